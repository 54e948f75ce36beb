//! The estimator: whitening filter, prediction errors and instrumental variables, noise, models, validation.

use std::f64::consts::TAU;

use libm::{cbrt, sqrt};
use nalgebra::SVector;
use serde::{Deserialize, Serialize};

use super::CONDITION_CAP;
use super::angle::angle_difference;
use super::config::Verdict;
use super::innovations::{FilterState, MAX_BRIDGED, Parameters, Sample, WhiteningFilter};
use super::models::{Comparison, Models, QUARTERS, WRONG_BY};
use super::noise::{Noise, OUTLIER, StartBuffer, USUAL_CURRENT_NOISE_A, current_range};
use super::sums::{AngleTable, Prior, Solution, Sums, lambda_of};
use super::validation::Validation;

/// Of a fast rotor, as many revolutions count as one as come closest to this duration, s, that of 3000 rpm: loads and λ do not change faster because the
/// rotor does. When every revolution counted, 20 of 40 runs at 12000 and 24000 rpm under 0.2 to 3 N at 50 or 100 Hz were valid but off by more than 5
/// standard deviations, now none (noise estimated: 16, now 3; another simulator, seeds 971001 to 971020).
const COUNTED_REVOLUTION_S: f64 = 0.02;

/// Duration that counts as a revolution of a rotor at rest, s, because λ may change then as well: the longest one of a fast rotor, that of 2250 rpm, since
/// from 1.5 revolutions in the duration above two count as one.
const REVOLUTION_AT_REST_S: f64 = COUNTED_REVOLUTION_S * 2.0 / 1.5;

/// Samples after a gap whose innovations do not count: the controller has responded to the noise of the missing samples, so the currents are correlated
/// with the errors of the filter. With 10 and 20 % of the samples missing (`montecarlo --only "0 % of the samples" --runs 40 --seed 1470001`) 22 of 160
/// runs exceeded 5 standard deviations when all innovations counted, with 8 samples 4, with 16 and 24 none; with 24, estimates are valid 16 instead of
/// 93 % of the time (20 %, noise known). With 12, λ of a spindle was off by 5.9.
const RESPONSE_SAMPLES: u32 = 16;

/// An estimate is outdated once this many successive samples have not counted. With 20 % missing at random such a stretch has a probability of 0.4 %.
const MAX_UNCOUNTED: u32 = 1000;

/// The equations are solved at the end of each quarter, after its samples were tested. At first, and if the noise is estimated, they are also solved
/// within a quarter, every 4 samples or this fraction of those so far: the error of an estimate that lags behind the data is taken for noise of the
/// currents. With quarters alone this noise was 1.5 times too large for spindles at 0.1 s, and error/std was 0.71 instead of 0.86 (seeds 61501 to 61600);
/// with 1/32 it is 0.81, with 1/128 0.88. Not after a change: 2 instead of 1 of 160 runs were valid and wrong after a blow (test `blows_are_forgotten`).
const SOLVE_EVERY: f64 = 4.0;
const SOLVE_FRACTION: f64 = 1.0 / 64.0;

/// Fewest samples for a solution: nine unknowns and two equations per sample, with some to spare.
const MIN_SAMPLES: f64 = 12.0;

/// Greatest relative standard deviation of a λ with which the filter leaves the first guess, and the smallest relative error of that guess that matters.
/// A first guess that is too large makes the noise of the currents, and with it this standard deviation, seem too large, by up to the same factor. If its
/// cube root is allowed, rotors at rest with a first guess × 10 are valid 95 instead of 37 % of the time; if the whole factor, those with one wrong by
/// two, updated late, 33 instead of 80 % (hostile courses, seeds 1300001 to 1300040); with the square root the test `blows_are_forgotten` fails.
const FILTER_STD: f64 = 0.2;

/// A first guess below this fraction of λ is far too small. With λ_0 a tenth of λ and a start far from the centre 16 of 600 runs exceeded 5 standard
/// deviations when the filter was not restarted, many with a spurious force; now none. With a limit of 0.8 spindles lost 5 to 20 % of their precision
/// (`montecarlo --only "spindle:" --runs 200 --seed 741001`).
const FAR_TOO_SMALL: f64 = 0.4;

