//! `#[derive(Variables)]`.

use proc_macro2::TokenStream;
use quote::{format_ident, quote, quote_spanned};
use syn::spanned::Spanned;
use syn::{Data, DeriveInput, Error, Expr, Field, Fields, GenericParam, Generics, Ident, LitStr, Member, Result, Type};

use crate::attributes::{Attributes, Item, Role, items, literal};
use crate::names::{check, description};

/// The implementation for a structure.
pub fn derive(input: &DeriveInput) -> Result<TokenStream> {
    let Data::Struct(data) = &input.data else {
        return Err(Error::new(input.ident.span(), "expected a structure: an enum has `#[derive(Choice)]`"));
    };
    let parameters: Vec<String> = input.generics.type_params().map(|parameter| parameter.ident.to_string()).collect();
    let keys: Vec<&str> = ["context", "default"].into_iter().chain(parameters.iter().map(String::as_str)).collect();
    let (mut context, mut has_default, mut chosen) = (None, false, Vec::new());
    for attribute in input.attrs.iter().filter(|attribute| attribute.path().is_ident("variables")) {
        for Item { key, value } in items(attribute, "variables", &keys)? {
            match value {
                Some(value) if key == "context" => context = Some(value),
                None => has_default = true,
                value => chosen.push((key, value)),
            }
        }
    }
    let target = Target::new(input, &chosen);
    let default = has_default.then(|| default(&target, &data.fields));
    let mut seen: Vec<String> = Vec::new();
    let (mut lenses, mut members) = (Vec::new(), Vec::new());
    for (at, field) in data.fields.iter().enumerate() {
        let attributes = Attributes::of(field)?;
        if attributes.role == Role::Hidden {
            continue;
        }
        let member = field.ident.clone().map_or_else(|| Member::Unnamed(at.into()), Member::Named);
        let lens = format_ident!("Field{at}");
        let name = name_of(field, &attributes, at, &data.fields)?;
        if let Some(name) = &name {
            if seen.contains(&name.value()) {
                return Err(Error::new(name.span(), format!("there are two variables named `{}`", name.value())));
            }
            seen.push(name.value());
        }
        lenses.push(lens_of(&target, &lens, &member, &field.ty));
        members.push(if attributes.role == Role::Nested {
            nested(&target, &lens, &member, &field.ty, &attributes, name.as_ref(), context.is_some())
        } else {
            variable(&target, &lens, &member, field, &attributes, name.as_ref())
        });
    }
    let fields = members.iter().map(|member| &member.fields);
    let (rows, places) = (members.iter().map(|member| &member.rows), members.iter().map(|member| &member.places));
    let (ident, context) = (&input.ident, context.map_or_else(|| quote!(()), |context| quote!(#context)));
    let aliases = chosen.iter().map(|(parameter, argument)| quote!(#[allow(dead_code)] type #parameter = #argument;));
    let (_, types, _) = input.generics.split_for_impl();
    let (bounds, _, conditions) = target.generics.split_for_impl();
    Ok(quote! {
        #[automatically_derived]
        const _: () = {
            #(#aliases)*
            #(#lenses)*
            #default

            impl #bounds ::fmu_export::Variables for #ident #types #conditions {
                type Context = #context;

                const FIELDS: usize = 0 #(+ #fields)*;

                #[allow(unused, reason = "`context` and `index` are for the attributes, and nothing follows the last field")]
                fn describe(
                    &self,
                    scope: &::fmu_export::variables::Scope<'_, Self::Context>,
                    rows: &mut ::std::vec::Vec<::fmu_export::variable::Row<()>>,
                ) {
                    let context = scope.context;
                    let mut field = 0;
                    #(#rows)*
                }

                fn places<Place: ::fmu_export::variables::Lens<Target = Self>>(
                    places: &mut ::std::vec::Vec<::fmu_export::variable::Place<Place::Data>>,
                ) {
                    #(#places)*
                }
            }
        };
    })
}

/// `Default` with the default of every field, also of arrays whose length is a parameter, for which Rust has none.
fn default(target: &Target<'_>, fields: &Fields) -> TokenStream {
    let values = fields.iter().enumerate().map(|(at, field)| {
        let member = field.ident.clone().map_or_else(|| Member::Unnamed(at.into()), Member::Named);
        match &field.ty {
            Type::Array(array) => {
                let length = &array.len;
                quote!(#member: [::core::default::Default::default(); #length])
            }
            _ => quote!(#member: ::core::default::Default::default()),
        }
    });
    let ident = &target.input.ident;
    let (_, types, _) = target.input.generics.split_for_impl();
    let (bounds, _, conditions) = target.generics.split_for_impl();
    quote! {
        impl #bounds ::core::default::Default for #ident #types #conditions {
            fn default() -> Self {
                Self { #(#values,)* }
            }
        }
    }
}

/// The structure, and what it stays generic over: the other type parameters become aliases of their arguments.
struct Target<'i> {
    input: &'i DeriveInput,
    generics: Generics,
}

impl<'i> Target<'i> {
    fn new(input: &'i DeriveInput, chosen: &[(Ident, Option<Expr>)]) -> Self {
        let mut generics = input.generics.clone();
        let is_chosen = |parameter: &GenericParam| match parameter {
            GenericParam::Type(parameter) => chosen.iter().any(|(chosen, _)| *chosen == parameter.ident),
            _ => false,
        };
        generics.params = generics.params.into_iter().filter(|parameter| !is_chosen(parameter)).collect();
        Self { input, generics }
    }
}

/// The name of a variable or structure as far as it is known when the macro runs.
fn name_of(field: &Field, attributes: &Attributes, at: usize, fields: &Fields) -> Result<Option<LitStr>> {
    let given = match attributes.role {
        Role::Nested if attributes.has("prefix") || attributes.has("prefixes") => return Ok(None),
        _ if attributes.has("names") => return Ok(None),
        _ => attributes.value("name"),
    };
    let name = match (given, &field.ident) {
        (Some(value), _) => match literal(value) {
            Some(name) => name.clone(),
            None => return Ok(None),
        },
        (None, Some(ident)) => {
            let text = ident.to_string();
            LitStr::new(text.strip_prefix("r#").unwrap_or(&text), ident.span())
        }
        (None, None) if attributes.role == Role::Nested && fields.len() == 1 => return Ok(None),
        (None, None) => {
            return Err(Error::new(field.ty.span(), format!("field {at} has no name: give it one by `name = …`")));
        }
    };
    check(&name)?;
    Ok(Some(name))
}

/// The place of a field within its structure.
fn lens_of(target: &Target<'_>, lens: &Ident, member: &Member, of_type: &Type) -> TokenStream {
    let ident = &target.input.ident;
    let (_, arguments, _) = target.input.generics.split_for_impl();
    let (bounds, types, conditions) = target.generics.split_for_impl();
    quote! {
        struct #lens #bounds (::core::marker::PhantomData<fn() -> #ident #arguments>) #conditions;

        impl #bounds ::fmu_export::variables::Lens for #lens #types #conditions {
            type Data = #ident #arguments;
            type Target = #of_type;
            const COUNT: usize = 1;

            #[inline]
            fn get(data: &Self::Data, _: usize) -> &Self::Target {
                &data.#member
            }

            #[inline]
            fn get_mut(data: &mut Self::Data, _: usize) -> &mut Self::Target {
                &mut data.#member
            }
        }
    }
}

/// The code for a field.
struct Code {
    /// Number of fields that are variables in it.
    fields: TokenStream,
    /// Adds the rows.
    rows: TokenStream,
    /// Adds access to values.
    places: TokenStream,
}

/// A field that is a structure, or an array of them.
fn nested(
    target: &Target<'_>,
    lens: &Ident,
    member: &Member,
    of_type: &Type,
    attributes: &Attributes,
    name: Option<&LitStr>,
    has_context: bool,
) -> Code {
    let (_, types, _) = target.generics.split_for_impl();
    let base = name.map_or_else(|| quote!(""), |name| quote!(#name));
    let prefixes = match (attributes.value("prefix"), attributes.value("prefixes"), name) {
        (Some(prefix), ..) => {
            quote!(::core::option::Option::Some(::std::vec![::std::format!("{}{}", scope.at.prefix, #prefix)]))
        }
        (_, Some(prefixes), _) => quote!(::core::option::Option::Some(
            (#prefixes).into_iter().map(|prefix| ::std::format!("{}{}", scope.at.prefix, prefix)).collect()
        )),
        (_, _, None) => quote!(::core::option::Option::Some(::std::vec![scope.at.prefix.clone()])),
        _ => quote!(::core::option::Option::None),
    };
    let count = optional(attributes.value("count"));
    let context = match attributes.value("context") {
        Some(context) => quote!(&#context),
        None if has_context => quote!(context),
        None => quote!(&()),
    };
    // The span is that of the type, so that errors of trait bounds point at the field.
    let nested = quote_spanned!(of_type.span()=> <#of_type as ::fmu_export::variables::Nested<_>>);
    Code {
        fields: quote!(#nested::FIELDS),
        rows: quote! {
            #nested::describe(
                &self.#member,
                &scope.at.within(#base, field),
                &|index: usize, describe: &mut dyn ::core::ops::FnMut(&_)| describe(#context),
                #prefixes,
                #count,
                rows,
            );
            field += #nested::FIELDS;
        },
        places: quote!(#nested::places::<::fmu_export::variables::Then<Place, #lens #types>>(places);),
    }
}

/// A field that is a variable, or an array of them.
fn variable(
    target: &Target<'_>,
    lens: &Ident,
    member: &Member,
    field: &Field,
    attributes: &Attributes,
    name: Option<&LitStr>,
) -> Code {
    let (_, types, _) = target.generics.split_for_impl();
    let of_type = &field.ty;
    let names = match (attributes.value("names"), attributes.value("name"), name) {
        (Some(names), ..) => quote!(Each((#names).into_iter().map(::std::convert::Into::into).collect())),
        (None, Some(name), None) => quote!(Common(::std::convert::Into::into(#name))),
        (_, _, name) => quote!(Common(::std::convert::Into::into(#name))),
    };
    let unit =
        attributes.value("unit").map_or_else(|| quote!(::core::default::Default::default()), |unit| quote!(#unit));
    let start = match attributes.value("start") {
        Some(start) => quote_spanned!(start.span()=>
            ::core::option::Option::Some(::fmu_export::variables::Start::<#of_type>::into_start(#start))),
        None => quote!(::core::option::Option::None),
    };
    let count = optional(attributes.value("count"));
    let finish = finish(attributes, field);
    let checks = checks(attributes, of_type);
    let with = attributes.value("with").map(|with| {
        quote! {
            let with: &mut dyn ::core::ops::FnMut(
                ::fmu_export::variable::Row<()>,
            ) -> ::fmu_export::variable::Row<()> = &mut (#with);
            let row = with(row);
        }
    });
    let add = quote_spanned!(of_type.span()=> ::fmu_export::variables::add::<#of_type>);
    let of_field = quote_spanned!(of_type.span()=> <#of_type as ::fmu_export::variables::Field>);
    Code {
        fields: quote!(1),
        rows: quote! {
            #checks
            #add(
                rows,
                (&scope.at, field),
                ::fmu_export::variables::Names::#names,
                &|index| #unit,
                (&self.#member, #start),
                #count,
                &mut |row| {
                    let index = row.index();
                    #finish
                    #with
                    row
                },
            );
            field += 1;
        },
        places: quote!(places.push(#of_field::place::<::fmu_export::variables::Then<Place, #lens #types>>());),
    }
}

fn optional(value: Option<&Expr>) -> TokenStream {
    value.map_or_else(|| quote!(::core::option::Option::None), |value| quote!(::core::option::Option::Some(#value)))
}

/// Attributes that suit some types only.
fn checks(attributes: &Attributes, of_type: &Type) -> TokenStream {
    let of_reals = ["display_unit", "nominal", "state", "derivative_of"];
    let there = of_reals.into_iter().filter(|key| attributes.has(key));
    let checks =
        there.map(|key| quote_spanned!(attributes.span(key)=> ::fmu_export::variables::only_real::<#of_type>();));
    quote!(#(#checks)*)
}

/// Role and attributes of a row.
fn finish(attributes: &Attributes, field: &Field) -> TokenStream {
    let of_type = &field.ty;
    let mut steps = Vec::new();
    steps.push(match attributes.role {
        Role::Parameter if attributes.has("tunable") => quote!(.tunable()),
        Role::Parameter if attributes.has("calculated") => quote!(.calculated()),
        Role::Parameter => quote!(.fixed()),
        Role::Input => quote!(.input()),
        Role::Output => quote!(.output()),
        Role::Local if attributes.has("constant") => quote!(.constant()),
        Role::Local | Role::Nested | Role::Hidden => quote!(.local()),
    });
    let about = attributes.value("description").map_or_else(
        || {
            let text = description(&field.attrs);
            quote!(#text)
        },
        |text| quote!(#text),
    );
    steps.push(quote!(.description(#about)));
    for flag in ["discrete", "exact", "state"].into_iter().filter(|flag| attributes.has(flag)) {
        let flag = Ident::new(flag, attributes.span(flag));
        steps.push(quote!(.#flag()));
    }
    for limit in ["min", "max"] {
        if let Some(value) = attributes.value(limit) {
            let method = Ident::new(limit, attributes.span(limit));
            steps.push(quote_spanned!(value.span()=> .#method(::fmu_export::variables::limit::<#of_type>(#value))));
        }
    }
    for key in ["nominal", "display_unit", "derivative_of"] {
        if let Some(value) = attributes.value(key) {
            let method = Ident::new(key, attributes.span(key));
            steps.push(quote!(.#method(#value)));
        }
    }
    for key in ["depends_on", "starts_from"] {
        if let Some(value) = attributes.value(key) {
            let method = Ident::new(key, attributes.span(key));
            let is_empty = matches!(value, Expr::Array(array) if array.elems.is_empty());
            steps.push(match (is_empty, key) {
                (true, "depends_on") => quote!(.depends_on_nothing()),
                (true, _) => quote!(.starts_from_nothing()),
                _ => quote!(.#method(#value)),
            });
        }
    }
    quote!(let row = row #(#steps)*;)
}
