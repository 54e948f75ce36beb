//! The Cramér–Rao bound: the least standard deviation that an unbiased estimate of λ can have.

use crate::bearing::coil::Drive;
use crate::bearing::magnet::Geometry;
use crate::simulation::recording::Recording;
use crate::simulation::scenario::Scenario;

/// Unknown parameters: `λ_1, λ_2, λ_3, U_c, U_s, p_Y, p_Z`.
const PARAMETERS: usize = 7;
/// Position and velocity of both axes, `y, z, ẏ, ż`, before the parameters.
const STATES: usize = 4 + PARAMETERS;

/// Data of one interval for the bound between two samples; axes in the order (y, z).
#[derive(Clone, Debug, PartialEq)]
pub struct Interval {
    /// Length, in s.
    pub length_s: f64,
    /// True position of the rotor in the middle, in m.
    pub position_m: [f64; 2],
    /// True current through each magnet, in A; its mean where it varies.
    pub current_a: [f64; 3],
    /// Angle of the rotor in the middle, in rad.
    pub theta_rad: f64,
    /// Speed, in rad/s.
    pub omega_rad_s: f64,
    /// Its derivative, in rad/s².
    pub acceleration_rad_s2: f64,
}

/// Bearing and sensors as the bound needs them.
#[derive(Clone, Debug, PartialEq)]
pub struct Bearing {
    /// Mass of the rotor, in kg.
    pub m_kg: f64,
    /// Nominal gap and directions of the magnets.
    pub geometry: Geometry,
    /// True λ, in N·m²/A².
    pub lambda_nm2_a2: [f64; 3],
    /// Standard deviation of the position noise, in m; above 0.
    pub position_noise_m: f64,
    /// Standard deviation of the current noise, in A.
    pub current_noise_a: f64,
}

/// The covariance of a Kalman filter along the true trajectory that starts without knowledge.
///
/// Position noise, current noise and angle are as in the plant: white, white, exact. Initial motion, constant load, λ and
/// unbalance are unknown, the true currents are nuisance parameters. Linearised about the truth, with `e_k = (sin α_k, cos α_k)`,
///
/// ```text
/// m δẍ = Σ 2λ_k i_k²/gap_k³ e_k e_kᵀ δx + Σ i_k²/gap_k² e_k δλ_k + Σ 2λ_k i_k/gap_k² e_k n_k
///        + (ω² cos θ + ω̇ sin θ, ω² sin θ − ω̇ cos θ) δU_c + (−ω² sin θ + ω̇ cos θ, ω² cos θ + ω̇ sin θ) δU_s + δp
/// ```
///
/// where the noise `n_k` of the current is constant over an interval. The filter's covariance is then the inverse of the
/// Fisher information of the joint likelihood. Where a current runs straight between its samples, the noise of the
/// two ends is correlated between neighbouring intervals; it is taken as white with the same density at low frequency.
pub struct Bound {
    bearing: Bearing,
    /// Units that make the unknowns of similar size.
    scale: [f64; STATES],
    /// Covariance in these units.
    p: [[f64; STATES]; STATES],
}

impl Bound {
    /// Before the first sample. The prior standard deviations are so large that they carry no information: 1 m/s, 30 times
    /// λ, an eccentricity of 10 gaps, 100 times the weight.
    pub fn new(bearing: Bearing) -> Self {
        let lambda = bearing.lambda_nm2_a2;
        let (sigma, weight) = (bearing.position_noise_m, 9.81 * bearing.m_kg);
        let eccentric = bearing.m_kg * bearing.geometry.gap_m[0];
        let scale = [sigma, sigma, 1e-3, 1e-3, lambda[0], lambda[1], lambda[2], eccentric, eccentric, weight, weight];
        let prior = [1e3, 1e3, 1e3, 1e3, 30.0, 30.0, 30.0, 10.0, 10.0, 100.0, 100.0];
        let mut p = [[0.0; STATES]; STATES];
        for n in 0..STATES {
            p[n][n] = prior[n] * prior[n];
        }
        Self { bearing, scale, p }
    }

