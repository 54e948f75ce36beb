//! The number type of the equations: `f64`, or truncated Taylor series for exact derivatives.
//!
//! The equations of geometry, coil, backup bearing and rotor are written once, generic over [`Scalar`]: `f64` gives values,
//! for the integration of the motion, and [`Taylor`](crate::plant::linearisation::Taylor) gives derivatives along a line.

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A real number, or a Taylor series along a line.
///
/// Comparisons in the equations use [`value`](Scalar::value): the value selects the branch, for the derivatives too.
/// The functions are not named like the methods of `f64`, which would call the platform's functions in non-generic code.
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
    /// Newton iterations that the derivatives need after the value has converged; each doubles the number of correct
    /// coefficients.
    const POLISHING: u32;

    /// A number without derivatives.
    fn constant(value: f64) -> Self;

    /// The value.
    fn value(self) -> f64;

    /// Whether the value and all derivatives are 0, so that terms with this factor may be skipped.
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

/// Combines two structures: scalars and arrays element by element, all other fields as given.
macro_rules! joined {
    ($own:expr, $other:expr, $join:expr, $type:ident {
        $($scalar:ident),*; $($list:ident),*; $($rest:ident: $value:expr),*
    }) => {{
        let (own, other, join) = ($own, $other, $join);
        $type {
            $($scalar: join(own.$scalar, other.$scalar),)*
            $($list: $crate::bearing::array::each(&own.$list, &other.$list, &join),)*
            $($rest: $value,)*
        }
    }};
}

pub(crate) use joined;
