//! The report as a page: self-contained, well-formed, small, the same every time, and drawn whatever the recording holds.

use std::f64::consts::TAU;

use magnetic_bearing::app::plot::{Axis, Colour, Line, Mark, Plot, Range, Unit, significant};
use magnetic_bearing::app::recording::{Column, Recording};
use magnetic_bearing::app::report::{Method, Parameter, Report, Table, page};
use quick_xml::Reader;
use quick_xml::events::Event;

const TS_S: f64 = 1e-4;
const UPDATE_S: f64 = 0.2;
const LAMBDA: [f64; 3] = [1.8e-6, 2.0e-6, 2.2e-6];
/// A page is to go by mail and to open at once.
const SIZE_LIMIT_BYTES: usize = 2_000_000;

/// Noise between −1 and 1 from an integer, the same everywhere.
fn noise(index: usize, signal: usize) -> f64 {
    let mut word = (index as u64 * 64 + signal as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    word ^= word >> 29;
    word = word.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (word >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Signals shaped like those of the paper's run: an elliptic orbit at 3000 rpm, the update at 0.2 s.
fn recording(samples: usize) -> Recording {
    let time_s: Vec<f64> = (0..samples).map(|index| index as f64 * TS_S).collect();
    let mut columns: Vec<Column> = Vec::new();
    let mut add = |name: &str, unit: &str, value: &dyn Fn(usize, f64) -> f64| {
        let values = time_s.iter().enumerate().map(|(index, &t)| value(index, t)).collect();
        columns.push(Column { name: name.into(), unit: unit.into(), values });
    };
    let theta = |t: f64| TAU * 50.0 * t;
    let before = |t: f64| if t < UPDATE_S { 1.0 } else { 0.06 };
    let error_y = |i: usize, t: f64| 1.5e-6 * before(t) * (2.0 * theta(t)).cos() + 0.08e-6 * noise(i, 0);
    let error_z = |i: usize, t: f64| 3.4e-6 * before(t) * (theta(t) + 0.4).cos() + 0.08e-6 * noise(i, 1);
    add("plant.theta", "rad", &|_, t| theta(t) % TAU);
    add("controller.reference.Y", "m", &|_, t| 30e-6 * theta(t).cos());
    add("controller.reference.Z", "m", &|_, t| 70e-6 * theta(t).sin());
    add("plant.Y", "m", &|i, t| 30e-6 * theta(t).cos() + error_y(i, t));
    add("plant.Z", "m", &|i, t| 70e-6 * theta(t).sin() + error_z(i, t));
    add("controller.eY", "m", &error_y);
    add("controller.eZ", "m", &error_z);
    add("plant.perturbation.Y", "N", &|_, t| 5.0 + theta(t).cos());
    add("plant.perturbation.Z", "N", &|_, t| 10.0 + 2.0 * theta(t).sin());
    add("controller.pYHat", "N", &|i, t| 5.0 + theta(t).cos() + 20.0 * before(t) * theta(t).sin() + noise(i, 2));
    add("controller.pZHat", "N", &|i, t| 10.0 + 2.0 * theta(t).sin() + 50.0 * before(t) * theta(t).sin() + noise(i, 3));
    for k in 1..=3 {
        let phase = TAU / 3.0 * k as f64;
        add(&format!("plant.im[{k}]"), "A", &|i, t| 2.2 + 0.9 * (theta(t) + phase).sin() + 0.01 * noise(i, 3 + k));
        let lambda = LAMBDA[k - 1];
        add(&format!("controller.lambdaUsed[{k}]"), "N.m2/A2", &|_, t| if t < UPDATE_S { 4e-6 } else { lambda });
        let settles = |t: f64, start: f64| if t < 0.02 { 4e-6 } else { lambda + start * (-(t - 0.02) * 60.0).exp() };
        let ripple = |t: f64, share: f64| 1.0 + share * (theta(t) + phase).sin();
        add(&format!("estimator.lambdaHat[{k}]"), "N.m2/A2", &|_, t| settles(t, 1e-7) * ripple(t, 1e-4));
        add(&format!("other.lambdaHat[{k}]"), "N.m2/A2", &|_, t| settles(t, 4e-7) * ripple(t, 5e-3));
        add(&format!("paper.lambdaHat[{k}]"), "N.m2/A2", &|_, t| settles(t, 9e-7) * ripple(t, 0.03));
        let diverges = |t: f64| settles(t, 0.0) * (1.0 + 0.02 / (0.2503 - t) * (t / 0.1).powi(2));
        add(&format!("paperLiteral.lambdaHat[{k}]"), "N.m2/A2", &|_, t| diverges(t));
    }
    add("estimator.valid", "", &|_, t| if t < 0.03 { 0.0 } else { 1.0 });
    add("paperLiteral.valid", "", &|_, _| 0.0);
    add("estimator.condition", "", &|_, t| 8.0 + 2.0 * (2.0 * theta(t)).sin());
    add("paper.condition", "", &|_, t| 80.0 + 60.0 * (2.0 * theta(t)).sin());
    Recording { time_s, columns }
}

fn method(element: &str, label: &str) -> Method {
    Method { element: element.into(), label: label.into() }
}

fn report(recording: &Recording) -> Report<'_> {
    let words = |cells: &[&str]| cells.iter().map(|cell| cell.to_string()).collect::<Vec<_>>();
    Report {
        description: "The simulation of the paper.\n\nA rotor on three magnets, λ < 4·10⁻⁶ & unknown.".into(),
        command: "magnetic-bearing run scenarios/paper.toml --report report.html".into(),
        tables: vec![Table {
            title: "The paper and this run".into(),
            note: "Numbers of the paper are read from its text.".into(),
            head: words(&["quantity", "paper", "ours", "where"]),
            rows: vec![
                words(&["λ̂₁", "1.786·10⁻⁶", "1.80·10⁻⁶ N·m²/A²", "Fig. 2, simulation"]),
                words(&["swing of p̂_z, before over after", "≥ 3", "27.4", "Figs. 8 and 10"]),
            ],
        }],
        parameters: (1..=3)
            .map(|k| Parameter {
                group: "plant".into(),
                name: format!("lambda[{k}]"),
                value: "1.8·10⁻⁶ N·m²/A²".into(),
                description: "Magnet constant".into(),
            })
            .collect(),
        update_s: Some(UPDATE_S),
        truth: Some(LAMBDA),
        methods: vec![
            method("paperLiteral", "P(20) to the letter"),
            method("paper", "Paper: P(20), signs aligned"),
            method("other", "Another method"),
            method("estimator", "Prediction errors"),
        ],
        paper: true,
        ..Report::new("Delpoux and Floquet, redrawn", recording)
    }
}

/// An element with its attributes.
type Element = (String, Vec<(String, String)>);

/// Reads the page as XML, where only the void elements of HTML stay open; gives every element.
fn elements(html: &str) -> Vec<Element> {
    const VOID: [&str; 2] = ["meta", "br"];
    let mut reader = Reader::from_str(html);
    reader.config_mut().check_end_names = false;
    reader.config_mut().allow_unmatched_ends = true;
    let (mut open, mut found): (Vec<String>, Vec<Element>) = (Vec::new(), Vec::new());
    loop {
        let position = reader.buffer_position();
        let event = reader.read_event().unwrap_or_else(|error| panic!("at byte {position}: {error}"));
        let (start, empty) = match event {
            Event::Start(start) => (start, false),
            Event::Empty(start) => (start, true),
            Event::End(end) => {
                let name = end.name().as_ref().to_string();
                assert_eq!(open.pop(), Some(name), "closing tag at byte {position}");
                continue;
            }
            Event::Eof => break,
            _ => continue,
        };
        let name = start.name().as_ref().to_string();
        let attributes = start.html_attributes().map(|attribute| {
            let attribute = attribute.unwrap_or_else(|error| panic!("{name} at byte {position}: {error}"));
            (attribute.key.as_ref().to_string(), attribute.value.to_string())
        });
        let attributes = attributes.collect();
        if !empty && !VOID.contains(&name.as_str()) {
            open.push(name.clone());
        }
        found.push((name, attributes));
    }
    assert!(open.is_empty(), "never closed: {open:?}");
    found
}

/// The text is well-formed, and numbers in the attributes of its drawings are numbers.
fn assert_sound(html: &str) {
    const NUMBERS: [&str; 10] = ["points", "viewBox", "x", "y", "cx", "cy", "r", "width", "height", "stroke-width"];
    for (name, attributes) in elements(html) {
        for (key, value) in attributes.iter().filter(|(key, _)| NUMBERS.contains(&key.as_str())) {
            for number in value.split([',', ' ']).filter(|text| !text.is_empty()) {
                assert!(number.parse::<f64>().is_ok_and(f64::is_finite), "{name} {key}: {number}");
            }
        }
    }
}

/// The element `figure` of that id.
fn figure<'p>(page: &'p str, id: &str) -> &'p str {
    let start = page.find(&format!("<figure id=\"{id}\">")).unwrap_or_else(|| panic!("no figure {id}"));
    let end = page[start..].find("</figure>").unwrap();
    &page[start..start + end]
}

