//! The rotor between its magnets, its coils, the backup bearing, and the sensors that look at it.
//!
//! ```text
//! m Ÿ = Σ F_k sin α_k + p_y + c_y    P(6), P(3)
//! m Z̈ = Σ F_k cos α_k + p_z + c_z    P(7), P(3)
//! F_k = λ_k i_k² / gap_k²            P(4), more generally coil.rs
//! dψ_k/dt = u_k − R i_k              with voltage drive, u_k within the limit of the amplifier
//! ```
//!
//! `p` is what acts on the rotor beside magnets and backup bearing: per axis a, with `t` the absolute time,
//! `p_a + amplitude_a sin(ω_p t + phase_a) + m g_a`, and the unbalance `U ω² (cos(θ + φ), sin(θ + φ))` of axes (y, z).
//! `c` is the push of the backup bearing, touchdown.rs.
//!
//! # Integration
//!
//! The classical Runge–Kutta method in equal sub-steps of at most `max_step_s`. Where the model itself is faster, a sub-step
//! is divided until it is at most [`SAFETY`] over the fastest rate: that of the coils `R ∂i/∂ψ`, of the rotor in the field
//! of the magnets `√(Σ 2F_k/gap_k/m)`, of the narrowest gap `|v|/gap`, and of a contact. The instant at which the rotor
//! meets or leaves the backup bearing is located, and a sub-step ends there, so that no step runs across a kink.
//!
//! # Samples
//!
//! The sensors read at `start + k · T_s`. A sample of the currents is the value just before the instant, that is the
//! current held over the interval that ends there (`heldBefore`). Sample 0 is taken at the start; no current is held
//! before it, so it reads 0 A. With voltage drive currents are continuous, and a sample is that of the instant (`linear`).
//! Steps may have any length; see [`Plant::advance`].

use std::cell::Cell;
use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use super::coil::{Coil, CoilConfig, CoilPoint, Drive};
use super::integration::{rk4, substeps};
use super::magnet::Magnets;
use super::noise::Noise;
pub use super::sensor::SensorConfig;
use super::sensor::{Delayed, Seen};
use super::touchdown::TouchdownConfig;
use super::{Checks, Invalid};

/// `[Y, Z, Ẏ, Ż, ψ_1, ψ_2, ψ_3]`, in m, m/s and Wb: what the equations of motion move.
///
/// With current drive the fluxes follow the currents and are no state: they stay 0.
pub type Motion = [f64; 7];

/// A sub-step is at most this part of the reciprocal of the fastest rate of the model.
///
/// The error of a step of the Runge–Kutta method is then about `SAFETY⁵/120`, a ten millionth, of what decays or swings at
/// that rate.
pub const SAFETY: f64 = 0.1;

/// The most parts that one call integrates over; some seconds of computing.
pub const MOST_PARTS: usize = 3_000_000;

/// How many meetings with the backup bearing are located within one sub-step; further ones are stepped across.
const MOST_CROSSINGS: usize = 8;

/// Halvings by which such an instant is located: to a millionth of a millionth of the sub-step.
const HALVINGS: usize = 40;

/// Part of the sensor step within which an instant counts as the end of a step.
pub const INSTANT_TOLERANCE: f64 = 1e-3;

/// Part of the sensor step up to which a difference in time is taken for rounding and removed.
///
/// Times that were added up differ in their last bits from those that were multiplied. With this, both give the same
/// bits of position.
pub const ROUNDING_TOLERANCE: f64 = 1e-6;

/// The shortest sensor step, and the shortest sub-step of the integration, in s.
///
/// Shorter ones are lost in the rounding of the time, or never come to an end.
pub const SHORTEST_STEP_S: f64 = 1e-9;

/// A harmonic perturbation force, per axis `amplitude sin(omega t + phase)`, t the absolute time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Harmonic {
    /// Amplitude, (y, z), in N.
    pub amplitude_n: [f64; 2],
    /// Angular frequency, common to both axes, in rad/s.
    pub omega_rad_s: f64,
    /// Phase at t = 0, (y, z), in rad.
    pub phase_rad: [f64; 2],
}

impl Default for Harmonic {
    /// None, at 50 Hz.
    fn default() -> Self {
        Self { amplitude_n: [0.0; 2], omega_rad_s: 2.0 * PI * 50.0, phase_rad: [0.0; 2] }
    }
}

