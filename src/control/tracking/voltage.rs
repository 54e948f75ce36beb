//! Voltage drive: feedback of the acceleration, and the current loop.
//!
//! The measured currents give the state of the coils at `t_k`; the voltages in effect, limited like those of the amplifiers, predict
//! it at `t_{k+1}`. So the force of each magnet is known at the sample instants and is nearly linear in between. Sample k selects the
//! acceleration at `t_{k+2}` by feedback of position, velocity and acceleration predicted for `t_{k+1}`:
//!
//! ```text
//! q̈_{k+2} = q̈*_{k+2} − k_0 (q − q*)_{k+1} − k_1 (q̇ − q̇*)_{k+1} − k_2 (q̈ − q̈*)_{k+1}
//! ```
//!
//! which places the poles of the double integrator with piecewise linear input at ρ, ρ and 0. The voltages follow from the currents
//! `i*` for these forces as the mean of `u = R i + d(L i)/dt` over `[t_{k+1}, t_{k+2})`, including the change of L with the gap (the
//! speed voltage); the current error at `t_{k+1}` decays by `ρ_i = exp(−ω_i T_s)` per sample:
//!
//! ```text
//! i_{k+2} = i*_{k+2} + ρ_i (i − i*)_{k+1}
//! ```
//!
//! There is no integrator windup when the amplifiers saturate: the integral action of the loop is the perturbation observer, which
//! uses the forces of the actual currents, not the commanded ones.

use super::{Preview, TrackingState};
use crate::bearing::coil::CoilConfig;
use crate::bearing::{array, magnet};
use crate::control::controller::{Controller, ControllerInput, ControllerOutput};
use crate::control::observer::{Estimate, pole};

/// `[k_0, k_1, k_2]`, in 1/s², 1/s and 1, that place the poles of the double integrator with piecewise linear input at
/// `ρ = exp(−ω T_s)`, ρ and 0.
///
/// `k_0 = (1 − ρ)²/T_s²`, `k_1 = 2(1 − ρ)/T_s`, `k_2 = (1 − ρ) − (1 − ρ)²/6`.
pub fn ramp_gains(bandwidth_rad_s: f64, step_s: f64) -> [f64; 3] {
    let (_, q) = pole(bandwidth_rad_s, step_s);
    [q * q / (step_s * step_s), 2.0 * q / step_s, q - q * q / 6.0]
}

impl<const N: usize, const K: usize, const B: usize, const G: usize> Controller<N, K, B, G> {
    /// Voltages to hold over the sample time that begins at the next sample; the currents and gaps are those of this sample.
    #[inline]
    pub(super) fn voltages(
        &self,
        state: &mut TrackingState<N, K, G>,
        estimate: &[Estimate; N],
        measured: &ControllerInput<N, K>,
        gap_m: [f64; K],
        level: [f64; G],
        [_, begin, end]: &Preview<N>,
    ) -> ControllerOutput<N, K> {
        let m = self.inertia;
        let step_s = self.config.law.step_s;
        let CoilConfig { resistance_ohm, limit_v, .. } = self.config.law.coil;
        let geometry = self.rotor.geometry();
        let gyroscopic = |rates| self.gyroscopic(measured.omega_rad_s, rates);
        let current_a = measured.current_a;
        let lambda = state.lambda_nm2_a2;
        let inductance =
            |k: usize, gap_m: f64| self.config.law.coil.of(lambda[k], geometry.gap_m[k]).inductance_h(gap_m);
        let to_acceleration =
            |force: [f64; N], moment: [f64; N]| -> [f64; N] { array::from_fn(|a| (force[a] + moment[a]) / m[a]) };

        // For the positions at the next sample the forces are constant: their change moves the rotor by less than the rounding of a gap.
        let now =
            to_acceleration(geometry.resultant(state.in_effect_n), gyroscopic(array::from_fn(|a| estimate[a][1])));
        let next: [Estimate; N] = array::from_fn(|a| self.observer.predict(estimate[a], now[a]));
        let next_gap_m = self.limited(geometry.gaps(array::map(next, |[x, ..]| x)));
        // ψ' = u − R i with the mean of the currents at the ends of the interval.
        let half = 0.5 * step_s * resistance_ohm;
        let next_a: [f64; K] = array::from_fn(|k| {
            let linkage = inductance(k, gap_m[k]) * current_a[k] + step_s * state.voltage_v[k] - half * current_a[k];
            linkage / (inductance(k, next_gap_m[k]) + half)
        });
        let next = to_acceleration(
            geometry.resultant(magnet::forces(lambda, next_a, next_gap_m)),
            gyroscopic(array::map(next, |[_, v, _]| v)),
        );

        let [k_0, k_1, k_2] = self.ramp_gains;
        let mut acceleration = [0.0; N];
        for a in 0..N {
            let expected = self.observer.predict_ramp(estimate[a], now[a], next[a]);
            let [x, v, d] = expected;
            let ([x_0, v_0, a_0], [.., a_1]) = (begin[a], end[a]);
            acceleration[a] = a_1 - k_2 * (next[a] + d - a_0) - k_1 * (v - v_0) - k_0 * (x - x_0);
            state.expected[a] = expected;
        }
        let last: [Estimate; N] = array::from_fn(|a| {
            let [_, _, d] = state.expected[a];
            self.observer.predict_ramp(state.expected[a], next[a], acceleration[a] - d)
        });
        let moment = gyroscopic(array::map(last, |[_, v, _]| v));
        let planned_a = state.planned_a;
        let (command, last_gap_m) = self.command_at(state, acceleration, moment, level, array::map(last, |[x, ..]| x));
        state.planned_a = command.current_a;
        let wanted_v: [f64; K] = array::from_fn(|k| {
            let last_a = (command.current_a[k] + self.decay * (next_a[k] - planned_a[k])).max(0.0);
            let change = inductance(k, last_gap_m[k]) * last_a - inductance(k, next_gap_m[k]) * next_a[k];
            change / step_s + 0.5 * resistance_ohm * (last_a + next_a[k])
        });
        let voltage_v = array::map(wanted_v, |u| u.clamp(-limit_v, limit_v));
        state.voltage_v = voltage_v;
        ControllerOutput { voltage_v, limited: voltage_v != wanted_v, ..command }
    }
}
