//! Passes of the Kalman filter over a piece of a recording: sensitivities of the innovations, smoothed trajectory, likelihood of
//! noise levels.
//!
//! The state is the deviation δ of coordinates and rates from the trajectory of the previous pass; where a slow force is estimated, its acceleration
//! follows, a random walk that is 0 at the start of the recording. For given gains the innovation is linear in the parameters, and its derivative with
//! respect to each is the output of the same filter driven by the derivatives of force and reading (sensitivity equations). The gains depend on the force
//! noise `λ_k σ_i`: at the end of a search their derivatives are included (Ljung 1999, section 10.3).
//!
//! A piece is filtered with a margin of rows before it and smoothed with one after it, which makes pieces independent: what lies further away is
//! forgotten. Their number does not depend on that of the processors.
//!
//! Sizes: N coordinates, K magnets, S states.

#![allow(clippy::needless_range_loop, reason = "several matrices go by one index")]

use std::ops::Range;

use super::SHORTEST;
use super::data::{Input, Pass};
use super::kalman::{Innovation, Kalman, Transition};
use super::rotor::{ByMagnet, Description, Interval, Layout, Shaft, State, regressors};
use crate::bearing::{RotorConfig, array};
use crate::plant::PLANES;
use crate::studies::identify::agreement::rows_ahead;

/// Columns in a processor register.
const REGISTER: usize = 8;
type Register = [f64; REGISTER];
/// Rows of whitened sensitivities summed at a time.
const BATCH: usize = 16;
/// Step of the logarithm of the noise of a current, for derivatives of the innovations.
const LEVEL_STEP: f64 = 1e-3;
/// Harmonics of the shaft angle tested.
pub const HARMONICS: usize = 4;

/// Logarithm of the product of many determinants of N rows, without taking the logarithm of each.
#[derive(Clone, Copy, Debug)]
struct LogProduct<const N: usize> {
    sum: f64,
    product: f64,
    /// Factor on each determinant.
    scale: f64,
}

impl<const N: usize> LogProduct<N> {
    /// Approximate decimal logarithm of the reciprocal variance of a position: determinants lie far below 1.
    const SCALE: usize = 13;

    fn new() -> Self {
        Self { sum: 0.0, product: 1.0, scale: std::iter::repeat_n(10.0, Self::SCALE * N).product() }
    }

    #[inline(always)]
    fn times(&mut self, factor: f64) {
        self.product *= factor * self.scale;
        if !(1e-200..1e200).contains(&self.product) {
            self.sum += libm::log(self.product);
            self.product = 1.0;
        }
    }

    fn finish(self, count: f64) -> f64 {
        self.sum + libm::log(self.product) - count * (Self::SCALE * N) as f64 * std::f64::consts::LN_10
    }
}

/// Sums over one block of rows.
#[derive(Clone, Debug, Default)]
pub(super) struct Block {
    /// Index of the recording.
    pub recording: usize,
    pub rows: Range<usize>,
    /// Number of innovations (rows).
    pub count: f64,
    /// Sum of normalised innovations squared; its expectation is the number of coordinates per row.
    pub nis: f64,
    pub log_det: f64,
    /// `Σ φᵀ S⁻¹ φ`, lower triangle, `columns` per row.
    pub j: Vec<f64>,
    /// `Σ φᵀ S⁻¹ e`.
    pub b: Vec<f64>,
    pub columns: usize,
    /// Sums of whitened innovations by axis, harmonic, and cos or sin.
    pub harmonics: Vec<[[f64; 2]; HARMONICS]>,
    /// `Σ w_t w_{t−1}` of the whitened innovations over all axes.
    pub neighbours: f64,
}

/// Sums for the columns in some registers.
struct Sums<'a> {
    registers: &'a [usize],
    columns: usize,
    j: Vec<f64>,
    b: Vec<f64>,
    /// By register.
    batch: Vec<[Register; BATCH]>,
    filled: usize,
}

impl<'a> Sums<'a> {
    fn new(registers: &'a [usize]) -> Self {
        let columns = registers.last().map_or(0, |last| (last + 1) * REGISTER);
        let batch = vec![[[0.0; REGISTER]; BATCH]; registers.len()];
        Self { registers, columns, j: vec![0.0; columns * columns], b: vec![0.0; columns], batch, filled: 0 }
    }

