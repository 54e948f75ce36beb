//! The models of this project as FMUs: their tables of variables, and the library that exports them.
//!
//! [`plant`], [`controller`] and [`estimator`] each read from top to bottom: values, table, run, for any machine. The dependencies of a
//! plant's outputs are in `dependencies.rs`.

pub mod controller;
pub mod estimator;
pub mod plant;

mod common;
mod dependencies;

use std::sync::Arc;

use fmu_export::ModelType;

fmu_export::export_fmus!(
    plant::PlantModel<2, 3, 1>,
    controller::ControllerModel<2, 3, 1, 1>,
    estimator::OneBearing<2, 3>,
    plant::PlantModel<5, 8, 3>,
    controller::ControllerModel<5, 8, 3, 3>,
    estimator::Spindle<5, 3, 8>,
    plant::PlantModel<2, 4, 1>,
    controller::ControllerModel<2, 4, 1, 2>,
    estimator::OneBearing<2, 4>,
    plant::PlantModel<5, 10, 3>,
    controller::ControllerModel<5, 10, 3, 5>,
    estimator::Spindle<5, 3, 10>,
    plant::PlantModel<1, 2, 1>,
    controller::ControllerModel<1, 2, 1, 1>,
    estimator::OneBearing<1, 2>,
);

/// All models of this project, in display order.
pub fn catalogue() -> Arc<[Arc<ModelType>]> {
    FMUS.models()
}

/// The model of this name, for instance `MagneticBearing`.
pub fn find(name: &str) -> Option<Arc<ModelType>> {
    FMUS.find(name)
}
