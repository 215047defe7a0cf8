//! Gives a surface a thickness.
//!
//! Moving each vertex along its normal would fold the surface where its radius of curvature is smaller than the thickness. Limiting the
//! motions makes thin walls, and repairing thin walls makes blobs. Instead, the surface is closed to a body: each border gets a lid. Where
//! a lid would touch the surface, a wall is added between both. A grid gives the volume within the thickness of the surface, and `Boolean`
//! takes the part of the body inside of that volume. The surface itself does not change.

use std::collections::BTreeMap;

use maquette_fill::{FillMethod, HoleChoice, fill_holes};
use maquette_mesh::{Outside, orient};
use maquette_node::{
    CancelledError, Carry, Context, Error, In, Node, Progress, Promise, Transfer, Want, bail,
};
use maquette_value::{Mesh, MeshError, TriangleTree};
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::base::{Ground, visible_part, with_base};
use crate::combine::boolean;
use crate::extended::{ExtendedMesh, border};
use crate::offset::offset_surface;
use crate::operation::Operation;
use crate::polygons::{loops, project_to_plane, triangulate};
use crate::thicken::{still_thin, thin};
use crate::transfer_attributes::transfer_attributes;
use crate::volume::volume;

/// Gives a surface a thickness: an open scan becomes a shell that can be printed, as a mask is.
///
/// The surface itself does not change, unless it is in the middle. The other side is everywhere at the distance `thickness`, and is missing
/// where there is no room for it: a finger becomes solid. Borders get walls. Where the surface encloses something thinner, or a border
/// meets the surface at a sharp angle, the shell is thinner, with a warning. The other side has the attributes of the nearest point of the
/// surface.
///
/// In other programs: solidify, thicken, extrude.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Shell {
    /// The surface.
    pub mesh: In<Mesh>,
    /// Minimum thickness in mm.
    #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
    #[serde(default = "default_thickness")]
    pub thickness: f64,
    /// The side of the surface on which the shell is added.
    #[serde(default)]
    pub side: Side,
}

fn default_thickness() -> f64 {
    2.0
}

/// Position of a shell relative to its surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Side {
    /// Behind the surface, which is the visible front.
    #[default]
    Inside,
    /// In front of the surface.
    Outside,
    /// Half of the thickness on each side.
    Middle,
}

/// A reason why a surface that was closed by lids and walls does not bound a body.
#[derive(Debug, thiserror::Error)]
enum BodyError {
    #[error("the faces that close the surface intersect it: {count} pairs of faces cross, the first one at ({:.3}, {:.3}, {:.3}); use `side: Middle`, which needs no closed surface, or `Reconstruct` if the surface intersects itself there", at.x, at.y, at.z)]
    Crossing { count: usize, at: Point3<f64> },
    #[error(
        "the faces that close the surface touch it or themselves: {count} edges do not have two faces; use `side: Middle`, which needs no closed surface"
    )]
    Touching { count: usize },
    #[error(
        "the surface has no inside behind it: use `Orient` to make its faces look outward, or `side: Middle`, which needs no inside"
    )]
    InsideOut,
}

impl Node for Shell {
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
        let (shell, thin) = shell(cx.get(&self.mesh), self.thickness, self.side, cx.progress())?;
        if thin > 0 {
            cx.warn(still_thin(thin, self.thickness));
        }
        Ok((shell,))
    }
}

/// Factor by which the requested distance is multiplied. Without this factor, the flat faces of the offset surface would be too close to
/// the surface where the surface is curved.
const DISTANCE_FACTOR: f64 = 1.06;

/// Height of the walls between a border and its lid, as a multiple of the shell's thickness. The height of the walls must be greater than
/// the thickness of the shell.
const WALL_FACTOR: f64 = 1.3;