/// Greatest relative standard deviation of a λ, tolerances included, with which an estimate becomes valid; it stays valid up to twice that.
pub const STD_LIMIT: f64 = 0.05;

/// An oscillating force that is not in the model is taken for noise of the currents, and its beat with the rotor for a backward force. No backward force
/// is identified if this noise exceeds the stated noise, or else the usual noise, by the first factor; beyond the second, stated noise does not
/// explain the motion. Noise stated 30 % too low gives 1.4, stated as a third 3, ramps of load 4. Without the first, 4 of 200 runs with 0.5 to 8 N
/// at 95 to 130 Hz were off by up to 42 standard deviations, with it none (noise estimated, seeds 985001 to 985200).
const FORCE_EXCESS: f64 = 1.5;
const NOISE_EXCESS: f64 = 5.0;

/// Time in s by which failed tests may outnumber passed ones for an estimate to become valid. Without this, estimates that passed by chance between two
/// failures exceeded 5 standard deviations in 5 of 120 runs with 0.5 N in a narrow band and an eccentric encoder (seeds 60101 to 60120).
const FAILED_S: f64 = 0.05;

/// Sums over a revolution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Revolution<const K: usize, const U: usize, const T: usize> {
    sums: Sums<K, U, T>,
    samples: f64,
    /// Fraction of it that has passed.
    passed: f64,
    /// Sums of `i_k/gap_k²` and `i_k²/gap_k³`.
    field: [SVector<f64, K>; 2],
}

/// Current estimate; holds the last valid one while there is none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate<const K: usize, const U: usize> {
    /// λ, unbalance, backward forces, loads; λ_0 and zero at first.
    pub unknowns: SVector<f64, U>,
    /// λ of the last revolution alone.
    pub lambda_raw: SVector<f64, K>,
    /// Variance of λ due to noise, and due to noise and tolerances.
    pub variance: [SVector<f64, K>; 2],
    pub ki: SVector<f64, K>,
    pub ks: SVector<f64, K>,
    /// Condition number of the information matrix, and normalised innovation squared per degree of freedom.
    pub condition: f64,
    pub residual: f64,
    /// Standard deviations of a position, m, and of a current, A.
    pub noise: [f64; 2],
    /// The verdict on the last sample.
    pub verdict: Verdict,
}

/// State between samples. Large fields are on the heap: the threads of importers have small stacks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictionErrorState<const N: usize, const K: usize, const U: usize, const T: usize> {
    pub estimate: Estimate<K, U>,
    /// Samples not filtered yet, which give the initial noise estimate, and missing samples before the next one.
    pending: Box<StartBuffer<N, K>>,
    gap: u32,
    /// The noise estimate, if any; the estimates when each of the last quarters began, or when the estimate of λ was last valid before.
    noise: Option<Noise>,
    trusted: [Option<Noise>; QUARTERS],
    filter: Option<FilterState<N, K, U, T>>,
    /// ϑ in the filter, and the number of quarters when it was first estimated from data, if it was.
    filter_unknowns: SVector<f64, U>,
    estimated_at: Option<u64>,
    /// Sums of the completed quarters, of the present quarter, and of the present revolution.
    models: Models<K, U, T>,
    present: Box<Sums<K, U, T>>,
    revolution: Box<Revolution<K, U, T>>,
    /// Whether a revolution is complete; means of `i_k/gap_k²` and `i_k²/gap_k³` over the last one.
    has_revolution: bool,
    field: [SVector<f64, K>; 2],
    table: AngleTable<K>,
    /// Completed quarters; revolutions and samples since, including missing ones; revolutions per sample at the present speed, as counted.
    quarters: u64,
    passed: f64,
    quarter_samples: f64,
    pace: f64,
    /// Whether the estimate has been valid since the sums began, so that outliers among the innovations can be recognised; successive outliers, and the
    /// number of quarters until which they make the verdict `Unexplained`.
    detects_outliers: bool,
    outliers: u32,
    unexplained_until: u64,
    /// Whether λ has changed since the estimate was last valid.
    changed: bool,
    /// Samples at which the tests failed, minus those at which they have passed since.
    failed: u64,
    /// Sample counts from which the estimate may be valid again: after it became invalid, and after each of the last two times that it became valid.
    valid_from: u64,
    revalid_from: [u64; 2],
    /// Mean square of the currents, A².
    mean_square_a2: f64,
    /// Samples since the start, since the last missing one, and since the last one that counted.
    samples: u64,
    since_gap: u32,
    uncounted: u32,
    /// The latest solution.
    solution: Option<Solution<U, T>>,
    validation: Box<Validation<N, U, T>>,
}

