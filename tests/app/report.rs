//! The report page: one file that loads nothing, well-formed, reproducible, and robust against any recording.

use std::f64::consts::{PI, TAU};

use base64::Engine;
use magnetic_bearing::report::experiment;
use magnetic_bearing::report::plot::{Line, Plot, PlotUnit};
use magnetic_bearing::report::{
    Answer, ComparedEstimator, Event, Paper, Parameter, Report, Scene, SensitivityCurves, page,
};
use magnetic_bearing::simulation::recording::{Column, Recording};
use magnetic_bearing::simulation::scenario::Scenario;
use magnetic_bearing::simulation::simulate;
use magnetic_bearing::table::Table;
use quick_xml::Reader;
use quick_xml::events::Event as Xml;
use serde_json::Value as Json;

const TS_S: f64 = 1e-4;
const UPDATE_S: f64 = 0.2;
const LAMBDA: [f64; 3] = [1.8e-6, 2.0e-6, 2.2e-6];
/// Limit of the data, so that the page of a long run can be mailed and opens at once.
const DATA_LIMIT_BYTES: usize = 2_000_000;

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
    add("plant.theta", "rad", &|_, t| theta(t));
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
        add(&format!("plant.F[{k}]"), "N", &|_, t| 30.0 + 9.0 * (theta(t) + phase).sin());
        add(&format!("estimator.lambdaStdTotal[{k}]"), "N.m2/A2", &|_, t| 1e-7 * (-t * 10.0).exp());
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

fn method(element: &str, label: &str) -> ComparedEstimator {
    ComparedEstimator { element: element.into(), label: label.into() }
}

