//! `MagneticBearing`, `MagneticBearing4`, `AxialBearing`: the rotor, its magnets and their coils, unbalance, perturbation forces, backup bearing and
//! sensors.

use fmu_export::variable::Row;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::plants::{self, ModelledRotor, PlantModel};
use crate::bearing::scalar::Scalar;
use crate::machine::Machine;
use crate::plant::{Equations, Motion, PlantParameters, RotorConfig};
use crate::variables::Variables;

/// The plant with N coordinates and K magnets.
pub type Plant<const N: usize, const K: usize> = PlantModel<RotorConfig<f64, N, K>, N, K>;

/// The values of all variables of the plant.
type Values<const N: usize, const K: usize> = plants::Values<RotorConfig<f64, N, K>, N, K>;

/// Outputs that other plants have not.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
pub struct Touchdown {
    /// Whether the rotor touches the backup bearing
    #[output(name = "touchdown.contact")]
    contact: bool,
}

impl<const N: usize, const K: usize> ModelledRotor<N, K> for RotorConfig<f64, N, K>
where
    // True of every length that is used; serde does not know it of all.
    Self: Serialize + DeserializeOwned,
{
    type Details = Touchdown;

    fn dependent(row: Row<Values<N, K>>) -> Row<Values<N, K>> {
        dependent(row, Self::MACHINE)
    }

    fn details<U: Scalar>(
        _: &Equations<RotorConfig<U, N, K>, N, K>,
        _: &Motion<U, N, K>,
        _: U,
        contact: bool,
        _: [U; K],
        _: impl Fn(U) -> f64,
    ) -> Touchdown {
        Touchdown { contact }
    }
}

/// Dependencies of contact with the backup bearing at the start, besides the motion.
const TOUCHING: [&str; 3] = ["touchdown.clearance", "touchdown.stiffness", "touchdown.damping"];

fn dependent<D>(row: Row<D>, machine: &Machine) -> Row<D> {
    let (name, k) = (row.variable.name.clone(), row.index());
    let axis = machine.resultant.get(k).copied().unwrap_or_default();
    let along = |names: &[&str]| names.iter().map(|name| format!("{name}{axis}")).collect::<Vec<_>>();
    let at_start = machine.at_start(|coordinate| coordinate.position);
    let rate_at_start = machine.at_start(|coordinate| coordinate.rate);
    // An axial bearing has neither angles of magnets nor an unbalance.
    let angle = machine.is_planar().then_some("alpha[{k}]");
    let turning: &[&str] =
        if machine.planes > 0 { &["unbalance.magnitude", "unbalance.phase", "omega", "theta0"] } else { &[] };
    let ring: &[&str] = if machine.is_planar() { &["omega"] } else { &[] };
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
            pulling(row.depends_on(["i", "psi"]).depends_on(machine.of_resultant("")))
                .starts_from(angles.chain(of_magnets))
        }
        "gap" => row.starts_from(["s"]).starts_from(at_start.clone()).starts_from(angle),
        "perturbation." => row
            .starts_from(["perturbation.omega"])
            .starts_from(turning.iter().copied())
            .starts_from(["m"])
            .starts_from(along(&["p", "perturbation.amplitude", "perturbation.phase", "gravity."])),
        "touchdown.contact" => touching(row.depends_on(machine.of_resultant("")).depends_on(machine.of_resultant("v"))),
        "touchdown.F" => touching(
            row.depends_on(ring.iter().copied())
                .depends_on(machine.of_resultant(""))
                .depends_on(machine.of_resultant("v"))
                .starts_from(ring.iter().copied())
                .starts_from(["touchdown.friction", "touchdown.radius"].into_iter().filter(|_| machine.is_planar())),
        ),
        _ => row,
    }
}
