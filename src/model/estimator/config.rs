//! What the estimator is told and what it tells.

use std::fmt;

use libm::sin;
use serde::{Deserialize, Serialize};

use crate::model::{Checks, Invalid};

/// The shortest window, in sample times: the test functions need room for their three changes of sign.
pub const MIN_INTERVALS: f64 = 8.0;

/// The longest window, in sample times: memory grows in proportion, and rounding of the kernels with the cube.
pub const MAX_INTERVALS: f64 = 1.0e5;

/// The largest condition number with which an estimate counts as valid.
///
/// On the paper's orbit both axes have about 3, the z axis alone 17 to 32, both axes with the unbalance 40 to 80; on
/// a circular orbit, where the unbalance is not identifiable, imperfect tracking leaves 1300 to 2000. With sensor noise of
/// 0.1 µm and 10 mA the error of λ̂ is about 0.5 % at 45, 1.4 % at 120 and 4 % at 280.
pub const CONDITION_LIMIT: f64 = 60.0;

/// The largest residual with which an estimate counts as valid: beyond it the model explains less than three
/// quarters (in the mean square) of the motion that it is asked to explain.
pub const RESIDUAL_LIMIT: f64 = 0.5;

/// The largest standard deviation of a λ, relative to the λ, with which an estimate counts as valid.
pub const STD_LIMIT: f64 = 0.05;

/// The same for the paper's methods. Their standard deviation takes all that is left unexplained for one error in the worst
/// direction, which is about five times the error that it makes: in the paper's own simulation, where a perturbation of 2 N in
/// phase with the path costs 4.6 %, it is 20 %.
pub const PAPER_STD_LIMIT: f64 = 5.0 * STD_LIMIT;

/// Before so many windows without a common sample have passed, the residual of the paper's methods says nothing: the six
/// rows of the first one leave three degrees of freedom, and fit by chance what the model does not hold.
pub const PAPER_WINDOWS: u64 = 3;

/// The methods that know no unbalance presume that there is none, and it is the residual that shows if that is wrong. On a
/// circle it cannot: the force of an unbalance turns with the acceleration of the rotor, and looks like force constants that
/// are all too small or too large by the same part. `(a² − b²)/(a² + b²)` of the acceleration with the half-axes a and b must be at
/// least this; it is 0.69 on the paper's orbit and 0.1 where the half-axes differ by a tenth.
pub const ROUND_LIMIT: f64 = 0.1;

/// Upper end of [`EstimatorOutput::lambda_std`], in units of λ_0.
pub const STD_CAP: f64 = 1.0e3;

/// How many times more a window may contradict what was learnt before than noise explains.
pub const CHANGE_LIMIT: f64 = 4.0;

/// What the discretisation may be off by, relative: motions that noise does not hide are not trusted further than this.
pub const MODEL_STD: f64 = 1.0e-4;

/// As many samples of one position equal to the last bit, while others move, are a sensor that is stuck.
pub const STUCK_SAMPLES: u32 = 25;

/// The least variation of the magnets' `i²/gap²`, relative to its level, that counts as excitation; rounding makes
/// about 1e-15.
pub const EXCITATION_FLOOR: f64 = 1.0e-9;

/// The least |sin| of the angle between two magnets.
pub const LEAST_SINE_BETWEEN_MAGNETS: f64 = 1.0e-3;

/// Upper end of [`EstimatorOutput::residual`].
pub const RESIDUAL_CAP: f64 = 1.0e6;

/// How far `T_f/T_s` may be from a whole number, relative.
pub(super) const WHOLE_NUMBER_TOLERANCE: f64 = 1.0e-6;

/// Filtered quantities beyond this come from samples that no bearing makes, and their products could overflow.
pub(super) const CHANNEL_LIMIT: f64 = 1.0e150;

