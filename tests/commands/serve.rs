//! `maquette serve --stdio` as a host program sees it: the guarantees of docs/serve.md, and hosts that lie, stall or die.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value as Json, json};

use crate::project::Project;

mod materials;
mod missing;
mod outline;

/// A host program, and the server that it has started.
struct Host {
    process: Child,
    requests: Option<ChildStdin>,
    events: BufReader<ChildStdout>,
    folder: PathBuf,
    asked: u64,
    /// The final events of other requests, which arrived while the host waited for the end of one request.
    ends: Vec<Json>,
}

impl Host {
    fn start(project: &Project) -> Self {
        Self::start_with(project, &[])
    }

    fn start_with(project: &Project, more: &[&str]) -> Self {
        let mut command = project.command(&[&["serve", "--stdio"], more].concat());
        let piped = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut process = piped.spawn().unwrap();
        let requests = process.stdin.take();
        let events = BufReader::new(process.stdout.take().unwrap());
        let mut host =
            Self { process, requests, events, folder: PathBuf::new(), asked: 0, ends: Vec::new() };
        let ready = host.hear();
        assert_eq!((&ready["event"], &ready["protocol"]), (&json!("ready"), &json!(1)), "{ready}");
        host.folder = ready["folder"].as_str().unwrap().into();
        host
    }

    fn hear(&mut self) -> Json {
        let mut line = String::new();
        self.events.read_line(&mut line).unwrap();
        serde_json::from_str(&line).unwrap_or_else(|error| panic!("{error}: {line}"))
    }

    fn say(&mut self, line: &[u8]) {
        let requests = self.requests.as_mut().unwrap();
        requests.write_all(line).unwrap();
        requests.write_all(b"\n").unwrap();
    }

    /// Sends a request without waiting for the answer; returns its id.
    fn send(&mut self, what: &str, mut fields: Json) -> Json {
        self.asked += 1;
        fields["id"] = self.asked.into();
        fields["do"] = what.into();
        self.say(fields.to_string().as_bytes());
        self.asked.into()
    }

    /// Waits for the event that ends the request with this id: an answer or a refusal.
    fn end(&mut self, id: &Json) -> Json {
        let is_it = |event: &Json| event.get("id") == Some(id);
        if let Some(place) = self.ends.iter().position(is_it) {
            return self.ends.remove(place);
        }
        loop {
            let event = self.hear();
            if is_it(&event) {
                return event;
            }
            if event.get("id").is_some() {
                self.ends.push(event);
            }
        }
    }

    /// Waits until a run has started its first node.
    fn until_it_runs(&mut self, id: &Json) {
        loop {
            let event = self.hear();
            assert_ne!(event.get("id"), Some(id), "{event}");
            if event["event"] == "started" {
                assert_eq!(event["run"], *id);
                return;
            }
        }
    }

    fn ask(&mut self, what: &str, fields: Json) -> Json {
        let id = self.send(what, fields);
        let answer = self.end(&id);
        assert_eq!(answer["event"], "answer", "{answer}");
        answer
    }

    /// Sends a request that must be refused, and returns the reason.
    fn refusal(&mut self, what: &str, fields: Json) -> String {
        let id = self.send(what, fields);
        let answer = self.end(&id);
        assert_eq!(answer["event"], "refused", "{answer}");
        answer["why"].as_str().unwrap().to_owned()
    }

    fn put<T: bytemuck::NoUninit>(&self, name: &str, numbers: &[T]) {
        fs::write(self.folder.join(name), bytemuck::cast_slice(numbers)).unwrap();
    }

    fn bytes(&self, column: &Json) -> Vec<u8> {
        fs::read(self.folder.join(column["file"].as_str().unwrap())).unwrap()
    }

