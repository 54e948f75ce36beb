//! Misread units: values that no magnetic bearing has, and signals that contradict each other.

use std::f64::consts::{PI, TAU};

use nalgebra::Complex;

use super::read::{Signals, TIME_AT};
use super::samples::{Rotation, Samples};
use super::units::{rounded_time, significant, time};
use crate::estimation::Hold;
use crate::studies::statistics::{median, noise, range};

/// Sample times of controllers and recorders of magnetic bearings, in s: 2 MHz to 500 Hz.
const STEP_S: [f64; 2] = [0.5e-6, 2e-3];
/// Plausible largest currents, in A: a few milliamperes carry no rotor, and no bearing of this kind takes hundreds of amperes.
const CURRENT_A: [f64; 2] = [20e-3, 200.0];
/// Fastest rotor, in rad/s: 150,000 rpm.
const SPEED_RAD_S: f64 = 150_000.0 * PI / 30.0;
/// Minimum number of samples per turn: with fewer, no controller levitates a rotor.
const SAMPLES_PER_TURN: f64 = 8.0;
/// Greatest plausible distance of a levitated body from the origin, in m, where the gap is unknown: beyond it, magnets need hundreds of amperes.
const TRAVEL_M: f64 = 0.5;
/// Motion of less than 1 µm peak to peak ...
const STILL_M: f64 = 1e-6;
/// ... with less than 5 nm of noise does not come from a position sensor: they have 50 nm to 2 µm.
const SILENT_M: f64 = 5e-9;
/// Greatest relative difference between the slope of the angle and the speed.
const AGREE: f64 = 0.05;
/// Below this speed, in rad/s, the rotor counts as being at rest.
pub const REST_RAD_S: f64 = 1.0;

impl Samples {
    /// Signs of a misread unit, by magnitude and by comparing the signals; `gap_m` is the nominal air gap of each bearing
    /// in m, infinite if it is unknown. A recording with findings must not be used.
    pub fn implausible(&self, gap_m: &[f64]) -> Vec<String> {
        let current_a = self.currents(Hold::Linear);
        let checks = Checks { samples: self, signals: Signals::of(self.machine), current_a };
        // A mass without a shaft may be sampled at any rate.
        let pace = if self.machine.planes > 0 { checks.pace() } else { None };
        let mut rotation: Vec<String> = checks.wrapping().into_iter().chain(checks.angle_against_speed()).collect();
        // The other checks use a speed, which needs a correct time, and are less specific.
        if pace.is_none() && rotation.is_empty() {
            rotation.extend(checks.speed().or_else(|| checks.motion_against_angle()));
        }
        let positions = gap_m.iter().enumerate().flat_map(|(bearing, gap_m)| checks.positions(bearing, *gap_m));
        pace.into_iter().chain(positions).chain(checks.currents()).chain(rotation).collect()
    }
}

fn rpm(rad_s: f64) -> String {
    format!("{:.0} rpm", (rad_s * 30.0 / PI).abs())
}

/// Checks of a recording with the signals of its machine.
struct Checks<'s> {
    samples: &'s Samples,
    signals: Signals,
    /// Currents by magnet; those of an unused magnet are empty.
    current_a: Vec<Vec<f64>>,
}

