//! The example `van_der_pol` as the library that goes into its FMU.

#[path = "../van_der_pol.rs"]
#[allow(dead_code, reason = "`main` belongs to the program")]
mod van_der_pol;
