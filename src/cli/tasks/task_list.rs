//! The list of tasks that is handed over to a render farm. A job receives the index of its task and the hash of the list, so command lines
//! contain no names given by users. If the list no longer matches the sweep, the job runs nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use maquette_engine::writing::{self, Sources};
use maquette_golden::sweep::{Sweep, Task};
use maquette_syntax::paths::{folder_of_new, path_between};
use maquette_value::Hash;
use serde::{Deserialize, Serialize};

use super::Batch;
use super::record::{FOLDER, Record, write_error};
use crate::DisplayPath;

/// The subfolder for lists of tasks, in the folder of records. No record can have this name, because the names of tasks contain no `@`.
const LISTS: &str = "@handovers";

/// The number of digits of the hash by which a list is named.
pub(crate) const HASH_DIGITS: usize = 16;

/// The maximum number of task names that a message lists for each kind of change, such as added or removed tasks.
const MAX_NAMED: usize = 4;

/// All tasks of a sweep at the time when they are handed over to a farm.
#[derive(Debug, Deserialize, PartialEq, Serialize)]
struct TaskList {
    /// The version of the file format, which is 1.
    format: u32,
    /// The path of the graph, relative to the folder of the sweep.
    graph: String,
    tasks: Vec<ListedTask>,
}

/// A task in the list, with everything in which it may differ from other tasks.
#[derive(Debug, Deserialize, PartialEq, Serialize)]
struct ListedTask {
    name: String,
    /// The swept values, as written in the sweep, by name.
    values: Vec<(String, String)>,
    /// The values that the task sets, by the name of the parameter or field.
    set: Vec<(String, String)>,
    /// The input files, by the name of the graph's input. Paths are relative to the folder of the sweep.
    inputs: Vec<(String, String)>,
}

impl TaskList {
    fn from_sweep(sweep: &Sweep) -> Self {
        let folder = folder_of_new(&sweep.source.name);
        let graph = folder_of_new(&sweep.graph).join(sweep.graph.file_name().unwrap_or_default());
        let listed = |task: &Task| {
            let values = sweep.names.iter().cloned().zip(task.row.values.iter().cloned());
            let set = task.row.set.iter().map(|set| (set.target.clone(), set.text.clone()));
            let inputs = task.row.inputs.iter();
            let inputs = inputs.map(|(name, file)| (name.clone(), path_between(&folder, file)));
            // Sort the pairs, because their order has no meaning and lists are compared.
            fn sort_pairs(mut all: Vec<(String, String)>) -> Vec<(String, String)> {
                all.sort();
                all
            }
            ListedTask {
                name: task.name.clone(),
                values: sort_pairs(values.collect()),
                set: sort_pairs(set.collect()),
                inputs: sort_pairs(inputs.collect()),
            }
        };
        let tasks = sweep.tasks.iter().map(listed).collect();
        Self { format: 1, graph: path_between(&folder, &graph), tasks }
    }

    fn read(path: &Path) -> Option<Self> {
        let bytes = maquette_value::fs::read_no_follow(path).ok()?;
        serde_json::from_slice(&bytes).ok().filter(|it: &Self| it.format == 1)
    }

    /// Returns the content of the file of the list, and its hash.
    fn to_bytes(&self) -> (Vec<u8>, String) {
        let mut bytes = serde_json::to_vec_pretty(self).unwrap_or_default();
        bytes.push(b'\n');
        let mut hash = Hash::compute(&bytes).to_string();
        hash.truncate(HASH_DIGITS);
        (bytes, hash)
    }

    fn by_name(&self) -> BTreeMap<&str, &ListedTask> {
        self.tasks.iter().map(|task| (&task.name[..], task)).collect()
    }

    /// Describes how the present list `now` differs from this one.
    fn changes(&self, now: &Self) -> String {
        let (before, after) = (self.by_name(), now.by_name());
        let is_new = |task: &&ListedTask| !before.contains_key(&task.name[..]);
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
            words.push(format!("the graph is `{}` instead of `{}`", now.graph, self.graph));
        }
        for (names, kind) in kinds.iter().filter(|(names, _)| !names.is_empty()) {
            words.push(format!("{} {kind} ({})", names.len(), join_names(names)));
        }
        if words.is_empty() { "their order has changed".into() } else { words.join(", ") }
    }
}

impl ListedTask {
    /// Returns everything in the task except its name.
    fn content(&self) -> [&[(String, String)]; 3] {
        [&self.values, &self.set, &self.inputs]
    }

