//! Makes a solid of a surface.

use maquette::value::{Attribute, Faces, Mesh, MeshError};
use maquette::{Cancelled, Carry, Context, Error, Fate, In, Node, Progress, Promise, Want};
use maquette_fill::{FillError, FillMethod, HoleChoice, fill_holes};
use maquette_mesh::{OrientError, Outside, orient};
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::crossings::crossings;
use crate::polygons::{flat, loops, triangulate};

/// Makes a solid of a surface: what was seen from the front gets walls and a flat base, and what is nearly closed is closed.
///
/// The result is closed, manifold and looks outward, so that it can be printed. What was there stays where it was. Walls and base have what
/// lies on the border that they come from, and filled holes what `FillHoles` mixes of their rims.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Solid {
    /// The surface.
    pub mesh: In<Mesh>,
    /// What it stands on.
    #[serde(default)]
    pub base: Base,
}

/// What a solid stands on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Base {
    /// Walls run from each border to a flat base. Of a capture they run away from the sensor, so that they meet nothing that it saw; faces
    /// that it cannot have seen, since they look away from it, are left out.
    Flat {
        /// How far the base is behind the farthest place.
        #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
        #[serde(default = "three")]
        behind: f64,
        /// Where the base looks away from, of a mesh that no capture gave; its length means nothing. If left out, where the faces look on
        /// the whole.
        #[serde(default)]
        up: Option<[f64; 3]>,
        /// What becomes of holes.
        #[serde(default)]
        holes: Holes,
    },
    /// Nothing new: the holes of the mesh are filled with the surface that bends least, so that it encloses a volume.
    Keep,
}

/// What becomes of holes in front of a base.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Holes {
    /// They are filled with the smallest surface first.
    #[default]
    Fill,
    /// They go through the base.
    Through,
}

fn three() -> f64 {
    3.0
}

impl Default for Base {
    fn default() -> Self {
        Self::Flat { behind: three(), up: None, holes: Holes::Fill }
    }
}

/// Why a surface has no solid.
#[derive(Debug, Error)]
pub enum SolidError {
    /// A mesh without a border.
    #[error(
        "the mesh has no border from which walls could run: it is closed, and `base: Keep` leaves it so"
    )]
    NoBorder,
    /// A direction that is none.
    #[error("{}", match given { Some([x, y, z]) => format!("`up` is ({x}, {y}, {z}), but a direction has a length"), None => "the faces look to all sides alike: say where the upper side is by `up`".to_owned() })]
    NoUp {
        /// What was given.
        given: Option<[f64; 3]>,
    },
    /// Faces that look away.
    #[error(
        "{count} of {all} faces look away from {from}, most of the surface by area: `Orient` turns faces, and `up` says where the upper side is"
    )]
    Away {
        /// How many.
        count: usize,
        /// Of how many.
        all: usize,
        /// From what.
        from: &'static str,
    },
    /// A border that stays.
    #[error(
        "{count} edges of the mesh are still open after its holes are filled: a border around an open scan is no hole; `base: Flat()` gives it walls"
    )]
    Open {
        /// How many.
        count: usize,
    },
    /// Faces that cross.
    #[error(
        "the solid would run through itself: {count} pairs of faces cross, the first one at ({:.3}, {:.3}, {:.3}); `Reconstruct` makes one skin of such data", at[0], at[1], at[2]
    )]
    Crossing {
        /// How many pairs there are.
        count: usize,
        /// Where the first one is.
        at: [f64; 3],
    },
    /// Holes that cannot be filled.
    #[error(transparent)]
    Fill(#[from] FillError),
    /// A side that is none.
    #[error(transparent)]
    Orient(#[from] OrientError),
    /// Places out of all bounds.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
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

    const CARRIES: &'static [Carry] = &[Carry::each(
        "mesh",
        "mesh",
        [Fate::Interpolated, Fate::Interpolated, Fate::Kept, Fate::Kept],
    )];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (solid, unseen) = solid(cx.get(&self.mesh), &self.base, cx.progress())?;
        if unseen > 0 {
            let faces = if unseen == 1 { "face is" } else { "faces are" };
            cx.warn(format!("{unseen} {faces} left out: they look away from the sensor, or hang by a vertex alone where such a face was"));
        }
        Ok((solid,))
    }
}

