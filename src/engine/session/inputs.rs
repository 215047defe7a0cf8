//! Reads the values of a graph's inputs from files. A forecast does not read large files. Instead, it uses notes that were stored when the
//! files were last read.

use std::path::{Path, PathBuf};

use maquette_graph::files::{FileStats, KnownFile, NodeFile, Reads};
use maquette_graph::{Graph, InputValues, KnownInput, KnownInputs};
use maquette_syntax::error::Diagnostic;
use maquette_syntax::paths::{folder_of_new, project_root};
use maquette_value::ValueType;

use super::Session;

pub(super) fn read(
    session: &Session,
    graph: &Graph,
    files: &[(String, PathBuf)],
) -> Result<(InputValues, Vec<Diagnostic>), Vec<Diagnostic>> {
    graph.read_inputs_by(files, |path, kind| {
        let stamps = FileStats::read(path);
        let readers = session.catalog.readers();
        let (value, warnings) =
            readers.open_with_companions(path, Some(kind), &|file| stamps.add(file))?;
        if let (Some(known), Some(note)) =
            (stamps.into_known_file(value.hash()), note_of(path, kind))
        {
            session.keep_note(&note, || serde_json::to_vec(&known).unwrap_or_default());
        }
        Ok((value, warnings))
    })
}

pub(super) fn read_known(
    session: &Session,
    graph: &Graph,
    files: &[(String, PathBuf)],
) -> Result<(KnownInputs, Vec<Diagnostic>), Vec<Diagnostic>> {
    let reads = Reads::new(session.evaluator.known_files(), graph.readers()).with_forecast_limit();
    graph.read_inputs_by(files, |path, kind| {
        let file = NodeFile::from_path(path, [project_root(&folder_of_new(path))].into());
        if !reads.is_too_large(&file) {
            let (value, warnings) = session.catalog.readers().open(path, Some(kind))?;
            return Ok((KnownInput::Value(value), warnings));
        }
        fn noted_hash(
            path: &Path,
            session: &Session,
            kind: &ValueType,
        ) -> Option<maquette_value::Hash> {
            let note = session.note(&note_of(path, kind)?)?;
            serde_json::from_slice::<KnownFile>(&note).ok()?.hash()
        }
        Ok((
            noted_hash(path, session, kind).map_or(KnownInput::File(file), KnownInput::Hash),
            Vec::new(),
        ))
    })
}

/// Returns the key of the note about the value of type `kind` that the file at `path` contains; `None` if the file does not exist.
fn note_of(path: &Path, kind: &ValueType) -> Option<PathBuf> {
    Some(std::fs::canonicalize(path).ok()?.join(kind.name))
}
