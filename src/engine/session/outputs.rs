//! Writes the outputs of a graph: each file appears whole or not at all.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::{self, File};
use std::io;
use std::mem::take;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};
use std::time::Instant;

use maquette_graph::catalog::Catalog;
use maquette_graph::stamp::Stamp;
use maquette_graph::{Graph, GraphOutput};
use maquette_node::CancelToken;
use maquette_node::pack::{Content, Kept, NewFile, Pieces};
use maquette_node::provenance::Signature;
use maquette_syntax::error::{Problem, Severity, code};
use maquette_value::Hash;
use maquette_value::parallel::*;
use maquette_value::plain;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::provenance::Teller;
use crate::eval::{Evaluation, Evaluator, or_panic};
use crate::writing::{Destination, Last, Refused, Rewritten, Sources, Spare, write_at};

/// A file of an output that is on disk now.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Written {
    /// The name of the output.
    pub output: String,
    /// Where the file is.
    pub path: PathBuf,
    /// How many bytes it has.
    pub bytes: usize,
    /// The hash of its content.
    pub hash: Hash,
    /// It was there already, with these bytes.
    pub unchanged: bool,
    /// How long this run took to make and to write it.
    #[serde(skip)]
    pub seconds: f64,
}

impl Written {
    /// The file as `--json` prints it.
    pub fn to_json(&self) -> serde_json::Value {
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
pub struct OutputFolder {
    folder: PathBuf,
    /// The user named the folder, so that it may be anywhere.
    named: bool,
    /// Files tell where they came from.
    signs: bool,
    /// Files that are not replaced, beside those of the graph.
    kept: Sources,
    /// By output: what its files were made of, and they, each as it was left.
    known: Mutex<HashMap<String, Known>>,
}

#[derive(Serialize, Deserialize)]
struct Known {
    /// What they were made of: the value, and what they tell of it.
    made_of: Hash,
    /// Each as it was left; none if somebody changed it while it was written.
    files: Vec<(Written, Option<Left>)>,
    /// What they cannot tell of the value, in words.
    doubts: Vec<String>,
    /// What makes it cheap to write them again.
    #[serde(skip)]
    again: Vec<Again>,
}

/// What is known of a large file while this process may write it again.
#[derive(Default)]
struct Again {
    pieces: Pieces,
    #[expect(dead_code, reason = "others find it as long as it is there")]
    kept: Kept,
    /// The file that it replaced.
    spare: Option<Spare<Pieces>>,
}

/// A file as it was when it was last known to be right.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Left {
    stamp: Stamp,
    /// Whether any later write gives another stamp; if not, an equal stamp does not prove that the file is unchanged.
    settled: bool,
}

impl Left {
    pub fn at(path: &Path) -> Option<Self> {
        let stamp = Stamp::of(path)?;
        Some(Self { stamp, settled: stamp.is_settled() })
    }

    /// Whether the file is as it was left.
    fn is_there(&mut self, file: &Written) -> bool {
        self.holds(&file.path, file.hash)
    }

    /// Whether the file at this path is as it was left, with this content: of a young one its content decides. Then it is known better
    /// from now on.
    pub fn holds(&mut self, path: &Path, content: Hash) -> bool {
        if Stamp::of(path) != Some(self.stamp) {
            return false;
        }
        if self.settled {
            return true;
        }
        let settled = self.stamp.is_settled();
        let is_right = plain::read_own(path).is_ok_and(|it| Hash::of(&it) == content);
        self.settled = settled && is_right;
        is_right
    }

    /// Whether its stamp alone proves that it is as it was.
    pub fn is_settled(&self) -> bool {
        self.settled
    }
}

/// `out/doll` for `graphs/doll.ron`.
fn default_folder(graph: &Path) -> PathBuf {
    Path::new("out").join(graph.file_stem().unwrap_or_default())
}

impl OutputFolder {
    /// The folder that the user named, else `out/GRAPH` in the current one.
    pub fn new(folder: Option<&Path>, graph: &Path) -> Self {
        let named = folder.is_some();
        let folder = folder.map_or_else(|| default_folder(graph), Path::to_owned);
        Self { folder, named, signs: true, kept: Sources::default(), known: Mutex::default() }
    }

    /// The folder of a task's outputs, in one that the user named or not.
    pub fn of_task(folder: &Path, named: bool, signs: bool) -> Self {
        Self { named, signs, ..Self::new(Some(folder), folder) }
    }

    /// The same, whose files do not tell where they came from.
    #[must_use]
    pub fn without_provenance(self) -> Self {
        Self { signs: false, ..self }
    }

