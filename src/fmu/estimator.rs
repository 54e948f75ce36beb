//! `AlgebraicEstimator`: the force constants from positions and currents, on line.

use fmu_export::log::{Digits, Log, Topic};
use fmu_export::unit::{
    AMPERE, KILOGRAM, METRE, NEWTON, NEWTON_PER_AMPERE, NEWTON_PER_METRE, ONE, RADIAN, RADIAN_PER_SECOND, SECOND,
};
use fmu_export::variable::{Access, Enumeration, Row, Table, Value};
use fmu_export::{Info, Invalid, Resources, SampledModel, StepError, place};
use serde::{Deserialize, Serialize};

use super::common::{Axes, geometry, info, lambda0, sample_time, sampled, together};
use crate::estimation::{
    Estimator, EstimatorConfig, EstimatorInput, EstimatorOutput, EstimatorState, Hold, Method, Verdict,
};
use crate::machine::PLANAR;
use crate::variables::{KILOGRAM_METRE, LAMBDA};

/// How the force constants are computed.
pub static METHOD: Enumeration = Enumeration::new(
    "EstimationMethod",
    "How the force constants are computed",
    &[
        ("paperLiteral", "Filtered signed determinants, equation (20) to the letter; diverges"),
        ("paper", "Equation (20) with the sign of the determinant aligned; z axis only"),
        ("predictionError", "Prediction errors and instrumental variables; unbalance and noise identified as well"),
    ],
);

/// Why an estimate is valid or not.
pub static VERDICT: Enumeration = Enumeration::new(
    "Verdict",
    "Why an estimate is valid or not",
    &[
        ("valid", "All tests pass"),
        ("collecting", "Not enough samples yet"),
        ("disabled", "The input enable is false"),
        ("badSample", "A sample is not finite, or outside the gap"),
        ("contact", "The rotor is in contact"),
        ("stuck", "A position sensor reads the same all the time"),
        ("changed", "The latest samples contradict the earlier ones; what they told is discarded"),
        ("singular", "The excitation does not determine all unknowns"),
        ("notPositive", "A force constant came out zero or negative"),
        ("unexplained", "The model does not explain the motion"),
        ("coloured", "The innovations are not white"),
        (
            "noisy",
            "There is too much noise to be estimated from the data: set sensor.positionNoise and sensor.currentNoise",
        ),
        ("unsteady", "The estimate has changed several times"),
        ("uncertain", "The standard deviation is too large"),
        ("foreignState", "The state belongs to an estimator with other parameters"),
        ("speed", "The input omega is not the speed of theta in rad/s"),
    ],
);

/// What a sample of a current stands for.
pub static HOLD: Enumeration = Enumeration::new(
    "CurrentHold",
    "What a sample of a current stands for",
    &[
        ("heldBefore", "The current held over the interval that ends at the sample"),
        ("heldAfter", "The current held over the interval that begins at the sample"),
        ("linear", "A point of a continuous current"),
    ],
);

/// Noise of the sensors, and how well the rest is known: σ_z, σ_i, then the tolerances in the order of [`Tolerance`](crate::estimation::Tolerance).
pub(super) fn known<D>(positions: &str, places: [Access<D, f64>; 10]) -> impl Iterator<Item = Row<D>> {
    let rows = [
        (
            "sensor.positionNoise",
            METRE,
            1e-7,
            "Standard deviation of the noise of {positions}; 0 to estimate it from the data",
        ),
        ("sensor.currentNoise", AMPERE, 1e-2, "Standard deviation of the noise of im; 0 to estimate it from the data"),
        ("tolerance.m", KILOGRAM, 0.1, "Standard deviation of m; 0 means exactly known"),
        ("tolerance.s", METRE, 1e-5, "Standard deviation of s; 0 means exactly known"),
        ("tolerance.alpha", RADIAN, 1e-2, "Standard deviation of each alpha; 0 means exactly known"),
        ("tolerance.positionGain", ONE, 1e-2, "Relative standard deviation of the gains of {positions}; 0 means exact"),
        ("tolerance.positionOffset", METRE, 1e-5, "Standard deviation of the offsets of {positions}; 0 means none"),
        ("tolerance.currentGain", ONE, 1e-2, "Relative standard deviation of the gain of each im; 0 means exact"),
        ("tolerance.currentOffset", AMPERE, 1e-2, "Standard deviation of the offset of each im; 0 means none"),
        (
            "tolerance.backwardForce",
            NEWTON,
            1.0,
            "Standard deviation of a force of constant magnitude that turns against the rotor, estimated with the rest; 0 means there is none",
        ),
    ];
    rows.into_iter().zip(places).map(move |((name, unit, nominal, description), place)| {
        let start = if name == "tolerance.backwardForce" { 2.0 } else { 0.0 };
        let row = Row::real(name, place, unit, start).fixed().min(0.0).nominal(nominal);
        row.description(description.replace("{positions}", positions))
    })
}

