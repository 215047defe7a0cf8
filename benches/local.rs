//! Measures the cost of a local change, on two threads and in memory, compared with computing everything again. First the nose of the
//! example doll grows by a millimeter under four levels of subdivision, which give about 10 million faces. Then a fraction of the control
//! vertices is moved, and finally a fraction of the vertices of the surface itself.
//!
//! Target: at most 40 ms for growing the nose.

#![allow(clippy::print_stdout, reason = "whoever measures must know what was measured")]

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use maquette::value::Mesh;
use maquette::{
    AnyValue, CancelToken, Carry, Catalog, CheckedGraph, Context, Error, Evaluator, Graph, In,
    Node, Options, OutputFolder, Pack, Promise, Session, Settings, Transfer, node,
};
use maquette_nodes::subdivision::{Plan, Scheme, Subdivision};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const GRAPHS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../graphs");

/// The number of measurements; their median is reported.
const SAMPLES: usize = 11;

/// The memory for results in bytes, which is the program's default. With more memory, all old values would be kept, and none could be
/// updated in place.
const MEMORY: usize = 2_000_000_000;

/// Moves the first vertices of a mesh along z.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Push {
    /// The mesh.
    mesh: In<Mesh>,
    /// The fraction of its vertices that is moved.
    share: f64,
    /// Distance along z in mm.
    by: f64,
}

impl Node for Push {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];
    const CARRIES: &'static [Carry] = &[Carry::uniform("mesh", "mesh", Transfer::Kept)];
    const PROMISES: &'static [Promise<Self>] = &[
        Promise::from("mesh", "Triangles", "mesh"),
        Promise::from("mesh", "Manifold", "mesh"),
        Promise::from("mesh", "Oriented", "mesh"),
        Promise::from("mesh", "Unpinched", "mesh"),
    ];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let count = (mesh.positions().len() as f64 * self.share) as usize;
        let mut places = mesh.positions().to_vec();
        places[..count].iter_mut().for_each(|place| place.z += self.by);
        Ok((mesh.with_positions(places)?,))
    }
}

/// Moves the vertices of a mesh that are nearest to its first vertex along z.
#[derive(Serialize, Deserialize, JsonSchema)]
struct Dent {
    /// The mesh.
    mesh: In<Mesh>,
    /// The fraction of its vertices that is moved.
    share: f64,
    /// Distance along z in mm.
    by: f64,
}

impl Node for Dent {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];
    const CARRIES: &'static [Carry] = &[Carry::uniform("mesh", "mesh", Transfer::Kept)];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let mut places = mesh.positions().to_vec();
        let first = places[0];
        let far: Vec<_> = places.iter().map(|place| (place - first).norm_squared()).collect();
        let count = (far.len() as f64 * self.share) as usize;
        let most = match count < far.len() {
            true => *far.clone().select_nth_unstable_by(count, f64::total_cmp).1,
            false => f64::INFINITY,
        };
        let near = places.iter_mut().zip(&far).filter(|(_, far)| **far < most);
        near.for_each(|(place, _)| place.z += self.by);
        Ok((mesh.with_positions(places)?,))
    }
}

const PACK: Pack = Pack { name: "bench", nodes: &[node::<Push>(), node::<Dent>()], ..Pack::EMPTY };

fn packs() -> Vec<&'static Pack> {
    maquette_nodes::PACKS.iter().copied().chain([&PACK]).collect()
}

fn load(path: &Path, parameters: &[(&str, f64)]) -> Graph {
    let packs = packs();
    let set = parameters.iter().map(|(name, value)| ((*name).to_owned(), format!("{value:?}")));
    let set = set.chain([("levels".to_owned(), "4".to_owned())]).collect();
    let CheckedGraph { graph, diagnostics: problems, .. } =
        Graph::load(path, &Catalog::new(&packs), &Options { set, ..Options::default() });
    graph.unwrap_or_else(|| panic!("{}", problems[0].message))
}