/// How λ is computed from the windows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// P(20) to the letter, `F(n_i)/F(d)` with signed Cramer numerators and determinant of the z axis.
    ///
    /// `d` changes sign twice per revolution and nearly cancels in the mean, so this diverges; it is here to be
    /// compared with. Its values are shown as they are, valid or not, and no residual makes them invalid.
    PaperLiteral,
    /// P(20) with the signs aligned first, `F(n_i sign d)/F(|d|)`: what reproduces the paper.
    Paper,
    /// Both axes, weighted least squares over all windows remembered, noise in the regressors compensated.
    LeastSquares,
    /// As `LeastSquares`, with the unbalance identified as well: two more unknowns `U cos φ`, `U sin φ`.
    #[default]
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
    /// ω_n of F(s) in P(20), rad/s. The methods of least squares forget with the rate `γ = ω_n/(2 ζ)` instead, which has
    /// the same mean age of the data, `2 ζ/ω_n`.
    pub filter_omega_rad_s: f64,
    /// ζ of F(s) in P(20).
    pub filter_zeta: f64,
    /// Standard deviation σ_z of the noise of a position, m; 0 if it is to be found from the data.
    pub position_noise_m: f64,
    /// Standard deviation σ_i of the noise of a current, A; 0 if it is to be found from the data.
    pub current_noise_a: f64,
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
            position_noise_m: 0.0,
            current_noise_a: 0.0,
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
    /// Whether the rotor touches something beside the magnets: samples are of no use meanwhile.
    pub contact: bool,
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
    /// The rotor touches something: the window starts afresh.
    Contact,
    /// A position has read the same to the last bit for [`STUCK_SAMPLES`] samples: the window starts afresh.
    Stuck,
    /// The latest windows contradict those before: what was learnt is forgotten, and learnt anew.
    Changed,
    /// The excitation does not tell the unknowns apart: see [`CONDITION_LIMIT`], [`EXCITATION_FLOOR`] and, where the
    /// unbalance is none of the unknowns, [`ROUND_LIMIT`].
    Singular,
    /// A magnet constant came out zero or negative, which a magnet cannot have.
    NotPositive,
    /// The model does not explain the motion: see [`RESIDUAL_LIMIT`].
    Unexplained,
    /// A standard deviation is too large for the estimate to be of use: see [`STD_LIMIT`] and [`PAPER_STD_LIMIT`].
    Uncertain,
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
            Reason::Contact => "not valid: the rotor is in contact; the window starts afresh",
            Reason::Stuck => "not valid: a position sensor reads the same all the time; the window starts afresh",
            Reason::Changed => "not valid: the latest samples contradict those before; learning anew",
            Reason::Uncertain => "not valid: the standard deviation is too large",
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
    /// Standard deviation of `lambda_hat`, N·m²/A²; λ_0 before there is one, and at most [`STD_CAP`] times λ_0. While the estimate
    /// is not valid it includes how far `lambda_raw` is from `lambda_hat`.
    pub lambda_std: [f64; 3],
    /// Whether `lambda_hat` was identified with this sample; `reason == Reason::Valid`. False while disabled: the
    /// estimate held then is as old as the last sample.
    pub valid: bool,
    /// Why.
    pub reason: Reason,
    /// Condition number of the filtered, scaled D of the rows that the method uses (the square root of that of
    /// `F(DᵀD)`), dimensionless; [`CONDITION_CAP`](crate::model::regression::CONDITION_CAP) if singular, and before the first full window.
    pub condition: f64,
    /// `√(F(|N − D Λ̂|²)/F(|N|²))`, dimensionless: the part of the motion that the model leaves unexplained. 1 before
    /// the first full window and without motion, at most [`RESIDUAL_CAP`]. Rounding leaves about 1e-7.
    pub residual: f64,
    /// det D of the z axis of the present window, rows and columns scaled as the module says, m³; 0 at first, and always
    /// with the methods of least squares.
    pub determinant: f64,
    /// Static load (p_y, p_z) over the present window, N (method section 6), weighted with `τ³(1 − τ)³`; 0 at first,
    /// then the value with the last valid estimate.
    pub load_n: [f64; 2],
    /// Magnitude U of the unbalance, kg·m; 0 unless [`Method::Unbalance`] has identified it.
    pub unbalance_kg_m: f64,
    /// Phase φ of the unbalance, rad in (−π, π]: the force on the rotor is `U ω² (cos(θ + φ), sin(θ + φ))`.
    pub unbalance_phase_rad: f64,
    /// Standard deviations of the noise of a position, m, and of a current, A, that `lambda_std` rests on: as given, or as
    /// found. What the model leaves unexplained counts as noise of the currents where that is not given.
    pub noise: [f64; 2],
    /// `|N − D Λ̂|²` of the last window over what the noise explains, dimensionless, about one: what [`CHANGE_LIMIT`] is for.
    pub surprise: f64,
}

pub(super) fn check(config: &EstimatorConfig) -> Result<(), Vec<Invalid>> {
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
    checks.not_negative("sensor.positionNoise", config.position_noise_m, "m");
    checks.not_negative("sensor.currentNoise", config.current_noise_a, "A");
    checks.finish()
}
