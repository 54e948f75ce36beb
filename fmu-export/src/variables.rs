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
use crate::variable::{Access, Enumeration, Row};

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

    /// The rows of this structure where it stands within the values of a model; for the macro.
    #[doc(hidden)]
    fn rows_at<L: Lens<Target = Self>>(scope: &Scope<'_, L::Data, Self::Context>) -> Vec<Row<L::Data>>;

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
        let scope = Scope { prefix: String::new(), context, defaults: &Self::default(), outer: 0, number: None };
        Self::rows_at::<Whole<Self>>(&scope)
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

/// Context of the rows of a structure: prefix, index, description.
#[doc(hidden)]
pub struct Scope<'s, D, C: ?Sized> {
    /// Prefix of all names.
    pub prefix: String,
    pub context: &'s C,
    /// The values from which start values come that no attribute gives.
    pub defaults: &'s D,
    /// Index of the structure among those at its place.
    pub outer: usize,
    /// Number of the structure in its array.
    pub number: Option<usize>,
}

/// A type of variables.
#[doc(hidden)]
pub trait Scalar: Sized + 'static {
    /// Its unit; `()` if it has none.
    type Unit;
    /// Its limits.
    type Limit: Into<f64>;
    /// What its place holds.
    type Value: 'static;
    fn access<L: Lens<Target = Self>>() -> Access<L::Data, Self::Value>;
    fn row<D>(name: String, place: Access<D, Self::Value>, unit: &Self::Unit, start: &Self) -> Row<D>;
}

/// The limits of a type that has none.
#[doc(hidden)]
pub enum NoLimit {}

impl From<NoLimit> for f64 {
    fn from(none: NoLimit) -> f64 {
        match none {}
    }
}

impl Scalar for f64 {
    type Unit = Unit;
    type Limit = f64;
    type Value = f64;

    fn access<L: Lens<Target = f64>>() -> Access<L::Data, f64> {
        Access { get: |data, at| *L::get(data, at), set: |data, at, value| *L::get_mut(data, at) = value }
    }

    fn row<D>(name: String, place: Access<D, f64>, unit: &Unit, start: &f64) -> Row<D> {
        Row::real(name, place, *unit, *start)
    }
}

impl Scalar for i32 {
    type Unit = ();
    type Limit = i32;
    type Value = i32;

    fn access<L: Lens<Target = i32>>() -> Access<L::Data, i32> {
        Access { get: |data, at| *L::get(data, at), set: |data, at, value| *L::get_mut(data, at) = value }
    }

    fn row<D>(name: String, place: Access<D, i32>, (): &(), start: &i32) -> Row<D> {
        Row::integer(name, place, *start)
    }
}

impl Scalar for bool {
    type Unit = ();
    type Limit = NoLimit;
    type Value = bool;

    fn access<L: Lens<Target = bool>>() -> Access<L::Data, bool> {
        Access { get: |data, at| *L::get(data, at), set: |data, at, value| *L::get_mut(data, at) = value }
    }

    fn row<D>(name: String, place: Access<D, bool>, (): &(), start: &bool) -> Row<D> {
        Row::boolean(name, place, *start)
    }
}

impl Scalar for String {
    type Unit = ();
    type Limit = NoLimit;
    type Value = String;

    fn access<L: Lens<Target = String>>() -> Access<L::Data, String> {
        Access { get: |data, at| L::get(data, at).clone(), set: |data, at, value| *L::get_mut(data, at) = value }
    }

    fn row<D>(name: String, place: Access<D, String>, (): &(), start: &String) -> Row<D> {
        Row::string(name, place, start.clone())
    }
}

impl<T: Choice> Scalar for T {
    type Unit = ();
    type Limit = NoLimit;
    type Value = i32;

    fn access<L: Lens<Target = T>>() -> Access<L::Data, i32> {
        Access {
            get: |data, at| L::get(data, at).number(),
            // A number that is none of an item was refused before.
            set: |data, at, number| {
                if let Some(item) = T::of_number(number) {
                    *L::get_mut(data, at) = item;
                }
            },
        }
    }

