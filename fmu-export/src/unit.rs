//! Units of variables, with display units. Models declare missing ones themselves.

/// A unit of the interface, with its exponents of the SI base units and its display units. It is coherent: a unit with another factor or
/// zero, such as `°C`, is a display unit.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Unit {
    /// Name in the interface, for instance `N.m2/A2`.
    pub name: &'static str,
    /// Exponents of SI base units, by their FMI 2.0 names: `kg`, `m`, `s`, `A`, `K`, `mol`, `cd`, `rad`.
    pub base: &'static [(&'static str, i32)],
    /// Display units that tools offer.
    pub displays: &'static [Display],
}

/// A display unit: displayed value = factor × value + offset.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Display {
    /// Name, for instance `µm`.
    pub name: &'static str,
    /// Displayed value per value.
    pub factor: f64,
    /// Displayed value of 0.
    pub offset: f64,
}

impl Display {
    /// A display unit with its name and the displayed value per value.
    pub const fn new(name: &'static str, factor: f64) -> Self {
        Self { name, factor, offset: 0.0 }
    }

    /// A display unit with another zero than the unit, such as `°C`.
    pub const fn with_offset(name: &'static str, factor: f64, offset: f64) -> Self {
        Self { name, factor, offset }
    }
}

/// [`ONE`].
impl Default for Unit {
    fn default() -> Self {
        ONE
    }
}

