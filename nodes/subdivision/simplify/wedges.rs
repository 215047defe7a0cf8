//! What lies on the corners around a vertex, such as texture coordinates, and the seams between.
//!
//! A *wedge* is the corners at one vertex that have the same attributes: Hoppe, "Efficient implementation of progressive meshes" (1998),
//! section 2.

use maquette_base::linear::carry::Carry;
use maquette_base::linear::mix::Mix;
use maquette_base::topology::lists::Lists;
use maquette_value::{Attribute, Mesh};
use nalgebra::{Point3, Vector3};

use super::quadric::Quadric;

/// The wedges of a mesh of triangles.
pub(super) struct Wedges {
    /// The wedge at each corner of each triangle.
    of: Vec<[u32; 3]>,
    /// A corner of the mesh that has what each wedge has.
    corners: Vec<u32>,
    /// How texture coordinates change along the surface around each wedge; empty if there are none.
    textures: Vec<[Linear; 2]>,
    /// What was done.
    mixes: Vec<Mixed>,
}

/// The wedges at a place of a triangle, with their shares.
pub(super) type Parts = [(f64, u32); 3];

/// A wedge that was made of others.
struct Mixed {
    /// Those with one number were mixed at one time.
    time: u32,
    wedge: u32,
    parts: Parts,
}

/// A side of an edge: its wedges at both ends.
pub(super) type Side = [u32; 2];

impl Wedges {
    /// Those of a mesh whose faces were cut into triangles, each with its corners; none if nothing lies on corners but normals, which are dropped.
    pub(super) fn new(mesh: &Mesh, triangles: &[[u32; 3]], corners: &[[u32; 3]]) -> Option<Self> {
        let attributes: Vec<_> = carried(mesh).map(|(_, attribute)| attribute).collect();
        if attributes.is_empty() {
            return None;
        }
        let vertices = mesh.faces().corners();
        let at = Lists::group(mesh.positions().len(), || vertices.iter().copied().zip(0..));
        let (mut of_corner, mut first) = (vec![0u32; vertices.len()], Vec::<u32>::new());
        for vertex in 0..mesh.positions().len() {
            let begin = first.len();
            for &corner in at.of(vertex) {
                let is_same =
                    |other: &u32| attributes.iter().all(|it| is_same(it, [corner, *other]));
                let known = first[begin..].iter().position(is_same);
                of_corner[corner as usize] = known.map_or(first.len(), |k| begin + k) as u32;
                if known.is_none() {
                    first.push(corner);
                }
            }
        }
        let of = corners.iter().map(|corners| corners.map(|corner| of_corner[corner as usize]));
        let mut wedges =
            Self { of: of.collect(), corners: first, textures: Vec::new(), mixes: Vec::new() };
        if let Some(uv) = mesh.corner().pairs("uv") {
            wedges.measure(mesh, triangles, corners, uv);
        }
        Some(wedges)
    }

    /// Finds how texture coordinates change along the surface: in mm, so that a texture may slip as far as the surface may be off. The
    /// scale is that at which the picture has the area that it covers.
    fn measure(
        &mut self,
        mesh: &Mesh,
        triangles: &[[u32; 3]],
        corners: &[[u32; 3]],
        uv: &[[f64; 2]],
    ) {
        fn spans([a, b, c]: [Point3<f64>; 3]) -> [Vector3<f64>; 2] {
            [b - a, c - a]
        }
        let place = |vertex: u32| mesh.positions()[vertex as usize];
        let (mut area, mut covered) = (0.0, 0.0);
        for (triangle, corners) in triangles.iter().zip(corners) {
            let [ab, ac] = spans(triangle.map(place));
            area += ab.cross(&ac).norm();
            let [a, b, c] = corners.map(|corner| uv[corner as usize]);
            covered += ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs();
        }
        let scale = if covered > 0.0 { (area / covered).sqrt() } else { 0.0 };
        self.textures = vec![Default::default(); self.corners.len()];
        for ((triangle, corners), wedges) in triangles.iter().zip(corners).zip(&self.of) {
            let places = triangle.map(place);
            let [ab, ac] = spans(places);
            let normal = ab.cross(&ac);
            let square = normal.norm_squared();
            if square == 0.0 {
                continue;
            }
            for axis in [0, 1] {
                let [a, b, c] = corners.map(|corner| uv[corner as usize][axis] * scale);
                // Along the triangle, and by as much as its corners say.
                let slope = (ac.cross(&normal) * (b - a) + normal.cross(&ab) * (c - a)) / square;
                let linear =
                    Linear::new(slope, a - slope.dot(&places[0].coords), square.sqrt() / 2.0);
                wedges.iter().for_each(|&wedge| self.textures[wedge as usize][axis].add(&linear));
            }
        }
    }