    #[inline(always)]
    fn flush(&mut self) {
        self.batch.iter_mut().for_each(|batch| batch[self.filled..].fill([0.0; REGISTER]));
        self.filled = 0;
        for (n, (first, left)) in self.registers.iter().zip(&self.batch).enumerate() {
            for i in 0..REGISTER {
                let row = &mut self.j[(first * REGISTER + i) * self.columns..][..self.columns];
                let to = row.as_chunks_mut::<REGISTER>().0;
                for (second, right) in self.registers[..=n].iter().zip(&self.batch) {
                    let mut sum = [0.0; REGISTER];
                    for (left, right) in left.iter().zip(right) {
                        for at in 0..REGISTER {
                            sum[at] += left[i] * right[at];
                        }
                    }
                    for at in 0..REGISTER {
                        to[*second][at] += sum[at];
                    }
                }
            }
        }
    }

    /// Adds the newest rows of the batch to `Σ φᵀ S⁻¹ e`.
    #[inline(always)]
    fn add_score<const N: usize>(&mut self, w: [f64; N]) {
        for (register, batch) in self.registers.iter().zip(&self.batch) {
            let to = &mut self.b[register * REGISTER..][..REGISTER];
            for (w, row) in w.iter().zip(&batch[self.filled..]) {
                to.iter_mut().zip(row).for_each(|(to, of)| *to += w * of);
            }
        }
        self.filled += N;
    }

    fn take(&mut self) -> (Vec<f64>, Vec<f64>) {
        self.flush();
        let full = std::mem::replace(self, Self::new(self.registers));
        (full.j, full.b)
    }
}

