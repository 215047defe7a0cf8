//! Tubes around curves, for display and printing.

use maquette_base::limits::VERTICES;
use maquette_node::{Context, Error, Estimate, In, Node, Promise, bail};
use maquette_value::{Curve, Faces, Mesh, MeshError};
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Creates a tube around a curve: a mesh that can be displayed and printed. The tube of an open curve is closed at both ends.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Tube {
    /// Curve at the center of the tube.
    pub curve: In<Curve>,
    /// Radius of the tube.
    #[schemars(range(min = 1e-6), extend("unit" = "mm"))]
    #[serde(default = "default_radius")]
    pub radius: f64,
    /// Number of sides of its cross-section.
    #[schemars(range(min = 3, max = 256))]
    #[serde(default = "default_sides")]
    pub sides: usize,
}

fn default_radius() -> f64 {
    1.0
}

fn default_sides() -> usize {
    8
}

impl Node for Tube {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] =
        &[Promise::always("mesh", "Closed"), Promise::always("mesh", "NonEmpty")];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let vertices = cx.get(&self.curve).sample(0).len() as f64 * self.sides as f64;
        Some(Estimate { bytes: vertices * 72.0, help: VERTICES.help })
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((tube(cx.get(&self.curve), self.radius, self.sides)?,))
    }
}

/// Returns a tube around `curve`, with a ring of `sides` vertices, `radius` mm from the curve, around each point, and quads between rings.
/// The points are those of a polyline, or as many points of a B-spline as its shape needs.
///
/// A ring is perpendicular to the mean of the directions before and after its point. From ring to ring, it rotates no more than the curve
/// bends: Bishop, "There is more than one way to frame a curve" (1975).
///
/// # Errors
/// Returns an error if the radius is not greater than 0 and finite, there are fewer than 3 or more than 256 sides, or the curve has no
/// length.
pub fn tube(curve: &Curve, radius: f64, sides: usize) -> Result<Mesh, Error> {
    if !(radius > 0.0 && radius.is_finite() && (3..=256).contains(&sides)) {
        bail!(
            "expected a radius greater than 0 and 3 to 256 sides, found {radius} mm and {sides} sides"
        );
    }
    let is_closed = curve.is_closed();
    let mut points = curve.sample(0);
    // Remove points that equal the previous point, because no direction can be computed between equal points.
    points.dedup();
    if is_closed && points.first() == points.last() {
        points.pop();
    }
    VERTICES.check("the tube", points.len() as f64 * sides as f64)?;
    let directions = directions(&points, is_closed).ok_or_else(|| {
        let at = points.first().copied().unwrap_or_default();
        Error::new(format!(
            "the curve has no length: all its points are at ({:.3}, {:.3}, {:.3})",
            at.x, at.y, at.z
        ))
    })?;
    let mut side = any_normal(directions[0]);
    let mut positions = Vec::with_capacity(points.len() * sides);
    let mut before = directions[0];
    for (point, &direction) in points.iter().zip(&directions) {
        side = transport(side, before, direction);
        before = direction;
        let other = direction.cross(&side);
        positions.extend((0..sides).map(|corner| {
            let angle = std::f64::consts::TAU * corner as f64 / sides as f64;
            let (sine, cosine) = libm::sincos(angle);
            point + (side * cosine + other * sine) * radius
        }));
    }
    let corner_shift = is_closed.then(|| {
        // Along a closed curve, the rings may rotate in total. The last ring is connected to the first with a shift by whole corners, which
        // compensates the rotation.
        let side = transport(side, before, directions[0]);
        let heights: Vec<f64> =
            positions[..sides].iter().map(|position| (position - points[0]).dot(&side)).collect();
        (0..sides).max_by(|&a, &b| heights[a].total_cmp(&heights[b])).unwrap_or(0)
    });
    let faces = faces(points.len(), sides, corner_shift)?;
    Ok(Mesh::new(positions, faces)?)
}

