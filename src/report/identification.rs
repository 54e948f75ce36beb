//! The report page of an identification.

use maud::html;

use crate::estimation::{Method, Verdict};
use crate::report::frame;
use crate::report::plot::{self, Line, Plot, Unit, colour};
use crate::report::{cards, table_of};
use crate::simulation::recording::Recording;
use crate::studies::identify::{Answer, Samples, Track, recording, table};
use crate::table::Table;

/// The result as a page of its own, made by that command.
#[must_use]
pub fn page(
    title: &str,
    command: &str,
    samples: &Samples,
    tracks: &[Track],
    holds: Option<&Table>,
    answer: Option<&Answer>,
) -> String {
    let recording = recording(samples, tracks);
    let mut figures: Vec<(String, Vec<Plot>, String)> = Vec::new();
    for track in tracks {
        let caption = format!(
            "With a band of two standard deviations. Gaps are instants without a valid estimate. {}",
            track.verdict()
        );
        figures.push((format!("Force constants over time, {}", track.name), vec![bands(&recording, track)], caption));
    }
    if let Some(track) = tracks.iter().find(|track| track.config.method == Method::PredictionError) {
        let valid = |j: usize| track.outputs[j].valid;
        let mut unbalance = Plot::over_time(Unit::SECOND, ("unbalance", Unit { name: "g·mm", factor: 1e6 }));
        line(
            &mut unbalance,
            &recording,
            track,
            "unbalance.magnitude",
            Line::new("unbalance", colour::MAGNETS[0]),
            valid,
        );
        let mut load = Plot::over_time(Unit::SECOND, ("static load", Unit::NEWTON));
        for (name, label, colour) in
            [("pYHat", "along y", colour::MAGNETS[0]), ("pZHat", "along z", colour::MAGNETS[1])]
        {
            line(&mut load, &recording, track, name, Line::new(label, colour), valid);
        }
        let caption = "As identified together with the force constants.";
        figures.push(("Unbalance and static load".into(), vec![unbalance, load], caption.into()));
    }
    let mut residual = Plot::over_time(Unit::SECOND, ("residual", Unit::ONE));
    let colours = [colour::MAGNETS[0], colour::MAGNETS[1], colour::MAGNETS[2], colour::OTHER];
    for (track, colour) in tracks.iter().zip(colours) {
        line(&mut residual, &recording, track, "residual", Line::new(track.name, colour), |_| true);
    }
    figures.push((
        "What the model leaves unexplained".into(),
        vec![residual],
        "Of predictionError the normalised innovation squared, 1 where model and noise describe the data; of the paper's methods the \
         part of the motion that is left over.".into(),
    ));
    let mut tables: Vec<Table> = answer.map(Answer::tables).unwrap_or_default();
    tables.extend(std::iter::once(table(tracks)).chain(holds.cloned()));
    let verdict = answer.map(|answer| answer.verdict.clone()).or_else(|| tracks.last().map(Track::verdict));
    let class = match answer {
        Some(answer) if answer.valid => "verdict good",
        Some(_) => "verdict bad",
        None => "verdict",
    };
    let body = html! {
        header { h1 { (title) } }
        main {
            section #answer {
                @if let Some(verdict) = &verdict {
                    p class=(class) { (verdict) }
                }
                @if let Some(answer) = answer {
                    @if let Some(found) = &answer.found {
                        (cards([0, 1, 2].map(|k| found.lambda[k].value), [0, 1, 2].map(|k| found.lambda[k].total_std), None))
                        p.soft { "In 10⁻⁶ N·m²/A²; ± is two standard deviations, tolerances included." }
                    }
                    p { (answer.told()) }
                    ul { @for finding in &answer.findings { li { (finding) } } }
                }
                ul { @for note in &samples.notes { li { (note) } } }
            }
            @for (title, plots, caption) in &figures {
                figure {
                    h2 { (title) }
                    div.panels { @for plot in plots.iter().filter(|plot| !plot.is_empty()) { (plot.html()) } }
                    figcaption { (caption) }
                }
            }
            section #results { @for table in &tables { (table_of(table)) } }
            @if !command.is_empty() {
                section.table {
                    p.soft { "This page is made by" }
                    pre { code { (command) } }
                }
            }
        }
        (plot::scripts())
    };
    frame::page(title, &body)
}

/// Adds a signal of a track, with gaps where it is not to be shown.
fn line(plot: &mut Plot, recording: &Recording, track: &Track, name: &str, line: Line, show: impl Fn(usize) -> bool) {
    let values = recording.get(&format!("{}.{name}", track.name)).unwrap_or(&[]);
    let filling = |j: usize| track.outputs.get(j).is_none_or(|output| output.verdict == Verdict::Collecting);
    let shown = |(j, value): (usize, &f64)| if show(j) && !filling(j) { *value } else { f64::NAN };
    plot.line(line, &recording.time_s, &values.iter().enumerate().map(shown).collect::<Vec<f64>>());
}

fn bands(recording: &Recording, track: &Track) -> Plot {
    let mut plot = Plot::over_time(Unit::SECOND, ("λ̂", Unit::LAMBDA)).height(380.0);
    for k in 0..3 {
        let edge = |stds: f64| -> Vec<f64> {
            let valid = track.outputs.iter().map(|output| output.valid.then_some(output));
            valid.map(|output| output.map_or(f64::NAN, |o| o.lambda_hat[k] + stds * o.lambda_std_total[k])).collect()
        };
        let group = format!("λ{}", k + 1);
        plot.band(&group, colour::BANDS[k], &recording.time_s, &edge(-2.0), &edge(2.0));
        let line = Line::new(&format!("λ̂{}", ["₁", "₂", "₃"][k]), colour::MAGNETS[k]).group(&group).width(2.0);
        plot.line(line, &recording.time_s, &edge(0.0));
    }
    plot
}
