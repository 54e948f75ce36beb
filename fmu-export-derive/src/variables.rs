//! `#[derive(Variables)]`.

use proc_macro2::{TokenStream, TokenTree};
use quote::{quote, quote_spanned};
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
    let context = context.map_or_else(|| quote!(()), |context| quote!(#context));
    let target = Target::new(input, &chosen);
    let mut seen: Vec<String> = Vec::new();
    let (mut members, mut rows, mut defaults) = (Vec::new(), Vec::new(), Vec::new());
    for (at, field) in data.fields.iter().enumerate() {
        let attributes = Attributes::of(field)?;
        let member = field.ident.clone().map_or_else(|| Member::Unnamed(at.into()), Member::Named);
        if attributes.has("value") && !has_default {
            return Err(Error::new(attributes.span("value"), "`value` is for `#[variables(default)]`"));
        }
        defaults.push(default(&member, field, &attributes));
        if attributes.role == Role::Hidden {
            continue;
        }
        let name = name_of(field, &attributes, at, &data.fields)?;
        if let Some(name) = &name {
            if seen.contains(&name.value()) {
                return Err(Error::new(name.span(), format!("there are two variables named `{}`", name.value())));
            }
            seen.push(name.value());
        }
        let code = if attributes.role == Role::Nested {
            nested(&member, &field.ty, &attributes, name.as_ref())
        } else {
            variable(&target, &context, &member, field, &attributes, name.as_ref())
        };
        let of_type = &field.ty;
        // The span is that of the type, so that errors of trait bounds point at the field.
        let of_field = quote_spanned!(of_type.span()=> <#of_type as ::fmu_export::variables::Field<_>>);
        rows.push(quote!(#code before += #of_field::COUNT;));
        members.push((member, of_field));
    }
    let find = |at: TokenStream, reference: TokenStream| {
        let parts = members.iter().map(|(member, of_field)| {
            quote! {
                if number < #of_field::COUNT {
                    return #of_field::#at(#reference self.#member, number);
                }
                let number = number - #of_field::COUNT;
            }
        });
        quote!(#(#parts)* ::core::unreachable!("every variable is in a field"))
    };
    let (at, at_mut) = (find(quote!(at), quote!(&)), find(quote!(at_mut), quote!(&mut)));
    let fields = members.iter().map(|(_, of_field)| of_field);
    let ident = &input.ident;
    let aliases = chosen.iter().map(|(parameter, argument)| quote!(#[allow(dead_code)] type #parameter = #argument;));
    let (_, types, _) = input.generics.split_for_impl();
    let (bounds, _, conditions) = target.generics.split_for_impl();
    let default = has_default.then(|| {
        quote! {
            impl #bounds ::core::default::Default for #ident #types #conditions {
                fn default() -> Self {
                    Self { #(#defaults,)* }
                }
            }
        }
    });
    Ok(quote! {
        #[automatically_derived]
        const _: () = {
            #(#aliases)*
            #default

            impl #bounds ::fmu_export::Variables for #ident #types #conditions {
                type Context = #context;

                const COUNT: usize = 0 #(+ #fields::COUNT)*;

                #[allow(unused, reason = "`context` and `index` are for the attributes, and nothing follows the last field")]
                fn describe(
                    &self,
                    scope: &::fmu_export::variables::Scope,
                    context: &Self::Context,
                    rows: &mut ::std::vec::Vec<::fmu_export::variable::Row<()>>,
                ) {
                    let mut before = 0;
                    #(#rows)*
                }

                fn at(&self, number: usize) -> &dyn ::fmu_export::variable::Slot {
                    #at
                }

                fn at_mut(&mut self, number: usize) -> &mut dyn ::fmu_export::variable::Slot {
                    #at_mut
                }
            }
        };
    })
}

/// A compiler error, with an implementation so that the compiler does not report a missing one too.
pub fn refuse(input: &DeriveInput, error: Error) -> TokenStream {
    let (ident, error) = (&input.ident, error.into_compile_error());
    let (bounds, types, conditions) = input.generics.split_for_impl();
    quote! {
        #error

        #[automatically_derived]
        impl #bounds ::fmu_export::Variables for #ident #types #conditions {
            type Context = ();

            const COUNT: usize = 0;

            fn describe(
                &self,
                _: &::fmu_export::variables::Scope,
                _: &(),
                _: &mut ::std::vec::Vec<::fmu_export::variable::Row<()>>,
            ) {
            }

            fn at(&self, _: usize) -> &dyn ::fmu_export::variable::Slot {
                ::core::unreachable!()
            }

            fn at_mut(&mut self, _: usize) -> &mut dyn ::fmu_export::variable::Slot {
                ::core::unreachable!()
            }
        }
    }
}

/// The value of a field in `Default`: the given one or that of its type; Rust has none for arrays whose length is a parameter.
fn default(member: &Member, field: &Field, attributes: &Attributes) -> TokenStream {
    match (attributes.value("value"), &field.ty) {
        (Some(value), _) => quote!(#member: #value),
        (None, Type::Array(array)) => {
            let length = &array.len;
            quote!(#member: [::core::default::Default::default(); #length])
        }
        (None, _) => quote!(#member: ::core::default::Default::default()),
    }
}

/// The remaining generic parameters of the structure; the other type parameters become aliases of their arguments.
struct Target {
    generics: Generics,
}

impl Target {
    fn new(input: &DeriveInput, chosen: &[(Ident, Option<Expr>)]) -> Self {
        let mut generics = input.generics.clone();
        let is_chosen = |parameter: &GenericParam| match parameter {
            GenericParam::Type(parameter) => chosen.iter().any(|(chosen, _)| *chosen == parameter.ident),
            _ => false,
        };
        generics.params = generics.params.into_iter().filter(|parameter| !is_chosen(parameter)).collect();
        Self { generics }
    }

    /// Whether code depends on the remaining generic parameters.
    fn is_in(&self, code: TokenStream) -> bool {
        code.into_iter().any(|token| match token {
            TokenTree::Group(group) => self.is_in(group.stream()),
            TokenTree::Ident(ident) => {
                ident == "self"
                    || ident == "Self"
                    || self.generics.type_params().any(|parameter| parameter.ident == ident)
                    || self.generics.const_params().any(|parameter| parameter.ident == ident)
            }
            TokenTree::Punct(_) | TokenTree::Literal(_) => false,
        })
    }
}

/// The name of a variable or structure if the macro knows it.
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

/// A field that is a structure, or an array of them.
fn nested(member: &Member, of_type: &Type, attributes: &Attributes, name: Option<&LitStr>) -> TokenStream {
    let prefixes = match (attributes.value("prefix"), attributes.value("prefixes"), name) {
        (Some(prefix), ..) => quote!(each([#prefix])),
        (_, Some(prefixes), _) => quote!(each(#prefixes)),
        (_, _, Some(name)) => quote!(Common(::std::string::String::from(#name))),
        _ => quote!(each([""])),
    };
    let count = optional(attributes.value("count"));
    let context = attributes.value("context").map_or_else(|| quote!(context), |context| quote!(&#context));
    let structures = quote_spanned!(of_type.span()=> ::fmu_export::variables::items::<_, #of_type>);
    let describe = quote_spanned!(of_type.span()=> ::fmu_export::Variables::describe);
    let variables = quote_spanned!(of_type.span()=> <#of_type as ::fmu_export::variables::Field<_>>::COUNT);
    quote! {
        let (lengths, structures) = #structures(&self.#member);
        let variables = #variables;
        let prefixes = &::fmu_export::variables::Names::#prefixes;
        for scope in &scope.nested((before, variables), prefixes, &lengths, #count) {
            let index = scope.index;
            #describe(structures[index], scope, #context, rows);
        }
    }
}

/// A field that is a variable, or an array of them.
fn variable(
    target: &Target,
    context: &TokenStream,
    member: &Member,
    field: &Field,
    attributes: &Attributes,
    name: Option<&LitStr>,
) -> TokenStream {
    let of_type = &field.ty;
    let names = match (attributes.value("names"), attributes.value("name"), name) {
        (Some(names), ..) => quote!(each(#names)),
        (_, Some(name), None) => {
            let text = quote_spanned!(name.span()=> ::std::string::String::from);
            quote!(Common(#text(#name)))
        }
        (_, _, name) => quote!(Common(::std::string::String::from(#name))),
    };
    let start = match attributes.value("start") {
        Some(start) => {
            quote_spanned!(start.span()=> &::fmu_export::variables::Start::<#of_type>::into_start(#start))
        }
        None => quote!(&self.#member),
    };
    let elements = quote_spanned!(of_type.span()=> &::fmu_export::variables::elements::<_, #of_type>(#start));
    let count = optional(attributes.value("count"));
    let (steps, checks) = (steps(attributes, field), checks(attributes, of_type));
    let row = match attributes.value("with") {
        Some(with) => quote!(::fmu_export::variables::apply(row #steps, #with)),
        None => quote!(row #steps),
    };
    let describe = |elements: &TokenStream| {
        quote! {
            let names = &::fmu_export::variables::Names::#names;
            scope.rows(before, names, #elements, #count, rows, &|index, row| #row);
        }
    };
    // Code that is the same for all arguments of a generic structure is compiled once.
    let rows = if target.is_in(quote!(#context #names #count #row)) {
        describe(&elements)
    } else {
        let code = describe(&quote!(elements));
        quote! {{
            fn describe(
                scope: &::fmu_export::variables::Scope,
                context: &#context,
                before: usize,
                elements: &::fmu_export::variables::Elements<'_>,
                rows: &mut ::std::vec::Vec<::fmu_export::variable::Row<()>>,
            ) {
                #code
            }
            describe(scope, context, before, #elements, rows);
        }}
    };
    quote!(#checks #rows)
}

fn optional(value: Option<&Expr>) -> TokenStream {
    value.map_or_else(|| quote!(::core::option::Option::None), |value| quote!(::core::option::Option::Some(#value)))
}

/// Checks of attributes that only some types allow.
fn checks(attributes: &Attributes, of_type: &Type) -> TokenStream {
    let of_reals = ["unit", "display_unit", "above", "nominal", "state", "derivative_of"];
    let present = of_reals.into_iter().filter(|key| attributes.has(key));
    let reals =
        present.map(|key| quote_spanned!(attributes.span(key)=> ::fmu_export::variables::only_real::<_, #of_type>();));
    let limits = ["min", "above", "max"].into_iter().filter_map(|key| attributes.value(key)).map(
        |value| quote_spanned!(value.span()=> let _ = |index: usize| ::fmu_export::variables::limit::<_, #of_type>(#value);),
    );
    quote!(#(#reals)* #(#limits)*)
}

/// Role and attributes of a row, as chained methods.
fn steps(attributes: &Attributes, field: &Field) -> TokenStream {
    let mut steps = Vec::new();
    steps.push(match attributes.role {
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
    for flag in ["tunable", "discrete", "exact", "state"].into_iter().filter(|flag| attributes.has(flag)) {
        let flag = Ident::new(flag, attributes.span(flag));
        steps.push(quote!(.#flag()));
    }
    for limit in ["min", "above", "max"] {
        if let Some(value) = attributes.value(limit) {
            let method = Ident::new(limit, attributes.span(limit));
            steps.push(quote_spanned!(value.span()=> .#method(::core::convert::Into::into(#value))));
        }
    }
    for (key, method) in [
        ("unit", "with_unit"),
        ("nominal", "nominal"),
        ("display_unit", "display_unit"),
        ("derivative_of", "derivative_of"),
    ] {
        if let Some(value) = attributes.value(key) {
            let method = Ident::new(method, attributes.span(key));
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
    quote!(#(#steps)*)
}
