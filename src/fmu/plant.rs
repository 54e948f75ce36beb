//! `MagneticBearing`: the rotor, its three magnets and their coils, unbalance, perturbation forces, backup bearing and
//! sensors.

use fmu_export::input::{HIGHEST_ORDER, InputTrajectory};
use fmu_export::log::Log;
use fmu_export::unit::{
    AMPERE, METRE, METRE_PER_SECOND, METRE_PER_SECOND2, NEWTON, NEWTON_PER_METRE, NEWTON_SECOND_PER_METRE, ONE, RADIAN,
    RADIAN_PER_SECOND, SECOND, VOLT, WEBER,
};
use fmu_export::variable::Dependency::{Constant, Fixed};
use fmu_export::variable::{Row, Table, Value, element};
use fmu_export::{Capabilities, Info, Invalid, Model, Step, StepError, place};
use serde::{Deserialize, Serialize};

use super::common::{Axes, DRIVE, KILOGRAM_METRE, LAMBDA, coils, geometry, info, of_magnets, together};
use crate::bearing::coil::Drive;
use crate::plant::linearisation::{Point, Taylor};
use crate::plant::sensor::Channels;
use crate::plant::{
    self, Conditions, INSTANT_TOLERANCE, Motion, Plant, PlantConfig, PlantInput, PlantOutput, PlantState,
};

/// Speed of the paper's experiments, 3000 rpm.
const OMEGA_RAD_S: f64 = 100.0 * std::f64::consts::PI;
/// Velocity r_Z ω at the start of the paper's reference ellipse, rounded as in the interface.
const START_VELOCITY_M_S: f64 = 0.021991148575128554;

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
    /// The configuration, converted from the types of the interface.
    fn config(&self) -> (PlantConfig, Vec<Invalid>) {
        let mut config = self.config.clone();
        // Any integer is a seed, negative ones included.
        config.sensor.seed = u64::from(self.seed.cast_unsigned());
        let mut findings = Vec::new();
        let drives = [Drive::Current, Drive::Voltage];
        DRIVE.choose("drive", self.drive, drives, &mut config.coil.drive, &mut findings);
        (config, findings)
    }
}

/// Configuration and inputs of a plant with the given values by index, and start values elsewhere.
///
/// # Errors
/// Every value that is not an item of its enumeration.
pub fn configuration(settings: &[(usize, Value)]) -> Result<(PlantConfig, PlantInput), Vec<Invalid>> {
    let values = Table::new(table()).values(settings);
    let (config, findings) = values.config();
    together(findings, Ok((config, values.input)))
}

