//! Maximum likelihood over whole recordings: accuracy, imperfect benches, changes.

use crate::prelude::*;
use magnetic_bearing::bearing::{BearingConfig, RotorConfig, Shaft};
use magnetic_bearing::plant::noise::Noise;
use magnetic_bearing::studies::identify::likelihood::{self, Recording, *};
use magnetic_bearing::studies::montecarlo::figures::{Trial, wanted};
use magnetic_bearing::studies::montecarlo::offline;

fn by_column<const N: usize>(rows: &[[f64; N]]) -> Vec<Vec<f64>> {
    (0..N).map(|n| rows.iter().map(|row| row[n]).collect()).collect()
}

/// The recording of a bench, with its noise levels if they are known.
fn recording(bench: &Bench, noise_known: bool) -> Recording {
    let recorded = bench.record();
    Recording {
        start_s: 0.0,
        step_s: bench.step,
        position_m: by_column(&recorded.position),
        current_a: by_column(&recorded.current),
        usable: vec![true; recorded.theta.len()],
        theta_rad: recorded.theta,
        omega_rad_s: recorded.omega,
        has_mark: true,
        position_error_m: Vec::new(),
        square_error_a2: Vec::new(),
        hold: Hold::HeldBefore,
        position_noise_m: noise_known.then_some(bench.position_noise),
        current_noise_a: noise_known.then_some(bench.current_noise),
    }
}

fn identified(bench: &Bench, options: &Options) -> Identification {
    likelihood::identify(&[recording(bench, false)], options).unwrap()
}

/// λ are those of the bench, within four of their deviations.
#[track_caller]
fn is_right(what: &str, found: &Identification, bench: &Bench) {
    for (k, (lambda, truth)) in found.lambda.iter().zip(bench.lambda).enumerate() {
        is_near(&format!("{what}, λ{k}"), lambda, truth, 4.0);
    }
}

fn options(bench: &Bench) -> Options {
    let mut bearing = BearingConfig { gap_m: bench.s, ..BearingConfig::default() };
    bearing.alpha_rad[..3].copy_from_slice(&bench.alpha);
    let shaft = Shaft { m_kg: bench.m, transverse_kgm2: 0.0, polar_kgm2: 0.0 };
    let rotor = RotorConfig { shaft, extent_m: [0.0; 2], bearings: [bearing; 2] };
    let body = Body { bearings: PLANAR.bearings, rotor, planes_m: [0.0; 2] };
    Options { parts: vec![Part::new(body, 0, 0)], slow_force: false, excludes_rows: true, corrects_bias: true }
}

fn know(options: &mut Options, name: &str, knowledge: Knowledge) {
    let mut named = options.bench().filter(|parameter| parameter.name == name);
    named.next().unwrap_or_else(|| panic!("no parameter {name}")).knowledge = knowledge;
}

/// The estimate of a parameter of the bench.
fn of_bench(found: &Identification, name: &str) -> Estimate {
    let named = found.bench.iter().find(|estimated| estimated.parameter.name == name);
    named.unwrap_or_else(|| panic!("no parameter {name}")).estimate
}

/// A bench with every error drawn from its typical tolerance, and the errors.
fn drawn(seed: u64, base: Bench) -> (Bench, Vec<f64>) {
    let mut channels = Noise::sequence(seed);
    let noise: [Noise; 29] = std::array::from_fn(|_| channels());
    let drawn = options(&base).parts[0].parameters.clone().into_iter().zip(noise).map(|(parameter, mut noise)| {
        let value = parameter.typical * noise.standard_normal();
        // Sensors are causal.
        if parameter.name == "delay" { value.abs() } else { value }
    });
    let d: Vec<f64> = drawn.collect();
    let errors = Errors {
        m: d[0],
        s: d[1],
        alpha: [d[2], d[3], d[4]],
        offset: [d[5], d[6]],
        gain: [d[7] + d[8], d[7] - d[8]],
        rotation: d[9],
        skew: d[10],
        delay: d[11],
        runout1: [d[12], d[13], d[14], d[15]],
        runout2: [d[16], d[17], d[18], d[19]],
        current_offset: [d[20], d[21], d[22]],
        current_gain: [d[23], d[24], d[25]],
        iron: d[26],
        backward: [d[27], d[28]],
    };
    (Bench { seed, errors, ..base }, d)
}

/// A bench with all errors or none converges to within its deviations, from short recordings to more rows than the likelihood is trusted for.
#[test]
fn all_parameters_of_a_bench_are_found_at_once() {
    let imperfect = [(60_101, 0.5), (60_103, 6.0)];
    let imperfect = imperfect.map(|(seed, seconds)| drawn(seed, Bench { seconds, ..Bench::default() }));
    let exact = (Bench { seconds: 1.0, seed: 45, ..Bench::default() }, vec![0.0; 29]);
    for (bench, truth) in imperfect.into_iter().chain([exact]) {
        let what = format!("seed {}", bench.seed);
        let mut options = options(&bench);
        options.bench().for_each(|parameter| parameter.knowledge = Knowledge::Tolerance(parameter.typical));
        let found = identified(&bench, &options);
        assert!(found.converged, "{what}: {} iterations", found.iterations);
        is_right(&what, &found, &bench);
        assert_eq!(found.bench.len(), truth.len(), "{what}");
        for (found, truth) in found.bench.iter().zip(truth) {
            is_near(&format!("{what}, {}", found.parameter.name), &found.estimate, truth, 5.0);
        }
    }
}

