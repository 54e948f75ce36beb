//! A test bench with imperfections: bearing, sampled controller, and every difference between a bench and its data sheet.
//!
//! The controller knows only the data sheet. It holds the currents over a sample; a reading is the current held before (`HeldBefore`).

use std::f64::consts::{FRAC_PI_3, PI, TAU};

use crate::support::runge_kutta;
use magnetic_bearing::bearing::Scalar;
use magnetic_bearing::bearing::magnet::{Geometry, Magnets, currents};
use magnetic_bearing::control::controller::tracking_gains;
use magnetic_bearing::control::observer::gains_of_three;
use magnetic_bearing::invalid::Checks;
use magnetic_bearing::plant::noise::Noise;

/// Runge–Kutta steps per sample.
const SUBSTEPS: usize = 8;

/// A bearing, its controller, and its bench. Angles in rad, otherwise SI units.
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub struct Bench {
    pub m: f64,
    pub s: f64,
    pub alpha: [f64; 3],
    pub lambda: [f64; 3],
    /// The controller uses the true λ from this time on; 0 for never.
    pub update_s: f64,
    pub omega: f64,
    pub load: [f64; 2],
    pub unbalance: [f64; 2],
    pub position_noise: f64,
    pub current_noise: f64,
    pub step: f64,
    pub seconds: f64,
    pub seed: u64,
    pub errors: Errors,
    /// Step of λ: time in s, relative change.
    pub change: [f64; 2],
    /// Impact along z, a half sine of 0.5 ms: time in s, peak in N.
    pub impact: [f64; 2],
    /// Time constant, in s, with which the currents in the magnets follow the recorded ones.
    pub lag: f64,
    /// Random-walk force along y and z: standard deviation after 1 s, in N.
    pub slow_force: f64,
}

/// Errors of the bench, unknown to the controller; those of mass and gap are relative.
#[derive(Clone, Debug, Default)]
#[allow(missing_docs)]
pub struct Errors {
    pub m: f64,
    pub s: f64,
    pub alpha: [f64; 3],
    pub offset: [f64; 2],
    pub gain: [f64; 2],
    pub rotation: f64,
    pub skew: f64,
    pub delay: f64,
    /// Forward cos, sin; backward cos, sin.
    pub runout1: [f64; 4],
    /// y cos, sin; z cos, sin.
    pub runout2: [f64; 4],
    pub current_offset: [f64; 3],
    pub current_gain: [f64; 3],
    pub iron: f64,
    pub backward: [f64; 2],
}

impl Default for Bench {
    fn default() -> Self {
        let omega = TAU * 50.0;
        let u = 20.0 / (omega * omega);
        let phi = 40.0_f64.to_radians();
        Self {
            m: 6.7,
            s: 5e-4,
            alpha: [PI, -FRAC_PI_3, FRAC_PI_3],
            lambda: [1.8e-6, 2.0e-6, 2.2e-6],
            update_s: 0.2,
            omega,
            load: [10.0, -20.0],
            unbalance: [u * phi.cos(), u * phi.sin()],
            position_noise: 1e-7,
            current_noise: 1e-2,
            step: 1e-4,
            seconds: 0.4,
            seed: 1,
            errors: Errors::default(),
            change: [0.0; 2],
            impact: [0.0; 2],
            lag: 0.0,
            slow_force: 0.0,
        }
    }
}

/// A recording.
#[derive(Clone, Debug, Default)]
#[allow(missing_docs)]
pub struct Recorded {
    pub position: Vec<[f64; 2]>,
    pub current: Vec<[f64; 3]>,
    pub theta: Vec<f64>,
    pub omega: Vec<f64>,
}

impl Bench {
    /// Position, velocity and acceleration along y and z: an ellipse.
    fn reference(&self, t: f64) -> [[f64; 3]; 2] {
        let (w, (sin, cos)) = (self.omega, (self.omega * t).sin_cos());
        let [r_y, r_z] = [30e-6, 70e-6];
        [[r_y * cos, w * (-r_y * sin), w * w * (-r_y * cos)], [r_z * sin, w * (r_z * cos), w * w * (-r_z * sin)]]
    }

    fn force(&self, t: f64, x: &[f64; 4], current: [f64; 3], e: &[[f64; 2]; 3]) -> [f64; 2] {
        let gap = self.s * (1.0 + self.errors.s) + self.errors.iron;
        let lambda_factor = if self.change[0] > 0.0 && t >= self.change[0] { 1.0 + self.change[1] } else { 1.0 };
        let mut force = self.load;
        for k in 0..3 {
            let b = current[k] / (gap - e[k][0] * x[0] - e[k][1] * x[1]);
            let pull = self.lambda[k] * lambda_factor * b * b;
            force[0] += e[k][0] * pull;
            force[1] += e[k][1] * pull;
        }
        let (sin, cos) = (self.omega * t).sin_cos();
        let w_2 = self.omega * self.omega;
        let [u_c, u_s] = self.unbalance;
        let [b_c, b_s] = self.errors.backward;
        force[0] += w_2 * (u_c * cos - u_s * sin) + b_c * cos + b_s * sin;
        force[1] += w_2 * (u_c * sin + u_s * cos) - b_c * sin + b_s * cos;
        if self.impact[1] != 0.0 && t >= self.impact[0] && t < self.impact[0] + 5e-4 {
            force[1] += self.impact[1] * (PI * (t - self.impact[0]) / 5e-4).sin();
        }
        force
    }

