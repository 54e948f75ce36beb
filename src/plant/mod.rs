//! The plant: a rotor between its magnets, with coils, backup bearings and sensors.
//!
//! This file contains state and sampling; `config.rs` the parameters; `equations.rs` and `forces.rs` the equations, written once for N
//! coordinates, K magnets and B bearings; `substeps.rs` and [`integration`] the integration; `trajectory.rs` inputs that vary over a
//! step; [`sensor`] and [`noise`] the sensors; [`linearisation`] derivatives. Sizes default to those of the planar rotor.
//!
//! ```text
//! M q̈ + Ω G q̇ = Σ F_k d_k + p + c
//! F_k = λ_k i_k² / gap_k²            P(4); in general coil.rs
//! dψ_k/dt = u_k − R i_k              with voltage drive, u_k limited by the amplifier
//! ```
//!
//! For the planar rotor, with q = (Y, Z), this becomes
//!
//! ```text
//! m Ÿ = Σ F_k sin α_k + p_y + c_y    P(6), P(3)
//! m Z̈ = Σ F_k cos α_k + p_z + c_z    P(7), P(3)
//! ```
//!
//! Coordinates, signs and G of a shaft that tilts are those of [`shaft`](crate::bearing::shaft). A change of speed adds no term for the
//! tilt: the driving torque acts along the rotor's own axis, and its components across the axis at rest are just `J_p Ω̇ (γ, −β)`.
//!
//! `p` are all forces on the rotor except those of magnets and backup bearings: per axis a, with the absolute time `t`,
//! `p_a + amplitude_a sin(ω_p t + phase_a) + m g_a`, and along (y, z) the unbalance `U ω² (cos(θ + φ), sin(θ + φ))`, of a shaft in two
//! planes at ξ. `c` is the force of the backup bearings, touchdown.rs.
//!
//! # Integration
//!
//! The classical Runge–Kutta method with equal sub-steps of at most `max_step_s`. Where the model is faster, sub-steps are divided
//! until they are at most [`SAFETY`] over the fastest rate: of the coils `R ∂i/∂ψ`, of the rotor in the field of the magnets
//! `√(Σ 2F_k/gap_k d_kᵀM⁻¹d_k)`, of the narrowest gap `|v|/gap`, and of a contact. The instant at which contact with a backup
//! bearing begins or ends is located, and a sub-step ends there, so that none crosses a kink.
//!
//! # Samples
//!
//! The sensors read at `start + k · T_s`. A current sample is the value just before the instant, that is, the current held over
//! the interval that ends there (`heldBefore`). Sample 0 is taken at the start, before which no current flows, so it reads 0 A. With
//! voltage drive the currents are continuous, and a sample is their value at the instant (`linear`). Steps may have any length; see
//! [`Plant::advance`].

pub mod integration;
pub mod linearisation;
pub mod noise;
pub mod sensor;

mod config;
mod equations;
mod error;
mod forces;
mod substeps;
mod trajectory;

use serde::{Deserialize, Serialize};

use crate::bearing::{Drive, Rotor, array};
use crate::invalid::{Checks, Invalid};
pub use crate::plant::sensor::SensorConfig;
use crate::plant::sensor::{Channels, DelayLine, Sample};
use crate::variables::{Saved, is_finite};

pub use config::{Harmonic, PLANES, PlantConfig, PlantConfigOf};
pub use equations::{Conditions, Equations, Instant, Motion, PlantInput, PlantOutput};
pub use error::StepError;
pub use forces::AtBearing;
pub use substeps::{MOST_SUBSTEPS, SAFETY};
pub use trajectory::{HIGHEST_ORDER, InputTrajectory};

/// Fraction of the sample time within which two instants count as the same.
pub const INSTANT_TOLERANCE: f64 = 1e-3;

/// Fraction of the sensor step up to which a time difference is attributed to rounding and removed.
///
/// Accumulated and multiplied times differ in their last bits; with this tolerance both give the same bits of position.
pub const ROUNDING_TOLERANCE: f64 = 1e-6;

