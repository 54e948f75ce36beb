//! Response of the controller to its position readings: part of the currents.
//!
//! A controller responds to the noise of its position sensor with currents that may be too small to see in their own noise, and yet hold
//! the rotor. A filter without them takes the rotor for less unstable than it is, and overestimates κ. Therefore the impulse
//! response of the currents is found by least squares, constant between the lags 1, 2, 3, 4, 6, 8, 12, … rows. The position readings are exact here:
//! they are the input of the controller.

use nalgebra::{DMatrix, DVector};

use super::filter::Readings;

/// Approximate length of the response, s: controllers of levitated bodies respond within some time constants √(m/ks), 10 to 30 ms.
const RESPONSE_S: f64 = 0.064;
/// Time constant of the high-pass, s, a quarter of that length. References followed by the controller are slower.
const HIGH_PASS_S: f64 = 0.016;

/// Changes of the currents per row due to the controller's response to the position, A; the response is fitted to the rows that count.
pub(super) fn feedback(readings: &Readings) -> Vec<Vec<f64>> {
    let x_m = hold_last(&readings.x_m);
    let part = |current: &Vec<f64>| {
        let edges = edges(RESPONSE_S / readings.step_s);
        let bins: Vec<[usize; 2]> = edges.windows(2).map(|pair| [pair[0], pair[1]]).collect();
        let response =
            response(readings, &x_m, &hold_last(current), &bins).unwrap_or_else(|| DVector::zeros(bins.len()));
        let at = |row: usize, lag: usize| x_m[row.saturating_sub(lag)];
        let change = |row: usize| {
            response.iter().zip(&bins).map(|(gain, [from, to])| gain * (at(row, *from) - at(row, *to))).sum()
        };
        (0..x_m.len()).map(change).collect()
    };
    readings.current_a.iter().map(part).collect()
}

/// Edges of the lag bins: 1, 2, 3, 4, 6, 8, 12, 16, ….
fn edges(longest: f64) -> Vec<usize> {
    let powers = (1..).map(|power| 1 << power).take_while(|lag| *lag as f64 <= longest.max(2.0));
    std::iter::once(1).chain(powers.flat_map(|lag: usize| [lag, lag + lag / 2])).collect()
}

/// Gains of the bins, A/m, by least squares over the rows that count.
fn response(readings: &Readings, x_m: &[f64], current_a: &[f64], bins: &[[usize; 2]]) -> Option<DVector<f64>> {
    let [moved, driven] = [x_m, current_a].map(|of| high_pass_sum(of, readings.step_s));
    let longest = bins.last()?[1];
    let (mut normal, mut right) = (DMatrix::zeros(bins.len(), bins.len()), DVector::zeros(bins.len()));
    for row in readings.rows.start.max(longest)..readings.rows.end {
        let before =
            DVector::from_iterator(bins.len(), bins.iter().map(|[from, to]| moved[row - from] - moved[row - to]));
        normal.ger(1.0, &before, &before, 1.0);
        right.axpy(driven[row] - driven[row - 1], &before, 1.0);
    }
    Some(normal.cholesky()?.solve(&right))
}

/// Cumulative sum of a signal after a third-order high-pass with a triple real pole; its differences are the filtered signal.
fn high_pass_sum(of: &[f64], step_s: f64) -> Vec<f64> {
    let pole = libm::exp(-step_s / HIGH_PASS_S);
    let mut high_passed: Vec<f64> = of.iter().map(|value| value - of[0]).collect();
    for order in 0..3 {
        let (mut sum, mut before) = (0.0, 0.0);
        for value in &mut high_passed {
            let now = *value;
            sum = pole * sum + now - if order == 0 { 0.0 } else { before };
            before = now;
            *value = sum;
        }
    }
    high_passed
}

/// Readings with the previous one where there is none: the filter must not use a later one.
fn hold_last(of: &[f64]) -> Vec<f64> {
    let mut last = of.iter().copied().find(|value| value.is_finite()).unwrap_or(0.0);
    let hold = |value: &f64| {
        if value.is_finite() {
            last = *value;
        }
        last
    };
    of.iter().map(hold).collect()
}
