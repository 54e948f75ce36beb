//! The answer from whole recordings: maximum likelihood, its validity, and findings if it is not valid.

mod judge;
mod recorded;
mod restored;
mod shown;
mod words;

use nalgebra::DVector;

pub(super) use self::judge::{implausible, judge, noise_differs};
use self::judge::{uncertain, wrong_noise};
pub(super) use self::recorded::{read_as, recording};
pub(super) use self::shown::shown;
pub(super) use self::words::{constant_currents, dynamics_remark};
use super::agreement::{Check, Own, disagreement, marked_speed, other_unbalance, sentence};
use super::diagnosis::{self, Proposals, Trial};
use super::likelihood::{
    self, Change, DELAY, Estimate, Failed, Hold, Identification, Identified, Knowledge, Options, Recording,
};
use super::samples::{Rotation, Samples};
use super::tolerance::plain;
use super::units::significant;
use super::{GRAVITY_M_S2, Holds, Stated};
use crate::estimation::{STD_LIMIT, VERY_STRONG};
use crate::studies::parallel::in_order;

/// Minimum number of turns of a recording, with noise known or estimated (as on line). Of 600 good recordings of drawn bearings,
/// 0.1 to 5 s, nine have fewer (seeds 95001 and 101001).
const TURNS: [f64; 2] = [1.3, 2.0];
/// A force that wanders by more in a second, in weights of the rotor, is not a slow force: the law fits badly.
const SLOW_FORCE: f64 = 0.015;
/// A motion whose speed differs from that of the shaft by more, relative, is a trajectory with its own speed.
const OTHER_SPEED: f64 = 0.05;
/// Error of the angle, in rad, that changes a synchronous force by a tenth.
const TURNED_RAD: f64 = 0.1;

/// Note for a ± that is too small.
const NOT_COMPARED: &str =
    "± does not contain by how much λ would differ with another reading of the currents: no other search converged.";

const NO_ROTATION: &str =
    "neither angle nor speed was recorded: give --speed RPM, 0 at rest, or assign a column (--column theta=…)";

/// The question that recordings shall answer.
#[derive(Clone, Debug)]
pub struct Question {
    /// The bearing and its sensors, with prior knowledge of the bench.
    pub stated: Stated,
    /// The meanings of the current samples, if they were compared.
    pub holds: Option<Holds>,
    /// Other meanings that are as likely, if none is stated.
    pub equally_likely: Vec<Hold>,
    /// Whether a slow force is estimated; if this is not stated, the likelihood decides.
    pub slow_force: Option<bool>,
}

/// The answer from recordings.
#[derive(Clone, Debug)]
pub struct Answer {
    /// Whether the estimates are valid.
    pub valid: bool,
    /// The reason, in a sentence.
    pub verdict: String,
    /// Further findings, in sentences; if the answer is not valid, alternatives that would fit.
    pub findings: Vec<String>,
    /// The estimates, if any.
    pub found: Option<Identification>,
    /// The question.
    pub question: Question,
}

/// An identification and its validity.
struct Judged {
    question: Question,
    options: Options,
    /// The estimates, if any, even if the search did not converge.
    found: Option<Identification>,
    refusal: Option<Refusal>,
    /// Remarks on the identification itself.
    notes: Vec<String>,
}

/// Why estimates are not valid, and which findings are added.
struct Refusal {
    why: String,
    /// Advice if no other description explains the data; may be empty.
    advice: String,
    details: Details,
}

/// Findings that are added to estimates that are not valid.
#[derive(PartialEq)]
enum Details {
    Nothing,
    /// Findings from the estimates.
    Findings,
    /// These, and alternatives that would fit.
    Proposals,
}

/// Identifies from all recordings together.
pub fn answer(recordings: &[Samples], question: Question) -> Answer {
    if recordings.iter().any(|samples| samples.rotation == Rotation::Unknown) {
        let verdict = format!("Not valid: {NO_ROTATION}.");
        let finding = "The unbalance, which turns with the rotor, is not known then, and with it neither force constants, ki and ks nor the \
                       load.";
        return Answer { valid: false, verdict, findings: vec![finding.into()], found: None, question };
    }
    let stated = question.stated.clone();
    let all: Vec<Recording> = recordings.iter().map(|samples| recording(samples, &stated, stated.hold)).collect();
    let other = |hold: Hold| -> Vec<Recording> {
        all.iter().zip(recordings).map(|(of, samples)| read_as(of, samples, &stated, hold)).collect()
    };
    let equally_likely: Vec<_> = question.equally_likely.iter().map(|hold| (other(*hold), true)).collect();
    let mut judged = identify_and_judge(&all, &equally_likely, question);
    let judged = with_delay(other, &all, &mut judged).unwrap_or(judged);
    let mut of_each = recordings.iter().zip(&all).rev();
    let wrong_speed = of_each.find_map(|(samples, recording)| wrong_speed(samples, recording, &judged));
    let answer = worded(judged, &all, wrong_speed.is_some());
    match wrong_speed {
        Some(verdict) => Answer { valid: false, verdict, ..answer },
        None => answer,
    }
}

