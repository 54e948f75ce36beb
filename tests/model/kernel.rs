//! The weights against the printed kernels of the paper, and their exact discrete identities.

use magnetic_bearing::estimation::paper::kernel::{ROWS_PER_AXIS, Weights};

/// Largest rounding error of a sum that vanishes, relative to the sum of the absolute terms.
const VANISHING_SUM: f64 = 1e-14;

/// The kernels of position and current in a row of P section III.B, as printed, without the powers of T_f.
fn printed(row: usize, tau: f64) -> [f64; 2] {
    let sum = |terms: &[(f64, i32, i32)]| terms.iter().map(|(c, a, b)| c * (1.0 - tau).powi(*a) * tau.powi(*b)).sum();
    match row {
        0 => [sum(&[(1.0, 3, 0), (-9.0, 2, 1), (9.0, 1, 2), (-1.0, 0, 3)]), sum(&[(0.5, 3, 2), (-0.5, 2, 3)])],
        1 => [sum(&[(-4.0, 3, 1), (18.0, 2, 2), (-12.0, 1, 3), (1.0, 0, 4)]), sum(&[(-4.0 / 6.0, 3, 3), (0.5, 2, 4)])],
        _ => [sum(&[(10.0, 3, 2), (-30.0, 2, 3), (15.0, 1, 4), (-1.0, 0, 5)]), sum(&[(5.0 / 6.0, 3, 4), (-0.5, 2, 5)])],
    }
}

fn assert_vanishes(what: &str, terms: impl Iterator<Item = f64> + Clone) {
    let total: f64 = terms.clone().sum();
    let size: f64 = terms.map(f64::abs).sum();
    assert!(total.abs() <= VANISHING_SUM * size, "{what}: sum {total:e} of terms of total size {size:e}");
}

#[test]
fn constants_and_slopes_are_annihilated() {
    for intervals in [8, 9, 63, 200, 1000, 20_000] {
        let rows = (0..ROWS_PER_AXIS).map(|row| (format!("row {}", row + 1), Weights::paper(row, intervals)));
        for (name, w) in rows.clone().chain([("load".into(), Weights::static_load(intervals))]) {
            let what = |of: &str| format!("N = {intervals}, {name}, {of}");
            assert_vanishes(&what("position, constant"), w.position.iter().copied());
            assert_vanishes(&what("position, slope"), w.position.iter().enumerate().map(|(j, w)| w * j as f64));
        }
        for (name, w) in rows {
            assert_vanishes(&format!("N = {intervals}, {name}, continuous current"), w.node.iter().copied());
            let held = w.held_start.iter().zip(&w.held_end).map(|(a, b)| a + b);
            assert_vanishes(&format!("N = {intervals}, {name}, held current"), held);
        }
    }
}

/// Every inner weight converges to h times the paper's kernel with order 2 in h. The two end weights converge to half of
/// that, as in the paper's trapezoidal rule, with order 1: they contain the end corrections that cancel slopes.
#[test]
fn weights_converge_to_the_printed_kernels_of_the_paper() {
    let errors = |intervals: usize| {
        let h = 1.0 / intervals as f64;
        let [mut position, mut ends, mut current] = [0.0_f64; 3];
        for row in 0..ROWS_PER_AXIS {
            let w = Weights::paper(row, intervals);
            for j in 0..=intervals {
                let [g_z, g_u] = printed(row, j as f64 * h);
                if j == 0 || j == intervals {
                    ends = ends.max((w.position[j] / h - 0.5 * g_z).abs());
                } else {
                    position = position.max((w.position[j] / h - g_z).abs());
                }
                let held = w.held_end[j] + w.held_start.get(j + 1).copied().unwrap_or(0.0);
                current = current.max((w.node[j] / h - g_u).abs()).max((held / h - g_u).abs());
            }
        }
        [position, ends, current]
    };
    let (coarse, fine) = (errors(200), errors(400));
    for (k, (name, wanted)) in [("position", 2.0), ("position, ends", 1.0), ("current", 2.0)].into_iter().enumerate() {
        let order = (coarse[k] / fine[k]).log2();
        assert!((order - wanted).abs() < 0.1, "{name}: order {order}, wanted {wanted}");
    }
}

/// `Σ w_j Z_j = T_f² ∫ φ_h Z̈` for a held force: Z̈ piecewise constant, Z by exact integration. Both sides are exact up to
/// rounding, for any number of intervals.
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
            let is_exact = (left - right).abs() < VANISHING_SUM * size;
            assert!(is_exact, "N = {intervals}, row {}: {left:e}, {right:e}", row + 1);
        }
    }
}
