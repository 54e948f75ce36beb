//! Units: the one a variable is computed in, and those in which people read it. Models declare what is missing here.

/// A unit of the interface, with its exponents over the SI base units and the units for display.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    /// Name as it stands in the interface, for instance `N.m2/A2`.
    pub name: &'static str,
    /// Exponents over SI base units, by the names FMI 2.0 uses: `kg`, `m`, `s`, `A`, `rad`.
    pub base: &'static [(&'static str, i32)],
    /// Units for display; the first is the one proposed for variables that name none.
    pub displays: &'static [Display],
}

/// A unit for display: shown value = factor × value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Display {
    /// Name, for instance `µm`.
    pub name: &'static str,
    /// Shown value per value.
    pub factor: f64,
}

impl Display {
    /// A unit for display that has its name and the shown value per value.
    pub const fn new(name: &'static str, factor: f64) -> Self {
        Self { name, factor }
    }
}

impl Unit {
    /// A unit with its exponents over the base units, and the units in which people read it.
    pub const fn new(name: &'static str, base: &'static [(&'static str, i32)], displays: &'static [Display]) -> Self {
        Self { name, base, displays }
    }
}

const PER_DEGREE: f64 = 180.0 / std::f64::consts::PI;
const RPM: f64 = 30.0 / std::f64::consts::PI;

/// Dimensionless.
pub const ONE: Unit = Unit { name: "1", base: &[], displays: &[] };
/// Mass.
pub const KILOGRAM: Unit =
    Unit { name: "kg", base: &[("kg", 1)], displays: &[Display::new("kg", 1.0), Display::new("g", 1e3)] };
/// Length.
pub const METRE: Unit =
    Unit { name: "m", base: &[("m", 1)], displays: &[Display::new("µm", 1e6), Display::new("mm", 1e3)] };
/// Velocity.
pub const METRE_PER_SECOND: Unit =
    Unit { name: "m/s", base: &[("m", 1), ("s", -1)], displays: &[Display::new("mm/s", 1e3)] };
/// Acceleration.
pub const METRE_PER_SECOND2: Unit = Unit { name: "m/s2", base: &[("m", 1), ("s", -2)], displays: &[] };
/// Time.
pub const SECOND: Unit =
    Unit { name: "s", base: &[("s", 1)], displays: &[Display::new("ms", 1e3), Display::new("µs", 1e6)] };
/// Rate.
pub const PER_SECOND: Unit = Unit::new("1/s", &[("s", -1)], &[]);
/// Change of a rate.
pub const PER_SECOND2: Unit = Unit::new("1/s2", &[("s", -2)], &[]);
/// Frequency.
pub const HERTZ: Unit = Unit { name: "Hz", base: &[("s", -1)], displays: &[Display::new("kHz", 1e-3)] };
/// Angle.
pub const RADIAN: Unit = Unit { name: "rad", base: &[("rad", 1)], displays: &[Display::new("deg", PER_DEGREE)] };
/// Angular velocity.
pub const RADIAN_PER_SECOND: Unit = Unit {
    name: "rad/s",
    base: &[("rad", 1), ("s", -1)],
    displays: &[Display::new("rpm", RPM), Display::new("Hz", 0.5 / std::f64::consts::PI)],
};
/// Electric current.
pub const AMPERE: Unit =
    Unit { name: "A", base: &[("A", 1)], displays: &[Display::new("A", 1.0), Display::new("mA", 1e3)] };
/// Force.
pub const NEWTON: Unit = Unit { name: "N", base: &[("kg", 1), ("m", 1), ("s", -2)], displays: &[] };
/// Force per current.
pub const NEWTON_PER_AMPERE: Unit =
    Unit { name: "N/A", base: &[("kg", 1), ("m", 1), ("s", -2), ("A", -1)], displays: &[] };
/// Voltage.
pub const VOLT: Unit = Unit { name: "V", base: &[("kg", 1), ("m", 2), ("s", -3), ("A", -1)], displays: &[] };
/// Resistance.
pub const OHM: Unit = Unit { name: "Ohm", base: &[("kg", 1), ("m", 2), ("s", -3), ("A", -2)], displays: &[] };
/// Inductance.
pub const HENRY: Unit =
    Unit { name: "H", base: &[("kg", 1), ("m", 2), ("s", -2), ("A", -2)], displays: &[Display::new("mH", 1e3)] };
/// Magnetic flux.
pub const WEBER: Unit =
    Unit { name: "Wb", base: &[("kg", 1), ("m", 2), ("s", -2), ("A", -1)], displays: &[Display::new("mWb", 1e3)] };
/// Stiffness.
pub const NEWTON_PER_METRE: Unit =
    Unit { name: "N/m", base: &[("kg", 1), ("s", -2)], displays: &[Display::new("N/µm", 1e-6)] };
/// Damping.
pub const NEWTON_SECOND_PER_METRE: Unit = Unit { name: "N.s/m", base: &[("kg", 1), ("s", -1)], displays: &[] };
impl Unit {
    /// A value given in the unit `name`, converted to this unit, or `None` for a name this unit does not know. `µ` may
    /// be written as `u`.
    pub fn convert(&self, value: f64, name: &str) -> Option<f64> {
        let plain = |text: &str| text.replace(['µ', 'μ'], "u");
        if plain(name) == plain(self.name) {
            return Some(value);
        }
        self.displays.iter().find(|display| plain(display.name) == plain(name)).map(|display| value / display.factor)
    }

    /// All names by which values of this unit may be given.
    pub fn names(&self) -> impl Iterator<Item = &'static str> {
        let displays = self.displays.iter().map(|display| display.name);
        std::iter::once(self.name).chain(displays.filter(|name| *name != self.name))
    }
}
