//! The reference trajectory of the rotor: the flat output and its derivatives.
//!
//! # Start
//!
//! Where the rotor starts away from the reference trajectory, for instance on the backup bearing, a transition brings it there
//! without jumps:
//!
//! ```text
//! X*(t) = (1 − σ(t/lift)) X_0 + σ((t − start)/ramp) curve(θ)      σ(τ) = 10τ³ − 15τ⁴ + 6τ⁵, 0 before, 1 after
//! ```
//!
//! with `X_0` the first measured position and t the time since then. A lift of 0 omits the first term, a ramp of 0 is a step;
//! with start, ramp and lift of 0, `X*` is the curve itself.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use crate::bearing::magnet::MagnetsOf;
use crate::control::observer::{Signal, SignalObserver};
use crate::invalid::{Checks, Invalid, Short};
use crate::machine::Machine;
use crate::variables::unit::{METRE, RADIAN_PER_SECOND, SECOND};
use crate::variables::{Choice, Variables};

/// The most lobes of a curve; no sample time in use resolves more.
pub const MOST_LOBES: i32 = 1000;

/// The number of harmonics of [`Contour`].
pub const HARMONICS: usize = 8;

/// A closed curve as a Fourier series, n from 1 to [`HARMONICS`]:
/// `Y* = y_0 + Σ (cosY_n cos nθ + sinY_n sin nθ)`, `Z*` alike, all in m.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
#[serde(default)]
pub struct Contour {
    /// Mean of the reference trajectory along {axis} with shape = fourier
    #[parameter(names = context.of_resultant("centre"), count = context.resultant.len(), unit = METRE, nominal = 1e-5)]
    pub centre_m: [f64; 2],
    /// Cosine of harmonic {k} of the reference trajectory along {first axis} with shape = fourier
    #[parameter(name = format!("cos{}", context.resultant[0]), unit = METRE, nominal = 1e-5)]
    pub cos_y_m: [f64; HARMONICS],
    /// Sine of harmonic {k} of the reference trajectory along {first axis} with shape = fourier
    #[parameter(name = format!("sin{}", context.resultant[0]), unit = METRE, nominal = 1e-5)]
    pub sin_y_m: [f64; HARMONICS],
    /// Cosine of harmonic {k} of the reference trajectory along z with shape = fourier
    #[parameter(name = "cosZ", count = if context.is_planar() { HARMONICS } else { 0 }, unit = METRE, nominal = 1e-5)]
    pub cos_z_m: [f64; HARMONICS],
    /// Sine of harmonic {k} of the reference trajectory along z with shape = fourier
    #[parameter(name = "sinZ", count = if context.is_planar() { HARMONICS } else { 0 }, unit = METRE, nominal = 1e-5)]
    pub sin_z_m: [f64; HARMONICS],
}

impl Contour {
    /// `[value, d/dθ, d²/dθ²]`, in m, of the axes (y, z) at the angle θ in rad.
    pub fn at(&self, theta_rad: f64) -> [[f64; 3]; 2] {
        let axis = |mean: f64, cos_m: &[f64; HARMONICS], sin_m: &[f64; HARMONICS]| {
            let mut sums = [mean, 0.0, 0.0];
            for (index, (a, b)) in cos_m.iter().zip(sin_m).enumerate() {
                let n = (index + 1) as f64;
                let (sin, cos) = (libm::sin(n * theta_rad), libm::cos(n * theta_rad));
                sums[0] += a * cos + b * sin;
                sums[1] += n * (b * cos - a * sin);
                sums[2] -= n * n * (a * cos + b * sin);
            }
            sums
        };
        [axis(self.centre_m[0], &self.cos_y_m, &self.sin_y_m), axis(self.centre_m[1], &self.cos_z_m, &self.sin_z_m)]
    }
}

/// Shape of the reference trajectory
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Choice)]
#[choice(name = "ReferenceShape")]
pub enum Shape {
    /// Ellipse with the semi-axes rY and rZ
    ///
    /// That of the paper: `Y* = r_Y cos θ`, `Z* = r_Z sin θ`.
    #[default]
    Ellipse,
    /// Ellipse with lobes
    ///
    /// `Y* = (r_Y + a cos nθ) cos θ`, `Z* = (r_Z + a cos nθ) sin θ`.
    Lobes,
    /// The inputs Yref and Zref
    External,
    /// A Fourier series with centre, cosY, sinY, cosZ, sinZ
    ///
    /// For holes of any shape.
    Fourier,
}

