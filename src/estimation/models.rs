//! Models run in parallel and compared by their evidence: how fast the unknowns change, and whether there is a backward force.
//!
//! Discount models (M. West, J. Harrison, *Bayesian Forecasting and Dynamic Models*, 2nd ed., sections 6.3 and 12.2): for each block of samples a
//! model multiplies its information by `exp(−t/τ)`, so that the unknowns may change, or lets the loads follow a random walk, which preserves the
//! information on λ. Its evidence is the likelihood of each block given the blocks before. A model clearly likelier than the one without change is
//! selected, and the total variance includes that of the mixture.

use std::ops::Range;

use libm::{exp, log, sqrt};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::STD_LIMIT;
use super::motion::Square;
use super::sums::{PredictionErrorSolution, Prior, Solution, Sums};
use crate::bearing::array;
use crate::variables::Array;

/// Blocks of samples in a revolution: a change is detected within half of one.
pub const QUARTERS: usize = 4;

/// The models of change: memory τ, s, from a constant bearing down to less than a block at 3000 rpm, and random walk of the loads as acceleration of the
/// rotor, m/s² per √s; 0.03 corresponds to 0.2 N in a second for 6.7 kg. Without walks ± of λ after a load ramp of 1 N/s is 1.3 instead of 0.4 %, and at 10 N/s the
/// estimate is valid 55 instead of 100 % of the time (`montecarlo --only "hostile: load ramp" --runs 40 --seed 1200001`, noise known). The strongest walk
/// is for axes, whose load along their only direction moves faster: at 30 N/s they are valid 100 instead of 79 % of the time (noise estimated). Models with a
/// walk also forget λ, or its drift would be taken for one of the load; without a model of 0.03 s that has none it is, by up to 14 standard deviations.
const CHANGES: [[f64; 2]; 9] = [
    [f64::INFINITY, 0.0],
    [0.5, 0.01],
    [0.5, 0.03],
    [0.3, 0.0],
    [0.1, 0.0],
    [0.1, 0.1],
    [0.03, 0.0],
    [0.03, 0.3],
    [0.003, 0.0],
];

/// Prior log odds of a model of change against the one without. With −4, 4 of 80 spindles with drifting λ exceeded 5 standard deviations, with −3.5 2,
/// with −3 2 but λ took longer to settle after a step (seeds 730001 to 730040).
const PRIOR_LOG_ODDS: f64 = -3.5;

/// Log odds with which the sums of a shorter memory replace those of a longer one: a wrong model is that far ahead with a probability below e⁻¹²
/// (Markov's inequality).
const REPLACING_LOG_ODDS: f64 = 12.0;

/// A model whose variance of unit weight exceeds that of the present innovations by this many standard deviations (F-test) contains samples that no λ
/// explains, and is replaced. Without this 20 of 160 runs were valid but off by more than 5 standard deviations after a blow on the rotor, with a limit
/// of 5 it was 4, with 4 none (test `blows_are_forgotten`).
const UNEXPLAINED_LIMIT: f64 = 4.0;

/// Time constant, s, of the mean about which the scatter of changing estimates is taken. A force at nearly the frequency of the motion beats with it, and λ
/// seems to oscillate: half a second covers beats of 1 Hz and more; a drift of λ by 2 %/s gives a scatter of 1 %. Without this scatter 13 instead of 3 of 40
/// runs with a path of 43 Hz and late currents exceeded 5 standard deviations, and in all 17 instead of 4 of 3440 (noise known, seeds 1300001 to 1300040).
const SCATTER_S: f64 = 0.5;

/// Exponent of the weights of the models of change in the variance of the mixture, for the reason given at `FORCE_TEMPER`. With 1, 43 of 320 axes with
/// drifting λ exceeded 5 standard deviations, with 0.75 21, with 0.7 16, with 0.65 14 (noise estimated, seeds 1300001 to 1300160, 3200001 to 3200160). The
/// ratio of rms error to total standard deviation of drawn bearings is then 0.75, 0.72, 0.70 and 0.69 after 1 s (noise known, seeds 745001 to 745200).
const CHANGE_TEMPER: f64 = 0.7;

