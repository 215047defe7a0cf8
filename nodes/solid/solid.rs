//! Makes a solid of a surface.

use maquette_fill::{FillMethod, HoleChoice, fill_holes};
use maquette_mesh::{Outside, orient};
use maquette_node::{Carry, Context, Error, In, Node, Progress, Promise, Transfer, Want, bail};
use maquette_value::{Bounds, Mesh};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::base::{Ground, visible_part, with_base};
use crate::repair::{self, Repaired};
use crate::thicken::{ThinWalls, thicken};

/// Makes a solid of a surface: a front side gets walls and a flat base, and a nearly closed surface is closed.
///
/// The result is closed, manifold and oriented outward, so that it can be printed. Existing faces stay. Walls and base have the attributes
/// of the border that they start from, and filled holes those that `FillHoles` interpolates.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Solid {
    /// The surface.
    pub mesh: In<Mesh>,
    /// The base of the solid.
    #[serde(default)]
    pub base: Base,
    /// Minimum thickness of walls in mm, measured straight inward from each face, so that `Printable` holds: thinner parts grow equally on
    /// both sides, but not through a flat base. 0 leaves them as they are.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub thickness: f64,
    /// Treatment of faces that cross each other.
    #[serde(default)]
    pub repair: Repair,
}

/// Treatment of a solid whose faces cross each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Repair {
    /// Faces that cross are an error.
    #[default]
    None,
    /// What is enclosed more than once is united: the result is the surface of all places with a positive winding number. Faces are divided
    /// exactly along their crossings, and nothing moves, as in Zhou, Grinspun, Zorin and Jacobson, "Mesh arrangements for solid geometry"
    /// (2016). Only if rounding makes that impossible, the whole surface is rebuilt from voxels, by its distance signed by the winding
    /// number (Jacobson, Kavan and Sorkine-Hornung, "Robust inside-outside segmentation using generalized winding numbers", 2013). A
    /// warning names the place, and how far the surface moved.
    Voxels {
        /// Edge length of the voxels in mm; 0 means the mean edge length, but at least 1/200 of the extent.
        #[schemars(range(min = 0.0), extend("unit" = "mm"))]
        #[serde(default)]
        size: f64,
    },
}

/// The base of a solid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Base {
    /// Walls from each border to a flat base. For a capture they extend away from the sensor, so that they touch no captured face; faces
    /// that the sensor cannot have seen, because they look away from it, are removed.
    Flat {
        /// Distance of the base behind the farthest point, in mm.
        #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
        #[serde(default = "default_behind")]
        behind: f64,
        /// Direction opposite to the base, for a mesh without a capture; its length is ignored. If omitted, the mean direction of the
        /// faces.
        #[schemars(extend("direction" = true))]
        #[serde(default)]
        up: Option<[f64; 3]>,
        /// Treatment of holes.
        #[serde(default)]
        holes: Holes,
    },
    /// No base: holes of the mesh are filled with the smoothest surface, so that it encloses a volume.
    Keep,
}

/// Treatment of holes in front of a base.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Holes {
    /// Holes are filled with a surface of least area first.
    #[default]
    Fill,
    /// Holes continue through the base.
    Through,
}

fn default_behind() -> f64 {
    3.0
}

impl Default for Base {
    fn default() -> Self {
        Self::Flat { behind: default_behind(), up: None, holes: Holes::Fill }
    }
}

