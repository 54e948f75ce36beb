//! A table of sampled signals: what a run leaves behind.

/// One signal over the samples of a [`Recording`].
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Name, `element.variable`, for instance `plant.Y` or `estimator.lambdaHat[1]`.
    pub name: String,
    /// Unit as in the interface, for instance `m`; empty where there is none.
    pub unit: String,
    /// One value per sample, in that unit; Booleans are 0 and 1.
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

impl Recording {
    /// The values of the signal of that name, if there is one.
    pub fn get(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|column| column.name == name).map(|column| column.values.as_slice())
    }
}
