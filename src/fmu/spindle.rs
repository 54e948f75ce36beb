//! `MagneticSpindle`: a rigid rotor in two radial magnetic bearings and an axial one, with coils, two-plane unbalance, loads, backup
//! bearings and sensors.

use fmu_export::variable::Dependency::Fixed;
use fmu_export::variable::Row;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::bearing::scalar::Scalar;
use crate::bearing::shaft::COORDINATES;
use crate::fmu::plants::{self, ModelledRotor, PlantModel};
use crate::machine::Machine;
use crate::plant::spindle::{AtBearings, SpindleConfig, SpindleConfigOf};
use crate::plant::{Equations, Motion, PlantParameters};

/// The plant with three magnets in each radial bearing.
pub type MagneticSpindle = PlantModel<SpindleConfig, COORDINATES, 8>;

/// That with four.
pub type MagneticSpindle4 = PlantModel<SpindleConfigOf<f64, 4, 10>, COORDINATES, 10>;

impl<const M: usize, const K: usize> ModelledRotor<COORDINATES, K> for SpindleConfigOf<f64, M, K>
where
    // True of every length that is used; serde does not know it of all.
    Self: Serialize + DeserializeOwned,
{
    type Details = AtBearings;

    fn dependent(row: Row<plants::Values<Self, COORDINATES, K>>) -> Row<plants::Values<Self, COORDINATES, K>> {
        dependent(row, Self::MACHINE)
    }

    fn start_mut(&mut self) -> (&mut [f64; COORDINATES], &mut [f64; COORDINATES], &mut f64) {
        (&mut self.position_m, &mut self.velocity_m_s, &mut self.theta_rad)
    }

    fn details<U: Scalar>(
        equations: &Equations<SpindleConfigOf<U, M, K>, COORDINATES, K>,
        motion: &Motion<U, COORDINATES, K>,
        omega_rad_s: U,
        contact: [bool; 3],
        force_n: [U; K],
        of: impl Fn(U) -> f64,
    ) -> AtBearings {
        equations.at_bearings(motion, omega_rad_s, contact, force_n).map(of)
    }
}

/// Coordinates that move the shaft sideways; Y is not A.Y.
const SIDEWAYS: [&str; 4] = [".Y", ".Z", "beta", "gamma"];

/// Their rates.
const RATES: [&str; 4] = ["vY", "vZ", "betaRate", "gammaRate"];

fn dependent<D>(row: Row<D>, machine: &Machine) -> Row<D> {
    let name = row.variable.name.clone();
    let (bearing, own) = name.split_once('.').unwrap_or(("", &name));
    let drives = || {
        let of_bearing = move |name: &String| name.starts_with(bearing);
        ["i", "psi"].into_iter().flat_map(|name| machine.of_magnets(name)).filter(of_bearing).collect::<Vec<_>>()
    };
    match (bearing, own) {
        (_, own) if own.starts_with("im[") => row.starts_from_parameters(),
        (_, "Ym" | "Zm" | "Xm") => row.starts_from_parameters(),
        (_, own) if own.starts_with("psi[") => {
            let current = name.replace("psi", "i");
            row.starts_from_parameters().starts_from([current])
        }
        ("A" | "B", "Y") => row.depends(Fixed, [".Y", "gamma"]),
        ("A" | "B", "Z") => row.depends(Fixed, [".Z", "beta"]),
        ("A" | "B", "FY" | "FZ") => row.depends_on(drives()).depends_on(SIDEWAYS),
        ("A" | "B", "touchdown.FY" | "touchdown.FZ") => {
            row.depends_on(["omega"]).depends_on(SIDEWAYS).depends_on(RATES)
        }
        ("A" | "B", "contact") => row.depends_on(SIDEWAYS).depends_on(RATES),
        ("X", "FX") => row.depends_on(drives()).depends_on(["X"]),
        ("X", "touchdown.FX" | "contact") => row.depends_on(["X", "vX"]),
        _ => row,
    }
}
