//! Gives the build of a crate an id: a hash of all that its code is made of. Results on disk are believed by it
//! (`src/engine/eval/disk/program.rs`).
//!
//! It counts what the code depends on and nothing else: the crate's sources, the entries of the lock file and of the workspace for the
//! packages beneath, profiles, the compiler and what it is told, and the ids of the crates beneath. These come through cargo: each
//! crate that takes part has `build = ".../build.rs"` and its own name as `links`. What only tests need does not count. The id is empty
//! if something of this cannot be told, as where a local crate beneath has no id.
//!
//! The id is empty, too, where a change could go unnoticed: a build folder outside of the workspace, or a library that is patched in from a
//! folder. A source that is saved while it is compiled may get the id of its old content; the next build corrects this.

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// What the code is made of, by name. A file that cannot be read has no content.
type Parts = BTreeMap<String, Option<Vec<u8>>>;

/// The end of the variables by which cargo hands over the ids of the crates beneath.
const HANDED_OVER: &str = "_MAQUETTE_BUILD";

fn main() {
    let mut parts = Parts::new();
    let is_known = add_files(&mut parts) & add_settings(&mut parts);
    let id = if is_known { hash(&parts) } else { String::new() };
    println!("cargo::rustc-env=MAQUETTE_BUILD={id}");
    println!("cargo::metadata=maquette_build={id}");
}

/// Two hashes of 64 bits.
fn hash(parts: &Parts) -> String {
    let half = |which: u8| {
        let mut hasher = DefaultHasher::new();
        (which, parts).hash(&mut hasher);
        format!("{:016x}", hasher.finish())
    };
    [0, 1].map(half).concat()
}

/// Adds the files. Whether no others matter.
fn add_files(parts: &mut Parts) -> bool {
    let crate_folder = folder("CARGO_MANIFEST_DIR");
    add_file(parts, "own Cargo.toml", &crate_folder.join("Cargo.toml"));
    let sources = Some(crate_folder.join("src")).filter(|sources| sources.is_dir());
    let sources = sources.unwrap_or_else(|| crate_folder.clone());
    // Of the whole folder, cargo notices new files and lost ones, too.
    println!("cargo::rerun-if-changed={}", sources.display());
    add_sources(parts, "", &sources);
    // The workspace that is built, and the one that the crate is from: the build folder may lie in either.
    let mut is_covered = false;
    for (name, inside) in [("built", &folder("OUT_DIR")), ("own", &crate_folder)] {
        let Some(workspace) = workspace(inside) else { continue };
        let [lock, settings] =
            ["Cargo.lock", "Cargo.toml"].map(|file| watched(&workspace.join(file)));
        let packages = packages(&lock);
        let beneath = Beneath::of(&packages, &for_tests_alone(&crate_folder));
        is_covered |= name == "built" && beneath.is_covered;
        let entries = beneath.names.iter().filter_map(|name| packages.get(name));
        let entries = String::from_iter(entries.flat_map(|package| &package.entries).copied());
        let settings = settings_of(&settings, &beneath.names);
        for (what, text) in [("lock", entries), ("settings", settings)] {
            parts.insert(format!("{name} workspace, {what}"), Some(text.into_bytes()));
        }
    }
    is_covered
}

/// The text of a file, of which cargo notices changes; empty if there is none.
fn watched(path: &Path) -> String {
    if path.exists() {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    fs::read_to_string(path).unwrap_or_default()
}

/// The packages that the crate in this folder needs for its tests and for nothing else.
fn for_tests_alone(crate_folder: &Path) -> BTreeSet<String> {
    let manifest = fs::read_to_string(crate_folder.join("Cargo.toml")).unwrap_or_default();
    let (mut always, mut in_tests) = (BTreeSet::new(), BTreeSet::new());
    let mut section = "";
    for line in manifest.lines() {
        if line.starts_with('[') {
            section = line.trim_matches(['[', ']']);
        } else if let Some((name, _)) = line.split_once(['.', ' ', '='])
            && section.ends_with("dependencies")
        {
            let names =
                if section.ends_with("dev-dependencies") { &mut in_tests } else { &mut always };
            names.insert(name.to_owned());
        }
    }
    &in_tests - &always
}

/// What a workspace's `Cargo.toml` says of profiles, of patches, and of this package and these ones.
fn settings_of(manifest: &str, packages: &BTreeSet<&str>) -> String {
    let own = env::var("CARGO_PKG_NAME").unwrap_or_default();
    let (mut settings, mut section) = (String::new(), "");
    for line in manifest.lines() {
        if line.starts_with('[') {
            section = line.trim_matches(['[', ']']);
        }
        let name = line.split(['.', ' ', '=']).next().unwrap_or_default();
        let is_profile = section.starts_with("profile");
        let counts = match section {
            "workspace.dependencies" => packages.contains(name),
            // `"*"` means all packages.
            _ if is_profile && section.ends_with(".package") => {
                packages.contains(name) || name.starts_with('"') || name == own
            }
            _ => is_profile || section.starts_with("patch"),
        };
        if counts {
            settings += line;
            settings.push('\n');
        }
    }
    settings
}

/// The folder that a variable of cargo names.
fn folder(variable: &str) -> PathBuf {
    env::var_os(variable).unwrap_or_else(|| panic!("cargo sets {variable}")).into()
}

/// The nearest folder with a lock file.
fn workspace(inside: &Path) -> Option<&Path> {
    inside.ancestors().find(|folder| folder.join("Cargo.lock").is_file())
}

fn add_file(parts: &mut Parts, name: &str, path: &Path) {
    // Of a file that is not there, cargo would think that it always changes.
    if path.exists() {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    parts.insert(name.to_owned(), fs::read(path).ok());
}

/// Adds what is in a folder of sources, except what cargo builds there.
fn add_sources(parts: &mut Parts, within: &str, path: &Path) {
    for entry in fs::read_dir(path).into_iter().flatten().flatten() {
        let (path, name) = (entry.path(), entry.file_name());
        let name = format!("{within}/{}", name.to_string_lossy());
        if !path.is_dir() {
            parts.insert(name, fs::read(path).ok());
        } else if !folder("OUT_DIR").starts_with(&path) {
            add_sources(parts, &name, &path);
        }
    }
}

/// What a lock file says of the packages of one name.
#[derive(Default)]
struct Package<'l> {
    /// Whether one of them is a folder of this machine, of which the lock file names no version that would change with it.
    is_local: bool,
    needs: BTreeSet<&'l str>,
    /// Its entries as they stand there.
    entries: Vec<&'l str>,
}

type Packages<'l> = BTreeMap<&'l str, Package<'l>>;

fn packages(lock: &str) -> Packages<'_> {
    let mut packages = Packages::new();
    for text in lock.split("\n[[").filter_map(|text| text.strip_prefix("package]]")) {
        let value = |key| text.lines().find_map(|line| line.strip_prefix(key));
        let Some(name) = value("name = ") else { continue };
        let package = packages.entry(name.trim_matches('"')).or_default();
        package.is_local |= value("source = ").is_none();
        package.entries.push(text);
        // A line such as ` "png 0.18.0",`; the version is there only if there are several.
        let needs =
            text.lines().filter_map(|line| line.strip_prefix(" \"")?.split([' ', '"']).next());
        package.needs.extend(needs);
    }
    packages
}

