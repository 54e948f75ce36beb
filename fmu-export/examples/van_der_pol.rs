//! The Van der Pol oscillator x'' = mu (1 - x²) x' - x: `cargo run --release -p fmu-export --example van_der_pol`.
use fmu_export::{package, prelude::*};

const STEP_S: f64 = 1e-3;
#[derive(Clone, Default, Serialize, Deserialize, Variables)]
struct Values {
    /// Strength of the damping
    #[parameter(start = 1.0)]
    mu: f64,
    /// Initial position
    #[parameter(start = 2.0)]
    x0: f64,
    /// Initial velocity
    #[parameter(unit = unit::PER_SECOND)]
    v0: f64,
    /// Position
    #[output(state, depends_on = ["x"], starts_from = ["x0"])]
    x: f64,
    /// Velocity
    #[output(unit = unit::PER_SECOND, state, derivative_of = "x", depends_on = ["v"], starts_from = ["v0"])]
    v: f64,
    /// Acceleration
    #[local(unit = unit::PER_SECOND2, derivative_of = "v", depends_on = ["x", "v"])]
    a: f64,
}

#[derive(Clone)]
struct VanDerPol;

fn slope(mu: f64, x: f64, v: f64) -> [f64; 2] {
    [v, mu * (1.0 - x * x) * v - x]
}

impl Model for VanDerPol {
    const INFO: Info = Info::new("VanDerPol", "Van der Pol oscillator").experiment(20.0, 0.01);
    const CAPABILITIES: Capabilities = Capabilities::NONE.directional_derivatives();
    type Values = Values;
    type State = ();

    fn table() -> Vec<Row<Values>> {
        Values::rows()
    }

    fn new(_: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        Ok(Self)
    }

    fn start(&self, values: &mut Values, _: f64) {
        (values.x, values.v) = (values.x0, values.v0);
        values.a = slope(values.mu, values.x, values.v)[1];
    }

    fn step(&self, _: &mut (), values: &mut Values, to: Step, _: &InputTrajectory<Values>, _: &mut dyn Log) -> Stepped {
        let count = (to.length_s / STEP_S - 1e-6).ceil().max(1.0);
        let (mu, h) = (values.mu, to.length_s / count);
        for _ in 0..count as usize {
            let (x, v) = (values.x, values.v);
            let k1 = slope(mu, x, v);
            let k2 = slope(mu, x + h / 2.0 * k1[0], v + h / 2.0 * k1[1]);
            let k3 = slope(mu, x + h / 2.0 * k2[0], v + h / 2.0 * k2[1]);
            let k4 = slope(mu, x + h * k3[0], v + h * k3[1]);
            [values.x, values.v] = [0, 1].map(|i| [x, v][i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
        }
        values.a = slope(mu, values.x, values.v)[1];
        if values.a.is_finite() { Ok(()) } else { Err(StepError::of("the solution is no longer finite")) }
    }

    fn base_step_s(&self) -> f64 {
        STEP_S
    }

    fn differentiate(&self, _: &(), values: &Values, along: &Values, _: f64, _: bool) -> Values {
        let (&Values { mu, x, v, .. }, dx, dv) = (values, along.x + along.x0, along.v + along.v0);
        let da = (1.0 - x * x) * (along.mu * v + mu * dv) - (2.0 * mu * x * v + 1.0) * dx;
        Values { x: dx, v: dv, a: da, ..Values::default() }
    }
}

export_fmus!(VanDerPol);

fn main() -> Result<(), package::PackageError> {
    package::package_example(&FMUS, "van_der_pol_fmu", "target/fmu")
}
