//! The reference trajectory of the rotor: the flat output and its derivatives.
//!
//! # Start
//!
//! If the rotor starts away from the reference trajectory, for instance on the backup bearing, a transition leads it there without
//! jumps:
//!
//! ```text
//! X*(t) = (1 − σ(t/lift)) X_0 + σ((t − start)/ramp) curve(θ)      σ(τ) = 10τ³ − 15τ⁴ + 6τ⁵, 0 before, 1 after
//! ```
//!
//! with the first measured position `X_0` and the time t since then. A lift of 0 omits the first term, a ramp of 0 is a step; with
//! start, ramp and lift 0, `X*` is the curve itself.
//!
//! # Several bearings
//!
//! A shaft that tilts follows an ellipse in each radial bearing, with the angle θ of the reference, and a sine in an axial bearing:
//!
//! ```text
//! Y* = r_Y cos(θ + φ)     Z* = r_Z sin(θ + φ)          at the magnets of A and B, each with its own r_Y, r_Z, φ
//! X* = a sin(2π f t)                                   t since the first sample
//! ```
//!
//! Equal phases give cylindrical motion, opposite phases conical motion. The coordinates are linear in the displacements at the
//! bearings, so the lateral ones are `c cos θ + s sin θ` with constant c and s.

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};

use crate::bearing::magnet::Magnets;
use crate::bearing::shaft::has_x;
use crate::bearing::{Rotor, array};
use crate::control::observer::{Signal, SignalObserver, ahead};
use crate::control::phase::Phase;
use crate::invalid::{Checks, Short};
use crate::machine::{Bearing, Machine};
use crate::variables::unit::{HERTZ, METRE, RADIAN, RADIAN_PER_SECOND, SECOND};
use crate::variables::{Choice, Saved, Variables, numbers};

/// The most lobes of a curve; no practical sample time resolves more.
pub const MOST_LOBES: i32 = 1000;

/// Number of harmonics of a [`Contour`].
pub const HARMONICS: usize = 8;

/// A closed curve as a Fourier series, n from 1 to [`HARMONICS`]:
/// `Y* = y_0 + Σ (cosY_n cos nθ + sinY_n sin nθ)`, `Z*` likewise, all in m.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
pub struct Contour {
    /// Mean of the reference trajectory along {axis} with shape = fourier
    #[parameter(names = context.of_resultant("centre"), unit = METRE, nominal = 1e-5)]
    pub centre_m: [f64; 2],
    /// Cosine of harmonic {k} of the reference trajectory along {first axis} with shape = fourier
    #[parameter(name = format!("cos{}", context.coordinates[0].position), unit = METRE, nominal = 1e-5)]
    pub cos_y_m: [f64; HARMONICS],
    /// Sine of harmonic {k} of the reference trajectory along {first axis} with shape = fourier
    #[parameter(name = format!("sin{}", context.coordinates[0].position), unit = METRE, nominal = 1e-5)]
    pub sin_y_m: [f64; HARMONICS],
    /// Cosine of harmonic {k} of the reference trajectory along z with shape = fourier
    #[parameter(name = "cosZ", count = if context.is_planar() { HARMONICS } else { 0 }, unit = METRE, nominal = 1e-5)]
    pub cos_z_m: [f64; HARMONICS],
    /// Sine of harmonic {k} of the reference trajectory along z with shape = fourier
    #[parameter(name = "sinZ", count = if context.is_planar() { HARMONICS } else { 0 }, unit = METRE, nominal = 1e-5)]
    pub sin_z_m: [f64; HARMONICS],
}

impl Contour {
    /// `[value, d/dθ, d²/dθ²]`, in m, for the axes (y, z) at the angle θ in rad.
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

/// Ellipse in a radial bearing, semi-axis in a single axial bearing, or sine in an axial bearing beside others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Bearing)]
pub struct PathConfig {
    /// Semi-axis of the reference trajectory along {first axis}{at the magnets of bearing}
    #[parameter(
        name = format!("reference.r{}", context.first_axis().to_uppercase()), count = context.if_radial().max(usize::from(context.is_alone())),
        unit = METRE, min = 0.0, nominal = 1e-5
    )]
    pub r_y_m: f64,
    /// Semi-axis of the reference trajectory along z{at the magnets of bearing}
    #[parameter(name = "reference.rZ", count = context.if_radial(), unit = METRE, min = 0.0, nominal = 1e-5)]
    pub r_z_m: f64,
    /// Phase of the reference trajectory in bearing {prefix}
    #[parameter(name = "reference.phase", count = context.if_placed(), unit = RADIAN)]
    pub phase_rad: f64,
    /// Amplitude of the axial reference, a sine
    #[parameter(name = "reference.amplitude", count = context.if_beside(), unit = METRE, min = 0.0, nominal = 1e-5)]
    pub amplitude_m: f64,
    /// Frequency of the axial reference
    #[parameter(name = "reference.frequency", count = context.if_beside(), unit = HERTZ, min = 0.0, nominal = 100.0)]
    pub frequency_hz: f64,
}

