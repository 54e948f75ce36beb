//! The table of a model: its variables with access to their values.

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::Arc;

use super::access::Place;
use super::{Causality, Dependency, Row, Type, Value, Variable};

/// The variables of a model with access to their values, by index. The index is the value reference.
pub struct Table<D> {
    /// The variables.
    pub variables: Arc<[Variable]>,
    places: Vec<(Option<Place<D>>, usize)>,
    items_only: Vec<bool>,
}

impl<D> Table<D> {
    /// The table with these rows.
    pub fn new(rows: Vec<Row<D>>) -> Self {
        let mut rows = rows;
        resolve(&mut rows);
        let from_parameters: Vec<bool> = rows.iter().map(|row| row.starts_from_parameters).collect();
        let items_only = rows.iter().map(|row| row.holds_items_only).collect();
        let (mut variables, places): (Vec<_>, Vec<_>) =
            rows.into_iter().map(|row| (row.variable, (row.place, row.place_index))).unzip();
        complete(&mut variables, &from_parameters);
        Self { variables: variables.into(), places, items_only }
    }

    /// Whether the variable takes values of that type.
    pub(crate) fn takes(&self, index: usize, value: &Value) -> bool {
        matches!(
            (&self.places[index].0, value),
            (None | Some(Place::Real(_)), Value::Real(_))
                | (Some(Place::Integer(_)), Value::Integer(_))
                | (Some(Place::Boolean(_)), Value::Boolean(_))
                | (Some(Place::String(_)), Value::String(_))
        )
    }

    /// Whether the field of a variable cannot hold a number that is none of an item.
    pub(crate) fn holds_items_only(&self, index: usize) -> bool {
        self.items_only[index]
    }

    /// The value of the variable with that index.
    pub fn get(&self, index: usize, values: &D) -> Value {
        let (place, element) = &self.places[index];
        match place {
            Some(Place::Real(place)) => Value::Real((place.get)(values, *element)),
            Some(Place::Integer(place)) => Value::Integer((place.get)(values, *element)),
            Some(Place::Boolean(place)) => Value::Boolean((place.get)(values, *element)),
            Some(Place::String(place)) => Value::String((place.get)(values, *element)),
            // The time, which the instance knows.
            None => Value::Real(f64::NAN),
        }
    }

    /// Writes a variable; `false` if the value has another type.
    #[must_use]
    pub(crate) fn set(&self, index: usize, values: &mut D, value: Value) -> bool {
        let (place, element) = &self.places[index];
        match (place, value) {
            (Some(Place::Real(place)), Value::Real(value)) => (place.set)(values, *element, value),
            (Some(Place::Integer(place)), Value::Integer(value)) => (place.set)(values, *element, value),
            (Some(Place::Boolean(place)), Value::Boolean(value)) => (place.set)(values, *element, value),
            (Some(Place::String(place)), Value::String(value)) => (place.set)(values, *element, value),
            (None, Value::Real(_)) => {}
            _ => return false,
        }
        true
    }
}

impl<D: Default> Table<D> {
    /// The start values, with those at the given indices replaced; settings of another type are ignored.
    pub fn values(&self, settings: &[(usize, Value)]) -> D {
        let mut values = D::default();
        for (index, variable) in self.variables.iter().enumerate() {
            if variable.causality == Causality::Independent {
                continue;
            }
            let fits = self.set(index, &mut values, variable.start());
            debug_assert!(fits, "the start value of {} has the type of its place", variable.name);
        }
        for (index, value) in settings.iter().filter(|(index, _)| *index < self.places.len()) {
            let _ = self.set(*index, &mut values, value.clone());
        }
        values
    }

    /// Pairs of rows that access the same place, for packing: each changes what the other reads.
    pub(crate) fn shared_places(&self) -> Vec<String> {
        let start = self.values(&[]);
        let read = |values: &D, index| self.get(index, values);
        // Variables that read differently once the row has written another value.
        let changed: Vec<Vec<usize>> = (0..self.places.len())
            .map(|index| {
                let mut values = self.values(&[]);
                let _ = self.set(index, &mut values, other(&self.variables[index], read(&start, index)));
                let differs = |at: &usize| !same(&read(&values, *at), &read(&start, *at));
                (0..self.places.len()).filter(differs).collect()
            })
            .collect();
        let pairs = changed.iter().enumerate().flat_map(|(one, others)| others.iter().map(move |other| (one, *other)));
        pairs
            .filter(|(one, other)| one < other && changed[*other].contains(one))
            .map(|(one, other)| {
                format!("{} and {} access the same field", self.variables[one].name, self.variables[other].name)
            })
            .collect()
    }

