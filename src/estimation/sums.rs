//! Sums of the normal equations, and the resulting estimate.
//!
//! Prediction errors (Ljung, section 7.2): `J = Σ φᵀ S⁻¹ φ`, `b = Σ φᵀ S⁻¹ e_0`, `ϑ = J⁻¹ b`, covariance `σ_z² J⁻¹`. Efficient, but attenuated by the
//! current noise in φ, and biased by noise that the controller feeds back.
//!
//! Instrumental variables (section 7.6): `H = Σ ζᵀ S⁻¹ φ`, `h = Σ ζᵀ S⁻¹ e_0`, `G = Σ ζᵀ S⁻¹ ζ`, `ϑ = H⁻¹ h`, covariance `σ_z² H⁻¹ G H⁻ᵀ`, with instruments ζ in
//! place of φ for the λ. They are driven by the mean of `i_k²/gap_k²` at the same rotor angle over earlier revolutions, whose noise is independent of that
//! of the sample, and so are free of both biases. φ of load, unbalance and backward force contains no noise and is its own instrument. Samples at angles
//! that the rotor has not passed before have no instruments and are left out.
//!
//! A Gaussian [`Prior`] adds its precision R to J, H and G, and R times its mean to b and h.

use std::f64::consts::TAU;
use std::ops::Range;

use libm::{log, sqrt};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::innovations::Innovation;
use super::motion::{Square, add_product};
use crate::variables::Array;

/// Variance of the size of the bias, in units of the attenuation. The size is −1 without feedback, near 0 with usual controllers, which respond to position
/// noise. With a variance of 1 error/std was 0.2 to 0.8 where the attenuation dominates (100 drawn bearings, seeds 51001 and 55001); with 1/16 an estimate
/// without feedback would be off by four standard deviations.
const ATTENUATION_VARIANCE: f64 = 0.25;

/// Sums of U signals times e_0, times φ of the U unknowns, and times ψ of T tolerances.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Products<const U: usize, const T: usize> {
    right: SVector<f64, U>,
    unknowns: Square<U>,
    tolerances: SMatrix<f64, U, T>,
}

impl<const U: usize, const T: usize> Products<U, T> {
    fn zeros() -> Self {
        Self { right: SVector::zeros(), unknowns: SMatrix::zeros(), tolerances: SMatrix::zeros() }
    }

    #[inline(always)]
    fn add<const N: usize, const K: usize>(&mut self, a: &SMatrix<f64, U, N>, innovation: &Innovation<N, K, U, T>) {
        add_product(&mut self.right, a, &innovation.motion);
        add_product(&mut self.unknowns, a, &innovation.unknowns);
        if let Some(tolerances) = &innovation.tolerances {
            add_product(&mut self.tolerances, a, tolerances);
        }
    }

    fn merge(&mut self, other: &Self) {
        self.right += other.right;
        self.unknowns += other.unknowns;
        self.tolerances += other.tolerances;
    }

    fn scale(&mut self, factor: f64) {
        self.right *= factor;
        self.unknowns *= factor;
        self.tolerances *= factor;
    }

    /// Random walk of the last N unknowns with the variances Q; returns `M = (Q⁻¹ + φ_Nᵀ S⁻¹ φ_N)⁻¹`.
    fn walk<const N: usize>(&mut self, variances: &SVector<f64, N>) -> Option<Square<N>> {
        let own = self.unknowns.fixed_view::<N, N>(U - N, U - N) + Square::from_diagonal(&variances.map(|x| 1.0 / x));
        let (m, _) = inverse(&own)?;
        let gain = self.unknowns.fixed_columns::<N>(U - N) * m;
        self.right -= gain * self.right.fixed_rows::<N>(U - N);
        self.tolerances -= gain * self.tolerances.fixed_rows::<N>(U - N);
        self.unknowns -= gain * self.unknowns.fixed_rows::<N>(U - N);
        Some(m)
    }
}

/// Prior knowledge of the unknowns: inverse variances and means.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior<const U: usize> {
    pub precision: SVector<f64, U>,
    pub mean: SVector<f64, U>,
    /// The backward forces among the unknowns.
    pub forces: Range<usize>,
}

