//! The controller of any machine: flatness-based tracking of its reference trajectory.
//!
//! The control law is in [`tracking`](crate::control::tracking). The readings give the coordinates, `q = H⁻¹ r`; the observers estimate
//! perturbation forces, and moments of a shaft that tilts. The generalised force is split among the bearings, which allocate it.

pub use crate::control::tracking::{
    Allocation, ControllerError, PRELOAD_S, SMALLEST_GAP, UpdateMode, ramp_gains, tracking_gains,
};

use serde::{Deserialize, Serialize};

pub use crate::bearing::Used;
use crate::bearing::shaft::has_x;
use crate::bearing::{Drive, Rotor, RotorConfig, array};
use crate::control::observer::{PerturbationObserver, pole};
use crate::control::reference::{RefPoint, Reference, ReferenceConfig, ReferenceState};
use crate::control::tracking::{TrackingConfig, TrackingState, excitation};
use crate::invalid::{Checks, Invalid, NotFinite};
use crate::machine::Machine;
use crate::variables::unit::{AMPERE, METRE, NEWTON, NEWTON_METRE, RADIAN_PER_SECOND, VOLT};
use crate::variables::{LAMBDA, OMEGA_RAD_S, Saved, Variables, is_finite};

/// Configuration of the controller of a machine with N coordinates, K magnets in G groups, and B bearings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
#[serde(default, bound = "RotorConfig<f64, B>: Saved, TrackingConfig<K, G>: Saved, ReferenceConfig<B>: Saved")]
pub struct ControllerConfigOf<const N: usize, const K: usize, const B: usize, const G: usize> {
    /// Rotor and bearings as modelled by the controller. With `J_p` = 0 it does not compensate gyroscopic moments.
    #[nested(prefix = "")]
    pub rotor: RotorConfig<f64, B>,
    /// Which magnets are used
    #[parameter(name = "magnets.used", count = usize::from(!context.tilts() && !context.is_planar()))]
    pub used: Used,
    /// The control law.
    #[nested(prefix = "")]
    pub law: TrackingConfig<K, G>,
    /// The reference trajectory.
    #[nested(prefix = "")]
    pub reference: ReferenceConfig<B>,
}

/// Configuration for the paper's planar rotor.
pub type ControllerConfig = ControllerConfigOf<2, 3, 1, 1>;

impl<const N: usize, const K: usize, const B: usize, const G: usize> Default for ControllerConfigOf<N, K, B, G> {
    /// The paper's bearing, or one of the same size, with the paper's first guess; no axial motion.
    ///
    /// For shafts the spindle of the examples, a smallest force of 15 N, and different modulation frequencies in all bearings.
    /// With tracking poles at 1200 rad/s an unbalance of 8 and 5·10⁻⁵ kg·m in two planes causes a tracking error of 2.5 µm at
    /// 6000 rpm with current drive and 2.8 µm with voltage drive, with poles at 1000 rad/s 2.9 and 3.3 µm. Observer poles at 5000 rad/s
    /// would gain as much, but the axial amplifiers reach their limit more often (0.1 µm, 10 mA, seeds 1 to 5).
    fn default() -> Self {
        let machine = Rotor::<N, K, B>::MACHINE;
        let mut law = TrackingConfig::default();
        if machine.tilts() {
            (law.f0_n, law.tracking_rad_s) = ([15.0; G], 1200.0);
            if has_x::<N>() {
                law.modulation_hz[G - 1] = 90.0;
            }
        }
        Self { rotor: RotorConfig::of(machine), used: Used::Both, law, reference: ReferenceConfig::of(machine) }
    }
}

/// Inputs of the controller at a sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine, default)]
#[serde(bound = "[f64; N]: Saved, [f64; K]: Saved")]
pub struct ControllerInput<const N: usize = 2, const K: usize = 3> {
    /// Angular velocity on the reference trajectory; of a shaft that tilts also that of the gyroscopic moments
    #[parameter(name = "reference.omega", tunable, unit = RADIAN_PER_SECOND, start = OMEGA_RAD_S, nominal = 100.0)]
    pub omega_rad_s: f64,
    /// Measured position of the rotor along {axis}
    #[input(names = context.measured(), unit = METRE, nominal = 1e-5)]
    pub position_m: [f64; N],
    /// Measured current of {magnet}, with drive = voltage
    #[input(names = context.of_magnets("im"), unit = AMPERE)]
    pub current_a: [f64; K],
    /// Estimated force constant of {magnet}
    #[input(names = context.of_magnets("lambdaHat"), unit = LAMBDA, nominal = 1e-6)]
    pub lambda_hat_nm2_a2: [f64; K],
    /// Whether lambdaHat of all magnets may be used
    #[input(name = "lambdaValid")]
    pub lambda_valid: bool,
    /// Reference along {axis} with reference.shape = external
    #[input(
        names = context.of_resultant("").into_iter().map(|axis| axis + "ref").collect::<Vec<_>>(), unit = METRE,
        nominal = 1e-5
    )]
    pub reference_m: [f64; N],
}

