//! `MagneticBearing`: the rotor, its three magnets, unbalance, perturbation forces and sensors.

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

use super::bearing::{geometry, of_magnets};
use super::course::{Course, HIGHEST_ORDER};
use super::instance::{Capabilities, Fault, Kind, Slave, Step, all, instantiate, variables};
use super::log::Log;
use super::unit::{
    AMPERE, KILOGRAM_METRE, LAMBDA, METRE, METRE_PER_SECOND, METRE_PER_SECOND2, NEWTON, RADIAN, RADIAN_PER_SECOND,
    SECOND,
};
use super::variable::Dependency::{Constant, Fixed};
use super::variable::{Row, element, place};
use crate::model::Invalid;
use crate::model::linearisation::{Jet, Point, Response, along, in_time};
use crate::model::noise::Noise;
use crate::model::plant::{INSTANT_TOLERANCE, Plant, PlantConfig, PlantCourse, PlantInput, PlantOutput, PlantState};

/// The plant as a sort of slave.
pub static KIND: Kind = Kind {
    name: "MagneticBearing",
    description: "Rotor in a three-phase radial magnetic bearing, with unbalance, perturbation forces and sensors",
    stop_s: 0.4,
    step_s: 1e-4,
    capabilities: Bearing::CAPABILITIES,
    variables: variables::<Bearing>,
    instantiate: instantiate::<Bearing>,
};

/// Speed of the paper's experiments, 3000 rpm.
const OMEGA_RAD_S: f64 = 100.0 * std::f64::consts::PI;
/// Velocity r_Z ω on the paper's reference ellipse at its start, rounded as the interface has it.
const START_VELOCITY_M_S: f64 = 0.021991148575128554;

static TABLE: LazyLock<Vec<Row<Values>>> = LazyLock::new(table);

/// The values of all variables of the plant.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Values {
    config: PlantConfig,
    seed: i32,
    input: PlantInput,
    output: PlantOutput,
    position_m: [f64; 2],
    velocity_m_s: [f64; 2],
    measured_position_m: [f64; 2],
    measured_current_a: [f64; 3],
    measured_theta_rad: f64,
    measured_omega_rad_s: f64,
    theta_rad: f64,
    omega_rad_s: f64,
}

