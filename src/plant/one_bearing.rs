//! A rotor in one bearing: across its axis, as in the paper, with coordinates (y, z) and three or four magnets, or along it, with the
//! coordinate x and a magnet on either side.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use super::check_step;
use super::equations::{Motion, PlantInput};
use super::rotor::{PlantParameters, Rotor, check_lambda_and_unbalance, check_start};
use super::sensor::SensorConfig;
use crate::bearing::coil::{CoilConfig, Saturates};
use crate::bearing::magnet::{Geometry, MagnetsOf, alpha_rad};
use crate::bearing::scalar::Scalar;
use crate::bearing::touchdown::{Called, TouchdownConfig};
use crate::invalid::Checks;
use crate::machine::Machine;
use crate::variables::unit::{
    KILOGRAM, METRE, METRE_PER_SECOND, METRE_PER_SECOND2, NEWTON, RADIAN, RADIAN_PER_SECOND, SECOND,
};
use crate::variables::{KILOGRAM_METRE, LAMBDA, Variables};

/// A harmonic perturbation force, per axis `amplitude sin(omega t + phase)`, with t the absolute time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Machine)]
#[serde(bound(
    serialize = "T: Serialize, [T; N]: Serialize",
    deserialize = "T: Deserialize<'de>, [T; N]: Deserialize<'de>"
))]
pub struct Harmonic<T = f64, const N: usize = 2> {
    /// Amplitude of a harmonic perturbation force along {axis}
    #[parameter(names = context.of_resultant("amplitude"), tunable, unit = NEWTON)]
    pub amplitude_n: [T; N],
    /// Angular frequency of the harmonic perturbation force
    #[parameter(name = "omega", tunable, unit = RADIAN_PER_SECOND, min = 0.0, nominal = 100.0, display_unit = "Hz")]
    pub omega_rad_s: T,
    /// Phase at time 0 of the harmonic perturbation force along {axis}, which is a sine
    #[parameter(names = context.of_resultant("phase"), tunable, unit = RADIAN)]
    pub phase_rad: [T; N],
}

impl<const N: usize> Default for Harmonic<f64, N> {
    /// None, at 50 Hz.
    fn default() -> Self {
        Self { amplitude_n: [0.0; N], omega_rad_s: 2.0 * PI * 50.0, phase_rad: [0.0; N] }
    }
}

/// The bearing and the initial conditions of the rotor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Machine)]
#[serde(bound(
    serialize = "T: Serialize, [T; N]: Serialize, [T; K]: Serialize, [f64; N]: Serialize, [f64; K]: Serialize",
    deserialize = "T: Deserialize<'de>, [T; N]: Deserialize<'de>, [T; K]: Deserialize<'de>, [f64; N]: Deserialize<'de>, \
                   [f64; K]: Deserialize<'de>"
))]
pub struct RotorConfig<T, const N: usize, const K: usize> {
    /// Mass of the rotor
    #[parameter(name = "m", unit = KILOGRAM, min = 0.0)]
    pub m_kg: T,
    /// Nominal air gap
    #[parameter(name = "s", unit = METRE, min = 0.0, nominal = 1e-4, display_unit = "mm")]
    pub gap_m: T,
    /// Angle of magnet {k}; its direction is (sin alpha, cos alpha) in the y-z plane
    #[parameter(name = "alpha", count = context.angles(), unit = RADIAN)]
    pub alpha_rad: [T; K],
    /// Initial position of the rotor along {axis}
    #[parameter(names = context.at_start(|coordinate| coordinate.position), unit = METRE, nominal = 1e-5)]
    pub position_m: [T; N],
    /// Initial velocity of the rotor along {axis}
    #[parameter(names = context.at_start(|coordinate| coordinate.rate), unit = METRE_PER_SECOND, nominal = 1e-2)]
    pub velocity_m_s: [T; N],
    /// The coils.
    #[nested(prefix = "", context = Saturates(true))]
    pub coil: CoilConfig<T>,
    /// Acceleration of gravity along {axis}
    #[parameter(names = context.of_resultant("gravity."), unit = METRE_PER_SECOND2, nominal = 10.0)]
    pub gravity_m_s2: [T; N],
    /// The backup bearing.
    #[nested(prefix = "", context = backup_bearing(context))]
    pub touchdown: TouchdownConfig<T>,
    /// Initial rotor angle
    #[parameter(name = "theta0", unit = RADIAN)]
    pub theta_rad: T,
    /// The sensors.
    #[nested(prefix = "")]
    pub sensor: SensorConfig<N, K>,
    /// Upper bound of the integration step
    #[parameter(name = "solver.maxStep", unit = SECOND, min = 0.0, nominal = 1e-5, display_unit = "µs")]
    pub max_step_s: f64,
    /// Force constant of magnet {k}
    #[parameter(name = "lambda", tunable, unit = LAMBDA, min = 0.0, nominal = 1e-6)]
    pub lambda_nm2_a2: [T; K],
    /// Unbalance of the rotor, mass times eccentricity
    #[parameter(name = "unbalance.magnitude", count = context.planes, tunable, unit = KILOGRAM_METRE, min = 0.0, nominal = 1e-4)]
    pub unbalance_kgm: T,
    /// Angle of the unbalance from the mark on the rotor that theta refers to
    #[parameter(name = "unbalance.phase", count = context.planes, tunable, unit = RADIAN)]
    pub unbalance_phase_rad: T,
    /// Harmonic perturbation.
    #[nested(prefix = "perturbation.")]
    pub harmonic: Harmonic<T, N>,
}

