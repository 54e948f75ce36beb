//! A million calls in random order with random arguments over several instances in turn: nothing crashes, hangs, panics,
//! or returns a number that is not finite; every error has exactly one message.

use std::time::{Duration, Instant};

use crate::support::Random;
use crate::support::abuse::Abuse;
use crate::support::abuse3::Abuse3;

/// Calls in all, unless the environment says otherwise. Debug builds, which are a tenth as fast, make fewer.
const CALLS: u64 = if cfg!(debug_assertions) { 100_000 } else { 1_000_000 };
/// Calls on one set of instances; the next set has its own seed.
const CALLS_OF_A_SEED: u64 = 2_000;

/// Makes the calls with a kind of importer.
macro_rules! a_million_calls {
    ($importer:ident) => {
        let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
        let calls = number("ABUSE_CALLS").unwrap_or(CALLS);
        let first = number("ABUSE_SEED").unwrap_or(1);
        let begin = Instant::now();
        let (mut made, mut served, mut refused, mut steps, mut longest) = (0, 0, 0, 0, Duration::ZERO);
        let mut instantiations = [0, 0];
        let mut seed = first;
        while made < calls {
            let mut abuse = $importer::new(Random::new(seed));
            // Shown if the test fails: `ABUSE_SEED` begins there.
            println!("seed {seed}");
            while abuse.calls < CALLS_OF_A_SEED.min(calls - made) {
                let before = Instant::now();
                abuse.step().expect("random bytes do not end");
                longest = longest.max(before.elapsed());
            }
            made += abuse.calls;
            served += abuse.served;
            refused += abuse.refused;
            instantiations = [0, 1].map(|at| instantiations[at] + abuse.instantiations[at]);
            steps += abuse.steps;
            seed += 1;
        }
        let [instances, without] = instantiations;
        println!("{made} calls: {served} OK, {refused} Error, {instances} instances made and {without} refused;");
        println!("{steps} steps; {:?}, the longest call {longest:?}", begin.elapsed());
        // Many calls succeed.
        assert!(served > made / 3 && steps > made / 20, "{made} calls, {served} served, {steps} steps");
    };
}

/// Fails if the finite check of fmi2GetReal is taken away, if a null pointer or a length is accepted, if a foreign GUID is
/// accepted, if fmi2GetFMUstate accepts a snapshot of another model, and if steps may begin anywhere: then it does not end.
#[test]
fn nothing_that_an_importer_does_breaks_an_instance() {
    a_million_calls!(Abuse);
}

/// As above, through FMI 3.0.
#[test]
fn nothing_that_an_importer_of_fmi_3_does_breaks_an_instance() {
    a_million_calls!(Abuse3);
}
