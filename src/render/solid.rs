//! Points, lines, arrows and plots as small solids, so that one renderer draws all layers.

use maquette_value::{Attribute, Axes, Faces, Image, Layer, Mesh, Rgb, Series, bounds};
use nalgebra::{Point3, Vector3};

use super::{Aim, View};

/// The radius of lines and the size of points and of arrows' heads, as shares of the diagonal of all there is.
///
/// Lines on faces are half as thick, so that these are seen between them. A few points alone are as large as `FEW`, so that they are seen
/// at all.
const LINE: f64 = 0.002;
const POINT: f64 = 0.004;
const FEW: f64 = 0.012;
const HEAD: f64 = 0.03;

/// The radius of beads in the middle of marked edges, which show the smallest one.
const BEAD: f64 = 0.005;

/// The color of marks, which nothing else has.
const MARK: Rgb = [235, 30, 40];

/// Of more points than that, every n-th is drawn.
const MOST: usize = 100_000;

/// Colors of points, lines and arrows, and of the series of a plot.
const COLORS: [Rgb; 4] = [[214, 170, 60], [92, 152, 232], [190, 80, 40], [70, 140, 90]];

/// The height of a plot whose width is 1.
const PLOT: f64 = 0.7;

/// A picture of what of a value lies in space or is a plot, if there is any: faces, lines, points and arrows together.
///
/// It has the axes of the faces, or of the first layer if there are none, and so does what the view aims at.
pub fn render_layers(layers: &[Layer], view: &View) -> Option<Image> {
    let (meshes, axes) = meshes_of(layers, Some(Axes::Upright));
    let has_faces = meshes.iter().any(|(_, is_solid)| !is_solid);
    let meshes: Vec<_> = meshes.iter().map(|(mesh, _)| mesh).collect();
    let view = if has_faces { *view } else { View { aim: aim(view, axes), ..*view } };
    (!meshes.is_empty()).then(|| super::render_all(&meshes, &view))
}

/// The faces of some layers, and solids for all else that lies in space, with whether they are solids; and the axes of the value: those
/// of the faces, or of the first layer if there are none, where the solids have them too, unless others are asked for.
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
    let solids = Solids::of(layers, drawn).mesh(&faces);
    let faces = faces.into_iter().map(|mesh| (mesh.clone(), false));
    (faces.chain(solids.map(|mesh| (mesh, true))).collect(), axes)
}

/// What a view aims at, with y up.
fn aim(view: &View, axes: Axes) -> Option<Aim> {
    fn turn(place: Point3<f64>, axes: &Axes) -> Point3<f64> {
        axes.turned(place, Axes::Upright)
    }
    view.aim.map(|aim| match aim {
        Aim::Place(place) => Aim::Place(turn(place, &axes)),
        Aim::Box(low, high) => Aim::Box(turn(low, &axes), turn(high, &axes)),
    })
}

/// What is to be drawn.
#[derive(Default)]
struct Solids {
    points: Vec<(Point3<f64>, Rgb)>,
    lines: Vec<([Point3<f64>; 2], Rgb)>,
    arrows: Vec<[Point3<f64>; 2]>,
    marks: Vec<Vec<Point3<f64>>>,
}

impl Solids {
    /// The layers that are no faces, in these axes.
    fn of(layers: &[Layer], axes: Axes) -> Self {
        let mut all = Self::default();
        for layer in layers {
            match layer {
                Layer::Points(cloud) => {
                    let colors = cloud.points.attributes().colors("color");
                    fn color(
                        k: usize,
                        colors: &Option<&maquette_value::Column<[u8; 3]>>,
                    ) -> [u8; 3] {
                        colors.map_or(COLORS[0], |colors| colors[k])
                    }
                    let places = cloud.points.positions().iter().enumerate();
                    let stride = places.len().div_ceil(MOST).max(1);
                    all.points.extend(
                        places
                            .step_by(stride)
                            .map(|(k, &point)| (cloud.axes.turned(point, axes), color(k, &colors))),
                    );
                }
                Layer::Lines(lines) => {
                    fn at(
                        &k: &u32,
                        lines_points: &maquette_value::Column<Point3<f64>>,
                    ) -> Option<Point3<f64>> {
                        lines_points.get(k as usize).copied()
                    }
                    for ends in lines.chains.iter().flat_map(|chain| chain.windows(2)) {
                        let [Some(a), Some(b)] =
                            [at(&ends[0], &lines.points), at(&ends[1], &lines.points)]
                        else {
                            continue;
                        };
                        all.lines.push(([a, b].map(|end| lines.axes.turned(end, axes)), COLORS[1]));
                    }
                }
                Layer::Arrows(arrows) => {
                    let ends = arrows.from.iter().zip(arrows.to.iter());
                    all.arrows.extend(
                        ends.map(|(&from, &to)| {
                            [from, to].map(|end| arrows.axes.turned(end, axes))
                        }),
                    );
                }
                Layer::Marks(marks) => {
                    let outlines = marks.outlines.iter();
                    all.marks.extend(outlines.map(|it| {
                        it.iter().map(|&place| marks.axes.turned(place, axes)).collect::<Vec<_>>()
                    }));
                }
                Layer::Plot(series) => all.plot(series),
                Layer::Picture(_) | Layer::Triangles(_) => {}
            }
        }
        all
    }

