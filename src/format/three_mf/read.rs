//! Reads 3MF files: all items on the plate as one mesh.

use std::collections::BTreeMap;

use maquette_value::{Attribute, Image, Mesh, MeshError, Rgb};
use nalgebra::{Matrix4, Point3};
use thiserror::Error;

use super::model::{Group, Look, Model, Object, Shape};
use crate::corners::{FaceList, with_corners};
use crate::finite::{self, Finite};
use crate::zip::{Archive, NotRead};
use crate::{most_memory, picture_file};

/// Why bytes are not a mesh in a 3MF file.
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum ThreeMfReadError {
    /// No ZIP archive, or a damaged one.
    #[error("a 3MF file is a ZIP archive, but {0}")]
    Archive(#[from] NotRead),
    /// A part without which there is no model.
    #[error("the archive has no part `{name}`: it is no 3MF file, or damaged")]
    NoPart {
        /// Its name.
        name: String,
    },
    /// XML that is none, or in which something is missing or wrong.
    #[error("`{part}`, line {line}: {message}")]
    Wrong {
        /// The part of the archive.
        part: String,
        /// The line, from 1.
        line: u32,
        /// What is wrong.
        message: String,
    },
    /// An object that is a part of itself, or that is nested too deeply.
    #[error(
        "object {object} is a component of itself, or nested more than {MOST_NESTED} levels deep"
    )]
    Nested {
        /// The object's id.
        object: u32,
    },
    /// Copies that take too much memory.
    #[error(
        "its components make more than {MOST_COPIES} times as many triangles as the file has bytes: simplify the assembly where it comes from"
    )]
    TooMany,
    /// No mesh on the plate.
    #[error("there is no triangle in the file")]
    Empty,
    /// A mesh that cannot be.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

const MOST_NESTED: usize = 64;

/// Most triangles that assemblies may make of each byte of the file.
const MOST_COPIES: usize = 4;

/// The part that holds the model, unless the archive says otherwise.
const MODEL: &str = "3D/3dmodel.model";

/// The mesh of all items that are built, y up and in mm, and warnings about what is left out.
///
/// # Errors
/// If the bytes are no 3MF file, it is damaged, or there is no triangle in it.
pub(crate) fn read(bytes: &[u8]) -> Result<(Mesh, Vec<String>), ThreeMfReadError> {
    let archive = Archive::open(bytes)?;
    let most = most_memory(bytes.len());
    let root =
        archive.find(MODEL).or_else(|| archive.names().find(|name| name.ends_with(".model")));
    let root = root.ok_or(ThreeMfReadError::NoPart { name: MODEL.to_owned() })?.to_owned();
    let mut notes = Vec::new();
    let mut models = BTreeMap::new();
    let mut wanted = vec![root.clone()];
    while let Some(name) = wanted.pop() {
        if models.contains_key(&name) {
            continue;
        }
        let text = archive.read(&name, most)?;
        let model = Model::read(&name, &text, &mut notes)?;
        for path in model.parts() {
            let part =
                archive.find(path).ok_or(ThreeMfReadError::NoPart { name: path.to_owned() })?;
            wanted.push(part.to_owned());
        }
        models.insert(name, model);
    }
    let mut assembly = Assembly::new(&archive, &models, MOST_COPIES.saturating_mul(bytes.len()));
    let items = &models[&root].items;
    let plate = Matrix4::identity();
    for item in items {
        let part = item.part.as_deref().and_then(|path| archive.find(path)).unwrap_or(&root);
        assembly.add(part, item.object, &(plate * item.motion), 0)?;
    }
    if items.is_empty() {
        // Some programs write objects and build none of them.
        let used = models[&root].components();
        for &object in models[&root].objects.keys().filter(|object| !used.contains(object)) {
            assembly.add(&root, object, &plate, 0)?;
        }
    }
    assembly.notes.splice(0..0, notes);
    assembly.finish(most)
}

/// The meshes of all items, as they are put together.
struct Assembly<'a> {
    archive: &'a Archive<'a>,
    models: &'a BTreeMap<String, Model>,
    /// Triangles that there may be.
    most: usize,
    places: Vec<Point3<f64>>,
    faces: FaceList,
    /// Of each corner of a face that was given.
    colors: Vec<Rgb>,
    uv: Vec<[f64; 2]>,
    /// The picture, by the name of its part.
    picture: Option<String>,
    /// The names of other pictures.
    other_pictures: Vec<String>,
    /// Triangles with a color, with a place on the picture, and all.
    counts: [usize; 3],
    left_out: usize,
    notes: Vec<String>,
}

