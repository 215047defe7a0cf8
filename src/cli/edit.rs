//! `maquette edit`: nodes, links, names and outputs of a graph file.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use maquette_edit::{Edit as GraphEdit, Edited};
use maquette_engine::writing::{Turn, replace};
use maquette_graph::catalog::Catalog;
use maquette_graph::{Files, Graph, Options};
use maquette_syntax::error::{Problem, Source};
use maquette_value::plain;

use super::{Exit, assignment, eprint, print, print_document, report};
use crate::Shown;

/// What the edit does not speak of keeps every byte. An edit that would leave the graph with a mistake is refused, with the reason.
#[derive(Args)]
pub(crate) struct Edit {
    /// The graph file.
    graph: PathBuf,
    #[command(subcommand)]
    what: What,
    /// Print the lines that would change; write nothing.
    #[arg(long, global = true)]
    dry_run: bool,
    /// Let the graph read files of this folder, too.
    #[arg(long = "root", value_name = "DIR", global = true)]
    roots: Vec<PathBuf>,
}

#[derive(Subcommand)]
enum What {
    /// Add a node: edit G add mask Threshold image=scan.color 'select=Near(color: "#c33923")' --after scan
    Add {
        /// Its name.
        name: String,
        /// Its type: a node, a graph that this one uses, ForEach or Switch.
        node: String,
        /// Its fields. A value that is no RON is text.
        #[arg(value_name = "FIELD=VALUE", value_parser = assignment)]
        fields: Vec<(String, String)>,
        /// The node behind which it stands; the last one if left out.
        #[arg(long, value_name = "NODE")]
        after: Option<String>,
    },
    /// Take a node, an input or a parameter away, with the comments in it and behind it.
    Remove {
        /// Its name; nodes.NAME or params.NAME where both have it.
        name: String,
        /// Let what names it go along: links to ports that can do without, entries of lists of links, outputs, expectations.
        #[arg(long)]
        and_links: bool,
    },
    /// Give a node, an input or a parameter another name, here and wherever this file names it.
    Rename {
        /// Its name; nodes.NAME or params.NAME where both have it.
        from: String,
        /// The new one.
        to: String,
    },
    /// Link a port: edit G link label.mask threshold
    Link {
        /// The port; one that takes many gets one more. NODE.PORT.0 is the first of them.
        #[arg(value_name = "NODE.PORT")]
        port: String,
        /// What it is linked to.
        #[arg(value_name = "NODE[.OUTPUT]")]
        to: String,
    },
    /// Take the link at a port away.
    Unlink {
        /// The port; all links of one that takes many. NODE.PORT.0 is the first of them.
        #[arg(value_name = "NODE.PORT")]
        port: String,
    },
    /// Add or change an output: edit G output model.glb skin. Without a link it is taken away.
    Output {
        /// The file, or the port of a graph that others use.
        name: String,
        /// What it gives.
        #[arg(value_name = "NODE[.OUTPUT]")]
        to: Option<String>,
    },
}

impl What {
    fn edit(&self) -> GraphEdit {
        match self {
            Self::Add { name, node, fields, after } => GraphEdit::Add {
                name: name.clone(),
                node: node.clone(),
                fields: fields.clone(),
                after: after.clone(),
            },
            Self::Remove { name, and_links } => {
                GraphEdit::Remove { name: name.clone(), and_links: *and_links }
            }
            Self::Rename { from, to } => GraphEdit::Rename { from: from.clone(), to: to.clone() },
            Self::Link { port, to } => GraphEdit::Link { port: port.clone(), to: to.clone() },
            Self::Unlink { port } => GraphEdit::Unlink { port: port.clone() },
            Self::Output { name, to } => GraphEdit::Output { name: name.clone(), to: to.clone() },
        }
    }
}

impl Edit {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let file = GraphFile {
            graph: &self.graph,
            roots: &self.roots,
            draft: false,
            dry_run: self.dry_run,
        };
        let Some(edited) = file.edit(&[self.what.edit()], catalog) else { return Exit::Failed };
        file.tell(edited, catalog);
        Exit::Done
    }
}