    /// The series over one axis, in a frame.
    fn plot(&mut self, series: &[Series]) {
        let all = |numbers: fn(&Series) -> &[f64]| {
            let numbers = series.iter().flat_map(numbers).filter(|x| x.is_finite());
            let start = (f64::INFINITY, f64::NEG_INFINITY);
            numbers.fold(start, |(low, high), &x| (low.min(x), high.max(x)))
        };
        let (across, up) = (all(|series| &series.at), all(|series| &series.numbers));
        fn share(x: f64, (low, high): (f64, f64)) -> f64 {
            // Halves, because the difference of two huge numbers is infinite.
            if low < high { (x / 2.0 - low / 2.0) / (high / 2.0 - low / 2.0) } else { 0.5 }
        }
        for (series, color) in series.iter().zip(COLORS.iter().cycle().skip(1)) {
            let places: Vec<_> = series
                .at
                .iter()
                .zip(&series.numbers)
                .map(|(&at, &x): (&f64, &f64)| {
                    let place = Point3::new(share(at, across), share(x, up) * PLOT, 0.0);
                    place.coords.iter().all(|x| x.is_finite()).then_some(place)
                })
                .collect();
            let pairs = places.windows(2).filter_map(|pair| Some([pair[0]?, pair[1]?]));
            self.lines.extend(pairs.map(|pair| (pair, *color)));
            self.points.extend(places.iter().flatten().map(|place| (*place, *color)));
        }
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, PLOT], [0.0, PLOT]];
        let corners = corners.map(|[x, y]| Point3::new(x, y, 0.0));
        let frame = (0..4).map(|k| ([corners[k], corners[(k + 1) % 4]], [120; 3]));
        self.lines.extend(frame);
    }

    /// The size of points, as a share of the diagonal: the fewer there are, the larger. Beads on lines are small.
    fn point(&self) -> f64 {
        let count = self.points.len() + self.arrows.len();
        if self.lines.is_empty() { (0.1 / (count as f64).sqrt()).clamp(POINT, FEW) } else { POINT }
    }

    /// All of it as one mesh, as large as it must be beside some faces; none if there is nothing, or it is too large for numbers.
    fn mesh(&self, faces: &[&Mesh]) -> Option<Mesh> {
        let points = self.points.iter().map(|(point, _)| point);
        let ends = self.lines.iter().flat_map(|(ends, _)| ends);
        let ends = ends.chain(self.arrows.iter().flatten()).chain(self.marks.iter().flatten());
        let mut places = points
            .chain(ends)
            .filter(|point| point.coords.iter().all(|x| x.is_finite()))
            .peekable();
        places.peek()?;
        let vertices = faces.iter().flat_map(|mesh| mesh.positions().iter());
        let (low, high) = bounds(places.chain(vertices))?;
        let diagonal = (high - low).norm();
        let size = if diagonal > 0.0 { diagonal } else { 1.0 };
        let line = size * if faces.is_empty() { LINE } else { LINE / 2.0 };
        let point = size * self.point();
        let mut pieces = Pieces::default();
        for (place, color) in &self.points {
            pieces.point(*place, point, *color);
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

/// A mesh that grows. What is not at a finite place is left out.
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

    /// An octahedron.
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

    /// A place, a line or a closed outline, in something of this size.
    fn mark(&mut self, outline: &[Point3<f64>], size: f64) {
        let [first, .., last] = outline else {
            return outline.iter().for_each(|place| self.point(*place, BEAD * size, MARK));
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

    /// A prism of four sides with a radius at each end.
    fn tube(&mut self, ends: [Point3<f64>; 2], radii: [f64; 2], color: Rgb) {
        let Some(along) = (ends[1] - ends[0]).try_normalize(0.0) else { return };
        let least = along.iamin();
        let side = along.cross(&Vector3::ith(least, 1.0)).normalize();
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

    /// How many pixels of a square picture show something.
    fn seen(layers: &[Layer], side: usize) -> usize {
        let view = View { size: [side; 2], ..View::front() };
        let Some(picture) = render_layers(layers, &view) else { return 0 };
        let row = |k: usize| &picture.pixels()[side * k..][..side];
        (0..side).map(|k| row(k).iter().filter(|pixel| **pixel != row(k)[0]).count()).sum()
    }

    #[test]
    fn lines_arrows_and_plots_are_seen() {
        let points = vec![Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(1.0, 1.0, 0.0)];
        let lines =
            Lines { points: points.into(), chains: vec![vec![0, 1, 2, 9]], axes: Axes::Upright };
        assert!(seen(&[Layer::Lines(lines)], 200) > 200);
        let (from, to) = (vec![Point3::origin()].into(), vec![Point3::new(0.0, 5.0, 0.0)].into());
        assert!(seen(&[Layer::Arrows(Arrows { from, to, axes: Axes::Sensor })], 200) > 100);
        let series = Series {
            name: "a".into(),
            at: vec![0.0, 1.0, 2.0],
            numbers: vec![3.0, f64::NAN, 1e300],
        };
        assert!(seen(&[Layer::Plot(vec![series])], 200) > 300);
        assert_eq!(seen(&[], 200), 0);
    }

    #[test]
    fn every_hostile_value_is_seen_or_not_but_never_stops_the_program() {
        for kind in TYPES {
            let values = kind.hostile();
            assert!(values.iter().all(|value| seen(&value.show(), 12) <= 12 * 12), "{}", kind.name);
        }
    }

    #[test]
    fn solids_are_closed_and_look_outside() {
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
