//! Reads 3MF files: all items on the plate as one mesh.

use std::collections::BTreeMap;

use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{Attribute, Image, Mesh, Rgb};
use nalgebra::{Matrix4, Point3};

use super::model::{Appearance, Group, Model, Object, Shape};
use crate::corners::{FaceList, add_corner_data};
use crate::finite::{self, FiniteMask};
use crate::zip::Archive;
use crate::{max_memory, picture_file, unjoined_note};

const MAX_NESTING: usize = 64;

/// The maximum number of an assembly's triangles per byte of the file.
const MAX_TRIANGLES_PER_BYTE: usize = 4;

/// The usual name of the part with the model.
const MODEL: &str = "3D/3dmodel.model";

/// Reads all items to build as one mesh, y up and in mm, with warnings about data that are left out.
///
/// Returns an error if the bytes are not a 3MF file, the file is damaged, or it has no triangles.
pub(crate) fn read(bytes: &[u8]) -> Result<(Mesh, Vec<String>), Error> {
    let archive = Archive::open(bytes).map_err(|error| archive_error(&error))?;
    let limit = max_memory(bytes.len());
    let root =
        archive.find(MODEL).or_else(|| archive.names().find(|name| name.ends_with(".model")));
    let root = root.ok_or_else(|| missing_part(MODEL))?.to_owned();
    let mut notes = Vec::new();
    let mut models = BTreeMap::new();
    let mut wanted = vec![root.clone()];
    while let Some(name) = wanted.pop() {
        if models.contains_key(&name) {
            continue;
        }
        let text = archive.read(&name, limit).map_err(|error| archive_error(&error))?;
        let model = Model::read(&name, &text, &mut notes)?;
        for path in model.parts() {
            let part = archive.find(path).ok_or_else(|| missing_part(path))?;
            wanted.push(part.to_owned());
        }
        models.insert(name, model);
    }
    let mut assembly =
        Assembly::new(&archive, &models, MAX_TRIANGLES_PER_BYTE.saturating_mul(bytes.len()));
    let items = &models[&root].items;
    let plate = Matrix4::identity();
    for item in items {
        let part = item.part.as_deref().and_then(|path| archive.find(path)).unwrap_or(&root);
        assembly.add(part, item.object, &(plate * item.motion), 0)?;
    }
    if items.is_empty() {
        // Some programs write objects, but no build items. Add all objects that are not components of other objects then.
        let used = models[&root].components();
        for &object in models[&root].objects.keys().filter(|object| !used.contains(object)) {
            assembly.add(&root, object, &plate, 0)?;
        }
    }
    assembly.notes.splice(0..0, notes);
    assembly.finish(limit)
}

fn archive_error(error: &Error) -> Error {
    Error::new(format!("a 3MF file is a ZIP archive, but {error}"))
}

fn missing_part(name: &str) -> Error {
    Error::new(format!("the archive has no part `{name}`: it is not a 3MF file, or is damaged"))
}

/// Collects the meshes of all build items.
struct Assembly<'a> {
    archive: &'a Archive<'a>,
    models: &'a BTreeMap<String, Model>,
    /// The maximum number of triangles in the result.
    max_triangles: usize,
    positions: Vec<Point3<f64>>,
    faces: FaceList,
    /// The color of each added corner.
    colors: Vec<Rgb>,
    uv: Vec<[f64; 2]>,
    /// The name of the part with the picture.
    picture: Option<String>,
    /// The names of the parts with other pictures, which are left out.
    other_pictures: Vec<String>,
    /// Three numbers of triangles: with a color, with texture coordinates, and in total.
    counts: [usize; 3],
    left_out: usize,
    notes: Vec<String>,
}

impl<'a> Assembly<'a> {
    fn new(
        archive: &'a Archive<'a>,
        models: &'a BTreeMap<String, Model>,
        max_triangles: usize,
    ) -> Self {
        Self {
            archive,
            models,
            max_triangles,
            positions: Vec::new(),
            faces: FaceList::default(),
            colors: Vec::new(),
            uv: Vec::new(),
            picture: None,
            other_pictures: Vec::new(),
            counts: [0; 3],
            left_out: 0,
            notes: Vec::new(),
        }
    }

    /// Adds an object of the part `part`, transformed by `motion`.
    fn add(
        &mut self,
        part: &str,
        object: u32,
        motion: &Matrix4<f64>,
        depth: usize,
    ) -> Result<(), Error> {
        if depth > MAX_NESTING {
            bail!(
                "object {object} is a component of itself, or nested more than {MAX_NESTING} levels deep"
            );
        }
        let models = self.models;
        let model = &models[part];
        let Some(found) = model.objects.get(&object) else {
            self.notes.push(format!("object {object} is left out: `{part}` has no such object"));
            return Ok(());
        };
        match &found.shape {
            Shape::Mesh { .. } => self.add_mesh(model, found, motion),
            Shape::Components(components) => {
                for component in components {
                    let path = component.part.as_deref().and_then(|path| self.archive.find(path));
                    let motion = motion * component.motion;
                    self.add(path.unwrap_or(part), component.object, &motion, depth + 1)?;
                }
                Ok(())
            }
        }
    }

