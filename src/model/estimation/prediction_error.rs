//! The estimator: whitening filter, prediction errors and instrumental variables, noise, validation.
//!
//! The sums hold all samples since the last change of λ; nothing is forgotten. The last revolution is kept apart in quarters, to be compared
//! with what came before.

use libm::{atan2, sincos, sqrt};
use serde::{Deserialize, Serialize};

use super::config::{EstimatorConfig, EstimatorInput, EstimatorOutput, Verdict};
use super::innovations::{Field, FilterState, Innovation, Running, Sample, UNKNOWNS, WhiteningFilter, turned};
use super::noise::{Differences, LEVERAGE_LIMIT, Noise, OUTLIER, clip};
use super::sums::{AngleTable, InstrumentalSums, Solution, Square, Sums};
use super::validation::{Validation, has_changed};
use super::{CONDITION_CAP, MAGNETS};

/// Quarters of a revolution that are kept apart.
const QUARTERS: usize = 4;

/// The longest time that counts as a quarter of a revolution, s: a rotor at rest has no revolutions, but λ may change all the same. That
/// of 2250 rpm.
const LONGEST_QUARTER_S: f64 = 1.0 / 150.0;

/// The estimate is solved for every so many samples.
const SOLVE_EVERY: u64 = 4;

/// The least samples for a solution.
const LEAST_SAMPLES: u32 = 12;

/// Revolutions after which the table of the instruments is full, and a little more.
const INSTRUMENTS_AFTER: f64 = 1.3;

/// More outliers than this in a row are no glitches of a sensor.
const OUTLIERS_IN_A_ROW: u32 = 30;

/// Quarters with instruments before their estimate counts.
const LEAST_INSTRUMENTED: u64 = 2;

/// Where the noise is not told, innovations below this leverage are those of a settled estimate.
const SETTLED_LEVERAGE: f64 = 0.1;

/// Least revolutions before an estimate is valid, with the noise told and found.
const VALID_AFTER: [f64; 2] = [1.25, 2.0];

/// Revolutions before changes are looked for, with the noise told and found: it must be known by then. The sums compared with hold as many
/// quarters as those of the last revolution.
const CHANGES_AFTER: [f64; 2] = [2.0, 8.0];

/// The greatest relative standard deviation of a λ with which the filter leaves the first guess.
const RUNNING_STD: f64 = 0.2;

/// The greatest relative standard deviation of a λ, tolerances included, with which an estimate is valid.
pub const STD_LIMIT: f64 = 0.05;

/// The sums begin anew when λ has moved so far from what they began with that this change, in one of the samples gathered, could be a fifth
/// of the standard deviation; at most so many times, and after so many samples.
const RELINEARISE: f64 = 0.2;
const RELINEARISATIONS: u32 = 5;
const RELINEARISE_AFTER: u32 = 40;

/// After the sums began anew the former estimate stays until the new one is at most so much less certain.
const WORSE: f64 = 1.05;

/// A quarter of a revolution.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Quarter {
    sums: Sums,
    /// Noise and ϑ at its begin, or when the estimate was last valid before it.
    trusted: Option<(Noise, [f64; UNKNOWNS])>,
    samples: f64,
    turned_rad: f64,
    /// Sums of `i_k/gap_k²` and `i_k²/gap_k³`.
    per_current: [f64; MAGNETS],
    gradient: [f64; MAGNETS],
}

/// All that changes with a sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictionErrorState {
    /// What the noise is started from.
    differences: Differences,
    /// The noise, once it is known.
    noise: Option<Noise>,
    /// The filter, unless the last sample was of no use.
    filter: Option<FilterState>,
    /// ϑ with which the filter runs, and whether it comes from the data.
    running: [f64; UNKNOWNS],
    estimated: bool,
    /// λ with which the sums began, and how often they began anew because of it.
    linearised: [f64; MAGNETS],
    relinearisations: u32,
    /// Sums before the last quarters, of these, and of the present one.
    before: Sums,
    last: [Quarter; QUARTERS],
    present: Quarter,
    table: AngleTable,
    instrumental: InstrumentalSums,
    /// Quarters that have ended, and those among them with instruments.
    quarters: u64,
    instrumented: u64,
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
    /// The solution that is given out, with the variance of λ, and the inverse of J for the leverage.
    solution: Option<Solution>,
    /// Whether it is of before the sums began anew, and stays until they tell as much.
    held: bool,
    inverse: Square,
    condition: f64,
    validation: Validation,
}

