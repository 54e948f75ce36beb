//! The three magnets: geometry, force law, and allocation of a force to the magnets.
//!
//! # Two signs of the paper
//!
//! With the paper's angles, P(3) reads `F_y = (√3/2)(F_3 − F_2)` and `F_z = −F_1 + (F_2 + F_3)/2`. Solved for the
//! forces with `min(F_1, F_2, F_3) = F_0`, it gives
//!
//! ```text
//! F_1 = F_0                     if F_z ≥ |F_y|/√3
//!     = F_0 + |F_y|/√3 − F_z    otherwise
//! F_2 = F_1 − F_y/√3 + F_z
//! F_3 = F_1 + F_y/√3 + F_z
//! ```
//!
//! P(5) prints `F_0 − |F_y|/√3 + F_z` in the second line, and exchanges the signs of `F_y` in the two formulas below it. Taken
//! literally, it asks for negative forces and feeds back positively in y. [`Magnets::allocate`] uses neither: these formulas
//! hold for one set of angles only. It solves P(3) for any number of magnets at any admissible angles and agrees with the corrected formulas where they
//! apply.

use crate::bearing::scalar::Scalar;
use crate::invalid::Checks;
use crate::invalid::Invalid;

/// Two magnets whose angle has a smaller sine than this (0.57°) count as parallel.
///
/// The forces for a resultant across two nearly parallel magnets grow with the inverse of this sine, and so does the standard
/// deviation of their identified λ.
pub const SMALLEST_SINE: f64 = 1e-2;

/// The name of the angle of magnet k, counted from 0.
fn alpha_name(k: usize) -> String {
    format!("alpha[{}]", k + 1)
}

/// `F_k = λ_k i_k² / gap_k²`, in N, P(4), for λ in N·m²/A², currents in A and gaps in m.
///
/// A magnet pulls towards itself whatever the sign of its current.
#[inline]
pub fn forces<T: Scalar, const K: usize>(lambda_nm2_a2: [T; K], current_a: [T; K], gap_m: [T; K]) -> [T; K] {
    std::array::from_fn(|k| {
        let i_per_gap = current_a[k] / gap_m[k];
        lambda_nm2_a2[k] * i_per_gap * i_per_gap
    })
}

/// `i_k = gap_k √(F_k/λ_k)`, in A: P(4) solved for the current, for forces in N, gaps in m, λ in N·m²/A².
///
/// A magnet cannot push: a force below 0 gives no current.
pub fn currents<const K: usize>(force_n: [f64; K], gap_m: [f64; K], lambda_nm2_a2: [f64; K]) -> [f64; K] {
    std::array::from_fn(|k| gap_m[k] * (force_n[k].max(0.0) / lambda_nm2_a2[k]).sqrt())
}

/// Geometry of K magnets around a rotor with N coordinates q: nominal gaps and directions.
///
/// The planar rotor has `q = (y, z)` and three magnets; a [`Shaft`](crate::bearing::shaft::Shaft) has five coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry<T = f64, const N: usize = 2, const K: usize = 3> {
    /// Gap of each magnet with the rotor in the centre, in m; the paper's `s`.
    pub gap_m: [T; K],
    /// `d_k`: how far the point of the rotor before magnet k moves towards the magnet, per unit of each coordinate. So the
    /// generalised force of magnet k is `F_k d_k`. In the plane it is the direction `e_k = (sin α_k, cos α_k)`.
    pub directions: [[T; N]; K],
}

impl<T: Scalar, const K: usize> Geometry<T, 2, K> {
    /// Magnets in the plane at the angles `α_k` of P(3) in rad, with the nominal gap in m.
    pub fn new(gap_m: T, alpha_rad: [T; K]) -> Self {
        let directions = alpha_rad.map(|alpha| {
            let (sin, cos) = alpha.sine_cosine();
            [sin, cos]
        });
        Self { gap_m: [gap_m; K], directions }
    }
}

impl<T: Scalar, const N: usize, const K: usize> Geometry<T, N, K> {
    /// `gap_k = s_k − d_k · q`, in m, of a rotor at the coordinates q; the bracket of P(4).
    ///
    /// A gap of 0 or below means contact.
    #[inline]
    pub fn gaps(&self, q: [T; N]) -> [T; K] {
        std::array::from_fn(|k| self.gap_m[k] - dot(self.directions[k], q))
    }