/// That of the planar rotor of the paper.
pub type PlantConfig<T = f64> = RotorConfig<T, 2, 3>;

/// Name of the backup bearing of a machine with one bearing.
fn backup_bearing(machine: &Machine) -> Called {
    match machine.is_planar() {
        true => Called { what: "backup bearing", from: "centre", is_ring: true },
        false => Called { what: "axial stop", from: "middle", is_ring: false },
    }
}

impl<const N: usize, const K: usize> Default for RotorConfig<f64, N, K> {
    /// The paper's bearing, or one of the same size; across its axis the rotor is on the paper's ellipse.
    fn default() -> Self {
        Self {
            m_kg: 6.7,
            gap_m: 5e-4,
            alpha_rad: alpha_rad(),
            lambda_nm2_a2: std::array::from_fn(|k| [1.8e-6, 2.0e-6, 2.2e-6, 2.4e-6][k]),
            unbalance_kgm: 0.0,
            unbalance_phase_rad: 0.0,
            harmonic: Harmonic::default(),
            gravity_m_s2: [0.0; N],
            coil: CoilConfig::default(),
            touchdown: TouchdownConfig::default(),
            position_m: std::array::from_fn(|n| if N == 2 { [30e-6, 0.0][n] } else { 0.0 }),
            velocity_m_s: std::array::from_fn(|n| if N == 2 { [0.0, 0.021991148575128554][n] } else { 0.0 }),
            theta_rad: 0.0,
            sensor: SensorConfig::default(),
            max_step_s: 5e-5,
        }
    }
}

/// In the plane of the backup bearing: a motion along the axis has one component.
#[inline]
fn in_plane<T: Scalar, const N: usize>(x: [T; N]) -> [T; 2] {
    std::array::from_fn(|n| if n < N { x[n] } else { T::constant(0.0) })
}

impl<T: Scalar, const N: usize, const K: usize> Rotor<N, K> for RotorConfig<T, N, K> {
    type Number = T;
    type With<U: Scalar> = RotorConfig<U, N, K>;
    type Contact = bool;

    fn with<U: Scalar, V: Scalar>(
        &self,
        other: &RotorConfig<U, N, K>,
        join: &impl Fn(T, U) -> V,
    ) -> RotorConfig<V, N, K> {
        let harmonic = &other.harmonic;
        joined!(self, other, join, RotorConfig {
            m_kg, gap_m, unbalance_kgm, unbalance_phase_rad, theta_rad;
            alpha_rad, lambda_nm2_a2, gravity_m_s2, position_m, velocity_m_s;
            harmonic: joined!(&self.harmonic, harmonic, join, Harmonic { omega_rad_s; amplitude_n, phase_rad; }),
            coil: self.coil.with(&other.coil, join),
            touchdown: self.touchdown.with(&other.touchdown, join),
            sensor: self.sensor.clone(),
            max_step_s: self.max_step_s
        })
    }

    fn geometry(&self) -> Geometry<T, N, K> {
        Geometry::new(self.gap_m, self.alpha_rad)
    }

    #[inline]
    fn inertia(&self) -> [T; N] {
        [self.m_kg; N]
    }

    #[inline]
    fn lambda_nm2_a2(&self) -> &[T; K] {
        &self.lambda_nm2_a2
    }

    #[inline]
    fn coil(&self) -> &CoilConfig<T> {
        &self.coil
    }

    fn readings_m(&self, position_m: [T; N]) -> [T; N] {
        position_m
    }

