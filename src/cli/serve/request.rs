//! The requests of a host: a program that has started `maquette serve`.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::PathBuf;

use maquette_edit::Edit;
use serde::Deserialize;
use serde_json::Value as Json;

use super::layout::Layout;
use super::materials::MaterialMessage;

/// One line from a host: a request with an id. The answer repeats the id, which is a number or a text.
pub(super) struct Line {
    pub(super) id: Json,
    pub(super) request: Result<Request, String>,
}

/// A request of a host.
#[derive(Deserialize)]
#[serde(tag = "do", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum Request {
    /// Requests a list of all node types.
    Catalog {},
    /// Requests the inputs, outputs and diagnostics of a graph.
    Load(Load),
    /// Requests the parts of a graph's text, such as its nodes and their fields.
    Outline(Outline),
    /// Stores the positions of a graph's nodes in the editor.
    Layout { graph: PathBuf, layout: Layout },
    /// Evaluates a graph and requests some of its values.
    Run(Run),
    /// Cancels a run.
    Cancel {
        /// The id of the request that started the run.
        run: Json,
    },
    /// Creates a value for an input from files.
    Input(Input),
    /// Edits a graph file.
    Edit(EditRequest),
    /// Replaces the whole text of a graph file, for instance to undo an edit.
    Put {
        graph: PathBuf,
        /// The text that the file must contain at present.
        was: String,
        text: String,
        /// The changes that other programs made since the file had the text `text`, in order. Each is the text before and the text after
        /// the change. All of them are merged into the result.
        theirs: Option<Vec<[String; 2]>>,
    },
    /// Asks for the reason why a node would run, or why it would not.
    Why {
        graph: PathBuf,
        #[serde(default)]
        roots: Vec<PathBuf>,
        #[serde(default)]
        set: BTreeMap<String, String>,
        #[serde(default)]
        draft: bool,
        #[serde(default = "default_true")]
        pins: bool,
        #[serde(default)]
        locked: bool,
        node: String,
    },
}

/// A graph and the options for loading it.
#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Load {
    pub(super) graph: PathBuf,
    #[serde(default)]
    pub(super) roots: Vec<PathBuf>,
    /// The values to set, as RON, by the name of the parameter or by `node.field`.
    #[serde(default)]
    pub(super) set: BTreeMap<String, String>,
    /// True if the draft value of each `Draft` is used instead of its final value.
    #[serde(default)]
    pub(super) draft: bool,
    /// True if pinned results are used instead of running their nodes.
    #[serde(default = "default_true")]
    pub(super) pins: bool,
    /// True if used graphs must match the lock file.
    #[serde(default)]
    pub(super) locked: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Outline {
    pub(super) graph: PathBuf,
    #[serde(default)]
    pub(super) roots: Vec<PathBuf>,
    /// The text of the graph. If it is omitted, the text is read from the file.
    pub(super) text: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Run {
    pub(super) graph: PathBuf,
    #[serde(default)]
    pub(super) roots: Vec<PathBuf>,
    #[serde(default)]
    pub(super) set: BTreeMap<String, String>,
    #[serde(default)]
    pub(super) draft: bool,
    #[serde(default = "default_true")]
    pub(super) pins: bool,
    #[serde(default)]
    pub(super) locked: bool,
    /// The hashes of the values for the graph's inputs, by the name of the input. The host has created these values with `Input`.
    #[serde(default)]
    pub(super) inputs: BTreeMap<String, String>,
    /// The slot of the run. A run that has not begun is replaced by a later run with the same slot. By default, the slot is the path of the
    /// graph.
    slot: Option<String>,
    /// The values to return. If it is omitted, all outputs are returned.
    pub(super) want: Option<Vec<ValueRequest>>,
}

impl Run {
    /// Returns the slot of the run: the given one, or the path of the graph.
    pub(super) fn slot(&self) -> Cow<'_, str> {
        match &self.slot {
            Some(slot) => slot.into(),
            None => self.graph.to_string_lossy(),
        }
    }
}

/// A value that the host requests.
#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ValueRequest {
    /// The name of an output of the graph, of a node, or of an output of a node.
    pub(super) value: String,
    #[serde(default, rename = "as")]
    pub(super) form: Form,
}

/// The form in which a value is returned.
#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Form {
    /// Only the type, the hash and the facts of the value.
    Facts,
    /// All data columns, without loss of precision.
    #[default]
    Parts,
    /// Vertices, edges and faces for drawing, with numbers in single precision.
    Mesh,
    /// A picture as PNG.
    Picture,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Input {
    /// The type of the value, such as `Mesh`.
    #[serde(rename = "type")]
    pub(super) kind: String,
    #[serde(default)]
    pub(super) facts: BTreeMap<String, Json>,
    pub(super) columns: Vec<InputColumn>,
    /// The number of elements in a row, if the value is a grid of pixels or control points.
    pub(super) row: Option<usize>,
    /// The materials of a mesh.
    #[serde(default)]
    pub(super) materials: Vec<MaterialMessage>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct InputColumn {
    pub(super) name: String,
    pub(super) on: String,
    pub(super) meaning: String,
    #[serde(default = "default_width")]
    pub(super) width: usize,
    #[serde(rename = "type")]
    pub(super) numbers: Numbers,
    /// The name of the file in the exchange folder that contains the column.
    pub(super) file: String,
}

fn default_width() -> usize {
    1
}

fn default_true() -> bool {
    true
}

/// The types of numbers in files. All are little-endian.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Numbers {
    F64,
    F32,
    U32,
    U8,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct EditRequest {
    pub(super) graph: PathBuf,
    #[serde(default)]
    pub(super) roots: Vec<PathBuf>,
    pub(super) edits: Vec<Edit>,
    /// True if the edit is only computed, not written.
    #[serde(default)]
    pub(super) dry: bool,
}

impl Line {
    /// Parses a line. The id is read even if the rest of the request is invalid, so that the error can be answered.
    pub(super) fn read(line: &[u8]) -> Self {
        let document: Json = match serde_json::from_slice(line) {
            Ok(document) => document,
            Err(error) => {
                return Self { id: Json::Null, request: Err(format!("expected JSON: {error}")) };
            }
        };
        let Json::Object(mut fields) = document else {
            let request =
                Err("expected an object as request: {\"id\": 1, \"do\": \"catalog\"}".into());
            return Self { id: Json::Null, request };
        };
        let id = fields.remove("id").unwrap_or_default();
        if !(id.is_number() || id.is_string()) {
            let why = "expected a number or a text as `id` of the request";
            return Self { id: Json::Null, request: Err(why.into()) };
        }
        let request =
            serde_json::from_value(Json::Object(fields)).map_err(|error| error.to_string());
        Self { id, request }
    }
}
