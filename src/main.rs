//! The command `magnetic-bearing`.
use magnetic_bearing::app::{scenario::Scenario, simulate};
fn main() {
    for name in std::env::args().skip(1) {
        let scenario = Scenario::open(std::path::Path::new(&name)).unwrap_or_else(|e| panic!("{e}"));
        let t = std::time::Instant::now();
        let run = simulate::run(&scenario).unwrap_or_else(|e| panic!("{e}"));
        println!("{name} {:?} {:?} {:#?}", t.elapsed(), run.fault, run.messages);
        let truth: Vec<f64> = (1..4).map(|k| scenario.value("plant", &format!("lambda[{k}]")).unwrap().as_f64()).collect();
        for e in scenario.elements.iter().skip(2) {
            for at in [350, 1000, 1001,2000, 4000] {
                let err: Vec<f64> = (0..3).map(|k| 100.0*(run.recording.get(&format!("{}.lambdaHat[{}]", e.name, k+1)).unwrap()[at]/truth[k]-1.0)).collect();
                println!("  {} {at}: {err:.4?} % unb {:?} res {:?} valid {:?}", e.name, run.recording.get(&format!("{}.unbalance.magnitude", e.name)).unwrap()[at],run.recording.get(&format!("{}.residual", e.name)).unwrap()[at],run.recording.get(&format!("{}.valid", e.name)).unwrap()[at]);
            }
        }
        for (what, from, to) in [("before",1600,2000),("after",3600,4000)] {
            for (y, r, p) in [("plant.Y","controller.reference.Y","controller.pYHat"),("plant.Z","controller.reference.Z","controller.pZHat")] {
                let (a,b,c) = (run.recording.get(y).unwrap(), run.recording.get(r).unwrap(), run.recording.get(p).unwrap());
                let e = (from..to).map(|k| (a[k]-b[k]).abs()).fold(0.0, f64::max);
                let hi = (from..to).map(|k| c[k]).fold(f64::MIN, f64::max); let lo=(from..to).map(|k| c[k]).fold(f64::MAX, f64::min);
                println!("  {what} {y} e {:.3} um  p swing {:.2} N", e*1e6, hi-lo);
            }
        }
    }
}
