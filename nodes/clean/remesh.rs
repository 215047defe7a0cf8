//! Gives a surface triangles of one size.

use maquette_node::{
    Cancelled, Carry, Context, Error, Estimate, Fate, In, Limit, Node, Progress, Promise, Want,
};
use maquette_value::Mesh;
use maquette_value::parallel::*;
use nalgebra::Point3;
use net::{Kind, NONE, Net};
use original::Original;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::remesh_error::RemeshError;

mod net;
mod original;

/// Gives a surface new triangles, all with edges of nearly one length.
///
/// The new vertices lie on the old surface. Borders, creases and edges where faces meet at a larger angle than `angle` stay, and so do the
/// corners where they end, meet or turn. The shape of what is smaller than `length` goes, holes and parts stay as many as they are.
/// Vertices have attributes mixed from those around their places, faces those of the nearest face; attributes of corners and
/// normals are dropped. A vertex that joins fans of faces becomes one for each.
///
/// In other programs: retopologize, isotropic.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Remesh {
    /// The surface.
    pub mesh: In<Mesh>,
    /// How long edges become, most of them between four fifths and four thirds of this; 0 takes the mean length of the edges that there are.
    #[schemars(range(min = 0.0), extend("unit" = "mm"))]
    #[serde(default)]
    pub length: f64,
    /// Edges whose faces meet at a larger angle are kept; 180 keeps borders and creases alone. Less finds edges in noise.
    #[schemars(range(min = 0.0, max = 180.0), extend("unit" = "deg"))]
    #[serde(default = "forty")]
    pub angle: f64,
}

fn forty() -> f64 {
    40.0
}

/// Triangles of a result: some 4 GB while they are made.
const TRIANGLES: Limit =
    Limit { most: 1 << 23, of: "triangles", help: "choose a greater `length`" };

/// Bytes for each triangle while it is made.
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

    const CARRIES: &'static [Carry] =
        &[Carry::each("mesh", "mesh", [Fate::Interpolated, Fate::Dropped, Fate::Kept, Fate::Kept])];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let mesh = cx.get(&self.mesh);
        let count = count(mesh, length(mesh, self.length)) + mesh.faces().corners().len() as f64;
        Some(Estimate { bytes: count * BYTES, help: TRIANGLES.help })
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let mesh = cx.get(&self.mesh);
        if mesh.corner().iter().any(|(name, _)| name != "normal") {
            cx.warn("the attributes of corners are dropped: the new triangles do not keep to their seams");
        }
        Ok((remesh(mesh, self.length, self.angle, cx.progress())?,))
    }
}

/// How often triangles are changed and vertices moved: after that little changes any more.
const ROUNDS: u32 = 10;

/// Edges that are longer or shorter than this share of the length are split and collapsed: then both halves, or what is left, are nearer to it.
const LONG: f64 = 4.0 / 3.0;
const SHORT: f64 = 4.0 / 5.0;

/// The surface of `mesh` with edges of some `length` mm (their mean length if 0), keeping edges where faces meet at more than `angle` degrees.
///
/// Botsch and Kobbelt, "A remeshing approach to multiresolution modeling" (2004), section 4: long edges are split, short ones collapse,
/// others are flipped where that brings valences nearer to 6 (4 at borders), and vertices move within the tangent plane to the middle
/// of the area around them and from there to the nearest place of the surface. Vertices on features move along them to the middle between
/// their neighbors; where features end, meet or turn by more than 45 degrees on a way of `length` they stay. What would turn a triangle by more than 60 degrees or make it a needle is left out. Cost grows with n log n.
///
/// # Errors
/// If a parameter is out of range, the mesh is no surface, there would be too many triangles, or the evaluation is told to stop.
pub fn remesh(
    mesh: &Mesh,
    length: f64,
    angle: f64,
    progress: &Progress<'_>,
) -> Result<Mesh, RemeshError> {
    if !(0.0 <= length && length.is_finite()) {
        return Err(RemeshError::Length(length));
    }
    if !(0.0..=180.0).contains(&angle) {
        return Err(RemeshError::Angle(angle));
    }
    let length = self::length(mesh, length);
    let count = count(mesh, length);
    TRIANGLES.check(format_args!("a surface with edges of {length} mm"), count)?;
    let (original, mut net) = Original::new(mesh, length, angle)?;
    // Of faces without area nothing even can be made.
    let rounds = if count > 0.0 { ROUNDS } else { 0 };
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
    Ok(original.into_mesh(&net)?)
}

