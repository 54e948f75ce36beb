//! The Campbell diagram of a shaft as a page.

use maud::html;
use nalgebra::ComplexField;

use super::Report;
use super::figures::Figure;
use crate::report::plot::{Line, Plot, PlotUnit, colour};
use crate::studies::whirl::Whirl;
use crate::table::Table;

/// Points along each line.
const POINTS: usize = 240;

/// The page of `command`: whirl frequencies and unbalance response up to `greatest_rpm`, and the table.
pub fn page(command: &str, whirl: &Whirl, greatest_rpm: f64, table: &Table) -> String {
    let rpm: Vec<f64> = (0..=POINTS).map(|n| greatest_rpm * n as f64 / POINTS as f64).collect();
    let omega = |rpm: &f64| rpm * std::f64::consts::PI / 30.0;
    let speed = ("speed", PlotUnit { name: "rpm", factor: 1.0 });
    let hertz = PlotUnit { name: "Hz", factor: 1.0 };

    let speeds = [0.0, greatest_rpm];
    let all: Vec<[[f64; 2]; 2]> = rpm.iter().map(|rpm| whirl.modes_hz(omega(rpm))).collect();
    let highest = all.iter().flatten().flatten().copied().fold(0.0, f64::max);
    let frequencies = Plot::new(speed, ("natural frequency", hertz)).range(0, speeds).range(1, [0.0, 1.2 * highest]);
    let mut frequencies = frequencies.height(420.0);
    for mode in 0..2 {
        let line = |name: &str| Line::new(&format!("mode {} {name}", mode + 1), colour::MAGNETS[mode]).width(2.0);
        let of = |direction: usize| all.iter().map(|one| one[mode][direction]).collect::<Vec<_>>();
        frequencies.line(line("backward").dotted(), &rpm, &of(0));
        frequencies.line(line("forward"), &rpm, &of(1));
    }
    let synchronous: Vec<f64> = rpm.iter().map(|rpm| rpm / 60.0).collect();
    frequencies.line(Line::new("speed (1×)", colour::INK).dashed(), &rpm, &synchronous);
    for (mode, rpm) in whirl.critical_rpm(greatest_rpm) {
        frequencies.instant(rpm, &format!("critical {mode}"));
    }

    let mut response = Plot::new(speed, ("amplitude", PlotUnit::MICROMETRE)).range(0, speeds).decades(1).height(320.0);
    let responses: Vec<_> = rpm.iter().skip(1).map(|rpm| whirl.response_m(omega(rpm))).collect();
    for (bearing, name) in ["A", "B"].into_iter().enumerate() {
        let amplitude: Vec<f64> = responses.iter().map(|one| one[bearing].modulus()).collect();
        response.line(Line::new(name, colour::MAGNETS[bearing]), &rpm[1..], &amplitude);
    }

    let of_frequencies = "Natural frequencies of the rigid shaft over its speed. Gyroscopic moments raise those that whirl with the rotor and \
                          lower those that whirl against it. Unbalance excites forward whirl where its line meets that of the speed.";
    let of_response = "Orbit of the shaft in the bearings under its unbalance.";
    let figures = [
        Figure::new("campbell", "Natural frequencies", vec![frequencies], of_frequencies.into()),
        Figure::new("response", "Response to the unbalance", vec![response], of_response.into()),
    ];
    let answer = html! { p.verdict { (whirl.critical_in_words(greatest_rpm)) } };
    let report = Report { title: "Campbell diagram", command, tables: vec![table.clone()], ..Report::default() };
    report.page(&answer, &figures)
}
