//! `MagneticBearing`: the rotor, its three magnets and their coils, unbalance, perturbation forces, backup bearing and
//! sensors.

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

use super::bearing::{DRIVE, coils, geometry, of_magnets, together};
use super::course::{Course, HIGHEST_ORDER};
use super::instance::{Capabilities, Fault, Kind, Slave, Step, all, instantiate, variables};
use super::log::Log;
use super::unit::{
    AMPERE, KILOGRAM_METRE, LAMBDA, METRE, METRE_PER_SECOND, METRE_PER_SECOND2, NEWTON, NEWTON_PER_METRE,
    NEWTON_SECOND_PER_METRE, ONE, RADIAN, RADIAN_PER_SECOND, SECOND, VOLT, WEBER,
};
use super::variable::Dependency::{Constant, Fixed};
use super::variable::{Row, Value, element, place, with};
use crate::model::Invalid;
use crate::model::coil::Drive;
use crate::model::linearisation::{Point, Taylor, along, in_time};
use crate::model::noise::Noise;
use crate::model::plant::{
    Conditions, INSTANT_TOLERANCE, InputTrajectory, Plant, PlantConfig, PlantInput, PlantOutput, PlantState,
};

/// The plant as a sort of slave.
pub static KIND: Kind = Kind {
    name: "MagneticBearing",
    description: "Rotor in a three-phase radial magnetic bearing, with unbalance, perturbation forces and sensors",
    stop_s: 0.4,
    step_s: 1e-4,
    capabilities: Bearing::CAPABILITIES,
    shelf: &TABLE,
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
    drive: i32,
    open: [bool; 3],
    contact: bool,
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

impl Values {
    /// Brings into the configuration what the interface has in another form.
    fn complete(&mut self) -> Vec<Invalid> {
        // Any integer is a seed; the bits of a negative one serve as well as others.
        self.config.sensor.seed = u64::from(self.seed.cast_unsigned());
        let mut findings = Vec::new();
        let drives = [Drive::Current, Drive::Voltage];
        DRIVE.choose("drive", self.drive, drives, &mut self.config.coil.drive, &mut findings);
        findings
    }
}

/// Configuration and inputs of a plant whose variables, by index, have the values given and else their start values.
///
/// # Errors
/// Every choice that cannot be accepted.
pub fn configuration(settings: &[(usize, Value)]) -> Result<(PlantConfig, PlantInput), Vec<Invalid>> {
    let mut values: Values = with(&TABLE, settings);
    together(values.complete(), Ok((values.config, values.input)))
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
    rows.extend(coils(
        place!(drive),
        place!(config.coil.resistance_ohm),
        place!(config.coil.leakage_h),
        place!(config.coil.limit_v),
    ));
    rows.push(
        Row::real("coil.fluxSaturation", place!(config.coil.saturation_wb), WEBER, 0.0)
            .fixed()
            .min(0.0)
            .nominal(1e-2)
            .says("Flux at which the iron needs as much current as the nominal gap; 0 for iron that does not saturate"),
    );
    rows.extend(
        Row::named_reals(["gravity.Y", "gravity.Z"], place!(config.gravity_m_s2[k]), METRE_PER_SECOND2, [0.0; 2])
            .map(|row| row.fixed().nominal(10.0).says("Acceleration of gravity along {axis}")),
    );
    rows.extend(touchdown());
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
    rows.extend(sensor_errors());
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
        Row::booleans("coil.open", place!(open[k]), [false; 3])
            .map(|row| row.tunable().says("Whether the circuit of magnet {k} is open, so that it carries no current")),
    );

    rows.extend(
        Row::reals("i", place!(input.current_a[k]), AMPERE, [0.0; 3])
            .map(|row| row.input().says("Current through magnet {k}, held over the step, with drive = current")),
    );
    rows.extend(
        Row::reals("u", place!(input.voltage_v[k]), VOLT, [0.0; 3])
            .map(|row| row.input().nominal(10.0).says("Voltage asked of amplifier {k}, with drive = voltage")),
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
                .starts_from(["0", "sensor.offset", "sensor.gainError"].map(|name| match name {
                    "0" => format!("{axis}0"),
                    name => format!("{name}{axis}"),
                }))
                .starts_from(["sensor.positionNoise", "sensor.positionResolution", "sensor.seed"])
        },
    ));
    rows.extend(Row::reals("im", place!(measured_current_a[k]), AMPERE, [0.0; 3]).enumerate().map(|(k, row)| {
        row.sampled_output()
            .says("Current through magnet {k} as the sensor read it at its last sample, with drive = current held until then")
            .starts_from(["sensor.currentNoise", "sensor.currentResolution", "sensor.seed"])
            .starts_from([element("sensor.currentOffset", k)])
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
        let own = ["lambda", "alpha", "i", "coil.open"].map(|name| element(name, k));
        row.output()
            .nominal(10.0)
            .says("Force of magnet {k} on the rotor")
            .depends_on([element("i", k), element("psi", k)])
            .depends_on(AXES)
            .starts_from(["s", "Y0", "Z0", "drive", "coil.fluxSaturation"])
            .starts_from(own)
    }));
    rows.extend(Row::named_reals(["FY", "FZ"], place!(output.resultant_n[k]), NEWTON, [0.0; 2]).map(|row| {
        row.output()
            .nominal(10.0)
            .says("Force of all magnets on the rotor along {axis}")
            .depends_on(["i", "psi"].into_iter().flat_map(of_magnets))
            .depends_on(AXES)
            .starts_from(["s", "Y0", "Z0", "drive", "coil.fluxSaturation"])
            .starts_from(["alpha", "lambda", "i", "coil.open"].into_iter().flat_map(of_magnets))
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
                    .says("All forces on the rotor beside those of magnets and backup bearing, along {axis}")
                    .depends(Constant, [["pY", "pZ"][axis]])
                    .depends_on(["omega", "rotor.theta"])
                    .starts_from(acting_on(axis))
                    .starts_from(["m", ["gravity.Y", "gravity.Z"][axis]])
            }),
    );
    rows.push(
        Row::boolean("touchdown.contact", place!(contact), false)
            .output()
            .says("Whether the rotor touches the backup bearing")
            .depends_on(MOTION)
            .starts_from(TOUCHING),
    );
    rows.extend(Row::named_reals(["touchdown.FY", "touchdown.FZ"], place!(output.contact_n[k]), NEWTON, [0.0; 2]).map(
        |row| {
            row.output()
                .nominal(1000.0)
                .says("Force of the backup bearing on the rotor along {axis}")
                .depends_on(["omega"])
                .depends_on(MOTION)
                .starts_from(["omega", "touchdown.friction", "touchdown.radius"])
                .starts_from(TOUCHING)
        },
    ));
    rows.extend(
        Row::reals("psi", place!(output.linkage_wb[k]), WEBER, [0.0; 3]).map(|row| {
            row.local().state().nominal(1e-2).says("Flux linked with coil {k}; a state with drive = voltage")
        }),
    );
    rows.extend(
        Row::reals("coil.i", place!(output.current_a[k]), AMPERE, [0.0; 3])
            .map(|row| row.local().says("Current through coil {k}")),
    );
    rows.extend(Row::reals("coil.uInduced", place!(output.induced_v[k]), VOLT, [0.0; 3]).enumerate().map(
        |(k, row)| {
            row.local()
            .nominal(10.0)
            .says("Derivative of psi[{k}], u - R i with drive = voltage; 0 with drive = current, where psi is no state")
            .derivative_of(["psi[1]", "psi[2]", "psi[3]"][k])
            .depends_on(["u", "psi"].map(|name| element(name, k)))
            .depends_on(AXES)
        },
    ));
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
                    .depends_on(["i", "psi"].into_iter().flat_map(of_magnets))
                    .depends(Fixed, [["pY", "pZ"][axis]])
                    .depends_on(["omega", "rotor.theta"])
                    .depends_on(MOTION)
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

