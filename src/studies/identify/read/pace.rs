//! The pace of a recording: a straight line through its time stamps, which scatter, are rounded, and lack rows.

use super::signals::{median, range};
use crate::studies::identify::units::{rounded_time, time as shown};

/// The stamps may scatter about the line by so many sample times (rms): rounding to half a sample time scatters by 0.5/√12 = 0.144.
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
const SPARSE: f64 = 20.0;

/// The samples on the straight line.
pub(super) struct Pace {
    /// Instant of the first sample on the line, in s.
    pub start_s: f64,
    /// Sample time, in s.
    pub step_s: f64,
    /// Number of the sample that each row is; NaN for rows without a place.
    pub place: Vec<f64>,
    /// Findings, in sentences.
    pub notes: Vec<String>,
}

/// A straight line over the numbers of the samples.
#[derive(Clone, Copy)]
struct Line {
    start_s: f64,
    step_s: f64,
}

/// A sample: the row in which it stands, its number and its stamp.
#[derive(Clone, Copy)]
struct Point {
    row: usize,
    place: f64,
    time_s: f64,
}

impl Line {
    /// Least squares about the mean, so that nothing cancels.
    fn fit(points: &[Point]) -> Self {
        let n = points.len() as f64;
        let first = points[0].time_s;
        let mean_place = points.iter().map(|point| point.place).sum::<f64>() / n;
        let mean_time = points.iter().map(|point| point.time_s - first).sum::<f64>() / n;
        let (up, down) = points.iter().fold((0.0, 0.0), |(up, down), point| {
            let x = point.place - mean_place;
            (up + x * (point.time_s - first - mean_time), down + x * x)
        });
        let step_s = up / down;
        Self { start_s: first + mean_time - mean_place * step_s, step_s }
    }

    /// Distance of a stamp from the line, in sample times.
    fn miss(self, point: &Point) -> f64 {
        ((point.time_s - self.start_s) / self.step_s - point.place).abs()
    }

    /// The line with a round sample time or rate about the same middle, if the data cannot tell, and how many digits that has. At the ends of
    /// the recording it may be off by `freedom_s`.
    fn round(self, last: f64, freedom_s: f64) -> Option<(Self, usize)> {
        let freedom_s = freedom_s.max(1e-6 * self.step_s);
        // Rounding by decimal text gives the number nearest to what people write.
        let round = |value: f64, digits: usize| format!("{value:.*e}", digits - 1).parse::<f64>().unwrap_or(value);
        (1..=6).find_map(|digits| {
            let steps = [round(self.step_s, digits), 1.0 / round(1.0 / self.step_s, digits)];
            let near = |step_s: &f64| (step_s - self.step_s).abs() * (last / 2.0).max(1.0) <= freedom_s;
            let step_s = steps.into_iter().find(near)?;
            let start_s = self.start_s + (self.step_s - step_s) * last / 2.0;
            // So is the beginning.
            let start_s = if start_s.abs() < 2.0 * freedom_s { 0.0 } else { start_s };
            Some((Self { start_s, step_s }, digits))
        })
    }
}

