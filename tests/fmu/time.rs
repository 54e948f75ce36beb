//! Communication steps: any start and length, tolerances, refusals. Sampled outputs do not depend on them.

use crate::prelude::*;

/// The input of a sampled FMU at a sample.
fn wave(sample: i64) -> f64 {
    3e-5 * (sample as f64 * 0.3).sin()
}

/// The outputs after `samples` samples with a new input at every sample; `next_length` returns the length of the next step in
/// units of the sample time.
fn sampled(model: &str, start_s: f64, samples: u32, mut next_length: impl FnMut() -> f64) -> Vec<u64> {
    let fmu = Fmu::new(model);
    for (name, value) in [("Tf", 2e-3), ("epsilon", 2e-3)] {
        if model == ESTIMATOR {
            fmu.set(name, value).ok(&fmu);
        }
    }
    fmu.set("Zm", wave(0)).ok(&fmu);
    fmu.start(start_s, None);
    let mut time = start_s;
    for sample in 0..samples {
        // The input is valid at the sample and held up to the next one.
        fmu.set("Zm", wave(sample.into())).ok(&fmu);
        let end = start_s + f64::from(sample + 1) * TS;
        while time < end - 1e-3 * TS {
            // A step ends at the sample at the latest, up to rounding.
            let (wanted, remaining) = (next_length() * TS, end - time);
            let length = if wanted > 1.000_1 * remaining { remaining } else { wanted };
            fmu.step(time, length).ok(&fmu);
            time += length;
        }
    }
    fmu.all_bits()
}

/// The last step of a run is often 1.1e-16 s long. Fails if a sample is lost or doubled because the clock has no tolerance.
#[test]
fn sampled_outputs_do_not_depend_on_the_steps() {
    for model in [CONTROLLER, ESTIMATOR] {
        for start_s in [0.0, 0.1, 12.345, 1e4] {
            let wanted = sampled(model, start_s, 60, || 1.0);
            let mut random = Random::new(7);
            assert_eq!(sampled(model, start_s, 60, || 0.25), wanted, "{model}: quarters, from {start_s}");
            assert_eq!(sampled(model, start_s, 60, || 1.0 / 3.0), wanted, "{model}: thirds, from {start_s}");
            let jitter = || random.between(0.01, 1.5);
            assert_eq!(sampled(model, start_s, 60, jitter), wanted, "{model}: at random, from {start_s}");
            let mut count = 0;
            let tiny = || {
                count += 1;
                [1.0, 1.1e-16 / TS, 0.0][count % 3]
            };
            assert_eq!(sampled(model, start_s, 60, tiny), wanted, "{model}: tiny ones between, from {start_s}");
        }
    }
}

/// With constant inputs. Fails if a long step takes one sample.
#[test]
fn a_long_step_takes_all_its_samples() {
    for model in [CONTROLLER, ESTIMATOR] {
        let [one, many] = [0, 1].map(|_| Fmu::started(model, &[("Zm", 2e-5)]));
        one.step(0.0, 400.0 * TS).ok(&one);
        for step in 0..400 {
            many.step(f64::from(step) * TS, TS).ok(&many);
        }
        assert_eq!(one.all_bits(), many.all_bits(), "{model}");
    }
}

/// Fails if the end of a step is compared with stopTime exactly, or not at all.
#[test]
fn stop_time_is_enforced_with_a_tolerance() {
    for model in [PLANT, CONTROLLER, ESTIMATOR] {
        let fmu = Fmu::new(model);
        fmu.start(0.0, Some(0.01));
        let mut time = 0.0;
        for _ in 0..10 {
            fmu.step(time, 1e-3).ok(&fmu);
            time += 1e-3;
        }
        assert!(time > 0.01, "a sum that rounding has put beyond the end: {time}");
        fmu.step(time, 1e-16).ok(&fmu);
        let text = fmu.step(time, 1e-3).error(&fmu);
        assert!(text.contains("beyond stopTime = 0.01"), "{text}");
        assert!(fmu.step(time, 1e-6).error(&fmu).contains("beyond stopTime"));
        // The instance is still usable.
        fmu.step(time, 0.0).ok(&fmu);
    }
}