/// The models of a backward force: none, or Gaussian with these fractions of its tolerance, from a tenth of a newton to a few newtons. The bearings of a
/// shaft have models of their own: with one for both, the force of one pays for the unknowns of both, and 0.3 N in one bearing were taken for λ, up to 9
/// deviations off in 6 of 12 runs of another simulator (four magnets, controller with λ wrong by two).
const FORCE_FRACTIONS: [f64; 4] = [0.0, 0.05, 0.3, 1.0];
const FORCE_MODELS: usize = FORCE_FRACTIONS.len() * FORCE_FRACTIONS.len();

/// Probability of a force above which it enters the model, and below which it leaves it. With 0.99 instead of 0.9999 a force was identified in two of 400
/// drawn bearings without one, with errors of λ of 7 to 11 bounds (seeds 740001 to 740200); runs with a force do not differ.
const FORCE_LIMITS: [f64; 2] = [0.9999, 0.50];

/// Exponent of the weights in the spread of the models of the force, so that the stated variance covers less likely models as well. With 1, 4 of 120 runs
/// with 0.1 and 0.3 N were off by 5 to 12 standard deviations (`montecarlo --only backward --seed 97301`), with 0.5 none.
const FORCE_TEMPER: f64 = 0.5;

/// A tolerance of backward forces is multiplied by this factor where the data contradict it: where they are more probable, with very strong evidence, with
/// a force that much greater (prior predictive check, Box 1980). It is divided by the factor again once they are not: outliers look like a great force
/// for a while. With the tolerance of 2 N alone, 31 of 40 runs of a rotor of 100 kg under 25 N were off by up to 9 standard deviations (noise estimated,
/// seeds 2200101 to 2200140).
const WIDER: f64 = 10.0;

/// Very strong evidence, as a difference of log-likelihoods (Kass and Raftery 1995).
pub const VERY_STRONG: f64 = 5.0;

/// Greatest number of unknowns of backward forces.
const FORCES: usize = 4;

/// Prior precision, 1/N², that fixes a force at its mean.
const FIXED: f64 = 1.0e12;

/// Prior precisions, 1/N², in a model of that many unknowns, two for each bearing, from the precision with the tolerance.
fn precisions(model: usize, unknowns: usize, precision: f64) -> [f64; FORCES] {
    let count = FORCE_FRACTIONS.len();
    let of = if unknowns == FORCES { [model % count, model / count] } else { [model % count; 2] };
    array::from_fn(|n| {
        let fraction = FORCE_FRACTIONS[of[n / 2]];
        (precision / (fraction * fraction)).min(FIXED)
    })
}

/// Result of comparing the models.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Comparison {
    /// The selected model continues.
    Same,
    /// Other sums are selected now.
    Renewed,
    /// Earlier information is invalid.
    Changed,
}

/// Running statistics of the estimates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct RecentEstimates<const U: usize> {
    /// Means of the estimates and of their variances due to noise.
    mean: SVector<f64, U>,
    variance: SVector<f64, U>,
    /// Mean weight of these estimates.
    weight: f64,
    /// Mean square distance of the estimates from their mean in excess of these variances.
    scatter: SVector<f64, U>,
}

impl<const U: usize> RecentEstimates<U> {
    /// Adds estimates with their variances due to noise and a weight from 0 to 1; `forgetting` is the forgetting factor of the means.
    fn add(
        &mut self,
        unknowns: &SVector<f64, U>,
        noise: &SVector<f64, U>,
        weight: f64,
        changing: bool,
        forgetting: f64,
    ) {
        let gain = 1.0 - forgetting;
        let before = self.weight;
        self.weight += (weight - before) * gain;
        let share = gain * weight / self.weight.max(f64::MIN_POSITIVE);
        for j in 0..U {
            let distance = unknowns[j] - self.mean[j];
            if changing {
                let excess = (distance * distance - self.variance[j] - noise[j]).max(0.0);
                self.scatter[j] = (self.scatter[j] + excess * before * gain) * forgetting;
            }
            self.mean[j] += distance * share;
            self.variance[j] += (noise[j] - self.variance[j]) * share;
        }
    }
}

