//! Errors of a step.

use super::substeps::MOST_SUBSTEPS;
use crate::invalid::{NotFinite, Short};

/// Why the plant could not complete a step.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StepError {
    /// The rotor has left the gap of a magnet, or its motion has diverged. The state is the one before that sub-step.
    #[error("the rotor leaves the gap at {magnet} after t = {} s, starting at {}", Short(*time_s), listed(position))]
    Contact {
        /// The nearest magnet, for instance `magnet 2 of bearing A`.
        magnet: String,
        /// Begin of the sub-step, in s.
        time_s: f64,
        /// Names and values of the coordinates at that time, in m, angles in rad.
        position: Vec<(&'static str, f64)>,
    },
    /// The motion is so fast that the step would take too long. The state is the one before that sub-step.
    #[error(
        "the motion of the rotor is too fast for a step after t = {} s: it needs more than {MOST_SUBSTEPS} sub-steps",
        Short(*time_s)
    )]
    Fast {
        /// Begin of the sub-step, in s.
        time_s: f64,
    },
    /// An input is not finite. The state is unchanged.
    #[error(transparent)]
    Input(#[from] NotFinite),
    /// The step does not begin where the last one ended, or its length is invalid. The state is unchanged.
    #[error("a step of {h_s} s from t = {t_s} s is refused: the plant is at t = {time_s} s")]
    Time {
        /// Begin of the refused step, in s.
        t_s: f64,
        /// Its length, in s.
        h_s: f64,
        /// Time of the plant, in s.
        time_s: f64,
    },
}

/// Coordinates with their units: angles have Greek names.
fn listed(position: &[(&'static str, f64)]) -> String {
    let unit = |name: &str| if ["beta", "gamma"].contains(&name) { "rad" } else { "m" };
    let words = position.iter().map(|(name, value)| format!("{name} = {} {}", Short(*value), unit(name)));
    words.collect::<Vec<_>>().join(", ")
}
