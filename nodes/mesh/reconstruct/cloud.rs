//! The points of a reconstruction, with their normals and, where known, the directions to the sensor.

use maquette_base::scattered::Scattered;
use maquette_value::{Attribute, Attributes, Column, Mesh, Points, RangeImage, Rgb, bounds};
use nalgebra::{Matrix4, Point3, Vector3};

/// The points of several sources in one coordinate system.
#[derive(Clone, Debug, Default)]
pub(super) struct Cloud {
    pub(super) positions: Vec<Point3<f64>>,
    /// Unit normals; zero vectors for points without a normal.
    pub(super) normals: Vec<Vector3<f64>>,
    /// Unit vectors towards the sensor; zero vectors if the sensor is unknown.
    pub(super) views: Vec<Vector3<f64>>,
    /// The color of each point; `None` unless all sources have colors.
    pub(super) colors: Option<Vec<Rgb>>,
    /// The weight of each point, 1 on average; empty if all weights are equal.
    pub(super) weights: Vec<f64>,
}

/// Name of the point attribute from which weights are read.
const CONFIDENCE: &str = "confidence";

/// Minimum weight of a point; lower weights are raised to it, since a mean needs positive weights.
const MIN_WEIGHT: f64 = 1e-6;

/// Minimum distance from the origin, in extents of the points, from which the points are moved.
const FAR: f64 = 1000.0;

/// Maximum distance from the origin, in mm, so that squares do not overflow.
const MAX_DISTANCE: f64 = 1e100;

impl Cloud {
    /// Collects the points of all sources. Each source is moved by its pose, unless that is `None`. Normals are dropped unless `normals` is
    /// true.
    pub(super) fn new(
        sources: &[Scattered],
        poses: &[Option<Matrix4<f64>>],
        normals: bool,
    ) -> Self {
        let mut cloud = Self { colors: Some(Vec::new()), ..Self::default() };
        for (source, pose) in sources.iter().zip(poses) {
            let first = cloud.positions.len();
            let colors = match source {
                Scattered::Points(points) => cloud.add_points(points),
                Scattered::Mesh(mesh) => cloud.add_mesh(mesh),
                Scattered::RangeImage(range) => cloud.add_range(range),
            };
            cloud.colors = cloud.colors.take().zip(colors).map(|(all, more)| [all, more].concat());
            if let Some(pose) = pose {
                cloud.positions[first..].iter_mut().for_each(|x| *x = pose.transform_point(x));
                let turned = cloud.normals[first..].iter_mut().chain(&mut cloud.views[first..]);
                turned.for_each(|x| *x = pose.transform_vector(x));
            }
        }
        cloud.weigh(sources);
        if !normals {
            cloud.normals.fill(Vector3::zeros());
        }
        cloud
    }

    /// Moves the points near the origin if they are far away, compared with their extent, and returns their distance from where they were.
    /// The differences of coordinates stay exact, and sums and squares of coordinates keep all digits.
    pub(super) fn move_to_origin(&mut self) -> Vector3<f64> {
        let (low, high) = bounds(self.positions.iter()).unwrap_or_default();
        let far = low.coords.amax().max(high.coords.amax());
        let size = (high - low).amax();
        let is_far = far > FAR * size && size > 0.0 && far < MAX_DISTANCE;
        if !is_far {
            return Vector3::zeros();
        }
        let middle = nalgebra::center(&low, &high).coords;
        self.positions.iter_mut().for_each(|at| *at -= middle);
        middle
    }

    /// Returns true if the normal of a point, or the direction to its sensor, is known.
    pub(super) fn has_sides(&self) -> bool {
        self.normals.iter().chain(&self.views).any(|side| *side != Vector3::zeros())
    }

