//! A ball that bounces, with its impacts inside the steps: `cargo run -p fmu-export --example bouncing_ball`.
use fmu_export::{package, prelude::*};

#[derive(Clone, Default, Serialize, Deserialize, Variables)]
struct Values {
    /// Acceleration of gravity
    #[parameter(unit = unit::METRE_PER_SECOND2, start = 9.81, min = 0.0)]
    g: f64,
    /// Velocity after an impact as a fraction of that before
    #[parameter(start = 0.7, min = 0.0, max = 1.0, tunable)]
    restitution: f64,
    /// Height; its start value can be set
    #[output(unit = unit::METRE, start = 1.0, min = 0.0, state, exact, depends_on = ["h"])]
    h: f64,
    /// Velocity upwards
    #[output(unit = unit::METRE_PER_SECOND, state, exact, derivative_of = "h", depends_on = ["v"])]
    v: f64,
    /// Acceleration upwards
    #[local(unit = unit::METRE_PER_SECOND2, derivative_of = "v", depends_on = [])]
    a: f64,
    /// Number of impacts
    #[output(discrete, depends_on = [])]
    impacts: i32,
}

#[derive(Clone)]
struct BouncingBall;

impl Model for BouncingBall {
    const INFO: Info = Info::new("BouncingBall", "A ball that loses energy at each impact").experiment(3.0, 0.01);
    type Values = Values;
    type State = ();

    fn table() -> Vec<Row<Values>> {
        Values::rows()
    }

    fn new(_: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        Ok(Self)
    }

    fn start(&self, values: &mut Values, _: f64) {
        (values.a, values.impacts) = (-values.g, 0);
    }

    fn step(
        &self,
        _: &mut (),
        values: &mut Values,
        step: Step,
        _: &InputTrajectory<Values>,
        _: &mut dyn Log,
    ) -> Stepped {
        let mut rest_s = step.length_s;
        loop {
            // The ball flies on a parabola; h + v t - g t²/2 = 0 is the next impact.
            let Values { g, h, v, .. } = *values;
            let flight_s = ((v + (v * v + 2.0 * g * h).sqrt()) / g).min(rest_s);
            (values.h, values.v) = ((h + v * flight_s - g / 2.0 * flight_s * flight_s).max(0.0), v - g * flight_s);
            rest_s -= flight_s;
            if rest_s <= 0.0 || g == 0.0 {
                return Ok(());
            }
            (values.h, values.v, values.impacts) = (0.0, -values.restitution * values.v, values.impacts + 1);
            if values.v < 1e-3 {
                return Err(StepError::terminate(step.end_s() - rest_s, "the ball lies still"));
            }
        }
    }
}

export_fmus!(BouncingBall);

fn main() -> Result<(), package::PackageError> {
    package::package_example(&FMUS, "bouncing_ball_fmu", "target/fmu")
}
