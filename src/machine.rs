//! The machines of this project, each described once: its bearings, coordinates and sensors, with their names.
//!
//! Names of variables, connections, scenario keys and FMUs derive from this description. The equations only know the sizes of their
//! arrays, as const generics; `Machine::of` finds the description for given sizes.

use std::ops::Range;

/// Name and description.
type Described = (&'static str, &'static str);

/// A coordinate: the names of its variables.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coordinate {
    /// The coordinate itself.
    pub position: &'static str,
    /// Its rate.
    pub rate: &'static str,
    /// Its acceleration.
    pub acceleration: &'static str,
    /// The load along it, an input.
    pub load: &'static str,
    /// All forces along it except those of magnets and backup bearings.
    pub perturbation: &'static str,
    /// Whether it is an angle, so that its force is a moment.
    pub is_angle: bool,
}

impl Coordinate {
    const fn new([position, rate, acceleration, load, perturbation]: [&'static str; 5], is_angle: bool) -> Self {
        Self { position, rate, acceleration, load, perturbation, is_angle }
    }
}

/// A position reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Its name.
    pub name: &'static str,
    /// Prefix and suffix of the names of its variables.
    pub around: (&'static str, &'static str),
    /// Its axis, with the bearing if there are several.
    pub axis: &'static str,
}

/// A bearing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bearing {
    /// Prefix of the names of its variables.
    pub prefix: &'static str,
    /// Whether it is radial, not axial.
    pub is_radial: bool,
    /// Number of its magnets.
    pub magnets: usize,
}

impl Bearing {
    const fn radial(prefix: &'static str, magnets: usize) -> Self {
        Self { prefix, is_radial: true, magnets }
    }

    const fn axial(prefix: &'static str) -> Self {
        Self { prefix, is_radial: false, magnets: 2 }
    }

    /// Its name; empty if it is the only one.
    pub fn name(&self) -> &'static str {
        self.prefix.trim_end_matches('.')
    }

    /// Whether it is the only bearing of its machine.
    pub(crate) const fn is_alone(&self) -> bool {
        self.prefix.is_empty()
    }

    /// ` of bearing A`; empty for the only bearing.
    pub(crate) fn located(&self, preposition: &str) -> String {
        if self.is_alone() { String::new() } else { format!(" {preposition} bearing {}", self.name()) }
    }

    /// Count of a variable that only radial bearings have: 1 or 0.
    pub(crate) fn if_radial(&self) -> usize {
        usize::from(self.is_radial)
    }

    /// Count of a variable that only radial bearings placed along a shaft have: 1 or 0.
    pub(crate) fn if_placed(&self) -> usize {
        usize::from(self.is_radial && !self.is_alone())
    }

    /// Count of a variable that only an axial bearing beside others has: 1 or 0.
    pub(crate) fn if_beside(&self) -> usize {
        usize::from(!self.is_radial && !self.is_alone())
    }

    /// The first axis of its magnets.
    pub(crate) fn first_axis(&self) -> &'static str {
        if self.is_radial { "y" } else { "x" }
    }

    /// Number of directions in which it supports the rotor.
    pub(crate) const fn directions(&self) -> usize {
        if self.is_radial { 2 } else { 1 }
    }

    /// Whether its magnets can form opposed pairs.
    const fn is_paired(&self) -> bool {
        self.magnets == 2 * self.directions()
    }

    /// Number of groups of magnets, each with its own smallest force: one per pair, or one for all magnets.
    pub const fn groups(&self) -> usize {
        if self.is_paired() { self.directions() } else { 1 }
    }
}

/// A machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Machine {
    /// Its name in scenarios.
    pub name: &'static str,
    /// The models of plant, controller and estimator, with their descriptions.
    pub models: [Described; 3],
    /// The bearings, in the order of their magnets.
    pub bearings: &'static [Bearing],
    /// Number of unbalance planes.
    pub planes: usize,
    /// The coordinates, including angles if the shaft tilts.
    pub coordinates: &'static [Coordinate],
    /// The position readings.
    pub readings: &'static [Reading],
}

