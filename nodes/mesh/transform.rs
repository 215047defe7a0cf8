//! Moves, rotates and scales.

use maquette_node::{
    Carry, Context, Error, Forecast, In, Node, Previous, Promise, Sizes, Transfer,
};
use maquette_value::{Attribute, ControlNet, ControlNetError, Mesh, Points, PointsError};
use schemars::{JsonSchema, json_schema};
use serde::{Deserialize, Serialize};

use super::followed::{Part, move_vertices};
use super::motion::Motion;
use super::movable::Movable;
use super::moved_mesh::{moved_frame, moved_mesh};

/// Moves, rotates and scales a mesh, a range image, points, a curve or a control net.
///
/// The value is first scaled about the origin, then rotated about the x, the y and the z axis in this order, then translated. The result
/// has the type of the input. A mirrored mesh (one or three negative scales) has its faces reversed, so that they still face outward.
/// Normals are rotated, too; other attributes do not change.
///
/// A moved value no longer has the position that its camera saw: camera and pose are dropped, unless nothing moves. Texture coordinates and
/// the registration of a range image stay.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Transform {
    /// The value: a mesh, a range image, points, a curve or a control net.
    pub mesh: In<Movable>,
    /// Translation along x, y and z in mm.
    #[schemars(extend("unit" = "mm"))]
    #[serde(default)]
    pub translate: [f64; 3],
    /// Rotation angles about x, y and z in degrees; positive angles are counter-clockwise seen against the axis.
    #[schemars(extend("unit" = "deg"))]
    #[serde(default)]
    pub rotate: [f64; 3],
    /// Factors along x, y and z; not 0, and negative ones mirror.
    #[schemars(extend("items" = json_schema!({ "type": "number", "format": "double", "nonzero": true })))]
    #[serde(default = "default_scale")]
    pub scale: [f64; 3],
    /// Drops the capture frame of a mesh or net, so that its files have its coordinates unchanged, y down and z away from the sensor.
    /// Otherwise captured values are rotated upright in files for viewers.
    #[serde(default)]
    pub sensor_axes: bool,
}

fn default_scale() -> [f64; 3] {
    [1.0; 3]
}

impl Node for Transform {
    type Outputs = (Movable,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] =
        &[Carry::uniform("mesh", "mesh", Transfer::Kept).and_cells(Transfer::Kept)];

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        Some(Forecast::by_law(sizes.get(&self.mesh)?))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let moved = transform(&cx.get(&self.mesh), &self.motion()?)?;
        Ok((if self.sensor_axes { without_frame(moved) } else { moved },))
    }

    /// If only some vertices of a mesh have moved since the last evaluation, moves only these vertices in the last result. Otherwise
    /// returns `None`.
    fn update(
        &self,
        cx: &Context<'_>,
        previous: &Previous<'_>,
    ) -> Result<Option<Self::Outputs>, Error> {
        let motion = self.motion()?;
        let meshes = (cx.get(&self.mesh), previous.get(&self.mesh), previous.output(0));
        let (Movable::Mesh(mesh), Movable::Mesh(before), Some(made)) = meshes else {
            return Ok(None);
        };
        let moved = follow(&mesh, &before, made, &motion).map(Movable::Mesh);
        Ok(moved.map(|moved| (if self.sensor_axes { without_frame(moved) } else { moved },)))
    }
}

impl Transform {
    fn motion(&self) -> Result<Motion, Error> {
        Motion::new(self.translate, self.rotate, self.scale)
    }
}

/// Maximum fraction of moved vertices for which the last result is updated. Above this fraction, computing a new mesh is faster: for five
/// million vertices, both methods are equally fast if a fifth has moved. The limit does not apply to a mirrored mesh, because a new mesh
/// would also need its faces reversed.
const MAX_MOVED_FRACTION: f64 = 0.2;

/// Updates `made`, the last result of [`transform`]; returns `None` if anything else than positions and normals of vertices has changed.
fn follow(mesh: &Mesh, before: &Mesh, made: &Mesh, motion: &Motion) -> Option<Mesh> {
    if motion.is_identity() {
        return None;
    }
    let part = Part { before, now: mesh, motion: Some(*motion) };
    let most = if motion.is_mirror() { 1.0 } else { MAX_MOVED_FRACTION };
    let followed = move_vertices(made, &[part], most)?;
    Some(followed.with_materials(mesh.materials().clone()).with_frame(moved_frame(mesh)))
}

