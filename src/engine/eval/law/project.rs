//! A folder with a graph, the graph that it uses, and files; and how its author changes them.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use super::step::{Edit, Kind};

/// A node of the graph.
struct Node {
    name: String,
    kind: Kind,
    number: u8,
    /// Where its links go: places of nodes before it.
    links: Vec<usize>,
    /// Whether it takes their other outputs.
    other: bool,
}

/// What the author has in mind; [`Project::save`] brings it into the folder.
pub(super) struct Project {
    folder: PathBuf,
    nodes: Vec<Node>,
    /// What the used graph adds.
    inner: u8,
    /// Whether the used graph has one more node.
    longer: bool,
    /// Which case a `Switch` takes.
    second: bool,
    /// How many nodes have been named.
    named: usize,
    /// How often something was changed: what a file holds tells it, so that no two contents are the same by chance.
    changes: u8,
}

/// The files of the folder that nodes read; the last one is optional.
const FILES: [&str; 3] = ["a.txt", "b.txt", "extra"];

impl Project {
    pub(super) fn new(folder: &Path) -> Self {
        let project = Self {
            folder: folder.to_owned(),
            nodes: Vec::new(),
            inner: 1,
            longer: false,
            second: false,
            named: 0,
            changes: 0,
        };
        for file in &FILES[..2] {
            fs::write(folder.join(file), "1").unwrap();
        }
        project.save();
        project
    }

    pub(super) fn path(&self) -> PathBuf {
        self.folder.join("graph.ron")
    }

    pub(super) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// The name of a node.
    pub(super) fn name(&self, pick: u8) -> &str {
        &self.nodes[usize::from(pick) % self.nodes.len()].name
    }

    /// Does what the author does; what is not possible changes nothing.
    pub(super) fn edit(&mut self, edit: &Edit) {
        self.changes = self.changes.wrapping_add(1);
        let count = self.nodes.len();
        fn place(pick: u8, count: usize) -> usize {
            usize::from(pick) % count.max(1)
        }
        match edit.clone() {
            Edit::Add { at, kind, number, links } => {
                self.insert(usize::from(at) % (count + 1), kind, number, &links);
            }
            Edit::File { file, number } => self.write(file, number),
            Edit::Replace { file, number } => {
                let path = self.file(file);
                fs::write(self.folder.join("new"), content(number)).unwrap();
                fs::rename(self.folder.join("new"), path).unwrap();
            }
            Edit::Date { file, seconds } => {
                let date = SystemTime::now() - Duration::from_secs(u64::from(seconds));
                let file = fs::File::options().append(true).open(self.file(file));
                // A file that is not there has no date.
                let _ = file.and_then(|file| file.set_modified(date));
            }
            Edit::Delete { file } => drop(fs::remove_file(self.file(file))),
            Edit::Settle => std::thread::sleep(maquette_graph::stamp::FINE_GRAIN * 5 / 4),
            Edit::Inner { number } => self.inner = number,
            Edit::Longer => self.longer = !self.longer,
            Edit::Switch => self.second = !self.second,
            _ if count == 0 => {}
            Edit::Number { node, number } => self.nodes[place(node, count)].number = number,
            Edit::Kind { node, kind } => self.nodes[place(node, count)].kind = kind,
            Edit::Rename { node } => self.nodes[place(node, count)].name = self.new_name(),
            Edit::Link { node, link, to } => {
                let node = place(node, count);
                let links = &mut self.nodes[node].links;
                if node > 0 && !links.is_empty() {
                    let link = usize::from(link) % links.len();
                    links[link] = usize::from(to) % node;
                }
            }
            Edit::Turn { node } => self.nodes[place(node, count)].links.reverse(),
            Edit::Other { node } => self.nodes[place(node, count)].other ^= true,
            Edit::Swap { node } => self.swap(place(node, count)),
            Edit::Remove { node } => self.remove(place(node, count)),
        }
        self.save();
    }

    fn new_name(&mut self) -> String {
        self.named += 1;
        format!("n{}", self.named)
    }

    fn insert(&mut self, at: usize, kind: Kind, number: u8, links: &[u8]) {
        for link in self.nodes[at..].iter_mut().flat_map(|node| &mut node.links) {
            *link += usize::from(*link >= at);
        }
        let links = links.iter().filter(|_| at > 0).map(|link| usize::from(*link) % at).collect();
        let name = self.new_name();
        self.nodes.insert(at, Node { name, kind, number, links, other: false });
    }

