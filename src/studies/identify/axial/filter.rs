//! Extended Kalman filter of one axis between one or two magnets, whose currents are measured with noise.
//!
//! ```text
//! m ẍ = (p + λ₁ i₁²/(s − x)² − λ₂ i₂²/(s + x)²)/κ + d      x in m, forces in N
//! d  random walk with the level q in N/√s                   i_k  random walks with the level w in A/√s, and g Δi_c of the controller
//! x_read = x(t − delay) + noise, σ_x (gap/gap_at)^ν          i_read = i + noise, σ_i
//! ```
//!
//! and with errors of the sensors `x_read = (1 + sensor.gain) x(t − delay) + sensor.offset`, `i_read = (1 + current.gain) i + current.offset`.
//! The states of the currents are as read, so that noise, walks and feedback do not depend on these errors.
//!
//! The innovations give the likelihood (Ljung, *System Identification*, 2nd ed., section 7.4; Jazwinski, *Stochastic Processes
//! and Filtering Theory*, section 8.3 for the extended filter). Missing readings are skipped: the filter predicts
//! across any pattern of gaps.

use std::ops::Range;

use nalgebra::{SMatrix, SVector};

use super::{Axis, CURRENT_NOISE, DELAY, FEEDBACK, Law, SLOPE, SLOW, SLOW_START, WALK};
use crate::bearing::array;
use crate::estimation::Hold;

/// Initial standard deviations: of the position and of the travel in a sample time, relative to the gap; of a current, A.
const START_STD: f64 = 0.1;
const START_STD_A: f64 = 1.0;
/// The same for the slope of a current, A/s.
const START_STD_A_S: f64 = 10.0;
/// Where the position is known no better than this fraction of the gap, the law cannot be linearised: the filter waits for a reading and restarts.
const LOST: f64 = 0.3;

/// Input of the filter: readings with a uniform sample time, NaN where there is none.
#[derive(Clone, Debug)]
pub(super) struct Readings {
    /// Time of the first sample, and sample time, s.
    pub start_s: f64,
    pub step_s: f64,
    /// Positions, m.
    pub x_m: Vec<f64>,
    /// Currents of the magnets used, A.
    pub current_a: Vec<Vec<f64>>,
    /// Their changes since the previous row due to the controller, A, see [`feedback`](super::feedback::feedback); empty at first.
    pub feedback_a: Vec<Vec<f64>>,
    /// The rows that count.
    pub rows: Range<usize>,
}

impl Readings {
    /// Whether a row has all readings.
    pub(super) fn is_complete(&self, row: usize) -> bool {
        self.x_m[row].is_finite() && self.current_a.iter().all(|current| current[row].is_finite())
    }
}

/// Values of the magnets used in a row; 0 where there are none.
pub(super) fn in_row(columns: &[Vec<f64>], row: usize) -> [f64; 2] {
    array::from_fn(|k| columns.get(k).map_or(0.0, |column| column[row]))
}

/// Number of states for two magnets: x, v, d, the currents and their slopes. An unused magnet has a current of 0 without effect.
pub(super) const BOTH: usize = 7;
/// The same without the states of an unused magnet, which halves the time.
pub(super) const ONE: usize = 5;
/// Index of the position among the channels, which are the currents and the position.
pub(super) const POSITION: usize = 2;

/// Innovation of every channel with its variance; the variance is 0 where there was no reading.
pub(super) type Row = [[f64; 2]; 3];

/// The filter with N states at a row.
#[derive(Clone, Debug)]
pub(super) struct Filter<const N: usize> {
    law: Law,
    x: SVector<f64, N>,
    p: SMatrix<f64, N, N>,
    row: usize,
}

impl<const N: usize> Filter<N> {
    /// Number of magnets with states, and index of the slope of the first current.
    const MAGNETS: usize = (N - 3) / 2;
    const SLOPES: usize = 3 + Self::MAGNETS;

