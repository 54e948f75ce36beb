//! The kernels against the polynomials the paper prints, and exact discrete identities of their weights.

use magnetic_bearing::estimation::paper::kernel::{ROWS_PER_AXIS, Weights};

/// Largest rounding error of a sum that vanishes, relative to the sum of the absolute terms.
const VANISHING_SUM: f64 = 1e-14;

/// Terms `c (1 − τ)^a τ^b` of a polynomial.
type Terms = &'static [(f64, i32, i32)];

/// The six polynomials of P section III.B, as printed, without the powers of T_f: g_z and g_u of each row.
const PRINTED: [[Terms; 2]; ROWS_PER_AXIS] = [
    [&[(1.0, 3, 0), (-9.0, 2, 1), (9.0, 1, 2), (-1.0, 0, 3)], &[(0.5, 3, 2), (-0.5, 2, 3)]],
    [&[(-4.0, 3, 1), (18.0, 2, 2), (-12.0, 1, 3), (1.0, 0, 4)], &[(-4.0 / 6.0, 3, 3), (0.5, 2, 4)]],
    [&[(10.0, 3, 2), (-30.0, 2, 3), (15.0, 1, 4), (-1.0, 0, 5)], &[(5.0 / 6.0, 3, 4), (-0.5, 2, 5)]],
];

/// The value of a polynomial at τ.
fn value(terms: Terms, tau: f64) -> f64 {
    terms.iter().map(|(c, a, b)| c * (1.0 - tau).powi(*a) * tau.powi(*b)).sum()
}

fn assert_vanishes(what: &str, terms: impl Iterator<Item = f64> + Clone) {
    let total: f64 = terms.clone().sum();
    let size: f64 = terms.map(f64::abs).sum();
    assert!(total.abs() <= VANISHING_SUM * size, "{what}: sum {total:e} of terms of total size {size:e}");
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

/// Every inner weight approaches h times the kernel that the paper prints with the square of h. The two end weights approach half of
/// that, as in the trapezoidal rule of the paper, with the first power: they carry the end corrections with which
/// slopes drop out.
#[test]
fn weights_converge_to_the_kernels() {
    let errors = |intervals: usize| {
        let h = 1.0 / intervals as f64;
        let mut position = 0.0_f64;
        let mut ends = 0.0_f64;
        let mut current = 0.0_f64;
        for (row, [g_z, g_u]) in PRINTED.into_iter().enumerate() {
            let w = Weights::paper(row, intervals);
            for j in 0..=intervals {
                let tau = j as f64 * h;
                if j == 0 || j == intervals {
                    ends = ends.max((w.position[j] / h - 0.5 * value(g_z, tau)).abs());
                } else {
                    position = position.max((w.position[j] / h - value(g_z, tau)).abs());
                }
                current = current.max((w.node[j] / h - value(g_u, tau)).abs());
                let held = w.held_end[j] + w.held_start.get(j + 1).copied().unwrap_or(0.0);
                current = current.max((held / h - value(g_u, tau)).abs());
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
