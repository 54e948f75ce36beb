//! Variables: what is known of each, and the rows of a slave's table.

use std::borrow::Cow;

use super::unit::Unit;
use crate::model::Invalid;

/// Role of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Causality {
    /// Set before the run; while it runs only where [`Variability::Tunable`].
    Parameter,
    /// Set by others at any time.
    Input,
    /// Computed for others.
    Output,
    /// Computed, for looking at.
    Local,
}

/// When a variable may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variability {
    /// Never after initialization.
    Fixed,
    /// Between two steps.
    Tunable,
    /// At sample instants or events.
    Discrete,
    /// At any time.
    Continuous,
}

/// How an unknown depends on one of the variables it is computed from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dependency {
    /// In any way.
    Any,
    /// Linearly, with a factor that no parameter changes.
    Constant,
    /// Linearly, with a factor that changes with fixed parameters alone.
    Fixed,
}

/// Names for the values 1, 2, … of an enumeration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Enumeration {
    /// Name of the type.
    pub name: &'static str,
    /// What it chooses.
    pub description: &'static str,
    /// Name and description of the items, whose values count from 1.
    pub items: &'static [(&'static str, &'static str)],
    /// Names that items had in former versions, and what replaces them.
    pub renamed: &'static [(&'static str, &'static str)],
}

impl Enumeration {
    /// The value of the item of that name.
    pub fn value_of(&self, item: &str) -> Option<i32> {
        self.items.iter().position(|(name, _)| *name == item).map(|index| index as i32 + 1)
    }

    /// The value of the item of that name.
    ///
    /// # Errors
    /// What is to be written instead.
    pub fn find(&self, item: &str) -> Result<i32, String> {
        self.value_of(item).ok_or_else(|| match self.renamed.iter().find(|(former, _)| *former == item) {
            Some((_, name)) => format!("{name}, which replaces it, is wanted"),
            None => format!("one of {} is wanted", self.listed()),
        })
    }

    /// The name of the item with that value.
    pub fn item(&self, value: i32) -> Option<&'static str> {
        let index = usize::try_from(value.checked_sub(1)?).ok()?;
        self.items.get(index).map(|(name, _)| *name)
    }
}

impl Enumeration {
    /// Chooses the option that belongs to the value, or notes in `findings` that there is none.
    pub fn choose<T, const N: usize>(
        &self,
        name: &'static str,
        value: i32,
        options: [T; N],
        chosen: &mut T,
        findings: &mut Vec<Invalid>,
    ) {
        debug_assert_eq!(N, self.items.len());
        let index = value.checked_sub(1).and_then(|index| usize::try_from(index).ok());
        match index.and_then(|index| options.into_iter().nth(index)) {
            Some(option) => *chosen = option,
            None => findings.push(Invalid {
                name: name.into(),
                value: value.to_string(),
                wanted: format!("one of {}", self.listed()).into(),
            }),
        }
    }

    /// The items with their values, for messages.
    pub fn listed(&self) -> String {
        let items = self.items.iter().zip(1..).map(|((item, _), value)| format!("{item} ({value})"));
        items.collect::<Vec<_>>().join(", ")
    }
}

/// Type of a variable, with what belongs to that type alone. The value is the start value.
#[derive(Clone, Debug, PartialEq)]
pub enum Type {
    /// A real number in SI units.
    Real {
        /// Start value in `unit`.
        start: f64,
        /// Its unit.
        unit: Unit,
        /// Unit proposed for display, by name.
        display: Option<&'static str>,
        /// Magnitude that is usual.
        nominal: f64,
        /// Least value that has a meaning.
        min: Option<f64>,
        /// Greatest value that has a meaning.
        max: Option<f64>,
    },
    /// A whole number.
    Integer {
        /// Start value.
        start: i32,
        /// Least value that has a meaning.
        min: Option<i32>,
        /// Greatest value that has a meaning.
        max: Option<i32>,
    },
    /// True or false.
    Boolean {
        /// Start value.
        start: bool,
    },
    /// One of several named items.
    Enumeration {
        /// Start value.
        start: i32,
        /// The items.
        items: &'static Enumeration,
    },
}

/// A value of any type; enumerations are integers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// Of a [`Type::Real`].
    Real(f64),
    /// Of a [`Type::Integer`] or [`Type::Enumeration`].
    Integer(i32),
    /// Of a [`Type::Boolean`].
    Boolean(bool),
}

