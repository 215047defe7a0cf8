//! The language of graphs, as users of the commands meet it: a file for each row of what it promises.

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