/// Writes a copy of the example graph `doll.ron` with additional nodes that move vertices.
fn project() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    fs::create_dir(folder.path().join("doll")).expect("a folder");
    for name in ["doll/color.png", "doll/range.pcd", "doll/camera.json"] {
        fs::copy(Path::new(GRAPHS).join(name), folder.path().join(name)).expect("a copy");
    }
    let text = fs::read_to_string(Path::new(GRAPHS).join("doll.ron")).expect("the graph");
    let pushed = "\"pushed\": Push(mesh: \"grid\", share: Param(\"share\"), by: Param(\"by\")),\n\
        \"pulled\": Ffd(mesh: \"skin\", mode: Displacement, space: Box, background: 0.1, accuracy: 0.00001, handles: [\n\
            (at: (0.5, 0.6, 0.9), to: (0.5, 0.6, Param(\"pull\")), sigma: (0.03, 0.03, 0.03))]),\n\
        \"dented\": Dent(mesh: \"skin\", share: Param(\"dent\"), by: Param(\"depth\")),\n\
        \"turned\": Transform(mesh: \"dented\", rotate: (0, 30, 0)),\n\
        \"mirrored\": Transform(mesh: \"dented\", scale: (-1, 1, 1)),\n\
        \"beside\": Merge(meshes: [\"dented\", \"grid\"]),\n";
    let text = text
        .replace(
            "\"skin\": Subdivide(mesh: \"grid\"",
            &format!("{pushed}\"skin\": Subdivide(mesh: \"pushed\""),
        )
        .replace(
            "params: {",
            "params: { \"share\": Number(default: 0.0), \"by\": Number(default: 0.0), \"pull\": Number(default: 1.0), \"dent\": Number(default: 0.0), \"depth\": Number(default: 0.0),",
        );
    let path = folder.path().join("doll.ron");
    fs::write(&path, text).expect("a file");
    (folder, path)
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

fn evaluator() -> Evaluator {
    Evaluator::new(2, MEMORY).expect("threads")
}

/// Evaluates the graphs one after the other. Returns the median time in milliseconds from a changed parameter to the value of the node
/// `target`, and the median time of each node.
fn changes(evaluator: &mut Evaluator, graphs: &[Graph], target: &str) -> (f64, Vec<(String, f64)>) {
    let mut nodes: Vec<(String, Vec<f64>)> = Vec::new();
    let mut times = Vec::new();
    for (index, graph) in graphs.iter().enumerate() {
        let start = Instant::now();
        let evaluation = evaluator.evaluate_nodes(graph, &[target]);
        if index > 0 {
            times.push(start.elapsed().as_secs_f64() * 1e3);
            for node in evaluation.trace().0 {
                match nodes.iter_mut().find(|(name, _)| *name == node.name) {
                    Some((_, times)) => times.push(node.seconds * 1e3),
                    None => nodes.push((node.name, vec![node.seconds * 1e3])),
                }
            }
        }
    }
    let nodes = nodes.into_iter().map(|(name, times)| (name, median(times)));
    (median(times), nodes.filter(|(_, time)| *time >= 0.05).collect())
}

/// Prints the time from a changed parameter to the written file.
fn save_graph(path: &Path) {
    let packs = packs();
    let settings = Settings { threads: 2, memory: MEMORY, ..Settings::in_memory() };
    let mut session = Session::new(&packs, &settings).expect("threads");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let outputs = OutputFolder::new(Some(folder.path()), path);
    let mut times = Vec::new();
    warm_up();
    for k in 0..=SAMPLES {
        let graph = load(path, &[("growth", 12.0 + k as f64)]);
        let start = Instant::now();
        let only = ["model.ply".to_owned()];
        let made = session.produce(&graph, &only, &outputs, &(), &CancelToken::default());
        let made = made.expect("such an output");
        assert!(made.complete && !made.written[0].unchanged, "the file is written");
        times.push(start.elapsed().as_secs_f64() * 1e3);
        if k == SAMPLES {
            times.remove(0);
            let [time, size] = [median(times.split_off(0)), made.written[0].bytes as f64 / 1e6];
            println!("from a millimeter to the written PLY file: {time:.0} ms, {size:.0} MB");
        }
    }
}

fn mesh(evaluator: &mut Evaluator, graph: &Graph, node: &str) -> Mesh {
    let evaluation = evaluator.evaluate_nodes(graph, &[node]);
    let mesh = evaluation.find(graph, node, "").and_then(AnyValue::get::<Mesh>);
    mesh.cloned().expect("a mesh")
}

/// Makes a virtual machine get memory from its host in advance. The host may have taken back unused memory, and getting 2 MiB of it again
/// can take milliseconds. Also makes the allocator keep freed memory, as the program does.
fn warm_up() {
    maquette::memory::keep_freed();
    let mut memory: Vec<u8> = maquette::memory::huge_vec(4 << 30);
    memory.iter_mut().step_by(4096).for_each(|byte| *byte = 1);
}

