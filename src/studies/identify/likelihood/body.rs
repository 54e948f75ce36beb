//! The moving bodies: a rotor in one radial bearing, a shaft in radial motion, an axis.

use super::bench::Places;
use super::filter::Passes;
use super::rotor::{Layout, Model};
use super::search;
use super::{Identified, Options, Part, Recording};
use crate::bearing::{BearingConfig, RotorConfig};
use crate::machine::Bearing;
use crate::plant::PLANES;

/// A body with its magnets, as stated on the data sheet: a rotor in one radial bearing, a shaft in two, or a rotor that moves along its axis.
#[derive(Clone, Debug)]
pub struct Body {
    /// Its bearings, with the same number of magnets each.
    pub bearings: &'static [Bearing],
    /// Inertia and geometry; only as many bearings count as there are.
    pub rotor: RotorConfig<f64, 2>,
    /// Positions of the unbalance planes of a shaft, m from the centre of gravity.
    pub planes_m: [f64; PLANES],
}

impl Body {
    /// Whether it moves along its axis, not across.
    pub(in crate::studies::identify) fn is_axis(&self) -> bool {
        !self.bearings[0].is_radial
    }

    /// Whether it is a shaft, which tilts.
    pub(in crate::studies::identify) fn is_shaft(&self) -> bool {
        self.bearings.len() > 1
    }

    /// Prefix of parameters of the whole body: the axial motion has a mass and a delay of its own.
    pub(in crate::studies::identify) fn prefix(&self) -> &'static str {
        if self.is_axis() { self.bearings[0].prefix } else { "" }
    }

    /// Number of planes of unbalance.
    pub(super) fn planes(&self) -> usize {
        self.coordinates() / 2
    }

    /// Number of coordinates, one per position sensor.
    #[must_use]
    pub fn coordinates(&self) -> usize {
        self.bearings.iter().map(Bearing::directions).sum()
    }

    /// Number of magnets.
    #[must_use]
    pub fn magnets(&self) -> usize {
        self.bearings.iter().map(|bearing| bearing.magnets).sum()
    }

    /// Mass, kg.
    #[must_use]
    pub fn m_kg(&self) -> f64 {
        self.rotor.shaft.m_kg
    }

    /// Nominal gap of the magnets (first radial bearing of a shaft), m.
    #[must_use]
    pub fn gap_m(&self) -> f64 {
        self.rotor.bearings[0].gap_m
    }

    /// Gap of a magnet at these sensor readings, m, as if the sensors were at the magnets.
    pub(in crate::studies::identify) fn gap_at(&self, k: usize, position_m: impl Fn(usize) -> f64) -> f64 {
        let magnets = self.bearings[0].magnets;
        let (b, number) = (k / magnets, k % magnets);
        let BearingConfig { gap_m, alpha_rad, .. } = self.rotor.bearings[b];
        if self.is_axis() {
            return gap_m + if number == 0 { -position_m(0) } else { position_m(0) };
        }
        let (sin, cos) = libm::sincos(alpha_rad[number]);
        gap_m - sin * position_m(2 * b) - cos * position_m(2 * b + 1)
    }

    /// Stated values by name.
    pub(in crate::studies::identify) fn numbers(&self) -> Vec<(String, f64)> {
        let RotorConfig { shaft, bearings, .. } = &self.rotor;
        let mut numbers = vec![("m".to_owned(), shaft.m_kg)];
        if self.is_shaft() {
            numbers.push(("Jt".into(), shaft.transverse_kgm2));
            numbers.push(("Jp".into(), shaft.polar_kgm2));
        }
        for (of, bearing) in self.bearings.iter().zip(bearings) {
            let mut put = |name: &str, value: f64| numbers.push((format!("{}{name}", of.prefix), value));
            put("s", bearing.gap_m);
            for (k, alpha_rad) in (1..).zip(&bearing.alpha_rad[..of.if_radial() * of.magnets]) {
                put(&format!("alpha[{k}]"), *alpha_rad);
            }
            if self.is_shaft() {
                put("position", bearing.position_m);
                put("sensorPosition", bearing.sensor_position_m);
            }
        }
        let planes_m = (1..).zip(self.planes_m).filter(|_| self.is_shaft());
        numbers.extend(planes_m.map(|(n, at_m)| (format!("unbalance[{n}].position"), at_m)));
        numbers
    }
}

impl Part {
    /// Identifies this part of the motion.
    pub(super) fn identify(&self, recordings: &[Recording], options: &Options) -> Identified {
        let Self { body, parameters, .. } = self;
        let (coordinates, magnets) = (body.coordinates(), body.magnets());
        let (load, places) = (magnets + 2 * body.planes(), Places::of(body, parameters));
        let has_common_angle = recordings.len() == 1 || recordings.iter().all(|recording| recording.has_mark);
        let model = Model {
            part: self,
            options,
            layout: Layout {
                magnets,
                load,
                own: if has_common_angle { load } else { magnets },
                base: load + coordinates,
                all: load + coordinates + parameters.len(),
                dynamics: places.dynamics.map(|at| load + coordinates + at),
                commands: self.settings.lag,
            },
            places,
            passes: Passes::of(coordinates, magnets),
        };
        search::identify(recordings, &model)
    }
}
