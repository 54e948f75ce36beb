//! Reset, states read back, and parameters that are refused.

use super::*;

#[test]
fn reset_equals_a_fresh_state() {
    let rotor = noisy(31, 1001);
    let inputs = rotor.inputs(Hold::HeldBefore);
    for noise in [(0.0, 0.0), NOISE] {
        for tolerance in [Tolerance::default(), Tolerance { gap_m: 1e-6, ..Tolerance::default() }] {
            let estimator = estimator(EstimatorConfig { tolerance, ..told(config(&rotor), noise) });
            let (_, mut used) = run(&estimator, &inputs[..777]);
            let mut fresh = estimator.start();
            for input in &inputs {
                // The level stays high: only its rising edge counts.
                let input = EstimatorInput { reset: true, ..input.clone() };
                assert_eq!(estimator.sample(&mut used, &input), estimator.sample(&mut fresh, &input));
            }
            assert_eq!(postcard::to_stdvec(&used), postcard::to_stdvec(&fresh));
            assert!(fresh.output().valid);
        }
    }
}

#[test]
fn a_state_read_back_continues_bit_for_bit() {
    let rotor = noisy(32, 1001);
    let inputs = rotor.inputs(Hold::HeldBefore);
    for noise in [(0.0, 0.0), NOISE] {
        let estimator = estimator(told(config(&rotor), noise));
        for at in [1, 40, 70, 333, 800] {
            let (_, mut state) = run(&estimator, &inputs[..at]);
            let bytes = postcard::to_stdvec(&state).expect("serialisable");
            let mut back: EstimatorState = postcard::from_bytes(&bytes).expect("readable");
            assert!(estimator.accepts(&back));
            for input in &inputs[at..] {
                let [one, other] = [&mut back, &mut state].map(|state| estimator.sample(state, input));
                assert_eq!(postcard::to_stdvec(&one), postcard::to_stdvec(&other));
            }
            assert_eq!(postcard::to_stdvec(&back), postcard::to_stdvec(&state));
        }
    }
}

/// A state of another method is left alone; one of the same method with other numbers is no worse than other data.
#[test]
fn a_foreign_state_is_refused() {
    let rotor = noisy(33, 501);
    let inputs = rotor.inputs(Hold::HeldBefore);
    let estimator = estimator(config(&rotor));
    for method in [Method::Paper, Method::PaperLiteral] {
        let other = Estimator::new(rotor.config(method, Hold::HeldBefore)).expect("good");
        let (_, mut state) = run(&other, &inputs);
        assert!(!estimator.accepts(&state));
        assert_eq!(estimator.sample(&mut state, &inputs[0]).verdict, Verdict::ForeignState);
        assert!(other.accepts(&state));
    }
}

/// A number that is not finite would never leave the sums again, and a place outside of its ring would panic.
#[test]
fn a_state_that_is_not_finite_is_refused() {
    let rotor = noisy(34, 801);
    let inputs = rotor.inputs(Hold::HeldBefore);
    // Before there is an estimate, before the noise is found, and later.
    for (method, at) in [
        (Method::PredictionError, 40),
        (Method::PredictionError, 90),
        (Method::PredictionError, 801),
        (Method::Paper, 801),
    ] {
        let estimator = Estimator::new(rotor.config(method, Hold::HeldBefore)).expect("good");
        let (_, state) = run(&estimator, &inputs[..at]);
        assert!(estimator.accepts(&state));
        let bytes = postcard::to_stdvec(&state).expect("serialisable");
        let mut refused = 0;
        for from in (0..bytes.len() - 8).step_by(53) {
            let mut spoilt = bytes.clone();
            // The end of nearly every number that these bytes are put into is not a number.
            spoilt[from..from + 8].fill(0xff);
            let Ok(mut back) = postcard::from_bytes::<EstimatorState>(&spoilt) else { continue };
            if format!("{back:?}").contains("NaN") {
                refused += 1;
                assert!(!estimator.accepts(&back), "{method:?} after {at} samples, byte {from}");
            } else if estimator.accepts(&back) {
                estimator.sample(&mut back, &inputs[at - 1]);
            }
        }
        println!("{method:?} after {at} samples: {refused} spoilt states of {} bytes", bytes.len());
        assert!(refused > 50, "{refused}");
    }
}

#[test]
fn every_bad_parameter_is_named() {
    let good = EstimatorConfig::default();
    let names = |config: EstimatorConfig| -> Vec<String> {
        Estimator::new(config).map_or_else(|found| found.iter().map(|i| i.name.to_string()).collect(), |_| Vec::new())
    };
    type Set = fn(&mut EstimatorConfig, f64);
    let not_negative: [(&str, Set); 9] = [
        ("sensor.positionNoise", |c, x| c.position_noise_m = x),
        ("sensor.currentNoise", |c, x| c.current_noise_a = x),
        ("tolerance.m", |c, x| c.tolerance.m_kg = x),
        ("tolerance.s", |c, x| c.tolerance.gap_m = x),
        ("tolerance.alpha", |c, x| c.tolerance.alpha_rad = x),
        ("tolerance.positionGain", |c, x| c.tolerance.position_gain = x),
        ("tolerance.positionOffset", |c, x| c.tolerance.position_offset_m = x),
        ("tolerance.currentGain", |c, x| c.tolerance.current_gain = x),
        ("tolerance.currentOffset", |c, x| c.tolerance.current_offset_a = x),
    ];
    let mut all_bad = good.clone();
    for (name, set) in not_negative {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1e-9] {
            let mut config = good.clone();
            set(&mut config, value);
            assert_eq!(names(config), [name], "{name} = {value}");
        }
        let mut config = good.clone();
        set(&mut config, 1e-3);
        assert_eq!(names(config.clone()), [""; 0], "{name} = 0.001");
        for method in [Method::Paper, Method::PaperLiteral] {
            // Noise is of no use to them, and does no harm.
            let refused: &[&str] = if name.starts_with("tolerance") { &[name] } else { &[] };
            assert_eq!(names(EstimatorConfig { method, ..config.clone() }), refused, "{name} with {method:?}");
        }
        set(&mut all_bad, -1.0);
    }
    assert_eq!(names(all_bad).len(), 9, "all findings at once");
    let balanced = EstimatorConfig { identify_unbalance: false, ..good.clone() };
    assert_eq!(names(balanced.clone()), [""; 0]);
    assert_eq!(names(EstimatorConfig { method: Method::Paper, ..balanced.clone() }), ["identify.unbalance"]);
    let refused = Estimator::new(EstimatorConfig { method: Method::Paper, ..balanced }).expect_err("refused");
    assert!(refused[0].to_string().contains("method = predictionError"), "{}", refused[0]);
    // The window of the paper's methods is none of this one's business.
    let window = EstimatorConfig { window_s: 7e-4, epsilon_s: 1e-4, step_s: 3.3e-5, ..good };
    assert_eq!(names(window), [""; 0]);
}
