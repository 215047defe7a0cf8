//! `maquette batch` runs one graph for many scans and many values. Each test is named after a guarantee of the command.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use serde_json::Value as Json;

use crate::output::{stderr_of, stdout_of};
use crate::project::Project;
use crate::thorough::is_thorough;

const SWEEP: &str = r#"Sweep(
    graph: "doll.ron",
    over: Product([
        Files("scans/*/range.pcd", set: "scan.range", name: "scan"),
        Zip([Values("growth", [5, 12, 20]), Values("levels", [0, 1, 1])]),
    ]),
    out: "{scan}/{growth}_{levels}",
    picture: ("model.glb", camera: (30, 15)),
)
"#;

/// Makes a project with the example graph `doll.ron`, several scans and a sweep.
fn project_with_scans(scans: &[&str], sweep: &str) -> Project {
    let project = Project::doll();
    for scan in scans {
        fs::create_dir_all(project.folder().join("scans").join(scan)).unwrap();
        project.copy_asset("range.pcd", &format!("scans/{scan}/range.pcd"));
        project.copy_asset("color.png", &format!("scans/{scan}/color.png"));
    }
    project.write("doll.sweep.ron", sweep);
    project
}

/// Runs a batch and returns its exit code and its JSON document.
fn batch(project: &Project, more: &[&str]) -> (Option<i32>, Json) {
    let words =
        [&["batch", "doll.sweep.ron", "--out", "all", "--json", "--threads", "1"], more].concat();
    let output = project.maquette(&words);
    let told = stderr_of(&output);
    let document = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{told}"));
    (output.status.code(), document)
}

fn names(document: &Json, is_wanted: impl Fn(&Json) -> bool) -> Vec<String> {
    let tasks = document["tasks"].as_array().unwrap().iter();
    tasks
        .filter(|task| is_wanted(task))
        .map(|task| task["name"].as_str().unwrap().to_owned())
        .collect()
}

fn ran(document: &Json) -> Vec<String> {
    names(document, |task| task["ran"] == true)
}

/// Returns the hash of each output of each task, from the JSON document of a batch.
fn hashes(document: &Json) -> BTreeMap<String, String> {
    let mut hashes = BTreeMap::new();
    for task in document["tasks"].as_array().unwrap() {
        for output in task["outputs"].as_array().unwrap() {
            let path = output["path"].as_str().unwrap().to_owned();
            hashes.insert(path, output["hash"].as_str().unwrap().to_owned());
        }
    }
    hashes
}

#[test]
fn each_with_each_and_one_with_another() {
    let project = project_with_scans(&["a", "b-10", "b-2"], SWEEP);
    let (code, document) = batch(&project, &[]);
    assert_eq!(code, Some(0), "{document}");
    let all = names(&document, |_| true);
    fn tasks_of(scan: &str) -> [String; 3] {
        ["5_0", "12_1", "20_1"].map(|rest| format!("{scan}/{rest}"))
    }
    assert_eq!(all, [tasks_of("a"), tasks_of("b-2"), tasks_of("b-10")].concat());
    let first = &document["tasks"][1]["values"];
    assert_eq!(
        (&first["scan"], &first["growth"], &first["levels"]),
        (&"a".into(), &"12".into(), &"1".into())
    );
    // The scans are copies of each other: only the tasks of the first scan compute nodes, and the other tasks use cached results. The
    // outputs of a task must equal those of `maquette run` with the same values.
    let computed =
        |index: usize| document["tasks"][index]["nodes"]["computed"].as_u64().unwrap_or(0);
    assert_eq!((0..9).map(computed).collect::<Vec<_>>(), [15, 8, 8, 0, 0, 0, 0, 0, 0]);
    let run = ["run", "doll.ron", "--out", "one", "--set", "growth=12", "--set", "levels=1"];
    assert!(
        project
            .maquette(&[&run[..], &["--set", "scan.range=scans/a/range.pcd"]].concat())
            .status
            .success()
    );
    for file in ["model.glb", "model.ply", "blended.pcd", "surface.ply", "nose-mask.png"] {
        fn read(folder: &str, project: &Project, file: &str) -> Vec<u8> {
            fs::read(project.folder().join(folder).join(file)).unwrap()
        }
        assert!(read("all/a/12_1", &project, file) == read("one", &project, file), "{file}");
    }
}

/// Returns the names of the tasks for which a record file exists.
fn read_records(folder: &Path) -> BTreeSet<String> {
    fn collect(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).into_iter().flatten() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => collect(&path, found),
                false => found.push(path),
            }
        }
    }
    let mut files = Vec::new();
    collect(folder, &mut files);
    let records =
        files.iter().filter(|path| path.extension().is_some_and(|ending| ending == "json"));
    records
        .map(|path| path.strip_prefix(folder).unwrap().with_extension("").display().to_string())
        .collect()
}