/// Applies a motion to the points of any movable value; see [`Transform`] for the other data.
///
/// # Errors
/// Returns an error if a coordinate becomes infinite.
pub fn transform(what: &Movable, motion: &Motion) -> Result<Movable, Error> {
    if motion.is_identity() {
        return Ok(what.clone());
    }
    Ok(match what {
        Movable::Mesh(mesh) => Movable::Mesh(moved_mesh(mesh, motion)?),
        Movable::RangeImage(range) => Movable::RangeImage(
            range
                .with_points(motion.apply_all(range.points()))?
                .with_camera(None)
                .with_world_from_camera(None),
        ),
        Movable::Points(points) => Movable::Points(moved_points(points, motion)?),
        Movable::Curve(curve) => {
            Movable::Curve(curve.with_points(motion.apply_all(curve.points()))?)
        }
        Movable::ControlNet(net) => Movable::ControlNet(moved_net(net, motion)?),
    })
}

/// Returns the value without its capture frame, so that its coordinates are written to files unchanged.
fn without_frame(what: Movable) -> Movable {
    match what {
        Movable::Mesh(mesh) => Movable::Mesh(mesh.with_frame(None)),
        Movable::ControlNet(net) => Movable::ControlNet(net.with_frame(None)),
        other => other,
    }
}

fn moved_points(points: &Points, motion: &Motion) -> Result<Points, PointsError> {
    let moved = points.with_positions(motion.apply_all(points.positions()))?;
    match points.attributes().vectors("normal").zip(motion.normals()) {
        Some((normals, turn)) => {
            let normals = normals.iter().map(turn).collect();
            moved.with_attribute("normal", Attribute::Vector(normals))
        }
        None => Ok(moved),
    }
}

fn moved_net(net: &ControlNet, motion: &Motion) -> Result<ControlNet, ControlNetError> {
    let moved = ControlNet::new(net.rows(), net.columns(), motion.apply_all(net.base()))?
        .with_points(motion.apply_all(net.points()))?
        .with_weights(net.weights().to_vec())?
        .with_fixed(net.fixed_points().to_vec())?;
    Ok(match net.chart() {
        Some(chart) => moved.with_chart(chart.clone()),
        None => moved,
    })
}

#[cfg(test)]
mod tests {
    use maquette_value::hash_of;
    use maquette_value::{Curve, Faces, Pinhole, RangeImage};
    use nalgebra::{Point3, Vector3};

    use super::*;

