//! Modulation of the smallest force, which makes λ identifiable without moving the rotor.
//!
//! Forces along a null vector of P(3) cancel on the rotor, so the smallest force of a bearing, or of each opposed pair of magnets, can
//! vary without moving it:
//!
//! ```text
//! min F_k = F_0 (1 + a sin 2πφ)        φ = f t
//! ```
//!
//! `a` is `F0.modulation`; `f` is `F0.modulationFrequency`, one per null vector; t starts at the first sample. For current drive t is the
//! middle of the interval over which the currents are held, for voltage drive the instant at which they are reached. The varying
//! currents make λ identifiable where the reference trajectory alone does not, for instance with the rotor at rest. While λ is
//! wrong, the forces do not cancel exactly, and the rotor moves slightly.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use super::{TrackingConfig, TrackingState};
use crate::bearing::Drive;
use crate::control::controller::Controller;
use crate::control::phase::Phase;
use crate::invalid::{Checks, Short};
use crate::machine::Machine;

/// Modulation of the smallest force, or of the bias, of one group of magnets.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Excitation {
    /// `1 + a sin 2πφ` at the last sample.
    pub factor: f64,
    /// φ, in revolutions, in [0, 1) when f changes, and f, in Hz.
    pub phase: Phase,
}

/// Checks the frequencies of the modulation.
pub(in crate::control) fn check<const K: usize, const G: usize>(
    &TrackingConfig { step_s, modulation_hz, .. }: &TrackingConfig<K, G>,
    machine: &Machine,
    checks: &mut Checks,
) {
    let highest_hz = 0.5 / step_s;
    let wanted = format!("a finite number above 0, at most half the sample rate ({} Hz)", Short(highest_hz));
    for (name, hz) in machine.of_groups("F0.modulationFrequency").into_iter().zip(modulation_hz) {
        checks.number(hz <= highest_hz, name, (hz, "Hz"), wanted.clone());
    }
}

/// Revolutions, 0 or above, modulo 1.
fn wrapped(revolutions: f64) -> f64 {
    revolutions - libm::floor(revolutions)
}

impl<const N: usize, const K: usize, const B: usize, const G: usize> Controller<N, K, B, G> {
    /// `1 + a sin 2πφ` in group g for the force commanded at this sample.
    pub(super) fn modulate(&self, state: &mut TrackingState<N, K, G>, g: usize) -> f64 {
        let TrackingConfig { modulation, step_s, .. } = self.config.law;
        let frequency_hz = self.config.law.modulation_hz[g];
        let samples = state.samples;
        let excitation = &mut state.excitation[g];
        if frequency_hz != excitation.phase.rate {
            // f changes after the last commanded force. The first one is for the middle of the interval of held currents, or for the end of that of held
            // voltages.
            let ahead = if self.config.law.coil.drive == Drive::Current { 1.5 } else { 2.0 };
            let (base, base_sample) = match samples.checked_sub(1) {
                Some(last) => (wrapped(excitation.phase.at(last, step_s)), last),
                None => (wrapped(frequency_hz * (ahead * step_s)), 0),
            };
            excitation.phase = Phase { base, base_sample, rate: frequency_hz };
        }
        let phase_rev = wrapped(excitation.phase.at(samples, step_s));
        excitation.factor = if modulation == 0.0 { 1.0 } else { 1.0 + modulation * libm::sin(TAU * phase_rev) };
        excitation.factor
    }
}
