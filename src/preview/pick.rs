//! What of a value is under the pointer, where it lies in space.

use maquette_value::{
    AnyValue, Attribute, Attributes, Axes, Layer, Material, Mesh, RayHit, Rgb, TriangleTree, Wrap,
};
use nalgebra::{Point3, Vector3};
use serde::Deserialize;
use serde_json::{Map, Value as Json, json};

/// How far beside the ray a point may be if nothing else is said: a share of its distance.
const RADIUS: f64 = 0.01;

/// A ray from the eye through the pointer, in the value's axes.
#[derive(Clone, Debug, Deserialize)]
pub struct Sight {
    origin: [f64; 3],
    direction: [f64; 3],
    /// How far beside the ray a point may be: a share of its distance.
    radius: Option<f64>,
}

/// A value, so prepared that what is under the pointer is found fast. Its axes are those of its faces, or of its first layer if it has
/// none.
pub(super) struct Pickable {
    axes: Axes,
    layers: Vec<Layer>,
    /// Of each mesh among the layers.
    trees: Vec<TriangleTree>,
}

/// What was found.
struct Found<'a> {
    kind: &'static str,
    at: Point3<f64>,
    /// The number of the vertex or point, and where it is.
    vertex: (usize, Point3<f64>),
    axes: Axes,
    face: Option<u32>,
    /// The color that is seen there, and the pixel of the texture that has it.
    color: Option<(Rgb, Option<[usize; 2]>)>,
    /// Where they are told, the attributes, and of which element.
    attributes: Vec<(&'static str, &'a Attributes, usize)>,
}

impl Pickable {
    pub(super) fn new(value: &AnyValue) -> Self {
        let layers = value.show();
        let meshes = || layers.iter().filter_map(mesh_of);
        let first = meshes().next().map(axes_of_mesh);
        let axes = first.or_else(|| layers.iter().find_map(Layer::axes)).unwrap_or_default();
        let trees = meshes().map(TriangleTree::new).collect();
        Self { axes, layers, trees }
    }

    /// The first face that the ray meets, or else what of points, lines and arrows is nearest to it, in words for the page; nothing if
    /// there is nothing.
    pub(super) fn pick(&self, sight: &Sight) -> Option<Json> {
        let numbers = sight.origin.iter().chain(&sight.direction).chain(&sight.radius);
        if !numbers.into_iter().all(|number| number.is_finite()) {
            return None;
        }
        let found = self.face(sight).or_else(|| self.point(sight))?;
        let told =
            |place: Point3<f64>| Json::from(found.axes.turned(place, self.axes).coords.as_slice());
        let (vertex, vertex_at) = found.vertex;
        let mut fields = json!({
            "kind": found.kind,
            "at": told(found.at),
            "vertex": vertex,
            "vertex_at": told(vertex_at),
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

    fn face(&self, sight: &Sight) -> Option<Found<'_>> {
        let meshes = self.layers.iter().filter_map(mesh_of);
        let hits = meshes.zip(&self.trees).filter_map(|(mesh, tree)| {
            let (origin, direction) = self.ray(sight, axes_of_mesh(mesh));
            Some((mesh, tree.first_hit(origin, direction)?))
        });
        let (mesh, hit) = hits.reduce(|a, b| if b.1.along < a.1.along { b } else { a })?;
        let at = hit.place(mesh);
        let face = hit.face as usize;
        let first = mesh.faces().first_corner(face);
        let vertices = mesh.faces().face(face).iter().enumerate();
        fn place(vertex: u32, mesh: &Mesh) -> Point3<f64> {
            mesh.positions()[vertex as usize]
        }
        fn distance(vertex: u32, mesh: &Mesh, at: Point3<f64>) -> f64 {
            (place(vertex, mesh) - at).norm_squared()
        }
        let (corner, &vertex) = vertices
            .min_by(|(_, a), (_, b)| distance(**a, mesh, at).total_cmp(&distance(**b, mesh, at)))?;
        Some(Found {
            kind: "triangles",
            at,
            vertex: (vertex as usize, place(vertex, mesh)),
            axes: axes_of_mesh(mesh),
            face: Some(hit.face),
            color: color_at(mesh, &hit, first + corner, vertex as usize),
            attributes: vec![
                ("attributes", mesh.vertex(), vertex as usize),
                ("corner_attributes", mesh.corner(), first + corner),
                ("face_attributes", mesh.face(), face),
            ],
        })
    }

    /// What of points, of the corners of lines and of the ends of arrows is nearest to the ray, as its angle is seen from the origin.
    fn point(&self, sight: &Sight) -> Option<Found<'_>> {
        let mut best: Option<(f64, Found<'_>)> = None;
        for layer in &self.layers {
            let Some(axes) = layer.axes() else { continue };
            let cone = Cone::new(self.ray(sight, axes), sight.radius.unwrap_or(RADIUS))?;
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
                let found = Found { kind, at, vertex, axes, face: None, color, attributes };
                best = Some((off, found));
            }
        }
        best.map(|(_, found)| found)
    }

    /// The ray in the axes of a layer.
    fn ray(&self, sight: &Sight, axes: Axes) -> (Point3<f64>, Vector3<f64>) {
        fn turn(place: [f64; 3], axes: &Axes, self_axes: &Axes) -> Point3<f64> {
            self_axes.turned(place.into(), *axes)
        }
        (turn(sight.origin, &axes, &self.axes), turn(sight.direction, &axes, &self.axes).coords)
    }
}

/// What is near a ray, as seen from its origin.
struct Cone {
    origin: Point3<f64>,
    /// Of length 1.
    direction: Vector3<f64>,
    /// How far beside the ray a point may be: a share of its distance.
    radius: f64,
}

impl Cone {
    /// None if the direction leads nowhere.
    fn new((origin, direction): (Point3<f64>, Vector3<f64>), radius: f64) -> Option<Self> {
        // First by its largest number: the square of a huge one is infinite.
        let direction = (direction / direction.amax()).normalize();
        let is_one = direction.iter().all(|x| x.is_finite());
        is_one.then_some(Self { origin, direction, radius })
    }

