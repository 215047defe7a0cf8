//! A project in a temporary folder, and a process that watches its graph.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant, SystemTime};

use serde_json::{Value as Json, json};

/// The folder of the example graphs.
pub(crate) const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../graphs");

/// Timeout for events; only a failing test waits this long.
const PATIENCE: Duration = Duration::from_secs(120);

/// A tetrahedron as an OBJ file.
pub(crate) const TETRAHEDRON: &str =
    "v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";

/// A graph that lifts the mesh in `tet.obj`.
pub(crate) const LIFTED: &str = r#"Graph(
    format: 1,
    params: { "lift": Number(default: 5.0, min: 0.0, max: 40.0, doc: "Lift.") },
    nodes: {
        "mesh": ReadMesh(path: "tet.obj"),
        "lifted": Transform(mesh: "mesh", translate: (0, Param("lift"), 0)),
    },
    outputs: { "out.obj": "lifted" },
)
"#;

pub(crate) struct Project {
    folder: PathBuf,
    _temporary: tempfile::TempDir,
    /// The cache folder of the program.
    cache: tempfile::TempDir,
    /// The folder in which the program keeps user data, such as page addresses.
    state: tempfile::TempDir,
}

impl Project {
    /// Makes a project without files.
    pub(crate) fn empty() -> Self {
        let temporary = tempfile::tempdir().unwrap();
        // On macOS, the temporary folder is behind a link, so the canonical path is used.
        let folder = std::fs::canonicalize(temporary.path()).unwrap();
        let cache = tempfile::tempdir().unwrap();
        let state = tempfile::tempdir().unwrap();
        Self { folder, _temporary: temporary, cache, state }
    }

    /// Makes a project with these files.
    pub(crate) fn with_files(files: &[(&str, &str)]) -> Self {
        let project = Self::empty();
        files.iter().for_each(|(name, text)| project.write(name, text));
        project
    }

    /// Makes a project with this graph as `doll.ron`, and no other files.
    pub(crate) fn new(text: &str) -> Self {
        let project = Self::empty();
        project.save(text);
        project
    }

    /// Makes a project with this graph and a tetrahedron, `tet.obj`.
    pub(crate) fn with_tetrahedron(text: &str) -> Self {
        Self::with_files(&[("doll.ron", text), ("maquette.toml", ""), ("tet.obj", TETRAHEDRON)])
    }

    /// Makes a project with the example graph `doll.ron` and the files that it reads.
    pub(crate) fn doll() -> Self {
        let project = Self::with_files(&[("maquette.toml", "")]);
        project.save(&project.doll_text(12.0));
        std::fs::create_dir(project.folder.join("doll")).unwrap();
        for file in ["color.png", "range.pcd", "camera.json"] {
            project.copy_asset(file, &format!("doll/{file}"));
        }
        project
    }

