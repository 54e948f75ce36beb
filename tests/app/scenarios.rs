//! The built-in scenarios and the effects that they demonstrate.

use crate::prelude::*;

fn largest(run: &Run, name: &str, from_s: f64, to_s: f64) -> f64 {
    values_within(run, name, from_s, to_s).into_iter().fold(0.0, |most, value| most.max(value.abs()))
}

/// No amplifier chatters. Fails (68 times in 10 ms) if λ approaches its estimate in small steps, one per sample, and each step restarts the
/// smallest force from the measured forces: nothing then holds it at F0, and the coil that carries it loses its current.
#[test]
fn every_scenario_runs_to_its_end_and_has_a_page() {
    for scenario in BUILT_IN.into_iter().map(|(name, _)| open(name, &[])).filter(|of| of.machine.name == "planar") {
        let run = run_to_end(&scenario);
        let name = &scenario.title;
        let page = experiment::page(Path::new(name), "", &scenario, &run);
        assert_contains(&page, &[name, "Figures of the bearing", "largest displacement / clearance of"]);
        assert_contains(&page, &["Sensitivity function of each axis"]);
        for column in &run.recording.columns {
            assert!(column.values.iter().all(|value| value.is_finite()), "{name}: {} is not finite", column.name);
        }
        for (k, turns) in chatter(&scenario, &run).into_iter().enumerate() {
            // One occurs at the update or when a lift ends.
            assert!(turns <= 1, "{name}: u[{}] goes from limit to limit {turns} times in 10 ms", k + 1);
        }
    }
}

/// Ten seeds of the sensor noise, none of them selected.
#[test]
fn the_experiment_finds_the_constants_despite_amplifiers_and_noise() {
    let mut scenario = open("experiment", &[]);
    scenario.elements.truncate(3);
    for seed in 1..=10 {
        scenario.set("plant", "sensor.seed", seed);
        let run = run_to_end(&scenario);
        for (k, error) in lambda_errors(&scenario, &run, "estimator", 0.19).into_iter().enumerate() {
            below(&format!("seed {seed}: relative error of λ{} at 0.19 s", k + 1), error.abs(), 0.01);
        }
        let what = format!("seed {seed}: tracking error after the update, m");
        below(&what, error_m(&run, "", 0.25, scenario.duration_s), 1e-6);
    }
}

/// Weak amplifiers have an effect while they are at their limit, but not afterwards.
///
/// Fails if `limited` is not set. A controller that uses its commanded voltage is little worse: each current sample updates the
/// state of the coils, so nothing winds up.
#[test]
fn amplifiers_at_their_limit_have_no_lasting_effect() {
    let (mut scenario, free) = scenario_and_run("experiment", &[]);
    scenario.elements.truncate(3);
    // A load step that exceeds the amplifiers.
    let text = "title = \"x\"\nduration = \"1 s\"\nstep = \"100 µs\"\n[[profile]]\nof = [\"plant.pZ\"]\n\
                time = [\"0.25 s\", \"0.2501 s\", \"0.26 s\", \"0.2601 s\"]\nvalue = [\"-20 N\", \"-120 N\", \"-120 N\", \"-20 N\"]\n";
    scenario.profiles = Scenario::parse("x", text).expect("sound").profiles;
    for element in ["plant", "controller"] {
        scenario.set(element, "coil.uMax", 60.0);
    }
    let run = run_to_end(&scenario);
    assert_eq!(largest(&run, "controller.limited", 0.25, 0.27), 1.0, "the limit is reached");
    assert!(error_m(&run, "", 0.25, 0.27) > 5.0 * error_m(&free, "", 0.25, 0.27), "and has an effect");
    below("error 40 ms later, m", error_m(&run, "", 0.31, 0.4), 1.2e-6);
}

/// Largest number of limit-to-limit changes of each voltage within 10 ms.
fn chatter(scenario: &Scenario, run: &Run) -> [usize; 3] {
    /// Fraction of the limit from which an amplifier counts as limited.
    const AT_LIMIT: f64 = 0.999;
    let limit_v = AT_LIMIT * scenario.value("controller", "coil.uMax").expect("a parameter").as_f64();
    let samples = (10e-3 / scenario.step_s).round() as usize;
    std::array::from_fn(|k| {
        let voltage = column(run, &format!("controller.u[{}]", k + 1));
        let side = |u: f64| i32::from(u >= limit_v) - i32::from(u <= -limit_v);
        let turns: Vec<_> = voltage.windows(2).map(|two| usize::from(side(two[0]) * side(two[1]) < 0)).collect();
        turns.windows(samples).map(|within| within.iter().sum()).max().unwrap_or(0)
    })
}

/// With both drives. The load acts before the first current, and is compensated within 20 ms.
#[test]
fn at_standstill_the_modulation_excites_the_currents_but_not_the_rotor() {
    for drive in ["current", "voltage"] {
        let (_, run) = scenario_and_run("standstill", &[("plant.drive", drive), ("controller.drive", drive)]);
        below(&format!("{drive}: radius while the load is compensated, m"), error_m(&run, "", 0.0, 0.02), 10e-6);
        below(&format!("{drive}: radius, m"), error_m(&run, "", 0.02, 0.6), 1e-6);
        for k in 1..=3 {
            let current = column(&run, &format!("plant.im[{k}]"))[400..].iter().copied();
            let (low, high) = (current.clone().fold(f64::MAX, f64::min), current.fold(f64::MIN, f64::max));
            assert!(high - low > 0.3, "{drive}: current {k} stays between {low} and {high} A");
        }
    }
}

