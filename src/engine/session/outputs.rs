//! Writes the outputs of a graph. Each file appears whole or not at all.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::{self, File};
use std::mem::take;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};
use std::time::Instant;

use maquette_graph::catalog::Catalog;
use maquette_graph::file_stat::FileStat;
use maquette_graph::{Graph, GraphOutput};
use maquette_node::CancelToken;
use maquette_node::pack::{CachedData, Content, Pieces};
use maquette_node::provenance::Signature;
use maquette_syntax::error::{Diagnostic, Error, Severity, code};
use maquette_value::Hash;
use maquette_value::parallel::*;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::provenance::ProvenanceBuilder;
use crate::eval::{Evaluation, Evaluator, catch_panic};
use crate::writing::{
    Destination, PreviousFiles, RecycledFile, Rewritten, Sources, WriteError, write_at,
};

/// A file on disk that contains an output of a graph, or a part of that output.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct OutputFile {
    /// The name of the output.
    pub output: String,
    /// The path of the file.
    pub path: PathBuf,
    /// The size of the file, in bytes.
    pub bytes: usize,
    /// The hash of the file's content.
    pub hash: Hash,
    /// True if the file already had the right bytes and was not written.
    pub unchanged: bool,
    /// The time spent encoding and writing the file in this run, in seconds.
    #[serde(skip)]
    pub seconds: f64,
}

impl OutputFile {
    /// Returns the file as JSON, in the form that the option `--json` prints.
    pub fn to_json(&self) -> serde_json::Value {
        json!({
            "name": self.output,
            "path": self.path.display().to_string(),
            "bytes": self.bytes,
            "hash": self.hash.to_string(),
        })
    }
}

/// The folder for a graph's outputs, and what is known about the files in it.
///
/// A file that already has the right bytes is not written again. Otherwise viewers and build tools would take it for a new file.
pub struct OutputFolder {
    folder: PathBuf,
    /// True if the user has given the folder explicitly. Then it may be anywhere; otherwise it must be in the current folder.
    is_given: bool,
    /// True if the provenance of each output is written into its files.
    writes_provenance: bool,
    /// Files that must not be replaced, in addition to those that belong to the graph.
    kept: Sources,
    /// The known files of each output, by the name of the output.
    known: Mutex<HashMap<String, KnownOutput>>,
}

#[derive(Serialize, Deserialize)]
struct KnownOutput {
    /// The hash of the value and provenance from which the files were made.
    made_of: Hash,
    /// The files of the output, each with its metadata. The metadata is `None` if another program changed the file while it was written.
    files: Vec<(OutputFile, Option<VerifiedStamp>)>,
    /// Warnings about the parts of the value that the file format cannot store.
    #[serde(rename = "doubts")]
    warnings: Vec<String>,
    /// For each file, state that makes it faster to write the file again.
    #[serde(skip)]
    rewrite_states: Vec<RewriteState>,
}

/// State that makes it faster for this process to write a large file again.
#[derive(Default)]
struct RewriteState {
    pieces: Pieces,
    #[expect(dead_code, reason = "others find it as long as it is there")]
    kept: CachedData,
    /// The replaced version of the file, if there is one that the next write can overwrite.
    recycled: Option<RecycledFile<Pieces>>,
}

/// The metadata (stamp) that a file had at a time when its content was known.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct VerifiedStamp {
    stamp: FileStat,
    /// True if any later write is certain to change the metadata. If false, equal metadata does not prove that the file is unchanged.
    settled: bool,
}

impl VerifiedStamp {
    pub fn read(path: &Path) -> Option<Self> {
        let stamp = FileStat::read(path)?;
        Some(Self { stamp, settled: stamp.is_settled() })
    }

    /// Returns true if `file` still has the content with the known hash.
    fn is_unchanged(&mut self, file: &OutputFile) -> bool {
        self.holds(&file.path, file.hash)
    }

    /// Returns true if the file at this path still has the content with this hash. If the metadata does not prove this, the file is read;
    /// then the metadata may become settled, so that it proves this later.
    pub fn holds(&mut self, path: &Path, content: Hash) -> bool {
        if FileStat::read(path) != Some(self.stamp) {
            return false;
        }
        if self.settled {
            return true;
        }
        let settled = self.stamp.is_settled();
        let is_right =
            maquette_value::fs::read_no_follow(path).is_ok_and(|it| Hash::compute(&it) == content);
        self.settled = settled && is_right;
        is_right
    }

