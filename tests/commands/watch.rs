//! `maquette watch` while an editor saves files: real ways to save real files, and the events that the program reports.

use std::path::Path;
use std::process::Command;

use serde_json::{Value as Json, json};

use crate::editors::{SEQUENCES, programs};
use crate::output::stdout_of;
use crate::project::Project;

fn count(done: &Json, state: &str) -> u64 {
    done[state].as_u64().unwrap()
}

#[test]
fn every_editors_way_of_saving_is_seen_once() {
    let project = Project::doll();
    let mut watch = project.watch(&[]);
    for (index, (editor, save)) in SEQUENCES.iter().enumerate() {
        let growth = 13.0 + index as f64;
        save(&project.graph(), &project.doll_text(growth)).unwrap();
        // On a busy machine, the watch may read a half-saved file as an invalid graph, so runs with errors are skipped.
        let run = watch.run_until_ok();
        assert_eq!(run.state("raised"), "computed", "{editor}, or the save before was seen twice");
        assert_eq!(run.state("nose"), "cached", "{editor}");
    }
    watch.end();
    project.assert_outputs_are_right();
}

#[test]
fn every_program_that_is_installed_saves_and_is_seen() {
    let project = Project::doll();
    let mut watch = project.watch(&[]);
    let mut last = 12.0;
    for (index, (program, command)) in programs().into_iter().enumerate() {
        let growth = 13.0 + index as f64;
        let wanted = project.folder().join("wanted.txt");
        std::fs::write(&wanted, project.doll_text(growth)).unwrap();
        let script = command
            .replace("OLD", &format!("default: {last:.1}"))
            .replace("NEW", &format!("default: {growth:.1}"));
        let status = Command::new("sh")
            .args(["-c", &script])
            .current_dir(project.folder())
            .env("HOME", project.folder())
            .output()
            .unwrap();
        assert!(status.status.success(), "{program}: {status:?}");
        let saved = std::fs::read_to_string(project.graph()).unwrap();
        assert_eq!(saved, project.doll_text(growth), "{script}");
        let run = watch.run_until_ok();
        assert_eq!(run.state("raised"), "computed", "{program}, or the save before was seen twice");
        last = growth;
    }
    watch.end();
    project.assert_outputs_are_right();
}

#[test]
fn a_comment_runs_no_node_and_touches_no_output() {
    let project = Project::doll();
    let mut watch = project.watch(&[]);
    let before = project.output_times();
    project.save(&format!("// A comment.\n{}", project.doll_text(12.0)));
    let run = watch.run();
    assert_eq!((count(&run.done, "computed"), count(&run.done, "cached")), (0, 15));
    assert!(run.written.iter().all(|file| file["unchanged"] == true), "{:?}", run.written);
    assert_eq!(project.output_times(), before);
}

#[test]
fn an_event_that_changes_no_content_is_dropped() {
    let project = Project::doll();
    let mut watch = project.watch(&[]);
    let text = project.doll_text(12.0);
    for _ in 0..5 {
        project.save(&text);
        let color = project.folder().join("doll/color.png");
        std::fs::write(&color, std::fs::read(&color).unwrap()).unwrap();
    }
    project.save(&project.doll_text(20.0));
    assert_eq!(watch.run().number(), 2, "the saves before caused no run");
}

#[test]
fn a_broken_graph_keeps_the_outputs_and_the_next_good_save_recovers() {
    let project = Project::doll();
    let mut watch = project.watch(&[]);
    let before = project.outputs();
    for broken in ["Graph(format: 1, nodes: {", "", &project.doll_text(99.0)] {
        project.save(broken);
        let run = watch.run();
        assert_eq!(run.done["ok"], false);
        assert_ne!(run.problems, json!([]), "after {broken:?}");
        assert_eq!(project.outputs(), before);
    }
    std::fs::remove_file(project.graph()).unwrap();
    assert_eq!(watch.run().problems[0]["code"], "G013");
    project.save(&project.doll_text(20.0));
    let run = watch.run();
    assert_eq!((&run.done["ok"], &run.problems), (&json!(true), &json!([])));
    watch.end();
    project.assert_outputs_are_right();
}

