//! Missing, stuck, wild and wrapped samples, and a rotor that does not turn.

use super::*;

/// A gap keeps the accumulated information; meanwhile the verdict names the reason.
#[test]
fn gaps_keep_the_accumulated_information() {
    type Spoil = fn(&mut EstimatorInput);
    let spoilt: [(Spoil, Verdict); 9] = [
        (|input| input.position_m[1] = f64::NAN, Verdict::BadSample),
        (|input| input.position_m[0] = f64::NEG_INFINITY, Verdict::BadSample),
        (|input| input.current_a[2] = f64::INFINITY, Verdict::BadSample),
        (|input| input.current_a[0] = 1e200, Verdict::BadSample),
        (|input| input.position_m[1] = -6e-4, Verdict::BadSample),
        (|input| input.theta_rad = f64::NAN, Verdict::BadSample),
        (|input| input.omega_rad_s = f64::NEG_INFINITY, Verdict::BadSample),
        (|input| input.enable = false, Verdict::Disabled),
        (|input| input.contact = true, Verdict::Contact),
    ];
    for (verdict, words) in [
        (Verdict::BadSample, "not finite"),
        (Verdict::Stuck, "is stuck"),
        (Verdict::Contact, "contact"),
        (Verdict::Disabled, "enable is false"),
    ] {
        assert_contains(&verdict.to_string(), &["not valid: ", words]);
    }
    let rotor = noisy(5, 3001);
    let good = rotor.inputs(Hold::HeldBefore);
    for noise in [NOISE, (0.0, 0.0)] {
        let estimator = estimator(with_noise(config(&rotor), noise));
        let undisturbed = run(&estimator, &good).0.pop().expect("samples");
        for (spoil, verdict) in spoilt {
            // Single missing samples are bridged.
            let lasting = |j: usize| {
                [Verdict::Disabled, Verdict::Contact].contains(&verdict) || j >= 1000 + STUCK_SAMPLES as usize
            };
            for gap in [1000..1001, 1000..1230] {
                let mut inputs = good.clone();
                inputs[gap.clone()].iter_mut().for_each(spoil);
                let (outputs, _) = run(&estimator, &inputs);
                let before = &outputs[999];
                assert!(before.valid);
                for (j, output) in gap.clone().zip(&outputs[gap.clone()]) {
                    assert_eq!(output.verdict, if lasting(j) { verdict } else { Verdict::Valid }, "{verdict:?} at {j}");
                    assert_eq!(output.lambda_hat, before.lambda_hat, "the last valid estimate stays");
                }
                let back = outputs[gap.end..].iter().position(|output| output.valid);
                assert!(back.is_some_and(|samples| samples <= 5), "{verdict:?} {gap:?}: valid after {back:?} samples");
                assert_never_wrong(&format!("{verdict:?} {gap:?}"), &rotor, &outputs);
                let last = outputs.last().expect("samples");
                for k in 0..3 {
                    // The gap costs the information of its samples.
                    let more = last.lambda_std[k] / undisturbed.lambda_std[k];
                    assert!((0.95..1.15).contains(&more), "{verdict:?} {gap:?}: {more} times the standard deviation");
                }
            }
        }
    }
}

/// λ may have changed during a long gap: the estimate of before is not valid at once.
#[test]
fn a_changed_lambda_after_a_long_gap_is_no_surprise() {
    let cold = noisy(10, 9001);
    let warm = Rotor { lambda: cold.lambda.map(|lambda| 1.03 * lambda), ..cold.clone() };
    let mut inputs = cold.inputs(Hold::HeldBefore);
    inputs[4000..].clone_from_slice(&warm.inputs(Hold::HeldBefore)[4000..]);
    inputs[4000..6000].iter_mut().for_each(|input| input.enable = false);
    for noise in [NOISE, (0.0, 0.0)] {
        let outputs = run(&estimator(with_noise(config(&cold), noise)), &inputs).0;
        assert!(outputs[3999].valid);
        let valid = assert_never_wrong("3 % more after a gap", &warm, &outputs[6000..]);
        assert!(valid > 1000, "valid at {valid} samples");
    }
}

