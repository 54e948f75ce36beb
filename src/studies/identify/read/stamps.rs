//! Formats of time stamps: numbers with a unit, Unix times, ISO 8601.

use super::header::Unit;
use super::text;
use crate::studies::identify::units::{TIME, in_si};

/// Unix times from 2000 to 2100, in seconds.
const EPOCH_S: std::ops::Range<f64> = 946_684_800.0..4_102_444_800.0;

/// Format of the time stamps of a recording.
pub(super) struct Stamps {
    /// Unit of numbers: its name and its size in s; `None` for civil or absolute times.
    pub unit: Option<Unit>,
    /// Origin of large numbers, in their unit, and of times, in ns, so that nanoseconds survive.
    origin: i128,
}

/// Integer and fractional part of a stamp in plain decimal notation; 0 and the value of any other number.
fn parts(cell: &str, separator: char) -> Option<(i64, f64)> {
    let is_point = |c: char| c == '.' || (c == ',' && separator != ',');
    let (whole, fraction) = cell.split_at(cell.find(is_point).unwrap_or(cell.len()));
    let is_plain = cell.chars().all(|c| c.is_ascii_digit() || is_point(c));
    match whole.parse() {
        Ok(whole) if is_plain => Some((whole, text::number(&format!("0{fraction}"), separator)?)),
        _ => text::number(cell, separator).map(|value| (0, value)),
    }
}

/// ISO 8601 as nanoseconds from a fixed instant: with an offset, without one, or the time of day alone.
fn iso_ns(cell: &str) -> Option<i128> {
    let day = jiff::civil::date(1970, 1, 1);
    let civil = || cell.parse().or_else(|_| cell.parse().map(|time| day.to_datetime(time))).ok();
    let absolute = || civil()?.to_zoned(jiff::tz::TimeZone::UTC).ok().map(|zoned| zoned.timestamp());
    cell.parse().ok().or_else(absolute).map(jiff::Timestamp::as_nanosecond)
}

impl Stamps {
    /// The format of the stamps by the first of them and the stated unit, if any; with a remark, if any.
    ///
    /// # Errors
    /// The stamp is not a time, or contradicts the unit.
    pub(super) fn of(first: &str, separator: char, unit: Option<Unit>) -> Result<(Self, Option<String>), String> {
        let Some((whole, fraction)) = parts(first, separator) else {
            let origin = iso_ns(first)
                .ok_or_else(|| format!("{first:?} is not a time: expected a number or an ISO 8601 stamp"))?;
            return Ok((Self { unit: None, origin }, Some(format!("Time counts from {first}."))));
        };
        let value = whole as f64 + fraction;
        let Some(([name, ..], factor)) = TIME.iter().find(|(_, factor)| EPOCH_S.contains(&(value * factor))) else {
            let note = unit.is_none().then(|| "time has no unit; it is taken to be in s.".to_owned());
            return Ok((Self { unit: unit.or(Some(("s", 1.0))), origin: 0 }, note));
        };
        if let Some((given, _)) = unit.filter(|(_, given)| given != factor) {
            return Err(format!("the first stamp is {first} {given}: a Unix time in {name}? Then --unit time={name}"));
        }
        let note = format!("The stamps are Unix times in {name}; time counts from the first, {first}.");
        Ok((Self { unit: Some((name, *factor)), origin: whole.into() }, Some(note)))
    }

    /// The origin of the times, in ns of the clock.
    pub(super) fn origin_ns(&self) -> i128 {
        self.origin * self.unit.map_or(1, |(_, factor)| (factor * 1e9).round() as i128)
    }

    /// A stamp in seconds; NaN if it is missing, `None` if it is not a time.
    pub(super) fn seconds(&self, cell: &str, separator: char) -> Option<f64> {
        match self.unit {
            Some((_, factor)) => {
                let (whole, fraction) = parts(cell, separator)?;
                Some(in_si(whole.wrapping_sub(self.origin as i64) as f64 + fraction, factor))
            }
            None if text::missing(cell) => Some(f64::NAN),
            None => Some((iso_ns(cell)? - self.origin) as f64 * 1e-9),
        }
    }
}
