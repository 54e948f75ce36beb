//! Inputs over a step.

use super::PlantInput;
use crate::invalid::NotFinite;
use crate::machine::Machine;

/// The highest order of an input derivative in an [`InputTrajectory`].
pub const HIGHEST_ORDER: usize = 4;

/// Inputs over a step, as polynomials: `u(t) = u + Σ_j d_j (t − t_0)^j / j!`.
#[derive(Clone, Debug, PartialEq)]
pub struct InputTrajectory<const N: usize = 2, const K: usize = 3> {
    /// u, at the time `since_s`.
    pub input: PlantInput<f64, N, K>,
    /// d_1, d_2, … in units of the input per s, s², …; `None` holds the inputs.
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
            input = input.with(slope, |value, slope| value + weight * slope);
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

    /// Checks that all inputs are finite.
    pub(super) fn check(&self) -> Result<(), NotFinite> {
        self.slopes.iter().flatten().try_for_each(check_input::<N, K>)?;
        check_input::<N, K>(&self.input)
    }
}

fn check_input<const N: usize, const K: usize>(input: &PlantInput<f64, N, K>) -> Result<(), NotFinite> {
    let machine = Machine::of::<N, K>();
    NotFinite::check(&|| machine.of_magnets("i"), &input.current_a)?;
    NotFinite::check(&|| machine.of_magnets("u"), &input.voltage_v)?;
    NotFinite::check(&|| machine.of_coordinates(|coordinate| coordinate.load), &input.perturbation_n)?;
    NotFinite::check(&|| vec!["omega".into()], &[input.omega_rad_s])
}
