//! Represents points, lines, arrows and plots by small solids, so that one renderer can draw all layers.

use maquette_value::{Attribute, Axes, Faces, Image, Layer, Mesh, Rgb, Series, bounds};
use nalgebra::{Point3, Vector3};

use super::{Aim, View};

/// The radius of lines and the size of points and arrowheads, as fractions of the diagonal of the scene.
///
/// Lines on faces are half as thick as other lines, so that the faces between them stay visible. If a scene consists only of a few points,
/// they have the size `FEW_POINTS`, so that they can be seen at all.
const LINE: f64 = 0.002;
const POINT: f64 = 0.004;
const FEW_POINTS: f64 = 0.012;
const HEAD: f64 = 0.03;

/// The radius of the small balls in the middle of marked edges, as a fraction of the diagonal of the scene. The balls make even the
/// shortest edge visible.
const BEAD: f64 = 0.005;

/// The color of marked elements. Nothing else has this color.
const MARK: Rgb = [235, 30, 40];

/// The maximum number of points that are drawn. If there are more, only every n-th point is drawn.
const MAX_POINTS: usize = 100_000;

/// The colors of points, lines and arrows, and the colors of the series of a plot.
const COLORS: [Rgb; 4] = [[214, 170, 60], [92, 152, 232], [190, 80, 40], [70, 140, 90]];

/// The ratio of height to width of a plot.
const PLOT: f64 = 0.7;

/// Renders the layers of a value that are in 3D space, or its plot. Faces, lines, points and arrows are drawn together. Returns `None` if
/// there are no such layers.
///
/// The picture and the target of the view have the coordinate axes of the faces. If there are no faces, they have those of the first layer.
pub fn render_layers(layers: &[Layer], view: &View) -> Option<Image> {
    let (meshes, axes) = meshes_of(layers, Some(Axes::Upright));
    let has_faces = meshes.iter().any(|(_, is_solid)| !is_solid);
    let meshes: Vec<_> = meshes.iter().map(|(mesh, _)| mesh).collect();
    let view = if has_faces { *view } else { View { aim: aim(view, axes), ..*view } };
    (!meshes.is_empty()).then(|| super::render_all(&meshes, &view))
}

/// Returns the meshes of some layers, and one more mesh with solids for everything else in 3D space. Each mesh comes with a flag, which is
/// true for the mesh of solids. Also returns the coordinate axes of the value: those of the faces, or of the first layer if there are no
/// faces. Solids have these axes, too; but if there are no faces and `alone` is given, they have the axes `alone`.
pub(super) fn meshes_of(layers: &[Layer], alone: Option<Axes>) -> (Vec<(Mesh, bool)>, Axes) {
    let mut faces_first =
        layers.iter().filter(|layer| matches!(layer, Layer::Triangles(_))).chain(layers);
    let axes = faces_first.find_map(Layer::axes).unwrap_or_default();
    let faces = layers.iter().filter_map(|layer| match layer {
        Layer::Triangles(mesh) => Some(&**mesh),
        _ => None,
    });
    let faces = Vec::from_iter(faces);
    let drawn = if faces.is_empty() { alone.unwrap_or(axes) } else { axes };
    let solids = Solids::from_layers(layers, drawn).mesh(&faces);
    let faces = faces.into_iter().map(|mesh| (mesh.clone(), false));
    (faces.chain(solids.map(|mesh| (mesh, true))).collect(), axes)
}

/// Converts the target of a view from the given axes to upright axes. Returns `None` if the view has no target.
fn aim(view: &View, axes: Axes) -> Option<Aim> {
    view.aim.map(|aim| match aim {
        Aim::Point(position) => Aim::Point(axes.convert(position, Axes::Upright)),
        Aim::Box(low, high) => {
            Aim::Box(axes.convert(low, Axes::Upright), axes.convert(high, Axes::Upright))
        }
    })
}

/// The points, lines, arrows and marked elements that are to be drawn.
#[derive(Default)]
struct Solids {
    points: Vec<(Point3<f64>, Rgb)>,
    lines: Vec<([Point3<f64>; 2], Rgb)>,
    arrows: Vec<[Point3<f64>; 2]>,
    marks: Vec<Vec<Point3<f64>>>,
}

