//! Measures visible defects of meshes: holes near a selected region, sharp bends, jumps of the curvature, and vertex attributes out of
//! their range.

use std::collections::BTreeMap;

use maquette_value::{Attribute, Mesh, Region, border};
use nalgebra::{Point3, SMatrix, SVector};

use super::digits::six_digits;

/// A description of a defect with the positions where it occurs, or `None` if there is no defect.
pub(super) type Defect = Option<(String, Vec<Point3<f64>>)>;

/// The minimum ratio of the smallest to the largest eigenvalue in the least-squares fit of a quadratic. If the ratio is smaller, the points
/// do not determine all coefficients.
const MIN_EIGENVALUE_RATIO: f64 = 1e-6;

/// The maximum number of positions of a defect that are reported.
const MAX_POSITIONS: usize = 1000;

/// Checks that `mesh` covers the selected region of the picture: no border edge is within `band` pixels of a selected pixel.
pub(super) fn check_whole(mesh: &Mesh, region: &Region, band: f64) -> Defect {
    let (Some(uv), Some(frame)) = (mesh.vertex().pairs("uv"), mesh.frame()) else {
        return Some(("has no texture coordinates of a capture".to_owned(), Vec::new()));
    };
    let picture = frame.picture.map(|size| size as f64);
    let grid = [region.width(), region.height()];
    let reach = [0, 1].map(|axis| band * grid[axis] as f64 / picture[axis].max(1.0));
    let inside = region.grid();
    let is_near = |vertex: &u32| {
        let at = cell(uv[*vertex as usize], grid);
        let [columns, rows] = [0, 1].map(|axis| {
            let from = (at[axis] - reach[axis]).ceil().max(0.0) as usize;
            let to = (at[axis] + reach[axis] + 1.0).max(0.0) as usize;
            from..to.min(grid[axis])
        });
        rows.flat_map(|row| columns.clone().map(move |column| (row, column))).any(
            |(row, column)| {
                let away = [column, row].map(|line| line as f64);
                let offset =
                    [0, 1].map(|axis| (away[axis] - at[axis]) / reach[axis].max(f64::MIN_POSITIVE));
                inside[row * grid[0] + column] == 1
                    && offset[0] * offset[0] + offset[1] * offset[1] <= 1.0
            },
        )
    };
    let near: Vec<[u32; 2]> =
        border(mesh).into_iter().filter(|edge| edge.iter().any(is_near)).collect();
    let first = mesh.positions()[near.first()?[0] as usize];
    let why = format!(
        "has {} border edges within {} px of the region; the first is at {}",
        near.len(),
        six_digits(band),
        format_position(first)
    );
    Some((
        why,
        near.iter()
            .take(MAX_POSITIONS)
            .map(|&[a, b]| {
                nalgebra::center(&mesh.positions()[a as usize], &mesh.positions()[b as usize])
            })
            .collect(),
    ))
}

fn format_position(point: Point3<f64>) -> String {
    format!("({}, {}, {})", six_digits(point.x), six_digits(point.y), six_digits(point.z))
}

/// Returns the bends at all edges that have two faces and for which `wanted` returns true. `wanted` receives the indices of the two faces.
fn edge_bends(mesh: &Mesh, wanted: impl Fn(usize, usize) -> bool) -> Vec<Bend> {
    let edges = mesh.edges();
    // For each edge, the last visited face that contains the edge.
    let mut first = vec![usize::MAX; edges.vertices.len()];
    let mut found = Vec::new();
    for face in 0..mesh.faces().len() {
        for corner in mesh.faces().first_corner(face)..mesh.faces().first_corner(face + 1) {
            let edge = edges.of_corner[corner] as usize;
            let other = std::mem::replace(&mut first[edge], face);
            if edges.faces[edge] == 2 && other != usize::MAX && wanted(other, face) {
                found.extend(bend_at(mesh, edges.vertices[edge], [other, face]));
            }
        }
    }
    found
}

