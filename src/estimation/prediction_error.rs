//! The estimator: whitening filter, prediction errors and instrumental variables, noise, validation.
//!
//! The sums hold all samples since the last change of λ; nothing is forgotten. The last revolution is kept apart in quarters, to be compared
//! with what came before.

use std::f64::consts::{FRAC_PI_2, TAU};

use libm::sqrt;
use nalgebra::SVector;
use serde::{Deserialize, Serialize};

use super::CONDITION_CAP;
use super::config::Verdict;
use super::innovations::{Field, FilterState, Innovation, Running, Sample, Square, WhiteningFilter, turned};
use super::noise::{Noise, OUTLIER, Waiting};
use super::sums::{AngleTable, Solution, Sums};
use super::validation::{Validation, has_changed};

/// Quarters of a revolution that are kept apart.
const QUARTERS: usize = 4;

/// The longest time that counts as a quarter of a revolution, s: a rotor at rest has no revolutions, but λ may change all the same. That
/// of 2250 rpm.
const LONGEST_QUARTER_S: f64 = 1.0 / 150.0;

/// The estimate is solved for every so many samples.
const SOLVE_EVERY: u64 = 4;

/// The least samples for a solution.
const LEAST_SAMPLES: f64 = 12.0;

/// Revolutions after which the table of the instruments is full, and a little more.
const INSTRUMENTS_AFTER: f64 = 1.3;

/// Revolutions with instruments before their estimate counts.
const LEAST_INSTRUMENTED: f64 = 0.5;

/// More outliers than this in a row are no glitches of a sensor.
const OUTLIERS_IN_A_ROW: u32 = 30;

/// Above this leverage an innovation says more of the unknowns than of the noise: where the noise is not told, it tells nothing of it, and
/// nothing of the model.
const LEVERAGE_LIMIT: f64 = 0.5;

/// Least revolutions before an estimate is valid, with the noise told and found: with 2 instead of 3 the worst samples of drawn bearings, early
/// ones, were off by 4.7 and 4.4 deviations instead of 4.1 and 3.9 (seeds 63001 to 63200 and 67001 to 67200), while the noise was still moving.
const VALID_AFTER: [f64; 2] = [1.25, 3.0];

/// Quarters that the filter runs with an estimate before it is valid: until then neither noise nor tests have seen residuals of it. Without this a
/// rotor that had been lifted from the backup bearing was valid for up to five samples, 20 % wrong by 20 deviations (`lift-off`, seeds 1001,
/// 2001, 2002, 2004, 2006).
const SETTLED_AFTER: u64 = 4;

/// Revolutions before changes are looked for, with the noise told and found: it must be known by then. The sums compared with hold as many
/// quarters as those of the last revolution.
const CHANGES_AFTER: [f64; 2] = [2.0, 8.0];

/// The greatest relative standard deviation of a λ with which the filter leaves the first guess.
const RUNNING_STD: f64 = 0.2;

/// The greatest relative standard deviation of a λ, tolerances included, with which an estimate is valid.
pub const STD_LIMIT: f64 = 0.05;

/// A normalised innovation squared beyond this comes from samples that no bearing makes.
const NIS_CAP: f64 = 1.0e12;

/// A quarter of a revolution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Quarter<const K: usize, const U: usize, const T: usize> {
    sums: Sums<K, U, T>,
    /// Noise and ϑ at its begin, or when the estimate was last valid before it.
    trusted: Option<(Noise, SVector<f64, U>)>,
    samples: f64,
    turned_rad: f64,
    /// Sums of `i_k/gap_k²` and `i_k²/gap_k³`.
    per_current: SVector<f64, K>,
    gradient: SVector<f64, K>,
}

/// What there is to say of the unknowns; the last valid estimate where nothing else is said.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate<const K: usize, const U: usize> {
    /// λ, unbalance, loads; λ_0 and zero at first.
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
    valid: bool,
}

impl<const K: usize, const U: usize> Estimate<K, U> {
    /// λ.
    pub fn lambda(&self) -> SVector<f64, K> {
        self.unknowns.fixed_rows::<K>(0).into_owned()
    }

    pub fn is_finite(&self) -> bool {
        let [noise, total] = &self.variance;
        let of_magnets = self.lambda_raw.iter().chain(noise).chain(total).chain(&self.ki).chain(&self.ks);
        let others = [&self.condition, &self.residual];
        of_magnets.chain(&self.unknowns).chain(others).chain(&self.noise).all(|x| x.is_finite())
    }
}

