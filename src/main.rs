//! The command `magnetic-bearing`.

use std::process::ExitCode;

/// The log of checked-out commits, one per line, the current one last; empty if there is none. Not in the library, so that its
/// bytes do not depend on the commit.
const LOG: &[u8] = include_bytes!(env!("COMMIT_LOG"));

/// Number of digits of a commit to show.
const DIGITS: usize = 12;

/// The commit of the last line, which begins with the previous commit, a blank, and the current one.
const COMMIT: Option<[u8; DIGITS]> = {
    let mut line = LOG.len().saturating_sub(1);
    while line > 0 && LOG[line - 1] != b'\n' {
        line -= 1;
    }
    let mut rest = LOG.split_at(line).1;
    while let [letter, after @ ..] = rest {
        rest = after;
        if *letter == b' ' {
            break;
        }
    }
    rest.first_chunk().copied()
};

fn main() -> ExitCode {
    let commit = COMMIT.as_ref().and_then(|digits| std::str::from_utf8(digits).ok());
    magnetic_bearing::cli::main(commit)
}
