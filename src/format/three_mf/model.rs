//! Parses the model in a 3MF file, an XML text that contains objects, their appearance, and the items to build.

use std::collections::{BTreeMap, BTreeSet};
use std::str::FromStr;

use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::Rgb;
use nalgebra::{Matrix4, Point3};
use roxmltree::{Document, Node};

use crate::{MAX_NAMESPACES, excerpt, has_many_namespaces, parse_real};

/// The content of a model part, one of the files in the archive.
pub(super) struct Model {
    /// Millimeters per unit of the coordinates.
    pub(super) unit: f64,
    pub(super) objects: BTreeMap<u32, Object>,
    pub(super) groups: BTreeMap<u32, Group>,
    pub(super) items: Vec<Component>,
}

pub(super) struct Object {
    pub(super) shape: Shape,
    /// The appearance of triangles that do not state one.
    pub(super) look: Option<Appearance>,
}

pub(super) enum Shape {
    Mesh { positions: Vec<Point3<f64>>, triangles: Vec<Triangle> },
    Components(Vec<Component>),
}

pub(super) struct Triangle {
    pub(super) vertices: [u32; 3],
    pub(super) look: Option<Appearance>,
}

/// The appearance of a triangle: a group, and the entries of the group for the three corners.
pub(super) struct Appearance {
    pub(super) group: u32,
    pub(super) entries: [u32; 3],
}

/// A group of colors or texture coordinates to which triangles refer.
pub(super) enum Group {
    Colors(Vec<Rgb>),
    /// A picture, with texture coordinates; `(0, 0)` is the lower left corner of the picture.
    Picture {
        path: String,
        uv: Vec<[f64; 2]>,
    },
}

/// A transformed object, as part of another object or on the build plate.
pub(super) struct Component {
    pub(super) object: u32,
    /// The part of the archive that contains the object; `None` if the component and the object are in the same part.
    pub(super) part: Option<String>,
    pub(super) motion: Matrix4<f64>,
}

impl Model {
    /// Parses the part `name` of an archive. Adds warnings about data that are left out.
    pub(super) fn read(name: &str, bytes: &[u8], notes: &mut Vec<String>) -> Result<Self, Error> {
        let Ok(text) = str::from_utf8(bytes) else {
            bail!("`{name}`, line 1: it is not text in UTF-8");
        };
        if has_many_namespaces(bytes) {
            bail!("`{name}`, line 1: it declares more than {MAX_NAMESPACES} namespaces");
        }
        let text = text.trim_start_matches('\u{feff}');
        let document = Document::parse(text).map_err(|error| {
            let line = error.pos().row;
            Error::new(format!("`{name}`, line {line}: {error}"))
        })?;
        let part = Part { name, document: &document };
        part.model(document.root_element(), notes)
    }

    /// Returns the names of the other parts of the archive to which the model refers.
    pub(super) fn parts(&self) -> impl Iterator<Item = &str> {
        let nested = self.objects.values().flat_map(|object| match &object.shape {
            Shape::Components(components) => &components[..],
            Shape::Mesh { .. } => &[],
        });
        self.items.iter().chain(nested).filter_map(|component| component.part.as_deref())
    }

    /// Returns the objects that are components of other objects.
    pub(super) fn components(&self) -> BTreeSet<u32> {
        let nested = self.objects.values().filter_map(|object| match &object.shape {
            Shape::Components(components) => Some(components),
            Shape::Mesh { .. } => None,
        });
        nested.flatten().map(|component| component.object).collect()
    }
}

/// A part of the archive while it is being parsed.
struct Part<'a> {
    name: &'a str,
    document: &'a Document<'a>,
}

