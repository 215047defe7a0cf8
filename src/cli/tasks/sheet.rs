//! The contact sheet of a batch: one page with a picture of each task, made of records alone.

use std::path::{Path, PathBuf};

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use maquette_engine::writing::Sources;
use maquette_golden::sweep::Sweep;
use maquette_syntax::telling::escaped;
use maquette_value::plain;
use serde_json::{Value as Json, json};

use super::Batch;
use super::record::{Record, State, unwritten};

/// The page, in which `@@style@@`, `@@data@@` and `@@script@@` stand for what belongs there.
const PAGE: &str = include_str!("sheet/sheet.html");
const STYLE: &str = include_str!("sheet/sheet.css");

/// The modules of its script, each behind those that it takes something from at the start.
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
    /// Makes the page of the records that are there, and says where it is.
    ///
    /// # Errors
    /// In words, if it cannot be written.
    pub(crate) fn write_sheet(&self) -> Result<PathBuf, String> {
        let path = self.out.join("index.html");
        let page = page(self.sweep, self.out, self.options.draft);
        // Where nothing has changed the folder may be one that can only be read.
        if plain::read_own(&path).is_ok_and(|there| there == page.as_bytes()) {
            return Ok(path);
        }
        let written = self.destination(&Sources::default()).put(&path, page.as_bytes());
        written.map_err(|why| unwritten(&path, &why))?;
        Ok(path)
    }
}

/// The page of a sweep whose records lie in this folder. Tasks without a record are missing.
fn page(sweep: &Sweep, out: &Path, is_draft: bool) -> String {
    let title = sweep.source.name.file_name().unwrap_or_default().to_string_lossy();
    let graph = sweep.graph.file_name().unwrap_or_default().to_string_lossy();
    let (width, height) = sweep.picture.size;
    let tasks = sweep.tasks.iter().map(|task| {
        let values = &task.row.values;
        match Record::read(out, &task.name) {
            Some(record) => of_record(&record, values, out),
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
    // No text in it ends the script that it stands in.
    let data = escaped(&data.to_string()).replace('<', "\\u003c");
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

/// All modules as one, in which what one takes from another is there already.
fn script() -> String {
    let lines = SCRIPTS.iter().flat_map(|script| script.lines());
    let lines = lines.filter(|line| !line.starts_with("import "));
    let lines = lines.map(|line| line.strip_prefix("export ").unwrap_or(line));
    Vec::from_iter(lines).join("\n")
}

fn of_record(record: &Record, values: &[String], out: &Path) -> Json {
    let picture = record.picture.as_ref();
    let picture = picture.and_then(|picture| plain::read_own(&out.join(&picture.path)).ok());
    let picture =
        picture.map(|bytes| format!("data:image/jpeg;base64,{}", BASE64_STANDARD.encode(&bytes)));
    let file = |output: &super::record::Output| json!({ "name": output.name, "path": output.path, "bytes": output.bytes });
    let problem = |problem: &Json| {
        let text = |name: &str| problem[name].as_str().unwrap_or_default();
        // A problem of the whole task has a file, but no line, or neither.
        let file = problem["file"].as_str().filter(|file| !file.is_empty()).map(str::to_owned);
        let numbers = ["line", "column"].iter().map_while(|name| problem[*name].as_u64());
        let place =
            file.map(|file| numbers.fold(file, |place, number| format!("{place}:{number}")));
        json!({ "severity": text("severity"), "message": text("message"), "place": place, "help": text("help") })
    };
    json!({
        "name": record.name,
        "state": match record.state { State::Done => "done", State::Failed => "failed" },
        "values": values,
        "seconds": record.seconds,
        "nodes": record.nodes,
        "picture": picture,
        "files": record.outputs.iter().map(file).collect::<Vec<_>>(),
        "problems": record.problems.iter().map(problem).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn a_task_is_told_with_all_fields_and_a_problem_with_the_place_that_it_has() {
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
            may_pass: false,
        };
        let told = of_record(&record, &[], Path::new("nowhere"));
        let places = told["problems"].as_array().unwrap().iter().map(|it| &it["place"]);
        let expected = [json!("g.ron:3:7"), json!("g.ron"), Json::Null, Json::Null];
        assert_eq!(Vec::from_iter(places), Vec::from_iter(&expected));
        let fields =
            ["name", "state", "values", "seconds", "nodes", "picture", "files", "problems"];
        assert!(fields.iter().all(|field| told.get(field).is_some()), "{told}");
    }
}
