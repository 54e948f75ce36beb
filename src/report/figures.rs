//! The figures of the report, each drawn from the columns that it needs.

use std::f64::consts::TAU;

use maud::{Markup, html};
use serde_json::{Value as Json, json};

use super::experiment::Paper;
use super::{title_of, titled};
use crate::machine::Bearing;
use crate::report::evaluation::{self, Axis, Sensitivities, Stretch, lengths};
use crate::report::plot::{self, Line, Plot, PlotUnit, colour};
use crate::simulation::{Recording, Scenario};
use crate::studies::sensitivity::ZONES;

/// Maximum number of animation frames; the paper's run has 4000, 200 per revolution.
const FRAMES: usize = 6000;
/// Tracking errors that industry requires, in m, on circular and other trajectories (introduction of the paper).
const REQUIRED_M: [(f64, &str); 2] = [(1e-6, "1 µm, for circles"), (3e-6, "3 µm, for other paths")];
/// Runs up to this length, in s, have a time axis in milliseconds.
const SHORT_S: f64 = 2.0;
/// Subscripts of the magnets of a bearing.
pub(super) const INDEX: [&str; 4] = ["₁", "₂", "₃", "₄"];

/// A figure: plots and their caption.
pub(super) struct Figure {
    /// Anchor in the page.
    pub(super) id: &'static str,
    /// Heading.
    pub(super) title: String,
    /// The corresponding figures of the paper.
    paper: Option<&'static str>,
    /// Plots side by side.
    plots: Vec<Plot>,
    /// Caption.
    caption: String,
}

impl Figure {
    /// A figure from its anchor, heading, plots and caption; empty plots are left out.
    pub(super) fn new(id: &'static str, title: &str, mut plots: Vec<Plot>, caption: String) -> Figure {
        plots.retain(|plot| !plot.is_empty());
        Figure { id, title: title.into(), paper: None, plots, caption }
    }

    pub(super) fn html(&self, number: usize) -> Markup {
        html! {
            figure id=(self.id) {
                h2 { (self.title) }
                div class=(if self.plots.len() > 1 { "panels two" } else { "panels" }) {
                    @for plot in &self.plots {
                        div {
                            @if !plot.title.is_empty() { h3 { (plot.title) } }
                            (plot.html())
                        }
                    }
                }
                figcaption {
                    b { "Figure " (number) }
                    @if let Some(paper) = self.paper { " (" (paper) ")" }
                    b { ". " }
                    (self.caption)
                }
            }
        }
    }
}

/// Figures with a counterpart in the paper: in its simulation, and in its experiment.
const IN_PAPER: [(&str, [&str; 2]); 4] = [
    ("methods", ["the paper’s Fig. 2", "the paper’s Fig. 6"]),
    ("tracking", ["the paper’s Fig. 3; Figs. 7 to 10 are of its experiment", "the paper’s Figs. 7 to 10"]),
    ("currents", ["as Fig. 5 of the paper’s experiment", "the paper’s Fig. 5"]),
    ("orbit", ["as Figs. 11 and 12 of the paper’s experiment", "the paper’s Figs. 11 and 12"]),
];

/// A run, with all data that its figures show.
pub(super) struct Signals<'r> {
    pub scenario: &'r Scenario,
    pub recording: &'r Recording,
    /// The estimators to compare: each by its element and its label.
    pub methods: Vec<[String; 2]>,
    /// The element of the best one.
    pub best: &'r str,
    /// The true λ of all magnets, in N·m²/A².
    pub truth: Vec<f64>,
    /// Before and after the update, or only the end of the run.
    pub stretches: Vec<Stretch>,
    /// The signals along the axes of all readings.
    pub axes: Vec<Axis<'r>>,
    /// Events to mark, with their times in s.
    pub events: Vec<(f64, String)>,
    /// Sensitivity functions of the loop in the stretches.
    pub sensitivities: &'r Sensitivities,
    /// The section of the paper that the run reproduces; captions then name the paper's figures.
    pub paper: Option<Paper>,
}