impl Machine {
    /// The machine with N coordinates and K magnets. A shaft that is not among [`MACHINES`] has no name.
    pub(crate) const fn of<const N: usize, const K: usize>() -> &'static Self {
        const ALL: &[Machine] = &MACHINES;
        let mut at = 0;
        while at < ALL.len() {
            if ALL[at].coordinates.len() == N && ALL[at].magnets() == K {
                return &ALL[at];
            }
            at += 1;
        }
        const { &if N < 4 { PLANAR } else { Self::shaft::<N, K>("", [("", ""); 3]) } }
    }

    /// The machine with B bearings and K magnets.
    pub(crate) const fn with<const B: usize, const K: usize>() -> &'static Self {
        match (B, K) {
            (1, 2) => Self::of::<1, K>(),
            (1, _) => Self::of::<2, K>(),
            (2, _) => Self::of::<4, K>(),
            _ => Self::of::<5, K>(),
        }
    }

    /// A shaft in two radial bearings, with N = 5 also in an axial one; K magnets in total.
    const fn shaft<const N: usize, const K: usize>(name: &'static str, models: [Described; 3]) -> Self {
        const { assert!(N == 4 || N == 5, "a shaft that tilts") };
        Self {
            name,
            models,
            bearings: const {
                let radial = K / 2 + 4 - N;
                &[Bearing::radial("A.", radial), Bearing::radial("B.", radial), Bearing::axial("X.")]
            }
            .split_at(N - 2)
            .0,
            planes: 2,
            coordinates: COORDINATES.split_at(5 - N).1,
            readings: READINGS_OF_SHAFT.split_at(N).0,
        }
    }

    /// Index of the bearing of magnet k, both counted from 0, and the magnet's number in that bearing, counted from 1.
    pub fn magnet(&self, k: usize) -> Option<(usize, usize)> {
        let numbered = |(b, bearing): (usize, &Bearing)| (1..=bearing.magnets).map(move |number| (b, number));
        self.bearings.iter().enumerate().flat_map(numbered).nth(k)
    }

    /// The bearings with the index ranges of their magnets.
    pub fn magnets_of_bearings(&self) -> Vec<(&'static Bearing, Range<usize>)> {
        self.bearings.iter().enumerate().map(|(b, bearing)| (bearing, self.magnets_of(b))).collect()
    }

    /// Number of magnets.
    pub const fn magnets(&self) -> usize {
        self.before(self.bearings.len())[0]
    }

    /// Number of magnets, groups and readings that precede those of a bearing.
    const fn before(&self, bearing: usize) -> [usize; 3] {
        let (mut before, mut b) = ([0; 3], 0);
        while b < bearing {
            before[0] += self.bearings[b].magnets;
            before[1] += self.bearings[b].groups();
            before[2] += self.bearings[b].directions();
            b += 1;
        }
        before
    }

    /// Index range of a bearing's magnets.
    pub(crate) const fn magnets_of(&self, bearing: usize) -> Range<usize> {
        self.before(bearing)[0]..self.before(bearing + 1)[0]
    }

    /// Index range of a bearing's groups.
    pub(crate) const fn groups_of(&self, bearing: usize) -> Range<usize> {
        self.before(bearing)[1]..self.before(bearing + 1)[1]
    }

    /// Index range of a bearing's readings.
    pub const fn readings_of(&self, bearing: usize) -> Range<usize> {
        self.before(bearing)[2]..self.before(bearing + 1)[2]
    }

    /// Bearing of each group of magnets with its own smallest force, and its number in the bearing, both counted from 0.
    pub fn groups(&self) -> Vec<(usize, usize)> {
        let of_bearing = |(b, bearing): (usize, &Bearing)| (0..bearing.groups()).map(move |group| (b, group));
        self.bearings.iter().enumerate().flat_map(of_bearing).collect()
    }

    /// Index of magnet k's group in [`groups`](Self::groups).
    pub(crate) fn group(&self, k: usize) -> usize {
        let Some((bearing, number)) = self.magnet(k) else { return 0 };
        self.before(bearing)[1] + (number - 1) % self.bearings[bearing].groups()
    }

    /// Whether all magnets can form opposed pairs.
    pub fn is_paired(&self) -> bool {
        self.bearings.iter().all(Bearing::is_paired)
    }

    /// Whether the shaft tilts, in several bearings; a rotor in one bearing does not.
    pub(crate) const fn tilts(&self) -> bool {
        self.bearings.len() > 1
    }

    /// `number` for a shaft that tilts, 0 for a rotor in one bearing.
    pub(crate) fn if_tilting(&self, number: usize) -> usize {
        if self.tilts() { number } else { 0 }
    }

    /// `number` for a rotor in one bearing, 0 for a shaft that tilts.
    pub(crate) fn if_single(&self, number: usize) -> usize {
        if self.tilts() { 0 } else { number }
    }

    /// Whether the machine is a single radial bearing.
    pub fn is_planar(&self) -> bool {
        matches!(self.bearings, [bearing] if bearing.is_radial)
    }

    /// Indices of the coordinates on which a bearing acts.
    pub fn moves(&self, bearing: usize) -> Vec<usize> {
        let axial = !self.bearings[bearing].is_radial;
        (0..self.coordinates.len()).filter(|n| (self.coordinates[*n].position == X) == axial).collect()
    }

    /// Names of a variable of each magnet: `i` gives `i[1]`, or `A.i[1]`.
    pub fn of_magnets(&self, name: &str) -> Vec<String> {
        let of = |bearing: &'static Bearing| {
            (1..=bearing.magnets).map(move |number| format!("{}{name}[{number}]", bearing.prefix))
        };
        self.bearings.iter().flat_map(of).collect()
    }

    /// Symbols of a quantity of each magnet: `λ1`, or `A.λ1`.
    pub fn symbols(&self, symbol: &str) -> Vec<String> {
        self.of_magnets(symbol).into_iter().map(|name| name.replace(['[', ']'], "")).collect()
    }

    /// Names of a variable of each bearing: `F0`, or `A.F0`.
    pub fn of_bearings(&self, name: &str) -> Vec<String> {
        self.bearings.iter().map(|bearing| format!("{}{name}", bearing.prefix)).collect()
    }

    /// Names of the bias current of each bearing, if all magnets can form opposed pairs.
    pub fn of_biases(&self) -> Vec<String> {
        if self.is_paired() { self.of_bearings("bias.current") } else { Vec::new() }
    }

    /// Names of a variable of each group: numbered if the bearing has several.
    pub fn of_groups(&self, name: &str) -> Vec<String> {
        let of = |(bearing, group): (usize, usize)| {
            let Bearing { prefix, .. } = self.bearings[bearing];
            let number = if self.bearings[bearing].groups() > 1 { format!("[{}]", group + 1) } else { String::new() };
            format!("{prefix}{name}{number}")
        };
        self.groups().into_iter().map(of).collect()
    }

    /// Number of radial bearings.
    pub fn radial(&self) -> usize {
        self.bearings.iter().filter(|bearing| bearing.is_radial).count()
    }

    /// Names of a variable of each radial bearing.
    pub fn of_radial(&self, name: &str) -> Vec<String> {
        let radial = self.bearings.iter().filter(|bearing| bearing.is_radial);
        radial.map(|bearing| format!("{}{name}", bearing.prefix)).collect()
    }

    /// Names of a variable of each unbalance plane: `unbalance.phase`, or `unbalance[1].phase`.
    pub fn of_planes(&self, name: &str) -> Vec<String> {
        let number = |plane: usize| if self.planes > 1 { format!("[{plane}]") } else { String::new() };
        (1..=self.planes).map(|plane| format!("unbalance{}.{name}", number(plane))).collect()
    }

    /// Number of independent parts of the motion: two with both radial and axial bearings.
    pub fn parts(&self) -> usize {
        1 + usize::from((1..self.bearings.len()).contains(&self.radial()))
    }

    /// Names of a variable of each part.
    pub fn of_parts(&self, name: &str) -> Vec<String> {
        ["", "X."][..self.parts()].iter().map(|prefix| format!("{prefix}{name}")).collect()
    }

    /// Count of a variable of the paper's methods, which exist for its machine only: 1 or 0.
    pub fn of_paper(&self) -> usize {
        usize::from(*self == PLANAR)
    }

    /// Names of a variable of each reading: `sensor.offset` gives `sensor.offsetY`, or `A.sensor.offsetY`.
    pub fn of_readings(&self, name: &str) -> Vec<String> {
        self.readings.iter().map(|Reading { around: (begin, end), .. }| format!("{begin}{name}{end}")).collect()
    }

    /// Names of the references, in the order of the readings.
    pub fn of_references(&self) -> Vec<String> {
        let names = self.of_readings("reference.").into_iter();
        names.map(|name| if name.ends_with('.') { name + X } else { name }).collect()
    }

    /// Names of the positions of the rotor along the axes of the readings.
    pub fn positions(&self) -> Vec<String> {
        self.readings.iter().map(|reading| reading.name.trim_end_matches('m').to_owned()).collect()
    }

    /// Names of the readings.
    pub fn measured(&self) -> Vec<String> {
        self.readings.iter().map(|reading| reading.name.to_owned()).collect()
    }

    /// Names of a variable of each coordinate.
    pub fn of_coordinates(&self, part: fn(&Coordinate) -> &'static str) -> Vec<String> {
        self.coordinates.iter().map(|coordinate| part(coordinate).to_owned()).collect()
    }

    /// Names of a variable of each coordinate that is a length: `gravity.` gives `gravity.Y`.
    pub(crate) fn of_lengths(&self, name: &str) -> Vec<String> {
        let lengths = self.coordinates.iter().filter(|coordinate| !coordinate.is_angle);
        lengths.map(|coordinate| format!("{name}{}", coordinate.position)).collect()
    }

    /// Names of the start value of each coordinate: `Y0`.
    pub fn at_start(&self, part: fn(&Coordinate) -> &'static str) -> Vec<String> {
        self.of_coordinates(part).into_iter().map(|name| name + "0").collect()
    }

    /// Names of a variable of the load along each coordinate: `p` and `Hat` give `pYHat`, or `MYHat` for a moment.
    pub fn of_loads(&self, force: &str, end: &str) -> Vec<String> {
        let of = |coordinate: &Coordinate| {
            let (kind, axis) = coordinate.load.split_at(1);
            format!("{}{axis}{end}", if coordinate.is_angle { kind } else { force })
        };
        self.coordinates.iter().map(of).collect()
    }

    /// `along y`, or `about y` for an angle.
    pub fn direction(&self, n: usize) -> String {
        let axis = self.coordinates[n].load[1..].to_lowercase();
        format!("{} {axis}", self.either(n, "along", "about"))
    }

    /// Names of a force along each axis of a rotor in one bearing; several bearings have their own forces.
    pub fn of_resultant(&self, name: &str) -> Vec<String> {
        if self.tilts() { Vec::new() } else { self.of_lengths(name) }
    }

    /// Names of the outputs that state contact with each backup bearing.
    pub fn of_contact(&self) -> Vec<String> {
        self.of_bearings(if self.tilts() { "contact" } else { "touchdown.contact" })
    }

    /// The bearing of a variable with this name; the first one for those without a prefix.
    pub(crate) fn bearing_of(&self, name: &str) -> &Bearing {
        self.bearings.iter().find(|bearing| name.starts_with(bearing.prefix)).unwrap_or(&self.bearings[0])
    }

    /// `length` if coordinate n is a length, `angle` if it is an angle.
    pub fn either<T>(&self, n: usize, length: T, angle: T) -> T {
        if self.coordinates[n].is_angle { angle } else { length }
    }

    /// A description with its placeholders in braces filled in, for element `index` of the variable `name`.
    pub fn describe(&self, description: &str, name: &str, index: usize) -> String {
        let mut text = description.to_owned();
        if !text.contains('{') {
            return text;
        }
        let mut replace = |word: &str, by: &str| text = text.replace(word, by);
        let several = self.parts() > 1;
        replace("{, the greater}", if several { ", the greater of the radial and of the axial one" } else { "" });
        let part = ["radial bearings", "axial bearing"].get(index).filter(|_| several);
        replace("{of part}", &part.map(|part| format!(" of the {part}")).unwrap_or_default());
        let paper = "; with the paper's methods: fraction of the motion left unexplained";
        replace("{unexplained}", if self.of_paper() == 1 { paper } else { "" });
        replace("{in plane}", &if self.planes > 1 { format!(" in plane {}", index + 1) } else { String::new() });
        if let Some((bearing, number)) = self.magnet(index) {
            replace("{magnet}", &format!("magnet {number}{}", self.bearings[bearing].located("of")));
        }
        let bearing = self.bearing_of(name);
        if let Some((_, group)) = self.groups().get(index).filter(|(b, _)| self.bearings[*b].groups() > 1) {
            replace("{in group}", &format!(" in magnets {} and {}{{in bearing}}", group + 1, group + 3));
        }
        replace("{in group}", "{in bearing}");
        for preposition in ["of", "in", "at", "at the magnets of"] {
            replace(&format!("{{{preposition} bearing}}"), &bearing.located(preposition));
        }
        replace("{first axis}", bearing.first_axis());
        if let Some(coordinate) = self.coordinates.get(index) {
            replace("{position}", self.either(index, "Position of the centre of gravity", "Tilt of the rotor"));
            replace("{coordinate}", coordinate.position);
            replace("{force}", self.either(index, "force", "moment"));
            replace("{direction}", &self.direction(index));
        }
        if let Some(reading) = self.readings.get(index) {
            replace("{reading}", reading.name);
            replace("{axis}", reading.axis);
        }
        text
    }
}