#[test]
fn the_page_holds_everything_and_loads_nothing() {
    let recording = recording(4001);
    let page = page(&report(&recording));
    // Left for whoever wants to look at it.
    std::fs::write(concat!(env!("CARGO_TARGET_TMPDIR"), "/report.html"), &page).unwrap();

    assert!(page.starts_with("<!DOCTYPE html>"));
    assert!(page.len() < SIZE_LIMIT_BYTES, "{} bytes, limit {SIZE_LIMIT_BYTES}", page.len());
    assert_sound(&page);
    const LOADING: [&str; 10] =
        ["script", "link", "img", "iframe", "object", "embed", "image", "use", "source", "base"];
    for (name, attributes) in elements(&page) {
        assert!(!LOADING.contains(&name.as_str()), "<{name}> loads something");
        for (key, value) in attributes {
            assert!(key != "src" && key != "srcset" && !key.starts_with("on"), "<{name} {key}=…>");
            assert!(!key.ends_with("href") || value.starts_with('#'), "<{name} {key}={value}>");
            assert!(key == "xmlns" || !value.contains("://"), "<{name} {key}={value}>");
        }
    }
    assert!(!page.contains("url(") && !page.contains("@import"), "the style loads something");
}

#[test]
fn every_figure_is_there_with_its_plots() {
    let recording = recording(4001);
    let page = page(&report(&recording));
    // Anchor, figures of the paper, plots.
    let expected = [
        ("lambda", "the paper’s Fig. 2)", 4),
        ("lambda-error", "", 4),
        ("condition", "", 1),
        ("tracking", "the paper’s Fig. 3)", 3),
        ("currents", "the paper’s Fig. 5)", 2),
        ("axis-y", "the paper’s Figs. 7 and 9)", 6),
        ("axis-z", "the paper’s Figs. 8 and 10)", 6),
        ("orbit", "the paper’s Figs. 11 and 12)", 4),
    ];
    for (id, paper, plots) in expected {
        let figure = figure(&page, id);
        assert!(figure.contains(paper), "{id}: {paper}");
        assert_eq!(figure.matches("<svg").count(), plots, "{id}");
        assert!(!figure.contains("no values to show"), "{id}");
        assert!(page.contains(&format!("href=\"#{id}\"")), "{id} is not in the contents");
    }
    assert_eq!(page.matches("<figure").count(), expected.len());
    assert!(page.contains("The paper and this run") && page.contains("<td class=\"number\">27.4</td>"));
    assert!(page.contains("λ &lt; 4·10⁻⁶ &amp; unknown"));
    assert!(page.contains("<details>") && page.contains("lambda[3]"));
    assert!(page.contains("magnetic-bearing run scenarios/paper.toml"));
    // Two revolutions are 40 ms.
    assert!(figure(&page, "axis-z").contains("After the update: 360.0 to 400.0 ms"));
    assert!(figure(&page, "axis-z").contains("Before the update: 159.9 to 199.9 ms"));
    assert!(figure(&page, "lambda").contains("update at 0.2 s"));
    assert!(figure(&page, "lambda").contains("Valid by its own account from 0.03 s<"));
    assert!(figure(&page, "lambda").contains("Never valid by its own account"));
}