/// Recordings at two speeds share λ, unbalance and bench; each has its own load. The deviation of the run-out is 0.38 of that from one speed.
#[test]
fn two_speeds_determine_run_out_better_than_one() {
    let errors = Errors { runout1: [2e-6, 0.0, 0.0, 0.0], ..Errors::default() };
    let base = Bench { seconds: 0.5, errors, ..Bench::default() };
    let slow = Bench { load: [5.0, -30.0], seed: 46, omega: std::f64::consts::TAU * 30.0, ..base.clone() };
    let fast = Bench { load: [10.0, -20.0], seed: 47, omega: std::f64::consts::TAU * 60.0, ..base };
    let mut options = options(&slow);
    for name in ["runout1.forward.cos", "runout1.forward.sin"] {
        know(&mut options, name, Knowledge::Tolerance(5e-6));
    }
    let both = [&slow, &fast].map(|bench| recording(bench, false));
    let [together, alone] =
        [&both[..], &both[..1]].map(|recordings| likelihood::identify(recordings, &options).unwrap());
    let [both, one] = [&together, &alone].map(|found| of_bench(found, "runout1.forward.cos"));
    assert!(together.converged && both.total_std < 0.5 * one.total_std, "{both:?} {one:?}");
    is_near("run-out", &both, 2e-6, 4.0);
    for (conditions, bench) in together.conditions.iter().zip([&slow, &fast]) {
        for (load, truth) in conditions.load_n.iter().zip(bench.load) {
            is_near("load", load, truth, 4.0);
        }
    }
}

#[test]
fn a_change_of_lambda_is_found_with_the_values_before_and_after() {
    let bench = Bench { seconds: 1.0, update_s: 0.0, change: [0.6, 0.05], seed: 41, ..Bench::default() };
    let found = identified(&bench, &options(&bench));
    let [Contradiction { rows, what: Change::Lambda(lambda), .. }] = &found.contradictions[..] else {
        panic!("{:?}", found.contradictions)
    };
    assert!(rows.start.abs_diff(6000) <= 200 && rows.end == 10_001, "{rows:?}");
    is_right("before", &found, &bench);
    below("what a slow force explains besides", found.gain_by_slow_force, 0.5 * f64::ln(2.0 * 10_001.0));
    for (after, truth) in lambda.iter().zip(bench.lambda) {
        is_near("after", after, 1.05 * truth, 4.0);
    }
}

#[test]
fn an_impact_is_excluded() {
    let bench = Bench { seconds: 0.6, impact: [0.4, 60.0], seed: 42, ..Bench::default() };
    let found = identified(&bench, &options(&bench));
    let is_impact = |part: &Contradiction| matches!(part.what, Change::Disturbed { .. }) && part.rows.contains(&4003);
    assert!(found.contradictions.iter().any(is_impact), "{:?}", found.contradictions);
    is_right("an impact", &found, &bench);
}

/// A current that is temporarily unknown carries no information: the value in its place does not matter, and λ stays within its deviation.
#[test]
fn an_unknown_current_is_not_used() {
    let bench = Bench { seconds: 1.0, seed: 44, ..Bench::default() };
    let of = |instead_a: f64| {
        let mut recording = recording(&bench, true);
        let rows = recording.theta_rad.len();
        recording.square_error_a2 = vec![vec![0.0; rows]; 3];
        for row in (0..rows).filter(|row| (21..50).contains(&(row % 200))) {
            recording.current_a[1][row] = instead_a;
            recording.square_error_a2[1][row] = f32::INFINITY;
        }
        likelihood::identify(&[recording], &options(&bench)).unwrap()
    };
    let [found, other] = [2.0, 3.0].map(of);
    is_right("unknown currents", &found, &bench);
    for (k, (found, other)) in found.lambda.iter().zip(&other.lambda).enumerate() {
        let moved = (found.value - other.value) / found.total_std;
        assert!(moved.abs() < 0.5, "λ{k} moved by {moved} standard deviations");
    }
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let bench = Bench { seconds: 6.0, ..Bench::default() };
    let of = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| identified(&bench, &options(&bench)))
    };
    assert_eq!(of(1), of(4));
}

/// A tolerance of the mass widens λ and the unbalance in proportion.
#[test]
fn a_tolerance_of_the_mass_widens_deviations_in_proportion() {
    const MASS: f64 = 0.01;
    let bench = Bench { seconds: 0.5, seed: 49, ..Bench::default() };
    let mut options = options(&bench);
    let exact = identified(&bench, &options);
    know(&mut options, "m", Knowledge::Tolerance(MASS));
    let within = identified(&bench, &options);
    let estimates = |found: &Identification| [found.lambda.clone(), vec![found.unbalance[0].magnitude]].concat();
    for (exact, within) in estimates(&exact).into_iter().zip(estimates(&within)) {
        assert_eq!(exact.value, within.value);
        let wanted = exact.total_std.hypot(MASS * exact.value);
        assert!((within.total_std / wanted - 1.0).abs() < 1e-12, "{exact:?} {within:?}");
    }
    let mass = of_bench(&within, "m");
    assert_eq!((mass.value, mass.total_std), (0.0, MASS));
}

