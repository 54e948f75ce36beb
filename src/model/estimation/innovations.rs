//! The whitening filter: a Kalman filter of the motion whose innovations are linear in the unknowns.
//!
//! Within one sample interval the rotor moves by
//!
//! ```text
//! m (ÿ, z̈) = Σ_k λ_k e_k u_k + K (q − q̄) + U (ω² e^{j(θ+φ)} − j ω̇ e^{j(θ+φ)}) + (p_y, p_z)        u_k = i_k²/gap_k(q̄)²
//! ```
//!
//! with q̄ a motion that starts at the measured position, and the negative stiffness `K = Σ_k 2 λ_k (i_k²/gap_k³) e_k e_kᵀ`. The filter
//! has the state (y, z, ẏ, ż), measurement noise σ_z and process noise `2 λ_k i_k/gap_k² σ_i`. With its gains given, the innovation is
//!
//! ```text
//! e = e_0 − Σ_j φ_j ϑ_j        ϑ = (λ_1, λ_2, λ_3, U cos φ, U sin φ, p_y, p_z)
//! ```
//!
//! where e_0 and the φ_j come from the same filter run on the measured positions and on what each unknown does to the acceleration
//! (Ljung, *System Identification*, 2nd ed., section 7.2: a linear regression). So does the response ζ_k to an instrument in place of u_k, and the
//! sensitivity ψ_j to each tolerance. Covariances and sums are in units of σ_z²: they depend on the ratio of the noises alone.

use libm::{sincos, sqrt};
use serde::{Deserialize, Serialize};

use super::Hold;
use super::config::EstimatorConfig;

/// Unknowns: λ of three magnets, U cos φ, U sin φ, p_y, p_z.
pub const UNKNOWNS: usize = 7;

/// Columns of the filter: measured position, unknowns, instruments, sensitivity to the logarithm of the ratio of the noises.
const COLUMNS: usize = 12;
const FIRST_INSTRUMENT: usize = 1 + UNKNOWNS;
const NOISE_RATIO: usize = COLUMNS - 1;

/// Columns of the tolerances, each for one standard deviation: s, α of three magnets, gain and offset of two positions, offset of three
/// currents; one is spare.
pub const TOLERANCES: usize = 12;

/// Standard deviation of a velocity at the start, m/s: rotors of magnetic bearings orbit within their clearance at less.
const START_VELOCITY_M_S: f64 = 1.0;

/// The least gap reckoned with, in parts of s: predictions at the start may be anywhere.
const LEAST_GAP: f64 = 0.1;

/// Time constant of the acceleration ω̇, s: short beside a run-up, long beside the noise of a speed sensor.
const ACCELERATION_TIME_S: f64 = 3.0e-3;

/// The filter: geometry and sample time.
#[derive(Clone, Debug, PartialEq)]
pub struct WhiteningFilter {
    pub(super) m_kg: f64,
    gap_m: f64,
    step_s: f64,
    /// `e_k = (sin α_k, cos α_k)`.
    direction: [[f64; 2]; 3],
    hold: Hold,
    identify_unbalance: bool,
    /// Standard deviations of s, α, gain and offset of a position, offset of a current; `None` if all are zero.
    tolerance: Option<[f64; 5]>,
}

/// One measurement with the rotor angle as sine and cosine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    pub position_m: [f64; 2],
    pub current_a: [f64; 3],
    pub theta_rad: f64,
    pub turn: [f64; 2],
    pub omega_rad_s: f64,
}

/// What the filter is run with: the present estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Running {
    /// ϑ in SI units.
    pub unknowns: [f64; UNKNOWNS],
    /// σ_z², m².
    pub position_variance: f64,
    /// σ_i², A².
    pub current_variance: f64,
    /// Whether ϑ comes from the data, and not from the first guess.
    pub estimated: bool,
    /// Mean of `i_k²/gap_k³` over the last revolution, A²/m³.
    pub field_gradient: [f64; 3],
}

/// All that changes with a sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FilterState {
    /// Samples since the last gap in the data.
    pub samples: u64,
    pub last: Sample,
    /// The last position less the one before, m.
    difference_m: [f64; 2],
    /// ω̇, rad/s².
    acceleration: f64,
    /// Response of (y, z, ẏ, ż) to each column.
    columns: [[f64; COLUMNS]; 4],
    tolerances: [[f64; TOLERANCES]; 4],
    /// Covariance of the state in units of σ_z² (index 0), and its derivative to `λ_k² σ_i²/σ_z²` (index k).
    covariance: [[[f64; 4]; 4]; 4],
}

