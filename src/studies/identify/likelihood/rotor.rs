//! Equations of motion over one sample interval, linearised about a trajectory, and of the sensors, with their derivatives to all
//! parameters.
//!
//! The rotor and its magnets are those of the on-line estimator ([`Machine`]): N coordinates that the sensors read, K magnets, accelerations by
//! unit forces. What a parameter of the bearing changes is the difference of two such descriptions. Descriptions have room for the largest machine; what is done at
//! every sample knows N and K.

#![allow(clippy::needless_range_loop, reason = "several arrays go by one index")]

use super::Part;
use super::bench::Places;
use super::case::Case;
use super::filter::{Passes, Sheet};
use super::lag::Lag;
use crate::estimation::Machine;
use crate::plant::PLANES;

/// A value for each coordinate, and for each magnet, with room for the most of them.
pub(super) type ByAxis<T = f64> = [T; 4];
pub(super) type ByMagnet<T = f64> = [T; 8];

/// Coordinates in m and their rates in m/s.
pub(super) type State<const N: usize> = [[f64; N]; 2];

/// Places of the parameters of one recording: λ, U cos φ and U sin φ of each plane, loads, then the bench.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    /// Number of magnets, and place of the first unbalance.
    pub magnets: usize,
    /// Place of the first load. Among the unknowns of all recordings the bench begins here.
    pub load: usize,
    /// Place of the first parameter of the bench.
    pub base: usize,
    /// Number of parameters.
    pub all: usize,
    /// Place of κ, if it is asked for.
    pub dynamics: Option<usize>,
    /// Whether the currents are commands, which have no noise that instruments would be needed for.
    pub commands: bool,
}

impl Layout {
    /// Number of loads, one for each coordinate.
    pub fn loads(&self) -> usize {
        self.base - self.load
    }

    /// Number of unknowns that all recordings share: λ, U, then the bench.
    pub fn shared(&self) -> usize {
        self.all - self.loads()
    }

    /// Number of unknowns of so many recordings.
    pub fn unknowns(&self, recordings: usize) -> usize {
        self.shared() + self.loads() * recordings
    }

    /// Place of the measured sensitivity to a parameter behind those of all parameters: λ and κ have one, for the noise of the currents biases their scores.
    pub fn measured(&self, j: usize) -> Option<usize> {
        if self.commands {
            None
        } else if j < self.magnets {
            Some(self.all + j)
        } else {
            self.dynamics.filter(|dynamics| *dynamics == j).map(|_| self.all + self.magnets)
        }
    }

    /// Number of columns with the measured ones.
    pub fn columns(&self) -> usize {
        self.all + if self.commands { 0 } else { self.magnets + usize::from(self.dynamics.is_some()) }
    }

    /// Number of the unknown that parameter `j` of recording `r` is: λ, U, bench, then the loads of each recording.
    pub fn unknown(&self, j: usize, r: usize) -> usize {
        if j < self.load {
            j
        } else if j < self.base {
            self.shared() + self.loads() * r + (j - self.load)
        } else {
            j - self.loads()
        }
    }
}

/// The response of a rotor to forces and motions: gaps in m, directions and accelerations per N, as in [`Machine`].
#[derive(Clone, Debug, Default)]
pub(super) struct Description {
    gap_m: ByMagnet,
    directions: ByMagnet<ByAxis>,
    magnets: ByMagnet<ByAxis>,
    /// By forces along y and z in each plane of unbalance, and of each backward force.
    turning: [[ByAxis; 2]; PLANES],
    backward: [[ByAxis; 2]; PLANES],
    loads: ByAxis<ByAxis>,
    gyroscopic: ByAxis<ByAxis>,
    planes: usize,
}

