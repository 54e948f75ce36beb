//! Identification of one axis between one or two magnets from a recording of a real bench: the machine `axial`.
//!
//! The model includes effects of real benches that simulations lack: an unexplained slow force, a factor κ between statics and dynamics,
//! sensor noise that grows with the gap, currents measured with noise, repeated or missing rows,
//! a start at rest on a table. The likelihood decides which of them a recording has (Schwarz 1978); [`Answer`] states it.
//! Only `Law` knows the magnets: a description of any machine can take its place.

mod answer;
mod feedback;
mod filter;
mod search;
mod twin;

pub use self::answer::{Answer, agreement, answer};
use self::feedback::feedback;
use self::filter::{Readings, in_row};
use self::search::{Fit, fit, follow, log_likelihood};
use super::samples::Samples;
use super::units::significant;
use super::{GRAVITY_M_S2, NOISE_EXPONENT, likelihood};
use crate::bearing::array;
use crate::estimation::Hold;
use crate::studies::statistics::{mean, median, noise, range};

/// Number of unknowns of the search; noises and force constants are searched by their logarithms.
pub const UNKNOWNS: usize = 20;
/// Values of the unknowns.
pub type Point = [f64; UNKNOWNS];

const GAP: usize = 2;
const LOAD: usize = 3;
const DYNAMICS: usize = 4;
const POSITION_NOISE: usize = 5;
const EXPONENT: usize = 6;
const CURRENT_NOISE: usize = 7;
const WALK: usize = 8;
const SLOW: usize = 9;
const DELAY: usize = 10;
const SLOPE: usize = 11;
const MASS: usize = 12;
const CURRENT_OFFSET: usize = 13;
const CURRENT_GAIN: usize = 15;
const SENSOR_OFFSET: usize = 17;
const SENSOR_GAIN: usize = 18;
const FEEDBACK: usize = 19;

/// Errors of the bench, 0 if it is as stated: of the mass, relative, and of the sensors.
pub(crate) const BENCH_ERRORS: std::ops::Range<usize> = MASS..FEEDBACK;

/// Names and units of the unknowns, for `--set` and `--estimate`: λ of the magnet that pulls along x and of the other one, gap at x = 0, load along x, κ between
/// forces in statics and in dynamics, noises, random walks, delay of positions relative to currents, errors of mass and sensors. Those with a smallest value are searched by their
/// logarithms; that of the slow force is relative to the weight.
pub const PARAMETERS: [(&str, &str, f64); UNKNOWNS] = [
    ("lambda[1]", "N.m2/A2", f64::MIN_POSITIVE),
    ("lambda[2]", "N.m2/A2", f64::MIN_POSITIVE),
    ("s", "m", 0.0),
    ("pX", "N", 0.0),
    (likelihood::DYNAMICS, "1", 0.0),
    ("noise.position", "m", 1e-10),
    (NOISE_EXPONENT, "1", 0.0),
    ("noise.current", "A", 1e-7),
    ("current.walk", "A/s0.5", 1e-5),
    ("force.slow", "N/s0.5", 1e-6),
    (likelihood::DELAY, "s", 0.0),
    ("current.slope", "A/s1.5", 1e-3),
    ("m", "1", 0.0),
    ("current.offset[1]", "A", 0.0),
    ("current.offset[2]", "A", 0.0),
    ("current.gain[1]", "1", 0.0),
    ("current.gain[2]", "1", 0.0),
    ("sensor.offset", "m", 0.0),
    ("sensor.gain", "1", 0.0),
    ("current.feedback", "1", 0.0),
];

/// Effects of real benches in the order in which they are tried, with the value of the unknown where there is none.
const EFFECTS: [(usize, f64); 5] =
    [(SLOPE, f64::NEG_INFINITY), (FEEDBACK, 0.0), (EXPONENT, 0.0), (DYNAMICS, 1.0), (SLOW, f64::NEG_INFINITY)];

