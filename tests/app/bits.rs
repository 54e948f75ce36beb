//! The paper's simulation, bit for bit as recorded.
//!
//! The results are the same on every platform, so any difference is a change of the equations or of their order of evaluation.
//! After an intended change, `BITS=write cargo test --release --test app bits::` rewrites the file; its diff shows what has
//! changed, and by how much.

use crate::prelude::*;
use std::fmt::Write;

/// Samples in the file: the first ones, around the first estimates and around the update, and the last.
const SAMPLES: [usize; 9] = [0, 1, 2, 200, 208, 1000, 2000, 2001, 4000];

/// Fails if, for instance, the sub-step of the plant or the order of a sum changes.
#[test]
fn the_papers_simulation_is_unchanged_to_the_bit() {
    let recording = scenario_and_run("paper", &[]).1.recording;
    let mut text = String::from("signal");
    for k in SAMPLES {
        let _ = write!(text, ",{} s", recording.time_s[k]);
    }
    for column in &recording.columns {
        let _ = write!(text, "\n{}", column.name);
        for k in SAMPLES {
            let _ = write!(text, ",{:?}", column.values[k]);
        }
    }
    text.push('\n');
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/paper-bits.csv");
    if std::env::var("BITS").is_ok_and(|what| what == "write") {
        std::fs::write(&path, &text).expect("a place to write");
    }
    let before = std::fs::read_to_string(&path).expect("the file");
    let changed: Vec<_> = before.lines().zip(text.lines()).filter(|(a, b)| a != b).collect();
    let few = &changed[..changed.len().min(3)];
    assert!(changed.is_empty(), "{} signals have moved, among them\n{few:#?}", changed.len());
    assert_eq!(before.lines().count(), text.lines().count(), "there are other signals than before");
}
