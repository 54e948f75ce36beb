//! The controller of the planar rotor: flatness-based tracking of its reference trajectory.
//!
//! The control law is that of [`tracking`](crate::control::tracking), with two coordinates, three magnets and one bearing.

pub use crate::control::tracking::{
    ControllerError, INSTANT_TOLERANCE, PRELOAD_S, SMALLEST_GAP, UpdateMode, ramp_gains, tracking_gains,
};

use serde::{Deserialize, Serialize};

use crate::bearing::coil::{CoilConfig, Drive};
use crate::bearing::magnet::{Geometry, Magnets};
use crate::control::reference::{Reference, ReferenceConfig, ReferenceState, Shape};
use crate::control::tracking::{Arrangement, Command, Measured, Names, Tracking, TrackingConfig, TrackingState};
use crate::invalid::Checks;
use crate::invalid::Invalid;

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
    law: TrackingState<2, 3, 1>,
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
        let law = &self.law;
        let parts = law.expected.iter().flatten().chain(&law.in_effect_n).chain(&law.voltage_v).chain(&law.planned_a);
        for (place, value) in all.iter_mut().zip(parts) {
            *place = *value;
        }
        all
    }

    /// Sets the components that [`unknowns`](Self::unknowns) returns.
    pub(crate) fn set_unknowns(&mut self, all: [f64; UNKNOWNS]) {
        let law = &mut self.law;
        let parts = law.expected.iter_mut().flatten();
        let parts = parts.chain(&mut law.in_effect_n).chain(&mut law.voltage_v).chain(&mut law.planned_a);
        for (place, value) in parts.zip(all) {
            *place = value;
        }
    }
}

/// A rotor between three magnets.
#[derive(Clone, Debug, PartialEq)]
struct PlanarRotor {
    m_kg: f64,
    magnets: Magnets,
}

impl Arrangement<2, 3, 1> for PlanarRotor {
    const NAMES: Names<3, 1> = Names {
        lambda0: ["lambda0[1]", "lambda0[2]", "lambda0[3]"],
        current: ["im[1]", "im[2]", "im[3]"],
        f0: ["F0"],
        modulation_hz: ["F0.modulationFrequency"],
    };
    const BEARING: [usize; 3] = [0; 3];

    fn geometry(&self) -> &Geometry {
        self.magnets.geometry()
    }

    fn inertia(&self) -> [f64; 2] {
        [self.m_kg; 2]
    }

    fn allocate(&self, force_n: [f64; 2], [smallest_n]: [f64; 1]) -> [f64; 3] {
        self.magnets.allocate(force_n, smallest_n)
    }
}

/// A validated controller.
#[derive(Clone, Debug, PartialEq)]
pub struct Controller {
    config: ControllerConfig,
    law: Tracking<PlanarRotor, 2, 3, 1>,
    reference: Reference,
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
        let law = TrackingConfig {
            step_s: config.step_s,
            lambda0_nm2_a2: config.lambda0_nm2_a2,
            f0_n: [config.f0_n],
            modulation: config.modulation,
            modulation_hz: [config.modulation_hz],
            tracking_rad_s: config.tracking_rad_s,
            observer_rad_s: config.observer_rad_s,
            current_rad_s: config.current_rad_s,
            coil: config.coil.clone(),
            update: config.update,
            update_time_s: config.update_time_s,
        };
        let law = Tracking::checked(law, PlanarRotor { m_kg: config.m_kg, magnets: magnets.clone() }, &mut checks);
        let reference = Reference::checked(config.reference.clone(), config.step_s, &magnets, &mut checks);
        checks.finish()?;
        Ok(Self { config, law, reference })
    }

    /// The configuration, including the last retuning.
    pub fn config(&self) -> &ControllerConfig {
        &self.config
    }

    /// Changes the modulation of the smallest force: `modulation` as a fraction of `F_0`, its frequency in Hz.
    ///
    /// The phase is continuous.
    ///
    /// # Errors
    /// `F0.modulation` outside 0 to 1; `F0.modulationFrequency` unless it is above 0 and at most half the sample rate. The
    /// former values then remain.
    pub fn retune(&mut self, modulation: f64, modulation_hz: f64) -> Result<(), Vec<Invalid>> {
        self.law.retune(modulation, [modulation_hz])?;
        (self.config.modulation, self.config.modulation_hz) = (modulation, modulation_hz);
        Ok(())
    }

    /// The state before the first sample, which is due at `start_s`, in s.
    pub fn start(&self, start_s: f64) -> ControllerState {
        ControllerState { law: self.law.start(start_s), reference: self.reference.start() }
    }

    /// Whether a state, for instance one read from a file, is consistent: finite numbers, counts in order.
    pub fn accepts(&self, state: &ControllerState) -> bool {
        self.reference.accepts(&state.reference) && self.law.accepts(&state.law)
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
        self.law.due_s(&state.law)
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
        if next.law.samples == 0 {
            self.reference.begin(&mut next.reference, input.position_m);
        }
        self.reference.sample(&mut next.reference, input.omega_rad_s, input.reference_m);
        let course = [0.0, 1.0, 2.0].map(|samples| self.reference.ahead(&next.reference, samples * self.config.step_s));
        // The tracking error refers to the reference itself, not to an observer's estimate of it.
        let reference_m = match self.config.reference.shape {
            Shape::External => input.reference_m,
            _ => course[0].map(|point| point.position_m),
        };
        let tracking_error_m: [f64; 2] = std::array::from_fn(|a| input.position_m[a] - reference_m[a]);
        if !tracking_error_m.iter().all(|error| error.is_finite()) {
            return Err(ControllerError::Overflow { sample: state.law.samples });
        }
        let measured = Measured {
            coordinates: input.position_m,
            current_a: input.current_a,
            lambda_hat_nm2_a2: input.lambda_hat_nm2_a2,
            lambda_valid: input.lambda_valid,
            omega_rad_s: input.omega_rad_s,
        };
        let Command { current_a, voltage_v, force, perturbation, saturated, limited } =
            self.law.sample(&mut next.law, &measured, &course)?;
        *state = next;
        Ok(ControllerOutput {
            current_a,
            voltage_v,
            tracking_error_m,
            perturbation_n: perturbation,
            lambda_used_nm2_a2: state.law.lambda_nm2_a2,
            force_n: force,
            reference_m,
            reference_ahead_m: course[1].map(|point| point.position_m),
            saturated,
            limited,
        })
    }

    fn check_input(&self, input: &ControllerInput) -> Result<(), ControllerError> {
        let [y, z] = input.position_m;
        ControllerError::check([("Ym", y), ("Zm", z), ("reference.omega", input.omega_rad_s)])?;
        if self.config.coil.drive == Drive::Voltage {
            ControllerError::check(PlanarRotor::NAMES.current.into_iter().zip(input.current_a))?;
        }
        if self.config.reference.shape == Shape::External {
            let [y, z] = input.reference_m;
            ControllerError::check([("Yref", y), ("Zref", z)])?;
        }
        Ok(())
    }
}