impl Checks<'_> {
    /// Other units that a signal may have been recorded in, and the factors that they would apply to its values.
    fn other_units(&self, at: usize) -> impl Iterator<Item = (&'static str, f64)> {
        let (quantity, unit) = (self.signals.list[at].quantity, self.samples.units[at]);
        let taken = quantity.iter().find(|(names, _)| Some(names[0]) == unit).unwrap_or(&quantity[0]);
        let others = quantity.iter().filter(move |unit| *unit != taken);
        others.map(|(names, factor)| (names[0], factor / taken.1))
    }

    /// The finding for an implausible value of a signal: units that would explain it, and options to try. The unit of each suspect enters
    /// the value to a power; `fits` tests a factor of the value.
    fn misread(&self, at: usize, value: &str, suspects: &[(usize, i32)], fits: &dyn Fn(f64) -> bool) -> String {
        let (mut likely, mut remedies) = (Vec::new(), Vec::new());
        for (suspect, power) in suspects {
            let Some(taken) = self.samples.units[*suspect] else { continue };
            let name = &self.signals.list[*suspect].name;
            for (unit, _) in self.other_units(*suspect).filter(|(_, scale)| fits(scale.powi(*power))) {
                likely.push(format!("{name} in {unit} read as {taken}"));
                remedies.push(format!("--unit {name}={unit}"));
            }
        }
        let name = &self.signals.list[at].name;
        match likely.as_slice() {
            [] if self.samples.units[at].is_none() => {
                format!("{name}: {value}: is the option for it in the right unit?")
            }
            [] => {
                format!(
                    "{name}: {value}: no unit known here explains it; is this the right column (--column {name}=…)?"
                )
            }
            likely => format!("{name}: {value}: {}? ({})", likely.join(", or "), remedies.join(" or ")),
        }
    }

    fn pace(&self) -> Option<String> {
        let step_s = self.samples.step_s;
        let fits = |scale: f64| (STEP_S[0]..=STEP_S[1]).contains(&(scale * step_s));
        let [least, most] = STEP_S.map(time);
        let value = format!("a sample every {}, where {least} to {most} is usual", rounded_time(step_s, 4));
        let count = if step_s == 1.0 { "; if these are numbers of samples, --rate=…" } else { "" };
        (!fits(1.0)).then(|| self.misread(TIME_AT, &value, &[(TIME_AT, 1)], &fits) + count)
    }

    /// Findings about the positions at a bearing.
    fn positions(&self, bearing: usize, gap_m: f64) -> Vec<String> {
        let axes: Vec<usize> = self.samples.machine.readings_of(bearing).collect();
        let ranges: Vec<[f64; 2]> = axes.iter().map(|axis| range(&self.samples.position_m[*axis])).collect();
        let spans: Vec<f64> = ranges.iter().map(|[low, high]| high - low).collect();
        let limit_m = gap_m.min(TRAVEL_M);
        let is_silent = |n: usize| noise(&self.samples.position_m[axes[n]]) < SILENT_M;
        let is_still = (0..axes.len()).all(|n| spans[n] < STILL_M && is_silent(n));
        let own_a = &self.current_a[self.samples.machine.magnets_of(bearing)];
        let currents_vary = own_a.iter().map(range).any(|[low, high]| low < high);
        let at = |n: usize| self.signals.positions.start + axes[n];
        let finding = |n: usize| {
            let (span, furthest) = (spans[n], ranges[n][0].abs().max(ranges[n][1].abs()));
            if span == 0.0 && currents_vary {
                let (name, value) = (&self.signals.list[at(n)].name, significant(1e6 * ranges[n][0], 4));
                let words = "µm throughout, while the currents vary: is the sensor connected?";
                return Some(format!("{name} reads {value} {words}"));
            }
            let value = if furthest > limit_m {
                let [furthest, limit] = [furthest, limit_m].map(|length_m| significant(length_m * 1e3, 4));
                let of = if gap_m > TRAVEL_M { "any gap" } else { "the gap" };
                format!("up to {furthest} mm from the centre, beyond {of} of {limit} mm")
            } else if is_still && span > 0.0 {
                format!("it moves by {} nm only, and without noise", significant(span * 1e9, 3))
            } else {
                return None;
            };
            let fits = |scale: f64| scale * furthest < limit_m && scale * span > STILL_M;
            Some(self.misread(at(n), &value, &[(at(n), 1)], &fits))
        };
        let mut findings: Vec<String> = (0..axes.len()).filter_map(finding).collect();
        // If the axes are in different units, both may be within the limits above.
        if let ([one, other], []) = (&spans[..], &findings[..]) {
            let small = usize::from(other < one);
            let (least, most) = (one.min(*other), one.max(*other));
            let fits = |scale: f64| (0.03..30.0).contains(&(scale * least / most));
            let is_hidden = least > 0.0 && most / least > 300.0 && is_silent(small);
            if is_hidden && self.other_units(at(small)).any(|(_, scale)| fits(scale)) {
                let [own, other] = [least, most].map(|span| significant(span * 1e6, 3));
                let value = format!("it moves by {own} µm, the other axis by {other} µm");
                findings.push(self.misread(at(small), &value, &[(at(small), 1)], &fits));
            }
        }
        findings
    }

    /// Findings about the currents.
    fn currents(&self) -> Vec<String> {
        let currents = &self.current_a;
        let largest: Vec<f64> =
            currents.iter().map(|current| range(current.iter().map(|value| value.abs()))[1]).collect();
        let most = range(&largest)[1];
        let finding = |k: usize| {
            let (at, strongest) = (self.signals.currents.start + k, largest[k]);
            if strongest == 0.0 && currents[k].iter().any(|value| value.is_finite()) {
                let (name, magnet) = (&self.signals.list[at].name, self.samples.machine.describe("{magnet}", "", k));
                let words = "is 0 throughout, which gives no information about";
                return Some(format!("{name} {words} {magnet}: are it and the sensor of its current connected?"));
            }
            let is_weak = strongest < CURRENT_A[0] && most < 50.0 * strongest;
            let is_odd = most > 300.0 * strongest && noise(&currents[k]) < 2e-5;
            let is_misread = strongest > CURRENT_A[1] || strongest > 0.0 && (is_weak || is_odd);
            let fits = |scale: f64| (CURRENT_A[0]..=CURRENT_A[1]).contains(&(scale * strongest));
            is_misread.then(|| self.misread(at, &format!("up to {} A", significant(strongest, 4)), &[(at, 1)], &fits))
        };
        (0..currents.len()).filter_map(finding).collect()
    }

    /// A wrapped angle reveals its unit by the size of a turn.
    fn wrapping(&self) -> Option<String> {
        let wrap = self.samples.wrap_rad?;
        let fits = |scale: f64| {
            let turns = scale * wrap / TAU;
            turns > 0.5 && (turns - turns.round()).abs() < 0.1 && turns < 4.5
        };
        let value = format!("it wraps every {} rad, a turn is {} rad", significant(wrap, 5), significant(TAU, 5));
        let theta = self.signals.theta;
        (!fits(1.0)).then(|| self.misread(theta, &value, &[(theta, 1)], &fits))
    }

    /// If both are recorded, the slope of the angle must agree with the speed, by least squares, except at rest.
    fn angle_against_speed(&self) -> Option<String> {
        let samples = self.samples;
        if samples.rotation != Rotation::Both {
            return None;
        }
        let both = samples.theta_rad.windows(2).zip(samples.omega_rad_s.windows(2));
        let both = both.map(|(theta, omega)| ((theta[1] - theta[0]) / samples.step_s, 0.5 * (omega[0] + omega[1])));
        let known = both.filter(|(slope, omega)| slope.is_finite() && omega.is_finite());
        let [up, speeds, slopes, count] = known.fold([0.0; 4], |[up, speeds, slopes, count], (slope, omega)| {
            [up + slope * omega, speeds + omega * omega, slopes + slope * slope, count + 1.0]
        });
        let rest = REST_RAD_S * REST_RAD_S * count;
        let ratio = if speeds > 0.0 { up / speeds } else { f64::INFINITY };
        let agrees = |scale: f64| (ratio * scale - 1.0).abs() < AGREE;
        if speeds <= rest && slopes <= rest || agrees(1.0) {
            return None;
        }
        let speed = median(&samples.omega_rad_s);
        let slope = if speeds > 0.0 { ratio * speed } else { (slopes / count).sqrt() };
        let value = format!("the angle turns at {}, the speed is {}", rpm(slope), rpm(speed));
        let Signals { theta, omega, .. } = self.signals;
        Some(if agrees(-1.0) {
            format!("theta: {value}: they have opposite directions")
        } else {
            self.misread(theta, &value, &[(theta, 1), (omega, -1), (TIME_AT, -1)], &agrees)
        })
    }

    /// The signal whose unit determines the speed.
    fn speed_source(&self) -> usize {
        if self.samples.rotation.has_mark() { self.signals.theta } else { self.signals.omega }
    }

    /// Speeds that are too high for a rotor, or for its controller.
    fn speed(&self) -> Option<String> {
        let (speed, step_s) = (median(&self.samples.omega_rad_s).abs(), self.samples.step_s);
        let fits = |speed: f64| speed <= SPEED_RAD_S && speed * step_s <= TAU / SAMPLES_PER_TURN;
        if fits(speed) || speed.is_nan() {
            return None;
        }
        let value = format!("{}, {} samples a turn", rpm(speed), significant(TAU / speed / step_s, 3));
        // A rotor that hardly turns is not a better explanation.
        let fits = |scale: f64| fits(scale * speed) && scale * speed > REST_RAD_S;
        Some(self.misread(self.speed_source(), &value, &[(self.speed_source(), 1)], &fits))
    }

    /// A rotor moves in step with its rotation; if it moves in step with another one, angle, speed or time are misread.
    fn motion_against_angle(&self) -> Option<String> {
        /// Fraction of the motion below which the angle as read explains nothing, and above which another one is the explanation.
        const NOTHING: f64 = 0.2;
        const MOST: f64 = 0.6;
        /// Least part of the fundamental: otherwise a path with a speed of its own passes for a harmonic of another rotation.
        const LEAST: f64 = 0.02;
        let samples = self.samples;
        if samples.theta_rad.is_empty() || synchronous(samples, 1.0, HARMONICS).is_some_and(|part| part > NOTHING) {
            return None;
        }
        let part = |scale: f64, harmonics: i32| synchronous(samples, scale, harmonics).unwrap_or(0.0);
        let explains = |scale: f64| part(scale, HARMONICS) > MOST && part(scale, 1) > LEAST;
        let speed = rpm(median(&samples.omega_rad_s));
        let value = |scale: f64| format!("{speed}, while the motion turns {} times as fast", significant(scale, 3));
        let suspects: &[(usize, i32)] = match samples.rotation {
            Rotation::Angle | Rotation::Both => &[(self.signals.theta, 1)],
            Rotation::Speed => &[(self.signals.omega, 1), (TIME_AT, 1)],
            Rotation::Stated | Rotation::Unknown => &[(TIME_AT, 1)],
        };
        let others = suspects.iter().flat_map(|(at, _)| self.other_units(*at).map(|(_, scale)| scale));
        // A speed in Hz or rad/s may have been stated as rpm.
        let stated = (samples.rotation == Rotation::Stated).then_some([60.0, 30.0 / PI]);
        let scale = others.chain(stated.into_iter().flatten()).find(|scale| explains(*scale))?;
        Some(self.misread(self.speed_source(), &value(scale), suspects, &explains))
    }
}