#[test]
fn captions_state_what_the_data_say() {
    let recording = recording(4001);
    let page = page(&report(&recording));
    let axis = figure(&page, "axis-z");
    let number = |after: &str| {
        let text = axis.split(after).nth(1).unwrap_or_else(|| panic!("no {after:?}"));
        let words: Vec<&str> = text.split_whitespace().collect();
        // For instance: 3.5 µm before and 0.28 µm after
        (words[0].parse::<f64>().unwrap(), words[4].parse::<f64>().unwrap())
    };
    // The amplitudes of `recording`, each less or more by its noise and by the rounding to two digits.
    let near = |(before, after): (f64, f64), expected: (f64, f64), slack: f64| {
        assert!((before - expected.0).abs() <= slack && (after - expected.1).abs() <= slack, "{before}, {after}");
    };
    near(number("Largest error of z: "), (3.4, 0.204), 0.09);
    near(number("Swing of the estimated perturbation: "), (2.0 * 52.0, 2.0 * 5.0), 2.0);
    near(number("Largest distance from the true one: "), (50.0, 3.0), 1.0);
    // What leaves the frame is told.
    assert!(
        figure(&page, "lambda").contains("P(20) to the letter: cut off at the frame: λ̂₁, λ̂₂, λ̂₃, out to −2800·10⁻⁶")
    );
}