/// The models of change, each with its sums, and the models of the backward force.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Models<const K: usize, const U: usize, const T: usize> {
    /// Boxed one by one: the threads of importers have small stacks.
    sums: Array<Box<Sums<K, U, T>>, { CHANGES.len() }>,
    /// Log evidence, relative to the greatest.
    evidence: [f64; CHANGES.len()],
    selected: usize,
    /// Variance due to the other models.
    spread: SVector<f64, U>,
    /// Whether unknowns have changed, and statistics of the estimates.
    changing: bool,
    recent: Option<RecentEstimates<U>>,
    /// Factor on the tolerance of backward forces, and their selected model ([`precisions`]).
    force_scale: f64,
    force: usize,
    /// Log odds of the models of the forces against none from the sums, and from samples forgotten by these: a change of λ does not change the force.
    force_log_odds: [f64; FORCE_MODELS],
    retained_log_odds: [f64; FORCE_MODELS],
    /// Successive solutions with a probable force.
    force_solutions: u32,
    /// Successive blocks with a force in the model.
    force_blocks: u64,
}

impl<const K: usize, const U: usize, const T: usize> Models<K, U, T> {
    pub fn start() -> Self {
        let sums = Array(std::array::from_fn(|_| Box::new(Sums::zeros())));
        Self {
            sums,
            evidence: [0.0; CHANGES.len()],
            selected: 0,
            spread: SVector::zeros(),
            changing: false,
            recent: None,
            force_scale: 1.0,
            force: 0,
            force_log_odds: [0.0; FORCE_MODELS],
            retained_log_odds: [0.0; FORCE_MODELS],
            force_solutions: 0,
            force_blocks: 0,
        }
    }

    /// Whether the indices of the selected models are valid.
    pub fn has_shape(&self) -> bool {
        self.selected < CHANGES.len() && self.force < FORCE_MODELS
    }

    /// Discards the sums, without allocation.
    pub fn restart(&mut self) {
        self.sums.iter_mut().for_each(|sums| **sums = Sums::zeros());
        (self.evidence, self.selected, self.spread, self.force_blocks) = ([0.0; CHANGES.len()], 0, SVector::zeros(), 0);
        (self.changing, self.recent) = (false, None);
    }

    /// Whether the model of the backward force has been selected long enough for λ to be trusted: without replacement of sums for two revolutions, within
    /// which the tests of spectral lines detect other disturbances that resemble such a force. Without this 6 of 120 runs with 0.5 N in a narrow band at
    /// 140 Hz, 1 N at twice the speed and an encoder with an eccentricity of 1 % were off by up to 11 standard deviations, with it 2 (seeds 984001 to 984040).
    pub fn is_confirmed(&self) -> bool {
        self.force == 0 || self.force_blocks >= 2 * QUARTERS as u64
    }

    /// The sums of the selected model.
    pub fn sums(&self) -> &Sums<K, U, T> {
        &self.sums[self.selected]
    }

    /// The forgetting factor of the selected model over a time.
    pub fn forgetting_factor(&self, time_s: f64) -> f64 {
        exp(-time_s / CHANGES[self.selected][0])
    }

    /// Multiplies the sums of all models by a weight.
    pub fn discount(&mut self, weight: f64) {
        self.sums.iter_mut().for_each(|sums| sums.discount(weight));
    }

    /// Adds a block without comparing the models.
    pub fn merge(&mut self, block: &Sums<K, U, T>) {
        self.sums.iter_mut().for_each(|sums| sums.merge(block));
    }