    /// Removes a node; what was linked to it is linked to the one before it.
    fn remove(&mut self, at: usize) {
        self.nodes.remove(at);
        for node in &mut self.nodes[at..] {
            if at == 0 {
                node.links.retain(|link| *link > 0);
            }
            node.links.iter_mut().for_each(|link| *link -= usize::from(*link >= at));
        }
    }

    /// Exchanges a node and the next one, if that does not hang on it.
    fn swap(&mut self, at: usize) {
        if at + 1 < self.nodes.len() && !self.nodes[at + 1].links.contains(&at) {
            self.nodes.swap(at, at + 1);
            for link in self.nodes.iter_mut().flat_map(|node| &mut node.links) {
                *link = match *link {
                    link if link == at => at + 1,
                    link if link == at + 1 => at,
                    link => link,
                };
            }
        }
    }

    fn file(&self, pick: u8) -> PathBuf {
        self.folder.join(FILES[usize::from(pick) % FILES.len()])
    }

    fn write(&self, file: u8, number: u8) {
        fs::write(self.file(file), content(number)).unwrap();
    }

    /// Brings the graphs into the folder.
    fn save(&self) {
        let longer = if self.longer { r#""c": Split(of: "b"),"# } else { "" };
        let out = if self.longer { "c.remainder" } else { "b" };
        let inner = format!(
            r#"Graph(
                format: 1,
                inputs: {{ "of": Amount() }},
                params: {{ "plus": Integer(default: 1) }},
                nodes: {{
                    "a": Add(of: ["of"], plus: Param("plus")),
                    "b": Add(of: ["a"], plus: {}),
                    {longer}
                }},
                outputs: {{ "sum": "{out}" }},
            )"#,
            self.inner
        );
        fs::write(self.folder.join("inner.ron"), inner).unwrap();
        let mut text = String::from(r#"Graph(format: 1, use: { "Twice": "inner.ron" }, nodes: {"#);
        for node in &self.nodes {
            let _ = write!(text, "\n    {:?}: {},", node.name, self.call(node));
        }
        text += "\n}, outputs: {})\n";
        fs::write(self.path(), text).unwrap();
    }

    /// A node as the file has it; one that needs links and has none is a plain number.
    fn call(&self, node: &Node) -> String {
        let link = |at: usize| {
            let to = &self.nodes[*node.links.get(at % node.links.len().max(1))?];
            let output = match to.kind {
                Kind::Split if to.links.is_empty() => "",
                Kind::Split if node.other ^ node.number.is_multiple_of(2) => ".remainder",
                _ => "",
            };
            // Of a list only the first element.
            let element = if to.kind == Kind::Each && !to.links.is_empty() { "/1" } else { "" };
            Some(format!("\"{}{element}{output}\"", to.name))
        };
        let number = node.number % 16;
        let all: Vec<_> = (0..node.links.len()).filter_map(link).collect();
        match (node.kind, link(0), link(1)) {
            (Kind::Read, ..) => format!("Read(path: {:?})", FILES[usize::from(number) % 2]),
            (Kind::Split, Some(of), _) => format!("Split(of: {of})"),
            (Kind::Fragile, Some(of), _) => format!("Fragile(of: {of})"),
            (Kind::Use, Some(of), _) => format!("Twice(of: {of}, plus: {number})"),
            (Kind::Each, Some(of), _) => {
                let over = (0..1 + number % 3).map(|k| format!("(plus: {})", k * 2 + number / 8));
                let over = Vec::from_iter(over).join(", ");
                format!("ForEach(graph: \"Twice\", over: [{over}], links: (of: {of}))")
            }
            (Kind::Switch, Some(a), Some(b)) => {
                let choose = if self.second { "b" } else { "a" };
                format!("Switch(cases: {{ \"a\": {a}, \"b\": {b} }}, choose: \"{choose}\")")
            }
            _ => format!("Add(of: [{}], plus: {number})", all.join(", ")),
        }
    }
}

fn content(number: u8) -> [u8; 1] {
    [number % 8]
}
