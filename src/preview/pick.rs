//! Finds the element of a value that is under the pointer in a 3D view.

use maquette_value::{
    AnyValue, Attribute, Attributes, Axes, Layer, Material, Mesh, RayHit, Rgb, TriangleTree, Wrap,
};
use nalgebra::{Point3, Vector3};
use serde::Deserialize;
use serde_json::{Map, Value as Json, json};

/// The radius that is used if [`PickRay::radius`] is `None`, as a fraction of the distance from the eye.
const DEFAULT_RADIUS: f64 = 0.01;

/// A ray from the eye through the pointer, in the coordinate system of the value.
#[derive(Clone, Debug, Deserialize)]
pub struct PickRay {
    origin: [f64; 3],
    direction: [f64; 3],
    /// The maximum distance of a picked point from the ray, as a fraction of the point's distance from the eye. `None` stands for
    /// `DEFAULT_RADIUS`.
    radius: Option<f64>,
}

/// An index of a value that makes picking fast. Its coordinate system is that of the first mesh, or of the first layer if there is no mesh.
pub(super) struct Pickable {
    axes: Axes,
    layers: Vec<Layer>,
    /// A search tree for each mesh layer.
    trees: Vec<TriangleTree>,
}

/// The element that a ray hits.
struct Hit<'a> {
    kind: &'static str,
    at: Point3<f64>,
    /// The index and the position of the vertex or point nearest to the hit.
    vertex: (usize, Point3<f64>),
    axes: Axes,
    face: Option<u32>,
    /// The visible color at the hit, or `None` if the element has no color. If the color comes from a texture, also the pixel of the
    /// texture.
    color: Option<(Rgb, Option<[usize; 2]>)>,
    /// The attributes at the hit, for each kind of element: the name of the kind, its attributes, and the index of the element.
    attributes: Vec<(&'static str, &'a Attributes, usize)>,
}

impl Pickable {
    pub(super) fn new(value: &AnyValue) -> Self {
        let layers = value.show();
        let meshes: Vec<_> = layers.iter().filter_map(mesh_of).collect();
        let first = meshes.first().copied().map(axes_of_mesh);
        let axes = first.or_else(|| layers.iter().find_map(Layer::axes)).unwrap_or_default();
        let trees = meshes.into_iter().map(TriangleTree::new).collect();
        Self { axes, layers, trees }
    }

    /// Describes the first face that the ray hits. If the ray hits no face, describes the point, line or arrow nearest to the ray. Returns
    /// `None` if all of them are too far from the ray.
    pub(super) fn pick(&self, sight: &PickRay) -> Option<Json> {
        let numbers = sight.origin.iter().chain(&sight.direction).chain(&sight.radius);
        if !numbers.into_iter().all(|number| number.is_finite()) {
            return None;
        }
        let found = self.face(sight).or_else(|| self.point(sight))?;
        let (vertex, vertex_at) = found.vertex;
        let [at, vertex_at] = [found.at, vertex_at]
            .map(|position| Json::from(found.axes.convert(position, self.axes).coords.as_slice()));
        let mut fields = json!({
            "kind": found.kind,
            "at": at,
            "vertex": vertex,
            "vertex_at": vertex_at,
        });
        if let Some(face) = found.face {
            fields["face"] = face.into();
        }
        if let Some((color, pixel)) = found.color {
            fields["color"] = in_hexadecimal(color).into();
            fields["pixel"] = pixel.map_or(Json::Null, |pixel| pixel.to_vec().into());
        }
        for (name, attributes, element) in found.attributes {
            fields[name] = values(attributes, element);
        }
        Some(fields)
    }

