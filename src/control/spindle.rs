//! The controller of a spindle: tracking of a path in each radial bearing and of an axial position.
//!
//! The control law is that of [`tracking`](crate::control::tracking), with five coordinates, eight magnets and three bearings.
//! The readings give the coordinates, `q = H⁻¹ r`; the observers see three forces and two moments. The generalised force is
//! shared by the two radial bearings, each of which allocates its part as a planar bearing does, and the axial one:
//!
//! ```text
//! F_X1 = F_0 + max(F_x, 0)      F_X2 = F_0 + max(−F_x, 0)
//! ```

mod path;

pub use path::{BearingPath, SpindlePath, SpindlePathConfig, SpindlePathState};

use serde::{Deserialize, Serialize};

use crate::bearing::coil::Drive;
use crate::bearing::magnet::Geometry;
use crate::bearing::shaft::{self, COORDINATES};
use crate::bearing::spindle::{MAGNETS, READINGS, Spindle, SpindleGeometry};
use crate::control::tracking::{
    Arrangement, Command, ControllerError, Measured, Names, Tracking, TrackingConfig, TrackingState,
};
use crate::invalid::{Checks, Invalid};
use crate::machine::Machine;
use crate::variables::unit::{AMPERE, METRE, NEWTON, NEWTON_METRE, RADIAN_PER_SECOND, VOLT};
use crate::variables::{LAMBDA, OMEGA_RAD_S, Variables};

/// Names of the readings of position.
const READING_NAMES: [&str; READINGS] = ["A.Ym", "A.Zm", "B.Ym", "B.Zm", "Xm"];

/// Configuration of the controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
#[serde(default)]
pub struct SpindleControllerConfig {
    /// Shaft and bearings as the controller knows them. With `J_p` = 0 it compensates no gyroscopic moments.
    #[nested(prefix = "", context = ())]
    pub geometry: SpindleGeometry,
    /// The control law; magnets and bearings in the order of [`spindle`](crate::bearing::spindle).
    #[nested(prefix = "")]
    pub law: TrackingConfig<MAGNETS, 3>,
    /// The reference.
    #[nested(prefix = "", context = ())]
    pub path: SpindlePathConfig,
}

impl Default for SpindleControllerConfig {
    /// The spindle of the examples, a smallest force of 15 N, and modulation frequencies that are apart in all bearings.
    ///
    /// With tracking poles at 1200 rad/s an unbalance of 8 and 5·10⁻⁵ kg·m in two planes leaves a tracking error of 2.5 µm at
    /// 6000 rpm with current drive and 2.8 µm with voltage drive, with poles at 1000 rad/s 2.9 and 3.3 µm; observers with poles at 5000
    /// rad/s would make as much, but the axial amplifiers reach their limit more often (0.1 µm, 10 mA, seeds 1 to 5).
    fn default() -> Self {
        Self {
            geometry: SpindleGeometry::default(),
            law: TrackingConfig {
                f0_n: [15.0; 3],
                modulation_hz: [110.0, 130.0, 90.0],
                tracking_rad_s: 1200.0,
                ..TrackingConfig::default()
            },
            path: SpindlePathConfig::default(),
        }
    }
}

/// Inputs of the controller at a sample.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
pub struct SpindleControllerInput {
    /// Speed of the rotor: of the reference trajectory and of the gyroscopic moments
    #[parameter(name = "reference.omega", tunable, unit = RADIAN_PER_SECOND, start = OMEGA_RAD_S, nominal = 100.0)]
    pub omega_rad_s: f64,
    /// Readings of position.
    #[input(
        names = context.measured(), unit = METRE, nominal = 1e-5,
        description = format!("Measured position of the rotor along {}", PLACES[index])
    )]
    pub reading_m: [f64; READINGS],
    /// Measured current of {magnet}, with drive = voltage
    #[input(names = context.of_magnets("im"), unit = AMPERE)]
    pub current_a: [f64; MAGNETS],
    /// Estimated force constant of {magnet}
    #[input(names = context.of_magnets("lambdaHat"), unit = LAMBDA, nominal = 1e-6)]
    pub lambda_hat_nm2_a2: [f64; MAGNETS],
    /// Whether lambdaHat of all magnets may be used
    #[input(name = "lambdaValid")]
    pub lambda_valid: bool,
}

