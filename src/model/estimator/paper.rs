//! The paper's estimate, P(19) and P(20): Cramer's rule on the z axis, numerators and determinant filtered apart.
//!
//! Every row is divided by its gain for white position noise, so that a row carries metres and every row the same noise; the
//! column of `λ_k` is multiplied by `λ_0,k`, so that the unknowns are `λ_k/λ_0,k`. Normal equations of both axes are
//! filtered along to judge the result.

use nalgebra::{SMatrix, SVector};

use super::config::{
    CHANNEL_LIMIT, CONDITION_LIMIT, EXCITATION_FLOOR, EstimatorOutput, MODEL_STD, Method, PAPER_STD_LIMIT,
    PAPER_WINDOWS, RESIDUAL_CAP, RESIDUAL_LIMIT, Reason, STD_CAP,
};
use super::{Estimator, EstimatorState, MAGNETS, is_round, shape};
use crate::model::kernel::ROWS_PER_AXIS;
use crate::model::regression::{Equations, NormalMatrix, NormalVector};
use crate::model::window::{Integrals, KERNELS, Sample, WindowSums};

/// The low-passed quantities: normal equations and the ratio of P(20).
type Channels = SVector<f64, CHANNELS>;

const ROWS: usize = 2 * ROWS_PER_AXIS;

/// Upper triangle of DᵀD.
const NORMAL: usize = MAGNETS * (MAGNETS + 1) / 2;

/// DᵀN follows.
const RIGHT: usize = NORMAL;

/// |N|² follows.
const SQUARE: usize = RIGHT + MAGNETS;

/// n_1, n_2, n_3, d of P(20) follow, signs aligned or not as the method says.
const RATIO: usize = SQUARE + 1;

/// The squares of what each column of D would be if nothing cancelled follow.
const LEVEL: usize = RATIO + MAGNETS + 1;

/// `|N_y|² − |N_z|²` and `2 N_y·N_z` follow.
const SHAPE: usize = LEVEL + MAGNETS;

pub(super) const CHANNELS: usize = SHAPE + 2;

impl Estimator {
    /// Takes in one sample; what comes of it, or why the window has to start afresh.
    pub(super) fn filter(
        &self,
        state: &mut EstimatorState,
        sums: &WindowSums,
        sample: &Sample,
    ) -> Result<Reason, Reason> {
        state.filled = state.filled.saturating_add(1);
        state.samples = state.samples.saturating_add(1);
        let integrals = state.sums.as_mut().and_then(|state| sums.push(state, sample));
        let Some(integrals) = integrals.filter(|_| state.samples >= self.samples_until_epsilon) else {
            return Ok(Reason::Filling);
        };
        let channels = self.channels(state, &integrals, &sample.squares[0]);
        // Written so that a NaN fails as well.
        if !channels.iter().all(|x| x.abs() < CHANNEL_LIMIT) {
            return Err(Reason::BadSample);
        }
        self.low_pass.step(&mut state.filtered, &channels);
        self.window_alone(&mut state.output, &channels);
        Ok(self.estimate(state, &integrals[ROWS_PER_AXIS]))
    }

    /// What the present window contributes to the filtered quantities.
    fn channels(
        &self,
        state: &mut EstimatorState,
        integrals: &[Integrals; KERNELS],
        squares: &[f64; MAGNETS],
    ) -> Channels {
        let mut d = SMatrix::<f64, ROWS, MAGNETS>::zeros();
        let mut n = SVector::<f64, ROWS>::zeros();
        for (row, (integrals, scale)) in integrals.iter().zip(self.row_scale).enumerate() {
            for (axis, values) in self.row_pair(integrals).iter().enumerate() {
                let at = axis * ROWS_PER_AXIS + row;
                n[at] = scale * integrals.position[axis];
                for (k, value) in values.iter().enumerate().take(MAGNETS) {
                    d[(at, k)] = scale * value;
                }
            }
        }

        let dz = d.fixed_view::<3, 3>(ROWS_PER_AXIS, 0).into_owned();
        let nz = n.fixed_rows::<3>(ROWS_PER_AXIS).into_owned();
        let determinant = dz.determinant();
        let sign = if self.config.method == Method::Paper && determinant < 0.0 { -1.0 } else { 1.0 };
        let mut channels = Channels::zeros();
        for k in 0..MAGNETS {
            let mut with_n = dz;
            with_n.set_column(k, &nz);
            channels[RATIO + k] = sign * with_n.determinant();
        }
        channels[RATIO + MAGNETS] = sign * determinant;
        if determinant.is_finite() {
            state.output.determinant = determinant;
        }

        // The paper solves the rows of the z axis; those of both axes judge the result.
        let p = d.tr_mul(&d);
        let h = d.tr_mul(&n);
        for (channel, (row, column)) in upper_triangle().enumerate() {
            channels[channel] = p[(row, column)];
        }
        channels.fixed_rows_mut::<MAGNETS>(RIGHT).copy_from(&h);
        channels[SQUARE] = n.norm_squared();
        let [shape_0, shape_1] = shape(&n.as_slice()[..ROWS_PER_AXIS], &n.as_slice()[ROWS_PER_AXIS..]);
        channels[SHAPE] = shape_0;
        channels[SHAPE + 1] = shape_1;
        for k in 0..MAGNETS {
            let level = squares[k] * self.reach[k];
            channels[LEVEL + k] = level * level;
        }
        channels
    }

