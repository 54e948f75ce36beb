//! Parameters of the plant of any machine.

use serde::{Deserialize, Serialize};

use super::check_step;
use super::sensor::SensorConfig;
use crate::bearing::coil::{CoilConfig, Saturates};
use crate::bearing::touchdown::TouchdownConfig;
use crate::bearing::{BearingConfig, Rotor, RotorConfig, Scalar, Shaft, array, joined};
use crate::invalid::{Checks, Short};
use crate::machine::Machine;
use crate::variables::unit::{METRE, METRE_PER_SECOND, METRE_PER_SECOND2, NEWTON, RADIAN, RADIAN_PER_SECOND, SECOND};
use crate::variables::{KILOGRAM_METRE, LAMBDA, OMEGA_RAD_S, Saved, Variables};

/// The largest number of planes with an unbalance.
pub const PLANES: usize = 2;

/// A harmonic perturbation force, per axis `amplitude sin(omega t + phase)`, with the absolute time t; by default 0, at 50 Hz.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Machine, default)]
#[serde(bound = "T: Saved, [T; N]: Saved")]
pub struct Harmonic<T = f64, const N: usize = 2> {
    /// Amplitude of a harmonic perturbation force along {axis}
    #[parameter(names = context.of_resultant("amplitude"), tunable, unit = NEWTON)]
    pub amplitude_n: [T; N],
    /// Angular frequency of the harmonic perturbation force
    #[parameter(
        name = "omega", tunable, unit = RADIAN_PER_SECOND, min = 0.0, nominal = 100.0, display_unit = "Hz",
        value = OMEGA_RAD_S
    )]
    pub omega_rad_s: T,
    /// Phase at time 0 of the harmonic perturbation force along {axis}, which is a sine
    #[parameter(names = context.of_resultant("phase"), tunable, unit = RADIAN)]
    pub phase_rad: [T; N],
}

/// Parameters of a rotor with N coordinates and of the K magnets of its B bearings, sensors, start and integration. Coordinates are in m,
/// angles in rad; generalised forces in N, moments in N·m.
///
/// By default the paper's bearing, one of the same size, or the balanced spindle of the examples; in a single radial bearing the rotor
/// starts on the paper's ellipse, otherwise at rest in the centre.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Machine, default)]
#[serde(
    bound = "T: Saved, [T; N]: Saved, [T; K]: Saved, RotorConfig<T, B>: Saved, [TouchdownConfig<T>; B]: Saved, SensorConfig<N, K>: Saved"
)]
pub struct PlantConfigOf<T, const N: usize, const K: usize, const B: usize> {
    /// Rotor and bearings.
    #[nested(prefix = "", value = RotorConfig::of(Rotor::<N, K, B>::MACHINE))]
    pub rotor: RotorConfig<T, B>,
    /// The coils.
    #[nested(prefix = "", context = Saturates(true))]
    pub coil: CoilConfig<T>,
    /// {position} {direction} at the start
    #[parameter(
        names = context.at_start(|coordinate| coordinate.position), unit = context.either(index, METRE, RADIAN),
        nominal = context.either(index, 1e-5, 1e-4), value = on_ellipse([30e-6, 0.0])
    )]
    pub position_m: [T; N],
    /// Derivative of {coordinate} at the start
    #[parameter(
        names = context.at_start(|coordinate| coordinate.rate),
        unit = context.either(index, METRE_PER_SECOND, RADIAN_PER_SECOND), nominal = context.either(index, 1e-2, 0.1),
        value = on_ellipse([0.0, 1e-6 * (70.0 * OMEGA_RAD_S)])
    )]
    pub velocity_m_s: [T; N],
    /// Initial rotor angle
    #[parameter(name = "theta0", unit = RADIAN)]
    pub theta_rad: T,
    /// Acceleration of gravity {direction}
    #[parameter(names = context.of_lengths("gravity."), unit = METRE_PER_SECOND2, nominal = 10.0)]
    pub gravity_m_s2: [T; N],
    /// The backup bearings.
    #[nested(
        prefixes = context.of_bearings(""), context = context.bearings[index],
        value = RotorConfig::of(Rotor::<N, K, B>::MACHINE).bearings.map(half_the_gap)
    )]
    pub touchdown: [TouchdownConfig<T>; B],
    /// The sensors.
    #[nested(prefix = "")]
    pub sensor: SensorConfig<N, K>,
    /// Upper bound of the integration step
    #[parameter(name = "solver.maxStep", unit = SECOND, above = 0.0, nominal = 1e-5, display_unit = "µs", value = 5e-5)]
    pub max_step_s: f64,
    /// Force constant of {magnet}
    #[parameter(
        names = context.of_magnets("lambda"), tunable, unit = LAMBDA, above = 0.0, nominal = 1e-6,
        value = array::from_fn(|k| lambda_nm2_a2(Rotor::<N, K, B>::MACHINE, k))
    )]
    pub lambda_nm2_a2: [T; K],
    /// Unbalance of the rotor{in plane}, mass times eccentricity
    #[parameter(names = context.of_planes("magnitude"), tunable, unit = KILOGRAM_METRE, min = 0.0, nominal = 1e-4)]
    pub unbalance_kgm: [T; PLANES],
    /// Angle of the unbalance{in plane} from the mark on the rotor that theta refers to
    #[parameter(names = context.of_planes("phase"), tunable, unit = RADIAN)]
    pub unbalance_phase_rad: [T; PLANES],
    /// Position of plane {k} along the shaft, from the centre of gravity
    #[parameter(
        names = context.of_planes("position").into_iter().take(context.if_tilting(PLANES)), unit = METRE, nominal = 0.1,
        value = [-0.08, 0.10]
    )]
    pub unbalance_position_m: [T; PLANES],
    /// Harmonic perturbation of a rotor in one bearing.
    #[nested(prefix = "perturbation.", count = context.if_single(1))]
    pub harmonic: Harmonic<T, N>,
}

