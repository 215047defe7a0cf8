//! The list of tasks that is handed over to a farm. Its jobs name a task by its number and the list by its hash, so that no name that a user
//! gave is part of a command line. A job whose list is not that of the sweep any more runs nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use maquette_engine::writing::{self, Sources};
use maquette_golden::sweep::{Sweep, Task};
use maquette_syntax::paths::{folder_of_new, path_between};
use maquette_value::Hash;
use maquette_value::plain;
use serde::{Deserialize, Serialize};

use super::Batch;
use super::record::{FOLDER, Record, unwritten};
use crate::Shown;

/// The folder of lists in that of records. No task has a name with an `@`.
const LISTS: &str = "@handovers";

/// The number of digits of a hash that name a list.
pub(crate) const DIGITS: usize = 16;

/// At most this many changes of one kind are named.
const MAX_NAMED: usize = 4;

/// All tasks of a sweep as they were handed over.
#[derive(Debug, Deserialize, PartialEq, Serialize)]
struct TaskList {
    /// 1.
    format: u32,
    /// The path of the graph from the sweep.
    graph: String,
    tasks: Vec<Listed>,
}

/// A task of a list: all by which it differs from others.
#[derive(Debug, Deserialize, PartialEq, Serialize)]
struct Listed {
    name: String,
    /// What is swept, by name, as its author writes it.
    values: Vec<(String, String)>,
    /// What is set, by its target.
    set: Vec<(String, String)>,
    /// The files of inputs, by paths from the sweep.
    inputs: Vec<(String, String)>,
}

impl TaskList {
    fn of(sweep: &Sweep) -> Self {
        let folder = folder_of_new(&sweep.source.name);
        let graph = folder_of_new(&sweep.graph).join(sweep.graph.file_name().unwrap_or_default());
        let listed = |task: &Task| {
            let values = sweep.names.iter().cloned().zip(task.row.values.iter().cloned());
            let set = task.row.set.iter().map(|set| (set.target.clone(), set.text.clone()));
            let inputs = task.row.inputs.iter();
            let inputs = inputs.map(|(name, file)| (name.clone(), path_between(&folder, file)));
            // In which order they are written changes nothing.
            fn sorted(mut all: Vec<(String, String)>) -> Vec<(String, String)> {
                all.sort();
                all
            }
            Listed {
                name: task.name.clone(),
                values: sorted(values.collect()),
                set: sorted(set.collect()),
                inputs: sorted(inputs.collect()),
            }
        };
        let tasks = sweep.tasks.iter().map(listed).collect();
        Self { format: 1, graph: path_between(&folder, &graph), tasks }
    }

    fn read(path: &Path) -> Option<Self> {
        let bytes = plain::read_own(path).ok()?;
        serde_json::from_slice(&bytes).ok().filter(|it: &Self| it.format == 1)
    }

    /// The list as it is written, and the hash that names it.
    fn written(&self) -> (Vec<u8>, String) {
        let mut bytes = serde_json::to_vec_pretty(self).unwrap_or_default();
        bytes.push(b'\n');
        let mut hash = Hash::of(&bytes).to_string();
        hash.truncate(DIGITS);
        (bytes, hash)
    }

    fn by_name(&self) -> BTreeMap<&str, &Listed> {
        self.tasks.iter().map(|task| (&task.name[..], task)).collect()
    }

    /// Says in words what is different now.
    fn changes(&self, now: &Self) -> String {
        let (before, after) = (self.by_name(), now.by_name());
        let is_new = |task: &&Listed| !before.contains_key(&task.name[..]);
        let mut new: BTreeMap<_, _> =
            now.tasks.iter().filter(is_new).map(|task| (task.content(), &task.name[..])).collect();
        let (mut removed, mut renamed, mut changed) = (Vec::new(), Vec::new(), Vec::new());
        let mut new_names = BTreeSet::new();
        for task in &self.tasks {
            match after.get(&task.name[..]) {
                Some(&found) if found == task => {}
                Some(&found) => changed.push(task.difference(found)),
                None => match new.remove(&task.content()) {
                    Some(name) => {
                        new_names.insert(name);
                        renamed.push(format!("`{}` is `{name}`", task.name));
                    }
                    None => removed.push(format!("`{}`", task.name)),
                },
            }
        }
        let added =
            now.tasks.iter().filter(is_new).filter(|task| !new_names.contains(&task.name[..]));
        let added: Vec<_> = added.map(|task| format!("`{}`", task.name)).collect();
        let kinds =
            [(added, "added"), (removed, "removed"), (renamed, "renamed"), (changed, "changed")];
        let mut words = Vec::new();
        if self.graph != now.graph {
            words.push(format!("the graph is `{}` in place of `{}`", now.graph, self.graph));
        }
        for (names, kind) in kinds.iter().filter(|(names, _)| !names.is_empty()) {
            words.push(format!("{} {kind} ({})", names.len(), named(names)));
        }
        if words.is_empty() { "their order has changed".into() } else { words.join(", ") }
    }
}