impl PathConfig {
    /// c and s of the ellipse `c cos θ + s sin θ`, (y, z) in m.
    fn waves(&self) -> [[f64; 2]; 2] {
        let (sin, cos) = libm::sincos(self.phase_rad);
        [[self.r_y_m * cos, self.r_z_m * sin], [-self.r_y_m * sin, self.r_z_m * cos]]
    }

    /// The axial sine at a time in s.
    fn axial(&self, t_s: f64) -> RefPoint {
        let (a, f) = (self.amplitude_m, self.frequency_hz);
        if a == 0.0 {
            return [0.0; 3];
        }
        let rate = TAU * f;
        let revolutions = f * t_s;
        let (sin, cos) = libm::sincos(TAU * (revolutions - libm::floor(revolutions)));
        [a * sin, a * rate * cos, -a * rate * rate * sin]
    }
}

/// The reference trajectory of a rotor in B bearings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Variables)]
#[variables(context = Machine, default)]
#[serde(bound = "[PathConfig; B]: Saved")]
pub struct ReferenceConfig<const B: usize = 1> {
    /// Shape of the reference trajectory
    #[parameter(name = "reference.shape", count = context.if_single(1))]
    pub shape: Shape,
    /// Path in each bearing.
    #[nested(prefixes = context.of_bearings(""), context = context.bearings[index])]
    pub paths: [PathConfig; B],
    /// Number of lobes with shape = lobes
    #[parameter(name = "reference.lobes", count = usize::from(context.is_planar()), min = 0, max = MOST_LOBES, value = 3)]
    pub lobes: i32,
    /// Amplitude of the lobes with shape = lobes
    ///
    /// A negative amplitude rotates the lobes by half a lobe.
    #[parameter(name = "reference.lobeAmplitude", count = usize::from(context.is_planar()), unit = METRE, nominal = 1e-5)]
    pub lobe_amplitude_m: f64,
    /// The curve of [`Shape::Fourier`].
    #[nested(prefix = "reference.", count = context.if_single(1))]
    pub contour: Contour,
    /// Transition from the start to the reference trajectory.
    #[nested(prefix = "reference.", context = ())]
    pub transition: Transition,
    /// Poles of the observer that differentiates an external reference
    ///
    /// It tracks all references except cubics with a lag. With the paper's ellipse as external reference the tracking error is
    /// 1.9 µm at 3000 rpm and 0.03 µm at 1000 rpm with 2000 rad/s, and 0.45 µm at 3000 rpm with 4000 rad/s (tracking poles at
    /// 1000 rad/s, 10 kHz). A noisy reference requires a lower bandwidth.
    #[parameter(
        name = "bandwidth.reference", count = context.if_single(1), unit = RADIAN_PER_SECOND, above = 0.0, nominal = 1000.0,
        display_unit = "Hz", value = 4000.0
    )]
    pub bandwidth_rad_s: f64,
}

impl<const B: usize> ReferenceConfig<B> {
    /// The paper's ellipse at 3000 rpm in every radial bearing, in phase, without axial motion.
    pub fn of(machine: &Machine) -> Self {
        let path = |b: usize| match machine.bearings[b].is_radial {
            true => PathConfig { r_y_m: 30e-6, r_z_m: 70e-6, ..PathConfig::default() },
            false => PathConfig { frequency_hz: 60.0, ..PathConfig::default() },
        };
        Self { paths: array::from_fn(path), ..Self::default() }
    }
}

/// One coordinate of the reference trajectory at one instant: `[x, x', x'']` in `[m, m/s, m/s²]`, or `[rad, rad/s, rad/s²]`.
pub type RefPoint = [f64; 3];

