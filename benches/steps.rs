//! Steps of the estimator, one by one, with divan: `cargo bench --bench steps`.

mod support;

use divan::{Bencher, black_box};
use magnetic_bearing::model::estimator::{Estimator, EstimatorConfig, Method};

fn main() {
    divan::main();
}

fn bench(bencher: Bencher, method: Method, intervals: usize) {
    let window_s = intervals as f64 * 1e-4;
    let config = EstimatorConfig { method, window_s, epsilon_s: window_s, ..EstimatorConfig::default() };
    let estimator = Estimator::new(config).expect("parameters that are in order");
    let mut state = estimator.start();
    let record = support::record();
    let mut inputs = record.iter().cycle();
    let hop = (intervals / 25).max(8);
    for input in inputs.by_ref().take(intervals + 2 * hop) {
        estimator.sample(&mut state, input);
    }
    bencher.counter(hop).bench_local(|| {
        for input in inputs.by_ref().take(hop) {
            black_box(estimator.sample(&mut state, input));
        }
    });
}

#[divan::bench(args = [200, 2000, 20_000])]
fn paper(bencher: Bencher, intervals: usize) {
    bench(bencher, Method::Paper, intervals);
}

#[divan::bench(args = [200, 2000, 20_000])]
fn least_squares(bencher: Bencher, intervals: usize) {
    bench(bencher, Method::LeastSquares, intervals);
}

#[divan::bench(args = [200, 2000, 20_000])]
fn unbalance(bencher: Bencher, intervals: usize) {
    bench(bencher, Method::Unbalance, intervals);
}
