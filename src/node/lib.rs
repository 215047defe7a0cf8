//! What a pack of nodes needs: what a step is, what a plugin is, and how files become values.
//!
//! [`Node`] is one step of a graph: a struct whose fields are its ports ([`In`]) and parameters, and a pure function of a
//! [`Context`]. A [`Pack`] lists nodes, types of values, [`FileFormat`]s, [`FileReader`]s and migrations: it is all that a program is
//! made of. [`Limit`] bounds the memory that a node takes, and [`Signature`] is what a written file tells of its origin.
//!
//! Begin reading in `node.rs`, then `pack.rs`. A pack depends on this crate and on `maquette-value`, and on nothing else of the
//! engine.
//!
//! This crate knows no graph, no evaluation and no particular file format.

pub mod limit;
pub mod pack;
pub mod provenance;
pub mod reading;

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
mod terms;

pub use carry::{Carry, DOMAINS, Fate};
pub use context::{CancelToken, Context, Memos, Progress};
pub use exactness::Exactness;
pub use fidelity::{DataKind, Fidelities, Fidelity};
pub use field_error::FieldError;
pub use file::{Companions, File, FilePath, ReadError};
pub use kind::{AnyNode, NodeType, Output, node};
pub use limit::{Estimate, Limit, TooMuch};
pub use maquette_syntax::Reader;
// What a pack names beside these.
pub use maquette_syntax::error::{Cancelled, Error};
pub use maquette_value::{AnyValue, ValueType, value_type};
pub use node::Node;
pub use pack::{Content, FileFormat, Format, Migration, NewFile, NewValue, Pack, Recipe, format};
pub use port::{In, Outputs, PortType};
pub use previous::Previous;
pub use provenance::Signature;
pub use reading::{AnyReader, Beside, ColorRange, FileReader, NoReader, Reading, reader};
pub use terms::{Promise, Source, Term, Want};