impl Part<'_> {
    fn node_error(&self, node: Node<'_, '_>, message: String) -> Error {
        let line = self.document.text_pos_at(node.range().start).row;
        Error::new(format!("`{}`, line {line}: {message}", self.name))
    }

    /// Parses an optional attribute.
    fn optional_attribute<T: FromStr>(
        &self,
        node: Node<'_, '_>,
        name: &str,
    ) -> Result<Option<T>, Error> {
        let Some(text) = node.attribute(name) else { return Ok(None) };
        text.trim().parse().map(Some).map_err(|_| {
            let text = excerpt(text.as_bytes());
            self.node_error(
                node,
                format!("invalid value `{text}` of `{name}` in `{}`", node.tag_name().name()),
            )
        })
    }

    fn attribute<T: FromStr>(&self, node: Node<'_, '_>, name: &str) -> Result<T, Error> {
        self.optional_attribute(node, name)?.ok_or_else(|| {
            self.node_error(node, format!("`{}` has no `{name}`", node.tag_name().name()))
        })
    }

    /// Parses a coordinate, which may be NaN.
    fn real(&self, node: Node<'_, '_>, name: &str) -> Result<f64, Error> {
        let text = node.attribute(name).map(|text| text.trim().as_bytes());
        text.and_then(parse_real).map_or_else(|| self.attribute(node, name), Ok)
    }

    fn model(&self, root: Node<'_, '_>, notes: &mut Vec<String>) -> Result<Model, Error> {
        if root.tag_name().name() != "model" {
            return Err(self.node_error(
                root,
                format!("expected `model`, found `{}`", root.tag_name().name()),
            ));
        }
        let unit = match root.attribute("unit").unwrap_or("millimeter") {
            "micron" => 0.001,
            "millimeter" => 1.0,
            "centimeter" => 10.0,
            "inch" => 25.4,
            "foot" => 304.8,
            "meter" => 1000.0,
            other => {
                return Err(
                    self.node_error(root, format!("unknown unit `{}`", excerpt(other.as_bytes())))
                );
            }
        };
        let mut model =
            Model { unit, objects: BTreeMap::new(), groups: BTreeMap::new(), items: Vec::new() };
        let mut others = BTreeSet::new();
        let mut pictures: BTreeMap<u32, String> = BTreeMap::new();
        for node in elements(root) {
            match node.tag_name().name() {
                "resources" => {}
                "build" => {
                    for item in elements(node) {
                        model.items.push(self.component(item)?);
                    }
                }
                "metadata" | "metadatagroup" => {}
                other => drop(others.insert(other)),
            }
        }
        let resources =
            elements(root).filter(|node| node.tag_name().name() == "resources").flat_map(elements);
        for node in resources {
            match node.tag_name().name() {
                "object" => {
                    let object = self.object(node, &mut others)?;
                    model.objects.insert(self.attribute(node, "id")?, object);
                }
                "basematerials" => {
                    let colors = self.colors(node, "base", "displaycolor")?;
                    model.groups.insert(self.attribute(node, "id")?, Group::Colors(colors));
                }
                "colorgroup" => {
                    let colors = self.colors(node, "color", "color")?;
                    model.groups.insert(self.attribute(node, "id")?, Group::Colors(colors));
                }
                "texture2d" => {
                    pictures.insert(self.attribute(node, "id")?, self.attribute(node, "path")?);
                }
                "texture2dgroup" => {
                    let path =
                        pictures.get(&self.attribute(node, "texid")?).cloned().unwrap_or_default();
                    let uv =
                        elements(node).map(|it| Ok([self.real(it, "u")?, self.real(it, "v")?]));
                    let uv = uv.collect::<Result<_, Error>>()?;
                    model.groups.insert(self.attribute(node, "id")?, Group::Picture { path, uv });
                }
                other => drop(others.insert(other)),
            }
        }
        let others: Vec<_> =
            others.into_iter().map(|name| format!("`{}`", excerpt(name.as_bytes()))).collect();
        if !others.is_empty() {
            notes.push(format!(
                "{} of `{}` {} left out: not supported in 3MF files",
                others.join(", "),
                self.name,
                if others.len() == 1 { "is" } else { "are" }
            ));
        }
        Ok(model)
    }

    fn colors(
        &self,
        group: Node<'_, '_>,
        element: &str,
        attribute: &str,
    ) -> Result<Vec<Rgb>, Error> {
        let entries = elements(group).filter(|node| node.tag_name().name() == element);
        entries
            .map(|node| {
                let text: String = self.attribute(node, attribute)?;
                let digits = text.strip_prefix('#').filter(|it| [6, 8].contains(&it.len()));
                let number =
                    digits.and_then(|digits| u32::from_str_radix(digits.get(..6)?, 16).ok());
                let [_, red, green, blue] = number
                    .ok_or_else(|| {
                        self.node_error(
                            node,
                            format!(
                                "expected a color `#RRGGBB`, found `{}`",
                                excerpt(text.as_bytes())
                            ),
                        )
                    })?
                    .to_be_bytes();
                Ok([red, green, blue])
            })
            .collect()
    }

    fn object<'d>(
        &self,
        node: Node<'d, '_>,
        others: &mut BTreeSet<&'d str>,
    ) -> Result<Object, Error> {
        let group: Option<u32> = self.optional_attribute(node, "pid")?;
        let entry: u32 = self.optional_attribute(node, "pindex")?.unwrap_or_default();
        let mut shape = Shape::Components(Vec::new());
        for child in elements(node) {
            match child.tag_name().name() {
                "mesh" => shape = self.mesh(child, group, others)?,
                "components" => {
                    let components = elements(child).map(|node| self.component(node));
                    shape = Shape::Components(components.collect::<Result<_, Error>>()?);
                }
                "metadatagroup" => {}
                other => drop(others.insert(other)),
            }
        }
        Ok(Object { shape, look: group.map(|group| Appearance { group, entries: [entry; 3] }) })
    }

    fn mesh<'d>(
        &self,
        node: Node<'d, '_>,
        group: Option<u32>,
        others: &mut BTreeSet<&'d str>,
    ) -> Result<Shape, Error> {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for list in elements(node) {
            match list.tag_name().name() {
                "vertices" => {
                    for vertex in elements(list) {
                        let [x, y, z] = ["x", "y", "z"].map(|axis| self.real(vertex, axis));
                        positions.push(Point3::new(x?, y?, z?));
                    }
                }
                "triangles" => {
                    for triangle in elements(list) {
                        triangles.push(self.triangle(triangle, group, positions.len())?);
                    }
                }
                other => drop(others.insert(other)),
            }
        }
        Ok(Shape::Mesh { positions, triangles })
    }

    fn triangle(
        &self,
        node: Node<'_, '_>,
        group: Option<u32>,
        count: usize,
    ) -> Result<Triangle, Error> {
        let [a, b, c] = ["v1", "v2", "v3"].map(|name| self.attribute::<u32>(node, name));
        let vertices = [a?, b?, c?];
        if let Some(vertex) = vertices.iter().find(|&&vertex| count <= vertex as usize) {
            return Err(self.node_error(
                node,
                format!(
                    "a triangle refers to vertex {vertex}, but there are only {count} vertices"
                ),
            ));
        }
        let look = match (
            self.optional_attribute(node, "pid")?.or(group),
            self.optional_attribute::<u32>(node, "p1")?,
        ) {
            (Some(group), Some(first)) => {
                let [second, third] = ["p2", "p3"].map(|name| self.optional_attribute(node, name));
                Some(Appearance {
                    group,
                    entries: [first, second?.unwrap_or(first), third?.unwrap_or(first)],
                })
            }
            _ => None,
        };
        Ok(Triangle { vertices, look })
    }

    fn component(&self, node: Node<'_, '_>) -> Result<Component, Error> {
        let object = self.attribute(node, "objectid")?;
        // `path` is an attribute of the production extension. The prefix of this extension differs between files, so it is ignored.
        let part = node.attributes().find(|it| it.name() == "path").map(|it| it.value().to_owned());
        let Some(text) = node.attribute("transform") else {
            return Ok(Component { object, part, motion: Matrix4::identity() });
        };
        let numbers = text.split_whitespace().map(|word| parse_real::<f64>(word.as_bytes()));
        let numbers =
            numbers.collect::<Option<Vec<f64>>>().and_then(|it| <[f64; 12]>::try_from(it).ok());
        let rows = numbers.ok_or_else(|| {
            self.node_error(
                node,
                format!("expected 12 numbers in `transform`, found `{}`", excerpt(text.as_bytes())),
            )
        })?;
        // In the file, the matrix multiplies row vectors, and its last row is the translation.
        Ok(Component {
            object,
            part,
            motion: Matrix4::from_fn(|row: usize, column: usize| {
                if row < 3 { rows[3 * column + row] } else { f64::from(column == 3) }
            }),
        })
    }
}

/// The child elements of a node.
fn elements<'d, 'i>(node: Node<'d, 'i>) -> impl Iterator<Item = Node<'d, 'i>> {
    node.children().filter(Node::is_element)
}
