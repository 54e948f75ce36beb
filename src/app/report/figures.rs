//! The figures of the report, each from the columns it needs.

use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::ops::Range as Indices;

use maud::{Markup, PreEscaped, html};

use super::{Report, Table, table_of};
use crate::app::plot::{Axis, Colour, Drawing, Line, Mark, Plot, Range, Unit};

/// Width of a plot over the whole page, and of one beside another, in pixels.
const WIDE_PX: f64 = 1060.0;
const HALF_PX: f64 = 520.0;
/// How many revolutions before the update and before the end are compared, as in the paper's figures.
const REVOLUTIONS: f64 = 2.0;
/// How long a piece is shown where the rotor does not turn or its angle is not recorded, in seconds.
const WITHOUT_ANGLE_S: f64 = 0.04;
/// The paper's error of λ̂ in simulation: 2.072 for 2.0.
const PAPER_ERROR: f64 = 0.036;
/// Path errors the industry asks for, in metres: on circular and on non-circular paths (introduction of the paper).
const ASKED_M: [(f64, &str); 2] = [(1e-6, "1 µm, for circles"), (3e-6, "3 µm, for other paths")];
/// Names of the magnets' indices.
const INDEX: [&str; 3] = ["₁", "₂", "₃"];

/// A figure: plots and what to see in them.
pub(super) struct Figure {
    /// Anchor in the page.
    pub(super) id: &'static str,
    /// Heading.
    pub(super) title: String,
    /// Figures of the paper it redraws, for instance `Figs. 7 and 9`.
    paper: Option<&'static str>,
    /// Columns of plots beside each other.
    columns: Vec<Vec<Panel>>,
    /// What to see.
    caption: String,
    /// Numbers below the plots.
    table: Option<Table>,
}

struct Panel {
    drawing: Drawing,
    /// What the notes on the drawing are to be told apart by; may be empty.
    name: String,
    /// A line below the plot.
    below: String,
}

impl From<Plot<'_>> for Panel {
    fn from(plot: Plot) -> Panel {
        Panel { drawing: plot.draw(), name: plot.title.clone(), below: String::new() }
    }
}

impl Figure {
    /// A figure that cannot be drawn, and why.
    fn missing(id: &'static str, title: &str, paper: Option<&'static str>, names: &[&str]) -> Figure {
        Figure {
            id,
            title: title.into(),
            paper,
            columns: Vec::new(),
            caption: format!("Not drawn: the recording has no usable {}.", names.join(", ")),
            table: None,
        }
    }

    pub(super) fn html(&self, number: usize) -> Markup {
        let notes: Vec<String> = {
            let mut seen: Vec<String> = Vec::new();
            for panel in self.columns.iter().flatten() {
                for note in &panel.drawing.notes {
                    let note =
                        if panel.name.is_empty() { note.clone() } else { format!("{}: {}", panel.name, lower(note)) };
                    if !seen.contains(&note) {
                        seen.push(note);
                    }
                }
            }
            seen
        };
        let arrangement = if self.columns.len() > 1 { "panels two" } else { "panels wide" };
        html! {
            figure id=(self.id) {
                h2 { (self.title) }
                @if !self.columns.is_empty() {
                    div class=(arrangement) {
                        @for column in &self.columns {
                            div {
                                @for panel in column {
                                    (PreEscaped(&panel.drawing.svg))
                                    @if !panel.below.is_empty() { p.ends { (panel.below) } }
                                }
                            }
                        }
                    }
                }
                figcaption {
                    b { "Figure " (number) }
                    @if let Some(paper) = self.paper { " (the paper’s " (paper) ")" }
                    b { ". " }
                    (self.caption)
                    @for note in notes { " " (note) }
                }
                @if let Some(table) = &self.table { (table_of(table)) }
            }
        }
    }
}

/// A sentence to stand after a colon.
fn lower(sentence: &str) -> String {
    let mut chars = sentence.chars();
    chars.next().map_or(String::new(), |first| first.to_lowercase().chain(chars).collect())
}

/// A stretch of the run, and what to call it.
#[derive(Clone)]
struct Window {
    name: &'static str,
    samples: Indices<usize>,
}

/// The recording, its instants and its stretches.
struct Run<'r> {
    report: &'r Report<'r>,
    time_s: &'r [f64],
    /// When the controller took the estimate.
    update_s: Option<f64>,
    /// Before and after the update, or the end of the run alone.
    windows: Vec<Window>,
}

