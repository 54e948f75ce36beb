//! The kernels against the polynomials the paper prints, and exact discrete identities of their weights.

use magnetic_bearing::estimation::paper::kernel::{
    Polynomial, ROWS_PER_AXIS, Weights, paper_current_kernel, paper_position_kernel,
};

/// Rounding of a few additions of numbers of order 100, absolute.
const COEFFICIENT_ROUNDING: f64 = 1e-13;

/// Largest rounding error of a sum that vanishes, relative to the sum of the absolute terms.
const VANISHING_SUM: f64 = 1e-14;

/// `c (1 − τ)^a τ^b`.
fn term(c: f64, a: usize, b: usize) -> Polynomial {
    let mut p = Polynomial::power(b).scaled(c);
    for _ in 0..a {
        p = p.times(&Polynomial::new([1.0, -1.0]));
    }
    p
}

fn sum(terms: &[Polynomial]) -> Polynomial {
    terms.iter().fold(Polynomial::default(), |sum, t| sum.plus(t))
}

fn assert_same(what: &str, got: &Polynomial, wanted: &Polynomial) {
    let n = got.coefficients.len().max(wanted.coefficients.len());
    for k in 0..n {
        let g = got.coefficients.get(k).copied().unwrap_or(0.0);
        let w = wanted.coefficients.get(k).copied().unwrap_or(0.0);
        assert!((g - w).abs() <= COEFFICIENT_ROUNDING, "{what}, coefficient of tau^{k}: {g}, wanted {w}");
    }
}

fn assert_vanishes(what: &str, terms: impl Iterator<Item = f64> + Clone) {
    let total: f64 = terms.clone().sum();
    let size: f64 = terms.map(f64::abs).sum();
    assert!(total.abs() <= VANISHING_SUM * size, "{what}: sum {total:e} of terms of total size {size:e}");
}

/// The six polynomials of P section III.B, as printed, without the powers of T_f.
#[test]
fn kernels_are_those_the_paper_prints() {
    let printed_z = [
        sum(&[term(1.0, 3, 0), term(-9.0, 2, 1), term(9.0, 1, 2), term(-1.0, 0, 3)]),
        sum(&[term(-4.0, 3, 1), term(18.0, 2, 2), term(-12.0, 1, 3), term(1.0, 0, 4)]),
        sum(&[term(10.0, 3, 2), term(-30.0, 2, 3), term(15.0, 1, 4), term(-1.0, 0, 5)]),
    ];
    let printed_u = [
        sum(&[term(0.5, 3, 2), term(-0.5, 2, 3)]),
        sum(&[term(-4.0 / 6.0, 3, 3), term(0.5, 2, 4)]),
        sum(&[term(5.0 / 6.0, 3, 4), term(-0.5, 2, 5)]),
    ];
    for row in 0..ROWS_PER_AXIS {
        assert_same(&format!("g_z,{}", row + 1), &paper_position_kernel(row), &printed_z[row]);
        assert_same(&format!("g_u,{}", row + 1), &paper_current_kernel(row), &printed_u[row]);
    }
}

#[test]
fn constants_and_slopes_are_annihilated() {
    for intervals in [8, 9, 63, 200, 1000, 20_000] {
        for row in 0..ROWS_PER_AXIS {
            let w = Weights::paper(row, intervals);
            let what = |name| format!("N = {intervals}, row {}, {name}", row + 1);
            assert_vanishes(&what("position, constant"), w.position.iter().copied());
            assert_vanishes(&what("position, slope"), w.position.iter().enumerate().map(|(j, w)| w * j as f64));
            assert_vanishes(&what("continuous current, constant"), w.node.iter().copied());
            assert_vanishes(&what("held current, constant"), w.held_start.iter().zip(&w.held_end).map(|(a, b)| a + b));
        }
        let load = Weights::static_load(intervals);
        assert_vanishes("load, position, constant", load.position.iter().copied());
        assert_vanishes("load, position, slope", load.position.iter().enumerate().map(|(j, w)| w * j as f64));
    }
}

/// Every inner weight approaches h times the paper's kernel with the square of h. The two end weights approach half of
/// that, as in the trapezoidal rule of the paper, with the first power: they carry the end corrections with which
/// slopes drop out.
#[test]
fn weights_converge_to_the_kernels() {
    let errors = |intervals: usize| {
        let h = 1.0 / intervals as f64;
        let mut position = 0.0_f64;
        let mut ends = 0.0_f64;
        let mut current = 0.0_f64;
        for row in 0..ROWS_PER_AXIS {
            let w = Weights::paper(row, intervals);
            let (g_z, g_u) = (paper_position_kernel(row), paper_current_kernel(row));
            for j in 0..=intervals {
                let tau = j as f64 * h;
                if j == 0 || j == intervals {
                    ends = ends.max((w.position[j] / h - 0.5 * g_z.value(tau)).abs());
                } else {
                    position = position.max((w.position[j] / h - g_z.value(tau)).abs());
                }
                current = current.max((w.node[j] / h - g_u.value(tau)).abs());
                let held = w.held_end[j] + w.held_start.get(j + 1).copied().unwrap_or(0.0);
                current = current.max((held / h - g_u.value(tau)).abs());
            }
        }
        [position, ends, current]
    };
    let (coarse, fine) = (errors(200), errors(400));
    for (name, wanted, coarse, fine) in [
        ("position", 2.0, coarse[0], fine[0]),
        ("position, ends", 1.0, coarse[1], fine[1]),
        ("current", 2.0, coarse[2], fine[2]),
    ] {
        let order = (coarse / fine).log2();
        assert!((order - wanted).abs() < 0.1, "{name}: order {order}, wanted {wanted}");
    }
}

/// `Σ w_j Z_j = T_f² ∫ φ_h Z̈` for a held force: Z̈ piecewise constant, Z by exact integration. Neither side has an
/// error but rounding, on any number of intervals.
#[test]
fn weak_form_is_exact_for_held_forces() {
    for intervals in [8, 20, 200] {
        let force = |j: usize| libm::sin(1.7 * (j * j) as f64) + 0.3;
        let h = 1.0 / intervals as f64;
        let (mut z, mut v) = (0.4, -3.0);
        let mut positions = vec![z];
        for j in 0..intervals {
            z += h * v + 0.5 * h * h * force(j);
            v += h * force(j);
            positions.push(z);
        }
        for row in 0..ROWS_PER_AXIS {
            let w = Weights::paper(row, intervals);
            let left: f64 = w.position.iter().zip(&positions).map(|(w, z)| w * z).sum();
            let right: f64 = (1..=intervals).map(|j| (w.held_start[j] + w.held_end[j]) * force(j - 1)).sum();
            let size: f64 = w.position.iter().map(|w| w.abs()).sum();
            assert!(
                (left - right).abs() < VANISHING_SUM * size,
                "N = {intervals}, row {}: {left:e}, {right:e}",
                row + 1
            );
        }
    }
}
