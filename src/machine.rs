//! The machines of this project, each described once: its bearings, coordinates and sensors, and how they are called.
//!
//! Names of variables, connections, scenario keys and FMUs follow from a description. The equations know the sizes of their arrays alone, as
//! const generics: `Machine::of` finds the description of sizes.

use std::ops::Range;

/// Name and description.
type Called = (&'static str, &'static str);

/// A coordinate, and what belongs to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coordinate {
    /// The coordinate itself.
    pub position: Called,
    /// Its rate.
    pub rate: Called,
    /// Its acceleration.
    pub acceleration: Called,
    /// The load on it, an input.
    pub load: Called,
    /// All forces on it except those of magnets and backup bearings.
    pub perturbation: Called,
    /// Whether it is an angle, and the force on it a moment.
    pub is_angle: bool,
}

/// A reading of position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Its name.
    pub name: &'static str,
    /// Begin and end of the names of what belongs to it.
    pub around: (&'static str, &'static str),
    /// Where it is taken.
    pub place: &'static str,
    /// The axis that it is for, and the bearing if there are several.
    pub axis: &'static str,
    /// Its sensor.
    pub sensor: &'static str,
}

/// In which direction a bearing holds the rotor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Across the shaft.
    Radial,
    /// Along the shaft.
    Axial,
}

/// A bearing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bearing {
    /// Prefix of the names of all that belongs to it.
    pub prefix: &'static str,
    /// Its direction.
    pub kind: Kind,
    /// Number of its magnets.
    pub magnets: usize,
}

impl Bearing {
    const fn radial(prefix: &'static str, magnets: usize) -> Self {
        Self { prefix, kind: Kind::Radial, magnets }
    }

    const fn axial(prefix: &'static str) -> Self {
        Self { prefix, kind: Kind::Axial, magnets: 2 }
    }

    /// Its name; empty if there is no other.
    pub fn name(&self) -> &'static str {
        self.prefix.trim_end_matches('.')
    }

    /// The number of directions in which it holds the rotor.
    fn directions(&self) -> usize {
        match self.kind {
            Kind::Radial => 2,
            Kind::Axial => 1,
        }
    }

    /// Whether its magnets come in pairs that may face each other.
    fn is_paired(&self) -> bool {
        self.magnets == 2 * self.directions()
    }

    /// The number of groups of magnets that have a smallest force of their own: the pairs, or all magnets together.
    pub fn groups(&self) -> usize {
        if self.is_paired() { self.directions() } else { 1 }
    }
}

/// A machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Machine {
    /// Its name in scenarios.
    pub name: &'static str,
    /// The models of plant, controller and estimator, with a description each.
    pub models: [Called; 3],
    /// The bearings, in the order of their magnets.
    pub bearings: &'static [Bearing],
    /// Number of planes with an unbalance.
    pub planes: usize,
    /// The coordinates; among them angles if the shaft tilts.
    pub coordinates: &'static [Coordinate],
    /// The readings of position.
    pub readings: &'static [Reading],
    /// The axes along which the forces of all magnets and of the backup bearing are shown.
    pub resultant: &'static [&'static str],
    /// Words in braces for these texts.
    words: &'static [Called],
}

