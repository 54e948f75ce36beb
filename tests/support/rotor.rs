//! A small independent simulator: rotor, three magnets, sampled flatness-based tracking, noisy sensors. It shares no code with
//! the program, and its integration error is below 1e-12 m.

use crate::prelude::*;
use crate::support::runge_kutta;

/// One instant of the data; the two currents are those before and after it (the same if they are continuous).
#[derive(Clone, Debug)]
pub struct Sample {
    pub position_m: [f64; 2],
    pub before_a: [f64; 3],
    pub after_a: [f64; 3],
    pub theta_rad: f64,
}

/// The currents between two samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Currents {
    /// Held over a sample.
    Held,
    /// A continuous function of the true state, without delay.
    OfState,
    /// Linear between samples, from one command to the next, as in coils at held voltages.
    Ramping,
}

/// Position, velocity and acceleration of the reference (y, z) at a time in s.
pub type Path = fn(&Rotor, f64) -> [[f64; 2]; 3];

#[derive(Clone, Debug)]
pub struct Rotor {
    pub m_kg: f64,
    pub gap_m: f64,
    pub alpha_rad: [f64; 3],
    pub lambda: [f64; 3],
    /// Instant in s at which λ changes, if it does, and λ from then on.
    pub change: Option<(f64, [f64; 3])>,
    /// λ used by the controller.
    pub lambda_controller: [f64; 3],
    pub omega_rad_s: f64,
    pub radius_m: [f64; 2],
    pub path: Path,
    pub currents: Currents,
    /// Constant force (y, z), N.
    pub load_n: [f64; 2],
    /// Amplitude of a force in z, sin ωt, N.
    pub sine_n: f64,
    /// Unbalance: magnitude in kg·m, phase in rad.
    pub unbalance: (f64, f64),
    /// Initial deviation from the reference along both axes: position (m), velocity (m/s).
    pub start_off: (f64, f64),
    pub samples: usize,
    /// Greatest current, A.
    pub limit_a: f64,
    /// Standard deviations of the sensors, m and A.
    pub noise: (f64, f64),
    pub seed: u64,
}

/// The ellipse with the radii of the rotor, in phase with its angle.
pub fn ellipse(rotor: &Rotor, t: f64) -> [[f64; 2]; 3] {
    let w = rotor.omega_rad_s;
    let (s, c) = (w * t).sin_cos();
    let [ry, rz] = rotor.radius_m;
    [[ry * c, rz * s], [-ry * w * s, rz * w * c], [-ry * w * w * c, -rz * w * w * s]]
}

impl Default for Rotor {
    fn default() -> Self {
        Self {
            m_kg: 6.7,
            gap_m: 5e-4,
            alpha_rad: [PI, -PI / 3.0, PI / 3.0],
            lambda: [1.8e-6, 2.0e-6, 2.2e-6],
            change: None,
            lambda_controller: [1.8e-6, 2.0e-6, 2.2e-6],
            omega_rad_s: 100.0 * PI,
            radius_m: [30e-6, 70e-6],
            path: ellipse,
            currents: Currents::Held,
            load_n: [0.0; 2],
            sine_n: 0.0,
            unbalance: (0.0, 0.0),
            start_off: (0.0, 0.0),
            samples: 1001,
            limit_a: f64::INFINITY,
            noise: (0.0, 0.0),
            seed: 1,
        }
    }
}

/// Position and velocity (y, z), m and m/s.
type State = [f64; 4];

impl Rotor {
    /// Different mass, gap, angles, magnets and speed; a revolution is 158.7 samples.
    pub fn another() -> Self {
        Self {
            m_kg: 3.4,
            gap_m: 4e-4,
            alpha_rad: [PI + 0.15, -PI / 3.0 + 0.15, PI / 3.0 + 0.15],
            lambda: [3.1e-6, 2.7e-6, 2.4e-6],
            lambda_controller: [4e-6; 3],
            omega_rad_s: 126.0 * PI,
            ..Self::default()
        }
    }