/// Name of the coordinate along the shaft.
const X: &str = "X";

/// Plant, controller and estimator of a machine, with their descriptions.
macro_rules! models {
    ($($name:literal: $description:literal,)*) => { [$(($name, $description)),*] };
}

/// The coordinates of a shaft that tilts: without an axial bearing the first is omitted. A rotor in one bearing has some of them.
const COORDINATES: [Coordinate; 5] = [
    Coordinate::new([X, "vX", "aX", "pX", "perturbation.X"], false),
    Coordinate::new(["Y", "vY", "aY", "pY", "perturbation.Y"], false),
    Coordinate::new(["Z", "vZ", "aZ", "pZ", "perturbation.Z"], false),
    Coordinate::new(["beta", "betaRate", "betaAcceleration", "MY", "perturbation.MY"], true),
    Coordinate::new(["gamma", "gammaRate", "gammaAcceleration", "MZ", "perturbation.MZ"], true),
];

/// The planar rotor of the paper.
pub const PLANAR: Machine = Machine {
    name: "planar",
    models: models! {
        "MagneticBearing": "Rotor in a three-phase radial magnetic bearing, with unbalance, perturbation forces and sensors",
        "FlatnessController": "Flatness-based tracking controller with perturbation observer for a three-phase magnetic bearing",
        "AlgebraicEstimator": "On-line estimator of the force constants of a three-phase magnetic bearing",
    },
    bearings: &[Bearing::radial("", 3)],
    planes: 1,
    coordinates: &[COORDINATES[1], COORDINATES[2]],
    readings: &[
        Reading { name: "Ym", around: ("", "Y"), axis: "y" },
        Reading { name: "Zm", around: ("", "Z"), axis: "z" },
    ],
};

