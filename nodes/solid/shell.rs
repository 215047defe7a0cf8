//! Gives a surface a thickness.
//!
//! Moving each vertex along its normal folds the surface wherever it bends more than the wall is thick. Limiting these moves made thin
//! walls, and mending thin walls made blobs. So the surface is closed to a body, with a lid on each border (behind walls where the lid
//! would be in the surface), and `Boolean` takes the part of the body within the distance, which a grid knows. The surface itself keeps its
//! bytes.

use std::collections::BTreeMap;

use maquette_fill::{FillMethod, HoleChoice, fill_holes};
use maquette_mesh::{OrientError, Outside, orient};
use maquette_node::{Cancelled, Carry, Context, Error, Fate, In, Node, Progress, Promise, Want};
use maquette_value::{Mesh, MeshError, TriangleTree};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::base::{Ground, seen, with_base};
use crate::combine::{BooleanError, boolean};
use crate::grown::{Grown, border};
use crate::lend::lend;
use crate::operation::Operation;
use crate::polygons::{flat, loops, triangulate};
use crate::round::{RoundError, round};
use crate::thicken::{still_thin, thin};
use crate::volume::volume;

/// Gives a surface a thickness: an open scan becomes a shell that can be printed, as a mask is.
///
/// The surface itself stays as it is, unless it lies in the middle. The other side is as far from it everywhere as the shell is thick, and there is none where there is no
/// room for it: a finger becomes solid. At its borders there are walls. Where the surface itself is the skin of something thinner, or a border meets the surface at a sharp
/// angle, the shell is thinner, and that is told. What lies on the surface lies on the other side as at the nearest place.
///
/// In other programs: solidify, thicken, extrude.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Shell {
    /// The surface.
    pub mesh: In<Mesh>,
    /// How thick it is at least.
    #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
    #[serde(default = "two")]
    pub thickness: f64,
    /// On which side of the surface.
    #[serde(default)]
    pub side: Side,
}

fn two() -> f64 {
    2.0
}

/// Where a shell lies beside its surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Side {
    /// Behind it: the surface is what is seen from where its faces look.
    #[default]
    Inside,
    /// In front of it.
    Outside,
    /// By half on either side.
    Middle,
}

/// Why a surface has no shell.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ShellError {
    /// A thickness that is none.
    #[error("`thickness` is {0}, but must be a number above 0")]
    Thickness(f64),
    /// A surface that nothing closes.
    #[error("what closes the surface runs through it: {count} pairs of faces cross, the first one at ({:.3}, {:.3}, {:.3}); `side: Middle` needs nothing closed, and if the surface itself runs through itself there, `Reconstruct` makes one skin of it", at[0], at[1], at[2])]
    Crossing {
        /// How many pairs there are.
        count: usize,
        /// Where the first one is.
        at: [f64; 3],
    },
    /// What closes the surface lies edge on edge with it.
    #[error(
        "what closes the surface touches it or itself: at {count} edges not two faces meet; `side: Middle` needs nothing closed"
    )]
    Touching {
        /// How many edges.
        count: usize,
    },
    /// Faces that make no surface.
    #[error(
        "the faces make no surface: at {count} edges more than two meet, or two that look to different sides; `Orient` turns faces"
    )]
    NoSurface {
        /// How many edges.
        count: usize,
    },
    /// A closed surface whose faces look inward, or one that is as good as closed.
    #[error(
        "behind the surface there is no inside: `Orient` turns its faces outward, and `side: Middle` needs no inside"
    )]
    InsideOut,
    /// A shell without a face.
    #[error(
        "nothing is as near to the surface as `thickness`, {thickness} mm: beside its size of {size} mm that is too much, or too little, to be told apart"
    )]
    Nothing {
        /// How thick it should be.
        thickness: f64,
        /// How large the surface is: the diagonal of its box.
        size: f64,
    },
    /// A side that is none.
    #[error(transparent)]
    Orient(#[from] OrientError),
    /// Too many places around the surface.
    #[error(transparent)]
    Round(#[from] RoundError),
    /// What is around the surface meets it in a way that cannot be decided.
    #[error(transparent)]
    Boolean(#[from] BooleanError),
    /// Places out of all bounds.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
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

    const CARRIES: &'static [Carry] = &[Carry::each(
        "mesh",
        "mesh",
        [Fate::Interpolated, Fate::Interpolated, Fate::Kept, Fate::Kept],
    )];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let (shell, thin) = shell(cx.get(&self.mesh), self.thickness, self.side, cx.progress())?;
        if thin > 0 {
            cx.warn(still_thin(thin, self.thickness));
        }
        Ok((shell,))
    }
}