impl Machine {
    /// The machine with n coordinates and m magnets in its first bearing.
    const fn find(n: usize, m: usize) -> Option<&'static Self> {
        const ALL: &[Machine] = &MACHINES;
        let mut at = 0;
        while at < ALL.len() {
            if ALL[at].coordinates.len() == n && ALL[at].bearings[0].magnets == m {
                return Some(&ALL[at]);
            }
            at += 1;
        }
        None
    }

    /// That with one bearing.
    pub(crate) const fn of_one_bearing(n: usize, k: usize) -> &'static Self {
        Self::find(n, k).expect("a machine of this project")
    }

    /// That with a shaft that tilts. One that is none of [`MACHINES`] has no name.
    pub(crate) const fn of_shaft<const N: usize, const M: usize>() -> &'static Self {
        match Self::find(N, M) {
            Some(known) => known,
            None => const { &Self::shaft::<N, M>("", [("", ""); 3]) },
        }
    }

    /// A shaft that tilts, in two radial bearings with M magnets each, and with N = 5 coordinates in an axial one.
    const fn shaft<const N: usize, const M: usize>(name: &'static str, models: [Called; 3]) -> Self {
        const { assert!(N == 4 || N == 5, "a shaft that tilts") };
        Self {
            name,
            models,
            bearings: const { &[Bearing::radial("A.", M), Bearing::radial("B.", M), Bearing::axial("X.")] }
                .split_at(N - 2)
                .0,
            planes: 2,
            coordinates: OF_SHAFT.split_at(5 - N).1,
            readings: READINGS_OF_SHAFT.split_at(N).0,
            resultant: &[],
            words: WORDS_OF_SHAFT,
        }
    }

    /// The bearing of magnet k, counted from 0, by its place among the bearings, and the magnet's number there, counted from 1.
    pub fn magnet(&self, k: usize) -> Option<(usize, usize)> {
        let numbered = |(b, bearing): (usize, &Bearing)| (1..=bearing.magnets).map(move |number| (b, number));
        self.bearings.iter().enumerate().flat_map(numbered).nth(k)
    }

    /// The bearings with their magnets, by their places among all.
    pub fn magnets_of_bearings(&self) -> Vec<(&'static Bearing, Range<usize>)> {
        let ends = self.bearings.iter().scan(0, |end, bearing| {
            *end += bearing.magnets;
            Some((bearing, *end - bearing.magnets..*end))
        });
        ends.collect()
    }

    /// Number of magnets.
    pub fn magnets(&self) -> usize {
        self.bearings.iter().map(|bearing| bearing.magnets).sum()
    }

    /// Bearing, and number in it, of each group of magnets that has a smallest force of its own, both counted from 0.
    pub fn groups(&self) -> Vec<(usize, usize)> {
        let of_bearing = |(b, bearing): (usize, &Bearing)| (0..bearing.groups()).map(move |group| (b, group));
        self.bearings.iter().enumerate().flat_map(of_bearing).collect()
    }

    /// The group of magnet k, by its place in [`groups`](Self::groups).
    pub(crate) fn group(&self, k: usize) -> usize {
        let Some((bearing, number)) = self.magnet(k) else { return 0 };
        let before: usize = self.bearings[..bearing].iter().map(Bearing::groups).sum();
        before + (number - 1) % self.bearings[bearing].groups()
    }

    /// Whether all magnets come in pairs that may face each other.
    pub fn is_paired(&self) -> bool {
        self.bearings.iter().all(Bearing::is_paired)
    }

    /// Whether the machine is a single bearing and holds the rotor across its axis.
    pub fn is_planar(&self) -> bool {
        matches!(self.bearings, [bearing] if bearing.kind == Kind::Radial)
    }

    /// The coordinates that a bearing moves.
    pub fn moves(&self, bearing: usize) -> Vec<usize> {
        let axial = self.bearings[bearing].kind == Kind::Axial;
        (0..self.coordinates.len()).filter(|n| (self.coordinates[*n].position.0 == X) == axial).collect()
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

    /// Names of the bias current of each bearing, if all have pairs of magnets that may face each other.
    pub fn of_biases(&self) -> Vec<String> {
        if self.is_paired() { self.of_bearings("bias.current") } else { Vec::new() }
    }

    /// Names of a variable of each group: that of the bearing, with a number if it has several.
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
        self.bearings.iter().filter(|bearing| bearing.kind == Kind::Radial).count()
    }

    /// Number of axial bearings.
    pub(crate) fn axial(&self) -> usize {
        self.bearings.len() - self.radial()
    }

    /// Names of a variable of each radial bearing.
    pub fn of_radial(&self, name: &str) -> Vec<String> {
        let radial = self.bearings.iter().filter(|bearing| bearing.kind == Kind::Radial);
        radial.map(|bearing| format!("{}{name}", bearing.prefix)).collect()
    }

    /// Names of a variable of each plane of unbalance: `unbalance.phase`, or `unbalance[1].phase`.
    pub fn of_planes(&self, name: &str) -> Vec<String> {
        let number = |plane: usize| if self.planes > 1 { format!("[{plane}]") } else { String::new() };
        (1..=self.planes).map(|plane| format!("unbalance{}.{name}", number(plane))).collect()
    }

    /// Number of independent parts of the motion: radial bearings and an axial one make two.
    pub fn parts(&self) -> usize {
        1 + usize::from(self.radial() > 0 && self.axial() > 0)
    }

    /// Names of a variable of each part.
    pub fn of_parts(&self, name: &str) -> Vec<String> {
        ["", "X."][..self.parts()].iter().map(|prefix| format!("{prefix}{name}")).collect()
    }

    /// Names of the positions and the currents of a part.
    pub fn part(&self, index: usize) -> (&'static str, &'static str) {
        match (self.parts(), index) {
            (1, _) => (self.word("{read}"), "im"),
            (_, 0) => ("the radial positions", "im of A and B"),
            _ => ("Xm", "im of X"),
        }
    }

    /// 1 for the machine of the paper, for which its methods are, 0 for all others.
    pub fn of_paper(&self) -> usize {
        usize::from(*self == PLANAR)
    }

    /// Names of a variable of each reading: `sensor.offset` gives `sensor.offsetY`, or `A.sensor.offsetY`.
    pub fn of_readings(&self, name: &str) -> Vec<String> {
        self.readings.iter().map(|Reading { around: (begin, end), .. }| format!("{begin}{name}{end}")).collect()
    }

    /// Names of the references in the order of the readings.
    pub fn of_references(&self) -> Vec<String> {
        let names = self.of_readings("reference.").into_iter();
        names.map(|name| if name.ends_with('.') { name + X } else { name }).collect()
    }

    /// Names of the readings.
    pub fn measured(&self) -> Vec<String> {
        self.readings.iter().map(|reading| reading.name.to_owned()).collect()
    }

    /// Names of what belongs to each coordinate.
    pub fn of_coordinates(&self, part: impl Fn(&Coordinate) -> Called) -> Vec<String> {
        self.coordinates.iter().map(|coordinate| part(coordinate).0.to_owned()).collect()
    }

    /// Names of what belongs to each coordinate that is a length: `gravity.` gives `gravity.Y`.
    pub(crate) fn of_lengths(&self, name: &str) -> Vec<String> {
        let lengths = self.coordinates.iter().filter(|coordinate| !coordinate.is_angle);
        lengths.map(|coordinate| format!("{name}{}", coordinate.position.0)).collect()
    }

    /// Names of what belongs to each coordinate at the start: `Y0`.
    pub fn at_start(&self, part: impl Fn(&Coordinate) -> Called) -> Vec<String> {
        self.of_coordinates(part).into_iter().map(|name| name + "0").collect()
    }

    /// The number of angles of magnets if all are in one bearing: an axial one has none.
    pub fn angles(&self) -> usize {
        if self.is_planar() { self.magnets() } else { 0 }
    }

    /// Names of what belongs to the load on each coordinate: `p` and `Hat` give `pYHat`, and `MYHat` for a moment.
    pub fn of_loads(&self, force: &str, end: &str) -> Vec<String> {
        let of = |coordinate: &Coordinate| {
            let (kind, axis) = coordinate.load.0.split_at(1);
            format!("{}{axis}{end}", if coordinate.is_angle { kind } else { force })
        };
        self.coordinates.iter().map(of).collect()
    }

    /// `along y`, or `about y` for an angle.
    pub fn direction(&self, n: usize) -> String {
        let axis = self.coordinates[n].load.0[1..].to_lowercase();
        format!("{} {axis}", self.either(n, "along", "about"))
    }

    /// Names of a force along each axis of the resultant.
    pub fn of_resultant(&self, name: &str) -> Vec<String> {
        self.resultant.iter().map(|axis| format!("{name}{axis}")).collect()
    }

    /// The first for a coordinate that is a length or what belongs to one, the second for an angle.
    pub fn either<T>(&self, n: usize, length: T, angle: T) -> T {
        if self.coordinates[n].is_angle { angle } else { length }
    }

    /// Replacement of a word in braces.
    pub fn word(&self, word: &str) -> &'static str {
        self.words.iter().find(|(known, _)| *known == word).map_or("", |(_, text)| text)
    }

    /// A description with words for what stands in braces, of the element with that index.
    pub fn describe(&self, description: &str, index: usize) -> String {
        let mut text = description.to_owned();
        if !text.contains('{') {
            return text;
        }
        let mut replace = |word: &str, by: &str| text = text.replace(word, by);
        for (word, by) in self.words {
            replace(word, by);
        }
        let several = self.parts() > 1;
        replace("{, the greater}", if several { ", the greater of the radial and of the axial one" } else { "" });
        replace("{at this bearing}", if several { " at this bearing" } else { "" });
        let paper = "; with the paper's methods: fraction of the motion left unexplained";
        replace("{unexplained}", if self.of_paper() == 1 { paper } else { "" });
        replace("{in planes}", if self.planes > 1 { " in two planes" } else { "" });
        replace("{in plane}", &if self.planes > 1 { format!(" in plane {}", index + 1) } else { String::new() });
        let (valid, why) = match several {
            true => (
                "Whether all estimates are valid; of those that are not, the last valid one is shown",
                "Why the estimates are valid or not: of A and B, or, if they are valid, of X",
            ),
            false => (
                "Whether the estimate is valid; if not, lambdaHat is the last valid one",
                "Why the estimate is valid or not",
            ),
        };
        replace("{Whether the estimate is valid}", valid);
        replace("{Why the estimate is valid or not}", why);
        if let Some((bearing, number)) = self.magnet(index) {
            let Bearing { prefix, .. } = self.bearings[bearing];
            let magnet = format!("magnet {number}{}", of_bearing(prefix));
            let part = |part: &str| {
                if prefix.is_empty() { format!("{part} {number}") } else { format!("the {part} of {magnet}") }
            };
            replace("{coil}", &part("coil"));
            replace("{amplifier}", &part("amplifier"));
            replace("{driven}", &if prefix.is_empty() { format!("amplifier {number}") } else { magnet.clone() });
            replace("{flux}", &format!("{prefix}psi[{number}]"));
            replace("{magnet}", &magnet);
        }
        if let Some(Bearing { prefix, .. }) = self.bearings.get(index) {
            replace("{of bearing}", &of_bearing(prefix));
        }
        if let Some((bearing, group)) = self.groups().get(index) {
            let Bearing { prefix, .. } = self.bearings[*bearing];
            let pair = format!(" in magnets {} and {}", group + 1, group + 3);
            let pair = if self.bearings[*bearing].groups() > 1 { pair } else { String::new() };
            replace("{in group}", &(pair + &of_bearing(prefix).replace(" of ", " in ")));
        }
        if let Some(axis) = self.resultant.get(index) {
            replace("{axis}", &axis.to_lowercase());
        }
        if let Some(reading) = self.readings.get(index) {
            replace("{place}", reading.place);
            replace("{sensor}", reading.sensor);
        }
        text
    }
}