/// The length of edges that is meant.
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

/// About how many triangles the surface is made of that have such edges; a long needle has little area, but is cut often.
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

/// How many edges are looked at before somebody may stop it.
const BATCH: usize = 4096;

/// Splits the edges that are longer than `longest`, the longest first.
fn split(net: &mut Net, longest: f64, progress: &Progress<'_>) -> Result<(), Cancelled> {
    loop {
        let mut long = edges(net, |square| longest * longest < square);
        long.reverse();
        if long.is_empty() {
            return Ok(());
        }
        for batch in long.chunks(BATCH) {
            progress.check()?;
            for &(square, h) in batch {
                // It has another length if it was cut off.
                if net.square(h) == square {
                    net.split(h);
                }
            }
        }
    }
}

/// The edges of certain squared lengths, by half-edge, the shortest first.
fn edges(net: &Net, wanted: impl Fn(f64) -> bool) -> Vec<(f64, u32)> {
    let edges = net.edges().map(|h| (net.square(h), h));
    let mut edges: Vec<_> = edges.filter(|(square, _)| wanted(*square)).collect();
    edges.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    edges
}

/// Collapses the edges that are shorter than `shortest`, the shortest first, where none becomes longer than `longest`.
fn collapse(
    net: &mut Net,
    [shortest, longest]: [f64; 2],
    progress: &Progress<'_>,
) -> Result<(), Cancelled> {
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
        // Most that are left are short because nothing can be done.
        if done * 10 <= count {
            return Ok(());
        }
    }
}

/// Flips edges where that brings the valences of the four vertices around nearer to what they should be.
fn flip(net: &mut Net, progress: &Progress<'_>) -> Result<(), Cancelled> {
    fn off(vertex: u32, net: &Net) -> i32 {
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
    let mut offs: Vec<i32> = vertices.map(|vertex| off(vertex, still)).collect();
    let edges = Vec::from_iter(net.edges());
    for batch in edges.chunks(BATCH) {
        progress.check()?;
        for &h in batch {
            let twin = net.twin(h);
            if twin == NONE {
                continue;
            }
            let [a, b] = [net.from(h), net.to(h)];
            let [c, d] = [h, twin].map(|h| net.from(net::previous(h)));
            let changes = [(a, -1), (b, -1), (c, 1), (d, 1)];
            // By how much the sum of the squares grows.
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

/// Moves vertices to the middle of what is around them, on the surface and on its features.
fn relax(net: &mut Net, original: &Original<'_>, progress: &Progress<'_>) -> Result<(), Cancelled> {
    fn of_kind(kind: Kind, net: &Net) -> Vec<u32> {
        let vertices = 0..net.places.len() as u32;
        let is_there =
            |&vertex: &u32| net.kind(vertex) == kind && net.leaving[vertex as usize] != NONE;
        vertices.filter(is_there).collect::<Vec<_>>()
    }
    let (smooth, curved) = (of_kind(Kind::Smooth, net), of_kind(Kind::Curve, net));
    let still = &*net;
    let (targets, normals): (Vec<Point3<f64>>, Vec<_>) = smooth
        .par_iter()
        .with_min_len(256)
        .map(|&vertex| {
            let at = still.place(vertex);
            let (normal, middle) = still.around(vertex);
            let normal = normal.try_normalize(0.0).unwrap_or_default();
            let way = middle - at;
            (at + (way - normal * normal.dot(&way)), normal)
        })
        .unzip();
    let curve_targets: Vec<_> = curved
        .iter()
        .map(|&vertex| match still.along_curve(vertex) {
            Some([a, b]) => nalgebra::center(&still.place(a), &still.place(b)),
            None => still.place(vertex),
        })
        .collect();
    progress.check()?;
    let found = original.on_surface(&targets);
    progress.check()?;
    for (&vertex, place) in curved.iter().zip(original.on_curves(&curve_targets)) {
        if let Some(place) = place {
            net.shift(vertex, place);
        }
    }
    for ((&vertex, place), normal) in smooth.iter().zip(found).zip(normals) {
        // The other side of what is thin is not meant.
        match place {
            Some((place, of_place)) if of_place.dot(&normal) >= 0.0 => net.shift(vertex, place),
            _ => {}
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
