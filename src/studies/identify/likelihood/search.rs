//! The search for the most likely parameters.

use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::{DMatrix, DVector};

use super::bench::{BENCH, PARAMETERS};
use super::case::{Case, NOISE_STEP, noise_step, prepare};
use super::changes;
use super::equations::{ALL, BASE, Bearing, LOAD, Nominal, State, Theta};
use super::filter::{self, Block, Piece};
use super::instruments::Instruments;
use super::outcome;
use super::solve::{Normal, SHARED, inverse, part, unknown};
use super::{
    Contradiction, Covariance, Estimate, Failed, Identification, Knowledge, Options, Recording, SHORTEST, Score,
};

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
/// First guesses of λ, relative to that from the weight of the rotor. Currents that hold more than the weight make it too small; from a fifteenth, at
/// 6657 rpm, λ1 fell to 0 and stayed there (seed 62024 of drawn bearings).
const GUESSES: [f64; 2] = [1.0, 8.0];
/// Variance of the size of the bias of scores ([`bias`]): 0 where the loop is fast, 1 without feedback. With the 0.25 of the on-line estimator error/std
/// was 0.86 and 0.87 over 5 s; with 0.0625 it is 0.87 and 0.96 (drawn bearings, seeds 94001 and 63001).
const BIAS_VARIANCE: f64 = 0.0625;
/// Most steps with instruments.
const INSTRUMENTAL: usize = 4;
/// Longest step of a bench parameter, in typical tolerances.
const LONGEST: f64 = 3.0;
/// Changes of the logarithm of a noise level below this need no second look.
const NOISE_SETTLED: f64 = 0.002;
/// A parameter without a tolerance has one that cannot matter, in typical tolerances.
const FREE: f64 = 1e3;
/// A free parameter that is known to this many typical tolerances only is not told by the data.
const NOT_SEPARATED: f64 = 20.0;

/// Where bench parameters are estimated, all rows together tell as much as so many: the likelihood is raised to the power `BENCH_ROWS`/rows.
///
/// Its scores have a bias that grows with the rows, their standard deviation with the root of them. Noise of the positions comes back through the
/// controller as current and motion, noise of the currents stands in the regressors; combinations of parameters that hardly change the motion (delay,
/// offsets, gap, and gain together) explain it. At the truth, nominal bench, 0.1 µm and 10 mA, the step with all typical tolerances is −2.1 standard
/// deviations in the delay after 5 s, −4.9 after 40 s, with 1 µm −10.6 in an offset and −6 in λ2 after 40 s (`score_at`, seeds 70000–70003). One
/// parameter alone shows none of it, nor do regressors that take from other turns what repeats; these leave too little to find the rest by.
const BENCH_ROWS: f64 = 50_000.0;
/// Rows of a long recording, in stretches over the whole of it, from which the search starts: all rows are for its last iterations.
const FIRST_ROWS: usize = 100_000;
const STRETCH: usize = 1 << 14;
/// Pieces that are smoothed together at least.
const SMOOTHED: usize = 8;

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

/// All that is searched.
pub(super) struct Search<'a> {
    pub cases: Vec<Case<'a>>,
    pub options: &'a Options,
    /// Unknowns as in [`unknown`].
    pub x: Vec<f64>,
    /// Mean and standard deviation of the prior of each unknown; 0 for what is not estimated.
    pub prior: Vec<(f64, f64)>,
    /// Power of the likelihood ([`BENCH_ROWS`]).
    weight: f64,
    pub iterations: usize,
    pub converged: bool,
}

impl<'a> Search<'a> {
    fn nominal(&self) -> Nominal {
        Nominal { m_kg: self.options.m_kg, gap_m: self.options.gap_m, alpha_rad: self.options.alpha_rad }
    }

    fn theta(&self, r: usize) -> Theta {
        std::array::from_fn(|j| self.x[unknown(j, r)])
    }

