//! Tunable parameters that are refused during a run.

use fmu_export::ModelType;
use fmu_export::log::Silent;
use fmu_export::prelude::*;

#[derive(Clone, Default, Serialize, Deserialize, Variables)]
struct Values {
    #[parameter(start = 1.0, tunable)]
    k: f64,
    #[parameter(unit = unit::SECOND, start = 0.1, tunable)]
    period: f64,
    #[output]
    y: f64,
}

/// Adds `k` in each sample; its state holds `k` and the sum.
#[derive(Clone)]
struct Adder(f64);

impl SampledModel for Adder {
    const INFO: Info = Info::new("Adder", "Adds a number in each sample");
    type Values = Values;
    type State = [f64; 2];

    fn table() -> Vec<Row<Values>> {
        Values::rows()
    }

    fn new(values: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        Ok(Self(values.period))
    }

    fn period_s(&self) -> f64 {
        self.0
    }

    fn start(&self, values: &mut Values, _: f64) -> [f64; 2] {
        [values.k, 0.0]
    }

    fn sample(&self, [k, sum]: &mut [f64; 2], values: &mut Values, _: f64, _: &mut dyn Log) -> Stepped {
        *sum += *k;
        values.y = *sum;
        Ok(())
    }

    fn retune(&mut self, state: &mut [f64; 2], values: &Values, _: &Resources) -> Result<(), Vec<Invalid>> {
        (self.0, *state) = (values.period, [values.k, 0.0]);
        if values.k < 0.0 { Err(Invalid::new("k", values.k, "a number not below 0").into()) } else { Ok(()) }
    }
}

/// Fails if the model or the state keeps a part of what was refused by the model, or by the clock after it.
#[test]
fn refused_parameters_leave_the_run_as_it_was() {
    let model = ModelType::of::<fmu_export::Sampled<Adder>>();
    let mut adder = model.instantiate();
    adder.start().expect("good parameters");
    for (n, refused) in [(0, Value::Real(-5.0)), (1, Value::Real(0.2))] {
        adder.step(Step { time_s: f64::from(n) * 0.1, length_s: 0.1 }, &mut Silent).expect("a step");
        let before = adder.write();
        adder.set(n as usize, refused).expect_err("refused");
        assert_eq!(adder.write(), before);
    }
    adder.step(Step { time_s: 0.2, length_s: 0.1 }, &mut Silent).expect("a step");
    assert_eq!(adder.get(2), Ok(Value::Real(3.0)));
}
