//! Studies of many runs, to assess estimator, controller and data.
//!
//! - [`montecarlo`]: errors over many seeds, stated standard deviations and the Cramér–Rao bound;
//! - [`design`]: precision of λ over time for a choice of excitation;
//! - [`sweep`]: a scenario with varied values, a row per case;
//! - [`sensitivity`]: the sensitivity function of the sampled loop, after ISO 14839-3;
//! - [`whirl`]: natural frequencies and unbalance response of a shaft over the speed;
//! - [`identify`]: identification from recordings of a test bench;
//! - [`statistics`]: means, ranges and noise of values.

pub mod design;
pub mod identify;
pub mod montecarlo;
pub mod parallel;
pub mod sensitivity;
pub mod statistics;
pub mod sweep;
pub mod whirl;
