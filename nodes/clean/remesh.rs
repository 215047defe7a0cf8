//! Replaces the triangles of a surface by triangles of uniform size.

use maquette_node::{
    CancelledError, Carry, Context, Error, Estimate, In, Limit, Node, Progress, Promise, Transfer,
    Want, bail,
};
use maquette_value::Mesh;
use maquette_value::parallel::*;
use nalgebra::Point3;
use net::{Kind, NONE, Net};
use original::Original;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

mod curves;
mod feature;
mod net;
mod original;
mod sheet;
mod walls;

/// Replaces the triangles of a surface by new ones with edges of nearly one length.
///
/// The new vertices are on the old surface. Borders, creases, and edges where faces meet at an angle larger than `angle` are kept, and so
/// are the corners where such lines end, meet or bend. Detail smaller than `length` is lost; the numbers of holes and of parts stay.
/// Vertices have attributes interpolated at their positions, faces have those of the nearest face; attributes of corners, and normals, are
/// dropped. A vertex that joins several fans of faces is split into one vertex for each fan.
///
/// In other programs: retopologize, isotropic.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Remesh {
    /// The surface.
    pub mesh: In<Mesh>,
    /// Target length of edges in mm; most edges are between four fifths and four thirds of it. 0 takes the mean length of the existing
    /// edges. If many edges would run through thin walls, they are shorter, and a warning says how long.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub length: f64,
    /// Edges whose faces meet at a larger angle, in degrees, are kept; 180 keeps only borders and creases. Small angles also find edges in
    /// noise.
    #[schemars(range(min = 0.0, max = 180.0), extend("unit" = "deg"))]
    #[serde(default = "default_angle")]
    pub angle: f64,
}

fn default_angle() -> f64 {
    40.0
}

/// Maximum number of triangles of the result; remeshing to this many triangles needs about 4 GB of memory.
const TRIANGLES: Limit =
    Limit { max: 1 << 23, items: "triangles", help: "choose a greater `length`" };

/// Memory in bytes for each triangle during the computation.
const BYTES: f64 = 450.0;

impl Node for Remesh {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const WANTS: &'static [Want<Self>] =
        &[Want::new("mesh", "Manifold"), Want::new("mesh", "Oriented")];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::always("mesh", "Triangles"),
        Promise::always("mesh", "Manifold"),
        Promise::always("mesh", "Oriented"),
        Promise::always("mesh", "Unpinched"),
        Promise::from("mesh", "Closed", "mesh"),
        Promise::from("mesh", "NonEmpty", "mesh"),
    ];

    const CARRIES: &'static [Carry] = &[Carry::per_domain(
        "mesh",
        "mesh",
        [Transfer::Interpolated, Transfer::Dropped, Transfer::Kept, Transfer::Kept],
    )];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let mesh = cx.get(&self.mesh);
        let count = count(mesh, length(mesh, self.length)) + mesh.faces().corners().len() as f64;
        Some(Estimate { bytes: count * BYTES, help: TRIANGLES.help })
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        if mesh.corner().iter().any(|(name, _)| name != "normal") {
            cx.warn("the attributes of corners are dropped: the new triangles do not follow their seams");
        }
        let (even, length) = remesh_apart(mesh, self.length, self.angle, cx.progress())?;
        let asked = self::length(mesh, self.length);
        if length < asked {
            cx.warn(format!(
                "walls are too thin for edges of {asked} mm, which would run through them: the edges have about {length} mm"
            ));
        }
        Ok((even,))
    }
}

/// Number of rounds of remeshing. Each round splits, collapses and flips edges and moves vertices; further rounds hardly change the result.
const ROUNDS: u32 = 10;

/// Multiples of the target length: edges longer than `LONG` are split, and edges shorter than `SHORT` collapse. With these limits, the
/// halves of a split edge, and the edge into which two edges merge, are closer to the target length.
const LONG: f64 = 4.0 / 3.0;
const SHORT: f64 = 4.0 / 5.0;

