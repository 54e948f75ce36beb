//! `MagneticBearing`: the rotor, its three magnets and their coils, unbalance, perturbation forces, backup bearing and
//! sensors.

use fmu_export::Info;
use fmu_export::variable::{Row, Value};
use serde::{Deserialize, Serialize};

use super::common::info;
use super::plants::{self, ModelledRotor, PlantModel};
use crate::bearing::scalar::Scalar;
use crate::invalid;
use crate::machine::PLANAR;
use crate::plant::{Equations, Motion, Plant, PlantConfig, PlantInput};
use crate::variables::Variables;

/// The plant.
pub type MagneticBearing = PlantModel<PlantConfig, 2, 3>;

/// The values of all variables of the plant.
type Values = plants::Values<PlantConfig, 2, 3>;

/// Configuration and inputs of a plant with the given values by index, and start values elsewhere.
pub fn configuration(settings: &[(usize, Value)]) -> (PlantConfig, PlantInput) {
    plants::configuration(settings)
}

/// Outputs that other plants have not.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
pub struct Touchdown {
    /// Whether the rotor touches the backup bearing
    #[output(name = "touchdown.contact")]
    contact: bool,
}

impl ModelledRotor<2, 3> for PlantConfig {
    const INFO: Info = info(
        "MagneticBearing",
        "Rotor in a three-phase radial magnetic bearing, with unbalance, perturbation forces and sensors",
    );
    type Details = Touchdown;

    fn dependent(row: Row<Values>) -> Row<Values> {
        dependent(row)
    }

    fn start_mut(&mut self) -> (&mut [f64; 2], &mut [f64; 2], &mut f64) {
        (&mut self.position_m, &mut self.velocity_m_s, &mut self.theta_rad)
    }

    fn retune(plant: &mut Plant, to: &Self) -> Result<(), Vec<invalid::Invalid>> {
        plant.retune(to.lambda_nm2_a2, to.unbalance_kgm, to.unbalance_phase_rad, to.harmonic.clone())
    }

    fn details<U: Scalar>(
        _: &Equations<PlantConfig<U>>,
        _: &Motion<U>,
        _: U,
        contact: bool,
        _: [U; 3],
        _: impl Fn(U) -> f64,
    ) -> Touchdown {
        Touchdown { contact }
    }
}

/// Position and velocity of the rotor.
const MOTION: [&str; 4] = ["Y", "Z", "vY", "vZ"];

/// What forces of magnets depend on at the start, besides what belongs to the magnet.
const PULLING: [&str; 5] = ["s", "Y0", "Z0", "drive", "coil.fluxSaturation"];

/// What contact with the backup bearing depends on at the start.
const TOUCHING: [&str; 7] =
    ["Y0", "Z0", "vY0", "vZ0", "touchdown.clearance", "touchdown.stiffness", "touchdown.damping"];

/// What the perturbation along either axis depends on at the start.
const ACTING: [&str; 6] = ["perturbation.omega", "unbalance.magnitude", "unbalance.phase", "omega", "theta0", "m"];

fn dependent(row: Row<Values>) -> Row<Values> {
    let (name, k) = (row.variable.name.clone(), row.index());
    let axis = ["Y", "Z"].get(k).copied().unwrap_or_default();
    let along = |names: &[&str]| names.iter().map(|name| format!("{name}{axis}")).collect::<Vec<_>>();
    match name.split('[').next().unwrap_or(&name) {
        "Ym" | "Zm" => row
            .starts_from([format!("{axis}0")])
            .starts_from(along(&["sensor.offset", "sensor.gainError"]))
            .starts_from(["sensor.positionNoise", "sensor.positionResolution", "sensor.seed"]),
        "im" => row.starts_from([
            "sensor.currentNoise",
            "sensor.currentResolution",
            "sensor.seed",
            "sensor.currentOffset[{k}]",
        ]),
        "F" => row.starts_from(PULLING).starts_from(["lambda[{k}]", "alpha[{k}]", "i[{k}]", "coil.open[{k}]"]),
        "FY" | "FZ" => row
            .depends_on(["i", "psi", "Y", "Z"])
            .starts_from(PULLING)
            .starts_from(["alpha", "lambda", "i", "coil.open"].into_iter().flat_map(|name| PLANAR.of_magnets(name))),
        "gap" => row.starts_from(["s", "Y0", "Z0", "alpha[{k}]"]),
        "perturbation.Y" | "perturbation.Z" => row.starts_from(ACTING).starts_from(along(&[
            "p",
            "perturbation.amplitude",
            "perturbation.phase",
            "gravity.",
        ])),
        "touchdown.contact" => row.depends_on(MOTION).starts_from(TOUCHING),
        "touchdown.FY" | "touchdown.FZ" => row
            .depends_on(["omega"])
            .depends_on(MOTION)
            .starts_from(["omega", "touchdown.friction", "touchdown.radius"])
            .starts_from(TOUCHING),
        _ => row,
    }
}