/// Parameters of the paper's planar rotor.
pub type PlantConfig<T = f64> = PlantConfigOf<T, 2, 3, 1>;

/// The coordinates, or their rates, of a rotor in a single radial bearing; 0 for others.
fn on_ellipse<const N: usize>(yz: [f64; 2]) -> [f64; N] {
    array::from_fn(|n| if N == 2 { yz[n] } else { 0.0 })
}

fn half_the_gap(of: BearingConfig) -> TouchdownConfig {
    TouchdownConfig { clearance_m: 0.5 * of.gap_m, ..TouchdownConfig::default() }
}

/// The default force constant of magnet k, counted from 0.
fn lambda_nm2_a2(machine: &Machine, k: usize) -> f64 {
    match machine.magnet(k) {
        Some((1, number)) => [2.4e-6, 2.1e-6, 1.9e-6, 2.0e-6][number - 1],
        Some((2, number)) => [3.0e-6, 2.6e-6][number - 1],
        _ => [1.8e-6, 2.0e-6, 2.2e-6, if machine.tilts() { 2.3e-6 } else { 2.4e-6 }][k],
    }
}

impl<T: Scalar, const N: usize, const K: usize, const B: usize> PlantConfigOf<T, N, K, B> {
    /// Combines two sets of parameters, number by number; all other fields come from `self`.
    pub fn with<U: Scalar, V: Scalar>(
        &self,
        other: &PlantConfigOf<U, N, K, B>,
        join: &impl Fn(T, U) -> V,
    ) -> PlantConfigOf<V, N, K, B> {
        let (rotor, others) = (&self.rotor, &other.rotor);
        let rotor = joined!(rotor, others, join, RotorConfig {
            ; extent_m;
            shaft: joined!(&rotor.shaft, &others.shaft, join, Shaft { m_kg, transverse_kgm2, polar_kgm2;; }),
            bearings: array::from_fn(|b| joined!(&rotor.bearings[b], &others.bearings[b], join, BearingConfig {
                position_m, sensor_position_m, gap_m; alpha_rad;
            }))
        });
        let (harmonic, others) = (&self.harmonic, &other.harmonic);
        joined!(self, other, join, PlantConfigOf {
            theta_rad;
            lambda_nm2_a2, unbalance_kgm, unbalance_phase_rad, unbalance_position_m, gravity_m_s2, position_m, velocity_m_s;
            rotor: rotor,
            harmonic: joined!(harmonic, others, join, Harmonic { omega_rad_s; amplitude_n, phase_rad; }),
            coil: joined!(&self.coil, &other.coil, join, CoilConfig {
                resistance_ohm, leakage_h, limit_v, saturation_wb;; drive: self.coil.drive
            }),
            touchdown: std::array::from_fn(|b| joined!(&self.touchdown[b], &other.touchdown[b], join, TouchdownConfig {
                clearance_m, stiffness_n_m, damping_ns_m, friction, radius_m;;
            })),
            sensor: self.sensor.clone(),
            max_step_s: self.max_step_s
        })
    }
}

impl<const N: usize, const K: usize, const B: usize> PlantConfigOf<f64, N, K, B> {
    /// Checks combinations of numbers that are within their limits; findings have the names of the interface.
    pub(super) fn check(&self, checks: &mut Checks) {
        let rotor = Rotor::<N, K, B>::checked(self.rotor, checks);
        let machine = Rotor::<N, K, B>::MACHINE;
        if machine.tilts() {
            for (name, at_m) in machine.of_planes("position").into_iter().zip(self.unbalance_position_m) {
                self.rotor.check_position(name, at_m, checks);
            }
        }
        self.check_start(&rotor, checks);
        self.coil.check(rotor.geometry().gap_m, self.lambda_nm2_a2, checks);
        self.sensor.check(checks);
        check_step("solver.maxStep", self.max_step_s, checks);
    }

    /// Rejects a rotor that starts at a magnet; the finding names the coordinate that contributes most.
    fn check_start(&self, rotor: &Rotor<N, K, B>, checks: &mut Checks) {
        let (machine, position_m) = (Rotor::<N, K, B>::MACHINE, self.position_m);
        let geometry = rotor.geometry();
        let gaps = geometry.gaps(position_m);
        let Some(k) = gaps.iter().position(|gap_m| *gap_m <= 0.0) else { return };
        let share = |n: usize| position_m[n] * geometry.directions[k][n];
        let worst = (0..N).fold(0, |worst, n| if share(n) > share(worst) { n } else { worst });
        let magnet = machine.of_magnets("gap").swap_remove(k);
        let start = machine.at_start(|coordinate| coordinate.position).swap_remove(worst);
        let wanted = format!("a start inside the gap ({magnet} would be {} m)", Short(gaps[k]));
        checks.number(false, start, (position_m[worst], machine.either(worst, "m", "rad")), wanted);
    }
}
