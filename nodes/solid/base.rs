//! Extends an open surface to a solid: adds a flat base, and walls from the surface's border to the base.

use maquette_node::{Error, bail};
use maquette_value::Mesh;
use nalgebra::{Point3, Vector3};

use crate::extended::{ExtendedMesh, border};
use crate::offset::Floor;
use crate::polygons::{loops, project_to_plane, triangulate};

/// The projection of surface points onto the plane of the base.
pub(crate) enum Ground {
    /// Central projection from a sensor at the origin, onto the plane at the given z coordinate in mm.
    Seen(f64),
    /// Parallel projection along the given unit direction, onto the plane perpendicular to this direction at the given height in mm.
    Below(Vector3<f64>, f64),
}

impl Ground {
    pub(crate) fn of_mesh(mesh: &Mesh, behind: f64, up: Option<[f64; 3]>) -> Result<Self, Error> {
        let places = mesh.faces().corners().iter().map(|&it| mesh.positions()[it as usize]);
        if mesh.frame().is_some() && places.clone().all(|place| place.z > 0.0) {
            let farthest = places.fold(0.0, |z, place| place.z.max(z));
            return Ok(Self::Seen(farthest + behind));
        }
        let faces = mesh.faces().iter();
        let sum = up.map_or_else(|| faces.map(|face| mesh.area_vector(face)).sum(), Vector3::from);
        let unit = sum.try_normalize(0.0).filter(|up| up.iter().all(|x| x.is_finite()));
        let up = match (unit, up) {
            (Some(unit), _) => unit,
            (None, Some([x, y, z])) => {
                bail!("`up` is ({x}, {y}, {z}), but a direction must not be zero")
            }
            (None, None) => bail!(
                "the faces have no common direction: set `up` to the direction of the upper side"
            ),
        };
        let lowest = places.fold(f64::INFINITY, |low, place| low.min(place.coords.dot(&up)));
        Ok(Self::Below(up, lowest - behind))
    }

    fn place(&self, at: Point3<f64>) -> Point3<f64> {
        match *self {
            Self::Seen(depth) => Point3::new(at.x * (depth / at.z), at.y * (depth / at.z), depth),
            Self::Below(up, height) => at + up * (height - at.coords.dot(&up)),
        }
    }

    /// Returns the half-space above the base plane.
    pub(crate) fn floor(&self) -> Floor {
        match *self {
            Self::Seen(depth) => Floor { up: -Vector3::z(), height: -depth },
            Self::Below(up, height) => Floor { up, height },
        }
    }

    /// Returns the outward normal of the base.
    fn down(&self) -> Vector3<f64> {
        match *self {
            Self::Seen(_) => Vector3::z(),
            Self::Below(up, _) => -up,
        }
    }

    /// Returns the name, for error messages, of the point or direction from which all faces must be visible.
    fn viewer(&self) -> &'static str {
        match self {
            Self::Seen(_) => "the sensor",
            Self::Below(..) => "`up`",
        }
    }
}

/// Returns twice the area of a face projected onto the base; positive if the face looks away from the base.
fn shadow(mesh: &Mesh, face: &[u32], ground: &Ground) -> f64 {
    let fan = face[1..].windows(2);
    let areas = fan.map(|pair| {
        let [a, b, c] = [face[0], pair[0], pair[1]]
            .map(|vertex: u32| ground.place(mesh.positions()[vertex as usize]));
        -(b - a).cross(&(c - a)).dot(&ground.down())
    });
    areas.sum()
}

/// Returns the mesh without the faces that look away from the sensor. Also removes faces that would then be connected to the rest of the
/// mesh by a single vertex only.
pub(crate) fn visible_part(mesh: &Mesh, ground: &Ground) -> Mesh {
    let faces = mesh.faces();
    let mut is_seen: Vec<_> = faces.iter().map(|face| shadow(mesh, face, ground) > 0.0).collect();
    // If all faces look away from the sensor, keep them all: the mesh is inside out, which the caller reports as an error.
    if !is_seen.contains(&false) || !is_seen.contains(&true) {
        return mesh.clone();
    }
    loop {
        let kept = (0..faces.len() as u32).filter(|&face| is_seen[face as usize]);
        let kept = Vec::from_iter(kept);
        let left = mesh.select(&kept);
        let edges = left.edges();
        // The number of border edges that leave each vertex. The number is at most one, unless some faces at the vertex touch each other
        // only in this vertex.
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

/// Returns the mesh with a flat base, and with walls from each border loop to the base.
///
/// # Errors
/// Returns an error if the mesh has no border, or if its faces look toward the base, by the sum of their projected areas.
pub(crate) fn with_base(mesh: &Mesh, ground: &Ground) -> Result<Mesh, Error> {
    let faces = mesh.faces();
    let shadows: Vec<_> = faces.iter().map(|face| shadow(mesh, face, ground)).collect();
    // Single faces may look toward the base without covering another face, so only the sum of all faces is tested.
    if shadows.iter().sum::<f64>() <= 0.0 {
        let count = shadows.iter().filter(|area| **area <= 0.0).count();
        bail!(
            "{count} of {} faces look away from {}, most of the surface by area: use `Orient` to turn faces, or `up` to give the upper side",
            faces.len(),
            ground.viewer()
        );
    }
    let border = border(mesh);
    if border.is_empty() {
        bail!("the mesh has no border for walls: it is closed, and `base: Keep` leaves it so");
    }
    let mut grown = ExtendedMesh::new(mesh);
    fn vertex(corner: u32, faces: &maquette_value::Faces) -> u32 {
        faces.corners()[corner as usize]
    }
    // For each border vertex, its projection onto the base: the index and the position of the new vertex, and the corner and the face whose
    // attributes the base copies. `None` for all other vertices.
    let mut feet = vec![None; mesh.positions().len()];
    for &(face, [corner, _]) in &border {
        let at = vertex(corner, faces);
        feet[at as usize].get_or_insert_with(|| {
            let foot = ground.place(mesh.positions()[at as usize]);
            (grown.add_vertex(foot, at), foot, corner, face)
        });
    }
    let foot =
        |at: u32| feet[at as usize].expect("each vertex of the border is the start of a side");
    for &(face, [a, b]) in &border {
        let [low_a, low_b] = [a, b].map(|corner| foot(vertex(corner, faces)).0);
        let wall = [[vertex(b, faces), b], [vertex(a, faces), a], [low_a, a], [low_b, b]];
        grown.add_face([0, 1, 2].map(|k: usize| wall[k]), face);
        grown.add_face([0, 2, 3].map(|k: usize| wall[k]), face);
    }
    let outline: Vec<_> =
        border.iter().map(|(_, side)| [vertex(side[1], faces), vertex(side[0], faces)]).collect();
    for triangle in triangulate(&loops(&outline), |at| project_to_plane(foot(at).1, ground.down()))
    {
        let own = triangle.map(foot);
        grown.add_face(own.map(|(low, _, corner, _)| [low, corner]), own[0].3);
    }
    Ok(grown.mesh()?)
}
