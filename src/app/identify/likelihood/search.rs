//! The search for the most likely parameters, and what follows from it.

use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::{DMatrix, DVector};

use super::bench::{BENCH, PARAMETERS};
use super::equations::{ALL, BASE, Bearing, LOAD, Nominal, Theta};
use super::filter::{self, Block, Data, HARMONICS, LAGS, Piece, Track};
use super::solve::{Normal, SHARED, inverse, part, unknown};
use super::synchronous::{MEASURED, Synchronous};
use super::{
    BenchEstimate, BudgetLine, Change, Conditions, Contradiction, Covariance, Estimate, Failed, Identification,
    Knowledge, Options, Recording, Residuals, SHORTEST, Score, Suspect,
};

/// Rows of a piece.
const PIECE: usize = 1 << 15;
/// What the filter forgets in this time, in s, does not matter: the field's negative stiffness makes its slowest pole some 100 rad/s
/// (e⁻¹⁵).
const MARGIN_S: f64 = 0.15;
/// Blocks per recording: enough to find a change within a per cent of the recording.
const BLOCKS: usize = 128;
/// Rows of the shortest block.
const SHORTEST_BLOCK: usize = 32;
/// Time over which ω̇ is taken, to each side, in s.
const RATE_S: f64 = 1.5e-3;
/// Passes about the measured trajectory before the smoother takes over: without load and unbalance it would follow a wrong model.
const UNSMOOTHED: usize = 2;
/// Most iterations.
const MOST: usize = 30;
/// Converged: largest step in standard deviations.
const CONVERGED: f64 = 0.05;
/// The same before bench parameters are estimated with the rest.
const ROUGH: f64 = 1.0;
/// A step is too long if after it the likelihood is lower and the score larger, both by this in χ². One of them alone says little: the scores are
/// freed of their bias, so that the search does not end at the maximum of the likelihood.
const WORSE: f64 = 2.0;
/// Relative steps up to which numbers that multiply are moved in their logarithms.
const STRAIGHT: f64 = 0.3;
/// Longest step of a bench parameter, in typical tolerances.
const LONGEST: f64 = 3.0;
/// Step of the logarithm of the current noise for the parabola through its likelihood.
const NOISE_STEP: f64 = 0.25;
/// Changes of the logarithm of a noise level below this need no second look.
const NOISE_SETTLED: f64 = 0.002;
/// First guess of the current noise, A, and how far it holds, as a standard deviation of the logarithm: it decides only where
/// positions are too noisy to tell.
const CURRENT_NOISE_A: f64 = 0.01;
const CURRENT_NOISE_LOG_STD: f64 = 3.0;
/// A parameter without a tolerance has one that cannot matter, in typical tolerances.
const FREE: f64 = 1e3;
/// A free parameter that is known to this many typical tolerances only is not told by the data.
const NOT_SEPARATED: f64 = 20.0;

/// Rows of a long recording, in stretches over the whole of it, from which the search starts: all rows are for its last iterations.
const FIRST_ROWS: usize = 100_000;
const STRETCH: usize = 1 << 14;

/// One recording with its rows cut into pieces.
struct Case<'a> {
    data: Data<'a>,
    recording: &'a Recording<'a>,
    segments: Vec<Range<usize>>,
    pieces: Vec<Piece>,
    position_noise: f64,
    current_noise: f64,
    track: Track,
}

/// Segments of usable rows.
fn segments(usable: impl Iterator<Item = bool>) -> Vec<Range<usize>> {
    let mut segments = Vec::new();
    let mut start = None;
    let mut count = 0;
    for (row, usable) in usable.enumerate() {
        count = row + 1;
        match (usable, start) {
            (true, None) => start = Some(row),
            (false, Some(from)) => {
                segments.push(from..row);
                start = None;
            }
            _ => {}
        }
    }
    segments.extend(start.map(|from| from..count));
    segments.retain(|segment: &Range<usize>| segment.len() >= SHORTEST);
    segments
}

fn pieces(segments: &[Range<usize>], h: f64) -> Vec<Piece> {
    let rows: usize = segments.iter().map(Range::len).sum();
    let block = (rows / BLOCKS).max(SHORTEST_BLOCK);
    let margin = (MARGIN_S / h).ceil() as usize;
    let length = PIECE.max(8 * margin).div_ceil(block) * block;
    let mut pieces = Vec::new();
    for segment in segments {
        let mut from = segment.start;
        while from < segment.end {
            // A short rest goes with the piece before it.
            let to = if segment.end - from < length + length / 2 { segment.end } else { from + length };
            let filtered = from.saturating_sub(margin).max(segment.start)..(to + margin).min(segment.end);
            pieces.push(Piece { filtered, counted: from..to, block, blocks_from: segment.start });
            from = to;
        }
    }
    pieces
}

/// rms of fourth and sixth differences, over √70 and √924, the smaller one: white noise without the motion.
fn position_noise(position: &[[f64; 2]], segments: &[Range<usize>]) -> f64 {
    let binomials: [(&[f64], f64); 2] =
        [(&[1.0, -4.0, 6.0, -4.0, 1.0], 70.0), (&[1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0], 924.0)];
    let of = |(weights, gain): (&[f64], f64)| {
        let (mut sum, mut count) = (0.0, 0.0);
        for segment in segments {
            for window in position[segment.clone()].windows(weights.len()) {
                for a in 0..2 {
                    let d: f64 = window.iter().zip(weights).map(|(p, w)| p[a] * w).sum();
                    sum += d * d;
                    count += 1.0;
                }
            }
        }
        (sum / (count * gain)).sqrt()
    };
    of(binomials[0]).min(of(binomials[1])).max(1e-10)
}

/// Works on all items with so many threads; results in the order of the items.
fn parallel<T: Sync, R: Send>(threads: usize, items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    if threads <= 1 || items.len() <= 1 {
        return items.iter().map(work).collect();
    }
    let next = AtomicUsize::new(0);
    let results: Mutex<Vec<Option<R>>> = Mutex::new(items.iter().map(|_| None).collect());
    std::thread::scope(|scope| {
        for _ in 0..threads.min(items.len()) {
            scope.spawn(|| {
                loop {
                    let at = next.fetch_add(1, Ordering::Relaxed);
                    let Some(item) = items.get(at) else { break };
                    let result = work(item);
                    if let Ok(mut results) = results.lock() {
                        results[at] = Some(result);
                    }
                }
            });
        }
    });
    results.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner).into_iter().flatten().collect()
}

