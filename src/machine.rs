//! How the parts of a machine are called: names of variables, and words of their descriptions.

/// Name and description.
type Called = (&'static str, &'static str);

/// A coordinate, and what belongs to it.
#[derive(Clone, Copy, Debug)]
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
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    /// Its name.
    pub name: &'static str,
    /// Begin and end of the names of what belongs to it.
    pub around: (&'static str, &'static str),
    /// Where it is taken.
    pub place: &'static str,
    /// Its sensor.
    pub sensor: &'static str,
}

/// A machine.
#[derive(Clone, Copy, Debug)]
pub struct Machine {
    /// What the names of each bearing begin with.
    pub bearings: &'static [&'static str],
    /// The bearing of each magnet, by its place in `bearings`, and its number there, counted from 1.
    pub magnets: &'static [(usize, usize)],
    /// The coordinates that each bearing moves.
    pub moves: &'static [&'static [usize]],
    /// The coordinates.
    pub coordinates: &'static [Coordinate],
    /// The readings of position.
    pub readings: &'static [Reading],
    /// The axes along which the forces of all magnets and of the backup bearing are shown.
    pub resultant: &'static [&'static str],
    /// Words in braces for these texts.
    words: &'static [(&'static str, &'static str)],
}

impl Machine {
    /// Names of a variable of each magnet: `i` gives `i[1]`, or `A.i[1]`.
    pub fn of_magnets(&self, name: &str) -> Vec<String> {
        let of = |(bearing, number): &(usize, usize)| format!("{}{name}[{number}]", self.bearings[*bearing]);
        self.magnets.iter().map(of).collect()
    }

    /// Names of a variable of each bearing: `F0`, or `A.F0`.
    pub fn of_bearings(&self, name: &str) -> Vec<String> {
        self.bearings.iter().map(|bearing| format!("{bearing}{name}")).collect()
    }

    /// Names of a variable of each reading: `sensor.offset` gives `sensor.offsetY`, or `A.sensor.offsetY`.
    pub fn of_readings(&self, name: &str) -> Vec<String> {
        self.readings.iter().map(|Reading { around: (begin, end), .. }| format!("{begin}{name}{end}")).collect()
    }

    /// Names of the readings.
    pub fn measured(&self) -> Vec<String> {
        self.readings.iter().map(|reading| reading.name.to_owned()).collect()
    }

    /// Names of what belongs to each coordinate.
    pub fn of_coordinates(&self, part: impl Fn(&Coordinate) -> Called) -> Vec<String> {
        self.coordinates.iter().map(|coordinate| part(coordinate).0.to_owned()).collect()
    }

    /// Names of a force along each axis of the resultant.
    pub fn of_resultant(&self, name: &str) -> Vec<String> {
        self.resultant.iter().map(|axis| format!("{name}{axis}")).collect()
    }

