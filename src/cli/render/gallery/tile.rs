//! The picture of a graph: its result, and beside it what it was made from, if both can be compared.

use maquette_engine::session::{Run, Session, Targets};
use maquette_graph::Graph;
use maquette_render::{Aim, BackFaces, View, render};
use maquette_value::{AnyValue, Attribute, Faces, Image, Mesh, RangeImage, Rgb, TriangleTree};
use nalgebra::{Point3, Vector3};

use crate::report;

/// The width and height of one view in pixels. At this size several pictures fit side by side, and a file has some tens of kilobytes.
const SIZE: [usize; 2] = [320, 240];

/// The angles by which the camera is to the right of the surface that it looks at and above it, in degrees. They show depth.
const BESIDE: [f64; 2] = [25.0, 10.0];

/// A face has changed if it is farther from the old surface than this fraction of the diagonal, and than this fraction of the largest
/// distance.
const CHANGED: f64 = 0.002;
const MAINLY_CHANGED: f64 = 0.25;

/// A change of at most this size, relative to the whole, is shown from near. The picture contains this multiple of it.
const LOCAL: f64 = 0.5;
const SURROUNDINGS: f64 = 2.0;

/// Surfaces whose sizes differ by more than this factor are not compared.
const MAX_GROWTH: f64 = 1.5;

/// Draws the first output of a graph that has faces. If its shape was changed, the mesh or range image that it was made from is drawn at
/// its left, by the same camera, which looks at the change.
pub(super) fn draw(graph: &Graph, session: &mut Session) -> Option<Image> {
    let source = source_names(graph);
    let targets = graph.output_names().map(str::to_owned).chain(source.iter().cloned()).collect();
    let finished = session
        .run(graph, &Run { targets: Targets::Named(targets), ..Run::default() })
        .inspect_err(|diagnostics| report(diagnostics))
        .ok()?;
    report(&finished.diagnostics());
    let after =
        graph.output_names().filter_map(|name| finished.value(name)).find_map(AnyValue::as_mesh)?;
    let compared = source.iter().filter_map(|name| surface(finished.value(name)?)).find_map(|it| {
        let change = Change::new(&it, &after)?;
        Some((it, change))
    });
    let [yaw, pitch] = BESIDE;
    let view = View { size: SIZE, yaw, pitch, back_faces: BackFaces::Neutral, ..View::front() };
    let Some((before, change)) = compared else { return Some(render(&after, &view)) };
    let view = change.look(view);
    Some(side_by_side(&[&textured(before, &after), &after].map(|mesh| render(mesh, &view))))
}

/// Gives a surface the picture of another one, if it has texture coordinates only.
fn textured(mesh: Mesh, other: &Mesh) -> Mesh {
    match mesh.vertex().pairs("uv") {
        Some(_) if mesh.materials().is_empty() => mesh.with_materials(other.materials().clone()),
        _ => mesh,
    }
}

/// Returns the names of the values from which the first output was made, the oldest first: those at the first input of each node.
fn source_names(graph: &Graph) -> Vec<String> {
    let mut names = Vec::new();
    let mut node = graph.outputs().first().map(|output| output.node);
    while let Some(link) = node.and_then(|node| graph.nodes()[node].links.first()) {
        let source = &graph.nodes()[link.node];
        names.push(format!("{}.{}", source.name, source.outputs[link.output]));
        node = Some(link.node);
    }
    names.reverse();
    names
}

/// Returns the surface of a mesh or a range image.
fn surface(value: &AnyValue) -> Option<Mesh> {
    value.as_mesh().or_else(|| grid_surface(value.get::<RangeImage>()?))
}

/// Joins neighboring cells of a range image to triangles, except across jumps of more than six median spacings.
fn grid_surface(range: &RangeImage) -> Option<Mesh> {
    const MAX_JUMP: f64 = 6.0;
    let (width, count) = (range.width(), range.points().len());
    let quads = (0..count.saturating_sub(width)).filter(|cell| (cell + 1) % width != 0);
    let triangles: Vec<([usize; 3], f64)> = quads
        .map(|cell| [cell, cell + width, cell + width + 1, cell + 1])
        .flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]])
        .filter_map(|triangle| Some((triangle, longest_side(range, triangle)?)))
        .collect();
    let mut sides: Vec<f64> = triangles.iter().map(|(_, side)| *side).collect();
    sides.sort_unstable_by(f64::total_cmp);
    let limit = MAX_JUMP * sides.get(sides.len() / 2)?;
    let near = triangles.iter().filter(|(_, side)| *side < limit);
    let faces = near.map(|(triangle, _)| triangle.map(|cell| cell as u32)).collect();
    // Cells without a point have no face; they get any other point, which does not change the bounding box.
    let any = range.point(triangles.first()?.0[0])?;
    let points: Vec<_> = (0..count).map(|cell| range.point(cell).unwrap_or(any)).collect();
    let map = range.registration();
    let uv =
        (0..count).map(|cell| map.uv_from_range([cell % width, cell / width].map(|k| k as f64)));
    let mesh = Mesh::new(points, Faces::triangles(faces)).ok()?;
    let mesh = mesh.with_vertex("uv", Attribute::Pair(uv.collect::<Vec<_>>().into())).ok()?;
    Some(mesh.with_frame(range.capture_frame().ok()))
}

/// Returns the length of the longest side of a triangle of cells. `None` if a cell has no point.
fn longest_side(range: &RangeImage, triangle: [usize; 3]) -> Option<f64> {
    let [a, b, c] = triangle.map(|cell| range.point(cell));
    let (a, b, c) = (a?, b?, c?);
    Some((b - a).norm().max((c - b).norm()).max((a - c).norm()))
}

