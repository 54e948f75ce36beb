//! The model of a plant, written once for the planar rotor and the spindle: values, table, run, derivatives.

use std::fmt::Debug;

use fmu_export::input::{HIGHEST_ORDER, InputTrajectory};
use fmu_export::log::Log;
use fmu_export::variable::Dependency::{Constant, Fixed};
use fmu_export::variable::{Causality, Row, Table, Value, Variability};
use fmu_export::{Capabilities, Info, Invalid, Model, Resources, Step, StepError};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::common::{described, info, refused};
use crate::bearing::scalar::Scalar;
use crate::machine::Machine;
use crate::plant::linearisation::{Point, Taylor};
use crate::plant::sensor::Channels;
use crate::plant::{
    self, Conditions, Equations, INSTANT_TOLERANCE, Motion, Plant, PlantInput, PlantOutput, PlantParameters,
    PlantState, Rotor,
};
use crate::variables::Variables;
use crate::variables::unit::{AMPERE, METRE, METRE_PER_SECOND, RADIAN, RADIAN_PER_SECOND};

/// A rotor as a model: its dependencies, and what the equations leave to it.
pub trait ModelledRotor<const N: usize, const K: usize>:
    PlantParameters<N, K, Contact: Send + Sync>
    + Default
    + Variables<Context = Machine>
    + Serialize
    + DeserializeOwned
    + Send
    + Sync
    + 'static
{
    /// Outputs besides those of all plants.
    type Details: Clone
        + Debug
        + Default
        + PartialEq
        + Variables<Context = Machine>
        + Serialize
        + DeserializeOwned
        + Send
        + Sync
        + 'static;

    /// Adds to a row what it depends on, beyond what holds for all plants.
    fn dependent(row: Row<Values<Self, N, K>>) -> Row<Values<Self, N, K>>;

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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
#[serde(bound(
    serialize = "R: Serialize, R::Details: Serialize, [bool; K]: Serialize, [f64; N]: Serialize, [f64; K]: Serialize",
    deserialize = "R: DeserializeOwned, R::Details: DeserializeOwned, [bool; K]: Deserialize<'de>, \
                   [f64; N]: Deserialize<'de>, [f64; K]: Deserialize<'de>"
))]
pub struct Values<R: ModelledRotor<N, K>, const N: usize, const K: usize> {
    #[nested(prefix = "")]
    config: R,
    /// Whether the circuit of {magnet} is open, so that it carries no current
    #[parameter(names = context.of_magnets("coil.open"), tunable)]
    open: [bool; K],
    #[nested(prefix = "")]
    input: PlantInput<f64, N, K>,
    #[output(
        names = context.of_coordinates(|coordinate| coordinate.position),
        description = context.coordinates[index].position.1,
        unit = context.either(index, METRE, RADIAN), nominal = context.either(index, 1e-5, 1e-4), state,
        with = |row| {
            let name = row.variable.name.clone();
            row.starts_from([format!("{name}0")]).depends(Constant, [name])
        }
    )]
    position_m: [f64; N],
    #[nested(prefix = "")]
    details: R::Details,
    /// Position {place} as read by the sensor at the last sample
    #[output(names = context.measured(), discrete, unit = METRE, nominal = 1e-5)]
    measured_position_m: [f64; N],
    /// Current through {magnet} as read by the sensor at the last sample; with drive = current the one held until then
    #[output(names = context.of_magnets("im"), discrete, unit = AMPERE)]
    measured_current_a: [f64; K],
    /// Unwrapped rotor angle at the last sample
    #[output(name = "theta", discrete, unit = RADIAN, starts_from = ["theta0"])]
    measured_theta_rad: f64,
    /// Speed of the rotor at the last sample, held over the interval that ends there
    #[output(name = "omegam", discrete, unit = RADIAN_PER_SECOND, nominal = 100.0, starts_from = ["omega"])]
    measured_omega_rad_s: f64,
    #[nested(prefix = "")]
    output: PlantOutput<f64, N, K>,
    #[local(
        names = context.of_coordinates(|coordinate| coordinate.rate),
        description = context.coordinates[index].rate.1,
        unit = context.either(index, METRE_PER_SECOND, RADIAN_PER_SECOND), nominal = context.either(index, 1e-2, 0.1), state,
        derivative_of = context.coordinates[index].position.0,
        with = |row| {
            let name = row.variable.name.clone();
            row.starts_from([format!("{name}0")]).depends(Constant, [name])
        }
    )]
    velocity_m_s: [f64; N],
    /// Unwrapped rotor angle
    #[local(name = "rotor.theta", unit = RADIAN, state, starts_from = ["theta0"])]
    theta_rad: f64,
    /// Derivative of the rotor angle, equal to the input omega
    #[local(
        name = "rotor.omega", unit = RADIAN_PER_SECOND, nominal = 100.0, derivative_of = "rotor.theta", starts_from = ["omega"],
        with = |row| row.depends(Constant, ["omega"])
    )]
    omega_rad_s: f64,
}

impl<R: ModelledRotor<N, K>, const N: usize, const K: usize> Default for Values<R, N, K> {
    fn default() -> Self {
        Self {
            config: R::default(),
            open: [false; K],
            input: PlantInput::default(),
            position_m: [0.0; N],
            details: R::Details::default(),
            measured_position_m: [0.0; N],
            measured_current_a: [0.0; K],
            measured_theta_rad: 0.0,
            measured_omega_rad_s: 0.0,
            output: PlantOutput::default(),
            velocity_m_s: [0.0; N],
            theta_rad: 0.0,
            omega_rad_s: 0.0,
        }
    }
}

