//! The estimator on data of a small simulator of its own: rotor, three magnets, PD tracking with the true state.

use magnetic_bearing::model::estimator::{
    CONDITION_LIMIT, Estimator, EstimatorConfig, EstimatorInput, EstimatorOutput, EstimatorState, Hold, Method, Reason,
};
use magnetic_bearing::model::regression::CONDITION_CAP;
use std::f64::consts::PI;

/// One instant of the data; the two currents are those before and after it (the same if they are continuous).
#[derive(Clone, Debug)]
struct Sample {
    position_m: [f64; 2],
    before_a: [f64; 3],
    after_a: [f64; 3],
    theta_rad: f64,
}

#[derive(Clone, Debug)]
struct Scenario {
    m_kg: f64,
    gap_m: f64,
    alpha_rad: [f64; 3],
    lambda: [f64; 3],
    /// What the controller believes.
    lambda_controller: [f64; 3],
    omega_rad_s: f64,
    radius_m: [f64; 2],
    step_s: f64,
    /// Held over a sample, or a continuous function of the state.
    held: bool,
    /// Constant force (y, z), N.
    load_n: [f64; 2],
    /// Amplitude of a force in z, sin ωt, N.
    sine_n: f64,
    /// Unbalance, kg·m and rad.
    unbalance: (f64, f64),
    /// Deviation of the start from the reference: position (m), velocity (m/s), both axes.
    start_off: (f64, f64),
    samples: usize,
    /// Least magnet force, N.
    f0_n: f64,
    /// Standard deviations of the sensors, m and A.
    noise: (f64, f64),
    seed: u64,
}

/// Normal numbers, the sum of twelve uniform ones, from the generator SplitMix64.
struct Noise(u64);

impl Noise {
    fn draw(&mut self) -> f64 {
        let mut sum = -6.0;
        for _ in 0..12 {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = self.0;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            sum += ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64;
        }
        sum
    }
}

impl Default for Scenario {
    fn default() -> Self {
        Self {
            m_kg: 6.7,
            gap_m: 5e-4,
            alpha_rad: [PI, -PI / 3.0, PI / 3.0],
            lambda: [1.8e-6, 2.0e-6, 2.2e-6],
            lambda_controller: [1.8e-6, 2.0e-6, 2.2e-6],
            omega_rad_s: 100.0 * PI,
            radius_m: [30e-6, 70e-6],
            step_s: 1e-4,
            held: true,
            load_n: [0.0; 2],
            sine_n: 0.0,
            unbalance: (0.0, 0.0),
            start_off: (0.0, 0.0),
            samples: 1001,
            f0_n: 20.0,
            noise: (0.0, 0.0),
            seed: 1,
        }
    }
}

impl Scenario {
    fn gaps(&self, x: &[f64; 4]) -> [f64; 3] {
        self.alpha_rad.map(|a| self.gap_m - a.sin() * x[0] - a.cos() * x[1])
    }

    /// Flatness-based tracking with both poles at 1000 rad/s; `p_n` is the perturbation to be compensated.
    fn currents(&self, t: f64, x: &[f64; 4], p_n: [f64; 2]) -> ([f64; 2], [f64; 3]) {
        const K0: f64 = 1e6;
        const K1: f64 = 2e3;
        let w = self.omega_rad_s;
        let (s, c) = (w * t).sin_cos();
        let [ry, rz] = self.radius_m;
        let reference = [ry * c, rz * s];
        let velocity = [-ry * w * s, rz * w * c];
        let force: [f64; 2] = std::array::from_fn(|k| {
            let accel = -w * w * reference[k] - K1 * (x[k + 2] - velocity[k]) - K0 * (x[k] - reference[k]);
            self.m_kg * accel - p_n[k]
        });
        // The magnet forces with the sum `force` are a particular solution plus a multiple of the null vector, which
        // is positive as long as the magnets surround the rotor; the least of them is F_0.
        let sine = |i: usize, k: usize| (self.alpha_rad[k] - self.alpha_rad[i]).sin();
        let null = [sine(1, 2), sine(2, 0), sine(0, 1)];
        let [a2, a3] = [self.alpha_rad[1], self.alpha_rad[2]];
        let particular = [
            0.0,
            (force[1] * a3.sin() - force[0] * a3.cos()) / null[0],
            (force[0] * a2.cos() - force[1] * a2.sin()) / null[0],
        ];
        let lift = (0..3).map(|k| (self.f0_n - particular[k]) / null[k]).fold(f64::NEG_INFINITY, f64::max);
        let gaps = self.gaps(x);
        let currents = std::array::from_fn(|k| {
            gaps[k] * ((particular[k] + lift * null[k]).max(0.0) / self.lambda_controller[k]).sqrt()
        });
        (force, currents)
    }

