//! Writes the outputs of a graph: each file appears whole or not at all.

use std::collections::{BTreeSet, HashMap};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};
use std::time::Duration;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::error::{Problem, Severity, code};
use crate::eval::{Evaluation, Evaluator, Stamp};
use crate::graph::{Graph, GraphOutput};
use crate::node::CancelToken;
use crate::pack::NewFile;
use crate::value::Hash;

/// How temporary files begin.
const TEMPORARY: &str = ".maquette-";

/// A temporary file older than this was left by a process that was killed: writing one takes seconds at most.
const LEFT_BEHIND: Duration = Duration::from_secs(600);

/// A file of an output that is on disk now.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Written {
    pub(super) output: String,
    pub(super) path: PathBuf,
    pub(super) bytes: usize,
    pub(super) hash: Hash,
    /// It was there already, with these bytes.
    pub(super) unchanged: bool,
}

impl Written {
    pub(super) fn to_json(&self) -> serde_json::Value {
        json!({
            "name": self.output,
            "path": self.path.display().to_string(),
            "bytes": self.bytes,
            "hash": self.hash.to_string(),
        })
    }
}

/// The folder of a graph's outputs, and what is known of the files in it.
///
/// A file that holds the right bytes already is left alone, so that neither a viewer nor a build tool takes it for a new one.
pub(super) struct Outputs {
    folder: PathBuf,
    /// By output: the value that its files were made of, and they, each as it was left.
    known: Mutex<HashMap<String, Known>>,
}

#[derive(Serialize, Deserialize)]
struct Known {
    value: Hash,
    files: Vec<(Written, Option<Stamp>)>,
}

/// `out/doll` for `graphs/doll.ron`.
pub(super) fn default_folder(graph: &Path) -> PathBuf {
    Path::new("out").join(graph.file_stem().unwrap_or_default())
}

impl Outputs {
    pub(super) fn new(folder: PathBuf) -> Self {
        Self { folder, known: Mutex::default() }
    }

    /// Finds out what the last process knew of the files in the folder.
    pub(super) fn recall(&self, evaluator: &Evaluator) {
        let note = evaluator.disk().and_then(|disk| disk.note(&self.folder));
        if let Some(known) = note.and_then(|note| serde_json::from_slice(&note).ok()) {
            *self.lock() = known;
        }
    }

    /// Tells the next process what is known of the files in the folder.
    pub(super) fn keep(&self, evaluator: &Evaluator) {
        if let (Some(disk), Ok(note)) = (evaluator.disk(), serde_json::to_vec(&*self.lock())) {
            disk.keep_note(&self.folder, note);
        }
    }

    /// The nodes whose values must be had to write these outputs: not those of files that are known to be right.
    pub(super) fn nodes_to_write(
        &self,
        outputs: &[&GraphOutput],
        graph: &Graph,
        evaluator: &mut Evaluator,
    ) -> Vec<usize> {
        let places = Vec::from_iter(outputs.iter().map(|output| (output.node, output.output)));
        let hashes = evaluator.known_hashes(graph, &places);
        let is_right = |(output, hash): &(&&GraphOutput, Option<Hash>)| {
            hash.is_some_and(|hash| self.still_there(&output.name, hash).is_some())
        };
        let to_write = outputs.iter().zip(hashes).filter(|output| !is_right(output));
        to_write.map(|(output, _)| output.node).collect()
    }

    /// Writes outputs in parallel; those whose nodes failed are left out, because that has been reported. What cannot be
    /// written is a problem; the file that was there before stays. Stops early if cancelled.
    pub(super) fn write(
        &self,
        outputs: &[&GraphOutput],
        evaluation: &Evaluation,
        graph: &Graph,
        evaluator: &Evaluator,
        cancel: &CancelToken,
    ) -> (Vec<Written>, Vec<Problem>) {
        let folders: BTreeSet<PathBuf> =
            outputs.iter().map(|output| self.folder_of(output)).collect();
        folders.iter().for_each(|folder| remove_left_behind(folder));
        let write = |output: &&GraphOutput| match cancel.is_cancelled() {
            true => Ok(Vec::new()),
            false => self.output(output, evaluation, graph),
        };
        let results: Vec<_> = evaluator.install(|| outputs.par_iter().map(write).collect());
        let (mut files, mut problems) = (Vec::new(), Vec::new());
        for result in results {
            match result {
                Ok(written) => files.extend(written),
                Err(problem) => problems.push(*problem),
            }
        }
        (files, problems)
    }

