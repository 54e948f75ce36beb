//! Misread units: values that no magnetic bearing has, and signals that contradict each other.

use std::f64::consts::{PI, TAU};
use std::fmt;

use super::header::{Signals, TIME_AT};
use super::signals::{median, noise, range};
use super::units::{rounded_time, significant, time};
use super::{Rotation, Samples};

/// Sample times of controllers and recorders of magnetic bearings, in s: 2 MHz to 500 Hz.
const STEP_S: [f64; 2] = [0.5e-6, 2e-3];
/// Largest currents, in A. A few milliamperes carry no rotor, and no bearing of this kind takes hundreds of amperes.
const CURRENT_A: [f64; 2] = [20e-3, 200.0];
/// Fastest rotor, in rad/s: 150,000 rpm.
const SPEED_RAD_S: f64 = 150_000.0 * PI / 30.0;
/// A controller takes so many samples a turn at least, or the rotor would not levitate.
const SAMPLES_PER_TURN: f64 = 8.0;
/// Motion of less than 1 µm peak to peak ...
const STILL_M: f64 = 1e-6;
/// ... without at least 5 nm of noise is none that a sensor of position would show: they have 50 nm to 2 µm.
const SILENT_M: f64 = 5e-9;
/// The slope of the angle and the speed may differ by so much.
const AGREE: f64 = 0.05;
/// Below this speed, in rad/s, the rotor counts as being at rest.
pub const REST_RAD_S: f64 = 1.0;

/// A signal that looks as if its unit were misread.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// The signal, as in the interface.
    pub signal: String,
    /// The value, with its unit.
    pub value: String,
    /// The likely cause.
    pub suspicion: String,
    /// Options to try; empty if nothing is known that would fit.
    pub remedy: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}: {}", self.signal, self.value, self.suspicion)?;
        if self.remedy.is_empty() { Ok(()) } else { write!(f, " ({})", self.remedy) }
    }
}

/// All findings, with the gap of each bearing in m.
pub(super) fn findings(samples: &Samples, gap_m: &[f64]) -> Vec<Finding> {
    let mut findings: Vec<Finding> = pace(samples).into_iter().collect();
    let is_paced = findings.is_empty();
    for (bearing, gap_m) in samples.machine.bearings.iter().zip(gap_m) {
        findings.extend(positions(samples, bearing.prefix, *gap_m));
    }
    findings.extend(currents(samples));
    let before = findings.len();
    findings.extend(wrapping(samples));
    findings.extend(angle_against_speed(samples));
    // The other checks go by a speed that makes sense only if the time does, and say less than these.
    if is_paced && findings.len() == before {
        findings.extend(speed(samples).or_else(|| motion_against_angle(samples)));
    }
    findings
}

/// The name as people write it.
fn written(unit: &str) -> &str {
    match unit {
        "um" => "µm",
        "us" => "µs",
        other => other,
    }
}

/// The signals of the recording.
fn signals(samples: &Samples) -> Signals {
    Signals::of(samples.machine)
}

/// The units that a signal may have been recorded in instead of that in which it was read, and how its values would change.
fn instead(at: usize, samples: &Samples) -> Vec<(&'static str, f64)> {
    let quantity = signals(samples).list[at].quantity;
    let taken = quantity.iter().find(|(names, _)| Some(names[0]) == samples.units[at]).unwrap_or(&quantity[0]);
    quantity.iter().filter(|unit| *unit != taken).map(|(names, factor)| (written(names[0]), factor / taken.1)).collect()
}

/// A finding with the units that would bring the value into a range: `fits` says of a factor whether it would.
fn misread(at: usize, samples: &Samples, value: String, fits: impl Fn(f64) -> bool) -> Finding {
    let signal = signals(samples).list.swap_remove(at).name;
    let units: Vec<&str> =
        instead(at, samples).into_iter().filter(|(_, scale)| fits(*scale)).map(|(name, _)| name).collect();
    let read = samples.units[at].map_or(String::new(), |taken| format!(" read as {}", written(taken)));
    let suspicion = match units.as_slice() {
        [] => "no unit known here explains it".into(),
        units => format!("{}{read}?", units.join(" or ")),
    };
    let remedies: Vec<String> = units.iter().map(|unit| format!("--unit {signal}={unit}")).collect();
    Finding { signal, value, suspicion, remedy: remedies.join(" or ") }
}

