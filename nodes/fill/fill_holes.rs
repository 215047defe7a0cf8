//! Fills the holes of a mesh.

use std::sync::atomic::{AtomicUsize, Ordering};

use maquette_base::topology::flat_faces::remove_flat_faces;
use maquette_node::{
    Carry, Context, Error, Estimate, In, Node, Progress, Promise, Transfer, Want, bail,
};
use maquette_value::parallel::*;
use maquette_value::{Attribute, Faces, Mesh, MeshError, Trace};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::attributes::carry::{AttributeCarrier, copies_attributes};
use super::attributes::colors::colors;
use super::bending::bending_energies;
use super::border::holes::{
    ChosenRims, Components, HoleChoice, choose, without_isolated_components,
};
use super::border::manifold_check::check_rims;
use super::border::regions::{cut, marked_vertices, vertices_in_region};
use super::border::rim::{OneRings, Rim};
use super::border::rims::{NotManifold, rims};
use super::border::zip::{ZipRim, ZippedMesh, zip};
use super::exemplar::{CompletionInput, Copies, Update, complete, complete_as_published};
use super::intersections::damping::damp_displacements;
use super::intersections::detect::Intersections;
use super::intersections::resolve::HoleFills;
use super::method::FillMethod;
use super::plain::hole_fill::HoleFill;
use super::plain::options::PlainOptions;
use super::plain::plain_fill::fill_hole;
use super::plain::remesh::Remesh;
use super::triangles::density::TRIANGLES;
use super::triangles::filling::Filling;
use super::warnings::{describe_fallbacks, describe_place, face_center};

/// Fills the holes of a mesh: with shapes found elsewhere on it, smoothly, or flat.
///
/// The mesh keeps its vertices and faces with their indices; the filled ones, triangles about as large as those around the hole, are
/// appended. Only `holes: Region` removes data: the vertices in the region and components isolated in the gap are cut out, and later
/// vertices are renumbered. The vertex attribute `filled` marks the filled vertices. The vertex attribute `exemplar` has the index of the
/// data vertex whose surroundings a filled vertex copies; for data vertices it is their own index, in a plain fill the index of the nearest
/// vertex at the rim.
///
/// Colors, numbers, vectors and texture coordinates of filled vertices are interpolated from those at the rim, so that a picture continues
/// across the hole; flags and integers are copied from the vertex that `exemplar` names. A seam of texture coordinates that runs into the
/// hole ends there. An exemplar fill copies the colors, numbers and vectors of its exemplars; if texture coordinates are stored per corner,
/// as in an atlas, each filled face also shows the exemplar's part of the picture, unless `texture` says otherwise.
///
/// Where the borders of holes touch, within a twentieth of the length of the edges there, they are zipped instead: a crack has no area. An
/// outer border is zipped only where it coincides with itself or another, or if most of it touches others. Then vertices are joined, so
/// that later ones have new indices, and a warning says how many.
///
/// The outer border of an open scan is not a hole: the border of each connected component whose faces mostly look to one side, or that
/// comes from a capture, stays open, and a warning names it. A mesh without holes is returned unchanged except for the two attributes.
///
/// The trace has the iterations of an exemplar fill, and the bending energy of each fill in the order of the rims, a measure of fairness:
/// the sum of A (2 H)^2 over the vertices of the fill and its rim, with the area A and the mean curvature H of a vertex. It has no unit, is
/// 0 for a plane, and does not depend on the size of the mesh.
///
/// In other programs: cap, patch, inpaint.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct FillHoles {
    /// Mesh whose holes are filled. Its faces may be any polygons.
    pub mesh: In<Mesh>,
    /// Selects the holes to fill.
    #[serde(default)]
    pub holes: HoleChoice,
    /// Surface that fills the holes.
    #[serde(default)]
    pub method: FillMethod,
}

/// Estimates the number of triangles that fill a circular hole with `edges` equal edges: the area of the circle divided by that of an
/// equilateral triangle.
fn estimate_triangles(edges: usize) -> f64 {
    const PER_SQUARE: f64 = 0.184;
    (PER_SQUARE * edges as f64 * edges as f64).min(TRIANGLES.max as f64)
}