/// Where tracking errors and references are, in the order of the readings.
const PLACES: [&str; READINGS] = ["y at bearing A", "z at bearing A", "y at bearing B", "z at bearing B", "x"];

/// Outputs of the controller at a sample.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
pub struct SpindleControllerOutput {
    /// Current reference of {magnet}; with drive = voltage for the end of the sample
    #[output(names = context.of_magnets("i"), discrete, unit = AMPERE)]
    pub current_a: [f64; MAGNETS],
    /// Voltage command of {magnet}, with drive = voltage
    #[output(names = context.of_magnets("u"), discrete, unit = VOLT, nominal = 10.0)]
    pub voltage_v: [f64; MAGNETS],
    /// Measured position minus reference at this sample, at the magnets.
    #[output(
        names = ["A.eY", "A.eZ", "B.eY", "B.eZ", "X.e"], discrete, unit = METRE, nominal = 1e-6,
        description = format!("Tracking error at the last sample, measured minus reference, along {}", PLACES[index])
    )]
    pub tracking_error_m: [f64; READINGS],
    /// Estimated perturbation force at the centre of gravity.
    #[output(
        names = ["pXHat", "pYHat", "pZHat"], discrete, unit = NEWTON, nominal = 10.0,
        description = format!("Observed perturbation force along {}", AXES[index])
    )]
    pub perturbation_n: [f64; 3],
    /// Estimated perturbation moment.
    #[output(
        names = ["MYHat", "MZHat"], discrete, unit = NEWTON_METRE,
        description = format!("Observed perturbation moment about {}", AXES[index + 1])
    )]
    pub perturbation_nm: [f64; 2],
    /// Force constant of {magnet} that the controller uses
    #[output(names = context.of_magnets("lambdaUsed"), discrete, unit = LAMBDA, nominal = 1e-6)]
    pub lambda_used_nm2_a2: [f64; MAGNETS],
    /// Commanded force at the centre of gravity.
    #[output(
        names = ["FXdes", "FYdes", "FZdes"], discrete, unit = NEWTON, nominal = 10.0,
        description = format!("Force command along {}", AXES[index])
    )]
    pub force_n: [f64; 3],
    /// Commanded moment.
    #[output(
        names = ["MYdes", "MZdes"], discrete, unit = NEWTON_METRE,
        description = format!("Moment command about {}", AXES[index + 1])
    )]
    pub moment_nm: [f64; 2],
    /// Reference at the next sample, as the tracking error.
    #[output(
        names = ["A.reference.Y", "A.reference.Z", "B.reference.Y", "B.reference.Z", "X.reference.X"], discrete,
        unit = METRE, nominal = 1e-5, description = format!("Reference at the next sample along {}", PLACES[index])
    )]
    pub reference_ahead_m: [f64; READINGS],
    /// Whether a predicted gap was below its limit, so that the currents are those for the limit
    ///
    /// The limit is [`SMALLEST_GAP`](crate::control::tracking::SMALLEST_GAP). The magnets do not give the commanded forces then.
    #[output(discrete)]
    pub saturated: bool,
    /// Whether a voltage command is at the limit, with drive = voltage
    #[output(discrete)]
    pub limited: bool,
}

const AXES: [&str; 3] = ["x", "y", "z"];

/// State of a [`SpindleController`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpindleControllerState {
    law: TrackingState<COORDINATES, MAGNETS, 3>,
    path: SpindlePathState,
}

