//! The whitening filter: a Kalman filter of the motion whose innovations are linear in the unknowns.
//!
//! The coordinates q are what the position sensors read. Within one sample interval
//!
//! ```text
//! q̈ = Σ_k λ_k u_k a_k + K (q − q̄) + Γ q̇ + unbalance + load        u_k = i_k²/gap_k(q̄)²        gap_k = s_k − d_k · q
//! ```
//!
//! with `a_k` the acceleration due to a unit force of magnet k, q̄ a motion that starts at the measured position, the negative stiffness
//! `K = Σ_k 2 λ_k (i_k²/gap_k³) a_k d_kᵀ` and the gyroscopic matrix Γ, proportional to the speed. An unbalance in a plane of the rotor acts there as a
//! force `U (ω² e^{j(θ+φ)} − j ω̇ e^{j(θ+φ)})` in (y, z); a backward force of constant magnitude turns against the rotor as `e^{−j(θ+φ)}`. The filter
//! has the state (q, q̇), measurement noise σ_z and process noise `2 λ_k i_k/gap_k² σ_i`. For given gains the innovation is
//!
//! ```text
//! e = e_0 − Σ_j φ_j ϑ_j        ϑ = (λ_k, U cos φ and U sin φ of each plane, B cos φ and −B sin φ of each backward force, constant loads)
//! ```
//!
//! where e_0 and the φ_j come from the same filter, applied to the measured positions and to the effect of each unknown on the acceleration
//! (Ljung, *System Identification*, 2nd ed., section 7.2: a linear regression). So do the response ζ_k to an instrument in place of u_k and the
//! sensitivity ψ_n to each tolerance. Covariances and sums are in units of σ_z², so that they depend only on the ratio of the noise variances.
//!
//! Sizes: N coordinates, K magnets, U unknowns, T tolerances.

use libm::sqrt;
use nalgebra::{Matrix2, RowSVector, SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::Hold;
use super::angle::{Rotation, angle_difference, cos_sin};
use super::motion::{Covariance, Motions, Square, Transition, Turn, add_product, product};
use crate::bearing::array;
use crate::bearing::magnet::Geometry;

/// The rotor and its magnets, in the coordinates that the position sensors read.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine<const N: usize, const K: usize, const U: usize> {
    /// Gaps in m, and directions `d_k`.
    pub geometry: Geometry<f64, N, K>,
    /// Row j: the acceleration, m/s², due to a unit force of unknown j: 1 N of a magnet; 1 N along y and 1 N along z in each plane of unbalance, then
    /// for each backward force; a unit of each load.
    pub accelerations: SMatrix<f64, U, N>,
    /// Index of the first backward force among the unknowns.
    pub backward: usize,
    /// Γ per speed, if the rotor has gyroscopic effects.
    pub gyroscopic: Option<Square<N>>,
}

impl<const N: usize, const K: usize, const U: usize> Machine<N, K, U> {
    /// The loads that accelerate a position by 1 m/s², one on each coordinate.
    pub fn unit_loads(&self) -> SVector<f64, N> {
        SVector::from_fn(|n, _| 1.0 / self.accelerations.row(U - N + n).amax())
    }

    /// Change of the machine by one standard deviation of a parameter: `(M(p + σ) − M(p − σ))/2`.
    pub fn variation([more, less]: [Self; 2]) -> Self {
        let half = |a: f64, b: f64| 0.5 * (a - b);
        let directions = |a, b| array::each(&a, &b, half);
        Self {
            geometry: Geometry {
                gap_m: array::each(&more.geometry.gap_m, &less.geometry.gap_m, half),
                directions: array::each(&more.geometry.directions, &less.geometry.directions, directions),
            },
            accelerations: (more.accelerations - less.accelerations) * 0.5,
            backward: more.backward,
            gyroscopic: more.gyroscopic.zip(less.gyroscopic).map(|(more, less)| (more - less) * 0.5),
        }
    }
}

/// Tolerances, T columns in all: one for each variation of the machine, then gain and offset of each position, offset of each current.
#[derive(Clone, Debug, PartialEq)]
pub struct Tolerances<const N: usize, const K: usize, const U: usize> {
    pub variations: Vec<Machine<N, K, U>>,
    /// Standard deviations of the gain and of the offset of a position, m, and of the offset of a current, A.
    pub gain: f64,
    pub offset_m: f64,
    pub current_a: f64,
}

