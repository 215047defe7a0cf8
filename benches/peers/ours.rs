//! Maquette's part of the comparison with other programs (peers) in `benches/peers/peers.py`. Does one task repeatedly, on the same inputs
//! as the peers.
//!
//! `peers FOLDER WORK [INPUT]` reads the inputs from a folder, and does the task once without measuring it. It prints a number (the check)
//! that must agree with the peers' result, and perhaps a note on the result. Then it does the task once for each line on stdin, and prints the milliseconds. Each result is newly
//! allocated, and is dropped after the time is taken. To add a task, add an arm to [`repeat`] and a row to `peers.py`.

#![allow(clippy::print_stdout, reason = "the numbers go to the program that asks for them")]

use std::hint::black_box;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

use maquette::Progress;
use maquette::format::{pcd, ply};
use maquette::value::{
    Attribute, ControlNet, Faces, Handle, HandleSpace, Handles, Image, KnotVector, Mesh, Points,
    Rgb, Surface,
};
use maquette_nodes::align::{AlignMethod, align};
use maquette_nodes::clean::{Outliers, outliers, remesh, smooth};
use maquette_nodes::color::{Layout, lay_out};
use maquette_nodes::deform::{DeformOptions, Drag, Mode, ffd};
use maquette_nodes::fill::{FillMethod, HoleChoice, fill_holes};
use maquette_nodes::image::{
    Connectivity, High, Operator, Picture, Select, Space, edges, label, threshold,
};
use maquette_nodes::mesh::{Movable, Options as ReconstructOptions, Poses, reconstruct};
use maquette_nodes::range::{Axes, Unit, read_range};
use maquette_nodes::scan::Scan;
use maquette_nodes::solid::{Operation, boolean, hollow};
use maquette_nodes::subdivision::{
    Boundary, Corners, Creases, InterpolateOptions, Plan, Scattered, Scheme, Subdivision,
    interpolate, simplify, subdivide,
};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};

fn main() {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let [folder, work, input @ ..] = &arguments[..] else {
        println!("usage: peers FOLDER WORK [INPUT]; see benches/peers/peers.py");
        return;
    };
    let input = input.first().map_or("", |input| input);
    // Keep freed memory, as an evaluator does.
    maquette::memory::keep_freed();
    let pool = rayon::ThreadPoolBuilder::new().build().expect("threads");
    pool.install(|| repeat(work, input, Path::new(folder)));
}

