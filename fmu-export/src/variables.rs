//! Variables as fields of a structure: [`derive@crate::Variables`], and of Rust enums: [`derive@crate::Choice`].
//!
//! A field is a variable, and its doc comment the description. The attribute sets the role and, in parentheses, further properties;
//! README lists them all.
//!
//! ```
//! use fmu_export::prelude::*;
//!
//! /// Drive of the coil
//! #[derive(Clone, Copy, Default, PartialEq, Serialize, Deserialize, Choice)]
//! enum Drive {
//!     /// A current
//!     #[default]
//!     Current,
//!     /// A voltage
//!     Voltage,
//! }
//!
//! #[derive(Clone, Default, Serialize, Deserialize, Variables)]
//! struct Coil {
//!     /// Resistance of coil {n}
//!     #[parameter(name = "R", unit = unit::OHM, start = 1.0, min = 0.0)]
//!     resistance: f64,
//!     /// Current through coil {n}
//!     #[output(unit = unit::AMPERE, depends_on = ["u[{n}]"])]
//!     i: f64,
//! }
//!
//! #[derive(Clone, Default, Serialize, Deserialize, Variables)]
//! struct Values {
//!     #[parameter]
//!     drive: Drive,
//!     /// Voltage at coil {k}
//!     #[input(unit = unit::VOLT)]
//!     u: [f64; 2],
//!     coil: [Coil; 2],
//! }
//!
//! let names: Vec<_> = Values::rows().into_iter().map(|row| row.variable.name.to_string()).collect();
//! assert_eq!(names, ["drive", "u[1]", "u[2]", "coil[1].R", "coil[1].i", "coil[2].R", "coil[2].i"]);
//! assert_eq!(Drive::all().map(Drive::name).collect::<Vec<_>>(), ["current", "voltage"]);
//! ```
//!
//! Mistakes are compiler errors, at the place of the mistake:
//!
//! ```compile_fail
//! # use fmu_export::prelude::*;
//! #[derive(Clone, Default, Serialize, Deserialize, Variables)]
//! struct Values {
//!     #[parameter(unit = unit::FURLONG)] // there is no such unit
//!     length: f64,
//! }
//! ```
//!
//! ```compile_fail
//! # use fmu_export::prelude::*;
//! #[derive(Clone, Default, Serialize, Deserialize, Variables)]
//! struct Values {
//!     #[input]
//!     #[output] // two rows on one field
//!     u: f64,
//! }
//! ```
//!
//! ```compile_fail
//! # use fmu_export::prelude::*;
//! #[derive(Clone, Default, Serialize, Deserialize, Variables)]
//! struct Values {
//!     #[input(name = "my input")] // not allowed as a name
//!     u: f64,
//! }
//! ```
//!
//! ```compile_fail
//! # use fmu_export::prelude::*;
//! #[derive(Clone, Default, Serialize, Deserialize, Variables)]
//! struct Values {
//!     #[input(unit = unit::VOLT)] // a Boolean has no unit
//!     on: bool,
//! }
//! ```
//!
//! ```compile_fail
//! # use fmu_export::prelude::*;
//! #[derive(Clone, Default, Serialize, Deserialize, Variables)]
//! struct Values {
//!     #[input(maximum = 3.0)] // unknown
//!     u: f64,
//! }
//! ```
//!
//! ```compile_fail
//! # use fmu_export::prelude::*;
//! #[derive(Clone, Default, Serialize, Deserialize, Variables)]
//! struct Values {
//!     forgotten: f64, // neither a variable nor a structure of variables
//! }
//! ```

use std::marker::PhantomData;

use crate::array::Array;
use crate::unit::Unit;
use crate::variable::{Access, Enumeration, Row, Slot, Type, Value};

