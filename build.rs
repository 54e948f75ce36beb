//! Tells `src/main.rs` where git logs the checked-out commits, so that the program can report its commit. Only the program
//! depends on that file: a new commit does not rebuild the library.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let folder = PathBuf::from(env::var_os("OUT_DIR").expect("cargo says where to write"));
    let none = folder.join("no-commit");
    fs::write(&none, "").expect("the folder can be written to");
    let log = log().unwrap_or(none);
    println!("cargo::rustc-env=COMMIT_LOG={}", log.display());
}

/// Git's log of checked-out commits, if this is the root of a repository.
fn log() -> Option<PathBuf> {
    // A copy of the sources inside another repository must not report the commits of that one.
    Path::new(".git").exists().then_some(())?;
    let output = Command::new("git").args(["rev-parse", "--git-path", "logs/HEAD"]).output().ok()?;
    let path = String::from_utf8(output.stdout).ok()?;
    let path = fs::canonicalize(path.trim()).ok()?;
    (output.status.success() && path.is_file()).then_some(path)
}
