//! Means, ranges and noise of values, some of which may be NaN.

use std::borrow::Borrow;

/// The finite values.
fn finite(values: impl IntoIterator<Item: Borrow<f64>>) -> impl Iterator<Item = f64> {
    values.into_iter().map(|value| *value.borrow()).filter(|value| value.is_finite())
}

/// The mean of the finite values.
pub fn mean(values: impl IntoIterator<Item: Borrow<f64>>) -> f64 {
    let (sum, count) = finite(values).fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

/// The mean and the variance of the finite values.
pub fn spread(values: impl Iterator<Item: Borrow<f64>> + Clone) -> [f64; 2] {
    let middle = mean(values.clone());
    [middle, mean(values.map(|value| (value.borrow() - middle).powi(2)))]
}

/// The root mean square; 0 if there are no values.
pub fn rms(values: impl IntoIterator<Item: Borrow<f64>>) -> f64 {
    let squares = values.into_iter().map(|value| value.borrow() * value.borrow());
    let (sum, count) = squares.fold((0.0, 0.0_f64), |(sum, count), square| (sum + square, count + 1.0));
    (sum / count.max(1.0)).sqrt()
}

/// The median of finite values; NaN if there are none.
pub fn median(values: impl IntoIterator<Item: Borrow<f64>>) -> f64 {
    quantile(values, 0.5)
}

/// The value that exceeds this part of the finite values, less than all; NaN if there are none.
pub fn quantile(values: impl IntoIterator<Item: Borrow<f64>>, part: f64) -> f64 {
    let mut values: Vec<f64> = finite(values).collect();
    if values.is_empty() {
        return f64::NAN;
    }
    let at = (part * values.len() as f64) as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

/// Minimum and maximum of the finite values; 0 if there are none.
pub fn range(values: impl IntoIterator<Item: Borrow<f64>>) -> [f64; 2] {
    finite(values).map(|value| [value, value]).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or_default()
}

/// Standard deviation of white noise from fourth differences; the squares of their coefficients sum to 70.
pub fn noise(values: &[f64]) -> f64 {
    let fourth = |v: &[f64]| v[0] - 4.0 * v[1] + 6.0 * v[2] - 4.0 * v[3] + v[4];
    (mean(values.windows(5).map(|v| fourth(v).powi(2))) / 70.0).sqrt()
}