/// A structure whose fields are variables; see [`derive@crate::Variables`].
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a structure of variables",
    label = "expected `#[derive(Variables)]` on it, or one of the attributes `#[parameter]`, `#[input]`, `#[output]`, `#[local]`, \
             `#[hidden]` on this field"
)]
pub trait Variables: Sized + 'static {
    /// Source of names, descriptions and start values when the table is built; `()` unless set by
    /// `#[variables(context = Type)]`.
    type Context: ?Sized;

    /// Number of variables, including those of nested structures.
    #[doc(hidden)]
    const COUNT: usize;

    /// Appends the rows of this structure without access to values; for the macro.
    #[doc(hidden)]
    fn describe(&self, scope: &Scope, context: &Self::Context, rows: &mut Vec<Row<()>>);

    /// The variable of that number, counted from 0; for the macro.
    #[doc(hidden)]
    fn at(&self, number: usize) -> &dyn Slot;

    /// As `at`, to write.
    #[doc(hidden)]
    fn at_mut(&mut self, number: usize) -> &mut dyn Slot;

    /// The rows of a model whose values are this structure.
    fn rows() -> Vec<Row<Self>>
    where
        Self: Default + Variables<Context = ()>,
    {
        Self::rows_in(&())
    }

    /// As [`Variables::rows`], with the `context` of the attributes.
    fn rows_in(context: &Self::Context) -> Vec<Row<Self>>
    where
        Self: Default,
    {
        Self::default().rows_of(context)
    }

    /// As [`Variables::rows_in`], with the values of this structure as start values.
    fn rows_of(&self, context: &Self::Context) -> Vec<Row<Self>> {
        let mut rows = Vec::new();
        self.describe(&Scope::default(), context, &mut rows);
        Self::placed(rows)
    }

    /// As [`Variables::rows_in`], without access to values: such rows have the same type for all models, and so do functions that
    /// change them before [`Variables::placed`].
    fn described(context: &Self::Context) -> Vec<Row<()>>
    where
        Self: Default,
    {
        let mut rows = Vec::new();
        Self::default().describe(&Scope::default(), context, &mut rows);
        rows
    }

    /// Rows from [`Variables::described`], in any order, with access to values.
    fn placed(rows: Vec<Row<()>>) -> Vec<Row<Self>> {
        rows.into_iter().map(|row| row.placed(Access { at: Self::at, at_mut: Self::at_mut })).collect()
    }
}

/// Items of an enumeration as a Rust enum; see [`derive@crate::Choice`].
pub trait Choice: Copy + 'static {
    /// Names and descriptions.
    const ENUMERATION: &'static Enumeration;
    /// The value of an item, counted from 1.
    fn number(self) -> i32;
    /// The item with that value.
    fn of_number(number: i32) -> Option<Self>;

    /// The name of the item.
    fn name(self) -> &'static str {
        Self::ENUMERATION.items[self.number() as usize - 1].0
    }

    /// The description of the item.
    fn description(self) -> &'static str {
        Self::ENUMERATION.items[self.number() as usize - 1].1
    }

    /// All items, in the order of their values.
    fn all() -> impl Iterator<Item = Self> {
        (1..).map_while(Self::of_number)
    }
}

/// Position of a structure within the values of a model.
#[doc(hidden)]
#[derive(Default)]
pub struct Scope {
    /// Prefix of all names.
    prefix: String,
    /// Index of the structure in its array.
    pub index: usize,
    /// Number of the structure in its array, or else that of the enclosing structure.
    number: Option<usize>,
    /// Number of its first variable among those of the model.
    first: usize,
}

impl Scope {
    /// The structures in a field, from the numbers of variables before it and in it, and the lengths of an array.
    ///
    /// # Panics
    /// If `count` or the number of prefixes is more than the number of structures.
    pub fn nested(
        &self,
        (before, variables): (usize, usize),
        names: &Names,
        lengths: &[usize],
        count: Option<usize>,
    ) -> Vec<Self> {
        let given = if let Names::Each(prefixes) = names { Some(prefixes.len()) } else { None };
        let most = lengths.iter().product();
        let count = count.or(given).unwrap_or(most);
        assert!(count <= most, "{} has {most} elements, fewer than {count}", names.at(&self.prefix, 0, &[]));
        let structure = |index| {
            let end = if let Names::Common(_) = names { "." } else { "" };
            let prefix = names.at(&self.prefix, index, lengths) + end;
            let number = if lengths.is_empty() { self.number } else { Some(index + 1) };
            Self { prefix, index, number, first: self.first + before + index * (variables / most) }
        };
        (0..count).map(structure).collect()
    }

    /// Appends the rows of all elements of a field, or of the first `count`; `before` is the number of variables before it.
    /// `complete` adds the attributes to the row of an index.
    ///
    /// # Panics
    /// If the numbers of names and elements differ.
    pub fn rows(
        &self,
        before: usize,
        names: &Names,
        (lengths, slots): &Elements<'_>,
        count: Option<usize>,
        rows: &mut Vec<Row<()>>,
        complete: &dyn Fn(usize, Row<()>) -> Row<()>,
    ) {
        let given = if let Names::Each(names) = names { Some(names) } else { None };
        let made = count.or(given.map(Vec::len)).unwrap_or(slots.len());
        let name = || names.at(&self.prefix, 0, lengths);
        assert!(made <= slots.len(), "{}: count = {made} is refused for an array of {} elements", name(), slots.len());
        if let Some(names) = given {
            assert!(made == names.len(), "there are {} names for {made} elements: {}", names.len(), names.join(", "));
        }
        for (index, slot) in slots[..made].iter().enumerate() {
            let row = slot.row(names.at(&self.prefix, index, lengths));
            rows.push(complete(index, row.within(&self.prefix, self.number, self.first + before + index, index)));
        }
    }
}