/// The filter.
#[derive(Clone, Debug, PartialEq)]
pub struct WhiteningFilter<const N: usize, const K: usize, const U: usize, const T: usize> {
    pub machine: Machine<N, K, U>,
    pub step_s: f64,
    pub hold: Hold,
    pub identify_unbalance: bool,
    pub identify_backward: bool,
    /// `None` if all tolerances are zero.
    pub tolerances: Option<Tolerances<N, K, U>>,
}

/// Missing samples over which the filter predicts; after more it restarts. If it restarted after every gap, estimates would be valid 71 instead of 99 %
/// of the time with 10 % of the samples missing (noise estimated, seeds 1450001 to 1450020).
pub const MAX_BRIDGED: u32 = 8;

/// One measurement with the rotation of the rotor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sample<const N: usize, const K: usize> {
    pub position_m: SVector<f64, N>,
    pub current_a: SVector<f64, K>,
    pub rotation: Rotation,
    /// Cosine and sine of the angle.
    pub cos_sin: [f64; 2],
    /// Missing samples before this one.
    pub missing: u32,
}

impl<const N: usize, const K: usize> Sample<N, K> {
    pub fn new(position_m: [f64; N], current_a: [f64; K], rotation: Rotation) -> Self {
        let cos_sin = cos_sin(rotation.theta_rad);
        Self { position_m: position_m.into(), current_a: current_a.into(), rotation, cos_sin, missing: 0 }
    }

    /// A sample interpolated between this one and another, at a fraction of the time.
    pub fn between(&self, other: &Self, fraction: f64) -> Self {
        let current_a = self.current_a.lerp(&other.current_a, fraction);
        let rotation = self.rotation.between(&other.rotation, fraction);
        Self::new(self.position_m.lerp(&other.position_m, fraction).into(), current_a.into(), rotation)
    }
}

/// The present estimates, which set the gains of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters<const U: usize> {
    /// ϑ in SI units.
    pub unknowns: SVector<f64, U>,
    /// Whether ϑ is estimated from data rather than the first guess.
    pub estimated: bool,
    /// σ_z², m².
    pub position_variance: f64,
    /// σ_i², A².
    pub current_variance: f64,
}

impl<const U: usize> Parameters<U> {
    /// `λ_k² σ_i²/σ_z²`.
    fn current_noise(&self, k: usize) -> f64 {
        self.unknowns[k] * self.unknowns[k] * self.current_variance / self.position_variance
    }
}

/// State between samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FilterState<const N: usize, const K: usize, const U: usize, const T: usize> {
    pub last: Sample<N, K>,
    /// The last position minus the one before, m, if there was one.
    difference_m: Option<SVector<f64, N>>,
    /// Effect of each signal on (q, q̇), with its sign in the innovation: for e_0 the negative state.
    motion: Motions<1, N>,
    unknowns: Motions<U, N>,
    instruments: Motions<K, N>,
    tolerances: Motions<T, N>,
    /// Derivative of the state with respect to `ln (σ_i²/σ_z²)`.
    by_noise_ratio: Motions<1, N>,
    /// Covariance of the state in units of σ_z², and its derivatives with respect to `λ_k² σ_i²/σ_z²`.
    covariance: Covariance<N>,
    by_current_noise: SVector<Covariance<N>, K>,
}

/// The field in the middle of a sample interval.
#[derive(Clone, Copy, Debug)]
pub struct Field<const N: usize, const K: usize> {
    position: SVector<f64, N>,
    /// `1/gap_k`.
    reciprocal: SVector<f64, K>,
    /// `i_k/gap_k²`, A/m².
    pub per_current: SVector<f64, K>,
    /// `i_k²/gap_k³`, A²/m³.
    pub gradient: SVector<f64, K>,
}

/// The factors of the unknowns at an instant, or their mean over an interval.
struct Regressors<const K: usize> {
    /// `u_k`.
    square: SVector<f64, K>,
    /// Columns: `ω² e^{jθ} − j ω̇ e^{jθ}` and `e^{jθ}`, as cosine and sine parts.
    rotating: Matrix2<f64>,
    load: f64,
}