/// The reference trajectory.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
#[serde(default)]
pub struct ReferenceConfig {
    /// Shape of the reference trajectory
    #[parameter(name = "reference.shape")]
    pub shape: Shape,
    /// Semi-axis of the reference trajectory along {first axis}
    #[parameter(name = format!("reference.r{}", context.resultant[0]), unit = METRE, min = 0.0, nominal = 1e-5)]
    pub r_y_m: f64,
    /// Semi-axis of the reference trajectory along z
    #[parameter(name = "reference.rZ", count = usize::from(context.is_planar()), unit = METRE, min = 0.0, nominal = 1e-5)]
    pub r_z_m: f64,
    /// Number of lobes with shape = lobes
    #[parameter(name = "reference.lobes", count = usize::from(context.is_planar()), min = 0, max = MOST_LOBES)]
    pub lobes: i32,
    /// Amplitude of the lobes with shape = lobes
    ///
    /// A negative one rotates them by half a lobe.
    #[parameter(name = "reference.lobeAmplitude", count = usize::from(context.is_planar()), unit = METRE, nominal = 1e-5)]
    pub lobe_amplitude_m: f64,
    /// The curve of [`Shape::Fourier`].
    #[nested(prefix = "reference.")]
    pub contour: Contour,
    /// Begin of the motion.
    #[nested(prefix = "reference.", context = ())]
    pub transition: Transition,
    /// Poles of the observer that differentiates an external reference
    ///
    /// It tracks any reference that is not a cubic with a lag. For the paper's ellipse as external reference the tracking error
    /// is 1.9 µm at 3000 rpm and 0.03 µm at 1000 rpm with 2000 rad/s, and 0.45 µm at 3000 rpm with 4000 rad/s (tracking poles
    /// at 1000 rad/s, 10 kHz). Noise in the reference calls for a lower bandwidth.
    #[parameter(name = "bandwidth.reference", unit = RADIAN_PER_SECOND, min = 0.0, nominal = 1000.0, display_unit = "Hz")]
    pub bandwidth_rad_s: f64,
    /// Angular velocity on the curve, in rad/s; negative values run backwards.
    #[hidden]
    pub omega_rad_s: f64,
}

impl Default for ReferenceConfig {
    /// The paper's ellipse at 3000 rpm.
    fn default() -> Self {
        Self {
            shape: Shape::Ellipse,
            r_y_m: 30e-6,
            r_z_m: 70e-6,
            lobes: 3,
            lobe_amplitude_m: 0.0,
            contour: Contour::default(),
            transition: Transition::default(),
            omega_rad_s: 2.0 * PI * 50.0,
            bandwidth_rad_s: 4000.0,
        }
    }
}

/// One axis of the reference trajectory at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RefPoint {
    /// Position, in m.
    pub position_m: f64,
    /// Velocity, in m/s.
    pub velocity_m_s: f64,
    /// Acceleration, in m/s².
    pub acceleration_m_s2: f64,
}

impl RefPoint {
    /// The point times a varying factor: `[factor, its first, its second derivative with respect to time]`.
    fn grown(self, [s, s_1, s_2]: [f64; 3]) -> Self {
        let Self { position_m: x, velocity_m_s: v, acceleration_m_s2: a } = self;
        Self { position_m: s * x, velocity_m_s: s_1 * x + s * v, acceleration_m_s2: s_2 * x + 2.0 * s_1 * v + s * a }
    }

    /// The point plus the remaining part of the way from `first_m`, when the fraction `s` has been covered.
    fn from(self, first_m: f64, [s, s_1, s_2]: [f64; 3]) -> Self {
        Self {
            position_m: self.position_m + (1.0 - s) * first_m,
            velocity_m_s: self.velocity_m_s - s_1 * first_m,
            acceleration_m_s2: self.acceleration_m_s2 - s_2 * first_m,
        }
    }
}

/// `σ(t/length)` with its first and second derivative by t, in 1, 1/s, 1/s²: from 0 to 1, both derivatives 0 at the ends.
fn rise(t_s: f64, length_s: f64) -> [f64; 3] {
    if t_s < 0.0 {
        return [0.0; 3];
    }
    if t_s >= length_s {
        return [1.0, 0.0, 0.0];
    }
    let x = t_s / length_s;
    [
        x * x * x * (10.0 + x * (6.0 * x - 15.0)),
        30.0 * x * x * (1.0 - x) * (1.0 - x) / length_s,
        60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / (length_s * length_s),
    ]
}

