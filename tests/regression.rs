//! Solving small systems, in two ways that know nothing of each other.

use magnetic_bearing::model::regression::{
    CONDITION_CAP, Definite, Equations, NormalMatrix, NormalVector, SymmetricEigen, condition,
};

/// Random definite matrices with eigenvalues over so many powers of ten.
fn matrix(seed: u64, unknowns: usize, decades: f64) -> NormalMatrix {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut number = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    let mut matrix = NormalMatrix::zeros();
    for row in 0..8 {
        let scale = 10.0_f64.powf(-decades * f64::from(row) / 8.0);
        let direction = NormalVector::from_fn(|k, _| if k < unknowns { number() } else { 0.0 });
        matrix += direction * direction.transpose() * scale;
    }
    matrix
}

#[test]
fn factors_and_eigenvalues_agree() {
    for unknowns in [3, 5] {
        for seed in 1..200 {
            for decades in [0.0, 3.0, 6.0] {
                let matrix = matrix(seed, unknowns, decades);
                let eigen = SymmetricEigen::new(&matrix, unknowns);
                let near = 1e-12 * eigen.condition() * eigen.condition();
                if near > 1e-3 {
                    continue;
                }
                let other = condition(&matrix, unknowns);
                assert!((other / eigen.condition() - 1.0).abs() < near, "{other}, wanted {}", eigen.condition());
                let factors = Definite::new(&matrix, unknowns).expect("a definite matrix");
                let h = NormalVector::from_fn(|k, _| if k < unknowns { 1.0 + k as f64 } else { 0.0 });
                let [x, wanted] = [factors.solve(&h), eigen.solve(&h)].map(|x| x.expect("a solution"));
                assert!((x - wanted).norm() < near * wanted.norm(), "{x} {wanted}");
                let [inverse, wanted] =
                    [factors.inverse(), eigen.inverse()].map(|inverse| inverse.expect("an inverse"));
                assert!((inverse - wanted).norm() < near * wanted.norm(), "{inverse} {wanted}");
            }
        }
    }
}

#[test]
fn a_diagonal_is_its_own_eigenvalues() {
    let matrix = NormalMatrix::from_diagonal(&NormalVector::from([4.0, 1.0, 25.0, 9.0, 16.0]));
    assert_eq!(condition(&matrix, 5), 5.0);
    assert_eq!(condition(&matrix, 3), 5.0);
}

#[test]
fn what_has_no_solution_has_none() {
    let mut singular = NormalMatrix::repeat(1.0);
    let nan = NormalMatrix::repeat(f64::NAN);
    let huge = NormalMatrix::repeat(1e300);
    let indefinite = NormalMatrix::from_diagonal(&NormalVector::from([1.0, -1.0, 1.0, 1.0, 1.0]));
    for matrix in [NormalMatrix::zeros(), singular, nan, huge, indefinite, nan * 0.0, huge * 1e300] {
        for unknowns in [3, 5] {
            assert!(Definite::new(&matrix, unknowns).is_none(), "{matrix}");
            assert!(condition(&matrix, unknowns) > 1e7, "{matrix}: {}", condition(&matrix, unknowns));
        }
    }
    // Without rotation the columns of the unbalance vanish.
    singular = NormalMatrix::zeros();
    singular.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
    let equations = Equations::new(&singular, 5);
    assert_eq!(equations.condition(), CONDITION_CAP);
    assert!(equations.solve(&NormalVector::repeat(1.0)).is_none() && equations.inverse().is_none());
    assert_eq!(Equations::new(&singular, 3).condition(), 1.0);
}

/// The scale of the unbalance, which changes with ω⁴, changes nothing but the unit.
#[test]
fn columns_of_the_unbalance_have_any_size() {
    let plain = matrix(7, 5, 1.0);
    let wanted = Equations::new(&plain, 5);
    for size in [1e-6, 1e3] {
        let unit = NormalMatrix::from_diagonal(&NormalVector::from([1.0, 1.0, 1.0, size, size]));
        let other = Equations::new(&(unit * plain * unit), 5);
        assert!((other.condition() / wanted.condition() - 1.0).abs() < 1e-9);
        let h = NormalVector::repeat(1.0);
        let [x, y] = [(&other, unit * h), (&wanted, h)].map(|(equations, h)| equations.solve(&h).expect("a solution"));
        assert!((unit * x - y).norm() < 1e-9 * y.norm());
    }
}
