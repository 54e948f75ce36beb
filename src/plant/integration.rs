//! Fixed-step integration of the motion, without allocation.

use super::Motion;

/// Relative amount by which a duration may exceed a whole number of sub-steps without adding another.
///
/// It absorbs the rounding of the division: 1e-4/5e-5 gives two sub-steps, not three. Sub-steps exceed the requested length by at
/// most this fraction.
pub const ROUNDING: f64 = 1e-9;

/// One step of the classical Runge–Kutta method of order 4 from `x` at time `t` over `h`; `f(t, x)` is dx/dt.
///
/// The local error is of order h⁵, the global error of order h⁴.
pub fn rk4<const N: usize, const K: usize>(
    x: Motion<f64, N, K>,
    t: f64,
    h: f64,
    f: impl Fn(f64, &Motion<f64, N, K>) -> Motion<f64, N, K>,
) -> Motion<f64, N, K> {
    let along = |slope: &Motion<f64, N, K>, h: f64| x.with(slope, |x, slope| x + h * slope);
    let half = 0.5 * h;
    let k_1 = f(t, &x);
    let k_2 = f(t + half, &along(&k_1, half));
    let k_3 = f(t + half, &along(&k_2, half));
    let k_4 = f(t + h, &along(&k_3, h));
    let sum = k_1.with(&k_2.with(&k_3, |k_2, k_3| 2.0 * (k_2 + k_3)), |k_1, middle| k_1 + middle);
    along(&sum.with(&k_4, |sum, k_4| sum + k_4), h / 6.0)
}

/// Number of equal sub-steps of `duration`, none longer than `max_step` in the same unit, with the tolerance [`ROUNDING`]; at least 1.
pub fn substeps(duration: f64, max_step: f64) -> usize {
    // The conversion saturates, and maps NaN to 0.
    let whole = (duration / max_step * (1.0 - ROUNDING)).ceil() as usize;
    whole.max(1)
}
