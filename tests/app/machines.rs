//! The machines beside the planar rotor and the spindle: their closed loops, and what they refuse.

use std::path::Path;

use crate::support::says;
use magnetic_bearing::machine::{MACHINES, Machine};
use magnetic_bearing::package;
use magnetic_bearing::simulation::scenario::Scenario;
use magnetic_bearing::simulation::simulate::{Run, run};

/// Errors above this many of their own standard deviations contradict them.
const MOST_STD: f64 = 5.0;

fn open(name: &str, changes: &[(&str, &str)]) -> Scenario {
    let changes: Vec<_> = changes.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
    Scenario::open_with(Path::new(name), &changes).unwrap_or_else(|error| panic!("{error}"))
}

/// The value of an output at a time in s.
fn at(run: &Run, name: &str, time_s: f64) -> f64 {
    let row = run.recording.time_s.partition_point(|t| *t < time_s - 1e-9).min(run.recording.time_s.len() - 1);
    run.recording.get(name).unwrap_or_else(|| panic!("{name}"))[row]
}

/// Runs a scenario: from an instant in s on the estimate is valid, and all these magnets are known within a part.
fn estimates(scenario: &Scenario, from_s: f64, magnets: &[String], limit: f64) {
    let run = run(scenario).expect("a run");
    assert_eq!(run.error, None, "{}", scenario.title);
    let end_s = *run.recording.time_s.last().expect("a sample");
    for time_s in [from_s, end_s] {
        assert_eq!(at(&run, "estimator.valid", time_s), 1.0, "{} at {time_s} s", scenario.title);
        for magnet in magnets {
            let truth = scenario.value("plant", &magnet.replace("lambdaHat", "lambda")).expect("λ").as_f64();
            let error = at(&run, &format!("estimator.{magnet}"), time_s) - truth;
            let std = at(&run, &format!("estimator.{}", magnet.replace("Hat", "StdTotal")), time_s);
            println!(
                "{} at {time_s} s: {magnet} {:.3} %, {:.2} std",
                scenario.title,
                100.0 * error / truth,
                error / std
            );
            assert!(error.abs() < limit * truth, "{} at {time_s} s: {magnet} is off by {error:e}", scenario.title);
            assert!(error.abs() < MOST_STD * std, "{} at {time_s} s: {magnet}: {} std", scenario.title, error / std);
        }
    }
}

fn hats(machine: &Machine) -> Vec<String> {
    machine.of_magnets("lambdaHat")
}

#[test]
fn all_force_constants_of_every_machine_become_known() {
    for (name, from_s) in [("planar4", 0.1), ("spindle4", 0.15), ("axial", 0.1)] {
        let scenario = open(name, &[]);
        estimates(&scenario, from_s, &hats(scenario.machine), 0.02);
    }
}

#[test]
fn a_bias_current_holds_the_rotor_and_lets_the_estimator_work() {
    for (name, from_s) in [("planar4", 0.1), ("spindle4", 0.15), ("axial", 0.1)] {
        let scenario = open(name, &[("allocation", "biasCurrent")]);
        estimates(&scenario, from_s, &hats(scenario.machine), 0.02);
    }
}

#[test]
fn a_body_hangs_below_one_magnet() {
    let scenario = open("levitation", &[]);
    estimates(&scenario, 0.5, &["lambdaHat[1]".to_owned()], 0.02);
}

/// Voltage drive as well.
#[test]
fn amplifiers_with_voltage_drive_hold_four_magnets() {
    for allocation in ["smallestForce", "biasCurrent"] {
        let scenario = open("planar4", &[("drive", "voltage"), ("hold", "linear"), ("allocation", allocation)]);
        estimates(&scenario, 0.2, &hats(scenario.machine), 0.02);
    }
}

#[test]
fn what_a_machine_cannot_do_is_refused_by_name() {
    for (scenario, changes, words) in [
        (
            "planar4",
            &[("allocation", "biasCurrent"), ("alpha", "[0.8, 2.3, 4.0, 5.5]")][..],
            &["allocation = biasCurrent is refused", "face each other"][..],
        ),
        (
            "axial",
            &[("allocation", "biasCurrent"), ("magnets.used", "first")],
            &["allocation = biasCurrent is refused"],
        ),
        ("planar4", &[("alpha", "[0.0, 0.5, 1.0, 1.5]")], &["alpha[", "all round the rotor"]),
        ("axial", &[("bias.current", "-1 A")], &["bias.current = -1 A is refused"]),
        ("spindle4", &[("B.bias.current", "-1 A")], &["B.bias.current = -1 A is refused"]),
        ("axial", &[("reference.rX", "6e-4")], &["reference.rX", "does not touch magnet 1"]),
    ] {
        let scenario = open(scenario, changes);
        let Err(error) = run(&scenario) else { panic!("not refused: {words:?}") };
        says(&error.to_string(), words);
    }
    for name in ["method", "Tf", "filter.omega"] {
        let changes = [(format!("estimator.{name}"), "0.1".to_owned())];
        let error = Scenario::open_with(Path::new("planar4"), &changes).err().expect("a refusal").to_string();
        says(&error, &["there is no variable of this name"]);
    }
    let text = "title = \"x\"\nduration = 1.0\nstep = 1e-4\nmachine = \"planer4\"\n";
    says(&Scenario::parse("x", text).err().expect("a refusal").to_string(), &["did you mean planar4?"]);
    let error = package::machines(&["spindel"]).expect_err("a refusal");
    says(&error, &["spindel is no machine", "did you mean spindle?"]);
    assert_eq!(package::machines(&["axial"]).expect("a machine"), [&MACHINES[4]]);
}
