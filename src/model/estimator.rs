//! On-line identification of the magnet constants λ, P(10)–(20), and what method section 6 adds to it.
//!
//! One row of `D Λ = N`, P(18), is the weak form of the motion along one axis over the window of length `T_f` that
//! ends now, with a test function that ignores initial conditions and constant forces (see [`super::kernel`]):
//!
//! ```text
//! ∫ g_z,i Y dτ = T_f² Σ_k λ_k ∫ g_u,i u_y,k dτ        u_y,k = sin α_k i_k²/(m gap_k²)
//! ∫ g_z,i Z dτ = T_f² Σ_k λ_k ∫ g_u,i u_z,k dτ        u_z,k = cos α_k i_k²/(m gap_k²)
//! ```
//!
//! Every row is divided by its gain for white position noise, so that a row carries metres and every row the same
//! noise; the column of `λ_k` is multiplied by `λ_0,k`, so that the unknowns are `λ_k/λ_0,k`.

use std::fmt;

use libm::{atan2, cos, sin};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use super::kernel::{ROWS_PER_AXIS, Weights};
use super::lowpass::{LowPass, LowPassState};
use super::regression::{CONDITION_CAP, MAX_UNKNOWNS, NormalMatrix, NormalVector, SymmetricEigen};
use super::window::{Window, dot};
use super::{Checks, Invalid};

/// The shortest window, in sample times: the test functions need room for their three changes of sign.
pub const MIN_INTERVALS: f64 = 8.0;

/// The longest window, in sample times: a step costs time and memory in proportion, and rounding of the kernels
/// grows with the cube.
pub const MAX_INTERVALS: f64 = 1.0e5;

/// The largest condition number with which an estimate counts as valid.
///
/// On the paper's orbit both axes have about 3, the z axis alone 17 to 32, both axes with the unbalance 40 to 80; on
/// a circular orbit, where the unbalance is not identifiable, imperfect tracking leaves 1300 to 2000. With sensor noise of
/// 0.1 µm and 10 mA the error of λ̂ is about 0.5 % at 45, 1.4 % at 120 and 4 % at 280.
pub const CONDITION_LIMIT: f64 = 200.0;

/// The largest residual with which an estimate counts as valid: beyond it the model explains less than three
/// quarters (in the mean square) of the motion that it is asked to explain.
pub const RESIDUAL_LIMIT: f64 = 0.5;

/// The least variation of the magnets' `i²/gap²`, relative to its level, that counts as excitation; rounding makes
/// about 1e-15.
pub const EXCITATION_FLOOR: f64 = 1.0e-9;

/// The least |sin| of the angle between two magnets.
pub const LEAST_SINE_BETWEEN_MAGNETS: f64 = 1.0e-3;

/// Upper end of [`EstimatorOutput::residual`].
pub const RESIDUAL_CAP: f64 = 1.0e6;

/// How far `T_f/T_s` may be from a whole number, relative.
const WHOLE_NUMBER_TOLERANCE: f64 = 1.0e-6;

/// Filtered quantities beyond this come from samples that no bearing makes, and their products could overflow.
const CHANNEL_LIMIT: f64 = 1.0e150;

const MAGNETS: usize = 3;
const ROWS: usize = 2 * ROWS_PER_AXIS;

/// How λ is computed from the windows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// P(20) to the letter, `F(n_i)/F(d)` with signed Cramer numerators and determinant of the z axis.
    ///
    /// `d` changes sign twice per revolution and nearly cancels in the mean, so this diverges; it is here to be
    /// compared with. Its values are shown as they are, and no residual makes them invalid.
    PaperLiteral,
    /// P(20) with the signs aligned first, `F(n_i sign d)/F(|d|)`: what reproduces the paper.
    Paper,
    /// Both axes, filtered normal equations: `F(DᵀD) λ̂ = F(DᵀN)`.
    #[default]
    LeastSquares,
    /// As `LeastSquares`, with the unbalance identified as well: two more unknowns `U cos φ`, `U sin φ`.
    Unbalance,
}

