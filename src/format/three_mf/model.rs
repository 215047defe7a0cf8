//! The model in a 3MF file: an XML text of objects, what they look like, and which of them are built.

use std::collections::{BTreeMap, BTreeSet};
use std::str::FromStr;

use maquette_value::Rgb;
use nalgebra::{Matrix4, Point3};
use roxmltree::{Document, Node};

use super::read::ThreeMfReadError;
use crate::{MOST_NAMESPACES, excerpt, has_many_namespaces, real};

/// What a part of the archive says.
pub(super) struct Model {
    /// Millimeters in its unit.
    pub(super) unit: f64,
    pub(super) objects: BTreeMap<u32, Object>,
    pub(super) groups: BTreeMap<u32, Group>,
    pub(super) items: Vec<Component>,
}

pub(super) struct Object {
    pub(super) shape: Shape,
    /// The look of triangles that have none of their own.
    pub(super) look: Option<Look>,
}

pub(super) enum Shape {
    Mesh { places: Vec<Point3<f64>>, triangles: Vec<Triangle> },
    Components(Vec<Component>),
}

pub(super) struct Triangle {
    pub(super) vertices: [u32; 3],
    pub(super) look: Option<Look>,
}

/// The entries of a group that the three corners of a triangle have.
pub(super) struct Look {
    pub(super) group: u32,
    pub(super) entries: [u32; 3],
}

/// What triangles can look like.
pub(super) enum Group {
    Colors(Vec<Rgb>),
    /// Places on a picture, `(0, 0)` at its lower left.
    Picture {
        path: String,
        uv: Vec<[f64; 2]>,
    },
}

/// A moved object, in an object or on the plate.
pub(super) struct Component {
    pub(super) object: u32,
    /// The part of the archive that has the object, if it is another one.
    pub(super) part: Option<String>,
    pub(super) motion: Matrix4<f64>,
}

impl Model {
    /// Reads the part `name` of an archive; adds warnings about what is left out.
    pub(super) fn read(
        name: &str,
        bytes: &[u8],
        notes: &mut Vec<String>,
    ) -> Result<Self, ThreeMfReadError> {
        fn wrong(line: u32, message: String, name: &str) -> ThreeMfReadError {
            ThreeMfReadError::Wrong { part: name.to_owned(), line, message }
        }
        let text =
            str::from_utf8(bytes).map_err(|_| wrong(1, "it is not text in UTF-8".into(), name))?;
        if has_many_namespaces(bytes) {
            return Err(wrong(
                1,
                format!("it declares more than {MOST_NAMESPACES} namespaces"),
                name,
            ));
        }
        let text = text.trim_start_matches('\u{feff}');
        let document = Document::parse(text)
            .map_err(|error| wrong(error.pos().row, error.to_string(), name))?;
        let part = Part { name, document: &document };
        part.model(document.root_element(), notes)
    }

    /// The other parts of the archive that it needs.
    pub(super) fn parts(&self) -> impl Iterator<Item = &str> {
        let nested = self.objects.values().flat_map(|object| match &object.shape {
            Shape::Components(components) => &components[..],
            Shape::Mesh { .. } => &[],
        });
        self.items.iter().chain(nested).filter_map(|component| component.part.as_deref())
    }

    /// The objects that are components of others.
    pub(super) fn components(&self) -> BTreeSet<u32> {
        let nested = self.objects.values().filter_map(|object| match &object.shape {
            Shape::Components(components) => Some(components),
            Shape::Mesh { .. } => None,
        });
        nested.flatten().map(|component| component.object).collect()
    }
}

/// A part of the archive that is being read.
struct Part<'a> {
    name: &'a str,
    document: &'a Document<'a>,
}

type Found<T> = Result<T, ThreeMfReadError>;

