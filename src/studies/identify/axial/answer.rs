//! Result for an axis: force constants, operating point with standard deviations, effects found on the bench.

use nalgebra::{DMatrix, DVector};
use serde_json::{Value as Json, json};

use super::filter::Readings;
use super::search::{Fit, follow};
use super::{
    Axis, BENCH_ERRORS, CURRENT_NOISE, DELAY, DYNAMICS, EXPONENT, Effect, Found, GAP, KAPPA, LOAD, PARAMETERS,
    POSITION_NOISE, Point, SLOW, UNKNOWNS, find, is_logarithm, mean, values,
};
use crate::bearing::array;
use crate::estimation::{Hold, STD_LIMIT};
use crate::simulation::{Column, Recording};
use crate::studies::identify::agreement::{Check, disagreement, rows_ahead, sentence};
use crate::studies::identify::answer::{constant_currents, dynamics_remark, noise_differs};
use crate::studies::identify::diagnosis::MEANINGS;
use crate::studies::identify::likelihood::Estimate;
use crate::studies::identify::{Samples, Statement, significant, time};
use crate::table::Table;

/// Relative standard deviation that a single recording of any bench cannot reveal, and which is therefore part of every ±: with it the
/// five recordings in tests/data differ by their stated standard deviations (docs/bench.md).
const FLOOR: f64 = 0.015;
/// A slow force that within a second wanders by more than the floor, relative to the load, is not covered by ±.
const MAX_SLOW_FORCE: f64 = FLOOR;
/// Standard deviations from 1 at which κ is mentioned.
const MENTIONED_STD: f64 = 2.0;
/// Maximum shift of an estimate by a finding in a valid result, in standard deviations.
const MAX_SHIFT_STD: f64 = 3.0;
/// Common mistakes with their corrections. Exchanged magnets are a reversed axis: without a known load, the two are the same.
const MIRRORED: &str = "x is mirrored: reverse the sign of the sensor";
const EXCHANGED: &str = "the magnets are exchanged: exchange their columns (--column), or magnets.used";

/// Result for one axis.
#[derive(Clone, Debug)]
pub struct Answer {
    /// Whether it is reliable.
    pub valid: bool,
    /// Reason, for a valid and an invalid result.
    pub verdict: String,
    /// Further findings as sentences.
    pub findings: Vec<String>,
    /// Position of the operating point, m.
    pub at_m: f64,
    /// Operating point: current in A, ki in N/A, ks in N/m, dynamic ki and ks.
    pub operating: [Estimate; 5],
    /// κ between statics and dynamics.
    pub dynamics: Estimate,
    /// Estimates of λ of the magnets that are used, N·m²/A², by magnet, and of the gap, m.
    pub lambda: Vec<(usize, Estimate)>,
    /// See [`Answer::lambda`].
    pub gap: Estimate,
    /// Errors of the bench with tolerances, by index of the unknown.
    pub bench: Vec<(usize, Estimate)>,
    pub(super) found: Found,
}

/// rms of the prediction errors `ahead` rows ahead, m.
fn prediction_rms(axis: &Axis, readings: &Readings, point: &Point, ahead: usize) -> f64 {
    let (mut squares, mut row) = (Vec::new(), readings.rows.start);
    follow(axis, readings, point, |filter, _| {
        if let Some(x_m) = readings.x_m[..readings.rows.end].get(row + ahead) {
            squares.push((x_m - filter.ahead(readings, ahead)).powi(2));
        }
        row += 1;
    });
    mean(squares).sqrt()
}

/// Identifies the axis from one recording. If the result is not valid, common mistakes are tried, and those that explain the data are proposed.
///
/// # Errors
/// The reason if nothing can be identified.
pub fn answer(axis: &Axis, recording: &Samples) -> Result<Answer, String> {
    let mut answer = identified(axis, recording)?;
    if !answer.valid {
        let constant = constant_currents(&recording.current_a, recording.machine);
        let proposals = if constant.is_empty() { proposals(axis, recording, &answer) } else { Vec::new() };
        if let Some(first) = proposals.first() {
            answer.verdict = format!("Not valid: {first}.");
        }
        answer.findings.splice(..0, constant.into_iter().chain(proposals.iter().map(|of| sentence(of))));
    }
    Ok(answer)
}

