//! Coordinates of a rigid rotor: a shaft in two radial bearings, with or without an axial one, or a rotor that does not tilt.
//!
//! ```text
//! q = (x, y, z, β, γ), (y, z, β, γ), (y, z) or x    centre of gravity, in m; rotations about y and z, in rad
//! y(ξ) = y + ξ γ     z(ξ) = z − ξ β        point of the axis, ξ along the shaft from the centre of gravity
//! M_β = −ξ F_z       M_γ = ξ F_y           moments of a force at ξ
//! m ẍ = F_x     m ÿ = F_y     m z̈ = F_z
//! J_t β̈ = M_β − J_p Ω γ̇                    Ω about x, from y towards z
//! J_t γ̈ = M_γ + J_p Ω β̇
//! ```
//!
//! β and γ are small. With the complex coordinates `u = y + i z` and `ψ = γ − i β`, the displacement is `u + ξ ψ` and the rotation obeys
//! `J_t ψ̈ − i J_p Ω ψ̇ = M_γ − i M_β`: solutions that turn in the direction of Ω are forward whirls.

use serde::{Deserialize, Serialize};

use crate::bearing::{Scalar, array};
use crate::machine::Machine;
use crate::variables::Variables;
use crate::variables::unit::{KILOGRAM, KILOGRAM_METRE2};

/// Number of lateral coordinates of a shaft, (y, z, β, γ). With an axial bearing x precedes them, and N is 5.
pub const ACROSS: usize = 4;

/// Inertia of a rotor; moments of inertia only if it tilts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64, context = Machine)]
pub struct Shaft<T = f64> {
    /// Mass of the rotor
    #[parameter(name = "m", unit = KILOGRAM, above = 0.0)]
    pub m_kg: T,
    /// Moment of inertia of the rotor about an axis across the shaft through the centre of gravity
    #[parameter(name = "Jt", count = context.if_tilting(1), unit = KILOGRAM_METRE2, above = 0.0, nominal = 0.1)]
    pub transverse_kgm2: T,
    /// Moment of inertia of the rotor about its axis, at most 2 Jt
    #[parameter(name = "Jp", count = context.if_tilting(1), unit = KILOGRAM_METRE2, min = 0.0, nominal = 0.1)]
    pub polar_kgm2: T,
}

impl<T: Scalar> Shaft<T> {
    /// The mass or moment of inertia for each coordinate, in kg or kg·m².
    #[inline]
    pub fn inertia<const N: usize>(&self) -> [T; N] {
        joined(self.m_kg, [self.m_kg, self.m_kg, self.transverse_kgm2, self.transverse_kgm2])
    }

    /// The gyroscopic moments `−Ω G q̇`, in N·m, at the speed Ω in rad/s and the rates q̇ in m/s and rad/s; `None` without tilt.
    #[inline]
    pub fn gyroscopic<const N: usize>(&self, omega_rad_s: T, rates: [T; N]) -> Option<[T; N]> {
        if N < ACROSS {
            return None;
        }
        let [zero, spin] = [T::constant(0.0), self.polar_kgm2 * omega_rad_s];
        let [_, _, beta, gamma] = across(rates);
        Some(joined(zero, [zero, zero, -(spin * gamma), spin * beta]))
    }
}

/// Whether x is one of the N coordinates, in which case it is the first.
pub const fn has_x<const N: usize>() -> bool {
    const { assert!(N == 1 || N == 2 || N == ACROSS || N == ACROSS + 1, "x, (y, z), (y, z, β, γ) or (x, y, z, β, γ)") };
    N == 1 || N == ACROSS + 1
}

/// The lateral ones of a shaft's coordinates, or of quantities per coordinate.
#[inline]
pub fn across<T: Copy, const N: usize>(q: [T; N]) -> [T; ACROSS] {
    array::from_fn(|a| q[N - ACROSS + a])
}

/// All coordinates, or quantities per coordinate, from x and the lateral ones.
#[inline]
fn joined<T: Copy, const N: usize>(x: T, across: [T; ACROSS]) -> [T; N] {
    let first = usize::from(has_x::<N>());
    array::from_fn(|a| if a < first { x } else { across[a - first] })
}

/// Displacement (y, z) of the axis at ξ in m, for coordinates or their rates; (x, 0) for a rotor that only moves axially.
#[inline]
pub fn displacement<T: Scalar, const N: usize>(at_m: T, q: [T; N]) -> [T; 2] {
    if N < ACROSS {
        return array::from_fn(|n| if n < N { q[n] } else { T::constant(0.0) });
    }
    let [y, z, beta, gamma] = across(q);
    [y + at_m * gamma, z - at_m * beta]
}

/// The coordinates, or their rates, of a shaft at the axial position x with the displacements (y, z) at two positions ξ in m.
#[inline]
pub fn through<const N: usize>(x: f64, at_m: [f64; 2], [[y_1, z_1], [y_2, z_2]]: [[f64; 2]; 2]) -> [f64; N] {
    let length_m = at_m[1] - at_m[0];
    let [gamma, minus_beta] = [(y_2 - y_1) / length_m, (z_2 - z_1) / length_m];
    joined(x, [y_1 - at_m[0] * gamma, z_1 - at_m[0] * minus_beta, -minus_beta, gamma])
}

/// The forces (F_y, F_z), in N, at two positions ξ in m that are equivalent to a generalised force, without its axial part.
#[inline]
pub fn shared<const N: usize>(at_m: [f64; 2], force: [f64; N]) -> [[f64; 2]; 2] {
    let [y, z, beta, gamma] = across(force);
    let length_m = at_m[1] - at_m[0];
    let [y_2, z_2] = [(gamma - at_m[0] * y) / length_m, (-beta - at_m[0] * z) / length_m];
    [[y - y_2, z - z_2], [y_2, z_2]]
}

/// The generalised force of a force (F_y, F_z) at ξ, in N and N·m.
#[inline]
pub fn generalised<T: Scalar, const N: usize>(at_m: T, [y, z]: [T; 2]) -> [T; N] {
    joined(T::constant(0.0), [y, z, -(at_m * z), at_m * y])
}

/// The generalised force of an axial force, in N.
#[inline]
pub fn along<T: Scalar, const N: usize>(x: T) -> [T; N] {
    let zero = T::constant(0.0);
    if has_x::<N>() { joined(x, [zero; ACROSS]) } else { [zero; N] }
}
