//! Programs of one build use each other's cached results.

use std::path::Path;
use std::process::Command;

use maquette::{CacheFolder, Options, Pack, Run, Session, Settings, State};
use maquette_nodes::PACKS;

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../graphs");

#[test]
fn a_host_has_the_results_of_the_command_line() {
    let folder = tempfile::tempdir().unwrap();
    let (cache, out) = (folder.path().join("cache"), folder.path().join("out"));
    let mut command = Command::new(env!("CARGO_BIN_EXE_maquette"));
    command.current_dir(GRAPHS).args(["run", "doll.ron", "--out"]).arg(out);
    let output = command.env("MAQUETTE_CACHE", &cache).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));

    fn count_cached(packs: &[&Pack], cache: &Path) -> usize {
        let settings = Settings { cache: CacheFolder::At(cache.to_owned()), ..Settings::default() };
        let mut session = Session::new(packs, &settings).unwrap();
        let graph = session.load(&Path::new(GRAPHS).join("doll.ron"), &Options::default());
        let done = session.run(&graph.graph.unwrap(), &Run::default());
        done.unwrap_or_else(|problems| panic!("{problems:?}")).trace().count(State::Cached)
    }
    // Without build ids, the executable's hash identifies the code, and it differs between the command and this test.
    let has_ids = Path::new(env!("CARGO_BIN_EXE_maquette"))
        .ancestors()
        .any(|folder| folder.join("Cargo.lock").is_file());
    assert_eq!(count_cached(PACKS, &cache), if has_ids { 15 } else { 0 });
    let other = Pack { name: "other", ..Pack::EMPTY };
    assert_eq!(count_cached(&[PACKS, &[&other]].concat(), &cache), 0);
}
