//! Variables, and the rows of a model's table.

use std::borrow::Cow;
use std::sync::Arc;

use crate::model::Invalid;
use crate::unit::Unit;

/// Role of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Causality {
    /// Set before the run; during it only if [`Variability::Tunable`].
    Parameter,
    /// Set by the importer at any time.
    Input,
    /// Computed, to be connected.
    Output,
    /// Computed, to be observed.
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

/// How an unknown depends on a known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dependency {
    /// In any way.
    Any,
    /// Linearly, with a constant factor.
    Constant,
    /// Linearly, with a factor that depends on fixed parameters only.
    Fixed,
}

/// Names for the values 1, 2, … of an enumeration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Enumeration {
    /// Name of the type.
    pub name: &'static str,
    /// Description.
    pub description: &'static str,
    /// Name and description of the items, whose values count from 1.
    pub items: &'static [(&'static str, &'static str)],
    /// Former names of items, and their replacements.
    pub renamed: &'static [(&'static str, &'static str)],
}

impl Enumeration {
    /// The value of an item.
    pub fn value_of(&self, item: &str) -> Option<i32> {
        self.items.iter().position(|(name, _)| *name == item).map(|index| index as i32 + 1)
    }

    /// The value of an item.
    ///
    /// # Errors
    /// What to write instead.
    pub fn find(&self, item: &str) -> Result<i32, String> {
        self.value_of(item).ok_or_else(|| match self.renamed.iter().find(|(former, _)| *former == item) {
            Some((_, name)) => format!("expected {name}, which replaces it"),
            None => format!("expected one of {}", self.listed()),
        })
    }

    /// The name of the item with that value.
    pub fn item(&self, value: i32) -> Option<&'static str> {
        let index = usize::try_from(value.checked_sub(1)?).ok()?;
        self.items.get(index).map(|(name, _)| *name)
    }

    /// Sets `option` to the item with that value, or adds a finding if there is none.
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
            None => findings.push(Invalid::new(name, value, format!("one of {}", self.listed()))),
        }
    }

    /// The items with their values, for messages.
    pub fn listed(&self) -> String {
        let items = self.items.iter().zip(1..).map(|((item, _), value)| format!("{item} ({value})"));
        items.collect::<Vec<_>>().join(", ")
    }
}

/// Type of a variable, with its attributes and start value.
#[derive(Clone, Debug, PartialEq)]
pub enum Type {
    /// A real number in SI units.
    Real {
        /// Start value in `unit`.
        start: f64,
        /// Its unit.
        unit: Unit,
        /// Default display unit, by name.
        display: Option<&'static str>,
        /// Typical magnitude.
        nominal: f64,
        /// Smallest meaningful value.
        min: Option<f64>,
        /// Largest meaningful value.
        max: Option<f64>,
    },
    /// A whole number.
    Integer {
        /// Start value.
        start: i32,
        /// Smallest meaningful value.
        min: Option<i32>,
        /// Largest meaningful value.
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
    /// A text.
    String {
        /// Start value.
        start: Cow<'static, str>,
    },
}

/// A value of any type; enumerations are integers.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Of a [`Type::Real`].
    Real(f64),
    /// Of a [`Type::Integer`] or [`Type::Enumeration`].
    Integer(i32),
    /// Of a [`Type::Boolean`].
    Boolean(bool),
    /// Of a [`Type::String`].
    String(String),
}

impl Value {
    /// The value as a number for recordings; false and true are 0 and 1, a string is NaN.
    pub fn as_f64(self) -> f64 {
        match self {
            Value::Real(value) => value,
            Value::Integer(value) => f64::from(value),
            Value::Boolean(value) => f64::from(u8::from(value)),
            Value::String(_) => f64::NAN,
        }
    }

    /// The name of its type, for messages.
    pub fn type_name(&self) -> &'static str {
        match self {
            Value::Real(_) => "Real",
            Value::Integer(_) => "Integer",
            Value::Boolean(_) => "Boolean",
            Value::String(_) => "String",
        }
    }
}

