//! `SpindleEstimator`: the force constants of a spindle's eight magnets and its unbalance in two planes, on line.

use fmu_export::log::Log;
use fmu_export::unit::{
    AMPERE, KILOGRAM_METRE2, METRE, NEWTON, NEWTON_METRE, NEWTON_PER_AMPERE, NEWTON_PER_METRE, ONE, RADIAN,
    RADIAN_PER_SECOND,
};
use fmu_export::variable::{Access, Row, Table, Value};
use fmu_export::{Info, Invalid, Resources, SampledModel, StepError, place};
use serde::{Deserialize, Serialize};

use super::common::{HasGeometry, MEASURED, OfMagnet, geometry, lambda0, of_coordinates, of_magnets};
use crate::bearing::spindle::{MAGNETS, READINGS, SpindleGeometry};
use crate::estimation::Hold;
use crate::estimation::spindle::{
    self, SpindleEstimatorConfig, SpindleEstimatorInput, SpindleEstimatorOutput, SpindleEstimatorState,
};
use crate::fmu::common::{info, sample_time, sampled, together};
use crate::fmu::estimator::{HOLD, VERDICT, known, log_verdict, number_of, stiffness_std, verdict_of};
use crate::machine::SPINDLE;
use crate::variables::{KILOGRAM_METRE, LAMBDA};

/// The values of all variables of the estimator.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Values {
    config: SpindleEstimatorConfig,
    hold: i32,
    input: SpindleEstimatorInput,
    output: SpindleEstimatorOutput,
}

impl HasGeometry for Values {
    fn geometry(&self) -> &SpindleGeometry {
        &self.config.geometry
    }

    fn geometry_mut(&mut self) -> &mut SpindleGeometry {
        &mut self.config.geometry
    }
}

fn table() -> Vec<Row<Values>> {
    let mut rows: Vec<Row<Values>> = geometry().collect();
    rows.push(sample_time(place!(Values.config.step_s)));
    rows.extend(lambda0(place!(Values.config.lambda0_nm2_a2[k])));
    rows.push(
        Row::choice("hold", place!(Values.hold), &HOLD, 1).fixed().description("What a sample of a current stands for"),
    );
    rows.push(
        Row::boolean("identify.unbalance", place!(Values.config.identify_unbalance), true)
            .fixed()
            .description("Whether to identify an unbalance in two planes as well"),
    );
    let of_planes = |name: &str| [1, 2].map(|plane| format!("unbalance[{plane}].{name}"));
    let position = place!(Values.config.unbalance_position_m[k]);
    rows.extend(Row::named_reals(of_planes("position"), position, METRE, [-0.08, 0.10]).map(|row| {
        row.fixed()
            .nominal(0.1)
            .description("Position of plane {k} of the unbalance along the shaft, from the centre of gravity")
    }));
    rows.extend(known(
        "the positions",
        [
            place!(Values.config.position_noise_m),
            place!(Values.config.current_noise_a),
            place!(Values.config.tolerance.m_kg),
            place!(Values.config.tolerance.gap_m),
            place!(Values.config.tolerance.alpha_rad),
            place!(Values.config.tolerance.position_gain),
            place!(Values.config.tolerance.position_offset_m),
            place!(Values.config.tolerance.current_gain),
            place!(Values.config.tolerance.current_offset_a),
            place!(Values.config.tolerance.backward_force_n),
        ],
    ));
    for (name, place, unit, nominal, description) in [
        ("Jt", place!(Values.config.shaft_tolerance.transverse_kgm2), KILOGRAM_METRE2, 1e-3, "Jt"),
        ("Jp", place!(Values.config.shaft_tolerance.polar_kgm2), KILOGRAM_METRE2, 1e-3, "Jp"),
        (
            "position",
            place!(Values.config.shaft_tolerance.position_m),
            METRE,
            1e-3,
            "the positions of A and B along the shaft",
        ),
        (
            "sensorPosition",
            place!(Values.config.shaft_tolerance.sensor_position_m),
            METRE,
            1e-3,
            "the positions of their sensors along the shaft",
        ),
        (
            "unbalancePosition",
            place!(Values.config.shaft_tolerance.unbalance_position_m),
            METRE,
            1e-3,
            "the positions of the planes of unbalance",
        ),
    ] {
        rows.push(
            Row::real(format!("tolerance.{name}"), place, unit, 0.0)
                .fixed()
                .min(0.0)
                .nominal(nominal)
                .description(format!("Standard deviation of {description}; 0 means exactly known")),
        );
    }

    rows.extend(Row::named_reals(MEASURED, place!(Values.input.reading_m[k]), METRE, [0.0; READINGS]).map(|row| {
        let (axis, place) = [("y", "A"), ("z", "A"), ("y", "B"), ("z", "B"), ("x", "X")][row.index()];
        row.input().nominal(1e-5).description(format!("Measured position along {axis} at the sensors of {place}"))
    }));
    rows.extend(
        Row::named_reals(of_magnets("im"), place!(Values.input.current_a[k]), AMPERE, [0.0; MAGNETS])
            .map(|row| row.input().of_magnet("Measured current through {magnet}")),
    );
    rows.push(
        Row::real("theta", place!(Values.input.theta_rad), RADIAN, 0.0)
            .input()
            .description("Rotor angle, wrapped or unwrapped; needed to identify an unbalance"),
    );
    rows.push(
        Row::real("omega", place!(Values.input.omega_rad_s), RADIAN_PER_SECOND, 100.0 * std::f64::consts::PI)
            .input()
            .nominal(100.0)
            .description("Speed of the rotor"),
    );
    for (name, place, start, description) in [
        ("enable", place!(Values.input.enable), true, "Whether to use the samples"),
        (
            "contact",
            place!(Values.input.contact),
            false,
            "Whether the rotor touches a backup bearing, so that samples cannot be used",
        ),
        ("reset", place!(Values.input.reset), false, "A rising edge restarts the estimation"),
    ] {
        rows.push(Row::boolean(name, place, start).input().description(description));
    }
    outputs(&mut rows);
    rows
}

