//! Runs tasks, and knows which need not be run: those with a record that still holds.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use maquette_engine::eval::{Forecast, Observer, RunTrace, State as NodeState};
use maquette_engine::session::{Finished, Left, OutputFolder, ReadFiles, Run, Session, Wanted};
use maquette_engine::writing::{Destination, Sources};
use maquette_golden::sweep::file::with;
use maquette_golden::sweep::{Picture, Sweep, Task};
use maquette_graph::{Graph, Options};
use maquette_node::CancelToken;
use maquette_render::{Kind, Look, View, picture};
use maquette_syntax::error::{Problem, Severity, Span, code, with_those_of_run};
use maquette_value::Hash;

use super::record::{Output, Record, State, picture_path, unwritten};
use super::time_limit::{TimeLimit, in_words};

/// How good the pictures of tasks are, of a hundred: noise of the compression cannot be seen at their size.
const QUALITY: u8 = 88;

/// The tasks of a sweep, in a folder of results.
pub(crate) struct Batch<'a> {
    pub(crate) sweep: &'a Sweep,
    /// Where results go.
    pub(crate) out: &'a Path,
    /// Whether the user named that folder.
    pub(crate) is_named: bool,
    /// How graphs are read.
    pub(crate) options: &'a Options,
    /// Whether outputs tell where they came from.
    pub(crate) signs: bool,
    /// Whether what failed is run again though nothing has changed.
    pub(crate) retries: bool,
    /// How long a task may take.
    pub(crate) time_limit: Option<Duration>,
    /// The hash of the list by which the tasks were handed over.
    pub(crate) handover: Option<&'a str>,
    /// Whether nothing is run: then no large files are read to know what would be.
    pub(crate) is_forecast: bool,
}

/// What is to be done for a task.
pub(crate) enum Standing {
    /// Nothing: this is what came of it.
    Holds(Box<Record>),
    /// It is run.
    Due(Box<Due>),
}

/// A task that must be run.
pub(crate) struct Due {
    /// Why.
    pub(crate) reason: String,
    /// Its graph, if that was read to find out.
    loaded: Option<Loaded>,
}

/// A task's graph, or why there is none.
struct Loaded {
    graph: Option<Graph>,
    problems: Vec<Problem>,
    /// What it would be made of; none if a file cannot be read.
    made_of: Option<(Hash, ReadFiles)>,
}