/// Detection of the start: length of a window, s; number of windows in a row, of which no more than in the second half may have a normalised innovation
/// squared above this many medians; time after which transients of the slow force have decayed, s. All four are set by the five recordings in
/// tests/data, where the ball leaves its table within 3 s.
const WINDOW_S: f64 = 0.1;
const WINDOWS: usize = 10;
const LOUD: f64 = 2.5;
const SETTLING_S: f64 = 1.5;
/// A slow force above this fraction of the weight is that of a table: those of the five wander by less than a tenth in their 15 s.
const TABLE_FORCE: f64 = 0.25;
/// Iterations of the search over the second half, used only to find the start.
const ROUGH_ITERATIONS: usize = 8;
/// Limits of κ.
const KAPPA: [f64; 2] = [0.2, 5.0];
/// First guess of the walk of the slope of a current relative to that of the current, 1/s: usual coils have time constants of some 10 ms.
const SLOPE_START_1_S: f64 = 30.0;
/// Initial standard deviation of the slow force relative to the load: 10 mN of 594 mN on the bench in tests/data, with which its five recordings
/// agree within their standard deviations.
const SLOW_START: f64 = 0.017;

/// Initial gaps tried where positions hardly differ, relative to the mean position.
const INITIAL_GAPS: [f64; 4] = [0.5, 1.0, 2.0, 4.0];

/// Stated knowledge of an axis.
#[derive(Clone, Debug, Default)]
pub struct Axis {
    /// Levitated mass, kg.
    pub m_kg: f64,
    /// Magnets used, in rising order: 0 pulls along x, its gap is s − x; 1 pulls against x, its gap is s + x.
    pub used: Vec<usize>,
    /// Stated values of the unknowns, in SI units: noises and λ not as logarithms.
    pub known: [Option<f64>; UNKNOWNS],
    /// Unknowns to be estimated although they are stated or usually known.
    pub estimated: [bool; UNKNOWNS],
    /// Standard deviations of the stated values, which are then estimated as well; 0 if exactly known.
    pub tolerance: [f64; UNKNOWNS],
    /// Meaning of the currents; linear if not stated.
    pub hold: Option<Hold>,
    /// Position at which the result is linearised, m; the mean of the recording by default.
    pub at_m: Option<f64>,
}

/// Whether the search uses the logarithm of an unknown: λ or the level of a noise.
fn is_logarithm(at: usize) -> bool {
    PARAMETERS[at].2 > 0.0
}

/// Direction along x in which a magnet pulls.
fn direction(k: usize) -> f64 {
    if k == 0 { 1.0 } else { -1.0 }
}

/// Unknowns of a point in SI units: noises and λ not as logarithms.
fn values(point: &Point) -> Point {
    array::from_fn(|at| if is_logarithm(at) { libm::exp(point[at]) } else { point[at] })
}

impl Axis {
    /// Gap that bounds the motion, m; infinite if it is unknown, or if one magnet leaves the other side open.
    #[must_use]
    pub fn gap_m(&self) -> f64 {
        let is_closed = self.used.len() == 2 && self.is_known(GAP);
        self.known[GAP].filter(|_| is_closed).unwrap_or(f64::INFINITY)
    }

    fn is_known(&self, at: usize) -> bool {
        self.known[at].is_some() && !self.estimated[at]
    }

    /// Whether a stated value has a tolerance and is estimated.
    fn is_tolerated(&self, at: usize) -> bool {
        self.tolerance[at] > 0.0 && !self.estimated[at]
    }

    /// Inverse variance of an unknown by its tolerance; 0 without one.
    fn precision(&self, at: usize) -> f64 {
        if self.is_tolerated(at) { self.tolerance[at].powi(-2) } else { 0.0 }
    }

    /// Unknowns with a tolerance, and the deviations from their stated values at a point.
    fn deviations<'a>(&'a self, point: &'a Point) -> impl Iterator<Item = (usize, f64)> + 'a {
        let of = |at: usize| (at, point[at] - self.known[at].unwrap_or(0.0));
        (0..UNKNOWNS).filter(|at| self.is_tolerated(*at)).map(of)
    }

    /// Load used as the scale of forces, N: the weight on earth if none is stated.
    fn weight_n(&self) -> f64 {
        self.known[LOAD].map(f64::abs).filter(|load_n| *load_n > 0.0).unwrap_or(GRAVITY_M_S2 * self.m_kg)
    }

    /// Step of the central differences along an unknown: small compared with the curvature of the model, large compared with rounding.
    fn step(&self, at: usize, point: &Point) -> f64 {
        match at {
            0..GAP => 1e-3,
            // Relative to the gap at the operating point: s may be near 0.
            GAP => 1e-3 * self.law(point).reference_m.abs().max(1e-4),
            LOAD => 1e-3 * self.weight_n(),
            SENSOR_OFFSET => 1e-3 * self.law(point).reference_m.abs(),
            DYNAMICS | MASS | SENSOR_GAIN | CURRENT_OFFSET..SENSOR_OFFSET => 2e-3,
            DELAY => 1e-6,
            _ => 0.02,
        }
    }

