//! Flatness-based tracking of the reference trajectory with a perturbation observer, sampled.
//!
//! Per axis, with the reference trajectory Y* and the estimated perturbation p̂,
//!
//! ```text
//! F = m (Ÿ* − k_1 (Ẏ − Ẏ*) − k_0 (Y − Y*)) − p̂
//! ```
//!
//! # Timing
//!
//! Sample k measures at `t_k = start + k · T_s`. Its currents act over `[t_{k+1}, t_{k+2})`, because co-simulation delays them
//! by one sample; the force commanded at sample k − 1 acts during `[t_k, t_{k+1})`. So the measurement corrects the observer at
//! `t_k`, the force in effect predicts it at `t_{k+1}`, and the feedback is computed there:
//!
//! - gains for the sampled double integrator with both poles at `ρ = exp(−ω_c T_s)`;
//! - feed-forward of the mean acceleration of the reference over `[t_{k+1}, t_{k+2})`, from its velocities at both ends;
//! - currents for the gaps predicted at the middle of `[t_{k+1}, t_{k+2})`, over which they are held.
//!
//! At the first sample the rotor is assumed to be on the reference trajectory: position as measured, velocity of the reference,
//! perturbation 0. From `t_0` to `t_1`, before the first command acts, no current flows, and the observer uses that.
//!
//! # A change of λ
//!
//! The currents stay what they are; a new λ assigns new forces to them. The difference of the resultants is added to the
//! perturbation estimate, so that the sum of force and perturbation does not change. The smallest force starts from that of the
//! new forces and returns to `F_0` with the time constant [`PRELOAD_S`]. So the currents do not jump.
//!
//! Both use the forces commanded at the last sample. With current drive these are the forces in effect. With voltage drive the
//! forces in effect follow from currents measured at one instant: their noise and the errors of the current loop would enter
//! the perturbation estimate, and with an estimate that changes at every sample nothing would hold the smallest force at `F_0`.
//!
//! Voltage drive is in `voltage.rs`, the modulation of the smallest force in `excitation.rs`.

mod excitation;
mod voltage;

pub use voltage::ramp_gains;

use serde::{Deserialize, Serialize};

use crate::bearing::coil::{CoilConfig, Drive};
use crate::bearing::magnet::{self, Magnets};
use crate::control::observer::{Estimate, PerturbationObserver, pole};
use crate::control::reference::{RefPoint, Reference, ReferenceConfig, ReferenceState, Shape};
use crate::invalid::Checks;
use crate::invalid::Invalid;
use crate::plant::check_step;

/// Time constant, in s, with which the smallest force returns to `F_0` after a change of λ.
pub const PRELOAD_S: f64 = 0.01;

/// Below this fraction of the preload, the smallest force does not determine the preload.
///
/// In the trough of a full modulation the smallest force is 0 whatever the preload. Forces of 100 N are rounded to 10⁻¹⁴ N;
/// divided by this fraction, that is still only 10⁻⁸ N of preload.
const TROUGH: f64 = 1e-6;

/// Lower limit of a predicted gap, as a fraction of the nominal gap.
///
/// The currents are then computed for this gap, which keeps them finite, and the output `saturated` is true.
pub const SMALLEST_GAP: f64 = 0.01;

/// Fraction of the sample time by which a sample may precede the time of the update and still count.
pub const INSTANT_TOLERANCE: f64 = 1e-3;

/// When the controller uses the estimated λ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum UpdateMode {
    /// Never: λ0 throughout.
    Never,
    /// Once, at the time of the update or as soon after it as the estimate is valid, as in the paper.
    #[default]
    AtTime,
    /// At every sample at which it is valid, from the start.
    WhenValid,
}

