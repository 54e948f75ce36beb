//! Sliding sums against sums computed afresh, in twice the precision.

use magnetic_bearing::model::kernel::Weights;
use magnetic_bearing::model::sliding::{SlidingState, SlidingSums, Sums, Way};
use magnetic_bearing::model::window::{Sample, WindowSums};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const LANES: usize = 3;
const TERMS: usize = 8;
const KERNELS: usize = 4;
type Engine = SlidingSums<LANES, TERMS, KERNELS>;

/// Largest error allowed, relative to `Σ |w x|`. Rounding of random signs makes about `ε √L`, which is 2e-14 at
/// L = 20,000; measured are 8e-15 up to L = 2000 and 2e-14 there.
const TOLERANCE: f64 = 5e-14;

/// Kernels like those of the estimator: `(1 + v)^a (1 − v)^b` of degree 7 and less.
fn kernels() -> [[f64; TERMS]; KERNELS] {
    let product = |a: usize, b: usize| {
        let mut coefficients = [0.0; TERMS];
        coefficients[0] = 1.0;
        for factor in 0..a + b {
            let sign = if factor < a { 1.0 } else { -1.0 };
            for d in (1..TERMS).rev() {
                coefficients[d] += sign * coefficients[d - 1];
            }
        }
        coefficients
    };
    // One changes its sign, as derivatives do.
    let mut odd = product(3, 3);
    odd.rotate_right(1);
    [product(2, 2), product(3, 2), product(5, 2), odd]
}

/// A number as the unevaluated sum of two, about 106 bits.
#[derive(Clone, Copy)]
struct Double(f64, f64);

impl Double {
    fn sum(a: f64, b: f64) -> Self {
        let sum = a + b;
        let rest = sum - a;
        Self(sum, (a - (sum - rest)) + (b - rest))
    }

    fn plus(self, other: Self) -> Self {
        let Self(high, low) = Self::sum(self.0, other.0);
        Self::sum(high, low + self.1 + other.1)
    }

    fn times(self, other: Self) -> Self {
        let high = self.0 * other.0;
        let low = self.0.mul_add(other.0, -high) + self.0 * other.1 + self.1 * other.0;
        Self::sum(high, low)
    }

    fn quotient(a: f64, b: f64) -> Self {
        let high = a / b;
        Self(high, (-high).mul_add(b, a) / b)
    }
}

/// `Σ w x` and `Σ |w x|` over a window, from its definition.
fn afresh(window: &[[f64; LANES]]) -> (Sums<LANES, KERNELS>, Sums<LANES, KERNELS>) {
    let mut sums = [[Double(0.0, 0.0); LANES]; KERNELS];
    let mut sizes = [[0.0; LANES]; KERNELS];
    let length = window.len() as f64;
    for (j, sample) in window.iter().enumerate() {
        let v = Double::quotient(2.0 * j as f64 - (length - 1.0), length + 1.0);
        for (k, kernel) in kernels().iter().enumerate() {
            let weight = kernel.iter().rev().fold(Double(0.0, 0.0), |sum, a| sum.times(v).plus(Double(*a, 0.0)));
            for lane in 0..LANES {
                let product = weight.times(Double(sample[lane], 0.0));
                sums[k][lane] = sums[k][lane].plus(product);
                sizes[k][lane] += product.0.abs();
            }
        }
    }
    (sums.map(|lanes| lanes.map(|sum| sum.0)), sizes)
}

/// A constant with noise, as squares of currents are; a swing about zero, as positions are; noise.
fn samples() -> impl FnMut(usize) -> [f64; LANES] {
    let mut random = Pcg64Mcg::seed_from_u64(20);
    move |j| {
        let noise: f64 = random.random_range(-1.0..1.0);
        [4.0 + noise, 7e-5 * (j as f64 * 0.0314).sin(), 1e3 * noise]
    }
}