/// The estimator of [`Method::PredictionError`](super::Method::PredictionError) for N coordinates, K magnets, U unknowns and T tolerances.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictionError<const N: usize, const K: usize, const U: usize, const T: usize> {
    pub filter: WhiteningFilter<N, K, U, T>,
    pub lambda0: [f64; K],
    /// Prior of the unknowns, with the widest one of the backward forces.
    pub prior: Prior<U>,
    /// Standard deviations of the noise of a position and of a current, m and A; 0 if unknown.
    pub known_noise: [f64; 2],
    /// The smallest gap of a centred rotor.
    pub gap_m: f64,
    /// Relative variance of λ due to the tolerances of mass and current gains, which scale it.
    pub scale_variance: f64,
}

impl<const N: usize, const K: usize, const U: usize, const T: usize> PredictionError<N, K, U, T> {
    fn is_noise_known(&self) -> bool {
        self.known_noise.iter().all(|noise| *noise > 0.0)
    }

    /// Whether the rotor is within the gaps of all magnets at a position, m.
    pub fn is_in_gap(&self, position_m: [f64; N]) -> bool {
        self.filter.machine.geometry.gaps(position_m).iter().all(|gap_m| *gap_m > 0.0)
    }

    /// A new state.
    pub fn start(&self) -> PredictionErrorState<N, K, U, T> {
        let unknowns = SVector::from_fn(|j, _| if j < K { self.lambda0[j] } else { 0.0 });
        let lambda = SVector::from(self.lambda0);
        let variance = lambda.component_mul(&lambda);
        let estimate = Estimate {
            unknowns,
            lambda_raw: lambda,
            variance: [variance; 2],
            ki: SVector::zeros(),
            ks: SVector::zeros(),
            condition: CONDITION_CAP,
            residual: 1.0,
            noise: self.known_noise,
            verdict: Verdict::Collecting,
        };
        PredictionErrorState {
            estimate,
            pending: Box::new(StartBuffer::empty()),
            gap: 0,
            noise: self.is_noise_known().then(|| Noise::new(self.known_noise, self.known_noise[0], self.gap_m)),
            trusted: [const { None }; QUARTERS],
            filter: None,
            filter_unknowns: unknowns,
            estimated_at: None,
            models: Models::start(),
            present: Box::new(Sums::zeros()),
            revolution: Box::new(Revolution::start()),
            has_revolution: false,
            field: [SVector::zeros(); 2],
            table: AngleTable::empty(),
            quarters: 0,
            passed: 0.0,
            quarter_samples: 0.0,
            pace: self.filter.step_s / REVOLUTION_AT_REST_S,
            detects_outliers: false,
            outliers: 0,
            unexplained_until: 0,
            changed: false,
            failed: 0,
            valid_from: 0,
            revalid_from: [0; 2],
            mean_square_a2: 0.0,
            samples: 0,
            since_gap: u32::MAX,
            uncounted: 0,
            solution: None,
            validation: Box::new(Validation::start()),
        }
    }