/// Sums over samples, for K magnets, U unknowns and T tolerances.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sums<const K: usize, const U: usize, const T: usize> {
    pub samples: f64,
    /// Sum of the weights of the samples, and `Σ e_0ᵀ S⁻¹ e_0`.
    weight: f64,
    square: f64,
    /// b, J, and `C = Σ φᵀ S⁻¹ ψ`.
    predicted: Products<U, T>,
    /// h, H and `Σ ζᵀ S⁻¹ ψ` over the samples with instruments, and `Σ ζᵀ S⁻¹ ζ` of the λ.
    instruments: Products<U, T>,
    instrument_square: Square<K>,
    /// Contribution of each current's noise, per σ_i², and of the angle noise to the diagonal of J.
    regressor_noise: SVector<f64, U>,
}

impl<const K: usize, const U: usize, const T: usize> Sums<K, U, T> {
    pub fn zeros() -> Self {
        Self {
            samples: 0.0,
            weight: 0.0,
            square: 0.0,
            predicted: Products::zeros(),
            instruments: Products::zeros(),
            instrument_square: Square::zeros(),
            regressor_noise: SVector::zeros(),
        }
    }

    /// Adds a sample with the variance of its angle, rad², with or without instruments.
    #[inline(always)]
    pub fn add<const N: usize>(
        &mut self,
        innovation: &Innovation<N, K, U, T>,
        angle_variance: f64,
        instrumented: bool,
    ) {
        self.samples += 1.0;
        self.weight += 1.0;
        self.square += innovation.motion.norm_squared();
        self.predicted.add(&innovation.unknowns, innovation);
        // No controller responds to angle noise, so it attenuates in full: by one standard deviation of the size.
        let by_angle = angle_variance / sqrt(ATTENUATION_VARIANCE);
        for (j, noise) in self.regressor_noise.iter_mut().enumerate().take(U - N) {
            *noise += match j {
                j if j < K => innovation.by_current_noise[j],
                _ => by_angle * innovation.unknowns.row(j).norm_squared(),
            };
        }
        if instrumented {
            let mut instruments = innovation.unknowns;
            instruments.fixed_rows_mut::<K>(0).copy_from(&innovation.instruments);
            self.instruments.add(&instruments, innovation);
            add_product(&mut self.instrument_square, &innovation.instruments, &innovation.instruments);
        }
    }

    /// Adds the sums over other samples.
    pub fn merge(&mut self, other: &Self) {
        self.samples += other.samples;
        self.weight += other.weight;
        self.square += other.square;
        self.predicted.merge(&other.predicted);
        self.instruments.merge(&other.instruments);
        self.instrument_square += other.instrument_square;
        self.regressor_noise += other.regressor_noise;
    }

    /// Multiplies the sums by a weight.
    pub fn discount(&mut self, weight: f64) {
        self.weight *= weight;
        self.square *= weight;
        self.predicted.scale(weight);
        self.instruments.scale(weight);
        self.instrument_square *= weight;
        self.regressor_noise *= weight;
    }

    /// Random walk of the loads, the last N unknowns, with the variances Q in units of σ_z²: the estimate does not change, and the samples so far get the
    /// weight `S⁻¹ − S⁻¹ φ_N M φ_Nᵀ S⁻¹` with `M = (Q⁻¹ + φ_Nᵀ S⁻¹ φ_N)⁻¹` (matrix inversion lemma).
    pub fn walk<const N: usize>(&mut self, variances: &SVector<f64, N>) {
        let right = self.predicted.right.fixed_rows::<N>(U - N).into_owned();
        if let Some(m) = self.predicted.walk(variances) {
            self.square -= right.dot(&(m * right));
        }
        let loads = self.instruments.unknowns.fixed_view::<K, N>(0, U - N).into_owned();
        if let Some(m) = self.instruments.walk(variances) {
            self.instrument_square -= loads * m * loads.transpose();
        }
    }

    /// `J + R` and `b + R m` in units of σ_z².
    fn with_prior(&self, prior: &Prior<U>, position_variance: f64) -> (Square<U>, SVector<f64, U>) {
        let information = self.predicted.unknowns + Square::from_diagonal(&(prior.precision * position_variance));
        (information, self.predicted.right + prior.precision.component_mul(&prior.mean) * position_variance)
    }

    /// Degrees of freedom of the residuals of N coordinates.
    pub fn degrees<const N: usize>(&self) -> f64 {
        (N as f64 * self.weight - U as f64).max(1.0)
    }

