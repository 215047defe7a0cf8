//! STEP, the exchange format of CAD programs: a surface becomes one trimmed face of an open shell.
//!
//! ISO 10303-21 (the text) and 10303-214 (AUTOMOTIVE_DESIGN); entities of 10303-42. The face is bounded by the surface's own four edges. An
//! edge that is a single point is left out, and two equal edges become one seam. Lengths are in mm; numbers have 17 significant digits, so
//! they are read back exactly. The file has no time stamp, so equal surfaces give equal bytes.

use std::fmt::Write;

use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{KnotVector, Surface};
use nalgebra::{Point3, Vector4};

use super::upright::upright_surface;

/// Writes a rational B-spline surface.
pub(super) struct SurfaceStep;

impl FileFormat for SurfaceStep {
    type Value = Surface;
    const EXTENSION: &'static str = "step";

    fn write(surface: &Surface, name: &str) -> Result<Vec<NewFile>, Error> {
        Ok(NewFile::single(name, encode(&*upright_surface(surface)?)?))
    }
}

/// Two end points of edges count as equal if they are closer than this fraction of the control net's size. This allows for rounding.
const RELATIVE_TOLERANCE: f64 = 1e-9;

fn encode(surface: &Surface) -> Result<Vec<u8>, Error> {
    let columns = surface.net().columns();
    if let Some(zero) = surface.net().weights().iter().position(|&weight| weight == 0.0) {
        let (row, column) = (zero / columns, zero % columns);
        bail!("the weight of control point ({row}, {column}) is 0, which STEP does not allow");
    }
    let mut file = File::default();
    let context = file.preamble();
    let bounds = Bounds::new(surface)?;
    let geometry = file.surface(surface, [bounds.closed_u(), bounds.closed_v()]);
    let outline = bounds.write(&mut file);
    let bound = file.add(&format!("FACE_OUTER_BOUND('',#{outline},.T.)"));
    let face = file.add(&format!("ADVANCED_FACE('',(#{bound}),#{geometry},.T.)"));
    let shell = file.add(&format!("OPEN_SHELL('',(#{face}))"));
    let model = file.add(&format!("SHELL_BASED_SURFACE_MODEL('',(#{shell}))"));
    let frame = file.frame();
    let shape = file.add(&format!(
        "MANIFOLD_SURFACE_SHAPE_REPRESENTATION('',(#{frame},#{model}),#{})",
        context.units
    ));
    file.add(&format!("SHAPE_DEFINITION_REPRESENTATION(#{},#{shape})", context.definition));
    Ok(file.finish())
}

/// The entities of the data section. They are numbered from 1.
#[derive(Default)]
struct File {
    lines: Vec<String>,
}

/// The numbers of the entities to which the shape refers.
struct ProductContext {
    /// The number of the entity with the units and the accuracy.
    units: usize,
    /// The number of the product definition.
    definition: usize,
}

impl File {
    /// Adds an entity. Returns its number.
    fn add(&mut self, entity: &str) -> usize {
        self.lines.push(entity.to_owned());
        self.lines.len()
    }

    fn finish(self) -> Vec<u8> {
        let mut text = String::from(
            "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION(('surface'),'2;1');\n\
             FILE_NAME('','1970-01-01T00:00:00',(''),(''),'maquette','maquette','');\n\
             FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));\nENDSEC;\nDATA;\n",
        );
        for (line, number) in self.lines.iter().zip(1..) {
            let _ = writeln!(text, "#{number}={line};");
        }
        text.push_str("ENDSEC;\nEND-ISO-10303-21;\n");
        text.into_bytes()
    }

    /// Adds a product with a shape, and the units of the shape: mm and radians.
    fn preamble(&mut self) -> ProductContext {
        let application = self.add("APPLICATION_CONTEXT('automotive design')");
        self.add(&format!(
            "APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,#{application})"
        ));
        let context = self.add(&format!("PRODUCT_CONTEXT('',#{application},'mechanical')"));
        let product = self.add(&format!("PRODUCT('surface','surface','',(#{context}))"));
        self.add(&format!("PRODUCT_RELATED_PRODUCT_CATEGORY('part',$,(#{product}))"));
        let formation = self.add(&format!("PRODUCT_DEFINITION_FORMATION('','',#{product})"));
        let design = self
            .add(&format!("PRODUCT_DEFINITION_CONTEXT('part definition',#{application},'design')"));
        let product = self.add(&format!("PRODUCT_DEFINITION('design','',#{formation},#{design})"));
        let definition = self.add(&format!("PRODUCT_DEFINITION_SHAPE('','',#{product})"));
        let length = self.add("(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.))");
        let angle = self.add("(NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.))");
        let solid = self.add("(NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT())");
        let exactness = self.add(&format!(
            "UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-06),#{length},'distance_accuracy_value','')"
        ));
        let units = self.add(&format!(
            "(GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#{exactness})) \
             GLOBAL_UNIT_ASSIGNED_CONTEXT((#{length},#{angle},#{solid})) REPRESENTATION_CONTEXT('',''))"
        ));
        ProductContext { units, definition }
    }

