//! The models of this project as FMUs: a table of variables each, and the library that serves them.
//!
//! [`plant`], [`controller`] and [`estimator`] each read from top to bottom: values, table, run. [`spindle`] holds the models of a
//! whole rotor.

pub mod controller;
pub mod estimator;
pub mod plant;
pub mod spindle;

mod common;
mod plants;

use std::sync::Arc;

use fmu_export::ModelType;

fmu_export::export_fmus!(
    plant::MagneticBearing,
    controller::FlatnessController,
    estimator::AlgebraicEstimator,
    spindle::plant::MagneticSpindle,
    spindle::controller::SpindleController,
    spindle::estimator::SpindleEstimator,
);

/// All models of this project, in the order in which they are shown.
pub fn catalogue() -> Arc<[Arc<ModelType>]> {
    FMUS.models()
}

/// The model of a name, for instance `MagneticBearing`.
pub fn find(name: &str) -> Option<Arc<ModelType>> {
    FMUS.find(name)
}
