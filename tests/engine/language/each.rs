//! `ForEach` over data: repeats a node or graph for each component, point, part or hole, however many there are.

use std::path::PathBuf;

use maquette::value::{Faces, Labels, Mesh, Points};
use maquette::{
    AnyValue, CacheFolder, Catalog, Graph, InputValues, Options, Pack, Run, RunResult, Session,
    Settings, State, Targets, node, value_type,
};
use nalgebra::Point3;
use regions::{Center, Collect, grid};

mod nodes;
#[path = "../../common/regions.rs"]
mod regions;
mod sequences;

use nodes::{Add, Along, Beads, Corner, Count, Rim};

const PACK: Pack = Pack {
    name: "loops",
    nodes: &[
        node::<Center>(),
        node::<Collect>(),
        node::<Add>(),
        node::<Along>(),
        node::<Corner>(),
        node::<Rim>(),
        node::<Count>(),
    ],
    values: &[value_type::<Beads>()],
    ..Pack::EMPTY
};

fn session() -> Session {
    Session::new(
        &[&maquette::format::PACK, &PACK],
        &Settings { threads: 2, ..Settings::in_memory() },
    )
    .unwrap()
}

/// A temporary folder for graph files.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self) -> PathBuf {
        self.0.path().join("graph.ron")
    }

    fn put(&self, name: &str, fields: &str) {
        let text = format!("Graph(format: 1, {fields})");
        std::fs::write(self.0.path().join(name), text).unwrap();
    }

    fn load(&self) -> Graph {
        let checked = Graph::load(
            &self.path(),
            &Catalog::new(&[&maquette::format::PACK, &PACK]),
            &Options::default(),
        );
        checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics))
    }
}

/// Loads a graph whose text contains these fields.
fn graph(fields: &str) -> Graph {
    let folder = Folder::new();
    folder.put("graph.ron", fields);
    folder.load()
}

/// Creates labels in a single row of pixels. The spot with the index `k` is `widths[k]` pixels wide and begins at the pixel `10 * k`.
fn spots(widths: &[u32]) -> AnyValue {
    let mut row = Vec::new();
    for (spot, &width) in (1..).zip(widths) {
        row.extend(std::iter::repeat_n(spot, width as usize));
        // Let each spot begin at a fixed position, so that changing the width of one does not move the others.
        row.resize(10 * spot as usize, 0);
    }
    AnyValue::new(Labels::new(row.len(), 1, row).unwrap())
}

fn run(session: &mut Session, graph: &Graph, input: &str, value: AnyValue) -> RunResult {
    run_for(session, graph, input, value, Targets::Outputs)
}

fn run_for(
    session: &mut Session,
    graph: &Graph,
    input: &str,
    value: AnyValue,
    wanted: Targets,
) -> RunResult {
    let inputs = [(input.to_owned(), value)].into();
    session.run(graph, &Run { targets: wanted, inputs, ..Run::default() }).unwrap_or_else(
        |problems| {
            panic!("{problems:?}");
        },
    )
}

fn messages(finished: &RunResult) -> Vec<String> {
    finished.diagnostics().into_iter().map(|problem| problem.message).collect()
}

/// Returns the x coordinates of the points in an output.
fn along_x(finished: &RunResult, name: &str) -> Vec<f64> {
    let points = finished.get::<Points>(name).unwrap_or_else(|why| {
        panic!("{why}: {:?}", messages(finished));
    });
    points.positions().iter().map(|point| point.x).collect()
}

/// Returns the names of the nodes of this type that were computed.
fn computed_nodes(finished: &RunResult, kind: &str) -> Vec<String> {
    let trace = finished.trace().0.into_iter();
    let computed = trace.filter(|node| node.node == kind && node.state == State::Computed);
    computed.map(|node| node.name).collect()
}

const SPOTS: &str = r#"
    inputs: { "labels": Labels() },
    nodes: {
        "spots": ForEach(graph: "Center", over: "labels"),
        "all": Collect(points: "spots"),
    },
    outputs: { "all": "all" },
"#;