    /// Returns a tetrahedron at the origin, with faces that look outward.
    fn tetrahedron() -> Mesh {
        fn point(x: f64, y: f64, z: f64) -> Point3<f64> {
            Point3::new(x, y, z)
        }
        let positions =
            vec![point(0., 0., 0.), point(1., 0., 0.), point(0., 1., 0.), point(0., 0., 1.)];
        let faces = Faces::triangles(vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]);
        let mesh = Mesh::new(positions, faces).unwrap();
        let normals = mesh.vertex_normals().into_iter().map(Into::into).collect();
        mesh.with_vertex("normal", Attribute::Vector(normals))
            .unwrap()
            .with_corner("uv", Attribute::Pair((0..12).map(|k| [f64::from(k), 0.0]).collect()))
            .unwrap()
    }

    fn transform_mesh(mesh: &Mesh, translate: [f64; 3], rotate: [f64; 3], scale: [f64; 3]) -> Mesh {
        let motion = Motion::new(translate, rotate, scale).unwrap();
        match transform(&Movable::Mesh(mesh.clone()), &motion) {
            Ok(Movable::Mesh(mesh)) => mesh,
            other => panic!("a mesh became {other:?}"),
        }
    }

    /// Returns six times the signed volume of a mesh.
    fn volume(mesh: &Mesh) -> f64 {
        fn position(vertex: u32, mesh: &Mesh) -> Vector3<f64> {
            mesh.positions()[vertex as usize].coords
        }
        mesh.faces()
            .iter()
            .map(|face| {
                position(face[0], mesh)
                    .cross(&position(face[1], mesh))
                    .dot(&position(face[2], mesh))
            })
            .sum()
    }

    #[test]
    fn scaling_comes_first_then_x_y_z_then_moving() {
        let motion = Motion::new([0., 0., 5.], [90., 90., 0.], [2., 3., 1.]).unwrap();
        fn corner(x: f64, y: f64, z: f64, motion: &Motion) -> Point3<f64> {
            motion.apply(Point3::new(x, y, z))
        }
        assert_eq!(corner(1., 0., 0., &motion), Point3::new(0., 0., 3.));
        assert_eq!(corner(0., 1., 0., &motion), Point3::new(3., 0., 5.));
        let turned = Motion::new([0.; 3], [0., 0., 30.], [1.; 3]).unwrap();
        let expected = Point3::new(f64::sqrt(0.75), 0.5, 0.);
        assert!((turned.apply(Point3::new(1., 0., 0.)) - expected).norm() < 1e-15);
    }

    #[test]
    fn a_mirrored_mesh_stays_right_side_out() {
        let mesh = tetrahedron();
        let mirrored = transform_mesh(&mesh, [0.; 3], [10., 20., 30.], [-1., 2., 1.]);
        assert!((volume(&mirrored) - 2.0 * volume(&mesh)).abs() < 1e-12);
        assert_eq!(mirrored.corner().pairs("uv").unwrap()[..3], [[0., 0.], [2., 0.], [1., 0.]]);
        assert_eq!(
            transform_mesh(&mirrored, [0.; 3], [0.; 3], [1., 1., -1.]).faces(),
            mesh.faces()
        );
    }

    #[test]
    fn normals_stay_normal_to_what_is_stretched_or_mirrored() {
        let face = Faces::triangles(vec![[0, 1, 2]]);
        let positions =
            vec![Point3::new(1., 0., 0.), Point3::new(0., 1., 0.), Point3::new(0., 0., 1.)];
        let mesh = Mesh::new(positions, face).unwrap();
        let normals = mesh.vertex_normals().into_iter().map(Into::into).collect();
        let mesh = mesh.with_vertex("normal", Attribute::Vector(normals)).unwrap();
        for scale in [[3., 1., 0.5], [-1., 1., 1.]] {
            let stretched = transform_mesh(&mesh, [1., 2., 3.], [40., 0., 7.], scale);
            let expected = stretched.vertex_normals()[0];
            let normal = Vector3::from(stretched.vertex().vectors("normal").unwrap()[0]);
            assert!((normal - expected).norm() < 1e-14, "{normal} {expected}");
        }
    }

    #[test]
    fn vertices_that_have_moved_are_moved_on_with_their_normals() {
        let before = tetrahedron();
        let on_corners = Attribute::Vector(vec![[0.6, 0., 0.8]; 12].into());
        let before_at_corners = before.clone().with_corner("normal", on_corners).unwrap();
        for before in [&before, &before.clone().without_attribute("normal"), &before_at_corners] {
            let places = [Point3::new(-0., 2., 0.), Point3::new(0., 1., 4.)];
            let mut now = before.with_moved(&[0..1, 3..4], &places).unwrap();
            if let Some(normals) = before.vertex().vectors("normal") {
                let turned = normals.with_rows(&[1..2, 2..3], &[[0., 0.6, 0.8], [1., 0., 0.]]);
                now = now.with_vertex("normal", Attribute::Vector(turned)).unwrap();
            }
            if let Some(normals) = before.corner().get("normal") {
                now = now.with_corner("normal", normals.clone()).unwrap();
            }
            for scale in [[1., 2., 0.5], [-1., 1., 1.]] {
                let motion = Motion::new([1., 2., 3.], [10., 20., 30.], scale).unwrap();
                let [made, expected] =
                    [before, &now].map(|mesh| moved_mesh(mesh, &motion).unwrap());
                let followed =
                    |now| move_vertices(&made, &[Part { before, now, motion: Some(motion) }], 0.5);
                assert_eq!(hash_of(&followed(&now).unwrap()), hash_of(&expected), "{scale:?}");
                assert_eq!(followed(&now.clone().without_attribute("uv")), None);
                // Half of the vertices have moved, which is too many for an update of the last result, unless the mesh is mirrored.
                let pays = follow(&now, before, &made, &motion).is_some();
                assert_eq!(pays, motion.is_mirror());
            }
        }
    }

    #[test]
    fn a_scale_of_zero_is_an_error() {
        let error = Motion::new([0.; 3], [0.; 3], [1., 0., 1.]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the scale along y is 0, but it must be a number other than 0"
        );
    }

    #[test]
    fn a_range_image_forgets_its_camera_only_if_it_moves() {
        let camera = Pinhole { focal: [1.; 2], center: [0.; 2] };
        let points = vec![Point3::new(0., 0., 5.), Point3::new(f64::NAN, 0., 0.)];
        let range = RangeImage::new(2, 1, points).unwrap().with_camera(Some(camera));
        fn shift_along_x(shift: f64, range: &RangeImage) -> RangeImage {
            let motion = Motion::new([0., 0., shift], [0.; 3], [1.; 3]).unwrap();
            match transform(&Movable::RangeImage(range.clone()), &motion) {
                Ok(Movable::RangeImage(range)) => range,
                other => panic!("a range image became {other:?}"),
            }
        }
        assert_eq!(shift_along_x(0., &range), range);
        assert_eq!(
            (shift_along_x(2., &range).point(0), shift_along_x(2., &range).point(1)),
            (Some(Point3::new(0., 0., 7.)), None)
        );
        assert_eq!(shift_along_x(2., &range).camera(), None);
    }

    #[test]
    fn a_net_moves_with_its_base() {
        let net = ControlNet::new(1, 2, vec![Point3::origin(); 2]).unwrap();
        let net = net.with_points(vec![Point3::new(0., 0., 1.); 2]).unwrap();
        let net = net.with_weights(vec![1., 2.]).unwrap();
        let motion = Motion::new([1., 0., 0.], [0.; 3], [1., 1., 4.]).unwrap();
        let Ok(Movable::ControlNet(moved)) = transform(&Movable::ControlNet(net), &motion) else {
            panic!("a net stays a net");
        };
        assert_eq!(moved.base()[1], Point3::new(1., 0., 0.));
        assert_eq!(moved.points()[1], Point3::new(1., 0., 4.));
        assert_eq!(moved.weights(), [1., 2.]);
    }

    #[test]
    fn points_move_with_their_normals_and_curves_with_their_weights() {
        let motion = Motion::new([1., 0., 0.], [0., 0., 90.], [1., 1., -2.]).unwrap();
        let points = Points::new(vec![Point3::new(2., 0., 3.)]).unwrap();
        let normals = Attribute::Vector(vec![[0., 0.6, 0.8]].into());
        let points = points.with_attribute("normal", normals).unwrap();
        let kept = Attribute::Vector(vec![[7., 8., 9.]].into());
        let points = points.with_attribute("other", kept).unwrap();
        let Ok(Movable::Points(moved)) = transform(&Movable::Points(points), &motion) else {
            panic!("points stay points");
        };
        assert_eq!(moved.positions()[0], Point3::new(1., 2., -6.));
        let normal = Vector3::from(moved.attributes().vectors("normal").unwrap()[0]);
        assert!((normal - Vector3::new(-0.6, 0., -0.4).normalize()).norm() <= 1e-15);
        assert_eq!(moved.attributes().vectors("other").unwrap()[0], [7., 8., 9.]);

        let knots = maquette_value::KnotVector::uniform(3, 3).unwrap();
        fn point(x: f64, y: f64) -> Point3<f64> {
            Point3::new(x, y, 1.0)
        }
        let places = vec![point(0., 0.), point(1., 0.), point(1., 1.)];
        let curve = Curve::rational(places, vec![1., 2., 1.], knots).unwrap();
        let Ok(Movable::Curve(moved)) = transform(&Movable::Curve(curve.clone()), &motion) else {
            panic!("a curve stays a curve");
        };
        assert_eq!(moved.weights(), curve.weights());
        assert!((moved.point(0.3) - motion.apply(curve.point(0.3))).norm() <= 1e-14);
    }
}
