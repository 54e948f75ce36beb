//! The machines other than the planar rotor: closed loops, accuracy, correction masses, pages.

use crate::prelude::*;

use magnetic_bearing::simulation::{summary, synchronous};

/// From an instant in s on, the estimate is valid, and the error of each magnet in use is below a relative limit and a number of its own
/// standard deviations.
///
/// First guesses of the spindle are wrong by a factor of two. Fails if its estimator assumes that the sensors are at the magnets.
#[test]
fn all_force_constants_of_every_machine_are_identified() {
    let bias = ("allocation", "biasCurrent");
    let voltage = [("drive", "voltage"), ("hold", "linear")];
    for (name, changes, from_s, limit, most_std) in [
        ("planar4", &[][..], 0.1, 0.02, 5.0),
        ("planar4", &[bias], 0.1, 0.02, 5.0),
        ("planar4", &voltage, 0.2, 0.02, 5.0),
        ("planar4", &[voltage[0], voltage[1], bias], 0.2, 0.02, 5.0),
        ("spindle", &[], 0.1, 0.01, 4.0),
        ("spindle4", &[], 0.15, 0.02, 5.0),
        ("spindle4", &[bias], 0.15, 0.02, 5.0),
        ("axial", &[], 0.1, 0.02, 5.0),
        ("axial", &[bias], 0.1, 0.02, 5.0),
        // A body suspended below one magnet.
        ("levitation", &[], 0.5, 0.02, 5.0),
    ] {
        let (scenario, run) = scenario_and_run(name, changes);
        let (machine, truth) = (scenario.machine, scenario.truth());
        let names = ["lambda", "lambdaHat", "lambdaStdTotal"].map(|name| machine.of_magnets(name));
        for at_s in [from_s, scenario.duration_s] {
            let read = |name: &str| column(&run, &format!("estimator.{name}"))[row(&run, at_s)];
            assert_eq!(read("valid"), 1.0, "{name} {changes:?} at {at_s} s");
            for k in (0..machine.magnets()).filter(|k| scenario.uses(*k)) {
                let [lambda, hat, std] = names.each_ref().map(|names| names[k].as_str());
                let (error, std) = (read(hat) / truth[k] - 1.0, read(std) / truth[k]);
                let what = format!("{name} {changes:?} at {at_s} s: {lambda} is off by {error:.4}, std {std:.4}");
                assert!(error.abs() < limit && error.abs() < most_std * std, "{what}");
            }
        }
    }
}

/// Accuracy: 1 µm at 3000 rpm and 3 µm at 6000 rpm in each bearing after the update, with voltage drive and noise. The reference is that
/// of the next sample, the position that of the communication point.
#[test]
fn both_bearings_track_their_references() {
    for (omega, limit_m) in [("314.159265358979", 1e-6), ("628.318530717959", 3e-6)] {
        let speed = [("plant.omega", omega), ("controller.reference.omega", omega)];
        let drive = [("plant.drive", "voltage"), ("controller.drive", "voltage"), ("estimator.hold", "linear")];
        let (scenario, run) = scenario_and_run("spindle", &[speed.as_slice(), &drive].concat());
        for bearing in ["A.", "B."] {
            let error_m = error_m(&run, bearing, 0.3, scenario.duration_s);
            assert!(error_m < limit_m, "{omega} rad/s, {bearing}: {error_m:e} m");
        }
    }
}

#[test]
fn correction_masses_remove_the_synchronous_force() {
    let (scenario, run) = scenario_and_run("balance", &[]);
    let forces = |at_s: f64| synchronous::forces(&run.recording, at_s).expect("forces");
    let (before, after) = (forces(scenario.balance_s.expect("a time")), forces(scenario.duration_s));
    for (before, after) in before.into_iter().zip(after) {
        assert!(before > 2.0 && after < 0.05 * before, "{before} N before, {after} N after");
    }
    for outside_s in [0.05, 99.0] {
        assert_eq!(synchronous::forces(&run.recording, outside_s), None, "{outside_s} s");
    }
}

/// Neither in the report nor in machine-readable results.
#[test]
fn a_magnet_that_is_not_used_has_no_estimate() {
    let (scenario, run) = scenario_and_run("levitation", &[("duration", "0.1")]);
    let page = experiment::page(Path::new("levitation"), "", &scenario, &run);
    assert!(page.contains("true λ₁") && page.contains("error 1"), "the magnet that is used is drawn");
    assert!(!page.contains("true λ₂") && !page.contains("error 2") && !page.contains("2 std 2"), "the other is not");
    let estimate = &summary::json(&scenario, &run)["estimates"][0];
    for name in ["lambdaHat", "lambdaStd", "lambdaStdTotal", "error"] {
        assert!(estimate[name][0].is_f64() && estimate[name][1].is_null(), "{name}: {estimate}");
    }
    let design = "controller.magnets.used,estimator.magnets.used\nfirst,first\n";
    let row = swept(&folder("sweep/used"), design, "levitation").remove(0);
    for name in ["error", "lambdaHat", "lambdaStd"] {
        let is_empty =
            |k: &str| row.iter().any(|(head, cell)| head.starts_with(&format!("{name}[{k}]")) && cell.is_empty());
        assert!(!is_empty("1") && is_empty("2"), "{name}: {row:?}");
    }
}

#[test]
fn the_page_shows_the_machine() {
    for (name, words) in [("spindle", "Orbit, bearing B"), ("balance", "Synchronous force of the magnets")] {
        let (scenario, run) = scenario_and_run(name, &[]);
        let page = experiment::page(Path::new(name), "", &scenario, &run);
        assert_contains(&page, &[&scenario.title, "shaft-animation", "Position along x", words]);
        assert_contains(&page, &["Unbalance in two planes"]);
        assert!(page.contains("-120 mm") && !page.contains("-120000 µm"), "positions along the shaft");
        // The forces before and after the correction masses are on the first screen, before the animation.
        let (first_screen, _) = page.split_once("shaft-animation").expect("an animation");
        assert_eq!(first_screen.contains("Synchronous force of the magnets"), name == "balance", "{name}");
    }
}