/// The mistakes with which a recording is valid and more likely.
fn proposals(axis: &Axis, recording: &Samples, stated: &Answer) -> Vec<String> {
    let mirrored = |sign: f64, words: String| {
        let (mut axis, mut recording) = (axis.clone(), recording.clone());
        recording.position_m[0].iter_mut().for_each(|x_m| *x_m = -*x_m);
        axis.at_m = axis.at_m.map(|at_m| sign * at_m);
        axis.known[LOAD] = axis.known[LOAD].map(|load_n| sign * load_n);
        (axis, recording, words)
    };
    let mut mistakes = match axis.is_known(LOAD) {
        true => vec![mirrored(1.0, MIRRORED.to_owned()), mirrored(-1.0, EXCHANGED.to_owned())],
        false => vec![mirrored(1.0, format!("{MIRRORED}; or if {EXCHANGED}"))],
    };
    let others = MEANINGS.into_iter().filter(|(hold, ..)| *hold != axis.hold.unwrap_or(Hold::Linear));
    mistakes.extend(others.map(|(hold, meaning, advice)| {
        (Axis { hold: Some(hold), ..axis.clone() }, recording.clone(), format!("{meaning}: {advice}"))
    }));
    let proposal = |(axis, recording, words): (Axis, Samples, String)| {
        let other = identified(&axis, &recording).ok().filter(|other| other.valid)?;
        let is_better = other.found.fit.log_likelihood > stated.found.fit.log_likelihood;
        is_better.then(|| format!("the data fit better if {words}"))
    };
    mistakes.into_iter().filter_map(proposal).collect()
}

fn identified(axis: &Axis, recording: &Samples) -> Result<Answer, String> {
    let found = find(axis, recording)?;
    let Found { axis, fit: Fit { point, covariance, of_tolerances, .. }, .. } = &found;
    let (law, at_m) = (axis.law(point), axis.at_m.unwrap_or(0.0));
    for (n, k) in axis.used.iter().enumerate() {
        let gap_m = law.gap_of(n, at_m);
        if gap_m <= 0.0 {
            let [at, gap] = [at_m, gap_m].map(|of_m| significant(1e3 * of_m, 4));
            return Err(format!(
                "--at Xm={at}mm: the gap of magnet {} would be {gap} mm there; the recording has positions {}",
                k + 1,
                found.position_range().1
            ));
        }
    }
    let estimate = |value: f64, variance: f64, of_tolerances: f64| Estimate {
        value,
        noise_std: (variance - of_tolerances).max(0.0).sqrt(),
        total_std: (variance.max(0.0) + (FLOOR * value).powi(2)).sqrt(),
    };
    let unknown = |at: usize| {
        let (value, slope) = (law.values[at], if is_logarithm(at) { law.values[at] } else { 1.0 });
        let [variance, of_tolerances] = [covariance, of_tolerances].map(|of| slope * slope * of[(at, at)]);
        estimate(value, variance, of_tolerances)
    };
    let operating = found.operating(point);
    let [all, part] = [covariance, of_tolerances].map(|of| found.covariance_at_operating_point(of));
    let mut answer = Answer {
        valid: true,
        verdict: String::new(),
        findings: Vec::new(),
        at_m,
        operating: array::from_fn(|i| estimate(operating[i], all[(i, i)], part[(i, i)])),
        dynamics: unknown(DYNAMICS),
        lambda: axis.used.iter().map(|k| (*k, unknown(*k))).collect(),
        gap: unknown(GAP),
        bench: BENCH_ERRORS.filter(|at| axis.is_tolerated(*at)).map(|at| (at, unknown(at))).collect(),
        found,
    };
    answer.judge();
    Ok(answer)
}

