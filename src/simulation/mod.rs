//! Simulation of the closed loop over the models of the FMUs.
//!
//! In reading order:
//!
//! - [`scenario`]: what is connected to what, and start values; [`contour`]: a path of points as a Fourier series;
//! - [`closed_loop`]: a scenario as configurations of plant, controller and estimator;
//! - [`simulate`]: runs a scenario as an importer would run the FMUs; [`recording`]: the signals of a run;
//! - [`summary`]: the result for other programs.

pub mod closed_loop;
pub mod contour;
pub mod recording;
pub mod scenario;
pub mod simulate;
pub mod summary;
