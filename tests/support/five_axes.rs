//! A small independent simulator of a spindle in its closed loop. It shares no code with the program.

use crate::prelude::*;

use crate::support::runge_kutta;

const ALPHA: [f64; 3] = [PI, -PI / 3.0, PI / 3.0];
/// Mass in kg, transverse moment of inertia in kg·m².
const INERTIA: [f64; 2] = [12.0, 0.16];
/// Axial positions of the bearings, their sensors, and the planes of unbalance.
const AT_M: [f64; 2] = [-0.12, 0.15];
const SENSORS_M: [f64; 2] = [-0.10, 0.13];
const PLANES_M: [f64; 2] = [-0.08, 0.10];
type Five = [f64; 5];

/// A spindle: rotor, two radial bearings and one axial bearing.
#[derive(Clone, Debug)]
pub struct FiveAxes {
    pub rpm: f64,
    /// Polar moment of inertia.
    pub polar_kgm2: f64,
    pub gap_m: [f64; 2],
    pub lambda: [f64; 8],
    /// λ used by the controller.
    pub guess: [f64; 8],
    pub unbalance: [(f64, f64); 2],
    /// Forces in x, y, z, moments about y and z.
    pub load: Five,
    pub noise: (f64, f64),
    /// Relative amplitude, and frequencies in Hz, of the modulation of the smallest force.
    pub modulation: (f64, [f64; 3]),
    /// Semi-axes and phase of the ellipses in A and B; amplitude and frequency of the axial motion.
    pub paths: [(f64, f64, f64); 2],
    pub axial: (f64, f64),
    pub samples: usize,
    pub seed: u64,
}

impl Default for FiveAxes {
    fn default() -> Self {
        let lambda = [1.8e-6, 2.0e-6, 2.2e-6, 2.4e-6, 2.1e-6, 1.9e-6, 3.0e-6, 2.6e-6];
        Self {
            rpm: 3000.0,
            polar_kgm2: 0.02,
            gap_m: [5e-4, 6e-4],
            lambda,
            guess: lambda,
            unbalance: [(8e-5, 0.7), (5e-5, -1.9)],
            load: [8.0, 15.0, -20.0, 0.6, -0.9],
            noise: (1e-7, 1e-2),
            modulation: (0.5, [110.0, 130.0, 90.0]),
            paths: [(30e-6, 70e-6, 0.0), (60e-6, 25e-6, 1.2)],
            axial: (20e-6, 60.0),
            samples: 1001,
            seed: 1,
        }
    }
}

impl FiveAxes {
    /// First guesses too large or too small by a factor of 1.5 to 2.
    pub fn guessing(seed: u64) -> Self {
        let mut draw = Random::new(7_000_000 + seed);
        let this = Self::default();
        let guess = this.lambda.map(|lambda| {
            let by = draw.between(1.5, 2.0);
            if draw.between(0.0, 1.0) < 0.5 { lambda * by } else { lambda / by }
        });
        Self { guess, seed, ..this }
    }

    fn omega(&self) -> f64 {
        self.rpm * 2.0 * PI / 60.0
    }

    fn inertia(&self) -> Five {
        [INERTIA[0], INERTIA[0], INERTIA[0], INERTIA[1], INERTIA[1]]
    }

    fn directions(&self) -> [Five; 8] {
        std::array::from_fn(|k| match k / 3 {
            2 => [if k == 6 { 1.0 } else { -1.0 }, 0.0, 0.0, 0.0, 0.0],
            b => {
                let (xi, a) = (AT_M[b], ALPHA[k % 3]);
                [0.0, a.sin(), a.cos(), -xi * a.cos(), xi * a.sin()]
            }
        })
    }

    fn gaps(&self, q: &Five) -> [f64; 8] {
        let d = self.directions();
        std::array::from_fn(|k| self.gap_m[k / 6] - (0..5).map(|j| d[k][j] * q[j]).sum::<f64>())
    }

    fn readings(&self, q: &Five) -> Five {
        let [a, b] = SENSORS_M;
        [q[1] + a * q[4], q[2] - a * q[3], q[1] + b * q[4], q[2] - b * q[3], q[0]]
    }

    fn coordinates(&self, r: &Five) -> Five {
        let [a, b] = SENSORS_M;
        let (gamma, beta) = ((r[2] - r[0]) / (b - a), -(r[3] - r[1]) / (b - a));
        [r[4], r[0] - a * gamma, r[1] + a * beta, beta, gamma]
    }

    fn acceleration(&self, q: &Five, v: &Five, i: &[f64; 8], theta: f64) -> Five {
        let (w, d, gaps) = (self.omega(), self.directions(), self.gaps(q));
        let mut f = self.load;
        for k in 0..8 {
            let force = self.lambda[k] * (i[k] / gaps[k]).powi(2);
            (0..5).for_each(|j| f[j] += d[k][j] * force);
        }
        for ((u, phi), xi) in self.unbalance.into_iter().zip(PLANES_M) {
            let (y, z) = (u * w * w * (theta + phi).cos(), u * w * w * (theta + phi).sin());
            f[1] += y;
            f[2] += z;
            f[3] -= xi * z;
            f[4] += xi * y;
        }
        f[3] -= self.polar_kgm2 * w * v[4];
        f[4] += self.polar_kgm2 * w * v[3];
        let m = self.inertia();
        std::array::from_fn(|j| f[j] / m[j])
    }

