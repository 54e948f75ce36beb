//! Equations of motion over one sample interval, linearised about a trajectory, and of the sensors, with their derivatives to all
//! parameters.

use super::bench::{
    ALPHA, BACKWARD, BENCH, CURRENT_GAIN, CURRENT_OFFSET, DELAY, GAIN, GAIN_DIFFERENCE, GAP, IRON, MASS, OFFSET,
    ROTATION, RUNOUT_1, RUNOUT_2,
};

/// λ_1..3, U cos φ, U sin φ, load y, z, then the bench parameters.
pub(super) const BASE: usize = 7;
/// Number of parameters of one recording.
pub(super) const ALL: usize = BASE + BENCH;
/// First parameter of the load.
pub(super) const LOAD: usize = 5;

/// Parameters of one recording, in SI units.
pub(super) type Theta = [f64; ALL];

/// `[y, z, ẏ, ż]` in m and m/s.
pub(super) type State = [f64; 4];

/// Exactly stated parameters of a bearing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nominal {
    pub m_kg: f64,
    pub gap_m: f64,
    pub alpha_rad: [f64; 3],
}

/// One sample instant of the shaft.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shaft {
    pub cos: f64,
    pub sin: f64,
    /// ω², in 1/s².
    pub square: f64,
    /// ω̇, in 1/s².
    pub rate: f64,
}

impl Shaft {
    /// Factors of U cos φ and U sin φ in the force of the unbalance, (y, z).
    fn unbalance(&self) -> [[f64; 2]; 2] {
        let (c, s, w, b) = (self.cos, self.sin, self.square, self.rate);
        [[w * c + b * s, w * s - b * c], [-w * s + b * c, w * c + b * s]]
    }
}

/// A bearing with given parameters.
#[derive(Clone, Debug)]
pub(super) struct Bearing {
    pub h: f64,
    theta: Theta,
    nominal: Nominal,
    per_mass: f64,
    gap: f64,
    e: [[f64; 2]; 3],
    across: [[f64; 2]; 3],
    /// Sensor gains and rotation, row by row.
    pub sensor: [[f64; 2]; 2],
    pub delay: f64,
    /// Variance of the current noise, A².
    variance: f64,
    /// Standard deviation of the current noise, A.
    pub noise: f64,
    /// Level of a slow force as an acceleration, a random walk, m/s² after a second.
    pub slow: f64,
    rotation: [f64; 2],
}

/// One sample interval: `δ_k = F δ_{k−1} + offset + Σ_j Γ_j w_j` with the stiffness in F, w of variance 1.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Interval {
    /// `∂a/∂(y, z)` in the middle: yy, yz, zz, in 1/s².
    pub stiffness: [f64; 3],
    /// Prediction from the trajectory at the start, minus the trajectory at the end.
    pub offset: State,
    /// Acceleration (y, z) by one standard deviation of the noise of each current.
    pub noise: [[f64; 2]; 3],
    /// Acceleration at the end.
    pub end: [f64; 2],
    /// Point in the middle (y, z), m, and squared currents there, A².
    pub middle: [f64; 2],
    pub squares: [f64; 3],
}

/// Squared currents at start, middle, and end of an interval.
#[derive(Clone, Copy, Debug)]
pub(super) struct Squares {
    pub start: [f64; 3],
    pub middle: [f64; 3],
    pub end: [f64; 3],
}

impl Bearing {
    pub fn new(nominal: Nominal, theta: &Theta, h: f64, current_noise_a: f64, slow_force_n: f64) -> Self {
        let bench: &[f64] = &theta[BASE..];
        let alpha: [f64; 3] = std::array::from_fn(|k| nominal.alpha_rad[k] + bench[ALPHA + k]);
        let (c, s) = (libm::cos(bench[ROTATION]), libm::sin(bench[ROTATION]));
        let gain = [bench[GAIN] + bench[GAIN_DIFFERENCE], bench[GAIN] - bench[GAIN_DIFFERENCE]].map(|g| 1.0 + g);
        let per_mass = 1.0 / (nominal.m_kg * (1.0 + bench[MASS]));
        Self {
            h,
            theta: *theta,
            nominal,
            per_mass,
            gap: nominal.gap_m * (1.0 + bench[GAP]) + bench[IRON],
            e: alpha.map(|alpha| [libm::sin(alpha), libm::cos(alpha)]),
            across: alpha.map(|alpha| [libm::cos(alpha), -libm::sin(alpha)]),
            sensor: [[gain[0] * c, -gain[0] * s], [gain[1] * s, gain[1] * c]],
            delay: bench[DELAY],
            variance: current_noise_a * current_noise_a,
            noise: current_noise_a,
            slow: slow_force_n * per_mass,
            rotation: [c, s],
        }
    }