/// Description of a variable, independent of the model.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// Name in structured naming convention, for instance `coil.R` or `lambda[1]`.
    pub name: Cow<'static, str>,
    /// Description, as a phrase without a full stop.
    pub description: Cow<'static, str>,
    /// Its role.
    pub causality: Causality,
    /// When it may change.
    pub variability: Variability,
    /// Type, start value, unit and limits.
    pub data_type: Type,
    /// Whether it is a continuous state, which is integrated.
    pub state: bool,
    /// For the derivative of a state: the name of the state.
    pub derivative_of: Option<&'static str>,
    /// For outputs and derivatives: the inputs and states with direct feedthrough to it, by name.
    pub depends_on: Vec<(Cow<'static, str>, Dependency)>,
    /// For variables computed at the start: the parameters and inputs that they depend on then, by name; `None` means all of
    /// them.
    pub starts_from: Option<Vec<Cow<'static, str>>>,
}

impl Variable {
    /// The start value.
    pub fn start(&self) -> Value {
        match &self.data_type {
            Type::Real { start, .. } => Value::Real(*start),
            Type::Integer { start, .. } | Type::Enumeration { start, .. } => Value::Integer(*start),
            Type::Boolean { start } => Value::Boolean(*start),
            Type::String { start } => Value::String(start.to_string()),
        }
    }

    /// The name of the unit; empty if there is none.
    pub fn unit_name(&self) -> &'static str {
        match &self.data_type {
            Type::Real { unit, .. } => unit.name,
            _ => "",
        }
    }

    /// Whether an importer may set it at all.
    pub fn is_settable(&self) -> bool {
        matches!(self.causality, Causality::Parameter | Causality::Input)
    }

    /// Whether it is a Real that may change at any time.
    pub fn is_continuous(&self) -> bool {
        self.variability == Variability::Continuous && matches!(self.data_type, Type::Real { .. })
    }
}

/// Access to a value in the structure `D`; the index is that of an array element. Made by [`place!`](crate::place).
pub struct Access<D, T> {
    /// Reads the element with that index.
    pub get: fn(&D, usize) -> T,
    /// Writes the element with that index.
    pub set: fn(&mut D, usize, T),
}

impl<D, T> Clone for Access<D, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<D, T> Copy for Access<D, T> {}

/// Access to a value of any type.
enum Place<D> {
    Real(Access<D, f64>),
    Integer(Access<D, i32>),
    Boolean(Access<D, bool>),
    String(Access<D, String>),
}

/// Makes an [`Access`](crate::variable::Access) from a type and the path of one of its fields; `[k]` at the end stands for the
/// element of an array.
///
/// ```
/// # use fmu_export::{place, variable::Access};
/// struct Sensor { gain: f64 }
/// struct Values { sensor: Sensor, current: [f64; 3] }
/// let gain: Access<Values, f64> = place!(Values.sensor.gain);
/// let current: Access<Values, f64> = place!(Values.current[k]);
/// ```
#[macro_export]
macro_rules! place {
    ($values:ident . $($field:ident).+) => {
        $crate::variable::Access {
            get: |values: &$values, _| values.$($field).+.clone(),
            set: |values: &mut $values, _, value| values.$($field).+ = value,
        }
    };
    ($values:ident . $($field:ident).+ [$index:ident]) => {
        $crate::variable::Access {
            get: |values: &$values, $index| values.$($field).+[$index].clone(),
            set: |values: &mut $values, $index, value| values.$($field).+[$index] = value,
        }
    };
}

/// One row of a model's table: a variable, and access to its value in `D`.
///
/// A constructor gives type and start value; the role follows ([`Row::fixed`], [`Row::tunable`], [`Row::input`],
/// [`Row::output`], [`Row::sampled_output`]; a local variable by default), and then further attributes.
pub struct Row<D> {
    /// The variable.
    pub variable: Variable,
    place: Place<D>,
    index: usize,
}

impl<D> Row<D> {
    fn new(name: impl Into<Cow<'static, str>>, data_type: Type, place: Place<D>, index: usize) -> Self {
        Self {
            variable: Variable {
                name: name.into(),
                description: Cow::Borrowed(""),
                causality: Causality::Local,
                variability: if matches!(data_type, Type::Real { .. }) {
                    Variability::Continuous
                } else {
                    Variability::Discrete
                },
                data_type,
                state: false,
                derivative_of: None,
                depends_on: Vec::new(),
                starts_from: None,
            },
            place,
            index,
        }
    }

    /// A real number.
    pub fn real(name: impl Into<Cow<'static, str>>, place: Access<D, f64>, unit: Unit, start: f64) -> Self {
        let display = unit.displays.first().map(|display| display.name);
        let data_type = Type::Real { start, unit, display, nominal: 1.0, min: None, max: None };
        Self::new(name, data_type, Place::Real(place), 0)
    }