/// The estimator of [`Method::PredictionError`](super::Method::PredictionError).
#[derive(Clone, Debug, PartialEq)]
pub struct PredictionError {
    filter: WhiteningFilter,
    lambda0: [f64; MAGNETS],
    told: [f64; 2],
    step_s: f64,
    identify_unbalance: bool,
    /// Relative variance of λ by what scales it: mass and gains of the currents.
    scale_variance: f64,
}

impl PredictionError {
    /// The estimator of a checked configuration.
    pub fn new(config: &EstimatorConfig) -> Self {
        let mass = config.tolerance.m_kg / config.m_kg;
        Self {
            filter: WhiteningFilter::new(config),
            lambda0: config.lambda0_nm2_a2,
            told: [config.position_noise_m, config.current_noise_a],
            step_s: config.step_s,
            identify_unbalance: config.identify_unbalance,
            scale_variance: mass * mass + 4.0 * config.tolerance.current_gain * config.tolerance.current_gain,
        }
    }

    /// A fresh state.
    pub fn start(&self) -> PredictionErrorState {
        let told = self.told.iter().all(|noise| *noise > 0.0);
        PredictionErrorState {
            differences: Differences::default(),
            noise: told.then(|| Noise::new(self.told, self.told[0])),
            filter: None,
            running: self.first_guess(),
            estimated: false,
            linearised: self.lambda0,
            relinearisations: 0,
            before: Sums::default(),
            last: Default::default(),
            present: Quarter::default(),
            table: AngleTable::default(),
            instrumental: InstrumentalSums::default(),
            quarters: 0,
            instrumented: 0,
            armed: false,
            outliers: 0,
            doubtful_until: 0,
            angle_rad: 0.0,
            mean_square_a2: 0.0,
            samples: 0,
            solution: None,
            held: false,
            inverse: Square::zeros(),
            condition: CONDITION_CAP,
            validation: Validation::start(0.0),
        }
    }

    fn first_guess(&self) -> [f64; UNKNOWNS] {
        let [l1, l2, l3] = self.lambda0;
        [l1, l2, l3, 0.0, 0.0, 0.0, 0.0]
    }

    /// A gap in the data: the filter starts again after it, the sums stay.
    pub fn interrupt(&self, state: &mut PredictionErrorState) {
        state.filter = None;
        if state.noise.is_none() {
            state.differences = Differences::default();
        }
    }

