//! The estimator of a spindle: two radial bearings, with or without an axial one, and two planes of unbalance.
//!
//! Radial magnets do not pull along the shaft, axial ones not across it: the radial motion, including tilt, and the axial motion, if any, are two machines,
//! each with its own filter and sums. The coordinates of each are its sensor readings, `r = H q`: sensor noise is then independent, and all coordinates
//! are lengths. With the acceleration `H M⁻¹ f` due to a generalised force f, and directions `H⁻ᵀ d`, the equations are those of the planar rotor.

use nalgebra::{SMatrix, SVector};

use super::motion::Square;
use super::parts::Parts;
use super::{Estimator, EstimatorConfigOf, Machine};
use crate::bearing::array;
use crate::bearing::magnet::Geometry;
use crate::bearing::rotor::{Rotor, RotorConfig, SHORTEST_DISTANCE_M};
use crate::bearing::shaft::{ACROSS, generalised};
use crate::invalid::Checks;
use crate::plant::PLANES;

/// The estimator of a spindle with three magnets in each radial bearing, and an axial one.
pub type SpindleEstimator = Estimator<RotorConfig<f64, 3>, 5, 8, 2>;

/// Number of uncertain parameters of the radial machine without the angles: gap, J_t, J_p, positions of magnets, of sensors, of unbalance.
const OTHER_PARAMETERS: usize = 9;

impl<const B: usize, const A: usize> EstimatorConfigOf<RotorConfig<f64, B>, A> {
    /// Reports parameters that [`Rotor::checked`] rejects; planes of unbalance off the shaft or too close to each other; tolerances that are too large.
    pub(super) fn check_shaft<const N: usize>(&self, checks: &mut Checks) {
        let (geometry, tolerance) = (&self.geometry, &self.tolerance);
        Rotor::<N, A, B>::checked(*geometry, checks);
        let [first_m, second_m] = self.unbalance_position_m;
        geometry.check_position("unbalance[1].position", first_m, checks);
        geometry.check_position("unbalance[2].position", second_m, checks);
        let wanted = format!("a position at least {SHORTEST_DISTANCE_M} m from unbalance[1].position = {first_m} m");
        let apart_m = (first_m - second_m).abs();
        checks.number(apart_m >= SHORTEST_DISTANCE_M, "unbalance[2].position", (second_m, "m"), wanted);
        let [begin_m, end_m] = geometry.extent_m;
        for (name, value) in [
            ("tolerance.position", tolerance.position_m),
            ("tolerance.sensorPosition", tolerance.sensor_position_m),
            ("tolerance.unbalancePosition", tolerance.unbalance_position_m),
        ] {
            let wanted = format!("less than the length of the shaft, {} m,", end_m - begin_m);
            checks.number(value < end_m - begin_m || begin_m >= end_m, name, (value, "m"), wanted);
        }
        let (inertia, of_inertia) = (geometry.shaft.transverse_kgm2, tolerance.transverse_kgm2);
        let wanted = format!("less than Jt = {inertia} kg.m2,");
        checks.number(of_inertia < inertia, "tolerance.Jt", (of_inertia, "kg.m2"), wanted);
        // The distance of the sensors determines the tilt.
        let apart_m = (geometry.bearings[0].sensor_position_m - geometry.bearings[1].sensor_position_m).abs();
        let value_m = tolerance.sensor_position_m;
        let wanted = format!("less than the distance of the sensors, {apart_m} m,");
        let small = value_m < apart_m || apart_m < SHORTEST_DISTANCE_M;
        checks.number(small, "tolerance.sensorPosition", (value_m, "m"), wanted);
    }