/// Sums of the sensitivities in some registers, block by block. With instruments these are the expected sensitivities, and the measured ones
/// ([`Layout::measured`](super::rotor::Layout::measured)) follow them.
fn columns_of<const N: usize, const K: usize, const S: usize>(input: Input<'_>, request: &Request) -> Vec<Block> {
    let Request { columns, registers, bench } = request;
    let (Input { case, rotor, piece }, pass) = (input, &Pass::<N, K>::of(input));
    let h = rotor.h;
    let (h_2, d) = (0.5 * h * h, rotor.delay);
    let m = rotor.sensor;
    let mut kalman = Kalman::<S>::diffuse::<N>(pass.slow(piece.filtered.start, &UNCHANGED));
    // Filters with the noise of one current raised give the derivatives of the innovations with respect to its level, and so the effect of the parameters
    // through the gains. Without it λ of a slow bearing seems known almost four times as well as it is.
    let gains = matches!(columns, Columns::Total | Columns::Instruments);
    let mut raised: [Kalman<S>; K] = std::array::from_fn(|_| kalman.clone());
    let mut x = vec![[[0.0; REGISTER]; S]; registers.len()];
    let [mut force, mut sensor] = [(); 2].map(|()| ColumnValues::new(rotor.layout.columns()));
    let mut sums = Sums::new(registers);
    let mut blocks = Vec::new();
    let expected = |row: usize| pass.expected(row).filter(|_| *columns == Columns::Instruments);
    let block_of = |row: usize| (row - piece.blocks_from) / piece.block;
    let empty = |row: usize| Block {
        recording: piece.recording,
        rows: row..row,
        harmonics: vec![Default::default(); N],
        ..Block::default()
    };
    let mut block = empty(piece.counted.start);
    let mut log_det = LogProduct::<N>::new();
    let mut former = [0.0; N];
    each_row(pass, piece.filtered.start..piece.counted.end, |row, to, interval, residual| {
        if let Some(interval) = interval {
            let ahead: State<N> = [
                array::from_fn(|a| interval.middle[0][a] + kalman.x[a] + 0.5 * h * kalman.x[N + a]),
                array::from_fn(|a| interval.middle[1][a] + kalman.x[N + a]),
            ];
            let measured = regressors(rotor.gaps(&ahead[0]), interval.squares);
            let (at, pulls) = match expected(row) {
                Some((pulls, [q, v])) => ([array::from_fn(|a| q[a] - 0.5 * h * v[a]), v], pulls),
                None => (ahead, measured),
            };
            kalman.predict(interval, &UNCHANGED.currents, pass.slow(1, &UNCHANGED));
            for k in 0..if gains { K } else { 0 } {
                let mut levels = UNCHANGED;
                levels.currents[k] += LEVEL_STEP;
                let scales = pass.scales(row, &levels);
                raised[k].predict(interval, &scales, pass.slow(1, &UNCHANGED));
            }
            rotor.force_columns(&at, pulls, measured, &interval.shaft, *bench, &mut force);
            if let Some((j, column)) = pass.by_lag(row, &at[0]).filter(|_| *bench) {
                force.put(j, column);
            }
            let [a, b, c, g] = &interval.transition.blocks;
            for (x, register) in x.iter_mut().zip(registers) {
                let force = &force.0[*register];
                for l in 0..REGISTER {
                    let [q, v]: State<N> = [array::from_fn(|i| x[i][l]), array::from_fn(|i| x[N + i][l])];
                    let mut f: [f64; N] = array::from_fn(|i| force[i][l]);
                    if S > 2 * N {
                        for i in 0..N {
                            f[i] += x[2 * N + i][l];
                        }
                    }
                    for i in 0..N {
                        let (mut to_q, mut to_v) = (q[i] + h_2 * f[i], v[i] + h * f[i]);
                        for j in 0..N {
                            to_q += a[i][j] * q[j] + b[i][j] * v[j];
                            to_v += c[i][j] * q[j] + g[i][j] * v[j];
                            if N > 2 {
                                to_v += h_2 * interval.gyroscopic[i][j] * f[j];
                            }
                        }
                        x[i][l] = to_q;
                        x[N + i][l] = to_v;
                    }
                }
            }
        }
        if *bench {
            // At the position predicted by the filter, as for the force.
            let [at, rate]: State<N> = match expected(row) {
                Some((_, state)) => state,
                None => array::from_fn(|d| array::from_fn(|a| pass.state[row][d][a] + kalman.x[N * d + a])),
            };
            let acceleration = interval.map_or([0.0; N], |interval| interval.end);
            rotor.sensor_columns(&[at, rate, acceleration], to, &mut sensor);
        }
        let innovation = kalman.update(rotor, pass.variance(row, &UNCHANGED), residual);
        let counts = row >= piece.counted.start;
        let w = innovation.factor.whiten(innovation.e);
        if counts && block_of(row) != block_of(block.rows.start) {
            close(&mut block, &mut sums, &mut log_det);
            blocks.push(std::mem::replace(&mut block, empty(row)));
        }
        if sums.filled + N > BATCH {
            sums.flush();
        }
        let filled = sums.filled;
        for ((x, register), batch) in x.iter_mut().zip(registers).zip(&mut sums.batch) {
            let sensor = &sensor.0[*register];
            for l in 0..REGISTER {
                let seen: [f64; N] = array::from_fn(|a| x[a][l] - d * x[N + a][l]);
                let mut phi: [f64; N] = array::from_fn(|a| sensor[a][l]);
                for a in 0..N {
                    for b in 0..N {
                        phi[a] += m[a][b] * seen[b];
                    }
                }
                for i in 0..S {
                    for a in 0..N {
                        x[i][l] -= innovation.gain[i][a] * phi[a];
                    }
                }
                let white = innovation.factor.whiten(phi);
                for a in 0..N {
                    batch[filled + a][l] = white[a];
                }
            }
        }
        if gains {
            let by_level: [[f64; N]; K] = array::from_fn(|k| {
                let other = raised[k].update(rotor, pass.variance(row, &UNCHANGED), residual);
                innovation.factor.whiten(array::from_fn(|a| (other.e[a] - innovation.e[a]) / LEVEL_STEP))
            });
            for (j, k, level) in &rotor.levels {
                let column = match columns {
                    // Instruments do not depend on the innovations; the measured sensitivities after them do.
                    Columns::Instruments => rotor.layout.measured(*j),
                    _ => Some(*j),
                };
                let Some(column) = column else { continue };
                // All registers are present.
                for a in 0..N {
                    sums.batch[column / REGISTER][filled + a][column % REGISTER] -= level * by_level[*k][a];
                }
            }
        }
        // Where the force is unknown, innovations are not white.
        let white = if counts && case.is_informative(row) { w } else { [0.0; N] };
        if counts {
            sums.add_score(w);
            block.rows.end = row + 1;
            if case.is_informative(row) {
                block.count += 1.0;
                block.nis += w.iter().map(|w| w * w).sum::<f64>();
                log_det.times(innovation.det);
            }
            let (c, s) = (to.cos, to.sin);
            for (harmonics, w) in block.harmonics.iter_mut().zip(white) {
                let mut turn = [c, s];
                for harmonic in harmonics {
                    harmonic[0] += w * turn[0];
                    harmonic[1] += w * turn[1];
                    turn = [turn[0] * c - turn[1] * s, turn[1] * c + turn[0] * s];
                }
            }
            block.neighbours += white.iter().zip(former).map(|(white, former)| white * former).sum::<f64>();
        }
        former = white;
    });
    close(&mut block, &mut sums, &mut log_det);
    blocks.push(block);
    blocks
}

