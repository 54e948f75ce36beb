//! Standard deviations of the noise, told or found by likelihood.
//!
//! Before the filter can run, the noise of the positions is taken from their differences. Then the innovations tell both: with their
//! covariance `σ_z² S(ρ)`, `ρ = σ_i²/σ_z²`, the logarithm of the likelihood of one of them is `−½ (eᵀ S⁻¹ e/σ_z² + ln det S + 2 ln σ_z²)`, and
//! the recursive Gauss–Newton method (Ljung, section 11.4) climbs it in `(ln ρ, ln σ_z²)`.

use libm::{exp, log, sqrt};
use serde::{Deserialize, Serialize};

use super::innovations::{Innovation, Running};

/// Samples whose differences the start is taken from: their standard deviation is then known to about a tenth.
pub const START_SAMPLES: u32 = 64;

/// Standard deviation of the noise of a current that the search starts from, A: the geometric mean of 1 mA and 0.1 A, between which it is
/// found.
const START_CURRENT_NOISE_A: f64 = 1.0e-2;

/// Least and greatest standard deviation of a position, m: what is below is rounding, what is above hides a clearance.
const POSITION_NOISE_M: [f64; 2] = [1.0e-9, 3.0e-5];

/// The greatest standard deviations that the search finds without being far off, m and A: one and a half times those of the study of fourteen
/// pairs of noise (`montecarlo --only "14 pairs"`).
const GREATEST_FOUND: [f64; 2] = [7.5e-6, 0.15];

/// Least and greatest `σ_i/σ_z`, A/m. At the ends one of the two noises is without effect on the innovations.
const NOISE_RATIO: [f64; 2] = [1.0e2, 1.0e8];

/// The greatest part of the mean square of the currents that may be noise: the motion itself, while λ is unknown, is not to be taken for it.
const CURRENT_NOISE_PART: f64 = 0.15;

/// The most by which a logarithm changes with one sample.
const STEP: f64 = 0.1;

/// Information at the start: a standard deviation of three in ln ρ and ln σ_z², which are found within a factor of twenty.
const START_INFORMATION: f64 = 0.1;

/// Added to the information of each, so that the first samples decide nothing.
const RIDGE: f64 = 2.0;

/// The information forgets the samples taken with a worse estimate: so much of the number of samples counts, and at least so many.
const MEMORY_PART: f64 = 0.7;
const LEAST_MEMORY: f64 = 100.0;

/// Innovations whose normalised square is beyond this count with a weight that brings them back to it.
pub const OUTLIER: f64 = 60.0;

/// Above this leverage an innovation says more of the unknowns than of the noise.
pub const LEVERAGE_LIMIT: f64 = 0.5;

/// A change of ln ρ that makes the weights of earlier samples wrong by a factor of two, and what they then count.
const RATIO_CHANGE: f64 = 1.4;
const DISCOUNT: f64 = 0.3;

/// The noise, and how well it is known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    /// Whether σ_z and σ_i are told.
    told: [bool; 2],
    /// ln ρ, ln σ_z².
    log_ratio: f64,
    log_variance: f64,
    information: [[f64; 2]; 2],
    samples: f64,
    /// ln ρ with which most samples were weighed.
    weighed_with: f64,
}

impl Noise {
    /// The noise at the start; a standard deviation of zero is not told.
    pub fn new([told_m, told_a]: [f64; 2], first_m: f64) -> Self {
        let position = if told_m > 0.0 { told_m } else { first_m.clamp(POSITION_NOISE_M[0], POSITION_NOISE_M[1]) };
        let current = if told_a > 0.0 { told_a } else { START_CURRENT_NOISE_A };
        let log_ratio = 2.0 * log(current / position);
        Self {
            told: [told_m > 0.0, told_a > 0.0],
            log_ratio,
            log_variance: 2.0 * log(position),
            information: [[START_INFORMATION, 0.0], [0.0, START_INFORMATION]],
            samples: 0.0,
            weighed_with: log_ratio,
        }
    }

    /// Whether both are told.
    pub fn is_told(&self) -> bool {
        self.told == [true; 2]
    }

    /// Whether what is not told has been found where the search can find it.
    pub fn is_within_range(&self) -> bool {
        let found = self.variances().into_iter().zip(GREATEST_FOUND);
        found.zip(self.told).all(|((variance, greatest), told)| told || variance <= greatest * greatest)
    }

    /// σ_z² and σ_i², m² and A².
    pub fn variances(&self) -> [f64; 2] {
        [exp(self.log_variance), exp(self.log_variance + self.log_ratio)]
    }

