//! Sensor noise: seeded, reproducible on every platform, and part of the state.

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// A generator of Gaussian noise for one channel; the value is its complete state.
///
/// Each channel has its own generator, so that the noise of one channel does not affect another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    generator: Pcg64,
}

impl Noise {
    /// Statistically independent generators from one seed, one by one.
    pub fn sequence(seed: u64) -> impl FnMut() -> Self {
        let mut parent = Pcg64::seed_from_u64(seed);
        move || Self { generator: Pcg64::from_rng(&mut parent) }
    }

    /// The next number of the standard normal distribution, by the Box–Muller method.
    ///
    /// Every draw consumes two numbers of the generator, so that draw k does not depend on earlier values. Logarithm and cosine
    /// come from `libm`: the same seed gives the same bits everywhere.
    pub fn standard_normal(&mut self) -> f64 {
        const UNIT: f64 = 1.0 / (1u64 << 53) as f64;
        // In (0, 1], to avoid the logarithm of 0, and in [0, 1).
        let a = ((self.generator.next_u64() >> 11) + 1) as f64 * UNIT;
        let b = (self.generator.next_u64() >> 11) as f64 * UNIT;
        (-2.0 * libm::log(a)).sqrt() * libm::cos(std::f64::consts::TAU * b)
    }

    /// `value` plus noise of the given standard deviation, in the unit of `value`.
    ///
    /// A standard deviation of 0 returns `value` exactly, without a draw.
    pub fn measure(&mut self, value: f64, standard_deviation: f64) -> f64 {
        if standard_deviation == 0.0 { value } else { value + standard_deviation * self.standard_normal() }
    }
}
