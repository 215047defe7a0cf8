//! From the text of a graph to a checked, flat graph that is ready to be evaluated.
//!
//! [`Graph::load`] reads a file and those that it uses: `load` takes one file through the checks (`top`, `subgraphs`, `draft`, `link`,
//! `outputs` and others, each of which adds to a [`Check`](check::Check)), which makes it a `definition`; `parameters` and `expression`
//! are `Param`, `Expr` and `--set`; `expand` makes one flat graph of all files, of the parts in `flat`; `stage` and `repeat` make the
//! elements of a `ForEach` over data. [`Catalog`](catalog::Catalog) is what the packs of a program offer. What a text means apart from its
//! words stands in `meaning`, and `diff`, `lock`, `migrate` and `pins` are made of it.
//!
//! Begin reading in `graph.rs`, then `load.rs` and `expand.rs`.
//!
//! This crate reads texts; what changes them is `maquette-edit`, and what computes is `maquette-engine`.

#![allow(missing_docs, reason = "what others may use is documented where `maquette` hands it on")]

pub mod catalog;
pub mod files;
pub mod stamp;

mod asked;
pub mod check;
mod declaration;
pub mod definition;
pub mod describe;
pub mod diff;
mod diff_uses;
mod difference;
pub mod draft;
mod draft_fields;
mod each;
pub mod element;
mod expand;
pub mod expectation;
mod expected;
pub mod expression;
mod fits;
pub mod fitting;
mod flat;
mod graph;
mod guards;
mod input;
mod lineage;
pub mod link;
mod link_fixes;
pub mod load;
mod lock;
pub mod meaning;
pub mod migrate;
pub mod needs;
mod node;
pub mod options;
mod outputs;
pub mod parameters;
pub mod patch;
mod pinned;
mod pins;
pub mod place;
mod promises;
pub mod quality;
pub mod rebase;
mod recipe;
mod repeat;
mod shape;
pub mod splice;
mod stage;
mod subgraphs;
pub mod top;
pub mod tree;
mod unfound;
mod unknown;
mod version;
mod words;
pub mod world;

pub use asked::{Asked, Broken};
pub use describe::Subgraph;
pub use diff::{Change, Difference};
pub use difference::{in_short, parameter_difference, parameter_name};
pub use draft_fields::DraftField;
pub use element::written;
pub use expectation::Expectation;
pub use expected::Expected;
pub use flat::{Count, Counts, GraphNode, GraphOutput, GraphUse, Guard, Link, Loop, Wanter};
pub use graph::{Checked, Graph};
pub use input::{GraphInput, GraphPort, INPUT, InputValues, InputsOr, KnownInput, KnownInputs};
pub use lock::{ENDING as LOCK_ENDING, Lock, Locked, UsedNow, beside as lock_beside, differences};
pub use options::{Files, Options, ReadFile};
pub use pins::{Ancestry, ENDING as PINS_ENDING, PINNED, Pin, Pins, bytes_of};
pub use place::{Refusal, field, place, unreachable_part};
pub use recipe::Recipe;
pub(crate) use shape::Shape;
pub use splice::{
    Splice, Tail, added, apply, behind, indent_of, newline, opened, parts, put_entry, reindented,
    without, without_blank_lines,
};
pub use stage::{ELEMENTS, OtherCount};
pub use subgraphs::is_type_name;
pub use top::{field_of, is_name, name_of};
pub use unknown::UnknownType;
pub use words::{Word, words, words_of_choices, words_of_fields};