    /// Adds a block of a duration and compares the models, given the present normalised innovation squared and its degrees of freedom, the number of
    /// blocks so far, and the loads that accelerate a position by 1 m/s².
    pub fn compare<const N: usize>(
        &mut self,
        (block, time_s): (&Sums<K, U, T>, f64),
        prior: &Prior<U>,
        position_variance: f64,
        [nis, degrees]: [f64; 2],
        blocks: u64,
        unit_loads: &SVector<f64, N>,
    ) -> Comparison {
        let former = self.selected;
        let forgotten = 1.0 - self.forgetting_factor(time_s);
        // A level of 0.03 over all blocks so far (Bonferroni); without it 4 of 8 runs of 100 s restarted (`unbalanced`, seeds 90001 to 90004).
        let limit = UNEXPLAINED_LIMIT.max(sqrt(2.0 * log(blocks as f64 / 0.03)));
        let mut unexplained = [false; CHANGES.len()];
        for (m, sums) in self.sums.iter_mut().enumerate() {
            let [memory_s, walk] = CHANGES[m];
            sums.discount(exp(-time_s / memory_s));
            if walk > 0.0 {
                let std = unit_loads * walk;
                sums.walk(&(std.component_mul(&std) * (time_s / position_variance)));
            }
            let before = sums.evidence(prior, position_variance);
            sums.merge(block);
            let Some([after, residuals]) = sums.evidence(prior, position_variance) else { continue };
            let gain = before.map_or(0.0, |[before, _]| after - before);
            // Evidence has a memory of 64 blocks, 16 revolutions.
            self.evidence[m] = (self.evidence[m] + gain) * (1.0 - 1.0 / 64.0);
            let dof = sums.degrees::<N>();
            // At least 0.5: the noise estimate decreases slowly after a disturbance.
            unexplained[m] = residuals / dof > nis.max(0.5) * (1.0 + limit * sqrt(2.0 / dof + 2.0 / degrees));
        }
        let last = CHANGES.len() - 1;
        // Ramps and drifts are explained by a model with some memory. When they counted as changes, an axis with a load ramp of 10 N/s was valid 53 instead
        // of 97 % of the time (`montecarlo --only "hostile: axial, load" --runs 40 --seed 3120001`, noise known).
        let is_behind = |m: usize| self.evidence[last] - self.evidence[m] > REPLACING_LOG_ODDS;
        let changed = unexplained[0] || (0..last).all(is_behind);
        let mut renewed = false;
        for m in (0..last).rev() {
            if unexplained[m] || self.evidence[m + 1] - self.evidence[m] > REPLACING_LOG_ODDS {
                renewed = true;
                let (to, from) = self.sums.split_at_mut(m + 1);
                to[m].clone_from(&from[0]);
                self.evidence[m] = self.evidence[m + 1];
            }
        }
        let most = self.evidence.into_iter().fold(f64::NEG_INFINITY, f64::max);
        // Bounded, so that a model can recover within the memory of the evidence.
        self.evidence = self.evidence.map(|evidence| (evidence - most).max(-20.0));
        let log_odds = self.log_odds();
        let likeliest = (0..=last).fold(0, |best, m| if log_odds[m] > log_odds[best] { m } else { best });
        // A smaller margin would let two models alternate.
        if log_odds[likeliest] > log_odds[self.selected] + 1.0 {
            self.selected = likeliest;
        }
        let comparison = match changed {
            true => Comparison::Changed,
            false if renewed || self.selected != former => Comparison::Renewed,
            false => Comparison::Same,
        };
        self.changing |= renewed || self.selected > 0;
        if changed {
            (self.changing, self.recent) = (false, None);
        }
        let continues = self.force > 0 && comparison == Comparison::Same;
        self.force_blocks = if continues { self.force_blocks + 1 } else { 0 };
        let forgotten = if renewed { 1.0 } else { forgotten };
        for (retained, log_odds) in self.retained_log_odds.iter_mut().zip(self.force_log_odds) {
            // Bounded, because a force may begin.
            *retained = (*retained + forgotten * log_odds).clamp(-4.0, 4.0);
        }
        comparison
    }

    /// Log odds of the models.
    fn log_odds(&self) -> [f64; CHANGES.len()] {
        array::from_fn(|m| self.evidence[m] + if m > 0 { PRIOR_LOG_ODDS } else { 0.0 })
    }