/// The bend at an edge: the angle between the normals of its two faces in degrees, and the midpoint of the edge.
struct Bend {
    edge: [u32; 2],
    angle: f64,
    at: Point3<f64>,
}

/// Returns the bend at an edge, or `None` if one of the two faces has no area and therefore no normal.
fn bend_at(mesh: &Mesh, edge: [u32; 2], faces: [usize; 2]) -> Option<Bend> {
    let [m, n] = faces.map(|face| mesh.area_vector(mesh.faces().face(face)));
    if faces.iter().zip([m, n]).any(|(&face, area)| area.norm() <= area_rounding(mesh, face)) {
        return None;
    }
    let angle = libm::atan2(m.cross(&n).norm(), m.dot(&n)).to_degrees();
    let [p, q] = edge.map(|vertex| mesh.positions()[vertex as usize]);
    Some(Bend { edge, angle, at: nalgebra::center(&p, &q) })
}

/// Returns the area that a face whose vertices are on a line may have because its coordinates are rounded.
fn area_rounding(mesh: &Mesh, face: usize) -> f64 {
    let corners = mesh.faces().face(face).iter().map(|&vertex| mesh.positions()[vertex as usize]);
    let (mut largest, mut extent) = (0.0, 0.0);
    let first = mesh.positions()[mesh.faces().face(face)[0] as usize];
    for corner in corners {
        largest = f64::max(largest, corner.coords.amax());
        extent = f64::max(extent, (corner - first).norm());
    }
    8.0 * f64::EPSILON * largest * extent
}

fn bends_above(found: Vec<Bend>, max: f64, what: &str) -> Defect {
    let mut sharp: Vec<_> = found.into_iter().filter(|bend| bend.angle > max).collect();
    sharp.sort_by(|a, b| b.angle.total_cmp(&a.angle).then(a.edge.cmp(&b.edge)));
    let &Bend { angle, at, .. } = sharp.first()?;
    let why = format!(
        "bends by more than {} degrees at {} edges{what}; the sharpest, {} degrees, is at {}",
        six_digits(max),
        sharp.len(),
        six_digits(angle),
        format_position(at)
    );
    Some((why, sharp.iter().take(MAX_POSITIONS).map(|bend| bend.at).collect()))
}

/// Checks that the two faces at each edge are bent by at most `max` degrees.
pub(super) fn check_bend(mesh: &Mesh, max: f64) -> Defect {
    bends_above(edge_bends(mesh, |_, _| true), max, "")
}

/// Returns the position of a texture coordinate in a grid of `grid[0]` columns and `grid[1]` rows, in units of cells. The position may be
/// between cells or outside of the grid.
///
/// The origin is the upper left corner of the grid, as in the picture.
fn cell([u, v]: [f64; 2], grid: [usize; 2]) -> [f64; 2] {
    [u * grid[0] as f64 - 0.5, (1.0 - v) * grid[1] as f64 - 0.5]
}

/// Returns a flag for each face, which is true if the face is new: if one of its vertices is in `region`. If no region is given, the new
/// vertices are those with the attribute `filled`.
fn new_faces(mesh: &Mesh, region: Option<&Region>) -> Result<Vec<bool>, &'static str> {
    let is_new: Vec<bool> = match (region, mesh.vertex().get("filled"), mesh.vertex().pairs("uv")) {
        (None, Some(Attribute::Flag(filled)), _) => filled.iter().map(|&flag| flag == 1).collect(),
        (None, ..) => return Err("has no vertex attribute `filled`"),
        (Some(_), _, None) => {
            return Err("has no texture coordinates of a capture");
        }
        (Some(region), _, Some(uv)) => {
            let size = [region.width(), region.height()];
            let inside = region.grid();
            uv.iter()
                .map(|&uv| {
                    let [column, row] = cell(uv, size).map(f64::round);
                    let is_seen = 0.0 <= column && 0.0 <= row && (column as usize) < size[0];
                    let at = row as usize * size[0] + column as usize;
                    is_seen && inside.get(at) == Some(&1)
                })
                .collect()
        }
    };
    Ok(mesh.faces().iter().map(|face| face.iter().any(|&vertex| is_new[vertex as usize])).collect())
}