impl<'r> Run<'r> {
    fn new(report: &'r Report<'r>) -> Run<'r> {
        let time_s = report.recording.time_s.as_slice();
        let mut run = Run { report, time_s, update_s: None, windows: Vec::new() };
        let used: Vec<&[f64]> = (1..=3).filter_map(|k| run.get(&format!("controller.lambdaUsed[{k}]"))).collect();
        // What the controller did counts for more than what was planned: it may have had to wait for a valid estimate.
        run.update_s = if used.is_empty() {
            report.update_s
        } else {
            let changed = |values: &&[f64]| values.iter().position(|value| *value != values[0]);
            used.iter().filter_map(changed).min().map(|index| time_s[index])
        };
        let end = time_s.len();
        let update =
            run.update_s.map(|at| time_s.partition_point(|t| *t < at)).filter(|index| (1..end).contains(index));
        run.update_s = update.map(|index| time_s[index]);
        let last = run.revolutions_before(end, REVOLUTIONS);
        run.windows = match update {
            Some(update) => vec![
                Window { name: "Before the update", samples: run.revolutions_before(update, REVOLUTIONS) },
                // Where the run ends soon after the update, the stretch after it is shorter, not mixed.
                Window { name: "After the update", samples: last.start.max(update)..end },
            ],
            None => vec![Window { name: "End of the run", samples: last }],
        };
        run
    }

    /// A column, as far as it goes with the instants.
    fn get(&self, name: &str) -> Option<&'r [f64]> {
        let values = self.report.recording.get(name)?;
        Some(&values[..values.len().min(self.time_s.len())]).filter(|values| !values.is_empty())
    }

    /// Columns that only serve together.
    fn get3(&self, pattern: impl Fn(usize) -> String) -> Option<[&'r [f64]; 3]> {
        Some([self.get(&pattern(1))?, self.get(&pattern(2))?, self.get(&pattern(3))?])
    }

    /// The samples of so many revolutions that end before sample `end`.
    fn revolutions_before(&self, end: usize, revolutions: f64) -> Indices<usize> {
        let end = end.min(self.time_s.len());
        let Some(last) = end.checked_sub(1) else { return 0..0 };
        let by_time = || self.time_s[..end].partition_point(|t| *t < self.time_s[last] - WITHOUT_ANGLE_S)..end;
        let Some(theta) = self.get("plant.theta").filter(|theta| theta.len() >= end) else { return by_time() };
        let mut turned = 0.0;
        for index in (0..last).rev() {
            // The angle may be given within one turn.
            let step = theta[index + 1] - theta[index];
            turned += step - TAU * (step / TAU).round();
            if turned.abs() >= TAU * revolutions * (1.0 - 1e-9) {
                return index..end;
            }
        }
        if turned.abs() > TAU { 0..end } else { by_time() }
    }

    /// Some revolutions with the update in their middle, or those at the end.
    fn around_update(&self) -> Window {
        match self.windows.as_slice() {
            [before, _] => {
                let width = before.samples.len();
                let end = (before.samples.end + width).min(self.time_s.len());
                Window { name: "Around the update", samples: before.samples.start..end }
            }
            _ => Window {
                name: "End of the run",
                samples: self.revolutions_before(self.time_s.len(), 2.0 * REVOLUTIONS),
            },
        }
    }

    fn whole(&self) -> Window {
        Window { name: "", samples: 0..self.time_s.len() }
    }

    fn time_unit(&self, window: &Window) -> Unit {
        let instants = part(self.time_s, window);
        let span = instants.last().unwrap_or(&0.0) - instants.first().unwrap_or(&0.0);
        if span < 0.2 { Unit::MILLISECOND } else { Unit::SECOND }
    }

    fn time_axis(&self, window: &Window, named: bool) -> Axis {
        let range = Range::hull(part(self.time_s, window)).filter(|range| range.min < range.max);
        Axis::new(if named { "time" } else { "" }, self.time_unit(window)).from_to(range)
    }

    fn line(&self, name: &str, values: &'r [f64], window: &Window, colour: Colour) -> Line<'r> {
        Line::new(name, part(self.time_s, window), part(values, window), colour)
    }

    fn update_mark(&self) -> Vec<Mark> {
        let mark = |at| Mark::new(at, &format!("update at {}", instant(at)), Colour::Grey);
        self.update_s.map(mark).into_iter().collect()
    }
}

/// The samples of `values` in the window, as far as there are any.
fn part<'v>(values: &'v [f64], window: &Window) -> &'v [f64] {
    let end = window.samples.end.min(values.len());
    &values[window.samples.start.min(end)..end]
}

/// An instant to the tenth of a millisecond, without zeros at the end.
pub(super) fn instant(at_s: f64) -> String {
    format!("{} s", (at_s * 1e4).round() / 1e4)
}

fn largest(values: &[f64]) -> Option<f64> {
    Range::hull(values).map(|range| range.max.max(-range.min))
}

/// `before → after` of a number taken in every window, or the one number.
fn over_windows(run: &Run, unit: Unit, number: impl Fn(&Window) -> Option<f64>) -> String {
    let show = |window| number(window).map_or("unknown".into(), |value| unit.show(value, 3));
    match run.windows.as_slice() {
        [before, after] => format!("{} before and {} after the update", show(before), show(after)),
        [only] => format!("{} at the end of the run", show(only)),
        _ => "unknown".into(),
    }
}

/// Every figure of the page, in order.
pub(super) fn all(report: &Report) -> Vec<Figure> {
    let run = Run::new(report);
    let mut figures = Vec::new();
    figures.extend(estimates(&run));
    figures.extend(estimate_errors(&run));
    figures.extend(condition(&run));
    figures.push(whole_run(&run));
    figures.push(currents(&run));
    figures.push(axis(&run, Direction { letter: "y", name: "Y", id: "axis-y", paper: "Figs. 7 and 9" }));
    figures.push(axis(&run, Direction { letter: "z", name: "Z", id: "axis-z", paper: "Figs. 8 and 10" }));
    figures.push(orbit(&run));
    figures.extend(clearance(&run));
    figures.extend(sensitivity(&run));
    for figure in &mut figures {
        figure.paper = figure.paper.filter(|_| report.paper);
    }
    figures
}