#[test]
fn the_same_run_makes_the_same_page() {
    let (first, second) = (recording(2500), recording(2500));
    assert_eq!(page(&report(&first)), page(&report(&second)));
}

#[test]
fn without_the_paper_nothing_speaks_of_it() {
    let recording = recording(4001);
    let methods = vec!["estimator".into()];
    let report = Report { paper: false, tables: vec![], parameters: vec![], methods, ..report(&recording) };
    let page = page(&report);
    let main = &page[page.find("<main>").unwrap()..];
    assert!(!main.to_lowercase().contains("paper"));
}

#[test]
fn a_run_without_update_shows_its_end() {
    let mut recording = recording(4001);
    recording.columns.retain(|column| !column.name.starts_with("controller.lambdaUsed"));
    let page = page(&Report { update_s: None, ..report(&recording) });
    assert!(figure(&page, "axis-z").contains("End of the run: 360.0 to 400.0 ms"));
    assert_eq!(figure(&page, "axis-z").matches("<svg").count(), 3);
    assert!(!page.contains("update at"));
}

#[test]
fn the_stretches_shown_follow_the_rotor() {
    let mut recording = recording(4001);
    // 1000 rpm: two revolutions take 120 ms. The angle comes within one turn, as angles may.
    for column in recording.columns.iter_mut().filter(|column| column.name == "plant.theta") {
        column.values = recording.time_s.iter().map(|t| (TAU * t / 0.06) % TAU).collect();
    }
    let page = page(&report(&recording));
    assert!(figure(&page, "axis-z").contains("After the update: 280.0 to 400.0 ms"));
}

#[test]
fn the_update_is_where_the_controller_made_it() {
    let mut recording = recording(4001);
    // Planned before the estimate was valid.
    let early = page(&Report { update_s: Some(0.1), ..report(&recording) });
    assert!(early.contains("update at 0.2 s") && !early.contains("update at 0.1 s"));
    for column in &mut recording.columns {
        if column.name.starts_with("controller.lambdaUsed") {
            column.values.fill(4e-6);
        }
    }
    let never = page(&report(&recording));
    assert!(!never.contains("update at") && never.contains("did not take an estimate"));
}

#[test]
fn missing_columns_leave_out_their_figure_with_a_sentence() {
    let full = recording(1000);
    for (gone, id) in [
        ("plant.Z", "tracking"),
        ("plant.Y", "orbit"),
        ("plant.Z", "axis-z"),
        ("plant.im", "currents"),
        ("estimator.lambda", "lambda"),
    ] {
        let mut recording = full.clone();
        recording.columns.retain(|column| !column.name.starts_with(gone));
        let page = page(&Report { methods: vec!["estimator".into()], ..report(&recording) });
        assert_sound(&page);
        assert!(figure(&page, id).contains("Not drawn: the recording has no usable"), "{id} without {gone}");
        assert!(!figure(&page, id).contains("<svg"), "{id} without {gone}");
    }
    // And no single column is indispensable to the page.
    for index in 0..full.columns.len() {
        let mut recording = full.clone();
        recording.columns.remove(index);
        assert_sound(&page(&report(&recording)));
    }
}

