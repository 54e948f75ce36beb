//! The coil: one energy for current and force, saturation, and the plant driven by voltage.

use crate::prelude::*;

const GAP_M: f64 = 5e-4;

fn of_mass(m_kg: f64) -> RotorConfig {
    let mut rotor = RotorConfig::of(&PLANAR);
    rotor.shaft.m_kg = m_kg;
    rotor
}

fn voltage(coil: CoilConfig) -> CoilConfig {
    CoilConfig { drive: Drive::Voltage, ..coil }
}

/// The paper's coil; with leakage, with saturation, and with both.
fn coils() -> [CoilConfig; 4] {
    let plain = CoilConfig::default();
    [
        plain.clone(),
        CoilConfig { leakage_h: 2e-3, ..plain.clone() },
        CoilConfig { saturation_wb: 0.02, ..plain.clone() },
        CoilConfig { leakage_h: 2e-3, saturation_wb: 0.02, ..plain },
    ]
}

/// Energy of the field, in J: the work `∫ i dψ` that builds up the flux at this gap, by Simpson's rule.
fn energy_j(coil: &Coil, linkage_wb: f64, gap_m: f64) -> f64 {
    const INTERVALS: u32 = 1000;
    let part = |n: u32| f64::from(n) / f64::from(INTERVALS);
    let weight = |n: u32| if n == 0 || n == INTERVALS { 1.0 } else { [2.0, 4.0][n as usize % 2] };
    let current_a = |n: u32| coil.at_linkage(part(n) * linkage_wb, gap_m).current_a;
    (0..=INTERVALS).map(|n| weight(n) * current_a(n)).sum::<f64>() * linkage_wb / (3.0 * f64::from(INTERVALS))
}

#[test]
fn current_and_force_are_the_derivatives_of_one_energy() {
    /// Relative error of central differences with increments of 1e-5.
    const DIFFERENCES: f64 = 1e-8;
    for config in coils() {
        let coil = config.of(2e-6, GAP_M);
        for linkage in [-0.03, 1e-3, 0.01, 0.03, 0.06] {
            for gap in [1e-4, 3e-4, 7e-4] {
                let at = coil.at_linkage(linkage, gap);
                below("linkage, Wb", (at.linkage_wb - linkage).abs(), 1e-15);
                let slope = |of: &dyn Fn(f64, f64) -> f64, by_gap: bool| {
                    let size = 1e-5 * if by_gap { gap } else { linkage.abs() };
                    let [a, b] = if by_gap { [0.0, size] } else { [size, 0.0] };
                    (of(linkage + a, gap + b) - of(linkage - a, gap - b)) / (2.0 * size)
                };
                let energy = |psi, gap| energy_j(&coil, psi, gap);
                let current = |psi, gap| coil.at_linkage(psi, gap).current_a;
                let force = |psi, gap| coil.at_linkage(psi, gap).force_n;
                let same = |what: &str, got: f64, wanted: f64, scale: f64| {
                    let what = format!("{config:?}, ψ = {linkage} Wb, gap = {gap} m, {what}");
                    below(&what, (got - wanted).abs() / scale, DIFFERENCES);
                };
                same("i = ∂W/∂ψ", at.current_a, slope(&energy, false), at.current_a.abs());
                // Saturated iron stores most of the energy, whose rounding errors exceed those of the force.
                same("F = ∂W/∂gap", at.force_n, slope(&energy, true), energy(linkage, gap) / gap);
                same("∂i/∂ψ", at.current_by_linkage, slope(&current, false), at.current_by_linkage);
                // Both are second derivatives of the energy.
                same("∂i/∂gap = ∂F/∂ψ", slope(&current, true), slope(&force, false), (at.current_a / gap).abs());
                let back = coil.at_current(at.current_a, gap);
                below("ψ back from the current", (back.linkage_wb / linkage - 1.0).abs(), 1e-12);
            }
        }
    }
}

#[test]
fn without_saturation_the_force_is_that_of_the_paper() {
    let coil = CoilConfig::default().of(2e-6, GAP_M);
    below("L at the nominal gap, H", (coil.inductance_h(GAP_M) - 8e-3).abs(), 1e-17);
    let at = coil.at_current(2.0, 4e-4);
    below("F, N", (at.force_n - 2e-6 * 4.0 / 16e-8).abs(), 1e-12);
    below("ψ, Wb", (at.linkage_wb - 2.0 * 2.0 * 2e-6 / 4e-4).abs(), 1e-16);
}