impl Arrangement<COORDINATES, MAGNETS, 3> for Spindle {
    const NAMES: Names<MAGNETS, 3> = Names {
        lambda0: [
            "A.lambda0[1]",
            "A.lambda0[2]",
            "A.lambda0[3]",
            "B.lambda0[1]",
            "B.lambda0[2]",
            "B.lambda0[3]",
            "X.lambda0[1]",
            "X.lambda0[2]",
        ],
        current: ["A.im[1]", "A.im[2]", "A.im[3]", "B.im[1]", "B.im[2]", "B.im[3]", "X.im[1]", "X.im[2]"],
        f0: ["A.F0", "B.F0", "X.F0"],
        modulation_hz: ["A.F0.modulationFrequency", "B.F0.modulationFrequency", "X.F0.modulationFrequency"],
    };
    const BEARING: [usize; MAGNETS] = [0, 0, 0, 1, 1, 1, 2, 2];

    fn geometry(&self) -> &Geometry<f64, COORDINATES, MAGNETS> {
        self.geometry()
    }

    fn inertia(&self) -> [f64; COORDINATES] {
        self.inertia()
    }

    fn allocate(&self, force: [f64; COORDINATES], [f0_a, f0_b, f0_x]: [f64; 3]) -> [f64; MAGNETS] {
        let [at_a, at_b] = shaft::shared(magnets_at_m(self), force);
        let [a, b] = self.bearings();
        let ([a_1, a_2, a_3], [b_1, b_2, b_3]) = (a.allocate(at_a, f0_a), b.allocate(at_b, f0_b));
        let along = force[0];
        [a_1, a_2, a_3, b_1, b_2, b_3, f0_x + along.max(0.0), f0_x + (-along).max(0.0)]
    }

    fn gyroscopic(&self, omega_rad_s: f64, rates: [f64; COORDINATES]) -> [f64; COORDINATES] {
        self.config().shaft.gyroscopic(omega_rad_s, rates)
    }
}

/// Positions of the radial magnets along the shaft, in m.
fn magnets_at_m(spindle: &Spindle) -> [f64; 2] {
    [spindle.config().a.position_m, spindle.config().b.position_m]
}

/// The coordinates, or their differences, at the magnets: (y, z) in A, (y, z) in B, x, in m.
fn at_magnets(spindle: &Spindle, q: [f64; COORDINATES]) -> [f64; READINGS] {
    let [[a_y, a_z], [b_y, b_z]] = magnets_at_m(spindle).map(|at_m| shaft::displacement(at_m, q));
    [a_y, a_z, b_y, b_z, q[0]]
}

/// A validated controller.
#[derive(Clone, Debug, PartialEq)]
pub struct SpindleController {
    config: SpindleControllerConfig,
    law: Tracking<Spindle, COORDINATES, MAGNETS, 3>,
    path: SpindlePath,
}

impl SpindleController {
    /// A controller of the given configuration.
    ///
    /// # Errors
    /// Every parameter that is not finite or outside its range, by its name in the interface; the geometry as in
    /// [`Spindle::new`], the reference as in [`SpindlePath::new`], the modulation as in [`SpindleController::retune`].
    pub fn new(config: SpindleControllerConfig) -> Result<Self, Vec<Invalid>> {
        let mut checks = Checks::default();
        let spindle = config.geometry.checked(&mut checks);
        let path = SpindlePath::checked(config.path.clone(), config.law.step_s, &spindle, &mut checks);
        let law = Tracking::checked(config.law.clone(), spindle, &mut checks);
        checks.finish()?;
        Ok(Self { config, law, path })
    }

    /// The configuration, including the last retuning.
    pub fn config(&self) -> &SpindleControllerConfig {
        &self.config
    }

