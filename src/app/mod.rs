//! The command line: packaging, experiments, reports.

pub mod plot;
pub mod recording;
pub mod report;