fn report(recording: &Recording) -> Report<'_> {
    let words = |cells: &[&str]| cells.iter().map(|cell| cell.to_string()).collect::<Vec<_>>();
    Report {
        description: "The simulation of the paper.\n\nA rotor on three magnets, λ < 4·10⁻⁶ & unknown.".into(),
        command: "cargo run --release -- simulate 'my file.toml' --report out".into(),
        answers: vec![Answer {
            element: "estimator".into(),
            method: "predictionError".into(),
            valid: false,
            verdict: "since 0.3 s: the innovations are not white.".into(),
            lambda: LAMBDA.map(|lambda| Some([1.01 * lambda, 2e-9])).into(),
            limit: 0.05,
            expectation: "One per cent too much is to be expected.".into(),
        }],
        tables: vec![Table {
            title: "The paper and this run".into(),
            note: "Numbers of the paper are read from its text.".into(),
            head: words(&["quantity", "paper", "ours", "where"]),
            rows: vec![
                words(&["λ̂₁", "1.786·10⁻⁶", "1.80·10⁻⁶ N·m²/A²", "Fig. 2, simulation"]),
                words(&["peak-to-peak value of p̂_z, before over after", "≥ 3", "27.4", "Figs. 8 and 10"]),
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
        events: vec![Event { at_s: UPDATE_S, label: "update".into() }],
        truth: Some(LAMBDA.into()),
        methods: vec![
            method("paperLiteral", "P(20) literally"),
            method("paper", "Paper: P(20), signs aligned"),
            method("other", "Another method"),
            method("estimator", "Prediction errors"),
        ],
        clearance_m: vec![2.5e-4],
        scene: Some(Scene::Bearing { alpha_rad: vec![PI, -PI / 3.0, PI / 3.0], gap_m: 5e-4 }),
        paper: Some(Paper::Simulation),
        ..Report::new("Delpoux and Floquet, redrawn", recording)
    }
}

/// An element with its attributes.
type Element = (String, Vec<(String, String)>);

/// The page without the contents of its scripts, and these contents with their opening tags.
fn taken_apart(page: &str) -> (String, Vec<(&str, &str)>) {
    let (mut text, mut scripts, mut rest) = (String::new(), Vec::new(), page);
    while let Some(start) = rest.find("<script") {
        let open = start + rest[start..].find('>').unwrap() + 1;
        let end = open + rest[open..].find("</script>").unwrap();
        text += &rest[..open];
        scripts.push((&rest[start..open], &rest[open..end]));
        rest = &rest[end..];
    }
    (text + rest, scripts)
}

/// Parses the page as XML, where only the void elements of HTML stay open; returns every element.
fn elements(html: &str) -> Vec<Element> {
    const VOID: [&str; 3] = ["meta", "br", "input"];
    let mut reader = Reader::from_str(html);
    reader.config_mut().check_end_names = false;
    reader.config_mut().allow_unmatched_ends = true;
    let (mut open, mut found): (Vec<String>, Vec<Element>) = (Vec::new(), Vec::new());
    loop {
        let position = reader.buffer_position();
        let event = reader.read_event().unwrap_or_else(|error| panic!("at byte {position}: {error}"));
        let (start, empty) = match event {
            Xml::Start(start) => (start, false),
            Xml::Empty(start) => (start, true),
            Xml::End(end) => {
                let name = end.name().as_ref().to_string();
                assert_eq!(open.pop(), Some(name), "closing tag at byte {position}");
                continue;
            }
            Xml::Eof => break,
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

/// The data of every plot, and those of the animation.
fn data(page: &str) -> Vec<Json> {
    let (_, scripts) = taken_apart(page);
    let data = scripts.iter().filter(|(open, _)| open.contains("application/json"));
    data.map(|(_, text)| serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text:.80}"))).collect()
}

/// Well-formed, loads nothing, contains no address, and its data are valid.
fn assert_sound(page: &str) {
    assert!(page.starts_with("<!DOCTYPE html>"));
    let (text, scripts) = taken_apart(page);
    for (name, attributes) in elements(&text) {
        assert!(
            !["link", "img", "iframe", "object", "embed", "base"].contains(&name.as_str()),
            "<{name}> loads something"
        );
        for (key, value) in attributes {
            assert!(key != "src" && key != "srcset" && !key.starts_with("on"), "<{name} {key}=…>");
            assert!(!key.ends_with("href") || value.starts_with('#'), "<{name} {key}={value}>");
        }
    }
    for (open, script) in &scripts {
        assert!(!open.contains("src"), "{open}");
        assert!(!script.contains("://") && !script.contains("fetch(") && !script.contains("import("), "{open}");
    }
    let addresses = ["://", "url(", "@import"].iter().any(|sign| text.replace("url(#", "").contains(sign));
    assert!(!addresses, "the page names an address");
    let size: usize = scripts.iter().filter(|(open, _)| open.contains("json")).map(|(_, data)| data.len()).sum();
    assert!(size < DATA_LIMIT_BYTES, "{size} bytes of data, limit {DATA_LIMIT_BYTES}");
    data(page);
}

/// Numbers as they are packed.
fn numbers(of: &Json, name: &str) -> Vec<f32> {
    let text = of[name]["bdata"].as_str().unwrap_or_else(|| panic!("no {name} in {of:.80}"));
    let bytes = base64::engine::general_purpose::STANDARD.decode(text).expect("base64");
    bytes.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().expect("four"))).collect()
}

/// The instants of a trace, which are told by the first and their distance where they are even.
fn instants(trace: &Json) -> Vec<f32> {
    match (trace["x0"].as_f64(), trace["dx"].as_f64()) {
        (Some(x0), Some(dx)) => (0..numbers(trace, "y").len()).map(|at| (x0 + at as f64 * dx) as f32).collect(),
        _ => numbers(trace, "x"),
    }
}

/// The traces of that name of the plots within an element.
fn traces(part: &str, name: &str) -> Vec<Json> {
    let all = data(part).into_iter().flat_map(|plot| plot["data"].as_array().cloned().unwrap_or_default());
    all.filter(|trace| trace["name"] == name).collect()
}

/// The element `figure` of that id.
fn figure<'p>(page: &'p str, id: &str) -> &'p str {
    let start = page.find(&format!("<figure id=\"{id}\">")).unwrap_or_else(|| panic!("no figure {id}"));
    let end = page[start..].find("</figure>").unwrap();
    &page[start..start + end]
}

/// The first screen.
fn answer(page: &str) -> &str {
    let start = page.find("<section id=\"answer\">").expect("an answer");
    &page[start..start + page[start..].find("</section>").unwrap()]
}

#[test]
fn the_page_holds_everything_and_loads_nothing() {
    let recording = recording(4001);
    let page = page(&report(&recording));
    assert_sound(&page);
    // Anchor, figures of the paper, plots.
    let expected = [
        ("methods", "the paper’s Fig. 2)", 4),
        ("errors", "", 4),
        ("condition", "", 1),
        ("tracking", "the paper’s Fig. 3;", 5),
        ("currents", "as Fig. 5 of the paper’s experiment)", 2),
        ("orbit", "as Figs. 11 and 12", 2),
        ("clearance", "", 1),
    ];
    for (id, paper, plots) in expected {
        let figure = figure(&page, id);
        assert!(figure.contains(paper), "{id}: {paper}");
        assert_eq!(data(figure).len(), plots, "{id}");
        assert!(page.contains(&format!("href=\"#{id}\"")), "{id} is not in the contents");
    }
    assert_eq!(page.matches("<figure").count(), expected.len());
    assert!(page.contains("The paper and this run") && page.contains("<td class=\"number\">27.4</td>"));
    assert!(page.contains("λ &lt; 4·10⁻⁶ &amp; unknown"));
    assert!(page.contains("<details>") && page.contains("lambda[3]"));
    assert!(page.contains("cargo run --release -- simulate 'my file.toml' --report out"));
}

#[test]
fn the_first_screen_states_the_answer_and_the_verdict() {
    let recording = recording(4001);
    let page = page(&report(&recording));
    let answer = answer(&page);
    for text in [
        "Not valid",
        "the innovations are not white",
        "1.8180 ± 0.0040",
        "truth 1.8000, error +1.00 %",
        "is to be expected",
    ] {
        assert!(answer.contains(text), "{text}");
    }
    // The animation and one plot, before any table.
    assert_eq!(data(answer).len(), 2);
    assert!(page.find("id=\"answer\"").unwrap() < page.find("<table").unwrap());
    let animation = &data(answer)[0];
    assert_eq!(numbers(animation, "y").len(), 4001);
    assert_eq!(animation["events"][0][1], "update");
}

#[test]
fn the_data_are_those_of_the_recording() {
    let recording = recording(4001);
    let page = page(&report(&recording));
    let y = traces(figure(&page, "tracking"), "position").remove(0);
    let (shown, is) = (numbers(&y, "y"), recording.get("plant.Y").unwrap());
    assert_eq!(shown.len(), is.len());
    for (shown, is) in shown.iter().zip(is) {
        assert!((f64::from(*shown) - is * 1e6).abs() < 1e-4, "{shown} µm, {is} m");
    }
    // Every sample 0.1 ms after the other, from 0.
    assert!((y["dx"].as_f64().unwrap() - 0.1).abs() < 1e-9 && y["x0"] == 0.0);
    assert!(y["hovertemplate"].as_str().unwrap().ends_with("µm<extra></extra>"));
}

#[test]
fn what_is_not_valid_is_dotted_and_what_happened_is_marked() {
    let recording = recording(4001);
    let page = page(&report(&recording));
    let solid = traces(answer(&page), "λ̂₁").remove(0);
    let dotted = traces(answer(&page), "λ̂₁ not valid").remove(0);
    assert!(solid["line"]["dash"] == "solid" && dotted["line"]["dash"] == "dot");
    // Valid from 30 ms on.
    let first = numbers(&solid, "y").iter().position(|value| value.is_finite()).unwrap();
    assert!(first.abs_diff(300) <= 1, "{first}");
    let y = numbers(&dotted, "y");
    let shown = instants(&dotted).into_iter().zip(y).filter(|(_, value)| value.is_finite());
    let last = shown.map(|(time, _)| time).fold(0.0, f32::max);
    assert!((29.95..30.05).contains(&last), "{last}");
    let plot = &data(answer(&page))[1];
    let shapes = plot["layout"]["shapes"].as_array().unwrap();
    assert!(shapes.iter().any(|shape| shape["label"]["text"] == "update"));
    let shaded: Vec<_> = shapes.iter().filter(|shape| shape["type"] == "rect").collect();
    assert!(
        shaded.len() == 1 && shaded[0]["x0"] == 0.0 && (shaded[0]["x1"].as_f64().unwrap() - 30.0).abs() < 0.11,
        "{shaded:?}"
    );
    // The band is two standard deviations wide, either way.
    let band = plot["data"].as_array().unwrap().iter().find(|trace| trace["fill"] == "toself").expect("a band");
    let (x, y) = (numbers(band, "x"), numbers(band, "y"));
    let at = |time: f32| -> Vec<f32> {
        x.iter().zip(&y).filter(|(x, _)| (**x - time).abs() < 0.01).map(|(_, y)| *y).collect()
    };
    let edges = at(x[40]);
    let wanted = 4.0 * 0.1 * (-x[40] * 0.01).exp();
    assert!(edges.len() == 2 && ((edges[0] - edges[1]).abs() - wanted).abs() < 1e-3, "{edges:?}, {wanted}");
}

#[test]
fn the_best_estimate_leads_and_that_of_the_controller_stands_beside_it() {
    let scenario = Scenario::open(std::path::Path::new("paper")).expect("a built-in scenario");
    let run = simulate::run(&scenario).expect("a run");
    let page = experiment::page(std::path::Path::new("paper"), "", &scenario, &run);
    let answer = answer(&page);
    let [best, used] =
        ["<code>predictionError</code>", "<code>paper</code>"].map(|method| answer.find(method).expect(method));
    let beside = answer.find("the estimate that the controller uses").expect("a heading");
    assert!(best < beside && beside < used);
    // Each states its own limit; the load in phase with the trajectory is a matter of the paper's method alone.
    assert!(answer[..beside].contains("below 5 %") && answer[beside..].contains("below 25 %"));
    assert!(
        !answer[..beside].contains("look like magnets weaker") && answer[beside..].contains("look like magnets weaker")
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
    let methods = vec![method("estimator", "estimator")];
    let report = Report {
        paper: None,
        tables: vec![],
        parameters: vec![],
        methods,
        description: String::new(),
        ..report(&recording)
    };
    let page = page(&report);
    let (text, _) = taken_apart(&page[page.find("<main>").unwrap()..]);
    assert!(!text.to_lowercase().contains("paper"));
}

#[test]
fn a_run_without_update_compares_nothing() {
    let mut never = recording(4001);
    for column in never.columns.iter_mut().filter(|column| column.name.starts_with("controller.lambdaUsed")) {
        column.values.fill(4e-6);
    }
    let page = page(&Report { events: vec![], ..report(&never) });
    assert_eq!(traces(figure(&page, "orbit"), "End of the run").len(), 2);
    assert!(!page.contains("Before the update") && !page.contains("After the update"));
}

#[test]
fn another_speed_in_the_end_compares_nothing() {
    let mut faster = recording(4001);
    for column in faster.columns.iter_mut().filter(|column| column.name == "plant.theta") {
        let speed = |t: f64| if t < 0.25 { TAU * 50.0 * t } else { TAU * (12.5 + 100.0 * (t - 0.25)) };
        column.values = faster.time_s.iter().map(|t| speed(*t)).collect();
    }
    assert!(!page(&report(&faster)).contains("Before the update"));
    let steady = recording(4001);
    assert!(page(&report(&steady)).contains("Before the update"));
}

/// The pages of whole runs, tables included.
#[test]
fn tables_of_an_update_need_an_update() {
    let run = |text: &str| {
        let scenario = Scenario::parse("test", text).expect("a scenario");
        let run = simulate::run(&scenario).expect("a run");
        experiment::page("test".as_ref(), "the command", &scenario, &run)
    };
    let text = |mode: &str| {
        format!(
            "title = \"T\"\nduration = \"0.26 s\"\nstep = \"100 µs\"\n[controller]\nupdate.mode = \"{mode}\"\nupdate.time = \"0.2 s\"\n"
        )
    };
    let with = run(&text("atTime"));
    assert_sound(&with);
    assert!(
        with.contains("Tracking before and after the update")
            && with.contains("<th scope=\"col\" class=\"number\">before")
    );
    assert!(answer(&with).contains("Valid") && answer(&with).contains("All tests pass".to_lowercase().as_str()));
    let without = run(&text("never"));
    assert_sound(&without);
    assert!(!without.contains("Tracking before and after") && !without.contains("\">before"));
}

#[test]
fn the_sensitivity_plots_show_both_axes_and_the_zones() {
    let recording = recording(1000);
    let curve = |rise: f64| (1..50).map(|n| [f64::from(n) * 10.0, 1.0 + rise * f64::from(n)]).collect();
    let axes = vec![("y".to_owned(), curve(0.01)), ("z".to_owned(), curve(0.0))];
    let one = SensitivityCurves { name: "after".into(), axes, missing: None };
    let page = page(&Report { sensitivities: vec![one], ..report(&recording) });
    let figure = figure(&page, "sensitivity");
    assert!(traces(figure, "y").len() == 1 && traces(figure, "z").len() == 1);
    let shapes = data(figure)[0]["layout"]["shapes"].as_array().unwrap().clone();
    assert!(shapes.iter().any(|shape| shape["label"]["text"] == "zone A: below 3 (9.5 dB)"));
}

#[test]
fn missing_columns_leave_out_their_figure_with_a_sentence() {
    let full = recording(1000);
    for (gone, id) in [("plant.im", "currents"), ("estimator.lambda", "methods")] {
        let mut recording = full.clone();
        recording.columns.retain(|column| !column.name.starts_with(gone) && !column.name.starts_with("plant.F"));
        let page = page(&Report { methods: vec![method("estimator", "estimator")], ..report(&recording) });
        assert_sound(&page);
        assert!(figure(&page, id).contains("Not drawn: the recording has no usable"), "{id} without {gone}");
        assert!(data(figure(&page, id)).is_empty(), "{id} without {gone}");
    }
    // No single column is indispensable.
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
        assert_sound(&page(&report(&some)));
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
    assert_sound(&page(&report(&recording(100_000))));
}

#[test]
fn thinning_keeps_a_single_peak() {
    let x: Vec<f64> = (0..100_000).map(f64::from).collect();
    let mut y: Vec<f64> = x.iter().map(|x| (x * 0.7).sin()).collect();
    y[54_321] = 5.0;
    let mut plot = Plot::over_time(PlotUnit::SECOND, ("y", PlotUnit::ONE));
    plot.line(Line::new("line", "--ink"), &x, &y);
    let trace = traces(&plot.html().into_string(), "line").remove(0);
    let (x, y) = (numbers(&trace, "x"), numbers(&trace, "y"));
    assert!(x.len() < 5000, "{} points", x.len());
    let peaks: Vec<f32> = x.iter().zip(&y).filter(|(_, y)| **y > 1.5).map(|(x, _)| *x).collect();
    assert_eq!(peaks, [54_321.0]);
    assert!(x.is_sorted());
}

#[test]
fn text_of_any_kind_is_harmless() {
    let recording = recording(200);
    let mut report = report(&recording);
    let text = "a < b & \"c\" </script><script>";
    report.title = text.into();
    report.methods[0].label = text.into();
    report.events[0].label = text.into();
    assert_sound(&page(&report));
}