/// The packages beneath this crate, down to those with ids of their own, which tell of the rest.
struct Beneath<'l> {
    names: BTreeSet<&'l str>,
    /// Whether each of them is told by the lock file or by an id: an edit of a local copy that is patched in would go unnoticed.
    is_covered: bool,
}

impl<'l> Beneath<'l> {
    fn of(packages: &Packages<'l>, left_out: &BTreeSet<String>) -> Self {
        let own = env::var("CARGO_PKG_NAME").unwrap_or_default();
        let has_id = |name: &str| {
            let variable = format!("DEP_{}{HANDED_OVER}", name.to_uppercase().replace('-', "_"));
            env::var(variable).is_ok_and(|id| !id.is_empty())
        };
        let needs = |name: &str| packages.get(name).into_iter().flat_map(|package| &package.needs);
        let mut names = BTreeSet::new();
        let mut next = Vec::from_iter(needs(&own).filter(|name| !left_out.contains(**name)));
        while let Some(name) = next.pop() {
            if names.insert(*name) && !has_id(name) {
                next.extend(needs(name));
            }
        }
        let is_told = |name: &&str| {
            has_id(name) || packages.get(*name).is_some_and(|package| !package.is_local)
        };
        let is_covered = packages.contains_key(&own[..]) && names.iter().all(is_told);
        Self { names, is_covered }
    }
}

/// Adds the compiler, what it is told, and the ids of the crates beneath. Whether the compiler is known.
fn add_settings(parts: &mut Parts) -> bool {
    const TOLD: [&str; 4] = ["TARGET", "PROFILE", "OPT_LEVEL", "CARGO_ENCODED_RUSTFLAGS"];
    // The folder of a profile has its name, while `PROFILE` knows two alone.
    let out = folder("OUT_DIR");
    let profile = out.ancestors().nth(3).and_then(Path::file_name).unwrap_or_default();
    let profile = profile.to_string_lossy();
    parts.insert("folder of the profile".into(), Some(profile.as_bytes().to_vec()));
    let is_feature = |name: &str| name.starts_with("CARGO_FEATURE_") && !name.ends_with("_DEFAULT");
    let counts = |name: &str| {
        TOLD.contains(&name)
            || name.starts_with("CARGO_PROFILE_")
            || (name.starts_with("DEP_") && name.ends_with(HANDED_OVER))
            || is_feature(name)
    };
    for (name, value) in env::vars_os() {
        let name = name.to_string_lossy().into_owned();
        if counts(&name) {
            parts.insert(name, Some(value.as_encoded_bytes().to_vec()));
        }
    }
    watch_variables(&profile);
    // Asking takes half of the time of this script, and what is built at once has one compiler: the crates beneath have counted it.
    if parts.keys().any(|name| name.ends_with(HANDED_OVER)) {
        return true;
    }
    let rustc = env::var_os("RUSTC").and_then(|rustc| Command::new(rustc).arg("-vV").output().ok());
    let rustc = rustc.filter(|rustc| rustc.status.success());
    let is_known = rustc.is_some();
    parts.insert("rustc".into(), rustc.map(|rustc| rustc.stdout));
    is_known
}

/// Cargo notices by itself what else it tells the compiler, but of profiles only the level of optimization.
fn watch_variables(profile: &str) {
    const SETTINGS: [&str; 6] =
        ["CODEGEN_UNITS", "DEBUG_ASSERTIONS", "LTO", "OPT_LEVEL", "OVERFLOW_CHECKS", "PANIC"];
    println!("cargo::rerun-if-env-changed=RUSTFLAGS");
    println!("cargo::rerun-if-env-changed=CARGO_ENCODED_RUSTFLAGS");
    let profile = profile.to_uppercase().replace('-', "_");
    for profile in ["BENCH", "DEV", "RELEASE", "TEST", &profile] {
        for setting in SETTINGS {
            println!("cargo::rerun-if-env-changed=CARGO_PROFILE_{profile}_{setting}");
        }
    }
}