fn close<const N: usize>(block: &mut Block, sums: &mut Sums<'_>, log_det: &mut LogProduct<N>) {
    block.columns = sums.columns;
    (block.j, block.b) = sums.take();
    block.log_det = log_det.finish(block.count);
    *log_det = LogProduct::new();
}

/// Calls `each` with every row, the shaft there, the interval that ends there (none at the first row), and the residual: measured position minus the
/// reading at the trajectory.
#[inline(always)]
fn each_row<const N: usize, const K: usize>(
    pass: &Pass<N, K>,
    rows: Range<usize>,
    mut each: impl FnMut(usize, &Shaft, Option<&Interval<N, K>>, [f64; N]),
) {
    let Input { case, rotor, .. } = pass.input;
    let mut from = case.shaft(rows.start);
    for row in rows.clone() {
        let to = case.shaft(row);
        let interval = (row > rows.start).then(|| pass.interval(row, &from, &to));
        let acceleration = interval.as_ref().map_or([0.0; N], |interval| interval.end);
        let [at, rate] = pass.state[row];
        let read = rotor.reading(&[at, rate, acceleration], &to);
        let residual = array::from_fn(|a| pass.position[a][row] - read[a]);
        each(row, &to, interval.as_ref(), residual);
        from = to;
    }
}

/// State of the smoother for a row.
struct FilteredRow<const N: usize, const S: usize> {
    /// From the previous row; none at the first one.
    transition: Option<Transition<N>>,
    predicted: Kalman<S>,
    innovation: Innovation<N, S>,
}

/// The smoothed trajectory of the counted rows (modified Bryson–Frazier recursion, Bierman 1973).
fn smooth<const N: usize, const K: usize, const S: usize>(input: Input<'_>) -> Vec<f64> {
    let (Input { rotor, piece, .. }, pass) = (input, &Pass::<N, K>::of(input));
    let start = piece.filtered.start;
    let mut kalman = Kalman::<S>::diffuse::<N>(pass.slow(start, &UNCHANGED));
    let mut filtered = Vec::with_capacity(piece.filtered.len());
    each_row(pass, piece.filtered.clone(), |row, _, interval, residual| {
        if let Some(interval) = interval {
            kalman.predict(interval, &UNCHANGED.currents, pass.slow(1, &UNCHANGED));
        }
        let transition = interval.map(|interval| interval.transition);
        let predicted = kalman.clone();
        let innovation = kalman.update(rotor, pass.variance(row, &UNCHANGED), residual);
        filtered.push(FilteredRow { transition, predicted, innovation });
    });
    let (m, d) = (&rotor.sensor, rotor.delay);
    let mut r = [0.0; S];
    let mut smoothed = vec![0.0; 2 * N * piece.counted.len()];
    for row in piece.filtered.clone().rev() {
        let FilteredRow { transition, predicted, innovation } = &filtered[row - start];
        // r ← Hᵀ (S⁻¹ e − Kᵀ r) + r.
        let mut u = innovation.factor.unwhiten(innovation.factor.whiten(innovation.e));
        for (a, u) in u.iter_mut().enumerate() {
            *u -= (0..S).map(|i| innovation.gain[i][a] * r[i]).sum::<f64>();
        }
        for a in 0..N {
            let back: f64 = (0..N).map(|b| m[b][a] * u[b]).sum();
            r[a] += back;
            r[N + a] -= d * back;
        }
        if row >= piece.counted.start && row < piece.counted.end {
            let to = &mut smoothed[2 * N * (row - piece.counted.start)..][..2 * N];
            for (i, before) in pass.state[row].as_flattened().iter().enumerate() {
                let change: f64 = (0..S).map(|j| predicted.p[i][j] * r[j]).sum();
                to[i] = before + predicted.x[i] + change;
            }
        }
        r = transition.map_or(r, |transition| transition.apply_transposed(&r));
    }
    smoothed
}