    fn face(&self, sight: &PickRay) -> Option<Hit<'_>> {
        let meshes = self.layers.iter().filter_map(mesh_of);
        let hits = meshes.zip(&self.trees).filter_map(|(mesh, tree)| {
            let (origin, direction) = self.ray(sight, axes_of_mesh(mesh));
            Some((mesh, tree.first_hit(origin, direction)?))
        });
        let (mesh, hit) = hits.reduce(|a, b| if b.1.along < a.1.along { b } else { a })?;
        let at = hit.position(mesh);
        let face = hit.face as usize;
        let first = mesh.faces().first_corner(face);
        let vertices = mesh.faces().face(face).iter().map(|&vertex| vertex as usize);
        let distances =
            vertices.map(|vertex| (vertex, (mesh.positions()[vertex] - at).norm_squared()));
        let (corner, (vertex, _)) =
            distances.enumerate().min_by(|(_, (_, a)), (_, (_, b))| a.total_cmp(b))?;
        Some(Hit {
            kind: "triangles",
            at,
            vertex: (vertex, mesh.positions()[vertex]),
            axes: axes_of_mesh(mesh),
            face: Some(hit.face),
            color: color_at(mesh, &hit, first + corner, vertex),
            attributes: vec![
                ("attributes", mesh.vertex(), vertex),
                ("corner_attributes", mesh.corner(), first + corner),
                ("face_attributes", mesh.face(), face),
            ],
        })
    }

    /// Returns the point, end of a line segment or end of an arrow that has the smallest angle to the ray. Returns `None` if all are too
    /// far from the ray.
    fn point(&self, sight: &PickRay) -> Option<Hit<'_>> {
        let mut best: Option<(f64, Hit<'_>)> = None;
        for layer in &self.layers {
            let Some(axes) = layer.axes() else { continue };
            let cone = Cone::new(self.ray(sight, axes), sight.radius.unwrap_or(DEFAULT_RADIUS))?;
            let (kind, nearest) = match layer {
                Layer::Points(cloud) => {
                    ("points", cone.nearest(cloud.points.positions().iter().copied().enumerate()))
                }
                Layer::Lines(lines) => {
                    let corners = lines.chains.iter().flatten().map(|&k| k as usize);
                    (
                        "lines",
                        cone.nearest(
                            corners.filter_map(|k: usize| Some((k, *lines.points.get(k)?))),
                        ),
                    )
                }
                Layer::Arrows(arrows) => {
                    let ends = arrows.to.iter().copied().enumerate();
                    ("arrows", cone.nearest(arrows.from.iter().copied().enumerate().chain(ends)))
                }
                Layer::Picture(_) | Layer::Triangles(_) | Layer::Plot(_) | Layer::Marks(_) => {
                    continue;
                }
            };
            let Some((off, vertex)) = nearest else { continue };
            if best.as_ref().is_none_or(|(least, _)| off < *least) {
                let attributes = match layer {
                    Layer::Points(cloud) => {
                        vec![("attributes", cloud.points.attributes(), vertex.0)]
                    }
                    _ => Vec::new(),
                };
                let at = vertex.1;
                let color = attributes.first().and_then(|(_, attributes, element)| {
                    Some((attributes.colors("color")?[*element], None))
                });
                let found = Hit { kind, at, vertex, axes, face: None, color, attributes };
                best = Some((off, found));
            }
        }
        best.map(|(_, found)| found)
    }

    /// Converts the ray to the coordinate system `axes` of a layer.
    fn ray(&self, sight: &PickRay, axes: Axes) -> (Point3<f64>, Vector3<f64>) {
        let [origin, direction] = [sight.origin, sight.direction]
            .map(|vector| self.axes.convert(Point3::from(vector), axes));
        (origin, direction.coords)
    }
}

/// A cone whose axis is a ray. Points inside of it are near enough to be picked.
struct Cone {
    origin: Point3<f64>,
    /// The direction of the axis, of length 1.
    direction: Vector3<f64>,
    /// The radius of the cone at a point, as a fraction of the point's distance from the eye.
    radius: f64,
}

impl Cone {
    /// Creates a cone around a ray, given by its origin and direction. Returns `None` if the direction is zero or not finite.
    fn new((origin, direction): (Point3<f64>, Vector3<f64>), radius: f64) -> Option<Self> {
        // Scale first: the square of a huge component would be infinite.
        let direction = (direction / direction.amax()).normalize();
        let is_one = direction.iter().all(|x| x.is_finite());
        is_one.then_some(Self { origin, direction, radius })
    }