impl<'r> Signals<'r> {
    /// Columns of the magnets of a bearing.
    fn of_magnets(&self, element: &str, bearing: &Bearing, name: &str) -> Vec<&'r [f64]> {
        let of_magnet = |k: usize| &self.recording[format!("{element}.{}{name}[{k}]", bearing.prefix)];
        (1..=bearing.magnets).map(of_magnet).collect()
    }

    /// A plot for each method and bearing, with a title that tells it apart.
    fn of_methods(&self, plot: impl Fn(&str, usize) -> Plot) -> Vec<Plot> {
        let bearings = self.scenario.machine.bearings;
        let of_method = |[element, label]: &[String; 2]| {
            let of_bearing = |(b, bearing): (usize, &Bearing)| {
                let title = match (self.methods.len(), bearings.len()) {
                    (1, 1) => String::new(),
                    (1, _) => title_of(bearing),
                    _ => titled(label, bearing),
                };
                plot(element, b).title(title)
            };
            bearings.iter().enumerate().map(of_bearing).collect::<Vec<_>>()
        };
        self.methods.iter().flat_map(of_method).collect()
    }

    /// Begin and end of the run, in s.
    fn ends_s(&self) -> [f64; 2] {
        let time_s = &self.recording.time_s;
        [time_s[0], time_s[time_s.len() - 1]]
    }

    /// A plot over time with the events of the run.
    fn plot(&self, quantity: &str, unit: PlotUnit) -> Plot {
        let mut plot = Plot::over_time(time_unit(self.ends_s()[1]), (quantity, unit)).range(0, self.ends_s());
        // Marks close together share a label, as two would overlap.
        let near_s = 0.03 * self.ends_s()[1];
        let mut events = self.events.clone();
        events.sort_by(|a, b| a.0.total_cmp(&b.0));
        for together in events.chunk_by(|a, b| b.0 - a.0 < near_s) {
            let labels: Vec<&str> = together.iter().map(|(_, label)| label.as_str()).collect();
            for (at, (at_s, _)) in together.iter().enumerate() {
                plot.instant(*at_s, if at == 0 { labels.join(", ") } else { String::new() }.as_str());
            }
        }
        plot
    }

    fn line(&self, plot: &mut Plot, line: Line, values: &[f64]) {
        plot.line(line, &self.recording.time_s, values);
    }

    /// Adds the line of a column.
    fn column(&self, plot: &mut Plot, line: Line, name: &str) {
        self.line(plot, line, &self.recording[name]);
    }

    /// Values at the equidistant frames of an animation.
    fn frames(&self, values: &[f64], factor: f64) -> Json {
        let every = self.recording.time_s.len().div_ceil(FRAMES).max(1);
        plot::packed(&values.iter().step_by(every).map(|value| value * factor).collect::<Vec<_>>())
    }

    /// A figure, or a sentence instead if all plots are empty.
    fn figure(&self, id: &'static str, title: &str, plots: Vec<Plot>, caption: &str) -> Figure {
        let mut figure = Figure::new(id, title, plots, caption.into());
        if figure.plots.is_empty() {
            figure.caption = "Not drawn: the recording has no usable signals for it.".into();
        }
        let in_paper = IN_PAPER.iter().find(|(same, _)| *same == id).zip(self.paper);
        Figure { paper: in_paper.map(|((_, figures), paper)| figures[paper as usize]), ..figure }
    }
}

/// The unit of the time axis of a run that ends at `end_s`.
pub(super) fn time_unit(end_s: f64) -> PlotUnit {
    if end_s <= SHORT_S { PlotUnit::MILLISECOND } else { PlotUnit::SECOND }
}

/// `values` where `show` is true, NaN elsewhere.
pub(super) fn where_shown(values: &[f64], show: impl Fn(usize) -> bool) -> Vec<f64> {
    values.iter().enumerate().map(|(at, value)| if show(at) { *value } else { f64::NAN }).collect()
}

