//! `MagneticSpindle`, `MagneticSpindle4`: a rigid rotor in two radial magnetic bearings, with or without an axial one, with coils, two-plane
//! unbalance, loads, backup bearings and sensors.

use fmu_export::variable::Dependency::Fixed;
use fmu_export::variable::Row;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::bearing::scalar::Scalar;
use crate::fmu::plants::{self, ModelledRotor, PlantModel};
use crate::machine::Machine;
use crate::plant::spindle::{AtBearings, Contact, SpindleConfigOf};
use crate::plant::{Equations, Motion, PlantParameters};

/// The plant with N coordinates, M magnets in each radial bearing, and K magnets.
pub type Plant<const N: usize, const M: usize, const K: usize> = PlantModel<SpindleConfigOf<f64, N, M, K>, N, K>;

impl<const N: usize, const M: usize, const K: usize> ModelledRotor<N, K> for SpindleConfigOf<f64, N, M, K>
where
    // True of every length that is used; serde does not know it of all.
    Self: Serialize + DeserializeOwned,
{
    type Details = AtBearings;

    fn dependent(row: Row<plants::Values<Self, N, K>>) -> Row<plants::Values<Self, N, K>> {
        dependent(row, Self::MACHINE)
    }

    fn details<U: Scalar>(
        equations: &Equations<SpindleConfigOf<U, N, M, K>, N, K>,
        motion: &Motion<U, N, K>,
        omega_rad_s: U,
        contact: Contact,
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
