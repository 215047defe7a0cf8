//! Where filled triangles run through each other or through the data, decided without rounding.

use maquette::{Cancelled, Progress};
use nalgebra::Point3;
use rayon::prelude::*;
use robust::{Coord, Coord3D, orient2d, orient3d};

use super::filling::Filling;

#[derive(Clone, Copy)]
struct Triangle {
    vertices: [u32; 3],
    low: Point3<f64>,
    high: Point3<f64>,
    face: u32,
}

/// Faces that one task bounds.
const FACES: usize = 4096;

/// The filled faces that meet another face in more than the vertices and the edge that they share, ascending.
///
/// # Errors
/// If the evaluation is told to stop.
pub(super) fn intersecting(
    filling: &Filling,
    progress: &Progress<'_>,
) -> Result<Vec<u32>, Cancelled> {
    let boxed = |(face, &vertices): (usize, &[u32; 3])| {
        let [a, b, c] = vertices.map(|vertex| filling.points[vertex as usize]);
        Triangle { vertices, low: a.inf(&b).inf(&c), high: a.sup(&b).sup(&c), face: face as u32 }
    };
    let filled = filling.faces.iter().enumerate().skip(filling.kept).map(boxed);
    let Some(around) = filled
        .map(|triangle| (triangle.low, triangle.high))
        .reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)))
    else {
        return Ok(Vec::new());
    };
    let all = filling.faces.par_iter().with_min_len(FACES).enumerate().map(boxed);
    let triangles: Vec<Triangle> = all.filter(|triangle| overlap(triangle, around)).collect();
    let (strips, axis) = strips(triangles, around);
    let found: Vec<Vec<[u32; 2]>> = strips
        .into_par_iter()
        .map(|strip| {
            progress.check()?;
            Ok(pairs(filling, strip, axis))
        })
        .collect::<Result<_, Cancelled>>()?;
    let faces = found.into_iter().flatten().flatten();
    let mut faces: Vec<u32> = faces.filter(|&face| filling.kept <= face as usize).collect();
    faces.sort_unstable();
    faces.dedup();
    Ok(faces)
}

/// How many triangles wide strips are, about: in narrower ones most triangles lie in two, in wider ones too many are compared.
const WIDE: f64 = 4.0;

/// Triangles cut into strips along the longest side of the box around the filled part, each triangle in all strips that it reaches; and
/// the axis along which they run.
fn strips(
    triangles: Vec<Triangle>,
    (low, high): (Point3<f64>, Point3<f64>),
) -> (Vec<Vec<Triangle>>, usize) {
    let size = high - low;
    let along = size.imax();
    let [one, other] = [(along + 1) % 3, (along + 2) % 3];
    let across = if size[one] < size[other] { other } else { one };
    let count = ((triangles.len() as f64).sqrt() / WIDE) as usize + 1;
    let strip = |place: f64| {
        // What is no number is in the first one, what lies outside in the nearest.
        ((place - low[across]) / size[across] * count as f64).clamp(0.0, (count - 1) as f64)
            as usize
    };
    let mut strips = vec![Vec::new(); count];
    for triangle in triangles {
        for strip in &mut strips[strip(triangle.low[across])..=strip(triangle.high[across])] {
            strip.push(triangle);
        }
    }
    (strips, along)
}

/// The pairs of faces in a strip that meet.
fn pairs(filling: &Filling, mut strip: Vec<Triangle>, axis: usize) -> Vec<[u32; 2]> {
    strip.sort_unstable_by(|a, b| a.low[axis].total_cmp(&b.low[axis]).then(a.face.cmp(&b.face)));
    let is_filled = |triangle: &Triangle| filling.kept <= triangle.face as usize;
    let mut pairs = Vec::new();
    for (index, a) in strip.iter().enumerate() {
        let behind = strip[index + 1..].iter();
        for b in behind.take_while(|b| b.low[axis] <= a.high[axis]) {
            if (is_filled(a) || is_filled(b))
                && overlap(b, (a.low, a.high))
                && meet(filling, a.vertices, b.vertices)
            {
                pairs.push([a.face, b.face]);
            }
        }
    }
    pairs
}

fn overlap(triangle: &Triangle, (low, high): (Point3<f64>, Point3<f64>)) -> bool {
    (0..3).all(|k| triangle.low[k] <= high[k] && low[k] <= triangle.high[k])
}

