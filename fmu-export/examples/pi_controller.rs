//! A sampled PI controller with anti-windup: `cargo run -p fmu-export --example pi_controller`.
use fmu_export::{package, prelude::*};

#[derive(Clone, Default, Serialize, Deserialize, Variables)]
struct Values {
    /// Sample time
    #[parameter(name = "Ts", unit = unit::SECOND, start = 1e-2, min = 1e-6)]
    period_s: f64,
    /// Limit of u
    #[parameter(start = 1.0, min = 1e-9)]
    limit: f64,
    /// Proportional gain
    #[parameter(start = 2.0, tunable)]
    kp: f64,
    /// Integral gain
    #[parameter(unit = unit::PER_SECOND, start = 5.0, tunable)]
    ki: f64,
    /// Reference
    #[input]
    r: f64,
    /// Measured value
    #[input]
    y: f64,
    /// Output
    #[output(discrete)]
    u: f64,
    /// Whether u is limited
    #[output(discrete)]
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
        Values::rows()
    }

    fn new(values: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        Ok(Self { period_s: values.period_s })
    }

    fn period_s(&self) -> f64 {
        self.period_s
    }

    fn start(&self, values: &mut Values, _: f64) -> f64 {
        (values.u, values.limited) = (0.0, false);
        0.0
    }

    fn sample(&self, integral: &mut f64, values: &mut Values, instant_s: f64, log: &mut dyn Log) -> Stepped {
        let error = values.r - values.y;
        let ahead = *integral + values.ki * self.period_s * error;
        let wanted = values.kp * error + ahead;
        if !wanted.is_finite() {
            return Err(StepError::of(format_args!("r = {} and y = {} give no output", values.r, values.y)));
        }
        let limited = wanted.abs() > values.limit;
        if limited && !values.limited {
            log.message(Topic::Event, format_args!("at {instant_s} s the output reaches its limit"));
        }
        *integral = if limited { *integral } else { ahead };
        (values.u, values.limited) = (wanted.clamp(-values.limit, values.limit), limited);
        Ok(())
    }
}

export_fmus!(PiController);

fn main() -> Result<(), package::PackageError> {
    package::package_example(&FMUS, "pi_controller_fmu", "target/fmu")
}