/// What a current sample stands for; the choice decides several per cent in λ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Hold {
    /// Sample j was held over `[t_{j−1}, t_j)`: the current measured just before it jumps.
    #[default]
    HeldBefore,
    /// Sample j is held over `[t_j, t_{j+1})`: the command issued at the sample.
    HeldAfter,
    /// Sample j is a point of a continuous current.
    Linear,
}

/// Parameters of the estimator, before they are checked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimatorConfig {
    /// Mass m of the rotor, kg.
    pub m_kg: f64,
    /// Nominal air gap s, m.
    pub gap_m: f64,
    /// Angles α_k of the magnets, rad; magnet k pulls along `(sin α_k, cos α_k)` in (y, z).
    pub alpha_rad: [f64; 3],
    /// Sample time T_s, s.
    pub step_s: f64,
    /// Window length T_f, s; a whole number of sample times.
    pub window_s: f64,
    /// ε of P: the estimate is λ_0 until samples of this length of time have come in, s; at least T_f.
    pub epsilon_s: f64,
    /// First guess λ_0, N·m²/A².
    pub lambda0_nm2_a2: [f64; 3],
    /// How λ is computed.
    pub method: Method,
    /// What a current sample stands for.
    pub hold: Hold,
    /// ω_n of F(s) in P(20), rad/s.
    pub filter_omega_rad_s: f64,
    /// ζ of F(s) in P(20).
    pub filter_zeta: f64,
}

impl Default for EstimatorConfig {
    fn default() -> Self {
        use std::f64::consts::{FRAC_PI_3, PI};
        Self {
            m_kg: 6.7,
            gap_m: 5.0e-4,
            alpha_rad: [PI, -FRAC_PI_3, FRAC_PI_3],
            step_s: 1.0e-4,
            window_s: 0.02,
            epsilon_s: 0.02,
            lambda0_nm2_a2: [4.0e-6; 3],
            method: Method::default(),
            hold: Hold::default(),
            filter_omega_rad_s: 15.0,
            filter_zeta: 0.707,
        }
    }
}

/// One sample of the measurements, all of the same instant.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EstimatorInput {
    /// Position (Y, Z) of the rotor, m.
    pub position_m: [f64; 2],
    /// Currents of the magnets, A; [`Hold`] says what they stand for.
    pub current_a: [f64; 3],
    /// Angle θ of the rotor, rad, wrapped or not; used by [`Method::Unbalance`] alone.
    pub theta_rad: f64,
    /// Speed of the rotor, rad/s; used by [`Method::Unbalance`] alone.
    pub omega_rad_s: f64,
    /// While false, samples are ignored.
    pub enable: bool,
    /// A rising edge starts afresh, with this sample as the first.
    pub reset: bool,
}

/// Why an estimate is valid or not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Reason {
    /// The estimate is good.
    Valid,
    /// The window is not full yet, or ε has not passed.
    #[default]
    Filling,
    /// `enable` is false.
    Disabled,
    /// The sample is not finite, or the rotor is outside the gap of a magnet: the window starts afresh.
    BadSample,
    /// The excitation does not tell the unknowns apart: see [`CONDITION_LIMIT`] and [`EXCITATION_FLOOR`].
    Singular,
    /// A magnet constant came out zero or negative, which a magnet cannot have.
    NotPositive,
    /// The model does not explain the motion: see [`RESIDUAL_LIMIT`].
    Unexplained,
    /// The state was made by an estimator with another window or method; it is left untouched.
    ForeignState,
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Reason::Valid => "valid",
            Reason::Filling => "not valid: the window is not full yet, or epsilon has not passed",
            Reason::Disabled => "not valid: enable is false",
            Reason::BadSample => "not valid: a sample is not finite, or outside the gap; the window starts afresh",
            Reason::Singular => "not valid: the excitation does not tell the unknowns apart",
            Reason::NotPositive => "not valid: a force constant came out zero or negative",
            Reason::Unexplained => "not valid: the model does not explain the motion",
            Reason::ForeignState => "not valid: the state was made by another estimator",
        })
    }
}

