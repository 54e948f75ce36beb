//! Contours of holes as tables of points: reading and refusals.

use crate::prelude::*;
use magnetic_bearing::control::reference::HARMONICS;
use magnetic_bearing::simulation::contour::{Fit, read};
use magnetic_bearing::simulation::scenario::built_in;

/// A table of `count` points of an ellipse of 30 µm by 70 µm about (1, −2) µm, in the units of `head`.
fn table(head: &str, count: usize, [angle, length_y, length_z]: [f64; 3]) -> String {
    let row = |k: usize| {
        // Unevenly spaced points.
        let theta = std::f64::consts::TAU * (k as f64 + 0.3 * (k as f64).sin()) / count as f64;
        let (y, z) = (1e-6 + 30e-6 * theta.cos(), -2e-6 + 70e-6 * theta.sin());
        format!("\n{},{},{}", theta / angle, y / length_y, z / length_z)
    };
    head.to_owned() + &(0..count).map(row).collect::<String>()
}

/// Fails if points are assumed to lie at equal angles, or a unit is misread.
#[test]
fn points_at_any_angles_and_in_any_unit_give_their_series() {
    let degree = std::f64::consts::PI / 180.0;
    for (head, units) in [
        ("theta [deg],Y [um],Z [um]", [degree, 1e-6, 1e-6]),
        ("theta [rad], Y [m], Z [m]", [1.0, 1.0, 1.0]),
        ("theta [deg],Y [mm],Z [µm]", [degree, 1e-3, 1e-6]),
    ] {
        let Fit { contour, largest_m } = read(&table(head, 48, units)).expect(head);
        for (what, value, wanted) in [
            ("largest deviation", largest_m, 0.0),
            ("centre y", contour.centre_m[0], 1e-6),
            ("centre z", contour.centre_m[1], -2e-6),
            ("cosine of y", contour.cos_y_m[0], 30e-6),
            ("sine of z", contour.sin_z_m[0], 70e-6),
            ("second cosine of y", contour.cos_y_m[1], 0.0),
        ] {
            assert!((value - wanted).abs() < 1e-15, "{head}: {what} is {value}, not {wanted}");
        }
    }
}

/// An ellipse that begins 90° from the y axis has neither cosines along y nor sines along z.
#[test]
fn a_contour_may_begin_at_any_angle() {
    let folder = folder("contour");
    let row = |k: u32| {
        let (sin, cos) = f64::from(5 * k).to_radians().sin_cos();
        format!("\n{},{},{}", 5 * k, -50.0 * sin, 30.0 * cos)
    };
    write(&folder, "turned.csv", "theta [deg],Y [um],Z [um]".to_owned() + &(0..72).map(row).collect::<String>());
    let hole = built_in("hole".as_ref()).expect("a scenario of the program").replace("hole.csv", "turned.csv");
    write(&folder, "turned.toml", hole);
    let scenario = Scenario::open(&folder.join("turned.toml")).expect("a sound scenario");
    let sine_m = scenario.number("controller", "reference.sinY[1]");
    assert!((sine_m + 50e-6).abs() < 1e-12, "{sine_m} m");
}

/// The series cannot represent a corner; it reports its largest deviation.
#[test]
fn the_misfit_of_a_corner_is_reported() {
    let mut text = "theta [deg],Y [um],Z [um]".to_owned();
    for k in 0..360 {
        let y = if k < 180 { 40.0 } else { -40.0 };
        text += &format!("\n{k},{y},0");
    }
    let largest_m = read(&text).expect("a series").largest_m;
    assert!((1e-5..4e-5).contains(&largest_m), "{largest_m} m");
}

#[test]
fn invalid_tables_are_refused_with_the_reason() {
    let good = table("theta [deg],Y [um],Z [um]", 48, [0.0175, 1e-6, 1e-6]);
    let few = format!("at least {} points", 2 * HARMONICS + 1);
    // Points over half a revolution.
    let half: String = (0..60).map(|k| format!("\n{},1,1", 0.01 * f64::from(k))).collect();
    for (text, words) in [
        (good.replace("theta [deg]", "angle [deg]"), "there is no column theta with its unit"),
        (good.replace("Y [um]", "Y"), "there is no column Y with its unit"),
        (good.replace("Z [um]", "Z [kg]"), "the unit kg is not one of"),
        (good.lines().take(9).collect::<Vec<_>>().join("\n"), few.as_str()),
        (format!("theta [deg],Y [um],Z [um]{half}"), "the angles leave gaps"),
        (format!("{good}\n1,2,much"), "row 49: \"much\" is not a number"),
        (format!("{good}\n1,2,NaN"), "row 49: NaN is not finite"),
        (format!("{good}\n1,2"), "found record with 2 fields"),
        (String::new(), "there is no column theta"),
    ] {
        let refused = read(&text).expect_err(words);
        assert!(refused.contains(words), "{refused}");
    }
}
