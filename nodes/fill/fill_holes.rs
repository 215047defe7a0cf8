//! Fills the holes of a mesh.

use std::sync::atomic::{AtomicUsize, Ordering};

use maquette_node::{
    Cancelled, Carry, Context, Error, Estimate, Fate, In, Node, Progress, Promise, Want,
};
use maquette_value::parallel::*;
use maquette_value::{Attribute, Faces, Mesh, MeshError, Trace};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::attributes::carry::Carry as Mixed;
use super::attributes::colors::colors;
use super::border::clashes::check_rims;
use super::border::holes::{Components, HoleChoice, choose, without_isolated_components};
use super::border::regions::{cut, marks, within};
use super::border::rim::{OneRings, Rim};
use super::border::rims::{NotManifold, rims};
use super::exemplar::{Copies, Given, Update, complete, complete_as_published};
use super::fill_error::FillError;
use super::intersections::damping::damp_displacements;
use super::intersections::detect::Intersections;
use super::intersections::resolve::HoleFills;
use super::method::FillMethod;
use super::plain::hole_fill::{Fallback, HoleFill};
use super::plain::options::PlainOptions;
use super::plain::plain_fill::fill_hole;
use super::plain::remesh::Remesh;
use super::triangles::density::{Stop, TRIANGLES};
use super::triangles::filling::Filling;

/// Fills the holes of a mesh: with shapes found elsewhere on it, smoothly, or flat.
///
/// The mesh keeps its vertices and faces, in place and in order; the filled ones, triangles about as large as those around the hole,
/// follow behind them. Only what a region cuts out goes, isolated components in the gap included, and then the vertices behind
/// it move up. The filled vertices are marked by the attribute `filled`. Of each vertex the attribute `exemplar` names the one in the data
/// whose surroundings it copies: itself for data, the nearest one at the rim in a plain fill.
///
/// Colors, numbers, vectors and texture coordinates of filled vertices are mixed from those at the rim, so that a picture goes on across
/// the hole; flags and whole numbers are those of the vertex named by `exemplar`. A seam of texture coordinates that runs into the hole
/// ends there. What is filled with shapes found elsewhere has their colors, numbers and vectors; and if texture coordinates are given for
/// corners, as those of an atlas are, each face shows what the picture has there, unless `texture` says otherwise.
///
/// The outer border of an open scan is no hole: of each connected part whose faces mostly look to one side, and of each that comes from a
/// capture, the border around it stays, and a warning says so. A mesh without holes stays as it is.
///
/// In other programs: cap, patch, inpaint.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct FillHoles {
    /// The mesh; its faces may be any polygons.
    pub mesh: In<Mesh>,
    /// Which holes.
    #[serde(default)]
    pub holes: HoleChoice,
    /// What they are filled with.
    #[serde(default)]
    pub method: FillMethod,
}

/// About how many triangles fill a round rim of so many edges, all as long: the area in its circle by that of a triangle.
fn triangles_within(edges: usize) -> f64 {
    const PER_SQUARE: f64 = 0.184;
    (PER_SQUARE * edges as f64 * edges as f64).min(TRIANGLES.most as f64)
}

/// A mesh with filled holes.
#[derive(Clone, Debug)]
pub struct Filled {
    /// The mesh.
    pub mesh: Mesh,
    /// How an exemplar fill went: see [`FillMethod`]. Empty for others.
    pub trace: Trace,
    /// What the user should know of the result, in sentences.
    pub warnings: Vec<String>,
}

impl Node for FillHoles {
    type Outputs = (Mesh, Trace);
    const OUTPUTS: [&'static str; 2] = ["mesh", "trace"];

    const WANTS: &'static [Want<Self>] = &[
        Want::new("mesh", "Manifold").when("unless a region is cut out", |it| !it.cuts()),
        Want::new("mesh", "Oriented").when("unless a region is cut out", |it| !it.cuts()),
    ];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::always("mesh", "Manifold"),
        Promise::always("mesh", "Oriented"),
        Promise::from("mesh", "Closed", "mesh").when("unless a region is cut out", |it| !it.cuts()),
        Promise::from("mesh", "Triangles", "mesh"),
        Promise::from("mesh", "NonEmpty", "mesh")
            .when("unless a region is cut out", |it| !it.cuts()),
    ];

    const CARRIES: &'static [Carry] = &[Carry::each(
        "mesh",
        "mesh",
        [Fate::Interpolated, Fate::Interpolated, Fate::Kept, Fate::Kept],
    )];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let mesh = cx.get(&self.mesh);
        let corners = mesh.faces().corners().len() as f64;
        let mut edges: Vec<_> = rims(mesh).iter().flatten().map(Vec::len).collect();
        match &self.holes {
            HoleChoice::Loops(chosen) => {
                edges = chosen.iter().filter_map(|&rim| edges.get(rim).copied()).collect();
            }
            HoleChoice::Edges { max } => edges.retain(|edges| edges <= max),
            // The longest is the outer border, or fills as much as any hole if there is none.
            _ if edges.len() > 1 => {
                edges.sort_unstable();
                edges.pop();
            }
            _ => {}
        }
        let filled: f64 = edges.into_iter().map(triangles_within).sum();
        let of_data = if matches!(self.method, FillMethod::Exemplar(_)) { 450.0 } else { 110.0 };
        Some(Estimate { bytes: corners * of_data + filled * 600.0, help: TRIANGLES.help })
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let filled = fill_holes(cx.get(&self.mesh), &self.holes, &self.method, cx.progress())?;
        filled.warnings.into_iter().for_each(|warning| cx.warn(warning));
        Ok((filled.mesh, filled.trace))
    }
}

