use magnetic_bearing::model::estimator::*;
fn main() {
    for method in [Method::Paper, Method::LeastSquares, Method::Unbalance] {
        for n in [200usize, 2000, 20000] {
            let c = EstimatorConfig { window_s: n as f64 * 1e-4, epsilon_s: n as f64 * 1e-4, method, ..Default::default() };
            let e = Estimator::new(c).unwrap();
            let mut s = e.start();
            let steps = 2 * n + 20000;
            let mut worst = 0u128; let mut total = 0u128; let mut count = 0;
            for k in 0..steps {
                let th = 0.0314159 * k as f64;
                let input = EstimatorInput { position_m: [30e-6 * th.cos(), 70e-6 * th.sin()], current_a: [2.0 + th.sin(), 2.0 + (th + 1.0).cos(), 2.0 - (2.0 * th).sin()], theta_rad: th, omega_rad_s: 314.159, enable: true, reset: false, ..Default::default() };
                let t = std::time::Instant::now();
                std::hint::black_box(e.sample(&mut s, &input));
                let d = t.elapsed().as_nanos();
                if k > n { total += d; count += 1; worst = worst.max(d); }
            }
            println!("{method:?} N={n}: mean {} ns, worst {} ns", total / count, worst);
        }
    }
}