/// λ̂ of one method, if its columns are there.
struct Estimate<'r> {
    label: &'r str,
    lambda: [&'r [f64]; 3],
    valid: Option<&'r [f64]>,
}

fn estimates_of<'r>(run: &Run<'r>) -> Vec<Estimate<'r>> {
    let column = |element: &str, k: usize| format!("{element}.lambdaHat[{k}]");
    let of = |method: &'r super::Method| {
        let lambda = run.get3(|k| column(&method.element, k))?;
        Some(Estimate { label: &method.label, lambda, valid: run.get(&format!("{}.valid", method.element)) })
    };
    run.report.methods.iter().filter_map(of).collect()
}

/// Since when an estimator calls its estimate valid, and whether it ever took that back.
fn validity(run: &Run, valid: &[f64]) -> String {
    match valid.iter().position(|valid| *valid > 0.5) {
        None => "\nNever valid by its own account".into(),
        Some(first) => {
            let rest = &valid[first..];
            let invalid = rest.iter().filter(|valid| **valid <= 0.5).count();
            let share = 100.0 * invalid as f64 / rest.len() as f64;
            let but = if invalid > 0 { format!(", but for {share:.1} % of the time after") } else { String::new() };
            format!("\nValid by its own account from {}{but}", instant(run.time_s[first]))
        }
    }
}

/// One plot per method, side by side in rows of two; a single one takes the whole width.
fn side_by_side(panels: Vec<Panel>) -> Vec<Vec<Panel>> {
    panels.into_iter().map(|panel| vec![panel]).collect()
}

fn method_size(count: usize) -> (f64, f64) {
    if count > 1 { (HALF_PX, 270.0) } else { (WIDE_PX, 300.0) }
}

fn estimates(run: &Run) -> Option<Figure> {
    let (id, title, paper) = ("lambda", "Estimates of the magnet constants", Some("Fig. 2"));
    if run.report.methods.is_empty() {
        return None;
    }
    let estimates = estimates_of(run);
    if estimates.is_empty() {
        return Some(Figure::missing(id, title, paper, &["….lambdaHat[1..3]"]));
    }
    let truth = run.report.truth;
    // With the truth known the axis reaches from zero over the truth and the first guesses: what leaves it has diverged.
    let firsts: Vec<f64> = estimates.iter().flat_map(|estimate| estimate.lambda.map(|values| values[0])).collect();
    let range = match truth {
        Some(truth) => {
            Range::hull(truth.iter().chain(&firsts).chain([&0.0])).map(|range| Range::new(range.min, 1.12 * range.max))
        }
        None => {
            let later =
                estimates.iter().flat_map(|estimate| estimate.lambda).flat_map(|values| &values[values.len() / 2..]);
            Range::of_axis(later.chain(&firsts))
        }
    };
    let window = run.whole();
    let panels = estimates
        .iter()
        .map(|estimate| {
            let mut plot = Plot::new(
                estimate.label,
                run.time_axis(&window, true),
                Axis::new("λ̂", Unit::LAMBDA).from_to(range),
                method_size(estimates.len()),
            );
            for k in 0..3 {
                let colour = Colour::MAGNETS[k];
                plot.lines.push(run.line(&format!("λ̂{}", INDEX[k]), estimate.lambda[k], &window, colour));
                if let Some(truth) = truth {
                    plot.values.push(Mark::new(truth[k], &format!("λ{} = {:.3}", INDEX[k], truth[k] * 1e6), colour));
                }
            }
            plot.instants = run.update_mark();
            let ends = estimate.lambda.map(|values| values[values.len() - 1]);
            let list = |each: &dyn Fn(usize) -> String| [0, 1, 2].map(each).join(", ");
            let mut below = format!("At the end ({})·10⁻⁶", list(&|k| significant_lambda(ends[k])));
            if let Some(truth) = truth {
                let error = |k: usize| signed_percent(ends[k] / truth[k] - 1.0);
                below += &format!("\nErrors ({}) %", list(&error));
            }
            below += &estimate.valid.map_or(String::new(), |valid| validity(run, valid));
            Panel { below, ..Panel::from(plot) }
        })
        .collect();
    let mut caption =
        String::from("The estimates against time, all methods fed with the same samples and drawn on one scale.");
    if truth.is_some() {
        caption += " Dotted: the true values.";
    }
    if run.report.paper {
        caption += " The paper ends at (1.786, 2.072, 2.199)·10⁻⁶ in less than 0.1 s.";
    }
    Some(Figure { id, title: title.into(), paper, columns: side_by_side(panels), caption, table: None })
}

fn significant_lambda(value: f64) -> String {
    if value.is_finite() && value.abs() < 1e-3 {
        format!("{:.3}", value * 1e6).replace('-', "−")
    } else {
        crate::app::plot::significant(value * 1e6, 3)
    }
}