    /// Adds the coordinate axes of the shape.
    fn frame(&mut self) -> usize {
        let origin = self.point(&Point3::origin());
        let z = self.add("DIRECTION('',(0.,0.,1.))");
        let x = self.add("DIRECTION('',(1.,0.,0.))");
        self.add(&format!("AXIS2_PLACEMENT_3D('',#{origin},#{z},#{x})"))
    }

    fn point(&mut self, point: &Point3<f64>) -> usize {
        self.add(&format!("CARTESIAN_POINT('',({}))", reals(point.iter())))
    }

    fn surface(&mut self, surface: &Surface, closed: [bool; 2]) -> usize {
        let net = surface.net();
        let rows = net.points().chunks(net.columns()).map(|row| {
            let row: Vec<_> = row.iter().map(|point| format!("#{}", self.point(point))).collect();
            format!("({})", row.join(","))
        });
        let points = rows.collect::<Vec<_>>().join(",");
        let (u, v) = (surface.u(), surface.v());
        let degrees = format!("{},{}", u.degree(), v.degree());
        let [(times_u, knots_u), (times_v, knots_v)] = [u, v].map(multiplicities);
        let [closed_u, closed_v] = closed.map(|closed| if closed { ".T." } else { ".F." });
        let shape = format!("{degrees},({points}),.UNSPECIFIED.,{closed_u},{closed_v},.U.");
        let knots = format!("({times_u}),({times_v}),({knots_u}),({knots_v}),.UNSPECIFIED.");
        if net.weights().iter().all(|&weight| weight == net.weights()[0]) {
            return self.add(&format!("B_SPLINE_SURFACE_WITH_KNOTS('',{shape},{knots})"));
        }
        let rows = net.weights().chunks(net.columns()).map(|row| format!("({})", reals(row)));
        let weights = rows.collect::<Vec<_>>().join(",");
        self.add(&format!(
            "(BOUNDED_SURFACE() B_SPLINE_SURFACE({shape}) B_SPLINE_SURFACE_WITH_KNOTS({knots}) \
             GEOMETRIC_REPRESENTATION_ITEM() RATIONAL_B_SPLINE_SURFACE(({weights})) \
             REPRESENTATION_ITEM('') SURFACE())"
        ))
    }

    fn curve(&mut self, side: &Side, knots: &KnotVector) -> usize {
        let points =
            side.points.iter().map(|point| format!("#{}", self.point(point))).collect::<Vec<_>>();
        let (times, values) = multiplicities(knots);
        let shape = format!("{},({}),.UNSPECIFIED.,.F.,.U.", knots.degree(), points.join(","));
        let knots = format!("({times}),({values}),.UNSPECIFIED.");
        if side.weights.iter().all(|&weight| weight == side.weights[0]) {
            return self.add(&format!("B_SPLINE_CURVE_WITH_KNOTS('',{shape},{knots})"));
        }
        let weights = reals(&side.weights);
        self.add(&format!(
            "(BOUNDED_CURVE() B_SPLINE_CURVE({shape}) B_SPLINE_CURVE_WITH_KNOTS({knots}) CURVE() \
             GEOMETRIC_REPRESENTATION_ITEM() RATIONAL_B_SPLINE_CURVE(({weights})) \
             REPRESENTATION_ITEM(''))"
        ))
    }
}

/// Formats numbers for STEP, with 17 significant digits.
fn reals<'a>(numbers: impl IntoIterator<Item = &'a f64>) -> String {
    numbers.into_iter().map(|number| format!("{number:.16E}")).collect::<Vec<_>>().join(",")
}

/// Returns the multiplicities of the distinct knots, and the distinct knots, both as text.
fn multiplicities(knots: &KnotVector) -> (String, String) {
    let runs: Vec<&[f64]> = knots.knots().chunk_by(|a, b| a == b).collect();
    let times: Vec<_> = runs.iter().map(|run| run.len().to_string()).collect();
    (times.join(","), reals(runs.iter().map(|run| &run[0])))
}

/// A boundary curve of the surface, at one end of the u or v domain.
struct Side {
    points: Vec<Point3<f64>>,
    weights: Vec<f64>,
    /// The first and the last point of the curve. They equal the first and the last control point only if the end knots are repeated.
    ends: [Point3<f64>; 2],
}

/// The four boundary curves of a surface.
struct Bounds<'a> {
    surface: &'a Surface,
    low_v: Side,
    high_v: Side,
    low_u: Side,
    high_u: Side,
    /// The maximum distance between points that count as equal.
    tolerance: f64,
}

