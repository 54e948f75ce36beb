//! The answer in words, tables and JSON.

use std::ops::Range;

use serde_json::{Value as Json, json};

use super::Answer;
use crate::machine::Bearing;
use crate::studies::identify::likelihood::{self, BenchEstimate, BenchParameter, Identification, Knowledge};
use crate::studies::identify::{Statement, significant};
use crate::table::Table;
use crate::variables::Choice;

/// Note below the first budget.
const SENSITIVITIES: &str = "The sensitivities say by how much λ is wrong if the parameter differs from its stated value. Contributions of typical tolerances are of \
     what the data do not exclude.";

/// Factor and name of the unit in which a parameter is shown.
pub fn shown(parameter: &BenchParameter) -> (f64, &'static str) {
    match parameter.unit {
        "1" => (0.01, "%"),
        // Positions along a shaft are not sensor errors.
        "m" if parameter.typical > 1e-4 => (1e-3, "mm"),
        "m" => (1e-6, "µm"),
        "rad" => (std::f64::consts::PI / 180.0, "°"),
        "s" => (1e-6, "µs"),
        "A" => (1e-3, "mA"),
        _ => (1.0, "N"),
    }
}

impl Answer {
    /// The answer in words, numbers and JSON.
    pub fn statement(&self) -> Statement {
        Statement {
            valid: Some(self.valid),
            verdict: self.verdict.clone(),
            findings: self.findings.clone(),
            assumptions: self.assumptions(),
            tables: self.tables(),
            json: self.json(),
        }
    }

    /// Parameters taken as known.
    fn assumptions(&self) -> String {
        let stated = &self.question.stated;
        let hold = stated.hold.name();
        let mut words = format!("Taken as known: {}, currents {hold}", stated.descriptions().join(", "));
        for parameter in stated.bench() {
            let (factor, unit) = shown(parameter);
            match parameter.knowledge {
                Knowledge::Exact => {}
                Knowledge::Tolerance(std) => {
                    words += &format!(", {} ± {} {unit}", parameter.name, significant(std / factor, 3));
                }
                Knowledge::Free => words += &format!(", {} free", parameter.name),
            }
        }
        words + "."
    }

    /// Estimates, bench and budget as tables.
    fn tables(&self) -> Vec<Table> {
        let Some(found) = &self.found else { return Vec::new() };
        let of_bearings = self.question.stated.machine.magnets_of_bearings();
        let budgets = of_bearings.into_iter().map(|(bearing, magnets)| budget(found, bearing, magnets));
        let all = [self.estimates(found), bench(found)].into_iter().chain(budgets);
        all.filter(|table| !table.rows.is_empty()).collect()
    }

    fn estimates(&self, found: &Identification) -> Table {
        let row = |name: String, of: &likelihood::Estimate, factor: f64, unit: &str, typical: Option<f64>| {
            let [value, noise, total] = of.cells(factor);
            let typical = typical.map_or(String::new(), |std| significant(std / factor, 2));
            vec![name, value, noise, total, typical, unit.to_owned()]
        };
        let stated = &self.question.stated;
        let mut rows = Vec::new();
        for ((name, lambda), typical) in
            stated.machine.symbols("λ").into_iter().zip(&found.lambda).zip(&found.typical_std)
        {
            rows.push(row(name, lambda, 1e-6, "10⁻⁶ N·m²/A²", Some(typical * lambda.value.abs())));
        }
        for (plane, unbalance) in (1..).zip(&found.unbalance) {
            let number = if found.unbalance.len() > 1 { plane.to_string() } else { String::new() };
            rows.push(row(format!("U{number}"), &unbalance.magnitude, 1e-6, "g·mm", None));
            rows.push(row(format!("φ{number}"), &unbalance.phase, 1.0, "rad", None));
        }
        for (r, conditions) in found.conditions.iter().enumerate() {
            let of = if found.conditions.len() > 1 { format!(", {}", r + 1) } else { String::new() };
            let (ki, ks) = (&conditions.ki_n_a, &conditions.ks_n_m);
            for (symbol, all, factor, unit) in [("ki", ki, 1.0, "N/A"), ("ks", ks, 1e3, "N/mm")] {
                let named = stated.machine.symbols(symbol).into_iter().zip(all);
                rows.extend(named.map(|(name, own)| row(format!("{name}{of}"), own, factor, unit, None)));
            }
            for (name, load) in stated.loads().iter().zip(&conditions.load_n) {
                let unit = if name.starts_with('M') { "N·m" } else { "N" };
                rows.push(row(format!("{name}{of}"), load, 1.0, unit, None));
            }
            let noise = |name: &str, value: f64, unit: &str| {
                [&format!("{name}{of}"), &*significant(value, 3), "", "", "", unit].map(String::from).to_vec()
            };
            for (prefix, part) in stated.machine.of_parts("").iter().zip(&conditions.parts) {
                rows.push(noise(&format!("{prefix}noise of positions"), 1e6 * part.position_noise_m, "µm"));
                rows.push(noise(&format!("{prefix}noise of currents"), 1e3 * part.current_noise_a, "mA"));
                if let Some(power) = &part.noise_exponent {
                    rows.push(row(format!("{prefix}power of the gap{of}"), power, 1.0, "", None));
                }
                if part.slow_force_n > 0.0 {
                    rows.push(noise(&format!("{prefix}slow force"), 1e3 * part.slow_force_n, "mN/√s"));
                }
            }
        }
        let note = "± is one standard deviation: of noise alone; in all, with the stated tolerances; and with those of a typical \
                    bench where none is stated (--tolerance all=typical).";
        let head = ["", "value", "± of noise", "± in all", "± typical bench", ""];
        Table::new("Maximum likelihood over the whole recording", note, head, rows)
    }