/// The estimates after a sample. All numbers are finite at all times.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EstimatorOutput {
    /// λ̂, N·m²/A²: λ_0 at first, then the last valid estimate ([`Method::PaperLiteral`]: the last finite one).
    pub lambda_hat: [f64; 3],
    /// `D⁻¹N` of the present window alone, P(19), N·m²/A²; in the sense of least squares for the methods with more
    /// rows than unknowns. The last value where the window is singular, λ_0 at first.
    pub lambda_raw: [f64; 3],
    /// Whether `lambda_hat` was identified with this sample; `reason == Reason::Valid`. False while disabled: the
    /// estimate held then is as old as the last sample.
    pub valid: bool,
    /// Why.
    pub reason: Reason,
    /// Condition number of the filtered, scaled D of the rows that the method uses (the square root of that of
    /// `F(DᵀD)`), dimensionless; [`CONDITION_CAP`] if singular, and before the first full window.
    pub condition: f64,
    /// `√(F(|N − D Λ̂|²)/F(|N|²))`, dimensionless: the part of the motion that the model leaves unexplained. 1 before
    /// the first full window and without motion, at most [`RESIDUAL_CAP`]. Rounding leaves about 1e-7.
    pub residual: f64,
    /// det D of the z axis of the present window, rows and columns scaled as the module says, m³; 0 at first.
    pub determinant: f64,
    /// Static load (p_y, p_z) over the present window, N (method section 6), weighted with `τ³(1 − τ)³`; 0 at first,
    /// then the value with the last valid estimate.
    pub load_n: [f64; 2],
    /// Magnitude U of the unbalance, kg·m; 0 unless [`Method::Unbalance`] has identified it.
    pub unbalance_kg_m: f64,
    /// Phase φ of the unbalance, rad in (−π, π]: the force on the rotor is `U ω² (cos(θ + φ), sin(θ + φ))`.
    pub unbalance_phase_rad: f64,
}

/// The low-passed quantities: normal equations and the ratio of P(20).
type Channels = SVector<f64, CHANNELS>;

/// Upper triangle of DᵀD.
const NORMAL: usize = MAX_UNKNOWNS * (MAX_UNKNOWNS + 1) / 2;
/// DᵀN follows.
const RIGHT: usize = NORMAL;
/// |N|² follows.
const SQUARE: usize = RIGHT + MAX_UNKNOWNS;
/// n_1, n_2, n_3, d of P(20) follow, signs aligned or not as the method says.
const RATIO: usize = SQUARE + 1;
/// The squares of what each column of D would be if nothing cancelled follow.
const LEVEL: usize = RATIO + MAGNETS + 1;
const CHANNELS: usize = LEVEL + MAGNETS;

/// Signals in the window: Y, Z, then `i²/gap²` of each magnet (its values at the start of the hold intervals and at
/// their ends, or at the nodes if the current is continuous), then `ω² cos θ`, `ω² sin θ` if they are needed.
const MAX_SIGNALS: usize = 2 + 2 * MAGNETS + 2;
const SQUARES: usize = 2;

/// All that changes with a sample. Made by [`Estimator::start`], and good only for estimators with the same window,
/// method and hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimatorState {
    /// Samples taken in since the start or the last reset.
    samples: u64,
    reset_was_high: bool,
    /// `1/gap_k²` at the last sample and at the one before, 1/m².
    inverse_square_gap: [[f64; 3]; 2],
    /// Currents of the last sample, A.
    current_a: [f64; 3],
    window: Window,
    filtered: LowPassState<CHANNELS>,
    output: EstimatorOutput,
}

impl EstimatorState {
    /// The estimates after the last sample.
    #[must_use]
    pub fn output(&self) -> &EstimatorOutput {
        &self.output
    }
}

/// The integrals of one test function over the present window.
struct Integrals {
    /// `∫ φ'' (Y, Z) dτ`, m.
    position: [f64; 2],
    /// `∫ φ i_k²/gap_k² dτ`, A²/m².
    squares: [f64; 3],
    /// `∫ φ ω² (cos θ, sin θ) dτ`, rad²/s².
    rotating: [f64; 2],
}

/// Solution of normal equations.
struct Solution {
    condition: f64,
    unknowns: Option<NormalVector>,
}

