//! Sums of the normal equations, and the estimate that follows from them.
//!
//! Prediction errors (Ljung, section 7.2): `J = Σ φᵀ S⁻¹ φ`, `b = Σ φᵀ S⁻¹ e_0`, `ϑ = J⁻¹ b`, covariance `σ_z² J⁻¹`. Efficient, but noise of the currents
//! in φ attenuates it, and noise that the controller feeds back pulls at it.
//!
//! Instrumental variables (section 7.6): `H = Σ ζᵀ S⁻¹ φ`, `h = Σ ζᵀ S⁻¹ e_0`, `G = Σ ζᵀ S⁻¹ ζ`, `ϑ = H⁻¹ h`, covariance `σ_z² H⁻¹ G H⁻ᵀ`, with instruments ζ in
//! place of φ for the three λ. They are driven by the mean of `i_k²/gap_k²` at the same rotor angle over earlier revolutions, whose noise is
//! not that of the sample: free of both.

use std::f64::consts::TAU;

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::innovations::{FIRST_INSTRUMENT, FIRST_TOLERANCE, Field, Innovation, SIGNALS, TOLERANCES, UNKNOWNS, Vector};

/// A square matrix of the unknowns.
pub type Square = SMatrix<f64, UNKNOWNS, UNKNOWNS>;
/// What tolerances do to the unknowns.
pub type ByTolerance = SMatrix<f64, UNKNOWNS, TOLERANCES>;

/// The signals that the rows of the sums are made with: φ of the unknowns over all samples; ζ of the three λ and φ of the others over those
/// with instruments.
const ROWS: [usize; 2 * UNKNOWNS] =
    [1, 2, 3, 4, 5, 6, 7, FIRST_INSTRUMENT, FIRST_INSTRUMENT + 1, FIRST_INSTRUMENT + 2, 4, 5, 6, 7];

/// Variance of the size of the bias, in units of the attenuation: −1 without feedback, near 0 with usual controllers, which answer to noise of
/// the positions. With a variance of 1 error/std was 0.2 to 0.8 where the attenuation decides (100 drawn bearings, seeds 51001 and 55001).
const ATTENUATION_VARIANCE: f64 = 0.25;

/// Sums over a stretch of samples.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sums {
    /// Samples, and those of them with instruments.
    pub samples: f64,
    pub instrumented: f64,
    /// `Σ aᵀ S⁻¹ s` of each of the [`ROWS`] with each of the [`SIGNALS`].
    products: [[f64; SIGNALS]; ROWS.len()],
    /// What unit noise of each current adds to the diagonal of J.
    current_noise: [f64; 3],
}

impl Sums {
    pub fn is_finite(&self) -> bool {
        let sums = self.products.as_flattened().iter().chain(&self.current_noise);
        sums.chain([&self.samples, &self.instrumented]).all(|x| x.is_finite())
    }

    /// Adds a sample with so many signals, and with instruments or without.
    #[inline(always)]
    pub fn add(&mut self, innovation: &Innovation, signals: usize, instrumented: bool) {
        self.samples += 1.0;
        self.instrumented += f64::from(instrumented);
        let rows = if instrumented { ROWS.len() } else { UNKNOWNS };
        let [of_y, of_z] = &innovation.signals;
        for (row, signal) in self.products[..rows].iter_mut().zip(ROWS) {
            let weighted = innovation.inverse * innovation.signal(signal);
            for ((sum, y), z) in row.iter_mut().zip(of_y).zip(of_z).take(signals) {
                *sum += weighted.x * y + weighted.y * z;
            }
        }
        for (sum, by) in self.current_noise.iter_mut().zip(innovation.by_current_noise) {
            *sum += innovation.inverse.dot(&by);
        }
    }

    /// Adds another stretch.
    pub fn merge(&mut self, other: &Sums) {
        self.samples += other.samples;
        self.instrumented += other.instrumented;
        let sums = self.products.as_flattened_mut().iter_mut().zip(other.products.as_flattened());
        sums.chain(self.current_noise.iter_mut().zip(&other.current_noise)).for_each(|(sum, value)| *sum += value);
    }

    /// Counts all samples so far with this weight.
    pub fn discount(&mut self, weight: f64) {
        self.products.as_flattened_mut().iter_mut().chain(&mut self.current_noise).for_each(|sum| *sum *= weight);
    }

    /// J.
    pub fn information(&self) -> Square {
        Square::from_fn(|row, column| self.products[row][1 + column])
    }

    /// b.
    pub fn right(&self) -> Vector {
        Vector::from_fn(|row, _| self.products[row][0])
    }

    /// `C = Σ φᵀ S⁻¹ ψ`.
    pub fn by_tolerance(&self) -> ByTolerance {
        ByTolerance::from_fn(|row, n| self.products[row][FIRST_TOLERANCE + n])
    }

