//! Interleaved timing: candidates run in turn for a short time, round after round, so that other load on the machine affects all alike.
//! Ratios are taken within a round.

use std::time::Instant;

pub struct Candidate<'a> {
    pub name: String,
    /// Does the work this number of times.
    pub work: Box<dyn FnMut(u32) + 'a>,
    /// Repetitions per round.
    pub times: u32,
    /// The candidate that ratios refer to.
    pub peer: Option<usize>,
}

/// A candidate; `times` per round should take some hundred microseconds.
pub fn candidate<'a>(name: impl Into<String>, times: u32, work: impl FnMut(u32) + 'a) -> Candidate<'a> {
    Candidate { name: name.into(), work: Box::new(work), times, peer: None }
}

impl<'a> Candidate<'a> {
    /// Sets the candidate that ratios refer to.
    pub fn beside(mut self, peer: usize) -> Self {
        self.peer = Some(peer);
        self
    }
}

fn quartiles(values: &[f64]) -> [f64; 3] {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    [0.25, 0.5, 0.75].map(|share| sorted[((sorted.len() - 1) as f64 * share).round() as usize])
}

/// A time in nanoseconds, with its unit.
pub fn shown(nanoseconds: f64) -> String {
    match nanoseconds {
        ns if ns < 1e3 => format!("{ns:.1} ns"),
        ns if ns < 1e6 => format!("{:.2} µs", ns / 1e3),
        ns => format!("{:.2} ms", ns / 1e6),
    }
}

/// Times all candidates in turn and prints medians, quartiles, and ratios with their quartiles. Returns the medians in ns.
pub fn table(title: &str, rounds: usize, mut candidates: Vec<Candidate>) -> Vec<f64> {
    for candidate in &mut candidates {
        (candidate.work)(candidate.times);
    }
    let mut spent = vec![Vec::with_capacity(rounds); candidates.len()];
    for _ in 0..rounds {
        for (candidate, spent) in candidates.iter_mut().zip(&mut spent) {
            let since = Instant::now();
            (candidate.work)(candidate.times);
            spent.push(since.elapsed().as_nanos() as f64 / f64::from(candidate.times));
        }
    }
    println!("\n| {title} | median | quartiles | ratio | its quartiles | beside |\n|---|---:|---|---:|---|---|");
    let medians: Vec<f64> = spent.iter().map(|spent| quartiles(spent)[1]).collect();
    for (at, candidate) in candidates.iter().enumerate() {
        let [low, median, high] = quartiles(&spent[at]);
        print!("| {} | {} | {} … {} |", candidate.name, shown(median), shown(low), shown(high));
        match candidate.peer {
            Some(peer) => {
                let ratios: Vec<f64> = spent[at].iter().zip(&spent[peer]).map(|(own, other)| own / other).collect();
                let [low, ratio, high] = quartiles(&ratios);
                println!(" {ratio:.2} | {low:.2} … {high:.2} | {} |", candidates[peer].name);
            }
            None => println!(" | | |"),
        }
    }
    medians
}