fn signed_percent(ratio: f64) -> String {
    let percent = ratio * 100.0;
    match percent.abs() {
        size if !size.is_finite() || size >= 1e5 => crate::app::plot::significant(percent, 2),
        size if size >= 10.0 => format!("{percent:+.0}").replace('-', "−"),
        size if size >= 1.0 => format!("{percent:+.1}").replace('-', "−"),
        size if size >= 0.1 => format!("{percent:+.2}").replace('-', "−"),
        _ => format!("{percent:+.3}").replace('-', "−"),
    }
}

/// The largest value of each sample and the `count` that follow; what is not finite does not count.
fn largest_to_come(values: &[f64], count: usize) -> Vec<f64> {
    // Indices of samples not surpassed by a later one within reach, the largest first.
    let mut rivals: VecDeque<usize> = VecDeque::new();
    let mut largest = vec![f64::NAN; values.len()];
    for index in (0..values.len()).rev() {
        if values[index].is_finite() {
            while rivals.back().is_some_and(|&rival| values[rival] <= values[index]) {
                rivals.pop_back();
            }
            rivals.push_back(index);
        }
        while rivals.front().is_some_and(|&rival| rival > index + count) {
            rivals.pop_front();
        }
        largest[index] = rivals.front().map_or(f64::NAN, |&rival| values[rival]);
    }
    largest
}

fn estimate_errors(run: &Run) -> Option<Figure> {
    let truth = run.report.truth.filter(|truth| truth.iter().all(|lambda| lambda.is_finite() && *lambda != 0.0))?;
    let estimates = estimates_of(run);
    let revolution = run.revolutions_before(run.time_s.len(), 1.0).len();
    let error = |value: &f64, truth: f64| (value / truth - 1.0).abs();
    let errors: Vec<[Vec<f64>; 3]> = estimates
        .iter()
        .map(|estimate| {
            [0, 1, 2].map(|k| {
                largest_to_come(
                    &estimate.lambda[k].iter().map(|value| error(value, truth[k])).collect::<Vec<f64>>(),
                    revolution,
                )
            })
        })
        .collect();
    let mut pool: Vec<f64> = errors.iter().flatten().flatten().copied().filter(|error| *error > 0.0).collect();
    pool.retain(|error| error.is_finite());
    pool.sort_by(f64::total_cmp);
    let least = *pool.get(pool.len() / 50)?;
    let range = Range::new(10f64.powf(least.log10().floor()).clamp(1e-6, 1e-2), 3.0);
    let window = run.whole();
    let panels = estimates
        .iter()
        .zip(errors)
        .map(|(estimate, errors)| {
            let mut plot = Plot::new(
                estimate.label,
                run.time_axis(&window, true),
                Axis::new("|λ̂ − λ|/λ", Unit::PERCENT).in_decades().from_to(Some(range)),
                method_size(estimates.len()),
            );
            for (k, error) in errors.into_iter().enumerate() {
                // The last revolution has no full one to follow.
                let known = error.len() - revolution.min(error.len() / 2);
                let instants = &run.time_s[..known];
                let error = error[..known].to_vec();
                plot.lines.push(Line::new(&format!("λ̂{}", INDEX[k]), instants, error, Colour::MAGNETS[k]));
            }
            if run.report.paper {
                plot.values.push(Mark::new(PAPER_ERROR, "paper 3.6 %", Colour::Ink));
            }
            plot.instants = run.update_mark();
            Panel::from(plot)
        })
        .collect();
    Some(Figure {
        id: "lambda-error",
        title: "Errors of the estimates".into(),
        paper: None,
        columns: side_by_side(panels),
        caption: "The relative errors in decades, at each instant the largest within the revolution that follows: where a line \
                  falls below a level, the error stays below it for a revolution at least."
            .into(),
        table: None,
    })
}

fn condition(run: &Run) -> Option<Figure> {
    let window = run.whole();
    let colours = [Colour::Blue, Colour::Vermillion, Colour::Green, Colour::Purple];
    let mut plot = Plot::new(
        "",
        run.time_axis(&window, true),
        Axis::new("condition number", Unit::ONE).in_decades(),
        (WIDE_PX, 220.0),
    );
    for (index, method) in run.report.methods.iter().enumerate() {
        if let Some(values) = run.get(&format!("{}.condition", method.element)) {
            plot.lines.push(run.line(&method.label, values, &window, colours[index % colours.len()]));
        }
    }
    plot.instants = run.update_mark();
    if plot.lines.is_empty() {
        return None;
    }
    Some(Figure {
        id: "condition",
        title: "How well the data determine the estimates".into(),
        paper: None,
        columns: vec![vec![plot.into()]],
        caption: "The condition number of the equations that are solved: by how much errors of the data may grow."
            .into(),
        table: None,
    })
}

/// The signals of one axis.
struct Signals<'r> {
    position: &'r [f64],
    reference: Option<&'r [f64]>,
    error: Vec<f64>,
    estimate: Option<&'r [f64]>,
    perturbation: Option<&'r [f64]>,
}

/// y or z.
#[derive(Clone, Copy)]
struct Direction {
    letter: &'static str,
    name: &'static str,
    id: &'static str,
    paper: &'static str,
}

