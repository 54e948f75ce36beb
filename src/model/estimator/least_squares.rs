//! Weighted least squares of both axes, over all windows remembered (method section 6).
//!
//! The methods `LeastSquares` and `Unbalance` take the test functions of [`crate::model::memory::Bank`] instead of the paper's three:
//! the lowest sines of the window without their mean, combined so that noise is white in them. A window is evaluated 25 times
//! while it moves by its own length, and what it says is remembered with the weight `e^{−γ age}`, `γ = ω_n/(2 ζ)`. In the long
//! run that has the mean age and the noise bandwidth of F(s), but no dead time at the start: F gives the newest data the
//! weight zero, and at 35 ms nearly all data are new.
//!
//! **Noise** of every single sample is followed into the estimate ([`crate::model::memory`]): its bias is taken off, its variance makes
//! `lambda_std`. A σ that is not given is found: σ_z from fourth differences of the positions (no motion of a rotor has them),
//! σ_i from the residual.
//!
//! **Errors of the model** are told from noise by their memory: the residual of a window is compared with that of a window
//! whole revolutions before ([`Estimator`] listens for echoes). The coherent part ρ of the residual adds `P⁻¹ ρ` to the
//! covariance, without averaging. Before enough windows have passed to tell, all that given noise does not explain is taken
//! to be coherent.
//!
//! **Change**: a window whose residual with what was learnt before is more than [`CHANGE_LIMIT`] times what noise explains ends the
//! memory. Nothing is learnt until the windows are clear of the change. As long as there is none, the variance is that of
//! the whole memory; a faster forgetting would pay for the readiness all the time. With 22 rows per window a false alarm is
//! expected with a probability below 1e-9 per window for white rows.
//!
//! The unbalance force is `U ω² (cos(θ + φ), sin(θ + φ))`; the tangential part `U ω̇`, at 500 rpm per second 5e-4 of it,
//! is left out.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::config::{
    CHANGE_LIMIT, CONDITION_LIMIT, EXCITATION_FLOOR, EstimatorInput, EstimatorOutput, Hold, MODEL_STD, Method,
    RESIDUAL_CAP, Reason, STD_CAP, STD_LIMIT, STUCK_SAMPLES,
};
use super::{Estimator, EstimatorState, HOPS_PER_WINDOW, MAGNETS, MAX_SIGNALS, SQUARES};
use crate::model::kernel::Weights;
use crate::model::memory::{Bank, MAX_FUNCTIONS, Memory, Regressors, Sensitivity, Sums, Targets};
use crate::model::regression::{NormalMatrix, NormalVector};
use crate::model::window::{Integrals, Window, dot};

/// Sums of squares of regressors beyond this come from samples that no bearing makes.
const SUM_LIMIT: f64 = 1.0e60;

/// What the discretisation may leave of a motion without noise, relative.
const MODEL_RESIDUAL: f64 = 2.0e-3;

/// Noise found from the residual is reckoned with so many of its own standard deviations higher.
const NOISE_MARGIN: f64 = 0.5;

/// How many of its own standard deviations a correlation of residuals one or more revolutions apart must have to count as
/// an error of the model.
const COHERENCE_LIMIT: f64 = 3.0;

/// Pairs of windows, counted without overlap, that it takes to tell a coherent residual from noise. Before, all of it counts
/// as coherent if the noise is not given, and what the noise does not explain if it is.
const PAIRS_TO_JUDGE: f64 = 1.5;

/// Before so many windows, counted without overlap, too little is left over to show that the model holds.
const WINDOWS_TO_TRUST: f64 = 1.25;

/// How many times more than [`CHANGE_LIMIT`] a window must fit better by itself to end the memory of an uncertain estimate.
const MUCH_BETTER: f64 = 25.0;

/// Residuals of so many windows are kept.
pub(super) const ECHOES: usize = 4 * HOPS_PER_WINDOW;

/// Squares of the coefficients of a fourth difference: its variance for white noise of variance one.
const FOURTH_DIFFERENCE_GAIN: f64 = 70.0;

