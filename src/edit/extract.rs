//! Nodes of a graph that become a graph of their own, with a use of it in their place.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use maquette_graph::catalog::Catalog;
use maquette_graph::definition::What;
use maquette_graph::meaning::named_node;
use maquette_graph::migrate::kind_of;
use maquette_graph::needs::Needs;
use maquette_graph::options::folder_of;
use maquette_graph::rebase::path_of_use;
use maquette_graph::top::field_of;
use maquette_graph::{
    Options, Refusal, Splice, added, apply, behind, field, newline, parts, put_entry, reindented,
};
use maquette_syntax::error::{Problem, Span, code};
use maquette_syntax::paths::folder_of_new;
use maquette_syntax::{Ends, Tree, nearest_or_all, quoted};

use super::format::{entry_form, formatted};
use super::moved::{Known, Linked, free_name, moved, part_with, refusal};
use super::{Edited, Judge};

mod border;
mod naming;

use border::{Border, Crossing};
use naming::New;

/// Nodes that are to become a graph of their own.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Extraction {
    /// Their names, in any order.
    pub nodes: Vec<String>,
    /// The new graph's file, `lib/nose.ron`, relative to what the graph's own path is relative to. If it is left out, the file stands
    /// beside the graph's and has the name of the new node, with a number behind it if that is taken.
    pub to: Option<PathBuf>,
    /// The type of nodes that the new graph is, `Nose`; made of the file's name if it is left out.
    pub kind: Option<String>,
    /// The name of the node that uses it, `nose`; that of the file if it is left out.
    pub name: Option<String>,
}

/// A graph of which some nodes have become another one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Extracted {
    /// The graph's own text, before and now.
    pub edited: Edited,
    /// The new graph's file, which is not there yet.
    pub path: PathBuf,
    /// What is to stand in it.
    pub text: String,
    /// The type of nodes that the new graph is.
    pub kind: String,
    /// The node that uses it.
    pub name: String,
}

/// The texts of the graph file at `path` and of a new one, to which some of its nodes go. One use of the new graph takes their place.
///
/// What the nodes take from others comes in at inputs, what others take from them goes out at outputs, and parameters that they name
/// are handed on: every value has the key that it had. Comments inside of the nodes, behind them and directly above go along, and
/// types of nodes that nothing else needs. All else keeps every byte, except for links to what has gone. What names the nodes in
/// other files, as a `Patch`, a test or a pin does, is not known here.
///
/// # Errors
/// The graph has problems, or the nodes cannot be taken out, with the reason: one is not there, another one stands between them, a
/// list goes in or out, a name is taken, or the new file is there. Places are those in `text`. Or the new texts have problems.
pub fn extract(
    path: &Path,
    text: &str,
    extraction: &Extraction,
    catalog: &Catalog,
    options: &Options,
) -> Result<Extracted, Vec<Problem>> {
    // What is set stands in no text.
    let options = &Options { set: Vec::new(), ..options.clone() };
    let mut extracted = None;
    let edited = Edited::with_commas_behind(text, |text| {
        let done = extracted_from(&Judge { path, catalog, options }, text, extraction)?;
        Ok(extracted.insert(done).edited.clone())
    })?;
    extracted.map(|extracted| Extracted { edited, ..extracted }).ok_or_else(Vec::new)
}

fn extracted_from(
    judge: &Judge<'_>,
    text: &str,
    extraction: &Extraction,
) -> Result<Extracted, Vec<Problem>> {
    let &Judge { path, catalog, options } = judge;
    let (known, before) = judge.sound(text)?;
    let refused = |refused| judge.refuse(text, refused);
    let set = chosen(&known, &extraction.nodes).map_err(refused)?;
    between(&known, &set).map_err(refused)?;
    let border = Border::of(&known, &set).map_err(refused)?;
    let names = New::of(judge, &known, &set, extraction).map_err(refused)?;
    let work = Work { judge, known: &known, set: &set, border: &border, new: &names };
    let (new, file) = work.done().map_err(refused)?;
    let file = formatted(&names.path, &file)?;
    let file = Ends::of(text).unwrap_or(Ends::Unix).put(file);
    let New { kind, name, path: to, given } = names;
    let inside = options.clone().with_text(folder_of(path).join(given), file.clone());
    if before != (Judge { path, catalog, options: &inside }).computed(&new)? {
        let message = "something would be computed otherwise than before";
        let help = "this is a fault of the program: the graph is left as it is";
        return Err(refused(refusal(code::EXPRESSION, Span::default(), message, help)));
    }
    let edited = Edited { text: new, before: text.to_owned(), changes: Vec::new() };
    Ok(Extracted { edited, path: to, text: file, kind, name })
}

