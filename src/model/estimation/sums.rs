//! Sums of the normal equations, and the two estimates that follow from them.
//!
//! Prediction errors (Ljung, section 7.2): `J = Σ φᵀ S⁻¹ φ`, `b = Σ φᵀ S⁻¹ e_0`, `ϑ = J⁻¹ b`, covariance `σ_z² J⁻¹`. Efficient, but noise of the currents
//! in φ attenuates it, and noise that the controller feeds back pulls at it.
//!
//! Instrumental variables (section 7.6): `H = Σ ζᵀ S⁻¹ φ`, `h = Σ ζᵀ S⁻¹ e_0`, `G = Σ ζᵀ S⁻¹ ζ`, `ϑ = H⁻¹ h`, covariance `σ_z² H⁻¹ G H⁻ᵀ`. The instruments ζ are
//! driven by the mean of `i_k²/gap_k²` at the same rotor angle over earlier revolutions, whose noise is not that of the sample: free of both.

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::innovations::{Field, Innovation, TOLERANCES, UNKNOWNS};

/// A square matrix of the unknowns.
pub type Square = SMatrix<f64, UNKNOWNS, UNKNOWNS>;
/// A vector of the unknowns.
pub type Vector = SVector<f64, UNKNOWNS>;

/// `Σ aᵀ S⁻¹ (e_0, φ)`: right-hand side in column 0, matrix in the others.
type Rows<const N: usize> = [[f64; 1 + UNKNOWNS]; N];

/// Sums over a stretch of samples.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sums {
    pub samples: u32,
    /// b and J.
    equations: Rows<UNKNOWNS>,
    /// `Σ φᵀ S⁻¹ ψ`.
    tolerances: [[f64; TOLERANCES]; UNKNOWNS],
    /// What unit noise of each current adds to the diagonal of J.
    current_noise: [f64; 3],
}

/// Sums with instruments.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct InstrumentalSums {
    pub samples: u32,
    /// h and H.
    equations: Rows<UNKNOWNS>,
    /// `Σ ζᵀ S⁻¹ φ` of the instruments among themselves: G but for its last rows, which are those of H.
    instruments: [[f64; 3]; 3],
    tolerances: [[f64; TOLERANCES]; UNKNOWNS],
}

/// A solution of either.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Solution {
    pub unknowns: [f64; UNKNOWNS],
    /// Variance of λ by noise.
    pub variance: [f64; 3],
    /// Change of the solution by one standard deviation of each tolerance.
    pub sensitivity: [[f64; TOLERANCES]; UNKNOWNS],
}

impl Solution {
    /// The greatest relative standard deviation of a λ; infinite if one is not positive.
    pub fn relative_std(&self) -> f64 {
        let relative = |k: usize| match self.unknowns[k] > 0.0 && self.variance[k] >= 0.0 {
            true => self.variance[k].sqrt() / self.unknowns[k],
            false => f64::INFINITY,
        };
        (0..3).map(relative).fold(0.0, f64::max)
    }

    /// Variance of λ by the tolerances of the filter.
    pub fn tolerance_variance(&self) -> [f64; 3] {
        std::array::from_fn(|k| self.sensitivity[k].iter().map(|s| s * s).sum())
    }
}

impl Sums {
    /// Adds a sample.
    #[inline(always)]
    pub fn add(&mut self, innovation: &Innovation, with_tolerances: bool) {
        self.samples += 1;
        let [y, z] = innovation.regression;
        for j in 0..UNKNOWNS {
            let weighted = weighted(innovation, [y[1 + j], z[1 + j]]);
            accumulate(&mut self.equations[j], weighted, &innovation.regression);
            if with_tolerances {
                accumulate(&mut self.tolerances[j], weighted, &innovation.tolerance);
            }
        }
        let [yy, yz, zz] = innovation.inverse;
        for (sum, by) in self.current_noise.iter_mut().zip(innovation.by_current_noise) {
            *sum += yy * by[0] + 2.0 * yz * by[1] + zz * by[2];
        }
    }

    /// Adds another stretch.
    pub fn merge(&mut self, other: &Sums) {
        self.samples = self.samples.saturating_add(other.samples);
        add_all(self.equations.as_flattened_mut(), other.equations.as_flattened());
        add_all(self.tolerances.as_flattened_mut(), other.tolerances.as_flattened());
        add_all(&mut self.current_noise, &other.current_noise);
    }

