//! The estimator: whitening filter, prediction errors and instrumental variables, noise, models, validation.

use std::f64::consts::TAU;
use std::ops::Range;

use libm::sqrt;
use nalgebra::SVector;
use serde::{Deserialize, Serialize};

use super::CONDITION_CAP;
use super::angle::turned;
use super::config::Verdict;
use super::innovations::{FilterState, Running, Sample, WhiteningFilter};
use super::models::{Models, Weighed};
use super::noise::{Noise, OUTLIER, USUAL_CURRENT_NOISE_A, Waiting};
use super::sums::{AngleTable, Prior, Solution, Sums, lambda_of};
use super::validation::Validation;

/// Blocks of samples in a revolution: a change is seen within half of one.
const QUARTERS: usize = 4;

/// Duration that counts as a revolution of a rotor at rest, s: λ may change all the same. That of 2250 rpm.
const REVOLUTION_AT_REST_S: f64 = 4.0 / 150.0;

/// Over so many missing samples the filter predicts; after more it starts again. If it started after every gap, estimates would be valid 71 instead of 99 %
/// of the time with 10 % of the samples missing (noise estimated, seeds 1450001 to 1450020).
const BRIDGED: u32 = 8;

/// The controller has read what is missing here, noise and all, and answered. For so many samples after a gap the currents and the errors of the
/// filter depend on each other, and innovations do not count. With 10 and 20 % of the samples missing (`montecarlo --only "0 % of the samples" --runs 40
/// --seed 1470001`) 22 of 160 runs were beyond 5 deviations where they counted, with 8 samples 4, with 16 and 24 none; with 24 estimates are valid 16
/// instead of 93 % of the time (20 %, noise known). With 12 λ of a spindle were off by 5.9.
const ANSWERED: u32 = 16;

/// After so many samples none of which counted an estimate says nothing of the present. With 20 % missing at random so long a stretch has a probability
/// of 0.4 %.
const MOST_UNCOUNTED: u32 = 1000;

/// The estimate is solved at the end of each quarter, whose samples are judged first. At first, and where the noise is estimated, it is solved within a quarter
/// too, for every so many samples, or for this part of those before: where it lags behind the data, its error passes for noise of the currents. With
/// quarters alone this noise of spindles came out 1.5 times too large at 0.1 s, and error/std was 0.71 instead of 0.86 (seeds 61501 to 61600); with a
/// part of 1/32 it is 0.81, with 1/128 0.88. Not so after a change: 2 instead of 1 of 160 runs were valid and wrong after a blow (test `blows_are_forgotten`).
const SOLVE_EVERY: f64 = 4.0;
const SOLVE_PART: f64 = 1.0 / 64.0;

/// The least samples for a solution: nine unknowns in two equations per sample, with some to spare.
const LEAST_SAMPLES: f64 = 12.0;

/// The greatest relative standard deviation of a λ with which the filter leaves the first guess, and the least relative error of this that shows.
const RUNNING_STD: f64 = 0.2;

/// The part of a λ below which a first guess is far too small. With λ_0 a tenth of λ and a start far from the centre 16 of 600 runs were beyond 5
/// deviations where the filter went on, many with a force that was none; now none. With a limit of 0.8 spindles lost 5 to 20 % of their
/// precision (`montecarlo --only "spindle:" --runs 200 --seed 741001`).
const FAR_TOO_SMALL: f64 = 0.4;

/// The greatest relative standard deviation of a λ, tolerances included, with which an estimate becomes valid; it stays so up to twice that.
pub const STD_LIMIT: f64 = 0.05;

/// An oscillating force that the model does not hold passes for noise of the currents, and its beat with the rotor for a force that turns backward. So
/// no such force is identified where this noise exceeds what is stated, or else what is usual, by the first factor; by the second, stated noise does not
/// explain the motion. Noise stated 30 % too low is off by 1.4, as a third by 3, ramps of load by 4. Without the first, 4 of 200
/// runs with 0.5 to 8 N at 95 to 130 Hz were up to 42 deviations off, with it none (noise estimated, seeds 985001 to 985200).
const FORCE_EXCESS: f64 = 1.5;
const NOISE_EXCESS: f64 = 5.0;

/// An estimate that the tests refused for longer, in s, has to pass them until less is left: without this, estimates that pass by chance between two
/// refusals were beyond 5 deviations in 5 of 120 runs with 0.5 N in a narrow band and an eccentric encoder (seeds 60101 to 60120).
const REFUSED_S: f64 = 0.05;