impl Description {
    pub fn of<const N: usize, const K: usize, const U: usize>(machine: &Machine<N, K, U>) -> Self {
        let row = |j: usize| {
            let mut row = ByAxis::default();
            (0..N).for_each(|n| row[n] = machine.accelerations[(j, n)]);
            row
        };
        let planes = (machine.backward - K) / 2;
        let mut of = Self { planes, ..Self::default() };
        for k in 0..K {
            of.gap_m[k] = machine.geometry.gap_m[k];
            of.directions[k][..N].copy_from_slice(&machine.geometry.directions[k]);
            of.magnets[k] = row(k);
        }
        for p in 0..planes {
            of.turning[p] = [0, 1].map(|axis| row(K + 2 * p + axis));
        }
        for p in 0..(U - N - machine.backward) / 2 {
            of.backward[p] = [0, 1].map(|axis| row(machine.backward + 2 * p + axis));
        }
        for n in 0..N {
            of.loads[n] = row(U - N + n);
            if let Some(gyroscopic) = &machine.gyroscopic {
                (0..N).for_each(|l| of.gyroscopic[n][l] = gyroscopic[(n, l)]);
            }
        }
        of
    }

    /// `(more − less)/(2 step)`.
    fn derivative(mut more: Self, mut less: Self, step: f64) -> Self {
        more.values().zip(less.values()).for_each(|(more, less)| *more = (*more - *less) / (2.0 * step));
        more
    }

    fn values(&mut self) -> impl Iterator<Item = &mut f64> {
        let turning = self.turning.as_flattened_mut().iter_mut().chain(self.backward.as_flattened_mut());
        let magnets = self.directions.iter_mut().chain(&mut self.magnets).chain(turning);
        self.gap_m.iter_mut().chain(magnets.chain(&mut self.loads).chain(&mut self.gyroscopic).flatten())
    }
}

/// A kind of rotor: what the parameters of its bench do.
pub(super) struct Kind<'a> {
    pub part: &'a Part,
    /// Whether a slow force is estimated.
    pub slow_force: bool,
    /// Describes it with given values of its bench.
    pub describe: Describe<'a>,
    /// Parameters of the bench that change the description, with the steps of central differences.
    pub varied: Vec<(usize, f64)>,
    pub places: Places,
    pub layout: Layout,
    /// The filters of its sizes, without a slow force and with one.
    pub passes: [Passes; 2],
}

/// Describes a rotor with given values of its bench.
pub(super) type Describe<'a> = Box<dyn Fn(&[f64]) -> Description + Sync + 'a>;

/// One sample instant of the shaft.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shaft {
    pub cos: f64,
    pub sin: f64,
    /// ω, in 1/s.
    pub speed: f64,
    /// ω², in 1/s².
    pub square: f64,
    /// ω̇, in 1/s².
    pub rate: f64,
}

impl Shaft {
    /// Factors of U cos φ and U sin φ in the force of the unbalance, (y, z).
    fn unbalance(&self) -> [[f64; 2]; 2] {
        let (c, s, w, b) = (self.cos, self.sin, self.square, self.rate);
        [[w * c + b * s, w * s - b * c], [-w * s + b * c, w * c + b * s]]
    }
}

/// A rotor with given parameters.
#[derive(Clone, Debug)]
pub(super) struct Rotor {
    pub h: f64,
    /// Parameters of the recording, in SI units, by [`Layout`].
    theta: Vec<f64>,
    pub layout: Layout,
    pub places: Places,
    machine: Description,
    /// Its derivatives to parameters of the bench, by number.
    varied: Vec<(usize, Description)>,
    /// cos and sin of the rotation of each pair of position sensors.
    rotations: Vec<[f64; 2]>,
    /// Sensor offsets, m.
    offset: ByAxis,
    /// Sensor gains and rotation, row by row.
    pub sensor: ByAxis<ByAxis>,
    pub delay: f64,
    /// Offset and `1 + gain` of the readings of the currents.
    current: ByMagnet<[f64; 2]>,
    /// The currents, if they follow commands, and with a longer and a shorter lag.
    pub lag: Option<[Lag; 3]>,
    /// Standard deviation of the current noise, A.
    pub noise: f64,
    /// Level of a slow force as an acceleration, a random walk, m/s² after a second.
    pub slow: f64,
    /// Power of the gap with which the noise of the positions grows, and the nominal gap, m.
    pub exponent: f64,
    pub nominal_m: f64,
    /// Derivatives of the logarithm of the force noise `λ_k σ_i` of a magnet to the parameters: parameter, magnet, derivative.
    pub levels: Vec<(usize, usize, f64)>,
    /// The filter.
    pub passes: Passes,
}