    /// The folder that the user named, else `out/GRAPH-draft`: what is only a draft must not lie where a final result is looked for.
    pub fn of_draft(folder: Option<&Path>, graph: &Path) -> Self {
        let mut name = graph.file_stem().unwrap_or_default().to_owned();
        name.push("-draft");
        Self {
            folder: folder.map_or_else(|| Path::new("out").join(name), Path::to_owned),
            ..Self::new(folder, graph)
        }
    }

    /// The same, which never replaces these files.
    #[must_use]
    pub fn keeping<'a>(mut self, files: impl Iterator<Item = &'a Path>) -> Self {
        files.for_each(|file| self.kept.add(file, "it is an input"));
        self
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.folder
    }

    /// Where they may be written: in their folder, which must not lead elsewhere if nobody named it.
    pub fn destination<'a>(&self, sources: &'a Sources) -> Destination<'a> {
        match self.named {
            true => Destination::folder(&self.folder, sources),
            false => Destination::inside(Path::new("."), &self.folder, sources),
        }
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
        let known = self.lock();
        if let (Some(disk), Ok(note)) = (evaluator.disk(), serde_json::to_vec(&*known)) {
            // What is written over an older file would have the right length and time, if the machine stopped before it is on disk.
            let files = known.values().flat_map(|known| known.files.iter().zip(&known.again));
            let over = files.filter(|(_, again)| !again.pieces.is_empty());
            let over = over.map(|((file, _), _)| file.path.clone()).collect();
            disk.keep_note(&self.folder, note, over);
        }
    }

    /// Removes what was kept beside large files to write them again.
    pub fn let_go(&self) {
        self.lock().values_mut().for_each(|known| known.again.clear());
    }

    /// The nodes whose values must be had to write these outputs: not those of files that are known to be right.
    pub(super) fn nodes_to_write(
        &self,
        outputs: &[&GraphOutput],
        graph: &Graph,
        catalog: &Catalog,
        evaluator: &mut Evaluator,
    ) -> Vec<usize> {
        self.nodes_unless(outputs, graph, catalog, evaluator, |name, made_of| {
            self.still_there(name, made_of).is_some()
        })
    }

    /// The same as far as the stamps of files tell, without reading any.
    pub(super) fn nodes_to_write_by_stamps(
        &self,
        outputs: &[&GraphOutput],
        graph: &Graph,
        catalog: &Catalog,
        evaluator: &mut Evaluator,
    ) -> Vec<usize> {
        self.nodes_unless(outputs, graph, catalog, evaluator, |name, made_of| {
            let known = self.lock();
            let files = known.get(name).filter(|known| known.made_of == made_of);
            files.is_some_and(|known| {
                known.files.iter().all(|(file, left)| {
                    left.as_ref().is_some_and(|left| Stamp::of(&file.path) == Some(left.stamp))
                })
            })
        })
    }

    /// The nodes of outputs, but not of those whose files, made of a value and what they tell of it, are right.
    fn nodes_unless(
        &self,
        outputs: &[&GraphOutput],
        graph: &Graph,
        catalog: &Catalog,
        evaluator: &mut Evaluator,
        is_right: impl Fn(&str, Hash) -> bool,
    ) -> Vec<usize> {
        let nodes: Vec<_> = outputs.iter().map(|output| output.node).collect();
        let known = evaluator.foreseen(graph, &nodes);
        let teller = self.signs.then(|| Teller::new(graph, catalog));
        let is_known = |output: &&&GraphOutput| {
            known.hash(output.node, output.output).is_some_and(|value| {
                let told =
                    teller.as_ref().map(|it| it.signature(output, |node| known.read_by(node)));
                is_right(&output.name, made_of(value, told.as_ref()))
            })
        };
        outputs.iter().filter(|output| !is_known(output)).map(|output| output.node).collect()
    }

    /// Writes outputs in parallel; those whose nodes failed are left out, because that has been reported. What cannot be
    /// written is a problem; the file that was there before stays. What files cannot tell is a warning. Stops early if cancelled. Says,
    /// too, whether the system refused a file.
    pub(super) fn write(
        &self,
        outputs: &[&GraphOutput],
        evaluation: &Evaluation,
        graph: &Graph,
        catalog: &Catalog,
        evaluator: &Evaluator,
        cancel: &CancelToken,
    ) -> (Vec<Written>, Vec<Problem>, bool) {
        let folders: BTreeSet<PathBuf> =
            outputs.iter().map(|output| self.folder_of(output)).collect();
        let mut sources = Sources::of(graph);
        sources.extend(&self.kept);
        let destination = self.destination(&sources);
        folders.iter().for_each(|folder| destination.sweep(folder));
        let teller = self.signs.then(|| Teller::new(graph, catalog));
        let signature = |output: &GraphOutput| {
            Some(teller.as_ref()?.signature(output, |it| evaluation.read_by(it)))
        };
        let results: Vec<_> = evaluator.install(|| {
            outputs
                .par_iter()
                .map(|output| match cancel.is_cancelled() {
                    true => Ok(Vec::new()),
                    false => {
                        self.output(output, evaluation, graph, signature(output), &destination)
                    }
                })
                .collect()
        });
        let (mut files, mut problems, mut is_refused) = (Vec::new(), Vec::new(), false);
        let mut writers: BTreeMap<PathBuf, &str> = BTreeMap::new();
        for (output, result) in outputs.iter().zip(results) {
            match result {
                Ok(written) => {
                    // Names of files beside an output are known once it is written.
                    let others: Vec<_> = written
                        .iter()
                        .filter_map(|file| writers.insert(file.path.clone(), &output.name))
                        .collect();
                    problems.extend(others.first().map(|other| shared_file(output, other)));
                    problems.extend(written.first().into_iter().flat_map(|_| self.doubts(output)));
                    files.extend(written);
                }
                Err(unwritten) => {
                    is_refused |= unwritten.is_refused;
                    problems.push(*unwritten.problem);
                }
            }
        }
        (files, problems, is_refused)
    }

    /// What the files of an output, which are right now, cannot tell of its value.
    fn doubts(&self, output: &GraphOutput) -> Vec<Problem> {
        let known = self.lock();
        let doubts = known.get(&output.name).map_or(&[][..], |known| &known.doubts);
        doubts
            .iter()
            .map(|doubt| {
                let place = (output.source.clone(), output.span);
                let message = format!("`{}`: {doubt}", output.name);
                Problem::new(Severity::Warning, code::WARNING, place, message)
            })
            .collect()
    }

    fn output(
        &self,
        output: &GraphOutput,
        evaluation: &Evaluation,
        graph: &Graph,
        signature: Option<Signature>,
        destination: &Destination<'_>,
    ) -> Result<Vec<Written>, Unwritten> {
        let Some(value) = evaluation.hash(output.node, output.output) else {
            return Ok(Vec::new());
        };
        let made_of = made_of(value, signature.as_ref());
        if let Some(files) = self.still_there(&output.name, made_of) {
            return Ok(files);
        }
        fn problem(
            message: String,
            help: &str,
            output_source: &std::sync::Arc<maquette_syntax::Source>,
            output_span: &maquette_syntax::Span,
        ) -> Unwritten {
            let place = (output_source.clone(), *output_span);
            let problem = Problem::new(Severity::Error, code::FAILED, place, message);
            let problem = Box::new(Problem { help: help.into(), ..problem });
            Unwritten { problem, is_refused: false }
        }
        let mut start = Instant::now();
        let cannot = |error| {
            problem(
                format!("cannot write `{}`: {error}", output.name),
                "",
                &output.source,
                &output.span,
            )
        };
        let files = match evaluation.contents(output, signature.as_ref()) {
            None => return Ok(Vec::new()),
            Some(files) => files.map_err(cannot)?,
        };
        let path = |name: &str| self.folder_of(output).join(name);
        if let Some((name, _)) = files.iter().find(|(name, _)| {
            path(name) != self.folder.join(&output.name)
                && graph.outputs().iter().any(|other| self.folder.join(&other.name) == path(name))
        }) {
            let message = format!("`{}` also writes {name}, another output", output.name);
            return Err(problem(
                message,
                "give one of the two outputs another name",
                &output.source,
                &output.span,
            ));
        }
        // What was kept for the last files is there until those of now are made of it.
        let mut last = self.take_again(&output.name);
        let is_again = !last.is_empty();
        last.resize_with(files.len(), Default::default);
        let (mut written, mut again) = (Vec::new(), Vec::new());
        for ((name, content), (last, left)) in files.into_iter().zip(&mut last) {
            let path = path(&name);
            let known = is_again.then_some(&last.pieces);
            let there = left.as_ref().filter(|_| !last.pieces.is_empty());
            let there = there.map(|left| (left.stamp, last.pieces.clone()));
            let over = Last { there, spare: last.spare.take() };
            // What is made while it is written is still the format's own code.
            let file = or_panic(|| {
                Ok(self.file(&output.name, path.clone(), &content, known, over, destination))
            });
            let (file, left, known) = file.map_err(cannot)?.map_err(|refused| {
                let help = match refused {
                    Refused::System(_) => {
                        "the file that was there before is untouched; --out chooses another folder"
                    }
                    _ => "--out chooses another folder",
                };
                let message = format!("cannot write {}: {refused}", path.display());
                let is_refused = !matches!(refused, Refused::Source(_));
                Unwritten { is_refused, ..problem(message, help, &output.source, &output.span) }
            })?;
            let seconds = start.elapsed().as_secs_f64();
            start = Instant::now();
            written.push((Written { seconds, ..file }, left));
            again.push(Again { kept: content.into_kept(), ..known });
        }
        let files = written.iter().map(|(file, _)| file.clone()).collect();
        let value = evaluation.value(output.node, output.output);
        let doubts = value.map_or(Vec::new(), |value| output.format.doubts(value));
        self.lock().insert(output.name.clone(), Known { made_of, files: written, doubts, again });
        Ok(files)
    }

    /// What makes it cheap to write the files of an output again, and how each was left; nothing if this process has not written them.
    fn take_again(&self, output: &str) -> Vec<(Again, Option<Left>)> {
        let mut known = self.lock();
        let Some(Known { files, again, .. }) = known.get_mut(output) else { return Vec::new() };
        take(again).into_iter().zip(files.iter().map(|(_, left)| left.clone())).collect()
    }

    /// The files of an output if they were made of this and nobody has changed them since.
    fn still_there(&self, output: &str, made_of: Hash) -> Option<Vec<Written>> {
        let known = self.lock();
        let mut files = known.get(output).filter(|it| it.made_of == made_of)?.files.clone();
        drop(known);
        if !files.iter_mut().all(|(file, left): &mut (Written, Option<Left>)| {
            left.as_mut().is_some_and(|left| left.is_there(file))
        }) {
            return None;
        }
        let unchanged =
            |(file, _): &(Written, _)| Written { unchanged: true, seconds: 0.0, ..file.clone() };
        let unchanged = files.iter().map(unchanged).collect();
        if let Some(known) = self.lock().get_mut(output).filter(|it| it.made_of == made_of) {
            known.files = files;
        }
        Some(unchanged)
    }

    fn file(
        &self,
        output: &str,
        path: PathBuf,
        content: &Content<'_>,
        known: Option<&Pieces>,
        last: Last<Pieces>,
        destination: &Destination<'_>,
    ) -> Result<(Written, Option<Left>, Again), Refused> {
        destination.judge(&path)?;
        let there = content.as_bytes().and_then(|bytes| Some((holds(&path, bytes)?, bytes)));
        let unchanged = there.is_some();
        let (left, hash, again) = match there {
            Some((found, bytes)) => (Some(found), Hash::of(bytes), Again::default()),
            None => {
                let Rewritten { stamp, told: (hash, pieces), spare } = destination.write_again(
                    &path,
                    content.len(),
                    last,
                    |file: &mut File, there: Option<&Pieces>| {
                        content.each(known, there, |place, piece| write_at(file, place, piece))
                    },
                )?;
                let left = stamp.map(|stamp| Left { stamp, settled: stamp.is_settled() });
                (left, hash, Again { pieces, spare, ..Again::default() })
            }
        };
        let (output, bytes) = (output.to_owned(), content.len());
        Ok((Written { output, path, bytes, hash, unchanged, seconds: 0.0 }, left, again))
    }

    fn folder_of(&self, output: &GraphOutput) -> PathBuf {
        self.folder.join(Path::new(&output.name).parent().unwrap_or(Path::new("")))
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<String, Known>> {
        self.known.lock().unwrap_or_else(|broken| broken.into_inner())
    }
}