    /// Counts all samples so far with this weight.
    pub fn discount(&mut self, weight: f64) {
        let sums = self.equations.as_flattened_mut().iter_mut().chain(self.tolerances.as_flattened_mut());
        sums.chain(&mut self.current_noise).for_each(|sum| *sum *= weight);
    }

    /// J.
    pub fn information(&self) -> Square {
        Square::from_fn(|row, column| self.equations[row][1 + column])
    }

    /// b.
    pub fn right(&self) -> Vector {
        Vector::from_fn(|row, _| self.equations[row][0])
    }

    /// `Σ φᵀ S⁻¹ ψ`.
    pub fn tolerances(&self) -> SMatrix<f64, UNKNOWNS, TOLERANCES> {
        SMatrix::from_fn(|row, column| self.tolerances[row][column])
    }

    /// The prediction-error estimate with a prior of 100 % about λ_0, for noises of these variances.
    pub fn solve(&self, lambda0: [f64; 3], [position, current]: [f64; 2]) -> Option<PredictionErrorSolution> {
        let (mut information, mut right) = (self.information(), self.right());
        for (k, lambda0) in lambda0.into_iter().enumerate() {
            information[(k, k)] += position / (lambda0 * lambda0);
            right[k] += position / lambda0;
        }
        let definite = Definite::new(&information)?;
        let inverse = definite.inverse();
        let unknowns = product(&inverse, &right);
        let noise = Vector::from_fn(|k, _| if k < 3 { current * self.current_noise[k] * unknowns[k] } else { 0.0 });
        let solution = PredictionErrorSolution {
            attenuation: product(&inverse, &noise),
            sensitivity: sensitivity(&inverse, &self.tolerances),
            condition: definite.condition(&information, &inverse),
            unknowns,
            information,
            inverse,
        };
        solution.unknowns.iter().chain(&solution.attenuation).all(|x| x.is_finite()).then_some(solution)
    }
}

/// What prediction errors tell.
pub struct PredictionErrorSolution {
    pub unknowns: Vector,
    /// How far noise of the currents in the regressors may pull the unknowns: `J⁻¹ D λ σ_i²`.
    attenuation: Vector,
    information: Square,
    pub inverse: Square,
    pub sensitivity: [[f64; TOLERANCES]; UNKNOWNS],
    pub condition: f64,
}

impl PredictionErrorSolution {
    /// The estimate of both: the attenuation counts as a bias of the known direction a and of a size s with variance one, which instruments,
    /// free of it, tell as far as they can.
    ///
    /// With `l = J a/(aᵀ J a)`, so that `lᵀ a = 1`, the difference `lᵀ (ϑ_IV − ϑ_PE)` is s with the variance `v = lᵀ (P_IV − P_PE) l`. So
    /// `ŝ = lᵀ (ϑ_IV − ϑ_PE)/(1 + v)`, `ϑ = ϑ_PE + ŝ a`, and the variance is that of ϑ_PE and `a² v/(1 + v)`.
    pub fn combine(&self, instrumental: Option<&InstrumentalSums>, position_variance: f64) -> Solution {
        let a = &self.attenuation;
        let direction = product(&self.information, a);
        let weight = a.dot(&direction);
        let told = instrumental.filter(|_| weight > 0.0).and_then(|sums| {
            let l = direction / weight;
            let own = position_variance / weight;
            sums.contrast(&l, position_variance, &self.unknowns, &self.sensitivity).map(|mut told| {
                told.variance = (told.variance - own).max(0.0);
                told
            })
        });
        let mut solution = Solution {
            unknowns: self.unknowns.into(),
            variance: std::array::from_fn(|k| position_variance * self.inverse[(k, k)]),
            sensitivity: self.sensitivity,
        };
        let unknown_part = told.as_ref().map_or(1.0, |told| told.variance / (1.0 + told.variance));
        for k in 0..3 {
            solution.variance[k] += unknown_part * a[k] * a[k];
        }
        if let Some(told) = told {
            let part = 1.0 / (1.0 + told.variance);
            for (row, a) in a.iter().enumerate() {
                solution.unknowns[row] += part * told.difference * a;
                for (by, contrast) in solution.sensitivity[row].iter_mut().zip(told.sensitivity) {
                    *by += part * contrast * a;
                }
            }
        }
        solution
    }
}

/// What instruments say of one combination of the unknowns, beside another estimate.
pub struct Contrast {
    difference: f64,
    variance: f64,
    sensitivity: [f64; TOLERANCES],
}

