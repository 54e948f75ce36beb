//! The sums over cells that [`Memory`](super::Memory) needs, for the widest registers that the processor has.
//!
//! Eight cells are worked on together, number by number and in a fixed order, without fused operations: every width of vector
//! instructions gives the same bits.

use multiversion::multiversion;

use super::{Bank, COLUMNS, Chunk, Directions, Gains, Lane, MAX_FUNCTIONS, Sensitivity, WIDTH};
use crate::model::regression::NormalMatrix;

/// Up to [`WIDTH`] numbers from `at` on, and zeros.
#[inline(always)]
fn load(values: &[f64], at: usize) -> Lane {
    if let Some(place) = values.get(at..at + WIDTH) {
        let mut lane = [0.0; WIDTH];
        lane.copy_from_slice(place);
        return lane;
    }
    let mut lane = [0.0; WIDTH];
    for (lane, value) in lane.iter_mut().zip(values.iter().skip(at)) {
        *lane = *value;
    }
    lane
}

#[inline(always)]
fn store(values: &mut [f64], at: usize, lane: &Lane) {
    if let Some(place) = values.get_mut(at..at + WIDTH) {
        place.copy_from_slice(lane);
        return;
    }
    for (value, lane) in values.iter_mut().skip(at).zip(lane) {
        *value = *lane;
    }
}

/// `sum += a b`, number by number.
#[inline(always)]
fn add_product(sum: &mut Lane, a: &Lane, b: &Lane) {
    for ((sum, a), b) in sum.iter_mut().zip(a).zip(b) {
        *sum += a * b;
    }
}

/// `sum += a b`, number by number.
#[inline(always)]
fn add_scaled(sum: &mut Lane, a: f64, b: &Lane) {
    for (sum, b) in sum.iter_mut().zip(b) {
        *sum += a * b;
    }
}

#[inline(always)]
fn times(a: &Lane, b: &Lane) -> Lane {
    let mut product = *a;
    for (product, b) in product.iter_mut().zip(b) {
        *product *= b;
    }
    product
}

/// `a − (b c + d e)`, number by number.
#[inline(always)]
fn without(a: &Lane, [b, c]: [&Lane; 2], [d, e]: [&Lane; 2]) -> Lane {
    let mut rest = *a;
    for lane in 0..WIDTH {
        rest[lane] -= b[lane] * c[lane] + d[lane] * e[lane];
    }
    rest
}

#[inline(always)]
fn total(lane: &Lane) -> f64 {
    ((lane[0] + lane[4]) + (lane[2] + lane[6])) + ((lane[1] + lane[5]) + (lane[3] + lane[7]))
}

/// `Σ uu current_k` of three magnets, `Σ zu gap_k`, and `Σ uu gap_k gap_l` of six pairs k ≤ l.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
pub(super) fn profile(weights: &[Vec<f64>; 2], gains: Gains) -> [[f64; 6]; 3] {
    let [mixed, force] = weights;
    let [current, gap] = [gains.current, gains.gap];
    let mut by_current = [[0.0; WIDTH]; 3];
    let mut by_gap = [[0.0; WIDTH]; 3];
    let mut by_pair = [[0.0; WIDTH]; 6];
    let mut at = 0;
    while at < force.len() {
        let (zu, uu) = (load(mixed, at), load(force, at));
        let [a, b, c] = [load(gap[0], at), load(gap[1], at), load(gap[2], at)];
        add_product(&mut by_current[0], &uu, &load(current[0], at));
        add_product(&mut by_current[1], &uu, &load(current[1], at));
        add_product(&mut by_current[2], &uu, &load(current[2], at));
        add_product(&mut by_gap[0], &zu, &a);
        add_product(&mut by_gap[1], &zu, &b);
        add_product(&mut by_gap[2], &zu, &c);
        let weighted = [times(&uu, &a), times(&uu, &b), times(&uu, &c)];
        add_product(&mut by_pair[0], &weighted[0], &a);
        add_product(&mut by_pair[1], &weighted[0], &b);
        add_product(&mut by_pair[2], &weighted[0], &c);
        add_product(&mut by_pair[3], &weighted[1], &b);
        add_product(&mut by_pair[4], &weighted[1], &c);
        add_product(&mut by_pair[5], &weighted[2], &c);
        at += WIDTH;
    }
    let mut sums = [[0.0; 6]; 3];
    for k in 0..3 {
        sums[0][k] = total(&by_current[k]);
        sums[1][k] = total(&by_gap[k]);
    }
    for (sum, lane) in sums[2].iter_mut().zip(&by_pair) {
        *sum = total(lane);
    }
    sums
}

/// What cells that are worked on together bring into the score.
#[derive(Clone, Copy)]
struct Scores {
    /// `P − S F` along y and z.
    along: [[Lane; COLUMNS]; 2],
    force: [Lane; COLUMNS],
    /// Squares of the gains of the currents.
    gain: [Lane; 3],
}