impl Batch<'_> {
    fn load(&self, session: &Session, task: &Task) -> Loaded {
        let checked = session.load(&self.sweep.graph, &with(&task.row.set, self.options));
        let checked = checked.without_missing_files();
        let graph = checked.graph.or(checked.partial);
        let made_of = graph.as_ref().and_then(|graph| {
            let files = session.files_of(graph, &task.row.inputs, self.is_forecast)?;
            let Picture { output, camera, zoom, size } = &self.sweep.picture;
            let shown = format!("{output:?} {camera:?} {zoom:?} {size:?} {}", self.signs);
            let key = format!("{} {} {shown}", session.build(), session.made_of(graph));
            Some((Hash::of(key.as_bytes()), files))
        });
        Loaded { graph, problems: checked.problems, made_of }
    }

    /// Whether a task must be run, and why.
    pub(crate) fn standing(&self, session: &Session, task: &Task) -> Standing {
        let Some(mut record) = Record::read(self.out, &task.name) else {
            let reason = "it has not been run".to_owned();
            return Standing::Due(Due { reason, loaded: None }.into());
        };
        session.know(std::mem::take(&mut record.as_read));
        let loaded = self.load(session, task);
        match self.change(&mut record, &loaded) {
            Some(reason) => Standing::Due(Due { reason, loaded: Some(loaded) }.into()),
            None => Standing::Holds(record.into()),
        }
    }

    /// Why a task's record does not hold any more, if it does not.
    fn change(&self, record: &mut Record, loaded: &Loaded) -> Option<String> {
        let Some((key, files)) = &loaded.made_of else {
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
        if let Some(name) = &files.unread {
            return Some(format!("`{name}` may have changed and was not read"));
        }
        if record.state == State::Failed {
            let why = match (self.retries, record.may_pass) {
                (_, true) => {
                    "it failed for want of memory or disk space, of time, or of access to a file"
                }
                (true, false) => "it failed",
                (false, false) => return None,
            };
            return Some(why.to_owned());
        }
        record.as_read.clone_from(&files.as_read);
        let what = self.changed_file(record)?;
        Some(format!("{what} is not as it was left"))
    }

    /// The first output, or the picture, that is not as it was left. If all are, and some were too young before to be believed without a
    /// look at their content, the record says that they are not any more.
    fn changed_file(&self, record: &mut Record) -> Option<String> {
        let mut is_better_known = false;
        let outputs = record.outputs.iter_mut().map(|output| (false, output));
        let picture = record.picture.iter_mut().map(|picture| (true, picture));
        for (is_picture, output) in outputs.chain(picture) {
            let path = self.out.join(&output.path);
            let before = output.left.as_ref().is_some_and(Left::is_settled);
            if !output.left.as_mut().is_some_and(|left| left.holds(&path, output.hash)) {
                return Some(match is_picture {
                    true => "its picture".into(),
                    false => format!("its output `{}`", output.name),
                });
            }
            is_better_known |= !before && output.left.as_ref().is_some_and(Left::is_settled);
        }
        if is_better_known {
            // Only time is lost if it cannot be written.
            let _ = record.write(self.out, &self.destination(&Sources::default()));
        }
        None
    }

    /// Looks at the outputs of a task that was run a moment ago, so that the next batch need not.
    pub(super) fn settle(&self, task: &Task) {
        if let Some(mut record) = Record::read(self.out, &task.name) {
            // One that somebody has changed is found by the next batch.
            let _ = self.changed_file(&mut record);
        }
    }

    /// What each node of a task would do now, with the hash of what it is made of.
    pub(crate) fn forecast(&self, session: &mut Session, task: &Task) -> Vec<(Hash, Forecast)> {
        let Loaded { graph: Some(graph), .. } = self.load(session, task) else { return Vec::new() };
        let known = session.known_inputs(&graph, &task.row.inputs);
        let graph = known.and_then(|(known, _)| session.fed_with_known(&graph, &known));
        let Ok(graph) = graph else { return Vec::new() };
        let graph = session.as_last_known(&graph);
        let made = session.made_of_nodes(&graph);
        let folder = self.folder_of(task);
        session.recall(&folder);
        let forecasts = session.dry_run(&graph, &[], &folder).unwrap_or_default();
        forecasts.into_iter().map(|it| (made[it.index], it)).collect()
    }

    fn fed(
        &self,
        session: &Session,
        graph: &Graph,
        task: &Task,
    ) -> Result<(Graph, Vec<Problem>), Vec<Problem>> {
        let (values, warnings) = session.read_inputs(graph, &task.row.inputs)?;
        Ok((session.fed(graph, &values)?, warnings))
    }

    /// Runs a task and writes its outputs, its picture and, last, its record; none if it was cancelled.
    ///
    /// # Errors
    /// In words, if the record cannot be written.
    pub(super) fn run(
        &self,
        session: &mut Session,
        task: &Task,
        due: Due,
        observer: &dyn Observer,
        limit: &TimeLimit,
    ) -> Result<Option<Record>, String> {
        let cancel = limit.token();
        let start = Instant::now();
        let loaded = due.loaded.unwrap_or_else(|| self.load(session, task));
        let Loaded { graph, mut problems, made_of } = loaded;
        let (key, files) = made_of.unzip();
        let files = files.unwrap_or_default();
        let sources = graph.as_ref().map(Sources::of).unwrap_or_default();
        let fed = graph.map(|graph| self.fed(session, &graph, task));
        let mut done = Done::default();
        match fed {
            None => {}
            Some(Err(wrong)) => problems.extend(wrong),
            Some(Ok((graph, warnings))) => {
                problems.extend(warnings);
                done = self.produced(session, task, &graph, observer, cancel);
                problems = with_those_of_run(problems, std::mem::take(&mut done.problems));
            }
        }
        if limit.is_over() {
            problems = vec![self.too_late()];
            (done.picture, done.may_pass) = (None, true);
        } else if cancel.is_cancelled() {
            return Ok(None);
        }
        let destination = self.destination(&sources);
        let path = picture_path(self.out, &task.name);
        if let Some(picture) = &done.picture {
            destination.write(&path, picture).map_err(|why| unwritten(&path, &why))?;
        }
        let picture =
            done.picture.map(|bytes| self.left("picture", &path, bytes.len(), Hash::of(&bytes)));
        let has_error = problems.iter().any(|problem| problem.severity == Severity::Error);
        let names = self.sweep.names.iter().cloned();
        let record = Record {
            format: 1,
            name: task.name.clone(),
            state: if has_error { State::Failed } else { State::Done },
            values: names.zip(task.row.values.iter().cloned()).collect(),
            seconds: start.elapsed().as_secs_f64(),
            may_pass: has_error && done.may_pass,
            nodes: counts(&done.trace),
            outputs: done.outputs,
            picture,
            problems: problems.iter().map(Problem::to_json).collect(),
            key,
            files: files.by_name,
            as_read: files.as_read,
        };
        let path = super::record::path(self.out, &task.name);
        record.write(self.out, &destination).map_err(|why| unwritten(&path, &why))?;
        Ok(Some(record))
    }

    /// The error of a task whose time is over.
    fn too_late(&self) -> Problem {
        let limit = in_words(self.time_limit.unwrap_or_default());
        let place = (self.sweep.source.clone(), Span::default());
        let message = format!("the task took longer than {limit}, its limit");
        let help = "raise --time-limit, or make the graph faster";
        Problem { help: help.into(), ..Problem::new(Severity::Error, code::FAILED, place, message) }
    }

    fn produced(
        &self,
        session: &mut Session,
        task: &Task,
        graph: &Graph,
        observer: &dyn Observer,
        cancel: &CancelToken,
    ) -> Done {
        let folder = self.folder_of(task);
        session.recall(&folder);
        let produced = match session.produce(graph, &[], &folder, observer, cancel) {
            Ok(produced) => produced,
            // Nothing was named.
            Err(_) => return Done::default(),
        };
        let picture = self.picture(session, graph, cancel);
        let written = produced.written.iter();
        let outputs = written
            .map(|file| self.left(&file.output, &file.path, file.bytes, file.hash))
            .collect();
        let (trace, may_pass, problems) = (produced.trace(), produced.may_pass, produced.problems);
        Done { outputs, picture, trace, may_pass, problems }
    }

    /// The folder of a task's outputs.
    fn folder_of(&self, task: &Task) -> OutputFolder {
        let inputs = task.row.inputs.iter().map(|(_, file)| &**file);
        let folder = self.out.join(&task.name);
        OutputFolder::of_task(&folder, self.is_named, self.signs).keeping(inputs)
    }

    /// A file that was just written.
    fn left(&self, name: &str, path: &Path, bytes: usize, hash: Hash) -> Output {
        let own = path.strip_prefix(self.out).unwrap_or(path);
        let parts = own.components().map(|part| part.as_os_str().to_string_lossy());
        Output {
            name: name.to_owned(),
            path: Vec::from_iter(parts).join("/"),
            bytes,
            hash,
            left: Left::at(path),
        }
    }

    /// The picture of a task for the contact sheet; none if nothing can be seen.
    fn picture(
        &self,
        session: &mut Session,
        graph: &Graph,
        cancel: &CancelToken,
    ) -> Option<Vec<u8>> {
        let Picture { output, camera: (yaw, pitch), zoom, size: (width, height) } =
            &self.sweep.picture;
        let wanted = match output.is_empty() {
            true => graph.output_names().map(str::to_owned).collect(),
            false => vec![output.clone()],
        };
        let names: Vec<_> = wanted.iter().cloned().collect();
        let run = Run { wanted: Wanted::Named(wanted), cancel: cancel.clone(), ..Run::default() };
        let finished = session.run(graph, &run).ok()?;
        let layers = shown(&finished, &names)?;
        let size = [width.0 as usize, height.0 as usize];
        let view = View { size, yaw: *yaw, pitch: *pitch, zoom: *zoom, ..View::front() };
        let look = Look { view, kind: Kind::Fitted, below: None };
        let image = session.install(|| picture(&layers, &look))?;
        let mut bytes = Vec::new();
        let encoder = JpegEncoder::new_with_quality(&mut bytes, QUALITY);
        let pixels = image.pixels().as_flattened();
        encoder.write_image(pixels, width.0, height.0, ExtendedColorType::Rgb8).ok()?;
        Some(bytes)
    }

    /// Removes what killed processes left among the records: once, because there may be many.
    pub(super) fn sweep_records(&self) {
        let (root, sources) = (self.out.join(super::record::FOLDER), Sources::default());
        let destination = self.destination(&sources);
        let tasks = self.sweep.tasks.iter().map(|task| Path::new(&task.name));
        let folders: BTreeSet<&Path> = tasks.flat_map(|task| task.ancestors().skip(1)).collect();
        folders.iter().for_each(|folder| destination.sweep(&root.join(folder)));
    }

    pub(super) fn destination<'s>(&self, sources: &'s Sources) -> Destination<'s> {
        match self.is_named {
            true => Destination::folder(self.out, sources),
            false => Destination::inside(Path::new("."), self.out, sources),
        }
    }
}

/// What came of a task.
#[derive(Default)]
struct Done {
    outputs: Vec<Output>,
    picture: Option<Vec<u8>>,
    trace: RunTrace,
    may_pass: bool,
    problems: Vec<Problem>,
}

/// What the first of these values shows that has faces; without one, the first that shows anything.
fn shown(finished: &Finished, names: &[String]) -> Option<Vec<maquette_value::Layer>> {
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

/// `out/doll.sweep` for `graphs/doll.sweep.ron`, and `out/doll.sweep-draft` for what are only drafts of it.
pub(crate) fn default_folder(sweep: &Path, is_draft: bool) -> PathBuf {
    let mut name = sweep.file_stem().unwrap_or_default().to_owned();
    if is_draft {
        name.push("-draft");
    }
    Path::new("out").join(name)
}