impl<'a> Bounds<'a> {
    fn new(surface: &'a Surface) -> Result<Self, Error> {
        let net = surface.net();
        let control = |row: usize, column: usize| {
            let index = row * net.columns() + column;
            let weight = net.weights()[index];
            (net.points()[index].coords * weight).push(weight)
        };
        let (u, v) = (surface.u(), surface.v());
        let ((low_u, high_u), (low_v, high_v)) = (u.domain(), v.domain());
        // The curve along u at a fixed v has one control point per row; the curve along v at a fixed u has one per column.
        let along_u = |at| {
            let ends = [surface.point(low_u, at), surface.point(high_u, at)];
            side(net.rows(), v.basis(at), control, ends)
        };
        let along_v = |at| {
            let ends = [surface.point(at, low_v), surface.point(at, high_v)];
            side(net.columns(), u.basis(at), |column, row| control(row, column), ends)
        };
        let size = net.points().iter().map(|point| (point - net.points()[0]).norm());
        Ok(Self {
            low_v: along_u(low_v)?,
            high_v: along_u(high_v)?,
            low_u: along_v(low_u)?,
            high_u: along_v(high_u)?,
            tolerance: RELATIVE_TOLERANCE * size.fold(0.0, f64::max),
            surface,
        })
    }

    fn closed_u(&self) -> bool {
        self.are_equal(&self.low_u, &self.high_u)
    }

    fn closed_v(&self) -> bool {
        self.are_equal(&self.low_v, &self.high_v)
    }

    /// Adds the loop of edges, which is counter-clockwise in (u, v).
    fn write(&self, file: &mut File) -> usize {
        let corners = [self.low_v.ends, self.high_v.ends].concat();
        let mut vertices = [0; 4];
        for k in 0..4 {
            let twin = (0..k).find(|&other| self.is_same_point(&corners[other], &corners[k]));
            vertices[k] = twin.map(|twin| vertices[twin]).unwrap_or_else(|| {
                let point = file.point(&corners[k]);
                file.add(&format!("VERTEX_POINT('',#{point})"))
            });
        }
        let [a, b, c, d] = vertices;
        let (u, v) = (self.surface.u(), self.surface.v());
        let low_v = self.edge(file, &self.low_v, u, [a, b]);
        let low_u = self.edge(file, &self.low_u, v, [a, c]);
        let mut other = |closed, edge, side, knots, ends| {
            if closed { edge } else { self.edge(file, side, knots, ends) }
        };
        let high_v = other(self.closed_v(), low_v, &self.high_v, u, [c, d]);
        let high_u = other(self.closed_u(), low_u, &self.high_u, v, [b, d]);
        let round = [(low_v, ".T."), (high_u, ".T."), (high_v, ".F."), (low_u, ".F.")];
        let mut edges = Vec::new();
        for (edge, sense) in round {
            let Some(edge) = edge else { continue };
            let oriented = file.add(&format!("ORIENTED_EDGE('',*,*,#{edge},{sense})"));
            edges.push(format!("#{oriented}"));
        }
        match edges.is_empty() {
            true => file.add(&format!("VERTEX_LOOP('',#{a})")),
            false => file.add(&format!("EDGE_LOOP('',({}))", edges.join(","))),
        }
    }

    /// Adds an edge between two vertices. Returns `None` for a boundary curve that is a single point.
    fn edge(
        &self,
        file: &mut File,
        side: &Side,
        knots: &KnotVector,
        [start, end]: [usize; 2],
    ) -> Option<usize> {
        if side.points.iter().all(|point| self.is_same_point(point, &side.points[0])) {
            return None;
        }
        let curve = file.curve(side, knots);
        Some(file.add(&format!("EDGE_CURVE('',#{start},#{end},#{curve},.T.)")))
    }

    fn are_equal(&self, a: &Side, b: &Side) -> bool {
        a.weights == b.weights
            && a.points.iter().zip(&b.points).all(|(a, b)| self.is_same_point(a, b))
    }

    fn is_same_point(&self, a: &Point3<f64>, b: &Point3<f64>) -> bool {
        (a - b).norm() <= self.tolerance
    }
}

