//! One recording, cut into pieces, and its noise levels.

use std::ops::Range;

use super::data::{Piece, Track};
use super::{Part, Recording, SHORTEST, resolution};
use crate::estimation::START_CURRENT_NOISE_A;
use crate::studies::identify::mean;

/// Error of a squared current that is not known, relative to its mean: so large that the interval tells nothing of the magnet.
const NOTHING: f64 = 20.0;
/// Rows of a piece.
const PIECE: usize = 1 << 15;
/// Memory of the filter in s, beyond which a sample does not matter: the field's negative stiffness makes its slowest pole some 100 rad/s
/// (e⁻¹⁵).
const MARGIN_S: f64 = 0.15;
/// Blocks per recording: enough to find a change within a per cent of the recording.
const BLOCKS: usize = 128;
/// Rows of the shortest block.
pub(super) const SHORTEST_BLOCK: usize = 32;
/// Time over which ω̇ is taken, to each side, in s.
const RATE_S: f64 = 1.5e-3;
/// Step of the logarithm of the current noise for the parabola through its likelihood.
pub(super) const NOISE_STEP: f64 = 0.25;
/// How far the first guess of the current noise holds, as a standard deviation of the logarithm: half of ln(50/5), as it is the middle of 5 and 50 mA. It decides
/// only where positions are too noisy to tell.
const CURRENT_NOISE_LOG_STD: f64 = 0.5 * std::f64::consts::LN_10;

/// One recording with its rows cut into pieces.
pub(super) struct Case<'a> {
    pub recording: &'a Recording,
    /// By coordinate, m.
    pub position: Vec<&'a [f64]>,
    /// Its currents, by magnet, A.
    pub current: Vec<&'a [f64]>,
    /// By how much positions and currents may be off that were not recorded ([`Recording::position_error_m`]); empty if all were.
    pub position_error: Vec<&'a [f32]>,
    pub square_error: Vec<&'a [f32]>,
    /// Errors of squared currents of which nothing is known, A².
    pub unknown_a2: Vec<f64>,
    /// cos θ, sin θ at the samples, and in the middle of the interval that ends there.
    pub at: Vec<[f64; 2]>,
    pub middle: Vec<[f64; 2]>,
    /// Half the number of rows over which ω̇ is taken.
    pub half_width: usize,
    pub segments: Vec<Range<usize>>,
    pub pieces: Vec<Piece>,
    pub position_noise: f64,
    pub current_noise: f64,
    /// Variance of the logarithm of the current noise; 0 if it is told.
    pub noise_variance: f64,
    /// Level of the slow force, N after a second; 0 unless it is estimated.
    pub slow_force: f64,
    /// Power of the gap with which the noise of the positions grows, with its standard deviation; 0 unless it is estimated.
    pub exponent: f64,
    pub exponent_std: f64,
    /// Factor of the errors of squared currents that were not recorded.
    pub restored: f64,
    /// Step of each position sensor, m; 0 unless it is quantised.
    pub resolution_m: Vec<f64>,
    /// As how many rows they count, if not all.
    counting: Option<usize>,
    pub track: Track,
}

impl Case<'_> {
    /// Rows that are used.
    pub fn rows(&self) -> usize {
        self.pieces.iter().map(|piece| piece.counted.len()).sum()
    }

    /// As how many rows they count.
    pub fn counting(&self) -> usize {
        self.counting.map_or(self.rows(), |counting| counting.min(self.rows()))
    }

    /// Whether both levels of noise are stated.
    pub fn has_known_noise(&self) -> bool {
        self.recording.position_noise_m.is_some() && self.recording.current_noise_a.is_some()
    }

    /// Rows of a block.
    pub fn block(&self) -> usize {
        self.pieces.first().map_or(0, |piece| piece.block)
    }
}

/// Segments of usable rows.
fn segments(usable: impl Iterator<Item = bool>) -> Vec<Range<usize>> {
    let rows: Vec<usize> = usable.enumerate().filter(|(_, usable)| *usable).map(|(row, _)| row).collect();
    let segments = rows.chunk_by(|row, next| row + 1 == *next).filter(|rows| rows.len() >= SHORTEST);
    segments.map(|rows| rows[0]..rows[rows.len() - 1] + 1).collect()
}

fn pieces(segments: &[Range<usize>], h: f64) -> Vec<Piece> {
    let rows: usize = segments.iter().map(Range::len).sum();
    let block = (rows / BLOCKS).max(SHORTEST_BLOCK);
    let margin = (MARGIN_S / h).ceil() as usize;
    let length = PIECE.max(8 * margin).div_ceil(block) * block;
    let mut pieces = Vec::new();
    for segment in segments {
        let mut from = segment.start;
        while from < segment.end {
            // A short rest goes with the piece before it.
            let to = if segment.end - from < length + length / 2 { segment.end } else { from + length };
            let filtered = from.saturating_sub(margin).max(segment.start)..(to + margin).min(segment.end);
            pieces.push(Piece { filtered, counted: from..to, block, blocks_from: segment.start });
            from = to;
        }
    }
    pieces
}

