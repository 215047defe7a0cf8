//! Runs tasks, except those whose record is up to date.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use maquette_engine::eval::{Forecast, Observer, RunTrace, State as NodeState};
use maquette_engine::session::{
    OutputFolder, ReadFiles, Run, RunResult, Session, Targets, VerifiedStamp,
};
use maquette_engine::writing::{Destination, Sources};
use maquette_golden::sweep::file::options_with;
use maquette_golden::sweep::{Picture, Sweep, Task};
use maquette_graph::{Graph, Options};
use maquette_node::CancelToken;
use maquette_render::{Look, Representation, View, picture};
use maquette_syntax::error::{Diagnostic, Severity, Span, code, merge_diagnostics};
use maquette_value::Hash;

use super::record::{Output, Record, State, picture_path, write_error};
use super::time_limit::{TimeLimit, format_time};
use crate::has_errors;

/// The quality of JPEG pictures, from 1 to 100. At the size of the pictures no artifacts are visible with this value.
const QUALITY: u8 = 88;

/// The tasks of a sweep, with the folder for their results and the options for running them.
pub(crate) struct Batch<'a> {
    pub(crate) sweep: &'a Sweep,
    /// The folder for results.
    pub(crate) out: &'a Path,
    /// True if the user has given the folder explicitly.
    pub(crate) is_chosen_folder: bool,
    /// The options for loading graphs.
    pub(crate) options: &'a Options,
    /// True if the provenance is written into output files.
    pub(crate) has_provenance: bool,
    /// True if failed tasks run again even if nothing changed.
    pub(crate) retries_failures: bool,
    /// The maximum time for one task, or `None` without a limit.
    pub(crate) time_limit: Option<Duration>,
    /// The hash of the list of tasks that was handed over to a farm. `None` if this is not a job of a farm.
    pub(crate) handover: Option<&'a str>,
    /// True if tasks are only examined and not run. Then large files are not read.
    pub(crate) is_forecast: bool,
}

/// The state of a task before it is run: up to date or due.
pub(crate) enum TaskStatus {
    /// The task has this record, which is up to date.
    Holds(Box<Record>),
    /// The task must be run.
    Due(Box<DueTask>),
}

/// A task that must be run.
pub(crate) struct DueTask {
    /// The reason for running the task.
    pub(crate) reason: String,
    /// The graph of the task, if it was loaded to find out that the task must be run.
    loaded: Option<LoadedTask>,
}

/// The graph of a task, or the errors that prevent loading it.
struct LoadedTask {
    graph: Option<Graph>,
    diagnostics: Vec<Diagnostic>,
    /// A hash of the task, and the task's input files with their hashes. `None` if an input file cannot be read.
    identity: Option<(Hash, ReadFiles)>,
}