#[test]
fn each_component_runs_once_and_all_are_collected_in_order() {
    let found = run(&mut session(), &graph(SPOTS), "labels", spots(&[1, 3, 5]));
    assert_eq!(messages(&found), [] as [&str; 0]);
    assert_eq!(along_x(&found, "all"), [0.0, 11.0, 22.0]);
    assert_eq!(computed_nodes(&found, "Center"), ["spots/1", "spots/2", "spots/3"]);
}

#[test]
fn one_of_20_elements_changed_runs_one_body() {
    let (mut session, graph) = (session(), graph(SPOTS));
    let mut widths = [3; 20];
    assert_eq!(
        computed_nodes(&run(&mut session, &graph, "labels", spots(&widths)), "Center").len(),
        20
    );
    widths[6] = 5;
    let changed = run(&mut session, &graph, "labels", spots(&widths));
    assert_eq!(computed_nodes(&changed, "Center"), ["spots/7"]);
    assert_eq!(along_x(&changed, "all")[6], 62.0);
    // Removing an element changes the numbers of the elements after it, but not their results.
    let [_, rest @ ..] = widths;
    let mut labels = vec![0; 10];
    labels.extend(spots(&rest).get::<Labels>().unwrap().pixels());
    let fewer = AnyValue::new(Labels::new(200, 1, labels).unwrap());
    let before: Vec<_> = (0..20).map(|k| f64::from(10 * k + if k == 6 { 2 } else { 1 })).collect();
    let fewer = run(&mut session, &graph, "labels", fewer);
    assert_eq!(along_x(&fewer, "all")[5], before[6]);
    assert_eq!(along_x(&fewer, "all").len(), 19);
    assert!(computed_nodes(&fewer, "Center").is_empty());
}

/// Tests a run with more than a thousand small results. Only the first thousand of them are stored on disk.
#[test]
fn who_looks_at_one_node_forgets_no_element() {
    let graph = graph(
        r#"inputs: { "points": Points() },
        nodes: {
            "one": Along(at: 1),
            "sums": ForEach(graph: "Add", over: "points", each: "point", links: (sum: "one")),
            "all": Collect(points: "sums"),
        },
        outputs: { "all": "all" }"#,
    );
    let points = (0..1200).map(|k| Point3::new(f64::from(k), 0.0, 0.0));
    let points = AnyValue::new(Points::new(points.collect::<Vec<_>>()).unwrap());
    let inputs = InputValues::from([("points".to_owned(), points)]);
    let cache = tempfile::tempdir().unwrap();
    let folder = CacheFolder::At(cache.path().join("cache"));
    // Each call uses a new session, like a separate process.
    let then = |wanted: Option<Targets>| {
        let settings = Settings { threads: 2, cache: folder.clone(), ..Settings::in_memory() };
        let mut session = Session::new(&[&maquette::format::PACK, &PACK], &settings).unwrap();
        let fed = session.bind_inputs(&graph, &inputs).unwrap();
        if let Some(wanted) = wanted {
            let run = session.run(&fed, &Run { targets: wanted, ..Run::default() }).unwrap();
            assert_eq!(messages(&run), [] as [&str; 0]);
        }
        let said =
            [session.explain(&fed, "sums/1150").unwrap(), session.explain(&fed, "all").unwrap()];
        session.finish();
        said
    };
    then(Some(Targets::Outputs));
    let known = then(None);
    assert!(known[0].contains("does not run"), "{known:?}");
    // Accepts two answers of `why`. The node usually takes so little time that its result is not stored on disk. On a busy machine it may
    // take long enough to be stored.
    fn is_known(why: &str) -> bool {
        why.contains("does not run") || why.contains("too short to be stored")
    }
    assert!(is_known(&known[1]), "{known:?}");
    then(Some(Targets::Nodes(vec!["one".into()])));
    assert_eq!(then(None), known);
}

