//! Maximum likelihood over whole recordings: accuracy, imperfect benches, changes.

use crate::bench::{Bench, Recorded};
use magnetic_bearing::app::identify::likelihood::{self, *};

fn recording<'a>(recorded: &'a Recorded, bench: &Bench, told: bool) -> Recording<'a> {
    Recording {
        step_s: bench.step,
        position_m: &recorded.position,
        current_a: &recorded.current,
        theta_rad: &recorded.theta,
        omega_rad_s: &recorded.omega,
        usable: &[],
        hold: CurrentHold::Before,
        position_noise_m: told.then_some(bench.position_noise),
        current_noise_a: told.then_some(bench.current_noise),
    }
}

fn options(bench: &Bench) -> Options {
    Options { threads: 2, ..Options::new(bench.m, bench.s, bench.alpha) }
}

#[test]
#[ignore = "prints one identification"]
fn show() {
    let seconds: f64 = std::env::var("SECONDS").map_or(0.5, |s| s.parse().unwrap());
    let noise: f64 = std::env::var("NOISE").map_or(1e-7, |s| s.parse().unwrap());
    let bench = Bench { seconds, position_noise: noise, ..Bench::default() };
    let recorded = bench.record();
    for told in [true, false] {
        let start = std::time::Instant::now();
        let found = likelihood::identify(&[recording(&recorded, &bench, told)], &options(&bench)).unwrap();
        println!("{:?}", start.elapsed());
        println!("{:?} {:?}", found.lambda, found.conditions);
        println!("{:?} {:?} {:?}", found.unbalance_magnitude, found.unbalance_phase, bench.unbalance);
        println!("{:?} {:?} {:?}", found.suspects, found.contradictions, found.residuals);
        println!("{} {} {:?}", found.iterations, found.converged, found.covariance);
        for line in &found.budget {
            println!("{} {:?}", PARAMETERS[line.parameter].name, line.sensitivity);
        }
    }
}

/// Bound of the three λ, from the same bench without noise.
fn bound(bench: &Bench, recorded: &Recorded, options: &Options) -> [f64; 3] {
    let truth = Recording {
        position_m: &recorded.true_position,
        current_a: &recorded.true_current,
        ..recording(recorded, bench, true)
    };
    let bound = likelihood::cramer_rao(&[truth], options).unwrap();
    [bound[0], bound[1], bound[2]]
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), value| (sum + value * value, n + 1.0));
    f64::sqrt(sum / n)
}

#[test]
#[ignore = "a study: bias and efficiency on the nominal bearing"]
fn study_nominal() {
    let draws: u64 = std::env::var("DRAWS").map_or(40, |s| s.parse().unwrap());
    for (seconds, noise, current) in [
        (1.0, 1e-7, 1e-2),
        (1.0, 1e-6, 1e-2),
        (5.0, 1e-6, 1e-2),
        (1.0, 1e-6, 5e-2),
        (1.0, 1e-7, 5e-2),
        (0.1, 1e-6, 1e-2),
        (5.0, 1e-6, 1e-3),
        (5.0, 3e-6, 1e-2),
    ]
    .into_iter()
    .enumerate()
    .filter(|(at, _)| std::env::var("ONLY").map_or(true, |only| only.contains(&at.to_string())))
    .map(|(_, case)| case)
    {
        for told in if std::env::var("TOLD").is_ok() { vec![true] } else { vec![true, false] } {
            let (mut errors, mut over_bound, mut over_std, mut worst) = (vec![], vec![], vec![], 0.0_f64);
            let mut slow = 0;
            let draws = if seconds > 2.0 { draws / 2 } else { draws };
            for seed in 0..draws {
                let bench = Bench {
                    seconds,
                    position_noise: noise,
                    current_noise: current,
                    lambda0: if std::env::var("TRUE0").is_ok() { Bench::default().lambda } else { [4e-6; 3] },
                    seed: std::env::var("SEED").map_or(1000, |s| s.parse::<u64>().unwrap()) + seed,
                    ..Bench::default()
                };
                let recorded =
                    if std::env::var("AFTER").is_ok() { bench.record_with_noise_afterwards() } else { bench.record() };
                let options = options(&bench);
                let bound = bound(&bench, &recorded, &options);
                let found = likelihood::identify(&[recording(&recorded, &bench, told)], &options).unwrap();
                slow += usize::from(!found.converged) + 1000 * usize::from(!found.contradictions.is_empty());
                let error: [f64; 3] = std::array::from_fn(|k| found.lambda[k].value - bench.lambda[k]);
                errors.push(std::array::from_fn::<f64, 3, _>(|k| error[k] / bound[k]));
                over_bound.extend((0..3).map(|k| error[k] / bound[k]));
                over_std.extend((0..3).map(|k| error[k] / found.lambda[k].total_std));
            }
            for value in &over_std {
                worst = worst.max(value.abs());
            }
            let mean: [f64; 3] =
                std::array::from_fn(|k| errors.iter().map(|error| error[k]).sum::<f64>() / errors.len() as f64);
            println!(
                "{seconds} s {noise:e} m {current} A told {told}: error/bound {:.3} error/std {:.3} worst {worst:.2} mean/bound {mean:.2?} (± {:.2}) {slow}",
                rms(over_bound.into_iter()),
                rms(over_std.into_iter()),
                1.0 / (draws as f64).sqrt()
            );
        }
    }
}

