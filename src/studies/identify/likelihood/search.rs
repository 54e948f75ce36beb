//! Search for the most likely parameters; `finish.rs` turns it into results with their covariance.

mod finish;
mod test;

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

pub(super) use finish::Finished;
use finish::finish;

use super::case::{Case, NOISE_STEP, RESTORED_LOG_STD, exponent_step, level_step, noise_step, prepare};
use super::changes;
use super::data::{Input, Piece};
use super::expected::expected;
use super::filter::{Block, Columns, Levels, Likelihoods, Request, UNCHANGED};
use super::outcome;
use super::rotor::{Model, Rotor};
use super::solve::{Normal, inverse, submatrix};
use super::{Body, Change, Contradiction, Failed, Identified, Knowledge, Recording};
use crate::bearing::array;
use crate::studies::identify::{GRAVITY_M_S2, mean};
use crate::studies::parallel::in_order;

/// Passes about the measured trajectory before the smoother takes over: without load and unbalance it would follow a wrong model.
const UNSMOOTHED: usize = 2;
/// Maximum number of iterations.
const MAX_ITERATIONS: usize = 30;
/// Convergence: largest step in standard deviations.
const CONVERGED: f64 = 0.05;
/// The same before bench parameters are estimated with the others.
const ROUGH: f64 = 1.0;
/// Longest step of a bench parameter, in typical tolerances: without it the search misses a bench of the test `all_parameters_of_a_bench_are_found_at_once`.
const MAX_STEP: f64 = 3.0;
/// Prior standard deviation of a free parameter, in typical tolerances: too wide to matter.
const FREE_STD: f64 = 1e3;
/// Prior standard deviation of a given value, relative to that of an unknown one: too narrow to matter.
const GIVEN_STD: f64 = 1e-12;
/// A free parameter with a standard deviation above this many typical tolerances is not determined by the data.
const MAX_FREE_STD: f64 = 20.0;

/// Where bench parameters are estimated, all rows together carry at most the information of this many: the likelihood is raised to the power `BENCH_ROWS`/rows.
///
/// The bias of its scores grows with the number of rows, their standard deviation with its root. Position noise returns through the controller as
/// current and motion, current noise enters the regressors; combinations of parameters that hardly change the motion (delay, offsets, gap, and gain
/// together) absorb it. At the true parameters, nominal bench, 0.1 µm and 10 mA, the step with all typical tolerances is −2.1 standard deviations in the
/// delay after 5 s, −4.9 after 40 s, with 1 µm −10.6 in an offset and −6 in λ2 after 40 s (seeds 70000–70003). A single parameter shows no such bias, nor
/// do regressors predicted from other turns; these carry too little information to find the other parameters.
pub(in crate::studies::identify) const BENCH_ROWS: f64 = 50_000.0;
/// Rows from which the search of a long recording starts, in stretches spread over all of it; only the last iterations use all rows.
const FIRST_ROWS: usize = 100_000;
const STRETCH: usize = 1 << 14;
/// Minimum number of pieces that pass together where results are large.
const MIN_TOGETHER: usize = 8;

/// Reason why an information matrix has no inverse.
const NOT_DETERMINED: &str = "the data do not determine all parameters: state tolerances, or estimate fewer";

/// Matrix and right-hand side of linear equations.
type Equations = (DMatrix<f64>, DVector<f64>);

/// A search with its recordings and unknowns.
pub(super) struct Search<'a> {
    pub cases: Vec<Case<'a>>,
    pub model: &'a Model<'a>,
    /// Unknowns as in [`Layout::unknown`](super::rotor::Layout::unknown).
    pub x: Vec<f64>,
    /// Prior mean and standard deviation of each unknown; a standard deviation of 0 if it is not estimated.
    pub prior: Vec<(f64, f64)>,
    /// Exponent of the likelihood ([`BENCH_ROWS`], [`Case::effective_rows`]).
    weight: f64,
    pub iterations: usize,
    pub converged: bool,
}

