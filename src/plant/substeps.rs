//! Integration over a segment of a step: length of the sub-steps, and begin and end of contact.

use std::cell::Cell;

use super::{
    Conditions, InputTrajectory, Instant, Motion, Plant, PlantInput, PlantState, ROUNDING_TOLERANCE, SHORTEST_STEP_S,
    StepError, UniformRotation,
};
use crate::bearing::{Rotor, array};
use crate::invalid::are_finite;
use crate::plant::integration::{rk4, substeps};

/// Upper bound of a sub-step, as a fraction of the reciprocal of the fastest rate of the model.
///
/// The relative error of a Runge–Kutta step for a mode of that rate is then about `SAFETY⁵/120`, 10⁻⁷.
pub const SAFETY: f64 = 0.1;

/// The most sub-steps of one call, a few seconds of computing.
pub const MOST_SUBSTEPS: usize = 3_000_000;

/// The most contact events located within one sub-step; further ones are ignored until its end.
const MOST_CONTACT_EVENTS: usize = 8;

/// Bisections that locate a contact event: to 10⁻¹² of the sub-step.
const BISECTIONS: usize = 40;

/// Time, angle and force of a perturbation.
type Perturbation<const N: usize> = (f64, f64, [f64; N]);

impl<const N: usize, const K: usize, const B: usize> Plant<N, K, B> {
    /// Integrates over a segment, `length_s` from `from_s`, without a sample inside; the time of the state becomes `end_s`.
    pub(super) fn integrate(
        &self,
        state: &mut PlantState<N, K, B>,
        inputs: &InputTrajectory<N, K>,
        (from_s, length_s, end_s): (f64, f64, f64),
        budget: &mut usize,
    ) -> Result<(), StepError> {
        let (from_s, length_s) = self.without_rounding(state, from_s, length_s);
        let evenly = inputs.turns_evenly();
        if !evenly || inputs.input.omega_rad_s != state.rotation.omega_rad_s {
            let omega_rad_s = inputs.at(from_s).omega_rad_s;
            state.rotation = UniformRotation { base_rad: state.theta_rad, since_s: from_s, omega_rad_s };
        }
        let turned_rad = inputs.turned_rad(from_s);
        let theta_rad = |rotation: &UniformRotation, t: f64| {
            if evenly { rotation.theta_rad(t) } else { rotation.base_rad + (inputs.turned_rad(t) - turned_rad) }
        };
        let n = substeps(length_s, self.config().max_step_s);
        let h = length_s / n as f64;
        for k in 0..K {
            if state.open[k] {
                state.motion.linkage_wb[k] = 0.0;
            }
        }
        // The last perturbation computed: two of the four slopes of a sub-step are at the same instant, and the last one is usually
        // where the next sub-step begins.
        let cached = Cell::new(None);
        for j in 0..n {
            let t = from_s + j as f64 * h;
            self.sub_step(state, inputs, (t, h), &theta_rad, &cached, budget)?;
            state.theta_rad = theta_rad(&state.rotation, t + h);
        }
        state.time_s = end_s;
        state.theta_rad = theta_rad(&state.rotation, from_s + length_s);
        if !evenly {
            // The next segment begins with its own angle and speed.
            let omega_rad_s = inputs.at(from_s + length_s).omega_rad_s;
            state.rotation = UniformRotation { base_rad: state.theta_rad, since_s: from_s + length_s, omega_rad_s };
        }
        Ok(())
    }