fn prepare<'a>(recording: &'a Recording<'a>, usable: &[bool], repeats: bool) -> Option<Case<'a>> {
    let h = recording.step_s;
    let rows = recording.position_m.len();
    let segments = segments(
        (0..rows)
            .map(|row| recording.usable.get(row).copied().unwrap_or(true) && usable.get(row).copied().unwrap_or(true)),
    );
    if segments.is_empty() {
        return None;
    }
    let turn = |angle: f64| {
        let (sin, cos) = libm::sincos(angle);
        [cos, sin]
    };
    let (theta, omega) = (recording.theta_rad, recording.omega_rad_s);
    let data = Data {
        h,
        position: recording.position_m,
        current: recording.current_a,
        omega,
        hold: recording.hold,
        at: theta.iter().map(|theta| turn(*theta)).collect(),
        middle: theta.iter().zip(omega).map(|(theta, omega)| turn(theta - 0.5 * h * omega)).collect(),
        reach: ((RATE_S / h).round() as usize).max(1),
    };
    let long = repeats && segments.iter().map(Range::len).sum::<usize>() > MEASURED;
    let synchronous = if long { Synchronous::new(&data, &segments) } else { Synchronous::default() };
    let mut track = Track { state: vec![[0.0; 4]; rows], level: vec![[0.0; 3]; rows], synchronous };
    for segment in &segments {
        for row in segment.clone() {
            let (before, after) = (row.max(segment.start + 1) - 1, (row + 1).min(segment.end - 1));
            let velocity = |a: usize| {
                (recording.position_m[after][a] - recording.position_m[before][a]) / ((after - before) as f64 * h)
            };
            let [y, z] = recording.position_m[row];
            track.state[row] = [y, z, velocity(0), velocity(1)];
        }
    }
    let noise = recording.position_noise_m.unwrap_or_else(|| position_noise(recording.position_m, &segments));
    Some(Case {
        data,
        recording,
        pieces: pieces(&segments, h),
        segments,
        position_noise: noise.max(1e-10),
        current_noise: recording.current_noise_a.unwrap_or(CURRENT_NOISE_A).max(1e-7),
        track,
    })
}

/// All that is searched.
struct Search<'a> {
    cases: Vec<Case<'a>>,
    options: &'a Options,
    /// Unknowns as in [`unknown`].
    x: Vec<f64>,
    /// Mean and standard deviation of the prior of each unknown; 0 for what is not estimated.
    prior: Vec<(f64, f64)>,
    iterations: usize,
    converged: bool,
}

impl<'a> Search<'a> {
    fn nominal(&self) -> Nominal {
        Nominal { m_kg: self.options.m_kg, gap_m: self.options.gap_m, alpha_rad: self.options.alpha_rad }
    }

    fn theta(&self, r: usize) -> Theta {
        std::array::from_fn(|j| self.x[unknown(j, r)])
    }

    fn bearing(&self, r: usize) -> Bearing {
        Bearing::new(self.nominal(), &self.theta(r), self.cases[r].data.h, self.cases[r].current_noise)
    }

    /// Numbers of the unknowns that are estimated.
    fn estimated(&self) -> Vec<usize> {
        (0..self.x.len()).filter(|at| self.prior[*at].1 > 0.0).collect()
    }

    fn tasks(&self) -> Vec<(usize, &Piece)> {
        self.cases.iter().enumerate().flat_map(|(r, case)| case.pieces.iter().map(move |piece| (r, piece))).collect()
    }

    fn pass(&self, all: bool) -> Vec<(usize, Vec<Block>)> {
        let bearings: Vec<Bearing> = (0..self.cases.len()).map(|r| self.bearing(r)).collect();
        parallel(self.options.threads, &self.tasks(), |(r, piece)| {
            let case = &self.cases[*r];
            let variance = case.position_noise * case.position_noise;
            let pass = if all { filter::all_columns } else { filter::few_columns };
            (*r, pass(&case.data, &bearings[*r], &case.track, variance, piece))
        })
    }

    fn normal(&self, blocks: &[(usize, Vec<Block>)], all: bool) -> Normal {
        let mut normal = Normal::new(self.cases.len());
        for (r, blocks) in blocks {
            for block in blocks {
                normal.add(block, *r, if all { ALL } else { BASE });
            }
        }
        normal
    }

    /// `J + Π` and `b + Π(mean − x)` of what is estimated.
    fn equations(&self, normal: &Normal, of: &[usize]) -> (DMatrix<f64>, DVector<f64>) {
        let mut a = part(&normal.j, of, of);
        let mut b = DVector::from_fn(of.len(), |i, _| normal.b[of[i]]);
        for (i, at) in of.iter().enumerate() {
            let (mean, std) = self.prior[*at];
            let weight = 1.0 / (std * std);
            a[(i, i)] += weight;
            b[i] += weight * (mean - self.x[*at]);
        }
        (a, b)
    }

    /// One Gauss–Newton step, scaled by `part`.
    fn step(&mut self, normal: &Normal) -> Result<f64, Failed> {
        let step = self.newton(normal)?;
        self.x = self.moved(&self.x, &step.step, self.within(&step.step));
        Ok(step.largest)
    }

    /// The step of Gauss and Newton from the present point.
    fn newton(&self, normal: &Normal) -> Result<Step, Failed> {
        let of = self.estimated();
        let (a, b) = self.equations(normal, &of);
        let covariance = inverse(&a)
            .filter(|_| b.iter().all(|b| b.is_finite()))
            .ok_or_else(|| Failed::Diverged("the normal equations are not positive definite".into()))?;
        let solved = &covariance * &b;
        let mut step = Step { step: vec![0.0; self.x.len()], largest: 0.0, gain: b.dot(&solved) };
        for (i, at) in of.iter().enumerate() {
            step.step[*at] = solved[i];
            step.largest = step.largest.max((solved[i] / covariance[(i, i)].sqrt()).abs());
        }
        Ok(step)
    }

