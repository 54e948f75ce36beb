//! The three magnets: geometry, force law, and how a wanted force is shared among them.
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
//! P(5) prints `F_0 − |F_y|/√3 + F_z` in the second line, and the two formulas below it have the signs of `F_y`
//! exchanged. Read to the letter, the paper asks for negative forces and feeds back positively in y.
//! [`Magnets::allocate`] does not use these formulas, as they hold for one set of angles only; it solves P(3) for
//! any admissible angles and agrees with the corrected formulas where they apply.

use crate::bearing::scalar::Scalar;
use crate::invalid::Checks;
use crate::invalid::Invalid;

/// The smallest sine of the angle between two magnets (0.57°) at which they still count as two directions.
///
/// The forces needed for a resultant across two nearly parallel magnets grow with the inverse of this sine, and so does the
/// standard deviation of their identified λ.
pub const SMALLEST_SINE: f64 = 1e-2;

/// Names of the angles, in the order of the magnets.
const ALPHA: [&str; 3] = ["alpha[1]", "alpha[2]", "alpha[3]"];

/// `F_k = λ_k i_k² / gap_k²`, in N, P(4), for λ in N·m²/A², currents in A and gaps in m.
///
/// A magnet pulls towards itself whatever the sign of its current.
#[inline]
pub fn forces<T: Scalar>(lambda_nm2_a2: [T; 3], current_a: [T; 3], gap_m: [T; 3]) -> [T; 3] {
    std::array::from_fn(|k| {
        let i_per_gap = current_a[k] / gap_m[k];
        lambda_nm2_a2[k] * i_per_gap * i_per_gap
    })
}

/// `i_k = gap_k √(F_k/λ_k)`, in A: P(4) solved for the current, for forces in N, gaps in m, λ in N·m²/A².
///
/// A magnet cannot push: a force below 0 gives no current.
pub fn currents(force_n: [f64; 3], gap_m: [f64; 3], lambda_nm2_a2: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| gap_m[k] * (force_n[k].max(0.0) / lambda_nm2_a2[k]).sqrt())
}

/// Where the magnets are: nominal gap and directions; gaps, force law and resultant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry<T = f64> {
    /// Gap of every magnet with the rotor in the centre, the paper's `s`, in m.
    pub gap_m: T,
    /// `e_k = (sin α_k, cos α_k)`: direction, in the (y, z) plane, in which magnet k pulls the rotor.
    pub directions: [[T; 2]; 3],
}

impl<T: Scalar> Geometry<T> {
    /// Magnets at the angles `α_k` of P(3) in rad, with the nominal gap in m.
    pub fn new(gap_m: T, alpha_rad: [T; 3]) -> Self {
        let directions = alpha_rad.map(|alpha| {
            let (sin, cos) = alpha.sine_cosine();
            [sin, cos]
        });
        Self { gap_m, directions }
    }

    /// `gap_k = s − e_k · (Y, Z)`, in m, of a rotor at `position_m`, (y, z) in m; the bracket of P(4).
    ///
    /// A gap that is not above 0 means contact.
    #[inline]
    pub fn gaps(&self, position_m: [T; 2]) -> [T; 3] {
        self.directions.map(|e_k| self.gap_m - (e_k[0] * position_m[0] + e_k[1] * position_m[1]))
    }

    /// `(F_y, F_z) = Σ F_k e_k`, in N, P(3), for the forces of the magnets in N.
    #[inline]
    pub fn resultant(&self, force_n: [T; 3]) -> [T; 2] {
        let [e_1, e_2, e_3] = self.directions;
        std::array::from_fn(|a| force_n[0] * e_1[a] + force_n[1] * e_2[a] + force_n[2] * e_3[a])
    }
}

impl Geometry {
    /// Reports what is wrong in `checks`: `s` unless it is finite and above 0; `alpha[k]` if it is not finite, or if magnet k
    /// is parallel to one before it (see [`SMALLEST_SINE`]). The geometry is of use only if nothing was reported.
    pub(crate) fn checked(gap_m: f64, alpha_rad: [f64; 3], checks: &mut Checks) -> Self {
        checks.positive("s", gap_m, "m");
        for (name, alpha) in ALPHA.into_iter().zip(alpha_rad) {
            checks.finite(name, alpha, "rad");
        }
        let geometry = Self::new(gap_m, alpha_rad);
        for (first, second) in geometry.parallel() {
            checks.require(
                false,
                ALPHA[second],
                format_args!("{} rad", alpha_rad[second]),
                format!("a direction that is not parallel to that of {}", ALPHA[first]),
            );
        }
        geometry
    }

    /// `n_1 : n_2 : n_3 = sin(α_2 − α_3) : sin(α_3 − α_1) : sin(α_1 − α_2)` with `Σ n_k e_k = 0`.
    ///
    /// From the rounded directions, so that n is their null vector to the last bits.
    fn sines(&self) -> [f64; 3] {
        let [e_1, e_2, e_3] = self.directions;
        [cross(e_2, e_3), cross(e_3, e_1), cross(e_1, e_2)]
    }

