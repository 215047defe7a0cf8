//! The ways in which host programs use a session: unsaved texts, inputs from memory and from files, and diagnostics as data.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use maquette::value::{Image, Mesh, RangeImage};
use maquette::{
    AnyValue, CancelToken, Graph, Options, OutputFolder, Run, RunTrace, Session, Settings, State,
    Targets, code,
};
use maquette_nodes::PACKS;

fn session() -> Session {
    Session::new(PACKS, &Settings { threads: 2, ..Settings::in_memory() }).unwrap()
}

fn graphs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs")
}

fn load(session: &Session, path: &Path, options: &Options) -> Graph {
    let checked = session.load(path, options);
    checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics))
}

/// A graph that uses `lib/feature.ron` to process a scan of the front of a doll.
const USE: &str = r#"Graph(
    format: 1,
    use: { "Feature": "lib/feature.ron" },
    nodes: {
        "scan": ReadCapture(color: "doll/color.png", range: "doll/range.pcd"),
        "nose": Feature(color: "scan.color", range: "scan.range"),
    },
    outputs: { "nose.pcd": "nose.range", "nose.ply": "nose.region" },
)"#;

fn inputs(run: &maquette::RunResult) -> BTreeMap<String, AnyValue> {
    ["color", "range"]
        .map(|name| (name.to_owned(), run.value(&format!("scan.{name}")).unwrap().clone()))
        .into()
}

fn computed_nodes(trace: &RunTrace) -> Vec<String> {
    let computed = trace.0.iter().filter(|node| node.state == State::Computed);
    computed.map(|node| node.name.clone()).collect()
}

#[test]
fn a_graph_that_is_called_gives_what_its_use_gives_from_the_same_cache() {
    let mut session = session();
    let path = graphs().join("unsaved.ron");
    let used = load(&session, &path, &Options::default().with_text(&path, USE));
    let used = session.run(&used, &Run { targets: Targets::Everything, ..Run::default() }).unwrap();
    assert!(used.diagnostics().is_empty(), "{:?}", used.diagnostics());

    let feature = load(&session, &graphs().join("lib/feature.ron"), &Options::default());
    let wants: Vec<_> = feature.inputs().iter().map(|it| (&it.name[..], it.kind.name)).collect();
    assert_eq!(wants, [("color", "Image"), ("range", "RangeImage")]);
    let called = session.run(&feature, &Run { inputs: inputs(&used), ..Run::default() }).unwrap();
    assert!(called.diagnostics().is_empty(), "{:?}", called.diagnostics());
    for output in ["range", "region"] {
        let [a, b] = [used.value(&format!("nose.{output}")), called.value(output)];
        assert_eq!(a.unwrap().hash(), b.unwrap().hash(), "{output}");
    }
    // Only the nodes that represent the inputs have been computed again. All other results were cached.
    assert_eq!(computed_nodes(&called.trace()), ["color", "range"]);
}

