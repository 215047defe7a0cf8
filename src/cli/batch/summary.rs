//! `maquette batch --dry-run` prints which tasks would run. `maquette batch --report` reports the records of tasks that have run.

use std::collections::HashSet;
use std::sync::Arc;

use maquette_golden::sweep::Task;
use maquette_graph::catalog::Catalog;
use maquette_syntax::error::Diagnostic;
use serde_json::{Value as Json, json};

use super::{Batch, record_fields, unchanged_reason};
use crate::events::{EventFormat, Listener};
use crate::openjd::JobProgress;
use crate::tasks as batch;
use crate::tasks::{Batch as Tasks, Record, State, TaskStatus};
use crate::{DisplayPath, Exit, eprint, format_count, print, print_json, put_problems};

impl Batch {
    /// Prints which tasks would run, and why.
    pub(super) fn forecast(
        &self,
        tasks: &Tasks<'_>,
        diagnostics: &[Diagnostic],
        catalog: &Arc<Catalog>,
    ) -> Exit {
        let mut session = match self.session(1, catalog) {
            Ok(session) => session,
            Err(why) => return Exit::Usage(why),
        };
        let sweep = tasks.sweep;
        let longest = sweep.tasks.iter().map(|task| task.name.len()).max().unwrap_or(0);
        let (mut runs, mut all, mut due) = (HashSet::new(), 0, 0);
        let mut entries = Vec::new();
        for (index, task) in sweep.tasks.iter().enumerate() {
            let (state, reason, count, new) = match tasks.status(&session, task) {
                TaskStatus::Holds(record) => {
                    (record.state.word(), unchanged_reason(record.state).to_owned(), 0, 0)
                }
                TaskStatus::Due(found) => {
                    due += 1;
                    let forecast = tasks.forecast(&mut session, task).into_iter();
                    let would = forecast.filter(|(_, it)| it.may_run());
                    let before = runs.len();
                    let count = would.map(|(made, _)| runs.insert(made)).count();
                    all += count;
                    ("run", found.reason, count, runs.len() - before)
                }
            };
            if self.json || self.events == Some(EventFormat::Json) {
                let fields = json!({
                    "task": index,
                    "name": task.name,
                    "state": state,
                    "reason": reason,
                    "values": values(&sweep.names, task),
                    "nodes": count,
                    "new_nodes": new,
                });
                match self.json {
                    true => entries.push(fields),
                    false => Listener::of_stdout().send("forecast", fields),
                }
                continue;
            }
            let reason = match state {
                "run" => format!("{reason}; {}, {new} of them new", format_count(count, "node")),
                _ => reason,
            };
            print(&format!("{state:<6}  {index:>4}  {:<longest$}  {reason}\n", task.name));
        }
        let fields = json!({ "due": due, "nodes": runs.len(), "nodes_without_sharing": all });
        if self.json {
            let mut document = json!({ "tasks": entries });
            merge(&mut document, fields);
            put_problems(&mut document, diagnostics);
            print_json(&document);
        } else if self.events == Some(EventFormat::Json) {
            Listener::of_stdout().send("batch", fields);
        } else {
            let shared = match all - runs.len() {
                0 => String::new(),
                _ => format!(" instead of {all}, because shared nodes are computed once"),
            };
            let tasks = format_count(sweep.tasks.len(), "task");
            print(&format!(
                "{due} of {tasks} would run: {}{shared}\n",
                format_count(runs.len(), "node")
            ));
        }
        Exit::Done
    }

    /// Writes the contact sheet from the existing records. Fails if a task is not done, or if the tasks differ from those that were handed
    /// over to the farm.
    pub(super) fn report_records(
        &self,
        tasks: &Tasks<'_>,
        handover: Result<(), String>,
        diagnostics: &[Diagnostic],
    ) -> Exit {
        let path = match tasks.write_sheet() {
            Ok(path) => path,
            Err(why) => return Exit::Usage(why),
        };
        let all = &tasks.sweep.tasks;
        let records = all.iter().map(|task| Record::read(tasks.out, &task.name));
        let records = Vec::from_iter(records);
        fn count(state: State, records: &[Option<Record>]) -> usize {
            records.iter().flatten().filter(|it| it.state == state).count()
        }
        let (done, failed) = (count(State::Done, &records), count(State::Failed, &records));
        let missing = all.len() - done - failed;
        let sheet = path.display().to_string();
        let mut fields =
            json!({ "done": done, "failed": failed, "missing": missing, "sheet": sheet });
        let counts = format!(
            "{}: {done} done, {failed} failed, {missing} missing",
            format_count(all.len(), "task")
        );
        match self.events {
            _ if self.json => {
                let entries = all.iter().zip(&records).enumerate();
                let entries = entries.map(|(index, (task, record))| match record {
                    Some(record) => record_fields(index, record, false),
                    None => json!({
                        "task": index,
                        "name": task.name,
                        "state": "missing",
                        "ran": false,
                        "values": values(&tasks.sweep.names, task),
                    }),
                });
                let mut document = json!({ "tasks": entries.collect::<Json>() });
                merge(&mut document, fields);
                put_problems(&mut document, diagnostics);
                print_json(&document);
            }
            Some(EventFormat::Json) => {
                fields["ran"] = 0.into();
                Listener::of_stdout().send("batch", fields);
            }
            Some(EventFormat::Openjd) => {
                JobProgress::new(0, Default::default()).status(&counts);
            }
            None => print(&format!("{}\n", path.for_display())),
        }
        let new = tasks.never_handed_over();
        let new = (!new.is_empty()).then(|| batch::never_handed_over_message(&new, all.len()));
        if let Some(why) = handover.err().or(new) {
            eprint(&format!("error: {why}\n"));
            return Exit::Failed;
        }
        if done == all.len() {
            return Exit::Done;
        }
        eprint(&format!("error: {counts}\n"));
        let logs = self.handover.as_deref().map(|hash| tasks.logs(hash));
        if let Some(logs) = logs.filter(|logs| logs.is_dir()) {
            eprint(&format!("  = help: read the logs of the tasks in {}\n", logs.for_display()));
        }
        Exit::Failed
    }
}

/// Returns the swept values of a task as a JSON object, by name.
fn values(names: &[String], task: &Task) -> Json {
    let values = names.iter().zip(&task.row.values);
    Json::Object(values.map(|(name, value)| (name.clone(), value.clone().into())).collect())
}

fn merge(document: &mut Json, fields: Json) {
    if let (Json::Object(document), Json::Object(fields)) = (document, fields) {
        document.extend(fields);
    }
}
