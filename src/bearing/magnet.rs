//! The magnets of a bearing: geometry, force law, and allocation of a force to the magnets.
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
//! P(5) prints `F_0 − |F_y|/√3 + F_z` in the second line and swaps the signs of `F_y` in the two formulas below it. Taken literally,
//! it demands negative forces and gives positive feedback in y. [`Magnets::allocate`] uses neither version, since they hold for one
//! set of angles only. It solves P(3) for any number of magnets at any admissible angles and agrees with the corrected formulas
//! where they apply.
//!
//! # Opposed pairs
//!
//! Two opposed magnets share a force f along their common line. With a smallest force F_0 each pulls with `F_0 + max(±f, 0)`. With a
//! bias current i_0 the currents are `i_0 ± i_c`, and `f = a (i_0 + i_c)² − b (i_0 − i_c)²` with `a = λ₊/gap₊²` and `b = λ₋/gap₋²` has one
//! solution with both currents above 0; for larger f only one magnet pulls. In the centre, with equal λ, this is the usual linear law
//! `i_c = f/k_i` with `k_i = 4 λ i_0/s²` (Schweitzer and Maslen, Magnetic Bearings, 2009, section 4.2); off-centre it also compensates
//! the negative stiffness.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use crate::bearing::{Scalar, array};
use crate::invalid::Checks;
use crate::variables::Choice;

/// Two magnets are considered parallel if the sine of the angle between them is smaller than this (0.57°).
///
/// The forces needed for a resultant across two nearly parallel magnets grow with the inverse of this sine, and so does the
/// standard deviation of their identified λ.
pub const SMALLEST_SINE: f64 = 1e-2;

/// Two magnets are opposed if each component of the sum of their directions is below this: angles may be given with six digits.
const OPPOSED: f64 = 1e-5;

/// Limit of the angle of a magnet, in rad, two turns: a larger one was probably meant in degrees.
const MOST_RAD: f64 = 2.0 * TAU;

/// The largest number of magnets in a bearing.
pub const MOST_MAGNETS: usize = 6;

/// Which magnets of an axial bearing are used
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Choice)]
#[choice(name = "UsedMagnets")]
pub enum Used {
    /// Both
    #[default]
    Both,
    /// The first one alone, which pulls towards +x: a load pulls back
    First,
    /// The second one alone, which pulls towards -x: a load pulls back
    Second,
}

impl Used {
    /// The only magnet that is used, counted from 0.
    pub fn only(self) -> Option<usize> {
        match self {
            Self::Both => None,
            Self::First => Some(0),
            Self::Second => Some(1),
        }
    }

    /// The magnets that are used, counted from 0.
    pub fn magnets(self) -> Vec<usize> {
        self.only().map_or_else(|| vec![0, 1], |only| vec![only])
    }
}

/// Default angles in rad: of three magnets as in the paper, of four in opposed pairs, 1 and 3, 2 and 4; axial magnets have none.
///
/// Elements beyond the number of magnets are unused.
pub(crate) fn angles_rad<const K: usize>(magnets: usize) -> [f64; K] {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, FRAC_PI_4, PI};
    array::from_fn(|k| match magnets {
        3 => [PI, -FRAC_PI_3, FRAC_PI_3].get(k).copied().unwrap_or_default(),
        4 => FRAC_PI_4 + k as f64 * FRAC_PI_2,
        _ => 0.0,
    })
}

/// The name of the angle of magnet k, counted from 0.
fn alpha_name(k: usize) -> String {
    format!("alpha[{}]", k + 1)
}

/// `F_k = λ_k i_k² / gap_k²`, in N, P(4), for λ in N·m²/A², currents in A and gaps in m.
///
/// A magnet attracts whatever the sign of its current.
#[inline]
pub fn forces<T: Scalar, const K: usize>(lambda_nm2_a2: [T; K], current_a: [T; K], gap_m: [T; K]) -> [T; K] {
    array::from_fn(|k| {
        let i_per_gap = current_a[k] / gap_m[k];
        lambda_nm2_a2[k] * i_per_gap * i_per_gap
    })
}