#[test]
fn empty_and_short_recordings_are_drawn() {
    let empty = Recording::default();
    assert!(page(&report(&empty)).contains("The recording is empty."));
    for samples in [0, 1, 2, 3, 150] {
        assert_sound(&page(&report(&recording(samples))));
    }
    // Instants without values and values without instants.
    let mut ragged = recording(500);
    for (index, column) in ragged.columns.iter_mut().enumerate() {
        column.values.resize(100 * (index % 8), 1.0);
    }
    assert_sound(&page(&report(&ragged)));
}

#[test]
fn broken_values_are_drawn_as_far_as_they_go() {
    let wild = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN, f64::MIN_POSITIVE, 0.0, -0.0, 1e-300];
    for value in wild {
        let mut all = recording(1500);
        all.columns.iter_mut().for_each(|column| column.values.fill(value));
        assert_sound(&page(&report(&all)));
        let mut some = recording(3000);
        for column in &mut some.columns {
            column.values.iter_mut().skip(700).step_by(97).for_each(|sample| *sample = value);
        }
        let page = page(&report(&some));
        assert_sound(&page);
        assert!(page.len() < SIZE_LIMIT_BYTES, "{value}: {} bytes", page.len());
        if !value.is_finite() {
            assert!(figure(&page, "tracking").contains("Samples left out because they are no finite numbers"));
        }
    }
    let mut instants = recording(300);
    instants.time_s[100..].fill(f64::NAN);
    assert_sound(&page(&report(&instants)));
    let mut standing = recording(300);
    standing.time_s.fill(0.0);
    assert_sound(&page(&report(&standing)));
}

#[test]
fn a_long_run_makes_no_longer_page() {
    let recording = recording(100_000);
    let page = page(&report(&recording));
    assert!(page.len() < SIZE_LIMIT_BYTES, "{} bytes, limit {SIZE_LIMIT_BYTES}", page.len());
}

/// A plot of a single line without a name.
fn plot<'a>(x: &'a [f64], y: &'a [f64]) -> Plot<'a> {
    let mut plot = Plot::new("", Axis::new("", Unit::ONE), Axis::new("", Unit::ONE), (600.0, 300.0));
    plot.lines.push(Line::new("", x, y, Colour::Blue));
    plot
}

/// The points of the blue lines, in tenths of a pixel.
fn points(svg: &str) -> Vec<(i32, i32)> {
    let mut found = Vec::new();
    for (name, attributes) in elements(svg) {
        let get = |key: &str| attributes.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str());
        if name == "polyline" && get("stroke") == Some("#0072B2") {
            for pair in get("points").unwrap().split_whitespace() {
                let (x, y) = pair.split_once(',').unwrap();
                found.push((x.parse().unwrap(), y.parse().unwrap()));
            }
        }
    }
    found
}

#[test]
fn thinning_keeps_a_single_peak() {
    let x: Vec<f64> = (0..100_000).map(f64::from).collect();
    let mut y: Vec<f64> = x.iter().map(|x| (x * 0.7).sin()).collect();
    y[54_321] = 5.0;
    let mut plot = plot(&x, &y);
    plot.y.range = Some(Range::new(-6.0, 6.0));
    let points = points(&plot.draw().svg);
    assert!(points.len() < 4 * 600, "{} points", points.len());
    let top = points.iter().min_by_key(|(_, y)| *y).unwrap();
    let others = points.iter().filter(|point| point.1 < top.1 + 500).count() - 1;
    assert_eq!(others, 0, "the peak is one sample");
    // The frame reaches from 66 to 586 pixels across, and from 4 to 276 down.
    let expected = (660.0 + 5200.0 * 54_321.0 / 99_999.0, 40.0 + 2720.0 / 12.0);
    assert!((f64::from(top.0) - expected.0).abs() < 2.0, "{top:?}, expected {expected:?}");
    assert!((f64::from(top.1) - expected.1).abs() < 2.0, "{top:?}, expected {expected:?}");
}

