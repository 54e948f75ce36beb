//! The estimator's statement of its own error: over many seeds, in every scenario of a matrix, and when λ changes.

use std::ops::Range;

use crate::program::open;
use fmu_export::variable::Value;
use magnetic_bearing::simulation::scenario::Scenario;
use magnetic_bearing::simulation::simulate;
use magnetic_bearing::studies::montecarlo::{self, NOISE};

/// While an estimate is valid its error must stay below this many of its standard deviations.
const CONFIDENT: f64 = 5.0;

/// Outputs of the estimator at an instant.
struct Said {
    time_s: f64,
    valid: bool,
    hat: [f64; 3],
    std: [f64; 3],
    verdict: f64,
}

/// Outputs of the estimator in a run of so many seconds, and its messages. Inputs of the estimator may be altered on their way.
fn said(
    scenario: &Scenario,
    end_s: f64,
    mut alter: impl FnMut(f64, &mut dyn FnMut(&str, Value)),
) -> (Vec<Said>, Vec<String>) {
    let mut scenario = scenario.clone();
    scenario.duration_s = end_s;
    let connections = scenario.connections();
    let place =
        |name: &str| connections.iter().position(|c| c.to[0] == "estimator" && c.to[1] == name).expect("an input");
    let altered = |time_s: f64, values: &mut [Value]| alter(time_s, &mut |name, value| values[place(name)] = value);
    let wanted = |path: &str| ["estimator.lambda", "estimator.v"].iter().any(|start| path.starts_with(start));
    let run = simulate::run_altered(&scenario, wanted, altered, |_| ()).expect("a good scenario");
    let read = |name: &str, row: usize| run.recording.get(&format!("estimator.{name}")).expect("an output")[row];
    let magnets = |name: &str, row: usize| [1, 2, 3].map(|k| read(&format!("{name}[{k}]"), row));
    let of_row = |row: usize| Said {
        time_s: run.recording.time_s[row],
        valid: read("valid", row) == 1.0,
        hat: magnets("lambdaHat", row),
        std: magnets("lambdaStd", row),
        verdict: read("verdict", row),
    };
    ((1..run.recording.time_s.len()).map(of_row).collect(), run.messages)
}

/// A sinusoidal force along y within an interval in s, in N and rad/s.
fn blow(scenario: &mut Scenario, within_s: &Range<f64>, amplitude_n: f64, rate_rad_s: f64) {
    let force = |time_s: f64| if within_s.contains(&time_s) { amplitude_n * (rate_rad_s * time_s).sin() } else { 0.0 };
    let time_s: Vec<f64> = (0..=6000).map(|step| f64::from(step) * scenario.step_s).collect();
    let load_n: Vec<f64> = time_s.iter().map(|time_s| 10.0 + force(*time_s)).collect();
    scenario.follow(&["plant.pY"], &time_s, load_n, true);
}

fn truth(scenario: &Scenario) -> [f64; 3] {
    scenario.truth().try_into().expect("three magnets")
}

/// Greatest |error|/standard deviation while valid, and how often it was valid.
fn confidence<'s>(said: impl IntoIterator<Item = &'s Said>, truth: &[f64; 3]) -> (f64, usize) {
    let valid: Vec<&Said> = said.into_iter().filter(|said| said.valid).collect();
    let ratio = |said: &&Said| (0..3).map(|k| ((said.hat[k] - truth[k]) / said.std[k]).abs()).fold(0.0, f64::max);
    (valid.iter().map(ratio).fold(0.0, f64::max), valid.len())
}

/// Settings of the scenario, by element and variable.
type Settings = &'static [(&'static str, &'static str, f64)];

/// Scenarios: name, base, settings, whether the final estimate must be valid.
const MATRIX: [(&str, &str, Settings, Option<bool>); 10] = [
    ("as it is", "unbalanced", &[], Some(true)),
    ("heavy unbalance", "unbalanced", &[("plant", "unbalance.magnitude", 5e-4)], Some(true)),
    ("the paper's perturbation", "paper", &[], None),
    ("the paper's perturbation and unbalance", "paper", &[("plant", "unbalance.magnitude", 2e-4)], None),
    ("another bearing", "turned", &[("plant", "unbalance.magnitude", 1e-4)], Some(true)),
    (
        "circle",
        "unbalanced",
        &[("controller", "reference.rY", 5e-5), ("controller", "reference.rZ", 5e-5), ("plant", "Y0", 5e-5)],
        None,
    ),
    (
        "rotor at rest",
        "unbalanced",
        &[
            ("plant", "omega", 0.0),
            ("plant", "Y0", 0.0),
            ("plant", "vZ0", 0.0),
            ("controller", "reference.omega", 0.0),
            ("controller", "reference.rY", 0.0),
            ("controller", "reference.rZ", 0.0),
        ],
        Some(false),
    ),
    ("wrong hold", "unbalanced", &[("estimator", "hold", 2.0)], None),
    ("a force along y that turns with nothing", "unbalanced", &[("plant", "perturbation.amplitudeY", 5.0)], None),
    (
        "slow perturbation",
        "unbalanced",
        &[("plant", "perturbation.amplitudeZ", 5.0), ("plant", "perturbation.omega", 30.0)],
        None,
    ),
];

