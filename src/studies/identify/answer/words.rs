//! Verdict and findings in sentences.

use super::judge::{harmonics, is_silent};
use super::shown::shown;
use crate::machine::Machine;
use crate::studies::identify::likelihood::{
    BenchEstimate, BenchParameter, Change, Contradiction, DELAY, DYNAMICS, Estimate, Hold, Identification, LAG,
    Recording, Suspect,
};
use crate::studies::identify::units::with_std;
use crate::studies::identify::{Stated, plain, significant, time};
use crate::studies::statistics::range;
use crate::variables::Choice;

/// How well valid force constants are known.
pub(super) fn valid(found: &Identification, stated: &Stated) -> String {
    let worst = found.lambda.iter().map(|lambda| lambda.total_std / lambda.value).fold(0.0, f64::max);
    let exact = |of: &BenchParameter| !of.is_uncertain() || [DELAY, LAG].contains(&plain(&of.name));
    let has_tolerance = stated.bench().any(|of| of.knowledge.tolerance().is_some());
    let on = match stated.bench().all(exact) {
        true => " if the bench is exactly as stated; mind the budget",
        false if has_tolerance => ", the stated tolerances of the bench included",
        false => " if the rest of the bench is exactly as stated; mind the budget",
    };
    format!("Valid: the force constants are known within {} %{on}.", significant(100.0 * worst, 2))
}

/// Findings besides the estimates. If another description explains the data, the residuals of this one mean nothing, and neither do the parts
/// that contradict the rest.
pub(super) fn findings(found: &Identification, all: &[Recording], stated: &Stated, is_explained: bool) -> Vec<String> {
    let mut words = if is_explained { Vec::new() } else { contradictions(found, all) };
    let held: Vec<&str> = found.held().collect();
    if !held.is_empty() {
        words.push(format!(
            "The data do not separate {} from the rest; held at the stated value. (Mass and common current gain scale λ; run-out that turns \
             with the shaft is like unbalance at one speed.)",
            held.join(", ")
        ));
    }
    if !is_silent(found) && !is_explained {
        // One gain may explain what the other gains of its pair explain as well.
        let overlaps =
            |a: &Suspect, b: &Suspect| a.parameters.iter().any(|(j, _)| b.parameters.iter().any(|(l, _)| j == l));
        let most = |at: &usize| !found.suspects[..*at].iter().any(|better| overlaps(better, &found.suspects[*at]));
        let suspects = (0..found.suspects.len()).filter(most).take(3);
        words.extend(suspects.map(|at| suspected(found, &found.suspects[at], all[0].step_s)));
        words.extend(of_shaft(found, stated));
    }
    words.extend(quantisation(found, stated));
    if found.covariance_from_scores {
        words.push(
            "The scatter of the data is larger than noise explains; ± of noise is taken from it (scores).".into(),
        );
    }
    if !is_explained {
        words.extend(slow_force(found));
    }
    words.extend(effects(found));
    words.extend(found.bench.iter().filter_map(unusual));
    words
}

/// A value of a bench in this many typical tolerances is not usual: effects that the model lacks, such as saturation and hysteresis, look like it.
const UNUSUAL: f64 = 10.0;

/// A remark on an estimated parameter that is far from its stated value.
fn unusual(BenchEstimate { parameter, estimate, estimated, .. }: &BenchEstimate) -> Option<String> {
    let times = estimate.value.abs() / parameter.typical;
    let is_unusual = *estimated && times > UNUSUAL;
    let (name, (factor, unit)) = (&parameter.name, shown(parameter));
    let [value, times] = [estimate.value / factor, times].map(|of| significant(of, 2));
    is_unusual.then(|| {
        format!(
            "{name} of {value} {unit} is {times} times what is usual on a bench: check it, since what the model lacks, such as saturation or hysteresis \
             of the magnets, may look like that, and λ would be wrong."
        )
    })
}

/// Currents that are the same in every row: commands at their limit, or readings of a dead sensor.
pub fn constant_currents(current_a: &[Vec<f64>], machine: &Machine) -> Vec<String> {
    let words = |(name, current): (String, &Vec<f64>)| {
        let [low, high] = range(current);
        let value = significant(low, 4);
        (low == high && !current.is_empty()).then(|| {
            format!("{name} is {value} A throughout: if this is a reading, are the magnet and its sensor connected?")
        })
    };
    machine.of_magnets("im").into_iter().zip(current_a).filter_map(words).collect()
}

/// The size of a delay with its standard deviation, and its direction.
fn later(delay: Estimate) -> [String; 2] {
    [with_std(delay.value.abs(), delay.total_std), if delay.value > 0.0 { "later" } else { "earlier" }.to_owned()]
}

/// How much later than stated the currents act, which delays the positions relative to them, and the gain in log-likelihood.
pub(super) fn acting_later(delay: Estimate, hold: Hold, gain: f64) -> String {
    let [by, later] = later(delay);
    format!(
        "The currents act {by} {later} than {} says, or the positions are read so much {later} (worth {} in log-likelihood).",
        hold.name(),
        significant(gain, 3)
    )
}

