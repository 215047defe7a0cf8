//! What an eye sees at once: tears, kinks and needles, as numbers.

use std::collections::BTreeMap;

use maquette_value::{Attribute, Mesh, Region, border};
use nalgebra::{Point3, SMatrix, SVector};

use super::six::six;

/// What is wrong, and where.
pub(super) type Wrong = Option<(String, Vec<Point3<f64>>)>;

/// The least share of the best known combination of a quadratic's coefficients that the worst known one must have.
const LEAST_KNOWN: f64 = 1e-6;

/// How many places are reported.
const PLACES: usize = 1000;

/// Checks that no border of `mesh` comes nearer than `band` pixels to the region, measured in the picture.
pub(super) fn whole(mesh: &Mesh, region: &Region, band: f64) -> Wrong {
    let (Some(uv), Some(frame)) = (mesh.vertex().pairs("uv"), mesh.frame()) else {
        return Some((
            "has no texture coordinates of a capture, which tell what is seen where".to_owned(),
            Vec::new(),
        ));
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
                let share =
                    [0, 1].map(|axis| (away[axis] - at[axis]) / reach[axis].max(f64::MIN_POSITIVE));
                inside[row * grid[0] + column] == 1
                    && share[0] * share[0] + share[1] * share[1] <= 1.0
            },
        )
    };
    let near: Vec<[u32; 2]> =
        border(mesh).into_iter().filter(|edge| edge.iter().any(is_near)).collect();
    let first = mesh.positions()[near.first()?[0] as usize];
    let why = format!(
        "has {} border edges within {} px of the region; the first is at {}",
        near.len(),
        six(band),
        place(first)
    );
    Some((
        why,
        near.iter()
            .take(PLACES)
            .map(|&[a, b]| {
                nalgebra::center(&mesh.positions()[a as usize], &mesh.positions()[b as usize])
            })
            .collect(),
    ))
}

fn place(point: Point3<f64>) -> String {
    format!("({}, {}, {})", six(point.x), six(point.y), six(point.z))
}

