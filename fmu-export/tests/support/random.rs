//! Random numbers for tests.

/// Reproducible random numbers (SplitMix64).
pub struct Random(u64);

impl Random {
    /// A different sequence for every seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number in `[low, high)`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A normal number of mean 0 and standard deviation 1, as the sum of twelve uniform ones.
    pub fn normal(&mut self) -> f64 {
        (0..12).fold(-6.0, |sum, _| sum + self.between(0.0, 1.0))
    }
}

impl super::abuse::Source for Random {
    fn byte(&mut self) -> Option<u8> {
        Some(self.between(0.0, 256.0) as u8)
    }
}