    /// Values with all Reals 0, to hold directions and derivatives.
    pub(crate) fn zeros(&self) -> D {
        let mut values = D::default();
        for index in 0..self.places.len() {
            // Only Reals have derivatives; other types ignore the number.
            let _ = self.set(index, &mut values, Value::Real(0.0));
        }
        values
    }
}

/// A value of the same type that differs.
fn other(variable: &Variable, value: Value) -> Value {
    match (&variable.data_type, value) {
        (_, Value::Real(value)) => Value::Real(if value == 0.125 { 0.25 } else { 0.125 }),
        (Type::Enumeration { items, .. }, Value::Integer(value)) => {
            Value::Integer(if value == 1 { items.items.len() as i32 } else { 1 })
        }
        (_, Value::Integer(value)) => Value::Integer(if value == 1 { 2 } else { 1 }),
        (_, Value::Boolean(value)) => Value::Boolean(!value),
        (_, Value::String(value)) => Value::String(value + "."),
    }
}

/// Whether two readings are equal; NaN equals itself.
fn same(one: &Value, other: &Value) -> bool {
    match (one, other) {
        (Value::Real(one), Value::Real(other)) => one.to_bits() == other.to_bits(),
        _ => one == other,
    }
}

/// Replaces names to which rows refer: one of the own structure gets its prefix, unless it begins with a point; that of an
/// array becomes those of its elements. Unknown names stay, to be reported.
fn resolve<D>(rows: &mut [Row<D>]) {
    let mut elements: HashMap<Cow<'static, str>, Vec<Cow<'static, str>>> = HashMap::new();
    for row in rows.iter() {
        let name = row.variable.name.clone();
        if let Some((array, _)) = name.strip_suffix(']').and_then(|name| name.rsplit_once('[')) {
            elements.entry(array.to_owned().into()).or_default().push(name.clone());
        }
        elements.entry(name.clone()).or_default().push(name);
    }
    for row in rows {
        let index = row.index();
        let meant = |name: &Cow<'static, str>| {
            let own = match name.strip_prefix('.') {
                Some(name) => name.to_owned(),
                None => format!("{}{name}", row.prefix),
            };
            elements.get(own.as_str()).or_else(|| elements.get(name)).cloned().unwrap_or_else(|| vec![name.clone()])
        };
        if let Some(depends_on) = &mut row.variable.depends_on {
            let each =
                |(name, how): &(_, Dependency)| meant(name).into_iter().map(|name| (name, *how)).collect::<Vec<_>>();
            *depends_on = depends_on.iter().flat_map(each).collect();
        }
        if let Some(starts_from) = &mut row.variable.starts_from {
            *starts_from = starts_from.iter().flat_map(meant).collect();
        }
        if let Some(state) = &mut row.variable.derivative_of {
            let states = meant(state);
            *state = states.get(index).or(states.first()).cloned().unwrap_or_else(|| state.clone());
        }
    }
}

/// Adds what the variables depend on at the start, as far as it follows from what they depend on later: an output of inputs and
/// states depends on these inputs, on whatever the states depend on at the start, and on any parameter.
fn complete(variables: &mut [Variable], from_parameters: &[bool]) {
    let name = |variable: &Variable| variable.name.clone();
    let is_parameter = |variable: &&Variable| variable.causality == Causality::Parameter;
    let parameters: Vec<_> = variables.iter().filter(is_parameter).map(name).collect();
    for (variable, all) in variables.iter_mut().zip(from_parameters) {
        if *all {
            variable.starts_from.get_or_insert_default().extend(parameters.iter().cloned());
        }
    }
    let found: Vec<_> = variables
        .iter()
        .map(|variable| match (&variable.starts_from, &variable.depends_on) {
            (None, Some(depends_on)) if variable.is_computed() && !variable.state && !depends_on.is_empty() => {
                let mut names = parameters.clone();
                for (known, _) in depends_on {
                    names.extend(at_start(variables, known)?);
                }
                Some(names)
            }
            (given, _) => given.clone(),
        })
        .collect();
    for (variable, mut names) in variables.iter_mut().zip(found) {
        if let Some(names) = &mut names {
            names.sort_unstable();
            names.dedup();
        }
        variable.starts_from = names;
    }
}

/// Parameters and inputs that a known depends on at the start; `None` for all of them.
fn at_start(variables: &[Variable], known: &str) -> Option<Vec<Cow<'static, str>>> {
    let variable = variables.iter().find(|variable| variable.name == known)?;
    match variable.causality {
        Causality::Input => Some(vec![variable.name.clone()]),
        // A start value that can be set is known like a parameter.
        _ if variable.has_start() => Some(vec![variable.name.clone()]),
        _ => variable.starts_from.clone(),
    }
}