impl FillHoles {
    fn cuts(&self) -> bool {
        matches!(self.holes, HoleChoice::Region(_))
    }
}

/// `mesh` with its `holes` filled as `method` says; see [`FillHoles`] for what is kept and what attributes become.
///
/// Positions are in mm. The data's vertices keep their bits and, unless a region is cut out, their indices. The result is a surface if
/// `mesh` is one. [`Filled::warnings`] tells of filled triangles that intersect others.
///
/// Triangles over the rim: Liepa, "Filling holes in meshes" (2003). Density: Botsch and Kobbelt, "A remeshing approach to multiresolution
/// modeling" (2004). Plain shapes: Kobbelt, Campagna, Vorsatz and Seidel, "Interactive multi-resolution modeling on arbitrary meshes"
/// (1998). Exemplars: Kawai, Sato and Yokoya, "Surface completion by minimizing energy based on similarity of shape" (2008).
///
/// # Errors
/// If the mesh is no surface, or would be none when it is filled; if a chosen rim or an attribute does not exist; if a hole would take too
/// many triangles; if the evaluation is told to stop.
pub fn fill_holes(
    mesh: &Mesh,
    holes: &HoleChoice,
    method: &FillMethod,
    progress: &Progress<'_>,
) -> Result<Filled, FillError> {
    progress.check()?;
    let (mesh, is_cut) = match holes {
        HoleChoice::Region(region) => {
            let (left, is_cut) = cut(mesh, &within(mesh, region)?)?;
            without_isolated_components(left, is_cut)?
        }
        _ => (mesh.clone(), Vec::new()),
    };
    let ((rims, mut filling), components) =
        rayon::join(|| (rims(&mesh), Filling::new(&mesh)), || Components::new(&mesh));
    let rims =
        rims.map_err(|NotManifold { edges, vertices }| FillError::NonManifold { edges, vertices })?;
    let chosen = choose(&mesh, &components, &rims, holes, &is_cut)
        .map_err(|number| FillError::NoRim { number, count: rims.len() })?;
    let mut warnings = Vec::new();
    warnings.extend(describe_outer(&rims, &chosen.outer, components.count()));
    if chosen.holes.is_empty() && chosen.outer.is_empty() {
        warnings.push("there is no such hole".to_owned());
    }
    let holes: Vec<Vec<u32>> = chosen.holes.iter().map(|&hole| rims[hole].clone()).collect();
    let one_rings = OneRings::new(&filling, &holes);
    let plain_options = PlainOptions::of(method);
    let is_start = matches!(method, FillMethod::Exemplar(_));
    let plain_share = if is_start { PLAIN_START } else { PLAIN };
    let mut fills = progress.part(0.0..plain_share, |progress| {
        fill_all(&filling, &one_rings, (&holes, &chosen.holes), plain_options, progress)
    })?;
    filling.add_all(&holes, &fills);
    let mut intersections = Intersections::new(&filling, progress)?;
    if !intersections.is_empty() {
        let mut hole_fills = HoleFills {
            filling: &mut filling,
            one_rings: &one_rings,
            holes: &holes,
            fills: &mut fills,
            intersections: &mut intersections,
        };
        hole_fills.resolve(plain_options, progress)?;
    }
    warnings.extend(describe_fallbacks(&chosen.holes, &fills));
    check_rims(&filling, &one_rings, &holes)
        .map_err(|NotManifold { edges, vertices }| FillError::Clash { edges, vertices })?;
    let (mut steps, mut copies) = (Vec::new(), None);
    if let FillMethod::Exemplar(options) = method {
        let allowed = match &options.exemplars[..] {
            "" => None,
            name => Some(marks(&mesh, name)?),
        };
        // Without an iteration nothing is looked for, because nothing would move.
        if options.most_iterations() > 0 {
            let mut start = filling.points[filling.data..].to_vec();
            let colors = options.counts_colors().then(|| colors(&mesh, &filling, options.texture));
            let sharp = holes.iter().zip(&fills).flat_map(|(hole, fill)| {
                let count = fill.triangulation.compact().1.len() - hole.len();
                std::iter::repeat_n(fill.is_sharp, count)
            });
            let given = Given { allowed, colors: colors.flatten(), sharp: sharp.collect() };
            let own = plain_share..PLAIN;
            let completed = match options.update {
                Update::Exact => progress
                    .part(own, |progress| complete(&mut filling, options, &given, progress))?,
                Update::Published => {
                    let mut remesh = Remesh {
                        one_rings: &one_rings,
                        holes: &holes,
                        fills: &mut fills,
                        edge: plain_options.edge,
                    };
                    let mut density =
                        |filling: &mut Filling, least: f64, progress: &Progress<'_>| {
                            remesh.refine(filling, least, progress)
                        };
                    let completed = progress.part(own, |progress| {
                        complete_as_published(&mut filling, &mut density, options, &given, progress)
                    });
                    let completed = completed.map_err(stopped)?;
                    start = remesh.membranes(&mut filling, progress)?;
                    intersections = Intersections::new(&filling, progress)?;
                    completed
                }
            };
            if completed.no_exemplar && !holes.is_empty() {
                warnings.push("no part of the data is like what surrounds the holes: they keep the shape of the start".into());
            }
            (steps, copies) = (completed.trace, Some(completed.copies));
            intersections.update(&filling, |_| true, progress)?;
            if !intersections.is_empty() {
                let before = intersections.faces(&filling).len();
                damp_displacements(&mut filling, &start, &mut intersections, progress)?;
                if intersections.faces(&filling).len() < before {
                    warnings.push("where shapes found elsewhere would have run through the mesh or each other, it is filled as at the start".into());
                }
            }
        }
    }
    let hole_fills = HoleFills {
        filling: &mut filling,
        one_rings: &one_rings,
        holes: &holes,
        fills: &mut fills,
        intersections: &mut intersections,
    };
    warnings.extend(describe_intersections(&chosen.holes, &hole_fills, &components));
    let trace = Trace::new(steps)?;
    Ok(Filled { mesh: filled_mesh(&mesh, &filling, copies.as_ref())?, trace, warnings })
}