    /// Processes a sample and returns the verdict on the estimate. A rejected sample counts as missing and keeps the sums, unless it resets the estimator.
    pub fn step(
        &self,
        state: &mut PredictionErrorState<N, K, U, T>,
        rejection: Option<Verdict>,
        resets: bool,
        sample: impl FnOnce() -> Sample<N, K>,
    ) -> Verdict {
        if let Some(verdict) = rejection {
            if resets && state.filter.is_some() {
                self.reset(state);
            }
            state.gap = state.gap.saturating_add(1);
            if self.is_long(state.gap) {
                state.estimate.verdict = verdict;
            }
            return verdict;
        }
        let missing = std::mem::take(&mut state.gap);
        state.pending.push(Sample { missing, ..sample() });
        if state.noise.is_none() {
            state.noise =
                state.pending.position_noise_m().map(|first_m| Noise::new(self.known_noise, first_m, self.gap_m));
            state.uncounted = state.uncounted.saturating_add(1);
            if state.uncounted > MAX_UNCOUNTED {
                state.estimate.verdict = Verdict::BadSample;
            }
        }
        // Two per step, to catch up with the samples that waited for the noise estimate.
        for _ in 0..2 {
            if let Some(noise) = state.noise.clone()
                && let Some(sample) = state.pending.pop()
            {
                state.estimate.verdict = self.filter(state, &noise, sample);
            }
        }
        state.estimate.verdict
    }

    /// Whether λ may have changed during this many missing samples.
    fn is_long(&self, missing: u32) -> bool {
        f64::from(missing) * self.filter.step_s > REVOLUTION_AT_REST_S
    }

    fn filter(&self, state: &mut PredictionErrorState<N, K, U, T>, noise: &Noise, sample: Sample<N, K>) -> Verdict {
        let [position_variance, current_variance] = noise.variances;
        if sample.missing > MAX_BRIDGED {
            state.filter = None;
        }
        state.since_gap = if sample.missing > 0 { 0 } else { state.since_gap.saturating_add(1) };
        state.advance(&sample, self.filter.step_s);
        if self.is_long(sample.missing) {
            state.valid_from = state.valid_from.max(state.samples + (2.0 * state.per_revolution()) as u64);
        }
        let Some(filter) = &mut state.filter else {
            state.filter = Some(self.filter.start(sample, position_variance));
            return self.report(state);
        };
        let (unknowns, estimated) = (state.filter_unknowns, state.estimated_at.is_some());
        let parameters = Parameters { unknowns, estimated, position_variance, current_variance };
        let mut instrumented = false;
        let table = &mut state.table;
        let mut predict = |filter: &mut FilterState<N, K, U, T>, parameters: &Parameters<U>, sample: &Sample<N, K>| {
            let (from_rad, to_rad) = (filter.last.rotation.theta_rad, sample.rotation.theta_rad);
            self.filter.predict(filter, parameters, sample, |square| {
                let instruments = table.exchange(from_rad + 0.5 * angle_difference(from_rad, to_rad), square);
                instrumented = instruments.is_some();
                instruments.unwrap_or_else(SVector::zeros)
            })
        };
        let before = filter.last;
        for n in 0..sample.missing {
            // The current jumped from one value to the other at an unknown instant.
            let interpolated = before.between(&sample, f64::from(n + 1) / f64::from(sample.missing + 1));
            let jump = (sample.current_a - before.current_a).amax();
            let current_variance = current_variance + f64::from(sample.missing) * jump * jump;
            let parameters = Parameters { current_variance, ..parameters };
            predict(filter, &parameters, &interpolated);
            let innovation = self.filter.innovation(filter, &parameters);
            filter.last.position_m -= innovation.error_m;
        }
        let field = predict(filter, &parameters, &sample);
        let innovation = self.filter.innovation(filter, &parameters);
        let nis = innovation.nis(position_variance);
        state.revolution.samples += 1.0;
        state.revolution.field[0] += field.per_current;
        state.revolution.field[1] += field.gradient;
        if state.detects_outliers && nis > OUTLIER {
            // The filter proceeds as if the measurement were missing; several outliers in a row are a change, which later samples confirm.
            filter.last.position_m -= innovation.error_m;
            state.outliers += 1;
            if state.outliers == 1 {
                state.since_gap = 0;
                return state.estimate.verdict;
            }
            (state.since_gap, state.unexplained_until) = (RESPONSE_SAMPLES, state.quarters + QUARTERS as u64);
            // Too many for a sensor glitch.
            if state.outliers > 30 {
                self.restart(state);
            }
            return self.end_sample(state);
        }
        state.outliers = 0;
        if !((0.0..1.0e12).contains(&nis) && innovation.is_sound()) {
            // Non-physical sample: the accumulated information cannot be trusted.
            self.reset(state);
            return Verdict::BadSample;
        }
        // With a leverage `φ J⁻¹ φᵀ S⁻¹` above one half an innovation depends more on the unknowns than on the noise, and does not test the model.
        let leverage = |found: &Solution<U, T>| (found.inverse * innovation.unknowns).dot(&innovation.unknowns);
        let settled = estimated && state.solution.as_ref().is_some_and(|found| leverage(found) < 0.5);
        // Below one for outliers.
        let weight = if settled { (OUTLIER / nis).min(1.0) } else { 0.0 };
        self.filter.correct(filter, &parameters, &innovation, sqrt(weight));

        state.samples += 1;
        if estimated && state.since_gap < RESPONSE_SAMPLES {
            state.uncounted = state.uncounted.saturating_add(1);
            return self.end_sample(state);
        }
        state.uncounted = 0;
        state.present.add(&innovation, sample.rotation.variance, instrumented);
        let per_revolution = state.per_revolution();
        state.validation.add(&innovation, sample.cos_sin, per_revolution);
        let square = sample.current_a.norm_squared() / K as f64;
        state.mean_square_a2 += (square - state.mean_square_a2) / per_revolution.min(state.samples as f64);
        if settled && let Some(noise) = &mut state.noise {
            state.validation.add_settled(&innovation.error, position_variance, per_revolution);
            let discount = noise.update(&innovation, position_variance, weight, state.mean_square_a2, self.gap_m);
            if discount < 1.0 {
                state.validation.forget();
                state.discount(discount);
            }
        }
        let interval = SOLVE_EVERY.max((SOLVE_FRACTION * state.models.sums().samples).floor());
        let lags = !self.is_noise_known() && !state.changed;
        if state.present.samples % interval == 0.0 && (lags || !state.is_settled()) {
            self.solve(state);
        }
        let verdict = self.end_sample(state);
        if verdict == Verdict::Valid {
            (state.detects_outliers, state.changed) = (true, false);
        }
        verdict
    }