    fn rate(&self, t: f64, x: &[f64; 4], held: Option<&[f64; 3]>) -> [f64; 4] {
        let i = held.copied().unwrap_or_else(|| self.currents(t, x, self.load_n).1);
        let gaps = self.gaps(x);
        let w = self.omega_rad_s;
        let (u, phi) = self.unbalance;
        let mut f = [
            self.load_n[0] + u * w * w * (w * t + phi).cos(),
            self.load_n[1] + u * w * w * (w * t + phi).sin() + self.sine_n * (w * t).sin(),
        ];
        for k in 0..3 {
            let pull = self.lambda[k] * (i[k] / gaps[k]).powi(2);
            f[0] += pull * self.alpha_rad[k].sin();
            f[1] += pull * self.alpha_rad[k].cos();
        }
        [x[2], x[3], f[0] / self.m_kg, f[1] / self.m_kg]
    }

    /// Runge–Kutta of order 4 with substeps of a tenth of a sample: error below 1e-12 m.
    ///
    /// With held currents the loop is that of a sampled-data controller: an observer of position, velocity and
    /// perturbation with its poles at 4000 rad/s predicts one sample ahead, and the current computed from
    /// the samples up to t_j acts from t_{j+1} on.
    fn run(&self) -> Vec<Sample> {
        const SUBSTEPS: usize = 10;
        let w = self.omega_rad_s;
        let (dx, dv) = self.start_off;
        let mut x = [self.radius_m[0] + dx, -dx, dv, self.radius_m[1] * w - dv];
        let mut observed = x;
        let mut p_hat = [0.0; 2];
        let ts = self.step_s;
        let q = 1.0 - (-4000.0 * ts).exp();
        let gains = [3.0 * q, (3.0 * q * q - q * q * q / 2.0) / ts, self.m_kg * q * q * q / (ts * ts)];
        let (mut force, mut after) = self.currents(0.0, &x, self.load_n);
        let mut before = after;
        let h = ts / SUBSTEPS as f64;
        let mut noise = Noise(self.seed);
        let mut out = Vec::with_capacity(self.samples);
        for j in 0..self.samples {
            let t = j as f64 * ts;
            if !self.held {
                after = self.currents(t, &x, self.load_n).1;
                before = after;
            }
            let measured = [x[0] + self.noise.0 * noise.draw(), x[1] + self.noise.0 * noise.draw()];
            let [before_a, after_a] = [before, after].map(|i| i.map(|i| i + self.noise.1 * noise.draw()));
            out.push(Sample { position_m: measured, before_a, after_a, theta_rad: w * t });
            let held = self.held.then_some(&after);
            for sub in 0..SUBSTEPS {
                let t = t + sub as f64 * h;
                let plus =
                    |x: &[f64; 4], d: &[f64; 4], h: f64| -> [f64; 4] { std::array::from_fn(|n| x[n] + h * d[n]) };
                let k1 = self.rate(t, &x, held);
                let k2 = self.rate(t + h / 2.0, &plus(&x, &k1, h / 2.0), held);
                let k3 = self.rate(t + h / 2.0, &plus(&x, &k2, h / 2.0), held);
                let k4 = self.rate(t + h, &plus(&x, &k3, h), held);
                x = std::array::from_fn(|n| x[n] + h / 6.0 * (k1[n] + 2.0 * k2[n] + 2.0 * k3[n] + k4[n]));
            }
            if self.held {
                for axis in 0..2 {
                    let error = measured[axis] - observed[axis];
                    let accel = (force[axis] + p_hat[axis]) / self.m_kg;
                    observed[axis] += ts * observed[axis + 2] + 0.5 * ts * ts * accel + gains[0] * error;
                    observed[axis + 2] += ts * accel + gains[1] * error;
                    p_hat[axis] += gains[2] * error;
                }
                before = after;
                (force, after) = self.currents(t + ts, &observed, p_hat);
            }
        }
        out
    }