/// `i_k = gap_k √(F_k/λ_k)`, in A: P(4) solved for the current, for forces in N, gaps in m, λ in N·m²/A².
///
/// A magnet cannot push: a force below 0 gives no current.
pub fn currents<const K: usize>(force_n: [f64; K], gap_m: [f64; K], lambda_nm2_a2: [f64; K]) -> [f64; K] {
    array::from_fn(|k| gap_m[k] * (force_n[k].max(0.0) / lambda_nm2_a2[k]).sqrt())
}

/// Geometry of K magnets around a rotor with N coordinates q: nominal gaps and directions.
///
/// The planar rotor has `q = (y, z)` and three magnets; a [`Shaft`](crate::bearing::shaft::Shaft) has four or five coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry<T = f64, const N: usize = 2, const K: usize = 3> {
    /// Gap of each magnet with the rotor in the centre, in m; the paper's `s`.
    pub gap_m: [T; K],
    /// `d_k`: displacement of the rotor towards magnet k, at the magnet, per unit of each coordinate. So the generalised force of
    /// magnet k is `F_k d_k`. In the plane it is the direction `e_k = (sin α_k, cos α_k)`.
    pub directions: [[T; N]; K],
}

impl<T: Scalar, const N: usize, const K: usize> Geometry<T, N, K> {
    /// `gap_k = s_k − d_k · q`, in m, with the rotor at the coordinates q; the bracket of P(4).
    ///
    /// A gap of 0 or less means contact.
    #[inline]
    pub fn gaps(&self, q: [T; N]) -> [T; K] {
        array::from_fn(|k| self.gap_m[k] - dot(self.directions[k], q))
    }

    /// `Σ F_k d_k`, the generalised force, P(3), for the forces of the magnets in N.
    #[inline]
    pub fn resultant(&self, force_n: [T; K]) -> [T; N] {
        array::from_fn(|a| {
            let part = |k: usize| force_n[k] * self.directions[k][a];
            (1..K).fold(part(0), |sum, k| sum + part(k))
        })
    }
}

/// Scalar product, summed in the order of the components.
#[inline]
fn dot<T: Scalar, const N: usize>(a: [T; N], b: [T; N]) -> T {
    (1..N).fold(a[0] * b[0], |sum, n| sum + a[n] * b[n])
}

/// The magnets of one bearing: force allocation. Those of a radial bearing pull in the plane (y, z), the two of an axial one along the
/// first of these axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Magnets {
    /// Nominal gap `s`, in m.
    gap_m: f64,
    /// Number of magnets; only as many elements of the arrays are used.
    number: usize,
    /// `e_k = (sin α_k, cos α_k)`: the direction in which each magnet pulls the rotor.
    directions: [[f64; 2]; MOST_MAGNETS],
    /// `n` with `Σ n_k e_k = 0`, all components above 0, mean 1: forces without resultant.
    null: [f64; MOST_MAGNETS],
    /// `Eᵀ(EEᵀ)⁻¹`, one row per magnet: the minimum-norm forces for a given resultant.
    inverse: [[f64; 2]; MOST_MAGNETS],
    /// If magnets k and k + half their number are opposed: for each pair the row that gives the force along its line.
    pairs: Option<[[f64; 2]; 2]>,
}

