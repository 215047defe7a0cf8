//! Which build of the code this is: results of another one are never believed.
//!
//! Values, formats and readers of a pack count as its nodes do, because they need not be from the crate of its nodes.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs::File;
use std::io;
#[cfg(target_os = "linux")]
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use maquette_graph::catalog::{Catalog, Code};
use maquette_graph::stamp::Stamp;
use maquette_value::Hash;
use maquette_value::plain;

use super::folder::{PROGRAMS, is_fingerprint};
use super::seal::{seal, unsealed};
use crate::writing::write_parts;

/// Whether this process is a program of its own, and no host that has loaded a library.
static IS_OWN: AtomicBool = AtomicBool::new(false);

/// Says that this process is a program of its own.
pub fn this_is_a_program() {
    IS_OWN.store(true, Ordering::Relaxed);
}

/// The id of the engine's build: see `build.rs`.
const BUILD: &str = env!("MAQUETTE_BUILD");

/// The fingerprint of all code that makes results, the engine's and that of the packs, in their order: of the ids of their builds, so that
/// programs and libraries of the same build share results, and where there is no id, of the files that it was loaded from.
pub(super) fn fingerprint(folder: &Path, catalog: &Catalog) -> io::Result<String> {
    fingerprint_with(folder, BUILD, catalog.code())
}

/// The same, for an engine of this build.
fn fingerprint_with(folder: &Path, build: &'static str, packs: &[Code]) -> io::Result<String> {
    let others = build.is_empty().then(own_code).into_iter().collect();
    let engine = Code { pack: "", build, others };
    let mut hashes = BTreeMap::new();
    let mut told = String::new();
    for Code { pack, build, others } in [&engine].into_iter().chain(packs) {
        let _ = writeln!(told, "{pack:?} is of {build:?}");
        // Where no file is needed, none must be found: there are systems that do not tell.
        let files = if others.is_empty() { BTreeSet::new() } else { files_of(others)? };
        for file in files {
            let hash = match hashes.get(&file) {
                Some(known) => String::clone(known),
                None => fingerprint_of(folder, &file)?,
            };
            let _ = writeln!(told, "and from {hash}");
            hashes.insert(file, hash);
        }
    }
    Ok(Hash::of(told.as_bytes()).to_string()[..32].to_owned())
}

/// The hash of a file of code, remembered in the cache by what the system says of the file, because hashing it takes longer than most
/// graphs.
fn fingerprint_of(folder: &Path, file: &Path) -> io::Result<String> {
    let (memo, is_settled) = memo(folder, file)?;
    if let Some(known) = plain::read_own(&memo).ok().and_then(|bytes| remembered(&memo, bytes)) {
        return Ok(known);
    }
    let fingerprint = computed(file)?;
    if is_settled {
        // Only time is lost if it cannot be remembered.
        let text = fingerprint.as_bytes();
        let _ = write_parts(&memo, &[text, &seal(&memo, text)]);
    }
    Ok(fingerprint)
}

/// Where a file of code is remembered, and whether a later build would be remembered elsewhere.
fn memo(folder: &Path, file: &Path) -> io::Result<(PathBuf, bool)> {
    let stamp = Stamp::of(file).ok_or_else(|| io::Error::other("no such program"))?;
    let name = Hash::of(format!("{} {stamp:?}", file.display()).as_bytes()).to_string();
    Ok((folder.join(PROGRAMS).join(name), stamp.is_settled()))
}

/// Whether this file remembers another fingerprint of the engine's own code than it has now.
pub(super) fn is_wrong(folder: &Path, path: &Path, remembered: &str) -> bool {
    let Ok(files) = files_of(&[own_code()]) else { return false };
    files.iter().any(|file| {
        let is_its = memo(folder, file).is_ok_and(|(memo, _)| memo == path);
        is_its && computed(file).is_ok_and(|now| now != remembered)
    })
}

fn computed(file: &Path) -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(File::open(file)?)?;
    Ok(hasher.finalize().to_hex()[..32].to_owned())
}

/// Where the engine's own code is.
fn own_code() -> usize {
    computed as fn(&Path) -> io::Result<String> as usize
}

/// The files that the code at these addresses was loaded from.
#[cfg(target_os = "linux")]
fn files_of(addresses: &[usize]) -> io::Result<BTreeSet<PathBuf>> {
    let maps = std::fs::read_to_string("/proc/self/maps")?;
    let parts: Vec<_> = maps.lines().filter_map(mapped).collect();
    addresses
        .iter()
        .map(|address| {
            let part = parts.iter().find(|(range, _)| range.contains(address));
            part.map(|(_, file)| PathBuf::from(file)).ok_or_else(|| {
                io::Error::other("which file the code of a pack is from cannot be told")
            })
        })
        .collect()
}

/// The addresses and the file of a line such as `55d0a000-55d0b000 r-xp 00001000 08:01 1234    /usr/bin/maquette`.
#[cfg(target_os = "linux")]
fn mapped(line: &str) -> Option<(Range<usize>, &str)> {
    let file = &line[line.find('/')?..];
    let (start, rest) = line.split_once('-')?;
    let end = rest.split_once(' ')?.0;
    fn number(text: &str) -> Option<usize> {
        usize::from_str_radix(text, 16).ok()
    }
    Some((number(start)?..number(end)?, file))
}

