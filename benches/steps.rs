//! Steps of the estimator, one by one, with divan: `cargo bench --bench steps`.

mod support;

use divan::{Bencher, black_box};
use magnetic_bearing::estimation::{Estimator, EstimatorConfig, Method, Tolerance};

/// Steps per measurement: a revolution, because some samples take longer than others.
const BATCH: usize = 200;

fn main() {
    divan::main();
}

fn bench(bencher: Bencher, config: EstimatorConfig) {
    let warm_up = (config.window_s / config.step_s) as usize + 2000;
    let estimator = Estimator::new(config).expect("valid parameters");
    let mut state = estimator.start();
    let record = support::record();
    let mut inputs = record.iter().cycle();
    for input in inputs.by_ref().take(warm_up) {
        estimator.sample(&mut state, input);
    }
    bencher.counter(BATCH).bench_local(|| {
        for input in inputs.by_ref().take(BATCH) {
            black_box(estimator.sample(&mut state, input));
        }
    });
}

#[divan::bench(args = [200, 2000, 20_000])]
fn paper(bencher: Bencher, intervals: usize) {
    let window_s = intervals as f64 * 1e-4;
    let config = EstimatorConfig { method: Method::Paper, window_s, epsilon_s: window_s, ..EstimatorConfig::default() };
    bench(bencher, config);
}

#[divan::bench]
fn noise_known(bencher: Bencher) {
    bench(bencher, EstimatorConfig { position_noise_m: 1e-7, current_noise_a: 1e-2, ..EstimatorConfig::default() });
}

#[divan::bench]
fn noise_estimated(bencher: Bencher) {
    bench(bencher, EstimatorConfig::default());
}

#[divan::bench]
fn tolerances(bencher: Bencher) {
    let tolerance = Tolerance { gap_m: 2e-6, alpha_rad: 2e-3, ..Tolerance::default() };
    bench(bencher, EstimatorConfig { tolerance, ..EstimatorConfig::default() });
}
