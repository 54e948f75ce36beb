//! The method `predictionError` on data of a small simulator that shares no code with the program.

mod readings;
mod state;

use crate::prelude::*;

use crate::rotor::{Currents, Path, Rotor, largest, unbalanced};

/// Standard deviations of typical sensors, m and A.
const NOISE: (f64, f64) = (1e-7, 1e-2);

/// Limit of the error of a valid estimate, in standard deviations.
const CONFIDENT: f64 = 5.0;

/// A rotor with unbalance, load and noise.
fn noisy(seed: u64, samples: usize) -> Rotor {
    Rotor { noise: NOISE, seed, samples, ..unbalanced() }
}

fn config(rotor: &Rotor) -> EstimatorConfig {
    let hold = if rotor.currents == Currents::Held { Hold::HeldBefore } else { Hold::Linear };
    rotor.config(Method::PredictionError, hold)
}

fn with_noise(config: EstimatorConfig, (position_noise_m, current_noise_a): (f64, f64)) -> EstimatorConfig {
    EstimatorConfig { position_noise_m, current_noise_a, ..config }
}

/// Largest |error|/standard deviation of the valid estimates from a sample on, its sample, and the number of valid samples.
fn confidence(rotor: &Rotor, outputs: &[EstimatorOutput], from: usize) -> (f64, usize, usize) {
    let (mut worst, mut at, mut valid) = (0.0, 0, 0);
    for (j, output) in outputs.iter().enumerate().skip(from).filter(|(_, output)| output.valid) {
        let changed = rotor.change.filter(|(from_s, _)| j as f64 * STEP_S > from_s + 1e-9);
        let truth = changed.map_or(rotor.lambda, |(_, lambda)| lambda);
        valid += 1;
        for ((hat, truth), std) in output.lambda_hat.iter().zip(truth).zip(output.lambda_std_total) {
            let ratio = ((hat - truth) / std).abs();
            if ratio.is_nan() || ratio > worst {
                (worst, at) = (ratio, j);
            }
        }
    }
    (worst, at, valid)
}

/// Asserts that no valid estimate is off by [`CONFIDENT`] standard deviations; returns the number of valid samples.
#[track_caller]
fn assert_never_wrong(what: &str, rotor: &Rotor, outputs: &[EstimatorOutput]) -> usize {
    let (worst, at, valid) = confidence(rotor, outputs, 0);
    assert!(worst < CONFIDENT, "{what}: {worst:.2} standard deviations at sample {at}, limit {CONFIDENT}");
    valid
}

/// Outputs for these inputs, and the final state.
fn run(estimator: &Estimator, inputs: &[EstimatorInput]) -> (Vec<EstimatorOutput>, EstimatorState) {
    let mut state = estimator.start();
    let outputs = inputs.iter().map(|input| estimator.sample(&mut state, input)).collect();
    (outputs, state)
}

fn estimator(config: EstimatorConfig) -> Estimator {
    Estimator::new(config).expect("a good configuration")
}

/// Asserts that the last output is valid and within a limit in per cent.
#[track_caller]
fn assert_right(what: &str, rotor: &Rotor, outputs: &[EstimatorOutput], limit_percent: f64) {
    let last = outputs.last().expect("samples");
    let errors = rotor.error_percent(&last.lambda_hat);
    assert_eq!(last.verdict, Verdict::Valid, "{what}");
    assert!(largest(errors) < limit_percent, "{what}: errors {errors:?} %, limit {limit_percent} %");
}

/// Per cent, at 35 ms and at 0.2 s; twice as much where the noise estimate must first fall from 0.5 µm to rounding errors. Subtracting a
/// stated σ_i² from i² without noise changes λ by 10⁻⁵.
const EXACT_EARLY_PERCENT: f64 = 1e-2;
const EXACT_PERCENT: f64 = 1e-3;