fn worst(sums: &Sums<LANES, KERNELS>, expected: &Sums<LANES, KERNELS>, sizes: &Sums<LANES, KERNELS>) -> f64 {
    let pairs = sums.iter().flatten().zip(expected.iter().flatten()).zip(sizes.iter().flatten());
    pairs.map(|((sum, expected), size)| (sum - expected).abs() / size).fold(0.0, f64::max)
}

/// The last L samples, from a history.
fn check(length: usize, way: Way, steps: usize, looks: impl Fn(usize) -> bool) -> f64 {
    let engine = Engine::new(length, &kernels(), way);
    let mut state = engine.start();
    let mut sample = samples();
    let mut history = std::collections::VecDeque::new();
    let mut largest: f64 = 0.0;
    for step in 0..steps {
        let x = sample(step);
        let sums = engine.push(&mut state, &x);
        history.push_back(x);
        if history.len() > length + 1 {
            history.pop_front();
        }
        assert_eq!(engine.is_full(&state), step + 1 >= length, "at step {step} of length {length}");
        if step + 1 >= length && looks(step) {
            let window: Vec<_> = history.iter().skip(history.len() - length).copied().collect();
            let (expected, sizes) = afresh(&window);
            let error = worst(&sums, &expected, &sizes);
            assert!(error <= TOLERANCE, "{way:?}, length {length}, step {step}: error {error:e} above {TOLERANCE:e}");
            largest = largest.max(error);
        }
        let outgoing = (step >= length).then(|| history[0]);
        assert_eq!(engine.outgoing(&state), outgoing, "at step {step} of length {length}");
    }
    largest
}

#[test]
fn both_ways_are_the_sum_over_the_window_at_every_step_and_length() {
    for way in [Way::Direct, Way::Blocks] {
        for length in (4..=40).chain([99, 100, 199, 256]) {
            check(length, way, 5 * length + 3, |_| true);
        }
    }
}

#[test]
fn long_windows_are_exact_wherever_they_stand_among_the_blocks() {
    for length in [1999, 2000, 19_999] {
        let largest = check(length, Way::Blocks, 3 * length, |step| step % (length / 40) < 2);
        println!("length {length}: largest error {largest:.1e} of the sum of the magnitudes");
    }
}

#[test]
fn nothing_drifts_over_ten_million_samples() {
    // Looked at in the middle, which fixes what rounding makes, and at the end.
    let (length, steps) = (199, 10_000_000);
    let largest = check(length, Way::Blocks, steps, |step| step % 1_000_000 > 999_700 || step < 2000);
    println!("{steps} samples: largest error {largest:.1e} of the sum of the magnitudes");
}

#[test]
fn a_great_sample_leaves_nothing_behind() {
    let engine = Engine::new(50, &kernels(), Way::Blocks);
    let (mut clean, mut hit) = (engine.start(), engine.start());
    let mut sample = samples();
    for step in 0..500 {
        let x = sample(step);
        let great = if step == 117 { [1e200; LANES] } else { x };
        let (expected, sums) = (engine.push(&mut clean, &x), engine.push(&mut hit, &great));
        if !(117..117 + 50).contains(&step) {
            assert_eq!(sums, expected, "at step {step}");
        }
    }
}

#[test]
fn after_clearing_the_sums_are_those_of_a_fresh_state() {
    for way in [Way::Direct, Way::Blocks] {
        for before in [1, 24, 25, 49, 50, 51, 75, 130] {
            let engine = Engine::new(50, &kernels(), way);
            let mut used = engine.start();
            for _ in 0..before {
                engine.push(&mut used, &[f64::NAN, f64::INFINITY, 1e300]);
            }
            used.clear();
            let mut fresh = engine.start();
            let mut sample = samples();
            for step in 0..200 {
                let x = sample(step);
                let (one, other) = (engine.push(&mut used, &x), engine.push(&mut fresh, &x));
                assert_eq!(engine.is_full(&used), step >= 49);
                if step >= 49 {
                    assert_eq!(one, other, "{way:?}, step {step} after {before} samples");
                }
            }
        }
    }
}