/// Innovations of the counted rows, row by row: in m, whitened, and errors of predictions [`rows_ahead`], m, one after another.
fn innovations<const N: usize, const K: usize, const S: usize>(input: Input<'_>) -> [Vec<f64>; 3] {
    let (Input { case, rotor, piece }, pass) = (input, &Pass::<N, K>::of(input));
    let start = piece.filtered.start;
    let ahead = rows_ahead(rotor.h);
    let mut kalman = Kalman::<S>::diffuse::<N>(pass.slow(start, &UNCHANGED));
    let mut without_readings = kalman.clone();
    let mut innovations = [0; 3].map(|_| Vec::with_capacity(N * piece.counted.len()));
    each_row(pass, start..piece.counted.end, |row, _, interval, residual| {
        if let Some(interval) = interval {
            for kalman in [&mut kalman, &mut without_readings] {
                kalman.predict(interval, &UNCHANGED.currents, pass.slow(1, &UNCHANGED));
            }
        }
        let variance = pass.variance(row, &UNCHANGED);
        let innovation = kalman.update(rotor, variance, residual);
        let mut error_ahead = [f64::NAN; N];
        if (row - start) % ahead == SHORTEST % ahead {
            let innovation = std::mem::replace(&mut without_readings, kalman.clone()).update(rotor, variance, residual);
            if row >= start + SHORTEST + ahead {
                error_ahead = innovation.e;
            }
        }
        if row >= piece.counted.start {
            let recorded = |error: [f64; N]| if case.is_missing(row) { [f64::NAN; N] } else { error };
            innovations[0].extend(recorded(innovation.e));
            innovations[1].extend(innovation.factor.whiten(innovation.e));
            innovations[2].extend(recorded(error_ahead));
        }
    });
    innovations
}

/// Noise levels relative to those of a recording.
#[derive(Clone, Copy)]
pub(super) struct Levels {
    /// Factors of the noise of each current.
    pub currents: ByMagnet,
    /// Factor of the level of the slow force.
    pub slow: f64,
    /// Change of the exponent with which position noise grows with the gap.
    pub exponent: f64,
    /// Factor on the errors of currents that were not recorded.
    pub restored: f64,
}

/// Unchanged levels.
pub(super) const UNCHANGED: Levels = Levels { currents: [1.0; 8], slow: 1.0, exponent: 0.0, restored: 1.0 };

/// `[Σ ln det, Σ NIS, rows]` for each of three sets of noise levels.
pub(super) type Likelihoods = [[f64; 3]; 3];

/// Likelihoods of three sets of levels at the same position noise.
fn likelihoods<const N: usize, const K: usize, const S: usize>(input: Input<'_>, levels: &[Levels; 3]) -> Likelihoods {
    let (Input { case, rotor, piece }, pass) = (input, &Pass::<N, K>::of(input));
    let start = piece.filtered.start;
    let mut kalman = levels.map(|levels| Kalman::<S>::diffuse::<N>(pass.slow(start, &levels)));
    let mut logs = [LogProduct::<N>::new(); 3];
    let mut sums = [[0.0; 3]; 3];
    each_row(pass, start..piece.counted.end, |row, _, interval, residual| {
        if let Some(interval) = interval {
            for (kalman, levels) in kalman.iter_mut().zip(levels) {
                kalman.predict(interval, &pass.scales(row, levels), pass.slow(1, levels));
            }
        }
        for f in 0..3 {
            let innovation = kalman[f].update(rotor, pass.variance(row, &levels[f]), residual);
            if row >= piece.counted.start.max(start + 4) && case.is_informative(row) {
                let w = innovation.factor.whiten(innovation.e);
                logs[f].times(innovation.det);
                sums[f][1] += w.iter().map(|w| w * w).sum::<f64>();
                sums[f][2] += 1.0;
            }
        }
    });
    for f in 0..3 {
        sums[f][0] = logs[f].finish(sums[f][2]);
    }
    sums
}

/// Values of all columns by coordinate, grouped by register.
pub(super) struct ColumnValues<const N: usize>(Vec<[Register; N]>);