impl Node for Solid {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const WANTS: &'static [Want<Self>] = &[
        Want::new("mesh", "NonEmpty"),
        Want::new("mesh", "Manifold"),
        Want::new("mesh", "Oriented"),
    ];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::always("mesh", "Closed"),
        Promise::always("mesh", "Manifold"),
        Promise::always("mesh", "Oriented"),
        Promise::always("mesh", "NonEmpty"),
        Promise::from("mesh", "Triangles", "mesh"),
    ];

    const CARRIES: &'static [Carry] = &[Carry::per_domain(
        "mesh",
        "mesh",
        [Transfer::Interpolated, Transfer::Interpolated, Transfer::Kept, Transfer::Kept],
    )];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        let SolidMesh { mesh, unseen, thin, repaired } =
            solid(mesh, &self.base, self.thickness, self.repair, cx.progress())?;
        if let Some(repaired) = repaired {
            cx.warn(repaired);
        }
        if unseen > 0 {
            let faces = if unseen == 1 { "face is" } else { "faces are" };
            cx.warn(format!("{unseen} {faces} left out: they look away from the sensor, or are connected by a single vertex where such a face was"));
        }
        if let Some(thin) = thin {
            cx.warn(thin.warning(self.thickness));
        }
        Ok((mesh,))
    }
}

/// A solid, the number of faces that were removed, and the walls that are too thin.
#[derive(Clone, Debug, PartialEq)]
pub struct SolidMesh {
    /// The solid's surface.
    pub mesh: Mesh,
    /// The number of faces that were removed because the sensor cannot have seen them.
    pub unseen: usize,
    /// The walls that are thinner than requested.
    pub thin: Option<ThinWalls>,
    /// A description of the repair of faces that crossed each other.
    pub repaired: Option<String>,
}

/// Makes a solid of a surface, see [`Solid`]; its walls have at least the thickness `thickness` in mm.
///
/// # Errors
/// Returns an error if the result is not a solid, a thickness is invalid, or the evaluation is cancelled.
pub fn solid(
    mesh: &Mesh,
    base: &Base,
    thickness: f64,
    repair: Repair,
    progress: &Progress<'_>,
) -> Result<SolidMesh, Error> {
    if !(0.0 <= thickness && thickness.is_finite()) {
        bail!("`thickness` is {thickness}, but must be a number from 0 on");
    }
    let (solid, unseen, floor) = match *base {
        Base::Flat { behind, up, holes } => {
            let ground = Ground::of_mesh(mesh, behind, up)?;
            let front = match ground {
                Ground::Seen(_) => visible_part(mesh, &ground),
                Ground::Below(..) => mesh.clone(),
            };
            let unseen = mesh.faces().len() - front.faces().len();
            let front = match holes {
                Holes::Through => front,
                Holes::Fill => {
                    progress
                        .part(0.0..0.5, |progress| {
                            fill_holes(&front, &HoleChoice::All, &FillMethod::Membrane, progress)
                        })?
                        .mesh
                }
            };
            (with_base(&front, &ground)?, unseen, Some(ground.floor()))
        }
        Base::Keep => (progress.part(0.0..0.5, |progress| close(mesh, progress))?, 0, None),
    };
    let crossing = progress.part(0.5..0.55, |progress| solid.crossings(|| progress.check()))?;
    let (solid, repaired) = match (crossing.is_empty(), repair) {
        (true, _) => (solid, None),
        (false, Repair::None) => {
            let at = center(&solid, crossing[0][0]);
            bail!(
                "the solid would intersect itself: {} pairs of faces cross, the first one at ({:.3}, {:.3}, {:.3}); use `repair: Voxels()` to unite what crosses, or `Reconstruct` to make one surface of the data",
                crossing.len(),
                at.x,
                at.y,
                at.z
            )
        }
        (false, Repair::Voxels { size }) => {
            let repaired =
                progress.part(0.55..0.6, |progress| repair::repair(&solid, size, progress))?;
            let report = describe_repair(&solid, &crossing, &repaired);
            (repaired.mesh, Some(report))
        }
    };
    if thickness == 0.0 {
        return Ok(SolidMesh { mesh: solid, unseen, thin: None, repaired });
    }
    let (mesh, thin) =
        progress.part(0.6..1.0, |progress| thicken(&solid, thickness, floor, progress))?;
    Ok(SolidMesh { mesh, unseen, thin, repaired })
}

fn center(mesh: &Mesh, face: u32) -> Point3<f64> {
    mesh.first_triangle_center(mesh.faces().face(face as usize))
}

