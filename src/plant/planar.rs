//! The planar rotor of the paper: two coordinates (y, z), three magnets.

use std::f64::consts::{FRAC_PI_3, PI};

use serde::{Deserialize, Serialize};

use super::equations::{Motion, PlantInput};
use super::error::StepError;
use super::rotor::{PlantParameters, Rotor};
use super::sensor::SensorConfig;
use super::{Plant, check_step};
use crate::bearing::coil::{CoilConfig, Saturates};
use crate::bearing::magnet::{Geometry, Magnets};
use crate::bearing::scalar::Scalar;
use crate::bearing::touchdown::{Called, TouchdownConfig};
use crate::invalid::{Checks, Invalid, Short};
use crate::machine::{Machine, PLANAR};
use crate::variables::unit::{
    KILOGRAM, METRE, METRE_PER_SECOND, METRE_PER_SECOND2, NEWTON, RADIAN, RADIAN_PER_SECOND, SECOND,
};
use crate::variables::{KILOGRAM_METRE, LAMBDA, Variables};

/// A harmonic perturbation force, per axis `amplitude sin(omega t + phase)`, with t the absolute time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64)]
pub struct Harmonic<T = f64> {
    /// Amplitude of a harmonic perturbation force along {axis}
    #[parameter(names = ["amplitudeY", "amplitudeZ"], tunable, unit = NEWTON)]
    pub amplitude_n: [T; 2],
    /// Angular frequency of the harmonic perturbation force
    #[parameter(name = "omega", tunable, unit = RADIAN_PER_SECOND, min = 0.0, nominal = 100.0, display_unit = "Hz")]
    pub omega_rad_s: T,
    /// Phase at time 0 of the harmonic perturbation force along {axis}, which is a sine
    #[parameter(names = ["phaseY", "phaseZ"], tunable, unit = RADIAN)]
    pub phase_rad: [T; 2],
}

impl Default for Harmonic {
    /// None, at 50 Hz.
    fn default() -> Self {
        Self { amplitude_n: [0.0; 2], omega_rad_s: 2.0 * PI * 50.0, phase_rad: [0.0; 2] }
    }
}

/// The bearing and the initial conditions of the rotor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Machine)]
pub struct PlantConfig<T = f64> {
    /// Mass of the rotor
    #[parameter(name = "m", unit = KILOGRAM, min = 0.0)]
    pub m_kg: T,
    /// Nominal air gap
    #[parameter(name = "s", unit = METRE, min = 0.0, nominal = 1e-4, display_unit = "mm")]
    pub gap_m: T,
    /// Angle of magnet {k}; its direction is (sin alpha, cos alpha) in the y-z plane
    #[parameter(name = "alpha", unit = RADIAN)]
    pub alpha_rad: [T; 3],
    /// Initial position of the rotor along {axis}
    #[parameter(names = ["Y0", "Z0"], unit = METRE, nominal = 1e-5)]
    pub position_m: [T; 2],
    /// Initial velocity of the rotor along {axis}
    #[parameter(names = ["vY0", "vZ0"], unit = METRE_PER_SECOND, nominal = 1e-2)]
    pub velocity_m_s: [T; 2],
    /// The coils.
    #[nested(prefix = "", context = Saturates(true))]
    pub coil: CoilConfig<T>,
    /// Acceleration of gravity along {axis}
    #[parameter(names = ["gravity.Y", "gravity.Z"], unit = METRE_PER_SECOND2, nominal = 10.0)]
    pub gravity_m_s2: [T; 2],
    /// The backup bearing.
    #[nested(prefix = "", context = Called { what: "backup bearing", from: "centre", is_ring: true })]
    pub touchdown: TouchdownConfig<T>,
    /// Initial rotor angle
    #[parameter(name = "theta0", unit = RADIAN)]
    pub theta_rad: T,
    /// The sensors.
    #[nested(prefix = "")]
    pub sensor: SensorConfig,
    /// Upper bound of the integration step
    #[parameter(name = "solver.maxStep", unit = SECOND, min = 0.0, nominal = 1e-5, display_unit = "µs")]
    pub max_step_s: f64,
    /// Force constant of magnet {k}
    #[parameter(name = "lambda", tunable, unit = LAMBDA, min = 0.0, nominal = 1e-6)]
    pub lambda_nm2_a2: [T; 3],
    /// Unbalance of the rotor, mass times eccentricity
    #[parameter(name = "unbalance.magnitude", tunable, unit = KILOGRAM_METRE, min = 0.0, nominal = 1e-4)]
    pub unbalance_kgm: T,
    /// Angle of the unbalance from the mark on the rotor that theta refers to
    #[parameter(name = "unbalance.phase", tunable, unit = RADIAN)]
    pub unbalance_phase_rad: T,
    /// Harmonic perturbation.
    #[nested(prefix = "perturbation.", context = ())]
    pub harmonic: Harmonic<T>,
}