/// The estimator: a checked configuration with its kernels.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimator {
    config: EstimatorConfig,
    intervals: usize,
    /// Number of samples at which ε has passed; the first sample is at time zero.
    samples_until_epsilon: u64,
    /// Number of unknowns: 3, or 5 with the unbalance.
    unknowns: usize,
    signals: usize,
    /// `(sin α_k, cos α_k)`.
    direction: [[f64; 2]; 3],
    rows: [Weights; ROWS_PER_AXIS],
    /// One over the gain of each row for position noise.
    row_scale: [f64; ROWS_PER_AXIS],
    static_load: Weights,
    /// `T_f² λ_0,k/m`, or `T_f² U_0/m` for the unbalance with its unit U_0 = m s.
    column_scale: [f64; MAX_UNKNOWNS],
    /// What one A²/m² would make in a column of D if nothing cancelled, m.
    reach: [f64; MAGNETS],
    low_pass: LowPass,
}

impl Estimator {
    /// Checks the parameters and computes the kernels.
    ///
    /// # Errors
    /// Every parameter that cannot be accepted, under its name in the interface: not finite or not positive; `Tf` less than
    /// 8 or more than 10⁵ sample times or not a whole number of them; `epsilon` shorter than the window; two magnets
    /// on one line.
    pub fn new(config: EstimatorConfig) -> Result<Self, Vec<Invalid>> {
        check(&config)?;
        let intervals = (config.window_s / config.step_s).round() as usize;
        let epsilon_steps = config.epsilon_s / config.step_s;
        let unknowns = if config.method == Method::Unbalance { MAX_UNKNOWNS } else { MAGNETS };
        let squares = if config.hold == Hold::Linear { MAGNETS } else { 2 * MAGNETS };
        let rows: [Weights; ROWS_PER_AXIS] = std::array::from_fn(|row| Weights::paper(row, intervals));
        let row_scale = std::array::from_fn(|row| 1.0 / rows[row].noise_gain());
        let window2 = config.window_s * config.window_s;
        let column_scale = std::array::from_fn(|k| match config.lambda0_nm2_a2.get(k) {
            Some(lambda0) => window2 * lambda0 / config.m_kg,
            None => window2 * config.gap_m,
        });
        let reach = rows.iter().zip(&row_scale).map(|(w, scale): (&Weights, &f64)| w.reach() * scale).sum::<f64>();
        Ok(Self {
            intervals,
            samples_until_epsilon: ((epsilon_steps * (1.0 - WHOLE_NUMBER_TOLERANCE)).ceil() as u64).saturating_add(1),
            unknowns,
            signals: SQUARES + squares + unknowns - MAGNETS,
            direction: config.alpha_rad.map(|alpha| [sin(alpha), cos(alpha)]),
            row_scale,
            static_load: Weights::static_load(intervals),
            reach: std::array::from_fn(|k| reach * column_scale[k]),
            column_scale,
            low_pass: LowPass::new(config.filter_omega_rad_s, config.filter_zeta, config.step_s),
            rows,
            config,
        })
    }

    /// The configuration.
    #[must_use]
    pub fn config(&self) -> &EstimatorConfig {
        &self.config
    }

    /// A fresh state, with all the memory that stepping needs.
    #[must_use]
    pub fn start(&self) -> EstimatorState {
        EstimatorState {
            samples: 0,
            reset_was_high: false,
            inverse_square_gap: [[0.0; 3]; 2],
            current_a: [0.0; 3],
            window: Window::new(self.signals, self.intervals + 1),
            filtered: LowPassState::default(),
            output: self.first_output(),
        }
    }

    /// Whether a state, for instance one read from a file, has the shape this estimator needs.
    #[must_use]
    pub fn accepts(&self, state: &EstimatorState) -> bool {
        state.window.has_shape(self.signals, self.intervals + 1)
    }

    /// Takes in one sample; to be called once every T_s.
    ///
    /// Whatever the input, the result is finite and nothing panics. A gap in the data (a bad sample, or `enable`
    /// false) starts the window afresh, for its integrals need every sample; the filters F and the estimate keep what they
    /// have. A rising edge of `reset` forgets everything, λ̂ included.
    pub fn sample(&self, state: &mut EstimatorState, input: &EstimatorInput) -> EstimatorOutput {
        if self.accepts(state) {
            if input.reset && !state.reset_was_high {
                state.samples = 0;
                state.window.clear();
                state.filtered = LowPassState::default();
                state.output = self.first_output();
            }
            state.reset_was_high = input.reset;
            state.output.reason = self.advance(state, input);
        } else {
            state.output.reason = Reason::ForeignState;
        }
        state.output.valid = state.output.reason == Reason::Valid;
        state.output.clone()
    }

