//! The second-order low-pass of P(20), for many channels at once.

use nalgebra::SVector;
use serde::{Deserialize, Serialize};

/// `F(s) = ω_n²/(s² + 2 ζ ω_n s + ω_n²)`, discretised by the trapezoidal rule.
///
/// F is stable for every step, ω_n > 0 and ζ > 0, and its DC gain is exactly one. The input is taken as constant over the step that ends now; the phase
/// error of half a step has no effect because only ratios of outputs are used.
#[derive(Clone, Debug, PartialEq)]
pub struct LowPass {
    /// `(1 − ζωT − ω²T²/4)/(1 + ζωT + ω²T²/4)`: factor of the rate per step.
    rate_decay: f64,
    /// `ω² T/(1 + ζωT + ω²T²/4)`, in 1/s.
    gain: f64,
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
    pub fn new(omega_rad_s: f64, zeta: f64, step_s: f64) -> Self {
        let (w, t) = (omega_rad_s, step_s);
        let damping = zeta * w * t + w * w * t * t / 4.0;
        Self { rate_decay: (1.0 - damping) / (1.0 + damping), gain: w * w * t / (1.0 + damping), half_step_s: t / 2.0 }
    }

    /// One step with the input `x`.
    pub fn step<const N: usize>(&self, state: &mut LowPassState<N>, x: &SVector<f64, N>) {
        for ((y, v), x) in state.value.iter_mut().zip(state.rate.iter_mut()).zip(x.iter()) {
            let rate = self.rate_decay * *v + self.gain * (x - *y);
            *y += self.half_step_s * (*v + rate);
            *v = rate;
        }
    }
}