/// The places of nodes by their names.
fn chosen(known: &Known, names: &[String]) -> Result<BTreeSet<usize>, Refusal> {
    if names.is_empty() {
        let help = "name the nodes that are to become a graph";
        return Err(refusal(
            code::UNKNOWN_LINK,
            Span::default(),
            "there is nothing to extract",
            help,
        ));
    }
    let place = |given: &String| {
        let name = given.strip_prefix("nodes.").unwrap_or(given);
        known.position("nodes", name).ok_or_else(|| {
            let nodes = Vec::from_iter(known.names("nodes"));
            let (message, help) = match known.position("inputs", name) {
                Some(_) => (
                    format!("`{name}` is an input, and no node"),
                    "what comes in at inputs comes in at the new graph's, too".to_owned(),
                ),
                None => (
                    format!("the graph has no node `{name}`"),
                    String::from(nearest_or_all(name, "its nodes", &nodes)),
                ),
            };
            refusal(code::UNKNOWN_LINK, Span::default(), message, help)
        })
    };
    names.iter().map(place).collect()
}

/// Refuses a set of nodes if another one needs one of them and is needed by one of them.
fn between(known: &Known, set: &BTreeSet<usize>) -> Result<(), Refusal> {
    let nodes = known.entries("nodes");
    let links = known.links.iter().filter_map(|link| {
        let to = known.position("nodes", named_node(&link.text))?;
        Some((known.owner(link.span)?, to))
    });
    let links = BTreeSet::from_iter(links);
    let needs = Needs::new(nodes.len(), links.iter().copied());
    let back = Needs::new(nodes.len(), links.iter().map(|&(user, source)| (source, user)));
    let (below, above) = (needs.of(set.iter().copied()), back.of(set.iter().copied()));
    let Some(at) = (0..nodes.len()).find(|at| !set.contains(at) && below[*at] && above[*at]) else {
        return Ok(());
    };
    let name = |at: usize| nodes[at].0.text().unwrap_or_default();
    let found = |needs: &Needs| {
        let reached = needs.of([at]);
        set.iter().copied().find(|&it| reached[it]).map_or("", name)
    };
    let (it, source, user) = (name(at), found(&needs), found(&back));
    let message =
        format!("`{it}` stands between the nodes: it needs `{source}`, and `{user}` needs it");
    let help = format!("extract `{it}`, too, or leave one of them where it is");
    Err(refusal(code::CYCLE, nodes[at].0.span, message, help))
}

/// Writes both texts.
struct Work<'a> {
    judge: &'a Judge<'a>,
    known: &'a Known,
    set: &'a BTreeSet<usize>,
    border: &'a Border,
    new: &'a New,
}