/// The transition of the module: from the first measured position to the curve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[serde(default)]
pub struct Transition {
    /// Time after the first sample at which the reference trajectory begins to grow out of the centre
    #[parameter(name = "startTime", unit = SECOND, min = 0.0, nominal = 0.1, display_unit = "ms")]
    pub start_s: f64,
    /// Time in which the reference trajectory grows to its full size; 0 for a step
    #[parameter(name = "rampTime", unit = SECOND, min = 0.0, nominal = 0.1, display_unit = "ms")]
    pub ramp_s: f64,
    /// Time in which the rotor is brought from its first measured position to the centre; 0 for none
    #[parameter(name = "liftTime", unit = SECOND, min = 0.0, nominal = 0.1, display_unit = "ms")]
    pub lift_s: f64,
}

impl Transition {
    /// Reports errors in `checks`.
    pub(super) fn check(self, checks: &mut Checks) {
        checks.not_negative("reference.startTime", self.start_s, "s");
        checks.not_negative("reference.rampTime", self.ramp_s, "s");
        checks.not_negative("reference.liftTime", self.lift_s, "s");
    }

    /// The reference `t_s` after the first sample, at which the coordinates were `first`.
    pub(super) fn apply<const N: usize>(self, curve: [RefPoint; N], first: [f64; N], t_s: f64) -> [RefPoint; N] {
        let Self { start_s, ramp_s, lift_s } = self;
        if [start_s, ramp_s, lift_s] == [0.0; 3] {
            return curve;
        }
        let grown = rise(t_s - start_s, ramp_s);
        let left = if lift_s > 0.0 { rise(t_s, lift_s) } else { [1.0, 0.0, 0.0] };
        std::array::from_fn(|a| curve[a].grown(grown).from(first[a], left))
    }
}

/// The angle θ = ∫ω dt of a sampled reference, which starts at 0.
///
/// It is base + ω·(count · T_s), with a new base when ω changes, so that it does not drift.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Turning {
    /// Number of samples taken.
    samples: u64,
    /// θ at the sample at which ω changed last, in rad.
    base_rad: f64,
    /// Number of that sample.
    base_sample: u64,
    /// Angular velocity since then, in rad/s.
    omega_rad_s: f64,
    /// θ at the last sample, in rad.
    theta_rad: f64,
}

impl Turning {
    /// Before the first sample.
    pub fn start(omega_rad_s: f64) -> Self {
        Self { samples: 0, base_rad: 0.0, base_sample: 0, omega_rad_s, theta_rad: 0.0 }
    }

    /// Whether an angle, for instance one read from a file, is consistent: finite numbers, counts in order.
    pub fn is_consistent(&self) -> bool {
        self.base_sample <= self.samples
            && self.samples < u64::MAX
            && [self.base_rad, self.omega_rad_s, self.theta_rad].into_iter().all(f64::is_finite)
    }

    /// Moves on to the next sample; ω holds from this sample on.
    pub fn sample(&mut self, omega_rad_s: f64, step_s: f64) {
        let since_base_s = (self.samples - self.base_sample) as f64 * step_s;
        self.theta_rad = self.base_rad + self.omega_rad_s * since_base_s;
        if omega_rad_s != self.omega_rad_s {
            self.base_rad = self.theta_rad;
            self.base_sample = self.samples;
            self.omega_rad_s = omega_rad_s;
        }
        self.samples += 1;
    }

    /// Number of samples taken.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Angular velocity at the last sample, in rad/s.
    pub fn omega_rad_s(&self) -> f64 {
        self.omega_rad_s
    }

    /// θ a time after the last sample, in rad.
    pub fn ahead_rad(&self, ahead_s: f64) -> f64 {
        self.theta_rad + self.omega_rad_s * ahead_s
    }

    /// Time since the first sample, a time after the last one, in s.
    pub fn since_first_s(&self, ahead_s: f64, step_s: f64) -> f64 {
        (self.samples.max(1) - 1) as f64 * step_s + ahead_s
    }
}

/// The curve that a reference with N coordinates follows.
pub trait Curve<const N: usize> {
    /// Begin of the motion.
    fn transition(&self) -> Transition;

    /// Angular velocity before the first sample, in rad/s.
    fn omega_rad_s(&self) -> f64;