impl Value {
    /// The value as a number for recordings; false and true are 0 and 1.
    pub fn as_f64(self) -> f64 {
        match self {
            Value::Real(value) => value,
            Value::Integer(value) => f64::from(value),
            Value::Boolean(value) => f64::from(u8::from(value)),
        }
    }

    /// What kind of value this is, in words for messages.
    pub fn noun(self) -> &'static str {
        match self {
            Value::Real(_) => "Real",
            Value::Integer(_) => "Integer",
            Value::Boolean(_) => "Boolean",
        }
    }
}

/// What is known of a variable, whatever the slave.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// Name in structured naming convention, for instance `coil.R` or `lambda[1]`.
    pub name: Cow<'static, str>,
    /// What it is, in a sentence without a full stop.
    pub description: Cow<'static, str>,
    /// Its role.
    pub causality: Causality,
    /// When it may change.
    pub variability: Variability,
    /// Type, start value, unit and limits.
    pub kind: Type,
    /// Whether it is a continuous state: integrated, not computed from others at the same instant.
    pub state: bool,
    /// For the derivative of a state: the name of the state.
    pub derivative_of: Option<&'static str>,
    /// For outputs and derivatives: the inputs and states that change it at the same instant, by name.
    pub depends_on: Vec<(Cow<'static, str>, Dependency)>,
    /// For what is computed at the start: the parameters and inputs it then follows from, by name; `None` stands for
    /// all of them.
    pub starts_from: Option<Vec<Cow<'static, str>>>,
}

impl Variable {
    /// The start value.
    pub fn start(&self) -> Value {
        match self.kind {
            Type::Real { start, .. } => Value::Real(start),
            Type::Integer { start, .. } | Type::Enumeration { start, .. } => Value::Integer(start),
            Type::Boolean { start } => Value::Boolean(start),
        }
    }

    /// The name of the unit; empty where there is none.
    pub fn unit_name(&self) -> &'static str {
        match &self.kind {
            Type::Real { unit, .. } => unit.name,
            _ => "",
        }
    }

    /// Whether users may set it at all.
    pub fn is_settable(&self) -> bool {
        matches!(self.causality, Causality::Parameter | Causality::Input)
    }

    /// Whether it is a Real that may change at any time.
    pub fn is_continuous(&self) -> bool {
        self.variability == Variability::Continuous && matches!(self.kind, Type::Real { .. })
    }
}

/// How a row finds its value among the values of a slave; the index tells the elements of an array apart.
pub struct Access<D, T> {
    /// Reads the element of that index.
    pub get: fn(&D, usize) -> T,
    /// Writes the element of that index.
    pub set: fn(&mut D, usize, T),
}

impl<D, T> Clone for Access<D, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<D, T> Copy for Access<D, T> {}

/// Access to one type of value among the values `D` of a slave.
pub enum Place<D> {
    /// A real number.
    Real(Access<D, f64>),
    /// A whole number or the value of an enumeration.
    Integer(Access<D, i32>),
    /// True or false.
    Boolean(Access<D, bool>),
}

impl<D> Clone for Place<D> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<D> Copy for Place<D> {}

/// Makes an [`Access`] from the path of a field of `Values`; `[k]` at its end stands for the element of an array.
///
/// `place!(sensor.step_s)` and `place!(lambda[k])` both work.
macro_rules! place {
    ($($field:ident).+) => {
        $crate::slave::variable::Access {
            get: |values: &Values, _| values.$($field).+,
            set: |values: &mut Values, _, value| values.$($field).+ = value,
        }
    };
    ($($field:ident).+ [$index:ident]) => {
        $crate::slave::variable::Access {
            get: |values: &Values, $index| values.$($field).+[$index],
            set: |values: &mut Values, $index, value| values.$($field).+[$index] = value,
        }
    };
}
pub(crate) use place;

/// One row of the table of a slave: a variable and where its value stands among the values `D`.
pub struct Row<D> {
    /// What is known of the variable.
    pub variable: Variable,
    pub(super) place: Place<D>,
    pub(super) index: usize,
}

impl<D> Row<D> {
    fn new(name: impl Into<Cow<'static, str>>, kind: Type, place: Place<D>, index: usize) -> Self {
        Self {
            variable: Variable {
                name: name.into(),
                description: Cow::Borrowed(""),
                causality: Causality::Local,
                variability: Variability::Continuous,
                kind,
                state: false,
                derivative_of: None,
                depends_on: Vec::new(),
                starts_from: None,
            },
            place,
            index,
        }
    }