    /// A whole number.
    pub fn integer(name: impl Into<Cow<'static, str>>, place: Access<D, i32>, start: i32) -> Self {
        Self::new(name, Type::Integer { start, min: None, max: None }, Place::Integer(place), 0)
    }

    /// A Boolean.
    pub fn boolean(name: impl Into<Cow<'static, str>>, place: Access<D, bool>, start: bool) -> Self {
        Self::new(name, Type::Boolean { start }, Place::Boolean(place), 0)
    }

    /// An item of an enumeration.
    pub fn choice(
        name: impl Into<Cow<'static, str>>,
        place: Access<D, i32>,
        items: &'static Enumeration,
        start: i32,
    ) -> Self {
        Self::new(name, Type::Enumeration { start, items }, Place::Integer(place), 0)
    }

    /// A string.
    pub fn string(
        name: impl Into<Cow<'static, str>>,
        place: Access<D, String>,
        start: impl Into<Cow<'static, str>>,
    ) -> Self {
        Self::new(name, Type::String { start: start.into() }, Place::String(place), 0)
    }

    /// The elements `name[1]`, `name[2]`, … of an array of real numbers.
    pub fn reals<const N: usize>(
        name: &str,
        place: Access<D, f64>,
        unit: Unit,
        starts: [f64; N],
    ) -> impl Iterator<Item = Self> {
        Self::elements(name, starts, move |name, start| Self::real(name, place, unit, start))
    }