    /// Makes a project whose graph has a node that wants a closed mesh, but gets a mesh with a hole of three edges.
    pub(crate) fn with_a_hole() -> Self {
        let project = Self::doll();
        let open = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\n";
        project.write("open.obj", open);
        let lib = r#"Graph(
    format: 1,
    inputs: { "skin": Mesh(doc: "It.", wants: [Closed]) },
    nodes: { "it": Transform(mesh: "skin") },
    outputs: { "skin": "it" },
)"#;
        project.write("lib.ron", lib);
        project.save(
            r#"Graph(
    format: 1,
    use: { "Lib": "lib.ron" },
    nodes: { "open": ReadMesh(path: "open.obj"), "whole": Lib(skin: "open") },
    outputs: { "whole.ply": "whole" },
)"#,
        );
        project
    }

    pub(crate) fn doll_text(&self, growth: f64) -> String {
        let text = std::fs::read_to_string(Path::new(GRAPHS).join("doll.ron")).unwrap();
        text.replace("default: 12.0", &format!("default: {growth:.1}"))
    }

    pub(crate) fn copy_asset(&self, name: &str, to: &str) {
        std::fs::copy(Path::new(GRAPHS).join("doll").join(name), self.folder.join(to)).unwrap();
    }

    /// Returns the cache folder of the program.
    pub(crate) fn cache(&self) -> &Path {
        self.cache.path()
    }

    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    pub(crate) fn graph(&self) -> PathBuf {
        self.folder.join("doll.ron")
    }

    /// Writes a file and makes its folder.
    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, content).unwrap();
    }

    pub(crate) fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.folder.join(name)).unwrap()
    }

    /// Saves the graph atomically, by renaming a new file.
    pub(crate) fn save(&self, text: &str) {
        let temporary = self.folder.join("doll.ron.new");
        std::fs::write(&temporary, text).unwrap();
        std::fs::rename(temporary, self.graph()).unwrap();
    }

    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        self.program(env!("CARGO_BIN_EXE_maquette"), arguments)
    }

    /// Returns a command of any program, in the project's folder and with the variables of the program `maquette`.
    pub(crate) fn program(&self, program: &str, arguments: &[&str]) -> Command {
        let mut command = Command::new(program);
        command.args(arguments).current_dir(&self.folder).stdin(Stdio::null());
        command.env("MAQUETTE_CACHE", self.cache.path());
        command.env("XDG_STATE_HOME", self.state.path());
        // Remove these variables: no test may open the user's editor or browser, and tests bless goldens, which `CI` prevents.
        for name in ["BROWSER", "CI", "DISPLAY", "WAYLAND_DISPLAY", "MAQUETTE_EDITOR", "VISUAL"] {
            command.env_remove(name);
        }
        command
    }

    /// Returns the folder where the program saves the addresses of pages.
    pub(crate) fn pages(&self) -> PathBuf {
        self.state.path().join("maquette/pages")
    }

    pub(crate) fn maquette(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Starts the program with arguments that make it print events.
    pub(crate) fn spawn(&self, arguments: &[&str]) -> Watch {
        self.spawn_with(arguments, &[])
    }

    /// Starts the program with these arguments and environment variables.
    pub(crate) fn spawn_with(&self, arguments: &[&str], variables: &[(&str, &OsStr)]) -> Watch {
        let mut process = self
            .command(arguments)
            .envs(variables.iter().copied())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let lines = BufReader::new(process.stdout.take().unwrap()).lines();
        let (sender, events) = channel();
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                let event = serde_json::from_str(&line).unwrap_or_else(|_| panic!("{line}"));
                if sender.send(event).is_err() {
                    return;
                }
            }
        });
        Watch { process, events, polled: Json::Null }
    }

    /// Starts a watch without waiting for a result.
    pub(crate) fn start(&self, more: &[&str]) -> Watch {
        self.start_with(more, &[])
    }

    /// Starts a watch with these environment variables.
    pub(crate) fn start_with(&self, more: &[&str], variables: &[(&str, &OsStr)]) -> Watch {
        let arguments = [&["watch", "doll.ron", "--events", "--out", "out"], more].concat();
        self.spawn_with(&arguments, variables)
    }

    /// Starts a watch and waits until its first run has succeeded.
    pub(crate) fn watch(&self, more: &[&str]) -> Watch {
        let mut watch = self.start(more);
        let watching = watch.wait(|event| event["event"] == "watching");
        watch.polled = watching["polled"].clone();
        let run = watch.run();
        assert_eq!((run.number(), &run.done["ok"]), (1, &json!(true)), "{run:?}");
        watch
    }

    /// Returns the contents of all output files by name.
    pub(crate) fn outputs(&self) -> BTreeMap<String, Vec<u8>> {
        read(&self.folder.join("out"))
    }

    pub(crate) fn output_times(&self) -> BTreeMap<String, SystemTime> {
        fn time(name: &String, folder: &Path) -> SystemTime {
            let metadata = std::fs::metadata(folder.join("out").join(name)).unwrap();
            metadata.modified().unwrap()
        }
        self.outputs().into_keys().map(|name| (name.clone(), time(&name, &self.folder))).collect()
    }

    /// Returns the hash of a node's output with these parameter values, computed by a process without a cache.
    pub(crate) fn hash(&self, node: &str, set: &[&str]) -> String {
        let set = set.iter().flat_map(|value| ["--set", value]);
        let asked = ["inspect", "doll.ron", node, "--json", "--no-cache"].into_iter().chain(set);
        let told = self.maquette(&Vec::from_iter(asked));
        let told: Json = serde_json::from_slice(&told.stdout).unwrap();
        told["outputs"][0]["hash"].as_str().unwrap().to_owned()
    }

    /// Waits until the cache stops changing, and returns the contents of all its files.
    pub(crate) fn settled_cache(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut before = read_all(self.cache.path());
        loop {
            std::thread::sleep(Duration::from_millis(700));
            let now = read_all(self.cache.path());
            if now == before {
                return now;
            }
            before = now;
        }
    }

    /// Checks that the outputs equal those of a new run of the current graph.
    pub(crate) fn assert_outputs_are_right(&self) {
        let fresh = self.folder.join("fresh");
        let run = self.maquette(&["run", "doll.ron", "--out", fresh.to_str().unwrap()]);
        assert!(run.status.success(), "{run:?}");
        let (fresh, outputs) = (read(&fresh), self.outputs());
        assert!(fresh.keys().eq(outputs.keys()), "{:?}", outputs.keys());
        for (name, bytes) in &fresh {
            assert!(outputs[name] == *bytes, "{name} is stale");
        }
    }

    /// Checks that every output file is complete, by its recorded length or its end marker.
    pub(crate) fn assert_no_output_is_torn(&self) {
        for (name, bytes) in self.outputs() {
            if name.ends_with(".glb") {
                let length = u32::from_le_bytes(bytes[8..12].try_into().unwrap());
                assert_eq!(bytes.len(), length as usize, "{name} is torn");
            } else if name.ends_with(".png") {
                assert!(bytes.ends_with(b"IEND\xaeB`\x82"), "{name} is torn");
            }
        }
    }

    pub(crate) fn assert_no_temporary_file(&self) {
        let Ok(entries) = std::fs::read_dir(self.folder.join("out")) else { return };
        for entry in entries {
            let name = entry.unwrap().file_name().into_string().unwrap();
            assert!(!name.starts_with('.'), "{name} was left");
        }
    }
}