/// All that changes with a sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictionErrorState<const N: usize, const K: usize, const U: usize, const T: usize> {
    pub estimate: Estimate<K, U>,
    /// Samples that have not been filtered yet, from which the noise is started.
    waiting: Waiting<N, K>,
    /// The noise, once it is known.
    noise: Option<Noise>,
    /// The filter, unless the last sample was of no use.
    filter: Option<FilterState<N, K, U, T>>,
    /// ϑ with which the filter runs, whether it comes from the data, and the quarters that had ended when it first did.
    running: SVector<f64, U>,
    estimated: bool,
    estimated_at: u64,
    /// Sums before the last quarters, of these and all before, of these, and of the present one.
    before: Sums<K, U, T>,
    ended: Sums<K, U, T>,
    last: [Quarter<K, U, T>; QUARTERS],
    present: Quarter<K, U, T>,
    table: AngleTable<K>,
    /// Quarters that have ended.
    quarters: u64,
    /// Whether the estimate has been valid since the sums began; outliers among the innovations are then known as such. Those in a row, and
    /// the quarters until which they make the estimate doubtful.
    armed: bool,
    outliers: u32,
    doubtful_until: u64,
    /// Angle passed since the start, rad.
    angle_rad: f64,
    /// Mean square of the currents, A².
    mean_square_a2: f64,
    /// Samples since the start.
    samples: u64,
    /// The solution that is given out, and the inverse of J for the leverage.
    solution: Option<Solution<U, T>>,
    inverse: Square<U>,
    condition: f64,
    validation: Validation<N, U, T>,
}

/// The estimator of [`Method::PredictionError`](super::Method::PredictionError) for N coordinates, K magnets, U unknowns and T tolerances.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictionError<const N: usize, const K: usize, const U: usize, const T: usize> {
    pub filter: WhiteningFilter<N, K, U, T>,
    pub lambda0: [f64; K],
    /// Standard deviations of the noise of a position and of a current that are told, m and A, or 0.
    pub told: [f64; 2],
    /// Relative variance of λ by what scales it: mass and gains of the currents.
    pub scale_variance: f64,
}