impl InstrumentalSums {
    /// Adds a sample.
    #[inline(always)]
    pub fn add(&mut self, innovation: &Innovation, with_tolerances: bool) {
        self.samples += 1;
        let [y, z] = innovation.regression;
        let [of_y, of_z] = innovation.instrument;
        let instruments: [(f64, f64); 3] = std::array::from_fn(|k| (of_y[k], of_z[k]));
        for j in 0..UNKNOWNS {
            let instrument = match j < 3 {
                true => innovation.instrument.map(|axis| axis[j]),
                false => [y[1 + j], z[1 + j]],
            };
            let weighted = weighted(innovation, instrument);
            accumulate(&mut self.equations[j], weighted, &innovation.regression);
            if j < 3 {
                for (sum, (y, z)) in self.instruments[j].iter_mut().zip(instruments) {
                    *sum += weighted[0] * y + weighted[1] * z;
                }
            }
            if with_tolerances {
                accumulate(&mut self.tolerances[j], weighted, &innovation.tolerance);
            }
        }
    }

    /// Counts all samples so far with this weight.
    pub fn discount(&mut self, weight: f64) {
        let sums = self.equations.as_flattened_mut().iter_mut().chain(self.instruments.as_flattened_mut());
        sums.chain(self.tolerances.as_flattened_mut()).for_each(|sum| *sum *= weight);
    }

    /// `lᵀ (ϑ_IV − ϑ)` with the variance of `lᵀ ϑ_IV`, and its change by the tolerances.
    fn contrast(
        &self,
        l: &Vector,
        position_variance: f64,
        unknowns: &Vector,
        sensitivity: &[[f64; TOLERANCES]; UNKNOWNS],
    ) -> Option<Contrast> {
        let h = Square::from_fn(|row, column| self.equations[row][1 + column]);
        // What is not excited has a row and a column of zeros, and stays zero.
        let scale = Vector::from_fn(|j, _| match h[(j, j)] {
            0.0 => 1.0,
            diagonal => 1.0 / diagonal.abs().sqrt(),
        });
        let transposed = Square::from_fn(|r, c| match r == c && h[(r, r)] == 0.0 {
            true => 1.0,
            false => scale[r] * h[(c, r)] * scale[c],
        });
        let w = transposed.lu().solve(&l.component_mul(&scale))?.component_mul(&scale);
        let g = Square::from_fn(|r, c| match (r < 3, c < 3) {
            (true, true) => self.instruments[r][c],
            (true, false) => self.equations[r][1 + c],
            (false, true) => self.equations[c][1 + r],
            (false, false) => h[(r, c)],
        });
        let right = Vector::from_fn(|row, _| self.equations[row][0]);
        let contrast = Contrast {
            difference: w.dot(&right) - l.dot(unknowns),
            variance: position_variance * product(&g, &w).dot(&w),
            sensitivity: std::array::from_fn(|n| {
                -(0..UNKNOWNS).map(|j| w[j] * self.tolerances[j][n] + l[j] * sensitivity[j][n]).sum::<f64>()
            }),
        };
        (contrast.difference.is_finite() && contrast.variance >= 0.0 && contrast.variance.is_finite())
            .then_some(contrast)
    }
}

/// A symmetric positive definite matrix, factored after scaling it to unit diagonal; rows and columns of zeros are left out.
pub struct Definite {
    scale: Vector,
    factor: nalgebra::Cholesky<f64, nalgebra::Const<UNKNOWNS>>,
}

impl Definite {
    /// `None` if the matrix is not definite.
    pub fn new(matrix: &Square) -> Option<Self> {
        let scale = Vector::from_fn(|j, _| match matrix[(j, j)] {
            0.0 => 1.0,
            diagonal => 1.0 / diagonal.sqrt(),
        });
        let factor = Square::from_fn(|r, c| match r == c {
            true => 1.0,
            false => scale[r] * matrix[(r, c)] * scale[c],
        });
        Some(Self { scale, factor: factor.cholesky()? })
    }

    /// The solution of `matrix · x = right`, column by column.
    pub fn solve<const N: usize>(&self, right: &SMatrix<f64, UNKNOWNS, N>) -> SMatrix<f64, UNKNOWNS, N> {
        let mut x: SMatrix<f64, UNKNOWNS, N> = SMatrix::from_fn(|row, column| self.scale[row] * right[(row, column)]);
        self.factor.solve_mut(&mut x);
        SMatrix::from_fn(|row, column| self.scale[row] * x[(row, column)])
    }

    /// The inverse of the matrix.
    pub fn inverse(&self) -> Square {
        self.solve(&Square::identity())
    }

