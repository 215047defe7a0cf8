//! Units are converted: `cm(1.2)` is 12 in a field in millimeters. The check refuses units of another kind.

use std::path::Path;

use maquette::value::{Curve, Mesh, Points};
use maquette::{
    Catalog, Graph, Options, Run, RunTrace, Session, Settings, Severity, State, Targets,
};
use maquette_nodes::PACKS;
use tempfile::TempDir;

const BALL: &str = "v 1.5 0 0\nv 0 2.25 0\nv 0 0 3\nv 0 0 0\nf 1 2 3\nf 2 1 4\nf 3 2 4\nf 1 3 4\n";

fn session() -> Session {
    Session::new(PACKS, &Settings { threads: 2, ..Settings::in_memory() }).unwrap()
}

/// Creates a folder with a mesh, points and a curve. Each exists in two files, with numbers in millimeters and in meters.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fn write(name: &str, text: &str, folder: &TempDir) {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    fn in_meters(text: &str) -> String {
        text.lines()
            .map(|line| match line.starts_with('f') || line.starts_with('l') {
                true => line.to_owned(),
                false => line
                    .split(' ')
                    .map(|word| match word.parse::<f64>() {
                        Ok(number) => format!("{}", number / 1000.0),
                        Err(_) => word.to_owned(),
                    })
                    .collect::<Vec<_>>()
                    .join(" "),
            })
            .collect::<Vec<_>>()
            .join("\n")
            + "\n"
    }
    let line = "v 1 2 3\nv 4.5 0 0\nv 0 6 1\nl 1 2 3\n";
    let points = "1.25 2 3\n4 5 6.5\n";
    for (name, text) in [("ball.obj", BALL), ("line.obj", line), ("points.xyz", points)] {
        write(name, text, &folder);
        write(&format!("m-{name}"), &in_meters(text), &folder);
    }
    folder
}

fn graph(params: &str, nodes: &str) -> String {
    format!(
        "Graph(format: 1, params: {{{params}}}, nodes: {{{nodes}}}, outputs: {{\"out.ply\": \"out\"}})"
    )
}

fn load(folder: &TempDir, text: &str, set: &[(&str, &str)]) -> Graph {
    let options = Options {
        set: set.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect(),
        ..Options::default()
    };
    let checked = Graph::load_text(
        &folder.path().join("graph.ron"),
        text.to_owned(),
        &Catalog::new(PACKS),
        &options,
    );
    checked.graph.unwrap_or_else(|| panic!("{text}: {:?}", checked.diagnostics))
}

fn computed_nodes(trace: &RunTrace) -> Vec<String> {
    let computed = trace.0.iter().filter(|node| node.state == State::Computed);
    computed.map(|node| node.name.clone()).collect()
}

/// Runs two graphs, one after the other. Checks that the second run computes nothing, because all keys are equal.
fn check_same(folder: &TempDir, graphs: [&Graph; 2]) {
    let mut session = session();
    for (index, graph) in graphs.into_iter().enumerate() {
        let run =
            session.run(graph, &Run { targets: Targets::Everything, ..Run::default() }).unwrap();
        // Ignore warnings: a sphere has no holes, so filling them causes one.
        let wrong = run.diagnostics().into_iter().find(|it| it.severity == Severity::Error);
        assert_eq!(wrong, None);
        let computed = computed_nodes(&run.trace());
        assert_eq!(computed.is_empty(), index == 1, "{}: {computed:?}", folder.path().display());
    }
}

fn check_nodes(written: &str, plain: &str) {
    let folder = folder();
    let ball = "\"ball\": ReadMesh(path: \"ball.obj\"), ";
    let graphs =
        [written, plain].map(|nodes| load(&folder, &graph("", &format!("{ball}{nodes}")), &[]));
    check_same(&folder, [&graphs[0], &graphs[1]]);
}