fn table() -> Vec<Row<Values>> {
    let mut rows: Vec<Row<Values>> = Vec::new();

    rows.extend(geometry(place!(config.m_kg), place!(config.gap_m), place!(config.alpha_rad[k])));
    rows.extend(
        Row::named_reals(["Y0", "Z0"], place!(config.position_m[k]), METRE, [30e-6, 0.0])
            .map(|row| row.fixed().nominal(1e-5).says("Position of the rotor at the start, along {axis}")),
    );
    rows.extend(
        Row::named_reals(["vY0", "vZ0"], place!(config.velocity_m_s[k]), METRE_PER_SECOND, [0.0, START_VELOCITY_M_S])
            .map(|row| row.fixed().nominal(1e-2).says("Velocity of the rotor at the start, along {axis}")),
    );
    rows.push(Row::real("theta0", place!(config.theta_rad), RADIAN, 0.0).fixed().says("Rotor angle at the start"));

    rows.push(
        Row::real("sensor.positionNoise", place!(config.sensor.position_noise_m), METRE, 0.0)
            .fixed()
            .min(0.0)
            .nominal(1e-7)
            .says("Standard deviation of the noise on Ym and Zm"),
    );
    rows.push(
        Row::real("sensor.currentNoise", place!(config.sensor.current_noise_a), AMPERE, 0.0)
            .fixed()
            .min(0.0)
            .nominal(1e-2)
            .says("Standard deviation of the noise on im"),
    );
    rows.push(
        Row::real("sensor.Ts", place!(config.sensor.step_s), SECOND, 1e-4)
            .fixed()
            .min(0.0)
            .nominal(1e-4)
            .shown_in("µs")
            .says("Sample time of the sensors"),
    );
    rows.push(Row::integer("sensor.seed", place!(seed), 1).fixed().says("Seed of the noise; equal seeds, equal noise"));
    rows.push(
        Row::real("solver.maxStep", place!(config.max_step_s), SECOND, 5e-5)
            .fixed()
            .min(0.0)
            .nominal(1e-5)
            .shown_in("µs")
            .says("Upper bound of the integration step"),
    );

    rows.extend(
        Row::reals("lambda", place!(config.lambda_nm2_a2[k]), LAMBDA, [1.8e-6, 2.0e-6, 2.2e-6])
            .map(|row| row.tunable().min(0.0).nominal(1e-6).says("Force constant of magnet {k}")),
    );
    rows.push(
        Row::real("unbalance.magnitude", place!(config.unbalance_kgm), KILOGRAM_METRE, 0.0)
            .tunable()
            .min(0.0)
            .nominal(1e-4)
            .says("Unbalance of the rotor, mass times eccentricity"),
    );
    rows.push(
        Row::real("unbalance.phase", place!(config.unbalance_phase_rad), RADIAN, 0.0)
            .tunable()
            .says("Angle of the unbalance from the mark on the rotor that theta refers to"),
    );
    rows.extend(
        Row::named_reals(
            ["perturbation.amplitudeY", "perturbation.amplitudeZ"],
            place!(config.harmonic.amplitude_n[k]),
            NEWTON,
            [0.0; 2],
        )
        .map(|row| row.tunable().says("Amplitude of a harmonic perturbation force along {axis}")),
    );
    rows.push(
        Row::real("perturbation.omega", place!(config.harmonic.omega_rad_s), RADIAN_PER_SECOND, OMEGA_RAD_S)
            .tunable()
            .min(0.0)
            .nominal(100.0)
            .shown_in("Hz")
            .says("Angular frequency of the harmonic perturbation force"),
    );
    rows.extend(
        Row::named_reals(
            ["perturbation.phaseY", "perturbation.phaseZ"],
            place!(config.harmonic.phase_rad[k]),
            RADIAN,
            [0.0; 2],
        )
        .map(|row| row.tunable().says("Phase at time 0 of the harmonic perturbation force along {axis}, a sine")),
    );

    rows.extend(
        Row::reals("i", place!(input.current_a[k]), AMPERE, [0.0; 3])
            .map(|row| row.input().says("Current through magnet {k}, held over the step")),
    );
    rows.extend(
        Row::named_reals(["pY", "pZ"], place!(input.perturbation_n[k]), NEWTON, [0.0; 2])
            .map(|row| row.input().says("Perturbation force on the rotor along {axis}")),
    );
    rows.push(
        Row::real("omega", place!(input.omega_rad_s), RADIAN_PER_SECOND, OMEGA_RAD_S)
            .input()
            .nominal(100.0)
            .says("Speed of the rotor"),
    );

    rows.extend(Row::named_reals(AXES, place!(position_m[k]), METRE, [0.0; 2]).zip(AXES).map(|(row, axis)| {
        row.output()
            .nominal(1e-5)
            .says("Position of the rotor along {axis}")
            .state()
            .depends(Constant, [axis])
            .starts_from([format!("{axis}0")])
    }));
    rows.extend(Row::named_reals(["Ym", "Zm"], place!(measured_position_m[k]), METRE, [0.0; 2]).zip(AXES).map(
        |(row, axis)| {
            row.sampled_output()
                .nominal(1e-5)
                .says("Position along {axis} as the sensor read it at its last sample")
                .starts_from([format!("{axis}0"), "sensor.positionNoise".into(), "sensor.seed".into()])
        },
    ));
    rows.extend(Row::reals("im", place!(measured_current_a[k]), AMPERE, [0.0; 3]).map(|row| {
        row.sampled_output()
            .says("Current through magnet {k} at the last sample, held over the interval that ended there")
            .starts_from(["sensor.currentNoise", "sensor.seed"])
    }));
    rows.push(
        Row::real("theta", place!(measured_theta_rad), RADIAN, 0.0)
            .sampled_output()
            .says("Rotor angle at the last sample, counted on over the revolutions")
            .starts_from(["theta0"]),
    );
    rows.push(
        Row::real("omegam", place!(measured_omega_rad_s), RADIAN_PER_SECOND, 0.0)
            .sampled_output()
            .nominal(100.0)
            .says("Speed of the rotor at the last sample, held over the interval that ended there")
            .starts_from(["omega"]),
    );
    rows.extend(Row::reals("F", place!(output.force_n[k]), NEWTON, [0.0; 3]).enumerate().map(|(k, row)| {
        let own = ["lambda", "alpha", "i"].map(|name| element(name, k));
        row.output()
            .nominal(10.0)
            .says("Force of magnet {k} on the rotor")
            .depends_on([element("i", k)])
            .depends_on(AXES)
            .starts_from(["s", "Y0", "Z0"])
            .starts_from(own)
    }));
    rows.extend(Row::named_reals(["FY", "FZ"], place!(output.resultant_n[k]), NEWTON, [0.0; 2]).map(|row| {
        row.output()
            .nominal(10.0)
            .says("Force of all magnets on the rotor along {axis}")
            .depends_on(of_magnets("i"))
            .depends_on(AXES)
            .starts_from(["s", "Y0", "Z0"])
            .starts_from(["alpha", "lambda", "i"].into_iter().flat_map(of_magnets))
    }));
    rows.extend(Row::reals("gap", place!(output.gap_m[k]), METRE, [0.0; 3]).enumerate().map(|(k, row)| {
        row.output()
            .nominal(1e-4)
            .shown_in("mm")
            .says("Air gap at magnet {k}")
            .depends(Fixed, AXES)
            .starts_from(["s", "Y0", "Z0"])
            .starts_from([element("alpha", k)])
    }));
    rows.extend(
        Row::named_reals(["perturbation.Y", "perturbation.Z"], place!(output.perturbation_n[k]), NEWTON, [0.0; 2])
            .enumerate()
            .map(|(axis, row)| {
                row.output()
                    .nominal(10.0)
                    .says("All forces on the rotor beside those of the magnets, along {axis}")
                    .depends(Constant, [["pY", "pZ"][axis]])
                    .depends_on(["omega", "rotor.theta"])
                    .starts_from(acting_on(axis))
            }),
    );
    rows.extend(Row::named_reals(["vY", "vZ"], place!(velocity_m_s[k]), METRE_PER_SECOND, [0.0; 2]).zip(AXES).map(
        |(row, axis)| {
            let row = row.local().nominal(1e-2).says("Velocity of the rotor along {axis}").state();
            let own = row.variable.name.clone();
            row.derivative_of(axis).depends(Constant, [own.clone()]).starts_from([format!("{own}0")])
        },
    ));
    rows.extend(
        Row::named_reals(["aY", "aZ"], place!(output.acceleration_m_s2[k]), METRE_PER_SECOND2, [0.0; 2])
            .enumerate()
            .map(|(axis, row)| {
                row.local()
                    .says("Acceleration of the rotor along {axis}")
                    .derivative_of(["vY", "vZ"][axis])
                    .depends_on(of_magnets("i"))
                    .depends(Fixed, [["pY", "pZ"][axis]])
                    .depends_on(["omega", "Y", "Z", "rotor.theta"])
                    .starts_from(["m", "s", "Y0", "Z0"])
                    .starts_from(["alpha", "lambda", "i"].into_iter().flat_map(of_magnets))
                    .starts_from(acting_on(axis))
            }),
    );
    rows.push(
        Row::real("rotor.theta", place!(theta_rad), RADIAN, 0.0)
            .local()
            .says("Rotor angle, counted on over the revolutions")
            .state()
            .starts_from(["theta0"]),
    );
    rows.push(
        Row::real("rotor.omega", place!(omega_rad_s), RADIAN_PER_SECOND, 0.0)
            .local()
            .nominal(100.0)
            .says("Derivative of the rotor angle, equal to the input omega")
            .derivative_of("rotor.theta")
            .depends(Constant, ["omega"])
            .starts_from(["omega"]),
    );
    rows
}

