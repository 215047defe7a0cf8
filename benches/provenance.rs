//! Measures the cost of recording the provenance in output files. A mesh of a million triangles is written as PLY and as GLB, with and
//! without the record.
//!
//! There is no performance target.

use divan::Bencher;
use maquette::format::ply;
use maquette::value::{Faces, Mesh};
use maquette::{CancelToken, Options, OutputFolder, Run, RunResult, Session, Settings};
use nalgebra::Point3;

fn main() {
    divan::main();
}

/// Creates a wavy sheet of a million triangles.
fn sheet() -> Mesh {
    let (width, height) = (1001_u32, 501_u32);
    let quads = (0..height - 1).flat_map(|row| (0..width - 1).map(move |k| row * width + k));
    let faces = Faces::triangles(
        quads
            .flat_map(|a: u32| [[a, a + width, a + width + 1], [a, a + width + 1, a + 1]])
            .collect(),
    );
    Mesh::new(
        (0..width * height)
            .map(|k: u32| {
                let [x, y] = [k % width, k / width].map(f64::from);
                Point3::new(x, y, 5.0 * libm::sin(0.1 * x) * libm::cos(0.07 * y))
            })
            .collect::<Vec<_>>(),
        faces,
    )
    .expect("a mesh")
}

/// Runs a graph on two threads. Its only output is the sheet, in the format with the extension `ending`.
fn ran(ending: &str) -> (Session, RunResult) {
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = ply::encode(&sheet()).expect("a file");
    std::fs::write(folder.path().join("sheet.ply"), bytes).expect("a file");
    let text = format!(
        "Graph(format: 1, nodes: {{ \"sheet\": ReadMesh(path: \"sheet.ply\") }}, outputs: {{ \"out.{ending}\": \"sheet\" }})"
    );
    let path = folder.path().join("sheet.ron");
    let settings = Settings { threads: 2, memory: 1 << 30, ..Settings::in_memory() };
    let mut session = Session::new(maquette_nodes::PACKS, &settings).expect("threads");
    let checked = session.load(&path, &Options::default().with_text(&path, text));
    let graph = checked.graph.unwrap_or_else(|| panic!("{:?}", checked.diagnostics));
    let finished = session.run(&graph, &Run::default());
    (session, finished.unwrap_or_else(|problems| panic!("{problems:?}")))
}

fn write(bencher: Bencher<'_, '_>, ending: &str, is_told: bool) {
    let (session, finished) = ran(ending);
    bencher.with_inputs(|| tempfile::tempdir().expect("a folder")).bench_local_refs(|folder| {
        let into = OutputFolder::new(Some(folder.path()), "sheet.ron".as_ref());
        let into = if is_told { into } else { into.without_provenance() };
        let (written, problems) = session.write(&finished, &[], &into, &CancelToken::default());
        assert!(written.len() == 1 && problems.is_empty(), "{problems:?}");
    });
}

#[divan::bench(args = ["ply", "glb"], sample_count = 51, sample_size = 1)]
fn with_provenance(bencher: Bencher<'_, '_>, ending: &str) {
    write(bencher, ending, true);
}

#[divan::bench(args = ["ply", "glb"], sample_count = 51, sample_size = 1)]
fn untold(bencher: Bencher<'_, '_>, ending: &str) {
    write(bencher, ending, false);
}