impl<const N: usize, const K: usize, const U: usize, const T: usize> PredictionError<N, K, U, T> {
    /// A fresh state.
    pub fn start(&self) -> PredictionErrorState<N, K, U, T> {
        let told = self.told.iter().all(|noise| *noise > 0.0);
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
            noise: self.told,
            valid: false,
        };
        PredictionErrorState {
            estimate,
            waiting: Waiting::empty(),
            noise: told.then(|| Noise::new(self.told, self.told[0])),
            filter: None,
            running,
            estimated: false,
            estimated_at: 0,
            before: Sums::zeros(),
            ended: Sums::zeros(),
            last: std::array::from_fn(|_| Quarter::begin(None)),
            present: Quarter::begin(None),
            table: AngleTable::empty(),
            quarters: 0,
            armed: false,
            outliers: 0,
            doubtful_until: 0,
            angle_rad: 0.0,
            mean_square_a2: 0.0,
            samples: 0,
            solution: None,
            inverse: Square::zeros(),
            condition: CONDITION_CAP,
            validation: Validation::start(0.0),
        }
    }

    /// A gap in the data: the filter starts again after it, the sums stay.
    pub fn interrupt(&self, state: &mut PredictionErrorState<N, K, U, T>) {
        (state.filter, state.waiting, state.estimate.valid) = (None, Waiting::empty(), false);
    }

    /// Takes in a sample, which is finite and within the gap; what to say of the estimate.
    pub fn sample(&self, state: &mut PredictionErrorState<N, K, U, T>, sample: Sample<N, K>) -> Verdict {
        state.waiting.put(sample);
        if state.noise.is_none() {
            state.noise = state.waiting.position_noise_m().map(|first_m| Noise::new(self.told, first_m));
        }
        // Two a step, so that the samples that waited for the noise are caught up with.
        let mut verdict = Verdict::Collecting;
        for _ in 0..2 {
            if let Some(noise) = state.noise.clone()
                && let Some(sample) = state.waiting.take()
            {
                verdict = self.filter(state, &noise, sample);
            }
        }
        state.estimate.valid = verdict == Verdict::Valid;
        verdict
    }

    fn filter(&self, state: &mut PredictionErrorState<N, K, U, T>, noise: &Noise, sample: Sample<N, K>) -> Verdict {
        let [position_variance, current_variance] = noise.variances();
        let Some(filter) = &mut state.filter else {
            state.filter = Some(self.filter.start(sample, position_variance));
            return Verdict::Collecting;
        };
        let by_rad = turned(filter.last.theta_rad, sample.theta_rad);
        let (unknowns, estimated) = (state.running, state.estimated);
        let running = Running { unknowns, estimated, position_variance, current_variance };
        let angle_rad = filter.last.theta_rad + 0.5 * by_rad;
        state.angle_rad += by_rad;
        let passed = state.angle_rad.abs() / TAU;
        let table = &mut state.table;
        let field = self.filter.predict(filter, &running, &sample, |field| {
            table.exchange(angle_rad, field).filter(|_| passed > 1.0).unwrap_or(field.square)
        });
        let innovation = self.filter.innovation(filter, &running);
        let nis = innovation.nis(position_variance);
        state.present.count(&field, by_rad);
        if state.armed && nis > OUTLIER {
            // The filter goes on without the measurement; several in a row are a change.
            filter.last.position_m -= innovation.error_m;
            state.outliers += 1;
            state.doubtful_until = state.quarters + QUARTERS as u64;
            if state.outliers > OUTLIERS_IN_A_ROW {
                self.restart(state);
                return self.report(state, true);
            }
            return self.conclude(state);
        }
        state.outliers = 0;
        if !((0.0..NIS_CAP).contains(&nis) && innovation.is_sound()) {
            // No bearing moves like this: nothing that was gathered can be relied on.
            let estimate = state.estimate.clone();
            *state = PredictionErrorState { estimate, ..self.start() };
            return Verdict::BadSample;
        }
        let told = noise.is_told();
        let settled = state.estimated && (told || leverage(&innovation, &state.inverse) < LEVERAGE_LIMIT);
        // Less than one for outliers.
        let weight = if settled && !told { (OUTLIER / nis).min(1.0) } else { 0.0 };
        self.filter.correct(filter, &running, &innovation, sqrt(weight));

        state.samples += 1;
        state.present.sums.add(&innovation, passed > INSTRUMENTS_AFTER);
        let per_revolution = state.per_revolution();
        state.validation.add(&innovation, sample.turn);
        if settled {
            state.validation.add_settled(&innovation.error, position_variance, per_revolution);
        }
        let square = sample.current_a.norm_squared() / K as f64;
        state.mean_square_a2 += (square - state.mean_square_a2) / per_revolution.min(state.samples as f64);
        if weight > 0.0
            && let Some(noise) = &mut state.noise
        {
            let discount = noise.update(&innovation, position_variance, weight, state.mean_square_a2);
            if discount < 1.0 {
                state.validation.forget(state.revolution());
                state.all_sums().for_each(|sums| sums.discount(discount));
            }
        }
        if state.samples.is_multiple_of(SOLVE_EVERY) {
            self.solve(state);
        }
        let verdict = self.conclude(state);
        state.armed |= verdict == Verdict::Valid;
        verdict
    }

    /// Begins anew after a change of λ.
    fn restart(&self, state: &mut PredictionErrorState<N, K, U, T>) {
        // What was found since then holds the contradiction.
        if let Some((noise, running)) = state.last[0].trusted.clone() {
            (state.noise, state.running) = (Some(noise), running);
        }
        state.all_sums().for_each(|sums| *sums = Sums::zeros());
        // The columns of the filter remember what the former λ did. The estimate of before goes on as the one with which the filter runs: noise and
        // tests need residuals, or samples that no λ explains would stay in the sums for ever.
        (state.filter, state.solution) = (None, None);
        (state.armed, state.outliers) = (false, 0);
        state.validation.restart(state.revolution());
    }

    /// Solves the equations of all samples.
    fn solve(&self, state: &mut PredictionErrorState<N, K, U, T>) {
        let Some(noise) = &state.noise else { return };
        let variances = noise.variances();
        let mut sums = state.ended.clone();
        sums.merge(&state.present.sums);
        if sums.samples < LEAST_SAMPLES {
            return;
        }
        let Some(found) = sums.solve(self.lambda0, variances) else {
            state.condition = CONDITION_CAP;
            return;
        };
        (state.inverse, state.condition) = (found.inverse, found.condition);
        let instruments = Some(&sums).filter(|sums| sums.instrumented >= LEAST_INSTRUMENTED * state.per_revolution());
        let solution = found.combine(instruments, variances[0]);
        let std = solution.relative_std::<K>();
        if !std.is_finite() {
            return;
        }
        // Once the filter runs with an estimate it follows it: the residuals of an estimate that is held would pass for noise, and the noise
        // would keep the estimate uncertain.
        if !state.estimated {
            state.estimated_at = state.quarters;
        }
        if std < RUNNING_STD || state.estimated {
            (state.running, state.estimated) = (solution.unknowns, true);
        }
        state.solution = Some(solution);
    }

    /// Ends the quarter if it is over, and reports.
    fn conclude(&self, state: &mut PredictionErrorState<N, K, U, T>) -> Verdict {
        let Quarter { turned_rad, samples, .. } = state.present;
        let over = turned_rad.abs() >= FRAC_PI_2 || samples * self.filter.step_s >= LONGEST_QUARTER_S;
        let changed = over && self.end_quarter(state);
        self.report(state, changed)
    }

    /// Puts the quarter that is over with the last ones; whether the last revolution contradicts what came before.
    fn end_quarter(&self, state: &mut PredictionErrorState<N, K, U, T>) -> bool {
        let Some(noise) = &state.noise else { return false };
        state.quarters += 1;
        let trusted =
            if state.estimate.valid { Some((noise.clone(), state.running)) } else { state.present.trusted.clone() };
        let quarter = std::mem::replace(&mut state.present, Quarter::begin(trusted));
        state.ended.merge(&quarter.sums);
        state.last.rotate_left(1);
        let oldest = std::mem::replace(&mut state.last[QUARTERS - 1], quarter);
        state.before.merge(&oldest.sums);
        let mut revolution = Sums::zeros();
        state.last.iter().for_each(|quarter| revolution.merge(&quarter.sums));
        let variances = noise.variances();
        if let Some(found) = state.ended.solve(self.lambda0, variances) {
            state.validation.judge_harmonics(state.revolution(), &found, variances[0]);
        }
        if let Some(alone) = revolution.solve(self.lambda0, variances) {
            state.estimate.lambda_raw = alone.combine::<K>(None, variances[0]).lambda();
        }
        let testable = state.estimated
            && state.before.samples > revolution.samples
            && state.revolution() > CHANGES_AFTER[usize::from(!noise.is_told())];
        let changed = testable && has_changed(&state.before, &revolution, variances[0]);
        if changed {
            self.restart(state);
        }
        changed
    }

    /// Completes the estimate; the verdict on it.
    fn report(&self, state: &mut PredictionErrorState<N, K, U, T>, changed: bool) -> Verdict {
        let Some(noise) = &state.noise else { return Verdict::Collecting };
        state.estimate.noise = noise.variances().map(sqrt);
        state.estimate.condition = state.condition;
        state.estimate.residual = state.validation.nis;
        let Some(solution) = &state.solution else {
            let few = state.samples < LEAST_SAMPLES as u64 + SOLVE_EVERY;
            return match (changed, few || state.condition < CONDITION_CAP) {
                (true, _) => Verdict::Changed,
                (false, true) => Verdict::Collecting,
                (false, false) => Verdict::Singular,
            };
        };
        let lambda = solution.lambda::<K>();
        let total = solution.total_variance(self.scale_variance);
        let verdict = self.verdict(state, noise, &lambda, &total);
        let estimate = &mut state.estimate;
        if verdict == Verdict::Valid {
            estimate.unknowns = solution.unknowns;
        }
        let held = (estimate.lambda() - lambda).map(|x| x * x);
        estimate.variance = [solution.variance.fixed_rows::<K>(0) + held, total + held];
        let samples: f64 = state.last.iter().map(|quarter| quarter.samples).sum();
        if samples > 0.0 {
            let twice = estimate.lambda() * (2.0 / samples);
            let sum =
                |of: fn(&Quarter<K, U, T>) -> &SVector<f64, K>| state.last.iter().map(of).sum::<SVector<f64, K>>();
            estimate.ki = twice.component_mul(&sum(|quarter| &quarter.per_current));
            estimate.ks = twice.component_mul(&sum(|quarter| &quarter.gradient));
        }
        verdict
    }

    /// The verdict on an estimate with this variance.
    fn verdict(
        &self,
        state: &PredictionErrorState<N, K, U, T>,
        noise: &Noise,
        lambda: &SVector<f64, K>,
        total: &SVector<f64, K>,
    ) -> Verdict {
        let told = noise.is_told();
        let revolution = state.revolution();
        let settled = state.quarters >= state.estimated_at + SETTLED_AFTER;
        if state.validation.revolutions(revolution) < VALID_AFTER[usize::from(!told)] || !settled {
            Verdict::Collecting
        } else if lambda.iter().any(|lambda| *lambda <= 0.0) {
            Verdict::NotPositive
        } else if state.condition >= CONDITION_CAP {
            Verdict::Singular
        } else if state.quarters < state.doubtful_until {
            Verdict::Unexplained
        } else if !noise.is_within_range() {
            Verdict::Noisy
        } else {
            match state.validation.verdict(revolution, state.per_revolution(), told) {
                Verdict::Valid if (0..K).any(|k| sqrt(total[k]) >= STD_LIMIT * lambda[k]) => Verdict::Uncertain,
                verdict => verdict,
            }
        }
    }
}