/// ` of bearing A` for the prefix `A.`, nothing where there is but one.
fn of_bearing(prefix: &str) -> String {
    prefix.strip_suffix('.').map(|name| format!(" of bearing {name}")).unwrap_or_default()
}

/// The name of the coordinate along the shaft.
const X: &str = "X";

/// A coordinate of a rotor in one bearing: its name and the axis.
macro_rules! in_one_bearing {
    ($name:literal $axis:literal) => {
        Coordinate {
            position: ($name, concat!("Position of the rotor along ", $axis)),
            rate: (concat!("v", $name), concat!("Velocity of the rotor along ", $axis)),
            acceleration: (concat!("a", $name), concat!("Acceleration of the rotor along ", $axis)),
            load: (concat!("p", $name), concat!("Perturbation force on the rotor along ", $axis)),
            perturbation: (
                concat!("perturbation.", $name),
                concat!("All forces on the rotor except those of magnets and backup bearing, along ", $axis),
            ),
            is_angle: false,
        }
    };
}

/// A coordinate of the centre of gravity of a shaft: its name, its direction, and where a load acts.
macro_rules! of_centre {
    ($name:literal $along:literal $at:literal) => {
        Coordinate {
            position: ($name, concat!("Position of the centre of gravity ", $along)),
            rate: (concat!("v", $name), concat!("Derivative of ", $name)),
            acceleration: (concat!("a", $name), concat!("Derivative of v", $name)),
            load: (concat!("p", $name), concat!("Load on the rotor ", $along, $at)),
            perturbation: (
                concat!("perturbation.", $name),
                concat!("All forces on the rotor ", $along, " except those of magnets and backup bearings"),
            ),
            is_angle: false,
        }
    };
}