#[test]
fn exact_data_give_exact_constants() {
    for (name, rotor) in [("unbalanced", unbalanced()), ("balanced", Rotor::default())] {
        for currents in [Currents::Held, Currents::Ramping] {
            let rotor = Rotor { currents, samples: 2001, ..rotor.clone() };
            for (noise, at) in [((0.0, 0.0), None), (NOISE, Some(350)), ((1e-9, 1e-3), Some(350))] {
                let outputs = rotor.identify(with_noise(config(&rotor), noise));
                let what = format!("{name}, {currents:?}, noise known {noise:?}");
                if let Some(at) = at {
                    assert_right(&format!("{what} at 35 ms"), &rotor, &outputs[..=at], EXACT_EARLY_PERCENT);
                }
                assert_right(&what, &rotor, &outputs, if noise == (1e-9, 1e-3) { 1.0 } else { 2.0 } * EXACT_PERCENT);
                let last = outputs.last().expect("samples");
                for (load, wanted) in last.load_n.iter().zip(rotor.load_n) {
                    assert!((load - wanted).abs() < 1e-3, "{what}: load {load} N, wanted {wanted} N within 1 mN");
                }
                let (u, phi) = rotor.unbalance;
                // 10 µg·m is a thousandth of an unbalance of 1 N.
                assert!((last.unbalance_kg_m[0] - u).abs() < 1e-8, "{what}: U {}", last.unbalance_kg_m[0]);
                let off = (last.unbalance_phase_rad[0] - phi).abs();
                assert!(u == 0.0 || off < 1e-4, "{what}: the unbalance is off by {off} rad");
            }
        }
    }
}

/// The field is linearised with first guesses wrong by a factor of two while the rotor moves the most; the other bearing has another gap,
/// other angles, magnets and speed.
#[test]
fn neither_start_nor_bearing_nor_sense_of_rotation_matter() {
    let off = |start_off| Rotor { start_off, samples: 2001, ..unbalanced() };
    let other = Rotor { lambda_controller: [5e-6; 3], samples: 2001, ..Rotor::another() };
    let backward = Rotor { omega_rad_s: -100.0 * PI, samples: 2001, ..unbalanced() };
    for (what, rotor, guess, limit) in [
        ("beside its place", off((20e-6, 0.0)), 4e-6, 8.0),
        ("too fast", off((0.0, 0.02)), 4e-6, 8.0),
        ("beside its place and too fast", off((-15e-6, 0.01)), 4e-6, 8.0),
        ("another bearing from small guesses", other.clone(), 1.3e-6, 10.0),
        ("another bearing from large guesses", other, 6e-6, 10.0),
        ("backward", backward, 4e-6, 2.0),
    ] {
        let outputs = rotor.identify(EstimatorConfig { lambda0_nm2_a2: [guess; 3], ..config(&rotor) });
        assert_right(what, &rotor, &outputs, limit * EXACT_PERCENT);
        let last = outputs.last().expect("samples");
        let (u, phi) = rotor.unbalance;
        below(&format!("{what}: unbalance, kg·m"), (last.unbalance_kg_m[0] - u).abs(), 2e-8);
        below(&format!("{what}: its angle, rad"), u * (last.unbalance_phase_rad[0] - phi).abs(), 1e-4 * u);
    }
}

/// Values held over an interval may belong to the sample at its end or at its start.
#[test]
fn both_holds_give_the_same_estimate() {
    let rotor = noisy(3, 2001);
    let [before, after] = [Hold::HeldBefore, Hold::HeldAfter]
        .map(|hold| rotor.identify(rotor.config(Method::PredictionError, hold)).pop().expect("samples"));
    assert!(before.valid && after.valid);
    for k in 0..3 {
        let off = (before.lambda_hat[k] / after.lambda_hat[k] - 1.0).abs();
        // Only one of them knows the first interval.
        assert!(off < 0.1 * before.lambda_std[k] / before.lambda_hat[k], "lambda[{}] is off by {off}", k + 1);
    }
}

