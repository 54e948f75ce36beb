//! The second-order low-pass of P(20), for all channels at once.

use serde::{Deserialize, Serialize};

use super::Channels;

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

/// The filtered quantities and their rates (per second), all zero at the start.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LowPassState {
    pub value: Channels,
    rate: Channels,
}

impl LowPass {
    /// The filter with natural frequency `omega_rad_s`, damping ratio `zeta` and sample time `step_s`, all positive.
    pub fn new(omega_rad_s: f64, zeta: f64, step_s: f64) -> Self {
        let (w, t) = (omega_rad_s, step_s);
        let damping = zeta * w * t + w * w * t * t / 4.0;
        Self { rate_decay: (1.0 - damping) / (1.0 + damping), gain: w * w * t / (1.0 + damping), half_step_s: t / 2.0 }
    }

    /// One step with the input `x`.
    pub fn step(&self, state: &mut LowPassState, x: &Channels) {
        let error = x.with(&state.value, |x, y| x - y);
        let rate = state.rate.with(&error, |v, error| self.rate_decay * v + self.gain * error);
        let change = state.rate.with(&rate, |v, rate| self.half_step_s * (v + rate));
        *state = LowPassState { value: state.value.with(&change, |y, change| y + change), rate };
    }
}