    /// The place that is the fewest times its distance beside the ray, the first of several; and how many times.
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

/// The color of a mesh where a ray meets it, as `render` paints it: the texel, or else the color of the nearest corner or vertex.
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
        && let Some(texture) = material.shown()
    {
        let uv = [0, 1].map(|axis| {
            hit.shares().iter().zip(uv).map(|(share, uv)| share * uv[axis]).sum::<f64>()
        });
        let [u, v] = Wrap::uv(material.wrap(), uv);
        fn texel(share: f64, size: usize) -> usize {
            ((share * size as f64) as usize).min(size - 1)
        }
        let pixel = [texel(u, texture.width()), texel(1.0 - v, texture.height())];
        return Some((texture.at(pixel), Some(pixel)));
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

/// What the attributes of an element are, by name.
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
        let sight = Sight::deserialize(sight).unwrap();
        Pickable { axes, layers, trees }.pick(&sight).unwrap_or_default()
    }

    #[test]
    fn what_is_nearest_to_the_ray_is_found_among_points_lines_and_arrows() {
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
        // The one behind is as far beside the ray, and farther away.
        assert_eq!((&found["kind"], &found["vertex"]), (&json!("points"), &json!(2)), "{found}");
        assert_eq!(
            (&found["at"], &found["attributes"]),
            (&json!([0.2, 5.0, 0.0]), &json!({ "w": 3.0 }))
        );
        // Behind the eye is nothing, and nothing far beside.
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
    fn other_axes_are_turned_into_those_of_the_value() {
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
    fn a_textured_face_tells_the_pixel_of_its_texture_and_the_color_of_that() {
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
        // A picture that nobody knows the place of is not seen.
        let sight = json!({ "origin": [1.0, 1.0, 7.0], "direction": [0, 0, -1] });
        assert_eq!(pick(vec![Layer::Triangles(Box::new(bare))], &sight)["color"], Json::Null);
    }

    #[test]
    fn a_face_is_before_the_points_behind_it_and_tells_what_it_has() {
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