    /// P(19): the estimate from the present window, which the output keeps if there is one.
    fn window_alone(&self, output: &mut EstimatorOutput, channels: &Channels) {
        let lambda = self.lambda(ratio(channels));
        if lambda.iter().all(|l| l.is_finite()) {
            output.lambda_raw = lambda;
        }
    }

    /// The paper's estimate from the filtered quantities.
    fn estimate(&self, state: &mut EstimatorState, static_load: &Integrals) -> Reason {
        let filtered = &state.filtered.value;
        let output = &mut state.output;
        let p = normal(filtered);
        let equations = Equations::new(&p, MAGNETS);
        output.condition = equations.condition();
        let inverse = equations.inverse();
        let excited = (0..MAGNETS).all(|k| p[(k, k)] > EXCITATION_FLOOR * EXCITATION_FLOOR * filtered[LEVEL + k]);
        let literal = self.config.method == Method::PaperLiteral;
        let scaled = ratio(filtered);
        let lambda = self.lambda(scaled);
        if !scaled.iter().chain(&lambda).all(|x| x.is_finite()) {
            return Reason::Singular;
        }
        let mut unknowns = NormalVector::zeros();
        unknowns.fixed_rows_mut::<MAGNETS>(0).copy_from_slice(&scaled);
        output.residual = residual(filtered, &unknowns);
        // Whatever is left unexplained counts as one coherent error, for it may be: no averaging over windows.
        let rest = output.residual * output.residual * filtered[SQUARE];
        for k in 0..MAGNETS {
            let spread = inverse.map_or(f64::INFINITY, |inverse| (inverse[(k, k)].max(0.0) * rest).sqrt());
            let std = (spread * spread + (MODEL_STD * scaled[k]) * (MODEL_STD * scaled[k])).sqrt();
            output.lambda_std[k] = self.config.lambda0_nm2_a2[k] * if std < STD_CAP { std } else { STD_CAP };
        }
        if literal {
            output.lambda_hat = lambda;
        }
        if !excited
            || output.condition > CONDITION_LIMIT
            || is_round([filtered[SHAPE], filtered[SHAPE + 1]], filtered[SQUARE])
        {
            return Reason::Singular;
        }
        if !lambda.iter().all(|l| *l > 0.0) {
            return Reason::NotPositive;
        }
        if !literal && output.residual > RESIDUAL_LIMIT {
            return Reason::Unexplained;
        }
        let few = state.samples <= PAPER_WINDOWS * self.intervals as u64;
        if few || (0..MAGNETS).any(|k| output.lambda_std[k] > PAPER_STD_LIMIT * lambda[k]) {
            return Reason::Uncertain;
        }
        output.lambda_hat = lambda;
        self.report(output, static_load, &unknowns);
        Reason::Valid
    }
}

/// Row and column of the upper triangle, in the order of the channels.
fn upper_triangle() -> impl Iterator<Item = (usize, usize)> {
    (0..MAGNETS).flat_map(|row| (row..MAGNETS).map(move |column| (row, column)))
}

/// DᵀD out of the channels.
fn normal(channels: &Channels) -> NormalMatrix {
    let mut p = NormalMatrix::zeros();
    for (channel, (row, column)) in upper_triangle().enumerate() {
        p[(row, column)] = channels[channel];
        p[(column, row)] = channels[channel];
    }
    p
}

/// `n_i/d`, scaled unknowns; not finite where d is zero.
fn ratio(channels: &Channels) -> [f64; 3] {
    std::array::from_fn(|k| channels[RATIO + k] / channels[RATIO + MAGNETS])
}

/// `√(F(|N − D x|²)/F(|N|²))`, between 0 and [`RESIDUAL_CAP`], 1 without motion.
fn residual(channels: &Channels, x: &NormalVector) -> f64 {
    let mut h = NormalVector::zeros();
    h.fixed_rows_mut::<MAGNETS>(0).copy_from(&channels.fixed_rows::<MAGNETS>(RIGHT));
    let square = channels[SQUARE];
    let rest = square - 2.0 * x.dot(&h) + x.dot(&(normal(channels) * x));
    let residual = (rest.max(0.0) / square).sqrt();
    if square.is_nan() || square <= 0.0 {
        1.0
    } else if residual.is_finite() {
        residual.min(RESIDUAL_CAP)
    } else {
        RESIDUAL_CAP
    }
}
