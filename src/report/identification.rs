//! The report page of an identification: the maximum likelihood answer first, then the on-line estimate.

use std::ops::Range;

use maud::{Markup, html};
use serde_json::Value as Json;

use crate::estimation::{Hold, Method, Verdict};
use crate::machine::{Bearing, Machine, Reading};
use crate::report::evaluation::{REVOLUTIONS, WITHOUT_TURNING_S};
use crate::report::figures::{Figure, INDEX, time_unit, where_shown};
use crate::report::plot::{Line, Plot, PlotUnit, colour};
use crate::report::{Report, cards, titled};
use crate::simulation::Scenario;
use crate::studies::identify::likelihood::{BenchEstimate, Change, Estimate, Identification};
use crate::studies::identify::{Answer, Samples, Statement, Track, Twin, axial};

/// Names of the magnets in legends.
const NAMES: [&str; 4] = ["λ₁", "λ₂", "λ₃", "λ₄"];
/// Colours of the readings of positions.
const AXES: [&str; 5] = [colour::MAGNETS[0], colour::MAGNETS[1], colour::MAGNETS[2], colour::MAGNETS[3], colour::INK];

/// Results of an identification.
#[derive(Default)]
pub struct Results {
    /// The recordings.
    pub recordings: Vec<Samples>,
    /// On-line estimators.
    pub tracks: Vec<Track>,
    /// The answer from all recordings together.
    pub answer: Option<Answer>,
    /// Answers for an axis, one from each recording.
    pub axes: Vec<axial::Answer>,
    /// Statements on all recordings together, or on each.
    pub statements: Vec<Statement>,
    /// Statements on several of them together.
    pub summary: Vec<String>,
    /// The same as JSON.
    pub document: Json,
    /// Why an answer is not valid.
    pub not_valid: Option<String>,
    /// How the recording to check differs, or why it cannot be compared.
    pub differs: Option<String>,
}

impl Results {
    /// The twin of the bench.
    ///
    /// # Errors
    /// If there is no valid answer; all values that a model refuses.
    pub fn twin(&self, base: &Scenario) -> std::result::Result<Twin, Vec<String>> {
        match (&self.answer, self.axes.first()) {
            (Some(answer), _) => answer.twin(base, &self.recordings[0]),
            (None, Some(axis)) => axis.twin(base),
            (None, None) => Err(self.not_valid.iter().cloned().collect()),
        }
    }
}

/// The report page of an identification, made by `command`. Figures of signals show the first recording.
#[must_use]
pub fn page(title: &str, command: &str, results: &Results) -> String {
    let Results { recordings, tracks, answer, .. } = results;
    let samples = &recordings[0];
    let run = Drawn::new(samples, recordings.len());
    let mut figures = Vec::new();
    if let Some(found) = answer.as_ref().and_then(|answer| answer.found.as_ref()) {
        figures.push(run.constants(found, tracks.first()));
        figures.push(run.positions(found));
        figures.push(run.residuals(found));
        figures.push(budget(found, samples.machine));
    }
    figures.extend(results.axes.iter().take(1).flat_map(|axis| run.axis(axis)));
    figures.push(run.currents());
    if results.statements.iter().all(|statement| statement.valid.is_none()) {
        figures.extend(run.on_line(tracks));
    }
    let tables = results.statements.iter().flat_map(|statement| statement.tables.clone()).collect();
    let report = Report { title, command, tables, time_s: Some(&run.time_s), ..Report::default() };
    report.page(&first(results), &figures)
}

