//! Values of a third-party pack are compared, shown as tables and rendered like the values of built-in packs.

use std::path::Path;
use std::process::{Command, Output};

use maquette::value::{Layer, Meaning, Parts};
use maquette::{
    AnyValue, Catalog, Options, Pack, Run, Session, Settings, State, Targets, test_graphs,
    value_type,
};
use maquette_third_party::{PACK, Palette};

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/graphs");

/// Returns a command that runs the program with this pack, which cargo builds beside the tests.
fn program() -> Command {
    let test = std::env::current_exe().unwrap();
    let built = test.ancestors().nth(2).unwrap().join("examples/third-party");
    Command::new(built.with_extension(std::env::consts::EXE_EXTENSION))
}

fn inspect(arguments: &[&str]) -> Output {
    let mut command = program();
    command.args(["inspect", "ExtractPalette.ron", "palette", "--no-cache"]);
    command.args(arguments).current_dir(GRAPHS).output().unwrap()
}

#[test]
fn its_golden_passes_within_its_tolerance() {
    let packs = [maquette_nodes::PACKS, &[&PACK]].concat();
    let run = test_graphs(Path::new(GRAPHS), &Catalog::new(&packs), 1).unwrap();
    assert!(run.failures.is_empty(), "{:?}", run.failures);
    assert_eq!(run.passed, 2);
}

#[test]
fn its_tolerances_are_those_of_colors() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(format!("{GRAPHS}/color.png"), folder.path().join("color.png")).unwrap();
    let graph = folder.path().join("ExtractPalette.ron");
    std::fs::copy(format!("{GRAPHS}/ExtractPalette.ron"), graph).unwrap();
    let test = "Test(graph: \"ExtractPalette.ron\", compare: {\"doll.gpl\": Palette(rms: 1.0)})";
    std::fs::write(folder.path().join("ExtractPalette.test.ron"), test).unwrap();
    let packs = [maquette_nodes::PACKS, &[&PACK]].concat();
    let run = test_graphs(folder.path(), &Catalog::new(&packs), 1).unwrap();
    assert_eq!(run.failures, ["Palette has no tolerance `rms`"]);
}

#[test]
fn its_columns_are_a_table() {
    let output = inspect(&["--table"]);
    let text = String::from_utf8(output.stdout).unwrap();
    let row = text.lines().find(|line| line.trim_start().starts_with("color ")).unwrap();
    let words: Vec<_> = row.split_whitespace().take(4).collect();
    assert_eq!(words, ["color", "entry", "level", "3"], "{text}");
    let output = inspect(&["--table", "--json"]);
    let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let column = &document["outputs"][0]["parts"]["columns"][0];
    assert_eq!((&column["on"], &column["width"]), (&"entry".into(), &3.into()), "{document}");
}

#[test]
fn it_is_seen_as_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("palette.png");
    let output = inspect(&["--out", path.to_str().unwrap()]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let picture = maquette::format::png::read(&std::fs::read(path).unwrap()).unwrap();
    assert_eq!((picture.width() % 16, picture.height()), (0, 16));
}

#[test]
fn it_is_made_of_an_array() {
    let mut parts = Parts::default();
    parts.push("color", maquette::value::ElementKind::Entry, Meaning::Level, 3, vec![1u8, 2, 3]);
    let made = value_type::<Palette>().from_parts(&parts).unwrap();
    let palette = Palette(vec![[1, 2, 3]].into());
    assert_eq!(made.hash(), AnyValue::new(palette).hash());
    assert!(matches!(&made.show()[..], [Layer::Picture(_)]));
}