/// The other side is a little farther away than asked for, because what bends is measured between flat faces.
const MORE: f64 = 1.06;

/// How far walls run behind a border, as a multiple of the thickness: farther than the shell reaches.
const BEHIND: f64 = 1.3;

/// A lid that looks as the faces around it do, or away from all of them, up to this angle (as its cosine), closes a border at its rim only: walls run
/// behind it first. The cosine of 45 degrees.
const FLAT: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// A shell of a surface, see [`Shell`], and how many faces have still less behind them than the thickness.
///
/// The surface is closed to a body, of which that is taken which is no farther from the surface than the thickness: so the other side cannot run
/// through itself, and where there is no room for it there is none. Cost grows with the area of the surface, in squares of the thickness.
///
/// # Errors
/// If the thickness is none, nothing closes the surface, there are too many places around it, or the evaluation is told to stop.
pub fn shell(
    mesh: &Mesh,
    thickness: f64,
    side: Side,
    progress: &Progress<'_>,
) -> Result<(Mesh, usize), ShellError> {
    if !(thickness > 0.0 && thickness.is_finite()) {
        return Err(ShellError::Thickness(thickness));
    }
    let edges = mesh.edges();
    let count = edges.misoriented + edges.faces.iter().filter(|faces| 2 < **faces).count();
    if count > 0 {
        return Err(ShellError::NoSurface { count });
    }
    fn something(made: Mesh, thickness: f64, mesh: &Mesh) -> Result<Mesh, ShellError> {
        match made.faces().is_empty() {
            false => Ok(made),
            true => {
                let size = mesh.bounds().map_or(0.0, |(low, high)| (high - low).norm());
                Err(ShellError::Nothing { thickness, size })
            }
        }
    }
    let around = |mesh: &Mesh, distance: f64, progress: &Progress<'_>| {
        let around =
            something(round(mesh, (MORE * distance, 2.0), None, progress)?, thickness, mesh)?;
        let around = lend(mesh, &TriangleTree::new(mesh), around)?;
        Ok::<_, ShellError>(around.with_frame(mesh.frame().copied()))
    };
    if side == Side::Middle {
        return Ok((around(mesh, thickness / 2.0, progress)?, 0));
    }
    let mesh = &something(mesh.clone(), thickness, mesh)?;
    let behind = BEHIND * thickness;
    let (body, is_outside) = progress.part(0.0..0.2, |progress| match side {
        Side::Outside => body_in_front(mesh, behind, progress),
        _ => Ok((body(mesh, behind, progress)?, false)),
    })?;
    let around = progress.part(0.2..0.6, |progress| around(mesh, thickness, progress))?;
    let shell = progress.part(0.6..0.9, |progress| match is_outside {
        true => boolean(&around, &[&body], Operation::Difference, progress),
        false => boolean(&body, &[&around], Operation::Intersection, progress),
    })?;
    let shell = something(shell, thickness, mesh)?;
    let thin = thin(&shell, &TriangleTree::new(&shell), thickness).len();
    Ok((shell, thin))
}

/// The body in front of the surface; or that behind it, and that the shell is outside of it, for a surface around which nothing is closed.
fn body_in_front(
    mesh: &Mesh,
    behind: f64,
    progress: &Progress<'_>,
) -> Result<(Mesh, bool), ShellError> {
    if !border(mesh).is_empty() {
        match body(&orient(mesh, Outside::Flip)?.mesh, behind, progress) {
            Err(ShellError::InsideOut | ShellError::Touching { .. }) => {}
            found => return Ok((found?, false)),
        }
    }
    // Walls behind its borders would become plugs of what lies in front of them.
    Ok((body(mesh, 0.0, progress)?, true))
}