fn pace(samples: &Samples) -> Option<Finding> {
    let fits = |step_s: f64| (STEP_S[0]..=STEP_S[1]).contains(&step_s);
    let [least, most] = STEP_S.map(time);
    let value = format!("a sample every {}, where {least} to {most} is usual", rounded_time(samples.step_s, 4));
    let finding = || match samples.units[TIME_AT] {
        Some(_) => misread(TIME_AT, samples, value, |scale| fits(scale * samples.step_s)),
        None => Finding { signal: "time".into(), value, suspicion: "the wrong rate?".into(), remedy: String::new() },
    };
    (!fits(samples.step_s)).then(finding)
}

/// Findings about the positions at the bearing with that prefix.
fn positions(samples: &Samples, bearing: &str, gap_m: f64) -> Vec<Finding> {
    let mut findings = Vec::new();
    let start = signals(samples).positions.start;
    let readings = samples.machine.readings;
    let axes: Vec<usize> = (0..readings.len()).filter(|axis| readings[*axis].around.0 == bearing).collect();
    let ranges: Vec<_> = samples.position_m.iter().map(|position| range(position.iter().copied())).collect();
    let spans: Vec<f64> = ranges.iter().map(|[low, high]| high - low).collect();
    let is_silent = |axis: usize| noise(&samples.position_m[axis]) < SILENT_M;
    let is_still = axes.iter().all(|axis| spans[*axis] < STILL_M && is_silent(*axis));
    for axis in axes.iter().copied() {
        let (at, span, furthest) = (start + axis, spans[axis], ranges[axis][0].abs().max(ranges[axis][1].abs()));
        let fits = |scale: f64| scale * furthest < gap_m && scale * span > STILL_M;
        if furthest > gap_m {
            let [furthest, gap] = [furthest, gap_m].map(|length_m| significant(length_m * 1e3, 4));
            let value = format!("up to {furthest} mm from the centre, beyond the gap of {gap} mm");
            findings.push(misread(at, samples, value, fits));
        } else if is_still && span > 0.0 {
            let value = format!("it moves by {} nm only, and without noise", significant(span * 1e9, 3));
            findings.push(misread(at, samples, value, fits));
        }
    }
    // One axis in another unit than the other hides below the limits above.
    let [one, other] = axes[..] else { return findings };
    let (small, large) = if spans[other] < spans[one] { (other, one) } else { (one, other) };
    let (least, most) = (spans[small], spans[large]);
    if findings.is_empty() && least > 0.0 && most / least > 300.0 {
        let at = start + small;
        let fits = |scale: f64| (0.03..30.0).contains(&(scale * least / most));
        if instead(at, samples).iter().any(|(_, scale)| fits(*scale)) && is_silent(small) {
            let [own, other] = [least, most].map(|span| significant(span * 1e6, 3));
            let value = format!("it moves by {own} µm, the other axis by {other} µm");
            findings.push(misread(at, samples, value, fits));
        }
    }
    findings
}

fn currents(samples: &Samples) -> Vec<Finding> {
    let currents: Vec<Vec<f64>> = match &samples.apart {
        Some(apart) => apart.iter().map(|current| current.iter().map(|(_, value)| *value).collect()).collect(),
        None => samples.current_a.clone(),
    };
    let largest: Vec<f64> = currents.iter().map(|current| range(current.iter().map(|value| value.abs()))[1]).collect();
    let start = signals(samples).currents.start;
    let is_misread = |k: &usize| {
        let strongest = largest[*k];
        // A magnet that is switched off is not misread.
        let weak = strongest < CURRENT_A[0] && largest.iter().all(|other| *other < 50.0 * strongest);
        let odd = largest.iter().any(|other| *other > 300.0 * strongest) && noise(&currents[*k]) < 2e-5;
        strongest > CURRENT_A[1] || strongest > 0.0 && (weak || odd)
    };
    let finding = |k: usize| {
        let fits = |scale: f64| (CURRENT_A[0]..=CURRENT_A[1]).contains(&(scale * largest[k]));
        misread(start + k, samples, format!("up to {} A", significant(largest[k], 4)), fits)
    };
    (0..currents.len()).filter(is_misread).map(finding).collect()
}