    /// Condition number in the 1-norm of the scaled matrix, from the matrix and its inverse.
    fn condition(&self, matrix: &Square, inverse: &Square) -> f64 {
        let norm = |value: &dyn Fn(usize, usize) -> f64| {
            (0..UNKNOWNS).map(|c| (0..UNKNOWNS).map(|r| value(r, c).abs()).sum::<f64>()).fold(0.0, f64::max)
        };
        let s = &self.scale;
        norm(&|r, c| s[r] * matrix[(r, c)] * s[c]) * norm(&|r, c| inverse[(r, c)] / (s[r] * s[c]))
    }
}

/// Cells of the table of instruments around a revolution; what its harmonics above the eighth do is lost to the instruments.
const CELLS: usize = 32;

/// Revolutions after which a cell forgets: speed and λ may change.
const REVOLUTIONS: f64 = 8.0;

/// The mean of `i_k²/gap_k²` over earlier revolutions, over the rotor angle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AngleTable {
    mean: [[f64; 3]; CELLS],
    /// Revolutions in each mean, at most [`REVOLUTIONS`].
    weight: [f64; CELLS],
    /// Samples seen in each cell in this revolution, and their sums.
    seen: [f64; CELLS],
    sum: [[f64; 3]; CELLS],
    /// The cell in which the rotor is.
    present: usize,
}

impl AngleTable {
    /// The mean at an angle, interpolated, if the rotor has passed there before; then takes in what is there now.
    #[inline(always)]
    pub fn exchange(&mut self, angle_rad: f64, field: &Field) -> Option<[f64; 3]> {
        let turns = angle_rad / std::f64::consts::TAU;
        let place = (turns - turns.floor()) * CELLS as f64;
        let cell = (place as usize) % CELLS;
        let part = place - place.floor() - 0.5;
        let next = (if part > 0.0 { cell + 1 } else { cell + CELLS - 1 }) % CELLS;
        if cell != self.present {
            self.present = cell;
            // Half a revolution late, so that no mean holds the noise of neighbouring samples.
            self.close((cell + CELLS / 2) % CELLS);
        }
        let part = part.abs();
        let mean = (self.weight[cell] > 0.0 && self.weight[next] > 0.0)
            .then(|| std::array::from_fn(|k| self.mean[cell][k] * (1.0 - part) + self.mean[next][k] * part));
        self.seen[cell] += 1.0;
        add_all(&mut self.sum[cell], &field.square);
        mean
    }

    /// Takes what was seen in a cell into its mean.
    fn close(&mut self, cell: usize) {
        if self.seen[cell] > 0.0 {
            self.weight[cell] = (self.weight[cell] + 1.0).min(REVOLUTIONS);
            for (mean, sum) in self.mean[cell].iter_mut().zip(self.sum[cell]) {
                *mean += (sum / self.seen[cell] - *mean) / self.weight[cell];
            }
        }
        self.seen[cell] = 0.0;
        self.sum[cell] = [0.0; 3];
    }
}

/// `S⁻¹ a`.
#[inline(always)]
fn weighted(innovation: &Innovation, a: [f64; 2]) -> [f64; 2] {
    let [yy, yz, zz] = innovation.inverse;
    [yy * a[0] + yz * a[1], yz * a[0] + zz * a[1]]
}

#[inline(always)]
fn accumulate<const N: usize>(sums: &mut [f64; N], weights: [f64; 2], values: &[[f64; N]; 2]) {
    for n in 0..N {
        sums[n] += weights[0] * values[0][n] + weights[1] * values[1][n];
    }
}

fn add_all(sums: &mut [f64], values: &[f64]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum += value;
    }
}

/// `M x`. Products of larger matrices are not left to nalgebra: it takes other roundings on other processors.
pub fn product<const N: usize>(
    m: &SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    x: &SMatrix<f64, UNKNOWNS, N>,
) -> SMatrix<f64, UNKNOWNS, N> {
    SMatrix::from_fn(|row, column| (0..UNKNOWNS).map(|n| m[(row, n)] * x[(n, column)]).sum())
}

/// `−M⁻¹ C`: the change of a solution by the tolerances.
fn sensitivity(inverse: &Square, tolerances: &[[f64; TOLERANCES]; UNKNOWNS]) -> [[f64; TOLERANCES]; UNKNOWNS] {
    std::array::from_fn(|row| {
        std::array::from_fn(|n| -(0..UNKNOWNS).map(|l| inverse[(row, l)] * tolerances[l][n]).sum::<f64>())
    })
}
