//! The stated standard deviations: over many seeds, in every scenario of a matrix, and when λ changes.

use crate::prelude::*;
use magnetic_bearing::studies::montecarlo::hostile;

/// While an estimate is valid, its error must stay below this many of its standard deviations.
const CONFIDENT: f64 = 5.0;

/// Outputs of an estimator at an instant.
pub struct Output {
    time_s: f64,
    valid: bool,
    hat: [f64; 3],
    std: [f64; 3],
    total: [f64; 3],
    verdict: f64,
}

/// Outputs of an estimator at every sample of a run.
pub fn outputs_of(run: &Run, estimator: &str) -> Vec<Output> {
    let signal = |name: &str| column(run, &format!("{estimator}.{name}"));
    let [valid, verdict] = ["valid", "verdict"].map(signal);
    let [hat, std, total] =
        ["lambdaHat", "lambdaStd", "lambdaStdTotal"].map(|name| [1, 2, 3].map(|k| signal(&format!("{name}[{k}]"))));
    let of_row = |row: usize| Output {
        time_s: run.recording.time_s[row],
        valid: valid[row] == 1.0,
        hat: hat.map(|hat| hat[row]),
        std: std.map(|std| std[row]),
        total: total.map(|total| total[row]),
        verdict: verdict[row],
    };
    (1..run.recording.time_s.len()).map(of_row).collect()
}

/// Outputs of the estimator in the loop up to a time in s.
fn outputs(scenario: &Scenario, end_s: f64) -> Vec<Output> {
    let mut scenario = scenario.clone();
    scenario.duration_s = end_s;
    let wanted = |path: &str| ["estimator.lambda", "estimator.v"].iter().any(|start| path.starts_with(start));
    outputs_of(&simulate::run_for(&scenario, wanted).expect("a good scenario"), "estimator")
}

pub fn truth(scenario: &Scenario) -> [f64; 3] {
    scenario.truth().try_into().expect("three magnets")
}

/// The largest relative error of an estimate.
fn largest_error(output: &Output, truth: &[f64; 3]) -> f64 {
    (0..3).map(|k| (output.hat[k] / truth[k] - 1.0).abs()).fold(0.0, f64::max)
}

/// Greatest |error| of the valid samples in standard deviations due to noise, and in total ones.
pub fn deviations<'s>(outputs: impl IntoIterator<Item = &'s Output>, truth: &[f64; 3]) -> [f64; 2] {
    outputs.into_iter().filter(|output| output.valid).fold([0.0; 2], |most, Output { hat, std, total, .. }| {
        let largest = |std: &[f64; 3]| (0..3).map(|k| ((hat[k] - truth[k]) / std[k]).abs()).fold(0.0, f64::max);
        [most[0].max(largest(std)), most[1].max(largest(total))]
    })
}

/// Changes of the scenario.
type Settings = &'static [(&'static str, &'static str)];

/// Scenarios: name, base, settings, whether the final estimate must be valid.
const MATRIX: [(&str, &str, Settings, Option<bool>); 10] = [
    ("as it is", "unbalanced", &[], Some(true)),
    ("heavy unbalance", "unbalanced", &[("plant.unbalance.magnitude", "5e-4")], Some(true)),
    ("the paper's perturbation", "paper", &[], None),
    ("the paper's perturbation and unbalance", "paper", &[("plant.unbalance.magnitude", "2e-4")], None),
    ("another bearing", "turned", &[("plant.unbalance.magnitude", "1e-4")], Some(true)),
    ("circle", "unbalanced", &[("reference.rY", "5e-5"), ("reference.rZ", "5e-5"), ("Y0", "5e-5")], None),
    ("rotor at rest", "standstill", &[("F0.modulation", "0")], Some(false)),
    ("wrong hold", "unbalanced", &[("hold", "heldAfter")], None),
    ("a force along y that turns with nothing", "unbalanced", &[("perturbation.amplitudeY", "5")], None),
    ("slow perturbation", "unbalanced", &[("perturbation.amplitudeZ", "5"), ("perturbation.omega", "30")], None),
];