/// The shortest sensor step and integration sub-step, in s.
///
/// Shorter ones are lost in the rounding of the time, or take forever.
pub const SHORTEST_STEP_S: f64 = 1e-9;

/// State of a [`Plant`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "[f64; N]: Saved, [f64; K]: Saved, [bool; K]: Saved, [bool; B]: Saved, Channels<N, K>: Saved")]
pub struct PlantState<const N: usize = 2, const K: usize = 3, const B: usize = 1> {
    /// Time of the state, in s.
    pub time_s: f64,
    /// Coordinates, rates and flux linkages; these are 0 with current drive, where they follow from the currents.
    pub motion: Motion<f64, N, K>,
    /// Whether the rotor touches the backup bearing at each bearing.
    pub contact: [bool; B],
    /// Coils with an open circuit, which carry no current; may change between steps.
    pub open: [bool; K],
    /// Angle of the rotor, unwrapped, in rad.
    pub theta_rad: f64,
    /// The last sample; its currents are those held over the interval that ended at the instant, with voltage drive those at the instant.
    pub measured: Sample<N, K>,
    /// Angle of the rotor at that sample, unwrapped, in rad.
    pub measured_theta_rad: f64,
    /// Number of samples delivered; sample k is that of `start + k · T_s`.
    pub samples: u64,
    /// Start time, in s.
    start_s: f64,
    /// Integration of the angle.
    rotation: UniformRotation,
    /// Noise of the sensors.
    noise: Channels<N, K>,
    /// Samples taken but not yet delivered.
    delayed: DelayLine<N, K>,
}

/// θ = `base + ω (t − since)`, with a new base when ω changes, so that rounding does not accumulate over a long run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct UniformRotation {
    base_rad: f64,
    since_s: f64,
    omega_rad_s: f64,
}

impl UniformRotation {
    fn theta_rad(&self, t_s: f64) -> f64 {
        self.base_rad + self.omega_rad_s * (t_s - self.since_s)
    }
}

impl<const N: usize, const K: usize, const B: usize> PlantState<N, K, B> {
    /// Conditions of the equations at the time `t_s` in s.
    pub fn conditions(&self, t_s: f64) -> Conditions<f64, K, B> {
        Conditions { time_s: t_s, theta_rad: self.theta_rad, contact: self.contact, open: self.open }
    }

    /// The state with these inputs at the time `t_s` in s.
    pub fn at<'a>(&'a self, input: &'a PlantInput<f64, N, K>, t_s: f64) -> Instant<'a, f64, N, K, B> {
        Instant { motion: &self.motion, input, conditions: self.conditions(t_s) }
    }
}

/// The plant of a machine, with validated parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Plant<const N: usize = 2, const K: usize = 3, const B: usize = 1> {
    equations: Equations<f64, N, K, B>,
}

impl<const N: usize, const K: usize, const B: usize> Plant<N, K, B> {
    /// A plant of the given configuration.
    ///
    /// # Errors
    /// Every parameter that is not finite or outside its range, by its name in the interface; gaps and angles as in
    /// [`Magnets::checked`](crate::bearing::magnet::Magnets::checked); the coordinate of a rotor that would start outside the gap.
    pub fn new(config: PlantConfigOf<f64, N, K, B>) -> Result<Self, Vec<Invalid>> {
        Checks::described(&config, Rotor::<N, K, B>::MACHINE, |checks| config.check(checks))?;
        Ok(Self { equations: Equations::new(config) })
    }