    /// Points one step ahead of and behind a point along an unknown.
    fn neighbours(&self, at: usize, point: &Point) -> [Point; 2] {
        [1.0, -1.0].map(|sign| {
            let mut neighbour = *point;
            neighbour[at] += sign * self.step(at, point);
            neighbour
        })
    }

    /// Nearest admissible point: noises above rounding, κ within its limits. A slow force of zero stays zero.
    fn bounded(&self, mut point: Point) -> Point {
        for at in (0..UNKNOWNS).filter(|at| is_logarithm(*at)) {
            let least = PARAMETERS[at].2 * if at == SLOW { self.weight_n() } else { 1.0 };
            if point[at] > f64::NEG_INFINITY {
                point[at] = point[at].max(libm::log(least));
            }
        }
        point[DYNAMICS] = point[DYNAMICS].clamp(KAPPA[0], KAPPA[1]);
        point
    }

    fn law(&self, point: &Point) -> Law {
        let values = values(point);
        let magnet = |n: usize| self.used.get(n).map_or((0.0, 0.0), |k| (direction(*k), values[*k]));
        let error = |n: usize, at: usize| self.used.get(n).map_or(0.0, |k| values[at + k]);
        let current = |n: usize| [1.0 + error(n, CURRENT_GAIN), error(n, CURRENT_OFFSET)];
        let position = [1.0 + values[SENSOR_GAIN], values[SENSOR_OFFSET]];
        let law = Law {
            magnets: array::from_fn(magnet),
            sensors: [current(0), current(1), position],
            hold: self.hold.unwrap_or(Hold::Linear),
            m_kg: self.m_kg * (1.0 + values[MASS]),
            values,
            reference_m: 1.0,
        };
        Law { reference_m: law.gap_of(0, self.at_m.unwrap_or(0.0)), ..law }
    }
}

/// Force law at a point of the search; the only part that knows the magnets.
#[derive(Clone, Copy, Debug)]
struct Law {
    /// Direction along x and λ in N·m²/A² of the magnets used.
    magnets: [(f64, f64); 2],
    /// Gain and offset of the channels: currents of the magnets used, position.
    sensors: [[f64; 2]; 3],
    /// Meaning of the currents.
    hold: Hold,
    /// Unknowns in SI units.
    values: Point,
    m_kg: f64,
    /// Gap of the first magnet at the operating point, m.
    reference_m: f64,
}

impl Law {
    fn gap_of(&self, k: usize, x_m: f64) -> f64 {
        self.values[GAP] - self.magnets[k].0 * x_m
    }

    /// True value of a reading.
    fn true_value(&self, channel: usize, reading: f64) -> f64 {
        let [gain, offset] = self.sensors[channel];
        (reading - offset) / gain
    }

    /// Force of the magnets, N, with its derivatives with respect to x, N/m, and the currents, N/A.
    fn force(&self, x_m: f64, current_a: [f64; 2]) -> (f64, f64, [f64; 2]) {
        let (mut force, mut stiffness, mut gain) = (0.0, 0.0, [0.0; 2]);
        for (k, i) in current_a.into_iter().enumerate() {
            let (direction, lambda) = self.magnets[k];
            let gap = self.gap_of(k, x_m);
            gain[k] = 2.0 * direction * lambda * i / (gap * gap);
            force += 0.5 * gain[k] * i;
            stiffness += 2.0 * lambda * i * i / (gap * gap * gap);
        }
        (force, stiffness, gain)
    }

    /// Acceleration without the slow force, m/s², with its derivatives with respect to x and the currents as read.
    fn linearised(&self, x_m: f64, read_a: [f64; 2]) -> (f64, f64, [f64; 2]) {
        let (force, stiffness, gain) = self.force(x_m, array::from_fn(|k| self.true_value(k, read_a[k])));
        let inertia = self.values[DYNAMICS] * self.m_kg;
        let gain = array::from_fn(|k| gain[k] / inertia / self.sensors[k][0]);
        ((self.values[LOAD] + force) / inertia, stiffness / inertia, gain)
    }

