//! Wide survey of the promise "never a confident wrong number": every scenario that comes with the program and drawn
//! bearings, with every method, at every sample, and with seeds that nothing was tuned on.
//!
//! `SURVEY=1000 cargo test --release --test survey -- --nocapture` draws as many instead of the few that the tests take
//! along; `SURVEY_SEED` begins elsewhere.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use magnetic_bearing::app::scenario::{BUILT_IN, Scenario};
use magnetic_bearing::app::simulate;
use magnetic_bearing::slave::variable::Value;

/// While an estimate is valid its error is to stay below so many of its standard deviations.
const CONFIDENT: f64 = 5.0;

/// The methods by the names of the interface, with their numbers.
const METHODS: [(&str, i32); 4] = [("paperLiteral", 1), ("paper", 2), ("leastSquares", 3), ("unbalance", 4)];

/// The thresholds of the estimator were chosen with the seeds 1 to 200 before one's eyes.
const FRESH: u64 = 1001;

fn asked(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(otherwise)
}

/// What one method said in one run.
#[derive(Clone, Debug, Default)]
struct Said {
    case: String,
    samples: usize,
    valid: usize,
    /// Greatest |error|/standard deviation while valid, when, and the error and the deviation there, relative.
    worst: f64,
    when_s: f64,
    error: f64,
    std: f64,
    /// Greatest relative error and greatest relative standard deviation while valid.
    largest_error: f64,
    largest_std: f64,
}

/// Runs the loop with all methods beside it and compares with the truth, which is constant.
fn run(scenario: &Scenario) -> Vec<(&'static str, Said)> {
    let wanted = |path: &str| ["lambdaHat", "lambdaStd", ".valid"].iter().any(|part| path.contains(part));
    let run = simulate::run_for(scenario, wanted, |_| ()).expect("a good scenario");
    let truth = [1, 2, 3].map(|k| scenario.value("plant", &format!("lambda[{k}]")).map_or(f64::NAN, Value::as_f64));
    METHODS
        .iter()
        .map(|(method, _)| {
            let read = |name: String| run.recording.get(&format!("{method}.{name}")).expect("an output");
            let valid = read("valid".into());
            let hat = [1, 2, 3].map(|k| read(format!("lambdaHat[{k}]")));
            let std = [1, 2, 3].map(|k| read(format!("lambdaStd[{k}]")));
            let mut said = Said { case: scenario.description.clone(), samples: valid.len(), ..Said::default() };
            for j in (0..valid.len()).filter(|j| valid[*j] == 1.0) {
                said.valid += 1;
                for k in 0..3 {
                    let (error, std) = ((hat[k][j] / truth[k] - 1.0).abs(), std[k][j] / truth[k]);
                    said.largest_error = said.largest_error.max(error);
                    said.largest_std = said.largest_std.max(std);
                    if error / std > said.worst {
                        (said.worst, said.when_s, said.error, said.std) =
                            (error / std, run.recording.time_s[j], error, std);
                    }
                }
            }
            (*method, said)
        })
        .collect()
}

/// All methods beside the loop, whatever the scenario compares.
fn with_all_methods(scenario: &mut Scenario) {
    scenario.elements.truncate(3);
    for (name, number) in METHODS {
        let mut element = scenario.elements[2].clone();
        element.name = name.into();
        scenario.elements.push(element);
        scenario.set(name, "method", Value::Integer(number));
    }
    // What happens to the estimator of the loop happens to all.
    for profile in &mut scenario.profiles {
        for n in 0..profile.targets.len() {
            let (element, variable) = profile.targets[n];
            if element == 2 {
                profile.targets.extend((3..7).map(|beside| (beside, variable)));
            }
        }
    }
}

fn open(name: &str) -> Scenario {
    let mut scenario = Scenario::open(Path::new(name)).expect("a scenario that comes with the program");
    with_all_methods(&mut scenario);
    scenario
}

