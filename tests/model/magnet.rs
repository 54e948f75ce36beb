//! Magnets: forces, allocation, and geometries that cannot carry a rotor.

use crate::prelude::*;

use magnetic_bearing::bearing::magnet::{Geometry, Magnets, SMALLEST_SINE, currents, forces};

const GAP_M: f64 = 5e-4;
const ALPHA_RAD: [f64; 3] = [PI, -PI / 3.0, PI / 3.0];

/// Error of a force relative to the forces around it: a few dozen roundings.
const ROUNDING: f64 = 1e-13;

/// Number of random forces and geometries tried.
const TRIALS: usize = 2000;

/// Magnets in a plane: their forces, and their geometry.
struct Bearing<const K: usize>(Magnets, Geometry<f64, 2, K>);

impl<const K: usize> Bearing<K> {
    fn new(gap_m: f64, alpha_rad: [f64; K]) -> Result<Self, Vec<Invalid>> {
        let geometry = Geometry { gap_m: [gap_m; K], directions: alpha_rad.map(|alpha| alpha.sine_cosine().into()) };
        Checks::all(|checks| Magnets::checked(gap_m, &alpha_rad, checks)).map(|magnets| Self(magnets, geometry))
    }

    fn allocate(&self, force_n: [f64; 2], f0_n: &[f64]) -> [f64; K] {
        let mut forces_n = [0.0; K];
        self.0.allocate(force_n, f0_n, &mut forces_n);
        forces_n
    }
}

fn distance<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
    a.into_iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn gaps_and_forces_are_those_of_the_paper() {
    let magnets = Bearing::new(GAP_M, ALPHA_RAD).expect("the paper's geometry");
    // Magnet 1 is below, magnets 2 and 3 are above to the left and to the right.
    let gaps = magnets.1.gaps([1e-4, 2e-4]);
    let expected = [GAP_M + 2e-4, GAP_M + 1e-4 * (PI / 3.0).sin() - 1e-4, GAP_M - 1e-4 * (PI / 3.0).sin() - 1e-4];
    below("gaps in m", distance(gaps, expected), ROUNDING * GAP_M);
    // 2e-6 N·m²/A² · (2 A)² / (0.5 mm)² = 32 N.
    let pull = forces([2e-6; 3], [2.0, -2.0, 0.0], [GAP_M; 3]);
    below("forces in N", distance(pull, [32.0, 32.0, 0.0]), 32.0 * ROUNDING);
    assert_eq!(currents([-1.0; 3], gaps, [2e-6; 3]), [0.0; 3], "a magnet does not push");
    let [f_y, f_z] = magnets.1.resultant([7.0, 3.0, 5.0]);
    below("F_y in N", (f_y - 3f64.sqrt() / 2.0 * (5.0 - 3.0)).abs(), 7.0 * ROUNDING);
    below("F_z in N", (f_z - (-7.0 + (3.0 + 5.0) / 2.0)).abs(), 7.0 * ROUNDING);
}

/// For any number of magnets. With three, the forces with a given resultant and the smallest force `F0` are unique. A quarter of all random
/// triples surrounds the rotor; near the limit of parallel magnets the inverse loses a square of the sine. Fails if `c` is the mean
/// instead of the largest need.
#[test]
fn the_allocation_is_exact_for_any_admissible_angles() {
    fn holds<const K: usize>(alpha_rad: [f64; K], random: &mut Noise, parts: [f64; 2]) -> bool {
        let Ok(magnets) = Bearing::new(GAP_M, alpha_rad) else { return false };
        let wanted = [100.0 * random.standard_normal(), 100.0 * random.standard_normal()];
        let forces = magnets.allocate(wanted, &[20.0; 2]);
        let least = forces.into_iter().fold(f64::INFINITY, f64::min);
        let limits = parts.map(|part| part * forces.into_iter().fold(0.0, f64::max));
        below(&format!("resultant at {alpha_rad:?} rad"), distance(magnets.1.resultant(forces), wanted), limits[0]);
        assert!(least >= 20.0, "smallest of {forces:?} N");
        below("smallest force above F0 in N", least - 20.0, limits[1]);
        true
    }
    let mut random = Noise::sequence(2)();
    let triple = |_: &usize| {
        let alpha_rad = [0; 3].map(|_| 4.0 * random.standard_normal());
        holds(alpha_rad, &mut random, [ROUNDING / SMALLEST_SINE, ROUNDING])
    };
    let admissible = (0..TRIALS).filter(triple).count();
    assert!(admissible > TRIALS / 5, "{admissible} of {TRIALS} geometries admitted");
    for _ in 0..10 {
        let parts = [ROUNDING, 0.1 * ROUNDING];
        assert!(holds([0.0, 0.5 * PI, PI, 1.5 * PI], &mut random, parts));
        assert!(holds([0.1, 1.7, 2.5, 4.0, 5.6], &mut random, parts));
        assert!(holds([0.0, 1.0, 2.0, 3.0, 4.0, 5.0], &mut random, parts));
        // The first three hold the rotor; the fourth has its counterpart among them.
        assert!(holds([0.0, 2.0, 4.0, 4.1], &mut random, parts));
    }
}

#[test]
fn impossible_geometry_is_refused_by_name() {
    let cases: [(&[f64], &[&str]); 7] = [
        (&[PI, 0.5, 0.5], &["alpha[3]"]),
        (&[0.5, 0.5 + PI, -2.0], &["alpha[2]"]),
        (&[0.7, 0.7, 0.7], &["alpha[2]", "alpha[3]", "alpha[3]"]),
        // Degrees.
        (&[45.0, 135.0, 225.0, 0.1], &["alpha[1]", "alpha[2]", "alpha[3]"]),
        // All above the rotor; the middle one is named.
        (&[0.1, -1.0, 1.0], &["alpha[1]"]),
        (&[-1.0, 0.4, 1.0], &["alpha[2]"]),
        (&[0.0, 0.5, 1.0, 1.5], &["alpha[2]"]),
    ];
    for (alpha_rad, names) in cases {
        let found =
            Checks::all(|checks| Magnets::checked(GAP_M, alpha_rad, checks)).expect_err(&format!("{alpha_rad:?} rad"));
        let found: Vec<_> = found.iter().map(|finding| finding.name.as_ref()).collect();
        assert_eq!(found, names, "{alpha_rad:?} rad");
    }
}