    /// The prediction-error estimate with a prior of 100 % about λ_0, for noises of these variances.
    pub fn solve(&self, lambda0: [f64; 3], [position, current]: [f64; 2]) -> Option<PredictionErrorSolution> {
        let (mut information, mut right) = (self.information(), self.right());
        for (k, lambda0) in lambda0.into_iter().enumerate() {
            information[(k, k)] += position / (lambda0 * lambda0);
            right[k] += position / lambda0;
        }
        let (inverse, condition) = inverse(&information)?;
        let unknowns = inverse * right;
        let noise = Vector::from_fn(|k, _| if k < 3 { current * self.current_noise[k] * unknowns[k] } else { 0.0 });
        let (attenuation, sensitivity) = (inverse * noise, -inverse * self.by_tolerance());
        unknowns.iter().chain(&attenuation).all(|x| x.is_finite()).then_some(PredictionErrorSolution {
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
pub struct Solution {
    pub unknowns: Vector,
    /// Variance of λ by noise.
    pub variance: [f64; 3],
    /// Change of the unknowns by one standard deviation of each tolerance.
    sensitivity: ByTolerance,
}

impl Solution {
    pub fn is_finite(&self) -> bool {
        self.unknowns.iter().chain(&self.variance).chain(&self.sensitivity).all(|x| x.is_finite())
    }

    /// λ.
    pub fn lambda(&self) -> [f64; 3] {
        [self.unknowns[0], self.unknowns[1], self.unknowns[2]]
    }

    /// The greatest relative standard deviation of a λ; infinite if one is not positive.
    pub fn relative_std(&self) -> f64 {
        let relative = |(lambda, variance): (f64, f64)| match lambda > 0.0 && variance >= 0.0 {
            true => variance.sqrt() / lambda,
            false => f64::INFINITY,
        };
        self.lambda().into_iter().zip(self.variance).map(relative).fold(0.0, f64::max)
    }

    /// Variance of λ by noise and by tolerances, those that scale λ with this relative variance.
    pub fn total_variance(&self, scale: f64) -> [f64; 3] {
        std::array::from_fn(|k| {
            self.variance[k] + self.sensitivity.row(k).norm_squared() + scale * self.unknowns[k] * self.unknowns[k]
        })
    }
}

/// What prediction errors tell.
pub struct PredictionErrorSolution {
    pub unknowns: Vector,
    /// How far noise of the currents in the regressors may pull the unknowns: `J⁻¹ D λ σ_i²`.
    attenuation: Vector,
    information: Square,
    pub inverse: Square,
    pub sensitivity: ByTolerance,
    pub condition: f64,
}

impl PredictionErrorSolution {
    /// The estimate of both, with instruments if any are given: the attenuation counts as a bias of the known direction a and of a size s with
    /// the variance V of [`ATTENUATION_VARIANCE`], which instruments, free of it, tell as far as they can.
    ///
    /// With `l = J a/(aᵀ J a)`, so that `lᵀ a = 1`, the difference `lᵀ (ϑ_IV − ϑ_PE)` is s with the variance `v = lᵀ (P_IV − P_PE) l`. So
    /// `ŝ = V lᵀ (ϑ_IV − ϑ_PE)/(V + v)`, `ϑ = ϑ_PE + ŝ a`, and the variance is that of ϑ_PE and `a² V v/(V + v)`.
    pub fn combine(&self, instruments: Option<&Sums>, position_variance: f64) -> Solution {
        let a = &self.attenuation;
        let l = self.information * a;
        let weight = a.dot(&l);
        let told =
            instruments.filter(|_| weight > 0.0).and_then(|sums| self.contrast(sums, l / weight, position_variance));
        let (size, variance, sensitivity) = match told {
            Some((difference, variance, sensitivity)) => {
                let variance = (variance - position_variance / weight).max(0.0);
                let part = ATTENUATION_VARIANCE / (ATTENUATION_VARIANCE + variance);
                (part * difference, part * variance, sensitivity * part)
            }
            None => (0.0, ATTENUATION_VARIANCE, SVector::zeros()),
        };
        Solution {
            unknowns: self.unknowns + a * size,
            variance: std::array::from_fn(|k| position_variance * self.inverse[(k, k)] + variance * a[k] * a[k]),
            sensitivity: self.sensitivity + a * sensitivity.transpose(),
        }
    }

    /// `lᵀ (ϑ_IV − ϑ_PE)` with the variance of `lᵀ ϑ_IV`, and its change by the tolerances.
    ///
    /// Of load and unbalance φ itself is the instrument, so that G holds H in its last rows.
    fn contrast(&self, sums: &Sums, l: Vector, position_variance: f64) -> Option<(f64, f64, SVector<f64, TOLERANCES>)> {
        let row = |r: usize| &sums.products[UNKNOWNS + r];
        let h = Square::from_fn(|r, c| row(r)[1 + c]);
        let (scale, scaled) = scaled(&h);
        let w = scaled.transpose().lu().solve(&l.component_mul(&scale))?.component_mul(&scale);
        let g = Square::from_fn(|r, c| match (r < 3, c < 3) {
            (true, true) => row(r)[FIRST_INSTRUMENT + c],
            (false, true) => row(c)[1 + r],
            _ => row(r)[1 + c],
        });
        let right = Vector::from_fn(|r, _| row(r)[0]);
        let by_tolerance = ByTolerance::from_fn(|r, n| row(r)[FIRST_TOLERANCE + n]);
        let (difference, variance) = (w.dot(&right) - l.dot(&self.unknowns), position_variance * w.dot(&(g * w)));
        let sensitivity = -by_tolerance.transpose() * w - self.sensitivity.transpose() * l;
        (difference.is_finite() && variance >= 0.0 && variance.is_finite()).then_some((
            difference,
            variance,
            sensitivity,
        ))
    }
}

/// A matrix scaled to unit diagonal, and the scale; what is not excited has a row and a column of zeros, and gets a one on the diagonal.
fn scaled(matrix: &Square) -> (Vector, Square) {
    let scale = matrix.diagonal().map(|x| if x == 0.0 { 1.0 } else { 1.0 / x.abs().sqrt() });
    let scaled = |r: usize, c: usize| scale[r] * matrix[(r, c)] * scale[c];
    (scale, Square::from_fn(|r, c| if r == c && matrix[(r, r)] == 0.0 { 1.0 } else { scaled(r, c) }))
}

/// The inverse of a symmetric positive definite matrix, and the condition number in the 1-norm of the matrix scaled to unit diagonal.
pub fn inverse(matrix: &Square) -> Option<(Square, f64)> {
    let (scale, scaled) = scaled(matrix);
    let inverse = scaled.cholesky()?.inverse();
    let norm = |m: &Square| m.column_iter().map(|column| column.lp_norm(1)).fold(0.0, f64::max);
    Some((Square::from_fn(|r, c| scale[r] * inverse[(r, c)] * scale[c]), norm(&scaled) * norm(&inverse)))
}

/// Cells of the table of instruments around a revolution; what its harmonics above the eighth do is lost to the instruments.
const CELLS: usize = 32;

/// Revolutions after which a cell forgets: speed and λ may change.
const REVOLUTIONS: f64 = 8.0;

/// The mean of `i_k²/gap_k²` over earlier revolutions, over the rotor angle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AngleTable {
    cells: [Cell; CELLS],
    /// The cell in which the rotor is.
    present: usize,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Cell {
    mean: SVector<f64, 3>,
    /// Revolutions in the mean, at most [`REVOLUTIONS`].
    weight: f64,
    /// Samples seen in this revolution, and their sum.
    seen: f64,
    sum: SVector<f64, 3>,
}

impl AngleTable {
    pub fn is_finite(&self) -> bool {
        let numbers = |cell: &Cell| [cell.mean.sum(), cell.sum.sum(), cell.weight, cell.seen];
        self.present < CELLS && self.cells.iter().flat_map(numbers).all(f64::is_finite)
    }

    /// The mean at an angle, interpolated, if the rotor has passed there before; then takes in what is there now.
    #[inline(always)]
    pub fn exchange(&mut self, angle_rad: f64, field: &Field) -> Option<[f64; 3]> {
        let turns = angle_rad / TAU;
        let place = (turns - turns.floor()) * CELLS as f64;
        let cell = (place as usize) % CELLS;
        let part = place - place.floor() - 0.5;
        let next = (if part > 0.0 { cell + 1 } else { cell + CELLS - 1 }) % CELLS;
        if cell != self.present {
            self.present = cell;
            // Half a revolution late, so that no mean holds the noise of neighbouring samples.
            self.cells[(cell + CELLS / 2) % CELLS].close();
        }
        let [here, beside] = [&self.cells[cell], &self.cells[next]];
        let mean = here.mean.lerp(&beside.mean, part.abs());
        let known = here.weight > 0.0 && beside.weight > 0.0;
        self.cells[cell].seen += 1.0;
        self.cells[cell].sum += SVector::from(field.square);
        known.then_some(mean.into())
    }
}

impl Cell {
    /// Takes what was seen into the mean.
    fn close(&mut self) {
        if self.seen > 0.0 {
            self.weight = (self.weight + 1.0).min(REVOLUTIONS);
            self.mean += (self.sum / self.seen - self.mean) / self.weight;
        }
        (self.seen, self.sum) = (0.0, SVector::zeros());
    }
}
