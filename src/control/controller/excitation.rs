//! Modulation of the smallest force, which makes λ identifiable without moving the rotor.
//!
//! Forces along the null vector of P(3) cancel on the rotor, so the smallest force can vary without moving it:
//!
//! ```text
//! min F_k = F_0 (1 + a sin 2πφ)        φ = f t
//! ```
//!
//! `a` is `F0.modulation`, `f` is `F0.modulationFrequency`, t starts at the first sample. For current drive t is the middle of
//! the interval over which the currents are held, for voltage drive the instant at which they are reached. The varying currents
//! make λ identifiable where the reference trajectory alone does not, for instance with the rotor at rest. While λ is wrong,
//! the forces do not cancel exactly, and the rotor moves a little.

use std::f64::consts::TAU;

use super::{Controller, ControllerConfig, ControllerState};
use crate::bearing::coil::Drive;
use crate::invalid::{Checks, Invalid};

/// Checks a modulation; a sample time that is itself refused restricts no frequency.
pub(super) fn check(modulation: f64, modulation_hz: f64, step_s: f64, checks: &mut Checks) {
    checks.require((0.0..=1.0).contains(&modulation), "F0.modulation", modulation, "a fraction of F0 from 0 to 1");
    let highest_hz = if step_s.is_finite() && step_s > 0.0 { 0.5 / step_s } else { f64::INFINITY };
    checks.require(
        modulation_hz.is_finite() && modulation_hz > 0.0 && modulation_hz <= highest_hz,
        "F0.modulationFrequency",
        format_args!("{modulation_hz} Hz"),
        format!("a finite number above 0, at most half the sample rate ({highest_hz} Hz)"),
    );
}

/// Revolutions, 0 or above, modulo 1.
fn wrapped(revolutions: f64) -> f64 {
    revolutions - libm::floor(revolutions)
}

impl Controller {
    /// Changes the modulation of the smallest force: `modulation` as a fraction of `F_0`, its frequency in Hz.
    ///
    /// The phase is continuous.
    ///
    /// # Errors
    /// `F0.modulation` outside 0 to 1; `F0.modulationFrequency` unless it is above 0 and at most half the sample rate. The
    /// former values then remain.
    pub fn retune(&mut self, modulation: f64, modulation_hz: f64) -> Result<(), Vec<Invalid>> {
        let mut checks = Checks::default();
        check(modulation, modulation_hz, self.config.step_s, &mut checks);
        checks.finish()?;
        (self.config.modulation, self.config.modulation_hz) = (modulation, modulation_hz);
        Ok(())
    }

    /// `1 + a sin 2πφ` for the force commanded at this sample.
    pub(super) fn modulate(&self, state: &mut ControllerState) -> f64 {
        let ControllerConfig { modulation, modulation_hz, step_s, .. } = self.config;
        // Count × step, so that φ does not drift.
        let phase_rev = |state: &ControllerState, sample: u64| {
            wrapped(state.base_rev + state.modulation_hz * ((sample - state.base_sample) as f64 * step_s))
        };
        if modulation_hz != state.modulation_hz {
            // f changes after the last commanded force.
            (state.base_rev, state.base_sample) = match state.samples.checked_sub(1) {
                Some(last) => (phase_rev(state, last), last),
                None => (self.first_phase_rev(), 0),
            };
            state.modulation_hz = modulation_hz;
        }
        if modulation == 0.0 {
            return 1.0;
        }
        1.0 + modulation * libm::sin(TAU * phase_rev(state, state.samples))
    }

    /// φ of the force that the first sample commands, in revolutions.
    pub(super) fn first_phase_rev(&self) -> f64 {
        wrapped(self.config.modulation_hz * self.ahead_s())
    }

    /// Time from a sample to the instant for which its force is computed, in s: the middle of held currents, the end of
    /// voltages.
    fn ahead_s(&self) -> f64 {
        let samples = match self.config.coil.drive {
            Drive::Current => 1.5,
            Drive::Voltage => 2.0,
        };
        samples * self.config.step_s
    }
}
