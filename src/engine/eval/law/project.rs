//! A project folder with a graph, a second graph that the first one uses, and files. Random edits imitate the edits of an author.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use super::step::{Edit, Kind};

/// A node of the random graph.
struct Node {
    name: String,
    kind: Kind,
    number: u8,
    /// The nodes to which this node links, as indices. All of them are earlier nodes.
    links: Vec<usize>,
    /// True if the node's links lead to the second output of each linked node, instead of the first.
    uses_other_outputs: bool,
}

/// The project after all edits so far. [`Project::save`] writes it to the folder.
pub(super) struct Project {
    folder: PathBuf,
    nodes: Vec<Node>,
    /// The number that the used graph adds to its input.
    inner_number: u8,
    /// True if the used graph has one more node than usual.
    has_extra_node: bool,
    /// True if the `Switch` nodes choose their second case, false for the first.
    chooses_second: bool,
    /// The number of node names used so far. A name is not used again after its node is removed.
    named: usize,
    /// The number of edits so far.
    changes: u8,
}

/// The files that nodes read. The last file may be missing.
const FILES: [&str; 3] = ["a.txt", "b.txt", "extra"];

impl Project {
    pub(super) fn new(folder: &Path) -> Self {
        let project = Self {
            folder: folder.to_owned(),
            nodes: Vec::new(),
            inner_number: 1,
            has_extra_node: false,
            chooses_second: false,
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

    /// Returns the name of a node. `pick` selects the node, modulo the number of nodes.
    pub(super) fn name(&self, pick: u8) -> &str {
        &self.nodes[usize::from(pick) % self.nodes.len()].name
    }

    /// Applies an edit to the project. An impossible edit changes nothing.
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
                // Ignore an error: the file may be missing.
                let _ = file.and_then(|file| file.set_modified(date));
            }
            Edit::Delete { file } => drop(fs::remove_file(self.file(file))),
            Edit::Settle => std::thread::sleep(maquette_graph::file_stat::FINE_GRAIN * 5 / 4),
            Edit::Inner { number } => self.inner_number = number,
            Edit::Longer => self.has_extra_node = !self.has_extra_node,
            Edit::Switch => self.chooses_second = !self.chooses_second,
            _ if count == 0 => {}
            Edit::Number { node, number } => self.nodes[place(node, count)].number = number,
            Edit::Kind { node, kind } => self.nodes[place(node, count)].kind = kind,
            Edit::Rename { node } => self.nodes[place(node, count)].name = self.new_name(),
            Edit::Link { node, link, to } => {
                let node = place(node, count);
                let links = &mut self.nodes[node].links;
                if node > 0 && !links.is_empty() {
                    let link_text = usize::from(link) % links.len();
                    links[link_text] = usize::from(to) % node;
                }
            }
            Edit::Turn { node } => self.nodes[place(node, count)].links.reverse(),
            Edit::Other { node } => self.nodes[place(node, count)].uses_other_outputs ^= true,
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
        self.nodes.insert(at, Node { name, kind, number, links, uses_other_outputs: false });
    }

    /// Removes a node. Links to the removed node are redirected to the node before it in the graph.
    fn remove(&mut self, at: usize) {
        self.nodes.remove(at);
        for node in &mut self.nodes[at..] {
            if at == 0 {
                node.links.retain(|link| *link > 0);
            }
            node.links.iter_mut().for_each(|link| *link -= usize::from(*link >= at));
        }
    }

    /// Swaps a node with the next node in the graph. Does nothing if the next node depends on the first one.
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

    /// Writes both graph files to the folder.
    fn save(&self) {
        let longer = if self.has_extra_node { r#""c": Split(of: "b"),"# } else { "" };
        let out = if self.has_extra_node { "c.remainder" } else { "b" };
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
            self.inner_number
        );
        fs::write(self.folder.join("inner.ron"), inner).unwrap();
        let mut text = String::from(r#"Graph(format: 1, use: { "Twice": "inner.ron" }, nodes: {"#);
        for node in &self.nodes {
            let _ = write!(text, "\n    {:?}: {},", node.name, self.call(node));
        }
        text += "\n}, outputs: {})\n";
        fs::write(self.path(), text).unwrap();
    }

    /// Returns the text of a node in the graph file. If the node needs links but has none, the text is a plain number instead.
    fn call(&self, node: &Node) -> String {
        let link = |at: usize| {
            let to = &self.nodes[*node.links.get(at % node.links.len().max(1))?];
            let output = match to.kind {
                Kind::Split if to.links.is_empty() => "",
                Kind::Split if node.uses_other_outputs ^ node.number.is_multiple_of(2) => {
                    ".remainder"
                }
                _ => "",
            };
            // If the linked node has a list as its result, link to the first element of the list.
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
                let choose = if self.chooses_second { "b" } else { "a" };
                format!("Switch(cases: {{ \"a\": {a}, \"b\": {b} }}, choose: \"{choose}\")")
            }
            _ => format!("Add(of: [{}], plus: {number})", all.join(", ")),
        }
    }
}

fn content(number: u8) -> [u8; 1] {
    [number % 8]
}
