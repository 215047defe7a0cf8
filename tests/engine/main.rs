//! Tests of the engine from the point of view of packs and host programs. They form one program, because linking a program for each test
//! takes long.

mod blocks;
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
