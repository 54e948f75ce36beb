//! Weighted least squares of both axes, over all windows remembered (method section 6).
//!
//! The methods `LeastSquares` and `Unbalance` take the test functions of [`crate::model::memory::Bank`] instead of the paper's three:
//! the lowest sines of the window without their mean, combined so that noise is white in them. A window is evaluated 25 times
//! while it moves by its own length, and what it says is remembered with the weight `e^{−γ age}`, `γ = ω_n/(2 ζ)`. In the long
//! run that has the mean age and the noise bandwidth of F(s), but no dead time at the start: F gives the newest data the
//! weight zero, and at 35 ms nearly all data are new.
//!
//! **Noise** of every single sample is followed into the estimate ([`crate::model::memory`]): its bias is taken off, its variance makes
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

use std::f64::consts::TAU;

use libm::exp;
use serde::{Deserialize, Serialize};

use super::config::{
    CHANGE_LIMIT, CONDITION_LIMIT, EXCITATION_FLOOR, EstimatorConfig, EstimatorInput, EstimatorOutput, Hold, MODEL_STD,
    Method, RESIDUAL_CAP, Reason, STD_CAP, STD_LIMIT, STUCK_SAMPLES,
};
use super::{Estimator, EstimatorState, MAGNETS, Signals, is_round, shape};
use crate::model::memory::{Bank, Gains, Memory, Residuals, Rows, Sensitivity, Sums};
use crate::model::regression::{Equations, NormalMatrix, NormalVector};
use crate::model::sines::{HOPS_PER_WINDOW, LANES, SlidingSines, SlidingSinesState};
use crate::model::window::{Integrals, Window, combined};

/// Sums of squares of regressors beyond this come from samples that no bearing makes.
const SUM_LIMIT: f64 = 1.0e60;

/// What the discretisation may leave of a motion without noise, relative.
const MODEL_RESIDUAL: f64 = 2.0e-3;

/// Noise found from the residual is reckoned with so many of its own standard deviations higher.
const NOISE_MARGIN: f64 = 0.5;

/// How many of its own standard deviations a correlation of residuals one or more revolutions apart must have to count as
/// an error of the model.
const COHERENCE_LIMIT: f64 = 3.0;

/// Pairs of windows, counted without overlap, that it takes to tell a coherent residual from noise. Before, all of it counts
/// as coherent if the noise is not given, and what the noise does not explain if it is.
const PAIRS_TO_JUDGE: f64 = 1.5;

/// What is left of a motion without noise, relative, if a voltage drives the currents: they are not quite straight between
/// samples.
const LINEAR_RESIDUAL: f64 = 1.0e-4;

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

/// Noise that the test functions are made for where none is stated, m and A. Another noise is counted as it is; only
/// the weights are then not the best ones.
const NOMINAL_NOISE: [f64; 2] = [1.0e-7, 1.0e-2];

/// Acceleration by the magnets that the test functions are made for, m/s²: the weight of the rotor.
const NOMINAL_ACCELERATION: f64 = 9.81;

/// Signals of a cell: the squares of the gains of the currents, then the gains of the positions.
const CELL_SIGNALS: usize = 2 * MAGNETS;

/// What least squares needs beside the configuration.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct LeastSquares {
    pub(super) bank: Bank,
    sines: SlidingSines,
    intervals: usize,
    continuous: bool,
    /// Samples from one evaluation to the next, and what is then left of what was learnt.
    hop: usize,
    keep: f64,
    /// What is left after one sample.
    keep_sample: f64,
}