    /// Standard deviation of a position reading, m.
    fn position_noise(&self, reading_m: f64) -> f64 {
        let [noise_m, exponent] = [POSITION_NOISE, EXPONENT].map(|at| self.values[at]);
        let gap = (self.gap_of(0, reading_m) / self.reference_m).max(0.05);
        noise_m * libm::pow(gap, exponent)
    }
}

/// An effect of real benches.
#[derive(Clone, Debug)]
struct Effect {
    /// Index of its unknown.
    at: usize,
    /// Gain in log-likelihood, and whether it is significant.
    gain: f64,
    is_significant: bool,
    /// Whether it is part of the model.
    is_taken: bool,
}

/// Result for a recording.
#[derive(Clone, Debug)]
struct Found {
    axis: Axis,
    /// Noise of the positions as stated. The data tell it better.
    stated_noise_m: Option<f64>,
    fit: Fit,
    /// NaN where there is none; only rows that follow the law count.
    readings: Readings,
    effects: Vec<Effect>,
    /// Fit with the most likely delay, if that is significantly better.
    delayed: Option<Fit>,
}

/// Identifies the axis from one recording.
///
/// # Errors
/// A sentence with the reason if nothing can be identified.
fn find(axis: &Axis, recording: &Samples) -> Result<Found, String> {
    let mut axis = axis.clone();
    let stated_noise_m = axis.known[POSITION_NOISE].take();
    let mut columns = recording.unfilled(axis.hold.unwrap_or(Hold::Linear)).into_iter();
    let x_m = columns.next().unwrap_or_default();
    let current_a: Vec<Vec<f64>> = columns.filter(|column| !column.is_empty()).collect();
    let count = x_m.len();
    let Samples { start_s, step_s, .. } = *recording;
    let mut readings = Readings { start_s, step_s, x_m, current_a, feedback_a: Vec::new(), rows: count / 2..count };
    if axis.at_m.is_none() {
        axis.at_m = Some(mean(readings.rows.clone().map(|row| readings.x_m[row])));
    }
    let start = first_guess(&axis, &readings)?;
    let mut free = free(&axis);
    // There is no controller response yet.
    let has_feedback = free.pop_if(|at| *at == FEEDBACK).is_some();
    let failed = "the search fails: the readings do not follow the law of this machine at all";
    let rough = fit(&axis, &readings, &start, &free, ROUGH_ITERATIONS).ok_or(failed)?;
    readings.rows = 0..count;
    let begin = begin(&axis, &readings, &rough.point).ok_or(
        "no second of the recording follows the law as its second half does: it is too short, or the bench changes",
    )?;
    readings.rows = begin..count;
    readings.feedback_a = feedback(&readings);
    if has_feedback && readings.feedback_a.iter().flatten().any(|change_a| *change_a != 0.0) {
        free.push(FEEDBACK);
    }
    let mut start = rough.point;
    if axis.known[CURRENT_NOISE].is_none() {
        start[CURRENT_NOISE] = libm::log(current_noise(&readings));
    }
    let mut best = fit(&axis, &readings, &start, &free, usize::MAX).ok_or(failed)?;
    // Schwarz 1978: half of ln N per parameter.
    let needed = 0.5 * libm::log(best.readings as f64);
    let (mut effects, mut without_feedback) = (Vec::new(), None);
    for (at, none) in EFFECTS {
        let Some(place) = free.iter().position(|of| *of == at) else { continue };
        let (mut fewer, mut point) = (free.clone(), best.point);
        fewer.remove(place);
        point[at] = none;
        let simpler = fit(&axis, &readings, &point, &fewer, usize::MAX);
        let gain = simpler.as_ref().map_or(f64::INFINITY, |simpler| best.log_likelihood - simpler.log_likelihood);
        let is_significant = axis.estimated[at] || gain > needed;
        // A recording with little information on κ does not show that it is 1: κ stays, with its standard deviation.
        let is_taken = is_significant || at == DYNAMICS;
        match simpler {
            Some(simpler) if !is_taken => (best, free) = (simpler, fewer),
            Some(simpler) if at == FEEDBACK => without_feedback = Some(simpler.point),
            _ => {}
        }
        effects.push(Effect { at, gain, is_significant, is_taken });
    }
    if let Some(point) = without_feedback {
        best.widen(&point);
    }
    let delayed = (!free.contains(&DELAY)).then(|| {
        let more = [free.as_slice(), &[DELAY]].concat();
        fit(&axis, &readings, &best.point, &more, usize::MAX)
    });
    let delayed = delayed.flatten().filter(|of| of.log_likelihood - best.log_likelihood > needed);
    Ok(Found { axis, stated_noise_m, fit: best, readings, effects, delayed })
}