/// A delay of one sample changes λ by more than 1 %; it is detected within 0.2 s.
#[test]
fn a_wrong_hold_is_detected() {
    let rotor = noisy(3, 5001);
    let inputs = rotor.inputs(Hold::HeldBefore);
    for noise in [NOISE, (0.0, 0.0)] {
        let [right, half, full] = [Hold::HeldBefore, Hold::Linear, Hold::HeldAfter].map(|hold| {
            let config = with_noise(rotor.config(Method::PredictionError, hold), noise);
            run(&estimator(config), &inputs).0
        });
        assert_never_wrong("right hold", &rotor, &right);
        assert!(right.last().expect("samples").valid);
        for outputs in [&half, &full] {
            let other = outputs[2000..].iter().find(|output| output.verdict != Verdict::Unexplained);
            assert!(other.is_none(), "known {noise:?}: {other:?}");
        }
    }
}

/// Continuous currents with noise: the mean error over the seeds is within three of its standard deviations.
#[test]
fn continuous_currents_leave_no_bias() {
    const SEEDS: u64 = 40;
    for noise in [(0.0, 0.0), NOISE] {
        let (mut sum, mut square, mut normalised) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        for seed in 1..=SEEDS {
            let rotor = Rotor { currents: Currents::Ramping, ..noisy(1000 + 31 * seed, 2001) };
            let outputs = rotor.identify(with_noise(config(&rotor), noise));
            assert_never_wrong(&format!("seed {seed}"), &rotor, &outputs);
            let last = outputs.last().expect("samples");
            assert!(last.valid, "{:?}", last.verdict);
            for k in 0..3 {
                let error = last.lambda_hat[k] / rotor.lambda[k] - 1.0;
                sum[k] += error;
                square[k] += error * error;
                normalised[k] += ((last.lambda_hat[k] - rotor.lambda[k]) / last.lambda_std[k]).powi(2);
            }
        }
        let n = SEEDS as f64;
        for k in 0..3 {
            let (mean, rms) = (sum[k] / n, (square[k] / n).sqrt());
            let std = (rms * rms - mean * mean).max(0.0).sqrt() / (n - 1.0).sqrt();
            let ratio = (normalised[k] / n).sqrt();
            assert!(mean.abs() < 3.0 * std, "lambda[{}]: mean {mean}, standard deviation of it {std}", k + 1);
            // Three standard deviations of this ratio, each 1/9 with forty runs.
            assert!((0.67..1.4).contains(&ratio), "lambda[{}]: error/std {ratio}", k + 1);
        }
    }
}

/// A step of 5 % is noticed within two revolutions. One of 10 % is noticed within half a revolution and followed to within 1 % in a quarter
/// of a second, also without noise, which the estimator must then find to be zero. Error/std is below 4 from these instants on.
#[test]
fn a_step_of_lambda_is_detected_and_followed() {
    const FROM_S: f64 = 0.3;
    const FOUND: usize = 3400;
    const AFTERWARDS: f64 = 4.0;
    let cases = [(NOISE, NOISE, 1..=23), (NOISE, (0.0, 0.0), 1..=23), ((0.0, 0.0), (0.0, 0.0), 21..=23)];
    for (noise, stated, seeds) in cases {
        let (mut all_valid, runs) = (0, seeds.clone().count());
        for seed in seeds {
            let what = format!("noise {noise:?}, known {stated:?}, seed {seed}");
            let (size, noticed) = if seed > 20 { (0.1, 3100) } else { (0.05, FOUND) };
            let mut changed = Rotor::default().lambda;
            changed[seed as usize % 3] *= if seed % 2 == 0 { 1.0 + size } else { 1.0 - size };
            let rotor = Rotor { change: Some((FROM_S, changed)), noise, ..noisy(7000 + 13 * seed, 6001) };
            let outputs = rotor.identify(with_noise(config(&rotor), stated));
            let found = outputs[3000..].iter().position(|output| !output.valid).map(|n| 3000 + n);
            assert!(found.is_some_and(|at| at <= noticed), "{what}: found at {found:?}");
            let (worst, at, valid) = confidence(&rotor, &outputs, noticed);
            assert!(worst < AFTERWARDS, "{what}: {worst:.2} standard deviations at sample {at}");
            all_valid += valid;
            if size == 0.1 {
                assert!(outputs[3000..].iter().any(|output| output.verdict == Verdict::Changed), "{what}");
                for (hat, truth) in outputs[5500..].iter().flat_map(|output| output.lambda_hat.into_iter().zip(changed))
                {
                    below(&format!("{what}: error after a quarter of a second"), (hat / truth - 1.0).abs(), 0.01);
                }
            }
        }
        // Where a shorter memory absorbed the change, it must expire first, which takes a quarter of a second with some seeds.
        let mean = all_valid / runs;
        assert!(
            mean >= 1200,
            "noise {noise:?}, known {stated:?}: valid in {mean} of 2600 samples after it, in the mean"
        );
    }
}