/// Why an output was not written.
struct Unwritten {
    problem: Box<Problem>,
    /// Whether the system, or what is in the folder, refused it: then it may be written another time.
    is_refused: bool,
}

/// The error about an output that has replaced a file of an output before it.
fn shared_file(output: &GraphOutput, other: &str) -> Problem {
    let message = format!("`{}` also writes a file that `{other}` writes", output.name);
    let place = (output.source.clone(), output.span);
    let problem = Problem::new(Severity::Error, code::FAILED, place, message);
    Problem { help: "give one of the two outputs another name".into(), ..problem }
}

/// What files are made of: a value, and what they tell of it.
fn made_of(value: Hash, signature: Option<&Signature>) -> Hash {
    match signature {
        Some(signature) => Hash::of(&[&value.0, signature.words.as_bytes()].concat()),
        None => value,
    }
}

/// Whether a file holds these bytes, and how it was found; not asked of large files, because writing them takes no longer than
/// reading them.
fn holds(path: &Path, bytes: &[u8]) -> Option<Left> {
    const LARGE: usize = 16 << 20;
    let found = Left::at(path)?;
    let same_length = fs::metadata(path).is_ok_and(|it| it.len() == bytes.len() as u64);
    fn same(bytes: &[u8], path: &Path) -> bool {
        plain::read_own(path).is_ok_and(|there| there == bytes)
    }
    (same_length && bytes.len() < LARGE && same(bytes, path)).then_some(found)
}

