//! Whether separate estimates from recordings of one bench agree: χ² about their weighted mean; and how well the estimate from one predicts another.

use nalgebra::{DMatrix, DVector};
use serde_json::{Value as Json, json};

use super::likelihood::{Identification, Unbalance};
use super::units::{significant, time};
use crate::estimation::chi_square;
use crate::studies::statistics::mean;

/// Normal deviate of the χ² that chance exceeds with a probability of 10⁻⁴.
const LIMIT: f64 = 3.719;

/// Predictions over [`AHEAD_S`] that are worse than those of a fit of its own by this factor show that something differs. Good recordings of one bench
/// stay below 1.25, one with a fifth more unbalance exceeds it (test `another_recording_is_checked_with_the_estimate`).
const WORSE: f64 = 2.0;

/// Horizon of predictions beyond the next sample, s.
const AHEAD_S: f64 = 0.020;

/// The same in rows.
pub(super) fn rows_ahead(step_s: f64) -> usize {
    ((AHEAD_S / step_s).round() as usize).max(2)
}

/// Comparison of one recording with the estimate of another.
#[derive(Clone, Debug)]
pub struct Check {
    /// Whether both agree.
    pub agrees: bool,
    /// Description.
    pub verdict: String,
    /// Horizons in s, rms prediction errors in m with the estimate of the other recording and with its own fit.
    pub errors: [[f64; 3]; 2],
}

impl Check {
    /// From the disagreement, if any, the sample time, and the rms prediction errors in m, one sample and [`AHEAD_S`] ahead.
    pub(super) fn new(differ: Option<String>, step_s: f64, foreign_m: [f64; 2], own_m: [f64; 2]) -> Self {
        let ahead_s = [1, rows_ahead(step_s)].map(|rows| rows as f64 * step_s);
        let errors = [0, 1].map(|at| [ahead_s[at], foreign_m[at], own_m[at]]);
        let words = errors.iter().filter(|[_, foreign_m, own_m]| foreign_m.is_finite() && own_m.is_finite());
        let words = words.map(|[ahead_s, foreign_m, own_m]| {
            let [foreign_um, own_um] = [foreign_m, own_m].map(|rms_m| significant(1e6 * rms_m, 3));
            format!("{} ahead {foreign_um} µm, by a fit of its own {own_um} µm", time(*ahead_s))
        });
        let is_worse = foreign_m[1] > WORSE * own_m[1];
        let agrees = differ.is_none() && !is_worse;
        let differ = differ.unwrap_or_else(|| match is_worse {
            true => "The force constants agree, but something else differs: unbalance, or another value of the bench."
                .into(),
            false => "The recordings agree.".into(),
        });
        let words = words.collect::<Vec<_>>().join("; ");
        let verdict = format!("{differ} Predictions with the first estimate are off by (rms): {words}.");
        Self { agrees, verdict, errors }
    }

    /// The same as JSON.
    pub fn json(&self) -> Json {
        let horizon =
            |[ahead_s, foreign_m, own_m]: [f64; 3]| json!({"ahead": ahead_s, "rms": foreign_m, "rmsOwn": own_m});
        json!({"agrees": self.agrees, "verdict": self.verdict, "predictions": self.errors.map(horizon)})
    }
}

/// Unbalances that differ by more, relative, and by this many standard deviations are not those of one rotor; less may come from errors of the bench.
const OTHER_UNBALANCE: f64 = 0.05;
const OTHER_STD: f64 = 5.0;

/// Recordings at speeds that differ by less, relative, have the same run-out in their unbalance.
const SAME_SPEED: f64 = 0.01;

/// Mean speed, rad/s, if the angle counts from a mark of the shaft; otherwise unbalances cannot be compared.
pub(super) fn marked_speed(has_mark: bool, omega_rad_s: &[f64]) -> f64 {
    if has_mark { mean(omega_rad_s) } else { f64::NAN }
}

/// How the unbalance of a recording differs from that of the first at the same speed, if it does; from their [speeds](marked_speed) and own estimates.
pub(super) fn other_unbalance(own: &[(f64, &Identification)]) -> Option<String> {
    let [(first_rad_s, first), others @ ..] = own else { return None };
    let alike = (1..).zip(others).filter(|(_, (speed, _))| (speed / first_rad_s - 1.0).abs() < SAME_SPEED);
    let pairs = alike.flat_map(|(at, (_, own))| own.unbalance.iter().zip(&first.unbalance).map(move |both| (at, both)));
    let std = |of: &Unbalance| of.magnitude.total_std.hypot(of.magnitude.value * of.phase.total_std);
    let differs = |other: &Unbalance, first: &Unbalance| {
        let [[c, s], [d, t]] = [other, first].map(Unbalance::components);
        let distance = (c - d).hypot(s - t);
        distance > OTHER_UNBALANCE * first.magnitude.value && distance > OTHER_STD * std(other).hypot(std(first))
    };
    let (at, (other, first)) = pairs.into_iter().find(|(_, (other, first))| differs(other, first))?;
    let words = |of: &Unbalance| {
        format!("{} g·mm at {} rad", significant(1e6 * of.magnitude.value, 3), significant(of.phase.value, 3))
    };
    let (other, first) = (words(other), words(first));
    Some(format!("the recordings differ: the unbalance of recording {} is {other}, that of the first {first}", at + 1))
}

/// Estimates of one recording: values with their covariance.
pub(super) type Own = (DVector<f64>, DMatrix<f64>);

/// A disagreement as a sentence.
pub(super) fn sentence(differ: &str) -> String {
    format!("T{}.", &differ[1..])
}

/// The disagreement, unless chance explains it: in the recording furthest from the mean, the value that alone explains most of the difference.
pub(super) fn disagreement(own: &[Own], names: &[String]) -> Option<String> {
    let [first, _, ..] = own else { return None };
    let count = first.0.len();
    let inverse = |of: &DMatrix<f64>| of.clone().try_inverse();
    let weights: Vec<DMatrix<f64>> = own.iter().map(|(_, covariance)| inverse(covariance)).collect::<Option<_>>()?;
    let all: DMatrix<f64> = weights.iter().sum();
    let weighted = own.iter().zip(&weights).map(|((values, _), weight)| weight * values);
    let sum: DVector<f64> = weighted.sum();
    let mean = inverse(&all)? * &sum;
    let chi = |at: usize| {
        let off = &own[at].0 - &mean;
        off.dot(&(&weights[at] * &off))
    };
    let total: f64 = (0..own.len()).map(chi).sum();
    if total <= chi_square((count * (own.len() - 1)) as f64, LIMIT) {
        return None;
    }
    // Of two, the second differs from the first.
    let at = if own.len() == 2 { 1 } else { (0..own.len()).max_by(|a, b| chi(*a).total_cmp(&chi(*b)))? };
    // Against the others alone: the mean includes the one that differs.
    let others = inverse(&(all - &weights[at]))?;
    let of_others = &others * (sum - &weights[at] * &own[at].0);
    let weight = inverse(&(others + inverse(&weights[at])?))?;
    let score = &weight * (&own[at].0 - &of_others);
    let gain = |k: usize| score[k] * score[k] / weight[(k, k)];
    let k = (0..count).max_by(|a, b| gain(*a).total_cmp(&gain(*b)))?;
    let [by, std] = [score[k] / weight[(k, k)], weight[(k, k)].sqrt().recip()]
        .map(|of| significant(100.0 * of / of_others[k].abs(), 2));
    Some(format!("the recordings differ: {} of recording {} by {by} % ± {std} %", names[k], at + 1))
}