impl<const K: usize> Regressors<K> {
    /// The sum with weights for start, middle and end.
    #[inline(always)]
    fn weighted([u, v, w]: [f64; 3], [a, b, c]: &[Self; 3]) -> Self {
        Self {
            square: a.square * u + b.square * v + c.square * w,
            rotating: a.rotating * u + b.rotating * v + c.rotating * w,
            load: a.load * u + b.load * v + c.load * w,
        }
    }
}

/// One innovation and its components, whitened: multiplied by L⁻¹, with the covariance `S = L Lᵀ` of the innovation in units of σ_z².
#[derive(Clone, Copy, Debug)]
pub struct Innovation<const N: usize, const K: usize, const U: usize, const T: usize> {
    /// e_0, m.
    pub motion: RowSVector<f64, N>,
    /// φ, m per unit of the unknown.
    pub unknowns: SMatrix<f64, U, N>,
    /// ζ.
    pub instruments: SMatrix<f64, K, N>,
    /// ψ, m per standard deviation of the tolerance; `None` if all tolerances are zero.
    pub tolerances: Option<SMatrix<f64, T, N>>,
    /// Innovation with the present estimate, m.
    pub error: SVector<f64, N>,
    /// The same, not whitened.
    pub error_m: SVector<f64, N>,
    /// Predicted position, m, and what the predicted velocity adds to it per sample, m.
    pub predicted_m: [SVector<f64, N>; 2],
    /// Derivative of the innovation with respect to `ln (σ_i²/σ_z²)`, m.
    pub by_noise_ratio: SVector<f64, N>,
    /// Derivative of S with respect to `ln (σ_i²/σ_z²)`.
    pub by_log_ratio: Square<N>,
    /// Trace of `S⁻¹` times the derivative of S with respect to each `λ_k² σ_i²/σ_z²`.
    pub by_current_noise: SVector<f64, K>,
    /// L⁻¹.
    whitening: Square<N>,
}

impl<const N: usize, const K: usize, const U: usize, const T: usize> Innovation<N, K, U, T> {
    /// Whether S is positive definite, and sums of products of the components stay finite over any number of samples.
    pub fn is_sound(&self) -> bool {
        let tolerances = self.tolerances.map_or(0.0, |tolerances| tolerances.norm_squared());
        let signals = self.motion.norm_squared() + self.unknowns.norm_squared() + self.instruments.norm_squared();
        [signals, tolerances, self.whitening.norm_squared()].iter().all(|square| *square < 1.0e120)
    }

    /// Normalised innovation squared `eᵀ S⁻¹ e/σ_z²`.
    pub fn nis(&self, position_variance: f64) -> f64 {
        self.error.norm_squared() / position_variance
    }
}

/// L⁻¹ for `S = L Lᵀ`: rows orthonormalised with respect to S one after the other.
#[inline(always)]
fn whitening<const N: usize>(s: &Square<N>) -> Square<N> {
    let mut rows = [SVector::<f64, N>::zeros(); N];
    for n in 0..N {
        let (mut row, mut variance) = (SVector::zeros(), s[(n, n)]);
        row[n] = 1.0;
        for former in &rows[..n] {
            let along = former.dot(&s.column(n));
            (row, variance) = (row - former * along, variance - along * along);
        }
        rows[n] = row / sqrt(variance);
    }
    Square::from_columns(&rows).transpose()
}

impl<const N: usize, const K: usize, const U: usize, const T: usize> WhiteningFilter<N, K, U, T> {
    /// Index of the first load among the unknowns.
    pub const LOADS: usize = {
        assert!(U >= N + K && (U - N - K).is_multiple_of(2) && T >= 2 * N + K);
        U - N
    };

