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
//! Here are the samples, gaps between them, and the state; `paper.rs` and `least_squares.rs` are what is made of the windows. The
//! column of `λ_k` is multiplied by `λ_0,k`, so that the unknowns are `λ_k/λ_0,k`.

mod config;
mod least_squares;
mod paper;

use libm::{atan2, cos, sin, sincos};
use serde::{Deserialize, Serialize};

pub use self::config::{
    CHANGE_LIMIT, CONDITION_LIMIT, EXCITATION_FLOOR, EstimatorConfig, EstimatorInput, EstimatorOutput, Hold,
    LEAST_SINE_BETWEEN_MAGNETS, MAX_INTERVALS, MIN_INTERVALS, MODEL_STD, Method, PAPER_STD_LIMIT, PAPER_WINDOWS,
    RESIDUAL_CAP, RESIDUAL_LIMIT, ROUND_LIMIT, Reason, STD_CAP, STD_LIMIT, STUCK_SAMPLES,
};
use self::config::{WHOLE_NUMBER_TOLERANCE, check};
use self::least_squares::{Learnt, LeastSquares};
use self::paper::CHANNELS;
use super::Invalid;
use super::kernel::{ROWS_PER_AXIS, Weights};
use super::lowpass::{LowPass, LowPassState};
use super::regression::{CONDITION_CAP, MAX_UNKNOWNS, NormalVector};
use super::window::{Integrals, Sample, WindowSums, WindowSumsState};

const MAGNETS: usize = 3;

/// Two steps of a current whose difference squared is more than this part of their squares make a kink; at 3000 rpm those of
/// the path differ by 5e-4.
const KINK: f64 = 0.03;

/// A current is straight between samples, and not smooth, if so many of its last steps make kinks, and what is left of that
/// count after a step. At its extremes a smooth current has about eleven such steps in a row.
const KINKED: f64 = 0.4;
const KINK_KEEP: f64 = 0.97;

/// What a sample gives the windows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Signals {
    /// Position, and `i²/gap²` of each magnet.
    sample: Sample,
    /// `ω² (cos θ, sin θ)`, rad²/s², with [`Method::Unbalance`].
    rotating: [f64; 2],
    /// `2 i/gap²` and `2 i²/gap³` of each magnet, what noise of currents and positions is multiplied by, with least squares.
    gain: [[f64; 3]; 2],
}

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
    /// Samples since the last gap in the data.
    filled: u64,
    /// What the paper's methods keep of the window.
    sums: Option<WindowSumsState>,
    filtered: LowPassState<CHANNELS>,
    /// What least squares keeps of it, and has made of those before.
    learnt: Option<Learnt>,
    output: EstimatorOutput,
}

