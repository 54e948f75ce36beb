//! Fixed-step integration of ordinary differential equations, without allocation.

/// Fraction of a sub-step by which a duration may exceed a whole number of them and still count as that number.
///
/// It absorbs the rounding of the division: 1e-4/5e-5 are two sub-steps, not three. The sub-steps are then longer than
/// requested by at most this fraction.
pub const ROUNDING: f64 = 1e-9;

/// A vector, for [`rk4`].
pub trait Vector: Copy {
    /// The vector whose components are `f` of the components of `all`.
    fn combined<const M: usize>(all: [&Self; M], f: impl Fn([f64; M]) -> f64) -> Self;
}

impl<const N: usize> Vector for [f64; N] {
    #[inline]
    fn combined<const M: usize>(all: [&Self; M], f: impl Fn([f64; M]) -> f64) -> Self {
        std::array::from_fn(|i| f(all.map(|x| x[i])))
    }
}

/// Coordinates and their rates.
impl<const N: usize> Vector for [[f64; N]; 2] {
    #[inline]
    fn combined<const M: usize>(all: [&Self; M], f: impl Fn([f64; M]) -> f64) -> Self {
        std::array::from_fn(|part| Vector::combined(all.map(|x| &x[part]), &f))
    }
}

/// One step of the classical Runge–Kutta method of order 4 from `x` at time `t` over `h`; `f(t, x)` is dx/dt.
///
/// The error of one step is of order h⁵, that of many steps over a fixed time of order h⁴.
pub fn rk4<V: Vector>(x: V, t: f64, h: f64, f: impl Fn(f64, &V) -> V) -> V {
    let along = |slope: &V, h: f64| V::combined([&x, slope], |[x, slope]| x + h * slope);
    let half = 0.5 * h;
    let k_1 = f(t, &x);
    let k_2 = f(t + half, &along(&k_1, half));
    let k_3 = f(t + half, &along(&k_2, half));
    let k_4 = f(t + h, &along(&k_3, h));
    V::combined([&x, &k_1, &k_2, &k_3, &k_4], |[x, k_1, k_2, k_3, k_4]| x + h / 6.0 * (k_1 + 2.0 * (k_2 + k_3) + k_4))
}

/// Number of equal sub-steps of `duration` such that none is longer than `max_step`; at least 1.
///
/// Both in the same unit, with the tolerance [`ROUNDING`].
pub fn substeps(duration: f64, max_step: f64) -> usize {
    // The conversion saturates, and maps NaN to 0.
    let whole = (duration / max_step * (1.0 - ROUNDING)).ceil() as usize;
    whole.max(1)
}