    /// Array elements with individual names.
    pub fn named_reals<const N: usize>(
        names: [impl Into<Cow<'static, str>>; N],
        place: Access<D, f64>,
        unit: Unit,
        starts: [f64; N],
    ) -> impl Iterator<Item = Self> {
        let rows = names.into_iter().zip(starts).enumerate();
        rows.map(move |(index, (name, start))| Self { index, ..Self::real(name, place, unit, start) })
    }

    /// The elements of an array of whole numbers.
    pub fn integers<const N: usize>(name: &str, place: Access<D, i32>, starts: [i32; N]) -> impl Iterator<Item = Self> {
        Self::elements(name, starts, move |name, start| Self::integer(name, place, start))
    }

    /// The elements of an array of Booleans.
    pub fn booleans<const N: usize>(
        name: &str,
        place: Access<D, bool>,
        starts: [bool; N],
    ) -> impl Iterator<Item = Self> {
        Self::elements(name, starts, move |name, start| Self::boolean(name, place, start))
    }

    /// Booleans with individual names.
    pub fn named_booleans<const N: usize>(
        names: [impl Into<Cow<'static, str>>; N],
        place: Access<D, bool>,
        starts: [bool; N],
    ) -> impl Iterator<Item = Self> {
        let rows = names.into_iter().zip(starts).enumerate();
        rows.map(move |(index, (name, start))| Self { index, ..Self::boolean(name, place, start) })
    }

    /// The elements of an array of strings.
    pub fn strings<const N: usize>(
        name: &str,
        place: Access<D, String>,
        starts: [&'static str; N],
    ) -> impl Iterator<Item = Self> {
        Self::elements(name, starts, move |name, start| Self::string(name, place, start))
    }

    fn elements<T, const N: usize>(
        name: &str,
        starts: [T; N],
        row: impl Fn(String, T) -> Self,
    ) -> impl Iterator<Item = Self> {
        let name = name.to_owned();
        let rows = starts.into_iter().enumerate();
        rows.map(move |(index, start)| Self { index, ..row(element(&name, index), start) })
    }

    /// The index of the element of an array, counted from 0.
    pub fn index(&self) -> usize {
        self.index
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

    /// Makes it a parameter that may change between steps.
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

    /// Makes it a local variable, to be observed.
    pub fn local(self) -> Self {
        self.role(Causality::Local, Variability::Continuous)
    }

    /// Description, as a phrase without a full stop. `{k}` stands for the number of the element, counted from 1.
    pub fn description(mut self, description: impl Into<Cow<'static, str>>) -> Self {
        let text = description.into();
        self.variable.description =
            if text.contains("{k}") { text.replace("{k}", &(self.index + 1).to_string()).into() } else { text };
        self
    }

    /// Typical magnitude of a Real variable.
    pub fn nominal(mut self, value: f64) -> Self {
        if let Type::Real { nominal, .. } = &mut self.variable.data_type {
            *nominal = value;
        }
        self
    }

    /// Smallest meaningful value.
    pub fn min(mut self, value: f64) -> Self {
        match &mut self.variable.data_type {
            Type::Real { min, .. } => *min = Some(value),
            Type::Integer { min, .. } => *min = Some(value as i32),
            Type::Boolean { .. } | Type::Enumeration { .. } | Type::String { .. } => {}
        }
        self
    }

    /// Largest meaningful value.
    pub fn max(mut self, value: f64) -> Self {
        match &mut self.variable.data_type {
            Type::Real { max, .. } => *max = Some(value),
            Type::Integer { max, .. } => *max = Some(value as i32),
            Type::Boolean { .. } | Type::Enumeration { .. } | Type::String { .. } => {}
        }
        self
    }

    /// Sets a default display unit other than the first of its unit.
    pub fn display_unit(mut self, name: &'static str) -> Self {
        if let Type::Real { display, .. } = &mut self.variable.data_type {
            *display = Some(name);
        }
        self
    }

    /// Names the inputs and states with direct feedthrough to it.
    pub fn depends_on(self, names: impl IntoIterator<Item = impl Into<Cow<'static, str>>>) -> Self {
        self.depends(Dependency::Any, names)
    }

    /// Names the inputs and states with direct feedthrough to it, and the form of the dependency.
    pub fn depends(mut self, how: Dependency, names: impl IntoIterator<Item = impl Into<Cow<'static, str>>>) -> Self {
        self.variable.depends_on.extend(names.into_iter().map(|name| (name.into(), how)));
        self
    }

    /// Makes it a continuous state, which is integrated.
    pub fn state(mut self) -> Self {
        self.variable.state = true;
        self
    }

    /// Makes it the derivative of a state.
    pub fn derivative_of(mut self, state: &'static str) -> Self {
        self.variable.derivative_of = Some(state);
        self
    }

    /// Names the parameters and inputs that it depends on at the start; by default all.
    pub fn starts_from(mut self, names: impl IntoIterator<Item = impl Into<Cow<'static, str>>>) -> Self {
        self.variable.starts_from.get_or_insert_default().extend(names.into_iter().map(Into::into));
        self
    }
}

/// The variables of a model with access to their values, by index. The index is the value reference.
pub struct Table<D> {
    /// The variables.
    pub variables: Arc<[Variable]>,
    places: Vec<(Place<D>, usize)>,
}

impl<D> Table<D> {
    /// The table with these rows.
    pub fn new(rows: Vec<Row<D>>) -> Self {
        let (variables, places): (Vec<_>, Vec<_>) =
            rows.into_iter().map(|row| (row.variable, (row.place, row.index))).unzip();
        Self { variables: variables.into(), places }
    }

    /// Whether the variable takes values of that type.
    pub(crate) fn takes(&self, index: usize, value: &Value) -> bool {
        matches!(
            (&self.places[index].0, value),
            (Place::Real(_), Value::Real(_))
                | (Place::Integer(_), Value::Integer(_))
                | (Place::Boolean(_), Value::Boolean(_))
                | (Place::String(_), Value::String(_))
        )
    }

    /// Reads a variable.
    pub(crate) fn get(&self, index: usize, values: &D) -> Value {
        let (place, element) = &self.places[index];
        match place {
            Place::Real(place) => Value::Real((place.get)(values, *element)),
            Place::Integer(place) => Value::Integer((place.get)(values, *element)),
            Place::Boolean(place) => Value::Boolean((place.get)(values, *element)),
            Place::String(place) => Value::String((place.get)(values, *element)),
        }
    }

    /// Writes a variable; `false` if the value has another type.
    #[must_use]
    pub(crate) fn set(&self, index: usize, values: &mut D, value: Value) -> bool {
        let (place, element) = &self.places[index];
        match (place, value) {
            (Place::Real(place), Value::Real(value)) => (place.set)(values, *element, value),
            (Place::Integer(place), Value::Integer(value)) => (place.set)(values, *element, value),
            (Place::Boolean(place), Value::Boolean(value)) => (place.set)(values, *element, value),
            (Place::String(place), Value::String(value)) => (place.set)(values, *element, value),
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

/// The name of an array element, with the index counted from 0: `element("i", 0)` is `i[1]`.
pub fn element(name: &str, index: usize) -> String {
    format!("{name}[{}]", index + 1)
}
