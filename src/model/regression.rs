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

/// A pivot of a definite matrix, relative to its diagonal element, below which rounding decides what it is.
const PIVOT_FLOOR: f64 = 1.0e-15;

/// The factors of a symmetric positive definite matrix, `A = L D Lᵀ`.
#[derive(Clone, Debug, PartialEq)]
pub struct Definite {
    unknowns: usize,
    /// Below the diagonal.
    lower: NormalMatrix,
    /// One over the diagonal of D.
    reciprocal: NormalVector,
}

impl Definite {
    /// Factors the leading `unknowns` × `unknowns` block; `None` if it is not definite.
    #[inline]
    #[must_use]
    pub fn new(matrix: &NormalMatrix, unknowns: usize) -> Option<Self> {
        let n = unknowns.min(MAX_UNKNOWNS);
        let mut lower = NormalMatrix::zeros();
        let mut reciprocal = NormalVector::zeros();
        // L D.
        let mut scaled = NormalMatrix::zeros();
        for j in 0..n {
            let mut pivot = matrix[(j, j)];
            for k in 0..j {
                pivot -= scaled[(j, k)] * lower[(j, k)];
            }
            // Written so that a NaN fails as well.
            if !(pivot > PIVOT_FLOOR * matrix[(j, j)] && pivot < f64::INFINITY) {
                return None;
            }
            reciprocal[j] = 1.0 / pivot;
            for i in j + 1..n {
                let mut value = matrix[(i, j)];
                for k in 0..j {
                    value -= scaled[(i, k)] * lower[(j, k)];
                }
                scaled[(i, j)] = value;
                lower[(i, j)] = value * reciprocal[j];
            }
        }
        Some(Self { unknowns: n, lower, reciprocal })
    }

    /// `A⁻¹ h`; `None` if the result is not finite.
    #[must_use]
    pub fn solve(&self, h: &NormalVector) -> Option<NormalVector> {
        let mut x = NormalVector::zeros();
        for i in 0..self.unknowns {
            let mut value = h[i];
            for k in 0..i {
                value -= self.lower[(i, k)] * x[k];
            }
            x[i] = value;
        }
        for i in (0..self.unknowns).rev() {
            let mut value = x[i] * self.reciprocal[i];
            for k in i + 1..self.unknowns {
                value -= self.lower[(k, i)] * x[k];
            }
            x[i] = value;
        }
        x.iter().all(|x| x.is_finite()).then_some(x)
    }

    /// `A⁻¹`; `None` if the result is not finite.
    #[inline]
    #[must_use]
    pub fn inverse(&self) -> Option<NormalMatrix> {
        let n = self.unknowns;
        // L⁻¹ below the diagonal, which is one.
        let mut lower = NormalMatrix::zeros();
        for j in 0..n {
            for i in j + 1..n {
                let mut value = self.lower[(i, j)];
                for k in j + 1..i {
                    value += self.lower[(i, k)] * lower[(k, j)];
                }
                lower[(i, j)] = -value;
            }
            lower[(j, j)] = 1.0;
        }
        let mut inverse = NormalMatrix::zeros();
        for i in 0..n {
            for j in 0..=i {
                let mut value = 0.0;
                for k in i..n {
                    value += lower[(k, i)] * self.reciprocal[k] * lower[(k, j)];
                }
                inverse[(i, j)] = value;
                inverse[(j, i)] = value;
            }
        }
        inverse.iter().all(|x| x.is_finite()).then_some(inverse)
    }
}

/// `√(largest/smallest eigenvalue)` of the leading block of a symmetric matrix, three or five unknowns, as
/// [`SymmetricEigen::condition`] gives it, without eigenvectors: the matrix is made tridiagonal by reflections, and its eigenvalues are
/// found by the QL iteration without roots (Pal, Walker and Kahan).
#[must_use]
pub fn condition(matrix: &NormalMatrix, unknowns: usize) -> f64 {
    let range = if unknowns == MAX_UNKNOWNS { eigenvalues::<MAX_UNKNOWNS>(matrix) } else { eigenvalues::<3>(matrix) };
    let Some([low, high]) = range else { return CONDITION_CAP };
    let ratio = (high / low).sqrt();
    if low > 0.0 && ratio.is_finite() { ratio.clamp(1.0, CONDITION_CAP) } else { CONDITION_CAP }
}

/// The smallest and the largest eigenvalue; `None` if they are not found in a bounded number of iterations, which happens to matrices
/// that are not finite alone.
fn eigenvalues<const N: usize>(matrix: &NormalMatrix) -> Option<[f64; 2]> {
    const ITERATIONS: usize = 30;
    /// Squares of elements beside the diagonal below this, relative to those on it, count as zero: an eigenvalue is then off by
    /// the root of this, where it has a neighbour as near as that, and by this elsewhere.
    const FLOOR: f64 = 1.0e-28;
    let (mut diagonal, mut beside) = tridiagonal::<N>(matrix);
    let mut l = 0;
    let mut iterations = 0;
    while l + 1 < N {
        let mut m = l;
        while m + 1 < N && beside[m] > FLOOR * (diagonal[m] * diagonal[m + 1]).abs() {
            m += 1;
        }
        if m + 1 < N {
            beside[m] = 0.0;
        }
        if m == l {
            l += 1;
            iterations = 0;
            continue;
        }
        // Towards the eigenvalue of the first two rows that is nearer to the first element: a ∓ e²/(δ ± √(δ² + e²)).
        let (square, half) = (beside[l], 0.5 * (diagonal[l + 1] - diagonal[l]));
        let root = (half * half + square).sqrt();
        let shift = square / (half + if half < 0.0 { -root } else { root });
        if m == l + 1 {
            // Two rows alone.
            diagonal[l] -= shift;
            diagonal[l + 1] += shift;
            beside[l] = 0.0;
            l += 2;
            iterations = 0;
            continue;
        }
        if iterations == ITERATIONS {
            return None;
        }
        iterations += 1;
        let shift = diagonal[l] - shift;
        let (mut c, mut s) = (1.0, 0.0);
        let mut gamma = diagonal[m] - shift;
        let mut p = gamma * gamma;
        for i in (l..m).rev() {
            let square = beside[i];
            let r = p + square;
            if i + 1 != m {
                beside[i + 1] = s * r;
            }
            let (former_c, former_gamma) = (c, gamma);
            c = p / r;
            s = square / r;
            let alpha = diagonal[i];
            gamma = c * (alpha - shift) - s * former_gamma;
            diagonal[i + 1] = former_gamma + (alpha - gamma);
            p = if c == 0.0 { former_c * square } else { gamma * gamma / c };
        }
        beside[l] = s * p;
        diagonal[l] = shift + gamma;
    }
    let (mut low, mut high) = (diagonal[0], diagonal[0]);
    for value in diagonal {
        if !value.is_finite() {
            return None;
        }
        (low, high) = (low.min(value), high.max(value));
    }
    Some([low, high])
}