/// The verdict on a speed without a recorded angle, if that of the motion differs by less than [`OTHER_SPEED`], significantly, and by enough to matter.
fn wrong_speed(samples: &Samples, recording: &Recording, judged: &Judged) -> Option<String> {
    if samples.rotation.has_mark() {
        return None;
    }
    let [off, std, angle_rad] = diagnosis::drift(recording)?;
    let matters = off.abs() > 5.0 * std && off.abs() < OTHER_SPEED && angle_rad.abs() > TURNED_RAD;
    let (recording, options, machine) = (recording.clone(), judged.options.clone(), judged.question.stated.machine);
    if !matters || !diagnosis::may_be_faster(&Trial { recording, options, machine, bearing: 0 }, off) {
        return None;
    }
    let speed = if samples.rotation == Rotation::Stated { "stated" } else { "recorded" };
    let by = if off > 0.0 { "faster" } else { "slower" };
    let percent = significant(100.0 * off.abs(), 2);
    Some(format!(
        "Not valid: the motion turns {percent} % {by} than the {speed} speed: --speed, or a column of the angle."
    ))
}

/// Leaves out the rows that are inconsistent with the others.
fn leave_out(recordings: &mut [Recording], found: &Identification) {
    let left_out = found.contradictions.iter().filter(|of| !matches!(of.what, Change::Drift(_)));
    left_out.for_each(|of| recordings[of.recording].usable[of.rows.clone()].fill(false));
}

/// Advice where a delay that may be there makes λ uncertain.
const DELAY_ADVICE: &str = "positions and currents may be of different times: state by how much (--tolerance delay=…)";

/// Longest delay that is accepted without being requested, relative to that of a typical bench.
const LONGEST_DELAY: f64 = 3.0;