/// Writes the files of a value, as [`Catalog::write`](maquette_graph::catalog::Catalog::write) gives them, beside each other to where `path` is: each whole
/// or not at all, none if one may not be written, and only plain files are replaced. Gives their paths.
///
/// # Errors
/// Which file, and why.
pub fn save(files: Vec<NewFile>, path: &Path) -> Result<Vec<PathBuf>, SaveError> {
    let files = files.into_iter().map(|file| (path.with_file_name(&file.name), file.bytes));
    let files = Vec::from_iter(files);
    match Destination::anywhere(&Sources::default()).put_all(&files) {
        Ok(()) => Ok(files.into_iter().map(|(path, _)| path).collect()),
        Err((path, why)) => Err(SaveError { path, why }),
    }
}

/// Returns the POSIX code of an error of a temporary file, which has a kind alone.
fn code_of(kind: io::ErrorKind) -> Option<i32> {
    Some(match kind {
        io::ErrorKind::NotFound => 2,
        io::ErrorKind::PermissionDenied => ACCESS_DENIED,
        io::ErrorKind::AlreadyExists => 17,
        io::ErrorKind::NotADirectory => 20,
        io::ErrorKind::IsADirectory => 21,
        io::ErrorKind::StorageFull => 28,
        io::ErrorKind::ReadOnlyFilesystem => 30,
        _ => return None,
    })
}

