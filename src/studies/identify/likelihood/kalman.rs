//! Kalman filter of the deviation from a trajectory: transition over an interval, prediction, correction.
//!
//! Sizes: N coordinates, S states.

#![allow(clippy::needless_range_loop, reason = "several matrices go by one index")]

use super::rotor::{ByMagnet, Interval, Rotor};
use crate::bearing::array;

/// Kalman filter of the deviation.
#[derive(Clone, Debug)]
pub(super) struct Kalman<const S: usize> {
    pub x: [f64; S],
    pub p: [[f64; S]; S],
}

/// One innovation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Innovation<const N: usize, const S: usize> {
    pub e: [f64; N],
    /// Cholesky factor of the covariance of e.
    pub factor: Factor<N>,
    pub gain: [[f64; N]; S],
    /// Determinant of the covariance.
    pub det: f64,
}

/// Cholesky factor L of a covariance, with the reciprocals of its diagonal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Factor<const N: usize>([[f64; N]; N]);

impl<const N: usize> Factor<N> {
    /// Factor and determinant of a covariance.
    #[inline(always)]
    fn of(s: &[[f64; N]; N]) -> (Self, f64) {
        let (mut l, mut det) = ([[0.0; N]; N], 1.0);
        for a in 0..N {
            for b in 0..a {
                let remainder: f64 = s[a][b] - (0..b).map(|c| l[a][c] * l[b][c]).sum::<f64>();
                l[a][b] = remainder * l[b][b];
            }
            let remainder = s[a][a] - (0..a).map(|c| l[a][c] * l[a][c]).sum::<f64>();
            det *= remainder;
            l[a][a] = 1.0 / remainder.sqrt();
        }
        (Self(l), det)
    }

    /// `L⁻¹ e`.
    #[inline(always)]
    pub fn whiten(&self, mut e: [f64; N]) -> [f64; N] {
        for a in 0..N {
            for b in 0..a {
                e[a] -= self.0[a][b] * e[b];
            }
            e[a] *= self.0[a][a];
        }
        e
    }

    /// `S⁻¹ e` from the whitened e.
    #[inline(always)]
    pub fn unwhiten(&self, mut w: [f64; N]) -> [f64; N] {
        for a in (0..N).rev() {
            for b in a + 1..N {
                w[a] -= self.0[b][a] * w[b];
            }
            w[a] *= self.0[a][a];
        }
        w
    }
}

/// Transition over one interval minus identity: stiffness K and gyroscopic matrix G act to the third order of its length.
#[derive(Clone, Copy, Debug)]
pub(super) struct Transition<const N: usize> {
    /// Coordinates by coordinates, coordinates by rates, rates by coordinates, rates by rates.
    pub blocks: [[[f64; N]; N]; 4],
    h: f64,
}

impl<const N: usize> Transition<N> {
    #[inline(always)]
    pub fn of(h: f64, k: &[[f64; N]; N], g: &[[f64; N]; N]) -> Self {
        let (h_2, h_3) = (0.5 * h * h, h * h * h / 6.0);
        let mut blocks = array::map([h_2, h_3, h, h_2], |factor| array::map(*k, |row| array::map(row, |k| factor * k)));
        for n in 0..N {
            blocks[1][n][n] += h;
        }
        if N > 2 {
            let product = |a: &[[f64; N]; N], b: &[[f64; N]; N]| -> [[f64; N]; N] {
                array::from_fn(|i| array::from_fn(|l| (0..N).map(|m| a[i][m] * b[m][l]).sum()))
            };
            let (gk, gg) = (product(g, k), product(g, g));
            for i in 0..N {
                for l in 0..N {
                    blocks[0][i][l] += h_3 * gk[i][l];
                    blocks[1][i][l] += h_2 * g[i][l] + h_3 * gg[i][l];
                    blocks[2][i][l] += h_2 * gk[i][l];
                    blocks[3][i][l] += h * g[i][l] + h_2 * gg[i][l];
                }
            }
        }
        Self { blocks, h }
    }

    /// `F x`.
    #[inline(always)]
    fn apply<const S: usize>(&self, x: &[f64; S]) -> [f64; S] {
        let (h, h_2) = (self.h, 0.5 * self.h * self.h);
        let [a, b, c, d] = &self.blocks;
        let mut to = *x;
        for i in 0..N {
            for l in 0..N {
                to[i] += a[i][l] * x[l] + b[i][l] * x[N + l];
                to[N + i] += c[i][l] * x[l] + d[i][l] * x[N + l];
            }
            if S > 2 * N {
                to[i] += h_2 * x[2 * N + i];
                to[N + i] += h * x[2 * N + i];
            }
        }
        to
    }

