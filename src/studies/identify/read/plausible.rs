//! Misread units: what no magnetic bearing does, and signals that contradict each other.

use std::f64::consts::{PI, TAU};
use std::fmt;

use super::header::{CURRENTS, OMEGA, POSITIONS, SIGNALS, THETA, TIME_AT};
use super::units::{ANGLE, LENGTH, Quantity, SPEED, TIME, significant, time};
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
const REST_RAD_S: f64 = 1.0;

/// A signal that looks as if its unit were misread.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// The signal, as in the interface.
    pub signal: &'static str,
    /// What was found, with its unit.
    pub value: String,
    /// What may be behind it.
    pub suspicion: String,
    /// What to try; empty if nothing is known that would fit.
    pub remedy: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}: {}", self.signal, self.value, self.suspicion)?;
        if self.remedy.is_empty() { Ok(()) } else { write!(f, " ({})", self.remedy) }
    }
}

/// All findings.
pub(super) fn findings(samples: &Samples, gap_m: f64) -> Vec<Finding> {
    let mut findings = Vec::new();
    findings.extend(pace(samples));
    findings.extend(positions(samples, gap_m));
    findings.extend(currents(samples));
    let paced = !findings.iter().any(|finding| finding.signal == SIGNALS[TIME_AT].name);
    let before = findings.len();
    findings.extend(wrapping(samples));
    findings.extend(angle_against_speed(samples));
    // What follows goes by a speed that makes sense only if the time does, and says less than what was found.
    if paced && findings.len() == before {
        findings.extend(speed(samples));
    }
    if paced && findings.len() == before {
        findings.extend(motion_against_angle(samples));
    }
    findings
}

/// The units that a signal may have been recorded in instead, and how its values would change.
fn instead(quantity: Quantity, taken: Option<&'static str>) -> impl Iterator<Item = (&'static str, f64)> {
    let factor = quantity.iter().find(|(names, _)| Some(names[0]) == taken).map_or(1.0, |(_, factor)| *factor);
    let taken = taken.unwrap_or("");
    quantity.iter().map(move |(names, other)| (names[0], other / factor)).filter(move |(name, _)| *name != taken)
}

/// The name as people write it.
fn written(unit: &str) -> String {
    match unit {
        "um" => "µm".into(),
        "us" => "µs".into(),
        other => other.into(),
    }
}

/// `--unit`, or a question, for the units that would bring a value into a range.
fn remedy(at: usize, samples: &Samples, fits: impl Fn(f64) -> bool) -> (String, String) {
    let taken = samples.units[at];
    let units: Vec<String> =
        instead(SIGNALS[at].quantity, taken).filter(|(_, scale)| fits(*scale)).map(|(name, _)| written(name)).collect();
    let name = SIGNALS[at].name;
    let read = taken.map_or(String::new(), |taken| format!(" read as {}", written(taken)));
    match units.as_slice() {
        [] => ("no unit known here explains it".into(), String::new()),
        [one] => (format!("{one}{read}?"), format!("--unit {name}={one}")),
        several => (
            format!("{}{read}?", several.join(" or ")),
            several.iter().map(|unit| format!("--unit {name}={unit}")).collect::<Vec<_>>().join(" or "),
        ),
    }
}

fn pace(samples: &Samples) -> Option<Finding> {
    let fits = |step_s: f64| (STEP_S[0]..=STEP_S[1]).contains(&step_s);
    if fits(samples.step_s) {
        return None;
    }
    let value = format!(
        "a sample every {}, where {} to {} is usual",
        time(significant(samples.step_s, 4).parse().unwrap_or(samples.step_s)),
        time(STEP_S[0]),
        time(STEP_S[1])
    );
    let (suspicion, remedy) = if samples.units[TIME_AT].is_some() {
        remedy(TIME_AT, samples, |scale| fits(scale * samples.step_s))
    } else {
        ("the wrong rate?".into(), String::new())
    };
    Some(Finding { signal: "time", value, suspicion, remedy })
}