/// What the methods of least squares have learnt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Learnt {
    pub(super) memory: Memory,
    /// Samples until the window is evaluated again.
    pub(super) until_hop: u64,
    /// Samples until the windows hold none from before a change.
    pub(super) until_clean: u64,
    /// What the last evaluation said.
    pub(super) verdict: Reason,
    /// Scaled unknowns, once the memory has some.
    pub(super) unknowns: Option<NormalVector>,
    pub(super) covariance: NormalMatrix,
    /// What the last windows left unexplained, and how many of them there are.
    pub(super) echoes: Vec<Targets>,
    pub(super) next_echo: usize,
    pub(super) echoed: usize,
    /// `Σ w e(t)·e(t − L)` and the weights, L being whole revolutions that last longer than a window.
    pub(super) coherent: [f64; 2],
    /// The last four positions, newest first, and how many there are.
    pub(super) former: [[f64; 2]; 4],
    pub(super) formers: u32,
    /// Weighted sum of the squares of fourth differences, and of the weights.
    pub(super) roughness: [f64; 2],
    /// The last usable sample.
    pub(super) last_position_m: [f64; 2],
    pub(super) last_current_a: [f64; 3],
    /// For how many samples each position has read the same.
    pub(super) same: [u32; 2],
}

impl Learnt {
    /// Forgets what windows have taught; what is known of the sensors stays.
    fn forget(&mut self) {
        self.memory.clear();
        self.unknowns = None;
        self.covariance = NormalMatrix::zeros();
        self.forget_echoes();
        self.coherent = [0.0; 2];
    }

    /// No window to come is a whole number of hops after those before.
    pub(super) fn forget_echoes(&mut self) {
        self.next_echo = 0;
        self.echoed = 0;
    }

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        self.forget();
        self.until_hop = 0;
        self.until_clean = 0;
        self.verdict = Reason::Filling;
        self.formers = 0;
        self.former = [[0.0; 2]; 4];
        self.roughness = [0.0; 2];
        self.last_position_m = [0.0; 2];
        self.last_current_a = [0.0; 3];
        self.same = [0; 2];
    }
}

impl Estimator {
    /// Follows the roughness of the positions and whether they move at all. True if a sensor is stuck.
    pub(super) fn watch(
        &self,
        learnt: &mut Learnt,
        signals: &[f64; MAX_SIGNALS],
        input: &EstimatorInput,
        window: &Window,
    ) -> bool {
        let former = learnt.former;
        let now = [signals[0], signals[1]];
        if window.filled() == 0 {
            learnt.formers = 0;
        }
        let moved = [0, 1].map(|axis| learnt.last_position_m[axis] != now[axis]);
        let currents = learnt.last_current_a != input.current_a;
        learnt.last_position_m = now;
        learnt.last_current_a = input.current_a;
        for axis in 0..2 {
            let others = moved[1 - axis] || currents;
            learnt.same[axis] = match (moved[axis], others) {
                (true, _) => 0,
                (false, true) => learnt.same[axis].saturating_add(1),
                (false, false) => learnt.same[axis],
            };
        }
        if learnt.formers >= 4 {
            learnt.roughness = learnt.roughness.map(|sum| sum * self.keep_sample);
            for axis in 0..2 {
                let [a, b, c, d] = former.map(|position| position[axis]);
                let difference = (now[axis] + d) - 4.0 * (a + c) + 6.0 * b;
                learnt.roughness[0] += difference * difference;
                learnt.roughness[1] += FOURTH_DIFFERENCE_GAIN;
            }
        }
        learnt.former = [input.position_m, former[0], former[1], former[2]];
        learnt.formers = learnt.formers.saturating_add(1);
        learnt.same.iter().any(|same| *same >= STUCK_SAMPLES)
    }