/// The bearing and the rotor's start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PlantConfig {
    /// Mass of the rotor `m`, in kg.
    pub m_kg: f64,
    /// Nominal gap `s`, in m.
    pub gap_m: f64,
    /// Angles `α_k` of the magnets as in P(3), in rad.
    pub alpha_rad: [f64; 3],
    /// `λ_k` of P(4), in N·m²/A²; may be retuned.
    pub lambda_nm2_a2: [f64; 3],
    /// Unbalance `U`, mass × eccentricity, in kg·m; may be retuned.
    pub unbalance_kgm: f64,
    /// Angle `φ` of the unbalance on the rotor, from y towards z, in rad; may be retuned.
    pub unbalance_phase_rad: f64,
    /// Harmonic perturbation; may be retuned.
    pub harmonic: Harmonic,
    /// Acceleration of gravity, (y, z), in m/s².
    pub gravity_m_s2: [f64; 2],
    /// The coils.
    pub coil: CoilConfig,
    /// The backup bearing.
    pub touchdown: TouchdownConfig,
    /// Position (Y, Z) at the start, in m.
    pub position_m: [f64; 2],
    /// Velocity at the start, (y, z), in m/s.
    pub velocity_m_s: [f64; 2],
    /// Angle of the rotor at the start, in rad.
    pub theta_rad: f64,
    /// The sensors.
    pub sensor: SensorConfig,
    /// Longest sub-step of the integration, in s.
    pub max_step_s: f64,
}

impl Default for PlantConfig {
    /// The paper's bearing, the rotor on the paper's ellipse.
    fn default() -> Self {
        Self {
            m_kg: 6.7,
            gap_m: 5e-4,
            alpha_rad: [PI, -PI / 3.0, PI / 3.0],
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

/// What acts on the plant, held over a step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlantInput {
    /// Currents of the magnets, in A; the sign has no effect on the force. Of no effect with voltage drive.
    pub current_a: [f64; 3],
    /// Voltages asked of the amplifiers, in V. Of no effect with current drive.
    pub voltage_v: [f64; 3],
    /// Perturbation force on the rotor, (y, z), in N.
    pub perturbation_n: [f64; 2],
    /// Angular velocity of the rotor, from y towards z, in rad/s.
    pub omega_rad_s: f64,
}

/// The highest order of a derivative of an input that [`PlantCourse`] knows.
pub const HIGHEST_ORDER: usize = 4;

/// What acts on the plant over a step, as polynomials: `u(t) = u + Σ_j d_j (t − t_0)^j / j!`.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantCourse {
    /// u, at the time `since_s`.
    pub input: PlantInput,
    /// d_1, d_2, …; in the unit of the input over powers of seconds. `None` holds the inputs.
    pub slopes: Option<[PlantInput; HIGHEST_ORDER]>,
    /// t_0, in s.
    pub since_s: f64,
}

impl PlantCourse {
    /// Inputs that are held.
    pub fn held(input: &PlantInput) -> Self {
        Self { input: input.clone(), slopes: None, since_s: 0.0 }
    }

    /// The inputs at a time, in s.
    pub fn at(&self, t_s: f64) -> PlantInput {
        let mut input = self.input.clone();
        let Some(slopes) = &self.slopes else { return input };
        let elapsed_s = t_s - self.since_s;
        let mut weight = 1.0;
        for (slope, order) in slopes.iter().zip(1..) {
            weight *= elapsed_s / f64::from(order);
            let actuators = slope.current_a.into_iter().chain(slope.voltage_v);
            for (value, slope) in input.current_a.iter_mut().chain(&mut input.voltage_v).zip(actuators) {
                *value += weight * slope;
            }
            for (value, slope) in input.perturbation_n.iter_mut().zip(slope.perturbation_n) {
                *value += weight * slope;
            }
            input.omega_rad_s += weight * slope.omega_rad_s;
        }
        input
    }

    /// Whether ω is held.
    fn turns_evenly(&self) -> bool {
        self.slopes.as_ref().is_none_or(|slopes| slopes.iter().all(|slope| slope.omega_rad_s == 0.0))
    }

    /// `∫ ω dt` from t_0 to a time in s, in rad.
    fn turned_rad(&self, t_s: f64) -> f64 {
        let elapsed_s = t_s - self.since_s;
        let mut weight = elapsed_s;
        let mut angle_rad = self.input.omega_rad_s * weight;
        for (slope, order) in self.slopes.iter().flatten().zip(2..) {
            weight *= elapsed_s / f64::from(order);
            angle_rad += weight * slope.omega_rad_s;
        }
        angle_rad
    }

    fn check(&self) -> Result<(), PlantFault> {
        self.slopes.iter().flatten().try_for_each(check_input)?;
        check_input(&self.input)
    }
}

/// What the sensors read at their last instant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Position (Y, Z), in m.
    pub position_m: [f64; 2],
    /// Currents held over the interval that ended at the instant, or with voltage drive those of the instant, in A.
    pub current_a: [f64; 3],
    /// Angle of the rotor, unwrapped, in rad.
    pub theta_rad: f64,
}

/// Where the plant stands; belongs to a [`Plant`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlantState {
    /// Time up to which the plant has been advanced, in s.
    pub time_s: f64,
    /// Position (Y, Z), in m.
    pub position_m: [f64; 2],
    /// Velocity, (y, z), in m/s.
    pub velocity_m_s: [f64; 2],
    /// Flux linkages of the coils, in Wb; 0 with current drive, where they follow from the currents.
    pub linkage_wb: [f64; 3],
    /// Whether rotor and backup bearing push each other.
    pub contact: bool,
    /// Coils whose circuit is open, so that they carry no current; may be changed between steps.
    pub open: [bool; 3],
    /// Angle of the rotor, unwrapped, in rad.
    pub theta_rad: f64,
    /// The sample taken last.
    pub measured: Measured,
    /// Number of samples taken; sample k is that of `start + k · T_s`.
    pub samples: u64,
    /// Start time, in s.
    start_s: f64,
    /// Where the angle has come from.
    turn: Turn,
    /// Noise of Y, Z, and of the three currents.
    noise: [Noise; 5],
    /// Readings on their way.
    delayed: Delayed,
}