/// Minimum absolute cosine of the angle between the normals of a lid and of the surface at its border, for which walls are added between
/// both: that of 45 degrees. At smaller angles, the lid would touch the surface or its back.
const FLAT: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Returns the shell of a surface, see [`Shell`], and the number of faces at which the shell is thinner than requested.
///
/// The result is the intersection of two volumes: a body that is made by closing the surface, and the volume within `thickness` of the
/// surface. The surface of an intersection never intersects itself, so neither does the other side of the shell. Where there is no room,
/// the other side is missing. The cost grows with the area of the surface, in squares of the thickness.
///
/// # Errors
/// Returns an error if the thickness is invalid, the surface cannot be closed, there are too many cells around it, or the evaluation is
/// cancelled.
pub fn shell(
    mesh: &Mesh,
    thickness: f64,
    side: Side,
    progress: &Progress<'_>,
) -> Result<(Mesh, usize), Error> {
    if !(thickness > 0.0 && thickness.is_finite()) {
        bail!("`thickness` is {thickness}, but must be a number above 0");
    }
    let edges = mesh.edges();
    let count = edges.misoriented + edges.faces.iter().filter(|faces| 2 < **faces).count();
    if count > 0 {
        bail!(
            "the faces are not a surface: {count} edges have more than two faces, or two with different orientations; use `Orient` to turn faces"
        );
    }
    fn non_empty(made: Mesh, thickness: f64, mesh: &Mesh) -> Result<Mesh, Error> {
        match made.faces().is_empty() {
            false => Ok(made),
            true => {
                let size = mesh.bounds().map_or(0.0, |(low, high)| (high - low).norm());
                bail!(
                    "the shell is empty: `thickness`, {thickness} mm, is too large or too small for the surface's size of {size} mm"
                )
            }
        }
    }
    let around = |mesh: &Mesh, distance: f64, progress: &Progress<'_>| {
        let around = non_empty(
            offset_surface(mesh, (DISTANCE_FACTOR * distance, 2.0), None, progress)?,
            thickness,
            mesh,
        )?;
        let around = transfer_attributes(mesh, &TriangleTree::new(mesh), around)?;
        Ok::<_, Error>(around.with_frame(mesh.frame().copied()))
    };
    if side == Side::Middle {
        return Ok((around(mesh, thickness / 2.0, progress)?, 0));
    }
    let mesh = &non_empty(mesh.clone(), thickness, mesh)?;
    let behind = WALL_FACTOR * thickness;
    let (body, is_outside) = progress.part(0.0..0.2, |progress| match side {
        Side::Outside => body_in_front(mesh, behind, progress),
        _ => Ok((body(mesh, behind, progress)?, false)),
    })?;
    let around = progress.part(0.2..0.6, |progress| around(mesh, thickness, progress))?;
    let shell = progress.part(0.6..0.9, |progress| match is_outside {
        true => boolean(&around, &[&body], Operation::Difference, progress),
        false => boolean(&body, &[&around], Operation::Intersection, progress),
    })?;
    let shell = non_empty(shell, thickness, mesh)?;
    let thin = thin(&shell, &TriangleTree::new(&shell), thickness).len();
    Ok((shell, thin))
}

/// Returns the closed body in front of the surface, and false. If no volume in front of the surface can be closed, returns the body behind
/// the surface, and true; the shell is then outside of that body.
fn body_in_front(mesh: &Mesh, behind: f64, progress: &Progress<'_>) -> Result<(Mesh, bool), Error> {
    if !border(mesh).is_empty() {
        match body(&orient(mesh, Outside::Flip)?.mesh, behind, progress) {
            Err(error) if is_touching_or_inside_out(&error) => {}
            found => return Ok((found?, false)),
        }
    }
    // Make the body behind the surface without walls at its borders. The shell is outside of this body, so walls would add material to the
    // shell there.
    Ok((body(mesh, 0.0, progress)?, true))
}

fn is_touching_or_inside_out(error: &Error) -> bool {
    matches!(error.downcast(), Some(BodyError::InsideOut | BodyError::Touching { .. }))
}

