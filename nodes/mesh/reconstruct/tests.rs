use std::collections::BTreeMap;

use maquette_value::rng::Random;
use maquette_value::{Points, RangeImage, Rgb};

use super::*;

mod boards;
mod coarse;
mod colors;
mod doubts;

/// Pseudorandom numbers with a normal distribution.
trait Noise {
    fn normal(&mut self, deviation: f64) -> f64;

    fn noise(&mut self, deviation: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal(deviation))
    }
}

impl Noise for Random {
    /// Returns a normally distributed number with the standard deviation `deviation`: Box and Muller (1958).
    fn normal(&mut self, deviation: f64) -> f64 {
        let angle = std::f64::consts::TAU * self.even();
        deviation * (-2.0 * libm::log(1.0 - self.even())).sqrt() * libm::cos(angle)
    }
}

/// Returns uniformly distributed points of a sphere of radius 50 mm, moved along each axis by noise with the given deviation.
fn sphere(count: usize, deviation: f64) -> Vec<Point3<f64>> {
    let mut random = Random(1);
    fn direction(random: &mut Random) -> Vector3<f64> {
        random.noise(1.0).normalize()
    }
    (0..count)
        .map(|_| Point3::from(direction(&mut random) * 50.0 + random.noise(deviation)))
        .collect()
}

/// Returns uniformly distributed points of a torus around y with radii of 40 and 15 mm, moved along each axis by noise with the given
/// deviation.
fn torus(count: usize, deviation: f64) -> Vec<Point3<f64>> {
    let mut random = Random(2);
    let mut points = Vec::new();
    while points.len() < count {
        let [u, v] = [0, 1].map(|_| std::f64::consts::TAU * random.even());
        // Accept angles with a density that is proportional to the area of the torus there.
        if random.even() * 55.0 < 40.0 + 15.0 * libm::cos(v) {
            let r = 40.0 + 15.0 * libm::cos(v);
            let at = Vector3::new(r * libm::cos(u), 15.0 * libm::sin(v), r * libm::sin(u));
            points.push(Point3::from(at + random.noise(deviation)));
        }
    }
    points
}

fn off_torus(point: &Point3<f64>) -> f64 {
    let out = (point.x * point.x + point.z * point.z).sqrt() - 40.0;
    (out * out + point.y * point.y).sqrt() - 15.0
}

fn off_sphere(point: &Point3<f64>) -> f64 {
    point.coords.norm() - 50.0
}

fn cloud(points: Vec<Point3<f64>>) -> Scattered {
    Scattered::Points(Points::new(points).unwrap())
}

fn skin(points: Vec<Point3<f64>>, options: &Options) -> Mesh {
    reconstruct(&[cloud(points)], Poses::Auto, options, &Progress::silent()).unwrap()
}

fn rms(mesh: &Mesh, off: impl Fn(&Point3<f64>) -> f64) -> f64 {
    let squares: f64 = mesh.positions().iter().map(|point| off(point) * off(point)).sum();
    (squares / mesh.positions().len() as f64).sqrt()
}

/// Returns the Euler characteristic and the number of border edges of a mesh. Checks that all edges have one or two faces and that each
/// vertex has one fan of faces.
fn topology(mesh: &Mesh) -> (i64, usize) {
    let mut sides: BTreeMap<[u32; 2], [usize; 2]> = BTreeMap::new();
    let mut next: BTreeMap<u32, BTreeMap<u32, u32>> = BTreeMap::new();
    for face in mesh.faces().iter() {
        for k in 0..face.len() {
            let [last, at, then] = [0, 1, 2].map(|i| face[(k + i) % face.len()]);
            sides.entry([at.min(then), at.max(then)]).or_default()[usize::from(at < then)] += 1;
            assert_eq!(next.entry(at).or_default().insert(then, last), None, "twice a way");
        }
    }
    assert!(sides.values().all(|&[a, b]| a <= 1 && b <= 1), "edges have one face on each side");
    for ways in next.values() {
        // Begin at the border edge without a predecessor, or at any edge of a closed fan.
        let first = ways.keys().find(|&way| !ways.values().any(|to| to == way));
        let mut at = *first.unwrap_or_else(|| ways.keys().next().unwrap());
        let mut seen = 0;
        while let Some(&to) = ways.get(&at) {
            seen += 1;
            at = to;
            if seen == ways.len() {
                break;
            }
        }
        assert_eq!(seen, ways.len(), "a vertex has one fan of faces");
    }
    let borders = sides.values().filter(|sides| **sides != [1, 1]).count();
    let euler = next.len() as i64 - sides.len() as i64 + mesh.faces().len() as i64;
    assert_eq!(next.len(), mesh.positions().len(), "all vertices have faces");
    (euler, borders)
}

