//! `maquette new`: writes a new graph for a folder of scans.
//!
//! The command contains no names of nodes. Each pack may contain recipes, which are complete graph files. The fields of the first node in a
//! recipe that reads a scan determine which files the recipe needs. Files in the folder are recognized by their contents, not by their
//! names.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use clap::Args;
use maquette_engine::writing::{make_folder, remove_empty, write_new};
use maquette_graph::catalog::Catalog;
use maquette_graph::{Files, Graph, Options};
use maquette_node::pack::Recipe;
use maquette_syntax::paths::{MARKER, folder_of_new, project_root};
use maquette_syntax::{parse, quote_for_shell, unknown_name_message};

use super::{Exit, eprint, print, report};

mod requirements;
mod scans;

use requirements::ScanRequirements;
use scans::Scans;
pub(super) use scans::in_meters;

use crate::DisplayPath;

#[derive(Args)]
pub(crate) struct New {
    /// The folder of the scans, or one scan: range images with their pictures, meshes or points.
    #[arg(required_unless_present = "list")]
    folder: Option<PathBuf>,
    /// The recipe of the graph [default: the first recipe whose files exist].
    #[arg(long, value_name = "NAME")]
    recipe: Option<String>,
    /// The file of the graph [default: a file in the folder, with the name of the folder].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// List the recipes.
    #[arg(long)]
    list: bool,
}

impl New {
    pub(super) fn run(&self, catalog: &Catalog) -> Exit {
        let Some(folder) = self.folder.as_ref().filter(|_| !self.list) else {
            catalog.recipes().iter().for_each(|recipe| {
                print(&format!("{:<10} {}\n", recipe.name, recipe_doc(recipe)));
            });
            return Exit::Done;
        };
        let made = Scans::find(folder, catalog).and_then(|scans| {
            let (recipe, wants) = self.choose_recipe(&scans, catalog)?;
            Ok((scans, recipe, wants))
        });
        let (scans, recipe, wants) = match made {
            Ok(made) => made,
            Err(why) => return Exit::Usage(why),
        };
        let path = self.out.clone().unwrap_or_else(|| scans.folder.join(graph_name(folder)));
        let base = folder_of_new(&path);
        let set = wants.values(&scans.all, &base);
        let options = Options { files: Files::Ignored, ..Options::default() };
        let unread = scans.unread.iter().map(|why| format!("// Not used: {why}\n"));
        let text = String::from_iter(unread.chain([recipe.text.to_owned()]));
        let edited = maquette_edit::set_values(&path, &text, &set, catalog, &options);
        let text = match edited.and_then(|edited| maquette_edit::format_text(&path, &edited.text)) {
            Ok(text) => text,
            Err(diagnostics) => {
                report(&diagnostics);
                return Exit::Failed;
            }
        };
        let file = path.for_display();
        // Create the folder first: relative paths in the graph cannot be resolved before it exists.
        let is_new = !base.exists();
        if let Err(error) = make_folder(&base) {
            return Exit::Usage(format!("cannot write {file}: {error}"));
        }
        let checked = Graph::load_text(&path, text.clone(), catalog, &Options::default());
        report(&checked.diagnostics);
        if checked.graph.is_none() {
            if is_new {
                remove_empty(&base);
            }
            return Exit::Failed;
        }
        match write_new(&path, &text) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                return Exit::Usage(format!(
                    "{file} already exists; choose another file with --out"
                ));
            }
            Err(error) => return Exit::Usage(format!("cannot write {file}: {error}")),
            Ok(()) => {}
        }
        print(&format!("{file}: {}\n", recipe_doc(&recipe)));
        set.iter().for_each(|(target, value)| print(&format!("  {target}: {value}\n")));
        scans.unused_files(&wants.usable_scans(&scans.all)).iter().for_each(|(file, what)| {
            print(&format!("  not used: {file}, {what}\n"));
        });
        scans.unread.iter().for_each(|why| eprint(&format!("warning: {why}\n")));
        if mark_root(&base) {
            let marker = path.with_file_name(MARKER);
            print(&format!("{}: marks the root of the project\n", marker.for_display()));
        }
        print(&format!(
            "run `maquette watch {} --open` to see the result\n",
            quote_for_shell(&file.to_string())
        ));
        Exit::Done
    }

    /// Returns the recipe that `--recipe` names. By default, returns the first recipe whose files all exist.
    fn choose_recipe(
        &self,
        scans: &Scans,
        catalog: &Catalog,
    ) -> Result<(Recipe, ScanRequirements), String> {
        let all = catalog
            .recipes()
            .iter()
            .filter_map(|recipe| Some((*recipe, ScanRequirements::for_recipe(recipe, catalog)?)));
        let mut all = Vec::from_iter(all);
        // Put recipes for several scans first, because other recipes would use only the first scan.
        all.sort_by_key(|(_, wants)| !wants.is_list);
        let Some(name) = &self.recipe else {
            let found = all.into_iter().find(|(_, wants)| wants.is_satisfied(&scans.all));
            return found.ok_or_else(|| scans.no_scan_message());
        };
        let names: Vec<_> = all.iter().map(|(recipe, _)| recipe.name).collect();
        let found = all.iter().find(|(recipe, _)| recipe.name == name).cloned();
        let found = found.ok_or_else(|| {
            unknown_name_message(format!("there is no recipe `{name}`"), name, "there are", &names)
        })?;
        match found.1.is_satisfied(&scans.all) {
            true => Ok(found),
            false => Err(format!(
                "the recipe `{name}` needs {}, but {} has {}",
                found.1.in_words(),
                scans.folder.for_display(),
                scans.kind_in_words()
            )),
        }
    }
}

/// Makes a folder the root of a project, unless it is already inside of a project.
fn mark_root(folder: &Path) -> bool {
    const TEXT: &str =
        "# The root of a project: its graphs may read files anywhere under this folder.\n";
    let is_in_project = project_root(folder).join(MARKER).is_file();
    !is_in_project && write_new(&folder.join(MARKER), TEXT).is_ok()
}

/// Returns the description of a recipe, which its graph contains.
fn recipe_doc(recipe: &Recipe) -> String {
    let (tree, _) = parse(recipe.text);
    let doc = tree.fields().unwrap_or_default().iter().find(|field| field.name.text == "doc");
    doc.and_then(|doc| doc.value.text()).unwrap_or_default().to_owned()
}

/// Returns the file name of the new graph, derived from the name of the folder or file of the scans.
fn graph_name(scans: &Path) -> String {
    let scans = std::fs::canonicalize(scans).unwrap_or_else(|_| scans.to_owned());
    let name = if scans.is_file() { scans.file_stem() } else { scans.file_name() };
    let name = name.unwrap_or_default().to_string_lossy().to_lowercase();
    let plain = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' });
    let name = String::from_iter(plain);
    let name = name.trim_matches('-');
    if name.is_empty() { "scan.ron".to_owned() } else { format!("{name}.ron") }
}