    /// Takes the positions of a sample into account.
    pub fn measure(&mut self) {
        for axis in 0..2 {
            // In the units of the position its noise is 1.
            let column: [f64; STATES] = std::array::from_fn(|n| self.p[n][axis]);
            let s = column[axis] + 1.0;
            for n in 0..STATES {
                for other in 0..STATES {
                    self.p[n][other] -= column[n] * column[other] / s;
                }
            }
        }
    }

    /// Goes over an interval.
    pub fn predict(&mut self, interval: &Interval) {
        let Bearing { m_kg, geometry, lambda_nm2_a2, current_noise_a, .. } = &self.bearing;
        let ts = interval.length_s;
        let mut stiffness = [[0.0; 2]; 2];
        let mut columns = [[0.0; PARAMETERS]; 2];
        let mut noise = [[0.0; 3]; 2];
        let gaps = geometry.gaps(interval.position_m);
        for k in 0..3 {
            let (e, gap) = (geometry.directions[k], gaps[k]);
            let (i, lambda) = (interval.current_a[k], lambda_nm2_a2[k]);
            for axis in 0..2 {
                columns[axis][k] = e[axis] * i * i / (gap * gap) / m_kg;
                noise[axis][k] = e[axis] * 2.0 * lambda * i / (gap * gap) / m_kg * current_noise_a;
                for other in 0..2 {
                    stiffness[axis][other] += e[axis] * e[other] * 2.0 * lambda * i * i / (gap * gap * gap) / m_kg;
                }
            }
        }
        let (sin, cos) = interval.theta_rad.sin_cos();
        let (w2, dw) = (interval.omega_rad_s * interval.omega_rad_s, interval.acceleration_rad_s2);
        let (along, across) = (w2 * cos + dw * sin, w2 * sin - dw * cos);
        columns[0][3..].copy_from_slice(&[along / m_kg, -across / m_kg, 1.0 / m_kg, 0.0]);
        columns[1][3..].copy_from_slice(&[across / m_kg, along / m_kg, 0.0, 1.0 / m_kg]);

        // ẍ = K x + f with constant coefficients: [x, ẋ] becomes [C x + S ẋ + D f, K S x + C ẋ + S f] with C = cosh(√K T),
        // S = sinh(√K T)/√K, D = (C − 1)/K, as series in K T².
        let square: [[f64; 2]; 2] = std::array::from_fn(|a| {
            std::array::from_fn(|b| stiffness[a][0] * stiffness[0][b] + stiffness[a][1] * stiffness[1][b])
        });
        let series = |first: f64, second: f64, third: f64| -> [[f64; 2]; 2] {
            let unit = |a: usize, b: usize| if a == b { first } else { 0.0 };
            let t2 = ts * ts;
            std::array::from_fn(|a| {
                std::array::from_fn(|b| unit(a, b) + stiffness[a][b] * t2 * second + square[a][b] * t2 * t2 * third)
            })
        };
        let cosh = series(1.0, 1.0 / 2.0, 1.0 / 24.0);
        let sinh = series(ts, ts / 6.0, ts / 120.0);
        let twice = series(ts * ts / 2.0, ts * ts / 24.0, ts * ts / 720.0);
        let applied =
            |by: &[[f64; 2]; 2], axis: usize, force: [f64; 2]| by[axis][0] * force[0] + by[axis][1] * force[1];
        // The parameters stay.
        let mut transition = [[0.0; STATES]; 4];
        let mut disturbance = [[0.0; 3]; 4];
        for axis in 0..2 {
            for other in 0..2 {
                transition[axis][other] = cosh[axis][other];
                transition[axis][2 + other] = sinh[axis][other];
                transition[2 + axis][other] = applied(&sinh, axis, stiffness[other]);
                transition[2 + axis][2 + other] = cosh[axis][other];
            }
            for n in 0..PARAMETERS {
                let force = [columns[0][n], columns[1][n]];
                transition[axis][4 + n] = applied(&twice, axis, force);
                transition[2 + axis][4 + n] = applied(&sinh, axis, force);
            }
            for k in 0..3 {
                let force = [noise[0][k], noise[1][k]];
                disturbance[axis][k] = applied(&twice, axis, force) / self.scale[axis];
                disturbance[2 + axis][k] = applied(&sinh, axis, force) / self.scale[2 + axis];
            }
        }
        for (row, values) in transition.iter_mut().enumerate() {
            for (n, value) in values.iter_mut().enumerate() {
                *value *= self.scale[n] / self.scale[row];
            }
        }
        // P = A P Aᵀ + G Gᵀ, where A changes the first four rows and columns alone.
        let mut rows = [[0.0; STATES]; 4];
        for (row, values) in rows.iter_mut().enumerate() {
            for (n, a) in transition[row].iter().enumerate() {
                for (value, p) in values.iter_mut().zip(&self.p[n]) {
                    *value += a * p;
                }
            }
        }
        for row in 0..4 {
            for n in 0..4 {
                let motion: f64 = (0..STATES).map(|other| rows[row][other] * transition[n][other]).sum();
                let disturbed: f64 = (0..3).map(|k| disturbance[row][k] * disturbance[n][k]).sum();
                self.p[row][n] = motion + disturbed;
            }
            for (n, value) in rows[row].into_iter().enumerate().skip(4) {
                self.p[row][n] = value;
                self.p[n][row] = value;
            }
        }
        for row in 0..4 {
            for n in 0..row {
                let mean = 0.5 * (self.p[row][n] + self.p[n][row]);
                (self.p[row][n], self.p[n][row]) = (mean, mean);
            }
        }
    }