impl Magnets {
    /// Magnets at the finite angles `alpha_rad` in rad, none for the two of an axial bearing, with the nominal gap `gap_m` in m, above 0;
    /// valid only if `checks` finds nothing.
    ///
    /// It finds `alpha[k]` if it is beyond two turns, if one of three magnets is parallel to an earlier one (see [`SMALLEST_SINE`]), or if
    /// magnet k cannot balance others, for instance with all in one half-plane: magnets only pull.
    pub fn checked(gap_m: f64, alpha_rad: &[f64], checks: &mut Checks) -> Self {
        let mut directions = [[0.0; 2]; MOST_MAGNETS];
        if alpha_rad.is_empty() {
            directions[..2].copy_from_slice(&[[1.0, 0.0], [-1.0, 0.0]]);
            let rows = Some([[1.0, 0.0], [0.0; 2]]);
            return Self { gap_m, number: 2, directions, null: [1.0; MOST_MAGNETS], inverse: directions, pairs: rows };
        }
        for (k, (alpha, e_k)) in alpha_rad.iter().zip(&mut directions).enumerate() {
            let wanted = "an angle in rad, at most two turns either way (4π)";
            checks.number(alpha.abs() <= MOST_RAD, alpha_name(k), (*alpha, "rad"), wanted);
            let (sin, cos) = alpha.sine_cosine();
            *e_k = [sin, cos];
        }
        let number = alpha_rad.len();
        let e = &directions[..number];
        let twos = (0..number).flat_map(|second| (0..second).map(move |first| (first, second)));
        let is_parallel = |first: usize, second: usize| cross(e[first], e[second]).abs() < SMALLEST_SINE;
        let parallel: Vec<_> = twos.filter(|(first, second)| number == 3 && is_parallel(*first, *second)).collect();
        let null = null_vector(e);
        if parallel.is_empty() && alpha_rad.iter().all(|alpha| alpha.abs() <= MOST_RAD) {
            check_all_round(alpha_rad, e, &null, checks);
        }
        for (first, second) in parallel {
            let wanted = format!("a direction that is not parallel to that of {}", alpha_name(first));
            checks.number(false, alpha_name(second), (alpha_rad[second], "rad"), wanted);
        }
        let mean = null[1..number].iter().fold(null[0], |sum, n_k| sum + n_k) / number as f64;
        let (null, inverse, pairs) = (null.map(|n_k| n_k / mean), inverse(e), pairs(e));
        Self { gap_m, number, directions, null, inverse, pairs }
    }

    /// Nominal gap `s`, in m.
    pub fn gap_m(&self) -> f64 {
        self.gap_m
    }

    /// `e_k`: the unit vector, (y, z), in which each magnet pulls the rotor.
    pub fn directions(&self) -> &[[f64; 2]] {
        &self.directions[..self.number]
    }

    /// Whether the magnets form opposed pairs.
    pub fn is_paired(&self) -> bool {
        self.pairs.is_some()
    }

    /// Writes the forces, in N, with the resultant `force_n` in N, (F_y, F_z) in the plane. `f0_n` is the smallest force in N of each
    /// opposed pair; without pairs its minimum applies to all magnets.
    ///
    /// For any admissible angles: `F = Eᵀ(EEᵀ)⁻¹ (F_y, F_z) + c n` with `c = max_k (F_0 − F_k)/n_k`. With the paper's angles
    /// this is P(5) with corrected signs (see the module). No force falls below `f0_n`, not even by rounding.
    #[inline(always)]
    pub fn allocate(&self, force_n: [f64; 2], f0_n: &[f64], forces_n: &mut [f64]) {
        if let Some(rows) = &self.pairs {
            let (towards, away) = forces_n.split_at_mut(forces_n.len() / 2);
            for (((towards, away), row), f0) in towards.iter_mut().zip(away).zip(rows).zip(f0_n) {
                let f = dot(*row, force_n);
                (*towards, *away) = (f0 + f.max(0.0), f0 + (-f).max(0.0));
            }
            return;
        }
        let f0_n = f0_n.iter().copied().fold(f64::INFINITY, f64::min);
        let mut c = f64::NEG_INFINITY;
        for ((f_k, row), n_k) in forces_n.iter_mut().zip(&self.inverse).zip(&self.null) {
            *f_k = dot(*row, force_n);
            c = c.max((f0_n - *f_k) / n_k);
        }
        for (f_k, n_k) in forces_n.iter_mut().zip(&self.null) {
            *f_k = (*f_k + c * n_k).max(f0_n);
        }
    }