/// Outputs of the controller at a sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine, default)]
#[serde(bound = "[f64; N]: Saved, [f64; K]: Saved")]
pub struct ControllerOutput<const N: usize = 2, const K: usize = 3> {
    /// Current reference of {magnet}; with drive = voltage for the end of the sample
    #[output(names = context.of_magnets("i"), discrete, unit = AMPERE)]
    pub current_a: [f64; K],
    /// Voltage command of the amplifier of {magnet}, with drive = voltage
    #[output(names = context.of_magnets("u"), discrete, unit = VOLT, nominal = 10.0)]
    pub voltage_v: [f64; K],
    /// Tracking error at the last sample, measured minus reference, along {axis}
    #[output(names = context.of_readings("e"), discrete, unit = METRE, nominal = 1e-6)]
    pub tracking_error_m: [f64; N],
    /// Observed perturbation {force} {direction}
    #[output(
        names = context.of_loads("p", "Hat"), discrete, unit = context.either(index, NEWTON, NEWTON_METRE),
        nominal = context.either(index, 10.0, 1.0)
    )]
    pub perturbation_n: [f64; N],
    /// Force constant of {magnet} that the controller uses
    #[output(names = context.of_magnets("lambdaUsed"), discrete, unit = LAMBDA, nominal = 1e-6)]
    pub lambda_used_nm2_a2: [f64; K],
    /// Commanded {force} {direction}
    #[output(
        names = context.of_loads("F", "des"), discrete, unit = context.either(index, NEWTON, NEWTON_METRE),
        nominal = context.either(index, 10.0, 1.0)
    )]
    pub force_n: [f64; N],
    /// Reference at this sample, along the axes of the tracking error, in m.
    #[hidden]
    pub reference_m: [f64; N],
    /// Reference at the next sample along {axis}
    ///
    /// Along the axes of the tracking error; predicted if it is external.
    #[output(names = context.of_references(), discrete, unit = METRE, nominal = 1e-5)]
    pub reference_ahead_m: [f64; N],
    /// Whether a predicted gap was below its limit, so that the currents are those for the limit
    ///
    /// The limit is [`SMALLEST_GAP`]. The magnets then do not produce the commanded forces.
    #[output(discrete)]
    pub saturated: bool,
    /// Whether a voltage command is at the limit, with drive = voltage
    #[output(discrete)]
    pub limited: bool,
}

/// State of a [`Controller`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "ReferenceState<N>: Saved, TrackingState<N, K, G>: Saved")]
pub struct ControllerState<const N: usize = 2, const K: usize = 3, const G: usize = 1> {
    law: TrackingState<N, K, G>,
    reference: ReferenceState<N>,
}

/// A validated controller.
#[derive(Clone, Debug, PartialEq)]
pub struct Controller<const N: usize = 2, const K: usize = 3, const B: usize = 1, const G: usize = 1> {
    pub(super) config: ControllerConfigOf<N, K, B, G>,
    pub(super) rotor: Rotor<N, K, B>,
    reference: Reference<N, B>,
    pub(super) inertia: [f64; N],
    /// The group of each magnet.
    pub(super) group: [usize; K],
    /// Smallest force of each group, in N, and its bias current, in A.
    pub(super) f0_n: [f64; G],
    pub(super) bias_a: [f64; G],
    pub(super) observer: PerturbationObserver,
    /// `[k_0, k_1]` in 1/s² and 1/s.
    pub(super) gains: [f64; 2],
    /// `[k_0, k_1, k_2]` in 1/s², 1/s and 1, with voltage drive.
    pub(super) ramp_gains: [f64; 3],
    /// `ρ_i`.
    pub(super) decay: f64,
    /// Fraction by which the smallest force approaches `F_0` per sample.
    pub(super) relax: f64,
}

impl<const N: usize, const K: usize, const B: usize, const G: usize> Controller<N, K, B, G> {
    /// A controller of the given configuration.
    ///
    /// # Errors
    /// Parameters that are not finite or outside their limits, by their names in the interface; the geometry as in
    /// [`Rotor::checked`], the reference as in [`Reference::checked`], the modulation as in [`Controller::retune`].
    pub fn new(config: ControllerConfigOf<N, K, B, G>) -> Result<Self, Vec<Invalid>> {
        let law = &config.law;
        let (rotor, reference) = Checks::described(&config, Rotor::<N, K, B>::MACHINE, |checks| {
            let rotor = Rotor::checked(config.rotor, checks);
            law.check(&rotor, config.used, checks);
            let reference = Reference::checked(config.reference.clone(), law.step_s, &rotor, checks);
            (rotor, reference)
        })?;
        let groups = Rotor::<N, K, B>::MACHINE.groups();
        Ok(Self {
            inertia: config.rotor.shaft.inertia(),
            group: array::from_fn(|k| Rotor::<N, K, B>::MACHINE.group(k)),
            f0_n: array::from_fn(|g| law.f0_n[groups[g].0]),
            bias_a: array::from_fn(|g| law.bias_a[groups[g].0]),
            observer: PerturbationObserver::new(law.observer_rad_s, law.step_s),
            gains: tracking_gains(law.tracking_rad_s, law.step_s),
            ramp_gains: ramp_gains(law.tracking_rad_s, law.step_s),
            decay: pole(law.current_rad_s, law.step_s).0,
            relax: -libm::expm1(-law.step_s / PRELOAD_S),
            rotor,
            reference,
            config,
        })
    }