#[test]
fn names_are_those_of_a_list_and_each_element_can_be_had() {
    let folder = Folder::new();
    folder.put(
        "mark.ron",
        r#"inputs: { "spot": Labels() }, nodes: { "center": Center(labels: "spot") },
        outputs: { "points": "center" }"#,
    );
    folder.put(
        "graph.ron",
        r#"use: { "Mark": "mark.ron" }, inputs: { "labels": Labels() },
        nodes: { "eyes": ForEach(graph: "Mark", over: "labels") , "all": Collect(points: "eyes") },
        outputs: { "all": "all" }"#,
    );
    let names = ["eyes/2/center", "eyes/2", "eyes/2/spot"].map(str::to_owned);
    let wanted = Targets::Named(names.into());
    let found = run_for(&mut session(), &folder.load(), "labels", spots(&[1, 3]), wanted);
    assert_eq!(along_x(&found, "eyes/2/center"), [11.0]);
    assert_eq!(along_x(&found, "eyes/2"), [11.0]);
    assert_eq!(found.get::<Labels>("eyes/2/spot").unwrap().statistics().len(), 1);
    let wanted = Targets::Named(vec!["eyes/3/center".into()]);
    let inputs = [("labels".to_owned(), spots(&[1, 3]))].into();
    let refused = session().run(&folder.load(), &Run { targets: wanted, inputs, ..Run::default() });
    let refused = refused.err().expect("there are two eyes");
    assert_eq!(
        refused[0].message,
        "the graph has no output or node `eyes/3/center`: `eyes` has 2 elements"
    );
}

#[test]
fn a_component_is_the_picture_without_the_others() {
    let (width, height) = (300, 70);
    let labels = Labels::new(
        width,
        height,
        (0..width * height)
            .map(|at: usize| match [at % width, at / width] {
                [x, y] if x % 50 < 30 && y % 30 < 20 => (x / 50 + y / 30 * 6 + 1) as u32,
                _ => 0,
            })
            .collect(),
    )
    .unwrap();
    let count = labels.statistics().len() as u32;
    let alone = (1..=count).map(|number| {
        let pixels = labels.pixels().iter().map(|&label| u32::from(label == number));
        AnyValue::new(Labels::new(width, height, pixels.collect()).unwrap())
    });
    let alone = Vec::from_iter(alone);
    let names = (1..=count).map(|number| format!("spots/{number}/labels")).collect();
    let value = AnyValue::new(labels);
    let found = run_for(&mut session(), &graph(SPOTS), "labels", value, Targets::Named(names));
    for (number, alone) in (1..).zip(&alone) {
        let name = format!("spots/{number}/labels");
        assert_eq!(found.value(&name).map(AnyValue::hash), Some(alone.hash()), "{name}");
        assert_eq!(found.get::<Labels>(&name).unwrap(), alone.get::<Labels>().unwrap());
    }
}

#[test]
fn a_number_says_how_many_there_are_when_the_graph_is_read() {
    fn graph_with_count(default: u32) -> Graph {
        graph(&format!(
            r#"params: {{ "count": Integer(default: {default}, min: 0, max: 9) }},
            nodes: {{
                "steps": ForEach(graph: "Along", over: Param("count"), number: "at"),
                "all": Collect(points: "steps"),
            }},
            outputs: {{}}"#
        ))
    }
    let names: Vec<_> = graph_with_count(3).node_names().map(str::to_owned).collect();
    assert_eq!(names, ["steps/1", "steps/2", "steps/3", "all"]);
    for count in [0, 1, 4] {
        let wanted = Targets::Named(vec!["all".into()]);
        let run = Run { targets: wanted, ..Run::default() };
        let found = session().run(&graph_with_count(count), &run).unwrap();
        assert_eq!(along_x(&found, "all"), (1..=count).map(f64::from).collect::<Vec<_>>());
    }
}

#[test]
fn what_is_carried_goes_from_element_to_element_and_through_none() {
    let graph = graph(
        r#"inputs: { "cloud": Points() },
        nodes: {
            "start": Along(at: 7),
            "sum": ForEach(graph: "Add", over: "cloud", each: "point", carry: (sum: "start")),
        },
        outputs: { "sum": "sum" }"#,
    );
    fn cloud(xs: &[f64]) -> AnyValue {
        let points = xs.iter().map(|&x| Point3::new(x, 0.0, 0.0)).collect::<Vec<_>>();
        AnyValue::new(Points::new(points).unwrap())
    }
    let mut session = session();
    for xs in [&[1.0, 2.0, 3.0][..], &[], &[5.0]] {
        let found = run(&mut session, &graph, "cloud", cloud(xs));
        assert_eq!(along_x(&found, "sum"), [&[7.0], xs].concat());
    }
}