impl Solids {
    /// Collects the elements of all layers except faces, and converts them to the coordinate axes `axes`.
    fn from_layers(layers: &[Layer], axes: Axes) -> Self {
        let mut all = Self::default();
        for layer in layers {
            match layer {
                Layer::Points(cloud) => {
                    let colors = cloud.points.attributes().colors("color");
                    let positions = cloud.points.positions().iter().enumerate();
                    let stride = positions.len().div_ceil(MAX_POINTS).max(1);
                    all.points.extend(positions.step_by(stride).map(|(k, &point)| {
                        let color = colors.map_or(COLORS[0], |colors| colors[k]);
                        (cloud.axes.convert(point, axes), color)
                    }));
                }
                Layer::Lines(lines) => {
                    for ends in lines.chains.iter().flat_map(|chain| chain.windows(2)) {
                        let [Some(&a), Some(&b)] =
                            [0, 1].map(|end| lines.points.get(ends[end] as usize))
                        else {
                            continue;
                        };
                        all.lines
                            .push(([a, b].map(|end| lines.axes.convert(end, axes)), COLORS[1]));
                    }
                }
                Layer::Arrows(arrows) => {
                    let ends = arrows.from.iter().zip(arrows.to.iter());
                    all.arrows.extend(
                        ends.map(|(&from, &to)| {
                            [from, to].map(|end| arrows.axes.convert(end, axes))
                        }),
                    );
                }
                Layer::Marks(marks) => {
                    let outlines = marks.outlines.iter();
                    all.marks.extend(outlines.map(|it| {
                        it.iter()
                            .map(|&position| marks.axes.convert(position, axes))
                            .collect::<Vec<_>>()
                    }));
                }
                Layer::Plot(series) => all.plot(series),
                Layer::Picture(_) | Layer::Triangles(_) => {}
            }
        }
        all
    }

    /// Adds the series of a plot and a frame around them. All series share one horizontal axis.
    fn plot(&mut self, series: &[Series]) {
        let across = finite_range(series.iter().flat_map(|series| &series.at));
        let up = finite_range(series.iter().flat_map(|series| &series.numbers));
        for (series, color) in series.iter().zip(COLORS.iter().cycle().skip(1)) {
            let positions: Vec<_> = series
                .at
                .iter()
                .zip(&series.numbers)
                .map(|(&at, &x): (&f64, &f64)| {
                    let position = Point3::new(relative(at, across), relative(x, up) * PLOT, 0.0);
                    position.coords.iter().all(|x| x.is_finite()).then_some(position)
                })
                .collect();
            let pairs = positions.windows(2).filter_map(|pair| Some([pair[0]?, pair[1]?]));
            self.lines.extend(pairs.map(|pair| (pair, *color)));
            self.points.extend(positions.iter().flatten().map(|position| (*position, *color)));
        }
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, PLOT], [0.0, PLOT]];
        let corners = corners.map(|[x, y]| Point3::new(x, y, 0.0));
        let frame = (0..4).map(|k| ([corners[k], corners[(k + 1) % 4]], [120; 3]));
        self.lines.extend(frame);
    }

    /// Returns the size of points, as a fraction of the diagonal of the scene. The size is larger if there are few points, and `POINT` if
    /// there are also lines.
    fn point_size(&self) -> f64 {
        let count = self.points.len() + self.arrows.len();
        if self.lines.is_empty() {
            (0.1 / (count as f64).sqrt()).clamp(POINT, FEW_POINTS)
        } else {
            POINT
        }
    }

    /// Builds one mesh of all solids. The sizes of the solids are relative to the scene, which includes `faces`. Returns `None` if there
    /// are no solids, or if a coordinate overflows.
    fn mesh(&self, faces: &[&Mesh]) -> Option<Mesh> {
        let points = self.points.iter().map(|(point, _)| point);
        let ends = self.lines.iter().flat_map(|(ends, _)| ends);
        let ends = ends.chain(self.arrows.iter().flatten()).chain(self.marks.iter().flatten());
        let mut positions = points
            .chain(ends)
            .filter(|point| point.coords.iter().all(|x| x.is_finite()))
            .peekable();
        positions.peek()?;
        let vertices = faces.iter().flat_map(|mesh| mesh.positions().iter());
        let (low, high) = bounds(positions.chain(vertices))?;
        let diagonal = (high - low).norm();
        let size = if diagonal > 0.0 { diagonal } else { 1.0 };
        let line = size * if faces.is_empty() { LINE } else { LINE / 2.0 };
        let point = size * self.point_size();
        let mut pieces = Pieces::default();
        for (position, color) in &self.points {
            pieces.point(*position, point, *color);
        }
        for ([a, b], color) in &self.lines {
            pieces.line(*a, *b, line, *color);
        }
        for &[from, to] in &self.arrows {
            let length = (to - from).norm();
            let head = (HEAD * size).min(0.5 * length);
            if length > 0.0 {
                let neck = to - (to - from) * (head / length);
                pieces.line(from, neck, line, COLORS[2]);
                pieces.tube([neck, to], [head / 3.0, 0.0], COLORS[2]);
            } else {
                pieces.point(from, point, COLORS[2]);
            }
        }
        for outline in &self.marks {
            pieces.mark(outline, size);
        }
        let Pieces { positions, colors, faces } = pieces;
        let mesh = Mesh::new(positions, Faces::triangles(faces)).ok()?;
        mesh.with_vertex("color", Attribute::Color(colors.into())).ok()
    }
}

