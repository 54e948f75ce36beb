//! The answer in words, tables and JSON.

use serde_json::{Value as Json, json};

use super::Answer;
use crate::studies::identify::likelihood::{self, Identification, Knowledge, PARAMETERS};
use crate::studies::identify::name_of;
use crate::studies::identify::read::significant;
use crate::table::Table;

/// Factor and name of the unit in which a parameter is shown.
pub fn shown(unit: &str) -> (f64, &'static str) {
    match unit {
        "1" => (0.01, "%"),
        "m" => (1e-6, "µm"),
        "rad" => (std::f64::consts::PI / 180.0, "°"),
        "s" => (1e-6, "µs"),
        "A" => (1e-3, "mA"),
        _ => (1.0, "N"),
    }
}

impl Answer {
    /// Relative standard deviations of λ with a typical bench where no tolerance is stated.
    #[must_use]
    pub fn typical(&self) -> Option<[f64; 3]> {
        let found = self.found.as_ref()?;
        Some(std::array::from_fn(|k| {
            let own = found.lambda[k].total_std / found.lambda[k].value;
            let untold = found.budget.iter().filter(|line| !line.told && PARAMETERS[line.parameter].in_typical_bench);
            untold.map(|line| line.contribution[k]).fold(own * own, |sum, part| sum + part * part).sqrt()
        }))
    }

