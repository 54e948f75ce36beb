//! Sampled observers of chains of integrators, with gains by pole placement for the sampled system.
//!
//! The prediction between samples is exact: a position whose highest derivative is constant follows a polynomial. The measurement
//! corrects the estimate at its own instant ("current" observer):
//!
//! ```text
//! x⁻_{k+1} = A x_k + B u_k
//! x_k      = x⁻_k + L (measured_k − x⁻_k[0])
//! ```
//!
//! The error of `x_k` is governed by `(I − L C) A`. With all poles at ρ = exp(−ω T_s), for the bandwidth ω and the sample time T_s,
//! the gains are those of the fading-memory polynomial filters.

use crate::bearing::array;

/// Gains L for a chain of three, `[x, x', x'']`, with all three poles at `exp(−bandwidth · step)`.
///
/// `[1 − ρ³, (3/2)(1 − ρ²)(1 − ρ)/T_s, (1 − ρ)³/T_s²]`, in 1, 1/s and 1/s².
pub fn gains_of_three(bandwidth_rad_s: f64, step_s: f64) -> [f64; 3] {
    let (rho, q) = pole(bandwidth_rad_s, step_s);
    [q * (1.0 + rho + rho * rho), 1.5 * q * q * (1.0 + rho) / step_s, q * q * q / (step_s * step_s)]
}

/// Gains L for a chain of four, `[x, x', x'', x''']`, with all four poles at `exp(−bandwidth · step)`.
///
/// `[1 − ρ⁴, (1 − ρ)²(11 + 14ρ + 11ρ²)/(6 T_s), 2(1 − ρ)³(1 + ρ)/T_s², (1 − ρ)⁴/T_s³]`.
pub fn gains_of_four(bandwidth_rad_s: f64, step_s: f64) -> [f64; 4] {
    let (rho, q) = pole(bandwidth_rad_s, step_s);
    [
        q * (1.0 + rho) * (1.0 + rho * rho),
        q * q * (11.0 + 14.0 * rho + 11.0 * rho * rho) / (6.0 * step_s),
        2.0 * q * q * q * (1.0 + rho) / (step_s * step_s),
        q * q * q * q / (step_s * step_s * step_s),
    ]
}

/// `(ρ, 1 − ρ)` for `ρ = exp(−ω T_s)`, the difference without cancellation.
pub(crate) fn pole(bandwidth_rad_s: f64, step_s: f64) -> (f64, f64) {
    (libm::exp(-bandwidth_rad_s * step_s), -libm::expm1(-bandwidth_rad_s * step_s))
}

/// Observer of one axis: position, velocity and perturbation of a mass under a known force.
///
/// Its estimate is `[x, v, d]` in `[m, m/s, m/s²]`, with the perturbation per mass `d = p/m`, P(6) and P(7), positive along the
/// axis. The perturbation is assumed constant between samples; a varying one is tracked with the lag of the observer's poles.
#[derive(Clone, Debug, PartialEq)]
pub struct PerturbationObserver {
    step_s: f64,
    gains: [f64; 3],
}

/// Estimate of a [`PerturbationObserver`]: `[x, v, d]` in `[m, m/s, m/s²]`.
pub type Estimate = [f64; 3];

impl PerturbationObserver {
    /// An observer with a triple pole at `exp(−bandwidth · step)`; both arguments finite and above 0.
    pub fn new(bandwidth_rad_s: f64, step_s: f64) -> Self {
        Self { step_s, gains: gains_of_three(bandwidth_rad_s, step_s) }
    }

    /// The estimate one sample later, under the acceleration `force/m`, in m/s², held in between.
    pub fn predict(&self, estimate: Estimate, acceleration_m_s2: f64) -> Estimate {
        self.predict_by(estimate, acceleration_m_s2, self.step_s)
    }

    /// The estimate `ahead_s` later, under the acceleration `force/m`, in m/s², held in between.
    pub fn predict_by(&self, [x, v, d]: Estimate, acceleration_m_s2: f64, ahead_s: f64) -> Estimate {
        let a = acceleration_m_s2 + d;
        [x + ahead_s * (v + 0.5 * ahead_s * a), v + ahead_s * a, d]
    }

    /// The estimate one sample later, under `force/m` in m/s² that varies linearly between two values.
    pub fn predict_ramp(&self, [x, v, d]: Estimate, from_m_s2: f64, to_m_s2: f64) -> Estimate {
        let h = self.step_s;
        let [a, b] = [from_m_s2 + d, to_m_s2 + d];
        [x + h * (v + h * (a / 3.0 + b / 6.0)), v + 0.5 * h * (a + b), d]
    }

    /// The estimate predicted for the instant of the measurement, corrected by the measured position in m.
    pub fn update(&self, [x, v, d]: Estimate, position_m: f64) -> Estimate {
        let [l_1, l_2, l_3] = self.gains;
        let innovation = position_m - x;
        [x + l_1 * innovation, v + l_2 * innovation, d + l_3 * innovation]
    }
}

/// Observer of a sampled signal and its first three derivatives, for external references.
///
/// Its estimate is `[r, r', r'', r''']` in `[m, m/s, m/s², m/s³]`. It tracks polynomials up to degree 3 without lag once the
/// initial transient has decayed; the derivatives are consistent with each other.
#[derive(Clone, Debug, PartialEq)]
pub struct SignalObserver {
    step_s: f64,
    gains: [f64; 4],
}

/// Estimate of a [`SignalObserver`]: `[r, r', r'', r''']` in `[m, m/s, m/s², m/s³]`.
pub type Signal = [f64; 4];

/// The signal `h`, in s, later, by Taylor's formula.
pub(super) fn ahead([r, v, a, j]: Signal, h: f64) -> Signal {
    [r + h * (v + h / 2.0 * (a + h / 3.0 * j)), v + h * (a + h / 2.0 * j), a + h * j, j]
}

impl SignalObserver {
    /// An observer with four poles at `exp(−bandwidth · step)`; both arguments finite and above 0.
    pub fn new(bandwidth_rad_s: f64, step_s: f64) -> Self {
        Self { step_s, gains: gains_of_four(bandwidth_rad_s, step_s) }
    }

    /// The estimate at a sample, from the previous estimate and the value at this sample in m.
    pub fn update(&self, previous: Signal, value_m: f64) -> Signal {
        let predicted = ahead(previous, self.step_s);
        let innovation = value_m - predicted[0];
        array::from_fn(|j| predicted[j] + self.gains[j] * innovation)
    }
}