/// The axes, by the names of the positions along them.
const AXES: [&str; 2] = ["Y", "Z"];

/// What the perturbation along an axis follows from at the start.
fn acting_on(axis: usize) -> [&'static str; 8] {
    let [p, amplitude, phase] = [
        ["pY", "perturbation.amplitudeY", "perturbation.phaseY"],
        ["pZ", "perturbation.amplitudeZ", "perturbation.phaseZ"],
    ][axis];
    [p, amplitude, phase, "perturbation.omega", "unbalance.magnitude", "unbalance.phase", "omega", "theta0"]
}

/// A run of the plant.
#[derive(Clone)]
pub struct Bearing {
    plant: Plant,
    state: PlantState,
}

impl Bearing {
    fn fill(&self, values: &mut Values, time_s: f64) {
        values.position_m = self.state.position_m;
        values.velocity_m_s = self.state.velocity_m_s;
        values.measured_position_m = self.state.measured.position_m;
        values.measured_current_a = self.state.measured.current_a;
        values.measured_theta_rad = self.state.measured.theta_rad;
        values.theta_rad = self.state.theta_rad;
        values.omega_rad_s = values.input.omega_rad_s;
        values.output = self.plant.outputs(&self.state, &values.input, time_s);
    }

    /// The inputs over a step as the model knows them.
    fn course(values: &Values, inputs: &Course<Values>) -> PlantCourse {
        let slopes = (!inputs.is_held()).then(|| {
            std::array::from_fn(|lower| {
                let mut slopes = Values::default();
                inputs.put_derivative(&mut slopes, lower + 1);
                slopes.input
            })
        });
        PlantCourse { input: values.input.clone(), slopes, since_s: inputs.since_s() }
    }
}

