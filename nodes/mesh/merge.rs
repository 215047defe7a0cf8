//! Merges several meshes into one.

use std::collections::BTreeSet;

use maquette_node::{
    Carry, Context, Error, Forecast, In, Limit, Node, Previous, Promise, Sizes, Transfer, ValueSize,
};
use maquette_value::Value;
use maquette_value::parallel::*;
use maquette_value::{Attribute, Attributes, CaptureFrame, Faces, Mesh, MeshError};
use nalgebra::{Matrix4, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::common_frame::common_frame;
use super::followed::{Part, move_vertices};
use super::motion::Motion;
use super::moved_mesh::moved_mesh;
use super::poses::{Poses, no_pose_error};

mod several;

/// Merges several meshes into one: their vertices and faces are concatenated, and nothing is joined.
///
/// Meshes of captures are moved to world coordinates by the poses of their cameras, if these are known: the result then has y up.
/// Attributes that all meshes have are kept; a flag, such as `filled`, that some lack is not set there, and other attributes that some
/// lack, or have with another type, are dropped. A texture is kept if all meshes have the same one; otherwise it becomes vertex colors, and
/// texture coordinates are dropped; these colors are kept if all meshes have a texture or colors. If a mesh has materials of a file, all
/// meshes keep their materials and textures. An empty list, as a `ForEach` over data without elements gives, makes an empty mesh, with a
/// warning.
///
/// In other programs: join, append.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Merge {
    /// The meshes, in the order of their vertices in the result.
    pub meshes: Vec<In<Mesh>>,
    /// Motion of the meshes from camera to world coordinates.
    #[serde(default)]
    pub poses: Poses,
}

impl Node for Merge {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "meshes");

    const CARRIES: &'static [Carry] = &[Carry::uniform("meshes", "mesh", Transfer::Kept)];

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        let meshes: Option<Vec<_>> = self.meshes.iter().map(|mesh| sizes.get(mesh)).collect();
        let merged = meshes?.into_iter().reduce(ValueSize::plus)?;
        Some(Forecast::by_law(merged).with_memory(3.0 * merged.bytes, BYTES.help))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let meshes: Vec<&Mesh> = self.meshes.iter().map(|mesh| cx.get(mesh)).collect();
        self.warn(&meshes, cx);
        Ok((merge(&meshes, self.poses)?,))
    }

    /// If only vertices of some meshes have moved since the last evaluation, moves these vertices in the last result. Otherwise returns
    /// `None`.
    fn update(
        &self,
        cx: &Context<'_>,
        previous: &Previous<'_>,
    ) -> Result<Option<Self::Outputs>, Error> {
        let meshes: Vec<_> = self.meshes.iter().map(|mesh| cx.get(mesh)).collect();
        let before: Vec<_> = self.meshes.iter().map(|mesh| previous.get(mesh)).collect();
        let Some(made) = previous.output(0) else { return Ok(None) };
        let followed = follow(&meshes, &before, made, self.poses);
        if followed.is_some() {
            self.warn(&meshes, cx);
        }
        Ok(followed.map(|mesh| (mesh,)))
    }
}

impl Merge {
    /// Warns if there are no meshes, or if poses, capture frames or attributes of the meshes do not match.
    fn warn(&self, meshes: &[&Mesh], cx: &Context<'_>) {
        if meshes.is_empty() {
            cx.warn("the mesh is empty: there are no meshes to merge");
        }
        let known = meshes.iter().filter(|mesh| pose(mesh).is_some()).count();
        let stay = self.poses == Poses::Ignore || known < meshes.len();
        if self.poses == Poses::Auto && 0 < known && known < meshes.len() {
            cx.warn(format!(
                "only {known} of {} meshes have a pose, so that none is moved",
                meshes.len()
            ));
        }
        let in_capture = meshes.iter().filter(|mesh| mesh.frame().is_some()).count();
        if stay && 0 < in_capture && in_capture < meshes.len() {
            cx.warn("some meshes have y down, as captures do, and others y up");
        }
        if Looks::choose(meshes) == Looks::Painted {
            cx.warn(match meshes.iter().all(|mesh| is_colored(mesh)) {
                true => "the meshes have different textures, so that textures become vertex colors, with the resolution of the vertices",
                false => "some meshes have a picture and others neither picture nor colors, so that no mesh keeps its own",
            });
        }
    }
}

