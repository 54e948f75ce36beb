//! Rows that form one array in FMI 3.0.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
#[cfg(feature = "fmi3")]
use std::sync::Arc;

use crate::variable::{Type, Variable};

/// A variable of FMI 3.0: one row, or the rows of an array.
pub(crate) struct Group<'v> {
    /// Value reference: the index of the first row.
    pub reference: usize,
    /// Name, without the index of an element.
    pub name: &'v str,
    /// The rows.
    pub rows: &'v [Variable],
    /// Whether it is an array.
    pub is_array: bool,
}

impl<'v> Group<'v> {
    /// The first row; all have its attributes.
    pub fn first(&self) -> &'v Variable {
        &self.rows[0]
    }

    /// Description, with `k` in place of element numbers in the descriptions of the rows.
    pub fn description(&self) -> Cow<'v, str> {
        let first = &self.first().description;
        if self.rows.iter().all(|row| row.description == *first) {
            return Cow::Borrowed(first);
        }
        let mut general = (1..).zip(self.rows).map(|(number, row)| without_number(&row.description, number));
        let one = general.next().unwrap_or_default();
        if general.all(|other| other == one) { Cow::Owned(one) } else { Cow::Borrowed(first) }
    }
}

/// A text with `k` in place of every number of that value.
fn without_number(text: &str, number: usize) -> String {
    let number = number.to_string();
    let mut general = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find(|letter: char| letter.is_ascii_digit()) {
        let length = rest[at..].find(|letter: char| !letter.is_ascii_digit()).unwrap_or(rest.len() - at);
        general += &rest[..at];
        let found = &rest[at..at + length];
        general += if found == number { "k" } else { found };
        rest = &rest[at + length..];
    }
    general + rest
}

/// All variables in order. With `arrays`, consecutive rows `x[1]`, `x[2]`, … with the same attributes are one variable `x`. States and
/// their derivatives are arrays of the same length, or none.
pub(crate) fn groups(variables: &[Variable], arrays: bool) -> Vec<Group<'_>> {
    // Names not available for arrays.
    let mut taken: HashSet<&str> = variables.iter().map(|variable| variable.name.as_ref()).chain(["time"]).collect();
    loop {
        let groups = grouped(variables, |name| arrays && !taken.contains(name));
        let length = |group: &Group<'_>| (group.is_array, group.rows.len());
        let states = groups.iter().filter(|group| group.first().state);
        let states: HashMap<&str, &Group<'_>> =
            states.flat_map(|group| group.rows.iter().map(move |row| (row.name.as_ref(), group))).collect();
        let pairs = groups.iter().filter_map(|of| Some([of, *states.get(of.first().derivative_of.as_deref()?)?]));
        let unequal = pairs.filter(|[derivative, state]| length(derivative) != length(state)).flatten();
        let split: Vec<&str> = unequal.filter(|group| group.is_array).map(|group| group.name).collect();
        if split.is_empty() {
            return groups;
        }
        taken.extend(split);
    }
}

fn grouped<'v>(variables: &'v [Variable], may_be_array: impl Fn(&str) -> bool) -> Vec<Group<'v>> {
    let mut groups = Vec::new();
    let mut at = 0;
    while at < variables.len() {
        let rest = &variables[at..];
        let array = array(rest).filter(|(name, _)| may_be_array(name));
        let (name, count) = array.unwrap_or((rest[0].name.as_ref(), 1));
        groups.push(Group { reference: at, name, rows: &rest[..count], is_array: array.is_some() });
        at += count;
    }
    groups
}

/// The number of elements of each value reference; 0 for an element within an array.
#[cfg(feature = "fmi3")]
pub(crate) fn elements_of(variables: &[Variable]) -> Arc<[u32]> {
    let mut elements = vec![0; variables.len()];
    for group in groups(variables, true) {
        elements[group.reference] = group.rows.len() as u32;
    }
    elements.into()
}

/// Name and length of the array at the start of the rows, if any.
fn array(rows: &[Variable]) -> Option<(&str, usize)> {
    let name = rows[0].name.strip_suffix("[1]")?;
    let belongs =
        |(number, row): &(usize, &Variable)| is_element(&row.name, name, *number) && alike(&rows[0], row, *number);
    let count = (1..).zip(rows).take_while(belongs).count();
    (count > 1).then_some((name, count))
}

fn is_element(name: &str, array: &str, number: usize) -> bool {
    let index = name.strip_prefix(array).and_then(|rest| rest.strip_prefix('[')?.strip_suffix(']'));
    index.is_some_and(|index| index == number.to_string())
}

/// Whether the first row and that of the given number can be elements of one array.
fn alike(first: &Variable, other: &Variable, number: usize) -> bool {
    let attributes = |row: &Variable| (row.causality, row.variability, row.state, row.exact);
    let derivatives = match (&first.derivative_of, &other.derivative_of) {
        (None, None) => true,
        (Some(one), Some(state)) => one.strip_suffix("[1]").is_some_and(|array| is_element(state, array, number)),
        _ => false,
    };
    attributes(first) == attributes(other)
        && derivatives
        && with_start_of(&first.data_type, &other.data_type) == other.data_type
}

/// A type with the start value of another.
fn with_start_of(data_type: &Type, other: &Type) -> Type {
    let mut changed = data_type.clone();
    match (&mut changed, other) {
        (Type::Real { start, .. }, Type::Real { start: new, .. }) => *start = *new,
        (Type::Integer { start, .. }, Type::Integer { start: new, .. })
        | (Type::Enumeration { start, .. }, Type::Enumeration { start: new, .. }) => *start = *new,
        (Type::Boolean { start }, Type::Boolean { start: new }) => *start = *new,
        (Type::String { start }, Type::String { start: new }) => start.clone_from(new),
        _ => {}
    }
    changed
}