/// λ̂ of an element at a bearing, by its index, with a band of two standard deviations; dotted where it is not valid.
fn lambda_plot(run: &Signals, element: &str, bearing: usize) -> Plot {
    let mut plot = run.plot("λ̂", PlotUnit::LAMBDA);
    let machine = run.scenario.machine;
    let (magnets, bearing) = (machine.magnets_of(bearing), &machine.bearings[bearing]);
    let is_used = |k: usize| run.scenario.uses(magnets.start + k);
    let truth = &run.truth[magnets.clone()];
    let of_magnets = |name: &str| run.of_magnets(element, bearing, name);
    let lambda = of_magnets("lambdaHat");
    // From zero to above true values and first guesses: estimates beyond have diverged, or have a very large standard deviation.
    let ends = lambda.iter().zip(truth).enumerate().filter(|(k, _)| is_used(*k));
    let ends = ends.flat_map(|(_, (values, truth))| [values[0], *truth]);
    let most = ends.filter(|value| value.is_finite()).fold(0.0, f64::max);
    plot = plot.range(1, [0.0, 1.15 * most]);
    let valid = &run.recording[format!("{element}.valid")];
    let is_valid = |at: usize| valid[at] > 0.5;
    let time_s = &run.recording.time_s;
    let rows: Vec<usize> = (0..time_s.len()).collect();
    for stretch in rows.chunk_by(|one, next| is_valid(*one) == is_valid(*next)).filter(|rows| !is_valid(rows[0])) {
        // Up to the next valid sample.
        plot.shade(time_s[stretch[0]], time_s[(stretch[0] + stretch.len()).min(rows.len() - 1)]);
    }
    let magnets = lambda.into_iter().zip(of_magnets("lambdaStdTotal")).enumerate();
    for (k, (lambda, std)) in magnets.filter(|(k, _)| is_used(*k)) {
        let group = format!("λ{}", k + 1);
        let shown = where_shown(lambda, is_valid);
        plot.band(&group, colour::BANDS[k], time_s, &shown, std);
        let name = format!("λ̂{}", INDEX[k]);
        // The dotted line extends to the first valid sample, where the solid one begins.
        let not_valid = |at: usize| !is_valid(at) || at > 0 && !is_valid(at - 1);
        let dotted = Line::new(&format!("{name} not valid"), colour::MAGNETS[k]).dotted().unlisted().group(&group);
        run.line(&mut plot, dotted, &where_shown(lambda, not_valid));
        run.line(&mut plot, Line::new(&name, colour::MAGNETS[k]).group(&group).width(2.0), &shown);
        let line = Line::new(&format!("true λ{}", INDEX[k]), colour::MAGNETS[k]).dashed().unlisted();
        plot.line(line.group(&group), &run.ends_s(), &[truth[k]; 2]);
    }
    plot
}

/// The animation, beside λ̂ of the best estimator at the first bearing.
pub(super) fn first(run: &Signals) -> Markup {
    let plot = lambda_plot(run, run.best, 0).height(460.0);
    let animation = animation(run);
    let bearings = run.scenario.machine.bearings;
    html! {
        div.first {
            @if let Some((id, data)) = &animation {
                div id=(id) class="animation" { (plot::data_element(data)) }
            }
            @if !plot.is_empty() {
                div #lambda {
                    (plot.html())
                    p.soft {
                        @if bearings.len() > 1 { (title_of(&bearings[0])) ": solid" } @else { "Solid" }
                        " where the estimate is valid, with a band of two standard deviations; dotted and shaded where it is not; \
                         dashed: the true value."
                        @if animation.is_some() { " Paler after the instant of the animation; click to go to another one." }
                    }
                }
            }
        }
    }
}

