//! What came out of a run, as a document for other programs.

use serde_json::{Map, Value as Json, json};

use crate::fmu::estimator::METHOD;
use crate::simulation::scenario::Scenario;
use crate::simulation::simulate::Run;
use fmu_export::variable::Value;

/// The run as JSON: what was run, whether it came to its end, the estimates of every method at the end beside the truth, and
/// last, least and greatest value of every output. Values are in the units of the interface.
#[must_use]
pub fn json(scenario: &Scenario, run: &Run) -> Json {
    let truth = [1, 2, 3].map(|k| scenario.value("plant", &format!("lambda[{k}]")).map(Value::as_f64));
    let estimates = scenario.elements[2..].iter().map(|element| {
        let last = |name: &str| run.recording.get(&format!("{}.{name}", element.name))?.last().copied();
        let of_magnets = |name: &str| [1, 2, 3].map(|k| last(&format!("{name}[{k}]")));
        let hat = of_magnets("lambdaHat");
        let error = [0, 1, 2].map(|k| Some(hat[k]? / truth[k]? - 1.0));
        let method = scenario.value(&element.name, "method").and_then(|value| METHOD.item(value.as_f64() as i32));
        json!({
            "element": element.name,
            "method": method,
            "lambdaHat": hat,
            "lambdaStd": of_magnets("lambdaStd"),
            "lambdaStdTotal": of_magnets("lambdaStdTotal"),
            "error": error,
            "valid": last("valid").map(|valid| valid == 1.0),
        })
    });
    let outputs: Map<_, _> = run
        .recording
        .columns
        .iter()
        .map(|column| {
            let all = || column.values.iter().copied();
            let (least, greatest) = (all().reduce(f64::min), all().reduce(f64::max));
            let figures = json!({"unit": column.unit, "last": all().last(), "least": least, "greatest": greatest});
            (column.name.clone(), figures)
        })
        .collect();
    json!({
        "title": scenario.title,
        "changes": scenario.changes,
        "duration": scenario.duration_s,
        "step": scenario.step_s,
        "end": run.recording.time_s.last(),
        "complete": run.fault.is_none(),
        "fault": run.fault,
        "messages": run.messages,
        "lambda": truth,
        "estimates": estimates.collect::<Vec<_>>(),
        "outputs": outputs,
    })
}