    fn bench(&self, j: usize) -> f64 {
        self.theta[BASE + j]
    }

    /// True current from a reading, A.
    fn current(&self, k: usize, read: f64) -> f64 {
        (read - self.bench(CURRENT_OFFSET + k)) / (1.0 + self.bench(CURRENT_GAIN + k))
    }

    /// Squared currents, A², free of the σ² that noise adds on average. `before` is the reading a sample earlier of a current that
    /// is continuous.
    pub fn squares(&self, read: [f64; 3], before: Option<[f64; 3]>) -> Squares {
        let variance: [f64; 3] = std::array::from_fn(|k| {
            let gain = 1.0 + self.bench(CURRENT_GAIN + k);
            self.variance / (gain * gain)
        });
        let end: [f64; 3] = std::array::from_fn(|k| self.current(k, read[k]));
        let start: [f64; 3] = match before {
            None => end,
            Some(before) => std::array::from_fn(|k| self.current(k, before[k])),
        };
        // The noise of a mean of two has half the variance.
        let part = if before.is_some() { 0.5 } else { 1.0 };
        let square = |i: f64, variance: f64| i * i - variance;
        Squares {
            start: std::array::from_fn(|k| square(start[k], variance[k])),
            middle: std::array::from_fn(|k| square(0.5 * (start[k] + end[k]), part * variance[k])),
            end: std::array::from_fn(|k| square(end[k], variance[k])),
        }
    }

    fn gaps(&self, at: [f64; 2]) -> [f64; 3] {
        self.e.map(|e| self.gap - (e[0] * at[0] + e[1] * at[1]))
    }

    /// Gaps at a point of the trajectory, the iron path included, m.
    pub fn gaps_at(&self, at: &State) -> [f64; 3] {
        self.gaps([at[0], at[1]])
    }

    /// Force of all but the magnets, N.
    fn external(&self, shaft: Shaft) -> [f64; 2] {
        let [by_cos, by_sin] = shaft.unbalance();
        let (b_c, b_s) = (self.bench(BACKWARD), self.bench(BACKWARD + 1));
        let turning = |a: usize| self.theta[LOAD + a] + self.theta[3] * by_cos[a] + self.theta[4] * by_sin[a];
        [turning(0) + b_c * shaft.cos + b_s * shaft.sin, turning(1) - b_c * shaft.sin + b_s * shaft.cos]
    }

    fn acceleration(&self, gaps: [f64; 3], squares: [f64; 3], shaft: Shaft) -> [f64; 2] {
        let mut force = self.external(shaft);
        for k in 0..3 {
            let pull = self.theta[k] * squares[k] / (gaps[k] * gaps[k]);
            force[0] += self.e[k][0] * pull;
            force[1] += self.e[k][1] * pull;
        }
        force.map(|force| force * self.per_mass)
    }

