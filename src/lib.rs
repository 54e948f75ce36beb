//! On-line parameter estimation of magnetic bearings.
//!
//! SI units throughout, axis order (y, z), magnets in the order of their numbers. Each layer uses only those above it:
//!
//! 1. the equations, which know nothing of FMI, access no files, and do not allocate while stepping: [`bearing`],
//!    [`plant`], [`control`], [`estimation`]. Configuration and state are separate types: a configuration is validated
//!    once, when it is created ([`invalid`] collects the errors), and a step changes only the state. Elementary functions
//!    come from the crate `libm`, so that all platforms compute the same bits. [`machine`] describes the machines,
//!    [`mod@variables`] the fields of structures: unit, limits, meaning;
//! 2. [`fmu`]: the equations as FMUs, through the crate `fmu_export`;
//! 3. [`simulation`]: scenarios and the closed loop;
//! 4. [`studies`]: many runs, and identification from recordings of a test bench;
//! 5. [`report`]: HTML pages;
//! 6. [`cli`]: the command line, with [`mod@package`], [`output`], [`progress`] and [`table`] for archives and printed results.

pub mod bearing;
pub mod control;
pub mod estimation;
pub mod fmu;
pub mod invalid;
pub mod machine;
pub mod plant;
pub mod variables;

#[cfg(feature = "app")]
pub mod cli;
#[cfg(feature = "app")]
pub mod output;
#[cfg(feature = "app")]
pub mod package;
#[cfg(feature = "app")]
pub mod progress;
#[cfg(feature = "app")]
pub mod report;
#[cfg(feature = "app")]
pub mod simulation;
#[cfg(feature = "app")]
pub mod studies;
#[cfg(feature = "app")]
pub mod table;
