//! Values that are allowed, and hard to treat: empty, tiny, degenerate, enormous.

use nalgebra::{Point3, Vector3};

use crate::value::{
    AnyValue, ControlNet, Curve, Direction, Faces, Field, Handle, HandleSpace, Handles, Image,
    KnotVector, Labels, Mask, Mesh, Points, RangeImage, Region, Surface, Trace, TraceStep,
};

/// Hostile values of the type of that name; none for a type that the engine does not know.
pub(super) fn values(kind: &str) -> Vec<AnyValue> {
    match kind {
        "Image" => images().into_iter().map(AnyValue::new).collect(),
        "Mask" => masks().into_iter().map(AnyValue::new).collect(),
        "Field" => fields().into_iter().map(AnyValue::new).collect(),
        "Labels" => labels().into_iter().map(AnyValue::new).collect(),
        "RangeImage" => ranges().into_iter().map(AnyValue::new).collect(),
        "Region" => regions().into_iter().map(AnyValue::new).collect(),
        "Direction" => {
            let direction = Direction::mean(Vector3::new(0.0, 1e-5, 0.0));
            direction.ok().into_iter().map(AnyValue::new).collect()
        }
        "ControlNet" => nets().into_iter().map(AnyValue::new).collect(),
        "KnotVector" => knots().into_iter().map(AnyValue::new).collect(),
        "Surface" => surfaces().into_iter().map(AnyValue::new).collect(),
        "Curve" => curves().into_iter().map(AnyValue::new).collect(),
        "Points" => points().into_iter().map(AnyValue::new).collect(),
        "Trace" => traces().into_iter().map(AnyValue::new).collect(),
        "Handles" => handles().into_iter().map(AnyValue::new).collect(),
        "Mesh" => meshes().into_iter().map(AnyValue::new).collect(),
        _ => Vec::new(),
    }
}

/// Sizes that loops forget: nothing, one pixel, one row, one column.
const SIZES: [[usize; 2]; 5] = [[0, 0], [1, 1], [7, 1], [1, 7], [3, 0]];

fn images() -> Vec<Image> {
    let image =
        |[width, height]: [usize; 2]| Image::new(width, height, vec![[9, 8, 7]; width * height]);
    SIZES.into_iter().filter_map(|size| image(size).ok()).collect()
}

fn masks() -> Vec<Mask> {
    let mask = |[width, height]: [usize; 2], inside| {
        Mask::new(width, height, vec![inside; width * height])
    };
    SIZES.into_iter().flat_map(|size| [mask(size, 0), mask(size, 1)]).flatten().collect()
}

fn fields() -> Vec<Field> {
    let field = |[width, height]: [usize; 2], x| Field::new(width, height, vec![x; width * height]);
    let fields = SIZES
        .into_iter()
        .flat_map(|size| [f32::NAN, f32::INFINITY, 0.0, 1e38].map(|x| field(size, x)));
    fields.flatten().collect()
}

fn labels() -> Vec<Labels> {
    let labels = |[width, height]: [usize; 2], label| {
        Labels::new(width, height, vec![label; width * height])
    };
    SIZES.into_iter().flat_map(|size| [labels(size, 0), labels(size, u32::MAX)]).flatten().collect()
}

/// Points that coincide, lie on a line, are enormous, lie behind the sensor or in it, or are missing.
fn clouds(count: usize) -> Vec<Vec<Point3<f64>>> {
    let of = |point: fn(f64) -> Point3<f64>| (0..count).map(|k| point(k as f64)).collect();
    vec![
        of(|_| Point3::new(1.0, 2.0, 3.0)),
        of(|k| Point3::new(k, 0.0, 100.0)),
        of(|k| Point3::new(1e300 * (k - 1.0), 1e300, 1e300)),
        of(|k| Point3::new(k, k * k, -5.0)),
        of(|_| Point3::origin()),
        of(|k| Point3::new(k * 1e-300, 1e-300, 1e-300)),
        of(|_| Point3::new(f64::NAN, 0.0, 0.0)),
        of(|k| {
            if k % 2.0 == 0.0 { Point3::new(k, 1.0, 50.0) } else { Point3::new(f64::NAN, 0.0, 0.0) }
        }),
    ]
}

fn ranges() -> Vec<RangeImage> {
    let sizes = SIZES.into_iter().chain([[3, 3], [8, 5]]);
    let ranges = sizes.flat_map(|[width, height]| {
        clouds(width * height).into_iter().map(move |points| RangeImage::new(width, height, points))
    });
    ranges.flatten().collect()
}

