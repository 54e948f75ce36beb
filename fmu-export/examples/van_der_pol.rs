//! The Van der Pol oscillator x'' = μ (1 − x²) x' − x as an FMU: `cargo run --release -p fmu-export --example van_der_pol`.

use fmu_export::package::{PackageError, build_example, package_library};
use fmu_export::prelude::*;

const PER_SECOND: Unit = Unit::new("1/s", &[("s", -1)], &[]);
const PER_SECOND2: Unit = Unit::new("1/s2", &[("s", -2)], &[]);
/// Step of the classical Runge-Kutta method, in s. Its error at the end of the run is 2e-10.
const STEP_S: f64 = 1e-3;

#[derive(Clone, Default, Serialize, Deserialize)]
pub struct Values {
    mu: f64,
    x0: f64,
    v0: f64,
    x: f64,
    v: f64,
    a: f64,
}

#[derive(Clone)]
pub struct VanDerPol;

fn derivatives(mu: f64, [x, v]: [f64; 2]) -> [f64; 2] {
    [v, mu * (1.0 - x * x) * v - x]
}

impl Model for VanDerPol {
    const INFO: Info = Info { stop_s: 20.0, step_s: 0.01, ..Info::new("VanDerPol", "Oscillator with nonlinear damping") };
    const CAPABILITIES: Capabilities = Capabilities { directional_derivatives: true, output_derivative_order: 0 };
    type Values = Values;
    type State = ();

    fn table() -> Vec<Row<Values>> {
        let mu = Row::real("mu", place!(Values.mu), unit::ONE, 1.0).tunable().description("Strength of the damping");
        let x = Row::real("x", place!(Values.x), unit::ONE, 0.0).output().state().depends_on(["x"]).starts_from(["x0"]);
        let v = Row::real("v", place!(Values.v), PER_SECOND, 0.0).output().state().derivative_of("x");
        let a = Row::real("a", place!(Values.a), PER_SECOND2, 0.0).derivative_of("v").depends_on(["x", "v"]);
        vec![
            mu,
            Row::real("x0", place!(Values.x0), unit::ONE, 2.0).fixed().description("Position at the start"),
            Row::real("v0", place!(Values.v0), PER_SECOND, 0.0).fixed().description("Velocity at the start"),
            x.description("Position"),
            v.depends_on(["v"]).starts_from(["v0"]).description("Velocity"),
            a.starts_from(["mu", "x0", "v0"]).description("Acceleration"),
        ]
    }

    fn new(_: &Values) -> Result<Self, Vec<Invalid>> {
        Ok(Self)
    }

    fn start(&self, values: &mut Values, _: f64) {
        [values.x, values.v] = [values.x0, values.v0];
        [_, values.a] = derivatives(values.mu, [values.x, values.v]);
    }

    fn step(&self, _: &mut (), values: &mut Values, step: Step, _: &InputTrajectory<Values>, _: &mut dyn Log) -> Result<(), StepError> {
        let count = (step.length_s / STEP_S - 1e-6).ceil().max(1.0);
        let h = step.length_s / count;
        for _ in 0..count as usize {
            let z = [values.x, values.v];
            let ahead = |h: f64, k: [f64; 2]| derivatives(values.mu, [z[0] + h * k[0], z[1] + h * k[1]]);
            let k1 = derivatives(values.mu, z);
            let k2 = ahead(h / 2.0, k1);
            let k3 = ahead(h / 2.0, k2);
            let k4 = ahead(h, k3);
            [values.x, values.v] = std::array::from_fn(|i| z[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        }
        self.refresh(&(), values, step.end_s());
        Ok(())
    }

    fn base_step_s(&self) -> f64 { STEP_S }
}