impl<const K: usize, const U: usize, const T: usize> Quarter<K, U, T> {
    fn begin(trusted: Option<(Noise, SVector<f64, U>)>) -> Self {
        let zero = SVector::zeros();
        Self { sums: Sums::zeros(), trusted, samples: 0.0, turned_rad: 0.0, per_current: zero, gradient: zero }
    }

    /// Takes in the field of an interval in which the rotor turned by so much.
    #[inline(always)]
    fn count(&mut self, field: &Field<K>, by_rad: f64) {
        self.samples += 1.0;
        self.turned_rad += by_rad;
        self.per_current += field.per_current;
        self.gradient += field.gradient;
    }

    fn is_finite(&self) -> bool {
        let own = self.per_current.iter().chain(&self.gradient).chain([&self.samples, &self.turned_rad]);
        let trusted = |(noise, running): &(Noise, SVector<f64, U>)| noise.is_finite() && all_finite(running);
        own.copied().all(f64::is_finite) && self.sums.is_finite() && self.trusted.as_ref().is_none_or(trusted)
    }
}

fn all_finite<'a>(numbers: impl IntoIterator<Item = &'a f64>) -> bool {
    numbers.into_iter().all(|x| x.is_finite())
}

impl<const N: usize, const K: usize, const U: usize, const T: usize> PredictionErrorState<N, K, U, T> {
    /// Whether all numbers are finite, and all places within their rings.
    pub fn is_sound(&self) -> bool {
        all_finite(self.running.iter().chain([&self.angle_rad, &self.mean_square_a2, &self.condition]))
            && (all_finite(&self.inverse) && self.estimate.is_finite())
            && (self.waiting.is_finite() && self.table.is_finite() && self.validation.is_finite())
            && self.last.iter().chain([&self.present]).all(Quarter::is_finite)
            && (self.before.is_finite() && self.ended.is_finite())
            && self.noise.as_ref().is_none_or(Noise::is_finite)
            && self.filter.as_ref().is_none_or(FilterState::is_finite)
            && self.solution.as_ref().is_none_or(Solution::is_finite)
    }

