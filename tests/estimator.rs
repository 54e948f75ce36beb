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
            contact: false,
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

/// Error of λ̂ at 0.1 s without perturbation and with the right hold, %: what is left is the parabola through
/// 1/gap² within a hold interval.
const EXACT_DATA_PERCENT: f64 = 0.001;

/// Error of λ̂ at 0.1 s in the paper's scenario, %: the paper shows 3.6 with another perturbation of this kind.
const PAPER_SCENARIO_PERCENT: f64 = 5.0;

/// Least error, %, that a wrong hold must cause with the paper's method to show that the hold matters.
const WRONG_HOLD_PERCENT: f64 = 5.0;

fn assert_below(what: &str, errors: [f64; 3], limit: f64) {
    assert!(largest(errors) < limit, "{what}: errors {errors:?} %, limit {limit} %");
}

fn unbalanced() -> Scenario {
    let newton_at_50_hz = 1.0 / (100.0 * PI).powi(2);
    Scenario { load_n: [10.0, -20.0], unbalance: (20.0 * newton_at_50_hz, 0.7), ..Scenario::default() }
}

#[test]
fn every_method_is_exact_without_perturbation() {
    let quiet = Scenario::default();
    for method in [Method::PaperLiteral, Method::Paper, Method::LeastSquares, Method::Unbalance] {
        for hold in [Hold::HeldBefore, Hold::HeldAfter] {
            assert_below(&format!("{method:?} {hold:?}"), quiet.errors_percent(method, hold), EXACT_DATA_PERCENT);
        }
    }
    let smooth = Scenario { held: false, ..quiet };
    for method in [Method::Paper, Method::LeastSquares, Method::Unbalance] {
        assert_below(&format!("{method:?}"), smooth.errors_percent(method, Hold::Linear), EXACT_DATA_PERCENT);
    }
}

#[test]
fn wrong_hold_costs_and_the_residual_shows_it() {
    let quiet = Scenario::default();
    let errors = quiet.errors_percent(Method::Paper, Hold::Linear);
    assert!(largest(errors) > WRONG_HOLD_PERCENT, "held currents read as continuous: {errors:?} %");

    let data = quiet.run();
    let read = |hold: Hold, method: Method| {
        let estimator = Estimator::new(quiet.config(method, hold)).expect("a good configuration");
        let mut state = estimator.start();
        for sample in &data {
            // The samples are those of `HeldBefore`, whatever the estimator believes.
            estimator.sample(&mut state, &quiet.input(sample, Hold::HeldBefore));
        }
        state.output().clone()
    };
    let late = quiet.error_percent(&read(Hold::HeldAfter, Method::Paper).lambda_hat);
    assert!(largest(late) > WRONG_HOLD_PERCENT, "a sample late: {late:?} %");
    let [right, half, full] =
        [Hold::HeldBefore, Hold::Linear, Hold::HeldAfter].map(|hold| read(hold, Method::LeastSquares).residual);
    println!("residual {right:.1e} with the right hold, {half:.1e} half a sample off, {full:.1e} a sample off");
    assert!(right < 1e-5 && half > 1e-2 && full > 1.5 * half, "{right:e}, {half:e}, {full:e}");
}

/// Method section 5, the loop of section 7 without sensor noise.
#[test]
fn paper_scenario() {
    let paper = Scenario { load_n: [0.0, 10.0], sine_n: 2.0, lambda_controller: [4e-6; 3], ..Scenario::default() };
    assert_below("paper", paper.errors_percent(Method::Paper, Hold::HeldBefore), PAPER_SCENARIO_PERCENT);

    let long = Scenario { samples: 4001, ..paper };
    let outputs = long.identify(long.config(Method::PaperLiteral, Hold::HeldBefore));
    let worst = outputs.iter().skip(1000).map(|o| largest(long.error_percent(&o.lambda_hat))).fold(0.0, f64::max);
    println!("to the letter: {worst:.0} %");
    assert!(worst > 100.0, "P(20) to the letter leaves the truth by {worst} % within 0.4 s, more than 100 % is known");
    let revolutions = outputs[2000..4000].windows(2);
    let changes = revolutions.filter(|pair| pair[0].determinant * pair[1].determinant < 0.0).count();
    // An ellipse is symmetric about two axes, so the changes of sign come in pairs of pairs.
    assert!((35..=45).contains(&changes), "{changes} changes of the sign of det D in 10 revolutions, 4 in each known");
}