/// Returns a warning that tells where faces crossed, and how far the repaired surface is from the old one.
fn describe_repair(solid: &Mesh, crossing: &[[u32; 2]], repaired: &Repaired) -> String {
    let places: Vec<_> = crossing.as_flattened().iter().map(|&it| center(solid, it)).collect();
    let Bounds { low, high } = Bounds::from_points(&places);
    let how = match repaired.voxels {
        None => "what they enclosed twice is united".to_owned(),
        Some(size) => format!("the whole surface is rebuilt from voxels of {size:.3} mm"),
    };
    format!(
        "{} pairs of faces crossed between ({:.3}, {:.3}, {:.3}) and ({:.3}, {:.3}, {:.3}): {how}; the surface moved by at most {:.2e} mm, RMS {:.2e} mm",
        crossing.len(),
        low.x,
        low.y,
        low.z,
        high.x,
        high.y,
        high.z,
        repaired.largest,
        repaired.rms
    )
}

/// Returns the mesh with its holes filled and all faces oriented outward.
fn close(mesh: &Mesh, progress: &Progress<'_>) -> Result<Mesh, Error> {
    let filled = fill_holes(mesh, &HoleChoice::All, &FillMethod::ThinPlate, progress)?.mesh;
    let filled = orient(&filled, Outside::Outward)?.mesh;
    match filled.edges().faces.iter().filter(|faces| **faces == 1).count() {
        0 => Ok(filled),
        count => match filled.count_unjoined() {
            0 => bail!(
                "{count} edges of the mesh are still open after its holes are filled: the border around an open scan is not a hole; use `base: Flat()` to give it walls"
            ),
            unjoined => bail!(
                "{count} edges of the mesh are still open after its holes are filled, and {unjoined} vertices share a position with another; use `Weld` to join them"
            ),
        },
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::{Attribute, CaptureFrame, Faces};
    use nalgebra::Vector3;

    use super::*;

    /// Returns a grid of 9 x 9 points over 8 x 8 mm with the given heights, without the cells in `hole`.
    fn net(height: impl Fn(f64, f64) -> f64, hole: &[u32]) -> Mesh {
        let places = (0..81).map(|k| [f64::from(k % 9) - 4.0, f64::from(k / 9) - 4.0]);
        let positions = places.map(|[x, y]| Point3::new(x, y, height(x, y))).collect::<Vec<_>>();
        let cells = (0..72).filter(|k| k % 9 < 8 && !hole.contains(k));
        let faces = cells.flat_map(|k| [[k, k + 1, k + 10], [k, k + 10, k + 9]]).collect();
        Mesh::new(positions, Faces::triangles(faces)).unwrap()
    }

    fn flat_base(mesh: &Mesh, behind: f64, up: Option<[f64; 3]>) -> Result<Mesh, Error> {
        let base = Base::Flat { behind, up, holes: Holes::Through };
        Ok(solid(mesh, &base, 0.0, Repair::None, &Progress::silent())?.mesh)
    }

    fn volume(mesh: &Mesh) -> f64 {
        crate::volume::volume(mesh, Point3::origin())
    }

    #[track_caller]
    fn check(found: &Mesh, expected: f64) {
        let edges = found.edges();
        assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2));
        assert!((volume(found) - expected).abs() < 1e-9 * expected, "{}", volume(found));
    }

    #[test]
    fn a_relief_gets_walls_and_a_base() {
        let relief = net(|x, y| 0.1 * x + 0.05 * y, &[]);
        // The middle of the relief is 0.6 mm above the lowest corner.
        check(&flat_base(&relief, 2.0, Some([0., 0., 3.])).unwrap(), 64.0 * 2.6);
        let curved = net(|x, y| (x * y).abs() * 0.1, &[]);
        let found = flat_base(&curved, 1.0, None).unwrap();
        let lowest = found.positions().iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
        assert!((lowest + 1.0).abs() < 1e-9);
        assert_eq!(found.positions()[..81], curved.positions()[..]);
    }

    #[test]
    fn holes_continue_through_the_base() {
        let relief = net(|_, _| 0.0, &[40, 41, 20]);
        check(&flat_base(&relief, 2.0, None).unwrap(), 61.0 * 2.0);
        let base = Base::Flat { behind: 2.0, up: None, holes: Holes::Fill };
        check(
            &solid(&relief, &base, 0.0, Repair::None, &Progress::silent()).unwrap().mesh,
            64.0 * 2.0,
        );
    }

    #[test]
    fn what_a_sensor_cannot_have_seen_is_left_out() {
        let frame =
            CaptureFrame { camera: None, picture: [2, 2], depth: 20.0, world_from_camera: None };
        let seen = orient(&net(|_, _| 20.0, &[]), Outside::Flip).unwrap().mesh;
        // Move one vertex past its neighbors, as noise may do, which makes a fold.
        let mut moved = seen.positions().to_vec();
        moved[40] += Vector3::new(2.5, 0.2, 0.1);
        let folded = seen.with_positions(moved).unwrap().with_frame(Some(frame));
        let found =
            solid(&folded, &Base::default(), 0.0, Repair::None, &Progress::silent()).unwrap();
        let SolidMesh { mesh: found, unseen, .. } = found;
        assert!((1..10).contains(&unseen), "{unseen}");
        let edges = found.edges();
        assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2));
    }

    #[test]
    fn walls_of_a_capture_run_away_from_the_sensor() {
        let frame =
            CaptureFrame { camera: None, picture: [2, 2], depth: 20.0, world_from_camera: None };
        // In the coordinates of the sensor, y is down and z away from the sensor, so the faces look to -z.
        let seen = net(|x, y| 20.0 - 0.1 * (x * x + y * y), &[]);
        let seen = orient(&seen, Outside::Flip).unwrap().mesh.with_frame(Some(frame));
        let found = flat_base(&seen, 5.0, None).unwrap();
        assert!(volume(&found) > 0.0);
        fn ray(at: &Point3<f64>) -> [f64; 2] {
            [at.x / at.z, at.y / at.z]
        }
        let corner = ray(&found.positions()[0]);
        let foot = found.positions()[81..]
            .iter()
            .find(|at| (0..2).all(|k| (ray(at)[k] - corner[k]).abs() < 1e-12))
            .unwrap();
        assert!((foot.z - 25.0).abs() < 1e-12);
    }

    #[test]
    fn new_elements_have_the_attributes_of_the_border() {
        let relief = net(|_, _| 0.0, &[]);
        let colors = Attribute::Color((0..81).map(|k| [k, 0, 0]).collect());
        let parts = Attribute::Index((0..128).collect());
        let relief = relief.with_vertex("color", colors).unwrap().with_face("part", parts).unwrap();
        let found = flat_base(&relief, 2.0, None).unwrap();
        let colors = found.vertex().colors("color").unwrap();
        for (at, color) in found.positions().iter().zip(colors.iter()) {
            assert_eq!(f64::from(color[0]), (at.x + 4.0) + 9.0 * (at.y + 4.0));
        }
    }

    #[test]
    fn a_nearly_closed_mesh_is_closed() {
        let relief = net(|x, y| 4.0 - 0.1 * (x * x + y * y), &[]);
        let whole = flat_base(&relief, 3.0, None).unwrap();
        let faces =
            (0..whole.faces().len() as u32).filter(|k| !(60..66).contains(k)).collect::<Vec<_>>();
        let found =
            solid(&whole.select(&faces), &Base::Keep, 0.0, Repair::None, &Progress::silent())
                .unwrap()
                .mesh;
        let edges = found.edges();
        assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2));
        assert!((volume(&found) - volume(&whole)).abs() < 0.02 * volume(&whole));
    }

    #[test]
    fn thin_walls_become_as_thick_as_asked_above_their_base() {
        let relief = net(|x, _| if x < 0.0 { 0.2 } else { 3.0 }, &[]);
        let base = Base::Flat { behind: 0.1, up: Some([0., 0., 1.]), holes: Holes::Fill };
        let thin = solid(&relief, &base, 0.0, Repair::None, &Progress::silent()).unwrap().mesh;
        let found = solid(&relief, &base, 1.2, Repair::None, &Progress::silent()).unwrap();
        assert_eq!(found.thin, None);
        let edges = found.mesh.edges();
        assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2));
        // Half of the relief's area of 64 mm^2 becomes 1.1 mm thicker, with a rounded border.
        let more = volume(&found.mesh) - volume(&thin);
        assert!((35.0..50.0).contains(&more), "{more}");
        fn lowest(mesh: &Mesh) -> f64 {
            mesh.bounds().unwrap().0.z
        }
        assert_eq!(lowest(&found.mesh), lowest(&thin));
    }

    #[test]
    fn unsuitable_meshes_are_errors() {
        fn error(found: Result<Mesh, Error>) -> String {
            found.unwrap_err().to_string()
        }
        let relief = net(|_, _| 0.0, &[]);
        let whole = flat_base(&relief, 2.0, None).unwrap();
        let text = error(flat_base(&whole, 2.0, Some([0., 0., 1.])));
        assert!(
            text.starts_with("94 of 222 faces look away from `up`, most of the surface"),
            "{text}"
        );
        // The walls of the upper relief pass through the lower relief.
        let above = relief
            .with_positions(
                relief.positions().iter().map(|at| at + Vector3::new(1.3, 0.7, 2.0)).collect(),
            )
            .unwrap();
        let both = maquette_mesh::merge(&[&relief, &above], maquette_mesh::Poses::Ignore).unwrap();
        let text = error(flat_base(&both, 2.0, None));
        assert!(text.starts_with("the solid would intersect itself: "), "{text}");
        assert!(text.contains("use `repair: Voxels()`"), "{text}");
        let text = error(
            solid(&relief, &Base::Keep, -1.0, Repair::None, &Progress::silent()).map(|it| it.mesh),
        );
        assert_eq!(text, "`thickness` is -1, but must be a number from 0 on");
        let text = error(flat_base(&relief, 2.0, Some([0.; 3])));
        assert_eq!(text, "`up` is (0, 0, 0), but a direction must not be zero");
        let text = error(flat_base(&relief, 2.0, Some([0., 0., -1.])));
        assert!(text.starts_with("128 of 128 faces look away from `up`, most"), "{text}");
        let kept = solid(&relief, &Base::Keep, 0.0, Repair::None, &Progress::silent());
        let text = error(kept.map(|solid| solid.mesh));
        assert!(text.starts_with("32 edges of the mesh are still open"), "{text}");
        let one = Mesh::new(
            vec![Point3::origin(), Point3::new(1., 0., 0.), Point3::new(0., 1., 0.)],
            Faces::triangles(vec![[0, 1, 2]]),
        );
        check(&flat_base(&one.unwrap(), 3.0, None).unwrap(), 1.5);
    }

    #[test]
    fn what_crosses_is_united_if_asked() {
        let relief = net(|_, _| 0.0, &[]);
        let above = relief
            .with_positions(
                relief.positions().iter().map(|at| at + Vector3::new(1.3, 0.7, 2.0)).collect(),
            )
            .unwrap();
        let both = maquette_mesh::merge(&[&relief, &above], maquette_mesh::Poses::Ignore).unwrap();
        let base = Base::Flat { behind: 2.0, up: None, holes: Holes::Through };
        let repair = Repair::Voxels { size: 0.0 };
        let found = solid(&both, &base, 0.0, repair, &Progress::silent()).unwrap();
        // Two blocks of 2 and 4 mm, and what they have in common.
        check(&found.mesh, 64.0 * 2.0 + 64.0 * 4.0 - 6.7 * 7.3 * 2.0);
        let text = found.repaired.unwrap();
        assert!(text.contains("is united; the surface moved by at most"), "{text}");
    }
}