/// The plant that the values describe. Any integer is a seed; the bits of a negative one serve as well as others.
fn plant(values: &mut Values) -> Result<Plant, Vec<Invalid>> {
    values.config.sensor.seed = u64::from(values.seed.cast_unsigned());
    Plant::new(values.config.clone())
}

/// Puts the part of a response that `pick` takes into the places of the outputs.
fn put<const N: usize>(values: &mut Values, response: &Response<Jet<N>>, pick: impl Fn(Jet<N>) -> f64) {
    values.output.gap_m = response.gap_m.map(&pick);
    values.output.force_n = response.force_n.map(&pick);
    values.output.resultant_n = response.resultant_n.map(&pick);
    values.output.perturbation_n = response.perturbation_n.map(&pick);
    values.output.acceleration_m_s2 = response.acceleration_m_s2.map(&pick);
}

impl Slave for Bearing {
    type Values = Values;
    type State = PlantState;

    const CAPABILITIES: Capabilities = Capabilities { directional_derivatives: true, output_derivative_order: 2 };

    fn table() -> &'static [Row<Values>] {
        &TABLE
    }

    fn start(values: &mut Values, start_s: f64) -> Result<Self, Vec<Invalid>> {
        let plant = plant(values)?;
        let state = plant.start(start_s);
        let run = Self { plant, state };
        values.measured_omega_rad_s = values.input.omega_rad_s;
        run.fill(values, start_s);
        Ok(run)
    }

    fn state(&self) -> PlantState {
        self.state.clone()
    }

    fn resume(values: &mut Values, state: PlantState, time_s: Option<f64>) -> Result<Self, String> {
        let plant = plant(values).map_err(|findings| all(&findings))?;
        if time_s.is_some_and(|time_s| !plant.accepts(&state, time_s)) {
            return Err("the state of the rotor does not belong to the time or to the parameters".into());
        }
        Ok(Self { plant, state })
    }

    fn grain_s(&self) -> f64 {
        self.plant.grain_s()
    }

    fn retune(&mut self, values: &Values) -> Result<(), Vec<Invalid>> {
        let config = &values.config;
        self.plant.retune(
            config.lambda_nm2_a2,
            config.unbalance_kgm,
            config.unbalance_phase_rad,
            config.harmonic.clone(),
        )
    }

    fn step(&mut self, values: &mut Values, step: Step, inputs: &Course<Values>, _: &mut dyn Log) -> Result<(), Fault> {
        let samples = self.state.samples;
        let course = Self::course(values, inputs);
        let (time_s, length_s) = self.where_it_stands(step);
        let outcome = self.plant.advance_along(&mut self.state, &course, time_s, length_s);
        if self.state.samples != samples {
            values.measured_omega_rad_s = course.at(self.plant.sampled_s(&self.state)).omega_rad_s;
        }
        inputs.put(values, if outcome.is_ok() { step.end_s() } else { self.state.time_s });
        self.fill(values, step.end_s());
        outcome.map_err(Fault::of)
    }

    fn refresh(&self, values: &mut Values, time_s: f64) {
        self.fill(values, time_s);
    }

    fn differentiate(&self, values: &Values, direction: &Values, time_s: f64, started: bool) -> Values {
        let point = Point::of(&self.plant, &self.state, &values.input, time_s);
        let towards = &direction.config;
        let mut derivatives = Values::default();
        // Before the run the states are where the parameters put them.
        let from = |state: f64, start: f64| if started { state } else { state + start };
        derivatives.position_m = std::array::from_fn(|a| from(direction.position_m[a], towards.position_m[a]));
        derivatives.velocity_m_s = std::array::from_fn(|a| from(direction.velocity_m_s[a], towards.velocity_m_s[a]));
        derivatives.theta_rad = from(direction.theta_rad, towards.theta_rad);
        derivatives.omega_rad_s = direction.input.omega_rad_s;
        let line = Point {
            m_kg: towards.m_kg,
            gap_m: towards.gap_m,
            alpha_rad: towards.alpha_rad,
            lambda_nm2_a2: towards.lambda_nm2_a2,
            unbalance_kgm: towards.unbalance_kgm,
            unbalance_phase_rad: towards.unbalance_phase_rad,
            amplitude_n: towards.harmonic.amplitude_n,
            harmonic_omega_rad_s: towards.harmonic.omega_rad_s,
            harmonic_phase_rad: towards.harmonic.phase_rad,
            position_m: derivatives.position_m,
            velocity_m_s: derivatives.velocity_m_s,
            theta_rad: derivatives.theta_rad,
            current_a: direction.input.current_a,
            perturbation_n: direction.input.perturbation_n,
            omega_rad_s: direction.input.omega_rad_s,
            time_s: 0.0,
        };
        put(&mut derivatives, &along(&point, &line), |jet| jet.0[1]);
        // The first sample: y + σ n with the first draw n.
        let draws = Noise::channels::<5>(values.config.sensor.seed).map(|mut noise| noise.standard_normal());
        let sigma = &towards.sensor;
        derivatives.measured_position_m =
            std::array::from_fn(|a| derivatives.position_m[a] + sigma.position_noise_m * draws[a]);
        derivatives.measured_current_a = std::array::from_fn(|k| sigma.current_noise_a * draws[2 + k]);
        derivatives.measured_theta_rad = derivatives.theta_rad;
        derivatives.measured_omega_rad_s = direction.input.omega_rad_s;
        derivatives
    }

    fn output_derivatives(
        &self,
        values: &Values,
        slopes: &[Values; HIGHEST_ORDER],
        time_s: f64,
        order: usize,
    ) -> Values {
        let point = Point::of(&self.plant, &self.state, &values.input, time_s);
        let slopes = slopes.each_ref().map(|slopes| slopes.input.clone());
        let (motion, response) = in_time::<3>(&point, &slopes);
        let position_m = motion.position_m.map(|jet| jet.derivative(order));
        let mut derivatives = Values { position_m, ..Values::default() };
        put(&mut derivatives, &response, |jet| jet.derivative(order));
        derivatives
    }
}

impl Bearing {
    /// Begin and length of a step as the plant knows them: importers compute the begin anew, and where the plant's own
    /// tolerance is narrower than theirs, the step begins where the last one ended.
    fn where_it_stands(&self, step: Step) -> (f64, f64) {
        let beside_s = (step.time_s - self.state.time_s).abs();
        if beside_s <= 0.5 * INSTANT_TOLERANCE * self.plant.config().sensor.step_s {
            return (step.time_s, step.length_s);
        }
        (self.state.time_s, (step.end_s() - self.state.time_s).max(0.0))
    }
}
