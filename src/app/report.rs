//! A run as one page of HTML that needs nothing else: tables, plots, parameters.

use crate::app::recording::Recording;

/// What the page shows. Start from [`Report::new`] and fill in what there is.
#[derive(Clone, Debug)]
pub struct Report<'a> {
    /// Heading.
    pub title: String,
    /// What the run is about; blank lines part paragraphs.
    pub description: String,
    /// The command that makes this page.
    pub command: String,
    /// Why the run ended early, if it did.
    pub message: Option<String>,
    /// The signals, with columns named `element.variable`.
    pub recording: &'a Recording,
    /// Results in numbers.
    pub tables: Vec<Table>,
    /// Every parameter of the run.
    pub parameters: Vec<Parameter>,
    /// When the controller was to take the estimate, in seconds; `None` where that is not planned by time.
    pub update_s: Option<f64>,
    /// The true λ of the three magnets, in N·m²/A², where it is known.
    pub truth: Option<[f64; 3]>,
    /// The estimators to compare.
    pub methods: Vec<Method>,
    /// Whether the run repeats the paper's, so that captions name the figures they redraw.
    pub paper: bool,
}

impl<'a> Report<'a> {
    /// A report on `recording` with nothing but a title.
    pub fn new(title: &str, recording: &'a Recording) -> Report<'a> {
        Report {
            title: title.into(),
            description: String::new(),
            command: String::new(),
            message: None,
            recording,
            tables: Vec::new(),
            parameters: Vec::new(),
            update_s: None,
            truth: None,
            methods: Vec::new(),
            paper: false,
        }
    }
}

/// An estimator whose λ̂ stands in the columns `element.lambdaHat[1..3]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Method {
    /// Name of the element, for instance `paperLiteral`.
    pub element: String,
    /// What it is, in words.
    pub label: String,
}

impl From<&str> for Method {
    /// An estimator that goes by the name of its element.
    fn from(element: &str) -> Method {
        Method { element: element.into(), label: element.into() }
    }
}

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

/// A parameter of the run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parameter {
    /// The element it belongs to.
    pub group: String,
    /// Name as in the interface.
    pub name: String,
    /// Value with unit.
    pub value: String,
    /// What it is.
    pub description: String,
}

/// The page.
pub fn page(report: &Report) -> String {
    let _ = report;
    String::new()
}
