//! A machine's motion as independent parts, each with its own filter and sums, and the sizes of all machines.
//!
//! Radial magnets do not pull along the shaft, axial ones not across it: the axial motion of a shaft with both kinds of bearings is a separate part. All
//! other machines have one part.

use libm::{atan2, sqrt};

use super::paper::Paper;
use super::planar::Planar;
use super::prediction_error::{PredictionError, PredictionErrorState};
use super::{
    Body, CheckedSample, Estimation, EstimatorConfigOf, EstimatorOutputOf, Method, Names, Sample, SampleStatus, Verdict,
};
use crate::bearing::{RotorConfig, array};
use crate::invalid::{Checks, Invalid};
use crate::variables::Saved;

/// Implements [`Body`] for the sizes of a machine: coordinates, magnets, bearings, results per part, plane or radial bearing.
macro_rules! of_sizes {
    ($n:literal, $k:literal, $b:literal, $p:literal, $check:ident, $method:ty, |$config:ident| $make:expr) => {
        impl Body<$n, $k, $p> for RotorConfig<f64, $b> {
            type Method = $method;

            fn method($config: &EstimatorConfigOf<Self, $k>) -> Result<$method, Vec<Invalid>> {
                Checks::described($config, Names::of::<$n, $k>(), |checks| $config.$check::<$n>(checks))?;
                Ok($make)
            }
        }
    };
}

// Coordinates, magnets, bearings, results; for the first part: coordinates, magnets, unknowns and columns of tolerances.
of_sizes!(2, 3, 1, 1, check_bearing, Planar, |config| match config.method {
    Method::PredictionError => Planar::PredictionError(config.parts()),
    Method::Paper | Method::PaperLiteral => Planar::Paper(Paper::new(config)),
});
of_sizes!(2, 4, 1, 1, check_bearing, Parts<2, 4, 10, 13>, |config| config.parts());
of_sizes!(1, 2, 1, 1, check_bearing, Parts<1, 2, 3, 5>, |config| config.parts());
of_sizes!(5, 8, 3, 2, check_shaft, Parts<4, 6, 18, 29>, |config| config.parts());
of_sizes!(5, 10, 3, 2, check_shaft, Parts<4, 8, 20, 33>, |config| config.parts());
of_sizes!(4, 6, 2, 2, check_shaft, Parts<4, 6, 18, 29>, |config| config.parts());

/// The motion with R coordinates and K magnets, and the axial one if that is a separate part.
#[derive(Clone, Debug, PartialEq)]
pub struct Parts<const R: usize, const K: usize, const U: usize, const T: usize> {
    pub first: PredictionError<R, K, U, T>,
    pub axial: Option<PredictionError<1, 2, 3, 5>>,
}

/// State between samples.
pub type PartsState<const R: usize, const K: usize, const U: usize, const T: usize> =
    (Box<PredictionErrorState<R, K, U, T>>, Option<Box<PredictionErrorState<1, 2, 3, 5>>>);

impl<const N: usize, const A: usize, const P: usize, const R: usize, const K: usize, const U: usize, const T: usize>
    Estimation<N, A, P> for Parts<R, K, U, T>
where
    PredictionErrorState<R, K, U, T>: Saved,
{
    type State = PartsState<R, K, U, T>;

    fn start(&self) -> Self::State {
        (Box::new(self.first.start()), self.axial.as_ref().map(|axial| Box::new(axial.start())))
    }

    fn has_shape(&self, (first, axial): &Self::State) -> bool {
        let same_parts = axial.is_some() == self.axial.is_some();
        same_parts && first.has_shape() && axial.as_ref().is_none_or(|axial| axial.has_shape())
    }

    fn is_in_gap(&self, position_m: [f64; N]) -> bool {
        self.first.is_in_gap(array::from_fn(|n| position_m[n]))
            && self.axial.as_ref().is_none_or(|axial| axial.is_in_gap([position_m[N - 1]]))
    }

    fn advance(
        &self,
        (first, axial): &mut Self::State,
        sample: &CheckedSample<'_, N, A>,
        output: &mut EstimatorOutputOf<N, A, P>,
    ) -> [Verdict; P] {
        // Axial magnets and reading come last, the axial load first.
        let mut verdicts = [sample.advance(&self.first, first, output, 0, [0, 0, N - R]); P];
        if let (Some(method), Some(axial)) = (&self.axial, axial) {
            verdicts[1] = sample.advance(method, axial, output, 1, [R, K, 0]);
        }
        verdicts
    }
}

impl<const N: usize, const A: usize> CheckedSample<'_, N, A> {
    /// Updates the part whose readings, magnets and loads begin at these indices, writes its estimate to the output and returns the verdict.
    fn advance<const R: usize, const K: usize, const U: usize, const T: usize, const P: usize>(
        &self,
        method: &PredictionError<R, K, U, T>,
        state: &mut PredictionErrorState<R, K, U, T>,
        output: &mut EstimatorOutputOf<N, A, P>,
        part: usize,
        [reading, magnet, load]: [usize; 3],
    ) -> Verdict {
        let rejection = self.rejection(reading..reading + R, state.estimate.verdict);
        // The samples so far have a wrong angle, or one that had not settled.
        let is_usable = matches!(self.status, SampleStatus::Usable { .. });
        let resets = is_usable && matches!(rejection, Some(Verdict::Speed | Verdict::Collecting));
        let verdict = method.step(state, rejection, resets, || {
            let position_m = array::from_fn(|n| self.input.position_m[reading + n]);
            let current_a = array::from_fn(|k| self.input.current_a[magnet + k]);
            Sample::new(position_m, current_a, self.rotation)
        });
        let estimate = &state.estimate;
        let [noise, total] = estimate.variance.map(|variance| variance.map(sqrt));
        for k in 0..K {
            output.lambda_hat[magnet + k] = estimate.unknowns[k];
            output.lambda_raw[magnet + k] = estimate.lambda_raw[k];
            (output.lambda_std[magnet + k], output.lambda_std_total[magnet + k]) = (noise[k], total[k]);
            (output.ki[magnet + k], output.ks[magnet + k]) = (estimate.ki[k], estimate.ks[k]);
        }
        [output.position_noise_m[part], output.current_noise_a[part]] = estimate.noise;
        // The worst of all parts.
        let worst = |so_far: f64, own: f64| if part == 0 { own } else { so_far.max(own) };
        output.condition = worst(output.condition, estimate.condition);
        output.residual = worst(output.residual, estimate.residual);
        let (unknowns, backward, loads) = (&estimate.unknowns, method.filter.machine.backward, U - R);
        for n in 0..R {
            output.load_n[load + n] = unknowns[loads + n];
        }
        if verdict == Verdict::Valid {
            for plane in (0..(backward - K) / 2).filter(|_| method.filter.identify_unbalance) {
                let [x, y] = [0, 1].map(|part| unknowns[K + 2 * plane + part]);
                [output.unbalance_kg_m[plane], output.unbalance_phase_rad[plane]] = polar(x, y);
            }
            for bearing in 0..(loads - backward) / 2 {
                let [x, y] = [0, 1].map(|part| unknowns[backward + 2 * bearing + part]);
                [output.backward_force_n[bearing], output.backward_force_phase_rad[bearing]] = polar(x, -y);
            }
        }
        verdict
    }
}

/// Magnitude and phase, rad in (−π, π].
fn polar(x: f64, y: f64) -> [f64; 2] {
    [sqrt(x * x + y * y), atan2(y, x)]
}
