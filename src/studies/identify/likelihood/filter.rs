//! Passes of the Kalman filter over a piece of a recording: sensitivities of the innovations, smoothed trajectory, likelihood of
//! noise levels.
//!
//! The state is the deviation δ of (y, z, ẏ, ż) from the trajectory of the pass before; where a slow force is estimated, its acceleration (y, z) follows, a random
//! walk that is 0 at the start of the recording. With the gains of the filter given, the
//! innovation is linear in the parameters, and its derivative to each of them is the output of the same filter driven by the
//! derivatives of force and reading (sensitivity equations).
//!
//! A piece is filtered with a margin of rows before it, and smoothed with one behind it, so that pieces are independent of each
//! other: what lies further away is forgotten. Their number does not depend on that of the processors.

#![allow(clippy::needless_range_loop, reason = "several matrices go by one index")]

use std::ops::Range;

use super::data::{Data, Piece, Track};
use super::equations::{ALL, BASE, Bearing, Interval, State};

/// Columns of a pass without bench parameters, and of one with them: numbers of parameters, rounded up to whole registers.
pub(super) const FEW: usize = 8;
pub(super) const MANY: usize = 40;
/// Columns in a register of the processor.
const REGISTER: usize = 8;
/// Rows of whitened sensitivities that are summed at once.
const BATCH: usize = 16;
/// Harmonics of the shaft angle that are tested.
pub(super) const HARMONICS: usize = 4;
/// Lags that are tested.
pub(super) const LAGS: usize = 4;

/// Number of states without and with a slow force.
const PLAIN: usize = 4;
const SLOW: usize = 6;

/// Kalman filter of the deviation.
#[derive(Clone, Debug)]
struct Kalman<const N: usize> {
    x: [f64; N],
    p: [[f64; N]; N],
}

/// One innovation.
#[derive(Clone, Copy, Debug)]
struct Innovation<const N: usize> {
    e: [f64; 2],
    /// Cholesky factor of the covariance of e: 1/l_00, l_10, 1/l_11.
    factor: [f64; 3],
    gain: [[f64; 2]; N],
    /// ln det of the covariance.
    log_det: f64,
}

impl<const N: usize> Innovation<N> {
    #[inline(always)]
    fn whiten(&self, e: [f64; 2]) -> [f64; 2] {
        let first = e[0] * self.factor[0];
        [first, (e[1] - self.factor[1] * first) * self.factor[2]]
    }

    /// `S⁻¹ e` from the whitened e.
    #[inline(always)]
    fn unwhiten(&self, w: [f64; 2]) -> [f64; 2] {
        let second = w[1] * self.factor[2];
        [(w[0] - self.factor[1] * second) * self.factor[0], second]
    }
}

/// `F x`: the stiffness acts over one interval, to the third order of its length.
#[inline(always)]
fn transition<const N: usize>(h: f64, k: &[f64; 3], x: [f64; N]) -> [f64; N] {
    let [y, z, v, w] = [x[0], x[1], x[2], x[3]];
    let (h_2, h_3) = (0.5 * h * h, h * h * h / 6.0);
    let velocity = [h * y + h_2 * v, h * z + h_2 * w];
    let position = [h_2 * y + h_3 * v, h_2 * z + h_3 * w];
    let mut to = x;
    to[0] = y + h * v + k[0] * position[0] + k[1] * position[1];
    to[1] = z + h * w + k[1] * position[0] + k[2] * position[1];
    to[2] = v + k[0] * velocity[0] + k[1] * velocity[1];
    to[3] = w + k[1] * velocity[0] + k[2] * velocity[1];
    for slow in PLAIN..N {
        to[slow - 4] += h_2 * x[slow];
        to[slow - 2] += h * x[slow];
    }
    to
}