/// Sums over a revolution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Revolution<const K: usize, const U: usize, const T: usize> {
    sums: Sums<K, U, T>,
    samples: f64,
    /// The part of it that has passed.
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
    /// Variance of λ by noise, and by noise and tolerances.
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

/// All that changes with a sample. Its large parts are on the heap: the threads of importers have small stacks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictionErrorState<const N: usize, const K: usize, const U: usize, const T: usize> {
    pub estimate: Estimate<K, U>,
    /// Samples that have not been filtered yet, from which the noise is started, and how many are missing before the next.
    waiting: Box<Waiting<N, K>>,
    gap: u32,
    /// The noise, once there is one; as it was when the last quarters began or when the estimate was last valid before.
    noise: Option<Noise>,
    trusted: [Option<Noise>; QUARTERS],
    /// The filter, unless many samples are missing.
    filter: Option<FilterState<N, K, U, T>>,
    /// ϑ with which the filter runs, and the quarters that had ended when it first came from the data, if it does.
    running: SVector<f64, U>,
    estimated_at: Option<u64>,
    /// Sums of the quarters that have ended, and of the present one.
    models: Models<K, U, T>,
    present: Box<Sums<K, U, T>>,
    revolution: Box<Revolution<K, U, T>>,
    /// Whether a revolution has ended; means of `i_k/gap_k²` and `i_k²/gap_k³` over the last one.
    turned: bool,
    field: [SVector<f64, K>; 2],
    table: AngleTable<K>,
    /// Quarters that have ended; revolutions and samples since, the missing ones too; revolutions in a sample at the present pace.
    quarters: u64,
    passed: f64,
    quarter_samples: f64,
    pace: f64,
    /// Whether the estimate has been valid since the sums began; outliers among the innovations are then known as such. Those in a row, and
    /// the quarters until which they make the estimate unexplained.
    armed: bool,
    outliers: u32,
    unexplained_until: u64,
    /// Whether λ has changed since the estimate was last valid.
    changed: bool,
    /// Samples at which the tests refused the estimate, less those at which they passed since.
    refused: u64,
    /// The samples from which on the estimate may be valid again: after a refusal, and after each of the last two times that it became valid.
    valid_from: u64,
    twice_from: [u64; 2],
    /// Mean square of the currents, A².
    mean_square_a2: f64,
    /// Samples since the start, since the last that was missing, and since the last that counted.
    samples: u64,
    since_gap: u32,
    uncounted: u32,
    /// The solution that is given out.
    solution: Option<Solution<U, T>>,
    validation: Box<Validation<N, U, T>>,
}

/// The estimator of [`Method::PredictionError`](super::Method::PredictionError) for N coordinates, K magnets, U unknowns and T tolerances.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictionError<const N: usize, const K: usize, const U: usize, const T: usize> {
    pub filter: WhiteningFilter<N, K, U, T>,
    pub lambda0: [f64; K],
    /// With the widest prior of the backward forces.
    pub prior: Prior<U>,
    /// Standard deviations of the noise of a position and of a current that are known, m and A, or 0.
    pub known_noise: [f64; 2],
    /// Relative variance of λ by what scales it: mass and gains of the currents.
    pub scale_variance: f64,
}

impl<const N: usize, const K: usize, const U: usize, const T: usize> PredictionError<N, K, U, T> {
    /// Whether the noise of positions and currents is known.
    fn knows_noise(&self) -> bool {
        self.known_noise.iter().all(|noise| *noise > 0.0)
    }

    /// A fresh state.
    pub fn start(&self) -> PredictionErrorState<N, K, U, T> {
        let running = SVector::from_fn(|j, _| if j < K { self.lambda0[j] } else { 0.0 });
        let lambda = SVector::from(self.lambda0);
        let variance = lambda.component_mul(&lambda);
        let estimate = Estimate {
            unknowns: running,
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
            waiting: Box::new(Waiting::empty()),
            gap: 0,
            noise: self.knows_noise().then(|| Noise::new(self.known_noise, self.known_noise[0])),
            trusted: [const { None }; QUARTERS],
            filter: None,
            running,
            estimated_at: None,
            models: Models::start(),
            present: Box::new(Sums::zeros()),
            revolution: Box::new(Revolution::start()),
            turned: false,
            field: [SVector::zeros(); 2],
            table: AngleTable::empty(),
            quarters: 0,
            passed: 0.0,
            quarter_samples: 0.0,
            pace: self.filter.step_s / REVOLUTION_AT_REST_S,
            armed: false,
            outliers: 0,
            unexplained_until: 0,
            changed: false,
            refused: 0,
            valid_from: 0,
            twice_from: [0; 2],
            mean_square_a2: 0.0,
            samples: 0,
            since_gap: u32::MAX,
            uncounted: 0,
            solution: None,
            validation: Box::new(Validation::start()),
        }
    }