    /// Reads the weights of points from the attribute `confidence` of their sources. Points of sources without this attribute have the
    /// weight 1.
    fn weigh(&mut self, sources: &[Scattered]) {
        if !sources.iter().any(|source| match source {
            Scattered::RangeImage(_) => false,
            Scattered::Points(points) => confidence(points.attributes()).is_some(),
            Scattered::Mesh(mesh) => confidence(mesh.vertex()).is_some(),
        }) {
            return;
        }
        for source in sources {
            let own = match source {
                Scattered::RangeImage(range) => vec![1.0; range.n_valid()],
                Scattered::Points(points) => weights(points.attributes(), points.positions().len()),
                Scattered::Mesh(mesh) => weights(mesh.vertex(), mesh.positions().len()),
            };
            self.weights.extend(own);
        }
        let mean = self.weights.iter().sum::<f64>() / self.weights.len().max(1) as f64;
        self.weights.iter_mut().for_each(|weight| *weight = (*weight / mean).max(MIN_WEIGHT));
    }

    fn add_points(&mut self, points: &Points) -> Option<Vec<Rgb>> {
        let normals = points.attributes().vectors("normal");
        self.add(points.positions(), normals.map(|normals| &**normals));
        colors(points.attributes())
    }

    /// Adds the vertices of a mesh and returns their colors. A vertex without faces has no normal, so a mesh without faces has no normals.
    fn add_mesh(&mut self, mesh: &Mesh) -> Option<Vec<Rgb>> {
        let given = !mesh.faces().is_empty() || mesh.vertex().vectors("normal").is_some();
        let normals = given.then(|| mesh.normals());
        self.add(mesh.positions(), normals.as_deref());
        if let Some(depth) = mesh.frame().map(|frame| frame.depth).filter(|_| !given) {
            // The sensor of a capture is at the origin of the capture's frame.
            let first = self.views.len() - mesh.positions().len();
            let views = mesh.positions().iter().map(|point| towards_sensor(point, depth));
            self.views.truncate(first);
            self.views.extend(views);
        }
        mesh.texture_colors().map(|colors| colors.to_vec()).or_else(|| colors(mesh.vertex()))
    }

    fn add_range(&mut self, range: &RangeImage) -> Option<Vec<Rgb>> {
        let valid: Vec<usize> =
            (0..range.points().len()).filter(|&cell| range.point(cell).is_some()).collect();
        let places: Vec<Point3<f64>> = valid.iter().map(|&cell| range.points()[cell]).collect();
        let depth = range.median_depth().unwrap_or(0.0);
        self.add(&places, None);
        let first = self.views.len() - places.len();
        self.views.truncate(first);
        self.views.extend(places.iter().map(|point| towards_sensor(point, depth)));
        range.colors().map(|colors| valid.iter().map(|&cell| colors[cell]).collect())
    }

    fn add(&mut self, places: &[Point3<f64>], normals: Option<&[[f64; 3]]>) {
        self.positions.extend_from_slice(places);
        self.views.resize(self.positions.len(), Vector3::zeros());

        match normals {
            Some(normals) => self.normals.extend(
                normals
                    .iter()
                    .map(|normal| Vector3::from(*normal).try_normalize(1e-9).unwrap_or_default()),
            ),
            None => self.normals.resize(self.positions.len(), Vector3::zeros()),
        }
    }
}

/// Returns the direction from a point towards the sensor, which looks along z from the origin. A grid without a camera may have been moved
/// to or behind the origin; if `depth` is therefore not positive, the direction is -z.
fn towards_sensor(point: &Point3<f64>, depth: f64) -> Vector3<f64> {
    if depth > 0.0 {
        (-point.coords).try_normalize(1e-9).unwrap_or_default()
    } else {
        -Vector3::z()
    }
}

fn confidence(attributes: &Attributes) -> Option<&Column<f64>> {
    match attributes.get(CONFIDENCE) {
        Some(Attribute::Number(weights)) => Some(weights),
        _ => None,
    }
}

fn weights(attributes: &Attributes, count: usize) -> Vec<f64> {
    confidence(attributes).map_or_else(
        || vec![1.0; count],
        |own| {
            own.iter()
                .map(|it| if it.is_finite() { it.max(MIN_WEIGHT) } else { MIN_WEIGHT })
                .collect()
        },
    )
}

fn colors(attributes: &Attributes) -> Option<Vec<Rgb>> {
    attributes.colors("color").map(|colors: &Column<Rgb>| colors.to_vec())
}
