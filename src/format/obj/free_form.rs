//! Writes curves and surfaces without loss: polylines as `l`, B-splines as `curv` and `surf`, with all digits.

use std::fmt::Write;

use maquette_node::importers::{FileReader, InputFile};
use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::error::Error;
use maquette_value::{Curve, KnotVector, Surface};
use nalgebra::Point3;

use crate::upright::upright_surface;

/// Writes a polyline as a line element, or a B-spline as a free-form curve.
pub(crate) struct CurveObj;

impl FileFormat for CurveObj {
    type Value = Curve;
    const EXTENSION: &'static str = "obj";

    fn write(curve: &Curve, name: &str) -> Result<Vec<NewFile>, Error> {
        let count = curve.points().len();
        let Some((knots, weights)) = curve.knots().zip(curve.weights()) else {
            let mut text = vertices(curve.points().iter().map(|point| (point, None)));
            let first = if curve.is_closed() { Some(1) } else { None };
            text.push_str(&statement("l", (1..=count).chain(first)));
            return Ok(NewFile::single(name, text.into_bytes()));
        };
        let weights = weights.iter().map(Some);
        let mut text = vertices(curve.points().iter().zip(weights));
        let _ = writeln!(text, "cstype rat bspline\ndeg {}", knots.degree());
        let (start, end) = knots.domain();
        text.push_str(&statement(&format!("curv {start} {end}"), 1..=count));
        text.push_str(&parameters("u", knots));
        text.push_str("end\n");
        Ok(NewFile::single(name, text.into_bytes()))
    }
}

/// Writes a surface as a free-form surface. OBJ lists the control points row by row, with u changing fastest.
pub(crate) struct SurfaceObj;

impl FileFormat for SurfaceObj {
    type Value = Surface;
    const EXTENSION: &'static str = "obj";

    fn write(surface: &Surface, name: &str) -> Result<Vec<NewFile>, Error> {
        let surface = &*upright_surface(surface)?;
        let (net, u, v) = (surface.net(), surface.u(), surface.v());
        let weights = net.weights().iter().map(Some);
        let mut text = vertices(net.points().iter().zip(weights));
        let _ = writeln!(text, "cstype rat bspline\ndeg {} {}", u.degree(), v.degree());
        let ((u0, u1), (v0, v1)) = (u.domain(), v.domain());
        let (rows, columns) = (net.rows(), net.columns());
        let order =
            (0..columns).flat_map(|column| (0..rows).map(move |row| row * columns + column + 1));
        text.push_str(&statement(&format!("surf {u0} {u1} {v0} {v1}"), order));
        text.push_str(&parameters("u", u));
        text.push_str(&parameters("v", v));
        text.push_str("end\n");
        Ok(NewFile::single(name, text.into_bytes()))
    }
}

/// Formats the lines `v` of points, with the weights of the points if given.
fn vertices<'a>(points: impl Iterator<Item = (&'a Point3<f64>, Option<&'a f64>)>) -> String {
    let mut text = String::new();
    for (point, weight) in points {
        let _ = write!(text, "v {} {} {}", point.x, point.y, point.z);
        if let Some(weight) = weight {
            let _ = write!(text, " {weight}");
        }
        text.push('\n');
    }
    text
}

fn parameters(direction: &str, knots: &KnotVector) -> String {
    statement(&format!("parm {direction}"), knots.knots())
}

/// Formats a statement. It is continued in a new line after every twenty numbers, because some readers do not accept long lines.
fn statement(start: &str, numbers: impl IntoIterator<Item = impl std::fmt::Display>) -> String {
    let mut text = start.to_owned();
    for (k, number) in numbers.into_iter().enumerate() {
        text.push_str(if k > 0 && k % 20 == 0 { " \\\n  " } else { " " });
        let _ = write!(text, "{number}");
    }
    text.push('\n');
    text
}

impl FileReader for CurveObj {
    type Value = Curve;
    const EXTENSIONS: &'static [&'static str] = &["obj"];

    fn read(file: &InputFile<'_>) -> Result<Curve, Error> {
        super::read_curve(file.bytes())
    }
}

#[cfg(test)]
mod tests {
    use expect_test::expect;
    use maquette_value::ControlNet;

    use super::super::read_curve;
    use super::*;

    fn write_text<F: FileFormat>(value: &F::Value) -> String {
        String::from_utf8(F::write(value, "a.obj").unwrap().remove(0).bytes).unwrap()
    }

    #[test]
    fn a_written_curve_is_read_back() {
        let points: Vec<_> = (0..50)
            .map(|k| {
                let t = 0.1 * f64::from(k);
                Point3::new(libm::cos(t), libm::sin(t), t / 3.0)
            })
            .collect();
        let weights = (1..=50).map(|k| 1.0 / f64::from(k)).collect();
        let knots = KnotVector::uniform(50, 4).unwrap();
        let spline = Curve::rational(points.clone(), weights, knots).unwrap();
        let polylines =
            [true, false].map(|closed| Curve::polyline(points.clone(), closed).unwrap());
        for curve in polylines.into_iter().chain([spline]) {
            assert_eq!(read_curve(write_text::<CurveObj>(&curve).as_bytes()).unwrap(), curve);
        }
    }

    #[test]
    fn a_surface_lists_its_control_points_with_u_running_fastest() {
        let points: Vec<_> = (0..6).map(|k| Point3::new(f64::from(k), 0.5, 0.1)).collect();
        let net = ControlNet::new(2, 3, points).unwrap();
        let net = net.with_weights(vec![1., 0.5, 1., 1., 0.5, 1.]).unwrap();
        let u = KnotVector::uniform(2, 2).unwrap();
        let surface = Surface::new(net, u, KnotVector::uniform(3, 3).unwrap()).unwrap();
        expect![[r#"
            v 0 0.5 0.1 1
            v 1 0.5 0.1 0.5
            v 2 0.5 0.1 1
            v 3 0.5 0.1 1
            v 4 0.5 0.1 0.5
            v 5 0.5 0.1 1
            cstype rat bspline
            deg 1 2
            surf 0 1 0 1 1 4 2 5 3 6
            parm u 0 0 1 1
            parm v 0 0 0 1 1 1
            end
        "#]]
        .assert_eq(&write_text::<SurfaceObj>(&surface));
    }
}
