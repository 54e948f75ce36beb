//! The answer for whole recordings: maximum likelihood, what it is worth, and what is said where it is worth nothing.

mod judge;
mod recorded;
mod restored;
mod shown;
mod words;

use nalgebra::DVector;

pub(super) use self::judge::implausible;
use self::judge::{judge, moved};
pub(super) use self::recorded::{read_as, recording};
pub(super) use self::words::words_on_dynamics;
use super::agreement::disagreement;
use super::diagnosis::{self, Take};
use super::likelihood::{self, DELAY, Estimate, Failed, Hold, Identification, Knowledge, Options, Recording};
use super::samples::{Rotation, Samples};
use super::tolerance::plain;
use super::units::significant;
use super::{GRAVITY_M_S2, Holds, Stated};
use crate::estimation::STD_LIMIT;
use crate::studies::parallel::in_order;

/// Turns that a recording must have at least, noise known or estimated (as on line). Of 600 good recordings of drawn bearings, 0.1 to 5 s, nine have fewer
/// (seeds 95001 and 101001).
const TURNS: [f64; 2] = [1.3, 2.0];
/// A force that wanders by more within a second, in weights of the rotor, is no slow one: the law fits badly.
const SLOW_FORCE: f64 = 0.015;
/// A motion whose speed differs from that of the shaft by more, relative, is a path with a speed of its own.
const OTHER: f64 = 0.05;
/// An error of the angle, rad, that moves a synchronous force by a tenth of itself.
const TURNED_RAD: f64 = 0.1;

/// Said where ± holds less than it should.
const ALONE: &str =
    "± does not contain by how much λ would differ with another reading of the currents: no other search converged.";

/// Question to the recordings.
#[derive(Clone, Debug)]
pub struct Question {
    /// The bearing and its sensors, with prior knowledge of the bench.
    pub stated: Stated,
    /// The readings of the currents, if they were compared.
    pub holds: Option<Holds>,
    /// Other readings that are as likely, if none is stated.
    pub as_likely: Vec<Hold>,
    /// Whether a slow force is estimated; if this is not stated, the likelihood decides.
    pub slow_force: Option<bool>,
}

/// Answer of the recordings.
#[derive(Clone, Debug)]
pub struct Answer {
    /// Whether the estimates can be relied on.
    pub valid: bool,
    /// Why, or why not, in a sentence.
    pub verdict: String,
    /// Further findings, in sentences; where the answer is not valid, what would fit instead.
    pub findings: Vec<String>,
    /// The estimates, unless there are none.
    pub found: Option<Identification>,
    /// The question.
    pub question: Question,
}

/// An identification and whether it counts.
struct Judged {
    question: Question,
    options: Options,
    /// The estimates, if there are any, whether the search converged or not.
    found: Option<Identification>,
    refusal: Option<Refusal>,
    /// Remarks on the identification itself.
    notes: Vec<String>,
}

/// Why estimates are not valid, and what else is said.
struct Refusal {
    why: String,
    more: More,
}

/// Findings that go with estimates that are not valid.
#[derive(PartialEq)]
enum More {
    /// None.
    Nothing,
    /// Those that the estimates show.
    Findings,
    /// These, and other readings of the recording that would fit.
    Proposals,
}

/// Identifies from all recordings together.
#[must_use]
pub fn answer(recordings: &[Samples], question: Question) -> Answer {
    if recordings.iter().any(|samples| samples.rotation == Rotation::Unknown) {
        let verdict = "Not valid: neither angle nor speed was recorded: --speed RPM is wanted, 0 at rest.".into();
        let finding = "The unbalance, which turns with the rotor, is not known then, and with it neither force constants, ki and ks nor the \
                       load.";
        return Answer { valid: false, verdict, findings: vec![finding.into()], found: None, question };
    }
    let stated = question.stated.clone();
    let all: Vec<Recording> = recordings.iter().map(|samples| recording(samples, &stated, stated.hold)).collect();
    let other = |hold: Hold| -> Vec<Recording> {
        all.iter().zip(recordings).map(|(of, samples)| read_as(of, samples, &stated, hold)).collect()
    };
    let as_likely: Vec<Vec<Recording>> = question.as_likely.iter().map(|hold| other(*hold)).collect();
    let judged = judged(&all, as_likely.iter().map(|other| (other, true)), question);
    let mut answer = worded(with_delay(other, &all, &judged).unwrap_or(judged), &all);
    for (samples, recording) in recordings.iter().zip(&all) {
        if let Some(off) = drifts(samples, recording) {
            answer.valid = false;
            answer.verdict = format!(
                "Not valid: the motion turns by {} % faster than the stated speed: --speed, or a column of the angle.",
                significant(100.0 * off, 2)
            );
        }
    }
    answer
}

