//! The standard deviations that `design` predicts are those of the runs.

use crate::program::open;
use magnetic_bearing::simulation::scenario::Scenario;
use magnetic_bearing::studies::design::{self, Conditions, design};
use magnetic_bearing::studies::montecarlo::{self, NOISE};

fn conditions(rpm: f64, instant_s: f64) -> Conditions {
    Conditions { rpm, step_s: None, noise: NOISE, instant_s }
}

fn unbalanced() -> Scenario {
    open("unbalanced", &[])
}

#[test]
fn predictions_agree_with_runs() {
    const RUNS: usize = 40;
    /// Ratio of the rms error to the prediction; the scatter of forty runs is about 11 %.
    const KEPT: std::ops::RangeInclusive<f64> = 0.65..=1.4;
    for rpm in [3000.0, 4500.0] {
        let [alone, modulated] = design(&unbalanced(), &conditions(rpm, 0.1)).expect("a good scenario");
        let mut study = montecarlo::study("", &unbalanced(), NOISE, true, RUNS);
        montecarlo::at_speed(&mut study.scenario, rpm);
        study.instants_s = vec![0.1];
        for (precision, modulation) in [(alone, 0.0), (modulated, design::MODULATION.0)] {
            study.scenario.set("controller", "F0.modulation", modulation);
            study.scenario.set("controller", "F0.modulationFrequency", design::MODULATION.1);
            let figures = &study.run().expect("a good scenario").figures[0];
            let promised = precision.std.last().expect("the instant asked for");
            for ((k, found), promised) in (1..).zip(&figures.rms).zip(promised) {
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
    let strong = conditions(3000.0, 0.1);
    let precisions = design(&unbalanced(), &strong).expect("a good scenario");
    assert!(!design::is_modulation_recommended(&precisions), "{precisions:?}");
    assert!(design::advice(&unbalanced(), &strong, &precisions).contains("The reference trajectory excites enough"));
    let rest = conditions(0.0, 0.2);
    let precisions = design(&unbalanced(), &rest).expect("a good scenario");
    assert!(design::is_modulation_recommended(&precisions), "{precisions:?}");
    assert!(precisions[1].worst() < 0.05 && precisions[0].worst() > 0.05, "{precisions:?}");
    assert!(design::advice(&unbalanced(), &rest, &precisions).contains("F0.modulation = 0.5"));
    // The precision of λ improves with time.
    for precision in &precisions {
        assert_eq!(precision.std.len(), precision.instants_s.len());
        for pair in precision.std[..design::INSTANTS_S.len()].windows(2) {
            assert!((0..3).all(|k| pair[1][k] < pair[0][k]), "{precision:?}");
        }
    }
    let table = design::table(&unbalanced(), &rest, &precisions);
    assert_eq!(table.rows.len(), design::INSTANTS_S.len() + 1);
    assert!(table.rows.iter().all(|row| row.len() == table.head.len()), "{table:?}");
}

#[test]
fn bad_questions_are_refused_by_name() {
    let refused = |change: fn(&mut Conditions), name: &str| {
        let mut conditions = conditions(3000.0, 0.1);
        change(&mut conditions);
        let said = design(&unbalanced(), &conditions).expect_err(name).to_string();
        assert!(said.contains(name) && said.contains("expected"), "{said}");
    };
    refused(|conditions| conditions.rpm = -1.0, "speed");
    refused(|conditions| conditions.rpm = f64::NAN, "speed");
    refused(|conditions| conditions.instant_s = 0.0, "at");
    refused(|conditions| conditions.noise[0] = 0.0, "position-noise");
    refused(|conditions| conditions.noise[1] = f64::INFINITY, "current-noise");
}