    /// Takes in a sample, which is finite and within the gap; what to say of the estimate.
    pub fn sample(
        &self,
        state: &mut PredictionErrorState,
        input: &EstimatorInput,
        output: &mut EstimatorOutput,
    ) -> Verdict {
        let (sin, cos) = sincos(input.theta_rad);
        let sample = Sample {
            position_m: input.position_m,
            current_a: input.current_a,
            theta_rad: input.theta_rad,
            turn: [cos, sin],
            omega_rad_s: input.omega_rad_s,
        };
        if state.noise.is_none() {
            state.noise = state.differences.add(input.position_m).map(|first_m| Noise::new(self.told, first_m));
        }
        let Some(noise) = state.noise.clone() else { return Verdict::Collecting };
        let [position_variance, current_variance] = noise.variances();
        let Some(filter) = &mut state.filter else {
            state.filter = Some(self.filter.start(sample, position_variance));
            return Verdict::Collecting;
        };
        let by_rad = turned(filter.last.theta_rad, sample.theta_rad);
        let field_gradient = mean(state.last.iter().chain([&state.present]), |quarter| quarter.gradient);
        let field_gradient = field_gradient.unwrap_or_else(|| {
            let gaps = self.filter.gaps(sample.position_m);
            std::array::from_fn(|k| input.current_a[k] * input.current_a[k] / (gaps[k] * gaps[k] * gaps[k]))
        });
        let (unknowns, estimated) = (state.running, state.estimated);
        let running = Running { unknowns, estimated, position_variance, current_variance, field_gradient };
        let angle_rad = filter.last.theta_rad + 0.5 * by_rad;
        let passed = (state.angle_rad + by_rad).abs() / std::f64::consts::TAU;
        let table = &mut state.table;
        let field = self.filter.predict(filter, &running, &sample, |field| {
            table.exchange(angle_rad, field).filter(|_| passed > 1.0).unwrap_or(field.square)
        });
        let innovation = self.filter.innovation(filter, &running);
        let nis = innovation.product(innovation.error, innovation.error) / position_variance;
        if state.armed && nis > OUTLIER {
            // The filter goes on without the measurement.
            for (position, error) in filter.last.position_m.iter_mut().zip(innovation.error) {
                *position -= error;
            }
            state.angle_rad += by_rad;
            state.present.count(&field, by_rad);
            return self.outlier(state, instrumented(passed), output);
        }
        state.outliers = 0;
        if !(0.0..NIS_CAP).contains(&nis) {
            // No bearing moves like this: nothing that was gathered can be relied on.
            *state = self.start();
            return Verdict::BadSample;
        }
        let leverage =
            if state.estimated && !noise.is_told() { leverage(&innovation, &state.inverse) } else { f64::INFINITY };
        let weight = if leverage < LEVERAGE_LIMIT { clip(&innovation, &running) } else { 0.0 };
        self.filter.correct(filter, &running, &innovation, sqrt(weight));

        let with_tolerances = self.filter.has_tolerances();
        state.samples += 1;
        state.angle_rad += by_rad;
        state.present.sums.add(&innovation, with_tolerances);
        state.present.count(&field, by_rad);
        if instrumented(passed) {
            state.instrumental.add(&innovation, with_tolerances);
        }
        let per_revolution = state.per_revolution();
        let settled = if noise.is_told() { state.estimated } else { leverage < SETTLED_LEVERAGE };
        let turn = sample.turn;
        state.validation.add(&innovation, position_variance, turn, per_revolution, settled, with_tolerances);
        let square = input.current_a.iter().map(|i| i * i).sum::<f64>() / 3.0;
        state.mean_square_a2 += (square - state.mean_square_a2) / per_revolution.min(state.samples as f64);
        if weight > 0.0
            && let Some(noise) = &mut state.noise
        {
            let discount = noise.update(&innovation, &running, leverage, state.mean_square_a2);
            state.discount(discount);
        }
        if state.samples.is_multiple_of(SOLVE_EVERY) {
            self.solve(state, sample);
        }
        let changed = state.quarter_is_over(self.step_s) && self.end_quarter(state, instrumented(passed), output);
        let verdict = self.report(state, output, changed);
        state.armed |= verdict == Verdict::Valid;
        verdict
    }

    /// Leaves out a sample that cannot be noise; several in a row are a change.
    fn outlier(&self, state: &mut PredictionErrorState, instrumented: bool, output: &mut EstimatorOutput) -> Verdict {
        state.outliers += 1;
        state.doubtful_until = state.quarters + QUARTERS as u64;
        if state.outliers > OUTLIERS_IN_A_ROW {
            self.restart(state);
            return self.report(state, output, true);
        }
        let changed = state.quarter_is_over(self.step_s) && self.end_quarter(state, instrumented, output);
        self.report(state, output, changed)
    }

    /// Begins anew after a change of λ.
    fn restart(&self, state: &mut PredictionErrorState) {
        // What was found since then holds the contradiction.
        if let Some((noise, running)) = &state.last[0].trusted {
            (state.noise, state.running) = (Some(noise.clone()), *running);
        }
        state.forget();
        // Its columns remember what the former λ did.
        state.filter = None;
        state.solution = None;
        (state.armed, state.outliers) = (false, 0);
        state.relinearisations = 0;
        state.linearised = [state.running[0], state.running[1], state.running[2]];
        state.validation.restart(state.revolution());
    }