/// A body whose skin the surface is a part of: with flat lids on its borders, or, where these run through it, with borders that are filled as holes are, or with walls to
/// a flat base. Walls are no lower than `behind`, and there are none if that is 0.
fn body(mesh: &Mesh, behind: f64, progress: &Progress<'_>) -> Result<Mesh, ShellError> {
    let wrong = |body: &Mesh| -> Result<Option<ShellError>, ShellError> {
        let found = body.crossings(|| progress.check())?;
        let count = body.edges().faces.iter().filter(|faces| **faces != 2).count();
        Ok(match found.first() {
            Some(&[face, _]) => {
                let at = body.first_middle(body.faces().face(face as usize)).coords.into();
                Some(ShellError::Crossing { count: found.len(), at })
            }
            None if count > 0 => Some(ShellError::Touching { count }),
            None if volume(body, body.positions()[0]) <= 0.0 => Some(ShellError::InsideOut),
            None => None,
        })
    };
    let (body, _) = walled(mesh, behind, true)?;
    let Some(why) = wrong(&body)? else { return Ok(body) };
    let (open, rims) = walled(mesh, behind, false)?;
    let all = HoleChoice::Loops((0..rims).collect());
    let filled = fill_holes(&open, &all, &FillMethod::Membrane, progress);
    let based = Ground::of(mesh, behind, None).and_then(|ground| {
        let front = if mesh.frame().is_some() { seen(mesh, &ground) } else { mesh.clone() };
        with_base(&front, &ground)
    });
    for body in filled.ok().map(|it| it.mesh).into_iter().chain(based.ok()) {
        if wrong(&body)?.is_none() {
            return Ok(body);
        }
    }
    Err(why)
}

/// The surface with a flat lid on each border, if lids are wanted, and the number of borders. Walls run behind them first where a lid would lie in the
/// surface, or on its back.
fn walled(mesh: &Mesh, behind: f64, lids: bool) -> Result<(Mesh, usize), MeshError> {
    let faces = mesh.faces();
    let vertex = |corner: u32| faces.corners()[corner as usize];
    let sides = border(mesh).into_iter().map(|own| (own.1.map(vertex), own));
    // Lids run along sides the other way round.
    let sides: BTreeMap<[u32; 2], _> = sides.map(|([a, b], own)| ([b, a], own)).collect();
    let mut grown = Grown::new(mesh);
    let rims = loops(&sides.keys().copied().collect::<Vec<_>>());
    let rims: Vec<_> = rims.iter().flat_map(|rim| apart(rim)).collect();
    let count = rims.len();
    for rim in rims {
        let next = rim[1..].iter().chain(&rim[..1]);
        let own: Vec<_> = rim.iter().zip(next).map(|(&a, &b)| sides[&[a, b]]).collect();
        fn place(vertex: u32, mesh: &Mesh) -> nalgebra::Point3<f64> {
            mesh.positions()[vertex as usize]
        }
        let from = |corner: u32| place(vertex(corner), mesh) - place(rim[0], mesh);
        // Where the lid looks, and the faces at its rim.
        let lid: Vector3<f64> = own.iter().map(|(_, [a, b])| from(*b).cross(&from(*a))).sum();
        let out = own.iter().map(|(face, _)| {
            let out = mesh.area_vector(faces.face(*face as usize));
            out.try_normalize(0.0).unwrap_or_default()
        });
        let out = out.sum::<Vector3<f64>>() / own.len() as f64;
        let lid = lid.try_normalize(0.0).or(out.try_normalize(0.0)).unwrap_or_default();
        let has_walls = 0.0 < behind && FLAT < lid.dot(&out).abs();
        let way = if has_walls { -out.normalize() * behind } else { Vector3::zeros() };
        // The foot of each vertex, its place, and what it is like.
        let mut feet = BTreeMap::new();
        for &(face, [_, corner]) in &own {
            let at = vertex(corner);
            feet.entry(at).or_insert_with(|| {
                let foot = place(at, mesh) + way;
                let number = if has_walls { grown.add_vertex(foot, at) } else { at };
                (number, foot, corner, face)
            });
        }
        for &(face, [a, b]) in own.iter().filter(|_| has_walls) {
            let [low_a, low_b] = [a, b].map(|corner| feet[&vertex(corner)].0);
            let wall = [[vertex(b), b], [vertex(a), a], [low_a, a], [low_b, b]];
            grown.add_face([0, 1, 2].map(|k: usize| wall[k]), face);
            grown.add_face([0, 2, 3].map(|k: usize| wall[k]), face);
        }
        if !lids {
            continue;
        }
        for triangle in triangulate(&[rim], |at| flat(feet[&at].1, lid)) {
            let own = triangle.map(|at| feet[&at]);
            grown.add_face(own.map(|(foot, _, corner, _)| [foot, corner]), own[0].3);
        }
    }
    Ok((grown.mesh()?, count))
}