impl Batch<'_> {
    fn load(&self, session: &Session, task: &Task) -> LoadedTask {
        let checked = session.load(&self.sweep.graph, &options_with(&task.row.set, self.options));
        let checked = checked.without_missing_files();
        let graph = checked.graph.or(checked.partial);
        let made_of = graph.as_ref().and_then(|graph| {
            let files = session.files_of(graph, &task.row.inputs, self.is_forecast)?;
            let Picture { output, camera, zoom, size } = &self.sweep.picture;
            let shown = format!("{output:?} {camera:?} {zoom:?} {size:?} {}", self.has_provenance);
            let key = format!("{} {} {shown}", session.build(), session.graph_identity(graph));
            Some((Hash::compute(key.as_bytes()), files))
        });
        LoadedTask { graph, diagnostics: checked.diagnostics, identity: made_of }
    }

    /// Determines if a task is up to date or must be run.
    pub(crate) fn status(&self, session: &Session, task: &Task) -> TaskStatus {
        let Some(mut record) = Record::read(self.out, &task.name) else {
            let reason = "it has not been run".to_owned();
            return TaskStatus::Due(DueTask { reason, loaded: None }.into());
        };
        session.remember_files(std::mem::take(&mut record.as_read));
        let loaded = self.load(session, task);
        match self.find_change(&mut record, &loaded) {
            Some(reason) => TaskStatus::Due(DueTask { reason, loaded: Some(loaded) }.into()),
            None => TaskStatus::Holds(record.into()),
        }
    }

    /// Returns the reason why the record of a task is outdated, or `None` if it is up to date.
    fn find_change(&self, record: &mut Record, loaded: &LoadedTask) -> Option<String> {
        let Some((key, files)) = &loaded.identity else {
            return Some("a file cannot be read".to_owned());
        };
        if Some(*key) != record.key {
            return Some("the graph, its values or the program changed".to_owned());
        }
        let changed =
            files.by_name.iter().find(|(name, hash)| record.files.get(*name) != Some(*hash));
        if let Some((name, _)) = changed {
            return Some(format!("`{name}` changed"));
        }
        if let Some(name) = &files.first_unread {
            return Some(format!("`{name}` may have changed and was not read"));
        }
        if record.state == State::Failed {
            let why = match (self.retries_failures, record.may_succeed_later) {
                (_, true) => {
                    "it failed because memory, disk space, time or access to a file was missing"
                }
                (true, false) => "it failed",
                (false, false) => return None,
            };
            return Some(why.to_owned());
        }
        record.as_read.clone_from(&files.stamps);
        let what = self.find_changed_file(record)?;
        Some(format!("{what} was changed after the run"))
    }

    /// Looks for an output or picture that was changed after the run, and returns a description of the first. If no file was changed,
    /// updates the recorded metadata of files that were too new for their modification times to be reliable. Then the next check need not
    /// read these files.
    fn find_changed_file(&self, record: &mut Record) -> Option<String> {
        let mut is_better_known = false;
        let outputs = record.outputs.iter_mut().map(|output| (false, output));
        let picture = record.picture.iter_mut().map(|picture| (true, picture));
        for (is_picture, output) in outputs.chain(picture) {
            let path = self.out.join(&output.path);
            let before = output.stamp.as_ref().is_some_and(VerifiedStamp::is_settled);
            if !output.stamp.as_mut().is_some_and(|left| left.holds(&path, output.hash)) {
                return Some(match is_picture {
                    true => "its picture".into(),
                    false => format!("its output `{}`", output.name),
                });
            }
            is_better_known |=
                !before && output.stamp.as_ref().is_some_and(VerifiedStamp::is_settled);
        }
        if is_better_known {
            // Ignore an error: if the record cannot be written, the next check only takes longer.
            let _ = record.write(self.out, &self.destination(&Sources::default()));
        }
        None
    }

    /// Checks the outputs of a task some time after its run, when their modification times have become reliable. Then the next run of the
    /// batch need not read the outputs.
    pub(super) fn verify_outputs(&self, task: &Task) {
        if let Some(mut record) = Record::read(self.out, &task.name) {
            // Ignore a changed output here: the next run of the batch will notice it.
            let _ = self.find_changed_file(&mut record);
        }
    }

    /// Returns the forecast for each node of a task, together with a hash that identifies the node and its inputs.
    pub(crate) fn forecast(&self, session: &mut Session, task: &Task) -> Vec<(Hash, Forecast)> {
        let LoadedTask { graph: Some(graph), .. } = self.load(session, task) else {
            return Vec::new();
        };
        let known = session.known_inputs(&graph, &task.row.inputs);
        let graph = known.and_then(|(known, _)| session.bind_known_inputs(&graph, &known));
        let Ok(graph) = graph else { return Vec::new() };
        let graph = session.with_last_counts(&graph);
        let made = session.node_identities(&graph);
        let folder = self.folder_of(task);
        session.recall(&folder);
        let forecasts = session.dry_run(&graph, &[], &folder).unwrap_or_default();
        forecasts.into_iter().map(|it| (made[it.index], it)).collect()
    }

    fn bind_inputs(
        &self,
        session: &Session,
        graph: &Graph,
        task: &Task,
    ) -> Result<(Graph, Vec<Diagnostic>), Vec<Diagnostic>> {
        let (values, warnings) = session.read_inputs(graph, &task.row.inputs)?;
        Ok((session.bind_inputs(graph, &values)?, warnings))
    }

    /// Runs a task, and writes its outputs, its picture and its record. Returns `None` if the task was cancelled.
    ///
    /// # Errors
    /// A message if the record of the task cannot be written.
    pub(super) fn run(
        &self,
        session: &mut Session,
        task: &Task,
        due: DueTask,
        observer: &dyn Observer,
        limit: &TimeLimit,
    ) -> Result<Option<Record>, String> {
        let cancel = limit.token();
        let start = Instant::now();
        let loaded = due.loaded.unwrap_or_else(|| self.load(session, task));
        let LoadedTask { graph, mut diagnostics, identity: made_of } = loaded;
        let (key, files) = made_of.unzip();
        let files = files.unwrap_or_default();
        let sources = graph.as_ref().map(Sources::of_graph).unwrap_or_default();
        let fed = graph.map(|graph| self.bind_inputs(session, &graph, task));
        let mut done = TaskResult::default();
        match fed {
            None => {}
            Some(Err(wrong)) => diagnostics.extend(wrong),
            Some(Ok((graph, warnings))) => {
                diagnostics.extend(warnings);
                done = self.produce(session, task, &graph, observer, cancel);
                diagnostics = merge_diagnostics(diagnostics, std::mem::take(&mut done.diagnostics));
            }
        }
        if limit.is_over() {
            diagnostics = vec![self.timeout_error()];
            (done.picture, done.may_pass) = (None, true);
        } else if cancel.is_cancelled() {
            return Ok(None);
        }
        let destination = self.destination(&sources);
        let path = picture_path(self.out, &task.name);
        if let Some(picture) = &done.picture {
            destination.write(&path, picture).map_err(|why| write_error(&path, &why))?;
        }
        let picture = done
            .picture
            .map(|bytes| self.written_output("picture", &path, bytes.len(), Hash::compute(&bytes)));
        let has_error = has_errors(&diagnostics);
        let names = self.sweep.names.iter().cloned();
        let record = Record {
            format: 1,
            name: task.name.clone(),
            state: if has_error { State::Failed } else { State::Done },
            values: names.zip(task.row.values.iter().cloned()).collect(),
            seconds: start.elapsed().as_secs_f64(),
            may_succeed_later: has_error && done.may_pass,
            nodes: counts(&done.trace),
            outputs: done.outputs,
            picture,
            problems: diagnostics.iter().map(Diagnostic::to_json).collect(),
            key,
            files: files.by_name,
            as_read: files.stamps,
        };
        let path = super::record::record_path(self.out, &task.name);
        record.write(self.out, &destination).map_err(|why| write_error(&path, &why))?;
        Ok(Some(record))
    }

    /// Returns the error that a task has exceeded its time limit.
    fn timeout_error(&self) -> Diagnostic {
        let limit = format_time(self.time_limit.unwrap_or_default());
        let location = (self.sweep.source.clone(), Span::default());
        let message = format!("the task took longer than {limit}, its limit");
        let help = "raise --time-limit, or make the graph faster";
        Diagnostic {
            help: help.into(),
            ..Diagnostic::new(Severity::Error, code::FAILED, location, message)
        }
    }

    fn produce(
        &self,
        session: &mut Session,
        task: &Task,
        graph: &Graph,
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> TaskResult {
        let folder = self.folder_of(task);
        session.recall(&folder);
        let produced = match session.produce(graph, &[], &folder, observer, cancel) {
            Ok(produced) => produced,
            // An error is impossible, because it would be about an unknown output name, and no names are given.
            Err(_) => return TaskResult::default(),
        };
        let picture = self.picture(session, graph, cancel);
        let written = produced.written.iter();
        let outputs = written
            .map(|file| self.written_output(&file.output, &file.path, file.bytes, file.hash))
            .collect();
        let (trace, may_pass, diagnostics) =
            (produced.trace(), produced.may_succeed_later, produced.diagnostics);
        TaskResult { outputs, picture, trace, may_pass, diagnostics }
    }

    /// Returns the folder for the outputs of a task.
    fn folder_of(&self, task: &Task) -> OutputFolder {
        let inputs = task.row.inputs.iter().map(|(_, file)| &**file);
        let folder = self.out.join(&task.name);
        OutputFolder::of_task(&folder, self.is_chosen_folder, self.has_provenance).keeping(inputs)
    }

    /// Describes a file that has just been written.
    fn written_output(&self, name: &str, path: &Path, bytes: usize, hash: Hash) -> Output {
        let own = path.strip_prefix(self.out).unwrap_or(path);
        let parts = own.components().map(|part| part.as_os_str().to_string_lossy());
        Output {
            name: name.to_owned(),
            path: Vec::from_iter(parts).join("/"),
            bytes,
            hash,
            stamp: VerifiedStamp::read(path),
        }
    }

    /// Renders the picture of a task for the contact sheet. Returns `None` if the task has no visible output.
    fn picture(
        &self,
        session: &mut Session,
        graph: &Graph,
        cancel: &CancelToken,
    ) -> Option<Vec<u8>> {
        let Picture { output, camera: (yaw, pitch), zoom, size: (width, height) } =
            &self.sweep.picture;
        let targets = match output.is_empty() {
            true => graph.output_names().map(str::to_owned).collect(),
            false => vec![output.clone()],
        };
        let names: Vec<_> = targets.to_vec();
        let run =
            Run { targets: Targets::Named(targets), cancel: cancel.clone(), ..Run::default() };
        let finished = session.run(graph, &run).ok()?;
        let layers = visible_layers(&finished, &names)?;
        let size = [width.0 as usize, height.0 as usize];
        let view = View { size, yaw: *yaw, pitch: *pitch, zoom: *zoom, ..View::front() };
        let look = Look { view, representation: Representation::Fitted, backdrop: None };
        let image = session.install(|| picture(&layers, &look))?;
        let mut bytes = Vec::new();
        let encoder = JpegEncoder::new_with_quality(&mut bytes, QUALITY);
        let pixels = image.pixels().as_flattened();
        encoder.write_image(pixels, width.0, height.0, ExtendedColorType::Rgb8).ok()?;
        Some(bytes)
    }

    /// Removes temporary files that killed processes left in the folder of records. This is done once per batch, because there may be many
    /// records.
    pub(super) fn sweep_records(&self) {
        let (root, sources) = (self.out.join(super::record::FOLDER), Sources::default());
        let destination = self.destination(&sources);
        let tasks = self.sweep.tasks.iter().map(|task| Path::new(&task.name));
        let folders: BTreeSet<&Path> = tasks.flat_map(|task| task.ancestors().skip(1)).collect();
        folders.iter().for_each(|folder| destination.sweep(&root.join(folder)));
    }

    pub(super) fn destination<'s>(&self, sources: &'s Sources) -> Destination<'s> {
        match self.is_chosen_folder {
            true => Destination::folder(self.out, sources),
            false => Destination::folder_inside(Path::new("."), self.out, sources),
        }
    }
}