impl Work<'_> {
    /// The text of the graph and that of the new one, which has no form yet.
    fn done(&self) -> Result<(String, String), Refusal> {
        let Self { known, set, border, new, .. } = self;
        let text = &known.text;
        let Some(nodes) = known.section("nodes") else { return Ok(Default::default()) };
        let parameters = known.parameters(|span| self.is_inside(span));
        let inner = self.inner();
        let mut splices = Vec::new();
        for output in &border.outputs {
            let link = quoted(&format!("{}.{}", new.name, output.name));
            splices.extend(output.spans.iter().map(|span| (*span, link.clone())));
        }
        let links =
            border.inputs.iter().map(|it| format!("{}: {}", field_of(&it.name), quoted(&it.link)));
        let all = Vec::from_iter(known.names("params"));
        let names = parameters.iter().map(|&at| all[at]);
        let params = names.map(|name| format!("{}: Param({})", field_of(name), quoted(name)));
        let fields = links.chain(params).collect::<Vec<_>>().join(", ");
        let entry = format!("{}: {}({fields})", quoted(&new.name), new.kind);
        let taken = moved(text, nodes, set, &inner, |indent| {
            let columns = indent.chars().count();
            let newline = newline(text, nodes.span.end - 1);
            reindented(&entry_form(&entry, columns), columns, indent, newline)
        });
        splices.extend(taken.splices);
        let mut file = String::from("Graph(\n    format: 1,\n");
        let of = self.judge.path.file_name().unwrap_or_default().to_string_lossy();
        file += &format!("    doc: {},\n", quoted(&format!("A part of {of}.")));
        fn section(name: &str, inside: &str, file: &mut String) {
            *file += &format!("    {name}: {{\n{inside}    }},\n");
        }
        let packs = self.packs();
        if !packs.is_empty() {
            section("packs", &packs, &mut file);
        }
        let (uses, of_uses) = self.uses();
        splices.extend(of_uses);
        if !uses.is_empty() {
            section("use", &uses, &mut file);
        }
        let lines =
            |entries: &[String]| String::from_iter(entries.iter().map(|it| format!("{it},\n")));
        section(
            "inputs",
            &lines(&border.inputs.iter().map(|it| self.input(it)).collect::<Vec<_>>()),
            &mut file,
        );
        if !parameters.is_empty() {
            section("params", &lines(&self.declared(&parameters)), &mut file);
        }
        section("nodes", &taken.text, &mut file);
        section(
            "outputs",
            &lines(
                &border
                    .outputs
                    .iter()
                    .map(|it| format!("{}: {}", quoted(&it.name), quoted(&it.link)))
                    .collect::<Vec<_>>(),
            ),
            &mut file,
        );
        Ok((apply(text, splices), file + ")\n"))
    }

    fn is_inside(&self, span: Span) -> bool {
        self.known.owner(span).is_some_and(|at| self.set.contains(&at))
    }

    /// The edits of the nodes themselves: links to inputs, and paths.
    fn inner(&self) -> Vec<Splice> {
        let Self { known, border, .. } = self;
        let mut splices = self.paths(known.files());
        for input in &border.inputs {
            splices.extend(input.spans.iter().map(|span| (*span, quoted(&input.name))));
        }
        splices
    }

    /// The edits of paths that lie elsewhere from the new file.
    fn paths(&self, places: impl IntoIterator<Item = Span>) -> Vec<Splice> {
        let (from, to) = (folder_of_new(self.judge.path), folder_of_new(&self.new.path));
        self.known.rebased(places, &from, &to)
    }

    /// The packs of the nodes, as far as the graph names them.
    fn packs(&self) -> String {
        let known = self.known;
        let nodes = known.entries("nodes");
        let packs =
            self.set.iter().filter_map(|&at| match &known.draft(nodes[at].0.text()?)?.what {
                What::Node(entry) => Some(entry.pack),
                _ => None,
            });
        let packs = BTreeSet::from_iter(packs);
        let needed = known.entries("packs").iter();
        let needed = needed.filter(|(key, _)| key.text().is_some_and(|key| packs.contains(key)));
        needed.map(|entry| format!("{},\n", known.slice(whole(entry)))).collect()
    }

    /// The types that the nodes need, and the edits that put the new one into the graph: in the place of those that nothing else needs.
    fn uses(&self) -> (String, Vec<Splice>) {
        let Self { known, set, new, .. } = self;
        let text = &known.text;
        let entry = format!("{}: {}", quoted(&new.kind), quoted(&new.given));
        fn kinds(inside: bool, set: &BTreeSet<usize>, known: &Known) -> BTreeSet<String> {
            let nodes = known.entries("nodes").iter().enumerate();
            let nodes = nodes.filter(move |(at, _)| set.contains(at) == inside);
            BTreeSet::from_iter(nodes.filter_map(|(_, (_, call))| Some(kind_of(call)?.text)))
        }
        let (own, others) = (kinds(true, set, *known), kinds(false, set, *known));
        let uses = known.entries("use");
        fn is_needed(by: &BTreeSet<String>, at: usize, uses: &[(Tree, Tree)]) -> bool {
            uses[at].0.text().is_some_and(|name| by.contains(name))
        }
        let needed = BTreeSet::from_iter((0..uses.len()).filter(|&at| is_needed(&own, at, uses)));
        let gone = needed.iter().copied().filter(|&at| !is_needed(&others, at, uses)).collect();
        let paths = needed.iter().filter_map(|&at| path_of_use(&uses[at].1)).map(|it| it.span);
        let paths = self.paths(paths);
        let Some(map) = known.section("use") else {
            return (String::new(), self.first_use(&entry));
        };
        let copies = needed.difference(&gone).map(|&at| parts(map)[at]);
        let copies = copies.map(|part| part_with(text, part, &paths) + ",\n");
        let copies = String::from_iter(copies);
        let taken = moved(text, map, &gone, &paths, |_| entry.clone());
        let splices = match gone.is_empty() {
            true => put_entry(text, map, None, false, |_| entry.clone()),
            false => taken.splices,
        };
        (copies + &taken.text, splices)
    }

    /// The edits that give the graph its first entry of `use`: behind what stands at its head.
    fn first_use(&self, entry: &str) -> Vec<Splice> {
        let (text, tree) = (&self.known.text, self.known.tree());
        fn of_head(name: &str) -> bool {
            matches!(name, "format" | "version" | "doc" | "packs")
        }
        let fields = tree.fields().unwrap_or_default();
        let Some(head) = fields.iter().rposition(|field| of_head(&field.name.text)) else {
            return added(text, tree, "use", &format!("{{ {entry} }}"));
        };
        let places = parts(tree);
        let before = head.checked_sub(1).map(|before| places[before].end);
        behind(text, tree.span, before, places[head], &format!("use: {{ {entry} }}"))
    }

    /// The declaration of an input.
    fn input(&self, input: &Crossing) -> String {
        let known = self.known;
        let draft = &known.definition().drafts[input.target.0];
        let own = match draft.what {
            What::Input => field(&draft.tree, "doc").and_then(|doc| doc.value.text()),
            _ => None,
        };
        let doc = own.map_or_else(|| format!("What `{}` gives.", input.link), str::to_owned);
        let declared = format!("{}(doc: {})", input.kind, quoted(&doc));
        let declared = if draft.is_optional { format!("Optional({declared})") } else { declared };
        format!("{}: {declared}", quoted(&input.name))
    }

    /// The declarations of parameters, as they stand in the graph.
    fn declared(&self, parameters: &BTreeSet<usize>) -> Vec<String> {
        let known = self.known;
        let paths = self.paths(known.files());
        let entries = known.entries("params");
        parameters.iter().map(|&at| part_with(&known.text, whole(&entries[at]), &paths)).collect()
    }
}

/// The place of an entry.
fn whole((key, value): &(Tree, Tree)) -> Span {
    Span { start: key.span.start, end: value.span.end }
}
