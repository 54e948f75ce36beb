//! A survey of "never a confident wrong number", and of how close the estimates come to the Cramér–Rao bound: every built-in scenario
//! with every method, and random bearings, at every sample, with seeds not used for tuning.
//!
//! `SURVEY=1000 cargo test --release --test app survey:: -- --nocapture` draws that many bearings instead of the default 100; `SURVEY_SEED`
//! sets the first seed.

use crate::prelude::*;

use crate::uncertainty::{deviations, outputs_of, truth};
use magnetic_bearing::estimation::Method;
use magnetic_bearing::studies::montecarlo::cases::Draw;
use magnetic_bearing::studies::montecarlo::figures::CONFIDENT;
use magnetic_bearing::studies::montecarlo::{SEEDS, cases};

/// The methods by the names of the interface, with their numbers.
fn methods() -> Vec<(&'static str, i32)> {
    Method::all().map(|method| (method.name(), method.number())).collect()
}

/// First seed. The thresholds of the estimator were chosen with the seeds 1 to 200.
const FRESH: u64 = 1001;

/// A number from the environment.
fn environment(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// Runs the loop with all methods beside it: greatest |error|/standard deviation of each while it is valid. The true λ is constant.
fn run(scenario: &Scenario) -> Vec<(&'static str, f64)> {
    let wanted = |path: &str| [".lambda", ".valid", ".verdict"].iter().any(|name| path.contains(name));
    let run = simulate::run_for(scenario, wanted).expect("a good scenario");
    let worst = |method: &str| deviations(&outputs_of(&run, method), &truth(scenario))[0];
    methods().into_iter().map(|(method, _)| (method, worst(method))).collect()
}

/// All methods beside the loop, whatever the scenario compares.
fn with_all_methods(scenario: &mut Scenario) {
    scenario.elements.truncate(3);
    for (name, number) in methods() {
        let mut element = scenario.elements[2].clone();
        element.name = name.into();
        scenario.elements.push(element);
        scenario.set(name, "method", number);
    }
    // Profiles of the loop's estimator apply to all.
    for profile in &mut scenario.profiles {
        for n in 0..profile.targets.len() {
            let (element, variable) = profile.targets[n];
            if element == 2 {
                profile.targets.extend((3..3 + methods().len()).map(|beside| (beside, variable)));
            }
        }
    }
}

fn open(name: &str) -> Scenario {
    let mut scenario = program::open(name, &[]);
    with_all_methods(&mut scenario);
    scenario
}

/// Runs all cases in parallel; none is confident and wrong.
fn survey(cases: u64, is_included: fn(&str) -> bool, make: impl Fn(u64) -> (String, Scenario) + Send + Sync) {
    let misses = in_order(cases as usize, &|case| {
        let (group, scenario) = make(case as u64);
        let wrong = run(&scenario).into_iter().filter(|(method, worst)| is_included(method) && *worst > CONFIDENT);
        wrong
            .map(|(method, worst)| format!("{group}, {method}, case {case}: {worst:.1} deviations"))
            .collect::<Vec<_>>()
    });
    assert!(misses.concat().is_empty(), "limit {CONFIDENT}: {}", misses.concat().join("\n"));
}

/// Every built-in scenario of a bearing.
#[test]
fn every_scenario_with_every_method() {
    let seeds = environment("SURVEY", 9).div_ceil(9).max(1);
    let first = environment("SURVEY_SEED", FRESH);
    let names: Vec<_> =
        BUILT_IN.into_iter().map(|(name, _)| name).filter(|name| open(name).machine.name == "planar").collect();
    let make = |case: u64| {
        let name = names[case as usize % names.len()];
        let mut scenario = open(name);
        let seed = first + case / names.len() as u64;
        scenario.set("plant", "sensor.seed", seed as i32);
        (name.to_owned(), scenario)
    };
    survey(seeds * names.len() as u64, |_| true, make);
}

/// A random rotor without unbalance, as the methods of the paper assume: speed, trajectory, load, force constants, noise, window,
/// drive.
fn balanced(seed: u64) -> (String, Scenario) {
    let mut draw = Draw::new(seed);
    let mut scenario = open("unbalanced");
    let voltage = draw.chance(0.4);
    let omega = draw.log_uniform(1500.0, 6000.0) * TAU / 60.0;
    let radius = [draw.log_uniform(20e-6, 90e-6), draw.log_uniform(20e-6, 90e-6)];
    cases::trajectory(&mut scenario, radius, (3, 0.0), omega);
    cases::unbalance(&mut scenario, 0.0, 0.0);
    for k in 1..=3 {
        scenario.set("plant", &format!("lambda[{k}]"), draw.log_uniform(1.4e-6, 3.5e-6));
    }
    scenario.set("plant", "pY", draw.uniform(-30.0, 30.0));
    scenario.set("plant", "pZ", draw.uniform(-40.0, 20.0));
    let window_s = ((draw.log_uniform(0.6, 1.8) * TAU / omega) / 1e-4).round() * 1e-4;
    let noise = [draw.log_uniform(0.02e-6, 0.4e-6), draw.log_uniform(1e-3, 20e-3)];
    cases::noise(&mut scenario, noise, true);
    if voltage {
        cases::voltage_drive(&mut scenario);
    }
    scenario.elements.truncate(3);
    for name in ["Tf", "epsilon"] {
        scenario.set("estimator", name, window_s);
    }
    scenario.set("plant", "sensor.seed", seed as i32);
    // Half of the controllers adopt the estimates during the run.
    if draw.chance(0.5) {
        scenario.set("controller", "update.mode", 1);
    }
    scenario.duration_s = 0.3;
    with_all_methods(&mut scenario);
    (if voltage { "voltage" } else { "current" }.into(), scenario)
}

#[test]
fn rotors_without_unbalance_with_the_papers_methods() {
    let first = environment("SURVEY_SEED", FRESH);
    survey(environment("SURVEY", 20), |method| method.starts_with("paper"), |case| balanced(first + case));
}

/// Limits of the rms of error/standard deviation: due to noise, and total, which also covers a backward force (absent in drawn bearings) and a finite memory.
const STATED: std::ops::RangeInclusive<f64> = 0.85..=1.15;
const TOTAL: std::ops::RangeInclusive<f64> = 0.7..=1.1;

/// Limits at 35 ms, 0.1, 0.2, 0.4 and 1 s, from index `from` on: rms of error/bound, and valid fraction of the cases with a bound below 4 %.
fn drawn_bearings(known: bool, from: usize, over_bound: [f64; 5], valid: [f64; 5]) {
    let title = format!("Drawn bearings, noise {}known", if known { "" } else { "not " });
    let mut study = montecarlo::drawn(&title, known, environment("SURVEY", 100) as usize);
    study.first_seed = SEEDS * environment("SURVEY_SEED", FRESH);
    let outcome = study.run().expect("good scenarios");
    let table = montecarlo::table(&study, &outcome);
    println!("{}\n{}", table.title, table.note);
    for row in [&table.head].into_iter().chain(&table.rows) {
        println!("{}", row.join("  "));
    }
    let wrong = outcome.trials.iter().filter(|trial| trial.is_beyond());
    let mut misses: Vec<String> = wrong.map(|trial| format!("seed {}: {:?}", trial.seed, trial.worst)).collect();
    let of_instants = over_bound.into_iter().zip(valid);
    for (figures, (limit, least)) in outcome.figures.iter().zip(of_instants).skip(from) {
        let at = figures.instant_s;
        let [bound, stated, total] =
            [&figures.over_bound, &figures.normalised, &figures.over_total].map(|values| rms(values.iter().copied()));
        // NaN is outside all limits.
        for (what, value, limits) in [
            ("error/bound", bound, 0.0..=limit),
            ("error/standard deviation by noise", stated, STATED),
            ("error/total standard deviation", total, TOTAL),
        ] {
            if !limits.contains(&value) {
                misses.push(format!("{at} s: {what} {value:.2}, limits {limits:?}"));
            }
        }
        let (valid, of) = (figures.identified, figures.identifiable);
        if (valid as f64) < least * of as f64 {
            misses.push(format!("{at} s: {valid} valid of {of} with a bound below 4 %, limit {least}"));
        }
    }
    assert!(misses.is_empty(), "{}", misses.join("\n"));
}

#[test]
fn drawn_bearings_with_known_noise() {
    drawn_bearings(true, 0, [1.2, 1.15, 1.15, 1.15, 1.15], [0.85, 0.95, 0.95, 0.95, 0.95]);
}

#[test]
fn drawn_bearings_with_unknown_noise() {
    drawn_bearings(false, 1, [f64::INFINITY, 1.3, 1.3, 1.3, 1.3], [0.0, 0.85, 0.95, 0.95, 0.95]);
}
