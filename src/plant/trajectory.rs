//! Inputs over a step.

use super::PlantInput;
use super::error::StepError;

/// The highest order of a derivative of an input that an [`InputTrajectory`] knows.
pub const HIGHEST_ORDER: usize = 4;

/// What acts on the plant over a step, as polynomials: `u(t) = u + Σ_j d_j (t − t_0)^j / j!`.
#[derive(Clone, Debug, PartialEq)]
pub struct InputTrajectory {
    /// u, at the time `since_s`.
    pub input: PlantInput,
    /// d_1, d_2, …; in the unit of the input over powers of seconds. `None` holds the inputs.
    pub slopes: Option<[PlantInput; HIGHEST_ORDER]>,
    /// t_0, in s.
    pub since_s: f64,
}

impl InputTrajectory {
    /// Inputs that are held.
    pub fn held(input: &PlantInput) -> Self {
        Self { input: input.clone(), slopes: None, since_s: 0.0 }
    }

    /// The inputs at a time, in s.
    pub fn at(&self, t_s: f64) -> PlantInput {
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

    /// Whether ω is held.
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

    pub(super) fn check(&self) -> Result<(), StepError> {
        self.slopes.iter().flatten().try_for_each(check_input)?;
        check_input(&self.input)
    }
}

fn check_input(input: &PlantInput) -> Result<(), StepError> {
    const NAMES: [&str; 9] = ["i[1]", "i[2]", "i[3]", "u[1]", "u[2]", "u[3]", "pY", "pZ", "omega"];
    let [i_1, i_2, i_3] = input.current_a;
    let [u_1, u_2, u_3] = input.voltage_v;
    let [p_y, p_z] = input.perturbation_n;
    for (name, value) in NAMES.into_iter().zip([i_1, i_2, i_3, u_1, u_2, u_3, p_y, p_z, input.omega_rad_s]) {
        if !value.is_finite() {
            return Err(StepError::Input { name, value });
        }
    }
    Ok(())
}
