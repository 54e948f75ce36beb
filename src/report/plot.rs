//! Interactive plots, drawn by plotly.js.
//!
//! A page holds the script once ([`scripts`]) and every plot as data. Colours are names from the page's style, so that the
//! browser chooses between light and dark.

use std::io::Write;
use std::sync::LazyLock;

use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use maud::{Markup, PreEscaped, html};
use serde_json::{Value as Json, json};

/// Signals of up to this many samples are drawn completely, among them those of the paper's run.
pub(super) const MAX_UNTHINNED: usize = 5000;
/// Of longer signals, the minimum and maximum in each of this many intervals are drawn; a screen has fewer columns.
const INTERVALS: usize = 1200;
/// Points along each edge of a band, which is smooth.
const BAND_POINTS: usize = 300;

/// Colours by their names in the style of the page.
pub mod colour {
    /// Magnets of a bearing, at most four; safe for colour-blind readers.
    pub const MAGNETS: [&str; 4] = ["--magnet1", "--magnet2", "--magnet3", "--magnet4"];
    /// The bands of their standard deviations.
    pub const BANDS: [&str; 4] = ["--band1", "--band2", "--band3", "--band4"];
    /// The colour of text.
    pub const INK: &str = "--ink";
    /// Softer than text.
    pub const SOFT: &str = "--soft";
    /// Intervals without a valid estimate.
    pub const SHADE: &str = "--shade";
}

/// A unit to show values in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlotUnit {
    /// Name as on the axis; empty for a plain number.
    pub name: &'static str,
    /// Displayed value per SI value.
    pub factor: f64,
}

impl PlotUnit {
    /// Plain numbers.
    pub const ONE: PlotUnit = PlotUnit { name: "", factor: 1.0 };
    /// Ratios.
    pub const PERCENT: PlotUnit = PlotUnit { name: "%", factor: 1e2 };
    /// Positions of the rotor.
    pub const MICROMETRE: PlotUnit = PlotUnit { name: "µm", factor: 1e6 };
    /// Long runs.
    pub const SECOND: PlotUnit = PlotUnit { name: "s", factor: 1.0 };
    /// A few revolutions.
    pub const MILLISECOND: PlotUnit = PlotUnit { name: "ms", factor: 1e3 };
    /// Force constants λ.
    pub const LAMBDA: PlotUnit = PlotUnit { name: "10⁻⁶ N·m²/A²", factor: 1e6 };
    /// Forces.
    pub const NEWTON: PlotUnit = PlotUnit { name: "N", factor: 1.0 };
    /// Moments.
    pub const NEWTON_METRE: PlotUnit = PlotUnit { name: "N·m", factor: 1.0 };
    /// Unbalances.
    pub const GRAM_MILLIMETRE: PlotUnit = PlotUnit { name: "g·mm", factor: 1e6 };
    /// Currents.
    pub const AMPERE: PlotUnit = PlotUnit { name: "A", factor: 1.0 };
    /// Voltages.
    pub const VOLT: PlotUnit = PlotUnit { name: "V", factor: 1.0 };
}

/// Style of a line: its trace for plotly.js without the points.
#[derive(Clone, Debug)]
pub struct Line(Json);

impl Line {
    /// A solid line with a legend entry.
    pub fn new(name: &str, colour: &'static str) -> Line {
        Line(json!({
            "type": "scatter", "mode": "lines", "name": name, "showlegend": true,
            "line": {"color": colour, "dash": "solid", "width": 1.6},
        }))
    }

    /// Dashed and thin, for a reference.
    pub fn dashed(mut self) -> Line {
        self.0["line"]["dash"] = json!("dash");
        self.width(1.0)
    }

    /// Dotted, for invalid values.
    pub fn dotted(mut self) -> Line {
        self.0["line"]["dash"] = json!("dot");
        self
    }

    /// With this width in pixels.
    pub fn width(mut self, width: f64) -> Line {
        self.0["line"]["width"] = json!(width);
        self
    }

    /// Shown and hidden together with the other lines of that group.
    pub fn group(mut self, name: &str) -> Line {
        self.0["legendgroup"] = json!(name);
        self
    }