    /// A real variable.
    pub fn real(name: impl Into<Cow<'static, str>>, place: Access<D, f64>, unit: Unit, start: f64) -> Self {
        Self::real_element(name, place, unit, start, 0)
    }

    fn real_element(
        name: impl Into<Cow<'static, str>>,
        place: Access<D, f64>,
        unit: Unit,
        start: f64,
        index: usize,
    ) -> Self {
        let kind = Type::Real {
            start,
            unit,
            display: unit.displays.first().map(|display| display.name),
            nominal: 1.0,
            min: None,
            max: None,
        };
        Self::new(name, kind, Place::Real(place), index)
    }

    /// The elements `name[1]`, `name[2]`, … of an array.
    pub fn reals<const N: usize>(
        name: &str,
        place: Access<D, f64>,
        unit: Unit,
        starts: [f64; N],
    ) -> impl Iterator<Item = Self> {
        Self::named_reals(std::array::from_fn(|index| element(name, index)), place, unit, starts)
    }

    /// The elements of an array that have a name each.
    pub fn named_reals<const N: usize>(
        names: [impl Into<Cow<'static, str>>; N],
        place: Access<D, f64>,
        unit: Unit,
        starts: [f64; N],
    ) -> impl Iterator<Item = Self> {
        let rows = names.into_iter().zip(starts).enumerate();
        rows.map(|(index, (name, start))| Self::real_element(name, place, unit, start, index))
            .collect::<Vec<_>>()
            .into_iter()
    }

    /// A whole number.
    pub fn integer(name: impl Into<Cow<'static, str>>, place: Access<D, i32>, start: i32) -> Self {
        Self::new(name, Type::Integer { start, min: None, max: None }, Place::Integer(place), 0)
    }

    /// True or false.
    pub fn boolean(name: impl Into<Cow<'static, str>>, place: Access<D, bool>, start: bool) -> Self {
        Self::new(name, Type::Boolean { start }, Place::Boolean(place), 0)
    }

    /// The elements of an array of Booleans.
    pub fn booleans<const N: usize>(
        name: &str,
        place: Access<D, bool>,
        starts: [bool; N],
    ) -> impl Iterator<Item = Self> {
        std::array::from_fn::<_, N, _>(|index| {
            let kind = Type::Boolean { start: starts[index] };
            Self::new(element(name, index), kind, Place::Boolean(place), index)
        })
        .into_iter()
    }

    /// A choice among the items of an enumeration.
    pub fn choice(
        name: impl Into<Cow<'static, str>>,
        place: Access<D, i32>,
        items: &'static Enumeration,
        start: i32,
    ) -> Self {
        Self::new(name, Type::Enumeration { start, items }, Place::Integer(place), 0)
    }

    fn role(mut self, causality: Causality, variability: Variability) -> Self {
        self.variable.causality = causality;
        self.variable.variability = match (variability, &self.variable.kind) {
            (Variability::Continuous, Type::Real { .. }) => Variability::Continuous,
            (Variability::Continuous, _) => Variability::Discrete,
            (other, _) => other,
        };
        self
    }

    /// Makes it a parameter that is fixed once the run has begun.
    pub fn fixed(self) -> Self {
        self.role(Causality::Parameter, Variability::Fixed)
    }

    /// Makes it a parameter that may be changed between steps.
    pub fn tunable(self) -> Self {
        self.role(Causality::Parameter, Variability::Tunable)
    }

    /// Makes it an input.
    pub fn input(self) -> Self {
        self.role(Causality::Input, Variability::Continuous)
    }

    /// Makes it an output that may change at any time.
    pub fn output(self) -> Self {
        self.role(Causality::Output, Variability::Continuous)
    }

    /// Makes it an output that changes at sample instants only.
    pub fn sampled_output(self) -> Self {
        self.role(Causality::Output, Variability::Discrete)
    }

    /// Makes it a variable for looking at.
    pub fn local(self) -> Self {
        self.role(Causality::Local, Variability::Continuous)
    }

    /// What it is. `{k}` stands for the number of the element, counted from 1, and `{axis}` for `y` or `z`.
    pub fn says(mut self, description: &'static str) -> Self {
        self.variable.description = if description.contains('{') {
            let axis = if self.index == 0 { "y" } else { "z" };
            Cow::Owned(description.replace("{k}", &(self.index + 1).to_string()).replace("{axis}", axis))
        } else {
            Cow::Borrowed(description)
        };
        self
    }

    /// The usual magnitude of a real variable.
    pub fn nominal(mut self, value: f64) -> Self {
        if let Type::Real { nominal, .. } = &mut self.variable.kind {
            *nominal = value;
        }
        self
    }

    /// The least value that has a meaning.
    pub fn min(mut self, value: f64) -> Self {
        match &mut self.variable.kind {
            Type::Real { min, .. } => *min = Some(value),
            Type::Integer { min, .. } => *min = Some(value as i32),
            Type::Boolean { .. } | Type::Enumeration { .. } => {}
        }
        self
    }

    /// The greatest value that has a meaning.
    pub fn max(mut self, value: f64) -> Self {
        match &mut self.variable.kind {
            Type::Real { max, .. } => *max = Some(value),
            Type::Integer { max, .. } => *max = Some(value as i32),
            Type::Boolean { .. } | Type::Enumeration { .. } => {}
        }
        self
    }

    /// Proposes a unit for display other than the first of its unit.
    pub fn shown_in(mut self, name: &'static str) -> Self {
        if let Type::Real { display, .. } = &mut self.variable.kind {
            *display = Some(name);
        }
        self
    }

    /// Names inputs and states that change it at the same instant.
    pub fn depends_on(self, names: impl IntoIterator<Item = impl Into<Cow<'static, str>>>) -> Self {
        self.depends(Dependency::Any, names)
    }

    /// Names inputs and states that change it at the same instant, and how they do that.
    pub fn depends(mut self, how: Dependency, names: impl IntoIterator<Item = impl Into<Cow<'static, str>>>) -> Self {
        self.variable.depends_on.extend(names.into_iter().map(|name| (name.into(), how)));
        self
    }

    /// Makes it a continuous state, which at any instant is what it is.
    pub fn state(mut self) -> Self {
        self.variable.state = true;
        self
    }

    /// Makes it the derivative of a state with respect to time.
    pub fn derivative_of(mut self, state: &'static str) -> Self {
        self.variable.derivative_of = Some(state);
        self
    }

    /// Names the parameters and inputs from which it is computed at the start, so that others are known to have no part.
    pub fn starts_from(mut self, names: impl IntoIterator<Item = impl Into<Cow<'static, str>>>) -> Self {
        self.variable.starts_from.get_or_insert_default().extend(names.into_iter().map(Into::into));
        self
    }

    /// Whether values of that type can be written.
    pub(super) fn takes(&self, value: Value) -> bool {
        matches!(
            (self.place, value),
            (Place::Real(_), Value::Real(_))
                | (Place::Integer(_), Value::Integer(_))
                | (Place::Boolean(_), Value::Boolean(_))
        )
    }

    /// Reads the value.
    pub(super) fn get(&self, values: &D) -> Value {
        match self.place {
            Place::Real(place) => Value::Real((place.get)(values, self.index)),
            Place::Integer(place) => Value::Integer((place.get)(values, self.index)),
            Place::Boolean(place) => Value::Boolean((place.get)(values, self.index)),
        }
    }

    /// Writes the value; `false` when it is of another type.
    #[must_use]
    pub(super) fn set(&self, values: &mut D, value: Value) -> bool {
        match (self.place, value) {
            (Place::Real(place), Value::Real(value)) => (place.set)(values, self.index, value),
            (Place::Integer(place), Value::Integer(value)) => (place.set)(values, self.index, value),
            (Place::Boolean(place), Value::Boolean(value)) => (place.set)(values, self.index, value),
            _ => return false,
        }
        true
    }
}

/// The values of a table at their start, with those at the given indices replaced; what does not fit is left out.
pub(super) fn with<D: Default>(table: &[Row<D>], settings: &[(usize, Value)]) -> D {
    let mut values = D::default();
    let starts = table.iter().map(|row| (row, row.variable.start()));
    let given = settings.iter().filter_map(|(index, value)| Some((table.get(*index)?, *value)));
    for (row, value) in starts.chain(given) {
        let _ = row.set(&mut values, value);
    }
    values
}

/// The name of the element of an array, whose index counts from 0: `element("i", 0)` is `i[1]`.
pub fn element(name: &str, index: usize) -> String {
    format!("{name}[{}]", index + 1)
}
