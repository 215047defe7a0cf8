//! A node-based geometry graph for redesigning scanned objects: the engine and its values.

pub mod cli;
pub mod conformance;
pub mod format;
pub mod memory;
pub mod render;
pub mod simd;
pub mod value;

mod catalog;
mod draw;
mod error;
mod eval;
mod golden;
mod graph;
mod limit;
mod node;
mod pack;
mod paths;
mod plain;
mod stamp;
mod text;
mod watch;
mod writing;

pub use catalog::Catalog;
pub use error::{Cancelled, Error, Place, Problem, Severity, Source, Span, code};
pub use eval::{
    Diagnosis, Disk, DiskError, Evaluation, Evaluator, Fault, NodeTrace, Observer, State,
    ThreadsError, Trace, Usage,
};
pub use golden::{Comparison, Keep, Measure, TestRun, Tolerance, Verdict, compare, test_graphs};
pub use graph::{Change, Checked, Difference, Edited, Files, Graph, Options, Put, ReadFile};
pub use limit::{Limit, TooMuch};
pub use node::{
    CancelToken, Context, File, FilePath, In, Node, NodeType, Output, Outputs, PortType, Progress,
    ReadError, node,
};
pub use pack::{FileFormat, Format, NewFile, Pack, format};
pub use text::Reader;
pub use value::{
    AnyValue, DecodeError, Decoder, Encoder, Hash, Summary, Value, ValueType, hash_of, value_type,
};