/// Checks that the new faces (which fill a hole) continue the old faces smoothly. The bend at each edge between a new and an old face must
/// be at most `max` degrees. If `curvature` is given, it is the maximum jump of the curvature across these edges, in 1/mm.
pub(super) fn check_continuity(
    mesh: &Mesh,
    region: Option<&Region>,
    max: f64,
    curvature: Option<f64>,
) -> Defect {
    let new = match new_faces(mesh, region) {
        Ok(new) => new,
        Err(why) => return Some((why.to_owned(), Vec::new())),
    };
    let rim = edge_bends(mesh, |a, b| new[a] != new[b]);
    if rim.is_empty() {
        return Some(("has no edge between new faces and others".to_owned(), Vec::new()));
    }
    let bent = bends_above(rim, max, " around the new faces");
    bent.or_else(|| {
        let (most, found) = (curvature?, curvature_jump(mesh, &new));
        (found > most).then(|| {
            let [found, most] = [found, most].map(six_digits);
            let why = format!(
                "is not smooth around the new faces: its curvature jumps by {found}/mm (RMS), more than {most}"
            );
            (why, Vec::new())
        })
    })
}

/// Returns the root mean square of the jump of the curvature, in 1/mm, across the rim. The rim is the border between the new and the old
/// faces.
///
/// At each vertex of the rim and on each side of the rim, a quadratic height function over the tangent plane is fitted to nearby vertices:
/// those of two rings of faces around the vertex.
fn curvature_jump(mesh: &Mesh, new: &[bool]) -> f64 {
    let mut rim: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    let edges = mesh.edges();
    let mut sides = vec![[false; 2]; edges.vertices.len()];
    for (face, &is_new) in new.iter().enumerate() {
        for corner in mesh.faces().first_corner(face)..mesh.faces().first_corner(face + 1) {
            sides[edges.of_corner[corner] as usize][usize::from(is_new)] = true;
        }
    }
    for (&[a, b], _) in edges.vertices.iter().zip(&sides).filter(|(_, sides)| **sides == [true; 2])
    {
        rim.entry(a).or_default().push(b);
        rim.entry(b).or_default().push(a);
    }
    let around = faces_around(mesh, &rim);
    let normals = mesh.vertex_normals();
    let mut gaps: Vec<f64> = Vec::new();
    for (&vertex, others) in &rim {
        let &[before, after] = &others[..] else { continue };
        let [before, at, after] =
            [before, vertex, after].map(|vertex| mesh.positions()[vertex as usize]);
        let normal = normals[vertex as usize];
        let Some(across) = normal.cross(&(after - before)).try_normalize(0.0) else { continue };
        let axes = [across, normal.cross(&across), normal];
        let [old_side, new_side] = [false, true].map(|side| {
            let side_of = SideOfRim { mesh, around: &around, new, side };
            let points = side_of.two_rings(vertex).into_iter().map(|other| {
                let offset = mesh.positions()[other as usize] - at;
                axes.map(|axis| axis.dot(&offset))
            });
            curvature_across(&points.collect::<Vec<_>>())
        });
        gaps.extend(new_side.zip(old_side).map(|(new_side, old_side)| new_side - old_side));
    }
    (gaps.iter().map(|gap| gap * gap).sum::<f64>() / gaps.len().max(1) as f64).sqrt()
}

/// The faces on one side of the rim (the border between new and old faces): either the new faces or the old ones.
struct SideOfRim<'a> {
    mesh: &'a Mesh,
    around: &'a BTreeMap<u32, Vec<usize>>,
    new: &'a [bool],
    side: bool,
}