    /// Restarts from the initial state, keeping the estimate and the times from which it may be valid again.
    fn reset(&self, state: &mut PredictionErrorState<N, K, U, T>) {
        let estimate = Estimate { condition: CONDITION_CAP, verdict: Verdict::Collecting, ..state.estimate.clone() };
        let from = |at: u64| at.saturating_sub(state.samples);
        let (valid_from, revalid_from) = (from(state.valid_from), state.revalid_from.map(from));
        *state = PredictionErrorState { estimate, valid_from, revalid_from, ..self.start() };
    }

    /// Restarts after a change of λ.
    fn restart(&self, state: &mut PredictionErrorState<N, K, U, T>) {
        state.restore_noise();
        state.models.restart();
        (*state.present, *state.revolution) = (Sums::zeros(), Revolution::start());
        // The columns of the filter contain the effect of the former λ. The filter keeps the former estimate: noise and tests need residuals, or samples
        // that no λ explains would stay in the sums for ever.
        (state.filter, state.solution) = (None, None);
        (state.detects_outliers, state.outliers) = (false, 0);
        state.validation.restart();
    }

    /// Solves the normal equations of all samples.
    fn solve(&self, state: &mut PredictionErrorState<N, K, U, T>) {
        let Some(noise) = &state.noise else { return };
        let variances = noise.variances;
        let mut sums = state.models.sums().clone();
        sums.merge(&state.present);
        if sums.samples < MIN_SAMPLES {
            return;
        }
        // The solutions with the widest prior of the backward forces, and with that of the selected model.
        let widest_prior = state.models.widest(&self.prior);
        let solutions = sums.solve(&widest_prior, variances).and_then(|found| {
            let widest = found.combine();
            let is_plausible = self.excess(variances[1], state.mean_square_a2) <= FORCE_EXCESS;
            let model = state.models.select(&found, &widest, is_plausible)?;
            let prior = state.models.prior(&widest_prior);
            let found = if prior == widest_prior { found } else { sums.solve(&prior, variances)? };
            let solution = Solution { model, ..found.combine() };
            Some((widest, solution, found.condition))
        });
        let Some((widest, solution, condition)) = solutions else {
            state.estimate.condition = CONDITION_CAP;
            return;
        };
        state.estimate.condition = condition;
        let std = solution.relative_std::<K>();
        if !std.is_finite() {
            return;
        }
        // Once the filter uses an estimate it follows all later ones: the residuals of an outdated estimate would be taken for noise, and the noise would
        // keep the estimate uncertain. The same holds for the residuals of a backward force that is still undecided.
        let estimated = state.estimated_at.is_some();
        let ratios = SVector::<f64, K>::from_fn(|k, _| self.lambda0[k] / solution.unknowns[k]);
        if estimated || std < FILTER_STD * cbrt(ratios.max().max(1.0)) {
            if !estimated {
                state.estimated_at = Some(state.quarters);
                // With λ_0 too small the weights S⁻¹ of these samples are too large, by a factor of 1 if position noise dominates, of (λ/λ_0)² if current
                // noise does: they are multiplied by the geometric mean of the inverses. The filter restarts, because its covariance was too small. More
                // than a revolution with a wrong stiffness counts a tenth. Dropping these samples altogether would leave weakly excited bearings valid
                // 16 instead of 78 % of the time (a study of such bearings).
                let wrong = ratios.iter().any(|ratio| (1.0 / ratio - 1.0).abs() > FILTER_STD);
                let (late, small) = (state.quarters >= QUARTERS as u64 && wrong, ratios.min() < FAR_TOO_SMALL);
                if late || small {
                    state.discount(if late { 0.1 } else { ratios.min() });
                    state.validation.forget();
                }
                if small {
                    state.filter = None;
                }
            }
            let wide = widest.relative_std::<K>() < FILTER_STD;
            state.filter_unknowns = if wide { widest.unknowns } else { solution.unknowns };
        }
        state.solution = Some(solution);
    }

