//! Maximum-likelihood estimates of the noise, with a tight prior if it is known.
//!
//! Unknown position noise is first estimated from differences of the positions. Then the innovations determine both noises: with their covariance
//! `σ_z² S(ρ)`, `ρ = σ_i²/σ_z²`, the log likelihood of an innovation is `−½ (eᵀ S⁻¹ e/σ_z² + ln det S + 2 ln σ_z²)`, and the recursive Gauss–Newton
//! method (Ljung, section 11.4) maximises it over `(ln ρ, ln σ_z²)`.

use libm::{exp, log, sqrt};
use nalgebra::{Matrix2, SVector, Vector2};
use serde::{Deserialize, Serialize};

use super::angle::Rotation;
use super::innovations::{Innovation, MAX_BRIDGED, Sample};
use crate::bearing::array;

/// Samples whose differences give the initial estimate, which is accurate to about a tenth.
const START_SAMPLES: usize = 64;

/// Greatest usual standard deviation of the noise of a current sensor, A; the smallest is a tenth of it.
pub const USUAL_CURRENT_NOISE_A: f64 = 5.0e-2;

/// The levels of current noise are for currents of up to this rms value, A, and in proportion beyond, as the ranges of current sensors are: with 5 to 10 A
/// and 80 mA of noise no backward force was identified (noise estimated, rotor of 100 kg).
const USUAL_CURRENT_A: f64 = 2.5;

/// Factor on the levels of current noise, for the mean square of the currents, A².
pub fn current_range(mean_square_a2: f64) -> f64 {
    (sqrt(mean_square_a2) / USUAL_CURRENT_A).max(1.0)
}

/// Initial standard deviation of the noise of a current, A: the geometric mean of the usual range. From below, where the data contain little information on
/// this noise, the search is slow, and meanwhile the stated standard deviation of λ is too small.
pub const START_CURRENT_NOISE_A: f64 = 1.5e-2;

/// Smallest and greatest standard deviation of a position, relative to the gap: smaller ones are rounding, greater ones hide the clearance.
const POSITION_NOISE: [f64; 2] = [2.0e-6, 0.06];

/// Greatest standard deviations for which the estimate is reliable, of a position relative to the gap, and of a current in A: one and a half times those
/// of the study of fourteen pairs of noise (`montecarlo --only "14 pairs"`).
const RELIABLE_UP_TO: [f64; 2] = [0.015, 0.15];

/// Prior information on ln σ² of known noise, 2 % of σ as after 1200 samples of one reading, and of estimated noise, so that the first samples have
/// little effect. The information of samples on ln ρ grows with ρ² and is below 1 at first: with 2 instead of 1 a search that started a factor of three too
/// low took 0.1 s (drawn bearings, seed 56183).
const KNOWN: f64 = 600.0;
const ESTIMATED: f64 = 1.0;

/// Innovations with a greater normalised square are outliers, and their weight reduces it to this value. Noise exceeds it once in 10¹³ samples (χ² with two
/// degrees of freedom).
pub const OUTLIER: f64 = 60.0;

/// Change of ln ρ that makes the weights of earlier samples wrong by a factor of two, and the factor by which these are then multiplied. With a factor of
/// 0.3 the stated standard deviation of the nominal bearing at 0.1 s is 1.4 times the bound instead of 1.2. Without any, 188 instead of 191 of 196
/// drawn bearings are valid at 0.1 s, and 195 instead of 198 of 200 at 0.2 s (seeds 757001 to 757200).
const RATIO_CHANGE: f64 = 1.4;
const DISCOUNT: f64 = 0.6;

/// Estimates of the noise, and the information on them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    /// Whether σ_z and σ_i are known, and the initial ln σ_z² and ln σ_i².
    known: [bool; 2],
    start: [f64; 2],
    /// ln ρ, ln σ_z².
    logs: Vector2<f64>,
    /// σ_z² and σ_i², m² and A².
    pub variances: [f64; 2],
    information: Matrix2<f64>,
    samples: f64,
    /// ln ρ with which most samples were weighted.
    weighting_log_ratio: f64,
}