/// θ = `base + ω (t − since)`, the base moved when ω changes, so that a long run does not add up rounding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Turn {
    base_rad: f64,
    since_s: f64,
    omega_rad_s: f64,
}

impl Turn {
    fn theta_rad(&self, t_s: f64) -> f64 {
        self.base_rad + self.omega_rad_s * (t_s - self.since_s)
    }
}

/// What can be said of the plant at an instant, inputs included.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlantOutput {
    /// Gap of each magnet, in m.
    pub gap_m: [f64; 3],
    /// Current of each coil, in A.
    pub current_a: [f64; 3],
    /// Flux linkage of each coil, in Wb.
    pub linkage_wb: [f64; 3],
    /// Energy of the field of each coil, in J.
    pub energy_j: [f64; 3],
    /// Force of each magnet, in N, P(4).
    pub force_n: [f64; 3],
    /// Resultant of the magnets, (F_y, F_z), in N, P(3).
    pub resultant_n: [f64; 2],
    /// Everything but magnets and backup bearing, (y, z), in N.
    pub perturbation_n: [f64; 2],
    /// What changes the flux linkage of each coil, `u − R i` with voltage drive, in V; 0 without, where it is no state.
    pub induced_v: [f64; 3],
    /// Push of the backup bearing, (y, z), in N.
    pub contact_n: [f64; 2],
    /// Acceleration of the rotor, (y, z), in m/s².
    pub acceleration_m_s2: [f64; 2],
}

/// Why the plant could not go on.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlantFault {
    /// The rotor has left the gap, or its motion is no longer finite. The state is that before the sub-step in
    /// which it happened.
    #[error(
        "the rotor leaves the gap at magnet {magnet} after t = {time_s} s, coming from Y = {} m, Z = {} m",
        position_m[0],
        position_m[1]
    )]
    Contact {
        /// Number of the magnet, 1 to 3: the one the rotor was nearest to.
        magnet: usize,
        /// Begin of the sub-step that ended outside, in s.
        time_s: f64,
        /// Position (Y, Z) at that time, in m.
        position_m: [f64; 2],
    },
    /// The motion is so fast that the step would not come to an end. The state is that before the sub-step in which that
    /// was seen.
    #[error("the motion of the rotor is too fast for a step after t = {time_s} s: more than {MOST_PARTS} parts")]
    Fast {
        /// Begin of the sub-step, in s.
        time_s: f64,
    },
    /// An input is not finite. The state is unchanged.
    #[error("the input {name} is not finite: {value}")]
    Input {
        /// Name of the input as in the interface.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// The step does not begin where the last one ended, or its length is not a time. The state is unchanged.
    #[error("a step of {h_s} s from t = {t_s} s is refused: the plant stands at t = {time_s} s")]
    Time {
        /// Begin of the step refused, in s.
        t_s: f64,
        /// Its length, in s.
        h_s: f64,
        /// Where the plant stands, in s.
        time_s: f64,
    },
}

/// A checked plant.
#[derive(Clone, Debug, PartialEq)]
pub struct Plant {
    config: PlantConfig,
    magnets: Magnets,
}

impl Plant {
    /// A plant of the given configuration.
    ///
    /// # Errors
    /// Every parameter that is not finite or outside its range, by its name in the interface; `s` and `alpha[k]` as in
    /// [`Magnets::new`]; `Y0` or `Z0` if the rotor would start outside the gap.
    pub fn new(config: PlantConfig) -> Result<Self, Vec<Invalid>> {
        let mut checks = Checks::default();
        checks.positive("m", config.m_kg, "kg");
        let magnets = Magnets::checked(config.gap_m, config.alpha_rad, &mut checks);
        check_tunable(
            config.lambda_nm2_a2,
            config.unbalance_kgm,
            config.unbalance_phase_rad,
            &config.harmonic,
            &mut checks,
        );
        for (name, value) in ["Y0", "Z0"].into_iter().zip(config.position_m) {
            checks.finite(name, value, "m");
        }
        for (name, value) in ["vY0", "vZ0"].into_iter().zip(config.velocity_m_s) {
            checks.finite(name, value, "m/s");
        }
        checks.finite("theta0", config.theta_rad, "rad");
        check_start(&config, &magnets, &mut checks);
        for (name, value) in ["gravity.Y", "gravity.Z"].into_iter().zip(config.gravity_m_s2) {
            checks.finite(name, value, "m/s2");
        }
        config.coil.check(config.gap_m, config.lambda_nm2_a2, &mut checks);
        config.touchdown.check(&mut checks);
        config.sensor.check(&mut checks);
        check_step("solver.maxStep", config.max_step_s, &mut checks);
        checks.finish()?;
        Ok(Self { config, magnets })
    }

