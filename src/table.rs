//! A table of results, to be printed or shown on a page.

/// A table of results.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Table {
    /// Heading.
    pub title: String,
    /// A sentence or two below it; may be empty.
    pub note: String,
    /// Names of the columns.
    pub head: Vec<String>,
    /// Rows, each as long as `head`; the first cell names the row.
    pub rows: Vec<Vec<String>>,
}
