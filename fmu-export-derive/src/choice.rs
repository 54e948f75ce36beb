//! `#[derive(Choice)]`.

use proc_macro2::TokenStream;
use quote::quote;
use syn::{Attribute, Data, DeriveInput, Error, Fields, Ident, LitStr, Result};

use crate::attributes::{items, literal};
use crate::names::description;

/// The implementation for an enum.
pub fn derive(input: &DeriveInput) -> Result<TokenStream> {
    let Data::Enum(data) = &input.data else {
        return Err(Error::new(input.ident.span(), "expected an enum: a structure has `#[derive(Variables)]`"));
    };
    if !input.generics.params.is_empty() {
        return Err(Error::new(input.ident.span(), "an enumeration cannot be generic"));
    }
    if data.variants.is_empty() {
        return Err(Error::new(input.ident.span(), "an enumeration has at least one item"));
    }
    let name = name_of(&input.ident, &input.ident.to_string(), &input.attrs, "choice")?;
    let mut seen: Vec<String> = Vec::new();
    let (mut entries, mut variants, mut numbers) = (Vec::new(), Vec::new(), Vec::new());
    for (variant, number) in data.variants.iter().zip(1_i32..) {
        if !matches!(variant.fields, Fields::Unit) {
            return Err(Error::new(variant.ident.span(), "an item of an enumeration has no fields"));
        }
        if let Some((_, value)) = &variant.discriminant {
            return Err(Error::new_spanned(value, "the values of items count from 1 and cannot be chosen"));
        }
        let item_name = name_of(&variant.ident, &lower(&variant.ident.to_string()), &variant.attrs, "item")?;
        if seen.contains(&item_name.value()) {
            return Err(Error::new(item_name.span(), format!("there are two items named `{}`", item_name.value())));
        }
        seen.push(item_name.value());
        let about = description(&variant.attrs);
        entries.push(quote!((#item_name, #about)));
        variants.push(&variant.ident);
        numbers.push(number);
    }
    let (ident, about) = (&input.ident, description(&input.attrs));
    Ok(quote! {
        #[automatically_derived]
        impl ::fmu_export::Choice for #ident {
            const ENUMERATION: &'static ::fmu_export::variable::Enumeration = {
                static ENUMERATION: ::fmu_export::variable::Enumeration =
                    ::fmu_export::variable::Enumeration::new(#name, #about, &[#(#entries),*]);
                &ENUMERATION
            };

            fn number(self) -> i32 {
                match self {
                    #(Self::#variants => #numbers,)*
                }
            }

            fn of_number(number: i32) -> ::core::option::Option<Self> {
                match number {
                    #(#numbers => ::core::option::Option::Some(Self::#variants),)*
                    _ => ::core::option::Option::None,
                }
            }
        }
    })
}

/// The name that the attribute gives to an identifier, or else the default.
fn name_of(ident: &Ident, default: &str, attributes: &[Attribute], attribute: &str) -> Result<LitStr> {
    let mut name = LitStr::new(default, ident.span());
    for found in attributes.iter().filter(|found| found.path().is_ident(attribute)) {
        for item in items(found, attribute, &["name"])? {
            let value = item.value.expect("a key without a value was refused");
            name = literal(&value).cloned().ok_or_else(|| Error::new_spanned(&value, "expected a text"))?;
        }
    }
    Ok(name)
}

/// A name that begins with a small letter.
fn lower(name: &str) -> String {
    let mut letters = name.chars();
    letters.next().map(|first| first.to_lowercase().chain(letters).collect()).unwrap_or_default()
}