    /// Returns true if equal metadata is enough to prove that the file is unchanged.
    pub fn is_settled(&self) -> bool {
        self.settled
    }
}

/// Returns the default output folder of a graph, for example `out/doll` for `graphs/doll.ron`.
fn default_folder(graph: &Path) -> PathBuf {
    Path::new("out").join(graph.file_stem().unwrap_or_default())
}

impl OutputFolder {
    /// Creates the output folder of a graph. If `folder` is `None`, it is `out/GRAPH` in the current folder.
    pub fn new(folder: Option<&Path>, graph: &Path) -> Self {
        let named = folder.is_some();
        let folder = folder.map_or_else(|| default_folder(graph), Path::to_owned);
        Self {
            folder,
            is_given: named,
            writes_provenance: true,
            kept: Sources::default(),
            known: Mutex::default(),
        }
    }

    /// Creates the output folder of a task. `named` is true if the user has given the folder explicitly. `signs` is true if provenance is
    /// written.
    pub fn of_task(folder: &Path, named: bool, signs: bool) -> Self {
        Self { is_given: named, writes_provenance: signs, ..Self::new(Some(folder), folder) }
    }

    /// Turns off writing provenance into files.
    #[must_use]
    pub fn without_provenance(self) -> Self {
        Self { writes_provenance: false, ..self }
    }

    /// Creates the output folder of a draft. If `folder` is `None`, it is `out/GRAPH-draft`. The different name prevents drafts from being
    /// mistaken for final results.
    pub fn of_draft(folder: Option<&Path>, graph: &Path) -> Self {
        let mut name = graph.file_stem().unwrap_or_default().to_owned();
        name.push("-draft");
        Self {
            folder: folder.map_or_else(|| Path::new("out").join(name), Path::to_owned),
            ..Self::new(folder, graph)
        }
    }

