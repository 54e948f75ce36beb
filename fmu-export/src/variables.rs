//! Variables as fields of a structure: [`derive@crate::Variables`], and of Rust enums: [`derive@crate::Choice`].
//!
//! A field is a variable, and its doc comment the description. The attribute gives the role, and in parentheses what else there is
//! to say; README lists it all.
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
//! Mistakes are errors of the compiler, at the place of the mistake:
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
use crate::variable::{Access, Enumeration, Place, Row, Type};

/// A structure whose fields are variables; see [`derive@crate::Variables`].
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a structure of variables",
    label = "expected `#[derive(Variables)]` on it, or one of the attributes `#[parameter]`, `#[input]`, `#[output]`, `#[local]`, \
             `#[hidden]` on this field"
)]
pub trait Variables: Sized + 'static {
    /// Source of names, descriptions and start values when the table is built; `()` unless
    /// `#[variables(context = Type)]` says otherwise.
    type Context: ?Sized;

    /// Number of fields that are variables or arrays of them, those of structures within included.
    #[doc(hidden)]
    const FIELDS: usize;

    /// Appends the rows of this structure without access to values; for the macro.
    #[doc(hidden)]
    fn describe(&self, scope: &Scope<'_, Self::Context>, rows: &mut Vec<Row<()>>);

    /// Appends access to each field where the structure stands within the values of a model; for the macro.
    #[doc(hidden)]
    fn places<L: Lens<Target = Self>>(places: &mut Vec<Place<L::Data>>);

    /// The rows of a model whose values are this structure.
    fn rows() -> Vec<Row<Self>>
    where
        Self: Default + Variables<Context = ()>,
    {
        Self::rows_in(&())
    }

    /// As [`Variables::rows`], with what the attributes call `context`.
    fn rows_in(context: &Self::Context) -> Vec<Row<Self>>
    where
        Self: Default,
    {
        let (mut rows, mut places) = (Vec::new(), Vec::new());
        let at = At { prefix: String::new(), outer: 0, number: None, field: 0 };
        Self::default().describe(&Scope { at, context }, &mut rows);
        Self::places::<Whole<Self>>(&mut places);
        rows.into_iter().map(|row| row.placed(&places)).collect()
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

/// The place of a structure or a variable within the values of a model.
#[doc(hidden)]
pub trait Lens: 'static {
    type Data: 'static;
    type Target: 'static;
    fn get(data: &Self::Data, index: usize) -> &Self::Target;
    fn get_mut(data: &mut Self::Data, index: usize) -> &mut Self::Target;
    /// How many places there are: the index is below it.
    const COUNT: usize;
}

/// All values.
#[doc(hidden)]
pub struct Whole<D>(PhantomData<D>);

impl<D: 'static> Lens for Whole<D> {
    type Data = D;
    type Target = D;
    const COUNT: usize = 1;

    #[inline]
    fn get(data: &D, _: usize) -> &D {
        data
    }

    #[inline]
    fn get_mut(data: &mut D, _: usize) -> &mut D {
        data
    }
}

/// A place within a place.
#[doc(hidden)]
pub struct Then<A, B>(PhantomData<(A, B)>);

impl<A: Lens, B: Lens<Data = A::Target>> Lens for Then<A, B> {
    type Data = A::Data;
    type Target = B::Target;
    const COUNT: usize = A::COUNT * B::COUNT;

    #[inline]
    fn get(data: &A::Data, index: usize) -> &B::Target {
        B::get(A::get(data, index / B::COUNT), index % B::COUNT)
    }

    #[inline]
    fn get_mut(data: &mut A::Data, index: usize) -> &mut B::Target {
        B::get_mut(A::get_mut(data, index / B::COUNT), index % B::COUNT)
    }
}

/// An array.
#[doc(hidden)]
pub trait List: 'static {
    type Item: 'static;
    const LENGTH: usize;
    fn at(&self, index: usize) -> &Self::Item;
    fn at_mut(&mut self, index: usize) -> &mut Self::Item;
}