/// Two circles with the golden ratio between their speeds.
fn two_circles(rotor: &Rotor, t: f64) -> [[f64; 2]; 3] {
    let (fast, slow) = (rotor.omega_rad_s, rotor.omega_rad_s * 0.5 * (5.0_f64.sqrt() - 1.0));
    let (a, b) = (40e-6, 25e-6);
    let ((s1, c1), (s2, c2)) = ((fast * t).sin_cos(), (slow * t).sin_cos());
    [
        [a * c1 - b * c2, a * s1 + b * s2],
        [-a * fast * s1 + b * slow * s2, a * fast * c1 + b * slow * c2],
        [-a * fast * fast * c1 + b * slow * slow * c2, -a * fast * fast * s1 - b * slow * slow * s2],
    ]
}

/// Twelve incommensurate sines on each axis.
fn wander(_: &Rotor, t: f64) -> [[f64; 2]; 3] {
    let mut out = [[0.0; 2]; 3];
    for n in 0..12 {
        let omega = 2.0 * PI * (7.3 + 11.7 * f64::from(n) + 0.31 * f64::from(n * n));
        let amplitude = 12e-6 / (1.0 + 0.25 * f64::from(n));
        for (axis, phase) in [f64::from(7 * n * n), f64::from(7 * n * n + 13)].into_iter().enumerate() {
            let (s, c) = (omega * t + phase).sin_cos();
            out[0][axis] += amplitude * c;
            out[1][axis] -= amplitude * omega * s;
            out[2][axis] -= amplitude * omega * omega * c;
        }
    }
    out
}

#[test]
fn orbits_without_a_period() {
    const LIMIT: f64 = 4.0;
    for (name, path) in [("two circles", two_circles as Path), ("wander", wander)] {
        for (noise, known) in [(NOISE, true), (NOISE, false), ((1e-6, 1e-2), true), ((1e-6, 1e-2), false)] {
            for seed in 1..=4 {
                let rotor = Rotor { path, noise, ..noisy(600 + seed, 10_001) };
                let outputs = rotor.identify(if known { with_noise(config(&rotor), noise) } else { config(&rotor) });
                let (worst, at, valid) = confidence(&rotor, &outputs, 0);
                assert!(worst < LIMIT, "{name}, {noise:?}, known {known}, seed {seed}: {worst:.2} at {at}");
                assert!(valid > 7000, "{name}, {noise:?}, known {known}: valid {valid} of 10001");
            }
        }
    }
}

