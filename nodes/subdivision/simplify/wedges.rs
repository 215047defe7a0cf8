//! Corner attributes around a vertex, such as texture coordinates, and the seams between them.
//!
//! A *wedge* is the set of those corners at one vertex that have equal attributes: Hoppe, "Efficient implementation of progressive meshes"
//! (1998), section 2.

use maquette_base::linear::attribute_transfer::AttributeTransfer;
use maquette_base::linear::weighted_mean::WeightedMean;
use maquette_base::topology::lists::Lists;
use maquette_value::{Attribute, Mesh};
use nalgebra::{Point3, Vector3};

use super::quadric::Quadric;

/// The wedges of a triangle mesh.
pub(super) struct Wedges {
    /// The wedge at each corner of each triangle.
    triangle_wedges: Vec<[u32; 3]>,
    /// For each wedge a corner of the input mesh that has the attributes of the wedge.
    corners: Vec<u32>,
    /// The gradients of the two texture coordinates around each wedge; empty if the mesh has no texture coordinates.
    textures: Vec<[Linear; 2]>,
    /// The history of merges of wedges.
    mixes: Vec<MixedWedge>,
}

/// A point of a triangle: each corner's barycentric weight and wedge.
pub(super) type Parts = [(f64, u32); 3];

/// A wedge whose attributes are a weighted mean of other wedges.
struct MixedWedge {
    /// The number of the merge operation. Wedges with equal numbers were merged simultaneously.
    time: u32,
    wedge: u32,
    parts: Parts,
}

/// One side of an edge: the wedges at the two ends of the edge that belong to the face on this side.
pub(super) type Side = [u32; 2];

impl Wedges {
    /// Finds the wedges of a mesh that was cut into triangles. Quadrics are relative to `origin`. `corners` has for each triangle its
    /// corners in the input mesh. Returns `None` if the mesh has no corner attributes other than normals, which are dropped.
    pub(super) fn new(
        mesh: &Mesh,
        origin: Point3<f64>,
        triangles: &[[u32; 3]],
        corners: &[[u32; 3]],
    ) -> Option<Self> {
        let attributes: Vec<_> = carried_attributes(mesh).map(|(_, attribute)| attribute).collect();
        if attributes.is_empty() {
            return None;
        }
        let vertices = mesh.faces().corners();
        let at = Lists::group(mesh.positions().len(), || vertices.iter().copied().zip(0..));
        let (mut of_corner, mut first) = (vec![0u32; vertices.len()], Vec::<u32>::new());
        for vertex in 0..mesh.positions().len() {
            let begin = first.len();
            for &corner in at.list(vertex) {
                let known = first[begin..].iter().position(|&other| {
                    attributes.iter().all(|attribute| is_same(attribute, [corner, other]))
                });
                of_corner[corner as usize] = known.map_or(first.len(), |k| begin + k) as u32;
                if known.is_none() {
                    first.push(corner);
                }
            }
        }
        let of = corners.iter().map(|corners| corners.map(|corner| of_corner[corner as usize]));
        let mut wedges = Self {
            triangle_wedges: of.collect(),
            corners: first,
            textures: Vec::new(),
            mixes: Vec::new(),
        };
        if let Some(uv) = mesh.corner().pairs("uv") {
            wedges.measure(mesh, origin, triangles, corners, uv);
        }
        Some(wedges)
    }

    /// Computes the gradients of the texture coordinates, scaled to mm: at this scale the texture has the area of the surface that it
    /// covers. A texture shift thus counts as much as an equal distance from the surface.
    fn measure(
        &mut self,
        mesh: &Mesh,
        origin: Point3<f64>,
        triangles: &[[u32; 3]],
        corners: &[[u32; 3]],
        uv: &[[f64; 2]],
    ) {
        fn spans([a, b, c]: [Point3<f64>; 3]) -> [Vector3<f64>; 2] {
            [b - a, c - a]
        }
        let (mut area, mut covered) = (0.0, 0.0);
        for (triangle, corners) in triangles.iter().zip(corners) {
            let [ab, ac] = spans(triangle.map(|vertex| mesh.positions()[vertex as usize]));
            area += ab.cross(&ac).norm();
            let [a, b, c] = corners.map(|corner| uv[corner as usize]);
            covered += ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs();
        }
        let scale = if covered > 0.0 { (area / covered).sqrt() } else { 0.0 };
        self.textures = vec![Default::default(); self.corners.len()];
        for ((triangle, corners), wedges) in
            triangles.iter().zip(corners).zip(&self.triangle_wedges)
        {
            let positions = triangle.map(|vertex| mesh.positions()[vertex as usize]);
            let [ab, ac] = spans(positions);
            let normal = ab.cross(&ac);
            let square = normal.norm_squared();
            if square == 0.0 {
                continue;
            }
            for axis in [0, 1] {
                let [a, b, c] = corners.map(|corner| uv[corner as usize][axis] * scale);
                // The gradient of a texture coordinate in the plane of the triangle.
                let slope = (ac.cross(&normal) * (b - a) + normal.cross(&ab) * (c - a)) / square;
                let linear = Linear::new(
                    slope,
                    a - slope.dot(&(positions[0] - origin)),
                    square.sqrt() / 2.0,
                );
                wedges.iter().for_each(|&wedge| self.textures[wedge as usize][axis].add(&linear));
            }
        }
    }

