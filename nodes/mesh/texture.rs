//! Puts a texture on a mesh.
//!
//! `Texture` does not implement `update`: `Bound` computes nothing, and the window of `Planar` depends on the bounds of all vertices.

use continuation::{Unseen, continue_texture};
use maquette_node::{Carry, Context, Error, In, Node, Promise, Transfer, bail};
use maquette_value::parallel::*;
use maquette_value::{Attribute, CaptureFrame, Image, Mesh, RangeImage};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

mod capture_grid;
mod continuation;
mod hidden_faces;
mod pitch;
mod visibility;

/// Puts a texture on a mesh.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Texture {
    /// The mesh.
    pub mesh: In<Mesh>,
    /// The picture.
    pub image: In<Image>,
    /// The unmodified capture, from which `Planar` takes extents and camera; if omitted, those of the mesh. The capture sees a vertex if it
    /// is within 1.5 cells of the surface that the capture shows, on a face within 75 degrees of the line of sight. Elsewhere, as on a nose
    /// that has grown, texture coordinates are continued from the surroundings (a discrete harmonic map), so that the picture sticks to
    /// what it shows. If the camera is known and `scale` is 0, faces in whose place the picture shows something else, such as the back of
    /// an object or what an object in front hides, get colors that are continued from the surroundings; these are appended below the
    /// picture, and a warning says where.
    pub range: Option<In<RangeImage>>,
    /// Mapping from vertices to texture coordinates.
    #[serde(default)]
    pub mapping: Mapping,
}

/// A mapping from vertices to texture coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Mapping {
    /// The mesh's own texture coordinates. A mesh made of a capture has those of the unmodified capture, so that the picture sticks to what
    /// it shows.
    #[default]
    Bound,
    /// Projected along z, without perspective.
    Planar {
        /// Half the picture's width and height, in half extents of the object: 1 if the object fills the picture. 0 takes it from the
        /// camera; without a camera it is 1.
        #[schemars(extend("prefixItems" = [
            { "type": "number", "format": "double", "minimum": 0.0 },
            { "type": "number", "format": "double", "minimum": 0.0 },
        ]))]
        #[serde(default)]
        scale: (f64, f64),
    },
}

impl Node for Texture {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] = &[
        Carry::uniform("mesh", "mesh", Transfer::Kept).excluding(&["uv"]),
        Carry::cells("range", "mesh", Transfer::Dropped),
    ];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (mesh, image) = (cx.get(&self.mesh), cx.get(&self.image));
        let range = self.range.as_ref().map(|range| cx.get(range));
        let size = [image.width(), image.height()];
        if let Some(picture) = mesh.frame().map(|frame| frame.picture)
            && picture != size
        {
            cx.warn(format!(
                "the picture has {} x {} pixels, but that of the mesh's capture has {} x {}",
                size[0], size[1], picture[0], picture[1]
            ));
        }
        let textured = texture(mesh, image, range, self.mapping)?;
        let (Some(range), Mapping::Planar { scale }) = (range, self.mapping) else {
            return Ok((textured,));
        };
        let is_registered = scale == (0.0, 0.0) && range.camera().is_some();
        let continued = continue_texture(textured, image, range, is_registered, cx.progress())?;
        match continued.unseen {
            Unseen::Nothing => {}
            Unseen::Faces(count, at) => cx.warn(format!(
                "the capture does not see {count} of {} faces, first at ({:.1}, {:.1}, {:.1}) mm: their colors are continued from the \
                 surroundings; use `Bake` with captures from other sides to show what is there",
                mesh.faces().len(),
                at.x,
                at.y,
                at.z
            )),
            Unseen::Everything => cx.warn(
                "no vertex of the mesh is within 1.5 cells of what the capture shows, so the picture is projected onto all of it: check that \
                 `range` is the capture of this mesh, in the same frame",
            ),
        }
        Ok((continued.mesh,))
    }
}