/// A graph file that a command edits.
pub(super) struct GraphFile<'a> {
    pub(super) graph: &'a Path,
    pub(super) roots: &'a [PathBuf],
    /// Whether values are put to the drafts of each `Draft`.
    pub(super) draft: bool,
    /// Whether the edits are only tried, and nothing is written.
    pub(super) dry_run: bool,
}

impl GraphFile<'_> {
    /// The text after some edits; none if they failed, for reasons that have been printed.
    pub(super) fn edit(&self, edits: &[GraphEdit], catalog: &Catalog) -> Option<Edited> {
        self.done(edits, catalog).map_err(EditError::tell).ok()
    }

    /// The text after some edits, which is in the file unless they are only tried. Whoever else edits it at the same time comes before
    /// or after.
    pub(super) fn done(&self, edits: &[GraphEdit], catalog: &Catalog) -> Result<Edited, EditError> {
        if self.dry_run {
            return self.edited(edits, catalog);
        }
        let _turn = self.turn()?;
        let edited = self.edited(edits, catalog)?;
        self.write(&edited)?;
        Ok(edited)
    }

    /// Keeps others from changing the file.
    pub(super) fn turn(&self) -> Result<Turn, EditError> {
        Turn::beside(self.graph).map_err(|error| EditError::Write(self.graph.to_owned(), error))
    }

    /// The text after some edits, which is not yet in the file.
    pub(super) fn edited(
        &self,
        edits: &[GraphEdit],
        catalog: &Catalog,
    ) -> Result<Edited, EditError> {
        let (text, options) = (self.text()?, self.options());
        maquette_edit::edit(self.graph, &text, edits, catalog, &options).map_err(EditError::Refused)
    }

    pub(super) fn text(&self) -> Result<String, EditError> {
        plain::read_text(self.graph).map_err(|error| EditError::Read(self.graph.to_owned(), error))
    }

    pub(super) fn options(&self) -> Options {
        let (roots, draft) = (self.roots.to_vec(), self.draft);
        Options { roots, draft, files: Files::Ignored, ..Options::default() }
    }

    /// Whether the file is what it was when it was read: nobody's changes are to be lost.
    pub(super) fn unchanged(&self, before: &str) -> Result<(), EditError> {
        let is_same = self.text()? == before;
        if is_same { Ok(()) } else { Err(EditError::Changed(self.graph.to_owned())) }
    }

    /// A text with the changes that others made to other versions of it, each given as the text before and after it.
    pub(super) fn merged(
        &self,
        text: String,
        theirs: Vec<[String; 2]>,
        catalog: &Catalog,
    ) -> Result<String, EditError> {
        // A change that continues the previous one is part of it: what was written and taken back is no change.
        let mut changes: Vec<[String; 2]> = Vec::new();
        for [before, after] in theirs {
            match changes.last_mut() {
                Some(last) if last[1] == before => last[1] = after,
                _ => changes.push([before, after]),
            }
        }
        let mut text = text;
        for [before, after] in changes {
            if before == after {
                continue;
            }
            let [base, ours, theirs] =
                [before, text, after].map(|text| Source { name: self.graph.to_owned(), text });
            let merge = maquette_edit::merge(self.graph, [&base, &ours, &theirs], catalog);
            if !merge.conflicts.is_empty() {
                return Err(EditError::Conflict(merge.conflicts));
            }
            if !merge.problems.is_empty() {
                return Err(EditError::Refused(merge.problems));
            }
            text = merge.text;
        }
        Ok(text)
    }

    /// Prints what an edit changes of what the graph says, or of its lines if nothing is written.
    pub(super) fn tell(&self, edited: Edited, catalog: &Catalog) {
        if self.dry_run {
            return print_document(&changed_lines(&edited.before, &edited.text));
        }
        fn source(text: String, graph: &Path) -> Source {
            Source { name: graph.to_owned(), text }
        }
        let found = Graph::differences(
            &source(edited.before, self.graph),
            &source(edited.text, self.graph),
            catalog,
        );
        // Both texts have been read.
        found.unwrap_or_default().iter().for_each(|found| print(&format!("{found}\n")));
    }

    /// Puts an edited text into the file.
    pub(super) fn write(&self, edited: &Edited) -> Result<(), EditError> {
        if edited.text == edited.before {
            return Ok(());
        }
        replace(self.graph, &edited.before, &edited.text)
            .map_err(|error| EditError::Write(self.graph.to_owned(), error))
    }
}

