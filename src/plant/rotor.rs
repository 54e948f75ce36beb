//! The interface of a rotor to the plant, implemented by the planar rotor and by the spindle.

use std::fmt::Debug;

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::equations::{Motion, PlantInput};
use super::sensor::SensorConfig;
use crate::bearing::coil::CoilConfig;
use crate::bearing::magnet::Geometry;
use crate::bearing::scalar::Scalar;
use crate::invalid::{Checks, Short};
use crate::machine::Machine;

/// Parameters of a rotor with N coordinates and K magnets, as numbers of the type [`Number`](Rotor::Number).
///
/// Coordinates are in m, angles among them in rad; generalised forces are in N, moments among them in N·m.
pub trait Rotor<const N: usize, const K: usize>: Clone {
    /// The number type: `f64`, or a Taylor series.
    type Number: Scalar;

    /// The same parameters with another number type.
    type With<U: Scalar>: Rotor<N, K, Number = U, Contact = Self::Contact>;

    /// Which backup bearings the rotor touches.
    type Contact: Copy + Debug + Default + PartialEq + Serialize + DeserializeOwned;

    /// Combines these parameters with others, number by number; fields that are no numbers are taken from these.
    fn with<U: Scalar, V: Scalar>(&self, other: &Self::With<U>, join: &impl Fn(Self::Number, U) -> V) -> Self::With<V>;

    /// Gaps and directions of the magnets.
    fn geometry(&self) -> Geometry<Self::Number, N, K>;

    /// The mass or moment of inertia of each coordinate, in kg or kg·m².
    fn inertia(&self) -> [Self::Number; N];

    /// λ of each magnet, in N·m²/A².
    fn lambda_nm2_a2(&self) -> &[Self::Number; K];

    /// Readings of ideal position sensors at these coordinates, in m.
    fn readings_m(&self, position_m: [Self::Number; N]) -> [Self::Number; N];

    /// The coils.
    fn coil(&self) -> &CoilConfig<Self::Number>;

    /// All forces except those of magnets and backup bearings, at a time in s and an angle in rad.
    fn perturbation(
        &self,
        input: &PlantInput<Self::Number, N, K>,
        time_s: Self::Number,
        theta_rad: Self::Number,
    ) -> [Self::Number; N];

    /// The gyroscopic moments at the speed of the rotor in rad/s; `None` for a rotor that does not tilt.
    fn gyroscopic(&self, omega_rad_s: Self::Number, rates: [Self::Number; N]) -> Option<[Self::Number; N]>;

    /// Force of the backup bearings that are touched, at the speed of the rotor in rad/s.
    fn contact_n(
        &self,
        motion: &Motion<Self::Number, N, K>,
        omega_rad_s: Self::Number,
        contact: Self::Contact,
    ) -> [Self::Number; N];
}

/// Parameters of a plant: a [`Rotor`] with its sensors, start and integration.
pub trait PlantParameters<const N: usize, const K: usize>:
    Rotor<N, K, Number = f64, With<f64> = Self> + Debug + PartialEq
{
    /// How its parts are called.
    const MACHINE: &'static Machine;

    /// Reports invalid parameters by their names in the interface.
    fn check(&self, checks: &mut Checks);

    /// Reports invalid tunable parameters.
    fn check_tunable(&self, checks: &mut Checks);

    /// The same with the tunable parameters of others.
    fn retuned(&self, to: &Self) -> Self;

    /// Coordinates and rates at the start.
    fn start(&self) -> ([f64; N], [f64; N]);

    /// Angle of the rotor at the start, in rad.
    fn start_angle_rad(&self) -> f64;

    /// The sensors.
    fn sensor(&self) -> &SensorConfig<N, K>;

    /// Longest sub-step of the integration, in s.
    fn max_step_s(&self) -> f64;

    /// Which backup bearings the rotor touches.
    fn touches(&self, position_m: &[f64; N], velocity_m_s: &[f64; N]) -> Self::Contact;

    /// The fastest rate of motion and contact, in 1/s, where the magnets pull with these forces in N over these gaps in m.
    fn rate(&self, motion: &Motion<f64, N, K>, contact: Self::Contact, force_n: [f64; K], gap_m: [f64; K]) -> f64;
}

/// Reports a start that is not finite, and a rotor that starts at a magnet, by the coordinate that brings it nearest.
pub(super) fn check_start<R: PlantParameters<N, K>, const N: usize, const K: usize>(rotor: &R, checks: &mut Checks) {
    let (position_m, velocity_m_s) = rotor.start();
    let names = R::MACHINE.at_start(|coordinate| coordinate.position);
    for (n, name) in names.iter().enumerate() {
        checks.finite(name.clone(), position_m[n], R::MACHINE.either(n, "m", "rad"));
    }
    for (n, name) in R::MACHINE.at_start(|coordinate| coordinate.rate).into_iter().enumerate() {
        checks.finite(name, velocity_m_s[n], R::MACHINE.either(n, "m/s", "rad/s"));
    }
    checks.finite("theta0", rotor.start_angle_rad(), "rad");
    let geometry = rotor.geometry();
    for (k, gap) in geometry.gaps(position_m).into_iter().enumerate() {
        // False for values that are not finite, which have been refused already.
        if !(gap <= 0.0 && gap.is_finite() && geometry.gap_m[k] > 0.0) {
            continue;
        }
        let share = |n: usize| position_m[n] * geometry.directions[k][n];
        let worst = (0..N).fold(0, |worst, n| if share(n) > share(worst) { n } else { worst });
        let magnet = R::MACHINE.of_magnets("gap").swap_remove(k);
        checks.require(
            false,
            names[worst].clone(),
            format_args!("{} {}", position_m[worst], R::MACHINE.either(worst, "m", "rad")),
            format!("a start inside the gap ({magnet} would be {} m)", Short(gap)),
        );
        return;
    }
}

/// Reports invalid λ in N·m²/A², and unbalance of each plane in kg·m and rad.
pub(super) fn check_lambda_and_unbalance(
    machine: &Machine,
    lambda_nm2_a2: &[f64],
    unbalance_kgm: &[f64],
    unbalance_phase_rad: &[f64],
    checks: &mut Checks,
) {
    for (name, lambda) in machine.of_magnets("lambda").into_iter().zip(lambda_nm2_a2) {
        checks.positive(name, *lambda, "N.m2/A2");
    }
    for (name, kgm) in machine.of_planes("magnitude").into_iter().zip(unbalance_kgm) {
        checks.not_negative(name, *kgm, "kg.m");
    }
    for (name, rad) in machine.of_planes("phase").into_iter().zip(unbalance_phase_rad) {
        checks.finite(name, *rad, "rad");
    }
}
