//! Whether separate estimates from recordings of one bench agree: χ² about their weighted mean.

use nalgebra::{DMatrix, DVector};

use super::units::significant;
use crate::estimation::chi_square;

/// Normal deviate of the χ² that chance exceeds with a probability of 10⁻⁴.
const LIMIT: f64 = 3.719;

/// Estimates of one recording: values with their covariance.
pub(super) type Own = (DVector<f64>, DMatrix<f64>);

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
    let at = (0..own.len()).max_by(|a, b| chi(*a).total_cmp(&chi(*b)))?;
    // Against the others alone: the mean includes the one that differs.
    let others = inverse(&(all - &weights[at]))?;
    let of_others = &others * (sum - &weights[at] * &own[at].0);
    let weight = inverse(&(others + inverse(&weights[at])?))?;
    let score = &weight * (&own[at].0 - &of_others);
    let gain = |k: usize| score[k] * score[k] / weight[(k, k)];
    let k = (0..count).max_by(|a, b| gain(*a).total_cmp(&gain(*b)))?;
    let [by, std] =
        [score[k] / weight[(k, k)], weight[(k, k)].sqrt().recip()].map(|of| significant(100.0 * of / of_others[k], 2));
    Some(format!("the recordings differ: {} of recording {} by {by} % ± {std} %", names[k], at + 1))
}