/// `Fᵀ r`.
#[inline(always)]
fn transition_transposed<const N: usize>(h: f64, k: &[f64; 3], r: [f64; N]) -> [f64; N] {
    let (h_2, h_3) = (0.5 * h * h, h * h * h / 6.0);
    let kr = [k[0] * r[0] + k[1] * r[1], k[1] * r[0] + k[2] * r[1]];
    let kv = [k[0] * r[2] + k[1] * r[3], k[1] * r[2] + k[2] * r[3]];
    let mut to = r;
    for a in 0..2 {
        to[a] = r[a] + h_2 * kr[a] + h * kv[a];
        to[2 + a] = r[2 + a] + h * r[a] + h_3 * kr[a] + h_2 * kv[a];
    }
    for slow in PLAIN..N {
        to[slow] += h_2 * r[slow - 4] + h * r[slow - 2];
    }
    to
}

/// `F P Fᵀ + Σ scale_k² Γ_k Γ_kᵀ`; `slow` is the variance that the acceleration of a slow force gains in an interval.
#[inline(always)]
fn propagate<const N: usize>(
    h: f64,
    k: &[f64; 3],
    noise: &[[f64; 2]; 3],
    scales: [f64; 3],
    slow: f64,
    p: &mut [[f64; N]; N],
) {
    // P is symmetric: its rows are its columns.
    let half: [[f64; N]; N] = std::array::from_fn(|j| transition(h, k, p[j]));
    let full: [[f64; N]; N] = std::array::from_fn(|i| transition(h, k, std::array::from_fn(|j| half[j][i])));
    let mut w = [0.0; 3];
    for (g, scale) in noise.iter().zip(scales) {
        let g = g.map(|g| g * scale);
        w[0] += g[0] * g[0];
        w[1] += g[0] * g[1];
        w[2] += g[1] * g[1];
    }
    let (q_0, q_1, q_2) = (0.25 * h * h * h * h, 0.5 * h * h * h, h * h);
    let w = [[w[0], w[1]], [w[1], w[2]]];
    for a in 0..2 {
        for b in 0..2 {
            p[a][b] = full[a][b] + q_0 * w[a][b];
            p[a][2 + b] = full[a][2 + b] + q_1 * w[a][b];
            p[2 + a][b] = p[a][2 + b];
            p[2 + a][2 + b] = full[2 + a][2 + b] + q_2 * w[a][b];
        }
    }
    // Rounding must not make it unsymmetric.
    p[1][0] = p[0][1];
    p[3][2] = p[2][3];
    p[2][1] = p[1][2];
    p[3][0] = p[0][3];
    for i in PLAIN..N {
        for j in 0..=i {
            p[i][j] = full[i][j] + if i == j { slow } else { 0.0 };
            p[j][i] = p[i][j];
        }
    }
}

impl<const N: usize> Kalman<N> {
    /// Nothing is known of the state but that the rotor is near the trajectory, within a gap and a metre per second. `slow` is the variance of the acceleration of a
    /// slow force.
    fn diffuse(slow: f64) -> Self {
        let mut p = [[0.0; N]; N];
        for a in 0..2 {
            p[a][a] = 1e-6;
            p[2 + a][2 + a] = 1.0;
        }
        for at in PLAIN..N {
            p[at][at] = slow;
        }
        Self { x: [0.0; N], p }
    }

    #[inline(always)]
    fn predict(&mut self, h: f64, interval: &Interval, scales: [f64; 3], slow: f64) {
        self.x = transition(h, &interval.stiffness, self.x);
        for (x, offset) in self.x.iter_mut().zip(interval.offset) {
            *x += offset;
        }
        propagate(h, &interval.stiffness, &interval.noise, scales, slow, &mut self.p);
    }

