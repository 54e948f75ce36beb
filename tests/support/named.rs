//! An instance with access to its variables by name.

use fmu_export::instance::AccessError;
use fmu_export::log::Silent;
use fmu_export::variable::{Type, Value, Variable};
use fmu_export::{Instance, Invalid, Step};
use magnetic_bearing::fmu::find;

/// An instance with its variables.
pub struct Named {
    /// The instance.
    pub instance: Instance,
    /// Its variables, by index.
    pub variables: Vec<&'static Variable>,
}

/// A number as a value of the type of a variable.
pub fn value(kind: &Type, number: f64) -> Value {
    match kind {
        Type::Real { .. } => Value::Real(number),
        Type::Integer { .. } | Type::Enumeration { .. } => Value::Integer(number as i32),
        Type::Boolean { .. } => Value::Boolean(number != 0.0),
        _ => panic!("a text is no number"),
    }
}

impl Named {
    /// A new instance of the model of that name.
    pub fn new(model: &str) -> Self {
        let kind = find(model).unwrap_or_else(|| panic!("there is no model {model}"));
        // Leaked so that a test can hold a variable while it changes the instance.
        let kind = Box::leak(Box::new(kind));
        Self { instance: kind.instantiate(), variables: kind.variables().iter().collect() }
    }

    /// A running instance; these values are set before the start at time 0.
    pub fn started(model: &str, values: &[(&str, f64)]) -> Self {
        let mut named = Self::new(model);
        for (name, number) in values {
            named.set(name, *number);
        }
        named.start().unwrap_or_else(|findings| panic!("{model}: {findings:?}"));
        named
    }

    /// The index of a variable.
    pub fn index(&self, name: &str) -> usize {
        let found = self.variables.iter().position(|variable| variable.name == name);
        found.unwrap_or_else(|| panic!("there is no variable {name}"))
    }

    /// Reads a variable.
    pub fn get(&mut self, name: &str) -> f64 {
        let index = self.index(name);
        self.instance.get(index).expect("the index is that of a variable").as_f64()
    }

    /// Three elements of an array.
    pub fn three(&mut self, name: &str) -> [f64; 3] {
        std::array::from_fn(|k| self.get(&format!("{name}[{}]", k + 1)))
    }

    /// Tries to set a variable.
    pub fn try_set(&mut self, name: &str, number: f64) -> Result<(), AccessError> {
        let index = self.index(name);
        self.instance.set(index, value(&self.variables[index].data_type, number))
    }

    /// Sets a variable.
    #[track_caller]
    pub fn set(&mut self, name: &str, number: f64) {
        self.try_set(name, number).unwrap_or_else(|error| panic!("{name} = {number}: {error}"));
    }

    /// Starts the run.
    pub fn start(&mut self) -> Result<(), Vec<Invalid>> {
        self.instance.start()
    }

    /// Performs a step that must succeed.
    #[track_caller]
    pub fn step(&mut self, time_s: f64, length_s: f64) {
        let done = self.instance.step(Step { time_s, length_s }, &mut Silent);
        done.unwrap_or_else(|error| panic!("step at {time_s} s: {error}"));
    }

    /// All values by index, bit for bit.
    pub fn bits(&mut self) -> Vec<u64> {
        (0..self.variables.len())
            .map(|index| self.instance.get(index).expect("the index is that of a variable").as_f64().to_bits())
            .collect()
    }
}
