//! Enumerations: names for whole numbers.

/// Names for the values 1, 2, … of an enumeration.
///
/// ```
/// # use fmu_export::variable::Enumeration;
/// static DRIVE: Enumeration =
///     Enumeration::new("Drive", "Drive of the coils", &[("current", "Currents"), ("voltage", "Voltages")]);
/// assert_eq!(DRIVE.item(2), Some("voltage"));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Enumeration {
    /// Name of the type.
    pub name: &'static str,
    /// Description.
    pub description: &'static str,
    /// Name and description of the items, whose values count from 1.
    pub items: &'static [(&'static str, &'static str)],
}

impl Enumeration {
    /// An enumeration with its name, its description, and name and description of each item.
    pub const fn new(
        name: &'static str,
        description: &'static str,
        items: &'static [(&'static str, &'static str)],
    ) -> Self {
        Self { name, description, items }
    }

    /// The value of an item.
    ///
    /// # Errors
    /// The available items.
    pub fn find(&self, item: &str) -> Result<i32, String> {
        let index = self.items.iter().position(|(name, _)| *name == item);
        index.map(|index| index as i32 + 1).ok_or_else(|| format!("expected one of {}", self.listed()))
    }

    /// The name of the item with that value.
    pub fn item(&self, value: i32) -> Option<&'static str> {
        let index = usize::try_from(value.checked_sub(1)?).ok()?;
        self.items.get(index).map(|(name, _)| *name)
    }

    /// The items with their values, for messages.
    pub fn listed(&self) -> String {
        let items = self.items.iter().zip(1..).map(|((item, _), value)| format!("{item} ({value})"));
        items.collect::<Vec<_>>().join(", ")
    }
}