    /// The answer as one JSON document, in SI units; without estimates if they are not valid.
    fn json(&self) -> Json {
        let Some(found) = self.found.as_ref().filter(|_| self.valid) else {
            return json!({"valid": false, "verdict": self.verdict, "findings": self.findings});
        };
        let per = |of: &[likelihood::Estimate], part: fn(&likelihood::Estimate) -> f64| -> Vec<f64> {
            of.iter().map(part).collect()
        };
        let estimated = found.bench.iter().filter(|of| of.estimated);
        let bench = estimated.map(|of| (of.parameter.name.clone(), of.estimate.json()));
        let budget = found.bench.iter().map(|line| {
            json!({
                "parameter": line.parameter.name, "unit": line.parameter.unit,
                "tolerance": line.tolerance, "uncertain": line.parameter.is_uncertain(), "sensitivity": line.sensitivity,
                "contribution": line.contribution,
            })
        });
        let stated = &self.question.stated;
        let unbalance = |of: &likelihood::Unbalance| {
            json!({
                "magnitude": of.magnitude.value, "magnitudeStd": of.magnitude.noise_std,
                "magnitudeStdTotal": of.magnitude.total_std,
                "phase": of.phase.value, "phaseStd": of.phase.noise_std, "phaseStdTotal": of.phase.total_std,
            })
        };
        // A list of one is shown as its element.
        let one_or_all = |all: Vec<Json>| match <[Json; 1]>::try_from(all) {
            Ok([one]) => one,
            Err(all) => all.into(),
        };
        let noise = |of: &likelihood::Conditions| {
            let noise = of.parts.iter().map(|of| {
                let mut noise = json!({"position": of.position_noise_m, "current": of.current_noise_a});
                if let Some(power) = &of.noise_exponent {
                    noise["exponent"] = power.json();
                }
                noise
            });
            one_or_all(noise.collect())
        };
        let recording = |of: &likelihood::Conditions| {
            let mut recording = json!({
                "ki": per(&of.ki_n_a, |of| of.value), "ks": per(&of.ks_n_m, |of| of.value), "noise": noise(of),
                "slowForce": one_or_all(of.parts.iter().map(|part| part.slow_force_n.into()).collect()),
                "rows": one_or_all(of.parts.iter().map(|part| part.rows.into()).collect()),
            });
            for (name, load) in stated.loads().iter().zip(&of.load_n) {
                recording[name.as_str()] = load.json();
            }
            recording
        };
        json!({
            "valid": self.valid, "verdict": self.verdict, "findings": self.findings,
            "lambdaHat": per(&found.lambda, |of| of.value), "lambdaStd": per(&found.lambda, |of| of.noise_std),
            "lambdaStdTotal": per(&found.lambda, |of| of.total_std),
            "lambdaStdTypical": found.typical_std.iter().zip(&found.lambda).map(|(part, of)| part * of.value.abs()).collect::<Vec<_>>(),
            "magnets": stated.machine.of_magnets("lambda"),
            "unbalance": one_or_all(found.unbalance.iter().map(unbalance).collect()),
            "stated": stated.json(), "noise": noise(&found.conditions[0]),
            "recordings": found.conditions.iter().map(recording).collect::<Vec<_>>(),
            "bench": bench.collect::<serde_json::Map<_, _>>(), "budget": budget.collect::<Vec<_>>(),
            "notSeparated": found.held().collect::<Vec<_>>(),
            "iterations": found.iterations,
        })
    }
}

fn bench(found: &Identification) -> Table {
    let rows = found.bench.iter().filter(|of| of.estimated).map(|of| {
        let parameter = &of.parameter;
        let (factor, unit) = shown(parameter);
        vec![
            parameter.name.clone(),
            significant(of.estimate.value / factor, 4),
            significant(of.estimate.total_std / factor, 2),
            unit.into(),
            parameter.description.clone(),
        ]
    });
    Table::new("The bench, estimated with the rest", "", ["", "value", "± in all", "", ""], rows)
}

/// Contributions to ± of λ of the magnets of a bearing.
fn budget(found: &Identification, bearing: &Bearing, magnets: Range<usize>) -> Table {
    let row = |line: &BenchEstimate| {
        let (factor, unit) = shown(&line.parameter);
        let mut row = vec![
            line.parameter.name.clone(),
            format!("{} {unit}", significant(line.tolerance / factor, 2)),
            match line.parameter.knowledge {
                Knowledge::Exact => "typical",
                Knowledge::Tolerance(_) => "stated",
                Knowledge::Free => "free",
            }
            .into(),
        ];
        row.extend(line.contribution[magnets.clone()].iter().map(|part| format!("{:.2}", 100.0 * part)));
        row.extend(line.sensitivity[magnets.clone()].iter().map(|part| format!("{:+.2}", 100.0 * part * factor)));
        row.push(format!("% per {unit}"));
        row
    };
    let numbers = || 1..=magnets.len();
    let lambda = numbers().map(|k| format!("{}λ{k}", bearing.prefix));
    let sensitivities = numbers().map(|k| if k == 1 { "sens. 1".to_owned() } else { k.to_string() });
    let head =
        ["", "tolerance", ""].map(String::from).into_iter().chain(lambda).chain(sensitivities).chain([String::new()]);
    let title = "Uncertainty budget: contribution of each bench parameter to ± of λ, in %";
    let note = if magnets.start > 0 { "" } else { SENSITIVITIES };
    Table::new(title, note, head, found.budget_of(bearing, &magnets).map(row))
}
