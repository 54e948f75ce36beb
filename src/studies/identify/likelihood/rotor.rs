//! Equations of motion over one sample interval, linearised about a trajectory, and of the sensors, with their derivatives with respect to all parameters.
//!
//! Rotor and magnets are those of the on-line estimator ([`Machine`]): N coordinates read by the sensors, K magnets, accelerations by
//! unit forces. The derivative with respect to a bearing parameter is the difference of two such descriptions. Descriptions have room for the largest
//! machine; code that runs at every sample knows N and K.

#![allow(clippy::needless_range_loop, reason = "several arrays go by one index")]

use super::bench::Places;
use super::case::Case;
use super::filter::{ColumnValues, Passes};
use super::kalman::Transition;
use super::lag::Lag;
use super::{Options, Part};
use crate::bearing::{RotorConfig, array};
use crate::estimation::Machine;
use crate::plant::PLANES;

/// Step of central differences, in typical tolerances: the truncation error is below 10⁻⁸ of a derivative.
const STEP: f64 = 1e-3;

/// A value for each coordinate, and for each magnet, with room for the largest machine.
pub(super) type ByAxis<T = f64> = [T; 4];
pub(super) type ByMagnet<T = f64> = [T; 8];

/// Coordinates in m and their rates in m/s.
pub(super) type State<const N: usize> = [[f64; N]; 2];

/// Coordinates, their rates and accelerations, m, m/s and m/s².
pub(super) type Moving<const N: usize> = [[f64; N]; 3];

/// Indices of the parameters of one recording: λ, U cos φ and U sin φ of each plane, loads, then the bench.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    /// Number of magnets, and index of the first unbalance.
    pub magnets: usize,
    /// Index of the first load.
    pub load: usize,
    /// Index of the first parameter that every recording has for itself: its loads, and before them the unbalance if the angles of several recordings
    /// count from different positions of the shaft. Among the unknowns of all recordings the bench begins here.
    pub own: usize,
    /// Index of the first bench parameter.
    pub base: usize,
    /// Number of parameters.
    pub all: usize,
    /// Index of κ, if it is a parameter.
    pub dynamics: Option<usize>,
    /// Whether the currents are commands, which are free of noise and need no instruments.
    pub commands: bool,
}

impl Layout {
    /// Number of loads, one for each coordinate.
    pub fn loads(&self) -> usize {
        self.base - self.load
    }

    /// Number of parameters that every recording has for itself.
    pub fn owned(&self) -> usize {
        self.base - self.own
    }

    /// Number of unknowns common to all recordings: λ, U, then the bench.
    pub fn shared(&self) -> usize {
        self.all - self.owned()
    }

    /// Number of unknowns of this number of recordings.
    pub fn unknowns(&self, recordings: usize) -> usize {
        self.shared() + self.owned() * recordings
    }

    /// Column of the measured sensitivity to a parameter, after those of all parameters: λ and κ have one, since noise of the currents biases their scores.
    pub fn measured(&self, j: usize) -> Option<usize> {
        if self.commands {
            None
        } else if j < self.magnets {
            Some(self.all + j)
        } else {
            self.dynamics.filter(|dynamics| *dynamics == j).map(|_| self.all + self.magnets)
        }
    }

    /// Number of columns, including the measured sensitivities.
    pub fn columns(&self) -> usize {
        self.all + if self.commands { 0 } else { self.magnets + usize::from(self.dynamics.is_some()) }
    }

    /// Index of the unknown for parameter `j` of recording `r`: λ, U, bench, then what each recording has for itself.
    pub fn unknown(&self, j: usize, r: usize) -> usize {
        if j < self.own {
            j
        } else if j < self.base {
            self.shared() + self.owned() * r + (j - self.own)
        } else {
            j - self.owned()
        }
    }
}

/// Response of a rotor to forces and motions: gaps in m, directions and accelerations per N, as in [`Machine`].
#[derive(Clone, Debug, Default)]
pub(super) struct Description {
    gap_m: ByMagnet,
    directions: ByMagnet<ByAxis>,
    magnets: ByMagnet<ByAxis>,
    /// By [`Forces`].
    others: [ByAxis; FORCES],
    gyroscopic: ByAxis<ByAxis>,
}