    /// The interval between two points of the trajectory. The stiffness is that of the expected `i_k²/gap_k²`, once they are known: in that of the measured
    /// ones, noise of the currents would meet itself in the innovations, and bias the scores of all that hardly moves the rotor (an offset by 20 standard
    /// deviations after 5 s, with 12 nm and 41 mA).
    #[inline(always)]
    pub fn interval(
        &self,
        [from, to]: [&State; 2],
        squares: &Squares,
        expected: Option<[f64; 3]>,
        [at_start, at_middle, at_end]: [Shaft; 3],
    ) -> Interval {
        let h = self.h;
        // The cubic through both points and both velocities.
        let middle: [f64; 2] = std::array::from_fn(|a| 0.5 * (from[a] + to[a]) + h / 8.0 * (from[2 + a] - to[2 + a]));
        let gaps = self.gaps(middle);
        let a_0 = self.acceleration(self.gaps([from[0], from[1]]), squares.start, at_start);
        let a_m = self.acceleration(gaps, squares.middle, at_middle);
        let a_1 = self.acceleration(self.gaps([to[0], to[1]]), squares.end, at_end);
        let mut interval = Interval { end: a_1, middle, ..Interval::default() };
        for a in 0..2 {
            interval.offset[a] = from[a] + h * from[2 + a] + h * h / 6.0 * (a_0[a] + 2.0 * a_m[a]) - to[a];
            interval.offset[2 + a] = from[2 + a] + h / 6.0 * (a_0[a] + 4.0 * a_m[a] + a_1[a]) - to[2 + a];
        }
        interval.squares = squares.middle;
        let expected = expected.unwrap_or_else(|| self.regressors(middle, squares.middle));
        for k in 0..3 {
            let gain = 1.0 + self.bench(CURRENT_GAIN + k);
            let noise = self.noise / gain;
            // Var (i + n)² = 4 i² σ² + 2 σ⁴.
            let square_std = (4.0 * squares.middle[k].max(0.0) + 2.0 * noise * noise).sqrt() * noise;
            let e = self.e[k];
            let per_regressor = self.theta[k] * self.per_mass;
            let by_noise = per_regressor / (gaps[k] * gaps[k]) * square_std;
            interval.noise[k] = [e[0] * by_noise, e[1] * by_noise];
            let stiff = 2.0 * per_regressor * expected[k] / gaps[k];
            interval.stiffness[0] += stiff * e[0] * e[0];
            interval.stiffness[1] += stiff * e[0] * e[1];
            interval.stiffness[2] += stiff * e[1] * e[1];
        }
        interval
    }

    /// `i_k²/gap_k²` at a point, A²/m².
    #[inline(always)]
    pub fn regressors(&self, at: [f64; 2], squares: [f64; 3]) -> [f64; 3] {
        let gaps = self.gaps(at);
        std::array::from_fn(|k| squares[k] / (gaps[k] * gaps[k]))
    }

    /// `∂a/∂θ`, (y, z), for given `i_k²/gap_k²` at a point, and after all parameters once more those of λ, for the measured ones.
    ///
    /// The point is where the filter predicts the rotor, not on the smoothed trajectory: that one knows the innovations to come, and with the
    /// negative stiffness their product has an expectation (the derivative of ln det S, for a rotor held by feedback).
    #[inline(always)]
    pub fn force_columns<const P: usize>(
        &self,
        at: [f64; 2],
        regressors: [f64; 3],
        measured: [f64; 3],
        shaft: Shaft,
        d: &mut [[f64; P]; 2],
    ) {
        let per_mass = self.per_mass;
        let mut put = |j: usize, y: f64, z: f64| {
            d[0][j] = y;
            d[1][j] = z;
        };
        let mut stretch = [0.0; 2];
        let mut magnets = [0.0; 2];
        let gaps = self.gaps(at);
        for k in 0..3 {
            let (e, across, gap) = (self.e[k], self.across[k], gaps[k]);
            let per_lambda = regressors[k] * per_mass;
            put(k, e[0] * per_lambda, e[1] * per_lambda);
            if P <= BASE + 1 {
                continue;
            }
            put(ALL + k, e[0] * measured[k] * per_mass, e[1] * measured[k] * per_mass);
            let pull = self.theta[k] * per_lambda;
            let by_gap = -2.0 * pull / gap;
            magnets[0] += e[0] * pull;
            magnets[1] += e[1] * pull;
            stretch[0] += e[0] * by_gap;
            stretch[1] += e[1] * by_gap;
            let turned = -by_gap * (across[0] * at[0] + across[1] * at[1]);
            put(BASE + ALPHA + k, pull * across[0] + turned * e[0], pull * across[1] + turned * e[1]);
            let gain = 1.0 + self.bench(CURRENT_GAIN + k);
            let by_offset = -2.0 * self.theta[k] * regressors[k].max(0.0).sqrt() / gap * per_mass / gain;
            put(BASE + CURRENT_OFFSET + k, e[0] * by_offset, e[1] * by_offset);
            put(BASE + CURRENT_GAIN + k, -2.0 * pull / gain * e[0], -2.0 * pull / gain * e[1]);
        }
        let [by_cos, by_sin] = shaft.unbalance();
        put(3, by_cos[0] * per_mass, by_cos[1] * per_mass);
        put(4, by_sin[0] * per_mass, by_sin[1] * per_mass);
        put(LOAD, per_mass, 0.0);
        put(LOAD + 1, 0.0, per_mass);
        if P <= BASE + 1 {
            return;
        }
        let heavier = -1.0 / (1.0 + self.bench(MASS));
        // The sum of the columns of λ, unbalance and load.
        let rest = self.external(shaft).map(|force| force * per_mass);
        put(BASE + MASS, (magnets[0] + rest[0]) * heavier, (magnets[1] + rest[1]) * heavier);
        put(BASE + GAP, stretch[0] * self.nominal.gap_m, stretch[1] * self.nominal.gap_m);
        put(BASE + IRON, stretch[0], stretch[1]);
        put(BASE + BACKWARD, shaft.cos * per_mass, -shaft.sin * per_mass);
        put(BASE + BACKWARD + 1, shaft.sin * per_mass, shaft.cos * per_mass);
    }

