//! Models.
pub mod bearing;
pub mod control;
pub mod estimation;
pub mod fmu;
pub mod invalid;
pub mod machine;
pub mod plant;
pub mod variables;