/// What the methods of least squares keep of the window, and have learnt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Learnt {
    /// The last sample and the one before.
    recent: [Signals; 2],
    sines: SlidingSinesState,
    /// The cells of the window, the sums over the one that is filling up, and of how many samples.
    cells: Window,
    cell: [f64; CELL_SIGNALS],
    in_cell: u32,
    memory: Memory,
    /// Samples until the window is evaluated.
    until_hop: u64,
    /// Samples until the windows hold none from before a change.
    until_clean: u64,
    /// What the last evaluation said.
    verdict: Reason,
    /// Scaled unknowns, once the memory has some.
    unknowns: Option<NormalVector>,
    covariance: NormalMatrix,
    /// What the last windows left unexplained, and how many of them there are.
    echoes: Vec<Residuals>,
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

    /// A gap in the data, for this reason; `filled` if there are samples before it.
    pub(super) fn part(&mut self, filled: bool, reason: Reason) {
        if filled {
            self.memory.part();
        }
        self.sines.clear();
        self.cells.clear();
        self.cell = [0.0; CELL_SIGNALS];
        self.in_cell = 0;
        self.forget_echoes();
        self.until_clean = 0;
        self.formers = 0;
        if reason != Reason::Stuck {
            self.same = [0; 2];
        }
    }

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        self.part(false, Reason::Filling);
        self.forget();
        self.verdict = Reason::Filling;
        self.former = [[0.0; 2]; 4];
        self.roughness = [0.0; 2];
        self.last_position_m = [0.0; 2];
        self.last_current_a = [0.0; 3];
    }
}

impl LeastSquares {
    /// What the methods of least squares need; `None` for the others.
    pub(super) fn new(config: &EstimatorConfig, intervals: usize) -> Option<Self> {
        if !matches!(config.method, Method::LeastSquares | Method::Unbalance) {
            return None;
        }
        let noise = if config.position_noise_m > 0.0 && config.current_noise_a > 0.0 {
            [config.position_noise_m, config.current_noise_a]
        } else {
            NOMINAL_NOISE
        };
        // A magnet force F = m g varies by 2 √(λ F)/s per ampere.
        let lambda0 = config.lambda0_nm2_a2.iter().sum::<f64>() / 3.0;
        let per_ampere = 2.0 * (lambda0 * config.m_kg * NOMINAL_ACCELERATION).sqrt() / config.gap_m;
        let force_noise = config.window_s * config.window_s / config.m_kg * per_ampere * noise[1];
        let continuous = config.hold == Hold::Linear;
        let hop = (intervals / HOPS_PER_WINDOW).max(1);
        let rate = config.filter_omega_rad_s / (2.0 * config.filter_zeta);
        Some(Self {
            bank: Bank::new(intervals, hop, continuous, [noise[0], force_noise], exp(-FOLLOWING * config.step_s)),
            sines: SlidingSines::new(intervals, hop),
            intervals,
            continuous,
            hop,
            keep: exp(-rate * config.step_s * hop as f64),
            keep_sample: exp(-rate * config.step_s),
        })
    }

    fn cells(&self) -> usize {
        self.bank.cells().sizes().len()
    }

    /// A fresh state; the only place that allocates.
    pub(super) fn start(&self) -> Learnt {
        Learnt {
            recent: [Signals::default(); 2],
            sines: self.sines.start(),
            cells: Window::new(CELL_SIGNALS, self.cells()),
            cell: [0.0; CELL_SIGNALS],
            in_cell: 0,
            memory: Memory::new(self.cells()),
            until_hop: 0,
            until_clean: 0,
            verdict: Reason::Filling,
            unknowns: None,
            covariance: NormalMatrix::zeros(),
            echoes: vec![Residuals::zeros(); ECHOES],
            next_echo: 0,
            echoed: 0,
            coherent: [0.0; 2],
            former: [[0.0; 2]; 4],
            formers: 0,
            roughness: [0.0; 2],
            last_position_m: [0.0; 2],
            last_current_a: [0.0; 3],
            same: [0; 2],
        }
    }

    /// Whether a state, for instance one read from a file, has the shape that is needed.
    pub(super) fn accepts(&self, learnt: &Learnt) -> bool {
        self.sines.accepts(&learnt.sines)
            && learnt.cells.has_shape(CELL_SIGNALS, self.cells())
            && learnt.memory.has_shape(self.cells())
            && learnt.echoes.len() == ECHOES
            && learnt.next_echo < ECHOES
    }