    fn output(
        &self,
        output: &GraphOutput,
        evaluation: &Evaluation,
        graph: &Graph,
    ) -> Result<Vec<Written>, Box<Problem>> {
        let Some(value) = evaluation.hash(output.node, output.output) else {
            return Ok(Vec::new());
        };
        if let Some(files) = self.still_there(&output.name, value) {
            return Ok(files);
        }
        let problem = |message: String, help: &str| {
            Box::new(Problem {
                severity: Severity::Error,
                code: code::FAILED,
                source: output.source.clone(),
                span: output.span,
                message,
                help: help.into(),
                note: None,
                uses: Vec::new(),
            })
        };
        let files = match evaluation.files(output) {
            None => return Ok(Vec::new()),
            Some(Ok(files)) => files,
            Some(Err(error)) => {
                return Err(problem(format!("cannot write `{}`: {error}", output.name), ""));
            }
        };
        let path = |file: &NewFile| self.folder_of(output).join(&file.name);
        let is_other = |file: &&NewFile| {
            let of_other = |other: &GraphOutput| self.folder.join(&other.name) == path(file);
            path(file) != self.folder.join(&output.name) && graph.outputs.iter().any(of_other)
        };
        if let Some(file) = files.iter().find(is_other) {
            let message = format!("`{}` also writes {}, another output", output.name, file.name);
            return Err(problem(message, "give one of the two outputs another name"));
        }
        let mut written = Vec::new();
        for file in files {
            let path = path(&file);
            if is_read_by(graph, &path) {
                let message = format!("cannot write {}: the graph reads this file", path.display());
                return Err(problem(message, "--out chooses another folder"));
            }
            let file = self.file(&output.name, path.clone(), &file).map_err(|error| {
                let help =
                    "the file that was there before is untouched; --out chooses another folder";
                problem(format!("cannot write {}: {error}", path.display()), help)
            })?;
            written.push(file);
        }
        let files = written.iter().map(|file| (file.clone(), Stamp::of(&file.path))).collect();
        self.lock().insert(output.name.clone(), Known { value, files });
        Ok(written)
    }

    /// The files of an output if they were made of this value and nobody has changed them since.
    fn still_there(&self, output: &str, value: Hash) -> Option<Vec<Written>> {
        let known = self.lock();
        let known = known.get(output).filter(|known| known.value == value)?;
        let is_as_left = |(file, left): &(Written, Option<Stamp>)| {
            left.is_some() && Stamp::of(&file.path) == *left
        };
        let unchanged = |(file, _): &(Written, _)| Written { unchanged: true, ..file.clone() };
        known.files.iter().all(is_as_left).then(|| known.files.iter().map(unchanged).collect())
    }

    fn file(&self, output: &str, path: PathBuf, file: &NewFile) -> std::io::Result<Written> {
        let bytes = &file.bytes[..];
        let unchanged = holds(&path, bytes);
        if !unchanged {
            write_whole(&path, bytes)?;
        }
        let (output, hash) = (output.to_owned(), Hash::of(bytes));
        Ok(Written { output, path, bytes: bytes.len(), hash, unchanged })
    }

    fn folder_of(&self, output: &GraphOutput) -> PathBuf {
        self.folder.join(Path::new(&output.name).parent().unwrap_or(Path::new("")))
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<String, Known>> {
        self.known.lock().unwrap_or_else(|broken| broken.into_inner())
    }
}

/// Whether a file is one of those that the graph reads: writing it would destroy it, and a watch would never come to rest.
fn is_read_by(graph: &Graph, path: &Path) -> bool {
    let path = real(path);
    path.is_some() && graph.files().any(|file| real(file) == path)
}

/// The path without links, also of a file that is not there yet.
fn real(path: &Path) -> Option<PathBuf> {
    let beside = || Some(std::fs::canonicalize(path.parent()?).ok()?.join(path.file_name()?));
    std::fs::canonicalize(path).ok().or_else(beside)
}

/// Whether a file holds these bytes; not asked of large files, because writing them takes no longer than reading them.
fn holds(path: &Path, bytes: &[u8]) -> bool {
    const LARGE: usize = 16 << 20;
    let same_length =
        std::fs::metadata(path).is_ok_and(|metadata| metadata.len() == bytes.len() as u64);
    same_length && bytes.len() < LARGE && std::fs::read(path).is_ok_and(|there| there == bytes)
}

/// Removes what processes that were killed while they wrote have left in a folder.
fn remove_left_behind(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let ours = entry.file_name().to_string_lossy().starts_with(TEMPORARY);
        let metadata = entry.metadata().ok().filter(|metadata| ours && metadata.is_file());
        let age = metadata.and_then(|metadata| metadata.modified().ok()?.elapsed().ok());
        if age.is_some_and(|age| age > LEFT_BEHIND) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Writes a file beside its place and moves it there: it appears whole or not at all.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)?;
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // What the user's umask leaves of it, as for any new file.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.tempfile_in(folder)?;
    file.write_all(bytes)?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::time::SystemTime;

    use super::*;

    #[test]
    fn old_temporary_files_are_swept_and_young_ones_stay() {
        let folder = tempfile::tempdir().unwrap();
        let make = |name: &str, age: u64| {
            let file = std::fs::File::create(folder.path().join(name)).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(age)).unwrap();
        };
        make(".maquette-old", 601);
        make(".maquette-young", 500);
        make("model.ply", 601);
        remove_left_behind(folder.path());
        let names = std::fs::read_dir(folder.path()).unwrap();
        let mut names: Vec<_> = names.map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, [".maquette-young", "model.ply"]);
    }

    #[test]
    fn a_file_that_holds_the_bytes_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let file = NewFile { name: "a.ply".into(), bytes: b"ply".to_vec() };
        let write = || {
            let outputs = Outputs::new(folder.path().to_owned());
            outputs.file("a", path.clone(), &file).unwrap().unchanged
        };
        assert!(!write());
        assert!(write());
        std::fs::write(&path, "plx").unwrap();
        assert!(!write());
    }
}