#[test]
fn a_number_with_a_unit_has_the_key_of_the_plain_number_in_the_fields_unit() {
    check_nodes(
        r#""out": Transform(mesh: "ball", translate: (cm(1.13), m(0.0123), inch(-0.1)), rotate: (0, 0, rad(3.141592653589793)))"#,
        r#""out": Transform(mesh: "ball", translate: (11.3, 12.3, -2.54), rotate: (0, 0, 180))"#,
    );
    // Units are also converted in enum variants, lists of groups, lists of lists, and `Some`.
    check_nodes(
        r#""out": FillHoles(mesh: "ball", holes: Region(Ball(at: (cm(1), 0, 0), radius: cm(0.2))))"#,
        r#""out": FillHoles(mesh: "ball", holes: Region(Ball(at: (10, 0, 0), radius: 2)))"#,
    );
    check_nodes(
        r#""net": PointNet(points: [[(0, 0, 0), (cm(1), 0, 0)], [(0, 1, 0), (1, 1, mm(2))]]), "s": Nurbs(net: "net", order: (2, 2)), "out": Tessellate(surface: "s", tolerance: cm(0.01))"#,
        r#""net": PointNet(points: [[(0, 0, 0), (10, 0, 0)], [(0, 1, 0), (1, 1, 2)]]), "s": Nurbs(net: "net", order: (2, 2)), "out": Tessellate(surface: "s", tolerance: 0.1)"#,
    );
    check_nodes(
        r#""all": ForEach(graph: "Transform", over: [(translate: (cm(1), 0, 0)), ()], with: (mesh: "ball", rotate: (deg(5), 0, 0))), "out": Merge(meshes: "all")"#,
        r#""all": ForEach(graph: "Transform", over: [(translate: (10, 0, 0)), ()], with: (mesh: "ball", rotate: (5, 0, 0))), "out": Merge(meshes: "all")"#,
    );
}

#[test]
fn a_parameters_values_are_in_its_own_unit_wherever_they_are_given() {
    let folder = folder();
    let nodes = r#""ball": ReadMesh(path: "ball.obj"), "out": Transform(mesh: "ball", translate: (Param("far"), Expr("far + mm(2)"), 0))"#;
    fn graph_with_far(text: &str, nodes: &str) -> String {
        graph(&format!("\"far\": Number({text})"), nodes)
    }
    let plain = load(&folder, &graph_with_far("default: 12.0, unit: \"mm\"", nodes), &[]);
    for text in [
        "default: cm(1.2), unit: \"mm\"",
        "default: 12.0, min: cm(1), max: inch(1), unit: \"mm\"",
        // A parameter may have another unit than the field in which it is used.
        "default: 1.2, unit: \"cm\"",
        "default: mm(12), unit: \"m\"",
    ] {
        check_same(&folder, [&load(&folder, &graph_with_far(text, nodes), &[]), &plain]);
    }
    let set =
        load(&folder, &graph_with_far("default: 3.0, unit: \"mm\"", nodes), &[("far", "cm(1.2)")]);
    check_same(&folder, [&set, &plain]);
    let field = load(
        &folder,
        &graph("", &nodes.replace("Expr(\"far + mm(2)\")", "14").replace("Param(\"far\")", "0")),
        &[("out.translate.0", "cm(1.2)")],
    );
    check_same(&folder, [&field, &plain]);
    let schema =
        load(&folder, &graph_with_far("default: cm(1.2), max: m(1), unit: \"mm\"", nodes), &[])
            .schema()
            .clone();
    let far = &schema["properties"]["far"];
    assert_eq!((&far["default"], &far["maximum"]), (&12.0.into(), &1000.0.into()));
}

#[test]
fn a_patch_and_a_use_give_numbers_with_units() {
    let folder = folder();
    fn write(name: &str, text: &str, folder: &TempDir) {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    write(
        "used.ron",
        r#"Graph(format: 1, inputs: {"mesh": Mesh()}, params: {"far": Number(default: 1.0, max: 50.0, unit: "mm")},
        nodes: {"moved": Transform(mesh: "mesh", translate: (Param("far"), 0, 0))}, outputs: {"mesh": "moved"})"#,
        &folder,
    );
    fn using(far: &str) -> String {
        format!(
            r#"Graph(format: 1, use: {{"Moved": "used.ron"}}, params: {{"own": Number(default: 1.2, unit: "cm")}},
        nodes: {{"ball": ReadMesh(path: "ball.obj"), "out": Moved(mesh: "ball", far: {far})}}, outputs: {{"out.ply": "out"}})"#
        )
    }
    let plain = load(&folder, &using("12.0"), &[]);
    for far in ["cm(1.2)", "Param(\"own\")", "Expr(\"own\")"] {
        check_same(&folder, [&load(&folder, &using(far), &[]), &plain]);
    }
    write("whole.ron", &using("Param(\"own\")"), &folder);
    let patch = r#"Patch(format: 1, of: "whole.ron", params: {"own": mm(3)}, nodes: {"out": (far: inch(1))})"#;
    check_same(&folder, [&load(&folder, patch, &[]), &load(&folder, &using("25.4"), &[])]);
}