impl SideOfRim<'_> {
    /// Returns the corners of all faces at `vertex` that are on this side of the rim. A vertex can occur more than once.
    fn corners(&self, vertex: u32) -> impl Iterator<Item = u32> {
        let faces = self.around[&vertex].iter().filter(move |&&face| self.new[face] == self.side);
        faces.flat_map(move |&face| self.mesh.faces().face(face)).copied()
    }

    /// Returns the vertices of the two rings of faces around `vertex` that are on this side of the rim, in ascending order.
    fn two_rings(&self, vertex: u32) -> Vec<u32> {
        let mut near: Vec<u32> =
            self.corners(vertex).flat_map(|other| self.corners(other)).collect();
        near.sort_unstable();
        near.dedup();
        near
    }
}

/// Returns the indices of the faces at each vertex, ascending. Covers the vertices of the rim (the border between new and old faces), and
/// all vertices that share a face with a vertex of the rim.
fn faces_around(mesh: &Mesh, rim: &BTreeMap<u32, Vec<u32>>) -> BTreeMap<u32, Vec<usize>> {
    let [mut is_rim, mut is_near] = [(); 2].map(|()| vec![false; mesh.positions().len()]);
    rim.keys().for_each(|&vertex| is_rim[vertex as usize] = true);
    for face in mesh.faces().iter().filter(|face| face.iter().any(|&it| is_rim[it as usize])) {
        face.iter().for_each(|&vertex| is_near[vertex as usize] = true);
    }
    let mut around: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (index, face) in mesh.faces().iter().enumerate() {
        for &vertex in face.iter().filter(|&&vertex| is_near[vertex as usize]) {
            around.entry(vertex).or_default().push(index);
        }
    }
    around
}

/// Fits a quadratic height function z(x, y) to points, and returns the curvature of the function along the x axis. Returns `None` if the
/// points do not determine the function.
fn curvature_across(places: &[[f64; 3]]) -> Option<f64> {
    let reach_sq = places.iter().map(|[x, y, _]| x * x + y * y).sum::<f64>() / places.len() as f64;
    let reach = reach_sq.sqrt();
    let (mut matrix, mut right) = (SMatrix::<f64, 5, 5>::zeros(), SVector::<f64, 5>::zeros());
    for place in places {
        let [x, y, z] = place.map(|part| part / reach);
        let row = SVector::from([x, y, x * x / 2.0, x * y, y * y / 2.0]);
        matrix += row * row.transpose();
        right += row * z;
    }
    let eigen = matrix.symmetric_eigen();
    if eigen.eigenvalues.min() < MIN_EIGENVALUE_RATIO * eigen.eigenvalues.max() {
        return None;
    }
    let found = eigen.recompose().cholesky()?.solve(&right);
    let slope = 1.0 + found[0] * found[0] + found[1] * found[1];
    Some(found[2] / (reach * slope * slope.sqrt()))
}

/// Checks that the vertex attribute `name` is between `min` and `max` at every vertex.
pub(super) fn check_attribute(
    mesh: &Mesh,
    name: &str,
    min: Option<f64>,
    max: Option<f64>,
) -> Defect {
    let Some(Attribute::Number(numbers)) = mesh.vertex().get(name) else {
        let known = mesh.vertex().iter().filter(|(_, it)| matches!(it, Attribute::Number(_)));
        let known = known.map(|(name, _)| format!("`{name}`")).collect::<Vec<_>>().join(", ");
        let which = if known.is_empty() { "none".to_owned() } else { format!("only {known}") };
        return Some((format!("has no number `{name}` at its vertices, {which}"), Vec::new()));
    };
    let outside: Vec<usize> = (0..numbers.len())
        .filter(|&vertex| {
            let number = numbers[vertex];
            !(min.is_none_or(|min| min <= number) && max.is_none_or(|max| number <= max))
        })
        .collect();
    /// Returns the distance by which a number is outside of its range; 0 if it is inside.
    fn excess(number: f64, min: Option<f64>, max: Option<f64>) -> f64 {
        let below = min.map_or(0.0, |min| min - number);
        let above = max.map_or(0.0, |max| number - max);
        if number.is_nan() { f64::INFINITY } else { below.max(above) }
    }
    let worst = *outside
        .iter()
        .max_by(|&&a, &&b| excess(numbers[a], min, max).total_cmp(&excess(numbers[b], min, max)))?;
    let why = format!(
        "has {} vertices with a `{name}` out of its range; the worst, {}, is at {}",
        outside.len(),
        six_digits(numbers[worst]),
        format_position(mesh.positions()[worst])
    );
    Some((
        why,
        outside.iter().take(MAX_POSITIONS).map(|&vertex| mesh.positions()[vertex]).collect(),
    ))
}