    /// The point at the angle θ in rad, at a constant angular velocity in rad/s, and at a time after the first sample in s.
    fn at(&self, theta_rad: f64, omega_rad_s: f64, t_s: f64) -> [RefPoint; N];
}

/// State of a [`Path`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound(
    serialize = "[f64; N]: Serialize, [Signal; N]: Serialize",
    deserialize = "[f64; N]: Deserialize<'de>, [Signal; N]: Deserialize<'de>"
))]
pub struct PathState<const N: usize> {
    /// θ.
    turning: Turning,
    /// Coordinates at the first sample, in m or rad.
    first: [f64; N],
    /// Estimate of the external reference of each coordinate at the last sample.
    signal: [Signal; N],
}

/// A validated reference, sampled at a fixed step: a curve and its begin, or an external one.
#[derive(Clone, Debug, PartialEq)]
pub struct Path<C, const N: usize> {
    curve: C,
    step_s: f64,
    /// The differentiator of an external reference.
    observer: Option<SignalObserver>,
}

impl<C: Curve<N>, const N: usize> Path<C, N> {
    /// That along a curve.
    pub(super) fn along(curve: C, step_s: f64) -> Self {
        Self { curve, step_s, observer: None }
    }

    /// The curve.
    pub fn curve(&self) -> &C {
        &self.curve
    }

    /// Whether the reference is external.
    pub fn is_external(&self) -> bool {
        self.observer.is_some()
    }

    /// Before the first sample: θ = 0, an external reference at rest.
    pub fn start(&self) -> PathState<N> {
        let turning = Turning::start(self.curve.omega_rad_s());
        PathState { turning, first: [0.0; N], signal: [Signal::default(); N] }
    }

    /// Whether a state, for instance one read from a file, is consistent: finite numbers, counts in order.
    pub fn accepts(&self, state: &PathState<N>) -> bool {
        let numbers = state.first.iter().chain(state.signal.iter().flat_map(|signal| &signal.0));
        state.turning.is_consistent() && numbers.copied().all(f64::is_finite)
    }

    /// Moves on to the next sample, at the measured coordinates; a lift begins at the first. `omega_rad_s` holds from this sample on, `external`
    /// is an external reference at it.
    ///
    /// An external reference starts at rest at its first sample.
    pub fn sample(&self, state: &mut PathState<N>, omega_rad_s: f64, coordinates: [f64; N], external: [f64; N]) {
        let first = state.turning.samples() == 0;
        if first {
            state.first = coordinates;
        }
        state.turning.sample(omega_rad_s, self.step_s);
        if let Some(observer) = &self.observer {
            for (signal, value) in state.signal.iter_mut().zip(external) {
                *signal = if first { Signal([value, 0.0, 0.0, 0.0]) } else { observer.update(*signal, value) };
            }
        }
    }

    /// The reference `ahead_s` after the last sample, in s.
    ///
    /// An external reference is extrapolated with the derivatives that its observer estimates.
    pub fn ahead(&self, state: &PathState<N>, ahead_s: f64) -> [RefPoint; N] {
        if self.is_external() {
            return state.signal.map(|signal| {
                let [position_m, velocity_m_s, acceleration_m_s2, _] = signal.ahead(ahead_s).0;
                RefPoint { position_m, velocity_m_s, acceleration_m_s2 }
            });
        }
        let t_s = state.turning.since_first_s(ahead_s, self.step_s);
        let curve = self.curve.at(state.turning.ahead_rad(ahead_s), state.turning.omega_rad_s(), t_s);
        self.curve.transition().apply(curve, state.first, t_s)
    }

    /// θ at the last sample, in rad.
    pub fn theta_rad(&self, state: &PathState<N>) -> f64 {
        state.turning.ahead_rad(0.0)
    }
}

/// The reference of a rotor in one bearing.
pub type Reference<const N: usize = 2> = Path<ReferenceConfig, N>;

impl<const N: usize> Reference<N> {
    /// A reference sampled every `step_s` (finite, above 0), for a rotor between `magnets`.
    ///
    /// `reference.rY`, `reference.rZ` if they are below 0, `reference.lobes` above [`MOST_LOBES`], `bandwidth.reference` unless
    /// above 0; all of these and `reference.lobeAmplitude`, `reference.omega` if they are not finite; `reference.rY` and others
    /// if the reference trajectory touches a magnet.
    pub fn new<const K: usize>(
        config: ReferenceConfig,
        step_s: f64,
        magnets: &MagnetsOf<N, K>,
    ) -> Result<Self, Vec<Invalid>> {
        let mut checks = Checks::default();
        let reference = Self::checked(config, step_s, magnets, &mut checks);
        checks.finish()?;
        Ok(reference)
    }