/// Remeshes `mesh` with edges of `length` mm (the mean length of its edges if 0), keeping edges where faces meet at more than `angle`
/// degrees.
///
/// Botsch and Kobbelt, "A remeshing approach to multiresolution modeling" (2004), section 4. Long edges are split, short ones collapse, and
/// others are flipped if that brings the valences of vertices closer to 6 (4 at borders). Then each vertex moves in its tangent plane to
/// the centroid of the area around it, and from there to the nearest point of the surface. Vertices on feature edges move along them to the
/// middle between their neighbors; they stay where feature edges end, meet, or turn by more than 45 degrees within `length`. A change that
/// would rotate a triangle by more than 60 degrees, or make it a needle, is skipped. The cost is O(n log n).
///
/// # Errors
/// Returns an error if a parameter is out of range, the mesh is not a surface, there would be too many triangles, or the evaluation is
/// cancelled.
pub fn remesh(
    mesh: &Mesh,
    length: f64,
    angle: f64,
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    Ok(remesh_apart(mesh, length, angle, progress)?.0)
}

/// Maximum number of times that the target length is halved because triangles run through walls.
const MAX_HALVINGS: i32 = 4;

/// Maximum fraction of the triangles that may run through walls. Up to this, they are refined; else the whole surface gets shorter edges.
const MAX_CROSSING: f64 = 0.02;

/// Like [`remesh`], but also returns the target length, which is halved while many triangles run through walls.
fn remesh_apart(
    mesh: &Mesh,
    length: f64,
    angle: f64,
    progress: &Progress<'_>,
) -> Result<(Mesh, f64), Error> {
    if !(0.0 <= length && length.is_finite()) {
        bail!("`length` is {length} mm, but must be a number from 0 on");
    }
    if !(0.0..=180.0).contains(&angle) {
        bail!("`angle` is {angle}, but must be from 0 to 180 degrees");
    }
    let mut length = self::length(mesh, length);
    TRIANGLES.check(format_args!("a surface with edges of {length} mm"), count(mesh, length))?;
    let (mut start, mut halvings) = (0.0, 0);
    loop {
        let end = start + 0.9 * (1.0 - start);
        let (original, mut net) =
            progress.part(start..end, |progress| even_net(mesh, length, angle, progress))?;
        let is_last =
            halvings == MAX_HALVINGS || (TRIANGLES.max as f64) < count(mesh, length / 2.0);
        let max_crossing = if is_last { 1.0 } else { MAX_CROSSING };
        if walls::refine(&mut net, &original, max_crossing, progress)? {
            return Ok((original.into_mesh(&net)?, length));
        }
        (length, start, halvings) = (length / 2.0, end, halvings + 1);
    }
}

/// Returns the surface with edges of `length` mm. Its triangles may run through thin walls.
fn even_net<'a>(
    mesh: &'a Mesh,
    length: f64,
    angle: f64,
    progress: &Progress<'_>,
) -> Result<(Original<'a>, Net), Error> {
    let (original, mut net) = Original::new(mesh, length, angle)?;
    // A mesh whose faces have no area cannot be remeshed, so its faces are kept.
    let rounds = if area(mesh) > 0.0 { ROUNDS } else { 0 };
    for round in 0..rounds {
        fn share(part: f64, round: u32, rounds: u32) -> f64 {
            (f64::from(round) + part) / f64::from(rounds)
        }
        progress.tick(share(0.0, round, rounds))?;
        split(&mut net, length * LONG, progress)?;
        progress.tick(share(0.15, round, rounds))?;
        collapse(&mut net, [length * SHORT, length * LONG], progress)?;
        progress.tick(share(0.35, round, rounds))?;
        flip(&mut net, progress)?;
        progress.tick(share(0.5, round, rounds))?;
        relax(&mut net, &original, progress)?;
    }
    Ok((original, net))
}