    /// The configuration, as last retuned.
    pub fn config(&self) -> &ControllerConfigOf<N, K, B, G> {
        &self.config
    }

    /// Changes the modulation of the smallest forces: `modulation` as a fraction of `F_0`, and its frequencies in Hz, one per group.
    ///
    /// The phases are continuous. The numbers must be within their limits, as the FMU ensures.
    ///
    /// # Errors
    /// `F0.modulationFrequency` above half the sample rate; nothing changes then.
    pub fn retune(&mut self, modulation: f64, modulation_hz: [f64; G]) -> Result<(), Vec<Invalid>> {
        let law = TrackingConfig { modulation, modulation_hz, ..self.config.law.clone() };
        Checks::all(|checks| excitation::check(&law, Rotor::<N, K, B>::MACHINE, checks))?;
        self.config.law = law;
        Ok(())
    }

    /// The state before the first sample, which is due at `start_s`, in s.
    pub fn start(&self, start_s: f64) -> ControllerState<N, K, G> {
        ControllerState { law: self.law_at_start(start_s), reference: self.reference.start() }
    }

    /// Whether a state, for instance one read from a file, has finite numbers and consistent counts.
    pub fn accepts(&self, state: &ControllerState<N, K, G>) -> bool
    where
        ControllerState<N, K, G>: Serialize,
    {
        is_finite(state) && state.reference.is_in_order() && state.law.is_in_order()
    }

    /// The outputs before the first sample: no current, the first guess of λ, and the start of the reference.
    pub fn output_at_start(&self) -> ControllerOutput<N, K> {
        let start_m = self.at_magnets(self.reference.ahead(&self.reference.start(), 0.0));
        ControllerOutput {
            lambda_used_nm2_a2: self.config.law.lambda0_nm2_a2,
            reference_m: start_m,
            reference_ahead_m: start_m,
            ..ControllerOutput::default()
        }
    }

    fn at_magnets(&self, reference: [RefPoint; N]) -> [f64; N] {
        self.rotor.config().at_magnets(array::map(reference, |[x, ..]| x))
    }

    /// Processes the sample that is due.
    ///
    /// # Errors
    /// [`ControllerError`] if a required number is not finite; the state is then unchanged. An unusable estimate of λ is no
    /// error: it is ignored.
    pub fn sample(
        &self,
        state: &mut ControllerState<N, K, G>,
        input: &ControllerInput<N, K>,
    ) -> Result<ControllerOutput<N, K>, ControllerError> {
        self.check_input(input)?;
        let mut next = state.clone();
        let rotor = &self.rotor;
        let coordinates = rotor.coordinates(input.position_m);
        self.reference.sample(&mut next.reference, input.omega_rad_s, coordinates, input.reference_m);
        let step_s = self.config.law.step_s;
        let preview = array::from_fn(|k| self.reference.ahead(&next.reference, k as f64 * step_s));
        // The tracking error refers to the reference itself, not to the estimate of an observer.
        let reference = match self.reference.is_external() {
            true => input.reference_m,
            false => array::map(preview[0], |[x, ..]| x),
        };
        let tracking_error_m = rotor.config().at_magnets(array::from_fn(|a| coordinates[a] - reference[a]));
        if !tracking_error_m.iter().all(|error| error.is_finite()) {
            return Err(ControllerError::Overflow { sample: state.law.samples });
        }
        let mut output = self.command(&mut next.law, coordinates, input, &preview)?;
        *state = next;
        output.tracking_error_m = tracking_error_m;
        output.lambda_used_nm2_a2 = state.law.lambda_nm2_a2;
        output.reference_m = rotor.config().at_magnets(reference);
        output.reference_ahead_m = self.at_magnets(preview[1]);
        Ok(output)
    }

    fn check_input(&self, input: &ControllerInput<N, K>) -> Result<(), NotFinite> {
        let machine = Rotor::<N, K, B>::MACHINE;
        NotFinite::check(&|| machine.measured(), &input.position_m)?;
        NotFinite::check(&|| vec!["reference.omega".into()], &[input.omega_rad_s])?;
        if self.config.law.coil.drive == Drive::Voltage {
            NotFinite::check(&|| machine.of_magnets("im"), &input.current_a)?;
        }
        if self.reference.is_external() {
            let names = || machine.of_resultant("").into_iter().map(|axis| axis + "ref").collect();
            NotFinite::check(&names, &input.reference_m)?;
        }
        Ok(())
    }
}