    /// The state at a first sample, with a position known to σ_z and an unknown velocity.
    pub fn start(&self, sample: Sample<N, K>, position_variance: f64) -> FilterState<N, K, U, T> {
        // Standard deviation 1 m/s: rotors orbit more slowly within the clearance of magnetic bearings.
        let velocity_variance = 1.0 / position_variance;
        let zero = Covariance { position: Square::zeros(), mixed: Square::zeros(), rate: Square::zeros() };
        let position = Square::identity();
        FilterState {
            last: sample,
            difference_m: None,
            motion: Motions { position: -sample.position_m.transpose(), rate: SMatrix::zeros() },
            unknowns: Motions::zeros(),
            instruments: Motions::zeros(),
            tolerances: Motions::zeros(),
            by_noise_ratio: Motions::zeros(),
            covariance: Covariance { position, mixed: Square::zeros(), rate: position * velocity_variance },
            by_current_noise: SVector::from_element(zero),
        }
    }

    /// The currents at start, middle and end of an interval, A, and their variances in units of σ_i².
    #[inline(always)]
    fn currents(&self, last: &Sample<N, K>, sample: &Sample<N, K>) -> ([SVector<f64, K>; 3], [f64; 3]) {
        match self.hold {
            Hold::HeldBefore => ([sample.current_a; 3], [1.0; 3]),
            Hold::HeldAfter => ([last.current_a; 3], [1.0; 3]),
            Hold::Linear => {
                let middle = (last.current_a + sample.current_a) * 0.5;
                ([last.current_a, middle, sample.current_a], [1.0, 0.5, 1.0])
            }
        }
    }

    /// Effect of each unknown on the acceleration.
    #[inline(always)]
    fn responses(&self, accelerations: &SMatrix<f64, U, N>, at: &Regressors<K>) -> SMatrix<f64, U, N> {
        let mut responses = *accelerations;
        let inverse = at.rotating.data.0.map(|[c, s]| [c, -s]);
        responses.data.0.iter_mut().for_each(|column| self.multiply(column, at, inverse));
        responses
    }

    /// The forces that multiply the rows of the machine's accelerations: `responses(a)ᵀ ϑ = aᵀ forces`.
    #[inline(always)]
    fn forces(&self, unknowns: &SVector<f64, U>, at: &Regressors<K>) -> SVector<f64, U> {
        let mut forces = *unknowns;
        self.multiply(&mut forces.data.0[0], at, at.rotating.data.0);
        forces
    }

    /// Multiplies by the factors of the unknowns; rotates the pairs of the unbalances by (c, s), those of the backward forces against (bc, bs).
    #[inline(always)]
    fn multiply(&self, x: &mut [f64; U], at: &Regressors<K>, [[c, s], [bc, bs]]: [[f64; 2]; 2]) {
        x.iter_mut().zip(&at.square).for_each(|(x, square)| *x *= square);
        for j in (K..self.machine.backward).step_by(2) {
            (x[j], x[j + 1]) = (c * x[j] - s * x[j + 1], c * x[j + 1] + s * x[j]);
        }
        for j in (self.machine.backward..Self::LOADS).step_by(2) {
            (x[j], x[j + 1]) = (bc * x[j] + bs * x[j + 1], bc * x[j + 1] - bs * x[j]);
        }
        x[Self::LOADS..].iter_mut().for_each(|x| *x *= at.load);
    }

