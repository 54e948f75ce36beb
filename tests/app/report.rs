//! The report page: a single file that loads nothing, well-formed, reproducible, and faithful to the recording.

use crate::prelude::*;
use std::sync::LazyLock;

use base64::Engine;
use magnetic_bearing::report::plot::{Line, Plot, PlotUnit};
use quick_xml::Reader;
use quick_xml::events::Event as Xml;

/// Limit of the data, so that the page of a long run can be mailed and opens quickly.
const DATA_LIMIT_BYTES: usize = 2_000_000;

/// The paper's scenario and its run.
static PAPER: LazyLock<(Scenario, Run)> = LazyLock::new(|| scenario_and_run("paper", &[]));

/// The page of a run of the paper's scenario.
fn page_of(scenario: &Scenario, run: &Run) -> String {
    experiment::page("paper".as_ref(), "cargo run --release -- simulate 'my file.toml'", scenario, run)
}

/// The page of the paper's run.
static PAGE: LazyLock<String> = LazyLock::new(|| page_of(&PAPER.0, &PAPER.1));

/// The page of the paper's run after a change to its recording.
fn changed(change: impl FnOnce(&mut Recording)) -> String {
    let mut recording = PAPER.1.recording.clone();
    change(&mut recording);
    page_of(&PAPER.0, &Run { recording, error: None, messages: Vec::new() })
}

/// The page without the contents of its scripts; these contents, with their opening tags.
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

/// Parses the page as XML, in which only the void elements of HTML stay open; no element loads anything.
fn assert_elements_sound(html: &str) {
    const VOID: [&str; 3] = ["meta", "br", "input"];
    let mut reader = Reader::from_str(html);
    reader.config_mut().check_end_names = false;
    reader.config_mut().allow_unmatched_ends = true;
    let mut open: Vec<String> = Vec::new();
    loop {
        let position = reader.buffer_position();
        let event = reader.read_event().unwrap_or_else(|error| panic!("at byte {position}: {error}"));
        let start = match &event {
            Xml::Start(start) | Xml::Empty(start) => start,
            Xml::End(end) => {
                assert_eq!(open.pop(), Some(end.name().as_ref().to_string()), "closing tag at byte {position}");
                continue;
            }
            Xml::Eof => break,
            _ => continue,
        };
        let name = start.name().as_ref().to_string();
        let loads = ["link", "img", "iframe", "object", "embed", "base"].contains(&name.as_str());
        assert!(!loads, "<{name}> loads something");
        for attribute in start.html_attributes() {
            let attribute = attribute.unwrap_or_else(|error| panic!("{name} at byte {position}: {error}"));
            let (key, value) = (attribute.key.as_ref(), attribute.value);
            assert!(key != "src" && key != "srcset" && !key.starts_with("on"), "<{name} {key}=…>");
            assert!(!key.ends_with("href") || value.starts_with('#'), "<{name} {key}={value}>");
        }
        if matches!(event, Xml::Start(_)) && !VOID.contains(&name.as_str()) {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "never closed: {open:?}");
}

/// The data of every plot and of the animation.
fn data(page: &str) -> Vec<Json> {
    let (_, scripts) = taken_apart(page);
    let data = scripts.iter().filter(|(open, _)| open.contains("application/json"));
    data.map(|(_, text)| serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text:.80}"))).collect()
}

/// The page is well-formed, loads nothing, contains no address, and has valid data.
fn assert_sound(page: &str) {
    assert_sound_within(page, DATA_LIMIT_BYTES);
}

/// The same with a different limit of the data.
fn assert_sound_within(page: &str, limit_bytes: usize) {
    assert!(page.starts_with("<!DOCTYPE html>"));
    let (text, scripts) = taken_apart(page);
    assert_elements_sound(&text);
    for (open, script) in &scripts {
        assert!(!open.contains("src"), "{open}");
        assert!(!script.contains("://") && !script.contains("fetch(") && !script.contains("import("), "{open}");
    }
    let addresses = ["://", "url(", "@import"].iter().any(|sign| text.replace("url(#", "").contains(sign));
    assert!(!addresses, "the page names an address");
    let size: usize = scripts.iter().filter(|(open, _)| open.contains("json")).map(|(_, data)| data.len()).sum();
    assert!(size < limit_bytes, "{size} bytes of data, limit {limit_bytes}");
    data(page);
}

/// Unpacks numbers.
fn numbers(of: &Json, name: &str) -> Vec<f32> {
    let text = of[name]["bdata"].as_str().unwrap_or_else(|| panic!("no {name} in {of:.80}"));
    let bytes = base64::engine::general_purpose::STANDARD.decode(text).expect("base64");
    bytes.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().expect("four"))).collect()
}