/// Rotates `side`, a unit vector perpendicular to `from`, by the smallest rotation from `from` to `to`. If `from` and `to` are opposite,
/// the rotation is about `side` itself.
fn transport(side: Vector3<f64>, from: Vector3<f64>, to: Vector3<f64>) -> Vector3<f64> {
    let both = from + to;
    let length = both.norm_squared();
    let rotated = if length > 1e-6 { side - both * (2.0 * side.dot(&to) / length) } else { side };
    let square = rotated - to * rotated.dot(&to);
    square.try_normalize(0.0).unwrap_or_else(|| any_normal(to))
}

/// Returns the direction of the curve at each point; `None` if all points coincide.
fn directions(points: &[Point3<f64>], is_closed: bool) -> Option<Vec<Vector3<f64>>> {
    let count = points.len();
    if count < 2 {
        return None;
    }
    // The unit direction from each point to the next; `None` at the end of an open curve.
    let steps: Vec<Option<Vector3<f64>>> = (0..count)
        .map(|index| match is_closed || index + 1 < count {
            true => (points[(index + 1) % count] - points[index]).try_normalize(0.0),
            false => None,
        })
        .collect();
    (0..count)
        .map(|index: usize| {
            let (before, after) = (steps[(index + count - 1) % count], steps[index]);
            let both = before.unwrap_or_default() + after.unwrap_or_default();
            // At a point where the curve reverses, the mean of both directions vanishes; use the incoming direction.
            both.try_normalize(1e-9).or(before)
        })
        .collect()
}

/// Returns a unit vector perpendicular to a direction: the perpendicular component of the x axis, or of the y axis if the direction is
/// nearly x. The axis with the largest angle to the direction is not used: where two axes have equal angles, as on every grid, rounding
/// could change the choice.
fn any_normal(direction: Vector3<f64>) -> Vector3<f64> {
    let axis = usize::from(direction[0].abs() > 0.9);
    let rest = Vector3::ith(axis, 1.0) - direction * direction[axis];
    rest.normalize()
}