impl Noise {
    /// Initial noise: the known standard deviations of a position, m, and of a current, A, if not 0; otherwise `first_m`, from differences, for a position.
    /// `gap_m` is that of the magnets.
    pub fn new([known_m, known_a]: [f64; 2], first_m: f64, gap_m: f64) -> Self {
        let known = [known_m > 0.0, known_a > 0.0];
        let [least, most] = POSITION_NOISE.map(|part| part * gap_m);
        let position = if known[0] { known_m } else { first_m.clamp(least, most) };
        let current = if known[1] { known_a } else { START_CURRENT_NOISE_A };
        let logs = Vector2::new(2.0 * log(current / position), 2.0 * log(position));
        // A standard deviation of three in ln ρ and ln σ_z²: a factor of twenty.
        let information = Matrix2::identity() * 0.1;
        let variances = [position * position, current * current];
        let start = [logs.y, logs.sum()];
        Self { known, start, weighting_log_ratio: logs.x, logs, variances, information, samples: 0.0 }
    }

    /// Whether all estimated noise is within the reliable range, with this gap and mean square of the currents.
    pub fn is_within_range(&self, gap_m: f64, mean_square_a2: f64) -> bool {
        let [position, current] = RELIABLE_UP_TO;
        let limited = self.variances.into_iter().zip([position * gap_m, current * current_range(mean_square_a2)]);
        limited.zip(self.known).all(|((variance, greatest), known)| known || variance <= greatest * greatest)
    }

    /// Updates the estimates with a weighted innovation, computed with this position variance; returns a factor for all sums so far.
    #[inline(always)]
    pub fn update<const N: usize, const K: usize, const U: usize, const T: usize>(
        &mut self,
        innovation: &Innovation<N, K, U, T>,
        variance: f64,
        weight: f64,
        mean_square_a2: f64,
        gap_m: f64,
    ) -> f64 {
        let Innovation { error, by_log_ratio, by_noise_ratio, .. } = innovation;
        let trace = by_log_ratio.trace();
        let quadratic = error.dot(&(by_log_ratio * error)) / variance;
        let score = Vector2::new(
            sqrt(weight) * by_noise_ratio.dot(error) / variance + 0.5 * (weight * quadratic - trace),
            0.5 * (weight * innovation.nis(variance) - N as f64),
        );
        let by_ratio = 0.5 * by_log_ratio.norm_squared() + by_noise_ratio.norm_squared() / variance;
        let mixed = 0.5 * trace;
        if !(score.sum() + by_ratio).is_finite() {
            return 1.0;
        }
        self.samples += 1.0;
        // Earlier samples, with a worse estimate, are forgotten.
        self.information *= 1.0 - 1.0 / (0.7 * self.samples).max(100.0);
        self.information += Matrix2::new(by_ratio, mixed, mixed, 0.5 * N as f64);
        // ln σ_i² = ln ρ + ln σ_z².
        let [position, current] = self.known.map(|known| if known { KNOWN } else { ESTIMATED });
        let prior = Matrix2::new(current, current, current, current + position);
        let information = self.information + prior;
        let mut step = information.try_inverse().map_or(Vector2::zeros(), |inverse| inverse * score);
        // Known noise may be outside the range of estimates.
        let any = [f64::MIN_POSITIVE, f64::MAX];
        let [least, most] =
            if self.known[0] { any } else { POSITION_NOISE.map(|part| (part * gap_m) * (part * gap_m)) };
        // A position variance at its bound stays there.
        if (self.variances[0] <= least && step.y < 0.0) || (self.variances[0] >= most && step.y > 0.0) {
            step = Vector2::new(score.x / information[(0, 0)], 0.0);
        }
        // The logarithm of a bounded variance, and the variance, after a step of at most 0.1 in the logarithm.
        let bounded = |x: f64, step: f64, [least, most]: [f64; 2]| {
            let x = x + step.clamp(-0.1, 0.1);
            match exp(x) {
                value if value < least => (log(least), least),
                value if value > most => (log(most), most),
                value => (x, value),
            }
        };
        (self.logs.y, self.variances[0]) = bounded(self.logs.y, step.y, [least, most]);
        // More than 0.2 A would explain all of the motion by noise, so that neither λ nor the noise converges: orbits of two circles with 1 µm then end at
        // 0.7 A. To keep the motion itself from being taken for noise while λ is unknown, the variance is at most 0.15 of the mean square of the currents.
        let most_a = 0.2 * current_range(mean_square_a2);
        let most = (0.15 * mean_square_a2).min(most_a * most_a) / self.variances[0];
        // Outside 10² ≤ σ_i/σ_z ≤ 10⁸ A/m one of the two noises has no effect on the innovations.
        let ratio = if self.known[1] { any } else { [1.0e4, most.clamp(1.0e4, 1.0e16)] };
        (self.logs.x, self.variances[1]) = bounded(self.logs.x, step.x, ratio);
        self.variances[1] *= self.variances[0];
        // An estimate five standard deviations of the prior away means that the noise was not known (prior-data conflict).
        let distance = [self.logs.y - self.start[0], self.logs.sum() - self.start[1]];
        if self.known.iter().zip(distance).any(|(known, distance)| *known && distance * distance * KNOWN > 25.0) {
            self.known = [false; 2];
        }
        if (self.logs.x - self.weighting_log_ratio).abs() <= RATIO_CHANGE {
            return 1.0;
        }
        self.weighting_log_ratio = self.logs.x;
        DISCOUNT
    }
}