/// Position and velocity of the rotor.
const MOTION: [&str; 4] = ["Y", "Z", "vY", "vZ"];

/// What contact with the backup bearing follows from at the start.
const TOUCHING: [&str; 7] =
    ["Y0", "Z0", "vY0", "vZ0", "touchdown.clearance", "touchdown.stiffness", "touchdown.damping"];

/// The backup bearing.
fn touchdown() -> impl Iterator<Item = Row<Values>> {
    [
        Row::real("touchdown.clearance", place!(config.touchdown.clearance_m), METRE, 2.5e-4)
            .nominal(1e-4)
            .shown_in("mm")
            .says("Distance from the centre at which the rotor touches the backup bearing"),
        Row::real("touchdown.stiffness", place!(config.touchdown.stiffness_n_m), NEWTON_PER_METRE, 5e7)
            .nominal(1e7)
            .says("Stiffness of the backup bearing"),
        Row::real("touchdown.damping", place!(config.touchdown.damping_ns_m), NEWTON_SECOND_PER_METRE, 5e3)
            .nominal(1e3)
            .says("Damping of the backup bearing"),
        Row::real("touchdown.friction", place!(config.touchdown.friction), ONE, 0.0)
            .nominal(0.1)
            .says("Coefficient of friction of the backup bearing"),
        Row::real("touchdown.radius", place!(config.touchdown.radius_m), METRE, 0.025)
            .nominal(1e-2)
            .shown_in("mm")
            .says("Radius of the rotor at the backup bearing, which friction asks for"),
    ]
    .into_iter()
    .map(|row| row.fixed().min(0.0))
}

