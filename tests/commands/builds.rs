//! Programs of one build use each other's cached results.

use std::path::Path;

use maquette::{CacheFolder, Options, Pack, Run, Session, Settings, State};
use maquette_nodes::PACKS;

use crate::output::stderr_of;
use crate::project::{GRAPHS, Project};

#[test]
fn a_host_has_the_results_of_the_command_line() {
    let project = Project::empty();
    let mut command = project.command(&["run", "doll.ron", "--out"]);
    let output = command.arg(project.folder()).current_dir(GRAPHS).output().unwrap();
    assert!(output.status.success(), "{}", stderr_of(&output));

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
    assert_eq!(count_cached(PACKS, project.cache()), if has_ids { 15 } else { 0 });
    let other = Pack { name: "other", ..Pack::EMPTY };
    assert_eq!(count_cached(&[PACKS, &[&other]].concat(), project.cache()), 0);
}
