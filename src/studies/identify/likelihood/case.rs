//! One recording, cut into pieces, and its noise levels.

use std::ops::Range;

use super::data::Piece;
use super::filter::Likelihoods;
use super::{Part, Recording, SHORTEST, resolution};
use crate::bearing::array;
use crate::estimation::START_CURRENT_NOISE_A;
use crate::studies::identify::mean;

/// Standard deviation of a squared current of which nothing is known, relative to its mean: so large that the interval carries no information on the magnet.
const UNKNOWN_SQUARE: f64 = 20.0;
/// Rows of a piece.
const PIECE: usize = 1 << 15;
/// Memory of the filter, s: with the negative stiffness of the field its slowest pole is at some 100 rad/s, which attenuates older samples by e⁻¹⁵.
const MARGIN_S: f64 = 0.15;
/// Blocks per recording: enough to find a change within a per cent of the recording.
const BLOCKS: usize = 128;
/// Rows of the shortest block.
pub(super) const SHORTEST_BLOCK: usize = 32;
/// Half-width of the window for ω̇, s.
const RATE_HALF_WIDTH_S: f64 = 1.5e-3;
/// Step of the logarithm of the current noise for the parabola through its likelihood.
pub(super) const NOISE_STEP: f64 = 0.25;
/// Prior standard deviation of the logarithm of the current noise: half of ln(50/5), as the first guess is the middle of 5 and 50 mA. It matters
/// only where positions are too noisy to determine the current noise.
const CURRENT_NOISE_LOG_STD: f64 = 0.5 * std::f64::consts::LN_10;
/// Scale of the Cauchy prior of the logarithm of a stated noise: the error of drawn bearings after 5 s is 1.09 bounds, as with a fixed noise, but 1.22 with
/// a scale of 2 % (seed 131001). Its tails let the data correct a wrong statement: with a fixed noise, positions × 0.75 and currents × 1.3, half of good
/// recordings of 1 s were refused for a backward force.
const STATED_NOISE: f64 = 0.005;

/// One recording with its rows cut into pieces.
pub(super) struct Case<'a> {
    pub recording: &'a Recording,
    /// By coordinate, m.
    pub position: Vec<&'a [f64]>,
    /// Currents by magnet, A.
    pub current: Vec<&'a [f64]>,
    /// Errors of positions and squared currents that were not recorded ([`Recording::position_error_m`]); empty if all were.
    pub position_error: Vec<&'a [f32]>,
    pub square_error: Vec<&'a [f32]>,
    /// Standard deviations of squared currents of which nothing is known, A².
    pub unknown_a2: Vec<f64>,
    /// cos θ, sin θ at the samples, and in the middle of the interval ending there.
    pub at: Vec<[f64; 2]>,
    pub middle: Vec<[f64; 2]>,
    /// Half-width of the window for ω̇, rows.
    pub half_width: usize,
    pub segments: Vec<Range<usize>>,
    pub pieces: Vec<Piece>,
    pub position_noise: f64,
    pub current_noise: f64,
    /// Medians of both before the data: as stated, if they are.
    noise_median: [f64; 2],
    /// Variance of the logarithm of the current noise.
    pub noise_variance: f64,
    /// Level of the slow force, N after one second; 0 unless estimated.
    pub slow_force: f64,
    /// Exponent with which position noise grows with the gap, and its standard deviation; 0 unless estimated.
    pub exponent: f64,
    pub exponent_std: f64,
    /// Factor on the errors of squared currents that were not recorded.
    pub restored: f64,
    /// Step of each position sensor, m; 0 unless it is quantised.
    pub resolution_m: Vec<f64>,
    /// Effective number of rows, if fewer than all.
    effective_rows: Option<usize>,
    /// Trajectory about which a pass is linearised: coordinates and rates, row by row.
    pub state: Vec<f64>,
    /// Expected values by row, in single precision to save memory: `i_k²/gap_k²` in A²/m² over the interval that ends there, then coordinates
    /// and rates. Empty until known.
    pub expected: Vec<f32>,
}