#[test]
fn constant_load_changes_nothing_and_is_measured() {
    let loaded = Scenario { load_n: [10.0, -20.0], ..Scenario::default() };
    for method in [Method::Paper, Method::LeastSquares, Method::Unbalance] {
        let outputs = loaded.identify(loaded.config(method, Hold::HeldBefore));
        let last = outputs.last().expect("samples");
        assert_below(&format!("{method:?}"), loaded.error_percent(&last.lambda_hat), EXACT_DATA_PERCENT);
        for (got, wanted) in last.load_n.iter().zip(loaded.load_n) {
            assert!((got - wanted).abs() < 1e-3, "{method:?}: load {got} N, wanted {wanted} N within 1 mN");
        }
    }
}

#[test]
fn initial_conditions_do_not_matter() {
    for start_off in [(20e-6, 0.0), (0.0, 0.02), (-15e-6, 0.01)] {
        let scenario = Scenario { start_off, ..Scenario::default() };
        let errors = scenario.errors_percent(Method::LeastSquares, Hold::HeldBefore);
        assert_below(&format!("{start_off:?}"), errors, EXACT_DATA_PERCENT);
    }
}

/// Another rotor, gap, angles, magnets and speed; a revolution is 158.7 samples, the window 159.
#[test]
fn another_bearing() {
    let other = Scenario {
        m_kg: 3.4,
        gap_m: 4e-4,
        alpha_rad: [PI + 0.15, -PI / 3.0 + 0.15, PI / 3.0 + 0.15],
        lambda: [3.1e-6, 2.7e-6, 2.4e-6],
        lambda_controller: [4e-6; 3],
        omega_rad_s: 126.0 * PI,
        ..Scenario::default()
    };
    for method in [Method::Paper, Method::LeastSquares, Method::Unbalance] {
        let config = EstimatorConfig { window_s: 0.0159, epsilon_s: 0.0159, ..other.config(method, Hold::HeldBefore) };
        let last = other.identify(config).pop().expect("samples");
        println!("{method:?}: {:.5?} %", other.error_percent(&last.lambda_hat));
        assert_below(&format!("{method:?}"), other.error_percent(&last.lambda_hat), EXACT_DATA_PERCENT);
    }
}

#[test]
fn unbalance_is_identified_with_lambda() {
    let scenario = unbalanced();
    let outputs = scenario.identify(scenario.config(Method::Unbalance, Hold::HeldBefore));
    for (instant, limit_percent) in [(300, 0.01), (1000, EXACT_DATA_PERCENT)] {
        let at = &outputs[instant];
        let (u, phi) = scenario.unbalance;
        let u_error = 100.0 * (at.unbalance_kg_m / u - 1.0);
        println!("{instant}: {:.5?} %, U {u_error:.5} %", scenario.error_percent(&at.lambda_hat));
        assert!(at.valid, "{:?}", at.reason);
        assert_below("lambda", scenario.error_percent(&at.lambda_hat), limit_percent);
        assert!(u_error.abs() < limit_percent, "unbalance: error {u_error} %, limit {limit_percent} %");
        assert!((at.unbalance_phase_rad - phi).abs() < 1e-4, "phase {} rad, wanted {phi}", at.unbalance_phase_rad);
    }
    let ignored = scenario.errors_percent(Method::Paper, Hold::HeldBefore);
    assert!(
        largest(ignored) > 20.0,
        "the paper's method with an unbalance of 20 N: {ignored:?} %, above 20 % is known"
    );
}