    /// `½ (bᵀ J⁻¹ b/σ_z² − ln det J)`, prior included: the log evidence of the samples up to terms common to all models; and the residual sum of squares of
    /// the best estimate, `Σ eᵀ S⁻¹ e/σ_z²`.
    pub fn evidence(&self, prior: &Prior<U>, position_variance: f64) -> Option<[f64; 2]> {
        let (information, right) = self.with_prior(prior, position_variance);
        let (scale, scaled) = scaled(&information);
        let cholesky = scaled.cholesky()?;
        let lower = cholesky.l_dirty();
        let half = lower.solve_lower_triangular(&right.component_mul(&scale))?;
        let log_determinant: f64 = (0..U).map(|j| log(lower[(j, j)] / scale[j])).sum();
        let explained = half.norm_squared() / position_variance;
        let prior_square = prior.precision.dot(&prior.mean.component_mul(&prior.mean));
        let log_evidence = 0.5 * explained - log_determinant;
        log_evidence.is_finite().then_some([log_evidence, self.square / position_variance + prior_square - explained])
    }

    /// The prediction-error estimate with a prior, for these variances of the noise of positions and currents.
    pub fn solve<'a>(
        &'a self,
        prior: &'a Prior<U>,
        [position_variance, current]: [f64; 2],
    ) -> Option<PredictionErrorSolution<'a, K, U, T>> {
        let (information, right) = self.with_prior(prior, position_variance);
        let (inverse, condition) = inverse(&information)?;
        let unknowns = inverse * right;
        let noise = SVector::from_fn(|j, _| if j < K { current } else { 1.0 } * self.regressor_noise[j] * unknowns[j]);
        let attenuation = inverse * noise;
        let mut sensitivity = SMatrix::zeros();
        // Most bearings have no tolerances.
        let by_tolerance = &self.predicted.tolerances;
        if by_tolerance.iter().any(|x| *x != 0.0) {
            sensitivity = -inverse * by_tolerance;
        }
        unknowns.iter().chain(&attenuation).all(|x| x.is_finite()).then_some(PredictionErrorSolution {
            sums: self,
            prior,
            position_variance,
            unknowns,
            attenuation,
            information,
            inverse,
            sensitivity,
            condition,
        })
    }
}

/// An estimate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Solution<const U: usize, const T: usize> {
    pub unknowns: SVector<f64, U>,
    /// Variance of the unknowns due to noise.
    pub variance: SVector<f64, U>,
    /// Standard deviation of the remaining bias in the direction of the attenuation; included in that variance.
    pub bias: SVector<f64, U>,
    /// Variance due to alternative models.
    pub model: SVector<f64, U>,
    /// Change of the unknowns by one standard deviation of each tolerance.
    pub sensitivity: SMatrix<f64, U, T>,
    /// J⁻¹.
    pub inverse: Square<U>,
}

impl<const U: usize, const T: usize> Solution<U, T> {
    /// Greatest relative standard deviation of the K λ; infinite if one is not positive.
    pub fn relative_std<const K: usize>(&self) -> f64 {
        let relative = |(lambda, variance): (&f64, &f64)| match *lambda > 0.0 && *variance >= 0.0 {
            true => variance.sqrt() / lambda,
            false => f64::INFINITY,
        };
        self.unknowns.iter().zip(&self.variance).take(K).map(relative).fold(0.0, f64::max)
    }

    /// Variances of the K λ due to noise, and due to noise, alternative models and tolerances; `scale` is the relative variance due to tolerances that
    /// scale λ. A normalised innovation squared above 1 scales the noise (variance of unit weight).
    pub fn variances<const K: usize>(&self, nis: f64, scale: f64) -> [SVector<f64, K>; 2] {
        let noise = SVector::from_fn(|k, _| self.variance[k] * nis.max(1.0));
        let total = SVector::from_fn(|k, _| {
            let tolerances = self.sensitivity.row(k).norm_squared() + scale * self.unknowns[k] * self.unknowns[k];
            noise[k] + self.model[k] + tolerances
        });
        [noise, total]
    }
}

/// λ of the K magnets, the first of the unknowns.
pub fn lambda_of<const K: usize, const U: usize>(unknowns: &SVector<f64, U>) -> SVector<f64, K> {
    unknowns.fixed_rows::<K>(0).into_owned()
}

/// The estimate from prediction errors alone.
pub struct PredictionErrorSolution<'a, const K: usize, const U: usize, const T: usize> {
    sums: &'a Sums<K, U, T>,
    pub prior: &'a Prior<U>,
    pub position_variance: f64,
    pub unknowns: SVector<f64, U>,
    /// Largest attenuation of the unknowns by current noise in the regressors: `J⁻¹ D λ σ_i²`.
    attenuation: SVector<f64, U>,
    information: Square<U>,
    pub inverse: Square<U>,
    pub sensitivity: SMatrix<f64, U, T>,
    pub condition: f64,
}

