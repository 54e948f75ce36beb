//! The model of a plant, written once for the planar rotor and the spindle: values, run, derivatives, and the rows that both have.

use std::fmt::Debug;

use fmu_export::input::{HIGHEST_ORDER, InputTrajectory};
use fmu_export::log::Log;
use fmu_export::unit::{
    AMPERE, METRE, NEWTON_PER_METRE, NEWTON_SECOND_PER_METRE, ONE, RADIAN, RADIAN_PER_SECOND, SECOND, WEBER,
};
use fmu_export::variable::Dependency::Constant;
use fmu_export::variable::{Access, Row, Table, Value, Variability};
use fmu_export::{Capabilities, Info, Invalid, Model, Resources, Step, StepError};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::common::{DRIVE, displayed, together};
use crate::bearing::coil::{CoilConfig, Drive};
use crate::bearing::scalar::Scalar;
use crate::invalid;
use crate::plant::linearisation::{Point, Taylor};
use crate::plant::sensor::{Channels, SensorConfig};
use crate::plant::{
    self, Conditions, Equations, INSTANT_TOLERANCE, Motion, Plant, PlantInput, PlantOutput, PlantParameters,
    PlantState, Rotor,
};

/// Speed of the paper's experiments, 3000 rpm.
pub(super) const OMEGA_RAD_S: f64 = 100.0 * std::f64::consts::PI;

/// A rotor as a model: its table, and what the equations leave to it.
pub trait ModelledRotor<const N: usize, const K: usize>:
    PlantParameters<N, K, Contact: Send + Sync> + Default + Serialize + DeserializeOwned + Send + Sync + 'static
{
    /// Name and description.
    const INFO: Info;

    /// Outputs besides those of all plants.
    type Details: Clone + Debug + Default + PartialEq + Serialize + DeserializeOwned + Send + Sync + 'static;

    /// The table of variables.
    fn table() -> Vec<Row<Values<Self, N, K>>>;

    /// The sensors.
    fn sensor_mut(&mut self) -> &mut SensorConfig<N, K>;

    /// The coils.
    fn coil_mut(&mut self) -> &mut CoilConfig;

    /// The parameters that give coordinates and rates at the start, and the angle.
    fn start_mut(&mut self) -> (&mut [f64; N], &mut [f64; N], &mut f64);

    /// Applies changed tunable parameters.
    ///
    /// # Errors
    /// Every invalid parameter; nothing is changed then.
    fn retune(plant: &mut Plant<Self, N, K>, to: &Self) -> Result<(), Vec<invalid::Invalid>>;

    /// The details where the magnets pull with these forces; `of` makes a number of the result, the value or a derivative.
    fn details<U: Scalar>(
        equations: &Equations<Self::With<U>, N, K>,
        motion: &Motion<U, N, K>,
        omega_rad_s: U,
        contact: Self::Contact,
        force_n: [U; K],
        of: impl Fn(U) -> f64,
    ) -> Self::Details;
}

/// The values of all variables of a plant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound(
    serialize = "R: Serialize, R::Contact: Serialize, R::Details: Serialize, [bool; K]: Serialize, [f64; N]: Serialize, \
                 [f64; K]: Serialize",
    deserialize = "R: DeserializeOwned, R::Contact: DeserializeOwned, R::Details: DeserializeOwned, \
                   [bool; K]: Deserialize<'de>, [f64; N]: Deserialize<'de>, [f64; K]: Deserialize<'de>"
))]
pub struct Values<R: ModelledRotor<N, K>, const N: usize, const K: usize> {
    pub(super) config: R,
    pub(super) seed: i32,
    pub(super) drive: i32,
    pub(super) open: [bool; K],
    pub(super) contact: R::Contact,
    pub(super) input: PlantInput<f64, N, K>,
    pub(super) output: PlantOutput<f64, N, K>,
    pub(super) details: R::Details,
    pub(super) position_m: [f64; N],
    pub(super) velocity_m_s: [f64; N],
    pub(super) measured_position_m: [f64; N],
    pub(super) measured_current_a: [f64; K],
    pub(super) measured_theta_rad: f64,
    pub(super) measured_omega_rad_s: f64,
    pub(super) theta_rad: f64,
    pub(super) omega_rad_s: f64,
}

