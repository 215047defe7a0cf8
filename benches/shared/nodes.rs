//! Evaluates nodes of a graph, and measures their CPU time.

use std::path::Path;
use std::time::Duration;

use maquette::{Catalog, Graph, Observer, Options, Run, Session, Settings, Targets};
use rustix::time::{ClockId, clock_gettime};

/// Reads the text of a graph, as if its file were in the folder of the example graphs, whose files it reads. Each pair of `set` is a
/// parameter and its value.
pub(crate) fn load(text: &str, set: &[(&str, String)]) -> Graph {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../graphs/bench.ron"));
    let set = set.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
    let options = Options { set, ..Options::default() }.with_text(path, text);
    let checked = Graph::load(path, &Catalog::new(maquette_nodes::PACKS), &options);
    let messages: Vec<_> = checked.diagnostics.iter().map(|found| &found.message[..]).collect();
    checked.graph.unwrap_or_else(|| panic!("{}", messages.join("; ")))
}

pub(crate) fn session(threads: usize) -> Session {
    let settings = Settings { threads, memory: 8 << 30, ..Settings::in_memory() };
    Session::new(maquette_nodes::PACKS, &settings).expect("threads")
}

pub(crate) fn evaluate(
    graph: &Graph,
    nodes: &[String],
    session: &mut Session,
    observer: &dyn Observer,
) {
    let run = Run { targets: Targets::Nodes(nodes.to_vec()), observer, ..Run::default() };
    session.run(graph, &run).expect("nodes of the graph");
}

pub(crate) fn cpu_time(clock: ClockId) -> Duration {
    let time = clock_gettime(clock);
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}