    /// Parameters taken as known.
    #[must_use]
    pub fn told(&self) -> String {
        let config = &self.question.config;
        let hold = name_of(config.hold);
        let mut words = format!(
            "Taken as known: m = {} kg, s = {} mm, alpha = {} °, currents {hold}",
            significant(config.m_kg, 6),
            significant(1e3 * config.gap_m, 6),
            config.alpha_rad.map(|alpha| significant(alpha.to_degrees(), 5)).join(", ")
        );
        for (told, parameter) in self.question.bench.iter().zip(&PARAMETERS) {
            let (factor, unit) = shown(parameter.unit);
            match told.knowledge {
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
    #[must_use]
    pub fn tables(&self) -> Vec<Table> {
        let Some(found) = &self.found else { return Vec::new() };
        vec![self.estimates(found), bench(found), budget(found)]
            .into_iter()
            .filter(|table| !table.rows.is_empty())
            .collect()
    }

    fn estimates(&self, found: &Identification) -> Table {
        let typical = self.typical().unwrap_or_default();
        let row = |name: String, of: &likelihood::Estimate, factor: f64, unit: &str, typical: Option<f64>| {
            vec![
                name,
                significant(of.value / factor, 5),
                significant(of.noise_std / factor, 2),
                significant(of.total_std / factor, 2),
                typical.map_or(String::new(), |std| significant(std / factor, 2)),
                unit.to_owned(),
            ]
        };
        let mut rows: Vec<Vec<String>> = (0..3)
            .map(|k| {
                let lambda = &found.lambda[k];
                row(format!("λ{}", k + 1), lambda, 1e-6, "10⁻⁶ N·m²/A²", Some(typical[k] * lambda.value))
            })
            .collect();
        rows.push(row("U".into(), &found.unbalance_magnitude, 1e-6, "g·mm", None));
        rows.push(row("φ".into(), &found.unbalance_phase, 1.0, "rad", None));
        for (r, conditions) in found.conditions.iter().enumerate() {
            let of = if found.conditions.len() > 1 { format!(", {}", r + 1) } else { String::new() };
            for k in 0..3 {
                rows.push(row(format!("ki{}{of}", k + 1), &conditions.ki_n_a[k], 1.0, "N/A", None));
            }
            for k in 0..3 {
                rows.push(row(format!("ks{}{of}", k + 1), &conditions.ks_n_m[k], 1e3, "N/mm", None));
            }
            for (a, name) in ["pY", "pZ"].iter().enumerate() {
                rows.push(row(format!("{name}{of}"), &conditions.load_n[a], 1.0, "N", None));
            }
            let noise = |name: &str, value: f64, unit: &str| {
                vec![
                    format!("{name}{of}"),
                    significant(value, 3),
                    String::new(),
                    String::new(),
                    String::new(),
                    unit.into(),
                ]
            };
            rows.push(noise("noise of positions", 1e6 * conditions.position_noise_m, "µm"));
            rows.push(noise("noise of currents", 1e3 * conditions.current_noise_a, "mA"));
            if conditions.slow_force_n > 0.0 {
                rows.push(noise("slow force", 1e3 * conditions.slow_force_n, "mN/√s"));
            }
        }
        Table {
            title: "Maximum likelihood over the whole recording".into(),
            note: "± is one standard deviation: of noise alone; in all, with the tolerances that were told; and with those of a typical \
                   bench where none is stated (s ±1 %, angles ±0.5°, offsets ±5 µm, gains ±0.5 %, mass ±1 %)."
                .into(),
            head: ["", "value", "± of noise", "± in all", "± typical bench", ""].map(String::from).into(),
            rows,
        }
    }

    /// The answer as one JSON document, SI units; without estimates where they are not valid.
    #[must_use]
    pub fn json(&self) -> Json {
        let Some(found) = self.found.as_ref().filter(|_| self.valid) else {
            return json!({"valid": false, "verdict": self.verdict, "findings": self.findings});
        };
        let per = |of: &[likelihood::Estimate; 3], part: fn(&likelihood::Estimate) -> f64| of.each_ref().map(part);
        let estimate =
            |of: &likelihood::Estimate| json!({"value": of.value, "std": of.noise_std, "stdTotal": of.total_std});
        let typical = self.typical().unwrap_or_default();
        let bench: serde_json::Map<String, Json> = found
            .bench
            .iter()
            .zip(&PARAMETERS)
            .filter(|(of, _)| of.estimated)
            .map(|(of, parameter)| (parameter.name.to_owned(), estimate(&of.estimate)))
            .collect();
        let budget: Vec<Json> = found
            .budget
            .iter()
            .map(|line| {
                json!({
                    "parameter": PARAMETERS[line.parameter].name, "unit": PARAMETERS[line.parameter].unit,
                    "tolerance": line.tolerance, "told": line.told, "sensitivity": line.sensitivity,
                    "contribution": line.contribution,
                })
            })
            .collect();
        let first = &found.conditions[0];
        let config = &self.question.config;
        json!({
            "valid": self.valid, "verdict": self.verdict, "findings": self.findings,
            "lambdaHat": per(&found.lambda, |of| of.value), "lambdaStd": per(&found.lambda, |of| of.noise_std),
            "lambdaStdTotal": per(&found.lambda, |of| of.total_std),
            "lambdaStdTypical": std::array::from_fn::<f64, 3, _>(|k| typical[k] * found.lambda[k].value),
            "unbalance": {
                "magnitude": found.unbalance_magnitude.value, "magnitudeStd": found.unbalance_magnitude.noise_std,
                "phase": found.unbalance_phase.value, "phaseStd": found.unbalance_phase.noise_std,
            },
            "told": {"m": config.m_kg, "s": config.gap_m, "alpha": config.alpha_rad, "hold": name_of(config.hold)},
            "noise": {"position": first.position_noise_m, "current": first.current_noise_a},
            "recordings": found.conditions.iter().map(|of| json!({
                "pY": estimate(&of.load_n[0]), "pZ": estimate(&of.load_n[1]),
                "ki": per(&of.ki_n_a, |of| of.value), "ks": per(&of.ks_n_m, |of| of.value),
                "noise": {"position": of.position_noise_m, "current": of.current_noise_a},
                "slowForce": of.slow_force_n, "rows": of.rows,
            })).collect::<Vec<_>>(),
            "bench": bench, "budget": budget,
            "notSeparated": found.not_separated.iter().map(|j| PARAMETERS[*j].name).collect::<Vec<_>>(),
            "iterations": found.iterations,
        })
    }
}

fn bench(found: &Identification) -> Table {
    let rows = found.bench.iter().zip(&PARAMETERS).filter(|(of, _)| of.estimated).map(|(of, parameter)| {
        let (factor, unit) = shown(parameter.unit);
        vec![
            parameter.name.to_owned(),
            significant(of.estimate.value / factor, 4),
            significant(of.estimate.total_std / factor, 2),
            unit.into(),
            parameter.description.into(),
        ]
    });
    Table {
        title: "The bench, estimated with the rest".into(),
        note: String::new(),
        head: ["", "value", "± in all", "", ""].map(String::from).into(),
        rows: rows.collect(),
    }
}

fn budget(found: &Identification) -> Table {
    let rows =
        found.budget.iter().filter(|line| line.told || PARAMETERS[line.parameter].in_typical_bench).map(|line| {
            let parameter = &PARAMETERS[line.parameter];
            let (factor, unit) = shown(parameter.unit);
            let mut row = vec![
                parameter.name.to_owned(),
                format!("{} {unit}", significant(line.tolerance / factor, 2)),
                if line.told { "told" } else { "typical" }.into(),
            ];
            row.extend(line.contribution.map(|part| format!("{:.2}", 100.0 * part)));
            row.extend(line.sensitivity.map(|part| format!("{:+.2}", 100.0 * part * factor)));
            row.push(format!("% per {unit}"));
            row
        });
    Table {
        title: "Budget: what each parameter of the bench contributes to ± of λ, in %".into(),
        note: "The sensitivities say by how much λ is wrong if the parameter differs from its stated value.".into(),
        head: ["", "tolerance", "", "λ1", "λ2", "λ3", "sens. 1", "2", "3", ""].map(String::from).into(),
        rows: rows.collect(),
    }
}