#[test]
fn a_killed_run_loses_nothing_that_was_done() {
    let sweep = SWEEP
        .replace("[5, 12, 20]", "[5, 6, 7, 8, 9, 10]")
        .replace("[0, 1, 1]", "[0, 0, 0, 0, 0, 0]");
    let project = project_with_scans(&["a"], &sweep);
    let (code, whole) = batch(&project, &[]);
    assert_eq!(code, Some(0), "{whole}");
    let (hashes, all) = (hashes(&whole), names(&whole, |_| true));
    let seconds = whole["seconds"].as_f64().unwrap();
    let mut seen = BTreeSet::new();
    let moments = if is_thorough() { 20 } else { 8 };
    for moment in 0..moments {
        fs::remove_dir_all(project.folder().join("all")).unwrap();
        // In every second round, also remove the results from the cache.
        if moment % 2 == 0 {
            assert!(project.maquette(&["cache", "clear"]).status.success() || moment == 0);
        }
        let words = ["batch", "doll.sweep.ron", "--out", "all", "--threads", "1"];
        let mut child = project.command(&words).stdout(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_secs_f64(
            seconds * f64::from(moment) / f64::from(moments),
        ));
        child.kill().unwrap();
        child.wait().unwrap();
        let before = read_records(&project.folder().join("all/tasks"));
        let (code, document) = batch(&project, &[]);
        assert_eq!(code, Some(0), "{document}");
        let rest = all.iter().filter(|name| !before.contains(*name)).cloned();
        assert_eq!(ran(&document), Vec::from_iter(rest), "after {} records", before.len());
        assert_eq!(self::hashes(&document), hashes);
        seen.insert(before.len());
    }
    assert!(seen.len() > 2, "killed too late or too early: {seen:?}");
}

#[test]
fn any_number_of_tasks_at_a_time_gives_the_same() {
    let project = project_with_scans(&["a", "b"], SWEEP);
    let (_, one) = batch(&project, &[]);
    for jobs in ["2", "5"] {
        fs::remove_dir_all(project.folder().join("all")).unwrap();
        let (code, several) = batch(&project, &["--jobs", jobs]);
        assert_eq!((code, ran(&several).len()), (Some(0), 6));
        assert_eq!(hashes(&several), hashes(&one));
    }
    // A render farm runs the tasks one by one, in any order, and makes the report page from their results at the end.
    fs::remove_dir_all(project.folder().join("all")).unwrap();
    assert_eq!(batch(&project, &["--warm"]).0, Some(0));
    for range in ["4-5", "1", "2-3", "0"] {
        let (code, document) = batch(&project, &["--task", range]);
        assert_eq!((code, &document["sheet"]), (Some(0), &Json::Null));
    }
    assert!(!project.folder().join("all/index.html").exists());
    let report = project.maquette(&["batch", "doll.sweep.ron", "--out", "all", "--report"]);
    assert_eq!(stdout_of(&report), "all/index.html\n");
    let page = project.read("all/index.html");
    assert_eq!(page.matches("data:image/jpeg;base64,").count(), 6);
    let (_, document) = batch(&project, &[]);
    assert_eq!((ran(&document), hashes(&document)), (Vec::new(), hashes(&one)));
    let wrong = project.maquette(&["batch", "doll.sweep.ron", "--task", "6"]);
    assert_eq!(stderr_of(&wrong), "error: expected a task from 0 to 5, found 6\n");
    assert_eq!(wrong.status.code(), Some(2));
}

#[test]
fn samples_of_the_documentation_run() {
    let text = include_str!("../../src/lsp/manual/sweep.md");
    let mut count = 0;
    for sample in text.split("```ron\n").skip(1).map(|rest| rest.split("```").next().unwrap()) {
        let project = project_with_scans(&[], sample);
        fs::create_dir(project.folder().join("lib")).unwrap();
        let skin = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../graphs/lib/skin.ron");
        fs::copy(skin, project.folder().join("lib/skin.ron")).unwrap();
        project.write("cases.csv", "levels\n0\n1\n");
        let (code, document) = batch(&project, &[]);
        assert_eq!(code, Some(0), "{document}");
        let has_picture =
            |name: &String| project.folder().join("all/tasks").join(format!("{name}.jpg")).exists();
        let all = names(&document, |task| task["state"] == "done");
        assert!(all.len() > 1 && all.iter().all(has_picture), "{all:?}");
        let format = project.maquette(&["fmt", "--check", "doll.sweep.ron"]);
        assert!(format.status.success(), "{sample}");
        count += 1;
    }
    assert_eq!(count, 3);
}

#[test]
fn the_next_batch_need_not_read_the_outputs_of_tasks_that_were_run_a_while_before_the_last() {
    let project = project_with_scans(&["a"], SWEEP);
    batch(&project, &[]);
    let record = fs::read(project.folder().join("all/tasks/a/5_0.json")).unwrap();
    let record: Json = serde_json::from_slice(&record).unwrap();
    let outputs = record["outputs"].as_array().unwrap();
    assert!(!outputs.is_empty());
    assert!(outputs.iter().all(|output| output["left"]["settled"] == true), "{record}");
}