/// Returns the quads between adjacent rings, and the end caps of an open tube. `corner_shift` is `None` for an open tube; for a closed one,
/// it is the number of corners by which the last ring is rotated relative to the first.
fn faces(rings: usize, sides: usize, corner_shift: Option<usize>) -> Result<Faces, MeshError> {
    let mut corners = Vec::new();
    fn vertex(ring: usize, corner: usize, sides: usize) -> u32 {
        (ring * sides + corner % sides) as u32
    }
    fn quads(from: usize, to: usize, corner_shift: usize, corners: &mut Vec<u32>, sides: usize) {
        for corner in 0..sides {
            corners.extend([
                vertex(from, corner, sides),
                vertex(from, corner + 1, sides),
                vertex(to, corner + 1 + corner_shift, sides),
                vertex(to, corner + corner_shift, sides),
            ]);
        }
    }
    (1..rings).for_each(|ring| quads(ring - 1, ring, 0, &mut corners, sides));
    if let Some(corner_shift) = corner_shift {
        quads(rings - 1, 0, corner_shift, &mut corners, sides);
        return Faces::uniform(4, corners);
    }
    let mut counts = vec![4; (rings - 1) * sides];
    corners.extend((0..sides).rev().map(|corner| vertex(0, corner, sides)));
    corners.extend((0..sides).map(|corner| vertex(rings - 1, corner, sides)));
    counts.extend([sides; 2]);
    Faces::polygons(&counts, corners)
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    fn volume(mesh: &Mesh) -> f64 {
        mesh.faces()
            .iter()
            .map(|face| mesh.area_vector(face).dot(&mesh.positions()[face[0] as usize].coords))
            .sum::<f64>()
            / 3.0
    }

    #[test]
    fn a_straight_tube_is_a_closed_prism_facing_outwards() {
        let ends = vec![Point3::new(1.0, 2.0, 3.0), Point3::new(1.0, 2.0, 8.0)];
        let mesh = tube(&Curve::polyline(ends, false).unwrap(), 2.0, 4).unwrap();
        assert!((volume(&mesh) - 5.0 * 8.0).abs() < 1e-12, "{}", volume(&mesh));
        let edges = mesh.edges();
        assert!(edges.faces.iter().all(|faces| *faces == 2) && edges.misoriented == 0);
    }

    #[test]
    fn a_closed_tube_is_a_torus_of_the_right_volume() {
        let points: Vec<_> = (0..200)
            .map(|k: i32| {
                let (sine, cosine) = libm::sincos(f64::from(k) * std::f64::consts::TAU / 200.0);
                Point3::new(3.0 * cosine, 3.0 * sine, 0.2 * sine)
            })
            .collect();
        let mesh = tube(&Curve::polyline(points, true).unwrap(), 0.5, 40).unwrap();
        let torus = 2.0 * std::f64::consts::PI * std::f64::consts::PI * 3.0 * 0.25;
        assert!((volume(&mesh) / torus - 1.0).abs() < 0.01, "{}", volume(&mesh) / torus);
        let edges = mesh.edges();
        assert!(edges.faces.iter().all(|faces| *faces == 2) && edges.misoriented == 0);
        assert_eq!(edges.vertices.len(), 2 * mesh.faces().len());
    }

    #[test]
    fn a_coarse_ring_closes_without_a_twist() {
        let ring = Curve::polyline(
            (0..12)
                .map(|k: i32| {
                    let (sine, cosine) = libm::sincos(f64::from(k) * std::f64::consts::TAU / 12.0);
                    Point3::new(2.0 * cosine, sine, 0.0)
                })
                .collect::<Vec<_>>(),
            true,
        )
        .unwrap();
        let mesh = tube(&ring, 0.2, 12).unwrap();
        // Each quad belongs to one side of the tube, so the corners of the quad are at about the same angle around the tube.
        for face in mesh.faces().iter() {
            let heights = face.iter().map(|vertex| mesh.positions()[*vertex as usize].z);
            let (low, high) =
                heights.fold((1.0_f64, -1.0_f64), |(low, high), z| (low.min(z), high.max(z)));
            assert!(high - low < 0.2 * 0.52, "a quad reaches from {low} to {high}");
        }
    }

    #[test]
    fn rings_rotate_no_more_than_the_curve_bends() {
        let corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1], [0, 1, 1], [0, 1, 2]];
        fn corner(c: [i32; 3]) -> Point3<f64> {
            Point3::from(c.map(f64::from))
        }
        // The curve repeats one path many times, and rounding errors must not accumulate.
        let points =
            (0..20).flat_map(|k| corners.map(|[x, y, z]| corner([x + 2 * k, y + k, z + 2 * k])));
        let points: Vec<_> = points.collect();
        let mesh = tube(&Curve::polyline(points.clone(), false).unwrap(), 0.1, 4).unwrap();
        let directions = directions(&points, false).unwrap();
        let mut side = any_normal(directions[0]);
        for (ring, pair) in directions.windows(2).enumerate() {
            let rotation = Rotation3::rotation_between(&pair[0], &pair[1]).expect("not opposite");
            side = rotation * side;
            let positions = mesh.positions();
            let made = (positions[4 * (ring + 1)] - positions[4 * (ring + 1) + 2]) / 0.2;
            assert!((made - side).norm() < 1e-12, "ring {ring}: {made} in place of {side}");
        }
    }

    #[test]
    fn a_tube_with_too_many_vertices_is_rejected_with_numbers() {
        let line = Curve::polyline(
            (0..100_000).map(|k: u32| Point3::new(f64::from(k), 0.0, 0.0)).collect::<Vec<_>>(),
            false,
        )
        .unwrap();
        let error = tube(&line, 1.0, 256).unwrap_err();
        assert!(error.to_string().contains("about 26 000 000 vertices"), "{error}");
    }

    #[test]
    fn invalid_parameters_are_rejected() {
        let point = Point3::new(1.0, 1.0, 1.0);
        let curve = Curve::polyline(vec![point; 3], false).unwrap();
        let no_length = "the curve has no length: all its points are at (1.000, 1.000, 1.000)";
        assert_eq!(tube(&curve, 1.0, 8).unwrap_err().to_string(), no_length);
        assert!(tube(&curve, 0.0, 8).is_err() && tube(&curve, 1.0, 2).is_err());
        let back = vec![point, Point3::new(2.0, 1.0, 1.0), point];
        assert!(tube(&Curve::polyline(back, false).unwrap(), 0.1, 3).is_ok());
    }
}