/// Harmonics of the rotation that count as synchronous with it.
const HARMONICS: i32 = 4;

/// Fraction of the motion that is synchronous with the angle times a factor: its first harmonics, forwards and backwards.
fn synchronous(samples: &Samples, factor: f64, harmonics: i32) -> Option<f64> {
    /// Samples that are enough.
    const ENOUGH: usize = 100_000;
    let theta = &samples.theta_rad[..samples.theta_rad.len().min(ENOUGH)];
    let [low, high] = range(theta);
    let turned = factor * (high - low);
    // Less than two turns show little, and fast turns alias with slow ones.
    if turned < 2.0 * TAU || turned / theta.len() as f64 > PI / f64::from(harmonics) {
        return None;
    }
    let motion = samples.position_m[0].iter().zip(&samples.position_m[1]).map(|(y, z)| Complex::new(*y, *z));
    let rows: Vec<_> = theta.iter().zip(motion).filter(|(theta, at)| theta.is_finite() && at.is_finite()).collect();
    let count = rows.len() as f64;
    let mean = rows.iter().map(|(_, at)| at).sum::<Complex<f64>>() / count;
    let all = rows.iter().map(|(_, at)| (at - mean).norm_sqr()).sum::<f64>() / count;
    let part = |n: i32| {
        let turned_back = |(theta, at): &(&f64, Complex<f64>)| {
            let (sin, cos) = libm::sincos(f64::from(n) * factor * **theta);
            (at - mean) * Complex::new(cos, -sin)
        };
        (rows.iter().map(turned_back).sum::<Complex<f64>>() / count).norm_sqr()
    };
    (all > 0.0).then(|| (-harmonics..=harmonics).filter(|n| *n != 0).map(part).sum::<f64>() / all)
}