/// About which share of the time plain fills take, and which as the start of an exemplar fill.
const PLAIN: f64 = 0.9;
const PLAIN_START: f64 = 0.2;

/// Fills each hole by itself, without exemplars. `holes` are their rims, `numbers` those of the rims.
fn fill_all(
    filling: &Filling,
    one_rings: &OneRings,
    (holes, numbers): (&[Vec<u32>], &[usize]),
    options: PlainOptions,
    progress: &Progress<'_>,
) -> Result<Vec<HoleFill>, FillError> {
    let all: usize = holes.iter().map(Vec::len).sum();
    let done = AtomicUsize::new(0);
    let fill_one = |(hole, number): (&Vec<u32>, &usize)| {
        let rim = Rim::new(filling, one_rings, hole);
        fn share(edges: usize, all: usize) -> f64 {
            edges as f64 / all.max(1) as f64
        }
        // One hole tells how far it is; of several, how many edges of their rims are done.
        let before = share(done.load(Ordering::Relaxed), all);
        let own = if holes.len() == 1 { 0.0..1.0 } else { before..before };
        let filled = progress.part(own, |progress| fill_hole(filling, &rim, options, progress));
        let fill = filled.map_err(|stop| match stop {
            Stop::Cancelled => FillError::Cancelled(Cancelled),
            Stop::TooMany(need) => {
                TRIANGLES.refused(format_args!("what fills rim {number}"), need).into()
            }
        })?;
        progress.tick(share(done.fetch_add(hole.len(), Ordering::Relaxed) + hole.len(), all))?;
        Ok(fill)
    };
    holes.par_iter().zip(numbers).map(fill_one).collect()
}

fn stopped(stop: Stop) -> FillError {
    match stop {
        Stop::Cancelled => FillError::Cancelled(Cancelled),
        Stop::TooMany(need) => TRIANGLES.refused("what fills the holes", need).into(),
    }
}

