//! On-line parameter estimation of a three-phase radial magnetic bearing.
//!
//! The layers, each naming only those above it in this list:
//!
//! 1. [`model`]: the equations, in SI units, without any notion of FMI;
//! 2. [`slave`]: the equations as co-simulation slaves, whatever the standard;
//! 3. [`fmi2`]: the C interface of FMI 2.0 for co-simulation;
//! 4. [`app`]: the command line: packaging, experiments, reports.

#[cfg(feature = "app")]
pub mod app;
pub mod fmi2;
pub mod model;
pub mod slave;