/// A point times a factor s(t), given with its first and second time derivative.
fn scaled([x, v, a]: RefPoint, [s, s_1, s_2]: [f64; 3]) -> RefPoint {
    [s * x, s_1 * x + s * v, s_2 * x + 2.0 * s_1 * v + s * a]
}

/// A point plus `(1 − s(t)) first`, with s and its time derivatives.
fn offset([x, v, a]: RefPoint, first: f64, [s, s_1, s_2]: [f64; 3]) -> RefPoint {
    [x + (1.0 - s) * first, v - s_1 * first, a - s_2 * first]
}

/// `σ(t/length)` and its first and second derivative by t, in 1, 1/s, 1/s²: from 0 to 1, both derivatives 0 at the ends.
fn smooth_step(t_s: f64, length_s: f64) -> [f64; 3] {
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

/// The transition from the first measured position to the curve, see the module.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
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
    /// The reference at the time `t_s` after the first sample, at which the coordinates were `first`.
    pub(super) fn apply<const N: usize>(self, curve: [RefPoint; N], first: [f64; N], t_s: f64) -> [RefPoint; N] {
        let Self { start_s, ramp_s, lift_s } = self;
        if [start_s, ramp_s, lift_s] == [0.0; 3] {
            return curve;
        }
        let growth = smooth_step(t_s - start_s, ramp_s);
        let lift = if lift_s > 0.0 { smooth_step(t_s, lift_s) } else { [1.0, 0.0, 0.0] };
        array::from_fn(|a| offset(scaled(curve[a], growth), first[a], lift))
    }
}

/// State of a [`Reference`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "[f64; N]: Saved, [Signal; N]: Saved")]
pub struct ReferenceState<const N: usize> {
    /// Number of samples taken.
    samples: u64,
    /// θ = ∫ω dt, from 0 at the start, in rad.
    angle: Phase,
    /// Coordinates at the first sample, in m or rad.
    first: [f64; N],
    /// Estimate of the external reference of each coordinate at the last sample.
    signal: [Signal; N],
}

impl<const N: usize> ReferenceState<N> {
    /// Number of the last sample, from 0.
    fn last_sample(&self) -> u64 {
        self.samples.max(1) - 1
    }

    /// Whether the counts, for instance of a state read from a file, are consistent.
    pub(super) fn is_in_order(&self) -> bool {
        self.samples < u64::MAX && self.angle.is_in_order(self.samples)
    }
}

/// A validated reference, sampled at a fixed step: a curve with its transition, or an external signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference<const N: usize = 2, const B: usize = 1> {
    config: ReferenceConfig<B>,
    step_s: f64,
    /// c and s of a tilting shaft's coordinates `c cos θ + s sin θ`, in m and rad.
    waves: [[f64; N]; 2],
    /// The differentiator of an external reference.
    observer: Option<SignalObserver>,
}

impl<const N: usize, const B: usize> Reference<N, B> {
    /// A reference sampled every `step_s` (finite, above 0), for numbers within their limits; valid only if `checks` finds nothing.
    ///
    /// It finds `X.reference.frequency` above half the sample rate; `reference.rY` or another parameter of the curve if the reference
    /// trajectory touches a magnet.
    pub fn checked<const K: usize>(
        config: ReferenceConfig<B>,
        step_s: f64,
        rotor: &Rotor<N, K, B>,
        checks: &mut Checks,
    ) -> Self {
        let machine = Rotor::<N, K, B>::MACHINE;
        for ((bearing, path), magnets) in machine.bearings.iter().zip(&config.paths).zip(rotor.bearings()) {
            checks.of(bearing.prefix, |checks| match config.shape {
                _ if bearing.if_beside() == 1 => check_sine(path, step_s, magnets, checks),
                Shape::External => (),
                Shape::Fourier => check_contour(&config.contour, machine, magnets, checks),
                Shape::Ellipse => check_ellipse(path, 0.0, bearing, magnets, checks),
                Shape::Lobes => check_ellipse(path, config.lobe_amplitude_m, bearing, magnets, checks),
            });
        }
        let external = config.shape == Shape::External;
        let observer = external.then(|| SignalObserver::new(config.bandwidth_rad_s, step_s));
        let wave = |part: usize| {
            // At the magnets of A and B, without axial motion.
            let at = |n: usize| if machine.tilts() && n < 4 { config.paths[n / 2].waves()[part][n % 2] } else { 0.0 };
            rotor.through(array::from_fn(at), |bearing| bearing.position_m)
        };
        Self { waves: array::from_fn(wave), config, step_s, observer }
    }

