//! The graph language on the command line: one file for each group of its guarantees.

mod cases;
mod each;
mod help;
mod merging;
mod messages;
mod patterns;
mod pins;
mod promises;
mod provenance;
mod tables;
mod texts;
mod unknown;
mod versions;