/// A solid of a surface, see [`Solid`], and how many faces were left out because no sensor can have seen them.
///
/// # Errors
/// If it would be none, or the evaluation is told to stop.
pub fn solid(
    mesh: &Mesh,
    base: &Base,
    progress: &Progress<'_>,
) -> Result<(Mesh, usize), SolidError> {
    let (solid, unseen) = match *base {
        Base::Flat { behind, up, holes } => {
            let ground = Ground::of(mesh, behind, up)?;
            let front = match ground {
                Ground::Seen(_) => seen(mesh, &ground),
                Ground::Below(..) => mesh.clone(),
            };
            let unseen = mesh.faces().len() - front.faces().len();
            let front = match holes {
                Holes::Through => front,
                Holes::Fill => {
                    progress
                        .part(0.0..0.7, |progress| {
                            fill_holes(&front, &HoleChoice::All, &FillMethod::Membrane, progress)
                        })?
                        .mesh
                }
            };
            (with_base(&front, &ground)?, unseen)
        }
        Base::Keep => (progress.part(0.0..0.7, |progress| closed(mesh, progress))?, 0),
    };
    let crossing = progress.part(0.7..1.0, |progress| crossings(&solid, progress))?;
    match crossing.first() {
        None => Ok((solid, unseen)),
        Some(&[face, _]) => {
            let at = middle(&solid, face as usize).coords.into();
            Err(SolidError::Crossing { count: crossing.len(), at })
        }
    }
}

fn middle(mesh: &Mesh, face: usize) -> Point3<f64> {
    let face = mesh.faces().face(face);
    let sum: Vector3<f64> = face.iter().map(|&it| mesh.positions()[it as usize].coords).sum();
    (sum / face.len() as f64).into()
}

/// The mesh without holes, its outside outside.
fn closed(mesh: &Mesh, progress: &Progress<'_>) -> Result<Mesh, SolidError> {
    let filled = fill_holes(mesh, &HoleChoice::All, &FillMethod::ThinPlate, progress)?.mesh;
    let filled = orient(&filled, Outside::Outward)?.mesh;
    match filled.edges().faces.iter().filter(|faces| **faces == 1).count() {
        0 => Ok(filled),
        count => Err(SolidError::Open { count }),
    }
}

/// Where places lie on a base.
enum Ground {
    /// Along rays from a sensor at the origin, on a plane at this depth.
    Seen(f64),
    /// Straight down, at this height along a direction.
    Below(Vector3<f64>, f64),
}

impl Ground {
    fn of(mesh: &Mesh, behind: f64, up: Option<[f64; 3]>) -> Result<Self, SolidError> {
        let places = mesh.faces().corners().iter().map(|&it| mesh.positions()[it as usize]);
        if mesh.frame().is_some() && places.clone().all(|place| place.z > 0.0) {
            let farthest = places.fold(0.0, |z, place| place.z.max(z));
            return Ok(Self::Seen(farthest + behind));
        }
        let faces = mesh.faces().iter();
        let up = up
            .map_or_else(|| faces.map(|face| mesh.area_vector(face)).sum(), Vector3::from)
            .try_normalize(0.0)
            .filter(|up| up.iter().all(|x| x.is_finite()))
            .ok_or(SolidError::NoUp { given: up })?;
        let lowest = places.fold(f64::INFINITY, |low, place| low.min(place.coords.dot(&up)));
        Ok(Self::Below(up, lowest - behind))
    }

    fn place(&self, at: Point3<f64>) -> Point3<f64> {
        match *self {
            Self::Seen(depth) => Point3::new(at.x * (depth / at.z), at.y * (depth / at.z), depth),
            Self::Below(up, height) => at + up * (height - at.coords.dot(&up)),
        }
    }

    /// Where the base looks.
    fn down(&self) -> Vector3<f64> {
        match *self {
            Self::Seen(_) => Vector3::z(),
            Self::Below(up, _) => -up,
        }
    }