/// Six pauses of 2 ms within a second: the estimate is valid whenever the estimator is enabled, and `valid` does not count as newly reached.
#[test]
fn short_pauses_leave_the_verdict_as_it_was() {
    for stop in [|input: &mut EstimatorInput| input.enable = false, |input: &mut EstimatorInput| input.contact = true] {
        let rotor = noisy(5, 7001);
        let mut inputs = rotor.inputs(Hold::HeldBefore);
        let paused = |j: usize| j >= 1000 && j % 1000 < 20;
        inputs.iter_mut().enumerate().filter(|(j, _)| paused(*j)).for_each(|(_, input)| stop(input));
        let outputs = run(&estimator(config(&rotor)), &inputs).0;
        assert_never_wrong("pauses", &rotor, &outputs);
        assert!(outputs.iter().enumerate().skip(1000).all(|(j, output)| output.valid != paused(j)));
    }
}

/// The outputs after a change to the inputs, with unknown noise; no valid one is wrong.
fn after(what: &str, rotor: &Rotor, change: impl Fn(&mut [EstimatorInput])) -> Vec<EstimatorOutput> {
    let mut inputs = rotor.inputs(Hold::HeldBefore);
    change(&mut inputs);
    let outputs = run(&estimator(config(rotor)), &inputs).0;
    assert_never_wrong(what, rotor, &outputs);
    outputs
}

/// A wrong angle counts as a missing one.
#[test]
fn single_wrong_angles_do_no_harm() {
    let outputs = after("wrong angles", &noisy(13, 6001), |inputs| {
        inputs[2000..].iter_mut().step_by(300).for_each(|input| input.theta_rad += 1.6);
    });
    assert!(outputs[1999..].iter().all(|output| output.valid));
}

/// Missing samples at the start delay the noise estimate.
#[test]
fn a_gap_while_the_noise_is_estimated() {
    let outputs = after("gaps at the start", &noisy(6, 2001), |inputs| {
        [0, 30, 61, 90].into_iter().for_each(|j: usize| inputs[j].position_m[0] = f64::NAN);
    });
    assert!(outputs.last().expect("samples").valid);
}

/// The controller reacts to the missing samples too, so that those after a gap do not count; if none counts for long, there is no estimate.
#[test]
fn gaps_too_frequent_are_named() {
    let miss = |inputs: &mut [EstimatorInput], every: usize| {
        inputs.iter_mut().step_by(every).for_each(|input| input.position_m[1] = f64::NAN);
    };
    let outputs = after("frequent gaps", &noisy(8, 6001), |inputs| miss(&mut inputs[2000..4000], 16));
    assert!(outputs[1999..2900].iter().all(|output| output.valid), "the estimate of before");
    assert!(outputs[3100..4000].iter().all(|output| output.verdict == Verdict::BadSample));
    assert!(outputs[5000..].iter().all(|output| output.valid), "it comes back by itself");
    // With every fifth sample missing the noise cannot even be estimated.
    let outputs = after("every fifth is missing", &noisy(8, 6001), |inputs| miss(inputs, 5));
    assert!(outputs[1500..].iter().all(|output| output.verdict == Verdict::BadSample));
}

/// A single outlier of a position is excluded; several in a row are not sensor noise.
#[test]
fn outliers_are_left_out() {
    for (lasting, wanted) in [(1, Verdict::Valid), (2, Verdict::Unexplained)] {
        let outputs = after("outliers", &noisy(9, 4001), |inputs| {
            inputs[2000..2000 + lasting].iter_mut().for_each(|input| input.position_m[0] += 1e-5);
        });
        assert_eq!(outputs[1999 + lasting].verdict, wanted, "{lasting} in a row");
        let back = outputs[2001..].iter().position(|output| output.valid);
        assert!(back.is_some_and(|samples| samples < 1500), "{lasting} in a row: valid after {back:?} samples");
    }
}

