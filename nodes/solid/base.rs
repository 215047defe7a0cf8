//! Walls from a surface to a flat base.

use maquette_value::{Mesh, MeshError};
use nalgebra::{Point3, Vector3};
use thiserror::Error;

use crate::grown::{Grown, border};
use crate::polygons::{flat, loops, triangulate};
use crate::round::Floor;

/// Why a surface has no base.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum BaseError {
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
    /// Places out of all bounds.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

/// Where places lie on a base.
pub(crate) enum Ground {
    /// Along rays from a sensor at the origin, on a plane at this depth.
    Seen(f64),
    /// Straight down, at this height along a direction.
    Below(Vector3<f64>, f64),
}

impl Ground {
    pub(crate) fn of(mesh: &Mesh, behind: f64, up: Option<[f64; 3]>) -> Result<Self, BaseError> {
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
            .ok_or(BaseError::NoUp { given: up })?;
        let lowest = places.fold(f64::INFINITY, |low, place| low.min(place.coords.dot(&up)));
        Ok(Self::Below(up, lowest - behind))
    }

    fn place(&self, at: Point3<f64>) -> Point3<f64> {
        match *self {
            Self::Seen(depth) => Point3::new(at.x * (depth / at.z), at.y * (depth / at.z), depth),
            Self::Below(up, height) => at + up * (height - at.coords.dot(&up)),
        }
    }

    /// What is on this side of the base.
    pub(crate) fn floor(&self) -> Floor {
        match *self {
            Self::Seen(depth) => Floor { up: -Vector3::z(), height: -depth },
            Self::Below(up, height) => Floor { up, height },
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
    let fan = face[1..].windows(2);
    let areas = fan.map(|pair| {
        let [a, b, c] = [face[0], pair[0], pair[1]]
            .map(|vertex: u32| ground.place(mesh.positions()[vertex as usize]));
        -(b - a).cross(&(c - a)).dot(&ground.down())
    });
    areas.sum()
}

/// What of a mesh looks to the sensor, without faces that hang by a vertex alone where others were taken away.
pub(crate) fn seen(mesh: &Mesh, ground: &Ground) -> Mesh {
    let faces = mesh.faces();
    let mut is_seen: Vec<_> = faces.iter().map(|face| shadow(mesh, face, ground) > 0.0).collect();
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
///
/// # Errors
/// If there is no border, or the faces look away.
pub(crate) fn with_base(mesh: &Mesh, ground: &Ground) -> Result<Mesh, BaseError> {
    let faces = mesh.faces();
    let shadows: Vec<_> = faces.iter().map(|face| shadow(mesh, face, ground)).collect();
    // What looks away may still be nowhere in the way.
    if shadows.iter().sum::<f64>() <= 0.0 {
        let count = shadows.iter().filter(|area| **area <= 0.0).count();
        return Err(BaseError::Away { count, all: faces.len(), from: ground.viewer() });
    }
    let border = border(mesh);
    if border.is_empty() {
        return Err(BaseError::NoBorder);
    }
    let mut grown = Grown::new(mesh);
    fn vertex(corner: u32, faces: &maquette_value::Faces) -> u32 {
        faces.corners()[corner as usize]
    }
    // Below each vertex of the border its foot, and a corner and a face there.
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
    for triangle in triangulate(&loops(&outline), |at| flat(foot(at).1, ground.down())) {
        let own = triangle.map(foot);
        grown.add_face(own.map(|(low, _, corner, _)| [low, corner]), own[0].3);
    }
    Ok(grown.mesh()?)
}
