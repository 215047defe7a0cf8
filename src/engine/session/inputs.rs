//! Values in files for the inputs of a graph. A forecast reads no large ones: it believes what was noted when they were read.

use std::path::{Path, PathBuf};

use maquette_graph::files::{KnownFile, NodeFile, Reads, Stamps};
use maquette_graph::{Graph, InputValues, KnownInput, KnownInputs};
use maquette_syntax::error::Problem;
use maquette_syntax::paths::{folder_of_new, project_root};
use maquette_value::ValueType;

use super::Session;

pub(super) fn read(
    session: &Session,
    graph: &Graph,
    files: &[(String, PathBuf)],
) -> Result<(InputValues, Vec<Problem>), Vec<Problem>> {
    graph.read_inputs_by(files, |path, kind| {
        let stamps = Stamps::of(path);
        let readers = session.catalog.readers();
        let (value, doubts) = readers.open_noting(path, Some(kind), &|file| stamps.add(file))?;
        if let (Some(known), Some(note)) = (stamps.known(value.hash()), note_of(path, kind)) {
            session.keep_note(&note, || serde_json::to_vec(&known).unwrap_or_default());
        }
        Ok((value, doubts))
    })
}

pub(super) fn known(
    session: &Session,
    graph: &Graph,
    files: &[(String, PathBuf)],
) -> Result<(KnownInputs, Vec<Problem>), Vec<Problem>> {
    let reads = Reads::new(session.evaluator.known_files(), graph.readers()).sparing();
    graph.read_inputs_by(files, |path, kind| {
        let file = NodeFile::given(path, [project_root(&folder_of_new(path))].into());
        if !reads.is_too_large(&file) {
            let (value, doubts) = session.catalog.readers().open(path, Some(kind))?;
            return Ok((KnownInput::Value(value), doubts));
        }
        fn noted(path: &Path, session: &Session, kind: &ValueType) -> Option<maquette_value::Hash> {
            let note = session.note(&note_of(path, kind)?)?;
            serde_json::from_slice::<KnownFile>(&note).ok()?.hash()
        }
        Ok((
            noted(path, session, kind).map_or(KnownInput::File(file), KnownInput::Hash),
            Vec::new(),
        ))
    })
}

/// Where is noted what a file holds, read as a value of this type.
fn note_of(path: &Path, kind: &ValueType) -> Option<PathBuf> {
    Some(std::fs::canonicalize(path).ok()?.join(kind.name))
}