/// Returns the reason why a mesh does not bound a body; `None` if it does. A body has no self-intersections, two faces at each edge, and
/// faces that look outward.
fn body_error(body: &Mesh, progress: &Progress<'_>) -> Result<Option<BodyError>, CancelledError> {
    let found = body.crossings(|| progress.check())?;
    let count = body.edges().faces.iter().filter(|faces| **faces != 2).count();
    Ok(match found.first() {
        Some(&[face, _]) => {
            let at = body.first_triangle_center(body.faces().face(face as usize));
            Some(BodyError::Crossing { count: found.len(), at })
        }
        None if count > 0 => Some(BodyError::Touching { count }),
        None if volume(body, body.positions()[0]) <= 0.0 => Some(BodyError::InsideOut),
        None => None,
    })
}

/// Makes a closed body that contains the faces of a surface. The surface's borders get flat lids; if lids intersect the surface, the
/// borders are filled as holes instead, or get walls to a flat base. Walls have at least the height `behind`; 0 means no walls.
fn body(mesh: &Mesh, behind: f64, progress: &Progress<'_>) -> Result<Mesh, Error> {
    let (body, _) = with_lids(mesh, behind, true)?;
    let Some(why) = body_error(&body, progress)? else { return Ok(body) };
    let (open, rims) = with_lids(mesh, behind, false)?;
    let all = HoleChoice::Loops((0..rims).collect());
    let filled = fill_holes(&open, &all, &FillMethod::Membrane, progress);
    let based = Ground::of_mesh(mesh, behind, None).and_then(|ground| {
        let front = if mesh.frame().is_some() { visible_part(mesh, &ground) } else { mesh.clone() };
        with_base(&front, &ground)
    });
    for body in filled.ok().map(|it| it.mesh).into_iter().chain(based.ok()) {
        if body_error(&body, progress)?.is_none() {
            return Ok(body);
        }
    }
    Err(why.into())
}

/// Adds a flat lid to each border if `lids` is true, and walls where a lid would touch the surface or its back. Returns the new mesh and
/// the number of borders.
fn with_lids(mesh: &Mesh, behind: f64, lids: bool) -> Result<(Mesh, usize), MeshError> {
    let faces = mesh.faces();
    let (corners, points) = (faces.corners(), mesh.positions());
    let sides =
        border(mesh).into_iter().map(|own| (own.1.map(|corner| corners[corner as usize]), own));
    // A lid uses the sides of the border in the opposite direction.
    let sides: BTreeMap<[u32; 2], _> = sides.map(|([a, b], own)| ([b, a], own)).collect();
    let mut grown = ExtendedMesh::new(mesh);
    let rims = loops(&sides.keys().copied().collect::<Vec<_>>());
    let rims: Vec<_> = rims.iter().flat_map(|rim| split_loop(rim)).collect();
    let count = rims.len();
    for rim in rims {
        let next = rim[1..].iter().chain(&rim[..1]);
        let own: Vec<_> = rim.iter().zip(next).map(|(&a, &b)| sides[&[a, b]]).collect();

        let from =
            |corner: u32| points[corners[corner as usize] as usize] - points[rim[0] as usize];
        // The area vector of the lid. Its direction is compared with `out`, the mean normal of the faces at the lid's border.
        let lid: Vector3<f64> = own.iter().map(|(_, [a, b])| from(*b).cross(&from(*a))).sum();
        let out = own.iter().map(|(face, _)| {
            let out = mesh.area_vector(faces.face(*face as usize));
            out.try_normalize(0.0).unwrap_or_default()
        });
        let out = out.sum::<Vector3<f64>>() / own.len() as f64;
        let lid = lid.try_normalize(0.0).or(out.try_normalize(0.0)).unwrap_or_default();
        let has_walls = 0.0 < behind && FLAT < lid.dot(&out).abs();
        let way = if has_walls { -out.normalize() * behind } else { Vector3::zeros() };
        // For each border vertex, the vertex at the other end of its wall: index, position, and the corner and face whose attributes it
        // copies.
        let mut feet = BTreeMap::new();
        for &(face, [_, corner]) in &own {
            let at = corners[corner as usize];
            feet.entry(at).or_insert_with(|| {
                let foot = points[at as usize] + way;
                let number = if has_walls { grown.add_vertex(foot, at) } else { at };
                (number, foot, corner, face)
            });
        }
        for &(face, [a, b]) in own.iter().filter(|_| has_walls) {
            let [vertex_a, vertex_b] = [a, b].map(|corner| corners[corner as usize]);
            let (low_a, low_b) = (feet[&vertex_a].0, feet[&vertex_b].0);
            let wall = [[vertex_b, b], [vertex_a, a], [low_a, a], [low_b, b]];
            grown.add_face([0, 1, 2].map(|k: usize| wall[k]), face);
            grown.add_face([0, 2, 3].map(|k: usize| wall[k]), face);
        }
        if !lids {
            continue;
        }
        for triangle in triangulate(&[rim], |at| project_to_plane(feet[&at].1, lid)) {
            let own = triangle.map(|at| feet[&at]);
            grown.add_face(own.map(|(foot, _, corner, _)| [foot, corner]), own[0].3);
        }
    }
    Ok((grown.mesh()?, count))
}