    /// Writes the forces of opposed pairs, in N, with the resultant `force_n` in N, such that the two currents of each pair have the mean
    /// `bias_a`, in A, as long as both are above 0. `per_square` is `λ_k/gap_k²`, in N/A². See the module; 0 without pairs.
    pub fn allocate_with_bias(&self, force_n: [f64; 2], bias_a: &[f64], per_square: &[f64], forces_n: &mut [f64]) {
        let Some(rows) = self.pairs else { return forces_n.fill(0.0) };
        let half = forces_n.len() / 2;
        for p in 0..half {
            let [a, b, i_0] = [per_square[p], per_square[p + half], bias_a[p]];
            let f = dot(rows[p], force_n);
            let both_n = 4.0 * i_0 * i_0;
            [forces_n[p], forces_n[p + half]] = if f >= a * both_n {
                [f, 0.0]
            } else if f <= -b * both_n {
                [0.0, -f]
            } else {
                // (a − b) i_c² + 2 (a + b) i_0 i_c + (a − b) i_0² − f = 0, solved in a form that also holds for a = b.
                let (second, first) = (a - b, 2.0 * (a + b) * i_0);
                let zeroth = second * i_0 * i_0 - f;
                let i_c = -2.0 * zeroth / (first + (first * first - 4.0 * second * zeroth).sqrt());
                [a * (i_0 + i_c) * (i_0 + i_c), b * (i_0 - i_c) * (i_0 - i_c)]
            };
        }
    }
}

/// The sine of the angle between two directions `(sin α, cos α)`: `sin(α_a − α_b)`.
fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

/// `n` with `Σ n_k e_k = 0`: `sin(α_2 − α_3) : sin(α_3 − α_1) : sin(α_1 − α_2)` for three magnets; for more, the sum over all triples
/// that surround the rotor. A magnet in no such triple has 0.
///
/// Computed from the rounded directions, so that n is their null vector to the last bits.
fn null_vector(directions: &[[f64; 2]]) -> [f64; MOST_MAGNETS] {
    let mut null = [0.0; MOST_MAGNETS];
    for c in 0..directions.len() {
        for b in 0..c {
            for a in 0..b {
                let [e_a, e_b, e_c] = [a, b, c].map(|k| directions[k]);
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

/// `Eᵀ(EEᵀ)⁻¹`, one row per magnet.
fn inverse(directions: &[[f64; 2]]) -> [[f64; 2]; MOST_MAGNETS] {
    // E Eᵀ = [[a, b], [b, c]].
    let [mut a, mut b, mut c] = [0.0; 3];
    for [y, z] in directions {
        a += y * y;
        b += y * z;
        c += z * z;
    }
    let det = a * c - b * b;
    let row = |[y, z]: [f64; 2]| [(c * y - b * z) / det, (a * z - b * y) / det];
    array::from_fn(|k| directions.get(k).copied().map(row).unwrap_or_default())
}

/// For four magnets of which k and k + 2 are opposed: the rows that resolve a force into components along `e_1` and `e_2`.
fn pairs(e: &[[f64; 2]]) -> Option<[[f64; 2]; 2]> {
    let opposed = |k: usize| (0..2).all(|n| (e[k][n] + e[k + 2][n]).abs() < OPPOSED);
    if e.len() != 4 || !(0..2).all(opposed) {
        return None;
    }
    let sine = cross(e[0], e[1]);
    let rows = [[e[1][1], -e[1][0]], [-e[0][1], e[0][0]]];
    (sine.abs() >= SMALLEST_SINE).then(|| rows.map(|row| row.map(|part| part / sine)))
}

/// Rejects magnets that cannot balance others, for instance with all in one half-plane.
fn check_all_round(alpha_rad: &[f64], directions: &[[f64; 2]], null: &[f64], checks: &mut Checks) {
    // If all are in one half-plane, the finding names one between the others.
    let between = |k: &usize| {
        let sides = || directions.iter().map(|e| cross(directions[*k], *e));
        sides().any(|side| side > 0.0) && sides().any(|side| side < 0.0)
    };
    let all = 0..directions.len();
    let idle = match all.clone().all(|k| null[k] == 0.0) {
        true => Some(all.clone().find(between).unwrap_or(0)),
        false => all.clone().find(|k| null[*k] <= 0.0),
    };
    if let Some(k) = idle {
        let wanted = "magnets all round the rotor (magnets only pull, and these lie within a half-plane)";
        checks.number(false, alpha_name(k), (alpha_rad[k], "rad"), wanted);
    }
}