#[test]
fn errors_that_are_taken_back_go_away() {
    let project = Project::doll();
    let mut watch = project.watch(&[]);
    let good = project.doll_text(12.0);
    project.save(&good.replace("Threshold(", "Treshold("));
    watch.wait(|event| event["event"] == "problems" && event["problems"] != json!([]));
    project.save(&good);
    let event = watch.wait(|event| event["event"] == "problems" && event["problems"] == json!([]));
    assert_eq!(event["problems"], json!([]));
}

#[test]
fn a_node_that_fails_leaves_its_outputs_as_they_were() {
    let project = Project::doll();
    let mut watch = project.watch(&[]);
    let before = project.outputs();
    project.save(&project.doll_text(12.0).replace("pick: Largest", "pick: Rank(99)"));
    let run = watch.run();
    assert_eq!((run.state("nose"), run.state("model")), ("failed", "skipped"));
    assert_eq!(project.outputs(), before);
}

#[test]
fn a_file_that_is_not_there_yet_is_waited_for() {
    let project = Project::new(
        r#"Graph(
            format: 1,
            nodes: { "mesh": ReadMesh(path: "later/deep/mesh.obj") },
            outputs: { "mesh.ply": "mesh" },
        )"#,
    );
    let mut watch = project.start(&[]);
    assert_eq!(watch.run().problems[0]["code"], "G013");
    std::fs::create_dir_all(project.folder().join("later/deep")).unwrap();
    project.copy_asset("coarse.obj", "later/deep/mesh.obj");
    watch.run_until_ok();
    std::fs::rename(project.folder().join("later"), project.folder().join("away")).unwrap();
    assert_eq!(watch.run().problems[0]["code"], "G013");
    std::fs::rename(project.folder().join("away"), project.folder().join("later")).unwrap();
    watch.run_until_ok();
}

#[test]
fn a_file_that_a_node_can_do_without_is_watched_too() {
    let project = Project::doll();
    let mut watch = project.watch(&[]);
    let (camera, away) = (project.folder().join("doll/camera.json"), project.folder().join("away"));
    std::fs::rename(&camera, &away).unwrap();
    assert_eq!(watch.run().state("scan"), "computed");
    std::fs::rename(&away, &camera).unwrap();
    assert_eq!(watch.run().state("scan"), "cached");
}

#[test]
fn a_graph_that_is_used_is_watched_from_the_start_even_if_it_is_broken() {
    let used = r#"Graph(format: 1, inputs: {}, nodes: { "net": PointNet(points: [[(0, 0, 0), (1, 0, 0)], [(0, 1, 0), (1, 1, 0)]]) },
        outputs: { "net": "net" })"#;
    let project = Project::new(
        r#"Graph(format: 1, use: { "Net": "net.ron" }, nodes: { "it": Net() }, outputs: { "net.ply": "it" })"#,
    );
    let file = project.folder().join("net.ron");
    std::fs::write(&file, &used[..60]).unwrap();
    let mut watch = project.start(&[]);
    assert_eq!(watch.run().done["ok"], false);
    std::fs::write(&file, used).unwrap();
    assert_eq!(watch.run_until_ok().state("it/net"), "computed");
    std::fs::write(&file, used.replace("(1, 1, 0)", "(1, 1, 5)")).unwrap();
    assert_eq!(watch.run_until_ok().state("it/net"), "computed");
    watch.end();
}

#[test]
fn an_asset_and_a_whole_folder_can_be_replaced() {
    let project = Project::doll();
    let mut watch = project.watch(&[]);
    let color = project.folder().join("doll/color.png");
    let bytes = std::fs::read(&color).unwrap();
    std::fs::write(&color, "no picture").unwrap();
    let run = watch.run();
    assert_eq!(run.state("scan"), "failed");
    assert_eq!(run.changed, json!([color]));
    std::fs::write(&color, bytes).unwrap();
    assert_eq!(watch.run().done["ok"], true);

    let (doll, copy) = (project.folder().join("doll"), project.folder().join("copy"));
    std::fs::create_dir(&copy).unwrap();
    for file in ["color.png", "range.pcd"] {
        std::fs::copy(doll.join(file), copy.join(file)).unwrap();
    }
    std::fs::rename(&doll, project.folder().join("older")).unwrap();
    std::fs::rename(&copy, &doll).unwrap();
    let run = watch.run();
    assert_eq!(run.changed, json!([doll.join("camera.json")]), "the others came back as they were");
    project.copy_asset("camera.json", "doll/camera.json");
    assert_eq!(watch.run().done["ok"], true, "the new folder is watched");
}

