//! Normal equations of all recordings together.

use nalgebra::{DMatrix, DVector};

use super::bench::BENCH;
use super::equations::{ALL, BASE, LOAD};
use super::filter::Block;

/// λ, U, then the bench.
pub(super) const SHARED: usize = LOAD + BENCH;

/// Number of the unknown that parameter `j` of recording `r` is: λ, U, bench, then two loads for each recording.
pub(super) fn unknown(j: usize, r: usize) -> usize {
    match j {
        0..LOAD => j,
        LOAD..BASE => SHARED + 2 * r + (j - LOAD),
        _ => j - BASE + LOAD,
    }
}

/// Sums of the normal equations over blocks: unknowns, then the instruments of λ.
#[derive(Clone, Debug)]
pub(super) struct Normal {
    pub j: DMatrix<f64>,
    pub b: DVector<f64>,
}

impl Normal {
    pub fn new(recordings: usize) -> Self {
        let n = SHARED + 2 * recordings + 3;
        Self { j: DMatrix::zeros(n, n), b: DVector::zeros(n) }
    }

    /// Adds a block of recording `r`.
    pub fn add(&mut self, block: &Block, r: usize, parameters: usize) {
        let first_instrument = self.b.len() - 3;
        let place = |j: usize| if j < ALL { unknown(j, r) } else { first_instrument + j - ALL };
        for i in 0..parameters {
            let row = place(i);
            self.b[row] += block.b[i];
            for l in 0..=i {
                let value = block.j[i * block.columns + l];
                let column = place(l);
                self.j[(row, column)] += value;
                if row != column {
                    self.j[(column, row)] += value;
                }
            }
        }
    }
}

/// The inverse of a symmetric positive definite matrix, scaled by its diagonal first; `None` unless it is one.
pub(super) fn inverse(a: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = a.nrows();
    let scale: Vec<f64> = (0..n).map(|i| 1.0 / a[(i, i)].sqrt()).collect();
    if scale.iter().any(|scale| !scale.is_finite()) {
        return None;
    }
    let scaled = DMatrix::from_fn(n, n, |i, l| a[(i, l)] * scale[i] * scale[l]);
    let inverse = scaled.cholesky()?.inverse();
    Some(DMatrix::from_fn(n, n, |i, l| inverse[(i, l)] * scale[i] * scale[l]))
}

/// The inverse of a matrix whose rows and columns belong together, scaled by its diagonal first.
pub(super) fn general_inverse(a: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = a.diagonal().map(|own| 1.0 / own.abs().sqrt());
    let scaled = |a: &DMatrix<f64>| DMatrix::from_fn(a.nrows(), a.ncols(), |i, l| a[(i, l)] * scale[i] * scale[l]);
    let inverse = scaled(&scaled(a).try_inverse()?);
    inverse.iter().all(|value| value.is_finite()).then_some(inverse)
}

/// The rows and columns `of` of a matrix.
pub(super) fn part(a: &DMatrix<f64>, rows: &[usize], columns: &[usize]) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), columns.len(), |i, l| a[(rows[i], columns[l])])
}
