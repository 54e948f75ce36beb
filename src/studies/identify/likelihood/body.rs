//! The moving bodies: a rotor in one radial bearing, a shaft in radial motion, an axis.

use super::bench::{DYNAMICS, Places, place};
use super::filter::passes;
use super::rotor::{Describe, Description, Layout, Model};
use super::search;
use super::{Identified, Options, Part, Recording};
use crate::bearing::{BearingConfig, RotorConfig, Shaft, array};
use crate::estimation::Machine;
use crate::plant::PLANES;

/// Step of central differences, in typical tolerances: the truncation error is below 10⁻⁸ of a derivative.
const STEP: f64 = 1e-3;

/// Prefixes of the radial bearings of a shaft.
const SHAFT: [&str; 2] = ["A.", "B."];

/// A body with its magnets, as stated on the data sheet.
#[derive(Clone, Debug)]
pub enum Body {
    /// A rotor in one radial bearing.
    Disc {
        /// Mass, kg.
        m_kg: f64,
        /// Nominal gap, m.
        gap_m: f64,
        /// Angles of the magnets, rad; magnet k pulls along `(sin α_k, cos α_k)` in (y, z).
        alpha_rad: Vec<f64>,
    },
    /// A shaft in two radial bearings, with two planes of unbalance.
    Shaft {
        /// Shaft and bearings; only the first `magnets` angles count.
        geometry: Box<RotorConfig<f64, 3>>,
        /// Magnets of each radial bearing.
        magnets: usize,
        /// Positions of the unbalance planes, m from the centre of gravity.
        planes_m: [f64; PLANES],
    },
    /// A rotor moving along its axis between two magnets.
    Axis {
        /// Mass, kg.
        m_kg: f64,
        /// Nominal gap, m.
        gap_m: f64,
    },
}

impl Body {
    /// Name prefixes of its bearings.
    pub(in crate::studies::identify) fn prefixes(&self) -> &'static [&'static str] {
        match self {
            Self::Disc { .. } => &[""],
            Self::Shaft { .. } => &SHAFT,
            Self::Axis { .. } => &["X."],
        }
    }

    /// Prefix of parameters of the whole body: the axial motion has a mass and a delay of its own.
    pub(in crate::studies::identify) fn prefix(&self) -> &'static str {
        if let Self::Axis { .. } = self { self.prefixes()[0] } else { "" }
    }

    /// Numbers of coordinates, magnets and planes of unbalance.
    pub(super) fn sizes(&self) -> [usize; 3] {
        match self {
            Self::Disc { alpha_rad, .. } => [2, alpha_rad.len(), 1],
            Self::Shaft { magnets, .. } => [4, 2 * magnets, PLANES],
            Self::Axis { .. } => [1, 2, 0],
        }
    }

    /// Number of coordinates, one per position sensor.
    #[must_use]
    pub fn coordinates(&self) -> usize {
        self.sizes()[0]
    }

    /// Number of magnets.
    #[must_use]
    pub fn magnets(&self) -> usize {
        self.sizes()[1]
    }

    /// Mass, kg.
    #[must_use]
    pub fn m_kg(&self) -> f64 {
        match self {
            Self::Disc { m_kg, .. } | Self::Axis { m_kg, .. } => *m_kg,
            Self::Shaft { geometry, .. } => geometry.shaft.m_kg,
        }
    }

    /// Nominal gap of the magnets (first radial bearing of a shaft), m.
    #[must_use]
    pub fn gap_m(&self) -> f64 {
        match self {
            Self::Disc { gap_m, .. } | Self::Axis { gap_m, .. } => *gap_m,
            Self::Shaft { geometry, .. } => geometry.bearings[0].gap_m,
        }
    }

    /// Gap of a magnet at these sensor readings, m, as if the sensors were at the magnets.
    pub(in crate::studies::identify) fn gap_at(&self, k: usize, position_m: impl Fn(usize) -> f64) -> f64 {
        let radial = |gap_m: f64, alpha_rad: f64, first: usize| {
            let (sin, cos) = libm::sincos(alpha_rad);
            gap_m - sin * position_m(first) - cos * position_m(first + 1)
        };
        match self {
            Self::Disc { gap_m, alpha_rad, .. } => radial(*gap_m, alpha_rad[k], 0),
            Self::Shaft { geometry, magnets, .. } => {
                let bearing = &geometry.bearings[k / magnets];
                radial(bearing.gap_m, bearing.alpha_rad[k % magnets], 2 * (k / magnets))
            }
            Self::Axis { gap_m, .. } => gap_m + if k == 0 { -position_m(0) } else { position_m(0) },
        }
    }

    /// Stated values by name.
    pub(in crate::studies::identify) fn numbers(&self) -> Vec<(String, f64)> {
        let mut numbers = vec![("m".to_owned(), self.m_kg())];
        if let Self::Shaft { geometry, .. } = self {
            numbers.push(("Jt".into(), geometry.shaft.transverse_kgm2));
            numbers.push(("Jp".into(), geometry.shaft.polar_kgm2));
        }
        let mut bearing = |prefix: &str, gap_m: f64, alpha_rad: &[f64], places: &[(&str, f64)]| {
            numbers.push((format!("{prefix}s"), gap_m));
            numbers.extend((1..).zip(alpha_rad).map(|(k, alpha)| (format!("{prefix}alpha[{k}]"), *alpha)));
            numbers.extend(places.iter().map(|(name, at_m)| (format!("{prefix}{name}"), *at_m)));
        };
        match self {
            Self::Disc { gap_m, alpha_rad, .. } => bearing("", *gap_m, alpha_rad, &[]),
            Self::Shaft { geometry, magnets, planes_m } => {
                for (prefix, of) in SHAFT.iter().zip(&geometry.bearings) {
                    let places = [("position", of.position_m), ("sensorPosition", of.sensor_position_m)];
                    bearing(prefix, of.gap_m, &of.alpha_rad[..*magnets], &places);
                }
                numbers.extend((1..).zip(planes_m).map(|(n, at_m)| (format!("unbalance[{n}].position"), *at_m)));
            }
            Self::Axis { gap_m, .. } => bearing("X.", *gap_m, &[], &[]),
        }
        numbers
    }
}