fn signals<'r>(run: &Run<'r>, name: &str) -> Option<Signals<'r>> {
    let position = run.get(&format!("plant.{name}")).or_else(|| run.get(&format!("plant.{name}m")))?;
    let reference = run.get(&format!("controller.reference.{name}"));
    // The true error where it can be had: that of the controller is of the sample before, with the noise of the sensor.
    let error = match (reference, run.get(&format!("controller.e{name}"))) {
        (Some(reference), _) => {
            position.iter().zip(reference).map(|(position, reference)| position - reference).collect()
        }
        (None, Some(error)) => error.to_vec(),
        (None, None) => Vec::new(),
    };
    let estimate = run.get(&format!("controller.p{name}Hat"));
    Some(Signals { position, reference, error, estimate, perturbation: run.get(&format!("plant.perturbation.{name}")) })
}

/// Position, error and perturbation of one axis below each other, in one window.
fn stack(
    run: &Run,
    signals: &Signals,
    letter: &str,
    window: &Window,
    width: f64,
    ranges: [Option<Range>; 3],
) -> Vec<Panel> {
    let heading = match (window.name, part(run.time_s, window)) {
        ("", _) | (_, []) => String::new(),
        (name, instants) => format!("{name}: {:.1} to {:.1} ms", instants[0] * 1e3, instants[instants.len() - 1] * 1e3),
    };
    let mut position = Plot::new(
        &heading,
        run.time_axis(window, false),
        Axis::new(letter, Unit::MICROMETRE).from_to(ranges[0]),
        (width, 235.0),
    );
    position.lines.push(Line::new("position", part(run.time_s, window), part(signals.position, window), Colour::Blue));
    if let Some(reference) = signals.reference {
        let line = Line::new("reference", part(run.time_s, window), part(reference, window), Colour::Ink);
        position.lines.push(line.dashed());
    }
    let mut error = Plot::new(
        "",
        run.time_axis(window, false),
        Axis::new(&format!("error of {letter}"), Unit::MICROMETRE).from_to(ranges[1]),
        (width, 170.0),
    );
    if !signals.error.is_empty() {
        error.lines.push(Line::new("", part(run.time_s, window), part(&signals.error, window), Colour::Vermillion));
    }
    let mut perturbation = Plot::new(
        "",
        run.time_axis(window, true),
        Axis::new("perturbation", Unit::NEWTON).from_to(ranges[2]),
        (width, 215.0),
    );
    if let Some(estimate) = signals.estimate {
        perturbation.lines.push(Line::new(
            "estimated by the observer",
            part(run.time_s, window),
            part(estimate, window),
            Colour::Green,
        ));
    }
    if let Some(truth) = signals.perturbation {
        let line = Line::new("true", part(run.time_s, window), part(truth, window), Colour::Ink);
        perturbation.lines.push(line.dashed());
    }
    let mut plots = vec![position, error, perturbation];
    for plot in &mut plots {
        // Near the edge of a stretch that ends at the update its mark would say nothing.
        if window.name.is_empty() {
            plot.instants = run.update_mark();
        }
    }
    plots.into_iter().map(Panel::from).collect()
}

/// Ranges of position, error and perturbation that serve all the windows.
fn shared(signals: &Signals, windows: &[Window]) -> [Option<Range>; 3] {
    let over = |columns: &[Option<&[f64]>]| {
        let values: Vec<f64> = windows
            .iter()
            .flat_map(|window| columns.iter().flatten().flat_map(|values| part(values, window).iter().copied()))
            .collect();
        Range::of_axis(&values)
    };
    [
        over(&[Some(signals.position), signals.reference]),
        over(&[Some(&signals.error)]),
        over(&[signals.estimate, signals.perturbation]),
    ]
}

/// What the windows of one axis show, in numbers.
fn in_numbers(run: &Run, signals: &Signals, letter: &str) -> String {
    let mut text = String::new();
    if !signals.error.is_empty() {
        let error = over_windows(run, Unit::MICROMETRE, |window| largest(part(&signals.error, window)));
        text += &format!(" Largest error of {letter}: {error}.");
    }
    if let Some(estimate) = signals.estimate {
        let swing = |window: &Window| Range::hull(part(estimate, window)).map(|range| range.max - range.min);
        text += &format!(" Swing of the estimated perturbation: {}.", over_windows(run, Unit::NEWTON, swing));
        if let Some(truth) = signals.perturbation {
            let off = |window: &Window| {
                let pairs = part(estimate, window).iter().zip(part(truth, window));
                largest(&pairs.map(|(estimate, truth)| estimate - truth).collect::<Vec<f64>>())
            };
            text += &format!(" Largest distance from the true one: {}.", over_windows(run, Unit::NEWTON, off));
        }
    }
    text
}