/// Unknown noise is estimated between 20 nm and 5 µm, 1 mA and 0.1 A; beyond, the estimate is right or not valid.
#[test]
fn noise_is_estimated_or_the_estimate_refused() {
    for (noise, in_range) in [
        ((2e-8, 1e-3), true),
        ((2e-8, 1e-1), true),
        (NOISE, true),
        ((5e-6, 1e-3), true),
        ((5e-6, 1e-1), true),
        ((3e-9, 1e-4), false),
        ((1e-7, 0.5), false),
        ((5e-6, 0.5), false),
        ((1e-5, 0.3), false),
        ((2e-5, 1e-2), false),
        ((2e-5, 1e-1), false),
        ((5e-5, 1e-1), false),
    ] {
        for seed in 1..=4 {
            let rotor = Rotor { noise, ..noisy(900 + 17 * seed, 10_001) };
            let outputs = rotor.identify(config(&rotor));
            assert_never_wrong(&format!("{noise:?}, seed {seed}"), &rotor, &outputs);
            let last = outputs.last().expect("samples");
            let found = last.position_noise_m[0] / noise.0;
            let (low, high) = if in_range { (0.8, 1.25) } else { (0.0, f64::INFINITY) };
            between(&format!("{noise:?}, seed {seed}: noise found over true"), found, low, high);
        }
    }
}

/// On a circle only the curvature of the gaps separates the unbalance from the magnets: valid only with a small standard deviation.
#[test]
fn a_circle_with_unbalance_is_valid_only_when_it_is_known() {
    for unbalance in [(0.0, 0.0), unbalanced().unbalance] {
        for (noise, known) in [(NOISE, true), (NOISE, false), ((2e-8, 1e-3), true), ((2e-8, 1e-3), false)] {
            for seed in 1..=3 {
                let rotor = Rotor { radius_m: [50e-6; 2], unbalance, noise, ..noisy(70 + seed, 10_001) };
                let outputs = rotor.identify(if known { with_noise(config(&rotor), noise) } else { config(&rotor) });
                assert_never_wrong(&format!("{noise:?}, known {known}"), &rotor, &outputs);
                for output in outputs.iter().filter(|output| output.valid) {
                    let std = (0..3).map(|k| output.lambda_std[k] / output.lambda_hat[k]).fold(0.0, f64::max);
                    assert!(std < 2.0 * STD_LIMIT, "valid with a standard deviation of {std}");
                }
                let last = outputs.last().expect("samples");
                let honest = [Verdict::Valid, Verdict::Uncertain, Verdict::Singular, Verdict::Collecting];
                assert!(honest.contains(&last.verdict), "{last:?}");
            }
        }
    }
}

/// ki, ks, noise, condition and residual are as documented.
#[test]
fn the_other_outputs_are_as_documented() {
    let rotor = Rotor { samples: 2001, ..unbalanced() };
    let data = rotor.run();
    let outputs = rotor.identify(with_noise(config(&rotor), NOISE));
    let last = outputs.last().expect("samples");
    let (mut ki, mut ks) = ([0.0; 3], [0.0; 3]);
    for sample in &data[data.len() - 200..] {
        for k in 0..3 {
            let (sin, cos) = rotor.alpha_rad[k].sin_cos();
            let gap = rotor.gap_m - sin * sample.position_m[0] - cos * sample.position_m[1];
            ki[k] += 2.0 * rotor.lambda[k] * sample.before_a[k] / (gap * gap) / 200.0;
            ks[k] += 2.0 * rotor.lambda[k] * sample.before_a[k].powi(2) / (gap * gap * gap) / 200.0;
        }
    }
    for k in 0..3 {
        // Held currents and gaps half an interval apart: 1.5 % of a revolution.
        assert!((last.ki[k] / ki[k] - 1.0).abs() < 0.02, "ki[{}] {} N/A, wanted {}", k + 1, last.ki[k], ki[k]);
        assert!((last.ks[k] / ks[k] - 1.0).abs() < 0.02, "ks[{}] {} N/m, wanted {}", k + 1, last.ks[k], ks[k]);
    }
    let fresh = estimator(config(&rotor)).start();
    assert_eq!((fresh.output().condition, fresh.output().residual), (CONDITION_CAP, 1.0));
    assert_eq!((fresh.output().position_noise_m[0], fresh.output().current_noise_a[0]), (0.0, 0.0));

    let rotor = noisy(21, 5001);
    let nis = |factor: f64| {
        let outputs = rotor.identify(with_noise(config(&rotor), (factor * NOISE.0, factor * NOISE.1)));
        outputs.last().expect("samples").clone()
    };
    let right = nis(1.0);
    assert!((0.9..1.1).contains(&right.residual), "{}", right.residual);
    for (noise, known) in [(right.position_noise_m[0], NOISE.0), (right.current_noise_a[0], NOISE.1)] {
        assert!((noise / known - 1.0).abs() < 0.05, "{noise}, {known} is known");
    }
    // Stated noise is a strong prior; the data correct a value that is half of the true one.
    let half = nis(0.5);
    assert!((half.position_noise_m[0] / NOISE.0 - 1.0).abs() < 0.2, "{}", half.position_noise_m[0]);
    assert!((0.8..1.5).contains(&half.residual), "{}", half.residual);
    // One unknown less lowers the condition number, which does not depend on units.
    let rotor = Rotor { noise: NOISE, seed: 21, samples: 5001, ..Rotor::default() };
    let right = rotor.identify(with_noise(config(&rotor), NOISE)).pop().expect("samples");
    let balanced = EstimatorConfig { identify_unbalance: false, ..with_noise(config(&rotor), NOISE) };
    let balanced = rotor.identify(balanced).pop().expect("samples");
    assert!(1.0 <= balanced.condition && balanced.condition < 0.5 * right.condition && right.condition < 1e4);
}