/// 0.1 µm and 10 mA; tests/uncertainty.rs looks at the figures with more seeds and the bound beside them.
#[test]
fn noise_costs_what_is_known() {
    const SEEDS: u64 = 8;
    const LIMITS_PERCENT: [f64; 3] = [0.2, 0.45, 0.5];
    let mut squares = [0.0; 3];
    for seed in 1..=SEEDS {
        let noisy = Scenario { noise: (1e-7, 1e-2), seed, ..unbalanced() };
        let last = noisy.identify(noisy.config(Method::Unbalance, Hold::HeldBefore)).pop().expect("samples");
        assert!(last.valid, "seed {seed}: {:?}", last.reason);
        for (square, error) in squares.iter_mut().zip(noisy.error_percent(&last.lambda_hat)) {
            *square += error * error / SEEDS as f64;
        }
    }
    let rms = squares.map(f64::sqrt);
    println!("rms over {SEEDS} seeds: {rms:.3?} %");
    for k in 0..3 {
        assert!(rms[k] < LIMITS_PERCENT[k], "lambda[{}]: rms {} %, limit {} %", k + 1, rms[k], LIMITS_PERCENT[k]);
    }
}

/// On a circle the unbalance is not identifiable, at rest nothing is: the estimator says so.
#[test]
fn says_when_it_cannot_know() {
    for noise in [(0.0, 0.0), (1e-7, 1e-2)] {
        let circle = Scenario { radius_m: [50e-6; 2], noise, ..unbalanced() };
        let last = circle.identify(circle.config(Method::Unbalance, Hold::HeldBefore)).pop().expect("samples");
        assert_eq!(last.reason, Reason::Singular, "condition {}", last.condition);
        assert!(last.condition > CONDITION_LIMIT, "condition {}", last.condition);
    }

    let estimator = Estimator::new(EstimatorConfig::default()).expect("a good configuration");
    let mut state = estimator.start();
    for current_a in [[0.0; 3], [2.0, 2.0, 2.0]] {
        let rest = EstimatorInput {
            position_m: [1e-5, -2e-5],
            current_a,
            theta_rad: 0.0,
            omega_rad_s: 0.0,
            enable: true,
            contact: false,
            reset: false,
        };
        for _ in 0..600 {
            estimator.sample(&mut state, &rest);
        }
        let output = estimator.sample(&mut state, &rest);
        assert!(!output.valid);
        assert_eq!(output.lambda_hat, [4e-6; 3]);
        if current_a == [0.0; 3] {
            assert_eq!((output.reason, output.condition), (Reason::Singular, CONDITION_CAP));
        }
    }

    let noisy_rest = Scenario { radius_m: [0.0; 2], noise: (1e-7, 1e-2), ..Scenario::default() };
    let outputs = noisy_rest.identify(noisy_rest.config(Method::LeastSquares, Hold::HeldBefore));
    assert_eq!(outputs.last().map(|o| o.reason), Some(Reason::Uncertain));
}

#[test]
fn the_estimate_is_lambda0_until_epsilon() {
    let quiet = Scenario { samples: 500, ..Scenario::default() };
    let config = EstimatorConfig { epsilon_s: 0.03, ..quiet.config(Method::LeastSquares, Hold::HeldBefore) };
    for (j, output) in quiet.identify(config.clone()).iter().enumerate() {
        assert_eq!(output.valid, j >= 300, "sample {j}: {:?}", output.reason);
        if j < 300 {
            assert_eq!(output.lambda_hat, config.lambda0_nm2_a2);
        }
    }
    let outputs = quiet.identify(quiet.config(Method::LeastSquares, Hold::HeldBefore));
    assert_eq!(outputs.iter().position(|o| o.valid), Some(200), "201 samples span 200 intervals");
}

#[test]
fn reset_equals_a_fresh_state() {
    let scenario = Scenario { samples: 700, ..Scenario::default() };
    let data = scenario.run();
    for method in [Method::Paper, Method::Unbalance] {
        let estimator = Estimator::new(scenario.config(method, Hold::HeldAfter)).expect("a good configuration");
        let mut used = estimator.start();
        for sample in &data[..333] {
            estimator.sample(&mut used, &scenario.input(sample, Hold::HeldAfter));
        }
        let mut fresh = estimator.start();
        for sample in &data {
            // The level stays high: only its rising edge counts.
            let input = EstimatorInput { reset: true, ..scenario.input(sample, Hold::HeldAfter) };
            assert_eq!(estimator.sample(&mut used, &input), estimator.sample(&mut fresh, &input));
        }
        assert!(fresh.output().valid);
    }
}