    /// Pairs of magnets that count as parallel, the later of a pair second.
    fn parallel(&self) -> impl Iterator<Item = (usize, usize)> {
        // Component k belongs to the pair of the two other magnets.
        let pairs = self.sines().into_iter().zip([(1, 2), (0, 2), (0, 1)]);
        pairs.rev().filter(|(sine, _)| sine.abs() < SMALLEST_SINE).map(|(_, pair)| pair)
    }
}

/// Three magnets all round a rotor: their geometry, and how a wanted force is shared among them.
#[derive(Clone, Debug, PartialEq)]
pub struct Magnets {
    geometry: Geometry,
    /// Angle of each magnet as in P(3), in rad.
    alpha_rad: [f64; 3],
    /// `n` with `Σ n_k e_k = 0`, all components above 0, mean 1: forces that pull without resultant.
    null: [f64; 3],
    /// `Eᵀ(EEᵀ)⁻¹`, one row per magnet: the smallest forces that have a given resultant.
    inverse: [[f64; 2]; 3],
}

impl Magnets {
    /// Magnets at the angles `alpha_rad` in rad, nominal gap `gap_m` in m.
    ///
    /// # Errors
    /// `s` unless it is finite and above 0; `alpha[k]` if it is not finite, if magnet k is parallel to one before it
    /// (see [`SMALLEST_SINE`]), or if it leaves all three within one half plane. Magnets pull only: within
    /// half a plane, no forces above 0 balance.
    pub fn new(gap_m: f64, alpha_rad: [f64; 3]) -> Result<Self, Vec<Invalid>> {
        let mut checks = Checks::default();
        let magnets = Self::checked(gap_m, alpha_rad, &mut checks);
        checks.finish()?;
        Ok(magnets)
    }

    /// Reports what is wrong in `checks`; the value returned is of use only when nothing was.
    pub(crate) fn checked(gap_m: f64, alpha_rad: [f64; 3], checks: &mut Checks) -> Self {
        let geometry = Geometry::checked(gap_m, alpha_rad, checks);
        let sines = geometry.sines();
        if alpha_rad.iter().all(|alpha| alpha.is_finite()) && geometry.parallel().next().is_none() {
            check_all_round(alpha_rad, sines, checks);
        }
        let mean = (sines[0] + sines[1] + sines[2]) / 3.0;
        let null = sines.map(|n_k| n_k / mean);

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
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Nominal gap `s`, in m.
    pub fn gap_m(&self) -> f64 {
        self.geometry.gap_m
    }

    /// Angles `α_k` as in P(3), in rad.
    pub fn alpha_rad(&self) -> [f64; 3] {
        self.alpha_rad
    }

    /// `e_k = (sin α_k, cos α_k)`, without unit: the direction, (y, z), in which each magnet pulls the rotor.
    pub fn directions(&self) -> [[f64; 2]; 3] {
        self.geometry.directions
    }

    /// `n` with `Σ n_k e_k = 0`, without unit: all components above 0, their mean 1.
    pub fn null_vector(&self) -> [f64; 3] {
        self.null
    }

    /// Gaps in m, P(4); see [`Geometry::gaps`].
    pub fn gaps(&self, position_m: [f64; 2]) -> [f64; 3] {
        self.geometry.gaps(position_m)
    }

    /// Resultant in N, P(3); see [`Geometry::resultant`].
    pub fn resultant(&self, force_n: [f64; 3]) -> [f64; 2] {
        self.geometry.resultant(force_n)
    }

    /// The forces, in N, with the resultant `force_n` = (F_y, F_z) in N, the smallest of them `f0_n` in N.
    ///
    /// For any admissible angles: `F = Eᵀ(EEᵀ)⁻¹ (F_y, F_z) + c n` with `c = max_k (F_0 − F_k)/n_k`. With the paper's
    /// angles this is P(5) with its signs corrected (see the module). No force is ever below `f0_n`,
    /// not even by rounding.
    pub fn allocate(&self, force_n: [f64; 2], f0_n: f64) -> [f64; 3] {
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

/// Refuses angles at which the magnets, no two of them parallel, lie within half a plane.
fn check_all_round(alpha_rad: [f64; 3], sines: [f64; 3], checks: &mut Checks) {
    let above = sines.iter().filter(|n_k| **n_k > 0.0).count();
    if above == 1 || above == 2 {
        // The magnet whose component has the other sign is the one between the two others.
        let odd = (0..3).find(|k| (sines[*k] > 0.0) == (above == 1)).unwrap_or(0);
        checks.require(
            false,
            ALPHA[odd],
            format_args!("{} rad", alpha_rad[odd]),
            "magnets all round the rotor (magnets only pull, and these lie within half a plane)",
        );
    }
}