impl Part {
    fn place(&self, prefix: &str, name: &str) -> usize {
        place(&self.parameters, prefix, name)
    }

    /// Index of κ, if it is a parameter.
    fn dynamics(&self) -> Option<usize> {
        self.settings.dynamics.then(|| self.place(self.body.prefix(), DYNAMICS))
    }

    /// Identifies this part of the motion.
    pub(super) fn identify(&self, recordings: &[Recording], options: &Options) -> Identified {
        let [coordinates, magnets, planes] = self.body.sizes();
        let (describe, varied) = match &self.body {
            Body::Disc { m_kg, gap_m, alpha_rad } => match *alpha_rad.as_slice() {
                [a, b, c] => self.one_bearing::<2, 3, 9>(*m_kg, *gap_m, [a, b, c]),
                [a, b, c, d] => self.one_bearing::<2, 4, 10>(*m_kg, *gap_m, [a, b, c, d]),
                _ => unreachable!("3 or 4 magnets to a bearing"),
            },
            Body::Axis { m_kg, gap_m } => self.one_bearing::<1, 2, 3>(*m_kg, *gap_m, [0.0; 2]),
            Body::Shaft { magnets: 3, geometry, planes_m } => self.shaft::<3, 6, 18>(geometry, planes_m),
            Body::Shaft { geometry, planes_m, .. } => self.shaft::<4, 8, 20>(geometry, planes_m),
        };
        let (parameters, load) = (&self.parameters, magnets + 2 * planes);
        let has_common_angle = recordings.len() == 1 || recordings.iter().all(|recording| recording.has_mark);
        let model = Model {
            part: self,
            options,
            describe,
            varied: varied.iter().map(|at| (*at, STEP * parameters[*at].typical)).collect(),
            places: Places::of(&self.body, parameters),
            layout: Layout {
                magnets,
                load,
                own: if has_common_angle { load } else { magnets },
                base: load + coordinates,
                all: load + coordinates + parameters.len(),
                dynamics: self.dynamics().map(|at| load + coordinates + at),
                commands: self.settings.lag,
            },
            passes: passes(coordinates, magnets),
        };
        search::identify(recordings, &model)
    }