/// Returns the target length of edges: `given`, or the mean length of the edges of `mesh` if `given` is 0.
fn length(mesh: &Mesh, given: f64) -> f64 {
    if given != 0.0 {
        return given;
    }
    let edges = mesh.edges().vertices;
    fn place(vertex: u32, mesh: &Mesh) -> Point3<f64> {
        mesh.positions()[vertex as usize]
    }
    let lengths = edges.iter().map(|&[a, b]| (place(b, mesh) - place(a, mesh)).norm());
    lengths.sum::<f64>() / edges.len().max(1) as f64
}

/// Estimates the number of triangles with edges of the given length. The lengths of the existing edges count as well as the area, because a
/// long needle has hardly any area but is split often.
fn count(mesh: &Mesh, length: f64) -> f64 {
    fn place(vertex: u32, mesh: &Mesh) -> Point3<f64> {
        mesh.positions()[vertex as usize]
    }
    if area(mesh) > 0.0 {
        mesh.faces()
            .iter()
            .map(|face| {
                let next = face[1..].iter().chain(&face[..1]);
                let longest =
                    face.iter().zip(next).map(|(&a, &b)| (place(b, mesh) - place(a, mesh)).norm());
                let longest = longest.fold(0.0, f64::max);
                let by_area =
                    mesh.area_vector(face).norm() / (0.75_f64.sqrt() / 2.0 * length * length);
                if longest > length { by_area.max(longest / length) } else { by_area }
            })
            .sum()
    } else {
        0.0
    }
}

fn area(mesh: &Mesh) -> f64 {
    mesh.faces().iter().map(|face| mesh.area_vector(face).norm()).sum()
}

/// Number of edges that are processed between two checks for cancellation.
const BATCH: usize = 4096;

/// Splits edges longer than `longest`, the longest first.
fn split(net: &mut Net, longest: f64, progress: &Progress<'_>) -> Result<(), CancelledError> {
    loop {
        let mut long = edges(net, |square| longest * longest < square);
        long.reverse();
        if long.is_empty() {
            return Ok(());
        }
        for batch in long.chunks(BATCH) {
            progress.check()?;
            for &(square, h) in batch {
                // Skip an edge whose length has changed since the list was made, because the edge was split.
                if net.square(h) == square {
                    net.split(h);
                }
            }
        }
    }
}

/// Returns the edges whose squared length `wanted` accepts, the shortest first. Each edge is given by its squared length and one of its
/// half-edges.
fn edges(net: &Net, wanted: impl Fn(f64) -> bool) -> Vec<(f64, u32)> {
    let edges = net.edges().map(|h| (net.square(h), h));
    let mut edges: Vec<_> = edges.filter(|(square, _)| wanted(*square)).collect();
    edges.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    edges
}

/// Collapses edges shorter than `shortest`, in ascending order of length, if no edge becomes longer than `longest`.
fn collapse(
    net: &mut Net,
    [shortest, longest]: [f64; 2],
    progress: &Progress<'_>,
) -> Result<(), CancelledError> {
    let (shortest, longest) = (shortest * shortest, longest * longest);
    loop {
        let (mut done, mut count) = (0, 0);
        let short = edges(net, |square| square < shortest);
        for batch in short.chunks(BATCH) {
            progress.check()?;
            for &(_, h) in batch {
                if net.from(h) == NONE || shortest <= net.square(h) {
                    continue;
                }
                count += 1;
                let twin = net.twin(h);
                done += usize::from(
                    net.collapse(h, longest) || (twin != NONE && net.collapse(twin, longest)),
                );
            }
        }
        // If at most a tenth of the short edges could be collapsed, most of the remaining ones cannot be collapsed, either. Then the loop
        // ends.
        if done * 10 <= count {
            return Ok(());
        }
    }
}

