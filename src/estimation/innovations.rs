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
//! sensitivity ψ_n to each tolerance. Covariances and sums are in units of σ_z²: they depend on the ratio of the noises alone.
//!
//! Products of matrices whose sizes the compiler knows are left to nalgebra, which takes them in one order on every processor.

use std::f64::consts::TAU;

use libm::{sincos, sqrt};
use nalgebra::{Matrix2, Matrix4, SMatrix, Vector2, Vector4, stack};
use serde::{Deserialize, Serialize};

use super::Hold;
use super::config::EstimatorConfig;
use crate::bearing::magnet::Geometry;

/// Unknowns: λ of three magnets, U cos φ, U sin φ, p_y, p_z.
pub const UNKNOWNS: usize = 7;

/// Tolerances, each for one standard deviation: s, α of three magnets, gain and offset of two positions, offset of three currents.
pub const TOLERANCES: usize = 11;

/// The parts of an innovation: e_0, the φ of the unknowns, the ζ of three instruments, the ψ of the tolerances.
pub const SIGNALS: usize = FIRST_TOLERANCE + TOLERANCES;
pub const FIRST_INSTRUMENT: usize = 1 + UNKNOWNS;
pub const FIRST_TOLERANCE: usize = FIRST_INSTRUMENT + 3;

/// Standard deviation of a velocity at the start, m/s: rotors of magnetic bearings orbit within their clearance at less.
const START_VELOCITY_M_S: f64 = 1.0;

/// The least gap reckoned with, in parts of s: predictions at the start may be anywhere.
const LEAST_GAP: f64 = 0.1;

/// Time constant of the acceleration ω̇, s: short beside a run-up, long beside the noise of a speed sensor.
const ACCELERATION_TIME_S: f64 = 3.0e-3;

/// No part of an innovation of a bearing is as large as this, whatever its unit.
const SIGNAL_CAP: f64 = 1.0e60;

/// The unknowns ϑ.
pub type Vector = nalgebra::SVector<f64, UNKNOWNS>;

/// The filter: geometry and sample time.
#[derive(Clone, Debug, PartialEq)]
pub struct WhiteningFilter {
    m_kg: f64,
    geometry: Geometry,
    step_s: f64,
    hold: Hold,
    identify_unbalance: bool,
    /// Standard deviations of s, α, gain and offset of a position, offset of a current.
    tolerance: [f64; 5],
    /// How many of the [`SIGNALS`] are computed: the last ones, those of the tolerances, only if there are any.
    pub signals: usize,
}

/// One measurement with the rotor angle as cosine and sine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    pub position_m: Vector2<f64>,
    pub current_a: [f64; 3],
    pub theta_rad: f64,
    pub turn: [f64; 2],
    pub omega_rad_s: f64,
}

/// What the filter is run with: the present estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Running {
    /// ϑ in SI units.
    pub unknowns: Vector,
    /// Whether ϑ comes from the data, and not from the first guess.
    pub estimated: bool,
    /// σ_z², m².
    pub position_variance: f64,
    /// σ_i², A².
    pub current_variance: f64,
}

impl Running {
    /// `λ_k² σ_i²/σ_z²`.
    fn current_noise(&self, k: usize) -> f64 {
        self.unknowns[k] * self.unknowns[k] * self.current_variance / self.position_variance
    }
}

/// All that changes with a sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FilterState {
    pub last: Sample,
    /// The last position less the one before, m.
    difference_m: Vector2<f64>,
    /// ω̇, rad/s².
    acceleration: f64,
    /// What each of the signals has done to (y, z, ẏ, ż), with the sign with which it enters the innovation: that of e_0 is the negative state.
    columns: [Vector4<f64>; SIGNALS],
    /// Derivative of the state to the logarithm of `σ_i²/σ_z²`.
    by_noise_ratio: Vector4<f64>,
    /// Covariance of the state in units of σ_z² (index 0), and its derivative to `λ_k² σ_i²/σ_z²` (index k).
    covariance: [Matrix4<f64>; 4],
}

impl FilterState {
    pub fn is_finite(&self) -> bool {
        let Sample { position_m, current_a, theta_rad, turn, omega_rad_s } = &self.last;
        let sample = position_m.iter().chain(current_a).chain([theta_rad, omega_rad_s]).chain(turn);
        let state = self.columns.iter().chain([&self.by_noise_ratio]).flatten().chain(self.covariance.iter().flatten());
        sample.chain(&self.difference_m).chain([&self.acceleration]).chain(state).all(|x| x.is_finite())
    }
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
    /// e_0, φ, ζ and ψ of both axes: m, m per unit of the unknown, m per standard deviation of the tolerance.
    pub signals: [[f64; SIGNALS]; 2],
    /// Innovation with the present estimate, m.
    pub error: Vector2<f64>,
    /// Derivative of the innovation to the logarithm of `σ_i²/σ_z²`, m.
    pub by_noise_ratio: Vector2<f64>,
    /// S⁻¹, of the covariance S of the innovation in units of σ_z².
    pub inverse: Matrix2<f64>,
    /// Derivative of S to the logarithm of each magnet's `σ_i²/σ_z²`, and to its `λ_k² σ_i²/σ_z²`.
    pub by_log_ratio: Matrix2<f64>,
    pub by_current_noise: [Matrix2<f64>; 3],
    /// L⁻¹ with `S = L Lᵀ`: what it makes of the innovation is white.
    pub whitening: Matrix2<f64>,
}