impl Found {
    /// Current (A), ki (N/A), ks (N/m) at the operating point, and ki/κ, ks/κ: in equilibrium where one magnet carries a load,
    /// otherwise with the mean currents of the recording.
    fn operating(&self, point: &Point) -> [f64; 5] {
        let Self { axis, readings: Readings { current_a, rows, .. }, .. } = self;
        let (law, at_m) = (axis.law(point), axis.at_m.unwrap_or(0.0));
        let mut mean_a = [0.0; 2];
        for (k, (mean_a, of)) in mean_a.iter_mut().zip(current_a).enumerate() {
            *mean_a = law.true_value(k, mean(&of[rows.clone()]));
        }
        if let [k] = axis.used.as_slice() {
            mean_a[0] = law.reference_m * (point[LOAD].abs() / law.values[*k]).sqrt();
        }
        let (_, stiffness, gain) = law.force(at_m, mean_a);
        let gain: f64 = gain.iter().map(|gain| gain.abs()).sum();
        let current = mean_a.iter().sum::<f64>() / axis.used.len() as f64;
        [current, gain, stiffness, gain / point[DYNAMICS], stiffness / point[DYNAMICS]]
    }

    /// Covariance of these five from that of the unknowns, by differences.
    fn covariance_at_operating_point(&self, covariance: &DMatrix<f64>) -> DMatrix<f64> {
        let Self { axis, fit: Fit { point, .. }, .. } = self;
        let mut jacobian = DMatrix::zeros(5, UNKNOWNS);
        // Unknowns without covariance were not searched; at a slow force of zero there is no slope.
        for at in (0..UNKNOWNS).filter(|at| covariance[(*at, *at)] > 0.0) {
            let [up, down] = axis.neighbours(at, point).map(|point| self.operating(&point));
            (0..5).for_each(|i| jacobian[(i, at)] = (up[i] - down[i]) / (2.0 * axis.step(at, point)));
        }
        &jacobian * covariance * jacobian.transpose()
    }
}

/// A position in mm, to a tenth of a micrometre.
fn in_mm(position_m: f64) -> String {
    significant((1e7 * position_m).round() / 1e4, 4)
}

fn percent(part: f64) -> String {
    significant(100.0 * part, 2)
}

impl Answer {
    fn judge(&mut self) {
        let [_, ki, ks, ..] = &self.operating;
        let worst = (ki.total_std / ki.value).max(ks.total_std / ks.value);
        let refusal = self.refusal(worst);
        self.valid = refusal.is_none();
        self.findings = self.remarks();
        self.verdict = match refusal {
            Some(why) => format!("Not valid: {why}."),
            None if ki.noise_std == 0.0 => {
                "Valid: the law describes the recording. λ, s, pX and dynamics are all stated, so nothing was identified; --estimate names what \
                 is to be."
                    .into()
            }
            None => {
                let (at, worst, floor) = (in_mm(self.at_m), percent(worst), 100.0 * FLOOR);
                format!("Valid: ki and ks at x = {at} mm are known within {worst} %, {floor} % of any bench included.")
            }
        };
    }

    /// Rows left out, a position outside the recording, and significant effects of the bench. An invalid result gives no remark on the dynamics.
    fn remarks(&self) -> Vec<String> {
        let Found { fit, readings: Readings { rows, start_s, step_s, .. }, effects, .. } = &self.found;
        let mut remarks = Vec::new();
        if rows.start > 0 {
            let from = time(start_s + rows.start as f64 * step_s);
            remarks.push(format!("Readings before {from} do not follow the law (a start at rest?) and were left out."));
        }
        let ([low, high], positions) = self.found.position_range();
        if self.at_m < low || self.at_m > high {
            let at = in_mm(self.at_m);
            remarks.push(format!(
                "x = {at} mm is outside the positions of the recording, {positions}: ki and ks there rest on the law alone."
            ));
        }
        for Effect { at, gain, .. } in effects.iter().filter(|effect| effect.is_significant) {
            let worth = format!("worth {} in log-likelihood", significant(*gain, 3));
            let Estimate { value, noise_std, .. } = self.dynamics;
            remarks.extend(match *at {
                DYNAMICS if self.valid && (value - 1.0).abs() > MENTIONED_STD * noise_std => {
                    Some(dynamics_remark("", value, noise_std, &format!(", {worth}")))
                }
                SLOW => Some(format!("A slow force that nothing explains wanders by {} ({worth}).", self.slow_force())),
                EXPONENT => {
                    let power = significant(fit.point[EXPONENT], 2);
                    Some(format!("The noise of the position grows with the gap to the power of {power} ({worth})."))
                }
                _ => None,
            });
        }
        remarks
    }