    fn gaps(&self, x: &State) -> [f64; 3] {
        self.alpha_rad.map(|a| self.gap_m - a.sin() * x[0] - a.cos() * x[1])
    }

    /// Flatness-based tracking with both poles at 1000 rad/s; `p_n` is the perturbation to compensate.
    fn command(&self, t: f64, x: &State, p_n: [f64; 2]) -> ([f64; 2], [f64; 3]) {
        const K0: f64 = 1e6;
        const K1: f64 = 2e3;
        let [reference, velocity, acceleration] = (self.path)(self, t);
        let force: [f64; 2] = std::array::from_fn(|k| {
            let accel = acceleration[k] - K1 * (x[k + 2] - velocity[k]) - K0 * (x[k] - reference[k]);
            self.m_kg * accel - p_n[k]
        });
        // Magnet forces with the sum `force` are a particular solution plus a multiple of the null vector, which
        // is positive if the magnets surround the rotor; the smallest of them is F_0 = 20 N.
        let sine = |i: usize, k: usize| (self.alpha_rad[k] - self.alpha_rad[i]).sin();
        let null = [sine(1, 2), sine(2, 0), sine(0, 1)];
        let [a2, a3] = [self.alpha_rad[1], self.alpha_rad[2]];
        let particular = [
            0.0,
            (force[1] * a3.sin() - force[0] * a3.cos()) / null[0],
            (force[0] * a2.cos() - force[1] * a2.sin()) / null[0],
        ];
        let lift = (0..3).map(|k| (20.0 - particular[k]) / null[k]).fold(f64::NEG_INFINITY, f64::max);
        let gaps = self.gaps(x);
        let currents = std::array::from_fn(|k| {
            (gaps[k] * ((particular[k] + lift * null[k]).max(0.0) / self.lambda_controller[k]).sqrt()).min(self.limit_a)
        });
        (force, currents)
    }

    fn rate(&self, t: f64, x: &State, i: [f64; 3]) -> State {
        let lambda = self.change.filter(|(from_s, _)| t >= *from_s - 1e-9).map_or(self.lambda, |(_, lambda)| lambda);
        let gaps = self.gaps(x);
        let w = self.omega_rad_s;
        let (u, phi) = self.unbalance;
        let mut f = [
            self.load_n[0] + u * w * w * (w * t + phi).cos(),
            self.load_n[1] + u * w * w * (w * t + phi).sin() + self.sine_n * (w * t).sin(),
        ];
        for k in 0..3 {
            let pull = lambda[k] * (i[k] / gaps[k]).powi(2);
            f[0] += pull * self.alpha_rad[k].sin();
            f[1] += pull * self.alpha_rad[k].cos();
        }
        [x[2], x[3], f[0] / self.m_kg, f[1] / self.m_kg]
    }

