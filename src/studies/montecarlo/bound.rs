//! The Cramér–Rao bound: the least standard deviation that an unbiased estimate of λ can have, for any machine.

use nalgebra::{DMatrix, DVector};

use crate::bearing::{array, shaft};
use crate::fmu::plant;
use crate::simulation::{Recording, Scenario};

/// Order of the Taylor series over an interval; the negative stiffness changes little within a sample.
const ORDERS: usize = 6;

/// Data of the interval between two samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Interval {
    /// Length, in s.
    pub length_s: f64,
    /// True coordinates of the rotor in the middle, in m; angles in rad.
    pub position_m: Vec<f64>,
    /// True current through each magnet, in A; its mean where it varies.
    pub current_a: Vec<f64>,
    /// Angle of the rotor in the middle, in rad.
    pub theta_rad: f64,
    /// Speed, in rad/s.
    pub omega_rad_s: f64,
    /// Its derivative, in rad/s².
    pub acceleration_rad_s2: f64,
}

/// Rotor, magnets and sensors as the bound needs them. Coordinates are in m, angles among them in rad.
#[derive(Clone, Debug, PartialEq)]
pub struct Rotor {
    /// The mass or moment of inertia of each coordinate, in kg or kg·m².
    pub inertia: DVector<f64>,
    /// Gyroscopic moments at a speed of 1 rad/s, by coordinate, for a unit rate of each coordinate.
    pub gyroscopic: DMatrix<f64>,
    /// `d_k`: the generalised force for a unit force of each magnet.
    pub directions: DMatrix<f64>,
    /// Gap of each magnet with the rotor in the centre, in m.
    pub gap_m: Vec<f64>,
    /// True λ, in N·m²/A².
    pub lambda_nm2_a2: Vec<f64>,
    /// The generalised force for a unit force along y, and along z, in each unbalance plane.
    pub planes: Vec<[DVector<f64>; 2]>,
    /// Readings for a unit of each coordinate.
    pub readings: DMatrix<f64>,
    /// Standard deviation of the position noise, in m; above 0.
    pub position_noise_m: f64,
    /// Standard deviation of the current noise, in A.
    pub current_noise_a: f64,
}

impl Rotor {
    /// The rotor of a scenario.
    pub fn of(scenario: &Scenario) -> Self {
        match scenario.machine.name {
            "planar" => Self::with::<2, 3, 1>(scenario),
            "planar4" => Self::with::<2, 4, 1>(scenario),
            "axial" => Self::with::<1, 2, 1>(scenario),
            "spindle" => Self::with::<5, 8, 3>(scenario),
            _ => Self::with::<5, 10, 3>(scenario),
        }
    }

    fn with<const N: usize, const K: usize, const B: usize>(scenario: &Scenario) -> Self {
        let (config, _) = plant::configuration::<N, K, B>(&scenario.plant().values());
        let geometry = config.rotor.geometry::<N, K>();
        let unit = |n: usize| array::from_fn(|other| f64::from(other == n));
        let columns = |column: &dyn Fn(usize) -> [f64; N]| DMatrix::from_fn(N, N, |row, n| column(n)[row]);
        let of_plane = |at_m: &f64| {
            [[1.0, 0.0], [0.0, 1.0]].map(|force| DVector::from(shaft::generalised::<f64, N>(*at_m, force).to_vec()))
        };
        Self {
            inertia: DVector::from(config.rotor.shaft.inertia::<N>().to_vec()),
            gyroscopic: columns(&|n| config.rotor.shaft.gyroscopic(1.0, unit(n)).unwrap_or([0.0; N])),
            directions: DMatrix::from_fn(N, K, |n, k| geometry.directions[k][n]),
            gap_m: geometry.gap_m.to_vec(),
            lambda_nm2_a2: config.lambda_nm2_a2.to_vec(),
            planes: config.unbalance_position_m.iter().take(scenario.machine.planes).map(of_plane).collect(),
            readings: columns(&|n| config.rotor.readings(unit(n))),
            position_noise_m: config.sensor.position_noise_m,
            current_noise_a: config.sensor.current_noise_a,
        }
    }

    /// Number of coordinates.
    fn coordinates(&self) -> usize {
        self.inertia.len()
    }

    /// Number of parameters: `λ_k`, `U_c, U_s` of each plane, load on each coordinate.
    fn parameters(&self) -> usize {
        self.lambda_nm2_a2.len() + 2 * self.planes.len() + self.coordinates()
    }