impl Case<'_> {
    /// Rows used.
    pub fn rows(&self) -> usize {
        self.pieces.iter().map(|piece| piece.counted.len()).sum()
    }

    /// Effective number of rows.
    pub fn effective_rows(&self) -> usize {
        self.effective_rows.map_or(self.rows(), |effective| effective.min(self.rows()))
    }

    /// Root mean square of all currents.
    pub fn rms_current_a(&self) -> f64 {
        mean(self.current.iter().copied().flatten().map(|i| i * i)).sqrt()
    }

    /// Inverse variances of the logarithms of both noises before the data, at these deviations from the prior median. A Cauchy prior is a Gaussian one whose
    /// variance grows with the deviation: noises that start from the data stay with them where they contradict the statement.
    fn noise_precision(&self, deviations: [f64; 2]) -> [f64; 2] {
        let cauchy = |deviation: f64| 2.0 / (STATED_NOISE * STATED_NOISE + deviation * deviation);
        let [position, current] = deviations;
        [
            self.recording.position_noise_m.map_or(0.0, |_| cauchy(position)),
            self.recording.current_noise_a.map_or(CURRENT_NOISE_LOG_STD.powi(-2), |_| cauchy(current)),
        ]
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

fn pieces(recording: usize, segments: &[Range<usize>], h: f64) -> Vec<Piece> {
    let rows: usize = segments.iter().map(Range::len).sum();
    let block = (rows / BLOCKS).max(SHORTEST_BLOCK);
    let margin = (MARGIN_S / h).ceil() as usize;
    let length = PIECE.max(8 * margin).div_ceil(block) * block;
    let mut pieces = Vec::new();
    for segment in segments {
        let mut from = segment.start;
        while from < segment.end {
            // A short remainder joins the piece before it.
            let to = if segment.end - from < length + length / 2 { segment.end } else { from + length };
            let filtered = from.saturating_sub(margin).max(segment.start)..(to + margin).min(segment.end);
            pieces.push(Piece { recording, filtered, counted: from..to, block, blocks_from: segment.start });
            from = to;
        }
    }
    pieces
}

/// rms of fourth and sixth differences, over √70 and √924, whichever is smaller: white noise without the motion.
fn position_noise(position: &[&[f64]], segments: &[Range<usize>]) -> f64 {
    let rms = |weights: &[f64], gain: f64| {
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
    let fourth = rms(&[1.0, -4.0, 6.0, -4.0, 1.0], 70.0);
    fourth.min(rms(&[1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0], 924.0)).max(1e-10)
}

/// The recording with this index; `None` if it is too short.
pub(super) fn prepare<'a>(r: usize, recording: &'a Recording, part: &Part, usable: &[bool]) -> Option<Case<'a>> {
    let (h, rows) = (recording.step_s, recording.rows());
    fn columns<T>(of: &[Vec<T>], first: usize, count: usize) -> Vec<&[T]> {
        of.iter().skip(first).take(count).map(Vec::as_slice).collect()
    }
    let (coordinates, magnets) = (part.body.coordinates(), part.body.magnets());
    let position = columns(&recording.position_m, part.positions, coordinates);
    let current = columns(&recording.current_a, part.magnets, magnets);
    let position_error = columns(&recording.position_error_m, part.positions, coordinates);
    let square_error = columns(&recording.square_error_a2, part.magnets, magnets);
    let segments = segments((0..rows).map(|row| recording.usable[row] && usable[row]));
    if segments.is_empty() {
        return None;
    }
    let turn = |angle: f64| {
        let (sin, cos) = libm::sincos(angle);
        [cos, sin]
    };
    let (theta, omega) = (&recording.theta_rad, &recording.omega_rad_s);
    let n = position.len();
    let mut state = vec![0.0; 2 * n * rows];
    for segment in &segments {
        for row in segment.clone() {
            let (before, after) = (row.max(segment.start + 1) - 1, (row + 1).min(segment.end - 1));
            let rate = |of: &[f64]| (of[after] - of[before]) / ((after - before) as f64 * h);
            for (at, of) in position.iter().enumerate() {
                state[2 * n * row + at] = of[row];
                state[2 * n * row + n + at] = rate(of);
            }
        }
    }
    let noise = position_noise(&position, &segments);
    let is_read = |row: &usize| !position_error.iter().any(|error_m| error_m[*row] > 0.0);
    let read: Vec<usize> = segments.iter().flat_map(Clone::clone).filter(is_read).collect();
    let resolution_m: Vec<f64> = position.iter().map(|of| resolution::step(read.iter().map(|row| of[*row]))).collect();
    let effective_rows = resolution::effective_rows(&position, &read, &resolution_m, noise);
    Some(Case {
        recording,
        at: theta.iter().map(|theta| turn(*theta)).collect(),
        middle: theta.iter().zip(omega).map(|(theta, omega)| turn(theta - 0.5 * h * omega)).collect(),
        half_width: ((RATE_HALF_WIDTH_S / h).round() as usize).max(1),
        unknown_a2: current.iter().map(|of| UNKNOWN_SQUARE * mean(of.iter().map(|i| i * i))).collect(),
        position,
        current,
        position_error,
        square_error,
        pieces: pieces(r, &segments, h),
        segments,
        position_noise: noise,
        current_noise: START_CURRENT_NOISE_A,
        noise_median: [
            recording.position_noise_m.unwrap_or(noise),
            recording.current_noise_a.unwrap_or(START_CURRENT_NOISE_A),
        ],
        noise_variance: 0.0,
        slow_force: 0.0,
        exponent: 0.0,
        exponent_std: 0.0,
        restored: 1.0,
        resolution_m,
        effective_rows,
        state,
        expected: Vec::new(),
    })
}

