//! The program: scenarios, simulations, studies, identification from recordings, reports, packages.

#[path = "../support/bench.rs"]
mod bench;
#[path = "../support/mod.rs"]
mod support;

mod axial;
mod bits;
mod bound;
mod closed_loop;
mod command;
mod commands;
mod contour;
mod design;
mod hostile;
mod identify;
mod layers;
mod likelihood;
mod machines;
mod machines_identified;
mod montecarlo;
mod package;
mod platforms;
mod prelude;
pub mod program;
mod recordings;
mod report;
mod scenario;
mod scenarios;
mod survey;
mod sweep;
mod twin;
mod uncertainty;
mod whirl;
