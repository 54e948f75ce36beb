//! Dependencies of a plant's outputs: on inputs and states, and at the start on parameters.

use fmu_export::variable::Dependency::{Constant, Fixed};
use fmu_export::variable::Row;

use crate::machine::{Coordinate, Machine};

/// Adds the inputs and states on which an output depends directly.
pub(super) fn feedthrough(row: Row<()>, machine: &Machine) -> Row<()> {
    let (name, index) = (row.variable.name.clone(), row.index());
    let is_of_magnet = |quantity: &str| machine.of_magnets(quantity).get(index).is_some_and(|known| *known == name);
    let of_magnet = |quantity: &str| machine.of_magnets(quantity)[index].clone();
    let bearing = machine.magnet(index).map_or(0, |(bearing, _)| bearing);
    let moving = || machine.moves(bearing).into_iter().map(|n| machine.coordinates[n].position);
    if is_of_magnet("F") {
        return row.depends_on(["i", "psi"].map(of_magnet)).depends_on(moving());
    }
    if is_of_magnet("gap") {
        return row.depends(Fixed, moving());
    }
    if is_of_magnet("coil.uInduced") {
        return row.depends_on(["u", "psi"].map(of_magnet)).depends_on(moving());
    }
    let at_bearing =
        machine.bearings.iter().enumerate().find_map(|(b, bearing)| Some((b, name.strip_prefix(bearing.prefix)?)));
    if let Some((b, own)) = at_bearing {
        // The leading dot distinguishes Y from A.Y.
        let of_moved = |part: fn(&Coordinate) -> &'static str| {
            machine.moves(b).into_iter().map(move |n| format!(".{}", part(&machine.coordinates[n])))
        };
        let positions = of_moved(|coordinate| coordinate.position);
        let motion = positions.clone().chain(of_moved(|coordinate| coordinate.rate));
        let magnets = machine.magnets_of(b);
        match own {
            "FX" | "FY" | "FZ" => {
                let drives = ["i", "psi"].map(|quantity| machine.of_magnets(quantity)[magnets.clone()].to_vec());
                return row.depends_on(drives.concat()).depends_on(positions);
            }
            // The rotation causes no axial friction.
            "touchdown.FY" | "touchdown.FZ" => return row.depends_on(["omega"]).depends_on(motion),
            "touchdown.FX" | "touchdown.contact" | "contact" => return row.depends_on(motion),
            _ => (),
        }
    }
    let Some(coordinate) = machine.coordinates.get(index) else { return row };
    // The coordinates on which the same magnets act. A single one is axial, where no force rotates with the shaft.
    let moved = (0..machine.bearings.len()).map(|b| machine.moves(b)).find(|moved| moved.contains(&index));
    let moved = moved.unwrap_or_default();
    let turning: &[&str] = if moved.len() > 1 { &["omega", "rotor.theta"] } else { &[] };
    if name == coordinate.perturbation {
        return row.depends(Constant, [coordinate.load]).depends_on(turning.iter().copied());
    }
    if name == coordinate.acceleration {
        let magnets = (0..machine.magnets())
            .filter(|k| machine.magnet(*k).is_some_and(|(bearing, _)| machine.moves(bearing) == moved));
        let drives = magnets.flat_map(|k| ["i", "psi"].map(|quantity| machine.of_magnets(quantity).swap_remove(k)));
        let motion = moved.iter().map(|n| &machine.coordinates[*n]);
        return row
            .depends_on(drives)
            .depends(Fixed, [coordinate.load])
            .depends_on(turning.iter().copied())
            .depends_on(motion.flat_map(|coordinate| [coordinate.position, coordinate.rate]));
    }
    row
}

/// Adds the remaining dependencies of a row, mainly those at the start.
pub(super) fn dependent(row: Row<()>, machine: &Machine) -> Row<()> {
    if machine.tilts() { of_shaft(row) } else { of_one_bearing(row, machine) }
}

/// Parameters, besides the motion, on which contact with the backup bearing depends at the start.
const TOUCHING: [&str; 3] = ["touchdown.clearance", "touchdown.stiffness", "touchdown.damping"];

/// Dependencies of the outputs of a rotor in one bearing at the start.
fn of_one_bearing(row: Row<()>, machine: &Machine) -> Row<()> {
    let (name, k) = (row.variable.name.clone(), row.index());
    let axis = machine.coordinates.get(k).map_or("", |coordinate| coordinate.position);
    let along = |names: &[&str]| names.iter().map(|name| format!("{name}{axis}")).collect::<Vec<_>>();
    let at_start = machine.at_start(|coordinate| coordinate.position);
    let rate_at_start = machine.at_start(|coordinate| coordinate.rate);
    // An axial bearing has neither magnet angles nor unbalance.
    let angle = machine.is_planar().then_some("alpha[{k}]");
    let turning: &[&str] =
        if machine.planes > 0 { &["unbalance.magnitude", "unbalance.phase", "omega", "theta0"] } else { &[] };
    let pulling = |row: Row<_>| {
        row.starts_from(["s"]).starts_from(at_start.clone()).starts_from(["drive", "coil.fluxSaturation"])
    };
    let touching =
        |row: Row<_>| row.starts_from(at_start.clone()).starts_from(rate_at_start.clone()).starts_from(TOUCHING);
    let kind = name.split('[').next().unwrap_or(&name).trim_end_matches(axis);
    match kind {
        _ if machine.measured().contains(&name.to_string()) => row
            .starts_from([format!("{axis}0")])
            .starts_from(along(&["sensor.offset", "sensor.gainError"]))
            .starts_from(["sensor.positionNoise", "sensor.positionResolution", "sensor.seed"]),
        "im" => row.starts_from([
            "sensor.currentNoise",
            "sensor.currentResolution",
            "sensor.seed",
            "sensor.currentOffset[{k}]",
        ]),
        "F" if name.contains('[') => {
            pulling(row).starts_from(["lambda[{k}]"]).starts_from(angle).starts_from(["i[{k}]", "coil.open[{k}]"])
        }
        "F" => {
            let of_magnets = ["lambda", "i", "coil.open"].into_iter().flat_map(|name| machine.of_magnets(name));
            let angles = machine.of_magnets("alpha").into_iter().filter(|_| machine.is_planar());
            pulling(row).starts_from(angles.chain(of_magnets))
        }
        "gap" => row.starts_from(["s"]).starts_from(at_start.clone()).starts_from(angle),
        "perturbation." => row
            .starts_from(["perturbation.omega"])
            .starts_from(turning.iter().copied())
            .starts_from(["m"])
            .starts_from(along(&["p", "perturbation.amplitude", "perturbation.phase", "gravity."])),
        "touchdown.contact" => touching(row),
        "touchdown.F" => {
            let ring = ["omega", "touchdown.friction", "touchdown.radius"].into_iter();
            touching(row.starts_from(ring.filter(|_| machine.is_planar())))
        }
        _ => row,
    }
}

/// Dependencies of the outputs of a shaft at its bearings.
fn of_shaft(row: Row<()>) -> Row<()> {
    let name = row.variable.name.clone();
    match name.split_once('.').unwrap_or(("", &name)) {
        (_, "Ym" | "Zm" | "Xm") => row.starts_from_parameters(),
        (_, own) if own.starts_with("im[") => row.starts_from_parameters(),
        (_, own) if own.starts_with("psi[") => row.starts_from_parameters().starts_from([name.replace("psi", "i")]),
        ("A" | "B", "Y") => row.depends(Fixed, [".Y", "gamma"]),
        ("A" | "B", "Z") => row.depends(Fixed, [".Z", "beta"]),
        _ => row,
    }
}