/// Maximum of the parabola through three values a step apart, relative to the middle one, and its second derivative.
fn peak([low, mid, high]: [f64; 3]) -> (f64, f64) {
    let slope = (high - low) / (2.0 * NOISE_STEP);
    let curvature = (high - 2.0 * mid + low) / (NOISE_STEP * NOISE_STEP);
    let limit = 4.0 * NOISE_STEP;
    (if curvature < 0.0 { (-slope / curvature).clamp(-limit, limit) } else { limit.copysign(slope) }, curvature)
}

/// The same for likelihoods at three values a step apart, with a zero-mean prior.
fn posterior_peak(sums: &Likelihoods, middle: f64, prior_std: f64) -> (f64, f64) {
    peak([0, 1, 2].map(|i| {
        let deviation = (middle + (i as f64 - 1.0) * NOISE_STEP) / prior_std;
        -0.5 * (sums[i][0] + sums[i][1] + deviation * deviation)
    }))
}

/// Iterations for the common scale of the noises.
const NEWTON: usize = 20;

/// Updates the noise levels of one recording from the likelihood at three levels of the current noise; returns the largest change of a logarithm.
pub(super) fn noise_step(case: &mut Case<'_>, sums: &Likelihoods) -> f64 {
    let count = case.position.len() as f64 * sums[1][2];
    if count < 8.0 {
        return 0.0;
    }
    let before = [case.position_noise, case.current_noise];
    let deviations: [f64; 2] = array::from_fn(|at| libm::log(before[at] / case.noise_median[at]));
    let weights = case.noise_precision(deviations);
    // Each ratio of the noises has a most likely common scale (logarithm), and with it a posterior.
    let at_ratio = |i: usize| {
        let ratio = (i as f64 - 1.0) * NOISE_STEP;
        let (log_det, chi) = (sums[i][0], sums[i][1].max(f64::MIN_POSITIVE));
        let [position, current] = [deviations[0], deviations[1] + ratio];
        let (weight, moment) = (weights[0] + weights[1], weights[0] * position + weights[1] * current);
        // From below, Newton's method converges monotonically: the slope is convex.
        let mut scale = (0.5 * libm::log(chi / count)).min(if weight > 0.0 { -moment / weight } else { f64::INFINITY });
        for _ in 0..NEWTON {
            let fit = chi * libm::exp(-2.0 * scale);
            scale += (fit - count - moment - weight * scale) / (2.0 * fit + weight);
        }
        let [position, current] = [position, current].map(|of| (of + scale) * (of + scale));
        let fit = chi * libm::exp(-2.0 * scale) + 2.0 * count * scale;
        (scale, -0.5 * (log_det + fit + weights[0] * position + weights[1] * current))
    };
    let best = [0, 1, 2].map(at_ratio);
    let (ratio, curvature) = peak(best.map(|(_, value)| value));
    case.noise_variance = 1.0 / weights[1].max(-curvature);
    let scale = {
        let inside = (ratio / NOISE_STEP).clamp(-1.0, 1.0);
        let [l, m, h] = best.map(|(scale, _)| scale);
        m + 0.5 * inside * (h - l) + 0.5 * inside * inside * (h - 2.0 * m + l)
    };
    case.position_noise *= libm::exp(scale);
    case.current_noise *= libm::exp(ratio + scale);
    case.position_noise = case.position_noise.max(1e-10);
    // Above this the square of a current would be all noise.
    case.current_noise = case.current_noise.clamp(1e-6, 0.39 * case.rms_current_a().max(1e-5));
    let changes = [case.position_noise / before[0], case.current_noise / before[1]];
    let [position, current] = changes.map(|change| libm::log(change).abs());
    position.max(current * weight(curvature))
}

/// Updates a level with a log-normal prior about 1 and a smallest value from the likelihood at three levels; returns the change of its logarithm,
/// weighted by its information.
pub(super) fn level_step(level: &mut f64, sums: &Likelihoods, prior_std: f64, least: f64) -> f64 {
    let (before, (step, curvature)) = (*level, posterior_peak(sums, libm::log(*level), prior_std));
    *level = (before * libm::exp(step)).max(least);
    libm::log(*level / before).abs() * weight(curvature)
}

/// Weight of the change of a logarithm by its information: one that hardly matters need not converge.
fn weight(curvature: f64) -> f64 {
    (-curvature.min(0.0)).sqrt().min(1.0)
}

/// Prior standard deviation of the logarithm of the factor on errors of currents that were not recorded.
pub(super) const RESTORED_LOG_STD: f64 = 1.0;

/// Prior standard deviation of the exponent with which position noise grows with the gap.
const EXPONENT_STD: f64 = 3.0;

/// Updates that exponent from the likelihood at three values; returns its change in standard deviations.
pub(super) fn exponent_step(case: &mut Case<'_>, sums: &Likelihoods) -> f64 {
    let (step, curvature) = posterior_peak(sums, case.exponent, EXPONENT_STD);
    case.exponent += step;
    case.exponent_std = if curvature < 0.0 { (-1.0 / curvature).sqrt() } else { EXPONENT_STD };
    (step / case.exponent_std).abs()
}