    /// Description and the parameters that change it, for N coordinates, K magnets and U unknowns of the on-line estimator. An axis has no angles.
    fn one_bearing<const N: usize, const K: usize, const U: usize>(
        &self,
        m_kg: f64,
        gap_m: f64,
        alpha_rad: [f64; K],
    ) -> (Describe<'_>, Vec<usize>) {
        let [prefix] = *self.body.prefixes() else { unreachable!("one bearing") };
        let [mass, gap, iron] = ["m", "s", "gap.iron"].map(|name| self.place(prefix, name));
        let dynamics = self.dynamics();
        let angles = if N == 1 {
            0..0
        } else {
            let first = self.place(prefix, "alpha[1]");
            first..first + K
        };
        let varied = [mass, gap, iron].into_iter().chain(dynamics).chain(angles.clone()).collect();
        let describe = move |bench: &[f64]| {
            let mut alpha_rad = alpha_rad;
            alpha_rad.iter_mut().zip(&bench[angles.clone()]).for_each(|(alpha_rad, error)| *alpha_rad += error);
            let gap_m = gap_m * (1.0 + bench[gap]) + bench[iron];
            let m_kg = m_kg * (1.0 + bench[mass]) * dynamics.map_or(1.0, |at| 1.0 + bench[at]);
            let shaft = Shaft { m_kg, transverse_kgm2: 0.0, polar_kgm2: 0.0 };
            let alpha_rad = array::from_fn(|k| alpha_rad.get(k).copied().unwrap_or_default());
            let bearings = [BearingConfig { gap_m, alpha_rad, ..BearingConfig::default() }];
            let rotor = RotorConfig { shaft, extent_m: [0.0; 2], bearings };
            description(Machine::<N, K, U>::of(&rotor, [0.0; PLANES]))
        };
        (Box::new(describe), varied)
    }

    /// The same for M magnets in each of two radial bearings, K in both, and U unknowns of the on-line estimator.
    fn shaft<const M: usize, const K: usize, const U: usize>(
        &self,
        geometry: &RotorConfig<f64, 3>,
        planes_m: &[f64; PLANES],
    ) -> (Describe<'_>, Vec<usize>) {
        let (stated, planes_m) = (*geometry, *planes_m);
        let [mass, transverse, polar, plane] =
            ["m", "Jt", "Jp", "unbalance[1].position"].map(|name| self.place("", name));
        let of_bearings = SHAFT.map(|prefix| {
            ["s", "gap.iron", "alpha[1]", "position", "sensorPosition"].map(|name| self.place(prefix, name))
        });
        let varied = of_bearings.into_iter().flat_map(|[gap, iron, alpha, position, sensors]| {
            [gap, iron, position, sensors].into_iter().chain(alpha..alpha + M)
        });
        let dynamics = self.dynamics();
        let varied = varied.chain([mass, transverse, polar, plane, plane + 1]).chain(dynamics).collect();
        let describe = move |bench: &[f64]| {
            let (mut geometry, kappa) = (stated, dynamics.map_or(1.0, |at| 1.0 + bench[at]));
            let heavier = (1.0 + bench[mass]) * kappa;
            geometry.shaft.m_kg *= heavier;
            geometry.shaft.transverse_kgm2 *= heavier * (1.0 + bench[transverse]);
            geometry.shaft.polar_kgm2 *= heavier * (1.0 + bench[polar]);
            for ([gap, iron, alpha, position, sensors], bearing) in of_bearings.into_iter().zip(&mut geometry.bearings)
            {
                bearing.gap_m = bearing.gap_m * (1.0 + bench[gap]) + bench[iron];
                (0..M).for_each(|k| bearing.alpha_rad[k] += bench[alpha + k]);
                bearing.position_m += bench[position];
                bearing.sensor_position_m += bench[sensors];
            }
            let planes_m = array::from_fn(|n| planes_m[n] + bench[plane + n]);
            description(Machine::<4, K, U>::of(&geometry, planes_m))
        };
        (Box::new(describe), varied)
    }
}

/// Of a machine with sensors at different places.
fn description<const N: usize, const K: usize, const U: usize>(machine: Option<Machine<N, K, U>>) -> Description {
    Description::of(&machine.unwrap_or_else(|| unreachable!("sensors at different places")))
}