    /// Takes a sample into the window, the one after so many since the last gap, and number `r` in its hop.
    fn push(&self, learnt: &mut Learnt, filled: u64, r: usize, signals: &Signals) {
        let [last, before] = learnt.recent;
        learnt.recent = [*signals, last];
        if filled >= 2 {
            let n = self.intervals as f64;
            let unit = if self.continuous { 1.0 / (12.0 * n) } else { 1.0 / (6.0 * n) };
            let mut x = [0.0; LANES];
            for axis in 0..2 {
                let [a, b, c] = [&before, &last, signals].map(|signals| signals.sample.position[axis]);
                // Second differences of the test function times the positions are second differences of these times it.
                x[axis] = ((c - b) - (b - a)) * n;
                let [a, b, c] = [&before, &last, signals].map(|signals| signals.rotating[axis]);
                x[2 + MAGNETS + axis] = (a + 10.0 * b + c) / (12.0 * n);
            }
            for k in 0..MAGNETS {
                x[2 + k] = unit * combined(k, self.continuous, [&before.sample, &last.sample, &signals.sample]);
            }
            self.sines.push(&mut learnt.sines, r, &x);
        }
        let [current, gap] = &signals.gain;
        for k in 0..MAGNETS {
            learnt.cell[k] += current[k] * current[k];
            learnt.cell[MAGNETS + k] += gap[k];
        }
        learnt.in_cell = learnt.in_cell.saturating_add(1);
        if self.bank.cells().ends(r) {
            let samples = f64::from(learnt.in_cell);
            learnt.cells.push(&learnt.cell.map(|sum| sum / samples));
            learnt.cell = [0.0; CELL_SIGNALS];
            learnt.in_cell = 0;
        }
    }
}

impl Estimator {
    /// Takes in one sample; what comes of it, or why the window has to start afresh.
    pub(super) fn learn(
        &self,
        state: &mut EstimatorState,
        least_squares: &LeastSquares,
        signals: &Signals,
        input: &EstimatorInput,
    ) -> Result<Reason, Reason> {
        let EstimatorState { samples, filled, learnt: Some(learnt), output, .. } = state else {
            return Err(Reason::ForeignState);
        };
        if watch(learnt, input, *filled, least_squares.keep_sample) {
            return Err(Reason::Stuck);
        }
        let (hop, window) = (least_squares.hop as u64, self.intervals as u64 + 1);
        if *filled == 0 {
            learnt.until_hop = window.max(self.samples_until_epsilon.saturating_sub(*samples)) - 1;
        }
        // Hops end with the samples after which the window is evaluated.
        let r = hop - 1 - learnt.until_hop % hop;
        least_squares.push(learnt, *filled, r as usize, signals);
        *filled = filled.saturating_add(1);
        *samples = samples.saturating_add(1);
        if *filled >= window && *samples >= self.samples_until_epsilon {
            learnt.until_clean = learnt.until_clean.saturating_sub(1);
        }
        if learnt.until_hop > 0 {
            learnt.until_hop -= 1;
            let full = *filled >= window && *samples >= self.samples_until_epsilon;
            return Ok(if full { learnt.verdict } else { Reason::Filling });
        }
        learnt.until_hop = hop - 1;
        let level = std::array::from_fn(|k| {
            let level = signals.sample.squares[0][k] * self.reach[k];
            level * level
        });
        let Some(verdict) = self.evaluate(least_squares, learnt, output, level, input.omega_rad_s) else {
            learnt.clear();
            return Err(Reason::BadSample);
        };
        learnt.verdict = verdict;
        Ok(verdict)
    }