    /// `residual`: measured minus read at the trajectory.
    #[inline(always)]
    fn update(&mut self, bearing: &Bearing, variance: f64, residual: [f64; 2]) -> Innovation<N> {
        let (m, d) = (&bearing.sensor, bearing.delay);
        let at = |row: &[f64; N]| {
            let t = [row[0] - d * row[2], row[1] - d * row[3]];
            [m[0][0] * t[0] + m[0][1] * t[1], m[1][0] * t[0] + m[1][1] * t[1]]
        };
        let pht: [[f64; 2]; N] = std::array::from_fn(|i| at(&self.p[i]));
        let column = |a: usize| at(&std::array::from_fn(|i| pht[i][a]));
        let (first, second) = (column(0), column(1));
        let (s_00, s_01, s_11) = (first[0] + variance, 0.5 * (first[1] + second[0]), second[1] + variance);
        let l_00 = s_00.sqrt();
        let l_10 = s_01 / l_00;
        let rest = s_11 - l_10 * l_10;
        let l_11 = rest.sqrt();
        let det = s_00 * rest;
        let gain = pht.map(|row| [(row[0] * s_11 - row[1] * s_01) / det, (row[1] * s_00 - row[0] * s_01) / det]);
        let predicted = at(&self.x);
        let e = [residual[0] - predicted[0], residual[1] - predicted[1]];
        for i in 0..N {
            self.x[i] += gain[i][0] * e[0] + gain[i][1] * e[1];
            for j in 0..=i {
                let p = self.p[i][j] - (gain[i][0] * pht[j][0] + gain[i][1] * pht[j][1]);
                self.p[i][j] = p;
                self.p[j][i] = p;
            }
        }
        // The logarithm is taken of many at once.
        Innovation { e, factor: [1.0 / l_00, l_10, 1.0 / l_11], gain, log_det: det }
    }
}

/// Product of many numbers as a logarithm, without one of each.
#[derive(Clone, Copy, Debug)]
struct LogProduct {
    sum: f64,
    product: f64,
}

impl LogProduct {
    fn new() -> Self {
        Self { sum: 0.0, product: 1.0 }
    }

    #[inline(always)]
    fn times(&mut self, factor: f64) {
        // Determinants lie far below 1.
        self.product *= factor * 1e26;
        if !(1e-200..1e200).contains(&self.product) {
            self.sum += libm::log(self.product);
            self.product = 1.0;
        }
    }

    fn finish(self, count: f64) -> f64 {
        self.sum + libm::log(self.product) - count * 26.0 * std::f64::consts::LN_10
    }
}

/// Sums of one block of rows.
#[derive(Clone, Debug)]
pub(super) struct Block {
    pub rows: Range<usize>,
    /// Innovations (rows).
    pub count: f64,
    /// Sum of the normalised innovations squared; its expectation is 2 per row.
    pub nis: f64,
    pub log_det: f64,
    /// `Σ φᵀ S⁻¹ φ`, lower triangle, `columns` to a row.
    pub j: Vec<f64>,
    /// `Σ φᵀ S⁻¹ e`.
    pub b: Vec<f64>,
    pub columns: usize,
    /// Whitened innovations by harmonic, axis, and cos or sin.
    pub harmonics: [[[f64; 2]; 2]; HARMONICS],
    /// `Σ w_t w_{t−lag}` of the whitened innovations, both axes.
    pub lags: [f64; LAGS],
}

struct Sums<const P: usize> {
    j: Box<[[f64; P]; P]>,
    b: [f64; P],
    batch: Box<[[f64; P]; BATCH]>,
    filled: usize,
}

impl<const P: usize> Sums<P> {
    fn new() -> Self {
        Self { j: Box::new([[0.0; P]; P]), b: [0.0; P], batch: Box::new([[0.0; P]; BATCH]), filled: 0 }
    }

    #[inline(always)]
    fn flush(&mut self) {
        for row in &mut self.batch[self.filled..] {
            *row = [0.0; P];
        }
        self.filled = 0;
        for i in 0..P {
            for c in 0..=i / REGISTER {
                let mut sum = [0.0; REGISTER];
                for row in self.batch.iter() {
                    let factor = row[i];
                    for at in 0..REGISTER {
                        sum[at] += factor * row[c * REGISTER + at];
                    }
                }
                for at in 0..REGISTER {
                    self.j[i][c * REGISTER + at] += sum[at];
                }
            }
        }
    }

    fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        self.flush();
        let j = self.j.as_flattened().to_vec();
        let b = self.b.to_vec();
        *self.j = [[0.0; P]; P];
        self.b = [0.0; P];
        (j, b)
    }
}