fn outputs(rows: &mut Vec<Row<Values>>) {
    for (name, place, unit, nominal, description) in [
        ("lambdaHat", place!(Values.output.lambda_hat[k]), LAMBDA, 1e-6, "Estimated force constant of {magnet}"),
        (
            "lambdaRaw",
            place!(Values.output.lambda_raw[k]),
            LAMBDA,
            1e-6,
            "Force constant of {magnet} from the last revolution alone",
        ),
        (
            "lambdaStd",
            place!(Values.output.lambda_std[k]),
            LAMBDA,
            1e-8,
            "Standard deviation of the force constant of {magnet} due to noise alone",
        ),
        (
            "lambdaStdTotal",
            place!(Values.output.lambda_std_total[k]),
            LAMBDA,
            1e-8,
            "Standard deviation of the force constant of {magnet} due to noise and tolerances",
        ),
        (
            "ki",
            place!(Values.output.ki[k]),
            NEWTON_PER_AMPERE,
            10.0,
            "Force per current of {magnet}, mean over the last revolution",
        ),
        (
            "ks",
            place!(Values.output.ks[k]),
            NEWTON_PER_METRE,
            1e5,
            "Negative stiffness of {magnet}, mean over the last revolution",
        ),
        (
            "kiStd",
            Access {
                get: |Values { output, .. }: &Values, k| {
                    stiffness_std(output.ki[k], output.lambda_std_total[k], output.lambda_hat[k])
                },
                set: |_, _, _| (),
            },
            NEWTON_PER_AMPERE,
            0.1,
            "Standard deviation of ki of {magnet} due to noise and tolerances",
        ),
        (
            "ksStd",
            Access {
                get: |Values { output, .. }: &Values, k| {
                    stiffness_std(output.ks[k], output.lambda_std_total[k], output.lambda_hat[k])
                },
                set: |_, _, _| (),
            },
            NEWTON_PER_METRE,
            1e3,
            "Standard deviation of ks of {magnet} due to noise and tolerances",
        ),
    ] {
        rows.extend(Row::named_reals(of_magnets(name), place, unit, [0.0; MAGNETS]).map(|row| {
            let row = row.sampled_output().nominal(nominal).of_magnet(description);
            if name.starts_with("lambdaStd") { row.min(0.0) } else { row }
        }));
    }
    let noise = |name: &str| [format!("noise.{name}"), format!("X.noise.{name}")];
    for (names, place, unit, nominal, description) in [
        (
            noise("position"),
            place!(Values.output.position_noise_m[k]),
            METRE,
            1e-7,
            [
                "Standard deviation of the noise of the radial positions, given or estimated",
                "Standard deviation of the noise of Xm, given or estimated",
            ],
        ),
        (
            noise("current"),
            place!(Values.output.current_noise_a[k]),
            AMPERE,
            1e-2,
            [
                "Standard deviation of the noise of im of A and B, given or estimated",
                "Standard deviation of the noise of im of X, given or estimated",
            ],
        ),
    ] {
        rows.extend(Row::named_reals(names, place, unit, [0.0; 2]).map(|row| {
            let text = description[row.index()];
            row.sampled_output().min(0.0).nominal(nominal).description(text)
        }));
    }
    rows.push(
        Row::boolean("valid", place!(Values.output.valid), false)
            .sampled_output()
            .description("Whether all estimates are valid; of those that are not, the last valid one is shown"),
    );
    let verdict = Access {
        get: |values: &Values, _| number_of(values.output.verdict),
        set: |values: &mut Values, _, number| values.output.verdict = verdict_of(number),
    };
    let axial = Access {
        get: |values: &Values, _| number_of(values.output.axial_verdict),
        set: |values: &mut Values, _, number| values.output.axial_verdict = verdict_of(number),
    };
    for (name, access, description) in [
        ("verdict", verdict, "Why the estimates are valid or not: of A and B, or, if they are valid, of X"),
        ("X.verdict", axial, "Why the estimate of the axial magnets is valid or not"),
    ] {
        rows.push(Row::choice(name, access, &VERDICT, 2).sampled_output().description(description));
    }
    rows.push(
        Row::real("condition", place!(Values.output.condition), ONE, 0.0)
            .sampled_output()
            .min(0.0)
            .nominal(10.0)
            .description("Condition number of the information matrix scaled to unit diagonal, the greater of the radial and of the axial one"),
    );
    rows.push(
        Row::real("residual", place!(Values.output.residual), ONE, 0.0).sampled_output().min(0.0).description(
            "Normalised innovation squared, 1 if model and noise are correct, the greater of the radial and of the axial one",
        ),
    );
    let load = place!(Values.output.load[k]);
    rows.extend(of_coordinates(["pXHat", "pYHat", "pZHat", "MYHat", "MZHat"], load, [NEWTON, NEWTON_METRE]).map(
        |(n, row)| {
            let (nominal, what) = if n < 3 { (10.0, "load along") } else { (1.0, "moment about") };
            let axis = ["x", "y", "z", "y", "z"][n];
            row.sampled_output().nominal(nominal).description(format!("Static {what} {axis}"))
        },
    ));
    let of_planes = |name: &str| [1, 2].map(|plane| format!("unbalance[{plane}].{name}"));
    rows.extend(
        Row::named_reals(of_planes("magnitude"), place!(Values.output.unbalance_kg_m[k]), KILOGRAM_METRE, [0.0; 2])
            .map(|row| {
                row.sampled_output()
                    .min(0.0)
                    .nominal(1e-4)
                    .description("Identified unbalance in plane {k}, mass times eccentricity; 0 if none is identified")
            }),
    );
    rows.extend(
        Row::named_reals(of_planes("phase"), place!(Values.output.unbalance_phase_rad[k]), RADIAN, [0.0; 2]).map(
            |row| {
                row.sampled_output().description(
                    "Identified angle of the unbalance in plane {k} from the mark on the rotor that theta refers to",
                )
            },
        ),
    );
    let of_bearings = |name: &str| ["A", "B"].map(|bearing| format!("{bearing}.backwardForce.{name}"));
    for (name, place, unit, description) in [
        (
            "magnitude",
            place!(Values.output.backward_force_n[k]),
            NEWTON,
            "Identified force at this bearing that turns against the rotor; 0 if there is none",
        ),
        (
            "phase",
            place!(Values.output.backward_force_phase_rad[k]),
            RADIAN,
            "Identified phase phi of that force B (cos(theta + phi), -sin(theta + phi)) in the y-z plane",
        ),
    ] {
        rows.extend(Row::named_reals(of_bearings(name), place, unit, [0.0; 2]).map(|row| {
            let row = row.sampled_output().description(description);
            if name == "magnitude" { row.min(0.0) } else { row }
        }));
    }
}