/// The results of a task.
#[derive(Default)]
struct TaskResult {
    outputs: Vec<Output>,
    picture: Option<Vec<u8>>,
    trace: RunTrace,
    may_pass: bool,
    diagnostics: Vec<Diagnostic>,
}

/// Returns the layers to draw: those of the first value with faces, or else those of the first visible value.
fn visible_layers(finished: &RunResult, names: &[String]) -> Option<Vec<maquette_value::Layer>> {
    let values = || names.iter().filter_map(|name| finished.value(name));
    let solid = values().find(|value| value.as_mesh().is_some()).map(|value| value.show());
    solid.or_else(|| values().map(|value| value.show()).find(|layers| !layers.is_empty()))
}

fn counts(trace: &RunTrace) -> BTreeMap<String, usize> {
    let states = [
        NodeState::Computed,
        NodeState::Equal,
        NodeState::Cached,
        NodeState::Failed,
        NodeState::Skipped,
    ];
    let counts = states.into_iter().map(|state| (state.word().to_owned(), trace.count(state)));
    counts.filter(|(_, count)| 0 < *count).collect()
}

/// Returns the default folder for results. For `graphs/doll.sweep.ron`, it is `out/doll.sweep`, or `out/doll.sweep-draft` for drafts.
pub(crate) fn default_folder(sweep: &Path, is_draft: bool) -> PathBuf {
    let mut name = sweep.file_stem().unwrap_or_default().to_owned();
    if is_draft {
        name.push("-draft");
    }
    Path::new("out").join(name)
}