fn volume(mesh: &Mesh) -> f64 {
    mesh.faces()
        .iter()
        .map(|face| {
            fn edge(k: usize, mesh: &Mesh, face: &[u32]) -> Vector3<f64> {
                mesh.positions()[face[k] as usize].coords
            }
            (1..face.len() - 1)
                .map(|k| {
                    edge(0, mesh, face).dot(&edge(k, mesh, face).cross(&edge(k + 1, mesh, face)))
                })
                .sum::<f64>()
                / 6.0
        })
        .sum()
}

/// Returns the smallest angle of each triangle in degrees, sorted.
fn smallest_angles(mesh: &Mesh) -> Vec<f64> {
    let mut angles: Vec<f64> = mesh
        .faces()
        .iter()
        .map(|face| {
            fn corner(k: usize, mesh: &Mesh, face: &[u32]) -> Point3<f64> {
                mesh.positions()[face[k % 3] as usize]
            }
            (0..3)
                .map(|k: usize| {
                    (corner(k + 1, mesh, face) - corner(k, mesh, face))
                        .angle(&(corner(k + 2, mesh, face) - corner(k, mesh, face)))
                        .to_degrees()
                })
                .fold(f64::INFINITY, f64::min)
        })
        .collect();
    angles.sort_by(f64::total_cmp);
    angles
}

/// Returns the mean spacing of points: the side of the square that each point represents.
fn distance_on(area: f64, count: usize) -> f64 {
    (area / count as f64).sqrt()
}

const SPHERE: f64 = 4.0 * std::f64::consts::PI * 2500.0;
const TORUS: f64 = 4.0 * std::f64::consts::PI * std::f64::consts::PI * 600.0;

#[test]
fn noise_of_a_hundredth_is_averaged_to_half_the_distance_of_points() {
    let count = 100_000;
    // The noise has a standard deviation of a hundredth of the diagonal of the bounding box, which is three times the spacing of the
    // points.
    let mesh = skin(sphere(count, 1.73), &Options::default());
    assert_eq!(topology(&mesh), (2, 0));
    assert!(rms(&mesh, off_sphere) < 0.5 * distance_on(SPHERE, count));
    let mesh = skin(torus(count, 1.58), &Options::default());
    assert_eq!(topology(&mesh), (0, 0));
    assert!(rms(&mesh, off_torus) < 0.5 * distance_on(TORUS, count));
}

#[test]
fn a_clean_cloud_is_met_to_a_tenth_of_the_distance_by_even_triangles() {
    let count = 8000;
    let mesh = skin(torus(count, 0.0), &Options::default());
    assert_eq!(topology(&mesh), (0, 0));
    assert!(rms(&mesh, off_torus) < 0.1 * distance_on(TORUS, count));
    let volume_of_torus = TORUS / 2.0 * 15.0;
    assert!((volume(&mesh) / volume_of_torus - 1.0).abs() < 0.02, "{}", volume(&mesh));
    let angles = smallest_angles(&mesh);
    assert!(angles[0] > 15.0 && angles[angles.len() / 100] > 30.0, "{angles:?}");
}

#[test]
fn the_outside_is_found_for_each_of_several_parts() {
    let mut points = sphere(4000, 0.0);
    let small = points.iter().map(|point| point * 0.4 + Vector3::new(90.0, 0.0, 0.0));
    points.extend(small.collect::<Vec<_>>());
    let mesh = skin(points, &Options::default());
    assert_eq!(topology(&mesh), (4, 0));
    let both = 4.0 / 3.0 * std::f64::consts::PI * (125_000.0 + 8000.0);
    assert!((volume(&mesh) / both - 1.0).abs() < 0.02, "{}", volume(&mesh));
}

#[test]
fn given_normals_decide_what_is_outside() {
    let points = sphere(3000, 0.0);
    let inwards = points.iter().map(|point| (-point.coords.normalize()).into()).collect::<Vec<_>>();
    let cloud = Points::new(points).unwrap();
    let cloud = cloud.with_attribute("normal", Attribute::Vector(inwards.into())).unwrap();
    fn reconstruct_with(normals: Normals, cloud: &Points) -> Mesh {
        let options = Options { normals, skin: SkinKind::Open, ..Options::default() };
        let sources = [Scattered::Points(cloud.clone())];
        reconstruct(&sources, Poses::Auto, &options, &Progress::silent()).unwrap()
    }
    assert!(volume(&reconstruct_with(Normals::Given, &cloud)) < 0.0);
    assert!(volume(&reconstruct_with(Normals::Estimated, &cloud)) > 0.0);
}

