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
//! With the paper's methods every row is divided by its gain for white position noise, so that a row carries metres and
//! every row the same noise; the column of `λ_k` is multiplied by `λ_0,k`, so that the unknowns are `λ_k/λ_0,k`.
//!
//! # Least squares
//!
//! The methods `LeastSquares` and `Unbalance` take the test functions of [`super::memory::Bank`] instead of the paper's three:
//! the lowest sines of the window without their mean, combined so that noise is white in them. A window is evaluated 25 times
//! while it moves by its own length, and what it says is remembered with the weight `e^{−γ age}`, `γ = ω_n/(2 ζ)`. In the long
//! run that has the mean age and the noise bandwidth of F(s), but no dead time at the start: F gives the newest data the
//! weight zero, and at 35 ms nearly all data are new.
//!
//! **Noise** of every single sample is followed into the estimate ([`super::memory`]): its bias is taken off, its variance makes
//! `lambda_std`. A σ that is not given is found: σ_z from fourth differences of the positions (no motion of a rotor has them),
//! σ_i from the residual.
//!
//! **Errors of the model** are told from noise by their memory: the residual of a window is compared with that of a window
//! whole revolutions before ([`Estimator`] listens for echoes). The coherent part ρ of the residual adds `P⁻¹ ρ` to the
//! covariance, without averaging. Before enough windows have passed to tell, all that given noise does not explain is taken
//! to be coherent.
//!
//! **Change**: a window whose residual with what was learnt before is more than [`CHANGE_LIMIT`] times what noise explains ends the
//! memory. Nothing is learnt until the windows are clear of the change. As long as there is none, the variance is that of
//! the whole memory; a faster forgetting would pay for the readiness all the time. With 22 rows per window a false alarm is
//! expected with a probability below 1e-9 per window for white rows.
//!
//! The unbalance force is `U ω² (cos(θ + φ), sin(θ + φ))`; the tangential part `U ω̇`, at 500 rpm per second 5e-4 of it,
//! is left out.

mod config;

use std::f64::consts::TAU;

use libm::{atan2, cos, exp, sin};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

pub use self::config::{
    CHANGE_LIMIT, CONDITION_LIMIT, EXCITATION_FLOOR, EstimatorConfig, EstimatorInput, EstimatorOutput, Hold,
    LEAST_SINE_BETWEEN_MAGNETS, MAX_INTERVALS, MIN_INTERVALS, MODEL_STD, Method, PAPER_STD_LIMIT, PAPER_WINDOWS,
    RESIDUAL_CAP, RESIDUAL_LIMIT, ROUND_LIMIT, Reason, STD_CAP, STD_LIMIT, STUCK_SAMPLES,
};
use self::config::{CHANNEL_LIMIT, WHOLE_NUMBER_TOLERANCE, check};
use super::Invalid;
use super::kernel::{ROWS_PER_AXIS, Weights};
use super::lowpass::{LowPass, LowPassState};
use super::memory::{Bank, MAX_FUNCTIONS, Memory, Regressors, Sensitivity, Sums, Targets};
use super::regression::{CONDITION_CAP, MAX_UNKNOWNS, NormalMatrix, NormalVector, SymmetricEigen};
use super::window::{Integrals, KERNELS, Sample, Window, WindowSums, WindowSumsState, dot};

const MAGNETS: usize = 3;
const ROWS: usize = 2 * ROWS_PER_AXIS;

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
/// `|N_y|² − |N_z|²` and `2 N_y·N_z` follow.
const SHAPE: usize = LEVEL + MAGNETS;
const CHANNELS: usize = SHAPE + 2;

/// Signals in the window: Y, Z, then `i²/gap²` of each magnet (its values at the start of the hold intervals and at
/// their ends, or at the nodes if the current is continuous), then `ω² cos θ`, `ω² sin θ` if they are needed, then for
/// least squares `2 i/gap²` and `2 i²/gap³` of each magnet, what noise of currents and positions is multiplied by.
const MAX_SIGNALS: usize = 2 + 2 * MAGNETS + 2 + 2 * MAGNETS;
const SQUARES: usize = 2;

/// A window is evaluated anew by least squares after this part of its length: half the distance between the zeros of the
/// fastest test function, so that nothing is missed in between.
const HOPS_PER_WINDOW: usize = 25;

/// Sums of squares of regressors beyond this come from samples that no bearing makes.
const SUM_LIMIT: f64 = 1.0e60;

/// Noise that the test functions are made for where none is stated, m and A. Another noise is counted as it is; only
/// the weights are then not the best ones.
const NOMINAL_NOISE: [f64; 2] = [1.0e-7, 1.0e-2];

/// Acceleration by the magnets that the test functions are made for, m/s²: the weight of the rotor.
const NOMINAL_ACCELERATION: f64 = 9.81;

/// What the discretisation may leave of a motion without noise, relative.
const MODEL_RESIDUAL: f64 = 2.0e-3;

/// Two steps of a current whose difference squared is more than this part of their squares make a kink; at 3000 rpm those of
/// the path differ by 5e-4.
const KINK: f64 = 0.03;

/// A current is straight between samples, and not smooth, if so many of its last steps make kinks, and what is left of that
/// count after a step. At its extremes a smooth current has about eleven such steps in a row.
const KINKED: f64 = 0.4;
const KINK_KEEP: f64 = 0.97;

/// What is left of a motion without noise, relative, if a voltage drives the currents: they are not quite straight between
/// samples.
const LINEAR_RESIDUAL: f64 = 1.0e-4;

/// Noise found from the residual is reckoned with so many of its own standard deviations higher.
const NOISE_MARGIN: f64 = 0.5;

/// How many of its own standard deviations a correlation of residuals one or more revolutions apart must have to count as
/// an error of the model.
const COHERENCE_LIMIT: f64 = 3.0;

