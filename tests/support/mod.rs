//! Shared by several tests.

#![allow(dead_code, reason = "each test program uses only part of this")]

#[path = "../../fmu-export/tests/support/abuse.rs"]
pub mod abuse;
#[path = "../../fmu-export/tests/support/abuse3.rs"]
pub mod abuse3;
#[path = "../../fmu-export/tests/support/ffi.rs"]
pub mod ffi;
#[path = "../../fmu-export/tests/support/ffi3.rs"]
pub mod ffi3;
pub mod named;
#[path = "../../fmu-export/tests/support/random.rs"]
mod random;
#[path = "../../fmu-export/tests/support/sequence.rs"]
pub mod sequence;
#[path = "../../fmu-export/tests/support/sequence3.rs"]
pub mod sequence3;
pub mod whirl;

use magnetic_bearing::machine::MACHINES;

/// The models that the tests in `fmu-export/tests/support` work on.
pub use magnetic_bearing::fmu as library;
#[allow(unused_imports, reason = "not every test program needs it")]
pub use random::Random;

/// The models of this project.
pub const MODELS: [&str; 3 * MACHINES.len()] = {
    let (mut names, mut at) = ([""; 3 * MACHINES.len()], 0);
    while at < names.len() {
        names[at] = MACHINES[at / 3].models[at % 3].0;
        at += 1;
    }
    names
};

/// Whether a model is a plant.
pub fn is_plant(model: &str) -> bool {
    MACHINES.iter().any(|machine| machine.models[0].0 == model)
}

/// Asserts a value of at most `limit`.
#[track_caller]
pub fn below(what: &str, value: f64, limit: f64) {
    assert!(value <= limit, "{what}: {value:e} is above the limit {limit:e}");
}

/// Asserts a value within limits.
#[track_caller]
pub fn between(what: &str, value: f64, low: f64, high: f64) {
    assert!((low..=high).contains(&value), "{what}: {value:e} is outside {low:e} to {high:e}");
}

/// Asserts the poles of a linear map `M`: the product of `M − pI` over all poles `p` maps every unit vector to 0.
#[track_caller]
pub fn poles_are_at<const N: usize>(what: &str, poles: [f64; N], map: impl Fn([f64; N]) -> [f64; N]) {
    for unit in 0..N {
        let mut vector: [f64; N] = std::array::from_fn(|n| f64::from(n == unit));
        for pole in poles {
            let next = map(vector);
            vector = std::array::from_fn(|n| next[n] - pole * vector[n]);
        }
        vector.into_iter().for_each(|residual| below(&format!("poles, {what}"), residual.abs(), 1e-12));
    }
}

/// Parameters of the spindle with three magnets in each radial bearing.
pub type SpindleConfig = magnetic_bearing::plant::PlantConfigOf<f64, 5, 8, 3>;

/// Asserts that a message contains all of these words.
#[track_caller]
pub fn assert_contains(message: &str, words: &[&str]) {
    for word in words {
        assert!(message.contains(word), "`{word}` is missing in: {message}");
    }
}

/// One step of the fourth-order Runge–Kutta method.
pub fn runge_kutta<const N: usize>(x: &[f64; N], t: f64, h: f64, of: impl Fn(f64, &[f64; N]) -> [f64; N]) -> [f64; N] {
    let plus = |d: &[f64; N], h: f64| -> [f64; N] { std::array::from_fn(|n| x[n] + h * d[n]) };
    let k1 = of(t, x);
    let k2 = of(t + h / 2.0, &plus(&k1, h / 2.0));
    let k3 = of(t + h / 2.0, &plus(&k2, h / 2.0));
    let k4 = of(t + h, &plus(&k3, h));
    std::array::from_fn(|n| x[n] + h / 6.0 * (k1[n] + 2.0 * k2[n] + 2.0 * k3[n] + k4[n]))
}
