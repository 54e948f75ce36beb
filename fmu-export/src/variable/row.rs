//! The rows of a model's table.

use std::borrow::Cow;

use super::access::{Place, Slot};
use super::{Access, Causality, Dependency, Enumeration, Type, Value, Variability, Variable};
use crate::unit::{SECOND, Unit};

/// One row of a model's table: a variable, and access to its value in `D`.
///
/// A constructor sets type and start value; then follow the role ([`Row::fixed`], [`Row::tunable`], [`Row::input`],
/// [`Row::output`], [`Row::sampled_output`]; a local variable by default) and further attributes.
pub struct Row<D> {
    /// The variable.
    pub variable: Variable,
    /// Access to its value; initially none for the row of a field.
    pub(super) place: Option<Place<D>>,
    pub(super) details: Details,
}

/// Details of a row that are needed to complete the table.
#[derive(Default)]
pub(super) struct Details {
    /// Index of its value: that of the element, or of the field among all values.
    pub(super) place: usize,
    /// Index of the element in its array.
    pub(super) index: usize,
    pub(super) starts_from_parameters: bool,
    /// Prefix of its name; names to which it refers are looked up with this prefix first.
    pub(super) prefix: String,
    /// Number of its structure in an array of structures.
    number: Option<usize>,
}

impl<D> Row<D> {
    pub(crate) fn new(name: impl Into<Cow<'static, str>>, data_type: Type, place: Option<Place<D>>) -> Self {
        let variable = Variable::local(name.into(), data_type);
        Self { variable, place, details: Details::default() }
    }

    /// A real number.
    pub fn real(name: impl Into<Cow<'static, str>>, place: Access<D, f64>, unit: Unit, start: f64) -> Self {
        Self::new(name, Type::real(start, unit), Some(Place::Real(place)))
    }

    /// A whole number.
    pub fn integer(name: impl Into<Cow<'static, str>>, place: Access<D, i32>, start: i32) -> Self {
        Self::new(name, Type::integer(start), Some(Place::Integer(place)))
    }

    /// A Boolean.
    pub fn boolean(name: impl Into<Cow<'static, str>>, place: Access<D, bool>, start: bool) -> Self {
        Self::new(name, Type::Boolean { start }, Some(Place::Boolean(place)))
    }

    /// An item of an enumeration.
    pub fn choice(
        name: impl Into<Cow<'static, str>>,
        place: Access<D, i32>,
        items: &'static Enumeration,
        start: i32,
    ) -> Self {
        Self::new(name, Type::Enumeration { start, items }, Some(Place::Integer(place)))
    }

    /// A string.
    pub fn string(
        name: impl Into<Cow<'static, str>>,
        place: Access<D, String>,
        start: impl Into<Cow<'static, str>>,
    ) -> Self {
        Self::new(name, Type::String { start: start.into() }, Some(Place::String(place)))
    }

    /// The time, as the independent variable of FMI. It needs no access, and there is at most one.
    pub fn time(name: impl Into<Cow<'static, str>>) -> Self {
        let mut row = Self::new(name, Type::real(0.0, SECOND), Some(Place::Time)).description("Time");
        row.variable.causality = Causality::Independent;
        row
    }

    /// The elements `name[1]`, `name[2]`, … of an array; `row` makes each from its name and start value.
    ///
    /// ```
    /// # use fmu_export::{place, unit, variable::Row};
    /// struct Values { gain: [f64; 2] }
    /// let gains = Row::elements("gain", [1.0, 2.0], |name, start| Row::real(name, place!(Values.gain[k]), unit::ONE, start));
    /// assert_eq!(gains.last().expect("two rows").variable.name, "gain[2]");
    /// ```
    pub fn elements<T, const N: usize>(
        name: &str,
        starts: [T; N],
        row: impl Fn(String, T) -> Self,
    ) -> impl Iterator<Item = Self> {
        let name = name.to_owned();
        let rows = starts.into_iter().enumerate();
        rows.map(move |(index, start)| {
            let mut row = row(element(&name, index), start);
            (row.details.index, row.details.place) = (index, index);
            row
        })
    }