/// The table of a plant.
fn table<R: ModelledRotor<N, K>, const N: usize, const K: usize>() -> Vec<Row<Values<R, N, K>>> {
    let machine = R::MACHINE;
    // A sampled output is held until the next sample.
    let held = |row: Row<_>| match row.variable.variability {
        Variability::Discrete if row.variable.causality == Causality::Output => row.depends_on_nothing(),
        _ => row,
    };
    let mut rows = Values::rows_in(machine);
    // Where the order of the interface is not that of the fields.
    before(&mut rows, "touchdown.contact", "touchdown.FY");
    for coordinate in machine.coordinates {
        before(&mut rows, coordinate.rate.0, machine.coordinates[0].acceleration.0);
    }
    let rows = rows.into_iter().map(|row| held(R::dependent(feedthrough(row, machine))));
    described(rows, machine)
}

/// Moves a row, if it is there, to the place before another.
fn before<D>(rows: &mut Vec<Row<D>>, name: &str, other: &str) {
    let find = |rows: &[Row<D>], name: &str| rows.iter().position(|row| row.variable.name == name);
    let Some(from) = find(rows, name) else { return };
    let row = rows.remove(from);
    let to = find(rows, other).unwrap_or(from);
    rows.insert(to, row);
}

/// Inputs and states with direct feedthrough to the outputs that all plants have.
fn feedthrough<D>(row: Row<D>, machine: &Machine) -> Row<D> {
    let (name, index) = (row.variable.name.clone(), row.index());
    let is_of_magnet = |what: &str| machine.of_magnets(what).get(index).is_some_and(|known| *known == name);
    let of_magnet = |what: &str| machine.of_magnets(what)[index].clone();
    let bearing = machine.magnet(index).map_or(0, |(bearing, _)| bearing);
    let moving = || machine.moves(bearing).into_iter().map(|n| machine.coordinates[n].position.0);
    if is_of_magnet("F") {
        return row.depends_on(["i", "psi"].map(of_magnet)).depends_on(moving());
    }
    if is_of_magnet("gap") {
        return row.depends(Fixed, moving());
    }
    if is_of_magnet("coil.uInduced") {
        return row.depends_on(["u", "psi"].map(of_magnet)).depends_on(moving());
    }
    let Some(coordinate) = machine.coordinates.get(index) else { return row };
    // The magnets that move the coordinate, and what else they move. A force along the shaft does not turn with it.
    let moved = (0..machine.bearings.len()).map(|b| machine.moves(b)).find(|moved| moved.contains(&index));
    let moved = moved.unwrap_or_default();
    let turning: &[&str] = if moved.len() > 1 { &["omega", "rotor.theta"] } else { &[] };
    if name == coordinate.perturbation.0 {
        return row.depends(Constant, [coordinate.load.0]).depends_on(turning.iter().copied());
    }
    if name == coordinate.acceleration.0 {
        let magnets = (0..machine.magnets())
            .filter(|k| machine.magnet(*k).is_some_and(|(bearing, _)| machine.moves(bearing) == moved));
        let drives = magnets.flat_map(|k| ["i", "psi"].map(|what| machine.of_magnets(what).swap_remove(k)));
        let motion = moved.iter().map(|n| &machine.coordinates[*n]);
        return row
            .depends_on(drives)
            .depends(Fixed, [coordinate.load.0])
            .depends_on(turning.iter().copied())
            .depends_on(motion.flat_map(|coordinate| [coordinate.position.0, coordinate.rate.0]));
    }
    row
}

/// Configuration and inputs of a plant with the given values by index, and start values elsewhere.
pub fn configuration<R: ModelledRotor<N, K>, const N: usize, const K: usize>(
    settings: &[(usize, Value)],
) -> (R, PlantInput<f64, N, K>) {
    let values = Table::new(table::<R, N, K>()).values(settings);
    (values.config, values.input)
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
    const INFO: Info = info(&R::MACHINE.models[0]);
    type Values = Values<R, N, K>;
    type State = PlantState<N, K, R::Contact>;

    const CAPABILITIES: Capabilities =
        Capabilities::NONE.directional_derivatives().output_derivatives(2).interpolates_inputs();

    fn table() -> Vec<Row<Values<R, N, K>>> {
        table()
    }

    fn new(values: &Values<R, N, K>, _: &Resources) -> Result<Self, Vec<Invalid>> {
        Plant::new(values.config.clone()).map(Self).map_err(refused)
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
        self.0.retune(&values.config).map_err(refused)?;
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
        let towards = direction.config.clone();
        let mut derivatives = Values::<R, N, K>::default();
        // Before the run the states are given by the parameters.
        let (start_m, start_m_s) = towards.start();
        let from = |state: f64, start: f64| if started { state } else { state + start };
        derivatives.position_m = std::array::from_fn(|n| from(direction.position_m[n], start_m[n]));
        derivatives.velocity_m_s = std::array::from_fn(|n| from(direction.velocity_m_s[n], start_m_s[n]));
        derivatives.theta_rad = from(direction.theta_rad, towards.start_angle_rad());
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