/// The instants of a trace: evenly spaced ones are stored as the first and the spacing.
fn instants(trace: &Json) -> Vec<f32> {
    match (trace["x0"].as_f64(), trace["dx"].as_f64()) {
        (Some(x0), Some(dx)) => (0..numbers(trace, "y").len()).map(|at| (x0 + at as f64 * dx) as f32).collect(),
        _ => numbers(trace, "x"),
    }
}

/// The traces of this name in the plots within an element.
fn traces(part: &str, name: &str) -> Vec<Json> {
    let all = data(part).into_iter().flat_map(|plot| plot["data"].as_array().cloned().unwrap_or_default());
    all.filter(|trace| trace["name"] == name).collect()
}

/// The element with this name and id.
fn element<'p>(page: &'p str, name: &str, id: &str) -> &'p str {
    let start = page.find(&format!("<{name} id=\"{id}\">")).unwrap_or_else(|| panic!("no {name} {id}"));
    let end = page[start..].find(&format!("</{name}>")).unwrap();
    &page[start..start + end]
}

/// The figure with this id.
fn figure<'p>(page: &'p str, id: &str) -> &'p str {
    element(page, "figure", id)
}

/// The first screen.
fn answer(page: &str) -> &str {
    element(page, "section", "answer")
}

#[test]
fn the_page_is_complete_and_loads_nothing() {
    assert_sound(&PAGE);
    // Anchor, figures of the paper, plots.
    let expected = [
        ("methods", "the paper’s Fig. 2)", 3),
        ("errors", "", 3),
        ("condition", "", 1),
        ("tracking", "the paper’s Fig. 3;", 5),
        ("currents", "as Fig. 5 of the paper’s experiment)", 2),
        ("orbit", "as Figs. 11 and 12", 2),
        ("clearance", "", 1),
        ("unbalance", "", 1),
        ("sensitivity", "", 2),
    ];
    for (id, paper, plots) in expected {
        let figure = figure(&PAGE, id);
        assert!(figure.contains(paper), "{id}: {paper}");
        assert_eq!(data(figure).len(), plots, "{id}");
        assert!(PAGE.contains(&format!("href=\"#{id}\"")), "{id} is not in the contents");
    }
    assert_eq!(PAGE.matches("<figure").count(), expected.len());
    let table = "Tracking before and after the update";
    assert_contains(&PAGE, &[table, "<th scope=\"col\" class=\"number\">before", "<td class=\"number\">1.8000</td>"]);
    assert_contains(&PAGE, &["<details>", "<code>lambda[3]</code>", "simulate 'my file.toml'"]);
    // Both axes and the zones.
    let sensitivity = figure(&PAGE, "sensitivity");
    assert!(traces(sensitivity, "y").len() == 2 && traces(sensitivity, "z").len() == 2);
    assert_contains(&data(sensitivity)[0]["layout"]["shapes"].to_string(), &["zone A: below 3 (9.5 dB)"]);
    assert!(*PAGE == page_of(&PAPER.0, &run_to_end(&PAPER.0)), "the same run makes the same page");
}

