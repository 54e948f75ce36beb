//! Alternatives for data that are not as stated, each tried on a stretch of the recording.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use nalgebra::Complex;

use self::Concerns::{All, Axial, Each, Opposite, Radial, Shaft};
use super::answer::{implausible, judge, shown, with_slow_force};
use super::likelihood::Hold::{HeldAfter, HeldBefore, Linear};
use super::likelihood::{
    BenchParameter, Change, Contradiction, Estimate, Hold, Identification, Knowledge, LAG, Options, Recording,
};
use super::mean;
use super::tolerance::plain;
use super::units::significant;
use crate::bearing::array;
use crate::estimation::VERY_STRONG;
use crate::machine::Machine;
use crate::studies::parallel::{in_order, in_order_shown};

/// Minimum and maximum number of rows of a stretch.
const ROWS: [usize; 2] = [2000, 20_000];
/// Turns of the stretch.
const TURNS: f64 = 5.0;
/// The meaning of the currents decides several per cent of λ: it is judged on this many stretches. On one, a slow force made a held current look
/// continuous (`scripts/faults.py --only "slow force" --seed 7001`).
const HOLD_STRETCHES: usize = 4;
/// Rows on each side over which the slope of a position is taken.
const BESIDE: usize = 8;
/// Greatest part of a turn that a gap may hide.
const LARGEST_GAP: f64 = 0.1;
/// Probability of a proposal for data that are as stated.
const CHANCE: f64 = 1e-3;
/// Alternatives whose log-likelihood is within this of the best are proposed as well: the model errors that they share call for more than very
/// strong evidence.
const AS_GOOD: f64 = 2.0 * VERY_STRONG;

/// Gain in log-likelihood that an alternative needs over the stated values, for these numbers of alternatives and rows.
///
/// If the statements are true, the likelihood ratio of a fixed alternative has the expectation 1, so that it exceeds 1/p with a probability of at
/// most p (Markov). One of the alternatives has one more parameter.
fn needed_gain(alternatives: usize, rows: usize) -> f64 {
    libm::log(alternatives as f64 / CHANCE) + gain_by_chance(rows)
}

/// Gain in log-likelihood by a parameter fitted to the N readings of two coordinates in these rows: ½ ln N (Schwarz 1978).
pub(super) fn gain_by_chance(rows: usize) -> f64 {
    0.5 * libm::log(2.0 * rows as f64)
}

/// A recording with the statements about it.
#[derive(Clone, Debug)]
pub(super) struct Trial {
    pub recording: Recording,
    pub options: Options,
    pub machine: &'static Machine,
    /// The radial bearing that an alternative concerns.
    pub bearing: usize,
}

/// Part of a recording that a mistake concerns.
enum Concerns {
    /// The whole recording.
    All,
    /// Each radial bearing with at least this many magnets.
    Radial(usize),
    /// The axial bearing of a shaft.
    Axial,
    /// The two radial bearings of a shaft.
    Shaft,
    /// The magnets with this number, from 0, of the two radial bearings of a shaft.
    Opposite(usize),
    /// Each radial bearing of a shaft.
    Each,
}

/// A common mistake: the part it concerns, description, correction, advice to the user.
type Alternative = (Concerns, &'static str, fn(&mut Trial), &'static str);

/// Changes the positions that the sensors of the bearing read.
fn sensors(trial: &mut Trial, change: impl Fn([f64; 2]) -> [f64; 2]) {
    let [y, z, ..] = &mut trial.recording.position_m[2 * trial.bearing..] else { return };
    for (y, z) in y.iter_mut().zip(z) {
        [*y, *z] = change([*y, *z]);
    }
}

/// Reorders the currents of all magnets.
fn reorder(trial: &mut Trial, change: impl FnOnce(&mut [usize])) {
    let mut order: Vec<usize> = (0..trial.recording.current_a.len()).collect();
    change(&mut order);
    let Recording { current_a, square_error_a2, .. } = &mut trial.recording;
    *current_a = order.iter().map(|k| current_a[*k].clone()).collect();
    *square_error_a2 = order.iter().filter_map(|k| square_error_a2.get(*k).cloned()).collect();
}