/// Sums over cells, number by number, and what they are made of.
struct Work {
    scores: [Scores; TILE],
    /// `M_z`.
    by_position: Square,
    /// `Σ gain F Fᵀ` for the current of each magnet.
    by_current: [Square; 3],
}

/// Chunks between which the sums leave the registers.
const TILE: usize = 4;

/// Row and column of a symmetric matrix, and number by number.
type Square = [[Lane; COLUMNS]; COLUMNS];

/// Adds row L of the outer products of the scores, from the diagonal on.
#[inline(always)]
fn add_row<const L: usize>(scores: &[Scores], by_position: &mut Square, by_current: &mut [Square; 3]) {
    let mut sums = by_position[L];
    for Scores { along: [y, z], .. } in scores {
        for m in L..COLUMNS {
            add_product(&mut sums[m], &y[L], &y[m]);
            add_product(&mut sums[m], &z[L], &z[m]);
        }
    }
    by_position[L] = sums;
    let [mut first, mut second, mut third] = [by_current[0][L], by_current[1][L], by_current[2][L]];
    for Scores { force, gain: [a, b, c], .. } in scores {
        let weighted = [times(&force[L], a), times(&force[L], b), times(&force[L], c)];
        for m in L..COLUMNS {
            add_product(&mut first[m], &weighted[0], &force[m]);
            add_product(&mut second[m], &weighted[1], &force[m]);
            add_product(&mut third[m], &weighted[2], &force[m]);
        }
    }
    [by_current[0][L], by_current[1][L], by_current[2][L]] = [first, second, third];
}

/// The sums of a symmetric matrix, of which the rows from the diagonal on are given.
fn symmetric(sums: &Square) -> NormalMatrix {
    let mut matrix = NormalMatrix::zeros();
    for (l, row) in sums.iter().enumerate() {
        for (m, sum) in row.iter().enumerate().skip(l) {
            matrix[(l, m)] = total(sum);
            matrix[(m, l)] = matrix[(l, m)];
        }
    }
    matrix
}

/// Brings P and F of the cells up to date with a window, and sums what they make of `M_z` and `M_i`: over the cells that the next window
/// will not hold, then over the others.
pub(super) fn gather(
    bank: &Bank,
    nodes: &mut [f64],
    columns: &[[f64; MAX_FUNCTIONS]; COLUMNS],
    keep: f64,
    sensitivity: &Sensitivity,
) -> [[NormalMatrix; 2]; 2] {
    let cells = nodes.len() / (2 * COLUMNS);
    let leaving = bank.cells.per_hop().min(cells);
    let scores =
        [Scores { along: [[[0.0; WIDTH]; COLUMNS]; 2], force: [[0.0; WIDTH]; COLUMNS], gain: [[0.0; WIDTH]; 3] }; TILE];
    let mut work = Work {
        scores,
        by_position: [[[0.0; WIDTH]; COLUMNS]; COLUMNS],
        by_current: [[[[0.0; WIDTH]; COLUMNS]; COLUMNS]; 3],
    };
    let Sensitivity { scale, direction, .. } = sensitivity;
    let mut sums = [[NormalMatrix::zeros(); 2]; 2];
    for ((range, chunks), sums) in [0..leaving, leaving..cells].into_iter().zip(&bank.chunks).zip(&mut sums) {
        work.by_position = [[[0.0; WIDTH]; COLUMNS]; COLUMNS];
        work.by_current = [work.by_position; 3];
        let frame = Frame { start: range.start, end: range.end, leaving };
        gather_range(nodes, &frame, chunks, (columns, keep), sensitivity, &mut work);
        sums[0] = symmetric(&work.by_position);
        for (k, by_current) in work.by_current.iter().enumerate() {
            sums[1] += along_magnet(&symmetric(by_current), direction, k) * (scale[k] * scale[k]);
        }
    }
    sums
}

/// Cells of a window that are gathered, and how many the next window will not hold.
struct Frame {
    start: usize,
    end: usize,
    leaving: usize,
}