    /// Predicts to the next sample; `instrument` returns the instruments of the magnets from their `u_k`.
    #[inline(always)]
    pub fn predict(
        &self,
        state: &mut FilterState<N, K, U, T>,
        parameters: &Parameters<U>,
        sample: &Sample<N, K>,
        instrument: impl FnOnce(&SVector<f64, K>) -> SVector<f64, K>,
    ) -> Field<N, K> {
        let geometry = &self.machine.geometry;
        let h = self.step_s;
        let (h2, h3) = (0.5 * h * h, h * h * h / 6.0);
        let last = std::mem::replace(&mut state.last, *sample);
        let omega = 0.5 * (last.rotation.omega_rad_s + sample.rotation.omega_rad_s);
        let pairs = self.rotating_factors(&last, sample);

        // Mean accelerations over the interval due to constant forces, for rates and for coordinates: gyroscopic effects turn part of them.
        let turn = self.machine.gyroscopic.map(|per_speed| Turn::of(per_speed * (omega * h)));
        let (mut accelerations, mut to_coordinates) = (self.machine.accelerations, self.machine.accelerations);
        if let Some(turn) = &turn {
            accelerations = product(&accelerations, &turn.once);
            to_coordinates = product(&to_coordinates, &turn.twice);
        }

        // Initial velocity of the motion q̄ along which the field is evaluated: a difference of positions in the first interval, and with the first guess,
        // whose state diverges within a few samples because it contains no load.
        let difference_m = sample.position_m - last.position_m;
        let velocity = match state.difference_m.replace(difference_m) {
            Some(_) if parameters.estimated => {
                state.unknowns.rate.tr_mul(&parameters.unknowns) - state.motion.rate.transpose()
            }
            Some(former_m) => former_m / h,
            None => difference_m / h,
        };
        let (currents, ratios) = self.currents(&last, sample);
        let zero = SVector::<f64, K>::zeros();
        let mut regressors = pairs.map(|pairs| Regressors { square: zero, rotating: pairs.into(), load: 1.0 });
        let (mut position, mut reciprocal) = (last.position_m, zero);
        let mut acceleration = SVector::<f64, N>::zeros();
        for at in 0..3 {
            let t = 0.5 * h * at as f64;
            let moved = last.position_m + (velocity + acceleration * (0.5 * t)) * t;
            let gaps = geometry.gaps(moved.into());
            // Initial predictions may be outside the gap.
            let inverse = SVector::<f64, K>::from_fn(|k, _| 1.0 / gaps[k].max(0.1 * geometry.gap_m[k]));
            regressors[at].square = SVector::from_fn(|k, _| {
                (currents[at][k] * currents[at][k] - ratios[at] * parameters.current_variance) * inverse[k] * inverse[k]
            });
            if at == 0 {
                acceleration = accelerations.tr_mul(&self.forces(&parameters.unknowns, &regressors[0]));
            }
            if at == 1 {
                (position, reciprocal) = (moved, inverse);
            }
        }
        let square = regressors[1].square;
        let per_current = currents[1].component_mul(&reciprocal).component_mul(&reciprocal);
        let field = Field { position, reciprocal, per_current, gradient: square.component_mul(&reciprocal) };

        // Transition with the negative stiffness, and its difference from that of a free motion.
        let pulls: [SVector<f64, N>; K] = array::from_fn(|k| accelerations.row(k).transpose());
        let mut stiffness = Square::<N>::zeros();
        for (k, pull) in pulls.iter().enumerate() {
            let along = SVector::from(geometry.directions[k]) * (2.0 * parameters.unknowns[k] * field.gradient[k]);
            add_product(&mut stiffness, pull, &along);
        }
        let stiff = Transition {
            position: stiffness * h2,
            position_by_rate: stiffness * h3,
            rate_by_position: stiffness * h,
            rate: stiffness * h2,
        };
        let mut a = Transition {
            position: Square::identity() + stiff.position,
            position_by_rate: Square::identity() * h + stiff.position_by_rate,
            rate_by_position: stiff.rate_by_position,
            rate: Square::identity() + stiff.rate,
        };
        if let Some(turn) = &turn {
            a.position_by_rate += (turn.once - Square::identity()) * h;
            a.rate += turn.whole - Square::identity();
        }
        state.motion.predict(&a);
        state.unknowns.predict(&a);
        state.instruments.predict(&a);
        state.by_noise_ratio.predict(&a);
        let start = Motions { position: last.position_m.transpose(), rate: velocity.transpose() };
        state.motion.add(&stiff, &start);
        // Simpson's rule.
        for (sum, accelerations, weights) in [
            (&mut state.unknowns.position, &to_coordinates, [h2 / 3.0, 2.0 * h2 / 3.0, 0.0]),
            (&mut state.unknowns.rate, &accelerations, [h / 6.0, 4.0 * h / 6.0, h / 6.0]),
        ] {
            *sum += self.responses(accelerations, &Regressors::weighted(weights, &regressors));
        }
        // Instruments are constant over the interval.
        let instruments = instrument(&square);
        let by_instruments = SMatrix::<f64, K, N>::from_fn(|k, n| accelerations[(k, n)] * instruments[k]);
        state.instruments.position += by_instruments * h2;
        state.instruments.rate += by_instruments * h;
        if let Some(tolerances) = &self.tolerances {
            let forces = self.forces(&parameters.unknowns, &regressors[1]);
            let (by_force, state_change) = self.by_tolerance(tolerances, parameters, &field, &forces, &start, omega);
            state.tolerances.predict(&a);
            state.tolerances.add(&stiff, &state_change);
            state.tolerances.position -= by_force * h2;
            state.tolerances.rate -= by_force * h;
        }
        state.covariance.predict(&a);
        for (k, pull) in pulls.iter().enumerate() {
            // The variance of i² per unit of σ_i² is 4 i² + 2 σ_i².
            let variance = 4.0 * currents[1][k] * currents[1][k] + 2.0 * parameters.current_variance;
            let force = pull * (reciprocal[k] * reciprocal[k] * h);
            let noise = product(&force, &force) * variance;
            let own = &mut state.by_current_noise[k];
            own.drift_and_kick(h, &stiff.rate_by_position, turn.as_ref().map(|turn| &turn.gyroscopic));
            for (covariance, scale) in [(own, 1.0), (&mut state.covariance, parameters.current_noise(k))] {
                covariance.position += noise * (0.25 * h * h * scale);
                covariance.mixed += noise * (0.5 * h * scale);
                covariance.rate += noise * scale;
            }
        }
        field
    }

