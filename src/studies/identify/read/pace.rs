//! The pace of a recording: a straight line through its time stamps, which scatter, are rounded, and lack rows.

use super::units::{significant, time as shown};

/// The stamps may scatter about the line by so many sample times in the mean (rms): rounding to half a sample time scatters
/// by 0.5/√12 = 0.144.
const SCATTER: f64 = 0.15;

/// A stamp further off the line, in sample times, is wrong. Half a sample time would make the number of its sample uncertain;
/// rounding to half a sample time takes 0.25.
const WRONG: f64 = 0.35;

/// So many of the stamps may be wrong, as a part of all.
const WRONG_PART: f64 = 0.01;

/// Equal stamps in succession are rounding if they are more than this part of all; fewer are rows that came twice.
const ROUNDED_PART: f64 = 0.02;

/// Steps that differ by whole multiples of the rounding are rounding if there are so many at least, spread evenly; fewer are
/// missing rows.
const ROUNDED_STEPS: usize = 8;

/// So many sample times may a recording last for each of its rows; a longer one has a stamp that is far off.
const SPARSE: u64 = 20;

/// The samples on the straight line.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Pace {
    /// Instant of the first sample on the line, in s.
    pub start_s: f64,
    /// Sample time, in s.
    pub step_s: f64,
    /// Number of the sample that each row is; `None` for rows without a place.
    pub place: Vec<Option<u32>>,
    /// Scatter about the line (rms), in sample times.
    pub scatter: f64,
    /// What was found, in sentences.
    pub notes: Vec<String>,
}

/// A straight line through (place, time).
#[derive(Clone, Copy, Debug)]
struct Line {
    start_s: f64,
    step_s: f64,
}

impl Line {
    fn at(self, place: u64) -> f64 {
        self.start_s + place as f64 * self.step_s
    }

    /// Least squares through the rows of `time` that have a place, about their mean, so that nothing cancels.
    fn fit(time: &[f64], rows: &[u32], places: &[u64]) -> Self {
        let n = rows.len() as f64;
        let mean_place = places.iter().map(|place| *place as f64).sum::<f64>() / n;
        let first = time[rows[0] as usize];
        let mean_time = rows.iter().map(|row| time[*row as usize] - first).sum::<f64>() / n;
        let (mut up, mut down) = (0.0, 0.0);
        for (row, place) in rows.iter().zip(places) {
            let x = *place as f64 - mean_place;
            up += x * (time[*row as usize] - first - mean_time);
            down += x * x;
        }
        let step_s = up / down;
        Self { start_s: first + mean_time - mean_place * step_s, step_s }
    }

    /// Distances of the stamps from the line, in sample times: rms and largest.
    fn misses(self, time: &[f64], rows: &[u32], places: &[u64]) -> (f64, f64) {
        let misses = rows.iter().zip(places).map(|(row, place)| (time[*row as usize] - self.at(*place)) / self.step_s);
        let (sum, largest) =
            misses.fold((0.0, 0.0), |(sum, largest): (f64, f64), miss| (sum + miss * miss, largest.max(miss.abs())));
        ((sum / rows.len() as f64).sqrt(), largest)
    }
}

/// Finds the pace of time stamps, at least two of them and all finite. `line` gives the line of the file in which a row stands.
///
/// # Errors
/// What contradicts an even pace.
pub(super) fn find(time: &[f64], line: impl Fn(usize) -> u32) -> Result<Pace, Vec<String>> {
    let steps = || time.windows(2).map(|pair| pair[1] - pair[0]);
    if steps().all(|step| step <= 0.0) {
        return Err(vec!["time does not rise from any row to the next".into()]);
    }
    if let Some(rounded) = rounded(time) {
        return Ok(rounded);
    }
    let mut rows = rising(time);
    let wrong = time.len() - rows.len();
    if wrong > allowed(time.len()) {
        return Err(out_of_order(time, &line));
    }
    let mut pace = first_pace(time, &rows);
    let mut places = Vec::new();
    let mut straight = Line { start_s: time[rows[0] as usize], step_s: pace };
    // The first pass trusts every step, those that follow trust the line more than a stamp.
    for gain in [1.0, 0.1, 0.1] {
        places = follow(time, &rows, pace, gain);
        if places.last().is_some_and(|last| *last > SPARSE * time.len() as u64 + 1000) {
            return Err(vec![hole(time, &rows, &line, pace)]);
        }
        straight = Line::fit(time, &rows, &places);
        pace = straight.step_s;
        if !(pace.is_finite() && pace > 0.0) {
            return Err(vec!["no straight line fits the time stamps".into()]);
        }
    }
    // Stamps far off the line are wrong; without them it is fitted once more.
    let near = |row: u32, place: u64| ((time[row as usize] - straight.at(place)) / straight.step_s).abs() <= WRONG;
    let kept: Vec<(u32, u64)> = rows.iter().copied().zip(places).filter(|(row, place)| near(*row, *place)).collect();
    let wrong = time.len() - kept.len();
    (rows, places) = kept.into_iter().unzip();
    if rows.len() < 2 || wrong > allowed(time.len()) {
        return Err(vec![uneven(time, straight, &line)]);
    }
    straight = Line::fit(time, &rows, &places);
    let (scatter, _) = straight.misses(time, &rows, &places);
    if scatter > SCATTER {
        return Err(vec![uneven(time, straight, &line)]);
    }
    assemble(time, &rows, &places, straight, scatter, line)
}