#[test]
fn gaps_in_the_data_start_the_window_afresh() {
    let scenario = Scenario { samples: 700, ..Scenario::default() };
    let data = scenario.run();
    let good = |j: usize| scenario.input(&data[j], Hold::HeldBefore);
    let spoilt: [fn(&mut EstimatorInput); 6] = [
        |input| input.position_m[1] = f64::NAN,
        |input| input.current_a[2] = f64::INFINITY,
        |input| input.current_a[0] = 1e200,
        |input| input.position_m[1] = -6e-4,
        |input| input.theta_rad = f64::NAN,
        |input| input.omega_rad_s = f64::NEG_INFINITY,
    ];
    let estimator = Estimator::new(scenario.config(Method::Unbalance, Hold::HeldBefore)).expect("a good configuration");
    let disable: fn(&mut EstimatorInput) = |input| input.enable = false;
    for (spoil, reason) in spoilt.iter().map(|spoil| (spoil, Reason::BadSample)).chain([(&disable, Reason::Disabled)]) {
        let mut state = estimator.start();
        let mut before = state.output().clone();
        for j in 0..data.len() {
            let mut input = good(j);
            if j == 400 {
                before = state.output().clone();
                spoil(&mut input);
            }
            let output = estimator.sample(&mut state, &input);
            let wanted = match j {
                0..200 => Reason::Filling,
                // The first windows of this motion do not yet tell the unbalance from the magnets.
                200..230 if output.reason == Reason::Singular => continue,
                400 => reason,
                401..601 => Reason::Filling,
                _ => Reason::Valid,
            };
            assert_eq!(output.reason, wanted, "sample {j}");
            if (400..601).contains(&j) {
                assert_eq!(output.lambda_hat, before.lambda_hat, "the last valid estimate stays");
            }
        }
        let errors = scenario.error_percent(&state.output().lambda_hat);
        assert_below("after the gap", errors, EXACT_DATA_PERCENT);
    }
    // The other methods do not look at the angle.
    let estimator = Estimator::new(scenario.config(Method::LeastSquares, Hold::HeldBefore)).expect("good");
    let mut state = estimator.start();
    let output = estimator.sample(&mut state, &EstimatorInput { theta_rad: f64::NAN, ..good(0) });
    assert_eq!(output.reason, Reason::Filling);
}

#[test]
fn outputs_are_finite_on_wild_inputs() {
    let config = EstimatorConfig { window_s: 8e-4, epsilon_s: 8e-4, ..EstimatorConfig::default() };
    let mut noise = Noise(7);
    for method in [Method::PaperLiteral, Method::Paper, Method::LeastSquares, Method::Unbalance] {
        for hold in [Hold::HeldBefore, Hold::HeldAfter, Hold::Linear] {
            let estimator = Estimator::new(EstimatorConfig { method, hold, ..config.clone() }).expect("good");
            let mut state = estimator.start();
            for j in 0..5000 {
                let mut wild = |usual: f64, rare: i32| {
                    let exponent = if noise.draw() > 2.5 { (noise.draw() * f64::from(rare)) as i32 } else { 0 };
                    usual * noise.draw() * 10.0_f64.powi(exponent)
                };
                let input = EstimatorInput {
                    position_m: [wild(1e-4, 1), wild(1e-4, 1)],
                    current_a: [wild(3.0, 60), wild(3.0, 20), wild(3.0, 20)],
                    theta_rad: wild(10.0, 100),
                    omega_rad_s: wild(300.0, 30),
                    enable: j % 97 != 0,
                    contact: false,
                    reset: j % 501 == 0,
                };
                let o = estimator.sample(&mut state, &input);
                let numbers = [o.condition, o.residual, o.determinant, o.unbalance_kg_m, o.unbalance_phase_rad];
                let all = o.lambda_hat.iter().chain(&o.lambda_raw).chain(&o.load_n).chain(&numbers);
                assert!(all.clone().all(|x| x.is_finite()), "{method:?} {hold:?}, sample {j}: {o:?}");
                assert!(!o.valid || o.lambda_hat.iter().all(|l| *l > 0.0), "{o:?}");
            }
        }
    }
}