    /// Finds the position with the smallest angle to the ray, or the first of several such positions. Returns the tangent of the angle (the
    /// distance from the ray divided by the distance along the ray), and the position with its index. Returns `None` if no position is
    /// inside of the cone.
    fn nearest(
        &self,
        places: impl Iterator<Item = (usize, Point3<f64>)>,
    ) -> Option<(f64, (usize, Point3<f64>))> {
        places
            .filter_map(|(index, place): (usize, Point3<f64>)| {
                let way = place - self.origin;
                let along = way.dot(&self.direction);
                let off = (way - self.direction * along).norm() / along;
                (0.0 < along && off <= self.radius).then_some((off, (index, place)))
            })
            .reduce(|a, b| if b.0 < a.0 { b } else { a })
    }
}

fn mesh_of(layer: &Layer) -> Option<&Mesh> {
    match layer {
        Layer::Triangles(mesh) => Some(mesh),
        _ => None,
    }
}

fn axes_of_mesh(mesh: &Mesh) -> Axes {
    if mesh.frame().is_some() { Axes::Sensor } else { Axes::Upright }
}

/// Returns the color of a mesh where a ray hits it, as `maquette render` draws it. This is the color of the texture, otherwise of the
/// nearest corner or vertex, otherwise of the material. Returns `None` if the mesh has none of these. For a texture, also returns the
/// pixel.
fn color_at(
    mesh: &Mesh,
    hit: &RayHit,
    corner: usize,
    vertex: usize,
) -> Option<(Rgb, Option<[usize; 2]>)> {
    let corners = hit.corners.map(|corner| corner as usize);
    let vertices = corners.map(|corner| mesh.faces().corners()[corner] as usize);
    let uv = match (mesh.corner().pairs("uv"), mesh.vertex().pairs("uv")) {
        (Some(uv), _) => Some(corners.map(|corner| uv[corner])),
        (None, Some(uv)) => Some(vertices.map(|vertex| uv[vertex])),
        (None, None) => None,
    };
    let material = mesh.material_of(hit.face as usize);
    if let Some((material, uv)) = material.zip(uv)
        && let Some(texture) = material.non_empty_picture()
    {
        let uv = [0, 1].map(|axis| {
            hit.barycentric().iter().zip(uv).map(|(share, uv)| share * uv[axis]).sum::<f64>()
        });
        let [u, v] = Wrap::wrap_uv(material.wrap(), uv);
        fn texel(share: f64, size: usize) -> usize {
            ((share * size as f64) as usize).min(size - 1)
        }
        let pixel = [texel(u, texture.width()), texel(1.0 - v, texture.height())];
        return Some((texture.pixel(pixel), Some(pixel)));
    }
    let color = match (mesh.corner().colors("color"), mesh.vertex().colors("color")) {
        (Some(colors), _) => colors[corner],
        (None, Some(colors)) => colors[vertex],
        (None, None) => material.map(Material::color).filter(|color| *color != [255; 3])?,
    };
    Some((color, None))
}

