//! The models of this project as FMUs: a table of variables each, and the library that serves them.
//!
//! [`controller`] and [`estimator`] each read from top to bottom: values, table, run, for any machine. `plants.rs` does so for the plants;
//! what they depend on is in [`plant`] for one bearing and in [`spindle`].

pub mod controller;
pub mod estimator;
pub mod plant;
pub mod plants;
pub mod spindle;

mod common;

use std::sync::Arc;

use fmu_export::ModelType;

fmu_export::export_fmus!(
    plant::MagneticBearing,
    controller::FlatnessController,
    estimator::AlgebraicEstimator,
    spindle::MagneticSpindle,
    controller::SpindleController,
    estimator::SpindleEstimator,
    plant::MagneticBearing4,
    controller::FlatnessController4,
    estimator::AlgebraicEstimator4,
    spindle::MagneticSpindle4,
    controller::SpindleController4,
    estimator::SpindleEstimator4,
    plant::AxialBearing,
    controller::AxialController,
    estimator::AxialEstimator,
);

/// All models of this project, in the order in which they are shown.
pub fn catalogue() -> Arc<[Arc<ModelType>]> {
    FMUS.models()
}

/// The model of a name, for instance `MagneticBearing`.
pub fn find(name: &str) -> Option<Arc<ModelType>> {
    FMUS.find(name)
}