/// The animation and its data at equidistant instants, with the best estimator.
fn animation(run: &Signals) -> Option<(&'static str, Json)> {
    let of = |name: &str, factor: f64| run.frames(&run.recording[name], factor);
    let micro = |name: &str| of(name, 1e6);
    let frames = |columns: Vec<&[f64]>, factor: f64| -> Vec<Json> {
        columns.into_iter().map(|values| run.frames(values, factor)).collect()
    };
    let (scenario, machine) = (run.scenario, run.scenario.machine);
    let bearing = &machine.bearings[0];
    let mut data = json!({
        "t": run.frames(&run.recording.time_s, 1.0), "theta": of("plant.theta", 1.0), "valid": of(&format!("{}.valid", run.best), 1.0),
        "clearance": evaluation::clearance_m(scenario, bearing) * 1e6, "timeFactor": time_unit(run.ends_s()[1]).factor,
        "events": run.events,
    });
    let (id, own) = if machine.is_planar() {
        let alpha: Vec<_> = machine.of_magnets("alpha").iter().map(|name| scenario.real(name)).collect();
        let own = json!({
            "y": micro("plant.Y"), "z": micro("plant.Z"), "refY": micro("controller.reference.Y"),
            "refZ": micro("controller.reference.Z"), "force": frames(run.of_magnets("plant", bearing, "F"), 1.0),
            "lambda": frames(run.of_magnets(run.best, bearing, "lambdaHat"), 1e6),
            "contact": of("plant.touchdown.contact", 1.0), "alpha": alpha, "gap": scenario.real("s")? * 1e6,
        });
        ("orbit-animation", own)
    } else if !machine.tilts() {
        return None;
    } else {
        let both = |names: [&str; 2]| names.map(|name| scenario.real(name));
        let own = json!({
            "x": micro("plant.X"), "bearings": both(["A.position", "B.position"]),
            "sensors": both(["A.sensorPosition", "B.sensorPosition"]), "extent": both(["shaft.begin", "shaft.end"]),
            "orbits": [[micro("plant.A.Y"), micro("plant.A.Z")], [micro("plant.B.Y"), micro("plant.B.Z")]],
        });
        ("shaft-animation", own)
    };
    data.as_object_mut()?.extend(own.as_object()?.clone());
    Some((id, data))
}

/// Buttons that show the run or a stretch of it in all plots over time.
pub(super) fn views(run: &Signals) -> Markup {
    let of = |[from, to]: [f64; 2]| [from, to].map(|end| end * time_unit(run.ends_s()[1]).factor);
    let stretch =
        |stretch: &Stretch| (stretch.title, of([stretch.from, stretch.to - 1].map(|at| run.recording.time_s[at])));
    let views: Vec<_> =
        [("Whole run", of(run.ends_s()))].into_iter().chain(run.stretches.iter().map(stretch)).collect();
    html! {
        @if views.len() > 1 {
            div #views role="toolbar" aria-label="Time shown in all plots" {
                span.soft { "Time in all plots: " }
                @for (name, [from, to]) in &views {
                    button type="button" data-from=(from) data-to=(to) { (name) }
                }
            }
        }
    }
}

/// Every figure of the page, in order.
pub(super) fn all(run: &Signals) -> Vec<Figure> {
    let figures = [
        Some(estimates(run)),
        Some(errors(run)),
        condition(run),
        Some(tracking(run)),
        Some(currents(run)),
        orbit(run),
        Some(clearance(run)),
        unbalance(run),
        sensitivity(run),
    ];
    figures.into_iter().flatten().collect()
}

fn estimates(run: &Signals) -> Figure {
    let plots = run.of_methods(|element, bearing| lambda_plot(run, element, bearing));
    let shared = if run.methods.len() > 1 { "; all methods use the same samples" } else { "" };
    let caption =
        "Solid where valid, with a band of two standard deviations; dotted and shaded where not; dashed: the truth.";
    let in_paper = match run.paper {
        Some(Paper::Simulation) => " The paper ends at (1.786, 2.072, 2.199)·10⁻⁶ in less than 0.1 s.",
        Some(Paper::Experiment) => " The paper ends at (2.53, 2.04, 2.42)·10⁻⁶ after 0.2 s on its test bench.",
        None => "",
    };
    run.figure(
        "methods",
        "Estimates of the force constants",
        plots,
        &format!("Estimates over time{shared}. {caption}{in_paper}"),
    )
}