    /// Readings of the position sensors at a point of the trajectory, and that before gains and rotation.
    #[inline(always)]
    pub fn reading(&self, at: &State, acceleration: [f64; 2], shaft: Shaft) -> ([f64; 2], [f64; 2]) {
        let (c, s) = (shaft.cos, shaft.sin);
        let (c_2, s_2) = (c * c - s * s, 2.0 * c * s);
        let late = |a: usize| at[a] - self.delay * (at[2 + a] - 0.5 * self.delay * acceleration[a]);
        let r = |j: usize| self.bench(RUNOUT_1 + j);
        let q = |j: usize| self.bench(RUNOUT_2 + j);
        let y = late(0) + (r(0) + r(2)) * c + (r(3) - r(1)) * s + q(0) * c_2 + q(1) * s_2;
        let z = late(1) + (r(0) - r(2)) * s + (r(1) + r(3)) * c + q(2) * c_2 + q(3) * s_2;
        let m = &self.sensor;
        let read = [m[0][0] * y + m[0][1] * z + self.bench(OFFSET), m[1][0] * y + m[1][1] * z + self.bench(OFFSET + 1)];
        (read, [y, z])
    }

    /// `∂reading/∂θ` at a fixed trajectory, for all but the parameters of the force, whose columns stay as they are.
    #[inline(always)]
    pub fn sensor_columns<const P: usize>(
        &self,
        at: &State,
        acceleration: [f64; 2],
        shaft: Shaft,
        [y, z]: [f64; 2],
        d: &mut [[f64; P]; 2],
    ) {
        let (c, s) = (shaft.cos, shaft.sin);
        let (c_2, s_2) = (c * c - s * s, 2.0 * c * s);
        let m = &self.sensor;
        let mut put = |j: usize, y: f64, z: f64| {
            d[0][BASE + j] = y;
            d[1][BASE + j] = z;
        };
        put(OFFSET, 1.0, 0.0);
        put(OFFSET + 1, 0.0, 1.0);
        let [r_c, r_s] = self.rotation;
        let turned = [r_c * y - r_s * z, r_s * y + r_c * z];
        put(GAIN, turned[0], turned[1]);
        put(GAIN_DIFFERENCE, turned[0], -turned[1]);
        let common = 1.0 + self.bench(GAIN);
        let different = self.bench(GAIN_DIFFERENCE);
        put(ROTATION, -(common + different) * turned[1], (common - different) * turned[0]);
        let mut put = |j: usize, y: f64, z: f64| {
            d[0][BASE + j] = m[0][0] * y + m[0][1] * z;
            d[1][BASE + j] = m[1][0] * y + m[1][1] * z;
        };
        let late = |a: usize| self.delay * acceleration[a] - at[2 + a];
        put(DELAY, late(0), late(1));
        put(RUNOUT_1, c, s);
        put(RUNOUT_1 + 1, -s, c);
        put(RUNOUT_1 + 2, c, -s);
        put(RUNOUT_1 + 3, s, c);
        put(RUNOUT_2, c_2, 0.0);
        put(RUNOUT_2 + 1, s_2, 0.0);
        put(RUNOUT_2 + 2, 0.0, c_2);
        put(RUNOUT_2 + 3, 0.0, s_2);
    }
}