    /// Whether the reference is external.
    pub fn is_external(&self) -> bool {
        self.observer.is_some()
    }

    /// The state before the first sample: θ = 0, an external reference at rest.
    pub fn start(&self) -> ReferenceState<N> {
        ReferenceState { samples: 0, angle: Phase::default(), first: [0.0; N], signal: [[0.0; 4]; N] }
    }

    /// Advances to the next sample, at the measured coordinates; a lift begins at those of the first sample. `omega_rad_s` applies from
    /// this sample on; `external` is the external reference at this sample, assumed at rest at the first.
    pub fn sample(&self, state: &mut ReferenceState<N>, omega_rad_s: f64, coordinates: [f64; N], external: [f64; N]) {
        let first = state.samples == 0;
        if first {
            state.first = coordinates;
        }
        if omega_rad_s != state.angle.rate {
            let base = state.angle.at(state.samples, self.step_s);
            state.angle = Phase { base, base_sample: state.samples, rate: omega_rad_s };
        }
        state.samples += 1;
        if let Some(observer) = &self.observer {
            for (signal, value) in state.signal.iter_mut().zip(external) {
                *signal = if first { [value, 0.0, 0.0, 0.0] } else { observer.update(*signal, value) };
            }
        }
    }

    /// The reference `ahead_s` after the last sample, in s.
    ///
    /// An external reference is extrapolated with the derivatives estimated by its observer.
    pub fn ahead(&self, state: &ReferenceState<N>, ahead_s: f64) -> [RefPoint; N] {
        if self.is_external() {
            return array::map(state.signal, |signal| {
                let [x, v, a, _] = ahead(signal, ahead_s);
                [x, v, a]
            });
        }
        let t_s = state.last_sample() as f64 * self.step_s + ahead_s;
        let omega_rad_s = state.angle.rate;
        let curve = self.at(self.theta_rad(state) + omega_rad_s * ahead_s, omega_rad_s, t_s);
        self.config.transition.apply(curve, state.first, t_s)
    }

    /// The point at the angle θ in rad, for a constant angular velocity in rad/s, at a time in s after the first sample. A rotor with only
    /// axial motion follows the first axis of the curve.
    fn at(&self, theta_rad: f64, omega_rad_s: f64, t_s: f64) -> [RefPoint; N] {
        if B == 1 {
            let curve = self.config.point(theta_rad, omega_rad_s);
            return array::from_fn(|n| curve[n]);
        }
        let [c, s] = self.waves;
        let (sin, cos) = libm::sincos(theta_rad);
        let mut curve = array::from_fn(|a| {
            let x = c[a] * cos + s[a] * sin;
            [x, omega_rad_s * (s[a] * cos - c[a] * sin), -omega_rad_s * omega_rad_s * x]
        });
        if has_x::<N>() {
            curve[0] = self.config.paths[B - 1].axial(t_s);
        }
        curve
    }

    /// θ at the last sample, in rad.
    pub fn theta_rad(&self, state: &ReferenceState<N>) -> f64 {
        state.angle.at(state.last_sample(), self.step_s)
    }
}

impl<const B: usize> ReferenceConfig<B> {
    /// The curve for a rotor in one bearing, (y, z), at the angle `theta_rad` and the constant angular velocity `omega_rad_s`.
    ///
    /// `Y* = (r_Y + a cos nθ) cos θ`, `Z* = (r_Z + a cos nθ) sin θ`, with exact derivatives; a = 0 for an ellipse, and for an external
    /// reference, which has no curve. For a Fourier series see [`Contour::at`].
    pub fn point(&self, theta_rad: f64, omega_rad_s: f64) -> [RefPoint; 2] {
        if self.shape == Shape::Fourier {
            let curve = self.contour.at(theta_rad);
            return array::map(curve, |[x, x_1, x_2]| [x, omega_rad_s * x_1, omega_rad_s * omega_rad_s * x_2]);
        }
        let (sin, cos) = libm::sincos(theta_rad);
        let (a, n) = match self.shape {
            Shape::Lobes => (self.lobe_amplitude_m, f64::from(self.lobes)),
            Shape::Ellipse | Shape::External | Shape::Fourier => (0.0, 0.0),
        };
        // sin(±0) = ±0.
        let (sin_n, cos_n) = if n == 0.0 { (n * theta_rad, 1.0) } else { libm::sincos(n * theta_rad) };
        // The radii r + a cos nθ, and their first and second derivatives with respect to θ.
        let [r_1, r_2] = [-a * n * sin_n, -a * n * n * cos_n];
        let PathConfig { r_y_m, r_z_m, .. } = self.paths[0];
        let [r_y, r_z] = [r_y_m + a * cos_n, r_z_m + a * cos_n];
        // The radius times a function f of θ with the derivative f_1.
        let axis = |r: f64, f: f64, f_1: f64| {
            let second = r_2 * f + 2.0 * r_1 * f_1 - r * f;
            [r * f, omega_rad_s * (r_1 * f + r * f_1), omega_rad_s * omega_rad_s * second]
        };
        [axis(r_y, cos, -sin), axis(r_z, sin, cos)]
    }
}

