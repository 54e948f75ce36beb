//! The example `thermostat` as the library that goes into its FMU.

#[path = "../thermostat.rs"]
#[allow(dead_code, reason = "`main` belongs to the program")]
mod thermostat;
