//! The second-order low-pass of P(20), for many channels at once.

use nalgebra::SVector;
use serde::{Deserialize, Serialize};

/// `F(s) = ω_n²/(s² + 2 ζ ω_n s + ω_n²)`, discretised by the trapezoidal rule.
///
/// The rule keeps F stable for every step, ω_n > 0 and ζ > 0, and its gain at rest is exactly one. The input counts
/// as its value over the whole step that ends now; only ratios of outputs are used, so that half a step of phase
/// is of no consequence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LowPass {
    /// `(1 − ζωT − ω²T²/4)/(1 + ζωT + ω²T²/4)`: how much of the rate survives a step.
    keep: f64,
    /// `ω² T/(1 + ζωT + ω²T²/4)`, in 1/s.
    drive: f64,
    /// T/2, in s.
    half_step_s: f64,
}

/// Outputs and their rates (per second) of `N` channels, all zero at the start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LowPassState<const N: usize> {
    /// The filtered values, in the units of the inputs.
    pub value: SVector<f64, N>,
    /// Their rates, per second.
    pub rate: SVector<f64, N>,
}

impl<const N: usize> Default for LowPassState<N> {
    fn default() -> Self {
        Self { value: SVector::zeros(), rate: SVector::zeros() }
    }
}

impl LowPass {
    /// The filter with natural frequency `omega_rad_s`, damping ratio `zeta` and sample time `step_s`, all positive.
    #[must_use]
    pub fn new(omega_rad_s: f64, zeta: f64, step_s: f64) -> Self {
        let (w, t) = (omega_rad_s, step_s);
        let loss = zeta * w * t + w * w * t * t / 4.0;
        Self { keep: (1.0 - loss) / (1.0 + loss), drive: w * w * t / (1.0 + loss), half_step_s: t / 2.0 }
    }

    /// One step with the input `x`.
    pub fn step<const N: usize>(&self, state: &mut LowPassState<N>, x: &SVector<f64, N>) {
        for ((y, v), x) in state.value.iter_mut().zip(state.rate.iter_mut()).zip(x.iter()) {
            let rate = self.keep * *v + self.drive * (x - *y);
            *y += self.half_step_s * (*v + rate);
            *v = rate;
        }
    }
}
