//! Normal equations of all recordings together.

use nalgebra::{DMatrix, DVector};

use super::filter::Block;
use super::rotor::Layout;

/// Sums of the normal equations over blocks: unknowns, then the measured sensitivities.
#[derive(Clone, Debug)]
pub(super) struct Normal {
    layout: Layout,
    pub j: DMatrix<f64>,
    pub b: DVector<f64>,
}

impl Normal {
    pub fn new(layout: Layout, recordings: usize) -> Self {
        let n = layout.unknowns(recordings) + layout.columns() - layout.all;
        Self { layout, j: DMatrix::zeros(n, n), b: DVector::zeros(n) }
    }

    /// Adds the sums of a block times a weight.
    pub fn add(&mut self, block: &Block, weight: f64) {
        let layout = self.layout;
        let with_bench = layout.columns();
        let end = self.b.len();
        let place = |j: usize| if j < layout.all { layout.unknown(j, block.recording) } else { end + j - with_bench };
        for i in 0..block.columns.min(with_bench) {
            let row = place(i);
            self.b[row] += weight * block.b[i];
            for l in 0..=i {
                let value = weight * block.j[i * block.columns + l];
                let column = place(l);
                self.j[(row, column)] += value;
                if row != column {
                    self.j[(column, row)] += value;
                }
            }
        }
    }
}

/// Inverse of a symmetric positive definite matrix, scaled by its diagonal first; `None` if it is not positive definite.
pub(super) fn inverse(a: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    scaled(a, |a| Some(a.cholesky()?.inverse()))
}

/// Inverse of a matrix with corresponding rows and columns, scaled by its diagonal first.
pub(super) fn general_inverse(a: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    scaled(a, DMatrix::try_inverse)
}

fn scaled(a: &DMatrix<f64>, inverse: fn(DMatrix<f64>) -> Option<DMatrix<f64>>) -> Option<DMatrix<f64>> {
    let scale = a.diagonal().map(|own| 1.0 / own.abs().sqrt());
    let scaled = |a: &DMatrix<f64>| DMatrix::from_fn(a.nrows(), a.ncols(), |i, l| a[(i, l)] * scale[i] * scale[l]);
    let inverse = scaled(&inverse(scaled(a))?);
    inverse.iter().all(|value| value.is_finite()).then_some(inverse)
}

/// Submatrix of these rows and columns.
pub(super) fn submatrix(a: &DMatrix<f64>, rows: &[usize], columns: &[usize]) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), columns.len(), |i, l| a[(rows[i], columns[l])])
}
