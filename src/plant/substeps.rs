//! Integration over a part of a step: sub-steps, their length, and where contact begins and ends.

use std::cell::Cell;

use super::{
    Conditions, InputTrajectory, Motion, Plant, PlantInput, PlantState, ROUNDING_TOLERANCE, SHORTEST_STEP_S, StepError,
    Turn,
};
use crate::bearing::coil::Drive;
use crate::plant::integration::{rk4, substeps};

/// A sub-step is at most this part of the reciprocal of the fastest rate of the model.
///
/// The error of a step of the Runge–Kutta method is then about `SAFETY⁵/120`, a ten millionth, of what decays or oscillates at
/// that rate.
pub const SAFETY: f64 = 0.1;

/// The most parts that one call integrates over; some seconds of computing.
pub const MOST_PARTS: usize = 3_000_000;

/// How many meetings with the backup bearing are located within one sub-step; further ones are stepped across.
const MOST_CROSSINGS: usize = 8;

/// Halvings by which such an instant is located: to a millionth of a millionth of the sub-step.
const HALVINGS: usize = 40;

impl Plant {
    /// Integrates over a part of a step, from one time over a length, that has no sample inside; the state then stands at
    /// its end.
    pub(super) fn integrate(
        &self,
        state: &mut PlantState,
        inputs: &InputTrajectory,
        (from_s, length_s, end_s): (f64, f64, f64),
        budget: &mut usize,
    ) -> Result<(), StepError> {
        let (from_s, length_s) = self.without_rounding(state, from_s, length_s);
        let evenly = inputs.turns_evenly();
        if !evenly || inputs.input.omega_rad_s != state.turn.omega_rad_s {
            let omega_rad_s = inputs.at(from_s).omega_rad_s;
            state.turn = Turn { base_rad: state.theta_rad, since_s: from_s, omega_rad_s };
        }
        let turned_rad = inputs.turned_rad(from_s);
        let theta_rad = |turn: &Turn, t: f64| {
            if evenly { turn.theta_rad(t) } else { turn.base_rad + (inputs.turned_rad(t) - turned_rad) }
        };
        let n = substeps(length_s, self.config().max_step_s);
        let h = length_s / n as f64;
        for k in 0..3 {
            if state.open[k] {
                state.linkage_wb[k] = 0.0;
            }
        }
        // Time, angle and force of the perturbation computed last: two of the four slopes of a sub-step are taken at one instant, and
        // the last one mostly where the next sub-step begins.
        let latest = Cell::new(None);
        for j in 0..n {
            let t = from_s + j as f64 * h;
            self.sub_step(state, inputs, (t, h), &theta_rad, &latest, budget)?;
            state.theta_rad = theta_rad(&state.turn, t + h);
        }
        state.time_s = end_s;
        state.theta_rad = theta_rad(&state.turn, from_s + length_s);
        if !evenly {
            // The next part begins with an angle and a speed of its own.
            let omega_rad_s = inputs.at(from_s + length_s).omega_rad_s;
            state.turn = Turn { base_rad: state.theta_rad, since_s: from_s + length_s, omega_rad_s };
        }
        Ok(())
    }

