//! The controller of a spindle: closed loop with a rigid rotor, update of λ, allocation, gyroscopic moments, refusals.

use std::f64::consts::{PI, TAU};

use magnetic_bearing::bearing::coil::Drive;
use magnetic_bearing::bearing::magnet::forces;
use magnetic_bearing::bearing::shaft::{displacement, generalised, shared, through};
use magnetic_bearing::bearing::spindle::{Spindle, SpindleGeometry};
use magnetic_bearing::control::spindle::{
    BearingPath, SpindleController, SpindleControllerConfig, SpindleControllerInput, SpindleControllerOutput,
    SpindleControllerState,
};
use magnetic_bearing::control::tracking::{Arrangement, ControllerError, UpdateMode};
use magnetic_bearing::plant::noise::Noise;

/// True force constants of A, B, X, in N·m²/A².
const LAMBDA: [f64; 8] = [1.8e-6, 2.0e-6, 2.2e-6, 2.4e-6, 2.1e-6, 1.9e-6, 3.0e-6, 2.6e-6];

/// Guesses over true values, wrong by up to two.
const WRONG: [f64; 8] = [1.5, 1.0 / 1.5, 2.0, 1.0 / 1.7, 1.6, 1.5, 0.5, 1.6];

/// Unbalance in two planes: magnitude in kg·m, phase in rad, position in m.
const UNBALANCE: [[f64; 3]; 2] = [[8e-5, 0.7, -0.08], [5e-5, -1.9, 0.10]];

/// Runge–Kutta steps within a sample.
const SUBSTEPS: usize = 10;

fn below(what: &str, value: f64, limit: f64) {
    assert!(value <= limit, "{what}: {value:e} is above the limit {limit:e}");
}

/// Rotor and controller, one sample of delay between measurement and command.
#[derive(Clone)]
struct Loop {
    controller: SpindleControllerConfig,
    /// The true spindle.
    geometry: SpindleGeometry,
    unbalance: [[f64; 3]; 2],
    /// Constant load: three forces in N, two moments in N·m.
    load: [f64; 5],
    position_noise_m: f64,
    current_noise_a: f64,
    seed: u64,
    /// The estimate of λ at a sample; valid from `valid_s` on.
    lambda_at: fn(usize) -> [f64; 8],
    valid_s: f64,
    duration_s: f64,
}

struct Record {
    t_s: f64,
    output: SpindleControllerOutput,
    /// True position minus reference at the magnets: A.y, A.z, B.y, B.z, x, in m.
    error_m: [f64; 5],
    /// Currents that flowed until the sample, in A.
    flowing_a: [f64; 8],
    /// True coordinates.
    q: [f64; 5],
}

/// Coordinates, their rates, and fluxes in Wb.
#[derive(Clone, Copy)]
struct State {
    q: [f64; 5],
    v: [f64; 5],
    linkage: [f64; 8],
}

impl State {
    fn plus(&self, d: &State, h: f64) -> State {
        State {
            q: std::array::from_fn(|a| self.q[a] + h * d.q[a]),
            v: std::array::from_fn(|a| self.v[a] + h * d.v[a]),
            linkage: std::array::from_fn(|k| self.linkage[k] + h * d.linkage[k]),
        }
    }
}

impl Loop {
    /// The study of identification.md, section 7: mixed ellipses, axial motion, noise of 0.1 µm and 10 mA, unbalance in two
    /// planes, a load, F_0 modulated by half; λ known from the start.
    fn study(rpm: f64) -> Self {
        let mut controller = SpindleControllerConfig::default();
        controller.law.lambda0_nm2_a2 = LAMBDA;
        controller.law.modulation = 0.5;
        controller.path.a = BearingPath { r_y_m: 30e-6, r_z_m: 70e-6, phase_rad: 0.0 };
        controller.path.b = BearingPath { r_y_m: 60e-6, r_z_m: 25e-6, phase_rad: 1.2 };
        controller.path.axial_amplitude_m = 20e-6;
        controller.path.omega_rad_s = rpm * TAU / 60.0;
        Self {
            controller,
            geometry: SpindleGeometry::default(),
            unbalance: UNBALANCE,
            load: [8.0, 15.0, -20.0, 0.6, -0.9],
            position_noise_m: 1e-7,
            current_noise_a: 1e-2,
            seed: 1,
            lambda_at: |_| LAMBDA,
            valid_s: 0.0,
            duration_s: 0.4,
        }
    }

