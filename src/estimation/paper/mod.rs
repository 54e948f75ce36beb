//! The paper's estimates, P(19) and P(20): Cramer's rule on the z axis, numerators and determinant filtered separately.
//!
//! One row of `D Λ = N`, P(18), is the weak form of the equation of motion along one axis over the window of length `T_f` that
//! ends now, with a test function that eliminates initial conditions and constant forces (see [`kernel`]):
//!
//! ```text
//! ∫ g_z,i Y dτ = T_f² Σ_k λ_k ∫ g_u,i u_y,k dτ        u_y,k = sin α_k i_k²/(m gap_k²)
//! ∫ g_z,i Z dτ = T_f² Σ_k λ_k ∫ g_u,i u_z,k dτ        u_z,k = cos α_k i_k²/(m gap_k²)
//! ```
//!
//! Each row is divided by its gain for white position noise, so that all rows are in metres and have the same noise; the
//! column of `λ_k` is multiplied by `λ_0,k`, so that the unknowns are `λ_k/λ_0,k`. The normal equations of both axes are
//! filtered as well, to test the result.

pub mod kernel;
mod lowpass;
pub mod window;

use libm::sincos;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use serde::{Deserialize, Serialize};

use self::kernel::ROWS_PER_AXIS;
use self::lowpass::{LowPass, LowPassState};
use self::window::{Integrals, Sample, Window, WindowSums};
use super::CONDITION_CAP;
use super::config::{EstimatorConfig, EstimatorConfigOf, EstimatorInput, EstimatorOutput, Hold, Method, Verdict};
use super::sums::norm;
use crate::bearing::{RotorConfig, array, joined};
use crate::invalid::Checks;
use crate::machine::Machine;
use crate::variables::numbers;

/// Largest relative deviation of `T_f/T_s` from a whole number.
const WHOLE_NUMBER_TOLERANCE: f64 = 1.0e-6;

/// Largest condition number of a valid estimate; on the paper's orbit it is 17 to 32.
const CONDITION_LIMIT: f64 = 60.0;

/// Largest residual of a valid estimate: above it the model explains less than three quarters of the mean square of the motion.
const RESIDUAL_LIMIT: f64 = 0.5;

/// Largest relative standard deviation of a λ of a valid estimate.
///
/// The standard deviation attributes the whole residual to one error in the worst direction, about five times the actual error: in the paper's own
/// simulation, where a perturbation of 2 N in phase with the reference trajectory causes 4.6 %, it is 20 %.
pub const STD_LIMIT: f64 = 5.0 * super::STD_LIMIT;

/// Windows without a common sample that the residual needs: the six rows of the first one leave only three degrees of freedom, and overfit.
const MIN_WINDOWS: u64 = 3;

/// The paper assumes no unbalance, and the residual detects one, but not on a circular orbit: there the unbalance force turns with the acceleration of the
/// rotor, and is equivalent to force constants that are all too small or too large by the same factor. `(a² − b²)/(a² + b²)` of the acceleration with the
/// half-axes a and b must be at least this; it is 0.69 on the paper's orbit and 0.1 if the half-axes differ by a tenth.
const CIRCULAR_LIMIT: f64 = 0.1;

/// Relative discretisation error: the smallest relative standard deviation, even without noise.
const MODEL_STD: f64 = 1.0e-4;

/// Smallest variation of `i²/gap²`, relative to its level, that counts as excitation; rounding is about 1e-15.
const EXCITATION_FLOOR: f64 = 1.0e-9;

/// The low-passed quantities.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Channels {
    /// The normal equations: `DᵀD`, `DᵀN` and `|N|²`.
    normal: [f64; 9],
    right: [f64; 3],
    square: f64,
    /// n_1, n_2, n_3 and d of P(20), with signs aligned or not depending on the method.
    numerators: [f64; 3],
    determinant: f64,
    /// Squared size of each column of D without cancellation.
    level: [f64; 3],
    /// `|N_y|² − |N_z|²` and `2 N_y·N_z`: both are zero on a circle.
    shape: [f64; 2],
}

impl Channels {
    /// Combines two sets, number by number.
    fn with(&self, other: &Self, join: impl Fn(f64, f64) -> f64) -> Self {
        joined!(self, other, join, Channels { square, determinant; normal, right, numerators, level, shape; })
    }

    /// Whether no product can overflow; greater numbers, and NaN, come from non-physical samples.
    fn are_sound(&self) -> bool {
        let Self { normal, right, square, numerators, determinant, level, shape } = self;
        let numbers = [&normal[..], right, &[*square, *determinant], numerators, level, shape];
        numbers.into_iter().flatten().all(|x| x.abs() < 1.0e150)
    }

    /// `DᵀD`.
    fn normal(&self) -> Matrix3<f64> {
        Matrix3::from_column_slice(&self.normal)
    }

