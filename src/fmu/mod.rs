//! The models of this project as FMUs: their tables of variables, and the library that exports them.
//!
//! [`plant`], [`controller`] and [`estimator`] each read from top to bottom: values, table, run, for any machine. The dependencies of a
//! plant's outputs are in `dependencies.rs`, the values of sampled models in `common.rs`.

pub mod controller;
pub mod estimator;
pub mod plant;

mod common;
mod dependencies;

use std::sync::Arc;

use fmu_export::ModelType;

use crate::bearing::RotorConfig;
use crate::control::controller::Controller;
use crate::estimation::Estimator;
use crate::plant::Plant;

fmu_export::export_fmus!(
    Plant<2, 3, 1>,
    Controller<2, 3, 1, 1>,
    Estimator<RotorConfig, 2, 3, 1>,
    Plant<5, 8, 3>,
    Controller<5, 8, 3, 3>,
    Estimator<RotorConfig<f64, 3>, 5, 8, 2>,
    Plant<2, 4, 1>,
    Controller<2, 4, 1, 2>,
    Estimator<RotorConfig, 2, 4, 1>,
    Plant<5, 10, 3>,
    Controller<5, 10, 3, 5>,
    Estimator<RotorConfig<f64, 3>, 5, 10, 2>,
    Plant<1, 2, 1>,
    Controller<1, 2, 1, 1>,
    Estimator<RotorConfig, 1, 2, 1>,
);

/// All models of this project, in display order.
pub fn catalogue() -> Arc<[Arc<ModelType>]> {
    FMUS.models()
}

/// The model of this name, for instance `MagneticBearing`.
pub fn find(name: &str) -> Option<Arc<ModelType>> {
    FMUS.find(name)
}