    /// Without noise, load and unbalance.
    fn ideal(rpm: f64) -> Self {
        Self { unbalance: [[0.0; 3]; 2], load: [0.0; 5], position_noise_m: 0.0, current_noise_a: 0.0, ..Self::study(rpm) }
    }

    fn with_voltage(mut self) -> Self {
        self.controller.law.coil.drive = Drive::Voltage;
        self
    }

    fn wrong(mut self) -> Self {
        self.controller.law.lambda0_nm2_a2 = std::array::from_fn(|k| LAMBDA[k] * WRONG[k]);
        self
    }

    /// Reference (position, velocity) of the coordinates at a time after the start, without a ramp; written anew, as a second way.
    fn reference(&self, t_s: f64) -> [[f64; 5]; 2] {
        let path = &self.controller.path;
        let w = path.omega_rad_s;
        let at_m = [self.geometry.a.position_m, self.geometry.b.position_m];
        let wa = TAU * path.axial_hz;
        [0.0, 1.0].map(|d: f64| {
            // The derivative of a cosine is the cosine a quarter later.
            let ahead = d * PI / 2.0;
            let point = |path: &BearingPath| {
                let angle = w * t_s + path.phase_rad + ahead;
                [path.r_y_m * angle.cos() * w.powf(d), path.r_z_m * angle.sin() * w.powf(d)]
            };
            let x = path.axial_amplitude_m * (wa * t_s + ahead).sin() * wa.powf(d);
            let [a, b] = [point(&path.a), point(&path.b)];
            let slope = |axis: usize| (b[axis] - a[axis]) / (at_m[1] - at_m[0]);
            [x, a[0] - at_m[0] * slope(0), a[1] - at_m[0] * slope(1), -slope(1), slope(0)]
        })
    }

    fn rate(&self, t_s: f64, state: &State, command: &[f64; 8], spindle: &Spindle) -> (State, [f64; 8]) {
        let w = self.controller.path.omega_rad_s;
        let gap = spindle.geometry().gaps(state.q);
        assert!(gap.iter().all(|gap| *gap > 0.0), "the rotor touches a magnet at {t_s} s");
        let coil = &self.controller.law.coil;
        let mut linkage = [0.0; 8];
        let current = match coil.drive {
            Drive::Current => *command,
            Drive::Voltage => {
                let current: [f64; 8] = std::array::from_fn(|k| state.linkage[k] * gap[k] / (2.0 * LAMBDA[k]));
                linkage = std::array::from_fn(|k| command[k] - coil.resistance_ohm * current[k]);
                current
            }
        };
        let mut total = spindle.geometry().resultant(forces(LAMBDA, current, gap));
        for a in 0..5 {
            total[a] += self.load[a];
        }
        for [magnitude, phase, at_m] in self.unbalance {
            let angle = w * t_s + phase;
            let force = magnitude * w * w;
            let part = generalised(at_m, [force * angle.cos(), force * angle.sin()]);
            for a in 0..5 {
                total[a] += part[a];
            }
        }
        let jp = self.geometry.shaft.polar_kgm2;
        total[3] -= jp * w * state.v[4];
        total[4] += jp * w * state.v[3];
        let m = spindle.inertia();
        (State { q: state.v, v: std::array::from_fn(|a| total[a] / m[a]), linkage }, current)
    }