/// Returns true if the mesh has vertex colors or a texture, or no vertices.
fn is_colored(mesh: &Mesh) -> bool {
    let is_empty = mesh.positions().is_empty();
    is_empty || mesh.texture().is_some() || mesh.vertex().colors("color").is_some()
}

/// Maximum size of a merged mesh in bytes; the computation may need three times as much memory.
const BYTES: Limit =
    Limit { max: 4_000_000_000, items: "bytes", help: "merge fewer or coarser meshes" };

fn pose<'a>(mesh: &&'a Mesh) -> Option<&'a Matrix4<f64>> {
    mesh.frame()?.world_from_camera.as_ref()
}

/// Merges the vertices and faces of `meshes`, in order; see [`Merge`] for attributes and textures.
///
/// Positions are in mm: in world coordinates (y up) if poses are applied, otherwise unchanged. The result has no capture frame if the poses
/// were applied or a mesh has no frame. Without poses it has the common frame of the meshes, if all frames are equal. If the meshes come
/// from different captures, it has the frame of the first mesh without camera and pose, which only means that y points down. Without meshes
/// the result is empty.
///
/// # Errors
/// Returns an error if a pose is missing with [`Poses::Apply`], or the result is too large for a mesh.
pub fn merge(meshes: &[&Mesh], poses: Poses) -> Result<Mesh, Error> {
    let Some(&first) = meshes.first() else {
        return Ok(Mesh::new(Vec::new(), Faces::triangles(Vec::new()))?);
    };
    let nowhere = meshes.iter().position(|mesh| pose(mesh).is_none());
    if let (Some(place), Poses::Apply) = (nowhere, poses) {
        return Err(no_pose_error(place + 1));
    }
    fn bare_size(mesh: &Mesh) -> usize {
        mesh.clone().with_materials([]).size()
    }
    BYTES.check("the merged mesh", meshes.iter().map(|mesh| bare_size(mesh) as f64).sum())?;
    let (motions, looks) = (motions(meshes, poses), Looks::choose(meshes));
    let parts = meshes
        .iter()
        .zip(&motions)
        .map(|(&mesh, motion): (&&Mesh, &Option<Motion>)| {
            let part = match looks {
                Looks::Same => mesh.clone(),
                Looks::Several => several::prepare(mesh)?,
                Looks::Painted => with_vertex_colors(mesh)?,
            };
            match motion {
                Some(motion) => moved_mesh(&part, motion),
                None => Ok(part),
            }
        })
        .collect::<Result<Vec<Mesh>, _>>()?;
    let merged = Mesh::new(positions(&parts)?, faces(&parts)?)?
        .with_creases(creases(&parts))?
        .with_frame(frame(meshes, &motions));
    let merged = with_attributes(merged, &parts)?;
    Ok(match looks {
        Looks::Same => merged.with_materials(first.materials().clone()),
        Looks::Several => several::with_materials(merged, &parts)?,
        Looks::Painted => merged,
    })
}

/// Updates `made`, the last result of [`merge`], which was made of the meshes `before`. Returns `None` if anything else has changed than
/// positions and normals of vertices, a common texture, and frames.
fn follow(meshes: &[&Mesh], before: &[&Mesh], made: &Mesh, poses: Poses) -> Option<Mesh> {
    let (first, motions) = (meshes.first()?, motions(meshes, poses));
    let [now, earlier] = [meshes, before]
        .map(|meshes| meshes.iter().map(|mesh| pose(mesh).map(|pose| pose.map(f64::to_bits))));
    let same_poses = now.eq(earlier);
    if !same_poses || [meshes, before].map(Looks::choose) != [Looks::Same; 2] {
        return None;
    }
    let parts = before.iter().zip(meshes).zip(&motions);
    let parts = parts.map(|((&before, &now), &motion)| Part { before, now, motion });
    let followed = move_vertices(made, &Vec::from_iter(parts), 1.0)?;
    Some(followed.with_materials(first.materials().clone()).with_frame(frame(meshes, &motions)))
}

/// Returns the motion of each mesh into world coordinates. All motions are `None` unless poses are applied and each mesh has a pose.
fn motions(meshes: &[&Mesh], poses: Poses) -> Vec<Option<Motion>> {
    let all: Vec<_> = meshes.iter().map(|mesh| pose(mesh).map(motion)).collect();
    let applied = poses != Poses::Ignore && all.iter().all(Option::is_some);
    if applied { all } else { vec![None; meshes.len()] }
}