/// Whether two triangles have more in common than the vertices and the edge that they share.
fn meet(filling: &Filling, a: [u32; 3], b: [u32; 3]) -> bool {
    let place = |vertex: u32| filling.points[vertex as usize];
    let shared = a.iter().filter(|vertex| b.contains(vertex)).count();
    match shared {
        0 => {
            let edges = |face: [u32; 3]| [0, 1, 2].map(|k| [face[k], face[(k + 1) % 3]].map(place));
            let (on_a, on_b) = (a.map(place), b.map(place));
            edges(a).into_iter().any(|edge| pierces(edge, on_b))
                || edges(b).into_iter().any(|edge| pierces(edge, on_a))
                || overlap_in_plane(on_a, on_b)
        }
        1 => {
            let opposite = |face: [u32; 3], other: [u32; 3]| {
                let k = (0..3).find(|&k| other.contains(&face[k])).unwrap_or(0);
                [face[(k + 1) % 3], face[(k + 2) % 3]].map(place)
            };
            pierces(opposite(a, b), b.map(place)) || pierces(opposite(b, a), a.map(place))
        }
        2 => is_folded(a, b, place),
        _ => true,
    }
}

fn side([a, b, c]: [Point3<f64>; 3], p: Point3<f64>) -> f64 {
    let coord = |p: Point3<f64>| Coord3D { x: p.x, y: p.y, z: p.z };
    orient3d(coord(a), coord(b), coord(c), coord(p))
}

/// Whether a line runs through a triangle: its ends lie on different sides, and it passes all three edges on one.
fn pierces([p, q]: [Point3<f64>; 2], triangle: [Point3<f64>; 3]) -> bool {
    let (from, to) = (side(triangle, p), side(triangle, q));
    if !((from > 0.0 && to < 0.0) || (from < 0.0 && to > 0.0)) {
        return false;
    }
    let [a, b, c] = triangle;
    let sides = [[a, b], [b, c], [c, a]].map(|[from, to]| side([p, q, from], to));
    sides.iter().all(|&side| side >= 0.0) || sides.iter().all(|&side| side <= 0.0)
}

/// The coordinates of points without the one in which their triangle is seen edge-on.
fn flattened<const N: usize>(points: [Point3<f64>; N], drop: usize) -> [Coord<f64>; N] {
    points.map(|point| Coord { x: point[(drop + 1) % 3], y: point[(drop + 2) % 3] })
}

/// The axis along which a triangle is seen best.
fn best_axis([a, b, c]: [Point3<f64>; 3]) -> usize {
    (b - a).cross(&(c - a)).iamax()
}

/// Whether two triangles lie in one plane and cross there.
fn overlap_in_plane(a: [Point3<f64>; 3], b: [Point3<f64>; 3]) -> bool {
    if b.iter().any(|&corner| side(a, corner) != 0.0) {
        return false;
    }
    let drop = best_axis(a);
    let (a, b) = (flattened(a, drop), flattened(b, drop));
    let cross = |[p, q]: [Coord<f64>; 2], [r, s]: [Coord<f64>; 2]| {
        orient2d(p, q, r) * orient2d(p, q, s) < 0.0 && orient2d(r, s, p) * orient2d(r, s, q) < 0.0
    };
    let edges = |t: [Coord<f64>; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let within = |p: Coord<f64>, t: [Coord<f64>; 3]| {
        let sides = edges(t).map(|[from, to]| orient2d(from, to, p));
        sides.iter().all(|&side| side > 0.0) || sides.iter().all(|&side| side < 0.0)
    };
    edges(a).into_iter().any(|edge| edges(b).into_iter().any(|other| cross(edge, other)))
        || within(a[0], b)
        || within(b[0], a)
}

/// Whether two triangles at one edge lie in one plane, on the same side of the edge.
fn is_folded(a: [u32; 3], b: [u32; 3], place: impl Fn(u32) -> Point3<f64>) -> bool {
    let apex = |face: [u32; 3], other: [u32; 3]| {
        face.into_iter().find(|vertex| !other.contains(vertex)).unwrap_or(face[0])
    };
    let (p, q) = (place(apex(a, b)), place(apex(b, a)));
    let corners = a.map(&place);
    if side(corners, q) != 0.0 {
        return false;
    }
    let ends: Vec<Point3<f64>> =
        a.into_iter().filter(|vertex| b.contains(vertex)).map(&place).collect();
    let [u, v, p, q] = flattened([ends[0], ends[1], p, q], best_axis(corners));
    orient2d(u, v, p) * orient2d(u, v, q) > 0.0
}