/// The scenario of a row of the matrix.
fn row(base: &str, settings: Settings, method: i32, noise: [f64; 2], told: bool) -> Scenario {
    let mut scenario = montecarlo::study("", &open(base, &[]), noise, told, 1).scenario;
    for (element, variable, value) in settings {
        let value = if *variable == "hold" { Value::Integer(*value as i32) } else { Value::Real(*value) };
        scenario.set(element, variable, value);
    }
    scenario.set("estimator", "method", method);
    scenario
}

/// The bearing of the scenario `unbalanced` with the method `predictionError`.
fn unbalanced(noise: [f64; 2], told: bool) -> Scenario {
    row("unbalanced", &[], 3, noise, told)
}

/// When a synchronous force that is no unbalance has been seen though the noise is not told, or a load that changes slowly, s.
const SEEN_S: f64 = 0.2;

#[test]
fn never_confident_and_wrong() {
    let mut misses = Vec::new();
    for method in [3, 2] {
        for (noise, told) in [([0.0; 2], false), (NOISE, false), (NOISE, true)] {
            for (name, base, settings, wanted) in MATRIX {
                let scenario = row(base, settings, method, noise, told);
                let (said, _) = said(&scenario, 0.3, |_, _| ());
                // A synchronous force along a line turns partly backward. While noise is sought it passes for noise; README, "What is
                // not seen".
                let backward = method == 3 && !told && name.starts_with("the paper's perturbation");
                // A load that changes slowly is constant over the first revolutions.
                let slow = method == 3 && name == "slow perturbation";
                let from_s = if backward || slow { SEEN_S } else { 0.0 };
                let (worst, valid) = confidence(said.iter().filter(|said| said.time_s > from_s), &truth(&scenario));
                let last = said.last().expect("a run");
                let case = format!("method {method}, noise {noise:?}, told {told}, {name}");
                println!("{case}: {worst:.1} standard deviations at most, valid {valid} of {}", said.len());
                if worst > CONFIDENT {
                    misses.push(format!("{case}: {worst:.1} standard deviations, limit {CONFIDENT}"));
                }
                if method == 3 && wanted.is_some_and(|wanted| wanted != last.valid) {
                    misses.push(format!("{case}: valid {} at the end, wanted {wanted:?}", last.valid));
                }
            }
        }
    }
    assert!(misses.is_empty(), "{}", misses.join("\n"));
}

/// The largest relative error of an estimate.
fn largest_error(said: &Said, truth: &[f64; 3]) -> f64 {
    (0..3).map(|k| (said.hat[k] / truth[k] - 1.0).abs()).fold(0.0, f64::max)
}

/// A step of a tenth in one λ is followed to within 1 % in a quarter of a second (without any noise, which then has to be found to be none), and the estimate says so meanwhile.
#[test]
fn a_step_of_lambda_is_followed() {
    const STEP_S: f64 = 0.25;
    const FOLLOWED_S: f64 = 0.25;
    /// Longest time in which the step cannot be known yet: half a revolution.
    const NOTICED_S: f64 = 0.01;
    for (noise, told) in [([0.0; 2], false), (NOISE, false), (NOISE, true)] {
        for (magnet, factor) in [(1, 1.1), (2, 1.1), (3, 0.9)] {
            let mut scenario = unbalanced(noise, told);
            let mut after = truth(&scenario);
            after[magnet - 1] *= factor;
            scenario.follow(&[&format!("plant.lambda[{magnet}]")], &[STEP_S], [after[magnet - 1]], true);
            let (mut said, messages) = said(&scenario, STEP_S + FOLLOWED_S + 0.1, |_, _| ());
            said.retain(|said| said.time_s > STEP_S + 1e-9);
            let noticed = said.iter().find(|said| !said.valid).map(|said| said.time_s - STEP_S);
            let recovered =
                said.iter().skip_while(|said| said.valid).find(|said| said.valid).map(|said| said.time_s - STEP_S);
            let late = said.iter().filter(|said| said.time_s > STEP_S + FOLLOWED_S);
            let worst = late.map(|said| largest_error(said, &after)).fold(0.0, f64::max);
            let (ratio, _) = confidence(said.iter().filter(|said| said.time_s > STEP_S + NOTICED_S), &after);
            println!(
                "noise {noise:?} told {told} magnet {magnet}: noticed {noticed:?}, valid again {recovered:?}, then {:.3} %, {ratio:.1} std",
                100.0 * worst
            );
            assert!(worst < 0.01, "magnet {magnet}: {:.3} % after {FOLLOWED_S} s, limit 1 %", 100.0 * worst);
            assert!(
                noticed.is_some_and(|noticed| noticed < NOTICED_S),
                "noticed after {noticed:?} s, limit {NOTICED_S}"
            );
            assert!(ratio < CONFIDENT, "magnet {magnet}: {ratio:.1} standard deviations once the step can be known");
            assert!(messages.iter().any(|line| line.contains("contradict")), "{messages:?}");
        }
    }
}