#[test]
fn saturation_takes_current_and_gives_less_force() {
    let config = CoilConfig { saturation_wb: 0.02, ..CoilConfig::default() };
    let (iron, air) = (config.of(2e-6, GAP_M), CoilConfig::default().of(2e-6, GAP_M));
    // At φ_s the iron takes as much current as the nominal gap.
    let at = iron.at_linkage(0.02, GAP_M);
    below("current at φ_s", (at.current_a / (2.0 * air.at_linkage(0.02, GAP_M).current_a) - 1.0).abs(), 1e-12);
    for current in [0.5, 2.0, 5.0, 50.0, 5000.0] {
        let [iron, air] = [iron, air].map(|coil| coil.at_current(current, GAP_M));
        assert!(iron.force_n < air.force_n, "{current} A: {} N against {} N", iron.force_n, air.force_n);
        below("current found again", (iron.current_a / current - 1.0).abs(), 1e-12);
    }
}

/// Voltages that change from sample to sample and drive currents of some amperes.
fn voltages(sample: usize) -> PlantInput {
    let at = |k: usize| 1.5 + 6.0 * ((sample * (7 + 4 * k)) % 13) as f64 / 13.0 - 3.0;
    PlantInput { voltage_v: [at(0), at(1), at(2)], omega_rad_s: 314.0, ..PlantInput::default() }
}

#[test]
fn the_energy_of_coils_and_rotor_balances() {
    /// Balance error over 0.1 s, relative to the energy transferred. Input and loss are integrated by Simpson's rule with steps of 20 µs.
    const BALANCE: f64 = 1e-6;
    for coil in coils() {
        let config = PlantConfig {
            coil: voltage(coil.clone()),
            // A rotor heavy enough to be still clear of the backup bearing after 0.1 s without a controller.
            rotor: of_mass(670.0),
            velocity_m_s: [1e-3, -1e-3],
            position_m: [0.0; 2],
            ..PlantConfig::default()
        };
        let plant = Plant::new(config.clone()).expect("plant");
        let mut state = plant.start(0.0);
        let kinetic = |state: &PlantState| {
            0.5 * config.rotor.shaft.m_kg * state.motion.velocity_m_s.iter().map(|v| v * v).sum::<f64>()
        };
        let kinetic_at_start = kinetic(&state);
        let mut sums = [0.0; 4];
        let h = STEP_S / 10.0;
        for sample in 0..1000 {
            let input = voltages(sample);
            for node in 0..=10 {
                let out = plant.outputs(&state, &input, state.time_s);
                let power: f64 = (0..3).map(|k| input.voltage_v[k] * out.current_a[k]).sum();
                let loss: f64 = out.current_a.iter().map(|i| config.coil.resistance_ohm * i * i).sum();
                let work: f64 = (0..2).map(|a| out.resultant_n[a] * state.motion.velocity_m_s[a]).sum();
                let weight = if node % 10 == 0 { 1.0 } else { [2.0, 4.0][node % 2] };
                for (sum, rate) in sums.iter_mut().zip([power, power.abs(), loss, work]) {
                    *sum += weight * h / 3.0 * rate;
                }
                if node < 10 {
                    let t_s = (10 * sample + node) as f64 * h;
                    plant.advance(&mut state, &InputTrajectory::held(&input), t_s, h).expect("advance");
                }
            }
        }
        let [input, transferred, loss, work] = sums;
        let end = plant.outputs(&state, &voltages(0), state.time_s);
        let field: f64 = (0..3).map(|k| energy_j(&plant.equations().coil(k), end.linkage_wb[k], end.gap_m[k])).sum();
        let residual = input - loss - work - field;
        assert!(field > 1e-4 && loss > 1e-3, "{coil:?}: field {field} J, loss {loss} J: the test shows nothing");
        below(&format!("{coil:?}: electric balance"), residual.abs() / transferred, BALANCE);
        let gained = kinetic(&state) - kinetic_at_start;
        assert!(gained.abs() > 1e-5, "{coil:?}: kinetic energy gained {gained} J: the test shows nothing");
        below(&format!("{coil:?}: mechanical balance"), (gained - work).abs() / gained.abs(), BALANCE);
    }
}

