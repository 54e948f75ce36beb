//! What most tests of the program use.

pub use std::collections::BTreeMap;
pub use std::f64::consts::{PI, TAU};
pub use std::fs;
pub use std::path::{Path, PathBuf};
pub use std::process::Command;

pub use serde_json::Value as Json;

pub use crate::bench::{Bench, Errors};
pub use crate::program::{self, *};
pub use crate::support::{MODELS, Random, assert_contains, below, between};
pub use magnetic_bearing::machine::*;
pub use magnetic_bearing::report::experiment;
pub use magnetic_bearing::simulation::scenario::BUILT_IN;
pub use magnetic_bearing::simulation::{Column, Element, Recording, Run, Scenario, simulate};
pub use magnetic_bearing::studies::identify::{Reading, Samples};
pub use magnetic_bearing::studies::montecarlo::{self, NOISE, nominal};
pub use magnetic_bearing::studies::parallel::in_order;
pub use magnetic_bearing::studies::statistics::rms;
pub use magnetic_bearing::variables::Choice;