/// Reorders the currents of the bearing.
fn currents(trial: &mut Trial, change: impl FnOnce(&mut [usize])) {
    let magnets = trial.machine.magnets_of(trial.bearing);
    reorder(trial, |order| change(&mut order[magnets]));
}

/// Exchanges positions of the radial bearings of a shaft, along these axes, 0 for y and 1 for z, and currents of the magnets with these numbers.
fn exchange(trial: &mut Trial, axes: &[usize], magnets: &[usize]) {
    let Recording { position_m, position_error_m, .. } = &mut trial.recording;
    axes.iter().for_each(|axis| position_m.swap(*axis, axis + 2));
    if !position_error_m.is_empty() {
        axes.iter().for_each(|axis| position_error_m.swap(*axis, axis + 2));
    }
    let count = trial.machine.bearings[0].magnets;
    let own = magnets.iter().filter(|k| **k < count);
    reorder(trial, |order| own.for_each(|k| order.swap(*k, k + count)));
}

/// Shifts columns by a row, to earlier or later rows.
fn shift<T>(columns: &mut [Vec<T>], is_later: bool) {
    columns.iter_mut().for_each(|rows| if is_later { rows.rotate_right(1) } else { rows.rotate_left(1) });
}

/// Shifts the currents and the errors of restored ones.
fn shift_currents(trial: &mut Trial, is_later: bool) {
    shift(&mut trial.recording.current_a, is_later);
    shift(&mut trial.recording.square_error_a2, is_later);
}

/// Shifts the positions of the bearing and the errors of restored ones.
fn shift_positions(trial: &mut Trial, is_later: bool) {
    let own = 2 * trial.bearing..2 * trial.bearing + 2;
    shift(&mut trial.recording.position_m[own.clone()], is_later);
    trial.recording.position_error_m.get_mut(own).into_iter().for_each(|of| shift(of, is_later));
}

/// Moves the positions of the bearing to a fraction of a row later along their slopes, by least squares over [`BESIDE`] rows on both sides.
/// The noise of such a slope is a twentieth of that of a reading, so that the likelihoods stay comparable.
fn advance(trial: &mut Trial, fraction: f64) {
    let squares: f64 = (1..=BESIDE).map(|n| 2.0 * (n * n) as f64).sum();
    for position_m in &mut trial.recording.position_m[2 * trial.bearing..][..2] {
        let Some(last) = position_m.len().checked_sub(2 * BESIDE + 1).map(|rows| BESIDE + rows) else { continue };
        let read_m = position_m.clone();
        for (row, position_m) in position_m.iter_mut().enumerate() {
            let at = row.clamp(BESIDE, last);
            let moment: f64 = (1..=BESIDE).map(|n| n as f64 * (read_m[at + n] - read_m[at - n])).sum();
            *position_m += if moment.is_finite() { fraction * moment / squares } else { 0.0 };
        }
    }
}

/// A meaning of the currents: description, and advice.
type Meaning = (Hold, &'static str, &'static str);

const BEFORE: Meaning = (HeldBefore, "the currents are those before the sample (measured)", "--hold heldBefore");
const AFTER: Meaning = (HeldAfter, "the currents are commands, held after the sample", "--hold heldAfter");
const CONTINUOUS: Meaning = (Linear, "the currents are continuous", "--hold linear");
/// All of them.
pub(super) const MEANINGS: [Meaning; 3] = [BEFORE, AFTER, CONTINUOUS];

/// The magnets of a radial bearing.
const EACH: [usize; 4] = [0, 1, 2, 3];
const SWAP: &str = "exchange Ym and Zm (--column)";
const MIRROR: &str = "reverse the sign of the sensor";
const BACKWARD: &str = "--estimate force.backward";
const GAINS: &str = "--estimate sensor.gain --estimate sensor.gainDifference";
const COLUMNS: &str = "exchange their columns (--column)";
const ORDER: &str = "exchange the currents (--column), or the angles alpha";
const ROW: &str = "shift the currents by one row";
const ROW_OR_DELAY: &str = "shift the currents by one row, or --estimate delay";
const TOGETHER: &str = "read all sensors at the same instant, or correct its positions for the delay";
const REVERSE: &str = "reverse the signs of theta and omega, or that of --speed";
const LOADS: &str = "leave out the loads of --set, or correct them";
const SPEED: &str = "--speed, or a column of the angle";

