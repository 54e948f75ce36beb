//! Units of recordings and parameters, by their common names; numbers and times for messages.

use std::f64::consts::{PI, TAU};

use crate::simulation::scenario::number_and_unit;

/// A quantity: its units, each with all its names and its size in SI. The first is the SI unit; messages use the
/// first name of a unit.
pub(super) type Quantity = &'static [(&'static [&'static str], f64)];

pub(super) const TIME: Quantity = &[
    (&["s", "sec", "second", "seconds"], 1.0),
    (&["ms", "msec"], 1e-3),
    (&["µs", "usec"], 1e-6),
    (&["ns", "nsec"], 1e-9),
];

/// A mil is a thousandth of an inch.
pub(super) const LENGTH: Quantity = &[
    (&["m", "meter", "metre"], 1.0),
    (&["mm", "millimeter", "millimetre"], 1e-3),
    (&["µm", "micron", "microns", "micrometer", "micrometers", "micrometre", "micrometres"], 1e-6),
    (&["nm"], 1e-9),
    (&["mil", "mils"], 25.4e-6),
];

pub(super) const CURRENT: Quantity = &[(&["A", "Amp", "Amps", "Ampere"], 1.0), (&["mA"], 1e-3)];

/// Of sensors that are recorded as they read.
const VOLTAGE: Quantity = &[(&["V", "Volt", "Volts"], 1.0), (&["mV"], 1e-3)];

pub(super) const ANGLE: Quantity = &[
    (&["rad", "radian", "radians"], 1.0),
    (&["deg", "°", "degree", "degrees", "Grad"], PI / 180.0),
    (&["rev", "revolution", "revolutions", "turn", "turns"], TAU),
];

pub(super) const SPEED: Quantity = &[
    (&["rad/s", "rad/sec", "1/s*rad", "rad*s-1"], 1.0),
    (&["rpm", "1/min", "U/min", "Upm", "min-1", "rev/min", "r/min"], PI / 30.0),
    (&["Hz", "rev/s", "rps"], TAU),
    (&["deg/s", "°/s"], PI / 180.0),
];

/// An angle of a bench; sensors of a rotor do not use mrad.
const STATED_ANGLE: Quantity = &[ANGLE[0], (&["mrad"], 1e-3), ANGLE[1]];
const RATIO: Quantity = &[(&["1"], 1.0), (&["%"], 1e-2), (&["ppm"], 1e-6)];
const FORCE: Quantity = &[(&["N"], 1.0), (&["mN"], 1e-3)];
const MASS: Quantity = &[(&["kg"], 1.0), (&["g"], 1e-3)];
const INERTIA: Quantity = &[(&["kg.m2", "kg·m²"], 1.0)];

/// The quantity with this SI unit; empty if it has no other units.
pub(super) fn quantity_of(si: &str) -> Quantity {
    let all = [TIME, LENGTH, CURRENT, STATED_ANGLE, RATIO, FORCE, MASS, INERTIA];
    all.into_iter().find(|quantity| quantity[0].0[0] == si).unwrap_or_default()
}

/// Normalises the spelling of a name.
fn plain(name: &str) -> String {
    let name = name.trim().replace(['µ', 'μ'], "u").replace(['º', '˚'], "°").replace("⁻¹", "-1").replace('−', "-");
    name.replace([' ', '^', '\u{a0}'], "").replace("{-1}", "-1").replace("(-1)", "-1").replace(['·', '.'], "*")
}

/// The unit of that name: its name in messages and its size in SI. Capitals do not matter, except in names of one or two
/// characters (mA is not MA) other than Hz.
pub(super) fn find(quantity: Quantity, name: &str) -> Option<(&'static str, f64)> {
    let name = plain(name);
    let same = |known: &&str| {
        let known = plain(known);
        known == name
            || (known.chars().count() > 2 && known.eq_ignore_ascii_case(&name))
            || (known == "Hz" && name == "HZ")
    };
    quantity.iter().find(|(names, _)| names.iter().any(same)).map(|(names, factor)| (names[0], *factor))
}

/// Size in SI of one unit of a column by the calibration of its sensor: `25um/V`, `7.87V/mm`, or `0.3um` for each count. A voltage is in the unit of the
/// column if the header states one, or else in that of the calibration.
pub(super) fn calibrated(quantity: Quantity, calibration: &str, of_column: Option<&String>) -> Option<f64> {
    let (number, unit) = number_and_unit(calibration)?;
    let [size, volts] = [quantity, VOLTAGE].map(|quantity| move |name| find(quantity, name).map(|(_, size)| size));
    let per_volt = || unit.rsplit_once('/').and_then(|(of, volt)| Some((number * size(of)? / volts(volt)?, volt)));
    let volts_per = || unit.split_once('/').and_then(|(volt, of)| Some((size(of)? / (number * volts(volt)?), volt)));
    let sensor = per_volt().or_else(volts_per).and_then(|(per_volt, volt)| {
        let read = of_column.and_then(|unit| volts(unit)).or_else(|| volts(volt))?;
        Some(per_volt * read)
    });
    sensor.or_else(|| Some(number * size(unit)?)).filter(|size| size.is_normal())
}

/// Size of a unit in SI; without a name, that of the SI unit.
pub(super) fn factor(quantity: Quantity, name: &str) -> Option<f64> {
    if name.is_empty() { Some(1.0) } else { find(quantity, name).map(|(_, factor)| factor) }
}

/// Converts to SI. Division by a whole reciprocal rounds once, and keeps 100 µs at exactly 1e-4.
pub(super) fn in_si(number: f64, factor: f64) -> f64 {
    let per = (1.0 / factor).round();
    if factor < 1.0 && (factor * per - 1.0).abs() < 1e-12 { number / per } else { number * factor }
}

/// Whether any quantity of a signal has a unit of that name.
pub(super) fn is_unit(name: &str) -> bool {
    [TIME, LENGTH, CURRENT, ANGLE, SPEED, VOLTAGE].iter().any(|quantity| find(quantity, name).is_some())
}

/// The names that messages list.
pub(super) fn names(quantity: Quantity) -> String {
    let names = quantity.iter().map(|(names, _)| names[0]);
    names.filter(|name| *name != RATIO[0].0[0]).collect::<Vec<_>>().join(", ")
}

/// The sample time of a rate with its unit, `10kHz` or `9600 Hz`.
///
/// # Errors
/// The expected form.
pub fn rate_s(text: &str) -> Result<f64, String> {
    let wanted = || format!("{text}: expected a rate above 0 with its unit, as in 10kHz or 9600Hz");
    let (number, unit) = number_and_unit(text).ok_or_else(wanted)?;
    let factor = match unit.to_ascii_lowercase().as_str() {
        "hz" | "s/s" => 1.0,
        "khz" | "ks/s" => 1e3,
        "mhz" if unit.starts_with('M') => 1e6,
        _ => return Err(wanted()),
    };
    let value = 1.0 / (number * factor);
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err(wanted()) }
}