    /// Part of a step that the linearisation can follow: it is shortened as a whole, for its components belong together.
    fn within(&self, step: &[f64]) -> f64 {
        let most = |at: usize| match at {
            LOAD..SHARED => LONGEST * PARAMETERS[at - LOAD].typical,
            // λ is a positive number.
            0..3 if step[at] < 0.0 => 0.7 * self.x[at],
            0..3 => 2.0 * self.x[at],
            _ => f64::INFINITY,
        };
        let moving = (0..step.len()).filter(|at| step[*at] != 0.0);
        moving.map(|at| most(at) / step[at].abs()).fold(1.0, f64::min)
    }

    /// The point that a part of a step leads to.
    ///
    /// Scales multiply: λ, mass, gains, gap, and with them forces and unbalance trade against each other along curves on which
    /// the likelihood hardly changes, and which are straight lines in the logarithms.
    fn moved(&self, x: &[f64], step: &[f64], part: f64) -> Vec<f64> {
        let mut to: Vec<f64> = x.iter().zip(step).map(|(x, step)| x + part * step).collect();
        let scaled = |x: f64, step: f64| x * libm::exp(part * step / x);
        for (at, to) in to.iter_mut().enumerate() {
            let small = |x: f64| (step[at] / x).abs() < STRAIGHT;
            match at {
                0..3 if small(x[at]) => *to = scaled(x[at], step[at]),
                LOAD..SHARED if PARAMETERS[at - LOAD].unit == "1" && small(1.0 + x[at]) => {
                    *to = scaled(1.0 + x[at], step[at]) - 1.0;
                }
                _ => {}
            }
        }
        // Unbalance and loads are complex numbers.
        let pairs = std::iter::once(3).chain((SHARED..x.len()).step_by(2));
        for at in pairs {
            let (a, b, da, db) = (x[at], x[at + 1], part * step[at], part * step[at + 1]);
            let square = a * a + b * b;
            let (along, across) = ((a * da + b * db) / square, (a * db - b * da) / square);
            if along * along + across * across < STRAIGHT * STRAIGHT {
                let size = libm::exp(along);
                let (sin, cos) = libm::sincos(across);
                to[at] = size * (a * cos - b * sin);
                to[at + 1] = size * (a * sin + b * cos);
            }
        }
        to
    }

    /// Twice the negative logarithm of likelihood and priors, up to a constant.
    fn merit(&self, blocks: &[(usize, Vec<Block>)]) -> f64 {
        let fit: f64 = blocks.iter().flat_map(|(_, blocks)| blocks).map(|block| block.nis + block.log_det).sum();
        let far = |at: &usize| {
            let (mean, std) = self.prior[*at];
            (self.x[*at] - mean) / std
        };
        fit + self.estimated().iter().map(far).map(|far| far * far).sum::<f64>()
    }

    fn smooth(&mut self) {
        let bearings: Vec<Bearing> = (0..self.cases.len()).map(|r| self.bearing(r)).collect();
        let smoothed = parallel(self.options.threads, &self.tasks(), |(r, piece)| {
            let case = &self.cases[*r];
            let variance = case.position_noise * case.position_noise;
            let track = filter::smooth(&case.data, &bearings[*r], &case.track, variance, piece);
            (*r, piece.counted.clone(), track)
        });
        for (r, rows, track) in smoothed {
            self.cases[r].track.state[rows].copy_from_slice(&track);
        }
        for (case, bearing) in self.cases.iter_mut().zip(&bearings) {
            for segment in &case.segments {
                case.track.set_levels(&case.data, bearing, segment);
            }
            let mut synchronous = std::mem::take(&mut case.track.synchronous);
            synchronous.fit(&case.data, bearing, &case.track);
            case.track.synchronous = synchronous;
        }
    }

    /// One step of the noise levels that were not told; the largest change of a logarithm.
    fn noise(&mut self) -> f64 {
        let factors = [libm::exp(-NOISE_STEP), 1.0, libm::exp(NOISE_STEP)];
        let bearings: Vec<Bearing> = (0..self.cases.len()).map(|r| self.bearing(r)).collect();
        let unknown =
            |case: &Case| case.recording.position_noise_m.is_none() || case.recording.current_noise_a.is_none();
        let tasks: Vec<(usize, &Piece)> = self.tasks().into_iter().filter(|(r, _)| unknown(&self.cases[*r])).collect();
        let sums = parallel(self.options.threads, &tasks, |(r, piece)| {
            let case = &self.cases[*r];
            let variance = case.position_noise * case.position_noise;
            (*r, filter::likelihoods(&case.data, &bearings[*r], &case.track, variance, factors, piece))
        });
        let mut largest: f64 = 0.0;
        for (r, case) in self.cases.iter_mut().enumerate().filter(|(_, case)| unknown(case)) {
            let mut total = [[0.0; 3]; 3];
            for (_, sums) in sums.iter().filter(|(of, _)| *of == r) {
                for (total, sums) in total.as_flattened_mut().iter_mut().zip(sums.as_flattened()) {
                    *total += sums;
                }
            }
            let change = noise_step(case, &total);
            largest = largest.max(change);
        }
        largest
    }

    /// Noise levels until they hardly change, in three steps at most; the first change of a logarithm.
    fn settle_noise(&mut self) -> f64 {
        let first = self.noise();
        let mut last = first;
        for _ in 0..2 {
            if last > NOISE_SETTLED {
                last = self.noise();
            }
        }
        first
    }

    /// Starts where a search over some of the rows ended.
    fn start_at(&mut self, first: &Self) -> bool {
        self.x.clone_from(&first.x);
        for (case, first) in self.cases.iter_mut().zip(&first.cases) {
            case.position_noise = first.position_noise;
            case.current_noise = first.current_noise;
        }
        true
    }

    /// λ, unbalance and load first, then all: far from the solution, bench parameters would take up what λ has to explain.
    fn run(&mut self) -> Result<(), Failed> {
        let told = self.prior.clone();
        if self.estimated().iter().any(|at| (LOAD..SHARED).contains(at)) {
            for prior in &mut self.prior[LOAD..SHARED] {
                prior.1 = 0.0;
            }
            let first = self.iterate(0, ROUGH);
            self.prior = told;
            first?;
            return self.iterate(UNSMOOTHED, CONVERGED);
        }
        self.iterate(0, CONVERGED)
    }