impl Part<'_> {
    fn wrong(&self, node: Node<'_, '_>, message: String) -> ThreeMfReadError {
        let line = self.document.text_pos_at(node.range().start).row;
        ThreeMfReadError::Wrong { part: self.name.to_owned(), line, message }
    }

    /// An attribute, if it is there.
    fn maybe<T: FromStr>(&self, node: Node<'_, '_>, name: &str) -> Found<Option<T>> {
        let Some(text) = node.attribute(name) else { return Ok(None) };
        text.trim().parse().map(Some).map_err(|_| {
            let text = excerpt(text.as_bytes());
            self.wrong(node, format!("`{name}` of `{}` cannot be `{text}`", node.tag_name().name()))
        })
    }

    fn needed<T: FromStr>(&self, node: Node<'_, '_>, name: &str) -> Found<T> {
        self.maybe(node, name)?.ok_or_else(|| {
            self.wrong(node, format!("`{}` has no `{name}`", node.tag_name().name()))
        })
    }

    /// A coordinate, which may be NaN.
    fn real(&self, node: Node<'_, '_>, name: &str) -> Found<f64> {
        let text = node.attribute(name).map(|text| text.trim().as_bytes());
        text.and_then(real).map_or_else(|| self.needed(node, name), Ok)
    }

    fn model(&self, root: Node<'_, '_>, notes: &mut Vec<String>) -> Found<Model> {
        if root.tag_name().name() != "model" {
            return Err(
                self.wrong(root, format!("expected `model`, found `{}`", root.tag_name().name()))
            );
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
                    self.wrong(root, format!("unknown unit `{}`", excerpt(other.as_bytes())))
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
                    model.objects.insert(self.needed(node, "id")?, object);
                }
                "basematerials" => {
                    let colors = self.colors(node, "base", "displaycolor")?;
                    model.groups.insert(self.needed(node, "id")?, Group::Colors(colors));
                }
                "colorgroup" => {
                    let colors = self.colors(node, "color", "color")?;
                    model.groups.insert(self.needed(node, "id")?, Group::Colors(colors));
                }
                "texture2d" => {
                    pictures.insert(self.needed(node, "id")?, self.needed(node, "path")?);
                }
                "texture2dgroup" => {
                    let path =
                        pictures.get(&self.needed(node, "texid")?).cloned().unwrap_or_default();
                    let uv =
                        elements(node).map(|it| Ok([self.real(it, "u")?, self.real(it, "v")?]));
                    let uv = uv.collect::<Found<_>>()?;
                    model.groups.insert(self.needed(node, "id")?, Group::Picture { path, uv });
                }
                other => drop(others.insert(other)),
            }
        }
        let others: Vec<_> =
            others.into_iter().map(|name| format!("`{}`", excerpt(name.as_bytes()))).collect();
        if !others.is_empty() {
            notes.push(format!(
                "{} of `{}` {} left out: not read from 3MF files",
                others.join(", "),
                self.name,
                if others.len() == 1 { "is" } else { "are" }
            ));
        }
        Ok(model)
    }

    fn colors(&self, group: Node<'_, '_>, element: &str, attribute: &str) -> Found<Vec<Rgb>> {
        let entries = elements(group).filter(|node| node.tag_name().name() == element);
        entries
            .map(|node| {
                let text: String = self.needed(node, attribute)?;
                let digits = text.strip_prefix('#').filter(|it| [6, 8].contains(&it.len()));
                let number =
                    digits.and_then(|digits| u32::from_str_radix(digits.get(..6)?, 16).ok());
                let [_, red, green, blue] = number
                    .ok_or_else(|| {
                        self.wrong(
                            node,
                            format!(
                                "`{}` is no color: expected `#RRGGBB`",
                                excerpt(text.as_bytes())
                            ),
                        )
                    })?
                    .to_be_bytes();
                Ok([red, green, blue])
            })
            .collect()
    }

    fn object<'d>(&self, node: Node<'d, '_>, others: &mut BTreeSet<&'d str>) -> Found<Object> {
        let group: Option<u32> = self.maybe(node, "pid")?;
        let entry: u32 = self.maybe(node, "pindex")?.unwrap_or_default();
        let mut shape = Shape::Components(Vec::new());
        for child in elements(node) {
            match child.tag_name().name() {
                "mesh" => shape = self.mesh(child, group, others)?,
                "components" => {
                    let components = elements(child).map(|node| self.component(node));
                    shape = Shape::Components(components.collect::<Found<_>>()?);
                }
                "metadatagroup" => {}
                other => drop(others.insert(other)),
            }
        }
        Ok(Object { shape, look: group.map(|group| Look { group, entries: [entry; 3] }) })
    }

    fn mesh<'d>(
        &self,
        node: Node<'d, '_>,
        group: Option<u32>,
        others: &mut BTreeSet<&'d str>,
    ) -> Found<Shape> {
        let (mut places, mut triangles) = (Vec::new(), Vec::new());
        for list in elements(node) {
            match list.tag_name().name() {
                "vertices" => {
                    for vertex in elements(list) {
                        let [x, y, z] = ["x", "y", "z"].map(|axis| self.real(vertex, axis));
                        places.push(Point3::new(x?, y?, z?));
                    }
                }
                "triangles" => {
                    for triangle in elements(list) {
                        triangles.push(self.triangle(triangle, group, places.len())?);
                    }
                }
                other => drop(others.insert(other)),
            }
        }
        Ok(Shape::Mesh { places, triangles })
    }

    fn triangle(&self, node: Node<'_, '_>, group: Option<u32>, count: usize) -> Found<Triangle> {
        let [a, b, c] = ["v1", "v2", "v3"].map(|name| self.needed::<u32>(node, name));
        let vertices = [a?, b?, c?];
        if let Some(vertex) = vertices.iter().find(|&&vertex| count <= vertex as usize) {
            return Err(self.wrong(
                node,
                format!("a triangle names vertex {vertex}, but there are only {count}"),
            ));
        }
        let look = match (self.maybe(node, "pid")?.or(group), self.maybe::<u32>(node, "p1")?) {
            (Some(group), Some(first)) => {
                let [second, third] = ["p2", "p3"].map(|name| self.maybe(node, name));
                Some(Look {
                    group,
                    entries: [first, second?.unwrap_or(first), third?.unwrap_or(first)],
                })
            }
            _ => None,
        };
        Ok(Triangle { vertices, look })
    }

    fn component(&self, node: Node<'_, '_>) -> Found<Component> {
        let object = self.needed(node, "objectid")?;
        // An attribute of the production extension, whatever its prefix.
        let part = node.attributes().find(|it| it.name() == "path").map(|it| it.value().to_owned());
        let Some(text) = node.attribute("transform") else {
            return Ok(Component { object, part, motion: Matrix4::identity() });
        };
        let numbers = text.split_whitespace().map(|word| real::<f64>(word.as_bytes()));
        let numbers =
            numbers.collect::<Option<Vec<f64>>>().and_then(|it| <[f64; 12]>::try_from(it).ok());
        let rows = numbers.ok_or_else(|| {
            self.wrong(
                node,
                format!("`transform` is `{}`: expected 12 numbers", excerpt(text.as_bytes())),
            )
        })?;
        // It multiplies row vectors, with the translation in the last row.
        Ok(Component {
            object,
            part,
            motion: Matrix4::from_fn(|row: usize, column: usize| {
                if row < 3 { rows[3 * column + row] } else { f64::from(column == 3) }
            }),
        })
    }
}

/// The elements right below one.
fn elements<'d, 'i>(node: Node<'d, 'i>) -> impl Iterator<Item = Node<'d, 'i>> {
    node.children().filter(Node::is_element)
}
