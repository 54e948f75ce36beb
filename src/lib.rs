//! On-line parameter estimation of a three-phase radial magnetic bearing.
//!
//! The layers, each naming only those above it in this list:
//!
//! 1. [`model`]: the equations, in SI units, without any notion of FMI;
//! 2. [`fmu`]: the equations as FMUs, by the crate `fmu_export`;
//! 3. [`app`]: the command line: experiments, studies, reports, packaging.

#[cfg(feature = "app")]
pub mod app;
pub mod fmu;
pub mod model;
