//! The path the rotor is to follow: the flat output and its derivatives.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use super::magnet::Magnets;
use super::observer::{Signal, SignalObserver};
use super::{Checks, Invalid};

/// The most lobes a path may have; beyond, no sample time in use resolves them.
pub const MOST_LOBES: u32 = 1000;

/// What kind of path.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Shape {
    /// The paper's ellipse: `Y* = r_Y cos θ`, `Z* = r_Z sin θ`.
    #[default]
    Ellipse,
    /// An ellipse with lobes: `Y* = (r_Y + a cos nθ) cos θ`, `Z* = (r_Z + a cos nθ) sin θ`.
    Lobes,
    /// Positions sampled from outside.
    External,
}

/// The path to follow.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ReferenceConfig {
    /// What kind of path.
    pub shape: Shape,
    /// Half axis along y, `r_Y`, in m; not below 0.
    pub r_y_m: f64,
    /// Half axis along z, `r_Z`, in m; not below 0.
    pub r_z_m: f64,
    /// Number of lobes `n` per revolution.
    pub lobes: u32,
    /// Amplitude `a` of the lobes, in m; below 0 turns them by half a lobe.
    pub lobe_amplitude_m: f64,
    /// Angular velocity at which the path is run through, in rad/s; below 0 runs it backwards.
    pub omega_rad_s: f64,
    /// How fast the observer of an external reference is, in rad/s.
    ///
    /// What is no cubic is followed with the lag of its acceleration. The paper's ellipse given from outside costs
    /// 1.9 µm of tracking error at 3000 rpm, 0.03 µm at 1000 rpm, with 2000 rad/s; at 3000 rpm 0.45 µm with 4000 rad/s
    /// (tracking poles at 1000 rad/s, 10 kHz). Noise in the reference asks for less.
    pub bandwidth_rad_s: f64,
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
            omega_rad_s: 2.0 * PI * 50.0,
            bandwidth_rad_s: 4000.0,
        }
    }
}

/// One axis of the path at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RefPoint {
    /// Position, in m.
    pub position_m: f64,
    /// Velocity, in m/s.
    pub velocity_m_s: f64,
    /// Acceleration, in m/s².
    pub acceleration_m_s2: f64,
}

/// Where a reference stands; belongs to a [`Reference`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceState {
    /// Number of samples taken.
    samples: u64,
    /// θ at the sample at which ω changed last, in rad.
    base_rad: f64,
    /// Number of that sample.
    base_sample: u64,
    /// Angular velocity since then, in rad/s.
    omega_rad_s: f64,
    /// θ at the sample taken last, in rad.
    theta_rad: f64,
    /// What the external reference of each axis is taken to be at the sample taken last.
    signal: [Signal; 2],
}

/// A checked reference, sampled at a fixed step.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    config: ReferenceConfig,
    step_s: f64,
    observer: SignalObserver,
}

impl Reference {
    /// A reference sampled every `step_s` (finite, above 0), for a rotor between `magnets`.
    ///
    /// # Errors
    /// `reference.rY`, `reference.rZ` if they are below 0, `reference.lobes` above [`MOST_LOBES`], `bandwidth.reference`
    /// unless above 0; all of these and `reference.lobeAmplitude`, `reference.omega` if they are not finite; `reference.rY`
    /// and its like if the path reaches a magnet.
    pub fn new(config: ReferenceConfig, step_s: f64, magnets: &Magnets) -> Result<Self, Vec<Invalid>> {
        let mut checks = Checks::default();
        let reference = Self::checked(config, step_s, magnets, &mut checks);
        checks.finish()?;
        Ok(reference)
    }

    /// Notes what is wrong in `checks`; the value returned is of use only when nothing was.
    pub(crate) fn checked(config: ReferenceConfig, step_s: f64, magnets: &Magnets, checks: &mut Checks) -> Self {
        checks.not_negative("reference.rY", config.r_y_m, "m");
        checks.not_negative("reference.rZ", config.r_z_m, "m");
        checks.require(
            config.lobes <= MOST_LOBES,
            "reference.lobes",
            config.lobes,
            format!("a number up to {MOST_LOBES}"),
        );
        checks.finite("reference.lobeAmplitude", config.lobe_amplitude_m, "m");
        checks.finite("reference.omega", config.omega_rad_s, "rad/s");
        checks.positive("bandwidth.reference", config.bandwidth_rad_s, "rad/s");
        check_reach(&config, magnets, checks);
        let observer = SignalObserver::new(config.bandwidth_rad_s, step_s);
        Self { config, step_s, observer }
    }

    /// The configuration it was made from.
    pub fn config(&self) -> &ReferenceConfig {
        &self.config
    }

    /// Before the first sample: θ = 0, an external reference at rest.
    pub fn start(&self) -> ReferenceState {
        ReferenceState {
            samples: 0,
            base_rad: 0.0,
            base_sample: 0,
            omega_rad_s: self.config.omega_rad_s,
            theta_rad: 0.0,
            signal: [Signal::default(); 2],
        }
    }