    /// Adds files that must not be replaced.
    #[must_use]
    pub fn keeping<'a>(mut self, files: impl Iterator<Item = &'a Path>) -> Self {
        files.for_each(|file| self.kept.add(file, "it is an input"));
        self
    }

    /// Returns the path of the output folder.
    pub fn path(&self) -> &Path {
        &self.folder
    }

    /// Returns the destination that limits writing to this folder. If the user has not given the folder explicitly, it must be inside of
    /// the current folder, and no link may lead out of the current folder.
    pub fn destination<'a>(&self, sources: &'a Sources) -> Destination<'a> {
        match self.is_given {
            true => Destination::folder(&self.folder, sources),
            false => Destination::folder_inside(Path::new("."), &self.folder, sources),
        }
    }

    /// Loads the record that an earlier process has stored about the files in the folder.
    pub(super) fn recall(&self, evaluator: &Evaluator) {
        let note = evaluator.disk().and_then(|disk| disk.note(&self.folder));
        if let Some(known) = note.and_then(|note| serde_json::from_slice(&note).ok()) {
            *self.lock() = known;
        }
    }

    /// Stores a record of the files in the folder, for later processes to load.
    pub(super) fn keep(&self, evaluator: &Evaluator) {
        let known = self.lock();
        if let (Some(disk), Ok(note)) = (evaluator.disk(), serde_json::to_vec(&*known)) {
            // Store the record only after all large files are on disk. A large file may overwrite an older file, so if the machine stopped
            // earlier, the file would have the right length and time but wrong content.
            let files =
                known.values().flat_map(|known| known.files.iter().zip(&known.rewrite_states));
            let over = files.filter(|(_, again)| !again.pieces.is_empty());
            let over = over.map(|((file, _), _)| file.path.clone()).collect();
            disk.keep_note(&self.folder, note, over);
        }
    }

    /// Removes the replaced versions of large files, which are kept in the same folder to be overwritten later.
    pub fn drop_recycled_files(&self) {
        self.lock().values_mut().for_each(|known| known.rewrite_states.clear());
    }

    /// Returns the nodes whose values are needed to write the given outputs. Outputs whose files are up to date need no value.
    pub(super) fn nodes_to_write(
        &self,
        outputs: &[&GraphOutput],
        graph: &Graph,
        catalog: &Catalog,
        evaluator: &mut Evaluator,
    ) -> Vec<usize> {
        self.nodes_except(outputs, graph, catalog, evaluator, |name, made_of| {
            self.unchanged_files(name, made_of).is_some()
        })
    }

    /// Returns the nodes whose values are needed to write the given outputs. Unlike [`nodes_to_write`](Self::nodes_to_write), compares only
    /// the metadata of the files. No file is read.
    pub(super) fn nodes_to_write_by_stamps(
        &self,
        outputs: &[&GraphOutput],
        graph: &Graph,
        catalog: &Catalog,
        evaluator: &mut Evaluator,
    ) -> Vec<usize> {
        self.nodes_except(outputs, graph, catalog, evaluator, |name, made_of| {
            let known = self.lock();
            let files = known.get(name).filter(|known| known.made_of == made_of);
            files.is_some_and(|known| {
                known.files.iter().all(|(file, verified)| {
                    verified
                        .as_ref()
                        .is_some_and(|verified| FileStat::read(&file.path) == Some(verified.stamp))
                })
            })
        })
    }

    /// Returns the nodes of the outputs, without outputs whose files are all up to date. To find these, calls `is_right` with the name of
    /// each output and a hash of its data.
    fn nodes_except(
        &self,
        outputs: &[&GraphOutput],
        graph: &Graph,
        catalog: &Catalog,
        evaluator: &mut Evaluator,
        is_right: impl Fn(&str, Hash) -> bool,
    ) -> Vec<usize> {
        let nodes: Vec<_> = outputs.iter().map(|output| output.node).collect();
        let known = evaluator.predict(graph, &nodes);
        let provenance = self.writes_provenance.then(|| ProvenanceBuilder::new(graph, catalog));
        let is_up_to_date = |output: &&&GraphOutput| {
            known.hash(output.node, output.output).is_some_and(|value| {
                let signature = provenance
                    .as_ref()
                    .map(|it| it.signature(output, |node| known.files_read_by(node)));
                is_right(&output.name, source_hash(value, signature.as_ref()))
            })
        };
        outputs.iter().filter(|output| !is_up_to_date(output)).map(|output| output.node).collect()
    }

    /// Writes outputs in parallel until the run is cancelled. Outputs of failed nodes are skipped, because their errors are reported
    /// elsewhere. If a file cannot be written, its previous version stays.
    pub(super) fn write(
        &self,
        outputs: &[&GraphOutput],
        evaluation: &Evaluation,
        graph: &Graph,
        catalog: &Catalog,
        evaluator: &Evaluator,
        cancel: &CancelToken,
    ) -> WriteResult {
        let folders: BTreeSet<PathBuf> =
            outputs.iter().map(|output| self.folder_of(output)).collect();
        let mut sources = Sources::of_graph(graph);
        sources.extend(&self.kept);
        let destination = self.destination(&sources);
        folders.iter().for_each(|folder| destination.sweep(folder));
        let provenance = self.writes_provenance.then(|| ProvenanceBuilder::new(graph, catalog));
        let signature = |output: &GraphOutput| {
            Some(provenance.as_ref()?.signature(output, |it| evaluation.files_read_by(it)))
        };
        let results: Vec<_> = evaluator.install(|| {
            outputs
                .par_iter()
                .map(|output| match cancel.is_cancelled() {
                    true => Ok(Vec::new()),
                    false => self.write_output(
                        output,
                        evaluation,
                        graph,
                        signature(output),
                        &destination,
                    ),
                })
                .collect()
        });
        let mut result = WriteResult::default();
        let mut writers: BTreeMap<PathBuf, &str> = BTreeMap::new();
        for (output, written) in outputs.iter().zip(results) {
            match written {
                Ok(written) => {
                    // Look for other outputs with the same files only now: the names of an output's files are known only after writing.
                    let others: Vec<_> = written
                        .iter()
                        .filter_map(|file| writers.insert(file.path.clone(), &output.name))
                        .collect();
                    result.diagnostics.extend(others.first().map(|it| shared_file(output, it)));
                    if !written.is_empty() {
                        result.diagnostics.extend(self.warnings(output));
                    }
                    result.files.extend(written);
                }
                Err(unwritten) => {
                    result.is_refused |= unwritten.is_refused;
                    result.diagnostics.push(*unwritten.diagnostic);
                }
            }
        }
        result
    }

    /// Returns the stored warnings about the files of an output that is already up to date.
    fn warnings(&self, output: &GraphOutput) -> Vec<Diagnostic> {
        let known = self.lock();
        let warnings = known.get(&output.name).map_or(&[][..], |known| &known.warnings);
        warnings
            .iter()
            .map(|warning| {
                let place = (output.source.clone(), output.span);
                let message = format!("`{}`: {warning}", output.name);
                Diagnostic::new(Severity::Warning, code::WARNING, place, message)
            })
            .collect()
    }

    fn write_output(
        &self,
        output: &GraphOutput,
        evaluation: &Evaluation,
        graph: &Graph,
        signature: Option<Signature>,
        destination: &Destination<'_>,
    ) -> Result<Vec<OutputFile>, OutputError> {
        let Some(value) = evaluation.hash(output.node, output.output) else {
            return Ok(Vec::new());
        };
        let made_of = source_hash(value, signature.as_ref());
        if let Some(files) = self.unchanged_files(&output.name, made_of) {
            return Ok(files);
        }
        let mut start = Instant::now();
        let files = match evaluation.contents(output, signature.as_ref()) {
            None => return Ok(Vec::new()),
            Some(files) => files.map_err(|error| OutputError::encoding(output, &error))?,
        };
        if let Some((name, _)) = files.iter().find(|(name, _)| {
            let path = self.path_of(output, name);
            path != self.folder.join(&output.name)
                && graph.outputs().iter().any(|other| self.folder.join(&other.name) == path)
        }) {
            let message = format!("`{}` also writes {name}, another output", output.name);
            return Err(OutputError::new(output, message, "rename one of the two outputs"));
        }
        // Keep the state of the previous files until the new files are written.
        let mut last = self.take_rewrite_states(&output.name);
        let is_again = !last.is_empty();
        last.resize_with(files.len(), Default::default);
        let (mut written, mut again) = (Vec::new(), Vec::new());
        for ((name, content), (last, verified)) in files.into_iter().zip(&mut last) {
            let path = self.path_of(output, &name);
            let known = is_again.then_some(&last.pieces);
            let there = verified.as_ref().filter(|_| !last.pieces.is_empty());
            let there = there.map(|verified| (verified.stamp, last.pieces.clone()));
            let over = PreviousFiles { there, recycled: last.recycled.take() };
            // Catch panics, because encoding runs code of a file format from a pack.
            let file = catch_panic(|| {
                Ok(self.write_file(&output.name, path.clone(), &content, known, over, destination))
            });
            let (file, verified, known) = file.map_err(|error| OutputError::encoding(output, &error))?.map_err(|refused| {
                let help = match refused {
                    WriteError::System(_) => {
                        "the file that was there before is untouched; --out chooses another folder"
                    }
                    _ => "--out chooses another folder",
                };
                let message = format!("cannot write {}: {refused}", path.display());
                let is_refused = !matches!(refused, WriteError::Source(_));
                OutputError { is_refused, ..OutputError::new(output, message, help) }
            })?;
            let seconds = start.elapsed().as_secs_f64();
            start = Instant::now();
            written.push((OutputFile { seconds, ..file }, verified));
            again.push(RewriteState { kept: content.into_cached_data(), ..known });
        }
        let files = written.iter().map(|(file, _)| file.clone()).collect();
        let value = evaluation.value(output.node, output.output);
        let warnings = value.map_or(Vec::new(), |value| output.format.warnings(value));
        self.lock().insert(
            output.name.clone(),
            KnownOutput { made_of, files: written, warnings, rewrite_states: again },
        );
        Ok(files)
    }

    /// Takes the state that makes it faster to write the files of an output again, with the metadata of each file. The list is empty if
    /// this process has not written the files.
    fn take_rewrite_states(&self, output: &str) -> Vec<(RewriteState, Option<VerifiedStamp>)> {
        let mut known = self.lock();
        let Some(KnownOutput { files, rewrite_states: again, .. }) = known.get_mut(output) else {
            return Vec::new();
        };
        take(again).into_iter().zip(files.iter().map(|(_, verified)| verified.clone())).collect()
    }

    /// Returns the files of an output if they were made from data with the hash `made_of` and have not changed since, otherwise `None`.
    fn unchanged_files(&self, output: &str, made_of: Hash) -> Option<Vec<OutputFile>> {
        let known = self.lock();
        let mut files = known.get(output).filter(|it| it.made_of == made_of)?.files.clone();
        drop(known);
        if !files.iter_mut().all(|(file, verified): &mut (OutputFile, Option<VerifiedStamp>)| {
            verified.as_mut().is_some_and(|verified| verified.is_unchanged(file))
        }) {
            return None;
        }
        let unchanged = files
            .iter()
            .map(|(file, _)| OutputFile { unchanged: true, seconds: 0.0, ..file.clone() })
            .collect();
        if let Some(known) = self.lock().get_mut(output).filter(|it| it.made_of == made_of) {
            known.files = files;
        }
        Some(unchanged)
    }

    fn write_file(
        &self,
        output: &str,
        path: PathBuf,
        content: &Content<'_>,
        known: Option<&Pieces>,
        last: PreviousFiles<Pieces>,
        destination: &Destination<'_>,
    ) -> Result<(OutputFile, Option<VerifiedStamp>, RewriteState), WriteError> {
        destination.check(&path)?;
        let there = content.as_bytes().and_then(|bytes| Some((holds(&path, bytes)?, bytes)));
        let unchanged = there.is_some();
        let (verified, hash, again) = match there {
            Some((found, bytes)) => (Some(found), Hash::compute(bytes), RewriteState::default()),
            None => {
                let Rewritten { stamp, result: (hash, pieces), recycled: spare } = destination
                    .write_again(
                        &path,
                        content.len(),
                        last,
                        |file: &mut File, there: Option<&Pieces>| {
                            content.for_each_piece(known, there, |place, piece| {
                                write_at(file, place, piece)
                            })
                        },
                    )?;
                let verified =
                    stamp.map(|stamp| VerifiedStamp { stamp, settled: stamp.is_settled() });
                (
                    verified,
                    hash,
                    RewriteState { pieces, recycled: spare, ..RewriteState::default() },
                )
            }
        };
        let (output, bytes) = (output.to_owned(), content.len());
        Ok((OutputFile { output, path, bytes, hash, unchanged, seconds: 0.0 }, verified, again))
    }

    /// Returns the path at which an output writes the file `name`.
    fn path_of(&self, output: &GraphOutput, name: &str) -> PathBuf {
        self.folder_of(output).join(name)
    }

    fn folder_of(&self, output: &GraphOutput) -> PathBuf {
        self.folder.join(Path::new(&output.name).parent().unwrap_or(Path::new("")))
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<String, KnownOutput>> {
        self.known.lock().unwrap_or_else(|broken| broken.into_inner())
    }
}