/// Returns the mesh with the texture `image`, and with texture coordinates by `mapping`.
///
/// # Errors
/// Returns an error if the picture is empty, `Bound` finds no texture coordinates, or `Planar` finds no extents.
pub fn texture(
    mesh: &Mesh,
    image: &Image,
    range: Option<&RangeImage>,
    mapping: Mapping,
) -> Result<Mesh, Error> {
    if image.pixels().is_empty() {
        bail!(
            "the picture has {} x {} pixels, expected at least 1 x 1",
            image.width(),
            image.height()
        );
    }
    let mapped = match mapping {
        Mapping::Bound => {
            let bound = [mesh.vertex(), mesh.corner()].map(|attributes| attributes.pairs("uv"));
            if bound == [None; 2] {
                bail!(
                    "the mesh has no texture coordinates `uv` to be bound by: triangulate a capture first, or use `Planar`"
                );
            }
            mesh.clone()
        }
        Mapping::Planar { scale } => {
            let window = Window::new(mesh, range, scale.into())?;
            let uv = mesh.positions().par_iter().with_min_len(4096).map(|&p| window.uv(p));
            let uv: Vec<[f64; 2]> = uv.collect();
            mesh.clone().without_attribute("uv").with_vertex("uv", Attribute::Pair(uv.into()))?
        }
    };
    Ok(mapped.with_texture(Some(image.clone())))
}

/// The part of the object's x-y plane that a picture covers.
///
/// The planar mapping of the range-data redesign method: `s = (x + alpha a) / (2 alpha a)` and `t = (y + beta b) / (2 beta b)`. Here x and
/// y are measured from the axis of projection, with y up; `a` and `b` are half the extents of the object; `alpha a` and `beta b` are half
/// the picture's width and height in the object's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// The position of the axis of projection: the x and y of the object, in mm.
    pub axis: [f64; 2],
    /// The texture coordinates `(s, t)` at the axis of projection.
    pub center: [f64; 2],
    /// Half the picture's width and height (`alpha a`, `beta b`), in mm; not 0.
    pub half: [f64; 2],
    /// True if y points down in the picture, as in captures.
    pub y_down: bool,
}

impl Window {
    /// Returns the window of the capture from which `mesh` was made, or of `range` if given.
    ///
    /// With a camera, the axis is the camera's axis, at its principal point, and the size is the camera's field of view at the median depth
    /// `z`: `alpha a = (W / 2) z / fx`, with the picture's width `W` and the focal length `fx` in pixels. Without a camera the axis passes
    /// through the center of the object, and the object fills the picture. A `scale` (alpha, beta) other than 0 sets the size as a multiple
    /// of the object's half extents.
    ///
    /// # Errors
    /// Returns an error if the object has no points, or no extent to scale by.
    pub fn new(mesh: &Mesh, range: Option<&RangeImage>, scale: [f64; 2]) -> Result<Self, Error> {
        let frame = match range {
            Some(range) => Some(range.capture_frame()?),
            None => mesh.frame().copied(),
        };
        let (low, high) = match range {
            Some(range) => bounds((0..range.points().len()).filter_map(|cell| range.point(cell))),
            None => mesh.bounds(),
        }
        .unwrap_or_default();
        let middle = [0, 1].map(|k| low[k] / 2.0 + high[k] / 2.0);
        let extent = [0, 1].map(|k| high[k] / 2.0 - low[k] / 2.0);
        let seen = frame.as_ref().and_then(field_of_view);
        let mut half = extent;
        for k in 0..2 {
            half[k] = match (scale[k], &seen) {
                (0.0, Some(seen)) => seen.half[k],
                (0.0, None) => extent[k],
                (scale, _) => scale * extent[k],
            };
            if half[k].is_nan() || half[k] <= 0.0 {
                let axis = ['x', 'y'][k];
                bail!(
                    "the object has no extent along {axis}, by which the picture could be scaled; use `Transform` to turn it towards the z axis"
                );
            }
        }
        let y_down = frame.is_some();
        Ok(match seen {
            Some(seen) => Self { half, ..seen },
            None => Self { axis: middle, center: [0.5; 2], half, y_down },
        })
    }

    /// Returns the texture coordinates of a point. Both are from 0 to 1 inside of the window; outside, at least one is below 0 or above 1.
    pub fn uv(&self, point: Point3<f64>) -> [f64; 2] {
        let [x, y] = [0, 1].map(|k| (point[k] - self.axis[k]) / (2.0 * self.half[k]));
        [self.center[0] + x, self.center[1] + if self.y_down { -y } else { y }]
    }
}

/// Returns the field of view of a capture's camera at the median depth of the capture; `None` if the camera is not known.
fn field_of_view(frame: &CaptureFrame) -> Option<Window> {
    let camera = frame.camera?;
    let size = frame.picture.map(|size| size as f64);
    let half = [0, 1].map(|k| size[k] / 2.0 * frame.depth / camera.focal[k]);
    let [s, t] = [0, 1].map(|k| (camera.center[k] + 0.5) / size[k]);
    Some(Window { axis: [0.0; 2], center: [s, 1.0 - t], half, y_down: true })
}

