//! Whirl of the default spindle on springs, computed in Python with numpy, which agrees with ROSS.

/// Speed in rpm; whirl frequencies in Hz from the most backward to the most forward; response at A and at B, in µm and rad.
pub type Row = (f64, [f64; 4], Option<[[f64; 2]; 2]>);

/// Stiffness of both bearings, in N/m; the frequencies are without damping.
pub const STIFFNESS_N_M: f64 = 2e6;
/// Damping of both bearings for the response, in N·s/m.
pub const DAMPING_NS_M: f64 = 200.0;
/// Unbalances for the response: magnitude in kg·m, angle in rad, position in m.
pub const UNBALANCES: [[f64; 3]; 2] = [[8e-5, 0.7, -0.08], [5e-5, -1.9, 0.10]];

pub const TABLE: [Row; 4] = [
    (0.0, [-109.635625, -90.039217, 90.039217, 109.635625], None),
    (3000.0, [-106.863871, -89.731257, 90.276580, 112.568549], Some([[4.042961, 0.552840], [1.795886, -1.628717]])),
    (6000.0, [-104.282581, -89.323290, 90.463459, 115.642412], Some([[15.411339, -2.659019], [50.748982, -2.406197]])),
    (12000.0, [-99.866442, -88.030705, 90.736268, 122.160879], Some([[16.941726, -2.354873], [15.347813, 1.258659]])),
];
