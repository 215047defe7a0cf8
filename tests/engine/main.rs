//! The engine as the packs and a host see it: one program, because each of them is linked anew.

mod builds;
mod cache;
mod conformance;
mod doll;
mod edits;
mod evaluator;
mod fixes;
mod goldens;
mod graph_files;
mod hostile_files;
mod incremental;
mod language;
mod rooms;
mod session;
mod text_tools;

#[path = "../common/beside.rs"]
mod beside;
#[path = "../common/examples.rs"]
mod examples;
#[path = "../common/ron_files.rs"]
mod ron_files;
