//! Plots as SVG text: lines over time, orbits in a plane, marked values and instants.
//!
//! A [`Plot`] takes its data in SI units and shows them in the [`Unit`] of its axes. Whatever the data, a drawing comes
//! out: values that are not finite are left out, values beyond the stated range are cut at the frame, and
//! [`Drawing::notes`] says so in words for the caption.

use std::borrow::Cow;
use std::collections::BTreeSet;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::FontTransform;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Device units per pixel. The backend knows whole numbers only, and whole pixels would make steps in smooth curves.
const SCALE: f64 = 10.0;
/// Height of the text of axes and legends, in pixels.
const TEXT_PX: f64 = 12.0;
/// Width of a letter over its height, on the safe side: the page may be shown in any typeface.
const LETTER: f64 = 0.58;
/// Height of a row of text above the frame, in pixels.
const ROW_PX: f64 = 18.0;
/// Room left of the frame for tick labels and the title of the axis, in pixels.
const LEFT_PX: f64 = 66.0;
/// Room right of the frame where no marked value needs more, in pixels.
const RIGHT_PX: f64 = 14.0;
/// Room below the frame with and without a title of the axis, in pixels.
const BOTTOM_PX: (f64, f64) = (42.0, 24.0);
/// Lengths of a dash and of the gap after it, in pixels.
const DASH_PX: (f64, f64) = (5.0, 3.5);
/// How many dashes a line may have; a longer one is drawn solid.
const MOST_DASHES: f64 = 1000.0;
/// What is further out than this many frames is brought there, lest the arithmetic of clipping overflow.
const FAR: f64 = 1e6;

const INK: RGBColor = RGBColor(0x22, 0x26, 0x2b);
const FRAME: RGBColor = RGBColor(0x8a, 0x91, 0x99);
const GRID: RGBColor = RGBColor(0xe4, 0xe7, 0xea);

/// A colour of the palette of Okabe and Ito, which stays apart for colour-blind readers and in grey.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colour {
    /// First signal.
    Blue,
    /// Second signal.
    Vermillion,
    /// Third signal.
    Green,
    /// Fourth signal.
    Purple,
    /// References and true values.
    Ink,
    /// Limits, and what stands back.
    Grey,
}

impl Colour {
    /// The colours of the signals that come in threes, one per magnet.
    pub const MAGNETS: [Colour; 3] = [Colour::Blue, Colour::Vermillion, Colour::Green];

    fn rgb(self) -> RGBColor {
        match self {
            Colour::Blue => RGBColor(0x00, 0x72, 0xb2),
            Colour::Vermillion => RGBColor(0xd5, 0x5e, 0x00),
            Colour::Green => RGBColor(0x00, 0x9e, 0x73),
            Colour::Purple => RGBColor(0xb5, 0x5a, 0x92),
            Colour::Ink => INK,
            Colour::Grey => RGBColor(0x6b, 0x72, 0x7a),
        }
    }
}

/// A unit to show values in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    /// Name as on the axis; empty for a plain number.
    pub name: &'static str,
    /// Shown value over SI value.
    pub factor: f64,
}

impl Unit {
    /// Plain numbers.
    pub const ONE: Unit = Unit { name: "", factor: 1.0 };
    /// Ratios.
    pub const PERCENT: Unit = Unit { name: "%", factor: 1e2 };
    /// Positions of the rotor.
    pub const MICROMETRE: Unit = Unit { name: "µm", factor: 1e6 };
    /// Long runs.
    pub const SECOND: Unit = Unit { name: "s", factor: 1.0 };
    /// A few revolutions.
    pub const MILLISECOND: Unit = Unit { name: "ms", factor: 1e3 };
    /// Magnet constants λ.
    pub const LAMBDA: Unit = Unit { name: "10⁻⁶ N·m²/A²", factor: 1e6 };
    /// Forces.
    pub const NEWTON: Unit = Unit { name: "N", factor: 1.0 };
    /// Currents.
    pub const AMPERE: Unit = Unit { name: "A", factor: 1.0 };

    /// `value` (SI) in this unit with `digits` significant digits, and the name of the unit.
    pub fn show(&self, value: f64, digits: usize) -> String {
        let number = significant(value * self.factor, digits);
        match self.name {
            "" => number,
            // 10⁻⁶ is a factor, and so wants the sign of a product.
            name if name.starts_with("10") => format!("{number}·{name}"),
            // No line break between number and unit.
            name => format!("{number}\u{a0}{name}"),
        }
    }
}