/// One sample interval: `δ_k = F δ_{k−1} + offset + Σ_j Γ_j w_j` with stiffness and gyroscope in F, w of variance 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Interval<const N: usize, const K: usize> {
    /// `∂a/∂q` in the middle, in 1/s².
    pub stiffness: [[f64; N]; N],
    /// `∂a/∂q̇`, in 1/s; 0 unless the rotor tilts.
    pub gyroscopic: [[f64; N]; N],
    /// Prediction from the trajectory at the start, minus the trajectory at the end.
    pub offset: State<N>,
    /// Acceleration by one standard deviation of the noise of each current.
    pub noise: [[f64; N]; K],
    /// Acceleration at the end.
    pub end: [f64; N],
    /// Point in the middle, m, squared currents there, A², and the shaft.
    pub middle: State<N>,
    pub squares: [f64; K],
    pub shaft: Shaft,
}

/// Squared currents at start, middle, and end of an interval.
#[derive(Clone, Copy, Debug)]
pub(super) struct Squares<const K: usize> {
    pub start: [f64; K],
    pub middle: [f64; K],
    pub end: [f64; K],
    /// Standard deviations of those in the middle.
    pub std: [f64; K],
}

/// Forces (y, z) of unbalances by plane, and of backward forces by bearing, of which there are as many.
type Turning = [[[f64; 2]; PLANES]; 2];

/// `sum += factor · of`, as far as both go.
#[inline(always)]
fn add(sum: &mut [f64], factor: f64, of: &[f64]) {
    sum.iter_mut().zip(of).for_each(|(sum, of)| *sum += factor * of);
}

#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// `factor · of` of the first N.
#[inline(always)]
fn scaled<const N: usize>(of: &ByAxis, factor: f64) -> [f64; N] {
    std::array::from_fn(|n| of[n] * factor)
}

impl Rotor {
    /// With the noise and the slow force of a recording.
    pub fn new(kind: &Kind<'_>, theta: Vec<f64>, case: &Case<'_>) -> Self {
        let (layout, places) = (kind.layout, kind.places.clone());
        let bench = &theta[layout.base..];
        let varied = kind.varied.iter().map(|(at, step)| {
            let [more, less] = [*step, -*step].map(|change| {
                let mut bench = bench.to_vec();
                bench[*at] += change;
                (kind.describe)(&bench)
            });
            (*at, Description::derivative(more, less, *step))
        });
        let varied: Vec<(usize, Description)> = varied.collect();
        let machine = (kind.describe)(bench);
        let gain = |k: usize| 1.0 + bench[places.current_gain + k];
        let mut current = ByMagnet::default();
        let mut levels = Vec::new();
        for k in 0..layout.magnets {
            current[k] = [bench[places.current_offset + k], gain(k)];
            levels.push((k, k, 1.0 / theta[k]));
            levels.push((layout.base + places.current_gain + k, k, -2.0 / gain(k)));
            let pull = &machine.magnets[k];
            levels.extend(varied.iter().map(|(at, varied)| {
                let stronger = dot(&varied.magnets[k], pull) / dot(pull, pull);
                (layout.base + at, k, stronger - 2.0 * varied.gap_m[k] / machine.gap_m[k])
            }));
        }
        levels.retain(|(.., level)| *level != 0.0);
        let (mut sensor, mut offset) = (ByAxis::<ByAxis>::default(), ByAxis::default());
        (0..layout.loads()).for_each(|n| sensor[n][n] = 1.0);
        if let Some([of_offset, of_gain]) = places.single {
            sensor[0][0] += bench[of_gain];
            offset[0] = bench[of_offset];
        }
        let mut rotations = Vec::new();
        for (p, places) in places.pairs.iter().enumerate() {
            let (sin, cos) = libm::sincos(bench[places.rotation]);
            let (common, different) = (bench[places.gain], bench[places.gain_difference]);
            let gain = [1.0 + common + different, 1.0 + common - different];
            for (row, turned) in [[cos, -sin], [sin, cos]].into_iter().enumerate() {
                offset[2 * p + row] = bench[places.offset[row]];
                (0..2).for_each(|column| sensor[2 * p + row][2 * p + column] = gain[row] * turned[column]);
            }
            rotations.push([cos, sin]);
        }
        Self {
            h: case.recording.step_s,
            machine,
            varied,
            rotations,
            offset,
            sensor,
            delay: bench[places.delay],
            current,
            lag: places.lag.and_then(|at| Lag::of(case, bench[at])),
            noise: case.current_noise,
            slow: case.slow_force / kind.part.body.m_kg(),
            exponent: case.exponent,
            nominal_m: kind.part.body.gap_m(),
            levels,
            passes: kind.passes[usize::from(case.slow_force > 0.0)],
            layout,
            places,
            theta,
        }
    }