impl<R: ModelledRotor<N, K>, const N: usize, const K: usize> Default for Values<R, N, K> {
    fn default() -> Self {
        Self {
            config: R::default(),
            seed: 0,
            drive: 0,
            open: [false; K],
            contact: R::Contact::default(),
            input: PlantInput::default(),
            output: PlantOutput::default(),
            details: R::Details::default(),
            position_m: [0.0; N],
            velocity_m_s: [0.0; N],
            measured_position_m: [0.0; N],
            measured_current_a: [0.0; K],
            measured_theta_rad: 0.0,
            measured_omega_rad_s: 0.0,
            theta_rad: 0.0,
            omega_rad_s: 0.0,
        }
    }
}

impl<R: ModelledRotor<N, K>, const N: usize, const K: usize> Values<R, N, K> {
    /// The configuration, converted from the types of the interface.
    fn config(&self) -> (R, Vec<Invalid>) {
        let mut config = self.config.clone();
        // Any integer is a seed, negative ones included.
        config.sensor_mut().seed = u64::from(self.seed.cast_unsigned());
        let mut findings = Vec::new();
        let drives = [Drive::Current, Drive::Voltage];
        DRIVE.choose("drive", self.drive, drives, &mut config.coil_mut().drive, &mut findings);
        (config, findings)
    }
}

/// Configuration and inputs of a plant with the given values by index, and start values elsewhere.
///
/// # Errors
/// Every value that is not an item of its enumeration.
pub(super) fn configuration<R: ModelledRotor<N, K>, const N: usize, const K: usize>(
    settings: &[(usize, Value)],
) -> Result<(R, PlantInput<f64, N, K>), Vec<Invalid>> {
    let values = Table::new(R::table()).values(settings);
    let (config, findings) = values.config();
    together(findings, Ok((config, values.input)))
}

/// Noise and resolution of the sensors; `positions` names what the position sensors read.
pub(super) fn sensor_errors<D>(
    positions: &str,
    noise: [Access<D, f64>; 2],
    resolution: [Access<D, f64>; 2],
) -> impl Iterator<Item = Row<D>> {
    let ([position_noise, current_noise], [position_resolution, current_resolution]) = (noise, resolution);
    [
        Row::real("sensor.positionNoise", position_noise, METRE, 0.0)
            .nominal(1e-7)
            .description(format!("Standard deviation of the noise on {positions}")),
        Row::real("sensor.currentNoise", current_noise, AMPERE, 0.0)
            .nominal(1e-2)
            .description("Standard deviation of the noise on im"),
        Row::real("sensor.positionResolution", position_resolution, METRE, 0.0)
            .nominal(1e-7)
            .description(format!("Resolution of {positions}; 0 for no rounding")),
        Row::real("sensor.currentResolution", current_resolution, AMPERE, 0.0)
            .nominal(1e-3)
            .description("Resolution of im; 0 for no rounding"),
    ]
    .into_iter()
    .map(|row| row.fixed().min(0.0))
}

/// Delay, sample time and seed of the sensors, and the step of the integration.
pub(super) fn sampling<D>(
    positions: &str,
    [delay, ts, max_step]: [Access<D, f64>; 3],
    seed: Access<D, i32>,
) -> impl Iterator<Item = Row<D>> {
    let real = |name: &'static str, place, start, nominal| {
        Row::real(name, place, SECOND, start).min(0.0).nominal(nominal).display_unit("µs")
    };
    [
        real("sensor.delay", delay, 0.0, 1e-4)
            .description(format!("Delay of {positions} and im, up to 16 sample times")),
        real("sensor.Ts", ts, 1e-4, 1e-4).description("Sample time of the sensors"),
        Row::integer("sensor.seed", seed, 1).description("Seed of the noise; equal seeds give equal noise"),
        real("solver.maxStep", max_step, 5e-5, 1e-5).description("Upper bound of the integration step"),
    ]
    .into_iter()
    .map(Row::fixed)
}

/// Saturation of the iron.
pub(super) fn saturation<D>(flux: Access<D, f64>) -> Row<D> {
    Row::real("coil.fluxSaturation", flux, WEBER, 0.0).fixed().min(0.0).nominal(1e-2).description(
        "Flux at which the iron takes as much current as the nominal gap; 0 for iron that does not saturate",
    )
}