/// Reads the inputs of the task `work`, and does the task repeatedly. `input` is the name of the input of tasks that have several.
fn repeat(work: &str, input: &str, folder: &Path) {
    match work {
        "segment" => {
            let image = image(folder, "seg_rgb", |&color| color);
            serve(
                || label(&red(&image), Connectivity::Eight),
                |labels| labels.statistics().len() as f64,
            );
        }
        "edges" => edges_above(folder, High::Level(25.0)),
        "edges-percentile" => edges_above(folder, High::Percentile(90.0)),
        "points-2" => points(folder, 2),
        "points-3" => points(folder, 3),
        "normals-2" => points_and_normals(folder, 2),
        "normals-3" => points_and_normals(folder, 3),
        "ffd-64" => deform(folder, 64, 1.0, 0.0),
        "ffd-256" => deform(folder, 256, 1.0, 0.0),
        "ffd-near" => deform(folder, 64, NARROW, 5e-8),
        "ffd-drag" => drag(folder),
        "fill" => {
            let mesh = mesh(folder, "hole");
            let (holes, method) = (HoleChoice::All, FillMethod::ThinPlate);
            // Returns the number of border edges. It is 0 if all holes are filled.
            fn open(mesh: &Mesh) -> usize {
                mesh.edges().faces.iter().filter(|&&faces| faces == 1).count()
            }
            serve(
                || fill_holes(&mesh, &holes, &method, &Progress::silent()).expect("a hole"),
                |filled| open(&filled.mesh) as f64,
            );
        }
        "union" => union(["ball", "other"].map(|name| mesh(folder, name))),
        "union-large" => union(["large_ball", "large_other"].map(|name| mesh(folder, name))),
        "hollow" => {
            let ball = mesh(folder, "ball");
            fn run(ball: &Mesh) -> Mesh {
                hollow(ball, (1.0, 0.5), &[], &Progress::silent()).expect("a solid").0
            }
            serve_with_note(|| run(&ball), |mesh| format!("{} triangles", mesh.faces().len()));
        }
        "align" => align_scans(folder),
        "unwrap" => {
            let mesh = mesh(folder, "bumpy");
            let layout = Layout::default();
            serve(
                || lay_out(&mesh, &layout, &Progress::silent()).expect("a layout"),
                |laid| laid.charts as f64,
            );
        }
        "reconstruct" => reconstruct_points(folder, "cloud", false),
        "reconstruct-normals" => reconstruct_points(folder, "cloud", true),
        "reconstruct-large" => {
            let mesh = mesh(folder, input);
            let normals = bytemuck::cast_vec(mesh.vertex_normals());
            let normals = Attribute::Vector(normals.into());
            let points = Points::new(mesh.positions().to_vec()).expect("finite places");
            let points = points.with_attribute("normal", normals).expect("one for each");
            let (sources, options) = ([Scattered::Points(points)], ReconstructOptions::default());
            serve_with_note(
                || {
                    reconstruct(&sources, Poses::Auto, &options, &Progress::silent())
                        .expect("a skin")
                },
                |mesh| format!("{}, {} triangles", off_large_torus(mesh), mesh.faces().len()),
            );
        }
        "reconstruct-clean" => reconstruct_points(folder, "cloud_clean", false),
        "remesh" => {
            let mesh = mesh(folder, "clean");
            serve(
                || remesh(&mesh, EVEN_LENGTH, 40.0, &Progress::silent()).expect("a surface"),
                |mesh| mesh.faces().len() as f64,
            );
        }
        "simplify" if input.is_empty() => coarse(&mesh(folder, "clean")),
        "simplify" => {
            let mesh = mesh(folder, input);
            let target = mesh.faces().len() / 15;
            serve_with_note(
                || simplify(&mesh, target, &Progress::silent()).expect("a surface"),
                |mesh| format!("{}, {} triangles", off_large_torus(mesh), mesh.faces().len()),
            );
        }
        "smooth" => smoothed(&mesh(folder, input), 0.0),
        "smooth-equal" => {
            let mesh = mesh(folder, input);
            smoothed(&mesh, 3.9 * mean_edge(&mesh));
        }
        "simplify-texture" => {
            let (_, uv) = open::<[f64; 2]>(folder, "clean_uv");
            let mesh = mesh(folder, "clean").with_corner("uv", Attribute::Pair(uv.into()));
            coarse(&mesh.expect("one for each corner"));
        }
        "outliers" => {
            let (_, places) = open::<[f64; 3]>(folder, "scattered");
            let points = Points::new(places.into_iter().map(Point3::from).collect::<Vec<_>>());
            let scan = Scan::Points(points.expect("finite places"));
            let by = Outliers::Spread { neighbors: 20, ratio: 2.0 };
            // The check is the sum of the indices of the remaining points. It agrees if the peers keep the same points.
            serve(
                || outliers(&scan, by, &Progress::silent()).expect("points"),
                |apart| (0..apart.len()).filter(|&k| !apart[k]).map(|k| k as f64).sum(),
            );
        }
        "read-pcd" => {
            let bytes = read(&folder.join("grid.pcd"));
            serve(|| pcd::read(&bytes).expect("a grid"), |range| range.n_valid() as f64);
        }
        "read-ply" => {
            let bytes = read(&folder.join("mesh.ply"));
            serve(|| ply::read(&bytes).expect("a mesh"), |mesh| mesh.faces().len() as f64);
        }
        "write-ply" => {
            let mesh = ply::read(&read(&folder.join("mesh.ply"))).expect("a mesh");
            serve(|| ply::encode(&mesh).expect("a file"), |_| mesh.faces().len() as f64);
        }
        "catmull-clark" => refine(folder, Scheme::CatmullClark),
        "loop" => refine(folder, Scheme::Loop),
        "doo-sabin" => refine(folder, Scheme::DooSabin),
        "catmull-clark-places" => places(folder, Scheme::CatmullClark),
        "loop-places" => places(folder, Scheme::Loop),
        "interpolate-loop" => pass_through(folder, "int_tri", Scheme::Loop),
        "interpolate-catmull-clark" => pass_through(folder, "int_quad", Scheme::CatmullClark),
        _ => println!("there is no work `{work}`"),
    }
}

/// Unites two solids.
fn union([ball, other]: [Mesh; 2]) {
    fn run(ball: &Mesh, other: &Mesh) -> Result<Mesh, maquette::Error> {
        boolean(ball, &[other], Operation::Union, &Progress::silent())
    }
    serve(|| run(&ball, &other).expect("two solids"), |united| united.faces().len() as f64);
}

/// Smooths away waves shorter than `length` mm, or than the default.
fn smoothed(mesh: &Mesh, length: f64) {
    serve_with_note(
        || smooth(mesh, length, true, &Progress::silent()).expect("a surface"),
        off_large_torus,
    );
}