fn whole_run(run: &Run) -> Figure {
    let (id, title, paper) = ("tracking", "Tracking of the z axis over the run", Some("Fig. 3"));
    let Some(signals) = signals(run, "Z") else { return Figure::missing(id, title, paper, &["plant.Z"]) };
    let window = run.whole();
    let ranges = shared(&signals, std::slice::from_ref(&window));
    let columns = vec![stack(run, &signals, "z", &window, WIDE_PX, ranges)];
    let mut caption = String::from("Position, its error, and the perturbation that the observer sees.");
    caption += match (run.update_s, run.report.update_s) {
        (Some(_), _) => {
            " A wrong λ is a perturbation to the observer: at the update its estimate falls back to what really acts."
        }
        (None, Some(_)) => " The controller did not take an estimate in this run.",
        (None, None) => "",
    };
    caption += &in_numbers(run, &signals, "z");
    Figure { id, title: title.into(), paper, columns, caption, table: None }
}

fn axis(run: &Run, direction: Direction) -> Figure {
    let Direction { letter, name, id, paper } = direction;
    let compared = run.windows.len() > 1;
    let title =
        format!("The {letter} axis {}", if compared { "before and after the update" } else { "at the end of the run" });
    let Some(signals) = signals(run, name) else {
        return Figure::missing(id, &title, Some(paper), &[&format!("plant.{name}")]);
    };
    let ranges = shared(&signals, &run.windows);
    let width = if compared { HALF_PX } else { WIDE_PX };
    let columns = run.windows.iter().map(|window| stack(run, &signals, letter, window, width, ranges)).collect();
    let mut caption = String::from(if compared {
        "The last two revolutions before the update beside the last two of the run, on the same scales."
    } else {
        "The last two revolutions."
    });
    caption += &in_numbers(run, &signals, letter);
    Figure { id, title, paper: Some(paper), columns, caption, table: None }
}

fn currents(run: &Run) -> Figure {
    let (id, paper) = ("currents", Some("Fig. 5"));
    let measured = run.get3(|k| format!("plant.im[{k}]"));
    let title = "Currents of the three magnets";
    let Some(currents) = measured.or_else(|| run.get3(|k| format!("controller.i[{k}]"))) else {
        return Figure::missing(id, title, paper, &["plant.im[1..3]"]);
    };
    let panel = |title: &str, window: &Window, height_px: f64| {
        let axes = (run.time_axis(window, true), Axis::new("current", Unit::AMPERE));
        let mut plot = Plot::new(title, axes.0, axes.1, (WIDE_PX, height_px));
        for k in 0..3 {
            plot.lines.push(run.line(&format!("i{}", INDEX[k]), currents[k], window, Colour::MAGNETS[k]));
        }
        plot.instants = run.update_mark();
        Panel::from(plot)
    };
    // The paper shows the revolutions around the update; what else happens in a run is seen in the whole of it.
    let (around, whole) = (run.around_update(), run.whole());
    let mut panels = vec![panel(around.name, &around, 300.0)];
    if around.samples != whole.samples {
        panels.push(panel("All of the run", &whole, 220.0));
    }
    let mut head = vec!["".to_string()];
    for window in &run.windows {
        // Before, after, or neither.
        let when = window.name.split_once(" the update").map_or("", |(when, _)| when);
        head.extend(
            [format!("{when}: least"), format!("{when}: greatest")]
                .map(|cell| cell.trim_start_matches(": ").to_lowercase()),
        );
    }
    let row = |k: usize| {
        let mut row = vec![format!("i{}", INDEX[k])];
        for window in &run.windows {
            let range = Range::hull(part(currents[k], window));
            row.push(range.map_or("–".into(), |range| Unit::AMPERE.show(range.min, 3)));
            row.push(range.map_or("–".into(), |range| Unit::AMPERE.show(range.max, 3)));
        }
        row
    };
    let table = Table { head, rows: (0..3).map(row).collect(), ..Table::default() };
    let what = if measured.is_some() { "The measured currents" } else { "The commanded currents" };
    let when =
        if run.windows.len() > 1 { "two revolutions before and after the update" } else { "at the end of the run" };
    let below =
        if run.windows.len() > 1 { " Below: the last two revolutions before the update and of the run." } else { "" };
    let caption = format!("{what}, {when}. The magnets only pull: the sign of a current has no meaning.{below}");
    Figure { id, title: title.into(), paper, columns: vec![panels], caption, table: Some(table) }
}