fn errors(run: &Signals) -> Figure {
    let machine = run.scenario.machine;
    // A function of the ratio of a column to the true λ, for each magnet of a bearing that is in use.
    let of_ratios = |element: &str, b: usize, name: &str, of: fn(f64) -> f64| -> Vec<(usize, Vec<f64>)> {
        let columns = run.of_magnets(element, &machine.bearings[b], name);
        let magnets = columns.into_iter().zip(machine.magnets_of(b)).enumerate();
        let used = magnets.filter(|(_, (_, k))| run.scenario.uses(*k));
        used.map(|(number, (values, k))| (number, values.iter().map(|value| of(value / run.truth[k])).collect()))
            .collect()
    };
    let lambda = |element: &str, b: usize| of_ratios(element, b, "lambdaHat", |ratio| (ratio - 1.0).abs());
    // The axis ends at typical errors: an error that changes its sign is briefly near 0.
    let of_method = |[element, _]: &[String; 2]| {
        (0..machine.bearings.len()).flat_map(|b| lambda(element, b)).flat_map(|(_, errors)| errors).collect::<Vec<_>>()
    };
    let mut all: Vec<f64> = run.methods.iter().flat_map(of_method).filter(|error| *error > 0.0).collect();
    all.sort_by(f64::total_cmp);
    let least = all.get(all.len() / 50).map_or(1e-4, |error| 10f64.powf(error.log10().floor()).clamp(1e-7, 1e-3));
    let positive = |values: &[f64]| where_shown(values, |at| values[at] > 0.0);
    let plots = run.of_methods(|element, b| {
        let mut plot = run.plot("|λ̂ − λ|/λ", PlotUnit::PERCENT).decades(1).range(1, [least, 2.0]).height(280.0);
        for (k, error) in lambda(element, b) {
            let line = Line::new(&format!("error {}", k + 1), colour::MAGNETS[k]).group(&format!("λ{}", k + 1));
            run.line(&mut plot, line, &positive(&error));
        }
        for (k, stated) in of_ratios(element, b, "lambdaStdTotal", |ratio| 2.0 * ratio) {
            let line = Line::new(&format!("2 std {}", k + 1), colour::MAGNETS[k]).group(&format!("λ{}", k + 1));
            run.line(&mut plot, line.dashed().unlisted(), &positive(&stated));
        }
        plot
    });
    let caption = "Errors (solid) and two stated standard deviations (dashed), which do not cover bench errors \
                   without a stated tolerance.";
    run.figure("errors", "Errors of the estimates", plots, caption)
}

fn condition(run: &Signals) -> Option<Figure> {
    let mut plot = run.plot("condition number", PlotUnit::ONE).decades(1).height(240.0);
    for ([element, label], colour) in run.methods.iter().zip(colour::MAGNETS.into_iter().cycle()) {
        let values = &run.recording[format!("{element}.condition")];
        run.line(&mut plot, Line::new(label, colour), &where_shown(values, |at| values[at] > 0.0));
    }
    let caption = "The condition number of the equations solved: the factor by which errors of the data may grow.";
    let title = "How well the data determine the estimates";
    (!plot.is_empty()).then(|| run.figure("condition", title, vec![plot], caption))
}

fn tracking(run: &Signals) -> Figure {
    let machine = run.scenario.machine;
    let truth = |name: &str| Line::new(name, colour::INK).dashed();
    let mut plots = Vec::new();
    for Axis { reading, position, reference, .. } in &run.axes {
        let mut plot = run.plot(&reading.axis[..1], PlotUnit::MICROMETRE);
        run.line(&mut plot, Line::new("position", colour::MAGNETS[0]), position);
        run.line(&mut plot, truth("reference"), reference);
        plots.push(plot.title(format!("Position along {}", reading.axis)));
    }
    for (b, bearing) in machine.bearings.iter().enumerate() {
        let mut plot = run.plot("error", PlotUnit::MICROMETRE).height(230.0);
        for (axis, colour) in run.axes[machine.readings_of(b)].iter().zip(colour::MAGNETS) {
            run.line(&mut plot, Line::new(&axis.reading.axis[..1], colour), &axis.error);
        }
        plots.push(plot.title(titled("Tracking error", bearing)));
    }
    for (n, (coordinate, observed)) in machine.coordinates.iter().zip(machine.of_loads("p", "Hat")).enumerate() {
        let (quantity, unit) = machine.either(n, ("force", PlotUnit::NEWTON), ("moment", PlotUnit::NEWTON_METRE));
        let mut plot = run.plot(quantity, unit).height(260.0);
        run.column(&mut plot, Line::new("observed", colour::MAGNETS[2]), &format!("controller.{observed}"));
        run.column(&mut plot, truth("true"), &format!("plant.{}", coordinate.perturbation));
        plots.push(plot.title(format!("Perturbation {}", machine.direction(n))));
    }
    let caption = "Positions and references, the errors, and the estimated perturbations beside the true ones. A wrong λ \
                   is a perturbation to the observer.";
    run.figure("tracking", "Tracking", plots, caption)
}