impl Innovation {
    /// One of the signals.
    #[inline(always)]
    pub fn signal(&self, n: usize) -> Vector2<f64> {
        Vector2::new(self.signals[0][n], self.signals[1][n])
    }

    /// Whether S is definite, and sums of the squares of all parts stay finite.
    pub fn is_sound(&self) -> bool {
        self.signals.as_flattened().iter().all(|part| part.abs() < SIGNAL_CAP)
            && self.whitening.iter().all(|x| x.is_finite())
    }

    /// Normalised innovation squared `eᵀ S⁻¹ e/σ_z²`.
    pub fn nis(&self, position_variance: f64) -> f64 {
        self.error.dot(&(self.inverse * self.error)) / position_variance
    }
}

impl WhiteningFilter {
    /// The filter of a checked configuration.
    pub fn new(config: &EstimatorConfig) -> Self {
        let t = &config.tolerance;
        let tolerance = [t.gap_m, t.alpha_rad, t.position_gain, t.position_offset_m, t.current_offset_a];
        Self {
            m_kg: config.m_kg,
            geometry: Geometry::new(config.gap_m, config.alpha_rad),
            step_s: config.step_s,
            hold: config.hold,
            identify_unbalance: config.identify_unbalance,
            tolerance,
            signals: if tolerance.iter().any(|std| *std > 0.0) { SIGNALS } else { FIRST_TOLERANCE },
        }
    }

    /// `e_k = (sin α_k, cos α_k)`.
    #[inline(always)]
    fn directions(&self) -> [Vector2<f64>; 3] {
        self.geometry.directions.map(Vector2::from)
    }