    /// `Σ F_k d_k`, the generalised force, P(3), for the forces of the magnets in N.
    #[inline]
    pub fn resultant(&self, force_n: [T; K]) -> [T; N] {
        std::array::from_fn(|a| {
            let part = |k: usize| force_n[k] * self.directions[k][a];
            (1..K).fold(part(0), |sum, k| sum + part(k))
        })
    }
}

/// Scalar product, summed from the first component on.
#[inline]
fn dot<T: Scalar, const N: usize>(a: [T; N], b: [T; N]) -> T {
    (1..N).fold(a[0] * b[0], |sum, n| sum + a[n] * b[n])
}

impl<const K: usize> Geometry<f64, 2, K> {
    /// Reports in `checks`: `s` unless it is finite and above 0; `alpha[k]` if it is not finite or if, of three, magnet k is parallel to
    /// an earlier one (see [`SMALLEST_SINE`]). Use the geometry only if nothing was reported.
    fn checked(gap_m: f64, alpha_rad: [f64; K], checks: &mut Checks) -> Self {
        checks.positive("s", gap_m, "m");
        for (k, alpha) in alpha_rad.into_iter().enumerate() {
            checks.finite(alpha_name(k), alpha, "rad");
        }
        let geometry = Self::new(gap_m, alpha_rad);
        for (first, second) in geometry.parallel().filter(|_| K == 3) {
            checks.require(
                false,
                alpha_name(second),
                format_args!("{} rad", alpha_rad[second]),
                format!("a direction that is not parallel to that of {}", alpha_name(first)),
            );
        }
        geometry
    }

    /// Pairs of parallel magnets, the later one second.
    fn parallel(&self) -> impl Iterator<Item = (usize, usize)> {
        let pairs = (0..K).flat_map(|second| (0..second).map(move |first| (first, second)));
        pairs.filter(|(first, second)| cross(self.directions[*first], self.directions[*second]).abs() < SMALLEST_SINE)
    }

    /// `n` with `Σ n_k e_k = 0`: of three magnets `sin(α_2 − α_3) : sin(α_3 − α_1) : sin(α_1 − α_2)`, of more the sum of those of all three
    /// that stand all round the rotor. A magnet that belongs to no such three has 0.
    ///
    /// Computed from the rounded directions, so that n is their null vector to the last bits.
    fn null_vector(&self) -> [f64; K] {
        let mut null = [0.0; K];
        for c in 0..K {
            for b in 0..c {
                for a in 0..b {
                    let [e_a, e_b, e_c] = [a, b, c].map(|k| self.directions[k]);
                    let sines = [cross(e_b, e_c), cross(e_c, e_a), cross(e_a, e_b)];
                    if sines.iter().all(|sine| *sine >= 0.0) || sines.iter().all(|sine| *sine <= 0.0) {
                        for (k, sine) in [a, b, c].into_iter().zip(sines) {
                            null[k] += sine.abs();
                        }
                    }
                }
            }
        }
        null
    }
}

/// Magnets around a rotor, three or more: geometry and force allocation.
#[derive(Clone, Debug, PartialEq)]
pub struct Magnets<const K: usize = 3> {
    geometry: Geometry<f64, 2, K>,
    /// Angle of each magnet as in P(3), in rad.
    alpha_rad: [f64; K],
    /// `n` with `Σ n_k e_k = 0`, all components above 0, mean 1: forces without resultant.
    null: [f64; K],
    /// `Eᵀ(EEᵀ)⁻¹`, one row per magnet: the smallest forces with a given resultant.
    inverse: [[f64; 2]; K],
}

impl<const K: usize> Magnets<K> {
    /// Magnets at the angles `alpha_rad` in rad, nominal gap `gap_m` in m.
    ///
    /// # Errors
    /// `s` unless it is finite and above 0; `alpha[k]` if it is not finite, if of three magnet k is parallel to an earlier one (see
    /// [`SMALLEST_SINE`]), or if magnet k cannot balance others, as when all are within one half-plane: magnets only pull.
    pub fn new(gap_m: f64, alpha_rad: [f64; K]) -> Result<Self, Vec<Invalid>> {
        let mut checks = Checks::default();
        let magnets = Self::checked(gap_m, alpha_rad, &mut checks);
        checks.finish()?;
        Ok(magnets)
    }

