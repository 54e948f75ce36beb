//! Quantised positions: their step, and as how many readings they count.

use std::f64::consts::PI;

use crate::studies::statistics::median;

/// Rows in which a step is looked for.
const ROWS: usize = 10_000;
/// A column is quantised if its values occur so many times on average ...
const TIMES: usize = 4;
/// ... and so many of their distances are multiples of one step, but for a part of it that rounding in a text makes.
const EVEN: f64 = 0.98;
const ROUNDING: f64 = 0.02;
/// Noise below this part of the step leaves errors of quantisation that repeat: at 0.28 steps of normal noise and 1/√12 of quantisation, 0.4 in all, the error
/// that the noise does not smooth out is a fifth of the step's (Widrow and Kollár 2008, *Quantization Noise*).
const COARSE: f64 = 0.4;
/// Harmonics of the error of quantisation.
const HARMONICS: u32 = 50;

/// The step of quantised values; 0 if they are not quantised.
pub(super) fn step(values: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.filter(|value| value.is_finite()).take(ROWS).collect();
    let count = sorted.len();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    let steps: Vec<f64> = sorted.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if steps.is_empty() || TIMES * sorted.len() > count {
        return 0.0;
    }
    let step = median(steps.iter().copied());
    let is_multiple = |of: &&f64| (**of / step - (**of / step).round()).abs() < ROUNDING;
    let even = steps.iter().filter(is_multiple).count();
    if even as f64 >= EVEN * steps.len() as f64 { step } else { 0.0 }
}

/// As how many readings they count if the steps are coarse beside the noise: a part of the errors of quantisation depends on the place alone then, and comes again
/// with it.
///
/// Noise of variance σ² before a converter with step q leaves the mean error `Σ_n (−1)ⁿ q/(π n) exp(−2 π² n² σ²/q²) sin(2 π n x/q)` at x (Widrow and Kollár 2008,
/// *Quantization Noise*), of variance ρ of all noise. It is as if the part ρ of the variance were averaged over the readings that differ, and the rest over all.
/// On `scripts/faults.py` (1 µm, 80 seeds from 9001, true parameters) the rms error of λ is 0.9 of its deviations; with all readings it is 2.2, with those that differ alone 0.6.
pub(super) fn counting(position: &[&[f64]], rows: &[usize], steps: &[f64], noise: f64) -> Option<usize> {
    if !steps.iter().any(|step| noise < COARSE * step) {
        return None;
    }
    let reading = |row: usize| position.iter().map(move |of| of[row].to_bits());
    let mut different = rows.to_vec();
    different.sort_unstable_by(|a, b| reading(*a).cmp(reading(*b)));
    different.dedup_by(|a, b| reading(*a).eq(reading(*b)));
    let repeats = steps.iter().map(|step| repeating(*step, noise)).fold(0.0, f64::max);
    let all = rows.len() as f64;
    Some((all / (1.0 - repeats + repeats * all / different.len().max(1) as f64)) as usize)
}

/// Part of the variance of readings with this noise, the errors of quantisation included, that depends on the place alone.
fn repeating(step: f64, noise: f64) -> f64 {
    if step == 0.0 {
        return 0.0;
    }
    let square = (noise * noise / (step * step)).max(1e-9);
    let before = (square - 1.0 / 12.0).max(0.0);
    let harmonic = |n: f64| 0.5 / (PI * n).powi(2) * libm::exp(-(2.0 * PI * n).powi(2) * before);
    ((1..=HARMONICS).map(|n| harmonic(f64::from(n))).sum::<f64>() / square).min(1.0)
}
