//! Inputs of any size, and a use of each node.

use std::collections::BTreeMap;
use std::path::Path;

use maquette::value::{
    Attribute, ControlNet, Curve, Faces, Image, Mesh, Points, RangeImage, rng::Random,
};
use maquette::{AnyValue, CancelToken, Catalog, Evaluator, Graph, Options};
use nalgebra::Point3;

/// Values that are computed from others: the name, the output of the node, and the node.
const PREPARED: &[(&str, &str, &str)] = &[
    ("sheet", "", r#"Triangulate(range: "scan", grazing: 89)"#),
    ("moved-sheet", "", r#"Transform(mesh: "sheet", translate: (4, -3, 2), rotate: (1, 2, 3))"#),
    ("moved-ball", "", r#"Transform(mesh: "ball", translate: (31, 17, 5), rotate: (10, 20, 30))"#),
    ("valid", "", r#"Foreground(range: "scan", fill_holes: false, close: 0)"#),
    ("mask", "", r##"Threshold(image: "color", select: Near(color: "#c33923", distance: 30.0))"##),
    ("labels", "", r#"Label(mask: "mask")"#),
    ("region", "", r#"ExtractRegion(labels: "labels", range: "scan")"#),
    ("normal", "", r#"AverageNormal(region: "region", range: "scan")"#),
    ("lines", "mask", r#"Edges(image: "mask", high: Level(0.25))"#),
    ("region-net", "", r#"ControlNet(region: "region", range: "scan", method: Grid)"#),
    ("region-surface", "", r#"Nurbs(net: "region-net")"#),
    ("surface", "", r#"Nurbs(net: "net")"#),
    ("textured", "", r#"Texture(mesh: "sheet", image: "color")"#),
    ("handles", "", r#"Handles(mesh: "small-ball", on: Farthest(300), space: World)"#),
    ("alignment", "alignment", r#"Align(mesh: "small-ball", to: "small-ball")"#),
];

/// A use of each node.
pub(super) const NODES: &[&str] = &[
    r#"ReadImage(path: "color.png")"#,
    r#"PaintedMask(path: "color.png", image: "color")"#,
    r#"MaskShape(image: "color", shape: Ellipse(center: (100, 100), radii: (90, 80), angle: 20))"#,
    r##"Threshold(image: "color", select: Near(color: "#c33923", distance: 30.0), clean: 10)"##,
    r#"GrowRegion(image: "color", seeds: [(2, 2)], distance: 90.0)"#,
    r#"Edges(image: "color", blur: 8.0)"#,
    r#"Outline(mask: "mask")"#,
    r#"Thin(mask: "mask")"#,
    r#"Thin(mask: "mask", method: Ordered)"#,
    r#"FillContour(mask: "lines", close: 8)"#,
    r#"CombineMasks(a: "mask", b: "valid", mode: And)"#,
    r#"Label(mask: "valid")"#,
    r#"ReadCapture(color: "color.png", range: "scan.pcd")"#,
    r#"ReadRange(path: "scan.pcd")"#,
    r#"Denoise(range: "scan", iterations: 8)"#,
    r#"FillRange(range: "scan")"#,
    r#"Foreground(range: "scan")"#,
    r#"ExtractRegion(labels: "labels", range: "scan")"#,
    r#"AverageNormal(region: "region", range: "scan")"#,
    r#"Triangulate(range: "scan")"#,
    r#"ControlNet(region: "region", range: "scan", method: Harmonic)"#,
    r#"ControlNet(region: "region", range: "scan", method: Rows)"#,
    r#"OffsetNet(net: "region-net", normal: "normal", region: "region", steps: [(distance: 12.0)])"#,
    r#"PointNet(points: [[(0, 0, 0), (1, 0, 0)], [(0, 1, 0), (1, 1, 0)]])"#,
    r#"ReadNet(path: "net.json")"#,
    r#"Revolve(curve: "curve")"#,
    r#"Loft(curves: ["curve", "curve"])"#,
    r#"Weights(net: "net", all: 2.0)"#,
    r#"Knots(net: "net", along: V, kind: Chord)"#,
    r#"Nurbs(net: "net")"#,
    r#"FitSurface(net: "net")"#,
    r#"FitSurface(net: "net", method: Lspia(rows: 40, columns: 40, iterations: 1000))"#,
    r#"Tessellate(surface: "surface", u: SIDE, v: SIDE)"#,
    r#"Tessellate(surface: "surface", tolerance: 0.01)"#,
    r#"Blend(range: "scan", region: "region", surface: "region-surface")"#,
    r#"ReadCreases(mesh: "ball", path: "creases.json")"#,
    r#"Crease(mesh: "ball")"#,
    r#"Subdivide(mesh: "quarter-ball", scheme: Loop, levels: 1)"#,
    r#"Subdivide(mesh: "quarter-ball", scheme: CatmullClark, levels: 1, limit: true)"#,
    r#"Subdivide(mesh: "quarter-ball", scheme: DooSabin, levels: 1)"#,
    r#"Interpolate(mesh: "ball", scheme: Loop)"#,
    r#"Curvature(mesh: "ball")"#,
    r#"Curvature(mesh: "ball", method: Mesh)"#,
    r#"SubdivideCurve(curve: "short-curve", scheme: Chaikin, levels: 10)"#,
    r#"InterpolateCurve(curve: "curve", scheme: Cubic)"#,
    r#"InterpolateSurface(points: "net")"#,
    r#"Simplify(mesh: "ball")"#,
    r#"FitSubdivision(mesh: "small-ball", points: "ball")"#,
    r#"ReadHandles(path: "handles.csv")"#,
    r#"Handles(mesh: "ball", on: Farthest(2000))"#,
    r#"Ffd(mesh: "ball", layout: "handles", mode: Displacement, space: World, handles: [(at: (0, 0, 100), to: (0, 0, 105), sigma: (5, 5, 5))])"#,
    r#"GaussianSurface(u: SIDE, v: SIDE, points: [(at: (0, 0), to: (0, 0, 0)), (at: (0, 1), to: (0, 9, 0)), (at: (1, 0), to: (9, 0, 0))])"#,
    r#"Lattice(mesh: "ball")"#,
    r#"Tube(curve: "short-curve", radius: 0.1, sides: 256)"#,
    r#"FillHoles(mesh: "sheet", method: ThinPlate)"#,
    r#"ReadMesh(path: "ball.ply")"#,
    r#"ReadPoints(path: "points.xyz")"#,
    r#"ReadCurve(path: "curve.obj")"#,
    r#"Primitive(shape: Sphere(radius: 14, sides: SPHERE))"#,
    r#"Texture(mesh: "sheet", image: "color")"#,
    r#"Transform(mesh: "ball", rotate: (10, 20, 30))"#,
    r#"Orient(mesh: "ball")"#,
    r#"Merge(meshes: ["ball", "moved-ball"])"#,
    r#"Reconstruct(points: ["ball"])"#,
    r#"KeepCells(range: "scan", mask: "mask")"#,
    r#"Crop(mesh: "ball", within: Sphere(center: (0, 82, 0), radius: 46.0))"#,
    r#"Pieces(mesh: "ball")"#,
    r#"DominantPlane(mesh: "ball")"#,
    r#"Align(mesh: "moved-sheet", to: "sheet")"#,
    r#"AlignAll(scans: ["sheet", "moved-sheet"])"#,
    r#"MoveAligned(mesh: "ball", alignment: "alignment")"#,
    r#"Solid(mesh: "sheet")"#,
    r#"Shell(mesh: "sheet")"#,
    r#"Hollow(mesh: "ball")"#,
    r#"Boolean(mesh: "ball", with: ["moved-ball"])"#,
    r#"Remesh(mesh: "ball")"#,
    r#"Smooth(mesh: "ball")"#,
    r#"Weld(mesh: "ball", within: 0.001)"#,
    r#"RemoveOutliers(mesh: "ball")"#,
    r#"FlyingPixels(range: "scan")"#,
    r#"Unwrap(mesh: "ball")"#,
    r#"Bake(mesh: "sheet", captures: ["textured"], size: 1024)"#,
    r#"ColorsToTexture(mesh: "ball", size: 1024)"#,
    r#"TextureToColors(mesh: "textured")"#,
];

/// Inputs for meshes of `elements` triangles, and for as many elements of other kinds. They are computed when they are first used.
pub(super) struct Inputs {
    elements: usize,
    values: BTreeMap<String, AnyValue>,
}

impl Inputs {
    pub(super) fn new(elements: usize) -> Self {
        Self { elements, values: BTreeMap::new() }
    }

    /// Returns the text of a node with all numbers filled in.
    pub(super) fn complete(&self, node: &str) -> String {
        let around = 4 * (self.elements / 12).isqrt().clamp(1, 1024);
        let node = node.replace("SPHERE", &around.to_string());
        node.replace("SIDE", &side(self.elements).min(4000).to_string())
    }

    /// Returns the values that the node with the given text reads.
    pub(super) fn of_node(&mut self, node: &str) -> BTreeMap<String, AnyValue> {
        let words = node.split('"').skip(1).step_by(2);
        words.filter_map(|word| Some((word.to_owned(), self.find(word)?))).collect()
    }

    /// Forgets all values, to free their memory.
    pub(super) fn forget(&mut self) {
        self.values.clear();
    }

    fn find(&mut self, name: &str) -> Option<AnyValue> {
        if let Some(value) = self.values.get(name) {
            return Some(value.clone());
        }
        let n = self.elements;
        let value = match name {
            "ball" => AnyValue::new(ball(n)),
            "quarter-ball" => AnyValue::new(ball(n / 4)),
            "small-ball" => AnyValue::new(ball(n / 20)),
            "scan" => AnyValue::new(scan(side(n))),
            "color" => AnyValue::new(color(side(n))),
            "net" => AnyValue::new(net(side(n).min(2000))),
            "curve" => AnyValue::new(curve(n / 10)),
            "short-curve" => AnyValue::new(curve(n / 512 + 3)),
            "points" => AnyValue::new(Points::new(ball(n).positions().clone()).unwrap()),
            _ => {
                let (_, output, node) = PREPARED.iter().find(|(known, ..)| *known == name)?;
                let inputs = self.of_node(node);
                let catalog = Catalog::new(maquette_nodes::PACKS);
                let graph = graph(node, &inputs, Path::new("prepared.ron"), &catalog);
                let mut evaluator = Evaluator::new(2, 1 << 33).unwrap();
                let done = evaluator.evaluate_all_nodes(&graph, &(), &CancelToken::default());
                let value = done.find(&graph, "node", output);
                value.unwrap_or_else(|| panic!("{:?}", done.diagnostics())).clone()
            }
        };
        self.values.insert(name.to_owned(), value.clone());
        Some(value)
    }

    /// Writes the files that nodes with the given text read.
    pub(super) fn write_files(&mut self, node: &str, folder: &Path) {
        let files = node.split('"').skip(1).step_by(2).filter(|word| word.contains('.'));
        for name in files {
            let bytes = match name {
                "creases.json" => self.creases().into_bytes(),
                "handles.csv" => self.handles().into_bytes(),
                _ => {
                    let value = self.find(name.split('.').next().unwrap()).unwrap();
                    let catalog = Catalog::new(maquette_nodes::PACKS);
                    catalog.write(&value, name).unwrap().swap_remove(0).bytes
                }
            };
            std::fs::write(folder.join(name), bytes).unwrap();
        }
    }

    /// Creases along a tenth of the edges.
    fn creases(&mut self) -> String {
        let ball = self.find("ball").unwrap();
        let edges = ball.get::<Mesh>().unwrap().edges().vertices;
        let creases = edges.iter().step_by(10);
        let creases = creases.map(|[a, b]| format!(r#"{{"v":[{a},{b}],"sharpness":1}}"#));
        format!(r#"{{"edges":[{}]}}"#, creases.collect::<Vec<_>>().join(","))
    }

    /// A table of handles.
    fn handles(&self) -> String {
        let rows = (0..(self.elements / 10).min(2000)).map(|row| format!("{row},0,0,,,,,,,\n"));
        format!("x,y,z,to_x,to_y,to_z,sigma_x,sigma_y,sigma_z,weight\n{}", rows.collect::<String>())
    }
}

/// The graph that consists of the node `node` with these inputs.
pub(super) fn graph(
    node: &str,
    inputs: &BTreeMap<String, AnyValue>,
    path: &Path,
    catalog: &Catalog,
) -> Graph {
    let ports = inputs.iter().map(|(name, value)| format!("{name:?}: {}()", value.kind().name));
    let text = format!(
        "Graph(format: 1, inputs: {{ {} }}, nodes: {{ \"node\": {node} }}, outputs: {{}})",
        ports.collect::<Vec<_>>().join(", ")
    );
    let checked = Graph::load(path, catalog, &Options::default().with_text(path, text));
    let graph = checked.graph.unwrap_or_else(|| panic!("{node}: {:?}", checked.diagnostics));
    // Decoded values have no cached data, such as the edges of a mesh.
    let fresh = inputs.iter().map(|(name, value)| {
        let kept = value.encode();
        let value = value.kind().decode(&kept.bytes, &kept, value.hash()).unwrap();
        (name.clone(), value)
    });
    graph.with_inputs(&fresh.collect(), catalog).unwrap_or_else(|why| panic!("{node}: {why:?}"))
}

/// The number of cells per side of a square grid whose cells have this number of triangles.
fn side(triangles: usize) -> usize {
    (triangles / 2).isqrt()
}

/// A bumpy, noisy ball with a radius of about 100 mm, in colors.
fn ball(triangles: usize) -> Mesh {
    let rows = (triangles / 4).isqrt().max(3);
    let columns = 2 * rows;
    let mut rng = Random(7);
    let noise = 30.0 / rows as f64;
    let mut points = Vec::new();
    for row in 1..rows {
        let (sin, cos) = libm::sincos(std::f64::consts::PI * row as f64 / rows as f64);
        for column in 0..columns {
            let angle = std::f64::consts::TAU * column as f64 / columns as f64;
            let bumps = libm::sin(9.0 * angle) * libm::sin(11.0 * cos) * sin * sin;
            let radius = 100.0 + 3.0 * bumps + noise * (rng.even() - 0.5);
            let (y, x) = libm::sincos(angle);
            points.push(Point3::new(radius * sin * x, radius * cos, radius * sin * y));
        }
    }
    let [top, bottom] = [points.len() as u32, points.len() as u32 + 1];
    points.extend([Point3::new(0.0, 100.0, 0.0), Point3::new(0.0, -100.0, 0.0)]);
    let columns = columns as u32;
    let mut faces = Vec::new();
    for column in 0..columns {
        let next = (column + 1) % columns;
        faces.push([top, next, column]);
        for row in 0..rows as u32 - 2 {
            let [a, b] = [row * columns + column, row * columns + next];
            faces.extend([[a, b, b + columns], [a, b + columns, a + columns]]);
        }
        let last = (rows as u32 - 2) * columns;
        faces.push([bottom, last + column, last + next]);
    }
    let colors = points.iter().map(|p| [p.x, p.y, p.z].map(|x| (x + 128.0) as u8));
    let colors = Attribute::Color(colors.collect::<Vec<_>>().into());
    Mesh::new(points, Faces::triangles(faces)).unwrap().with_vertex("color", colors).unwrap()
}

/// A range image of a noisy relief with square holes.
fn scan(side: usize) -> RangeImage {
    let mut rng = Random(8);
    let cells = (0..side * side).map(|cell| {
        let [column, row] = [cell % side, cell / side];
        if column % 150 < 20 && row % 150 < 20 && column * row > 0 {
            return Point3::new(f64::NAN, f64::NAN, f64::NAN);
        }
        let [x, y] = [column as f64, row as f64];
        let relief = 20.0 * libm::sin(x / 60.0) * libm::sin(y / 50.0) + 40.0 * libm::sin(x / 300.0);
        Point3::new(x, y, 5000.0 + relief + 0.2 * rng.even())
    });
    RangeImage::new(side, side, cells.collect()).unwrap()
}

/// A picture of a red disk, which covers most of it, on a colored ground.
fn color(side: usize) -> Image {
    let mut rng = Random(9);
    let pixels = (0..side * side).map(|pixel| {
        let at = [pixel % side, pixel / side].map(|at| at.abs_diff(side / 2));
        let noise = (rng.even() * 12.0) as u8;
        match at[0] * at[0] + at[1] * at[1] < side * side / 6 {
            true => [190 + noise, 51 + noise, 35],
            false => [30 + noise, 108, 180 + noise],
        }
    });
    Image::new(side, side, pixels.collect::<Vec<_>>()).unwrap()
}

/// A wavy net of points.
fn net(side: usize) -> ControlNet {
    let points = (0..side * side).map(|at| {
        let [x, y] = [(at % side) as f64, (at / side) as f64];
        Point3::new(x, y, 5.0 * libm::sin(x / 7.0) * libm::sin(y / 9.0))
    });
    ControlNet::new(side, side, points.collect::<Vec<_>>()).unwrap()
}

/// A closed curve around the y axis at a distance of 20 to 30 mm.
fn curve(points: usize) -> Curve {
    let count = points as f64;
    let points = (0..points).map(|at| {
        let angle = std::f64::consts::TAU * at as f64 / count;
        let (sin, cos) = libm::sincos(angle);
        let radius = 4.0 + 0.02 * libm::sin(25.0 * angle);
        Point3::new(25.0 + radius * cos, radius * sin, 0.0)
    });
    Curve::polyline(points.collect::<Vec<_>>(), true).unwrap()
}
