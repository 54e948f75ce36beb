//! The report page of an identification of one axis.

use maud::html;

use crate::report::figures::{Figure, time_unit};
use crate::report::plot::{Line, Plot, PlotUnit, colour};
use crate::report::{Report, page_with};
use crate::simulation::recording::Recording;
use crate::studies::identify::axial::Answer;

/// The report page of an identification made by that command. The figures are of the first recording.
#[must_use]
pub fn page(title: &str, command: &str, answers: &[Answer]) -> String {
    let traces = answers[0].traces();
    let whole = Recording { time_s: traces.time_s.clone(), columns: Vec::new() };
    let tables = answers.iter().map(Answer::table).collect();
    let report = Report { command: command.into(), tables, ..Report::new(title, &whole) };
    let first = html! {
        @for answer in answers {
            p class=(if answer.valid { "verdict good" } else { "verdict bad" }) { (answer.verdict) }
            p { (answer.told()) }
            ul { @for line in answer.findings.iter().chain(&answer.notes) { li { (line) } } }
        }
    };
    let unit = time_unit(traces.time_s.last().copied().unwrap_or(1.0));
    let over_time = |name: &str, of: PlotUnit| Plot::over_time(unit, (name, of));
    let mut position = over_time("x", PlotUnit { name: "mm", factor: 1e3 });
    position.line(Line::new("measured", colour::MAGNETS[0]).width(1.0), &traces.time_s, &traces.x_m);
    let mut current = over_time("i", PlotUnit::AMPERE);
    for (k, values) in traces.current_a.iter().enumerate() {
        current.line(Line::new(["i", "second"][k], colour::MAGNETS[k]).width(1.0), &traces.time_s, values);
    }
    let mut slow = over_time("slow force", PlotUnit { name: "mN", factor: 1e3 });
    let side = |sign: f64| traces.slow_n.iter().map(|[force, std]| force + 2.0 * sign * std).collect::<Vec<_>>();
    let middle: Vec<f64> = traces.slow_n.iter().map(|of| of[0]).collect();
    slow.band("slow force", colour::BANDS[0], &traces.time_s, &side(-1.0), &side(1.0));
    slow.line(Line::new("slow force", colour::MAGNETS[0]).group("slow force"), &traces.time_s, &middle);
    let mut errors = over_time("prediction error", PlotUnit::MICROMETRE);
    errors.line(Line::new("one sample ahead", colour::MAGNETS[1]).width(1.0), &traces.time_s, &traces.error_m);
    for plot in [&mut position, &mut current, &mut slow, &mut errors] {
        if traces.from_s > traces.time_s[0] {
            plot.shade(traces.time_s[0], traces.from_s);
        }
    }
    let recorded = vec![("Position".to_owned(), position), ("Currents".to_owned(), current)];
    let found = vec![("Slow force".to_owned(), slow), ("Prediction errors".to_owned(), errors)];
    let caption = "As recorded; what is shaded was left out, and so were faults and repeated rows.";
    let of_force = "The force that the law does not explain, with a band of two standard deviations, and the errors of predictions.";
    let figures = [
        Figure::new("recorded", "Recording", recorded, caption.into()),
        Figure::new("slow", "What the law leaves", found, of_force.into()),
    ];
    page_with(&report, &first, &figures)
}
