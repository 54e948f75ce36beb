//! `AlgebraicEstimator`: the force constants from positions and currents, on line.

use std::sync::{Arc, LazyLock};

use serde::{Deserialize, Serialize};

use super::bearing::{geometry, lambda0, sample_time, together};
use super::clock::Clock;
use super::course::Course;
use super::instance::{Fault, Kind, Slave, Step, all, instantiate, variables};
use super::log::{Digits, Log, Topic};
use super::unit::{
    AMPERE, KILOGRAM, KILOGRAM_METRE, LAMBDA, METRE, NEWTON, NEWTON_PER_AMPERE, NEWTON_PER_METRE, ONE, RADIAN,
    RADIAN_PER_SECOND, SECOND,
};
use super::variable::{Access, Enumeration, Row, Value, place, with};
use crate::model::Invalid;
use crate::model::estimation::{
    Estimator, EstimatorConfig, EstimatorInput, EstimatorOutput, EstimatorState, Hold, Method, Verdict,
};

/// The estimator as a sort of slave.
pub static KIND: Kind = Kind {
    name: "AlgebraicEstimator",
    description: "On-line estimator of the force constants of a three-phase magnetic bearing",
    stop_s: 0.4,
    step_s: 1e-4,
    capabilities: Estimation::CAPABILITIES,
    shelf: &TABLE,
    variables: variables::<Estimation>,
    instantiate: instantiate::<Estimation>,
};

/// How the force constants are computed.
pub static METHOD: Enumeration = Enumeration {
    name: "EstimationMethod",
    description: "How the force constants are computed",
    items: &[
        ("paperLiteral", "Filtered signed determinants, equation (20) to the letter; diverges"),
        ("paper", "Equation (20) with the sign of the determinant aligned; z axis only"),
        ("predictionError", "Prediction errors and instrumental variables; unbalance and noise identified as well"),
    ],
    renamed: &[("leastSquares", "predictionError"), ("unbalance", "predictionError")],
};

/// Why an estimate is valid or not.
pub static VERDICT: Enumeration = Enumeration {
    name: "Verdict",
    description: "Why an estimate is valid or not",
    items: &[
        ("valid", "The estimate can be relied on"),
        ("collecting", "Too few samples so far"),
        ("disabled", "The input enable is false"),
        ("badSample", "A sample is not finite, or outside the gap"),
        ("contact", "The rotor is in contact"),
        ("stuck", "A position sensor reads the same all the time"),
        ("changed", "The latest revolution contradicts those before; estimation begins anew"),
        ("singular", "The excitation does not tell the unknowns apart"),
        ("notPositive", "A force constant came out zero or negative"),
        ("unexplained", "The model does not explain the motion"),
        ("coloured", "The innovations are not white"),
        ("noisy", "There is more noise than can be found from the data: tell it"),
        ("unsteady", "The estimate has contradicted itself several times"),
        ("uncertain", "The standard deviation is too large"),
        ("foreignState", "The state was made by an estimator with other parameters"),
    ],
    renamed: &[],
};

/// What a sample of a current stands for.
pub static HOLD: Enumeration = Enumeration {
    name: "CurrentHold",
    description: "What a sample of a current stands for",
    items: &[
        ("heldBefore", "The current held over the interval that ends at the sample"),
        ("heldAfter", "The current held over the interval that begins at the sample"),
        ("linear", "A point of a continuous current"),
    ],
    renamed: &[],
};

