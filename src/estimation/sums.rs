//! Sums of the normal equations, and the estimate that follows from them.
//!
//! Prediction errors (Ljung, section 7.2): `J = Σ φᵀ S⁻¹ φ`, `b = Σ φᵀ S⁻¹ e_0`, `ϑ = J⁻¹ b`, covariance `σ_z² J⁻¹`. Efficient, but noise of the currents
//! in φ attenuates it, and noise that the controller feeds back pulls at it: a bias of the known direction `a = J⁻¹ D ϑ σ_i²`, with the contribution D of
//! unit noise to J, and of unknown size, which counts as variance.
//!
//! A Gaussian [`Prior`] adds its precision R to J, and R times its mean to b.

use libm::log;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::innovations::Innovation;
use super::motion::{Square, add_product};

/// Standard deviation of the size of the bias, in units of the attenuation: −1 without feedback, near 0 with usual controllers, which answer to noise of
/// the positions. With 1 error/std was 0.2 to 0.8 where the attenuation decides (100 drawn bearings, seeds 51001 and 55001); 1/4 would
/// state four deviations where there is no feedback.
const BIAS: f64 = 0.5;

/// Prior knowledge of the unknowns: inverse variances and means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior<const U: usize> {
    pub precision: SVector<f64, U>,
    pub mean: SVector<f64, U>,
}

/// Sums over a stretch of samples, of K magnets, U unknowns, T tolerances.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sums<const K: usize, const U: usize, const T: usize> {
    pub samples: f64,
    /// Weights of the samples, and `Σ e_0ᵀ S⁻¹ e_0`.
    weight: f64,
    square: f64,
    /// b, J, and `C = Σ φᵀ S⁻¹ ψ`.
    right: SVector<f64, U>,
    information: Square<U>,
    by_tolerance: SMatrix<f64, U, T>,
    /// Contribution of unit noise of each current, and of the noise of the angle, to the diagonal of J.
    regressor_noise: SVector<f64, U>,
}

impl<const K: usize, const U: usize, const T: usize> Sums<K, U, T> {
    /// No samples.
    pub fn zeros() -> Self {
        Self {
            samples: 0.0,
            weight: 0.0,
            square: 0.0,
            right: SVector::zeros(),
            information: Square::zeros(),
            by_tolerance: SMatrix::zeros(),
            regressor_noise: SVector::zeros(),
        }
    }

    /// Takes in an innovation at an angle whose noise gives the force of an unbalance this relative variance.
    #[inline(always)]
    pub fn add<const N: usize>(&mut self, innovation: &Innovation<N, K, U, T>, angle_variance: f64) {
        let unknowns = &innovation.unknowns;
        self.samples += 1.0;
        self.weight += 1.0;
        self.square += innovation.motion.norm_squared();
        add_product(&mut self.right, unknowns, &innovation.motion);
        add_product(&mut self.information, unknowns, unknowns);
        if let Some(tolerances) = &innovation.tolerances {
            add_product(&mut self.by_tolerance, unknowns, tolerances);
        }
        for (j, noise) in self.regressor_noise.iter_mut().enumerate().take(U - N) {
            *noise += match j {
                j if j < K => innovation.by_current_noise[j],
                _ => angle_variance * unknowns.row(j).norm_squared(),
            };
        }
    }

    /// Adds another stretch.
    pub fn merge(&mut self, other: &Self) {
        self.samples += other.samples;
        self.weight += other.weight;
        self.square += other.square;
        self.right += other.right;
        self.information += other.information;
        self.by_tolerance += other.by_tolerance;
        self.regressor_noise += other.regressor_noise;
    }

    /// Counts all samples so far with this weight.
    pub fn discount(&mut self, weight: f64) {
        self.weight *= weight;
        self.square *= weight;
        self.right *= weight;
        self.information *= weight;
        self.by_tolerance *= weight;
        self.regressor_noise *= weight;
    }

    /// `(J + R) and b + R m` in units of σ_z².
    fn with(&self, prior: &Prior<U>, position: f64) -> (Square<U>, SVector<f64, U>) {
        let information = self.information + Square::from_diagonal(&(prior.precision * position));
        (information, self.right + prior.precision.component_mul(&prior.mean) * position)
    }

    /// Degrees of freedom of the residuals of N coordinates.
    pub fn degrees<const N: usize>(&self) -> f64 {
        (N as f64 * self.weight - U as f64).max(1.0)
    }

    /// `½ (bᵀ J⁻¹ b/σ_z² − ln det J)`, prior included: the logarithm of the evidence of the samples, but for what all models have in common; and the residual
    /// sum of squares of the best estimate, `Σ eᵀ S⁻¹ e/σ_z²`.
    pub fn evidence(&self, prior: &Prior<U>, position: f64) -> Option<[f64; 2]> {
        let (information, right) = self.with(prior, position);
        let (scale, scaled) = scaled(&information);
        let cholesky = scaled.cholesky()?;
        let lower = cholesky.l_dirty();
        let half = lower.solve_lower_triangular(&right.component_mul(&scale))?;
        let log_determinant: f64 = (0..U).map(|j| log(lower[(j, j)] / scale[j])).sum();
        let explained = half.norm_squared() / position;
        let prior = prior.precision.dot(&prior.mean.component_mul(&prior.mean));
        let log = 0.5 * explained - log_determinant;
        log.is_finite().then_some([log, self.square / position + prior - explained])
    }