    fn run(&self) -> Vec<Record> {
        let spindle = Spindle::new(self.geometry).expect("a spindle");
        let controller = SpindleController::new(self.controller.clone()).expect("a controller");
        let voltage = self.controller.law.coil.drive == Drive::Voltage;
        let step_s = self.controller.law.step_s;
        let h = step_s / SUBSTEPS as f64;
        let [q, v] = self.reference(0.0);
        let mut x = State { q, v, linkage: [0.0; 8] };
        let mut c = controller.start(0.0);
        let mut held = [0.0; 8];
        let mut before = [0.0; 8];
        let [mut noise] = Noise::channels(self.seed);
        let mut records = Vec::new();
        for k in 0..(self.duration_s / step_s).round() as usize {
            let t_s = k as f64 * step_s;
            let flowing_a = if voltage { self.rate(t_s, &x, &held, &spindle).1 } else { before };
            let input = SpindleControllerInput {
                reading_m: spindle.readings(x.q).map(|reading| reading + self.position_noise_m * noise.standard_normal()),
                current_a: flowing_a.map(|i| i + self.current_noise_a * noise.standard_normal()),
                lambda_hat_nm2_a2: (self.lambda_at)(k),
                lambda_valid: t_s >= self.valid_s,
                omega_rad_s: self.controller.path.omega_rad_s,
            };
            let output = controller.sample(&mut c, &input).expect("a sample");
            assert!(!output.saturated, "saturated at {t_s} s");
            // The first currents take longer than a sample.
            assert!(k < 100 || !output.limited, "limited at {t_s} s");
            let [wanted, _] = self.reference(t_s);
            let error: [f64; 5] = std::array::from_fn(|a| x.q[a] - wanted[a]);
            let [a, b] = [self.geometry.a, self.geometry.b].map(|bearing| displacement(bearing.position_m, error));
            let error_m = [a[0], a[1], b[0], b[1], error[0]];
            for n in 0..SUBSTEPS {
                let t_s = t_s + n as f64 * h;
                let rate = |t_s: f64, x: &State| self.rate(t_s, x, &held, &spindle).0;
                let k1 = rate(t_s, &x);
                let k2 = rate(t_s + 0.5 * h, &x.plus(&k1, 0.5 * h));
                let k3 = rate(t_s + 0.5 * h, &x.plus(&k2, 0.5 * h));
                let k4 = rate(t_s + h, &x.plus(&k3, h));
                x = x.plus(&k1, h / 6.0).plus(&k2, h / 3.0).plus(&k3, h / 3.0).plus(&k4, h / 6.0);
            }
            before = held;
            held = if voltage { output.voltage_v } else { output.current_a };
            records.push(Record { t_s, output, error_m, flowing_a, q: x.q });
        }
        records
    }
}

/// Largest tracking error in A (y, z), B (y, z), X, over the samples with t in `[from, to)`, in m.
fn largest(records: &[Record], from: f64, to: f64) -> [f64; 5] {
    let within = records.iter().filter(|r| (from..to).contains(&r.t_s));
    within.fold([0.0; 5], |most, r| std::array::from_fn(|a| f64::max(most[a], r.error_m[a].abs())))
}

fn drives(case: &Loop) -> [(&'static str, Loop); 2] {
    [("current", case.clone()), ("voltage", case.clone().with_voltage())]
}

#[test]
#[ignore]
fn figures() {
    for rpm in [1500.0, 3000.0, 6000.0, 12000.0] {
        for (name, case) in drives(&Loop::study(rpm)) {
            let e = largest(&case.run(), 0.1, 0.4).map(|e| e * 1e6);
            println!("study {rpm} {name}: {e:.3?}");
            let e = largest(&Loop { unbalance: [[0.0; 3]; 2], ..case.clone() }.run(), 0.1, 0.4).map(|e| e * 1e6);
            println!("   no unbalance: {e:.3?}");
            let e = largest(&Loop { position_noise_m: 0.0, current_noise_a: 0.0, ..case.clone() }.run(), 0.1, 0.4).map(|e| e * 1e6);
            println!("   no noise: {e:.3?}");
        }
        for (name, case) in drives(&Loop::ideal(rpm)) {
            let e = largest(&case.run(), 0.1, 0.4).map(|e| e * 1e6);
            println!("ideal {rpm} {name}: {e:.4?}");
            let mut without = case.clone();
            without.controller.geometry.shaft.polar_kgm2 = 0.0;
            let e = largest(&without.run(), 0.1, 0.4).map(|e| e * 1e6);
            println!("   not compensated: {e:.4?}");
        }
        for (name, case) in drives(&Loop::study(rpm).wrong()) {
            let r = case.run();
            println!("wrong {rpm} {name}: {:.3?} {:.3?}", largest(&r, 0.05, 0.2).map(|e| e * 1e6), largest(&r, 0.3, 0.4).map(|e| e * 1e6));
            let jump = |k: usize| -> f64 { (0..8).map(|j| (r[k].output.current_a[j] - r[k - 1].output.current_a[j]).abs()).fold(0.0, f64::max) };
            let usual = (1500..2000).map(jump).fold(0.0, f64::max);
            println!("    jump {:.4} usual {:.4}, next {:.4}", jump(2000), usual, jump(2001));
        }
    }
}