    fn perturbation(&self, input: &PlantInput<T, N, K>, time_s: T, theta_rad: T) -> [T; N] {
        let Harmonic { amplitude_n, omega_rad_s, phase_rad } = &self.harmonic;
        let mut p = input.perturbation_n;
        for a in 0..N {
            // Skipped at amplitude 0, so that the common case needs no sine.
            if !amplitude_n[a].is_zero() {
                p[a] = p[a] + amplitude_n[a] * (*omega_rad_s * time_s + phase_rad[a]).sine();
            }
        }
        for (p_a, gravity) in p.iter_mut().zip(self.gravity_m_s2) {
            if !gravity.is_zero() {
                *p_a = *p_a + self.m_kg * gravity;
            }
        }
        if !self.unbalance_kgm.is_zero() {
            let force = self.unbalance_kgm * input.omega_rad_s * input.omega_rad_s;
            let (sin, cos) = (theta_rad + self.unbalance_phase_rad).sine_cosine();
            p = std::array::from_fn(|a| p[a] + force * if a == 0 { cos } else { sin });
        }
        p
    }

    #[inline]
    fn gyroscopic(&self, _: T, _: [T; N]) -> Option<[T; N]> {
        None
    }

    fn contact_n(&self, motion: &Motion<T, N, K>, omega_rad_s: T, contact: bool) -> [T; N] {
        if !contact {
            return [T::constant(0.0); N];
        }
        let force_n = self.touchdown.force_n(in_plane(motion.position_m), in_plane(motion.velocity_m_s), omega_rad_s);
        std::array::from_fn(|n| force_n[n])
    }
}

impl<const N: usize, const K: usize> PlantParameters<N, K> for RotorConfig<f64, N, K> {
    const MACHINE: &'static Machine = Machine::of_one_bearing(N, K);

    fn check(&self, checks: &mut Checks) {
        checks.positive("m", self.m_kg, "kg");
        MagnetsOf::<N, K>::checked(self.gap_m, self.alpha_rad, checks);
        let machine = Self::MACHINE;
        self.check_tunable(checks);
        check_start(self, checks);
        for (name, value) in machine.of_resultant("gravity.").into_iter().zip(self.gravity_m_s2) {
            checks.finite(name, value, "m/s2");
        }
        self.coil.check([self.gap_m; K], self.lambda_nm2_a2, checks);
        self.touchdown.check(checks);
        self.sensor.check(machine, checks);
        check_step("solver.maxStep", self.max_step_s, checks);
    }

    fn check_tunable(&self, checks: &mut Checks) {
        let machine = Self::MACHINE;
        let (unbalance_kgm, phase_rad) = ([self.unbalance_kgm], [self.unbalance_phase_rad]);
        check_lambda_and_unbalance(machine, &self.lambda_nm2_a2, &unbalance_kgm, &phase_rad, checks);
        let Harmonic { amplitude_n, omega_rad_s, phase_rad } = self.harmonic;
        for (name, value) in machine.of_resultant("perturbation.amplitude").into_iter().zip(amplitude_n) {
            checks.finite(name, value, "N");
        }
        checks.not_negative("perturbation.omega", omega_rad_s, "rad/s");
        for (name, value) in machine.of_resultant("perturbation.phase").into_iter().zip(phase_rad) {
            checks.finite(name, value, "rad");
        }
    }

    fn retuned(&self, to: &Self) -> Self {
        let Self { lambda_nm2_a2, unbalance_kgm, unbalance_phase_rad, .. } = *to;
        Self { lambda_nm2_a2, unbalance_kgm, unbalance_phase_rad, harmonic: to.harmonic.clone(), ..self.clone() }
    }

    fn start(&self) -> ([f64; N], [f64; N]) {
        (self.position_m, self.velocity_m_s)
    }

    fn start_angle_rad(&self) -> f64 {
        self.theta_rad
    }

    fn sensor(&self) -> &SensorConfig<N, K> {
        &self.sensor
    }

    fn max_step_s(&self) -> f64 {
        self.max_step_s
    }

    fn touches(&self, position_m: &[f64; N], velocity_m_s: &[f64; N]) -> bool {
        self.touchdown.touches(in_plane(*position_m), in_plane(*velocity_m_s))
    }

    fn rate(&self, motion: &Motion<f64, N, K>, contact: bool, force_n: [f64; K], gap_m: [f64; K]) -> f64 {
        let m = self.m_kg;
        let mut softness = 0.0;
        let mut least_m = f64::INFINITY;
        for k in 0..K {
            softness += 2.0 * force_n[k] / gap_m[k];
            least_m = least_m.min(gap_m[k]);
        }
        let [v_y, v_z] = in_plane(motion.velocity_m_s);
        let rate = (softness / m).sqrt().max((v_y * v_y + v_z * v_z).sqrt() / least_m);
        if !contact {
            return rate;
        }
        let ring = &self.touchdown;
        rate.max(ring.rate(m, ring.push_n(in_plane(motion.position_m), [v_y, v_z])))
    }
}
