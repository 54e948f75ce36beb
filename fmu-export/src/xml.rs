//! Writes XML: model descriptions and system structures.

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesEnd, BytesStart, Event};

use crate::unit::Unit;
use crate::variable::{Type, Variable};

/// An element with attributes, in the order in which they are added.
pub struct Element {
    name: &'static str,
    attributes: Vec<(&'static str, String)>,
}

/// An element without attributes.
pub fn element(name: &'static str) -> Element {
    Element { name, attributes: Vec::new() }
}

impl Element {
    /// Adds an attribute.
    pub fn with(mut self, name: &'static str, value: impl Into<String>) -> Self {
        self.attributes.push((name, value.into()));
        self
    }

    /// Adds an attribute if there is a value for it.
    pub fn with_some(self, name: &'static str, value: Option<impl Into<String>>) -> Self {
        match value {
            Some(value) => self.with(name, value),
            None => self,
        }
    }

    fn tag(&self) -> BytesStart<'_> {
        let mut tag = BytesStart::new(self.name);
        for (name, value) in &self.attributes {
            tag.push_attribute((*name, value.as_str()));
        }
        tag
    }
}

/// A document in memory, into which writing cannot fail.
pub struct Page(Writer<Vec<u8>>);

impl Page {
    /// The text of a document with that root.
    pub fn document(root: Element, content: impl FnOnce(&mut Self)) -> String {
        let mut page = Self(Writer::new_with_indent(Vec::new(), b' ', 2));
        page.event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)));
        page.nest(root, content);
        let mut text = String::from_utf8(page.0.into_inner()).expect("all that was written is UTF-8");
        text.push('\n');
        text
    }

    fn event(&mut self, event: Event<'_>) {
        self.0.write_event(event).expect("a vector takes any number of bytes");
    }

    /// Writes an element without content.
    pub fn empty(&mut self, element: Element) {
        self.event(Event::Empty(element.tag()));
    }

    /// Writes an element around other elements.
    pub fn nest(&mut self, element: Element, content: impl FnOnce(&mut Self)) {
        self.event(Event::Start(element.tag()));
        content(self);
        self.event(Event::End(BytesEnd::new(element.name)));
    }
}

/// The shortest text that is read back as the same number.
pub fn real(value: f64) -> String {
    if value != 0.0 && !(1e-3..1e6).contains(&value.abs()) { format!("{value:e}") } else { format!("{value}") }
}

/// The units in use, each once, in the order of the variables.
pub fn units<'v>(variables: impl IntoIterator<Item = &'v Variable>) -> Vec<&'v Unit> {
    let mut units: Vec<&Unit> = Vec::new();
    for variable in variables {
        if let Type::Real { unit, .. } = &variable.kind
            && units.iter().all(|known| known.name != unit.name)
        {
            units.push(unit);
        }
    }
    units
}

/// Writes the exponents of a unit over the base units as an element of that name.
pub fn write_base_unit(page: &mut Page, name: &'static str, unit: &Unit) {
    let exponents = unit.base.iter();
    page.empty(exponents.fold(element(name), |tag, (base, exponent)| tag.with(base, exponent.to_string())));
}