/// Why a delay is not believed.
pub(super) fn long_delay(delay: Estimate) -> String {
    let [by, later] = later(delay);
    format!("the data call for positions that come {by} {later} than stated, more than on a usual bench")
}

/// Words for a parameter of the axial motion of a shaft.
fn along(name: &str) -> &'static str {
    if name.starts_with("X.") { " along the axis" } else { "" }
}

/// In order, disturbances and changes of the load that overlap or follow each other as one.
fn merged(found: &[Contradiction]) -> Vec<Contradiction> {
    let mut sorted = found.to_vec();
    sorted.sort_by_key(|of| (of.recording, of.part, of.rows.start));
    sorted.into_iter().fold(Vec::new(), |mut merged: Vec<Contradiction>, next| {
        if let Some(last) = merged.last_mut()
            && (last.recording, last.part) == (next.recording, next.part)
            && next.rows.start <= last.rows.end
            && let (Change::Disturbed { ratio: most }, Change::Disturbed { ratio: own })
            | (Change::Load { chi_square: most, .. }, Change::Load { chi_square: own, .. }) =
                (&mut last.what, &next.what)
        {
            (last.rows.end, *most) = (last.rows.end.max(next.rows.end), most.max(*own));
            return merged;
        }
        merged.push(next);
        merged
    })
}

/// Words for the parts of a motion: all of it or that across a shaft, and that along it.
pub(super) const PARTS: [&str; 2] = ["", ", along the axis,"];

/// Parts of recordings that are inconsistent with the others; the verdict names a drift.
fn contradictions(found: &Identification, all: &[Recording]) -> Vec<String> {
    let words = |part: &Contradiction| {
        let Recording { start_s, step_s, .. } = all[part.recording];
        let at = |row: usize| time(start_s + row as f64 * step_s);
        let of = PARTS[part.part];
        let rows = format!("{} to {} of recording {}{of}", at(part.rows.start), at(part.rows.end), part.recording + 1);
        Some(match &part.what {
            Change::Disturbed { ratio } => {
                let ratio = significant(*ratio, 2);
                format!("From {rows} something disturbs the rotor (residuals {ratio} times as large); left out.")
            }
            Change::Lambda(lambda) => {
                let each = |l: &Estimate| format!("{:.4} ± {:.4}", 1e6 * l.value, 1e6 * l.noise_std);
                let values = lambda.iter().map(each).collect::<Vec<_>>().join(", ");
                // Few rows may not determine them.
                let is_known = lambda.iter().all(|l| l.noise_std < l.value);
                let values = if is_known { format!(", {values} · 10⁻⁶ N·m²/A²") } else { String::new() };
                format!("From {rows} the force constants differ{values}; left out.")
            }
            Change::Drift(_) => return None,
            Change::Load { chi_square, or_lambda } => {
                let what = if *or_lambda { "the load or the force constants differ" } else { "the load differs" };
                format!("From {rows} {what} (χ² {}); left out.", significant(*chi_square, 3))
            }
        })
    };
    merged(&found.contradictions).iter().filter_map(words).collect()
}

/// Name and description of what the residuals call for.
pub(super) fn called(found: &Identification, suspect: &Suspect) -> [String; 2] {
    let parameter = |(j, _): &(usize, f64)| &found.bench[*j].parameter;
    let names: Vec<&str> = suspect.parameters.iter().map(|of| &*parameter(of).name).collect();
    let description = match suspect.parameters[..] {
        [(_, common), (_, different)] => {
            format!("gain of the position sensor {}", if common * different > 0.0 { "y" } else { "z" })
        }
        _ => parameter(&suspect.parameters[0]).description.clone(),
    };
    [names.join(" and "), description]
}

/// The clause on what the residuals call for together, with the largest errors in typical tolerances.
pub(super) fn together(found: &Identification, Suspect { parameters, chi_square, .. }: &Suspect) -> String {
    let mut sorted = parameters.clone();
    let size = |(j, value): &(usize, f64)| (value / found.bench[*j].parameter.typical).abs();
    sorted.sort_by(|a, b| size(b).total_cmp(&size(a)));
    let names: Vec<&str> = sorted.iter().take(3).map(|(j, _)| &*found.bench[*j].parameter.name).collect();
    let chi_square = significant(*chi_square, 2);
    format!(
        "the residuals call for several small errors of the bench at once, most for {} (χ² {chi_square})",
        names.join(", ")
    )
}