/// A mesh with filled holes.
#[derive(Clone, Debug)]
pub struct FilledMesh {
    /// The filled mesh.
    pub mesh: Mesh,
    /// The iterations of a fill with exemplars, see [`FillMethod`]; none for other methods. Also the bending energy of each fill.
    pub trace: Trace,
    /// Warnings for the user, as sentences.
    pub warnings: Vec<String>,
}

impl Node for FillHoles {
    type Outputs = (Mesh, Trace);
    const OUTPUTS: [&'static str; 2] = ["mesh", "trace"];

    const WANTS: &'static [Want<Self>] = &[
        Want::new("mesh", "Manifold").only_if("unless a region is cut out", |it| !it.cuts()),
        Want::new("mesh", "Oriented").only_if("unless a region is cut out", |it| !it.cuts()),
    ];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::always("mesh", "Manifold"),
        Promise::always("mesh", "Oriented"),
        Promise::from("mesh", "Closed", "mesh")
            .only_if("unless a region is cut out", |it| !it.cuts()),
        Promise::from("mesh", "Triangles", "mesh"),
        Promise::from("mesh", "NonEmpty", "mesh")
            .only_if("unless a region is cut out", |it| !it.cuts()),
    ];

    const CARRIES: &'static [Carry] = &[Carry::per_domain(
        "mesh",
        "mesh",
        [Transfer::Interpolated, Transfer::Interpolated, Transfer::Kept, Transfer::Kept],
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
            // Exclude the longest rim: without a better criterion it is taken for the outer border, which is not filled.
            _ if edges.len() > 1 => {
                edges.sort_unstable();
                edges.pop();
            }
            _ => {}
        }
        let filled: f64 = edges.into_iter().map(estimate_triangles).sum();
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

