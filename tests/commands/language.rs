//! The graph language on the command line: one file for each group of its guarantees.

mod each;
mod help;
mod pins;
mod promises;
mod provenance;
mod texts;
mod unknown;
mod versions;