/// Splits a loop of border vertices into simple loops at each vertex that the loop visits twice. This is needed because holes that share a
/// vertex have a common loop.
fn split_loop(rim: &[u32]) -> Vec<Vec<u32>> {
    let (mut loops, mut own) = (Vec::new(), Vec::new());
    let mut places = BTreeMap::new();
    for &vertex in rim {
        if let Some(&start) = places.get(&vertex) {
            let inner: Vec<u32> = own.split_off(start);
            for vertex in &inner {
                places.remove(vertex);
            }
            loops.push(inner);
        }
        places.insert(vertex, own.len());
        own.push(vertex);
    }
    loops.push(own);
    loops
}

#[cfg(test)]
mod tests {
    use maquette_value::{Attribute, Faces};
    use nalgebra::Point3;

    use super::*;

    /// Returns a grid of 21 x 21 points over 20 x 20 mm with the given heights.
    fn net(height: impl Fn(f64, f64) -> f64) -> Mesh {
        let places = (0..441).map(|k| [f64::from(k % 21) - 10.0, f64::from(k / 21) - 10.0]);
        let positions = places.map(|[x, y]| Point3::new(x, y, height(x, y))).collect::<Vec<_>>();
        let cells = (0..420).filter(|k| k % 21 < 20);
        let faces = cells.flat_map(|k| [[k, k + 1, k + 22], [k, k + 22, k + 21]]).collect();
        Mesh::new(positions, Faces::triangles(faces)).unwrap()
    }

