//! Contours of holes as tables of points: what is read, what is refused and in which words.

use magnetic_bearing::control::reference::HARMONICS;
use magnetic_bearing::simulation::contour::{Fit, read};

/// A table of so many points of an ellipse of 30 µm by 70 µm about (1, −2) µm, in the units of `head`.
fn table(head: &str, count: usize, angle: f64, length: f64) -> String {
    let mut text = head.to_owned();
    for k in 0..count {
        // No two distances between points are alike.
        let theta = std::f64::consts::TAU * (k as f64 + 0.3 * (k as f64).sin()) / count as f64;
        let (y, z) = (1e-6 + 30e-6 * theta.cos(), -2e-6 + 70e-6 * theta.sin());
        text += &format!("\n{},{},{}", theta / angle, y / length, z / length);
    }
    text
}

/// Fails if points are taken to lie at equal angles, or a unit is taken for another.
#[test]
fn points_at_any_angles_and_in_any_unit_give_their_series() {
    let degree = std::f64::consts::PI / 180.0;
    for (head, angle, length) in [
        ("theta [deg],Y [um],Z [um]", degree, 1e-6),
        ("theta [rad], Y [m], Z [m]", 1.0, 1.0),
        ("theta [deg],Y [mm],Z [µm]", degree, 1e-3),
    ] {
        let text = table(head, 48, angle, length);
        let text = if head.contains("mm") {
            // Z is in another unit than Y.
            text.lines()
                .map(|line| match line.rsplit_once(',').map(|(rest, z)| (rest, z.parse::<f64>())) {
                    Some((rest, Ok(z))) => format!("{rest},{}\n", z * 1e3),
                    _ => format!("{line}\n"),
                })
                .collect()
        } else {
            text
        };
        let Fit { contour, largest_m } = read(&text).expect(head);
        assert!(largest_m < 1e-15, "{head}: {largest_m}");
        let near = |what: &str, value: f64, wanted: f64| {
            assert!((value - wanted).abs() < 1e-15, "{head}: {what} is {value}, not {wanted}");
        };
        near("centre y", contour.centre_m[0], 1e-6);
        near("centre z", contour.centre_m[1], -2e-6);
        near("cosine of y", contour.cos_y_m[0], 30e-6);
        near("sine of z", contour.sin_z_m[0], 70e-6);
        near("second cosine of y", contour.cos_y_m[1], 0.0);
    }
}

/// A corner is more than the series can follow; it says by how much it strays.
#[test]
fn what_the_series_cannot_follow_is_told() {
    let mut text = "theta [deg],Y [um],Z [um]".to_owned();
    for k in 0..360 {
        let y = if k < 180 { 40.0 } else { -40.0 };
        text += &format!("\n{k},{y},0");
    }
    let strays_m = read(&text).expect("a series").largest_m;
    assert!((1e-5..4e-5).contains(&strays_m), "{strays_m} m");
}

#[test]
fn tables_that_make_no_sense_are_refused_by_name() {
    let good = table("theta [deg],Y [um],Z [um]", 48, 0.0175, 1e-6);
    let few = format!("at least {} points", 2 * HARMONICS + 1);
    let half: String = {
        // Points over half a turn leave the other half open.
        let lines = (0..60).map(|k| format!("\n{},1,1", 0.01 * f64::from(k)));
        "theta [deg],Y [um],Z [um]".to_owned() + &lines.collect::<String>()
    };
    for (text, words) in [
        (good.replace("theta [deg]", "angle [deg]"), "there is no column theta with its unit"),
        (good.replace("Y [um]", "Y"), "there is no column Y with its unit"),
        (good.replace("Z [um]", "Z [kg]"), "the unit kg is none of"),
        (good.lines().take(9).collect::<Vec<_>>().join("\n"), few.as_str()),
        (half, "the angles leave gaps"),
        (format!("{good}\n1,2,much"), "row 49: \"much\" is no number"),
        (format!("{good}\n1,2,NaN"), "row 49: NaN is not finite"),
        (format!("{good}\n1,2"), "found record with 2 fields"),
        (String::new(), "there is no column theta"),
    ] {
        let refused = read(&text).expect_err(words);
        assert!(refused.contains(words), "{refused}");
    }
}
