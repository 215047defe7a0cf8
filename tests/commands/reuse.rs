//! Graphs made from other graphs: uses, repetition, and patches.

mod folder;
mod patches;
mod repetition;
mod subgraphs;