    /// Solves both sets of equations and keeps the better estimate.
    fn solve(&self, state: &mut PredictionErrorState, sample: Sample) {
        let Some(noise) = &state.noise else { return };
        let variances = noise.variances();
        let mut sums = state.before.clone();
        state.last.iter().chain([&state.present]).for_each(|quarter| sums.merge(&quarter.sums));
        if sums.samples < LEAST_SAMPLES {
            return;
        }
        let Some(found) = sums.solve(self.lambda0, variances) else {
            state.condition = CONDITION_CAP;
            return;
        };
        (state.inverse, state.condition) = (found.inverse, found.condition);
        let instrumental = (state.instrumented >= LEAST_INSTRUMENTED).then_some(&state.instrumental);
        let solution = found.combine(instrumental, variances[0]);
        let std = solution.relative_std();
        if !std.is_finite() {
            return;
        }
        // Once the filter runs with an estimate it follows it: the residuals of an estimate that is held would pass for noise, and the noise
        // would keep the estimate uncertain.
        if std < RUNNING_STD || state.estimated {
            (state.running, state.estimated) = (solution.unknowns, true);
        }
        let moved = (0..MAGNETS).map(|k| (state.running[k] / state.linearised[k] - 1.0).abs()).fold(0.0, f64::max);
        let worse = state.solution.as_ref().filter(|_| state.held).is_some_and(|former| {
            solution.variance.iter().zip(former.variance).any(|(new, old)| *new > WORSE * WORSE * old)
        });
        if !worse {
            (state.solution, state.held) = (Some(solution), false);
        }
        let samples = f64::from(sums.samples);
        if state.relinearisations < RELINEARISATIONS
            && sums.samples >= RELINEARISE_AFTER
            && std < RELINEARISE * moved / samples
        {
            state.relinearisations += 1;
            state.linearised = [state.running[0], state.running[1], state.running[2]];
            // What is given out meanwhile owns to the error that is being removed.
            if let Some(solution) = &mut state.solution {
                for k in 0..MAGNETS {
                    let error = RELINEARISE * moved / samples * solution.unknowns[k];
                    solution.variance[k] = solution.variance[k].max(error * error);
                }
            }
            state.held = true;
            state.forget();
            state.filter = Some(self.filter.start(sample, variances[0]));
        }
    }

    /// Puts the quarter that is over with the last ones; whether the last revolution contradicts what came before.
    fn end_quarter(&self, state: &mut PredictionErrorState, instrumented: bool, output: &mut EstimatorOutput) -> bool {
        state.quarters += 1;
        state.instrumented += u64::from(instrumented);
        let trusted = match &state.noise {
            Some(noise) if output.valid => Some((noise.clone(), state.running)),
            _ => state.present.trusted.clone(),
        };
        let next = Quarter { trusted, ..Quarter::default() };
        let quarter = std::mem::replace(&mut state.present, next);
        state.last.rotate_left(1);
        let oldest = std::mem::replace(&mut state.last[QUARTERS - 1], quarter);
        state.before.merge(&oldest.sums);
        let Some(noise) = &state.noise else { return false };
        let [position_variance, _] = noise.variances();
        let now = state.revolution();
        let mut all = state.before.clone();
        state.last.iter().for_each(|quarter| all.merge(&quarter.sums));
        if let Some(found) = all.solve(self.lambda0, noise.variances()) {
            state.validation.judge_harmonics(now, &found, position_variance);
        }
        let mut revolution = Sums::default();
        state.last.iter().for_each(|quarter| revolution.merge(&quarter.sums));
        if let Some(alone) = revolution.solve(self.lambda0, noise.variances()) {
            let [l1, l2, l3, ..] = alone.combine(None, position_variance).unknowns;
            output.lambda_raw = [l1, l2, l3];
        }
        let testable = state.estimated
            && state.before.samples > revolution.samples
            && state.revolution() > CHANGES_AFTER[usize::from(!noise.is_told())];
        let with_tolerances = self.filter.has_tolerances();
        if !testable || !has_changed(&state.before, &revolution, position_variance, with_tolerances) {
            return false;
        }
        self.restart(state);
        true
    }