    /// A parameter of the bench, by its number.
    #[inline(always)]
    fn bench(&self, at: usize) -> f64 {
        self.theta[self.layout.base + at]
    }

    /// Squared currents, A², free of the σ² that noise adds on average. `before` is the reading a sample earlier of a current that
    /// is continuous.
    #[inline(always)]
    pub fn squares<const K: usize>(&self, read: [f64; K], before: Option<[f64; K]>) -> Squares<K> {
        let current = |k: usize, read: f64| (read - self.current[k][0]) / self.current[k][1];
        let variance: [f64; K] = std::array::from_fn(|k| {
            let gain = self.current[k][1];
            self.noise * self.noise / (gain * gain)
        });
        let end: [f64; K] = std::array::from_fn(|k| current(k, read[k]));
        let start: [f64; K] = match before {
            None => end,
            Some(before) => std::array::from_fn(|k| current(k, before[k])),
        };
        // The noise of a mean of two has half the variance.
        let part = if before.is_some() { 0.5 } else { 1.0 };
        let square = |i: f64, variance: f64| i * i - variance;
        let middle = std::array::from_fn(|k| square(0.5 * (start[k] + end[k]), part * variance[k]));
        Squares {
            start: std::array::from_fn(|k| square(start[k], variance[k])),
            middle,
            end: std::array::from_fn(|k| square(end[k], variance[k])),
            // Var (i + n)² = 4 i² σ² + 2 σ⁴.
            std: std::array::from_fn(|k| ((4.0 * middle[k].max(0.0) + 2.0 * variance[k]) * variance[k]).sqrt()),
        }
    }

    /// The same of currents that follow commands: parabolas with the moments of their squares.
    #[inline(always)]
    pub fn following<const K: usize>(&self, lag: &Lag, command: [f64; K], row: usize) -> Squares<K> {
        let mut squares = self.squares(command, None);
        for k in 0..K {
            let [offset, gain] = self.current[k];
            let [command, start] = [command[k], lag.start_a(row, k)].map(|read| (read - offset) / gain);
            let [mean, early] = lag.squares(command, start);
            let noise = self.noise * self.noise / (gain * gain);
            squares.start[k] = 6.0 * early - 2.0 * mean - noise;
            squares.middle[k] = mean - noise;
            squares.end[k] = 4.0 * mean - 6.0 * early - noise;
        }
        squares
    }

    /// Adds the acceleration by the magnets, with given gaps and squared currents, A².
    #[inline(always)]
    pub fn add_pulls<const N: usize, const K: usize>(&self, sum: &mut [f64; N], gaps: [f64; K], squares: [f64; K]) {
        for k in 0..K {
            add(sum, self.theta[k] * squares[k] / (gaps[k] * gaps[k]), &self.machine.magnets[k]);
        }
    }