    /// `ω² e^{jθ} − j ω̇ e^{jθ}` and `e^{jθ}` at start, middle and end of an interval, as cosine and sine parts; zero if not identified.
    #[inline(always)]
    fn rotating_factors(&self, last: &Sample<N, K>, sample: &Sample<N, K>) -> [[[f64; 2]; 2]; 3] {
        if U == N + K {
            return [[[0.0; 2]; 2]; 3];
        }
        let (from, to) = (&last.rotation, &sample.rotation);
        let omega = 0.5 * (from.omega_rad_s + to.omega_rad_s);
        let acceleration = 0.5 * (from.acceleration_rad_s2 + to.acceleration_rad_s2);
        let middle = cos_sin(from.theta_rad + 0.5 * angle_difference(from.theta_rad, to.theta_rad));
        let [unbalance, backward] = [self.identify_unbalance, self.identify_backward].map(f64::from);
        [last.cos_sin, middle, sample.cos_sin].map(|[c, s]| {
            let [along, across] = [omega * omega * unbalance, acceleration * unbalance];
            [[along * c + across * s, along * s - across * c], [backward * c, backward * s]]
        })
    }

    /// For one standard deviation of each tolerance: change of the modelled acceleration due to these forces, m/s², and of the state about which the
    /// model is linearised.
    #[inline(always)]
    fn by_tolerance(
        &self,
        &Tolerances { ref variations, gain, offset_m, current_a }: &Tolerances<N, K, U>,
        parameters: &Parameters<U>,
        field: &Field<N, K>,
        forces: &SVector<f64, U>,
        start: &Motions<1, N>,
        omega: f64,
    ) -> (SMatrix<f64, T, N>, Motions<T, N>) {
        let (mut by_force, mut state_change) = (SMatrix::<f64, T, N>::zeros(), Motions::zeros());
        let [gains, offsets, currents] = [T - 2 * N - K, T - N - K, T - K];
        // Force per gap.
        let stiffness: [f64; K] = array::from_fn(|k| 2.0 * forces[k] * field.reciprocal[k]);
        let pulls: [SVector<f64, N>; K] = array::from_fn(|k| self.machine.accelerations.row(k).transpose());
        for (v, variation) in variations.iter().enumerate() {
            let mut change = variation.accelerations.tr_mul(forces);
            for k in 0..K {
                let approach =
                    SVector::from(variation.geometry.directions[k]).dot(&field.position) - variation.geometry.gap_m[k];
                change += pulls[k] * (stiffness[k] * approach);
            }
            if let Some(gyroscopic) = &variation.gyroscopic {
                change += gyroscopic * start.rate.transpose() * omega;
            }
            by_force.set_row(v, &change.transpose());
        }
        for k in 0..K {
            let direction = self.machine.geometry.directions[k];
            for n in 0..N {
                let along = pulls[k][n] * stiffness[k];
                for a in 0..N {
                    by_force[(gains + a, n)] -= along * (gain * direction[a] * field.position[a]);
                    by_force[(offsets + a, n)] -= along * (offset_m * direction[a]);
                }
                by_force[(currents + k, n)] -=
                    pulls[k][n] * (2.0 * current_a * parameters.unknowns[k] * field.per_current[k]);
            }
        }
        for a in 0..N {
            state_change.position[(gains + a, a)] = -gain * start.position[a];
            state_change.rate[(gains + a, a)] = -gain * start.rate[a];
            state_change.position[(offsets + a, a)] = -offset_m;
        }
        (by_force, state_change)
    }