#[inline(always)]
fn columns_of<const P: usize, const N: usize>(
    data: &Data,
    bearing: &Bearing,
    track: &Track,
    variance: f64,
    piece: &Piece,
    instruments: bool,
) -> Vec<Block> {
    let h = data.h;
    let (h_2, d) = (0.5 * h * h, bearing.delay);
    let m = bearing.sensor;
    let mut kalman = Kalman::<N>::diffuse(data.slow(bearing, piece.filtered.start));
    let mut x = [[0.0; P]; N];
    let mut force = [[0.0; P]; 2];
    let mut sensor = [[0.0; P]; 2];
    let mut sums = Box::new(Sums::<P>::new());
    let mut blocks = Vec::new();
    let expected = |row: usize| track.expected.get(row).filter(|_| instruments).map(|of| of.map(f64::from));
    let block_of = |row: usize| (row - piece.blocks_from) / piece.block;
    let empty = |row: usize| Block {
        rows: row..row,
        count: 0.0,
        nis: 0.0,
        log_det: 0.0,
        j: Vec::new(),
        b: Vec::new(),
        columns: P,
        harmonics: [[[0.0; 2]; 2]; HARMONICS],
        lags: [0.0; LAGS],
    };
    let mut block = empty(piece.counted.start);
    let mut log_det = LogProduct::new();
    let mut former = [[0.0; 2]; LAGS];
    let mut from = data.shaft(piece.filtered.start);
    for row in piece.filtered.start..piece.counted.end {
        let to = data.shaft(row);
        let mut acceleration = [0.0; 2];
        if row > piece.filtered.start {
            let (interval, between) = data.interval(bearing, track, row, &from, &to);
            let ahead = |a: usize| interval.middle[a] + kalman.x[a] + 0.5 * h * kalman.x[2 + a];
            let predicted = [ahead(0), ahead(1)];
            let measured = bearing.regressors(predicted, interval.squares);
            let (at, regressors) = match expected(row) {
                Some([a, b, c, y, z, v, w]) => ([y - 0.5 * h * v, z - 0.5 * h * w], [a, b, c]),
                None => (predicted, measured),
            };
            kalman.predict(h, &interval, [1.0; 3], data.slow(bearing, 1));
            acceleration = interval.end;
            bearing.force_columns(at, regressors, measured, between, &mut force);
            let [k_0, k_1, k_2] = interval.stiffness;
            let h_3 = h * h * h / 6.0;
            let (plain, slow) = x.split_at_mut(PLAIN);
            let [x_0, x_1, x_2, x_3] = plain else { unreachable!("there are at least as many states") };
            for l in 0..P {
                let (y, z, v, w) = (x_0[l], x_1[l], x_2[l], x_3[l]);
                let (mut f, mut g) = (force[0][l], force[1][l]);
                if let [slow_0, slow_1] = slow {
                    f += slow_0[l];
                    g += slow_1[l];
                }
                let (a, b) = (h * y + h_2 * v, h * z + h_2 * w);
                let (p, q) = (h_2 * y + h_3 * v, h_2 * z + h_3 * w);
                x_0[l] = y + h * v + k_0 * p + k_1 * q + h_2 * f;
                x_1[l] = z + h * w + k_1 * p + k_2 * q + h_2 * g;
                x_2[l] = v + k_0 * a + k_1 * b + h * f;
                x_3[l] = w + k_1 * a + k_2 * b + h * g;
            }
        }
        from = to;
        let (read, _) = bearing.reading(&track.state[row], acceleration, to);
        if P > FEW {
            // Where the filter predicts the rotor, as the force.
            let at: State = match expected(row) {
                Some([.., y, z, v, w]) => [y, z, v, w],
                None => std::array::from_fn(|i| track.state[row][i] + kalman.x[i]),
            };
            let (_, plain) = bearing.reading(&at, acceleration, to);
            bearing.sensor_columns(&at, acceleration, to, plain, &mut sensor);
        }
        let residual = [data.position[row][0] - read[0], data.position[row][1] - read[1]];
        let innovation = kalman.update(bearing, data.variance(row, variance), residual);
        let counts = row >= piece.counted.start;
        let w = innovation.whiten(innovation.e);
        let [f_0, l_10, f_1] = innovation.factor;
        let g = &innovation.gain;
        let (plain, slow) = x.split_at_mut(PLAIN);
        let [x_0, x_1, x_2, x_3] = plain else { unreachable!("there are at least as many states") };
        if sums.filled + 2 > BATCH {
            sums.flush();
        }
        let filled = sums.filled;
        let (before, after) = sums.batch.split_at_mut(filled + 1);
        let (w_0, w_1) = (&mut before[filled], &mut after[0]);
        for l in 0..P {
            let (y, z) = (x_0[l] - d * x_2[l], x_1[l] - d * x_3[l]);
            let phi_0 = m[0][0] * y + m[0][1] * z + sensor[0][l];
            let phi_1 = m[1][0] * y + m[1][1] * z + sensor[1][l];
            x_0[l] -= g[0][0] * phi_0 + g[0][1] * phi_1;
            x_1[l] -= g[1][0] * phi_0 + g[1][1] * phi_1;
            x_2[l] -= g[2][0] * phi_0 + g[2][1] * phi_1;
            x_3[l] -= g[3][0] * phi_0 + g[3][1] * phi_1;
            for (x, g) in slow.iter_mut().zip(&g[PLAIN..]) {
                x[l] -= g[0] * phi_0 + g[1] * phi_1;
            }
            let first = phi_0 * f_0;
            w_0[l] = first;
            w_1[l] = (phi_1 - l_10 * first) * f_1;
        }
        // Where the force is not known, innovations are not white.
        let white = if counts && data.tells(row) { w } else { [0.0; 2] };
        if counts {
            if block_of(row) != block_of(block.rows.start) {
                // The batch holds the row that begins the next block.
                let (next_0, next_1) = (sums.batch[filled], sums.batch[filled + 1]);
                close(&mut block, &mut sums, &mut log_det);
                blocks.push(std::mem::replace(&mut block, empty(row)));
                sums.batch[0] = next_0;
                sums.batch[1] = next_1;
            }
            let filled = sums.filled;
            for l in 0..P {
                sums.b[l] += w[0] * sums.batch[filled][l] + w[1] * sums.batch[filled + 1][l];
            }
            sums.filled += 2;
            block.rows.end = row + 1;
            if data.tells(row) {
                block.count += 1.0;
                block.nis += w[0] * w[0] + w[1] * w[1];
                log_det.times(innovation.log_det);
            }
            let (c, s) = (to.cos, to.sin);
            let mut turn = [c, s];
            for harmonic in &mut block.harmonics {
                for (axis, w) in harmonic.iter_mut().zip(white) {
                    axis[0] += w * turn[0];
                    axis[1] += w * turn[1];
                }
                turn = [turn[0] * c - turn[1] * s, turn[1] * c + turn[0] * s];
            }
            for (sum, former) in block.lags.iter_mut().zip(&former) {
                *sum += white[0] * former[0] + white[1] * former[1];
            }
        }
        former.copy_within(..LAGS - 1, 1);
        former[0] = white;
    }
    close(&mut block, &mut sums, &mut log_det);
    blocks.push(block);
    blocks
}