/// Here only a program of its own is known to be one file: that of a host is not its libraries'.
#[cfg(not(target_os = "linux"))]
fn files_of(_: &[usize]) -> io::Result<BTreeSet<PathBuf>> {
    if !IS_OWN.load(Ordering::Relaxed) {
        return Err(io::Error::other("which library this is cannot be told on this system"));
    }
    std::env::current_exe().map(|program| [program].into())
}

/// The fingerprint in a file that remembers one.
pub(super) fn remembered(memo: &Path, bytes: Vec<u8>) -> Option<String> {
    let text = String::from_utf8(unsealed(memo, bytes)?).ok()?;
    Some(text).filter(|text| is_fingerprint(text))
}

#[cfg(target_os = "linux")]
#[cfg(test)]
mod tests {
    use super::super::{Disk, folder};
    use super::*;

    #[test]
    fn the_code_of_the_tests_is_in_the_file_of_the_tests() {
        let files = files_of(&[own_code()]).unwrap();
        assert_eq!(Vec::from_iter(files), [std::env::current_exe().unwrap()]);
        assert!(files_of(&[8]).is_err());
    }

    fn code(pack: &'static str, build: &'static str, others: &[usize]) -> Code {
        Code { pack, build, others: others.to_vec() }
    }

    #[test]
    fn code_that_is_known_by_its_build_needs_no_file() {
        let folder = tempfile::tempdir().unwrap();
        fn fingerprint(
            engine: &'static str,
            packs: &[Code],
            folder: &tempfile::TempDir,
        ) -> Result<String, io::Error> {
            fingerprint_with(folder.path(), engine, packs)
        }
        let (a, b) = (code("a", "1", &[]), code("b", "2", &[]));
        let all = [
            fingerprint("0", &[a.clone(), b.clone()], &folder),
            fingerprint("0", &[b.clone(), a.clone()], &folder),
            fingerprint("0", std::slice::from_ref(&a), &folder),
            fingerprint("1", &[a.clone(), b.clone()], &folder),
            fingerprint("0", &[code("a", "4", &[]), b.clone()], &folder),
            fingerprint("0", &[code("c", "1", &[]), b.clone()], &folder),
            fingerprint("0", &[code("a", "2", &[]), code("b", "1", &[])], &folder),
        ];
        let all = all.map(Result::unwrap);
        assert_eq!(BTreeSet::from_iter(&all).len(), all.len(), "{all:?}");
        assert!(all.iter().all(|fingerprint| is_fingerprint(fingerprint)));
        assert_eq!(fingerprint("0", &[a, b], &folder).unwrap(), all[0]);
        assert!(!folder.path().join(PROGRAMS).exists());
    }

    #[test]
    fn code_without_a_build_is_known_by_its_file() {
        let folder = tempfile::tempdir().unwrap();
        fn fingerprint(
            engine: &'static str,
            packs: &[Code],
            folder: &tempfile::TempDir,
        ) -> Result<String, io::Error> {
            fingerprint_with(folder.path(), engine, packs)
        }
        let library = libc::mallopt as unsafe extern "C" fn(_, _) -> _ as usize;
        let all = [
            fingerprint("0", &[code("a", "", &[])], &folder),
            fingerprint("0", &[code("a", "", &[own_code()])], &folder),
            fingerprint("0", &[code("a", "", &[library])], &folder),
            fingerprint("0", &[code("a", "", &[own_code(), library])], &folder),
            fingerprint("", &[code("a", "", &[library])], &folder),
        ];
        let all = all.map(Result::unwrap);
        assert_eq!(BTreeSet::from_iter(&all).len(), all.len(), "{all:?}");
        // Where it cannot be told, nothing is believed.
        assert!(fingerprint("0", &[code("a", "", &[8])], &folder).is_err());
    }

    #[test]
    fn the_doctor_finds_what_is_remembered_wrongly_of_a_file_of_code() {
        let folder = tempfile::tempdir().unwrap();
        folder::tag(folder.path()).unwrap();
        let file = files_of(&[own_code()]).unwrap().pop_first().unwrap();
        let (memo, _) = memo(folder.path(), &file).unwrap();
        fn remember(text: &str, memo: &Path) {
            write_parts(memo, &[text.as_bytes(), &seal(memo, text.as_bytes())]).unwrap();
        }
        remember(&computed(&file).unwrap(), &memo);
        fn faults(folder: &tempfile::TempDir) -> Vec<PathBuf> {
            let faults = Disk::doctor(folder.path(), false).unwrap().faults;
            faults.into_iter().map(|fault| fault.path).collect::<Vec<_>>()
        }
        assert_eq!(faults(&folder), [""; 0].map(PathBuf::from));
        let other = memo.with_file_name(Hash::of(b"other").to_string());
        write_parts(&other, &[&std::fs::read(&memo).unwrap()]).unwrap();
        assert_eq!((faults(&folder), memo.exists()), (vec![other], true));
        remember("0123456789abcdef0123456789abcdef", &memo);
        assert_eq!((faults(&folder), memo.exists()), (vec![memo.clone()], false));
    }

    #[test]
    fn code_of_a_library_is_in_the_file_of_the_library() {
        let library = files_of(&[libc::mallopt as unsafe extern "C" fn(_, _) -> _ as usize]);
        let library = library.unwrap().pop_first().unwrap();
        assert!(library.to_string_lossy().contains("libc"), "{}", library.display());
    }
}
