//! Lagrange multiplier tests of the bench parameters that are not estimated, at the maximum of the likelihood.

use nalgebra::{DMatrix, DVector};

use super::super::bench::{IRON, Sensors};
use super::super::filter::Block;
use super::super::solve::{self, submatrix};
use super::super::{Failed, Suspect, plain};
use super::Search;
use super::finish::inverse;

/// χ² with one degree of freedom above which a bench parameter is a suspect; chance exceeds it with a probability of 8 · 10⁻⁶.
const SUSPECT: f64 = 20.0;
/// Quantile of the normal distribution that chance exceeds with this probability, for χ² of all parameters together.
const QUANTILE: f64 = 4.31;

/// Scores of the bench parameters at their stated values and the information on them, in units of their typical tolerances.
pub struct Test {
    score: DVector<f64>,
    pub information: DMatrix<f64>,
    /// Change of the force constants with them.
    response: DMatrix<f64>,
}

impl Test {
    /// From sums over all columns and the estimated unknowns.
    pub fn of(search: &Search<'_>, blocks: &[Block], of: &[usize]) -> Result<Self, Failed> {
        let parameters = &search.model.part.parameters;
        let own: Vec<usize> = (0..parameters.len()).map(|j| search.model.layout.own + j).collect();
        let scale = DMatrix::from_diagonal(&DVector::from_iterator(own.len(), parameters.iter().map(|of| of.typical)));
        let normal = search.normal(blocks);
        let (a, b) = search.equations(&normal, of);
        let cross = submatrix(&normal.j, of, &own) * &scale;
        let response = inverse(&a)? * &cross;
        let all = &scale * submatrix(&normal.j, &own, &own) * &scale;
        let mut score = &scale * normal.b.select_rows(&own) - response.transpose() * b;
        let mut information = &all - cross.transpose() * &response;
        for j in 0..own.len() {
            // A parameter that the other unknowns reproduce up to rounding cannot be suspected.
            if information[(j, j)] <= 1e-9 * all[(j, j)] {
                score[j] = 0.0;
                information.row_mut(j).fill(0.0);
                information.column_mut(j).fill(0.0);
            }
        }
        // By so much the data tell less than the model says.
        let [nis, count] =
            [|of: &Block| of.nis, |of: &Block| of.count].map(|part| blocks.iter().map(part).sum::<f64>());
        let excess = (nis / (search.coordinates() as f64 * count)).max(1.0);
        let response = -response.rows(0, search.model.layout.magnets);
        Ok(Self { score: score / excess, information: information / excess, response })
    }

    /// The parameters that the residuals call for one at a time, and the gain of each position sensor of a pair, those first that explain most with the
    /// tolerances of a typical bench; and all together with these tolerances.
    pub fn suspects(&self, search: &Search<'_>) -> (Vec<Suspect>, Option<Suspect>) {
        let parameters = &search.model.part.parameters;
        let estimated = search.estimated();
        let is_open = |j: &usize| !estimated.contains(&(search.model.layout.own + j));
        let suspect = |direction: Vec<(usize, f64)>| {
            let sum = |of: &dyn Fn(usize) -> f64| direction.iter().map(|(j, part)| part * of(*j)).sum::<f64>();
            let score = sum(&|j| self.score[j]);
            let own = sum(&|j| sum(&|l| self.information[(j, l)]));
            let value = score / own;
            let is_negative_path = value < 0.0 && plain(&parameters[direction[0].0].name) == IRON;
            let is_suspect = score * value > SUSPECT && direction.iter().all(|(j, _)| is_open(j)) && !is_negative_path;
            let prior: f64 = direction.iter().map(|(_, part)| part * part).sum();
            is_suspect.then(|| Suspect {
                std: parameters[direction[0].0].typical / own.sqrt(),
                // A gap and an iron path are the same in the model: rounding must not decide which is named first.
                chi_square: f64::from((score * score / (own + prior)) as f32),
                parameters: direction.iter().map(|(j, part)| (*j, part * value * parameters[*j].typical)).collect(),
            })
        };
        let single = (0..parameters.len()).map(|j| vec![(j, 1.0)]);
        let sensor = |of: &Sensors| [1.0, -1.0].map(|sign| vec![(of.gain, 1.0), (of.gain_difference, sign)]);
        let directions = single.chain(search.model.places.pairs.iter().flat_map(sensor));
        let mut suspects: Vec<Suspect> = directions.filter_map(suspect).collect();
        suspects.sort_by(|a, b| b.chi_square.total_cmp(&a.chi_square));
        let open: Vec<usize> = (0..parameters.len()).filter(is_open).collect();
        (suspects, self.together(&open, search))
    }

    /// Covariance of these parameters if they have the tolerances of a typical bench.
    fn covariance(&self, of: &[usize]) -> Option<DMatrix<f64>> {
        solve::inverse(&(submatrix(&self.information, of, of) + DMatrix::identity(of.len(), of.len())))
    }

    /// By how much the variance of each λ grows if all parameters that are stated as exact have the tolerances of a typical bench.
    pub fn typical_variance(&self, search: &Search<'_>) -> Vec<f64> {
        let parameters = search.model.part.parameters.iter().enumerate();
        let exact: Vec<usize> = parameters.filter(|(_, of)| !of.is_uncertain()).map(|(j, _)| j).collect();
        let response = self.response.select_columns(&exact);
        let added = self.covariance(&exact).map(|covariance| &response * covariance * response.transpose());
        (0..response.nrows()).map(|k| added.as_ref().map_or(f64::NAN, |added| added[(k, k)])).collect()
    }

    /// These parameters with the tolerances of a typical bench, if χ² is larger than by chance.
    fn together(&self, of: &[usize], search: &Search<'_>) -> Option<Suspect> {
        let covariance = self.covariance(of)?;
        let score = self.score.select_rows(of);
        let step = &covariance * &score;
        let chi_square = step.dot(&score);
        // A weighted sum of squares of standard normal variables, like a multiple of χ² with ν degrees of freedom (Satterthwaite 1946), whose third root
        // is almost normal (Wilson and Hilferty 1931).
        let weights = DMatrix::identity(of.len(), of.len()) - covariance;
        let mean = weights.trace();
        let variance = 2.0 / 9.0 * weights.norm_squared() / (mean * mean);
        let by_chance = mean * (1.0 - variance + QUANTILE * variance.sqrt()).powi(3);
        let value = |(j, step): (&usize, &f64)| (*j, step * search.model.part.parameters[*j].typical);
        let parameters = || of.iter().zip(step.iter()).map(value).collect();
        (chi_square > by_chance).then(|| Suspect { parameters: parameters(), std: f64::NAN, chi_square })
    }
}