#[test]
fn a_state_survives_being_written_and_read() {
    let engine = Engine::new(33, &kernels(), Way::Blocks);
    let mut state = engine.start();
    let mut sample = samples();
    for step in 0..77 {
        engine.push(&mut state, &sample(step));
    }
    let text = toml::to_string(&state).expect("a state can be written");
    let mut read: SlidingState = toml::from_str(&text).expect("a state can be read");
    assert!(engine.accepts(&read));
    for step in 77..200 {
        let x = sample(step);
        assert_eq!(engine.push(&mut state, &x), engine.push(&mut read, &x), "at step {step}");
    }
}

#[test]
fn foreign_states_are_told() {
    let engine = Engine::new(33, &kernels(), Way::Blocks);
    assert!(!engine.accepts(&Engine::new(34, &kernels(), Way::Blocks).start()));
    assert!(!engine.accepts(&Engine::new(33, &kernels(), Way::Direct).start()));
    assert!(!engine.accepts(&SlidingSums::<2, TERMS, KERNELS>::new(33, &[[0.0; TERMS]; KERNELS], Way::Blocks).start()));
}

/// Largest difference allowed between two ways of integrating the same window, relative to `Σ |w x|`: rounding of the weights,
/// which [`Weights`] takes as differences of rounded values, grows with N³ (1e-11 at N = 200).
fn between_ways(intervals: usize) -> f64 {
    let n = intervals as f64;
    2e-14 + 1e-18 * n * n * n
}

#[test]
fn the_integrals_are_those_of_the_weights_one_by_one() {
    for intervals in [8, 9, 50, 63, 64, 159, 200, 2000] {
        for continuous in [false, true] {
            for way in [Way::Direct, Way::Blocks] {
                compare_with_weights(intervals, continuous, way);
            }
        }
    }
}

fn compare_with_weights(intervals: usize, continuous: bool, way: Way) {
    let sums = WindowSums::by(way, intervals, continuous);
    let mut state = sums.start();
    let weights: Vec<Weights> =
        (0..3).map(|row| Weights::paper(row, intervals)).chain([Weights::static_load(intervals)]).collect();
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let mut history: Vec<Sample> = Vec::new();
    for step in 0..3 * intervals {
        let mut draw = || -> f64 { random.random_range(0.5..1.5) };
        let start = [draw(), draw(), draw()];
        let end = if continuous { start } else { [draw(), draw(), draw()] };
        let sample = Sample { position: [1e-4 * draw(), -1e-4 * draw()], squares: [start, end] };
        history.push(sample);
        let integrals = sums.push(&mut state, &sample);
        assert_eq!(integrals.is_some(), step >= intervals, "at step {step} of {intervals} intervals");
        let (Some(integrals), true) = (integrals, step % 7 == 0 || step == intervals) else { continue };
        let window = &history[step - intervals..];
        let dot = |weights: &[f64], of: &dyn Fn(&Sample) -> f64| {
            let products = weights.iter().zip(window).map(|(w, sample)| w * of(sample));
            products.fold((0.0, 0.0), |(sum, size), x: f64| (sum + x, size + x.abs()))
        };
        for (row, (weights, integrals)) in weights.iter().zip(&integrals).enumerate() {
            for axis in 0..2 {
                let (sum, size) = dot(&weights.position, &|sample| sample.position[axis]);
                let error = (integrals.position[axis] - sum).abs() / size;
                assert!(
                    error <= between_ways(intervals),
                    "{way:?}, N = {intervals}, row {row}, axis {axis}: {error:e}"
                );
            }
            for k in 0..3 {
                let (sum, size) = if continuous {
                    dot(&weights.node, &|sample| sample.squares[0][k])
                } else {
                    let start = dot(&weights.held_start, &|sample| sample.squares[0][k]);
                    let end = dot(&weights.held_end, &|sample| sample.squares[1][k]);
                    (start.0 + end.0, start.1 + end.1)
                };
                let error = (integrals.squares[k] - sum).abs() / size;
                assert!(error <= between_ways(intervals), "{way:?}, N = {intervals}, row {row}, magnet {k}: {error:e}");
            }
        }
    }
}