/// What the field was in the interval that ended with a sample.
#[derive(Clone, Copy, Debug, Default)]
pub struct Field {
    /// `i_k²/gap_k²` in the middle, less the noise expected in it, A²/m².
    pub square: [f64; 3],
    /// `i_k/gap_k²`, A/m².
    pub per_current: [f64; 3],
    /// `i_k²/gap_k³`, A²/m³.
    pub gradient: [f64; 3],
}

/// One innovation and what it is made of.
#[derive(Clone, Copy, Debug)]
pub struct Innovation {
    /// e_0 and φ_1 … φ_7 of both axes, m and m per unit of the unknown.
    pub regression: [[f64; 1 + UNKNOWNS]; 2],
    /// ζ_1 … ζ_3 of both axes.
    pub instrument: [[f64; 3]; 2],
    /// ψ of both axes, m per standard deviation.
    pub tolerance: [[f64; TOLERANCES]; 2],
    /// Innovation with the present estimate, m.
    pub error: [f64; 2],
    /// Derivative of the predicted position to the logarithm of `(σ_i/σ_z)²`, m.
    pub noise_ratio: [f64; 2],
    /// Covariance S of the innovation in units of σ_z²: yy, yz, zz; its inverse likewise.
    pub covariance: [f64; 3],
    pub inverse: [f64; 3],
    /// Derivative of S to `λ_k² σ_i²/σ_z²`.
    pub by_current_noise: [[f64; 3]; 3],
}

impl Innovation {
    /// `aᵀ S⁻¹ b`.
    #[inline(always)]
    pub fn product(&self, a: [f64; 2], b: [f64; 2]) -> f64 {
        let [yy, yz, zz] = self.inverse;
        a[0] * (yy * b[0] + yz * b[1]) + a[1] * (yz * b[0] + zz * b[1])
    }

    /// `L⁻¹ a` with `S = L Lᵀ`: white where a is the innovation.
    #[inline(always)]
    pub fn whitened(&self, a: [f64; 2]) -> [f64; 2] {
        let [yy, yz, zz] = self.covariance;
        [a[0] / sqrt(yy), (a[1] - yz / yy * a[0]) / sqrt(zz - yz * yz / yy)]
    }
}

impl Innovation {
    /// `L⁻¹` times the rows of both axes.
    #[inline(always)]
    pub fn whitened_rows<const N: usize>(&self, rows: &[[f64; N]; 2]) -> [[f64; N]; 2] {
        let [yy, yz, zz] = self.covariance;
        let (y, across, z) = (1.0 / sqrt(yy), yz / yy, 1.0 / sqrt(zz - yz * yz / yy));
        [rows[0].map(|x| x * y), std::array::from_fn(|n| (rows[1][n] - across * rows[0][n]) * z)]
    }
}

impl WhiteningFilter {
    /// The filter of a checked configuration.
    pub fn new(config: &EstimatorConfig) -> Self {
        let t = &config.tolerance;
        let tolerance = [t.gap_m, t.alpha_rad, t.position_gain, t.position_offset_m, t.current_offset_a];
        Self {
            m_kg: config.m_kg,
            gap_m: config.gap_m,
            step_s: config.step_s,
            direction: config.alpha_rad.map(|alpha| sincos(alpha).into()),
            hold: config.hold,
            identify_unbalance: config.identify_unbalance,
            tolerance: tolerance.iter().any(|std| *std > 0.0).then_some(tolerance),
        }
    }

    /// Whether sensitivities to tolerances are computed.
    pub fn has_tolerances(&self) -> bool {
        self.tolerance.is_some()
    }

    /// Gaps of the magnets with the rotor at a position, m.
    #[inline(always)]
    pub fn gaps(&self, position_m: [f64; 2]) -> [f64; 3] {
        self.direction.map(|[y, z]| self.gap_m - y * position_m[0] - z * position_m[1])
    }

