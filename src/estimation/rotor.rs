//! The parts of a rotor's motion from its parameters, and the checks of these.
//!
//! Radial magnets do not pull along the shaft, axial ones not across it: radial motion, including tilt, and axial motion are separate parts, each with its
//! own filter and sums. The coordinates of each are its sensor readings, `r = H q`, with `H = 1` for a rotor in one bearing: sensor noise is then
//! independent, and all coordinates are lengths. With the acceleration `H M⁻¹ f` due to a generalised force f, and directions `H⁻ᵀ d`, the equations of all
//! machines are those of the planar rotor.

use libm::sin;
use nalgebra::{SMatrix, SVector};

use super::innovations::{Tolerances, WhiteningFilter};
use super::models::prior;
use super::motion::Square;
use super::parts::Parts;
use super::prediction_error::PredictionError;
use super::{EstimatorConfigOf, Machine, Method, Names, paper};
use crate::bearing::array;
use crate::bearing::magnet::{Geometry, SMALLEST_SINE};
use crate::bearing::rotor::{Rotor, RotorConfig, SHORTEST_DISTANCE_M};
use crate::bearing::shaft::generalised;
use crate::invalid::Checks;
use crate::plant::PLANES;

/// Relative standard deviation of a force constant that is fixed at its first guess.
const FIXED_STD: f64 = 1.0e-3;

impl<const K: usize> EstimatorConfigOf<RotorConfig<f64, 1>, K> {
    /// Reports inconsistent parameters whose values are each within their limits, under their names in the interface.
    pub(super) fn check_bearing<const N: usize>(&self, checks: &mut Checks) {
        let alpha_rad = &self.geometry.bearings[0].alpha_rad[..K];
        for (k, alpha) in alpha_rad.iter().enumerate().filter(|_| N == 2) {
            for (l, other) in alpha_rad.iter().enumerate().take(k) {
                // Of four magnets two may be opposed, since these pull alternately: their currents distinguish them.
                let sine = if K == 3 { sin(alpha - other).abs() } else { 2.0 * sin(0.5 * (alpha - other)).abs() };
                let wanted =
                    format!("an angle off the line of magnet {}: their forces could not be distinguished", l + 1);
                let name = format!("alpha[{}]", k + 1);
                checks.number(sine >= SMALLEST_SINE, name, (*alpha, "rad"), wanted);
            }
        }
        if self.method != Method::PredictionError {
            paper::check(self, Names::of::<N, K>(), checks);
        }
    }
}

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
    pub(super) fn parts<const N: usize, const K: usize, const U: usize, const T: usize>(&self) -> Parts<N, K, U, T> {
        let RotorConfig { shaft, extent_m, bearings } = self.geometry;
        let lambda0 = self.lambda0_nm2_a2;
        let axial = || {
            let alone = RotorConfig { shaft, extent_m, bearings: [bearings[B - 1]] };
            self.part(alone, [lambda0[K], lambda0[K + 1]])
        };
        let first = self.part(self.geometry, array::from_fn(|k| lambda0[k]));
        Parts { first, axial: (Names::with::<B, A>().parts() > 1).then(axial) }
    }

    /// The motion along N coordinates with K magnets, U unknowns and T tolerances.
    fn part<const N: usize, const K: usize, const U: usize, const T: usize, const C: usize>(
        &self,
        rotor: RotorConfig<f64, C>,
        lambda0: [f64; K],
    ) -> PredictionError<N, K, U, T> {
        let (t, names) = (&self.tolerance, Names::of::<N, K>());
        // The machine after a change of one uncertain parameter by so many standard deviations.
        let changed = |parameter: usize, deviations: f64| {
            let (mut rotor, mut planes_m) = (rotor, self.unbalance_position_m);
            let (values, std) = self.uncertain(&mut rotor, &mut planes_m, names).swap_remove(parameter);
            values.into_iter().for_each(|value| *value += deviations * std);
            // The checks cover parameters changed by a tolerance.
            Machine::of(&rotor, planes_m).unwrap_or_else(|| unreachable!("sensors at different places"))
        };
        let machine = changed(0, 0.0);
        let (mut stated, mut planes_m) = (rotor, self.unbalance_position_m);
        let uncertain = self.uncertain(&mut stated, &mut planes_m, names);
        let stds: Vec<_> = uncertain.into_iter().map(|(_, std)| std).collect();
        debug_assert_eq!(stds.len(), T - 2 * N - K, "a column for each tolerance");
        let [gain, offset_m, current_a] = [t.position_gain, t.position_offset_m, t.current_offset_a];
        let is_any = stds.iter().chain(&[gain, offset_m, current_a]).any(|std| *std > 0.0);
        let variation = |parameter| Machine::variation([changed(parameter, 1.0), changed(parameter, -1.0)]);
        let tolerances = is_any.then(|| Tolerances {
            variations: (0..stds.len()).map(variation).collect(),
            gain,
            offset_m,
            current_a,
        });
        let mut prior = prior(lambda0, machine.backward..U - N, t.backward_force_n);
        if let Some(only) = self.used.only() {
            for k in (0..K).filter(|k| *k != only) {
                let std = FIXED_STD * lambda0[k];
                prior.precision[k] = 1.0 / (std * std);
            }
        }
        let mass = t.m_kg / rotor.shaft.m_kg;
        PredictionError {
            lambda0,
            prior,
            gap_m: machine.geometry.gap_m.into_iter().fold(f64::INFINITY, f64::min),
            filter: WhiteningFilter {
                machine,
                step_s: self.step_s,
                hold: self.hold,
                identify_unbalance: self.identify_unbalance,
                identify_backward: t.backward_force_n > 0.0,
                tolerances,
            },
            known_noise: [self.position_noise_m, self.current_noise_a],
            // The mass and the gains of the currents scale λ.
            scale_variance: mass * mass + 4.0 * t.current_gain * t.current_gain,
        }
    }

    /// The uncertain parameters with their standard deviations; those in one list change together.
    fn uncertain<'a, const C: usize>(
        &self,
        rotor: &'a mut RotorConfig<f64, C>,
        planes_m: &'a mut [f64; PLANES],
        machine: &Names,
    ) -> Vec<(Vec<&'a mut f64>, f64)> {
        let [mut gaps_m, mut alpha_rad, mut positions_m, mut sensors_m] = [const { Vec::new() }; 4];
        for (bearing, of) in rotor.bearings.iter_mut().zip(machine.bearings) {
            gaps_m.push(&mut bearing.gap_m);
            alpha_rad.extend(&mut bearing.alpha_rad[..of.if_radial() * of.magnets]);
            positions_m.push(&mut bearing.position_m);
            sensors_m.push(&mut bearing.sensor_position_m);
        }
        let t = &self.tolerance;
        let each = |values: Vec<&'a mut f64>, std: f64| values.into_iter().map(move |value| (vec![value], std));
        let mut uncertain = vec![(gaps_m, t.gap_m)];
        uncertain.extend(each(alpha_rad, t.alpha_rad));
        if machine.tilts() {
            uncertain.push((vec![&mut rotor.shaft.transverse_kgm2], t.transverse_kgm2));
            uncertain.push((vec![&mut rotor.shaft.polar_kgm2], t.polar_kgm2));
            uncertain.extend(each(positions_m, t.position_m));
            uncertain.extend(each(sensors_m, t.sensor_position_m));
            uncertain.extend(each(planes_m.iter_mut().collect(), t.unbalance_position_m));
        }
        uncertain
    }
}