/// Flips each edge if the flip brings the valences of the four vertices of its two triangles closer to their targets.
fn flip(net: &mut Net, progress: &Progress<'_>) -> Result<(), CancelledError> {
    fn valence_error(vertex: u32, net: &Net) -> i32 {
        match net.leaving[vertex as usize] {
            NONE => 0,
            _ => {
                let (mut count, mut is_border) = (0, false);
                net.visit_neighbors(vertex, |_, h| {
                    count += 1;
                    is_border |= net.twin(h) == NONE;
                });
                count - if is_border { 4 } else { 6 }
            }
        }
    }
    let vertices = (0..net.places.len() as u32).into_par_iter().with_min_len(1024);
    let still = &*net;
    let mut offs: Vec<i32> = vertices.map(|vertex| valence_error(vertex, still)).collect();
    let edges = Vec::from_iter(net.edges());
    for batch in edges.chunks(BATCH) {
        progress.check()?;
        for &h in batch {
            let twin = net.twin(h);
            if twin == NONE {
                continue;
            }
            let [a, b] = [net.from(h), net.end(h)];
            let [c, d] = [h, twin].map(|h| net.from(net::previous(h)));
            let changes = [(a, -1), (b, -1), (c, 1), (d, 1)];
            // The change that a flip makes to the sum of the squared deviations from the target valences.
            let growth: i32 = changes
                .iter()
                .map(|&(vertex, change)| 2 * change * offs[vertex as usize] + 1)
                .sum();
            if growth < 0 && net.is_flippable(h) {
                net.flip(h);
                changes.iter().for_each(|&(vertex, change)| offs[vertex as usize] += change);
            }
        }
    }
    Ok(())
}

/// Moves each vertex to the centroid of its neighborhood, but keeps the vertex on the surface and on its feature edges.
fn relax(
    net: &mut Net,
    original: &Original<'_>,
    progress: &Progress<'_>,
) -> Result<(), CancelledError> {
    fn of_kind(kind: Kind, net: &Net) -> Vec<u32> {
        (0..net.places.len() as u32)
            .filter(|&vertex| net.kind(vertex) == kind && net.leaving[vertex as usize] != NONE)
            .collect()
    }
    let (smooth, curved) = (of_kind(Kind::Smooth, net), of_kind(Kind::Curve, net));
    let still = &*net;
    let (targets, normals): (Vec<Point3<f64>>, Vec<_>) = smooth
        .par_iter()
        .with_min_len(256)
        .map(|&vertex| {
            let at = still.place(vertex);
            let (normal, middle) = still.normal_and_center(vertex);
            let normal = normal.try_normalize(0.0).unwrap_or_default();
            let way = middle - at;
            (at + (way - normal * normal.dot(&way)), normal)
        })
        .unzip();
    let starts: Vec<_> = smooth.iter().map(|&vertex| still.near[vertex as usize]).collect();
    progress.check()?;
    let found = original.sheet.land(&targets, &starts);
    progress.check()?;
    let on_curves: Vec<_> = curved.iter().map(|&vertex| still.on_curve(vertex)).collect();
    for (&vertex, on_curve) in curved.iter().zip(on_curves) {
        if let Some((curve, position, [to_first, to_second])) = on_curve {
            // The middle between the neighbors, or at least the curve.
            for shift in [(to_first + to_second) / 2.0, 0.0] {
                let (place, triangle) = original.curves.point(curve, position + shift);
                if net.shift(vertex, place) {
                    net.slide(vertex, shift);
                    net.near[vertex as usize] = triangle;
                    break;
                }
            }
        }
    }
    for ((&vertex, landing), normal) in smooth.iter().zip(found).zip(normals) {
        // Do not move a vertex to a nearest point on the opposite side of a thin part, where the normal is reversed.
        if let Some(landing) = landing.filter(|landing| landing.normal.dot(&normal) >= 0.0)
            && net.shift(vertex, landing.place)
        {
            net.near[vertex as usize] = landing.triangle;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