/// Clearance, stiffness and damping of a backup bearing, whose names begin with `prefix`; `from` is what the clearance is
/// measured from.
pub(super) fn touchdown<D>(
    prefix: &str,
    (what, from): (&str, &str),
    clearance_m: f64,
    [clearance, stiffness, damping]: [Access<D, f64>; 3],
) -> impl Iterator<Item = Row<D>> {
    [
        Row::real(format!("{prefix}touchdown.clearance"), clearance, METRE, clearance_m)
            .nominal(1e-4)
            .display_unit("mm")
            .description(format!("Distance from the {from} at which the rotor touches the {what}")),
        Row::real(format!("{prefix}touchdown.stiffness"), stiffness, NEWTON_PER_METRE, 5e7)
            .nominal(1e7)
            .description(format!("Stiffness of the {what}")),
        Row::real(format!("{prefix}touchdown.damping"), damping, NEWTON_SECOND_PER_METRE, 5e3)
            .nominal(1e3)
            .description(format!("Damping of the {what}")),
    ]
    .into_iter()
    .map(|row| row.fixed().min(0.0))
}

/// Friction of a backup bearing, and the radius that it acts at.
pub(super) fn friction<D>(
    prefix: &str,
    what: &str,
    [friction, radius]: [Access<D, f64>; 2],
) -> impl Iterator<Item = Row<D>> {
    [
        Row::real(format!("{prefix}touchdown.friction"), friction, ONE, 0.0)
            .nominal(0.1)
            .description(format!("Coefficient of friction of the {what}")),
        Row::real(format!("{prefix}touchdown.radius"), radius, METRE, 0.025)
            .nominal(1e-2)
            .display_unit("mm")
            .description(format!("Radius of the rotor at the {what}, used by friction")),
    ]
    .into_iter()
    .map(|row| row.fixed().min(0.0))
}

/// Angle and speed of the rotor at the last sample.
pub(super) fn encoder<D>(theta: Access<D, f64>, omega: Access<D, f64>) -> impl Iterator<Item = Row<D>> {
    [
        Row::real("theta", theta, RADIAN, 0.0)
            .sampled_output()
            .description("Unwrapped rotor angle at the last sample")
            .starts_from(["theta0"]),
        Row::real("omegam", omega, RADIAN_PER_SECOND, 0.0)
            .sampled_output()
            .nominal(100.0)
            .description("Speed of the rotor at the last sample, held over the interval that ends there")
            .starts_from(["omega"]),
    ]
    .into_iter()
}

/// The angle as a state, and its derivative.
pub(super) fn rotation<D>(theta: Access<D, f64>, omega: Access<D, f64>) -> impl Iterator<Item = Row<D>> {
    [
        Row::real("rotor.theta", theta, RADIAN, 0.0)
            .local()
            .description("Unwrapped rotor angle")
            .state()
            .starts_from(["theta0"]),
        Row::real("rotor.omega", omega, RADIAN_PER_SECOND, 0.0)
            .local()
            .nominal(100.0)
            .description("Derivative of the rotor angle, equal to the input omega")
            .derivative_of("rotor.theta")
            .depends(Constant, ["omega"])
            .starts_from(["omega"]),
    ]
    .into_iter()
}

/// The model of a plant.
#[derive(Clone)]
pub struct PlantModel<R: ModelledRotor<N, K>, const N: usize, const K: usize>(Plant<R, N, K>);

impl<R: ModelledRotor<N, K>, const N: usize, const K: usize> PlantModel<R, N, K> {
    fn fill(&self, state: &PlantState<N, K, R::Contact>, values: &mut Values<R, N, K>, time_s: f64) {
        values.position_m = state.position_m;
        values.velocity_m_s = state.velocity_m_s;
        values.measured_position_m = state.measured.position_m;
        values.measured_current_a = state.measured.current_a;
        values.measured_theta_rad = state.measured.theta_rad;
        values.theta_rad = state.theta_rad;
        values.omega_rad_s = values.input.omega_rad_s;
        values.output = self.0.outputs(state, &values.input, time_s);
        let (motion, omega_rad_s) = (state.motion(), values.input.omega_rad_s);
        let force_n = values.output.force_n;
        let equations = self.0.equations();
        values.details = R::details(equations, &motion, omega_rad_s, state.contact, force_n, |value: f64| value);
        values.contact = state.contact;
    }

    /// The inputs over a step in the form of the equations.
    fn trajectory(values: &Values<R, N, K>, inputs: &InputTrajectory<Values<R, N, K>>) -> plant::InputTrajectory<N, K> {
        let slopes = (!inputs.is_held()).then(|| {
            std::array::from_fn(|lower| {
                let mut slopes = Values::default();
                inputs.apply_derivatives(&mut slopes, lower + 1);
                slopes.input
            })
        });
        plant::InputTrajectory { input: values.input.clone(), slopes, since_s: inputs.start_s() }
    }
}