/// Names of the elements of a field, or prefixes of those in its structures.
#[doc(hidden)]
pub enum Names {
    /// `name`, `name[1]`, `name[1,2]`.
    Common(String),
    /// One for each.
    Each(Vec<String>),
}

impl Names {
    /// One for each.
    pub fn each(names: impl IntoIterator<Item: Into<String>>) -> Self {
        Self::Each(names.into_iter().map(Into::into).collect())
    }

    /// The name of the element with an index, counted from 0 through all dimensions of an array with that shape.
    fn at(&self, prefix: &str, index: usize, shape: &[usize]) -> String {
        let name = match self {
            Self::Common(name) => name,
            Self::Each(names) => return format!("{prefix}{}", names[index]),
        };
        let mut rest = index;
        let mut indices = Vec::new();
        for length in shape.iter().rev() {
            indices.insert(0, (rest % length + 1).to_string());
            rest /= length;
        }
        if indices.is_empty() { format!("{prefix}{name}") } else { format!("{prefix}{name}[{}]", indices.join(",")) }
    }
}

/// A type of variables.
#[doc(hidden)]
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a type of variables",
    label = "expected f64, i32, bool, String, an enum with `#[derive(Choice)]`, or an array of them"
)]
pub trait Scalar: Slot + Sized {
    /// Its limits.
    type Limit;
}

/// The limits of a type that has none.
#[doc(hidden)]
pub enum NoLimit {}

/// Implements a type whose field holds its values directly.
macro_rules! scalar {
    ($scalar:ident, $limit:ty, $real:expr, $real_mut:expr, |$start:ident| $of_type:expr) => {
        impl Scalar for $scalar {
            type Limit = $limit;
        }

        impl Slot for $scalar {
            fn get(&self) -> Value {
                self.clone().into()
            }

            fn set(&mut self, value: Value) -> bool {
                value.try_into().map(|value| *self = value).is_ok()
            }

            fn row(&self, name: String) -> Row<()> {
                let $start = self;
                Row::new(name, $of_type, None)
            }

            fn real(&self) -> Option<&f64> {
                $real(self)
            }

            fn real_mut(&mut self) -> Option<&mut f64> {
                $real_mut(self)
            }
        }
    };
}
scalar!(f64, f64, Some, Some, |start| Type::real(*start, Unit::default()));
scalar!(i32, i32, |_| None, |_| None, |start| Type::integer(*start));
scalar!(bool, NoLimit, |_| None, |_| None, |start| Type::Boolean { start: *start });
scalar!(String, NoLimit, |_| None, |_| None, |start| Type::String { start: start.clone().into() });

impl<T: Choice> Scalar for T {
    type Limit = NoLimit;
}

impl<T: Choice> Slot for T {
    fn get(&self) -> Value {
        Value::Integer(self.number())
    }

    fn set(&mut self, value: Value) -> bool {
        let Value::Integer(number) = value else { return false };
        if let Some(item) = T::of_number(number) {
            *self = item;
        }
        true
    }

    fn row(&self, name: String) -> Row<()> {
        let mut row = Row::new(name, Type::Enumeration { start: self.number(), items: T::ENUMERATION }, None);
        row.variable.items_only = true;
        row
    }
}

/// A field: a variable or a structure of variables, or an array of them.
#[doc(hidden)]
#[diagnostic::on_unimplemented(
    message = "`{Self}` is neither a type of variables nor a structure of them",
    label = "expected f64, i32, bool, String, an enum with `#[derive(Choice)]`, a structure with `#[derive(Variables)]`, or an array of \
             them; `#[hidden]` for what is no variable"
)]
pub trait Field<Kind> {
    /// The variable or structure, or the element type of the array.
    type Item;
    /// Number of variables.
    const COUNT: usize;
    /// Appends the lengths of an array through all dimensions.
    fn lengths(_: &mut Vec<usize>) {}
    /// Appends the variables or structures.
    fn items<'f>(&'f self, items: &mut Vec<&'f Self::Item>);
    fn at(&self, number: usize) -> &dyn Slot;
    fn at_mut(&mut self, number: usize) -> &mut dyn Slot;
}

/// [`Field`] that is a variable.
#[doc(hidden)]
pub enum Single {}

/// [`Field`] that is a structure.
#[doc(hidden)]
pub enum Structure {}