static TABLE: LazyLock<Vec<Row<Values>>> = LazyLock::new(table);

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

    rows.extend(geometry(place!(config.m_kg), place!(config.gap_m), place!(config.alpha_rad[k])));
    rows.push(sample_time(place!(config.step_s)));
    rows.extend(lambda0(place!(config.lambda0_nm2_a2[k])));
    rows.push(Row::choice("method", place!(method), &METHOD, 3).fixed().says("How the force constants are computed"));
    rows.push(Row::choice("hold", place!(hold), &HOLD, 1).fixed().says("What a sample of a current stands for"));
    rows.push(
        Row::boolean("identify.unbalance", place!(config.identify_unbalance), true)
            .fixed()
            .says("Whether the rotor may have an unbalance, which is then identified as well"),
    );
    for (name, place, unit, nominal, description) in [
        (
            "sensor.positionNoise",
            place!(config.position_noise_m),
            METRE,
            1e-7,
            "Standard deviation of the noise of Ym and Zm; 0 finds it from the data",
        ),
        (
            "sensor.currentNoise",
            place!(config.current_noise_a),
            AMPERE,
            1e-2,
            "Standard deviation of the noise of im; 0 finds it from the data",
        ),
        ("tolerance.m", place!(config.tolerance.m_kg), KILOGRAM, 0.1, "Standard deviation of m; 0 means exactly known"),
        ("tolerance.s", place!(config.tolerance.gap_m), METRE, 1e-5, "Standard deviation of s; 0 means exactly known"),
        (
            "tolerance.alpha",
            place!(config.tolerance.alpha_rad),
            RADIAN,
            1e-2,
            "Standard deviation of each alpha; 0 means exactly known",
        ),
        (
            "tolerance.positionGain",
            place!(config.tolerance.position_gain),
            ONE,
            1e-2,
            "Relative standard deviation of the gains of Ym and Zm; 0 means exact",
        ),
        (
            "tolerance.positionOffset",
            place!(config.tolerance.position_offset_m),
            METRE,
            1e-5,
            "Standard deviation of the offsets of Ym and Zm; 0 means none",
        ),
        (
            "tolerance.currentGain",
            place!(config.tolerance.current_gain),
            ONE,
            1e-2,
            "Relative standard deviation of the gain of each im; 0 means exact",
        ),
        (
            "tolerance.currentOffset",
            place!(config.tolerance.current_offset_a),
            AMPERE,
            1e-2,
            "Standard deviation of the offset of each im; 0 means none",
        ),
    ] {
        rows.push(Row::real(name, place, unit, 0.0).fixed().min(0.0).nominal(nominal).says(description));
    }
    rows.push(
        Row::real("Tf", place!(config.window_s), SECOND, 0.02).fixed().min(0.0).nominal(1e-2).says(
            "Length of the window of the paper's methods, a whole multiple of Ts; one revolution is a good choice",
        ),
    );
    rows.push(Row::real("epsilon", place!(config.epsilon_s), SECOND, 0.02).fixed().min(0.0).nominal(1e-2).says(
        "How long the paper's methods give the first guess: counted in usable samples from the start or the last reset",
    ));
    rows.push(
        Row::real("filter.omega", place!(config.filter_omega_rad_s), RADIAN_PER_SECOND, 15.0)
            .fixed()
            .min(0.0)
            .nominal(10.0)
            .shown_in("Hz")
            .says("Natural frequency of the low-pass filter of the paper's methods"),
    );
    rows.push(
        Row::real("filter.zeta", place!(config.filter_zeta), ONE, 0.707)
            .fixed()
            .min(0.0)
            .says("Damping ratio of the low-pass filter of the paper's methods"),
    );

    rows.extend(
        Row::named_reals(["Ym", "Zm"], place!(input.position_m[k]), METRE, [0.0; 2])
            .map(|row| row.input().nominal(1e-5).says("Measured position of the rotor along {axis}")),
    );
    rows.extend(
        Row::reals("im", place!(input.current_a[k]), AMPERE, [0.0; 3])
            .map(|row| row.input().says("Measured current through magnet {k}")),
    );
    rows.push(
        Row::real("theta", place!(input.theta_rad), RADIAN, 0.0)
            .input()
            .says("Rotor angle, wrapped or not; without it no unbalance can be identified"),
    );
    rows.push(
        Row::real("omega", place!(input.omega_rad_s), RADIAN_PER_SECOND, 100.0 * std::f64::consts::PI)
            .input()
            .nominal(100.0)
            .says("Speed of the rotor, which the force of an unbalance goes with"),
    );
    rows.push(
        Row::boolean("enable", place!(input.enable), true).input().says("Whether samples are taken into account"),
    );
    rows.push(
        Row::boolean("contact", place!(input.contact), false)
            .input()
            .says("Whether the rotor touches something beside the magnets, so that samples are of no use"),
    );
    rows.push(
        Row::boolean("reset", place!(input.reset), false).input().says("A rising edge starts the estimation afresh"),
    );

    rows.extend(
        Row::reals("lambdaHat", place!(output.lambda_hat[k]), LAMBDA, [0.0; 3])
            .map(|row| row.sampled_output().nominal(1e-6).says("Estimated force constant of magnet {k}")),
    );
    rows.extend(Row::reals("lambdaRaw", place!(output.lambda_raw[k]), LAMBDA, [0.0; 3]).map(|row| {
        row.sampled_output().nominal(1e-6).says("Force constant of magnet {k} from the last revolution alone")
    }));
    rows.extend(Row::reals("lambdaStd", place!(output.lambda_std[k]), LAMBDA, [0.0; 3]).map(|row| {
        row.sampled_output()
            .min(0.0)
            .nominal(1e-8)
            .says("Standard deviation of the force constant of magnet {k} by noise alone")
    }));
    rows.extend(Row::reals("lambdaStdTotal", place!(output.lambda_std_total[k]), LAMBDA, [0.0; 3]).map(|row| {
        row.sampled_output()
            .min(0.0)
            .nominal(1e-8)
            .says("Standard deviation of the force constant of magnet {k} by noise and tolerances")
    }));
    rows.extend(Row::reals("ki", place!(output.ki[k]), NEWTON_PER_AMPERE, [0.0; 3]).map(|row| {
        row.sampled_output().nominal(10.0).says("Force per current of magnet {k}, mean over the last revolution")
    }));
    rows.extend(Row::reals("ks", place!(output.ks[k]), NEWTON_PER_METRE, [0.0; 3]).map(|row| {
        row.sampled_output().nominal(1e5).says("Negative stiffness of magnet {k}, mean over the last revolution")
    }));
    for (name, place, unit, nominal, description) in [
        (
            "noise.position",
            place!(output.position_noise_m),
            METRE,
            1e-7,
            "Standard deviation of the noise of Ym and Zm, told or found",
        ),
        (
            "noise.current",
            place!(output.current_noise_a),
            AMPERE,
            1e-2,
            "Standard deviation of the noise of im, told or found",
        ),
    ] {
        rows.push(Row::real(name, place, unit, 0.0).sampled_output().min(0.0).nominal(nominal).says(description));
    }
    rows.push(
        Row::boolean("valid", place!(output.valid), false)
            .sampled_output()
            .says("Whether the estimate can be relied on; if not, lambdaHat is the last valid one"),
    );
    let verdict = Access {
        get: |values: &Values, _| verdict_number(values.output.verdict),
        set: |values: &mut Values, _, number| {
            let at = usize::try_from(number).ok().and_then(|number| number.checked_sub(1));
            values.output.verdict = at.and_then(|at| Verdict::ALL.get(at)).copied().unwrap_or_default();
        },
    };
    rows.push(Row::choice("verdict", verdict, &VERDICT, 2).sampled_output().says("Why the estimate is valid or not"));
    rows.push(
        Row::real("condition", place!(output.condition), ONE, 0.0)
            .sampled_output()
            .min(0.0)
            .nominal(10.0)
            .says("Condition number of the information matrix scaled to unit diagonal"),
    );
    rows.push(
        Row::real("residual", place!(output.residual), ONE, 0.0)
            .sampled_output()
            .min(0.0)
            .says("Normalised innovation squared, 1 where model and noise are right; the paper's methods: part of the motion left unexplained"),
    );
    rows.extend(
        Row::named_reals(["pYHat", "pZHat"], place!(output.load_n[k]), NEWTON, [0.0; 2])
            .map(|row| row.sampled_output().nominal(10.0).says("Static load on the rotor along {axis}")),
    );
    rows.push(
        Row::real("unbalance.magnitude", place!(output.unbalance_kg_m), KILOGRAM_METRE, 0.0)
            .sampled_output()
            .min(0.0)
            .nominal(1e-4)
            .says("Identified unbalance, mass times eccentricity; 0 where none is identified"),
    );
    rows.push(
        Row::real("unbalance.phase", place!(output.unbalance_phase_rad), RADIAN, 0.0)
            .sampled_output()
            .says("Identified angle of the unbalance from the mark on the rotor that theta refers to"),
    );
    rows
}

