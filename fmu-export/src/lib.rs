//! Exports any Rust model as a co-simulation unit (FMU) of FMI 2.0 and FMI 3.0.
//!
//! A model is a type with a structure of variables, a start, and a step. Everything else follows from the table of variables: start
//! values, value references, access, units, model description, reset, snapshots. [`export_fmus!`] defines the C functions of one
//! library for all models of a crate; [`package`](mod@package) writes the archives.
//!
//! ```
//! use fmu_export::prelude::*;
//!
//! #[derive(Clone, Default, Serialize, Deserialize, Variables)]
//! struct Values {
//!     /// Gain
//!     #[parameter(start = 2.0, tunable)]
//!     k: f64,
//!     /// Voltage in
//!     #[input(unit = unit::VOLT)]
//!     u: f64,
//!     /// Voltage out
//!     #[output(unit = unit::VOLT, depends_on = ["u"])]
//!     y: f64,
//! }
//!
//! #[derive(Clone)]
//! struct Gain;
//!
//! impl Model for Gain {
//!     const INFO: Info = Info::new("Gain", "An amplifier");
//!     const CAPABILITIES: Capabilities = Capabilities::NONE.interpolates_inputs();
//!     type Values = Values;
//!     type State = ();
//!
//!     fn table() -> Vec<Row<Values>> {
//!         Values::rows()
//!     }
//!
//!     fn new(_: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
//!         Ok(Self)
//!     }
//!
//!     fn start(&self, values: &mut Values, _: f64) {
//!         self.refresh(&(), values, 0.0);
//!     }
//!
//!     fn step(&self, _: &mut (), values: &mut Values, step: Step, inputs: &InputTrajectory<Values>, _: &mut dyn Log) -> Stepped {
//!         inputs.apply(values, step.end_s());
//!         self.refresh(&(), values, step.end_s());
//!         Ok(())
//!     }
//!
//!     fn refresh(&self, _: &(), values: &mut Values, _: f64) {
//!         values.y = values.k * values.u;
//!     }
//! }
//!
//! export_fmus!(Gain);
//!
//! # fn main() {
//! let mut gain = FMUS.find("Gain").expect("a model of this crate").instantiate();
//! gain.start().expect("good parameters");
//! gain.set(1, Value::Real(3.0)).expect("an input");
//! assert_eq!(gain.get(2), Ok(Value::Real(6.0)));
//! # }
//! ```
//!
//! In reading order:
//!
//! - [`model`]: the part that you write: [`Model`], [`SampledModel`];
//! - [`mod@variables`], [`mod@unit`]: the structure of variables; [`variable`]: the rows made of it, or by hand; [`mod@array`]: long arrays;
//! - [`resources`]: files; [`state`]: the content of snapshots; [`mod@finite`]: a check of it;
//! - [`input`]: inputs over a step; [`mod@clock`]: sample instants; [`log`]: messages;
//! - [`instance`]: a model as its importer sees it; [`fmus`]: the models of one binary;
//! - [`fmi2`], [`fmi3`], [`interface`]: the C interface, where all unsafe code is;
//! - [`mod@description`], [`xml`]: the model description; [`check`]: errors in a table;
//! - `package`: archives, platforms, documentation pages, system structures.

#[cfg(not(any(feature = "fmi2", feature = "fmi3")))]
compile_error!("fmu-export needs one of its features `fmi2` and `fmi3`, or both");

pub mod array;
pub mod check;
pub mod clock;
pub mod description;
pub mod finite;
#[cfg(feature = "fmi2")]
pub mod fmi2;
#[cfg(feature = "fmi3")]
pub mod fmi3;
pub mod fmus;
pub mod input;
pub mod instance;
pub mod interface;
pub mod log;
pub mod model;
#[cfg(feature = "package")]
pub mod package;
pub mod resources;
pub mod state;
pub mod unit;
pub mod variable;
pub mod variables;
pub mod xml;

mod export;

pub use array::Array;
pub use description::Standard;
pub use finite::is_finite;
pub use fmus::Fmus;
pub use instance::{Instance, ModelType};
pub use model::{Capabilities, Info, Invalid, Model, Sampled, SampledModel, Step, StepError, Stepped};
pub use resources::Resources;
pub use state::{HiddenState, NotSaved};
pub use variables::{Choice, Variables};

pub use fmu_export_derive::{Choice, Variables};

/// The items that most models need, with serde's derive macros.
pub mod prelude {
    pub use serde::{Deserialize, Serialize};

    pub use crate::array::Array;
    pub use crate::input::{HIGHEST_ORDER, InputTrajectory};
    pub use crate::log::{Log, Topic};
    pub use crate::model::{Capabilities, Info, Invalid, Model, SampledModel, Step, StepError, Stepped};
    pub use crate::resources::Resources;
    pub use crate::state::NotSaved;
    pub use crate::unit::{self, Unit};
    pub use crate::variable::{Enumeration, Row, Value};
    pub use crate::variables::{Choice, Variables};
    pub use crate::{export_fmus, place};
    pub use fmu_export_derive::{Choice, Variables};
}
