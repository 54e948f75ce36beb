//! `MagneticBearing`, `MagneticSpindle` and the plants of the other machines: a rigid rotor, its magnets and their coils, unbalance, loads,
//! backup bearings and sensors.

use fmu_export::input::{HIGHEST_ORDER, InputTrajectory};
use fmu_export::log::Log;
use fmu_export::variable::Dependency::Constant;
use fmu_export::variable::{Causality, Row, Table, Value, Variability};
use fmu_export::{Capabilities, Info, Invalid, Model, Resources, Step, StepError};
use serde::{Deserialize, Serialize};

use super::common::{described, info};
use super::dependencies::dependent;
use crate::bearing::{Rotor, array};
use crate::machine::{Coordinate, Machine};
use crate::plant::linearisation::{Point, Taylor};
use crate::plant::sensor::Channels;
use crate::plant::{
    self, AtBearing, Conditions, INSTANT_TOLERANCE, Motion, Plant, PlantConfigOf, PlantInput, PlantOutput, PlantState,
};
use crate::variables::unit::{AMPERE, METRE, METRE_PER_SECOND, RADIAN, RADIAN_PER_SECOND};
use crate::variables::{Saved, Variables};

/// Values of all variables of a plant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine, default)]
#[serde(
    bound = "PlantConfigOf<f64, N, K, B>: Saved, PlantInput<f64, N, K>: Saved, PlantOutput<f64, N, K>: Saved, [AtBearing; B]: Saved, [bool; B]: Saved, [bool; K]: Saved, [f64; N]: Saved, [f64; K]: Saved"
)]
pub struct Values<const N: usize, const K: usize, const B: usize> {
    #[nested(prefix = "")]
    config: PlantConfigOf<f64, N, K, B>,
    /// Whether the circuit of {magnet} is open, so that it carries no current
    #[parameter(names = context.of_magnets("coil.open"), tunable)]
    open: [bool; K],
    #[nested(prefix = "")]
    input: PlantInput<f64, N, K>,
    /// {position} {direction}
    #[output(
        names = context.of_coordinates(|coordinate| coordinate.position),
        unit = context.either(index, METRE, RADIAN), nominal = context.either(index, 1e-5, 1e-4), state,
        with = a_state
    )]
    position_m: [f64; N],
    #[nested(
        prefixes = context.of_bearings("").into_iter().take(context.if_tilting(B)), count = context.if_tilting(B),
        context = context.bearings[index]
    )]
    at_bearings: [AtBearing; B],
    /// Whether the rotor touches the backup bearing{at bearing}
    #[output(names = context.of_contact())]
    contact: [bool; B],
    /// Position along {axis} as read by the sensor at the last sample
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
    /// Derivative of {coordinate}
    #[local(
        names = context.of_coordinates(|coordinate| coordinate.rate),
        unit = context.either(index, METRE_PER_SECOND, RADIAN_PER_SECOND), nominal = context.either(index, 1e-2, 0.1), state,
        derivative_of = context.coordinates[index].position,
        with = a_state
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

/// A state with its start parameter.
fn a_state(row: Row<()>) -> Row<()> {
    let name = row.variable.name.clone();
    row.starts_from([format!("{name}0")]).depends(Constant, [name])
}

/// The rows of a plant with the dependencies of its outputs, in the order of the interface.
fn arranged(mut rows: Vec<Row<()>>, machine: &Machine) -> Vec<Row<()>> {
    // A sampled output is held until the next sample.
    let held = |row: Row<()>| match row.variable.variability {
        Variability::Discrete if row.variable.causality == Causality::Output => row.depends_on_nothing(),
        _ => row,
    };
    // Rows that the interface orders differently from the fields.
    if !machine.tilts() {
        let at_start = [|of: &Coordinate| of.position, |of: &Coordinate| of.rate].map(|part| machine.at_start(part));
        at_start.iter().flatten().for_each(|name| before(&mut rows, name, "drive"));
        before(&mut rows, "theta0", "sensor.positionNoise");
        before(&mut rows, "touchdown.contact", "touchdown.FY");
    }
    for coordinate in machine.coordinates {
        before(&mut rows, coordinate.rate, machine.coordinates[0].acceleration);
    }
    let rows = rows.into_iter().map(|row| held(dependent(row, machine)));
    described(rows.collect(), machine)
}

