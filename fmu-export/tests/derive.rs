//! Rows derived from structures equal those written by hand.

use fmu_export::prelude::*;
use fmu_export::variable::{Causality, Dependency, Table, Type, Variability, Variable};
use fmu_export::{Array, unit};

/// How the wheels are driven
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Choice)]
enum Drive {
    /// Not at all
    #[default]
    None,
    /// By the front axle
    #[item(name = "front")]
    FrontAxle,
}

/// A wheel; its number is that in the array.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
struct Wheel<const N: usize> {
    /// Radius of wheel {n}
    #[parameter(unit = unit::METRE, display_unit = "mm", start = 0.3, above = 0.0)]
    radius: f64,
    /// Angle of wheel {n}.
    ///
    /// It is not wrapped.
    #[local(unit = unit::RADIAN, state)]
    angle: f64,
    /// Speed of wheel {n}
    #[local(unit = unit::RADIAN_PER_SECOND, derivative_of = "angle", depends_on = ["torque[{k}]", "angle"])]
    speed: f64,
    /// Temperature {k} of wheel {n}
    #[output(unit = unit::KELVIN, display_unit = "degC", depends_on = [], nominal = 100.0)]
    temperature: Array<f64, N>,
}

/// Context: number of wheels and start value.
struct Machine {
    wheels: usize,
    radius: f64,
}

#[derive(Clone, Debug, Serialize, Deserialize, Variables)]
#[variables(context = Machine)]
struct Car<const N: usize> {
    #[parameter(start = Drive::FrontAxle)]
    drive: Drive,
    /// Torques
    #[input(unit = unit::NEWTON_METRE, start = 1.5)]
    torque: [f64; 2],
    /// Forces
    #[input(unit = unit::NEWTON, names = ["Fx", "Fy"], with = |row| row.max(9.0))]
    force: [f64; 2],
    #[nested(count = context.wheels, context = ())]
    wheel: [Wheel<N>; 3],
    #[nested(prefix = "spare.", context = ())]
    spare: Wheel<N>,
    /// Largest radius
    #[parameter(unit = unit::METRE, start = context.radius, tunable)]
    largest: f64,
    /// Number of gears
    #[parameter(min = 1, max = 6)]
    gears: i32,
    /// Says what happens
    #[output(discrete)]
    says: String,
    /// Matrix
    #[local(discrete)]
    matrix: [[f64; 2]; 2],
    #[hidden]
    secret: u64,
}

impl<const N: usize> Default for Car<N> {
    fn default() -> Self {
        Self {
            drive: Drive::None,
            torque: [0.0; 2],
            force: [3.0, 4.0],
            wheel: std::array::from_fn(|_| Wheel { radius: 7.0, ..Wheel::default() }),
            spare: Wheel::default(),
            largest: 0.0,
            gears: 5,
            says: String::new(),
            matrix: [[1.0, 2.0], [3.0, 4.0]],
            secret: 0,
        }
    }
}

fn table() -> Table<Car<2>> {
    Table::new(Car::rows_in(&Machine { wheels: 2, radius: 0.35 }))
}

fn find<'t>(table: &'t Table<Car<2>>, name: &str) -> &'t Variable {
    table.variables.iter().find(|variable| variable.name == name).unwrap_or_else(|| panic!("there is no {name}"))
}

/// Fails if a field is missing, out of order, or has another name.
#[test]
fn every_field_is_a_variable_in_its_place() {
    let table = table();
    let names: Vec<_> = table.variables.iter().map(|variable| variable.name.as_ref()).collect();
    let of_wheel = |prefix: &str| {
        ["radius", "angle", "speed", "temperature[1]", "temperature[2]"].map(|name| format!("{prefix}.{name}"))
    };
    let mut wanted: Vec<String> = ["drive", "torque[1]", "torque[2]", "Fx", "Fy"].map(str::to_owned).into();
    wanted.extend(["wheel[1]", "wheel[2]", "spare"].iter().flat_map(|prefix| of_wheel(prefix)));
    let others = ["largest", "gears", "says", "matrix[1,1]", "matrix[1,2]", "matrix[2,1]", "matrix[2,2]"];
    wanted.extend(others.map(str::to_owned));
    assert_eq!(names, wanted);
}

/// Fails if an attribute is ignored.
#[test]
fn attributes_reach_the_variables() {
    let table = table();
    let radius = find(&table, "wheel[2].radius");
    assert_eq!((radius.causality, radius.variability), (Causality::Parameter, Variability::Fixed));
    assert_eq!(radius.description, "Radius of wheel 2");
    let Type::Real { start, unit, display, min, max, .. } = radius.data_type else { panic!("a Real") };
    assert_eq!((start, unit.name, display, min, max), (0.3, "m", Some("mm"), Some(0.0), None));
    assert!(radius.admits(&Value::Real(1e-300)).is_ok());
    let refused = radius.admits(&Value::Real(0.0)).expect_err("the limit itself");
    assert_eq!(refused.to_string(), "wheel[2].radius = 0 m is refused: expected a value above 0 m");
    let temperature = find(&table, "wheel[1].temperature[2]");
    assert_eq!(temperature.description, "Temperature 2 of wheel 1");
    assert_eq!(temperature.depends_on, Some(vec![]));
    let angle = find(&table, "spare.angle");
    assert_eq!((angle.state, angle.description.as_ref()), (true, "Angle of wheel {n}"));
    let speed = find(&table, "wheel[2].speed");
    assert_eq!(speed.derivative_of.as_deref(), Some("wheel[2].angle"));
    let any = |name: &str| (name.to_owned().into(), Dependency::Any);
    assert_eq!(speed.depends_on, Some(vec![any("torque[1]"), any("wheel[2].angle")]));
    assert_eq!(find(&table, "torque[2]").depends_on, None);
    assert!(matches!(find(&table, "Fy").data_type, Type::Real { max: Some(9.0), .. }));
    assert_eq!(find(&table, "largest").variability, Variability::Tunable);
    assert_eq!(find(&table, "says").variability, Variability::Discrete);
    assert!(matches!(find(&table, "gears").data_type, Type::Integer { min: Some(1), max: Some(6), .. }));
    let Type::Enumeration { start, items } = find(&table, "drive").data_type else { panic!("an enumeration") };
    assert_eq!((start, items.name, items.description), (2, "Drive", "How the wheels are driven"));
    assert_eq!(items.items, [("none", "Not at all"), ("front", "By the front axle")]);
}