/// Verdict, estimates, and the data and parameters behind them.
fn first(Results { recordings, answer, statements, summary, .. }: &Results) -> Markup {
    let class = |statement: &Statement| match statement.valid {
        Some(true) => "verdict good",
        Some(false) => "verdict bad",
        None => "verdict",
    };
    html! {
        @for statement in statements {
            p class=(class(statement)) { (statement.verdict) }
            @if let Some(found) = answer.as_ref().and_then(|answer| answer.found.as_ref()) {
                (cards(recordings[0].machine, &found.lambda.iter().map(|of| Some([of.value, of.total_std])).collect::<Vec<_>>(), None))
                p.soft {
                    "Maximum likelihood over the whole recording, in 10⁻⁶ N·m²/A²; ± is one standard deviation, stated tolerances included."
                    " With a typical bench where no tolerance is stated: ± "
                    (found.typical_std.iter().map(|std| format!("{:.1}", 100.0 * std)).collect::<Vec<_>>().join(", ")) " %."
                }
            }
            p { (statement.assumptions) }
            ul { @for finding in &statement.findings { li { (finding) } } }
        }
        @for words in summary { p { (words) } }
        ul { @for samples in recordings { @for note in &samples.notes { li { (note) } } } }
    }
}

/// Bars for the contribution of each parameter of the bench, bearing by bearing.
fn budget(found: &Identification, machine: &Machine) -> Figure {
    let of_bearing = |(bearing, magnets): (&Bearing, Range<usize>)| {
        let lines: Vec<_> = found.budget_of(bearing, &magnets).collect();
        let stated = |line: &BenchEstimate| if line.parameter.is_uncertain() { " (stated)" } else { "" };
        let name = |line: &&BenchEstimate| format!("{}{}", line.parameter.name, stated(line));
        let names: Vec<String> = lines.iter().map(name).collect();
        let mut plot = Plot::new(("part of the standard deviation of λ", PlotUnit::PERCENT), ("", PlotUnit::ONE));
        for (number, k) in magnets.clone().enumerate() {
            let parts: Vec<f64> = lines.iter().map(|line| line.contribution[k]).collect();
            plot.bars(NAMES[number], colour::MAGNETS[number], &names, &parts, true);
        }
        plot.title(bearing.name()).height(90.0 + 38.0 * names.len() as f64)
    };
    let caption = "Contribution of each bench parameter to the standard deviation of λ: with its tolerance if one is stated, \
                   otherwise with that of a typical bench, as far as the data do not exclude it, which is not in the ± above.";
    let plots = machine.magnets_of_bearings().into_iter().map(of_bearing).collect();
    Figure::new("budget", "Budget", plots, caption.into())
}

/// The first recording as it is drawn.
struct Drawn<'s> {
    samples: &'s Samples,
    time_s: Vec<f64>,
    unit: PlotUnit,
    /// Sentence for captions if there are several recordings.
    which: &'static str,
}

impl<'s> Drawn<'s> {
    fn new(samples: &'s Samples, recordings: usize) -> Self {
        let time_s: Vec<f64> = (0..samples.len()).map(|j| samples.start_s + j as f64 * samples.step_s).collect();
        let unit = time_unit(samples.len() as f64 * samples.step_s);
        Self { samples, time_s, unit, which: if recordings > 1 { " Of the first recording." } else { "" } }
    }

    fn over_time(&self, quantity: &str, unit: PlotUnit) -> Plot {
        Plot::over_time(self.unit, (quantity, unit)).range(0, self.ends_s())
    }

    /// The instants of the first and of the last row, in s.
    fn ends_s(&self) -> [f64; 2] {
        [0, self.time_s.len()].map(|row| self.instant(row))
    }