/// A tilt of a shaft: its name, its axis, and the moment about it.
macro_rules! tilt {
    ($name:literal $about:literal $moment:literal) => {
        Coordinate {
            position: ($name, concat!("Tilt of the rotor ", $about)),
            rate: (concat!($name, "Rate"), concat!("Derivative of ", $name)),
            acceleration: (concat!($name, "Acceleration"), concat!("Derivative of ", $name, "Rate")),
            load: ($moment, concat!("Load moment on the rotor ", $about)),
            perturbation: (
                concat!("perturbation.", $moment),
                concat!("All moments on the rotor ", $about, " except those of magnets and backup bearings"),
            ),
            is_angle: true,
        }
    };
}

/// The coordinates of a rotor that is held in a plane.
const IN_PLANE: [Coordinate; 2] = [in_one_bearing!("Y" "y"), in_one_bearing!("Z" "z")];

/// The coordinate of a rotor that moves along its axis alone.
const ALONG_AXIS: [Coordinate; 1] = [in_one_bearing!("X" "x")];

/// The coordinates of a shaft that tilts; the first one is left out if something else holds it along its axis.
const OF_SHAFT: [Coordinate; 5] = [
    of_centre!("X" "along the shaft" ""),
    of_centre!("Y" "along y" " at the centre of gravity"),
    of_centre!("Z" "along z" " at the centre of gravity"),
    tilt!("beta" "about y" "MY"),
    tilt!("gamma" "about z" "MZ"),
];