/// Pairs of windows, counted without overlap, that it takes to tell a coherent residual from noise. Before, all of it counts
/// as coherent if the noise is not given, and what the noise does not explain if it is.
const PAIRS_TO_JUDGE: f64 = 1.5;

/// How many times more of the noise of the positions a controller follows than a low-pass of second order with poles at
/// [`FOLLOWING`] does, and the standard deviation of that. The estimator does not know the controller; in sixteen studies (current
/// and voltage, poles from 500 to 6000 rad/s, windows of 14 to 30 ms) it was between −0.8 and 4.7.
const FED_BACK: [f64; 2] = [2.2, 0.9];

/// Poles of that low-pass, rad/s.
const FOLLOWING: f64 = 1500.0;

/// Before so many windows, counted without overlap, too little is left over to show that the model holds.
const WINDOWS_TO_TRUST: f64 = 1.25;

/// How many times more than [`CHANGE_LIMIT`] a window must fit better by itself to end the memory of an uncertain estimate.
const MUCH_BETTER: f64 = 25.0;

/// Residuals of so many windows are kept.
const ECHOES: usize = 4 * HOPS_PER_WINDOW;

/// Squares of the coefficients of a fourth difference: its variance for white noise of variance one.
const FOURTH_DIFFERENCE_GAIN: f64 = 70.0;

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
    /// By how much they differed from those before, A; for continuous currents.
    step_a: [f64; 3],
    /// How many of the last steps made a kink, as a part of one.
    kinks: [f64; 3],
    window: Window,
    /// What the paper's methods keep of the window instead.
    sums: Option<WindowSumsState>,
    filtered: LowPassState<CHANNELS>,
    learnt: Learnt,
    output: EstimatorOutput,
}

/// What the methods of least squares have learnt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Learnt {
    memory: Memory,
    /// Samples until the window is evaluated again.
    until_hop: u64,
    /// Samples until the windows hold none from before a change.
    until_clean: u64,
    /// What the last evaluation said.
    verdict: Reason,
    /// Scaled unknowns, once the memory has some.
    unknowns: Option<NormalVector>,
    covariance: NormalMatrix,
    /// What the last windows left unexplained, and how many of them there are.
    echoes: Vec<Targets>,
    next_echo: usize,
    echoed: usize,
    /// `Σ w e(t)·e(t − L)` and the weights, L being whole revolutions that last longer than a window.
    coherent: [f64; 2],
    /// The last four positions, newest first, and how many there are.
    former: [[f64; 2]; 4],
    formers: u32,
    /// Weighted sum of the squares of fourth differences, and of the weights.
    roughness: [f64; 2],
    /// The last usable sample.
    last_position_m: [f64; 2],
    last_current_a: [f64; 3],
    /// For how many samples each position has read the same.
    same: [u32; 2],
}

impl EstimatorState {
    /// The estimates after the last sample.
    #[must_use]
    pub fn output(&self) -> &EstimatorOutput {
        &self.output
    }
}

/// Solution of normal equations.
struct Solution {
    condition: f64,
    unknowns: Option<NormalVector>,
    inverse: Option<NormalMatrix>,
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
    /// Where the signals for the noise begin in the window.
    sensitivities: usize,
    /// The test functions of least squares; with the paper's methods empty.
    bank: Option<Bank>,
    /// Part of the noise in their rows that a controller follows.
    followed: f64,
    /// Samples from one evaluation of least squares to the next, and what is then left of what was learnt.
    hop: usize,
    keep: f64,
    /// What is left after one sample.
    keep_sample: f64,
    /// Samples that are kept as they are: a window of them for least squares, the last ones for the paper's methods.
    nodes: usize,
    /// The integrals of the paper's methods.
    sums: Option<WindowSums>,
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
        let least_squares = matches!(config.method, Method::LeastSquares | Method::Unbalance);
        let bank = least_squares.then(|| {
            let noise = if config.position_noise_m > 0.0 && config.current_noise_a > 0.0 {
                [config.position_noise_m, config.current_noise_a]
            } else {
                NOMINAL_NOISE
            };
            // A magnet force F = m g varies by 2 √(λ F)/s per ampere.
            let lambda0 = config.lambda0_nm2_a2.iter().sum::<f64>() / 3.0;
            let per_ampere = 2.0 * (lambda0 * config.m_kg * NOMINAL_ACCELERATION).sqrt() / config.gap_m;
            let force_noise = window2 / config.m_kg * per_ampere * noise[1];
            Bank::new(intervals, config.hold == Hold::Linear, noise[0], force_noise)
        });
        let reach: f64 = match &bank {
            Some(bank) => bank.rows.iter().map(Weights::reach).sum(),
            None => rows.iter().zip(&row_scale).map(|(w, scale): (&Weights, &f64)| w.reach() * scale).sum(),
        };
        let sensitivities = SQUARES + squares + unknowns - MAGNETS;
        let hop = (intervals / HOPS_PER_WINDOW).max(1);
        let rate = config.filter_omega_rad_s / (2.0 * config.filter_zeta);
        Ok(Self {
            intervals,
            samples_until_epsilon: ((epsilon_steps * (1.0 - WHOLE_NUMBER_TOLERANCE)).ceil() as u64).saturating_add(1),
            unknowns,
            followed: bank.as_ref().map_or(0.0, |bank| bank.followed(exp(-FOLLOWING * config.step_s))),
            sensitivities,
            signals: sensitivities + if least_squares { 2 * MAGNETS } else { 0 },
            bank,
            hop,
            keep: exp(-rate * config.step_s * hop as f64),
            keep_sample: exp(-rate * config.step_s),
            direction: config.alpha_rad.map(|alpha| [sin(alpha), cos(alpha)]),
            row_scale,
            static_load: Weights::static_load(intervals),
            reach: std::array::from_fn(|k| reach * column_scale[k]),
            column_scale,
            low_pass: LowPass::new(config.filter_omega_rad_s, config.filter_zeta, config.step_s),
            nodes: if least_squares { intervals + 1 } else { 2 },
            sums: (!least_squares).then(|| WindowSums::new(intervals, config.hold == Hold::Linear)),
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
            step_a: [0.0; 3],
            kinks: [0.0; 3],
            window: Window::new(self.signals, self.nodes),
            sums: self.sums.as_ref().map(WindowSums::start),
            filtered: LowPassState::default(),
            learnt: Learnt {
                memory: Memory::new(if self.bank.is_some() { self.intervals + 1 } else { 0 }),
                until_hop: 0,
                until_clean: 0,
                verdict: Reason::Filling,
                unknowns: None,
                covariance: NormalMatrix::zeros(),
                echoes: vec![Targets::zeros(); if self.bank.is_some() { ECHOES } else { 0 }],
                next_echo: 0,
                echoed: 0,
                coherent: [0.0; 2],
                former: [[0.0; 2]; 4],
                formers: 0,
                roughness: [0.0; 2],
                last_position_m: [0.0; 2],
                last_current_a: [0.0; 3],
                same: [0; 2],
            },
            output: self.first_output(),
        }
    }