/// Configuration of the controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ControllerConfig {
    /// Mass of the rotor `m`, in kg.
    pub m_kg: f64,
    /// Nominal gap `s`, in m.
    pub gap_m: f64,
    /// Angles `α_k` of the magnets as in P(3), in rad.
    pub alpha_rad: [f64; 3],
    /// Sample time `T_s`, in s.
    pub step_s: f64,
    /// First guess of `λ_k`, in N·m²/A².
    pub lambda0_nm2_a2: [f64; 3],
    /// Smallest force of a magnet `F_0`, in N; 0 is admitted.
    pub f0_n: f64,
    /// Amplitude `a` of the modulation of the smallest force, as a fraction of `F_0`, from 0 to 1; tunable.
    pub modulation: f64,
    /// Frequency `f` of that modulation, in Hz, at most half the sample rate; tunable.
    pub modulation_hz: f64,
    /// Poles of the tracking error, ω_c, in rad/s.
    pub tracking_rad_s: f64,
    /// Poles of the perturbation observer, ω_o, in rad/s.
    pub observer_rad_s: f64,
    /// Pole of the current loop with voltage drive, ω_i, in rad/s.
    pub current_rad_s: f64,
    /// The coils as the controller models them: drive, resistance, leakage, limit of the voltage. It assumes that their iron
    /// does not saturate.
    pub coil: CoilConfig,
    /// When the estimated λ is used.
    pub update: UpdateMode,
    /// Time of the update in [`UpdateMode::AtTime`], in s.
    pub update_time_s: f64,
    /// The reference trajectory.
    pub reference: ReferenceConfig,
}

impl Default for ControllerConfig {
    /// The paper's bearing and its first guess.
    fn default() -> Self {
        use std::f64::consts::PI;
        Self {
            m_kg: 6.7,
            gap_m: 5e-4,
            alpha_rad: [PI, -PI / 3.0, PI / 3.0],
            step_s: 1e-4,
            lambda0_nm2_a2: [4e-6; 3],
            f0_n: 20.0,
            modulation: 0.0,
            modulation_hz: 110.0,
            tracking_rad_s: 1000.0,
            observer_rad_s: 4000.0,
            current_rad_s: 5000.0,
            coil: CoilConfig::default(),
            update: UpdateMode::AtTime,
            update_time_s: 0.2,
            reference: ReferenceConfig::default(),
        }
    }
}

/// Inputs of the controller at a sample.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ControllerInput {
    /// Measured position (Ym, Zm), in m.
    pub position_m: [f64; 2],
    /// Measured currents, in A; must be finite only with voltage drive.
    pub current_a: [f64; 3],
    /// Estimate of λ, in N·m²/A².
    pub lambda_hat_nm2_a2: [f64; 3],
    /// Whether that estimate is valid.
    pub lambda_valid: bool,
    /// External reference (Yref, Zref), in m; must be finite only if it is used.
    pub reference_m: [f64; 2],
    /// Angular velocity on the reference trajectory from this sample on, in rad/s.
    pub omega_rad_s: f64,
}

/// Outputs of the controller at a sample.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ControllerOutput {
    /// Currents to hold from the next sample on, in A; with voltage drive those at the end of that sample.
    pub current_a: [f64; 3],
    /// Voltages to hold from the next sample on, in V, with voltage drive.
    pub voltage_v: [f64; 3],
    /// Measured position minus reference at this sample, (y, z), in m.
    pub tracking_error_m: [f64; 2],
    /// Estimated perturbation p̂, (y, z), in N.
    pub perturbation_n: [f64; 2],
    /// λ in use, in N·m²/A².
    pub lambda_used_nm2_a2: [f64; 3],
    /// Commanded force, (F_y, F_z), in N.
    pub force_n: [f64; 2],
    /// Reference at this sample, (y, z), in m.
    pub reference_m: [f64; 2],
    /// Reference at the next sample, (y, z), in m; predicted if it is external.
    pub reference_ahead_m: [f64; 2],
    /// Whether a predicted gap was below [`SMALLEST_GAP`]: the currents are those for that gap, and the magnets do not give the
    /// commanded forces.
    pub saturated: bool,
    /// Whether a voltage command is at the limit of the amplifiers.
    pub limited: bool,
}