    /// Writes the estimate into the output; the verdict on it.
    fn report(&self, state: &PredictionErrorState, output: &mut EstimatorOutput, changed: bool) -> Verdict {
        let Some(noise) = &state.noise else { return Verdict::Collecting };
        let [position_variance, current_variance] = noise.variances();
        output.position_noise_m = sqrt(position_variance);
        output.current_noise_a = sqrt(current_variance);
        output.condition = state.condition;
        output.residual = state.validation.nis;
        let Some(solution) = &state.solution else {
            return match (changed, state.condition < CONDITION_CAP) {
                (true, _) => Verdict::Changed,
                (false, true) => Verdict::Collecting,
                (false, false) if state.samples < u64::from(LEAST_SAMPLES) + SOLVE_EVERY => Verdict::Collecting,
                (false, false) => Verdict::Singular,
            };
        };
        let lambda = [solution.unknowns[0], solution.unknowns[1], solution.unknowns[2]];
        let by_tolerances = solution.tolerance_variance();
        let total: [f64; MAGNETS] = std::array::from_fn(|k| {
            solution.variance[k] + by_tolerances[k] + self.scale_variance * lambda[k] * lambda[k]
        });
        let told = noise.is_told();
        let verdict = if state.validation.revolutions(state.revolution()) < VALID_AFTER[usize::from(!told)] {
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
            match state.validation.verdict(state.revolution(), state.per_revolution(), told) {
                Verdict::Valid if (0..MAGNETS).any(|k| sqrt(total[k]) >= STD_LIMIT * lambda[k]) => Verdict::Uncertain,
                verdict => verdict,
            }
        };
        if verdict == Verdict::Valid {
            output.lambda_hat = lambda;
            let [.., along, across, p_y, p_z] = solution.unknowns;
            output.load_n = [p_y, p_z];
            if self.identify_unbalance {
                output.unbalance_kg_m = sqrt(along * along + across * across);
                output.unbalance_phase_rad = atan2(across, along);
            }
        }
        for k in 0..MAGNETS {
            let held = output.lambda_hat[k] - lambda[k];
            output.lambda_std[k] = sqrt(solution.variance[k] + held * held);
            output.lambda_std_total[k] = sqrt(total[k] + held * held);
        }
        if let (Some(per_current), Some(gradient)) = (
            mean(state.last.iter(), |quarter| quarter.per_current),
            mean(state.last.iter(), |quarter| quarter.gradient),
        ) {
            output.ki = std::array::from_fn(|k| 2.0 * output.lambda_hat[k] * per_current[k]);
            output.ks = std::array::from_fn(|k| 2.0 * output.lambda_hat[k] * gradient[k]);
        }
        verdict
    }
}

/// Whether the table of the instruments is full after so many revolutions.
fn instrumented(revolutions: f64) -> bool {
    revolutions > INSTRUMENTS_AFTER
}

/// A normalised innovation squared beyond this comes from samples that no bearing makes.
const NIS_CAP: f64 = 1.0e12;

impl Quarter {
    /// Takes in the field of an interval in which the rotor turned by so much.
    #[inline(always)]
    fn count(&mut self, field: &Field, by_rad: f64) {
        self.samples += 1.0;
        self.turned_rad += by_rad;
        for k in 0..MAGNETS {
            self.per_current[k] += field.per_current[k];
            self.gradient[k] += field.gradient[k];
        }
    }
}

impl PredictionErrorState {
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

    fn quarter_is_over(&self, step_s: f64) -> bool {
        self.present.turned_rad.abs() >= std::f64::consts::FRAC_PI_2
            || self.present.samples * step_s >= LONGEST_QUARTER_S
    }

    /// Counts all samples so far with this weight.
    fn discount(&mut self, weight: f64) {
        if weight < 1.0 {
            let now = self.revolution();
            self.validation.forget(now);
            self.before.discount(weight);
            self.instrumental.discount(weight);
            self.last.iter_mut().chain([&mut self.present]).for_each(|quarter| quarter.sums.discount(weight));
        }
    }

    /// Forgets all sums; the means of the field stay.
    fn forget(&mut self) {
        let now = self.revolution();
        self.validation.forget(now);
        self.before = Sums::default();
        self.instrumental = InstrumentalSums::default();
        self.instrumented = 0;
        self.last.iter_mut().chain([&mut self.present]).for_each(|quarter| quarter.sums = Sums::default());
    }
}

/// Mean of what the quarters have summed up.
fn mean<'a>(
    quarters: impl Iterator<Item = &'a Quarter>,
    sum: impl Fn(&Quarter) -> [f64; MAGNETS],
) -> Option<[f64; MAGNETS]> {
    let (mut samples, mut sums) = (0.0, [0.0; MAGNETS]);
    for quarter in quarters {
        samples += quarter.samples;
        sums.iter_mut().zip(sum(quarter)).for_each(|(sum, value)| *sum += value);
    }
    (samples > 0.0).then(|| sums.map(|sum| sum / samples))
}

/// `φ J⁻¹ φᵀ S⁻¹`: how much an innovation says of the unknowns.
#[inline(always)]
fn leverage(innovation: &Innovation, inverse: &Square) -> f64 {
    let [y, z] = innovation.regression;
    let mut sum = 0.0;
    for j in 0..UNKNOWNS {
        let (mut along_y, mut along_z) = (0.0, 0.0);
        for l in 0..UNKNOWNS {
            along_y += inverse[(j, l)] * y[1 + l];
            along_z += inverse[(j, l)] * z[1 + l];
        }
        sum += innovation.product([y[1 + j], z[1 + j]], [along_y, along_z]);
    }
    sum
}