/// Returns the capture frame of the merged mesh; `None` if a mesh has no frame, or all meshes are moved to world coordinates.
fn frame(meshes: &[&Mesh], motions: &[Option<Motion>]) -> Option<CaptureFrame> {
    let frames: Vec<_> = meshes.iter().map(|mesh| mesh.frame().copied()).collect();
    common_frame(&frames).filter(|_| motions.contains(&None))
}

/// The way in which the materials of the merged meshes are combined.
#[derive(Clone, Copy, PartialEq)]
enum Looks {
    /// All meshes have the same materials, or no mesh has materials.
    Same,
    /// Each mesh keeps its own materials.
    Several,
    /// The texture of each mesh becomes vertex colors.
    Painted,
}

impl Looks {
    fn choose(meshes: &[&Mesh]) -> Self {
        if meshes.windows(2).all(|pair| pair[0].materials() == pair[1].materials()) {
            Self::Same
        } else if meshes.iter().all(|mesh| match &mesh.materials()[..] {
            [] => true,
            [only] => only.is_plain(),
            _ => false,
        }) {
            Self::Painted
        } else {
            Self::Several
        }
    }
}

fn motion(pose: &Matrix4<f64>) -> Motion {
    Motion {
        linear: pose.fixed_view::<3, 3>(0, 0).into_owned(),
        shift: Vector3::new(pose[(0, 3)], pose[(1, 3)], pose[(2, 3)]),
    }
}

/// Returns the mesh with the colors of its texture as vertex colors, and without texture coordinates.
fn with_vertex_colors(mesh: &Mesh) -> Result<Mesh, MeshError> {
    let colors = mesh.texture_colors();
    let plain = mesh.clone().with_texture(None).without_attribute("uv");
    match colors {
        Some(colors) => plain.with_vertex("color", Attribute::Color(colors)),
        None => Ok(plain),
    }
}

fn positions(parts: &[Mesh]) -> Result<Vec<nalgebra::Point3<f64>>, MeshError> {
    let count = parts.iter().map(|part| part.positions().len()).sum();
    // Refuse too many vertices here, because the functions below index vertices with 32 bits.
    if u32::try_from(count).is_err() {
        return Err(MeshError::TooLarge { what: "vertices", count });
    }
    let mut positions = Vec::with_capacity(count);
    parts.iter().for_each(|part| positions.extend_from_slice(part.positions()));
    Ok(positions)
}

/// Returns, for each part, the index that its first vertex has in the merged mesh.
fn offsets(parts: &[Mesh]) -> impl Iterator<Item = u32> {
    parts.iter().scan(0, |end, part| {
        let begin = *end;
        *end += part.positions().len() as u32;
        Some(begin)
    })
}

fn faces(parts: &[Mesh]) -> Result<Faces, MeshError> {
    let corners = parts.iter().map(|part| part.faces().corners().len()).sum();
    let mut all = Vec::with_capacity(corners);
    for (part, offset) in parts.iter().zip(offsets(parts)) {
        part.faces().corners().par_iter().map(|&vertex| vertex + offset).collect_into(&mut all);
    }
    // Meshes without faces are skipped: they have no number of sides that could differ.
    let mut sides = parts.iter().filter(|part| !part.faces().is_empty()).map(|p| p.faces().sides());
    let first = sides.next().unwrap_or(Some(3));
    match first.filter(|_| sides.all(|sides| sides == first)) {
        Some(sides) => Faces::uniform(sides, all),
        None => {
            let sides = parts.iter().flat_map(|part| part.faces().iter().map(<[u32]>::len));
            Faces::polygons(&sides.collect::<Vec<_>>(), all)
        }
    }
}

fn creases(parts: &[Mesh]) -> Vec<([u32; 2], f64)> {
    parts
        .iter()
        .zip(offsets(parts))
        .flat_map(|(part, offset): (&Mesh, u32)| {
            part.creases()
                .map(|(ends, sharpness): ([u32; 2], f64)| (ends.map(|end| end + offset), sharpness))
                .collect::<Vec<_>>()
        })
        .collect()
}