impl Values {
    /// The configuration, converted from the types of the interface.
    fn config(&self) -> (SpindleEstimatorConfig, Vec<Invalid>) {
        let mut config = self.config.clone();
        let mut findings = Vec::new();
        let holds = [Hold::HeldBefore, Hold::HeldAfter, Hold::Linear];
        HOLD.choose("hold", self.hold, holds, &mut config.hold, &mut findings);
        (config, findings)
    }
}

/// The configuration of an estimator with the given values by index, and start values elsewhere.
///
/// # Errors
/// Every value that is not an item of its enumeration.
pub fn configuration(settings: &[(usize, Value)]) -> Result<SpindleEstimatorConfig, Vec<Invalid>> {
    let (config, findings) = Table::new(table()).values(settings).config();
    together(findings, Ok(config))
}

/// The estimator.
#[derive(Clone)]
pub struct SpindleEstimator(spindle::SpindleEstimator);

impl SampledModel for SpindleEstimator {
    const INFO: Info = info(
        "SpindleEstimator",
        "On-line estimator of the force constants and the two-plane unbalance of a spindle in magnetic bearings",
    );
    type Values = Values;
    type State = SpindleEstimatorState;

    fn table() -> Vec<Row<Values>> {
        sampled(table(), &SPINDLE)
    }

    fn new(values: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        let (config, findings) = values.config();
        together(findings, spindle::SpindleEstimator::new(config)).map(Self)
    }

    fn period_s(&self) -> f64 {
        self.0.config().step_s
    }

    fn start(&self, values: &mut Values, _: f64) -> SpindleEstimatorState {
        let state = self.0.start();
        values.output = state.output().clone();
        state
    }

    fn sample(
        &self,
        state: &mut SpindleEstimatorState,
        values: &mut Values,
        instant_s: f64,
        log: &mut dyn Log,
    ) -> Result<(), StepError> {
        let former = values.output.verdict;
        values.output = self.0.sample(state, &values.input);
        log_verdict(log, instant_s, former, values.output.verdict);
        Ok(())
    }

    fn accepts(&self, state: &SpindleEstimatorState) -> Result<(), String> {
        self.0.accepts(state).then_some(()).ok_or_else(|| "the state does not belong to these parameters".into())
    }
}