    /// Changes the modulation of the smallest forces: `modulation` as a fraction of `F_0`, its frequencies in Hz, of A, B, X.
    ///
    /// The phases are continuous.
    ///
    /// # Errors
    /// `F0.modulation` outside 0 to 1; `A.F0.modulationFrequency`, B and X alike, unless it is above 0 and at most half the
    /// sample rate. The former values then remain.
    pub fn retune(&mut self, modulation: f64, modulation_hz: [f64; 3]) -> Result<(), Vec<Invalid>> {
        self.law.retune(modulation, modulation_hz)?;
        self.config.law = self.law.config().clone();
        Ok(())
    }

    /// The state before the first sample, which is due at `start_s`, in s.
    pub fn start(&self, start_s: f64) -> SpindleControllerState {
        SpindleControllerState { law: self.law.start(start_s), path: self.path.start() }
    }

    /// Whether a state, for instance one read from a file, is consistent: finite numbers, counts in order.
    pub fn accepts(&self, state: &SpindleControllerState) -> bool {
        self.path.accepts(&state.path) && self.law.accepts(&state.law)
    }

    /// The outputs before the first sample: no current, the first guess of λ, and the begin of the reference.
    pub fn output_at_start(&self) -> SpindleControllerOutput {
        let begin = self.path.ahead(&self.path.start(), 0.0).map(|point| point.position_m);
        SpindleControllerOutput {
            lambda_used_nm2_a2: self.config.law.lambda0_nm2_a2,
            reference_ahead_m: at_magnets(self.law.arrangement(), begin),
            ..SpindleControllerOutput::default()
        }
    }

    /// Processes the sample that is due.
    ///
    /// # Errors
    /// [`ControllerError`] if a required number is not finite; the state is then unchanged, and the last currents remain the
    /// last valid ones. An unusable estimate of λ is no error: it is not used.
    pub fn sample(
        &self,
        state: &mut SpindleControllerState,
        input: &SpindleControllerInput,
    ) -> Result<SpindleControllerOutput, ControllerError> {
        self.check_input(input)?;
        let mut next = state.clone();
        let spindle = self.law.arrangement();
        let coordinates = spindle.coordinates(input.reading_m);
        self.path.sample(&mut next.path, input.omega_rad_s, coordinates);
        let course = [0.0, 1.0, 2.0].map(|samples| self.path.ahead(&next.path, samples * self.config.law.step_s));
        let error = std::array::from_fn(|a| coordinates[a] - course[0][a].position_m);
        let tracking_error_m = at_magnets(spindle, error);
        let measured = Measured {
            coordinates,
            current_a: input.current_a,
            lambda_hat_nm2_a2: input.lambda_hat_nm2_a2,
            lambda_valid: input.lambda_valid,
            omega_rad_s: input.omega_rad_s,
        };
        let Command { current_a, voltage_v, force, perturbation, saturated, limited } =
            self.law.sample(&mut next.law, &measured, &course)?;
        if !tracking_error_m.iter().all(|error| error.is_finite()) {
            return Err(ControllerError::Overflow { sample: state.law.samples });
        }
        *state = next;
        let apart = |[x, y, z, beta, gamma]: [f64; COORDINATES]| ([x, y, z], [beta, gamma]);
        let ((perturbation_n, perturbation_nm), (force_n, moment_nm)) = (apart(perturbation), apart(force));
        Ok(SpindleControllerOutput {
            current_a,
            voltage_v,
            tracking_error_m,
            perturbation_n,
            perturbation_nm,
            lambda_used_nm2_a2: state.law.lambda_nm2_a2,
            force_n,
            moment_nm,
            reference_ahead_m: at_magnets(spindle, course[1].map(|point| point.position_m)),
            saturated,
            limited,
        })
    }

    fn check_input(&self, input: &SpindleControllerInput) -> Result<(), ControllerError> {
        ControllerError::check(READING_NAMES.into_iter().zip(input.reading_m))?;
        ControllerError::check([("reference.omega", input.omega_rad_s)])?;
        if self.config.law.coil.drive == Drive::Voltage {
            ControllerError::check(Spindle::NAMES.current.into_iter().zip(input.current_a))?;
        }
        Ok(())
    }
}
