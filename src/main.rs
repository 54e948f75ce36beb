//! The command `magnetic-bearing`.

use std::process::ExitCode;

fn main() -> ExitCode {
    magnetic_bearing::app::cli::main()
}