/// Why a graph file was not edited.
#[derive(Debug, thiserror::Error)]
pub(super) enum EditError {
    #[error("cannot read {}: {}", .0.shown(), .1)]
    Read(PathBuf, std::io::Error),
    #[error("cannot write {}: {}", .0.shown(), .1)]
    Write(PathBuf, std::io::Error),
    #[error("{} has been changed meanwhile; load it again", .0.shown())]
    Changed(PathBuf),
    /// Somebody else changed the same places, differently.
    #[error("somebody else changed {}, too; the file is left as it is", in_list(.0))]
    Conflict(Vec<String>),
    /// The edits would leave mistakes.
    #[error("{}", in_words(.0))]
    Refused(Vec<Problem>),
}

impl EditError {
    /// Prints why.
    pub(super) fn tell(self) {
        match self {
            Self::Refused(problems) => report(&problems),
            error => eprint(&format!("error: {error}\n")),
        }
    }
}

/// Places in a text, as a list in words.
fn in_list(places: &[String]) -> String {
    places
        .iter()
        .map(|place| if place.is_empty() { "the same lines".into() } else { format!("`{place}`") })
        .collect::<Vec<_>>()
        .join(", ")
}

fn in_words(problems: &[Problem]) -> String {
    problems.iter().map(|problem| &problem.message[..]).collect::<Vec<_>>().join("; ")
}

/// The lines that only one of two texts has, as `diff` prints them: their numbers, and `-` or `+` before each.
pub(super) fn changed_lines(old: &str, new: &str) -> String {
    let (old, new) = (old.lines().collect::<Vec<_>>(), new.lines().collect::<Vec<_>>());
    let start = old.iter().zip(&new).take_while(|(old, new)| old == new).count();
    let rest = old[start..].iter().rev().zip(new[start..].iter().rev());
    let end = rest.take_while(|(old, new)| old == new).count();
    let (old, new) = (&old[start..old.len() - end], &new[start..new.len() - end]);
    let mut text = String::new();
    for (old_at, old_end, new_at, new_end) in hunks(old, new) {
        fn place(at: usize, end: usize, start: usize) -> String {
            match end - at {
                0 => format!("{},0", start + at),
                1 => format!("{}", start + at + 1),
                count => format!("{},{count}", start + at + 1),
            }
        }
        text += &format!(
            "@@ -{} +{} @@\n",
            place(old_at, old_end, start),
            place(new_at, new_end, start)
        );
        old[old_at..old_end].iter().for_each(|line| text += &format!("-{line}\n"));
        new[new_at..new_end].iter().for_each(|line| text += &format!("+{line}\n"));
    }
    text
}

/// The ranges of two lists that are not in the other one: where each begins and ends in the old list and in the new one.
fn hunks(old: &[&str], new: &[&str]) -> Vec<(usize, usize, usize, usize)> {
    let (mut hunks, mut a, mut b) = (Vec::new(), 0, 0);
    while a < old.len() || b < new.len() {
        if old.get(a) == new.get(b) {
            (a, b) = (a + 1, b + 1);
            continue;
        }
        // The nearest place from which on both go on alike.
        let ends = (old.len(), new.len());
        let most = (old.len() - a) + (new.len() - b);
        let (to_a, to_b) = (1..=most)
            .find_map(|skipped: usize| {
                let mut places = (0..=skipped).map(|k| (a + k, b + skipped - k));
                places.find(|&(a, b)| {
                    (a, b) == ends || old.get(a).is_some_and(|line| new.get(b) == Some(line))
                })
            })
            .unwrap_or(ends);
        hunks.push((a, to_a, b, to_b));
        (a, b) = (to_a, to_b);
    }
    hunks
}