    /// Evaluates the present window by least squares, together with those before. `None` if its numbers cannot be used.
    fn evaluate(
        &self,
        least_squares: &LeastSquares,
        learnt: &mut Learnt,
        output: &mut EstimatorOutput,
        level: [f64; MAGNETS],
        omega_rad_s: f64,
    ) -> Option<Reason> {
        let LeastSquares { bank, sines, keep, .. } = least_squares;
        let [first, second, third, ..] = self.column_scale;
        let columns = [first, second, third];
        // What noise does depends a little on λ; before anything is known the window itself says what it is.
        let plausible = |x: &NormalVector| (0..MAGNETS).all(|k| x[k] > 0.01 && x[k] < 100.0);
        let guess = learnt.unknowns.filter(plausible).unwrap_or(NormalVector::repeat(1.0));
        let integrals = sines.sums(&learnt.sines);
        let rows = bank.rows(&integrals, &self.column_scale);
        let noise = bank.noise(gains(&learnt.cells), columns, &self.direction);
        let mut sums = Sums::of(&rows, &self.direction, level, &noise, &guess);
        sums.shape = shape(&rows.position[0], &rows.position[1]);
        if !sums.is_below(SUM_LIMIT) {
            return None;
        }
        let raw = Equations::new(&sums.p, self.unknowns).solve(&sums.h);
        if let Some(raw) = raw {
            output.lambda_raw = self.lambda([raw[0], raw[1], raw[2]]);
            if learnt.unknowns.is_none() && plausible(&raw) {
                sums.trace = noise.trace(&raw);
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
        if self.contradicts(learnt, output, (&rows, &sums)) {
            learnt.forget();
            learnt.until_clean = self.intervals as u64;
        }
        if learnt.until_clean > 0 {
            self.doubt(output);
            return Some(Reason::Changed);
        }
        let guess = learnt.unknowns.or(raw).filter(plausible).unwrap_or(guess);
        let scale = std::array::from_fn(|k| columns[k] * guess[k]);
        let Learnt { cells, memory, .. } = &mut *learnt;
        let sensitivity = Sensitivity { gains: gains(cells), scale, direction: &self.direction };
        memory.add(bank, (&rows, &sums), *keep, &sensitivity);
        if let Some(x) = learnt.unknowns.or(raw) {
            listen(least_squares, learnt, &rows.left(&self.direction, &x), omega_rad_s * self.config.step_s);
        }
        let verdict = self.conclude(least_squares, learnt, output);
        if verdict == Reason::Valid {
            if let Some(unknowns) = learnt.unknowns {
                output.lambda_hat = self.lambda([unknowns[0], unknowns[1], unknowns[2]]);
                let [y, z, a, b, c, cos, sin] = bank.load(&integrals);
                let load = Integrals { position: [y, z], squares: [a, b, c], rotating: [cos, sin] };
                self.report(output, &load, &unknowns);
            }
        } else {
            self.doubt(output);
        }
        Some(verdict)
    }

    /// Whether the window is at odds with what was learnt before.
    fn contradicts(&self, learnt: &Learnt, output: &mut EstimatorOutput, (rows, sums): (&Rows, &Sums)) -> bool {
        let Some(x) = learnt.unknowns else { return false };
        let [position, current] = output.noise.map(|noise| noise * noise);
        let noise = position * sums.trace[0] + current * sums.trace[1];
        let uncertain = sums.p.dot(&learnt.covariance);
        let model = MODEL_RESIDUAL * MODEL_RESIDUAL * sums.square;
        let left = rows.left(&self.direction, &x).norm_squared();
        output.surprise = (left / (noise + uncertain + model)).min(RESIDUAL_CAP);
        output.surprise.is_nan() || output.surprise > CHANGE_LIMIT
    }

    /// Solves the normal equations of the memory, with the noise that it finds in them.
    fn conclude(&self, least_squares: &LeastSquares, learnt: &mut Learnt, output: &mut EstimatorOutput) -> Reason {
        let functions = least_squares.bank.functions();
        let hops_per_window = least_squares.intervals as f64 / least_squares.hop as f64;
        let memory = &learnt.memory;
        let sums = &memory.sums;
        let excited = (0..MAGNETS).all(|k| sums.p[(k, k)] > EXCITATION_FLOOR * EXCITATION_FLOOR * sums.level[k]);
        let given = [self.config.position_noise_m, self.config.current_noise_a].map(|noise| noise * noise);
        let [rough, weight] = learnt.roughness;
        let smooth = if weight > 0.0 { rough / weight } else { 0.0 };
        let mut variance = output.noise.map(|noise| noise * noise);
        variance[0] = if given[0] > 0.0 { given[0] } else { variance[0].min(smooth) };
        let mut equations = Equations::new(&sums.p, self.unknowns);
        let mut solution = (equations.solve(&sums.h), equations.inverse());
        // As many independent rows as there are in windows that do not overlap, and how far their sum of squares scatters.
        let [weight, weight2] = memory.weight;
        let windows = 1.0 + (weight * weight / weight2 - 1.0) / hops_per_window;
        let freedom = (2.0 * functions as f64 * windows - self.unknowns as f64).max(1.0);
        let scatter = (2.0 / freedom).sqrt();
        let mut compensate = variance;
        // The noise follows from the residual, the compensation from the noise; two rounds settle it.
        for round in 0..3 {
            let (Some(x), Some(inverse)) = solution else { break };
            let former = compensate;
            let rest = sums.rest(&x);
            let left: [f64; 2] =
                std::array::from_fn(|s| (sums.trace[s] - inverse.dot(&memory.score[s])).max(0.1 * sums.trace[s]));
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
            if round > 0 && compensate == former {
                break;
            }
            let (p, h) = sums.compensated(compensate);
            equations = Equations::new(&p, self.unknowns);
            solution = (equations.solve(&h), equations.inverse());
        }
        output.condition = equations.condition();
        let (Some(x), Some(inverse)) = solution else {
            return Reason::Singular;
        };
        if !variance.iter().chain(&compensate).all(|v| v.is_finite()) {
            return Reason::Singular;
        }
        output.noise = variance.map(f64::sqrt);
        output.residual = if sums.square > 0.0 { (sums.rest(&x) / sums.square).sqrt().min(RESIDUAL_CAP) } else { 1.0 };
        let hidden = self.config.method == Method::LeastSquares && is_round(sums.shape, sums.square);
        if !excited || output.condition > CONDITION_LIMIT || hidden {
            return Reason::Singular;
        }
        let followed = least_squares.bank.followed();
        let fed_back = inverse * fed_back(&x, followed * variance[0] * sums.trace[0]);
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
        let pairs_of_windows = pairs / hops_per_window;
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
}

/// Follows the roughness of the positions and whether they move at all. True if a sensor is stuck.
fn watch(learnt: &mut Learnt, input: &EstimatorInput, filled: u64, keep: f64) -> bool {
    let former = learnt.former;
    let now = input.position_m;
    if filled == 0 {
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
        learnt.roughness = learnt.roughness.map(|sum| sum * keep);
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

/// Compares what is left unexplained with what was left whole revolutions ago: noise has no memory, while what the model
/// lacks comes back. The rotor turns by `turn_rad` from sample to sample.
fn listen(least_squares: &LeastSquares, learnt: &mut Learnt, left: &Residuals, turn_rad: f64) {
    let window = least_squares.intervals as f64;
    let hop = least_squares.hop as f64;
    let revolution = TAU / turn_rad.abs();
    // Windows that far apart have no sample in common.
    let apart = (window / hop).ceil();
    let whole = ((window / revolution - 1e-3).ceil() * revolution / hop).round().max(apart);
    let lag = if whole < ECHOES as f64 { whole as usize } else { apart as usize };
    let keep = least_squares.keep;
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

/// `E[Σ w Dᵀ δN]` if the controller follows the noise of the positions, given what the noise that it follows contributes to
/// `Σ w |N|²`.
///
/// A controller takes noise n for motion and moves the rotor by −T n, T being the complementary sensitivity: D x then
/// contains −T n, and N contains n beside. Each of three magnets bears a third of that.
fn fed_back(x: &NormalVector, noise: f64) -> NormalVector {
    NormalVector::from_fn(|k, _| if k < MAGNETS { -noise / (MAGNETS as f64 * x[k]) } else { 0.0 })
}

/// The cells of the window.
fn gains(cells: &Window) -> Gains<'_> {
    Gains { current: std::array::from_fn(|k| cells.signal(k)), gap: std::array::from_fn(|k| cells.signal(MAGNETS + k)) }
}