/// The scenario of a row of the matrix.
fn scenario_of(base: &str, settings: Settings, method: i32, noise: [f64; 2], known: bool) -> Scenario {
    let mut scenario = montecarlo::study("", &open(base, settings), noise, known, 1).scenario;
    scenario.set("estimator", "method", method);
    scenario
}

/// The bearing of the scenario `unbalanced` with the method `predictionError`.
fn unbalanced(noise: [f64; 2], known: bool) -> Scenario {
    scenario_of("unbalanced", &[], 3, noise, known)
}

/// Time in s after which a synchronous force other than unbalance is detected with unknown noise, or a slowly changing load.
const DETECTED_S: f64 = 0.2;

#[test]
fn never_confident_and_wrong() {
    let mut misses = Vec::new();
    let noises = [([0.0; 2], false), (NOISE, false), (NOISE, true)];
    for (method, (noise, known)) in [3, 2].into_iter().flat_map(|method| noises.map(|noise| (method, noise))) {
        for (name, base, settings, wanted) in MATRIX {
            let scenario = scenario_of(base, settings, method, noise, known);
            let outputs = outputs(&scenario, 0.3);
            // A synchronous force along a line is partly a backward force. While the noise level is being estimated it passes for noise;
            // docs/uncertainty.md, "Undetected errors".
            let backward = method == 3 && !known && name.starts_with("the paper's perturbation");
            // A slowly changing load is nearly constant over the first revolutions.
            let slow = method == 3 && name == "slow perturbation";
            let from_s = if backward || slow { DETECTED_S } else { 0.0 };
            let [worst, _] = deviations(outputs.iter().filter(|output| output.time_s > from_s), &truth(&scenario));
            let last = outputs.last().expect("a run");
            let case = format!("method {method}, noise {noise:?}, known {known}, {name}");
            if worst > CONFIDENT {
                misses.push(format!("{case}: {worst:.1} standard deviations, limit {CONFIDENT}"));
            }
            if method == 3 && wanted.is_some_and(|wanted| wanted != last.valid) {
                misses.push(format!("{case}: valid {} at the end, wanted {wanted:?}", last.valid));
            }
        }
    }
    assert!(misses.is_empty(), "{}", misses.join("\n"));
}

/// A run-up by 500 rpm per second, with a constant window of 20 ms.
#[test]
fn speed_may_change() {
    let mut scenario = unbalanced([0.0; 2], false);
    let speeds = [1.0, 7.0 / 6.0].map(|ratio| 100.0 * std::f64::consts::PI * ratio);
    scenario.follow(&["plant.omega", "controller.reference.omega"], &[0.0, 1.0], speeds, false);
    let mut late = outputs(&scenario, 1.0);
    late.retain(|output| output.time_s > 0.1);
    assert!(late.iter().all(|output| output.valid));
    let worst = late.iter().map(|output| largest_error(output, &truth(&scenario))).fold(0.0, f64::max);
    assert!(worst < 5e-4, "{:.4} %, limit 0.05 %", 100.0 * worst);
}

/// The paper's method is valid on the paper's simulation, and not where an unbalance makes it wrong by half.
#[test]
fn the_papers_method_is_not_valid_with_an_unbalance() {
    for (name, wanted) in [("paper", 1.0), ("experiment", 0.0)] {
        let late = values_within(&scenario_and_run(name, &[]).1, "paper.valid", 0.1, f64::INFINITY);
        assert!(late.iter().all(|valid| *valid == wanted), "{name}: wanted {wanted} from 0.1 s on");
    }
}