    /// Starts at the first row with all readings.
    pub(super) fn new(axis: &Axis, law: Law, readings: &Readings) -> Option<Self> {
        let row = readings.rows.clone().find(|row| readings.is_complete(*row))?;
        let mut filter = Self { law, x: SVector::zeros(), p: SMatrix::zeros(), row };
        filter.x[0] = law.true_value(POSITION, readings.x_m[row]);
        for (k, current) in readings.current_a.iter().enumerate() {
            filter.x[3 + k] = current[row];
            filter.p[(3 + k, 3 + k)] = START_STD_A * START_STD_A;
            filter.p[(Self::SLOPES + k, Self::SLOPES + k)] =
                if law.values[SLOPE] > 0.0 { START_STD_A_S * START_STD_A_S } else { 0.0 };
        }
        filter.reset_motion(readings.step_s);
        let start_n = if law.values[SLOW] > 0.0 { SLOW_START * axis.weight_n() } else { 0.0 };
        filter.p[(2, 2)] = start_n * start_n;
        Some(filter)
    }

    /// Resets speed and the uncertainty of position and speed; the position stays.
    fn reset_motion(&mut self, h: f64) {
        let start_std_m = START_STD * self.law.reference_m;
        self.p.fixed_rows_mut::<2>(0).fill(0.0);
        self.p.fixed_columns_mut::<2>(0).fill(0.0);
        (self.p[(0, 0)], self.p[(1, 1)]) = (start_std_m.powi(2), (start_std_m / h).powi(2));
        self.x[1] = 0.0;
    }

    fn is_lost(&self) -> bool {
        self.p[(0, 0)] > (LOST * self.law.reference_m).powi(2)
    }

    /// Filters the next row and returns its innovations; rows before the first reading have none.
    pub(super) fn step(&mut self, readings: &Readings, row: usize) -> Row {
        if row < self.row {
            return Row::default();
        }
        if row > self.row {
            let change_a = in_row(&readings.feedback_a, row).map(|change_a| self.law.values[FEEDBACK] * change_a);
            self.predict(readings.step_s, change_a);
        }
        self.row = row;
        self.correct(readings, row)
    }

    /// One sample time, in which the controller changes the currents: midpoint rule, `P = F P Fᵀ + Σ_k w² g_k g_kᵀ`.
    fn predict(&mut self, h: f64, change_a: [f64; 2]) {
        let law = self.law;
        let [walk, slow, slope] = [WALK, SLOW, SLOPE].map(|at| law.values[at] * law.values[at] * h);
        let is_lost = self.is_lost();
        // Effect of a constant acceleration on position and speed, and of one that grows linearly to 1.
        let (constant, linear) = ([0.5 * h * h, h], [h * h / 6.0, 0.5 * h]);
        // Parts of the change of the currents at the beginning and in the middle, and its effect.
        let (begin, middle, of_change) = match law.hold {
            Hold::Linear => (0.0, 0.5, linear),
            Hold::HeldBefore => (1.0, 1.0, constant),
            Hold::HeldAfter => (0.0, 0.0, [0.0; 2]),
        };
        let current = |k: usize, part: f64| self.x[3 + k] + part * (h * self.x[Self::SLOPES + k] + change_a[k]);
        let [begin_a, middle_a, end_a] =
            [begin, middle, 1.0].map(|part| [0, 1].map(|k| if k < Self::MAGNETS { current(k, part) } else { 0.0 }));
        let mut f = SMatrix::<f64, N, N>::identity();
        let mut noise = [SVector::<f64, N>::zeros(); 2];
        for (k, noise) in noise.iter_mut().enumerate().take(Self::MAGNETS) {
            f[(3 + k, Self::SLOPES + k)] = h;
            noise[3 + k] = 1.0;
        }
        // Without a position the force is unknown.
        if !is_lost {
            let begin = law.linearised(self.x[0], begin_a).0 + self.x[2] / law.m_kg;
            let middle_m = self.x[0] + 0.5 * h * self.x[1] + 0.125 * h * h * begin;
            let (middle, stiffness, gain) = law.linearised(middle_m, middle_a);
            let middle = middle + self.x[2] / law.m_kg;
            self.x[0] += h * self.x[1] + h * h / 6.0 * (begin + 2.0 * middle);
            self.x[1] += h * middle;
            (f[(0, 1)], f[(1, 0)]) = (h + h * h * h / 6.0 * stiffness, h * stiffness);
            for row in 0..2 {
                f[(row, row)] += 0.5 * h * h * stiffness;
                f[(row, 2)] = constant[row] / law.m_kg;
                for k in 0..Self::MAGNETS {
                    f[(row, 3 + k)] = constant[row] * gain[k];
                    f[(row, Self::SLOPES + k)] = h * of_change[row] * gain[k];
                    noise[k][row] = of_change[row] * gain[k];
                }
            }
        }
        self.x.as_mut_slice()[3..Self::SLOPES].copy_from_slice(&end_a[..Self::MAGNETS]);
        self.p[(2, 2)] += slow;
        self.p = f * self.p * f.transpose();
        // Unequal rounding of the two triangles would grow with the instability of the rotor.
        self.p.fill_lower_triangle_with_upper_triangle();
        for (k, noise) in noise.iter().enumerate().take(Self::MAGNETS) {
            self.p.ger(walk, noise, noise, 1.0);
            self.p[(Self::SLOPES + k, Self::SLOPES + k)] += slope;
        }
        if is_lost {
            self.reset_motion(h);
            self.p[(0, 0)] = law.reference_m * law.reference_m;
        }
    }