    /// Position, velocity, acceleration of the reference.
    fn reference(&self, t: f64) -> [Five; 3] {
        let (w, [xa, xb]) = (self.omega(), AT_M);
        std::array::from_fn(|d| {
            let (f, turn) = (w.powi(d as i32), d as f64 * PI / 2.0);
            let [[ya, za], [yb, zb]] =
                self.paths.map(|(y, z, p)| [y * (w * t + p + turn).cos() * f, z * (w * t + p + turn).sin() * f]);
            let (amplitude, wa) = (self.axial.0, 2.0 * PI * self.axial.1);
            let l = xb - xa;
            [
                amplitude * (wa * t + turn).sin() * wa.powi(d as i32),
                (ya * xb - yb * xa) / l,
                (za * xb - zb * xa) / l,
                -(zb - za) / l,
                (yb - ya) / l,
            ]
        })
    }

    fn allocate(&self, f: &Five, q: &Five, t: f64) -> [f64; 8] {
        let [xa, xb] = AT_M;
        let (depth, frequencies) = self.modulation;
        let least = frequencies.map(|hz| 15.0 * (1.0 + depth * (2.0 * PI * hz * t).sin()));
        let y_b = (f[4] - xa * f[1]) / (xb - xa);
        let z_b = (-f[3] - xa * f[2]) / (xb - xa);
        let mut forces = [0.0; 8];
        for (b, [y, z]) in [[f[1] - y_b, f[2] - z_b], [y_b, z_b]].into_iter().enumerate() {
            let particular = ALPHA.map(|a| 2.0 / 3.0 * (a.sin() * y + a.cos() * z));
            let lift = particular.iter().fold(f64::NEG_INFINITY, |c, p| c.max(least[b] - p));
            (0..3).for_each(|k| forces[3 * b + k] = particular[k] + lift);
        }
        forces[6] = least[2] + f[0].max(0.0);
        forces[7] = least[2] + (-f[0]).max(0.0);
        let gaps = self.gaps(q);
        std::array::from_fn(|k| gaps[k].max(1e-5) * (forces[k].max(0.0) / self.guess[k]).sqrt())
    }

    /// The readings A.Ym, A.Zm, B.Ym, B.Zm, Xm, and the currents held over the past interval. Fourth-order Runge–Kutta, ten steps per sample;
    /// tracking poles at 800 and 1000 rad/s, observer poles at about 3500 rad/s.
    pub fn run(&self) -> Vec<EstimatorInputOf<5, 8>> {
        const SUBSTEPS: usize = 10;
        let (ts, w, m) = (STEP_S, self.omega(), self.inertia());
        let pole = 1.0 - (-3500.0 * ts).exp();
        let gains = [3.0 * pole, (3.0 * pole * pole - pole.powi(3) / 2.0) / ts, pole.powi(3) / (ts * ts)];
        let spin = |v: &Five| [0.0, 0.0, 0.0, -self.polar_kgm2 * w * v[4], self.polar_kgm2 * w * v[3]];
        let [q, v, a] = self.reference(0.0);
        let mut x = joined([q, v]);
        let mut observed: [[f64; 3]; 5] = std::array::from_fn(|j| [q[j], v[j], 0.0]);
        let mut force: Five = std::array::from_fn(|j| m[j] * a[j]);
        let mut current = self.allocate(&force, &q, 0.0);
        let mut before = current;
        let mut noise = Random::new(self.seed);
        let mut samples = Vec::with_capacity(self.samples);
        for n in 0..self.samples {
            let t = n as f64 * ts;
            let [position, _] = halves(&x);
            let position_m = self.readings(&position).map(|r| r + self.noise.0 * noise.normal());
            let current_a = before.map(|i| i + self.noise.1 * noise.normal());
            let (theta_rad, omega_rad_s, enable) = (w * t, w, true);
            samples.push(EstimatorInputOf {
                position_m,
                current_a,
                theta_rad,
                omega_rad_s,
                enable,
                ..Default::default()
            });
            let measured = self.coordinates(&position_m);
            let (at, [_, _, wanted]) = (self.reference(t + ts), self.reference(t + 1.5 * ts));
            let gyroscopic = spin(&at[1]);
            let (mut next, mut predicted) = ([0.0; 5], [0.0; 5]);
            for j in 0..5 {
                let e = measured[j] - observed[j][0];
                let [o0, o1, o2]: [f64; 3] = std::array::from_fn(|k| observed[j][k] + gains[k] * e);
                let accel = o2 + (force[j] + gyroscopic[j]) / m[j];
                observed[j] = [o0 + ts * o1 + ts * ts / 2.0 * accel, o1 + ts * accel, o2];
                let [o0, o1, o2] = observed[j];
                next[j] = m[j] * (wanted[j] - 1800.0 * (o1 - at[1][j]) - 8e5 * (o0 - at[0][j]) - o2) - gyroscopic[j];
                predicted[j] = o0 + ts / 2.0 * o1;
            }
            let after = self.allocate(&next, &predicted, t + 1.5 * ts);
            let h = ts / SUBSTEPS as f64;
            for sub in 0..SUBSTEPS {
                x = runge_kutta(&x, t + sub as f64 * h, h, |t, x| {
                    let [q, v] = halves(x);
                    joined([v, self.acceleration(&q, &v, &current, w * t)])
                });
            }
            (before, current, force) = (current, after, next);
        }
        samples
    }
}

/// Coordinates and rates of a state.
fn halves(x: &[f64; 10]) -> [Five; 2] {
    std::array::from_fn(|d| std::array::from_fn(|j| x[5 * d + j]))
}

fn joined(halves: [Five; 2]) -> [f64; 10] {
    std::array::from_fn(|n| halves[n / 5][n % 5])
}
