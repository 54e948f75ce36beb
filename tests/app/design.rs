//! What `design` promises is what the runs show.

use std::path::Path;

use fmu_export::variable::Value;
use magnetic_bearing::simulation::scenario::Scenario;
use magnetic_bearing::studies::design::{self, Question, design};
use magnetic_bearing::studies::montecarlo::{self, NOISE};

fn question(rpm: f64, instant_s: f64) -> Question {
    Question { rpm, step_s: None, noise: NOISE, instant_s }
}

fn open() -> Scenario {
    Scenario::open(Path::new("unbalanced")).expect("a scenario that comes with the program")
}

#[test]
fn promises_are_kept() {
    const RUNS: usize = 40;
    /// Ratio of the rms error to the promise; the scatter of forty runs is about 11 %.
    const KEPT: std::ops::RangeInclusive<f64> = 0.65..=1.4;
    for rpm in [3000.0, 4500.0] {
        let [alone, modulated] = design(&open(), &question(rpm, 0.1)).expect("a good scenario");
        let mut study = montecarlo::study("", &open(), NOISE, true, RUNS);
        montecarlo::at_speed(&mut study.scenario, rpm, 0.02);
        study.instants_s = vec![0.1];
        for (promise, modulation) in [(alone, 0.0), (modulated, design::MODULATION.0)] {
            study.scenario.set("controller", "F0.modulation", Value::Real(modulation));
            study.scenario.set("controller", "F0.modulationFrequency", Value::Real(design::MODULATION.1));
            let figures = &study.run().expect("a good scenario").figures[0];
            let promised = promise.std.last().expect("the instant asked for");
            for ((k, found), promised) in (1..).zip(figures.rms).zip(promised) {
                let ratio = found / promised;
                let what = format!("{rpm} rpm, modulation {modulation}, lambda[{k}]");
                println!("{what}: promised {promised:.4}, found {found:.4}");
                assert!(KEPT.contains(&ratio), "{what}: {ratio}");
            }
        }
    }
}

#[test]
fn modulation_is_recommended_where_the_path_is_weak() {
    let strong = question(3000.0, 0.1);
    let promises = design(&open(), &strong).expect("a good scenario");
    assert!(!design::is_modulation_recommended(&promises), "{promises:?}");
    assert!(design::advice(&strong, &promises).contains("The path excites enough"));
    let rest = question(0.0, 0.2);
    let promises = design(&open(), &rest).expect("a good scenario");
    assert!(design::is_modulation_recommended(&promises), "{promises:?}");
    assert!(promises[1].worst() < 0.05 && promises[0].worst() > 0.05, "{promises:?}");
    assert!(design::advice(&rest, &promises).contains("F0.modulation = 0.5"));
    // λ is known better and better.
    for promise in &promises {
        assert_eq!(promise.std.len(), promise.instants_s.len());
        for pair in promise.std[..design::INSTANTS_S.len()].windows(2) {
            assert!((0..3).all(|k| pair[1][k] < pair[0][k]), "{promise:?}");
        }
    }
    let table = design::table(&rest, &promises);
    assert_eq!(table.rows.len(), design::INSTANTS_S.len() + 1);
    assert!(table.rows.iter().all(|row| row.len() == table.head.len()), "{table:?}");
}

#[test]
fn bad_questions_are_refused_by_name() {
    let refused = |change: fn(&mut Question), name: &str| {
        let mut question = question(3000.0, 0.1);
        change(&mut question);
        let said = design(&open(), &question).expect_err(name).to_string();
        assert!(said.contains(name) && said.contains("is wanted"), "{said}");
    };
    refused(|question| question.rpm = -1.0, "speed");
    refused(|question| question.rpm = f64::NAN, "speed");
    refused(|question| question.instant_s = 0.0, "at");
    refused(|question| question.noise[0] = 0.0, "position-noise");
    refused(|question| question.noise[1] = f64::INFINITY, "current-noise");
}