    /// Whether a state, for instance one read from a file, has the shape this estimator needs.
    #[must_use]
    pub fn accepts(&self, state: &EstimatorState) -> bool {
        let sums = match (&self.sums, &state.sums) {
            (Some(sums), Some(state)) => sums.accepts(state),
            (None, None) => true,
            _ => false,
        };
        sums && state.window.has_shape(self.signals, self.nodes)
            && state.learnt.memory.has_shape(if self.bank.is_some() { self.intervals + 1 } else { 0 })
            && state.learnt.echoes.len() == if self.bank.is_some() { ECHOES } else { 0 }
            && state.learnt.next_echo < ECHOES
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
                state.kinks = [0.0; MAGNETS];
                clear(state);
                state.filtered = LowPassState::default();
                state.learnt.clear();
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
            lambda_std: self.config.lambda0_nm2_a2,
            valid: false,
            reason: Reason::Filling,
            condition: CONDITION_CAP,
            residual: 1.0,
            determinant: 0.0,
            load_n: [0.0; 2],
            unbalance_kg_m: 0.0,
            unbalance_phase_rad: 0.0,
            noise: [self.config.position_noise_m, self.config.current_noise_a],
            surprise: 0.0,
        }
    }

    fn advance(&self, state: &mut EstimatorState, input: &EstimatorInput) -> Reason {
        let usable = if !input.enable {
            Err(Reason::Disabled)
        } else if input.contact {
            Err(Reason::Contact)
        } else {
            self.signals(state, input).ok_or(Reason::BadSample)
        };
        let signals = match usable {
            Ok(signals) => signals,
            Err(reason) => return interrupt(state, reason),
        };
        if self.bank.is_some() && self.watch(&mut state.learnt, &signals, input, &state.window) {
            return interrupt(state, Reason::Stuck);
        }
        state.window.push(&signals[..self.signals.min(MAX_SIGNALS)]);
        state.samples = state.samples.saturating_add(1);
        let integrals = match (&self.sums, &mut state.sums) {
            (Some(sums), Some(state)) => sums.push(state, &self.pair(&signals)),
            _ => None,
        };
        let full = integrals.is_some() || (self.bank.is_some() && state.window.is_full());
        if !full || state.samples < self.samples_until_epsilon {
            return Reason::Filling;
        }
        if let Some(bank) = &self.bank {
            state.learnt.until_clean = state.learnt.until_clean.saturating_sub(1);
            if state.learnt.until_hop > 0 {
                state.learnt.until_hop -= 1;
                return state.learnt.verdict;
            }
            state.learnt.until_hop = self.hop as u64 - 1;
            let Some(verdict) = self.evaluate(state, bank, input.omega_rad_s) else {
                state.learnt.clear();
                return interrupt(state, Reason::BadSample);
            };
            state.learnt.verdict = verdict;
            return verdict;
        }
        let integrals = integrals.unwrap_or_default();
        let channels = self.channels(state, &integrals);
        // Written so that a NaN fails as well.
        if !channels.iter().all(|x| x.abs() < CHANNEL_LIMIT) {
            return interrupt(state, Reason::BadSample);
        }
        self.low_pass.step(&mut state.filtered, &channels);
        self.window_alone(&mut state.output, &channels);
        self.estimate(state, &integrals[ROWS_PER_AXIS])
    }

    /// A sample for the integrals of the paper's methods.
    fn pair(&self, signals: &[f64; MAX_SIGNALS]) -> Sample {
        let squares = |at: usize| std::array::from_fn(|k| signals[at + k]);
        let end = if self.config.hold == Hold::Linear { SQUARES } else { SQUARES + MAGNETS };
        Sample { position: [signals[0], signals[1]], squares: [squares(SQUARES), squares(end)] }
    }

    /// Follows the roughness of the positions and whether they move at all. True if a sensor is stuck.
    fn watch(
        &self,
        learnt: &mut Learnt,
        signals: &[f64; MAX_SIGNALS],
        input: &EstimatorInput,
        window: &Window,
    ) -> bool {
        let former = learnt.former;
        let now = [signals[0], signals[1]];
        if window.filled() == 0 {
            learnt.formers = 0;
        }
        let moved = [0, 1].map(|axis| learnt.last_position_m[axis] != now[axis]);
        let currents = learnt.last_current_a != input.current_a;
        learnt.last_position_m = now;
        learnt.last_current_a = input.current_a;
        for axis in 0..2 {
            let others = moved[1 - axis] || currents;
            learnt.same[axis] = match (moved[axis], others) {
                (true, _) => 0,
                (false, true) => learnt.same[axis].saturating_add(1),
                (false, false) => learnt.same[axis],
            };
        }
        if learnt.formers >= 4 {
            learnt.roughness = learnt.roughness.map(|sum| sum * self.keep_sample);
            for axis in 0..2 {
                let [a, b, c, d] = former.map(|position| position[axis]);
                let difference = (now[axis] + d) - 4.0 * (a + c) + 6.0 * b;
                learnt.roughness[0] += difference * difference;
                learnt.roughness[1] += FOURTH_DIFFERENCE_GAIN;
            }
        }
        learnt.former = [input.position_m, former[0], former[1], former[2]];
        learnt.formers = learnt.formers.saturating_add(1);
        learnt.same.iter().any(|same| *same >= STUCK_SAMPLES)
    }

    /// The rows of the present window, and its sums with the noise in them.
    fn evidence(&self, window: &Window, bank: &Bank, unknowns: &NormalVector) -> (Regressors, Targets, Sums) {
        let mut d = Regressors::zeros();
        let mut n = Targets::zeros();
        let functions = bank.rows.len().min(MAX_FUNCTIONS);
        for (row, weights) in bank.rows.iter().enumerate().take(functions) {
            let integrals = self.integrals(window, weights);
            for (axis, values) in self.row_pair(&integrals).iter().enumerate() {
                let at = axis * functions + row;
                n[at] = integrals.position[axis];
                for (k, value) in values.iter().enumerate() {
                    d[(at, k)] = *value;
                }
            }
        }
        let (n_y, n_z) = n.as_slice().split_at(functions);
        let shape = shape(n_y, &n_z[..functions]);
        let mut sums = Sums { p: d.tr_mul(&d), h: d.tr_mul(&n), square: n.norm_squared(), shape, ..Sums::default() };
        for k in 0..MAGNETS {
            let newest = window.signal(SQUARES + k).last().copied().unwrap_or(0.0);
            sums.level[k] = (newest * self.reach[k]) * (newest * self.reach[k]);
        }
        let current: [&[f64]; 3] = std::array::from_fn(|k| window.signal(self.sensitivities + k));
        let gap: [&[f64]; 3] = std::array::from_fn(|k| window.signal(self.sensitivities + MAGNETS + k));
        let mut pairs = [[0.0; MAGNETS]; MAGNETS];
        for (j, [zz, zu, uu]) in bank.profile.iter().enumerate() {
            for (k, row) in pairs.iter_mut().enumerate() {
                sums.p_current[k] += uu * current[k][j] * current[k][j];
                sums.h_position[k] += zu * gap[k][j];
                for (l, pair) in row.iter_mut().enumerate().skip(k) {
                    *pair += uu * gap[k][j] * gap[l][j];
                }
            }
            let Sensitivity { stiffness: [s_yy, s_yz, s_zz], current } = self.sensitivity(window, unknowns, j);
            sums.trace[0] += 2.0 * zz - 2.0 * zu * (s_yy + s_zz) + uu * (s_yy * s_yy + 2.0 * s_yz * s_yz + s_zz * s_zz);
            sums.trace[1] += uu * current.iter().map(|gain| gain * gain).sum::<f64>();
        }
        for (k, row) in pairs.iter().enumerate() {
            let scale = self.column_scale[k];
            sums.p_current[k] *= scale * scale;
            sums.h_position[k] *= scale;
            for (l, pair) in row.iter().enumerate().skip(k) {
                let [[sin_k, cos_k], [sin_l, cos_l]] = [self.direction[k], self.direction[l]];
                let along = sin_k * sin_l + cos_k * cos_l;
                let value = scale * self.column_scale[l] * along * along * pair;
                sums.p_position[(k, l)] = value;
                sums.p_position[(l, k)] = value;
            }
        }
        (d, n, sums)
    }

    /// What noise does at a node of the window.
    fn sensitivity(&self, window: &Window, unknowns: &NormalVector, node: usize) -> Sensitivity {
        let mut sensitivity = Sensitivity::default();
        for k in 0..MAGNETS {
            let scale = self.column_scale[k] * unknowns[k];
            let [sin, cos] = self.direction[k];
            let stiffness = scale * window.signal(self.sensitivities + MAGNETS + k)[node];
            sensitivity.stiffness[0] += stiffness * sin * sin;
            sensitivity.stiffness[1] += stiffness * sin * cos;
            sensitivity.stiffness[2] += stiffness * cos * cos;
            sensitivity.current[k] = scale * window.signal(self.sensitivities + k)[node];
        }
        sensitivity
    }

    /// Evaluates the present window by least squares, together with those before. `None` if its numbers cannot be used.
    fn evaluate(&self, state: &mut EstimatorState, bank: &Bank, omega_rad_s: f64) -> Option<Reason> {
        let EstimatorState { learnt, output, window, .. } = state;
        // What noise does depends a little on λ; before anything is known the window itself says what it is.
        let plausible = |x: &NormalVector| (0..MAGNETS).all(|k| x[k] > 0.01 && x[k] < 100.0);
        let guess = learnt.unknowns.filter(plausible).unwrap_or(NormalVector::repeat(1.0));
        let (d, n, mut sums) = self.evidence(window, bank, &guess);
        if !sums.is_below(SUM_LIMIT) {
            return None;
        }
        let raw = self.solve(&sums.p, &sums.h).unknowns;
        if let Some(raw) = raw {
            output.lambda_raw = self.lambda([raw[0], raw[1], raw[2]]);
            if learnt.unknowns.is_none() && plausible(&raw) {
                sums = self.evidence(window, bank, &raw).2;
            }
        }
        // What was learnt while something was wrong is of no use once a window fits by itself so much better.
        let better = match learnt.verdict {
            Reason::Singular | Reason::NotPositive => CHANGE_LIMIT,
            // A lasting error of the model makes single windows fit better too, but not that much.
            Reason::Uncertain => MUCH_BETTER * CHANGE_LIMIT,
            _ => f64::INFINITY,
        };
        if better.is_finite() && learnt.memory.weight[0] > 0.0 {
            let [position, current] = output.noise.map(|noise| noise * noise);
            let noise = position * sums.trace[0] + current * sums.trace[1];
            let own = raw.filter(plausible).map_or(f64::INFINITY, |raw| sums.rest(&raw));
            if better * own < noise && noise > MODEL_RESIDUAL * MODEL_RESIDUAL * sums.square {
                learnt.forget();
            }
        }
        if self.contradicts(learnt, output, (&d, &n, &sums)) {
            learnt.forget();
            learnt.until_clean = self.intervals as u64;
        }
        if learnt.until_clean > 0 {
            self.doubt(output);
            return Some(Reason::Changed);
        }
        let guess = learnt.unknowns.or(raw).filter(plausible).unwrap_or(guess);
        let sensitivity = |j: usize| self.sensitivity(window, &guess, j);
        learnt.memory.add(bank, (&d, &sums), sensitivity, (self.hop, self.keep), &self.direction);
        if let Some(x) = learnt.unknowns.or(raw) {
            self.listen(learnt, &(n - d * x), omega_rad_s);
        }
        let verdict = self.conclude(learnt, output, bank.rows.len());
        if verdict == Reason::Valid {
            if let Some(unknowns) = learnt.unknowns {
                output.lambda_hat = self.lambda([unknowns[0], unknowns[1], unknowns[2]]);
                self.report(output, &self.integrals(window, &self.static_load), &unknowns);
            }
        } else {
            self.doubt(output);
        }
        Some(verdict)
    }

    /// Whether the window is at odds with what was learnt before.
    fn contradicts(
        &self,
        learnt: &Learnt,
        output: &mut EstimatorOutput,
        (d, n, sums): (&Regressors, &Targets, &Sums),
    ) -> bool {
        let Some(x) = learnt.unknowns else { return false };
        let [position, current] = output.noise.map(|noise| noise * noise);
        let noise = position * sums.trace[0] + current * sums.trace[1];
        let uncertain = (sums.p * learnt.covariance).trace();
        let model = MODEL_RESIDUAL * MODEL_RESIDUAL * sums.square;
        output.surprise = ((n - d * x).norm_squared() / (noise + uncertain + model)).min(RESIDUAL_CAP);
        output.surprise.is_nan() || output.surprise > CHANGE_LIMIT
    }

    /// Compares what is left unexplained with what was left whole revolutions ago: noise has no memory, while what the model
    /// lacks comes back.
    fn listen(&self, learnt: &mut Learnt, left: &Targets, omega_rad_s: f64) {
        let window = self.intervals as f64;
        let hop = self.hop as f64;
        let revolution = TAU / (omega_rad_s.abs() * self.config.step_s);
        // Windows that far apart have no sample in common.
        let apart = (window / hop).ceil();
        let whole = ((window / revolution - 1e-3).ceil() * revolution / hop).round().max(apart);
        let lag = if whole < ECHOES as f64 { whole as usize } else { apart as usize };
        let keep = self.keep;
        learnt.coherent = learnt.coherent.map(|sum| sum * keep);
        if (1..ECHOES).contains(&lag) && learnt.echoed >= lag {
            let former = learnt.echoes[(learnt.next_echo + ECHOES - lag) % ECHOES];
            learnt.coherent[0] += left.dot(&former);
            learnt.coherent[1] += 1.0;
        }
        learnt.echoes[learnt.next_echo] = *left;
        learnt.next_echo = (learnt.next_echo + 1) % ECHOES;
        learnt.echoed = (learnt.echoed + 1).min(ECHOES);
    }

    /// Solves the normal equations of the memory, with the noise that it finds in them.
    fn conclude(&self, learnt: &mut Learnt, output: &mut EstimatorOutput, functions: usize) -> Reason {
        let memory = &learnt.memory;
        let sums = &memory.sums;
        let excited = (0..MAGNETS).all(|k| sums.p[(k, k)] > EXCITATION_FLOOR * EXCITATION_FLOOR * sums.level[k]);
        let given = [self.config.position_noise_m, self.config.current_noise_a].map(|noise| noise * noise);
        let [rough, weight] = learnt.roughness;
        let smooth = if weight > 0.0 { rough / weight } else { 0.0 };
        let mut variance = output.noise.map(|noise| noise * noise);
        variance[0] = if given[0] > 0.0 { given[0] } else { variance[0].min(smooth) };
        let mut solution = self.solve(&sums.p, &sums.h);
        output.condition = solution.condition;
        // As many independent rows as there are in windows that do not overlap, and how far their sum of squares scatters.
        let [weight, weight2] = memory.weight;
        let windows = 1.0 + (weight * weight / weight2 - 1.0) * self.hop as f64 / self.intervals as f64;
        let freedom = (2.0 * functions as f64 * windows - self.unknowns as f64).max(1.0);
        let scatter = (2.0 / freedom).sqrt();
        let mut compensate = variance;
        // The noise follows from the residual, the compensation from the noise; two rounds settle it.
        for _ in 0..3 {
            let (Some(x), Some(inverse)) = (solution.unknowns, solution.inverse) else { break };
            let rest = sums.rest(&x);
            let left: [f64; 2] =
                std::array::from_fn(|s| (sums.trace[s] - (inverse * memory.score[s]).trace()).max(0.1 * sums.trace[s]));
            if given[0] == 0.0 {
                variance[0] = smooth.min(rest / left[0]);
            }
            // What noise does not explain counts as noise of the currents, whatever it is.
            let unexplained = ((rest - variance[0] * left[0]) / left[1]).max(0.0);
            let chance = scatter * rest / left[1];
            // What may be chance is not taken off: too much compensation feeds itself, for it makes the residual grow.
            let weight = unexplained * unexplained / (unexplained * unexplained + chance * chance);
            let known = if weight.is_finite() { unexplained * weight } else { 0.0 };
            compensate = [variance[0], if given[1] > 0.0 { given[1] } else { known }];
            variance[1] = if given[1] > 0.0 && unexplained < given[1] + chance {
                given[1]
            } else if given[1] > 0.0 {
                unexplained
            } else {
                // The less is known of the noise, the more of it is reckoned with.
                unexplained + NOISE_MARGIN * chance
            };
            let (p, h) = sums.compensated(compensate);
            solution = self.solve(&p, &h);
        }
        let (Some(x), Some(inverse)) = (solution.unknowns, solution.inverse) else {
            return Reason::Singular;
        };
        if !variance.iter().chain(&compensate).all(|v| v.is_finite()) {
            return Reason::Singular;
        }
        output.noise = variance.map(f64::sqrt);
        output.condition = output.condition.max(solution.condition);
        output.residual = if sums.square > 0.0 { (sums.rest(&x) / sums.square).sqrt().min(RESIDUAL_CAP) } else { 1.0 };
        let hidden = self.config.method == Method::LeastSquares && is_round(sums.shape, sums.square);
        if !excited || output.condition > CONDITION_LIMIT || hidden {
            return Reason::Singular;
        }
        let fed_back = inverse * fed_back(&x, self.followed * variance[0] * sums.trace[0]);
        let x = x - fed_back * FED_BACK[0];
        if !(0..MAGNETS).all(|k| x[k] > 0.0) {
            return Reason::NotPositive;
        }
        let score = memory.score[0] * variance[0] + memory.score[1] * variance[1];
        let covariance = inverse * score * inverse + fed_back * fed_back.transpose() * (FED_BACK[1] * FED_BACK[1]);
        if !covariance.iter().all(|c| c.is_finite()) {
            return Reason::Singular;
        }
        // Part of the residual that is no noise, brought to the windows of the memory.
        let rest = sums.rest(&x);
        let [echo, pairs] = learnt.coherent;
        let pairs_of_windows = pairs * self.hop as f64 / self.intervals as f64;
        // Without the unbalance among the unknowns, what could hide below the limit counts as well: it is no small error of λ.
        let presumes = self.config.method == Method::LeastSquares;
        let coherent = if pairs_of_windows >= PAIRS_TO_JUDGE {
            let echo = echo * weight / pairs;
            let chance = rest / (2.0 * functions as f64 * pairs_of_windows).sqrt();
            if echo > COHERENCE_LIMIT * chance {
                echo
            } else if presumes {
                COHERENCE_LIMIT * chance
            } else {
                0.0
            }
        } else if presumes || given[1] == 0.0 || windows < WINDOWS_TO_TRUST {
            rest
        } else if variance[1] > given[1] {
            rest * (1.0 - given[1] / variance[1])
        } else {
            0.0
        };
        let bend = if self.config.hold == Hold::Linear { LINEAR_RESIDUAL * LINEAR_RESIDUAL * sums.square } else { 0.0 };
        let coherent = coherent + bend;
        let mut sure = true;
        for k in 0..MAGNETS {
            let model = MODEL_STD * x[k];
            let model_error = inverse[(k, k)].max(0.0) * coherent;
            let std = (covariance[(k, k)].max(0.0) + model_error + model * model).sqrt();
            output.lambda_std[k] = self.config.lambda0_nm2_a2[k] * std.min(STD_CAP);
            sure &= std <= STD_LIMIT * x[k];
        }
        learnt.unknowns = Some(x);
        learnt.covariance = covariance;
        if sure { Reason::Valid } else { Reason::Uncertain }
    }

    /// While the estimate is not valid, its standard deviation covers how far the present window is from it.
    fn doubt(&self, output: &mut EstimatorOutput) {
        for k in 0..MAGNETS {
            let off = (output.lambda_raw[k] - output.lambda_hat[k]).abs();
            let cap = STD_CAP * self.config.lambda0_nm2_a2[k];
            output.lambda_std[k] = output.lambda_std[k].max(off).min(cap);
        }
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
        let (mut steps, mut kinks) = ([0.0; MAGNETS], [0.0; MAGNETS]);
        for k in 0..MAGNETS {
            let i = match self.config.hold {
                Hold::HeldBefore | Hold::Linear => input.current_a[k],
                Hold::HeldAfter => state.current_a[k],
            };
            // The mean of (i + n)² is i² + σ_i².
            let square = i * i - self.config.current_noise_a * self.config.current_noise_a;
            if self.config.hold == Hold::Linear {
                // The mean of i² along the straight line from i_0 to i_1 is (i_0² + i_1²)/2 − (i_1 − i_0)²/6.
                // Where the current is smooth its curvature makes up for that.
                let step = if state.window.filled() > 0 { i - state.current_a[k] } else { 0.0 };
                let former = if state.window.filled() > 1 { state.step_a[k] } else { step };
                steps[k] = step;
                let noise = self.config.current_noise_a * self.config.current_noise_a;
                let kink = (step - former) * (step - former) > KINK * (step * step + former * former);
                kinks[k] = KINK_KEEP * state.kinks[k] + if kink { 1.0 - KINK_KEEP } else { 0.0 };
                let chord = if kinks[k] > KINKED { step * step - 2.0 * noise } else { 0.0 };
                signals[SQUARES + k] = (square - chord / 6.0) * w[k];
            } else if state.window.filled() > 0 {
                // Within the interval 1/gap² is a parabola; one twelfth of its second difference, taken off both
                // ends of the chord, gives the chord the area of the parabola.
                let bulge = if state.window.filled() > 1 { (w[k] - 2.0 * w_last[k] + w_before[k]) / 12.0 } else { 0.0 };
                signals[SQUARES + k] = square * (w_last[k] - bulge);
                signals[SQUARES + MAGNETS + k] = square * (w[k] - bulge);
            }
        }
        if self.config.method == Method::Unbalance {
            let omega2 = input.omega_rad_s * input.omega_rad_s;
            signals[self.sensitivities - 2] = omega2 * cos(input.theta_rad);
            signals[self.sensitivities - 1] = omega2 * sin(input.theta_rad);
        }
        if self.bank.is_some() {
            for (k, w) in w.iter().enumerate() {
                let i = if self.config.hold == Hold::HeldAfter { state.current_a[k] } else { input.current_a[k] };
                let at = self.sensitivities + k;
                signals[at] = 2.0 * i * w;
                signals[at + MAGNETS] = 2.0 * i * i * w * w.sqrt();
            }
        }
        let fine = signals.iter().chain(&w).chain(&input.current_a).all(|x| x.is_finite());
        if fine {
            state.inverse_square_gap = [w, w_last];
            state.current_a = input.current_a;
            state.step_a = steps;
            state.kinks = kinks;
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
                Method::Unbalance => [node(self.sensitivities - 2), node(self.sensitivities - 1)],
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
    fn channels(&self, state: &mut EstimatorState, integrals: &[Integrals; KERNELS]) -> Channels {
        let mut d = SMatrix::<f64, ROWS, MAX_UNKNOWNS>::zeros();
        let mut n = SVector::<f64, ROWS>::zeros();
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

        // The paper solves the rows of the z axis; those of both axes judge the result.
        let p: NormalMatrix = d.tr_mul(&d);
        let h: NormalVector = d.tr_mul(&n);
        for (channel, (row, column)) in upper_triangle().enumerate() {
            channels[channel] = p[(row, column)];
        }
        channels.fixed_rows_mut::<MAX_UNKNOWNS>(RIGHT).copy_from(&h);
        channels[SQUARE] = n.norm_squared();
        let [shape_0, shape_1] = shape(&n.as_slice()[..ROWS_PER_AXIS], &n.as_slice()[ROWS_PER_AXIS..]);
        channels[SHAPE] = shape_0;
        channels[SHAPE + 1] = shape_1;
        for k in 0..MAGNETS {
            let newest = state.window.signal(SQUARES + k).last().copied().unwrap_or(0.0);
            channels[LEVEL + k] = (newest * self.reach[k]) * (newest * self.reach[k]);
        }
        channels
    }

    /// P(19): the estimate from the present window, which the output keeps if there is one.
    fn window_alone(&self, output: &mut EstimatorOutput, channels: &Channels) {
        let lambda = self.lambda(ratio(channels));
        if lambda.iter().all(|l| l.is_finite()) {
            output.lambda_raw = lambda;
        }
    }

    /// The paper's estimate from the filtered quantities.
    fn estimate(&self, state: &mut EstimatorState, static_load: &Integrals) -> Reason {
        let filtered = &state.filtered.value;
        let output = &mut state.output;
        let p = normal(filtered);
        let solution = self.solve(&p, &filtered.fixed_rows::<MAX_UNKNOWNS>(RIGHT).into_owned());
        output.condition = solution.condition;
        let excited = (0..MAGNETS).all(|k| p[(k, k)] > EXCITATION_FLOOR * EXCITATION_FLOOR * filtered[LEVEL + k]);
        let literal = self.config.method == Method::PaperLiteral;
        let scaled = ratio(filtered);
        let lambda = self.lambda(scaled);
        if !scaled.iter().chain(&lambda).all(|x| x.is_finite()) {
            return Reason::Singular;
        }
        let mut unknowns = NormalVector::zeros();
        unknowns.fixed_rows_mut::<MAGNETS>(0).copy_from_slice(&scaled);
        output.residual = residual(filtered, &unknowns);
        // Whatever is left unexplained counts as one coherent error, for it may be: no averaging over windows.
        let rest = output.residual * output.residual * filtered[SQUARE];
        for k in 0..MAGNETS {
            let spread = solution.inverse.map_or(f64::INFINITY, |inverse| (inverse[(k, k)].max(0.0) * rest).sqrt());
            let std = (spread * spread + (MODEL_STD * scaled[k]) * (MODEL_STD * scaled[k])).sqrt();
            output.lambda_std[k] = self.config.lambda0_nm2_a2[k] * if std < STD_CAP { std } else { STD_CAP };
        }
        if literal {
            output.lambda_hat = lambda;
        }
        if !excited
            || output.condition > CONDITION_LIMIT
            || is_round([filtered[SHAPE], filtered[SHAPE + 1]], filtered[SQUARE])
        {
            return Reason::Singular;
        }
        if !lambda.iter().all(|l| *l > 0.0) {
            return Reason::NotPositive;
        }
        if !literal && output.residual > RESIDUAL_LIMIT {
            return Reason::Unexplained;
        }
        let few = state.samples <= PAPER_WINDOWS * self.intervals as u64;
        if few || (0..MAGNETS).any(|k| output.lambda_std[k] > PAPER_STD_LIMIT * lambda[k]) {
            return Reason::Uncertain;
        }
        output.lambda_hat = lambda;
        self.report(output, static_load, &unknowns);
        Reason::Valid
    }

    /// Unbalance and static load that go with a valid estimate.
    fn report(&self, output: &mut EstimatorOutput, static_load: &Integrals, unknowns: &NormalVector) {
        let unit = self.config.m_kg * self.config.gap_m;
        let (along, across) = (unit * unknowns[MAGNETS], unit * unknowns[MAGNETS + 1]);
        let magnitude = (along * along + across * across).sqrt();
        if magnitude.is_finite() {
            output.unbalance_kg_m = magnitude;
            output.unbalance_phase_rad = atan2(across, along);
        }
        let load = self.static_load(static_load, unknowns);
        if load.iter().all(|p| p.is_finite()) {
            output.load_n = load;
        }
    }

    /// The constant force that is left over in the present window: `m (∫ ψ'' Z/T_f² − Σ λ̂ ∫ ψ u)/∫ ψ` per axis.
    fn static_load(&self, integrals: &Integrals, unknowns: &NormalVector) -> [f64; 2] {
        let rows = self.row_pair(integrals);
        std::array::from_fn(|axis| {
            let modelled: f64 = rows[axis].iter().zip(unknowns.iter()).map(|(d, x)| d * x).sum();
            self.config.m_kg * (integrals.position[axis] - modelled) / (self.config.window_s * self.config.window_s)
        })
    }

    /// λ from the scaled unknowns.
    fn lambda(&self, scaled: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|k| self.config.lambda0_nm2_a2[k] * scaled[k])
    }

    /// Solves normal equations.
    ///
    /// The columns of the unbalance are brought to the size of those of the magnets first, for their natural size
    /// changes with ω⁴; without rotation they vanish and the system is singular.
    fn solve(&self, p: &NormalMatrix, h: &NormalVector) -> Solution {
        let mut p = *p;
        let magnets = (p[(0, 0)] + p[(1, 1)] + p[(2, 2)]) / 3.0;
        let mut scale = NormalVector::repeat(1.0);
        if self.unknowns > MAGNETS {
            let unbalance = (p[(3, 3)] + p[(4, 4)]) / 2.0;
            let factor = (magnets / unbalance).sqrt();
            if !(factor.is_finite() && factor > 0.0) {
                return Solution { condition: CONDITION_CAP, unknowns: None, inverse: None };
            }
            scale[3] = factor;
            scale[4] = factor;
        }
        for row in 0..MAX_UNKNOWNS {
            for column in 0..MAX_UNKNOWNS {
                p[(row, column)] *= scale[row] * scale[column];
            }
        }
        let eigen = SymmetricEigen::new(&p, self.unknowns);
        let unknowns = eigen.solve(&h.component_mul(&scale)).map(|x| x.component_mul(&scale));
        let inverse = eigen
            .inverse()
            .map(|inverse| NormalMatrix::from_fn(|row, column| inverse[(row, column)] * scale[row] * scale[column]));
        Solution { condition: eigen.condition(), unknowns, inverse }
    }
}