fn currents(run: &Signals) -> Figure {
    let mut plots = Vec::new();
    let mut add = |title: String, quantity: &str, unit: PlotUnit, columns: Vec<&[f64]>| {
        let mut plot = run.plot(quantity, unit).title(title);
        for (k, column) in columns.into_iter().enumerate() {
            run.line(&mut plot, Line::new(&format!("{quantity}{}", INDEX[k]), colour::MAGNETS[k]), column);
        }
        plots.push(plot);
    };
    for bearing in run.scenario.machine.bearings {
        add(titled("Measured currents", bearing), "i", PlotUnit::AMPERE, run.of_magnets("plant", bearing, "im"));
        add(titled("Forces", bearing), "F", PlotUnit::NEWTON, run.of_magnets("plant", bearing, "F"));
        let voltages = run.of_magnets("controller", bearing, "u");
        // A current controller commands no voltage.
        if voltages.iter().any(|u| u.iter().any(|u| *u != 0.0)) {
            add(titled("Voltages", bearing), "u", PlotUnit::VOLT, voltages);
        }
    }
    let caption = "The magnets only pull: the sign of a current has no meaning.";
    run.figure("currents", "Currents of the magnets", plots, caption)
}

fn orbit(run: &Signals) -> Option<Figure> {
    let plot_of = |what: &str| {
        let axis = |letter: &str| if what.is_empty() { letter.to_owned() } else { format!("{what} of {letter}") };
        Plot::new((&axis("y"), PlotUnit::MICROMETRE), (&axis("z"), PlotUnit::MICROMETRE)).equal().height(460.0)
    };
    let machine = run.scenario.machine;
    // The last stretch has the first colour.
    let colours = colour::MAGNETS[..run.stretches.len()].iter().rev();
    let mut plots = Vec::new();
    for (b, bearing) in machine.bearings.iter().enumerate() {
        // Radial bearings only.
        let [y, z] = &run.axes[machine.readings_of(b)] else { continue };
        let mut path = plot_of("").title(titled("Orbit", bearing));
        let mut errors = plot_of("error").title(titled("Error", bearing));
        for (stretch, colour) in run.stretches.iter().zip(colours.clone()) {
            let line = Line::new(stretch.title, colour);
            path.line(line.clone(), stretch.of(y.position), stretch.of(z.position));
            errors.line(line, stretch.of(&y.error), stretch.of(&z.error));
        }
        if let Some(last) = run.stretches.last() {
            path.line(Line::new("reference", colour::INK).dashed(), last.of(y.reference), last.of(z.reference));
        }
        if run.paper.is_some() {
            for (radius, name) in REQUIRED_M {
                let circle =
                    |of: fn(f64) -> f64| (0..=120).map(|i| radius * of(TAU * f64::from(i) / 120.0)).collect::<Vec<_>>();
                errors.line(Line::new(name, colour::SOFT).dashed(), &circle(f64::cos), &circle(f64::sin));
            }
        }
        plots.extend([path, errors]);
    }
    let caption =
        "The orbit in the plane of the bearing and its distance from the reference trajectory, over two revolutions.";
    let in_paper = " The paper states about 5 µm for its experiment on a non-circular path, and that up to 1000 rpm the \
                    industry asks for less than 1 µm on circular paths and 3 µm on others.";
    let caption = if run.paper.is_some() { format!("{caption}{in_paper}") } else { caption.into() };
    (!plots.is_empty()).then(|| run.figure("orbit", "Orbit of the rotor", plots, &caption))
}

