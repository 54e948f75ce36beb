//! The controller of the planar rotor: flatness-based tracking of its reference trajectory.
//!
//! The control law is that of [`tracking`](crate::control::tracking), with two coordinates, three magnets and one bearing.

pub use crate::control::tracking::{
    ControllerError, INSTANT_TOLERANCE, PRELOAD_S, SMALLEST_GAP, UpdateMode, ramp_gains, tracking_gains,
};

use serde::{Deserialize, Serialize};

use crate::bearing::coil::Drive;
use crate::bearing::magnet::{Geometry, Magnets};
use crate::control::reference::{Reference, ReferenceConfig, ReferenceState, Shape};
use crate::control::tracking::{Arrangement, Command, Measured, Names, Tracking, TrackingConfig, TrackingState};
use crate::invalid::{Checks, Invalid};
use crate::machine::Machine;
use crate::variables::unit::{AMPERE, KILOGRAM, METRE, NEWTON, RADIAN, RADIAN_PER_SECOND, VOLT};
use crate::variables::{LAMBDA, OMEGA_RAD_S, Variables};

/// Configuration of the controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
#[serde(default)]
pub struct ControllerConfig {
    /// Mass of the rotor
    #[parameter(name = "m", unit = KILOGRAM, min = 0.0)]
    pub m_kg: f64,
    /// Nominal air gap
    #[parameter(name = "s", unit = METRE, min = 0.0, nominal = 1e-4, display_unit = "mm")]
    pub gap_m: f64,
    /// Angle of magnet {k}; its direction is (sin alpha, cos alpha) in the y-z plane
    #[parameter(name = "alpha", unit = RADIAN)]
    pub alpha_rad: [f64; 3],
    /// The control law.
    #[nested(prefix = "")]
    pub law: TrackingConfig<3, 1>,
    /// The reference trajectory.
    #[nested(prefix = "", context = ())]
    pub reference: ReferenceConfig,
}

impl Default for ControllerConfig {
    /// The paper's bearing and its first guess.
    fn default() -> Self {
        use std::f64::consts::{FRAC_PI_3, PI};
        Self {
            m_kg: 6.7,
            gap_m: 5e-4,
            alpha_rad: [PI, -FRAC_PI_3, FRAC_PI_3],
            law: TrackingConfig::default(),
            reference: ReferenceConfig::default(),
        }
    }
}

/// Inputs of the controller at a sample.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
pub struct ControllerInput {
    /// Angular velocity on the reference trajectory
    #[parameter(name = "reference.omega", tunable, unit = RADIAN_PER_SECOND, start = OMEGA_RAD_S, nominal = 100.0)]
    pub omega_rad_s: f64,
    /// Measured position of the rotor along {axis}
    #[input(names = ["Ym", "Zm"], unit = METRE, nominal = 1e-5)]
    pub position_m: [f64; 2],
    /// Measured current of magnet {k}, with drive = voltage
    #[input(name = "im", unit = AMPERE)]
    pub current_a: [f64; 3],
    /// Estimated force constant of magnet {k}
    #[input(name = "lambdaHat", unit = LAMBDA, nominal = 1e-6)]
    pub lambda_hat_nm2_a2: [f64; 3],
    /// Whether lambdaHat may be used
    #[input(name = "lambdaValid")]
    pub lambda_valid: bool,
    /// Reference along {axis} with reference.shape = external
    #[input(names = ["Yref", "Zref"], unit = METRE, nominal = 1e-5)]
    pub reference_m: [f64; 2],
}

/// Outputs of the controller at a sample.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
pub struct ControllerOutput {
    /// Current reference of magnet {k}; with drive = voltage for the end of the sample
    #[output(name = "i", discrete, unit = AMPERE)]
    pub current_a: [f64; 3],
    /// Voltage command of amplifier {k}, with drive = voltage
    #[output(name = "u", discrete, unit = VOLT, nominal = 10.0)]
    pub voltage_v: [f64; 3],
    /// Tracking error at the last sample, measured minus reference, along {axis}
    #[output(names = ["eY", "eZ"], discrete, unit = METRE, nominal = 1e-6)]
    pub tracking_error_m: [f64; 2],
    /// Observed perturbation force along {axis}
    #[output(names = ["pYHat", "pZHat"], discrete, unit = NEWTON, nominal = 10.0)]
    pub perturbation_n: [f64; 2],
    /// Force constant of magnet {k} that the controller uses
    #[output(name = "lambdaUsed", discrete, unit = LAMBDA, nominal = 1e-6)]
    pub lambda_used_nm2_a2: [f64; 3],
    /// Force command along {axis}
    #[output(names = ["FYdes", "FZdes"], discrete, unit = NEWTON, nominal = 10.0)]
    pub force_n: [f64; 2],
    /// Reference at this sample, (y, z), in m.
    #[hidden]
    pub reference_m: [f64; 2],
    /// Reference at the next sample along {axis}
    ///
    /// Predicted if it is external.
    #[output(names = ["reference.Y", "reference.Z"], discrete, unit = METRE, nominal = 1e-5)]
    pub reference_ahead_m: [f64; 2],
    /// Whether the predicted gap was below its limit, so that the currents are those for the limit
    ///
    /// The limit is [`SMALLEST_GAP`]. The magnets do not give the commanded forces then.
    #[output(discrete)]
    pub saturated: bool,
    /// Whether a voltage command is at the limit, with drive = voltage
    #[output(discrete)]
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
        let law = Tracking::checked(
            config.law.clone(),
            PlanarRotor { m_kg: config.m_kg, magnets: magnets.clone() },
            &mut checks,
        );
        let reference = Reference::checked(config.reference.clone(), config.law.step_s, &magnets, &mut checks);
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
        (self.config.law.modulation, self.config.law.modulation_hz) = (modulation, [modulation_hz]);
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
            lambda_used_nm2_a2: self.config.law.lambda0_nm2_a2,
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
        let course =
            [0.0, 1.0, 2.0].map(|samples| self.reference.ahead(&next.reference, samples * self.config.law.step_s));
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
        if self.config.law.coil.drive == Drive::Voltage {
            ControllerError::check(PlanarRotor::NAMES.current.into_iter().zip(input.current_a))?;
        }
        if self.config.reference.shape == Shape::External {
            let [y, z] = input.reference_m;
            ControllerError::check([("Yref", y), ("Zref", z)])?;
        }
        Ok(())
    }
}