    /// The level of the slow force.
    fn slow_force(&self) -> String {
        format!("{} mN/√s", significant(1e3 * libm::exp(self.found.fit.point[SLOW]), 2))
    }

    /// First reason why the result is not valid, if any. ki or ks is known within `worst`.
    fn refusal(&self, worst: f64) -> Option<String> {
        let Found { axis, stated_noise_m, fit, delayed, .. } = &self.found;
        let kappa = fit.point[DYNAMICS];
        if !axis.is_known(DYNAMICS) && KAPPA.contains(&kappa) {
            return Some(format!(
                "the dynamics are not known: κ is at the limit of its search, {kappa}: are there too few positions, or is the mass or a unit wrong?"
            ));
        }
        if !fit.converged {
            return Some("the search did not converge".into());
        }
        if worst.is_nan() || worst > STD_LIMIT {
            let (known, limit) = (percent(worst), 100.0 * STD_LIMIT);
            return Some(format!(
                "ki or ks is known to {known} % only, the limit is {limit} %: use a longer recording with more positions"
            ));
        }
        let moved = delayed.as_ref().map(|delayed| {
            let (moved, lambda) = (self.found.operating(&delayed.point), values(&delayed.point));
            let stiffness = self.operating.iter().zip(moved).skip(1).take(2);
            let all = stiffness.chain(self.lambda.iter().map(|(k, estimate)| (estimate, lambda[*k])));
            let far = all.map(|(estimate, moved)| (moved - estimate.value).abs() / estimate.total_std);
            (delayed, far.fold(0.0, f64::max))
        });
        if let Some((delayed, furthest)) = moved.filter(|(_, furthest)| *furthest > MAX_SHIFT_STD) {
            let gain = significant(delayed.log_likelihood - fit.log_likelihood, 3);
            let delay_s = delayed.point[DELAY];
            let (delay, far) = (time(delay_s.abs()), significant(furthest, 2));
            let later = if delay_s > 0.0 { "later" } else { "earlier" };
            return Some(format!(
                "positions {delay} {later} than currents are more likely by {gain}, and with them ki, ks or λ moves by {far} deviations \
                 (--estimate delay)"
            ));
        }
        let is_bad = libm::exp(fit.point[SLOW]) > MAX_SLOW_FORCE * axis.weight_n();
        if is_bad {
            return Some(format!("the law fits badly: slow force of {}", self.slow_force()));
        }
        let noise_m = libm::exp(fit.point[POSITION_NOISE]);
        stated_noise_m.and_then(|stated_m| noise_differs(0, noise_m, stated_m))
    }

    /// The result in words, numbers and JSON.
    #[must_use]
    pub fn statement(&self) -> Statement {
        Statement {
            valid: Some(self.valid),
            verdict: self.verdict.clone(),
            findings: self.findings.clone(),
            assumptions: self.known_values(),
            tables: vec![self.table()],
            json: self.json(),
        }
    }