/// rms of fourth and sixth differences, over √70 and √924, the smaller one: white noise without the motion.
fn position_noise(position: &[&[f64]], segments: &[Range<usize>]) -> f64 {
    let binomials: [(&[f64], f64); 2] =
        [(&[1.0, -4.0, 6.0, -4.0, 1.0], 70.0), (&[1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0], 924.0)];
    let of = |(weights, gain): (&[f64], f64)| {
        let (mut sum, mut count) = (0.0, 0.0);
        for segment in segments {
            for window in position.iter().flat_map(|position| position[segment.clone()].windows(weights.len())) {
                let d: f64 = window.iter().zip(weights).map(|(p, w)| p * w).sum();
                sum += d * d;
                count += 1.0;
            }
        }
        (sum / (count * gain)).sqrt()
    };
    of(binomials[0]).min(of(binomials[1])).max(1e-10)
}

pub(super) fn prepare<'a>(recording: &'a Recording, part: &Part, usable: &[bool]) -> Option<Case<'a>> {
    let (h, rows) = (recording.step_s, recording.rows());
    fn columns<T>(of: &[Vec<T>], first: usize, count: usize) -> Vec<&[T]> {
        of.iter().skip(first).take(count).map(Vec::as_slice).collect()
    }
    let (coordinates, magnets) = (part.body.coordinates(), part.body.magnets());
    let position = columns(&recording.position_m, part.positions, coordinates);
    let current = columns(&recording.current_a, part.magnets, magnets);
    let position_error = columns(&recording.position_error_m, part.positions, coordinates);
    let square_error = columns(&recording.square_error_a2, part.magnets, magnets);
    let is_usable = |of: &[bool], row: usize| of.get(row).copied().unwrap_or(true);
    let segments = segments((0..rows).map(|row| is_usable(&recording.usable, row) && is_usable(usable, row)));
    if segments.is_empty() {
        return None;
    }
    let turn = |angle: f64| {
        let (sin, cos) = libm::sincos(angle);
        [cos, sin]
    };
    let (theta, omega) = (&recording.theta_rad, &recording.omega_rad_s);
    let n = position.len();
    let mut track = Track { state: vec![0.0; 2 * n * rows], expected: Vec::new() };
    for segment in &segments {
        for row in segment.clone() {
            let (before, after) = (row.max(segment.start + 1) - 1, (row + 1).min(segment.end - 1));
            let rate = |of: &[f64]| (of[after] - of[before]) / ((after - before) as f64 * h);
            for (at, of) in position.iter().enumerate() {
                track.state[2 * n * row + at] = of[row];
                track.state[2 * n * row + n + at] = rate(of);
            }
        }
    }
    let noise = recording.position_noise_m.unwrap_or_else(|| position_noise(&position, &segments));
    let is_read = |row: &usize| !position_error.iter().any(|error_m| error_m[*row] > 0.0);
    let read: Vec<usize> = segments.iter().flat_map(Clone::clone).filter(is_read).collect();
    let steps = position.iter().map(|of| resolution::step(read.iter().map(|row| of[*row])));
    let resolution_m: Vec<f64> = steps.collect();
    let counting = resolution::counting(&position, &read, &resolution_m, noise);
    Some(Case {
        recording,
        at: theta.iter().map(|theta| turn(*theta)).collect(),
        middle: theta.iter().zip(omega).map(|(theta, omega)| turn(theta - 0.5 * h * omega)).collect(),
        half_width: ((RATE_S / h).round() as usize).max(1),
        unknown_a2: current
            .iter()
            .map(|of| NOTHING * mean(of.iter().filter(|i| i.is_finite()).map(|i| i * i)))
            .collect(),
        position,
        current,
        position_error,
        square_error,
        pieces: pieces(&segments, h),
        segments,
        position_noise: noise.max(1e-10),
        current_noise: recording.current_noise_a.unwrap_or(START_CURRENT_NOISE_A).max(1e-7),
        noise_variance: 0.0,
        slow_force: 0.0,
        exponent: 0.0,
        exponent_std: 0.0,
        restored: 1.0,
        resolution_m,
        counting,
        track,
    })
}

/// Where a parabola through three values a step apart is highest, from the middle one, and its second derivative.
fn peak([low, mid, high]: [f64; 3]) -> (f64, f64) {
    let slope = (high - low) / (2.0 * NOISE_STEP);
    let bend = (high - 2.0 * mid + low) / (NOISE_STEP * NOISE_STEP);
    let most = 4.0 * NOISE_STEP;
    (if bend < 0.0 { (-slope / bend).clamp(-most, most) } else { most.copysign(slope) }, bend)
}