    /// The wedges of a triangle.
    pub(super) fn of(&self, triangle: u32) -> [u32; 3] {
        self.of[triangle as usize]
    }

    /// What it costs the texture to make one wedge of each side's two.
    pub(super) fn cost(&self, sides: &[Side]) -> Quadric {
        let mut cost = Quadric::default();
        for &[a, b] in sides.iter().filter(|_| !self.textures.is_empty()) {
            for axis in [0, 1] {
                let mut both = self.textures[a as usize][axis];
                both.add(&self.textures[b as usize][axis]);
                cost += both.deviation();
            }
        }
        cost
    }

    /// Makes one wedge of each side's two, of these parts. `time` counts upwards.
    pub(super) fn merge(&mut self, time: u32, sides: impl Iterator<Item = (Side, Parts)>) {
        for ([a, b], parts) in sides {
            self.mixes.push(Mixed { time, wedge: a, parts });
            if !self.textures.is_empty() {
                let of_b = self.textures[b as usize];
                (0..2).for_each(|axis| self.textures[a as usize][axis].add(&of_b[axis]));
            }
        }
    }

    /// Gives a corner another wedge.
    pub(super) fn replace(&mut self, triangle: u32, corner: usize, wedge: u32) {
        self.of[triangle as usize][corner] = wedge;
    }

    /// The attributes of the corners of some triangles.
    pub(super) fn attributes<'a>(
        &'a self,
        mesh: &'a Mesh,
        triangles: &'a [usize],
    ) -> impl Iterator<Item = (&'a str, Attribute)> {
        let of_corners = triangles.iter().flat_map(|&triangle| self.of[triangle]);
        let of_corners = Vec::from_iter(of_corners);
        carried(mesh).map(move |(name, attribute)| {
            let mixed = self.attribute(&attribute.select(&self.corners));
            (name, mixed.select(&of_corners))
        })
    }
}

impl Carry for Wedges {
    fn column<T: Mix>(&self, old: &[T]) -> Vec<T> {
        let mut mixed = old.to_vec();
        for together in self.mixes.chunk_by(|a, b| a.time == b.time) {
            let new = together.iter().map(|Mixed { wedge, parts, .. }| {
                // Indices have no mean: the nearest one comes first. What has no share must not set a flag.
                let mut parts: Vec<_> = parts.iter().filter(|(share, _)| *share > 0.0).collect();
                parts.sort_by(|a, b| b.0.total_cmp(&a.0));
                let parts = parts.into_iter().map(|&(share, part)| (share, mixed[part as usize]));
                (*wedge, T::mix(parts))
            });
            for (wedge, value) in Vec::from_iter(new) {
                mixed[wedge as usize] = value;
            }
        }
        mixed
    }
}

/// The attributes of corners that are carried: all but normals.
fn carried(mesh: &Mesh) -> impl Iterator<Item = (&str, &Attribute)> {
    mesh.corner().iter().filter(|(name, _)| *name != "normal")
}

/// Whether two entries are the same.
fn is_same(attribute: &Attribute, places: [u32; 2]) -> bool {
    let [a, b] = places.map(|place| place as usize);
    match attribute {
        Attribute::Number(all) => all[a].to_bits() == all[b].to_bits(),
        Attribute::Index(all) => all[a] == all[b],
        Attribute::Flag(all) => all[a] == all[b],
        Attribute::Pair(all) => all[a] == all[b],
        Attribute::Vector(all) => all[a] == all[b],
        Attribute::Color(all) => all[a] == all[b],
    }
}

/// Linear functions of the place, each weighed by the area of its triangle: `slope . x + offset`.
///
/// Hoppe, "New quadric metric for simplifying meshes with appearance attributes" (1999), section 4: what a vertex has is free, so that of all
/// functions only their deviation from their mean counts.
#[derive(Clone, Copy, Debug, Default)]
struct Linear {
    weight: f64,
    slope: Vector3<f64>,
    offset: f64,
    /// The sum of the weighted squares.
    squares: Quadric,
}

impl Linear {
    fn new(slope: Vector3<f64>, offset: f64, weight: f64) -> Self {
        let squares = Quadric::linear(slope, offset, weight);
        Self { weight, slope: slope * weight, offset: offset * weight, squares }
    }

    fn add(&mut self, other: &Self) {
        self.weight += other.weight;
        self.slope += other.slope;
        self.offset += other.offset;
        self.squares += other.squares;
    }

    /// The weighted squares of the functions' deviations from their mean.
    fn deviation(&self) -> Quadric {
        let mut deviation = self.squares;
        if self.weight > 0.0 {
            deviation += Quadric::linear(self.slope, self.offset, -1.0 / self.weight);
        }
        deviation
    }
}
