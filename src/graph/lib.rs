//! Parses and checks the text of a graph, and expands it to a flat graph that is ready to be evaluated.
//!
//! [`Graph::load`] reads a file and the files that it uses. `load` checks one file in several steps (`header`, `subgraphs`, `parsed_node`,
//! `link`, `outputs` and others). Each step adds to a [`Check`](check::Check), and together they result in a `definition`. `parameters` and
//! `expression` evaluate `Param`, `Expr` and `--set`. `expand` combines all files into one flat graph, whose parts are defined in `flat`;
//! `stage` and `repeat` create the elements of a `ForEach` over data. [`Catalog`](catalog::Catalog) contains the node types of all packs.
//! `canonical` computes the canonical form of a text, on which `diff`, `lock`, `migrate` and `pins` are based.
//!
//! Start reading in `graph.rs`, then `load.rs` and `expand.rs`.
//!
//! This crate reads texts. `maquette-edit` changes them, and `maquette-engine` evaluates graphs.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

pub mod catalog;
pub mod file_head;
pub mod file_stat;
pub mod files;

pub mod canonical;
pub mod check;
pub mod constants;
mod dangling_names;
mod declaration;
pub mod definition;
pub mod dependencies;
pub mod describe;
pub mod diff;
mod diff_uses;
mod difference;
mod draft_fields;
pub mod draft_value;
pub mod element;
mod expand;
pub mod expectation;
mod expected;
pub mod expression;
mod flat;
mod for_each;
mod graph;
mod guards;
pub mod header;
mod input;
mod lineage;
pub mod link;
mod link_fixes;
pub mod load;
mod lock;
pub mod migrate;
mod node;
pub mod options;
mod outputs;
pub mod parameters;
pub mod parsed_node;
pub mod patch;
mod pinned;
mod pins;
pub mod place;
mod promises;
pub mod rebase;
mod recipe;
mod repeat;
mod requirements;
mod satisfiable;
pub mod splice;
mod stage;
mod subgraphs;
mod topology;
pub mod tree;
mod unknown;
mod version;
mod words;
pub mod world;

pub use describe::Subgraph;
pub use diff::{Change, Difference};
pub use difference::{parameter_difference, parameter_name, short_text};
pub use draft_fields::DraftField;
pub use element::target_in_file;
pub use expectation::{ContinuityOrder, Expectation};
pub use expected::GraphExpectation;
pub use flat::{
    Count, Counts, GraphNode, GraphOutput, GraphUse, Guard, Link, Loop, RequiringInput,
};
pub use graph::{CheckedGraph, Graph};
pub use header::{field_of, is_name, name_of};
pub use input::{GraphInput, GraphPort, INPUT, InputValues, KnownInput, KnownInputs, ReadInputs};
pub use lock::{
    EXTENSION as LOCK_ENDING, Lock, LockedGraph, UsedGraphs, differences, lock_path as lock_beside,
};
pub use options::{Files, Options, ReadFile};
pub use pins::{Ancestry, EXTENSION as PINS_ENDING, PINNED, Pin, Pins, bytes_of};
pub use place::{EditError, field, place_value, unreachable_part};
pub use recipe::Recipe;
pub use requirements::{Requirement, UnmetRequirement};
pub use splice::{
    Splice, Tail, add_field, apply, content_start, indent_of, insert_after, newline, parts,
    put_entry, reindent, remove_parts, without_blank_lines,
};
pub use stage::{ELEMENTS, ElementCountChanged};
pub use subgraphs::is_type_name;
pub(crate) use topology::Topology;
pub use unknown::UnknownType;
pub use words::{Word, words, words_of_choices, words_of_fields};