/// Finds the pace of time stamps, at least two of them and all finite. `line` gives the line of the file in which a row stands.
///
/// # Errors
/// Contradictions to an even pace.
pub(super) fn find(time: &[f64], line: impl Fn(usize) -> u32) -> Result<Pace, Vec<String>> {
    if time.windows(2).all(|pair| pair[1] <= pair[0]) {
        return Err(vec!["time does not rise from any row to the next".into()]);
    }
    if let Some(rounded) = rounded(time) {
        return Ok(rounded);
    }
    let allowed = ((time.len() as f64 * WRONG_PART) as usize).max(2);
    let rows = rising(time);
    if time.len() - rows.len() > allowed {
        return Err(out_of_order(time, &line));
    }
    let stamps: Vec<f64> = rows.iter().map(|row| time[*row]).collect();
    let mut step_s = median(stamps.windows(2).map(|pair| pair[1] - pair[0]));
    let mut points = Vec::new();
    let mut straight = Line { start_s: stamps[0], step_s };
    // The first pass trusts every step, those that follow trust the line more than a stamp.
    for gain in [1.0, 0.1, 0.1] {
        points = follow(&rows, &stamps, step_s, gain);
        if points[points.len() - 1].place > SPARSE * time.len() as f64 + 1000.0 {
            return Err(vec![hole(&points, &line, step_s)]);
        }
        straight = Line::fit(&points);
        // Slopes over a few rows are not bent by a hole over which the samples were not counted right at first.
        let slope =
            |few: &[Point]| (few[few.len() - 1].time_s - few[0].time_s) / (few[few.len() - 1].place - few[0].place);
        step_s = if gain < 1.0 { straight.step_s } else { median(points.windows(17.min(points.len())).map(slope)) };
    }
    // Stamps far off the line are wrong; without them it is fitted once more.
    points.retain(|point| straight.miss(point) <= WRONG);
    if points.len() < 2 || time.len() - points.len() > allowed {
        return Err(vec![uneven(time, straight, &line)]);
    }
    straight = Line::fit(&points);
    let scatter = (points.iter().map(|point| straight.miss(point).powi(2)).sum::<f64>() / points.len() as f64).sqrt();
    if scatter > SCATTER {
        return Err(vec![uneven(time, straight, &line)]);
    }
    let (first, last) = (points[0].place, points[points.len() - 1].place);
    straight.start_s += first * straight.step_s;
    points.iter_mut().for_each(|point| point.place -= first);
    let (place, mut notes) = numbered(time, &points, &line)?;
    let freedom_s = 2.0 * scatter * straight.step_s / (points.len() as f64).sqrt();
    let Line { start_s, step_s } = straight.round(last - first, freedom_s).map_or(straight, |(line, _)| line);
    if scatter > 1e-4 {
        notes.push(format!(
            "The time stamps scatter by {} (rms) about the straight line; the samples are taken to be on it.",
            rounded_time(scatter * step_s, 2)
        ));
    }
    Ok(Pace { start_s, step_s, place, notes })
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
    let points: Vec<Point> =
        time.iter().enumerate().map(|(row, time_s)| Point { row, place: row as f64, time_s: *time_s }).collect();
    let line = Line::fit(&points);
    // Half the rounding, and what least squares may be off from the line that halves the band.
    if points.iter().any(|point| line.miss(point) * line.step_s > 0.55 * rounding_s + 0.05 * line.step_s) {
        return None;
    }
    // A row that a logger drops regularly looks like rounding as well; a round pace speaks for rounding, and so does rounding
    // so coarse that too many rows would have been dropped.
    let coarse = equal + usual > steps.len() / 5;
    let round = line.round(time.len() as f64 - 1.0, rounding_s / (time.len() as f64).sqrt());
    if !coarse && round.is_none_or(|(_, digits)| digits > 3) {
        return None;
    }
    let Line { start_s, step_s } = round.map_or(line, |(line, _)| line);
    let note = format!(
        "The time stamps are rounded to {}; the pace is the slope of the straight line through all rows.",
        shown(rounding_s)
    );
    Some(Pace { start_s, step_s, place: points.iter().map(|point| point.place).collect(), notes: vec![note] })
}

/// The largest set of rows whose stamps rise (longest increasing subsequence); the others are out of order.
fn rising(time: &[f64]) -> Vec<usize> {
    // The last row of the best sequence of every length, and the row before each.
    let mut ends: Vec<usize> = Vec::new();
    let mut before: Vec<Option<usize>> = Vec::with_capacity(time.len());
    for row in 0..time.len() {
        let length = ends.partition_point(|end| time[*end] < time[row]);
        before.push(length.checked_sub(1).map(|shorter| ends[shorter]));
        if length == ends.len() {
            ends.push(row);
        } else if time[row] < time[ends[length]] {
            // Of equal stamps the first one counts.
            ends[length] = row;
        }
    }
    let mut rows: Vec<usize> = std::iter::successors(ends.last().copied(), |row| before[*row]).collect();
    rows.reverse();
    rows
}

/// Numbers the samples from row to row: how many steps have gone by since the sample before. That sample's instant is the
/// predicted one, corrected by a part (`gain`) of its stamp's error, so that scatter does not pass for missing rows.
fn follow(rows: &[usize], stamps: &[f64], step_s: f64, gain: f64) -> Vec<Point> {
    let (mut place, mut instant_s) = (0.0, stamps[0]);
    let number = |(row, time_s): (&usize, &f64)| {
        if *time_s > stamps[0] {
            let steps = ((time_s - instant_s) / step_s).round().max(1.0);
            place += steps;
            instant_s += steps * step_s;
            instant_s += gain * (time_s - instant_s);
        }
        Point { row: *row, place, time_s: *time_s }
    };
    rows.iter().zip(stamps).map(number).collect()
}