#[test]
fn a_palette_is_read_again_when_one_that_it_includes_changes() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["ReadPalette.ron", "color.png", "doll.gpl", "grays.gpl"] {
        std::fs::copy(format!("{GRAPHS}/{name}"), folder.path().join(name)).unwrap();
    }
    let packs = [maquette_nodes::PACKS, &[&PACK]].concat();
    let mut session = Session::new(&packs, &Settings::in_memory()).unwrap();
    fn run(
        session: &mut Session,
        folder: &tempfile::TempDir,
    ) -> (State, Vec<[u8; 3]>, Vec<String>) {
        let checked = session.load(&folder.path().join("ReadPalette.ron"), &Options::default());
        let everything = Run { targets: Targets::Everything, ..Run::default() };
        let Ok(done) = session.run(&checked.graph.unwrap(), &everything) else { panic!() };
        let trace = done.trace();
        let node = trace.0.iter().find(|node| node.name == "colors").unwrap();
        let colors = done.get::<Palette>("colors").unwrap().0.to_vec();
        let warnings: Vec<_> = done.diagnostics().iter().map(|it| it.message.clone()).collect();
        (node.state, colors, warnings)
    }
    let first = run(&mut session, &folder);
    assert_eq!((first.0, first.1.len(), first.2.len()), (State::Computed, 5, 0));
    assert_eq!(run(&mut session, &folder).0, State::Cached);
    let grays = folder.path().join("grays.gpl");
    std::fs::write(&grays, "GIMP Palette\n1 2 3\n").unwrap();
    let second = run(&mut session, &folder);
    assert_eq!((second.0, &second.1[0], second.1.len()), (State::Computed, &[1, 2, 3], 3));
    std::fs::remove_file(&grays).unwrap();
    let third = run(&mut session, &folder);
    assert_eq!((third.0, third.1.len()), (State::Computed, 2));
    assert_eq!(third.2, ["`colors`: there is no file `grays.gpl`: its colors are left out"]);
}

#[test]
fn old_names_in_patches_and_tests_are_migrated_too() {
    let folder = tempfile::tempdir().unwrap();
    fn write(name: &str, text: &str, folder: &tempfile::TempDir) {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let graphs = concat!(env!("CARGO_MANIFEST_DIR"), "/graphs/");
    std::fs::copy(format!("{graphs}color.png"), folder.path().join("color.png")).unwrap();
    std::fs::copy(format!("{graphs}Posterize.ron"), folder.path().join("poster.ron")).unwrap();
    let test = "// Fewer colors.\nTest(graph: \"p*.ron\", cases: { \"few\": (set: { \"palette.colors\": 2 }) })\n";
    let patch = "Patch(of: \"poster.ron\", nodes: { \"palette\": (colors: 3) })\n";
    write("poster.test.ron", test, &folder);
    write("patch.ron", patch, &folder);
    fn run(words: &[&str], folder: &tempfile::TempDir) -> (String, bool) {
        let done = program().args(words).current_dir(folder.path()).output().unwrap();
        let told = [done.stdout, done.stderr].concat();
        (String::from_utf8(told).unwrap(), done.status.success())
    }
    let (told, done) = run(&["run", "patch.ron", "--no-cache"], &folder);
    assert!(
        done && told.contains("field `colors` of ExtractPalette is called `count` now"),
        "{told}"
    );
    let (told, done) =
        run(&["run", "poster.ron", "--no-cache", "--set", "palette.colors=2"], &folder);
    assert!(done && told.contains("--set palette.colors=2: field `colors`"), "{told}");
    assert!(!run(&["edit", ".", "migrate", "--check"], &folder).1);
    let (told, done) = run(&["edit", ".", "migrate", "--write"], &folder);
    assert!(done && told.ends_with("2 files migrated\n"), "{told}");
    fn read(name: &str, folder: &tempfile::TempDir) -> String {
        std::fs::read_to_string(folder.path().join(name)).unwrap()
    }
    assert_eq!(read("poster.test.ron", &folder), test.replace("colors\"", "count\""));
    assert_eq!(read("patch.ron", &folder), patch.replace("colors", "count"));
    assert!(run(&["edit", ".", "migrate", "--check"], &folder).1);
}

#[test]
fn an_old_graph_runs_with_the_pack_and_what_does_not_need_it_without() {
    let path = Path::new(GRAPHS).join("old-names.ron");
    let packs = [maquette_nodes::PACKS, &[&PACK]].concat();
    let told = |packs: &[&Pack]| {
        let mut session = Session::new(packs, &Settings::in_memory()).unwrap();
        let checked = session.load(&path, &Options::default()).without_unknown_nodes();
        let told: Vec<_> =
            checked.diagnostics.iter().map(|it| (it.code, it.help.clone())).collect();
        let done = session.run(&checked.graph.unwrap(), &Run::default()).unwrap();
        (told, ["poster.png", "red.png"].map(|name| done.value(name).is_some()))
    };
    let (with, given) = told(&packs);
    assert_eq!(with.iter().map(|(code, _)| *code).collect::<Vec<_>>(), ["G032", "G032"]);
    assert_eq!(given, [true, true]);
    let (without, given) = told(maquette_nodes::PACKS);
    assert_eq!(without.len(), 2, "{without:?}");
    for (code, help) in without {
        assert!(code == "G003" && help.contains("the pack `palette` 0.1"), "{help}");
    }
    assert_eq!(given, [false, true]);
}