impl Listed {
    /// All but the name.
    fn content(&self) -> [&[(String, String)]; 3] {
        [&self.values, &self.set, &self.inputs]
    }

    /// The first value that another task of this name has in place of its own.
    fn difference(&self, other: &Self) -> String {
        let told = self.content().into_iter().zip(other.content()).find_map(|(own, others)| {
            fn text(all: &[(String, String)], name: &str) -> Option<String> {
                all.iter().find(|it| it.0 == name).map(|it| it.1.clone())
            }
            let names = own.iter().chain(others).map(|(name, _)| &name[..]);
            let (name, own, other) = names
                .map(|name| (name, text(own, name), text(others, name)))
                .find(|(_, own, other)| own != other)?;
            let [own, other] = [own, other].map(|it| it.unwrap_or_else(|| "not set".into()));
            Some(format!("`{}`: {name} was {own}, is {other}", self.name))
        });
        told.unwrap_or_else(|| format!("`{}`", self.name))
    }
}

/// The first few of some names.
fn named(names: &[String]) -> String {
    let shown = names.iter().take(MAX_NAMED).cloned();
    let rest = names.len().saturating_sub(MAX_NAMED);
    let rest = (0 < rest).then(|| format!("and {rest} more"));
    shown.chain(rest).collect::<Vec<_>>().join(", ")
}

impl Batch<'_> {
    fn lists(&self) -> PathBuf {
        self.out.join(FOLDER).join(LISTS)
    }

    fn list_path(&self, hash: &str) -> PathBuf {
        self.lists().join(format!("{hash}.json"))
    }

    /// The folder of logs of tasks that were handed over by this list.
    pub(crate) fn logs(&self, hash: &str) -> PathBuf {
        self.lists().join(hash)
    }

    /// The log of a task, if it was handed over.
    pub(super) fn log_path(&self, task: &Task) -> Option<PathBuf> {
        Some(self.logs(self.handover?).join(format!("{}.log", task.name)))
    }

    /// Writes the list of tasks, with which each job compares its own, and returns its hash.
    ///
    /// # Errors
    /// In words, if it cannot be written.
    pub(crate) fn hand_over(&self) -> Result<String, String> {
        let (bytes, hash) = TaskList::of(self.sweep).written();
        let path = self.list_path(&hash);
        let written = self.destination(&Sources::default()).put(&path, &bytes);
        written.map_err(|why| unwritten(&path, &why))?;
        // Logs of the same tasks that were handed over before are of another run.
        writing::remove_logs(&self.logs(&hash));
        Ok(hash)
    }

    /// Compares the tasks with those that were handed over.
    ///
    /// # Errors
    /// In words, if they are not the same.
    pub(crate) fn check_handover(&self, hash: &str) -> Result<(), String> {
        let now = TaskList::of(self.sweep);
        if now.written().1 == hash {
            return Ok(());
        }
        let path = self.list_path(hash);
        // A list whose hash is another one was changed by somebody.
        let before = TaskList::read(&path).filter(|list| list.written().1 == hash);
        let changes = match before {
            Some(before) => before.changes(&now),
            None => {
                format!("what they were is unknown, since {} is missing or damaged", path.shown())
            }
        };
        Err(format!(
            "the tasks of {} are not those that were handed over: {changes}; hand them over again, with `--emit` (tasks that are done do not run \
             again)",
            self.sweep.source.name.shown()
        ))
    }

    /// Names the tasks that are in no list, if any was handed over, and that have not been run here either.
    pub(crate) fn never_handed_over(&self) -> Vec<String> {
        let files = fs::read_dir(self.lists()).into_iter().flatten().flatten();
        let lists: Vec<_> = files.filter_map(|file| TaskList::read(&file.path())).collect();
        if lists.is_empty() {
            return Vec::new();
        }
        let now = TaskList::of(self.sweep);
        let by_name: Vec<_> =
            lists.iter().filter(|list| list.graph == now.graph).map(TaskList::by_name).collect();
        let known: BTreeSet<_> =
            lists.iter().flat_map(|list| &list.tasks).map(|task| &task.name[..]).collect();
        let is_listed =
            |task: &Listed| by_name.iter().any(|list| list.get(&task.name[..]) == Some(&task));
        // The record of a task that had other values before may be of those.
        fn was_run(task: &Listed, known: &BTreeSet<&str>, out: &Path) -> bool {
            let record = Record::read(out, &task.name);
            !known.contains(&task.name[..])
                && record.is_some_and(|mut record| {
                    record.values.sort();
                    record.values == task.values
                })
        }
        let missing =
            now.tasks.iter().filter(|task| !is_listed(task) && !was_run(task, &known, self.out));
        missing.map(|task| task.name.clone()).collect()
    }
}

