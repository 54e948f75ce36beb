//! Time stamps as they are written: numbers in a unit, Unix epochs, ISO 8601.

use super::text;
use super::units::TIME;

/// Unix times from 2000 to 2100, in seconds.
const EPOCH_S: std::ops::Range<f64> = 946_684_800.0..4_102_444_800.0;

/// How the time stamps of a recording are written. Large numbers count from the first stamp, so that nanoseconds survive.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Stamps {
    /// Numbers in a unit of so many seconds, whose name stands beside it.
    Number { unit: (&'static str, f64), origin: i64 },
    /// Civil or absolute times, counted from this one in nanoseconds.
    Iso { origin: i128 },
}

/// A stamp in plain decimal notation as whole units and the rest; others as a rest alone.
fn parts(cell: &[u8], separator: char) -> Option<(i64, f64)> {
    let point = cell.iter().position(|byte| *byte == b'.' || (*byte == b',' && separator != ','));
    let whole = &cell[..point.unwrap_or(cell.len())];
    if !whole.is_empty()
        && whole.iter().all(u8::is_ascii_digit)
        && let Some(whole) = std::str::from_utf8(whole).ok().and_then(|text| text.parse::<i64>().ok())
    {
        let rest = point.map_or(&b""[..], |point| &cell[point..]);
        if rest.len() <= 1 {
            return Some((whole, 0.0));
        }
        if rest[1..].iter().all(u8::is_ascii_digit) {
            return Some((whole, text::number(&[b"0", rest].concat(), separator)?));
        }
    }
    text::number(cell, separator).map(|value| (0, value))
}

/// ISO 8601 as nanoseconds from some instant: with an offset, without one, or the time of day alone.
fn iso_ns(cell: &[u8]) -> Option<i128> {
    let cell = std::str::from_utf8(cell).ok()?.trim();
    if let Ok(absolute) = cell.parse::<jiff::Timestamp>() {
        return Some(absolute.as_nanosecond());
    }
    let civil = cell
        .parse::<jiff::civil::DateTime>()
        .ok()
        .or_else(|| Some(jiff::civil::date(1970, 1, 1).to_datetime(cell.parse::<jiff::civil::Time>().ok()?)))?;
    Some(civil.to_zoned(jiff::tz::TimeZone::UTC).ok()?.timestamp().as_nanosecond())
}

impl Stamps {
    /// How the stamps are written, by the first of them; the unit is that of the header or told, if any. Beside it what there
    /// is to say.
    ///
    /// # Errors
    /// What contradicts the unit.
    pub(super) fn of(
        first: &[u8],
        separator: char,
        unit: Option<(&'static str, f64)>,
    ) -> Result<(Self, Option<String>), String> {
        let shown = String::from_utf8_lossy(first);
        let Some((whole, rest)) = parts(first, separator) else {
            return match iso_ns(first) {
                Some(origin) => Ok((Self::Iso { origin }, Some(format!("Time counts from {shown}.")))),
                None => Err(format!("{shown:?} is no time: a number or an ISO 8601 stamp is wanted")),
            };
        };
        let value = whole as f64 + rest;
        let epoch = TIME.iter().find(|(_, factor)| EPOCH_S.contains(&(value * factor)));
        match (unit, epoch) {
            (Some(told), Some((names, factor))) if told.1 != *factor => Err(format!(
                "the first stamp is {shown} {}: a Unix time in {1}? Then --unit time={1}",
                told.0, names[0]
            )),
            (told, Some((names, factor))) => {
                let unit = told.unwrap_or((names[0], *factor));
                let note = format!("The stamps are Unix times in {}; time counts from the first, {shown}.", unit.0);
                Ok((Self::Number { unit, origin: whole }, Some(note)))
            }
            (told, None) => {
                let note = told.is_none().then(|| "time has no unit; it is taken to be in s.".to_owned());
                Ok((Self::Number { unit: told.unwrap_or(("s", 1.0)), origin: 0 }, note))
            }
        }
    }

    /// What the times count from, in ns of the clock.
    pub(super) fn origin_ns(&self) -> i128 {
        match self {
            Self::Number { unit: (_, factor), origin } => i128::from(*origin) * (factor * 1e9).round() as i128,
            Self::Iso { origin } => *origin,
        }
    }

    /// The name of the unit, where there is one.
    pub(super) fn unit(&self) -> Option<&'static str> {
        match self {
            Self::Number { unit, .. } => Some(unit.0),
            Self::Iso { .. } => None,
        }
    }

    /// A stamp in seconds; NaN if it is missing, `None` if it is none.
    pub(super) fn seconds(&self, cell: &[u8], separator: char) -> Option<f64> {
        match self {
            Self::Number { unit: (_, factor), origin } => {
                let (whole, rest) = parts(cell, separator)?;
                let value = (whole.wrapping_sub(*origin)) as f64 + rest;
                // Dividing by the whole reciprocal rounds once.
                Some(if *factor < 1.0 { value / (1.0 / factor).round() } else { value * factor })
            }
            Self::Iso { .. } if text::missing(std::str::from_utf8(cell).ok()?.trim()) => Some(f64::NAN),
            Self::Iso { origin } => Some((iso_ns(cell)? - origin) as f64 * 1e-9),
        }
    }
}