    /// Takes in a sample unless it is refused: then it is missing, and the sums stay, unless all begins anew. The verdict on the estimate.
    pub fn take(
        &self,
        state: &mut PredictionErrorState<N, K, U, T>,
        refused: Option<Verdict>,
        is_anew: bool,
        sample: impl FnOnce() -> Sample<N, K>,
    ) -> Verdict {
        if let Some(verdict) = refused {
            if is_anew && state.filter.is_some() {
                self.reset(state);
            }
            state.gap = state.gap.saturating_add(1);
            state.estimate.verdict = verdict;
            return verdict;
        }
        let missing = std::mem::take(&mut state.gap);
        state.waiting.put(Sample { missing, ..sample() });
        if state.noise.is_none() {
            state.noise = state.waiting.position_noise_m().map(|first_m| Noise::new(self.known_noise, first_m));
        }
        // Two a step, so that the samples that waited for the noise are caught up with.
        for _ in 0..2 {
            if let Some(noise) = state.noise.clone()
                && let Some(sample) = state.waiting.take()
            {
                state.estimate.verdict = self.filter(state, &noise, sample);
            }
        }
        state.estimate.verdict
    }

    fn filter(&self, state: &mut PredictionErrorState<N, K, U, T>, noise: &Noise, sample: Sample<N, K>) -> Verdict {
        let [position_variance, current_variance] = noise.variances;
        if sample.missing > BRIDGED {
            state.filter = None;
        }
        state.since_gap = if sample.missing > 0 { 0 } else { state.since_gap.saturating_add(1) };
        state.advance(&sample, self.filter.step_s);
        let Some(filter) = &mut state.filter else {
            state.filter = Some(self.filter.start(sample, position_variance));
            return self.report(state);
        };
        let (unknowns, estimated) = (state.running, state.estimated_at.is_some());
        let running = Running { unknowns, estimated, position_variance, current_variance };
        let mut instrumented = false;
        let table = &mut state.table;
        let mut predict = |filter: &mut FilterState<N, K, U, T>, running: &Running<U>, sample: &Sample<N, K>| {
            let (from_rad, to_rad) = (filter.last.rotation.theta_rad, sample.rotation.theta_rad);
            self.filter.predict(filter, running, sample, |square| {
                let instruments = table.exchange(from_rad + 0.5 * turned(from_rad, to_rad), square);
                instrumented = instruments.is_some();
                instruments.unwrap_or_else(SVector::zeros)
            })
        };
        let before = filter.last;
        for n in 0..sample.missing {
            // The current went from one value to the other at an unknown instant.
            let lost = before.between(&sample, f64::from(n + 1) / f64::from(sample.missing + 1));
            let jump = (sample.current_a - before.current_a).amax();
            let running =
                Running { current_variance: current_variance + f64::from(sample.missing) * jump * jump, ..running };
            predict(filter, &running, &lost);
            let innovation = self.filter.innovation(filter, &running);
            filter.last.position_m -= innovation.error_m;
        }
        let field = predict(filter, &running, &sample);
        let innovation = self.filter.innovation(filter, &running);
        let nis = innovation.nis(position_variance);
        state.revolution.samples += 1.0;
        state.revolution.field[0] += field.per_current;
        state.revolution.field[1] += field.gradient;
        if state.armed && nis > OUTLIER {
            // The filter goes on as if the measurement were missing; several in a row are a change, which the samples after it show.
            filter.last.position_m -= innovation.error_m;
            state.outliers += 1;
            if state.outliers == 1 {
                state.since_gap = 0;
                return state.estimate.verdict;
            }
            (state.since_gap, state.unexplained_until) = (ANSWERED, state.quarters + QUARTERS as u64);
            // More are no glitches of a sensor.
            if state.outliers > 30 {
                self.restart(state);
            }
            return self.end_sample(state);
        }
        state.outliers = 0;
        if !((0.0..1.0e12).contains(&nis) && innovation.is_sound()) {
            // Non-physical sample: nothing that was gathered can be relied on.
            self.reset(state);
            return Verdict::BadSample;
        }
        // Above a leverage `φ J⁻¹ φᵀ S⁻¹` of one half an innovation says more of the unknowns than of the noise, and nothing of the model.
        let leverage = |found: &Solution<U, T>| (found.inverse * innovation.unknowns).dot(&innovation.unknowns);
        let settled = estimated && state.solution.as_ref().is_some_and(|found| leverage(found) < 0.5);
        // Less than one for outliers.
        let weight = if settled { (OUTLIER / nis).min(1.0) } else { 0.0 };
        self.filter.correct(filter, &running, &innovation, sqrt(weight));

        state.samples += 1;
        if estimated && state.since_gap < ANSWERED {
            state.uncounted = state.uncounted.saturating_add(1);
            return self.end_sample(state);
        }
        state.uncounted = 0;
        state.present.add(&innovation, sample.rotation.variance, instrumented);
        let per_revolution = state.per_revolution();
        state.validation.add(&innovation, sample.turn);
        let square = sample.current_a.norm_squared() / K as f64;
        state.mean_square_a2 += (square - state.mean_square_a2) / per_revolution.min(state.samples as f64);
        if settled && let Some(noise) = &mut state.noise {
            state.validation.add_settled(&innovation.error, position_variance, per_revolution);
            let discount = noise.update(&innovation, position_variance, weight, state.mean_square_a2);
            if discount < 1.0 {
                state.validation.forget();
                state.discount(discount);
            }
        }
        let every = SOLVE_EVERY.max((SOLVE_PART * state.models.sums().samples).floor());
        let lags = !self.knows_noise() && !state.changed;
        if state.present.samples % every == 0.0 && (lags || !state.is_settled()) {
            self.solve(state);
        }
        let verdict = self.end_sample(state);
        if verdict == Verdict::Valid {
            (state.armed, state.changed) = (true, false);
        }
        verdict
    }