    /// Noise of the currents relative to the stated, or else to the usual one: a ratio of standard deviations.
    fn excess(&self, current_variance: f64, mean_square_a2: f64) -> f64 {
        let [_, stated_a] = self.known_noise;
        let usual_a = USUAL_CURRENT_NOISE_A * current_range(mean_square_a2);
        sqrt(current_variance) / if stated_a > 0.0 { stated_a } else { usual_a }
    }

    /// Ends the quarter if it is over, and reports.
    fn end_sample(&self, state: &mut PredictionErrorState<N, K, U, T>) -> Verdict {
        if state.passed * QUARTERS as f64 >= 1.0 {
            self.end_quarter(state);
        }
        self.report(state)
    }

    /// Adds the completed quarter to the models, tests it, and solves.
    fn end_quarter(&self, state: &mut PredictionErrorState<N, K, U, T>) {
        let Some(noise) = state.noise.clone() else { return };
        let variances = noise.variances;
        let block = std::mem::replace(&mut *state.present, Sums::zeros());
        let time_s = state.quarter_samples * self.filter.step_s;
        (state.quarters, state.passed, state.quarter_samples) = (state.quarters + 1, 0.0, 0.0);
        state.validation.end_quarter();
        state.trusted.rotate_left(1);
        let is_valid = state.estimate.verdict == Verdict::Valid;
        state.trusted[QUARTERS - 1] = if is_valid { Some(noise) } else { state.trusted[QUARTERS - 2].clone() };
        let widest = state.models.widest(&self.prior);
        let prior = state.models.prior(&widest);
        if state.is_settled() || state.changed {
            state.validation.discount(state.models.forgetting_factor(time_s), time_s);
            let nis = state.validation.nis_with_degrees(state.per_revolution());
            let loads = self.filter.machine.unit_loads();
            match state.models.compare((&block, time_s), &widest, variances[0], nis, state.quarters, &loads) {
                Comparison::Same => (),
                Comparison::Renewed => state.validation.forget(),
                Comparison::Changed => {
                    state.restore_noise();
                    state.validation.restart();
                }
            }
            state.models.mix(&prior, variances, time_s);
        } else {
            state.models.merge(&block);
        }
        if let Some(found) = state.models.sums().solve(&prior, variances) {
            let changing = state.models.forgetting_factor(time_s) < 1.0;
            let per_revolution = state.per_revolution();
            state.validation.test_lines(&found, changing, per_revolution);
        }
        let revolution = &mut state.revolution;
        revolution.sums.merge(&block);
        let is_complete = revolution.passed >= 1.0;
        if is_complete && let Some(alone) = revolution.sums.solve(&prior, variances) {
            state.estimate.lambda_raw = lambda_of(&alone.unknowns);
        }
        if is_complete || !state.has_revolution {
            state.field = revolution.field.map(|sum| sum / revolution.samples);
        }
        if is_complete {
            **revolution = Revolution::start();
            state.has_revolution = true;
        }
        self.solve(state);
    }

