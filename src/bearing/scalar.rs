//! The number type of the equations: `f64`, or truncated Taylor series for exact derivatives.
//!
//! The equations of geometry, coil, backup bearing and rotor are written once, generic over [`Scalar`]. With `f64` they give
//! values and integrate the motion; with [`Taylor`](crate::plant::linearisation::Taylor) they give derivatives along a line.

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A real number, or one that changes along a line.
///
/// Comparisons in the equations use [`value`](Scalar::value): a derivative belongs to the branch that the value takes.
/// Functions have other names than the methods of `f64`, which call the platform's functions in code that is not generic.
pub trait Scalar:
    Copy
    + Debug
    + PartialEq
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Mul<f64, Output = Self>
{
    /// Newton iterations needed after the value has converged for the derivatives to converge; each one doubles the number of
    /// correct coefficients.
    const POLISHING: u32;

    /// A number without derivatives.
    fn constant(value: f64) -> Self;

    /// The value.
    fn value(self) -> f64;

    /// Whether the value and all derivatives are 0, so that a term with it may be left out.
    fn is_zero(self) -> bool;

    /// Sine and cosine of an angle in rad.
    fn sine_cosine(self) -> (Self, Self);

    /// `√(x² + y²)`, without overflow.
    fn norm(self, other: Self) -> Self;
}

impl Scalar for f64 {
    const POLISHING: u32 = 0;

    #[inline]
    fn constant(value: f64) -> Self {
        value
    }

    #[inline]
    fn value(self) -> f64 {
        self
    }

    #[inline]
    fn is_zero(self) -> bool {
        self == 0.0
    }

    fn sine_cosine(self) -> (Self, Self) {
        libm::sincos(self)
    }

    fn norm(self, other: Self) -> Self {
        libm::hypot(self, other)
    }
}

/// Two arrays combined number by number.
#[inline]
pub(crate) fn each<T: Copy, U: Copy, V, const N: usize>(own: &[T; N], off: &[U; N], f: impl Fn(T, U) -> V) -> [V; N] {
    std::array::from_fn(|k| f(own[k], off[k]))
}

/// A structure made of two others: scalars and arrays combined number by number, then all other fields as given.
macro_rules! joined {
    ($own:expr, $other:expr, $join:expr, $type:ident {
        $($scalar:ident),*; $($list:ident),*; $($rest:ident: $value:expr),*
    }) => {{
        let (own, other, join) = ($own, $other, $join);
        $type {
            $($scalar: join(own.$scalar, other.$scalar),)*
            $($list: $crate::bearing::scalar::each(&own.$list, &other.$list, &join),)*
            $($rest: $value,)*
        }
    }};
}

pub(crate) use joined;