    /// The state at a first sample, whose position is known to σ_z and whose velocity is not.
    pub fn start(&self, sample: Sample, position_variance: f64) -> FilterState {
        let mut state = FilterState {
            samples: 0,
            last: sample,
            difference_m: [0.0; 2],
            acceleration: 0.0,
            columns: [[0.0; COLUMNS]; 4],
            tolerances: [[0.0; TOLERANCES]; 4],
            covariance: [[[0.0; 4]; 4]; 4],
        };
        for axis in 0..2 {
            state.columns[axis][0] = sample.position_m[axis];
            state.covariance[0][axis][axis] = 1.0;
            state.covariance[0][2 + axis][2 + axis] = START_VELOCITY_M_S * START_VELOCITY_M_S / position_variance;
        }
        state
    }

    /// The currents in an interval at its start, middle and end, A, and the variance of each mean in units of σ_i².
    #[inline(always)]
    fn currents(&self, last: &Sample, sample: &Sample) -> ([[f64; 3]; 3], [f64; 3]) {
        match self.hold {
            Hold::HeldBefore => ([sample.current_a; 3], [1.0; 3]),
            Hold::HeldAfter => ([last.current_a; 3], [1.0; 3]),
            Hold::Linear => {
                let middle = std::array::from_fn(|k| 0.5 * (last.current_a[k] + sample.current_a[k]));
                ([last.current_a, middle, sample.current_a], [1.0, 0.5, 1.0])
            }
        }
    }

