//! The numbers that the equations are written for: `f64`, and truncated Taylor series of it for exact derivatives.
//!
//! The equations of geometry, coil, backup bearing and rotor stand once, generic over [`Scalar`]. With `f64` they give values
//! and integrate the motion; with [`Taylor`](crate::plant::linearisation::Taylor) they give derivatives along a line.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A real number, or one that changes along a line.
///
/// Comparisons in the equations go by [`value`](Scalar::value): a derivative belongs to the branch in which the value is.
/// Functions are not named like the methods of `f64`, which call the platform's where the code is not generic.
pub trait Scalar:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Mul<f64, Output = Self>
{
    /// Newton iterations after the value has converged until the derivatives have as well; each doubles the number of
    /// coefficients that are right.
    const POLISHING: u32;

    /// A number without derivatives.
    fn constant(value: f64) -> Self;

    /// The number itself.
    fn value(self) -> f64;

    /// Whether the number is 0 and has no derivatives either, so that a term with it may be left out.
    fn is_zero(self) -> bool;

    /// The sine of an angle in rad.
    fn sine(self) -> Self;

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

    fn sine(self) -> Self {
        libm::sin(self)
    }

    fn sine_cosine(self) -> (Self, Self) {
        libm::sincos(self)
    }

    fn norm(self, other: Self) -> Self {
        libm::hypot(self, other)
    }
}