const ALTERNATIVES: &[Alternative] = &[
    (Radial(3), "y and z are exchanged", |t| sensors(t, |[y, z]| [z, y]), SWAP),
    (Radial(3), "y is mirrored", |t| sensors(t, |[y, z]| [-y, z]), MIRROR),
    (Radial(3), "z is mirrored", |t| sensors(t, |[y, z]| [y, -z]), MIRROR),
    (Radial(3), "y and z are mirrored", |t| sensors(t, |[y, z]| [-y, -z]), "reverse the signs of both sensors"),
    (Radial(3), "the sensors are turned by 90°", |t| sensors(t, |[y, z]| [z, -y]), "exchange Ym and Zm and mirror y"),
    (Radial(3), "the sensors are turned by −90°", |t| sensors(t, |[y, z]| [-z, y]), "exchange Ym and Zm and mirror z"),
    (Radial(3), "y and z are exchanged and mirrored", |t| sensors(t, |[y, z]| [-z, -y]), SWAP),
    (Radial(3), "magnets 1 and 2 are exchanged", |t| currents(t, |order| order.swap(0, 1)), ORDER),
    (Radial(3), "magnets 1 and 3 are exchanged", |t| currents(t, |order| order.swap(0, 2)), ORDER),
    (Radial(3), "magnets 2 and 3 are exchanged", |t| currents(t, |order| order.swap(1, 2)), ORDER),
    (Radial(4), "magnets 1 and 4 are exchanged", |t| currents(t, |order| order.swap(0, 3)), ORDER),
    (Radial(4), "magnets 2 and 4 are exchanged", |t| currents(t, |order| order.swap(1, 3)), ORDER),
    (Radial(4), "magnets 3 and 4 are exchanged", |t| currents(t, |order| order.swap(2, 3)), ORDER),
    (Radial(3), "the magnets count from the second", |t| currents(t, |order| order.rotate_left(1)), ORDER),
    (Radial(3), "the magnets count from the third", |t| currents(t, |order| order.rotate_left(2)), ORDER),
    (Radial(4), "the magnets count from the fourth", |t| currents(t, |order| order.rotate_left(3)), ORDER),
    (Axial, "magnets 1 and 2 are exchanged", |t| currents(t, |order| order.swap(0, 1)), COLUMNS),
    (Axial, "x is mirrored", |t| t.recording.position_m[4].iter_mut().for_each(|x| *x = -*x), MIRROR),
    (Shaft, "the positions of the radial bearings are exchanged", |t| exchange(t, &[0, 1], &[]), COLUMNS),
    (Shaft, "y of the radial bearings is exchanged", |t| exchange(t, &[0], &[]), COLUMNS),
    (Shaft, "z of the radial bearings is exchanged", |t| exchange(t, &[1], &[]), COLUMNS),
    (Shaft, "the currents of the radial bearings are exchanged", |t| exchange(t, &[], &EACH), COLUMNS),
    (Shaft, "the radial bearings are exchanged", |t| exchange(t, &[0, 1], &EACH), COLUMNS),
    (Opposite(0), "magnets 1 of the radial bearings are exchanged", |t| exchange(t, &[], &[0]), COLUMNS),
    (Opposite(1), "magnets 2 of the radial bearings are exchanged", |t| exchange(t, &[], &[1]), COLUMNS),
    (Opposite(2), "magnets 3 of the radial bearings are exchanged", |t| exchange(t, &[], &[2]), COLUMNS),
    (Opposite(3), "magnets 4 of the radial bearings are exchanged", |t| exchange(t, &[], &[3]), COLUMNS),
    (Each, "the positions come a quarter of a sample late", |t| advance(t, 0.25), TOGETHER),
    (Each, "the positions come half a sample late", |t| advance(t, 0.5), TOGETHER),
    (Each, "the positions come three quarters of a sample late", |t| advance(t, 0.75), TOGETHER),
    (Each, "the positions come a quarter of a sample early", |t| advance(t, -0.25), TOGETHER),
    (Each, "the positions come half a sample early", |t| advance(t, -0.5), TOGETHER),
    (Each, "the positions come three quarters of a sample early", |t| advance(t, -0.75), TOGETHER),
    (Each, "the positions come a sample late", |t| shift_positions(t, false), "shift its positions by one row"),
    (Each, "the positions come a sample early", |t| shift_positions(t, true), "shift its positions by one row"),
    (All, BEFORE.1, |t| t.recording.hold = BEFORE.0, BEFORE.2),
    (All, AFTER.1, |t| t.recording.hold = AFTER.0, AFTER.2),
    (All, CONTINUOUS.1, |t| t.recording.hold = CONTINUOUS.0, CONTINUOUS.2),
    (All, "the currents come a sample late, or the positions early", |t| shift_currents(t, false), ROW),
    (All, "the currents come a sample early, or the positions late", |t| shift_currents(t, true), ROW_OR_DELAY),
    (All, "the angle counts against the rotation", |t| rotate(t, -1.0), REVERSE),
    (All, "the speed is twice as high", |t| rotate(t, 2.0), "double theta and omega, or --speed"),
    (All, "the speed is half as high", |t| rotate(t, 0.5), "halve theta and omega, or --speed"),
    (All, "the speed was recorded in rpm", |t| rotate(t, PI / 30.0), "--unit omega=rpm"),
    (All, "the speed was recorded in Hz", |t| rotate(t, TAU), "--unit omega=Hz"),
    (All, "the speed differs", |t| drift(&t.recording).into_iter().for_each(|[off, ..]| rotate(t, 1.0 + off)), SPEED),
    (All, "the loads differ", |t| t.options.parts.iter_mut().for_each(|part| part.settings.load_n.clear()), LOADS),
    (All, "the gap differs", |t| free(t, &["s"]), "--estimate s"),
    (All, "a force turns against the rotor", |t| free(t, &["force.backward.cos", "force.backward.sin"]), BACKWARD),
    (Shaft, "the moments of inertia differ", |t| free(t, &["Jt", "Jp"]), "--estimate Jt --estimate Jp"),
    (Shaft, "the magnets are elsewhere along the shaft", |t| free(t, &["position"]), "--estimate position"),
    (Shaft, "the sensors are elsewhere along the shaft", |t| free(t, &["sensorPosition"]), "--estimate sensorPosition"),
    (All, "the gains of the position sensors differ", |t| free(t, &["sensor.gain", "sensor.gainDifference"]), GAINS),
];