impl Description {
    /// With U unknowns of the on-line estimator.
    pub fn of<const N: usize, const K: usize, const U: usize>(
        rotor: &RotorConfig<f64, 2>,
        planes_m: [f64; PLANES],
    ) -> Self {
        let machine =
            Machine::<N, K, U>::of(rotor, planes_m).unwrap_or_else(|| unreachable!("sensors at different places"));
        let row = |j: usize| {
            let mut row = ByAxis::default();
            (0..N).for_each(|n| row[n] = machine.accelerations[(j, n)]);
            row
        };
        let mut of = Self::default();
        for k in 0..K {
            of.gap_m[k] = machine.geometry.gap_m[k];
            of.directions[k][..N].copy_from_slice(&machine.geometry.directions[k]);
            of.magnets[k] = row(k);
        }
        let rotating =
            (K..machine.backward).zip(machine.backward..).flat_map(|(unbalance, backward)| [unbalance, backward]);
        of.others.iter_mut().zip((U - N..U).chain(rotating)).for_each(|(of, j)| *of = row(j));
        for (n, l) in (0..N).flat_map(|n| (0..N).map(move |l| (n, l))) {
            of.gyroscopic[n][l] = machine.gyroscopic.as_ref().map_or(0.0, |gyroscopic| gyroscopic[(n, l)]);
        }
        of
    }

    /// `(more − less)/(2 step)`.
    fn derivative(mut more: Self, mut less: Self, step: f64) -> Self {
        more.values().zip(less.values()).for_each(|(more, less)| *more = (*more - *less) / (2.0 * step));
        more
    }

    fn values(&mut self) -> impl Iterator<Item = &mut f64> {
        let rows = self.directions.iter_mut().chain(&mut self.magnets).chain(&mut self.others);
        self.gap_m.iter_mut().chain(rows.chain(&mut self.gyroscopic).flatten())
    }
}

/// Model of a rotor: effects of its bench parameters.
pub(super) struct Model<'a> {
    pub part: &'a Part,
    pub options: &'a Options,
    pub places: Places,
    pub layout: Layout,
    /// Filters of its sizes, without and with a slow force.
    pub passes: [Passes; 2],
}

impl Model<'_> {
    /// The rotor for given values of its bench.
    fn describe(&self, bench: &[f64]) -> Description {
        let error = |at: Option<usize>| at.map_or(0.0, |at| bench[at]);
        let (mut rotor, mut planes_m) = (self.part.body.rotor, self.part.body.planes_m);
        let [heavier, kappa] = [Some(self.places.mass), self.places.dynamics].map(|at| 1.0 + error(at));
        let [transverse, polar, of_planes @ ..] = self.places.shaft.map(error);
        rotor.shaft.m_kg = rotor.shaft.m_kg * heavier * kappa;
        rotor.shaft.transverse_kgm2 *= heavier * kappa * (1.0 + transverse);
        rotor.shaft.polar_kgm2 *= heavier * kappa * (1.0 + polar);
        planes_m.iter_mut().zip(of_planes).for_each(|(at_m, error_m)| *at_m += error_m);
        for (bearing, of) in rotor.bearings.iter_mut().zip(&self.places.bearings) {
            let [gap, iron_m, magnets_m, sensors_m, of_alpha @ ..] = of.map(error);
            bearing.gap_m = bearing.gap_m * (1.0 + gap) + iron_m;
            bearing.position_m += magnets_m;
            bearing.sensor_position_m += sensors_m;
            bearing.alpha_rad.iter_mut().zip(of_alpha).for_each(|(alpha_rad, error_rad)| *alpha_rad += error_rad);
        }
        (self.passes[0].describe)(&rotor, planes_m)
    }

    /// Bench parameters that change the description.
    fn varied(&self) -> impl Iterator<Item = usize> {
        let Places { mass, dynamics, shaft, bearings, .. } = &self.places;
        let of_body = [Some(*mass), *dynamics].into_iter().chain(*shaft);
        of_body.chain(bearings.as_flattened().iter().copied()).flatten()
    }
}