    fn first_output(&self) -> EstimatorOutput {
        EstimatorOutput {
            lambda_hat: self.config.lambda0_nm2_a2,
            lambda_raw: self.config.lambda0_nm2_a2,
            valid: false,
            reason: Reason::Filling,
            condition: CONDITION_CAP,
            residual: 1.0,
            determinant: 0.0,
            load_n: [0.0; 2],
            unbalance_kg_m: 0.0,
            unbalance_phase_rad: 0.0,
        }
    }

    fn advance(&self, state: &mut EstimatorState, input: &EstimatorInput) -> Reason {
        if !input.enable {
            state.window.clear();
            return Reason::Disabled;
        }
        let Some(signals) = self.signals(state, input) else {
            state.window.clear();
            return Reason::BadSample;
        };
        state.window.push(&signals[..self.signals.min(MAX_SIGNALS)]);
        state.samples = state.samples.saturating_add(1);
        if !state.window.is_full() || state.samples < self.samples_until_epsilon {
            return Reason::Filling;
        }
        let channels = self.channels(state);
        // Written so that a NaN fails as well.
        if !channels.iter().all(|x| x.abs() < CHANNEL_LIMIT) {
            state.window.clear();
            return Reason::BadSample;
        }
        self.low_pass.step(&mut state.filtered, &channels);
        self.window_alone(&mut state.output, &channels);
        self.estimate(state)
    }

    /// The signals of one sample in the order of the window, and the memory of the last samples brought up to date.
    /// `None` if the sample is of no use.
    fn signals(&self, state: &mut EstimatorState, input: &EstimatorInput) -> Option<[f64; MAX_SIGNALS]> {
        let [y, z] = input.position_m;
        let mut w = [0.0; MAGNETS];
        for (w, [sin, cos]) in w.iter_mut().zip(self.direction) {
            let gap = self.config.gap_m - sin * y - cos * z;
            if gap.is_nan() || gap <= 0.0 {
                return None;
            }
            *w = 1.0 / (gap * gap);
        }
        let mut signals = [0.0; MAX_SIGNALS];
        signals[0] = y;
        signals[1] = z;
        let [w_last, w_before] = state.inverse_square_gap;
        for k in 0..MAGNETS {
            let i = match self.config.hold {
                Hold::HeldBefore | Hold::Linear => input.current_a[k],
                Hold::HeldAfter => state.current_a[k],
            };
            if self.config.hold == Hold::Linear {
                signals[SQUARES + k] = i * i * w[k];
            } else if state.window.filled() > 0 {
                // Within the interval 1/gap² is a parabola; one twelfth of its second difference, taken off both
                // ends of the chord, gives the chord the area of the parabola.
                let bulge = if state.window.filled() > 1 { (w[k] - 2.0 * w_last[k] + w_before[k]) / 12.0 } else { 0.0 };
                signals[SQUARES + k] = i * i * (w_last[k] - bulge);
                signals[SQUARES + MAGNETS + k] = i * i * (w[k] - bulge);
            }
        }
        if self.config.method == Method::Unbalance {
            let omega2 = input.omega_rad_s * input.omega_rad_s;
            signals[self.signals - 2] = omega2 * cos(input.theta_rad);
            signals[self.signals - 1] = omega2 * sin(input.theta_rad);
        }
        let fine = signals.iter().chain(&w).chain(&input.current_a).all(|x| x.is_finite());
        if fine {
            state.inverse_square_gap = [w, w_last];
            state.current_a = input.current_a;
        }
        fine.then_some(signals)
    }

