//! Simulation of the closed loop with the models of the FMUs.
//!
//! In reading order:
//!
//! - [`scenario`]: connections and start values; [`contour`]: a closed curve of points as a Fourier series;
//! - [`simulate`]: runs a scenario like an importer of the FMUs; [`recording`]: the signals of a run;
//! - [`summary`]: the results for other programs; [`synchronous`]: rotation-synchronous signals.

pub mod contour;
pub mod recording;
pub mod scenario;
pub mod simulate;
pub mod summary;
pub mod synchronous;

pub use recording::{Column, Recording};
pub use scenario::{Element, Pair, Place, Profile, Scenario, ScenarioError, suggestion};
pub use simulate::{Refused, Run, Stopped};