fn table() -> Vec<Row<Values>> {
    let mut rows: Vec<Row<Values>> = Vec::new();

    rows.extend(geometry(place!(Values.config.m_kg), place!(Values.config.gap_m), place!(Values.config.alpha_rad[k])));
    rows.extend(
        Row::named_reals(["Y0", "Z0"], place!(Values.config.position_m[k]), METRE, [30e-6, 0.0])
            .map(|row| row.fixed().nominal(1e-5).along("Initial position of the rotor along {axis}")),
    );
    rows.extend(
        Row::named_reals(
            ["vY0", "vZ0"],
            place!(Values.config.velocity_m_s[k]),
            METRE_PER_SECOND,
            [0.0, START_VELOCITY_M_S],
        )
        .map(|row| row.fixed().nominal(1e-2).along("Initial velocity of the rotor along {axis}")),
    );
    rows.extend(coils(
        place!(Values.drive),
        place!(Values.config.coil.resistance_ohm),
        place!(Values.config.coil.leakage_h),
        place!(Values.config.coil.limit_v),
    ));
    rows.push(
        Row::real("coil.fluxSaturation", place!(Values.config.coil.saturation_wb), WEBER, 0.0)
            .fixed()
            .min(0.0)
            .nominal(1e-2)
            .description(
                "Flux at which the iron takes as much current as the nominal gap; 0 for iron that does not saturate",
            ),
    );
    rows.extend(
        Row::named_reals(
            ["gravity.Y", "gravity.Z"],
            place!(Values.config.gravity_m_s2[k]),
            METRE_PER_SECOND2,
            [0.0; 2],
        )
        .map(|row| row.fixed().nominal(10.0).along("Acceleration of gravity along {axis}")),
    );
    rows.extend(touchdown());
    rows.push(
        Row::real("theta0", place!(Values.config.theta_rad), RADIAN, 0.0).fixed().description("Initial rotor angle"),
    );

    rows.push(
        Row::real("sensor.positionNoise", place!(Values.config.sensor.position_noise_m), METRE, 0.0)
            .fixed()
            .min(0.0)
            .nominal(1e-7)
            .description("Standard deviation of the noise on Ym and Zm"),
    );
    rows.push(
        Row::real("sensor.currentNoise", place!(Values.config.sensor.current_noise_a), AMPERE, 0.0)
            .fixed()
            .min(0.0)
            .nominal(1e-2)
            .description("Standard deviation of the noise on im"),
    );
    rows.extend(sensor_errors());
    rows.push(
        Row::real("sensor.Ts", place!(Values.config.sensor.step_s), SECOND, 1e-4)
            .fixed()
            .min(0.0)
            .nominal(1e-4)
            .display_unit("µs")
            .description("Sample time of the sensors"),
    );
    rows.push(
        Row::integer("sensor.seed", place!(Values.seed), 1)
            .fixed()
            .description("Seed of the noise; equal seeds give equal noise"),
    );
    rows.push(
        Row::real("solver.maxStep", place!(Values.config.max_step_s), SECOND, 5e-5)
            .fixed()
            .min(0.0)
            .nominal(1e-5)
            .display_unit("µs")
            .description("Upper bound of the integration step"),
    );

    rows.extend(
        Row::reals("lambda", place!(Values.config.lambda_nm2_a2[k]), LAMBDA, [1.8e-6, 2.0e-6, 2.2e-6])
            .map(|row| row.tunable().min(0.0).nominal(1e-6).description("Force constant of magnet {k}")),
    );
    rows.push(
        Row::real("unbalance.magnitude", place!(Values.config.unbalance_kgm), KILOGRAM_METRE, 0.0)
            .tunable()
            .min(0.0)
            .nominal(1e-4)
            .description("Unbalance of the rotor, mass times eccentricity"),
    );
    rows.push(
        Row::real("unbalance.phase", place!(Values.config.unbalance_phase_rad), RADIAN, 0.0)
            .tunable()
            .description("Angle of the unbalance from the mark on the rotor that theta refers to"),
    );
    rows.extend(
        Row::named_reals(
            ["perturbation.amplitudeY", "perturbation.amplitudeZ"],
            place!(Values.config.harmonic.amplitude_n[k]),
            NEWTON,
            [0.0; 2],
        )
        .map(|row| row.tunable().along("Amplitude of a harmonic perturbation force along {axis}")),
    );
    rows.push(
        Row::real("perturbation.omega", place!(Values.config.harmonic.omega_rad_s), RADIAN_PER_SECOND, OMEGA_RAD_S)
            .tunable()
            .min(0.0)
            .nominal(100.0)
            .display_unit("Hz")
            .description("Angular frequency of the harmonic perturbation force"),
    );
    rows.extend(
        Row::named_reals(
            ["perturbation.phaseY", "perturbation.phaseZ"],
            place!(Values.config.harmonic.phase_rad[k]),
            RADIAN,
            [0.0; 2],
        )
        .map(|row| {
            row.tunable().along("Phase at time 0 of the harmonic perturbation force along {axis}, which is a sine")
        }),
    );

    rows.extend(Row::booleans("coil.open", place!(Values.open[k]), [false; 3]).map(|row| {
        row.tunable().description("Whether the circuit of magnet {k} is open, so that it carries no current")
    }));

    rows.extend(
        Row::reals("i", place!(Values.input.current_a[k]), AMPERE, [0.0; 3])
            .map(|row| row.input().description("Current through magnet {k}, held over the step, with drive = current")),
    );
    rows.extend(
        Row::reals("u", place!(Values.input.voltage_v[k]), VOLT, [0.0; 3])
            .map(|row| row.input().nominal(10.0).description("Voltage command of amplifier {k}, with drive = voltage")),
    );
    rows.extend(
        Row::named_reals(["pY", "pZ"], place!(Values.input.perturbation_n[k]), NEWTON, [0.0; 2])
            .map(|row| row.input().along("Perturbation force on the rotor along {axis}")),
    );
    rows.push(
        Row::real("omega", place!(Values.input.omega_rad_s), RADIAN_PER_SECOND, OMEGA_RAD_S)
            .input()
            .nominal(100.0)
            .description("Speed of the rotor"),
    );

    rows.extend(Row::named_reals(AXES, place!(Values.position_m[k]), METRE, [0.0; 2]).zip(AXES).map(|(row, axis)| {
        row.output()
            .nominal(1e-5)
            .along("Position of the rotor along {axis}")
            .state()
            .depends(Constant, [axis])
            .starts_from([format!("{axis}0")])
    }));
    rows.extend(Row::named_reals(["Ym", "Zm"], place!(Values.measured_position_m[k]), METRE, [0.0; 2]).zip(AXES).map(
        |(row, axis)| {
            row.sampled_output()
                .nominal(1e-5)
                .along("Position along {axis} as read by the sensor at the last sample")
                .starts_from(["0", "sensor.offset", "sensor.gainError"].map(|name| match name {
                    "0" => format!("{axis}0"),
                    name => format!("{name}{axis}"),
                }))
                .starts_from(["sensor.positionNoise", "sensor.positionResolution", "sensor.seed"])
        },
    ));
    rows.extend(Row::reals("im", place!(Values.measured_current_a[k]), AMPERE, [0.0; 3]).enumerate().map(|(k, row)| {
        row.sampled_output()
            .description("Current through magnet {k} as read by the sensor at the last sample; with drive = current the one held until then")
            .starts_from(["sensor.currentNoise", "sensor.currentResolution", "sensor.seed"])
            .starts_from([element("sensor.currentOffset", k)])
    }));
    rows.push(
        Row::real("theta", place!(Values.measured_theta_rad), RADIAN, 0.0)
            .sampled_output()
            .description("Unwrapped rotor angle at the last sample")
            .starts_from(["theta0"]),
    );
    rows.push(
        Row::real("omegam", place!(Values.measured_omega_rad_s), RADIAN_PER_SECOND, 0.0)
            .sampled_output()
            .nominal(100.0)
            .description("Speed of the rotor at the last sample, held over the interval that ends there")
            .starts_from(["omega"]),
    );
    rows.extend(Row::reals("F", place!(Values.output.force_n[k]), NEWTON, [0.0; 3]).enumerate().map(|(k, row)| {
        let own = ["lambda", "alpha", "i", "coil.open"].map(|name| element(name, k));
        row.output()
            .nominal(10.0)
            .description("Force of magnet {k} on the rotor")
            .depends_on([element("i", k), element("psi", k)])
            .depends_on(AXES)
            .starts_from(["s", "Y0", "Z0", "drive", "coil.fluxSaturation"])
            .starts_from(own)
    }));
    rows.extend(Row::named_reals(["FY", "FZ"], place!(Values.output.resultant_n[k]), NEWTON, [0.0; 2]).map(|row| {
        row.output()
            .nominal(10.0)
            .along("Force of all magnets on the rotor along {axis}")
            .depends_on(["i", "psi"].into_iter().flat_map(of_magnets))
            .depends_on(AXES)
            .starts_from(["s", "Y0", "Z0", "drive", "coil.fluxSaturation"])
            .starts_from(["alpha", "lambda", "i", "coil.open"].into_iter().flat_map(of_magnets))
    }));
    rows.extend(Row::reals("gap", place!(Values.output.gap_m[k]), METRE, [0.0; 3]).enumerate().map(|(k, row)| {
        row.output()
            .nominal(1e-4)
            .display_unit("mm")
            .description("Air gap at magnet {k}")
            .depends(Fixed, AXES)
            .starts_from(["s", "Y0", "Z0"])
            .starts_from([element("alpha", k)])
    }));
    rows.extend(
        Row::named_reals(
            ["perturbation.Y", "perturbation.Z"],
            place!(Values.output.perturbation_n[k]),
            NEWTON,
            [0.0; 2],
        )
        .enumerate()
        .map(|(axis, row)| {
            row.output()
                .nominal(10.0)
                .along("All forces on the rotor except those of magnets and backup bearing, along {axis}")
                .depends(Constant, [["pY", "pZ"][axis]])
                .depends_on(["omega", "rotor.theta"])
                .starts_from(acting_on(axis))
                .starts_from(["m", ["gravity.Y", "gravity.Z"][axis]])
        }),
    );
    rows.push(
        Row::boolean("touchdown.contact", place!(Values.contact), false)
            .output()
            .description("Whether the rotor touches the backup bearing")
            .depends_on(MOTION)
            .starts_from(TOUCHING),
    );
    rows.extend(
        Row::named_reals(["touchdown.FY", "touchdown.FZ"], place!(Values.output.contact_n[k]), NEWTON, [0.0; 2]).map(
            |row| {
                row.output()
                    .nominal(1000.0)
                    .along("Force of the backup bearing on the rotor along {axis}")
                    .depends_on(["omega"])
                    .depends_on(MOTION)
                    .starts_from(["omega", "touchdown.friction", "touchdown.radius"])
                    .starts_from(TOUCHING)
            },
        ),
    );
    rows.extend(Row::reals("psi", place!(Values.output.linkage_wb[k]), WEBER, [0.0; 3]).map(|row| {
        row.local().state().nominal(1e-2).description("Flux linked with coil {k}; a state with drive = voltage")
    }));
    rows.extend(
        Row::reals("coil.i", place!(Values.output.current_a[k]), AMPERE, [0.0; 3])
            .map(|row| row.local().description("Current through coil {k}")),
    );
    rows.extend(Row::reals("coil.uInduced", place!(Values.output.induced_v[k]), VOLT, [0.0; 3]).enumerate().map(
        |(k, row)| {
            row.local()
            .nominal(10.0)
            .description("Derivative of psi[{k}], u - R i with drive = voltage; 0 with drive = current, where psi is no state")
            .derivative_of(["psi[1]", "psi[2]", "psi[3]"][k])
            .depends_on(["u", "psi"].map(|name| element(name, k)))
            .depends_on(AXES)
        },
    ));
    rows.extend(
        Row::named_reals(["vY", "vZ"], place!(Values.velocity_m_s[k]), METRE_PER_SECOND, [0.0; 2]).zip(AXES).map(
            |(row, axis)| {
                let row = row.local().nominal(1e-2).along("Velocity of the rotor along {axis}").state();
                let own = row.variable.name.clone();
                row.derivative_of(axis).depends(Constant, [own.clone()]).starts_from([format!("{own}0")])
            },
        ),
    );
    rows.extend(
        Row::named_reals(["aY", "aZ"], place!(Values.output.acceleration_m_s2[k]), METRE_PER_SECOND2, [0.0; 2])
            .enumerate()
            .map(|(axis, row)| {
                row.local()
                    .along("Acceleration of the rotor along {axis}")
                    .derivative_of(["vY", "vZ"][axis])
                    .depends_on(["i", "psi"].into_iter().flat_map(of_magnets))
                    .depends(Fixed, [["pY", "pZ"][axis]])
                    .depends_on(["omega", "rotor.theta"])
                    .depends_on(MOTION)
            }),
    );
    rows.push(
        Row::real("rotor.theta", place!(Values.theta_rad), RADIAN, 0.0)
            .local()
            .description("Unwrapped rotor angle")
            .state()
            .starts_from(["theta0"]),
    );
    rows.push(
        Row::real("rotor.omega", place!(Values.omega_rad_s), RADIAN_PER_SECOND, 0.0)
            .local()
            .nominal(100.0)
            .description("Derivative of the rotor angle, equal to the input omega")
            .derivative_of("rotor.theta")
            .depends(Constant, ["omega"])
            .starts_from(["omega"]),
    );
    rows
}