impl EstimatorState {
    /// The estimates after the last sample.
    #[must_use]
    pub fn output(&self) -> &EstimatorOutput {
        &self.output
    }
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
    /// `(sin α_k, cos α_k)`.
    direction: [[f64; 2]; 3],
    least_squares: Option<LeastSquares>,
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
        let rows: [Weights; ROWS_PER_AXIS] = std::array::from_fn(|row| Weights::paper(row, intervals));
        let row_scale = std::array::from_fn(|row| 1.0 / rows[row].noise_gain());
        let window2 = config.window_s * config.window_s;
        let column_scale = std::array::from_fn(|k| match config.lambda0_nm2_a2.get(k) {
            Some(lambda0) => window2 * lambda0 / config.m_kg,
            None => window2 * config.gap_m,
        });
        let least_squares = LeastSquares::new(&config, intervals);
        let reach: f64 = match &least_squares {
            Some(least_squares) => least_squares.bank.reach(),
            None => rows.iter().zip(&row_scale).map(|(w, scale): (&Weights, &f64)| w.reach() * scale).sum(),
        };
        Ok(Self {
            intervals,
            samples_until_epsilon: ((epsilon_steps * (1.0 - WHOLE_NUMBER_TOLERANCE)).ceil() as u64).saturating_add(1),
            unknowns,
            direction: config.alpha_rad.map(|alpha| [sin(alpha), cos(alpha)]),
            row_scale,
            static_load: Weights::static_load(intervals),
            reach: std::array::from_fn(|k| reach * column_scale[k]),
            column_scale,
            low_pass: LowPass::new(config.filter_omega_rad_s, config.filter_zeta, config.step_s),
            sums: least_squares.is_none().then(|| WindowSums::new(intervals, config.hold == Hold::Linear)),
            least_squares,
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
            filled: 0,
            sums: self.sums.as_ref().map(WindowSums::start),
            filtered: LowPassState::default(),
            learnt: self.least_squares.as_ref().map(LeastSquares::start),
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
        let learnt = match (&self.least_squares, &state.learnt) {
            (Some(least_squares), Some(learnt)) => least_squares.accepts(learnt),
            (None, None) => true,
            _ => false,
        };
        sums && learnt
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
                if let Some(learnt) = &mut state.learnt {
                    learnt.clear();
                }
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
        let said = match (&self.least_squares, &self.sums) {
            (Some(least_squares), _) => self.learn(state, least_squares, &signals, input),
            (None, Some(sums)) => self.filter(state, sums, &signals.sample),
            (None, None) => Err(Reason::ForeignState),
        };
        said.unwrap_or_else(|reason| interrupt(state, reason))
    }

    /// What one sample gives the windows, and the memory of the last samples brought up to date. `None` if the sample is of no use.
    fn signals(&self, state: &mut EstimatorState, input: &EstimatorInput) -> Option<Signals> {
        let [y, z] = input.position_m;
        let mut w = [0.0; MAGNETS];
        for (w, [sin, cos]) in w.iter_mut().zip(self.direction) {
            let gap = self.config.gap_m - sin * y - cos * z;
            if gap.is_nan() || gap <= 0.0 {
                return None;
            }
            *w = 1.0 / (gap * gap);
        }
        let mut signals = Signals::default();
        signals.sample.position = input.position_m;
        let [w_last, w_before] = state.inverse_square_gap;
        let (mut steps, mut kinks) = ([0.0; MAGNETS], [0.0; MAGNETS]);
        for k in 0..MAGNETS {
            let i = match self.config.hold {
                Hold::HeldBefore | Hold::Linear => input.current_a[k],
                Hold::HeldAfter => state.current_a[k],
            };
            // The mean of (i + n)² is i² + σ_i².
            let square = i * i - self.config.current_noise_a * self.config.current_noise_a;
            let [start, end] = &mut signals.sample.squares;
            if self.config.hold == Hold::Linear {
                // The mean of i² along the straight line from i_0 to i_1 is (i_0² + i_1²)/2 − (i_1 − i_0)²/6.
                // Where the current is smooth its curvature makes up for that.
                let step = if state.filled > 0 { i - state.current_a[k] } else { 0.0 };
                let former = if state.filled > 1 { state.step_a[k] } else { step };
                steps[k] = step;
                let noise = self.config.current_noise_a * self.config.current_noise_a;
                let kink = (step - former) * (step - former) > KINK * (step * step + former * former);
                kinks[k] = KINK_KEEP * state.kinks[k] + if kink { 1.0 - KINK_KEEP } else { 0.0 };
                let chord = if kinks[k] > KINKED { step * step - 2.0 * noise } else { 0.0 };
                start[k] = (square - chord / 6.0) * w[k];
                end[k] = start[k];
            } else if state.filled > 0 {
                // Within the interval 1/gap² is a parabola; one twelfth of its second difference, taken off both
                // ends of the chord, gives the chord the area of the parabola.
                let bulge = if state.filled > 1 { (w[k] - 2.0 * w_last[k] + w_before[k]) / 12.0 } else { 0.0 };
                start[k] = square * (w_last[k] - bulge);
                end[k] = square * (w[k] - bulge);
            }
            if self.least_squares.is_some() {
                signals.gain[0][k] = 2.0 * i * w[k];
                signals.gain[1][k] = 2.0 * i * i * w[k] * w[k].sqrt();
            }
        }
        if self.config.method == Method::Unbalance {
            let omega2 = input.omega_rad_s * input.omega_rad_s;
            let (sin, cos) = sincos(input.theta_rad);
            signals.rotating = [omega2 * cos, omega2 * sin];
        }
        let Signals { sample, rotating, gain } = &signals;
        let values = sample.position.iter().chain(sample.squares.as_flattened()).chain(rotating);
        let fine = values.chain(gain.as_flattened()).chain(&w).chain(&input.current_a).all(|x| x.is_finite());
        if fine {
            state.inverse_square_gap = [w, w_last];
            state.current_a = input.current_a;
            state.step_a = steps;
            state.kinks = kinks;
        }
        fine.then_some(signals)
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
}

/// `|N_y|² − |N_z|²` and `2 N_y·N_z`: both are zero on a circle.
fn shape(n_y: &[f64], n_z: &[f64]) -> [f64; 2] {
    let pairs = || n_y.iter().zip(n_z);
    [pairs().map(|(y, z)| y * y - z * z).sum(), pairs().map(|(y, z)| 2.0 * y * z).sum()]
}

/// Whether the motion is so nearly a circle that an unbalance would look like other force constants: see [`ROUND_LIMIT`].
fn is_round([difference, product]: [f64; 2], square: f64) -> bool {
    (difference * difference + product * product).sqrt() < ROUND_LIMIT * square
}

/// Forgets the samples.
fn clear(state: &mut EstimatorState) {
    state.filled = 0;
    if let Some(sums) = &mut state.sums {
        sums.clear();
    }
}

/// A gap in the data: the next window begins after it.
fn interrupt(state: &mut EstimatorState, reason: Reason) -> Reason {
    if let Some(learnt) = &mut state.learnt {
        learnt.part(state.filled > 0, reason);
    }
    clear(state);
    reason
}