    /// Reports errors in `checks`; use the returned value only if there are none.
    pub(crate) fn checked<const K: usize>(
        config: ReferenceConfig,
        step_s: f64,
        magnets: &MagnetsOf<N, K>,
        checks: &mut Checks,
    ) -> Self {
        checks.not_negative(along_first::<N>("reference.r"), config.r_y_m, "m");
        checks.not_negative("reference.rZ", config.r_z_m, "m");
        checks.require(
            (0..=MOST_LOBES).contains(&config.lobes),
            "reference.lobes",
            config.lobes,
            format!("a number from 0 to {MOST_LOBES}"),
        );
        checks.finite("reference.lobeAmplitude", config.lobe_amplitude_m, "m");
        config.transition.check(checks);
        check_contour::<N>(&config.contour, checks);
        checks.finite("reference.omega", config.omega_rad_s, "rad/s");
        checks.positive("bandwidth.reference", config.bandwidth_rad_s, "rad/s");
        check_reach(&config, magnets, checks);
        let external = config.shape == Shape::External;
        let observer = external.then(|| SignalObserver::new(config.bandwidth_rad_s, step_s));
        Self { curve: config, step_s, observer }
    }
}

impl ReferenceConfig {
    /// The curve, (y, z), at the angle `theta_rad` and the constant angular velocity `omega_rad_s`.
    ///
    /// `Y* = (r_Y + a cos nθ) cos θ`, `Z* = (r_Z + a cos nθ) sin θ`, with exact derivatives; an ellipse has a = 0. An external
    /// reference has no such points: it returns those of the ellipse. For a Fourier series see [`Contour::at`].
    pub fn point(&self, theta_rad: f64, omega_rad_s: f64) -> [RefPoint; 2] {
        if self.shape == Shape::Fourier {
            return self.contour.at(theta_rad).map(|[x, x_1, x_2]| RefPoint {
                position_m: x,
                velocity_m_s: omega_rad_s * x_1,
                acceleration_m_s2: omega_rad_s * omega_rad_s * x_2,
            });
        }
        let (sin, cos) = libm::sincos(theta_rad);
        let (a, n) = match self.shape {
            Shape::Lobes => (self.lobe_amplitude_m, f64::from(self.lobes)),
            Shape::Ellipse | Shape::External | Shape::Fourier => (0.0, 0.0),
        };
        // sin(±0) = ±0.
        let (sin_n, cos_n) = if n == 0.0 { (n * theta_rad, 1.0) } else { libm::sincos(n * theta_rad) };
        // The radius r + a cos nθ, its first and second derivative with respect to θ.
        let [r_1, r_2] = [-a * n * sin_n, -a * n * n * cos_n];
        let r_y = self.r_y_m + a * cos_n;
        let r_z = self.r_z_m + a * cos_n;
        let omega_2 = omega_rad_s * omega_rad_s;
        [
            RefPoint {
                position_m: r_y * cos,
                velocity_m_s: omega_rad_s * (r_1 * cos - r_y * sin),
                acceleration_m_s2: omega_2 * (r_2 * cos - 2.0 * r_1 * sin - r_y * cos),
            },
            RefPoint {
                position_m: r_z * sin,
                velocity_m_s: omega_rad_s * (r_1 * sin + r_z * cos),
                acceleration_m_s2: omega_2 * (r_2 * sin + 2.0 * r_1 * cos - r_z * sin),
            },
        ]
    }
}

/// A rotor that is held along one axis follows the first axis of the curve.
impl<const N: usize> Curve<N> for ReferenceConfig {
    fn transition(&self) -> Transition {
        self.transition
    }

    fn omega_rad_s(&self) -> f64 {
        self.omega_rad_s
    }

    fn at(&self, theta_rad: f64, omega_rad_s: f64, _: f64) -> [RefPoint; N] {
        let curve = self.point(theta_rad, omega_rad_s);
        std::array::from_fn(|n| curve[n])
    }
}

/// Refuses a curve that may touch a magnet.
fn check_reach<const N: usize, const K: usize>(
    config: &ReferenceConfig,
    magnets: &MagnetsOf<N, K>,
    checks: &mut Checks,
) {
    let lobes_m = match config.shape {
        Shape::External => return,
        Shape::Fourier => return check_contour_reach(&config.contour, magnets, checks),
        Shape::Ellipse => 0.0,
        Shape::Lobes => config.lobe_amplitude_m,
    };
    check_ellipse_reach([config.r_y_m, config.r_z_m], lobes_m, magnets, checks);
}