/// The planar rotor of the paper.
pub const PLANAR: Machine = Machine {
    name: "planar",
    models: [
        (
            "MagneticBearing",
            "Rotor in a three-phase radial magnetic bearing, with unbalance, perturbation forces and sensors",
        ),
        (
            "FlatnessController",
            "Flatness-based tracking controller with perturbation observer for a three-phase magnetic bearing",
        ),
        ("AlgebraicEstimator", "On-line estimator of the force constants of a three-phase magnetic bearing"),
    ],
    bearings: &[Bearing::radial("", 3)],
    planes: 1,
    coordinates: &IN_PLANE,
    readings: &[
        Reading { name: "Ym", around: ("", "Y"), place: "along y", axis: "y", sensor: "the position sensor along y" },
        Reading { name: "Zm", around: ("", "Z"), place: "along z", axis: "z", sensor: "the position sensor along z" },
    ],
    resultant: &["Y", "Z"],
    words: &[
        ("{positions}", "Ym and Zm"),
        ("{read}", "Ym and Zm"),
        ("{positions and im}", "Ym, Zm and im"),
        ("{smallest force}", "smallest force"),
        ("{turning}", ""),
        ("{speed of the reference}", "Angular velocity on the reference trajectory"),
        ("{predicted gap}", "the predicted gap"),
        ("{of all} ", ""),
        ("{first axis}", "y"),
        ("{its flux}", "psi"),
    ],
};

/// A radial bearing with two opposed pairs of magnets.
pub const PLANAR4: Machine = Machine {
    name: "planar4",
    models: [
        (
            "MagneticBearing4",
            "Rotor in a radial magnetic bearing with four magnets, with unbalance, perturbation forces and sensors",
        ),
        (
            "FlatnessController4",
            "Flatness-based tracking controller with perturbation observer for a magnetic bearing with four magnets",
        ),
        ("AlgebraicEstimator4", "On-line estimator of the force constants of a magnetic bearing with four magnets"),
    ],
    bearings: &[Bearing::radial("", 4)],
    ..PLANAR
};