fn close<const P: usize>(block: &mut Block, sums: &mut Sums<P>, log_det: &mut LogProduct) {
    (block.j, block.b) = sums.take();
    block.log_det = log_det.finish(block.count);
    *log_det = LogProduct::new();
}

/// Sums of the sensitivities of λ, unbalance and load, block by block.
pub(super) fn few_columns(data: &Data, bearing: &Bearing, track: &Track, variance: f64, piece: &Piece) -> Vec<Block> {
    if bearing.slow > 0.0 {
        return columns_of::<FEW, SLOW>(data, bearing, track, variance, piece, false);
    }
    columns_of::<FEW, PLAIN>(data, bearing, track, variance, piece, false)
}

/// Sums of the sensitivities of all parameters, block by block.
pub(super) fn all_columns(data: &Data, bearing: &Bearing, track: &Track, variance: f64, piece: &Piece) -> Vec<Block> {
    if bearing.slow > 0.0 {
        return columns_of::<MANY, SLOW>(data, bearing, track, variance, piece, false);
    }
    columns_of::<MANY, PLAIN>(data, bearing, track, variance, piece, false)
}

/// The same of their instruments: sensitivities as they were to be expected. The measured ones of λ follow after all others.
pub(super) fn instruments(data: &Data, bearing: &Bearing, track: &Track, variance: f64, piece: &Piece) -> Vec<Block> {
    if bearing.slow > 0.0 {
        return columns_of::<MANY, SLOW>(data, bearing, track, variance, piece, true);
    }
    columns_of::<MANY, PLAIN>(data, bearing, track, variance, piece, true)
}