    /// Iterates until the largest step is smaller than `enough` standard deviations; the first `begun` iterations are done.
    ///
    /// A step with bench parameters that is too long ([`WORSE`]) is halved.
    fn iterate(&mut self, begun: usize, enough: f64) -> Result<(), Failed> {
        let all = self.estimated().iter().any(|at| (LOAD..SHARED).contains(at));
        self.converged = false;
        for r in 0..self.cases.len() {
            let bearing = self.bearing(r);
            let case = &mut self.cases[r];
            for segment in &case.segments {
                case.track.set_levels(&case.data, &bearing, segment);
            }
        }
        let mut from: Option<(f64, Vec<f64>, Step, f64)> = None;
        for iteration in begun..MOST {
            self.iterations = iteration + 1;
            let blocks = self.pass(all);
            let normal = self.normal(&blocks, all);
            let merit = self.merit(&blocks);
            let next = self.newton(&normal)?;
            if all
                && let Some((before, x, step, part)) = from.take()
                && (merit.is_nan() || (merit > before + WORSE && next.gain > step.gain + WORSE))
            {
                let part = 0.5 * part;
                self.x = self.moved(&x, &step.step, part);
                from = Some((before, x, step, part));
                self.smooth();
                self.settle_noise();
                continue;
            }
            let part = self.within(&next.step);
            let x = self.x.clone();
            self.x = self.moved(&x, &next.step, part);
            let mut largest = next.largest;
            from = Some((merit, x, next, part));
            if !self.x.iter().all(|x| x.is_finite()) {
                return Err(Failed::Diverged("an estimate is not finite".into()));
            }
            if iteration + 1 >= UNSMOOTHED {
                self.smooth();
                // The process noise is that of λ σ_i: the levels belong to the point before its likelihood counts.
                largest = largest.max(self.settle_noise());
            }
            if iteration > UNSMOOTHED && largest < enough {
                self.converged = true;
                break;
            }
        }
        Ok(())
    }
}

/// A step of Gauss and Newton.
struct Step {
    /// By unknown; 0 for what is not estimated.
    step: Vec<f64>,
    /// The largest component in standard deviations.
    largest: f64,
    /// By how much it promises to lower twice the negative logarithm of the likelihood.
    gain: f64,
}

/// Noise levels of one recording from the likelihood at three levels of the current noise; the largest change of a logarithm.
fn noise_step(case: &mut Case, sums: &[[f64; 3]; 3]) -> f64 {
    let (told_position, told_current) =
        (case.recording.position_noise_m.is_some(), case.recording.current_noise_a.is_some());
    let count = 2.0 * sums[1][2];
    if count < 8.0 {
        return 0.0;
    }
    let at = |f: f64| f * NOISE_STEP;
    let logs = |i: usize| libm::log(sums[i][1] / count);
    // The common scale of both levels is known in closed form where neither is told.
    let scale_is_free = !told_position && !told_current;
    let value = |i: usize| {
        let fit = if scale_is_free { count * logs(i) } else { sums[i][1] };
        let level = libm::log(case.current_noise / CURRENT_NOISE_A)
            + at(i as f64 - 1.0)
            + if scale_is_free { 0.5 * logs(i) } else { 0.0 };
        let far = level / CURRENT_NOISE_LOG_STD;
        -0.5 * (sums[i][0] + fit + far * far)
    };
    let [low, mid, high] = [0, 1, 2].map(value);
    let slope = (high - low) / (2.0 * NOISE_STEP);
    let bend = (high - 2.0 * mid + low) / (NOISE_STEP * NOISE_STEP);
    let most = 4.0 * NOISE_STEP;
    let ratio = if bend < 0.0 { (-slope / bend).clamp(-most, most) } else { most.copysign(slope) };
    let rms = {
        let currents = case.recording.current_a.iter().flatten().filter(|i| i.is_finite());
        let (sum, n) = currents.fold((0.0, 0.0), |(sum, n), i| (sum + i * i, n + 1.0));
        (sum / n).sqrt()
    };
    let scale = {
        let t = ratio / NOISE_STEP;
        let (l, m, h) = (logs(0), logs(1), logs(2));
        let inside = t.clamp(-1.0, 1.0);
        0.5 * (m + 0.5 * inside * (h - l) + 0.5 * inside * inside * (h - 2.0 * m + l))
    };
    let (before_position, before_current) = (case.position_noise, case.current_noise);
    if scale_is_free {
        case.position_noise *= libm::exp(scale);
        case.current_noise *= libm::exp(ratio + scale);
    } else if !told_current {
        case.current_noise *= libm::exp(ratio);
    } else if !told_position {
        // The level of the positions alone: what the common scale says, again and again.
        case.position_noise *= libm::exp(logs(1).clamp(-1.0, 1.0));
    }
    case.position_noise = case.position_noise.max(1e-10);
    // Beyond it the square of a current would be all noise.
    case.current_noise = case.current_noise.clamp(1e-6, 0.39 * rms.max(1e-5));
    // A level that hardly matters has not to converge: weigh its change by its information.
    let weight = (-bend.min(0.0)).sqrt().min(1.0);
    libm::log(case.position_noise / before_position)
        .abs()
        .max(libm::log(case.current_noise / before_current).abs() * weight)
}

/// λ that would carry the weight of the rotor with the currents of the recording.
fn first_guess(recordings: &[Recording<'_>], options: &Options) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for i in recordings.iter().flat_map(|recording| recording.current_a).flatten().filter(|i| i.is_finite()) {
        sum += i * i;
        count += 1.0;
    }
    let mean: f64 = if sum > 0.0 { sum / count } else { 1.0 };
    const GRAVITY_M_S2: f64 = 9.81;
    options.m_kg * GRAVITY_M_S2 * options.gap_m * options.gap_m / (3.0 * mean)
}

