//! Identifies the running build of the code. Results of other builds are never used, because other code may compute other results.
//!
//! The code of a pack (a plug-in) includes its nodes, value types, file formats and readers, which may come from different crates.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs::File;
use std::io;
#[cfg(target_os = "linux")]
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use maquette_graph::catalog::{Catalog, Code};
use maquette_graph::file_stat::FileStat;
use maquette_value::Hash;

use super::folder::{PROGRAMS, is_fingerprint};
use super::seal::{seal, unseal};
use crate::writing::write_parts;

/// True if this process is the maquette program, and false if another program has loaded maquette as a library.
static IS_PROGRAM: AtomicBool = AtomicBool::new(false);

/// Declares that this process is the maquette program, not another program that has loaded maquette as a library.
pub fn this_is_a_program() {
    IS_PROGRAM.store(true, Ordering::Relaxed);
}

/// The id of the engine's build, which `build.rs` sets. Empty if it is unknown.
const BUILD: &str = env!("MAQUETTE_BUILD");

/// Returns the fingerprint of all code that computes results: the engine and the packs, in their order. The fingerprint contains build ids,
/// so a program and a library of the same build have equal fingerprints and share results. Code without a build id is identified by the
/// hash of the executable or library from which it was loaded.
pub(super) fn fingerprint(folder: &Path, catalog: &Catalog) -> io::Result<String> {
    fingerprint_with(folder, BUILD, catalog.code())
}

/// Returns the fingerprint of the code for an engine with the build id `build`.
fn fingerprint_with(folder: &Path, build: &'static str, packs: &[Code]) -> io::Result<String> {
    let others = build.is_empty().then(own_code).into_iter().collect();
    let engine = Code { pack: "", build, others };
    let mut hashes = BTreeMap::new();
    let mut description = String::new();
    for Code { pack, build, others } in [&engine].into_iter().chain(packs) {
        let _ = writeln!(description, "{pack:?} is of {build:?}");
        // Look up the executable or library only for code without a build id, because not all systems report that file.
        let files = if others.is_empty() { BTreeSet::new() } else { files_of(others)? };
        for file in files {
            let hash = match hashes.get(&file) {
                Some(known) => String::clone(known),
                None => fingerprint_of(folder, &file)?,
            };
            let _ = writeln!(description, "and from {hash}");
            hashes.insert(file, hash);
        }
    }
    Ok(Hash::compute(description.as_bytes()).to_string()[..32].to_owned())
}

/// Returns the hash of an executable or library. The hash is stored in the cache under the file's metadata (stamp), because computing it
/// takes longer than evaluating most graphs.
fn fingerprint_of(folder: &Path, file: &Path) -> io::Result<String> {
    let (memo, is_settled) = memo(folder, file)?;
    if let Some(known) =
        maquette_value::fs::read_no_follow(&memo).ok().and_then(|bytes| read_memo(&memo, bytes))
    {
        return Ok(known);
    }
    let fingerprint = hash_code_file(file)?;
    if is_settled {
        // Ignore an error: if the hash cannot be stored, the next process computes it again.
        let text = fingerprint.as_bytes();
        let _ = write_parts(&memo, &[text, &seal(&memo, text)]);
    }
    Ok(fingerprint)
}

/// Returns the path of the memo: the file in the cache that stores the hash of an executable or library. Also returns true if a later build
/// of the executable is certain to get another memo.
fn memo(folder: &Path, file: &Path) -> io::Result<(PathBuf, bool)> {
    let stamp = FileStat::read(file).ok_or_else(|| io::Error::other("no such program"))?;
    let name = Hash::compute(format!("{} {stamp:?}", file.display()).as_bytes()).to_string();
    Ok((folder.join(PROGRAMS).join(name), stamp.is_settled()))
}

/// Returns true if the memo at `path` is about this engine's own executable or library and stores a wrong hash.
pub(super) fn is_outdated(folder: &Path, path: &Path, remembered: &str) -> bool {
    let Ok(files) = files_of(&[own_code()]) else { return false };
    files.iter().any(|file| {
        let is_own_memo = memo(folder, file).is_ok_and(|(memo, _)| memo == path);
        is_own_memo && hash_code_file(file).is_ok_and(|now| now != remembered)
    })
}

fn hash_code_file(file: &Path) -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(File::open(file)?)?;
    Ok(hasher.finalize().to_hex()[..32].to_owned())
}

/// Returns the address of a function of the engine, by which the engine's executable or library is found.
fn own_code() -> usize {
    hash_code_file as fn(&Path) -> io::Result<String> as usize
}

/// Returns the executables and libraries from which the code at the given addresses was loaded.
#[cfg(target_os = "linux")]
fn files_of(addresses: &[usize]) -> io::Result<BTreeSet<PathBuf>> {
    let maps = std::fs::read_to_string("/proc/self/maps")?;
    let parts: Vec<_> = maps.lines().filter_map(parse_mapping).collect();
    addresses
        .iter()
        .map(|address| {
            let part = parts.iter().find(|(range, _)| range.contains(address));
            part.map(|(_, file)| PathBuf::from(file)).ok_or_else(|| {
                io::Error::other("the file that contains the code of a pack is unknown")
            })
        })
        .collect()
}