    /// λ over the recording: the answer with its parts, and the on-line estimate for comparison.
    fn constants(&self, found: &Identification, track: Option<&Track>) -> Figure {
        let mut on_line = track.map(|track| self.bands(track)).unwrap_or_default().into_iter();
        let mut plots = Vec::new();
        let mut has_on_line = false;
        for (bearing, magnets) in self.samples.machine.magnets_of_bearings() {
            let mut whole = self.over_time("λ", PlotUnit::LAMBDA).height(380.0);
            for (number, k) in magnets.clone().enumerate() {
                let [x, value, std] = self.corners(found, k);
                let name = NAMES[number];
                whole.band(name, colour::BANDS[number], &x, &value, &std);
                whole.line(Line::new(name, colour::MAGNETS[number]).group(name).width(2.0), &x, &value);
            }
            for part in found.contradictions.iter().filter(|part| part.recording == 0) {
                whole.shade(self.instant(part.rows.start), self.instant(part.rows.end));
            }
            plots.push(whole.title(titled("Maximum likelihood", bearing)));
            if let Some(mut on_line) = on_line.next().filter(|plot| !plot.is_empty()) {
                has_on_line = true;
                for (number, k) in magnets.enumerate() {
                    let line = Line::new("maximum likelihood", colour::MAGNETS[number]);
                    let line = line.group(NAMES[number]).dashed().unlisted();
                    on_line.line(line, &self.ends_s(), &[found.lambda[k].value; 2]);
                }
                plots.push(on_line.title(titled("On-line estimator", bearing)));
            }
        }
        let mut caption = String::from(
            "The answer from all samples, with a band of two standard deviations; disturbed parts, and those with a different λ or load, are shaded. ",
        );
        caption += if has_on_line {
            "For comparison the on-line estimator, which knows at each instant only the samples before it, beside the answer (dashed)."
        } else {
            "The on-line estimator, which knows at each instant only the samples before it, gives no valid estimate of this recording."
        };
        Figure::new("constants", "Force constants", plots, caption + self.which)
    }

    /// λ of one magnet over the recording: instant in s, value and standard deviation at begin and end of each part, and a gap after it.
    fn corners(&self, found: &Identification, k: usize) -> [Vec<f64>; 3] {
        let mut estimates = vec![&found.lambda[k]; self.time_s.len()];
        for part in found.contradictions.iter().filter(|part| part.recording == 0) {
            let Change::Lambda(lambda) = &part.what else { continue };
            let first = if part.part == 0 { 0 } else { found.lambda.len() - lambda.len() };
            if let Some(own) = k.checked_sub(first).and_then(|k| lambda.get(k)) {
                estimates[part.rows.clone()].fill(own);
            }
        }
        let rows: Vec<usize> = (0..estimates.len()).collect();
        let parts = rows.chunk_by(|one, other| std::ptr::eq(estimates[*one], estimates[*other]));
        let corners = |part: &[usize]| {
            let [from, to] = [part[0], part[0] + part.len()].map(|row| self.instant(row));
            let &Estimate { value, total_std, noise_std, .. } = estimates[part[0]];
            [(from, value), (to, value), (to, f64::NAN)].map(|(x, value)| [x, value, total_std.max(noise_std)])
        };
        let corners: Vec<_> = parts.flat_map(corners).collect();
        [0, 1, 2].map(|n| corners.iter().map(|corner| corner[n]).collect())
    }

    /// The instant of a row in s; rows past the end have the last one.
    fn instant(&self, row: usize) -> f64 {
        self.time_s.get(row).or(self.time_s.last()).copied().unwrap_or(0.0)
    }

    /// Measured and predicted positions over the last revolutions.
    fn positions(&self, found: &Identification) -> Figure {
        let errors = &found.conditions[0].prediction_errors_m;
        let end = errors[0].iter().rposition(|error| error.is_finite()).map_or(0, |last| last + 1);
        let speed = self.samples.omega_rad_s.get(end.saturating_sub(1)).copied().unwrap_or(0.0).abs();
        let turns_s = REVOLUTIONS * std::f64::consts::TAU / speed;
        let length_s = if turns_s.is_finite() && turns_s < 1.0 { turns_s } else { WITHOUT_TURNING_S };
        let rows = end.saturating_sub((length_s / self.samples.step_s) as usize)..end;
        let plots = self.samples.machine.readings.iter().enumerate().map(|(axis, Reading { axis: name, .. })| {
            let mut plot = Plot::new(("time", self.unit), (name, PlotUnit::MICROMETRE)).title(*name);
            let time_s = &self.time_s[rows.clone()];
            let measured = &self.samples.position_m[axis][rows.clone()];
            let predicted: Vec<f64> =
                measured.iter().zip(&errors[axis][rows.clone()]).map(|(measured, error)| measured - error).collect();
            plot.line(Line::new("measured", colour::MAGNETS[0]).width(3.0), time_s, measured);
            plot.line(Line::new("predicted", colour::INK).dashed().width(1.2), time_s, &predicted);
            plot
        });
        let caption = "The end of the recording: measured positions beside those that the identified model predicts from the samples before.";
        Figure::new("positions", "Measured and predicted positions", plots.collect(), caption.to_owned() + self.which)
    }