    fn row<D>(name: String, place: Access<D, i32>, (): &(), start: &T) -> Row<D> {
        Row::choice(name, place, T::ENUMERATION, start.number()).with_items_only()
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
    fn access<L: Lens<Target = Self>>() -> Access<L::Data, <Self::Scalar as Scalar>::Value>;
    /// Appends its elements, each with its indices, counted from 1, after those of the arrays around it.
    fn elements<'f>(&'f self, indices: &[usize], elements: &mut Vec<(Vec<usize>, &'f Self::Scalar)>);
}

impl<T: Scalar> Field for T {
    type Scalar = T;

    fn access<L: Lens<Target = T>>() -> Access<L::Data, T::Value> {
        <T as Scalar>::access::<L>()
    }

    fn elements<'f>(&'f self, indices: &[usize], elements: &mut Vec<(Vec<usize>, &'f T)>) {
        elements.push((indices.to_vec(), self));
    }
}

macro_rules! list_of_fields {
    ($list:ty) => {
        impl<T: Field, const N: usize> Field for $list {
            type Scalar = T::Scalar;

            fn access<L: Lens<Target = Self>>() -> Access<L::Data, <T::Scalar as Scalar>::Value> {
                <T as Field>::access::<Elements<L>>()
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

/// Adds the rows of a field; for the macro.
///
/// # Panics
/// If there are not as many names as elements.
#[doc(hidden)]
pub fn add<L: Lens<Target: Field>, C: ?Sized>(
    rows: &mut Vec<Row<L::Data>>,
    scope: &Scope<'_, L::Data, C>,
    names: Names,
    unit: &dyn Fn(usize) -> <<L::Target as Field>::Scalar as Scalar>::Unit,
    start: Option<L::Target>,
    count: Option<usize>,
    finish: &mut dyn FnMut(Row<L::Data>) -> Row<L::Data>,
) {
    let mut elements = Vec::new();
    start.as_ref().unwrap_or_else(|| L::get(scope.defaults, scope.outer)).elements(&[], &mut elements);
    let (indices, starts): (Vec<_>, Vec<_>) = elements.into_iter().unzip();
    // What follows is compiled once for all fields of a type.
    let Scope { prefix, outer, number, .. } = scope;
    let names = names_of(prefix, &names, &indices, count);
    let place = <L::Target as Field>::access::<L>();
    add_elements(rows, (prefix, *outer, *number), place, names, &starts, unit, finish);
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

fn add_elements<D, S: Scalar>(
    rows: &mut Vec<Row<D>>,
    (prefix, outer, number): (&str, usize, Option<usize>),
    place: Access<D, S::Value>,
    names: Vec<String>,
    starts: &[&S],
    unit: &dyn Fn(usize) -> S::Unit,
    finish: &mut dyn FnMut(Row<D>) -> Row<D>,
) {
    for (index, (name, start)) in names.into_iter().zip(starts).enumerate() {
        let row = S::row(name, place, &unit(index), start).at_place(outer * starts.len() + index, index);
        rows.push(finish(row.within(prefix, number)));
    }
}

/// A field that is a structure of variables, or an array of them.
#[doc(hidden)]
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a structure of variables",
    label = "expected `#[derive(Variables)]` on it, or one of the attributes `#[parameter]`, `#[input]`, `#[output]`, `#[local]`, \
             `#[hidden]` on this field"
)]
pub trait Nested<Kind>: Sized + 'static {
    type Context: ?Sized;
    fn add<L: Lens<Target = Self>>(
        rows: &mut Vec<Row<L::Data>>,
        scope: &Scope<'_, L::Data, Self::Context>,
        prefixes: Option<Vec<String>>,
        count: Option<usize>,
    );
}

/// [`Nested`] of one structure.
#[doc(hidden)]
pub enum One {}

/// [`Nested`] of an array.
#[doc(hidden)]
pub enum Many {}

impl<V: Variables> Nested<One> for V {
    type Context = V::Context;

    fn add<L: Lens<Target = V>>(
        rows: &mut Vec<Row<L::Data>>,
        scope: &Scope<'_, L::Data, V::Context>,
        prefixes: Option<Vec<String>>,
        _: Option<usize>,
    ) {
        let prefix = match prefixes.as_deref() {
            Some([prefix]) => prefix.clone(),
            _ => scope.prefix.clone() + ".",
        };
        rows.extend(V::rows_at::<L>(&Scope { prefix, ..*scope }));
    }
}

impl<A: List<Item: Variables>> Nested<Many> for A {
    type Context = <A::Item as Variables>::Context;

    fn add<L: Lens<Target = A>>(
        rows: &mut Vec<Row<L::Data>>,
        scope: &Scope<'_, L::Data, Self::Context>,
        prefixes: Option<Vec<String>>,
        count: Option<usize>,
    ) {
        let count = count.or(prefixes.as_ref().map(Vec::len)).unwrap_or(A::LENGTH);
        assert!(count <= A::LENGTH, "{} has {} elements, fewer than {count}", scope.prefix, A::LENGTH);
        for k in 0..count {
            let prefix = match &prefixes {
                Some(prefixes) => prefixes[k].clone(),
                None => format!("{}[{}].", scope.prefix, k + 1),
            };
            let outer = scope.outer * A::LENGTH + k;
            rows.extend(A::Item::rows_at::<Elements<L>>(&Scope { prefix, outer, number: Some(k + 1), ..*scope }));
        }
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