/// `value` rounded to `digits` significant digits, with a true minus sign, and powers of ten where zeros would mislead.
pub fn significant(value: f64, digits: usize) -> String {
    if value.is_nan() {
        return "not a number".into();
    }
    if value.is_infinite() {
        return if value > 0.0 { "∞" } else { "−∞" }.into();
    }
    let digits = digits.clamp(1, 17);
    // The exponent after rounding: 9.99 with two digits is 10.
    let scientific = format!("{:.*e}", digits - 1, value);
    let (mantissa, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if value == 0.0 {
        "0".into()
    } else if (-4..6).contains(&exponent) {
        // By way of the rounded text, so that 2755 with two digits is 2800 and not more exact than said.
        let rounded: f64 = scientific.parse().unwrap_or(value);
        let decimals = (digits as i32 - 1 - exponent).max(0) as usize;
        format!("{rounded:.decimals$}").replace('-', "−")
    } else {
        format!("{}·10{}", mantissa.replace('-', "−"), superscript(exponent))
    }
}

fn superscript(number: i32) -> String {
    let digits = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    number.to_string().chars().map(|c| c.to_digit(10).map_or('⁻', |d| digits[d as usize])).collect()
}

/// An interval of values, in SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Lower end.
    pub min: f64,
    /// Upper end.
    pub max: f64,
}

impl Range {
    /// From end to end.
    pub fn new(min: f64, max: f64) -> Range {
        Range { min, max }
    }

    /// The smallest interval that holds every finite value, if there is one.
    pub fn hull<'a>(values: impl IntoIterator<Item = &'a f64>) -> Option<Range> {
        values.into_iter().filter(|value| value.is_finite()).fold(None, |range, &value| match range {
            None => Some(Range::new(value, value)),
            Some(Range { min, max }) => Some(Range::new(min.min(value), max.max(value))),
        })
    }

    /// An interval for an axis: the hull of the finite values with some air, unless a few of them are so far out that
    /// the others would become a flat line; then an interval around the others.
    pub fn of_axis<'a>(values: impl IntoIterator<Item = &'a f64>) -> Option<Range> {
        /// Share of the values that may be outliers at either end.
        const TAIL: f64 = 0.02;
        /// How many times wider than the bulk the hull may be.
        const WIDER: f64 = 8.0;
        let mut sorted: Vec<f64> = values.into_iter().copied().filter(|value| value.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let (&min, &max) = (sorted.first()?, sorted.last()?);
        let tail = (TAIL * sorted.len() as f64) as usize;
        let bulk = Range::new(sorted[tail], sorted[sorted.len() - 1 - tail]);
        let wide = bulk.max - bulk.min;
        let range = if wide > 0.0 && max * 0.5 - min * 0.5 > 0.5 * WIDER * wide {
            // Each end goes out to the data, but not by more than the width of the bulk.
            Range::new(min.max(bulk.min - wide), max.min(bulk.max + wide))
        } else {
            Range::new(min, max)
        };
        Some(range.with_air(0.06))
    }

    /// The interval that holds both.
    pub fn and(self, other: Range) -> Range {
        Range::new(self.min.min(other.min), self.max.max(other.max))
    }

    /// Wider by `share` of its width at either end, and never empty.
    pub fn with_air(self, share: f64) -> Range {
        let half = 0.5 * self.max - 0.5 * self.min;
        let air = if half > 0.0 && half > 1e-12 * self.min.abs().max(self.max.abs()) {
            2.0 * share * half
        } else if self.max.abs().max(self.min.abs()) > 0.0 {
            0.1 * self.max.abs().max(self.min.abs())
        } else {
            1.0
        };
        Range::new((self.min - air).max(f64::MIN / 8.0), (self.max + air).min(f64::MAX / 8.0))
    }
}

/// An axis: what it shows, in which unit, and from where to where.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// The quantity; with an empty name the axis has tick labels only.
    pub quantity: String,
    /// The unit shown.
    pub unit: Unit,
    /// The range shown, SI; `None` takes [`Range::of_axis`] of the data.
    pub range: Option<Range>,
    /// Decades instead of equal steps; values that are not positive are left out.
    pub log: bool,
}

impl Axis {
    /// An axis that follows its data.
    pub fn new(quantity: &str, unit: Unit) -> Axis {
        Axis { quantity: quantity.into(), unit, range: None, log: false }
    }

    /// The same with a stated range, SI.
    pub fn from_to(self, range: Option<Range>) -> Axis {
        Axis { range, ..self }
    }

    /// The same in decades.
    pub fn in_decades(self) -> Axis {
        Axis { log: true, ..self }
    }