    /// The integrals of one test function over the present window.
    fn integrals(&self, window: &Window, weights: &Weights) -> Integrals {
        let node = |signal| dot(&weights.node, window.signal(signal));
        Integrals {
            position: std::array::from_fn(|axis| dot(&weights.position, window.signal(axis))),
            squares: std::array::from_fn(|k| match self.config.hold {
                Hold::Linear => node(SQUARES + k),
                Hold::HeldBefore | Hold::HeldAfter => {
                    dot(&weights.held_start, window.signal(SQUARES + k))
                        + dot(&weights.held_end, window.signal(SQUARES + MAGNETS + k))
                }
            }),
            rotating: match self.config.method {
                Method::Unbalance => [node(self.signals - 2), node(self.signals - 1)],
                _ => [0.0; 2],
            },
        }
    }

    /// The rows of D for the two axes, in m per scaled unknown; row and column order y, z and λ_1, λ_2, λ_3,
    /// U cos φ, U sin φ.
    fn row_pair(&self, integrals: &Integrals) -> [[f64; MAX_UNKNOWNS]; 2] {
        let mut rows = [[0.0; MAX_UNKNOWNS]; 2];
        for (axis, row) in rows.iter_mut().enumerate() {
            for (k, square) in integrals.squares.iter().enumerate() {
                row[k] = self.column_scale[k] * self.direction[k][axis] * square;
            }
        }
        let [c, s] = integrals.rotating;
        let scale = self.column_scale[MAGNETS];
        // U ω² cos(θ + φ) = U cos φ · ω² cos θ − U sin φ · ω² sin θ, and the sine likewise.
        rows[0][MAGNETS] = scale * c;
        rows[0][MAGNETS + 1] = -scale * s;
        rows[1][MAGNETS] = scale * s;
        rows[1][MAGNETS + 1] = scale * c;
        rows
    }