    /// Prediction errors over time, and their harmonics.
    fn residuals(&self, found: &Identification) -> Figure {
        let errors = &found.conditions[0].prediction_errors_m;
        let mut over_time = self.over_time("residual", PlotUnit::MICROMETRE);
        let mut harmonics = Plot::new(("", PlotUnit::ONE), ("amplitude / noise", PlotUnit::ONE));
        let names: Vec<String> = (1..=4).map(|harmonic| format!("{harmonic}×")).collect();
        for (axis, Reading { axis: name, .. }) in self.samples.machine.readings.iter().enumerate() {
            over_time.line(Line::new(name, AXES[axis]).width(1.0), &self.time_s, &errors[axis]);
            harmonics.bars(name, AXES[axis], &names, &found.conditions[0].amplitudes[axis], false);
        }
        let caption = "Measured minus predicted positions: noise if the model describes the motion. Bars: the amplitudes of their components at \
                       multiples of the rotor's speed, relative to the noise of one sample; those well above zero are run-out or forces that the \
                       model does not have.";
        let plots = vec![over_time.title("Over time"), harmonics.title("Harmonics of the speed")];
        Figure::new("residuals", "Residuals", plots, caption.to_owned() + self.which)
    }

    fn currents(&self) -> Figure {
        let recorded = self.samples.currents(Hold::Linear);
        let mut currents = recorded.iter();
        let of_bearing = |bearing: &Bearing| {
            let mut plot = self.over_time("i", PlotUnit::AMPERE);
            let own = currents.by_ref().take(bearing.magnets).enumerate();
            for (k, current) in own.filter(|(_, current)| !current.is_empty()) {
                plot.line(Line::new(&format!("i{}", INDEX[k]), colour::MAGNETS[k]), &self.time_s, current);
            }
            plot.title(bearing.name())
        };
        let plots = self.samples.machine.bearings.iter().map(of_bearing).collect();
        Figure::new("currents", "Currents", plots, format!("As recorded.{}", self.which))
    }

    /// The positions of an axis, and the remainder that the force law does not explain.
    fn axis(&self, answer: &axial::Answer) -> [Figure; 2] {
        let [force, std, errors_m] = answer.traces();
        let from = force.iter().position(|force| force.is_finite()).unwrap_or(0);
        let shaded = |mut plot: Plot| {
            if from > 0 {
                plot.shade(self.instant(0), self.instant(from));
            }
            plot
        };
        let mut position = self.over_time("x", PlotUnit { name: "mm", factor: 1e3 });
        position.line(Line::new("measured", colour::MAGNETS[0]).width(1.0), &self.time_s, &self.samples.position_m[0]);
        let mut slow = self.over_time("slow force", PlotUnit { name: "mN", factor: 1e3 });
        slow.band("slow force", colour::BANDS[0], &self.time_s, &force, &std);
        slow.line(Line::new("slow force", colour::MAGNETS[0]).group("slow force"), &self.time_s, &force);
        let mut errors = self.over_time("prediction error", PlotUnit::MICROMETRE);
        errors.line(Line::new("one sample ahead", colour::MAGNETS[1]).width(1.0), &self.time_s, &errors_m);
        let left = vec![shaded(slow).title("Slow force"), shaded(errors).title("Prediction errors")];
        let caption = format!("Shaded intervals were left out.{}", self.which);
        let of_force = "The force that the law does not explain, with a band of two standard deviations, and the errors of predictions.";
        [
            Figure::new("recorded", "Positions", vec![shaded(position)], caption),
            Figure::new("slow", "Unexplained force", left, of_force.to_owned() + self.which),
        ]
    }