/// Fails if a start value is not that of the attribute, which may use the context, or else that of `Default`.
#[test]
fn start_values_come_from_attribute_default_and_context() {
    let table = table();
    let start = |name: &str| find(&table, name).start();
    assert_eq!(start("torque[2]"), Value::Real(1.5));
    assert_eq!(start("Fy"), Value::Real(4.0));
    assert_eq!(start("wheel[1].radius"), Value::Real(0.3));
    assert_eq!(start("largest"), Value::Real(0.35));
    assert_eq!(start("gears"), Value::Integer(5));
    assert_eq!(start("matrix[2,1]"), Value::Real(3.0));
}

/// Fails if a row reads or writes the field of another.
#[test]
fn every_row_has_its_own_field() {
    let numbers = |index: usize| 10.0 + index as f64;
    let table = table();
    let is_real = |index: &usize| matches!(table.variables[*index].data_type, Type::Real { .. });
    let reals = (0..table.variables.len()).filter(is_real);
    let settings: Vec<_> = reals.map(|index| (index, Value::Real(numbers(index)))).collect();
    let values = table.values(&settings);
    let at = |name: &str| table.variables.iter().position(|variable| variable.name == name).expect("a variable");
    assert_eq!(values.force, [numbers(at("Fx")), numbers(at("Fy"))]);
    assert_eq!(values.wheel[1].radius, numbers(at("wheel[2].radius")));
    assert_eq!(values.wheel[1].temperature[0], numbers(at("wheel[2].temperature[1]")));
    assert_eq!(values.wheel[0].temperature[1], numbers(at("wheel[1].temperature[2]")));
    assert_eq!(values.spare.temperature[1], numbers(at("spare.temperature[2]")));
    assert_eq!(values.matrix[1][0], numbers(at("matrix[2,1]")));
    // The third wheel is not used.
    assert_eq!(values.wheel[2], Wheel { radius: 7.0, ..Wheel::default() });
    assert_eq!(values.drive, Drive::FrontAxle);
}

/// A mast, generic over its type of numbers; the table is for one of them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
#[variables(T = f64)]
struct Mast<T = f64> {
    /// Own force on {prefix}
    #[input(unit = unit::NEWTON)]
    force: T,
    /// Coordinate {k} of {prefix}
    #[output(
        names = ["x", "tilt"], unit = [unit::METRE, unit::RADIAN][index], nominal = [1.0, 0.1][index],
        depends_on = [["force", ".force"][index]]
    )]
    place: [T; 2],
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Variables)]
struct Ship {
    /// Force on all
    #[input(unit = unit::NEWTON)]
    force: f64,
    #[nested(prefix = "fore.")]
    fore: Mast,
    main: Mast,
}

/// Fails if an attribute ignores the index of the element, if a name is not first looked up in the same structure, or with a point in
/// the model, or if the description lacks the prefix.
#[test]
fn attributes_use_the_index_and_names_are_looked_up_in_the_structure_first() {
    let table = Table::new(Ship::rows());
    let find = |name: &str| table.variables.iter().find(|variable| variable.name == name).expect("a variable");
    let real = |name: &str| match find(name).data_type {
        Type::Real { unit, nominal, .. } => (unit.name, nominal),
        _ => panic!("a Real"),
    };
    assert_eq!((real("fore.x"), real("fore.tilt")), (("m", 1.0), ("rad", 0.1)));
    assert_eq!(find("fore.tilt").description, "Coordinate 2 of fore");
    assert_eq!(find("main.force").description, "Own force on main");
    let acting = |name: &str| find(name).depends_on.clone().expect("given")[0].0.clone();
    assert_eq!((acting("main.x"), acting("main.tilt")), ("main.force".into(), "force".into()));
}

/// A structure with an array whose length is a parameter, for which Rust has no `Default`.
#[derive(Clone, Debug, PartialEq, Variables)]
#[variables(default)]
struct Bank<const N: usize> {
    /// Voltage of cell {k}
    #[input(unit = unit::VOLT)]
    voltage: [f64; N],
    /// Whether it charges
    #[parameter]
    charges: bool,
    /// Capacity
    #[parameter(value = 2.5, min = 0.0)]
    capacity: f64,
    mast: Mast,
}

/// Fails if the default of a field is not the given one, or else that of its type.
#[test]
fn defaults_of_arrays_of_any_length_are_derived() {
    assert_eq!(Bank::default(), Bank { voltage: [0.0; 40], charges: false, capacity: 2.5, mast: Mast::default() });
    assert_eq!(Bank::<40>::rows().len(), 40 + 2 + 3);
}