    /// Adopts the tunable parameters of another configuration, which must be within their limits, as the FMU ensures.
    ///
    /// # Errors
    /// A coil that is too fast; nothing changes then.
    pub fn retune(&mut self, to: &PlantConfigOf<f64, N, K, B>) -> Result<(), Vec<Invalid>> {
        let PlantConfigOf { lambda_nm2_a2, unbalance_kgm, unbalance_phase_rad, harmonic, .. } = to.clone();
        let config =
            PlantConfigOf { lambda_nm2_a2, unbalance_kgm, unbalance_phase_rad, harmonic, ..self.config().clone() };
        Checks::all(|checks| config.coil.check(self.equations.geometry().gap_m, config.lambda_nm2_a2, checks))?;
        self.equations.config = config;
        Ok(())
    }

    /// The configuration, as last retuned.
    pub fn config(&self) -> &PlantConfigOf<f64, N, K, B> {
        &self.equations.config
    }

    /// The equations of motion.
    pub fn equations(&self) -> &Equations<f64, N, K, B> {
        &self.equations
    }

    /// The initial state, at the time `start_s`, with sample 0 taken. With voltage drive no current flows yet.
    pub fn start(&self, start_s: f64) -> PlantState<N, K, B> {
        let config = self.config();
        let &PlantConfigOf { ref sensor, position_m, velocity_m_s, theta_rad, .. } = config;
        let sample = Sample { position_m: config.rotor.readings(position_m), current_a: [0.0; K] };
        let mut state = PlantState {
            time_s: start_s,
            motion: Motion { position_m, velocity_m_s, linkage_wb: [0.0; K] },
            contact: config.touches(&position_m, &velocity_m_s),
            open: [false; K],
            theta_rad,
            measured: sample,
            measured_theta_rad: theta_rad,
            samples: 0,
            start_s,
            rotation: UniformRotation { base_rad: theta_rad, since_s: start_s, omega_rad_s: 0.0 },
            noise: Channels::new(sensor.seed),
            delayed: DelayLine::new(sample, sensor.delay_s / sensor.step_s),
        };
        self.deliver(&mut state, sample);
        state
    }

    /// Advances from `t_s` to `t_s + h_s`, in s, with inputs that vary over the step. A current sample is the value just before the
    /// instant.
    ///
    /// The sensors read at every instant `start + k · T_s` in `(t, t + h]`. An instant within [`INSTANT_TOLERANCE`] of `t + h`
    /// is read at `t + h`; an earlier one divides the step. Each segment is integrated in equal sub-steps, none longer than
    /// `max_step_s`. A step of 0 changes nothing; one too short to change the time neither loses nor repeats a sample.
    ///
    /// # Errors
    /// [`StepError::Contact`] if the rotor leaves the gap; [`StepError::Fast`] if the step would take too long;
    /// [`StepError::Input`] for an input that is not finite;
    /// [`StepError::Time`] for a step that is negative, not finite, or does not begin where the last one ended.
    pub fn advance(
        &self,
        state: &mut PlantState<N, K, B>,
        inputs: &InputTrajectory<N, K>,
        t_s: f64,
        h_s: f64,
    ) -> Result<(), StepError> {
        inputs.check()?;
        let step_s = self.config().sensor.step_s;
        let tolerance = INSTANT_TOLERANCE * step_s;
        let end_s = t_s + h_s;
        let follows = (t_s - state.time_s).abs() <= tolerance;
        if !(follows && h_s >= 0.0 && end_s.is_finite()) {
            return Err(StepError::Time { t_s, h_s, time_s: state.time_s });
        }
        if h_s == 0.0 {
            return Ok(());
        }
        let delay_s = self.config().sensor.delay_s;
        let mut now_s = t_s;
        let mut budget = MOST_SUBSTEPS;
        loop {
            let sample_s = state.start_s + state.samples as f64 * step_s;
            // Without delay a sample is delivered when it is taken.
            let taken_s = match delay_s {
                0.0 => sample_s,
                _ => state.start_s + (state.delayed.taken as f64 * step_s - delay_s),
            };
            let instant_s = taken_s.min(sample_s);
            let inside = instant_s < end_s - tolerance;
            let part_end_s = if inside { instant_s.max(now_s) } else { end_s };
            let length_s = if now_s == t_s && !inside { h_s } else { part_end_s - now_s };
            self.integrate(state, inputs, (now_s, length_s, part_end_s), &mut budget)?;
            if instant_s > end_s + tolerance {
                return Ok(());
            }
            let sample = self.sample(state, &inputs.at(part_end_s));
            if delay_s == 0.0 {
                self.deliver(state, sample);
                if !inside {
                    return Ok(());
                }
            } else if taken_s <= sample_s {
                // If one sample is taken and another delivered at the same instant, the former comes first.
                state.delayed.take(sample);
            } else {
                let delayed = state.delayed.sample(state.samples);
                self.deliver(state, delayed);
            }
            now_s = part_end_s;
        }
    }