    /// Without a legend entry.
    pub fn unlisted(mut self) -> Line {
        self.0["showlegend"] = json!(false);
        self
    }
}

/// A plot: lines, levels, instants and intervals between two axes.
#[derive(Clone, Debug)]
pub struct Plot {
    /// Heading above the plot; may be empty.
    pub(super) title: String,
    units: [PlotUnit; 2],
    traces: Vec<Json>,
    shapes: Vec<Json>,
    /// The layout for plotly.js without the shapes.
    layout: Json,
    height_px: f64,
    over_time: bool,
}

/// Keys of the axes in the layout.
const AXES: [&str; 2] = ["xaxis", "yaxis"];

impl Plot {
    /// An empty plot of `y` over `x`, each a quantity and its unit.
    pub fn new(x: (&str, PlotUnit), y: (&str, PlotUnit)) -> Plot {
        let title = |(quantity, unit): (&str, PlotUnit)| match unit.name {
            "" => json!({"text": quantity}),
            name => json!({"text": format!("{quantity} [{name}]")}),
        };
        // The unit appears at the pointer and at the last number of the axis.
        let suffix = format!(" {}", x.1.name);
        let layout = json!({
            "xaxis": {"title": title(x), "ticksuffix": suffix, "showticksuffix": "last"}, "yaxis": {"title": title(y)},
        });
        let (traces, shapes) = (Vec::new(), Vec::new());
        Plot { title: String::new(), units: [x.1, y.1], traces, shapes, layout, height_px: 300.0, over_time: false }
    }

    /// An empty plot over time, linked to all others over time on the page.
    pub fn over_time(unit: PlotUnit, y: (&str, PlotUnit)) -> Plot {
        Plot { over_time: true, ..Plot::new(("time", unit), y) }
    }

    /// With this heading.
    pub fn title(self, title: impl Into<String>) -> Plot {
        Plot { title: title.into(), ..self }
    }

    /// With this height in pixels.
    pub fn height(self, height_px: f64) -> Plot {
        Plot { height_px, ..self }
    }

    /// With a logarithmic axis (0 for x).
    pub fn decades(mut self, axis: usize) -> Plot {
        self.layout[AXES[axis]]["type"] = json!("log");
        self.layout[AXES[axis]]["nticks"] = json!(7);
        self
    }

    /// With an initial range of an axis (0 for x) in SI values; a range that is empty or not finite is ignored.
    pub fn range(mut self, axis: usize, ends: [f64; 2]) -> Plot {
        let log = self.layout[AXES[axis]]["type"] == "log";
        let ends = ends.map(|end| end * self.units[axis].factor).map(|end| if log { end.log10() } else { end });
        if ends.iter().all(|end| end.is_finite()) && ends[0] < ends[1] {
            self.layout[AXES[axis]]["range"] = json!(ends);
        }
        self
    }

    /// With equal scales on both axes.
    pub fn equal(mut self) -> Plot {
        self.layout[AXES[1]]["scaleanchor"] = json!("x");
        self
    }

    /// Adds a line; non-finite values leave gaps. A line without finite values is left out.
    pub fn line(&mut self, line: Line, x: &[f64], y: &[f64]) {
        let (x, y) = self.shown(x, y);
        if !y.iter().any(|y| y.is_finite()) {
            return;
        }
        let unit = self.units[1].name;
        let space = if unit.is_empty() { "" } else { " " };
        let Line(mut trace) = line;
        let name = trace["name"].as_str().unwrap_or_default();
        trace["hovertemplate"] = json!(format!("{name} %{{y:.5~g}}{space}{unit}<extra></extra>"));
        self.trace(trace, &thinned(&x, &y));
    }