    /// `n_i/d`, scaled unknowns; not finite if d is zero.
    fn ratio(&self) -> [f64; 3] {
        self.numerators.map(|numerator| numerator / self.determinant)
    }

    /// `√(F(|N − D x|²)/F(|N|²))`, 1 without motion; finite.
    fn residual(&self, x: &Vector3<f64>) -> f64 {
        let square = self.square - 2.0 * x.dot(&Vector3::from(self.right)) + x.dot(&(self.normal() * x));
        if self.square > 0.0 { (square.max(0.0) / self.square).sqrt().min(1.0e6) } else { 1.0 }
    }
}

/// Reports parameters with which the paper's methods cannot be used, under their names in the interface.
pub fn check<const K: usize>(config: &EstimatorConfigOf<RotorConfig, K>, machine: &Machine, checks: &mut Checks) {
    for (name, value, unit) in numbers("tolerance.", &config.tolerance, machine) {
        let wanted = "0, or method = predictionError, for the paper's methods have no use for a tolerance";
        let unused = value == 0.0 || name == "tolerance.backwardForce";
        checks.require(unused, name, format_args!("{value} {unit}"), wanted);
    }
    let wanted = "true, or method = predictionError, for the paper's methods identify no unbalance";
    checks.require(config.identify_unbalance, "identify.unbalance", config.identify_unbalance, wanted);
    let (n, slack) = (config.window_s / config.step_s, WHOLE_NUMBER_TOLERANCE);
    for (holds, wanted) in [
        // The kernels must resolve three changes of sign.
        (n >= 8.0 * (1.0 - slack), "at least 8 Ts"),
        // Memory grows in proportion to the window, rounding errors of the kernels with its cube.
        (n <= 1.0e5 * (1.0 + slack), "at most 100000 Ts"),
        ((n - n.round()).abs() <= slack * n, "a whole number of Ts"),
    ] {
        checks.number(holds, "Tf", (config.window_s, "s"), wanted);
    }
    let is_long = config.epsilon_s >= config.window_s * (1.0 - slack);
    let wanted = "at least Tf, the time to fill the first window";
    checks.number(is_long, "epsilon", (config.epsilon_s, "s"), wanted);
}

/// State between samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PaperState {
    /// Samples since the start.
    samples: u64,
    /// `1/gap_k²` at the last sample and at the one before, 1/m².
    inverse_square_gap: [[f64; 3]; 2],
    /// Currents of the last sample, A.
    current_a: [f64; 3],
    window: Window,
    filtered: LowPassState,
    /// Means of `i_k/gap_k²` and `i_k²/gap_k³` with the memory of a window.
    per_current: [f64; 3],
    gradient: [f64; 3],
}

/// The estimator of [`Method::Paper`] and [`Method::PaperLiteral`]: the kernels and the filter.
#[derive(Clone, Debug, PartialEq)]
pub struct Paper {
    config: EstimatorConfig,
    intervals: usize,
    /// Number of samples at which ε has passed; the first sample is at time zero.
    samples_until_epsilon: u64,
    /// `(sin α_k, cos α_k)`.
    direction: [[f64; 2]; 3],
    sums: WindowSums,
    /// Inverse of each row's gain for position noise.
    row_scale: [f64; ROWS_PER_AXIS],
    /// `T_f² λ_0,k/m`.
    column_scale: [f64; 3],
    /// Size of a column of D without cancellation per A²/m², m.
    level: [f64; 3],
    low_pass: LowPass,
}

impl Paper {
    /// The estimator of a checked configuration.
    pub fn new(config: &EstimatorConfig) -> Self {
        let intervals = (config.window_s / config.step_s).round() as usize;
        let epsilon_steps = config.epsilon_s / config.step_s;
        let sums = WindowSums::new(intervals, config.hold == Hold::Linear);
        let row_scale = sums.rows.each_ref().map(|row| 1.0 / row.noise_gain());
        let window2 = config.window_s * config.window_s;
        let column_scale = config.lambda0_nm2_a2.map(|lambda0| window2 * lambda0 / config.geometry.shaft.m_kg);
        let gain: f64 = sums.rows.iter().zip(&row_scale).map(|(row, scale)| row.l1_gain() * scale).sum();
        Self {
            intervals,
            samples_until_epsilon: ((epsilon_steps * (1.0 - WHOLE_NUMBER_TOLERANCE)).ceil() as u64).saturating_add(1),
            direction: [0, 1, 2].map(|k| sincos(config.geometry.bearings[0].alpha_rad[k]).into()),
            sums,
            row_scale,
            level: column_scale.map(|scale| gain * scale),
            column_scale,
            low_pass: LowPass::new(config.filter_omega_rad_s, config.filter_zeta, config.step_s),
            config: config.clone(),
        }
    }