impl Default for PlantConfig {
    /// The paper's bearing, the rotor on the paper's ellipse.
    fn default() -> Self {
        Self {
            m_kg: 6.7,
            gap_m: 5e-4,
            alpha_rad: [PI, -FRAC_PI_3, FRAC_PI_3],
            lambda_nm2_a2: [1.8e-6, 2.0e-6, 2.2e-6],
            unbalance_kgm: 0.0,
            unbalance_phase_rad: 0.0,
            harmonic: Harmonic::default(),
            gravity_m_s2: [0.0; 2],
            coil: CoilConfig::default(),
            touchdown: TouchdownConfig::default(),
            position_m: [30e-6, 0.0],
            velocity_m_s: [0.0, 0.021991148575128554],
            theta_rad: 0.0,
            sensor: SensorConfig::default(),
            max_step_s: 5e-5,
        }
    }
}

impl<T: Scalar> Rotor<2, 3> for PlantConfig<T> {
    type Number = T;
    type With<U: Scalar> = PlantConfig<U>;
    type Contact = bool;

    fn with<U: Scalar, V: Scalar>(&self, other: &PlantConfig<U>, join: &impl Fn(T, U) -> V) -> PlantConfig<V> {
        let harmonic = &other.harmonic;
        joined!(self, other, join, PlantConfig {
            m_kg, gap_m, unbalance_kgm, unbalance_phase_rad, theta_rad;
            alpha_rad, lambda_nm2_a2, gravity_m_s2, position_m, velocity_m_s;
            harmonic: joined!(&self.harmonic, harmonic, join, Harmonic { omega_rad_s; amplitude_n, phase_rad; }),
            coil: self.coil.with(&other.coil, join),
            touchdown: self.touchdown.with(&other.touchdown, join),
            sensor: self.sensor.clone(),
            max_step_s: self.max_step_s
        })
    }

    fn geometry(&self) -> Geometry<T> {
        Geometry::new(self.gap_m, self.alpha_rad)
    }

    #[inline]
    fn inertia(&self) -> [T; 2] {
        [self.m_kg; 2]
    }

    #[inline]
    fn lambda_nm2_a2(&self) -> &[T; 3] {
        &self.lambda_nm2_a2
    }

    #[inline]
    fn coil(&self) -> &CoilConfig<T> {
        &self.coil
    }

    fn readings_m(&self, position_m: [T; 2]) -> [T; 2] {
        position_m
    }

    fn perturbation(&self, input: &PlantInput<T>, time_s: T, theta_rad: T) -> [T; 2] {
        let Harmonic { amplitude_n, omega_rad_s, phase_rad } = &self.harmonic;
        let mut p = input.perturbation_n;
        for a in 0..2 {
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
            p = [p[0] + force * cos, p[1] + force * sin];
        }
        p
    }

    #[inline]
    fn gyroscopic(&self, _: T, _: [T; 2]) -> Option<[T; 2]> {
        None
    }

    fn contact_n(&self, motion: &Motion<T>, omega_rad_s: T, contact: bool) -> [T; 2] {
        match contact {
            true => self.touchdown.force_n(motion.position_m, motion.velocity_m_s, omega_rad_s),
            false => [T::constant(0.0); 2],
        }
    }
}

impl PlantParameters<2, 3> for PlantConfig {
    const MACHINE: &'static Machine = &PLANAR;

    fn check(&self, checks: &mut Checks) {
        checks.positive("m", self.m_kg, "kg");
        let magnets = Magnets::checked(self.gap_m, self.alpha_rad, checks);
        check_tunable(self.lambda_nm2_a2, self.unbalance_kgm, self.unbalance_phase_rad, &self.harmonic, checks);
        for (name, value) in ["Y0", "Z0"].into_iter().zip(self.position_m) {
            checks.finite(name, value, "m");
        }
        for (name, value) in ["vY0", "vZ0"].into_iter().zip(self.velocity_m_s) {
            checks.finite(name, value, "m/s");
        }
        checks.finite("theta0", self.theta_rad, "rad");
        check_start(self, &magnets, checks);
        for (name, value) in ["gravity.Y", "gravity.Z"].into_iter().zip(self.gravity_m_s2) {
            checks.finite(name, value, "m/s2");
        }
        self.coil.check([self.gap_m; 3], self.lambda_nm2_a2, checks);
        self.touchdown.check(checks);
        self.sensor.check(Self::MACHINE, checks);
        check_step("solver.maxStep", self.max_step_s, checks);
    }