    /// Integrates over one sub-step of `h_s` from `t_s`, divided if the model is faster and where contact begins or ends.
    fn sub_step(
        &self,
        state: &mut PlantState<N, K, B>,
        inputs: &InputTrajectory<N, K>,
        (t_s, h_s): (f64, f64),
        theta_rad: &impl Fn(&UniformRotation, f64) -> f64,
        cached: &Cell<Option<Perturbation<N>>>,
        budget: &mut usize,
    ) -> Result<(), StepError> {
        let mut done_s = 0.0;
        let mut contact_events = 0;
        let held = inputs.slopes.is_none();
        loop {
            let x = state.motion;
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
                let rotation = &state.rotation;
                let slope = |t: f64, x: &Motion<f64, N, K>| {
                    let theta_rad = theta_rad(rotation, t);
                    let conditions = Conditions { time_s: t, theta_rad, contact: state.contact, open: state.open };
                    if !held {
                        return self.equations.derivative(&Instant { motion: x, input: &inputs.at(t), conditions });
                    }
                    let perturbation_n = match cached.get() {
                        Some((at, angle, force)) if at == t && angle == theta_rad => force,
                        _ => self.equations.config.perturbation(&inputs.input, t, theta_rad),
                    };
                    cached.set(Some((t, theta_rad, perturbation_n)));
                    let at = Instant { motion: x, input: &inputs.input, conditions };
                    self.equations.derivative_under(&at, perturbation_n)
                };
                rk4(x, now_s, h_s, slope)
            };
            let touches = |x: &Motion<f64, N, K>| self.config().touches(&x.position_m, &x.velocity_m_s);
            let mut next = step(part_s);
            if touches(&next) != state.contact && contact_events < MOST_CONTACT_EVENTS {
                contact_events += 1;
                let mut before_s = 0.0;
                for _ in 0..BISECTIONS {
                    let middle_s = 0.5 * (before_s + part_s);
                    let middle = step(middle_s);
                    if touches(&middle) == state.contact {
                        before_s = middle_s;
                    } else {
                        (part_s, next) = (middle_s, middle);
                    }
                }
            }
            let inside = self.equations.geometry().gaps(next.position_m).iter().all(|gap| *gap > 0.0);
            if !(inside && are_finite(&[&next.position_m, &next.velocity_m_s, &next.linkage_wb])) {
                let gap_m = self.equations.geometry().gaps(state.motion.position_m);
                let nearest = (0..K).fold(0, |k, other| if gap_m[other] < gap_m[k] { other } else { k });
                state.time_s = now_s;
                let machine = Rotor::<N, K, B>::MACHINE;
                let names = machine.coordinates.iter().map(|coordinate| coordinate.position);
                return Err(StepError::Contact {
                    magnet: machine.describe("{magnet}", "", nearest),
                    time_s: now_s,
                    position: names.zip(state.motion.position_m).collect(),
                });
            }
            state.contact = touches(&next);
            state.motion = next;
            done_s = if part_s == left_s { h_s } else { done_s + part_s };
            if done_s >= h_s {
                return Ok(());
            }
        }
    }

    /// [`SAFETY`] over the fastest rate of the model in this state, in s.
    fn longest_step_s(&self, state: &PlantState<N, K, B>, input: &PlantInput<f64, N, K>) -> f64 {
        let gap_m = self.equations.geometry().gaps(state.motion.position_m);
        let coils = self.equations.coils(&state.at(input, state.time_s), gap_m);
        let of_coils = coils.iter().map(|coil| self.config().coil.resistance_ohm * coil.current_by_linkage);
        let rate = self.config().rate(state, array::map(coils, |coil| coil.force_n), gap_m);
        (SAFETY / of_coils.fold(rate, f64::max)).max(SHORTEST_STEP_S)
    }

    /// Begin and length of a segment with rounding removed: a begin close to a sample instant becomes that instant, a length close to
    /// the sensor step becomes that step.
    fn without_rounding(&self, state: &PlantState<N, K, B>, from_s: f64, length_s: f64) -> (f64, f64) {
        let step_s = self.config().sensor.step_s;
        let rounding = ROUNDING_TOLERANCE * step_s;
        let last_s = self.sampled_s(state);
        (
            if (from_s - last_s).abs() <= rounding { last_s } else { from_s },
            if (length_s - step_s).abs() <= rounding { step_s } else { length_s },
        )
    }
}
