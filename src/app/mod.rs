//! The command line: packaging, experiments, reports.

pub mod bearing;
pub mod cli;
pub mod closed_loop;
pub mod contour;
pub mod design;
pub mod documentation;
pub mod experiment;
pub mod html;
pub mod identify;
pub mod montecarlo;
pub mod output;
pub mod package;
pub mod platforms;
pub mod plot;
pub mod progress;
pub mod recording;
pub mod report;
pub mod scenario;
pub mod simulate;
pub mod summary;
pub mod sweep;

mod ssp;