impl<T: 'static, const N: usize> List for [T; N] {
    type Item = T;
    const LENGTH: usize = N;

    #[inline]
    fn at(&self, index: usize) -> &T {
        &self[index]
    }

    #[inline]
    fn at_mut(&mut self, index: usize) -> &mut T {
        &mut self[index]
    }
}

impl<T: 'static, const N: usize> List for Array<T, N> {
    type Item = T;
    const LENGTH: usize = N;

    #[inline]
    fn at(&self, index: usize) -> &T {
        &self[index]
    }

    #[inline]
    fn at_mut(&mut self, index: usize) -> &mut T {
        &mut self[index]
    }
}

/// The elements of an array.
#[doc(hidden)]
pub struct Elements<A>(PhantomData<A>);

impl<A: Lens<Target: List>> Lens for Elements<A> {
    type Data = A::Data;
    type Target = <A::Target as List>::Item;
    const COUNT: usize = A::COUNT * <A::Target as List>::LENGTH;

    #[inline]
    fn get(data: &A::Data, index: usize) -> &Self::Target {
        A::get(data, index / <A::Target as List>::LENGTH).at(index % <A::Target as List>::LENGTH)
    }

    #[inline]
    fn get_mut(data: &mut A::Data, index: usize) -> &mut Self::Target {
        A::get_mut(data, index / <A::Target as List>::LENGTH).at_mut(index % <A::Target as List>::LENGTH)
    }
}

/// Where a structure stands within the values of a model.
#[doc(hidden)]
#[derive(Clone)]
pub struct At {
    /// Prefix of all names.
    pub prefix: String,
    /// Index of the structure among those at its place.
    pub outer: usize,
    /// Number of the structure in its array.
    pub number: Option<usize>,
    /// Number of its first field among those of the model, counted from 0.
    pub field: usize,
}

impl At {
    /// The place of a structure within this one, or of an array of them.
    pub fn within(&self, prefix: &str, fields_before: usize) -> Self {
        Self { prefix: format!("{}{prefix}", self.prefix), field: self.field + fields_before, ..*self }
    }
}

/// Its place, and what the attributes call `context`.
#[doc(hidden)]
pub struct Scope<'s, C: ?Sized> {
    pub at: At,
    pub context: &'s C,
}

/// A type of variables.
#[doc(hidden)]
pub trait Scalar: Sized + 'static {
    /// Its unit; `()` if it has none.
    type Unit;
    /// Its limits.
    type Limit: Into<f64>;
    fn place<L: Lens<Target = Self>>() -> Place<L::Data>;
    fn row(name: String, unit: Self::Unit, start: &Self) -> Row<()>;
}

/// The limits of a type that has none.
#[doc(hidden)]
pub enum NoLimit {}

impl From<NoLimit> for f64 {
    fn from(none: NoLimit) -> f64 {
        match none {}
    }
}

/// Implements a type whose field holds its values as they are.
macro_rules! scalar {
    ($scalar:ident, $unit:ty, $limit:ty, $kind:ident, |$given:ident, $start:ident| $of_type:expr) => {
        impl Scalar for $scalar {
            type Unit = $unit;
            type Limit = $limit;

            fn place<L: Lens<Target = Self>>() -> Place<L::Data> {
                Place::$kind(Access {
                    get: |data, at| L::get(data, at).clone(),
                    set: |data, at, value| *L::get_mut(data, at) = value,
                })
            }

            fn row(name: String, $given: $unit, $start: &Self) -> Row<()> {
                Row::new(name, $of_type, None)
            }
        }
    };
}
scalar!(f64, Unit, f64, Real, |unit, start| Type::real(*start, unit));
scalar!(i32, (), i32, Integer, |_unit, start| Type::integer(*start));
scalar!(bool, (), NoLimit, Boolean, |_unit, start| Type::Boolean { start: *start });
scalar!(String, (), NoLimit, String, |_unit, start| Type::String { start: start.clone().into() });

impl<T: Choice> Scalar for T {
    type Unit = ();
    type Limit = NoLimit;