    fn title(&self) -> String {
        match (self.quantity.as_str(), self.unit.name) {
            ("", _) => String::new(),
            (quantity, "") => quantity.into(),
            (quantity, unit) => format!("{quantity} in {unit}"),
        }
    }

    /// From SI to the coordinate along the axis.
    fn shown(&self, value: f64) -> f64 {
        let value = value * self.unit.factor;
        match self.log {
            true if value > 0.0 => value.log10(),
            true => f64::NAN,
            false => value,
        }
    }

    /// The range along the axis, never empty and always finite.
    fn span(&self, data: &[f64], marks: &[f64]) -> (f64, f64) {
        let shown: Vec<f64> = data.iter().map(|&value| self.shown(value)).collect();
        let range = match self.range {
            Some(range) => {
                let (min, max) = (self.shown(range.min), self.shown(range.max));
                (min.is_finite() && max.is_finite() && min < max).then_some(Range::new(min, max))
            }
            None => {
                let marks: Vec<f64> = marks.iter().map(|&mark| self.shown(mark)).collect();
                let marks = Range::hull(&marks).map(|range| range.with_air(0.06));
                match (Range::of_axis(&shown), marks) {
                    (Some(data), Some(marks)) => Some(data.and(marks)),
                    (data, marks) => data.or(marks),
                }
            }
        };
        let Range { min, max } = range.unwrap_or(Range::new(0.0, 1.0));
        (min, max)
    }

    /// Where the gridlines stand, along the axis, and their labels; about `count` of them.
    fn ticks(&self, (min, max): (f64, f64), count: f64) -> Vec<(f64, String)> {
        let raw = (max - min) / count.max(1.0);
        if !(raw.is_finite() && raw > 0.0) {
            return Vec::new();
        }
        let decade = 10f64.powf(raw.log10().floor());
        let mut step = [1.0, 2.0, 5.0, 10.0].map(|times| times * decade).into_iter().find(|step| *step >= 0.999 * raw);
        if self.log {
            step = Some(raw.ceil());
        }
        let Some(step) = step.filter(|step| *step > 0.0) else { return Vec::new() };
        let (first, last) = ((min / step - 1e-9).ceil(), (max / step + 1e-9).floor());
        if !(first.is_finite() && last.is_finite() && last - first < 100.0) {
            return Vec::new();
        }
        let decimals = (-(step.log10() + 1e-9).floor()).clamp(0.0, 12.0) as usize;
        (0..=(last - first) as usize)
            .map(|index| {
                let at = (first + index as f64) * step;
                let label = if self.log {
                    significant(10f64.powf(at), 1)
                } else if !(1e-6..1e6).contains(&step) {
                    significant(at, 3)
                } else {
                    // Zero may come out as −0.
                    let at = if at.abs() < 0.5 * step { 0.0 } else { at };
                    format!("{at:.decimals$}").replace('-', "−")
                };
                (at, label)
            })
            .collect()
    }
}

/// A line through samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Line<'a> {
    /// Name in the legend; an empty one is not listed.
    pub name: String,
    /// Along the horizontal axis, SI.
    pub x: Cow<'a, [f64]>,
    /// Along the vertical axis, SI; samples beyond the shorter of the two do not count.
    pub y: Cow<'a, [f64]>,
    /// Colour.
    pub colour: Colour,
    /// Dashed, as references are.
    pub dashed: bool,
    /// Width in pixels.
    pub width_px: f64,
}

impl<'a> Line<'a> {
    /// A solid line.
    pub fn new(name: &str, x: impl Into<Cow<'a, [f64]>>, y: impl Into<Cow<'a, [f64]>>, colour: Colour) -> Line<'a> {
        Line { name: name.into(), x: x.into(), y: y.into(), colour, dashed: false, width_px: 1.5 }
    }

    /// The same, dashed.
    pub fn dashed(self) -> Line<'a> {
        Line { dashed: true, width_px: 1.3, ..self }
    }
}

/// A value or an instant to be told from the data.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// Where, SI.
    pub at: f64,
    /// What it is; stands outside the frame.
    pub label: String,
    /// Colour.
    pub colour: Colour,
}

impl Mark {
    /// A mark.
    pub fn new(at: f64, label: &str, colour: Colour) -> Mark {
        Mark { at, label: label.into(), colour }
    }
}

/// A plot, ready to be drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot<'a> {
    /// What it shows: the heading, and the name for those who hear the page.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Lines, the last on top.
    pub lines: Vec<Line<'a>>,
    /// Horizontal lines at values of `y`, labelled right of the frame.
    pub values: Vec<Mark>,
    /// Vertical lines at values of `x`, labelled above the frame.
    pub instants: Vec<Mark>,
    /// Width and height in pixels.
    pub size_px: (f64, f64),
    /// One scale for both axes, as an orbit wants; the range of one axis is widened.
    pub equal: bool,
}