    /// What must see all faces.
    fn viewer(&self) -> &'static str {
        match self {
            Self::Seen(_) => "the sensor",
            Self::Below(..) => "`up`",
        }
    }
}

/// Twice the area of a face's shadow on the ground; positive if the face looks to where the base does not.
fn shadow(mesh: &Mesh, face: &[u32], ground: &Ground) -> f64 {
    let place = |vertex: u32| ground.place(mesh.positions()[vertex as usize]);
    let fan = face[1..].windows(2);
    let areas = fan.map(|pair| {
        let [a, b, c] = [face[0], pair[0], pair[1]].map(place);
        -(b - a).cross(&(c - a)).dot(&ground.down())
    });
    areas.sum()
}

/// What of a mesh looks to the sensor, without faces that hang by a vertex alone where others were taken away.
fn seen(mesh: &Mesh, ground: &Ground) -> Mesh {
    let faces = mesh.faces();
    let looks = |face: &[u32]| shadow(mesh, face, ground) > 0.0;
    let mut is_seen = Vec::from_iter(faces.iter().map(looks));
    // Where all look away it is the mesh that is turned round, and told so.
    if !is_seen.contains(&false) || !is_seen.contains(&true) {
        return mesh.clone();
    }
    loop {
        let kept = (0..faces.len() as u32).filter(|&face| is_seen[face as usize]);
        let kept = Vec::from_iter(kept);
        let left = mesh.select(&kept);
        let edges = left.edges();
        // How often a border leaves each vertex: once at most, unless it joins faces that hang by it alone.
        let mut borders = vec![0u32; left.positions().len()];
        for (&edge, &vertex) in edges.of_corner.iter().zip(left.faces().corners().iter()) {
            borders[vertex as usize] += u32::from(edges.faces[edge as usize] == 1);
        }
        let pinched = (0..kept.len())
            .filter(|&face| left.faces().face(face).iter().any(|&it| 1 < borders[it as usize]));
        let pinched = Vec::from_iter(pinched);
        if pinched.is_empty() {
            return left;
        }
        pinched.into_iter().for_each(|face| is_seen[kept[face] as usize] = false);
    }
}