    /// Takes in an innovation of this leverage `φ cov φᵀ S⁻¹`; the weight that earlier sums are to be counted with from now on.
    #[inline(always)]
    pub fn update(&mut self, innovation: &Innovation, running: &Running, leverage: f64, mean_square_a2: f64) -> f64 {
        let clipped = clip(innovation, running);
        let [yy, yz, zz] = innovation.inverse;
        let [e_y, e_z] = innovation.error;
        let residual = [yy * e_y + yz * e_z, yz * e_y + zz * e_z];
        // ∂S/∂ln ρ.
        let mut by = [0.0; 3];
        let ratio = running.current_variance / running.position_variance;
        for (lambda, slope) in running.unknowns.iter().zip(&innovation.by_current_noise) {
            for (sum, slope) in by.iter_mut().zip(slope) {
                *sum += ratio * lambda * lambda * slope;
            }
        }
        let m =
            [[yy * by[0] + yz * by[1], yy * by[1] + yz * by[2]], [yz * by[0] + zz * by[1], yz * by[1] + zz * by[2]]];
        let trace = m[0][0] + m[1][1];
        let square_trace = m[0][0] * m[0][0] + 2.0 * m[0][1] * m[1][0] + m[1][1] * m[1][1];
        let slope = innovation.noise_ratio;
        let variance = running.position_variance;
        let quadratic = (by[0] * residual[0] * residual[0]
            + 2.0 * by[1] * residual[0] * residual[1]
            + by[2] * residual[1] * residual[1])
            / variance;
        let along = (slope[0] * residual[0] + slope[1] * residual[1]) / variance;
        let score = [
            sqrt(clipped) * along + 0.5 * (clipped * quadratic - trace),
            0.5 * (clipped * innovation.product(innovation.error, innovation.error)
                / variance
                / (1.0 + 0.5 * leverage)
                - 2.0),
        ];
        self.samples += 1.0;
        let keep = 1.0 - 1.0 / (MEMORY_PART * self.samples).max(LEAST_MEMORY);
        let [[f_rr, f_rs], [_, f_ss]] = &mut self.information;
        *f_rr = keep * *f_rr + 0.5 * square_trace + innovation.product(slope, slope) / variance;
        *f_rs = keep * *f_rs + 0.5 * trace;
        *f_ss = keep * *f_ss + 1.0;
        let (rr, rs, ss) = (*f_rr + RIDGE, *f_rs, *f_ss + RIDGE);
        let [by_ratio, by_variance] = match self.told {
            [true, true] => [0.0; 2],
            // Along the line on which the noise that is told stays.
            [true, false] => [score[0] / rr, 0.0],
            [false, true] => {
                let step = (score[1] - score[0]) / (rr - 2.0 * rs + ss);
                [-step, step]
            }
            [false, false] => {
                let determinant = rr * ss - rs * rs;
                [(ss * score[0] - rs * score[1]) / determinant, (rr * score[1] - rs * score[0]) / determinant]
            }
        };
        self.step(by_ratio.clamp(-STEP, STEP), by_variance.clamp(-STEP, STEP), mean_square_a2)
    }

    /// Moves within the bounds.
    fn step(&mut self, by_ratio: f64, by_variance: f64, mean_square_a2: f64) -> f64 {
        let [told_position, told_current] = self.told;
        let bounded = |x: f64, [least, most]: [f64; 2]| x.clamp(2.0 * log(least), 2.0 * log(most));
        let former = self.log_variance + self.log_ratio;
        if !told_position {
            self.log_variance = bounded(self.log_variance + by_variance, POSITION_NOISE_M);
        }
        if told_current {
            self.log_ratio = former - self.log_variance;
        } else {
            let most = log(CURRENT_NOISE_PART * mean_square_a2.max(f64::MIN_POSITIVE)) - self.log_variance;
            self.log_ratio = bounded((self.log_ratio + by_ratio).min(most), NOISE_RATIO);
        }
        if (self.log_ratio - self.weighed_with).abs() > RATIO_CHANGE {
            self.weighed_with = self.log_ratio;
            return DISCOUNT;
        }
        1.0
    }
}

/// The weight of an innovation: less than one for outliers.
#[inline(always)]
pub fn clip(innovation: &Innovation, running: &Running) -> f64 {
    let square = innovation.product(innovation.error, innovation.error) / running.position_variance;
    if square > OUTLIER { OUTLIER / square } else { 1.0 }
}

/// The noise of the positions from their first samples: the smaller of what fourth and sixth differences tell. They take the motion away,
/// and keep 70 and 924 times the variance of white noise, the sums of the squared binomial coefficients.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Differences {
    recent: [[f64; 2]; 7],
    samples: u32,
    squares: [f64; 2],
}

impl Differences {
    /// Takes in a position; the standard deviation once there are enough.
    pub fn add(&mut self, position_m: [f64; 2]) -> Option<f64> {
        self.recent.rotate_left(1);
        self.recent[6] = position_m;
        self.samples += 1;
        if self.samples >= 7 {
            for axis in 0..2 {
                let x = self.recent.map(|position| position[axis]);
                let fourth = x[2] - 4.0 * x[3] + 6.0 * x[4] - 4.0 * x[5] + x[6];
                let sixth = (x[0] + x[6]) - 6.0 * (x[1] + x[5]) + 15.0 * (x[2] + x[4]) - 20.0 * x[3];
                self.squares[0] += fourth * fourth / 70.0;
                self.squares[1] += sixth * sixth / 924.0;
            }
        }
        let terms = 2.0 * f64::from(START_SAMPLES - 6);
        (self.samples >= START_SAMPLES).then(|| sqrt(self.squares[0].min(self.squares[1]) / terms))
    }
}