/// The number of the sample that each row is, and notes. Rows with a wrong stamp get the places between their neighbours if these are as many as
/// the rows.
fn numbered(
    time: &[f64],
    points: &[Point],
    line: &impl Fn(usize) -> u32,
) -> Result<(Vec<f64>, Vec<String>), Vec<String>> {
    let mut place = vec![f64::NAN; time.len()];
    points.iter().for_each(|point| place[point.row] = point.place);
    let (first, last) = (points[0].row, points[points.len() - 1].row);
    // Stamps before the first and behind the last good one have no neighbours to go by.
    let mut discarded: Vec<u32> = (0..first).chain(last + 1..time.len()).map(line).collect();
    let (mut findings, mut corrected) = (Vec::new(), Vec::new());
    let (mut lost, mut holes, mut first_hole) = (0, 0, 0);
    for pair in points.windows(2) {
        let (from, to) = (pair[0].row, pair[1].row);
        let (between, free) = (to - from - 1, (pair[1].place - pair[0].place) as usize - 1);
        if between > free {
            findings.extend((from + 1..to).map(|row| {
                let (number, now) = (line(row), shown(time[row]));
                if time[row] == time[row - 1] || time[row] == time[from] {
                    format!("line {number}: the stamp of the row before stands here again ({now})")
                } else if time[row] < time[from] {
                    format!("line {number}: time goes back from {} to {now}", shown(time[from]))
                } else {
                    format!("line {number}: there is a row too many at {now}")
                }
            }));
        } else if between == free {
            (from + 1..to).for_each(|row| place[row] = pair[0].place + (row - from) as f64);
            corrected.extend((from + 1..to).map(line));
        } else {
            discarded.extend((from + 1..to).map(line));
            lost += free;
            holes += 1;
            first_hole = if holes == 1 { line(from) } else { first_hole };
        }
    }
    if !findings.is_empty() {
        return Err(shortened(findings));
    }
    let mut notes = Vec::new();
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
    Ok((place, notes))
}

/// The first of many findings, and how many there are.
fn shortened(mut findings: Vec<String>) -> Vec<String> {
    const SHOWN: usize = 5;
    let more = findings.len().saturating_sub(SHOWN);
    findings.truncate(SHOWN);
    findings.extend((more > 0).then(|| format!("and {more} more of this kind")));
    findings
}

/// A few lines by number.
fn lines(numbers: &[u32]) -> String {
    let shown = numbers.iter().take(5).map(u32::to_string).collect::<Vec<_>>().join(", ");
    match numbers.len() {
        1 => format!("line {shown}"),
        2..=5 => format!("lines {shown}"),
        many => format!("lines {shown} and {} more", many - 5),
    }
}

/// Findings on stamps of which too many are out of order.
fn out_of_order(time: &[f64], line: &impl Fn(usize) -> u32) -> Vec<String> {
    let back: Vec<usize> = (1..time.len()).filter(|row| time[*row] < time[row - 1]).collect();
    let twice: Vec<usize> = (1..time.len()).filter(|row| time[*row] == time[row - 1]).collect();
    let back = back.first().map(|row| {
        let (from, to) = (shown(time[row - 1]), shown(time[*row]));
        let (count, line) = (back.len(), line(*row));
        format!("time goes back at {count} places, the first in line {line}, from {from} to {to}; one recording with rising time is wanted")
    });
    let twice = twice.first().map(|row| {
        let (count, line, at) = (twice.len(), line(*row), shown(time[*row]));
        format!(
            "{count} rows have the time stamp of the row before, the first in line {line} ({at}), and no even pace explains them as \
             rounding"
        )
    });
    back.into_iter().chain(twice).collect()
}

/// The finding on a recording that lasts far longer than its rows.
fn hole(points: &[Point], line: &impl Fn(usize) -> u32, step_s: f64) -> String {
    let length = |pair: &[Point]| pair[1].time_s - pair[0].time_s;
    let longest = points.windows(2).max_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or(points);
    let [from, to] = [longest[0], longest[longest.len() - 1]];
    format!(
        "time jumps from {} in line {} to {} in line {}, where the rows before are {} apart",
        shown(from.time_s),
        line(from.row),
        shown(to.time_s),
        line(to.row),
        rounded_time(step_s, 4)
    )
}

/// The finding on stamps that no straight line explains: what they look like, without a proposal.
fn uneven(time: &[f64], straight: Line, line: &impl Fn(usize) -> u32) -> String {
    let steps: Vec<f64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let tenth = (steps.len() / 10).max(1);
    let off = |row: &usize| {
        let place = (time[*row] - straight.start_s) / straight.step_s;
        (place - place.round()).abs()
    };
    let worst = (0..time.len()).max_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0);
    let short = |seconds: f64| rounded_time(seconds, 4);
    let [least, greatest] = range(steps.iter().copied());
    format!(
        "the time stamps contradict an even pace: steps are from {} to {} (median {}; {} in the first tenth, {} in the last), and \
         stamps are up to {:.0} % of a sample time off the straight line (line {})",
        short(least),
        short(greatest),
        short(median(steps.iter().copied())),
        short(median(steps[..tenth].iter().copied())),
        short(median(steps[steps.len() - tenth..].iter().copied())),
        100.0 * off(&worst),
        line(worst)
    )
}