/// Relative difference of the speed of the motion from the stated one, its standard deviation, and the angle in rad that it amounts to over the
/// recording: the line through the phases of the forward component, turn by turn.
pub(super) fn drift(recording: &Recording) -> Option<[f64; 3]> {
    let Recording { theta_rad, position_m, .. } = recording;
    let (first, last) = (theta_rad[recording.used().next()?], theta_rad[recording.used().last()?]);
    let mean = [0, 1].map(|a| mean(recording.used().map(|row| position_m[a][row])));
    let (mut turns, mut before): (Vec<Option<Complex<f64>>>, f64) = (Vec::new(), 0.0);
    for row in recording.used() {
        let turned = (theta_rad[row] - first).abs() / TAU;
        let turn = turned as usize;
        turns.resize(turns.len().max(turn + 1), Some(Complex::default()));
        // Of a turn with a gap nothing is known.
        if turned > before + LARGEST_GAP {
            turns[before as usize..=turn].fill(None);
        }
        before = turned;
        let (sin, cos) = libm::sincos(theta_rad[row]);
        let [y, z] = [0, 1].map(|a| position_m[a][row] - mean[a]);
        turns[turn].iter_mut().for_each(|sum| *sum += Complex::new(y, z) * Complex::new(cos, -sin));
    }
    // The last turn is incomplete.
    turns.pop();
    let turns: Vec<(f64, Complex<f64>)> =
        turns.into_iter().enumerate().filter_map(|(turn, sum)| Some((turn as f64, sum?))).collect();
    let phases = turns.windows(2).scan(0.0, |phase, pair| {
        let step = pair[1].1 * pair[0].1.conj();
        *phase += libm::atan2(step.im, step.re);
        Some(*phase)
    });
    let phases: Vec<f64> = [0.0].into_iter().chain(phases).collect();
    let count = turns.len() as f64;
    let middle = turns.iter().map(|(turn, _)| turn).sum::<f64>() / count;
    let at = || turns.iter().map(|(turn, _)| turn - middle);
    let square: f64 = at().map(|at| at * at).sum();
    let slope = at().zip(&phases).map(|(at, phase)| at * phase).sum::<f64>() / square;
    let mean = phases.iter().sum::<f64>() / count;
    let residuals: Vec<f64> = at().zip(&phases).map(|(at, phase)| phase - mean - slope * at).collect();
    let power: f64 = residuals.iter().map(|residual| residual * residual).sum();
    // Other motions beat with the turns: the residuals are autocorrelated.
    let correlation = (residuals.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / power).max(0.0);
    let variance = power / (count - 2.0) / square * (1.0 + correlation) / (1.0 - correlation);
    let off = slope / TAU.copysign(last - first);
    (turns.len() >= 4).then(|| [off, variance.sqrt() / TAU, off * (last - first).abs()])
}