/// Returns the contents of the files in a folder, without temporary files.
fn read(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let Ok(entries) = std::fs::read_dir(folder) else { return BTreeMap::new() };
    let paths = entries.map(|entry| entry.unwrap().path());
    let files = paths.map(|path| {
        (path.file_name().unwrap().to_str().unwrap().to_owned(), std::fs::read(path).unwrap())
    });
    files.filter(|(name, _)| !name.starts_with('.')).collect()
}

/// Returns the contents of the files in a folder and its subfolders.
fn read_all(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let (mut files, mut folders) = (BTreeMap::new(), vec![folder.to_owned()]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => folders.push(path),
                false => drop(files.insert(path.clone(), std::fs::read(&path).unwrap_or_default())),
            }
        }
    }
    files
}

/// A process that prints events, such as a watch. It is killed when this value is dropped.
pub(crate) struct Watch {
    process: Child,
    events: Receiver<Json>,
    pub(crate) polled: Json,
}

/// The events of one run.
#[derive(Debug, Default)]
pub(crate) struct Run {
    /// The changed files that caused the run.
    pub(crate) changed: Json,
    pub(crate) states: BTreeMap<String, String>,
    pub(crate) written: Vec<Json>,
    pub(crate) problems: Json,
    pub(crate) done: Json,
}

impl Run {
    pub(crate) fn number(&self) -> u64 {
        self.done["run"].as_u64().unwrap()
    }

    /// Returns the state of a node, or an empty string if the run did not report it.
    pub(crate) fn state(&self, node: &str) -> &str {
        self.states.get(node).map_or("", String::as_str)
    }
}

impl Watch {
    fn next(&mut self) -> Json {
        let told = self.events.recv_timeout(PATIENCE);
        told.unwrap_or_else(|why| panic!("nothing is told: {why}, {:?}", self.process.try_wait()))
    }

    /// Returns the events that arrive within this time.
    pub(crate) fn heard_within(&mut self, time: Duration) -> Vec<Json> {
        let end = Instant::now() + time;
        std::iter::from_fn(|| {
            self.events.recv_timeout(end.saturating_duration_since(Instant::now())).ok()
        })
        .collect()
    }

    /// Waits for a wanted event; events before it are dropped.
    pub(crate) fn wait(&mut self, wanted: impl Fn(&Json) -> bool) -> Json {
        loop {
            let event = self.next();
            if wanted(&event) {
                return event;
            }
        }
    }

    /// Waits for an event of this kind and returns all events before it.
    pub(crate) fn events_until(&mut self, event: &str) -> Vec<Json> {
        let mut events = Vec::new();
        loop {
            match self.next() {
                next if next["event"] == event => return events,
                next => events.push(next),
            }
        }
    }

    /// Waits until a run has ended that was not cancelled.
    pub(crate) fn run(&mut self) -> Run {
        loop {
            let run = self.run_or_cancelled();
            if run.done["event"] == "done" {
                return run;
            }
        }
    }

    /// Waits until a run has ended or was cancelled, and returns its events.
    pub(crate) fn run_or_cancelled(&mut self) -> Run {
        let mut run = Run::default();
        loop {
            let event = self.next();
            match event["event"].as_str().unwrap() {
                "run" => run = Run { changed: event["changed"].clone(), ..Run::default() },
                "problems" => run.problems = event["problems"].clone(),
                "written" => run.written.push(event),
                "cancelled" | "done" => {
                    for node in event["nodes"].as_array().into_iter().flatten() {
                        fn text(field: &str, node: &Json) -> String {
                            node[field].as_str().unwrap().to_owned()
                        }
                        run.states.insert(text("name", node), text("state", node));
                    }
                    run.done = event;
                    return run;
                }
                _ => {}
            }
        }
    }

    /// Waits until a run has ended without errors.
    pub(crate) fn run_until_ok(&mut self) -> Run {
        loop {
            let run = self.run();
            if run.done["ok"] == true {
                return run;
            }
        }
    }

    #[cfg(target_os = "linux")]
    pub(crate) fn id(&self) -> u32 {
        self.process.id()
    }

    pub(crate) fn kill(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }

    /// Ends the program by Ctrl-C, or by killing it where Ctrl-C cannot be sent.
    pub(crate) fn end(&mut self) {
        #[cfg(unix)]
        assert_eq!(self.interrupt(), Some(0));
        #[cfg(not(unix))]
        self.kill();
    }

    /// Sends Ctrl-C, waits for the end and returns the exit code.
    #[cfg(unix)]
    pub(crate) fn interrupt(&mut self) -> Option<i32> {
        let id = self.process.id().to_string();
        assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
        self.process.wait().unwrap().code()
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