    fn add_mesh(
        &mut self,
        model: &Model,
        object: &Object,
        motion: &Matrix4<f64>,
    ) -> Result<(), Error> {
        let Shape::Mesh { positions, triangles } = &object.shape else { return Ok(()) };
        if self.counts[2] + triangles.len() > self.max_triangles {
            bail!(
                "the components have more than {MAX_TRIANGLES_PER_BYTE} triangles per byte of the file: simplify the assembly before the export"
            );
        }
        let first = self.positions.len() as u32;
        // The build plate has z up, but meshes have y up.
        let mut moved: Vec<_> = positions
            .iter()
            .map(|point| {
                let point = motion.transform_point(point);
                Point3::new(point.x, point.z, 0.0 - point.y) * model.unit
            })
            .collect();
        let finite = FiniteMask::clear_non_finite(&mut moved);
        self.positions.append(&mut moved);
        // A mirroring transformation reverses the orientation of faces.
        let is_mirrored = motion.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
        for triangle in triangles {
            if !triangle.vertices.iter().all(|&vertex| finite.contains(vertex as usize)) {
                self.left_out += 1;
                continue;
            }
            let order = if is_mirrored { [0, 2, 1] } else { [0, 1, 2] };
            self.faces.push(&order.map(|k| first + triangle.vertices[k]));
            let look = triangle.look.as_ref().or(object.look.as_ref());
            let (color, uv) = self.appearance(model, look);
            self.counts[0] += usize::from(color.is_some());
            self.counts[1] += usize::from(uv.is_some());
            self.counts[2] += 1;
            self.colors.extend(order.map(|k| color.map_or([255; 3], |color| color[k])));
            self.uv.extend(order.map(|k| uv.map_or([0.0; 2], |uv| uv[k])));
        }
        Ok(())
    }

    /// Returns the colors and the texture coordinates of a triangle's corners.
    fn appearance(
        &mut self,
        model: &Model,
        look: Option<&Appearance>,
    ) -> (Option<[Rgb; 3]>, Option<[[f64; 2]; 3]>) {
        let Some((look, group)) =
            look.and_then(|look| Some((look, model.groups.get(&look.group)?)))
        else {
            return (None, None);
        };
        match group {
            Group::Colors(colors) => {
                let [Some(a), Some(b), Some(c)] =
                    look.entries.map(|index: u32| colors.get(index as usize).copied())
                else {
                    return (None, None);
                };
                (Some([a, b, c]), None)
            }
            Group::Picture { path, uv } => {
                let [Some(a), Some(b), Some(c)] =
                    look.entries.map(|index: u32| uv.get(index as usize).copied())
                else {
                    return (None, None);
                };
                if self.picture.get_or_insert_with(|| path.clone()) != path {
                    if !self.other_pictures.contains(path) {
                        self.other_pictures.push(path.clone());
                    }
                    return (None, None);
                }
                (None, Some([a, b, c]))
            }
        }
    }

    fn finish(mut self, limit: usize) -> Result<(Mesh, Vec<String>), Error> {
        if self.counts[2] == 0 && self.left_out == 0 {
            bail!("the file has no triangles");
        }
        self.notes.extend(finite::left_out_note(self.left_out, "face"));
        self.notes.extend(self.faces.notes());
        for path in &self.other_pictures {
            self.notes.push(format!(
                "the picture `{path}` is left out: a mesh can have only one, which is `{}`",
                self.picture.as_deref().unwrap_or_default()
            ));
        }
        let [colored, textured, all] = self.counts;
        for (with, what) in [(colored, "color"), (textured, "texture coordinates")] {
            if (1..all).contains(&with) {
                let instead = if what == "color" { "are white" } else { "get zeros" };
                self.notes.push(format!(
                    "{} of {all} triangles have no {what}, and {instead}",
                    all - with
                ));
            }
        }
        let (faces, origins) = self.faces.finish()?;
        let mut mesh = Mesh::new(self.positions, faces)?;
        self.notes.extend(unjoined_note(&mesh));
        if colored > 0 {
            let colors: Vec<_> = origins.iter().map(|&origin| self.colors[origin]).collect();
            mesh = add_corner_data(mesh, "color", colors, [255; 3], Attribute::Color)?;
        }
        if textured > 0 {
            let uv: Vec<_> = origins.iter().map(|&origin| self.uv[origin]).collect();
            mesh = add_corner_data(mesh, "uv", uv, [0.0; 2], Attribute::Pair)?;
            let path = self.picture.unwrap_or_default();
            match read_picture(self.archive, &path, limit) {
                Ok(image) => mesh = mesh.with_texture(Some(image)),
                Err(why) => self.notes.push(format!("{why}: the mesh comes without its picture")),
            }
        }
        Ok((mesh, self.notes))
    }
}

fn read_picture(archive: &Archive<'_>, path: &str, limit: usize) -> Result<Image, String> {
    let name = archive.find(path).ok_or_else(|| format!("the archive has no picture `{path}`"))?;
    let bytes = archive.read(name, limit).map_err(|error| error.to_string())?;
    picture_file::read(&bytes).map_err(|error| format!("{name}: {error}"))
}
