//! Computes an id of the build of a crate: a hash of everything that its code depends on. A program uses the cached results on disk only if
//! they have the ids of its own crates (`src/engine/eval/disk/program.rs`).
//!
//! The id covers the dependencies of the code and nothing else: the crate's sources, its dependencies' entries in the lock file and in the
//! workspace's manifest, profiles, the compiler and its options, and the ids of the crates that it depends on. Cargo passes these ids on,
//! because each of the crates has `build = ".../build.rs"` and its own name as `links`. Dependencies of tests do not count. The id is empty
//! if any part of the hash is unknown, for example if a local dependency has no id.
//!
//! The id is also empty where a change could go unnoticed: if the build folder is outside of the workspace, or a library is patched by a
//! local folder. If a source is saved during compilation, the build may get the id of the old content; the next build corrects this.

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// The contents that are hashed, by name. `None` stands for a file that cannot be read.
type Parts = BTreeMap<String, Option<Vec<u8>>>;

/// The suffix of the environment variables in which cargo passes on the ids of dependencies.
const HANDED_OVER: &str = "_MAQUETTE_BUILD";

fn main() {
    let mut parts = Parts::new();
    let is_known = add_files(&mut parts) & add_settings(&mut parts);
    let id = if is_known { hash(&parts) } else { String::new() };
    println!("cargo::rustc-env=MAQUETTE_BUILD={id}");
    println!("cargo::metadata=maquette_build={id}");
}

/// Returns two 64-bit hashes of the parts as hexadecimal digits.
fn hash(parts: &Parts) -> String {
    let half = |which: u8| {
        let mut hasher = DefaultHasher::new();
        (which, parts).hash(&mut hasher);
        format!("{:016x}", hasher.finish())
    };
    [0, 1].map(half).concat()
}

/// Adds the contents of the crate's files to `parts`. Returns true if the code depends on no other file.
fn add_files(parts: &mut Parts) -> bool {
    let crate_folder = folder("CARGO_MANIFEST_DIR");
    add_file(parts, "own Cargo.toml", &crate_folder.join("Cargo.toml"));
    let sources = Some(crate_folder.join("src")).filter(|sources| sources.is_dir());
    let sources = sources.unwrap_or_else(|| crate_folder.clone());
    // If cargo watches a folder, it also notices new and deleted files in the folder.
    println!("cargo::rerun-if-changed={}", sources.display());
    add_sources(parts, "", &sources);
    // Two workspaces matter: the one that is built, which contains the build folder, and the one that contains the crate.
    let mut is_covered = false;
    for (name, inside) in [("built", &folder("OUT_DIR")), ("own", &crate_folder)] {
        let Some(workspace) = workspace(inside) else { continue };
        let [lock, settings] =
            ["Cargo.lock", "Cargo.toml"].map(|file| read_watched(&workspace.join(file)));
        let packages = packages(&lock);
        let beneath = Dependencies::new(&packages, &for_tests_alone(&crate_folder));
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

/// Returns the text of a file and lets cargo watch it. The text is empty if the file does not exist.
fn read_watched(path: &Path) -> String {
    if path.exists() {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    fs::read_to_string(path).unwrap_or_default()
}

/// Returns the dependencies that only the tests of this crate need.
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

/// Returns the lines of a workspace's `Cargo.toml` about profiles, patches, this package and its dependencies.
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
            // The package name `"*"` stands for all packages.
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

/// Returns the folder that an environment variable of cargo names.
fn folder(variable: &str) -> PathBuf {
    env::var_os(variable).unwrap_or_else(|| panic!("cargo sets {variable}")).into()
}

/// Returns the nearest enclosing folder with a lock file.
fn workspace(inside: &Path) -> Option<&Path> {
    inside.ancestors().find(|folder| folder.join("Cargo.lock").is_file())
}

fn add_file(parts: &mut Parts, name: &str, path: &Path) {
    // Cargo treats a missing watched file as changed in every build.
    if path.exists() {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    parts.insert(name.to_owned(), fs::read(path).ok());
}

/// Adds the files of a source folder, except for the build folder, if the source folder contains it.
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

/// The entries of a lock file for packages with one name.
#[derive(Default)]
struct Package<'l> {
    /// True if one of the packages is a local folder: the lock file does not record its changes.
    is_local: bool,
    needs: BTreeSet<&'l str>,
    /// The unchanged texts of the entries.
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
        // Dependencies have lines such as ` "png 0.18.0",`. The version is left out if the name is unambiguous.
        let needs =
            text.lines().filter_map(|line| line.strip_prefix(" \"")?.split([' ', '"']).next());
        package.needs.extend(needs);
    }
    packages
}

/// The dependencies of this crate. Those of a crate with an id are left out, because the id covers them.
struct Dependencies<'l> {
    names: BTreeSet<&'l str>,
    /// True if the lock file or an id covers each dependency. Otherwise an edit of a local dependency could go unnoticed.
    is_covered: bool,
}

impl<'l> Dependencies<'l> {
    fn new(packages: &Packages<'l>, left_out: &BTreeSet<String>) -> Self {
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

/// Adds the compiler, its options, and the ids of dependencies. Returns true if the compiler is known.
fn add_settings(parts: &mut Parts) -> bool {
    const TOLD: [&str; 4] = ["TARGET", "PROFILE", "OPT_LEVEL", "CARGO_ENCODED_RUSTFLAGS"];
    // The folder is named after the profile, whereas `PROFILE` is only `debug` or `release`.
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
    // Asking the compiler for its version takes half of the time of this script. One build has one compiler, which the ids of dependencies
    // already cover.
    if parts.keys().any(|name| name.ends_with(HANDED_OVER)) {
        return true;
    }
    let rustc = env::var_os("RUSTC").and_then(|rustc| Command::new(rustc).arg("-vV").output().ok());
    let rustc = rustc.filter(|rustc| rustc.status.success());
    let is_known = rustc.is_some();
    parts.insert("rustc".into(), rustc.map(|rustc| rustc.stdout));
    is_known
}

/// Lets cargo run this script again if these variables change. Cargo itself watches other compiler options, but of profiles only the
/// optimization level.
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