    /// Predicts to the next sample; `instrument` makes the instruments of the three magnets out of the field.
    #[inline(always)]
    pub fn predict(
        &self,
        state: &mut FilterState,
        running: &Running,
        sample: &Sample,
        instrument: impl FnOnce(&Field) -> [f64; 3],
    ) -> Field {
        let h = self.step_s;
        let last = state.last;
        state.samples += 1;
        state.last = *sample;
        let (omega, per_kg) = (0.5 * (last.omega_rad_s + sample.omega_rad_s), 1.0 / self.m_kg);
        let rate = (sample.omega_rad_s - last.omega_rad_s) / h;
        state.acceleration += (rate - state.acceleration) * (h / ACCELERATION_TIME_S).min(1.0);
        let turns = self.turns(&last, sample, omega, state.acceleration);

        // The motion q̄ along which the field is evaluated.
        let estimate = |row: usize| {
            let columns = &state.columns[row];
            running.unknowns.iter().zip(&columns[1..]).fold(columns[0], |sum, (x, column)| sum + x * column)
        };
        let velocity = match running.estimated {
            true => [estimate(2), estimate(3)],
            // A first guess that knows no load would lead astray within a few samples.
            false => state.difference_m.map(|difference| difference / h),
        };
        state.difference_m = std::array::from_fn(|a| sample.position_m[a] - last.position_m[a]);
        let (currents, parts) = self.currents(&last, sample);
        let mut squares = [[0.0; 3]; 3];
        let mut acceleration = [0.0; 2];
        let (mut middle, mut position) = (Field::default(), last.position_m);
        let mut reciprocal = [0.0; 3];
        for at in 0..3 {
            let t = 0.5 * h * at as f64;
            let moved: [f64; 2] =
                std::array::from_fn(|a| last.position_m[a] + t * (velocity[a] + 0.5 * t * acceleration[a]));
            let inverse = self.gaps(moved).map(|gap| 1.0 / gap.max(LEAST_GAP * self.gap_m));
            squares[at] = std::array::from_fn(|k| {
                (currents[at][k] * currents[at][k] - parts[at] * running.current_variance) * inverse[k] * inverse[k]
            });
            if at == 0 {
                acceleration = self.acceleration(running, &squares[0], turns[0]);
            }
            if at == 1 {
                middle.square = squares[1];
                middle.per_current = std::array::from_fn(|k| currents[1][k] * inverse[k] * inverse[k]);
                middle.gradient = std::array::from_fn(|k| squares[1][k] * inverse[k]);
                (position, reciprocal) = (moved, inverse);
            }
        }
        let [k_yy, k_yz, k_zz] = self.stiffness(running);
        let (h2, h3) = (0.5 * h * h, h * h * h / 6.0);
        let half = [1.0 + k_yy * h2, k_yz * h2, 1.0 + k_zz * h2];
        let (cross, cross_h) = (h + k_yy * h3, h + k_zz * h3);
        let a = [
            [half[0], half[1], cross, k_yz * h3],
            [half[1], half[2], k_yz * h3, cross_h],
            [k_yy * h, k_yz * h, half[0], half[1]],
            [k_yz * h, k_zz * h, half[1], half[2]],
        ];
        // What the stiffness does to a state, beyond what a free motion does.
        let free = |x: [f64; 4]| [x[0] + h * x[2], x[1] + h * x[3], x[2], x[3]];
        let stiff = |x: [f64; 4]| {
            let free = free(x);
            std::array::from_fn::<f64, 4, _>(|r| a[r].iter().zip(x).fold(0.0, |sum, (a, x)| sum + a * x) - free[r])
        };
        let start = [last.position_m[0], last.position_m[1], velocity[0], velocity[1]];
        state.columns = multiply(&a, &state.columns);
        for (row, known) in stiff(start).into_iter().enumerate() {
            state.columns[row][0] -= known;
        }
        // Simpson's rule for what forces add to position and velocity.
        let add = |values: [f64; 3]| {
            [h * h / 6.0 * (values[0] + 2.0 * values[1]), h / 6.0 * (values[0] + 4.0 * values[1] + values[2])]
        };
        let instruments = instrument(&middle);
        for k in 0..3 {
            let added = add([squares[0][k], squares[1][k], squares[2][k]].map(|u| per_kg * u));
            let instrument = [h2, h].map(|weight| weight * per_kg * instruments[k]);
            for row in 0..4 {
                state.columns[row][1 + k] += added[row / 2] * self.direction[k][row % 2];
                state.columns[row][FIRST_INSTRUMENT + k] += instrument[row / 2] * self.direction[k][row % 2];
            }
        }
        let cosine = add(turns.map(|[c, _]| per_kg * c));
        let sine = add(turns.map(|[_, s]| per_kg * s));
        for (n, weight) in [h2, h].into_iter().enumerate() {
            let [y, z] = [2 * n, 2 * n + 1];
            state.columns[y][4] += cosine[n];
            state.columns[y][5] -= sine[n];
            state.columns[z][4] += sine[n];
            state.columns[z][5] += cosine[n];
            state.columns[y][6] += weight * per_kg;
            state.columns[z][7] += weight * per_kg;
        }
        if let Some(stds) = &self.tolerance {
            let (forces, moved) = self.by_tolerance(stds, running, &middle, position, reciprocal, start);
            state.tolerances = multiply(&a, &state.tolerances);
            for (n, (force, moved)) in forces.iter().zip(&moved).enumerate() {
                let stiff = stiff(*moved);
                for row in 0..4 {
                    state.tolerances[row][n] += [h2, h][row / 2] * force[row % 2] - stiff[row];
                }
            }
        }
        // Process noise: variance of i² per unit of σ_i², at least that of zero current.
        let noise: [f64; 3] = std::array::from_fn(|k| {
            let i = currents[1][k];
            let variance = (4.0 * i * i - 2.0 * running.current_variance).max(0.5 * running.current_variance);
            let force = reciprocal[k] * reciprocal[k] * per_kg;
            variance * force * force
        });
        let ratio = running.current_variance / running.position_variance;
        propagate(&a, &mut state.covariance);
        for (k, (along, noise)) in self.direction.into_iter().zip(noise).enumerate() {
            let g = [h2 * along[0], h2 * along[1], h * along[0], h * along[1]];
            let share = ratio * running.unknowns[k] * running.unknowns[k];
            for row in 0..4 {
                for column in 0..4 {
                    let q = noise * g[row] * g[column];
                    state.covariance[0][row][column] += share * q;
                    state.covariance[1 + k][row][column] += q;
                }
            }
        }
        middle
    }

    /// `ω² e^{jθ} − j ω̇ e^{jθ}` at start, middle and end of an interval, as cosine and sine parts; zero without unbalance.
    #[inline(always)]
    fn turns(&self, last: &Sample, sample: &Sample, omega: f64, acceleration: f64) -> [[f64; 2]; 3] {
        if !self.identify_unbalance {
            return [[0.0; 2]; 3];
        }
        let angle = last.theta_rad + 0.5 * turned(last.theta_rad, sample.theta_rad);
        let (sin, cos) = sincos(angle);
        [last.turn, [cos, sin], sample.turn]
            .map(|[c, s]| [omega * omega * c + acceleration * s, omega * omega * s - acceleration * c])
    }