    /// Simulates the bench.
    #[must_use]
    pub fn record(&self) -> Recorded {
        let rows = (self.seconds / self.step).round() as usize + 1;
        let magnets = Checks::all(|checks| Magnets::checked(self.s, &self.alpha, checks)).expect("magnets");
        let directions = self.alpha.map(|alpha| alpha.sine_cosine().into());
        let geometry = Geometry { gap_m: [self.s; 3], directions };
        let allocate = |force: [f64; 2]| {
            let mut forces = [0.0; 3];
            magnets.allocate(force, &[20.0], &mut forces);
            forces
        };
        let errors = &self.errors;
        let e: [_; 3] = std::array::from_fn(|k| (self.alpha[k] + errors.alpha[k]).sin_cos().into());
        let mut channels = Noise::sequence(self.seed);
        let mut noise: [Noise; 5] = std::array::from_fn(|_| channels());
        let mut channels = Noise::sequence(self.seed + 1000);
        let (mut walks, mut slow): ([Noise; 2], _) = (std::array::from_fn(|_| channels()), [0.0; 2]);
        let gains = gains_of_three(4000.0, self.step);
        let tracking = tracking_gains(1000.0, self.step);
        let (h, sub) = (self.step, self.step / SUBSTEPS as f64);
        let m = self.m * (1.0 + errors.m);
        let start = self.reference(0.0);
        let mut x = [start[0][0], start[1][0], start[0][1], start[1][1]];
        let mut observed = [[start[0][0], start[0][1], 0.0], [start[1][0], start[1][1], 0.0]];
        let ahead = self.reference(0.5 * h);
        let mut demanded = [self.m * ahead[0][2], self.m * ahead[1][2]];
        let gaps = geometry.gaps([x[0], x[1]]);
        let mut lambda = [4e-6; 3];
        let mut current = currents(allocate(demanded), gaps, lambda);
        let mut held = current;
        let mut flowing = current;
        let mut history = vec![[x[0], x[1]]];
        let mut out = Recorded::default();
        for row in 0..rows {
            let t = row as f64 * h;
            let substep = ((row * SUBSTEPS) as f64 - errors.delay / sub).max(0.0);
            let (at, fraction) = (substep.floor() as usize, substep.fract());
            let next = (at + 1).min(history.len() - 1);
            let angle = self.omega * t;
            let (sin, cos) = angle.sin_cos();
            let (sin_2, cos_2) = (2.0 * angle).sin_cos();
            let (r, q) = (errors.runout1, errors.runout2);
            let delayed = |a: usize| history[at][a] * (1.0 - fraction) + history[next][a] * fraction;
            let y = delayed(0) + (r[0] + r[2]) * cos + (r[3] - r[1]) * sin + q[0] * cos_2 + q[1] * sin_2;
            let z = delayed(1) + (r[0] - r[2]) * sin + (r[1] + r[3]) * cos + q[2] * cos_2 + q[3] * sin_2;
            let turned = [errors.rotation - errors.skew, errors.rotation + errors.skew];
            let [(s_y, c_y), (s_z, c_z)] = turned.map(f64::sin_cos);
            let rotated = [c_y * y - s_y * z, s_z * y + c_z * z];
            let read: [f64; 2] = std::array::from_fn(|a| {
                noise[a].measure((1.0 + errors.gain[a]) * rotated[a] + errors.offset[a], self.position_noise)
            });
            let reading = std::array::from_fn(|k| {
                let value = (1.0 + errors.current_gain[k]) * held[k] + errors.current_offset[k];
                noise[2 + k].measure(value, self.current_noise)
            });
            out.position.push(read);
            out.current.push(reading);
            out.theta.push(angle);
            out.omega.push(self.omega);

            if self.update_s > 0.0 && (t - self.update_s).abs() < 0.5 * h {
                lambda = self.lambda;
            }
            let (middle, end) = (self.reference(t + 1.5 * h), self.reference(t + h));
            let mut force = [0.0; 2];
            let mut predicted = [0.0; 2];
            for a in 0..2 {
                let error = read[a] - observed[a][0];
                let o: [f64; 3] = std::array::from_fn(|j| observed[a][j] + gains[j] * error);
                let acceleration = demanded[a] / self.m + o[2];
                observed[a] = [o[0] + h * o[1] + 0.5 * h * h * acceleration, o[1] + h * acceleration, o[2]];
                force[a] = self.m
                    * (middle[a][2]
                        - tracking[1] * (observed[a][1] - end[a][1])
                        - tracking[0] * (observed[a][0] - end[a][0])
                        - observed[a][2]);
                predicted[a] = observed[a][0] + 0.5 * h * observed[a][1];
            }
            let gaps = geometry.gaps(predicted).map(|gap| gap.max(1e-5));
            let next = currents(allocate(force), gaps, lambda);

            for a in 0..2 {
                slow[a] = walks[a].measure(slow[a], self.slow_force * h.sqrt());
            }
            let lagged = |since: f64| -> [f64; 3] {
                let decay = if self.lag > 0.0 { (-since / self.lag).exp() } else { 0.0 };
                std::array::from_fn(|k| current[k] + (flowing[k] - current[k]) * decay)
            };
            for step in 0..SUBSTEPS {
                x = runge_kutta(&x, t + step as f64 * sub, sub, |now, x| {
                    let force = self.force(now, x, lagged(now - t), &e);
                    [x[2], x[3], (force[0] + slow[0]) / m, (force[1] + slow[1]) / m]
                });
                history.push([x[0], x[1]]);
            }
            let gaps = geometry.gaps([x[0], x[1]]);
            assert!(gaps.into_iter().all(|gap| gap > 0.05 * self.s), "the rotor leaves its gap at {t} s: {gaps:?}");
            flowing = lagged(h);
            held = current;
            current = next;
            demanded = force;
        }
        out
    }
}