#[test]
fn a_stuck_sensor_is_named() {
    let outputs = after("stuck", &noisy(7, 5001), |inputs| {
        let stuck = inputs[1000].position_m[1];
        inputs[1000..1400].iter_mut().for_each(|input| input.position_m[1] = stuck);
    });
    let named = outputs[1000..].iter().position(|output| output.verdict == Verdict::Stuck);
    assert_eq!(named, Some(STUCK_SAMPLES as usize), "samples until it is named");
    assert!(outputs[1000 + STUCK_SAMPLES as usize..1400].iter().all(|output| output.verdict == Verdict::Stuck));
    assert!(outputs[3400..].iter().all(|output| output.valid), "it comes back by itself within 0.2 s");
}

#[test]
fn the_angle_may_be_wrapped() {
    let rotor = noisy(8, 2001);
    let plain = rotor.inputs(Hold::HeldBefore);
    let estimator = estimator(config(&rotor));
    let one = run(&estimator, &plain).0.pop().expect("samples");
    type Wrap = fn(f64) -> f64;
    let wraps: [Wrap; 3] = [
        |theta| theta.rem_euclid(2.0 * PI),
        |theta| (theta + PI).rem_euclid(2.0 * PI) - PI,
        |theta| theta - 2000.0 * PI,
    ];
    for wrap in wraps {
        let wrapped: Vec<_> =
            plain.iter().map(|input| EstimatorInput { theta_rad: wrap(input.theta_rad), ..input.clone() }).collect();
        let other = run(&estimator, &wrapped).0.pop().expect("samples");
        assert_eq!(one.verdict, other.verdict);
        for k in 0..3 {
            // Rounding of the angle may end a quarter of a revolution one sample later, and give a sample other instruments.
            let off = (one.lambda_hat[k] - other.lambda_hat[k]).abs() / one.lambda_std[k];
            assert!(off < 0.1, "lambda[{}] is off by {off} standard deviations", k + 1);
        }
        assert!((one.unbalance_phase_rad[0] - other.unbalance_phase_rad[0]).abs() < 1e-3);
    }
}

/// A speed that disagrees with the angle is named, whichever of the two is wrong.
#[test]
fn angle_and_speed_in_other_units() {
    type Change = fn(&mut EstimatorInput);
    let changes: [Change; 4] = [
        |input| input.theta_rad = input.theta_rad.to_degrees(),
        |input| input.omega_rad_s *= 30.0 / PI,
        |input| input.omega_rad_s *= -1.0,
        |input| input.omega_rad_s = 0.0,
    ];
    let rotor = noisy(9, 2001);
    let estimator = estimator(config(&rotor));
    for (n, change) in changes.into_iter().enumerate() {
        let mut inputs = rotor.inputs(Hold::HeldBefore);
        inputs.iter_mut().for_each(change);
        let outputs = run(&estimator, &inputs).0;
        assert!(outputs[300..].iter().all(|output| output.verdict == Verdict::Speed), "change {n}");
        assert!(outputs.iter().all(|output| !output.valid), "change {n}");
    }
}

#[test]
fn a_balanced_rotor_needs_no_unbalance() {
    let rotor = Rotor { noise: NOISE, seed: 9, samples: 2001, ..Rotor::default() };
    let with = rotor.identify(config(&rotor));
    let balanced = EstimatorConfig { identify_unbalance: false, ..config(&rotor) };
    let without = rotor.identify(balanced.clone());
    assert!(assert_never_wrong("balanced", &rotor, &without) > 1000);
    let [with, without] = [with, without].map(|mut outputs| outputs.pop().expect("samples"));
    assert_eq!((without.unbalance_kg_m[0], without.unbalance_phase_rad[0]), (0.0, 0.0));
    assert!(without.lambda_std[1] < 0.6 * with.lambda_std[1], "an unknown less: {without:?}\n{with:?}");

    // The angle is not connected: it stays at 0 while the rotor turns.
    let mut inputs = rotor.inputs(Hold::HeldBefore);
    inputs.iter_mut().for_each(|input| input.theta_rad = 0.0);
    let outputs = run(&estimator(balanced), &inputs).0;
    assert!(outputs.last().expect("samples").valid, "{:?}", outputs.last());
    assert_never_wrong("balanced, no angle", &rotor, &outputs);

    // An unbalance excluded by the configuration invalidates the estimate.
    let rotor = noisy(9, 5001);
    let outputs = rotor.identify(EstimatorConfig { identify_unbalance: false, ..config(&rotor) });
    let last = outputs.last().expect("samples");
    assert!(!last.valid, "an unbalance of 20 N that is denied: {last:?}");
}