fn bounds(points: impl Iterator<Item = Point3<f64>>) -> Option<(Point3<f64>, Point3<f64>)> {
    points.map(|point| (point, point)).reduce(|(low, high), (point, _)| {
        (low.coords.inf(&point.coords).into(), high.coords.sup(&point.coords).into())
    })
}

#[cfg(test)]
mod tests {
    use maquette_value::{Faces, Pinhole, Registration};

    use super::*;

    fn mesh(points: &[[f64; 3]]) -> Mesh {
        let positions: Vec<Point3<f64>> = points.iter().map(|&point| point.into()).collect();
        Mesh::new(positions, Faces::triangles(vec![])).unwrap()
    }

    fn picture(width: usize, height: usize) -> Image {
        Image::new(width, height, vec![[9; 3]; width * height]).unwrap()
    }

    fn planar(mesh: &Mesh, range: Option<&RangeImage>, scale: (f64, f64)) -> Vec<[f64; 2]> {
        let textured = texture(mesh, &picture(4, 4), range, Mapping::Planar { scale }).unwrap();
        textured.vertex().pairs("uv").unwrap().to_vec()
    }

    #[test]
    fn a_planar_picture_spans_alpha_times_the_object() {
        // The box extends from its center (10, 20) by 3 along x and by 2 along y, to both sides.
        let box_corners = [[7., 18., 0.], [13., 22., 5.]];
        assert_eq!(planar(&mesh(&box_corners), None, (0., 0.)), [[0., 0.], [1., 1.]]);
        let probes =
            [box_corners[0], box_corners[1], [4., 12., 0.], [16., 28., 0.], [10., 20., 9.]];
        let window = Window::new(&mesh(&box_corners), None, [2., 4.]).unwrap();
        let uv: Vec<_> = probes.iter().map(|&probe| window.uv(probe.into())).collect();
        assert_eq!(uv, [[0.25, 0.375], [0.75, 0.625], [0., 0.], [1., 1.], [0.5, 0.5]]);
    }

    /// Returns a capture of a slanted plane, 40 x 40 cells and 80 x 80 pixels, with an off-center camera.
    fn capture(camera: Option<Pinhole>) -> RangeImage {
        let sees = Pinhole { focal: [140.; 2], center: [17., 22.] };
        let points = (0..1600).map(|i| {
            let cell = [f64::from(i % 40), f64::from(i / 40)];
            sees.unproject(cell, 700. + 0.1 * cell[0])
        });
        let map = Registration { scale: [2.; 2], offset: [0.5; 2], picture: [80, 80] };
        RangeImage::new(40, 40, points.collect())
            .unwrap()
            .with_camera(camera)
            .with_registration(map)
    }

    #[test]
    fn what_has_grown_keeps_the_picture_of_its_surroundings() {
        let range = capture(None);
        let has_grown = |cell: usize| {
            let [column, row] = [cell % 40, cell / 40];
            (14..26).contains(&column) && (14..26).contains(&row)
        };
        // The square in the middle has moved towards the sensor and sideways, in front of other parts.
        let positions = (0..1600).map(|cell| {
            let at = range.points()[cell];
            if has_grown(cell) { at + nalgebra::Vector3::new(60., 0., -80.) } else { at }
        });
        let cells = (0..1560_u32).filter(|cell| cell % 40 != 39);
        let faces = cells.flat_map(|k| [[k, k + 40, k + 41], [k, k + 41, k + 1]]);
        let mesh =
            Mesh::new(positions.collect::<Vec<_>>(), Faces::triangles(faces.collect())).unwrap();
        let before =
            planar(&mesh.with_positions(range.points().to_vec()).unwrap(), Some(&range), (0., 0.));
        let mapping = Mapping::Planar { scale: (0., 0.) };
        let projected = texture(&mesh, &picture(4, 4), Some(&range), mapping).unwrap();
        let progress = maquette_node::Progress::silent();
        let (image, before_it) = (picture(4, 4), projected.clone());
        let found = continue_texture(before_it, &image, &range, false, &progress).unwrap().mesh;
        let [projected, found] =
            [&projected, &found].map(|it| it.vertex().pairs("uv").unwrap().clone());
        for cell in 0..1600 {
            let off = (0..2).map(|k| (found[cell][k] - before[cell][k]).abs()).fold(0., f64::max);
            if has_grown(cell) {
                assert!(off < 0.1 && (projected[cell][0] - before[cell][0]).abs() > 0.2, "{off}");
            } else {
                assert_eq!(found[cell], projected[cell]);
            }
        }
    }