    /// The state at a first sample, whose position is known to σ_z and whose velocity is not.
    pub fn start(&self, sample: Sample, position_variance: f64) -> FilterState {
        let velocity = START_VELOCITY_M_S * START_VELOCITY_M_S / position_variance;
        let mut state = FilterState {
            last: sample,
            difference_m: Vector2::zeros(),
            acceleration: 0.0,
            columns: [Vector4::zeros(); SIGNALS],
            by_noise_ratio: Vector4::zeros(),
            covariance: [Matrix4::zeros(); 4],
        };
        state.columns[0].fixed_rows_mut::<2>(0).copy_from(&-sample.position_m);
        state.covariance[0] = Matrix4::from_diagonal(&Vector4::new(1.0, 1.0, velocity, velocity));
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

    /// What each unknown does to the acceleration, with `u_k` and `ω² e^{jθ} − j ω̇ e^{jθ}`.
    #[inline(always)]
    fn accelerations(&self, square: &[f64; 3], [c, s]: [f64; 2]) -> SMatrix<f64, 2, UNKNOWNS> {
        let [e1, e2, e3] = self.directions();
        let [turned, loads] = [Vector2::new(c, s), Vector2::new(-s, c)];
        let [l1, l2, l3] = [e1 * square[0], e2 * square[1], e3 * square[2]];
        SMatrix::from_columns(&[l1, l2, l3, turned, loads, Vector2::x(), Vector2::y()]) / self.m_kg
    }

    /// Predicts to the next sample; `instrument` makes the instruments of the three magnets out of the field.
    #[allow(clippy::toplevel_ref_arg, reason = "nalgebra's `stack!` expands to such a pattern")]
    #[inline(always)]
    pub fn predict(
        &self,
        state: &mut FilterState,
        running: &Running,
        sample: &Sample,
        instrument: impl FnOnce(&Field) -> [f64; 3],
    ) -> Field {
        let directions = self.directions();
        let h = self.step_s;
        let (h2, h3) = (0.5 * h * h, h * h * h / 6.0);
        let last = std::mem::replace(&mut state.last, *sample);
        let rate = (sample.omega_rad_s - last.omega_rad_s) / h;
        state.acceleration += (rate - state.acceleration) * (h / ACCELERATION_TIME_S).min(1.0);
        let turns = self.turns(&last, sample, state.acceleration);

        // The motion q̄ along which the field is evaluated. A first guess that knows no load would lead it astray within a few samples.
        let velocity = match running.estimated {
            true => {
                let columns = running.unknowns.iter().zip(&state.columns[1..]);
                columns.fold(-state.columns[0], |sum, (x, column)| sum + column * *x).fixed_rows::<2>(2).into_owned()
            }
            false => state.difference_m / h,
        };
        state.difference_m = sample.position_m - last.position_m;
        let (currents, parts) = self.currents(&last, sample);
        let (mut field, mut position, mut reciprocal) = (Field::default(), last.position_m, [0.0; 3]);
        let mut by = [SMatrix::<f64, 2, UNKNOWNS>::zeros(); 3];
        for at in 0..3 {
            let t = 0.5 * h * at as f64;
            let acceleration = by[0] * running.unknowns;
            let moved = last.position_m + (velocity + acceleration * (0.5 * t)) * t;
            let least_m = LEAST_GAP * self.geometry.gap_m[0];
            let inverse = self.geometry.gaps(moved.into()).map(|gap_m| 1.0 / gap_m.max(least_m));
            let square = std::array::from_fn(|k| {
                (currents[at][k] * currents[at][k] - parts[at] * running.current_variance) * inverse[k] * inverse[k]
            });
            by[at] = self.accelerations(&square, turns[at]);
            if at == 1 {
                field.square = square;
                field.per_current = std::array::from_fn(|k| currents[1][k] * inverse[k] * inverse[k]);
                field.gradient = std::array::from_fn(|k| square[k] * inverse[k]);
                (position, reciprocal) = (moved, inverse);
            }
        }

        // Motion with the negative stiffness, and what that adds to a free one.
        let one = Matrix2::identity();
        let stiffness = (0..3).fold(Matrix2::zeros(), |sum, k| {
            let e = directions[k];
            sum + e * e.transpose() * (2.0 * running.unknowns[k] * field.gradient[k] / self.m_kg)
        });
        let (half, cross, velocity_by) = (one + stiffness * h2, one * h + stiffness * h3, stiffness * h);
        let a: Matrix4<f64> = stack![half, cross; velocity_by, half];
        let stiff: Matrix4<f64> = stack![stiffness * h2, stiffness * h3; velocity_by, stiffness * h2];
        // The response to an acceleration that is constant, and to one by Simpson's rule.
        let held = |force: Vector2<f64>| -> Vector4<f64> { stack![force * h2; force * h] };
        for column in state.columns[..self.signals].iter_mut().chain([&mut state.by_noise_ratio]) {
            *column = a * *column;
        }
        let start: Vector4<f64> = stack![last.position_m; velocity];
        state.columns[0] += stiff * start;
        let (positions, velocities) = ((by[0] + by[1] * 2.0) * (h2 / 3.0), (by[0] + by[1] * 4.0 + by[2]) * (h / 6.0));
        for j in 0..UNKNOWNS {
            let added: Vector4<f64> = stack![positions.column(j); velocities.column(j)];
            state.columns[1 + j] += added;
        }
        let instruments = instrument(&field);
        for (k, instrument) in instruments.into_iter().enumerate() {
            state.columns[FIRST_INSTRUMENT + k] += held(directions[k] * (instrument / self.m_kg));
        }
        if self.signals > FIRST_TOLERANCE {
            let by_tolerance = self.by_tolerance(running, &field, position, reciprocal, start);
            for (column, (force, moved)) in state.columns[FIRST_TOLERANCE..].iter_mut().zip(by_tolerance) {
                *column += stiff * moved - held(force);
            }
        }
        for covariance in &mut state.covariance {
            *covariance = a * *covariance * a.transpose();
        }
        for k in 0..3 {
            // The variance of i² per unit of σ_i² is 4 i² + 2 σ_i².
            let variance = 4.0 * currents[1][k] * currents[1][k] + 2.0 * running.current_variance;
            let force = held(directions[k] * (reciprocal[k] * reciprocal[k] / self.m_kg));
            let noise = force * force.transpose() * variance;
            state.covariance[0] += noise * running.current_noise(k);
            state.covariance[1 + k] += noise;
        }
        field
    }

    /// `ω² e^{jθ} − j ω̇ e^{jθ}` at start, middle and end of an interval, as cosine and sine parts; zero without unbalance.
    #[inline(always)]
    fn turns(&self, last: &Sample, sample: &Sample, acceleration: f64) -> [[f64; 2]; 3] {
        if !self.identify_unbalance {
            return [[0.0; 2]; 3];
        }
        let (sin, cos) = sincos(last.theta_rad + 0.5 * turned(last.theta_rad, sample.theta_rad));
        let omega = 0.5 * (last.omega_rad_s + sample.omega_rad_s);
        [last.turn, [cos, sin], sample.turn]
            .map(|[c, s]| [omega * omega * c + acceleration * s, omega * omega * s - acceleration * c])
    }

    /// For one standard deviation of each tolerance: change of the modelled acceleration, m/s², and of the state about which the model is
    /// linear.
    #[inline(always)]
    fn by_tolerance(
        &self,
        running: &Running,
        field: &Field,
        position: Vector2<f64>,
        reciprocal: [f64; 3],
        start: Vector4<f64>,
    ) -> [(Vector2<f64>, Vector4<f64>); TOLERANCES] {
        let [gap, alpha, gain, offset, current] = self.tolerance;
        let mut by = [(Vector2::zeros(), Vector4::zeros()); TOLERANCES];
        for (k, e) in self.directions().into_iter().enumerate() {
            let per_square = running.unknowns[k] / self.m_kg;
            let pull = per_square * field.square[k];
            let along = e * (2.0 * pull * reciprocal[k]);
            let turned = Vector2::new(e.y, -e.x);
            by[0].0 -= along * gap;
            by[1 + k].0 += (turned * pull + along * turned.dot(&position)) * alpha;
            for a in 0..2 {
                by[4 + a].0 -= along * (gain * e[a] * position[a]);
                by[6 + a].0 -= along * (offset * e[a]);
            }
            by[8 + k].0 -= e * (2.0 * current * per_square * field.per_current[k]);
        }
        for a in 0..2 {
            (by[4 + a].1[a], by[4 + a].1[2 + a]) = (-gain * start[a], -gain * start[2 + a]);
            by[6 + a].1[a] = -offset;
        }
        by
    }

    /// The innovation of the sample that was predicted.
    #[inline(always)]
    pub fn innovation(&self, state: &FilterState, running: &Running) -> Innovation {
        let [covariance, by_current_noise @ ..] = state.covariance.map(|p| p.fixed_view::<2, 2>(0, 0).into_owned());
        let covariance = covariance + Matrix2::identity();
        let [yy, yz, zz] = [covariance.m11, covariance.m12, covariance.m22];
        let root = 1.0 / sqrt(zz - yz * yz / yy);
        let mut signals = [0, 1].map(|a| state.columns.map(|column| column[a]));
        for a in 0..2 {
            signals[a][0] += state.last.position_m[a];
            if self.signals > FIRST_TOLERANCE {
                signals[a][FIRST_TOLERANCE + 4 + a] -= self.tolerance[2] * state.last.position_m[a];
                signals[a][FIRST_TOLERANCE + 6 + a] -= self.tolerance[3];
            }
        }
        let error = |a: usize| {
            let [e_0, parts @ ..] = signals[a];
            parts.iter().zip(&running.unknowns).fold(e_0, |error, (phi, x)| error - x * phi)
        };
        Innovation {
            error: Vector2::new(error(0), error(1)),
            signals,
            by_noise_ratio: state.by_noise_ratio.fixed_rows::<2>(0).into_owned(),
            inverse: Matrix2::new(zz, -yz, -yz, yy) / (yy * zz - yz * yz),
            by_log_ratio: (0..3).fold(Matrix2::zeros(), |sum, k| sum + by_current_noise[k] * running.current_noise(k)),
            by_current_noise,
            whitening: Matrix2::new(1.0 / sqrt(yy), 0.0, -yz / yy * root, root),
        }
    }

    /// Corrects the state by the innovation; `weight` is what the sensitivity to the noise counts it with.
    #[inline(always)]
    pub fn correct(&self, state: &mut FilterState, running: &Running, innovation: &Innovation, weight: f64) {
        let gain = state.covariance[0].fixed_columns::<2>(0) * innovation.inverse;
        let residual = innovation.inverse * innovation.error;
        for (n, column) in state.columns[..self.signals].iter_mut().enumerate() {
            *column -= gain * innovation.signal(n);
        }
        state.by_noise_ratio -= gain * innovation.by_noise_ratio;
        let mut kept = Matrix4::<f64>::identity();
        kept.fixed_columns_mut::<2>(0).zip_apply(&gain, |kept, gain| *kept -= gain);
        for (n, covariance) in state.covariance.iter_mut().enumerate() {
            let left: Matrix4<f64> = kept * *covariance;
            *covariance = left * kept.transpose();
            if n == 0 {
                *covariance += gain * gain.transpose();
            } else {
                let moved = left.fixed_columns::<2>(0) * residual;
                state.by_noise_ratio += moved * (weight * running.current_noise(n - 1));
            }
        }
    }
}

/// By how much an angle has grown, rad in [−π, π], the angles wrapped or not.
#[inline(always)]
pub fn turned(from_rad: f64, to_rad: f64) -> f64 {
    let by = to_rad - from_rad;
    by - TAU * (by / TAU).round()
}
