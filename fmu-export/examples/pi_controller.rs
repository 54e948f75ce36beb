//! A sampled PI controller with anti-windup: `cargo run --release -p fmu-export --example pi_controller`.
use fmu_export::{package, prelude::*};

#[derive(Clone, Default, Serialize, Deserialize)]
struct Values {
    gain: f64,
    integral_gain: f64,
    limit: f64,
    period_s: f64,
    reference: f64,
    measured: f64,
    output: f64,
    limited: bool,
}

/// The controller; its state is the integral of the error, stopped while the output is limited.
#[derive(Clone)]
struct PiController {
    period_s: f64,
}

impl SampledModel for PiController {
    const INFO: Info = Info::new("PiController", "Sampled PI controller with a limited output");
    type Values = Values;
    type State = f64;

    fn table() -> Vec<Row<Values>> {
        vec![
            Row::real("Ts", place!(Values.period_s), unit::SECOND, 1e-2).fixed().min(0.0).description("Sample time"),
            Row::real("limit", place!(Values.limit), unit::ONE, 1.0).fixed().min(0.0).description("Limit of u"),
            Row::real("kp", place!(Values.gain), unit::ONE, 2.0).tunable().description("Proportional gain"),
            Row::real("ki", place!(Values.integral_gain), unit::PER_SECOND, 5.0).tunable().description("Integral gain"),
            Row::real("r", place!(Values.reference), unit::ONE, 0.0).input().description("Reference"),
            Row::real("y", place!(Values.measured), unit::ONE, 0.0).input().description("Measured value"),
            Row::real("u", place!(Values.output), unit::ONE, 0.0).sampled_output().description("Output"),
            Row::boolean("limited", place!(Values.limited), false).sampled_output().description("Whether u is limited"),
        ]
    }

    fn new(values: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        let Values { period_s, limit, .. } = *values;
        let above_0 = [("Ts", period_s), ("limit", limit)].into_iter().filter(|(_, value)| *value <= 0.0);
        let found: Vec<_> = above_0.map(|(name, value)| Invalid::new(name, value, "a number above 0")).collect();
        if found.is_empty() { Ok(Self { period_s }) } else { Err(found) }
    }

    fn period_s(&self) -> f64 {
        self.period_s
    }

    fn start(&self, values: &mut Values, _: f64) -> f64 {
        (values.output, values.limited) = (0.0, false);
        0.0
    }

    fn sample(&self, integral: &mut f64, values: &mut Values, instant_s: f64, log: &mut dyn Log) -> Stepped {
        let error = values.reference - values.measured;
        let ahead = *integral + values.integral_gain * self.period_s * error;
        let wanted = values.gain * error + ahead;
        if !wanted.is_finite() {
            return Err(StepError::of(format_args!(
                "r = {} and y = {} give no output",
                values.reference, values.measured
            )));
        }
        let limited = wanted.abs() > values.limit;
        if limited && !values.limited {
            log.message(Topic::Event, format_args!("at {instant_s} s the output reaches its limit"));
        }
        *integral = if limited { *integral } else { ahead };
        (values.output, values.limited) = (wanted.clamp(-values.limit, values.limit), limited);
        Ok(())
    }
}

export_fmus!(PiController);

fn main() -> Result<(), package::PackageError> {
    package::package_example(&FMUS, "pi_controller_fmu", "target/fmu")
}
