//! A thermostat with a mode, texts, and tunable parameters: `cargo run -p fmu-export --example thermostat`.
use fmu_export::{package, prelude::*};

/// Operating mode
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Choice)]
enum Mode {
    /// Nothing
    #[default]
    Off,
    /// It heats below the set point
    Heating,
    /// It cools above the set point
    Cooling,
}

#[derive(Clone, Default, Serialize, Deserialize, Variables)]
struct Values {
    /// Name of the room
    #[parameter(start = "living room")]
    room: String,
    /// Operating mode
    #[parameter(start = Mode::Heating, tunable)]
    mode: Mode,
    /// Temperature wanted
    #[parameter(unit = unit::KELVIN, display_unit = "degC", start = 293.15, min = 273.15, max = 313.15, tunable)]
    wanted: f64,
    /// Difference between switching on and off
    #[parameter(unit = unit::KELVIN, start = 0.5, min = 0.0, tunable)]
    hysteresis: f64,
    /// Temperature of the room
    #[input(unit = unit::KELVIN, display_unit = "degC", start = 293.15, min = 0.0)]
    temperature: f64,
    /// Whether the device is on
    #[output(discrete)]
    on: bool,
    /// How often the device was switched on
    #[output(discrete)]
    count: i32,
    /// The state in words
    #[output(discrete)]
    status: String,
}

#[derive(Clone)]
struct Thermostat;

impl SampledModel for Thermostat {
    const INFO: Info = Info::new("Thermostat", "A thermostat for heating and cooling").experiment(3600.0, 60.0);
    type Values = Values;
    type State = ();

    fn table() -> Vec<Row<Values>> {
        Values::rows()
    }

    fn new(_: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        Ok(Self)
    }

    fn period_s(&self) -> f64 {
        60.0
    }

    fn start(&self, values: &mut Values, _: f64) {
        (values.on, values.count, values.status) = (false, 0, format!("{}: ready", values.room));
    }

    fn sample(&self, _: &mut (), values: &mut Values, _: f64, _: &mut dyn Log) -> Stepped {
        let excess = (values.temperature - values.wanted) * if values.mode == Mode::Cooling { 1.0 } else { -1.0 };
        let limit = if values.on { -values.hysteresis } else { values.hysteresis } / 2.0;
        let on = values.mode != Mode::Off && excess > limit;
        values.count += i32::from(on && !values.on);
        values.on = on;
        values.status = format!("{}: {:?}, {}", values.room, values.mode, if on { "on" } else { "off" });
        Ok(())
    }
}

export_fmus!(Thermostat);

fn main() -> Result<(), package::PackageError> {
    package::package_example(&FMUS, "thermostat_fmu", "target/fmu")
}
