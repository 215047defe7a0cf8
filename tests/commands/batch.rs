//! `maquette batch` runs one graph for many scans and many values. Each test is named after a guarantee of the command.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use serde_json::Value as Json;

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
    write(&project, "doll.sweep.ron", sweep);
    project
}

fn write(project: &Project, name: &str, text: &str) {
    fs::write(project.folder().join(name), text).unwrap();
}

/// Runs a batch and returns its exit code and its JSON document.
fn batch(project: &Project, more: &[&str]) -> (Option<i32>, Json) {
    let words =
        [&["batch", "doll.sweep.ron", "--out", "all", "--json", "--threads", "1"], more].concat();
    let output = project.maquette(&words);
    let told = String::from_utf8_lossy(&output.stderr);
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

/// Returns the hash of each output of each task.
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

/// Returns the diagnostics of `check` for a sweep: line, column and message.
fn problems(project: &Project, text: &str) -> Vec<(u64, u64, String)> {
    write(project, "doll.sweep.ron", text);
    let output = project.maquette(&["check", "doll.sweep.ron", "--json"]);
    let document: Json = serde_json::from_slice(&output.stdout).unwrap();
    document["problems"]
        .as_array()
        .unwrap()
        .iter()
        .map(|it| {
            fn number(name: &str, it: &Json) -> u64 {
                it[name].as_u64().unwrap()
            }
            (number("line", it), number("column", it), it["message"].as_str().unwrap().to_owned())
        })
        .collect()
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

#[test]
fn what_is_wrong_is_told_once_at_its_place_before_anything_runs() {
    let project = project_with_scans(&["a"], SWEEP);
    fn sweep(over: &str, rest: &str) -> String {
        format!("Sweep(\n    graph: \"doll.ron\",\n    over: {over},\n{rest})\n")
    }
    let zip = sweep("Zip([Values(\"growth\", [5, 12, 20]), Values(\"levels\", [0, 1])])", "");
    assert_eq!(
        problems(&project, &zip),
        [(3, 47, "`levels` has 2 values, and `growth` has 3".into())]
    );
    for (over, rest, line, column, message) in [
        ("Values(\"growht\", [1, 2])", "", 3, 18, "the graph has no parameter `growht`"),
        (
            "Values(\"growth\", [1, 99])",
            "",
            3,
            32,
            "parameter `growth` is 99 mm, but must be at least 0 and at most 40 mm",
        ),
        (
            "Values(\"red.select.distanse\", [1, 2])",
            "",
            3,
            18,
            "doll.ron:15:55: Near has no field `distanse`",
        ),
        (
            "Values(\"growth\", [5, 5.0])",
            "out: \"a\"",
            4,
            6,
            "two tasks have the name `a`: growth = 5 and growth = 5.0",
        ),
        ("Values(\"growth\", [5, 6])", "out: \"{grwth}\"", 4, 7, "unknown name `grwth` in `over`"),
        (
            "Values(\"growth\", [5, 6])",
            "out: \"tasks/{growth}\"",
            4,
            6,
            "`tasks/5` cannot name a task: the batch writes its records and its contact sheet there",
        ),
        ("Files(\"scan/*\", set: \"scan.range\")", "", 3, 17, "no file matches `scan/*`"),
        ("Files(\"../*\", set: \"scan.range\")", "", 3, 17, ""),
        (
            "Values(\"growth\", [5])",
            "set: {\"levels\": 9}",
            4,
            17,
            "parameter `levels` is 9, but must be at least 0 and at most 4",
        ),
        (
            "Values(\"growth\", [5])",
            "picture: \"modl.glb\"",
            4,
            10,
            "the graph has no output `modl.glb`",
        ),
        ("Values(\"growth\", [])", "", 3, 28, "`growth` has no values"),
        ("Valeus(\"growth\", [5])", "", 3, 11, "field `over` of Sweep has no choice `Valeus`"),
    ] {
        let found = problems(&project, &sweep(over, rest));
        let [(at_line, at_column, told), others @ ..] = &found[..] else {
            panic!("{over} {rest}: nothing is told")
        };
        assert_eq!((*at_line, *at_column), (line, column), "{found:?}");
        assert!(message.is_empty() || (told == message && others.is_empty()), "{found:?}");
    }
    let output = project.maquette(&["batch", "doll.sweep.ron"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(!project.folder().join("out").exists(), "something was run");
    // Two folder names that differ only in case are an error, because they may denote one folder. Names that are invalid as folder names
    // are errors, too.
    let red = problems(
        &project,
        &sweep(
            "Values(\"red.select.color\", [\"#ff0000\", \"#FF0000\"])",
            "out: \"{red.select.color}\"",
        ),
    );
    assert_eq!(red.len(), 1, "{red:?}");
}

#[test]
fn tasks_of_one_name_are_told_what_gives_them_their_own() {
    let project = project_with_scans(&["a"], SWEEP);
    fn help(over: &str, out: &str, project: &Project) -> String {
        let sweep = format!("Sweep(graph: \"doll.ron\", over: {over}, out: \"{out}\")");
        write(project, "doll.sweep.ron", &sweep);
        let told = project.maquette(&["batch", "doll.sweep.ron"]);
        assert_eq!(told.status.code(), Some(1));
        let told = String::from_utf8(told.stderr).unwrap();
        told.split("help: ").nth(1).expect("help").trim_end().to_owned()
    }
    let two = "Product([Values(\"growth\", [5, 12]), Values(\"levels\", [0, 1])])";
    let named = help(two, "{growth}", &project);
    assert!(named.ends_with("add the values that differ: `out: \"{growth}_{levels}\"`"), "{named}");
    assert!(
        problems(
            &project,
            &format!("Sweep(graph: \"doll.ron\", over: {two}, out: \"{{growth}}_{{levels}}\")")
        )
        .is_empty()
    );
    let all = help(two, "one", &project);
    assert!(all.ends_with("add the values that differ: `out: \"one_{growth}_{levels}\"`"), "{all}");
    let twice = help("Values(\"growth\", [5, 12, 5])", "{growth}", &project);
    assert!(twice.ends_with("remove one of the two equal sets of values"), "{twice}");
    let colors = help(
        "Values(\"red.select.color\", [\"#ff0000\", \"#FF0000\"])",
        "{red.select.color}",
        &project,
    );
    assert!(colors.contains("case of letters"), "{colors}");
}

#[test]
fn values_for_all_that_count_for_none_are_told() {
    let project = project_with_scans(&["a"], SWEEP);
    let set = SWEEP.replace(
        "    out:",
        "    set: { \"growth\": 3, \"red.select.distance\": 30.0 },\n    out:",
    );
    let told = "`growth` has no effect: each task has its own value from `over`";
    assert_eq!(problems(&project, &set), [(7, 12, told.to_owned())]);
    let output = project.maquette(&["batch", "doll.sweep.ron", "-n", "--set", "levels=2"]);
    assert!(output.status.success());
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(told.contains("`--set levels=2` has no effect"), "{told}");
    // The output that a sweep gives as `picture` must exist, also in a graph with inputs.
    let sweep = "Sweep(graph: \"lib.ron\", over: Values(\"up\", [1, 2]), picture: \"nonsense\")";
    write(
        &project,
        "lib.ron",
        "Graph(format: 1, inputs: { \"m\": Mesh(doc: \"\") }, params: { \"up\": Number(default: 0.0, doc: \"\") }, nodes: { \"t\": Transform(mesh: \"m\", translate: (0, Param(\"up\"), 0)) }, outputs: { \"mesh\": \"t\" })",
    );
    let told = problems(&project, sweep);
    assert_eq!(
        told.iter().map(|it| &it.2[..]).collect::<Vec<_>>(),
        ["the graph has no output `nonsense`"]
    );
    assert_eq!(problems(&project, &sweep.replace("nonsense", "mesh")), []);
}

#[test]
fn one_that_fails_leaves_the_others() {
    let project = project_with_scans(
        &["a", "b", "c", "d", "e", "f"],
        &SWEEP.replace("[5, 12, 20]", "[5]").replace("[0, 1, 1]", "[0]"),
    );
    write(&project, "scans/c/range.pcd", "VERSION 0.7\nnot a range image\n");
    let (code, document) = batch(&project, &[]);
    assert_eq!(code, Some(1));
    assert_eq!(names(&document, |task| task["state"] == "failed"), ["c/5_0"]);
    assert_eq!(names(&document, |task| task["outputs"].as_array().unwrap().len() == 5).len(), 5);
    let told = &document["tasks"][2]["problems"][0]["message"];
    assert!(told.as_str().unwrap().contains("range.pcd"), "{told}");
    let words = project.maquette(&["batch", "doll.sweep.ron", "--out", "all"]);
    let (out, err) =
        (String::from_utf8(words.stdout).unwrap(), String::from_utf8(words.stderr).unwrap());
    assert!(out.contains("6 tasks: 5 done, 1 failed; 0 run now"), "{out}");
    assert!(err.contains("error: "), "{err}");
    assert_eq!(words.status.code(), Some(1));
    // The failed task is not repeated by itself: it is run again only with `--retry`, or if something has changed.
    assert_eq!(ran(&batch(&project, &["--retry"]).1), ["c/5_0"]);
    project.copy_asset("range.pcd", "scans/c/range.pcd");
    let (code, document) = batch(&project, &[]);
    assert_eq!((code, ran(&document)), (Some(0), vec!["c/5_0".to_owned()]));
}

/// Returns the names of the tasks that have a record.
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
        // In every second round, the results are removed from the cache, too.
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
fn a_change_runs_its_own_tasks_and_no_others() {
    let project = project_with_scans(&["a", "b"], SWEEP);
    assert_eq!(ran(&batch(&project, &[]).1).len(), 6);
    assert_eq!(ran(&batch(&project, &[]).1), [""; 0]);
    // A scan has changed: its tasks are run.
    let scan = project.folder().join("scans/b/range.pcd");
    let mut bytes = fs::read(&scan).unwrap();
    let last = bytes.len() - 2;
    bytes[last] ^= 1;
    fs::write(&scan, bytes).unwrap();
    assert_eq!(ran(&batch(&project, &[]).1), ["b/5_0", "b/12_1", "b/20_1"]);
    // An additional comment in the graph changes no value, so no task is run.
    fs::write(project.graph(), format!("// Mine.\n{}", project.doll_text(12.0))).unwrap();
    assert_eq!(ran(&batch(&project, &[]).1), [""; 0]);
    // A value of the sweep has changed: the tasks with this value are run.
    write(&project, "doll.sweep.ron", &SWEEP.replace("[5, 12, 20]", "[5, 12, 21]"));
    assert_eq!(ran(&batch(&project, &[]).1), ["a/21_1", "b/21_1"]);
    // An output was changed or deleted: its task is run.
    fs::write(project.folder().join("all/a/5_0/model.ply"), "mine").unwrap();
    fs::remove_file(project.folder().join("all/b/5_0/nose-mask.png")).unwrap();
    let (_, document) = batch(&project, &[]);
    assert_eq!(ran(&document), ["a/5_0", "b/5_0"]);
    assert!(fs::read(project.folder().join("all/a/5_0/model.ply")).unwrap().starts_with(b"ply"));
    // A picture of the contact sheet was changed: its task is run.
    let picture = project.folder().join("all/tasks/a/5_0.jpg");
    let before = fs::read(&picture).unwrap();
    fs::write(&picture, "no picture").unwrap();
    assert_eq!(ran(&batch(&project, &[]).1), ["a/5_0"]);
    assert_eq!(fs::read(&picture).unwrap(), before);
    assert_eq!(ran(&batch(&project, &[]).1), [""; 0]);
    // The graph has changed: all tasks are run.
    fs::write(project.graph(), project.doll_text(12.0).replace("distance: 30.0", "distance: 31.0"))
        .unwrap();
    assert_eq!(ran(&batch(&project, &[]).1).len(), 6);
}

#[test]
fn drafts_lie_beside_the_final_results() {
    let project = project_with_scans(&["a"], SWEEP);
    fn run(more: &[&str], project: &Project) {
        let words = [&["batch", "doll.sweep.ron"], more].concat();
        assert!(project.maquette(&words).status.success());
    }
    fn read(name: &str, project: &Project) -> Vec<u8> {
        fs::read(project.folder().join("out").join(name)).unwrap()
    }
    run(&[], &project);
    let (model, page) =
        (read("doll.sweep/a/5_0/model.glb", &project), read("doll.sweep/index.html", &project));
    run(&["--draft"], &project);
    assert_eq!(read("doll.sweep/a/5_0/model.glb", &project), model);
    assert_eq!(read("doll.sweep/index.html", &project), page);
    assert!(!read("doll.sweep-draft/a/5_0/model.glb", &project).is_empty());
    fn names_sweep(name: &str, project: &Project) -> bool {
        String::from_utf8(read(name, project)).unwrap().contains("sweep.ron, drafts")
    }
    assert_eq!(
        (
            names_sweep("doll.sweep-draft/index.html", &project),
            names_sweep("doll.sweep/index.html", &project)
        ),
        (true, false)
    );
}

#[test]
fn a_dry_run_says_what_would_run_and_why() {
    let project = project_with_scans(&["a"], SWEEP);
    fn words(project: &Project) -> String {
        let output = project.maquette(&["batch", "doll.sweep.ron", "--out", "all", "-n"]);
        assert!(output.status.success());
        String::from_utf8(output.stdout).unwrap()
    }
    expect_test::expect![[r#"
        run        0  a/5_0   it has not been run; 15 nodes, 15 of them new
        run        1  a/12_1  it has not been run; 15 nodes, 8 of them new
        run        2  a/20_1  it has not been run; 15 nodes, 8 of them new
        3 of 3 tasks would run: 31 nodes instead of 45, because shared nodes are computed once
    "#]]
    .assert_eq(&words(&project));
    assert!(!project.folder().join("all").exists());
    let (_, document) = batch(&project, &[]);
    let computed = document["tasks"]
        .as_array()
        .unwrap()
        .iter()
        .map(|task| task["nodes"]["computed"].as_u64().unwrap());
    assert_eq!(computed.sum::<u64>(), 31);
    write(&project, "doll.sweep.ron", &SWEEP.replace("[5, 12, 20]", "[5, 12, 30]"));
    fs::remove_file(project.folder().join("all/a/5_0/surface.ply")).unwrap();
    expect_test::expect![[r#"
        run        0  a/5_0   its output `surface.ply` was changed after the run; 0 nodes, 0 of them new
        done       1  a/12_1  nothing has changed
        run        2  a/30_1  it has not been run; 8 nodes, 8 of them new
        2 of 3 tasks would run: 8 nodes
    "#]]
    .assert_eq(&words(&project));
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
    // A farm runs the tasks one by one, in any order, and makes the page from their results at the end.
    fs::remove_dir_all(project.folder().join("all")).unwrap();
    assert_eq!(batch(&project, &["--warm"]).0, Some(0));
    for range in ["4-5", "1", "2-3", "0"] {
        let (code, document) = batch(&project, &["--task", range]);
        assert_eq!((code, &document["sheet"]), (Some(0), &Json::Null));
    }
    assert!(!project.folder().join("all/index.html").exists());
    let report = project.maquette(&["batch", "doll.sweep.ron", "--out", "all", "--report"]);
    assert_eq!(String::from_utf8(report.stdout).unwrap(), "all/index.html\n");
    let page = fs::read_to_string(project.folder().join("all/index.html")).unwrap();
    assert_eq!(page.matches("data:image/jpeg;base64,").count(), 6);
    let (_, document) = batch(&project, &[]);
    assert_eq!((ran(&document), hashes(&document)), (Vec::new(), hashes(&one)));
    let wrong = project.maquette(&["batch", "doll.sweep.ron", "--task", "6"]);
    assert_eq!(
        String::from_utf8(wrong.stderr).unwrap(),
        "error: expected a task from 0 to 5, found 6\n"
    );
    assert_eq!(wrong.status.code(), Some(2));
}

#[test]
fn a_graph_and_options_stand_for_a_sweep() {
    let project = project_with_scans(&["a", "b"], "");
    fs::remove_file(project.folder().join("doll.sweep.ron")).unwrap();
    let words = ["batch", "doll.ron", "--sweep", "growth=5,mm(12)", "--scans", "scans/*", "--json"];
    let output = project.maquette(&words);
    let document: Json = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        names(&document, |task| task["state"] == "done"),
        ["a_5", "a_mm-12", "b_5", "b_mm-12"]
    );
    assert_eq!(document["sheet"], "out/doll.sweep/index.html");
    // A scan lacks a file that the other scans have. It is not silently combined with the file that the graph names.
    let color = project.folder().join("scans/b/color.png");
    fs::remove_file(&color).unwrap();
    let output = project.maquette(&words);
    let document: Json = serde_json::from_slice(&output.stdout).unwrap();
    let told = document["problems"].as_array().unwrap().iter().map(|it| &it["message"]);
    let lacks = "`scans/b` has no `color.png`: its task uses `doll/color.png`";
    assert_eq!(Vec::from_iter(told), [lacks]);
    fs::copy(project.folder().join("scans/a/color.png"), &color).unwrap();
    // Files that the graph names may be missing if all scans replace them.
    fs::remove_dir_all(project.folder().join("doll")).unwrap();
    assert!(project.maquette(&[&words[..], &["--out", "other"]].concat()).status.success());
    for (words, told) in [
        (&["batch", "doll.ron"][..], "doll.ron is not a Sweep(..)"),
        (&["batch", "doll.ron", "--sweep", "growth"], "expected NAME=VALUE"),
        (&["batch", "doll.ron", "--sweep", "growth="], "expected values separated by commas"),
        (&["batch", "nowhere.ron"], "cannot read nowhere.ron"),
        (
            &["batch", "doll.ron", "--sweep", "growth=1", "--task", "3-1"],
            "expected I or FIRST-LAST",
        ),
    ] {
        let output = project.maquette(words);
        let err = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && err.contains(told), "{words:?}: {err}");
    }
}

#[test]
fn what_is_no_scan_is_left_out() {
    let project = project_with_scans(&["a"], "");
    fs::remove_file(project.folder().join("doll.sweep.ron")).unwrap();
    fs::create_dir(project.folder().join("scans/broken-off")).unwrap();
    write(&project, "scans/notes.txt", "by hand");
    let words = ["batch", "doll.ron", "--scans", "scans/*"];
    let output = project.maquette(&[&words[..], &["--json"]].concat());
    let document: Json = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(names(&document, |task| task["state"] == "done"), ["a"]);
    let told = document["problems"].as_array().unwrap().iter().map(|it| &it["message"]);
    let expected = [
        "`scans/broken-off` has none of the files that the graph reads (`color.png`, `range.pcd`); it is ignored",
        "the graph reads no file that `scans/notes.txt` could replace; it is ignored",
    ];
    assert_eq!(Vec::from_iter(told), expected);
    fs::remove_dir_all(project.folder().join("scans/a")).unwrap();
    let output = project.maquette(&words);
    let err = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(1) && err.contains("has none of the files"), "{err}");
}

#[test]
fn graphs_with_inputs_are_swept_over_files() {
    let project = Project::doll();
    fs::create_dir(project.folder().join("lib")).unwrap();
    fs::copy(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../graphs/lib/skin.ron"),
        project.folder().join("lib/skin.ron"),
    )
    .unwrap();
    let sweep = r#"Sweep(
        graph: "lib/skin.ron",
        over: Product([
            Files(pattern: "doll/*.pcd", input: "range", name: "scan"),
            Files("doll/color.png", input: "color", name: "picture"),
            Values("levels", [0, 1]),
        ]),
        picture: (output: "mesh"),
    )"#;
    write(&project, "doll.sweep.ron", sweep);
    let (code, document) = batch(&project, &[]);
    assert_eq!(code, Some(0), "{document}");
    assert_eq!(names(&document, |_| true), ["range_color_0", "range_color_1"]);
    assert!(project.folder().join("all/tasks/range_color_1.jpg").exists());
    assert_eq!(ran(&batch(&project, &[]).1), [""; 0]);
    let wrong = sweep.replace("input: \"range\"", "input: \"rnage\"");
    assert_eq!(problems(&project, &wrong)[0], (4, 49, "the graph has no input `rnage`".into()));
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
        write(&project, "cases.csv", "levels\n0\n1\n");
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
fn what_a_killed_batch_left_among_its_records_goes_though_nothing_is_run() {
    let project = project_with_scans(&["a"], SWEEP);
    batch(&project, &[]);
    let left = project.folder().join("all/tasks/.maquette-aB3dE5gH7jK9.part");
    fs::write(&left, "half of a record").unwrap();
    let (status, document) = batch(&project, &[]);
    assert_eq!((status, ran(&document).len(), left.exists()), (Some(0), 0, false));
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
