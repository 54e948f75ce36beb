//! The command line: packaging, experiments, reports.

pub mod progress;
pub mod recording;
pub mod scenario;
pub mod simulate;