fn orbit(run: &Run) -> Figure {
    let (id, title, paper) = ("orbit", "Orbit of the rotor", Some("Figs. 11 and 12"));
    let (Some(y), Some(z)) = (signals(run, "Y"), signals(run, "Z")) else {
        return Figure::missing(id, title, paper, &["plant.Y", "plant.Z"]);
    };
    let (error_y, error_z) = (&y.error, &z.error);
    let reference = y.reference.zip(z.reference);

    // One magnification for all the windows: the largest error is to be a third of the orbit at most.
    let over = |values: &[f64]| -> Vec<f64> {
        run.windows.iter().flat_map(|window| part(values, window).iter().copied()).collect()
    };
    let error = largest(&over(error_y)).unwrap_or(0.0).max(largest(&over(error_z)).unwrap_or(0.0));
    let radius = reference.map_or(0.0, |(y, z)| largest(&over(y)).unwrap_or(0.0).max(largest(&over(z)).unwrap_or(0.0)));
    let magnified = [200.0, 100.0, 50.0, 20.0, 10.0, 5.0, 2.0]
        .into_iter()
        .find(|times| error > 0.0 && times * error < 0.34 * radius);

    let size = if run.windows.len() > 1 { (HALF_PX, 500.0) } else { (WIDE_PX, 560.0) };
    let path = |along: &[f64], error: &[f64], window: &Window, times: f64| -> Vec<f64> {
        part(along, window).iter().zip(part(error, window)).map(|(at, error)| at + times * error).collect()
    };
    let mut orbits: Vec<Plot> = Vec::new();
    let mut errors: Vec<Plot> = Vec::new();
    for window in &run.windows {
        let axis = |name| Axis::new(name, Unit::MICROMETRE);
        let mut plot = Plot::new(window.name, axis("y"), axis("z"), size);
        plot.equal = true;
        if let (Some((ry, rz)), Some(times)) = (reference, magnified) {
            let (along, up) = (path(ry, error_y, window, times), path(rz, error_z, window, times));
            plot.lines.push(Line::new(&format!("error × {times}"), along, up, Colour::Vermillion));
        }
        plot.lines.push(Line::new("path", part(y.position, window), part(z.position, window), Colour::Blue));
        if let Some((ry, rz)) = reference {
            // Once around: a second turn would fill the gaps between the dashes.
            let start = run.revolutions_before(window.samples.end, 1.0).start.max(window.samples.start);
            let turn = Window { name: window.name, samples: start..window.samples.end };
            plot.lines.push(Line::new("reference", part(ry, &turn), part(rz, &turn), Colour::Ink).dashed());
        }
        orbits.push(plot);

        if !(error_y.is_empty() || error_z.is_empty()) {
            let mut plot = Plot::new("", axis("error of y"), axis("error of z"), (size.0, 400.0));
            plot.equal = true;
            plot.lines.push(Line::new("error", part(error_y, window), part(error_z, window), Colour::Vermillion));
            errors.push(plot);
        }
    }
    share_scales(&mut orbits);
    if run.report.paper {
        for (radius, name) in ASKED_M {
            // A limit far outside would shrink the errors to a point.
            if radius < 3.0 * error.max(0.5e-6) {
                let circle =
                    |of: fn(f64) -> f64| (0..=120).map(|i| radius * of(TAU * f64::from(i) / 120.0)).collect::<Vec<_>>();
                for plot in &mut errors {
                    plot.lines.insert(0, Line::new(name, circle(f64::cos), circle(f64::sin), Colour::Grey).dashed());
                }
            }
        }
    }
    share_scales(&mut errors);

    let mut columns: Vec<Vec<Panel>> = orbits.into_iter().map(|plot| vec![plot.into()]).collect();
    for (column, plot) in columns.iter_mut().zip(errors) {
        column.push(plot.into());
    }
    let mut caption = String::from("The path in the plane of the bearing, both axes on one scale.");
    if let Some(times) = magnified {
        caption += &format!(
            " Path and reference all but coincide at this scale, so the error is drawn once more, {times} times as large, \
             out from the reference; below it stands alone."
        );
    }
    let length = |window: &Window| {
        let pairs = part(error_y, window).iter().zip(part(error_z, window));
        largest(&pairs.map(|(y, z)| y.hypot(*z)).collect::<Vec<f64>>())
    };
    if !(error_y.is_empty() || error_z.is_empty()) {
        caption += &format!(" Largest distance from the reference: {}.", over_windows(run, Unit::MICROMETRE, length));
    }
    if run.report.paper {
        caption += " The paper states about 5 µm for its experiment on a non-circular path, and that up to 1000 rpm the \
                    industry asks for less than 1 µm on circular paths and 3 µm on others.";
    }
    Figure { id, title: title.into(), paper, columns, caption, table: None }
}