/// Parses a line of `/proc/self/maps`, such as `55d0a000-55d0b000 r-xp 00001000 08:01 1234    /usr/bin/maquette`. Returns the range of
/// addresses and the file.
#[cfg(target_os = "linux")]
fn parse_mapping(line: &str) -> Option<(Range<usize>, &str)> {
    let file = &line[line.find('/')?..];
    let (start, rest) = line.split_once('-')?;
    let end = rest.split_once(' ')?.0;
    fn number(text: &str) -> Option<usize> {
        usize::from_str_radix(text, 16).ok()
    }
    Some((number(start)?..number(end)?, file))
}

/// Returns the path of the executable if this process is the maquette program. This system does not report the file of a library.
#[cfg(not(target_os = "linux"))]
fn files_of(_: &[usize]) -> io::Result<BTreeSet<PathBuf>> {
    if !IS_PROGRAM.load(Ordering::Relaxed) {
        return Err(io::Error::other("the file of this library is unknown on this system"));
    }
    std::env::current_exe().map(|program| [program].into())
}

/// Returns the hash that is stored in a memo, or `None` if the memo is damaged.
pub(super) fn read_memo(memo: &Path, bytes: Vec<u8>) -> Option<String> {
    let text = String::from_utf8(unseal(memo, bytes)?).ok()?;
    Some(text).filter(|text| is_fingerprint(text))
}

#[cfg(target_os = "linux")]
#[cfg(test)]
mod tests {
    use super::super::{Disk, folder};
    use super::*;

    #[test]
    fn the_code_of_the_tests_is_found_in_the_test_executable() {
        let files = files_of(&[own_code()]).unwrap();
        assert_eq!(Vec::from_iter(files), [std::env::current_exe().unwrap()]);
        assert!(files_of(&[8]).is_err());
    }

    fn code(pack: &'static str, build: &'static str, others: &[usize]) -> Code {
        Code { pack, build, others: others.to_vec() }
    }

    #[test]
    fn code_with_a_build_id_needs_no_file() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let (a, b) = (code("a", "1", &[]), code("b", "2", &[]));
        let all = [
            fingerprint_with(folder, "0", &[a.clone(), b.clone()]),
            fingerprint_with(folder, "0", &[b.clone(), a.clone()]),
            fingerprint_with(folder, "0", std::slice::from_ref(&a)),
            fingerprint_with(folder, "1", &[a.clone(), b.clone()]),
            fingerprint_with(folder, "0", &[code("a", "4", &[]), b.clone()]),
            fingerprint_with(folder, "0", &[code("c", "1", &[]), b.clone()]),
            fingerprint_with(folder, "0", &[code("a", "2", &[]), code("b", "1", &[])]),
        ];
        let all = all.map(Result::unwrap);
        assert_eq!(BTreeSet::from_iter(&all).len(), all.len(), "{all:?}");
        assert!(all.iter().all(|fingerprint| is_fingerprint(fingerprint)));
        assert_eq!(fingerprint_with(folder, "0", &[a, b]).unwrap(), all[0]);
        assert!(!folder.join(PROGRAMS).exists());
    }

    #[test]
    fn code_without_a_build_id_is_identified_by_its_file() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let library = libc::mallopt as unsafe extern "C" fn(_, _) -> _ as usize;
        let all = [
            fingerprint_with(folder, "0", &[code("a", "", &[])]),
            fingerprint_with(folder, "0", &[code("a", "", &[own_code()])]),
            fingerprint_with(folder, "0", &[code("a", "", &[library])]),
            fingerprint_with(folder, "0", &[code("a", "", &[own_code(), library])]),
            fingerprint_with(folder, "", &[code("a", "", &[library])]),
        ];
        let all = all.map(Result::unwrap);
        assert_eq!(BTreeSet::from_iter(&all).len(), all.len(), "{all:?}");
        // If the file of some code cannot be found, there is no fingerprint, and so no stored result is used.
        assert!(fingerprint_with(folder, "0", &[code("a", "", &[8])]).is_err());
    }

    #[test]
    fn the_doctor_finds_wrong_program_memos() {
        let folder = tempfile::tempdir().unwrap();
        folder::tag(folder.path()).unwrap();
        let file = files_of(&[own_code()]).unwrap().pop_first().unwrap();
        let (memo, _) = memo(folder.path(), &file).unwrap();
        fn remember(text: &str, memo: &Path) {
            write_parts(memo, &[text.as_bytes(), &seal(memo, text.as_bytes())]).unwrap();
        }
        remember(&hash_code_file(&file).unwrap(), &memo);
        fn faults(folder: &tempfile::TempDir) -> Vec<PathBuf> {
            let faults = Disk::doctor(folder.path(), false).unwrap().faults;
            faults.into_iter().map(|fault| fault.path).collect::<Vec<_>>()
        }
        assert_eq!(faults(&folder), [""; 0].map(PathBuf::from));
        let other = memo.with_file_name(Hash::compute(b"other").to_string());
        write_parts(&other, &[&std::fs::read(&memo).unwrap()]).unwrap();
        assert_eq!((faults(&folder), memo.exists()), (vec![other], true));
        remember("0123456789abcdef0123456789abcdef", &memo);
        assert_eq!((faults(&folder), memo.exists()), (vec![memo.clone()], false));
    }

    #[test]
    fn the_code_of_a_library_is_found_in_its_file() {
        let library = files_of(&[libc::mallopt as unsafe extern "C" fn(_, _) -> _ as usize]);
        let library = library.unwrap().pop_first().unwrap();
        assert!(library.to_string_lossy().contains("libc"), "{}", library.display());
    }
}
