//! The pace of a recording: a straight line through its time stamps, which may scatter, be rounded, or lack rows.

use crate::studies::identify::units::{rounded_time, time as shown};
use crate::studies::statistics::{mean, median, range, rms};

/// Largest rms scatter of the stamps about the line, in sample times: rounding to half a sample time scatters by 0.5/√12 = 0.144.
const SCATTER: f64 = 0.15;

/// A stamp further off the line, in sample times, is wrong. At half a sample time its sample number would be ambiguous;
/// rounding to half a sample time uses up 0.25.
const WRONG: f64 = 0.35;

/// Largest fraction of wrong stamps.
const WRONG_PART: f64 = 0.01;

/// Equal successive stamps are due to rounding if they exceed this fraction; fewer are duplicated rows.
const ROUNDED_PART: f64 = 0.02;

/// Steps that differ by whole multiples of the rounding are due to rounding if there are at least this many, spread evenly; fewer
/// are missing rows.
const ROUNDED_STEPS: usize = 8;

/// Greatest duration of a recording, in sample times per row; a longer one has a stamp that is far off.
const SPARSE: f64 = 20.0;

/// Minimum number of changes of coarse stamps that determine the pace.
const LEAST_CHANGES: usize = 3;

/// Greatest relative difference between a stated rate and the slope of the time stamps; quartz clocks differ by a tenth of it.
pub(super) const CLOCKS: f64 = 1e-3;

/// Number of lines listed in a message.
const SHOWN: usize = 5;

/// The samples on the straight line.
#[derive(Default)]
pub(super) struct Pace {
    /// Instant of the first sample on the line, in s.
    pub start_s: f64,
    /// Sample time, in s.
    pub step_s: f64,
    /// Sample number of each row; NaN for rows without one, empty if the recording is interpolated.
    pub place: Vec<f64>,
    /// Relative uncertainty of the sample time, and its cause, if it is large.
    pub uncertain: Option<(f64, String)>,
    /// Findings, in sentences.
    pub notes: Vec<String>,
}

/// At least two time stamps, all finite, and their lines in the file.
pub(super) struct Times {
    pub time_s: Vec<f64>,
    pub lines: Vec<u32>,
}

/// Time as a straight line over the sample numbers.
#[derive(Clone, Copy)]
struct Line {
    start_s: f64,
    step_s: f64,
}

/// A sample: its row, number and stamp.
#[derive(Clone, Copy)]
struct Point {
    row: usize,
    place: f64,
    time_s: f64,
}

impl Line {
    /// Least squares about the mean, to avoid cancellation.
    fn fit(points: &[Point]) -> Self {
        let first = points[0].time_s;
        let mean_place = mean(points.iter().map(|point| point.place));
        let mean_time = mean(points.iter().map(|point| point.time_s - first));
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

    /// The line with a round sample time or rate about the same midpoint, if it is within `tolerance_s` at the ends of the recording, and the
    /// number of its digits.
    fn round(self, last: f64, tolerance_s: f64) -> Option<(Self, usize)> {
        let tolerance_s = tolerance_s.max(1e-6 * self.step_s);
        // Rounding as decimal text gives the number nearest to what people write.
        let round = |value: f64, digits: usize| format!("{value:.*e}", digits - 1).parse::<f64>().unwrap_or(value);
        (1..=6).find_map(|digits| {
            let steps = [round(self.step_s, digits), 1.0 / round(1.0 / self.step_s, digits)];
            let near = |step_s: &f64| (step_s - self.step_s).abs() * (last / 2.0).max(1.0) <= tolerance_s;
            let step_s = steps.into_iter().find(near)?;
            let start_s = self.start_s + (self.step_s - step_s) * last / 2.0;
            let start_s = if start_s.abs() < 2.0 * tolerance_s { 0.0 } else { start_s };
            Some((Self { start_s, step_s }, digits))
        })
    }
}

impl Times {
    /// Finds the pace.
    ///
    /// # Errors
    /// How the stamps contradict an even pace.
    pub(super) fn pace(&self) -> Result<Pace, String> {
        let time = &self.time_s;
        if let Some(rounded) = self.rounded() {
            return Ok(rounded);
        }
        let allowed = ((time.len() as f64 * WRONG_PART) as usize).max(2);
        let mut points = rising(time);
        if time.len() - points.len() > allowed {
            self.check_rising(|step| step <= 0.0)?;
        }
        let mut straight = self.follow(&mut points)?;
        // Stamps far off the line are wrong; fit again without them.
        points.retain(|point| straight.miss(point) <= WRONG);
        if points.len() < 2 || time.len() - points.len() > allowed {
            return Err(self.uneven(straight));
        }
        straight = Line::fit(&points);
        let scatter = rms(points.iter().map(|point| straight.miss(point)));
        if scatter > SCATTER {
            return Err(self.uneven(straight));
        }
        let (first, last) = (points[0].place, points[points.len() - 1].place);
        straight.start_s += first * straight.step_s;
        points.iter_mut().for_each(|point| point.place -= first);
        let (place, mut notes) = self.numbered(&points)?;
        let tolerance_s = 2.0 * scatter * straight.step_s / (points.len() as f64).sqrt();
        let Line { start_s, step_s } = straight.round(last - first, tolerance_s).map_or(straight, |(line, _)| line);
        if scatter > 1e-4 {
            let scatter = rounded_time(scatter * step_s, 2);
            notes.push(format!(
                "The time stamps scatter by {scatter} (rms) about the straight line; the samples are taken to be on it."
            ));
        }
        Ok(Pace { start_s, step_s, place, uncertain: None, notes })
    }