impl<R: ModelledRotor<N, K>, const N: usize, const K: usize> Model for PlantModel<R, N, K>
where
    // True of every length that is used; serde does not know it of all.
    Values<R, N, K>: Serialize + DeserializeOwned,
    PlantState<N, K, R::Contact>: Serialize + DeserializeOwned,
{
    const INFO: Info = R::INFO;
    type Values = Values<R, N, K>;
    type State = PlantState<N, K, R::Contact>;

    const CAPABILITIES: Capabilities =
        Capabilities::NONE.directional_derivatives().output_derivatives(2).interpolates_inputs();

    fn table() -> Vec<Row<Values<R, N, K>>> {
        // A sampled output is held until the next sample.
        let is_held = |row: &Row<_>| row.variable.variability == Variability::Discrete;
        let rows = R::table().into_iter().map(|row| if is_held(&row) { row.depends_on_nothing() } else { row });
        displayed(rows.collect())
    }

    fn new(values: &Values<R, N, K>, _: &Resources) -> Result<Self, Vec<Invalid>> {
        let (config, findings) = values.config();
        together(findings, Plant::new(config)).map(Self)
    }

    fn start(&self, values: &mut Values<R, N, K>, start_s: f64) -> PlantState<N, K, R::Contact> {
        let mut state = self.0.start(start_s);
        state.open = values.open;
        values.measured_omega_rad_s = values.input.omega_rad_s;
        self.fill(&state, values, start_s);
        state
    }

    fn accepts(
        &self,
        state: &PlantState<N, K, R::Contact>,
        _: &Values<R, N, K>,
        time_s: Option<f64>,
    ) -> Result<(), String> {
        if time_s.is_some_and(|time_s| !self.0.accepts(state, time_s)) {
            return Err("the state does not belong to this time or to these parameters".into());
        }
        Ok(())
    }

    fn base_step_s(&self) -> f64 {
        self.0.base_step_s()
    }

    fn retune(
        &mut self,
        state: &mut PlantState<N, K, R::Contact>,
        values: &Values<R, N, K>,
        _: &Resources,
    ) -> Result<(), Vec<Invalid>> {
        let tuned = R::retune(&mut self.0, &values.config);
        together(Vec::new(), tuned)?;
        state.open = values.open;
        Ok(())
    }

    fn step(
        &self,
        state: &mut PlantState<N, K, R::Contact>,
        values: &mut Values<R, N, K>,
        step: Step,
        inputs: &InputTrajectory<Values<R, N, K>>,
        _: &mut dyn Log,
    ) -> Result<(), StepError> {
        let samples = state.samples;
        let trajectory = Self::trajectory(values, inputs);
        let (time_s, length_s) = self.where_it_stands(state, step);
        let outcome = self.0.advance_along(state, &trajectory, time_s, length_s);
        if state.samples != samples {
            values.measured_omega_rad_s = trajectory.at(self.0.sampled_s(state)).omega_rad_s;
        }
        inputs.apply(values, if outcome.is_ok() { step.end_s() } else { state.time_s });
        self.fill(state, values, step.end_s());
        outcome.map_err(StepError::of)
    }

    fn refresh(&self, state: &PlantState<N, K, R::Contact>, values: &mut Values<R, N, K>, time_s: f64) {
        self.fill(state, values, time_s);
    }

    fn differentiate(
        &self,
        state: &PlantState<N, K, R::Contact>,
        values: &Values<R, N, K>,
        direction: &Values<R, N, K>,
        time_s: f64,
        started: bool,
    ) -> Values<R, N, K> {
        let point = Point::of(&self.0, state, &values.input, time_s);
        let mut towards = direction.config.clone();
        let mut derivatives = Values::<R, N, K>::default();
        // Before the run the states are given by the parameters.
        let (start_m, start_m_s, start_rad) = towards.start_mut();
        let from = |state: f64, start: f64| if started { state } else { state + start };
        derivatives.position_m = std::array::from_fn(|n| from(direction.position_m[n], start_m[n]));
        derivatives.velocity_m_s = std::array::from_fn(|n| from(direction.velocity_m_s[n], start_m_s[n]));
        derivatives.theta_rad = from(direction.theta_rad, *start_rad);
        derivatives.omega_rad_s = direction.input.omega_rad_s;
        let line = point.along(&Point {
            motion: Motion {
                position_m: derivatives.position_m,
                velocity_m_s: derivatives.velocity_m_s,
                linkage_wb: direction.output.linkage_wb,
            },
            input: direction.input.clone(),
            conditions: Conditions { theta_rad: derivatives.theta_rad, ..Conditions::default() },
            config: towards,
        });
        (derivatives.output, derivatives.details) = Self::derivatives_of(&line, 1);
        derivatives.output.linkage_wb = direction.output.linkage_wb;
        self.differentiate_first_sample(&line, direction, &mut derivatives);
        derivatives.measured_theta_rad = derivatives.theta_rad;
        derivatives.measured_omega_rad_s = direction.input.omega_rad_s;
        derivatives
    }

    fn output_derivatives(
        &self,
        state: &PlantState<N, K, R::Contact>,
        values: &Values<R, N, K>,
        slopes: &[Values<R, N, K>; HIGHEST_ORDER],
        time_s: f64,
        order: usize,
    ) -> Values<R, N, K> {
        let point = Point::of(&self.0, state, &values.input, time_s);
        let slopes = slopes.each_ref().map(|slopes| slopes.input.clone());
        let line = point.in_time::<3>(&slopes);
        let (output, details) = Self::derivatives_of(&line, order);
        let position_m = line.motion.position_m.map(|series| series.derivative(order));
        Values { position_m, output, details, ..Values::default() }
    }
}