impl Found {
    /// Smallest and largest position of the rows, m, and in words.
    fn position_range(&self) -> ([f64; 2], String) {
        let range_m = range(&self.readings.x_m[self.readings.rows.clone()]);
        let [low, high] = range_m.map(|of_m| significant(1e3 * of_m, 4));
        (range_m, format!("from {low} to {high} mm"))
    }
}

/// Indices of the unknowns searched when every effect of real benches is included.
fn free(axis: &Axis) -> Vec<usize> {
    let is_free = |at: &usize| match *at {
        at if axis.is_tolerated(at) => true,
        0..GAP => axis.used.contains(at) && !axis.is_known(*at),
        GAP => axis.estimated[GAP],
        // Without a known load, statics and dynamics have no common scale.
        DYNAMICS => axis.is_known(LOAD) && !axis.is_known(*at),
        // Two magnets have two gaps.
        EXPONENT => axis.used.len() == 1 && !axis.is_known(*at),
        // By the likelihood, a current that is smooth and not a random walk would have no noise.
        CURRENT_NOISE | DELAY | MASS..FEEDBACK => axis.estimated[*at],
        at => !axis.is_known(at),
    };
    (0..UNKNOWNS).filter(is_free).collect()
}

/// Standard deviation of white noise on a random walk about a slope that changes slowly: its differences have the autocovariances −σ² at lag 1 and 0 at lag 2, both
/// raised by the slope. The result is at least a twentieth of the noise by fourth differences, which is too small to matter.
fn noise_of_walk(values: &[f64]) -> f64 {
    let lag = |lag: usize| mean(values.windows(lag + 2).map(|v| (v[1] - v[0]) * (v[lag + 1] - v[lag])));
    let least = 0.05 * noise(values);
    (lag(2) - lag(1)).max(least * least).sqrt()
}

/// Noise of the currents without the controller's response, A.
fn current_noise(readings: &Readings) -> f64 {
    let noise = |(k, current): (usize, &Vec<f64>)| {
        let mut residual = current[readings.rows.clone()].to_vec();
        let changes = readings.feedback_a.get(k).map_or(&[][..], |of| &of[readings.rows.clone()]);
        let mut sum_a = 0.0;
        for (residual, change_a) in residual.iter_mut().zip(changes) {
            sum_a += change_a;
            *residual -= sum_a;
        }
        noise_of_walk(&residual)
    };
    readings.current_a.iter().enumerate().map(noise).fold(1e-6, f64::max)
}

