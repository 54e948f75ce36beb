//! Means, ranges and noise of values, of which some may not be known.

/// The mean of the values that are known.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let known = values.into_iter().filter(|value| value.is_finite());
    let (sum, count) = known.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

/// The root of the mean square; 0 of nothing.
pub fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) =
        values.into_iter().fold((0.0, 0.0_f64), |(sum, count), value| (sum + value * value, count + 1.0));
    (sum / count.max(1.0)).sqrt()
}

/// The median of finite values; NaN if there are none.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().filter(|value| value.is_finite()).collect();
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Lowest and highest of the known values; 0 if there are none.
pub fn range(values: impl IntoIterator<Item = f64>) -> [f64; 2] {
    let known = values.into_iter().filter(|value| value.is_finite());
    known.map(|value| [value, value]).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or_default()
}

/// Standard deviation of white noise from fourth differences, whose squares sum to 70.
pub fn noise(values: &[f64]) -> f64 {
    let fourth = |v: &[f64]| v[0] - 4.0 * v[1] + 6.0 * v[2] - 4.0 * v[3] + v[4];
    (mean(values.windows(5).map(|v| fourth(v).powi(2))) / 70.0).sqrt()
}
