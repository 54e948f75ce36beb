//! What `design` promises is what the runs show.

use std::path::Path;

use magnetic_bearing::app::design::{Question, design, figure};
use magnetic_bearing::app::montecarlo::{self, NOISE};
use magnetic_bearing::app::scenario::Scenario;
use magnetic_bearing::slave::variable::Value;

fn question(rpm: f64, windows_s: Vec<f64>, instant_s: f64) -> Question {
    Question { rpm, step_s: None, windows_s, noise: NOISE, instant_s }
}

fn open() -> Scenario {
    Scenario::open(Path::new("unbalanced")).expect("a scenario that comes with the program")
}

#[test]
fn promises_are_kept() {
    const RUNS: usize = 40;
    /// Ratio of the rms error to the promise; the scatter of forty runs is about 11 %.
    const KEPT: std::ops::RangeInclusive<f64> = 0.65..=1.4;
    for (rpm, window_s) in [(3000.0, 0.02), (4500.0, 0.0067)] {
        let (promises, _) = design(&open(), &question(rpm, vec![window_s], 0.1)).expect("a good scenario");
        let mut study = montecarlo::study("", &open(), NOISE, true, RUNS);
        montecarlo::at_speed(&mut study.scenario, rpm, window_s);
        study.instants_s = vec![0.1];
        let figures = &study.run().expect("a good scenario").figures[0];
        for k in 0..3 {
            let ratio = figures.rms[k] / promises[0].std[k];
            println!("{rpm} rpm, lambda[{}]: promised {:.4}, found {:.4}", k + 1, promises[0].std[k], figures.rms[k]);
            assert!(KEPT.contains(&ratio), "{rpm} rpm, lambda[{}]: {ratio}", k + 1);
        }
    }
}

#[test]
fn a_window_is_recommended_or_none() {
    let (promises, recommended) = design(&open(), &question(3000.0, Vec::new(), 0.1)).expect("a good scenario");
    let chosen = &promises[recommended.expect("a window")];
    assert!((0.015..=0.025).contains(&chosen.window_s), "{} s", chosen.window_s);
    // Longer windows have less gain for noise, a lower band and more delay.
    for pair in promises.windows(2) {
        assert!(pair[1].noise_gain[0] < pair[0].noise_gain[0]);
        assert!(pair[1].band_hz[1] <= pair[0].band_hz[1]);
        assert!(pair[1].delay_s > pair[0].delay_s);
    }
    let mut circle = open();
    for (element, name) in [("controller", "reference.rY"), ("plant", "Y0")] {
        circle.set(element, name, Value::Real(70e-6));
    }
    let (_, none) = design(&circle, &question(3000.0, vec![0.02], 0.2)).expect("a good scenario");
    assert_eq!(none, None, "the unbalance cannot be told apart on a circle");
}

#[test]
fn the_plot_in_the_documentation_is_current() {
    let drawn = figure();
    let is_current = drawn == include_str!("../modelDescription/window.svg");
    assert!(is_current, "modelDescription/window.svg is not current: run `cargo run --release -- describe`");
    assert_eq!(drawn.matches("<svg").count(), 4, "one in all and three parts");
    for text in ["standard deviation in %", "window Tf in ms", "frequency in Hz", "delay in ms", "λ₃", "recommended"]
    {
        assert!(drawn.contains(text), "the plot does not say {text:?}");
    }
}
