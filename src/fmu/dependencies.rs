//! Dependencies of a plant's outputs: on inputs and states, and at the start on parameters.

use fmu_export::variable::Dependency::{Constant, Fixed};
use fmu_export::variable::Row;

use crate::machine::{Coordinate, Machine};

/// Adds the inputs and states on which an output depends directly, and those at the start that do not follow from these.
pub(super) fn dependent(row: Row<()>, machine: &Machine) -> Row<()> {
    let name = row.variable.name.clone();
    if let Some(n) = machine.coordinates.iter().position(|of| [of.perturbation, of.acceleration].contains(&&*name)) {
        return along(row, n, machine);
    }
    let Some(b) = machine.bearings.iter().position(|bearing| name.starts_with(bearing.prefix)) else {
        let is_reading = machine.readings.iter().any(|reading| name == reading.name);
        return if is_reading { row.starts_from_parameters() } else { row };
    };
    // The name is `prefix kind [number]`; those of a bearing's other variables have the same prefix and number.
    let (prefix, own) = name.split_at(machine.bearings[b].prefix.len());
    let (kind, number) = own.split_at(own.find('[').unwrap_or(own.len()));
    let beside = |kind: &'static str| format!("{prefix}{kind}{number}");
    // The leading dot distinguishes Y from A.Y.
    let of_moved = |part: fn(&Coordinate) -> &'static str| {
        machine.moves(b).into_iter().map(move |n| format!(".{}", part(&machine.coordinates[n])))
    };
    let positions = of_moved(|coordinate| coordinate.position);
    let motion = positions.clone().chain(of_moved(|coordinate| coordinate.rate));
    let row = match kind {
        "F" | "FX" | "FY" | "FZ" => row.depends_on(["i", "psi"].map(beside)).depends_on(positions),
        "coil.uInduced" => row.depends_on(["u", "psi"].map(beside)).depends_on(positions),
        "gap" => row.depends(Fixed, positions),
        // The rotation causes no axial friction.
        "touchdown.FY" | "touchdown.FZ" => row.depends_on(["omega"]).depends_on(motion),
        "touchdown.FX" | "touchdown.contact" | "contact" => row.depends_on(motion),
        _ => row,
    };
    if !machine.tilts() {
        return at_start(row, kind, beside, machine);
    }
    match kind {
        "Ym" | "Zm" | "im" => row.starts_from_parameters(),
        "psi" => row.starts_from_parameters().starts_from([beside("i")]),
        "Y" => row.depends(Fixed, [".Y", "gamma"]),
        "Z" => row.depends(Fixed, [".Z", "beta"]),
        _ => row,
    }
}

/// Dependencies of an acceleration, or of the forces along a coordinate besides those of magnets and backup bearings.
fn along(row: Row<()>, n: usize, machine: &Machine) -> Row<()> {
    let coordinate = &machine.coordinates[n];
    let acting: Vec<_> = (0..machine.bearings.len()).filter(|b| machine.moves(*b).contains(&n)).collect();
    let moved = machine.moves(acting[0]);
    // A single coordinate is axial, where no force rotates with the shaft.
    let turning = ["omega", "rotor.theta"].into_iter().filter(|_| moved.len() > 1);
    if row.variable.name == coordinate.acceleration {
        let drives = |b: usize| ["i", "psi"].map(|name| format!("{}{name}", machine.bearings[b].prefix));
        let motion = moved.iter().map(|n| &machine.coordinates[*n]);
        return row
            .depends_on(acting.into_iter().flat_map(drives))
            .depends(Fixed, [coordinate.load])
            .depends_on(turning)
            .depends_on(motion.flat_map(|coordinate| [coordinate.position, coordinate.rate]));
    }
    let row = row.depends(Constant, [coordinate.load]).depends_on(turning);
    if machine.tilts() {
        return row;
    }
    let unbalance = ["unbalance.magnitude", "unbalance.phase", "omega", "theta0"];
    let own = ["p", "perturbation.amplitude", "perturbation.phase", "gravity."];
    row.starts_from(["perturbation.omega", "m"])
        .starts_from(unbalance.into_iter().filter(|_| machine.planes > 0))
        .starts_from(own.map(|name| format!("{name}{}", coordinate.position)))
}

/// Dependencies of the other outputs of a rotor in one bearing at the start; `beside` returns the name of a variable of the same magnet or magnets.
fn at_start(row: Row<()>, kind: &str, beside: impl Fn(&'static str) -> String, machine: &Machine) -> Row<()> {
    let position = machine.at_start(|coordinate| coordinate.position);
    let motion = position.iter().cloned().chain(machine.at_start(|coordinate| coordinate.rate));
    // Radial magnets have angles; friction is radial as well.
    let angle = machine.is_planar().then(|| beside("alpha"));
    let friction = ["omega", "touchdown.friction", "touchdown.radius"].into_iter().filter(|_| machine.is_planar());
    let touchdown = ["touchdown.clearance", "touchdown.stiffness", "touchdown.damping"];
    match kind {
        "Xm" | "Ym" | "Zm" => {
            let axis = kind.trim_end_matches('m');
            row.starts_from([format!("{axis}0"), format!("sensor.offset{axis}"), format!("sensor.gainError{axis}")])
                .starts_from(["sensor.positionNoise", "sensor.positionResolution", "sensor.seed"])
        }
        "im" => row
            .starts_from(["sensor.currentNoise", "sensor.currentResolution", "sensor.seed"])
            .starts_from([beside("sensor.currentOffset")]),
        "F" | "FX" | "FY" | "FZ" => row
            .starts_from(["s", "drive", "coil.fluxSaturation"])
            .starts_from(position)
            .starts_from(angle)
            .starts_from(["lambda", "i", "coil.open"].map(beside)),
        "gap" => row.starts_from(["s"]).starts_from(position).starts_from(angle),
        "touchdown.contact" => row.starts_from(motion).starts_from(touchdown),
        "touchdown.FX" | "touchdown.FY" | "touchdown.FZ" => {
            row.starts_from(motion).starts_from(touchdown).starts_from(friction)
        }
        _ => row,
    }
}
