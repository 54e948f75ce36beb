mod rotor;
use magnetic_bearing::model::estimation::*;
use rotor::*;

fn told(c: EstimatorConfig, n: (f64, f64)) -> EstimatorConfig {
    EstimatorConfig { position_noise_m: n.0, current_noise_a: n.1, ..c }
}
fn truth(r: &Rotor, j: usize) -> [f64; 3] {
    r.change.filter(|(t, _)| (j as f64) * r.step_s >= *t - 1e-9).map_or(r.lambda, |(_, l)| l)
}
fn show(name: &str, r: &Rotor, c: EstimatorConfig, at: &[usize]) {
    let out = r.identify(c);
    for &j in at {
        let o = &out[j];
        let truth = truth(r, j);
        let e: [f64; 3] = std::array::from_fn(|k| (o.lambda_hat[k] / truth[k] - 1.0) * 100.0);
        let s: [f64; 3] = std::array::from_fn(|k| o.lambda_std[k] / truth[k] * 100.0);
        println!(
            "{name} {j}: e% {e:.5?} std% {s:.5?} {:?} cond {:.1} nis {:.3} noise {:.2e} {:.2e} ki {:.2?} ks {:.3?}",
            o.verdict, o.condition, o.residual, o.position_noise_m, o.current_noise_a, o.ki, o.ks
        );
    }
    let mut worst = (0.0f64, 0);
    let mut nv = 0;
    for (j, o) in out.iter().enumerate() {
        if o.valid {
            nv += 1;
            let truth = truth(r, j);
            for k in 0..3 {
                let q = ((o.lambda_hat[k] - truth[k]) / o.lambda_std[k]).abs();
                if q > worst.0 {
                    worst = (q, j)
                };
            }
        }
    }
    println!("   {name}: valid {nv}, first {:?}, worst/std {worst:.2?}", out.iter().position(|o| o.valid));
}
fn circles(r: &Rotor, t: f64) -> [[f64; 2]; 3] {
    let (w1, w2) = (r.omega_rad_s, r.omega_rad_s * 0.5 * (5.0f64.sqrt() - 1.0));
    let (a, b) = (40e-6, -25e-6);
    let (s1, c1) = (w1 * t).sin_cos();
    let (s2, c2) = (w2 * t).sin_cos();
    [
        [a * c1 + b * c2, a * s1 - b * s2],
        [-a * w1 * s1 - b * w2 * s2, a * w1 * c1 - b * w2 * c2],
        [-a * w1 * w1 * c1 - b * w2 * w2 * c2, -a * w1 * w1 * s1 + b * w2 * w2 * s2],
    ]
}
fn wander(_: &Rotor, t: f64) -> [[f64; 2]; 3] {
    let mut o = [[0.0; 2]; 3];
    for n in 0..12 {
        let w = 2.0 * std::f64::consts::PI * (7.3 + 11.7 * (n as f64) + 0.31 * ((n * n) as f64));
        for a in 0..2 {
            let ph = (n * n * 7 + a * 13) as f64;
            let amp = 12e-6 / (1.0 + 0.25 * n as f64);
            o[0][a] += amp * (w * t + ph).cos();
            o[1][a] -= amp * w * (w * t + ph).sin();
            o[2][a] -= amp * w * w * (w * t + ph).cos();
        }
    }
    o
}
#[test]
fn explore() {
    use Hold::*;
    let pe = |r: &Rotor, h| r.config(Method::PredictionError, h);
    let noisy = Rotor { noise: (1e-7, 1e-2), samples: 4001, ..unbalanced() };
    for n in [(0., 0.), (1e-7, 1e-2)] {
        let lin = Rotor { currents: Currents::Ramping, noise: n, samples: 4001, ..unbalanced() };
        show(&format!("linear ramp {n:?}"), &lin, pe(&lin, Linear), &[1000, 2000, 4000]);
        show(&format!("linear ramp told {n:?}"), &lin, told(pe(&lin, Linear), (1e-7, 1e-2)), &[350, 2000, 4000]);
    }
    for (name, path) in [("circles", circles as Path), ("wander", wander)] {
        for n in [(0., 0.), (1e-7, 1e-2), (1e-6, 1e-2)] {
            for t in [false, true] {
                let r = Rotor { path, noise: n, samples: 10001, ..unbalanced() };
                let c = pe(&r, HeldBefore);
                show(&format!("{name} {n:?} told {t}"), &r, if t && n.0 > 0. { told(c, n) } else { c }, &[1000, 10000]);
            }
        }
    }
    for n in [(5e-6, 0.1), (2e-5, 0.1), (1e-5, 0.3), (5e-6, 0.5), (1e-7, 0.5), (2e-5, 1e-2), (3e-9, 1e-4), (2e-8, 1e-3)]
    {
        for seed in [1, 2] {
            let r = Rotor { noise: n, samples: 10001, seed, ..unbalanced() };
            show(&format!("noise {n:?} seed {seed}"), &r, pe(&r, HeldBefore), &[10000]);
        }
    }
    let mut sq = [[0.0; 3]; 4];
    let mut w = [0.0f64; 2];
    for seed in 1..41u64 {
        for (ti, t) in [(0., 0.), (1e-7, 1e-2)].into_iter().enumerate() {
            let ch = Rotor {
                change: Some((0.3, [1.8e-6 * 1.05, 2.0e-6, 2.2e-6])),
                seed: seed * 977,
                samples: 5001,
                ..noisy.clone()
            };
            let out = ch.identify(told(pe(&ch, HeldBefore), t));
            let first = out.iter().enumerate().skip(3000).find(|(_, o)| !o.valid).map(|(j, _)| j);
            let again = out.iter().enumerate().skip(first.unwrap_or(0)).find(|(_, o)| o.valid).map(|(j, _)| j);
            let l = ch.change.unwrap().1;
            let worst = out
                .iter()
                .enumerate()
                .skip(3000)
                .filter(|(_, o)| o.valid)
                .flat_map(|(j, o)| (0..3).map(move |k| (((o.lambda_hat[k] - l[k]) / o.lambda_std[k]).abs(), j)))
                .skip_while(|(_, j)| *j < first.unwrap_or(0))
                .fold((0.0, 0), |a, b| if b.0 > a.0 { b } else { a });
            w[ti] = w[ti].max(worst.0);
            if let Some(a) = again {
                for k in 0..3 {
                    sq[ti * 2][k] += ((out[a].lambda_hat[k] - l[k]) / out[a].lambda_std[k]).powi(2) / 40.0;
                    sq[ti * 2 + 1][k] += ((out[5000].lambda_hat[k] - l[k]) / out[5000].lambda_std[k]).powi(2) / 40.0;
                }
            }
            if seed < 6 {
                println!("step seed {seed} {t:?}: invalid {first:?} again {again:?} worst after {worst:.2?}");
            }
        }
    }
    println!(
        "step: rms error/std when valid again and at 0.5 s: not told {:?} {:?}; told {:?} {:?}; worst {w:?}",
        sq[0].map(f64::sqrt),
        sq[1].map(f64::sqrt),
        sq[2].map(f64::sqrt),
        sq[3].map(f64::sqrt)
    );
}
