//! The derive macros of fmu-export: [`Variables`] for structures, [`Choice`] for enums. `fmu-export` re-exports them and explains
//! them with examples.

mod attributes;
mod choice;
mod names;
mod variables;

use proc_macro::TokenStream;
use syn::{DeriveInput, Error, parse_macro_input};

/// Makes variables of the fields of a structure; explained in `fmu_export::Variables`.
#[proc_macro_derive(Variables, attributes(variables, parameter, input, output, local, nested, hidden))]
pub fn derive_variables(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    variables::derive(&input).unwrap_or_else(|error| variables::refuse(&input, error)).into()
}

/// Makes an enumeration of a Rust enum; explained in `fmu_export::Choice`.
#[proc_macro_derive(Choice, attributes(item, choice))]
pub fn derive_choice(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    choice::derive(&input).unwrap_or_else(Error::into_compile_error).into()
}