    /// Fourth-order Runge–Kutta with ten substeps per sample: error below 1e-12 m.
    ///
    /// The controller is a sampled one: an observer of position, velocity and perturbation with its poles at 4000 rad/s
    /// predicts one sample ahead, and the current computed from the samples up to t_j acts from t_{j+1} on.
    pub fn run(&self) -> Vec<Sample> {
        const SUBSTEPS: usize = 10;
        let (dx, dv) = self.start_off;
        let [at, velocity, _] = (self.path)(self, 0.0);
        let mut x: State = [at[0] + dx, at[1] - dx, velocity[0] + dv, velocity[1] - dv];
        let mut observed = x;
        let mut p_hat = [0.0; 2];
        let ts = STEP_S;
        let q = 1.0 - (-4000.0 * ts).exp();
        let gains = [3.0 * q, (3.0 * q * q - q * q * q / 2.0) / ts, self.m_kg * q * q * q / (ts * ts)];
        let (mut force, mut after) = self.command(0.0, &x, self.load_n);
        let mut before = after;
        let h = ts / SUBSTEPS as f64;
        let mut noise = Random::new(self.seed);
        let mut out = Vec::with_capacity(self.samples);
        for j in 0..self.samples {
            let t = j as f64 * ts;
            let (seen_before, seen_after) = match self.currents {
                Currents::Held => (before, after),
                Currents::OfState => [self.command(t, &x, self.load_n).1; 2].into(),
                Currents::Ramping => (before, before),
            };
            let measured = [x[0] + self.noise.0 * noise.normal(), x[1] + self.noise.0 * noise.normal()];
            let after_a = seen_after.map(|i| i + self.noise.1 * noise.normal());
            // A held current is measured only once.
            let before_a = match self.currents {
                Currents::Held => out.last().map_or(seen_before, |last: &Sample| last.after_a),
                _ => after_a,
            };
            out.push(Sample { position_m: measured, before_a, after_a, theta_rad: self.omega_rad_s * t });
            // The currents at a fraction of the interval.
            let current = |fraction: f64, t: f64, x: &State| match self.currents {
                Currents::Held => after,
                Currents::OfState => self.command(t, x, self.load_n).1,
                Currents::Ramping => std::array::from_fn(|k| before[k] + fraction * (after[k] - before[k])),
            };
            for sub in 0..SUBSTEPS {
                let begin = t + sub as f64 * h;
                x = runge_kutta(&x, begin, h, |now, x| self.rate(now, x, current((now - t) / ts, now, x)));
            }
            for axis in 0..2 {
                let error = measured[axis] - observed[axis];
                let accel = (force[axis] + p_hat[axis]) / self.m_kg;
                observed[axis] += ts * observed[axis + 2] + 0.5 * ts * ts * accel + gains[0] * error;
                observed[axis + 2] += ts * accel + gains[1] * error;
                p_hat[axis] += gains[2] * error;
            }
            before = after;
            (force, after) = self.command(t + ts, &observed, p_hat);
        }
        out
    }

    /// With the right force constants the rotor tracks its path perfectly. A backward force then cannot be distinguished from them: its
    /// tolerance is 0.
    pub fn config(&self, method: Method, hold: Hold) -> EstimatorConfig {
        let mut geometry = EstimatorConfig::default().geometry;
        (geometry.shaft.m_kg, geometry.bearings[0].gap_m) = (self.m_kg, self.gap_m);
        geometry.bearings[0].alpha_rad[..3].copy_from_slice(&self.alpha_rad);
        EstimatorConfig {
            tolerance: Tolerance { backward_force_n: 0.0, ..Tolerance::default() },
            geometry,
            step_s: STEP_S,
            method,
            hold,
            ..EstimatorConfig::default()
        }
    }

    pub fn input(&self, sample: &Sample, hold: Hold) -> EstimatorInput {
        EstimatorInput {
            position_m: sample.position_m,
            current_a: if hold == Hold::HeldBefore { sample.before_a } else { sample.after_a },
            theta_rad: sample.theta_rad,
            omega_rad_s: self.omega_rad_s,
            enable: true,
            ..EstimatorInput::default()
        }
    }

    /// The inputs of an estimator on this rotor.
    pub fn inputs(&self, hold: Hold) -> Vec<EstimatorInput> {
        self.run().iter().map(|sample| self.input(sample, hold)).collect()
    }

    /// The outputs of an estimator on this rotor.
    pub fn identify(&self, config: EstimatorConfig) -> Vec<EstimatorOutput> {
        let inputs = self.inputs(config.hold);
        let estimator = Estimator::new(config).expect("a good configuration");
        let mut state = estimator.start();
        inputs.iter().map(|input| estimator.sample(&mut state, input)).collect()
    }

    pub fn error_percent(&self, lambda: &[f64; 3]) -> [f64; 3] {
        std::array::from_fn(|k| 100.0 * (lambda[k] / self.lambda[k] - 1.0))
    }
}

pub fn largest(errors: [f64; 3]) -> f64 {
    errors.iter().fold(0.0, |m, e| m.max(e.abs()))
}

/// An unbalance of 20 N at 50 Hz and a static load.
pub fn unbalanced() -> Rotor {
    let newton_at_50_hz = 1.0 / (100.0 * PI).powi(2);
    Rotor { load_n: [10.0, -20.0], unbalance: (20.0 * newton_at_50_hz, 0.7), ..Rotor::default() }
}