fn in_hexadecimal([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Returns the attributes of an element as JSON, by the name of the attribute.
fn values(attributes: &Attributes, element: usize) -> Json {
    fn value(attribute: &Attribute, element: usize) -> Json {
        match attribute {
            Attribute::Number(column) => column[element].into(),
            Attribute::Index(column) => column[element].into(),
            Attribute::Flag(column) => column[element].into(),
            Attribute::Pair(column) => column[element].to_vec().into(),
            Attribute::Vector(column) => column[element].to_vec().into(),
            Attribute::Color(column) => in_hexadecimal(column[element]).into(),
        }
    }
    let all =
        attributes.iter().map(|(name, attribute)| (name.to_owned(), value(attribute, element)));
    Json::Object(Map::from_iter(all))
}

#[cfg(test)]
mod tests {
    use maquette_value::{Arrows, Cloud, Faces, Lines, Points};

    use super::*;

    fn pick(layers: Vec<Layer>, sight: &Json) -> Json {
        let axes = layers.iter().find_map(Layer::axes).unwrap_or_default();
        let trees = layers.iter().filter_map(mesh_of).map(TriangleTree::new).collect();
        let sight = PickRay::deserialize(sight).unwrap();
        Pickable { axes, layers, trees }.pick(&sight).unwrap_or_default()
    }

    #[test]
    fn the_nearest_point_line_or_arrow_is_picked() {
        fn x(x: f64) -> Point3<f64> {
            Point3::new(x, 0.0, 0.0)
        }
        fn cloud(axes: Axes) -> Layer {
            let points = Points::new(vec![x(-0.3), x(0.2), Point3::new(0.2, 5.0, 0.0)]).unwrap();
            let points = points.with_attribute("w", Attribute::Number(vec![1.0, 2.0, 3.0].into()));
            Layer::Points(Cloud { points: points.unwrap(), axes })
        }
        let up =
            json!({ "origin": [0.0, -10.0, 0.0], "direction": [0.0, 3.0, 0.0], "radius": 0.05 });
        let found = pick(vec![cloud(Axes::Upright)], &up);
        // The point with index 1 is nearer to the eye, but its angle to the ray is larger.
        assert_eq!((&found["kind"], &found["vertex"]), (&json!("points"), &json!(2)), "{found}");
        assert_eq!(
            (&found["at"], &found["attributes"]),
            (&json!([0.2, 5.0, 0.0]), &json!({ "w": 3.0 }))
        );
        // A point behind the eye or outside of the cone is not picked.
        let down =
            json!({ "origin": [0.0, -10.0, 0.0], "direction": [0.0, -1.0, 0.0], "radius": 0.05 });
        assert_eq!(pick(vec![cloud(Axes::Upright)], &down), Json::Null);
        let narrow = json!({ "origin": [0.0, -10.0, 0.0], "direction": [0.0, 1.0, 0.0] });
        assert_eq!(pick(vec![cloud(Axes::Upright)], &narrow), Json::Null);
        let (points, from, to) =
            (vec![x(9.0), x(0.1), x(8.0)], vec![x(5.0), x(6.0)], vec![x(7.0), x(0.05)]);
        let axes = Axes::Upright;
        let lines =
            Layer::Lines(Lines { points: points.into(), chains: vec![vec![0, 1, 7]], axes });
        let arrows = Layer::Arrows(Arrows { from: from.into(), to: to.into(), axes });
        let found = pick(vec![lines.clone()], &up);
        assert_eq!((&found["kind"], &found["vertex"]), (&json!("lines"), &json!(1)));
        let found = pick(vec![lines, arrows], &up);
        assert_eq!((&found["kind"], &found["vertex"]), (&json!("arrows"), &json!(1)));
        for wrong in [[0.0; 3], [1e308, 1e308, 0.0]] {
            let sight = json!({ "origin": [0.0, -10.0, 0.0], "direction": wrong, "radius": 0.05 });
            assert_eq!(pick(vec![cloud(axes)], &sight), Json::Null);
        }
    }

    #[test]
    fn coordinates_are_converted_to_the_axes_of_the_value() {
        fn place(axes: Axes) -> Point3<f64> {
            match axes {
                Axes::Upright => Point3::new(1.0, 2.0, 3.0),
                Axes::Sensor => Point3::new(1.0, -2.0, -3.0),
            }
        }
        let both = [Axes::Upright, Axes::Sensor];
        for (first, second) in both.into_iter().flat_map(|a| both.map(|b| (a, b))) {
            let far = Points::new(vec![Point3::new(900.0, 0.0, 0.0)]).unwrap();
            let points = Points::new(vec![place(second)]).unwrap();
            let layers = vec![
                Layer::Points(Cloud { points: far, axes: first }),
                Layer::Points(Cloud { points, axes: second }),
            ];
            let at = place(first);
            let origin = [at.x, at.y, at.z - 1.0];
            let found = pick(layers, &json!({ "origin": origin, "direction": [0.0, 0.0, 1.0] }));
            assert_eq!(found["at"], json!([at.x, at.y, at.z]), "{first:?} {second:?}");
        }
    }

    #[test]
    fn a_textured_face_has_a_texel_and_its_color() {
        let square = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
        let corners = square.map(|[x, y]| Point3::new(x, y, 0.0)).to_vec();
        let mesh = Mesh::new(corners, Faces::polygons(&[4], vec![0, 1, 2, 3]).unwrap()).unwrap();
        let pixels = (0..32).map(|k| [k, 2 * k, 7]).collect::<Vec<_>>();
        let texture = maquette_value::Image::new(8, 4, pixels).unwrap();
        fn uv(square: &[[f64; 2]; 4]) -> Attribute {
            Attribute::Pair(square.map(|[x, y]| [x / 4.0, y / 4.0]).to_vec().into())
        }
        let bare = mesh.with_texture(Some(texture));
        let by_vertex = bare.clone().with_vertex("uv", uv(&square)).unwrap();
        let by_corner = bare.clone().with_corner("uv", uv(&square)).unwrap();
        for mesh in [by_vertex, by_corner] {
            for (place, pixel) in [([1.2, 3.7], [2, 0]), ([0.1, 0.1], [0, 3]), ([3.9, 0.4], [7, 3])]
            {
                let sight = json!({ "origin": [place[0], place[1], 7.0], "direction": [0, 0, -1] });
                let found = pick(vec![Layer::Triangles(Box::new(mesh.clone()))], &sight);
                let level = (8 * pixel[1] + pixel[0]) as u8;
                assert_eq!(found["pixel"], json!(pixel), "{found}");
                assert_eq!(found["color"], in_hexadecimal([level, 2 * level, 7]), "{found}");
                assert_eq!(found["at"], json!([place[0], place[1], 0.0]), "{found}");
            }
        }
        // Without a camera pose the mesh does not show its picture, so it has no color.
        let sight = json!({ "origin": [1.0, 1.0, 7.0], "direction": [0, 0, -1] });
        assert_eq!(pick(vec![Layer::Triangles(Box::new(bare))], &sight)["color"], Json::Null);
    }

    #[test]
    fn a_face_hides_points_behind_it_and_has_attributes() {
        let corners = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
        let corners = corners.map(|[x, y]| Point3::new(x, y, 0.0)).to_vec();
        let mesh = Mesh::new(corners, Faces::polygons(&[4], vec![0, 1, 2, 3]).unwrap()).unwrap();
        let flags = Attribute::Flag(vec![0, 1, 1, 0].into());
        let colors = Attribute::Color(vec![[0, 0, 0], [1, 2, 3], [9, 9, 9], [195, 57, 35]].into());
        let mesh = mesh.with_vertex("filled", flags).unwrap().with_corner("color", colors).unwrap();
        let mesh = mesh.with_face("part", Attribute::Index(vec![5].into())).unwrap();
        let points = Points::new(vec![Point3::new(1.0, 3.0, -2.0)]).unwrap();
        let axes = Axes::Upright;
        let layers = vec![Layer::Triangles(Box::new(mesh)), Layer::Points(Cloud { points, axes })];
        let found =
            pick(layers, &json!({ "origin": [1.0, 3.0, 7.0], "direction": [0.0, 0.0, -1.0] }));
        let expected = json!({
            "color": "#c33923", "pixel": null,
            "kind": "triangles", "face": 0, "at": [1.0, 3.0, 0.0], "vertex": 3, "vertex_at": [0.0, 4.0, 0.0],
            "attributes": { "filled": 0 }, "corner_attributes": { "color": "#c33923" }, "face_attributes": { "part": 5 },
        });
        assert_eq!(found, expected);
    }
}