    /// Computes the variance of the mixture in excess of that of the selected model, at the end of a block of a duration. If unknowns change it includes
    /// their scatter: the data do not distinguish an oscillating λ from a force that beats with the motion, in which case the mean is right.
    pub fn mix(&mut self, prior: &Prior<U>, variances: [f64; 2], time_s: f64) {
        self.spread = SVector::zeros();
        let Some(selected) = self.sums[self.selected].solve(prior, variances) else { return };
        let log_odds = self.log_odds();
        let most = log_odds.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let tempered = log_odds.map(|log_odds| exp(CHANGE_TEMPER * (log_odds - most)));
        let sum: f64 = tempered.iter().sum();
        for (sums, weight) in self.sums.iter().zip(tempered) {
            let Some(other) = sums.solve(prior, variances) else { continue };
            let distance = other.unknowns - selected.unknowns;
            let excess = (other.inverse.diagonal() - selected.inverse.diagonal()) * variances[0];
            self.spread += (distance.component_mul(&distance) + excess) * (weight / sum);
        }
        let noise = selected.inverse.diagonal() * variances[0];
        // Estimates too uncertain to be valid hardly count, nor does a distance from a mean of such: after a step of the load by 20 N within 10 ms, the first
        // of them left ± of 50 % for more than a second.
        let relative = (0..K).map(|k| noise[k] / (selected.unknowns[k] * selected.unknowns[k])).fold(0.0, f64::max);
        let weight = 1.0 / (1.0 + relative / (STD_LIMIT * STD_LIMIT));
        let start = || RecentEstimates { mean: selected.unknowns, variance: noise, weight, scatter: SVector::zeros() };
        let recent = self.recent.get_or_insert_with(start);
        recent.add(&selected.unknowns, &noise, weight, self.changing, exp(-time_s / SCATTER_S));
        self.spread = self.spread.map(|x| x.max(0.0)) + recent.scatter;
    }

    /// The prior with the widest one of the backward forces, from that with their tolerance.
    pub fn widest(&self, stated: &Prior<U>) -> Prior<U> {
        let mut prior = stated.clone();
        prior.forces.clone().for_each(|j| prior.precision[j] /= self.force_scale * self.force_scale);
        prior
    }

    /// The prior of the unknowns in the selected model, from that with the widest prior of the backward forces.
    pub fn prior(&self, widest: &Prior<U>) -> Prior<U> {
        let mut prior = widest.clone();
        for (n, j) in widest.forces.clone().enumerate() {
            prior.precision[j] = precisions(self.force, widest.forces.len(), prior.precision[j])[n];
        }
        prior
    }