    fn start(&self) -> ([f64; 2], [f64; 2]) {
        (self.position_m, self.velocity_m_s)
    }

    fn start_angle_rad(&self) -> f64 {
        self.theta_rad
    }

    fn sensor(&self) -> &SensorConfig {
        &self.sensor
    }

    fn max_step_s(&self) -> f64 {
        self.max_step_s
    }

    fn touches(&self, position_m: &[f64; 2], velocity_m_s: &[f64; 2]) -> bool {
        self.touchdown.touches(*position_m, *velocity_m_s)
    }

    fn rate(&self, motion: &Motion, contact: bool, force_n: [f64; 3], gap_m: [f64; 3]) -> f64 {
        let m = self.m_kg;
        let mut softness = 0.0;
        let mut least_m = f64::INFINITY;
        for k in 0..3 {
            softness += 2.0 * force_n[k] / gap_m[k];
            least_m = least_m.min(gap_m[k]);
        }
        let [v_y, v_z] = motion.velocity_m_s;
        let rate = (softness / m).sqrt().max((v_y * v_y + v_z * v_z).sqrt() / least_m);
        if !contact {
            return rate;
        }
        let ring = &self.touchdown;
        rate.max(ring.rate(m, ring.push_n(motion.position_m, motion.velocity_m_s)))
    }

    fn left_the_gap(&self, k: usize, time_s: f64, position_m: [f64; 2]) -> StepError {
        StepError::Contact { magnet: k + 1, time_s, position_m }
    }
}

impl Plant {
    /// Changes the tunable parameters: λ in N·m²/A², unbalance in kg·m and rad, harmonic.
    ///
    /// # Errors
    /// As in [`Plant::new`]; nothing is changed then.
    pub fn retune(
        &mut self,
        lambda_nm2_a2: [f64; 3],
        unbalance_kgm: f64,
        unbalance_phase_rad: f64,
        harmonic: Harmonic,
    ) -> Result<(), Vec<Invalid>> {
        let mut checks = Checks::default();
        check_tunable(lambda_nm2_a2, unbalance_kgm, unbalance_phase_rad, &harmonic, &mut checks);
        let config = &mut self.equations.config;
        config.coil.check([config.gap_m; 3], lambda_nm2_a2, &mut checks);
        checks.finish()?;
        config.lambda_nm2_a2 = lambda_nm2_a2;
        config.unbalance_kgm = unbalance_kgm;
        config.unbalance_phase_rad = unbalance_phase_rad;
        config.harmonic = harmonic;
        Ok(())
    }
}

fn check_tunable(
    lambda_nm2_a2: [f64; 3],
    unbalance_kgm: f64,
    unbalance_phase_rad: f64,
    harmonic: &Harmonic,
    checks: &mut Checks,
) {
    for (name, lambda) in ["lambda[1]", "lambda[2]", "lambda[3]"].into_iter().zip(lambda_nm2_a2) {
        checks.positive(name, lambda, "N.m2/A2");
    }
    checks.not_negative("unbalance.magnitude", unbalance_kgm, "kg.m");
    checks.finite("unbalance.phase", unbalance_phase_rad, "rad");
    for (name, value) in ["perturbation.amplitudeY", "perturbation.amplitudeZ"].into_iter().zip(harmonic.amplitude_n) {
        checks.finite(name, value, "N");
    }
    checks.not_negative("perturbation.omega", harmonic.omega_rad_s, "rad/s");
    for (name, value) in ["perturbation.phaseY", "perturbation.phaseZ"].into_iter().zip(harmonic.phase_rad) {
        checks.finite(name, value, "rad");
    }
}

/// Refuses a rotor that starts at a magnet; the finding names the coordinate that brings it there.
fn check_start(config: &PlantConfig, magnets: &Magnets, checks: &mut Checks) {
    let [y, z] = config.position_m;
    let finite = |values: &[f64]| values.iter().all(|value| value.is_finite());
    if !(finite(&config.position_m) && finite(&config.alpha_rad) && config.gap_m.is_finite() && config.gap_m > 0.0) {
        return;
    }
    for (k, (gap, e_k)) in magnets.gaps([y, z]).into_iter().zip(magnets.directions()).enumerate() {
        if gap > 0.0 {
            continue;
        }
        let (name, value) = if (y * e_k[0]) > (z * e_k[1]) { ("Y0", y) } else { ("Z0", z) };
        let number = k + 1;
        checks.require(
            false,
            name,
            format_args!("{value} m"),
            format!("a start inside the gap (that of magnet {number} would be {} m)", Short(gap)),
        );
        return;
    }
}
