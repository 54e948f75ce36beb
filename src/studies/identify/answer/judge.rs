//! Why estimates are not valid.

use super::words::{PARTS, called, together};
use crate::estimation::STD_LIMIT;
use crate::machine::Machine;
use crate::studies::identify::likelihood::{
    self, Change, Conditions, HARMONICS, Identification, Part, PartResults, Recording, SILENT_A, SILENT_M, Suspect,
};
use crate::studies::identify::{Stated, significant};
use crate::studies::statistics::range;

// The limits below cause no false alarms in good recordings (seeds 95001 and 101001): 600 of drawn bearings, 0.1 to 5 s, 1400 of the nominal
// bearing whose bench is off by its tolerances, and 1200 with its bench exactly as stated.

/// A bench parameter that the residuals call for makes the answer invalid if it would move a λ by more than this many stated
/// standard deviations.
const SUSPECTED: f64 = 3.0;
/// Relative standard deviation of a λ beyond which a longer recording is no remedy: for 5 % it would have to be a hundred times as long.
const NOT_KNOWN: f64 = 0.5;
/// Standard deviation of a current, relative to its mean, below which its force resembles a load: the force changes by less than 10 %.
const CONSTANT: f64 = 0.05;
/// Autocorrelation of the innovations at lag one beyond which the model does not describe the motion, unless chance explains it.
const COLOURED: f64 = 0.15;
/// Amplitude of a harmonic, relative to the noise of one innovation, beyond which it counts.
const HARMONIC: f64 = 0.3;
/// χ² of a harmonic, with two degrees of freedom: e⁻¹⁵ by chance.
const HARMONIC_CHI: f64 = 30.0;
/// Greatest plausible noise of the currents, relative to their rms.
const CURRENT_NOISE: f64 = 0.15;
/// A stated noise that differs from that of the data by this factor is wrong. The data correct smaller errors.
const WRONG_NOISE: f64 = 2.0;
/// Greatest plausible ratio of force constants of one bearing.
const RATIO: f64 = 10.0;

/// Why estimates from recordings cannot describe a magnetic bearing, if they cannot.
pub fn implausible(found: &Identification, all: &[Recording], machine: &Machine, parts: &[Part]) -> Option<String> {
    for (_, magnets) in machine.magnets_of_bearings() {
        let [least, greatest] = range(found.lambda[magnets.clone()].iter().map(|lambda| lambda.value));
        if let Some(k) = magnets.clone().find(|k| found.lambda[*k].value <= 0.0) {
            return Some(format!("{} would be negative: its magnet would push", machine.symbols("λ")[k]));
        }
        if greatest > RATIO * least {
            let factor = significant(greatest / least, 2);
            return Some(format!(
                "the force constants would differ by a factor of {factor}, as those of one bearing do not"
            ));
        }
    }
    let of_parts = found.conditions.iter().zip(all).flat_map(|(of, recording)| {
        of.parts.iter().zip(parts).map(|(conditions, part)| (conditions, recording.sizes(part)))
    });
    for (conditions, [current_rms, motion_rms]) in of_parts {
        if conditions.current_noise_a > CURRENT_NOISE * current_rms {
            let noise_a = conditions.current_noise_a;
            let [noise, percent] = [noise_a, 100.0 * noise_a / current_rms].map(|of| significant(of, 2));
            return Some(format!(
                "the errors of the forces correspond to current noise of {noise} A, {percent} % of the rms: the currents do not \
                 match the motion"
            ));
        }
        if motion_rms > 2e-6 && conditions.position_noise_m > 0.3 * motion_rms {
            let [noise, motion] = [conditions.position_noise_m, motion_rms].map(|of_m| significant(1e6 * of_m, 2));
            return Some(format!(
                "the positions would have noise of {noise} µm where the rotor moves by {motion} µm rms"
            ));
        }
    }
    None
}

/// Why a stated noise of the positions (0) or the currents (1) is wrong, if the data contradict it.
pub fn noise_differs(at: usize, of_data: f64, stated: f64) -> Option<String> {
    let (option, factor, unit) = [("--position-noise", 1e6, "µm"), ("--current-noise", 1e3, "mA")][at];
    let is_wrong = !(1.0 / WRONG_NOISE..=WRONG_NOISE).contains(&(of_data / stated));
    let [of_data, stated] = [of_data, stated].map(|value| significant(factor * value, 2));
    is_wrong.then(|| {
        format!("{option} is {stated} {unit}, but the noise of the data is {of_data} {unit}: leave the option out")
    })
}

/// Why a stated noise is wrong, and whether that of the data is smaller. With a noise stated four times too large, six of nine good recordings were valid,
/// three with errors of 5 to 7 standard deviations; if it is stated too small, the model may be wrong instead.
pub(super) fn wrong_noise(found: &Identification, stated: &Stated) -> Option<(String, bool)> {
    found.parts().find_map(|part| {
        let of_data = [part.position_noise_m, part.current_noise_a];
        (0..2)
            .filter(|at| stated.noise[*at] > 0.0)
            .find_map(|at| Some((noise_differs(at, of_data[at], stated.noise[at])?, of_data[at] < stated.noise[at])))
    })
}

