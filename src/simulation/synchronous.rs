//! Rotation-synchronous signals.

use super::recording::Recording;

/// Length in s of the interval for synchronous forces: whole periods of 30, 40, 50 and 60 Hz.
pub const INTERVAL_S: f64 = 0.1;

/// Amplitude in a signal of harmonic n of the rotor angle, over whole revolutions.
pub fn harmonic(signal: &[f64], theta: &[f64], n: f64) -> f64 {
    // Trapezoidal rule over the angle, so that the speed may vary.
    let (mut re, mut im, mut turned) = (0.0, 0.0, 0.0);
    for (x, angle) in signal.windows(2).zip(theta.windows(2)) {
        let width = angle[1] - angle[0];
        re += 0.5 * width * (x[0] * (n * angle[0]).cos() + x[1] * (n * angle[1]).cos());
        im += 0.5 * width * (x[0] * (n * angle[0]).sin() + x[1] * (n * angle[1]).sin());
        turned += width;
    }
    if turned == 0.0 { 0.0 } else { 2.0 * re.hypot(im) / turned.abs() }
}

/// Amplitudes of the synchronous magnet forces of a spindle, in N, over the interval that ends at `end_s` in s: along y and z of A, then
/// of B; none if the recording does not cover the interval.
pub fn forces(recording: &Recording, end_s: f64) -> Option<[f64; 4]> {
    let (time_s, theta) = (&recording.time_s, recording.get("plant.theta")?);
    if end_s < INTERVAL_S - 1e-9 || end_s > time_s.last()? + 1e-9 {
        return None;
    }
    let at = |at_s: f64| time_s.partition_point(|time_s| *time_s < at_s - 1e-9);
    let (from, to) = (at(end_s - INTERVAL_S), at(end_s).min(time_s.len().checked_sub(1)?));
    let mut forces = [0.0; 4];
    for (force, name) in forces.iter_mut().zip(["A.FY", "A.FZ", "B.FY", "B.FZ"]) {
        *force = harmonic(&recording.get(&format!("plant.{name}"))?[from..=to], &theta[from..=to], 1.0);
    }
    Some(forces)
}