#[test]
fn lines_are_cut_where_they_cross_the_frame() {
    let (x, y) = ([0.0, 1.0], [-1.0, 2.0]);
    let mut plot = plot(&x, &y);
    plot.y.range = Some(Range::new(0.0, 1.0));
    let points = points(&plot.draw().svg);
    // From a third to two thirds of the width.
    assert_eq!(points.len(), 2, "{points:?}");
    assert!((points[0].0 - 660 - 1733).abs() <= 1 && (points[1].0 - 660 - 3467).abs() <= 1, "{points:?}");
    plot.lines[0].name = "line".into();
    assert_eq!(plot.draw().notes, ["Cut off at the frame: line, out to −1.0."]);
    plot.lines[0].name = String::new();
    plot.lines[0].y = vec![2.0, 3.0].into();
    assert!(self::points(&plot.draw().svg).is_empty(), "nothing of this line is within the frame");
}

#[test]
fn an_orbit_keeps_its_shape() {
    let angle: Vec<f64> = (0..=400).map(|i| TAU * f64::from(i) / 400.0).collect();
    let (y, z): (Vec<f64>, Vec<f64>) = angle.iter().map(|a| (30e-6 * a.cos(), 70e-6 * a.sin())).unzip();
    let mut plot = plot(&y, &z);
    plot.equal = true;
    plot.size_px = (520.0, 480.0);
    let points = points(&plot.draw().svg);
    let extent = |pick: fn(&(i32, i32)) -> i32| {
        f64::from(points.iter().map(pick).max().unwrap() - points.iter().map(pick).min().unwrap())
    };
    let ratio = extent(|point| point.1) / extent(|point| point.0);
    assert!((ratio - 70.0 / 30.0).abs() < 0.01, "{ratio}");
}

#[test]
fn outliers_do_not_flatten_the_rest() {
    let mut values: Vec<f64> = (0..1000).map(|i| (f64::from(i) * 0.1).sin()).collect();
    values[500] = 1e9;
    values[501] = f64::NAN;
    let range = Range::of_axis(&values).unwrap();
    assert!(range.max < 10.0 && range.min > -10.0 && range.min < -1.0, "{range:?}");
    assert_eq!(Range::of_axis(&[]), None);
    assert_eq!(Range::of_axis(&[f64::NAN]), None);
    let one = Range::of_axis(&[3.0]).unwrap();
    assert!(one.min < 3.0 && one.max > 3.0);
}

#[test]
fn marks_outside_the_range_and_text_of_any_kind_are_harmless() {
    let axis = |name| Axis::new(name, Unit::ONE);
    let mut plot = Plot::new("a < b & \"c\"\u{0}", axis("<x>"), axis("y"), (0.0, f64::NAN));
    plot.y.range = Some(Range::new(0.0, 1.0));
    plot.values = [f64::NAN, 7.0, 0.5, 0.5].map(|at| Mark::new(at, "<mark>", Colour::Ink)).into();
    plot.instants = vec![Mark::new(f64::INFINITY, "never", Colour::Ink)];
    let drawing = plot.draw();
    assert_sound(&drawing.svg);
    assert!(drawing.svg.contains("no values to show here") && !drawing.svg.contains("never"));
}

#[test]
fn numbers_read_as_an_engineer_writes_them() {
    let cases = [
        (9.99, 2, "10"),
        (0.096, 1, "0.1"),
        (-3.146, 3, "−3.15"),
        (1.786e-6, 3, "1.79·10⁻⁶"),
        (123456.0, 3, "123000"),
        (2.5e7, 2, "2.5·10⁷"),
        (0.0, 3, "0"),
        (f64::NEG_INFINITY, 3, "−∞"),
    ];
    for (value, digits, expected) in cases {
        assert_eq!(significant(value, digits), expected, "{value} with {digits}");
    }
    assert_eq!(Unit::LAMBDA.show(2.072e-6, 4), "2.072·10⁻⁶ N·m²/A²");
}