/// Whether a speed that differs by this part is not clearly refuted. A path with a speed of its own may look like a drift, but without a notable unbalance
/// the data do not tell the two apart.
pub(super) fn may_be_faster(trial: &Trial, off: f64) -> bool {
    let stated = stretch(trial, HOLD_STRETCHES);
    let mut other = stated.clone();
    rotate(&mut other, 1.0 + off);
    let likelihood = |of: &Trial| {
        let found = identified(of).filter(|found| found.converged);
        found.map_or(f64::NEG_INFINITY, |found| found.log_likelihood)
    };
    likelihood(&other) >= likelihood(&stated) - VERY_STRONG
}

/// Multiplies angle and speed by a factor.
fn rotate(trial: &mut Trial, factor: f64) {
    let rotation = trial.recording.theta_rad.iter_mut().chain(&mut trial.recording.omega_rad_s);
    rotation.for_each(|value| *value *= factor);
}

/// Frees these parameters of all bearings.
fn free(trial: &mut Trial, names: &[&str]) {
    let meant = trial.options.bench().filter(|of| names.contains(&plain(&of.name)));
    meant.for_each(|of| of.knowledge = Knowledge::Free);
}

fn identified(trial: &Trial) -> Option<Identification> {
    with_slow_force(std::slice::from_ref(&trial.recording), &mut trial.options.clone()).ok()
}

/// The middle of a recording, as long as this number of stretches, of which no rows are left out.
fn stretch(trial: &Trial, stretches: usize) -> Trial {
    let all = &trial.recording;
    let rows = all.usable.len();
    let speed = all.omega_rad_s.iter().filter(|omega| omega.is_finite()).sum::<f64>().abs() / rows.max(1) as f64;
    let wanted = if speed > 0.0 { (TURNS * TAU / speed / all.step_s) as usize } else { 0 };
    let count = (stretches * wanted.clamp(ROWS[0], ROWS[1])).min(rows);
    let from = (rows - count) / 2;
    let mut recording = all.part(from..from + count);
    // All alternatives use the same rows: some shift the currents by a row.
    for end in [0, count.saturating_sub(1)] {
        recording.usable[end..].iter_mut().take(1).for_each(|usable| *usable = false);
    }
    // Likelihoods are compared at their maximum, from which instruments lead away.
    let options = Options { excludes_rows: false, corrects_bias: false, ..trial.options.clone() };
    Trial { recording, options, ..*trial }
}

/// Sections of this many rows without changes of λ or load between them; all rows in one if none is long enough to decide.
fn sections(contradictions: &[&Contradiction], rows: usize) -> Vec<Range<usize>> {
    let changes = contradictions.iter().filter(|of| of.what.divides());
    let mut ends: Vec<usize> = changes.map(|of| if of.rows.start == 0 { of.rows.end } else { of.rows.start }).collect();
    ends.extend([0, rows]);
    ends.sort_unstable();
    // A change is found to within a block.
    let margin = rows / 64;
    let start = |at: usize| if at > 0 { at + margin } else { 0 };
    let end = |at: usize| if at < rows { at.saturating_sub(margin) } else { rows };
    let sections = ends.windows(2).map(|ends| start(ends[0])..end(ends[1]));
    let mut long: Vec<_> = sections.filter(|of| of.len() >= ROWS[0].min(rows) / 2).collect();
    if long.is_empty() {
        long.push(0..rows);
    }
    long
}