#[cfg(test)]
mod tests {
    use maquette_value::{CaptureFrame, Faces, border_loops};

    use super::*;

    /// Creates a sheet of 6 x 6 quads without the faces in `missing`. It looks like a scan of 6 x 6 cells in a picture of 12 x 12 pixels.
    /// The first columns are flat. From column 3 on, the step up to the next column grows by `rise`.
    fn sheet(missing: &[usize], rise: f64) -> Mesh {
        let points = (0..49).map(|at| {
            let [x, y] = [(at % 7) as f64, (at / 7) as f64];
            Point3::new(x, y, 500.0 - rise * (x - 3.0).max(0.0))
        });
        let quads = (0..36).filter(|face| !missing.contains(face)).flat_map(|face| {
            let a = (face / 6 * 7 + face % 6) as u32;
            [a, a + 7, a + 8, a + 1]
        });
        let faces = Faces::uniform(4, quads.collect::<Vec<u32>>()).unwrap();
        let frame =
            CaptureFrame { camera: None, picture: [12, 12], depth: 500.0, world_from_camera: None };
        let uv = (0..49).map(|at| [(at % 7) as f64 / 6.0, 1.0 - (at / 7) as f64 / 6.0]);
        let number = (0..49).map(f64::from);
        Mesh::new(points.collect::<Vec<_>>(), faces)
            .and_then(|mesh| mesh.with_vertex("uv", Attribute::Pair(uv.collect())))
            .and_then(|mesh| mesh.with_vertex("number", Attribute::Number(number.collect())))
            .unwrap()
            .with_frame(Some(frame))
    }

    #[test]
    fn loops_of_the_border_are_counted() {
        assert_eq!(border_loops(&sheet(&[], 0.0)), 1);
        assert_eq!(border_loops(&sheet(&[14], 0.0)), 2);
        assert_eq!(border_loops(&sheet(&[7, 10, 28], 0.0)), 4);
    }

    #[test]
    fn only_tears_near_the_region_are_reported() {
        let cells = vec![14, 15, 20, 21];
        let points = vec![Point3::new(0.0, 0.0, 500.0); 4];
        let region = Region::new(6, 6, cells, points, vec![0; 4], vec![]).unwrap();
        assert_eq!(check_whole(&sheet(&[], 0.0), &region, 2.0), None);
        assert_eq!(check_whole(&sheet(&[0], 0.0), &region, 2.0), None);
        let (why, places) = check_whole(&sheet(&[21], 0.0), &region, 2.0).unwrap();
        assert!(why.starts_with("has 4 border edges within 2 px of the region"), "{why}");
        assert_eq!(places.len(), 4);
        assert!(check_whole(&sheet(&[], 0.0), &region, 5.2).is_some());
        assert!(check_whole(&sheet(&[], 0.0).with_frame(None), &region, 1.0).is_some());
    }

    #[test]
    fn bends_are_measured_in_degrees() {
        assert_eq!(check_bend(&sheet(&[], 1.0), 45.1), None);
        let (why, places) = check_bend(&sheet(&[], 1.0), 44.9).unwrap();
        assert!(why.contains("at 6 edges") && why.contains("45 degrees"), "{why}");
        assert_eq!(places.len(), 6);
    }

