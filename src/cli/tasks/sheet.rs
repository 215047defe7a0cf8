//! The contact sheet of a batch: a page with a picture of each task. It is generated only from the records of tasks.

use std::path::{Path, PathBuf};

use maquette_engine::writing::Sources;
use maquette_format::data_uri;
use maquette_golden::sweep::Sweep;
use maquette_syntax::diagnostics::escape_json;
use maquette_value::fs;
use serde_json::{Value as Json, json};

use super::Batch;
use super::record::{Record, State, text_field, write_error};

/// The template of the page. It contains the placeholders `@@style@@`, `@@data@@` and `@@script@@`.
const PAGE: &str = include_str!("sheet/sheet.html");
const STYLE: &str = include_str!("sheet/sheet.css");

/// The JavaScript modules of the page. Each comes after the modules that it needs while it is loaded.
const SCRIPTS: [&str; 9] = [
    include_str!("sheet/element.js"),
    include_str!("sheet/data.js"),
    include_str!("sheet/state.js"),
    include_str!("sheet/cards.js"),
    include_str!("sheet/layout.js"),
    include_str!("sheet/filter.js"),
    include_str!("sheet/one.js"),
    include_str!("sheet/compare.js"),
    include_str!("sheet/sheet.js"),
];

impl Batch<'_> {
    /// Writes the page from the records that exist, and returns its path.
    ///
    /// # Errors
    /// A message if the page cannot be written.
    pub(crate) fn write_sheet(&self) -> Result<PathBuf, String> {
        let path = self.out.join("index.html");
        let page = page(self.sweep, self.out, self.options.draft);
        // Do not write an unchanged page, because the folder may be read-only.
        if fs::read_no_follow(&path).is_ok_and(|there| there == page.as_bytes()) {
            return Ok(path);
        }
        let written = self.destination(&Sources::default()).put(&path, page.as_bytes());
        written.map_err(|why| write_error(&path, &why))?;
        Ok(path)
    }
}

/// Returns the HTML page of a sweep, from the records in the folder `out`. A task without a record has the state `missing`.
fn page(sweep: &Sweep, out: &Path, is_draft: bool) -> String {
    let title = sweep.source.name.file_name().unwrap_or_default().to_string_lossy();
    let graph = sweep.graph.file_name().unwrap_or_default().to_string_lossy();
    let (width, height) = sweep.picture.size;
    let tasks = sweep.tasks.iter().map(|task| {
        let values = &task.row.values;
        match Record::read(out, &task.name) {
            Some(record) => task_json(&record, values, out),
            None => json!({
                "name": task.name, "state": "missing", "values": values, "seconds": null, "nodes": null,
                "picture": null, "files": [], "problems": [],
            }),
        }
    });
    let data = json!({
        "title": if is_draft { format!("{title}, drafts") } else { title.into_owned() },
        "graph": graph,
        "names": sweep.names,
        "size": [width.0, height.0],
        "tasks": Vec::from_iter(tasks),
    });
    // Escape `<`, so that no text in the data can end the script element.
    let data = escape_json(&data.to_string()).replace('<', "\\u003c");
    let script = script();
    let mut page = String::with_capacity(PAGE.len() + script.len() + STYLE.len() + data.len());
    for (index, piece) in PAGE.split("@@").enumerate() {
        page += match piece {
            "style" if index % 2 == 1 => STYLE,
            "data" if index % 2 == 1 => &data,
            "script" if index % 2 == 1 => &script,
            piece => piece,
        };
    }
    page
}

/// Joins all modules into one script, and removes their imports and exports.
fn script() -> String {
    let lines = SCRIPTS.iter().flat_map(|script| script.lines());
    let lines = lines.filter(|line| !line.starts_with("import "));
    let lines = lines.map(|line| line.strip_prefix("export ").unwrap_or(line));
    Vec::from_iter(lines).join("\n")
}

fn task_json(record: &Record, values: &[String], out: &Path) -> Json {
    let picture = record.picture.as_ref();
    let picture = picture.and_then(|picture| fs::read_no_follow(&out.join(&picture.path)).ok());
    let picture = picture.map(|bytes| data_uri("image/jpeg", &bytes));
    json!({
        "name": record.name,
        "state": match record.state { State::Done => "done", State::Failed => "failed" },
        "values": values,
        "seconds": record.seconds,
        "nodes": record.nodes,
        "picture": picture,
        "files": record.outputs.iter().map(file_json).collect::<Vec<_>>(),
        "problems": record.problems.iter().map(problem_json).collect::<Vec<_>>(),
    })
}

fn file_json(output: &super::record::Output) -> Json {
    json!({ "name": output.name, "path": output.path, "bytes": output.bytes })
}

fn problem_json(problem: &Json) -> Json {
    // A diagnostic about a whole task has no line, and possibly no file.
    let file = problem["file"].as_str().filter(|file| !file.is_empty()).map(str::to_owned);
    let numbers = ["line", "column"].iter().map_while(|name| problem[*name].as_u64());
    let position =
        file.map(|file| numbers.fold(file, |position, number| format!("{position}:{number}")));
    json!({
        "severity": text_field(problem, "severity"),
        "message": text_field(problem, "message"),
        "place": position,
        "help": text_field(problem, "help"),
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn a_task_has_all_fields_and_a_problem_has_its_position() {
        let record = Record {
            format: 1,
            name: "a".into(),
            state: State::Failed,
            values: Vec::new(),
            seconds: 0.5,
            nodes: BTreeMap::from([("cached".to_owned(), 3)]),
            outputs: Vec::new(),
            picture: None,
            problems: vec![
                json!({ "severity": "error", "message": "no", "file": "g.ron", "line": 3, "column": 7 }),
                json!({ "severity": "error", "message": "no", "file": "g.ron" }),
                json!({ "severity": "error", "message": "no", "file": "", "line": null }),
                json!({ "severity": "error", "message": "no" }),
            ],
            key: None,
            files: BTreeMap::new(),
            as_read: Vec::new(),
            may_succeed_later: false,
        };
        let told = task_json(&record, &[], Path::new("nowhere"));
        let places = told["problems"].as_array().unwrap().iter().map(|it| &it["place"]);
        let expected = [json!("g.ron:3:7"), json!("g.ron"), Json::Null, Json::Null];
        assert_eq!(Vec::from_iter(places), Vec::from_iter(&expected));
        let fields =
            ["name", "state", "values", "seconds", "nodes", "picture", "files", "problems"];
        assert!(fields.iter().all(|field| told.get(field).is_some()), "{told}");
    }
}