/// A file that could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {why}", .path.display())]
pub struct SaveError {
    /// Its path.
    pub path: PathBuf,
    why: Refused,
}

/// `EACCES` of every system.
const ACCESS_DENIED: i32 = 13;

impl SaveError {
    /// The code of the system's error, if the system refused it.
    pub fn system_code(&self) -> Option<i32> {
        match &self.why {
            Refused::System(error) => error.raw_os_error().or_else(|| code_of(error.kind())),
            Refused::ReadOnly => Some(ACCESS_DENIED),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What `write` does, and whether the file was there already.
    fn write(outputs: &OutputFolder, path: &Path) -> bool {
        let file = b"ply".to_vec().into();
        let sources = Sources::default();
        let destination = Destination::anywhere(&sources);
        let (written, left, _) =
            outputs.file("a", path.to_owned(), &file, None, Last::default(), &destination).unwrap();
        let unchanged = written.unchanged;
        let files = vec![(written, left)];
        let (made_of, doubts, again) = (Hash::of(b"value"), Vec::new(), Vec::new());
        let known = Known { made_of, files, doubts, again };
        outputs.lock().insert("a".into(), known);
        unchanged
    }

    #[test]
    fn a_file_that_holds_the_bytes_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let outputs = OutputFolder::new(Some(folder.path()), Path::new("a.ron"));
        assert!(!write(&outputs, &path));
        assert!(write(&outputs, &path));
        fs::write(&path, "plx").unwrap();
        assert!(!write(&outputs, &path));
    }

    #[test]
    fn a_file_that_was_just_written_is_read_before_it_is_believed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let outputs = OutputFolder::new(Some(folder.path()), Path::new("a.ron"));
        fn is_right(outputs: &OutputFolder) -> bool {
            outputs.still_there("a", Hash::of(b"value")).is_some()
        }
        write(&outputs, &path);
        assert!(is_right(&outputs));
        // Within the clock's grain, as far as a stamp tells.
        fs::write(&path, "plx").unwrap();
        let stamp = Stamp::of(&path);
        outputs
            .lock()
            .get_mut("a")
            .map(|known: &mut Known| {
                known.files[0].1 = stamp.map(|stamp| Left { stamp, settled: false });
            })
            .unwrap();
        assert!(!is_right(&outputs));
        fs::write(&path, "ply").unwrap();
        let old = std::time::SystemTime::now() - std::time::Duration::from_secs(60);
        File::options().append(true).open(&path).unwrap().set_modified(old).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(150));
        let stamp = Stamp::of(&path);
        outputs
            .lock()
            .get_mut("a")
            .map(|known: &mut Known| {
                known.files[0].1 = stamp.map(|stamp| Left { stamp, settled: false });
            })
            .unwrap();
        assert!(is_right(&outputs));
        let settled = outputs.lock()["a"].files[0].1.as_ref().map(|left| left.settled);
        assert_eq!(settled, Some(true), "the next look needs no reading");
    }
}