#[test]
fn an_open_cloud_gets_an_open_surface_or_a_closed_one_with_a_flag() {
    let cap: Vec<_> = sphere(8000, 0.0).into_iter().filter(|point| point.z > 0.0).collect();
    let open = skin(cap.clone(), &Options { skin: SkinKind::Open, ..Options::default() });
    let (euler, borders) = topology(&open);
    assert_eq!(euler, 1);
    assert!(borders > 20);
    assert!(open.positions().iter().all(|point| point.z > -6.0));
    let closed = skin(cap, &Options::default());
    assert_eq!(topology(&closed), (2, 0));
    let Some(Attribute::Flag(filled)) = closed.vertex().get("filled") else {
        panic!("nothing is flagged")
    };
    let share = filled.iter().filter(|&&flag| flag == 1).count() as f64 / filled.len() as f64;
    assert!(0.1 < share && share < 0.6, "{share}");
}

#[test]
fn a_flat_cloud_gets_an_open_surface() {
    let mut random = Random(3);
    let points: Vec<_> =
        (0..2000).map(|_| Point3::new(random.even(), random.even(), 0.0) * 10.0).collect();
    let mesh = skin(points, &Options { skin: SkinKind::Open, ..Options::default() });
    assert_eq!(topology(&mesh).0, 1);
    // At its border, the surface deviates from the plane by at most the spacing of the points.
    let most = mesh.positions().iter().map(|point| point.z.abs()).fold(0.0, f64::max);
    assert!(most < 0.224, "{most}");
    let mut inner = mesh
        .positions()
        .iter()
        .filter(|point| [point.x, point.y].iter().all(|x| 1.1 < *x && *x < 8.9));
    assert!(inner.all(|point| point.z.abs() < 0.05));
}

#[test]
fn points_that_are_there_several_times_change_little() {
    let points = sphere(2000, 0.0);
    let mesh = skin([points.clone(), points.clone(), points].concat(), &Options::default());
    assert_eq!(topology(&mesh), (2, 0));
    assert!(rms(&mesh, off_sphere) < 0.3);
}

#[test]
fn a_large_spacing_makes_a_control_mesh_of_quads() {
    let options = Options { spacing: 15.0, faces: FaceKind::Quads, ..Options::default() };
    let mesh = skin(sphere(5000, 0.0), &options);
    assert_eq!(topology(&mesh), (2, 0));
    assert_eq!(mesh.faces().sides(), Some(4));
    assert!(mesh.faces().len() < 400, "{}", mesh.faces().len());
    assert!(rms(&mesh, off_sphere) < 1.5, "{}", rms(&mesh, off_sphere));
}

#[test]
fn a_range_image_shows_its_outside_to_the_sensor() {
    // The surface is a bowl that opens towards the sensor, so the fronts of its outermost parts face inward.
    let range = RangeImage::new(
        60,
        60,
        (0..3600)
            .map(|cell: usize| {
                let (x, y) = ((cell % 60) as f64 - 29.5, (cell / 60) as f64 - 29.5);
                match (900.0 - x * x - y * y).sqrt() {
                    depth if depth.is_nan() => Point3::new(f64::NAN, 0.0, 0.0),
                    depth => Point3::new(x, y, 200.0 + depth),
                }
            })
            .collect(),
    )
    .unwrap();
    let options = Options { skin: SkinKind::Open, ..Options::default() };
    let sources = [Scattered::RangeImage(range)];
    let mesh = reconstruct(&sources, Poses::Auto, &options, &Progress::silent()).unwrap();
    assert!(mesh.frame().is_some());
    let towards = mesh.faces().iter().filter(|face| mesh.area_vector(face).z < 0.0).count();
    assert!(towards as f64 > 0.95 * mesh.faces().len() as f64);
}

#[test]
fn colors_are_those_of_the_points() {
    let points = sphere(3000, 0.0);
    fn color(point: &Point3<f64>) -> [u8; 3] {
        if point.x > 0.0 { [200, 0, 0] } else { [0, 0, 200] }
    }
    let colors: Vec<Rgb> = points.iter().map(color).collect();
    let cloud = Points::new(points).unwrap();
    let cloud = cloud.with_attribute("color", Attribute::Color(colors.into())).unwrap();
    let options = Options::default();
    let sources = [Scattered::Points(cloud)];
    let mesh = reconstruct(&sources, Poses::Auto, &options, &Progress::silent()).unwrap();
    let colors = mesh.vertex().colors("color").unwrap();
    for (point, found) in mesh.positions().iter().zip(&**colors) {
        assert!(point.x.abs() < 10.0 || *found == color(point), "{point} {found:?}");
    }
}

