//! The example `bouncing_ball` as the library that goes into its FMU.

#[path = "../bouncing_ball.rs"]
#[allow(dead_code, reason = "`main` belongs to the program")]
mod bouncing_ball;
