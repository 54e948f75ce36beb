//! The closed loop of a scenario, with a hand on it: what happens in the course of a run.
#![allow(dead_code, reason = "every test uses its part of this")]

use fmu_export::Instance;
use fmu_export::Step;
use fmu_export::log::{Log, Topic};
use fmu_export::variable::Value;
use magnetic_bearing::simulation::scenario::Scenario;

/// The slaves of a loop in motion.
pub struct Bench {
    scenario: Scenario,
    slaves: Vec<Box<dyn Instance>>,
    wires: Vec<((usize, usize), (usize, usize))>,
    step: usize,
    /// What the slaves have said.
    pub lines: Vec<String>,
    /// Why a slave could not go on.
    pub fault: Option<String>,
}

/// What the estimator says at an instant.
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
        let slaves = scenario.elements.iter().map(|element| {
            let mut slave = element.kind.instantiate();
            for setting in &element.settings {
                slave.set(setting.index, setting.value.clone()).expect("a good scenario");
            }
            slave.start().expect("a good scenario");
            slave
        });
        let slaves = slaves.collect();
        let mut bench =
            Self { scenario: scenario.clone(), slaves, wires: Vec::new(), step: 0, lines: Vec::new(), fault: None };
        let wire = |connection: magnetic_bearing::simulation::scenario::Connection| {
            let find = |[element, variable]: &[String; 2]| bench.find(element, variable);
            (find(&connection.from), find(&connection.to))
        };
        bench.wires = scenario.connections().into_iter().map(wire).collect();
        bench
    }

    fn find(&self, element: &str, variable: &str) -> (usize, usize) {
        let at = self.scenario.elements.iter().position(|candidate| candidate.name == element).expect("an element");
        let variables = self.scenario.elements[at].kind.variables();
        (at, variables.iter().position(|candidate| candidate.name == variable).expect("a variable"))
    }

    pub fn time_s(&self) -> f64 {
        self.step as f64 * self.scenario.step_s
    }

    /// Sets a value that no connection overrides, or one that does until the next step.
    pub fn set(&mut self, element: &str, variable: &str, value: impl Into<f64>) {
        let (at, index) = self.find(element, variable);
        let value = value.into();
        let value = match self.slaves[at].get(index).expect("a value") {
            Value::Boolean(_) => Value::Boolean(value != 0.0),
            Value::Integer(_) => Value::Integer(value as i32),
            Value::Real(_) => Value::Real(value),
            Value::String(_) => panic!("{element}.{variable} is a text"),
        };
        self.slaves[at].set(index, value).expect("a value that may be set");
    }

    pub fn get(&mut self, element: &str, variable: &str) -> f64 {
        let (at, index) = self.find(element, variable);
        self.slaves[at].get(index).expect("a value").as_f64()
    }

    /// One step; `spoil` may falsify what the connections have delivered.
    pub fn step(&mut self, spoil: impl FnOnce(&mut Self)) {
        for ((from, output), (to, input)) in self.wires.clone() {
            let value = self.slaves[from].get(output).expect("an output");
            self.slaves[to].set(input, value).expect("an input");
        }
        spoil(self);
        let step = Step { time_s: self.time_s(), length_s: self.scenario.step_s };
        for slave in &mut self.slaves {
            if let Err(fault) = slave.step(step, &mut Lines(&mut self.lines)) {
                self.fault.get_or_insert_with(|| fault.to_string());
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

    /// Runs until an instant; everything that the estimator said.
    pub fn until(&mut self, end_s: f64, mut spoil: impl FnMut(&mut Self)) -> Vec<Said> {
        let mut all = Vec::new();
        while self.fault.is_none() && self.time_s() < end_s - 1e-9 {
            self.step(&mut spoil);
            all.push(self.said());
        }
        all
    }
}
