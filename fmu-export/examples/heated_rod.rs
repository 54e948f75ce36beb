//! A rod of 40 cells that is heated at one end: `cargo run -p fmu-export --example heated_rod`.
use fmu_export::{package, prelude::*};

#[derive(Clone, Default, Serialize, Deserialize, Variables)]
struct Values {
    /// Thermal conductance between neighbouring cells
    #[parameter(unit = unit::WATT_PER_KELVIN, start = 0.5, min = 0.0, max = 100.0)]
    conductance: f64,
    /// Heat capacity of a cell
    #[parameter(unit = unit::JOULE_PER_KELVIN, start = 2.0, min = 0.1)]
    capacity: f64,
    /// Heat flow into the first cell
    #[input(unit = unit::WATT, start = 1.0)]
    heat: f64,
    /// Temperature of cell {k}
    #[output(unit = unit::KELVIN, display_unit = "degC", start = 293.15, state, exact, depends_on = ["temperature[{k}]"])]
    temperature: Array<f64, 40>,
    /// Rate of the temperature of cell {k}
    #[local(unit = unit::KELVIN_PER_SECOND, derivative_of = "temperature", depends_on = ["heat", "temperature"])]
    rate: Array<f64, 40>,
}

impl Values {
    fn update_rates(&mut self) {
        let flow = |k: usize| self.conductance * (self.temperature[k] - self.temperature[(k + 1).min(39)]);
        let into = |k: usize| if k == 0 { self.heat } else { flow(k - 1) };
        self.rate = Array(std::array::from_fn(|k| (into(k) - flow(k)) / self.capacity));
    }
}

#[derive(Clone)]
struct HeatedRod;

impl Model for HeatedRod {
    const INFO: Info = Info::new("HeatedRod", "A rod that is heated at one end").experiment(200.0, 1.0);
    type Values = Values;
    type State = ();

    fn table() -> Vec<Row<Values>> {
        Values::rows()
    }

    fn new(_: &Values, _: &Resources) -> Result<Self, Vec<Invalid>> {
        Ok(Self)
    }

    fn start(&self, values: &mut Values, _: f64) {
        values.update_rates();
    }

    fn step(
        &self,
        _: &mut (),
        values: &mut Values,
        step: Step,
        _: &InputTrajectory<Values>,
        _: &mut dyn Log,
    ) -> Stepped {
        // Euler's method, with steps that are short against the fastest time constant.
        let count = (step.length_s * 100.0 * values.conductance / values.capacity).ceil().max(1.0);
        for _ in 0..count as usize {
            values.update_rates();
            for k in 0..40 {
                values.temperature[k] += step.length_s / count * values.rate[k];
            }
        }
        values.update_rates();
        Ok(())
    }
}

export_fmus!(HeatedRod);

fn main() -> Result<(), package::PackageError> {
    package::package_example(&FMUS, "heated_rod_fmu", "target/fmu")
}