/// One axis held by a magnet on either side.
pub const AXIAL: Machine = Machine {
    name: "axial",
    models: [
        (
            "AxialBearing",
            "Rotor in an axial magnetic bearing with one or two magnets, with perturbation forces and sensors",
        ),
        (
            "AxialController",
            "Flatness-based tracking controller with perturbation observer for an axial magnetic bearing",
        ),
        ("AxialEstimator", "On-line estimator of the force constants of an axial magnetic bearing"),
    ],
    bearings: &[Bearing::axial("")],
    planes: 0,
    coordinates: &ALONG_AXIS,
    readings: &[Reading { name: "Xm", around: ("", "X"), place: "along x", axis: "x", sensor: "the position sensor" }],
    resultant: &[X],
    words: &[
        ("{positions}", "Xm"),
        ("{read}", "Xm"),
        ("{positions and im}", "Xm and im"),
        ("{smallest force}", "smallest force"),
        ("{turning}", ""),
        ("{speed of the reference}", "Angular velocity on the reference trajectory"),
        ("{predicted gap}", "the predicted gap"),
        ("{of all} ", ""),
        ("{first axis}", "x"),
        ("{its flux}", "psi"),
    ],
};

/// Readings of a shaft: the axial one is the last.
const READINGS_OF_SHAFT: &[Reading] = &[
    Reading {
        name: "A.Ym",
        around: ("A.", "Y"),
        place: "along y at the sensors of bearing A",
        axis: "y at bearing A",
        sensor: "A.Ym",
    },
    Reading {
        name: "A.Zm",
        around: ("A.", "Z"),
        place: "along z at the sensors of bearing A",
        axis: "z at bearing A",
        sensor: "A.Zm",
    },
    Reading {
        name: "B.Ym",
        around: ("B.", "Y"),
        place: "along y at the sensors of bearing B",
        axis: "y at bearing B",
        sensor: "B.Ym",
    },
    Reading {
        name: "B.Zm",
        around: ("B.", "Z"),
        place: "along z at the sensors of bearing B",
        axis: "z at bearing B",
        sensor: "B.Zm",
    },
    Reading { name: "Xm", around: ("X.", ""), place: "along the shaft", axis: "x", sensor: "Xm" },
];

/// Words for a shaft.
const WORDS_OF_SHAFT: &[Called] = &[
    ("{positions}", "the measured positions"),
    ("{read}", "the positions"),
    ("{positions and im}", "the measured positions and im"),
    ("{smallest force}", "smallest forces"),
    ("{turning}", ", from y towards z"),
    ("{speed of the reference}", "Speed of the rotor: of the reference trajectory and of the gyroscopic moments"),
    ("{predicted gap}", "a predicted gap"),
    ("{of all} ", "of all magnets "),
    ("{first axis}", "y"),
    ("{its flux}", "it"),
];

/// The spindle: a rigid shaft in two radial bearings with three magnets each, and an axial one.
pub const SPINDLE: Machine = Machine::shaft::<5, 3>(
    "spindle",
    [
        (
            "MagneticSpindle",
            "Rigid rotor in two radial magnetic bearings and an axial one, with two-plane unbalance, loads and sensors",
        ),
        (
            "SpindleController",
            "Flatness-based tracking controller with perturbation observers for a spindle in two radial bearings and an axial one",
        ),
        (
            "SpindleEstimator",
            "On-line estimator of the force constants and the two-plane unbalance of a spindle in magnetic bearings",
        ),
    ],
);

/// The spindle with two opposed pairs of magnets in each radial bearing.
pub const SPINDLE4: Machine = Machine::shaft::<5, 4>(
    "spindle4",
    [
        (
            "MagneticSpindle4",
            "Rigid rotor in two radial magnetic bearings with four magnets each and an axial one, with two-plane unbalance, loads and sensors",
        ),
        (
            "SpindleController4",
            "Flatness-based tracking controller with perturbation observers for a spindle with four magnets in each radial bearing",
        ),
        (
            "SpindleEstimator4",
            "On-line estimator of the force constants and the two-plane unbalance of a spindle with four magnets in each radial bearing",
        ),
    ],
);

/// All machines, in the order in which they are shown; a scenario that names none is of the first.
pub const MACHINES: [Machine; 5] = [PLANAR, SPINDLE, PLANAR4, SPINDLE4, AXIAL];

impl Default for &'static Machine {
    /// The planar rotor of the paper.
    fn default() -> Self {
        &PLANAR
    }
}

/// The machine of that name.
pub fn find(name: &str) -> Option<&'static Machine> {
    MACHINES.iter().find(|machine| machine.name == name)
}