    /// Gaps at a point, the iron path included, m.
    #[inline(always)]
    pub fn gaps<const N: usize, const K: usize>(&self, at: &[f64; N]) -> [f64; K] {
        std::array::from_fn(|k| self.machine.gap_m[k] - dot(&self.machine.directions[k], at))
    }

    #[inline(always)]
    fn turning(&self, shaft: &Shaft) -> Turning {
        let [by_cos, by_sin] = shaft.unbalance();
        let mut turning = [[[0.0; 2]; PLANES]; 2];
        for p in 0..self.machine.planes {
            let at = self.layout.magnets + 2 * p;
            let (u_c, u_s) = (self.theta[at], self.theta[at + 1]);
            turning[0][p] = [0, 1].map(|a| u_c * by_cos[a] + u_s * by_sin[a]);
            let [b_c, b_s] = self.places.backward.map(|first| self.bench(first + p));
            turning[1][p] = [b_c * shaft.cos + b_s * shaft.sin, b_s * shaft.cos - b_c * shaft.sin];
        }
        turning
    }

    /// Acceleration that a description makes of all forces but those of the magnets, and of the speeds.
    #[inline(always)]
    fn external<const N: usize>(
        &self,
        of: &Description,
        turning: &Turning,
        shaft: &Shaft,
        rate: &[f64; N],
    ) -> [f64; N] {
        let mut sum = [0.0; N];
        for n in 0..N {
            add(&mut sum, self.theta[self.layout.load + n], &of.loads[n]);
        }
        for p in 0..self.machine.planes {
            for axis in 0..2 {
                add(&mut sum, turning[0][p][axis], &of.turning[p][axis]);
                add(&mut sum, turning[1][p][axis], &of.backward[p][axis]);
            }
        }
        if N > 2 {
            for n in 0..N {
                sum[n] += shaft.speed * dot(&of.gyroscopic[n], rate);
            }
        }
        sum
    }

    #[inline(always)]
    fn acceleration<const N: usize, const K: usize>(
        &self,
        gaps: [f64; K],
        squares: [f64; K],
        shaft: &Shaft,
        rate: &[f64; N],
    ) -> [f64; N] {
        let mut sum = self.external(&self.machine, &self.turning(shaft), shaft, rate);
        self.add_pulls(&mut sum, gaps, squares);
        sum
    }

    /// The interval between two points of the trajectory. The stiffness is that of the expected `i_k²/gap_k²`, once they are known: in that of the measured
    /// ones, noise of the currents would meet itself in the innovations, and bias the scores of all that hardly moves the rotor (an offset by 20 standard
    /// deviations after 5 s, with 12 nm and 41 mA).
    pub fn interval<const N: usize, const K: usize>(
        &self,
        [from, to]: [&State<N>; 2],
        squares: &Squares<K>,
        expected: Option<[f64; K]>,
        [at_start, at_middle, at_end]: [Shaft; 3],
    ) -> Interval<N, K> {
        let h = self.h;
        // The cubic through both points and both velocities.
        let middle: State<N> = [
            std::array::from_fn(|a| 0.5 * (from[0][a] + to[0][a]) + h / 8.0 * (from[1][a] - to[1][a])),
            std::array::from_fn(|a| 1.5 / h * (to[0][a] - from[0][a]) - 0.25 * (from[1][a] + to[1][a])),
        ];
        let gaps = self.gaps(&middle[0]);
        let a_0 = self.acceleration(self.gaps(&from[0]), squares.start, &at_start, &from[1]);
        let a_m = self.acceleration(gaps, squares.middle, &at_middle, &middle[1]);
        let a_1 = self.acceleration(self.gaps(&to[0]), squares.end, &at_end, &to[1]);
        let offset = [
            std::array::from_fn(|a| from[0][a] + h * from[1][a] + h * h / 6.0 * (a_0[a] + 2.0 * a_m[a]) - to[0][a]),
            std::array::from_fn(|a| from[1][a] + h / 6.0 * (a_0[a] + 4.0 * a_m[a] + a_1[a]) - to[1][a]),
        ];
        let gyroscopic = std::array::from_fn(|a| scaled(&self.machine.gyroscopic[a], at_middle.speed));
        let (mut stiffness, mut noise) = ([[0.0; N]; N], [[0.0; N]; K]);
        let expected = expected.unwrap_or_else(|| regressors(gaps, squares.middle));
        for k in 0..K {
            let by_noise = self.theta[k] / (gaps[k] * gaps[k]) * squares.std[k];
            noise[k] = scaled(&self.machine.magnets[k], by_noise);
            let stiff = 2.0 * self.theta[k] * expected[k] / gaps[k];
            for a in 0..N {
                add(&mut stiffness[a], stiff * self.machine.magnets[k][a], &self.machine.directions[k]);
            }
        }
        Interval { stiffness, gyroscopic, offset, noise, end: a_1, middle, squares: squares.middle, shaft: at_middle }
    }

