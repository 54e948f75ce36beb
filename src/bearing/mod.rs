//! The bearing: geometry and force law of its magnets, coils, and the backup bearing.
//!
//! In reading order:
//!
//! - [`scalar`]: the numbers over which the equations are generic: `f64` for values, Taylor series for derivatives;
//! - [`magnet`]: gaps, forces, currents, and how a wanted force is shared among the magnets;
//! - [`coil`]: flux, current, force and energy of a coil;
//! - [`touchdown`]: the backup bearing.

pub mod coil;
pub mod magnet;
pub mod scalar;
pub mod touchdown;
