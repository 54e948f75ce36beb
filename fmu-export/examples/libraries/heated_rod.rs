//! The example `heated_rod` as the library that goes into its FMU.

#[path = "../heated_rod.rs"]
#[allow(dead_code, reason = "`main` belongs to the program")]
mod heated_rod;