/// Distance of the rotor from the centre of each bearing, beside the clearance of the backup bearing.
fn clearance(run: &Signals) -> Figure {
    let machine = run.scenario.machine;
    let (mut plots, mut touched) = (Vec::new(), false);
    for (b, bearing) in machine.bearings.iter().enumerate() {
        let clearance_m = evaluation::clearance_m(run.scenario, bearing);
        let radius = lengths(run.axes[machine.readings_of(b)].iter().map(|axis| axis.position));
        let most = radius.iter().copied().filter(|radius| radius.is_finite()).fold(clearance_m, f64::max);
        let mut distance = run.plot("distance from the centre", PlotUnit::MICROMETRE).height(260.0);
        distance = distance.range(1, [0.0, 1.1 * most]);
        run.line(&mut distance, Line::new("rotor", colour::MAGNETS[0]).unlisted(), &radius);
        distance.level(clearance_m, "clearance");
        plots.push(distance.title(titled("Distance from the centre", bearing)));
        let letters = if bearing.is_radial { &["Y", "Z"][..] } else { &["X"] };
        let force = |letter: &&str| &run.recording[format!("plant.{}touchdown.F{letter}", bearing.prefix)];
        let push_n = lengths(letters.iter().map(force));
        if push_n.iter().any(|force| *force > 0.0) {
            touched = true;
            let mut push = run.plot("force", PlotUnit::NEWTON).height(260.0);
            run.line(&mut push, Line::new("backup bearing", colour::MAGNETS[1]).unlisted(), &push_n);
            plots.push(push.title(titled("Force of the backup bearing", bearing)));
        }
    }
    let caption =
        if touched { "The rotor touches the backup bearing." } else { "The backup bearing is never touched." };
    run.figure("clearance", "Clearance", plots, caption)
}

/// The identified unbalance beside the true one.
fn unbalance(run: &Signals) -> Option<Figure> {
    let mut plot = run.plot("unbalance", PlotUnit::GRAM_MILLIMETRE).height(260.0);
    for (plane, name) in run.scenario.machine.of_planes("magnitude").iter().enumerate() {
        let line = Line::new(&format!("plane {}", plane + 1), colour::MAGNETS[plane]);
        run.column(&mut plot, line, &format!("{}.{name}", run.best));
        plot.level(run.scenario.real(name)?, "");
    }
    let caption = "Identified unbalance; dashed: the truth.";
    (!plot.is_empty()).then(|| run.figure("unbalance", "Unbalance", vec![plot.title("Magnitude")], caption))
}

/// The sensitivity functions of all axes, before and after the update.
fn sensitivity(run: &Signals) -> Option<Figure> {
    let hertz = PlotUnit { name: "Hz", factor: 1.0 / TAU };
    let mut plots = Vec::new();
    let mut missing = String::new();
    for (stretch, found) in run.sensitivities {
        let axes = match found {
            Ok(axes) => axes,
            Err(why) => {
                missing += &format!(" Not drawn: {why}.");
                continue;
            }
        };
        let peak = axes.iter().flatten().map(|point| point[1]).fold(0.0, f64::max);
        let mut plot =
            Plot::new(("frequency", hertz), ("|S|", PlotUnit::ONE)).decades(0).range(1, [0.0, 5.5f64.max(1.1 * peak)]);
        // Curves of different axes often coincide: a narrow line stays visible on a wide one.
        for (n, (reading, curve)) in run.scenario.machine.readings.iter().zip(axes).enumerate() {
            let line = Line::new(reading.axis, colour::MAGNETS[n % colour::MAGNETS.len()]);
            let line = if n % 2 == 0 { line.width(4.0) } else { line.dashed().width(2.0) };
            let (omega, gain): (Vec<f64>, Vec<f64>) = curve.iter().map(|[omega, gain]| (omega, gain)).unzip();
            plot.line(line, &omega, &gain);
        }
        for (limit, zone) in ZONES {
            plot.level(limit, &format!("zone {zone}: below {limit} ({:.1} dB)", 20.0 * limit.log10()));
        }
        let is_compared = run.sensitivities.len() > 1;
        plots.push(if is_compared { plot.title(format!("With λ {stretch} the update")) } else { plot });
    }
    let caption = "Gain from an error of one position sensor to its reading, with the rotor in the centre under the static load, from the \
                   response in time. Zones of ISO 14839-3.";
    if plots.is_empty() && missing.is_empty() {
        return None;
    }
    let mut figure = run.figure("sensitivity", "Sensitivity function of each axis", plots, caption);
    figure.caption = if figure.plots.is_empty() { missing } else { figure.caption + &missing };
    Some(figure)
}
