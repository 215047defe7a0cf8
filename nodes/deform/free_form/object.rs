//! Converts deformable objects (meshes, range images, points, curves, control nets) to points and back.

use maquette_mesh::Movable;
use maquette_node::{Error, bail};
use maquette_value::parallel::*;
use maquette_value::simd::{Kernel, widest};
use maquette_value::{Attribute, Mesh, Points};
use nalgebra::{Point3, Vector3};

use crate::gaussian::field::{Field, FieldRequest, scatter_rows, transform_normal};
use crate::gaussian::layout::Bounds;

/// Returns all points of an object.
pub(crate) fn points(object: &Movable) -> &[Point3<f64>] {
    match object {
        Movable::Mesh(mesh) => mesh.positions(),
        Movable::RangeImage(range) => range.points(),
        Movable::Points(points) => points.positions(),
        Movable::Curve(curve) => curve.points(),
        Movable::ControlNet(net) => net.points(),
    }
}

/// Returns the bounding box of an object; `None` if it has no points.
pub(crate) fn bounds(object: &Movable) -> Option<Bounds> {
    bounds_of(points(object))
}

/// The number of points that one task processes.
const CHUNK_SIZE: usize = 32768;

/// Returns the bounding box of those points that are not NaN; `None` if there are none.
pub(crate) fn bounds_of(points: &[Point3<f64>]) -> Option<Bounds> {
    let chunks: Vec<Extent> = points.par_chunks(CHUNK_SIZE).map(extent).collect();
    merge_extents(&chunks)
}

/// The minimum and maximum coordinates of some points; inverted infinities if there are no points.
pub(crate) type Extent = [[f64; 3]; 2];

pub(crate) fn extent(points: &[Point3<f64>]) -> Extent {
    let mut found = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    widest(Span { points, found: &mut found });
    found
}

/// Returns the bounding box of several extents; `None` if they contain no points.
pub(crate) fn merge_extents(ends: &[Extent]) -> Option<Bounds> {
    let ends = ends.iter().map(|ends| ends.map(Vector3::from));
    let [low, high] = ends.reduce(|a, b| [a[0].inf(&b[0]), a[1].sup(&b[1])])?;
    (low.x <= high.x).then(|| (low.into(), high.into()))
}

/// A kernel that computes the minimum and maximum coordinates of points. It ignores NaN.
struct Span<'a> {
    points: &'a [Point3<f64>],
    found: &'a mut Extent,
}

impl Kernel for Span<'_> {
    #[inline(always)]
    fn run(self) {
        const LANES: usize = 8;
        let [mut low, mut high] = self.found.map(|found| [found; LANES]);
        let (blocks, rest) = self.points.as_chunks::<LANES>();
        // With blocks of a constant length, the compiler keeps the extrema in registers.
        for points in blocks {
            for ((low, high), point) in low.iter_mut().zip(&mut high).zip(points) {
                extend(low, high, point);
            }
        }
        rest.iter().for_each(|point| extend(&mut low[0], &mut high[0], point));
        for axis in 0..3 {
            self.found[0][axis] = low.iter().map(|low| low[axis]).fold(f64::INFINITY, f64::min);
            self.found[1][axis] =
                high.iter().map(|high| high[axis]).fold(f64::NEG_INFINITY, f64::max);
        }
    }
}

#[inline(always)]
fn extend(low: &mut [f64; 3], high: &mut [f64; 3], point: &Point3<f64>) {
    for axis in 0..3 {
        let x = point[axis];
        low[axis] = if x < low[axis] { x } else { low[axis] };
        high[axis] = if high[axis] < x { x } else { high[axis] };
    }
}

/// Returns the results to request for an object in addition to positions. Folds are not requested for points without normals: these have no
/// inside and outside that could be exchanged.
pub(crate) fn field_request(object: &Movable) -> FieldRequest<'_> {
    let request = FieldRequest { folds: true, ..FieldRequest::default() };
    match object {
        Movable::Mesh(mesh) => FieldRequest {
            normals: mesh.vertex().vectors("normal").map(|normals| &normals[..]),
            jacobians: mesh.corner().vectors("normal").is_some(),
            ..request
        },
        Movable::Points(points) => match points.attributes().vectors("normal") {
            Some(normals) => FieldRequest { normals: Some(normals), ..request },
            None => FieldRequest::default(),
        },
        Movable::RangeImage(_) | Movable::Curve(_) | Movable::ControlNet(_) => request,
    }
}

/// Returns the object with its points replaced by those of `field`.
pub(crate) fn rebuild(object: &Movable, field: Field) -> Result<Movable, Error> {
    let field = match object {
        Movable::Mesh(_) => field,
        _ => field.expand(points(object), field_request(object).normals),
    };
    Ok(match object {
        Movable::Mesh(mesh) => Movable::Mesh(mesh_of(mesh, field)?),
        Movable::Points(points) => Movable::Points(points_of(points, field)?),
        Movable::Curve(curve) => Movable::Curve(curve.with_points(field.positions)?),
        Movable::RangeImage(range) => {
            let pairs = range.points().iter().zip(&field.positions);
            if let Some(cell) =
                pairs.into_iter().position(|(old, new): (&Point3<f64>, &Point3<f64>)| {
                    !old.x.is_nan() && !new.coords.iter().all(|x| x.is_finite())
                })
            {
                let (column, row) = (cell % range.width(), cell / range.width());
                bail!(
                    "the deformed point of cell ({column}, {row}) is not finite; move the handles less far, or give them a larger `sigma`"
                );
            }
            Movable::RangeImage(range.with_points(field.positions)?)
        }
        Movable::ControlNet(net) => {
            let mut positions = field.positions;
            for ((new, old), fixed) in
                positions.iter_mut().zip(net.points()).zip(net.fixed_points())
            {
                if *fixed == 1 {
                    *new = *old;
                }
            }
            Movable::ControlNet(net.clone().with_points(positions)?)
        }
    })
}

fn mesh_of(mesh: &Mesh, field: Field) -> Result<Mesh, Error> {
    let given = mesh.vertex().vectors("normal");
    let (moved, normals) = match &field.rows {
        Some(rows) => {
            let normals = given.map(|given| given.with_rows(rows, &field.normals));
            (mesh.with_moved(rows, &field.positions)?, normals)
        }
        None => (mesh.with_positions(field.positions)?, given.map(|_| field.normals.into())),
    };
    let mut moved = moved.without_attribute("folded");
    if let Some(normals) = normals {
        moved = moved.with_vertex("normal", Attribute::Vector(normals))?;
    }
    if let Some(normals) = mesh.corner().vectors("normal") {
        let corners = mesh.faces().corners().iter().zip(normals.iter());
        let transformed = corners
            .map(|(&vertex, normal)| transform_normal(&field.jacobians[vertex as usize], normal));
        moved = moved.with_corner("normal", Attribute::Vector(transformed.collect()))?;
    }
    if field.folded.contains(&1) {
        let folded =
            scatter_rows(field.rows.as_deref(), field.folded, || vec![0; mesh.positions().len()]);
        moved = moved.with_vertex("folded", Attribute::Flag(folded.into()))?;
    }
    Ok(moved)
}

fn points_of(points: &Points, field: Field) -> Result<Points, Error> {
    let mut moved = points.with_positions(field.positions)?;
    if !field.normals.is_empty() {
        moved = moved.with_attribute("normal", Attribute::Vector(field.normals.into()))?;
    }
    if field.folded.contains(&1) {
        moved = moved.with_attribute("folded", Attribute::Flag(field.folded.into()))?;
    }
    Ok(moved)
}