/// The bench errors of the issue, each in its parameter: name, change of the bench, what is told of it.
type Fault = (&'static str, fn(&mut Bench, f64), &'static [(&'static str, f64)]);

/// Every bench error with its tolerance; the function sets it to that many standard deviations.
const FAULTS: &[Fault] = &[
    ("m", |bench, t| bench.m_error = 0.01 * t, &[("m", 0.01)]),
    ("s", |bench, t| bench.s_error = 0.02 * t, &[("s", 0.02)]),
    ("alpha[1]", |bench, t| bench.alpha_error[0] = 0.035 * t, &[("alpha[1]", 0.035)]),
    ("alpha[2]", |bench, t| bench.alpha_error[1] = 0.035 * t, &[("alpha[2]", 0.035)]),
    ("alpha[3]", |bench, t| bench.alpha_error[2] = 0.035 * t, &[("alpha[3]", 0.035)]),
    ("offset y", |bench, t| bench.offset[0] = 1e-5 * t, &[("sensor.offset[y]", 1e-5)]),
    ("offset z", |bench, t| bench.offset[1] = 1e-5 * t, &[("sensor.offset[z]", 1e-5)]),
    ("gain", |bench, t| bench.gain = [0.01 * t; 2], &[("sensor.gain", 0.01)]),
    ("gain difference", |bench, t| bench.gain = [0.01 * t, -0.01 * t], &[("sensor.gainDifference", 0.01)]),
    ("rotation", |bench, t| bench.rotation = 0.0175 * t, &[("sensor.rotation", 0.0175)]),
    ("delay", |bench, t| bench.delay = 2e-5 * t.abs(), &[("delay", 2e-5)]),
    (
        "run-out 1",
        |bench, t| bench.runout1 = [1e-6 * t, 0.5e-6 * t, 0.0, 0.0],
        &[("runout1.forward.cos", 1e-6), ("runout1.forward.sin", 1e-6)],
    ),
    (
        "run-out 1 backward",
        |bench, t| bench.runout1 = [0.0, 0.0, 1e-6 * t, 0.5e-6 * t],
        &[("runout1.backward.cos", 1e-6), ("runout1.backward.sin", 1e-6)],
    ),
    (
        "run-out 2",
        |bench, t| bench.runout2 = [1e-6 * t, -1e-6 * t, 0.5e-6 * t, 0.0],
        &[("runout2.y.cos", 1e-6), ("runout2.y.sin", 1e-6), ("runout2.z.cos", 1e-6), ("runout2.z.sin", 1e-6)],
    ),
    (
        "current offset",
        |bench, t| bench.current_offset = [0.02 * t, -0.02 * t, 0.01 * t],
        &[("current.offset[1]", 0.02), ("current.offset[2]", 0.02), ("current.offset[3]", 0.02)],
    ),
    (
        "current gain",
        |bench, t| bench.current_gain = [0.01 * t, -0.01 * t, 0.005 * t],
        &[("current.gain[1]", 0.01), ("current.gain[2]", 0.01), ("current.gain[3]", 0.01)],
    ),
    ("iron", |bench, t| bench.iron = 1e-5 * t, &[("gap.iron", 1e-5)]),
    (
        "backward force",
        |bench, t| bench.backward = [t, 0.5 * t],
        &[("force.backward.cos", 1.0), ("force.backward.sin", 1.0)],
    ),
];

fn tell(options: &mut Options, tolerances: &[(&str, f64)]) {
    for (name, std) in tolerances {
        let at = by_name(name).unwrap_or_else(|| panic!("no parameter {name}"));
        options.bench[at].knowledge = Knowledge::Tolerance(*std);
    }
}

#[test]
#[ignore = "a study: every bench error with its tolerance"]
fn study_bench() {
    let draws: u64 = std::env::var("DRAWS").map_or(10, |s| s.parse().unwrap());
    for (name, set, tolerances) in FAULTS {
        let (mut ratios, mut noise, mut errors) = (vec![], vec![], vec![]);
        let mut plain = vec![];
        let mut lost = 0;
        for seed in 0..draws {
            let mut noise_source: [magnetic_bearing::model::noise::Noise; 1] =
                magnetic_bearing::model::noise::Noise::channels(7000 + seed);
            let mut bench = Bench { seconds: 0.5, seed: 3000 + seed, ..Bench::default() };
            set(&mut bench, noise_source[0].standard_normal());
            let recorded = bench.record();
            if !recorded.levitated {
                lost += 1;
                continue;
            }
            let mut options = options(&bench);
            let without = likelihood::identify(&[recording(&recorded, &bench, false)], &options).unwrap();
            tell(&mut options, tolerances);
            let found = likelihood::identify(&[recording(&recorded, &bench, false)], &options).unwrap();
            for k in 0..3 {
                let error = found.lambda[k].value - bench.lambda[k];
                ratios.push(error / found.lambda[k].total_std);
                noise.push(error / found.lambda[k].noise_std);
                errors.push(100.0 * error / bench.lambda[k]);
                plain.push(100.0 * (without.lambda[k].value / bench.lambda[k] - 1.0));
            }
        }
        let worst = ratios.iter().fold(0.0_f64, |worst, ratio| worst.max(ratio.abs()));
        println!(
            "{name:20} error/total {:.2} worst {worst:.2} error/noise {:.1} error {:.2} % (not told {:.2} %), lost {lost}",
            rms(ratios.into_iter()),
            rms(noise.into_iter()),
            rms(errors.into_iter()),
            rms(plain.into_iter())
        );
    }
}

#[test]
#[ignore = "a study: the mixed bench"]
fn study_mixed() {
    for seed in 0..6 {
        let bench = mixed(5000 + seed);
        let recorded = bench.record();
        let mut options = options(&bench);
        let without = likelihood::identify(&[recording(&recorded, &bench, false)], &options).unwrap();
        tell(&mut options, MIXED);
        let found = likelihood::identify(&[recording(&recorded, &bench, false)], &options).unwrap();
        let percent = |found: &Identification| -> [f64; 3] {
            std::array::from_fn(|k| 100.0 * (found.lambda[k].value / bench.lambda[k] - 1.0))
        };
        let stated: [f64; 3] = std::array::from_fn(|k| 100.0 * found.lambda[k].total_std / bench.lambda[k]);
        println!("{:.2?} stated {stated:.2?}, not told {:.2?} {}", percent(&found), percent(&without), found.converged);
    }
}

/// Section 4 of the study: 1° of rotation, offsets of 10 and −5 µm, gains of ±0.5 %, 20 µm of iron, a lag of 10 kHz, another bearing.
fn mixed(seed: u64) -> Bench {
    Bench {
        seconds: 1.0,
        seed,
        rotation: 1.0_f64.to_radians(),
        offset: [1e-5, -5e-6],
        gain: [5e-3, -5e-3],
        iron: 2e-5,
        sensor_lag: 1.0 / (std::f64::consts::TAU * 1e4),
        elliptic: [2.0, 4.7],
        ..Bench::default()
    }
}

const MIXED: &[(&str, f64)] = &[
    ("sensor.rotation", 0.02),
    ("sensor.offset[y]", 1e-5),
    ("sensor.offset[z]", 1e-5),
    ("sensor.gainDifference", 0.01),
    ("gap.iron", 2e-5),
    ("delay", 3e-5),
    ("force.backward.cos", 5.0),
    ("force.backward.sin", 5.0),
];

#[test]
#[ignore = "prints time for 1.2 million rows with all bench parameters"]
fn show_speed() {
    let seconds = std::env::var("SECONDS").map_or(120.0, |s| s.parse().unwrap());
    let bench = Bench { seconds, ..Bench::default() };
    let recorded = bench.record();
    let mut options = options(&bench);
    for (told, parameter) in options.bench.iter_mut().zip(&PARAMETERS) {
        told.knowledge = Knowledge::Tolerance(parameter.typical);
    }
    let start = std::time::Instant::now();
    let found = likelihood::identify(&[recording(&recorded, &bench, false)], &options).unwrap();
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let peak = status.lines().find(|line| line.starts_with("VmHWM")).unwrap().to_owned();
    println!("{:?}, {} iterations, converged {}, {peak}", start.elapsed(), found.iterations, found.converged);
    println!("{:?} {:?}", found.lambda, found.contradictions);
}

/// A bench of which everything is off by its typical tolerance, drawn.
fn drawn(seed: u64, base: Bench) -> (Bench, [f64; BENCH]) {
    let mut noise: [magnetic_bearing::model::noise::Noise; BENCH] =
        magnetic_bearing::model::noise::Noise::channels(seed);
    let d: [f64; BENCH] = std::array::from_fn(|j| {
        let value = PARAMETERS[j].typical * noise[j].standard_normal();
        // Sensors do not know the future.
        if PARAMETERS[j].name == "delay" { value.abs() } else { value }
    });
    let bench = Bench {
        seed,
        m_error: d[0],
        s_error: d[1],
        alpha_error: [d[2], d[3], d[4]],
        offset: [d[5], d[6]],
        gain: [d[7] + d[8], d[7] - d[8]],
        rotation: d[9],
        delay: d[10],
        runout1: [d[11], d[12], d[13], d[14]],
        runout2: [d[15], d[16], d[17], d[18]],
        current_offset: [d[19], d[20], d[21]],
        current_gain: [d[22], d[23], d[24]],
        iron: d[25],
        backward: [d[26], d[27]],
        ..base
    };
    (bench, d)
}

fn all_typical(bench: &Bench) -> Options {
    let mut options = options(bench);
    for (told, parameter) in options.bench.iter_mut().zip(&PARAMETERS) {
        told.knowledge = Knowledge::Tolerance(parameter.typical);
    }
    options
}

#[test]
#[ignore = "a study: all bench parameters drawn at once"]
fn study_drawn_benches() {
    for (seconds, noise, draws) in [(0.5, 1e-7, 40), (2.0, 1e-7, 10), (20.0, 1e-7, 5), (10.0, 1e-6, 5)] {
        let (mut lambda, mut parameters, mut slow) = (vec![], vec![], 0);
        for seed in 60_001..60_001 + draws {
            let (bench, truth) = drawn(seed, Bench { seconds, position_noise: noise, ..Bench::default() });
            let recorded = bench.record();
            let found = likelihood::identify(&[recording(&recorded, &bench, false)], &all_typical(&bench)).unwrap();
            slow += usize::from(!found.converged);
            lambda.extend((0..3).map(|k| (found.lambda[k].value - bench.lambda[k]) / found.lambda[k].total_std));
            let off = |j: usize| (found.bench[j].estimate.value - truth[j]) / found.bench[j].estimate.total_std;
            parameters.extend((0..BENCH).map(off));
        }
        let worst = |of: &[f64]| of.iter().fold(0.0_f64, |worst, ratio| worst.max(ratio.abs()));
        println!(
            "{seconds} s, {noise:e} m, {draws} draws: λ error/total {:.2} worst {:.2}, bench parameters {:.2} worst {:.2}, not converged {slow}",
            rms(lambda.iter().copied()),
            worst(&lambda),
            rms(parameters.iter().copied()),
            worst(&parameters)
        );
    }
}

/// A bench that is off in everything converges to within its deviations, from a second to more rows than the likelihood is believed.
#[test]
fn a_drawn_bench_is_found() {
    for (seed, seconds) in [(60_101, 0.5), (60_102, 0.5), (60_103, 7.0)] {
        let (bench, truth) = drawn(seed, Bench { seconds, ..Bench::default() });
        let recorded = bench.record();
        let found = likelihood::identify(&[recording(&recorded, &bench, false)], &all_typical(&bench)).unwrap();
        assert!(found.converged, "seed {seed}: {} iterations", found.iterations);
        for k in 0..3 {
            let error = (found.lambda[k].value - bench.lambda[k]) / found.lambda[k].total_std;
            assert!(error.abs() < 4.0, "seed {seed}, λ{k}: {error} standard deviations");
        }
        for (j, parameter) in PARAMETERS.iter().enumerate() {
            let error = (found.bench[j].estimate.value - truth[j]) / found.bench[j].estimate.total_std;
            assert!(error.abs() < 5.0, "seed {seed}, {}: {error} standard deviations", parameter.name);
        }
    }
}

/// Recordings at two speeds share λ, unbalance and bench; each has its load. The deviation of the run-out is 0.38 of that from one.
#[test]
fn two_speeds_tell_run_out_better_than_one() {
    let slow = Bench {
        seconds: 0.5,
        runout1: [2e-6, 0.0, 0.0, 0.0],
        load: [5.0, -30.0],
        seed: 46,
        omega: std::f64::consts::TAU * 30.0,
        ..Bench::default()
    };
    let fast = Bench { omega: std::f64::consts::TAU * 60.0, load: [10.0, -20.0], seed: 47, ..slow.clone() };
    let recorded = [slow.record(), fast.record()];
    let mut options = options(&slow);
    tell(&mut options, &[("runout1.forward.cos", 5e-6), ("runout1.forward.sin", 5e-6)]);
    let both = [recording(&recorded[0], &slow, false), recording(&recorded[1], &fast, false)];
    let together = likelihood::identify(&both, &options).unwrap();
    let alone = likelihood::identify(&both[..1], &options).unwrap();
    let runout = by_name("runout1.forward.cos").unwrap();
    let of = |found: &Identification| found.bench[runout].estimate;
    assert!(together.converged && (of(&together).value - 2e-6).abs() < 4.0 * of(&together).total_std);
    assert!(of(&together).total_std < 0.5 * of(&alone).total_std, "{:?} {:?}", of(&together), of(&alone));
    for (conditions, bench) in together.conditions.iter().zip([&slow, &fast]) {
        for (load, truth) in conditions.load_n.iter().zip(bench.load) {
            assert!((load.value - truth).abs() < 4.0 * load.total_std, "{load:?}, truth {truth}");
        }
    }
}

#[test]
fn all_bench_parameters_at_once() {
    let bench = Bench { seconds: 3.0, seed: 45, ..Bench::default() };
    let recorded = bench.record();
    let mut options = options(&bench);
    for (told, parameter) in options.bench.iter_mut().zip(&PARAMETERS) {
        told.knowledge = Knowledge::Tolerance(parameter.typical);
    }
    let found = likelihood::identify(&[recording(&recorded, &bench, false)], &options).unwrap();
    assert!(found.converged, "{} iterations", found.iterations);
    for k in 0..3 {
        let error = (found.lambda[k].value - bench.lambda[k]) / found.lambda[k].total_std;
        assert!(error.abs() < 4.0, "λ{k}: {error} standard deviations");
    }
}

#[test]
fn a_change_of_lambda_is_found_and_both_parts_are_told() {
    let bench = Bench { seconds: 1.0, update_s: 0.0, change: [0.6, 0.05], seed: 41, ..Bench::default() };
    let recorded = bench.record();
    let found = likelihood::identify(&[recording(&recorded, &bench, false)], &options(&bench)).unwrap();
    let [Contradiction { rows, what: Change::Lambda { lambda, .. }, .. }] = &found.contradictions[..] else {
        panic!("{:?}", found.contradictions)
    };
    assert!(rows.start.abs_diff(6000) <= 200 && rows.end == 10_001, "{rows:?}");
    for (k, ((before, after), truth)) in found.lambda.iter().zip(lambda).zip(bench.lambda).enumerate() {
        let error = (before.value - truth) / before.total_std;
        let after = (after.value - 1.05 * truth) / after.total_std;
        assert!(error.abs() < 4.0 && after.abs() < 4.0, "λ{k}: {error} and {after} standard deviations");
    }
}

#[test]
fn an_impact_is_left_out() {
    let bench = Bench { seconds: 0.6, impact: [0.4, 60.0], seed: 42, ..Bench::default() };
    let recorded = bench.record();
    let found = likelihood::identify(&[recording(&recorded, &bench, false)], &options(&bench)).unwrap();
    assert!(
        found
            .contradictions
            .iter()
            .any(|part| matches!(part.what, Change::Disturbed { .. }) && part.rows.contains(&4003)),
        "{:?}",
        found.contradictions
    );
    for k in 0..3 {
        let error = (found.lambda[k].value - bench.lambda[k]) / found.lambda[k].total_std;
        assert!(error.abs() < 4.0, "λ{k}: {error} standard deviations");
    }
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let bench = Bench { seconds: 6.0, ..Bench::default() };
    let recorded = bench.record();
    let one = Options { threads: 1, ..options(&bench) };
    let four = Options { threads: 4, ..options(&bench) };
    let of = |options: &Options| likelihood::identify(&[recording(&recorded, &bench, false)], options).unwrap();
    assert_eq!(of(&one), of(&four));
}

#[test]
fn unmodelled_run_out_is_the_first_suspect() {
    let bench = Bench { seconds: 0.5, runout2: [1e-6, 0.0, 0.0, 0.0], seed: 43, ..Bench::default() };
    let recorded = bench.record();
    let found = likelihood::identify(&[recording(&recorded, &bench, false)], &options(&bench)).unwrap();
    let named: Vec<&str> = found.suspects.iter().map(|suspect| PARAMETERS[suspect.parameter].name).collect();
    assert!(named.first().is_some_and(|name| name.starts_with("runout2")), "{named:?}");
}

#[test]
fn mass_and_current_gain_are_not_separated_from_lambda() {
    let bench = Bench { seconds: 0.5, seed: 44, ..Bench::default() };
    let recorded = bench.record();
    let mut options = options(&bench);
    for name in ["m", "current.gain[2]", "sensor.offset[y]"] {
        options.bench[by_name(name).unwrap()].knowledge = Knowledge::Free;
    }
    let found = likelihood::identify(&[recording(&recorded, &bench, false)], &options).unwrap();
    let mut held: Vec<&str> = found.not_separated.iter().map(|j| PARAMETERS[*j].name).collect();
    held.sort_unstable();
    assert_eq!(held, ["current.gain[2]", "m"]);
    assert!(found.bench[by_name("sensor.offset[y]").unwrap()].estimate.total_std < 5e-6);
}
