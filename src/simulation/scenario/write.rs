//! Writes scenarios as text that [`Scenario::parse`] can read.

use fmu_export::variable::{Type, Value, Variable};

use super::{OF_COLUMN, Scenario};
use crate::output::SCENARIO;

impl Scenario {
    /// The scenario as TOML, all values in the units of the interface, without profiles, balancing, tolerances and estimators beside the
    /// loop.
    pub fn to_toml(&self) -> String {
        let [title, description, machine] = [&*self.title, &self.description, self.machine.name].map(quoted);
        let (duration, step) = (self.duration_s, self.step_s);
        let mut text = format!(
            "{SCENARIO}\ntitle = {title}\ndescription = {description}\nmachine = {machine}\nduration = {duration:?}\nstep = {step:?}\n"
        );
        for element in self.in_loop().iter().filter(|element| !element.settings.is_empty()) {
            text += &format!("\n[{}]\n", element.name);
            for (index, value) in element.values() {
                let variable = &element.model_type.variables()[index];
                text += &format!("{} = {}\n", key(&variable.name), value_of(variable, &value));
            }
        }
        if !self.columns.is_empty() {
            let short = |name: &str| key(name.strip_suffix(OF_COLUMN[0]).unwrap_or(name));
            let columns = self.columns.iter().map(|(name, value)| format!("{} = {}\n", short(name), quoted(value)));
            text += &format!("\n[columns]\n{}", columns.collect::<String>());
        }
        if !self.identify.is_empty() {
            text += &format!("\n[identify]\n{}", self.identify);
        }
        text
    }
}

fn value_of(variable: &Variable, value: &Value) -> String {
    match (&variable.data_type, value) {
        (Type::Enumeration { items, .. }, Value::Integer(value)) => quoted(items.item(*value).unwrap_or_default()),
        (_, Value::Integer(value)) => value.to_string(),
        (_, Value::Boolean(value)) => value.to_string(),
        (_, Value::String(value)) => quoted(value),
        (_, value) => format!("{:?}", value.clone().as_f64()),
    }
}

/// A name with dots is quoted: without quotes `F0` could not be both a value and, for `F0.modulation`, a table.
fn key(name: &str) -> String {
    if name.chars().all(|letter| letter.is_ascii_alphanumeric()) { name.into() } else { quoted(name) }
}

fn quoted(text: &str) -> String {
    toml::Value::String(text.into()).to_string()
}