#[test]
fn a_state_read_back_continues_bit_for_bit() {
    let scenario = Scenario { samples: 600, ..Scenario::default() };
    let data = scenario.run();
    for (method, hold) in [(Method::Unbalance, Hold::HeldAfter), (Method::PaperLiteral, Hold::Linear)] {
        let estimator = Estimator::new(scenario.config(method, hold)).expect("a good configuration");
        let mut state = estimator.start();
        for sample in &data[..333] {
            estimator.sample(&mut state, &scenario.input(sample, hold));
        }
        let text = toml::to_string(&state).expect("serialisable");
        let mut back: EstimatorState = toml::from_str(&text).expect("readable");
        assert_eq!(back, state);
        for sample in &data[333..] {
            let input = scenario.input(sample, hold);
            assert_eq!(estimator.sample(&mut back, &input), estimator.sample(&mut state, &input));
        }
        assert_eq!(back, state);
    }
}

#[test]
fn a_foreign_state_is_refused_without_panic() {
    let scenario = Scenario { samples: 1, ..Scenario::default() };
    let input = scenario.input(&scenario.run()[0], Hold::HeldBefore);
    let estimator = Estimator::new(EstimatorConfig::default()).expect("a good configuration");
    let short = EstimatorConfig { window_s: 0.01, ..EstimatorConfig::default() };
    let mut state = Estimator::new(short).expect("a good configuration").start();
    assert!(!estimator.accepts(&state));
    assert_eq!(estimator.sample(&mut state, &input).reason, Reason::ForeignState);
}

#[test]
fn every_bad_parameter_is_named() {
    let good = EstimatorConfig::default();
    assert!(Estimator::new(good.clone()).is_ok());
    let names = |config: EstimatorConfig| -> Vec<String> {
        Estimator::new(config).map_or_else(|found| found.iter().map(|i| i.name.to_string()).collect(), |_| Vec::new())
    };
    type Case = (&'static str, fn(&mut EstimatorConfig, f64));
    let cases: [Case; 10] = [
        ("m", |c, x| c.m_kg = x),
        ("s", |c, x| c.gap_m = x),
        ("Ts", |c, x| c.step_s = x),
        ("Tf", |c, x| c.window_s = x),
        ("epsilon", |c, x| c.epsilon_s = x),
        ("lambda0[1]", |c, x| c.lambda0_nm2_a2[0] = x),
        ("lambda0[2]", |c, x| c.lambda0_nm2_a2[1] = x),
        ("lambda0[3]", |c, x| c.lambda0_nm2_a2[2] = x),
        ("filter.omega", |c, x| c.filter_omega_rad_s = x),
        ("filter.zeta", |c, x| c.filter_zeta = x),
    ];
    let mut all_bad = good.clone();
    for (name, set) in cases {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -1.0] {
            let mut config = good.clone();
            set(&mut config, value);
            assert_eq!(names(config), [name], "{name} = {value}");
        }
        set(&mut all_bad, f64::NAN);
    }
    all_bad.alpha_rad[1] = f64::NAN;
    assert_eq!(names(all_bad).len(), 11, "all findings at once");

    let refused = |change: fn(&mut EstimatorConfig), name: &str| {
        let mut config = good.clone();
        change(&mut config);
        assert_eq!(names(config), [name]);
    };
    refused(|c| c.alpha_rad[2] = f64::NAN, "alpha[3]");
    refused(|c| c.alpha_rad[1] = 2.0 * PI, "alpha[2]");
    refused(|c| c.alpha_rad[2] = c.alpha_rad[1], "alpha[3]");
    refused(|c| c.window_s = 7e-4, "Tf");
    refused(|c| c.window_s = 0.01005, "Tf");
    refused(|c| (c.window_s, c.epsilon_s) = (20.0, 20.0), "Tf");
    refused(|c| c.epsilon_s = 0.0199, "epsilon");
    // Decimal fractions are not binary ones: 0.0003/0.0001 is not 3.
    for intervals in 8..200 {
        let window_s = f64::from(intervals) * 1e-4;
        assert_eq!(names(EstimatorConfig { window_s, ..good.clone() }), [""; 0]);
    }
}