/// Better than the accuracy that industry requires.
#[test]
fn circle_and_hole_are_cut_within_half_a_micrometre() {
    // The circle has no update and is in steady state after 50 ms; the estimate of the hole becomes valid at about 0.39 s.
    for (name, from_s) in [("circle", 0.05), ("hole", 0.45)] {
        let (_, run) = scenario_and_run(name, &[]);
        below(&format!("{name}: radial error, m"), error_m(&run, "", from_s, 0.6), 0.5e-6);
    }
}

#[test]
fn lift_off_takes_the_rotor_from_the_ring_to_its_reference() {
    let (_, run) = scenario_and_run("lift-off", &[]);
    assert_eq!(column(&run, "plant.touchdown.contact")[0], 1.0, "it begins on the ring");
    assert_eq!(largest(&run, "plant.touchdown.contact", 0.01, 1.0), 0.0, "the ring is left within 10 ms, for good");
    below("deviation from the reference while lifted, m", error_m(&run, "", 0.01, 0.06), 5e-6);
    below("tracking error after the update, m", error_m(&run, "", 0.25, 0.4), 0.5e-6);
}

#[test]
fn a_lost_coil_drops_the_rotor_onto_the_ring_and_its_return_lifts_it() {
    let (_, run) = scenario_and_run("coil-loss", &[]);
    assert_eq!(largest(&run, "plant.touchdown.contact", 0.0, 0.2), 0.0);
    below("current of the open coil, A: noise alone", largest(&run, "plant.im[3]", 0.2005, 0.2995), 0.03);
    assert_eq!(largest(&run, "plant.touchdown.contact", 0.2, 0.3), 1.0, "it falls");
    let radius =
        column(&run, "plant.Y").iter().zip(column(&run, "plant.Z")).map(|(y, z)| y.hypot(*z)).fold(0.0, f64::max);
    below("largest distance from the centre, m", radius, 3.5e-4);
    assert_eq!(largest(&run, "plant.touchdown.contact", 0.32, 0.5), 0.0, "it is lifted again");
    below("tracking error at the end, m", error_m(&run, "", 0.45, 0.5), 0.5e-6);
}

#[test]
fn the_run_up_drives_plant_and_reference_together() {
    let (scenario, run) = scenario_and_run("run-up", &[]);
    let omega = column(&run, "plant.omegam");
    let rpm = |omega: f64| omega * 30.0 / std::f64::consts::PI;
    below("speed at the start, rpm", (rpm(omega[1]) - 1500.0).abs(), 1e-6);
    below("speed at the end, rpm", (rpm(omega[omega.len() - 1]) - 6000.0).abs(), 1e-6);
    let half = row(&run, 0.5);
    // The speed is that of the previous step, 0.56 rpm less.
    below("speed half way, rpm", (rpm(omega[half]) - 3750.0).abs(), 1.0);
    // With noise of 0.1 µm the window of the estimator is shortest where the speed is low.
    for error in lambda_errors(&scenario, &run, "estimator", 0.9) {
        below("relative error of λ̂ at 0.9 s", error.abs(), 0.02);
    }
    below("radial error at 3000 rpm and below, m", error_m(&run, "", 0.1, 0.35), 1.5e-6);
    // With known constants the coils follow: from 30 ms after the update on, every magnet pulls with more than 0.8 F0.
    let update = column(&run, "estimator.valid").iter().position(|valid| *valid == 1.0).expect("a valid estimate");
    for k in 1..=3 {
        let force = &column(&run, &format!("plant.F[{k}]"))[update + 300..];
        let least = force.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(least > 16.0, "magnet {k} pulls with {least} N");
    }
}

#[test]
fn a_profile_interpolates_linearly_and_holds_its_ends() {
    let text = "title = \"x\"\nduration = \"1 s\"\nstep = \"100 µs\"\n[[profile]]\nof = [\"plant.omega\"]\ntime = [\"0.1 s\", \"0.3 s\"]\n\
                value = [\"10 rad/s\", \"20 rad/s\"]\n[[profile]]\nof = [\"plant.coil.open[1]\"]\ntime = [0.5]\nvalue = [true]\n";
    let scenario = Scenario::parse("x", text).expect("sound");
    let [omega, open] = &scenario.profiles[..] else { panic!("two profiles") };
    for (time, value) in [(0.0, 10.0), (0.1, 10.0), (0.2, 15.0), (0.3, 20.0), (9.0, 20.0)] {
        below("profile", (omega.at(time).expect("a value").as_f64() - value).abs(), 1e-12);
    }
    assert_eq!(open.at(0.4), None);
    assert_eq!(open.at(0.5).map(|value| value.as_f64()), Some(1.0));
}