/// First guess: by statics if one magnet carries a known load, otherwise the most likely of force constants in steps of a factor of two.
fn first_guess(axis: &Axis, readings: &Readings) -> Result<Point, String> {
    let rows = &readings.rows;
    let mut point = [0.0; UNKNOWNS];
    (point[DYNAMICS], point[FEEDBACK]) = (1.0, 1.0);
    point[SLOW] = libm::log(0.01 * axis.weight_n());
    point[POSITION_NOISE] = libm::log(noise(&readings.x_m[rows.clone()]).max(1e-9));
    let current_noise_a = current_noise(readings);
    point[CURRENT_NOISE] = libm::log(current_noise_a);
    point[WALK] = libm::log(current_noise_a / (2.0 * readings.step_s.sqrt()));
    point[SLOPE] = point[WALK] + libm::log(SLOPE_START_1_S);
    for (at, value) in axis.known.iter().enumerate() {
        let known = value.map(|value| if is_logarithm(at) { libm::log(value) } else { value });
        point[at] = known.unwrap_or(point[at]);
    }
    let known: Vec<usize> = rows.clone().filter(|row| readings.is_complete(*row)).collect();
    if known.len() < 100 {
        return Err(format!(
            "the second half of the recording has {} rows with all readings, expected at least 100",
            known.len()
        ));
    }
    if let ([k], Some(load_n)) = (axis.used.as_slice(), axis.known[LOAD]) {
        let direction = direction(*k);
        if load_n * direction >= 0.0 {
            return Err(format!(
                "pX = {load_n} N pulls where magnet {} pulls as well: expected a load in the opposite direction, or the other magnet \
                 (magnets.used)",
                k + 1
            ));
        }
        // p = λ i²/gap², so i = c (s − direction x) with c = √(p/λ): from the slope of i if positions differ, otherwise the most likely.
        let current = |row: &usize| readings.current_a[0][*row];
        let along = |row: &usize| -direction * readings.x_m[*row];
        let (x, i) = (mean(known.iter().map(along)), mean(known.iter().map(current)));
        let mut gaps = vec![axis.known[GAP].map_or(f64::NAN, |gap_m| gap_m + x)];
        if !axis.is_known(GAP) {
            let slope = mean(known.iter().map(|row| (along(row) - x) * (current(row) - i)))
                / mean(known.iter().map(|row| (along(row) - x).powi(2)));
            gaps.push(i / slope);
            gaps.extend(INITIAL_GAPS.map(|part| part * x.abs()));
        }
        let guesses = gaps.into_iter().filter(|gap_m| *gap_m > 0.0 && gap_m.is_finite()).map(|gap_m| {
            let mut guess = point;
            guess[GAP] = gap_m - x;
            if axis.known[*k].is_none() {
                guess[*k] = libm::log(load_n.abs() * (gap_m / i).powi(2));
            }
            guess
        });
        return most_likely(axis, readings, guesses);
    }
    if axis.known[GAP].is_none() {
        return Err("s is not known: give --set s=… where the load is not known or there are two magnets".into());
    }
    // Force constants up to the largest, with which the mean currents carry a hundred times the weight.
    let square = |current: &Vec<f64>| mean(known.iter().map(|row| (current[*row] / point[GAP]).powi(2)));
    let pull = readings.current_a.iter().map(square);
    let largest = 100.0 * axis.weight_n() / pull.fold(1e-300, f64::max);
    let guesses = (0..20).map(|halved| {
        let mut guess = point;
        for k in axis.used.iter().filter(|k| axis.known[**k].is_none()) {
            guess[*k] = libm::log(largest) - f64::from(halved) * std::f64::consts::LN_2;
        }
        if axis.known[LOAD].is_none() {
            let law = axis.law(&guess);
            let force = |row: &usize| law.force(readings.x_m[*row], in_row(&readings.current_a, *row)).0;
            guess[LOAD] = -mean(known.iter().map(force));
        }
        guess
    });
    most_likely(axis, readings, guesses)
}

fn most_likely(axis: &Axis, readings: &Readings, guesses: impl Iterator<Item = Point>) -> Result<Point, String> {
    let weighed = guesses.map(|guess| (log_likelihood(axis, readings, &guess), guess));
    let best = weighed.filter(|(likelihood, _)| likelihood.is_finite()).max_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, guess)| guess).ok_or_else(|| "no force constant explains the motion at all".into())
}

/// First row from which the readings follow the law.
fn begin(axis: &Axis, readings: &Readings, point: &Point) -> Option<usize> {
    let count = readings.x_m.len();
    let window = ((WINDOW_S / readings.step_s).round() as usize).max(1);
    let (mut nis, mut slow_n) = (Vec::with_capacity(count), Vec::with_capacity(count));
    follow(axis, readings, point, |filter, [error, variance]| {
        nis.push(error * error / variance);
        slow_n.push(filter.slow_n()[0]);
    });
    let means = |of: &[f64]| of.chunks_exact(window).map(mean).collect::<Vec<_>>();
    let (nis, slow_n) = (means(&nis), means(&slow_n));
    let median = median(&nis[nis.len() / 2..]);
    if median.is_nan() {
        return None;
    }
    let table_force_n = TABLE_FORCE * axis.weight_n();
    let is_loud = |(nis, slow_n): (&f64, &f64)| *nis > LOUD * median || slow_n.abs() > table_force_n;
    let loud: Vec<bool> = nis.iter().zip(&slow_n).map(is_loud).collect();
    let counts: Vec<usize> =
        loud.windows(WINDOWS.min(loud.len().max(1))).map(|of| of.iter().filter(|loud| **loud).count()).collect();
    let usual = mean(counts[counts.len() / 2..].iter().map(|count| *count as f64));
    let from = counts.iter().position(|count| *count as f64 <= usual)?;
    if from == 0 {
        return Some(0);
    }
    let begin = from * window + (SETTLING_S / readings.step_s) as usize;
    (begin + WINDOWS * window < count).then_some(begin)
}