/// Computes a boundary curve from the control points (w x, w y, w z, w). Each of its control points is a sum over a line of control points,
/// weighted by the basis functions of the other direction.
fn side(
    lines: usize,
    (first, values): (usize, Vec<f64>),
    control: impl Fn(usize, usize) -> Vector4<f64>,
    ends: [Point3<f64>; 2],
) -> Result<Side, Error> {
    let (points, weights): (Vec<_>, Vec<_>) = (0..lines)
        .map(|line| {
            let terms = values.iter().zip(first..).filter(|(value, _)| **value != 0.0);
            let sum: Vector4<f64> =
                terms.map(|(&value, across)| control(line, across) * value).sum();
            (Point3::from(sum.xyz() / sum.w), sum.w)
        })
        .unzip();
    if points.iter().chain(&ends).all(|point| point.coords.iter().all(|x| x.is_finite())) {
        Ok(Side { points, weights, ends })
    } else {
        bail!("the surface is too large: a point of its edges is not finite")
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::ControlNet;

    use super::*;

    fn text(surface: &Surface) -> String {
        String::from_utf8(encode(surface).unwrap()).unwrap()
    }

    /// Creates a patch of 3 x 4 control points, with the given weights or with weights 1.
    fn patch(weights: Option<Vec<f64>>) -> Surface {
        let net = ControlNet::new(
            3,
            4,
            (0..12)
                .map(|k: usize| Point3::new((k / 4) as f64, (k % 4) as f64 / 3.0, 0.1 * k as f64))
                .collect::<Vec<_>>(),
        )
        .unwrap();
        let net = net.with_weights(weights.unwrap_or(vec![1.0; 12])).unwrap();
        let u = KnotVector::uniform(3, 3).unwrap();
        Surface::new(net, u, KnotVector::uniform(4, 3).unwrap()).unwrap()
    }

    fn count(text: &str, entity: &str) -> usize {
        text.matches(&format!("={entity}(")).count()
    }

    #[test]
    fn a_patch_is_a_face_with_four_edges() {
        let text = text(&patch(None));
        assert_eq!(count(&text, "B_SPLINE_SURFACE_WITH_KNOTS"), 1);
        assert_eq!([count(&text, "VERTEX_POINT"), count(&text, "EDGE_CURVE")], [4, 4]);
        assert_eq!([count(&text, "ORIENTED_EDGE"), count(&text, "ADVANCED_FACE")], [4, 1]);
        assert!(text.contains(",2,2,((#"));
        let knots = "(3,3),(3,1,3),(0.0000000000000000E0,1.0000000000000000E0),";
        assert!(text.contains(knots), "{text}");
        // The number is 1/3 with all its digits.
        assert!(text.contains("3.3333333333333331E-1"));
    }

    #[test]
    fn every_reference_is_to_an_earlier_entity() {
        let text = text(&patch(Some((1..=12).map(f64::from).collect())));
        assert!(
            text.contains("RATIONAL_B_SPLINE_SURFACE(((1.0000000000000000E0,2.0000000000000000E0,")
        );
        let lines = text.lines().filter(|line| line.starts_with('#'));
        for (line, expected) in lines.zip(1..) {
            let mut numbers = line.split('#').skip(1).map(|part| {
                let end = part.find(|c: char| !c.is_ascii_digit()).unwrap();
                part[..end].parse::<usize>().unwrap()
            });
            assert_eq!(numbers.next(), Some(expected));
            assert!(numbers.all(|number| number < expected), "{line}");
        }
    }

    #[test]
    fn a_cylinder_has_a_seam_and_a_cone_no_edge_at_its_tip() {
        let s = 0.5f64.sqrt();
        let square = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)];
        fn surface(tip: f64, square: &[(i32, i32); 9], s: f64) -> String {
            fn ring(radius: f64, z: f64, square: &[(i32, i32); 9]) -> [Point3<f64>; 9] {
                square.map(|(x, y)| Point3::new(radius * f64::from(x), radius * f64::from(y), z))
            }
            let points = [ring(1.0, 0.0, square), ring(tip, 5.0, square)].concat();
            let weights = (0..18).map(|k| if k % 9 % 2 == 0 { 1.0 } else { s }).collect();
            let net = ControlNet::new(2, 9, points).unwrap().with_weights(weights).unwrap();
            let along = KnotVector::uniform(2, 2).unwrap();
            text(&Surface::new(net, along, KnotVector::cylinder()).unwrap())
        }
        let cylinder = surface(1.0, &square, s);
        assert_eq!([count(&cylinder, "VERTEX_POINT"), count(&cylinder, "EDGE_CURVE")], [2, 3]);
        assert_eq!(count(&cylinder, "ORIENTED_EDGE"), 4);
        let cone = surface(0.0, &square, s);
        assert_eq!([count(&cone, "VERTEX_POINT"), count(&cone, "EDGE_CURVE")], [2, 2]);
        assert_eq!(count(&cone, "ORIENTED_EDGE"), 3);
    }

    #[test]
    fn a_zero_weight_is_rejected() {
        let mut weights = vec![1.0; 12];
        weights[6] = 0.0;
        let error = encode(&patch(Some(weights))).unwrap_err().to_string();
        assert_eq!(error, "the weight of control point (1, 2) is 0, which STEP does not allow");
    }
}
