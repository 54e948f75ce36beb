//! Inputs over a step.

use super::PlantInput;
use super::error::StepError;
use crate::machine::Machine;

/// The highest order of an input derivative in an [`InputTrajectory`].
pub const HIGHEST_ORDER: usize = 4;

/// Inputs over a step, as polynomials: `u(t) = u + Σ_j d_j (t − t_0)^j / j!`.
#[derive(Clone, Debug, PartialEq)]
pub struct InputTrajectory<const N: usize = 2, const K: usize = 3> {
    /// u, at the time `since_s`.
    pub input: PlantInput<f64, N, K>,
    /// d_1, d_2, …; in the unit of the input per power of seconds. `None` holds the inputs.
    pub slopes: Option<[PlantInput<f64, N, K>; HIGHEST_ORDER]>,
    /// t_0, in s.
    pub since_s: f64,
}

impl<const N: usize, const K: usize> InputTrajectory<N, K> {
    /// Constant inputs.
    pub fn held(input: &PlantInput<f64, N, K>) -> Self {
        Self { input: input.clone(), slopes: None, since_s: 0.0 }
    }

    /// The inputs at a time, in s.
    pub fn at(&self, t_s: f64) -> PlantInput<f64, N, K> {
        let mut input = self.input.clone();
        let Some(slopes) = &self.slopes else { return input };
        let elapsed_s = t_s - self.since_s;
        let mut weight = 1.0;
        for (slope, order) in slopes.iter().zip(1..) {
            weight *= elapsed_s / f64::from(order);
            let actuators = slope.current_a.into_iter().chain(slope.voltage_v);
            for (value, slope) in input.current_a.iter_mut().chain(&mut input.voltage_v).zip(actuators) {
                *value += weight * slope;
            }
            for (value, slope) in input.perturbation_n.iter_mut().zip(slope.perturbation_n) {
                *value += weight * slope;
            }
            input.omega_rad_s += weight * slope.omega_rad_s;
        }
        input
    }

    /// Whether ω is constant.
    pub(super) fn turns_evenly(&self) -> bool {
        self.slopes.as_ref().is_none_or(|slopes| slopes.iter().all(|slope| slope.omega_rad_s == 0.0))
    }

    /// `∫ ω dt` from t_0 to a time in s, in rad.
    pub(super) fn turned_rad(&self, t_s: f64) -> f64 {
        let elapsed_s = t_s - self.since_s;
        let mut weight = elapsed_s;
        let mut angle_rad = self.input.omega_rad_s * weight;
        for (slope, order) in self.slopes.iter().flatten().zip(2..) {
            weight *= elapsed_s / f64::from(order);
            angle_rad += weight * slope.omega_rad_s;
        }
        angle_rad
    }

    /// Whether all inputs are finite.
    pub(super) fn check(&self) -> Result<(), StepError> {
        self.slopes.iter().flatten().try_for_each(check_input::<N, K>)?;
        check_input::<N, K>(&self.input)
    }
}

fn check_input<const N: usize, const K: usize>(input: &PlantInput<f64, N, K>) -> Result<(), StepError> {
    let refused = |name: String, value: f64| Err(StepError::Input { name, value });
    for (name, values) in [("i", &input.current_a), ("u", &input.voltage_v)] {
        if let Some(k) = values.iter().position(|value| !value.is_finite()) {
            return refused(Machine::of::<N, K>().of_magnets(name).swap_remove(k), values[k]);
        }
    }
    if let Some(n) = input.perturbation_n.iter().position(|value| !value.is_finite()) {
        return refused(Machine::of::<N, K>().coordinates[n].load.0.into(), input.perturbation_n[n]);
    }
    match input.omega_rad_s {
        omega_rad_s if omega_rad_s.is_finite() => Ok(()),
        omega_rad_s => refused("omega".into(), omega_rad_s),
    }
}