/// By which part of itself the motion is faster than a speed that is not that of a recorded angle, if by less than [`OTHER`] and certainly, and if
/// it matters.
fn drifts(samples: &Samples, recording: &Recording) -> Option<f64> {
    if !matches!(samples.rotation, Rotation::Told | Rotation::Speed) {
        return None;
    }
    let [off, std, angle_rad] = diagnosis::drift(recording)?;
    (off.abs() > 5.0 * std && off.abs() < OTHER && angle_rad.abs() > TURNED_RAD).then_some(off)
}

/// A delay that is found without being asked for is at most so many times as long as that of a typical bench.
const FURTHEST: f64 = 3.0;

/// The same with a delay of the positions of which nothing is stated, if the residuals ask for one or several readings of the currents are as likely (with a delay each), and
/// it fits much better. The course of a current between two samples is not known then: by how much λ differs with the next likely reading of the samples is part of its deviation.
fn with_delay(other: impl Fn(Hold) -> Vec<Recording>, all: &[Recording], before: &Judged) -> Option<Judged> {
    let is_open = !before.question.as_likely.is_empty();
    if before.refusal.is_none() && !is_open {
        return None;
    }
    let found = before.found.as_ref().filter(|found| found.converged)?;
    let next = before.question.holds?.without_lag().find(|of| of.hold != before.question.stated.hold)?.hold;
    let is_delay = |at: &usize| {
        let parameter = &found.bench[*at].parameter;
        plain(&parameter.name) == DELAY && !parameter.is_open()
    };
    let delays: Vec<usize> = if is_open {
        (0..found.bench.len()).filter(is_delay).collect()
    } else {
        found.suspects.iter().map(|of| of.parameter).filter(is_delay).take(1).collect()
    };
    let first = *delays.first()?;
    let mut question = before.question.clone();
    delays.iter().for_each(|at| question.stated.know(*at, Knowledge::Free));
    let mut delayed = judged(all, [(&other(next), false)].into_iter(), question);
    let now = delayed.found.as_ref().filter(|now| now.converged)?;
    // Estimates by instruments are not at the maximum of the likelihood: a delay has to be as certain as it is likely, and all the more certain the less typical it is.
    let delay_of = |at: &usize| (now.bench[*at].estimate, now.bench[*at].parameter.typical);
    let evidence = |(delay, typical): (Estimate, f64)| {
        0.5 * ((delay.value / delay.total_std).powi(2) - (delay.value / typical).powi(2))
    };
    let gain = (now.log_likelihood - found.log_likelihood).min(delays.iter().map(delay_of).map(evidence).sum());
    // One that no bench has is asked for by something else, as by noise of the currents where a force turns backward (130 µs, λ 7 deviations off).
    let is_usual = |(delay, typical): (Estimate, f64)| delay.value.abs() < FURTHEST * typical;
    if gain < diagnosis::VERY_STRONG || !delays.iter().map(delay_of).all(is_usual) {
        return None;
    }
    // An answer that fits worse than one that is refused is not valid either; of two refused ones the plainer is told.
    if delayed.refusal.is_some() && before.refusal.is_some() {
        return None;
    }
    let late = words::acting_later(now.bench[first].estimate, delayed.question.stated.hold, gain);
    delayed.notes.push(late);
    Some(delayed)
}

/// Identifies and judges. By how much λ differs with each of the recordings `beside` is part of its deviation; positions of some may be late.
fn judged<'a>(
    all: &[Recording],
    beside: impl Iterator<Item = (&'a Vec<Recording>, bool)>,
    question: Question,
) -> Judged {
    let slow_force = question.slow_force.unwrap_or(false);
    let mut options = Options { parts: question.stated.parts.clone(), slow_force, leaves_out: true };
    let mut identified = match question.slow_force {
        Some(_) => likelihood::identify(all, &options),
        None => with_slow_force(all, &mut options),
    };
    let mut notes = Vec::new();
    if let Some(found) = identified.as_mut().ok().filter(|found| found.converged) {
        for (other, may_be_late) in beside {
            let own = if may_be_late { options.clone().late() } else { options.clone() };
            match likelihood::identify(other, &own) {
                Ok(other) if other.converged => found.widen(&other),
                _ => notes.push(ALONE.into()),
            }
        }
    }
    let refusal = refusal(&identified, all, &options, &question);
    Judged { question, options, found: identified.ok(), refusal, notes }
}

