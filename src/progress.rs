//! A progress bar for work that takes more than a second.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Time after which a bar is shown.
const DELAY: Duration = Duration::from_secs(1);

/// A bar on the standard error, shown once the work has taken more than a second, until it is dropped.
pub struct Progress(ProgressBar);

impl Progress {
    /// A bar for `length` steps.
    pub fn new(title: &'static str, length: u64) -> Self {
        let style = ProgressStyle::with_template("{msg} {wide_bar} {percent} %, {eta} left");
        let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::hidden()).with_message(title);
        Self(bar.with_style(style.expect("the template is well formed")))
    }

    /// Updates the number of completed steps.
    pub fn tell(&self, done: u64) {
        if self.0.is_hidden() && self.0.elapsed() > DELAY {
            self.0.set_draw_target(ProgressDrawTarget::stderr());
        }
        self.0.set_position(done);
    }
}