    /// The configuration, as it was retuned last.
    pub fn config(&self) -> &PlantConfig {
        &self.config
    }

    /// The magnets.
    pub fn magnets(&self) -> &Magnets {
        &self.magnets
    }

    /// Changes the parameters that may change while running: λ in N·m²/A², unbalance in kg·m and rad, harmonic.
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
        self.config.coil.check(self.config.gap_m, lambda_nm2_a2, &mut checks);
        checks.finish()?;
        self.config.lambda_nm2_a2 = lambda_nm2_a2;
        self.config.unbalance_kgm = unbalance_kgm;
        self.config.unbalance_phase_rad = unbalance_phase_rad;
        self.config.harmonic = harmonic;
        Ok(())
    }

    /// The plant at its start, the time `start_s`, with sample 0 taken. With voltage drive no current flows yet.
    pub fn start(&self, start_s: f64) -> PlantState {
        let config = &self.config;
        let seen = Seen { position_m: config.position_m, current_a: [0.0; 3] };
        let mut state = PlantState {
            time_s: start_s,
            position_m: config.position_m,
            velocity_m_s: config.velocity_m_s,
            linkage_wb: [0.0; 3],
            contact: config.touchdown.touches(config.position_m, config.velocity_m_s),
            open: [false; 3],
            theta_rad: config.theta_rad,
            measured: Measured { position_m: [0.0; 2], current_a: [0.0; 3], theta_rad: 0.0 },
            samples: 0,
            start_s,
            turn: Turn { base_rad: config.theta_rad, since_s: start_s, omega_rad_s: 0.0 },
            noise: Noise::channels(config.sensor.seed),
            delayed: Delayed::new(seen, config.sensor.delay_s / config.sensor.step_s),
        };
        self.take_sample(&mut state, seen);
        state
    }

    /// Advances from `t_s` to `t_s + h_s`, in s, with the input held; see [`Plant::advance_along`].
    ///
    /// # Errors
    /// As there.
    pub fn advance(&self, state: &mut PlantState, input: &PlantInput, t_s: f64, h_s: f64) -> Result<(), PlantFault> {
        self.advance_along(state, &PlantCourse::held(input), t_s, h_s)
    }

    /// Advances from `t_s` to `t_s + h_s`, in s, with inputs that change on the way. A sample of the currents is their
    /// value just before the instant.
    ///
    /// The sensors read at every instant `start + k · T_s` in `(t, t + h]`. An instant within [`INSTANT_TOLERANCE`] of
    /// `t + h` is read at `t + h`; at one inside, the step is divided. Each part is integrated in equal sub-steps, none
    /// longer than `max_step_s`. A step of 0 changes nothing; one too short to move the time neither loses nor doubles
    /// a sample.
    ///
    /// # Errors
    /// [`PlantFault::Contact`] when the rotor leaves the gap; [`PlantFault::Fast`] if the step would not end;
    /// [`PlantFault::Input`] for an input that is not finite;
    /// [`PlantFault::Time`] for a step that is negative, not finite, or does not begin where the last one ended.
    pub fn advance_along(
        &self,
        state: &mut PlantState,
        inputs: &PlantCourse,
        t_s: f64,
        h_s: f64,
    ) -> Result<(), PlantFault> {
        inputs.check()?;
        let step_s = self.config.sensor.step_s;
        let tolerance = INSTANT_TOLERANCE * step_s;
        let end_s = t_s + h_s;
        let follows = (t_s - state.time_s).abs() <= tolerance;
        if !(follows && h_s >= 0.0 && end_s.is_finite()) {
            return Err(PlantFault::Time { t_s, h_s, time_s: state.time_s });
        }
        if h_s == 0.0 {
            return Ok(());
        }
        let delay_s = self.config.sensor.delay_s;
        let mut now_s = t_s;
        let mut budget = MOST_PARTS;
        loop {
            let sample_s = state.start_s + state.samples as f64 * step_s;
            // Without delay a reading is seen when it is told.
            let seen_s = match delay_s {
                0.0 => sample_s,
                _ => state.start_s + (state.delayed.seen as f64 * step_s - delay_s),
            };
            let instant_s = seen_s.min(sample_s);
            let inside = instant_s < end_s - tolerance;
            let part_end_s = if inside { instant_s.max(now_s) } else { end_s };
            let length_s = if now_s == t_s && !inside { h_s } else { part_end_s - now_s };
            self.integrate(state, inputs, (now_s, length_s, part_end_s), &mut budget)?;
            if instant_s > end_s + tolerance {
                return Ok(());
            }
            let seen = self.seen(state, &inputs.at(part_end_s));
            if delay_s == 0.0 {
                self.take_sample(state, seen);
                if !inside {
                    return Ok(());
                }
            } else {
                // Of a reading seen and one told at the same instant, the one seen comes first.
                if seen_s <= sample_s {
                    state.delayed.see(seen);
                } else {
                    let told = state.delayed.told(state.samples);
                    self.take_sample(state, told);
                }
            }
            now_s = part_end_s;
        }
    }

    /// Whether a state, for instance one read from a file, is such that this plant can go on with it at `t_s`, in s: its
    /// numbers are finite, the rotor is inside the gap, and the samples before `t_s` are taken, those after it are not.
    pub fn accepts(&self, state: &PlantState, t_s: f64) -> bool {
        let step_s = self.config.sensor.step_s;
        let Turn { base_rad, since_s, omega_rad_s } = state.turn;
        let numbers = [state.time_s, state.start_s, state.theta_rad, base_rad, since_s, omega_rad_s, t_s];
        let mut numbers = numbers.iter().chain(&state.position_m).chain(&state.velocity_m_s).chain(&state.linkage_wb);
        let inside = self.magnets.gaps(state.position_m).iter().all(|gap| *gap > 0.0);
        // Importers may begin a step a little beside the end of the last one.
        let beside_s = step_s + 1e-6 * t_s.abs().max(1.0);
        let instant_s = |count: u64| state.start_s + count as f64 * step_s;
        let taken = instant_s(state.samples) >= t_s - beside_s && instant_s(state.samples.max(1) - 1) <= t_s + beside_s;
        let delay = (self.config.sensor.delay_s / step_s) as u64 + 2;
        let seen = state.samples.saturating_sub(2)..=state.samples.saturating_add(delay);
        numbers.all(|value| value.is_finite())
            && inside
            && taken
            && (self.config.sensor.delay_s == 0.0 || seen.contains(&state.delayed.seen))
            && (state.time_s - t_s).abs() <= beside_s
    }

    /// The instant of the last sample, in s.
    pub fn sampled_s(&self, state: &PlantState) -> f64 {
        state.start_s + (state.samples.max(1) - 1) as f64 * self.config.sensor.step_s
    }

    /// The shortest step inside: that of the sensors or of the integration, in s.
    pub fn grain_s(&self) -> f64 {
        self.config.sensor.step_s.min(self.config.max_step_s)
    }

    /// What can be said at the time `t_s`, in s, at which the state stands.
    pub fn outputs(&self, state: &PlantState, input: &PlantInput, t_s: f64) -> PlantOutput {
        let gap_m = self.magnets.gaps(state.position_m);
        let coils = self.coils(state.open, state.linkage_wb, input, gap_m);
        let force_n = coils.map(|coil| coil.force_n);
        let resultant_n = self.magnets.resultant(force_n);
        let perturbation_n = self.perturbation(input, t_s, state.theta_rad);
        let contact_n = match state.contact {
            true => self.config.touchdown.force_n(state.position_m, state.velocity_m_s, input.omega_rad_s),
            false => [0.0; 2],
        };
        let m = self.config.m_kg;
        let acceleration_m_s2 = std::array::from_fn(|a| sum(resultant_n[a] + perturbation_n[a], contact_n[a]) / m);
        PlantOutput {
            gap_m,
            current_a: coils.map(|coil| coil.current_a),
            linkage_wb: coils.map(|coil| coil.linkage_wb),
            energy_j: coils.map(|coil| coil.energy_j),
            induced_v: self.induced_v(state.open, &coils, input),
            force_n,
            resultant_n,
            perturbation_n,
            contact_n,
            acceleration_m_s2,
        }
    }

    /// The coil of magnet k, counted from 0.
    pub fn coil(&self, k: usize) -> Coil {
        self.config.coil.of(self.config.lambda_nm2_a2[k], self.config.gap_m)
    }

    /// The coils at the given gaps, in m; `linkage_wb` counts with voltage drive, the currents of the input without.
    fn coils(&self, open: [bool; 3], linkage_wb: [f64; 3], input: &PlantInput, gap_m: [f64; 3]) -> [CoilPoint; 3] {
        let coil = &self.config.coil;
        if self.is_plain() {
            // P(4) as it stands, in the order of operations that gives the fewest roundings.
            let current_a = std::array::from_fn(|k| if open[k] { 0.0 } else { input.current_a[k] });
            let force_n = self.magnets.forces(self.config.lambda_nm2_a2, current_a, gap_m);
            return std::array::from_fn(|k| {
                let inductance_h = self.coil(k).inductance_h(gap_m[k]);
                CoilPoint {
                    linkage_wb: inductance_h * current_a[k],
                    current_a: current_a[k],
                    force_n: force_n[k],
                    energy_j: 0.5 * inductance_h * current_a[k] * current_a[k],
                    ..CoilPoint::default()
                }
            });
        }
        std::array::from_fn(|k| match coil.drive {
            _ if open[k] => CoilPoint::default(),
            Drive::Current => self.coil(k).at_current(input.current_a[k], gap_m[k]),
            Drive::Voltage => self.coil(k).at_linkage(linkage_wb[k], gap_m[k]),
        })
    }

    /// The forces of the magnets alone, in N, as in [`Plant::coils`].
    fn forces(&self, open: [bool; 3], linkage_wb: [f64; 3], input: &PlantInput, gap_m: [f64; 3]) -> [f64; 3] {
        if self.is_plain() {
            let current_a = std::array::from_fn(|k| if open[k] { 0.0 } else { input.current_a[k] });
            return self.magnets.forces(self.config.lambda_nm2_a2, current_a, gap_m);
        }
        self.coils(open, linkage_wb, input, gap_m).map(|coil| coil.force_n)
    }

    /// Whether the forces are those of P(4) with the currents of the input.
    fn is_plain(&self) -> bool {
        self.config.coil.drive == Drive::Current && self.config.coil.saturation_wb == 0.0
    }

    /// `dψ_k/dt = u_k − R i_k` with voltage drive, u_k within the limit of the amplifier; 0 without, or if the circuit is
    /// open; in V.
    fn induced_v(&self, open: [bool; 3], coils: &[CoilPoint; 3], input: &PlantInput) -> [f64; 3] {
        let CoilConfig { drive, resistance_ohm, limit_v, .. } = self.config.coil;
        std::array::from_fn(|k| {
            if drive == Drive::Current || open[k] {
                return 0.0;
            }
            input.voltage_v[k].clamp(-limit_v, limit_v) - resistance_ohm * coils[k].current_a
        })
    }

    /// What a sensor without errors sees at the end of a step with that input.
    fn seen(&self, state: &PlantState, input: &PlantInput) -> Seen {
        let current_a = match self.config.coil.drive {
            Drive::Current => std::array::from_fn(|k| if state.open[k] { 0.0 } else { input.current_a[k] }),
            Drive::Voltage => {
                let gap_m = self.magnets.gaps(state.position_m);
                self.coils(state.open, state.linkage_wb, input, gap_m).map(|coil| coil.current_a)
            }
        };
        Seen { position_m: state.position_m, current_a }
    }

    /// Everything but magnets and backup bearing, (y, z), in N.
    fn perturbation(&self, input: &PlantInput, t_s: f64, theta_rad: f64) -> [f64; 2] {
        let Harmonic { amplitude_n, omega_rad_s, phase_rad } = &self.config.harmonic;
        let mut p = input.perturbation_n;
        for a in 0..2 {
            // Without amplitude nothing is added, so that the common case costs no sine.
            if amplitude_n[a] != 0.0 {
                p[a] += amplitude_n[a] * libm::sin(omega_rad_s * t_s + phase_rad[a]);
            }
        }
        for (p_a, gravity) in p.iter_mut().zip(self.config.gravity_m_s2) {
            if gravity != 0.0 {
                *p_a += self.config.m_kg * gravity;
            }
        }
        if self.config.unbalance_kgm != 0.0 {
            let force = self.config.unbalance_kgm * input.omega_rad_s * input.omega_rad_s;
            let angle = theta_rad + self.config.unbalance_phase_rad;
            let (sin, cos) = libm::sincos(angle);
            p[0] += force * cos;
            p[1] += force * sin;
        }
        p
    }

    /// Integrates over a part of a step, from one time over a length, that has no sample inside; the state then stands at
    /// its end.
    fn integrate(
        &self,
        state: &mut PlantState,
        inputs: &PlantCourse,
        (from_s, length_s, end_s): (f64, f64, f64),
        budget: &mut usize,
    ) -> Result<(), PlantFault> {
        let (from_s, length_s) = self.without_rounding(state, from_s, length_s);
        let evenly = inputs.turns_evenly();
        if !evenly || inputs.input.omega_rad_s != state.turn.omega_rad_s {
            let omega_rad_s = inputs.at(from_s).omega_rad_s;
            state.turn = Turn { base_rad: state.theta_rad, since_s: from_s, omega_rad_s };
        }
        let turned_rad = inputs.turned_rad(from_s);
        let theta_rad = |turn: &Turn, t: f64| {
            if evenly { turn.theta_rad(t) } else { turn.base_rad + (inputs.turned_rad(t) - turned_rad) }
        };
        let n = substeps(length_s, self.config.max_step_s);
        let h = length_s / n as f64;
        for k in 0..3 {
            if state.open[k] {
                state.linkage_wb[k] = 0.0;
            }
        }
        // Time, angle and force of the perturbation computed last: two of the four slopes of a sub-step are taken at one instant, and
        // the last one mostly where the next sub-step begins.
        let latest = Cell::new(None);
        for j in 0..n {
            let t = from_s + j as f64 * h;
            self.sub_step(state, inputs, (t, h), &theta_rad, &latest, budget)?;
            state.theta_rad = theta_rad(&state.turn, t + h);
        }
        state.time_s = end_s;
        state.theta_rad = theta_rad(&state.turn, from_s + length_s);
        if !evenly {
            // The next part begins with an angle and a speed of its own.
            let omega_rad_s = inputs.at(from_s + length_s).omega_rad_s;
            state.turn = Turn { base_rad: state.theta_rad, since_s: from_s + length_s, omega_rad_s };
        }
        Ok(())
    }

    /// Integrates over one sub-step from `t_s` over `h_s`, divided where the model is faster and where contact begins or
    /// ends.
    fn sub_step(
        &self,
        state: &mut PlantState,
        inputs: &PlantCourse,
        (t_s, h_s): (f64, f64),
        theta_rad: &impl Fn(&Turn, f64) -> f64,
        latest: &Cell<Option<(f64, f64, [f64; 2])>>,
        budget: &mut usize,
    ) -> Result<(), PlantFault> {
        let mut done_s = 0.0;
        let mut crossings = 0;
        let held = inputs.slopes.is_none();
        while done_s < h_s || done_s == 0.0 {
            let [y, z] = state.position_m;
            let [v_y, v_z] = state.velocity_m_s;
            let [psi_1, psi_2, psi_3] = state.linkage_wb;
            let x = [y, z, v_y, v_z, psi_1, psi_2, psi_3];
            let left_s = h_s - done_s;
            let parts = substeps(left_s, self.longest_step_s(state, &inputs.at(t_s + done_s)));
            let mut part_s = if parts == 1 { left_s } else { left_s / parts as f64 };
            let now_s = t_s + done_s;
            *budget = budget.saturating_sub(1);
            if parts > *budget {
                state.time_s = now_s;
                return Err(PlantFault::Fast { time_s: now_s });
            }
            let step = |h_s: f64| {
                let turn = &state.turn;
                let slope = |t: f64, x: &Motion| {
                    let theta_rad = theta_rad(turn, t);
                    let conditions = Conditions { time_s: t, theta_rad, contact: state.contact, open: state.open };
                    if !held {
                        return self.derivative(x, &inputs.at(t), conditions);
                    }
                    let perturbation_n = match latest.get() {
                        Some((at, angle, force)) if at == t && angle == theta_rad => force,
                        _ => self.perturbation(&inputs.input, t, theta_rad),
                    };
                    latest.set(Some((t, theta_rad, perturbation_n)));
                    self.derivative_under(x, &inputs.input, conditions, perturbation_n)
                };
                match self.config.coil.drive {
                    Drive::Voltage => rk4(x, now_s, h_s, slope),
                    Drive::Current => {
                        let [a, b, c, d] = rk4([y, z, v_y, v_z], now_s, h_s, |t, x| {
                            let [a, b, c, d, ..] = slope(t, &[x[0], x[1], x[2], x[3], psi_1, psi_2, psi_3]);
                            [a, b, c, d]
                        });
                        [a, b, c, d, psi_1, psi_2, psi_3]
                    }
                }
            };
            let touches = |x: &Motion| self.config.touchdown.touches([x[0], x[1]], [x[2], x[3]]);
            let mut next = step(part_s);
            if touches(&next) != state.contact && crossings < MOST_CROSSINGS {
                crossings += 1;
                let mut before_s = 0.0;
                for _ in 0..HALVINGS {
                    let middle_s = 0.5 * (before_s + part_s);
                    let middle = step(middle_s);
                    if touches(&middle) == state.contact {
                        before_s = middle_s;
                    } else {
                        (part_s, next) = (middle_s, middle);
                    }
                }
            }
            let inside = self.magnets.gaps([next[0], next[1]]).iter().all(|gap| *gap > 0.0);
            if !(inside && next.iter().all(|value| value.is_finite())) {
                let gap_m = self.magnets.gaps(state.position_m);
                let nearest = (0..3).fold(0, |k, other| if gap_m[other] < gap_m[k] { other } else { k });
                state.time_s = now_s;
                return Err(PlantFault::Contact { magnet: nearest + 1, time_s: now_s, position_m: state.position_m });
            }
            let contact = touches(&next);
            state.position_m = [next[0], next[1]];
            state.velocity_m_s = [next[2], next[3]];
            state.linkage_wb = [next[4], next[5], next[6]];
            state.contact = contact;
            done_s = if part_s == left_s { h_s } else { done_s + part_s };
            if h_s == 0.0 {
                break;
            }
        }
        Ok(())
    }

    /// [`SAFETY`] over the fastest rate of the model where it stands, in s.
    fn longest_step_s(&self, state: &PlantState, input: &PlantInput) -> f64 {
        let m = self.config.m_kg;
        let gap_m = self.magnets.gaps(state.position_m);
        let mut rate: f64 = 0.0;
        let force_n = if self.is_plain() {
            self.forces(state.open, state.linkage_wb, input, gap_m)
        } else {
            let coils = self.coils(state.open, state.linkage_wb, input, gap_m);
            for coil in &coils {
                rate = rate.max(self.config.coil.resistance_ohm * coil.current_by_linkage);
            }
            coils.map(|coil| coil.force_n)
        };
        let mut softness = 0.0;
        let mut least_m = f64::INFINITY;
        for k in 0..3 {
            softness += 2.0 * force_n[k] / gap_m[k];
            least_m = least_m.min(gap_m[k]);
        }
        rate = rate.max((softness / m).sqrt());
        let [v_y, v_z] = state.velocity_m_s;
        rate = rate.max((v_y * v_y + v_z * v_z).sqrt() / least_m);
        if state.contact {
            let ring = &self.config.touchdown;
            rate = rate.max(ring.rate(m, ring.push_n(state.position_m, state.velocity_m_s)));
        }
        (SAFETY / rate).max(SHORTEST_STEP_S)
    }

    /// Begin and length of a part, rounding removed: a begin at a sample instant is that instant, a length of
    /// one sensor step is that step.
    fn without_rounding(&self, state: &PlantState, from_s: f64, length_s: f64) -> (f64, f64) {
        let step_s = self.config.sensor.step_s;
        let rounding = ROUNDING_TOLERANCE * step_s;
        // Sample 0 is taken at the start, so there is a last one.
        let last_s = state.start_s + (state.samples.max(1) - 1) as f64 * step_s;
        (
            if (from_s - last_s).abs() <= rounding { last_s } else { from_s },
            if (length_s - step_s).abs() <= rounding { step_s } else { length_s },
        )
    }

    /// The right-hand side of the equations of motion, d/dt of [`Motion`]: a function of state, input and conditions.
    ///
    /// Not a number outside the gap, where P(4) has no meaning. With current drive the fluxes have no derivative: 0.
    pub fn derivative(&self, x: &Motion, input: &PlantInput, conditions: Conditions) -> Motion {
        let perturbation_n = self.perturbation(input, conditions.time_s, conditions.theta_rad);
        self.derivative_under(x, input, conditions, perturbation_n)
    }

    /// [`Plant::derivative`] with the perturbation known, in N.
    fn derivative_under(&self, x: &Motion, input: &PlantInput, conditions: Conditions, p: [f64; 2]) -> Motion {
        let gap_m = self.magnets.gaps([x[0], x[1]]);
        if !gap_m.iter().all(|gap| *gap > 0.0) {
            return [f64::NAN; 7];
        }
        let linkage_wb = [x[4], x[5], x[6]];
        let (force_n, induced_v) = if self.is_plain() {
            (self.forces(conditions.open, linkage_wb, input, gap_m), [0.0; 3])
        } else {
            let coils = self.coils(conditions.open, linkage_wb, input, gap_m);
            (coils.map(|coil| coil.force_n), self.induced_v(conditions.open, &coils, input))
        };
        let f = self.magnets.resultant(force_n);
        let c = match conditions.contact {
            true => self.config.touchdown.force_n([x[0], x[1]], [x[2], x[3]], input.omega_rad_s),
            false => [0.0; 2],
        };
        let m = self.config.m_kg;
        let [u_1, u_2, u_3] = induced_v;
        [x[2], x[3], sum(f[0] + p[0], c[0]) / m, sum(f[1] + p[1], c[1]) / m, u_1, u_2, u_3]
    }

    /// The sensors tell what they have seen.
    fn take_sample(&self, state: &mut PlantState, seen: Seen) {
        let Seen { position_m, current_a } = self.config.sensor.read(&seen, &mut state.noise);
        state.measured.position_m = position_m;
        state.measured.current_a = current_a;
        state.measured.theta_rad = state.theta_rad;
        state.samples += 1;
    }
}