/// Why the search or a force constant is too uncertain, and advice that holds if the description of the bench is right.
pub(super) fn uncertain(found: &Identification, all: &[Recording], stated: &Stated) -> Option<[String; 2]> {
    if !found.converged {
        let why = format!("the search did not converge in {} iterations", found.iterations);
        return Some([why, "the model does not describe these data, or too much was left free".into()]);
    }
    let relative = |k: usize| found.lambda[k].total_std / found.lambda[k].value.abs();
    let worst = (0..found.lambda.len()).max_by(|a, b| relative(*a).total_cmp(&relative(*b))).unwrap_or(0);
    let is_constant = |recording: &Recording| {
        let [mean, variance] = recording.spread(&recording.current_a[worst]);
        variance.sqrt() < CONSTANT * mean.abs()
    };
    (relative(worst).is_nan() || relative(worst) >= STD_LIMIT).then(|| {
        let wanted = match relative(worst) < NOT_KNOWN {
            true => "use a longer recording, a larger path, or better knowledge of the bench",
            false if all.iter().all(is_constant) => {
                "the current of its magnet hardly changes, so that its force looks like a load: state the load (--set pY=…), or vary \
                 that current by a larger path or a modulation"
            }
            false => "the model does not describe these data, or hardly anything excites the rotor",
        };
        let (names, percent, limit) =
            (stated.machine.symbols("λ"), significant(100.0 * relative(worst), 2), 100.0 * STD_LIMIT);
        [format!("{} is known to {percent} % only, the limit is {limit} %", names[worst]), wanted.into()]
    })
}

/// Why estimates that are certain enough are not valid.
pub fn judge(found: &Identification, all: &[Recording], machine: &Machine, parts: &[Part]) -> Option<String> {
    let names = machine.symbols("λ");
    if let Some(why) = implausible(found, all, machine, parts) {
        return Some(why);
    }
    let silent = is_silent(found);
    for of in &found.contradictions {
        if let Change::Drift(relative) = &of.what {
            let percent: Vec<String> = relative.iter().map(|of| significant(100.0 * of, 2)).collect();
            let (percent, part, recording) = (percent.join(", "), PARTS[of.part], of.recording + 1);
            return Some(format!(
                "the force constants or the sensors drift, λ by {percent} %{part} from the start to the end of recording {recording}"
            ));
        }
    }
    let differs = |suspect: &Suspect| {
        found.lambda.iter().enumerate().find_map(|(k, lambda)| {
            let shift = suspect.parameters.iter().map(|(j, value)| found.bench[*j].sensitivity[k] * value).sum::<f64>();
            let percent = || format!("{} would differ by {} %", names[k], significant(100.0 * shift.abs(), 2));
            (shift.abs() * lambda.value > SUSPECTED * lambda.total_std).then(percent)
        })
    };
    if let Some((suspect, differs)) =
        found.suspects.iter().filter(|_| !silent).find_map(|suspect| Some((suspect, differs(suspect)?)))
    {
        let ([most, _], [this, description]) = (called(found, &found.suspects[0]), called(found, suspect));
        let most = if most == this { String::new() } else { format!("most for {most}, then ") };
        return Some(format!("the residuals call {most}for {this} ({description}), and with it {differs}"));
    }
    let mut present = found.conditions.iter().filter(|_| !silent).flat_map(harmonics);
    if let Some((n, axis, amplitude)) = present.find(|(.., amplitude)| *amplitude > HARMONIC) {
        let (name, times) = (machine.readings[axis].axis, significant(amplitude, 2));
        return Some(format!(
            "the residuals of {name} contain harmonic {n} of the rotor, {times} times the noise: the model lacks a synchronous effect"
        ));
    }
    let is_exact = |of: &&PartResults| of.position_noise_m < SILENT_M && of.current_noise_a >= SILENT_A;
    if let Some(part) = found.parts().find(is_exact) {
        let noise_ma = significant(1e3 * part.current_noise_a, 2);
        return Some(format!(
            "the positions are exact, but the forces have errors like {noise_ma} mA of current noise: the bench is not as stated, or this is a \
             simulation whose positions need noise of some nanometres too"
        ));
    }
    let of_all = found.together.as_ref().filter(|_| !silent);
    if let Some((suspect, differs)) = of_all.and_then(|suspect| Some((suspect, differs(suspect)?))) {
        return Some(format!("{}, and with them {differs}: --tolerance all=typical", together(found, suspect)));
    }
    for conditions in &found.conditions {
        for (part, Part { body, .. }) in conditions.parts.iter().zip(parts) {
            let chance = 6.0 / ((body.coordinates() * part.rows) as f64).sqrt();
            if part.position_noise_m >= SILENT_M && part.correlation.abs() > COLOURED.max(chance) {
                let correlation = significant(part.correlation, 2);
                return Some(format!(
                    "the residuals are autocorrelated (neighbouring samples: {correlation}): the model misses some of the motion, \
                     or a filter of the sensors colours their noise"
                ));
            }
        }
    }
    None
}

/// The harmonics of the shaft in the residuals of a recording: number, axis, and amplitude relative to the noise of one innovation.
pub(super) fn harmonics(of: &Conditions) -> Vec<(usize, usize, f64)> {
    let each = (0..HARMONICS).flat_map(|n| (0..of.harmonics.len()).map(move |axis| (n, axis)));
    let present = each.filter(|(n, axis)| of.harmonics[*axis][*n] > HARMONIC_CHI);
    present.map(|(n, axis)| (n + 1, axis, of.amplitudes[axis][n])).collect()
}

/// Whether the noise is below that of any sensor.
pub(super) fn is_silent(found: &Identification) -> bool {
    found.parts().all(|part| likelihood::is_silent(part.position_noise_m, part.current_noise_a))
}