    /// Begins anew, with the estimate of before.
    fn reset(&self, state: &mut PredictionErrorState<N, K, U, T>) {
        let estimate = Estimate { condition: CONDITION_CAP, ..state.estimate.clone() };
        *state = PredictionErrorState { estimate, ..self.start() };
    }

    /// Begins anew after a change of λ.
    fn restart(&self, state: &mut PredictionErrorState<N, K, U, T>) {
        state.trust_again();
        state.models.restart();
        (*state.present, *state.revolution) = (Sums::zeros(), Revolution::start());
        // The columns of the filter remember what the former λ did. The estimate of before goes on as the one with which the filter runs: noise and
        // tests need residuals, or samples that no λ explains would stay in the sums for ever.
        (state.filter, state.solution) = (None, None);
        (state.armed, state.outliers) = (false, 0);
        *state.validation = Validation::start();
    }

    /// Solves the equations of all samples.
    fn solve(&self, state: &mut PredictionErrorState<N, K, U, T>) {
        let Some(noise) = &state.noise else { return };
        let variances = noise.variances;
        let mut sums = state.models.sums().clone();
        sums.merge(&state.present);
        if sums.samples < LEAST_SAMPLES {
            return;
        }
        // The solutions with the widest prior of the backward forces, and with that of the model that is used.
        let solutions = sums.solve(&self.prior, variances).and_then(|found| {
            let widest = found.combine(&sums, &self.prior, variances[0]);
            let is_plausible = self.excess(variances[1]) <= FORCE_EXCESS;
            let model = state.models.select(&self.prior, &found, &widest, self.forces(), variances[0], is_plausible)?;
            let prior = state.models.prior(&self.prior, self.forces());
            let found = if prior == self.prior { found } else { sums.solve(&prior, variances)? };
            let solution = Solution { model, ..found.combine(&sums, &prior, variances[0]) };
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
        // Once the filter runs with an estimate it follows it: the residuals of an estimate that is held would pass for noise, and the noise
        // would keep the estimate uncertain. So would those of a backward force that is not decided on.
        let estimated = state.estimated_at.is_some();
        if std < RUNNING_STD || estimated {
            if !estimated {
                state.estimated_at = Some(state.quarters);
                // Where λ was guessed too small, the weights S⁻¹ of these samples are too large, by 1 where the noise of the positions decides, and by
                // (λ/λ_0)² where that of the currents does: they count with the geometric mean. The state of the filter, of which it was too sure, goes
                // on to disturb: it starts again. More than a revolution with a wrong stiffness counts a tenth. To drop these samples altogether costs
                // bearings with little excitation most of their time valid: 16 instead of 78 % in a study of weakly excited bearings.
                let ratios = SVector::<f64, K>::from_fn(|k, _| self.lambda0[k] / solution.unknowns[k]);
                let wrong = ratios.iter().any(|ratio| (1.0 / ratio - 1.0).abs() > RUNNING_STD);
                let (late, small) = (state.quarters >= QUARTERS as u64 && wrong, ratios.min() < FAR_TOO_SMALL);
                if late || small {
                    state.discount(if late { 0.1 } else { ratios.min() });
                    state.validation.forget();
                }
                if small {
                    state.filter = None;
                }
            }
            let wide = widest.relative_std::<K>() < RUNNING_STD;
            state.running = if wide { widest.unknowns } else { solution.unknowns };
        }
        state.solution = Some(solution);
    }

    /// How far the noise of the currents is above what is stated, or else above what is usual: a ratio of standard deviations.
    fn excess(&self, current_variance: f64) -> f64 {
        let [_, stated_a] = self.known_noise;
        sqrt(current_variance) / if stated_a > 0.0 { stated_a } else { USUAL_CURRENT_NOISE_A }
    }

    /// The backward forces among the unknowns.
    fn forces(&self) -> Range<usize> {
        self.filter.machine.backward..U - N
    }

    /// Ends the quarter if it is over, and reports.
    fn end_sample(&self, state: &mut PredictionErrorState<N, K, U, T>) -> Verdict {
        if state.passed * QUARTERS as f64 >= 1.0 {
            self.end_quarter(state);
        }
        self.report(state)
    }

    /// Takes the quarter that is over into the models.
    fn end_quarter(&self, state: &mut PredictionErrorState<N, K, U, T>) {
        let Some(noise) = state.noise.clone() else { return };
        let variances = noise.variances;
        let block = std::mem::replace(&mut *state.present, Sums::zeros());
        let time_s = state.quarter_samples * self.filter.step_s;
        (state.quarters, state.passed, state.quarter_samples) = (state.quarters + 1, 0.0, 0.0);
        state.validation.end_quarter();
        state.trusted.rotate_left(1);
        if state.estimate.verdict == Verdict::Valid {
            state.trusted[QUARTERS - 1] = Some(noise.clone());
        } else {
            state.trusted[QUARTERS - 1] = state.trusted[QUARTERS - 2].clone();
        }
        let prior = state.models.prior(&self.prior, self.forces());
        if state.is_settled() || state.changed {
            state.validation.discount(state.models.discount_of(time_s), time_s);
            let present = state.validation.present(state.per_revolution());
            let loads = self.filter.machine.unit_loads();
            match state.models.weigh((&block, time_s), &self.prior, variances[0], present, state.quarters, &loads) {
                Weighed::Same => (),
                Weighed::Renewed => state.validation.forget(),
                Weighed::Changed => {
                    state.trust_again();
                    *state.validation = Validation::start();
                }
            }
            state.models.mix(&prior, variances, time_s);
        } else {
            state.models.merge(&block);
        }
        if let Some(found) = state.models.sums().solve(&prior, variances) {
            let moved = state.models.discount_of(time_s) < 1.0;
            let per_revolution = state.per_revolution();
            state.validation.judge_lines(&found, moved, variances[0], per_revolution);
        }
        let revolution = &mut state.revolution;
        revolution.sums.merge(&block);
        let over = revolution.passed >= 1.0;
        if over && let Some(alone) = revolution.sums.solve(&prior, variances) {
            state.estimate.lambda_raw = lambda_of(&alone.unknowns);
        }
        if over || !state.turned {
            state.field = revolution.field.map(|sum| sum / revolution.samples);
        }
        if over {
            **revolution = Revolution::start();
            state.turned = true;
        }
        self.solve(state);
    }

    /// Completes the estimate; the verdict on it.
    fn report(&self, state: &mut PredictionErrorState<N, K, U, T>) -> Verdict {
        let Some(noise) = &state.noise else { return Verdict::Collecting };
        state.estimate.noise = noise.variances.map(sqrt);
        state.estimate.residual = state.validation.nis;
        let Some(solution) = &state.solution else {
            let few = state.samples < (LEAST_SAMPLES + SOLVE_EVERY) as u64;
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
            state.refused = match tested {
                Verdict::Valid => state.refused.saturating_sub(1),
                _ => (state.refused + 1).min(samples(1.0)),
            };
        }
        match (state.estimate.verdict == Verdict::Valid, verdict == Verdict::Valid) {
            // An estimate that a test refused has to pass all of them for 0.1 s, and becomes valid twice a second at most: `valid` changes at most
            // five times a second.
            (false, true) => state.twice_from = [state.twice_from[1], state.samples + samples(1.0)],
            (true, false) => state.valid_from = state.samples + samples(0.1),
            _ => (),
        }
        let estimate = &mut state.estimate;
        if verdict == Verdict::Valid {
            estimate.unknowns = solution.unknowns;
        }
        let given = lambda_of::<K, U>(&estimate.unknowns);
        let held = (given - lambda).map(|x| x * x);
        estimate.variance = [variance + held, total + held];
        [estimate.ki, estimate.ks] = state.field.map(|field| given.component_mul(&field) * 2.0);
        verdict
    }

    /// The verdict on an estimate with this variance.
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
        // A quarter for the first solution and a revolution until it is settled; noise that is estimated takes longer to be found.
        let least = if self.knows_noise() { QUARTERS + 1 } else { 2 * QUARTERS };
        if state.validation.quarters() < least || (state.estimated_at.is_some() && !state.is_settled()) {
            if state.changed { Verdict::Changed } else { Verdict::Collecting }
        } else if state.estimate.condition >= CONDITION_CAP {
            Verdict::Singular
        } else if state.estimated_at.is_none() || !(was_valid || state.models.is_confirmed()) {
            Verdict::Uncertain
        } else if state.quarters < state.unexplained_until
            || (self.known_noise[1] > 0.0 && self.excess(noise.variances[1]) > NOISE_EXCESS)
        {
            Verdict::Unexplained
        } else if state.uncounted > MOST_UNCOUNTED {
            Verdict::BadSample
        } else if !noise.is_within_range() {
            Verdict::Noisy
        } else {
            match tested {
                Verdict::Valid if (0..K).any(|k| sqrt(total[k]) >= limit * lambda[k]) => Verdict::Uncertain,
                Verdict::Valid if state.refused as f64 * self.filter.step_s > REFUSED_S => state.estimate.verdict,
                Verdict::Valid if state.samples < state.valid_from.max(state.twice_from[0]) => state.estimate.verdict,
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
    /// Whether all places are within their lists.
    pub fn has_shape(&self) -> bool {
        self.models.has_shape() && self.waiting.has_shape()
    }

    /// Counts what passes of a revolution with a sample and those missing before it.
    fn advance(&mut self, sample: &Sample<N, K>, step_s: f64) {
        let (omega, at_rest) = (sample.rotation.omega_rad_s.abs(), step_s / REVOLUTION_AT_REST_S);
        let samples = 1.0 + f64::from(sample.missing);
        // Below one revolution a second a rotor is at rest.
        self.pace = if omega > TAU { omega * step_s / TAU } else { at_rest };
        self.revolution.passed += samples * self.pace;
        let least = self.least_pace(step_s);
        self.passed += samples * least;
        self.quarter_samples += samples;
        // Revolutions of the rotor in one that is counted.
        let of_rotor = if omega > TAU { self.pace / least } else { 0.0 };
        self.validation.advance(samples * least, of_rotor);
    }

    /// Revolutions in a sample, of a slow rotor those of one of 2250 rpm: quarters and orders are counted by it.
    fn least_pace(&self, step_s: f64) -> f64 {
        self.pace.max(step_s / REVOLUTION_AT_REST_S)
    }

    /// Samples in a revolution at the present pace.
    fn per_revolution(&self) -> f64 {
        1.0 / self.pace
    }

    /// Whether noise and tests have seen residuals of an estimate for a revolution. Without this a rotor that had been lifted from the backup bearing was
    /// valid for up to five samples, 20 % wrong by 20 deviations (`lift-off`, seeds 1001, 2001, 2002, 2004, 2006).
    fn is_settled(&self) -> bool {
        self.estimated_at.is_some_and(|at| self.quarters >= at + QUARTERS as u64)
    }

    /// The noise found since λ changed holds the contradiction.
    fn trust_again(&mut self) {
        if let Some(noise) = self.trusted[0].clone() {
            self.noise = Some(noise);
        }
        // A change takes several quarters until nothing of before is left.
        if !self.changed {
            (self.changed, self.estimated_at) = (true, Some(self.quarters));
        }
    }

    /// Counts all samples so far with a weight.
    fn discount(&mut self, weight: f64) {
        self.models.discount(weight);
        self.present.discount(weight);
        self.revolution.sums.discount(weight);
    }
}
