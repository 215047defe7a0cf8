//! The API for packs of nodes: the traits for nodes, file formats and file readers.
//!
//! [`Node`] is one step of a graph: a struct whose fields are its ports ([`In`]) and parameters, and a pure function of a [`Context`]. A
//! [`Pack`] lists nodes, types of values, [`FileFormat`]s, [`FileReader`]s and migrations. A program consists of packs. [`Limit`] bounds
//! the size of a node's result. [`Signature`] is the provenance that a written file contains.
//!
//! Start reading in `node.rs`, then `pack.rs`. A pack depends only on this crate and on `maquette-value`.
//!
//! This crate does not depend on graphs, on the evaluator, or on a particular file format.

pub mod budget;
pub mod importers;
pub mod pack;
pub mod provenance;

mod blocks;
mod carry;
mod context;
mod exactness;
mod fidelity;
mod field_error;
mod file;
mod kind;
mod node;
mod port;
mod previous;
mod size;
mod terms;

pub use blocks::{Blocks, PointBlock};
pub use budget::{Estimate, Limit, LimitError};
pub use carry::{Carry, DOMAINS, Transfer};
pub use context::{CancelToken, Context, Memos, Progress};
pub use exactness::Exactness;
pub use fidelity::{DataKind, Fidelities, Fidelity};
pub use field_error::FieldError;
pub use file::{Companions, File, FilePath, ReadError};
pub use importers::{
    AnyReader, BlockFile, ColorRange, CompanionLookup, FileReader, InputFile, NoReader,
    NotInBlocks, reader,
};
pub use kind::{AnyNode, NodeType, Output, node};
pub use maquette_syntax::Reader;
// Items of other crates that the code of a pack needs.
pub use maquette_syntax::bail;
pub use maquette_syntax::error::{CancelledError, Error};
pub use maquette_value::{AnyValue, ValueType, value_type};
pub use node::Node;
pub use pack::{Content, FileFormat, Format, Migration, NewFile, NewValue, Pack, Recipe, format};
pub use port::{In, Outputs, PortType};
pub use previous::Previous;
pub use provenance::Signature;
pub use size::{Certainty, FileHead, Forecast, Sizes, ValueSize};
pub use terms::{Promise, Source, Term, Want};
