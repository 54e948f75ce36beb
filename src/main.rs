//! The command `magnetic-bearing`.

fn main() {}