/// State of a [`Controller`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControllerState {
    /// Number of samples taken.
    pub samples: u64,
    /// Start time, in s.
    start_s: f64,
    /// Predictions of the observers for the next sample, (y, z).
    expected: [Estimate; 2],
    /// Forces of the magnets from the next sample on, by the model, in N; with voltage drive those at the last sample.
    in_effect_n: [f64; 3],
    /// Forces of the magnets commanded at the last sample, in N.
    asked_n: [f64; 3],
    /// Voltages from the next sample on, in V.
    voltage_v: [f64; 3],
    /// Currents commanded for the next sample, in A, with voltage drive.
    planned_a: [f64; 3],
    /// λ in use, in N·m²/A².
    lambda_nm2_a2: [f64; 3],
    /// Whether the estimate has been taken over, in [`UpdateMode::AtTime`].
    updated: bool,
    /// Smallest force commanded, without modulation, in N.
    preload_n: f64,
    /// `1 + a sin 2πφ` at the last sample.
    modulation_factor: f64,
    /// φ at the sample at which f last changed, in revolutions, in [0, 1).
    base_rev: f64,
    /// Number of that sample.
    base_sample: u64,
    /// f since then, in Hz.
    modulation_hz: f64,
    reference: ReferenceState,
}

/// Number of components of a [`ControllerState`] that a small motion of the loop changes.
#[cfg(feature = "app")]
pub(crate) const UNKNOWNS: usize = 15;

/// For the sensitivity function, which the library of an FMU does without.
#[cfg(feature = "app")]
impl ControllerState {
    /// Increments of these components for difference quotients, each of the size of a small motion.
    pub(crate) const INCREMENTS: [f64; UNKNOWNS] =
        [1e-9, 1e-6, 1e-3, 1e-9, 1e-6, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-5, 1e-5, 1e-5];

    /// `[x, v, d]` of y and of z, forces and voltages in effect, planned currents.
    pub(crate) fn unknowns(&self) -> [f64; UNKNOWNS] {
        let mut all = [0.0; UNKNOWNS];
        let parts =
            self.expected.iter().flatten().chain(&self.in_effect_n).chain(&self.voltage_v).chain(&self.planned_a);
        for (place, value) in all.iter_mut().zip(parts) {
            *place = *value;
        }
        all
    }

    /// Sets the components that [`unknowns`](Self::unknowns) returns.
    pub(crate) fn set_unknowns(&mut self, all: [f64; UNKNOWNS]) {
        let parts = self.expected.iter_mut().flatten();
        let parts = parts.chain(&mut self.in_effect_n).chain(&mut self.voltage_v).chain(&mut self.planned_a);
        for (place, value) in parts.zip(all) {
            *place = value;
        }
    }
}

/// Result of a sample.
struct Command {
    current_a: [f64; 3],
    voltage_v: [f64; 3],
    force_n: [f64; 2],
    saturated: bool,
    limited: bool,
}

/// Why a sample was refused. The state is unchanged, and there are no new currents.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ControllerError {
    /// An input is not finite.
    #[error("the input {name} is not finite: {value}")]
    Input {
        /// Name of the input as in the interface.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// The inputs are finite, but so large that the results are not.
    #[error("sample {sample} leads to currents or estimates that are not finite")]
    Overflow {
        /// Number of the sample, from 0.
        sample: u64,
    },
}

/// A validated controller.
#[derive(Clone, Debug, PartialEq)]
pub struct Controller {
    config: ControllerConfig,
    magnets: Magnets,
    observer: PerturbationObserver,
    reference: Reference,
    /// `[k_0, k_1]` in 1/s² and 1/s.
    gains: [f64; 2],
    /// `[k_0, k_1, k_2]` in 1/s², 1/s and 1, with voltage drive.
    ramp_gains: [f64; 3],
    /// `ρ_i`.
    decay: f64,
    /// Fraction of the way to `F_0` that the smallest force covers per sample.
    relax: f64,
}

