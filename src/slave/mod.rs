//! Co-simulation slaves, whatever the standard.
