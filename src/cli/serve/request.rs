//! What a host may ask for.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::PathBuf;

use maquette_edit::Edit;
use serde::Deserialize;
use serde_json::Value as Json;

use super::layout::Layout;
use super::materials::MaterialMessage;

/// One line of a host: what it wants, and the number or text by which the answer is known.
pub(super) struct Line {
    pub(super) id: Json,
    pub(super) wish: Result<Wish, String>,
}

/// What a host wants.
#[derive(Deserialize)]
#[serde(tag = "do", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum Wish {
    /// All types of nodes.
    Catalog {},
    /// What a graph takes and gives, and its problems.
    Load(Load),
    /// What stands in a graph's text, part by part.
    Outline(Outline),
    /// Keeps where an editor has put a graph's nodes.
    Layout { graph: PathBuf, layout: Layout },
    /// Values of a graph.
    Run(Run),
    /// No more of a run.
    Cancel {
        /// The id of its request.
        run: Json,
    },
    /// A value for an input, made of files.
    Input(Input),
    /// Another text of a graph's file.
    Edit(EditWish),
    /// A text in place of another one: who knows what an edit found and left can take it back.
    Put {
        graph: PathBuf,
        /// The text that is expected in the file.
        was: String,
        text: String,
        /// What others changed since the file had `text`, in order: the text before and after each change. All of it is kept.
        theirs: Option<Vec<[String; 2]>>,
    },
    /// Why a node would run, or why not.
    Why {
        graph: PathBuf,
        #[serde(default)]
        roots: Vec<PathBuf>,
        #[serde(default)]
        set: BTreeMap<String, String>,
        #[serde(default)]
        draft: bool,
        #[serde(default = "yes")]
        pins: bool,
        #[serde(default)]
        locked: bool,
        node: String,
    },
}

/// A graph, and how it is read.
#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Load {
    pub(super) graph: PathBuf,
    #[serde(default)]
    pub(super) roots: Vec<PathBuf>,
    /// Values in place of defaults and fields, as RON.
    #[serde(default)]
    pub(super) set: BTreeMap<String, String>,
    /// Whether each `Draft` stands for its draft.
    #[serde(default)]
    pub(super) draft: bool,
    /// Whether pinned results stand in for their nodes.
    #[serde(default = "yes")]
    pub(super) pins: bool,
    /// Whether used graphs must be what the lock file says.
    #[serde(default)]
    pub(super) locked: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Outline {
    pub(super) graph: PathBuf,
    #[serde(default)]
    pub(super) roots: Vec<PathBuf>,
    /// What stands, or will stand, in the file; what is in it if this is left out.
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
    #[serde(default = "yes")]
    pub(super) pins: bool,
    #[serde(default)]
    pub(super) locked: bool,
    /// The hashes of values for inputs, by the inputs' names.
    #[serde(default)]
    pub(super) inputs: BTreeMap<String, String>,
    /// What the run is for: those that have not begun make way for a later one of the same slot. The graph's path if it is left out.
    slot: Option<String>,
    /// What is wanted; all outputs if it is left out.
    pub(super) want: Option<Vec<Want>>,
}

impl Run {
    /// What it is for.
    pub(super) fn slot(&self) -> Cow<'_, str> {
        match &self.slot {
            Some(slot) => slot.into(),
            None => self.graph.to_string_lossy(),
        }
    }
}

/// A value that is wanted.
#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Want {
    /// An output, a node or an output of a node.
    pub(super) value: String,
    #[serde(default, rename = "as")]
    pub(super) form: Form,
}

/// The form in which a value is given.
#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Form {
    /// Its type, hash and facts alone.
    Facts,
    /// All that it is made of, exactly.
    #[default]
    Parts,
    /// Vertices, edges and faces as programs draw them, in single precision.
    Mesh,
    /// A picture, as PNG.
    Picture,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Input {
    /// The type of the value: `Mesh`.
    #[serde(rename = "type")]
    pub(super) kind: String,
    #[serde(default)]
    pub(super) facts: BTreeMap<String, Json>,
    pub(super) columns: Vec<InputColumn>,
    /// Elements in a row, where they are pixels or control points.
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
    #[serde(default = "one")]
    pub(super) width: usize,
    #[serde(rename = "type")]
    pub(super) numbers: Numbers,
    /// Its name in the folder.
    pub(super) file: String,
}

fn one() -> usize {
    1
}

fn yes() -> bool {
    true
}

/// Kinds of numbers, little-endian.
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
pub(super) struct EditWish {
    pub(super) graph: PathBuf,
    #[serde(default)]
    pub(super) roots: Vec<PathBuf>,
    pub(super) edits: Vec<Edit>,
    /// Whether nothing is written.
    #[serde(default)]
    pub(super) dry: bool,
}

impl Line {
    /// What a line says. The id is there even if nothing else can be understood, if the line has one.
    pub(super) fn read(line: &[u8]) -> Self {
        let document: Json = match serde_json::from_slice(line) {
            Ok(document) => document,
            Err(error) => return Self { id: Json::Null, wish: Err(format!("no JSON: {error}")) },
        };
        let Json::Object(mut fields) = document else {
            let wish = Err("a request is an object: {\"id\": 1, \"do\": \"catalog\"}".into());
            return Self { id: Json::Null, wish };
        };
        let id = fields.remove("id").unwrap_or_default();
        if !(id.is_number() || id.is_string()) {
            let why = "a request has an `id`, a number or a text, by which its answer is known";
            return Self { id: Json::Null, wish: Err(why.into()) };
        }
        let wish = serde_json::from_value(Json::Object(fields)).map_err(|error| error.to_string());
        Self { id, wish }
    }
}