#[test]
fn without_elements_a_port_for_many_gets_an_empty_list() {
    let found = run(&mut session(), &graph(SPOTS), "labels", spots(&[]));
    assert_eq!(along_x(&found, "all"), [] as [f64; 0]);
}

#[test]
fn parts_and_holes_of_a_mesh_are_gone_over() {
    let graph = graph(
        r#"inputs: { "mesh": Mesh() },
        nodes: {
            "parts": ForEach(graph: "Corner", over: Parts("mesh")),
            "corners": Collect(points: "parts"),
            "holes": ForEach(graph: "Rim", over: Holes("mesh")),
            "rims": Collect(points: "holes"),
        },
        outputs: { "corners": "corners", "rims": "rims" }"#,
    );
    let positions =
        (0..6).map(|k| Point3::new(f64::from(k), f64::from(k * k), 0.0)).collect::<Vec<_>>();
    let mesh = Mesh::new(positions, Faces::triangles(vec![[3, 4, 5], [0, 1, 2]])).unwrap();
    let found = run(&mut session(), &graph, "mesh", AnyValue::new(mesh));
    assert_eq!(along_x(&found, "corners"), [3.0, 0.0]);
    assert_eq!(along_x(&found, "rims"), [3.0, 4.0, 5.0, 0.0, 1.0, 2.0]);
}

#[test]
fn values_of_other_packs_say_what_their_elements_are() {
    let graph = graph(
        r#"inputs: { "beads": Beads() },
        nodes: { "each": ForEach(graph: "Count", over: One("beads")), "all": Collect(points: "each") },
        outputs: { "all": "all" }"#,
    );
    let found = run(&mut session(), &graph, "beads", AnyValue::new(Beads(vec![4, 2])));
    assert_eq!(along_x(&found, "all"), [4.0, 2.0]);
}

#[test]
fn loops_go_over_what_loops_give_and_stand_in_each_other() {
    let folder = Folder::new();
    folder.put(
        "grow.ron",
        r#"inputs: { "point": Points(), "others": Points() },
        nodes: {
            "inner": ForEach(graph: "Collect", over: "others", each: "points"),
            "all": Collect(points: ["point", "inner"]),
        },
        outputs: { "points": "all" }"#,
    );
    folder.put(
        "graph.ron",
        r#"use: { "Grow": "grow.ron" }, inputs: { "labels": Labels() },
        nodes: {
            "spots": ForEach(graph: "Center", over: "labels"),
            "cloud": Collect(points: "spots"),
            "grown": ForEach(graph: "Grow", over: "cloud", each: "point", links: (others: "cloud")),
            "all": Collect(points: "grown"),
        },
        outputs: { "all": "all" }"#,
    );
    let (mut session, graph) = (session(), folder.load());
    for count in [2, 0, 3, 1] {
        let found = run(&mut session, &graph, "labels", spots(&vec![1; count]));
        let all: Vec<_> = (0..count).map(|k| 10.0 * k as f64).collect();
        let grown = all.iter().flat_map(|&x| [vec![x], all.clone()].concat());
        assert_eq!(along_x(&found, "all"), Vec::from_iter(grown));
    }
}

#[test]
fn an_element_that_is_not_there_is_an_error_at_its_link_with_the_count() {
    let graph = graph(
        r#"inputs: { "labels": Labels() },
        nodes: {
            "spots": ForEach(graph: "Center", over: "labels"),
            "all": Collect(points: "spots"),
            "second": Collect(points: "spots/2"),
        },
        outputs: { "all": "all", "second": "second" }"#,
    );
    let mut session = session();
    assert_eq!(along_x(&run(&mut session, &graph, "labels", spots(&[1, 3])), "second"), [11.0]);
    let one = run(&mut session, &graph, "labels", spots(&[1]));
    let why = "`spots/2` cannot be computed: there is no such element: `spots` has 1 element";
    assert_eq!(messages(&one), [why]);
    let problem = &one.diagnostics()[0];
    assert_eq!(&problem.source.text[problem.span.start..problem.span.end], "\"spots/2\"");
    assert_eq!(along_x(&one, "all"), [0.0]);
}

