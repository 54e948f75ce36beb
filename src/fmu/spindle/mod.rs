//! The models of a spindle: a rigid shaft in two radial bearings A and B and an axial one X.
//!
//! Names are those of the planar models with the bearing in front, `A.lambda[1]`, `X.i[2]`.

pub mod controller;
pub mod estimator;
pub mod plant;