impl<const K: usize, const U: usize, const T: usize> PredictionErrorSolution<'_, K, U, T> {
    /// The combined estimate: the attenuation counts as a bias with a known direction a and an unknown size s with the prior variance V,
    /// [`ATTENUATION_VARIANCE`]. The instruments, free of this bias, determine s as far as they can.
    ///
    /// With `l = J a/(aᵀ J a)`, so that `lᵀ a = 1`, the difference `lᵀ (ϑ_IV − ϑ_PE)` is s with the variance `v = lᵀ (P_IV − P_PE) l`. So
    /// `ŝ = V lᵀ (ϑ_IV − ϑ_PE)/(V + v)`, `ϑ = ϑ_PE + ŝ a`, and the variance is that of ϑ_PE and `a² V v/(V + v)`.
    pub fn combine(&self) -> Solution<U, T> {
        let (a, position_variance) = (&self.attenuation, self.position_variance);
        let l = self.information * a;
        let weight = a.dot(&l);
        let contrast = if weight > 0.0 { self.contrast(l / weight) } else { None };
        let (size, variance, sensitivity) = match contrast {
            Some((difference, variance, sensitivity)) => {
                let variance = (variance - position_variance / weight).max(0.0);
                let shrinkage = ATTENUATION_VARIANCE / (ATTENUATION_VARIANCE + variance);
                (shrinkage * difference, shrinkage * variance, sensitivity * shrinkage)
            }
            None => (0.0, ATTENUATION_VARIANCE, SVector::zeros()),
        };
        let mut by_tolerance = self.sensitivity;
        add_product(&mut by_tolerance, a, &sensitivity);
        Solution {
            unknowns: self.unknowns + a * size,
            variance: SVector::from_fn(|j, _| position_variance * self.inverse[(j, j)] + variance * a[j] * a[j]),
            bias: a * variance.sqrt(),
            model: SVector::zeros(),
            sensitivity: by_tolerance,
            inverse: self.inverse,
        }
    }

    /// `lᵀ (ϑ_IV − ϑ_PE)`, the variance of `lᵀ ϑ_IV`, and the sensitivity of the difference to the tolerances.
    fn contrast(&self, l: SVector<f64, U>) -> Option<(f64, f64, SVector<f64, T>)> {
        let Products { right, unknowns: h, tolerances: by_tolerance } = &self.sums.instruments;
        let ridge = self.prior.precision * self.position_variance;
        let right = right + ridge.component_mul(&self.prior.mean);
        let h = h + Square::from_diagonal(&ridge);
        let (scale, scaled) = scaled(&h);
        let w = solve_transposed(&scaled, l.component_mul(&scale))?.component_mul(&scale);
        let g = Square::from_fn(|r, c| match (r < K, c < K) {
            (true, true) => self.sums.instrument_square[(r, c)] + if r == c { ridge[r] } else { 0.0 },
            (false, true) => h[(c, r)],
            _ => h[(r, c)],
        });
        let (difference, variance) = (w.dot(&right) - l.dot(&self.unknowns), self.position_variance * w.dot(&(g * w)));
        let sensitivity = -by_tolerance.tr_mul(&w) - self.sensitivity.tr_mul(&l);
        let is_sound = difference.is_finite() && variance >= 0.0 && variance.is_finite();
        is_sound.then_some((difference, variance, sensitivity))
    }
}

/// The scale that gives a matrix a unit diagonal, and the scaled matrix; an unexcited unknown has a row and a column of zeros, and a one on the diagonal.
fn scaled<const U: usize>(matrix: &Square<U>) -> (SVector<f64, U>, Square<U>) {
    let scale = matrix.diagonal().map(|x| if x == 0.0 { 1.0 } else { 1.0 / x.abs().sqrt() });
    let scaled = |r: usize, c: usize| scale[r] * matrix[(r, c)] * scale[c];
    (scale, Square::from_fn(|r, c| if r == c && matrix[(r, r)] == 0.0 { 1.0 } else { scaled(r, c) }))
}

