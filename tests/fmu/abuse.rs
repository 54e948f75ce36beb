//! A million calls in random order with random arguments on several instances: nothing crashes, hangs, panics,
//! or returns a non-finite number; every error has exactly one message.

use std::time::{Duration, Instant};

use crate::prelude::*;
use crate::support::abuse::Abuse;
use crate::support::abuse3::Abuse3;

/// Total number of calls unless set by the environment; fewer in debug builds, which are ten times slower.
const CALLS: u64 = if cfg!(debug_assertions) { 100_000 } else { 1_000_000 };
/// Calls per set of instances; each set has its own seed.
const CALLS_OF_A_SEED: u64 = 2_000;

/// Makes the calls with an importer of this type.
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
            // If the test fails, start from it with `ABUSE_SEED`.
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
        assert!(served > made / 3 && steps > made / 20, "{made} calls, {served} served, {steps} steps");
    };
}

/// Fails if fmi2GetReal does not check for finite values, if a null pointer, an invalid length, a foreign GUID or a snapshot of
/// another model is accepted; never ends if steps may begin anywhere.
#[test]
fn random_calls_never_break_an_instance() {
    a_million_calls!(Abuse);
}

/// As above, through FMI 3.0.
#[test]
fn random_calls_of_fmi_3_never_break_an_instance() {
    a_million_calls!(Abuse3);
}