/// The number of a verdict in the interface.
fn verdict_number(verdict: Verdict) -> i32 {
    Verdict::ALL.iter().zip(1..).find(|(one, _)| **one == verdict).map_or(0, |(_, number)| number)
}

/// A run of the estimator.
#[derive(Clone)]
pub struct Estimation {
    /// With the paper's kernels, which are large and the same for all copies.
    estimator: Arc<Estimator>,
    state: EstimatorState,
    clock: Clock,
}

impl Values {
    /// Brings into the configuration what the interface has in another form.
    fn complete(&mut self) -> Vec<Invalid> {
        let mut findings = Vec::new();
        let methods = [Method::PaperLiteral, Method::Paper, Method::PredictionError];
        METHOD.choose("method", self.method, methods, &mut self.config.method, &mut findings);
        let holds = [Hold::HeldBefore, Hold::HeldAfter, Hold::Linear];
        HOLD.choose("hold", self.hold, holds, &mut self.config.hold, &mut findings);
        findings
    }
}

/// The configuration of an estimator whose variables, by index, have the values given and else their start values.
///
/// # Errors
/// Every choice that cannot be accepted.
pub fn configuration(settings: &[(usize, Value)]) -> Result<EstimatorConfig, Vec<Invalid>> {
    let mut values: Values = with(&TABLE, settings);
    together(values.complete(), Ok(values.config))
}