/// A radial bearing with two opposed pairs of magnets.
pub const PLANAR4: Machine = Machine {
    name: "planar4",
    models: models! {
        "MagneticBearing4": "Rotor in a radial magnetic bearing with four magnets, with unbalance, perturbation forces and sensors",
        "FlatnessController4": "Flatness-based tracking controller with perturbation observer for a magnetic bearing with four magnets",
        "AlgebraicEstimator4": "On-line estimator of the force constants of a magnetic bearing with four magnets",
    },
    bearings: &[Bearing::radial("", 4)],
    ..PLANAR
};

/// One axis with a magnet on either side.
pub const AXIAL: Machine = Machine {
    name: "axial",
    models: models! {
        "AxialBearing": "Rotor in an axial magnetic bearing with one or two magnets, with perturbation forces and sensors",
        "AxialController": "Flatness-based tracking controller with perturbation observer for an axial magnetic bearing",
        "AxialEstimator": "On-line estimator of the force constants of an axial magnetic bearing",
    },
    bearings: &[Bearing::axial("")],
    planes: 0,
    coordinates: &[COORDINATES[0]],
    readings: &[Reading { name: "Xm", around: ("", "X"), axis: "x" }],
};

/// Readings of a shaft: the axial one is the last.
const READINGS_OF_SHAFT: &[Reading] = &[
    Reading { name: "A.Ym", around: ("A.", "Y"), axis: "y at bearing A" },
    Reading { name: "A.Zm", around: ("A.", "Z"), axis: "z at bearing A" },
    Reading { name: "B.Ym", around: ("B.", "Y"), axis: "y at bearing B" },
    Reading { name: "B.Zm", around: ("B.", "Z"), axis: "z at bearing B" },
    Reading { name: "Xm", around: ("X.", ""), axis: "x" },
];