/// `[k_0, k_1]`, in 1/s² and 1/s, that put both poles of the sampled double integrator at `ρ = exp(−ω T_s)`.
///
/// `k_0 = (1 − ρ)²/T_s²`, `k_1 = (1 − ρ)(3 + ρ)/(2 T_s)`.
pub fn tracking_gains(bandwidth_rad_s: f64, step_s: f64) -> [f64; 2] {
    let (rho, q) = pole(bandwidth_rad_s, step_s);
    [q * q / (step_s * step_s), q * (3.0 + rho) / (2.0 * step_s)]
}

impl Controller {
    /// A controller of the given configuration.
    ///
    /// # Errors
    /// Every parameter that is not finite or outside its range, by its name in the interface; `s` and `alpha[k]` as in
    /// [`Magnets::new`], the reference as in [`Reference::new`], the modulation as in [`Controller::retune`].
    pub fn new(config: ControllerConfig) -> Result<Self, Vec<Invalid>> {
        let mut checks = Checks::default();
        checks.positive("m", config.m_kg, "kg");
        let magnets = Magnets::checked(config.gap_m, config.alpha_rad, &mut checks);
        check_step("Ts", config.step_s, &mut checks);
        for (name, lambda) in ["lambda0[1]", "lambda0[2]", "lambda0[3]"].into_iter().zip(config.lambda0_nm2_a2) {
            checks.positive(name, lambda, "N.m2/A2");
        }
        checks.not_negative("F0", config.f0_n, "N");
        excitation::check(config.modulation, config.modulation_hz, config.step_s, &mut checks);
        checks.positive("bandwidth.tracking", config.tracking_rad_s, "rad/s");
        checks.positive("bandwidth.observer", config.observer_rad_s, "rad/s");
        checks.positive("bandwidth.current", config.current_rad_s, "rad/s");
        config.coil.check([config.gap_m; 3], config.lambda0_nm2_a2, &mut checks);
        checks.finite("update.time", config.update_time_s, "s");
        let reference = Reference::checked(config.reference.clone(), config.step_s, &magnets, &mut checks);
        checks.finish()?;
        Ok(Self {
            magnets,
            observer: PerturbationObserver::new(config.observer_rad_s, config.step_s),
            reference,
            gains: tracking_gains(config.tracking_rad_s, config.step_s),
            ramp_gains: ramp_gains(config.tracking_rad_s, config.step_s),
            decay: pole(config.current_rad_s, config.step_s).0,
            relax: -libm::expm1(-config.step_s / PRELOAD_S),
            config,
        })
    }

    /// The configuration, including the last retuning.
    pub fn config(&self) -> &ControllerConfig {
        &self.config
    }

    /// The state before the first sample, which is due at `start_s`, in s.
    pub fn start(&self, start_s: f64) -> ControllerState {
        ControllerState {
            samples: 0,
            start_s,
            expected: [[0.0; 3]; 2],
            in_effect_n: [0.0; 3],
            asked_n: [0.0; 3],
            voltage_v: [0.0; 3],
            planned_a: [0.0; 3],
            lambda_nm2_a2: self.config.lambda0_nm2_a2,
            updated: false,
            preload_n: self.config.f0_n,
            modulation_factor: 1.0,
            base_rev: self.first_phase_rev(),
            base_sample: 0,
            modulation_hz: self.config.modulation_hz,
            reference: self.reference.start(),
        }
    }

    /// Whether a state, for instance one read from a file, is consistent: finite numbers, counts in order.
    pub fn accepts(&self, state: &ControllerState) -> bool {
        let lists = state.expected.iter().flatten().chain(&state.in_effect_n).chain(&state.lambda_nm2_a2);
        let lists = lists.chain(&state.asked_n).chain(&state.voltage_v).chain(&state.planned_a);
        let modulation = [&state.modulation_factor, &state.base_rev, &state.modulation_hz];
        let numbers = lists.chain([&state.start_s, &state.preload_n]).chain(modulation);
        let counts = state.base_sample < state.samples.max(1) && state.samples < u64::MAX;
        self.reference.accepts(&state.reference) && counts && numbers.copied().all(f64::is_finite)
    }