/// The axes, by the names of the positions.
const AXES: [&str; 2] = ["Y", "Z"];

/// What the perturbation along an axis depends on at the start.
fn acting_on(axis: usize) -> [&'static str; 8] {
    let [p, amplitude, phase] = [
        ["pY", "perturbation.amplitudeY", "perturbation.phaseY"],
        ["pZ", "perturbation.amplitudeZ", "perturbation.phaseZ"],
    ][axis];
    [p, amplitude, phase, "perturbation.omega", "unbalance.magnitude", "unbalance.phase", "omega", "theta0"]
}

/// Position and velocity of the rotor.
const MOTION: [&str; 4] = ["Y", "Z", "vY", "vZ"];

/// What contact with the backup bearing depends on at the start.
const TOUCHING: [&str; 7] =
    ["Y0", "Z0", "vY0", "vZ0", "touchdown.clearance", "touchdown.stiffness", "touchdown.damping"];

/// The backup bearing.
fn touchdown() -> impl Iterator<Item = Row<Values>> {
    [
        Row::real("touchdown.clearance", place!(Values.config.touchdown.clearance_m), METRE, 2.5e-4)
            .nominal(1e-4)
            .display_unit("mm")
            .description("Distance from the centre at which the rotor touches the backup bearing"),
        Row::real("touchdown.stiffness", place!(Values.config.touchdown.stiffness_n_m), NEWTON_PER_METRE, 5e7)
            .nominal(1e7)
            .description("Stiffness of the backup bearing"),
        Row::real("touchdown.damping", place!(Values.config.touchdown.damping_ns_m), NEWTON_SECOND_PER_METRE, 5e3)
            .nominal(1e3)
            .description("Damping of the backup bearing"),
        Row::real("touchdown.friction", place!(Values.config.touchdown.friction), ONE, 0.0)
            .nominal(0.1)
            .description("Coefficient of friction of the backup bearing"),
        Row::real("touchdown.radius", place!(Values.config.touchdown.radius_m), METRE, 0.025)
            .nominal(1e-2)
            .display_unit("mm")
            .description("Radius of the rotor at the backup bearing, used by friction"),
    ]
    .into_iter()
    .map(|row| row.fixed().min(0.0))
}

