//! Programs of the same build believe each other's results on disk.

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

    fn cached(packs: &[&Pack], cache: &Path) -> usize {
        let settings = Settings { cache: CacheFolder::At(cache.to_owned()), ..Settings::default() };
        let mut session = Session::new(packs, &settings).unwrap();
        let graph = session.load(&Path::new(GRAPHS).join("doll.ron"), &Options::default());
        let done = session.run(&graph.graph.unwrap(), &Run::default());
        done.unwrap_or_else(|problems| panic!("{problems:?}")).trace().count(State::Cached)
    }
    // Where a build has no id, the host's file counts, which is another one.
    let has_ids = Path::new(env!("CARGO_BIN_EXE_maquette"))
        .ancestors()
        .any(|folder| folder.join("Cargo.lock").is_file());
    assert_eq!(cached(PACKS, &cache), if has_ids { 15 } else { 0 });
    let other = Pack { name: "other", ..Pack::EMPTY };
    assert_eq!(cached(&[PACKS, &[&other]].concat(), &cache), 0);
}