impl Unit {
    /// A unit with its exponents of the base units and its display units.
    pub const fn new(name: &'static str, base: &'static [(&'static str, i32)], displays: &'static [Display]) -> Self {
        Self { name, base, displays }
    }

    /// Converts a value from the unit `name` to this one; `None` for an unknown unit. `µ` may be written as `u`.
    pub fn convert(&self, value: f64, name: &str) -> Option<f64> {
        let plain = |text: &str| text.replace(['µ', 'μ'], "u");
        if plain(name) == plain(self.name) {
            return Some(value);
        }
        self.displays
            .iter()
            .find(|display| plain(display.name) == plain(name))
            .map(|display| (value - display.offset) / display.factor)
    }

    /// All unit names accepted for this unit.
    pub fn names(&self) -> impl Iterator<Item = &'static str> {
        let displays = self.displays.iter().map(|display| display.name);
        std::iter::once(self.name).chain(displays.filter(|name| *name != self.name))
    }
}

const PER_DEGREE: f64 = 180.0 / std::f64::consts::PI;
const RPM: f64 = 30.0 / std::f64::consts::PI;

/// Dimensionless.
pub const ONE: Unit = Unit::new("1", &[], &[]);
/// Mass.
pub const KILOGRAM: Unit = Unit::new("kg", &[("kg", 1)], &[Display::new("kg", 1.0), Display::new("g", 1e3)]);
/// Length.
pub const METRE: Unit = Unit::new("m", &[("m", 1)], &[Display::new("µm", 1e6), Display::new("mm", 1e3)]);
/// Velocity.
pub const METRE_PER_SECOND: Unit = Unit::new("m/s", &[("m", 1), ("s", -1)], &[Display::new("mm/s", 1e3)]);
/// Acceleration.
pub const METRE_PER_SECOND2: Unit = Unit::new("m/s2", &[("m", 1), ("s", -2)], &[]);
/// Time.
pub const SECOND: Unit = Unit::new("s", &[("s", 1)], &[Display::new("ms", 1e3), Display::new("µs", 1e6)]);
/// Rate.
pub const PER_SECOND: Unit = Unit::new("1/s", &[("s", -1)], &[]);
/// Change of a rate.
pub const PER_SECOND2: Unit = Unit::new("1/s2", &[("s", -2)], &[]);
/// Frequency.
pub const HERTZ: Unit = Unit::new("Hz", &[("s", -1)], &[Display::new("kHz", 1e-3)]);
/// Angle.
pub const RADIAN: Unit = Unit::new("rad", &[("rad", 1)], &[Display::new("deg", PER_DEGREE)]);
/// Angular velocity.
pub const RADIAN_PER_SECOND: Unit = Unit {
    name: "rad/s",
    base: &[("rad", 1), ("s", -1)],
    displays: &[Display::new("rpm", RPM), Display::new("Hz", 0.5 / std::f64::consts::PI)],
};
/// Electric current.
pub const AMPERE: Unit = Unit::new("A", &[("A", 1)], &[Display::new("A", 1.0), Display::new("mA", 1e3)]);
/// Force.
pub const NEWTON: Unit = Unit::new("N", &[("kg", 1), ("m", 1), ("s", -2)], &[]);
/// Force per current.
pub const NEWTON_PER_AMPERE: Unit = Unit::new("N/A", &[("kg", 1), ("m", 1), ("s", -2), ("A", -1)], &[]);
/// Voltage.
pub const VOLT: Unit = Unit::new("V", &[("kg", 1), ("m", 2), ("s", -3), ("A", -1)], &[]);
/// Resistance.
pub const OHM: Unit = Unit::new("Ohm", &[("kg", 1), ("m", 2), ("s", -3), ("A", -2)], &[]);
/// Inductance.
pub const HENRY: Unit = Unit::new("H", &[("kg", 1), ("m", 2), ("s", -2), ("A", -2)], &[Display::new("mH", 1e3)]);
/// Magnetic flux.
pub const WEBER: Unit = Unit::new("Wb", &[("kg", 1), ("m", 2), ("s", -2), ("A", -1)], &[Display::new("mWb", 1e3)]);
/// Stiffness.
pub const NEWTON_PER_METRE: Unit = Unit::new("N/m", &[("kg", 1), ("s", -2)], &[Display::new("N/µm", 1e-6)]);
/// Damping.
pub const NEWTON_SECOND_PER_METRE: Unit = Unit::new("N.s/m", &[("kg", 1), ("s", -1)], &[]);
/// Temperature.
pub const KELVIN: Unit = Unit::new(
    "K",
    &[("K", 1)],
    &[Display::with_offset("degC", 1.0, -273.15), Display::with_offset("degF", 1.8, -459.67)],
);
/// Rate of a temperature.
pub const KELVIN_PER_SECOND: Unit = Unit::new("K/s", &[("K", 1), ("s", -1)], &[]);
/// Amount of substance.
pub const MOLE: Unit = Unit::new("mol", &[("mol", 1)], &[]);
/// Luminous intensity.
pub const CANDELA: Unit = Unit::new("cd", &[("cd", 1)], &[]);
/// Area.
pub const METRE2: Unit = Unit::new("m2", &[("m", 2)], &[Display::new("mm2", 1e6), Display::new("cm2", 1e4)]);
/// Volume.
pub const METRE3: Unit = Unit::new("m3", &[("m", 3)], &[Display::new("l", 1e3), Display::new("cm3", 1e6)]);
/// Volume flow.
pub const METRE3_PER_SECOND: Unit = Unit::new("m3/s", &[("m", 3), ("s", -1)], &[Display::new("l/min", 6e4)]);
/// Mass flow.
pub const KILOGRAM_PER_SECOND: Unit = Unit::new("kg/s", &[("kg", 1), ("s", -1)], &[]);
/// Density.
pub const KILOGRAM_PER_METRE3: Unit = Unit::new("kg/m3", &[("kg", 1), ("m", -3)], &[]);
/// Moment of inertia.
pub const KILOGRAM_METRE2: Unit = Unit::new("kg.m2", &[("kg", 1), ("m", 2)], &[]);
/// Angular acceleration.
pub const RADIAN_PER_SECOND2: Unit = Unit::new("rad/s2", &[("rad", 1), ("s", -2)], &[]);
/// Moment, torque.
pub const NEWTON_METRE: Unit = Unit::new("N.m", &[("kg", 1), ("m", 2), ("s", -2)], &[]);
/// Torque per current, torque constant of a motor.
pub const NEWTON_METRE_PER_AMPERE: Unit = Unit::new("N.m/A", &[("kg", 1), ("m", 2), ("s", -2), ("A", -1)], &[]);
/// Damping of a rotation.
pub const NEWTON_METRE_SECOND_PER_RADIAN: Unit =
    Unit::new("N.m.s/rad", &[("kg", 1), ("m", 2), ("s", -1), ("rad", -1)], &[]);
/// Stiffness of a rotation.
pub const NEWTON_METRE_PER_RADIAN: Unit = Unit::new("N.m/rad", &[("kg", 1), ("m", 2), ("s", -2), ("rad", -1)], &[]);
/// Pressure, stress.
pub const PASCAL: Unit =
    Unit::new("Pa", &[("kg", 1), ("m", -1), ("s", -2)], &[Display::new("bar", 1e-5), Display::new("MPa", 1e-6)]);
/// Dynamic viscosity.
pub const PASCAL_SECOND: Unit = Unit::new("Pa.s", &[("kg", 1), ("m", -1), ("s", -1)], &[]);
/// Energy, heat.
pub const JOULE: Unit =
    Unit::new("J", &[("kg", 1), ("m", 2), ("s", -2)], &[Display::new("kJ", 1e-3), Display::new("kWh", 1.0 / 3.6e6)]);
/// Power, heat flow.
pub const WATT: Unit = Unit::new("W", &[("kg", 1), ("m", 2), ("s", -3)], &[Display::new("kW", 1e-3)]);
/// Specific heat capacity.
pub const JOULE_PER_KILOGRAM_KELVIN: Unit = Unit::new("J/(kg.K)", &[("m", 2), ("s", -2), ("K", -1)], &[]);
/// Heat capacity.
pub const JOULE_PER_KELVIN: Unit = Unit::new("J/K", &[("kg", 1), ("m", 2), ("s", -2), ("K", -1)], &[]);
/// Thermal conductance.
pub const WATT_PER_KELVIN: Unit = Unit::new("W/K", &[("kg", 1), ("m", 2), ("s", -3), ("K", -1)], &[]);
/// Thermal conductivity.
pub const WATT_PER_METRE_KELVIN: Unit = Unit::new("W/(m.K)", &[("kg", 1), ("m", 1), ("s", -3), ("K", -1)], &[]);
/// Heat transfer coefficient.
pub const WATT_PER_METRE2_KELVIN: Unit = Unit::new("W/(m2.K)", &[("kg", 1), ("s", -3), ("K", -1)], &[]);
/// Electric charge.
pub const COULOMB: Unit = Unit::new("C", &[("A", 1), ("s", 1)], &[Display::new("A.h", 1.0 / 3600.0)]);
/// Capacitance.
pub const FARAD: Unit =
    Unit::new("F", &[("kg", -1), ("m", -2), ("s", 4), ("A", 2)], &[Display::new("µF", 1e6), Display::new("nF", 1e9)]);
/// Conductance.
pub const SIEMENS: Unit = Unit::new("S", &[("kg", -1), ("m", -2), ("s", 3), ("A", 2)], &[]);
/// Magnetic flux density.
pub const TESLA: Unit = Unit::new("T", &[("kg", 1), ("s", -2), ("A", -1)], &[Display::new("mT", 1e3)]);
/// Voltage per speed, voltage constant of a motor.
pub const VOLT_SECOND_PER_RADIAN: Unit =
    Unit::new("V.s/rad", &[("kg", 1), ("m", 2), ("s", -2), ("A", -1), ("rad", -1)], &[]);