#[test]
fn clouds_without_a_surface_are_errors() {
    fn error(points: Vec<Point3<f64>>, options: &Options) -> String {
        let found = reconstruct(&[cloud(points)], Poses::Auto, options, &Progress::silent());
        found.unwrap_err().to_string()
    }
    let options = Options::default();
    let few = "there are only 1 different points, but a surface needs at least 4";
    assert_eq!(error(vec![Point3::new(1.0, 2.0, 3.0); 9], &options), few);
    assert!(error(Vec::new(), &options).starts_with("there are only 0"));
    let line = (0..50).map(|k: i32| Point3::from(Vector3::new(1.0, 2.0, 3.0) * f64::from(k)));
    assert!(error(line.collect(), &options).contains("line"));
    let plane = (0..49).map(|k: i32| Point3::new(f64::from(k % 7), f64::from(k / 7), 5.0));
    assert!(error(plane.collect(), &options).contains("plane"));
    let far = (0..9).map(|k: i32| Point3::new(1e300 * f64::from(k), 1.0, f64::from(k * k)));
    assert!(error(far.collect(), &options).contains("too far"));
    let corners = (0..8).map(|k: i32| Point3::from([k & 1, k >> 1 & 1, k >> 2].map(f64::from)));
    assert!(error(corners.collect(), &options).contains("too few to show"));
    let tiny = Options { spacing: 1e-9, ..options };
    assert!(error(sphere(100, 0.0), &tiny).contains("cells along a side"));
    for spacing in [f64::NAN, -1.0, f64::INFINITY] {
        assert!(error(sphere(100, 0.0), &Options { spacing, ..options }).contains("`spacing`"));
    }
    let apply =
        reconstruct(&[cloud(sphere(100, 0.0))], Poses::Apply, &options, &Progress::silent());
    assert!(apply.unwrap_err().to_string().contains("no pose"));
}

#[test]
fn any_number_of_threads_makes_the_same() {
    fn reconstruct_on(threads: usize) -> Mesh {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| skin(torus(6000, 0.3), &Options::default()))
    }
    assert_eq!(reconstruct_on(1), reconstruct_on(3));
}

#[test]
fn the_surface_of_any_function_is_manifold() {
    for seed in 0..20 {
        let mut random = Random(seed);
        let depth = 3;
        let cube = Cube { corner: Point3::origin(), edge: 1.0, depth };
        let grids = (0..=depth).map(|depth| {
            let nodes = cells::Places::full((1 << depth) + 1);
            let last = 1 << depth;
            fn is_border(node: usize, nodes: &cells::Places, last: i32) -> bool {
                nodes.place(node).iter().any(|&x| x == 0 || x == last)
            }
            let values = (0..nodes.len())
                .map(|node| if is_border(node, &nodes, last) { 0.0 } else { random.even() })
                .collect();
            poisson::Grid { nodes, values }
        });
        let field = Field { cube, grids: grids.collect() };
        let skin = contour(&field, depth, &Progress::silent()).unwrap();
        let mesh = Mesh::new(skin.positions.clone(), skin.faces(true).unwrap());
        assert_eq!(topology(&mesh.unwrap()).1, 0);
    }
}

#[test]
fn points_count_as_much_as_they_are_sure() {
    // One scan of the sphere is exact; the radius of the other one is 2 mm too large.
    let good = sphere(20_000, 0.0);
    let wrong = sphere(20_000, 0.0).into_iter().map(|it| Point3::from(it.coords * 1.04));
    let both = [good, wrong.collect()].concat();
    let options = Options { spacing: 4.0, ..Options::default() };
    let radius = |weights: Option<[f64; 2]>| {
        let mut points = Points::new(both.clone()).unwrap();
        if let Some(weights) = weights {
            let column = weights.iter().flat_map(|&weight| vec![weight; 20_000]).collect();
            points = points.with_attribute("confidence", Attribute::Number(column)).unwrap();
        }
        let sources = [Scattered::Points(points)];
        let skin = reconstruct(&sources, Poses::Ignore, &options, &Progress::silent()).unwrap();
        let radii = skin.positions().iter().map(|it| it.coords.norm());
        radii.sum::<f64>() / skin.positions().len() as f64
    };
    let [even, first, second, odd] =
        [None, Some([1.0, 0.01]), Some([0.02, 2.0]), Some([f64::NAN, 1.0])].map(radius);
    assert!((even - 51.0).abs() < 0.2, "{even}");
    assert!((first - 50.0).abs() < 0.2, "{first}");
    assert!((second - 52.0).abs() < 0.2 && (odd - 52.0).abs() < 0.2, "{second} {odd}");
    assert_eq!(radius(Some([3.0; 2])), even);
}