    fn config(&self, method: Method, hold: Hold) -> EstimatorConfig {
        EstimatorConfig {
            m_kg: self.m_kg,
            gap_m: self.gap_m,
            alpha_rad: self.alpha_rad,
            step_s: self.step_s,
            method,
            hold,
            ..EstimatorConfig::default()
        }
    }

    fn input(&self, sample: &Sample, hold: Hold) -> EstimatorInput {
        EstimatorInput {
            position_m: sample.position_m,
            current_a: if hold == Hold::HeldBefore { sample.before_a } else { sample.after_a },
            theta_rad: sample.theta_rad,
            omega_rad_s: self.omega_rad_s,
            enable: true,
            reset: false,
        }
    }

    /// All outputs of an estimator on this scenario.
    fn identify(&self, config: EstimatorConfig) -> Vec<EstimatorOutput> {
        let hold = config.hold;
        let estimator = Estimator::new(config).expect("a good configuration");
        let mut state = estimator.start();
        self.run().iter().map(|s| estimator.sample(&mut state, &self.input(s, hold))).collect()
    }

    /// Errors of λ̂ after the last sample, %.
    fn errors_percent(&self, method: Method, hold: Hold) -> [f64; 3] {
        let outputs = self.identify(self.config(method, hold));
        let last = outputs.last().expect("samples");
        let errors = self.error_percent(&last.lambda_hat);
        println!(
            "{method:?} {hold:?}: {errors:.4?} %, condition {:.1}, residual {:.2e}, {:?}, load {:.3?} N, unbalance {:.4e} kg.m {:.4} rad",
            last.condition, last.residual, last.reason, last.load_n, last.unbalance_kg_m, last.unbalance_phase_rad
        );
        errors
    }

    fn error_percent(&self, lambda: &[f64; 3]) -> [f64; 3] {
        std::array::from_fn(|k| 100.0 * (lambda[k] / self.lambda[k] - 1.0))
    }
}

fn largest(errors: [f64; 3]) -> f64 {
    errors.iter().fold(0.0, |m, e| m.max(e.abs()))
}