    /// The outputs before the first sample: no current, the first guess of λ, and the begin of the reference.
    pub fn output_at_start(&self) -> ControllerOutput {
        let begin = self.reference.ahead(&self.reference.start(), 0.0).map(|point| point.position_m);
        ControllerOutput {
            lambda_used_nm2_a2: self.config.lambda0_nm2_a2,
            reference_m: begin,
            reference_ahead_m: begin,
            ..ControllerOutput::default()
        }
    }

    /// When the next sample is due, in s: start + count · T_s.
    pub fn due_s(&self, state: &ControllerState) -> f64 {
        state.start_s + state.samples as f64 * self.config.step_s
    }

    /// Processes the sample that is due.
    ///
    /// # Errors
    /// [`ControllerError`] if a required number is not finite; the state is then unchanged, and the last currents remain the
    /// last valid ones. An unusable estimate of λ is no error: it is not used.
    pub fn sample(
        &self,
        state: &mut ControllerState,
        input: &ControllerInput,
    ) -> Result<ControllerOutput, ControllerError> {
        self.check_input(input)?;
        let mut next = state.clone();
        let output = self.next(&mut next, input);
        let estimates = next.expected.iter().flatten().chain(&next.in_effect_n).chain(&output.current_a);
        let coils = output.voltage_v.iter().chain(&next.planned_a);
        let outputs = output.force_n.iter().chain(&output.perturbation_n).chain(&output.tracking_error_m);
        if !estimates.chain(outputs).chain(coils).all(|value| value.is_finite()) {
            return Err(ControllerError::Overflow { sample: state.samples });
        }
        *state = next;
        Ok(output)
    }

    fn next(&self, state: &mut ControllerState, input: &ControllerInput) -> ControllerOutput {
        let step_s = self.config.step_s;
        let first = state.samples == 0;

        if first {
            self.reference.begin(&mut state.reference, input.position_m);
        }
        self.reference.sample(&mut state.reference, input.omega_rad_s, input.reference_m);
        let here = self.reference.ahead(&state.reference, 0.0);
        let begin = self.reference.ahead(&state.reference, step_s);
        let end = self.reference.ahead(&state.reference, 2.0 * step_s);
        // The tracking error refers to the reference itself, not to an observer's estimate of it.
        let reference_m = match self.config.reference.shape {
            Shape::External => input.reference_m,
            _ => here.map(|point| point.position_m),
        };

        let mut estimate: [Estimate; 2] = std::array::from_fn(|a| {
            if first {
                [input.position_m[a], here[a].velocity_m_s, 0.0]
            } else {
                self.observer.update(state.expected[a], input.position_m[a])
            }
        });
        let voltage = self.config.coil.drive == Drive::Voltage;
        let floor_m = SMALLEST_GAP * self.config.gap_m;
        let gap_m = self.magnets.gaps(estimate.map(|[x, ..]| x)).map(|gap| gap.max(floor_m));
        if voltage {
            state.in_effect_n = magnet::forces(state.lambda_nm2_a2, input.current_a, gap_m);
        }
        self.update_lambda(state, &mut estimate, input);
        state.preload_n += self.relax * (self.config.f0_n - state.preload_n);
        state.modulation_factor = self.modulate(state);

        let command = match voltage {
            true => self.voltages(state, &estimate, input.current_a, gap_m, [begin, end]),
            false => self.currents(state, &estimate, [begin, end]),
        };
        state.samples += 1;
        let Command { current_a, voltage_v, force_n, saturated, limited } = command;

        ControllerOutput {
            current_a,
            voltage_v,
            tracking_error_m: std::array::from_fn(|a| input.position_m[a] - reference_m[a]),
            perturbation_n: estimate.map(|[_, _, d]| self.config.m_kg * d),
            lambda_used_nm2_a2: state.lambda_nm2_a2,
            force_n,
            reference_m,
            reference_ahead_m: begin.map(|point| point.position_m),
            saturated,
            limited,
        }
    }