#[test]
fn stiff_coils_and_small_gaps_agree_with_a_reference_solution() {
    /// Error of the position after 2 ms against sub-steps of at most 50 ns, in m; measured 1.2e-13 for the coils with a time constant of
    /// 5 µs, which are integrated in steps of a tenth of it.
    const POSITION_M: f64 = 1e-12;
    /// Error of the fluxes, in Wb; they are of the order of 1e-3.
    const LINKAGE_WB: f64 = 1e-9;
    let stiff = CoilConfig { resistance_ohm: 800.0, limit_v: 2000.0, ..CoilConfig::default() };
    for (name, coil, position_m) in [
        ("the paper's", CoilConfig::default(), [30e-6, 0.0]),
        ("5 µs", stiff.clone(), [30e-6, 0.0]),
        ("a gap of 10 µm", CoilConfig::default(), [0.0, -490e-6]),
        ("5 µs and saturation", CoilConfig { saturation_wb: 0.01, leakage_h: 1e-3, ..stiff }, [0.0, 100e-6]),
    ] {
        let run = |max_step_s: f64| {
            let (driven, velocity_m_s) = (voltage(coil.clone()), [0.0; 2]);
            let mut config =
                PlantConfig { coil: driven, position_m, velocity_m_s, max_step_s, ..PlantConfig::default() };
            config.touchdown[0].clearance_m = 1.0;
            let plant = Plant::new(config).expect("plant");
            let mut state = plant.start(0.0);
            let scale = coil.resistance_ohm.min(400.0);
            for sample in 0..20 {
                let mut input = voltages(sample);
                input.voltage_v = input.voltage_v.map(|u| u * scale);
                // No current in the magnet at the small gap, which would attract the rotor.
                if position_m[1] < -400e-6 {
                    input.voltage_v[0] = 0.0;
                }
                let t_s = sample as f64 * STEP_S;
                plant.advance(&mut state, &InputTrajectory::held(&input), t_s, STEP_S).expect("advance");
            }
            state
        };
        let (got, wanted) = (run(5e-5).motion, run(5e-8).motion);
        for (got, wanted) in got.position_m.into_iter().zip(wanted.position_m) {
            below(&format!("{name}: position, m"), (got - wanted).abs(), POSITION_M);
        }
        for (got, wanted) in got.linkage_wb.into_iter().zip(wanted.linkage_wb) {
            below(&format!("{name}: flux, Wb"), (got - wanted).abs(), LINKAGE_WB);
        }
    }
}

/// A rotor too heavy to move: `i = u/R (1 − e^(−Rt/L))`.
#[test]
fn a_step_of_voltage_follows_the_closed_form_up_to_the_limit() {
    /// Relative error of the current.
    const CURRENT: f64 = 1e-9;
    let config = PlantConfig {
        rotor: of_mass(1e12),
        coil: voltage(CoilConfig { leakage_h: 1e-3, ..CoilConfig::default() }),
        position_m: [0.0; 2],
        velocity_m_s: [0.0; 2],
        ..PlantConfig::default()
    };
    let plant = Plant::new(config).expect("plant");
    let mut state = plant.start(0.0);
    // The amplifier limits the commanded 250 V to 100 V.
    let input = PlantInput { voltage_v: [2.0, -50.0, 250.0], ..PlantInput::default() };
    for sample in 0..100 {
        plant.advance(&mut state, &InputTrajectory::held(&input), sample as f64 * STEP_S, STEP_S).expect("advance");
    }
    for (k, (u, lambda)) in [2.0, -50.0, 100.0].into_iter().zip([1.8e-6, 2.0e-6, 2.2e-6]).enumerate() {
        let time_constant_s: f64 = 1e-3 + 2.0 * lambda / GAP_M;
        let wanted = u * -(-0.01 / time_constant_s).exp_m1();
        below("current", (state.measured.current_a[k] / wanted - 1.0).abs(), CURRENT);
    }
}

/// In deep saturation Newton's iteration starts at the solution: `i = i_s (φ/φ_s)⁷`, and the force is proportional to `i^(2/7)`.
/// Fails if the iteration stops when the value has converged but its derivatives have not.
#[test]
fn derivatives_converge_where_the_value_starts_at_the_solution() {
    let constant = Taylor::<4>::constant;
    let config = CoilConfig {
        drive: Drive::Current,
        resistance_ohm: constant(1.0),
        leakage_h: constant(0.0),
        limit_v: constant(100.0),
        saturation_wb: constant(0.02),
    };
    let coil = config.of(constant(2e-6), constant(GAP_M));
    // i_0 (1 + τ), with i_s = 2.5 A.
    let current = Taylor([2.5e19, 2.5e19, 0.0, 0.0]);
    let force = coil.at_current(current, constant(GAP_M)).force_n;
    for (got, wanted) in force.0.into_iter().zip([1.0, 2.0 / 7.0, -5.0 / 49.0, 20.0 / 343.0]) {
        below("coefficient of F/F_0", (got / force.0[0] - wanted).abs(), 1e-12);
    }
}

#[test]
fn a_coil_too_fast_to_integrate_is_refused() {
    // A time constant of 0.4 µs, irrelevant with current drive.
    for (drive, refused) in [(Drive::Voltage, true), (Drive::Current, false)] {
        let coil = CoilConfig { drive, resistance_ohm: 1e4, ..CoilConfig::default() };
        let made = Plant::new(PlantConfig { coil, ..PlantConfig::default() });
        assert_eq!(made.err().map(|found| found[0].name.to_string()), refused.then(|| "coil.R".into()));
    }
}