/// The sentence on what the residuals call for, with the options to estimate it.
fn suspected(found: &Identification, suspect: &Suspect, step_s: f64) -> String {
    let (mut values, mut options) = (Vec::new(), Vec::new());
    for (j, value) in &suspect.parameters {
        let parameter = &found.bench[*j].parameter;
        let (factor, unit) = shown(parameter);
        let [value, std] = [(*value, 3), (suspect.std, 2)].map(|(of, digits)| significant(of / factor, digits));
        values.push(format!("{} of {value} ± {std} {unit}", parameter.name));
        options.push(format!("--estimate {}", parameter.name));
    }
    let (first, value) = suspect.parameters[0];
    if plain(&found.bench[first].parameter.name) == DELAY {
        options.insert(0, format!("{} samples; --hold auto, or", significant(value / step_s, 2)));
    }
    let [_, description] = called(found, suspect);
    format!("The residuals call for {} ({description}): {}.", values.join(" and "), options.join(" "))
}

/// Names a recording, counted from 0, if there are several.
fn which(found: &Identification, r: usize) -> String {
    if found.conditions.len() > 1 { format!(" of recording {}", r + 1) } else { String::new() }
}

/// Harmonics of the shaft in the first recording that has any.
fn of_shaft(found: &Identification, stated: &Stated) -> Option<String> {
    let mut present = found.conditions.iter().map(harmonics).enumerate();
    let (r, present) = present.find(|(_, of)| !of.is_empty())?;
    let in_words = |(n, axis, _): &(usize, usize, f64)| format!("{n}× in {}", stated.machine.readings[*axis].axis);
    let (listed, of) = (present.iter().map(in_words).collect::<Vec<_>>().join(", "), which(found, r));
    Some(format!("Harmonics of the shaft in the residuals{of}: {listed}: run-out, or another force?"))
}

/// Sensors whose quantisation exceeds their noise.
fn quantisation(found: &Identification, stated: &Stated) -> Vec<String> {
    let mut words = Vec::new();
    for (r, conditions) in found.conditions.iter().enumerate() {
        let of = which(found, r);
        let of_parts = conditions.parts.iter().zip(&stated.parts);
        let noise = of_parts.flat_map(|(of, part)| std::iter::repeat_n(of.position_noise_m, part.body.coordinates()));
        for ((reading, &step_m), noise) in stated.machine.readings.iter().zip(&conditions.resolution_m).zip(noise) {
            if step_m > noise {
                let (name, step) = (reading.name, significant(1e6 * step_m, 3));
                words.push(format!("{name}{of} is quantised in steps of {step} µm, above the noise."));
            }
        }
        for part in conditions.parts.iter().filter(|part| part.counting < part.rows) {
            let (rows, counting) = (part.rows, part.counting);
            words
                .push(format!("Errors of quantisation{of} repeat with the readings: {rows} rows count as {counting}."));
        }
    }
    words
}

/// The slow force, and its gain in log-likelihood.
fn slow_force(found: &Identification) -> Option<String> {
    let levels: Vec<f64> = found.parts().map(|part| part.slow_force_n).collect();
    levels.iter().any(|level| *level > 0.0).then(|| {
        let levels = levels.iter().map(|level| significant(1e3 * level, 2)).collect::<Vec<_>>().join(", ");
        let worth = significant(found.gain_by_slow_force, 3);
        format!(
            "A slow force that nothing explains wanders by {levels} mN/√s (worth at least {worth} in log-likelihood)."
        )
    })
}

/// κ, the lag of the currents, and the power of the gap in the noise, if they were estimated.
fn effects(found: &Identification) -> Vec<String> {
    let of = |bench: &BenchEstimate| {
        let (name, Estimate { value, total_std, .. }) = (&bench.parameter.name, bench.estimate);
        match plain(name) {
            DYNAMICS => Some(dynamics_remark(along(name), 1.0 + value, total_std, "")),
            LAG => {
                let lag = with_std(value, total_std);
                Some(format!("The currents{} follow what is recorded, with a lag of {lag}.", along(name)))
            }
            _ => None,
        }
    };
    let of_bench = found.bench.iter().filter(|bench| bench.estimated).filter_map(of);
    let exponents = found.parts().filter_map(|part| part.noise_exponent);
    let exponents = exponents.map(|Estimate { value, total_std, .. }| {
        let [value, std] = [value, total_std].map(|of| significant(of, 2));
        format!("The noise of the positions grows with the gap to the power of {value} ± {std}.")
    });
    of_bench.chain(exponents).collect()
}

/// The factor κ between statics and dynamics; `worth` is appended to its value.
pub(in crate::studies::identify) fn dynamics_remark(of: &str, kappa: f64, std: f64, worth: &str) -> String {
    let weaker = 1.0 - 1.0 / kappa;
    let side = if weaker > 0.0 { "weaker" } else { "stronger" };
    let [percent, kappa, std] =
        [(100.0 * weaker.abs(), 2), (kappa, 4), (std, 2)].map(|(of, digits)| significant(of, digits));
    format!(
        "The dynamics{of} are {percent} % {side} than the law (κ = {kappa} ± {std}{worth}): use ki/κ and ks/κ for a controller."
    )
}