/// The shaft at one sample instant.
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
    /// Factors of U cos φ and U sin φ in the unbalance force (y, z).
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
    /// Derivatives of the description with respect to bench parameters, by index.
    varied: Vec<(usize, Description)>,
    /// sin and cos of the rotation of each sensor of each pair.
    rotations: Vec<[(f64, f64); 2]>,
    /// Sensor offsets, m.
    offset: ByAxis,
    /// Sensor gains and rotation, row by row.
    pub sensor: ByAxis<ByAxis>,
    pub delay: f64,
    /// Offset and `1 + gain` of the readings of the currents.
    current: ByMagnet<[f64; 2]>,
    /// Currents if they lag behind commands, also for a longer and a shorter lag.
    pub lag: Option<[Lag; 3]>,
    /// Standard deviation of the current noise, A.
    pub noise: f64,
    /// Level of the slow force as an acceleration, a random walk, m/s² after one second.
    pub slow: f64,
    /// Nominal gap, m.
    pub nominal_m: f64,
    /// Derivatives of the logarithm of the force noise `λ_k σ_i` of a magnet with respect to parameters: parameter, magnet, derivative.
    pub levels: Vec<(usize, usize, f64)>,
    /// Filter passes.
    pub passes: Passes,
}

/// One sample interval: `δ_k = F δ_{k−1} + offset + Σ_j Γ_j w_j` with stiffness and gyroscopic matrix in F, w of variance 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Interval<const N: usize, const K: usize> {
    /// F minus identity.
    pub transition: Transition<N>,
    /// `∂a/∂q̇`, in 1/s; 0 unless the rotor tilts.
    pub gyroscopic: [[f64; N]; N],
    /// Prediction from the trajectory at the start, minus the trajectory at the end.
    pub offset: State<N>,
    /// Acceleration by one standard deviation of the noise of each current.
    pub noise: [[f64; N]; K],
    /// Acceleration at the end.
    pub end: [f64; N],
    /// State at the midpoint, m and m/s, squared currents there, A², and the shaft.
    pub middle: State<N>,
    pub squares: [f64; K],
    pub shaft: Shaft,
}

/// Squared currents at start, midpoint and end of an interval.
#[derive(Clone, Copy, Debug)]
pub(super) struct Squares<const K: usize> {
    pub start: [f64; K],
    pub middle: [f64; K],
    pub end: [f64; K],
    /// Standard deviations of those at the midpoint.
    pub std: [f64; K],
}

/// Forces other than those of the magnets: N loads, then along y and z in each plane of unbalance that of the unbalance and the backward one of a
/// bearing; there are as many bearings as planes, N/2.
type Forces = [f64; FORCES];
const FORCES: usize = 4 + 4 * PLANES;

/// `sum += factor · of`, up to the shorter length.
#[inline(always)]
fn add(sum: &mut [f64], factor: f64, of: &[f64]) {
    sum.iter_mut().zip(of).for_each(|(sum, of)| *sum += factor * of);
}

#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// `factor · of`, first N values.
#[inline(always)]
fn scaled<const N: usize>(of: &ByAxis, factor: f64) -> [f64; N] {
    array::from_fn(|n| of[n] * factor)
}

/// Acceleration by all forces except those of the magnets, and by gyroscopic effect, in a given description.
#[inline(always)]
fn external<const N: usize>(of: &Description, forces: &Forces, shaft: &Shaft, rate: &[f64; N]) -> [f64; N] {
    let mut sum = [0.0; N];
    for j in 0..N + 4 * (N / 2) {
        add(&mut sum, forces[j], &of.others[j]);
    }
    if N > 2 {
        for n in 0..N {
            sum[n] += shaft.speed * dot(&of.gyroscopic[n], rate);
        }
    }
    sum
}

