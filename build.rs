//! Gives the build of a crate an id: a hash of all that its code is made of. Results on disk are believed by it
//! (`src/eval/disk/program.rs`).
//!
//! It counts the crate's sources, the lock file and settings of the workspace, the compiler and what it is told, and the ids of the
//! crates beneath. These come through cargo: each crate that takes part has `build = ".../build.rs"` and its own name as `links`.
//! Features count, except `cli`, which changes no result. The id is empty if something of this cannot be told.

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
    for (name, inside) in [("built", &folder("OUT_DIR")), ("own", &crate_folder)] {
        let Some(workspace) = workspace(inside) else { continue };
        for file in ["Cargo.lock", "Cargo.toml"] {
            add_file(parts, &format!("{name} workspace {file}"), &workspace.join(file));
        }
    }
    match parts.get("built workspace Cargo.lock") {
        Some(Some(lock)) => covers_all(&packages(&String::from_utf8_lossy(lock))),
        _ => false,
    }
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
}

type Packages<'l> = BTreeMap<&'l str, Package<'l>>;

fn packages(lock: &str) -> Packages<'_> {
    let mut packages = Packages::new();
    for text in lock.split("\n[[").filter_map(|text| text.strip_prefix("package]]")) {
        let value = |key| text.lines().find_map(|line| line.strip_prefix(key));
        let Some(name) = value("name = ") else { continue };
        let package = packages.entry(name.trim_matches('"')).or_default();
        package.is_local |= value("source = ").is_none();
        // A line such as ` "png 0.18.0",`; the version is there only if there are several.
        let needs =
            text.lines().filter_map(|line| line.strip_prefix(" \"")?.split([' ', '"']).next());
        package.needs.extend(needs);
    }
    packages
}

/// Whether every library beneath this crate is told by the lock file or by an id of its own: an edit of a local copy that is patched
/// in would go unnoticed.
fn covers_all(packages: &Packages<'_>) -> bool {
    let own = env::var("CARGO_PKG_NAME").unwrap_or_default();
    let has_id = |name: &str| {
        let variable = format!("DEP_{}{HANDED_OVER}", name.to_uppercase().replace('-', "_"));
        env::var(variable).is_ok_and(|id| !id.is_empty())
    };
    // What needs this crate itself is here for the tests alone: cargo allows no other circles.
    let needs_this = |name: &str| beneath(packages, name, |_| false).contains(&own[..]);
    packages.contains_key(&own[..])
        && beneath(packages, &own, has_id).into_iter().all(|name| {
            let is_local = packages.get(name).is_none_or(|package| package.is_local);
            !is_local || has_id(name) || needs_this(name)
        })
}

/// All that a package needs, but not what is needed by those at which the search `ends`.
fn beneath<'l>(
    packages: &Packages<'l>,
    from: &str,
    ends: impl Fn(&str) -> bool,
) -> BTreeSet<&'l str> {
    let needs = |name: &str| packages.get(name).into_iter().flat_map(|package| &package.needs);
    let mut found = BTreeSet::new();
    let mut next = Vec::from_iter(needs(from).copied());
    while let Some(name) = next.pop() {
        if found.insert(name) && !ends(name) {
            next.extend(needs(name));
        }
    }
    found
}

/// Adds the compiler, what it is told, and the ids of the crates beneath. Whether the compiler is known.
fn add_settings(parts: &mut Parts) -> bool {
    const TOLD: [&str; 4] = ["TARGET", "PROFILE", "OPT_LEVEL", "CARGO_ENCODED_RUSTFLAGS"];
    // The folder of a profile has its name, while `PROFILE` knows two alone.
    let out = folder("OUT_DIR");
    let profile = out.ancestors().nth(3).and_then(Path::file_name).unwrap_or_default();
    let profile = profile.to_string_lossy();
    parts.insert("folder of the profile".into(), Some(profile.as_bytes().to_vec()));
    let is_feature = |name: &str| {
        name.starts_with("CARGO_FEATURE_") && !name.ends_with("_CLI") && !name.ends_with("_DEFAULT")
    };
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
