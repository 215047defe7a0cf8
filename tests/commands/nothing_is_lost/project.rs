//! A project with a graph, inside of a folder that also has other files.

use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

pub(crate) const GRAPH: &str = r#"Graph(
    format: 1,
    nodes: {
        "net": PointNet(points: [
            [(0, 0, 0), (1, 0, 1), (2, 0, 0)],
            [(0, 1, 1), (1, 1, 2), (2, 1, 1)],
            [(0, 2, 0), (1, 2, 1), (2, 2, 0)],
        ]),
        "surface": Nurbs(net: "net"),
        "mesh": Tessellate(surface: "surface", u: 4, v: 4),
    },
    outputs: { "net.json": "net", "mesh.ply": "mesh" },
)
"#;

/// Maximum time of a command, even on a busy machine. A command that takes longer is considered stuck.
const PATIENCE: Duration = Duration::from_secs(60);

pub(crate) struct Project {
    temporary: tempfile::TempDir,
    root: PathBuf,
}

impl Project {
    /// Makes a project: the graph is `ROOT/project/net.ron` beside a marker of the project's root, and the cache is `ROOT/cache`.
    pub(crate) fn new() -> Self {
        let temporary = tempfile::tempdir().unwrap();
        let root = fs::canonicalize(temporary.path()).unwrap();
        let project = Self { temporary, root };
        project.write("maquette.toml", "");
        project.write("net.ron", GRAPH);
        project
    }

    pub(crate) fn root(&self) -> &Path {
        debug_assert!(self.temporary.path().exists());
        &self.root
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        assert!(!name.starts_with('/'), "{name} is not in the project");
        self.root.join("project").join(name)
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        write(&self.path(name), text);
    }

    pub(crate) fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    pub(crate) fn write_outside(&self, name: &str, text: &str) {
        write(&self.root.join(name), text);
    }

    pub(crate) fn read_outside(&self, name: &str) -> String {
        fs::read_to_string(self.root.join(name)).unwrap()
    }

    /// Makes a named pipe to which nobody writes.
    pub(crate) fn pipe(&self, name: &str) {
        assert!(Command::new("mkfifo").arg(self.path(name)).status().unwrap().success());
    }

    /// Returns all files in a folder of the project. Links are not followed.
    pub(crate) fn everything(&self, folder: &str) -> BTreeMap<PathBuf, Vec<u8>> {
        everything(&self.path(folder), &[])
    }

    /// Returns all files outside of the project and its cache.
    pub(crate) fn everything_outside(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        everything(&self.root, &[self.root.join("project"), self.root.join("cache")])
    }

    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_maquette"));
        command.args(arguments).current_dir(self.path("")).env_remove("CI").env("NO_COLOR", "1");
        command.env("MAQUETTE_CACHE", self.root.join("cache"));
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command
    }

    /// Runs the program with a timeout and returns its output.
    pub(crate) fn maquette(&self, arguments: &[&str]) -> Output {
        wait(self.command(arguments))
    }
}

pub(crate) fn wait(mut command: Command) -> Output {
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    fn reader(mut pipe: Box<dyn Read + Send>) -> std::thread::JoinHandle<Vec<u8>> {
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            pipe.read_to_end(&mut bytes).unwrap();
            bytes
        })
    }
    let stdout = reader(Box::new(child.stdout.take().unwrap()));
    let stderr = reader(Box::new(child.stderr.take().unwrap()));
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if PATIENCE < start.elapsed() {
            child.kill().unwrap();
            panic!("{command:?} hangs");
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    Output { status, stdout: stdout.join().unwrap(), stderr: stderr.join().unwrap() }
}

fn write(path: &Path, text: &str) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, text).unwrap();
}

/// Returns the content of each file below a folder, the target of each link, and a placeholder for each pipe, except for the paths in
/// `without`.
pub(crate) fn everything(folder: &Path, without: &[PathBuf]) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap().map(Result::unwrap) {
            let (path, kind) = (entry.path(), entry.file_type().unwrap());
            if without.contains(&path) {
                continue;
            }
            if kind.is_dir() {
                folders.push(path);
                continue;
            }
            let content = if kind.is_symlink() {
                fs::read_link(&path).unwrap().into_os_string().into_encoded_bytes()
            } else if kind.is_file() {
                fs::read(&path).unwrap()
            } else {
                b"pipe".to_vec()
            };
            found.insert(path, content);
        }
    }
    found
}