    /// The first for a coordinate that is a length or what belongs to one, the second for an angle.
    pub fn either<T>(&self, n: usize, length: T, angle: T) -> T {
        if self.coordinates[n].is_angle { angle } else { length }
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
        if let Some((bearing, number)) = self.magnets.get(index) {
            let prefix = self.bearings[*bearing];
            let magnet = format!("magnet {number}{}", of_bearing(prefix));
            let part = |part: &str| {
                if prefix.is_empty() { format!("{part} {number}") } else { format!("the {part} of {magnet}") }
            };
            replace("{coil}", &part("coil"));
            replace("{amplifier}", &part("amplifier"));
            replace("{flux}", &format!("{prefix}psi[{number}]"));
            replace("{magnet}", &magnet);
        }
        if let Some(prefix) = self.bearings.get(index) {
            replace("{of bearing}", &of_bearing(prefix));
            replace("{in bearing}", &of_bearing(prefix).replace(" of ", " in "));
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

/// The planar rotor of the paper.
pub static PLANAR: Machine = Machine {
    bearings: &[""],
    magnets: &[(0, 1), (0, 2), (0, 3)],
    moves: &[&[0, 1]],
    coordinates: &[
        Coordinate {
            position: ("Y", "Position of the rotor along y"),
            rate: ("vY", "Velocity of the rotor along y"),
            acceleration: ("aY", "Acceleration of the rotor along y"),
            load: ("pY", "Perturbation force on the rotor along y"),
            perturbation: (
                "perturbation.Y",
                "All forces on the rotor except those of magnets and backup bearing, along y",
            ),
            is_angle: false,
        },
        Coordinate {
            position: ("Z", "Position of the rotor along z"),
            rate: ("vZ", "Velocity of the rotor along z"),
            acceleration: ("aZ", "Acceleration of the rotor along z"),
            load: ("pZ", "Perturbation force on the rotor along z"),
            perturbation: (
                "perturbation.Z",
                "All forces on the rotor except those of magnets and backup bearing, along z",
            ),
            is_angle: false,
        },
    ],
    readings: &[
        Reading { name: "Ym", around: ("", "Y"), place: "along y", sensor: "the position sensor along y" },
        Reading { name: "Zm", around: ("", "Z"), place: "along z", sensor: "the position sensor along z" },
    ],
    resultant: &["Y", "Z"],
    words: &[
        ("{positions}", "Ym and Zm"),
        ("{read}", "Ym and Zm"),
        ("{positions and im}", "Ym, Zm and im"),
        ("{smallest force}", "smallest force"),
        ("{turning}", ""),
        ("{its flux}", "psi"),
    ],
};

/// The spindle.
pub static SPINDLE: Machine = Machine {
    bearings: &["A.", "B.", "X."],
    magnets: &[(0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 1), (2, 2)],
    moves: &[&[1, 2, 3, 4], &[1, 2, 3, 4], &[0]],
    coordinates: &[
        Coordinate {
            position: ("X", "Position of the centre of gravity along the shaft"),
            rate: ("vX", "Derivative of X"),
            acceleration: ("aX", "Derivative of vX"),
            load: ("pX", "Load on the rotor along the shaft"),
            perturbation: (
                "perturbation.X",
                "All forces on the rotor along the shaft except those of magnets and backup bearings",
            ),
            is_angle: false,
        },
        Coordinate {
            position: ("Y", "Position of the centre of gravity along y"),
            rate: ("vY", "Derivative of Y"),
            acceleration: ("aY", "Derivative of vY"),
            load: ("pY", "Load on the rotor along y at the centre of gravity"),
            perturbation: (
                "perturbation.Y",
                "All forces on the rotor along y except those of magnets and backup bearings",
            ),
            is_angle: false,
        },
        Coordinate {
            position: ("Z", "Position of the centre of gravity along z"),
            rate: ("vZ", "Derivative of Z"),
            acceleration: ("aZ", "Derivative of vZ"),
            load: ("pZ", "Load on the rotor along z at the centre of gravity"),
            perturbation: (
                "perturbation.Z",
                "All forces on the rotor along z except those of magnets and backup bearings",
            ),
            is_angle: false,
        },
        Coordinate {
            position: ("beta", "Tilt of the rotor about y"),
            rate: ("betaRate", "Derivative of beta"),
            acceleration: ("betaAcceleration", "Derivative of betaRate"),
            load: ("MY", "Load moment on the rotor about y"),
            perturbation: (
                "perturbation.MY",
                "All moments on the rotor about y except those of magnets and backup bearings",
            ),
            is_angle: true,
        },
        Coordinate {
            position: ("gamma", "Tilt of the rotor about z"),
            rate: ("gammaRate", "Derivative of gamma"),
            acceleration: ("gammaAcceleration", "Derivative of gammaRate"),
            load: ("MZ", "Load moment on the rotor about z"),
            perturbation: (
                "perturbation.MZ",
                "All moments on the rotor about z except those of magnets and backup bearings",
            ),
            is_angle: true,
        },
    ],
    readings: &[
        Reading { name: "A.Ym", around: ("A.", "Y"), place: "along y at the sensors of bearing A", sensor: "A.Ym" },
        Reading { name: "A.Zm", around: ("A.", "Z"), place: "along z at the sensors of bearing A", sensor: "A.Zm" },
        Reading { name: "B.Ym", around: ("B.", "Y"), place: "along y at the sensors of bearing B", sensor: "B.Ym" },
        Reading { name: "B.Zm", around: ("B.", "Z"), place: "along z at the sensors of bearing B", sensor: "B.Zm" },
        Reading { name: "Xm", around: ("X.", ""), place: "along the shaft", sensor: "Xm" },
    ],
    resultant: &[],
    words: &[
        ("{positions}", "the measured positions"),
        ("{read}", "the positions"),
        ("{positions and im}", "the measured positions and im"),
        ("{smallest force}", "smallest forces"),
        ("{turning}", ", from y towards z"),
        ("{its flux}", "it"),
    ],
};
