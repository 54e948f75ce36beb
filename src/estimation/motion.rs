//! Motions (q, q̇) driven by signals, their transitions and covariances.
//!
//! Matrices have a row for each signal and a column for each coordinate: each loop runs over contiguous numbers, in the same order on every processor.

use nalgebra::SMatrix;
use serde::{Deserialize, Serialize};

pub type Square<const N: usize> = SMatrix<f64, N, N>;

/// `sum += a bᵀ`.
#[inline(always)]
pub fn add_product<const R: usize, const C: usize, const M: usize>(
    sum: &mut SMatrix<f64, R, C>,
    a: &SMatrix<f64, R, M>,
    b: &SMatrix<f64, C, M>,
) {
    for (c, column) in sum.data.0.iter_mut().enumerate() {
        for m in 0..M {
            let factor = b.data.0[m][c];
            for (sum, a) in column.iter_mut().zip(&a.data.0[m]) {
                *sum += a * factor;
            }
        }
    }
}

/// `a bᵀ`.
#[inline(always)]
pub fn product<const R: usize, const C: usize, const M: usize>(
    a: &SMatrix<f64, R, M>,
    b: &SMatrix<f64, C, M>,
) -> SMatrix<f64, R, C> {
    let mut sum = SMatrix::zeros();
    add_product(&mut sum, a, b);
    sum
}

/// `(a + aᵀ)/2`.
#[inline(always)]
fn symmetric<const N: usize>(a: Square<N>) -> Square<N> {
    (a + a.transpose()) * 0.5
}

/// Coordinates and rates driven by several signals, a row for each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Motions<const R: usize, const N: usize> {
    pub position: SMatrix<f64, R, N>,
    pub rate: SMatrix<f64, R, N>,
}

impl<const R: usize, const N: usize> Motions<R, N> {
    pub fn zeros() -> Self {
        Self { position: SMatrix::zeros(), rate: SMatrix::zeros() }
    }

    /// Adds other motions after a transition.
    #[inline(always)]
    pub fn add(&mut self, by: &Transition<N>, of: &Self) {
        add_product(&mut self.position, &of.position, &by.position);
        add_product(&mut self.position, &of.rate, &by.position_by_rate);
        add_product(&mut self.rate, &of.position, &by.rate_by_position);
        add_product(&mut self.rate, &of.rate, &by.rate);
    }

    #[inline(always)]
    pub fn predict(&mut self, by: &Transition<N>) {
        let before = std::mem::replace(self, Self::zeros());
        self.add(by, &before);
    }

    /// Subtracts the gain times whitened signals.
    #[inline(always)]
    pub fn correct(&mut self, gain: &[Square<N>; 2], signals: &SMatrix<f64, R, N>) {
        add_product(&mut self.position, signals, &-gain[0]);
        add_product(&mut self.rate, signals, &-gain[1]);
    }
}

/// The blocks of a transition matrix of (q, q̇).
pub struct Transition<const N: usize> {
    pub position: Square<N>,
    pub position_by_rate: Square<N>,
    pub rate_by_position: Square<N>,
    pub rate: Square<N>,
}

/// The effect of gyroscopic moments on rates within a step: with `G = Γ h`, `exp(G)`, its mean `∫ exp(G t) dt` from 0 to 1, and `∫ 2 (1 − t) exp(G t) dt`.
///
/// G turns the axis of the rotor by g, so that `G³ = −g² G` and each is `1 + a G + b G²` (formula of Rodrigues).
pub struct Turn<const N: usize> {
    pub gyroscopic: Square<N>,
    pub whole: Square<N>,
    pub once: Square<N>,
    pub twice: Square<N>,
}

impl<const N: usize> Turn<N> {
    #[inline(always)]
    pub fn of(gyroscopic: Square<N>) -> Self {
        let square = gyroscopic * gyroscopic;
        let g2 = -0.5 * square.trace();
        // Taylor series of (sin g)/g, (1 − cos g)/g², (g − sin g)/g³ and (g²/2 − 1 + cos g)/g⁴, exact to 10⁻⁵ up to a radian in a step.
        let series = |first: f64| {
            let [a, b, c] =
                [(first + 1.0) * (first + 2.0), (first + 3.0) * (first + 4.0), (first + 5.0) * (first + 6.0)];
            1.0 - g2 / a * (1.0 - g2 / b * (1.0 - g2 / c))
        };
        let [a, b, c, d] = [series(1.0), series(2.0) / 2.0, series(3.0) / 6.0, series(4.0) / 24.0];
        let polynomial = |a: f64, b: f64| Square::identity() + gyroscopic * a + square * b;
        Self { gyroscopic, whole: polynomial(a, b), once: polynomial(b, c), twice: polynomial(2.0 * c, 2.0 * d) }
    }
}

/// The blocks of a covariance of (q, q̇).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Covariance<const N: usize> {
    pub position: Square<N>,
    pub mixed: Square<N>,
    pub rate: Square<N>,
}

impl<const N: usize> Covariance<N> {
    /// `A P Aᵀ`.
    #[inline(always)]
    pub fn predict(&mut self, a: &Transition<N>) {
        let predicted = |position: Square<N>, rate: Square<N>| {
            let mut motions = Motions { position, rate };
            motions.predict(a);
            motions
        };
        // The rows of P Aᵀ, then the columns.
        let above = predicted(self.position, self.mixed);
        let below = predicted(self.mixed.transpose(), self.rate);
        let positions = predicted(above.position.transpose(), below.position.transpose());
        let rates = predicted(above.rate.transpose(), below.rate.transpose());
        (self.position, self.mixed, self.rate) = (positions.position, positions.rate, rates.rate);
    }

    /// `A P Aᵀ` with A split into a free motion and the change of the rates by stiffness and gyroscopic terms, both times h. Correct to first order in h,
    /// costs a third, and keeps P semidefinite.
    #[inline(always)]
    pub fn drift_and_kick(&mut self, h: f64, stiffness: &Square<N>, gyroscopic: Option<&Square<N>>) {
        let moved = self.rate * h;
        let mixed = self.mixed * h;
        self.position += mixed + mixed.transpose() + moved * h;
        self.mixed += moved;
        // Covariances of the change of the rates with coordinates and rates, then its own.
        let mut with_position = product(&self.position, stiffness);
        let mut with_rate = product(&self.mixed.transpose(), stiffness);
        if let Some(gyroscopic) = gyroscopic {
            add_product(&mut with_position, &self.mixed, gyroscopic);
            add_product(&mut with_rate, &self.rate, gyroscopic);
        }
        self.mixed += with_position;
        self.rate += with_rate + with_rate.transpose() + product(stiffness, &with_position.transpose());
        if let Some(gyroscopic) = gyroscopic {
            add_product(&mut self.rate, gyroscopic, &with_rate.transpose());
        }
    }

    /// `(I − G H) P (I − G H)ᵀ` for the gain G and measured positions H; returns the first columns of `(I − G H) P`.
    #[inline(always)]
    pub fn correct(&mut self, gain: &[Square<N>; 2]) -> [Square<N>; 2] {
        let complement = Square::identity() - gain[0];
        let above = product(&complement, &self.position);
        let mixed = product(&complement, &self.mixed.transpose());
        let below = self.mixed.transpose() - product(&gain[1], &self.position);
        let rate = self.rate - product(&gain[1], &self.mixed.transpose());
        // Asymmetry by rounding would grow.
        self.position = symmetric(product(&above, &complement));
        self.mixed = mixed - product(&above, &gain[1]);
        self.rate = symmetric(rate - product(&below, &gain[1]));
        [above, below]
    }
}
