//! On-line parameter estimation of a three-phase radial magnetic bearing.
//!
//! SI units throughout, axis order (y, z), magnets in the order 1, 2, 3. Each layer names only those above it:
//!
//! 1. the equations, which know nothing of FMI, read or write no files, and do not allocate while stepping: [`bearing`], [`plant`], [`control`],
//!    [`estimation`]. Configuration and state are two types: a configuration is checked once, when it is made ([`invalid`] collects what is
//!    wrong), and a step changes the state alone. Elementary functions come from the crate `libm`, so that all platforms compute the same bits;
//! 2. [`fmu`]: the equations as FMUs, by the crate `fmu_export`;
//! 3. [`simulation`]: scenarios and the closed loop;
//! 4. [`studies`]: many runs, and recordings of a test bench;
//! 5. [`report`]: pages of HTML;
//! 6. [`cli`]: the command line, with [`mod@package`], [`output`], [`progress`] and [`table`] for what it packs and prints.

pub mod bearing;
pub mod control;
pub mod estimation;
pub mod fmu;
pub mod invalid;
pub mod plant;

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