/// A run-up by 500 rpm per second, with a window of 20 ms throughout.
#[test]
fn speed_may_change() {
    let mut scenario = unbalanced([0.0; 2], false);
    let truth = truth(&scenario);
    let speeds = [1.0, 7.0 / 6.0].map(|part| 100.0 * std::f64::consts::PI * part);
    scenario.follow(&["plant.omega", "controller.reference.omega"], &[0.0, 1.0], speeds, false);
    let (said, _) = said(&scenario, 1.0, |_, _| ());
    let late: Vec<&Said> = said.iter().filter(|said| said.time_s > 0.1).collect();
    let worst = late.iter().map(|said| largest_error(said, &truth)).fold(0.0, f64::max);
    println!("largest error {:.4} %", 100.0 * worst);
    assert!(late.iter().all(|said| said.valid));
    // Without noise λ is to be within 0.05 %.
    assert!(worst < 5e-4, "{:.4} %, limit 0.05 %", 100.0 * worst);
}

/// Disturbed samples: the estimate becomes invalid for a stated reason, is held, and becomes valid again by itself.
#[test]
fn disturbances_are_named_and_forgotten() {
    /// Samples disturbed before the verdict changed are forgotten after ten revolutions.
    const BACK_S: f64 = 0.25;
    let faults = [
        ("sensor missing", "not finite", "Ym", f64::NAN),
        ("sensor stuck", "reads the same", "Zm", 1.2e-5),
        ("contact told", "contact", "contact", 1.0),
        ("disabled", "enable is false", "enable", 0.0),
        ("no current in a magnet", "not valid", "im[2]", 0.0),
        ("an unknown blow", "not valid", "pY", 40.0),
    ];
    let within_s = 0.15 - 1e-9..0.2 - 1e-9;
    for noise in [[0.0; 2], NOISE] {
        for (name, reason, input, value) in faults {
            let mut scenario = unbalanced(noise, true);
            let truth = truth(&scenario);
            let is_reading = ["Ym", "Zm", "im[2]"].contains(&input);
            if input == "pY" {
                blow(&mut scenario, &within_s, value, 900.0);
            } else if !is_reading {
                let values = [value == 1.0, value != 1.0];
                scenario.follow(&[&format!("estimator.{input}")], &[0.15, 0.2], values, true);
            }
            let (said, mut messages) = said(&scenario, 0.6, |time_s, set| {
                if is_reading && within_s.contains(&time_s) {
                    set(input, Value::Real(value));
                }
            });
            messages.retain(|line| line.starts_with("estimator"));
            let before = said.iter().rfind(|said| said.time_s < 0.15 + 1e-9).expect("samples");
            let during = || said.iter().filter(|said| said.time_s > 0.15 + 1e-9);
            let invalid = during().find(|said| !said.valid).map(|said| said.time_s - 0.15);
            let after = said.iter().rev().take_while(|said| said.time_s > 0.2 + 1e-9);
            let back = after.take_while(|said| said.valid).last().map(|said| said.time_s - 0.2);
            println!(
                "{name}, noise {noise:?}: invalid after {invalid:?} s, valid again {back:?} s after the end; {messages:?}"
            );
            assert!(before.valid);
            assert!(invalid.is_some_and(|time_s| time_s < 0.01), "{name}: invalid after {invalid:?} s, limit 0.01");
            assert!(messages.iter().any(|line| line.contains(reason)), "{name}: {reason:?} is not in {messages:?}");
            // A magnet that was without current leaves a shorter memory, which may outlast the run.
            let lasting = name == "no current in a magnet";
            assert!(
                lasting || back.is_some_and(|time_s| time_s < BACK_S),
                "{name}: valid again after {back:?} s, limit {BACK_S}"
            );
            let (worst, _) = confidence(during().filter(|said| said.time_s > 0.16), &truth);
            assert!(worst < CONFIDENT, "{name}: {worst:.1} standard deviations while valid, limit {CONFIDENT}");
        }
    }
}