    /// The parts of the motion, for checked parameters.
    pub(super) fn parts_of_shaft<const N: usize, const K: usize, const U: usize, const T: usize, const R: usize>(
        &self,
    ) -> Parts<4, K, U, T> {
        const { assert!(R == OTHER_PARAMETERS + K, "an angle for each magnet") };
        let t = &self.tolerance;
        let mut std = [0.0; R];
        std[0] = t.gap_m;
        std[1..=K].fill(t.alpha_rad);
        let others = &mut std[1 + K..];
        others[..2].copy_from_slice(&[t.transverse_kgm2, t.polar_kgm2]);
        others[2..4].fill(t.position_m);
        others[4..6].fill(t.sensor_position_m);
        others[6..8].fill(t.unbalance_position_m);
        let radial = |change: [f64; R]| {
            let (mut geometry, mut planes_m) = (self.geometry, self.unbalance_position_m);
            let others = &change[1 + K..];
            geometry.shaft.transverse_kgm2 += others[0];
            geometry.shaft.polar_kgm2 += others[1];
            for (at, bearing) in geometry.bearings[..2].iter_mut().enumerate() {
                bearing.gap_m += change[0];
                let rotations = &change[1 + K / 2 * at..][..K / 2];
                bearing.alpha_rad.iter_mut().zip(rotations).for_each(|(alpha, rotation)| *alpha += rotation);
                bearing.position_m += others[2 + at];
                bearing.sensor_position_m += others[4 + at];
                planes_m[at] += others[6 + at];
            }
            // The checks cover parameters changed by a tolerance.
            Machine::of_shaft(&geometry, planes_m).unwrap_or_else(|| unreachable!("sensors at different places"))
        };
        let (m_kg, lambda0) = (self.geometry.shaft.m_kg, self.lambda0_nm2_a2);
        let axial =
            |[change_m]: [f64; 1]| Machine::of_bearing(m_kg, self.geometry.bearings[B - 1].gap_m + change_m, [0.0; 2]);
        let axial = || self.prediction_error(m_kg, axial, [t.gap_m], [lambda0[K], lambda0[K + 1]]);
        let first = self.prediction_error(m_kg, radial, std, array::from_fn(|k| lambda0[k]));
        Parts { first, axial: (N > ACROSS).then(axial) }
    }
}

impl<const K: usize, const U: usize> Machine<4, K, U> {
    /// The radial machine of a spindle with planes of unbalance; `None` if the readings do not determine the tilt.
    pub fn of_shaft<const B: usize>(spindle: &RotorConfig<f64, B>, planes_m: [f64; PLANES]) -> Option<Self> {
        let unit = |n: usize| array::from_fn(|other| if other == n { 1.0 } else { 0.0 });
        let h = Square::<4>::from_columns(&[0, 1, 2, 3].map(|n| SVector::from(spindle.readings(unit(n)))));
        let inverse = h.try_inverse()?;
        let inertia = SVector::from(spindle.shaft.inertia());
        let acceleration = |force: SVector<f64, 4>| -> SVector<f64, 4> { h * force.component_div(&inertia) };
        let geometry = spindle.geometry::<4, K>();
        let directions = geometry.directions.map(SVector::from);
        let axes_at = |at_m: f64| [[1.0, 0.0], [0.0, 1.0]].map(|axis| SVector::from(generalised(at_m, axis)));
        let bearings_m = [0, 1].map(|b| spindle.bearings[b].position_m);
        let rotating = planes_m.into_iter().chain(bearings_m).flat_map(axes_at);
        let loads = Square::<4>::identity();
        let forces = directions.into_iter().chain(rotating).chain(loads.column_iter().map(|x| x.into_owned()));
        let accelerations: Vec<_> = forces.map(|force| acceleration(force).transpose()).collect();
        let columns: [SVector<f64, 4>; 4] = array::from_fn(|c| {
            let rates: SVector<f64, 4> = inverse.column(c).into_owned();
            acceleration(spindle.shaft.gyroscopic(1.0, rates.into()).unwrap_or_default().into())
        });
        Some(Machine {
            geometry: Geometry { gap_m: geometry.gap_m, directions: directions.map(|d| inverse.tr_mul(&d).into()) },
            accelerations: SMatrix::from_rows(&accelerations),
            backward: K + 2 * PLANES,
            gyroscopic: Some(Square::from_columns(&columns)),
        })
    }
}