#[cfg(unix)]
#[test]
fn a_graph_behind_a_link_is_watched_at_both_ends() {
    use std::os::unix::fs::symlink;
    let project = Project::doll();
    let real = project.folder().join("real");
    std::fs::create_dir(&real).unwrap();
    std::fs::rename(project.graph(), real.join("one.ron")).unwrap();
    symlink("real/one.ron", project.graph()).unwrap();
    let mut watch = project.watch(&[]);
    std::fs::write(real.join("one.ron"), project.doll_text(20.0)).unwrap();
    assert_eq!(watch.run().state("raised"), "computed");
    std::fs::write(real.join("two.ron"), project.doll_text(30.0)).unwrap();
    let new = project.folder().join("new.ron");
    symlink("real/two.ron", &new).unwrap();
    std::fs::rename(&new, project.graph()).unwrap();
    assert_eq!(watch.run().state("raised"), "computed");
    std::fs::write(real.join("two.ron"), project.doll_text(12.0)).unwrap();
    assert_eq!(watch.run().state("raised"), "cached");
}

#[test]
fn a_burst_of_files_is_one_change() {
    let names: Vec<_> = (0..50).map(|index| format!("m{index}")).collect();
    let nodes = names.iter().map(|name| format!("\"{name}\": ReadMesh(path: \"{name}.obj\"),\n"));
    let text = format!(
        "Graph(format: 1, nodes: {{ {} \"all\": Merge(meshes: {names:?}) }}, outputs: {{ \"all.ply\": \"all\" }})",
        String::from_iter(nodes)
    );
    let project = Project::new(&text);
    fn write(size: usize, project: &Project, names: &[String]) {
        for name in names {
            let text = format!("v 0 0 0\nv {size} 0 0\nv 0 1 0\nf 1 2 3\n");
            project.write(&format!("{name}.obj"), text);
        }
    }
    write(1, &project, &names);
    let mut watch = project.watch(&[]);
    write(2, &project, &names);
    let mut changed = 0;
    let mut runs = 0;
    while changed < names.len() {
        changed += watch.run_or_cancelled().changed.as_array().unwrap().len();
        runs += 1;
    }
    assert!(runs <= 5, "{runs} runs for one burst");
    watch.end();
    project.assert_outputs_are_right();
}

/// Regression test: formerly, every file event started the watch of all files anew. This took minutes, and Ctrl-C had to wait for it.
#[test]
fn a_thousand_of_three_thousand_files_can_be_saved_together() {
    const READ: usize = 3000;
    const SAVED: usize = 1000;
    let nodes = (0..READ).map(|k| format!("\"m{k}\": ReadMesh(path: \"m{k}.obj\"),\n"));
    let nodes = String::from_iter(nodes);
    let project = Project::new(&format!(
        "Graph(format: 1, nodes: {{ {nodes} }}, outputs: {{ \"first.ply\": \"m0\" }})"
    ));
    fn save(count: usize, size: usize, project: &Project) {
        for k in 0..count {
            let path = project.folder().join(format!("m{k}.obj"));
            let new = path.with_extension("new");
            std::fs::write(&new, format!("v 0 0 0\nv {size} 0 0\nv 0 1 0\nf 1 2 3\n")).unwrap();
            std::fs::rename(new, path).unwrap();
        }
    }
    save(READ, 1, &project);
    let mut watch = project.watch(&[]);
    save(SAVED, 2, &project);
    let mut changed = 0;
    while changed < SAVED {
        changed += watch.run_or_cancelled().changed.as_array().unwrap().len();
    }
    save(SAVED, 3, &project);
    watch.end();
}