#[test]
fn the_first_screen_states_the_answer_and_the_verdict() {
    let answer = answer(&PAGE);
    assert_contains(answer, &["Valid", "all tests pass", "1.8000 ± 0.0042", "truth 1.8000, error −0.0020 %"]);
    // The animation and one plot, before any table.
    assert_eq!(data(answer).len(), 2);
    assert!(PAGE.find("id=\"answer\"").unwrap() < PAGE.find("<table").unwrap());
    let animation = &data(answer)[0];
    assert_eq!(numbers(animation, "y").len(), 4001);
    assert_eq!(animation["events"][0][1], "update");
    // The best estimate comes first, then that of the controller. Each states its own limit; the load in phase with the trajectory affects
    // only the paper's method.
    let (best, used) = answer.split_once("The estimate that the controller uses").expect("a heading");
    assert_contains(best, &["<code>predictionError</code>", "below 5 %"]);
    assert_contains(used, &["<code>paper</code>", "below 25 %", "look like magnets weaker"]);
    assert!(!best.contains("<code>paper</code>") && !best.contains("look like magnets weaker"), "{best}");
    // A failed verdict is stated with its reason and time.
    let disabled = 3.0;
    let failed = changed(|recording| {
        for column in recording.columns.iter_mut().filter(|column| column.name.starts_with("predictionError.v")) {
            column.values[3000..].fill(if column.name.ends_with("verdict") { disabled } else { 0.0 });
        }
    });
    let words = ["Not valid", "since 0.3 s: the input enable is false", "It was valid until 0.2999 s"];
    assert_contains(self::answer(&failed), &words);
}

#[test]
fn the_data_are_those_of_the_recording() {
    let y = traces(figure(&PAGE, "tracking"), "position").remove(0);
    let (shown, recorded) = (numbers(&y, "y"), column(&PAPER.1, "plant.Y"));
    assert_eq!(shown.len(), recorded.len());
    for (shown, recorded) in shown.iter().zip(recorded) {
        assert!((f64::from(*shown) - recorded * 1e6).abs() < 1e-4, "{shown} µm, {recorded} m");
    }
    // Samples every 0.1 ms, from 0.
    assert!((y["dx"].as_f64().unwrap() - 0.1).abs() < 1e-9 && y["x0"] == 0.0);
    assert!(y["hovertemplate"].as_str().unwrap().ends_with("µm<extra></extra>"));
}

#[test]
fn invalid_estimates_are_dotted_and_events_are_marked() {
    let valid = column(&PAPER.1, "predictionError.valid").iter().position(|valid| *valid == 1.0).expect("valid");
    let valid_ms = valid as f32 / 10.0;
    let [solid, dotted] = ["λ̂₁", "λ̂₁ not valid"].map(|name| traces(answer(&PAGE), name).remove(0));
    assert!(solid["line"]["dash"] == "solid" && dotted["line"]["dash"] == "dot");
    let first = numbers(&solid, "y").iter().position(|value| value.is_finite()).unwrap();
    assert!(first.abs_diff(valid) <= 1, "{first}");
    let shown = instants(&dotted).into_iter().zip(numbers(&dotted, "y")).filter(|(_, value)| value.is_finite());
    let last = shown.map(|(time, _)| time).fold(0.0, f32::max);
    assert!((last - valid_ms).abs() < 0.05, "{last}");
    let plot = &data(answer(&PAGE))[1];
    let shapes = plot["layout"]["shapes"].as_array().unwrap();
    assert!(shapes.iter().any(|shape| shape["label"]["text"] == "update"));
    let shaded: Vec<_> = shapes.iter().filter(|shape| shape["type"] == "rect").collect();
    assert!(shaded.len() == 1 && shaded[0]["x0"] == 0.0, "{shaded:?}");
    assert!((shaded[0]["x1"].as_f64().unwrap() - f64::from(valid_ms)).abs() < 0.11, "{shaded:?}");
    // The band is ± two standard deviations wide.
    let band = plot["data"].as_array().unwrap().iter().find(|trace| trace["fill"] == "toself").expect("a band");
    let (x, y) = (numbers(band, "x"), numbers(band, "y"));
    let edges: Vec<f32> = x.iter().zip(&y).filter(|(at, _)| (**at - x[40]).abs() < 0.01).map(|(_, y)| *y).collect();
    let at = (10.0 * x[40]).round() as usize;
    let wanted = 4e6 * column(&PAPER.1, "predictionError.lambdaStdTotal[1]")[at] as f32;
    assert!(edges.len() == 2 && ((edges[0] - edges[1]).abs() - wanted).abs() < 1e-3, "{edges:?}, {wanted}");
}