/// The estimator that the values describe.
fn estimator(values: &mut Values) -> Result<Arc<Estimator>, Vec<Invalid>> {
    together(values.complete(), Estimator::new(values.config.clone())).map(Arc::new)
}

impl Slave for Estimation {
    type Values = Values;
    type State = (EstimatorState, Clock);

    fn table() -> &'static [Row<Values>] {
        &TABLE
    }

    fn start(values: &mut Values, start_s: f64) -> Result<Self, Vec<Invalid>> {
        let estimator = estimator(values)?;
        let state = estimator.start();
        values.output = state.output().clone();
        Ok(Self { clock: Clock::new(start_s, values.config.step_s), estimator, state })
    }

    fn state(&self) -> (EstimatorState, Clock) {
        (self.state.clone(), self.clock)
    }

    fn resume(
        values: &mut Values,
        (state, clock): (EstimatorState, Clock),
        time_s: Option<f64>,
    ) -> Result<Self, String> {
        let estimator = estimator(values).map_err(|findings| all(&findings))?;
        if !estimator.accepts(&state) {
            return Err("the state is not that of the parameters".into());
        }
        if time_s.is_some_and(|time_s| !clock.suits(values.config.step_s, time_s)) {
            return Err("the samples taken do not belong to the time".into());
        }
        Ok(Self { estimator, state, clock })
    }

    fn grain_s(&self) -> f64 {
        self.estimator.config().step_s
    }

    fn step(
        &mut self,
        values: &mut Values,
        step: Step,
        inputs: &Course<Values>,
        log: &mut dyn Log,
    ) -> Result<(), Fault> {
        while let Some(instant_s) = self.clock.next_before(step.end_s()) {
            inputs.put(values, instant_s);
            let former = values.output.verdict;
            values.output = self.estimator.sample(&mut self.state, &values.input);
            let verdict = values.output.verdict;
            let topic = if verdict == Verdict::Singular { Topic::SingularLinearSystem } else { Topic::Event };
            if former != verdict && log.wants(topic) {
                log.say(topic, format_args!("at {} s the estimate is {verdict}", Digits::<9>(instant_s)));
            }
        }
        Ok(())
    }
}