impl Rotor {
    /// Rotor with the noise and the slow force of a recording.
    pub fn new(model: &Model<'_>, theta: Vec<f64>, case: &Case<'_>) -> Self {
        let (layout, places) = (model.layout, model.places.clone());
        let bench = &theta[layout.base..];
        let varied = model.varied().map(|at| {
            let step = STEP * model.part.parameters[at].typical;
            let [more, less] = [step, -step].map(|change| {
                let mut bench = bench.to_vec();
                bench[at] += change;
                model.describe(&bench)
            });
            (at, Description::derivative(more, less, step))
        });
        let varied: Vec<(usize, Description)> = varied.collect();
        let machine = model.describe(bench);
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
            let [skew, rotation] = [places.skew, places.rotation].map(|at| bench[at]);
            let turned = [rotation - skew, rotation + skew].map(libm::sincos);
            let [(s_y, c_y), (s_z, c_z)] = turned;
            let (common, different) = (bench[places.gain], bench[places.gain_difference]);
            let gain = [1.0 + common + different, 1.0 + common - different];
            for (row, rotated) in [[c_y, -s_y], [s_z, c_z]].into_iter().enumerate() {
                offset[2 * p + row] = bench[places.offset[row]];
                (0..2).for_each(|column| sensor[2 * p + row][2 * p + column] = gain[row] * rotated[column]);
            }
            rotations.push(turned);
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
            slow: case.slow_force / model.part.body.m_kg(),
            nominal_m: model.part.body.gap_m(),
            levels,
            passes: model.passes[usize::from(case.slow_force > 0.0)],
            layout,
            places,
            theta,
        }
    }

    /// A bench parameter by index.
    #[inline(always)]
    fn bench(&self, at: usize) -> f64 {
        self.theta[self.layout.base + at]
    }

    /// Squared currents, A², minus the σ² that noise adds on average. `before` is the previous reading of a continuous current.
    #[inline(always)]
    pub fn squares<const K: usize>(&self, read: [f64; K], before: Option<[f64; K]>) -> Squares<K> {
        let current = |k: usize, read: f64| (read - self.current[k][0]) / self.current[k][1];
        let variance: [f64; K] = array::from_fn(|k| {
            let gain = self.current[k][1];
            self.noise * self.noise / (gain * gain)
        });
        let end: [f64; K] = array::from_fn(|k| current(k, read[k]));
        let start: [f64; K] = match before {
            None => end,
            Some(before) => array::from_fn(|k| current(k, before[k])),
        };
        // The mean of two readings has half the noise variance.
        let part = if before.is_some() { 0.5 } else { 1.0 };
        let square = |i: f64, variance: f64| i * i - variance;
        let middle = array::from_fn(|k| square(0.5 * (start[k] + end[k]), part * variance[k]));
        Squares {
            start: array::from_fn(|k| square(start[k], variance[k])),
            middle,
            end: array::from_fn(|k| square(end[k], variance[k])),
            // Var (i + n)² = 4 i² σ² + 2 σ⁴.
            std: array::from_fn(|k| ((4.0 * middle[k].max(0.0) + 2.0 * variance[k]) * variance[k]).sqrt()),
        }
    }

    /// The same for currents that lag behind commands: parabolas with the moments of their squares.
    #[inline(always)]
    pub fn lagged_squares<const K: usize>(&self, lag: &Lag, command: [f64; K], row: usize) -> Squares<K> {
        let mut squares = self.squares(command, None);
        for k in 0..K {
            let [offset, gain] = self.current[k];
            let [command, start] = array::map([command[k], lag.start_a(row, k)], |read| (read - offset) / gain);
            let [mean, early] = lag.squares(command, start);
            let noise = self.noise * self.noise / (gain * gain);
            squares.start[k] = 6.0 * early - 2.0 * mean - noise;
            squares.middle[k] = mean - noise;
            squares.end[k] = 4.0 * mean - 6.0 * early - noise;
        }
        squares
    }

    /// Adds the acceleration by the magnets for given gaps and squared currents, A².
    #[inline(always)]
    pub fn add_pulls<const N: usize, const K: usize>(&self, sum: &mut [f64; N], gaps: [f64; K], squares: [f64; K]) {
        for k in 0..K {
            add(sum, self.theta[k] * squares[k] / (gaps[k] * gaps[k]), &self.machine.magnets[k]);
        }
    }

    /// Gaps at a point, iron path included, m.
    #[inline(always)]
    pub fn gaps<const N: usize, const K: usize>(&self, at: &[f64; N]) -> [f64; K] {
        array::from_fn(|k| self.machine.gap_m[k] - dot(&self.machine.directions[k], at))
    }

    #[inline(always)]
    fn forces<const N: usize>(&self, shaft: &Shaft) -> Forces {
        let [by_cos, by_sin] = shaft.unbalance();
        let mut forces = [0.0; FORCES];
        forces[..N].copy_from_slice(&self.theta[self.layout.load..][..N]);
        for p in 0..N / 2 {
            let at = self.layout.magnets + 2 * p;
            let (u_c, u_s) = (self.theta[at], self.theta[at + 1]);
            let [b_c, b_s] = array::map(self.places.backward, |first| self.bench(first + p));
            let backward = [b_c * shaft.cos + b_s * shaft.sin, b_s * shaft.cos - b_c * shaft.sin];
            for a in 0..2 {
                let of = [u_c * by_cos[a] + u_s * by_sin[a], backward[a]];
                forces[N + 4 * p + 2 * a..][..2].copy_from_slice(&of);
            }
        }
        forces
    }

    #[inline(always)]
    fn acceleration<const N: usize, const K: usize>(
        &self,
        at: &State<N>,
        squares: [f64; K],
        shaft: &Shaft,
    ) -> [f64; N] {
        let mut sum = external(&self.machine, &self.forces::<N>(shaft), shaft, &at[1]);
        self.add_pulls(&mut sum, self.gaps(&at[0]), squares);
        sum
    }

    /// The interval between two points of the trajectory. Its stiffness uses the expected `i_k²/gap_k²` once they are known: with the measured ones,
    /// current noise would be correlated with itself in the innovations and bias the scores of parameters that hardly move the rotor (an offset by 20
    /// standard deviations after 5 s, with 12 nm and 41 mA).
    pub fn interval<const N: usize, const K: usize>(
        &self,
        [from, to]: [&State<N>; 2],
        squares: &Squares<K>,
        expected: Option<[f64; K]>,
        [at_start, at_middle, at_end]: [Shaft; 3],
    ) -> Interval<N, K> {
        let h = self.h;
        // Cubic through both points and both velocities.
        let middle: State<N> = [
            array::from_fn(|a| 0.5 * (from[0][a] + to[0][a]) + h / 8.0 * (from[1][a] - to[1][a])),
            array::from_fn(|a| 1.5 / h * (to[0][a] - from[0][a]) - 0.25 * (from[1][a] + to[1][a])),
        ];
        let gaps = self.gaps(&middle[0]);
        let a_0 = self.acceleration(from, squares.start, &at_start);
        let a_m = self.acceleration(&middle, squares.middle, &at_middle);
        let a_1 = self.acceleration(to, squares.end, &at_end);
        let offset = [
            array::from_fn(|a| from[0][a] + h * from[1][a] + h * h / 6.0 * (a_0[a] + 2.0 * a_m[a]) - to[0][a]),
            array::from_fn(|a| from[1][a] + h / 6.0 * (a_0[a] + 4.0 * a_m[a] + a_1[a]) - to[1][a]),
        ];
        let gyroscopic = array::from_fn(|a| scaled(&self.machine.gyroscopic[a], at_middle.speed));
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
        Interval {
            transition: Transition::of(h, &stiffness, &gyroscopic),
            gyroscopic,
            offset,
            noise,
            end: a_1,
            middle,
            squares: squares.middle,
            shaft: at_middle,
        }
    }

    /// `∂a/∂θ` for given `i_k²/gap_k²` at a point, by parameter, including the bench if requested; after all parameters the measured sensitivities of λ and κ.
    ///
    /// The point is where the filter predicts the rotor, not on the smoothed trajectory, which depends on later innovations: with the
    /// negative stiffness their product has a non-zero expectation (the derivative of ln det S, for a rotor held by feedback).
    pub fn force_columns<const N: usize, const K: usize>(
        &self,
        [at, rate]: &State<N>,
        regressors: [f64; K],
        measured: [f64; K],
        shaft: &Shaft,
        bench: bool,
        d: &mut ColumnValues<N>,
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
        for p in 0..N / 2 {
            let (unbalance, backward) = (N + 4 * p, N + 4 * p + 1);
            let combined = |at: usize, by: [f64; 2]| {
                array::from_fn(|n| machine.others[at][n] * by[0] + machine.others[at + 2][n] * by[1])
            };
            d.put(layout.magnets + 2 * p, combined(unbalance, by_cos));
            d.put(layout.magnets + 2 * p + 1, combined(unbalance, by_sin));
            if bench {
                let [cos, sin] = array::map(places.backward, |first| layout.base + first + p);
                d.put(cos, combined(backward, [shaft.cos, -shaft.sin]));
                d.put(sin, combined(backward, [shaft.sin, shaft.cos]));
            }
        }
        (0..N).for_each(|n| d.put(layout.load + n, scaled(&machine.others[n], 1.0)));
        if !bench {
            return;
        }
        let forces = self.forces::<N>(shaft);
        for (j, varied) in &self.varied {
            let mut column: [f64; N] = external(varied, &forces, shaft, rate);
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

    /// Position at the sensors with their run-out, before gains and rotation.
    #[inline(always)]
    fn sensed<const N: usize>(&self, [at, rate, acceleration]: &Moving<N>, shaft: &Shaft) -> [f64; N] {
        let (c, s) = (shaft.cos, shaft.sin);
        let (c_2, s_2) = (c * c - s * s, 2.0 * c * s);
        let mut sensed: [f64; N] =
            array::from_fn(|a| at[a] - self.delay * (rate[a] - 0.5 * self.delay * acceleration[a]));
        for (sensed, places) in sensed.chunks_exact_mut(2).zip(&self.places.pairs) {
            let r = array::map(places.runout, |at| self.bench(at));
            sensed[0] += (r[0] + r[2]) * c + (r[3] - r[1]) * s + r[4] * c_2 + r[5] * s_2;
            sensed[1] += (r[0] - r[2]) * s + (r[1] + r[3]) * c + r[6] * c_2 + r[7] * s_2;
        }
        sensed
    }

    /// Readings of the position sensors at a point of the trajectory, m.
    #[inline(always)]
    pub fn reading<const N: usize>(&self, at: &Moving<N>, shaft: &Shaft) -> [f64; N] {
        let sensed = self.sensed(at, shaft);
        array::from_fn(|a| dot(&self.sensor[a], &sensed) + self.offset[a])
    }

    /// `∂reading/∂θ` at a fixed trajectory; columns of force parameters stay unchanged.
    pub fn sensor_columns<const N: usize>(&self, at: &Moving<N>, shaft: &Shaft, d: &mut ColumnValues<N>) {
        let (c, s) = (shaft.cos, shaft.sin);
        let (c_2, s_2) = (c * c - s * s, 2.0 * c * s);
        let base = self.layout.base;
        let sensed = self.sensed(at, shaft);
        let by_delay: [f64; N] = array::from_fn(|a| self.delay * at[2][a] - at[1][a]);
        d.put(base + self.places.delay, array::from_fn(|n| dot(&self.sensor[n], &by_delay)));
        if let Some([offset, gain]) = self.places.single {
            d.set(0, base + offset, 1.0);
            d.set(0, base + gain, sensed[0]);
        }
        for (p, (places, [(s_y, c_y), (s_z, c_z)])) in self.places.pairs.iter().zip(&self.rotations).enumerate() {
            let first = 2 * p;
            let mut put = |j: usize, y: f64, z: f64| {
                d.set(first, base + j, y);
                d.set(first + 1, base + j, z);
            };
            put(places.offset[0], 1.0, 0.0);
            put(places.offset[1], 0.0, 1.0);
            let [y, z] = [sensed[first], sensed[first + 1]];
            let rotated = [c_y * y - s_y * z, s_z * y + c_z * z];
            put(places.gain, rotated[0], rotated[1]);
            put(places.gain_difference, rotated[0], -rotated[1]);
            let (common, different) = (1.0 + self.bench(places.gain), self.bench(places.gain_difference));
            let turned = [-(common + different) * (s_y * y + c_y * z), (common - different) * (c_z * y - s_z * z)];
            put(places.rotation, turned[0], turned[1]);
            put(places.skew, -turned[0], turned[1]);
            let m: [[f64; 2]; 2] =
                array::from_fn(|row| [self.sensor[first + row][first], self.sensor[first + row][first + 1]]);
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
    array::from_fn(|k| squares[k] / (gaps[k] * gaps[k]))
}