/// The loops of which a loop consists that meets itself in vertices: where holes touch.
fn apart(rim: &[u32]) -> Vec<Vec<u32>> {
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

    /// A net of 21 x 21 places over 20 x 20 mm at these heights.
    fn net(height: impl Fn(f64, f64) -> f64) -> Mesh {
        let places = (0..441).map(|k| [f64::from(k % 21) - 10.0, f64::from(k / 21) - 10.0]);
        let positions = places.map(|[x, y]| Point3::new(x, y, height(x, y))).collect::<Vec<_>>();
        let cells = (0..420).filter(|k| k % 21 < 20);
        let faces = cells.flat_map(|k| [[k, k + 1, k + 22], [k, k + 22, k + 21]]).collect();
        Mesh::new(positions, Faces::triangles(faces)).unwrap()
    }

    fn made(mesh: &Mesh, thickness: f64, side: Side, most_thin: f64) -> Mesh {
        let (shell, thin) = shell(mesh, thickness, side, &Progress::none()).unwrap();
        let edges = shell.edges();
        assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2));
        assert_eq!(shell.crossings(|| Progress::none().check()).unwrap(), Vec::<[u32; 2]>::new());
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
            let plate = made(&plane, 2.0, side, 0.0);
            let bounds = plate.bounds().unwrap();
            assert!((bounds.0.z - low).abs() < 1e-6 && (bounds.1.z - low - 2.12).abs() < 1e-6);
            // The walls are upright.
            assert!((volume(&plate) - 400.0 * 2.12).abs() < 0.5, "{}", volume(&plate));
        }
        let plate = made(&plane, 2.0, Side::Middle, 0.0);
        let bounds = plate.bounds().unwrap();
        assert!((bounds.0.z + 1.06).abs() < 1e-6 && (bounds.1.z - 1.06).abs() < 1e-6);
    }

    #[test]
    fn the_surface_stays_where_the_other_side_has_no_room() {
        // A ridge that is narrower than two walls, and noise.
        fn noise(x: f64, y: f64) -> f64 {
            0.1 * libm::sin(37.0 * x + 91.0 * y * y)
        }
        let ridge = net(|x, y| 4.0 * libm::exp(-x * x / 3.0) + noise(x, y));
        for side in [Side::Inside, Side::Outside] {
            let shell = made(&ridge, 1.5, side, 0.01);
            let places = shell.positions();
            assert!(ridge.positions().iter().all(|at| places.contains(at)), "{side:?}");
        }
        made(&ridge, 1.5, Side::Middle, 0.01);
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
        let shell = made(&dome, 1.0, Side::Inside, 0.03);
        let (vertices, faces, edges) =
            (shell.positions().len(), shell.faces().len(), shell.edges().faces.len());
        // A plate with a hole, as a torus.
        assert_eq!(vertices + faces, edges);
        // It ends where the surface ends.
        fn lowest(mesh: &Mesh) -> f64 {
            mesh.bounds().unwrap().0.z
        }
        assert_eq!(lowest(&shell), lowest(&dome));
    }

    #[test]
    fn a_closed_mesh_becomes_hollow() {
        let block = crate::thicken::tests::cuboid([10.0, 12.0, 14.0], 2);
        let hollow = made(&block, 1.0, Side::Inside, 0.0);
        let inner = 1680.0 - volume(&hollow);
        assert!((inner - 7.88 * 9.88 * 11.88).abs() < 0.03 * inner, "{inner}");
    }

    #[test]
    fn a_closed_mesh_gets_a_skin_around_it() {
        let block = crate::thicken::tests::cuboid([10.0, 12.0, 14.0], 2);
        let outside = made(&block, 1.0, Side::Outside, 0.0);
        let (low, high) = outside.bounds().unwrap();
        let size = high - low;
        for (size, own) in size.iter().zip([10.0, 12.0, 14.0]) {
            assert!((size - own - 2.12).abs() < 0.02, "{size} around {own}");
        }
        // It has the block itself as its cavity, and rounded edges: less than the box around it.
        let hollow = volume(&outside);
        let most = 12.12 * 14.12 * 16.12 - 1680.0;
        assert!((0.95 * most..most).contains(&hollow), "{hollow} of {most}");
        // As a block with a hole in it, of which flat lids make no body that lies outside.
        let faces = (0..block.faces().len() as u32).filter(|face| *face != 0);
        let open = made(&block.select(&Vec::from_iter(faces)), 1.0, Side::Outside, 0.05);
        assert!((volume(&open) - hollow).abs() < 0.03 * hollow, "{}", volume(&open));
        // Nothing of it reaches into the block.
        let is_inside = |at: &Point3<f64>| {
            let mut sides = at.coords.iter().zip([10.0, 12.0, 14.0]);
            sides.all(|(x, own)| 0.01 < *x && *x < own - 0.01)
        };
        assert!(!open.positions().iter().any(is_inside));
    }

    #[test]
    fn holes_may_touch() {
        let ball = crate::thicken::tests::cuboid([10.0; 3], 3);
        // Two faces that share a vertex and no edge.
        let faces = ball.faces();
        fn shared(a: &[u32], b: &[u32]) -> usize {
            a.iter().filter(|vertex| b.contains(vertex)).count()
        }
        let other = (1..faces.len()).find(|&face| shared(faces.face(0), faces.face(face)) == 1);
        let kept = (1..faces.len()).filter(|face| Some(*face) != other);
        let pinched = ball.select(&kept.map(|face| face as u32).collect::<Vec<_>>());
        made(&pinched, 0.5, Side::Inside, 0.1);
        assert_eq!(apart(&[1, 2, 3, 4, 2, 5]), [vec![2, 3, 4], vec![1, 2, 5]]);
    }

    #[test]
    fn both_sides_have_what_lies_on_the_surface() {
        let colors = Attribute::Color((0..441).map(|k| [k as u8, 0, 0]).collect());
        let parts = Attribute::Index((0..800).collect());
        let plane = net(|_, _| 0.0).with_vertex("color", colors).unwrap();
        let shell = made(&plane.with_face("part", parts).unwrap(), 2.0, Side::Inside, 0.0);
        let colors = shell.vertex().colors("color").unwrap();
        let from = |low: f64| {
            let colors = shell.positions().iter().zip(colors.iter());
            colors.filter(move |(at, _)| (at.z - low).abs() < 0.1).map(|(_, color)| color[0])
        };
        assert!(from(0.0).max() == Some(255) && from(-2.12).max() == Some(255));
        assert!(shell.face().get("part").is_some());
    }

    #[test]
    fn what_has_no_shell_is_told_why() {
        fn told(mesh: &Mesh, thickness: f64) -> String {
            shell(mesh, thickness, Side::Inside, &Progress::none()).unwrap_err().to_string()
        }
        let plane = net(|_, _| 0.0);
        let empty = Mesh::new(Vec::new(), Faces::triangles(Vec::new())).unwrap();
        assert!(told(&empty, 1.0).starts_with("nothing is as near to the surface"));
        let fan = (0..5u32).map(|k| Point3::new(f64::from(k), f64::from(k * k), f64::from(k % 2)));
        let fan = Mesh::new(
            fan.collect::<Vec<_>>(),
            Faces::triangles(vec![[0, 1, 2], [0, 1, 3], [1, 0, 4]]),
        );
        assert!(told(&fan.unwrap(), 1.0).starts_with("the faces make no surface: at "));
        assert_eq!(told(&plane, 0.0), "`thickness` is 0, but must be a number above 0");
        assert_eq!(told(&plane, f64::NAN), "`thickness` is NaN, but must be a number above 0");
        let steep = plane.with_positions(
            plane.positions().iter().map(|p| Point3::new(p.x, p.x * p.y / 9.0, p.y)).collect(),
        );
        let both =
            maquette_mesh::merge(&[&plane, &steep.unwrap()], maquette_mesh::Poses::Ignore).unwrap();
        let text = told(&both, 1.0);
        assert!(text.starts_with("what closes the surface runs through it: "), "{text}");
        let ball = crate::thicken::tests::cuboid([10.0; 3], 2);
        let turned = orient(&ball, Outside::Flip).unwrap().mesh;
        assert!(told(&turned, 1.0).starts_with("behind the surface there is no inside: "));
        assert!(told(&plane, 1e-9).contains("blocks of a grid"), "{}", told(&plane, 1e-9));
        let text = told(&plane, 1e300);
        assert!(text.starts_with("nothing is as near to the surface as `thickness`, 1"), "{text}");
    }
}
