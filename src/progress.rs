//! A progress bar for work that takes more than a second.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Time after which a bar is shown.
const PATIENCE: Duration = Duration::from_secs(1);

/// Shows a bar on the standard error once the work has taken more than a second, until it is dropped.
pub struct Progress {
    title: &'static str,
    length: u64,
    since: Instant,
    bar: OnceLock<ProgressBar>,
}

impl Progress {
    /// Work with this many steps.
    pub fn new(title: &'static str, length: u64) -> Self {
        Self { title, length, since: Instant::now(), bar: OnceLock::new() }
    }

    /// Reports how many steps are done.
    pub fn tell(&self, done: u64) {
        if self.since.elapsed() > PATIENCE {
            self.bar.get_or_init(|| self.show()).set_position(done);
        }
    }

    fn show(&self) -> ProgressBar {
        let style = ProgressStyle::with_template("{msg} {wide_bar} {percent} %, {eta} left");
        let bar = ProgressBar::new(self.length).with_message(self.title).with_elapsed(self.since.elapsed());
        bar.with_style(style.expect("the template is well formed"))
    }
}