/// Where the search starts, and with which priors.
fn start<'a>(recordings: &'a [Recording<'a>], masks: &[Vec<bool>], options: &'a Options) -> Result<Search<'a>, Failed> {
    let bench = options.bench.iter().any(|told| told.knowledge != Knowledge::Exact);
    let cases: Option<Vec<Case>> =
        recordings.iter().zip(masks).map(|(recording, mask)| prepare(recording, mask, bench)).collect();
    let Some(cases) = cases else {
        let short = |(recording, mask): (&'a Recording<'a>, &Vec<bool>)| prepare(recording, mask, false).is_none();
        let recording = recordings.iter().zip(masks).position(short).unwrap_or(0) + 1;
        return Err(Failed::TooShort { recording, wanted: SHORTEST });
    };
    let lambda = options.lambda0_nm2_a2.unwrap_or([first_guess(recordings, options); 3]);
    let n = SHARED + 2 * recordings.len();
    let mut x = vec![0.0; n];
    let mut prior = vec![(0.0, 0.0); n];
    for k in 0..3 {
        x[k] = lambda[k];
        prior[k] = (lambda[k], FREE * lambda[k]);
    }
    // A mass centre outside the gap, or a load of a hundred times the weight, does not occur.
    prior[3..LOAD].fill((0.0, 100.0 * options.m_kg * options.gap_m));
    prior[SHARED..n].fill((0.0, 1e3 * options.m_kg));
    for (j, told) in options.bench.iter().enumerate() {
        x[LOAD + j] = told.value;
        let std = match told.knowledge {
            Knowledge::Exact => 0.0,
            Knowledge::Tolerance(std) => std,
            Knowledge::Free => FREE * PARAMETERS[j].typical,
        };
        prior[LOAD + j] = (told.value, std);
    }
    Ok(Search { cases, options, x, prior, iterations: 0, converged: false })
}

/// χ² of a change of three force constants between two blocks above which it counts. At one place chance makes 30 with a probability of
/// 1.4 · 10⁻⁶ (three degrees of freedom); there are [`BLOCKS`] places, which are not independent of each other.
const CHANGE: f64 = 30.0;
/// A change of λ less than this, relative, is no change of the bearing but what models leave.
const LEAST_CHANGE: f64 = 0.01;
/// Normalised innovations squared of a block, relative to the median of all, above which it is left out, and by how many of their
/// standard deviations they are at least.
const DISTURBED: f64 = 2.0;
const DISTURBED_STD: f64 = 8.0;
/// Least part of the rows that has to remain.
const REMAINS: f64 = 0.5;
/// χ² with one degree of freedom above which a bench parameter is a suspect: 8 · 10⁻⁶ by chance.
const SUSPECT: f64 = 20.0;
/// Blocks from which scores give a covariance.
const SCORES: usize = 32;
/// By how much the variance from scores exceeds that of the information before it counts. From n blocks it scatters by about √(2/n), more
/// with the lag: 0.25 for 32 blocks.
const SCORES_RATIO: f64 = 2.0;

/// A finished search, its sums taken over all columns.
struct Finished<'a> {
    search: Search<'a>,
    blocks: Vec<(usize, Vec<Block>)>,
    normal: Normal,
    estimated: Vec<usize>,
    /// Covariance by noise alone, and with priors, of what is estimated.
    noise: DMatrix<f64>,
    total: DMatrix<f64>,
    covariance: Covariance,
}

impl Finished<'_> {
    fn at(&self, unknown: usize) -> Option<usize> {
        self.estimated.iter().position(|at| *at == unknown)
    }

    fn estimate(&self, unknown: usize) -> Estimate {
        let std = |matrix: &DMatrix<f64>| self.at(unknown).map_or(0.0, |i| matrix[(i, i)].max(0.0).sqrt());
        Estimate { value: self.search.x[unknown], noise_std: std(&self.noise), total_std: std(&self.total) }
    }

    fn nis(&self, r: usize) -> f64 {
        let blocks = || self.blocks.iter().filter(move |(of, _)| *of == r).flat_map(|(_, blocks)| blocks);
        blocks().map(|block| block.nis).sum::<f64>() / (2.0 * blocks().map(|block| block.count).sum::<f64>())
    }
}

fn finish(mut search: Search<'_>) -> Result<Finished<'_>, Failed> {
    let blocks = search.pass(true);
    let normal = search.normal(&blocks, true);
    let before = search.x.clone();
    let before_step = search.step(&normal)?;
    // The sums are those of the point before the last step, which no longer matters unless it was a large one.
    if before_step > 1.0 {
        search.converged = false;
    }
    let estimated = search.estimated();
    let (a, _) = search.equations(&normal, &estimated);
    let response =
        inverse(&a).ok_or_else(|| Failed::Diverged("the information matrix is not positive definite".into()))?;
    let weights = DMatrix::from_fn(estimated.len(), estimated.len(), |i, l| {
        if i == l { 1.0 / (search.prior[estimated[i]].1 * search.prior[estimated[i]].1) } else { 0.0 }
    });
    let information = part(&normal.j, &estimated, &estimated);
    let mut noise = &response * &information * &response;
    let mut covariance = Covariance::Information;
    let told = |case: &Case| case.recording.position_noise_m.is_some() && case.recording.current_noise_a.is_some();
    if !search.cases.iter().all(told) {
        let step: Vec<f64> = search.x.iter().zip(&before).map(|(x, before)| x - before).collect();
        if let Some(scores) = scores(&blocks, &estimated, &step, search.cases.len()) {
            let by_scores = &response * scores * &response;
            let larger = (0..3).any(|k| by_scores[(k, k)] > SCORES_RATIO * noise[(k, k)]);
            if larger {
                noise = by_scores;
                covariance = Covariance::Scores;
            }
        }
    }
    let total = &noise + &response * weights * &response;
    Ok(Finished { search, blocks, normal, estimated, noise, total, covariance })
}

/// Covariance of the sum of the scores, with the covariance between neighbouring blocks (Newey and West 1987, one lag).
fn scores(blocks: &[(usize, Vec<Block>)], of: &[usize], step: &[f64], recordings: usize) -> Option<DMatrix<f64>> {
    let count: usize = blocks.iter().map(|(_, blocks)| blocks.len()).sum();
    if count < SCORES {
        return None;
    }
    let mut sum = DMatrix::zeros(of.len(), of.len());
    let mut former: Option<(usize, DVector<f64>)> = None;
    for (r, blocks) in blocks {
        for block in blocks {
            let mut alone = Normal::new(recordings);
            alone.add(block, *r, ALL);
            let step = DVector::from_column_slice(step);
            let score = alone.b - alone.j * step;
            let score = DVector::from_fn(of.len(), |i, _| score[of[i]]);
            sum += &score * score.transpose();
            if let Some((of, former)) = &former
                && of == r
            {
                let product = &score * former.transpose();
                sum += (&product + product.transpose()) * 0.5;
            }
            former = Some((*r, score));
        }
    }
    Some(sum)
}

/// Numbers of the bench parameters that are free but not told by the data.
fn not_separated(finished: &Finished) -> Vec<usize> {
    let too_wide = |j: &usize| {
        let unknown = LOAD + j;
        let free = finished.search.options.bench[*j].knowledge == Knowledge::Free;
        free && finished.estimate(unknown).total_std > NOT_SEPARATED * PARAMETERS[*j].typical
    };
    (0..BENCH).filter(too_wide).collect()
}

/// Some of the rows in stretches, evenly distributed; `None` where there are few.
fn stretches(masks: &[Vec<bool>]) -> Option<Vec<Vec<bool>>> {
    let all: usize = masks.iter().flatten().filter(|used| **used).count();
    let period = STRETCH * all / FIRST_ROWS;
    let used = |mask: &Vec<bool>| mask.iter().enumerate().map(|(row, used)| *used && row % period < STRETCH).collect();
    (period > 2 * STRETCH).then(|| masks.iter().map(used).collect())
}

/// The widest of them: the others may be told once it is held.
fn widest(finished: &Finished, of: &[usize]) -> Option<usize> {
    let width = |j: usize| finished.estimate(LOAD + j).total_std / PARAMETERS[j].typical;
    of.iter().copied().reduce(|widest, j| if width(j) > 0.99 * width(widest) { j } else { widest })
}

fn fit<'a>(
    recordings: &'a [Recording<'a>],
    masks: &[Vec<bool>],
    options: &'a Options,
    held: &mut Vec<usize>,
) -> Result<Finished<'a>, Failed> {
    let mut search = start(recordings, masks, options)?;
    let hold = |search: &mut Search, held: &[usize]| held.iter().for_each(|j| search.prior[LOAD + j].1 = 0.0);
    hold(&mut search, held);
    let near = match stretches(masks).map(|masks| start(recordings, &masks, options)) {
        Some(Ok(mut first)) => {
            hold(&mut first, held);
            first.run().is_ok() && first.converged && search.start_at(&first)
        }
        _ => false,
    };
    if near {
        search.smooth();
        search.iterate(UNSMOOTHED, CONVERGED)?;
    } else {
        search.run()?;
    }
    loop {
        let finished = finish(search)?;
        let wide = not_separated(&finished);
        let Some(widest) = widest(&finished, &wide) else { return Ok(finished) };
        held.push(widest);
        search = finished.search;
        search.prior[LOAD + widest].1 = 0.0;
        search.x[LOAD + widest] = options.bench[widest].value;
        search.run()?;
    }
}