/// The same with a free delay of the positions, where none is stated and the data determine one: neither the residuals nor the meaning of the samples
/// shows it for certain. The current between two samples is not known then: the difference of λ with the next likely meaning of the samples widens its
/// standard deviation.
fn with_delay(other: impl Fn(Hold) -> Vec<Recording>, all: &[Recording], before: &mut Judged) -> Option<Judged> {
    let is_certain = before.refusal.is_none() && before.question.equally_likely.is_empty();
    let rows: usize = all.iter().map(|recording| recording.used().count()).sum();
    // The likelihood of more rows is weighted if a bench parameter is searched, and cannot be compared.
    if is_certain && rows as f64 > likelihood::BENCH_ROWS {
        return None;
    }
    let found = before.found.as_ref().filter(|found| found.converged)?;
    let next = before.question.holds?.without_lag().find(|of| of.hold != before.question.stated.hold);
    let is_delay = |at: &usize| {
        let parameter = &found.bench[*at].parameter;
        plain(&parameter.name) == DELAY && !parameter.is_uncertain()
    };
    let delays: Vec<usize> = (0..found.bench.len()).filter(is_delay).collect();
    let first = *delays.first()?;
    let mut question = before.question.clone();
    delays.iter().for_each(|at| question.stated.know(*at, Knowledge::Free));
    let options = Options { parts: question.stated.parts.clone(), ..before.options.clone() };
    let now = likelihood::identify(all, &options).ok().filter(|now| now.converged)?;
    // Instrumental-variable estimates do not maximise the likelihood: the delay must also be significant, the more so the less typical it is.
    let delay_of = |at: &usize| (now.bench[*at].estimate, now.bench[*at].parameter.typical);
    let evidence = |(delay, typical): (Estimate, f64)| {
        0.5 * ((delay.value / delay.total_std).powi(2) - (delay.value / typical).powi(2))
    };
    let by_likelihood = now.log_likelihood - found.log_likelihood;
    let gain = by_likelihood.min(delays.iter().map(delay_of).map(evidence).sum());
    // An error that explains more is no delay: 1 % of z in the readings of y, called one of −23 µs, gave λ 4.9 standard deviations off.
    let first_suspect = found.suspects.first().filter(|suspect| !delays.contains(&suspect.parameters[0].0));
    let explained = first_suspect.map_or(0.0, |suspect| 0.5 * suspect.chi_square);
    if gain < VERY_STRONG || by_likelihood < explained {
        // Both descriptions, with and without a delay that has its typical prior, are equally likely beforehand: λ also varies by its difference between
        // them, weighted with their probabilities (Bayesian model averaging, Hoeting et al. 1999).
        let kept = |(delay, typical): (Estimate, f64)| 1.0 / (1.0 + (delay.total_std / typical).powi(2));
        let kept = delays.iter().map(delay_of).map(kept).fold(0.0, f64::max);
        let log_odds = kept * gain + 0.5 * libm::log(1.0 - kept);
        let found = before.found.as_mut()?;
        found.widen(&now, kept * kept / (1.0 + libm::exp(-log_odds)));
        if before.refusal.is_none() {
            let uncertain = uncertain(found, all, &before.question.stated);
            before.refusal =
                uncertain.map(|[why, _]| Refusal { why, advice: DELAY_ADVICE.into(), details: Details::Proposals });
        }
        return None;
    }
    // Of two refused answers, the simpler is given.
    if before.refusal.is_some() && (now.pushes() || uncertain(&now, all, &question.stated).is_some()) {
        return None;
    }
    let next: Vec<_> = next.map(|of| (other(of.hold), false)).into_iter().collect();
    let mut delayed = identify_and_judge(all, &next, question);
    if delayed.refusal.is_some() && before.refusal.is_some() {
        return None;
    }
    // A longer delay has another cause, such as noise of the currents with a backward force (130 µs, λ 7 standard deviations off).
    let is_long = |at: &&usize| delay_of(at).0.value.abs() >= LONGEST_DELAY * delay_of(at).1;
    if let Some(at) = delays.iter().find(is_long) {
        let why = words::long_delay(delay_of(at).0);
        delayed.refusal = Some(Refusal { why, advice: String::new(), details: Details::Proposals });
        return before.refusal.is_none().then_some(delayed);
    }
    let late = words::acting_later(now.bench[first].estimate, delayed.question.stated.hold, gain);
    delayed.notes.push(late);
    Some(delayed)
}

/// Advice where other meanings of the currents make λ uncertain.
const MEANING: &str =
    "with other meanings of the currents, which are about as likely, λ differs: state the right one (--hold)";

/// Identifies and judges. The difference of λ with each of the `alternatives` widens its standard deviation; the flag allows late positions.
fn identify_and_judge(all: &[Recording], alternatives: &[(Vec<Recording>, bool)], question: Question) -> Judged {
    let slow_force = question.slow_force.unwrap_or(false);
    let mut options =
        Options { parts: question.stated.parts.clone(), slow_force, excludes_rows: true, corrects_bias: true };
    let mut identified = match question.slow_force {
        Some(_) => likelihood::identify(all, &options),
        None => with_slow_force(all, &mut options),
    };
    let (mut notes, mut is_certain) = (Vec::new(), false);
    if let Some(found) = identified.as_mut().ok().filter(|found| found.converged) {
        is_certain = uncertain(found, all, &question.stated).is_none();
        for (other, may_be_late) in alternatives {
            let own = if *may_be_late { options.clone().late() } else { options.clone() };
            match likelihood::identify(other, &own) {
                Ok(other) if other.converged => found.widen(&other, 1.0),
                _ => notes.push(NOT_COMPARED.into()),
            }
        }
    }
    let mut refusal = refusal(&identified, all, &options, &question);
    let is_widened = |found: &Identification| is_certain && uncertain(found, all, &question.stated).is_some();
    if let (Some(refusal), true) = (&mut refusal, identified.as_ref().is_ok_and(is_widened)) {
        refusal.advice = MEANING.into();
    }
    Judged { question, options, found: identified.ok(), refusal, notes }
}

