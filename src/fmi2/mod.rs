//! The C interface of FMI 2.0 for co-simulation.