    // The picture must be upright, and agree with the registration within a few pixels.
    #[test]
    fn a_planar_picture_is_where_the_camera_saw_it() {
        let camera = Pinhole { focal: [140.; 2], center: [17., 22.] };
        let range = capture(Some(camera));
        let frame = range.capture_frame().unwrap();
        let mesh = Mesh::new(range.points().to_vec(), Faces::triangles(vec![])).unwrap();
        for (mesh, range) in
            [(mesh.clone(), Some(&range)), (mesh.clone().with_frame(Some(frame)), None)]
        {
            for (cell, uv) in planar(&mesh, range, (0., 0.)).into_iter().enumerate() {
                let cell = [(cell % 40) as f64, (cell / 40) as f64];
                let expected = capture(None).registration().uv_from_range(cell);
                let error = [0, 1].map(|k| (uv[k] - expected[k]) * 80.);
                assert!(error.iter().all(|error| error.abs() < 0.3), "{cell:?} {error:?}");
            }
        }
    }

    #[test]
    fn without_a_camera_a_capture_fills_the_picture_upright() {
        let range = capture(None);
        let mesh = Mesh::new(range.points().to_vec(), Faces::triangles(vec![])).unwrap();
        let uv = planar(&mesh, Some(&range), (0., 0.));
        fn span(k: usize, uv: &[[f64; 2]]) -> [f64; 2] {
            uv.iter().fold([1., 0.], |[low, high]: [f64; 2], uv| [low.min(uv[k]), high.max(uv[k])])
        }
        assert!(
            [span(0, &uv), span(1, &uv)]
                .iter()
                .all(|[low, high]| low.abs() + (high - 1.).abs() < 1e-12)
        );
        assert!(uv[0][1] > 0.9 && uv[1599][1] < 0.1, "row 0 is on top");
    }

    #[test]
    fn bound_coordinates_do_not_change_when_vertices_move() {
        let uv = vec![[0.1, 0.7], [0.3, 0.2]];
        let bound =
            mesh(&[[0.; 3], [1.; 3]]).with_vertex("uv", Attribute::Pair(uv.into())).unwrap();
        let moved = bound.with_positions(vec![Point3::new(5., 6., 7.); 2]).unwrap();
        let textured = texture(&moved, &picture(2, 2), None, Mapping::Bound).unwrap();
        assert_eq!(textured.vertex().pairs("uv"), bound.vertex().pairs("uv"));
        assert_eq!(textured.texture(), Some(&picture(2, 2)));
    }

    #[test]
    fn planar_coordinates_replace_those_at_corners() {
        let positions = vec![Point3::origin(), Point3::new(1., 0., 0.), Point3::new(0., 1., 0.)];
        let mesh = Mesh::new(positions, Faces::triangles(vec![[0, 1, 2]])).unwrap();
        let mesh = mesh.with_corner("uv", Attribute::Pair(vec![[0.; 2]; 3].into())).unwrap();
        assert!(texture(&mesh, &picture(1, 1), None, Mapping::Bound).is_ok());
        let planar = Mapping::Planar { scale: (0., 0.) };
        let planar = texture(&mesh, &picture(1, 1), None, planar).unwrap();
        assert_eq!(planar.corner().pairs("uv"), None);
    }

    #[test]
    fn what_gives_no_coordinates_is_an_error() {
        let line = mesh(&[[0.; 3], [1., 0., 0.]]);
        fn error(image: Image, mapping: Mapping, line: &Mesh) -> String {
            texture(line, &image, None, mapping).unwrap_err().to_string()
        }
        let flat = Mapping::Planar { scale: (0., 0.) };
        assert_eq!(
            error(picture(1, 1), Mapping::Bound, &line),
            "the mesh has no texture coordinates `uv` to be bound by: triangulate a capture first, or use `Planar`"
        );
        assert_eq!(
            error(picture(0, 1), flat, &line),
            "the picture has 0 x 1 pixels, expected at least 1 x 1"
        );
        assert_eq!(
            error(picture(1, 1), flat, &line),
            "the object has no extent along y, by which the picture could be scaled; use `Transform` to turn it towards the z axis"
        );
        let scale = (1., f64::NAN);
        assert!(texture(&line, &picture(1, 1), None, Mapping::Planar { scale }).is_err());
    }
}