/// Why the estimates are not valid, if they are not.
fn refusal(identified: &Identified, all: &[Recording], options: &Options, question: &Question) -> Option<Refusal> {
    let stated = &question.stated;
    let found = identified.as_ref();
    if let Some(why) = found.ok().and_then(|_| differ(all, options, &stated.machine.symbols("λ"))) {
        return Some(Refusal { why, advice: String::new(), details: Details::Nothing });
    }
    let wrong_noise = found.ok().and_then(|found| wrong_noise(found, stated));
    let refused = |why: String| Some(Refusal { why, advice: String::new(), details: Details::Findings });
    if let Some((why, true)) = wrong_noise {
        return refused(why);
    }
    let is_at_rest = all.iter().all(Recording::at_rest);
    let least = TURNS[usize::from(stated.noise.iter().any(|noise| *noise <= 0.0))];
    let turns: f64 = all.iter().map(Recording::turns).sum();
    if !is_at_rest && turns < least {
        let turns = significant(turns, 2);
        let why = format!("the recording is too short: {turns} turns of the rotor, expected at least {least}");
        return refused(why);
    }
    let reason = match found {
        Err(Failed::Diverged(advice)) => Some(["the search does not converge".into(), advice.clone()]),
        Err(failed) => Some([failed.to_string(), String::new()]),
        Ok(found) => {
            let against = question.holds.and_then(|holds| holds.against(stated.currents()));
            let plain = || judge(found, all, stated.machine, &stated.parts);
            against.or_else(|| uncertain(found, all, stated)).or_else(|| Some([plain()?, String::new()]))
        }
    };
    let Some([why, advice]) = reason else { return wrong_noise.and_then(|(why, _)| refused(why)) };
    let weak = found.is_ok_and(|found| {
        found.converged && found.lambda.iter().any(|lambda| lambda.noise_std >= STD_LIMIT * lambda.value.abs())
    });
    if is_at_rest && (weak || all.iter().all(|recording| recording.still(&options.parts))) {
        let why = "the rotor is at rest and nothing excites it, or not enough. Move it along a path, or modulate the smallest \
                   force (F0.modulation)";
        return refused(why.into());
    }
    Some(Refusal { why, advice, details: Details::Proposals })
}

/// The answer in words. Once the fault is known, the residuals of the description mean nothing.
fn worded(judged: Judged, all: &[Recording], is_known: bool) -> Answer {
    let Judged { question, options, found, refusal, notes } = judged;
    let details = refusal.as_ref().map_or(&Details::Findings, |refusal| &refusal.details);
    let mut findings = Vec::new();
    let mut best = None;
    if *details == Details::Proposals {
        let mut recording = all[0].clone();
        // Descriptions are compared where λ is constant.
        let contradictions = found.iter().flat_map(|found| &found.contradictions);
        let changes = contradictions.filter(|of| of.recording == 0 && matches!(of.what, Change::Lambda(_)));
        changes.for_each(|of| recording.usable[of.rows.clone()].fill(false));
        let trial = Trial { recording, options, machine: question.stated.machine, bearing: 0 };
        findings.extend(constant_currents(&all[0].current_a, question.stated.machine));
        let Proposals { words, why_not } = diagnosis::proposals(&trial);
        match (words.first(), why_not) {
            (None, _) => {}
            (Some(first), Some(why)) => {
                findings.push(format!("No usual mistake explains the data. They fit best if {first}; but then {why}."))
            }
            (first, None) => {
                findings.push(format!("The data fit better if {}.", words.join("; or if ")));
                best = first.cloned();
            }
        }
    }
    // A search that did not converge has neither estimates nor meaningful residuals.
    let found = found.filter(|found| found.converged);
    if let Some(found) = found.as_ref().filter(|_| *details != Details::Nothing) {
        let drifts = found.contradictions.iter().any(|of| matches!(of.what, Change::Drift(_)));
        findings.extend(words::findings(found, all, &question.stated, is_known || drifts || best.is_some()));
        findings.extend(notes);
    }
    let verdict = match (&refusal, &found) {
        (Some(Refusal { why, advice, .. }), _) => match best {
            Some(best) => format!("Not valid: {why}; the data fit better if {best}."),
            None if advice.is_empty() => format!("Not valid: {why}."),
            None => format!("Not valid: {why}: {advice}."),
        },
        (None, Some(found)) => words::valid(found, &question.stated),
        (None, None) => "Not valid.".into(),
    };
    Answer { valid: refusal.is_none(), verdict, findings, found, question }
}

