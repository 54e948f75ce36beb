//! Small symmetric systems: eigenvalues, condition, solution.

use nalgebra::{SMatrix, SVector};

/// The most unknowns that a regression here has.
pub const MAX_UNKNOWNS: usize = 5;

/// Normal matrix `DᵀD`; unknowns beyond those in use have zero rows and columns.
pub type NormalMatrix = SMatrix<f64, MAX_UNKNOWNS, MAX_UNKNOWNS>;

/// Right-hand side `DᵀN`, or a solution.
pub type NormalVector = SVector<f64, MAX_UNKNOWNS>;

/// Where the condition number ends: normal equations in double precision cannot tell larger ones apart, and a
/// singular system shows this value.
pub const CONDITION_CAP: f64 = 1.0e8;

/// Eigenvalues and eigenvectors of the leading block of a symmetric matrix.
#[derive(Clone, Debug, PartialEq)]
pub struct SymmetricEigen {
    unknowns: usize,
    values: NormalVector,
    /// One eigenvector per column.
    vectors: NormalMatrix,
}

impl SymmetricEigen {
    /// Decomposes the leading `unknowns` × `unknowns` block of `matrix` by cyclic Jacobi rotations.
    ///
    /// Jacobi needs only the four operations and square roots, which IEEE 754 fixes to the last bit, and ends after
    /// a bounded number of sweeps whatever the input.
    #[must_use]
    pub fn new(matrix: &NormalMatrix, unknowns: usize) -> Self {
        const SWEEPS: usize = 30;
        let n = unknowns.min(MAX_UNKNOWNS);
        let mut a = *matrix;
        let mut v = NormalMatrix::identity();
        for _ in 0..SWEEPS {
            let mut changed = false;
            for p in 0..n {
                for q in p + 1..n {
                    let off = a[(p, q)];
                    if off == 0.0 || off.abs() <= 1e-18 * (a[(p, p)].abs() * a[(q, q)].abs()).sqrt() {
                        continue;
                    }
                    changed = true;
                    let ratio = (a[(q, q)] - a[(p, p)]) / (2.0 * off);
                    let sign = if ratio < 0.0 { -1.0 } else { 1.0 };
                    let t = sign / (ratio.abs() + (1.0 + ratio * ratio).sqrt());
                    let c = 1.0 / (1.0 + t * t).sqrt();
                    let s = t * c;
                    for k in 0..n {
                        let (x, y) = (a[(k, p)], a[(k, q)]);
                        a[(k, p)] = c * x - s * y;
                        a[(k, q)] = s * x + c * y;
                    }
                    for k in 0..n {
                        let (x, y) = (a[(p, k)], a[(q, k)]);
                        a[(p, k)] = c * x - s * y;
                        a[(q, k)] = s * x + c * y;
                    }
                    a[(p, q)] = 0.0;
                    a[(q, p)] = 0.0;
                    for k in 0..n {
                        let (x, y) = (v[(k, p)], v[(k, q)]);
                        v[(k, p)] = c * x - s * y;
                        v[(k, q)] = s * x + c * y;
                    }
                }
            }
            if !changed {
                break;
            }
        }
        Self { unknowns: n, values: a.diagonal(), vectors: v }
    }

    /// `√(largest/smallest eigenvalue)`, the condition of D itself where the matrix is `DᵀD`; between 1 and
    /// [`CONDITION_CAP`], which also stands for a matrix that is not positive definite.
    #[must_use]
    pub fn condition(&self) -> f64 {
        let values = self.values.as_slice().iter().take(self.unknowns);
        let (low, high) = values.fold((f64::INFINITY, 0.0_f64), |(low, high), e| (low.min(*e), high.max(*e)));
        let ratio = (high / low).sqrt();
        if low > 0.0 && ratio.is_finite() { ratio.clamp(1.0, CONDITION_CAP) } else { CONDITION_CAP }
    }

    /// The inverse of the matrix; `None` if the condition has reached its cap or the result is not finite.
    #[must_use]
    pub fn inverse(&self) -> Option<NormalMatrix> {
        if self.condition() >= CONDITION_CAP {
            return None;
        }
        let mut inverse = NormalMatrix::zeros();
        for e in 0..self.unknowns {
            for row in 0..self.unknowns {
                for column in 0..self.unknowns {
                    inverse[(row, column)] += self.vectors[(row, e)] * self.vectors[(column, e)] / self.values[e];
                }
            }
        }
        inverse.iter().all(|x| x.is_finite()).then_some(inverse)
    }

    /// Solves `matrix · x = h`; `None` if the condition has reached its cap or the result is not finite.
    #[must_use]
    pub fn solve(&self, h: &NormalVector) -> Option<NormalVector> {
        if self.condition() >= CONDITION_CAP {
            return None;
        }
        let mut x = NormalVector::zeros();
        for e in 0..self.unknowns {
            let along: f64 = (0..self.unknowns).map(|k| self.vectors[(k, e)] * h[k]).sum();
            for k in 0..self.unknowns {
                x[k] += self.vectors[(k, e)] * along / self.values[e];
            }
        }
        x.iter().all(|x| x.is_finite()).then_some(x)
    }
}

/// Solution of normal equations.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// As [`SymmetricEigen::condition`], of the scaled matrix.
    pub condition: f64,
    /// The unknowns, unless the matrix is singular.
    pub unknowns: Option<NormalVector>,
    /// The inverse of the matrix, unless it is singular.
    pub inverse: Option<NormalMatrix>,
}

impl Solution {
    /// Solves `p · x = h` for three unknowns, the magnets, or five, the unbalance as well.
    ///
    /// The columns of the unbalance are brought to the size of those of the magnets first, for their natural size
    /// changes with ω⁴; without rotation they vanish and the system is singular.
    #[must_use]
    pub fn of(p: &NormalMatrix, h: &NormalVector, unknowns: usize) -> Self {
        let mut p = *p;
        let magnets = (p[(0, 0)] + p[(1, 1)] + p[(2, 2)]) / 3.0;
        let mut scale = NormalVector::repeat(1.0);
        if unknowns > 3 {
            let unbalance = (p[(3, 3)] + p[(4, 4)]) / 2.0;
            let factor = (magnets / unbalance).sqrt();
            if !(factor.is_finite() && factor > 0.0) {
                return Self { condition: CONDITION_CAP, unknowns: None, inverse: None };
            }
            scale[3] = factor;
            scale[4] = factor;
        }
        for row in 0..MAX_UNKNOWNS {
            for column in 0..MAX_UNKNOWNS {
                p[(row, column)] *= scale[row] * scale[column];
            }
        }
        let eigen = SymmetricEigen::new(&p, unknowns);
        let unknowns = eigen.solve(&h.component_mul(&scale)).map(|x| x.component_mul(&scale));
        let inverse = eigen
            .inverse()
            .map(|inverse| NormalMatrix::from_fn(|row, column| inverse[(row, column)] * scale[row] * scale[column]));
        Self { condition: eigen.condition(), unknowns, inverse }
    }
}