#[test]
fn custom_units_are_words_and_nothing_is_refused_by_them() {
    let folder = folder();
    let nodes = r#""ball": ReadMesh(path: "ball.obj"), "out": Transform(mesh: "ball", translate: (Param("a"), Expr("a + b"), Expr("c * 2")))"#;
    let params = r#""a": Number(default: 1.0, unit: "paces"), "b": Number(default: 2.0, unit: "mm"), "c": Number(default: 3.0)"#;
    let plain = nodes
        .replace("Param(\"a\")", "1")
        .replace("Expr(\"a + b\")", "3")
        .replace("Expr(\"c * 2\")", "6");
    check_same(
        &folder,
        [&load(&folder, &graph(params, nodes), &[]), &load(&folder, &graph("", &plain), &[])],
    );
}

#[test]
fn one_scan_in_meters_and_in_millimeters_gives_the_same_results() {
    let folder = folder();
    fn nodes(prefix: &str, unit: &str) -> String {
        graph(
            "",
            &format!(
                r#""mesh": ReadMesh(path: "{prefix}ball.obj"{unit}), "fine": Subdivide(mesh: "mesh", scheme: Loop, levels: 2), "out": Transform(mesh: "fine", translate: (cm(1), 0, 0), rotate: (20, 30, 0)),
            "points": ReadPoints(path: "{prefix}points.xyz"{unit}), "curve": ReadCurve(path: "{prefix}line.obj"{unit}), "tube": Tube(curve: "curve", radius: 0.5)"#
            ),
        )
    }
    let mut runs = Vec::new();
    for (prefix, unit) in [("", ""), ("m-", ", unit: M")] {
        let graph = load(&folder, &nodes(prefix, unit), &[]);
        let run =
            session().run(&graph, &Run { targets: Targets::Everything, ..Run::default() }).unwrap();
        assert!(run.diagnostics().is_empty(), "{:?}", run.diagnostics());
        let mut places = Vec::new();
        for mesh in ["out", "tube"] {
            places.extend_from_slice(run.get::<Mesh>(mesh).unwrap().positions());
        }
        places.extend_from_slice(run.get::<Points>("points").unwrap().positions());
        places.extend_from_slice(run.get::<Curve>("curve").unwrap().points());
        runs.push(places);
    }
    let [millimeters, meters] = &runs[..] else { panic!("two runs") };
    assert!(millimeters.len() > 60 && millimeters.len() == meters.len());
    for (a, b) in millimeters.iter().zip(meters) {
        assert!((a - b).norm() <= 1e-9 * a.coords.norm(), "{a} {b}");
    }
}

#[test]
fn edits_keep_what_is_written_and_refuse_what_does_not_fit() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../graphs/doll.ron");
    let text = std::fs::read_to_string(&path).unwrap();
    let catalog = Catalog::new(PACKS);
    let set = |value: &str| {
        let set = [("growth".to_owned(), value.to_owned())];
        maquette::edit::set_values(&path, &text, &set, &catalog, &Options::default())
    };
    let edited = set("cm(1.2)").unwrap();
    assert_eq!(edited.text, text.replace("default: 12.0", "default: cm(1.2)"));
    assert_eq!(maquette::edit::format_text(&path, &edited.text).unwrap(), edited.text);
    let problems = set("px(3)").unwrap_err();
    assert_eq!(problems[0].message, "parameter `growth` is in mm, but `px(3)` is in px");
    assert!(set("cm(5)").unwrap_err()[0].message.contains("is 50 mm, but must be"));
}