/// Fails if the start of a step is not checked, or compared exactly, or if steps of any length are accepted.
#[test]
fn a_step_begins_where_the_last_one_ended() {
    for (start, model) in [(0.0, PLANT), (0.0, ESTIMATOR), (100.0, PLANT), (-3.0, CONTROLLER)] {
        let fmu = Fmu::new(model);
        fmu.start(start, None);
        fmu.step(start, 1e-3).ok(&fmu);
        let before = fmu.all_bits();
        for beside in [1e-3, -1e-3, 1e-6, 1.0, f64::INFINITY, f64::NAN] {
            let text = fmu.step(start + 1e-3 + beside, 1e-3).error(&fmu);
            assert_contains(&text, &["currentCommunicationPoint", "the end of the last step"]);
        }
        for length in [-1e-3, -1e-300, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_contains(&fmu.step(start + 1e-3, length).error(&fmu), &["communicationStepSize", "is refused"]);
        }
        assert_eq!(fmu.all_bits(), before, "refused steps leave no trace");
        fmu.step(start + 1e-3 + 1e-13, 1e-3).ok(&fmu);
        fmu.step(start + 2e-3 - 1e-13, 1e-3).ok(&fmu);
        // With a sample time of 0.1 ms this step would take hours.
        let text = fmu.step(start + 3e-3, 1e9).error(&fmu);
        assert_contains(&text, &["communicationStepSize = 1000000000 is refused"]);
        fmu.step(start + 3e-3, 1e-3).ok(&fmu);
    }
}

/// A controller acts one sample later, and the sample at the end of a step belongs to the next one, whose inputs it sees. Fails if the clock
/// takes it too early, or if a shorter step makes the controller act earlier.
#[test]
fn a_controller_acts_one_sample_later_whatever_the_steps() {
    let [start, halves, whole] = [0, 2, 1].map(|steps| {
        let fmu = Fmu::started(CONTROLLER, &[("Ym", 1e-5)]);
        let length = TS / f64::from(steps.max(1));
        for step in 0..steps {
            assert_eq!(fmu.get("i[1]"), Fmu::started(CONTROLLER, &[]).get("i[1]"), "not before a sample has passed");
            fmu.step(f64::from(step) * length, length).ok(&fmu);
        }
        fmu
    });
    assert_ne!(start.get("i[1]"), whole.get("i[1]"));
    assert_eq!(halves.all_bits(), whole.all_bits(), "one sample each");
    whole.step(TS, TS).ok(&whole);
    assert_ne!(halves.all_bits(), whole.all_bits(), "the second sample shows");
}

/// Parameters such as the time of an update refer to simulation time.
/// Fails if the update ignores the start time; never ends if the samples do.
#[test]
fn a_start_time_shifts_samples_and_nothing_else() {
    for model in [CONTROLLER, ESTIMATOR] {
        // A power of two, so that times are shifted without rounding.
        let [here, there] = [0.0, 4.0].map(|start| {
            let fmu = Fmu::new(model);
            if model == CONTROLLER {
                let update = [("update.mode", 2.0), ("update.time", start + 20.5 * TS), ("lambdaValid", 1.0)];
                let estimates = [("lambdaHat[1]", 2e-6), ("lambdaHat[2]", 2e-6), ("lambdaHat[3]", 2e-6)];
                for (name, value) in update.into_iter().chain(estimates) {
                    fmu.set(name, value).ok(&fmu);
                }
            }
            fmu.start(start, Some(start + 1.0));
            for step in 0..40 {
                fmu.set("Ym", wave(step)).ok(&fmu);
                fmu.step(start + step as f64 * TS, TS).ok(&fmu);
            }
            fmu
        });
        if model == CONTROLLER {
            assert_eq!(there.get("lambdaUsed[1]"), 2e-6, "the update has taken place");
        }
        let outputs = |fmu: &Fmu| {
            let names = fmu.variables().iter().filter(|variable| !variable.is_settable());
            names.map(|variable| fmu.get(&variable.name).to_bits()).collect::<Vec<_>>()
        };
        assert_eq!(outputs(&here), outputs(&there), "{model}");
    }
}
