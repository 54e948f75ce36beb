//! The bearing: magnets, coils, rotor, and the backup bearing.
//!
//! In reading order:
//!
//! - `array`: arrays of numbers, filled and combined;
//! - [`scalar`]: the number type of the equations: `f64` for values, Taylor series for derivatives;
//! - [`magnet`]: gaps, forces, currents, and force allocation;
//! - [`shaft`]: coordinates of a rigid rotor;
//! - [`rotor`]: a rotor in its bearings;
//! - [`coil`]: flux, current and force of a coil;
//! - [`touchdown`]: the backup bearing.

pub(crate) mod array;
pub mod coil;
pub mod magnet;
pub mod rotor;
pub mod scalar;
pub mod shaft;
pub mod touchdown;

pub use coil::Drive;
pub use magnet::Used;
pub use rotor::{BearingConfig, Rotor, RotorConfig};
pub use scalar::Scalar;
pub(crate) use scalar::joined;
pub use shaft::Shaft;