    /// Updates the estimate and returns the verdict on it.
    fn report(&self, state: &mut PredictionErrorState<N, K, U, T>) -> Verdict {
        let Some(noise) = &state.noise else { return Verdict::Collecting };
        state.estimate.noise = noise.variances.map(sqrt);
        state.estimate.residual = state.validation.nis;
        let Some(solution) = &state.solution else {
            let few = state.samples < (MIN_SAMPLES + SOLVE_EVERY) as u64;
            return match (state.changed, few || state.estimate.condition < CONDITION_CAP) {
                (true, _) => Verdict::Changed,
                (false, true) => Verdict::Collecting,
                (false, false) => Verdict::Singular,
            };
        };
        let lambda = lambda_of(&solution.unknowns);
        let [variance, total] = solution.variances(state.validation.nis, self.scale_variance);
        let tested = state.validation.verdict(state.per_revolution(), state.estimate.verdict == Verdict::Valid);
        let verdict = self.verdict(state, noise, tested, &lambda, &total);
        let samples = |time_s: f64| (time_s / self.filter.step_s) as u64;
        if state.is_settled() {
            state.failed = match tested {
                Verdict::Valid => state.failed.saturating_sub(1),
                _ => (state.failed + 1).min(samples(1.0)),
            };
        }
        match (state.estimate.verdict == Verdict::Valid, verdict == Verdict::Valid) {
            // After a failed test an estimate stays invalid for at least 0.1 s, and it becomes valid at most twice a second: `valid` changes at most five times
            // a second.
            (false, true) => state.revalid_from = [state.revalid_from[1], state.samples + samples(1.0)],
            (true, false) => state.valid_from = state.samples + samples(0.1),
            _ => (),
        }
        let estimate = &mut state.estimate;
        if verdict == Verdict::Valid {
            estimate.unknowns = solution.unknowns;
        }
        let reported = lambda_of::<K, U>(&estimate.unknowns);
        let distance = (reported - lambda).map(|x| x * x);
        estimate.variance = [variance + distance, total + distance];
        [estimate.ki, estimate.ks] = state.field.map(|field| reported.component_mul(&field) * 2.0);
        verdict
    }