/// At 1 µm the closed loop transmits the position noise to the currents. Part of the effect is corrected, and the standard deviation covers the rest.
#[test]
fn noise_that_is_fed_back_is_covered() {
    const RUNS: usize = 200;
    let study = montecarlo::study("", &open("unbalanced", &[]), [10.0 * NOISE[0], NOISE[1]], true, RUNS);
    let [_, late] = study.run().expect("a good scenario").figures.try_into().expect("two instants");
    println!("{late:.4?}");
    // A backward force that cannot be excluded leaves some of them uncertain.
    assert!(late.valid >= RUNS * 19 / 20, "{}", late.valid);
    for k in 0..3 {
        let normalised = late.normalised[k];
        assert!((0.8..=1.25).contains(&normalised), "lambda[{}]: error/std {normalised:.2}", k + 1);
        assert!(late.bias[k].abs() < late.rms[k] / 3.0, "bias {:?}, rms {:?}", late.bias, late.rms);
    }
    assert!(late.worst < CONFIDENT, "{:.1} standard deviations", late.worst);
}

/// The paper's method is valid on the paper's simulation, and says no more where an unbalance makes it wrong by half.
#[test]
fn the_papers_method_knows_its_limit() {
    for (name, wanted) in [("paper", true), ("experiment", false)] {
        let run = simulate::run(&open(name, &[])).expect("a good scenario");
        let valid = run.recording.get("paper.valid").expect("the scenario compares the method");
        let late: Vec<f64> =
            run.recording.time_s.iter().zip(valid).filter(|(t, _)| **t >= 0.1).map(|(_, valid)| *valid).collect();
        assert!(late.iter().all(|valid| (*valid == 1.0) == wanted), "{name}: wanted {wanted} from 0.1 s on");
    }
}

/// Limits of the issue for the rms error, in per cent, and what the measured currents allow for λ3.
#[test]
fn errors_over_many_seeds() {
    const RUNS: usize = 60;
    /// rms error over the bound of Cramér and Rao.
    const OVER_BOUND: f64 = 1.3;
    /// Greatest rms error in per cent at 35 ms; at 100 ms the bound itself is 0.10, 0.22, 0.27 %.
    const AT_35_MS: f64 = 0.6;
    const AT_100_MS: [f64; 3] = [0.25, 0.25, 0.32];
    for told in [true, false] {
        let mut study = montecarlo::study("", &open("unbalanced", &[]), NOISE, told, RUNS);
        study.instants_s = vec![0.035, 0.1];
        let [early, late] = study.run().expect("a good scenario").figures.try_into().expect("two instants");
        println!("told {told}: {early:.5?}\n{late:.5?}");
        assert_eq!(late.valid, RUNS);
        for (k, limit) in AT_100_MS.into_iter().enumerate() {
            // Noise that is to be found first is not by then.
            assert!(
                !told || 100.0 * early.rms[k] < AT_35_MS,
                "lambda[{}] at 35 ms: {:.3} %",
                k + 1,
                100.0 * early.rms[k]
            );
            assert!(100.0 * late.rms[k] < limit, "lambda[{}] at 100 ms: {:.3} %", k + 1, 100.0 * late.rms[k]);
            assert!(late.rms[k] < OVER_BOUND * late.bound[k], "{:?} over {:?}", late.rms, late.bound);
            // Noise that is estimated is taken for 15 % too large at that instant.
            let least = if told { 0.8 } else { 0.65 };
            assert!((least..=1.25).contains(&late.normalised[k]), "error/std: {:?}", late.normalised);
            // A third of the error, and three standard errors of the mean of so many runs.
            let bias = late.rms[k] / 3.0 + 3.0 * late.rms[k] / (RUNS as f64).sqrt();
            assert!(late.bias[k].abs() < bias, "bias {:?}", late.bias);
        }
        assert!(late.unbalance[0] < 0.01 && late.unbalance[1] < 0.02, "unbalance {:?}", late.unbalance);
    }
}