/// Difference between the greatest log-likelihood of a stretch and that of each meaning of the currents; infinite if it does not fit. Each has
/// the best lag, if requested, or else the best delay of a typical bench: otherwise a delay of a third of a sample looks like a continuous current.
pub(super) fn holds<const N: usize>(trial: impl Fn(usize) -> Trial) -> [f64; N] {
    // One whole recording at a time: each may have millions of rows.
    let trials: [Trial; N] = std::array::from_fn(|at| {
        let mut trial = stretch(&trial(at), HOLD_STRETCHES);
        trial.options = Options { excludes_rows: true, ..trial.options.late() };
        // An unknown force is consistent with every meaning.
        for error_a2 in &trial.recording.square_error_a2 {
            let rows = trial.recording.usable.iter_mut().zip(error_a2);
            rows.for_each(|(usable, error_a2)| *usable &= error_a2.is_finite());
        }
        trial
    });
    let all = |trials: &[Trial; N]| in_order(trials.len(), &|at| identified(&trials[at]));
    // Magnets only pull, and currents do not lead commands: a negative lag counts as none. Single outliers made one of −20 µs more likely than
    // none by 20 to 40.
    let is_possible = |of: &&Identification| !of.lambda.iter().any(Estimate::is_negative);
    let leads = |of: &Identification| {
        let mut lags = of.bench.iter().filter(|bench| plain(&bench.parameter.name) == LAG);
        lags.any(|lag| lag.estimate.value < 0.0)
    };
    let minus_log_likelihoods = |trials: &[Trial; N], found: &[Option<Identification>]| -> [f64; N] {
        array::from_fn(|at| {
            let same = |other: &usize| trials[*other].recording.hold == trials[at].recording.hold;
            let from = if found[at].as_ref().is_some_and(leads) { (0..N).find(same).unwrap_or(at) } else { at };
            let whole = found[from].as_ref().filter(|of| of.contradictions.is_empty()).filter(is_possible);
            whole.map_or(f64::INFINITY, |of| -of.log_likelihood)
        })
    };
    let found = all(&trials);
    let contradictions: Vec<_> = found.iter().flatten().flat_map(|of| &of.contradictions).collect();
    let disturbed = contradictions.iter().filter(|of| matches!(of.what, Change::Disturbed { .. }));
    let disturbed: Vec<_> = disturbed.map(|of| of.rows.clone()).collect();
    let rows = trials.first().map_or(0, |trial| trial.recording.usable.len());
    let sections = sections(&contradictions, rows);
    let mut of = minus_log_likelihoods(&trials, &found);
    if !disturbed.is_empty() || sections.len() > 1 || sections[0].len() < rows {
        // Rows that are disturbed with one meaning are left out of all: an outlier would decide. A contradiction decides: further rows need not be
        // left out. Before and after a change the meanings are compared separately.
        of = [0.0; N];
        for section in sections {
            let mut own = trials.clone();
            for trial in &mut own {
                trial.options.excludes_rows = false;
                let left_out = disturbed.iter().cloned().chain([0..section.start, section.end..rows]);
                left_out.for_each(|rows| trial.recording.usable[rows].fill(false));
            }
            let found: Vec<_> = all(&own).into_iter().map(|of| of.filter(|of| of.converged)).collect();
            of.iter_mut().zip(minus_log_likelihoods(&own, &found)).for_each(|(sum, own)| *sum += own);
        }
    }
    let best = of.iter().copied().fold(f64::INFINITY, f64::min);
    of.map(|value| if value.is_finite() { value - best } else { value })
}

/// Descriptions with which the data fit better.
#[derive(Default)]
pub(super) struct Proposals {
    /// With advice, the best first; empty if nothing fits better than the stated values.
    pub words: Vec<String>,
    /// Why the best does not explain the data either, if it does not.
    pub why_not: Option<String>,
}