fn mean_edge(mesh: &Mesh) -> f64 {
    let (points, ends) = (mesh.positions(), &mesh.edges().vertices);
    let total: f64 =
        ends.iter().map(|&[a, b]| (points[a as usize] - points[b as usize]).norm()).sum();
    total / ends.len() as f64
}

/// The root mean square distance from the torus with bumps of `make_large_torus` in `peers.py`, without its noise.
fn off_large_torus(mesh: &Mesh) -> String {
    fn off(point: &Point3<f64>) -> f64 {
        let (u, out) = (libm::atan2(point.y, point.x), libm::hypot(point.x, point.y) - 40.0);
        let v = libm::atan2(point.z, out);
        let bumps =
            1.5 * libm::sin(9.0 * u) * libm::cos(7.0 * v) + 0.2 * libm::sin(41.0 * u + 23.0 * v);
        libm::hypot(out, point.z) - 15.0 - bumps
    }
    let points = mesh.positions();
    let squares: f64 = points.iter().map(|point| off(point) * off(point)).sum();
    format!("off by {:.5} mm", (squares / points.len() as f64).sqrt())
}

/// The target length of edges for remeshing, in the unit of the mesh.
const EVEN_LENGTH: f64 = 0.06;

/// Simplifies a mesh to a tenth of its faces.
fn coarse(mesh: &Mesh) {
    let target = mesh.faces().len() / 10;
    serve(
        || simplify(mesh, target, &Progress::silent()).expect("a surface"),
        |mesh| mesh.faces().len() as f64,
    );
}

/// Does the task once, and prints its check: a number that must agree with the peers' result. Then does the task once for each line on
/// stdin, and prints the milliseconds.
fn serve<T>(run: impl Fn() -> T, check: impl Fn(&T) -> f64) {
    answer(check(&run()));
    measure_runs(run);
}

/// Like [`serve`], with a note on the result in place of the check.
fn serve_with_note<T>(run: impl Fn() -> T, note: impl Fn(&T) -> String) {
    println!("0 {}", note(&run()));
    std::io::stdout().flush().expect("the program that asks is there");
    measure_runs(run);
}

/// Does the task once for each line on stdin, and prints the milliseconds.
fn measure_runs<T>(run: impl Fn() -> T) {
    for _ in std::io::stdin().lines() {
        let start = Instant::now();
        let result = black_box(run());
        let time = start.elapsed();
        drop(result);
        answer(1e3 * time.as_secs_f64());
    }
}

fn answer(number: f64) {
    println!("{number}");
    std::io::stdout().flush().expect("the program that asks is there");
}

/// Selects the pixels whose channels all differ by at most 30 levels from (205, 62, 48), the color in `make_inputs.py`.
fn red(image: &Image) -> maquette::value::Mask {
    let [low, high] = [-30.0, 30.0].map(|step| [205.0, 62.0, 48.0].map(|c| c + step));
    threshold(image, None, &Select::Box { space: Space::Rgb, low, high }, false)
        .expect("a box fits every picture")
}

/// Finds edges with Sobel's operator. The peers' thresholds of 100 and 200 apply to sums that are eight times as large as the levels per
/// pixel that are used here. So their 200 corresponds to 25 here.
fn edges_above(folder: &Path, high: High) {
    let gray = Picture::Image(image(folder, "seg_grey", |&[level]| [level; 3]));
    serve(
        || edges(&gray, None, Operator::Sobel, 0.0, high, 0.5).expect("no mask to fit"),
        |(mask, _)| mask.count() as f64,
    );
}

/// Aligns two scans without an initial pose. The check is the root mean square distance, in mm, between the points of the second scan and
/// their right positions according to Stanford's `bun.conf`.
fn align_scans(folder: &Path) {
    fn scan(name: &str, folder: &Path) -> Scan {
        let bytes = read(&folder.join(name));
        let (range, _) = read_range(&bytes, "ply", None, Unit::M, Axes::YUp).expect("a grid");
        Scan::RangeImage(range)
    }
    let (front, side) = (scan("bun000.ply", folder), scan("bun045.ply", folder));
    // The quaternion in `bun.conf` describes the inverse rotation. In this program, y points down and z away from the sensor.
    let turn = Quaternion::new(0.955586, -0.00548449, 0.294635, 0.0038555);
    let truth = Isometry3::from_parts(
        Translation3::new(-52.0211, -0.383981, -10.9223),
        UnitQuaternion::new_normalize(turn),
    );
    let over = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let truth = (over * truth * over).to_homogeneous();
    serve(
        || {
            align(&side, &front, &AlignMethod::Features, &|_| (), &Progress::silent())
                .expect("a place")
        },
        |alignment| {
            let motion = alignment.motion(2).expect("two scans");
            let places = || side.positions().iter().filter(|place| !place.x.is_nan());
            fn alignment_error(
                place: &Point3<f64>,
                motion: &nalgebra::Matrix4<f64>,
                truth: &nalgebra::Matrix4<f64>,
            ) -> Vector3<f64> {
                motion.transform_point(place) - truth.transform_point(place)
            }
            (places()
                .map(|place| alignment_error(place, &motion, &truth).norm_squared())
                .sum::<f64>()
                / places().count() as f64)
                .sqrt()
        },
    );
}