/// How many stamps may be wrong.
fn allowed(rows: usize) -> usize {
    ((rows as f64 * WRONG_PART) as usize).max(2)
}

/// Stamps that are rounded about as coarsely as the samples follow each other, or more coarsely: the rows themselves are
/// counted then, if a straight line over them explains every stamp.
fn rounded(time: &[f64]) -> Option<Pace> {
    let steps: Vec<f64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let rounding_s = steps.iter().copied().filter(|step| *step > 0.0).fold(f64::INFINITY, f64::min);
    let whole = |step: f64| (step / rounding_s - (step / rounding_s).round()).abs() < 1e-3;
    if steps.iter().any(|step| *step < 0.0 || !whole(*step)) {
        return None;
    }
    let equal = steps.iter().filter(|step| **step == 0.0).count();
    let long = steps.iter().filter(|step| **step > 1.5 * rounding_s).count();
    let usual = long.min(steps.len() - long);
    if equal as f64 <= ROUNDED_PART * time.len() as f64 && usual < ROUNDED_STEPS {
        return None;
    }
    let rows: Vec<u32> = (0..time.len() as u32).collect();
    let places: Vec<u64> = (0..time.len() as u64).collect();
    let line = Line::fit(time, &rows, &places);
    let (scatter, largest) = line.misses(time, &rows, &places);
    // Half the rounding, and what least squares may be off from the line that halves the band.
    if largest * line.step_s > 0.55 * rounding_s + 0.05 * line.step_s {
        return None;
    }
    let last = time.len() as u64 - 1;
    let freedom_s = rounding_s / (time.len() as f64).sqrt();
    // A row that a logger drops regularly looks like rounding as well; a round pace speaks for rounding, and so does rounding
    // so coarse that too many rows would have been dropped.
    let coarse = equal + usual > steps.len() / 5;
    if !coarse && round_step(line, last, freedom_s).is_none_or(|(_, digits)| digits > 3) {
        return None;
    }
    let line = snapped(line, last, freedom_s);
    let note = format!(
        "The time stamps are rounded to {}; the pace is the slope of the straight line through all rows.",
        shown(rounding_s)
    );
    Some(Pace {
        start_s: line.start_s,
        step_s: line.step_s,
        place: (0..time.len() as u32).map(Some).collect(),
        scatter,
        notes: vec![note],
    })
}

/// The largest set of rows whose stamps rise: what is left out is out of order.
fn rising(time: &[f64]) -> Vec<u32> {
    if time.windows(2).all(|pair| pair[1] > pair[0]) {
        return (0..time.len() as u32).collect();
    }
    // Longest increasing subsequence: the last row of the best one of every length, and who came before whom.
    let mut ends: Vec<u32> = Vec::new();
    let mut before = vec![u32::MAX; time.len()];
    for row in 0..time.len() {
        let length = ends.partition_point(|end| time[*end as usize] < time[row]);
        if length > 0 {
            before[row] = ends[length - 1];
        }
        match ends.get_mut(length) {
            None => ends.push(row as u32),
            // Of equal stamps the first one counts.
            Some(end) if time[row] < time[*end as usize] => *end = row as u32,
            Some(_) => {}
        }
    }
    let mut rows = Vec::with_capacity(ends.len());
    let mut row = ends.last().copied().unwrap_or(u32::MAX);
    while row != u32::MAX {
        rows.push(row);
        row = before[row as usize];
    }
    rows.reverse();
    rows
}