/// What [`gather`] does for the cells of a range.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2"))]
fn gather_range(
    nodes: &mut [f64],
    frame: &Frame,
    chunks: &[Chunk],
    (columns, keep): (&[[f64; MAX_FUNCTIONS]; COLUMNS], f64),
    Sensitivity { gains, scale, direction }: &Sensitivity,
    Work { scores, by_position, by_current }: &mut Work,
) {
    let cells = nodes.len() / (2 * COLUMNS);
    let end = frame.end;
    let mut at = frame.start;
    for tile in chunks.chunks(TILE) {
        for (chunk, scores) in tile.iter().zip(&mut *scores) {
            let mut position = [[0.0; WIDTH]; COLUMNS];
            update(&mut nodes[..COLUMNS * cells], (at, frame), &chunk.position, columns, keep, &mut position);
            let force = &mut scores.force;
            update(&mut nodes[COLUMNS * cells..], (at, frame), &chunk.force, columns, keep, force);
            // S, and what it leaves of the positions.
            let [mut yy, mut yz, mut zz] = [[0.0; WIDTH]; 3];
            for k in 0..3 {
                let gain = load(&gains.gap[k][..end], at);
                let [sin, cos] = direction[k];
                add_scaled(&mut yy, scale[k] * (sin * sin), &gain);
                add_scaled(&mut yz, scale[k] * (sin * cos), &gain);
                add_scaled(&mut zz, scale[k] * (cos * cos), &gain);
                scores.gain[k] = load(&gains.current[k][..end], at);
            }
            let [y, z] = &mut scores.along;
            for k in 0..3 {
                let [sin, cos] = direction[k];
                for lane in 0..WIDTH {
                    let (p, f) = (position[k][lane], force[k][lane]);
                    y[k][lane] = sin * p - f * (yy[lane] * sin + yz[lane] * cos);
                    z[k][lane] = cos * p - f * (yz[lane] * sin + zz[lane] * cos);
                }
            }
            let [c, s] = [&force[3], &force[4]];
            y[3] = without(&position[3], [&yy, c], [&yz, s]);
            z[3] = without(&position[4], [&yz, c], [&zz, s]);
            for lane in 0..WIDTH {
                y[4][lane] = (yy[lane] * s[lane] - yz[lane] * c[lane]) - position[4][lane];
                z[4][lane] = (yz[lane] * s[lane] - zz[lane] * c[lane]) + position[3][lane];
            }
            at += WIDTH;
        }
        let scores = &scores[..tile.len()];
        add_row::<0>(scores, by_position, by_current);
        add_row::<1>(scores, by_position, by_current);
        add_row::<2>(scores, by_position, by_current);
        add_row::<3>(scores, by_position, by_current);
        add_row::<4>(scores, by_position, by_current);
    }
}

/// Adds to P or F of the cells from `at` on what a window brings, and returns them in `values`.
#[inline(always)]
fn update(
    nodes: &mut [f64],
    (at, frame): (usize, &Frame),
    weights: &[Lane; MAX_FUNCTIONS],
    columns: &[[f64; MAX_FUNCTIONS]; COLUMNS],
    keep: f64,
    values: &mut [Lane; COLUMNS],
) {
    let cells = nodes.len() / COLUMNS;
    let [mut a, mut b, mut c, mut d, mut e] = [[0.0; WIDTH]; COLUMNS];
    // What has been the cell number `leaving` is number 0 now. Reading is always ahead of writing.
    let (from, to) = ((at + frame.leaving).min(cells), (frame.end + frame.leaving).min(cells));
    add_scaled(&mut a, keep, &load(&nodes[from..to], 0));
    add_scaled(&mut b, keep, &load(&nodes[cells + from..cells + to], 0));
    add_scaled(&mut c, keep, &load(&nodes[2 * cells + from..2 * cells + to], 0));
    add_scaled(&mut d, keep, &load(&nodes[3 * cells + from..3 * cells + to], 0));
    add_scaled(&mut e, keep, &load(&nodes[4 * cells + from..4 * cells + to], 0));
    for (i, weights) in weights.iter().enumerate() {
        add_scaled(&mut a, columns[0][i], weights);
        add_scaled(&mut b, columns[1][i], weights);
        add_scaled(&mut c, columns[2][i], weights);
        add_scaled(&mut d, columns[3][i], weights);
        add_scaled(&mut e, columns[4][i], weights);
    }
    *values = [a, b, c, d, e];
    for (m, value) in values.iter().enumerate() {
        store(&mut nodes[m * cells..m * cells + frame.end], at, value);
    }
}

/// `E F Eᵀ`, where E takes the five numbers of a sample to its forces along magnet k: `F_l dir_l·dir_k` for a magnet, and for the
/// rotation `F_c sin + F_s cos`, `F_c cos − F_s sin`.
fn along_magnet(forces: &NormalMatrix, direction: &Directions, k: usize) -> NormalMatrix {
    let [sin, cos] = direction[k];
    let along = direction.map(|[sin_l, cos_l]| sin_l * sin + cos_l * cos);
    let turned = |row: usize| {
        let (c, s) = (forces[(row, 3)], forces[(row, 4)]);
        [c * sin + s * cos, c * cos - s * sin]
    };
    let mut result = NormalMatrix::zeros();
    for l in 0..3 {
        for m in l..3 {
            result[(l, m)] = along[l] * along[m] * forces[(l, m)];
        }
        let [c, s] = turned(l);
        result[(l, 3)] = along[l] * c;
        result[(l, 4)] = along[l] * s;
    }
    let [[cc, cs], [sc, ss]] = [turned(3), turned(4)];
    result[(3, 3)] = sin * cc + cos * sc;
    result[(3, 4)] = sin * cs + cos * ss;
    result[(4, 4)] = cos * cs - sin * ss;
    result.fill_lower_triangle_with_upper_triangle();
    result
}