    /// Adds a band of two standard deviations where value and band are finite; it is shown and hidden with its group.
    pub fn band(&mut self, group: &str, fill: &str, x: &[f64], values: &[f64], std: &[f64]) {
        let every = (x.len() / BAND_POINTS).max(1);
        let mut outline = (Vec::new(), Vec::new());
        let edge = |at: usize, stds: f64| values[at] + stds * std[at];
        let rows: Vec<usize> = (0..x.len()).step_by(every).collect();
        for stretch in rows.split(|at| !edge(*at, 2.0).is_finite()).filter(|stretch| stretch.len() > 1) {
            let above = stretch.iter().map(|at| (x[*at], edge(*at, 2.0)));
            let below = stretch.iter().rev().map(|at| (x[*at], edge(*at, -2.0)));
            outline.extend(above.chain(below).chain([(f64::NAN, f64::NAN)]));
        }
        if !outline.0.is_empty() {
            let shown = self.shown(&outline.0, &outline.1);
            let trace = json!({
                "type": "scatter", "mode": "none", "fill": "toself", "fillcolor": fill, "legendgroup": group,
                "showlegend": false, "hoverinfo": "skip",
            });
            self.trace(trace, &shown);
        }
    }

    /// Adds a series of named bars, vertical or horizontal.
    pub fn bars(&mut self, name: &str, colour: &str, names: &[String], values: &[f64], horizontal: bool) {
        let (value, unit) = if horizontal { ("x", self.units[0]) } else { ("y", self.units[1]) };
        let values: Vec<f64> = values.iter().map(|value| value * unit.factor).collect();
        let mut trace = json!({
            "type": "bar", "name": name, "marker": {"color": colour}, "orientation": if horizontal { "h" } else { "v" },
            "hovertemplate": format!("{name} %{{{value}:.3~g}} {}<extra></extra>", unit.name),
        });
        trace[value] = packed(&values);
        trace[if horizontal { "y" } else { "x" }] = json!(names);
        if horizontal {
            // From top to bottom, as in a table.
            self.layout[AXES[1]]["autorange"] = json!("reversed");
        }
        self.layout["barmode"] = json!("group");
        self.layout["hovermode"] = json!("closest");
        self.traces.push(trace);
    }

    /// Shades an interval of the horizontal axis.
    pub fn shade(&mut self, from: f64, to: f64) {
        let [from, to] = [from, to].map(|end| end * self.units[0].factor);
        if from.is_finite() && to.is_finite() && from < to {
            self.shapes.push(json!({
                "type": "rect", "yref": "paper", "y0": 0, "y1": 1, "x0": from, "x1": to, "layer": "below",
                "fillcolor": colour::SHADE, "line": {"width": 0},
            }));
        }
    }

    /// Adds a horizontal line across the plot.
    pub fn level(&mut self, at: f64, label: &str) {
        let at = at * self.units[1].factor;
        if at.is_finite() {
            self.shapes.push(json!({
                "type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": at, "y1": at,
                "line": {"color": colour::SOFT, "width": 1, "dash": "dash"},
                "label": {"text": label, "textposition": "end", "font": {"size": 11, "color": colour::SOFT}},
            }));
        }
    }

    /// Adds a vertical line at an instant.
    pub fn instant(&mut self, at: f64, label: &str) {
        let at = at * self.units[0].factor;
        if at.is_finite() {
            self.shapes.push(json!({
                "type": "line", "yref": "paper", "y0": 0, "y1": 1, "x0": at, "x1": at,
                "line": {"color": colour::SOFT, "width": 1.2, "dash": "dot"},
                // Along the line, within the frame.
                "label": {"text": label, "textposition": "end", "textangle": -90, "xanchor": "right", "yanchor": "bottom",
                    "font": {"size": 11, "color": colour::SOFT}},
            }));
        }
    }

    /// Whether there is nothing to draw.
    pub fn is_empty(&self) -> bool {
        self.traces.is_empty()
    }

    fn shown(&self, x: &[f64], y: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let [fx, fy] = self.units.map(|unit| unit.factor);
        x.iter().zip(y).map(|(x, y)| (x * fx, y * fy)).unzip()
    }