/// Without an angle the unbalance cannot be identified: the estimate is right or not valid.
#[test]
fn no_angle_is_connected() {
    let rotor = noisy(10, 5001);
    let mut inputs = rotor.inputs(Hold::HeldBefore);
    inputs.iter_mut().for_each(|input| input.theta_rad = 0.0);
    for noise in [(0.0, 0.0), NOISE] {
        let outputs = run(&estimator(with_noise(config(&rotor), noise)), &inputs).0;
        assert_never_wrong(&format!("no angle, known {noise:?}"), &rotor, &outputs);
    }
}

#[test]
fn a_rotor_at_rest_is_right_or_not_valid() {
    for noise in [(0.0, 0.0), NOISE, (1e-6, 1e-2)] {
        for known_noise in [(0.0, 0.0), NOISE] {
            let rest = Rotor { radius_m: [0.0; 2], omega_rad_s: 0.0, noise, samples: 5001, ..unbalanced() };
            let outputs = rest.identify(with_noise(config(&rest), known_noise));
            let last = outputs.last().expect("samples");
            // Noise in the feedback excites the rotor a little.
            if noise == (0.0, 0.0) {
                assert!(outputs.iter().all(|output| !output.valid), "noise {noise:?}, known {known_noise:?}");
                assert_eq!(last.lambda_hat, [4e-6; 3]);
            }
            if known_noise == noise || known_noise == (0.0, 0.0) {
                assert_never_wrong(&format!("at rest, {noise:?} known {known_noise:?}"), &rest, &outputs);
            }
        }
    }
}

/// Amplifiers switched off or at their limit give little information, but no wrong estimate.
#[test]
fn currents_that_are_zero_or_limited() {
    let estimator = estimator(EstimatorConfig::default());
    for current_a in [[0.0; 3], [2.0; 3], [0.0, 2.0, 0.0]] {
        let mut state = estimator.start();
        for j in 0..3000 {
            let (position_m, theta_rad, omega_rad_s) = ([1e-5, -2e-5], 0.03 * f64::from(j), 300.0);
            let mut input = EstimatorInput { position_m, current_a, theta_rad, omega_rad_s, ..Default::default() };
            input.enable = true;
            let output = estimator.sample(&mut state, &input);
            assert!(!output.valid, "{current_a:?}: {output:?}");
            assert_eq!(output.lambda_hat, [4e-6; 3]);
        }
    }
    // One magnet without current: its λ stays unknown.
    let rotor = noisy(11, 2001);
    let mut inputs = rotor.inputs(Hold::HeldBefore);
    inputs.iter_mut().for_each(|input| input.current_a[1] = 0.0);
    let outputs = run(&self::estimator(config(&rotor)), &inputs).0;
    assert!(outputs.iter().all(|output| !output.valid), "{:?}", outputs.last());
    // Without current for a while the estimate soon becomes invalid, and is never wrong.
    let rotor = noisy(13, 6001);
    let mut inputs = rotor.inputs(Hold::HeldBefore);
    inputs[1500..2000].iter_mut().for_each(|input| input.current_a[1] = 0.0);
    for noise in [NOISE, (0.0, 0.0)] {
        let outputs = run(&self::estimator(with_noise(config(&rotor), noise)), &inputs).0;
        assert!(outputs[1499].valid && outputs[1500..1600].iter().any(|output| !output.valid), "known {noise:?}");
        let (worst, at, _) = confidence(&rotor, &outputs, 1600);
        assert!(worst < CONFIDENT, "known {noise:?}: {worst:.2} standard deviations at sample {at}");
    }
    // Currents at their limit in a quarter of the samples are still the true ones.
    let limited = Rotor { limit_a: 4.0, ..noisy(12, 5001) };
    let outputs = limited.identify(config(&limited));
    assert!(assert_never_wrong("limited", &limited, &outputs) > 0, "{:?}", outputs.last());
}