/// A pace to start from: the median of the mean steps over a few rows, which neither rounding nor missing rows disturb much.
fn first_pace(time: &[f64], rows: &[u32]) -> f64 {
    let span = 16.min(rows.len() - 1);
    let mut means: Vec<f64> = rows
        .windows(span + 1)
        .map(|window| (time[window[span] as usize] - time[window[0] as usize]) / span as f64)
        .collect();
    let middle = means.len() / 2;
    *means.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Numbers the samples from row to row: how many steps have gone by since the sample before. That sample's instant is the
/// predicted one, corrected by a part (`gain`) of what its stamp is off, so that scatter does not pass for missing rows.
fn follow(time: &[f64], rows: &[u32], pace_s: f64, gain: f64) -> Vec<u64> {
    let mut place = 0;
    let mut instant_s = time[rows[0] as usize];
    rows.iter()
        .enumerate()
        .map(|(n, row)| {
            let stamp = time[*row as usize];
            if n > 0 {
                let steps = ((stamp - instant_s) / pace_s).round().max(1.0);
                place += steps as u64;
                instant_s += steps * pace_s;
                instant_s += gain * (stamp - instant_s);
            }
            place
        })
        .collect()
}

/// The round number that the data cannot tell from the slope, of the sample time or of the rate, whichever is rounder, and how
/// many digits it has. At the ends of the recording it may be off by `freedom_s`.
fn round_step(line: Line, last: u64, freedom_s: f64) -> Option<(f64, usize)> {
    let freedom_s = freedom_s.max(1e-6 * line.step_s) / (last as f64 / 2.0).max(1.0);
    // Rounding by decimal text gives the number nearest to what people write.
    let round = |value: f64, digits: usize| format!("{value:.*e}", digits - 1).parse::<f64>().unwrap_or(value);
    (1..=6).find_map(|digits| {
        let steps = [round(line.step_s, digits), 1.0 / round(1.0 / line.step_s, digits)];
        steps.into_iter().find(|step_s| (step_s - line.step_s).abs() <= freedom_s).map(|step_s| (step_s, digits))
    })
}

/// The line with a round slope about the same middle, if the data cannot tell.
fn snapped(line: Line, last: u64, freedom_s: f64) -> Line {
    let Some((step_s, _)) = round_step(line, last, freedom_s) else { return line };
    let start_s = line.start_s + (line.step_s - step_s) * last as f64 / 2.0;
    // So is the beginning.
    let start_s = if start_s.abs() < 2.0 * freedom_s.max(1e-6 * step_s) { 0.0 } else { start_s };
    Line { start_s, step_s }
}

fn assemble(
    time: &[f64],
    rows: &[u32],
    places: &[u64],
    straight: Line,
    scatter: f64,
    line: impl Fn(usize) -> u32,
) -> Result<Pace, Vec<String>> {
    let base = places[0];
    let mut place: Vec<Option<u32>> = vec![None; time.len()];
    for (row, at) in rows.iter().zip(places) {
        place[*row as usize] = Some((at - base) as u32);
    }
    let mut notes = Vec::new();
    let (mut findings, mut corrected, mut discarded) = (Vec::new(), Vec::new(), Vec::new());
    let (mut lost, mut holes, mut first_hole) = (0, 0, 0);
    // Rows with a wrong stamp get the places between their neighbours if these are as many as the rows.
    let rowless = |place: &[Option<u32>]| (0..time.len()).filter(|row| place[*row].is_none()).collect::<Vec<_>>();
    for pair in rows.windows(2) {
        let (from, to) = (pair[0] as usize, pair[1] as usize);
        let (Some(first), Some(next)) = (place[from], place[to]) else { continue };
        let (between, free) = (to - from - 1, (next - first - 1) as usize);
        if between > free {
            for row in from + 1..to {
                findings.push(if time[row] == time[row - 1] || time[row] == time[from] {
                    format!("line {}: the stamp of the row before stands here again ({})", line(row), shown(time[row]))
                } else if time[row] < time[from] {
                    format!("line {}: time goes back from {} to {}", line(row), shown(time[from]), shown(time[row]))
                } else {
                    format!("line {}: there is a row too many at {}", line(row), shown(time[row]))
                });
            }
        } else if between > 0 && between == free {
            for (row, own) in place.iter_mut().enumerate().take(to).skip(from + 1) {
                *own = Some(first + (row - from) as u32);
                corrected.push(line(row));
            }
        } else {
            discarded.extend((from + 1..to).map(&line));
            if free > 0 {
                lost += free;
                holes += 1;
                if holes == 1 {
                    first_hole = line(from);
                }
            }
        }
    }
    // What lies before the first or behind the last good stamp has no neighbour to go by.
    let ends = rowless(&place);
    discarded.extend(
        ends.into_iter().filter(|row| *row < rows[0] as usize || *row > rows[rows.len() - 1] as usize).map(&line),
    );
    if !findings.is_empty() {
        return Err(shortened(findings));
    }
    if !corrected.is_empty() {
        notes.push(format!(
            "Wrong time stamps in {} replaced: the rows follow from their neighbours.",
            lines(&corrected)
        ));
    }
    if !discarded.is_empty() {
        notes.push(format!("Rows left out because their time stamps are wrong: {}.", lines(&discarded)));
    }
    if lost > 0 {
        notes.push(format!("{lost} rows are missing at {holes} places, the first after line {first_hole}."));
    }
    let last = places[places.len() - 1] - base;
    let straight = Line { start_s: straight.at(base), ..straight };
    let straight = snapped(straight, last, 2.0 * scatter * straight.step_s / (rows.len() as f64).sqrt());
    if scatter > 1e-4 {
        notes.push(format!(
            "The time stamps scatter by {} (rms) about the straight line; the samples are taken to be on it.",
            shown(significant(scatter * straight.step_s, 2).parse().unwrap_or(0.0))
        ));
    }
    Ok(Pace { start_s: straight.start_s, step_s: straight.step_s, place, scatter, notes })
}

/// The first of many findings, and how many there are.
fn shortened(mut findings: Vec<String>) -> Vec<String> {
    const SHOWN: usize = 5;
    let more = findings.len().saturating_sub(SHOWN);
    findings.truncate(SHOWN);
    if more > 0 {
        findings.push(format!("and {more} more of this kind"));
    }
    findings
}

/// A few lines by number.
fn lines(numbers: &[u32]) -> String {
    let shown: Vec<String> = numbers.iter().take(5).map(u32::to_string).collect();
    let more = numbers.len() - shown.len();
    let word = if numbers.len() == 1 { "line" } else { "lines" };
    format!("{word} {}{}", shown.join(", "), if more > 0 { format!(" and {more} more") } else { String::new() })
}

/// What is said about stamps of which too many are out of order.
fn out_of_order(time: &[f64], line: &impl Fn(usize) -> u32) -> Vec<String> {
    let back = (1..time.len()).filter(|row| time[*row] < time[row - 1]);
    let twice = (1..time.len()).filter(|row| time[*row] == time[row - 1]);
    let mut findings = Vec::new();
    let count = back.clone().count();
    if let Some(row) = back.clone().next() {
        findings.push(format!(
            "time goes back at {count} places, the first in line {}, from {} to {}; one recording with rising time is wanted",
            line(row),
            shown(time[row - 1]),
            shown(time[row])
        ));
    }
    let count = twice.clone().count();
    if let Some(row) = twice.clone().next() {
        findings.push(format!(
            "{count} rows have the time stamp of the row before, the first in line {} ({}), and no even pace explains them as \
             rounding",
            line(row),
            shown(time[row])
        ));
    }
    findings
}

/// What is said about a recording that lasts far longer than its rows.
fn hole(time: &[f64], rows: &[u32], line: &impl Fn(usize) -> u32, pace_s: f64) -> String {
    let longest = rows.windows(2).max_by(|a, b| {
        let step = |pair: &[u32]| time[pair[1] as usize] - time[pair[0] as usize];
        step(a).total_cmp(&step(b))
    });
    let (from, to) = longest.map_or((0, 0), |pair| (pair[0] as usize, pair[1] as usize));
    format!(
        "time jumps from {} in line {} to {} in line {}, where the rows before are {} apart",
        shown(time[from]),
        line(from),
        shown(time[to]),
        line(to),
        shown(significant(pace_s, 4).parse().unwrap_or(pace_s))
    )
}

/// What is said about stamps that no straight line explains: what they look like, without a proposal.
fn uneven(time: &[f64], straight: Line, line: &impl Fn(usize) -> u32) -> String {
    let mut steps: Vec<f64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let tenth = (steps.len() / 10).max(1);
    let median = |part: &[f64]| {
        let mut part = part.to_vec();
        let middle = part.len() / 2;
        *part.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let [begin, end] = [median(&steps[..tenth]), median(&steps[steps.len() - tenth..])];
    let off = |row: usize| {
        let place = (time[row] - straight.start_s) / straight.step_s;
        (place - place.round()).abs()
    };
    let worst = (0..time.len()).max_by(|a, b| off(*a).total_cmp(&off(*b))).unwrap_or(0);
    steps.sort_by(f64::total_cmp);
    let short = |seconds: f64| shown(significant(seconds, 4).parse().unwrap_or(seconds));
    format!(
        "the time stamps contradict an even pace: steps are from {} to {} (median {}; {} in the first tenth, {} in the last), and \
         stamps are up to {:.0} % of a sample time off the straight line (line {})",
        short(steps[0]),
        short(steps[steps.len() - 1]),
        short(steps[steps.len() / 2]),
        short(begin),
        short(end),
        100.0 * off(worst),
        line(worst)
    )
}