/// A finite number with or without a unit, in SI.
pub(super) fn value(text: &str, quantity: Quantity) -> Option<f64> {
    let (number, unit) = number_and_unit(text)?;
    Some(in_si(number, factor(quantity, unit)?)).filter(|value| value.is_finite())
}

/// A time in a unit that suits its size.
pub(super) fn time(seconds: f64) -> String {
    // A time that is below a unit only by rounding is shown in that unit.
    let (factor, name) = match seconds.abs() * (1.0 + 1e-9) {
        size if size >= 1.0 || size == 0.0 => (1.0, "s"),
        size if size >= 1e-3 => (1e3, "ms"),
        size if size >= 1e-6 => (1e6, "µs"),
        _ => (1e9, "ns"),
    };
    format!("{} {name}", significant(seconds * factor, 7))
}

/// A time, rounded to significant digits, with its unit.
pub(super) fn rounded_time(seconds: f64, digits: i32) -> String {
    time(significant(seconds, digits).parse().unwrap_or(seconds))
}

/// A time of a bench with its standard deviation, in µs.
pub(super) fn with_std(seconds: f64, std_s: f64) -> String {
    let [value, std] = [(seconds, 3), (std_s, 2)].map(|(of_s, digits)| significant(1e6 * of_s, digits));
    format!("{value} ± {std} µs")
}

/// A number, rounded to significant digits, without trailing zeros.
pub(super) fn significant(value: f64, digits: i32) -> String {
    if value == 0.0 || !value.is_finite() {
        // Without the sign of a zero.
        return format!("{}", value + 0.0);
    }
    let size = value.abs().log10().floor() as i32;
    if !(-4..15).contains(&size) {
        let rounded: f64 = format!("{:.*e}", digits as usize - 1, value).parse().unwrap_or(value);
        return format!("{rounded:e}");
    }
    let places = (digits - 1 - size).max(0) as usize;
    let text = format!("{value:.places$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}