    /// The verdict on an estimate with this variance, given that of the tests.
    fn verdict(
        &self,
        state: &PredictionErrorState<N, K, U, T>,
        noise: &Noise,
        tested: Verdict,
        lambda: &SVector<f64, K>,
        total: &SVector<f64, K>,
    ) -> Verdict {
        let was_valid = state.estimate.verdict == Verdict::Valid;
        let limit = if was_valid { 2.0 * STD_LIMIT } else { STD_LIMIT };
        // A λ below the first guess by more than this factor and four standard deviations is none: under a load that oscillates slowly, the force of the
        // controller is proportional to the displacement, and λ smaller by the ratio of inertia to stiffness explains the motion as well. Without this 6 of
        // 20 rotors at rest under 2 N at 13 Hz were valid with a twentieth of λ, 700 deviations off (another simulator, seed 978001).
        let far_below = WRONG_BY / (1.0 - 4.0 * STD_LIMIT);
        // A quarter for the first solution and a revolution until it has settled; estimating the noise takes longer.
        let least = if self.is_noise_known() { QUARTERS + 1 } else { 2 * QUARTERS };
        if state.validation.quarters() < least || (state.estimated_at.is_some() && !state.is_settled()) {
            if state.changed { Verdict::Changed } else { Verdict::Collecting }
        } else if state.estimate.condition >= CONDITION_CAP {
            Verdict::Singular
        } else if state.estimated_at.is_none() || !(was_valid || state.models.is_confirmed()) {
            Verdict::Uncertain
        } else if state.quarters < state.unexplained_until
            || (self.known_noise[1] > 0.0 && self.excess(noise.variances[1], state.mean_square_a2) > NOISE_EXCESS)
            || (0..K).any(|k| far_below * lambda[k] < self.lambda0[k])
        {
            Verdict::Unexplained
        } else if state.uncounted > MAX_UNCOUNTED {
            Verdict::BadSample
        } else if !noise.is_within_range(self.gap_m, state.mean_square_a2) {
            Verdict::Noisy
        } else {
            // After a rejection its reason no longer holds.
            let kept = match state.estimate.verdict {
                Verdict::Disabled | Verdict::Contact | Verdict::Stuck | Verdict::Speed | Verdict::BadSample => {
                    Verdict::Collecting
                }
                kept => kept,
            };
            match tested {
                Verdict::Valid if (0..K).any(|k| sqrt(total[k]) >= limit * lambda[k]) => Verdict::Uncertain,
                Verdict::Valid
                    if state.failed as f64 * self.filter.step_s > FAILED_S
                        || state.samples < state.valid_from.max(state.revalid_from[0]) =>
                {
                    kept
                }
                verdict => verdict,
            }
        }
    }
}

impl<const K: usize, const U: usize, const T: usize> Revolution<K, U, T> {
    fn start() -> Self {
        Self { sums: Sums::zeros(), samples: 0.0, passed: 0.0, field: [SVector::zeros(); 2] }
    }
}

impl<const N: usize, const K: usize, const U: usize, const T: usize> PredictionErrorState<N, K, U, T> {
    /// Whether all lists have their lengths, and all indices are within them.
    pub fn has_shape(&self) -> bool {
        self.models.has_shape() && self.pending.has_shape() && self.validation.has_shape()
    }

    /// Adds the rotation during a sample and those missing before it.
    fn advance(&mut self, sample: &Sample<N, K>, step_s: f64) {
        let (omega, at_rest) = (sample.rotation.omega_rad_s.abs(), step_s / REVOLUTION_AT_REST_S);
        let samples = 1.0 + f64::from(sample.missing);
        let of_rotor = omega * step_s / TAU;
        // Below one revolution per second the rotor counts as at rest.
        let counted = (COUNTED_REVOLUTION_S * omega / TAU).round().max(1.0);
        self.pace = if omega > TAU { of_rotor / counted } else { at_rest };
        self.revolution.passed += samples * self.pace;
        // Quarters and orders are counted at no less than 2250 rpm.
        let least = self.pace.max(at_rest);
        self.passed += samples * least;
        self.quarter_samples += samples;
        // Revolutions of the rotor per revolution that is counted.
        let rotor_ratio = if omega > TAU { of_rotor / least } else { 0.0 };
        self.validation.advance(samples * least, rotor_ratio);
    }

    /// Samples per revolution at the present speed, as counted.
    fn per_revolution(&self) -> f64 {
        1.0 / self.pace
    }

    /// Whether noise and tests have had the residuals of an estimate for a revolution. Without this a rotor just lifted from the backup bearing was valid
    /// for up to five samples, off by 20 % or 20 standard deviations (`lift-off`, seeds 1001, 2001, 2002, 2004, 2006).
    fn is_settled(&self) -> bool {
        self.estimated_at.is_some_and(|at| self.quarters >= at + QUARTERS as u64)
    }

    /// Restores the noise estimate from before λ changed; later ones contain the effect of the change.
    fn restore_noise(&mut self) {
        if let Some(noise) = self.trusted[0].clone() {
            self.noise = Some(noise);
        }
        // It takes several quarters until no data from before the change are left.
        if !self.changed {
            (self.changed, self.estimated_at) = (true, Some(self.quarters));
        }
    }

    /// Multiplies all sums so far by a weight.
    fn discount(&mut self, weight: f64) {
        self.models.discount(weight);
        self.present.discount(weight);
        self.revolution.sums.discount(weight);
    }
}