    /// Integrates over one sub-step from `t_s` over `h_s`, divided where the model is faster and where contact begins or
    /// ends.
    fn sub_step(
        &self,
        state: &mut PlantState,
        inputs: &InputTrajectory,
        (t_s, h_s): (f64, f64),
        theta_rad: &impl Fn(&Turn, f64) -> f64,
        latest: &Cell<Option<(f64, f64, [f64; 2])>>,
        budget: &mut usize,
    ) -> Result<(), StepError> {
        let mut done_s = 0.0;
        let mut crossings = 0;
        let held = inputs.slopes.is_none();
        while done_s < h_s || done_s == 0.0 {
            let x = state.motion();
            let [y, z, v_y, v_z, psi_1, psi_2, psi_3] = x;
            let left_s = h_s - done_s;
            let parts = substeps(left_s, self.longest_step_s(state, &inputs.at(t_s + done_s)));
            let mut part_s = if parts == 1 { left_s } else { left_s / parts as f64 };
            let now_s = t_s + done_s;
            *budget = budget.saturating_sub(1);
            if parts > *budget {
                state.time_s = now_s;
                return Err(StepError::Fast { time_s: now_s });
            }
            let step = |h_s: f64| {
                let turn = &state.turn;
                let slope = |t: f64, x: &Motion| {
                    let theta_rad = theta_rad(turn, t);
                    let conditions = Conditions { time_s: t, theta_rad, contact: state.contact, open: state.open };
                    if !held {
                        return self.equations.derivative(x, &inputs.at(t), conditions);
                    }
                    let perturbation_n = match latest.get() {
                        Some((at, angle, force)) if at == t && angle == theta_rad => force,
                        _ => self.equations.perturbation(&inputs.input, t, theta_rad),
                    };
                    latest.set(Some((t, theta_rad, perturbation_n)));
                    self.equations.derivative_under(x, &inputs.input, conditions, perturbation_n)
                };
                match self.config().coil.drive {
                    Drive::Voltage => rk4(x, now_s, h_s, slope),
                    Drive::Current => {
                        let [a, b, c, d] = rk4([y, z, v_y, v_z], now_s, h_s, |t, x| {
                            let [a, b, c, d, ..] = slope(t, &[x[0], x[1], x[2], x[3], psi_1, psi_2, psi_3]);
                            [a, b, c, d]
                        });
                        [a, b, c, d, psi_1, psi_2, psi_3]
                    }
                }
            };
            let touches = |x: &Motion| self.config().touchdown.touches([x[0], x[1]], [x[2], x[3]]);
            let mut next = step(part_s);
            if touches(&next) != state.contact && crossings < MOST_CROSSINGS {
                crossings += 1;
                let mut before_s = 0.0;
                for _ in 0..HALVINGS {
                    let middle_s = 0.5 * (before_s + part_s);
                    let middle = step(middle_s);
                    if touches(&middle) == state.contact {
                        before_s = middle_s;
                    } else {
                        (part_s, next) = (middle_s, middle);
                    }
                }
            }
            let inside = self.equations.gaps([next[0], next[1]]).iter().all(|gap| *gap > 0.0);
            if !(inside && next.iter().all(|value| value.is_finite())) {
                let gap_m = self.equations.gaps(state.position_m);
                let nearest = (0..3).fold(0, |k, other| if gap_m[other] < gap_m[k] { other } else { k });
                state.time_s = now_s;
                return Err(StepError::Contact { magnet: nearest + 1, time_s: now_s, position_m: state.position_m });
            }
            let contact = touches(&next);
            state.position_m = [next[0], next[1]];
            state.velocity_m_s = [next[2], next[3]];
            state.linkage_wb = [next[4], next[5], next[6]];
            state.contact = contact;
            done_s = if part_s == left_s { h_s } else { done_s + part_s };
            if h_s == 0.0 {
                break;
            }
        }
        Ok(())
    }

    /// [`SAFETY`] over the fastest rate of the model where it stands, in s.
    fn longest_step_s(&self, state: &PlantState, input: &PlantInput) -> f64 {
        let m = self.config().m_kg;
        let gap_m = self.equations.gaps(state.position_m);
        let mut rate: f64 = 0.0;
        let force_n = if self.equations.is_plain() {
            self.equations.forces(state.open, state.linkage_wb, input, gap_m)
        } else {
            let coils = self.equations.coils(state.open, state.linkage_wb, input, gap_m);
            for coil in &coils {
                rate = rate.max(self.config().coil.resistance_ohm * coil.current_by_linkage);
            }
            coils.map(|coil| coil.force_n)
        };
        let mut softness = 0.0;
        let mut least_m = f64::INFINITY;
        for k in 0..3 {
            softness += 2.0 * force_n[k] / gap_m[k];
            least_m = least_m.min(gap_m[k]);
        }
        rate = rate.max((softness / m).sqrt());
        let [v_y, v_z] = state.velocity_m_s;
        rate = rate.max((v_y * v_y + v_z * v_z).sqrt() / least_m);
        if state.contact {
            let ring = &self.config().touchdown;
            rate = rate.max(ring.rate(m, ring.push_n(state.position_m, state.velocity_m_s)));
        }
        (SAFETY / rate).max(SHORTEST_STEP_S)
    }

    /// Begin and length of a part, rounding removed: a begin at a sample instant is that instant, a length of
    /// one sensor step is that step.
    fn without_rounding(&self, state: &PlantState, from_s: f64, length_s: f64) -> (f64, f64) {
        let step_s = self.config().sensor.step_s;
        let rounding = ROUNDING_TOLERANCE * step_s;
        // Sample 0 is taken at the start, so there is a last one.
        let last_s = state.start_s + (state.samples.max(1) - 1) as f64 * step_s;
        (
            if (from_s - last_s).abs() <= rounding { last_s } else { from_s },
            if (length_s - step_s).abs() <= rounding { step_s } else { length_s },
        )
    }
}