/// The inverse of a symmetric positive definite matrix, and the condition number in the 1-norm of the matrix scaled to unit diagonal.
///
/// Gauss–Jordan elimination in place, with positive pivots. It works on whole columns, which takes half the time of a Cholesky decomposition at this size.
pub fn inverse<const U: usize>(matrix: &Square<U>) -> Option<(Square<U>, f64)> {
    let (scale, scaled) = scaled(matrix);
    let mut reduced = scaled;
    for k in 0..U {
        let column = reduced.data.0[k];
        let reciprocal = 1.0 / column[k];
        if !(reciprocal > 0.0 && reciprocal.is_finite()) {
            return None;
        }
        for (other, row) in reduced.data.0.iter_mut().zip(&column) {
            let factor = row * reciprocal;
            other.iter_mut().zip(&column).for_each(|(x, pivot)| *x -= pivot * factor);
            other[k] = factor;
        }
        reduced.data.0[k] = column.map(|x| x * reciprocal);
        reduced.data.0[k][k] = -reciprocal;
    }
    let inverse = -reduced;
    Some((Square::from_fn(|r, c| scale[r] * inverse[(r, c)] * scale[c]), norm(&scaled) * norm(&inverse)))
}

/// The 1-norm of a matrix.
pub fn norm<const U: usize>(matrix: &Square<U>) -> f64 {
    matrix.column_iter().map(|column| column.abs().sum()).fold(0.0, f64::max)
}

/// Solves `aᵀ x = b` by elimination with pivoting.
fn solve_transposed<const U: usize>(a: &Square<U>, mut b: SVector<f64, U>) -> Option<SVector<f64, U>> {
    let mut rows = a.data.0;
    for k in 0..U {
        let pivot = (k..U).max_by(|p, q| rows[*p][k].abs().total_cmp(&rows[*q][k].abs()))?;
        rows.swap(k, pivot);
        b.swap_rows(k, pivot);
        let (pivot, reciprocal) = (rows[k], 1.0 / rows[k][k]);
        for r in k + 1..U {
            let factor = rows[r][k] * reciprocal;
            rows[r].iter_mut().zip(&pivot).for_each(|(x, pivot)| *x -= pivot * factor);
            b[r] -= b[k] * factor;
        }
    }
    for k in (0..U).rev() {
        let solved: f64 = (k + 1..U).map(|c| rows[k][c] * b[c]).sum();
        b[k] = (b[k] - solved) / rows[k][k];
    }
    b.iter().all(|x| x.is_finite()).then_some(b)
}

/// Bins of the table of instruments over a revolution; the instruments do not contain harmonics above the eighth.
const BINS: usize = 32;

/// The mean of `i_k²/gap_k²` over earlier revolutions as a function of the rotor angle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AngleTable<const K: usize> {
    bins: Box<Array<Bin<K>, BINS>>,
    /// The bin of the present angle.
    present: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Bin<const K: usize> {
    mean: SVector<f64, K>,
    /// Revolutions in the mean, at most 8, because speed and λ may change.
    weight: f64,
    /// Number and sum of the samples in this revolution.
    samples: f64,
    sum: SVector<f64, K>,
}

impl<const K: usize> AngleTable<K> {
    pub fn empty() -> Self {
        let bin = Bin { mean: SVector::zeros(), weight: 0.0, samples: 0.0, sum: SVector::zeros() };
        Self { bins: Box::new(Array([bin; BINS])), present: 0 }
    }

    /// The interpolated mean at an angle, if the rotor has passed there before; then adds the present value.
    #[inline(always)]
    pub fn exchange(&mut self, angle_rad: f64, square: &SVector<f64, K>) -> Option<SVector<f64, K>> {
        let revolutions = angle_rad / TAU;
        let position = (revolutions - revolutions.floor()) * BINS as f64;
        let bin = (position as usize) % BINS;
        let offset = position - position.floor() - 0.5;
        let next = (if offset > 0.0 { bin + 1 } else { bin + BINS - 1 }) % BINS;
        if bin != self.present {
            self.present = bin;
            // Half a revolution late, so that the means do not contain the noise of neighbouring samples.
            self.bins[(bin + BINS / 2) % BINS].close();
        }
        let [here, neighbour] = [&self.bins[bin], &self.bins[next]];
        let mean = here.mean.lerp(&neighbour.mean, offset.abs());
        let known = here.weight > 0.0 && neighbour.weight > 0.0;
        self.bins[bin].samples += 1.0;
        self.bins[bin].sum += square;
        known.then_some(mean)
    }
}

impl<const K: usize> Bin<K> {
    /// Adds this revolution to the mean.
    fn close(&mut self) {
        if self.samples > 0.0 {
            self.weight = (self.weight + 1.0).min(8.0);
            self.mean += (self.sum / self.samples - self.mean) / self.weight;
        }
        (self.samples, self.sum) = (0.0, SVector::zeros());
    }
}