    /// Selects the model of the backward force and returns the variance due to all other models, of the force or of change, whichever is greater: the weights
    /// are tempered as if one unlikely model were the right one. With implausible noise no force is identified.
    ///
    /// The solution with the widest prior R of the force gives the information in the data, Λ and Λz: with the posterior precision P⁻¹ and mean F,
    /// `Λ = P⁻¹ − R` and `Λz = P⁻¹ F`. A bias of λ due to current noise, of unit variance along b, biases the force as well: with `u = P⁻¹ b` it
    /// reduces Λ by `u uᵀ/(1 + uᵀ Λ⁻¹ u)`. A model with the variances S, a diagonal matrix, has the posterior covariance `P_S = (Λ + S⁻¹)⁻¹`, the mean
    /// `F_S = P_S Λz` and the evidence `½ (Λz)ᵀ F_S + ½ ln det (P_S S⁻¹)`.
    pub fn select(
        &mut self,
        found: &PredictionErrorSolution<'_, K, U, T>,
        combined: &Solution<U, T>,
        is_plausible: bool,
    ) -> Option<SVector<f64, U>> {
        let (Prior { precision, forces, .. }, variance) = (found.prior, found.position_variance);
        if forces.is_empty() || precision[forces.start] >= FIXED {
            return Some(self.spread);
        }
        let at = |n: usize| Some(forces.start + n).filter(|j| forces.contains(j));
        let precision = precision[forces.start];
        // Unused places get the prior alone, which makes no difference.
        let covariance = SMatrix::<f64, FORCES, FORCES>::from_fn(|r, c| match (at(r), at(c)) {
            (Some(r), Some(c)) => found.inverse[(r, c)] * variance,
            _ => f64::from(r == c) / precision,
        });
        let forces_of =
            |unknowns: &SVector<f64, U>| SVector::<f64, FORCES>::from_fn(|n, _| at(n).map_or(0.0, |j| unknowns[j]));
        let posterior = covariance.try_inverse()?;
        let mut data = posterior - Square::identity() * precision;
        let mut right = posterior * forces_of(&combined.unknowns);
        let biased = posterior * forces_of(&combined.bias);
        // A millionth of the prior keeps the matrix regular if the data contain no information on a force.
        let by_bias = (data + Square::identity() * (1.0e-6 * precision)).try_inverse()? * biased;
        let reduction = biased / (1.0 + biased.dot(&by_bias));
        right -= reduction * by_bias.dot(&right);
        data -= reduction * biased.transpose();
        let count = if forces.len() == FORCES { FORCE_MODELS } else { FORCE_FRACTIONS.len() };
        let mut models = [(f64::NEG_INFINITY, SVector::zeros(), SMatrix::zeros()); FORCE_MODELS];
        models[0].0 = 0.0;
        let compared = |m: usize, precision: f64| {
            let own = Square::from_diagonal(&precisions(m, forces.len(), precision).into());
            let covariance = (data + own).try_inverse()?;
            let mean = covariance * right;
            let volume = (covariance * own).determinant();
            Some((0.5 * (right.dot(&mean) + log(volume)), mean, covariance))
        };
        for (m, model) in models[..count].iter_mut().enumerate().skip(1) {
            *model = compared(m, precision)?;
        }
        let scaled = |factor: f64| Some(compared(count - 1, precision / (factor * factor))?.0 - models[count - 1].0);
        if scaled(WIDER)? > VERY_STRONG {
            self.force_scale *= WIDER;
        } else if self.force_scale > 1.0 && scaled(1.0 / WIDER)? > 0.0 {
            self.force_scale /= WIDER;
        }
        for (m, model) in models[..count].iter_mut().enumerate() {
            self.force_log_odds[m] = model.0;
            model.0 += self.retained_log_odds[m] - if m > 0 { log((count - 1) as f64) } else { 0.0 };
        }
        let most = models.iter().fold(f64::NEG_INFINITY, |most, model| most.max(model.0));
        let sum: f64 = models.iter().map(|model| exp(model.0 - most)).sum();
        let probability = 1.0 - exp(models[0].0 - most) / sum;
        let likeliest = (1..count).max_by(|a, b| models[*a].0.total_cmp(&models[*b].0)).unwrap_or(1);
        let likely = is_plausible && probability > FORCE_LIMITS[usize::from(self.force > 0)];
        self.force_solutions = if likely { self.force_solutions.saturating_add(1) } else { 0 };
        self.force = match likely {
            // A transient that no model explains resembles a force for a quarter (`coil-loss`).
            true if self.force_solutions >= 4 => likeliest,
            true => self.force,
            false => 0,
        };
        let selected = self.force;
        let tempered = models.map(|model| exp(FORCE_TEMPER * (model.0 - most)));
        let sum: f64 = tempered.iter().sum();
        let mut spread = -models[selected].2;
        for ((_, mean, covariance), weight) in models.iter().zip(tempered).take(count) {
            let distance = mean - models[selected].1;
            spread += (covariance + distance * distance.transpose()) * (weight / sum);
        }
        let by_force = SVector::from_fn(|j, _| {
            let row =
                SMatrix::<f64, 1, FORCES>::from_fn(|_, n| at(n).map_or(0.0, |f| found.inverse[(j, f)] * variance));
            let gain = row * posterior;
            (gain * spread * gain.transpose())[0].max(0.0)
        });
        Some(self.spread.zip_map(&by_force, f64::max))
    }
}

/// A first guess of λ may be wrong by this factor.
pub const WRONG_BY: f64 = 10.0;

/// The prior: standard deviation of [`WRONG_BY`] times the first guess for each λ, which may be that much larger, and `std_n` in N for the unknowns of
/// backward forces; 0 means there are none.
pub fn prior<const K: usize, const U: usize>(lambda0: [f64; K], forces: Range<usize>, std_n: f64) -> Prior<U> {
    let mut prior = Prior { precision: SVector::zeros(), mean: SVector::zeros(), forces };
    for (k, lambda0) in lambda0.into_iter().enumerate() {
        prior.precision[k] = 1.0 / (WRONG_BY * lambda0 * (WRONG_BY * lambda0));
        prior.mean[k] = lambda0;
    }
    for j in prior.forces.clone() {
        prior.precision[j] = (1.0 / (std_n * std_n)).min(FIXED);
    }
    prior
}
