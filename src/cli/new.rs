//! `maquette new`: looks at a folder of scans and writes a graph that runs on them.
//!
//! The command knows no node. A recipe of a pack is a whole graph file, and the fields of its first node that reads a scan say which files
//! it needs. The readers determine what the files of the folder contain; names alone do not.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use clap::Args;
use maquette_engine::writing::{make_folder, remove_empty, write_new};
use maquette_graph::catalog::Catalog;
use maquette_graph::{Files, Graph, Options};
use maquette_node::pack::Recipe;
use maquette_syntax::paths::{MARKER, folder_of_new, project_root};
use maquette_syntax::{parse, shell, unknown};

use super::{Exit, eprint, print, report};

mod scans;
mod wants;

use scans::Scans;
pub(super) use scans::in_meters;
use wants::Wants;

use crate::Shown;

#[derive(Args)]
pub(crate) struct New {
    /// The folder of the scans: range images with their pictures, meshes or points. Or one such file.
    #[arg(required_unless_present = "list")]
    folder: Option<PathBuf>,
    /// What the graph does; if left out, the first recipe whose files are there.
    #[arg(long, value_name = "NAME")]
    recipe: Option<String>,
    /// The graph's file; if left out, it lies in the folder and has its name.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print the recipes, and what they are for.
    #[arg(long)]
    list: bool,
}

impl New {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let Some(folder) = self.folder.as_ref().filter(|_| !self.list) else {
            catalog.recipes().iter().for_each(|recipe| {
                print(&format!("{:<10} {}\n", recipe.name, what_for(recipe)));
            });
            return Exit::Done;
        };
        let made = Scans::of(folder, catalog).and_then(|scans| {
            let (recipe, wants) = self.recipe(&scans, catalog)?;
            Ok((scans, recipe, wants))
        });
        let (scans, recipe, wants) = match made {
            Ok(made) => made,
            Err(why) => return Exit::Usage(why),
        };
        let path = self.out.clone().unwrap_or_else(|| scans.folder.join(name_of(folder)));
        let base = folder_of_new(&path);
        let set = wants.values(&scans.all, &base);
        let options = Options { files: Files::Ignored, ..Options::default() };
        let unread = scans.unread.iter().map(|why| format!("// Not used: {why}\n"));
        let text = String::from_iter(unread.chain([recipe.text.to_owned()]));
        let edited = maquette_edit::edited(&path, &text, &set, catalog, &options);
        let text = match edited.and_then(|edited| maquette_edit::formatted(&path, &edited.text)) {
            Ok(text) => text,
            Err(problems) => {
                report(&problems);
                return Exit::Failed;
            }
        };
        let file = path.shown();
        // Its paths lead through its folder.
        let is_new = !base.exists();
        if let Err(error) = make_folder(&base) {
            return Exit::Usage(format!("cannot write {file}: {error}"));
        }
        let checked = Graph::load_text(&path, text.clone(), catalog, &Options::default());
        report(&checked.problems);
        if checked.graph.is_none() {
            if is_new {
                remove_empty(&base);
            }
            return Exit::Failed;
        }
        match write_new(&path, &text) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                return Exit::Usage(format!("{file} is there already: --out names another file"));
            }
            Err(error) => return Exit::Usage(format!("cannot write {file}: {error}")),
            Ok(()) => {}
        }
        print(&format!("{file}: {}\n", what_for(&recipe)));
        set.iter().for_each(|(target, value)| print(&format!("  {target}: {value}\n")));
        scans.unused(&wants.used(&scans.all)).iter().for_each(|(file, what)| {
            print(&format!("  not used: {file}, {what}\n"));
        });
        scans.unread.iter().for_each(|why| eprint(&format!("warning: {why}\n")));
        if mark_root(&base) {
            let marker = path.with_file_name(MARKER);
            print(&format!("{}: marks the root of the project\n", marker.shown()));
        }
        print(&format!("`maquette watch {} --open` shows it\n", shell(&file.to_string())));
        Exit::Done
    }

    /// The recipe that is asked for, or the first one whose files are there.
    fn recipe(&self, scans: &Scans, catalog: &Catalog) -> Result<(Recipe, Wants), String> {
        let all = catalog
            .recipes()
            .iter()
            .filter_map(|recipe| Some((*recipe, Wants::of(recipe, catalog)?)));
        let mut all = Vec::from_iter(all);
        // What is made of several is worth more than what is made of the first.
        all.sort_by_key(|(_, wants)| !wants.many);
        let Some(name) = &self.recipe else {
            let found = all.into_iter().find(|(_, wants)| wants.fit(&scans.all));
            return found.ok_or_else(|| scans.nothing());
        };
        let names: Vec<_> = all.iter().map(|(recipe, _)| recipe.name).collect();
        let found = all.iter().find(|(recipe, _)| recipe.name == name).cloned();
        let found = found.ok_or_else(|| {
            unknown(format!("there is no recipe `{name}`"), name, "there are", &names)
        })?;
        match found.1.fit(&scans.all) {
            true => Ok(found),
            false => Err(format!(
                "the recipe `{name}` wants {}, but {} has {}",
                found.1.in_words(),
                scans.folder.shown(),
                scans.in_words()
            )),
        }
    }
}

/// Marks a folder as the root of a project, unless it is in one.
fn mark_root(folder: &Path) -> bool {
    const TEXT: &str =
        "# The root of a project: its graphs may read files anywhere under this folder.\n";
    let is_in_project = project_root(folder).join(MARKER).is_file();
    !is_in_project && write_new(&folder.join(MARKER), TEXT).is_ok()
}

/// The file's own words of what it is for.
fn what_for(recipe: &Recipe) -> String {
    let (tree, _) = parse(recipe.text);
    let doc = tree.fields().unwrap_or_default().iter().find(|field| field.name.text == "doc");
    doc.and_then(|doc| doc.value.text()).unwrap_or_default().to_owned()
}

/// The name of a graph's file: that of the folder or file of its scans, as names of files are written.
fn name_of(scans: &Path) -> String {
    let scans = std::fs::canonicalize(scans).unwrap_or_else(|_| scans.to_owned());
    let name = if scans.is_file() { scans.file_stem() } else { scans.file_name() };
    let name = name.unwrap_or_default().to_string_lossy().to_lowercase();
    let plain = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' });
    let name = String::from_iter(plain);
    let name = name.trim_matches('-');
    if name.is_empty() { "scan.ron".to_owned() } else { format!("{name}.ron") }
}