/// Errors of the sensors beside noise.
fn sensor_errors() -> Vec<Row<Values>> {
    let mut rows = Vec::new();
    rows.push(
        Row::real("sensor.positionResolution", place!(config.sensor.position_resolution_m), METRE, 0.0)
            .min(0.0)
            .nominal(1e-7)
            .says("Ym and Zm are whole multiples of this; 0 for no rounding"),
    );
    rows.push(
        Row::real("sensor.currentResolution", place!(config.sensor.current_resolution_a), AMPERE, 0.0)
            .min(0.0)
            .nominal(1e-3)
            .says("im are whole multiples of this; 0 for no rounding"),
    );
    rows.extend(
        Row::named_reals(
            ["sensor.offsetY", "sensor.offsetZ"],
            place!(config.sensor.position_offset_m[k]),
            METRE,
            [0.0; 2],
        )
        .map(|row| row.nominal(1e-6).says("What the position sensor along {axis} reads in the centre")),
    );
    rows.extend(
        Row::named_reals(
            ["sensor.gainErrorY", "sensor.gainErrorZ"],
            place!(config.sensor.position_gain_error[k]),
            ONE,
            [0.0; 2],
        )
        .map(|row| row.nominal(0.01).min(-1.0).says("Relative error of the gain of the position sensor along {axis}")),
    );
    rows.extend(
        Row::reals("sensor.currentOffset", place!(config.sensor.current_offset_a[k]), AMPERE, [0.0; 3])
            .map(|row| row.nominal(1e-2).says("What the current sensor of magnet {k} reads without current")),
    );
    rows.extend(
        Row::reals("sensor.currentGainError", place!(config.sensor.current_gain_error[k]), ONE, [0.0; 3]).map(|row| {
            row.nominal(0.01).min(-1.0).says("Relative error of the gain of the current sensor of magnet {k}")
        }),
    );
    rows.push(
        Row::real("sensor.delay", place!(config.sensor.delay_s), SECOND, 0.0)
            .min(0.0)
            .nominal(1e-4)
            .shown_in("µs")
            .says("By how much Ym, Zm and im are late, up to 16 sample times"),
    );
    rows.into_iter().map(Row::fixed).collect()
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
        values.contact = self.state.contact;
    }

    /// The inputs over a step as the model knows them.
    fn course(values: &Values, inputs: &Course<Values>) -> InputTrajectory {
        let slopes = (!inputs.is_held()).then(|| {
            std::array::from_fn(|lower| {
                let mut slopes = Values::default();
                inputs.put_derivative(&mut slopes, lower + 1);
                slopes.input
            })
        });
        InputTrajectory { input: values.input.clone(), slopes, since_s: inputs.since_s() }
    }
}

/// The plant that the values describe.
fn plant(values: &mut Values) -> Result<Plant, Vec<Invalid>> {
    together(values.complete(), Plant::new(values.config.clone()))
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
        let mut state = plant.start(start_s);
        state.open = values.open;
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
        )?;
        self.state.open = values.open;
        Ok(())
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
        let ([y, z], [v_y, v_z]) = (derivatives.position_m, derivatives.velocity_m_s);
        let [psi_1, psi_2, psi_3] = direction.output.linkage_wb;
        let line = Point {
            config: towards.clone(),
            motion: [y, z, v_y, v_z, psi_1, psi_2, psi_3],
            input: direction.input.clone(),
            conditions: Conditions { theta_rad: derivatives.theta_rad, ..Conditions::default() },
        };
        derivatives.output = along(&point, &line).map(|series| series.derivative(1));
        derivatives.output.linkage_wb = direction.output.linkage_wb;
        self.differentiate_first_sample(values, towards, &mut derivatives);
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
        let (line, output) = in_time::<3>(&point, &slopes);
        let [y, z, ..] = line.motion;
        let derivative = |series: Taylor<3>| series.derivative(order);
        Values { position_m: [y, z].map(derivative), output: output.map(derivative), ..Values::default() }
    }
}

impl Bearing {
    /// The derivatives of the first sample: `(1 + gain error) x + offset + σ n` with the first draw n. What is rounded to a
    /// resolution stands still almost everywhere.
    fn differentiate_first_sample(&self, values: &Values, towards: &PlantConfig, derivatives: &mut Values) {
        let (sensor, towards) = (&self.plant.config().sensor, &towards.sensor);
        let draws = Noise::channels::<5>(values.config.sensor.seed).map(|mut noise| noise.standard_normal());
        derivatives.measured_position_m = std::array::from_fn(|a| {
            let rotor_m = (1.0 + sensor.position_gain_error[a]) * derivatives.position_m[a]
                + towards.position_gain_error[a] * self.state.position_m[a];
            let own_m = towards.position_offset_m[a] + towards.position_noise_m * draws[a];
            if sensor.position_resolution_m == 0.0 { rotor_m + own_m } else { 0.0 }
        });
        // No current is held before the start.
        derivatives.measured_current_a = std::array::from_fn(|k| {
            let own_a = towards.current_offset_a[k] + towards.current_noise_a * draws[2 + k];
            if sensor.current_resolution_a == 0.0 { own_a } else { 0.0 }
        });
    }

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