    /// Figures of the on-line methods.
    fn on_line(&self, tracks: &[Track]) -> Vec<Figure> {
        let verdicts: Vec<String> =
            tracks.iter().map(|track| format!("{}: {}", track.name(), track.verdict())).collect();
        let caption =
            format!("With a band of two standard deviations; gaps have no valid estimate. {}", verdicts.join(" "));
        let constants = tracks.iter().flat_map(|track| self.bands(track)).collect();
        let mut figures = vec![Figure::new("constants", "Force constants over time", constants, caption)];
        if let Some(track) = tracks.iter().find(|track| track.method() == Method::PredictionError) {
            let machine = track.machine;
            let is_valid = track.of("valid");
            let valid = |j: usize| is_valid[j] == 1.0;
            let mut unbalance = self.over_time("unbalance", PlotUnit::GRAM_MILLIMETRE);
            for (name, colour) in machine.of_planes("magnitude").iter().zip(colour::MAGNETS) {
                let label = name.trim_end_matches(".magnitude");
                line(&mut unbalance, track, name, Line::new(label, colour), valid);
            }
            let mut load = self.over_time("static load", PlotUnit::NEWTON);
            let mut moment = self.over_time("static moment", PlotUnit::NEWTON_METRE);
            for (n, name) in machine.of_loads("p", "Hat").iter().enumerate() {
                let own = Line::new(&machine.direction(n), colour::MAGNETS[n % 3]);
                line(machine.either(n, &mut load, &mut moment), track, name, own, valid);
            }
            let plots = vec![unbalance.title("Unbalance"), load.title("Static load"), moment.title("Static moment")];
            let caption = "As identified together with the force constants.";
            figures.push(Figure::new("unbalance", "Unbalance and static load", plots, caption.into()));
        }
        let mut residual = self.over_time("residual", PlotUnit::ONE);
        for (track, colour) in tracks.iter().zip(colour::MAGNETS) {
            line(&mut residual, track, "residual", Line::new(track.name(), colour), |_| true);
        }
        let caption = "For predictionError the normalised innovation squared, 1 if model and noise describe the data; for the paper's methods the \
                       part of the motion that is left over.";
        figures.push(Figure::new("residuals", "Residuals", vec![residual], caption.into()));
        figures
    }

    /// Valid λ̂ of an on-line method with their bands, bearing by bearing.
    fn bands(&self, track: &Track) -> Vec<Plot> {
        let names = ["lambdaHat", "lambdaStdTotal"].map(|name| track.machine.of_magnets(name));
        let mut magnets = names[0].iter().zip(&names[1]);
        let of_bearing = |bearing: &Bearing| {
            let mut plot = self.over_time("λ̂", PlotUnit::LAMBDA).height(380.0);
            for (k, (lambda, std)) in magnets.by_ref().take(bearing.magnets).enumerate() {
                let valid = track.of("valid");
                let lambda = where_shown(track.of(lambda), |j| valid[j] == 1.0);
                let time_s = &track.outputs.time_s;
                plot.band(NAMES[k], colour::BANDS[k], time_s, &lambda, track.of(std));
                let line = Line::new(&format!("λ̂{}", INDEX[k]), colour::MAGNETS[k]).group(NAMES[k]).width(2.0);
                plot.line(line, time_s, &lambda);
            }
            plot.title(if bearing.prefix.is_empty() { track.name() } else { bearing.name() })
        };
        track.machine.bearings.iter().map(of_bearing).collect()
    }
}

/// Adds a signal of a track, with gaps where it is not to be shown.
fn line(plot: &mut Plot, track: &Track, name: &str, line: Line, show: impl Fn(usize) -> bool) {
    let verdicts = track.verdicts();
    let shown = where_shown(track.of(name), |j| show(j) && verdicts[j] != Verdict::Collecting);
    plot.line(line, &track.outputs.time_s, &shown);
}
