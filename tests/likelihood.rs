//! Maximum likelihood over whole recordings: accuracy, imperfect benches, changes.

#[path = "support/bench.rs"]
mod bench;

use bench::{Bench, Recorded};
use magnetic_bearing::app::identify::likelihood::{self, *};

fn recording<'a>(recorded: &'a Recorded, bench: &Bench, told: bool) -> Recording<'a> {
    Recording {
        step_s: bench.step,
        position_m: &recorded.position,
        current_a: &recorded.current,
        theta_rad: &recorded.theta,
        omega_rad_s: &recorded.omega,
        usable: &[],
        hold: CurrentHold::Before,
        position_noise_m: told.then_some(bench.position_noise),
        current_noise_a: told.then_some(bench.current_noise),
    }
}

fn options(bench: &Bench) -> Options {
    Options { threads: 2, ..Options::new(bench.m, bench.s, bench.alpha) }
}

#[test]
#[ignore = "prints one identification"]
fn show() {
    let seconds: f64 = std::env::var("SECONDS").map_or(0.5, |s| s.parse().unwrap());
    let noise: f64 = std::env::var("NOISE").map_or(1e-7, |s| s.parse().unwrap());
    let bench = Bench { seconds, position_noise: noise, ..Bench::default() };
    let recorded = bench.record();
    for told in [true, false] {
        let start = std::time::Instant::now();
        let found = likelihood::identify(&[recording(&recorded, &bench, told)], &options(&bench)).unwrap();
        println!("{:?}", start.elapsed());
        println!("{:?} {:?}", found.lambda, found.conditions);
        println!("{:?} {:?} {:?}", found.unbalance_magnitude, found.unbalance_phase, bench.unbalance);
        println!("{:?} {:?} {:?}", found.suspects, found.contradictions, found.residuals);
        println!("{} {} {:?}", found.iterations, found.converged, found.covariance);
        for line in &found.budget {
            println!("{} {:?}", PARAMETERS[line.parameter].name, line.sensitivity);
        }
    }
}