const _: () = assert!(ALL + 3 <= MANY && BASE <= FEW);

/// Calls `each` with every row, the interval that ends there (none at the first row), and what is measured there minus what is read at the trajectory.
#[inline(always)]
fn each_row(
    data: &Data,
    bearing: &Bearing,
    track: &Track,
    rows: Range<usize>,
    mut each: impl FnMut(usize, Option<&Interval>, [f64; 2]),
) {
    let mut from = data.shaft(rows.start);
    for row in rows.clone() {
        let to = data.shaft(row);
        let interval = (row > rows.start).then(|| data.interval(bearing, track, row, &from, &to).0);
        from = to;
        let acceleration = interval.as_ref().map_or([0.0; 2], |interval| interval.end);
        let (read, _) = bearing.reading(&track.state[row], acceleration, to);
        each(row, interval.as_ref(), [data.position[row][0] - read[0], data.position[row][1] - read[1]]);
    }
}

/// State of the smoother for a row.
#[derive(Clone, Copy, Debug)]
struct Kept<const N: usize> {
    stiffness: [f64; 3],
    x: [f64; N],
    p: [[f64; N]; N],
    innovation: Innovation<N>,
}

/// The smoothed trajectory of the counted rows (modified Bryson–Frazier recursion, Bierman 1973).
pub(super) fn smooth(data: &Data, bearing: &Bearing, track: &Track, variance: f64, piece: &Piece) -> Vec<State> {
    if bearing.slow > 0.0 {
        return smooth_with::<SLOW>(data, bearing, track, variance, piece);
    }
    smooth_with::<PLAIN>(data, bearing, track, variance, piece)
}

#[inline(always)]
fn smooth_with<const N: usize>(
    data: &Data,
    bearing: &Bearing,
    track: &Track,
    variance: f64,
    piece: &Piece,
) -> Vec<State> {
    let h = data.h;
    let start = piece.filtered.start;
    let mut kalman = Kalman::<N>::diffuse(data.slow(bearing, start));
    let mut kept = Vec::with_capacity(piece.filtered.len());
    each_row(data, bearing, track, piece.filtered.clone(), |row, interval, residual| {
        if let Some(interval) = interval {
            kalman.predict(h, interval, [1.0; 3], data.slow(bearing, 1));
        }
        let (x, p) = (kalman.x, kalman.p);
        let stiffness = interval.map_or([0.0; 3], |interval| interval.stiffness);
        let innovation = kalman.update(bearing, data.variance(row, variance), residual);
        kept.push(Kept { stiffness, x, p, innovation });
    });
    let (m, d) = (&bearing.sensor, bearing.delay);
    let mut r = [0.0; N];
    let counted = piece.counted.len();
    let mut smoothed = vec![[0.0; 4]; counted];
    for row in piece.filtered.clone().rev() {
        let keep = &kept[row - start];
        let innovation = &keep.innovation;
        // r ← Hᵀ (S⁻¹ e − Kᵀ r) + r.
        let mut u = innovation.unwhiten(innovation.whiten(innovation.e));
        for (a, u) in u.iter_mut().enumerate() {
            *u -= (0..N).map(|i| innovation.gain[i][a] * r[i]).sum::<f64>();
        }
        let back = [m[0][0] * u[0] + m[1][0] * u[1], m[0][1] * u[0] + m[1][1] * u[1]];
        for a in 0..2 {
            r[a] += back[a];
            r[2 + a] -= d * back[a];
        }
        if row >= piece.counted.start && row < piece.counted.end {
            let at = row - piece.counted.start;
            for i in 0..4 {
                let change: f64 = (0..N).map(|j| keep.p[i][j] * r[j]).sum();
                smoothed[at][i] = track.state[row][i] + keep.x[i] + change;
            }
        }
        r = transition_transposed(h, &keep.stiffness, r);
    }
    smoothed
}