#[test]
fn files_become_inputs_and_outputs_become_files() {
    let mut session = session();
    let feature = load(&session, &graphs().join("lib/feature.ron"), &Options::default());
    let doll = graphs().join("doll");
    let files = [("color", "color.png"), ("range", "range.pcd")]
        .map(|(name, file)| (name.to_owned(), doll.join(file)));
    let (inputs, doubts) = session.read_inputs(&feature, &files).unwrap();
    assert!(doubts.is_empty());
    // The values of the inputs must be equal to the outputs of the node `scan`, which reads the same files.
    let path = graphs().join("unsaved.ron");
    let used = load(&session, &path, &Options::default().with_text(&path, USE));
    let wanted = Targets::Named(vec!["scan".into()]);
    let scan = session.run(&used, &Run { targets: wanted, ..Run::default() }).unwrap();
    fn hashes(inputs: &BTreeMap<String, AnyValue>) -> Vec<maquette::Hash> {
        inputs.values().map(AnyValue::hash).collect::<Vec<_>>()
    }
    assert_eq!(hashes(&inputs), hashes(&self::inputs(&scan)));
    let folder = tempfile::tempdir().unwrap();
    let run = session.run(&feature, &Run { inputs, ..Run::default() }).unwrap();
    assert!(run.diagnostics().is_empty(), "{:?}", run.diagnostics());
    let into = OutputFolder::new(Some(folder.path()), Path::new("feature.ron"));
    let (written, problems) = session.write(&run, &[], &into, &CancelToken::default());
    assert!(problems.is_empty());
    let names = written.iter().map(|file| file.path.file_name().unwrap().to_str().unwrap());
    assert_eq!(Vec::from_iter(names), ["range.pcd", "region.ply"]);

    let bad =
        [("colour".to_owned(), doll.join("color.png")), ("range".into(), doll.join("no.pcd"))];
    let problems = session.read_inputs(&feature, &bad).unwrap_err();
    let told = problems.iter().map(|it| (it.code, &it.message[..], &it.help[..]));
    let told = Vec::from_iter(told);
    assert_eq!(
        told[0],
        (code::UNKNOWN_FIELD, "the graph has no input `colour`", "did you mean `color`?")
    );
    assert!(told[1].1.starts_with("input `range`: cannot read "), "{}", told[1].1);
    assert!(problems[1].to_text(false).contains("\"range\": RangeImage("));
}

#[test]
fn a_value_of_a_wrong_type_is_refused_with_its_place_and_one_that_is_missing_fails_alone() {
    let mut session = session();
    let feature = load(&session, &graphs().join("lib/feature.ron"), &Options::default());
    let image = AnyValue::new(Image::new(1, 1, vec![[0xc3, 0x39, 0x23]]).unwrap());
    let wrong = BTreeMap::from([("range".to_owned(), image.clone())]);
    let problems = session.run(&feature, &Run { inputs: wrong, ..Run::default() }).err().unwrap();
    assert_eq!((problems.len(), problems[0].code), (1, code::WRONG_TYPE));
    let told = "input `range` wants a RangeImage, but it is given an Image";
    assert_eq!(problems[0].message, told);
    assert!(feature.source_text()[problems[0].span.start..].starts_with("RangeImage("));

    let some = BTreeMap::from([("color".to_owned(), image)]);
    let run = session.run(&feature, &Run { inputs: some, ..Run::default() }).unwrap();
    let told: Vec<_> = run.diagnostics().into_iter().map(|problem| problem.message).collect();
    let expected = "`range` cannot be computed: it is an input without a value: `maquette run --input range=FILE` gives it one, \
        as does a graph that uses this one";
    assert_eq!(told, [expected]);
    assert!(run.value("mask").is_none() || run.get::<RangeImage>("range").is_err());
}