/// The mesh with walls from each border to a base.
fn with_base(mesh: &Mesh, ground: &Ground) -> Result<Mesh, SolidError> {
    let (edges, faces) = (mesh.edges(), mesh.faces());
    let down = ground.down();
    let shadows = Vec::from_iter(faces.iter().map(|face| shadow(mesh, face, ground)));
    // What looks away may still be nowhere in the way.
    if shadows.iter().sum::<f64>() <= 0.0 {
        let count = shadows.iter().filter(|area| **area <= 0.0).count();
        return Err(SolidError::Away { count, all: faces.len(), from: ground.viewer() });
    }
    // Sides of faces at the border, as places among all corners.
    let mut border = Vec::new();
    for face in 0..faces.len() {
        let (first, count) = (faces.first_corner(face), faces.face(face).len());
        let sides = (0..count).map(|k| [first + k, first + (k + 1) % count]);
        let open = sides.filter(|side| edges.faces[edges.of_corner[side[0]] as usize] == 1);
        border.extend(open.map(|side| (face as u32, side.map(|corner| corner as u32))));
    }
    if border.is_empty() {
        return Err(SolidError::NoBorder);
    }
    // Behind the mesh's own elements, those that new ones copy.
    let mut vertices = Vec::from_iter(0..mesh.positions().len() as u32);
    let mut corners = Vec::from_iter(0..faces.corners().len() as u32);
    let mut sides = Vec::from_iter(faces.iter().map(<[u32]>::len));
    let mut of_faces = Vec::from_iter(0..faces.len() as u32);
    let mut all = faces.corners().to_vec();
    let mut positions = mesh.positions().to_vec();
    let vertex = |corner: u32| faces.corners()[corner as usize];
    // Below each vertex of the border its foot, and a corner and a face there.
    let mut feet = vec![None; positions.len()];
    for &(face, [corner, _]) in &border {
        let at = vertex(corner);
        if feet[at as usize].is_none() {
            feet[at as usize] = Some((positions.len() as u32, corner, face));
            positions.push(ground.place(positions[at as usize]));
            vertices.push(at);
        }
    }
    let foot =
        |at: u32| feet[at as usize].expect("each vertex of the border is the start of a side");
    for &(face, [a, b]) in &border {
        let [low_a, low_b] = [a, b].map(|corner| foot(vertex(corner)).0);
        let wall = [(vertex(b), b), (vertex(a), a), (low_a, a), (low_b, b)];
        for triangle in [[0, 1, 2], [0, 2, 3]] {
            all.extend(triangle.map(|k: usize| wall[k].0));
            corners.extend(triangle.map(|k: usize| wall[k].1));
            sides.push(3);
            of_faces.push(face);
        }
    }
    let outline = Vec::from_iter(border.iter().map(|(_, side)| [vertex(side[1]), vertex(side[0])]));
    let place = |at: u32| flat(positions[foot(at).0 as usize], down);
    for triangle in triangulate(&loops(&outline), place) {
        let own = triangle.map(foot);
        all.extend(own.map(|(low, ..)| low));
        corners.extend(own.map(|(_, corner, _)| corner));
        sides.push(3);
        of_faces.push(own[0].2);
    }
    let faces = match sides.iter().all(|count| *count == 3) {
        true => Faces::uniform(3, all)?,
        false => Faces::polygons(&sides, all)?,
    };
    let mut solid = Mesh::new(positions, faces)?
        .with_creases(mesh.creases())?
        .with_texture(mesh.texture().cloned())
        .with_frame(mesh.frame().copied());
    // A normal at the border would be one of walls, too.
    let kept = |(name, _): &(&str, &Attribute)| *name != "normal";
    for (name, attribute) in mesh.vertex().iter().filter(kept) {
        solid = solid.with_vertex(name, attribute.select(&vertices))?;
    }
    for (name, attribute) in mesh.corner().iter().filter(kept) {
        solid = solid.with_corner(name, attribute.select(&corners))?;
    }
    for (name, attribute) in mesh.face().iter() {
        solid = solid.with_face(name, attribute.select(&of_faces))?;
    }
    Ok(solid)
}

#[cfg(test)]
mod tests {
    use maquette::value::CaptureFrame;

    use super::*;

    /// A net of 9 x 9 places over 8 x 8 mm at these heights; without the cells that `hole` names.
    fn net(height: impl Fn(f64, f64) -> f64, hole: &[u32]) -> Mesh {
        let places = (0..81).map(|k| [f64::from(k % 9) - 4.0, f64::from(k / 9) - 4.0]);
        let positions = places.map(|[x, y]| Point3::new(x, y, height(x, y))).collect::<Vec<_>>();
        let cells = (0..72).filter(|k| k % 9 < 8 && !hole.contains(k));
        let faces = cells.flat_map(|k| [[k, k + 1, k + 10], [k, k + 10, k + 9]]).collect();
        Mesh::new(positions, Faces::triangles(faces)).unwrap()
    }

    fn flat_base(mesh: &Mesh, behind: f64, up: Option<[f64; 3]>) -> Result<Mesh, SolidError> {
        let base = Base::Flat { behind, up, holes: Holes::Through };
        Ok(solid(mesh, &base, &Progress::none())?.0)
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
        // The middle is 0.6 mm above the lowest corner.
        check(&flat_base(&relief, 2.0, Some([0., 0., 3.])).unwrap(), 64.0 * 2.6);
        let curved = net(|x, y| (x * y).abs() * 0.1, &[]);
        let found = flat_base(&curved, 1.0, None).unwrap();
        let lowest = found.positions().iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
        assert!((lowest + 1.0).abs() < 1e-9);
        assert_eq!(found.positions()[..81], curved.positions()[..]);
    }

    #[test]
    fn a_hole_goes_through() {
        let relief = net(|_, _| 0.0, &[40, 41, 20]);
        check(&flat_base(&relief, 2.0, None).unwrap(), 61.0 * 2.0);
        let base = Base::Flat { behind: 2.0, up: None, holes: Holes::Fill };
        check(&solid(&relief, &base, &Progress::none()).unwrap().0, 64.0 * 2.0);
    }