    /// Accelerations for a unit of each coordinate, rate, parameter and current.
    fn accelerations(&self, interval: &Interval) -> DMatrix<f64> {
        let (n, k) = (self.coordinates(), self.lambda_nm2_a2.len());
        let parameters = 2 * n;
        let loads = parameters + k + 2 * self.planes.len();
        let mut all = DMatrix::zeros(n, loads + n + k);
        let position = DVector::from_column_slice(&interval.position_m);
        for magnet in 0..k {
            let direction = self.directions.column(magnet);
            let gap = self.gap_m[magnet] - direction.dot(&position);
            let (i, lambda) = (interval.current_a[magnet], self.lambda_nm2_a2[magnet]);
            let stiffness = 2.0 * lambda * i * i / (gap * gap * gap);
            all.view_mut((0, 0), (n, n)).ger(stiffness, &direction, &direction, 1.0);
            all.column_mut(parameters + magnet).axpy(i * i / (gap * gap), &direction, 0.0);
            all.column_mut(loads + n + magnet).axpy(2.0 * lambda * i / (gap * gap), &direction, 0.0);
        }
        all.view_mut((0, n), (n, n)).copy_from(&(&self.gyroscopic * interval.omega_rad_s));
        let (sin, cos) = interval.theta_rad.sin_cos();
        let (w2, dw) = (interval.omega_rad_s * interval.omega_rad_s, interval.acceleration_rad_s2);
        let (along, across) = (w2 * cos + dw * sin, w2 * sin - dw * cos);
        for (plane, [y, z]) in self.planes.iter().enumerate() {
            let at = parameters + k + 2 * plane;
            all.set_column(at, &(y * along + z * across));
            all.set_column(at + 1, &(z * along - y * across));
        }
        all.view_mut((0, loads), (n, n)).fill_with_identity();
        for (mut row, inertia) in all.row_iter_mut().zip(&self.inertia) {
            row /= *inertia;
        }
        all
    }
}

/// The covariance of a Kalman filter along the true trajectory, without prior information.
///
/// As in the plant, noise of positions and currents is white, and the angle is exact. Initial motion, constant loads, λ and
/// unbalance are unknown; the true currents are nuisance parameters. Linearised about the truth, with `d_k` the generalised force for a unit
/// force of magnet k, and `y_j`, `z_j` those for a unit force along y and z in unbalance plane j,
///
/// ```text
/// M δq̈ = Σ 2λ_k i_k²/gap_k³ d_k d_kᵀ δq − Ω G δq̇ + Σ i_k²/gap_k² d_k δλ_k + Σ 2λ_k i_k/gap_k² d_k n_k
///        + Σ (c y_j + s z_j) δU_cj + (c z_j − s y_j) δU_sj + δp,    c = Ω² cos θ + Ω̇ sin θ,  s = Ω² sin θ − Ω̇ cos θ
/// ```
///
/// where the current noise `n_k` is constant over an interval. The filter's covariance is then the inverse of the Fisher
/// information of the joint likelihood. If currents are linear between samples, the noise of neighbouring intervals is
/// correlated; it is modelled as white with the same density at low frequency.
pub struct Bound {
    rotor: Rotor,
    /// Units that scale the unknowns to similar size: coordinates, rates, parameters, and finally currents.
    scale: DVector<f64>,
    /// The readings for a unit of each unknown, in units of their noise.
    readings: DMatrix<f64>,
    /// Covariance in these units.
    p: DMatrix<f64>,
}

impl Bound {
    /// The filter before the first sample. Prior standard deviations are too large to carry information: 1 m/s, 30 times λ, an
    /// eccentricity of 10 gaps, 100 times the weight; for angles and moments the same at the radius of gyration.
    pub fn new(rotor: Rotor) -> Self {
        let (n, sigma, m_kg) = (rotor.coordinates(), rotor.position_noise_m, rotor.inertia[0]);
        let (eccentric, weight) = (m_kg * rotor.gap_m[0], 9.81 * m_kg);
        let radius = rotor.inertia.map(|inertia| (inertia / m_kg).sqrt());
        // Unit of each unknown, and its prior standard deviation in this unit.
        let of_coordinates = |size: f64| radius.iter().map(move |radius| (size / radius, 1e3));
        let unknowns = of_coordinates(sigma)
            .chain(of_coordinates(1e-3))
            .chain(rotor.lambda_nm2_a2.iter().map(|lambda| (*lambda, 30.0)))
            .chain(std::iter::repeat_n((eccentric, 10.0), 2 * rotor.planes.len()))
            .chain(radius.iter().map(|radius| (weight * radius, 100.0)));
        let (mut scale, prior): (Vec<f64>, Vec<f64>) = unknowns.map(|(unit, std)| (unit, std * std)).unzip();
        scale.extend(rotor.lambda_nm2_a2.iter().map(|_| rotor.current_noise_a));
        let readings = DMatrix::from_fn(n, n, |row, n| rotor.readings[(row, n)] * scale[n] / sigma);
        Self { scale: scale.into(), readings, p: DMatrix::from_diagonal(&prior.into()), rotor }
    }

    /// Updates the covariance with the positions of a sample.
    pub fn measure(&mut self) {
        let n = self.rotor.coordinates();
        for reading in self.readings.row_iter() {
            let column = self.p.columns(0, n) * reading.transpose();
            // The noise of a reading is 1 in its units.
            let s = (reading * column.rows(0, n))[0] + 1.0;
            self.p.ger(-1.0 / s, &column, &column, 1.0);
        }
    }