/// The number of a verdict in the interface, and the verdict of a number.
pub(super) fn number_of(verdict: Verdict) -> i32 {
    verdict as i32 + 1
}

/// The verdict of a number in the interface.
pub(super) fn verdict_of(number: i32) -> Verdict {
    let at = usize::try_from(number).ok().and_then(|number| number.checked_sub(1));
    at.and_then(|at| Verdict::ALL.get(at)).map(|(verdict, _)| *verdict).unwrap_or_default()
}

/// The values of all variables of the estimator.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Values {
    config: EstimatorConfig,
    method: i32,
    hold: i32,
    input: EstimatorInput,
    output: EstimatorOutput,
}

fn table() -> Vec<Row<Values>> {
    let mut rows: Vec<Row<Values>> = Vec::new();

    rows.extend(geometry(place!(Values.config.m_kg), place!(Values.config.gap_m), place!(Values.config.alpha_rad[k])));
    rows.push(sample_time(place!(Values.config.step_s)));
    rows.extend(lambda0(place!(Values.config.lambda0_nm2_a2[k])));
    rows.push(
        Row::choice("method", place!(Values.method), &METHOD, 3)
            .fixed()
            .description("How the force constants are computed"),
    );
    rows.push(
        Row::choice("hold", place!(Values.hold), &HOLD, 1).fixed().description("What a sample of a current stands for"),
    );
    rows.push(
        Row::boolean("identify.unbalance", place!(Values.config.identify_unbalance), true)
            .fixed()
            .description("Whether to identify an unbalance as well"),
    );
    rows.extend(known(
        "Ym and Zm",
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
    rows.push(
        Row::real("Tf", place!(Values.config.window_s), SECOND, 0.02).fixed().min(0.0).nominal(1e-2).description(
            "Length of the window of the paper's methods, a whole multiple of Ts; one revolution is a good choice",
        ),
    );
    rows.push(
        Row::real("epsilon", place!(Values.config.epsilon_s), SECOND, 0.02)
            .fixed()
            .min(0.0)
            .nominal(1e-2)
            .description("Time during which the paper's methods return the first guess, counted in usable samples since the start or the last reset"),
    );
    rows.push(
        Row::real("filter.omega", place!(Values.config.filter_omega_rad_s), RADIAN_PER_SECOND, 15.0)
            .fixed()
            .min(0.0)
            .nominal(10.0)
            .display_unit("Hz")
            .description("Natural frequency of the low-pass filter of the paper's methods"),
    );
    rows.push(
        Row::real("filter.zeta", place!(Values.config.filter_zeta), ONE, 0.707)
            .fixed()
            .min(0.0)
            .description("Damping ratio of the low-pass filter of the paper's methods"),
    );

    rows.extend(
        Row::named_reals(["Ym", "Zm"], place!(Values.input.position_m[k]), METRE, [0.0; 2])
            .map(|row| row.input().nominal(1e-5).along("Measured position of the rotor along {axis}")),
    );
    rows.extend(
        Row::reals("im", place!(Values.input.current_a[k]), AMPERE, [0.0; 3])
            .map(|row| row.input().description("Measured current through magnet {k}")),
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
    rows.push(
        Row::boolean("enable", place!(Values.input.enable), true).input().description("Whether to use the samples"),
    );
    rows.push(
        Row::boolean("contact", place!(Values.input.contact), false)
            .input()
            .description("Whether the rotor touches the backup bearing, so that samples cannot be used"),
    );
    rows.push(
        Row::boolean("reset", place!(Values.input.reset), false)
            .input()
            .description("A rising edge restarts the estimation"),
    );

    rows.extend(
        Row::reals("lambdaHat", place!(Values.output.lambda_hat[k]), LAMBDA, [0.0; 3])
            .map(|row| row.sampled_output().nominal(1e-6).description("Estimated force constant of magnet {k}")),
    );
    rows.extend(Row::reals("lambdaRaw", place!(Values.output.lambda_raw[k]), LAMBDA, [0.0; 3]).map(|row| {
        row.sampled_output().nominal(1e-6).description("Force constant of magnet {k} from the last revolution alone")
    }));
    rows.extend(Row::reals("lambdaStd", place!(Values.output.lambda_std[k]), LAMBDA, [0.0; 3]).map(|row| {
        row.sampled_output()
            .min(0.0)
            .nominal(1e-8)
            .description("Standard deviation of the force constant of magnet {k} due to noise alone")
    }));
    rows.extend(Row::reals("lambdaStdTotal", place!(Values.output.lambda_std_total[k]), LAMBDA, [0.0; 3]).map(|row| {
        row.sampled_output()
            .min(0.0)
            .nominal(1e-8)
            .description("Standard deviation of the force constant of magnet {k} due to noise and tolerances")
    }));
    rows.extend(Row::reals("ki", place!(Values.output.ki[k]), NEWTON_PER_AMPERE, [0.0; 3]).map(|row| {
        row.sampled_output().nominal(10.0).description("Force per current of magnet {k}, mean over the last revolution")
    }));
    rows.extend(Row::reals("ks", place!(Values.output.ks[k]), NEWTON_PER_METRE, [0.0; 3]).map(|row| {
        row.sampled_output().nominal(1e5).description("Negative stiffness of magnet {k}, mean over the last revolution")
    }));
    let ki_std = Access {
        get: |Values { output, .. }: &Values, k| {
            stiffness_std(output.ki[k], output.lambda_std_total[k], output.lambda_hat[k])
        },
        set: |_, _, _| (),
    };
    rows.extend(Row::reals("kiStd", ki_std, NEWTON_PER_AMPERE, [0.0; 3]).map(|row| {
        row.sampled_output().nominal(0.1).description("Standard deviation of ki[{k}] due to noise and tolerances")
    }));
    let ks_std = Access {
        get: |Values { output, .. }: &Values, k| {
            stiffness_std(output.ks[k], output.lambda_std_total[k], output.lambda_hat[k])
        },
        set: |_, _, _| (),
    };
    rows.extend(Row::reals("ksStd", ks_std, NEWTON_PER_METRE, [0.0; 3]).map(|row| {
        row.sampled_output().nominal(1e3).description("Standard deviation of ks[{k}] due to noise and tolerances")
    }));
    for (name, place, unit, nominal, description) in [
        (
            "noise.position",
            place!(Values.output.position_noise_m),
            METRE,
            1e-7,
            "Standard deviation of the noise of Ym and Zm, given or estimated",
        ),
        (
            "noise.current",
            place!(Values.output.current_noise_a),
            AMPERE,
            1e-2,
            "Standard deviation of the noise of im, given or estimated",
        ),
    ] {
        rows.push(
            Row::real(name, place, unit, 0.0).sampled_output().min(0.0).nominal(nominal).description(description),
        );
    }
    rows.push(
        Row::boolean("valid", place!(Values.output.valid), false)
            .sampled_output()
            .description("Whether the estimate is valid; if not, lambdaHat is the last valid one"),
    );
    let verdict = Access {
        get: |values: &Values, _| number_of(values.output.verdict),
        set: |values: &mut Values, _, number| values.output.verdict = verdict_of(number),
    };
    rows.push(
        Row::choice("verdict", verdict, &VERDICT, 2).sampled_output().description("Why the estimate is valid or not"),
    );
    rows.push(
        Row::real("condition", place!(Values.output.condition), ONE, 0.0)
            .sampled_output()
            .min(0.0)
            .nominal(10.0)
            .description("Condition number of the information matrix scaled to unit diagonal"),
    );
    rows.push(
        Row::real("residual", place!(Values.output.residual), ONE, 0.0)
            .sampled_output()
            .min(0.0)
            .description("Normalised innovation squared, 1 if model and noise are correct; with the paper's methods: fraction of the motion left unexplained"),
    );
    rows.extend(
        Row::named_reals(["pYHat", "pZHat"], place!(Values.output.load_n[k]), NEWTON, [0.0; 2])
            .map(|row| row.sampled_output().nominal(10.0).along("Static load on the rotor along {axis}")),
    );
    rows.push(
        Row::real("unbalance.magnitude", place!(Values.output.unbalance_kg_m), KILOGRAM_METRE, 0.0)
            .sampled_output()
            .min(0.0)
            .nominal(1e-4)
            .description("Identified unbalance, mass times eccentricity; 0 if none is identified"),
    );
    rows.push(
        Row::real("unbalance.phase", place!(Values.output.unbalance_phase_rad), RADIAN, 0.0)
            .sampled_output()
            .description("Identified angle of the unbalance from the mark on the rotor that theta refers to"),
    );
    rows.push(
        Row::real("backwardForce.magnitude", place!(Values.output.backward_force_n), NEWTON, 0.0)
            .sampled_output()
            .min(0.0)
            .description("Identified force that turns against the rotor; 0 if there is none"),
    );
    rows.push(
        Row::real("backwardForce.phase", place!(Values.output.backward_force_phase_rad), RADIAN, 0.0)
            .sampled_output()
            .description("Identified phase phi of that force B (cos(theta + phi), -sin(theta + phi)) in the y-z plane"),
    );
    rows
}

/// Standard deviation of ki or ks, which are as uncertain as λ; 0 before the first sample.
pub(super) fn stiffness_std(stiffness: f64, lambda_std: f64, lambda: f64) -> f64 {
    if lambda > 0.0 { stiffness * lambda_std / lambda } else { 0.0 }
}

impl Values {
    /// The configuration, converted from the types of the interface.
    fn config(&self) -> (EstimatorConfig, Vec<Invalid>) {
        let mut config = self.config.clone();
        let mut findings = Vec::new();
        let methods = [Method::PaperLiteral, Method::Paper, Method::PredictionError];
        METHOD.choose("method", self.method, methods, &mut config.method, &mut findings);
        let holds = [Hold::HeldBefore, Hold::HeldAfter, Hold::Linear];
        HOLD.choose("hold", self.hold, holds, &mut config.hold, &mut findings);
        (config, findings)
    }
}

/// The configuration of an estimator with the given values by index, and start values elsewhere.
///
/// # Errors
/// Every value that is not an item of its enumeration.
pub fn configuration(settings: &[(usize, Value)]) -> Result<EstimatorConfig, Vec<Invalid>> {
    let (config, findings) = Table::new(table()).values(settings).config();
    together(findings, Ok(config))
}

/// Reports a verdict that has changed.
pub(super) fn log_verdict(log: &mut dyn Log, instant_s: f64, former: Verdict, verdict: Verdict) {
    let topic = if verdict == Verdict::Singular { Topic::SingularLinearSystem } else { Topic::Event };
    if former != verdict && log.wants(topic) {
        log.message(topic, format_args!("at {} s the estimate is {verdict}", Digits::<9>(instant_s)));
    }
}

/// The estimator.
#[derive(Clone)]
pub struct AlgebraicEstimator(Estimator);

impl SampledModel for AlgebraicEstimator {
    const INFO: Info =
        info("AlgebraicEstimator", "On-line estimator of the force constants of a three-phase magnetic bearing");
    type Values = Values;
    type State = EstimatorState;

    fn table() -> Vec<Row<Values>> {
        sampled(table(), &PLANAR)
    }

    fn new(values: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        let (config, findings) = values.config();
        together(findings, Estimator::new(config)).map(Self)
    }

    fn period_s(&self) -> f64 {
        self.0.config().step_s
    }

    fn start(&self, values: &mut Values, _: f64) -> EstimatorState {
        let state = self.0.start();
        values.output = state.output().clone();
        state
    }

    fn sample(
        &self,
        state: &mut EstimatorState,
        values: &mut Values,
        instant_s: f64,
        log: &mut dyn Log,
    ) -> Result<(), StepError> {
        let former = values.output.verdict;
        values.output = self.0.sample(state, &values.input);
        log_verdict(log, instant_s, former, values.output.verdict);
        Ok(())
    }

    fn accepts(&self, state: &EstimatorState) -> Result<(), String> {
        self.0.accepts(state).then_some(()).ok_or_else(|| "the state does not belong to these parameters".into())
    }
}