/// A wrapped angle shows its unit by the size of a turn.
fn wrapping(samples: &Samples) -> Option<Finding> {
    let wrap = samples.wrap_rad?;
    let fits = |scale: f64| {
        let turns = scale * wrap / TAU;
        turns > 0.5 && (turns - turns.round()).abs() < 0.1 && turns < 4.5
    };
    let value = format!("it wraps every {} rad, a turn is {} rad", significant(wrap, 5), significant(TAU, 5));
    (!fits(1.0)).then(|| misread(signals(samples).theta, samples, value, fits))
}

/// The slope of the angle over the speed, by least squares; none at rest.
fn slope_over_speed(samples: &Samples) -> Option<f64> {
    if samples.rotation != Rotation::Both {
        return None;
    }
    let (mut up, mut speeds, mut slopes, mut count) = (0.0, 0.0, 0.0, 0.0_f64);
    for (theta, omega) in samples.theta_rad.windows(2).zip(samples.omega_rad_s.windows(2)) {
        let (slope, omega) = ((theta[1] - theta[0]) / samples.step_s, 0.5 * (omega[0] + omega[1]));
        if slope.is_finite() && omega.is_finite() {
            up += slope * omega;
            speeds += omega * omega;
            slopes += slope * slope;
            count += 1.0;
        }
    }
    let rest = REST_RAD_S * REST_RAD_S * count;
    (speeds > rest || slopes > rest).then(|| if speeds > 0.0 { up / speeds } else { f64::INFINITY })
}

fn rpm(rad_s: f64) -> String {
    format!("{:.0} rpm", (rad_s * 30.0 / PI).abs())
}

/// Other units of a signal in words, the remedy, and how the speed or angle would change; `power` is −1 for signals that divide it.
fn alternatives(samples: &Samples, suspects: &[(usize, i32)]) -> Vec<(String, String, f64)> {
    let of = |(at, power): &(usize, i32)| {
        let (signal, power) = (signals(samples).list.swap_remove(*at).name, *power);
        let other = move |taken: &'static str, (name, scale): (&str, f64)| {
            let words = format!("{signal} in {name} read as {}", written(taken));
            (words, format!("--unit {signal}={name}"), scale.powi(power))
        };
        let others =
            samples.units[*at].map(|taken| instead(*at, samples).into_iter().map(move |unit| other(taken, unit)));
        others.into_iter().flatten()
    };
    suspects.iter().flat_map(of).collect()
}

/// Angle and speed, both recorded, must agree.
fn angle_against_speed(samples: &Samples) -> Option<Finding> {
    let ratio = slope_over_speed(samples)?;
    let agrees = |scale: f64| (ratio * scale - 1.0).abs() < AGREE;
    if agrees(1.0) {
        return None;
    }
    let Signals { theta, omega, .. } = signals(samples);
    let suspects = alternatives(samples, &[(theta, 1), (omega, -1), (TIME_AT, -1)]);
    let suspects: Vec<_> = suspects.into_iter().filter(|(_, _, scale)| agrees(*scale)).collect();
    let joined =
        |by: &str, text: fn(&(String, String, f64)) -> &str| suspects.iter().map(text).collect::<Vec<_>>().join(by);
    let speed = median(samples.omega_rad_s.iter().copied());
    let value = format!("the angle turns at {}, the speed is {}", rpm(ratio * speed), rpm(speed));
    let suspicion = if !suspects.is_empty() {
        format!("{}?", joined(", or ", |suspect| &suspect.0))
    } else if agrees(-1.0) {
        "they have opposite directions".into()
    } else {
        "no unit known here explains it".into()
    };
    Some(Finding { signal: "theta".into(), value, suspicion, remedy: joined(" or ", |suspect| &suspect.1) })
}

/// Where the speed comes from: the signal whose unit decides it.
fn source(samples: &Samples) -> Option<usize> {
    match samples.rotation {
        Rotation::Angle | Rotation::Both => Some(signals(samples).theta),
        Rotation::Speed => Some(signals(samples).omega),
        Rotation::Told | Rotation::Unknown => None,
    }
}