impl Search<'_> {
    /// The rotor in recording `r`.
    pub fn rotor(&self, r: usize) -> Rotor {
        let (case, layout) = (&self.cases[r], self.model.layout);
        let theta = (0..layout.all).map(|j| self.x[layout.unknown(j, r)]).collect();
        Rotor::new(self.model, theta, case)
    }

    fn coordinates(&self) -> usize {
        self.model.layout.loads()
    }

    /// Range of the unknowns that are bench parameters.
    fn bench(&self) -> Range<usize> {
        self.model.layout.own..self.model.layout.shared()
    }

    /// Indices of the estimated unknowns.
    fn estimated(&self) -> Vec<usize> {
        (0..self.x.len()).filter(|at| self.prior[*at].1 > 0.0).collect()
    }

    fn pieces(&self) -> Vec<Piece> {
        self.cases.iter().flat_map(|case| &case.pieces).cloned().collect()
    }

    /// Runs a pass of the filter over pieces of recordings; results are in their order.
    fn passes<R: Send + Sync>(&self, pieces: &[Piece], pass: &(dyn Fn(Input<'_>) -> R + Sync)) -> Vec<(Piece, R)> {
        let rotors: Vec<Rotor> = (0..self.cases.len()).map(|r| self.rotor(r)).collect();
        in_order(pieces.len(), &|at| {
            let (piece, r) = (&pieces[at], pieces[at].recording);
            (piece.clone(), pass(Input { case: &self.cases[r], rotor: &rotors[r], piece }))
        })
    }

    /// Sums of all blocks, in order.
    pub fn pass(&self, columns: Columns) -> Vec<Block> {
        let layout = &self.model.layout;
        let request = Request::of(columns, layout, |j| self.prior[layout.unknown(j, 0)].1 > 0.0);
        let passed = self.passes(&self.pieces(), &|input| (input.rotor.passes.columns)(input, &request));
        let mut blocks: Vec<Block> = passed.into_iter().flat_map(|(_, blocks)| blocks).collect();
        for block in &mut blocks {
            block.j.iter_mut().chain(&mut block.b).for_each(|sum| *sum *= self.weight);
        }
        blocks
    }

    pub fn normal(&self, blocks: &[Block]) -> Normal {
        let mut normal = Normal::new(self.model.layout, self.cases.len());
        blocks.iter().for_each(|block| normal.add(block, 1.0));
        normal
    }

    /// `J + Π` and `b + Π(mean − x)` of the estimated unknowns.
    pub fn equations(&self, normal: &Normal, of: &[usize]) -> Equations {
        self.equations_by(normal, of, of, of)
    }

    /// The same with other rows and columns of the sums than those of the unknowns.
    pub fn equations_by(&self, normal: &Normal, of: &[usize], rows: &[usize], columns: &[usize]) -> Equations {
        let mut a = submatrix(&normal.j, rows, columns);
        let mut b = DVector::from_fn(of.len(), |i, _| normal.b[rows[i]]);
        for (i, at) in of.iter().enumerate() {
            let (mean, std) = self.prior[*at];
            let weight = 1.0 / (std * std);
            a[(i, i)] += weight;
            b[i] += weight * (mean - self.x[*at]);
        }
        (a, b)
    }

    /// Gauss–Newton step from the present point by unknown, 0 if not estimated, and its largest component in standard deviations.
    fn newton(&self, normal: &Normal) -> Result<(Vec<f64>, f64), Failed> {
        let of = self.estimated();
        let (a, b) = self.equations(normal, &of);
        let is_finite = b.iter().all(|b| b.is_finite());
        let covariance = inverse(&a).filter(|_| is_finite).ok_or_else(|| Failed::Diverged(NOT_DETERMINED.into()))?;
        let solved = &covariance * &b;
        let (mut step, mut largest) = (vec![0.0; self.x.len()], 0.0_f64);
        for (i, at) in of.iter().enumerate() {
            step[*at] = solved[i];
            largest = largest.max((solved[i] / covariance[(i, i)].sqrt()).abs());
        }
        Ok((step, largest))
    }

    /// Fraction of a step within which the linearisation holds. With bench parameters the whole step is shortened, as its components belong together.
    fn within(&self, step: &[f64]) -> f64 {
        let moving = self.bench().zip(&self.model.part.parameters).filter(|(at, _)| step[*at] != 0.0);
        moving.map(|(at, parameter)| MAX_STEP * parameter.typical / step[at].abs()).fold(1.0, f64::min)
    }

    /// Minus twice the logarithm of likelihood and priors, up to a constant.
    pub fn merit(&self, blocks: &[Block]) -> f64 {
        let fit: f64 = blocks.iter().map(|block| block.nis + block.log_det).sum();
        let deviation_squared = |at: &usize| {
            let (mean, std) = self.prior[*at];
            let deviation = (self.x[*at] - mean) / std;
            deviation * deviation
        };
        self.weight * fit + self.estimated().iter().map(deviation_squared).sum::<f64>()
    }

    /// The pieces in groups: the results of all at once would take as much memory as the trajectories themselves.
    fn groups(&self) -> Vec<Vec<Piece>> {
        let together = MIN_TOGETHER.max(2 * rayon::current_num_threads());
        self.pieces().chunks(together).map(<[Piece]>::to_vec).collect()
    }

    /// Smooths the trajectories.
    fn smooth(&mut self) {
        let mut before = Vec::new();
        for group in &self.groups() {
            let smoothed = self.passes(group, &|input| (input.rotor.passes.smooth)(input));
            // A piece is linearised about the former trajectory of its neighbours: a group is stored after the next one is smoothed.
            self.store(std::mem::replace(&mut before, smoothed));
        }
        self.store(before);
    }

    fn store(&mut self, smoothed: Vec<(Piece, Vec<f64>)>) {
        for (Piece { recording, counted, .. }, track) in smoothed {
            let n = 2 * self.coordinates();
            self.cases[recording].state[n * counted.start..n * counted.end].copy_from_slice(&track);
        }
    }

    /// Whether the bench is exactly as stated, apart from the mass, which is searched only if a load is known, and κ, which acts like another λ.
    fn exact(&self) -> bool {
        let layout = self.model.layout;
        self.model.part.parameters.iter().enumerate().all(|(j, parameter)| match parameter.knowledge {
            Knowledge::Exact => true,
            _ if layout.dynamics == Some(layout.base + j) => true,
            Knowledge::Tolerance(_) => j == self.model.places.mass && !self.model.part.settings.is_loaded(),
            Knowledge::Free => false,
        })
    }

    fn corrects_bias(&self) -> bool {
        self.model.options.corrects_bias && self.exact()
    }

    /// Relative tolerance of the mass, if it is not searched with the others: it scales λ, unbalance and loads, and the data do not determine it.
    pub fn mass_tolerance(&self) -> Option<f64> {
        self.model.part.parameters[self.model.places.mass].knowledge.tolerance().filter(|_| self.exact())
    }

    /// Computes the expected values of every row if the bench is exactly as stated. Where its parameters are searched, values found at one point do not
    /// hold at the next.
    fn compute_expected(&mut self) {
        if !self.corrects_bias() {
            return;
        }
        let n = self.coordinates();
        let mut whitened: Vec<_> = self.cases.iter().map(|case| vec![0.0; n * case.at.len()]).collect();
        self.innovations(|Piece { recording, counted, .. }, [_, own, _]| {
            whitened[recording][n * counted.start..n * counted.end].copy_from_slice(&own);
        });
        let rotors: Vec<Rotor> = (0..self.cases.len()).map(|r| self.rotor(r)).collect();
        for ((case, rotor), whitened) in self.cases.iter_mut().zip(&rotors).zip(&whitened) {
            let input = Input { case, rotor, piece: &case.pieces[0] };
            case.expected = expected(input, whitened);
        }
    }

    /// Calls `each` with every piece and its innovations, as [`Passes::innovations`](super::filter::Passes::innovations).
    fn innovations(&self, mut each: impl FnMut(Piece, [Vec<f64>; 3])) {
        let pass = |input: Input<'_>| (input.rotor.passes.innovations)(input);
        self.groups().iter().flat_map(|group| self.passes(group, &pass)).for_each(|(piece, own)| each(piece, own));
    }

    /// Position minus its prediction, m, by recording: one sample ahead by coordinate and row, NaN where there is none; further ahead, where there is one.
    pub fn prediction_errors(&self) -> Vec<(Vec<Vec<f64>>, Vec<f64>)> {
        let count = self.coordinates();
        let none = |case: &Case<'_>| (vec![vec![f64::NAN; case.at.len()]; count], Vec::new());
        let mut errors: Vec<_> = self.cases.iter().map(none).collect();
        self.innovations(|Piece { recording, counted, .. }, [own, _, ahead]| {
            let (one_sample, further) = &mut errors[recording];
            for (row, own) in counted.zip(own.chunks_exact(count)) {
                one_sample.iter_mut().zip(own).for_each(|(column, error)| column[row] = *error);
            }
            further.extend(ahead.into_iter().filter(|error| error.is_finite()));
        });
        errors
    }

    /// Likelihoods of the recordings, as [`Passes::likelihoods`](super::filter::Passes::likelihoods).
    fn likelihoods(&self, levels: [Levels; 3]) -> Vec<Likelihoods> {
        let sums = self.passes(&self.pieces(), &|input| (input.rotor.passes.likelihoods)(input, &levels));
        let mut totals = vec![[[0.0; 3]; 3]; self.cases.len()];
        for (piece, sums) in sums {
            let total = totals[piece.recording].as_flattened_mut().iter_mut();
            total.zip(sums.as_flattened()).for_each(|(total, sum)| *total += sum);
        }
        totals
    }

    /// One update of a noise level by the likelihoods of the recordings; returns the largest change.
    fn step_level(&mut self, levels: [Levels; 3], step: impl Fn(&mut Case<'_>, &Likelihoods) -> f64) -> f64 {
        let totals = self.likelihoods(levels);
        self.cases.iter_mut().zip(&totals).map(|(case, sums)| step(case, sums)).fold(0.0, f64::max)
    }

    /// One update of the noise levels; returns the largest change of a logarithm.
    fn noise(&mut self) -> f64 {
        let steps = [libm::exp(-NOISE_STEP), 1.0, libm::exp(NOISE_STEP)];
        let levels = steps.map(|factor| Levels { currents: [factor; 8], ..UNCHANGED });
        let mut change = self.step_level(levels, noise_step);
        if self.model.part.settings.exponent {
            let levels = [-NOISE_STEP, 0.0, NOISE_STEP].map(|exponent| Levels { exponent, ..UNCHANGED });
            change = change.max(self.step_level(levels, exponent_step));
        }
        if self.cases.iter().any(|case| !case.square_error.is_empty()) {
            let levels = steps.map(|restored| Levels { restored, ..UNCHANGED });
            let step = |case: &mut Case<'_>, sums: &_| level_step(&mut case.restored, sums, RESTORED_LOG_STD, 0.0);
            change = change.max(self.step_level(levels, step));
        }
        if self.model.options.slow_force {
            let least = MIN_SLOW_FORCE * self.weight_n();
            let levels = steps.map(|slow| Levels { slow, ..UNCHANGED });
            let step = |case: &mut Case<'_>, sums: &_| level_step(&mut case.slow_force, sums, f64::INFINITY, least);
            change = change.max(self.step_level(levels, step));
        }
        change
    }

    /// Weight of the rotor, N.
    fn weight_n(&self) -> f64 {
        self.model.part.body.m_kg() * GRAVITY_M_S2
    }

    /// Gain in log-likelihood by a slow force with everything else unchanged: at the estimated level, or else at the best of three.
    fn gain_by_slow_force(&mut self) -> f64 {
        let level = SLOW_FORCE * self.weight_n();
        let slow = |slow: f64| Levels { slow, ..UNCHANGED };
        let sum = |totals: Vec<Likelihoods>| -> [f64; 3] {
            array::from_fn(|of| totals.iter().map(|sums| -0.5 * (sums[of][0] + sums[of][1])).sum())
        };
        if self.model.options.slow_force {
            let [without, with, _] = sum(self.likelihoods([NEGLIGIBLE, 1.0, 1.0].map(slow)));
            return with - without;
        }
        let [without, ..] = sum(self.likelihoods([1.0; 3].map(slow)));
        self.cases.iter_mut().for_each(|case| case.slow_force = level);
        let with = sum(self.likelihoods([0.1, 1.0, 10.0].map(slow)));
        self.cases.iter_mut().for_each(|case| case.slow_force = 0.0);
        with.into_iter().fold(f64::NEG_INFINITY, f64::max) - without
    }

    /// Current point of the search.
    fn point(&self) -> Point {
        let noise =
            |case: &Case<'_>| [case.position_noise, case.current_noise, case.slow_force, case.exponent, case.restored];
        (self.x.clone(), self.cases.iter().map(noise).collect())
    }

    /// Starts where a search over some of the rows ended, about the trajectory of all rows.
    fn start_at(&mut self, (x, noise): Point) {
        self.x = x;
        for (case, noise) in self.cases.iter_mut().zip(noise) {
            [case.position_noise, case.current_noise, case.slow_force, case.exponent, case.restored] = noise;
        }
        self.smooth();
    }

    /// Estimates λ, unbalance and load first, then the lag of the currents, then everything: far from the solution, bench parameters would absorb the
    /// effect of λ, and a delay that of a lag.
    fn run(&mut self) -> Result<(), Failed> {
        let prior = self.prior.clone();
        let bench = self.bench();
        let lag = self.model.places.lag.map(|at| bench.start + at);
        self.prior[bench].iter_mut().for_each(|prior| prior.1 = 0.0);
        let mut first = self.iterate(0, ROUGH);
        if let Some(lag) = lag {
            self.prior[lag] = prior[lag];
            first = first.and_then(|()| self.iterate(UNSMOOTHED, ROUGH));
        }
        self.prior = prior;
        first?;
        if self.model.layout.dynamics.is_some() {
            self.iterate(UNSMOOTHED, ROUGH)?;
        }
        self.compute_expected();
        self.iterate(UNSMOOTHED, CONVERGED)
    }

    /// Iterates until the largest step is smaller than `limit` standard deviations, from iteration `first` on.
    ///
    /// Forces are linear in λ, unbalance and load, and the data determine their balance far better than each of them: straight steps preserve it. Along
    /// curves on which λ is multiplied, current noise absorbed the imbalance, and 16 of 18 searches did not converge in 30 iterations (`scripts/faults.py`,
    /// seed 7807: stuck sensor, coarse quantisation, slow force); straight steps take 4 to 9.
    fn iterate(&mut self, first: usize, limit: f64) -> Result<(), Failed> {
        self.converged = false;
        for iteration in first..MAX_ITERATIONS {
            self.iterations = iteration + 1;
            let blocks = self.pass(Columns::Searched);
            let (step, mut largest) = self.newton(&self.normal(&blocks))?;
            let part = self.within(&step);
            self.x.iter_mut().zip(step).for_each(|(x, step)| *x += part * step);
            if !self.x.iter().all(|x| x.is_finite()) {
                return Err(Failed::Diverged("an estimate is not finite".into()));
            }
            if iteration + 1 >= UNSMOOTHED {
                self.smooth();
                largest = largest.max(self.noise());
            }
            if iteration > UNSMOOTHED && largest < limit {
                // Suspects are ranked with noise levels that fit the last point.
                self.noise();
                self.converged = true;
                break;
            }
        }
        Ok(())
    }
}

/// Point of a search: unknowns, and by recording the noise of positions and currents, level of the slow force, noise exponent, factor on restored errors.
type Point = (Vec<f64>, Vec<[f64; 5]>);

/// λ that carries the weight of the rotor with the currents of the recording.
fn first_guess(cases: &[Case<'_>], body: &Body) -> f64 {
    let currents = cases.iter().flat_map(|case| &case.current).copied().flatten();
    let square = Some(mean(currents.map(|i| i * i))).filter(|square| *square > 0.0).unwrap_or(1.0);
    body.m_kg() * GRAVITY_M_S2 * body.gap_m() * body.gap_m() / (body.magnets() as f64 * square)
}

/// A search with its priors, before the first step.
fn start<'a>(
    recordings: &'a [Recording],
    masks: &[Vec<bool>],
    model: &'a Model<'a>,
    held: &[usize],
) -> Result<Search<'a>, Failed> {
    let (part, body) = (model.part, &model.part.body);
    let cases = recordings
        .iter()
        .zip(masks)
        .enumerate()
        .map(|(r, (of, mask))| prepare(r, of, part, mask).ok_or(Failed::TooShort { recording: r + 1 }));
    let mut cases: Vec<Case<'_>> = cases.collect::<Result<_, _>>()?;
    if model.options.slow_force {
        cases.iter_mut().for_each(|case| case.slow_force = SLOW_FORCE * body.m_kg() * GRAVITY_M_S2);
    }
    let layout = model.layout;
    let n = layout.unknowns(recordings.len());
    let mut x = vec![0.0; n];
    let mut prior = vec![(0.0, 0.0); n];
    let lambda = first_guess(&cases, body);
    x[..layout.magnets].fill(lambda);
    prior[..layout.magnets].fill((lambda, FREE_STD * lambda));
    // A mass centre outside the gap, or a load of a hundred times the weight, does not occur.
    prior[layout.shared()..n].fill((0.0, 1e3 * body.m_kg()));
    for (r, j) in (0..recordings.len()).flat_map(|r| (layout.magnets..layout.load).map(move |j| (r, j))) {
        prior[layout.unknown(j, r)] = (0.0, 100.0 * body.m_kg() * body.gap_m());
    }
    for (at, load_n) in part.settings.load_n.iter().enumerate() {
        let of_recordings = (0..recordings.len()).map(|r| layout.unknown(layout.load + at, r));
        of_recordings.filter_map(|at| Some((at, (*load_n)?))).for_each(|(at, load_n)| {
            (x[at], prior[at]) = (load_n, (load_n, 0.0));
        });
    }
    for (prior, parameter) in prior[layout.own..].iter_mut().zip(&part.parameters) {
        prior.1 = match parameter.knowledge {
            Knowledge::Exact => 0.0,
            Knowledge::Tolerance(std) => std,
            Knowledge::Free => FREE_STD * parameter.typical,
        };
    }
    held.iter().for_each(|j| prior[layout.own + j].1 = 0.0);
    for (at, value) in part.given.iter().enumerate() {
        x[at] = *value;
        // The phase of the unbalance is known if the angles count from the same position of the shaft.
        if recordings[0].has_mark || !(layout.magnets..layout.load).contains(&at) {
            prior[at] = (*value, GIVEN_STD * prior[at].1);
        }
    }
    let rows = cases.iter().map(Case::rows).sum::<usize>() as f64;
    let weight = cases.iter().map(Case::effective_rows).sum::<usize>() as f64 / rows;
    let mut search = Search { cases, model, x, prior, weight, iterations: 0, converged: false };
    if search.exact() {
        search.prior[layout.own + model.places.mass].1 = 0.0;
    } else {
        search.weight = (BENCH_ROWS / rows).min(search.weight);
    }
    Ok(search)
}

/// Initial and smallest level of a slow force, in weights of the rotor after one second.
const SLOW_FORCE: f64 = 1e-3;
const MIN_SLOW_FORCE: f64 = 1e-7;
/// Fraction of a level that is negligible.
const NEGLIGIBLE: f64 = 1e-3;
/// Maximum number of rounds in which inconsistent rows are left out.
const MAX_ROUNDS: usize = 6;

/// The most uncertain free bench parameter not determined by the data: once it is held, the others may become determined.
fn not_separated(finished: &Finished<'_>) -> Option<usize> {
    let (parameters, first) = (&finished.search.model.part.parameters, finished.search.model.layout.own);
    let typical = |j: usize| parameters[j].typical;
    let std = |j: usize| finished.estimate(first + j).total_std;
    let free = (0..parameters.len()).filter(|j| parameters[*j].knowledge == Knowledge::Free);
    let too_wide = free.filter(|j| std(*j) > MAX_FREE_STD * typical(*j));
    let width = |j: usize| std(j) / typical(j);
    too_wide.reduce(|widest, j| if width(j) > 0.99 * width(widest) { j } else { widest })
}

/// Masks that use some of the rows in evenly distributed stretches; `None` if there are few rows.
fn stretches(masks: &[Vec<bool>]) -> Option<Vec<Vec<bool>>> {
    let all: usize = masks.iter().flatten().filter(|used| **used).count();
    let period = STRETCH * all / FIRST_ROWS;
    let used = |mask: &Vec<bool>| mask.iter().enumerate().map(|(row, used)| *used && row % period < STRETCH).collect();
    (period > 2 * STRETCH).then(|| masks.iter().map(used).collect())
}

pub(super) fn fit<'a>(
    recordings: &'a [Recording],
    masks: &[Vec<bool>],
    model: &'a Model<'a>,
    held: &mut Vec<usize>,
) -> Result<Finished<'a>, Failed> {
    // The first search ends before the second begins, as each holds a trajectory of all rows.
    let from_stretches = stretches(masks).and_then(|masks| {
        let mut first = start(recordings, &masks, model, held).ok()?;
        first.run().ok()?;
        first.converged.then(|| first.point())
    });
    let mut search = start(recordings, masks, model, held)?;
    match from_stretches {
        Some(point) => {
            search.start_at(point);
            search.compute_expected();
            search.iterate(UNSMOOTHED, CONVERGED)?;
        }
        None => search.run()?,
    }
    loop {
        let finished = finish(search)?;
        let Some(widest) = not_separated(&finished) else { return Ok(finished) };
        held.push(widest);
        search = finished.search;
        search.prior[model.layout.own + widest].1 = 0.0;
        search.x[model.layout.own + widest] = 0.0;
        search.run()?;
    }
}