/// The files and diagnostics that result from writing outputs.
#[derive(Default)]
pub(super) struct WriteResult {
    /// The files that are up to date now.
    pub(super) files: Vec<OutputFile>,
    /// An error for each output that was not written, and warnings about parts of values that a file format cannot store.
    pub(super) diagnostics: Vec<Diagnostic>,
    /// True if the operating system or something in the folder prevented writing of a file.
    pub(super) is_refused: bool,
}

/// The error of an output that was not written.
struct OutputError {
    diagnostic: Box<Diagnostic>,
    /// True if the operating system or something in the folder prevented writing. A later attempt may then succeed.
    is_refused: bool,
}

impl OutputError {
    fn new(output: &GraphOutput, message: String, help: &str) -> Self {
        Self { diagnostic: Box::new(output_error(output, message, help)), is_refused: false }
    }

    /// Creates the error that a file format cannot encode the value of an output.
    fn encoding(output: &GraphOutput, error: &Error) -> Self {
        Self::new(output, format!("cannot write `{}`: {error}", output.name), "")
    }
}

/// Creates an error that points at the definition of an output in the graph file.
fn output_error(output: &GraphOutput, message: String, help: &str) -> Diagnostic {
    let source = (output.source.clone(), output.span);
    let diagnostic = Diagnostic::new(Severity::Error, code::FAILED, source, message);
    Diagnostic { help: help.into(), ..diagnostic }
}

