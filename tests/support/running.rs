//! The closed loop of a scenario, step by step, with interventions.
#![allow(dead_code, reason = "every test uses its part of this")]

use fmu_export::Instance;
use fmu_export::Step;
use fmu_export::log::{Log, Topic};
use fmu_export::variable::Value;
use magnetic_bearing::simulation::scenario::Scenario;

/// The instances of a running loop.
pub struct Bench {
    scenario: Scenario,
    instances: Vec<Box<dyn Instance>>,
    wires: Vec<((usize, usize), (usize, usize))>,
    step: usize,
    /// Messages of the instances.
    pub lines: Vec<String>,
    /// Why an instance failed.
    pub error: Option<String>,
}

/// Outputs of the estimator at an instant.
#[derive(Clone, Debug)]
pub struct Said {
    pub time_s: f64,
    pub valid: bool,
    pub hat: [f64; 3],
    pub std: [f64; 3],
    pub residual: f64,
    pub condition: f64,
}

struct Lines<'a>(&'a mut Vec<String>);

impl Log for Lines<'_> {
    fn wants(&self, _: Topic) -> bool {
        true
    }

    fn message(&mut self, _: Topic, message: std::fmt::Arguments<'_>) {
        self.0.push(message.to_string());
    }
}

impl Bench {
    /// The loop of a scenario, started.
    pub fn new(scenario: &Scenario) -> Self {
        let instances = scenario.elements.iter().map(|element| {
            let mut instance = element.model_type.instantiate();
            for setting in &element.settings {
                instance.set(setting.index, setting.value.clone()).expect("a good scenario");
            }
            instance.start().expect("a good scenario");
            instance
        });
        let instances = instances.collect();
        let mut bench =
            Self { scenario: scenario.clone(), instances, wires: Vec::new(), step: 0, lines: Vec::new(), error: None };
        let wire = |connection: magnetic_bearing::simulation::scenario::Connection| {
            let find = |[element, variable]: &[String; 2]| bench.find(element, variable);
            (find(&connection.from), find(&connection.to))
        };
        bench.wires = scenario.connections().into_iter().map(wire).collect();
        bench
    }

    fn find(&self, element: &str, variable: &str) -> (usize, usize) {
        let at = self.scenario.elements.iter().position(|candidate| candidate.name == element).expect("an element");
        let variables = self.scenario.elements[at].model_type.variables();
        (at, variables.iter().position(|candidate| candidate.name == variable).expect("a variable"))
    }

    pub fn time_s(&self) -> f64 {
        self.step as f64 * self.scenario.step_s
    }

    /// Sets a value; that of a connected input lasts until the next step.
    pub fn set(&mut self, element: &str, variable: &str, value: impl Into<f64>) {
        let (at, index) = self.find(element, variable);
        let value = value.into();
        let value = match self.instances[at].get(index).expect("a value") {
            Value::Boolean(_) => Value::Boolean(value != 0.0),
            Value::Integer(_) => Value::Integer(value as i32),
            Value::Real(_) => Value::Real(value),
            _ => panic!("{element}.{variable} is a text"),
        };
        self.instances[at].set(index, value).expect("a value that may be set");
    }

    pub fn get(&mut self, element: &str, variable: &str) -> f64 {
        let (at, index) = self.find(element, variable);
        self.instances[at].get(index).expect("a value").as_f64()
    }

    /// One step; `spoil` may falsify what the connections have delivered.
    pub fn step(&mut self, spoil: impl FnOnce(&mut Self)) {
        for ((from, output), (to, input)) in self.wires.clone() {
            let value = self.instances[from].get(output).expect("an output");
            self.instances[to].set(input, value).expect("an input");
        }
        spoil(self);
        let step = Step { time_s: self.time_s(), length_s: self.scenario.step_s };
        for instance in &mut self.instances {
            if let Err(error) = instance.step(step, &mut Lines(&mut self.lines)) {
                self.error.get_or_insert_with(|| error.to_string());
            }
        }
        self.step += 1;
    }

    pub fn said(&mut self) -> Said {
        let mut magnets = |name: &str| [1, 2, 3].map(|k| self.get("estimator", &format!("{name}[{k}]")));
        let (hat, std) = (magnets("lambdaHat"), magnets("lambdaStd"));
        Said {
            time_s: self.time_s(),
            valid: self.get("estimator", "valid") == 1.0,
            hat,
            std,
            residual: self.get("estimator", "residual"),
            condition: self.get("estimator", "condition"),
        }
    }

    /// Runs until an instant and returns all outputs of the estimator.
    pub fn until(&mut self, end_s: f64, mut spoil: impl FnMut(&mut Self)) -> Vec<Said> {
        let mut all = Vec::new();
        while self.error.is_none() && self.time_s() < end_s - 1e-9 {
            self.step(&mut spoil);
            all.push(self.said());
        }
        all
    }
}