    /// The rows of the present window, and its sums with the noise in them.
    fn evidence(&self, window: &Window, bank: &Bank, unknowns: &NormalVector) -> (Regressors, Targets, Sums) {
        let mut d = Regressors::zeros();
        let mut n = Targets::zeros();
        let functions = bank.rows.len().min(MAX_FUNCTIONS);
        for (row, weights) in bank.rows.iter().enumerate().take(functions) {
            let integrals = self.integrals(window, weights);
            for (axis, values) in self.row_pair(&integrals).iter().enumerate() {
                let at = axis * functions + row;
                n[at] = integrals.position[axis];
                for (k, value) in values.iter().enumerate() {
                    d[(at, k)] = *value;
                }
            }
        }
        let mut sums = Sums { p: d.tr_mul(&d), h: d.tr_mul(&n), square: n.norm_squared(), ..Sums::default() };
        for k in 0..MAGNETS {
            let newest = window.signal(SQUARES + k).last().copied().unwrap_or(0.0);
            sums.level[k] = (newest * self.reach[k]) * (newest * self.reach[k]);
        }
        let current: [&[f64]; 3] = std::array::from_fn(|k| window.signal(self.sensitivities + k));
        let gap: [&[f64]; 3] = std::array::from_fn(|k| window.signal(self.sensitivities + MAGNETS + k));
        let mut pairs = [[0.0; MAGNETS]; MAGNETS];
        for (j, [zz, zu, uu]) in bank.profile.iter().enumerate() {
            for (k, row) in pairs.iter_mut().enumerate() {
                sums.p_current[k] += uu * current[k][j] * current[k][j];
                sums.h_position[k] += zu * gap[k][j];
                for (l, pair) in row.iter_mut().enumerate().skip(k) {
                    *pair += uu * gap[k][j] * gap[l][j];
                }
            }
            let Sensitivity { stiffness: [s_yy, s_yz, s_zz], current } = self.sensitivity(window, unknowns, j);
            sums.trace[0] += 2.0 * zz - 2.0 * zu * (s_yy + s_zz) + uu * (s_yy * s_yy + 2.0 * s_yz * s_yz + s_zz * s_zz);
            sums.trace[1] += uu * current.iter().map(|gain| gain * gain).sum::<f64>();
        }
        for (k, row) in pairs.iter().enumerate() {
            let scale = self.column_scale[k];
            sums.p_current[k] *= scale * scale;
            sums.h_position[k] *= scale;
            for (l, pair) in row.iter().enumerate().skip(k) {
                let [[sin_k, cos_k], [sin_l, cos_l]] = [self.direction[k], self.direction[l]];
                let along = sin_k * sin_l + cos_k * cos_l;
                let value = scale * self.column_scale[l] * along * along * pair;
                sums.p_position[(k, l)] = value;
                sums.p_position[(l, k)] = value;
            }
        }
        (d, n, sums)
    }

    /// What noise does at a node of the window.
    fn sensitivity(&self, window: &Window, unknowns: &NormalVector, node: usize) -> Sensitivity {
        let mut sensitivity = Sensitivity::default();
        for k in 0..MAGNETS {
            let scale = self.column_scale[k] * unknowns[k];
            let [sin, cos] = self.direction[k];
            let stiffness = scale * window.signal(self.sensitivities + MAGNETS + k)[node];
            sensitivity.stiffness[0] += stiffness * sin * sin;
            sensitivity.stiffness[1] += stiffness * sin * cos;
            sensitivity.stiffness[2] += stiffness * cos * cos;
            sensitivity.current[k] = scale * window.signal(self.sensitivities + k)[node];
        }
        sensitivity
    }

    /// Evaluates the present window by least squares, together with those before. `None` if its numbers cannot be used.
    pub(super) fn evaluate(&self, state: &mut EstimatorState, bank: &Bank, omega_rad_s: f64) -> Option<Reason> {
        let EstimatorState { learnt, output, window, .. } = state;
        // What noise does depends a little on λ; before anything is known the window itself says what it is.
        let plausible = |x: &NormalVector| (0..MAGNETS).all(|k| x[k] > 0.01 && x[k] < 100.0);
        let guess = learnt.unknowns.filter(plausible).unwrap_or(NormalVector::repeat(1.0));
        let (d, n, mut sums) = self.evidence(window, bank, &guess);
        if !sums.is_below(SUM_LIMIT) {
            return None;
        }
        let raw = self.solve(&sums.p, &sums.h).unknowns;
        if let Some(raw) = raw {
            output.lambda_raw = self.lambda([raw[0], raw[1], raw[2]]);
            if learnt.unknowns.is_none() && plausible(&raw) {
                sums = self.evidence(window, bank, &raw).2;
            }
        }
        // What was learnt while something was wrong is of no use once a window fits by itself so much better.
        let better = match learnt.verdict {
            Reason::Singular | Reason::NotPositive => CHANGE_LIMIT,
            // A lasting error of the model makes single windows fit better too, but not that much.
            Reason::Uncertain => MUCH_BETTER * CHANGE_LIMIT,
            _ => f64::INFINITY,
        };
        if better.is_finite() && learnt.memory.weight[0] > 0.0 {
            let [position, current] = output.noise.map(|noise| noise * noise);
            let noise = position * sums.trace[0] + current * sums.trace[1];
            let own = raw.filter(plausible).map_or(f64::INFINITY, |raw| sums.rest(&raw));
            if better * own < noise && noise > MODEL_RESIDUAL * MODEL_RESIDUAL * sums.square {
                learnt.forget();
            }
        }
        if self.contradicts(learnt, output, (&d, &n, &sums)) {
            learnt.forget();
            learnt.until_clean = self.intervals as u64;
        }
        if learnt.until_clean > 0 {
            self.doubt(output);
            return Some(Reason::Changed);
        }
        let guess = learnt.unknowns.or(raw).filter(plausible).unwrap_or(guess);
        let sensitivity = |j: usize| self.sensitivity(window, &guess, j);
        learnt.memory.add(bank, (&d, &sums), sensitivity, (self.hop, self.keep), &self.direction);
        if let Some(x) = learnt.unknowns.or(raw) {
            self.listen(learnt, &(n - d * x), omega_rad_s);
        }
        let verdict = self.conclude(learnt, output, bank.rows.len());
        if verdict == Reason::Valid {
            if let Some(unknowns) = learnt.unknowns {
                output.lambda_hat = self.lambda([unknowns[0], unknowns[1], unknowns[2]]);
                self.report(output, &self.integrals(window, &self.static_load), &unknowns);
            }
        } else {
            self.doubt(output);
        }
        Some(verdict)
    }