    /// The pace of stamps that are rounded to about a sample time or more: their rows are counted, if a straight line over
    /// them explains every stamp.
    fn rounded(&self) -> Option<Pace> {
        let (steps, count) = (self.steps(), self.time_s.len() as f64);
        let rounding_s = steps.iter().copied().filter(|step| *step > 0.0).fold(f64::INFINITY, f64::min);
        let is_whole = |step: f64| (step / rounding_s - (step / rounding_s).round()).abs() < 1e-3;
        if rounding_s.is_infinite() || steps.iter().any(|step| *step < 0.0 || !is_whole(*step)) {
            return None;
        }
        let equal = steps.iter().filter(|step| **step == 0.0).count();
        let long = steps.iter().filter(|step| **step > 1.5 * rounding_s).count();
        let usual = long.min(steps.len() - long);
        if equal as f64 <= ROUNDED_PART * count && usual < ROUNDED_STEPS {
            return None;
        }
        let point = |(row, time_s): (usize, &f64)| Point { row, place: row as f64, time_s: *time_s };
        let points: Vec<Point> = self.time_s.iter().enumerate().map(point).collect();
        // If the stamps are rounded to many samples and few of them differ, the rows at which they change determine the pace, each to half a
        // sample: the error of a staircase does not shrink with its rows. At worst, those of one half are early and those of the other late.
        let duration_s = self.time_s[self.time_s.len() - 1] - self.time_s[0];
        let is_stairs = 2 * equal > steps.len() && rounding_s > CLOCKS * duration_s;
        let changed = points.windows(2).filter(|pair| pair[0].time_s < pair[1].time_s);
        let change = |pair: &[Point]| {
            let time_s = 0.5 * (pair[0].time_s + pair[1].time_s);
            Point { place: pair[0].place + 0.5, time_s, ..pair[1] }
        };
        let changes: Vec<Point> = if is_stairs { changed.map(change).collect() } else { Vec::new() };
        let (mut line, mut known) = (Line::fit(&points), rounding_s / (duration_s + rounding_s));
        let mut tolerance_s = rounding_s / count.sqrt();
        if changes.len() >= LEAST_CHANGES {
            line = Line::fit(&changes);
            let off = changes.iter().map(|point| line.miss(point)).fold(0.5, f64::max);
            known = 3.0 * off / (changes[changes.len() - 1].place - changes[0].place);
            tolerance_s = 1.5 * off * line.step_s;
        }
        let is_uncertain = is_stairs && known > CLOCKS;
        // Half the rounding, plus the distance that the fitted line may have from the centre line of the band.
        let most_s = 0.55 * rounding_s + 0.05 * line.step_s;
        if !is_uncertain && points.iter().any(|point| line.miss(point) * line.step_s > most_s) {
            return None;
        }
        // Rows that a logger drops regularly look like rounding as well. A round pace indicates rounding, and so does rounding so
        // coarse that too many rows would have been dropped.
        let is_coarse = equal + usual > steps.len() / 5;
        let round = line.round(count - 1.0, tolerance_s);
        if !is_coarse && round.is_none_or(|(_, digits)| digits > 3) {
            return None;
        }
        let Line { start_s, step_s } = round.filter(|_| !is_uncertain).map_or(line, |(line, _)| line);
        let rounding = shown(rounding_s);
        let uncertain = is_uncertain.then(|| {
            let over = rounded_time(duration_s + rounding_s, 2);
            (known, format!("the time stamps are rounded to {rounding} in a recording of about {over}"))
        });
        let through = if changes.is_empty() { "all rows" } else { "the rows at which they change" };
        let slope = format!("the slope of the straight line through {through}");
        let pace = if is_uncertain { "that stated" } else { &slope };
        let notes = vec![format!("The time stamps are rounded to {rounding}; the pace is {pace}.")];
        Some(Pace { start_s, step_s, place: points.iter().map(|point| point.place).collect(), uncertain, notes })
    }