    fn check(mesh: &Mesh, thickness: f64, side: Side, most_thin: f64) -> Mesh {
        let (shell, thin) = shell(mesh, thickness, side, &Progress::silent()).unwrap();
        let edges = shell.edges();
        assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2));
        assert_eq!(shell.crossings(|| Progress::silent().check()).unwrap(), Vec::<[u32; 2]>::new());
        assert!(
            thin as f64 <= most_thin * shell.faces().len() as f64,
            "{thin} of {}",
            shell.faces().len()
        );
        shell
    }

    fn volume(mesh: &Mesh) -> f64 {
        crate::volume::volume(mesh, Point3::origin())
    }

    #[test]
    fn a_plane_becomes_a_plate_on_the_side_that_is_asked_for() {
        let plane = net(|_, _| 0.0);
        for (side, low) in [(Side::Inside, -2.12), (Side::Outside, 0.0)] {
            let plate = check(&plane, 2.0, side, 0.0);
            let bounds = plate.bounds().unwrap();
            assert!((bounds.0.z - low).abs() < 1e-6 && (bounds.1.z - low - 2.12).abs() < 1e-6);
            // The walls of the plate are upright, so its volume is its area times its thickness.
            assert!((volume(&plate) - 400.0 * 2.12).abs() < 0.5, "{}", volume(&plate));
        }
        let plate = check(&plane, 2.0, Side::Middle, 0.0);
        let bounds = plate.bounds().unwrap();
        assert!((bounds.0.z + 1.06).abs() < 1e-6 && (bounds.1.z - 1.06).abs() < 1e-6);
    }

    #[test]
    fn the_surface_stays_where_the_other_side_has_no_room() {
        // The surface has noise, and a ridge that is narrower than twice the thickness.
        fn noise(x: f64, y: f64) -> f64 {
            0.1 * libm::sin(37.0 * x + 91.0 * y * y)
        }
        let ridge = net(|x, y| 4.0 * libm::exp(-x * x / 3.0) + noise(x, y));
        for side in [Side::Inside, Side::Outside] {
            let shell = check(&ridge, 1.5, side, 0.01);
            let places = shell.positions();
            assert!(ridge.positions().iter().all(|at| places.contains(at)), "{side:?}");
        }
        check(&ridge, 1.5, Side::Middle, 0.01);
    }

    #[test]
    fn a_cap_gets_an_even_rim_and_a_hole_stays_open() {
        let dome = net(|x, y| (225.0 - x * x - y * y).sqrt());
        let kept = (0..dome.faces().len()).filter(|&face| {
            let mut places =
                dome.faces().face(face).iter().map(|&it| dome.positions()[it as usize]);
            !places.all(|at| at.x.abs() < 3.1 && (-2.1..1.1).contains(&at.y))
        });
        let dome = dome.select(&kept.map(|face| face as u32).collect::<Vec<_>>());
        let shell = check(&dome, 1.0, Side::Inside, 0.03);
        let (vertices, faces, edges) =
            (shell.positions().len(), shell.faces().len(), shell.edges().faces.len());
        // The shell is a plate with a hole: its Euler characteristic is that of a torus.
        assert_eq!(vertices + faces, edges);
        // The lowest point of the shell must not be below the border of the surface.
        fn lowest(mesh: &Mesh) -> f64 {
            mesh.bounds().unwrap().0.z
        }
        assert_eq!(lowest(&shell), lowest(&dome));
    }

    #[test]
    fn a_closed_mesh_becomes_hollow() {
        let block = crate::thicken::tests::cuboid([10.0, 12.0, 14.0], 2);
        let hollow = check(&block, 1.0, Side::Inside, 0.0);
        let inner = 1680.0 - volume(&hollow);
        assert!((inner - 7.88 * 9.88 * 11.88).abs() < 0.03 * inner, "{inner}");
    }

    #[test]
    fn a_closed_mesh_gets_a_shell_around_it() {
        let block = crate::thicken::tests::cuboid([10.0, 12.0, 14.0], 2);
        let outside = check(&block, 1.0, Side::Outside, 0.0);
        let (low, high) = outside.bounds().unwrap();
        let size = high - low;
        for (size, own) in size.iter().zip([10.0, 12.0, 14.0]) {
            assert!((size - own - 2.12).abs() < 0.02, "{size} around {own}");
        }
        // The block itself is the cavity. The outer edges are rounded, so the volume is less than that of the box around the shell.
        let hollow = volume(&outside);
        let most = 12.12 * 14.12 * 16.12 - 1680.0;
        assert!((0.95 * most..most).contains(&hollow), "{hollow} of {most}");
        // Without one of its faces, the block gets about the same shell, although no body can be made in front of the block's surface.
        let faces = (0..block.faces().len() as u32).filter(|face| *face != 0);
        let open = check(&block.select(&Vec::from_iter(faces)), 1.0, Side::Outside, 0.05);
        assert!((volume(&open) - hollow).abs() < 0.03 * hollow, "{}", volume(&open));
        // No part of the shell is inside of the block.
        assert!(!open.positions().iter().any(|at| {
            let mut sides = at.coords.iter().zip([10.0, 12.0, 14.0]);
            sides.all(|(x, own)| 0.01 < *x && *x < own - 0.01)
        }));
    }

    #[test]
    fn holes_may_touch() {
        let ball = crate::thicken::tests::cuboid([10.0; 3], 3);
        // Two faces share a vertex but no edge.
        let faces = ball.faces();
        fn common_vertices(a: &[u32], b: &[u32]) -> usize {
            a.iter().filter(|vertex| b.contains(vertex)).count()
        }
        let other =
            (1..faces.len()).find(|&face| common_vertices(faces.face(0), faces.face(face)) == 1);
        let kept = (1..faces.len()).filter(|face| Some(*face) != other);
        let pinched = ball.select(&kept.map(|face| face as u32).collect::<Vec<_>>());
        check(&pinched, 0.5, Side::Inside, 0.1);
        assert_eq!(split_loop(&[1, 2, 3, 4, 2, 5]), [vec![2, 3, 4], vec![1, 2, 5]]);
    }

    #[test]
    fn both_sides_have_the_attributes_of_the_surface() {
        let colors = Attribute::Color((0..441).map(|k| [k as u8, 0, 0]).collect());
        let parts = Attribute::Index((0..800).collect());
        let plane = net(|_, _| 0.0).with_vertex("color", colors).unwrap();
        let shell = check(&plane.with_face("part", parts).unwrap(), 2.0, Side::Inside, 0.0);
        let colors = shell.vertex().colors("color").unwrap();
        let from = |low: f64| {
            let colors = shell.positions().iter().zip(colors.iter());
            colors.filter(move |(at, _)| (at.z - low).abs() < 0.1).map(|(_, color)| color[0])
        };
        assert!(from(0.0).max() == Some(255) && from(-2.12).max() == Some(255));
        assert!(shell.face().get("part").is_some());
    }

    #[test]
    fn unsuitable_surfaces_are_errors() {
        fn error(mesh: &Mesh, thickness: f64) -> String {
            shell(mesh, thickness, Side::Inside, &Progress::silent()).unwrap_err().to_string()
        }
        let plane = net(|_, _| 0.0);
        let empty = Mesh::new(Vec::new(), Faces::triangles(Vec::new())).unwrap();
        assert!(error(&empty, 1.0).starts_with("the shell is empty: "));
        let fan = (0..5u32).map(|k| Point3::new(f64::from(k), f64::from(k * k), f64::from(k % 2)));
        let fan = Mesh::new(
            fan.collect::<Vec<_>>(),
            Faces::triangles(vec![[0, 1, 2], [0, 1, 3], [1, 0, 4]]),
        );
        assert!(error(&fan.unwrap(), 1.0).starts_with("the faces are not a surface: "));
        assert_eq!(error(&plane, 0.0), "`thickness` is 0, but must be a number above 0");
        assert_eq!(error(&plane, f64::NAN), "`thickness` is NaN, but must be a number above 0");
        let steep = plane.with_positions(
            plane.positions().iter().map(|p| Point3::new(p.x, p.x * p.y / 9.0, p.y)).collect(),
        );
        let both =
            maquette_mesh::merge(&[&plane, &steep.unwrap()], maquette_mesh::Poses::Ignore).unwrap();
        let text = error(&both, 1.0);
        assert!(text.starts_with("the faces that close the surface intersect it: "), "{text}");
        let ball = crate::thicken::tests::cuboid([10.0; 3], 2);
        let turned = orient(&ball, Outside::Flip).unwrap().mesh;
        assert!(error(&turned, 1.0).starts_with("the surface has no inside behind it: "));
        assert!(error(&plane, 1e-9).contains("blocks of a grid"), "{}", error(&plane, 1e-9));
        let text = error(&plane, 1e300);
        assert!(text.starts_with("the shell is empty: `thickness`, 1"), "{text}");
    }
}