    /// Whether the window is at odds with what was learnt before.
    fn contradicts(
        &self,
        learnt: &Learnt,
        output: &mut EstimatorOutput,
        (d, n, sums): (&Regressors, &Targets, &Sums),
    ) -> bool {
        let Some(x) = learnt.unknowns else { return false };
        let [position, current] = output.noise.map(|noise| noise * noise);
        let noise = position * sums.trace[0] + current * sums.trace[1];
        let uncertain = (sums.p * learnt.covariance).trace();
        let model = MODEL_RESIDUAL * MODEL_RESIDUAL * sums.square;
        output.surprise = ((n - d * x).norm_squared() / (noise + uncertain + model)).min(RESIDUAL_CAP);
        output.surprise.is_nan() || output.surprise > CHANGE_LIMIT
    }

    /// Compares what is left unexplained with what was left whole revolutions ago: noise has no memory, while what the model
    /// lacks comes back.
    fn listen(&self, learnt: &mut Learnt, left: &Targets, omega_rad_s: f64) {
        let window = self.intervals as f64;
        let hop = self.hop as f64;
        let revolution = TAU / (omega_rad_s.abs() * self.config.step_s);
        // Windows that far apart have no sample in common.
        let apart = (window / hop).ceil();
        let whole = ((window / revolution - 1e-3).ceil() * revolution / hop).round().max(apart);
        let lag = if whole < ECHOES as f64 { whole as usize } else { apart as usize };
        let keep = self.keep;
        learnt.coherent = learnt.coherent.map(|sum| sum * keep);
        if (1..ECHOES).contains(&lag) && learnt.echoed >= lag {
            let former = learnt.echoes[(learnt.next_echo + ECHOES - lag) % ECHOES];
            learnt.coherent[0] += left.dot(&former);
            learnt.coherent[1] += 1.0;
        }
        learnt.echoes[learnt.next_echo] = *left;
        learnt.next_echo = (learnt.next_echo + 1) % ECHOES;
        learnt.echoed = (learnt.echoed + 1).min(ECHOES);
    }

