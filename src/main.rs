//! The command `magnetic-bearing`.

use std::process::ExitCode;

/// The log of the commits that were checked out, one in each line, the present one last; empty if there is none. It is read
/// here and not in the library, whose bytes do not depend on the commit.
const LOG: &[u8] = include_bytes!(env!("COMMIT_LOG"));

/// Digits of a commit that are shown.
const DIGITS: usize = 12;

/// The commit of the last line, which begins with the former commit, a blank, and the present one.
const COMMIT: Option<[u8; DIGITS]> = {
    let mut line = LOG.len().saturating_sub(1);
    while line > 0 && LOG[line - 1] != b'\n' {
        line -= 1;
    }
    let mut at = line;
    while at < LOG.len() && LOG[at] != b' ' {
        at += 1;
    }
    if at + DIGITS < LOG.len() {
        let mut digits = [0; DIGITS];
        let mut digit = 0;
        while digit < DIGITS {
            digits[digit] = LOG[at + 1 + digit];
            digit += 1;
        }
        Some(digits)
    } else {
        None
    }
};

fn main() -> ExitCode {
    let commit = COMMIT.as_ref().and_then(|digits| std::str::from_utf8(digits).ok());
    magnetic_bearing::cli::main(commit)
}