    /// Whether a state, for instance one read from a file, belongs to this plant at `t_s`, in s: its numbers are finite, the
    /// rotor is inside the gap, and all samples before `t_s`, but none after it, have been taken.
    pub fn accepts(&self, state: &PlantState<N, K, B>, t_s: f64) -> bool
    where
        PlantState<N, K, B>: Serialize,
    {
        let step_s = self.config().sensor.step_s;
        let inside = self.equations.geometry().gaps(state.motion.position_m).iter().all(|gap| *gap > 0.0);
        // Importers may begin a step slightly off the end of the last one.
        let slack_s = step_s + 1e-6 * t_s.abs().max(1.0);
        let instant_s = |count: u64| state.start_s + count as f64 * step_s;
        let taken = instant_s(state.samples) >= t_s - slack_s && instant_s(state.samples.max(1) - 1) <= t_s + slack_s;
        let delay = (self.config().sensor.delay_s / step_s) as u64 + 2;
        let possible = state.samples.saturating_sub(2)..=state.samples.saturating_add(delay);
        is_finite(state)
            && inside
            && taken
            && (self.config().sensor.delay_s == 0.0 || possible.contains(&state.delayed.taken))
            && (state.time_s - t_s).abs() <= slack_s
    }

    /// The instant of the last sample, in s; sample 0 is taken at the start.
    pub fn sampled_s(&self, state: &PlantState<N, K, B>) -> f64 {
        state.start_s + (state.samples.max(1) - 1) as f64 * self.config().sensor.step_s
    }

    /// The outputs for a state at the time `t_s`, in s.
    pub fn outputs(
        &self,
        state: &PlantState<N, K, B>,
        input: &PlantInput<f64, N, K>,
        t_s: f64,
    ) -> PlantOutput<f64, N, K> {
        self.equations.outputs(&state.at(input, t_s))
    }

    /// The sample of ideal sensors for a state and an input.
    fn sample(&self, state: &PlantState<N, K, B>, input: &PlantInput<f64, N, K>) -> Sample<N, K> {
        let current_a = match self.config().coil.drive {
            Drive::Current => equations::flowing(state.open, input.current_a),
            Drive::Voltage => {
                let gap_m = self.equations.geometry().gaps(state.motion.position_m);
                array::map(self.equations.coils(&state.at(input, state.time_s), gap_m), |coil| coil.current_a)
            }
        };
        Sample { position_m: self.config().rotor.readings(state.motion.position_m), current_a }
    }

    /// Adds the sensor errors to a sample and delivers it.
    fn deliver(&self, state: &mut PlantState<N, K, B>, sample: Sample<N, K>) {
        state.measured = self.config().sensor.read(&sample, &mut state.noise);
        state.measured_theta_rad = state.theta_rad;
        state.samples += 1;
    }
}

/// Requires a sample or integration step that is finite and long enough to be resolved.
pub(crate) fn check_step(name: &'static str, step_s: f64, checks: &mut Checks) {
    let wanted = format!("a finite time of at least {SHORTEST_STEP_S} s");
    checks.number(step_s.is_finite() && step_s >= SHORTEST_STEP_S, name, (step_s, "s"), wanted);
}
