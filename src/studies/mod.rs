//! Studies: many runs, and what they say of estimator, controller and data.
//!
//! - [`montecarlo`]: errors over many seeds beside stated deviations and the Cramér–Rao bound;
//! - [`design`]: which excitation makes λ known after which time;
//! - [`sweep`]: a scenario with many values, a row per case;
//! - [`sensitivity`]: the sensitivity function of the sampled loop, after ISO 14839-3;
//! - [`identify`]: a bearing from recordings of a test bench.

pub mod design;
pub mod identify;
pub mod montecarlo;
pub mod sensitivity;
pub mod sweep;