    /// Closes stdin and waits until the server ends. Returns true if it ended successfully.
    fn ends(mut self) -> bool {
        drop(self.requests.take());
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(60) {
            if let Some(status) = self.process.try_wait().unwrap() {
                return status.success();
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        false
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn column<'j>(value: &'j Json, name: &str) -> &'j Json {
    let columns = value["columns"].as_array().unwrap_or_else(|| panic!("{value}"));
    let found = columns.iter().find(|column| column["name"] == name);
    found.unwrap_or_else(|| panic!("no {name}: {value}"))
}

/// A graph that subdivides its input.
const FINE: &str = r#"Graph(
    format: 1,
    inputs: { "mesh": Mesh(doc: "What is made fine.") },
    params: { "levels": Integer(default: 1, min: 0, max: 12, doc: "How fine.") },
    nodes: { "fine": Subdivide(mesh: "mesh", scheme: Loop, levels: Param("levels")) },
    outputs: { "fine": "fine" },
)
"#;

/// Returns a request for a run that takes long: it subdivides `FINE` further, a tetrahedron to 16 million faces.
fn long(project: &Project, value: &Json) -> Json {
    let fine = r#""fine": Subdivide(mesh: "mesh", scheme: Loop, levels: Param("levels"))"#;
    let finer = format!(r#"{fine}, "finer": Subdivide(mesh: "fine", scheme: Loop, levels: 4)"#);
    let text = FINE.replace(fine, &finer).replace(r#""fine": "fine""#, r#""fine": "finer""#);
    project.write("long.ron", text);
    json!({ "graph": "long.ron", "set": { "levels": "7" }, "inputs": { "mesh": value },
            "want": [{ "value": "finer", "as": "facts" }] })
}

const CORNERS: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
const FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

/// Returns a tetrahedron in the form in which a host passes it.
fn tetrahedron() -> Json {
    json!({ "type": "Mesh", "columns": [
        { "name": "position", "on": "vertex", "meaning": "position", "width": 3, "type": "f64", "file": "in-1" },
        { "name": "corners", "on": "face", "meaning": "index", "width": 3, "type": "u32", "file": "in-2" },
    ] })
}

/// Starts a host that passes a tetrahedron to the server; returns the host and the value's hash.
fn host_with_input(project: &Project) -> (Host, Json) {
    let mut host = Host::start(project);
    host.put("in-1", &CORNERS);
    host.put("in-2", &FACES);
    let value = host.ask("input", tetrahedron())["value"].clone();
    (host, value)
}

#[test]
#[expect(clippy::print_stdout, reason = "says what is not there to be tested")]
fn a_client_of_sixty_lines_in_python_gets_the_doll() {
    let client = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/serve.py");
    assert!(fs::read_to_string(client).unwrap().lines().count() <= 60);
    let project = Project::doll();
    let mut command = Command::new("python3");
    command.arg(client).args([env!("CARGO_BIN_EXE_maquette"), "doll.ron", "growth=5.0"]);
    command.current_dir(project.folder()).env("MAQUETTE_CACHE", project.folder().join("cache"));
    let output = match command.output() {
        Ok(output) => output,
        Err(why) => return println!("skipped: there is no python3 here ({why})"),
    };
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(said.contains("model.glb is a Mesh of {'vertices': 85926"), "{said}");
}

#[test]
fn arrays_go_in_and_come_out_and_what_has_not_changed_keeps_its_file() {
    let project = Project::new(FINE);
    let (mut host, value) = host_with_input(&project);
    fn run(levels: &str, form: &str, value: &Json) -> Json {
        json!({ "graph": "doll.ron", "set": { "levels": levels }, "inputs": { "mesh": value },
                "want": [{ "value": "fine", "as": form }] })
    }
    let same = host.ask("run", run("0", "parts", &value))["values"]["fine"].clone();
    assert_eq!(host.bytes(column(&same, "position")), bytemuck::cast_slice::<_, u8>(&CORNERS));
    assert_eq!(host.bytes(column(&same, "corners")), bytemuck::cast_slice::<_, u8>(&FACES));
    assert_eq!(same["hash"], value);

    let fine = host.ask("run", run("2", "mesh", &value))["values"]["fine"].clone();
    fn count(name: &str, fine: &Json) -> u64 {
        column(fine, name)["count"].as_u64().unwrap()
    }
    // The counts satisfy Euler's formula V - E + F = 2: 34 vertices, 96 edges and 64 triangles.
    assert_eq!(
        (count("position", &fine), count("edges", &fine), count("corners", &fine)),
        (34, 96, 3 * 64)
    );
    assert_eq!(count("edge of a corner", &fine), 3 * 64);
    let edges = host.bytes(column(&fine, "edges"));
    let edges: Vec<[u32; 2]> = bytemuck::pod_collect_to_vec(&edges);
    let corners: Vec<[u32; 3]> =
        bytemuck::pod_collect_to_vec(&host.bytes(column(&fine, "corners")));
    let sides: Vec<[u32; 3]> =
        bytemuck::pod_collect_to_vec(&host.bytes(column(&fine, "edge of a corner")));
    for (face, sides) in corners.iter().zip(&sides) {
        for k in 0..3 {
            let mut ends = [face[k], face[(k + 1) % 3]];
            ends.sort_unstable();
            assert_eq!(edges[sides[k] as usize], ends);
        }
    }

    // A mesh with other positions, but the same faces.
    let moved = CORNERS.map(|corner| corner.map(|x| 2.0 * x));
    host.put("in-1", &moved);
    let other = host.ask("input", tetrahedron())["value"].clone();
    let mut again = run("2", "mesh", &value);
    again["inputs"]["mesh"] = other;
    let twice = host.ask("run", again)["values"]["fine"].clone();
    for name in ["corners", "edges", "edge of a corner"] {
        assert_eq!(column(&twice, name)["file"], column(&fine, name)["file"], "{name}");
    }
    assert_ne!(column(&twice, "position")["file"], column(&fine, "position")["file"]);
    // Files to which the first answer referred, but the second does not, have been removed.
    assert!(!host.folder.join(column(&same, "position")["file"].as_str().unwrap()).exists());
    assert!(host.folder.join(column(&fine, "position")["file"].as_str().unwrap()).exists());
}

#[test]
fn the_doll_is_drawn_with_its_texture_and_the_numbers_of_the_command_line() {
    let project = Project::doll();
    let mut host = Host::start(&project);
    let want = json!([{ "value": "model.glb", "as": "mesh" }, { "value": "nose-mask.png", "as": "picture" }]);
    let answer = host.ask("run", json!({ "graph": "doll.ron", "want": want }));
    assert_eq!(answer["ok"], true, "{answer}");
    let mesh = &answer["values"]["model.glb"];
    let inspected = project.maquette(&["inspect", "doll.ron", "model", "--json"]);
    assert!(String::from_utf8_lossy(&inspected.stdout).contains(mesh["hash"].as_str().unwrap()));
    let uv = column(mesh, "uv");
    assert_eq!((&uv["on"], &uv["count"]), (&json!("corner"), &column(mesh, "corners")["count"]));
    assert_eq!(&host.bytes(&mesh["texture"])[..8], b"\x89PNG\r\n\x1a\n");
    assert_eq!(answer["values"]["nose-mask.png"]["picture"]["size"], json!([400, 400]));
}

#[test]
fn a_host_that_lies_is_refused_and_nothing_else_happens() {
    let project = Project::new(FINE);
    let (mut host, value) = host_with_input(&project);
    for line in [
        "{",
        "[]",
        "7",
        r#"{"do":"catalog"}"#,
        r#"{"id":null,"do":"catalog"}"#,
        "\u{0}",
        "{\"id\":[1],\"do\":\"catalog\"}",
    ] {
        host.say(line.as_bytes());
        let answer = host.end(&Json::Null);
        assert_eq!(answer["event"], "refused", "{line}: {answer}");
    }
    host.say(b"");
    host.say(b"\xff\xfe");
    assert_eq!(host.end(&Json::Null)["event"], "refused");
    assert!(host.refusal("fly", json!({})).contains("unknown variant `fly`"));
    assert!(host.refusal("load", json!({})).contains("missing field `graph`"));
    assert!(host.refusal("load", json!({ "graph": "doll.ron", "grpah": 1 })).contains("grpah"));
    fn with_lie(path: &[&str], lie: Json) -> Json {
        let mut input = tetrahedron();
        let place = path.iter().fold(&mut input, |json, step| match step.parse::<usize>() {
            Ok(index) => &mut json[index],
            Err(_) => &mut json[*step],
        });
        *place = lie;
        input
    }
    fs::write(host.folder.join("short"), [0; 23]).unwrap();
    host.put("nan", &[f64::NAN; 12]);
    host.put("far", &[9u32; 12]);
    let lies = [
        (with_lie(&["type"], json!("Mash")), "no type of values `Mash`"),
        (with_lie(&["columns", "0", "file"], json!("../../etc/passwd")), "cannot name a file here"),
        (with_lie(&["columns", "0", "file"], json!("/etc/passwd")), "cannot name a file here"),
        (with_lie(&["columns", "0", "file"], json!("lock")), "cannot name a file here"),
        (with_lie(&["columns", "0", "file"], json!("none")), "none: "),
        (with_lie(&["columns", "0", "file"], json!("short")), "23 bytes"),
        (with_lie(&["columns", "0", "file"], json!("nan")), "finite"),
        (with_lie(&["columns", "1", "file"], json!("far")), "vertex 9"),
        (with_lie(&["columns", "0", "width"], json!(0)), "has a width of 0"),
        (with_lie(&["columns", "0", "width"], json!(7)), "position"),
        (
            with_lie(&["columns", "0", "on"], json!("moon")),
            "unknown element kind `moon`, expected one of",
        ),
        (
            with_lie(&["columns", "0", "meaning"], json!("none")),
            "unknown meaning of numbers `none`, expected one of",
        ),
        (with_lie(&["columns"], json!([])), "`position` is missing"),
        (with_lie(&["columns", "0", "type"], json!("f16")), "f16"),
    ];
    for (lie, expected) in lies {
        let why = host.refusal("input", lie.clone());
        assert!(why.contains(expected), "{lie}: {why}");
    }
    fn run(hash: &Json) -> Json {
        json!({ "graph": "doll.ron", "inputs": { "mesh": hash } })
    }
    assert!(host.refusal("run", run(&json!("00"))).contains("there is no value 00"));
    assert!(host.refusal("run", json!({ "graph": "gone.ron" })).contains("errors"));
    assert!(
        host.refusal("why", json!({ "graph": "doll.ron", "node": "nobody" })).contains("nobody")
    );
    assert_eq!(host.ask("cancel", json!({ "run": "nothing" }))["found"], false);
    // After these refusals, the server answers valid requests as before.
    assert_eq!(host.ask("run", run(&value))["ok"], true);
    assert_eq!(host.ask("load", json!({ "graph": "doll.ron" }))["inputs"][0]["type"], "Mesh");
    assert_eq!(fs::read_to_string(project.graph()).unwrap(), FINE);
    assert!(host.ends());
}

#[cfg(unix)]
#[test]
fn no_link_in_the_folder_leads_out_of_it() {
    let project = Project::new(FINE);
    let (mut host, _) = host_with_input(&project);
    fs::remove_file(host.folder.join("in-2")).unwrap();
    std::os::unix::fs::symlink(project.graph(), host.folder.join("in-2")).unwrap();
    assert!(host.refusal("input", tetrahedron()).contains("in-2: it is a link"));
    use std::os::unix::fs::PermissionsExt;
    let mode = fs::metadata(&host.folder).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o700);
}

#[test]
fn of_many_values_of_a_slider_the_last_is_seen_and_none_waits_for_all() {
    let project = Project::new(FINE);
    let (mut host, value) = host_with_input(&project);
    // Send all requests at once, while the first of them runs.
    fn request(k: u32, value: &Json) -> Json {
        let set = json!({ "levels": if k == 99 { "3" } else { "8" } });
        json!({ "id": 1000 + k, "do": "run", "graph": "doll.ron", "set": set, "inputs": { "mesh": value },
                "want": [{ "value": "fine", "as": "facts" }] })
    }
    let requests: Vec<_> = (0..100).map(|k| request(k, &value).to_string()).collect();
    host.say(requests.join("\n").as_bytes());
    let ids: Vec<_> = (0..100).map(|k| json!(1000 + k)).collect();
    let answers: Vec<_> = ids.iter().map(|id| host.end(id)).collect();
    let replaced = answers.iter().filter(|answer| answer["replaced"] == true).count();
    assert!(replaced >= 90, "only {replaced} were replaced");
    let last = answers.last().unwrap();
    assert_eq!(last["values"]["fine"]["facts"]["faces"], 4 << 6, "{last}");
}

#[test]
fn two_objects_of_one_graph_do_not_take_each_others_turn() {
    let project = Project::new(FINE);
    let (mut host, value) = host_with_input(&project);
    let mut requests = Vec::new();
    for (id, slot) in [(1, "a"), (2, "a"), (3, "b"), (4, "b"), (5, "c")] {
        let set = json!({ "levels": if id == 1 { "8" } else { "2" } });
        let run = json!({ "id": 1000 + id, "do": "run", "graph": "doll.ron", "set": set, "slot": slot,
                          "inputs": { "mesh": value }, "want": [{ "value": "fine", "as": "mesh" }] });
        requests.push(run.to_string());
    }
    host.say(requests.join("\n").as_bytes());
    for id in [1002, 1004, 1005] {
        let answer = host.end(&json!(id));
        assert_eq!(column(&answer["values"]["fine"], "edges")["count"], 96, "{answer}");
    }
}

#[test]
fn a_long_run_is_cancelled_while_others_are_answered() {
    let project = Project::new(FINE);
    let (mut host, value) = host_with_input(&project);
    let id = host.send("run", long(&project, &value));
    host.until_it_runs(&id);
    assert!(host.ask("catalog", json!({}))["nodes"].as_array().unwrap().len() >= 40);
    assert_eq!(host.ask("cancel", json!({ "run": id }))["found"], true);
    let end = host.end(&id);
    assert_eq!(end["cancelled"], true, "{end}");
}

#[test]
fn a_host_that_does_not_read_for_a_while_gets_every_answer() {
    let project = Project::new(FINE);
    let (mut host, value) = host_with_input(&project);
    // The answers are larger than the buffer of a pipe.
    let ids: Vec<_> = (0..30).map(|_| host.send("catalog", json!({}))).collect();
    let run = json!({ "graph": "doll.ron", "inputs": { "mesh": value } });
    let last = host.send("run", run);
    std::thread::sleep(Duration::from_millis(300));
    assert!(ids.iter().all(|id| host.end(id)["event"] == "answer"));
    assert_eq!(host.end(&last)["ok"], true);
}

#[test]
fn a_host_that_dies_takes_the_server_and_its_folder_along() {
    let project = Project::new(FINE);
    let (mut host, value) = host_with_input(&project);
    let id = host.send("run", long(&project, &value));
    host.until_it_runs(&id);
    let folder = host.folder.clone();
    assert!(folder.join("in-1").exists());
    assert!(host.ends(), "it goes on");
    assert!(!folder.exists(), "{}", folder.display());
}

#[test]
fn what_a_killed_server_left_the_next_one_removes() {
    let project = Project::new(FINE);
    let place = project.folder().join("shelves");
    fs::create_dir(&place).unwrap();
    let host = Host::start_with(&project, &["--folder", "shelves"]);
    let left = project.folder().join(&host.folder);
    drop(host);
    assert!(left.exists());
    let host = Host::start_with(&project, &["--folder", "shelves"]);
    assert!(!left.exists());
    assert!(host.ends());
    assert_eq!(fs::read_dir(&place).unwrap().count(), 0);
}

#[test]
fn a_graph_with_an_unknown_node_gives_what_does_not_hang_on_it() {
    let project = Project::new(
        r#"Graph(
            format: 1,
            packs: { "hair": "0.3" },
            nodes: { "ball": ReadMesh(path: "ball.obj"), "hair": HairStrands(on: "ball") },
            outputs: { "ball.ply": "ball", "hair.ply": "hair" },
        )"#,
    );
    project.write("ball.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let mut host = Host::start(&project);
    let loaded = host.ask("load", json!({ "graph": project.graph() }));
    assert_eq!((&loaded["ok"], &loaded["nodes"]), (&json!(true), &json!(["ball", "hair"])));
    fn severities(answer: &Json) -> Vec<String> {
        let problems = answer["problems"].as_array().unwrap().iter();
        assert!(problems.clone().all(|it| it["help"].as_str().unwrap().contains("`hair` 0.3")));
        problems.map(|it| it["severity"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
    }
    assert_eq!(severities(&loaded), ["warning"]);
    let want = json!([{ "value": "ball.ply", "as": "facts" }]);
    let ball = host.ask("run", json!({ "graph": project.graph(), "want": want }));
    assert_eq!((&ball["ok"], severities(&ball)), (&json!(true), vec!["warning".to_owned()]));
    let all = host.ask("run", json!({ "graph": project.graph() }));
    assert_eq!((&all["ok"], severities(&all).contains(&"error".to_owned())), (&json!(false), true));
    assert!(all["values"]["ball.ply"].is_object() && all["values"]["hair.ply"].is_null(), "{all}");
}

#[test]
fn edits_are_made_taken_back_and_never_over_what_somebody_else_wrote() {
    let project = Project::new(FINE);
    let mut host = Host::start(&project);
    fn text(project: &Project) -> String {
        fs::read_to_string(project.graph()).unwrap()
    }
    fn edit(edits: Json) -> Json {
        json!({ "graph": "doll.ron", "edits": edits })
    }
    let edits = json!([
        { "add": { "name": "finer", "node": "Subdivide", "fields": [["mesh", "fine"], ["scheme", "Loop"]] } },
        { "rename": { "from": "fine", "to": "first" } },
        { "output": { "name": "finer", "to": "finer" } },
        { "set": { "target": "levels", "value": "2" } },
    ]);
    let done = host.ask("edit", edit(edits));
    assert_eq!(done["before"], FINE);
    assert_eq!(done["text"], text(&project));
    assert!(text(&project).contains(r#""finer": Subdivide(mesh: "first""#), "{}", text(&project));
    let known = text(&project);
    let why = host.refusal("edit", edit(json!([{ "remove": { "name": "first" } }])));
    assert!(why.contains("needs it"), "{why}");
    let why =
        host.refusal("edit", edit(json!([{ "link": { "port": "first.mesh", "to": "finer" } }])));
    assert!(why.contains("each other") || why.contains("cycle"), "{why}");
    assert_eq!(text(&project), known);
    let mut dry = edit(json!([{ "unlink": { "port": "finer.mesh" } }]));
    dry["dry"] = true.into();
    host.refusal("edit", dry);
    let undo = json!({ "graph": "doll.ron", "was": known, "text": FINE });
    host.ask("put", undo.clone());
    assert_eq!(text(&project), FINE);
    // The text has changed since the first undo, so the second undo is refused.
    assert!(host.refusal("put", undo).contains("has been changed meanwhile"));
    assert_eq!(text(&project), FINE);
    assert!(Path::new(&host.folder).exists());
}

#[test]
fn an_undo_takes_back_its_own_step_and_keeps_what_others_changed_before_and_after_it() {
    let project = Project::new(FINE);
    let mut host = Host::start(&project);
    let text = || fs::read_to_string(project.graph()).unwrap();
    let write = |old: &str, new: &str| {
        let (before, after) = (text(), text().replace(old, new));
        assert_ne!(before, after);
        fs::write(project.graph(), &after).unwrap();
        (before, after)
    };
    let rename = json!([{ "rename": { "from": "fine", "to": "first" } }]);
    let own = host.ask("edit", json!({ "graph": "doll.ron", "edits": rename }));
    let theirs = write("Graph(", "// Theirs.\nGraph(");
    // Another program changes the text, and the host does not know of this change yet.
    let unseen = write("format: 1,", "format: 1, doc: \"Also theirs.\",");
    let undo =
        json!({ "graph": "doll.ron", "was": theirs.1, "text": own["before"], "theirs": [theirs] });
    let done = host.ask("put", undo);
    fn has_both(text: &str) -> bool {
        text.starts_with("// Theirs.") && text.contains("Also theirs.")
    }
    assert!(
        has_both(&text()) && text().contains("\"fine\"") && !text().contains("\"first\""),
        "{}",
        text()
    );
    assert_eq!((&done["text"], &done["before"]), (&text().into(), &unseen.1.clone().into()));
    // After the redo, the changes of others are still in the text.
    let redo = json!({ "graph": "doll.ron", "was": text(), "text": own["text"], "theirs": [theirs, unseen] });
    host.ask("put", redo);
    assert_eq!(text(), unseen.1);
}

#[test]
fn an_undo_of_what_somebody_else_has_changed_again_is_refused_and_writes_nothing() {
    let project = Project::new(FINE);
    let mut host = Host::start(&project);
    fn rename(to: &str) -> Json {
        json!({ "graph": "doll.ron", "edits": [{ "rename": { "from": "fine", "to": to } }] })
    }
    let own = host.ask("edit", rename("first"));
    let theirs = own["text"].as_str().unwrap().replace("\"first\"", "\"second\"");
    fs::write(project.graph(), &theirs).unwrap();
    let undo =
        json!({ "graph": "doll.ron", "was": own["text"], "text": own["before"], "theirs": [] });
    let why = host.refusal("put", undo);
    assert!(why.contains("another change also edited") && why.contains("was not changed"), "{why}");
    assert_eq!(fs::read_to_string(project.graph()).unwrap(), theirs);
}