/// Runs all cases on all processors; per group and method: what was said, worst first.
fn survey(
    cases: u64,
    make: impl Fn(u64) -> (String, Scenario) + Sync,
) -> BTreeMap<(String, &'static str), Vec<(u64, Said)>> {
    let next = AtomicU64::new(0);
    let found = Mutex::new(BTreeMap::<_, Vec<_>>::new());
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let case = next.fetch_add(1, Ordering::Relaxed);
                    if case >= cases {
                        break;
                    }
                    let (group, scenario) = make(case);
                    for (method, said) in run(&scenario) {
                        let mut found = found.lock().expect("no thread has panicked");
                        found.entry((group.clone(), method)).or_default().push((case, said));
                    }
                }
            });
        }
    });
    let mut found = found.into_inner().expect("no thread has panicked");
    found.values_mut().for_each(|list| list.sort_by(|a, b| b.1.worst.total_cmp(&a.1.worst)));
    found
}

/// Prints the survey; the cases that were confident and wrong.
fn judge(found: &BTreeMap<(String, &'static str), Vec<(u64, Said)>>) -> Vec<String> {
    println!(
        "{:34} {:13} {:>5} {:>7} {:>6} {:>7} {:>7} {:>9} {:>9}  worst case",
        "", "", "cases", "valid", "wrong", "worst", "over 3", "error", "std"
    );
    let mut misses = Vec::new();
    for ((group, method), list) in found {
        let wrong = list.iter().filter(|(_, said)| said.worst > CONFIDENT).count();
        let (case, worst) = &list[0];
        let most = |value: fn(&Said) -> f64| list.iter().map(|(_, said)| value(said)).fold(0.0, f64::max);
        println!(
            "{group:34} {method:13} {:5} {:6.1}% {wrong:6} {:7.2} {:7} {:8.2}% {:8.2}%  case {case} at {:.4} s: {:.2} % by {:.2} %",
            list.len(),
            100.0 * list.iter().map(|(_, said)| said.valid as f64 / said.samples as f64).sum::<f64>()
                / list.len() as f64,
            worst.worst,
            list.iter().filter(|(_, said)| said.worst > 3.0).count(),
            100.0 * most(|said| said.largest_error),
            100.0 * most(|said| said.largest_std),
            worst.when_s,
            100.0 * worst.error,
            100.0 * worst.std,
        );
        misses.extend(list.iter().filter(|(_, said)| said.worst > CONFIDENT).map(|(case, said)| {
            format!(
                "{group}, {method}, case {case}: {:.1} standard deviations at {:.4} s ({:.2} % by {:.2} %), limit {CONFIDENT}; {}",
                said.worst,
                said.when_s,
                100.0 * said.error,
                100.0 * said.std,
                said.case
            )
        }));
    }
    misses
}

/// Every scenario that comes with the program.
#[test]
fn every_scenario_with_every_method() {
    let seeds = asked("SURVEY", 9).div_ceil(9).max(1);
    let first = asked("SURVEY_SEED", FRESH);
    let found = survey(seeds * BUILT_IN.len() as u64, |case| {
        let name = BUILT_IN[case as usize % BUILT_IN.len()].0;
        let mut scenario = open(name);
        let seed = first + case / BUILT_IN.len() as u64;
        scenario.set("plant", "sensor.seed", Value::Integer(seed as i32));
        (name.to_owned(), scenario)
    });
    let misses = judge(&found);
    assert!(misses.is_empty(), "{}", misses.join("\n"));
}

/// Numbers between 0 and 1, from the generator SplitMix64.
struct Draw(u64);

impl Draw {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * (((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64)
    }

    /// Evenly on a logarithmic scale.
    fn scale(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    fn chance(&mut self, share: f64) -> bool {
        self.between(0.0, 1.0) < share
    }
}

/// How the groups of rotors without unbalance begin.
const BALANCED: &str = "balanced";

/// A bearing drawn at random: speed, path, load, unbalance, force constants, noise, window, drive.
fn drawn(seed: u64) -> (String, Scenario) {
    let mut draw = Draw(seed);
    let mut scenario = open("unbalanced");
    let voltage = draw.chance(0.4);
    let balanced = draw.chance(0.4);
    let mut real = Vec::new();
    let omega = draw.scale(1500.0, 6000.0) * TAU / 60.0;
    let radius = [draw.scale(20e-6, 90e-6), draw.scale(20e-6, 90e-6)];
    for k in 1..=3 {
        real.push(("plant", format!("lambda[{k}]"), draw.scale(1.4e-6, 3.5e-6)));
    }
    real.extend(
        [
            ("plant", "omega", omega),
            ("plant", "Y0", radius[0]),
            ("plant", "vZ0", radius[1] * omega),
            ("plant", "unbalance.magnitude", if balanced { 0.0 } else { draw.scale(1.0, 40.0) / (omega * omega) }),
            ("plant", "unbalance.phase", draw.between(-PI, PI)),
            ("plant", "pY", draw.between(-30.0, 30.0)),
            ("plant", "pZ", draw.between(-40.0, 20.0)),
            ("controller", "reference.rY", radius[0]),
            ("controller", "reference.rZ", radius[1]),
            ("controller", "reference.omega", omega),
        ]
        .map(|(element, name, value)| (element, name.to_owned(), value)),
    );
    let window_s = ((draw.scale(0.6, 1.8) * TAU / omega) / 1e-4).round() * 1e-4;
    let noise = [draw.scale(0.02e-6, 0.4e-6), draw.scale(1e-3, 20e-3)];
    let told = draw.chance(0.5);
    for (name, noise) in [("sensor.positionNoise", noise[0]), ("sensor.currentNoise", noise[1])] {
        real.push(("plant", name.to_owned(), noise));
    }
    for (element, name, value) in real {
        scenario.set(element, &name, Value::Real(value));
    }
    for element in ["estimator", "paperLiteral", "paper", "leastSquares", "unbalance"] {
        scenario.set(element, "Tf", Value::Real(window_s));
        scenario.set(element, "epsilon", Value::Real(window_s));
        for (name, noise) in [("sensor.positionNoise", noise[0]), ("sensor.currentNoise", noise[1])] {
            scenario.set(element, name, Value::Real(if told { noise } else { 0.0 }));
        }
        scenario.set(element, "hold", Value::Integer(if voltage { 3 } else { 1 }));
    }
    for element in ["plant", "controller"] {
        scenario.set(element, "drive", Value::Integer(if voltage { 2 } else { 1 }));
    }
    scenario.set("plant", "sensor.seed", Value::Integer(seed as i32));
    // Half of the controllers take the estimates over in the course of the run.
    if draw.chance(0.5) {
        scenario.set("controller", "update.mode", Value::Integer(1));
    }
    scenario.duration_s = 0.3;
    scenario.description = format!(
        "rY {:.0} rZ {:.0} um, {:.0} rpm, Tf {:.2} rev, noise {:.2} um {:.0} mA, U {:.1} N",
        radius[0] * 1e6,
        radius[1] * 1e6,
        omega * 60.0 / TAU,
        window_s * omega / TAU,
        noise[0] * 1e6,
        noise[1] * 1e3,
        scenario.value("plant", "unbalance.magnitude").map_or(0.0, Value::as_f64) * omega * omega
    );
    let group = format!(
        "{}{}, noise {}",
        if balanced { BALANCED } else { "unbalance" },
        if voltage { ", voltage" } else { ", current" },
        if told { "told" } else { "found" }
    );
    (group, scenario)
}

#[test]
fn drawn_bearings_with_every_method() {
    let first = asked("SURVEY_SEED", FRESH);
    let mut found = survey(asked("SURVEY", 20), |case| drawn(first + case));
    // The other methods presume that there is no unbalance. One that hides in the noise they take for λ; it is printed here, and
    // stands in the README's limits.
    let presumed = |(group, method): &(String, &'static str)| *method == "unbalance" || group.starts_with(BALANCED);
    let hidden: BTreeMap<_, _> = found.extract_if(.., |key, _| !presumed(key)).collect();
    judge(&hidden);
    let misses = judge(&found);
    assert!(misses.is_empty(), "{}", misses.join("\n"));
}