#[test]
fn a_newer_save_cancels_and_keeps_what_is_done() {
    let project = Project::doll();
    let mut watch = project.watch(&[]);
    fn levels(levels: &str, project: &Project) -> String {
        let text = project.doll_text(25.0);
        text.replace("Integer(default: 1", &format!("Integer(default: {levels}"))
    }
    project.save(&levels("3", &project));
    watch.wait(|event| event["event"] == "started" && event["node"] == "skin");
    project.save(&levels("1", &project));
    watch.wait(|event| event["event"] == "cancelled");
    let run = watch.run();
    assert_eq!(run.done["ok"], true);
    assert_eq!((run.state("grid"), run.state("skin")), ("cached", "computed"));
    watch.end();
    project.assert_outputs_are_right();
}

#[test]
fn a_comment_does_not_cancel() {
    let project = Project::doll();
    let mut watch = project.watch(&[]);
    let text = project.doll_text(25.0).replace("Integer(default: 1", "Integer(default: 2");
    project.save(&text);
    watch.wait(|event| event["event"] == "started" && event["node"] == "skin");
    project.save(&format!("{text}\n// Done."));
    assert_eq!(watch.run().state("skin"), "computed");
    assert_eq!(count(&watch.run().done, "computed"), 0);
}

#[test]
fn polling_sees_changes_too_and_says_that_it_polls() {
    let project = Project::doll();
    let mut watch = project.watch(&["--poll"]);
    assert_eq!(watch.polled, json!("--poll"));
    project.save(&project.doll_text(20.0));
    assert_eq!(watch.run().state("raised"), "computed");
}

#[test]
fn an_output_never_overwrites_what_the_graph_reads() {
    let project = Project::doll();
    let text = project.doll_text(12.0).replace("\"nose-mask.png\"", "\"doll/color.png\"");
    project.save(&text);
    let before = std::fs::read(project.folder().join("doll/color.png")).unwrap();
    let folder = project.folder().to_str().unwrap().to_owned();
    let status = project.maquette(&["watch", "doll.ron", "--once", "--out", &folder]);
    assert_eq!(status.status.code(), Some(1));
    assert_eq!(std::fs::read(project.folder().join("doll/color.png")).unwrap(), before);
}

/// No file event reports that a folder can be written to again.
#[test]
fn outputs_that_could_not_be_written_are_written_as_soon_as_they_can_be() {
    let project = Project::doll();
    // A file in place of the folder prevents every user, even root, from writing.
    let out = project.folder().join("out");
    std::fs::write(&out, "").unwrap();
    let mut watch = project.start(&[]);
    assert_eq!(watch.run().done["ok"], false);
    std::fs::remove_file(&out).unwrap();
    assert_eq!(watch.run().done["ok"], true);
    watch.end();
    project.assert_outputs_are_right();
}

#[test]
fn once_evaluates_and_ends_with_an_exit_code() {
    let project = Project::doll();
    fn run_once(more: &[&str], project: &Project) -> Option<i32> {
        let arguments = [&["watch", "doll.ron", "--once", "--out", "out"], more].concat();
        project.maquette(&arguments).status.code()
    }
    assert_eq!(run_once(&[], &project), Some(0));
    project.assert_outputs_are_right();
    assert_eq!(run_once(&["--on-done", "exit 3"], &project), Some(1));
    assert_eq!(run_once(&["--set", "growth=99"], &project), Some(1));
    assert_eq!(run_once(&["--set", "nose.pick=Rank(99)"], &project), Some(1));
}