/// Masks that use all rows.
fn all_rows(recordings: &[Recording]) -> Vec<Vec<bool>> {
    recordings.iter().map(|recording| vec![true; recording.rows()]).collect()
}

/// A change that prevents the search over all rows from finding a solution: it is detected from the solution of one half. Returns the smaller side, and
/// the masks without it.
fn change_from_a_half(recordings: &[Recording], model: &Model<'_>) -> Option<(Contradiction, Vec<Vec<bool>>)> {
    let mut masks = all_rows(recordings);
    let from = |second: bool| {
        let of = |mask: &Vec<bool>| (0..mask.len()).map(|row| (2 * row >= mask.len()) == second).collect();
        let half: Vec<Vec<bool>> = masks.iter().map(of).collect();
        let mut held = Vec::new();
        let own = fit(recordings, &half, model, &mut held).ok().filter(|own| own.is_solution() && own.is_quiet())?;
        let mut search = start(recordings, &masks, model, &held).ok()?;
        search.start_at(own.search.point());
        let finished = finish(search).ok()?;
        let change = changes::change(&finished, &own)?;
        Some((finished, change))
    };
    let halves = in_order(2, &|half| from(half == 1));
    let (finished, change) = halves.into_iter().flatten().max_by(|(_, a), (_, b)| a.excess.total_cmp(&b.excess))?;
    Some((changes::leave_out(&mut masks, &finished, change)?, masks))
}

