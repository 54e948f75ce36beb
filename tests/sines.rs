//! Sums of sines over a sliding window against their definition.

use std::f64::consts::PI;

use magnetic_bearing::model::sines::{HARMONICS, LANES, SineSums, SlidingSines, SlidingSinesState};

/// Rounding, relative to the sum of magnitudes.
const ROUNDING: f64 = 1e-14;

/// Windows whose length is a multiple of the hop or not, with hops of one sample and of many.
const INTERVALS: [usize; 11] = [8, 9, 25, 49, 50, 74, 173, 200, 399, 1000, 2021];

fn hop(intervals: usize) -> usize {
    (intervals / 25).max(1)
}

/// A signal without any pattern that a window could hide.
fn sample(j: usize) -> [f64; LANES] {
    std::array::from_fn(|lane| {
        let mixed = (j as u64 * 7 + lane as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (mixed >> 11) as f64 / (1_u64 << 53) as f64 + lane as f64
    })
}

fn direct(nodes: &[[f64; LANES]]) -> SineSums {
    let intervals = nodes.len() + 1;
    let mut sums = [[0.0; HARMONICS]; LANES];
    for (node, x) in (1..).zip(nodes) {
        for (sums, x) in sums.iter_mut().zip(x) {
            for (l, sum) in (1..).zip(sums) {
                *sum += (PI * ((l * node) % (2 * intervals)) as f64 / intervals as f64).sin() * x;
            }
        }
    }
    sums
}

/// Feeds samples so that a hop ends with the last one, and returns the sums then.
fn feed(sines: &SlidingSines, state: &mut SlidingSinesState, hop: usize, samples: &[[f64; LANES]]) -> SineSums {
    for (left, x) in (0..samples.len()).rev().zip(samples) {
        sines.push(state, hop - 1 - left % hop, x);
    }
    sines.sums(state)
}

#[test]
fn sums_are_those_of_the_definition() {
    for intervals in INTERVALS {
        let hop = hop(intervals);
        let sines = SlidingSines::new(intervals, hop);
        let mut state = sines.start();
        let mut nodes: Vec<_> = (0..intervals - 1).map(sample).collect();
        let mut sums = feed(&sines, &mut state, hop, &nodes);
        for window in 0..60 {
            let last = &nodes[nodes.len() - (intervals - 1)..];
            let size: f64 = last.iter().map(|x| x[LANES - 1]).sum();
            for (sum, wanted) in sums.as_flattened().iter().zip(direct(last).as_flattened()) {
                let off = (sum - wanted).abs() / size;
                assert!(off < ROUNDING, "N = {intervals}, window {window}: off by {off:.1e} of the sum of magnitudes");
            }
            let more: Vec<_> = (nodes.len()..nodes.len() + hop).map(sample).collect();
            sums = feed(&sines, &mut state, hop, &more);
            nodes.extend(more);
        }
    }
}

/// Whatever was before, the sums are to the bit those of a state that has seen nothing but the window.
#[test]
fn what_has_left_leaves_nothing_behind() {
    for intervals in INTERVALS {
        let hop = hop(intervals);
        let sines = SlidingSines::new(intervals, hop);
        let window: Vec<_> = (0..intervals - 1).map(sample).collect();
        let wanted = feed(&sines, &mut sines.start(), hop, &window);
        let huge: Vec<_> = (0..3 * intervals + 1).map(|j| sample(j).map(|x| 1e12 * x)).collect();

        let mut state = sines.start();
        feed(&sines, &mut state, hop, &huge);
        // A hop in between, so that no block holds samples of both.
        let longer: Vec<_> = (0..hop).map(sample).chain(window.iter().copied()).collect();
        assert_eq!(feed(&sines, &mut state, hop, &longer), wanted, "N = {intervals}");

        // In the middle of a block.
        for x in huge.iter().take(hop / 2) {
            sines.push(&mut state, 0, x);
        }
        state.clear();
        assert_eq!(feed(&sines, &mut state, hop, &window), wanted, "N = {intervals}");
    }
}

#[test]
fn a_state_of_another_window_is_refused() {
    let sines = SlidingSines::new(200, 8);
    assert!(sines.accepts(&sines.start()));
    assert!(!sines.accepts(&SlidingSines::new(250, 8).start()));
}