/// Identifies, and again with a slow force if the likelihood calls for it; that counts if the force is slow and worth a parameter.
pub(super) fn with_slow_force(recordings: &[Recording], options: &mut Options) -> Identified {
    let plain = likelihood::identify(recordings, options);
    let rows = |of: &Identification| of.parts().map(|part| part.rows).sum::<usize>();
    let used: usize = recordings.iter().map(|recording| recording.used().count()).sum();
    let is_worth_it = |gain: f64, rows: usize| gain > diagnosis::gain_by_chance(rows);
    let gains = |of: &Identification| is_worth_it(of.gain_by_slow_force, rows(of));
    // A slow force looks like changes of the load. In a comparison of descriptions, magnets that push decide.
    let is_needed = match &plain {
        Ok(plain) => gains(plain) && (options.corrects_bias || !plain.pushes()),
        Err(Failed::Contradicted { gain }) => is_worth_it(*gain, used),
        Err(_) => false,
    };
    if options.slow_force || !is_needed {
        return plain;
    }
    let slow = Options { slow_force: true, ..options.clone() };
    let most = SLOW_FORCE * options.parts[0].body.m_kg() * GRAVITY_M_S2;
    let is_slow = |of: &Identification| of.parts().all(|part| part.slow_force_n < most);
    match likelihood::identify(recordings, &slow) {
        Ok(found) if found.converged && is_slow(&found) && gains(&found) => {
            *options = slow;
            // Each gain is computed with all else fixed: the smaller one is certain.
            let plain = plain.map_or(f64::INFINITY, |plain| plain.gain_by_slow_force);
            Ok(Identification { gain_by_slow_force: found.gain_by_slow_force.min(plain), ..found })
        }
        _ => plain,
    }
}

impl Answer {
    /// Checks the estimate against another recording of the bench; `first` is the first of its own.
    ///
    /// # Errors
    /// Why there is nothing to compare.
    pub fn check(&self, first: &Samples, samples: &Samples) -> Result<Check, String> {
        let found = self.found.as_ref().ok_or("the first recording gives no estimate")?;
        if samples.rotation == Rotation::Unknown {
            return Err(NO_ROTATION.into());
        }
        let stated = &self.question.stated;
        let mut other = recording(samples, stated, stated.hold);
        let own = identify_and_judge(std::slice::from_ref(&other), &[], self.question.clone());
        let options = Options { corrects_bias: false, ..own.options.given(found) };
        let Some(own) = own.found.filter(|own| own.converged) else {
            return Err(format!("no fit of its own: {}", own.refusal.map_or_else(String::new, |refusal| refusal.why)));
        };
        leave_out(std::slice::from_mut(&mut other), &own);
        other.has_mark &= first.rotation.has_mark();
        let [before, after] = [(first.rotation.has_mark(), &first.omega_rad_s), (other.has_mark, &other.omega_rad_s)]
            .map(|(has_mark, omega_rad_s)| marked_speed(has_mark, omega_rad_s));
        let foreign = likelihood::identify(&[other], &options).map_err(|failed| failed.to_string())?;
        let rms = |of: &Identification| {
            let parts = || of.parts().zip(&stated.parts).map(|(of, part)| (of, part.body.coordinates() as f64));
            let all: f64 = parts().map(|(_, coordinates)| coordinates).sum();
            let square = |at: usize| parts().map(|(of, count)| count * of.prediction_rms_m[at].powi(2)).sum::<f64>();
            [0, 1].map(|at| (square(at) / all).sqrt())
        };
        let differ = disagreement(&[estimates(found), estimates(&own)], &stated.machine.symbols("λ"))
            .or_else(|| other_unbalance(&[(before, found), (after, &own)]));
        Ok(Check::new(differ.as_deref().map(sentence), samples.step_s, rms(&foreign), rms(&own)))
    }
}

/// The force constants with their covariance, huge if the recording alone does not show that all magnets pull.
fn estimates(of: &Identification) -> Own {
    let weight = if of.lambda.iter().all(|of| of.value > 0.0) { 1.0 } else { 1e12 };
    (DVector::from_iterator(of.lambda.len(), of.lambda.iter().map(|of| of.value)), &of.lambda_covariance * weight)
}

/// How separate estimates from recordings of one bearing disagree, if they do.
fn differ(recordings: &[Recording], options: &Options, names: &[String]) -> Option<String> {
    let [_, _, ..] = recordings else { return None };
    let own = |at: usize| likelihood::identify(&recordings[at..=at], options).ok();
    let own: Vec<Identification> = in_order(recordings.len(), &own).into_iter().collect::<Option<_>>()?;
    if own.iter().any(|own| !own.converged) {
        return None;
    }
    let estimated: Vec<Own> = own.iter().map(estimates).collect();
    let speeds = recordings.iter().map(|recording| marked_speed(recording.has_mark, &recording.omega_rad_s));
    disagreement(&estimated, names).or_else(|| other_unbalance(&speeds.zip(&own).collect::<Vec<_>>()))
}