/// Lowest and highest of the known values.
fn range(values: &[f64]) -> Option<[f64; 2]> {
    let known = values.iter().copied().filter(|value| value.is_finite());
    known.map(|value| [value, value]).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

/// Standard deviation of the noise from fourth differences, whose squares sum to 70.
fn noise(values: &[f64]) -> f64 {
    let differences =
        values.windows(5).map(|v| v[0] - 4.0 * v[1] + 6.0 * v[2] - 4.0 * v[3] + v[4]).filter(|d| d.is_finite());
    let (sum, count) = differences.fold((0.0, 0.0), |(sum, count), d| (sum + d * d, count + 1.0));
    (sum / count / 70.0).sqrt()
}

fn positions(samples: &Samples, gap_m: f64) -> Vec<Finding> {
    let mut findings = Vec::new();
    let peak_to_peak = |axis: usize| range(&samples.position_m[axis]).map_or(0.0, |[low, high]| high - low);
    let still = [0, 1].iter().all(|axis| peak_to_peak(*axis) < STILL_M && noise(&samples.position_m[*axis]) < SILENT_M);
    for (axis, at) in POSITIONS.enumerate() {
        let Some([low, high]) = range(&samples.position_m[axis]) else { continue };
        let furthest = low.abs().max(high.abs());
        if furthest > gap_m {
            let value = format!(
                "up to {} mm from the centre, beyond the gap of {} mm",
                significant(furthest * 1e3, 4),
                significant(gap_m * 1e3, 4)
            );
            let (suspicion, remedy) =
                remedy(at, samples, |scale| scale * furthest < gap_m && scale * (high - low) > STILL_M);
            findings.push(Finding { signal: SIGNALS[at].name, value, suspicion, remedy });
        } else if still && peak_to_peak(axis) > 0.0 {
            let value = format!("it moves by {} nm only, and without noise", significant(peak_to_peak(axis) * 1e9, 3));
            let (suspicion, remedy) =
                remedy(at, samples, |scale| scale * peak_to_peak(axis) > STILL_M && scale * furthest < gap_m);
            findings.push(Finding { signal: SIGNALS[at].name, value, suspicion, remedy });
        }
    }
    // One axis in another unit than the other hides below the limits above.
    let [y, z] = [peak_to_peak(0), peak_to_peak(1)];
    if findings.is_empty() && y.min(z) > 0.0 && y.max(z) / y.min(z) > 300.0 {
        let small = usize::from(z < y);
        let at = POSITIONS.start + small;
        let fits = |scale: f64| (0.03..30.0).contains(&(scale * y.min(z) / y.max(z)));
        let named = samples.units[at];
        if instead(LENGTH, named).any(|(_, scale)| fits(scale)) && noise(&samples.position_m[small]) < SILENT_M {
            let value = format!(
                "it moves by {} µm, the other axis by {} µm",
                significant(y.min(z) * 1e6, 3),
                significant(y.max(z) * 1e6, 3)
            );
            let (suspicion, remedy) = remedy(at, samples, fits);
            findings.push(Finding { signal: SIGNALS[at].name, value, suspicion, remedy });
        }
    }
    findings
}

fn currents(samples: &Samples) -> Vec<Finding> {
    let fits = |current: f64| (CURRENT_A[0]..=CURRENT_A[1]).contains(&current);
    let mut findings = Vec::new();
    let of = |k: usize| samples.apart.as_ref().map_or(&samples.current_a[k], |(_, currents)| &currents[k]);
    let largest = [0, 1, 2].map(|k| range(of(k)).map_or(0.0, |[low, high]| low.abs().max(high.abs())));
    for (k, at) in CURRENTS.enumerate() {
        let strongest = largest[k];
        // A magnet that is switched off is not misread.
        let weak = strongest > 0.0 && strongest < CURRENT_A[0] && largest.iter().all(|other| *other < 50.0 * strongest);
        let odd = strongest > 0.0 && largest.iter().any(|other| *other > 300.0 * strongest) && noise(of(k)) < 2e-5;
        if strongest > CURRENT_A[1] || weak || odd {
            let value = format!("up to {} A", significant(strongest, 4));
            let (suspicion, remedy) = remedy(at, samples, |scale| fits(scale * strongest));
            findings.push(Finding { signal: SIGNALS[at].name, value, suspicion, remedy });
        }
    }
    findings
}

/// A wrapped angle says its unit by the size of a turn.
fn wrapping(samples: &Samples) -> Option<Finding> {
    let wrap = samples.wrap_rad?;
    let turns = |scale: f64| {
        let turns = scale * wrap / TAU;
        turns > 0.5 && (turns - turns.round()).abs() < 0.1 && turns < 4.5
    };
    if turns(1.0) {
        return None;
    }
    let value = format!("it wraps every {} rad, a turn is {} rad", significant(wrap, 5), significant(TAU, 5));
    let (suspicion, remedy) = remedy(THETA, samples, turns);
    Some(Finding { signal: "theta", value, suspicion, remedy })
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
    (count > 0.0 && (speeds > rest || slopes > rest)).then(|| if speeds > 0.0 { up / speeds } else { f64::INFINITY })
}

fn rpm(rad_s: f64) -> String {
    let digits = format!("{:.0}", (rad_s * 30.0 / PI).abs());
    // Groups of three, as in 171,887.
    let groups: Vec<&str> = {
        let head = digits.len() % 3;
        let (first, rest) = digits.split_at(head);
        std::iter::once(first)
            .filter(|group| !group.is_empty())
            .chain((0..rest.len() / 3).map(|n| &rest[3 * n..3 * n + 3]))
            .collect()
    };
    format!("{} rpm", groups.join(","))
}

/// Angle and speed, both recorded, must tell the same.
fn angle_against_speed(samples: &Samples) -> Option<Finding> {
    let ratio = slope_over_speed(samples)?;
    let agrees = |scale: f64| (ratio * scale - 1.0).abs() < AGREE;
    if agrees(1.0) {
        return None;
    }
    let mut suspects = Vec::new();
    let mut remedies = Vec::new();
    for (at, quantity, power) in [(THETA, ANGLE, 1.0), (OMEGA, SPEED, -1.0), (TIME_AT, TIME, -1.0)] {
        let Some(taken) = samples.units[at] else { continue };
        for (name, _) in instead(quantity, Some(taken)).filter(|(_, scale)| agrees(scale.powf(power))) {
            suspects.push(format!("{} in {} read as {}", SIGNALS[at].name, written(name), written(taken)));
            remedies.push(format!("--unit {}={}", SIGNALS[at].name, written(name)));
        }
    }
    let speed = middle(&samples.omega_rad_s);
    let value = format!("the angle turns at {}, the speed is {}", rpm(ratio * speed), rpm(speed));
    let suspicion = if !suspects.is_empty() {
        format!("{}?", suspects.join(", or "))
    } else if agrees(-1.0) {
        "they have opposite directions".into()
    } else {
        "no unit known here explains it".into()
    };
    Some(Finding { signal: "theta", value, suspicion, remedy: remedies.join(" or ") })
}

/// The median of the known values.
fn middle(values: &[f64]) -> f64 {
    let mut known: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    if known.is_empty() {
        return 0.0;
    }
    let middle = known.len() / 2;
    *known.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Where the speed comes from: the signal whose unit tells it.
fn source(samples: &Samples) -> Option<usize> {
    match samples.rotation {
        Rotation::Angle | Rotation::Both => Some(THETA),
        Rotation::Speed => Some(OMEGA),
        Rotation::Told | Rotation::Unknown => None,
    }
}

/// Speeds that no rotor has, or no controller follows.
fn speed(samples: &Samples) -> Option<Finding> {
    let speed = middle(&samples.omega_rad_s).abs();
    let fits = |speed: f64| speed <= SPEED_RAD_S && speed * samples.step_s <= TAU / SAMPLES_PER_TURN;
    if fits(speed) {
        return None;
    }
    let turn = TAU / speed / samples.step_s;
    let value = format!("{}, {} samples a turn", rpm(speed), significant(turn, 3));
    match source(samples) {
        Some(at) => {
            // A rotor that hardly turns is no better explanation.
            let (suspicion, remedy) = remedy(at, samples, |scale| fits(scale * speed) && scale * speed > REST_RAD_S);
            Some(Finding { signal: SIGNALS[at].name, value, suspicion, remedy })
        }
        None => Some(Finding { signal: "omega", value, suspicion: "--speed is in rpm".into(), remedy: String::new() }),
    }
}

/// Part of the motion that goes with the angle times a factor, its first four harmonics forwards and backwards.
fn synchronous(samples: &Samples, factor: f64) -> Option<f64> {
    const HARMONICS: i32 = 4;
    /// So many samples are enough to tell.
    const SEEN: usize = 100_000;
    let seen = samples.len().min(SEEN);
    let theta = &samples.theta_rad[..seen.min(samples.theta_rad.len())];
    let rows: Vec<usize> = (0..theta.len())
        .filter(|j| theta[*j].is_finite() && samples.position_m.iter().all(|axis| axis[*j].is_finite()))
        .collect();
    let turned = range(theta).map_or(0.0, |[low, high]| factor * (high - low));
    // Less than two turns say little, and fast ones are confused with slow ones.
    if turned < 2.0 * TAU || turned / theta.len() as f64 > PI / f64::from(HARMONICS) {
        return None;
    }
    let count = rows.len() as f64;
    let mean = [0, 1].map(|axis| rows.iter().map(|j| samples.position_m[axis][*j]).sum::<f64>() / count);
    let at = |j: usize| [0, 1].map(|axis| samples.position_m[axis][j] - mean[axis]);
    let all: f64 = rows.iter().map(|j| at(*j)).map(|[y, z]| y * y + z * z).sum::<f64>() / count;
    let mut part = 0.0;
    for n in (-HARMONICS..=HARMONICS).filter(|n| *n != 0) {
        let (mut re, mut im) = (0.0, 0.0);
        for j in &rows {
            let [y, z] = at(*j);
            let (sin, cos) = libm::sincos(f64::from(n) * factor * theta[*j]);
            re += y * cos + z * sin;
            im += z * cos - y * sin;
        }
        part += (re * re + im * im) / (count * count);
    }
    (all > 0.0).then_some(part / all)
}

/// A rotor moves with its own rotation; where it moves with another one instead, angle, speed or time are misread.
fn motion_against_angle(samples: &Samples) -> Option<Finding> {
    /// Part of the motion below which the angle as read explains nothing, and above which another one does.
    const NOTHING: f64 = 0.2;
    const MOST: f64 = 0.6;
    if samples.theta_rad.is_empty() || synchronous(samples, 1.0).is_some_and(|part| part > NOTHING) {
        return None;
    }
    let mut candidates: Vec<(String, String, f64)> = Vec::new();
    let mut add = |at: usize, quantity: Quantity, power: f64| {
        let Some(taken) = samples.units[at] else { return };
        for (name, scale) in instead(quantity, Some(taken)) {
            let [name, taken] = [name, taken].map(written);
            let signal = SIGNALS[at].name;
            candidates.push((
                format!("{signal} in {name} read as {taken}?"),
                format!("--unit {signal}={name}"),
                scale.powf(power),
            ));
        }
    };
    match samples.rotation {
        Rotation::Angle | Rotation::Both => add(THETA, ANGLE, 1.0),
        Rotation::Speed => {
            add(OMEGA, SPEED, 1.0);
            add(TIME_AT, TIME, 1.0);
        }
        Rotation::Told => {
            add(TIME_AT, TIME, 1.0);
            for (unit, scale) in [("Hz", 60.0), ("rad/s", 30.0 / PI)] {
                candidates.push((format!("--speed given in {unit}, which is in rpm?"), String::new(), scale));
            }
        }
        Rotation::Unknown => {}
    }
    let parts = candidates.into_iter().filter_map(|candidate| Some((synchronous(samples, candidate.2)?, candidate)));
    let (part, (suspicion, remedy, scale)) =
        parts.filter(|(part, _)| *part > MOST).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let speed = middle(&samples.omega_rad_s);
    let value =
        format!("{}, while {:.0} % of the motion turns at {}", rpm(speed), 100.0 * part.min(1.0), rpm(speed * scale));
    let signal = source(samples).map_or("omega", |at| SIGNALS[at].name);
    Some(Finding { signal, value, suspicion, remedy })
}