    /// Revolutions since the start, in quarters; those of a rotor at rest are times.
    fn revolution(&self) -> f64 {
        self.quarters as f64 / QUARTERS as f64
    }

    /// Samples in a revolution: the last one, as far as it has gone.
    fn per_revolution(&self) -> f64 {
        let ended = self.last.iter().filter(|quarter| quarter.samples > 0.0);
        let (count, samples) = ended.fold((0.0, 0.0), |(count, sum), quarter| (count + 1.0, sum + quarter.samples));
        if count > 0.0 { samples / count * QUARTERS as f64 } else { self.present.samples.max(1.0) * QUARTERS as f64 }
    }

    fn all_sums(&mut self) -> impl Iterator<Item = &mut Sums<K, U, T>> {
        let quarters = self.last.iter_mut().chain([&mut self.present]).map(|quarter| &mut quarter.sums);
        quarters.chain([&mut self.before, &mut self.ended])
    }
}

/// `φ J⁻¹ φᵀ S⁻¹`: how much an innovation says of the unknowns.
#[inline(always)]
fn leverage<const N: usize, const K: usize, const U: usize, const T: usize>(
    innovation: &Innovation<N, K, U, T>,
    inverse: &Square<U>,
) -> f64 {
    (inverse * innovation.unknowns).dot(&innovation.unknowns)
}