/// Adds the attributes of all parts to the mesh that was made of the parts.
fn with_attributes(mut merged: Mesh, parts: &[Mesh]) -> Result<Mesh, MeshError> {
    /// Returns the concatenated attributes of vertices, corners or faces. `part` returns the attributes of this kind of element for one
    /// mesh, and the number of its elements.
    fn concatenate_each(
        parts: &[Mesh],
        part: fn(&Mesh) -> (&Attributes, usize),
    ) -> Vec<(&str, Attribute)> {
        concatenate(&parts.iter().map(part).collect::<Vec<_>>())
    }
    for (name, attribute) in concatenate_each(parts, |part| (part.vertex(), part.positions().len()))
    {
        merged = merged.with_vertex(name, attribute)?;
    }
    for (name, attribute) in
        concatenate_each(parts, |part| (part.corner(), part.faces().corners().len()))
    {
        merged = merged.with_corner(name, attribute)?;
    }
    for (name, attribute) in concatenate_each(parts, |part| (part.face(), part.faces().len())) {
        merged = merged.with_face(name, attribute)?;
    }
    Ok(merged)
}

/// Returns the concatenated attributes of the parts, each of which is given with the number of its elements.
fn concatenate<'a>(parts: &[(&'a Attributes, usize)]) -> Vec<(&'a str, Attribute)> {
    let names: BTreeSet<&str> =
        parts.iter().flat_map(|(attributes, _)| attributes.iter().map(|(name, _)| name)).collect();
    names
        .into_iter()
        .filter_map(|name| {
            let columns = parts.iter().filter(|(_, count)| *count > 0);
            let columns = columns.map(|&(attributes, count)| (attributes.get(name), count));
            join(&columns.collect::<Vec<_>>()).map(|column| (name, column))
        })
        .collect()
}