/// Returns the minimum and the maximum of the finite numbers.
fn finite_range<'a>(numbers: impl Iterator<Item = &'a f64>) -> (f64, f64) {
    let start = (f64::INFINITY, f64::NEG_INFINITY);
    numbers.filter(|x| x.is_finite()).fold(start, |(low, high), &x| (low.min(x), high.max(x)))
}

/// Returns the relative position of a number in a range: 0 at its start, 1 at its end. In an empty range the position is 0.5.
fn relative(x: f64, (low, high): (f64, f64)) -> f64 {
    // Halve first: the difference of two huge numbers could be infinite.
    if low < high { (x / 2.0 - low / 2.0) / (high / 2.0 - low / 2.0) } else { 0.5 }
}

/// A mesh under construction. Solids with infinite positions or NaN are left out.
#[derive(Default)]
struct Pieces {
    positions: Vec<Point3<f64>>,
    colors: Vec<Rgb>,
    faces: Vec<[u32; 3]>,
}

impl Pieces {
    fn add(&mut self, positions: &[Point3<f64>], faces: &[[u32; 3]], color: Rgb) {
        if positions.iter().any(|point| !point.coords.iter().all(|x| x.is_finite())) {
            return;
        }
        let first = self.positions.len() as u32;
        self.positions.extend(positions);
        self.colors.extend(positions.iter().map(|_| color));
        self.faces.extend(faces.iter().map(|face| face.map(|vertex| first + vertex)));
    }

    /// Adds an octahedron that represents a point.
    fn point(&mut self, at: Point3<f64>, radius: f64, color: Rgb) {
        let corners: [_; 6] = std::array::from_fn(|k: usize| {
            let mut corner = at;
            corner[k / 2] += if k.is_multiple_of(2) { radius } else { -radius };
            corner
        });
        const FACES: [[u32; 3]; 8] = [
            [0, 2, 4],
            [2, 1, 4],
            [1, 3, 4],
            [3, 0, 4],
            [2, 0, 5],
            [1, 2, 5],
            [3, 1, 5],
            [0, 3, 5],
        ];
        self.add(&corners, &FACES, color);
    }

    /// Adds a mark for an element, given by its outline: a point, a line or a closed loop. The size of the mark depends on the size of the
    /// scene.
    fn mark(&mut self, outline: &[Point3<f64>], size: f64) {
        let [first, .., last] = outline else {
            return outline.iter().for_each(|position| self.point(*position, BEAD * size, MARK));
        };
        for ends in outline.windows(2) {
            self.line(ends[0], ends[1], LINE * size, MARK);
        }
        if 2 < outline.len() {
            self.line(*last, *first, LINE * size, MARK);
        } else {
            self.point(nalgebra::center(first, last), BEAD * size, MARK);
        }
    }

