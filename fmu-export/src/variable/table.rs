//! The table of a model: its variables with access to their values.

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::Arc;

use super::access::Place;
use super::row::Details;
use super::{Causality, Dependency, Row, Slot, Value, Variable};

/// The variables of a model with access to their values, by index. The index is the value reference.
pub struct Table<D> {
    /// The variables.
    pub variables: Arc<[Variable]>,
    /// Access, and the index of the value.
    places: Vec<(Place<D>, usize)>,
}

impl<D> Table<D> {
    /// The table with these rows.
    ///
    /// # Panics
    /// If the row of a field has no access to values, see [`Variables::placed`](crate::Variables::placed).
    pub fn new(rows: Vec<Row<D>>) -> Self {
        let mut variables = Vec::with_capacity(rows.len());
        let mut places = Vec::with_capacity(rows.len());
        for Row { variable, details, place } in rows {
            places.push((place.expect("rows of a model have access to its values"), details.place));
            variables.push((variable, details));
        }
        Self { variables: complete(variables), places }
    }

    /// The value of the variable with that index; NaN for the time.
    pub fn get(&self, index: usize, values: &D) -> Value {
        self.at(index, values).map_or(Value::Real(f64::NAN), |slot| slot.get())
    }

    /// Writes a variable; `false` if the value has another type.
    #[must_use]
    pub(crate) fn set(&self, index: usize, values: &mut D, value: Value) -> bool {
        self.at_mut(index, values).is_none_or(|slot| slot.set(value))
    }

    /// A reference to the value of a Real variable.
    pub(crate) fn real<'d>(&self, index: usize, values: &'d D) -> Option<&'d f64> {
        self.at(index, values)?.real()
    }

    /// As `real`, to write.
    pub(crate) fn real_mut<'d>(&self, index: usize, values: &'d mut D) -> Option<&'d mut f64> {
        self.at_mut(index, values)?.real_mut()
    }

    fn at<'d>(&self, index: usize, values: &'d D) -> Option<&'d dyn Slot> {
        let (place, index) = &self.places[index];
        place.at(values, *index)
    }

    fn at_mut<'d>(&self, index: usize, values: &'d mut D) -> Option<&'d mut dyn Slot> {
        let (place, index) = &self.places[index];
        place.at_mut(values, *index)
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

/// Resolves references between variables and derives dependencies at the start.
fn complete(mut rows: Vec<(Variable, Details)>) -> Arc<[Variable]> {
    resolve(&mut rows);
    let is_parameter = |(variable, _): &&(Variable, _)| variable.causality == Causality::Parameter;
    let parameters: Vec<_> = rows.iter().filter(is_parameter).map(|(variable, _)| variable.name.clone()).collect();
    let mut variables = Vec::with_capacity(rows.len());
    for (mut variable, details) in rows {
        if details.starts_from_parameters {
            variable.starts_from.get_or_insert_default().extend_from_slice(&parameters);
        }
        variables.push(variable);
    }
    let by_name: HashMap<&str, &Variable> =
        variables.iter().map(|variable: &Variable| (variable.name.as_ref(), variable)).collect();
    let found: Vec<_> = variables.iter().map(|variable| starts_from(variable, &by_name, &parameters)).collect();
    for (variable, mut names) in variables.iter_mut().zip(found) {
        if let Some(names) = &mut names {
            names.sort_unstable();
            names.dedup();
        }
        variable.starts_from = names;
    }
    variables.into()
}

/// Resolves names in rows: a name of the same structure gets its prefix, unless it begins with a point; the name of an
/// array becomes those of its elements. Unknown names stay, to be reported.
fn resolve(rows: &mut [(Variable, Details)]) {
    let mut elements: HashMap<Cow<'static, str>, Vec<Cow<'static, str>>> = HashMap::new();
    for (Variable { name, .. }, _) in rows.iter() {
        if let Some((array, _)) = name.strip_suffix(']').and_then(|name| name.rsplit_once('[')) {
            elements.entry(array.to_owned().into()).or_default().push(name.clone());
        }
        elements.entry(name.clone()).or_default().push(name.clone());
    }
    for (variable, Details { index, prefix, .. }) in rows {
        let resolved = |name: &Cow<'static, str>| {
            let own = match name.strip_prefix('.') {
                Some(name) => name.to_owned(),
                None => format!("{prefix}{name}"),
            };
            elements.get(own.as_str()).or_else(|| elements.get(name)).cloned().unwrap_or_else(|| vec![name.clone()])
        };
        if let Some(depends_on) = &mut variable.depends_on {
            let each =
                |(name, how): &(_, Dependency)| resolved(name).into_iter().map(|name| (name, *how)).collect::<Vec<_>>();
            *depends_on = depends_on.iter().flat_map(each).collect();
        }
        if let Some(starts_from) = &mut variable.starts_from {
            *starts_from = starts_from.iter().flat_map(resolved).collect();
        }
        if let Some(state) = &mut variable.derivative_of {
            let states = resolved(state);
            *state = states.get(*index).or(states.first()).cloned().unwrap_or_else(|| state.clone());
        }
    }
}

/// The names on which a variable depends at the start, derived from its dependencies in the run: an output of inputs and states
/// depends on these inputs, on the dependencies of the states at the start, and on any parameter.
fn starts_from(
    variable: &Variable,
    variables: &HashMap<&str, &Variable>,
    parameters: &[Cow<'static, str>],
) -> Option<Vec<Cow<'static, str>>> {
    match (&variable.starts_from, &variable.depends_on) {
        (None, Some(depends_on)) if variable.is_computed() && !variable.state && !depends_on.is_empty() => {
            let mut names = parameters.to_vec();
            for (known, _) in depends_on {
                names.extend(at_start(variables, known)?);
            }
            Some(names)
        }
        (given, _) => given.clone(),
    }
}

/// Parameters and inputs that a known depends on at the start; `None` for all of them.
fn at_start(variables: &HashMap<&str, &Variable>, known: &str) -> Option<Vec<Cow<'static, str>>> {
    let variable = variables.get(known)?;
    match variable.causality {
        Causality::Input => Some(vec![variable.name.clone()]),
        // A start value that can be set is known like a parameter.
        _ if variable.has_start() => Some(vec![variable.name.clone()]),
        _ => variable.starts_from.clone(),
    }
}