impl<R: ModelledRotor<N, K>, const N: usize, const K: usize> PlantModel<R, N, K> {
    /// The derivatives of one order of all outputs.
    fn derivatives_of<const ORDERS: usize>(
        line: &Point<R::With<Taylor<ORDERS>>, N, K>,
        order: usize,
    ) -> (PlantOutput<f64, N, K>, R::Details) {
        let of = |series: Taylor<ORDERS>| series.derivative(order);
        let equations = Equations::new(line.config.clone());
        let (Conditions { contact, .. }, omega_rad_s) = (line.conditions, line.input.omega_rad_s);
        let output = equations.outputs(&line.motion, &line.input, line.conditions);
        let details = R::details(&equations, &line.motion, omega_rad_s, contact, output.force_n, of);
        (output.map(of), details)
    }

    /// The derivatives of the first sample: `(1 + gain error) x + offset + σ n` with the first draw n. A rounded reading is
    /// constant almost everywhere.
    fn differentiate_first_sample(
        &self,
        line: &Point<R::With<Taylor<2>>, N, K>,
        direction: &Values<R, N, K>,
        derivatives: &mut Values<R, N, K>,
    ) {
        let (sensor, towards) = (self.0.config().sensor(), direction.config.sensor());
        let Channels { position, current } = Channels::<N, K>::new(sensor.seed);
        let position_draws = position.map(|mut noise| noise.standard_normal());
        let current_draws = current.map(|mut noise| noise.standard_normal());
        let readings_m = line.config.readings_m(line.motion.position_m);
        derivatives.measured_position_m = std::array::from_fn(|n| {
            let Taylor([reading_m, slope_m]) = readings_m[n];
            let rotor_m = (1.0 + sensor.position_gain_error[n]) * slope_m + towards.position_gain_error[n] * reading_m;
            let own_m = towards.position_offset_m[n] + towards.position_noise_m * position_draws[n];
            if sensor.position_resolution_m == 0.0 { rotor_m + own_m } else { 0.0 }
        });
        // No current is held before the start.
        derivatives.measured_current_a = std::array::from_fn(|k| {
            let own_a = towards.current_offset_a[k] + towards.current_noise_a * current_draws[k];
            if sensor.current_resolution_a == 0.0 { own_a } else { 0.0 }
        });
    }

    /// Begin and length of a step, aligned with the plant's own time: importers recompute the begin, and where the plant's
    /// tolerance is tighter than theirs, the step begins where the last one ended.
    fn where_it_stands(&self, state: &PlantState<N, K, R::Contact>, step: Step) -> (f64, f64) {
        let beside_s = (step.time_s - state.time_s).abs();
        if beside_s <= 0.5 * INSTANT_TOLERANCE * self.0.config().sensor().step_s {
            return (step.time_s, step.length_s);
        }
        (state.time_s, (step.end_s() - state.time_s).max(0.0))
    }
}
