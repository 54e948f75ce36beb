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
    plant::Plant<2, 3>,
    controller::OneBearing<2, 3, 1>,
    estimator::OneBearing<2, 3>,
    spindle::Plant<5, 3, 8>,
    controller::Spindle<5, 3, 8, 3>,
    estimator::Spindle<5, 3, 8>,
    plant::Plant<2, 4>,
    controller::OneBearing<2, 4, 2>,
    estimator::OneBearing<2, 4>,
    spindle::Plant<5, 4, 10>,
    controller::Spindle<5, 4, 10, 5>,
    estimator::Spindle<5, 4, 10>,
    plant::Plant<1, 2>,
    controller::OneBearing<1, 2, 1>,
    estimator::OneBearing<1, 2>,
);

/// All models of this project, in the order in which they are shown.
pub fn catalogue() -> Arc<[Arc<ModelType>]> {
    FMUS.models()
}

/// The model of a name, for instance `MagneticBearing`.
pub fn find(name: &str) -> Option<Arc<ModelType>> {
    FMUS.find(name)
}