impl<const N: usize, const K: usize, const U: usize> Machine<N, K, U> {
    /// The machine of a rotor, or its radial one, with planes of unbalance; `None` if the readings do not determine the tilt.
    pub fn of<const B: usize>(rotor: &RotorConfig<f64, B>, planes_m: [f64; PLANES]) -> Option<Self> {
        let names = Names::of::<N, K>();
        let unit = |n: usize| array::from_fn(|other| if other == n { 1.0 } else { 0.0 });
        let h = Square::<N>::from_columns(&array::from_fn::<_, N, _>(|n| SVector::from(rotor.readings(unit(n)))));
        let inverse = h.try_inverse()?;
        let inertia = SVector::from(rotor.shaft.inertia());
        let acceleration = |force: SVector<f64, N>| -> SVector<f64, N> { h * force.component_div(&inertia) };
        let geometry = rotor.geometry::<N, K>();
        let directions = geometry.directions.map(SVector::from);
        let axes_at = |at_m: f64| [[1.0, 0.0], [0.0, 1.0]].map(|axis| SVector::from(generalised(at_m, axis)));
        let bearings_m = rotor.bearings.iter().take(names.radial()).map(|bearing| bearing.position_m);
        let rotating = planes_m.into_iter().take(names.planes).chain(bearings_m).flat_map(axes_at);
        let loads = Square::<N>::identity();
        let forces = directions.into_iter().chain(rotating).chain(loads.column_iter().map(|x| x.into_owned()));
        let accelerations: Vec<_> = forces.map(|force| acceleration(force).transpose()).collect();
        let gyroscopic = |rates: SVector<f64, N>| Some(acceleration(rotor.shaft.gyroscopic(1.0, rates.into())?.into()));
        let columns: Option<Vec<_>> = inverse.column_iter().map(|rates| gyroscopic(rates.into_owned())).collect();
        Some(Machine {
            geometry: Geometry { gap_m: geometry.gap_m, directions: directions.map(|d| inverse.tr_mul(&d).into()) },
            accelerations: SMatrix::from_rows(&accelerations),
            backward: K + 2 * names.planes,
            gyroscopic: columns.map(|columns| Square::from_columns(&columns)),
        })
    }
}
