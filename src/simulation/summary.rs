//! The results of a run, as JSON for other programs.

use serde_json::{Map, Value as Json, json};

use crate::simulation::{Column, Run, Scenario};

/// The run as JSON: scenario, whether the run was completed, the final estimates of every method with the true values, and the
/// last, smallest and largest value of every output. Values are in the units of the interface; unused magnets have no estimates.
pub fn json(scenario: &Scenario, run: &Run) -> Json {
    let truth = scenario.truth();
    let estimates = scenario.elements[2..].iter().map(|element| {
        let last = |name: &str| run.recording.get(&format!("{}.{name}", element.name))?.last().copied();
        let of_magnets = |name: &str| {
            let of_magnet = |(k, name): (usize, &String)| last(name).filter(|_| scenario.uses(k));
            scenario.machine.of_magnets(name).iter().enumerate().map(of_magnet).collect::<Vec<_>>()
        };
        let hat = of_magnets("lambdaHat");
        let error: Vec<_> = hat.iter().zip(&truth).map(|(hat, truth)| Some((*hat)? / truth - 1.0)).collect();
        json!({
            "element": element.name,
            "method": scenario.method(&element.name),
            "lambdaHat": hat,
            "lambdaStd": of_magnets("lambdaStd"),
            "lambdaStdTotal": of_magnets("lambdaStdTotal"),
            "error": error,
            "valid": last("valid").map(|valid| valid == 1.0),
        })
    });
    let figures = |column: &Column| {
        let all = || column.values.iter().copied();
        let (least, greatest) = (all().reduce(f64::min), all().reduce(f64::max));
        let figures = json!({"unit": column.unit, "last": all().last(), "least": least, "greatest": greatest});
        (column.name.clone(), figures)
    };
    let outputs: Map<_, _> = run.recording.columns.iter().map(figures).collect();
    json!({
        "title": scenario.title,
        "changes": scenario.changes,
        "duration": scenario.duration_s,
        "step": scenario.step_s,
        "end": run.recording.time_s.last(),
        "complete": run.error.is_none(),
        "error": run.error,
        "messages": run.messages,
        "lambda": truth,
        "estimates": estimates.collect::<Vec<_>>(),
        "outputs": outputs,
    })
}