/// The orbit of the whole run within the clearance of the backup bearing.
fn clearance(run: &Run) -> Option<Figure> {
    let clearance_m = run.report.clearance_m?;
    let (y, z) = (run.get("plant.Y")?, run.get("plant.Z")?);
    let circle = |radius: f64, of: fn(f64) -> f64| -> Vec<f64> {
        (0..=180).map(|i| radius * of(TAU * f64::from(i) / 180.0)).collect()
    };
    let axis = |name| Axis::new(name, Unit::MICROMETRE);
    let mut plot = Plot::new("", axis("y"), axis("z"), (HALF_PX, 500.0));
    plot.equal = true;
    let ring = Line::new("clearance", circle(clearance_m, f64::cos), circle(clearance_m, f64::sin), Colour::Ink);
    plot.lines.push(Line::new("rotor", y, z, Colour::Blue));
    plot.lines.push(ring.dashed());
    let mut columns = vec![vec![plot.into()]];
    let radius: Vec<f64> = y.iter().zip(z).map(|(y, z)| y.hypot(*z)).collect();
    let window = run.whole();
    let mut distance = Plot::new(
        "",
        run.time_axis(&window, true),
        Axis::new("distance from the centre", Unit::MICROMETRE),
        (HALF_PX, 250.0),
    );
    distance.lines.push(Line::new("rotor", part(run.time_s, &window), part(&radius, &window), Colour::Blue));
    distance.values.push(Mark::new(clearance_m, "clearance", Colour::Ink));
    distance.instants = run.update_mark();
    let mut beside: Vec<Panel> = vec![distance.into()];
    let contact = run.get("plant.touchdown.contact").unwrap_or(&[]);
    let touched = contact.iter().filter(|contact| **contact > 0.5).count();
    let force = run.get("plant.touchdown.FY").zip(run.get("plant.touchdown.FZ")).filter(|_| touched > 0);
    let mut caption = String::from("The rotor in the clearance of the backup bearing, all of the run.");
    if let Some((force_y, force_z)) = force {
        let push: Vec<f64> = force_y.iter().zip(force_z).map(|(y, z)| y.hypot(*z)).collect();
        // The blows are short, and they are what there is to see.
        let range = Range::hull(&push).map(|range| range.with_air(0.05));
        let axis = Axis::new("push of the backup bearing", Unit::NEWTON).from_to(range);
        let mut plot = Plot::new("", run.time_axis(&window, true), axis, (HALF_PX, 250.0));
        plot.lines.push(Line::new("push", part(run.time_s, &window), part(&push, &window), Colour::Vermillion));
        beside.push(plot.into());
        let first = contact.iter().position(|contact| *contact > 0.5).unwrap_or(0);
        let last = contact.iter().rposition(|contact| *contact > 0.5).unwrap_or(0);
        caption += &format!(
            " It is touched between {} and {}, and pushes with {} at most at the instants recorded.",
            instant(run.time_s[first]),
            instant(run.time_s[last]),
            Unit::NEWTON.show(largest(&push).unwrap_or(0.0), 3)
        );
    } else {
        caption += " The backup bearing is never touched.";
    }
    columns.push(beside);
    Some(Figure { id: "clearance", title: "The clearance".into(), paper: None, columns, caption, table: None })
}

/// The sensitivity functions of both axes, before and after the update.
fn sensitivity(run: &Run) -> Option<Figure> {
    let all = &run.report.sensitivities;
    let drawn: Vec<_> = all.iter().filter(|one| !one.sweep.is_empty()).collect();
    let missing: Vec<&String> = all.iter().filter_map(|one| one.missing.as_ref()).collect();
    if drawn.is_empty() && missing.is_empty() {
        return None;
    }
    let hertz = Unit { name: "Hz", factor: 1.0 / TAU };
    let peak = drawn.iter().flat_map(|one| &one.sweep).flat_map(|point| [point[1], point[2]]).fold(0.0, f64::max);
    let columns = drawn
        .iter()
        .map(|one| {
            let title = match one.name.as_str() {
                "before" => "Before the update",
                "after" => "After the update",
                _ => "",
            };
            let width = if drawn.len() > 1 { HALF_PX } else { WIDE_PX };
            let omegas: Vec<f64> = one.sweep.iter().map(|point| point[0]).collect();
            let ends = Range::hull(&omegas);
            let mut plot = Plot::new(
                title,
                Axis::new("frequency", hertz).in_decades().from_to(ends),
                Axis::new("|S|", Unit::ONE).from_to(Some(Range::new(0.0, 5.3f64.max(1.1 * peak)))),
                (width, 330.0),
            );
            for (axis, (name, colour)) in [("y", Colour::Blue), ("z", Colour::Vermillion)].into_iter().enumerate() {
                let column =
                    |points: &[[f64; 3]], index: usize| points.iter().map(|point| point[index]).collect::<Vec<_>>();
                plot.lines.push(Line::new(name, omegas.clone(), column(&one.sweep, 1 + axis), colour));
                // Crosses at the frequencies injected.
                for [omega, value] in one.injected.iter().map(|point| [point[0], point[1 + axis]]) {
                    let wide = 1.04;
                    let across = Line::new("", vec![omega / wide, omega * wide], vec![value, value], Colour::Ink);
                    let up =
                        Line::new("", vec![omega, omega], vec![(value - 0.08).max(0.0), value + 0.08], Colour::Ink);
                    plot.lines.extend([across, up]);
                }
            }
            for (limit, zone) in crate::model::sensitivity::ZONES {
                plot.values.push(Mark::new(limit, &format!("{zone} below"), Colour::Grey));
            }
            vec![plot.into()]
        })
        .collect();
    let mut caption = String::from(
        "By how much an error of a position sensor appears in its reading, with the rotor at rest in the centre under the          static load: lines from the linearised loop, crosses from a sine injected in the time simulation. The zones are          those of ISO 14839-3.",
    );
    for why in missing {
        caption += &format!(" Not drawn: {why}.");
    }
    let title = "Sensitivity function of each axis".into();
    Some(Figure { id: "sensitivity", title, paper: None, columns, caption, table: None })
}

/// Gives all the plots the ranges that hold the data of each.
fn share_scales(plots: &mut [Plot]) {
    let all = |pick: fn(&Line) -> Vec<f64>| -> Option<Range> {
        let values: Vec<f64> = plots.iter().flat_map(|plot| plot.lines.iter().flat_map(pick)).collect();
        Range::of_axis(&values)
    };
    let (x, y) = (all(|line| line.x.to_vec()), all(|line| line.y.to_vec()));
    for plot in plots {
        plot.x.range = x;
        plot.y.range = y;
    }
}