    /// `Fᵀ r`.
    #[inline(always)]
    pub fn apply_transposed<const S: usize>(&self, r: &[f64; S]) -> [f64; S] {
        let (h, h_2) = (self.h, 0.5 * self.h * self.h);
        let [a, b, c, d] = &self.blocks;
        let mut to = *r;
        for i in 0..N {
            for l in 0..N {
                to[i] += a[l][i] * r[l] + c[l][i] * r[N + l];
                to[N + i] += b[l][i] * r[l] + d[l][i] * r[N + l];
            }
            if S > 2 * N {
                to[2 * N + i] += h_2 * r[i] + h * r[N + i];
            }
        }
        to
    }

    /// `F P Fᵀ + Σ scale_k² Γ_k Γ_kᵀ`; `slow` is the variance added to the acceleration of a slow force per interval.
    fn propagate<const S: usize>(&self, noise: &[[f64; N]], scales: &ByMagnet, slow: f64, p: &mut [[f64; S]; S]) {
        let h = self.h;
        // P is symmetric: its rows are its columns.
        let half: [[f64; S]; S] = array::from_fn(|j| self.apply(&p[j]));
        for i in 0..S {
            p[i] = self.apply(&array::from_fn(|j| half[j][i]));
        }
        let mut w = [[0.0; N]; N];
        for (g, scale) in noise.iter().zip(scales) {
            let g = array::map(*g, |g| g * scale);
            for i in 0..N {
                for l in 0..N {
                    w[i][l] += g[i] * g[l];
                }
            }
        }
        let (q_0, q_1, q_2) = (0.25 * h * h * h * h, 0.5 * h * h * h, h * h);
        for i in 0..N {
            for l in 0..N {
                p[i][l] += q_0 * w[i][l];
                p[i][N + l] += q_1 * w[i][l];
                p[N + i][N + l] += q_2 * w[i][l];
            }
        }
        for i in 2 * N..S {
            p[i][i] += slow;
        }
        // Keep P symmetric despite rounding.
        for i in 0..S {
            for l in 0..i {
                p[i][l] = p[l][i];
            }
        }
    }
}

impl<const S: usize> Kalman<S> {
    /// Initial state: the rotor is near the trajectory, within a millimetre and a metre per second. `slow` is the variance of the acceleration of a slow force.
    pub fn diffuse<const N: usize>(slow: f64) -> Self {
        let mut p = [[0.0; S]; S];
        for a in 0..N {
            p[a][a] = 1e-6;
            p[N + a][N + a] = 1.0;
        }
        for at in 2 * N..S {
            p[at][at] = slow;
        }
        Self { x: [0.0; S], p }
    }

    /// Over an interval, as [`Transition::propagate`].
    pub fn predict<const N: usize, const K: usize>(&mut self, interval: &Interval<N, K>, scales: &ByMagnet, slow: f64) {
        self.x = interval.transition.apply(&self.x);
        for (x, offset) in self.x.iter_mut().zip(interval.offset.as_flattened()) {
            *x += offset;
        }
        interval.transition.propagate(&interval.noise, scales, slow, &mut self.p);
    }

    /// `residual`: measured position minus the reading at the trajectory.
    pub fn update<const N: usize>(
        &mut self,
        rotor: &Rotor,
        variance: [f64; N],
        residual: [f64; N],
    ) -> Innovation<N, S> {
        let (m, d) = (&rotor.sensor, rotor.delay);
        let at = |row: &[f64; S]| -> [f64; N] {
            let mut read = [0.0; N];
            for a in 0..N {
                for b in 0..N {
                    read[a] += m[a][b] * (row[b] - d * row[N + b]);
                }
            }
            read
        };
        let pht: [[f64; N]; S] = array::from_fn(|i| at(&self.p[i]));
        let columns: [[f64; N]; N] = array::from_fn(|a| at(&array::from_fn(|i| pht[i][a])));
        let symmetric = |a: usize, b: usize| 0.5 * (columns[a][b] + columns[b][a]);
        let mut covariance: [[f64; N]; N] = array::from_fn(|a| array::from_fn(|b| symmetric(a, b)));
        for a in 0..N {
            covariance[a][a] += variance[a];
        }
        let (factor, det) = Factor::of(&covariance);
        let gain: [[f64; N]; S] = array::from_fn(|i| factor.unwhiten(factor.whiten(pht[i])));
        let predicted = at(&self.x);
        let e: [f64; N] = array::from_fn(|a| residual[a] - predicted[a]);
        for i in 0..S {
            for a in 0..N {
                self.x[i] += gain[i][a] * e[a];
            }
            for j in 0..=i {
                let mut p = self.p[i][j];
                for a in 0..N {
                    p -= gain[i][a] * pht[j][a];
                }
                self.p[i][j] = p;
                self.p[j][i] = p;
            }
        }
        Innovation { e, factor, gain, det }
    }
}