/// A drawn plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    /// An `svg` element without declaration, to be put in a page or a file.
    pub svg: String,
    /// Sentences on what the drawing does not show; empty as a rule.
    pub notes: Vec<String>,
}

impl<'a> Plot<'a> {
    /// A plot of `size_px` without lines.
    pub fn new(title: &str, x: Axis, y: Axis, size_px: (f64, f64)) -> Plot<'a> {
        Plot {
            title: title.into(),
            x,
            y,
            lines: Vec::new(),
            values: Vec::new(),
            instants: Vec::new(),
            size_px,
            equal: false,
        }
    }

    /// Draws it. With nothing to show the frame stands empty and says so.
    pub fn draw(&self) -> Drawing {
        let layout = Layout::new(self);
        let mut svg = String::new();
        let notes = {
            let size = (layout.device(layout.width) as u32, layout.device(layout.height) as u32);
            let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
            // Writing to a string does not fail; if it ever does, the note stands in for what is missing.
            match self.draw_on(&area, &layout).and_then(|notes| area.present().map(|()| notes)) {
                Ok(notes) => notes,
                Err(error) => vec![format!("This plot is incomplete: {error}.")],
            }
        };
        // The backend's own opening tag states a size in device units.
        let body = svg.split_once('>').map_or("", |(_, body)| body);
        let svg = format!(
            "<svg class=\"plot\" xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">{}",
            layout.device(layout.width),
            layout.device(layout.height),
            escape(&self.title),
            body.replace(">\n", ">").replace(" \"", "\"").replace(" opacity=\"1\"", ""),
        );
        Drawing { svg, notes }
    }

    fn draw_on(&self, area: &Area, layout: &Layout) -> Result<Vec<String>, DrawError> {
        let frame = &layout.frame;
        let at = |x: f64, y: f64| (layout.device(x), layout.device(y));
        area.draw(&Rectangle::new([at(frame.left, frame.top), at(frame.right, frame.bottom)], WHITE.filled()))?;

        for (x, label) in &layout.x_ticks {
            let x = frame.left + layout.u(*x) * frame.width();
            area.draw(&path(vec![at(x, frame.top), at(x, frame.bottom)], GRID, 1.0))?;
            write(area, label, at(x, frame.bottom + 6.0), INK, TEXT_PX, (HPos::Center, VPos::Top), false)?;
        }
        for (y, label) in &layout.y_ticks {
            let y = frame.bottom - layout.v(*y) * frame.height();
            area.draw(&path(vec![at(frame.left, y), at(frame.right, y)], GRID, 1.0))?;
            write(area, label, at(frame.left - 6.0, y), INK, TEXT_PX, (HPos::Right, VPos::Center), false)?;
        }
        let middle = at(0.5 * (frame.left + frame.right), layout.height - 5.0);
        write(area, &self.x.title(), middle, INK, TEXT_PX, (HPos::Center, VPos::Bottom), false)?;
        let middle = at(4.0, 0.5 * (frame.top + frame.bottom));
        write(area, &self.y.title(), middle, INK, TEXT_PX, (HPos::Center, VPos::Top), true)?;
        write(area, &self.title, at(frame.left, 2.0), INK, TEXT_PX + 1.0, (HPos::Left, VPos::Top), false)?;

        for mark in &self.values {
            let v = layout.v(self.y.shown(mark.at));
            if (0.0..=1.0).contains(&v) {
                let y = layout.device(frame.bottom - v * frame.height());
                let ends = [(layout.device(frame.left), y), (layout.device(frame.right), y)];
                for dash in dashes(&ends, (2.0, 3.0)) {
                    area.draw(&path(dash, mark.colour.rgb(), 1.0))?;
                }
            }
        }
        for (mark, y) in &layout.value_labels {
            let place = at(frame.right + 5.0, *y);
            write(area, &mark.label, place, mark.colour.rgb(), TEXT_PX - 1.0, (HPos::Left, VPos::Center), false)?;
        }
        for mark in &self.instants {
            let u = layout.u(self.x.shown(mark.at));
            if (0.0..=1.0).contains(&u) {
                let x = frame.left + u * frame.width();
                let colour = mark.colour.rgb();
                area.draw(&path(vec![at(x, frame.top - 4.0), at(x, frame.bottom)], colour, 1.0))?;
                // The label leans to the side that has room.
                let side = match u {
                    u if u < 0.15 => HPos::Left,
                    u if u > 0.85 => HPos::Right,
                    _ => HPos::Center,
                };
                let place = at(x, frame.top - 6.0);
                write(area, &mark.label, place, colour, TEXT_PX - 1.0, (side, VPos::Bottom), false)?;
            }
        }

        let mut shown = false;
        let mut notes = Vec::new();
        let mut cut: Vec<&str> = Vec::new();
        let mut farthest: Option<(f64, f64)> = None;
        let mut missing: Vec<String> = Vec::new();
        for line in &self.lines {
            let trace = Trace::new(self, layout, line);
            shown |= !trace.pieces.is_empty() || !trace.dots.is_empty();
            let colour = line.colour.rgb();
            for piece in &trace.pieces {
                let points = simplified(piece);
                // A line that fills the frame would come to more dashes than anyone can see.
                if line.dashed && length(&points) < MOST_DASHES * (DASH_PX.0 + DASH_PX.1) * SCALE {
                    for dash in dashes(&points, DASH_PX) {
                        area.draw(&path(dash, colour, line.width_px))?;
                    }
                } else {
                    area.draw(&path(points, colour, line.width_px))?;
                }
            }
            for &dot in &trace.dots {
                area.draw(&Circle::new(dot, layout.device(line.width_px), colour.filled()))?;
            }
            if let Some(out) = trace.farthest {
                cut.push(&line.name);
                farthest = farthest.filter(|known| known.0 >= out.0).or(Some(out));
            }
            if trace.missing > 0 {
                missing.push(format!("{} ({} of {})", line.name, trace.missing, line.x.len().min(line.y.len())));
            }
        }
        // As a path, for the backend draws the edge of a rectangle in a width of its own.
        let (left_top, right_bottom) = (at(frame.left, frame.top), at(frame.right, frame.bottom));
        let corners = [left_top, (right_bottom.0, left_top.1), right_bottom, (left_top.0, right_bottom.1), left_top];
        area.draw(&path(corners.to_vec(), FRAME, 1.0))?;
        if !shown {
            let middle = at(0.5 * (frame.left + frame.right), 0.5 * (frame.top + frame.bottom));
            let text = "no values to show here";
            write(area, text, middle, Colour::Grey.rgb(), TEXT_PX, (HPos::Center, VPos::Center), false)?;
        }
        for (name, index, x, y) in &layout.legend {
            let line = &self.lines[*index];
            let sample = [at(*x, *y), at(x + 22.0, *y)];
            if line.dashed {
                for dash in dashes(&sample, DASH_PX) {
                    area.draw(&path(dash, line.colour.rgb(), line.width_px.max(1.6)))?;
                }
            } else {
                area.draw(&path(sample.to_vec(), line.colour.rgb(), line.width_px.max(2.0)))?;
            }
            write(area, name, at(x + 27.0, *y), INK, TEXT_PX, (HPos::Left, VPos::Center), false)?;
        }

        if let Some((_, value)) = farthest {
            let names = cut.iter().filter(|name| !name.is_empty()).copied().collect::<Vec<_>>().join(", ");
            let names = if names.is_empty() { "values".into() } else { names };
            notes.push(format!("Cut off at the frame: {names}, out to {}.", self.y.unit.show(value, 2)));
        }
        if !missing.is_empty() {
            notes.push(format!("Samples left out because they are no finite numbers: {}.", missing.join(", ")));
        }
        Ok(notes)
    }
}

