//! Contours of holes: a closed curve given by points becomes a Fourier series.
//!
//! A table is CSV with the header `theta [deg],Y [um],Z [um]`, or with other units (`rad`, `m`, `mm`, `µm`): the angle of the spindle
//! and the position of its centre. The angles need not be equally spaced; the series minimises the sum of squared distances.

use nalgebra::{DMatrix, DVector};

use crate::bearing::array;
use crate::control::reference::{Contour, HARMONICS};
use crate::simulation::scenario::from_unit;
use fmu_export::unit::{METRE, RADIAN, Unit};

/// Unknowns per axis: the mean, a cosine and a sine per harmonic.
const UNKNOWNS: usize = 2 * HARMONICS + 1;
/// Smallest ratio of singular values at which the points determine all harmonics.
const LEAST_RATIO: f64 = 1e-6;

/// A fitted contour.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The series.
    pub contour: Contour,
    /// Largest distance of a point from the series, in m.
    pub largest_m: f64,
}

/// Reads a table and fits its points.
///
/// # Errors
/// The first invalid part of the table, with the expected form; those of [`fit`].
pub fn read(text: &str) -> Result<Fit, String> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let head = reader.headers().map_err(|error| error.to_string())?.clone();
    let wanted = "expected the header theta [deg],Y [um],Z [um]";
    let column = |name: &str, unit: Unit| -> Result<(usize, f64), String> {
        let found = head.iter().enumerate().find_map(|(index, cell)| {
            let (title, unit) = cell.split_once('[')?;
            (title.trim() == name).then_some((index, unit.trim_end_matches(']').trim().to_owned()))
        });
        let (index, given) = found.ok_or_else(|| format!("there is no column {name} with its unit: {wanted}"))?;
        Ok((index, from_unit(1.0, &given, &unit)?))
    };
    let columns = [column("theta", RADIAN)?, column("Y", METRE)?, column("Z", METRE)?];
    let mut points: Vec<[f64; 3]> = Vec::new();
    for (row, record) in (1..).zip(reader.records()) {
        let record = record.map_err(|error| error.to_string())?;
        let mut point = [0.0; 3];
        for (value, (index, factor)) in point.iter_mut().zip(columns) {
            let cell = record.get(index).unwrap_or_default();
            *value = match cell.parse::<f64>() {
                Ok(number) if number.is_finite() => number * factor,
                Ok(_) => return Err(format!("row {row}: {cell} is not finite")),
                Err(_) => return Err(format!("row {row}: {cell:?} is not a number")),
            };
        }
        points.push(point);
    }
    fit(&points)
}

/// Fits the series to points `[θ, Y, Z]` in rad and m.
///
/// # Errors
/// Too few points, or points that do not determine the series.
pub fn fit(points: &[[f64; 3]]) -> Result<Fit, String> {
    let wanted = format!("expected at least {UNKNOWNS} points around the curve");
    if points.len() < UNKNOWNS {
        return Err(format!("{} points: {wanted}", points.len()));
    }
    let basis = |theta: f64, column: usize| match column {
        0 => 1.0,
        _ if column <= HARMONICS => libm::cos(column as f64 * theta),
        _ => libm::sin((column - HARMONICS) as f64 * theta),
    };
    let matrix = DMatrix::from_fn(points.len(), UNKNOWNS, |row, column| basis(points[row][0], column));
    let svd = matrix.svd(true, true);
    if svd.singular_values.min() < LEAST_RATIO * svd.singular_values.max() {
        return Err(format!("the angles leave gaps: {wanted}"));
    }
    let solve = |axis: usize| {
        let values = DVector::from_fn(points.len(), |row, _| points[row][axis]);
        svd.solve(&values, 0.0).map_err(str::to_owned)
    };
    let (y, z) = (solve(1)?, solve(2)?);
    let cos = |x: &DVector<f64>| array::from_fn(|n| x[1 + n]);
    let sin = |x: &DVector<f64>| array::from_fn(|n| x[1 + HARMONICS + n]);
    let contour =
        Contour { centre_m: [y[0], z[0]], cos_y_m: cos(&y), sin_y_m: sin(&y), cos_z_m: cos(&z), sin_z_m: sin(&z) };
    let distance = |[theta, y, z]: &[f64; 3]| {
        let [[at_y, ..], [at_z, ..]] = contour.at(*theta);
        libm::hypot(at_y - y, at_z - z)
    };
    let largest_m = points.iter().map(distance).fold(0.0, f64::max);
    Ok(Fit { contour, largest_m })
}