    #[test]
    fn only_the_rim_of_new_faces_is_checked() {
        fn sheet_filled_from(from: usize) -> Mesh {
            let flags = (0..49).map(|at| u8::from(at % 7 >= from)).collect();
            sheet(&[], 1.0).with_vertex("filled", Attribute::Flag(flags)).unwrap()
        }
        fn kink(mesh: &Mesh) -> Option<(String, Vec<Point3<f64>>)> {
            check_continuity(mesh, None, 10.0, None)
        }
        assert!(kink(&sheet_filled_from(4)).is_some());
        assert_eq!(kink(&sheet_filled_from(6)), None);
        assert!(kink(&sheet_filled_from(7)).unwrap().0.contains("no edge"));
        assert!(kink(&sheet(&[], 0.0)).unwrap().0.contains("filled"));

        let cells: Vec<u32> = (0..36).filter(|cell| cell % 6 >= 4).collect();
        let points = vec![Point3::new(0.0, 0.0, 500.0); cells.len()];
        let depths = vec![0; cells.len()];
        let region = Region::new(6, 6, cells, points, depths, vec![]).unwrap();
        fn bend_at_region(max: f64, region: &Region) -> Option<(String, Vec<Point3<f64>>)> {
            check_continuity(&sheet(&[], 1.0), Some(region), max, None)
        }
        assert_eq!(bend_at_region(45.1, &region), None);
        assert!(bend_at_region(10.0, &region).is_some());
    }

    #[test]
    fn a_plane_next_to_a_cylinder_has_a_jump_of_curvature() {
        // Creates a sheet that is flat for x below 2 and continues as a half cylinder. The vertices after column `from` are marked as new.
        fn half_cylinder(radius: f64, from: usize) -> Mesh {
            let flat = sheet(&[], 0.0);
            let points = flat.positions().iter().map(|point| {
                let turn = (point.x - 2.0).max(0.0) / radius;
                let [x, z] = [libm::sin(turn), 1.0 - libm::cos(turn)].map(|part| part * radius);
                Point3::new(point.x.min(2.0) + x, point.y, point.z - z)
            });
            let flags = (0..49).map(|at| u8::from(at % 7 > from)).collect();
            let rolled = flat.with_positions(points.collect()).unwrap();
            rolled.with_vertex("filled", Attribute::Flag(flags)).unwrap()
        }
        fn gap(mesh: &Mesh) -> f64 {
            curvature_jump(mesh, &new_faces(mesh, None).unwrap())
        }
        // The new faces begin where the flat part meets the cylinder, or one column beside it.
        assert!(
            (gap(&half_cylinder(20.0, 2)) - 0.05).abs() < 0.003,
            "{}",
            gap(&half_cylinder(20.0, 2))
        );
        assert!(gap(&half_cylinder(20.0, 4)) < 0.001, "{}", gap(&half_cylinder(20.0, 4)));
        let joint = half_cylinder(20.0, 2);
        assert_eq!(check_continuity(&joint, None, 5.0, Some(0.06)), None);
        let (why, _) = check_continuity(&joint, None, 5.0, Some(0.04)).unwrap();
        assert!(why.contains("curvature jumps by 0.0"), "{why}");
    }

    #[test]
    fn vertex_attributes_outside_of_their_range_are_reported() {
        let mesh = sheet(&[], 0.0);
        assert_eq!(check_attribute(&mesh, "number", Some(0.0), Some(48.0)), None);
        let (why, places) = check_attribute(&mesh, "number", Some(2.0), Some(47.0)).unwrap();
        assert!(why.contains("3 vertices") && why.contains("the worst, 0,"), "{why}");
        assert_eq!(places.len(), 3);
        assert!(
            check_attribute(&mesh, "curvature", None, None).unwrap().0.contains("only `number`")
        );
    }
}