type Area<'s> = DrawingArea<SVGBackend<'s>, Shift>;
type DrawError = DrawingAreaErrorKind<std::io::Error>;

fn stroke(colour: RGBColor, width_px: f64) -> ShapeStyle {
    ShapeStyle { color: colour.to_rgba(), filled: false, stroke_width: (width_px * SCALE).round() as u32 }
}

fn path(points: Vec<(i32, i32)>, colour: RGBColor, width_px: f64) -> PathElement<(i32, i32)> {
    PathElement::new(points, stroke(colour, width_px))
}

fn write(
    area: &Area,
    text: &str,
    at: (i32, i32),
    colour: RGBColor,
    size_px: f64,
    anchor: (HPos, VPos),
    upright: bool,
) -> Result<(), DrawError> {
    if text.is_empty() {
        return Ok(());
    }
    let text: String = text.chars().filter(|c| !c.is_control()).collect();
    // The backend divides by 1.24.
    let font = FontDesc::new(FontFamily::SansSerif, size_px * SCALE * 1.24, FontStyle::Normal);
    let font = if upright { font.transform(FontTransform::Rotate270) } else { font };
    let style = TextStyle::from(font).color(&colour).pos(Pos::new(anchor.0, anchor.1));
    area.draw(&Text::new(text, at, style))
}