/// Creates the error that an output has overwritten a file of the earlier output `other`.
fn shared_file(output: &GraphOutput, other: &str) -> Diagnostic {
    let message = format!("`{}` also writes a file that `{other}` writes", output.name);
    output_error(output, message, "rename one of the two outputs")
}

/// Returns a hash of everything from which the files of an output are made: the value and its provenance.
fn source_hash(value: Hash, signature: Option<&Signature>) -> Hash {
    match signature {
        Some(signature) => Hash::compute(&[&value.0, signature.words.as_bytes()].concat()),
        None => value,
    }
}

/// Returns the metadata of the file if its content is `bytes`. Returns `None` for a large file without comparing it, because writing it is
/// as fast as reading it.
fn holds(path: &Path, bytes: &[u8]) -> Option<VerifiedStamp> {
    const LARGE: usize = 16 << 20;
    let found = VerifiedStamp::read(path)?;
    let same_length = fs::metadata(path).is_ok_and(|it| it.len() == bytes.len() as u64);
    fn has_bytes(bytes: &[u8], path: &Path) -> bool {
        maquette_value::fs::read_no_follow(path).is_ok_and(|there| there == bytes)
    }
    (same_length && bytes.len() < LARGE && has_bytes(bytes, path)).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Writes a small file for a test. Returns true if the file already had the right bytes.
    fn write(outputs: &OutputFolder, path: &Path) -> bool {
        let file = b"ply".to_vec().into();
        let sources = Sources::default();
        let destination = Destination::anywhere(&sources);
        let (written, verified, _) = outputs
            .write_file("a", path.to_owned(), &file, None, PreviousFiles::default(), &destination)
            .unwrap();
        let unchanged = written.unchanged;
        let files = vec![(written, verified)];
        let (made_of, warnings, again) = (Hash::compute(b"value"), Vec::new(), Vec::new());
        let known = KnownOutput { made_of, files, warnings, rewrite_states: again };
        outputs.lock().insert("a".into(), known);
        unchanged
    }

    #[test]
    fn a_file_with_the_right_bytes_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let outputs = OutputFolder::new(Some(folder.path()), Path::new("a.ron"));
        assert!(!write(&outputs, &path));
        assert!(write(&outputs, &path));
        fs::write(&path, "plx").unwrap();
        assert!(!write(&outputs, &path));
    }

    /// Replaces the stored metadata of a file by its present metadata, marked as unable to prove that the file is unchanged.
    fn unsettle(outputs: &OutputFolder, path: &Path) {
        let stamp = FileStat::read(path).map(|stamp| VerifiedStamp { stamp, settled: false });
        outputs.lock().get_mut("a").unwrap().files[0].1 = stamp;
    }

    #[test]
    fn a_file_with_an_unsettled_stamp_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let outputs = OutputFolder::new(Some(folder.path()), Path::new("a.ron"));
        fn is_right(outputs: &OutputFolder) -> bool {
            outputs.unchanged_files("a", Hash::compute(b"value")).is_some()
        }
        write(&outputs, &path);
        assert!(is_right(&outputs));
        // Simulate a write within the resolution of the file system's clock: the metadata does not show the change.
        fs::write(&path, "plx").unwrap();
        unsettle(&outputs, &path);
        assert!(!is_right(&outputs));
        fs::write(&path, "ply").unwrap();
        let old = std::time::SystemTime::now() - std::time::Duration::from_secs(60);
        File::options().append(true).open(&path).unwrap().set_modified(old).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(150));
        unsettle(&outputs, &path);
        assert!(is_right(&outputs));
        let settled = outputs.lock()["a"].files[0].1.as_ref().map(|verified| verified.settled);
        assert_eq!(settled, Some(true), "the file need not be read again");
    }
}