/// Says in words that some of this many tasks were never handed over.
pub(crate) fn never_handed_over_in_words(missing: &[String], all: usize) -> String {
    let names: Vec<_> = missing.iter().map(|name| format!("`{name}`")).collect();
    format!(
        "{} of {all} tasks never handed over: {}; hand them over again, with `--emit` (tasks that are done do not run again)",
        missing.len(),
        named(&names)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn list(tasks: &[(&str, &str)]) -> TaskList {
        TaskList {
            format: 1,
            graph: "doll.ron".into(),
            tasks: tasks
                .iter()
                .map(|(name, value)| {
                    let pairs = vec![("growth".to_owned(), (*value).to_owned())];
                    Listed {
                        name: (*name).to_owned(),
                        values: pairs.clone(),
                        set: pairs,
                        inputs: Vec::new(),
                    }
                })
                .collect(),
        }
    }

    #[test]
    fn each_change_of_a_list_is_told() {
        let before = list(&[("a", "1"), ("b", "2"), ("c", "3")]);
        fn check(after: &[(&str, &str)], told: &str, before: &TaskList) {
            let after = list(after);
            assert_ne!(before.written().1, after.written().1);
            assert_eq!(before.changes(&after), told);
        }
        check(&[("0", "0"), ("a", "1"), ("b", "2"), ("c", "3")], "1 added (`0`)", &before);
        check(&[("a", "1"), ("c", "3")], "1 removed (`b`)", &before);
        check(&[("a", "1"), ("d", "2"), ("c", "3")], "1 renamed (`b` is `d`)", &before);
        check(
            &[("a", "1"), ("b", "5"), ("c", "3")],
            "1 changed (`b`: growth was 2, is 5)",
            &before,
        );
        check(&[("b", "2"), ("a", "1"), ("c", "3")], "their order has changed", &before);
        check(&[("d", "4"), ("b", "2")], "1 added (`d`), 2 removed (`a`, `c`)", &before);
        let other =
            TaskList { graph: "face.ron".into(), ..list(&[("a", "1"), ("b", "2"), ("c", "3")]) };
        assert_eq!(before.changes(&other), "the graph is `face.ron` in place of `doll.ron`");
    }

    #[test]
    fn a_list_comes_back_as_it_was_written() {
        let list = list(&[("Mü-ller/\u{1f600}", "\"a\nb\""), ("b", "{{x}}")]);
        let (bytes, hash) = list.written();
        let read: TaskList = serde_json::from_slice(&bytes).unwrap();
        assert_eq!((read.written().1, read), (hash, list));
    }

    #[test]
    fn many_names_are_cut() {
        let names: Vec<_> = (0..6).map(|name| name.to_string()).collect();
        assert_eq!(named(&names), "0, 1, 2, 3, and 2 more");
    }
}