    /// Describes the first value in which this task differs from another one with the same name.
    fn difference(&self, other: &Self) -> String {
        let difference =
            self.content().into_iter().zip(other.content()).find_map(|(own, others)| {
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
        difference.unwrap_or_else(|| format!("`{}`", self.name))
    }
}

/// Joins names for a message. If there are too many, only the first ones are named.
fn join_names(names: &[String]) -> String {
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

    /// Returns the folder for the logs of the tasks in the list with this hash.
    pub(crate) fn logs(&self, hash: &str) -> PathBuf {
        self.lists().join(hash)
    }

    /// Returns the path of the log of a task, or `None` if the task was not handed over to a farm.
    pub(super) fn log_path(&self, task: &Task) -> Option<PathBuf> {
        Some(self.logs(self.handover?).join(format!("{}.log", task.name)))
    }

    /// Writes the list of tasks, and returns its hash. Each job compares this list with the tasks of the sweep.
    ///
    /// # Errors
    /// A message if the list cannot be written.
    pub(crate) fn hand_over(&self) -> Result<String, String> {
        let (bytes, hash) = TaskList::from_sweep(self.sweep).to_bytes();
        let path = self.list_path(&hash);
        let written = self.destination(&Sources::default()).put(&path, &bytes);
        written.map_err(|why| write_error(&path, &why))?;
        // Remove the logs of an earlier handover of the same tasks.
        writing::remove_logs(&self.logs(&hash));
        Ok(hash)
    }

    /// Checks that the tasks are the same as those in the list with this hash.
    ///
    /// # Errors
    /// A message that describes the differences.
    pub(crate) fn check_handover(&self, hash: &str) -> Result<(), String> {
        let now = TaskList::from_sweep(self.sweep);
        if now.to_bytes().1 == hash {
            return Ok(());
        }
        let path = self.list_path(hash);
        // Ignore a list whose hash differs from its name, because it was modified.
        let before = TaskList::read(&path).filter(|list| list.to_bytes().1 == hash);
        let changes = match before {
            Some(before) => before.changes(&now),
            None => {
                format!(
                    "the old list is unknown, because {} is missing or damaged",
                    path.for_display()
                )
            }
        };
        Err(format!(
            "the tasks of {} are not those that were handed over: {changes}; hand them over again, with `--emit` (tasks that are done do not run \
             again)",
            self.sweep.source.name.for_display()
        ))
    }

    /// Returns the names of the tasks that no list contains and that have not been run on this machine. If there are no lists, returns no
    /// names.
    pub(crate) fn never_handed_over(&self) -> Vec<String> {
        let files = fs::read_dir(self.lists()).into_iter().flatten().flatten();
        let lists: Vec<_> = files.filter_map(|file| TaskList::read(&file.path())).collect();
        if lists.is_empty() {
            return Vec::new();
        }
        let now = TaskList::from_sweep(self.sweep);
        let by_name: Vec<_> =
            lists.iter().filter(|list| list.graph == now.graph).map(TaskList::by_name).collect();
        let known: BTreeSet<_> =
            lists.iter().flat_map(|list| &list.tasks).map(|task| &task.name[..]).collect();
        let is_listed =
            |task: &ListedTask| by_name.iter().any(|list| list.get(&task.name[..]) == Some(&task));
        // Compare the values, too: a record with other values belongs to an earlier task of the same name.
        fn was_run(task: &ListedTask, known: &BTreeSet<&str>, out: &Path) -> bool {
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

/// Returns the message about tasks that were never handed over to a farm. `all` is the number of tasks in the sweep.
pub(crate) fn never_handed_over_message(missing: &[String], all: usize) -> String {
    let names: Vec<_> = missing.iter().map(|name| format!("`{name}`")).collect();
    format!(
        "{} of {all} tasks never handed over: {}; hand them over again, with `--emit` (tasks that are done do not run again)",
        missing.len(),
        join_names(&names)
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
                    ListedTask {
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
    fn each_change_of_a_list_is_described() {
        let before = list(&[("a", "1"), ("b", "2"), ("c", "3")]);
        fn check(after: &[(&str, &str)], difference: &str, before: &TaskList) {
            let after = list(after);
            assert_ne!(before.to_bytes().1, after.to_bytes().1);
            assert_eq!(before.changes(&after), difference);
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
        assert_eq!(before.changes(&other), "the graph is `face.ron` instead of `doll.ron`");
    }

    #[test]
    fn a_written_list_is_read_unchanged() {
        let list = list(&[("Mü-ller/\u{1f600}", "\"a\nb\""), ("b", "{{x}}")]);
        let (bytes, hash) = list.to_bytes();
        let read: TaskList = serde_json::from_slice(&bytes).unwrap();
        assert_eq!((read.to_bytes().1, read), (hash, list));
    }

    #[test]
    fn long_lists_of_names_are_shortened() {
        let names: Vec<_> = (0..6).map(|name| name.to_string()).collect();
        assert_eq!(join_names(&names), "0, 1, 2, 3, and 2 more");
    }
}