    /// Whether a state, for instance one read from a file, can be gone on with: its numbers are finite, its counts in order.
    pub fn accepts(&self, state: &ReferenceState) -> bool {
        let angles = [state.base_rad, state.omega_rad_s, state.theta_rad];
        let numbers = angles.iter().chain(state.signal.iter().flat_map(|signal| &signal.0));
        state.base_sample <= state.samples && state.samples < u64::MAX && numbers.copied().all(f64::is_finite)
    }

    /// Goes on to the next sample: `omega_rad_s` is valid from this sample on, `external_m` is what (Yref, Zref) are at
    /// it, in m; only a path from outside looks at it.
    ///
    /// θ = ∫ω dt is kept as base + ω·(count · T_s), the base moved when ω changes, so that it does not drift. An external
    /// reference starts at its first sample, at rest.
    pub fn sample(&self, state: &mut ReferenceState, omega_rad_s: f64, external_m: [f64; 2]) {
        let first = state.samples == 0;
        let sample = state.samples;
        let since_base_s = (sample - state.base_sample) as f64 * self.step_s;
        state.theta_rad = state.base_rad + state.omega_rad_s * since_base_s;
        if omega_rad_s != state.omega_rad_s {
            state.base_rad = state.theta_rad;
            state.base_sample = sample;
            state.omega_rad_s = omega_rad_s;
        }
        if self.config.shape == Shape::External {
            for (signal, value_m) in state.signal.iter_mut().zip(external_m) {
                *signal = if first { Signal([value_m, 0.0, 0.0, 0.0]) } else { self.observer.update(*signal, value_m) };
            }
        }
        state.samples += 1;
    }

    /// The path, (y, z), `ahead_s` after the sample taken last, in s.
    ///
    /// An external reference is continued by the derivatives its observer has found.
    pub fn ahead(&self, state: &ReferenceState, ahead_s: f64) -> [RefPoint; 2] {
        match self.config.shape {
            Shape::Ellipse | Shape::Lobes => {
                self.point(state.theta_rad + state.omega_rad_s * ahead_s, state.omega_rad_s)
            }
            Shape::External => state.signal.map(|signal| {
                let [position_m, velocity_m_s, acceleration_m_s2, _] = signal.ahead(ahead_s).0;
                RefPoint { position_m, velocity_m_s, acceleration_m_s2 }
            }),
        }
    }

    /// θ at the sample taken last, in rad.
    pub fn theta_rad(&self, state: &ReferenceState) -> f64 {
        state.theta_rad
    }

    /// The path, (y, z), at the angle `theta_rad`, run through at the constant `omega_rad_s`.
    ///
    /// `Y* = (r_Y + a cos nθ) cos θ`, `Z* = (r_Z + a cos nθ) sin θ`, derivatives exact; an ellipse has a = 0. An external
    /// reference has no such points: it gives those of the ellipse.
    pub fn point(&self, theta_rad: f64, omega_rad_s: f64) -> [RefPoint; 2] {
        let (sin, cos) = (libm::sin(theta_rad), libm::cos(theta_rad));
        let (a, n) = match self.config.shape {
            Shape::Lobes => (self.config.lobe_amplitude_m, f64::from(self.config.lobes)),
            Shape::Ellipse | Shape::External => (0.0, 0.0),
        };
        let (sin_n, cos_n) = (libm::sin(n * theta_rad), libm::cos(n * theta_rad));
        // The radius r + a cos nθ, its first and second derivative with respect to θ.
        let [r_1, r_2] = [-a * n * sin_n, -a * n * n * cos_n];
        let r_y = self.config.r_y_m + a * cos_n;
        let r_z = self.config.r_z_m + a * cos_n;
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

/// Refuses a path that may reach a magnet.
///
/// Towards the direction e the ellipse reaches `√((r_Y e_y)² + (r_Z e_z)²)`, the lobes at most `|a|` more.
fn check_reach(config: &ReferenceConfig, magnets: &Magnets, checks: &mut Checks) {
    let a = match config.shape {
        Shape::External => return,
        Shape::Ellipse => 0.0,
        Shape::Lobes => config.lobe_amplitude_m.abs(),
    };
    let [r_y, r_z] = [config.r_y_m, config.r_z_m];
    let s = magnets.gap_m();
    // What was refused already is not refused again for what follows from it.
    if ![r_y, r_z, a, s].iter().all(|value| value.is_finite() && *value >= 0.0) || s == 0.0 {
        return;
    }
    for (k, e_k) in magnets.directions().into_iter().enumerate() {
        let [y, z] = [r_y * e_k[0], r_z * e_k[1]];
        let reach = (y * y + z * z).sqrt() + a;
        if reach >= s {
            let (name, value) = if a >= y.abs() && a >= z.abs() {
                ("reference.lobeAmplitude", config.lobe_amplitude_m)
            } else if y.abs() >= z.abs() {
                ("reference.rY", r_y)
            } else {
                ("reference.rZ", r_z)
            };
            let number = k + 1;
            checks.require(
                false,
                name,
                format_args!("{value} m"),
                format!("a path that does not reach magnet {number} (it reaches {reach} m, the gap is {s} m)"),
            );
            return;
        }
    }
}