/// Diagonal of a similar tridiagonal matrix, and the squares of the elements beside it: number i stands between i and i + 1.
fn tridiagonal<const N: usize>(matrix: &NormalMatrix) -> ([f64; N], [f64; N]) {
    let mut a = [[0.0; N]; N];
    for (i, row) in a.iter_mut().enumerate() {
        for (k, value) in row.iter_mut().enumerate() {
            *value = matrix[(i, k)];
        }
    }
    let mut diagonal = [0.0; N];
    let mut beside = [0.0; N];
    for j in 0..N.saturating_sub(2) {
        let mut below = 0.0;
        for row in &a[j + 2..] {
            below += row[j] * row[j];
        }
        let first = a[j + 1][j];
        let square = first * first + below;
        beside[j] = square;
        if below == 0.0 {
            continue;
        }
        // The reflection 1 − v vᵀ/g takes what is below the diagonal to one element.
        let length = square.sqrt();
        let end = if first > 0.0 { -length } else { length };
        let mut v = [0.0; N];
        for i in j + 1..N {
            v[i] = a[i][j];
        }
        v[j + 1] -= end;
        let one_over_g = 1.0 / (end * (end - first));
        let mut w = [0.0; N];
        let mut along = 0.0;
        for i in j + 1..N {
            let mut sum = 0.0;
            for k in j + 1..N {
                sum += a[i][k] * v[k];
            }
            w[i] = sum * one_over_g;
            along += v[i] * w[i];
        }
        let half = 0.5 * along * one_over_g;
        for i in j + 1..N {
            w[i] -= half * v[i];
        }
        for i in j + 1..N {
            for k in j + 1..N {
                a[i][k] -= v[i] * w[k] + w[i] * v[k];
            }
        }
    }
    for i in 0..N {
        diagonal[i] = a[i][i];
    }
    if N >= 2 {
        beside[N - 2] = a[N - 1][N - 2] * a[N - 1][N - 2];
    }
    (diagonal, beside)
}

/// Normal equations ready to be solved, for three unknowns, the magnets, or five, the unbalance as well.
///
/// The columns of the unbalance are brought to the size of those of the magnets first, for their natural size
/// changes with ω⁴; without rotation they vanish and the system is singular.
#[derive(Clone, Debug, PartialEq)]
pub struct Equations {
    unknowns: usize,
    /// The matrix with its columns scaled; `None` if there is no scale.
    scaled: Option<NormalMatrix>,
    scale: NormalVector,
    factors: Option<Definite>,
}

impl Equations {
    /// The equations with the normal matrix `p`.
    #[inline]
    #[must_use]
    pub fn new(p: &NormalMatrix, unknowns: usize) -> Self {
        let mut scale = NormalVector::repeat(1.0);
        if unknowns > 3 {
            let magnets = (p[(0, 0)] + p[(1, 1)] + p[(2, 2)]) / 3.0;
            let unbalance = (p[(3, 3)] + p[(4, 4)]) / 2.0;
            let factor = (magnets / unbalance).sqrt();
            if !(factor.is_finite() && factor > 0.0) {
                return Self { unknowns, scaled: None, scale, factors: None };
            }
            scale[3] = factor;
            scale[4] = factor;
        }
        let scaled = NormalMatrix::from_fn(|row, column| p[(row, column)] * (scale[row] * scale[column]));
        Self { unknowns, factors: Definite::new(&scaled, unknowns), scaled: Some(scaled), scale }
    }

    /// As [`condition`], of the scaled matrix.
    #[must_use]
    pub fn condition(&self) -> f64 {
        self.scaled.map_or(CONDITION_CAP, |scaled| condition(&scaled, self.unknowns))
    }

    /// Solves `p · x = h`; `None` if the matrix is singular.
    #[must_use]
    pub fn solve(&self, h: &NormalVector) -> Option<NormalVector> {
        let x = self.factors.as_ref()?.solve(&h.component_mul(&self.scale))?;
        Some(x.component_mul(&self.scale))
    }

    /// The inverse of p; `None` if the matrix is singular.
    #[must_use]
    pub fn inverse(&self) -> Option<NormalMatrix> {
        let inverse = self.factors.as_ref()?.inverse()?;
        let scale = &self.scale;
        Some(NormalMatrix::from_fn(|row, column| inverse[(row, column)] * (scale[row] * scale[column])))
    }
}