fn everything(recordings: &[Recording<'_>]) -> Vec<Vec<bool>> {
    recordings.iter().map(|recording| vec![true; recording.position_m.len()]).collect()
}

pub(super) fn identify(recordings: &[Recording<'_>], options: &Options) -> Result<Identification, Failed> {
    let mut masks = everything(recordings);
    let mut held = Vec::new();
    let mut contradictions: Vec<Contradiction> = Vec::new();
    let mut finished = fit(recordings, &masks, options, &mut held)?;
    // Each round leaves out what contradicts most.
    for _ in 0..4 {
        // Away from the solution everything contradicts everything.
        if !finished.search.converged {
            break;
        }
        if let Some(change) = change(&finished) {
            let Some(other) = leave_smaller_side(&mut masks, &finished, &change) else { break };
            contradictions.push(describe(recordings, &masks, options, &change, other));
        } else {
            let disturbed = disturbed(&finished);
            let rows =
                |r: usize| finished.search.cases[r].pieces.iter().map(|piece| piece.counted.len()).sum::<usize>();
            let left: usize = disturbed.iter().map(|contradiction| contradiction.rows.len()).sum();
            let all: usize = (0..recordings.len()).map(rows).sum();
            if disturbed.is_empty() || left as f64 > (1.0 - REMAINS) * all as f64 {
                break;
            }
            for contradiction in disturbed {
                masks[contradiction.recording][contradiction.rows.clone()].fill(false);
                contradictions.push(contradiction);
            }
        }
        finished = fit(recordings, &masks, options, &mut held)?;
    }
    Ok(report(&finished, held, contradictions))
}

/// See [`super::cramer_rao`].
pub(super) fn cramer_rao(recordings: &[Recording<'_>], options: &Options) -> Result<Vec<f64>, Failed> {
    let masks = everything(recordings);
    let finished = fit(recordings, &masks, options, &mut Vec::new())?;
    let (a, _) = finished.search.equations(&finished.normal, &finished.estimated);
    let covariance = inverse(&a).ok_or_else(|| Failed::Diverged("the information matrix is singular".into()))?;
    Ok((0..finished.search.x.len())
        .map(|unknown| finished.at(unknown).map_or(0.0, |i| covariance[(i, i)].sqrt()))
        .collect())
}

/// See [`super::score_at`].
pub(super) fn score_at(recordings: &[Recording<'_>], options: &Options, unknowns: &[f64]) -> Result<Score, Failed> {
    let masks = everything(recordings);
    let mut search = start(recordings, &masks, options)?;
    search.x.copy_from_slice(unknowns);
    for _ in 0..3 {
        search.smooth();
    }
    let normal = search.normal(&search.pass(true), true);
    let information = normal.j.row_iter().map(|row| row.iter().copied().collect()).collect();
    Ok(Score { score: normal.b.iter().copied().collect(), information })
}

/// A change of λ or load in a recording.
struct Found {
    recording: usize,
    /// First row after it.
    row: usize,
    lambda: bool,
    chi_square: f64,
}

/// The most significant change of λ or load.
///
/// For a change after block n the score of the blocks up to it, `g`, has the covariance `J_n − J_n J⁻¹ J_n`, all other unknowns estimated.
fn change(finished: &Finished) -> Option<Found> {
    let search = &finished.search;
    let of = &finished.estimated;
    let (a, _) = search.equations(&finished.normal, of);
    let inverse_all = inverse(&a)?;
    let mut found: Option<Found> = None;
    for r in 0..search.cases.len() {
        let dispersion = finished.nis(r).max(1.0);
        let mut until = Normal::new(search.cases.len());
        let blocks: Vec<&Block> =
            finished.blocks.iter().filter(|(of, _)| *of == r).flat_map(|(_, blocks)| blocks).collect();
        let end = blocks.last().map_or(0, |block| block.rows.end);
        for block in blocks.iter().take(blocks.len().saturating_sub(1)) {
            until.add(block, r, ALL);
            // A few rows at the end say nothing, and the covariance of what is before them is rounding.
            if end - block.rows.end < SHORTEST_BLOCK {
                continue;
            }
            for (lambda, unknowns) in [(true, vec![0, 1, 2]), (false, vec![unknown(LOAD, r), unknown(LOAD + 1, r)])] {
                let g = DVector::from_fn(unknowns.len(), |i, _| until.b[unknowns[i]]);
                let c = part(&until.j, &unknowns, of);
                let covariance = part(&until.j, &unknowns, &unknowns) - &c * &inverse_all * c.transpose();
                let Some(gain) = inverse(&covariance) else { continue };
                let step = &gain * &g;
                let chi_square = step.dot(&g) / dispersion;
                let relative = (0..3).map(|k| (step.get(k).copied().unwrap_or(0.0) / search.x[k]).abs());
                let large = !lambda || relative.fold(0.0, f64::max) > LEAST_CHANGE;
                let best = found.as_ref().map_or(CHANGE, |found| found.chi_square);
                if chi_square > best && large {
                    found = Some(Found { recording: r, row: block.rows.end, lambda, chi_square });
                }
            }
        }
    }
    found
}

/// Leaves out the smaller side of a change; returns its rows, unless nothing would remain.
fn leave_smaller_side(masks: &mut [Vec<bool>], finished: &Finished, change: &Found) -> Option<Range<usize>> {
    let case = &finished.search.cases[change.recording];
    let mask = &mut masks[change.recording];
    let block = case.pieces.first()?.block;
    let used = |rows: Range<usize>, mask: &[bool]| mask[rows].iter().filter(|used| **used).count();
    let rows = mask.len();
    let before = used(0..change.row, mask);
    let after = used(change.row..rows, mask);
    if before.min(after) == 0 || before.max(after) < SHORTEST {
        return None;
    }
    // The change is somewhere within the block before or after.
    let range = if before < after { 0..(change.row + block).min(rows) } else { change.row.saturating_sub(block)..rows };
    mask[range.clone()].fill(false);
    Some(if before < after { 0..change.row } else { change.row..rows })
}

/// What the side that was left out says for itself.
fn describe(
    recordings: &[Recording<'_>],
    masks: &[Vec<bool>],
    options: &Options,
    change: &Found,
    rows: Range<usize>,
) -> Contradiction {
    let recording = change.recording;
    let what = if change.lambda {
        let mut mask = vec![false; masks[recording].len()];
        mask[rows.clone()].fill(true);
        let alone = &recordings[recording..=recording];
        let fitted = fit(alone, &[mask], options, &mut Vec::new());
        let lambda = fitted
            .map_or([Estimate { value: f64::NAN, noise_std: f64::NAN, total_std: f64::NAN }; 3], |fitted| {
                [0, 1, 2].map(|k| fitted.estimate(k))
            });
        Change::Lambda { lambda, chi_square: change.chi_square }
    } else {
        Change::Load { chi_square: change.chi_square }
    };
    Contradiction { recording, rows, what }
}

/// Blocks whose innovations are too large.
fn disturbed(finished: &Finished) -> Vec<Contradiction> {
    let mut found: Vec<Contradiction> = Vec::new();
    for recording in 0..finished.search.cases.len() {
        let blocks: Vec<&Block> =
            finished.blocks.iter().filter(|(of, _)| *of == recording).flat_map(|(_, blocks)| blocks).collect();
        let mean = |block: &Block| block.nis / (2.0 * block.count);
        let mut sorted: Vec<f64> = blocks.iter().map(|block| mean(block)).collect();
        sorted.sort_by(f64::total_cmp);
        let median = sorted.get(sorted.len() / 2).copied().unwrap_or(1.0);
        for block in blocks {
            let ratio = mean(block) / median;
            // The variance of χ² with 2n degrees of freedom is 4n.
            if ratio > DISTURBED && ratio > 1.0 + DISTURBED_STD / block.count.sqrt() {
                match found.last_mut() {
                    Some(Contradiction { recording: r, rows, what: Change::Disturbed { ratio: before } })
                        if *r == recording && rows.end == block.rows.start =>
                    {
                        rows.end = block.rows.end;
                        *before = before.max(ratio);
                    }
                    _ => found.push(Contradiction {
                        recording,
                        rows: block.rows.clone(),
                        what: Change::Disturbed { ratio },
                    }),
                }
            }
        }
    }
    found
}

fn report(
    finished: &Finished,
    mut held: Vec<usize>,
    contradictions: Vec<Contradiction>,
) -> Identification {
    held.sort_unstable();
    held.dedup();
    let search = &finished.search;
    let lambda = [0, 1, 2].map(|k| finished.estimate(k));
    let unbalance = [3, 4].map(|at| finished.estimate(at));
    let (magnitude, phase) = polar(finished, unbalance);
    let bench = std::array::from_fn(|j| BenchEstimate {
        told: search.options.bench[j],
        estimate: finished.estimate(LOAD + j),
        estimated: finished.at(LOAD + j).is_some(),
    });
    Identification {
        lambda,
        unbalance,
        unbalance_magnitude: magnitude,
        unbalance_phase: phase,
        conditions: (0..search.cases.len()).map(|r| conditions(finished, r, &lambda)).collect(),
        bench,
        not_separated: held,
        budget: budget(finished),
        residuals: (0..search.cases.len()).map(|r| residuals(finished, r)).collect(),
        suspects: suspects(finished),
        contradictions,
        covariance: finished.covariance,
        iterations: search.iterations,
        converged: search.converged,
        log_likelihood: -0.5 * search.merit(&finished.blocks),
    }
}

/// Magnitude and phase of the unbalance.
fn polar(finished: &Finished, [c, s]: [Estimate; 2]) -> (Estimate, Estimate) {
    let size = (c.value * c.value + s.value * s.value).sqrt();
    let (Some(i), Some(l)) = (finished.at(3), finished.at(4)) else {
        return (Estimate { value: size, ..Estimate::default() }, Estimate::default());
    };
    let (along, across) = ([c.value / size, s.value / size], [-s.value / size, c.value / size]);
    let std = |matrix: &DMatrix<f64>, d: [f64; 2]| {
        (d[0] * d[0] * matrix[(i, i)] + 2.0 * d[0] * d[1] * matrix[(i, l)] + d[1] * d[1] * matrix[(l, l)])
            .max(0.0)
            .sqrt()
    };
    let of = |value: f64, d: [f64; 2], per: f64| Estimate {
        value,
        noise_std: std(&finished.noise, d) / per,
        total_std: std(&finished.total, d) / per,
    };
    (of(size, along, 1.0), of(libm::atan2(s.value, c.value), across, size))
}

fn conditions(finished: &Finished, r: usize, lambda: &[Estimate; 3]) -> Conditions {
    let search = &finished.search;
    let case = &search.cases[r];
    let bearing = search.bearing(r);
    let (mut ki, mut ks, mut rows) = ([0.0; 3], [0.0; 3], 0);
    for piece in &case.pieces {
        for row in piece.counted.clone().skip(usize::from(piece.counted.start == piece.filtered.start)) {
            let gaps = bearing.gaps_at(&case.track.state[row]);
            let squares = case.data.square(&bearing, row);
            for k in 0..3 {
                let square = squares[k].max(0.0);
                ki[k] += square.sqrt() / (gaps[k] * gaps[k]);
                ks[k] += square / (gaps[k] * gaps[k] * gaps[k]);
            }
            rows += 1;
        }
    }
    let scaled = |factor: f64, of: &Estimate| Estimate {
        value: factor * of.value,
        noise_std: factor * of.noise_std,
        total_std: factor * of.total_std,
    };
    Conditions {
        load_n: [LOAD, LOAD + 1].map(|j| finished.estimate(unknown(j, r))),
        position_noise_m: case.position_noise,
        current_noise_a: case.current_noise,
        rows: case.pieces.iter().map(|piece| piece.counted.len()).sum(),
        nis: finished.nis(r),
        ki_n_a: std::array::from_fn(|k| scaled(2.0 * ki[k] / f64::from(rows.max(1)), &lambda[k])),
        ks_n_m: std::array::from_fn(|k| scaled(2.0 * ks[k] / f64::from(rows.max(1)), &lambda[k])),
    }
}

fn budget(finished: &Finished) -> Vec<BudgetLine> {
    let search = &finished.search;
    let relative = |k: usize, value: f64| value / search.x[k];
    let line = |j: usize| {
        let unknown = LOAD + j;
        let told = search.options.bench[j].knowledge;
        let tolerance = match told {
            Knowledge::Tolerance(std) => std,
            _ => PARAMETERS[j].typical,
        };
        // All that is estimated follows an error of the parameter, but for the parameter itself.
        let others: Vec<usize> = finished.estimated.iter().copied().filter(|at| *at != unknown).collect();
        let (a, _) = search.equations(&finished.normal, &others);
        let response = inverse(&a).map(|inverse| inverse * part(&finished.normal.j, &others, &[unknown]));
        let sensitivity =
            std::array::from_fn(|k| response.as_ref().map_or(f64::NAN, |response| relative(k, response[(k, 0)])));
        let contribution = match finished.at(unknown) {
            None => sensitivity.map(|s: f64| s.abs() * tolerance),
            Some(i) => std::array::from_fn(|k| {
                // Cov(λ, p)²/Var p is what λ's variance loses when p is known.
                let (cross, own) = (finished.total[(k, i)], finished.total[(i, i)]);
                relative(k, (cross * cross / own).sqrt())
            }),
        };
        BudgetLine { parameter: j, sensitivity, tolerance, told: told != Knowledge::Exact, contribution }
    };
    (0..BENCH).map(line).collect()
}

fn residuals(finished: &Finished, r: usize) -> Residuals {
    let blocks = || finished.blocks.iter().filter(move |(of, _)| *of == r).flat_map(|(_, blocks)| blocks);
    let rows: f64 = blocks().map(|block| block.count).sum();
    let nis: f64 = blocks().map(|block| block.nis).sum::<f64>();
    let mut residuals = Residuals { harmonics: [[0.0; 2]; 4], amplitudes: [[0.0; 2]; 4], lags: [0.0; 4] };
    const { assert!(HARMONICS == 4 && LAGS == 4) };
    for harmonic in 0..HARMONICS {
        for axis in 0..2 {
            let sum = |part: usize| blocks().map(|block| block.harmonics[harmonic][axis][part]).sum::<f64>();
            let power = sum(0) * sum(0) + sum(1) * sum(1);
            residuals.harmonics[harmonic][axis] = 2.0 * power / rows;
            residuals.amplitudes[harmonic][axis] = 2.0 * power.sqrt() / rows;
        }
    }
    for lag in 0..LAGS {
        residuals.lags[lag] = blocks().map(|block| block.lags[lag]).sum::<f64>() / nis;
    }
    residuals
}

/// Lagrange multiplier tests of the bench parameters that are not estimated.
fn suspects(finished: &Finished) -> Vec<Suspect> {
    let search = &finished.search;
    let of = &finished.estimated;
    let (a, b) = search.equations(&finished.normal, of);
    let Some(inverse) = inverse(&a) else { return Vec::new() };
    let rows: f64 = finished.blocks.iter().flat_map(|(_, blocks)| blocks).map(|block| 2.0 * block.count).sum();
    let nis = finished.blocks.iter().flat_map(|(_, blocks)| blocks).map(|block| block.nis).sum::<f64>() / rows;
    let mut suspects = Vec::new();
    for j in (0..BENCH).filter(|j| finished.at(LOAD + j).is_none()) {
        let unknown = LOAD + j;
        let cross = part(&finished.normal.j, &[unknown], of);
        let projected = &cross * &inverse;
        let all = finished.normal.j[(unknown, unknown)];
        let own = all - (&projected * cross.transpose())[(0, 0)];
        // What the other unknowns imitate up to rounding cannot be suspected.
        if own <= 1e-9 * all {
            continue;
        }
        let score = finished.normal.b[unknown] - (&projected * &b)[(0, 0)];
        let chi_square = score * score / own / nis.max(1.0);
        if chi_square > SUSPECT {
            suspects.push(Suspect {
                parameter: j,
                value: search.options.bench[j].value + score / own,
                std: (nis.max(1.0) / own).sqrt(),
                chi_square,
            });
        }
    }
    suspects.sort_by(|a, b| b.chi_square.total_cmp(&a.chi_square));
    suspects
}
