//! The attributes of a field: its role with the items in parentheses.

use proc_macro2::Span;
use syn::parse::{Parse, ParseStream};
use syn::punctuated::Punctuated;
use syn::spanned::Spanned;
use syn::{Attribute, Error, Expr, ExprLit, Field, Ident, Lit, LitStr, Meta, Result, Token};

/// Role of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    Parameter,
    Input,
    Output,
    Local,
    Nested,
    Hidden,
}

const ROLES: [(&str, Role); 6] = [
    ("parameter", Role::Parameter),
    ("input", Role::Input),
    ("output", Role::Output),
    ("local", Role::Local),
    ("nested", Role::Nested),
    ("hidden", Role::Hidden),
];

impl Role {
    /// Keys allowed in its parentheses.
    fn keys(self) -> Vec<&'static str> {
        let of_variable = ["unit", "display_unit", "start", "value", "min", "above", "max", "nominal"];
        let named = ["name", "names", "description", "count", "with"];
        let own: &[&str] = match self {
            Role::Parameter => &["fixed", "tunable", "calculated"],
            Role::Input => &["discrete"],
            Role::Output => &["discrete", "exact", "state", "derivative_of", "depends_on", "starts_from"],
            Role::Local => &["discrete", "exact", "state", "derivative_of", "depends_on", "starts_from", "constant"],
            Role::Nested => return vec!["prefix", "prefixes", "count", "context", "value"],
            Role::Hidden => return vec!["value"],
        };
        of_variable.into_iter().chain(named).chain(own.iter().copied()).collect()
    }
}

/// `key` or `key = value`.
pub struct Item {
    pub key: Ident,
    pub value: Option<Expr>,
}

impl Parse for Item {
    fn parse(input: ParseStream<'_>) -> Result<Self> {
        let key: Ident = input.parse()?;
        let value = if input.peek(Token![=]) {
            input.parse::<Token![=]>()?;
            Some(input.parse()?)
        } else {
            None
        };
        Ok(Self { key, value })
    }
}

/// Keys without a value.
const FLAGS: [&str; 8] = ["fixed", "tunable", "calculated", "discrete", "exact", "state", "constant", "default"];

/// The role of a field with its items.
pub struct Attributes {
    pub role: Role,
    items: Vec<Item>,
}

impl Attributes {
    /// Reads the attributes of a field.
    pub fn of(field: &Field) -> Result<Self> {
        let mut found: Option<(Role, Vec<Item>)> = None;
        for attribute in &field.attrs {
            let Some((name, role)) = ROLES.iter().find(|(name, _)| attribute.path().is_ident(name)) else { continue };
            if found.is_some() {
                return Err(Error::new(
                    attribute.span(),
                    "a field has one of these attributes: two rows cannot access one field",
                ));
            }
            found = Some((*role, items(attribute, name, &role.keys())?));
        }
        let (role, items) = found.unwrap_or((Role::Nested, Vec::new()));
        let attributes = Self { role, items };
        for [one, other] in
            [["name", "names"], ["fixed", "tunable"], ["fixed", "calculated"], ["prefix", "prefixes"], ["min", "above"]]
        {
            if attributes.get(one).is_some()
                && let Some(second) = attributes.get(other)
            {
                return Err(Error::new(second.key.span(), format!("`{one}` and `{other}` exclude one another")));
            }
        }
        Ok(attributes)
    }

    /// The item of that key.
    pub fn get(&self, key: &str) -> Option<&Item> {
        self.items.iter().find(|item| item.key == key)
    }

    /// Whether the key is present.
    pub fn has(&self, key: &str) -> bool {
        self.get(key).is_some()
    }

    /// The value of that key.
    pub fn value(&self, key: &str) -> Option<&Expr> {
        self.get(key).and_then(|item| item.value.as_ref())
    }

    /// Position of the key.
    pub fn span(&self, key: &str) -> Span {
        self.get(key).map_or_else(Span::call_site, |item| item.key.span())
    }
}

/// Items in the parentheses of an attribute; only these keys are accepted.
pub fn items(attribute: &Attribute, name: &str, keys: &[&str]) -> Result<Vec<Item>> {
    let items = match &attribute.meta {
        Meta::Path(_) => return Ok(Vec::new()),
        Meta::List(list) => list.parse_args_with(Punctuated::<Item, Token![,]>::parse_terminated)?,
        Meta::NameValue(pair) => return Err(Error::new(pair.span(), format!("expected `#[{name}(…)]`"))),
    };
    let mut seen: Vec<&Ident> = Vec::new();
    for item in &items {
        let key = &item.key;
        if !keys.iter().any(|known| key == known) {
            let known = if keys.is_empty() { "nothing".into() } else { keys.join(", ") };
            return Err(Error::new(key.span(), format!("`{key}` is unknown in `#[{name}]`: expected {known}")));
        }
        if seen.contains(&key) {
            return Err(Error::new(key.span(), format!("`{key}` is given twice")));
        }
        let is_flag = FLAGS.iter().any(|flag| key == flag);
        if is_flag == item.value.is_some() {
            let wanted = if is_flag { "no value" } else { "a value, as in" };
            let example = if is_flag { String::new() } else { format!(" `{key} = …`") };
            return Err(Error::new(key.span(), format!("`{key}` takes {wanted}{example}")));
        }
        seen.push(key);
    }
    Ok(items.into_iter().collect())
}

/// A string literal.
pub fn literal(value: &Expr) -> Option<&LitStr> {
    match value {
        Expr::Lit(ExprLit { lit: Lit::Str(text), .. }) => Some(text),
        _ => None,
    }
}