#[cfg(unix)]
#[test]
fn a_command_runs_after_each_good_run() {
    let project = Project::doll();
    let mut watch =
        project.watch(&["--on-done", "ls \"$MAQUETTE_OUT\" > listed.tmp; mv listed.tmp listed"]);
    let listed = project.folder().join("listed");
    fn wait(listed: &Path) -> String {
        while !listed.exists() {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        std::fs::read_to_string(listed).unwrap()
    }
    assert!(wait(&listed).contains("model.glb"));
    std::fs::remove_file(&listed).unwrap();
    project.save(&project.doll_text(20.0));
    watch.run();
    assert!(wait(&listed).contains("model.glb"));
}

#[test]
fn list_names_every_path_and_why() {
    let project = Project::doll();
    let list = project.maquette(&["watch", "doll.ron", "--list"]);
    let text = stdout_of(&list).replace('\\', "/");
    for line in [
        "doll.ron  the graph",
        "doll/color.png  read by `scan`",
        "doll/camera.json  read by `scan` if it exists",
        "maquette.toml  marks the root of the project",
    ] {
        assert!(text.lines().any(|listed| listed == line), "{line} is missing:\n{text}");
    }
    assert!(!Path::new(&project.folder().join("out")).exists());
}

#[test]
fn a_killed_watch_needs_no_cleaning_up() {
    let project = Project::doll();
    // The delays are spread over a run, from its first node to its last file.
    for delay in [0, 3, 9, 20, 40, 60, 80, 110, 150, 200] {
        let mut watch = project.start(&[]);
        watch.wait(|event| event["event"] == "run");
        project.save(&project.doll_text(13.0 + f64::from(delay) / 10.0));
        std::thread::sleep(std::time::Duration::from_millis(delay as u64));
        watch.kill();
        project.assert_no_output_is_torn();
    }
    let mut watch = project.watch(&[]);
    watch.end();
    project.assert_outputs_are_right();
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_a_watch_and_a_run_and_leaves_nothing_half_written() {
    let project = Project::doll();
    let mut watch = project.watch(&[]);
    project.save(&project.doll_text(30.0).replace("Integer(default: 1", "Integer(default: 3"));
    watch.wait(|event| event["event"] == "started" && event["node"] == "skin");
    assert_eq!(watch.interrupt(), Some(0));
    project.assert_no_output_is_torn();
    project.assert_no_temporary_file();

    // Run without the cache: the interrupted watch may have just stored the result of `skin`, but this run must compute it.
    let arguments = ["run", "doll.ron", "--events", "--no-cache", "--out", "out"];
    let mut run = project.spawn(&arguments);
    run.wait(|event| event["event"] == "started" && event["node"] == "skin");
    assert_eq!(run.interrupt(), Some(130));
    project.assert_no_output_is_torn();
    project.assert_no_temporary_file();
}

#[cfg(target_os = "linux")]
#[test]
fn what_is_kept_beside_a_large_file_goes_with_its_watch() {
    let project = Project::doll();
    let mut watch = project.watch(&[]);
    for growth in [13.0, 14.0, 15.0, 16.0] {
        let text = project.doll_text(growth);
        project.save(&text.replace("Integer(default: 1", "Integer(default: 3"));
        watch.run_until_ok();
    }
    let names = std::fs::read_dir(project.folder().join("out")).unwrap();
    let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    assert_eq!(names.filter(|name| name.starts_with('.')).count(), 2, "of GLB and PLY");
    watch.end();
    project.assert_no_temporary_file();
}

#[test]
fn run_tells_events_too() {
    let project = Project::doll();
    let run = project.maquette(&["run", "doll.ron", "--events", "--out", "out"]);
    let events: Vec<Json> = run
        .stdout
        .split(|&byte| byte == b'\n')
        .filter(|line| !line.is_empty())
        .map(|line| serde_json::from_slice(line).unwrap())
        .collect();
    fn kinds(kind: &str, events: &[Json]) -> usize {
        events.iter().filter(|event| event["event"] == kind).count()
    }
    assert_eq!((kinds("started", &events), kinds("finished", &events)), (15, 15));
    assert_eq!(
        (kinds("problems", &events), kinds("written", &events), kinds("done", &events)),
        (1, 5, 1)
    );
    assert_eq!(events.last().unwrap()["ok"], true);
}

#[test]
fn a_watch_that_is_not_on_a_terminal_prints_one_line_a_run() {
    let project = Project::doll();
    let once = project.maquette(&["watch", "doll.ron", "--once", "--out", "out"]);
    let text = stdout_of(&once);
    assert_eq!(text.lines().count(), 1, "{text}");
    assert!(text.starts_with("run 1: 15 computed; 5 files written; "), "{text}");
    assert!(!text.contains('\x1b'), "{text}");
}