    /// Currents to hold over the sample time that begins at the next sample, with the reference at its begin and end.
    fn currents(
        &self,
        state: &mut ControllerState,
        estimate: &[Estimate; 2],
        [begin, end]: [[RefPoint; 2]; 2],
    ) -> Command {
        let m = self.config.m_kg;
        let step_s = self.config.step_s;
        let in_effect_n = self.magnets.resultant(state.in_effect_n);
        let [k_0, k_1] = self.gains;
        let mut force_n = [0.0; 2];
        let mut middle_m = [0.0; 2];
        for a in 0..2 {
            let expected = self.observer.predict(estimate[a], in_effect_n[a] / m);
            let [x, v, d] = expected;
            let feedforward = (end[a].velocity_m_s - begin[a].velocity_m_s) / step_s;
            let acceleration = feedforward - k_1 * (v - begin[a].velocity_m_s) - k_0 * (x - begin[a].position_m);
            force_n[a] = m * (acceleration - d);
            middle_m[a] = self.observer.predict_by(expected, acceleration - d, 0.5 * step_s)[0];
            state.expected[a] = expected;
        }
        let wanted_n = self.magnets.allocate(force_n, state.preload_n * state.modulation_factor);
        let floor_m = SMALLEST_GAP * self.config.gap_m;
        let predicted_m = self.magnets.gaps(middle_m);
        let saturated = predicted_m.iter().any(|gap| *gap < floor_m);
        let current_a = magnet::currents(wanted_n, predicted_m.map(|gap| gap.max(floor_m)), state.lambda_nm2_a2);
        state.in_effect_n = wanted_n;
        state.asked_n = wanted_n;
        Command { current_a, voltage_v: [0.0; 3], force_n, saturated, limited: false }
    }

    /// Uses the estimated λ when it is due, and adds the difference in force to the perturbation estimate.
    fn update_lambda(&self, state: &mut ControllerState, estimate: &mut [Estimate; 2], input: &ControllerInput) {
        let hat = input.lambda_hat_nm2_a2;
        let usable = input.lambda_valid && hat.iter().all(|lambda| lambda.is_finite() && *lambda > 0.0);
        let before = state.lambda_nm2_a2;
        let after = match self.config.update {
            UpdateMode::AtTime if usable && !state.updated && self.update_is_due(state) => {
                state.updated = true;
                hat
            }
            UpdateMode::WhenValid if usable => hat,
            _ => return,
        };
        state.lambda_nm2_a2 = after;
        if state.samples == 0 || after == before {
            // No current flows yet, or nothing changes.
            return;
        }
        let old_n = self.magnets.resultant(state.asked_n);
        // Currents and gaps are unchanged, so P(4) scales with the ratio of the λ.
        for k in 0..3 {
            state.in_effect_n[k] *= after[k] / before[k];
            state.asked_n[k] *= after[k] / before[k];
        }
        let new_n = self.magnets.resultant(state.asked_n);
        for a in 0..2 {
            estimate[a][2] += (old_n[a] - new_n[a]) / self.config.m_kg;
        }
        if state.modulation_factor > TROUGH {
            let [f_1, f_2, f_3] = state.asked_n;
            state.preload_n = f_1.min(f_2).min(f_3) / state.modulation_factor;
        }
    }

    fn update_is_due(&self, state: &ControllerState) -> bool {
        self.due_s(state) >= self.config.update_time_s - INSTANT_TOLERANCE * self.config.step_s
    }

    fn check_input(&self, input: &ControllerInput) -> Result<(), ControllerError> {
        let finite = |name, value: f64| {
            if value.is_finite() { Ok(()) } else { Err(ControllerError::Input { name, value }) }
        };
        finite("Ym", input.position_m[0])?;
        finite("Zm", input.position_m[1])?;
        finite("reference.omega", input.omega_rad_s)?;
        if self.config.coil.drive == Drive::Voltage {
            for (name, value) in ["im[1]", "im[2]", "im[3]"].into_iter().zip(input.current_a) {
                finite(name, value)?;
            }
        }
        if self.config.reference.shape == Shape::External {
            finite("Yref", input.reference_m[0])?;
            finite("Zref", input.reference_m[1])?;
        }
        Ok(())
    }
}
