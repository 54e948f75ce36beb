//! The machine to identify: its scenario, changed by the arguments.

use std::path::Path;

use super::{Arguments, LIKELIHOOD, PREDICTION_ERROR, Pairs, Result, SLOW_FORCE, refused, report_errors};
use crate::fmu::find;
use crate::machine::{self, AXIAL, Machine, PLANAR};
use crate::simulation::scenario::{Scenario, knows, names, suggestion};

/// Variables of the estimator that have their own options.
const OPTIONS: [(&str, &str); 7] = [
    ("Ts", "the times of the recording, --rate or --step"),
    ("Tf", "--window"),
    ("epsilon", "--window"),
    ("method", "--method"),
    ("hold", "--hold"),
    ("sensor.positionNoise", "--position-noise"),
    ("sensor.currentNoise", "--current-noise"),
];

/// The name of an estimator variable without its element.
pub(super) fn without_element(path: &str) -> &str {
    path.strip_prefix("estimator.").unwrap_or(path)
}

impl Arguments {
    /// The machine from the option or from the scenario.
    pub(super) fn machine(&self) -> &'static Machine {
        let named = self.machine.as_deref().and_then(machine::find);
        named.or_else(|| Scenario::machine_of(self.scenario.as_deref()?)).unwrap_or_default()
    }

    /// Known loads stated by `--set`, and its other settings.
    pub(super) fn loads(&self, machine: &Machine) -> (Pairs, Pairs) {
        let loads = machine.of_coordinates(|coordinate| coordinate.load);
        self.changes.iter().cloned().partition(|(name, _)| loads.contains(name))
    }

    /// A message for each option that does not apply to the machine, or not with the other options.
    pub(super) fn unused(&self, machine: &Machine) -> Vec<String> {
        let (is_axial, is_planar, method) = (*machine == AXIAL, *machine == PLANAR, self.method.as_str());
        let has_none = |option: &str| format!("the machine {} has no {option}", machine.name);
        let is_usual = [LIKELIHOOD, PREDICTION_ERROR].contains(&method);
        let (is_on_line, has_several) = (method != LIKELIHOOD, self.recordings.len() > 1);
        let options = [
            (is_axial && self.speed.is_some(), has_none("--speed: an axis does not rotate")),
            (!is_planar && self.window.is_some(), has_none("--window")),
            (is_axial && is_on_line, has_none("--method but likelihood")),
            (!is_axial && !is_planar && !is_usual, has_none("--method but likelihood and predictionError")),
            (!is_axial && self.at.is_some(), "--at needs --machine axial".into()),
            (has_several && self.currents.is_some(), "--currents needs a single recording".into()),
            (!is_axial && has_several && is_on_line, format!("--method {method} needs a single recording")),
            (
                self.check.is_some() && (self.currents.is_some() || (!is_axial && is_on_line)),
                format!("--check needs --method {LIKELIHOOD}, and currents in the recording"),
            ),
        ];
        options.into_iter().filter(|(is_unused, _)| *is_unused).map(|(_, words)| words).collect()
    }

    /// The scenario of the machine, with its changes.
    pub(super) fn bearing(&self, machine: &Machine) -> Result<Scenario> {
        let mut wrong = self.unused(machine);
        let (_, changes) = self.loads(machine);
        let (slow, changes): (Vec<_>, Vec<_>) = changes.into_iter().partition(|(path, _)| path == SLOW_FORCE);
        if let Some((_, value)) = slow.iter().find(|(_, value)| value != "0") {
            wrong.push(format!("--set {SLOW_FORCE}={value}: expected 0, or --estimate force.slow"));
        }
        if !slow.is_empty() && self.estimates.iter().any(|name| name == SLOW_FORCE) {
            wrong.push(format!("{SLOW_FORCE} is both set and estimated"));
        }
        let estimator = find(machine.models[2].0).expect("a model of this project");
        for (path, value) in &changes {
            let name = without_element(path);
            if let Some((_, option)) = OPTIONS.iter().find(|(variable, _)| *variable == name) {
                wrong.push(format!("--set {path}: identify takes it from {option}"));
            } else if !knows(&estimator, name) {
                let suggestion = suggestion(name, &names(&[&estimator]));
                wrong.push(format!(
                    "--set {path}: the estimator of the machine has no variable of this name; {suggestion}"
                ));
            } else if value.is_empty() {
                wrong.push(format!("--set {path}=: expected a value"));
            }
        }
        report_errors(&wrong)?;
        let built_in = if *machine == PLANAR { "unbalanced" } else { machine.name };
        let path = self.scenario.as_deref().unwrap_or(Path::new(built_in));
        let scenario = Scenario::open_parameters(path, &changes)?;
        if scenario.machine != machine {
            let (given, other, path) = (machine.name, scenario.machine.name, path.display());
            return Err(refused(format!("--machine {given}: the scenario {path} describes the machine {other}")));
        }
        Ok(scenario)
    }
}