    /// Numbers the samples, and finds the straight line over the numbers.
    fn follow(&self, points: &mut [Point]) -> Result<Line, String> {
        let last = points.len() - 1;
        let mut step_s = median(points.windows(2).map(|pair| pair[1].time_s - pair[0].time_s));
        // The first pass trusts every step, later ones trust the line more than a stamp.
        for gain in [1.0, 0.1, 0.1] {
            number(points, step_s, gain);
            if points[last].place > SPARSE * self.time_s.len() as f64 + 1000.0 {
                return Err(self.hole(points, step_s));
            }
            // Slopes over a few rows are not biased by a hole whose samples were miscounted at first.
            let slope = |few: &[Point]| {
                let [from, to] = [few[0], few[few.len() - 1]];
                (to.time_s - from.time_s) / (to.place - from.place)
            };
            step_s = if gain < 1.0 {
                Line::fit(points).step_s
            } else {
                median(points.windows(17.min(points.len())).map(slope))
            };
        }
        Ok(Line::fit(points))
    }

    /// The sample number of each row, and notes. Rows with a wrong stamp get the numbers between their neighbours if there are as many as rows.
    fn numbered(&self, points: &[Point]) -> Result<(Vec<f64>, Vec<String>), String> {
        let mut place = vec![f64::NAN; self.time_s.len()];
        points.iter().for_each(|point| place[point.row] = point.place);
        // Rows before the first or after the last good stamp lack a neighbour.
        let (first, last) = (points[0].row, points[points.len() - 1].row);
        let mut discarded = [&self.lines[..first], &self.lines[last + 1..]].concat();
        let (mut surplus, mut corrected, mut holes, mut lost) = (Vec::new(), Vec::new(), Vec::new(), 0);
        for pair in points.windows(2) {
            let (from, to) = (pair[0].row, pair[1].row);
            let (between, free) = (to - from - 1, (pair[1].place - pair[0].place) as usize - 1);
            let lines = &self.lines[from + 1..to];
            if between > free {
                surplus.extend((from + 1..to).map(|row| (from, row)));
            } else if between == free {
                (from + 1..to).for_each(|row| place[row] = pair[0].place + (row - from) as f64);
                corrected.extend(lines);
            } else {
                discarded.extend(lines);
                holes.push(self.lines[from]);
                lost += free;
            }
        }
        if !surplus.is_empty() {
            return Err(self.out_of_order(&surplus));
        }
        let mut notes = Vec::new();
        if !corrected.is_empty() {
            let lines = listed(&corrected);
            notes.push(format!("Wrong time stamps in {lines} replaced: the rows follow from their neighbours."));
        }
        if !discarded.is_empty() {
            notes.push(format!("Rows left out because their time stamps are wrong: {}.", listed(&discarded)));
        }
        if let Some(first) = holes.first() {
            let places = if holes.len() == 1 { "1 place".into() } else { format!("{} places, the first", holes.len()) };
            notes.push(format!("{lost} rows are missing at {places} after line {first}."));
        }
        Ok((place, notes))
    }

    /// Refuses stamps that go back.
    pub(super) fn check_rising(&self, is_back: fn(f64) -> bool) -> Result<(), String> {
        let steps = self.steps();
        let back = (0..steps.len()).filter(|row| is_back(steps[*row])).map(|row| (row, row + 1)).collect::<Vec<_>>();
        if back.is_empty() { Ok(()) } else { Err(self.out_of_order(&back)) }
    }