impl<const N: usize> ColumnValues<N> {
    fn new(columns: usize) -> Self {
        Self(vec![[[0.0; REGISTER]; N]; columns.div_ceil(REGISTER)])
    }

    #[inline(always)]
    pub fn set(&mut self, n: usize, column: usize, value: f64) {
        self.0[column / REGISTER][n][column % REGISTER] = value;
    }

    #[inline(always)]
    pub fn put(&mut self, column: usize, values: [f64; N]) {
        let register = &mut self.0[column / REGISTER];
        (0..N).for_each(|n| register[n][column % REGISTER] = values[n]);
    }
}

/// Sensitivities computed by a pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Columns {
    /// To the unknowns of the search.
    Searched,
    /// To all parameters.
    All,
    /// The same, including the effect of parameters through the filter gains.
    Total,
    /// Instruments of all parameters, then the measured sensitivities, both total.
    Instruments,
}

/// Sums requested from a pass.
pub(super) struct Request {
    columns: Columns,
    /// Registers of the requested columns; others are skipped.
    registers: Vec<usize>,
    /// Whether bench parameters are among them.
    bench: bool,
}

impl Request {
    /// `searched` returns whether the search needs a column.
    pub fn of(columns: Columns, layout: &Layout, searched: impl Fn(usize) -> bool) -> Self {
        let is_needed = |j: &usize| columns != Columns::Searched || *j < layout.base || *j < layout.all && searched(*j);
        let needed = || (0..layout.columns()).filter(is_needed);
        let mut registers: Vec<usize> = needed().map(|j| j / REGISTER).collect();
        registers.dedup();
        Self { columns, registers, bench: needed().any(|j| j >= layout.base) }
    }
}

/// Description of the rotor and passes of the filter, with sizes fixed at compile time, since they run at every sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Passes {
    pub describe: fn(&RotorConfig<f64, 2>, [f64; PLANES]) -> Description,
    pub columns: fn(Input<'_>, &Request) -> Vec<Block>,
    /// Coordinates and rates, row by row.
    pub smooth: fn(Input<'_>) -> Vec<f64>,
    pub innovations: fn(Input<'_>) -> [Vec<f64>; 3],
    pub likelihoods: fn(Input<'_>, &[Levels; 3]) -> Likelihoods,
    /// Gaps in m and squared currents in A² of a row.
    pub gaps_and_squares: fn(Input<'_>, usize) -> [ByMagnet; 2],
}

impl Passes {
    /// For N coordinates, K magnets, U unknowns of the on-line estimator, and S states.
    fn sized<const N: usize, const K: usize, const U: usize, const S: usize>() -> Self {
        Self {
            describe: Description::of::<N, K, U>,
            columns: columns_of::<N, K, S>,
            smooth: smooth::<N, K, S>,
            innovations: innovations::<N, K, S>,
            likelihoods: likelihoods::<N, K, S>,
            gaps_and_squares: gaps_and_squares::<N, K>,
        }
    }

    /// For a part of a machine: without and with a slow force. An axis has one filter for both, as each takes a second to compile.
    pub fn of(coordinates: usize, magnets: usize) -> [Self; 2] {
        match (coordinates, magnets) {
            (1, 2) => [Self::sized::<1, 2, 3, 3>(); 2],
            (2, 3) => [Self::sized::<2, 3, 9, 4>(), Self::sized::<2, 3, 9, 6>()],
            (2, 4) => [Self::sized::<2, 4, 10, 4>(), Self::sized::<2, 4, 10, 6>()],
            (4, 6) => [Self::sized::<4, 6, 18, 8>(), Self::sized::<4, 6, 18, 12>()],
            (4, 8) => [Self::sized::<4, 8, 20, 8>(), Self::sized::<4, 8, 20, 12>()],
            _ => unreachable!("a part of a machine"),
        }
    }
}

fn gaps_and_squares<const N: usize, const K: usize>(input: Input<'_>, row: usize) -> [ByMagnet; 2] {
    let pass = Pass::<N, K>::of(input);
    let (mut gaps, mut squares) = (ByMagnet::default(), ByMagnet::default());
    gaps[..K].copy_from_slice(&input.rotor.gaps::<N, K>(&pass.state[row][0]));
    squares[..K].copy_from_slice(&pass.squares(row).middle);
    [gaps, squares]
}
