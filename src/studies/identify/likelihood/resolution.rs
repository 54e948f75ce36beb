//! Quantised positions: their step, and how many readings differ.

use std::collections::HashSet;

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

/// The step of quantised values; 0 if they are not quantised.
pub(super) fn step(values: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.filter(|value| value.is_finite()).take(ROWS).collect();
    let count = sorted.len();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    let mut steps: Vec<f64> = sorted.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if steps.is_empty() || TIMES * sorted.len() > count {
        return 0.0;
    }
    let middle = steps.len() / 2;
    let step = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
    let is_multiple = |of: &&f64| (**of / step - (**of / step).round()).abs() < ROUNDING;
    let even = steps.iter().filter(is_multiple).count();
    if even as f64 >= EVEN * steps.len() as f64 { step } else { 0.0 }
}

/// How many of the readings tell something new if the steps are coarse beside the noise: errors of quantisation depend on the place alone then, and come again with
/// it.
pub(super) fn different(readings: impl Iterator<Item = [f64; 2]>, steps: [f64; 2], noise: f64) -> Option<usize> {
    let is_coarse = steps.iter().any(|step| noise < COARSE * step);
    is_coarse.then(|| readings.map(|reading| reading.map(f64::to_bits)).collect::<HashSet<_>>().len())
}