    fn line(&mut self, from: Point3<f64>, to: Point3<f64>, radius: f64, color: Rgb) {
        self.tube([from, to], [radius; 2], color);
    }

    /// Adds a prism with four sides along a line. The radii at its two ends may differ.
    fn tube(&mut self, ends: [Point3<f64>; 2], radii: [f64; 2], color: Rgb) {
        let Some(along) = (ends[1] - ends[0]).try_normalize(0.0) else { return };
        let axis = along.iamin();
        let side = along.cross(&Vector3::ith(axis, 1.0)).normalize();
        let other = along.cross(&side);
        fn ring(k: usize, side: Vector3<f64>, other: Vector3<f64>) -> Vector3<f64> {
            [side, other, -side, -other][k]
        }
        let corners: [_; 8] =
            std::array::from_fn(|k: usize| ends[k / 4] + ring(k % 4, side, other) * radii[k / 4]);
        let mut faces = vec![[0, 3, 2], [0, 2, 1], [4, 5, 6], [4, 6, 7]];
        for k in 0..4 {
            let next = (k + 1) % 4;
            faces.extend([[k, next, next + 4], [k, next + 4, k + 4]]);
        }
        self.add(&corners, &faces, color);
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::{Arrows, Lines, TYPES};

    use super::*;

    /// Returns the number of pixels that show something other than the background, in a square picture.
    fn visible_pixels(layers: &[Layer], side: usize) -> usize {
        let view = View { size: [side; 2], ..View::front() };
        let Some(picture) = render_layers(layers, &view) else { return 0 };
        let row = |k: usize| &picture.pixels()[side * k..][..side];
        (0..side).map(|k| row(k).iter().filter(|pixel| **pixel != row(k)[0]).count()).sum()
    }

    #[test]
    fn lines_arrows_and_plots_are_visible() {
        let points = vec![Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(1.0, 1.0, 0.0)];
        let lines =
            Lines { points: points.into(), chains: vec![vec![0, 1, 2, 9]], axes: Axes::Upright };
        assert!(visible_pixels(&[Layer::Lines(lines)], 200) > 200);
        let (from, to) = (vec![Point3::origin()].into(), vec![Point3::new(0.0, 5.0, 0.0)].into());
        assert!(
            visible_pixels(&[Layer::Arrows(Arrows { from, to, axes: Axes::Sensor })], 200) > 100
        );
        let series = Series {
            name: "a".into(),
            at: vec![0.0, 1.0, 2.0],
            numbers: vec![3.0, f64::NAN, 1e300],
        };
        assert!(visible_pixels(&[Layer::Plot(vec![series])], 200) > 300);
        assert_eq!(visible_pixels(&[], 200), 0);
    }

    #[test]
    fn no_edge_case_causes_a_panic() {
        for kind in TYPES {
            let values = kind.edge_cases();
            assert!(
                values.iter().all(|value| visible_pixels(&value.show(), 12) <= 12 * 12),
                "{}",
                kind.name
            );
        }
    }

    #[test]
    fn solids_are_closed_and_oriented_outward() {
        let mut pieces = Pieces::default();
        pieces.point(Point3::origin(), 1.0, [0; 3]);
        pieces.line(Point3::new(5.0, 0.0, 0.0), Point3::new(9.0, 2.0, 1.0), 0.5, [0; 3]);
        let mesh = Mesh::new(pieces.positions, Faces::triangles(pieces.faces)).unwrap();
        let edges = mesh.edges();
        assert!(edges.faces.iter().all(|&faces| faces == 2) && edges.misoriented == 0);
        for (index, face) in mesh.faces().iter().enumerate() {
            let middle = if index < 8 { Point3::origin() } else { Point3::new(7.0, 1.0, 0.5) };
            let corner = mesh.positions()[face[0] as usize];
            assert!(mesh.area_vector(face).dot(&(corner - middle)) > 0.0, "face {index}");
        }
    }
}