    /// The bound for the standard deviation of each λ, relative to λ.
    pub fn lambda(&self) -> [f64; 3] {
        [4, 5, 6].map(|n| self.p[n][n].max(0.0).sqrt())
    }
}

/// The bound at instants in s, relative to λ, from a recording of the scenario with one row per sample; see [`Bound`].
///
/// `None` without noise, or if the recording lacks true positions, forces, gaps, angle or speed of the plant.
pub fn bound(scenario: &Scenario, recording: &Recording, instants_s: &[f64]) -> Option<Vec<[f64; 3]>> {
    let plant = scenario.closed_loop().ok()?.plant;
    let position_noise_m = plant.sensor.position_noise_m;
    if position_noise_m.is_nan() || position_noise_m <= 0.0 {
        return None;
    }
    let truth = plant.lambda_nm2_a2;
    let bearing = Bearing {
        m_kg: plant.m_kg,
        geometry: Geometry::new(plant.gap_m, plant.alpha_rad),
        lambda_nm2_a2: truth,
        position_noise_m,
        current_noise_a: plant.sensor.current_noise_a,
    };
    let signal = |name: &str| recording.get(&format!("plant.{name}"));
    let of_magnets = |name: &str| {
        let of = |k: usize| signal(&format!("{name}[{k}]"));
        Some([of(1)?, of(2)?, of(3)?])
    };
    let (y, z, theta, omega) = (signal("Y")?, signal("Z")?, signal("theta")?, signal("omegam")?);
    let (force, gap) = (of_magnets("F")?, of_magnets("gap")?);
    // The outputs of a row are read before the next inputs are set: the current is that at the end of the interval.
    let current = |k: usize, row: usize| gap[k][row] * (force[k][row] / truth[k]).max(0.0).sqrt();
    let held = plant.coil.drive == Drive::Current;
    let rows = recording.time_s.len();
    let mut bound = Bound::new(bearing);
    bound.measure();
    let mut found = vec![[f64::NAN; 3]; instants_s.len()];
    for row in 1..rows {
        let length_s = recording.time_s[row] - recording.time_s[row - 1];
        let next = (row + 1).min(rows - 1);
        bound.predict(&Interval {
            length_s,
            position_m: [y, z].map(|x| 0.5 * (x[row] + x[row - 1])),
            current_a: [0, 1, 2].map(|k| match held {
                true => current(k, row),
                false => 0.5 * (current(k, row) + current(k, row - 1)),
            }),
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