/// The part of a surface that was changed.
struct Change {
    /// The mean of the normals of the changed faces, weighted by area, in the axes of a viewer: x right, y up, z towards the viewer.
    normal: Vector3<f64>,
    /// The surroundings of the change; `None` if the whole surface was changed.
    aim: Option<Aim>,
}

impl Change {
    /// Compares two surfaces. Returns `None` if nothing was changed, or if the axes or the sizes of the surfaces differ.
    fn new(before: &Mesh, after: &Mesh) -> Option<Self> {
        let [size, size_before] =
            [after, before].map(|it| it.bounds().map_or(0.0, |(low, high)| (high - low).norm()));
        let growth = size / size_before;
        if before.frame().is_some() != after.frame().is_some()
            || !(1.0 / MAX_GROWTH..MAX_GROWTH).contains(&growth)
        {
            return None;
        }
        let triangles: Vec<[Point3<f64>; 3]> = after
            .triangle_corners()
            .into_iter()
            .map(|it| it.map(|corner| after.faces().corners()[corner as usize]))
            .map(|it| it.map(|vertex| after.positions()[vertex as usize]))
            .collect();
        let centers: Vec<_> = triangles
            .iter()
            .map(|[a, b, c]| Point3::from((a.coords + b.coords + c.coords) / 3.0))
            .collect();
        let nearest = TriangleTree::new(before).nearest_to_all(&centers);
        let distances: Vec<f64> =
            nearest.iter().map(|it| it.map_or(0.0, |it| it.distance_sq.sqrt())).collect();
        let farthest = distances.iter().copied().fold(0.0, f64::max);
        let limit = (CHANGED * size).max(MAINLY_CHANGED * farthest);
        let changed: Vec<_> = triangles
            .iter()
            .zip(&distances)
            .filter_map(|(triangle, distance)| (*distance > limit).then_some(triangle))
            .collect();
        let (low, high) = maquette_value::bounds(changed.iter().copied().flatten())?;
        let areas = changed.iter().map(|[a, b, c]| (b - a).cross(&(c - a)));
        let mut normal = areas.sum::<Vector3<f64>>();
        if after.frame().is_some() {
            (normal.y, normal.z) = (-normal.y, -normal.z);
        }
        let beyond = (high - low) * ((SURROUNDINGS - 1.0) / 2.0);
        let is_local = (high - low).norm() < LOCAL * size;
        let aim = is_local.then_some(Aim::Box(low - beyond, high + beyond));
        Some(Self { normal, aim })
    }

    /// Turns the camera towards the change, slightly from beside.
    fn look(&self, view: View) -> View {
        const MAX_PITCH: f64 = 50.0;
        if self.aim.is_none() {
            return view;
        }
        let [x, y, z]: [f64; 3] = self.normal.into();
        let yaw = libm::atan2(x, z).to_degrees() + BESIDE[0];
        let pitch = libm::atan2(y, libm::hypot(x, z)).to_degrees() + BESIDE[1];
        let pitch = pitch.clamp(-MAX_PITCH, MAX_PITCH);
        View { yaw: yaw.round(), pitch: pitch.round(), aim: self.aim, ..view }
    }
}

/// Joins two pictures of equal size.
fn side_by_side([left, right]: &[Image; 2]) -> Image {
    let [width, height] = SIZE;
    let rows = left.pixels().chunks_exact(width).zip(right.pixels().chunks_exact(width));
    let pixels: Vec<Rgb> =
        rows.flat_map(|(left, right)| left.iter().chain(right)).copied().collect();
    Image::new(2 * width, height, pixels).expect("the pixels of both pictures")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Creates a sheet of 20 by 20 cells of 1 mm in the plane z = 0, with a bump of `height` mm at (5, 5).
    fn sheet(height: f64) -> Mesh {
        let positions = (0..441).map(|k| {
            let [x, y] = [k % 21, k / 21].map(f64::from);
            let square = (x - 5.0) * (x - 5.0) + (y - 5.0) * (y - 5.0);
            Point3::new(x, y, height * (1.0 - square / 9.0).max(0.0))
        });
        let cells = (0..400).map(|k| k / 20 * 21 + k % 20);
        let faces = cells.flat_map(|a| [[a, a + 1, a + 22], [a, a + 22, a + 21]]);
        Mesh::new(positions.collect::<Vec<_>>(), Faces::triangles(faces.collect())).unwrap()
    }

    #[test]
    fn the_camera_looks_at_what_was_changed() {
        assert!(Change::new(&sheet(0.0), &sheet(0.0)).is_none());
        let look = Change::new(&sheet(0.0), &sheet(2.0)).unwrap().look(View::front());
        assert_eq!([look.yaw, look.pitch], BESIDE);
        let Some(Aim::Box(low, high)) = look.aim else { panic!("no aim") };
        let middle = nalgebra::center(&low, &high);
        assert!((middle.x - 5.0).abs() < 1.0 && (middle.y - 5.0).abs() < 1.0, "{middle}");
        assert!(high.x - low.x < 15.0, "{low} {high}");
    }

    #[test]
    fn a_change_of_everything_and_another_size_are_shown_whole() {
        let moved = sheet(0.0).with_positions(
            sheet(0.0).positions().iter().map(|p| Point3::new(p.x, p.y, 3.0)).collect::<Vec<_>>(),
        );
        assert_eq!(Change::new(&sheet(0.0), &moved.unwrap()).unwrap().aim, None);
        let larger = sheet(0.0)
            .with_positions(sheet(0.0).positions().iter().map(|p| p * 2.0).collect::<Vec<_>>());
        assert!(Change::new(&sheet(0.0), &larger.unwrap()).is_none());
    }
}
