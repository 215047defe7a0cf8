//! Graphs that are made of other graphs: uses, repetition, patches.

mod commands;
mod folder;
mod patches;
mod repetition;
mod subgraphs;
