//! A table of results, for the terminal or a page.

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

impl Table {
    /// A table from its fields.
    pub fn new(
        title: impl Into<String>,
        note: impl Into<String>,
        head: impl IntoIterator<Item: Into<String>>,
        rows: impl IntoIterator<Item = Vec<String>>,
    ) -> Self {
        let head = head.into_iter().map(Into::into).collect();
        Self { title: title.into(), note: note.into(), head, rows: rows.into_iter().collect() }
    }
}