/// Samples from before the noise is estimated contribute to later estimates.
#[test]
fn the_first_samples_are_not_lost() {
    let rotor = noisy(35, 1001);
    let last = |noise| rotor.identify(with_noise(config(&rotor), noise)).pop().expect("samples");
    let (known, estimated) = (last(NOISE), last((0.0, 0.0)));
    for k in 0..3 {
        // The noise estimate is still 15 % too large.
        let ratio = estimated.lambda_std[k] / known.lambda_std[k];
        assert!((0.9..1.25).contains(&ratio), "lambda[{}]: {ratio}", k + 1);
    }
}

#[test]
fn outputs_are_finite_on_wild_inputs() {
    let mut random = Random::new(7);
    // Rarely off by many orders of magnitude; the usual size is itself often outside the gap.
    let mut number = |usual: f64, rare: f64| {
        let exponent = if random.normal() > 2.5 { (random.normal() * rare) as i32 } else { 0 };
        usual * random.normal() * 10.0_f64.powi(exponent)
    };
    let tolerance = Tolerance { gap_m: 1e-6, alpha_rad: 0.01, current_offset_a: 0.01, ..Tolerance::default() };
    let error = |hold, tolerance: &Tolerance, noise| {
        with_noise(EstimatorConfig { hold, tolerance: tolerance.clone(), ..EstimatorConfig::default() }, noise)
    };
    let mut configs = vec![
        error(Hold::HeldBefore, &Tolerance::default(), (0.0, 0.0)),
        error(Hold::HeldAfter, &Tolerance::default(), NOISE),
        error(Hold::Linear, &tolerance, (0.0, 0.0)),
        error(Hold::HeldBefore, &tolerance, NOISE),
        error(Hold::Linear, &Tolerance::default(), (1e-300, 1e-300)),
        error(Hold::Linear, &Tolerance::default(), (1e10, 1e10)),
    ];
    for method in [Method::PaperLiteral, Method::Paper] {
        configs.extend([Hold::HeldBefore, Hold::HeldAfter, Hold::Linear].map(|hold| EstimatorConfig {
            method,
            hold,
            window_s: 8e-4,
            epsilon_s: 8e-4,
            ..EstimatorConfig::default()
        }));
    }
    for config in configs {
        let what = format!("{:?} {:?}, noise {:e} m", config.method, config.hold, config.position_noise_m);
        let (samples, reset_every) =
            if config.method == Method::PredictionError { (20_000, 5001) } else { (5000, 501) };
        // The square of 1e-300 is 0, and the variance of a velocity in its units infinite.
        let acceptable = config.position_noise_m != 1e-300;
        let estimator = estimator(config);
        let mut state = estimator.start();
        for j in 0..samples {
            let wild = EstimatorInput {
                position_m: [number(1e-4, 1.0), number(1e-4, 1.0)],
                current_a: [number(3.0, 60.0), number(3.0, 20.0), number(3.0, 20.0)],
                theta_rad: number(10.0, 100.0),
                omega_rad_s: number(300.0, 30.0),
                enable: j % 97 != 0,
                contact: false,
                reset: j % reset_every == 0,
            };
            let o = estimator.sample(&mut state, &wild);
            let numbers = [o.condition, o.residual, o.determinant, o.unbalance_kg_m[0], o.unbalance_phase_rad[0]];
            let noises = [o.position_noise_m[0], o.current_noise_a[0]];
            let all = o.lambda_hat.iter().chain(&o.lambda_raw).chain(&o.lambda_std).chain(&o.lambda_std_total);
            let mut all = all.chain(&o.ki).chain(&o.ks).chain(&o.load_n).chain(&numbers).chain(&noises);
            assert!(all.all(|x| x.is_finite()), "{what}, sample {j}: {o:?}");
            assert!(o.lambda_std.iter().chain(&o.lambda_std_total).all(|std| *std >= 0.0), "{what}, sample {j}: {o:?}");
            assert!(!o.valid || o.lambda_hat.iter().all(|l| *l > 0.0), "{what}, sample {j}: {o:?}");
            assert_eq!(o.valid, o.verdict == Verdict::Valid, "{what}, sample {j}");
            assert!(!acceptable || j % 101 != 0 || estimator.accepts(&state), "{what}, sample {j}");
        }
    }
}
