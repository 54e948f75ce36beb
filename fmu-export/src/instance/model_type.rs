//! A model that can be instantiated, and its descriptions.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, OnceLock};

use super::Instance;
use super::run::{Core, Typed};
use crate::check;
use crate::description::{self, Description, Standard};
use crate::interface::guard::panic_message;
use crate::model::{Capabilities, Info, Model};
use crate::resources::Resources;
use crate::state::HiddenState;
use crate::variable::{Table, Type, Value, Variable};

/// A model that can be instantiated, independent of its Rust type. Instances share its table.
pub struct ModelType {
    /// Name and description.
    pub info: Info,
    /// Optional capabilities.
    pub capabilities: Capabilities,
    variables: Arc<[Variable]>,
    new_core: Box<dyn Fn() -> Box<dyn Core> + Send + Sync>,
    /// In the order of [`Standard::ALL`].
    descriptions: [OnceLock<Description>; 3],
}

impl ModelType {
    /// The model type of a Rust type.
    pub fn of<M: Model>() -> Self {
        let table = Arc::new(Table::new(M::table()));
        Self {
            info: M::INFO,
            capabilities: Capabilities { snapshots: M::State::SAVED, ..M::CAPABILITIES },
            variables: table.variables.clone(),
            new_core: Box::new(move || Box::new(Typed::<M>::new(table.clone()))),
            descriptions: Default::default(),
        }
    }

    /// The variables in the order of the table. The index of a variable is its value reference.
    pub fn variables(&self) -> &[Variable] {
        &self.variables
    }

    /// Makes an instance with the start values of the table, without a folder `resources`.
    pub fn instantiate(&self) -> Instance {
        self.instantiate_with(Resources::default())
    }

    /// Makes an instance that finds its files in that folder.
    pub fn instantiate_with(&self, resources: Resources) -> Instance {
        Instance::new(self.variables.clone(), self.capabilities, (self.new_core)(), resources)
    }

    /// Errors in the table, each in a sentence; the packager refuses a model with any.
    pub fn problems(&self) -> Vec<String> {
        let mut found = check::problems(&self.info, &self.variables);
        match catch_unwind(AssertUnwindSafe(|| self.shared_places())) {
            Ok(shared) => found.extend(shared),
            Err(panic) => {
                found.push(format!("a row panics when it is read or written: {}", panic_message(panic.as_ref())))
            }
        }
        found
    }

    /// Pairs of rows that access the same value: each changes the value of the other.
    fn shared_places(&self) -> Vec<String> {
        let start = (self.new_core)();
        let indices = self.suspects(&*start).into_iter();
        // Variables that read differently once the row has written another value.
        let changed = |index: usize| {
            let mut core = (self.new_core)();
            core.set(index, other(&self.variables[index], start.get(index)));
            indices.clone().filter(|at| !same(&core.get(*at), &start.get(*at))).collect::<Vec<_>>()
        };
        let changed: HashMap<usize, Vec<usize>> = indices.clone().map(|index| (index, changed(index))).collect();
        let mut found = Vec::new();
        for one in indices {
            for other in changed[&one].iter().filter(|other| one < **other && changed[*other].contains(&one)) {
                let [one, other] = [one, *other].map(|index| &self.variables[index].name);
                found.push(format!("{one} and {other} access the same field"));
            }
        }
        found
    }

    /// Rows that lose a value when others are written. A bit of its index decides whether a row gets its start value or another one, so that
    /// any two rows get different values at least once, in both orders.
    fn suspects(&self, start: &dyn Core) -> Vec<usize> {
        let count = self.variables.len();
        let mut suspect = vec![false; count];
        for bit in 0..usize::BITS - count.leading_zeros() {
            for backward in [false, true] {
                let mut core = (self.new_core)();
                let written: Vec<_> = (0..count)
                    .map(|index| match (index >> bit) & 1 {
                        0 => start.get(index),
                        _ => other(&self.variables[index], start.get(index)),
                    })
                    .collect();
                for at in 0..count {
                    let index = if backward { count - 1 - at } else { at };
                    core.set(index, written[index].clone());
                }
                for index in 0..count {
                    suspect[index] |= !same(&core.get(index), &written[index]);
                }
            }
        }
        (0..count).filter(|index| suspect[*index]).collect()
    }

    /// The model description by a standard.
    pub fn description(&self, standard: Standard) -> &Description {
        let at = Standard::ALL.iter().position(|known| *known == standard).expect("all standards are listed");
        self.descriptions[at].get_or_init(|| {
            if cfg!(miri) {
                // Under Miri, writing descriptions would take many minutes.
                return Description { token: format!("{{{} {standard:?}}}", self.info.name), xml: String::new() };
            }
            description::write(&self.info, self.capabilities, &self.variables, standard)
        })
    }

    /// GUID of the description by FMI 2.0.
    pub fn guid(&self) -> &str {
        &self.description(Standard::Fmi2).token
    }

    /// The text of `modelDescription.xml` by FMI 2.0.
    pub fn xml(&self) -> &str {
        &self.description(Standard::Fmi2).xml
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

/// Lets [`export_fmus!`](crate::export_fmus) find out whether a type is a [`Model`] or a
/// [`SampledModel`](crate::SampledModel): the compiler looks for a method first on the type, then on a reference.
#[doc(hidden)]
pub mod kind {
    use std::marker::PhantomData;

    use super::ModelType;
    use crate::model::{self, Model, SampledModel};

    pub struct Of<M>(PhantomData<M>);

    impl<M> Of<M> {
        pub const NEW: Self = Self(PhantomData);
    }

    pub trait Continuous {
        fn model_type(&self) -> ModelType;
    }

    impl<M: Model> Continuous for Of<M> {
        fn model_type(&self) -> ModelType {
            ModelType::of::<M>()
        }
    }

    pub trait Sampled {
        fn model_type(&self) -> ModelType;
    }

    impl<S: SampledModel> Sampled for &Of<S> {
        fn model_type(&self) -> ModelType {
            ModelType::of::<model::Sampled<S>>()
        }
    }
}