    /// The wedges of a triangle.
    pub(super) fn triangle_wedges(&self, triangle: u32) -> [u32; 3] {
        self.triangle_wedges[triangle as usize]
    }

    /// Returns the texture error caused by merging the two wedges of each side, as a function of the new position.
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

    /// Merges the two wedges of each side; the merged wedge is the weighted mean of the wedges in `Parts`. `time` must increase with each
    /// call.
    pub(super) fn merge(&mut self, time: u32, sides: impl Iterator<Item = (Side, Parts)>) {
        for ([a, b], parts) in sides {
            self.mixes.push(MixedWedge { time, wedge: a, parts });
            if !self.textures.is_empty() {
                let of_b = self.textures[b as usize];
                (0..2).for_each(|axis| self.textures[a as usize][axis].add(&of_b[axis]));
            }
        }
    }

    /// Assigns another wedge to a corner.
    pub(super) fn replace(&mut self, triangle: u32, corner: usize, wedge: u32) {
        self.triangle_wedges[triangle as usize][corner] = wedge;
    }

    /// Computes the corner attributes of some triangles.
    pub(super) fn attributes<'a>(
        &'a self,
        mesh: &'a Mesh,
        triangles: &'a [usize],
    ) -> impl Iterator<Item = (&'a str, Attribute)> {
        let of_corners = triangles.iter().flat_map(|&triangle| self.triangle_wedges[triangle]);
        let of_corners: Vec<_> = of_corners.collect();
        carried_attributes(mesh).map(move |(name, attribute)| {
            let mixed = self.attribute(&attribute.select(&self.corners));
            (name, mixed.select(&of_corners))
        })
    }
}

impl AttributeTransfer for Wedges {
    fn column<T: WeightedMean>(&self, old: &[T]) -> Vec<T> {
        let mut mixed = old.to_vec();
        for together in self.mixes.chunk_by(|a, b| a.time == b.time) {
            let new = together.iter().map(|MixedWedge { wedge, parts, .. }| {
                // Integer indices have no mean; the mean takes the index of the first part. Therefore put the nearest corner first. Corners
                // of weight 0 are removed, because they must not set a flag.
                let mut parts: Vec<_> = parts.iter().filter(|(share, _)| *share > 0.0).collect();
                parts.sort_by(|a, b| b.0.total_cmp(&a.0));
                let parts = parts.into_iter().map(|&(share, part)| (share, mixed[part as usize]));
                (*wedge, T::weighted_mean(parts))
            });
            for (wedge, value) in new.collect::<Vec<_>>() {
                mixed[wedge as usize] = value;
            }
        }
        mixed
    }
}

/// The corner attributes that are transferred: all but normals.
fn carried_attributes(mesh: &Mesh) -> impl Iterator<Item = (&str, &Attribute)> {
    mesh.corner().iter().filter(|(name, _)| *name != "normal")
}

/// Returns true if the attribute has equal values at the two `indices`.
fn is_same(attribute: &Attribute, indices: [u32; 2]) -> bool {
    let [a, b] = indices.map(|index| index as usize);
    match attribute {
        Attribute::Number(all) => all[a].to_bits() == all[b].to_bits(),
        Attribute::Index(all) => all[a] == all[b],
        Attribute::Flag(all) => all[a] == all[b],
        Attribute::Pair(all) => all[a] == all[b],
        Attribute::Vector(all) => all[a] == all[b],
        Attribute::Color(all) => all[a] == all[b],
    }
}

/// A sum of linear functions `slope . x + offset` of the position `x`, weighted by the areas of their triangles.
///
/// Hoppe, "New quadric metric for simplifying meshes with appearance attributes" (1999), section 4. The value of the texture coordinate at
/// the merged vertex can be chosen freely, so only the deviation of the functions from their mean counts.
#[derive(Clone, Copy, Debug, Default)]
struct Linear {
    weight: f64,
    slope: Vector3<f64>,
    offset: f64,
    /// The weighted sum of the squares of the linear functions, as a quadric.
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

    /// Returns the weighted sum of the squared deviations of the linear functions from their mean, as a quadric.
    fn deviation(&self) -> Quadric {
        let mut deviation = self.squares;
        if self.weight > 0.0 {
            deviation += Quadric::linear(self.slope, self.offset, -1.0 / self.weight);
        }
        deviation
    }
}