fn filled_mesh(mesh: &Mesh, filling: &Filling, copies: Option<&Copies>) -> Result<Mesh, MeshError> {
    let filled = &filling.faces[filling.kept..];
    let count = filling.points.len();
    if filled.is_empty() {
        let marked = mesh.clone().with_vertex("filled", Attribute::Flag(vec![0; count].into()))?;
        return marked.with_vertex("exemplar", Attribute::Index((0..count as u32).collect()));
    }
    let faces = if mesh.faces().sides() == Some(3) {
        Faces::triangles(filling.faces.clone())
    } else {
        let sides: Vec<usize> =
            mesh.faces().iter().map(<[u32]>::len).chain(filled.iter().map(|_| 3)).collect();
        let corners = mesh.faces().corners().iter().chain(filled.as_flattened());
        Faces::polygons(&sides, corners.copied().collect())?
    };
    let (onto, carry) =
        rayon::join(|| Mesh::new(filling.points.clone(), faces), || Mixed::new(filling, copies));
    let onto = onto?
        .with_creases(mesh.creases())?
        .with_materials(mesh.materials().clone())
        .with_frame(mesh.frame().copied());
    let flags: Vec<u8> = (0..count).map(|vertex| u8::from(filling.data <= vertex)).collect();
    let mut onto = carry.onto(mesh, onto)?;
    if let Some(Attribute::Flag(before)) = mesh.vertex().get("filled") {
        // What was filled before stays marked.
        let flags = flags.iter().enumerate();
        let flags =
            flags.map(|(vertex, &flag)| before.get(vertex).copied().unwrap_or(flag)).collect();
        onto = onto.with_vertex("filled", Attribute::Flag(flags))?;
    } else {
        onto = onto.with_vertex("filled", Attribute::Flag(flags.into()))?;
    }
    onto.with_vertex("exemplar", Attribute::Index(carry.examples().into()))
}

fn describe_outer(rims: &[Vec<u32>], outer: &[usize], components: usize) -> Option<String> {
    let longest = outer.iter().copied().max_by_key(|&rim| rims[rim].len())?;
    let edges = rims[longest].len();
    Some(match outer.len() {
        1 if components > 1 => format!(
            "the border of {edges} edges around a loose part of the mesh is no hole and stays; `holes: Loops([{longest}])` fills it"
        ),
        1 => format!(
            "the border of {edges} edges around the mesh is no hole and stays; `holes: Loops([{longest}])` fills it"
        ),
        count => format!(
            "{count} borders around parts of the mesh are no holes and stay, the longest of {edges} edges; `holes: Loops([{longest}])` fills that one"
        ),
    })
}

fn describe_fallbacks(holes: &[usize], fills: &[HoleFill]) -> Vec<String> {
    fn with(fallback: Fallback, fills: &[HoleFill], holes: &[usize]) -> Vec<String> {
        let holes = holes.iter().zip(fills).filter(|(_, fill)| fill.fallback == Some(fallback));
        holes.map(|(hole, _)| hole.to_string()).collect()
    }
    let mut warnings = Vec::new();
    let (rough, smooth) =
        (with(Fallback::RoughRim, fills, holes), with(Fallback::NoCreases, fills, holes));
    let intersecting = with(Fallback::Intersection, fills, holes);
    if !intersecting.is_empty() {
        warnings.push(format!(
            "what fills rim {} is another surface than asked for, since that would have run through the mesh or itself",
            intersecting.join(", ")
        ));
    }
    if !rough.is_empty() {
        warnings.push(format!(
            "the rim is too rough for a thin plate, a membrane fills rim {}",
            rough.join(", ")
        ));
    }
    if !smooth.is_empty() {
        warnings.push(format!(
            "no creases end at rim {} that could be extended: a thin plate fills it",
            smooth.join(", ")
        ));
    }
    warnings
}

fn describe_intersections(
    holes: &[usize],
    hole_fills: &HoleFills<'_>,
    components: &Components,
) -> Option<String> {
    let filling = &*hole_fills.filling;
    let faces = hole_fills.intersections.faces(filling);
    let first = filling.faces[*faces.first()? as usize];
    let [a, b, c] = first.map(|vertex| filling.points[vertex as usize].coords);
    let middle = (a + b + c) / 3.0;
    let mut text = format!(
        "{} filled triangles run through others, the first at ({:.3}, {:.3}, {:.3})",
        faces.len(),
        middle.x,
        middle.y,
        middle.z
    );
    let why =
        ["a loose part of the mesh is in the way of rim", "the data run through themselves at rim"];
    for (why, at) in why.into_iter().zip(hole_fills.reasons(components)) {
        if !at.is_empty() {
            let at: Vec<String> = at.into_iter().map(|hole| holes[hole].to_string()).collect();
            text += &format!("; {why} {}", at.join(", "));
        }
    }
    Some(text)
}