/// The innovations of the counted rows: in m, and whitened.
pub(super) fn innovations(
    data: &Data,
    bearing: &Bearing,
    track: &Track,
    variance: f64,
    piece: &Piece,
) -> Vec<[[f64; 2]; 2]> {
    if bearing.slow > 0.0 {
        return innovations_with::<SLOW>(data, bearing, track, variance, piece);
    }
    innovations_with::<PLAIN>(data, bearing, track, variance, piece)
}

#[inline(always)]
fn innovations_with<const N: usize>(
    data: &Data,
    bearing: &Bearing,
    track: &Track,
    variance: f64,
    piece: &Piece,
) -> Vec<[[f64; 2]; 2]> {
    let mut kalman = Kalman::<N>::diffuse(data.slow(bearing, piece.filtered.start));
    let mut innovations = Vec::with_capacity(piece.counted.len());
    each_row(data, bearing, track, piece.filtered.start..piece.counted.end, |row, interval, residual| {
        if let Some(interval) = interval {
            kalman.predict(data.h, interval, [1.0; 3], data.slow(bearing, 1));
        }
        let innovation = kalman.update(bearing, data.variance(row, variance), residual);
        if row >= piece.counted.start {
            let error = if data.is_missing(row) { [f64::NAN; 2] } else { innovation.e };
            innovations.push([error, innovation.whiten(innovation.e)]);
        }
    });
    innovations
}

/// `[ln det sum, NIS sum, rows]` with the noise of each current, and after them the level of the slow force, times each of three sets of factors, at the same
/// position noise.
pub(super) fn likelihoods(
    data: &Data,
    bearing: &Bearing,
    track: &Track,
    variance: f64,
    factors: [[f64; 4]; 3],
    piece: &Piece,
) -> [[f64; 3]; 3] {
    if bearing.slow > 0.0 {
        return likelihoods_with::<SLOW>(data, bearing, track, variance, factors, piece);
    }
    likelihoods_with::<PLAIN>(data, bearing, track, variance, factors, piece)
}

#[inline(always)]
fn likelihoods_with<const N: usize>(
    data: &Data,
    bearing: &Bearing,
    track: &Track,
    variance: f64,
    factors: [[f64; 4]; 3],
    piece: &Piece,
) -> [[f64; 3]; 3] {
    let start = piece.filtered.start;
    let mut kalman = factors.map(|[.., slow]| Kalman::<N>::diffuse(slow * slow * data.slow(bearing, start)));
    let mut logs = [LogProduct::new(); 3];
    let mut sums = [[0.0; 3]; 3];
    each_row(data, bearing, track, start..piece.counted.end, |row, interval, residual| {
        if let Some(interval) = interval {
            for (kalman, [a, b, c, slow]) in kalman.iter_mut().zip(factors) {
                kalman.predict(data.h, interval, data.scales(row, [a, b, c]), slow * slow * data.slow(bearing, 1));
            }
        }
        for f in 0..3 {
            let innovation = kalman[f].update(bearing, data.variance(row, variance), residual);
            if row >= piece.counted.start.max(start + 4) && data.tells(row) {
                let w = innovation.whiten(innovation.e);
                logs[f].times(innovation.log_det);
                sums[f][1] += w[0] * w[0] + w[1] * w[1];
                sums[f][2] += 1.0;
            }
        }
    });
    for f in 0..3 {
        sums[f][0] = logs[f].finish(sums[f][2]);
    }
    sums
}
