//! Tolerances of a bench as people write them: `s=2%`, `alpha=1deg`, `sensor.offset=5um`.

use super::likelihood::{PARAMETERS, by_name};
use super::read::number_and_unit;
use crate::estimation::Tolerance;

/// Units by the unit of the parameter; `%` and numbers without unit are parts of the value.
const UNITS: [(&str, &[(&str, f64)]); 7] = [
    ("1", &[("", 1.0), ("1", 1.0), ("%", 1e-2), ("ppm", 1e-6)]),
    ("m", &[("", 1.0), ("m", 1.0), ("mm", 1e-3), ("µm", 1e-6), ("um", 1e-6), ("nm", 1e-9)]),
    ("rad", &[("", 1.0), ("rad", 1.0), ("mrad", 1e-3), ("deg", DEGREE), ("°", DEGREE)]),
    ("s", &[("", 1.0), ("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("us", 1e-6)]),
    ("A", &[("", 1.0), ("A", 1.0), ("mA", 1e-3)]),
    ("N", &[("", 1.0), ("N", 1.0), ("mN", 1e-3)]),
    ("kg", &[("", 1.0), ("kg", 1.0), ("g", 1e-3)]),
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

/// The bench parameters that a name means: one, or all whose names begin with it (`alpha`, `sensor.offset`, `runout2`).
///
/// # Errors
/// There are none; the message lists the names that there are.
pub fn named(name: &str) -> Result<Vec<usize>, String> {
    if let Some(one) = by_name(name) {
        return Ok(vec![one]);
    }
    let begins = |whole: &str| whole.strip_prefix(name).is_some_and(|rest| rest.starts_with(['[', '.']));
    let several: Vec<usize> = (0..PARAMETERS.len()).filter(|at| begins(PARAMETERS[*at].name)).collect();
    // A group has several members and one unit.
    if several.windows(2).all(|pair| PARAMETERS[pair[0]].unit == PARAMETERS[pair[1]].unit) && several.len() > 1 {
        return Ok(several);
    }
    let names: Vec<&str> = PARAMETERS.iter().map(|parameter| parameter.name).collect();
    Err(format!("{name} is no parameter of a bench; there are {}", names.join(", ")))
}

/// The tolerances that the on-line estimator is told (`tolerance.*`), as bench parameters with their standard deviations; none where they
/// are 0.
#[must_use]
pub fn of_estimator(tolerance: &Tolerance, m_kg: f64, gap_m: f64) -> Vec<(usize, f64)> {
    // Gains of two sensors that are independent of each other: their mean, and half their difference.
    let gain = tolerance.position_gain * std::f64::consts::FRAC_1_SQRT_2;
    let told = [
        ("m", tolerance.m_kg / m_kg),
        ("s", tolerance.gap_m / gap_m),
        ("alpha", tolerance.alpha_rad),
        ("sensor.gain", gain),
        ("sensor.gainDifference", gain),
        ("sensor.offset", tolerance.position_offset_m),
        ("current.gain", tolerance.current_gain),
        ("current.offset", tolerance.current_offset_a),
    ];
    let known = told.into_iter().filter(|(_, std)| *std > 0.0);
    known.flat_map(|(name, std)| named(name).unwrap_or_default().into_iter().map(move |at| (at, std))).collect()
}

/// The parameters of a tolerance with its value in their unit. Mass and gap may be given in kg and in m as well; they are relative then to
/// the values that are told.
///
/// # Errors
/// The wanted form.
pub fn tolerance(name: &str, value: &str, m_kg: f64, gap_m: f64) -> Result<Vec<(usize, f64)>, String> {
    let parameters = named(name)?;
    let parameter = &PARAMETERS[parameters[0]];
    let wanted = |units: &str| format!("tolerance {name}={value}: a number above 0 is wanted, in {units}");
    let units_of = |unit: &str| UNITS.iter().find(|(of, _)| *of == unit).map_or(&[][..], |(_, units)| *units);
    let mut kinds = vec![(parameter.unit, 1.0)];
    match parameter.name {
        "m" => kinds.push(("kg", 1.0 / m_kg)),
        "s" => kinds.push(("m", 1.0 / gap_m)),
        _ => {}
    }
    let listed: Vec<&str> = kinds
        .iter()
        .flat_map(|(unit, _)| units_of(unit))
        .map(|(name, _)| *name)
        .filter(|name| !name.is_empty() && *name != "1")
        .collect();
    let listed = listed.join(", ");
    let (number, unit) = number_and_unit(value).ok_or_else(|| wanted(&listed))?;
    let unit = unit.replace('μ', "µ");
    let factor = kinds
        .iter()
        .find_map(|(of, scale)| units_of(of).iter().find(|(name, _)| *name == unit).map(|(_, factor)| factor * scale));
    let std = number * factor.ok_or_else(|| wanted(&listed))?;
    if !(std.is_finite() && std > 0.0) {
        return Err(wanted(&listed));
    }
    if parameter.unit == "1" && std >= 1.0 {
        return Err(format!("tolerance {name}={value}: less than 100 % is wanted"));
    }
    Ok(parameters.into_iter().map(|at| (at, std)).collect())
}