    /// Acceleration with the present estimate, m/s².
    #[inline(always)]
    fn acceleration(&self, running: &Running, square: &[f64; 3], turn: [f64; 2]) -> [f64; 2] {
        let [l1, l2, l3, along, across, p_y, p_z] = running.unknowns;
        let [c, s] = turn;
        let turning = [along * c - across * s, along * s + across * c];
        std::array::from_fn(|a| {
            let magnets = [l1, l2, l3].into_iter().zip(square).zip(&self.direction);
            let pull = magnets.fold(0.0, |sum, ((lambda, square), e)| sum + lambda * square * e[a]);
            (pull + turning[a] + [p_y, p_z][a]) / self.m_kg
        })
    }

    /// Negative stiffness per mass, yy, yz, zz, 1/s².
    #[inline(always)]
    fn stiffness(&self, running: &Running) -> [f64; 3] {
        let mut stiffness = [0.0; 3];
        for (k, [y, z]) in self.direction.into_iter().enumerate() {
            let along = 2.0 * running.unknowns[k] * running.field_gradient[k] / self.m_kg;
            for (sum, part) in stiffness.iter_mut().zip([y * y, y * z, z * z]) {
                *sum += along * part;
            }
        }
        stiffness
    }

    /// For one standard deviation of each tolerance: change of the modelled acceleration, m/s², and of the state about which the model is
    /// linear.
    #[inline(always)]
    fn by_tolerance(
        &self,
        stds: &[f64; 5],
        running: &Running,
        field: &Field,
        position: [f64; 2],
        reciprocal: [f64; 3],
        start: [f64; 4],
    ) -> ([[f64; 2]; TOLERANCES], [[f64; 4]; TOLERANCES]) {
        let [gap, alpha, gain, offset, current] = *stds;
        let (mut force, mut moved) = ([[0.0; 2]; TOLERANCES], [[0.0; 4]; TOLERANCES]);
        for (k, [y, z]) in self.direction.into_iter().enumerate() {
            let per_square = running.unknowns[k] / self.m_kg;
            let pull = per_square * field.square[k];
            let gradient = 2.0 * pull * reciprocal[k];
            let across = z * position[0] - y * position[1];
            for (a, (along, turned)) in [(y, z), (z, -y)].into_iter().enumerate() {
                force[0][a] -= gap * gradient * along;
                force[1 + k][a] += alpha * (pull * turned + gradient * across * along);
                force[4][a] -= gain * gradient * along * y * position[0];
                force[5][a] -= gain * gradient * along * z * position[1];
                force[6][a] -= offset * gradient * along * y;
                force[7][a] -= offset * gradient * along * z;
                force[8 + k][a] -= current * 2.0 * per_square * field.per_current[k] * along;
            }
        }
        for a in 0..2 {
            moved[4 + a][a] = -gain * start[a];
            moved[4 + a][2 + a] = -gain * start[2 + a];
            moved[6 + a][a] = -offset;
        }
        (force, moved)
    }

    /// The innovation of the sample that was predicted.
    #[inline(always)]
    pub fn innovation(&self, state: &FilterState, running: &Running) -> Innovation {
        let columns = &state.columns;
        let p = &state.covariance;
        let covariance = [p[0][0][0] + 1.0, p[0][0][1], p[0][1][1] + 1.0];
        let determinant = covariance[0] * covariance[2] - covariance[1] * covariance[1];
        let mut regression = [[0.0; 1 + UNKNOWNS]; 2];
        let mut tolerance = [[0.0; TOLERANCES]; 2];
        let mut error = [0.0; 2];
        for a in 0..2 {
            let measured = state.last.position_m[a];
            regression[a].copy_from_slice(&columns[a][..=UNKNOWNS]);
            regression[a][0] = measured - columns[a][0];
            error[a] = regression[a][0];
            for (x, phi) in running.unknowns.iter().zip(&regression[a][1..]) {
                error[a] -= x * phi;
            }
            if let Some([_, _, gain, offset, _]) = self.tolerance {
                tolerance[a] = state.tolerances[a].map(|column| -column);
                tolerance[a][4 + a] -= gain * measured;
                tolerance[a][6 + a] -= offset;
            }
        }
        Innovation {
            regression,
            instrument: [0, 1].map(|a| std::array::from_fn(|k| columns[a][FIRST_INSTRUMENT + k])),
            tolerance,
            error,
            noise_ratio: [0, 1].map(|a| columns[a][NOISE_RATIO]),
            covariance,
            inverse: [covariance[2], -covariance[1], covariance[0]].map(|x| x / determinant),
            by_current_noise: std::array::from_fn(|k| [p[1 + k][0][0], p[1 + k][0][1], p[1 + k][1][1]]),
        }
    }