    /// A new state, with all the memory that stepping needs.
    pub fn start(&self) -> PaperState {
        PaperState {
            samples: 0,
            inverse_square_gap: [[0.0; 3]; 2],
            current_a: [0.0; 3],
            window: self.sums.start(),
            filtered: LowPassState::default(),
            per_current: [0.0; 3],
            gradient: [0.0; 3],
        }
    }

    /// Whether a state has the shape this estimator needs.
    pub fn has_shape(&self, state: &PaperState) -> bool {
        self.sums.accepts(&state.window)
    }

    /// A gap in the data: the window restarts because its integrals need every sample; the filters F keep their state.
    pub fn interrupt(&self, state: &mut PaperState) {
        state.window.clear();
    }

    /// The gaps of the magnets at a position, m.
    pub fn gaps(&self, [y, z]: [f64; 2]) -> [f64; 3] {
        self.direction.map(|[sin, cos]| self.config.geometry.bearings[0].gap_m - sin * y - cos * z)
    }

    /// Processes a sample, which must be finite and within the gap, and returns the verdict on the estimate.
    pub fn sample(&self, state: &mut PaperState, input: &EstimatorInput, output: &mut EstimatorOutput) -> Verdict {
        let sample = self.signals(state, input);
        state.samples = state.samples.saturating_add(1);
        let integrals = self.sums.push(&mut state.window, &sample);
        let Some((rows, static_load)) = integrals.filter(|_| state.samples >= self.samples_until_epsilon) else {
            return Verdict::Collecting;
        };
        let channels = self.channels(output, &rows, &sample.squares[0]);
        if !channels.are_sound() {
            self.interrupt(state);
            return Verdict::BadSample;
        }
        self.low_pass.step(&mut state.filtered, &channels);
        let lambda = self.lambda(channels.ratio());
        if lambda.iter().all(|l| l.is_finite()) {
            output.lambda_raw = lambda;
        }
        let verdict = self.estimate(state, &static_load, output);
        output.lambda_std_total = output.lambda_std;
        for k in 0..3 {
            output.ki[k] = 2.0 * output.lambda_hat[k] * state.per_current[k];
            output.ks[k] = 2.0 * output.lambda_hat[k] * state.gradient[k];
        }
        verdict
    }

    /// The signals of one sample for the window.
    fn signals(&self, state: &mut PaperState, input: &EstimatorInput) -> Sample {
        let gap_m = self.gaps(input.position_m);
        let w = gap_m.map(|gap| 1.0 / (gap * gap));
        let [w_last, w_before] = state.inverse_square_gap;
        let mut sample = Sample { position: input.position_m, ..Sample::default() };
        let weight = 1.0 / (state.samples as f64 + 1.0).min(self.intervals as f64);
        for k in 0..3 {
            let i = match self.config.hold {
                Hold::HeldBefore | Hold::Linear => input.current_a[k],
                Hold::HeldAfter => state.current_a[k],
            };
            // The mean of (i + n)² is i² + σ_i².
            let square = i * i - self.config.current_noise_a * self.config.current_noise_a;
            let [start, end] = &mut sample.squares;
            if self.config.hold == Hold::Linear {
                start[k] = square * w[k];
                end[k] = start[k];
            } else if state.window.filled() > 0 {
                // Within the interval 1/gap² is a parabola; the chord, lowered by one twelfth of the second difference, has the same area.
                let bulge = if state.window.filled() > 1 { (w[k] - 2.0 * w_last[k] + w_before[k]) / 12.0 } else { 0.0 };
                start[k] = square * (w_last[k] - bulge);
                end[k] = square * (w[k] - bulge);
            }
            state.per_current[k] += weight * (i * w[k] - state.per_current[k]);
            state.gradient[k] += weight * (i * i * w[k] / gap_m[k] - state.gradient[k]);
        }
        state.inverse_square_gap = [w, w_last];
        state.current_a = input.current_a;
        sample
    }

    /// The rows of D for the two axes, in m per scaled unknown.
    fn row_pair(&self, integrals: &Integrals) -> [[f64; 3]; 2] {
        array::from_fn(|axis| array::from_fn(|k| self.column_scale[k] * self.direction[k][axis] * integrals.squares[k]))
    }

    /// λ from the scaled unknowns.
    fn lambda(&self, scaled: [f64; 3]) -> [f64; 3] {
        array::from_fn(|k| self.config.lambda0_nm2_a2[k] * scaled[k])
    }