    /// Parameters taken as known.
    fn known_values(&self) -> String {
        let axis = &self.found.axis;
        let known = (0..UNKNOWNS).filter(|at| axis.is_known(*at));
        let known = known.map(|at| {
            let (name, unit, _) = PARAMETERS[at];
            let unit = if unit == "1" { String::new() } else { format!(" {unit}") };
            let std = axis.tolerance[at];
            let tolerance = if std > 0.0 { format!(" ± {}", significant(std, 2)) } else { String::new() };
            format!(", {name} = {}{tolerance}{unit}", significant(axis.known[at].unwrap_or(0.0), 5))
        });
        let used: Vec<_> = axis.used.iter().map(|k| (k + 1).to_string()).collect();
        let known: String = known.collect();
        format!("Taken as known: m = {} kg, magnets {}{known}.", significant(axis.m_kg, 5), used.join(" and "))
    }

    /// Estimates as a table.
    fn table(&self) -> Table {
        let row = |name: &str, of: &Estimate, factor: f64, unit: &str| {
            let [value, noise, total] = of.cells(factor);
            vec![name.to_owned(), value, noise, total, unit.to_owned()]
        };
        let [current, ki, ks, ki_dynamic, ks_dynamic] = &self.operating;
        let mut rows = vec![
            row("current", current, 1.0, "A"),
            row("ki", ki, 1.0, "N/A"),
            row("ks", ks, 1.0, "N/m"),
            row("κ", &self.dynamics, 1.0, ""),
            row("ki/κ", ki_dynamic, 1.0, "N/A"),
            row("ks/κ", ks_dynamic, 1.0, "N/m"),
        ];
        rows.extend(self.lambda.iter().map(|(k, of)| row(&format!("λ{}", k + 1), of, 1e-6, "10⁻⁶ N·m²/A²")));
        rows.push(row("s", &self.gap, 1e-3, "mm"));
        rows.extend(self.bench.iter().map(|(at, of)| row(PARAMETERS[*at].0, of, 1.0, PARAMETERS[*at].1)));
        let point = &self.found.fit.point;
        let noise = |name: &str, at: usize, factor: f64, unit: &str| {
            let value = significant(libm::exp(point[at]) / factor, 3);
            vec![name.to_owned(), value, String::new(), String::new(), unit.to_owned()]
        };
        rows.push(noise("noise of the position", POSITION_NOISE, 1e-6, "µm"));
        rows.push(noise("noise of the currents", CURRENT_NOISE, 1e-3, "mA"));
        rows.push(noise("slow force", SLOW, 1e-3, "mN/√s"));
        let (title, floor) = (format!("Axis at x = {} mm", in_mm(self.at_m)), 100.0 * FLOOR);
        let note =
            format!("± is one standard deviation: of noise and slow force; and with {floor} % that any bench hides.");
        Table::new(title, note, ["", "value", "± of noise", "± in all", ""], rows)
    }

    /// The result as JSON, in SI units.
    fn json(&self) -> Json {
        let [current, ki, ks, ki_dynamic, ks_dynamic] = &self.operating;
        let magnets: serde_json::Map<String, Json> =
            self.lambda.iter().map(|(k, lambda)| (format!("lambda[{}]", k + 1), lambda.json())).collect();
        let effect =
            |of: &Effect| (PARAMETERS[of.at].0.into(), json!({"logLikelihood": of.gain, "taken": of.is_taken}));
        let effects: serde_json::Map<String, Json> = self.found.effects.iter().map(effect).collect();
        let Readings { rows, start_s, step_s, .. } = &self.found.readings;
        let point = &self.found.fit.point;
        let bench = self.bench.iter().map(|(at, of)| (PARAMETERS[*at].0.to_owned(), of.json()));
        json!({
            "valid": self.valid, "verdict": self.verdict, "findings": self.findings,
            "operatingPoint": {
                "x": self.at_m, "current": current.value,
                "ki": ki.value, "kiStd": ki.noise_std, "kiStdTotal": ki.total_std,
                "ks": ks.value, "ksStd": ks.noise_std, "ksStdTotal": ks.total_std,
                "dynamics": self.dynamics.value, "dynamicsStd": self.dynamics.noise_std,
                "dynamicsStdTotal": self.dynamics.total_std,
                "kiDynamic": ki_dynamic.value, "kiDynamicStdTotal": ki_dynamic.total_std,
                "ksDynamic": ks_dynamic.value, "ksDynamicStdTotal": ks_dynamic.total_std,
            },
            "magnets": magnets, "s": self.gap.json(), "pX": point[LOAD],
            "force.slow": libm::exp(point[SLOW]), "noise.exponent": point[EXPONENT], "delay": point[DELAY],
            "noise": {"position": libm::exp(point[POSITION_NOISE]), "current": libm::exp(point[CURRENT_NOISE])},
            "effects": effects, "bench": bench.collect::<serde_json::Map<_, _>>(),
            "rows": {"from": start_s + rows.start as f64 * step_s, "count": rows.len()},
            "logLikelihood": self.found.fit.log_likelihood,
        })
    }

