//! Fixed-step integration of ordinary differential equations, without allocation.

/// Part of a sub-step by which a duration may exceed a whole number of them and still count as that number.
///
/// It takes up the rounding of the division: 1e-4/5e-5 are two sub-steps, not three. The sub-steps are
/// then longer than asked for by at most this part.
pub const ROUNDING: f64 = 1e-9;

/// One step of the classical Runge–Kutta method of order 4 from `x` at time `t` over `h`; `f(t, x)` is dx/dt.
///
/// The error of one step is of order h⁵, that of many steps over a fixed time of order h⁴.
pub fn rk4<const N: usize>(x: [f64; N], t: f64, h: f64, f: impl Fn(f64, &[f64; N]) -> [f64; N]) -> [f64; N] {
    let along = |slope: &[f64; N], h: f64| -> [f64; N] { std::array::from_fn(|i| x[i] + h * slope[i]) };
    let half = 0.5 * h;
    let k_1 = f(t, &x);
    let k_2 = f(t + half, &along(&k_1, half));
    let k_3 = f(t + half, &along(&k_2, half));
    let k_4 = f(t + h, &along(&k_3, h));
    std::array::from_fn(|i| x[i] + h / 6.0 * (k_1[i] + 2.0 * (k_2[i] + k_3[i]) + k_4[i]))
}

/// Number of equal sub-steps into which `duration` is divided so that none is longer than `max_step`; at least 1.
///
/// Both in the same unit. [`ROUNDING`] says how far "longer" is taken.
pub fn substeps(duration: f64, max_step: f64) -> usize {
    // The conversion saturates, and turns what is no number into 0.
    let whole = (duration / max_step * (1.0 - ROUNDING)).ceil() as usize;
    whole.max(1)
}
