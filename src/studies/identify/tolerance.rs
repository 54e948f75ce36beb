//! Tolerances of a bench as people write them: `s=2%`, `alpha=1deg`, `sensor.offset=5um`.

use fmu_export::variable::Value;

use super::Stated;
use super::likelihood::BenchParameter;
use super::read::number_and_unit;
use crate::simulation::scenario::Element;

/// Units by the unit of the parameter; `%` and numbers without unit are parts of the value.
const UNITS: [(&str, &[(&str, f64)]); 8] = [
    ("1", &[("", 1.0), ("1", 1.0), ("%", 1e-2), ("ppm", 1e-6)]),
    ("m", &[("", 1.0), ("m", 1.0), ("mm", 1e-3), ("µm", 1e-6), ("um", 1e-6), ("nm", 1e-9)]),
    ("rad", &[("", 1.0), ("rad", 1.0), ("mrad", 1e-3), ("deg", DEGREE), ("°", DEGREE)]),
    ("s", &[("", 1.0), ("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("us", 1e-6)]),
    ("A", &[("", 1.0), ("A", 1.0), ("mA", 1e-3)]),
    ("N", &[("", 1.0), ("N", 1.0), ("mN", 1e-3)]),
    ("kg", &[("", 1.0), ("kg", 1.0), ("g", 1e-3)]),
    ("kg.m2", &[("", 1.0), ("kg.m2", 1.0), ("kg·m²", 1.0)]),
];
const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// A value in SI units from a number with or without one of the units of a quantity, which is named by its SI unit.
///
/// # Errors
/// The wanted form.
pub fn quantity(name: &str, text: &str, si: &str) -> Result<f64, String> {
    // A random walk is given by what it reaches in a second.
    let of = si.trim_end_matches("/s0.5");
    let units = UNITS.iter().find(|(unit, _)| *unit == of).map_or(&[("", 1.0)][..], |(_, units)| *units);
    let listed: Vec<_> = units.iter().map(|(unit, _)| *unit).filter(|unit| !unit.is_empty() && *unit != "1").collect();
    let wanted = || match listed.as_slice() {
        [] => format!("{name}={text}: a number is wanted ({si})"),
        listed => format!("{name}={text}: a number is wanted, in {}", listed.join(", ")),
    };
    let (number, unit) = number_and_unit(text).ok_or_else(wanted)?;
    let unit = unit.replace('μ', "µ");
    let factor = units.iter().find(|(known, _)| *known == unit).ok_or_else(wanted)?.1;
    // Division by a whole reciprocal rounds once.
    let per = (1.0 / factor).round();
    let value = if (factor * per - 1.0).abs() < 1e-12 && factor < 1.0 { number / per } else { number * factor };
    if value.is_finite() { Ok(value) } else { Err(wanted()) }
}

/// The name of a bench parameter without the prefix of its bearing.
pub(super) fn plain(name: &str) -> &str {
    ["A.", "B.", "X."].into_iter().find_map(|prefix| name.strip_prefix(prefix)).unwrap_or(name)
}

/// The bench parameters that a name means: one, those of all bearings, or all whose names begin with it (`alpha`, `sensor.offset`, `runout2`).
///
/// # Errors
/// There are none; the message lists the names that there are.
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
    let names: Vec<&str> = parameters.iter().map(|parameter| parameter.name.as_str()).collect();
    Err(format!("{name} is no parameter of a bench; there are {}", names.join(", ")))
}

/// The tolerances that the on-line estimator is told (`tolerance.*`), as bench parameters with their standard deviations; none where they
/// are 0.
#[must_use]
pub fn of_estimator(stated: &Stated, estimator: &Element) -> Vec<(usize, f64)> {
    let of = |name: &str| estimator.value(&format!("tolerance.{name}")).map_or(0.0, Value::as_f64);
    // Gains of two sensors that are independent of each other: their mean, and half their difference.
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

/// The parameters of a tolerance with its value in their unit. Masses, gaps and moments of inertia may be given in their units as well; they are relative
/// then to the values that are stated.
///
/// # Errors
/// The wanted form.
pub fn tolerance(name: &str, value: &str, stated: &Stated) -> Result<Vec<(usize, f64)>, String> {
    let parameters = stated.parameters();
    let meant = named(&parameters, name)?;
    let units_of = |unit: &str| UNITS.iter().find(|(of, _)| *of == unit).map_or(&[][..], |(_, units)| *units);
    let own = parameters[meant[0]].unit;
    let absolute = match plain(&parameters[meant[0]].name) {
        "m" => "kg",
        "s" => "m",
        "Jt" | "Jp" => "kg.m2",
        _ => "",
    };
    let listed = units_of(own).iter().chain(units_of(absolute)).map(|(name, _)| *name);
    let listed: Vec<&str> = listed.filter(|name| !name.is_empty() && *name != "1").collect();
    let wanted = || format!("tolerance {name}={value}: a number above 0 is wanted, in {}", listed.join(", "));
    let (number, unit) = number_and_unit(value).ok_or_else(wanted)?;
    let unit = unit.replace('μ', "µ");
    let factor = |of: &str| units_of(of).iter().find(|(name, _)| *name == unit).map(|(_, factor)| *factor);
    let of = |at: usize| {
        let std = match (factor(own), factor(absolute)) {
            (Some(factor), _) => number * factor,
            (None, Some(factor)) => number * factor / stated.value(&parameters[at].name),
            (None, None) => return Err(wanted()),
        };
        if !(std.is_finite() && std > 0.0) {
            return Err(wanted());
        }
        if own == "1" && std >= 1.0 {
            return Err(format!("tolerance {name}={value}: less than 100 % is wanted"));
        }
        Ok((at, std))
    };
    meant.into_iter().map(of).collect()
}
