mod support;
use magnetic_bearing::model::estimator::*;
fn main() {
    let record = support::record();
    let only = std::env::args().nth(1).filter(|a| !a.starts_with("--"));
    for (name, method) in [("paper", Method::Paper), ("unbalance", Method::Unbalance)] {
        if only.as_ref().is_some_and(|o| o != name) { continue }
        for n in [200usize, 2000, 20000] {
            let c = EstimatorConfig { window_s: n as f64 * 1e-4, epsilon_s: n as f64 * 1e-4, method, ..Default::default() };
            let e = Estimator::new(c).unwrap();
            let mut s = e.start();
            let steps = 2 * n + 40000;
            let mut spent = vec![];
            let inputs: Vec<_> = record.iter().cycle().take(steps).cloned().collect();
            let (mut valid, mut worst) = (0, 0);
            for (k, chunk) in inputs.chunks(400).enumerate() {
                let t = std::time::Instant::now();
                for input in chunk { let t = std::time::Instant::now(); let o = e.sample(&mut s, input); valid += o.valid as usize; worst = worst.max(t.elapsed().as_nanos()) }
                if k * 400 > n { spent.push(t.elapsed().as_nanos() as f64 / chunk.len() as f64); }
            }
            spent.sort_by(f64::total_cmp);
            println!("{name} N={n}: min {:.0} median {:.0} ns, worst {worst}, valid {valid} {:?}", spent[0], spent[spent.len() / 2], s.output().lambda_hat);
        }
    }
}