    pub fn bearing(&self, r: usize) -> Bearing {
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
        let mut blocks = parallel(self.options.threads, &self.tasks(), |(r, piece)| {
            let case = &self.cases[*r];
            let variance = case.position_noise * case.position_noise;
            let pass = if all { filter::all_columns } else { filter::few_columns };
            (*r, pass(&case.data, &bearings[*r], &case.track, variance, piece))
        });
        for block in blocks.iter_mut().flat_map(|(_, blocks)| blocks) {
            block.j.iter_mut().chain(&mut block.b).for_each(|sum| *sum *= self.weight);
        }
        blocks
    }

    fn normal(&self, blocks: &[(usize, Vec<Block>)], all: bool) -> Normal {
        let mut normal = Normal::new(self.cases.len());
        for (r, blocks) in blocks {
            for block in blocks {
                normal.add(block, *r, if all { ALL + 3 } else { BASE });
            }
        }
        normal
    }

    /// `J + Π` and `b + Π(mean − x)` of what is estimated.
    pub fn equations(&self, normal: &Normal, of: &[usize]) -> (DMatrix<f64>, DVector<f64>) {
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
    pub fn merit(&self, blocks: &[(usize, Vec<Block>)]) -> f64 {
        let fit: f64 = blocks.iter().flat_map(|(_, blocks)| blocks).map(|block| block.nis + block.log_det).sum();
        let far = |at: &usize| {
            let (mean, std) = self.prior[*at];
            (self.x[*at] - mean) / std
        };
        self.weight * fit + self.estimated().iter().map(far).map(|far| far * far).sum::<f64>()
    }

    /// Smooths the trajectories, a group of pieces at a time: those of all at once would take as much memory as the trajectories themselves.
    fn smooth(&mut self) {
        let bearings: Vec<Bearing> = (0..self.cases.len()).map(|r| self.bearing(r)).collect();
        let tasks: Vec<(usize, Piece)> = self.tasks().into_iter().map(|(r, piece)| (r, piece.clone())).collect();
        let mut before = Vec::new();
        for group in tasks.chunks(SMOOTHED.max(2 * self.options.threads)) {
            let smoothed = parallel(self.options.threads, group, |(r, piece)| {
                let case = &self.cases[*r];
                let variance = case.position_noise * case.position_noise;
                let track = filter::smooth(&case.data, &bearings[*r], &case.track, variance, piece);
                (*r, piece.counted.clone(), track)
            });
            // A piece is linearised about the former trajectory of its neighbours: a group is taken over after the next one.
            self.take_over(std::mem::replace(&mut before, smoothed));
        }
        self.take_over(before);
        for (case, bearing) in self.cases.iter_mut().zip(&bearings) {
            for segment in &case.segments {
                case.track.set_levels(&case.data, bearing, segment);
            }
        }
    }

    fn take_over(&mut self, smoothed: Vec<(usize, Range<usize>, Vec<State>)>) {
        for (r, rows, track) in smoothed {
            self.cases[r].track.state[rows].copy_from_slice(&track);
        }
    }

    /// Likelihoods of the recordings that `of` holds for, as [`filter::likelihoods`].
    fn likelihoods(&self, factors: [[f64; 3]; 3], of: impl Fn(&Case) -> bool) -> Vec<[[f64; 3]; 3]> {
        let bearings: Vec<Bearing> = (0..self.cases.len()).map(|r| self.bearing(r)).collect();
        let tasks: Vec<(usize, &Piece)> = self.tasks().into_iter().filter(|(r, _)| of(&self.cases[*r])).collect();
        let sums = parallel(self.options.threads, &tasks, |(r, piece)| {
            let case = &self.cases[*r];
            let variance = case.position_noise * case.position_noise;
            (*r, filter::likelihoods(&case.data, &bearings[*r], &case.track, variance, factors, piece))
        });
        let mut totals = vec![[[0.0; 3]; 3]; self.cases.len()];
        for (r, sums) in sums {
            let total = totals[r].as_flattened_mut().iter_mut();
            total.zip(sums.as_flattened()).for_each(|(total, sum)| *total += sum);
        }
        totals
    }

    /// One step of the noise levels that were not told; the largest change of a logarithm.
    fn noise(&mut self) -> f64 {
        let factors = [libm::exp(-NOISE_STEP), 1.0, libm::exp(NOISE_STEP)].map(|factor| [factor; 3]);
        let unknown =
            |case: &Case| case.recording.position_noise_m.is_none() || case.recording.current_noise_a.is_none();
        let totals = self.likelihoods(factors, unknown);
        let cases = self.cases.iter_mut().zip(&totals).filter(|(case, _)| unknown(case));
        cases.map(|(case, sums)| noise_step(case, sums)).fold(0.0, f64::max)
    }

    /// By how much noise of the currents lowers the scores of λ: `λ_k Σ γᵀ S⁻¹ γ` with γ the sensitivity to λ_k that this noise drives.
    ///
    /// S contains the same noise as process noise, so that this is half the derivative of Σ ln det S to the logarithm of its level, over λ_k.
    fn attenuation(&self) -> [f64; 3] {
        let sets = [-NOISE_STEP, NOISE_STEP].map(|step| {
            let raised = |k: usize| std::array::from_fn(|l| if k == l { libm::exp(step) } else { 1.0 });
            self.likelihoods([0, 1, 2].map(raised), |_| true)
        });
        let log_det = |set: &[[[f64; 3]; 3]], k: usize| set.iter().map(|sums| sums[k][0]).sum::<f64>();
        std::array::from_fn(|k| (log_det(&sets[1], k) - log_det(&sets[0], k)) / (4.0 * NOISE_STEP * self.x[k]))
    }

    /// Moves from the maximum of the likelihood to the estimate that instruments free of the bias of scores; returns the covariance that this adds.
    fn free_of_bias(&mut self) -> Result<DMatrix<f64>, Failed> {
        let of = self.estimated();
        let mut added = DMatrix::zeros(of.len(), of.len());
        for _ in 0..INSTRUMENTAL {
            let bearings: Vec<Bearing> = (0..self.cases.len()).map(|r| self.bearing(r)).collect();
            for (case, bearing) in self.cases.iter_mut().zip(&bearings) {
                case.track.instruments = Some(Instruments::new(&case.data, bearing, &case.track, &case.segments));
            }
            let normal = self.normal(&self.pass(true), true);
            let (j, b) = self.equations(&normal, &of);
            let inverse = inverse(&j)
                .ok_or_else(|| Failed::Diverged("the information matrix is not positive definite".into()))?;
            let attenuation = self.attenuation();
            let lowered = DVector::from_fn(of.len(), |i, _| attenuation.get(of[i]).copied().unwrap_or(0.0));
            let a = &inverse * lowered;
            let found = &inverse * b;
            let (size, variance) = bias(&normal, &of, &j, &found, &a);
            let step = found + &a * size;
            added = &a * a.transpose() * variance;
            for (i, at) in of.iter().enumerate() {
                self.x[*at] += step[i];
            }
            let of_std = |i: usize| (step[i] / (inverse[(i, i)] + added[(i, i)]).sqrt()).abs();
            if (0..of.len()).map(of_std).fold(0.0, f64::max) < CONVERGED {
                break;
            }
            self.smooth();
        }
        Ok(added)
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

    /// Where the search has ended.
    fn found(&self) -> Point {
        let noise = |case: &Case| [case.position_noise, case.current_noise];
        Point { x: self.x.clone(), noise: self.cases.iter().map(noise).collect() }
    }

    /// Starts where a search over some of the rows ended.
    fn start_at(&mut self, point: Point) {
        self.x = point.x;
        for (case, noise) in self.cases.iter_mut().zip(point.noise) {
            [case.position_noise, case.current_noise] = noise;
        }
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

/// Where a search ends: unknowns, and noise of positions and currents by recording.
struct Point {
    x: Vec<f64>,
    noise: Vec<[f64; 2]>,
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
    let cases: Option<Vec<Case>> =
        recordings.iter().zip(masks).map(|(recording, mask)| prepare(recording, mask)).collect();
    let Some(cases) = cases else {
        let short = |(recording, mask): (&'a Recording<'a>, &Vec<bool>)| prepare(recording, mask).is_none();
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
    let exact = options.bench.iter().all(|told| told.knowledge == Knowledge::Exact);
    let rows: usize = masks.iter().flatten().filter(|used| **used).count();
    let weight = if exact { 1.0 } else { (BENCH_ROWS / rows as f64).min(1.0) };
    Ok(Search { cases, options, x, prior, weight, iterations: 0, converged: false })
}

/// Least part of the rows that has to remain.
const REMAINS: f64 = 0.5;
/// Blocks from which scores give a covariance.
const SCORES: usize = 32;
/// By how much the variance from scores exceeds that of the information before it counts. From n blocks it scatters by about √(2/n), more
/// with the lag: 0.25 for 32 blocks.
const SCORES_RATIO: f64 = 2.0;

/// Size of the bias of the scores and its variance, at a point from which `step` leads to the maximum of the likelihood ϑ.
///
/// Noise of the currents in the regressors moves ϑ by −a, what the controller makes of the noise of the positions by about +a where its loop is fast. The
/// sum is −s a; s has the variance V ([`BIAS_VARIANCE`]). With `l = J a/(aᵀ J a)`, the difference `lᵀ (ϑ_IV − ϑ)` is s with the variance
/// `v = lᵀ P_IV l − 1/(aᵀ J a)`, so that `ŝ = V lᵀ (ϑ_IV − ϑ)/(V + v)`, and its variance is `V v/(V + v)`. The on-line estimator does the same.
fn bias(normal: &Normal, of: &[usize], j: &DMatrix<f64>, step: &DVector<f64>, a: &DVector<f64>) -> (f64, f64) {
    let unknown = (0.0, BIAS_VARIANCE);
    let weight = a.dot(&(j * a));
    if weight <= 0.0 {
        return unknown;
    }
    let l = j * a / weight;
    // Instruments take the place of the columns of λ.
    let first = normal.b.len() - 3;
    let rows: Vec<usize> = of.iter().map(|at| if *at < 3 { first + at } else { *at }).collect();
    let (h, g) = (part(&normal.j, &rows, of), part(&normal.j, &rows, &rows));
    let scale = j.diagonal().map(|own| 1.0 / own.sqrt());
    let scaled = DMatrix::from_fn(of.len(), of.len(), |i, c| h[(c, i)] * scale[i] * scale[c]);
    let Some(w) = scaled.lu().solve(&l.component_mul(&scale)) else { return unknown };
    let w = w.component_mul(&scale);
    let right = DVector::from_fn(rows.len(), |i, _| normal.b[rows[i]]);
    let difference = w.dot(&right) - l.dot(step);
    let variance = (w.dot(&(g * &w)) - 1.0 / weight).max(0.0);
    if !difference.is_finite() || !variance.is_finite() {
        return unknown;
    }
    let part = BIAS_VARIANCE / (BIAS_VARIANCE + variance);
    (part * difference, part * variance)
}

/// A finished search, its sums taken over all columns.
pub(super) struct Finished<'a> {
    pub search: Search<'a>,
    pub blocks: Vec<(usize, Vec<Block>)>,
    pub normal: Normal,
    pub estimated: Vec<usize>,
    /// Covariance by noise alone, and with priors, of what is estimated.
    pub noise: DMatrix<f64>,
    pub total: DMatrix<f64>,
    pub covariance: Covariance,
}

impl Finished<'_> {
    pub fn at(&self, unknown: usize) -> Option<usize> {
        self.estimated.iter().position(|at| *at == unknown)
    }

    pub fn estimate(&self, unknown: usize) -> Estimate {
        let std = |matrix: &DMatrix<f64>| self.at(unknown).map_or(0.0, |i| matrix[(i, i)].max(0.0).sqrt());
        Estimate { value: self.search.x[unknown], noise_std: std(&self.noise), total_std: std(&self.total) }
    }

    pub fn nis(&self, r: usize) -> f64 {
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
            // Scores of `weight` times the information have `weight²` times the variance.
            let by_scores = &response * (scores / search.weight) * &response;
            let larger = (0..3).any(|k| by_scores[(k, k)] > SCORES_RATIO * noise[(k, k)]);
            if larger {
                noise = by_scores;
                covariance = Covariance::Scores;
            }
        }
    }
    if search.converged && search.options.bench.iter().all(|told| told.knowledge == Knowledge::Exact) {
        noise += search.free_of_bias()?;
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
            let step = DVector::from_column_slice(step).resize_vertically(alone.b.len(), 0.0);
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

fn hold(search: &mut Search, held: &[usize]) {
    held.iter().for_each(|j| search.prior[LOAD + j].1 = 0.0);
}

/// Searches from the first guess, and where that does not converge from the next one.
fn search_from_guesses<'a>(
    recordings: &'a [Recording<'a>],
    masks: &[Vec<bool>],
    options: &'a Options,
    held: &[usize],
) -> Result<Search<'a>, Failed> {
    let mut failed = None;
    for factor in GUESSES {
        let mut search = start(recordings, masks, options)?;
        hold(&mut search, held);
        search.x[..3].iter_mut().for_each(|lambda| *lambda *= factor);
        let outcome = search.run();
        if outcome.is_ok() && search.converged {
            return Ok(search);
        }
        failed.get_or_insert(outcome.map(|()| search));
    }
    failed.unwrap_or(Err(Failed::Nothing))
}

pub(super) fn fit<'a>(
    recordings: &'a [Recording<'a>],
    masks: &[Vec<bool>],
    options: &'a Options,
    held: &mut Vec<usize>,
) -> Result<Finished<'a>, Failed> {
    // The first search ends before the other begins: each has its own trajectory of all rows.
    let near = stretches(masks).and_then(|masks| {
        let first = search_from_guesses(recordings, &masks, options, held).ok()?;
        first.converged.then(|| first.found())
    });
    let mut search = match near {
        Some(near) => {
            let mut search = start(recordings, masks, options)?;
            hold(&mut search, held);
            search.start_at(near);
            search.smooth();
            search.iterate(UNSMOOTHED, CONVERGED)?;
            search
        }
        None => search_from_guesses(recordings, masks, options, held)?,
    };
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
        if let Some(change) = changes::change(&finished) {
            let Some(other) = changes::leave_smaller_side(&mut masks, &finished, &change) else { break };
            contradictions.push(changes::describe(recordings, &masks, options, &change, other));
        } else {
            let disturbed = changes::disturbed(&finished);
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
    Ok(outcome::report(&finished, held, contradictions))
}

/// See [`super::cramer_rao`].
pub(super) fn cramer_rao(recordings: &[Recording<'_>], options: &Options) -> Result<Vec<f64>, Failed> {
    let masks = everything(recordings);
    let mut search = start(recordings, &masks, options)?;
    search.weight = 1.0;
    search.run()?;
    let finished = finish(search)?;
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
    search.weight = 1.0;
    search.x.copy_from_slice(unknowns);
    for _ in 0..3 {
        search.smooth();
    }
    let normal = search.normal(&search.pass(true), true);
    let information = normal.j.row_iter().map(|row| row.iter().copied().collect()).collect();
    Ok(Score { score: normal.b.iter().copied().collect(), information })
}
