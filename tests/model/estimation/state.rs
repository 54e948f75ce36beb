//! Reset, restored states, and refused parameters, for every method.

use super::*;

const METHODS: [Method; 3] = [Method::PaperLiteral, Method::Paper, Method::PredictionError];

/// Every method, with noise known and estimated, with and without a tolerance.
fn cases() -> Vec<(Rotor, EstimatorConfig)> {
    let (rotor, quiet) = (noisy(31, 1001), Rotor { samples: 700, ..Rotor::default() });
    let mut cases = Vec::new();
    for noise in [(0.0, 0.0), NOISE] {
        for tolerance in [Tolerance::default(), Tolerance { gap_m: 1e-6, ..Tolerance::default() }] {
            cases.push((rotor.clone(), EstimatorConfig { tolerance, ..with_noise(config(&rotor), noise) }));
        }
    }
    for (method, hold) in [
        (Method::Paper, Hold::HeldAfter),
        (Method::PaperLiteral, Hold::HeldAfter),
        (Method::PaperLiteral, Hold::Linear),
    ] {
        cases.push((quiet.clone(), quiet.config(method, hold)));
    }
    cases
}

#[test]
fn reset_equals_a_fresh_state() {
    for (rotor, config) in cases() {
        let what = format!("{:?} {:?}", config.method, config.hold);
        let inputs = rotor.inputs(config.hold);
        let estimator = estimator(config);
        let (_, mut used) = run(&estimator, &inputs[..333]);
        let mut fresh = estimator.start();
        for input in &inputs {
            // The level stays high: only its rising edge counts.
            let input = EstimatorInput { reset: true, ..input.clone() };
            assert_eq!(estimator.sample(&mut used, &input), estimator.sample(&mut fresh, &input), "{what}");
        }
        assert_eq!(postcard::to_stdvec(&used), postcard::to_stdvec(&fresh), "{what}");
        assert!(fresh.output().valid, "{what}");
    }
}

#[test]
fn a_state_read_back_continues_bit_for_bit() {
    for (rotor, config) in cases() {
        let what = format!("{:?} {:?}", config.method, config.hold);
        let inputs = rotor.inputs(config.hold);
        let estimator = estimator(config);
        for at in [1, 40, 70, 333, 650] {
            let (_, mut state) = run(&estimator, &inputs[..at]);
            let bytes = postcard::to_stdvec(&state).expect("serialisable");
            let mut back: EstimatorState = postcard::from_bytes(&bytes).expect("readable");
            assert!(estimator.accepts(&back), "{what}");
            for input in &inputs[at..] {
                let [one, other] = [&mut back, &mut state].map(|state| estimator.sample(state, input));
                assert_eq!(postcard::to_stdvec(&one), postcard::to_stdvec(&other), "{what}");
            }
            assert_eq!(postcard::to_stdvec(&back), postcard::to_stdvec(&state), "{what}");
        }
    }
}

/// A state of another method or window is not touched.
#[test]
fn a_foreign_state_is_refused() {
    let rotor = noisy(33, 501);
    let inputs = rotor.inputs(Hold::HeldBefore);
    let [literal, paper, error] = METHODS.map(|method| rotor.config(method, Hold::HeldBefore));
    let short = EstimatorConfig { window_s: 0.01, ..paper.clone() };
    for (one, other) in [(&error, &literal), (&error, &paper), (&paper, &error), (&paper, &short), (&short, &paper)] {
        let what = format!("{:?}, {} s: {:?}, {} s", one.method, one.window_s, other.method, other.window_s);
        let [estimator, other] = [one, other].map(|config| estimator(config.clone()));
        for samples in [0, inputs.len()] {
            let (_, mut state) = run(&other, &inputs[..samples]);
            assert!(!estimator.accepts(&state), "{what}");
            assert_eq!(estimator.sample(&mut state, &inputs[0]).verdict, Verdict::ForeignState, "{what}");
            assert!(other.accepts(&state), "{what}");
        }
    }
}

/// A non-finite number would stay in the sums for ever, and an index outside its ring buffer would panic.
#[test]
fn a_state_that_is_not_finite_is_refused() {
    let rotor = noisy(34, 801);
    let inputs = rotor.inputs(Hold::HeldBefore);
    // Before the first estimate, before the noise is estimated, and later.
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
            // Nearly every number that ends in these bytes is NaN.
            spoilt[from..from + 8].fill(0xff);
            let Ok(mut back) = postcard::from_bytes::<EstimatorState>(&spoilt) else { continue };
            if format!("{back:?}").contains("NaN") {
                refused += 1;
                assert!(!estimator.accepts(&back), "{method:?} after {at} samples, byte {from}");
            } else if estimator.accepts(&back) {
                estimator.sample(&mut back, &inputs[at - 1]);
            }
        }
        assert!(refused > 50, "{method:?} after {at} samples: {refused} spoilt states");
    }
}

/// In addition to the checks common to all models.
#[test]
fn unsuitable_parameters_of_a_method_are_named() {
    // Two checks may refuse the same value.
    let names = |config: EstimatorConfig| -> Vec<String> {
        let found = Estimator::new(config).err().unwrap_or_default();
        let mut names: Vec<_> = found.iter().map(|invalid| invalid.name.to_string()).collect();
        names.dedup();
        names
    };
    let good = EstimatorConfig::default();
    // Only the paper's methods check the window.
    let window = EstimatorConfig { window_s: 7e-4, epsilon_s: 1e-4, step_s: 3.3e-5, ..good.clone() };
    assert_eq!(names(window), [""; 0]);
    let tolerance = Tolerance { gap_m: 1e-3, ..Tolerance::default() };
    // The paper's methods ignore noise.
    let wide = |method| with_noise(EstimatorConfig { method, tolerance: tolerance.clone(), ..good.clone() }, NOISE);
    assert_eq!(METHODS.map(|method| names(wide(method))), [vec!["tolerance.s"], vec!["tolerance.s"], vec![]]);
    let balanced = |method| EstimatorConfig { method, identify_unbalance: false, ..good.clone() };
    assert_eq!(names(balanced(Method::PredictionError)), [""; 0]);
    let refused = Estimator::new(balanced(Method::Paper)).expect_err("refused");
    assert_contains(&refused[0].to_string(), &["identify.unbalance", "method = predictionError"]);
    for method in METHODS {
        let mut config = EstimatorConfig { method, step_s: f64::NAN, filter_zeta: 0.0, ..good.clone() };
        config.geometry.shaft.m_kg = -1.0;
        assert_eq!(names(config), ["m", "Ts", "filter.zeta"], "{method:?}");
    }
    for (magnet, angle_rad, name) in [(2, f64::NAN, "alpha[3]"), (1, 2.0 * PI, "alpha[2]"), (2, -PI / 3.0, "alpha[3]")]
    {
        let mut config = good.clone();
        config.geometry.bearings[0].alpha_rad[magnet] = angle_rad;
        assert_eq!(names(config), [name]);
    }
}