    fn steps(&self) -> Vec<f64> {
        self.time_s.windows(2).map(|pair| pair[1] - pair[0]).collect()
    }

    /// The finding for rows that have no place after an earlier one.
    fn out_of_order(&self, pairs: &[(usize, usize)]) -> String {
        let lines: Vec<u32> = pairs.iter().map(|(_, row)| self.lines[*row]).collect();
        let (lines, (before, row)) = (listed(&lines), pairs[0]);
        let [from, to] = [before, row].map(|row| shown(self.time_s[row]));
        format!(
            "time does not rise by a sample in {lines}, first from {from} to {to}, and no rounding explains it; expected one recording with \
             rising time"
        )
    }

    /// The finding for a recording that lasts far longer than its rows.
    fn hole(&self, points: &[Point], step_s: f64) -> String {
        let length = |pair: &[Point]| pair[1].time_s - pair[0].time_s;
        let longest = points.windows(2).max_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or(points);
        let [from, to] = [longest[0], longest[longest.len() - 1]]
            .map(|point| format!("{} in line {}", shown(point.time_s), self.lines[point.row]));
        let step = rounded_time(step_s, 4);
        format!("time jumps from {from} to {to}, where the rows before are {step} apart")
    }

    /// The finding for stamps that no straight line explains: their properties, without a proposal.
    fn uneven(&self, straight: Line) -> String {
        let steps = self.steps();
        let tenth = (steps.len() / 10).max(1);
        let off = |row: &usize| {
            let place = (self.time_s[*row] - straight.start_s) / straight.step_s;
            (place - place.round()).abs()
        };
        let worst = (0..self.time_s.len()).max_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0);
        let (percent, line) = (100.0 * off(&worst), self.lines[worst]);
        let [least, greatest] = range(&steps).map(|step| rounded_time(step, 4));
        let [all, begin, end] =
            [&steps, &steps[..tenth], &steps[steps.len() - tenth..]].map(|steps| rounded_time(median(steps), 4));
        format!(
            "the time stamps contradict an even pace: steps are from {least} to {greatest} (median {all}; {begin} in the first tenth, {end} in \
             the last), and stamps are up to {percent:.0} % of a sample time off the straight line (line {line})"
        )
    }
}

/// The largest set of rows whose stamps rise (longest increasing subsequence); the others are out of order.
fn rising(time: &[f64]) -> Vec<Point> {
    // The last row of the best sequence of every length, and the row before each.
    let mut ends: Vec<usize> = Vec::new();
    let mut before: Vec<Option<usize>> = Vec::with_capacity(time.len());
    for row in 0..time.len() {
        let length = ends.partition_point(|end| time[*end] < time[row]);
        before.push(length.checked_sub(1).map(|shorter| ends[shorter]));
        if length == ends.len() {
            ends.push(row);
        } else if time[row] < time[ends[length]] {
            // Of equal stamps, the first counts.
            ends[length] = row;
        }
    }
    let rows = std::iter::successors(ends.last().copied(), |row| before[*row]);
    let mut points: Vec<Point> = rows.map(|row| Point { row, place: 0.0, time_s: time[row] }).collect();
    points.reverse();
    points
}

/// Numbers the samples from row to row by the number of steps since the previous sample. That sample's instant is the
/// prediction, corrected by a fraction (`gain`) of its stamp's error, so that scatter is not mistaken for missing rows.
fn number(points: &mut [Point], step_s: f64, gain: f64) {
    let (mut place, mut instant_s) = (0.0, points[0].time_s);
    for point in points.iter_mut().skip(1) {
        let steps = ((point.time_s - instant_s) / step_s).round().max(1.0);
        place += steps;
        instant_s += steps * step_s;
        instant_s += gain * (point.time_s - instant_s);
        point.place = place;
    }
}

/// A few lines by number.
pub(super) fn listed(lines: &[u32]) -> String {
    let shown = lines.iter().take(SHOWN).map(u32::to_string).collect::<Vec<_>>().join(", ");
    match lines.len() {
        1 => format!("line {shown}"),
        2..=SHOWN => format!("lines {shown}"),
        many => format!("lines {shown} and {} more", many - SHOWN),
    }
}