/// Moves a row, if it exists, before another.
fn before(rows: &mut Vec<Row<()>>, name: &str, other: &str) {
    let find = |rows: &[Row<()>], name: &str| rows.iter().position(|row| row.variable.name == name);
    let Some(from) = find(rows, name) else { return };
    let row = rows.remove(from);
    let to = find(rows, other).unwrap_or(from);
    rows.insert(to, row);
}

/// The table of a plant.
fn table<const N: usize, const K: usize, const B: usize>() -> Vec<Row<Values<N, K, B>>> {
    let machine = Rotor::<N, K, B>::MACHINE;
    Values::placed(arranged(Values::<N, K, B>::described(machine), machine))
}

/// Configuration and inputs of a plant with the given values by index, and start values otherwise.
pub fn configuration<const N: usize, const K: usize, const B: usize>(
    settings: &[(usize, Value)],
) -> (PlantConfigOf<f64, N, K, B>, PlantInput<f64, N, K>) {
    let values = Table::new(table::<N, K, B>()).values(settings);
    (values.config, values.input)
}

impl<const N: usize, const K: usize, const B: usize> Plant<N, K, B> {
    fn fill(&self, state: &PlantState<N, K, B>, values: &mut Values<N, K, B>, time_s: f64) {
        values.position_m = state.motion.position_m;
        values.velocity_m_s = state.motion.velocity_m_s;
        values.measured_position_m = state.measured.position_m;
        values.measured_current_a = state.measured.current_a;
        values.measured_theta_rad = state.measured_theta_rad;
        values.theta_rad = state.theta_rad;
        values.omega_rad_s = values.input.omega_rad_s;
        values.output = self.outputs(state, &values.input, time_s);
        values.contact = state.contact;
        if Rotor::<N, K, B>::MACHINE.tilts() {
            let at = state.at(&values.input, time_s);
            values.at_bearings = self.equations().at_bearings(&at, values.output.force_n);
        }
    }