#[test]
fn texts_that_nobody_saved_stand_in_place_of_files() {
    let mut session = session();
    let folder = tempfile::tempdir().unwrap();
    let [outer, inner] = ["outer.ron", "lib/inner.ron"].map(|name| folder.path().join(name));
    fn text(scale: f64, outer: &Path, inner: &Path) -> Options {
        Options::default()
            .with_text(outer, r#"Graph(format: 1, use: { "Inner": "lib/inner.ron" }, nodes: { "big": Inner() }, outputs: { "big.ply": "big" })"#)
            .with_text(inner, format!(r#"Graph(format: 1, inputs: {{}}, nodes: {{
                "cloud": ReadMesh(path: "a.obj"),
                "big": Transform(mesh: "cloud", scale: ({scale:?}, {scale:?}, {scale:?})),
            }}, outputs: {{ "mesh": "big" }})"#))
    }
    std::fs::create_dir(folder.path().join("lib")).unwrap();
    std::fs::write(folder.path().join("lib/a.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        .unwrap();
    for scale in [2.0, 3.0] {
        let graph = load(&session, &outer, &text(scale, &outer, &inner));
        let run = session.run(&graph, &Run::default()).unwrap();
        let mesh = run.get::<Mesh>("big.ply").unwrap();
        assert_eq!(mesh.positions()[1].x, scale);
        let same = run.get::<Mesh>("big").unwrap();
        // Both calls return references to the same mesh in the memory of the session, not copies of it.
        assert!(std::ptr::eq(mesh.positions().as_ptr(), same.positions().as_ptr()));
        assert!(run.get::<Image>("big").unwrap_err().contains("`big` is a Mesh, not an Image"));
    }
    assert!(!outer.exists() && !inner.exists());
}

#[test]
fn a_stranger_s_format_becomes_an_input_and_can_be_compared() {
    let packs = [PACKS, &[&maquette_third_party::PACK]].concat();
    let session = Session::new(&packs, &Settings::in_memory()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let [path, colors] = ["recolor.ron", "two.gpl"].map(|name| folder.path().join(name));
    std::fs::write(&colors, "GIMP Palette\nName: two\n#\n  0   0   0 black\n255 255 255\n")
        .unwrap();
    let text = r#"Graph(
        format: 1,
        inputs: { "image": Image(doc: "A picture."), "colors": Palette(doc: "Its colors.") },
        nodes: { "few": ApplyPalette(image: "image", palette: "colors") },
        outputs: { "image": "few" },
    )"#;
    let graph = load(&session, &path, &Options::default().with_text(&path, text));
    let (mut inputs, _) =
        session.read_inputs(&graph, &[("colors".into(), colors.clone())]).unwrap();
    let gray = Image::new(2, 1, vec![[90; 3], [200; 3]]).unwrap();
    inputs.insert("image".into(), AnyValue::new(gray));
    let mut session = session;
    let run = session.run(&graph, &Run { inputs, ..Run::default() }).unwrap();
    assert_eq!(run.get::<Image>("image").unwrap().pixels(), [[0; 3], [255; 3]]);

    std::fs::write(&colors, "GIMP Palette\n0 0\n").unwrap();
    let problems = session.read_inputs(&graph, &[("colors".into(), colors)]).unwrap_err();
    assert!(problems[0].message.ends_with("line 2: a color is three numbers from 0 to 255"));
}

#[test]
fn a_large_file_that_is_written_again_and_again_is_what_a_new_session_writes() {
    let path = graphs().join("doll.ron");
    let folder = tempfile::tempdir().unwrap();
    fn write(
        session: &mut Session,
        into: &OutputFolder,
        growth: f64,
        levels: &str,
        path: &Path,
    ) -> Vec<maquette::OutputFile> {
        let set = [("growth", format!("{growth}")), ("levels", levels.to_owned())];
        let set = set.map(|(name, value)| (name.to_owned(), value)).into();
        let graph = load(session, path, &Options { set, ..Options::default() });
        let wanted = ["model.glb", "model.ply"].map(str::to_owned);
        let made = session.produce(&graph, &wanted, into, &(), &CancelToken::default()).unwrap();
        assert!(made.complete, "{:?}", made.diagnostics);
        made.written
    }
    let mut long = session();
    let into = OutputFolder::new(Some(folder.path()), &path);
    for (growth, levels) in
        [(12.0, "3"), (13.0, "3"), (12.5, "3"), (12.5, "1"), (13.0, "3"), (40.0, "3"), (12.5, "3")]
    {
        let written = write(&mut long, &into, growth, levels, &path);
        let fresh = tempfile::tempdir().unwrap();
        let alone = OutputFolder::new(Some(fresh.path()), &path);
        for (file, expected) in
            written.iter().zip(write(&mut session(), &alone, growth, levels, &path))
        {
            let [bytes, expected_bytes] =
                [file, &expected].map(|it| std::fs::read(&it.path).unwrap());
            assert!(levels == "1" || 16 << 20 <= bytes.len(), "large enough to be in pieces");
            assert!(bytes == expected_bytes, "{growth} {levels}: {}", file.output);
            assert_eq!(file.hash, expected.hash, "{growth} {levels}: {}", file.output);
        }
    }
}
