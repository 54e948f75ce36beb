//! The example `van_der_pol` as the library that goes into its FMU.

#[path = "../van_der_pol.rs"]
pub mod van_der_pol;