    /// Converts the inputs over a step to the types of the equations.
    fn trajectory(values: &Values<N, K, B>, inputs: &InputTrajectory<Values<N, K, B>>) -> plant::InputTrajectory<N, K> {
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

/// The trait's methods take [`Values`]; calls without them go to the plant's own.
impl<const N: usize, const K: usize, const B: usize> Model for Plant<N, K, B>
where
    // Holds for every length in use; serde does not implement it for generic lengths.
    Values<N, K, B>: Saved,
    PlantState<N, K, B>: Saved,
{
    const INFO: Info = info(&Rotor::<N, K, B>::MACHINE.models[0]);
    type Values = Values<N, K, B>;
    type State = PlantState<N, K, B>;

    const CAPABILITIES: Capabilities =
        Capabilities::NONE.directional_derivatives().output_derivatives(2).interpolates_inputs();

    fn table() -> Vec<Row<Self::Values>> {
        table()
    }

    fn new(values: &Self::Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        Self::new(values.config.clone())
    }

    fn start(&self, values: &mut Self::Values, start_s: f64) -> Self::State {
        let mut state = self.start(start_s);
        state.open = values.open;
        values.measured_omega_rad_s = values.input.omega_rad_s;
        self.fill(&state, values, start_s);
        state
    }

    fn accepts(&self, state: &Self::State, _: &Self::Values, time_s: Option<f64>) -> Result<(), String> {
        let accepted = time_s.is_none_or(|time_s| self.accepts(state, time_s));
        accepted.then_some(()).ok_or_else(|| "the state does not belong to this time or to these parameters".into())
    }

    fn base_step_s(&self) -> f64 {
        self.config().sensor.step_s.min(self.config().max_step_s)
    }

    fn retune(&mut self, state: &mut Self::State, values: &Self::Values, _: &Resources) -> Result<(), Vec<Invalid>> {
        self.retune(&values.config)?;
        state.open = values.open;
        Ok(())
    }

    fn step(
        &self,
        state: &mut Self::State,
        values: &mut Self::Values,
        step: Step,
        inputs: &InputTrajectory<Self::Values>,
        _: &mut dyn Log,
    ) -> Result<(), StepError> {
        let samples = state.samples;
        let trajectory = Self::trajectory(values, inputs);
        let (time_s, length_s) = self.aligned(state, step);
        let outcome = self.advance(state, &trajectory, time_s, length_s);
        if state.samples != samples {
            values.measured_omega_rad_s = trajectory.at(self.sampled_s(state)).omega_rad_s;
        }
        inputs.apply(values, if outcome.is_ok() { step.end_s() } else { state.time_s });
        self.fill(state, values, step.end_s());
        outcome.map_err(StepError::of)
    }

    fn refresh(&self, state: &Self::State, values: &mut Self::Values, time_s: f64) {
        self.fill(state, values, time_s);
    }

    fn differentiate(
        &self,
        state: &Self::State,
        values: &Self::Values,
        direction: &Self::Values,
        time_s: f64,
        started: bool,
    ) -> Self::Values {
        let point = Point::of(self, state, &values.input, time_s);
        let towards = direction.config.clone();
        let mut derivatives = Self::Values::default();
        // Before the run the parameters determine the states.
        let from = |state: f64, start: f64| if started { state } else { state + start };
        derivatives.position_m = array::from_fn(|n| from(direction.position_m[n], towards.position_m[n]));
        derivatives.velocity_m_s = array::from_fn(|n| from(direction.velocity_m_s[n], towards.velocity_m_s[n]));
        derivatives.theta_rad = from(direction.theta_rad, towards.theta_rad);
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
        (derivatives.output, derivatives.at_bearings) = Self::derivatives_of(&line, 1);
        derivatives.output.linkage_wb = direction.output.linkage_wb;
        self.differentiate_first_sample(&line, direction, &mut derivatives);
        derivatives.measured_theta_rad = derivatives.theta_rad;
        derivatives.measured_omega_rad_s = direction.input.omega_rad_s;
        derivatives
    }

    fn output_derivatives(
        &self,
        state: &Self::State,
        values: &Self::Values,
        slopes: &[Self::Values; HIGHEST_ORDER],
        time_s: f64,
        order: usize,
    ) -> Self::Values {
        let point = Point::of(self, state, &values.input, time_s);
        let slopes = slopes.each_ref().map(|slopes| slopes.input.clone());
        let line = point.in_time(&slopes);
        let (output, at_bearings) = Self::derivatives_of(&line, order);
        let position_m = array::map(line.motion.position_m, |series| series.derivative(order));
        Values { position_m, output, at_bearings, ..Values::default() }
    }
}

impl<const N: usize, const K: usize, const B: usize> Plant<N, K, B> {
    /// The derivatives of the given order of all outputs.
    fn derivatives_of(line: &Point<Taylor<3>, N, K, B>, order: usize) -> (PlantOutput<f64, N, K>, [AtBearing; B]) {
        let of = |series: Taylor<3>| series.derivative(order);
        let (output, at_bearings) = line.outputs();
        (output.map(of), array::map(at_bearings, |at| at.map(of)))
    }

    /// The derivatives of the first sample, `(1 + gain error) x + offset + σ n` with the first draw n. A rounded reading is
    /// constant almost everywhere.
    fn differentiate_first_sample(
        &self,
        line: &Point<Taylor<3>, N, K, B>,
        direction: &Values<N, K, B>,
        derivatives: &mut Values<N, K, B>,
    ) {
        let (sensor, towards) = (&self.config().sensor, &direction.config.sensor);
        let Channels { position, current } = Channels::<N, K>::new(sensor.seed);
        let position_draws = position.map(|mut noise| noise.standard_normal());
        let current_draws = current.map(|mut noise| noise.standard_normal());
        let readings_m = line.config.rotor.readings(line.motion.position_m);
        derivatives.measured_position_m = array::from_fn(|n| {
            let Taylor([reading_m, slope_m, _]) = readings_m[n];
            let rotor_m = (1.0 + sensor.position_gain_error[n]) * slope_m + towards.position_gain_error[n] * reading_m;
            let error_m = towards.position_offset_m[n] + towards.position_noise_m * position_draws[n];
            if sensor.position_resolution_m == 0.0 { rotor_m + error_m } else { 0.0 }
        });
        // No current flows before the start.
        derivatives.measured_current_a = array::from_fn(|k| {
            let error_a = towards.current_offset_a[k] + towards.current_noise_a * current_draws[k];
            if sensor.current_resolution_a == 0.0 { error_a } else { 0.0 }
        });
    }

    /// Begin and length of a step, aligned with the plant's time: importers recompute the begin; beyond the plant's tolerance the
    /// step begins where the last one ended.
    fn aligned(&self, state: &PlantState<N, K, B>, step: Step) -> (f64, f64) {
        let deviation_s = (step.time_s - state.time_s).abs();
        if deviation_s <= 0.5 * INSTANT_TOLERANCE * self.config().sensor.step_s {
            return (step.time_s, step.length_s);
        }
        (state.time_s, (step.end_s() - state.time_s).max(0.0))
    }
}