/// Why the estimates are not valid, if they are not.
fn refusal(
    identified: &Result<Identification, Failed>,
    all: &[Recording],
    options: &Options,
    question: &Question,
) -> Option<Refusal> {
    let stated = &question.stated;
    let found = identified.as_ref();
    if let Some(why) = found.ok().and_then(|_| differ(all, options, &stated.machine.symbols("λ"))) {
        return Some(Refusal { why, more: More::Nothing });
    }
    let rest = all.iter().all(Recording::at_rest);
    let least = TURNS[usize::from(stated.noise.iter().any(|noise| *noise <= 0.0))];
    let turns: f64 = all.iter().map(Recording::turns).sum();
    if !rest && turns < least {
        let turns = significant(turns, 2);
        let why = format!("the recording is too short: {turns} turns of the rotor, {least} at least are wanted");
        return Some(Refusal { why, more: More::Findings });
    }
    let judge_all = |found: &Identification| {
        let why =
            question.holds.and_then(|holds| holds.against(stated.currents())).or_else(|| judge(found, all, stated));
        why.or_else(|| moved(found, all, options, stated))
    };
    let why = found.map_or_else(|failed| Some(failed.to_string()), judge_all)?;
    let weak = found.is_ok_and(|found| {
        found.converged && found.lambda.iter().any(|lambda| lambda.noise_std >= STD_LIMIT * lambda.value.abs())
    });
    if rest && (weak || all.iter().all(|recording| recording.still(&options.parts))) {
        let why = "the rotor is at rest and nothing excites it, or not enough. Move it along a path, or modulate the smallest \
                   force (F0.modulation)";
        return Some(Refusal { why: why.into(), more: More::Findings });
    }
    Some(Refusal { why, more: More::Proposals })
}

/// The answer in words.
fn worded(judged: Judged, all: &[Recording]) -> Answer {
    let Judged { question, options, found, refusal, notes } = judged;
    let more = refusal.as_ref().map_or(&More::Findings, |refusal| &refusal.more);
    let mut findings = Vec::new();
    if *more == More::Proposals {
        let take = Take { recording: all[0].clone(), options, machine: question.stated.machine, bearing: 0 };
        findings.extend(diagnosis::proposals(&take));
    }
    // A search that did not converge has no estimate, and its residuals ask for nothing.
    let found = found.filter(|found| found.converged);
    if let Some(found) = found.as_ref().filter(|_| *more != More::Nothing) {
        findings.extend(words::words_on(found, all, &question.stated));
        findings.extend(notes);
    }
    let verdict = match (&refusal, &found) {
        (Some(Refusal { why, .. }), _) => format!("Not valid: {why}."),
        (None, Some(found)) => words::valid(found, &question.stated),
        (None, None) => "Not valid.".into(),
    };
    Answer { valid: refusal.is_none(), verdict, findings, found, question }
}

/// Identifies, once more with a slow force if the likelihood asks for it; that counts if the force is slow and worth a parameter (Schwarz 1978).
pub(super) fn with_slow_force(recordings: &[Recording], options: &mut Options) -> Result<Identification, Failed> {
    let plain = likelihood::identify(recordings, options);
    let rows = |of: &Identification| of.parts().map(|part| part.rows).sum::<usize>();
    let is_worth_it = |of: &Identification| of.gain_by_slow_force > 0.5 * libm::log(2.0 * rows(of) as f64);
    // A force that wanders looks like changes of the load.
    let asks = match &plain {
        Ok(plain) => is_worth_it(plain),
        Err(failed) => *failed == Failed::Contradicted,
    };
    if options.slow_force || !asks {
        return plain;
    }
    let slow = Options { slow_force: true, ..options.clone() };
    let most = SLOW_FORCE * options.parts[0].body.m_kg() * GRAVITY_M_S2;
    let is_slow = |of: &Identification| of.parts().all(|part| part.slow_force_n < most);
    match likelihood::identify(recordings, &slow) {
        Ok(found) if found.converged && is_slow(&found) && is_worth_it(&found) => {
            *options = slow;
            // Each is reckoned with everything else as it is: the smaller one is certain.
            let plain = plain.map_or(f64::INFINITY, |plain| plain.gain_by_slow_force);
            Ok(Identification { gain_by_slow_force: found.gain_by_slow_force.min(plain), ..found })
        }
        _ => plain,
    }
}

/// Whether recordings of one bearing disagree by estimates of their own, and about what.
fn differ(recordings: &[Recording], options: &Options, names: &[String]) -> Option<String> {
    let [_, _, ..] = recordings else { return None };
    let own = |at: usize| likelihood::identify(&recordings[at..=at], options).ok();
    let own: Vec<Identification> = in_order(recordings.len(), &own).into_iter().collect::<Option<_>>()?;
    if own.iter().any(|own| !own.converged) {
        return None;
    }
    let of = |own: Identification| {
        (DVector::from_iterator(own.lambda.len(), own.lambda.iter().map(|of| of.value)), own.lambda_covariance)
    };
    disagreement(&own.into_iter().map(of).collect::<Vec<_>>(), names)
}