/// After an unknown force of 10 to 60 N for 50 ms the estimate is right whenever it is valid, and valid again within three revolutions in the median.
#[test]
fn blows_are_forgotten() {
    const BLOWS: u32 = 40;
    let (mut wrong, mut back_s) = (0, Vec::new());
    for noise in [[0.0; 2], NOISE] {
        for told in [true, false] {
            for number in 0..BLOWS {
                let (amplitude_n, rate_rad_s) = (10.0 + 10.0 * f64::from(number % 6), 400.0 + 61.0 * f64::from(number));
                let mut scenario = unbalanced(noise, told);
                blow(&mut scenario, &(0.15 - 1e-9..0.2 - 1e-9), amplitude_n, rate_rad_s);
                let (mut said, _) = said(&scenario, 0.6, |_, _| ());
                let back =
                    said.iter().rev().take_while(|said| said.valid).last().map_or(f64::INFINITY, |said| said.time_s);
                back_s.push(back - 0.2);
                said.retain(|said| said.time_s > 0.16);
                let (worst, _) = confidence(&said, &truth(&scenario));
                if worst >= CONFIDENT {
                    wrong += 1;
                    println!("{amplitude_n} N, {rate_rad_s} rad/s, noise {noise:?}, told {told}: {worst:.1}");
                }
            }
        }
    }
    back_s.sort_by(f64::total_cmp);
    let [median, most] = [back_s.len() / 2, back_s.len() * 9 / 10].map(|n| back_s[n]);
    println!("{wrong} of {} wrong; valid again after {median:.3} s, nine in ten after {most:.3} s", back_s.len());
    assert!(wrong <= back_s.len() / 100, "{wrong} of {} valid and wrong", back_s.len());
    assert!(median < 0.075 && most < 0.125, "valid again after {median:.3} s, nine in ten after {most:.3} s");
}

/// Whatever hits the rotor, and however often, `valid` changes at most five times within any second.
#[test]
fn valid_is_calm() {
    for every_s in [0.15, 0.2, 0.3] {
        let mut scenario = unbalanced(NOISE, true);
        let blows = 1..=(3.0 / every_s) as u32;
        let time_s: Vec<f64> =
            blows.flat_map(|blow| [0.0, 0.01].map(|more_s| f64::from(blow) * every_s + more_s)).collect();
        scenario.follow(&["plant.pY"], &time_s, [40.0, 10.0].repeat(time_s.len() / 2), true);
        let (said, _) = said(&scenario, time_s[time_s.len() - 1], |_, _| ());
        let mut changes = Vec::new();
        for pair in said.windows(2).filter(|pair| pair[0].valid != pair[1].valid) {
            changes.push(pair[1].time_s);
        }
        let within = |from_s: f64| changes.iter().filter(|at_s| (from_s..from_s + 1.0).contains(*at_s)).count();
        let most = changes.iter().map(|from_s| within(*from_s)).max().unwrap_or(0);
        assert!((4..=5).contains(&most), "a blow every {every_s} s: {most} changes within a second, {changes:?}");
    }
}

/// A bearing that does not change is known the better the longer it runs: no false change, no backward force that is only the bias of noisy currents.
#[test]
fn a_long_run_keeps_its_estimate() {
    for (seed, end_s) in [(1, 24.0), (90_003, 12.0), (90_004, 12.0)] {
        let mut scenario = unbalanced(NOISE, false);
        scenario.set("plant", "sensor.seed", seed);
        let (said, _) = said(&scenario, end_s, |_, _| ());
        let refused = said.iter().filter(|said| said.time_s > 0.2 && !said.valid).count();
        assert_eq!(refused, 0, "seed {seed}: samples that are not valid");
        let last = said.last().expect("a run");
        let error = largest_error(last, &truth(&scenario));
        assert!(error < 1e-3, "seed {seed}: {:.3} % after {end_s} s", 100.0 * error);
    }
}

/// An estimator that runs twice as fast as the sensors sees every other sample repeated. It says that this does not fit, and states nothing wrong.
#[test]
fn every_other_sample_may_be_missing() {
    let mut scenario = unbalanced(NOISE, false);
    scenario.step_s = 5e-5;
    scenario.set("estimator", "Ts", 5e-5);
    let (said, _) = said(&scenario, 0.6, |_, _| ());
    let (worst, _) = confidence(&said, &truth(&scenario));
    assert!(worst < CONFIDENT, "{worst:.1} standard deviations");
    let collecting = 2.0;
    assert_ne!(said.last().expect("a run").verdict, collecting, "still collecting after 0.6 s");
}