    #[test]
    fn what_a_sensor_cannot_have_seen_is_left_out() {
        let frame =
            CaptureFrame { camera: None, picture: [2, 2], depth: 20.0, world_from_camera: None };
        let seen = orient(&net(|_, _| 20.0, &[]), Outside::Flip).unwrap().mesh;
        // A vertex that noise moved over its neighbors.
        let mut moved = seen.positions().to_vec();
        moved[40] += Vector3::new(2.5, 0.2, 0.1);
        let folded = seen.with_positions(moved).unwrap().with_frame(Some(frame));
        let (found, unseen) = solid(&folded, &Base::default(), &Progress::none()).unwrap();
        assert!((1..10).contains(&unseen), "{unseen}");
        let edges = found.edges();
        assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2));
    }

    #[test]
    fn walls_of_a_capture_run_away_from_the_sensor() {
        let frame =
            CaptureFrame { camera: None, picture: [2, 2], depth: 20.0, world_from_camera: None };
        // The sensor sees y down and z away, so that the faces look to -z.
        let seen = net(|x, y| 20.0 - 0.1 * (x * x + y * y), &[]);
        let seen = orient(&seen, Outside::Flip).unwrap().mesh.with_frame(Some(frame));
        let found = flat_base(&seen, 5.0, None).unwrap();
        assert!(volume(&found) > 0.0);
        let ray = |at: &Point3<f64>| [at.x / at.z, at.y / at.z];
        let corner = ray(&found.positions()[0]);
        let is_below = |at: &&Point3<f64>| (0..2).all(|k| (ray(at)[k] - corner[k]).abs() < 1e-12);
        let foot = found.positions()[81..].iter().find(is_below).unwrap();
        assert!((foot.z - 25.0).abs() < 1e-12);
    }

    #[test]
    fn new_elements_have_what_lies_on_the_border() {
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
            Vec::from_iter((0..whole.faces().len() as u32).filter(|k| !(60..66).contains(k)));
        let (found, _) = solid(&whole.select(&faces), &Base::Keep, &Progress::none()).unwrap();
        let edges = found.edges();
        assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2));
        assert!((volume(&found) - volume(&whole)).abs() < 0.02 * volume(&whole));
    }

    #[test]
    fn what_has_no_solid_is_told_why() {
        let told = |found: Result<Mesh, SolidError>| found.unwrap_err().to_string();
        let relief = net(|_, _| 0.0, &[]);
        let whole = flat_base(&relief, 2.0, None).unwrap();
        let text = told(flat_base(&whole, 2.0, Some([0., 0., 1.])));
        assert!(
            text.starts_with("94 of 222 faces look away from `up`, most of the surface"),
            "{text}"
        );
        // What lies over another part has walls that run through it.
        let shift = |at: &Point3<f64>| at + Vector3::new(1.3, 0.7, 2.0);
        let above = relief.with_positions(relief.positions().iter().map(shift).collect()).unwrap();
        let both = maquette_mesh::merge(&[&relief, &above], maquette_mesh::Poses::Ignore).unwrap();
        let text = told(flat_base(&both, 2.0, None));
        assert!(text.starts_with("the solid would run through itself: "), "{text}");
        let text = told(flat_base(&relief, 2.0, Some([0.; 3])));
        assert_eq!(text, "`up` is (0, 0, 0), but a direction has a length");
        let text = told(flat_base(&relief, 2.0, Some([0., 0., -1.])));
        assert!(text.starts_with("128 of 128 faces look away from `up`, most"), "{text}");
        let kept = solid(&relief, &Base::Keep, &Progress::none());
        let text = told(kept.map(|(mesh, _)| mesh));
        assert!(text.starts_with("32 edges of the mesh are still open"), "{text}");
        let one = Mesh::new(
            vec![Point3::origin(), Point3::new(1., 0., 0.), Point3::new(0., 1., 0.)],
            Faces::triangles(vec![[0, 1, 2]]),
        );
        check(&flat_base(&one.unwrap(), 3.0, None).unwrap(), 1.5);
    }
}