/// Speeds that no rotor has, or no controller follows.
fn speed(samples: &Samples) -> Option<Finding> {
    let speed = median(samples.omega_rad_s.iter().copied()).abs();
    let fits = |speed: f64| speed <= SPEED_RAD_S && speed * samples.step_s <= TAU / SAMPLES_PER_TURN;
    if fits(speed) || speed.is_nan() {
        return None;
    }
    let value = format!("{}, {} samples a turn", rpm(speed), significant(TAU / speed / samples.step_s, 3));
    Some(match source(samples) {
        // A rotor that hardly turns is no better explanation.
        Some(at) => misread(at, samples, value, |scale| fits(scale * speed) && scale * speed > REST_RAD_S),
        None => Finding { signal: "omega".into(), value, suspicion: "--speed is in rpm".into(), remedy: String::new() },
    })
}

/// Part of the motion that goes with the angle times a factor, its first four harmonics forwards and backwards.
fn synchronous(samples: &Samples, factor: f64) -> Option<f64> {
    const HARMONICS: i32 = 4;
    /// So many samples are enough to tell.
    const SEEN: usize = 100_000;
    let theta = &samples.theta_rad[..samples.theta_rad.len().min(SEEN)];
    let [low, high] = range(theta.iter().copied());
    let turned = factor * (high - low);
    // Less than two turns show little, and fast ones are confused with slow ones.
    if turned < 2.0 * TAU || turned / theta.len() as f64 > PI / f64::from(HARMONICS) {
        return None;
    }
    let rows =
        theta.iter().zip(&samples.position_m[0]).zip(&samples.position_m[1]).map(|((theta, y), z)| [*theta, *y, *z]);
    let mut rows: Vec<[f64; 3]> = rows.filter(|row| row.iter().all(|value| value.is_finite())).collect();
    let count = rows.len() as f64;
    for axis in 1..3 {
        let mean = rows.iter().map(|row| row[axis]).sum::<f64>() / count;
        rows.iter_mut().for_each(|row| row[axis] -= mean);
    }
    let all: f64 = rows.iter().map(|[_, y, z]| y * y + z * z).sum::<f64>() / count;
    let part = |n: i32| {
        let (re, im) = rows.iter().fold((0.0, 0.0), |(re, im), [theta, y, z]| {
            let (sin, cos) = libm::sincos(f64::from(n) * factor * theta);
            (re + y * cos + z * sin, im + z * cos - y * sin)
        });
        (re * re + im * im) / (count * count)
    };
    (all > 0.0).then(|| (-HARMONICS..=HARMONICS).filter(|n| *n != 0).map(part).sum::<f64>() / all)
}

/// A rotor moves with its own rotation; where it moves with another one instead, angle, speed or time are misread.
fn motion_against_angle(samples: &Samples) -> Option<Finding> {
    /// Part of the motion below which the angle as read explains nothing, and above which another one does.
    const NOTHING: f64 = 0.2;
    const MOST: f64 = 0.6;
    if samples.theta_rad.is_empty() || synchronous(samples, 1.0).is_some_and(|part| part > NOTHING) {
        return None;
    }
    let Signals { theta, omega, mut list, .. } = signals(samples);
    let suspects = match samples.rotation {
        Rotation::Angle | Rotation::Both => vec![(theta, 1)],
        Rotation::Speed => vec![(omega, 1), (TIME_AT, 1)],
        Rotation::Told => vec![(TIME_AT, 1)],
        Rotation::Unknown => Vec::new(),
    };
    let mut candidates = alternatives(samples, &suspects);
    if samples.rotation == Rotation::Told {
        let given =
            |(unit, scale): (&str, f64)| (format!("--speed given in {unit}, which is in rpm"), String::new(), scale);
        candidates.extend([("Hz", 60.0), ("rad/s", 30.0 / PI)].map(given));
    }
    let parts = candidates.into_iter().filter_map(|candidate| Some((synchronous(samples, candidate.2)?, candidate)));
    let (part, (suspicion, remedy, scale)) =
        parts.filter(|(part, _)| *part > MOST).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let speed = median(samples.omega_rad_s.iter().copied());
    let (own, other) = (rpm(speed), rpm(speed * scale));
    let value = format!("{own}, while {:.0} % of the motion turns at {other}", 100.0 * part.min(1.0));
    let signal = list.swap_remove(source(samples).unwrap_or(omega)).name;
    Some(Finding { signal, value, suspicion: format!("{suspicion}?"), remedy })
}