    /// Slow force and its standard deviation, N, and one-step prediction errors of the position, m, by row; NaN where the row was not used.
    #[must_use]
    pub fn traces(&self) -> [Vec<f64>; 3] {
        let Found { axis, readings, fit, .. } = &self.found;
        let mut traces = [0; 3].map(|_| vec![f64::NAN; readings.rows.start]);
        follow(axis, readings, &fit.point, |filter, [error, variance]| {
            let [slow_n, std_n] = filter.slow_n();
            let values = [slow_n, std_n, if variance > 0.0 { error } else { f64::NAN }];
            traces.iter_mut().zip(values).for_each(|(trace, value)| trace.push(value));
        });
        traces
    }

    /// Readings, prediction errors and slow force over time.
    #[must_use]
    pub fn recording(&self) -> Recording {
        let Readings { start_s, step_s, x_m, .. } = &self.found.readings;
        let [slow_n, std_n, errors_m] = self.traces();
        let columns = [
            ("Xm", "m", x_m.clone()),
            ("Xm.predictionError", "m", errors_m),
            ("force.slow", "N", slow_n),
            ("force.slowStd", "N", std_n),
        ];
        let columns = columns.map(|(name, unit, values)| Column { name: name.into(), unit: unit.into(), values });
        Recording { time_s: (0..x_m.len()).map(|row| start_s + row as f64 * step_s).collect(), columns: columns.into() }
    }

    /// Checks this estimate against another recording, given the result of that recording.
    #[must_use]
    pub fn check(&self, own: &Self) -> Check {
        let Found { axis, fit, readings, .. } = &own.found;
        // Noises, slow force and delay belong to the recording, force constants and gap to the bench.
        let mut point = fit.point;
        let bench = [0, 1, GAP, DYNAMICS].into_iter().chain(BENCH_ERRORS);
        bench.for_each(|at| point[at] = self.found.fit.point[at]);
        let horizons = [1, rows_ahead(readings.step_s)];
        let [foreign_m, own_m] =
            [&point, &fit.point].map(|point| horizons.map(|ahead| prediction_rms(axis, readings, point, ahead)));
        Check::new(agreement([self, own]), readings.step_s, foreign_m, own_m)
    }
}

/// Disagreement between recordings of one bench in ki, ks and κ, with the floor of every bench; none if they agree.
#[must_use]
pub fn agreement<'a>(answers: impl IntoIterator<Item = &'a Answer>) -> Option<String> {
    let own = answers.into_iter().map(|answer| {
        let [_, ki, ks, ..] = answer.operating;
        let all = [ki, ks, answer.dynamics];
        // A tolerance of the bench is common to all recordings.
        let variance = |of: &Estimate| of.noise_std.powi(2) + (FLOOR * of.value).powi(2);
        let variances = DVector::from_iterator(3, all.iter().map(variance));
        (DVector::from_iterator(3, all.iter().map(|of| of.value)), DMatrix::from_diagonal(&variances))
    });
    let differ = disagreement(&own.collect::<Vec<_>>(), &["ki", "ks", "κ"].map(String::from));
    differ.as_deref().map(sentence)
}