    /// What the present window contributes to the filtered quantities.
    fn channels(&self, state: &mut EstimatorState) -> Channels {
        let mut d = SMatrix::<f64, ROWS, MAX_UNKNOWNS>::zeros();
        let mut n = SVector::<f64, ROWS>::zeros();
        for (row, (weights, scale)) in self.rows.iter().zip(self.row_scale).enumerate() {
            let integrals = self.integrals(&state.window, weights);
            for (axis, values) in self.row_pair(&integrals).iter().enumerate() {
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
        let mut channels = Channels::zeros();
        for k in 0..MAGNETS {
            let mut with_n = dz;
            with_n.set_column(k, &nz);
            channels[RATIO + k] = sign * with_n.determinant();
        }
        channels[RATIO + MAGNETS] = sign * determinant;
        if determinant.is_finite() {
            state.output.determinant = determinant;
        }

        if matches!(self.config.method, Method::Paper | Method::PaperLiteral) {
            // The paper uses the z axis alone; condition and residual are to speak of the same rows.
            d.fixed_rows_mut::<3>(0).fill(0.0);
            n.fixed_rows_mut::<3>(0).fill(0.0);
        }
        let p: NormalMatrix = d.tr_mul(&d);
        let h: NormalVector = d.tr_mul(&n);
        for (channel, (row, column)) in upper_triangle().enumerate() {
            channels[channel] = p[(row, column)];
        }
        channels.fixed_rows_mut::<MAX_UNKNOWNS>(RIGHT).copy_from(&h);
        channels[SQUARE] = n.norm_squared();
        for k in 0..MAGNETS {
            let newest = state.window.signal(SQUARES + k).last().copied().unwrap_or(0.0);
            channels[LEVEL + k] = (newest * self.reach[k]) * (newest * self.reach[k]);
        }
        channels
    }

    /// P(19): the estimate from the present window, which the output keeps if there is one.
    fn window_alone(&self, output: &mut EstimatorOutput, channels: &Channels) {
        let scaled: Option<[f64; 3]> = match self.config.method {
            Method::Paper | Method::PaperLiteral => Some(ratio(channels)),
            Method::LeastSquares | Method::Unbalance => self.solve(channels).unknowns.map(|x| [x[0], x[1], x[2]]),
        };
        if let Some(lambda) = scaled.map(|x| self.lambda(x)).filter(|lambda| lambda.iter().all(|l| l.is_finite())) {
            output.lambda_raw = lambda;
        }
    }

    /// The estimate from the filtered quantities.
    fn estimate(&self, state: &mut EstimatorState) -> Reason {
        let filtered = &state.filtered.value;
        let output = &mut state.output;
        let solution = self.solve(filtered);
        output.condition = solution.condition;
        let excited =
            (0..MAGNETS).all(|k| normal(filtered)[(k, k)] > EXCITATION_FLOOR * EXCITATION_FLOOR * filtered[LEVEL + k]);
        let literal = self.config.method == Method::PaperLiteral;
        let unknowns = match self.config.method {
            Method::Paper | Method::PaperLiteral => {
                let mut x = NormalVector::zeros();
                x.fixed_rows_mut::<MAGNETS>(0).copy_from_slice(&ratio(filtered));
                Some(x)
            }
            Method::LeastSquares | Method::Unbalance => solution.unknowns,
        };
        let Some((unknowns, lambda)) = unknowns
            .map(|x| (x, self.lambda([x[0], x[1], x[2]])))
            .filter(|(x, lambda)| x.iter().chain(lambda).all(|x| x.is_finite()))
        else {
            return Reason::Singular;
        };
        output.residual = residual(filtered, &unknowns);
        if literal {
            output.lambda_hat = lambda;
        }
        if !excited || output.condition > CONDITION_LIMIT {
            return Reason::Singular;
        }
        if !lambda.iter().all(|l| *l > 0.0) {
            return Reason::NotPositive;
        }
        if !literal && output.residual > RESIDUAL_LIMIT {
            return Reason::Unexplained;
        }
        output.lambda_hat = lambda;
        let unit = self.config.m_kg * self.config.gap_m;
        let (along, across) = (unit * unknowns[MAGNETS], unit * unknowns[MAGNETS + 1]);
        let magnitude = (along * along + across * across).sqrt();
        if magnitude.is_finite() {
            output.unbalance_kg_m = magnitude;
            output.unbalance_phase_rad = atan2(across, along);
        }
        let load = self.static_load(&state.window, &unknowns);
        if load.iter().all(|p| p.is_finite()) {
            output.load_n = load;
        }
        Reason::Valid
    }

    /// The constant force that is left over in the present window: `m (∫ ψ'' Z/T_f² − Σ λ̂ ∫ ψ u)/∫ ψ` per axis.
    fn static_load(&self, window: &Window, unknowns: &NormalVector) -> [f64; 2] {
        let integrals = self.integrals(window, &self.static_load);
        let rows = self.row_pair(&integrals);
        std::array::from_fn(|axis| {
            let modelled: f64 = rows[axis].iter().zip(unknowns.iter()).map(|(d, x)| d * x).sum();
            self.config.m_kg * (integrals.position[axis] - modelled) / (self.config.window_s * self.config.window_s)
        })
    }

    /// λ from the scaled unknowns.
    fn lambda(&self, scaled: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|k| self.config.lambda0_nm2_a2[k] * scaled[k])
    }

    /// Solves the normal equations in the channels.
    ///
    /// The columns of the unbalance are brought to the size of those of the magnets first, for their natural size
    /// changes with ω⁴; without rotation they vanish and the system is singular.
    fn solve(&self, channels: &Channels) -> Solution {
        let mut p = normal(channels);
        let mut h: NormalVector = channels.fixed_rows::<MAX_UNKNOWNS>(RIGHT).into_owned();
        let magnets = (p[(0, 0)] + p[(1, 1)] + p[(2, 2)]) / 3.0;
        let mut scale = NormalVector::repeat(1.0);
        if self.unknowns > MAGNETS {
            let unbalance = (p[(3, 3)] + p[(4, 4)]) / 2.0;
            let factor = (magnets / unbalance).sqrt();
            if !(factor.is_finite() && factor > 0.0) {
                return Solution { condition: CONDITION_CAP, unknowns: None };
            }
            scale[3] = factor;
            scale[4] = factor;
        }
        for row in 0..MAX_UNKNOWNS {
            h[row] *= scale[row];
            for column in 0..MAX_UNKNOWNS {
                p[(row, column)] *= scale[row] * scale[column];
            }
        }
        let eigen = SymmetricEigen::new(&p, self.unknowns);
        let unknowns = eigen.solve(&h).map(|x| x.component_mul(&scale));
        Solution { condition: eigen.condition(), unknowns }
    }
}

/// Row and column of the upper triangle, in the order of the channels.
fn upper_triangle() -> impl Iterator<Item = (usize, usize)> {
    (0..MAX_UNKNOWNS).flat_map(|row| (row..MAX_UNKNOWNS).map(move |column| (row, column)))
}

/// DᵀD out of the channels.
fn normal(channels: &Channels) -> NormalMatrix {
    let mut p = NormalMatrix::zeros();
    for (channel, (row, column)) in upper_triangle().enumerate() {
        p[(row, column)] = channels[channel];
        p[(column, row)] = channels[channel];
    }
    p
}

/// `n_i/d`, scaled unknowns; not finite where d is zero.
fn ratio(channels: &Channels) -> [f64; 3] {
    std::array::from_fn(|k| channels[RATIO + k] / channels[RATIO + MAGNETS])
}

/// `√(F(|N − D x|²)/F(|N|²))`, between 0 and [`RESIDUAL_CAP`], 1 without motion.
fn residual(channels: &Channels, x: &NormalVector) -> f64 {
    let h: NormalVector = channels.fixed_rows::<MAX_UNKNOWNS>(RIGHT).into_owned();
    let square = channels[SQUARE];
    let rest = square - 2.0 * x.dot(&h) + x.dot(&(normal(channels) * x));
    let residual = (rest.max(0.0) / square).sqrt();
    if square.is_nan() || square <= 0.0 {
        1.0
    } else if residual.is_finite() {
        residual.min(RESIDUAL_CAP)
    } else {
        RESIDUAL_CAP
    }
}

fn check(config: &EstimatorConfig) -> Result<(), Vec<Invalid>> {
    let mut checks = Checks::default();
    checks.positive("m", config.m_kg, "kg");
    checks.positive("s", config.gap_m, "m");
    for (k, alpha) in config.alpha_rad.iter().enumerate() {
        checks.finite(format!("alpha[{}]", k + 1), *alpha, "rad");
    }
    for (k, l) in [(0, 1), (0, 2), (1, 2)] {
        let between = config.alpha_rad[l] - config.alpha_rad[k];
        checks.require(
            !between.is_finite() || sin(between).abs() >= LEAST_SINE_BETWEEN_MAGNETS,
            format!("alpha[{}]", l + 1),
            format_args!("{} rad", config.alpha_rad[l]),
            format!("an angle off the line of magnet {}, whose force could not be told apart,", k + 1),
        );
    }
    checks.positive("Ts", config.step_s, "s");
    checks.positive("Tf", config.window_s, "s");
    let positive = |x: f64| x.is_finite() && x > 0.0;
    let intervals = config.window_s / config.step_s;
    if positive(config.step_s) && positive(config.window_s) {
        let value = format!("{} s", config.window_s);
        checks.require(intervals >= MIN_INTERVALS * (1.0 - WHOLE_NUMBER_TOLERANCE), "Tf", &value, "at least 8 Ts");
        checks.require(intervals <= MAX_INTERVALS * (1.0 + WHOLE_NUMBER_TOLERANCE), "Tf", &value, "at most 100000 Ts");
        checks.require(
            (intervals - intervals.round()).abs() <= WHOLE_NUMBER_TOLERANCE * intervals,
            "Tf",
            &value,
            "a whole number of Ts",
        );
    }
    checks.positive("epsilon", config.epsilon_s, "s");
    if positive(config.epsilon_s) && positive(config.window_s) {
        checks.require(
            config.epsilon_s >= config.window_s * (1.0 - WHOLE_NUMBER_TOLERANCE),
            "epsilon",
            format_args!("{} s", config.epsilon_s),
            "at least Tf, for there is no estimate before the first window is full,",
        );
    }
    for (k, lambda0) in config.lambda0_nm2_a2.iter().enumerate() {
        checks.positive(format!("lambda0[{}]", k + 1), *lambda0, "N.m2/A2");
    }
    checks.positive("filter.omega", config.filter_omega_rad_s, "rad/s");
    checks.positive("filter.zeta", config.filter_zeta, "1");
    checks.finish()
}