impl<'a> Assembly<'a> {
    fn new(archive: &'a Archive<'a>, models: &'a BTreeMap<String, Model>, most: usize) -> Self {
        Self {
            archive,
            models,
            most,
            places: Vec::new(),
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

    /// Adds an object of a part of the archive, moved.
    fn add(
        &mut self,
        part: &str,
        object: u32,
        motion: &Matrix4<f64>,
        depth: usize,
    ) -> Result<(), ThreeMfReadError> {
        if depth > MOST_NESTED {
            return Err(ThreeMfReadError::Nested { object });
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
    ) -> Result<(), ThreeMfReadError> {
        let Shape::Mesh { places, triangles } = &object.shape else { return Ok(()) };
        if self.counts[2] + triangles.len() > self.most {
            return Err(ThreeMfReadError::TooMany);
        }
        let first = self.places.len() as u32;
        // The plate is under z, and meshes have y up.
        let upright =
            |place: Point3<f64>| Point3::new(place.x, place.z, 0.0 - place.y) * model.unit;
        let moved = places.iter().map(|place| upright(motion.transform_point(place)));
        let mut moved = Vec::from_iter(moved);
        let finite = Finite::of(&mut moved);
        self.places.append(&mut moved);
        // A mirror image has its inside out.
        let is_mirrored = motion.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
        for triangle in triangles {
            if !triangle.vertices.iter().all(|&vertex| finite.contains(vertex as usize)) {
                self.left_out += 1;
                continue;
            }
            let order = if is_mirrored { [0, 2, 1] } else { [0, 1, 2] };
            self.faces.push(&order.map(|k| first + triangle.vertices[k]));
            let look = triangle.look.as_ref().or(object.look.as_ref());
            let (color, uv) = self.look(model, look);
            self.counts[0] += usize::from(color.is_some());
            self.counts[1] += usize::from(uv.is_some());
            self.counts[2] += 1;
            self.colors.extend(order.map(|k| color.map_or([255; 3], |color| color[k])));
            self.uv.extend(order.map(|k| uv.map_or([0.0; 2], |uv| uv[k])));
        }
        Ok(())
    }

    /// The colors and the places on the picture of a triangle's corners.
    fn look(
        &mut self,
        model: &Model,
        look: Option<&Look>,
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

    fn finish(mut self, most: usize) -> Result<(Mesh, Vec<String>), ThreeMfReadError> {
        if self.counts[2] == 0 && self.left_out == 0 {
            return Err(ThreeMfReadError::Empty);
        }
        self.notes.extend(finite::doubt(self.left_out, "face"));
        self.notes.extend(self.faces.notes());
        for path in &self.other_pictures {
            self.notes.push(format!(
                "the picture `{path}` is left out: a mesh has one, and its faces show `{}` or nothing",
                self.picture.as_deref().unwrap_or_default()
            ));
        }
        let [colored, textured, all] = self.counts;
        for (with, what) in [(colored, "color"), (textured, "place on the picture")] {
            if (1..all).contains(&with) {
                let instead = if what == "color" { "are white" } else { "have zeros in its place" };
                self.notes.push(format!(
                    "{} of {all} triangles have no {what}, and {instead}",
                    all - with
                ));
            }
        }
        let (faces, origins) = self.faces.finish()?;
        let mut mesh = Mesh::new(self.places, faces)?;
        if colored > 0 {
            let colors: Vec<_> = origins.iter().map(|&origin| self.colors[origin]).collect();
            mesh = with_corners(mesh, "color", colors, [255; 3], Attribute::Color)?;
        }
        if textured > 0 {
            let uv: Vec<_> = origins.iter().map(|&origin| self.uv[origin]).collect();
            mesh = with_corners(mesh, "uv", uv, [0.0; 2], Attribute::Pair)?;
            let path = self.picture.unwrap_or_default();
            match picture(self.archive, &path, most) {
                Ok(image) => mesh = mesh.with_texture(Some(image)),
                Err(why) => self.notes.push(format!("{why}: the mesh comes without its picture")),
            }
        }
        Ok((mesh, self.notes))
    }
}

fn picture(archive: &Archive<'_>, path: &str, most: usize) -> Result<Image, String> {
    let name = archive.find(path).ok_or_else(|| format!("the archive has no picture `{path}`"))?;
    let bytes = archive.read(name, most).map_err(|error| error.to_string())?;
    picture_file::read(&bytes).map_err(|error| format!("{name}: {error}"))
}
