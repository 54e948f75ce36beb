//! The command line: packaging, experiments, reports.

pub mod recording;