    /// The estimate with a prior, for noises of these variances.
    pub fn solve(&self, prior: &Prior<U>, [position, current]: [f64; 2]) -> Option<Solution<U, T>> {
        let (information, right) = self.with(prior, position);
        let (inverse, condition) = inverse(&information)?;
        let biased = inverse * right;
        let by = |noises: [f64; 2]| {
            inverse * SVector::from_fn(|j, _| noises[usize::from(j >= K)] * self.regressor_noise[j] * biased[j])
        };
        // No controller answers to noise of the angle, and its filter leaves some: it attenuates in full or less.
        let (unknowns, bias) = (biased + by([0.0, BIAS]), by([BIAS * current, BIAS]));
        let mut sensitivity = SMatrix::zeros();
        // Most bearings state no tolerance.
        if self.by_tolerance.iter().any(|x| *x != 0.0) {
            sensitivity = -inverse * self.by_tolerance;
        }
        let variance = inverse.diagonal() * position + bias.component_mul(&bias);
        unknowns.iter().chain(&bias).all(|x| x.is_finite()).then_some(Solution {
            unknowns,
            variance,
            bias,
            model: SVector::zeros(),
            sensitivity,
            inverse,
            condition,
        })
    }
}

/// An estimate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Solution<const U: usize, const T: usize> {
    pub unknowns: SVector<f64, U>,
    /// Variance of the unknowns by noise.
    pub variance: SVector<f64, U>,
    /// Standard deviation of the bias by noise in the regressors; part of that variance.
    pub bias: SVector<f64, U>,
    /// Variance by the models that may be true instead.
    pub model: SVector<f64, U>,
    /// Change of the unknowns by one standard deviation of each tolerance.
    pub sensitivity: SMatrix<f64, U, T>,
    /// J⁻¹.
    pub inverse: Square<U>,
    pub condition: f64,
}

impl<const U: usize, const T: usize> Solution<U, T> {
    /// The first K unknowns.
    pub fn lambda<const K: usize>(&self) -> SVector<f64, K> {
        self.unknowns.fixed_rows::<K>(0).into_owned()
    }

    /// The greatest relative standard deviation of one of K λ; infinite if one is not positive.
    pub fn relative_std<const K: usize>(&self) -> f64 {
        let relative = |(lambda, variance): (&f64, &f64)| match *lambda > 0.0 && *variance >= 0.0 {
            true => variance.sqrt() / lambda,
            false => f64::INFINITY,
        };
        self.unknowns.iter().zip(&self.variance).take(K).map(relative).fold(0.0, f64::max)
    }

    /// Variance of the K λ by noise, and by noise, other models and tolerances, those that scale λ with this relative variance. A normalised
    /// innovation squared above 1 scales the noise (variance of unit weight).
    pub fn variances<const K: usize>(&self, nis: f64, scale: f64) -> [SVector<f64, K>; 2] {
        let noise = SVector::from_fn(|k, _| self.variance[k] * nis.max(1.0));
        let total = SVector::from_fn(|k, _| {
            let tolerances = self.sensitivity.row(k).norm_squared() + scale * self.unknowns[k] * self.unknowns[k];
            noise[k] + self.model[k] + tolerances
        });
        [noise, total]
    }
}

/// A matrix scaled to unit diagonal, and the scale; what is not excited has a row and a column of zeros, and gets a one on the diagonal.
fn scaled<const U: usize>(matrix: &Square<U>) -> (SVector<f64, U>, Square<U>) {
    let scale = matrix.diagonal().map(|x| if x == 0.0 { 1.0 } else { 1.0 / x.abs().sqrt() });
    let scaled = |r: usize, c: usize| scale[r] * matrix[(r, c)] * scale[c];
    (scale, Square::from_fn(|r, c| if r == c && matrix[(r, r)] == 0.0 { 1.0 } else { scaled(r, c) }))
}

/// The inverse of a symmetric positive definite matrix, and the condition number in the 1-norm of the matrix scaled to unit diagonal.
///
/// Gauss–Jordan elimination in place; each of its pivots is positive. It runs along whole columns, which takes half the time of a Cholesky
/// decomposition of so small a matrix.
pub fn inverse<const U: usize>(matrix: &Square<U>) -> Option<(Square<U>, f64)> {
    let (scale, scaled) = scaled(matrix);
    let mut left = scaled;
    for k in 0..U {
        let column = left.data.0[k];
        let reciprocal = 1.0 / column[k];
        if !(reciprocal > 0.0 && reciprocal.is_finite()) {
            return None;
        }
        for (of, row) in left.data.0.iter_mut().zip(&column) {
            let factor = row * reciprocal;
            of.iter_mut().zip(&column).for_each(|(x, of_pivot)| *x -= of_pivot * factor);
            of[k] = factor;
        }
        left.data.0[k] = column.map(|x| x * reciprocal);
        left.data.0[k][k] = -reciprocal;
    }
    let inverse = -left;
    let norm = |m: &Square<U>| m.column_iter().map(|column| column.abs().sum()).fold(0.0, f64::max);
    Some((Square::from_fn(|r, c| scale[r] * inverse[(r, c)] * scale[c]), norm(&scaled) * norm(&inverse)))
}