#[test]
fn pages_of_other_scenarios_do_not_mention_the_paper() {
    let (scenario, run) = scenario_and_run("standstill", &[("duration", "0.05")]);
    let page = experiment::page("standstill".as_ref(), "", &scenario, &run);
    assert_sound(&page);
    let (text, _) = taken_apart(&page[page.find("<main>").unwrap()..page.find("id=\"parameters\"").unwrap()]);
    assert!(!text.to_lowercase().contains("paper"));
}

#[test]
fn a_run_without_update_or_with_a_change_of_speed_compares_nothing() {
    let (scenario, run) = scenario_and_run("paper", &[("update.mode", "never"), ("duration", "0.1")]);
    let page = page_of(&scenario, &run);
    assert_sound(&page);
    assert_eq!(traces(figure(&page, "orbit"), "End of the run").len(), 2);
    for absent in ["Before the update", "After the update", "Tracking before and after", "\">before"] {
        assert!(!page.contains(absent), "{absent}");
    }
    let faster = changed(|recording| {
        let speed = |t: &f64| if *t < 0.25 { TAU * 50.0 * t } else { TAU * (12.5 + 100.0 * (t - 0.25)) };
        let theta = recording.columns.iter_mut().find(|column| column.name == "plant.theta").expect("an angle");
        theta.values = recording.time_s.iter().map(speed).collect();
    });
    assert!(!faster.contains("Before the update") && PAGE.contains("Before the update"));
}

/// Fails if the note ignores the phase or the sign of the perturbation, or the end of the run.
#[test]
fn notes_appear_only_where_they_apply() {
    let short = [("duration", "0.05"), ("update.mode", "never")];
    for (change, is_in_phase, words) in [
        (("perturbation.phaseZ", "1 rad"), false, ""),
        (("perturbation.amplitudeZ", "2 N"), true, "look like magnets weaker by"),
        (("perturbation.amplitudeZ", "-2 N"), true, "look like magnets stronger by"),
    ] {
        let (scenario, run) = scenario_and_run("paper", &[&short[..], &[change]].concat());
        let note = experiment::tables("paper".as_ref(), &scenario, &run).remove(0).note;
        assert_eq!(note.contains("in phase"), is_in_phase, "{change:?}: {note}");
        assert!(note.contains(words) && !note.contains("its greatest error after"), "{change:?}: {note}");
    }
}

#[test]
fn a_sentence_replaces_a_figure_without_values() {
    for (gone, id) in [(["plant.F", "plant.im"], "currents"), (["predictionError.lambda", "paper"], "errors")] {
        let page = changed(|recording| {
            for column in &mut recording.columns {
                if gone.iter().any(|start| column.name.starts_with(start)) {
                    column.values.fill(f64::NAN);
                }
            }
        });
        assert_sound(&page);
        let figure = figure(&page, id);
        assert!(figure.contains("Not drawn: the recording has no usable") && data(figure).is_empty(), "{id}");
    }
}

#[test]
fn short_runs_and_invalid_values_are_drawn() {
    for duration in ["1e-4", "3e-4", "0.015"] {
        let (scenario, run) = scenario_and_run("paper", &[("duration", duration), ("update.mode", "never")]);
        assert_sound(&page_of(&scenario, &run));
    }
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, 1e-300] {
        assert_sound(&changed(|recording| {
            for column in &mut recording.columns {
                column.values.iter_mut().skip(700).step_by(97).for_each(|sample| *sample = value);
            }
        }));
    }
}

#[test]
fn the_page_of_a_long_run_is_thinned() {
    let repeated = changed(|recording| {
        recording.time_s = (0..100_000).map(|at| f64::from(at) * 1e-4).collect();
        for column in &mut recording.columns {
            column.values = column.values.iter().copied().cycle().take(100_000).collect();
        }
    });
    // Every method and every plot.
    assert_sound_within(&repeated, 2_500_000);
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
fn text_is_escaped() {
    let (mut scenario, run) = scenario_and_run("standstill", &[("duration", "0.01")]);
    let text = "a < b & \"c\" </script><script>";
    (scenario.title, scenario.description) = (text.into(), text.into());
    let page = experiment::page(text.as_ref(), text, &scenario, &Run { error: Some(text.into()), ..run });
    assert_sound(&page);
    assert_contains(&page, &["a &lt; b &amp; &quot;c&quot;"]);
}