/// Concatenates columns of one type. Returns `None` if the types differ, or if a mesh lacks a column that does not contain flags.
fn join(columns: &[(Option<&Attribute>, usize)]) -> Option<Attribute> {
    macro_rules! join {
        ($kind:ident, $absent:expr) => {{
            let mut all = Vec::new();
            for &(column, count) in columns {
                match (column, $absent) {
                    (Some(Attribute::$kind(column)), _) => all.extend_from_slice(column),
                    (None, Some(absent)) => all.resize(all.len() + count, absent),
                    _ => return None,
                }
            }
            Some(Attribute::$kind(all.into()))
        }};
    }
    match columns.iter().find_map(|(column, _)| *column)? {
        Attribute::Number(_) => join!(Number, None::<f64>),
        Attribute::Index(_) => join!(Index, None::<u32>),
        Attribute::Flag(_) => join!(Flag, Some(0)),
        Attribute::Pair(_) => join!(Pair, None::<[f64; 2]>),
        Attribute::Vector(_) => join!(Vector, None::<[f64; 3]>),
        Attribute::Color(_) => join!(Color, None::<[u8; 3]>),
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::Image;
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn a_picture_or_colors_color_a_mesh_and_so_does_having_no_vertex() {
        let (bare, picture) = (square(0.0, true), Image::new(1, 1, vec![[9; 3]]).unwrap());
        let colors = Attribute::Color(vec![[9; 3]; 4].into());
        assert!(!is_colored(&bare));
        assert!(is_colored(&bare.clone().with_texture(Some(picture))));
        assert!(is_colored(&bare.with_vertex("color", colors).unwrap()));
        assert!(is_colored(&Mesh::new(Vec::new(), Faces::triangles(Vec::new())).unwrap()));
    }

    /// Returns a square of one quad (or two triangles) in the plane z = 0, with its lower left corner at x.
    fn square(x: f64, triangles: bool) -> Mesh {
        fn point(dx: f64, y: f64, x: f64) -> Point3<f64> {
            Point3::new(x + dx, y, 0.0)
        }
        let positions =
            vec![point(0., 0., x), point(1., 0., x), point(1., 1., x), point(0., 1., x)];
        let faces = match triangles {
            true => Faces::triangles(vec![[0, 1, 2], [0, 2, 3]]),
            false => Faces::uniform(4, vec![0, 1, 2, 3]).unwrap(),
        };
        Mesh::new(positions, faces).unwrap()
    }

    fn with_pose(mesh: Mesh, pose: Option<Matrix4<f64>>) -> Mesh {
        mesh.with_frame(Some(CaptureFrame {
            camera: None,
            picture: [4, 4],
            depth: 5.0,
            world_from_camera: pose,
        }))
    }

    /// Returns a rotation by 180 degrees about x, which makes y point up, followed by a translation.
    fn upright(shift: f64) -> Matrix4<f64> {
        Matrix4::new(
            1., 0., 0., shift, //
            0., -1., 0., 0., //
            0., 0., -1., 0., //
            0., 0., 0., 1.,
        )
    }

    fn flags(flags: &[u8]) -> Attribute {
        Attribute::Flag(flags.to_vec().into())
    }

    #[test]
    fn vertices_faces_and_creases_follow_each_other() {
        let first = square(0.0, true).with_creases([([1, 0], 3.0)]).unwrap();
        let second = square(5.0, false).with_creases([([2, 3], 1.0)]).unwrap();
        let merged = merge(&[&first, &second], Poses::Auto).unwrap();
        let faces: Vec<&[u32]> = merged.faces().iter().collect();
        assert_eq!(faces, [&[0, 1, 2][..], &[0, 2, 3], &[4, 5, 6, 7]]);
        assert_eq!(merged.positions()[4], Point3::new(5.0, 0.0, 0.0));
        let creases: Vec<_> = merged.creases().collect();
        assert_eq!(creases, [([0, 1], 3.0), ([6, 7], 1.0)]);
        assert_eq!(merge(&[&first], Poses::Auto).unwrap(), first);
    }

    #[test]
    fn a_merge_beyond_the_memory_is_refused_in_advance() {
        let points =
            (0..100_000).map(|k: u32| Point3::new(f64::from(k), 0.0, 0.0)).collect::<Vec<_>>();
        let mesh = Mesh::new(points, Faces::triangles(Vec::new())).unwrap();
        let error = merge(&vec![&mesh; 30_000], Poses::Auto).unwrap_err();
        assert!(error.to_string().contains("about 72 000 000 000 bytes"), "{error}");
    }

    #[test]
    fn poses_bring_captures_into_one_world_and_turn_their_normals() {
        let normals = Attribute::Vector(vec![[0.0, 0.0, -1.0]; 4].into());
        fn capture(shift: f64, normals: &Attribute) -> Mesh {
            let mesh = square(0.0, true).with_vertex("normal", normals.clone()).unwrap();
            with_pose(mesh, Some(upright(shift)))
        }
        let (first, second) = (capture(0.0, &normals), capture(10.0, &normals));
        for poses in [Poses::Auto, Poses::Apply] {
            let merged = merge(&[&first, &second], poses).unwrap();
            assert_eq!(merged.positions()[6], Point3::new(11.0, -1.0, 0.0));
            assert_eq!(merged.vertex().vectors("normal").unwrap()[6], [0.0, 0.0, 1.0]);
            assert_eq!((merged.frame(), merged.edges().misoriented), (None, 0));
        }
        let ignored = merge(&[&first, &second], Poses::Ignore).unwrap();
        assert_eq!(ignored.positions()[6], Point3::new(1.0, 1.0, 0.0));
        let frame = ignored.frame().unwrap();
        assert_eq!((frame.world_from_camera, frame.picture), (None, [4, 4]));
    }

    #[test]
    fn meshes_stay_without_all_poses_and_requiring_poses_is_an_error() {
        let (first, second) =
            (with_pose(square(0.0, true), Some(upright(9.0))), with_pose(square(2.0, true), None));
        let merged = merge(&[&first, &second], Poses::Auto).unwrap();
        assert_eq!(merged.positions()[0], Point3::origin());
        let error = merge(&[&first, &second], Poses::Apply).unwrap_err();
        assert!(error.to_string().starts_with("mesh 2 has no pose: only captures "), "{error}");
        let mixed = merge(&[&first, &square(0.0, true)], Poses::Auto).unwrap();
        assert_eq!(mixed.frame(), None);
    }

    #[test]
    fn vertices_that_have_moved_are_found_behind_those_of_other_meshes() {
        let normals = Attribute::Vector(vec![[0.0, 0.6, 0.8]; 4].into());
        fn square_at(pose: Option<Matrix4<f64>>, normals: &Attribute) -> Mesh {
            let mesh = square(0.0, true).with_creases([([0, 1], 2.0)]).unwrap();
            with_pose(mesh.with_vertex("normal", normals.clone()).unwrap(), pose)
        }
        for pose in [None, Some(upright(9.0))] {
            let before =
                [square_at(pose, &normals), square_at(pose, &normals), square_at(pose, &normals)];
            let mut now = before.clone();
            let places = [Point3::new(1., 7., 3.), Point3::origin(), Point3::new(2., -0., 4.)];
            let rows = Attribute::Vector(vec![[1., 0., 0.]; 4].into());
            now[1] = now[1].with_moved(&[0..2, 3..4], &places).unwrap();
            now[1] = now[1].clone().with_vertex("normal", rows).unwrap();
            let frame = CaptureFrame { depth: 6.0, ..*before[1].frame().unwrap() };
            now[2] = now[2].clone().with_frame(Some(frame));
            let [before, now] = [&before, &now].map(Vec::from_iter);
            let [made, expected] =
                [&before, &now].map(|meshes| merge(meshes, Poses::Auto).unwrap());
            let followed = follow(&now, &before, &made, Poses::Auto).unwrap();
            assert_eq!(maquette_value::hash_of(&followed), maquette_value::hash_of(&expected));
            let none = with_pose(now[0].clone(), pose.is_none().then(|| upright(1.0)));
            assert_eq!(follow(&[&none; 3], &before, &made, Poses::Apply), None);
            let painted = now[0].clone().with_face("mixed", flags(&[1, 0])).unwrap();
            assert_eq!(follow(&[&painted, now[1], now[2]], &before, &made, Poses::Auto), None);
        }
    }

    #[test]
    fn merging_no_meshes_gives_an_empty_mesh() {
        for poses in [Poses::Auto, Poses::Apply, Poses::Ignore] {
            let empty = merge(&[], poses).unwrap();
            assert_eq!((empty.positions().len(), empty.faces().len()), (0, 0));
        }
    }

    #[test]
    fn attributes_of_all_are_kept_flags_are_filled_in_and_others_left_out() {
        fn numbers(from: u8) -> Attribute {
            Attribute::Number((from..from + 4).map(f64::from).collect())
        }
        let first = square(0.0, true)
            .with_vertex("h", numbers(0))
            .and_then(|mesh| mesh.with_vertex("filled", flags(&[1; 4])))
            .and_then(|mesh| mesh.with_vertex("only", numbers(0)))
            .and_then(|mesh| mesh.with_face("mixed", flags(&[1, 0])))
            .unwrap();
        let second = square(0.0, true)
            .with_vertex("h", numbers(4))
            .and_then(|mesh| mesh.with_face("mixed", Attribute::Index(vec![1, 2].into())))
            .unwrap();
        let merged = merge(&[&first, &second], Poses::Auto).unwrap();
        let expected = Attribute::Number((0..8).map(f64::from).collect());
        assert_eq!(merged.vertex().get("h"), Some(&expected));
        assert_eq!(merged.vertex().get("filled"), Some(&flags(&[1, 1, 1, 1, 0, 0, 0, 0])));
        assert_eq!(merged.vertex().get("only"), None);
        assert_eq!(merged.face().get("mixed"), None);
        let points = Mesh::new(vec![], Faces::triangles(vec![])).unwrap();
        let with_nothing = merge(&[&first, &points], Poses::Auto).unwrap();
        assert_eq!(with_nothing.vertex(), first.vertex());
    }

    #[test]
    fn one_picture_is_kept_and_different_ones_become_colors() {
        fn picture(red: u8) -> Image {
            Image::new(1, 1, vec![[red, 0, 0]]).unwrap()
        }
        fn with_color(red: u8) -> Mesh {
            let uv = Attribute::Pair(vec![[0.5; 2]; 4].into());
            square(0.0, true).with_vertex("uv", uv).unwrap().with_texture(Some(picture(red)))
        }
        let same = merge(&[&with_color(9), &with_color(9)], Poses::Auto).unwrap();
        assert_eq!(same.texture(), Some(&picture(9)));
        assert_eq!(same.vertex().pairs("uv").unwrap().len(), 8);
        let different = merge(&[&with_color(9), &with_color(7)], Poses::Auto).unwrap();
        assert_eq!((different.texture(), different.vertex().pairs("uv")), (None, None));
        let colors = different.vertex().colors("color").unwrap();
        assert_eq!((colors[0], colors[7]), ([9, 0, 0], [7, 0, 0]));
    }
}
