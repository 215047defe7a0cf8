//! Compares subdivision with OpenSubdiv and CGAL; run by hand with `just oracles`. The sources of the two programs are beside this file.
//! The first and second arguments are the built programs, and the third argument is the folder of the test data, shared/data.
//!
//! Prints for each mesh the largest distance between our points and theirs, divided by the mesh's largest coordinate. The other programs
//! number the vertices differently, so each of our vertices is compared with the nearest of theirs, and each of theirs must be the nearest
//! of one of ours.

#![allow(clippy::print_stdout, reason = "the table goes to whoever asks for it")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use maquette::value::{Faces, Mesh};
use maquette_nodes::mesh::read_mesh;
use maquette_nodes::subdivision::{
    Boundary, Corners, Creases, Scheme, Subdivision, crease, read_creases, subdivide,
};
use nalgebra::{Point3, Vector3};

/// Maximum difference, divided by the mesh's largest coordinate.
const TOLERANCE: f64 = 1e-12;

fn main() -> ExitCode {
    let [osd, cgal, data] =
        [1, 2, 3].map(|k| PathBuf::from(std::env::args().nth(k).unwrap_or_default()));
    if !data.is_dir() {
        println!("skipped: the test data is not there, {}", data.display());
        return ExitCode::SUCCESS;
    }
    let mut table = Table::default();
    println!("{:44} {:>9} {:>10} {:>10}", "mesh, 4 levels", "vertices", "points", "limits");
    for (name, mesh) in files(&data) {
        table.row(&osd, &name, std::slice::from_ref(&mesh), Scheme::CatmullClark, 4);
        if mesh.faces().sides() == Some(3) {
            table.row(&osd, &name, std::slice::from_ref(&mesh), Scheme::Loop, 4);
        }
        if mesh.creases().len() == 0 && mesh.edges().faces.iter().all(|&faces| faces == 2) {
            table.row(&cgal, &name, &[mesh], Scheme::DooSabin, 4);
        }
    }
    for creased in [false, true] {
        let word = if creased { "with creases" } else { "plain" };
        fn meshes(triangles: bool, creased: bool) -> Vec<Mesh> {
            random_meshes(100, triangles, creased)
        }
        table.row(
            &osd,
            &format!("100 random meshes, {word}"),
            &meshes(false, creased),
            Scheme::CatmullClark,
            4,
        );
        table.row(
            &osd,
            &format!("100 random meshes, {word}"),
            &meshes(true, creased),
            Scheme::Loop,
            4,
        );
    }
    let closed: Vec<Mesh> = random_closed(100);
    table.row(&cgal, "100 random closed meshes", &closed, Scheme::DooSabin, 4);
    println!("{} passed, {} failed", table.passed, table.failed);
    if table.failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn files(data: &Path) -> Vec<(String, Mesh)> {
    fn read(path: &str, data: &Path) -> Mesh {
        let ending = path.rsplit('.').next().unwrap_or_default();
        let bytes = fs::read(data.join(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
        read_mesh(&bytes, ending).unwrap_or_else(|error| panic!("{path}: {error}"))
    }
    let mug = read("doll/mug_control.obj", data);
    let creases = fs::read(data.join("doll/mug_creases.json")).expect("the mug has creases");
    let creased = read_creases(&mug, &creases).expect("creases of the mug");
    let coarse = read("doll/doll_coarse.obj", data);
    fn named_mesh(name: &str, mesh: Mesh) -> (String, Mesh) {
        (name.to_owned(), mesh)
    }
    vec![
        named_mesh("doll, coarse", coarse.clone()),
        named_mesh("doll, coarse, sharp where it bends", crease(&coarse, 20.0, 10.0)),
        named_mesh("doll, coarse, half sharp where it bends", crease(&coarse, 20.0, 1.5)),
        named_mesh("doll", read("doll/doll.ply", data)),
        named_mesh("mug", mug.clone()),
        named_mesh("mug, its creases", creased),
        named_mesh("mug, sharp where it bends", crease(&mug, 30.0, 10.0)),
        named_mesh("Spot", read("meshes/spot/spot_control_mesh.obj", data)),
        named_mesh("Spot, triangles", read("meshes/spot/spot_low_resolution.obj", data)),
        named_mesh("penguin", read("meshes/penguin/penguin_control_mesh.obj", data)),
    ]
}

#[derive(Default)]
struct Table {
    passed: usize,
    failed: usize,
}

impl Table {
    fn row(&mut self, oracle: &Path, name: &str, meshes: &[Mesh], scheme: Scheme, levels: u32) {
        let mut vertices = 0;
        let mut worst = [0.0f64; 2];
        for mesh in meshes {
            for (boundary, creases) in [
                (Boundary::EdgeAndCorner, Creases::OpenSubdiv),
                (Boundary::EdgeOnly, Creases::OpenSubdiv),
                (Boundary::EdgeAndCorner, Creases::Chaikin),
            ] {
                if creases == Creases::Chaikin && mesh.creases().len() == 0 {
                    continue;
                }
                let how = Subdivision {
                    scheme,
                    levels,
                    limit: false,
                    boundary,
                    creases,
                    corners: Corners::Linear,
                };
                let (count, errors) = compare(oracle, mesh, how);
                vertices += count;
                worst = [worst[0].max(errors[0]), worst[1].max(errors[1])];
                if scheme == Scheme::DooSabin || meshes.len() == 1 && vertices > 400_000 {
                    break;
                }
            }
        }
        let passed = worst.iter().all(|error| *error <= TOLERANCE);
        *(if passed { &mut self.passed } else { &mut self.failed }) += 1;
        let name = format!("{name}: {scheme:?}");
        let mark = if passed { "" } else { "  FAILED" };
        println!("{name:44} {vertices:9} {:10.1e} {:10.1e}{mark}", worst[0], worst[1]);
    }
}

/// Compares our points with those of the program `oracle`. Returns the number of vertices, and the largest distances of the subdivided
/// points and of the limit points.
fn compare(oracle: &Path, mesh: &Mesh, how: Subdivision) -> (usize, [f64; 2]) {
    let folder = std::env::temp_dir();
    let [input, output] = ["in", "out"]
        .map(|word| folder.join(format!("maquette-oracle-{}.{word}", std::process::id())));
    fs::write(&input, text(mesh, how)).expect("the temporary folder can be written");
    let done = Command::new(oracle).arg(&input).arg(&output).status().expect("the oracle runs");
    assert!(done.success(), "{} failed on {}", oracle.display(), input.display());
    let bytes = fs::read(&output).expect("the oracle has written");
    let numbers: Vec<f64> =
        bytes.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
    let count = numbers[0] as usize;
    let points: Vec<[f64; 3]> = numbers[1..].as_chunks::<3>().0.to_vec();
    let scale = mesh.positions().iter().map(|point| point.coords.amax()).fold(0.0, f64::max);
    let ours = subdivide(mesh, how).expect("a surface");
    assert_eq!(ours.positions().len(), count);
    let mut errors = [distance(ours.positions(), &points[..count]) / scale, 0.0];
    // Limit points are compared only if no crease is semi-sharp after these levels: each is infinitely sharp (10 or more) or already
    // smooth. OpenSubdiv has no limit for semi-sharp vertices. It also does not move inner vertices with only two faces to the limit.
    let lasting =
        |(_, sharpness): ([u32; 2], f64)| sharpness >= 10.0 || sharpness <= f64::from(how.levels);
    if points.len() > count && mesh.creases().all(lasting) && how.creases == Creases::OpenSubdiv {
        let ours = subdivide(mesh, Subdivision { limit: true, ..how }).expect("a surface");
        errors[1] = distance(ours.positions(), &points[count..]) / scale;
    }
    [input, output].iter().for_each(|path| fs::remove_file(path).expect("it was there"));
    (count, errors)
}

fn text(mesh: &Mesh, how: Subdivision) -> String {
    use std::fmt::Write;

    let mut text = String::new();
    let scheme = u8::from(how.scheme == Scheme::Loop);
    let boundary = u8::from(how.boundary == Boundary::EdgeAndCorner);
    let creasing = u8::from(how.creases == Creases::Chaikin);
    let counts = [mesh.positions().len(), mesh.faces().len(), mesh.creases().len()];
    let [vertices, faces, creases] = counts;
    let levels = how.levels;
    fn line(line: String, text: &mut String) {
        writeln!(text, "{line}").expect("a string can grow");
    }
    line(
        format!("{scheme} {levels} {boundary} {creasing} {vertices} {faces} {creases}"),
        &mut text,
    );
    mesh.positions().iter().for_each(|p| line(format!("{:e} {:e} {:e}", p.x, p.y, p.z), &mut text));
    for face in mesh.faces().iter() {
        let corners: Vec<String> = face.iter().map(u32::to_string).collect();
        line(format!("{} {}", face.len(), corners.join(" ")), &mut text);
    }
    mesh.creases().for_each(|([a, b], sharpness)| line(format!("{a} {b} {sharpness}"), &mut text));
    text
}

/// Returns the largest distance of a point of `ours` to the nearest point of `theirs`, or infinity if a point of `theirs` is not the
/// nearest of any.
fn distance(ours: &[Point3<f64>], theirs: &[[f64; 3]]) -> f64 {
    // Points are sorted along a direction in which the points of a symmetric mesh rarely coincide.
    let along = Vector3::new(0.726_31, 0.523_17, 0.445_93);
    let sorted =
        |points: &mut Vec<(f64, [f64; 3], u32)>| points.sort_by(|a, b| a.0.total_cmp(&b.0));
    fn sort_key(point: [f64; 3], index: u32, along: Vector3<f64>) -> (f64, [f64; 3], u32) {
        (along.dot(&Vector3::from(point)), point, index)
    }
    let mut ours: Vec<_> =
        ours.iter().zip(0..).map(|(&p, k)| sort_key(p.into(), k, along)).collect();
    let mut theirs: Vec<_> = theirs.iter().zip(0..).map(|(&p, k)| sort_key(p, k, along)).collect();
    sorted(&mut ours);
    sorted(&mut theirs);
    let window = 1e-7 * theirs.iter().map(|point| point.0.abs()).fold(0.0, f64::max);
    let mut met = vec![false; theirs.len()];
    let (mut worst, mut from) = (0.0f64, 0);
    for (at, point, _) in &ours {
        while from < theirs.len() && theirs[from].0 < at - window {
            from += 1;
        }
        let near = theirs[from..].iter().take_while(|other| other.0 <= at + window);
        let distances = near.zip(from..).map(|((_, other, _), place)| {
            ((Vector3::from(*other) - Vector3::from(*point)).norm(), place)
        });
        match distances.min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((distance, place)) => {
                worst = worst.max(distance);
                met[place] = true;
            }
            None => return f64::INFINITY,
        }
    }
    if met.iter().all(|met| *met) { worst } else { f64::INFINITY }
}

/// A pseudorandom number generator: xorshift.
struct Random(u64);

impl Random {
    fn next_below(&mut self, count: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as usize % count.max(1)
    }

    fn unit(&mut self) -> f64 {
        self.next_below(1 << 20) as f64 / f64::from(1 << 20)
    }
}

/// Returns random meshes with borders, of triangles only or of faces of several sizes.
fn random_meshes(count: usize, triangles: bool, creased: bool) -> Vec<Mesh> {
    let mut random = Random(0x9e37_79b9_7f4a_7c15 + u64::from(triangles) + 2 * u64::from(creased));
    let meshes = std::iter::repeat_with(|| {
        let mesh = random_mesh(&mut random, triangles, false)?;
        Some(if creased { with_creases(mesh, &mut random) } else { mesh })
    });
    meshes.flatten().take(count).collect()
}

fn random_closed(count: usize) -> Vec<Mesh> {
    let mut random = Random(77);
    std::iter::repeat_with(|| random_mesh(&mut random, false, true)).flatten().take(count).collect()
}

/// Returns a sheet or torus of quads, some of which are split, merged to larger faces, or removed. Returns `None` if the result is not a
/// surface.
fn random_mesh(random: &mut Random, triangles: bool, closed: bool) -> Option<Mesh> {
    let [m, n] = [0; 2].map(|_| 3 + random.next_below(4));
    let around = closed || random.next_below(3) == 0;
    let (rows, columns) = if around { (m, n) } else { (m + 1, n + 1) };
    fn vertex_index(i: usize, j: usize, rows: usize, columns: usize) -> u32 {
        (i % rows * columns + j % columns) as u32
    }
    let mut faces: Vec<Vec<u32>> = Vec::new();
    for (i, j) in (0..m * n).map(|k| (k / n, k % n)) {
        let mut quad = vec![
            vertex_index(i, j, rows, columns),
            vertex_index(i, j + 1, rows, columns),
            vertex_index(i + 1, j + 1, rows, columns),
            vertex_index(i + 1, j, rows, columns),
        ];
        quad.rotate_left(random.next_below(4));
        let cut = random.next_below(3) == 0;
        match random.next_below(8) {
            0 if !closed => {}
            _ if triangles || cut => {
                faces.extend([vec![quad[0], quad[1], quad[2]], vec![quad[0], quad[2], quad[3]]]);
            }
            _ => faces.push(quad),
        }
    }
    for _ in 0..if triangles { 0 } else { random.next_below(6) } {
        let [a, b] = [0; 2].map(|_| random.next_below(faces.len()));
        if a != b
            && let Some(joined) = join_triangles(&faces[a], &faces[b])
        {
            faces[a] = joined;
            faces.remove(b);
        }
    }
    let sides: Vec<usize> = faces.iter().map(Vec::len).collect();
    let positions: Vec<Point3<f64>> = (0..rows * columns)
        .map(|k| {
            let [x, y] = [(k / columns) as f64, (k % columns) as f64];
            Point3::new(x + 0.6 * random.unit(), y + 0.6 * random.unit(), random.unit())
        })
        .collect();
    // Vertices without faces are removed, because the other programs do not keep them.
    let used: Vec<u32> =
        (0..positions.len() as u32).filter(|v| faces.iter().flatten().any(|c| c == v)).collect();
    let corners = faces
        .iter()
        .flatten()
        .map(|corner| used.iter().position(|v| v == corner).unwrap_or_default() as u32)
        .collect();
    let positions: Vec<_> = used.iter().map(|&v| positions[v as usize]).collect();
    let mesh = Mesh::new(positions, Faces::polygons(&sides, corners).ok()?).ok()?;
    let how = Subdivision {
        scheme: Scheme::CatmullClark,
        levels: 1,
        limit: false,
        boundary: Boundary::EdgeOnly,
        creases: Creases::OpenSubdiv,
        corners: Corners::Linear,
    };
    match subdivide(&mesh, how) {
        Err(error) if error.to_string().starts_with("the mesh is not a surface") => None,
        _ => Some(mesh).filter(|mesh| !has_inner_valence_2(mesh)),
    }
}

/// Joins two faces if they share exactly one edge and no other vertex.
fn join_triangles(a: &[u32], b: &[u32]) -> Option<Vec<u32>> {
    if a.iter().filter(|v| b.contains(v)).count() != 2 {
        return None;
    }
    let k = (0..a.len()).find(|&k| b.contains(&a[k]) && b.contains(&a[(k + 1) % a.len()]))?;
    let l = b.iter().position(|&v| v == a[k])?;
    // The new face has the vertices of face `a` from the end of the shared edge around to its start, and then the vertices of face `b`
    // between those two.
    let first = (1..=a.len()).map(|j| a[(k + j) % a.len()]);
    let second = (1..b.len() - 1).map(|j| b[(l + j) % b.len()]);
    (b[(l + b.len() - 1) % b.len()] == a[(k + 1) % a.len()]).then(|| first.chain(second).collect())
}

fn has_inner_valence_2(mesh: &Mesh) -> bool {
    let edges = mesh.edges();
    let mut inner = vec![0; mesh.positions().len()];
    for (ends, faces) in edges.vertices.iter().zip(&edges.faces) {
        ends.iter().for_each(|&end| inner[end as usize] += if *faces == 2 { 1 } else { 100 });
    }
    inner.contains(&2)
}

/// Makes a few edges infinitely sharp, and others semi-sharp.
///
/// OpenSubdiv stores sharpness in single precision, so a mean of three sharpnesses is not exact. A rule may depend on whether such a mean
/// is slightly above 0. Therefore all creases of a mesh have the same fractional part, and at most two semi-sharp creases meet at a vertex.
fn with_creases(mesh: Mesh, random: &mut Random) -> Mesh {
    let mut soft = vec![0; mesh.positions().len()];
    let fraction = random.next_below(8) as f64 / 8.0;
    let edges = mesh.edges();
    let inner = edges.vertices.iter().zip(&edges.faces).filter(|(_, faces)| **faces == 2);
    let mut creases: Vec<([u32; 2], f64)> = Vec::new();
    for (ends, _) in inner {
        match random.next_below(8) {
            0 | 1 => creases.push((*ends, 10.0)),
            2 | 3 if ends.iter().all(|&end| soft[end as usize] < 2) => {
                ends.iter().for_each(|&end| soft[end as usize] += 1);
                creases.push((*ends, 1.0 - fraction + random.next_below(3) as f64));
            }
            _ => {}
        }
    }
    mesh.with_creases(creases).unwrap()
}