#[test]
fn explore() {
    let quiet = Scenario::default();
    for method in [Method::LeastSquares, Method::Unbalance, Method::Paper, Method::PaperLiteral] {
        for hold in [Hold::HeldBefore, Hold::HeldAfter, Hold::Linear] {
            quiet.errors_percent(method, hold);
        }
    }
    let _ = Scenario { ..quiet.clone() };
    println!("wrong: before read as after");
    let estimator = Estimator::new(quiet.config(Method::LeastSquares, Hold::HeldAfter)).unwrap();
    for method in [Method::LeastSquares, Method::Paper] {
        let estimator = Estimator::new(EstimatorConfig { method, ..estimator.config().clone() }).unwrap();
        let mut state = estimator.start();
        for s in quiet.run() {
            estimator.sample(&mut state, &quiet.input(&s, Hold::HeldBefore));
        }
        println!("{method:?} {:?} {:?}", quiet.error_percent(&state.output().lambda_hat), state.output());
    }
    println!("continuous");
    let smooth = Scenario { held: false, ..quiet.clone() };
    for method in [Method::LeastSquares, Method::Unbalance, Method::Paper] {
        smooth.errors_percent(method, Hold::Linear);
        smooth.errors_percent(method, Hold::HeldBefore);
    }
    println!("paper");
    for controller in [[4e-6; 3], [1.8e-6, 2.0e-6, 2.2e-6]] {
        let paper = Scenario { load_n: [0.0, 10.0], sine_n: 2.0, lambda_controller: controller, ..quiet.clone() };
        for method in [Method::LeastSquares, Method::Unbalance, Method::Paper, Method::PaperLiteral] {
            paper.errors_percent(method, Hold::HeldBefore);
        }
    }
    for sine_n in [0.0, 2.0, 10.0] {
        for f0_n in [10.0, 20.0, 40.0] {
            for controller in [[4e-6; 3], [1.8e-6, 2.0e-6, 2.2e-6]] {
                let long = Scenario {
                    samples: 10001,
                    load_n: [0.0, 10.0],
                    sine_n,
                    f0_n,
                    lambda_controller: controller,
                    ..quiet.clone()
                };
                let o = long.identify(long.config(Method::PaperLiteral, Hold::HeldBefore));
                let worst = |a: usize, b: usize| {
                    o[a..b].iter().map(|o| largest(long.error_percent(&o.lambda_hat))).fold(0.0, f64::max)
                };
                let changes = o[2000..4000].windows(2).filter(|w| w[0].determinant * w[1].determinant < 0.0).count();
                let d: f64 = o[2000..4000].iter().map(|o| o.determinant).sum();
                let da: f64 = o[2000..4000].iter().map(|o| o.determinant.abs()).sum();
                println!(
                    "literal sine {sine_n} f0 {f0_n} {controller:?}: to 0.2 {:.3} to 0.4 {:.3} to 1 {:.3}, sign changes in 10 rev {changes}, mean/mean abs {:.4}",
                    worst(201, 2000),
                    worst(2000, 4000),
                    worst(4000, 10001),
                    d / da
                );
            }
        }
    }
    println!("unbalance 20 N");
    let w2 = quiet.omega_rad_s * quiet.omega_rad_s;
    let unbalanced = Scenario { load_n: [10.0, -20.0], unbalance: (20.0 / w2, 0.7), ..quiet.clone() };
    println!("U = {:e}", 20.0 / w2);
    for method in [Method::LeastSquares, Method::Unbalance, Method::Paper] {
        unbalanced.errors_percent(method, Hold::HeldBefore);
    }
    let u5 = Scenario { unbalance: (5.0 / w2, 0.7), ..quiet.clone() };
    for method in [Method::LeastSquares, Method::Unbalance, Method::Paper] {
        u5.errors_percent(method, Hold::HeldBefore);
    }
    println!("circle");
    let circle = Scenario { radius_m: [50e-6, 50e-6], ..unbalanced.clone() };
    for method in [Method::LeastSquares, Method::Unbalance, Method::Paper] {
        circle.errors_percent(method, Hold::HeldBefore);
    }
    let noisy = Scenario { noise: (1e-7, 1e-2), ..circle.clone() };
    noisy.errors_percent(Method::Unbalance, Hold::HeldBefore);
    let noisy = Scenario { noise: (1e-7, 1e-2), ..unbalanced.clone() };
    noisy.errors_percent(Method::Unbalance, Hold::HeldBefore);
    noisy.errors_percent(Method::LeastSquares, Hold::HeldBefore);
    let noisy = Scenario { noise: (1e-7, 1e-2), ..quiet.clone() };
    noisy.errors_percent(Method::LeastSquares, Hold::HeldBefore);
    noisy.errors_percent(Method::Paper, Hold::HeldBefore);
    let rest = Scenario { radius_m: [0.0, 0.0], unbalance: (0.0, 0.0), noise: (1e-7, 1e-2), ..unbalanced.clone() };
    rest.errors_percent(Method::LeastSquares, Hold::HeldBefore);
    let rest = Scenario { radius_m: [0.0, 0.0], unbalance: (0.0, 0.0), ..unbalanced.clone() };
    for method in [Method::LeastSquares, Method::Unbalance, Method::Paper] {
        rest.errors_percent(method, Hold::HeldBefore);
    }
}