/// The number of parameters along each side of the grid.
const GRID: usize = 2000;

fn points(folder: &Path, degree: usize) {
    let (surface, at) = (surface(folder, degree), parameters());
    serve(|| surface.grid(&at, &at), |points| points.iter().map(|point| point.coords.sum()).sum());
}

fn points_and_normals(folder: &Path, degree: usize) {
    let (surface, at) = (surface(folder, degree), parameters());
    serve(
        || surface.normal_grid(&at, &at),
        |(_, normals)| normals.iter().map(|normal| normal.sum()).sum(),
    );
}

fn parameters() -> Vec<f64> {
    (0..GRID).map(|k| k as f64 / (GRID - 1) as f64).collect()
}

fn surface(folder: &Path, degree: usize) -> Surface {
    let (shape, points) = open::<[f64; 3]>(folder, "nurbs_pts");
    let (_, weights) = open::<[f64; 1]>(folder, "nurbs_w");
    let points: Vec<_> = points.into_iter().map(Point3::from).collect();
    fn knots(count: usize, degree: usize) -> KnotVector {
        let inner = count - degree;
        KnotVector::new(
            degree,
            (0..count + degree + 1)
                .map(|k: usize| k.saturating_sub(degree).min(inner) as f64 / inner as f64)
                .collect(),
        )
        .expect("knots")
    }
    let net = ControlNet::new(shape[0], shape[1], points)
        .and_then(|net| net.with_weights(weights.into_iter().map(|[weight]| weight).collect()))
        .expect("finite points and positive weights");
    Surface::new(net, knots(shape[0], degree), knots(shape[1], degree)).expect("knots for the net")
}

/// Subdivides a mesh four times, to about 1.5 million faces.
fn refine(folder: &Path, scheme: Scheme) {
    let mesh = control_mesh(folder, scheme);
    serve(|| subdivide(&mesh, four_steps(scheme)).expect("a surface"), squares);
}

/// Subdivides a mesh four times with a plan that is made in advance, so that only the positions are computed.
fn places(folder: &Path, scheme: Scheme) {
    let mesh = control_mesh(folder, scheme);
    let plan = Plan::new(&mesh, four_steps(scheme)).expect("a surface");
    serve(|| plan.apply(&mesh).expect("a surface"), squares);
}

fn four_steps(scheme: Scheme) -> Subdivision {
    Subdivision {
        scheme,
        levels: 4,
        limit: false,
        boundary: Boundary::EdgeOnly,
        creases: Creases::OpenSubdiv,
        corners: Corners::Linear,
    }
}

/// Finds the control mesh of a surface that passes through all vertices of a mesh, to a millionth of the diagonal.
fn pass_through(folder: &Path, name: &str, scheme: Scheme) {
    let mesh = mesh(folder, name);
    let options = InterpolateOptions::default();
    let run =
        || interpolate(&mesh, scheme, &options, &[], &Progress::silent()).expect("a surface").shape;
    serve(run, squares);
}

fn control_mesh(folder: &Path, scheme: Scheme) -> Mesh {
    mesh(folder, if scheme == Scheme::Loop { "sub_tri" } else { "sub_quad" })
}

fn mesh(folder: &Path, name: &str) -> Mesh {
    let (_, points) = open::<[f64; 3]>(folder, &format!("{name}_v"));
    let (shape, corners) = open::<[u32; 1]>(folder, &format!("{name}_f"));
    let faces = Faces::uniform(shape[1], corners.into_flattened()).expect("whole faces");
    Mesh::new(points.into_iter().map(Point3::from).collect::<Vec<_>>(), faces).expect("a mesh")
}

fn squares(mesh: &Mesh) -> f64 {
    mesh.positions().iter().map(|point| point.x * point.x).sum()
}

