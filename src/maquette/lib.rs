//! A node-based geometry graph for redesigning scanned objects: the engine and its values.
//!
//! # A tour
//!
//! A graph is a text. A [`Session`] checks a graph, evaluates the requested outputs, and caches the result of each node:
//!
//! ```
//! use maquette::value::Mesh;
//! use maquette::{Options, Run, Session, Settings};
//!
//! let text = r#"Graph(
//!     format: 1,
//!     params: { "levels": Integer(default: 2, min: 0, max: 5, doc: "How often faces are divided.") },
//!     nodes: {
//!         "cage": ReadMesh(path: "doll/coarse.obj"),
//!         "skin": Subdivide(mesh: "cage", scheme: CatmullClark, levels: Param("levels")),
//!     },
//!     outputs: { "skin.glb": "skin" },
//! )"#;
//! # let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../graphs/unsaved.ron");
//! let mut session = Session::new(maquette_nodes::PACKS, &Settings::in_memory())?;
//! let checked = session.load(&path, &Options::default().with_text(&path, text));
//! let graph = checked.graph.ok_or_else(|| checked.diagnostics[0].to_text(false))?;
//! let done = session.run(&graph, &Run::default()).map_err(|problems| problems[0].to_text(false))?;
//! assert!(done.get::<Mesh>("skin.glb")?.faces().len() > 1000);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Links between nodes carry [`Value`]s: meshes, range images, curves and the other types in [`value`] and in packs. The readers and
//! writers of their files are in [`format`](mod@format).
//!
//! A node type is a struct with a pure function. The fields of the struct are the ports and parameters of the node, and its doc comments
//! are the manual for users. A [`Pack`] lists node types, and a program consists of packs:
//!
//! ```
//! use maquette::value::Mesh;
//! use maquette::{Context, Error, In, Node, Pack, node};
//! use schemars::JsonSchema;
//! use serde::{Deserialize, Serialize};
//!
//! /// Lifts a mesh.
//! #[derive(Serialize, Deserialize, JsonSchema)]
//! pub struct Lift {
//!     /// The mesh to lift.
//!     pub mesh: In<Mesh>,
//!     /// The distance by which the mesh is lifted, along z.
//!     #[schemars(range(min = 0.0), extend("unit" = "mm"))]
//!     pub height: f64,
//! }
//!
//! impl Node for Lift {
//!     type Outputs = (Mesh,);
//!     const OUTPUTS: [&'static str; 1] = ["mesh"];
//!
//!     fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
//!         let mesh = cx.get(&self.mesh);
//!         let lifted = mesh.positions().iter().map(|p| p + nalgebra::Vector3::z() * self.height);
//!         Ok((mesh.with_positions(lifted.collect())?,))
//!     }
//! }
//!
//! pub const PACK: Pack =
//!     Pack { name: "lift", nodes: &[node::<Lift>()], ..Pack::EMPTY };
//! ```
//!
//! [`conformance::check`] reports the rules for nodes that a pack violates. A program that calls `maquette_cli::main` with packs has all
//! commands. `examples/embed.rs` embeds the engine in another program in forty lines, and `docs/architecture.md` describes the design of
//! the engine.

pub use maquette_diagram as diagram;
pub use maquette_edit as edit;
pub use maquette_edit::{Edit, EditedText, ExtractedGraph, Extraction, Merge, ValueChange};
pub use maquette_engine::RequestCounts;
pub use maquette_engine::eval::needs::{NodeNeeds, RunNeeds};
pub use maquette_engine::eval::{
    CacheFault, Diagnosis, Disk, DiskError, Evaluation, Evaluator, NodeTrace, Observer, RunTrace,
    State, ThreadsError, Usage, start_threads,
};
pub use maquette_engine::session::{
    CacheFolder, CacheServer, OutputFile, OutputFolder, OutputReport, Run, RunResult, SaveError,
    Session, SessionError, Settings, Targets, save,
};
pub use maquette_format as format;
pub use maquette_golden::conformance;
pub use maquette_golden::suite::{TestRun, test_graphs};
pub use maquette_golden::{Comparison, Keep, Measure, Tolerance, Verdict, compare};
pub use maquette_graph::catalog::Catalog;
pub use maquette_graph::{
    Change, CheckedGraph, Difference, Files, Graph, GraphInput, GraphPort, InputValues, Options,
    ReadFile,
};
pub use maquette_node::budget::{Estimate, Limit, LimitError};
pub use maquette_node::importers::{
    AnyReader, CompanionLookup, FileReader, InputFile, NoReader, reader,
};
pub use maquette_node::pack::{
    Content, FileFormat, Format, Migration, NewFile, NewValue, Pack, Recipe, format,
};
pub use maquette_node::provenance::Signature;
pub use maquette_node::{
    CancelToken, Carry, Certainty, ColorRange, Context, DataKind, Exactness, Fidelities, Fidelity,
    FieldError, File, FileHead, FilePath, Forecast, In, Node, NodeType, Output, Outputs, PortType,
    Previous, Progress, Promise, ReadError, Sizes, Transfer, ValueSize, Want, node,
};
pub use maquette_node::{bail, this_build, union};
pub use maquette_render as render;
pub use maquette_syntax::{
    CancelledError, Diagnostic, Error, Position, Reader, Severity, Source, Span, code,
};
pub use maquette_value as value;
pub use maquette_value::{
    AnyValue, DecodeError, Decoder, Elements, Encoder, Hash, Memo, NoElements, Summary, Value,
    ValueType, hash_of, value_type,
};
pub use maquette_value::{memory, parallel, rng, simd};