/// What the equations of motion depend on beside state and input.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Conditions {
    /// Absolute time, in s.
    pub time_s: f64,
    /// Angle of the rotor, in rad.
    pub theta_rad: f64,
    /// Whether rotor and backup bearing push each other.
    pub contact: bool,
    /// Coils whose circuit is open.
    pub open: [bool; 3],
}

/// `a + b`, and `a` itself to the bit, the sign of a zero included, where there is no b.
fn sum(a: f64, b: f64) -> f64 {
    if b == 0.0 { a } else { a + b }
}

/// A step has to be finite and long enough to be resolved.
pub(crate) fn check_step(name: &'static str, step_s: f64, checks: &mut Checks) {
    checks.require(
        step_s.is_finite() && step_s >= SHORTEST_STEP_S,
        name,
        format_args!("{step_s} s"),
        format!("a finite time of at least {SHORTEST_STEP_S} s"),
    );
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

/// Refuses a rotor that starts at a magnet, by the coordinate that takes it there.
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
            format!("a start inside the gap (that of magnet {number} would be {gap} m)"),
        );
        return;
    }
}

fn check_input(input: &PlantInput) -> Result<(), PlantFault> {
    const NAMES: [&str; 9] = ["i[1]", "i[2]", "i[3]", "u[1]", "u[2]", "u[3]", "pY", "pZ", "omega"];
    let [i_1, i_2, i_3] = input.current_a;
    let [u_1, u_2, u_3] = input.voltage_v;
    let [p_y, p_z] = input.perturbation_n;
    for (name, value) in NAMES.into_iter().zip([i_1, i_2, i_3, u_1, u_2, u_3, p_y, p_z, input.omega_rad_s]) {
        if !value.is_finite() {
            return Err(PlantFault::Input { name, value });
        }
    }
    Ok(())
}