    /// Reports errors in `checks`; use the returned value only if there are none.
    pub(crate) fn checked(gap_m: f64, alpha_rad: [f64; K], checks: &mut Checks) -> Self {
        const { assert!(K >= 3, "fewer magnets cannot hold a rotor") };
        let geometry = Geometry::checked(gap_m, alpha_rad, checks);
        let null = geometry.null_vector();
        if alpha_rad.iter().all(|alpha| alpha.is_finite()) && (K > 3 || geometry.parallel().next().is_none()) {
            check_all_round(alpha_rad, &geometry.directions, null, checks);
        }
        let mean = (1..K).fold(null[0], |sum, k| sum + null[k]) / K as f64;
        let null = null.map(|n_k| n_k / mean);

        // E Eᵀ = [[a, b], [b, c]].
        let [mut a, mut b, mut c] = [0.0; 3];
        for e_k in geometry.directions {
            a += e_k[0] * e_k[0];
            b += e_k[0] * e_k[1];
            c += e_k[1] * e_k[1];
        }
        let det = a * c - b * b;
        let inverse = geometry.directions.map(|e_k| [(c * e_k[0] - b * e_k[1]) / det, (a * e_k[1] - b * e_k[0]) / det]);
        Self { geometry, alpha_rad, null, inverse }
    }

    /// Gap and directions.
    pub fn geometry(&self) -> &Geometry<f64, 2, K> {
        &self.geometry
    }

    /// Nominal gap `s`, in m.
    pub fn gap_m(&self) -> f64 {
        self.geometry.gap_m[0]
    }

    /// Angles `α_k` as in P(3), in rad.
    pub fn alpha_rad(&self) -> [f64; K] {
        self.alpha_rad
    }

    /// `e_k = (sin α_k, cos α_k)`, without unit: the direction, (y, z), in which each magnet pulls the rotor.
    pub fn directions(&self) -> [[f64; 2]; K] {
        self.geometry.directions
    }

    /// `n` with `Σ n_k e_k = 0`, without unit: all components above 0, their mean 1.
    pub fn null_vector(&self) -> [f64; K] {
        self.null
    }

    /// Gaps in m, P(4); see [`Geometry::gaps`].
    pub fn gaps(&self, position_m: [f64; 2]) -> [f64; K] {
        self.geometry.gaps(position_m)
    }

    /// Resultant in N, P(3); see [`Geometry::resultant`].
    pub fn resultant(&self, force_n: [f64; K]) -> [f64; 2] {
        self.geometry.resultant(force_n)
    }

    /// The forces, in N, with the resultant `force_n` = (F_y, F_z) in N, the smallest of them `f0_n` in N.
    ///
    /// For any admissible angles: `F = Eᵀ(EEᵀ)⁻¹ (F_y, F_z) + c n` with `c = max_k (F_0 − F_k)/n_k`. With the paper's angles
    /// this is P(5) with its signs corrected (see the module). No force falls below `f0_n`, not even by rounding.
    pub fn allocate(&self, force_n: [f64; 2], f0_n: f64) -> [f64; K] {
        let particular = self.inverse.map(|row| row[0] * force_n[0] + row[1] * force_n[1]);
        let needed = particular.iter().zip(self.null).map(|(f_k, n_k)| (f0_n - f_k) / n_k);
        let c = needed.fold(f64::NEG_INFINITY, f64::max);
        std::array::from_fn(|k| (particular[k] + c * self.null[k]).max(f0_n))
    }
}

/// The sine of the angle between two directions `(sin α, cos α)`: `sin(α_a − α_b)`.
fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

/// Refuses magnets that cannot balance others, such as all within a half-plane.
fn check_all_round<const K: usize>(
    alpha_rad: [f64; K],
    directions: &[[f64; 2]; K],
    null: [f64; K],
    checks: &mut Checks,
) {
    // Within a half-plane the one in the middle is named: it lies between the others.
    let between = |k: usize| {
        let sides = directions.map(|e| cross(directions[k], e));
        sides.iter().any(|side| *side > 0.0) && sides.iter().any(|side| *side < 0.0)
    };
    let middle = (0..K).find(|k| between(*k)).unwrap_or(0);
    let idle = if null == [0.0; K] { Some(middle) } else { (0..K).find(|k| null[*k] <= 0.0) };
    if let Some(k) = idle {
        checks.require(
            false,
            alpha_name(k),
            format_args!("{} rad", alpha_rad[k]),
            "magnets all round the rotor (magnets only pull, and these lie within a half-plane)",
        );
    }
}