    fn trace(&mut self, mut trace: Json, (x, y): &(Vec<f64>, Vec<f64>)) {
        let step = if x.len() > 1 { (x[x.len() - 1] - x[0]) / (x.len() - 1) as f64 } else { 0.0 };
        let x0 = x.first().copied().unwrap_or(0.0);
        // Well below the sample spacing, well above the rounding of the instants.
        let even = x.iter().enumerate().all(|(at, value)| (value - x0 - at as f64 * step).abs() < 1e-3 * step);
        if even {
            trace["x0"] = json!(x0);
            trace["dx"] = json!(step);
        } else {
            trace["x"] = packed(x);
        }
        trace["y"] = packed(y);
        self.traces.push(trace);
    }

    /// The plot as an element of a page with [`scripts`].
    pub fn html(&self) -> Markup {
        let mut layout = self.layout.clone();
        layout["shapes"] = json!(self.shapes);
        let data = json!({"data": self.traces, "layout": layout});
        html! {
            div.plot data-over-time[self.over_time] style={ "height:" (self.height_px) "px" } { (data_element(&data)) }
        }
    }
}

/// Data as an element that a script reads.
pub fn data_element(data: &Json) -> Markup {
    // The characters that would end the element are escaped.
    let text = data.to_string().replace('<', "\\u003c");
    html! { script type="application/json" { (PreEscaped(text)) } }
}

/// Numbers for plotly.js in single precision, finer than a screen resolves.
pub fn packed(values: &[f64]) -> Json {
    let bytes: Vec<u8> = values.iter().flat_map(|value| (*value as f32).to_le_bytes()).collect();
    json!({"dtype": "f4", "bdata": BASE64.encode(bytes)})
}

/// The points drawn: all of a short signal; the minimum and maximum of each interval of a long one, at their instants. If more
/// than a quarter of the values are missing, each gap becomes one point.
fn thinned(x: &[f64], y: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let missing = y.iter().filter(|y| !y.is_finite()).count();
    let mut rows: Vec<usize> = (0..y.len()).collect();
    if 4 * missing > y.len() {
        rows.retain(|at| y[*at].is_finite() || *at > 0 && y[*at - 1].is_finite());
    }
    if rows.len() > MAX_UNTHINNED {
        let size = rows.len().div_ceil(INTERVALS);
        let extremes = |interval: &[usize]| {
            let finite = || interval.iter().copied().filter(|at| y[*at].is_finite());
            let least = finite().min_by(|a, b| y[*a].total_cmp(&y[*b]));
            let greatest = finite().max_by(|a, b| y[*a].total_cmp(&y[*b]));
            match (least, greatest) {
                (Some(least), Some(greatest)) => vec![least.min(greatest), least.max(greatest)],
                _ => vec![interval[0]],
            }
        };
        rows = rows.chunks(size).flat_map(extremes).collect();
    }
    rows.into_iter().map(|at| (x[at], y[at])).unzip()
}

/// plotly.js, compressed from 1.0 to 0.5 MB so that a page can be mailed. `plotly/` holds the distribution `basic` (lines, bars and pies) of the
/// npm package plotly.js-basic-dist-min 3.0.1, with its licence.
static PLOTLY: LazyLock<String> = LazyLock::new(|| {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    let written = encoder.write_all(include_bytes!("frame/plotly/plotly-basic.min.js")).and_then(|()| encoder.finish());
    BASE64.encode(written.expect("a vector takes all that is written"))
});

/// A notice for browsers without JavaScript, which also hides the empty figures.
pub fn notice() -> Markup {
    html! {
        noscript {
            p.message { "Plots and animation need JavaScript, which this browser does not run; nothing is loaded from elsewhere. The tables need none." }
            style { "figure, .first, nav, #views, footer { display: none }" }
        }
    }
}

/// The scripts that draw plots and animation, for the end of the page.
pub fn scripts() -> Markup {
    html! {
        script type="text/plain" id="plotly" { (PreEscaped(PLOTLY.as_str())) }
        script { (PreEscaped(include_str!("frame/plots.js"))) }
        script { (PreEscaped(include_str!("frame/player.js"))) }
        script { (PreEscaped(include_str!("frame/orbit.js"))) }
        script { (PreEscaped(include_str!("frame/shaft.js"))) }
    }
}