#[test]
fn mass_and_current_gain_are_not_separated_from_lambda() {
    let bench = Bench { seconds: 0.5, seed: 44, ..Bench::default() };
    let mut options = options(&bench);
    for name in ["m", "current.gain[2]", "sensor.offset[y]"] {
        know(&mut options, name, Knowledge::Free);
    }
    let found = identified(&bench, &options);
    let held = found.bench.iter().filter(|estimated| estimated.is_held).map(|held| &*held.parameter.name);
    assert_eq!(held.collect::<Vec<_>>(), ["m", "current.gain[2]"]);
    assert!(of_bench(&found, "sensor.offset[y]").total_std < 5e-6);
}

/// Runs of one drawn bearing (`montecarlo --only "identify: drawn bearings, noise known"` and its seed) with different noise, the position noise scaled.
fn runs_of(bearing: u64, position_noise: f64, runs: usize) -> Vec<Trial> {
    let studies = offline::studies(1);
    let study = studies.iter().find(|study| study.title == "identify: drawn bearings, noise known").unwrap();
    in_order(runs, &|run| {
        let mut scenario = study.case(bearing, 0);
        let noise = position_noise * scenario.real("sensor.positionNoise").unwrap();
        scenario.set("plant", "sensor.seed", 800_000 + run as i32);
        for element in ["plant", "estimator"] {
            scenario.set(element, "sensor.positionNoise", noise);
        }
        let run = simulate::run_for(&scenario, wanted).unwrap();
        let offline = study.offline.as_ref().unwrap();
        offline.judge(&scenario, &run.recording, &study.instants_s, bearing)
    })
}

/// A bearing excited mostly by noise, 82 nm and 23 mA: the maximum of the likelihood is off by 4.7 bounds after 5 s. Instrumental variables remove this
/// bias and state the remaining error.
#[test]
fn a_bearing_excited_by_noise_is_found_without_bias() {
    let trials = runs_of(92_025, 1.0, 8);
    for k in 0..3 {
        let mean = |f: fn(f64, f64, f64) -> f64| {
            let last = trials.iter().map(|trial| trial.samples.last().unwrap());
            last.map(|sample| f(sample.error[k], sample.std[k], sample.bound[k])).sum::<f64>() / trials.len() as f64
        };
        below(&format!("λ{k}, bounds off on average"), mean(|error, _, bound| error / bound).abs(), 1.5);
        below(&format!("λ{k}, error in deviations"), mean(|error, std, _| (error / std).powi(2)).sqrt(), 1.7);
        below(&format!("λ{k}, bounds that it states"), mean(|_, std, bound| std / bound), 1.7);
    }
}

/// At 1000 rpm with 0.23 µm and 29 mA the filter gains depend so strongly on λ that little of the apparent information is real: ± without that part of
/// the sensitivity was 1.3 %, the error up to 9 %. With 12 nm and 41 mA the filter trusts the positions, and current noise in its stiffness would look
/// like an offset of 50 µm. After six revolutions the stiffness is free of it.
#[test]
fn deviations_are_not_too_small_under_misleading_noise() {
    for trial in runs_of(131_025, 1.0, 2) {
        assert!(trial.worst.ratio < 4.0, "{:?}", trial.worst);
    }
    for sample in runs_of(91_002, 0.1, 3).iter().flat_map(|trial| &trial.samples[1..]) {
        assert!(sample.valid, "{:?} {:?}", sample.verdict, sample.error);
    }
}

/// Noise that grows with the gap: its exponent is found with a realistic ±, and its level is that at the nominal gap.
#[test]
fn noise_may_grow_with_the_gap() {
    let errors = in_order(12, &|run| {
        let (seed, power) = (84_501 + run as u64, -1.0 + 0.3 * run as f64);
        let bench = Bench { seed, seconds: 0.5, position_noise: 1e-8, ..Bench::default() };
        let mut recording = recording(&bench, false);
        let mut noise = Noise::sequence(seed)();
        for position_m in recording.position_m.iter_mut().flatten() {
            *position_m += 1e-6 * (1.0 + *position_m / bench.s).powf(power) * noise.standard_normal();
        }
        let mut options = options(&bench);
        options.parts[0].settings.exponent = true;
        let found = likelihood::identify(&[recording], &options).unwrap();
        let part = &found.conditions[0].parts[0];
        below(&format!("seed {seed}, noise"), (part.position_noise_m / 1e-6 - 1.0).abs(), 0.05);
        let estimate = part.noise_exponent.expect("an estimate");
        below(&format!("seed {seed}, ± of the power"), estimate.total_std, 0.2);
        (estimate.value - power) / estimate.total_std
    });
    between("error of the power in deviations", rms(errors), 0.7, 1.3);
}