    /// Propagates the covariance over an interval.
    pub fn predict(&mut self, interval: &Interval) {
        let (n, of_motion) = (self.rotor.coordinates(), 2 * self.rotor.coordinates());
        let accelerations = self.rotor.accelerations(interval);
        let (states, all) = (of_motion + self.rotor.parameters(), accelerations.ncols());
        // ẋ = F x + B p: the derivatives with respect to the initial [x, p], order by order.
        let motion = DMatrix::from_fn(of_motion, of_motion, |row, column| match row.checked_sub(n) {
            None => f64::from(column == row + n),
            Some(row) => accelerations[(row, column)],
        });
        let mut transition = DMatrix::identity(of_motion, all);
        let mut derivative = DMatrix::zeros(of_motion, all);
        derivative.view_mut((0, n), (n, n)).fill_with_identity();
        derivative.rows_mut(n, n).copy_from(&accelerations);
        let mut factor = 1.0;
        for order in 1..=ORDERS {
            factor *= interval.length_s / order as f64;
            transition += &derivative * factor;
            derivative = &motion * derivative;
        }
        for (column, mut values) in transition.column_iter_mut().enumerate() {
            values.iter_mut().zip(&self.scale).for_each(|(value, scale)| *value *= self.scale[column] / scale);
        }
        // P = A P Aᵀ + G Gᵀ, where A changes only the rows and columns of the motion.
        let (a, g) = (transition.columns(0, states), transition.columns(states, all - states));
        let rows = a * &self.p;
        let moved = &rows * a.transpose() + g * g.transpose();
        self.p.rows_mut(0, of_motion).copy_from(&rows);
        self.p.columns_mut(0, of_motion).copy_from(&rows.transpose());
        self.p.view_mut((0, 0), (of_motion, of_motion)).copy_from(&(0.5 * (&moved + moved.transpose())));
    }

    /// The bound for the standard deviation of each λ, relative to λ; NaN after an overflow.
    pub fn lambda(&self) -> Vec<f64> {
        let first = 2 * self.rotor.coordinates();
        let of = |n: usize| self.p[(n, n)].clamp(0.0, f64::INFINITY).sqrt();
        (first..first + self.rotor.lambda_nm2_a2.len()).map(of).collect()
    }
}

/// The bound at instants in s, relative to λ, from a recording of the scenario with one row per sample; see [`Bound`].
///
/// `None` without noise, or if the recording lacks true coordinates, forces, gaps, angle or speed of the plant.
pub fn bound(scenario: &Scenario, recording: &Recording, instants_s: &[f64]) -> Option<Vec<Vec<f64>>> {
    let rotor = Rotor::of(scenario);
    if rotor.position_noise_m.is_nan() || rotor.position_noise_m <= 0.0 {
        return None;
    }
    let signal = |name: &str| recording.get(&format!("plant.{name}"));
    let all = |names: Vec<String>| names.iter().map(|name| signal(name)).collect::<Option<Vec<_>>>();
    let machine = scenario.machine;
    let coordinates = all(machine.of_coordinates(|coordinate| coordinate.position))?;
    let (theta, omega) = (signal("theta")?, signal("omegam")?);
    let (force, gap) = (all(machine.of_magnets("F"))?, all(machine.of_magnets("gap"))?);
    let truth = rotor.lambda_nm2_a2.clone();
    // The outputs of a row are read before the next inputs are set: the current is that at the end of the interval.
    let current = |k: usize, row: usize| gap[k][row] * (force[k][row] / truth[k]).max(0.0).sqrt();
    // Current drive.
    let held = scenario.number("plant", "drive") == 1.0;
    let rows = recording.time_s.len();
    let mut found = vec![vec![f64::NAN; truth.len()]; instants_s.len()];
    let mut bound = Bound::new(rotor);
    bound.measure();
    for row in 1..rows {
        let length_s = recording.time_s[row] - recording.time_s[row - 1];
        let next = (row + 1).min(rows - 1);
        let current = |k: usize| if held { current(k, row) } else { 0.5 * (current(k, row) + current(k, row - 1)) };
        bound.predict(&Interval {
            length_s,
            position_m: coordinates.iter().map(|x| 0.5 * (x[row] + x[row - 1])).collect(),
            current_a: (0..truth.len()).map(current).collect(),
            theta_rad: 0.5 * (theta[row] + theta[row - 1]),
            omega_rad_s: omega[row],
            acceleration_rad_s2: (omega[next] - omega[row - 1]) / ((next + 1 - row) as f64 * length_s),
        });
        bound.measure();
        for (found, instant_s) in found.iter_mut().zip(instants_s) {
            if (recording.time_s[row] - instant_s).abs() <= 0.5 * length_s {
                *found = bound.lambda();
            }
        }
    }
    Some(found)
}