    fn place<L: Lens<Target = T>>() -> Place<L::Data> {
        Place::Integer(Access {
            get: |data, at| L::get(data, at).number(),
            // A number that is none of an item was refused before.
            set: |data, at, number| {
                if let Some(item) = T::of_number(number) {
                    *L::get_mut(data, at) = item;
                }
            },
        })
    }

    fn row(name: String, (): (), start: &T) -> Row<()> {
        Row::new(name, Type::Enumeration { start: start.number(), items: T::ENUMERATION }, None).with_items_only()
    }
}

/// A type that a field with one of the attributes can have: a variable, or an array of them.
#[doc(hidden)]
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a type of variables",
    label = "expected f64, i32, bool, String, an enum with `#[derive(Choice)]`, or an array of them"
)]
pub trait Field: Sized + 'static {
    type Scalar: Scalar;
    /// Access to its elements, whose indices are counted through all dimensions.
    fn place<L: Lens<Target = Self>>() -> Place<L::Data>;
    /// Appends its elements, each with its indices, counted from 1, after those of the arrays around it.
    fn elements<'f>(&'f self, indices: &[usize], elements: &mut Vec<(Vec<usize>, &'f Self::Scalar)>);
}

impl<T: Scalar> Field for T {
    type Scalar = T;

    fn place<L: Lens<Target = T>>() -> Place<L::Data> {
        <T as Scalar>::place::<L>()
    }

    fn elements<'f>(&'f self, indices: &[usize], elements: &mut Vec<(Vec<usize>, &'f T)>) {
        elements.push((indices.to_vec(), self));
    }
}

macro_rules! list_of_fields {
    ($list:ty) => {
        impl<T: Field, const N: usize> Field for $list {
            type Scalar = T::Scalar;

            fn place<L: Lens<Target = Self>>() -> Place<L::Data> {
                <T as Field>::place::<Elements<L>>()
            }

            fn elements<'f>(&'f self, indices: &[usize], elements: &mut Vec<(Vec<usize>, &'f T::Scalar)>) {
                for (k, element) in self.iter().enumerate() {
                    element.elements(&[indices, &[k + 1]].concat(), elements);
                }
            }
        }
    };
}
list_of_fields!([T; N]);
list_of_fields!(Array<T, N>);

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

/// Names of the elements of a field.
#[doc(hidden)]
pub enum Names {
    /// `name`, `name[1]`, `name[1,2]`.
    Common(String),
    /// One for each.
    Each(Vec<String>),
}

/// Adds the rows of a field, which is the one of that number in its structure; for the macro.
///
/// # Panics
/// If there are not as many names as elements.
#[doc(hidden)]
pub fn add<F: Field>(
    rows: &mut Vec<Row<()>>,
    (at, field): (&At, usize),
    names: Names,
    unit: &dyn Fn(usize) -> <F::Scalar as Scalar>::Unit,
    (default, start): (&F, Option<F>),
    count: Option<usize>,
    finish: &mut dyn FnMut(Row<()>) -> Row<()>,
) {
    let mut elements = Vec::new();
    start.as_ref().unwrap_or(default).elements(&[], &mut elements);
    let (indices, starts): (Vec<_>, Vec<_>) = elements.into_iter().unzip();
    let names = names_of(&at.prefix, &names, &indices, count);
    for (index, (name, start)) in names.into_iter().zip(&starts).enumerate() {
        let row = F::Scalar::row(name, unit(index), start).at_place(at.outer * starts.len() + index, index);
        rows.push(finish(row.within(&at.prefix, at.number, at.field + field)));
    }
}

