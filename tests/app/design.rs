//! The standard deviations that `design` predicts against those of runs.

use crate::prelude::*;
use magnetic_bearing::studies::design::{self, Conditions, design, worst_in_the_end};

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
    const LIMITS: [f64; 2] = [0.65, 1.4];
    let [alone, modulated] = design(&unbalanced(), &conditions(4500.0, 0.1)).expect("a good scenario");
    let mut study = montecarlo::study("", &unbalanced(), NOISE, true, RUNS);
    montecarlo::at_speed(&mut study.scenario, 4500.0);
    study.instants_s = vec![0.1];
    for (precision, modulation) in [(alone, 0.0), (modulated, design::MODULATION.0)] {
        study.scenario.set("controller", "F0.modulation", modulation);
        study.scenario.set("controller", "F0.modulationFrequency", design::MODULATION.1);
        let figures = &study.run().expect("a good scenario").figures[0];
        let predicted = precision.last().expect("the instant asked for");
        for ((k, found), predicted) in (1..).zip(&figures.rms).zip(predicted) {
            let what = format!("modulation {modulation}, lambda[{k}]: predicted {predicted:.4}, ratio");
            between(&what, found / predicted, LIMITS[0], LIMITS[1]);
        }
    }
}

#[test]
fn modulation_is_recommended_where_the_excitation_is_weak() {
    let strong = conditions(3000.0, 0.1);
    let precisions = design(&unbalanced(), &strong).expect("a good scenario");
    assert!(!design::is_modulation_recommended(&precisions), "{precisions:?}");
    assert_contains(&design::advice(&unbalanced(), &strong, &precisions), &["The reference trajectory excites enough"]);
    // At rest modulation is recommended; `commands` tests that for every machine.
    let rest = conditions(0.0, 0.2);
    let precisions = design(&unbalanced(), &rest).expect("a good scenario");
    assert!(worst_in_the_end(&precisions[1]) < 0.05 && worst_in_the_end(&precisions[0]) > 0.05, "{precisions:?}");
    // The precision of λ improves with time.
    for precision in &precisions {
        assert_eq!(precision.len(), design::INSTANTS_S.len() + 1);
        for pair in precision[..design::INSTANTS_S.len()].windows(2) {
            assert!((0..3).all(|k| pair[1][k] < pair[0][k]), "{precision:?}");
        }
    }
    assert_eq!(design::table(&unbalanced(), &rest, &precisions).rows.len(), design::INSTANTS_S.len() + 1);
}

/// Neither variant is recommended where the bound exceeds the limit of a valid estimate, or does not exist.
#[test]
fn no_advice_without_a_valid_estimate() {
    let good = conditions(3000.0, 0.01);
    let too_early = Conditions { instant_s: 1e-3, ..good.clone() };
    let [loud, quiet] = [[NOISE[0], 1e300], [1e-300, NOISE[1]]].map(|noise| Conditions { noise, ..good.clone() });
    for conditions in [too_early, loud, quiet, conditions(0.0, 0.01)] {
        let precisions = design(&unbalanced(), &conditions).expect("a good scenario");
        let advice = design::advice(&unbalanced(), &conditions, &precisions);
        let absent = ["enough:", "0.00 %", "NaN", "inf"];
        assert!(!absent.iter().any(|word| advice.contains(word)), "{advice}");
        assert_contains(&advice, &["The limit of a valid estimate"]);
        let table = design::table(&unbalanced(), &conditions, &precisions);
        assert!(!table.rows.iter().flatten().any(|cell| ["0.00", "NaN", "inf"].contains(&&**cell)), "{:?}", table.rows);
    }
}