/// The spindle: a rigid shaft in two radial bearings with three magnets each and an axial bearing.
pub const SPINDLE: Machine = Machine::shaft::<5, 8>(
    "spindle",
    models! {
        "MagneticSpindle": "Rigid rotor in two radial magnetic bearings and an axial one, with two-plane unbalance, loads and sensors",
        "SpindleController": "Flatness-based tracking controller with perturbation observers for a spindle in two radial bearings and an axial one",
        "SpindleEstimator": "On-line estimator of the force constants and the two-plane unbalance of a spindle in magnetic bearings",
    },
);

/// The spindle with two opposed pairs of magnets in each radial bearing.
pub const SPINDLE4: Machine = Machine::shaft::<5, 10>(
    "spindle4",
    models! {
        "MagneticSpindle4": "Rigid rotor in two radial magnetic bearings with four magnets each and an axial one, with two-plane unbalance, loads and sensors",
        "SpindleController4": "Flatness-based tracking controller with perturbation observers for a spindle with four magnets in each radial bearing",
        "SpindleEstimator4": "On-line estimator of the force constants and the two-plane unbalance of a spindle with four magnets in each radial bearing",
    },
);

/// All machines, in display order; the first is the default of scenarios.
pub const MACHINES: [Machine; 5] = [PLANAR, SPINDLE, PLANAR4, SPINDLE4, AXIAL];

impl Default for &'static Machine {
    /// The planar rotor of the paper.
    fn default() -> Self {
        &PLANAR
    }
}

/// The machine of this name.
pub fn find(name: &str) -> Option<&'static Machine> {
    MACHINES.iter().find(|machine| machine.name == name)
}
