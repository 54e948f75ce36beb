//! Sampled signals: the result of a run.

use std::io::{self, BufWriter, Write};
use std::ops::Index;

/// One signal over the samples of a [`Recording`].
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Name, `element.variable`, for instance `plant.Y` or `estimator.lambdaHat[1]`.
    pub name: String,
    /// Unit as in the interface, for instance `m`; may be empty.
    pub unit: String,
    /// One value per sample, in this unit; Booleans are 0 and 1.
    pub values: Vec<f64>,
}

/// Signals sampled at common instants.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// The instants, in seconds.
    pub time_s: Vec<f64>,
    /// The signals, each as long as `time_s`.
    pub columns: Vec<Column>,
}

/// The values of the signal of this name, such as an output that every machine has.
///
/// # Panics
/// If there is none.
impl<N: AsRef<str>> Index<N> for Recording {
    type Output = [f64];

    fn index(&self, name: N) -> &[f64] {
        self.get(name.as_ref()).unwrap_or_else(|| panic!("{} is not recorded", name.as_ref()))
    }
}

/// A name with its unit, if it has one: `plant.Y [m]`.
pub fn with_unit(name: String, unit: &str) -> String {
    if unit.is_empty() || unit == "1" { name } else { format!("{name} [{unit}]") }
}

impl Recording {
    /// The values of the signal of this name, if there is one.
    pub fn get(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|column| column.name == name).map(|column| column.values.as_slice())
    }

    /// Writes CSV: a header with names and units, for instance `plant.Y [m]`, then one row per sample, with enough digits to read the
    /// same number again. Small whole numbers, such as Booleans and items, have no exponent.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn write_csv(&self, to: impl Write) -> io::Result<()> {
        let mut to = BufWriter::new(to);
        // Neither names nor numbers need quotes.
        write!(to, "time [s]")?;
        for column in &self.columns {
            write!(to, ",{}", with_unit(column.name.clone(), &column.unit))?;
        }
        writeln!(to)?;
        for (row, time_s) in self.time_s.iter().enumerate() {
            write!(to, "{time_s}")?;
            for column in &self.columns {
                match column.values[row] {
                    value if value.fract() == 0.0 && value.abs() < 1e6 => write!(to, ",{value}")?,
                    value => write!(to, ",{value:e}")?,
                }
            }
            writeln!(to)?;
        }
        to.flush()
    }
}