/// Refuses an ellipse with lobes that may touch a magnet.
///
/// Towards the direction e the ellipse extends to `√((r_Y e_y)² + (r_Z e_z)²)`, the lobes at most `|a|` further.
pub(super) fn check_ellipse_reach<const N: usize, const K: usize>(
    [r_y, r_z]: [f64; 2],
    lobes_m: f64,
    magnets: &MagnetsOf<N, K>,
    checks: &mut Checks,
) {
    let a = lobes_m.abs();
    let s = magnets.gap_m();
    // Do not report again the consequences of a refused value.
    if ![r_y, r_z, a, s].iter().all(|value| value.is_finite() && *value >= 0.0) || s == 0.0 {
        return;
    }
    for (k, e_k) in magnets.directions().into_iter().enumerate() {
        let [y, z] = [r_y * e_k[0], if N == 2 { r_z * e_k[1] } else { 0.0 }];
        let reach = (y * y + z * z).sqrt() + a;
        if reach >= s {
            let (name, value) = if a >= y.abs() && a >= z.abs() {
                ("reference.lobeAmplitude".to_owned(), lobes_m)
            } else if y.abs() >= z.abs() {
                (along_first::<N>("reference.r"), r_y)
            } else {
                ("reference.rZ".to_owned(), r_z)
            };
            let number = k + 1;
            checks.require(
                false,
                name,
                format_args!("{value} m"),
                format!(
                    "a reference trajectory that does not touch magnet {number} (it extends to {} m, the gap is {} m)",
                    Short(reach),
                    Short(s)
                ),
            );
            return;
        }
    }
}

/// The name of what belongs to the first axis: y, or x along the axis.
fn along_first<const N: usize>(name: &str) -> String {
    format!("{name}{}", if N == 1 { "X" } else { "Y" })
}

/// The arrays of a contour with their names in the interface.
fn coefficients<const N: usize>(contour: &Contour) -> [(String, &[f64; HARMONICS]); 4] {
    [
        (along_first::<N>("reference.cos"), &contour.cos_y_m),
        (along_first::<N>("reference.sin"), &contour.sin_y_m),
        ("reference.cosZ".to_owned(), &contour.cos_z_m),
        ("reference.sinZ".to_owned(), &contour.sin_z_m),
    ]
}

fn check_contour<const N: usize>(contour: &Contour, checks: &mut Checks) {
    let centres = [along_first::<N>("reference.centre"), "reference.centreZ".to_owned()];
    for (name, value) in centres.into_iter().zip(contour.centre_m) {
        checks.finite(name, value, "m");
    }
    for (name, values) in coefficients::<N>(contour) {
        for (index, value) in values.iter().enumerate() {
            checks.finite(format!("{name}[{}]", index + 1), *value, "m");
        }
    }
}

/// Refuses a contour that touches a magnet at one of these angles, 45 per shortest wave; the finding names the largest
/// coefficient.
fn check_contour_reach<const N: usize, const K: usize>(
    contour: &Contour,
    magnets: &MagnetsOf<N, K>,
    checks: &mut Checks,
) {
    const ANGLES: usize = 45 * HARMONICS;
    let mut least = (f64::INFINITY, 0);
    for index in 0..ANGLES {
        let theta_rad = 2.0 * PI * index as f64 / ANGLES as f64;
        let point = contour.at(theta_rad);
        let position_m = std::array::from_fn(|n| point[n][0]);
        for (k, gap) in magnets.gaps(position_m).into_iter().enumerate() {
            if gap < least.0 {
                least = (gap, k + 1);
            }
        }
    }
    let mut largest = (along_first::<N>("reference.centre"), contour.centre_m[0]);
    for (name, values) in coefficients::<N>(contour) {
        for (index, value) in values.iter().enumerate() {
            if value.abs() > largest.1.abs() {
                largest = (format!("{name}[{}]", index + 1), *value);
            }
        }
    }
    let (gap, number) = least;
    checks.require(
        gap > 0.0 || gap.is_infinite(),
        largest.0,
        format_args!("{} m", largest.1),
        format!("a reference trajectory that does not touch magnet {number} (the least gap would be {} m)", Short(gap)),
    );
}