    /// A text with the number of the element for `{k}`, and that of its structure for `{n}`.
    fn numbered(&self, text: Cow<'static, str>) -> Cow<'static, str> {
        if !text.contains('{') {
            return text;
        }
        let Details { index, prefix, number, .. } = &self.details;
        let text = text.replace("{k}", &(index + 1).to_string());
        let text = text.replace("{prefix}", prefix.strip_suffix('.').unwrap_or(prefix));
        number.map_or(text.clone(), |number| text.replace("{n}", &number.to_string())).into()
    }

    /// The index of the element of an array, counted from 0.
    pub fn index(&self) -> usize {
        self.details.index
    }

    /// The value of a Real variable in a structure.
    pub fn number(&self, data: &D) -> Option<f64> {
        self.place.as_ref()?.at(data, self.details.place)?.real().copied()
    }

    /// The value of the variable in a structure.
    pub fn value(&self, data: &D) -> Option<Value> {
        Some(self.place.as_ref()?.at(data, self.details.place)?.get())
    }

    /// The unit of a Real variable.
    pub fn unit(&self) -> Option<Unit> {
        match self.variable.data_type {
            Type::Real { unit, .. } => Some(unit),
            _ => None,
        }
    }

    fn role(mut self, causality: Causality, variability: Variability) -> Self {
        self.variable.causality = causality;
        self.variable.variability = match (variability, &self.variable.data_type) {
            (Variability::Continuous, Type::Real { .. }) => Variability::Continuous,
            (Variability::Continuous, _) => Variability::Discrete,
            (other, _) => other,
        };
        self
    }

    /// Makes it a parameter that is fixed during the run.
    pub fn fixed(self) -> Self {
        self.role(Causality::Parameter, Variability::Fixed)
    }

    /// Makes it a parameter that [`Model::start`](crate::Model::start) computes from other parameters. If these are tunable, it is `tunable`
    /// too, and [`Model::refresh`](crate::Model::refresh) also computes it.
    pub fn calculated(self) -> Self {
        self.role(Causality::CalculatedParameter, Variability::Fixed)
    }

    /// Makes it a constant, with its start value.
    pub fn constant(self) -> Self {
        self.role(Causality::Local, Variability::Constant)
    }

    /// Makes it a parameter that may change between steps; a calculated one stays calculated.
    pub fn tunable(self) -> Self {
        let is_calculated = self.variable.causality == Causality::CalculatedParameter;
        let causality = if is_calculated { Causality::CalculatedParameter } else { Causality::Parameter };
        self.role(causality, Variability::Tunable)
    }

    /// Makes it an input.
    pub fn input(self) -> Self {
        self.role(Causality::Input, Variability::Continuous)
    }

    /// Makes it an output that may change at any time.
    pub fn output(self) -> Self {
        self.role(Causality::Output, Variability::Continuous)
    }

    /// Makes it an output that changes only at sample instants or events.
    pub fn sampled_output(self) -> Self {
        self.role(Causality::Output, Variability::Discrete)
    }

    /// Lets an input, output or local variable change only at sample instants or events.
    pub fn discrete(mut self) -> Self {
        self.variable.variability = Variability::Discrete;
        self
    }

    /// Lets an output or a local variable start from its start value, which importers may set before the run and the start does
    /// not change. Mainly for states, whose initial values then need no parameters.
    pub fn exact(mut self) -> Self {
        self.variable.exact = true;
        self
    }

    /// Makes it a local variable, to be observed.
    pub fn local(self) -> Self {
        self.role(Causality::Local, Variability::Continuous)
    }

    /// Description, as a phrase without a full stop. `{k}` stands for the number of the element, counted from 1, `{n}` for that of
    /// its structure, `{prefix}` for the prefix of its name, without the final point.
    pub fn description(mut self, description: impl Into<Cow<'static, str>>) -> Self {
        self.variable.description = self.numbered(description.into());
        self
    }

    /// Typical magnitude of a Real variable.
    pub fn nominal(mut self, value: f64) -> Self {
        if let Type::Real { nominal, .. } = &mut self.variable.data_type {
            *nominal = value;
        }
        self
    }

    /// Smallest value accepted; anything below is refused.
    ///
    /// # Panics
    /// For a variable of type Integer if the value is no whole number; so does [`Row::max`].
    pub fn min(mut self, value: f64) -> Self {
        match &mut self.variable.data_type {
            Type::Real { min, .. } => *min = Some(value),
            Type::Integer { min, .. } => *min = Some(whole(value, &self.variable.name)),
            Type::Boolean { .. } | Type::Enumeration { .. } | Type::String { .. } => {}
        }
        self
    }

    /// A lower limit of a Real variable that is itself refused; model descriptions show it as the smallest value.
    pub fn above(mut self, value: f64) -> Self {
        self.variable.excludes_min = true;
        self.min(value)
    }

    /// Largest value accepted; anything above is refused.
    pub fn max(mut self, value: f64) -> Self {
        match &mut self.variable.data_type {
            Type::Real { max, .. } => *max = Some(value),
            Type::Integer { max, .. } => *max = Some(whole(value, &self.variable.name)),
            Type::Boolean { .. } | Type::Enumeration { .. } | Type::String { .. } => {}
        }
        self
    }

    /// Sets the display unit, one of those of its unit.
    pub fn display_unit(mut self, name: &'static str) -> Self {
        if let Type::Real { display, .. } = &mut self.variable.data_type {
            *display = Some(name);
        }
        self
    }

    /// Sets the first display unit of its unit, unless another was set.
    pub fn display_in_first(mut self) -> Self {
        if let Type::Real { display, unit, .. } = &mut self.variable.data_type {
            *display = display.or(unit.displays.first().map(|first| first.name));
        }
        self
    }

    /// Declares that it depends on no parameter and no input at the start.
    pub fn starts_from_nothing(mut self) -> Self {
        self.variable.starts_from.get_or_insert_default();
        self
    }

    /// Declares that it depends on no input and no state.
    pub fn depends_on_nothing(mut self) -> Self {
        self.variable.depends_on.get_or_insert_default();
        self
    }

    /// Names the inputs and states with direct feedthrough to it; without this it depends on all of them. The name of an array
    /// stands for all its elements; `{k}` in a name for the number of this element.
    pub fn depends_on(self, names: impl IntoIterator<Item = impl Into<Cow<'static, str>>>) -> Self {
        self.depends(Dependency::Any, names)
    }

    /// Names the inputs and states with direct feedthrough to it, and the form of the dependency.
    pub fn depends(mut self, how: Dependency, names: impl IntoIterator<Item = impl Into<Cow<'static, str>>>) -> Self {
        let names: Vec<_> = names.into_iter().map(|name| (self.numbered(name.into()), how)).collect();
        self.variable.depends_on.get_or_insert_default().extend(names);
        self
    }

    /// Makes it a continuous state, which is integrated.
    pub fn state(mut self) -> Self {
        self.variable.state = true;
        self
    }

    /// Makes it the derivative of a state. If the name is that of an array, an element is the derivative of the element with the same
    /// number.
    pub fn derivative_of(mut self, state: impl Into<Cow<'static, str>>) -> Self {
        self.variable.derivative_of = Some(self.numbered(state.into()));
        self
    }

    /// Declares that at the start it depends on any parameters, and only on the inputs named by [`Row::starts_from`].
    pub fn starts_from_parameters(mut self) -> Self {
        self.details.starts_from_parameters = true;
        self.variable.starts_from.get_or_insert_default();
        self
    }

    /// Names the parameters and inputs on which it depends at the start; by default these follow from [`Row::depends_on`] if
    /// possible, and are otherwise all.
    pub fn starts_from(mut self, names: impl IntoIterator<Item = impl Into<Cow<'static, str>>>) -> Self {
        let names: Vec<_> = names.into_iter().map(|name| self.numbered(name.into())).collect();
        self.variable.starts_from.get_or_insert_default().extend(names);
        self
    }
}

impl Row<()> {
    /// Sets the index of its value and of the element, and prefix and number of its structure.
    pub(crate) fn within(mut self, prefix: &str, number: Option<usize>, place: usize, index: usize) -> Self {
        self.details = Details { prefix: prefix.to_owned(), number, place, index, ..self.details };
        self
    }

    /// Sets the unit of a Real variable.
    #[doc(hidden)]
    pub fn with_unit(mut self, of: Unit) -> Self {
        if let Type::Real { unit, .. } = &mut self.variable.data_type {
            *unit = of;
        }
        self
    }

    /// The same with access to its value, given that to all fields.
    pub(crate) fn placed<D>(self, fields: Access<D, dyn Slot>) -> Row<D> {
        let Self { variable, details, .. } = self;
        Row { variable, place: Some(Place::Field(fields)), details }
    }
}

/// The name of an array element, with the index counted from 0: `element("i", 0)` is `i[1]`.
pub fn element(name: &str, index: usize) -> String {
    format!("{name}[{}]", index + 1)
}

/// A limit of an Integer variable.
fn whole(value: f64, name: &str) -> i32 {
    let limit = value as i32;
    assert!(f64::from(limit) == value, "the limit {value} of {name} is refused: expected a whole number");
    limit
}