/// Descriptions with which the data fit better than with the stated values.
pub(super) fn proposals(trial: &Trial) -> Proposals {
    let trial = stretch(trial, 1);
    let as_stated = identified(&trial);
    // The axial bearing and the radial ones are separate: an alternative for one leaves magnets of the other that push.
    let pushes = |is_radial: bool| {
        let own = trial.machine.magnets_of_bearings().into_iter().filter(|(of, _)| of.is_radial == is_radial);
        let found = as_stated.as_ref().filter(|found| found.converged);
        found.is_some_and(|found| own.flat_map(|(_, own)| own).any(|k| found.lambda[k].is_negative()))
    };
    let bearings = trial.machine.bearings;
    let is_shaft = bearings.iter().filter(|of| of.is_radial).count() == 2;
    let each = |alternative: &'static Alternative| {
        let concerned = bearings.iter().enumerate().filter(|(at, of)| match alternative.0 {
            All => *at == 0,
            Radial(magnets) => of.is_radial && of.magnets >= magnets,
            Axial => !of.is_radial && is_shaft,
            Shaft => *at == 0 && is_shaft,
            Opposite(k) => *at == 0 && is_shaft && of.magnets > k,
            Each => of.is_radial && is_shaft,
        });
        concerned.map(|(at, of)| (alternative, at, of.name())).collect::<Vec<_>>()
    };
    let alternatives: Vec<_> = ALTERNATIVES.iter().flat_map(each).collect();
    let stated = as_stated.as_ref().map_or(f64::NEG_INFINITY, |found| found.log_likelihood);
    let least = stated + needed_gain(alternatives.len(), trial.recording.usable.len());
    let words = |index: usize| {
        let ((concerns, name, apply, proposal), at, bearing) = &alternatives[index];
        if !matches!(concerns, All) && pushes(matches!(concerns, Axial)) {
            return None;
        }
        let mut other = Trial { bearing: *at, ..trial.clone() };
        apply(&mut other);
        let found = identified(&other)?;
        let own = std::slice::from_ref(&other.recording);
        let parts = &other.options.parts;
        let is_plausible = implausible(&found, own, other.machine, parts).is_none();
        // Parameters that the alternative frees.
        let stated = trial.options.parts.iter().flat_map(|part| &part.parameters);
        let freed = found.bench.iter().zip(stated).filter(|(of, stated)| of.parameter.knowledge != stated.knowledge);
        let off: Vec<(&BenchParameter, f64)> = freed.map(|(of, _)| (&of.parameter, of.estimate.value)).collect();
        // A careful assembly is that accurate.
        let is_stated = !off.is_empty() && off.iter().all(|(of, off)| off.abs() < of.typical);
        if !found.converged || !is_plausible || found.log_likelihood <= least || is_stated {
            return None;
        }
        let is_local = matches!(concerns, Radial(_) | Axial | Each) && is_shaft;
        let of = if is_local { format!(" at {bearing}") } else { String::new() };
        let mut words = format!("{name}{of}: {proposal}");
        for (of, off) in off.into_iter().filter(|(of, off)| off.abs() > 0.1 * of.typical) {
            let (size, unit) = shown(of);
            words += &format!("; {} by about {} {unit}", of.name, significant(off / size, 2));
        }
        if let (SPEED, Some([off, ..])) = (*proposal, drift(&trial.recording)) {
            words += &format!("; by about {} %", significant(100.0 * off, 2));
        }
        // Parts of a sample are approximated: their residuals are not white.
        let why_not = judge(&found, own, other.machine, parts).filter(|_| *proposal != TOGETHER);
        Some((found.log_likelihood, *proposal, words, why_not))
    };
    let tried = in_order_shown("trying alternatives", alternatives.len(), &words);
    let mut fits: Vec<(f64, &str, String, Option<String>)> = tried.into_iter().flatten().collect();
    fits.sort_by(|a, b| b.0.total_cmp(&a.0));
    let Some((best, .., why_not)) = fits.first().cloned() else { return Proposals::default() };
    // Parts of a sample only if one is the best: its neighbours fit almost as well.
    let is_shown = |rank: usize, proposal: &str| rank == 0 || proposal != TOGETHER;
    let as_good = fits.into_iter().take_while(|(likelihood, ..)| *likelihood > best - AS_GOOD).enumerate();
    let words =
        as_good.filter_map(|(rank, (_, proposal, words, _))| is_shown(rank, proposal).then_some(words)).collect();
    Proposals { words, why_not }
}