/// `text` for an attribute or the body of an element.
fn escape(text: &str) -> String {
    let text: String = text.chars().filter(|c| !c.is_control()).collect();
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// How wide `text` is at most, in pixels.
fn width_px(text: &str, size_px: f64) -> f64 {
    // The circumflex of λ̂ stands above its letter.
    text.chars().filter(|c| !('\u{300}'..'\u{370}').contains(c)).count() as f64 * LETTER * size_px
}

/// The rectangle of the data, in pixels.
struct Frame {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

impl Frame {
    fn width(&self) -> f64 {
        self.right - self.left
    }

    fn height(&self) -> f64 {
        self.bottom - self.top
    }
}

/// Where everything stands, in pixels; and the ranges along the axes, in shown units.
struct Layout<'p> {
    width: f64,
    height: f64,
    frame: Frame,
    x: (f64, f64),
    y: (f64, f64),
    x_ticks: Vec<(f64, String)>,
    y_ticks: Vec<(f64, String)>,
    /// Name, index of the line, and place of each entry of the legend.
    legend: Vec<(&'p str, usize, f64, f64)>,
    /// Labels of the marked values and their heights, none upon another.
    value_labels: Vec<(&'p Mark, f64)>,
}

impl<'p> Layout<'p> {
    fn new(plot: &'p Plot) -> Layout<'p> {
        let (width, height) = (plot.size_px.0.clamp(160.0, 4000.0), plot.size_px.1.clamp(100.0, 4000.0));
        let label = plot.values.iter().map(|mark| width_px(&mark.label, TEXT_PX - 1.0)).fold(0.0, f64::max);
        let right = width - if label > 0.0 { (label + 9.0).min(0.4 * width) } else { RIGHT_PX };
        let bottom = height - if plot.x.quantity.is_empty() { BOTTOM_PX.1 } else { BOTTOM_PX.0 };

        let mut top = if plot.title.is_empty() { 4.0 } else { ROW_PX + 4.0 };
        let mut legend = Vec::new();
        let mut x = LEFT_PX;
        for (index, line) in plot.lines.iter().enumerate().filter(|(_, line)| !line.name.is_empty()) {
            let wide = 27.0 + width_px(&line.name, TEXT_PX) + 16.0;
            if x > LEFT_PX && x + wide > width {
                x = LEFT_PX;
                top += ROW_PX;
            }
            legend.push((line.name.as_str(), index, x, top + 0.5 * ROW_PX));
            x += wide;
        }
        if !legend.is_empty() {
            top += ROW_PX + 4.0;
        }
        if !plot.instants.is_empty() {
            top += ROW_PX;
        }
        let frame = Frame { left: LEFT_PX, top: top.min(bottom - 20.0), right, bottom };

        let gather = |pick: fn(&'p Line) -> &'p [f64]| -> Vec<f64> {
            plot.lines.iter().flat_map(|line| pick(line).iter().copied()).collect()
        };
        let values: Vec<f64> = plot.values.iter().map(|mark| mark.at).collect();
        let mut y = plot.y.span(&gather(|line| &line.y), &values);
        // Time starts and ends with the data: air would look like missing samples.
        let mut x = match plot.x.range {
            None if !plot.equal && !plot.x.log => {
                let data = gather(|line| &line.x);
                let hull = Range::hull(&data).filter(|range| range.min < range.max);
                plot.x.clone().from_to(hull).span(&data, &[])
            }
            _ => plot.x.span(&gather(|line| &line.x), &[]),
        };
        if plot.equal {
            let per_px = ((x.1 - x.0) / frame.width()).max((y.1 - y.0) / frame.height());
            let widened = |(min, max): (f64, f64), px: f64| {
                let (middle, half) = (0.5 * (min + max), 0.5 * per_px * px);
                (middle - half, middle + half)
            };
            (x, y) = (widened(x, frame.width()), widened(y, frame.height()));
        }
        let x_ticks = plot.x.ticks(x, frame.width() / 70.0);
        let y_ticks = plot.y.ticks(y, if plot.equal { frame.height() / 70.0 } else { frame.height() / 25.0 });

        let mut layout = Layout { width, height, frame, x, y, x_ticks, y_ticks, legend, value_labels: Vec::new() };
        layout.value_labels = layout.spread(plot);
        layout
    }

    /// The labels of the marked values, pushed apart where they would stand upon each other.
    fn spread(&self, plot: &'p Plot) -> Vec<(&'p Mark, f64)> {
        let mut labels: Vec<(&Mark, f64)> = plot
            .values
            .iter()
            .map(|mark| (mark, self.v(plot.y.shown(mark.at))))
            .filter(|(_, v)| (0.0..=1.0).contains(v))
            .map(|(mark, v)| (mark, self.frame.bottom - v * self.frame.height()))
            .collect();
        labels.sort_by(|a, b| a.1.total_cmp(&b.1));
        for _ in 0..50 {
            for index in 1..labels.len() {
                let lack = TEXT_PX + 1.0 - (labels[index].1 - labels[index - 1].1);
                if lack > 0.0 {
                    labels[index - 1].1 -= 0.5 * lack;
                    labels[index].1 += 0.5 * lack;
                }
            }
        }
        labels
    }

    fn device(&self, px: f64) -> i32 {
        (px * SCALE).round() as i32
    }

    /// Place along the horizontal axis, 0 at the left end and 1 at the right.
    fn u(&self, x: f64) -> f64 {
        ((x - self.x.0) / (self.x.1 - self.x.0)).clamp(-FAR, FAR)
    }

    /// Place along the vertical axis, 0 at the lower end and 1 at the upper.
    fn v(&self, y: f64) -> f64 {
        ((y - self.y.0) / (self.y.1 - self.y.0)).clamp(-FAR, FAR)
    }
}

/// A line made ready: thinned out, cut at the frame, in device units.
struct Trace {
    pieces: Vec<Vec<(i32, i32)>>,
    /// Samples without a neighbour.
    dots: BTreeSet<(i32, i32)>,
    /// How far the value furthest out of the range shown is beyond it, in frames, and that value, SI; if any is.
    farthest: Option<(f64, f64)>,
    /// How many samples are not finite.
    missing: usize,
}

impl Trace {
    fn new(plot: &Plot, layout: &Layout, line: &Line) -> Trace {
        let mut trace = Trace { pieces: Vec::new(), dots: BTreeSet::new(), farthest: None, missing: 0 };
        let mut run: Vec<(f64, f64)> = Vec::new();
        for (&x, &y) in line.x.iter().zip(line.y.iter()) {
            // A zero has no logarithm and yet is a number: it is cut off, not missing.
            trace.missing += usize::from(!(x.is_finite() && y.is_finite()));
            let (x_shown, y_shown) = (plot.x.shown(x), plot.y.shown(y));
            if x_shown.is_finite() && y_shown.is_finite() {
                let (u, v) = (layout.u(x_shown), layout.v(y_shown));
                // What goes down in decades goes to zero, which is no news.
                let beyond = if plot.y.log { v - 1.0 } else { (v - 1.0).max(-v) };
                if (0.0..=1.0).contains(&u) && beyond > trace.farthest.map_or(1e-9, |(known, _)| known) {
                    trace.farthest = Some((beyond, y));
                }
                run.push((u, v));
            } else {
                trace.add(layout, &run);
                run.clear();
            }
        }
        trace.add(layout, &run);
        trace
    }

    fn add(&mut self, layout: &Layout, run: &[(f64, f64)]) {
        let frame = &layout.frame;
        let device = |(u, v): (f64, f64)| {
            (layout.device(frame.left + u * frame.width()), layout.device(frame.bottom - v * frame.height()))
        };
        match run {
            [] => {}
            [(u, v)] => {
                if (0.0..=1.0).contains(u) && (0.0..=1.0).contains(v) {
                    // To the whole pixel, so that their number is bounded by the size of the plot.
                    let (x, y) = device((*u, *v));
                    let whole = SCALE as i32;
                    self.dots.insert((x / whole * whole, y / whole * whole));
                }
            }
            run => {
                let thin = thinned(run, frame.width());
                self.pieces.extend(clipped(&thin).iter().map(|piece| piece.iter().copied().map(device).collect()));
            }
        }
    }
}

/// A run of samples with no more than four of them per column of pixels: first, least, greatest, last. So peaks stay.
/// A run that goes back and forth is kept as it is.
fn thinned(run: &[(f64, f64)], columns: f64) -> Vec<(f64, f64)> {
    if run.windows(2).any(|pair| pair[1].0 < pair[0].0) {
        return run.to_vec();
    }
    let column = |index: usize| (run[index].0.clamp(-0.01, 1.01) * columns).floor();
    let mut kept = Vec::new();
    let mut start = 0;
    while start < run.len() {
        let mut end = start;
        let (mut least, mut greatest) = (start, start);
        while end < run.len() && column(end) == column(start) {
            if run[end].1 < run[least].1 {
                least = end;
            }
            if run[end].1 > run[greatest].1 {
                greatest = end;
            }
            end += 1;
        }
        let indices: BTreeSet<usize> = [start, least, greatest, end - 1].into();
        kept.extend(indices.into_iter().map(|index| run[index]));
        start = end;
    }
    kept
}

/// The parts of a line within the unit square.
fn clipped(line: &[(f64, f64)]) -> Vec<Vec<(f64, f64)>> {
    let mut pieces: Vec<Vec<(f64, f64)>> = Vec::new();
    let mut open = false;
    for pair in line.windows(2) {
        let Some((from, to)) = clipped_segment(pair[0], pair[1]) else {
            open = false;
            continue;
        };
        match pieces.last_mut() {
            Some(piece) if open => piece.push(to),
            _ => pieces.push(vec![from, to]),
        }
        open = to == pair[1];
    }
    pieces
}

/// The part of a segment within the unit square (Liang and Barsky), its ends untouched where they lie inside.
fn clipped_segment(from: (f64, f64), to: (f64, f64)) -> Option<((f64, f64), (f64, f64))> {
    let (dx, dy) = (to.0 - from.0, to.1 - from.1);
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for (p, q) in [(-dx, from.0), (dx, 1.0 - from.0), (-dy, from.1), (dy, 1.0 - from.1)] {
        if p == 0.0 {
            if q < 0.0 {
                return None;
            }
        } else if p < 0.0 {
            enter = enter.max(q / p);
        } else {
            leave = leave.min(q / p);
        }
    }
    let at = |t: f64| ((from.0 + t * dx).clamp(0.0, 1.0), (from.1 + t * dy).clamp(0.0, 1.0));
    (enter <= leave).then(|| (if enter > 0.0 { at(enter) } else { from }, if leave < 1.0 { at(leave) } else { to }))
}

/// A line without points that do not show: those nearer than a quarter of a pixel to the last one, and those on the way
/// straight from one to another.
fn simplified(points: &[(i32, i32)]) -> Vec<(i32, i32)> {
    let near = (0.25 * SCALE) as i32;
    let mut kept: Vec<(i32, i32)> = Vec::new();
    for (index, &point) in points.iter().enumerate() {
        if let Some(&last) = kept.last() {
            let end = index + 1 == points.len();
            if point == last || (!end && (point.0 - last.0).abs() <= near && (point.1 - last.1).abs() <= near) {
                continue;
            }
        }
        if let [.., before, last] = kept[..] {
            let (a, b) = ((last.0 - before.0, last.1 - before.1), (point.0 - last.0, point.1 - last.1));
            let straight = i64::from(a.0) * i64::from(b.1) == i64::from(a.1) * i64::from(b.0);
            let onward = i64::from(a.0) * i64::from(b.0) + i64::from(a.1) * i64::from(b.1) > 0;
            if straight && onward {
                kept.pop();
            }
        }
        kept.push(point);
    }
    if kept.len() == 1 {
        kept.push(kept[0]);
    }
    kept
}

fn length(points: &[(i32, i32)]) -> f64 {
    points.windows(2).map(|pair| f64::from(pair[1].0 - pair[0].0).hypot(f64::from(pair[1].1 - pair[0].1))).sum()
}

/// A line cut into dashes of `on` pixels with `off` pixels between them.
fn dashes(points: &[(i32, i32)], (on, off): (f64, f64)) -> Vec<Vec<(i32, i32)>> {
    let (on, off) = (on * SCALE, off * SCALE);
    let mut pieces = Vec::new();
    let mut dash: Vec<(i32, i32)> = points.first().copied().into_iter().collect();
    let (mut drawing, mut left) = (true, on);
    for pair in points.windows(2) {
        let (from, to) = ((f64::from(pair[0].0), f64::from(pair[0].1)), (f64::from(pair[1].0), f64::from(pair[1].1)));
        let length = (to.0 - from.0).hypot(to.1 - from.1);
        let mut done = 0.0;
        while length - done > left {
            done += left;
            let share = done / length;
            let at =
                ((from.0 + share * (to.0 - from.0)).round() as i32, (from.1 + share * (to.1 - from.1)).round() as i32);
            if drawing {
                dash.push(at);
                pieces.push(std::mem::take(&mut dash));
            } else {
                dash = vec![at];
            }
            drawing = !drawing;
            left = if drawing { on } else { off };
        }
        left -= length - done;
        if drawing {
            dash.push(pair[1]);
        }
    }
    if drawing && dash.len() > 1 {
        pieces.push(dash);
    }
    pieces
}