/// The factor by which the task `ffd-near` multiplies the standard deviations of the handles. The other tasks use the factor 1.
const NARROW: f64 = 1.0 / 3.0;

fn deform(folder: &Path, count: usize, narrower: f64, accuracy: f64) {
    let (what, handles) = (cloud(folder), handles(folder, count, narrower));
    let how = DeformOptions { accuracy, ..DeformOptions::default() };
    serve(
        || {
            ffd(&what, &handles, Mode::default(), how, &Progress::silent())
                .expect("a well conditioned layout")
                .0
        },
        sum,
    );
}

/// Drags the handle with the index 21: moves its target by (0.01, 0.02, 0.03).
fn drag(folder: &Path) {
    let handles = handles(folder, 64, 1.0);
    let drag =
        Drag::new(&cloud(folder), &handles, &[21], Mode::default(), DeformOptions::default());
    let drag = drag.expect("a well conditioned layout");
    let to = [(21, handles.targets()[21] + Vector3::new(0.01, 0.02, 0.03))];
    serve(|| drag.apply_targets(&to, &Progress::silent()).expect("finite points").0, sum);
}

fn cloud(folder: &Path) -> Movable {
    let (_, points) = open::<[f64; 3]>(folder, "ffd_pts");
    let points: Vec<_> = points.into_iter().map(Point3::from).collect();
    Movable::Points(Points::new(points).expect("finite points"))
}

/// Reconstructs a surface from points, with or without their normals.
fn reconstruct_points(folder: &Path, name: &str, with_normals: bool) {
    let (_, places) = open::<[f64; 3]>(folder, name);
    let points = Points::new(places.into_iter().map(Point3::from).collect::<Vec<_>>());
    let mut points = points.expect("finite places");
    if with_normals {
        let (_, normals) = open::<[f64; 3]>(folder, "cloud_normals");
        let normals = Attribute::Vector(normals.into());
        points = points.with_attribute("normal", normals).expect("one for each");
    }
    let sources = [Scattered::Points(points)];
    let options = ReconstructOptions::default();
    serve(
        || reconstruct(&sources, Poses::Auto, &options, &Progress::silent()).expect("a skin"),
        |mesh| mesh.faces().len() as f64,
    );
}

fn handles(folder: &Path, count: usize, narrower: f64) -> Handles {
    fn list(name: &str, count: usize, folder: &Path) -> Vec<[f64; 3]> {
        open::<[f64; 3]>(folder, &format!("ffd_{name}{count}")).1
    }
    fn numbers(name: &str, count: usize, folder: &Path) -> Vec<[f64; 1]> {
        open::<[f64; 1]>(folder, &format!("ffd_{name}{count}")).1
    }
    let (at, moves, sigma, weight) = (
        list("h", count, folder),
        list("d", count, folder),
        numbers("s", count, folder),
        numbers("w", count, folder),
    );
    Handles::new(
        HandleSpace::World,
        &(0..at.len())
            .map(|k: usize| Handle {
                at: at[k],
                to: Some([0, 1, 2].map(|axis| at[k][axis] + moves[k][axis])),
                sigma: Some([sigma[k][0] * narrower; 3]),
                weight: weight[k][0],
            })
            .collect::<Vec<_>>(),
    )
    .expect("finite handles")
}

fn sum(what: &Movable) -> f64 {
    let Movable::Points(points) = what else { return f64::NAN };
    points.positions().iter().map(|point| point.coords.sum()).sum()
}

fn image<const N: usize>(folder: &Path, name: &str, color: impl Fn(&[u8; N]) -> Rgb) -> Image
where
    [u8; N]: bytemuck::Pod,
{
    let (shape, pixels) = open::<[u8; N]>(folder, name);
    Image::new(shape[1], shape[0], pixels.iter().map(color).collect::<Vec<_>>()).expect("a picture")
}

/// Reads a NumPy file (version 1, C order). Returns its shape and its items, whose type the caller must know.
fn open<T: bytemuck::Pod>(folder: &Path, name: &str) -> (Vec<usize>, Vec<T>) {
    let bytes = read(&folder.join(format!("{name}.npy")));
    let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let (header, items) = bytes[10..].split_at(length);
    let header = str::from_utf8(header).expect("a header is text");
    let (_, shape) = header.split_once("'shape': (").expect("a header has a shape");
    let (shape, _) = shape.split_once(')').expect("a shape has an end");
    let shape = shape.split(',').filter_map(|count| count.trim().parse().ok());
    (shape.collect(), bytemuck::pod_collect_to_vec(items))
}

fn read(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}