/// Sensor errors other than noise.
fn sensor_errors() -> Vec<Row<Values>> {
    let mut rows = Vec::new();
    rows.push(
        Row::real("sensor.positionResolution", place!(Values.config.sensor.position_resolution_m), METRE, 0.0)
            .min(0.0)
            .nominal(1e-7)
            .description("Resolution of Ym and Zm; 0 for no rounding"),
    );
    rows.push(
        Row::real("sensor.currentResolution", place!(Values.config.sensor.current_resolution_a), AMPERE, 0.0)
            .min(0.0)
            .nominal(1e-3)
            .description("Resolution of im; 0 for no rounding"),
    );
    rows.extend(
        Row::named_reals(
            ["sensor.offsetY", "sensor.offsetZ"],
            place!(Values.config.sensor.position_offset_m[k]),
            METRE,
            [0.0; 2],
        )
        .map(|row| {
            row.nominal(1e-6)
                .along("Offset of the position sensor along {axis}: its reading with the rotor in the centre")
        }),
    );
    rows.extend(
        Row::named_reals(
            ["sensor.gainErrorY", "sensor.gainErrorZ"],
            place!(Values.config.sensor.position_gain_error[k]),
            ONE,
            [0.0; 2],
        )
        .map(|row| row.nominal(0.01).min(-1.0).along("Relative gain error of the position sensor along {axis}")),
    );
    rows.extend(
        Row::reals("sensor.currentOffset", place!(Values.config.sensor.current_offset_a[k]), AMPERE, [0.0; 3]).map(
            |row| {
                row.nominal(1e-2).description("Offset of the current sensor of magnet {k}: its reading without current")
            },
        ),
    );
    rows.extend(
        Row::reals("sensor.currentGainError", place!(Values.config.sensor.current_gain_error[k]), ONE, [0.0; 3]).map(
            |row| row.nominal(0.01).min(-1.0).description("Relative gain error of the current sensor of magnet {k}"),
        ),
    );
    rows.push(
        Row::real("sensor.delay", place!(Values.config.sensor.delay_s), SECOND, 0.0)
            .min(0.0)
            .nominal(1e-4)
            .display_unit("µs")
            .description("Delay of Ym, Zm and im, up to 16 sample times"),
    );
    rows.into_iter().map(Row::fixed).collect()
}