/// Returns `mesh` with its `holes` filled by `method`. See [`FillHoles`] for which vertices and faces are kept and how attributes are
/// computed.
///
/// Positions are in mm. The vertices of `mesh` keep their exact positions and, unless a region is cut out, their indices. The result is
/// manifold if `mesh` is. [`FilledMesh::warnings`] lists triangles of the fill that intersect others.
///
/// Triangles between rim vertices: Liepa, "Filling holes in meshes" (2003). Vertex density: Botsch and Kobbelt, "A remeshing approach to
/// multiresolution modeling" (2004). Smooth fills: Kobbelt, Campagna, Vorsatz and Seidel, "Interactive multi-resolution modeling on
/// arbitrary meshes" (1998). Exemplars: Kawai, Sato and Yokoya, "Surface completion by minimizing energy based on similarity of shape"
/// (2008).
///
/// # Errors
/// Returns an error if the mesh is not manifold or would not be when filled, if a chosen rim or an attribute does not exist, if a hole
/// would take too many triangles, or if the evaluation is cancelled.
pub fn fill_holes(
    mesh: &Mesh,
    holes: &HoleChoice,
    method: &FillMethod,
    progress: &Progress<'_>,
) -> Result<FilledMesh, Error> {
    progress.check()?;
    let (mesh, is_cut) = match holes {
        HoleChoice::Region(region) => {
            let (left, is_cut) = cut(mesh, &vertices_in_region(mesh, region)?)?;
            without_isolated_components(left, is_cut)?
        }
        _ => (mesh.clone(), Vec::new()),
    };
    let border = MeshBorder::new(&mesh, holes, &is_cut)?;
    let zipped = border.zip(&mesh, holes, is_cut)?;
    let joined = zipped.as_ref().map_or(0, |(zipped, _)| zipped.joined);
    let (mesh, border) = match zipped {
        Some((zipped, border)) => (zipped.mesh, border),
        None => (mesh, border),
    };
    let MeshBorder { rims, chosen, components, mut filling } = border;
    let mut warnings = Vec::new();
    warnings.extend(describe_outer(&rims, &chosen.outer, components.count()));
    if joined > 0 {
        warnings.push(format!(
            "borders touch: {joined} vertices are joined with others instead of filling between them, and later vertices have new indices"
        ));
    } else if chosen.holes.is_empty() && chosen.outer.is_empty() {
        warnings.push(match rims.len() {
            0 => "the mesh has no hole to fill: it is closed".to_owned(),
            count => {
                format!("no hole is filled: `holes` chooses none of the {count} rims of the mesh")
            }
        });
    }
    let holes: Vec<Vec<u32>> = chosen.holes.iter().map(|&hole| rims[hole].clone()).collect();
    let one_rings = OneRings::new(&filling, &holes);
    let plain_options = PlainOptions::from_method(method);
    let is_start = matches!(method, FillMethod::Exemplar(_));
    let plain_share = if is_start { START_PROGRESS } else { PLAIN_PROGRESS };
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
    warnings.extend(describe_fallbacks(&chosen.holes, &holes, &fills, &filling));
    if let Err(elements) = check_rims(&filling, &one_rings, &holes) {
        bail!(
            "the filled mesh would not be manifold at {elements}: leave out the rim there with `holes: Loops`, or cut out the faces around it with `holes: Region`"
        );
    }
    let (mut steps, mut copies) = (Vec::new(), None);
    if let FillMethod::Exemplar(options) = method {
        let allowed = match &options.exemplars[..] {
            "" => None,
            name => Some(marked_vertices(&mesh, name)?),
        };
        // With 0 iterations no vertex would move, so do not search exemplars.
        if options.max_iterations() > 0 {
            let mut start = filling.points[filling.n_data_vertices..].to_vec();
            let colors = options.counts_colors().then(|| colors(&mesh, &filling, options.texture));
            let sharp =
                holes.iter().zip(&fills).flat_map(|(hole, fill)| fill.sharp_vertices(hole.len()));
            let given = CompletionInput {
                allowed,
                colors: colors.flatten(),
                sharp: sharp.collect(),
                copies_attributes: copies_attributes(&mesh),
            };
            let own = plain_share..PLAIN_PROGRESS;
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
                    let completed = progress.part(own, |progress| {
                        complete_as_published(
                            &mut filling,
                            &mut |filling, min_length, progress| {
                                remesh.refine(filling, min_length, progress)
                            },
                            options,
                            &given,
                            progress,
                        )
                    });
                    let completed =
                        completed.map_err(|stop| stop.error("the fill of the holes"))?;
                    remesh.fair(&mut filling, &completed.to_fair, progress)?;
                    start = remesh.membranes(&mut filling, progress)?;
                    intersections = Intersections::new(&filling, progress)?;
                    completed
                }
            };
            if completed.no_exemplar && !holes.is_empty() {
                warnings.push("no part of the data is similar to the surroundings of the holes: the initial shape is kept; use smaller `radii`, or `method: ThinPlate`".into());
            }
            (steps, copies) = (completed.trace, Some(completed.copies));
            intersections.update(&filling, |_| true, progress)?;
            if !intersections.is_empty() {
                let before = intersections.faces(&filling);
                damp_displacements(&mut filling, &start, &mut intersections, progress)?;
                if intersections.faces(&filling).len() < before.len() {
                    let place = describe_place(face_center(&filling, before[0]));
                    warnings.push(format!("where copied shapes would intersect the mesh or each other, first at {place}, the initial shape is used"));
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
    let trace = Trace::new(steps)?.with_bending(bending_energies(&filling, &fills))?;
    let filled = filled_mesh(&mesh, &filling, copies.as_ref())?;
    // Where vertices of a rim are on a line, a face of the fill may have no area.
    let data_faces = mesh.faces().len() as u32;
    let filled = remove_flat_faces(&filled, |face| data_faces <= face)?.unwrap_or(filled);
    Ok(FilledMesh { mesh: filled, trace, warnings })
}

/// The border of a mesh and the holes to fill.
struct MeshBorder {
    rims: Vec<Vec<u32>>,
    chosen: ChosenRims,
    components: Components,
    filling: Filling,
}

impl MeshBorder {
    /// # Errors
    /// Returns an error if the mesh is not manifold, or a chosen rim does not exist.
    fn new(mesh: &Mesh, holes: &HoleChoice, is_cut: &[bool]) -> Result<Self, Error> {
        let ((rims, filling), components) =
            join(|| (rims(mesh), Filling::new(mesh)), || Components::new(mesh));
        let rims = rims.map_err(|elements| not_manifold(mesh, &elements))?;
        let chosen = choose(mesh, &components, &rims, holes, is_cut).map_err(|number| {
            let count = rims.len();
            Error::new(format!(
                "the mesh has no rim {number}: it has {count} rims, numbered from 0"
            ))
        })?;
        Ok(Self { rims, chosen, components, filling })
    }

    /// Zips the chosen rims where they touch; if all holes are chosen, also the outer borders. Returns the zipped mesh and its border, on
    /// which the chosen rims are the rest of those before. Returns `None` if no rims touch.
    fn zip(
        &self,
        mesh: &Mesh,
        holes: &HoleChoice,
        is_cut: Vec<bool>,
    ) -> Result<Option<(ZippedMesh, Self)>, Error> {
        let outer = match holes {
            HoleChoice::All => &self.chosen.outer[..],
            _ => &[],
        };
        let rim = |is_outer| move |&rim: &usize| ZipRim { vertices: &self.rims[rim], is_outer };
        let chosen = self.chosen.holes.iter().map(rim(false)).chain(outer.iter().map(rim(true)));
        let chosen: Vec<ZipRim<'_>> = chosen.collect();
        let Some(zipped) = zip(mesh, &chosen)? else { return Ok(None) };
        // A vertex that joins several parts of the surface may prevent that the zipped mesh is manifold.
        if rims(&zipped.mesh).is_err() {
            return Ok(None);
        }
        let mut is_cut_now = vec![false; zipped.mesh.positions().len()];
        for (&vertex, is_cut) in zipped.vertices.iter().zip(is_cut) {
            is_cut_now[vertex as usize] |= is_cut;
        }
        let all = Self::new(&zipped.mesh, &HoleChoice::All, &is_cut_now)?;
        if matches!(holes, HoleChoice::All) {
            return Ok(Some((zipped, all)));
        }
        // A new vertex on an edge of a chosen rim is on no other one.
        let mut is_chosen = vec![true; zipped.mesh.positions().len()];
        zipped.vertices.iter().for_each(|&vertex| is_chosen[vertex as usize] = false);
        for &vertex in chosen.iter().flat_map(|rim| rim.vertices) {
            is_chosen[zipped.vertices[vertex as usize] as usize] = true;
        }
        let chosen = ChosenRims {
            holes: (0..all.rims.len())
                .filter(|rim| all.rims[*rim].iter().all(|&vertex| is_chosen[vertex as usize]))
                .collect(),
            outer: Vec::new(),
        };
        Ok(Some((zipped, Self { chosen, ..all })))
    }
}

fn not_manifold(mesh: &Mesh, elements: &NotManifold) -> Error {
    let edges = elements.edges.iter().map(|edge| edge[0]);
    let first = edges.chain(elements.vertices.iter().copied()).next();
    let place = first.map(|vertex| describe_place(mesh.positions()[vertex as usize]));
    Error::new(format!(
        "the mesh is not manifold at {elements}: an edge may have at most two faces, of equal orientation, and the faces \
         around a vertex must be connected; cut out the faces there, the first at {}, with `holes: Region`",
        place.unwrap_or_default()
    ))
}

/// The fractions of the total progress at which the fills without exemplars are complete. `PLAIN_PROGRESS` applies if these fills are the
/// result, `START_PROGRESS` if they are the initial fill of a method with exemplars.
const PLAIN_PROGRESS: f64 = 0.9;
const START_PROGRESS: f64 = 0.2;

/// Fills each hole separately, without exemplars. `holes` are the rims to fill, `numbers` their rim numbers.
fn fill_all(
    filling: &Filling,
    one_rings: &OneRings,
    (holes, numbers): (&[Vec<u32>], &[usize]),
    options: PlainOptions,
    progress: &Progress<'_>,
) -> Result<Vec<HoleFill>, Error> {
    let all: usize = holes.iter().map(Vec::len).sum();
    let done = AtomicUsize::new(0);
    holes
        .par_iter()
        .zip(numbers)
        .map(|(hole, number): (&Vec<u32>, &usize)| {
            let rim = Rim::new(filling, one_rings, hole);
            // A single hole reports its own progress. Several holes report the fraction of their rim edges that are done.
            let before = done.load(Ordering::Relaxed) as f64 / all.max(1) as f64;
            let own = if holes.len() == 1 { 0.0..1.0 } else { before..before };
            let filled = progress.part(own, |progress| fill_hole(filling, &rim, options, progress));
            let fill =
                filled.map_err(|stop| stop.error(format_args!("the fill of rim {number}")))?;
            let after = done.fetch_add(hole.len(), Ordering::Relaxed) + hole.len();
            progress.tick(after as f64 / all.max(1) as f64)?;
            Ok(fill)
        })
        .collect()
}

fn filled_mesh(mesh: &Mesh, filling: &Filling, copies: Option<&Copies>) -> Result<Mesh, MeshError> {
    let filled = &filling.faces[filling.n_data_faces..];
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
    let (onto, carry) = join(
        || Mesh::new(filling.points.clone(), faces),
        || AttributeCarrier::new(filling, copies),
    );
    let onto = onto?
        .with_creases(mesh.creases())?
        .with_materials(mesh.materials().clone())
        .with_frame(mesh.frame().copied());
    let flags: Vec<u8> =
        (0..count).map(|vertex| u8::from(filling.n_data_vertices <= vertex)).collect();
    let mut onto = carry.transfer(mesh, onto)?;
    if let Some(Attribute::Flag(before)) = mesh.vertex().get("filled") {
        // Input vertices keep their flag `filled`, which an earlier node may have set.
        let flags = flags.iter().enumerate();
        let flags =
            flags.map(|(vertex, &flag)| before.get(vertex).copied().unwrap_or(flag)).collect();
        onto = onto.with_vertex("filled", Attribute::Flag(flags))?;
    } else {
        onto = onto.with_vertex("filled", Attribute::Flag(flags.into()))?;
    }
    onto.with_vertex("exemplar", Attribute::Index(carry.example_vertices().into()))
}

fn describe_outer(rims: &[Vec<u32>], outer: &[usize], components: usize) -> Option<String> {
    let longest = outer.iter().copied().max_by_key(|&rim| rims[rim].len())?;
    let edges = rims[longest].len();
    Some(match outer.len() {
        1 if components > 1 => format!(
            "the border of {edges} edges around a disconnected part of the mesh is not a hole and stays open; use `holes: Loops([{longest}])` to fill it"
        ),
        1 => format!(
            "the border of {edges} edges around the mesh is not a hole and stays open; use `holes: Loops([{longest}])` to fill it"
        ),
        count => format!(
            "{count} borders around parts of the mesh are not holes and stay open; use `holes: Loops([{longest}])` to fill the longest, of {edges} edges"
        ),
    })
}

fn describe_intersections(
    holes: &[usize],
    hole_fills: &HoleFills<'_>,
    components: &Components,
) -> Option<String> {
    let filling = &*hole_fills.filling;
    let faces = hole_fills.intersections.faces(filling);
    let place = describe_place(face_center(filling, *faces.first()?));
    let mut text =
        format!("{} filled triangles intersect others, the first at {place}", faces.len());
    let why =
        ["a disconnected part of the mesh blocks rim", "the data intersect themselves at rim"];
    for (why, at) in why.into_iter().zip(hole_fills.reasons(components)) {
        if !at.is_empty() {
            let at: Vec<String> = at.into_iter().map(|hole| holes[hole].to_string()).collect();
            text += &format!("; {why} {}", at.join(", "));
        }
    }
    Some(text)
}