/// How the two faces bend at each edge that has two, if `wanted` takes these.
fn bends(mesh: &Mesh, wanted: impl Fn(usize, usize) -> bool) -> Vec<Bend> {
    let edges = mesh.edges();
    // The face that met each edge first, until the other one does.
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

/// An edge, by how many degrees two faces bend there, and its middle.
struct Bend {
    edge: [u32; 2],
    angle: f64,
    at: Point3<f64>,
}

/// None where a face has no area: it looks nowhere.
fn bend_at(mesh: &Mesh, edge: [u32; 2], faces: [usize; 2]) -> Option<Bend> {
    let [m, n] = faces.map(|face| mesh.area_vector(mesh.faces().face(face)));
    if m.norm() == 0.0 || n.norm() == 0.0 {
        return None;
    }
    let angle = libm::atan2(m.cross(&n).norm(), m.dot(&n)).to_degrees();
    let [p, q] = edge.map(|vertex| mesh.positions()[vertex as usize]);
    Some(Bend { edge, angle, at: nalgebra::center(&p, &q) })
}

fn sharpest(found: Vec<Bend>, max: f64, what: &str) -> Wrong {
    let mut sharp: Vec<_> = found.into_iter().filter(|bend| bend.angle > max).collect();
    sharp.sort_by(|a, b| b.angle.total_cmp(&a.angle).then(a.edge.cmp(&b.edge)));
    let &Bend { angle, at, .. } = sharp.first()?;
    let why = format!(
        "bends by more than {} degrees at {} edges{what}; the sharpest, {} degrees, is at {}",
        six(max),
        sharp.len(),
        six(angle),
        place(at)
    );
    Some((why, sharp.iter().take(PLACES).map(|bend| bend.at).collect()))
}

/// Whether no two faces that share an edge bend by more than `max` degrees there.
pub(super) fn bend(mesh: &Mesh, max: f64) -> Wrong {
    sharpest(bends(mesh, |_, _| true), max, "")
}

/// The cell of a grid of so many columns and rows that a place of its picture shows, between cells and outside as it comes.
///
/// Upper left corners are at 0, as those of the picture.
fn cell([u, v]: [f64; 2], grid: [usize; 2]) -> [f64; 2] {
    [u * grid[0] as f64 - 0.5, (1.0 - v) * grid[1] as f64 - 0.5]
}

/// Which faces are new: those in the region, or, without one, those that were filled in.
fn new_faces(mesh: &Mesh, region: Option<&Region>) -> Result<Vec<bool>, &'static str> {
    let is_new: Vec<bool> = match (region, mesh.vertex().get("filled"), mesh.vertex().pairs("uv")) {
        (None, Some(Attribute::Flag(filled)), _) => filled.iter().map(|&flag| flag == 1).collect(),
        (None, ..) => return Err("says of no vertex whether it was `filled`"),
        (Some(_), _, None) => {
            return Err("has no texture coordinates of a capture, which tell what is seen where");
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

/// Whether new faces go on from the others without a bend of more than `max` degrees, and if it is given, without a jump of more than
/// `curvature`, in 1/mm.
pub(super) fn continuity(
    mesh: &Mesh,
    region: Option<&Region>,
    max: f64,
    curvature: Option<f64>,
) -> Wrong {
    let new = match new_faces(mesh, region) {
        Ok(new) => new,
        Err(why) => return Some((why.to_owned(), Vec::new())),
    };
    let rim = bends(mesh, |a, b| new[a] != new[b]);
    if rim.is_empty() {
        return Some(("has no edge between new faces and others".to_owned(), Vec::new()));
    }
    let bent = sharpest(rim, max, " around what is new");
    bent.or_else(|| {
        let (most, found) = (curvature?, jump(mesh, &new));
        (found > most).then(|| {
            let [found, most] = [found, most].map(six);
            let why = format!(
                "bends otherwise beside what is new: its curvature jumps by {found}/mm (RMS), more than {most}"
            );
            (why, Vec::new())
        })
    })
}

/// The root mean square of how much the curvature across the rim of the new faces jumps there, in 1/mm.
///
/// On each side of a vertex of the rim, a quadratic height over the tangent plane is fitted to the vertices of two rings of faces.
fn jump(mesh: &Mesh, new: &[bool]) -> f64 {
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
    let gap = |(&vertex, others): (&u32, &Vec<u32>)| {
        let &[before, after] = &others[..] else { return None };
        let [before, at, after] =
            [before, vertex, after].map(|vertex| mesh.positions()[vertex as usize]);
        let normal = normals[vertex as usize];
        let across = normal.cross(&(after - before)).try_normalize(0.0)?;
        let axes = [across, normal.cross(&across), normal];
        let curvature = |side: bool| {
            let faces = |vertex: u32| around[&vertex].iter().filter(|&&face| new[face] == side);
            let corners = |vertex: u32| faces(vertex).flat_map(|&face| mesh.faces().face(face));
            let mut near: Vec<u32> =
                corners(vertex).flat_map(|&other| corners(other)).copied().collect();
            near.sort_unstable();
            near.dedup();
            curvature_across(
                &near
                    .iter()
                    .map(|&other| {
                        let way = mesh.positions()[other as usize] - at;
                        axes.map(|axis| axis.dot(&way))
                    })
                    .collect::<Vec<_>>(),
            )
        };
        Some(curvature(true)? - curvature(false)?)
    };
    let gaps: Vec<f64> = rim.iter().filter_map(gap).collect();
    (gaps.iter().map(|gap| gap * gap).sum::<f64>() / gaps.len().max(1) as f64).sqrt()
}

/// The faces at each vertex of a rim, and at each other corner of these, in order.
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

/// The curvature along the first axis of the quadratic height over the first two axes that fits best; none if the places do not tell.
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
    if eigen.eigenvalues.min() < LEAST_KNOWN * eigen.eigenvalues.max() {
        return None;
    }
    let found = eigen.recompose().cholesky()?.solve(&right);
    let slope = 1.0 + found[0] * found[0] + found[1] * found[1];
    Some(found[2] / (reach * slope * slope.sqrt()))
}

/// Checks that a number of the vertices is nowhere out of its range.
pub(super) fn numbers(mesh: &Mesh, name: &str, min: Option<f64>, max: Option<f64>) -> Wrong {
    let Some(Attribute::Number(numbers)) = mesh.vertex().get(name) else {
        let known = mesh.vertex().iter().filter(|(_, it)| matches!(it, Attribute::Number(_)));
        let known = known.map(|(name, _)| format!("`{name}`")).collect::<Vec<_>>().join(", ");
        let which = if known.is_empty() { "none".to_owned() } else { format!("only {known}") };
        return Some((format!("has no number `{name}` at its vertices, {which}"), Vec::new()));
    };
    let fits =
        |number: f64| min.is_none_or(|min| min <= number) && max.is_none_or(|max| number <= max);
    let outside: Vec<usize> = (0..numbers.len()).filter(|&vertex| !fits(numbers[vertex])).collect();
    fn off(number: f64, min: &Option<f64>, max: &Option<f64>) -> f64 {
        let below = min.map_or(0.0, |min| min - number);
        let above = max.map_or(0.0, |max| number - max);
        if number.is_nan() { f64::INFINITY } else { below.max(above) }
    }
    let worst = *outside
        .iter()
        .max_by(|&&a, &&b| off(numbers[a], &min, &max).total_cmp(&off(numbers[b], &min, &max)))?;
    let why = format!(
        "has {} vertices with a `{name}` out of its range; the worst, {}, is at {}",
        outside.len(),
        six(numbers[worst]),
        place(mesh.positions()[worst])
    );
    Some((why, outside.iter().take(PLACES).map(|&vertex| mesh.positions()[vertex]).collect()))
}

#[cfg(test)]
mod tests {
    use maquette_value::{CaptureFrame, Faces, border_loops};

    use super::*;

    /// A sheet of 6 x 6 quads, as a capture of 6 x 6 cells sees it in a picture of 12 x 12 pixels, without the faces in `missing`, its
    /// columns from 3 on rising by `rise`.
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
    fn a_tear_near_a_region_is_found_and_one_far_away_is_none_of_its_business() {
        let cells = vec![14, 15, 20, 21];
        let points = vec![Point3::new(0.0, 0.0, 500.0); 4];
        let region = Region::new(6, 6, cells, points, vec![0; 4], vec![]).unwrap();
        assert_eq!(whole(&sheet(&[], 0.0), &region, 2.0), None);
        assert_eq!(whole(&sheet(&[0], 0.0), &region, 2.0), None);
        let (why, places) = whole(&sheet(&[21], 0.0), &region, 2.0).unwrap();
        assert!(why.starts_with("has 4 border edges within 2 px of the region"), "{why}");
        assert_eq!(places.len(), 4);
        assert!(whole(&sheet(&[], 0.0), &region, 5.2).is_some());
        assert!(whole(&sheet(&[], 0.0).with_frame(None), &region, 1.0).is_some());
    }

    #[test]
    fn bends_are_measured_in_degrees() {
        assert_eq!(bend(&sheet(&[], 1.0), 45.1), None);
        let (why, places) = bend(&sheet(&[], 1.0), 44.9).unwrap();
        assert!(why.contains("at 6 edges") && why.contains("45 degrees"), "{why}");
        assert_eq!(places.len(), 6);
    }

    #[test]
    fn the_rim_of_what_is_new_is_looked_at_alone() {
        fn filled(from: usize) -> Mesh {
            let flags = (0..49).map(|at| u8::from(at % 7 >= from)).collect();
            sheet(&[], 1.0).with_vertex("filled", Attribute::Flag(flags)).unwrap()
        }
        fn smooth(mesh: &Mesh) -> Option<(String, Vec<Point3<f64>>)> {
            continuity(mesh, None, 10.0, None)
        }
        assert!(smooth(&filled(4)).is_some());
        assert_eq!(smooth(&filled(6)), None);
        assert!(smooth(&filled(7)).unwrap().0.contains("no edge"));
        assert!(smooth(&sheet(&[], 0.0)).unwrap().0.contains("filled"));

        let cells: Vec<u32> = (0..36).filter(|cell| cell % 6 >= 4).collect();
        let points = vec![Point3::new(0.0, 0.0, 500.0); cells.len()];
        let depths = vec![0; cells.len()];
        let region = Region::new(6, 6, cells, points, depths, vec![]).unwrap();
        fn within(max: f64, region: &Region) -> Option<(String, Vec<Point3<f64>>)> {
            continuity(&sheet(&[], 1.0), Some(region), max, None)
        }
        assert_eq!(within(45.1, &region), None);
        assert!(within(10.0, &region).is_some());
    }

    #[test]
    fn a_plane_beside_a_cylinder_is_smooth_but_bends_otherwise() {
        // Along x, flat until 2, then round; new is what comes after column `from`.
        fn rolled(radius: f64, from: usize) -> Mesh {
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
            jump(mesh, &new_faces(mesh, None).unwrap())
        }
        // At the joint, and beside it.
        assert!((gap(&rolled(20.0, 2)) - 0.05).abs() < 0.003, "{}", gap(&rolled(20.0, 2)));
        assert!(gap(&rolled(20.0, 4)) < 0.001, "{}", gap(&rolled(20.0, 4)));
        let joint = rolled(20.0, 2);
        assert_eq!(continuity(&joint, None, 5.0, Some(0.06)), None);
        let (why, _) = continuity(&joint, None, 5.0, Some(0.04)).unwrap();
        assert!(why.contains("curvature jumps by 0.0"), "{why}");
    }

    #[test]
    fn numbers_of_vertices_have_ranges() {
        let mesh = sheet(&[], 0.0);
        assert_eq!(numbers(&mesh, "number", Some(0.0), Some(48.0)), None);
        let (why, places) = numbers(&mesh, "number", Some(2.0), Some(47.0)).unwrap();
        assert!(why.contains("3 vertices") && why.contains("the worst, 0,"), "{why}");
        assert_eq!(places.len(), 3);
        assert!(numbers(&mesh, "curvature", None, None).unwrap().0.contains("only `number`"));
    }
}