#[test]
fn more_elements_than_allowed_are_an_error_with_their_number() {
    fn graph_with_limit(most: &str) -> Graph {
        graph(&format!(
            r#"inputs: {{ "labels": Labels() }},
            nodes: {{
                "spots": ForEach(graph: "Center", over: "labels"{most}),
                "all": Collect(points: "spots"),
            }},
            outputs: {{ "all": "all" }}"#
        ))
    }
    let found = run(&mut session(), &graph_with_limit(", most: 2"), "labels", spots(&[1, 1, 1]));
    let why = "`labels` has 3 elements, but ForEach takes 2 at most: `most: 3` allows them";
    assert_eq!(messages(&found), [format!("`spots/labels` cannot be computed: {why}")]);
    assert!(
        messages(&run(&mut session(), &graph_with_limit(", most: 3"), "labels", spots(&[1; 3])))
            .is_empty()
    );
    let many = Labels::new(20_002, 1, (0..20_002).map(|k| k % 2 * k).collect()).unwrap();
    let found = run(&mut session(), &graph_with_limit(""), "labels", AnyValue::new(many));
    assert!(messages(&found)[0].contains("has 10001 elements"), "{:?}", messages(&found));
}

#[test]
fn a_number_that_an_element_cannot_have_lets_that_one_fail() {
    let graph = graph(
        r#"inputs: { "labels": Labels() },
        nodes: { "spots": ForEach(graph: "Center", over: "labels", number: "rank") },
        outputs: { "third": "spots/3", "fourth": "spots/4" }"#,
    );
    let found = run(&mut session(), &graph, "labels", spots(&[1; 4]));
    assert_eq!(along_x(&found, "third"), [20.0]);
    let messages = messages(&found);
    assert_eq!(messages.len(), 1, "{messages:?}");
    assert!(messages[0].starts_with("`spots/4` cannot be computed: "), "{messages:?}");
}

#[test]
fn data_that_fail_are_told_once() {
    let graph = graph(
        r#"inputs: { "mesh": Mesh() },
        nodes: {
            "corner": Corner(mesh: "mesh"),
            "each": ForEach(graph: "Collect", over: "corner", each: "points"),
            "cloud": Collect(points: "each"),
        },
        outputs: { "cloud": "cloud" }"#,
    );
    let empty = Mesh::new(vec![], Faces::triangles(vec![])).unwrap();
    let found = run(&mut session(), &graph, "mesh", AnyValue::new(empty));
    let messages = messages(&found);
    assert!(messages[..].len() == 1 && messages[0].starts_with("`corner` cannot"), "{messages:?}");
}

#[test]
fn the_data_of_a_loop_are_linked_to_it_in_a_drawing() {
    fn links(node: &str) -> usize {
        let nodes = r#"nodes: { "one": Along(at: 1), "sum": NODE, "all": Collect(points: "sum") }, outputs: { "all.ply": "all" }"#;
        maquette::diagram::to_svg(
            &graph(&nodes.replace("NODE", node)),
            &Catalog::new(&[&maquette::format::PACK, &PACK]),
        )
        .matches("<path")
        .count()
    }
    let each = r#"ForEach(graph: "Add", over: "one", each: "point", links: (sum: "one"))"#;
    assert_eq!(links(each), links(r#"Add(sum: "one", point: "one")"#));
}

#[test]
fn why_says_that_the_number_is_not_known_yet() {
    let (mut session, graph) = (session(), graph(SPOTS));
    for name in ["spots", "spots/2"] {
        let why = session.explain(&graph, name).expect("it may be there");
        assert!(why.contains("how many elements `spots` has is known when"), "{why}");
    }
    run(&mut session, &graph, "labels", spots(&[1, 2]));
    assert!(session.explain(&graph, "spots/2").unwrap().starts_with("`spots/2` "));
    assert_eq!(session.explain(&graph, "spots/3"), None);
}

#[test]
fn components_that_are_as_they_were_are_taken_over() {
    let (mut session, graph) = (session(), graph(SPOTS));
    let mut times = Vec::new();
    for changed in [None, Some(77), Some(154), Some(4900)] {
        let labels = grid(changed);
        let start = std::time::Instant::now();
        let found = run(&mut session, &graph, "labels", labels);
        times.push(start.elapsed());
        assert_eq!(along_x(&found, "all").len(), 5000);
    }
    let changed = times[1..].iter().min().unwrap();
    assert!(6 * *changed < times[0], "{times:?}");
}