    /// Corrects the state by the innovation; `weight` is what the sensitivity to the noise counts it with.
    #[inline(always)]
    pub fn correct(&self, state: &mut FilterState, running: &Running, innovation: &Innovation, weight: f64) {
        let [yy, yz, zz] = innovation.inverse;
        let p = state.covariance[0];
        let gain = p.map(|row| [row[0] * yy + row[1] * yz, row[0] * yz + row[1] * zz]);
        let [e_y, e_z] = innovation.error;
        let residual = [yy * e_y + yz * e_z, yz * e_y + zz * e_z];
        let ratio = running.current_variance / running.position_variance;

        for a in 0..2 {
            state.columns[a][0] -= state.last.position_m[a];
        }
        correct_columns(&mut state.columns, &gain);
        for a in 0..2 {
            state.columns[a][0] += state.last.position_m[a];
        }
        if self.tolerance.is_some() {
            for (row, gain) in state.tolerances.iter_mut().zip(gain) {
                for (n, column) in row.iter_mut().enumerate() {
                    *column += gain[0] * innovation.tolerance[0][n] + gain[1] * innovation.tolerance[1][n];
                }
            }
        }
        for (n, covariance) in state.covariance.iter_mut().enumerate() {
            // (1 − K H) P (1 − K H)ᵀ + K Kᵀ
            let rows = *covariance;
            let left: [[f64; 4]; 4] = std::array::from_fn(|r| {
                std::array::from_fn(|c| rows[r][c] - gain[r][0] * rows[0][c] - gain[r][1] * rows[1][c])
            });
            let noise = if n == 0 { 1.0 } else { 0.0 };
            for r in 0..4 {
                for c in 0..4 {
                    covariance[r][c] = left[r][c] - left[r][0] * gain[c][0] - left[r][1] * gain[c][1]
                        + noise * (gain[r][0] * gain[c][0] + gain[r][1] * gain[c][1]);
                }
            }
            if n > 0 {
                let share = weight * ratio * running.unknowns[n - 1] * running.unknowns[n - 1];
                for (row, left) in state.columns.iter_mut().zip(left) {
                    row[NOISE_RATIO] += share * (left[0] * residual[0] + left[1] * residual[1]);
                }
            }
        }
    }
}

/// By how much an angle has grown, rad in [−π, π], the angles wrapped or not.
#[inline(always)]
pub fn turned(from_rad: f64, to_rad: f64) -> f64 {
    let by = to_rad - from_rad;
    by - std::f64::consts::TAU * (by / std::f64::consts::TAU).round()
}

/// `A X`.
#[inline(always)]
fn multiply<const N: usize>(a: &[[f64; 4]; 4], x: &[[f64; N]; 4]) -> [[f64; N]; 4] {
    a.map(|[a0, a1, a2, a3]| std::array::from_fn(|n| a0 * x[0][n] + a1 * x[1][n] + a2 * x[2][n] + a3 * x[3][n]))
}

/// `X − K (X_y, X_z)`.
#[inline(always)]
fn correct_columns<const N: usize>(x: &mut [[f64; N]; 4], gain: &[[f64; 2]; 4]) {
    let (y, z) = (x[0], x[1]);
    for (row, gain) in x.iter_mut().zip(gain) {
        for n in 0..N {
            row[n] -= gain[0] * y[n] + gain[1] * z[n];
        }
    }
}

/// `P ← A P Aᵀ` for each of the covariances.
#[inline(always)]
fn propagate(a: &[[f64; 4]; 4], covariances: &mut [[[f64; 4]; 4]; 4]) {
    for covariance in covariances {
        let left = multiply(a, covariance);
        *covariance = std::array::from_fn(|r| {
            std::array::from_fn(|c| {
                left[r][0] * a[c][0] + left[r][1] * a[c][1] + left[r][2] * a[c][2] + left[r][3] * a[c][3]
            })
        });
    }
}
