//! The points to reconstruct a surface from, with their normals and the directions to the sensor where these are known.

use maquette_base::scattered::Scattered;
use maquette_value::{Attribute, Attributes, Column, Mesh, Points, RangeImage, Rgb};
use nalgebra::{Matrix4, Point3, Vector3};

/// Points of several sources in one frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Cloud {
    pub(super) positions: Vec<Point3<f64>>,
    /// Unit normals; 0 where there is none.
    pub(super) normals: Vec<Vector3<f64>>,
    /// Unit vectors towards the sensor; 0 where it is not known.
    pub(super) views: Vec<Vector3<f64>>,
    /// One for each point, if all sources have colors.
    pub(super) colors: Option<Vec<Rgb>>,
    /// How much each point counts, 1 on the mean; empty if all count the same.
    pub(super) weights: Vec<f64>,
}

/// The attribute of points that says how much each counts.
const CONFIDENCE: &str = "confidence";

/// A point counts at least so much, as a share of one that counts 1: a mean needs a weight.
const LEAST: f64 = 1e-6;

impl Cloud {
    /// The points of all sources, moved by their poses where there are some. Normals are left out without `normals`.
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

    /// Takes the weights of points from sources that have some. Points of the others count 1.
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
        self.weights.iter_mut().for_each(|weight| *weight = (*weight / mean).max(LEAST));
    }

    fn add_points(&mut self, points: &Points) -> Option<Vec<Rgb>> {
        let normals = points.attributes().vectors("normal");
        self.add(points.positions(), normals.map(|normals| &**normals));
        colors(points.attributes())
    }

    /// Vertices that belong to no face have no normal; without faces none has.
    fn add_mesh(&mut self, mesh: &Mesh) -> Option<Vec<Rgb>> {
        let given = !mesh.faces().is_empty() || mesh.vertex().vectors("normal").is_some();
        let normals = given.then(|| mesh.normals());
        self.add(mesh.positions(), normals.as_deref());
        if let Some(depth) = mesh.frame().map(|frame| frame.depth).filter(|_| !given) {
            // The sensor is at the origin of its frame.
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
        let unit =
            |normal: &[f64; 3]| Vector3::from(*normal).try_normalize(1e-9).unwrap_or_default();
        match normals {
            Some(normals) => self.normals.extend(normals.iter().map(unit)),
            None => self.normals.resize(self.positions.len(), Vector3::zeros()),
        }
    }
}

/// The direction of the sensor, which looks along z from the origin. Grids without a camera may have been moved towards it.
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
        |own| own.iter().map(|it| if it.is_finite() { it.max(LEAST) } else { LEAST }).collect(),
    )
}

fn colors(attributes: &Attributes) -> Option<Vec<Rgb>> {
    attributes.colors("color").map(|colors: &Column<Rgb>| colors.to_vec())
}