/// Rejects an ellipse with lobes that may touch a magnet.
///
/// In the direction e the ellipse extends to `√((r_Y e_y)² + (r_Z e_z)²)`, the lobes at most `|a|` further.
fn check_ellipse(path: &PathConfig, lobes_m: f64, bearing: &Bearing, magnets: &Magnets, checks: &mut Checks) {
    let PathConfig { r_y_m: r_y, r_z_m: r_z, .. } = *path;
    let a = lobes_m.abs();
    let s = magnets.gap_m();
    let towards = magnets.directions().iter().map(|e_k| [r_y * e_k[0], r_z * e_k[1]]);
    let extent = |[y, z]: [f64; 2]| (y * y + z * z).sqrt() + a;
    let Some((number, [y, z])) = (1..).zip(towards).find(|(_, towards)| extent(*towards) >= s) else { return };
    let (name, value) = if a >= y.abs() && a >= z.abs() {
        ("reference.lobeAmplitude".to_owned(), lobes_m)
    } else if y.abs() >= z.abs() {
        (format!("reference.r{}", bearing.first_axis().to_uppercase()), r_y)
    } else {
        ("reference.rZ".to_owned(), r_z)
    };
    let (extent, gap) = (Short(extent([y, z])), Short(s));
    let wanted = format!(
        "a reference trajectory that does not touch magnet {number} (it extends to {extent} m, the gap is {gap} m)"
    );
    checks.number(false, name, (value, "m"), wanted);
}

/// Rejects a sine that touches a magnet or exceeds half the sample rate.
fn check_sine(path: &PathConfig, step_s: f64, magnets: &Magnets, checks: &mut Checks) {
    let (amplitude_m, gap_m) = (path.amplitude_m, magnets.gap_m());
    let wanted = format!("an axial motion that does not touch a magnet (the gap is {gap_m} m)");
    checks.number(amplitude_m < gap_m, "reference.amplitude", (amplitude_m, "m"), wanted);
    let highest_hz = 0.5 / step_s;
    let wanted = format!("a finite number, 0 or above, at most half the sample rate ({highest_hz} Hz)");
    checks.number(path.frequency_hz <= highest_hz, "reference.frequency", (path.frequency_hz, "Hz"), wanted);
}

/// Rejects a contour that touches a magnet, checked at 45 angles per period of the highest harmonic; the finding names the largest
/// coefficient.
fn check_contour(contour: &Contour, machine: &Machine, magnets: &Magnets, checks: &mut Checks) {
    const ANGLES: usize = 45 * HARMONICS;
    let mut least = (f64::INFINITY, 0);
    for index in 0..ANGLES {
        let theta_rad = 2.0 * PI * index as f64 / ANGLES as f64;
        let [[y, ..], [z, ..]] = contour.at(theta_rad);
        for (k, e_k) in magnets.directions().iter().enumerate() {
            let gap = magnets.gap_m() - (y * e_k[0] + z * e_k[1]);
            if gap < least.0 {
                least = (gap, k + 1);
            }
        }
    }
    let coefficients = numbers("reference.", contour, machine);
    let largest = coefficients.into_iter().rev().max_by(|(_, a, _), (_, b, _)| a.abs().total_cmp(&b.abs()));
    let (Some((name, value, unit)), (gap, number)) = (largest, least) else { return };
    let gap_m = Short(gap);
    let wanted =
        format!("a reference trajectory that does not touch magnet {number} (the least gap would be {gap_m} m)");
    checks.number(gap > 0.0, name, (value, unit), wanted);
}