/// A tolerance leaves the standard deviation due to noise as it is and enters the total in quadrature.
#[test]
fn tolerances_enter_the_total_alone() {
    let rotor = noisy(22, 3001);
    let plain = rotor.identify(with_noise(config(&rotor), NOISE)).pop().expect("samples");
    // Includes the uncertainty from the other forgetting factors.
    let models: [f64; 3] = std::array::from_fn(|k| plain.lambda_std_total[k] / plain.lambda_hat[k]);
    for (total, noise) in plain.lambda_std_total.iter().zip(plain.lambda_std) {
        assert!((1.0..1.6).contains(&(total / noise)), "{plain:?}");
    }
    let with = |tolerance: Tolerance| {
        let outputs = rotor.identify(EstimatorConfig { tolerance, ..with_noise(config(&rotor), NOISE) });
        assert_never_wrong("tolerance", &rotor, &outputs);
        let last = outputs.last().expect("samples").clone();
        let total = [0, 1, 2].map(|k| last.lambda_std_total[k] / last.lambda_hat[k]);
        let part = [0, 1, 2].map(|k| (total[k] * total[k] - models[k] * models[k]).max(0.0).sqrt());
        (part, last)
    };
    let none = || config(&rotor).tolerance;
    // Sensitivities on this ellipse.
    let (mass, _) = with(Tolerance { m_kg: 0.067, ..none() });
    let (gain, _) = with(Tolerance { current_gain: 0.01, ..none() });
    let (gap, _) = with(Tolerance { gap_m: 5e-6, ..none() });
    let (offset, _) = with(Tolerance { position_offset_m: 1e-5, ..none() });
    for k in 0..3 {
        assert!((mass[k] - 0.01).abs() < 1e-4, "1 % of mass is 1 % of lambda: {mass:?}");
        assert!((gain[k] - 0.02).abs() < 1e-4, "1 % of current is 2 % of lambda: {gain:?}");
        assert!((gap[k] - 0.017).abs() < 0.004, "1 % of the gap is 1.7 % of lambda: {gap:?}");
        assert!((0.005..0.06).contains(&offset[k]), "{offset:?}");
    }
    // A total beyond the limit invalidates the estimate.
    let (_, wide) = with(Tolerance { m_kg: 0.06 * 6.7, ..none() });
    assert_eq!(wide.verdict, Verdict::Uncertain);
    assert!(!wide.valid);
}