/// Limits of the rms error at 35 and 100 ms, in per cent; that of λ3 is what the measured currents allow. At 1 µm the closed loop transmits
/// position noise to the currents. Part of the effect is corrected; the standard deviation covers the remainder.
#[test]
fn errors_over_many_seeds() {
    /// rms error over the Cramér–Rao bound.
    const OVER_BOUND: f64 = 1.3;
    /// Greatest rms error in per cent at 35 ms; at 100 ms the bound itself is 0.10, 0.22, 0.27 %.
    const AT_35_MS: f64 = 0.6;
    const AT_100_MS: [f64; 3] = [0.25, 0.25, 0.32];
    // Unknown noise is not yet estimated at 35 ms, and its estimate is 15 % too large at 100 ms. At 1 µm a backward force that cannot be
    // excluded leaves some runs too uncertain.
    let cases = [(1.0, true, 60, 60, 0.8), (1.0, false, 60, 60, 0.65), (10.0, true, 200, 190, 0.8)];
    for (factor, known, runs, least_valid, least_normalised) in cases {
        let noise = [factor * NOISE[0], NOISE[1]];
        let study = montecarlo::study("", &open("unbalanced", &[]), noise, known, runs);
        let [early, late] = study.run().expect("a good scenario").figures.try_into().expect("two instants");
        assert!(late.valid >= least_valid, "{factor} times 0.1 µm, known {known}: {} valid", late.valid);
        below("worst error in standard deviations", late.worst, CONFIDENT);
        for (k, limit) in AT_100_MS.into_iter().enumerate() {
            let what = format!("{factor} times 0.1 µm, known {known}, lambda[{}]", k + 1);
            between(&format!("{what}, error/std"), late.normalised[k], least_normalised, 1.25);
            if factor > 1.0 {
                below(&format!("{what}, bias"), late.bias[k].abs(), late.rms[k] / 3.0);
                continue;
            }
            assert!(!known || 100.0 * early.rms[k] < AT_35_MS, "{what} at 35 ms: {:.3} %", 100.0 * early.rms[k]);
            below(&format!("{what} at 100 ms, %"), 100.0 * late.rms[k], limit);
            below(&format!("{what}, rms error over bound"), late.rms[k] / late.bound[k], OVER_BOUND);
            // A third of the error, and three standard errors of the mean of this many runs.
            let limit = late.rms[k] / 3.0 + 3.0 * late.rms[k] / (runs as f64).sqrt();
            below(&format!("{what}, bias"), late.bias[k].abs(), limit);
        }
        assert!(factor > 1.0 || (late.unbalance[0] < 0.01 && late.unbalance[1] < 0.02), "{:?}", late.unbalance);
    }
}

/// After an unknown force of 10 to 60 N for 50 ms the estimate is correct whenever it is valid, and in the median valid again within three revolutions.
#[test]
fn blows_are_forgotten() {
    const BLOWS: u32 = 40;
    let (mut wrong, mut back_s) = (0, Vec::new());
    let noises = [([0.0; 2], true), ([0.0; 2], false), (NOISE, true), (NOISE, false)];
    for ((noise, known), number) in noises.into_iter().flat_map(|noise| (0..BLOWS).map(move |number| (noise, number))) {
        let (amplitude_n, rate_rad_s) = (10.0 + 10.0 * f64::from(number % 6), 400.0 + 61.0 * f64::from(number));
        let mut scenario = unbalanced(noise, known);
        let within_s = 0.15 - 1e-9..0.2 - 1e-9;
        let force = |time_s: &f64| if within_s.contains(time_s) { (rate_rad_s * time_s).sin() } else { 0.0 };
        let time_s: Vec<f64> = (0..=6000).map(|step| f64::from(step) * scenario.step_s).collect();
        let load_n = time_s.iter().map(|time_s| 10.0 + amplitude_n * force(time_s)).collect::<Vec<f64>>();
        scenario.follow(&["plant.pY"], &time_s, load_n, true);
        let outputs = outputs(&scenario, 0.6);
        let since = outputs.iter().rev().take_while(|output| output.valid).last();
        back_s.push(since.map_or(f64::INFINITY, |output| output.time_s - 0.2));
        let [worst, _] = deviations(outputs.iter().filter(|output| output.time_s > 0.16), &truth(&scenario));
        if worst >= CONFIDENT {
            wrong += 1;
            println!("{amplitude_n} N, {rate_rad_s} rad/s, noise {noise:?}, known {known}: {worst:.1}");
        }
    }
    back_s.sort_by(f64::total_cmp);
    let [median, most] = [back_s.len() / 2, back_s.len() * 9 / 10].map(|n| back_s[n]);
    assert!(wrong <= back_s.len() / 100, "{wrong} of {} valid and wrong", back_s.len());
    assert!(median < 0.075 && most < 0.125, "valid again after {median:.3} s, nine in ten after {most:.3} s");
}

