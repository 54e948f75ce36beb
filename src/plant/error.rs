//! Why a step fails.

use super::substeps::MOST_PARTS;

/// Why the plant could not complete a step.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StepError {
    /// The rotor has left the gap, or its motion is no longer finite. The state is that before the sub-step in
    /// which it happened.
    #[error(
        "the rotor leaves the gap at magnet {magnet} after t = {time_s} s, coming from Y = {} m, Z = {} m",
        position_m[0],
        position_m[1]
    )]
    Contact {
        /// Number of the magnet, 1 to 3: the one the rotor was nearest to.
        magnet: usize,
        /// Begin of the sub-step that ended outside, in s.
        time_s: f64,
        /// Position (Y, Z) at that time, in m.
        position_m: [f64; 2],
    },
    /// The motion is so fast that the step would not come to an end. The state is that before the sub-step in which that
    /// was found.
    #[error("the motion of the rotor is too fast for a step after t = {time_s} s: more than {MOST_PARTS} parts")]
    Fast {
        /// Begin of the sub-step, in s.
        time_s: f64,
    },
    /// An input is not finite. The state is unchanged.
    #[error("the input {name} is not finite: {value}")]
    Input {
        /// Name of the input as in the interface.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// The step does not begin where the last one ended, or its length is not a time. The state is unchanged.
    #[error("a step of {h_s} s from t = {t_s} s is refused: the plant stands at t = {time_s} s")]
    Time {
        /// Begin of the step refused, in s.
        t_s: f64,
        /// Its length, in s.
        h_s: f64,
        /// Where the plant stands, in s.
        time_s: f64,
    },
}