    fn correct(&mut self, readings: &Readings, row: usize) -> Row {
        let mut innovations = Row::default();
        for (k, innovation) in innovations.iter_mut().enumerate() {
            let is_position = k == POSITION;
            let reading =
                if is_position { Some(readings.x_m[row]) } else { readings.current_a.get(k).map(|of| of[row]) };
            let Some(reading) = reading.filter(|reading| reading.is_finite()) else { continue };
            if is_position && self.is_lost() {
                self.x[0] = self.law.true_value(POSITION, reading);
                self.reset_motion(readings.step_s);
            }
            let (at, delay_s) = if is_position { (0, self.law.values[DELAY]) } else { (3 + k, 0.0) };
            let [scale, offset] = if is_position { self.law.sensors[POSITION] } else { [1.0, 0.0] };
            let gain = (self.p.column(at) - self.p.column(1) * delay_s) * scale;
            let noise = if is_position { self.law.position_noise(reading) } else { self.law.values[CURRENT_NOISE] };
            let variance = scale * (gain[at] - delay_s * gain[1]) + noise * noise;
            let error = reading - (scale * (self.x[at] - delay_s * self.x[1]) + offset);
            *innovation = [error, variance];
            self.x.axpy(error / variance, &gain, 1.0);
            self.p.ger(-1.0 / variance, &gain, &gain, 1.0);
        }
        innovations
    }

    /// The slow force with its standard deviation, N.
    pub(super) fn slow_n(&self) -> [f64; 2] {
        [self.x[2], self.p[(2, 2)].max(0.0).sqrt()]
    }

    /// Reading of the position predicted this many rows ahead from the currents read in between, without position readings, m.
    pub(super) fn ahead(&self, readings: &Readings, rows: usize) -> f64 {
        let mut predictor = self.clone();
        for row in self.row + 1..=self.row + rows {
            for (k, current) in readings.current_a.iter().enumerate() {
                let change_a = current[row] - predictor.x[3 + k];
                predictor.x[Self::SLOPES + k] = if change_a.is_finite() { change_a / readings.step_s } else { 0.0 };
            }
            predictor.predict(readings.step_s, [0.0; 2]);
        }
        let [gain, offset] = self.law.sensors[POSITION];
        gain * predictor.x[0] + offset
    }
}