impl Learnt {
    /// Forgets what windows have taught; what is known of the sensors stays.
    fn forget(&mut self) {
        self.memory.clear();
        self.unknowns = None;
        self.covariance = NormalMatrix::zeros();
        self.forget_echoes();
        self.coherent = [0.0; 2];
    }

    /// No window to come is a whole number of hops after those before.
    fn forget_echoes(&mut self) {
        self.next_echo = 0;
        self.echoed = 0;
    }

    /// Forgets everything.
    fn clear(&mut self) {
        self.forget();
        self.until_hop = 0;
        self.until_clean = 0;
        self.verdict = Reason::Filling;
        self.formers = 0;
        self.former = [[0.0; 2]; 4];
        self.roughness = [0.0; 2];
        self.last_position_m = [0.0; 2];
        self.last_current_a = [0.0; 3];
        self.same = [0; 2];
    }
}

/// Forgets the samples.
fn clear(state: &mut EstimatorState) {
    state.window.clear();
    if let Some(sums) = &mut state.sums {
        sums.clear();
    }
}

/// A gap in the data: the next window begins after it.
fn interrupt(state: &mut EstimatorState, reason: Reason) -> Reason {
    // Parting costs time in proportion to the window; once is enough.
    if state.window.filled() > 0 {
        state.learnt.memory.part();
    }
    clear(state);
    state.learnt.forget_echoes();
    state.learnt.until_hop = 0;
    state.learnt.until_clean = 0;
    state.learnt.formers = 0;
    if reason != Reason::Stuck {
        state.learnt.same = [0; 2];
    }
    reason
}

/// `|N_y|² − |N_z|²` and `2 N_y·N_z`: both are zero on a circle.
fn shape(n_y: &[f64], n_z: &[f64]) -> [f64; 2] {
    let pairs = || n_y.iter().zip(n_z);
    [pairs().map(|(y, z)| y * y - z * z).sum(), pairs().map(|(y, z)| 2.0 * y * z).sum()]
}

/// `E[Σ w Dᵀ δN]` if the controller follows the noise of the positions, given what the noise that it follows contributes to
/// `Σ w |N|²`.
///
/// A controller takes noise n for motion and moves the rotor by −T n, T being the complementary sensitivity: D x then
/// contains −T n, and N contains n beside. Each of three magnets bears a third of that.
fn fed_back(x: &NormalVector, noise: f64) -> NormalVector {
    NormalVector::from_fn(|k, _| if k < MAGNETS { -noise / (MAGNETS as f64 * x[k]) } else { 0.0 })
}

/// Whether the motion is so nearly a circle that an unbalance would look like other force constants: see [`ROUND_LIMIT`].
fn is_round([difference, product]: [f64; 2], square: f64) -> bool {
    (difference * difference + product * product).sqrt() < ROUND_LIMIT * square
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