#[test]
fn what_is_expected_takes_units_too() {
    let folder = folder();
    fn graph_expecting(expect: &str) -> String {
        graph("", r#""out": ReadMesh(path: "ball.obj")"#)
            .replace("outputs:", &format!("expect: [{expect}], outputs:"))
    }
    fn run_messages(expect: &str, folder: &TempDir) -> Vec<String> {
        let graph = load(folder, &graph_expecting(expect), &[]);
        let run = session().run(&graph, &Run::default()).unwrap();
        run.diagnostics().into_iter().map(|problem| problem.message).collect::<Vec<_>>()
    }
    let holds = r#"Bounds(of: "out", low: (0, 0, 0), high: (cm(0.15), mm(2.25), m(0.003))), Bend(of: "out", max: rad(3.1)),
        Near(of: "out", to: "out.ply", max: cm(0.01), rms: Some(mm(0.1)))"#;
    assert_eq!(run_messages(holds, &folder), [""; 0]);
    let told_of_box = run_messages(&holds.replace("cm(0.15)", "cm(0.14)"), &folder);
    assert!(
        told_of_box[0].starts_with("expected Bounds, but `out` has 1 vertices"),
        "{told_of_box:?}"
    );
    fn wrong(expect: &str, folder: &TempDir) -> Vec<String> {
        let (path, options) = (folder.path().join("graph.ron"), Options::default());
        let checked =
            Graph::load_text(&path, graph_expecting(expect), &Catalog::new(PACKS), &options);
        checked
            .diagnostics
            .into_iter()
            .map(|it| format!("{} ({})", it.message, it.help))
            .collect::<Vec<_>>()
    }
    let like = "a plain number is in mm; other units of the same kind are converted";
    assert_eq!(
        wrong(
            r#"Near(of: "out", to: "out", max: px(3)), Bounds(of: "out", low: (0, 0, deg(1)), high: (1, 1, 1))"#,
            &folder
        ),
        [
            format!("field `max` of Near is in mm, but `px(3)` is in px ({like})"),
            format!("field `low` of Bounds is in mm, but `deg(1)` is in deg ({like})"),
        ]
    );
    assert_eq!(
        wrong(r#"Count(of: "out", what: "faces", min: mm(3))"#, &folder),
        ["field `min` of Count has no unit, but `mm(3)` is in mm (write a plain number)"]
    );
    let too_much = wrong(r#"Bend(of: "out", max: rad(4))"#, &folder);
    assert!(too_much[0].starts_with("field `max` of Graph is 229.18"), "{too_much:?}");
}

#[test]
fn a_difference_is_shown_as_it_is_written_and_another_unit_for_the_same_is_none() {
    fn text(size: &str, reach: &str, high: &str) -> String {
        let params = format!(r#""reach": Number(default: {reach}, unit: "mm")"#);
        let nodes = format!(
            r#""ball": ReadMesh(path: "ball.obj"), "out": Transform(mesh: "ball", translate: (0, {size}, Param("reach")), rotate: (0, 0, deg(5)))"#
        );
        graph(&params, &nodes).replace(
            "outputs:",
            &format!(
                r#"expect: [Bounds(of: "out", low: (0, 0, 0), high: ({high}, 1, 1))], outputs:"#
            ),
        )
    }
    fn difference_texts(before: String, after: String) -> Vec<String> {
        let [before, after] =
            [before, after].map(|text| maquette::Source { name: "graph.ron".into(), text });
        let found = Graph::differences(&before, &after, &Catalog::new(PACKS)).unwrap();
        found.iter().map(ToString::to_string).collect::<Vec<_>>()
    }
    fn first_text() -> String {
        text("cm(3)", "inch(1)", "cm(1)")
    }
    assert_eq!(difference_texts(first_text(), text("30", "mm(25.4)", "10.0")), [""; 0]);
    assert_eq!(
        difference_texts(first_text(), text("cm(4)", "12", "inch(2.5)")),
        [
            r#"graph: changed expect: [Bounds(high: (cm(1), 1, 1), low: (0, 0, 0), of: "out")] -> [Bounds(high: (inch(2.5), 1, 1), low: (0, 0, 0), of: "out")]"#,
            "parameter reach: changed default: inch(1) -> 12",
            "node out: changed translate.1: cm(3) -> cm(4)",
        ]
    );
    // If only one side of a comparison has the field `rotate`, the reported difference shows the whole tuple.
    let bare = first_text().replace("rotate: (0, 0, deg(5))", "pivot: 1");
    let gone = difference_texts(first_text(), bare);
    assert!(
        gone.iter().any(|it| it.contains("changed rotate: (0, 0, deg(5)) -> left out")),
        "{gone:?}"
    );
}