    /// Solves the normal equations of the memory, with the noise that it finds in them.
    fn conclude(&self, learnt: &mut Learnt, output: &mut EstimatorOutput, functions: usize) -> Reason {
        let memory = &learnt.memory;
        let sums = &memory.sums;
        let excited = (0..MAGNETS).all(|k| sums.p[(k, k)] > EXCITATION_FLOOR * EXCITATION_FLOOR * sums.level[k]);
        let given = [self.config.position_noise_m, self.config.current_noise_a].map(|noise| noise * noise);
        let [rough, weight] = learnt.roughness;
        let smooth = if weight > 0.0 { rough / weight } else { 0.0 };
        let mut variance = output.noise.map(|noise| noise * noise);
        variance[0] = if given[0] > 0.0 { given[0] } else { variance[0].min(smooth) };
        let mut solution = self.solve(&sums.p, &sums.h);
        output.condition = solution.condition;
        // As many independent rows as there are in windows that do not overlap, and how far their sum of squares scatters.
        let [weight, weight2] = memory.weight;
        let windows = 1.0 + (weight * weight / weight2 - 1.0) * self.hop as f64 / self.intervals as f64;
        let freedom = (2.0 * functions as f64 * windows - self.unknowns as f64).max(1.0);
        let scatter = (2.0 / freedom).sqrt();
        let mut compensate = variance;
        // The noise follows from the residual, the compensation from the noise; two rounds settle it.
        for _ in 0..3 {
            let (Some(x), Some(inverse)) = (solution.unknowns, solution.inverse) else { break };
            let rest = sums.rest(&x);
            let left: [f64; 2] =
                std::array::from_fn(|s| (sums.trace[s] - (inverse * memory.score[s]).trace()).max(0.1 * sums.trace[s]));
            if given[0] == 0.0 {
                variance[0] = smooth.min(rest / left[0]);
            }
            // What noise does not explain counts as noise of the currents, whatever it is.
            let unexplained = ((rest - variance[0] * left[0]) / left[1]).max(0.0);
            compensate = [variance[0], if given[1] > 0.0 { given[1] } else { unexplained }];
            let chance = scatter * rest / left[1];
            variance[1] = if given[1] > 0.0 && unexplained < given[1] + chance {
                given[1]
            } else if given[1] > 0.0 {
                unexplained
            } else {
                // The less is known of the noise, the more of it is reckoned with.
                unexplained + NOISE_MARGIN * chance
            };
            let (p, h) = sums.compensated(compensate);
            solution = self.solve(&p, &h);
        }
        let (Some(x), Some(inverse)) = (solution.unknowns, solution.inverse) else {
            return Reason::Singular;
        };
        if !variance.iter().chain(&compensate).all(|v| v.is_finite()) {
            return Reason::Singular;
        }
        output.noise = variance.map(f64::sqrt);
        output.condition = output.condition.max(solution.condition);
        output.residual = if sums.square > 0.0 { (sums.rest(&x) / sums.square).sqrt().min(RESIDUAL_CAP) } else { 1.0 };
        if !excited || output.condition > CONDITION_LIMIT {
            return Reason::Singular;
        }
        if !(0..MAGNETS).all(|k| x[k] > 0.0) {
            return Reason::NotPositive;
        }
        let score = memory.score[0] * variance[0] + memory.score[1] * variance[1];
        let covariance = inverse * score * inverse;
        if !covariance.iter().all(|c| c.is_finite()) {
            return Reason::Singular;
        }
        // Part of the residual that is no noise, brought to the windows of the memory.
        let rest = sums.rest(&x);
        let [echo, pairs] = learnt.coherent;
        let pairs_of_windows = pairs * self.hop as f64 / self.intervals as f64;
        let coherent = if pairs_of_windows >= PAIRS_TO_JUDGE {
            let echo = echo * weight / pairs;
            let chance = rest / (2.0 * functions as f64 * pairs_of_windows).sqrt();
            if echo > COHERENCE_LIMIT * chance { echo } else { 0.0 }
        } else if given[1] == 0.0 || windows < WINDOWS_TO_TRUST {
            rest
        } else if variance[1] > given[1] {
            rest * (1.0 - given[1] / variance[1])
        } else {
            0.0
        };
        let mut sure = true;
        for k in 0..MAGNETS {
            let model = MODEL_STD * x[k];
            let model_error = inverse[(k, k)].max(0.0) * coherent;
            let std = (covariance[(k, k)].max(0.0) + model_error + model * model).sqrt();
            output.lambda_std[k] = self.config.lambda0_nm2_a2[k] * std.min(STD_CAP);
            sure &= std <= STD_LIMIT * x[k];
        }
        learnt.unknowns = Some(x);
        learnt.covariance = covariance;
        if sure { Reason::Valid } else { Reason::Uncertain }
    }

    /// While the estimate is not valid, its standard deviation covers how far the present window is from it.
    fn doubt(&self, output: &mut EstimatorOutput) {
        for k in 0..MAGNETS {
            let off = (output.lambda_raw[k] - output.lambda_hat[k]).abs();
            let cap = STD_CAP * self.config.lambda0_nm2_a2[k];
            output.lambda_std[k] = output.lambda_std[k].max(off).min(cap);
        }
    }

    /// The integrals of one test function over the present window.
    fn integrals(&self, window: &Window, weights: &Weights) -> Integrals {
        let node = |signal| dot(&weights.node, window.signal(signal));
        Integrals {
            position: std::array::from_fn(|axis| dot(&weights.position, window.signal(axis))),
            squares: std::array::from_fn(|k| match self.config.hold {
                Hold::Linear => node(SQUARES + k),
                Hold::HeldBefore | Hold::HeldAfter => {
                    dot(&weights.held_start, window.signal(SQUARES + k))
                        + dot(&weights.held_end, window.signal(SQUARES + MAGNETS + k))
                }
            }),
            rotating: match self.config.method {
                Method::Unbalance => [node(self.sensitivities - 2), node(self.sensitivities - 1)],
                _ => [0.0; 2],
            },
        }
    }
}