/// [`Field`] that is an array.
#[doc(hidden)]
pub struct Many<Kind>(PhantomData<Kind>);

impl<T: Scalar> Field<Single> for T {
    type Item = T;
    const COUNT: usize = 1;

    fn items<'f>(&'f self, items: &mut Vec<&'f T>) {
        items.push(self);
    }

    fn at(&self, _: usize) -> &dyn Slot {
        self
    }

    fn at_mut(&mut self, _: usize) -> &mut dyn Slot {
        self
    }
}

impl<V: Variables> Field<Structure> for V {
    type Item = V;
    const COUNT: usize = V::COUNT;

    fn items<'f>(&'f self, items: &mut Vec<&'f V>) {
        items.push(self);
    }

    fn at(&self, number: usize) -> &dyn Slot {
        V::at(self, number)
    }

    fn at_mut(&mut self, number: usize) -> &mut dyn Slot {
        V::at_mut(self, number)
    }
}

macro_rules! lists {
    ($($list:ty),*) => {$(
        impl<K, T: Field<K>, const N: usize> Field<Many<K>> for $list {
            type Item = T::Item;
            const COUNT: usize = N * T::COUNT;

            fn lengths(lengths: &mut Vec<usize>) {
                lengths.push(N);
                T::lengths(lengths);
            }

            fn items<'f>(&'f self, items: &mut Vec<&'f T::Item>) {
                for element in self.iter() {
                    element.items(items);
                }
            }

            fn at(&self, number: usize) -> &dyn Slot {
                self[number / T::COUNT].at(number % T::COUNT)
            }

            fn at_mut(&mut self, number: usize) -> &mut dyn Slot {
                self[number / T::COUNT].at_mut(number % T::COUNT)
            }
        }
    )*};
}
lists!([T; N], Array<T, N>);

/// The lengths of a field that is an array, and the variables or structures in it.
#[doc(hidden)]
pub fn items<K, F: Field<K>>(field: &F) -> (Vec<usize>, Vec<&F::Item>) {
    let (mut lengths, mut items) = (Vec::new(), Vec::new());
    F::lengths(&mut lengths);
    field.items(&mut items);
    (lengths, items)
}

/// As [`items`], of variables of any type.
#[doc(hidden)]
pub type Elements<'f> = (Vec<usize>, Vec<&'f dyn Slot>);

/// As [`items`] for a field of variables.
#[doc(hidden)]
pub fn elements<K, F: Field<K, Item: Scalar>>(field: &F) -> Elements<'_> {
    let (lengths, items) = items(field);
    (lengths, items.into_iter().map(|item| item as &dyn Slot).collect())
}

/// The value of the attribute `start` for a field of type `F`: the same type, or one value for all elements.
#[doc(hidden)]
#[diagnostic::on_unimplemented(message = "`{Self}` cannot be the start value of a `{F}`")]
pub trait Start<F> {
    fn into_start(self) -> F;
}

impl<F> Start<F> for F {
    fn into_start(self) -> F {
        self
    }
}

impl<T: Scalar + Clone, const N: usize> Start<[T; N]> for T {
    fn into_start(self) -> [T; N] {
        std::array::from_fn(|_| self.clone())
    }
}

impl<T: Scalar + Clone, const N: usize> Start<Array<T, N>> for T {
    fn into_start(self) -> Array<T, N> {
        Array(self.into_start())
    }
}

impl<T, const N: usize> Start<Array<T, N>> for [T; N] {
    fn into_start(self) -> Array<T, N> {
        Array(self)
    }
}

impl Start<String> for &str {
    fn into_start(self) -> String {
        self.to_owned()
    }
}

impl<const N: usize> Start<[String; N]> for [&str; N] {
    fn into_start(self) -> [String; N] {
        self.map(str::to_owned)
    }
}

/// For attributes that only a variable of type Real can have.
#[doc(hidden)]
#[diagnostic::on_unimplemented(
    message = "only a variable of type f64 can have this attribute, not one of type `{Self}`"
)]
pub trait Real {}

impl Real for f64 {}

/// Fails to compile unless the field is of type Real.
#[doc(hidden)]
pub fn only_real<K, F: Field<K, Item: Real>>() {}

/// Fails to compile unless a limit has the limit type of the field.
#[doc(hidden)]
pub fn limit<K, F: Field<K, Item: Scalar>>(_: <F::Item as Scalar>::Limit) {}

/// Changes a row by a function or a closure.
#[doc(hidden)]
pub fn apply(row: Row<()>, with: impl FnOnce(Row<()>) -> Row<()>) -> Row<()> {
    with(row)
}