    /// The innovation of the predicted sample.
    #[inline(always)]
    pub fn innovation(&self, state: &FilterState<N, K, U, T>, parameters: &Parameters<U>) -> Innovation<N, K, U, T> {
        let whitening = whitening(&(state.covariance.position + Square::identity()));
        let measured = state.last.position_m.transpose();
        let motion = product(&(state.motion.position + measured), &whitening);
        let unknowns = product(&state.unknowns.position, &whitening);
        let inverse = whitening.tr_mul(&whitening);
        let by_current_noise = SVector::from_fn(|k, _| inverse.dot(&state.by_current_noise[k].position));
        let by_log_ratio: Square<N> =
            (0..K).map(|k| state.by_current_noise[k].position * parameters.current_noise(k)).sum();
        let by_log_ratio = product(&product(&whitening, &by_log_ratio), &whitening);
        let tolerances = self.tolerances.as_ref().map(|&Tolerances { gain, offset_m, .. }| {
            let mut tolerances = state.tolerances.position;
            for n in 0..N {
                tolerances[(T - 2 * N - K + n, n)] -= gain * measured[n];
                tolerances[(T - N - K + n, n)] -= offset_m;
            }
            product(&tolerances, &whitening)
        });
        let velocity = state.unknowns.rate.tr_mul(&parameters.unknowns) - state.motion.rate.transpose();
        let error_m = state.last.position_m + state.motion.position.transpose()
            - state.unknowns.position.tr_mul(&parameters.unknowns);
        Innovation {
            error: whitening * error_m,
            error_m,
            predicted_m: [state.last.position_m - error_m, velocity * self.step_s],
            motion,
            unknowns,
            instruments: product(&state.instruments.position, &whitening),
            tolerances,
            by_noise_ratio: whitening * state.by_noise_ratio.position.transpose(),
            by_log_ratio,
            by_current_noise,
            whitening,
        }
    }

    /// Corrects the state by the innovation; `weight` applies to the sensitivity to the noise.
    #[inline(always)]
    pub fn correct(
        &self,
        state: &mut FilterState<N, K, U, T>,
        parameters: &Parameters<U>,
        innovation: &Innovation<N, K, U, T>,
        weight: f64,
    ) {
        let whitening = &innovation.whitening;
        // The gains for whitened and for unwhitened signals.
        let whitened = [&state.covariance.position, &state.covariance.mixed.transpose()].map(|p| product(p, whitening));
        let gain = whitened.map(|gain| gain * whitening);
        state.motion.correct(&whitened, &innovation.motion);
        state.unknowns.correct(&whitened, &innovation.unknowns);
        state.instruments.correct(&whitened, &innovation.instruments);
        if let Some(tolerances) = &innovation.tolerances {
            state.tolerances.correct(&whitened, tolerances);
        }
        state.by_noise_ratio.correct(&whitened, &innovation.by_noise_ratio.transpose());
        state.covariance.correct(&gain);
        add_product(&mut state.covariance.position, &gain[0], &gain[0]);
        add_product(&mut state.covariance.mixed, &gain[0], &gain[1]);
        add_product(&mut state.covariance.rate, &gain[1], &gain[1]);
        let residual = whitening.tr_mul(&innovation.error);
        for (k, covariance) in state.by_current_noise.iter_mut().enumerate() {
            let [above, below] = covariance.correct(&gain);
            if weight > 0.0 {
                let scale = weight * parameters.current_noise(k);
                state.by_noise_ratio.position += (above * residual * scale).transpose();
                state.by_noise_ratio.rate += (below * residual * scale).transpose();
            }
        }
    }
}