/// Under repeated blows, `valid` changes at most five times within any second.
#[test]
fn valid_does_not_chatter() {
    for every_s in [0.15, 0.2, 0.3] {
        let mut scenario = unbalanced(NOISE, true);
        let blows = 1..=(3.0 / every_s) as u32;
        let time_s: Vec<f64> =
            blows.flat_map(|blow| [0.0, 0.01].map(|more_s| f64::from(blow) * every_s + more_s)).collect();
        scenario.follow(&["plant.pY"], &time_s, [40.0, 10.0].repeat(time_s.len() / 2), true);
        scenario.duration_s = time_s[time_s.len() - 1];
        let recording = run_to_end(&scenario).recording;
        let most = hostile::judge(&scenario, &recording, false).changes;
        assert!((4..=5).contains(&most), "a blow every {every_s} s: {most} changes within a second");
    }
}

/// The estimate of a constant bearing improves with time: no false change, no backward force that is only the bias of noisy currents, and no error
/// beyond the deviations.
#[test]
fn a_long_run_stays_valid() {
    for (seed, end_s, known) in [(1, 24.0, false), (90_003, 12.0, false), (90_004, 12.0, false), (8001, 10.0, true)] {
        let mut scenario = unbalanced(NOISE, known);
        scenario.set("plant", "sensor.seed", seed);
        let outputs = outputs(&scenario, end_s);
        let [_, worst] = deviations(&outputs, &truth(&scenario));
        assert!(worst < CONFIDENT, "seed {seed}: {worst:.1} standard deviations");
        let refused = outputs.iter().filter(|output| output.time_s > 0.2 && !output.valid).count();
        assert_eq!(refused, 0, "seed {seed}: samples that are not valid");
        let last = outputs.last().expect("a run");
        let error = largest_error(last, &truth(&scenario));
        assert!(error < 1e-3, "seed {seed}: {:.3} % after {end_s} s", 100.0 * error);
    }
}

/// On a trajectory of 40 Hz, whatever the speed, a force of 42 Hz beats with the motion, and λ seems to oscillate by percents twice a second. After one
/// beat period the estimate is refused.
#[test]
fn a_force_that_beats_with_the_motion_is_refused() {
    let settings = [
        ("controller.F0.modulation", "0.5"),
        ("controller.F0.modulationFrequency", "110 Hz"),
        ("controller.reference.omega", "251.327"),
        ("plant.perturbation.amplitudeY", "0.4"),
        ("plant.perturbation.amplitudeZ", "0.3"),
        ("plant.perturbation.omega", "263.894"),
    ];
    for (seed, known) in [(97_001, true), (97_002, true), (97_001, false), (97_002, false)] {
        let mut scenario = montecarlo::study("", &open("unbalanced", &settings), NOISE, known, 1).scenario;
        scenario.set("plant", "sensor.seed", seed);
        let mut outputs = outputs(&scenario, 1.5);
        outputs.retain(|output| output.time_s > 0.5);
        let valid = outputs.iter().filter(|output| output.valid).count();
        assert_eq!(valid, 0, "seed {seed}, known {known}: samples valid");
    }
}

/// An estimator that runs twice as fast as the sensors sees every other sample repeated. It detects the mismatch and states nothing wrong.
#[test]
fn every_other_sample_may_be_repeated() {
    let mut scenario = unbalanced(NOISE, false);
    scenario.step_s = 5e-5;
    scenario.set("estimator", "Ts", 5e-5);
    let outputs = outputs(&scenario, 0.6);
    let [worst, _] = deviations(&outputs, &truth(&scenario));
    assert!(worst < CONFIDENT, "{worst:.1} standard deviations");
    let collecting = 2.0;
    assert_ne!(outputs.last().expect("a run").verdict, collecting, "still collecting after 0.6 s");
}
