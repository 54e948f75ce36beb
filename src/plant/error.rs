//! Errors of a step.

use super::substeps::MOST_PARTS;
use crate::invalid::Short;

/// Why the plant could not complete a step.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StepError {
    /// The rotor has left the gap, or its motion is no longer finite. The state is the one before the sub-step in which this
    /// happened.
    #[error(
        "the rotor leaves the gap at magnet {magnet} after t = {} s, starting at Y = {} m, Z = {} m",
        Short(*time_s),
        Short(position_m[0]),
        Short(position_m[1])
    )]
    Contact {
        /// Number of the nearest magnet, 1 to 3.
        magnet: usize,
        /// Begin of the sub-step, in s.
        time_s: f64,
        /// Position (Y, Z) at that time, in m.
        position_m: [f64; 2],
    },
    /// The rotor of a spindle has left the gap of a bearing, or its motion is no longer finite. The state is the one before the
    /// sub-step in which this happened.
    #[error(
        "the rotor leaves the gap at magnet {magnet} of bearing {bearing} after t = {} s, starting at \
         X = {} m, Y = {} m, Z = {} m, beta = {} rad, gamma = {} rad",
        Short(*time_s), Short(position_m[0]), Short(position_m[1]), Short(position_m[2]), Short(position_m[3]), Short(position_m[4])
    )]
    SpindleContact {
        /// Name of the bearing: A, B or X.
        bearing: &'static str,
        /// Number of the nearest magnet in that bearing, from 1.
        magnet: usize,
        /// Begin of the sub-step, in s.
        time_s: f64,
        /// Coordinates (x, y, z, β, γ) at that time, in m and rad.
        position_m: [f64; 5],
    },
    /// The motion is so fast that the step would take too long. The state is the one before the sub-step in which this was
    /// found.
    #[error(
        "the motion of the rotor is too fast for a step after t = {} s: it needs more than {MOST_PARTS} sub-steps",
        Short(*time_s)
    )]
    Fast {
        /// Begin of the sub-step, in s.
        time_s: f64,
    },
    /// An input is not finite. The state is unchanged.
    #[error("the input {name} is not finite: {value}")]
    Input {
        /// Name of the input as in the interface.
        name: String,
        /// Its value.
        value: f64,
    },
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
