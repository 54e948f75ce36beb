//! Tolerances of a bench as users write them: `s=2%`, `alpha=1deg`, `sensor.offset=5um`.

use fmu_export::variable::Value;

use super::Stated;
use super::likelihood::BenchParameter;
use super::units::{self, factor, significant};
use crate::simulation::scenario::number_and_unit;
use crate::simulation::{Element, suggestion};

/// A value in SI units from a number with or without a unit of the quantity whose SI unit is `si`.
///
/// # Errors
/// The expected form.
pub fn quantity(name: &str, text: &str, si: &str) -> Result<f64, String> {
    // The level of a random walk is its standard deviation after one second.
    let units = units::quantity_of(si.trim_end_matches("/s0.5"));
    units::value(text, units).ok_or_else(|| match units {
        [] => format!("{name}={text}: expected a number ({si})"),
        units => format!("{name}={text}: expected a number, in {}", units::names(units)),
    })
}

/// The name of a bench parameter without the prefix of its bearing.
pub(super) fn plain(name: &str) -> &str {
    ["A.", "B.", "X."].into_iter().find_map(|prefix| name.strip_prefix(prefix)).unwrap_or(name)
}

/// The bench parameters that a name stands for: one, those of all bearings, or all whose names begin with it (`alpha`, `sensor.offset`, `runout2`).
///
/// # Errors
/// No parameter matches; the message suggests a name.
pub fn named(parameters: &[BenchParameter], name: &str) -> Result<Vec<usize>, String> {
    let is_group = |whole: &str| whole.strip_prefix(name).is_some_and(|rest| rest.starts_with(['[', '.']));
    let is_meant = |whole: &str| [whole, plain(whole)].into_iter().any(|whole| whole == name || is_group(whole));
    let meant: Vec<usize> = (0..parameters.len()).filter(|at| is_meant(&parameters[*at].name)).collect();
    // A group has several members and one unit.
    match meant.as_slice() {
        [one] if plain(&parameters[*one].name) == plain(name) => return Ok(meant),
        [first, _, ..] if meant.iter().all(|at| parameters[*at].unit == parameters[*first].unit) => return Ok(meant),
        _ => {}
    }
    let names: Vec<String> = parameters.iter().map(|parameter| parameter.name.clone()).collect();
    Err(format!("{name} is not a parameter of a bench; {}", suggestion(name, &names)))
}

/// The tolerances of the on-line estimator (`tolerance.*`) above 0, as bench parameters with their standard deviations.
pub fn of_estimator(stated: &Stated, estimator: &Element) -> Vec<(usize, f64)> {
    let of = |name: &str| estimator.value(&format!("tolerance.{name}")).map_or(0.0, Value::as_f64);
    // The gains of the two sensors are independent: factor for their mean, and for half their difference.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let std = |name: &str| match plain(name) {
        own @ ("m" | "s" | "Jt" | "Jp") => of(own) / stated.value(name),
        "sensor.gain" => of("positionGain") * if name.starts_with("X.") { 1.0 } else { half },
        "sensor.gainDifference" => of("positionGain") * half,
        own @ ("position" | "sensorPosition") => of(own),
        own if own.starts_with("alpha") => of("alpha"),
        own if own.starts_with("sensor.offset") => of("positionOffset"),
        own if own.starts_with("current.gain") => of("currentGain"),
        own if own.starts_with("current.offset") => of("currentOffset"),
        own if own.starts_with("unbalance") => of("unbalancePosition"),
        _ => 0.0,
    };
    let all = stated.parameters().into_iter().map(|parameter| std(&parameter.name)).enumerate();
    all.filter(|(_, std)| *std > 0.0).collect()
}

/// Name of all bench parameters together.
pub const ALL: &str = "all";
/// The tolerance of a typical bench.
const TYPICAL: &str = "typical";

/// The parameters that a tolerance applies to, with its value in their unit. Absolute tolerances of masses, gaps and moments of inertia are
/// divided by the stated values.
///
/// # Errors
/// The expected form.
pub fn tolerance(name: &str, value: &str, stated: &Stated) -> Result<Vec<(usize, f64)>, String> {
    let parameters = stated.parameters();
    let meant = if name == ALL { (0..parameters.len()).collect() } else { named(&parameters, name)? };
    if value == TYPICAL {
        return Ok(meant.into_iter().map(|at| (at, parameters[at].typical)).collect());
    }
    if name == ALL {
        return Err(format!("tolerance {name}={value}: expected {ALL}={TYPICAL}"));
    }
    let own = parameters[meant[0]].unit;
    let absolute = match plain(&parameters[meant[0]].name) {
        "m" => "kg",
        "s" => "m",
        "Jt" | "Jp" => "kg.m2",
        _ => "",
    };
    let [of_own, of_absolute] = [own, absolute].map(units::quantity_of);
    let wanted = || {
        let listed = [of_own, of_absolute].map(units::names).join(", ");
        format!("tolerance {name}={value}: expected a number above 0, in {}", listed.trim_end_matches(", "))
    };
    let (number, unit) = number_and_unit(value).ok_or_else(wanted)?;
    let of = |at: usize| {
        let std = match (factor(of_own, unit), factor(of_absolute, unit)) {
            (Some(factor), _) => number * factor,
            (None, Some(factor)) => number * factor / stated.value(&parameters[at].name),
            (None, None) => return Err(wanted()),
        };
        if !(std.is_finite() && std > 0.0) {
            return Err(wanted());
        }
        if own == "1" && std >= 1.0 {
            return Err(format!(
                "tolerance {name}={value}: this is {} %, expected less than 100 %",
                significant(100.0 * std, 3)
            ));
        }
        Ok((at, std))
    };
    meant.into_iter().map(of).collect()
}