/// Returns two median times in milliseconds: for updating the result of a node after its input has changed, and for computing it from
/// scratch.
fn time_updates(node: &str, from: &str, graph: &dyn Fn(usize) -> Graph) -> [f64; 2] {
    // Use a high memory limit, because memory that several values share is counted once for each of them.
    let mut own = Evaluator::new(2, 16 << 30).expect("threads");
    let mut times = [Vec::new(), Vec::new()];
    warm_up();
    for k in 0..=14 {
        let graph = graph(k);
        // Evaluate the input in advance in half of the cases. Then the node cannot update its result, and computes it from scratch.
        if k % 2 == 0 {
            own.evaluate_nodes(&graph, &[from]);
        }
        let trace = own.evaluate_nodes(&graph, &[node]).trace().0;
        let seconds = trace.iter().find(|it| it.name == node).expect("it ran").seconds;
        if k > 0 {
            times[usize::from(k % 2 == 0)].push(seconds * 1e3);
        }
    }
    let last = graph(13);
    fn hash(evaluator: &mut Evaluator, last: &Graph, node: &str) -> maquette::Hash {
        evaluator.evaluate_nodes(last, &[node]).find(last, node, "").expect("a value").hash()
    }
    assert!(
        hash(&mut own, &last, node) == hash(&mut evaluator(), &last, node),
        "other bytes than without memory"
    );
    times.map(median)
}

/// Prints the times of nodes that depend on the surface, when some of its vertices move. Also prints the times of blending when the nose
/// grows.
fn followers(path: &Path) {
    fn row(node: &str, from: &str, graph: &dyn Fn(usize) -> Graph) -> String {
        let [followed, anew] = time_updates(node, from, graph);
        format!("{node} {followed:.1} ms ({anew:.1} ms)")
    }
    println!("share dented   followed (anew)");
    for share in [0.001, 0.01, 0.1, 1.0] {
        let dented = |k: usize| load(path, &[("dent", share), ("depth", 0.01 * k as f64)]);
        let told = ["turned", "mirrored", "beside"].map(|node| row(node, "dented", &dented));
        println!("{:9.1} %    {}", share * 100.0, told.join(", "));
    }
    let grown = |k: usize| load(path, &[("growth", 12.0 + k as f64)]);
    println!("growth by a millimeter of the grid: {}", row("blended", "surface", &grown));
}

fn main() {
    let (_folder, path) = project();
    println!("local change of the doll, levels 4; two threads, medians of {SAMPLES}");

    let graphs: Vec<_> =
        (0..=SAMPLES).map(|k: usize| load(&path, &[("growth", 12.0 + k as f64)])).collect();
    let mut own = evaluator();
    warm_up();
    let (time, nodes) = changes(&mut own, &graphs, "model");
    let skin = mesh(&mut own, &graphs[SAMPLES], "model");
    println!("growth by a millimeter: {time:.1} ms, {} faces", skin.faces().len());
    nodes.iter().for_each(|(name, time)| println!("    {name:8} {time:6.1} ms"));
    let alone = mesh(&mut evaluator(), &graphs[SAMPLES], "model");
    assert!(
        maquette::hash_of(&skin) == maquette::hash_of(&alone),
        "other bytes than without memory"
    );
    drop((skin, alone));

    save_graph(&path);

    let graphs: Vec<_> =
        (0..=SAMPLES).map(|k: usize| load(&path, &[("pull", 1.0 + 0.01 * k as f64)])).collect();
    warm_up();
    let (time, _) = changes(&mut own, &graphs, "pulled");
    let [skin, pulled] = ["skin", "pulled"].map(|node| mesh(&mut own, &graphs[SAMPLES], node));
    let pairs = skin.positions().iter().zip(pulled.positions().iter());
    let moved = pairs.filter(|(skin, pulled)| skin != pulled).count();
    println!("handle of an FFD by a hundredth of the box: {time:.1} ms, {moved} vertices moved");
    drop((own, skin, pulled));

    println!("share moved   followed   positions anew, with their hash");
    let how: Subdivision =
        serde_json::from_value(serde_json::json!({ "scheme": Scheme::Loop, "levels": 4 }))
            .expect("parameters");
    for share in [0.001, 0.01, 0.03, 0.1, 0.3, 1.0] {
        let graphs: Vec<_> = (0..=SAMPLES)
            .map(|k: usize| load(&path, &[("share", share), ("by", 0.01 * k as f64)]))
            .collect();
        let mut own = evaluator();
        warm_up();
        let (time, _) = changes(&mut own, &graphs, "model");
        let skin = mesh(&mut own, &graphs[SAMPLES], "skin");
        let pushed = mesh(&mut own, &graphs[SAMPLES], "pushed");
        drop(own);
        let plan = Plan::new(&pushed, how).expect("a surface");
        let evaluator = evaluator();
        let anew: Vec<_> = (0..SAMPLES)
            .map(|_| {
                let start = Instant::now();
                let refined =
                    evaluator.install(|| AnyValue::new(plan.apply(&pushed).expect("a mesh")));
                (start.elapsed().as_secs_f64() * 1e3, refined.hash())
            })
            .collect();
        assert!(anew[0].1 == AnyValue::new(skin).hash(), "other bytes than without memory");
        let anew = median(anew.iter().map(|(time, _)| *time).collect());
        println!("{:9.1} %   {time:5.1} ms   {anew:5.1} ms", share * 100.0);
    }

    followers(&path);
}