    /// `∂a/∂θ` for given `i_k²/gap_k²` at a point, by parameter, those of the bench as well if asked for, and after all parameters once more those of λ and κ, for the measured ones.
    ///
    /// The point is where the filter predicts the rotor, not on the smoothed trajectory: that one knows the innovations to come, and with the
    /// negative stiffness their product has an expectation (the derivative of ln det S, for a rotor held by feedback).
    pub fn force_columns<const N: usize, const K: usize>(
        &self,
        [at, rate]: &State<N>,
        regressors: [f64; K],
        measured: [f64; K],
        shaft: &Shaft,
        bench: bool,
        d: &mut Sheet<N>,
    ) {
        let (layout, places, machine) = (&self.layout, &self.places, &self.machine);
        let gaps: [f64; K] = self.gaps(at);
        let (mut pulls, mut by_gap) = ([0.0; K], [0.0; K]);
        for k in 0..K {
            let acceleration = &machine.magnets[k];
            d.put(k, scaled(acceleration, regressors[k]));
            pulls[k] = self.theta[k] * regressors[k];
            by_gap[k] = -2.0 * pulls[k] / gaps[k];
            if bench {
                if let Some(at) = layout.measured(k) {
                    d.put(at, scaled(acceleration, measured[k]));
                }
                let gain = self.current[k][1];
                let by_offset = -2.0 * self.theta[k] * regressors[k].max(0.0).sqrt() / gaps[k] / gain;
                d.put(layout.base + places.current_offset + k, scaled(acceleration, by_offset));
                d.put(layout.base + places.current_gain + k, scaled(acceleration, -2.0 * pulls[k] / gain));
            }
        }
        let [by_cos, by_sin] = shaft.unbalance();
        let turned = |[y, z]: &[ByAxis; 2], by: [f64; 2]| std::array::from_fn(|n| y[n] * by[0] + z[n] * by[1]);
        for p in 0..machine.planes {
            d.put(layout.magnets + 2 * p, turned(&machine.turning[p], by_cos));
            d.put(layout.magnets + 2 * p + 1, turned(&machine.turning[p], by_sin));
            if bench {
                let [cos, sin] = places.backward.map(|first| layout.base + first + p);
                d.put(cos, turned(&machine.backward[p], [shaft.cos, -shaft.sin]));
                d.put(sin, turned(&machine.backward[p], [shaft.sin, shaft.cos]));
            }
        }
        (0..N).for_each(|n| d.put(layout.load + n, scaled(&machine.loads[n], 1.0)));
        if !bench {
            return;
        }
        let turning = self.turning(shaft);
        for (j, varied) in &self.varied {
            let mut column: [f64; N] = self.external(varied, &turning, shaft, rate);
            if let Some(place) = layout.measured(layout.base + j) {
                let mut column = column;
                (0..K).for_each(|k| add(&mut column, self.theta[k] * measured[k], &varied.magnets[k]));
                d.put(place, column);
            }
            for k in 0..K {
                add(&mut column, pulls[k], &varied.magnets[k]);
                let wider = varied.gap_m[k] - dot(&varied.directions[k], at);
                add(&mut column, by_gap[k] * wider, &machine.magnets[k]);
            }
            d.put(layout.base + j, column);
        }
    }

