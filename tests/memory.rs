//! What noise does to an estimate, followed sample by sample by the book and in cells.

use magnetic_bearing::model::kernel::Weights;
use magnetic_bearing::model::memory::{
    Bank, COLUMNS, Gains, MAX_FUNCTIONS, Memory, NoiseSums, Rows, Sensitivity, Sums,
};
use magnetic_bearing::model::regression::{NormalMatrix, NormalVector};

const DIRECTION: [[f64; 2]; 3] = [[0.1, -0.9], [-0.8, 0.6], [0.9, 0.5]];
const NOISE: [f64; 2] = [1e-7, 3e-7];
const KEEP: f64 = 0.97;
const WINDOWS: usize = 40;
const SCALE: [f64; 3] = [1.1, 0.9, 1.3];

/// Gains at a sample: squares of those of the currents, then those of the positions; some periods per window.
fn gain(j: usize, intervals: usize) -> [[f64; 3]; 2] {
    let turn = 2.0 * std::f64::consts::PI * j as f64 / intervals as f64;
    [
        std::array::from_fn(|k| 2.0 + (turn + k as f64).sin()),
        std::array::from_fn(|k| 0.2 + 0.1 * (turn + 2.0 * k as f64).cos()),
    ]
}

/// Some integrals of window number w.
fn rows(w: usize) -> Rows {
    let value = |a: usize, i: usize| ((w * 31 + a * 7 + i * 3) as f64 * 0.37).sin();
    Rows {
        position: std::array::from_fn(|a| std::array::from_fn(|i| value(a + COLUMNS, i))),
        column: std::array::from_fn(|m| std::array::from_fn(|i| value(m, i))),
    }
}

/// The two numbers with which the unknowns stand in a sample, of the five that belong to the integrals.
fn vectors(five: &[f64; COLUMNS]) -> [[f64; 2]; COLUMNS] {
    let [.., c, s] = *five;
    let magnet = |k: usize| DIRECTION[k].map(|along| along * five[k]);
    [magnet(0), magnet(1), magnet(2), [c, s], [-s, c]]
}

/// `M_z` and `M_i` of all samples, sample by sample.
fn by_the_book(intervals: usize, hop: usize) -> [NormalMatrix; 2] {
    let weights = Weights::sines(intervals, MAX_FUNCTIONS + 1, NOISE[0], NOISE[1]);
    let mut score = [NormalMatrix::zeros(); 2];
    for j in 0..=(WINDOWS - 1) * hop + intervals {
        let [mut position, mut force] = [[0.0; COLUMNS]; 2];
        for w in (0..WINDOWS).filter(|w| (w * hop..=w * hop + intervals).contains(&j)) {
            let weight = KEEP.powi((WINDOWS - 1 - w) as i32);
            let node = j - w * hop;
            for (m, column) in rows(w).column.iter().enumerate() {
                for (value, row) in column.iter().zip(&weights) {
                    position[m] += weight * value * row.position[node];
                    force[m] += weight * value * (row.held_start[node] + row.held_end[node]);
                }
            }
        }
        let [current, gap] = gain(j, intervals);
        let (position, force) = (vectors(&position), vectors(&force));
        let along: [[f64; COLUMNS]; 2] = std::array::from_fn(|axis| {
            std::array::from_fn(|l| {
                let mut value = position[l][axis];
                for k in 0..3 {
                    let towards = force[l][0] * DIRECTION[k][0] + force[l][1] * DIRECTION[k][1];
                    value -= SCALE[k] * gap[k] * DIRECTION[k][axis] * towards;
                }
                value
            })
        });
        for axis in along {
            let axis = NormalVector::from(axis);
            score[0] += axis * axis.transpose();
        }
        for k in 0..3 {
            let v = NormalVector::from_fn(|l, _| force[l][0] * DIRECTION[k][0] + force[l][1] * DIRECTION[k][1]);
            score[1] += v * v.transpose() * (SCALE[k] * SCALE[k] * current[k]);
        }
    }
    score
}

/// The same by the memory.
fn in_cells(intervals: usize, hop: usize) -> [NormalMatrix; 2] {
    let bank = Bank::new(intervals, hop, false, NOISE, 0.9);
    let sizes = bank.cells().sizes();
    let mut memory = Memory::new(sizes.len());
    for w in 0..WINDOWS {
        let mut means = [const { Vec::new() }; 6];
        let mut first = w * hop;
        for size in sizes {
            for (signal, mean) in means.iter_mut().enumerate() {
                let sum: f64 = (first..first + size).map(|j| gain(j, intervals)[signal / 3][signal % 3]).sum();
                mean.push(sum / *size as f64);
            }
            first += size;
        }
        let [a, b, c, d, e, f] = &means;
        let gains = Gains { current: [a, b, c], gap: [d, e, f] };
        let sensitivity = Sensitivity { gains, scale: SCALE, direction: &DIRECTION };
        let x = NormalVector::repeat(1.0);
        let sums = Sums::of(&rows(w), &DIRECTION, [0.0; 3], &NoiseSums::default(), &x);
        memory.add(&bank, (&rows(w), &sums), KEEP, &sensitivity);
    }
    memory.score
}

fn largest_difference(intervals: usize) -> f64 {
    let hop = (intervals / 25).max(1);
    let pairs = by_the_book(intervals, hop).into_iter().zip(in_cells(intervals, hop));
    pairs.map(|(wanted, score)| (score - wanted).norm() / wanted.norm()).fold(0.0, f64::max)
}

#[test]
fn every_sample_counts_once() {
    for intervals in [8, 30, 49, 50, 120, 173, 199] {
        let off = largest_difference(intervals);
        assert!(off < 1e-11, "N = {intervals}: off by {off:.1e}");
    }
}

/// Longer windows take samples together; a standard deviation is then off by half of this.
#[test]
fn cells_lose_little() {
    for intervals in [200, 299, 400, 1003] {
        let off = largest_difference(intervals);
        println!("N = {intervals}: off by {off:.1e}");
        assert!(off < 0.01, "N = {intervals}: off by {off:.1e}");
    }
}

#[test]
fn a_window_fits_what_it_was_made_of() {
    let rows = rows(3);
    let x = NormalVector::from([0.3, -0.2, 0.7, 1.1, -0.4]);
    let zero = NormalVector::zeros();
    let (p, h, square) = rows.normal(&DIRECTION);
    let left = rows.left(&DIRECTION, &x).norm_squared();
    let wanted = square - 2.0 * x.dot(&h) + x.dot(&(p * x));
    assert!((left / wanted - 1.0).abs() < 1e-12, "{left}, wanted {wanted}");
    assert!((rows.left(&DIRECTION, &zero).norm_squared() / square - 1.0).abs() < 1e-12);
}

#[test]
fn clearing_and_parting() {
    let bank = Bank::new(50, 2, false, NOISE, 0.9);
    let cells = bank.cells().sizes().len();
    let ones = vec![1.0; cells];
    let gains = Gains { current: [&ones; 3], gap: [&ones; 3] };
    let sensitivity = Sensitivity { gains, scale: SCALE, direction: &DIRECTION };
    let sums = Sums::default();
    let mut memory = Memory::new(cells);
    memory.add(&bank, (&rows(0), &sums), 1.0, &sensitivity);
    let one = memory.score;
    // Windows that share no sample: their noise adds up.
    memory.part();
    memory.add(&bank, (&rows(0), &sums), 1.0, &sensitivity);
    for (score, one) in memory.score.iter().zip(one) {
        assert!((score - one * 2.0).norm() < 1e-12 * one.norm());
    }
    memory.clear();
    assert_eq!(memory, Memory::new(cells));
}