/// Noise levels of one recording from the likelihood at three levels of the current noise; the largest change of a logarithm.
pub(super) fn noise_step(case: &mut Case<'_>, sums: &[[f64; 3]; 3]) -> f64 {
    let told_current = case.recording.current_noise_a.is_some();
    let count = case.position.len() as f64 * sums[1][2];
    if count < 8.0 || case.has_known_noise() {
        return 0.0;
    }
    let logs = |i: usize| libm::log(sums[i][1] / count);
    // The common scale of both levels is known in closed form where neither is told.
    let scale_is_free = case.recording.position_noise_m.is_none() && !told_current;
    let value = |i: usize| {
        let fit = if scale_is_free { count * logs(i) } else { sums[i][1] };
        let level = libm::log(case.current_noise / START_CURRENT_NOISE_A)
            + (i as f64 - 1.0) * NOISE_STEP
            + if scale_is_free { 0.5 * logs(i) } else { 0.0 };
        let far = level / CURRENT_NOISE_LOG_STD;
        -0.5 * (sums[i][0] + fit + far * far)
    };
    let (ratio, bend) = peak([0, 1, 2].map(value));
    if !told_current {
        let prior = CURRENT_NOISE_LOG_STD * CURRENT_NOISE_LOG_STD;
        case.noise_variance = if bend < 0.0 { (-1.0 / bend).min(prior) } else { prior };
    }
    let rms = mean(case.current.iter().copied().flatten().map(|i| i * i)).sqrt();
    let scale = {
        let t = ratio / NOISE_STEP;
        let (l, m, h) = (logs(0), logs(1), logs(2));
        let inside = t.clamp(-1.0, 1.0);
        0.5 * (m + 0.5 * inside * (h - l) + 0.5 * inside * inside * (h - 2.0 * m + l))
    };
    let (before_position, before_current) = (case.position_noise, case.current_noise);
    if scale_is_free {
        case.position_noise *= libm::exp(scale);
        case.current_noise *= libm::exp(ratio + scale);
    } else if !told_current {
        case.current_noise *= libm::exp(ratio);
    } else {
        // The level of the positions alone: what the common scale says, again and again.
        case.position_noise *= libm::exp(0.5 * logs(1).clamp(-1.0, 1.0));
    }
    case.position_noise = case.position_noise.max(1e-10);
    // Beyond it the square of a current would be all noise.
    case.current_noise = case.current_noise.clamp(1e-6, 0.39 * rms.max(1e-5));
    // A level that hardly matters has not to converge: weigh its change by its information.
    let weight = (-bend.min(0.0)).sqrt().min(1.0);
    let changes = [case.position_noise / before_position, case.current_noise / before_current];
    let [position, current] = changes.map(|change| libm::log(change).abs());
    position.max(current * weight)
}

/// Level of the slow force from the likelihood at three levels; the change of its logarithm, weighed by its information.
pub(super) fn slow_force_step(case: &mut Case<'_>, sums: &[[f64; 3]; 3], least: f64) -> f64 {
    let (step, bend) = peak([0, 1, 2].map(|i| -0.5 * (sums[i][0] + sums[i][1])));
    let before = case.slow_force;
    case.slow_force = (before * libm::exp(step)).max(least);
    libm::log(case.slow_force / before).abs() * (-bend.min(0.0)).sqrt().min(1.0)
}

/// How far errors of currents that were not recorded may be from those that are expected, as a standard deviation of the logarithm.
const RESTORED_LOG_STD: f64 = 1.0;

/// Level of the errors of currents that were not recorded, from the likelihood at three levels; the change of its logarithm, weighed by its information.
pub(super) fn restored_step(case: &mut Case<'_>, sums: &[[f64; 3]; 3]) -> f64 {
    let value = |i: usize| {
        let far = (libm::log(case.restored) + (i as f64 - 1.0) * NOISE_STEP) / RESTORED_LOG_STD;
        -0.5 * (sums[i][0] + sums[i][1] + far * far)
    };
    let (step, bend) = peak([0, 1, 2].map(value));
    case.restored *= libm::exp(step);
    step.abs() * (-bend.min(0.0)).sqrt().min(1.0)
}

/// How far the noise of the positions may depend on the gap, as a standard deviation of its power.
const EXPONENT_STD: f64 = 3.0;

/// Power of the gap in the noise of the positions from the likelihood at three of them; its change in standard deviations.
pub(super) fn exponent_step(case: &mut Case<'_>, sums: &[[f64; 3]; 3]) -> f64 {
    let value = |i: usize| {
        let far = (case.exponent + (i as f64 - 1.0) * NOISE_STEP) / EXPONENT_STD;
        -0.5 * (sums[i][0] + sums[i][1] + far * far)
    };
    let (step, bend) = peak([0, 1, 2].map(value));
    case.exponent += step;
    case.exponent_std = if bend < 0.0 { (-1.0 / bend).sqrt() } else { EXPONENT_STD };
    (step / case.exponent_std).abs()
}