/// Names of the elements with these indices, or of the first `count` of them.
fn names_of(prefix: &str, names: &Names, indices: &[Vec<usize>], count: Option<usize>) -> Vec<String> {
    let made = count.unwrap_or(indices.len());
    assert!(made <= indices.len(), "count = {made} is refused for an array of {} elements", indices.len());
    if let Names::Each(names) = names {
        assert!(made == names.len(), "there are {} names for {made} elements: {}", names.len(), names.join(", "));
    }
    let name = |index: usize| match names {
        Names::Common(name) if indices[index].is_empty() => format!("{prefix}{name}"),
        Names::Common(name) => {
            let indices: Vec<_> = indices[index].iter().map(usize::to_string).collect();
            format!("{prefix}{name}[{}]", indices.join(","))
        }
        Names::Each(names) => format!("{prefix}{}", names[index]),
    };
    (0..made).map(name).collect()
}

/// Passes the context of each structure of an array by its index.
#[doc(hidden)]
pub type EachContext<'c, C> = dyn Fn(usize, &mut dyn FnMut(&C)) + 'c;

/// A field that is a structure of variables, or an array of them.
#[doc(hidden)]
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a structure of variables",
    label = "expected `#[derive(Variables)]` on it, or one of the attributes `#[parameter]`, `#[input]`, `#[output]`, `#[local]`, \
             `#[hidden]` on this field"
)]
pub trait Nested<Kind>: Sized + 'static {
    type Context: ?Sized;
    const FIELDS: usize;
    /// Appends the rows of the structure or structures that stand there; `context` passes that of each.
    fn describe(
        &self,
        at: &At,
        context: &EachContext<'_, Self::Context>,
        prefixes: Option<Vec<String>>,
        count: Option<usize>,
        rows: &mut Vec<Row<()>>,
    );
    fn places<L: Lens<Target = Self>>(places: &mut Vec<Place<L::Data>>);
}

/// [`Nested`] of one structure.
#[doc(hidden)]
pub enum One {}

/// [`Nested`] of an array.
#[doc(hidden)]
pub enum Many {}

impl<V: Variables> Nested<One> for V {
    type Context = V::Context;
    const FIELDS: usize = V::FIELDS;

    fn describe(
        &self,
        at: &At,
        context: &EachContext<'_, V::Context>,
        prefixes: Option<Vec<String>>,
        count: Option<usize>,
        rows: &mut Vec<Row<()>>,
    ) {
        if count == Some(0) {
            return;
        }
        let prefix = match prefixes.as_deref() {
            Some([prefix]) => prefix.clone(),
            _ => at.prefix.clone() + ".",
        };
        let at = At { prefix, ..*at };
        context(0, &mut |context| V::describe(self, &Scope { at: at.clone(), context }, rows));
    }

    fn places<L: Lens<Target = V>>(places: &mut Vec<Place<L::Data>>) {
        V::places::<L>(places);
    }
}

impl<A: List<Item: Variables>> Nested<Many> for A {
    type Context = <A::Item as Variables>::Context;
    const FIELDS: usize = <A::Item as Variables>::FIELDS;

    fn describe(
        &self,
        at: &At,
        context: &EachContext<'_, Self::Context>,
        prefixes: Option<Vec<String>>,
        count: Option<usize>,
        rows: &mut Vec<Row<()>>,
    ) {
        let count = count.or(prefixes.as_ref().map(Vec::len)).unwrap_or(A::LENGTH);
        assert!(count <= A::LENGTH, "{} has {} elements, fewer than {count}", at.prefix, A::LENGTH);
        for k in 0..count {
            let prefix = match &prefixes {
                Some(prefixes) => prefixes[k].clone(),
                None => format!("{}[{}].", at.prefix, k + 1),
            };
            let at = At { prefix, outer: at.outer * A::LENGTH + k, number: Some(k + 1), field: at.field };
            context(k, &mut |context| Variables::describe(self.at(k), &Scope { at: at.clone(), context }, rows));
        }
    }

    fn places<L: Lens<Target = A>>(places: &mut Vec<Place<L::Data>>) {
        <A::Item as Variables>::places::<Elements<L>>(places);
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
pub fn only_real<F: Field<Scalar: Real>>() {}

/// The limit of a field as a number.
#[doc(hidden)]
pub fn limit<F: Field>(limit: <F::Scalar as Scalar>::Limit) -> f64 {
    limit.into()
}