fn regions() -> Vec<Region> {
    let sizes = [[1, 1], [7, 1], [1, 7], [3, 3], [400, 300]];
    let regions = sizes.into_iter().flat_map(|[width, height]| {
        let count = (width * height).min(9);
        clouds(count).into_iter().map(move |points| {
            let cells = (0..count as u32).collect();
            Region::new(width, height, cells, points, vec![0; count], Vec::new())
        })
    });
    regions.flatten().collect()
}

fn nets() -> Vec<ControlNet> {
    let sizes = [[1, 1], [1, 4], [2, 2], [3, 3], [5, 9]];
    let nets = sizes.into_iter().flat_map(|[rows, columns]| {
        clouds(rows * columns).into_iter().map(move |points| ControlNet::new(rows, columns, points))
    });
    nets.flatten().collect()
}

fn knots() -> Vec<KnotVector> {
    let knots = [
        KnotVector::new(1, vec![0.0, 0.0, 1.0, 1.0]),
        KnotVector::new(2, vec![-1e300, -1e300, 0.0, 1e300, 1e300, 1e300]),
        KnotVector::new(1, vec![0.0, 0.0, 1e-300, 1e-300]),
        KnotVector::new(9, (0..20).map(f64::from).collect()),
    ];
    knots.into_iter().flatten().collect()
}

fn surfaces() -> Vec<Surface> {
    let knots = || KnotVector::new(2, vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
    let surfaces = clouds(9).into_iter().map(|points| {
        let net = ControlNet::new(3, 3, points).ok()?;
        Surface::new(net, knots().ok()?, knots().ok()?).ok()
    });
    surfaces.flatten().collect()
}

fn curves() -> Vec<Curve> {
    let polylines = [2, 3, 7]
        .into_iter()
        .flat_map(clouds)
        .flat_map(|points| [Curve::polyline(points.clone(), false), Curve::polyline(points, true)]);
    let knots = || KnotVector::new(2, vec![0.0, 0.0, 0.0, 1e-300, 1.0, 1.0, 1.0]);
    let splines = clouds(4).into_iter().flat_map(|points| {
        [vec![1.0; 4], vec![1e-300, 1.0, 1e300, 1.0]]
            .map(|weights| Curve::rational(points.clone(), weights, knots().ok()?).ok())
    });
    polylines.map(Result::ok).chain(splines).flatten().collect()
}

fn points() -> Vec<Points> {
    [0, 1, 2, 9].into_iter().flat_map(clouds).flat_map(Points::new).collect()
}

fn traces() -> Vec<Trace> {
    let step = |iteration, max| TraceStep { iteration, max, rms: 0.0 };
    let steps = [
        vec![],
        vec![step(u64::MAX, f64::INFINITY)],
        vec![step(0, 0.0), step(1, 1e300), step(1 << 60, 1e-300)],
    ];
    steps.into_iter().flat_map(Trace::new).collect()
}

/// None, at one place, far away, of enormous and of vanishing reach and weight, and many at almost one place.
fn handles() -> Vec<Handles> {
    let lists = [0, 1, 2, 9].into_iter().flat_map(clouds).flat_map(|points| {
        [(1.0, 1.0), (1e-300, 1e300), (1e300, 1e-300), (1e-5, 1.0)].map(|(sigma, weight)| {
            let handle = |(k, point): (usize, &Point3<f64>)| {
                let to = point + Vector3::new(0.0, k as f64, 0.0);
                Handle {
                    at: (*point).into(),
                    to: (k % 2 == 0).then(|| to.into()),
                    sigma: (k % 3 != 0).then_some([sigma, 1.0, 2.0 * sigma]),
                    weight,
                }
            };
            Vec::from_iter(points.iter().enumerate().map(handle))
        })
    });
    let spaces = [HandleSpace::Box, HandleSpace::Cube, HandleSpace::World];
    lists.flat_map(|list| spaces.map(|space| Handles::new(space, &list))).flatten().collect()
}

fn meshes() -> Vec<Mesh> {
    let faces: [&[[u32; 3]]; 5] = [
        &[],
        &[[0, 1, 2]],
        // Three faces at an edge.
        &[[0, 1, 2], [1, 0, 3], [0, 1, 4]],
        // The same face twice, and turned round.
        &[[0, 1, 2], [0, 1, 2], [2, 1, 0]],
        // Two faces that share one vertex alone.
        &[[0, 1, 2], [2, 3, 4]],
    ];
    let meshes = faces.into_iter().flat_map(|faces| {
        clouds(5).into_iter().map(move |points| Mesh::new(points, Faces::triangles(faces.to_vec())))
    });
    let polygon = Faces::polygons(&[5], vec![0, 1, 2, 3, 4]);
    let polygon = polygon.into_iter().flat_map(|faces| Mesh::new(vec![Point3::origin(); 5], faces));
    let nothing = Mesh::new(Vec::new(), Faces::triangles(Vec::new()));
    meshes.flatten().chain(polygon).chain(nothing).collect()
}