    /// The residual constant force in the present window: `m (∫ ψ'' Z/T_f² − Σ λ̂ ∫ ψ u)/∫ ψ` per axis.
    fn static_load(&self, integrals: &Integrals, unknowns: &Vector3<f64>) -> [f64; 2] {
        let rows = self.row_pair(integrals);
        array::from_fn(|axis| {
            let modelled: f64 = rows[axis].iter().zip(unknowns.iter()).map(|(d, x)| d * x).sum();
            self.config.geometry.shaft.m_kg * (integrals.position[axis] - modelled)
                / (self.config.window_s * self.config.window_s)
        })
    }

    /// The quantities to be filtered, from the present window.
    fn channels(
        &self,
        output: &mut EstimatorOutput,
        integrals: &[Integrals; ROWS_PER_AXIS],
        squares: &[f64; 3],
    ) -> Channels {
        let mut d = SMatrix::<f64, 6, 3>::zeros();
        let mut n = SVector::<f64, 6>::zeros();
        for (row, (integrals, scale)) in integrals.iter().zip(self.row_scale).enumerate() {
            for (axis, values) in self.row_pair(integrals).iter().enumerate() {
                let at = axis * ROWS_PER_AXIS + row;
                n[at] = scale * integrals.position[axis];
                for (k, value) in values.iter().enumerate() {
                    d[(at, k)] = scale * value;
                }
            }
        }

        let dz = d.fixed_view::<3, 3>(ROWS_PER_AXIS, 0).into_owned();
        let nz = n.fixed_rows::<3>(ROWS_PER_AXIS).into_owned();
        let determinant = dz.determinant();
        let sign = if self.config.method == Method::Paper && determinant < 0.0 { -1.0 } else { 1.0 };
        if determinant.is_finite() {
            output.determinant = determinant;
        }
        // The paper solves the rows of the z axis; those of both axes test the result.
        let p = d.tr_mul(&d);
        let pairs = || n.iter().zip(&nz);
        Channels {
            normal: array::from_fn(|n| p[n]),
            right: d.tr_mul(&n).into(),
            square: n.norm_squared(),
            numerators: array::from_fn(|k| {
                let mut with_n = dz;
                with_n.set_column(k, &nz);
                sign * with_n.determinant()
            }),
            determinant: sign * determinant,
            level: array::from_fn(|k| squares[k] * self.level[k]).map(|level| level * level),
            shape: [pairs().map(|(y, z)| y * y - z * z).sum(), pairs().map(|(y, z)| 2.0 * y * z).sum()],
        }
    }

    /// The paper's estimate from the filtered quantities.
    fn estimate(&self, state: &PaperState, static_load: &Integrals, output: &mut EstimatorOutput) -> Verdict {
        let filtered = &state.filtered.value;
        let p = filtered.normal();
        let inverse = p.try_inverse();
        let condition = inverse.map_or(f64::INFINITY, |inverse| (norm(&p) * norm(&inverse)).sqrt());
        output.condition = condition.min(CONDITION_CAP);
        let excited = (0..3).all(|k| p[(k, k)] > EXCITATION_FLOOR * EXCITATION_FLOOR * filtered.level[k]);
        let literal = self.config.method == Method::PaperLiteral;
        let scaled = filtered.ratio();
        let lambda = self.lambda(scaled);
        if !scaled.iter().chain(&lambda).all(|x| x.is_finite()) {
            return Verdict::Singular;
        }
        let unknowns = Vector3::from(scaled);
        output.residual = filtered.residual(&unknowns);
        // The residual may be one coherent error: no averaging over windows.
        let residual_square = output.residual * output.residual * filtered.square;
        for k in 0..3 {
            let spread = inverse.map_or(f64::INFINITY, |inverse| (inverse[(k, k)].max(0.0) * residual_square).sqrt());
            let std = (spread * spread + (MODEL_STD * scaled[k]) * (MODEL_STD * scaled[k])).sqrt();
            // Finite in any case.
            output.lambda_std[k] = self.config.lambda0_nm2_a2[k] * std.min(1.0e3);
        }
        if literal {
            output.lambda_hat = lambda;
        }
        let [difference, product] = filtered.shape;
        let is_circular = (difference * difference + product * product).sqrt() < CIRCULAR_LIMIT * filtered.square;
        if !excited || output.condition > CONDITION_LIMIT || is_circular {
            return Verdict::Singular;
        }
        if !lambda.iter().all(|l| *l > 0.0) {
            return Verdict::NotPositive;
        }
        if !literal && output.residual > RESIDUAL_LIMIT {
            return Verdict::Unexplained;
        }
        let few = state.samples <= MIN_WINDOWS * self.intervals as u64;
        if few || (0..3).any(|k| output.lambda_std[k] > STD_LIMIT * lambda[k]) {
            return Verdict::Uncertain;
        }
        output.lambda_hat = lambda;
        let load = self.static_load(static_load, &unknowns);
        if load.iter().all(|p| p.is_finite()) {
            output.load_n = load;
        }
        Verdict::Valid
    }
}