    /// Where the sensors look, with their run-out, before gains and rotation.
    #[inline(always)]
    fn seen<const N: usize>(&self, [at, rate]: &State<N>, acceleration: &[f64; N], shaft: &Shaft) -> [f64; N] {
        let (c, s) = (shaft.cos, shaft.sin);
        let (c_2, s_2) = (c * c - s * s, 2.0 * c * s);
        let mut seen: [f64; N] =
            std::array::from_fn(|a| at[a] - self.delay * (rate[a] - 0.5 * self.delay * acceleration[a]));
        for (seen, places) in seen.chunks_exact_mut(2).zip(&self.places.pairs) {
            let r = places.runout.map(|at| self.bench(at));
            seen[0] += (r[0] + r[2]) * c + (r[3] - r[1]) * s + r[4] * c_2 + r[5] * s_2;
            seen[1] += (r[0] - r[2]) * s + (r[1] + r[3]) * c + r[6] * c_2 + r[7] * s_2;
        }
        seen
    }

    /// Readings of the position sensors at a point of the trajectory, m.
    #[inline(always)]
    pub fn reading<const N: usize>(&self, at: &State<N>, acceleration: &[f64; N], shaft: &Shaft) -> [f64; N] {
        let seen = self.seen(at, acceleration, shaft);
        std::array::from_fn(|a| dot(&self.sensor[a], &seen) + self.offset[a])
    }

    /// `∂reading/∂θ` at a fixed trajectory, for all but the parameters of the force, whose columns stay as they are.
    pub fn sensor_columns<const N: usize>(
        &self,
        at: &State<N>,
        acceleration: &[f64; N],
        shaft: &Shaft,
        d: &mut Sheet<N>,
    ) {
        let (c, s) = (shaft.cos, shaft.sin);
        let (c_2, s_2) = (c * c - s * s, 2.0 * c * s);
        let base = self.layout.base;
        let seen = self.seen(at, acceleration, shaft);
        let late: [f64; N] = std::array::from_fn(|a| self.delay * acceleration[a] - at[1][a]);
        d.put(base + self.places.delay, std::array::from_fn(|n| dot(&self.sensor[n], &late)));
        if let Some([offset, gain]) = self.places.single {
            d.set(0, base + offset, 1.0);
            d.set(0, base + gain, seen[0]);
        }
        for (p, (places, [r_c, r_s])) in self.places.pairs.iter().zip(&self.rotations).enumerate() {
            let first = 2 * p;
            let mut put = |j: usize, y: f64, z: f64| {
                d.set(first, base + j, y);
                d.set(first + 1, base + j, z);
            };
            put(places.offset[0], 1.0, 0.0);
            put(places.offset[1], 0.0, 1.0);
            let [y, z] = [seen[first], seen[first + 1]];
            let turned = [r_c * y - r_s * z, r_s * y + r_c * z];
            put(places.gain, turned[0], turned[1]);
            put(places.gain_difference, turned[0], -turned[1]);
            let (common, different) = (1.0 + self.bench(places.gain), self.bench(places.gain_difference));
            put(places.rotation, -(common + different) * turned[1], (common - different) * turned[0]);
            let m = [0, 1].map(|row| [self.sensor[first + row][first], self.sensor[first + row][first + 1]]);
            let runouts = [[c, s], [-s, c], [c, -s], [s, c], [c_2, 0.0], [s_2, 0.0], [0.0, c_2], [0.0, s_2]];
            for (part, [y, z]) in runouts.into_iter().enumerate() {
                put(places.runout[part], m[0][0] * y + m[0][1] * z, m[1][0] * y + m[1][1] * z);
            }
        }
    }
}

/// `i_k²/gap_k²`, A²/m².
#[inline(always)]
pub(super) fn regressors<const K: usize>(gaps: [f64; K], squares: [f64; K]) -> [f64; K] {
    std::array::from_fn(|k| squares[k] / (gaps[k] * gaps[k]))
}