/// A ring buffer of the first samples, which wait here for the initial estimate of the position noise.
///
/// That is the smaller of the estimates from fourth and sixth differences. These remove the motion and have 70 and 924 times the variance of white noise,
/// the sums of the squared binomial coefficients. Only equidistant samples count, for instance with every other one missing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StartBuffer<const N: usize, const K: usize> {
    ring: Vec<Sample<N, K>>,
    first: usize,
    count: usize,
    /// Missing samples before the last one, and successive samples with that distance; number of differences, and sums of their squares.
    missing: u32,
    equidistant: usize,
    differences: usize,
    squares: [f64; 2],
}

impl<const N: usize, const K: usize> StartBuffer<N, K> {
    pub fn empty() -> Self {
        let sample = Sample::new([0.0; N], [0.0; K], Rotation::start(0.0, 0.0));
        Self {
            ring: vec![sample; START_SAMPLES],
            first: 0,
            count: 0,
            missing: 0,
            equidistant: 0,
            differences: 0,
            squares: [0.0; 2],
        }
    }

    /// Whether the ring is complete and all indices are within it.
    pub fn has_shape(&self) -> bool {
        self.ring.len() == START_SAMPLES && self.first < START_SAMPLES && self.count <= START_SAMPLES
    }

    /// Appends a sample; if the buffer is full, the oldest is dropped.
    pub fn push(&mut self, sample: Sample<N, K>) {
        let end = self.first + self.count;
        self.ring[end % START_SAMPLES] = sample;
        if self.count < START_SAMPLES {
            self.count += 1;
        } else {
            self.first = (self.first + 1) % START_SAMPLES;
            // The sample before the one that is now the oldest is lost.
            self.ring[self.first].missing = MAX_BRIDGED + 1;
        }
        self.equidistant = if sample.missing == self.missing { self.equidistant } else { self.equidistant.min(1) } + 1;
        self.missing = sample.missing;
        if self.differences < START_SAMPLES - 6 && self.equidistant >= 7 {
            let x: [SVector<f64, N>; 7] =
                array::from_fn(|n| self.ring[(end + START_SAMPLES - n) % START_SAMPLES].position_m);
            let fourth = x[1] + x[5] - (x[2] + x[4]) * 4.0 + x[3] * 6.0;
            let sixth = x[0] + x[6] - (x[1] + x[5]) * 6.0 + (x[2] + x[4]) * 15.0 - x[3] * 20.0;
            self.differences += 1;
            self.squares[0] += fourth.norm_squared() / 70.0;
            self.squares[1] += sixth.norm_squared() / 924.0;
        }
    }

    /// Removes and returns the oldest sample.
    pub fn pop(&mut self) -> Option<Sample<N, K>> {
        self.count = self.count.checked_sub(1)?;
        let at = self.first;
        self.first = (at + 1) % START_SAMPLES;
        Some(self.ring[at])
    }

    /// Standard deviation of the positions, m, once there are enough samples.
    pub fn position_noise_m(&self) -> Option<f64> {
        let enough = self.differences >= START_SAMPLES - 6;
        enough.then(|| sqrt(self.squares[0].min(self.squares[1]) / (N * self.differences) as f64))
    }
}