/// Fits the rows that remain, and compares the side of a change with them if that was left out last.
fn fit_rest<'a>(
    recordings: &'a [Recording],
    masks: &[Vec<bool>],
    model: &'a Model<'a>,
    held: &mut Vec<usize>,
    contradictions: &mut [Contradiction],
) -> Result<Finished<'a>, Failed> {
    let rest = fit(recordings, masks, model, held)?;
    if let Some(side) = contradictions.last_mut().filter(|last| last.what.divides()) {
        changes::compare(recordings, side, &rest);
    }
    Ok(rest)
}

pub(super) fn identify(recordings: &[Recording], model: &Model<'_>) -> Identified {
    let exclude = model.options.excludes_rows;
    let mut masks = all_rows(recordings);
    let mut held = Vec::new();
    let mut contradictions: Vec<Contradiction> = Vec::new();
    let mut found = fit(recordings, &masks, model, &mut held);
    let mut halves_remain = exclude;
    let mut gain = None;
    // Each round leaves out the most inconsistent rows. Given estimates are judged by all rows.
    for _ in 0..if model.part.given.is_empty() { MAX_ROUNDS } else { 0 } {
        // Tests are meaningful only near a solution.
        let near = found.as_ref().ok().filter(|found| found.is_solution());
        let (disturbed, change) = near.map(changes::inconsistent).unwrap_or_default();
        let rows: usize = disturbed.iter().map(|of| of.rows.len()).sum();
        let is_minor =
            rows > 0 && near.is_some_and(|found| 2 * rows <= found.search.cases.iter().map(Case::rows).sum());
        // Where noise explains the motion, a change seems to be elsewhere, or is not seen at all.
        let is_sound = near.is_some_and(|found| found.is_quiet() || (is_minor && change.is_none()));
        // In a comparison of descriptions, magnets that push decide.
        let is_pushing = |found: &Finished<'_>| found.search.converged && found.pushes();
        let is_decided = !model.options.corrects_bias && found.as_ref().is_ok_and(is_pushing);
        if !is_sound
            && !is_decided
            && std::mem::take(&mut halves_remain)
            && let Some((side, without)) = change_from_a_half(recordings, model)
        {
            // Rows left out so far were not inconsistent with any solution.
            (masks, contradictions) = (without, vec![side]);
            held.clear();
        } else {
            let Some(finished) = found.as_mut().ok().filter(|found| found.is_solution()) else { break };
            if !exclude && (change.is_some() || !disturbed.is_empty()) {
                return Err(Failed::Contradicted { gain: finished.search.gain_by_slow_force() });
            }
            if let Some(change) = change {
                // A wandering force looks like changes of the load or of λ.
                gain.get_or_insert_with(|| finished.search.gain_by_slow_force());
                let Some(side) = changes::leave_out(&mut masks, finished, change) else { break };
                let drifts = matches!(side.what, Change::Drift(_));
                contradictions.push(side);
                if drifts {
                    break;
                }
            } else if is_minor {
                for contradiction in disturbed {
                    masks[contradiction.recording][contradiction.rows.clone()].fill(false);
                    contradictions.push(contradiction);
                }
            } else {
                break;
            }
        }
        found = fit_rest(recordings, &masks, model, &mut held, &mut contradictions);
    }
    let mut finished = found?;
    let gain = gain.filter(|_| !model.options.slow_force);
    // A single change of λ looks like a slow force that is absent from the remaining rows.
    let changes = contradictions.iter().map(|of| &of.what).filter(|what| !matches!(what, Change::Disturbed { .. }));
    let is_one_change = matches!(changes.collect::<Vec<_>>()[..], [Change::Lambda(_)]);
    let gain = match gain {
        Some(gain) if !is_one_change => gain,
        _ if finished.search.converged => finished.search.gain_by_slow_force().min(gain.unwrap_or(f64::INFINITY)),
        _ => 0.0,
    };
    Ok(outcome::report(&finished, &held, contradictions, gain))
}