/// The plant.
#[derive(Clone)]
pub struct MagneticBearing(Plant);

impl MagneticBearing {
    fn fill(&self, state: &PlantState, values: &mut Values, time_s: f64) {
        values.position_m = state.position_m;
        values.velocity_m_s = state.velocity_m_s;
        values.measured_position_m = state.measured.position_m;
        values.measured_current_a = state.measured.current_a;
        values.measured_theta_rad = state.measured.theta_rad;
        values.theta_rad = state.theta_rad;
        values.omega_rad_s = values.input.omega_rad_s;
        values.output = self.0.outputs(state, &values.input, time_s);
        values.contact = state.contact;
    }

    /// The inputs over a step in the form of the equations.
    fn trajectory(values: &Values, inputs: &InputTrajectory<Values>) -> plant::InputTrajectory {
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

impl Model for MagneticBearing {
    const INFO: Info = info(
        "MagneticBearing",
        "Rotor in a three-phase radial magnetic bearing, with unbalance, perturbation forces and sensors",
    );
    type Values = Values;
    type State = PlantState;

    const CAPABILITIES: Capabilities = Capabilities { directional_derivatives: true, output_derivative_order: 2 };

    fn table() -> Vec<Row<Values>> {
        table()
    }

    fn new(values: &Values) -> Result<Self, Vec<Invalid>> {
        let (config, findings) = values.config();
        together(findings, Plant::new(config)).map(Self)
    }

    fn start(&self, values: &mut Values, start_s: f64) -> PlantState {
        let mut state = self.0.start(start_s);
        state.open = values.open;
        values.measured_omega_rad_s = values.input.omega_rad_s;
        self.fill(&state, values, start_s);
        state
    }

    fn accepts(&self, state: &PlantState, _: &Values, time_s: Option<f64>) -> Result<(), String> {
        if time_s.is_some_and(|time_s| !self.0.accepts(state, time_s)) {
            return Err("the state does not belong to this time or to these parameters".into());
        }
        Ok(())
    }

    fn base_step_s(&self) -> f64 {
        self.0.base_step_s()
    }

    fn retune(&mut self, state: &mut PlantState, values: &Values) -> Result<(), Vec<Invalid>> {
        let config = &values.config;
        let tuned = self.0.retune(
            config.lambda_nm2_a2,
            config.unbalance_kgm,
            config.unbalance_phase_rad,
            config.harmonic.clone(),
        );
        together(Vec::new(), tuned)?;
        state.open = values.open;
        Ok(())
    }

    fn step(
        &self,
        state: &mut PlantState,
        values: &mut Values,
        step: Step,
        inputs: &InputTrajectory<Values>,
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

    fn refresh(&self, state: &PlantState, values: &mut Values, time_s: f64) {
        self.fill(state, values, time_s);
    }

    fn differentiate(
        &self,
        state: &PlantState,
        values: &Values,
        direction: &Values,
        time_s: f64,
        started: bool,
    ) -> Values {
        let point = Point::of(&self.0, state, &values.input, time_s);
        let towards = &direction.config;
        let mut derivatives = Values::default();
        // Before the run the states are given by the parameters.
        let from = |state: f64, start: f64| if started { state } else { state + start };
        derivatives.position_m = std::array::from_fn(|a| from(direction.position_m[a], towards.position_m[a]));
        derivatives.velocity_m_s = std::array::from_fn(|a| from(direction.velocity_m_s[a], towards.velocity_m_s[a]));
        derivatives.theta_rad = from(direction.theta_rad, towards.theta_rad);
        derivatives.omega_rad_s = direction.input.omega_rad_s;
        let line = Point {
            config: towards.clone(),
            motion: Motion {
                position_m: derivatives.position_m,
                velocity_m_s: derivatives.velocity_m_s,
                linkage_wb: direction.output.linkage_wb,
            },
            input: direction.input.clone(),
            conditions: Conditions { theta_rad: derivatives.theta_rad, ..Conditions::default() },
        };
        derivatives.output = point.along(&line).outputs().map(|series| series.derivative(1));
        derivatives.output.linkage_wb = direction.output.linkage_wb;
        self.differentiate_first_sample(state, towards, &mut derivatives);
        derivatives.measured_theta_rad = derivatives.theta_rad;
        derivatives.measured_omega_rad_s = direction.input.omega_rad_s;
        derivatives
    }

    fn output_derivatives(
        &self,
        state: &PlantState,
        values: &Values,
        slopes: &[Values; HIGHEST_ORDER],
        time_s: f64,
        order: usize,
    ) -> Values {
        let point = Point::of(&self.0, state, &values.input, time_s);
        let slopes = slopes.each_ref().map(|slopes| slopes.input.clone());
        let line = point.in_time(&slopes);
        let output = line.outputs();
        let derivative = |series: Taylor<3>| series.derivative(order);
        Values {
            position_m: line.motion.position_m.map(derivative),
            output: output.map(derivative),
            ..Values::default()
        }
    }
}

impl MagneticBearing {
    /// The derivatives of the first sample: `(1 + gain error) x + offset + σ n` with the first draw n. A rounded reading is
    /// constant almost everywhere.
    fn differentiate_first_sample(&self, state: &PlantState, towards: &PlantConfig, derivatives: &mut Values) {
        let (sensor, towards) = (&self.0.config().sensor, &towards.sensor);
        let Channels { position, current } = Channels::<2, 3>::new(sensor.seed);
        let position_draws = position.map(|mut noise| noise.standard_normal());
        let current_draws = current.map(|mut noise| noise.standard_normal());
        derivatives.measured_position_m = std::array::from_fn(|a| {
            let rotor_m = (1.0 + sensor.position_gain_error[a]) * derivatives.position_m[a]
                + towards.position_gain_error[a] * state.position_m[a];
            let own_m = towards.position_offset_m[a] + towards.position_noise_m * position_draws[a];
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
    fn where_it_stands(&self, state: &PlantState, step: Step) -> (f64, f64) {
        let beside_s = (step.time_s - state.time_s).abs();
        if beside_s <= 0.5 * INSTANT_TOLERANCE * self.0.config().sensor.step_s {
            return (step.time_s, step.length_s);
        }
        (state.time_s, (step.end_s() - state.time_s).max(0.0))
    }
}
