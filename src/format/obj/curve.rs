//! Reads curves: polylines `l` and B-splines `curv`.

use maquette_syntax::bail;
use maquette_syntax::error::Error;
use maquette_value::{Curve, KnotVector};
use nalgebra::Point3;

use super::lines::{for_lines, numbers, resolve, without_comment};
use crate::{not_a_number, parse, words};

/// Reads the curve in an OBJ file. It is either a polyline or one free-form curve `curv` of type `bspline`, with or without `rat`. A
/// polyline may consist of several `l` elements that continue each other, and is closed if it returns to its first vertex.
///
/// Returns an error if a line is invalid, or the file has no curve or more than one.
pub fn read_curve(bytes: &[u8]) -> Result<Curve, Error> {
    let mut reader = Reader::default();
    for_lines(bytes, |text, line| reader.read_line(text, line))?;
    match (reader.spline, reader.chain) {
        (Some(spline), _) => spline.finish(&reader.vertices),
        (None, chain) => polyline(&reader.vertices, chain),
    }
}

/// A vertex and its weight.
type Vertex = (Point3<f64>, f64);

#[derive(Default)]
struct Reader {
    vertices: Vec<Vertex>,
    /// The vertices of the polyline that have been read so far.
    chain: Vec<u32>,
    rational: bool,
    kind: Option<Vec<u8>>,
    degree: Option<usize>,
    spline: Option<Spline>,
}

/// A free-form curve.
struct Spline {
    line: usize,
    degree: usize,
    rational: bool,
    ends: [f64; 2],
    control: Vec<u32>,
    knots: Vec<f64>,
}

impl Reader {
    fn read_line(&mut self, text: &[u8], line: usize) -> Result<(), Error> {
        let mut words = words(without_comment(text));
        match words.next() {
            Some(b"v") => {
                let ([x, y, z, weight, ..], count) = numbers::<5>(words, 3, line)?;
                let weight = if count == 4 { weight } else { 1.0 };
                self.vertices.push((Point3::new(x, y, z), weight));
            }
            Some(b"l") => self.read_chain(words, line)?,
            Some(b"cstype") => {
                let kinds: Vec<_> = words.collect();
                self.rational = kinds.first() == Some(&&b"rat"[..]);
                self.kind = kinds.last().map(|kind| kind.to_vec());
            }
            Some(b"deg") => {
                let word = words.next().unwrap_or_default();
                self.degree = Some(parse(word).ok_or_else(|| not_a_number(line, word))?);
            }
            Some(b"curv") => self.read_spline(words, line)?,
            Some(b"parm") => {
                if let (Some(b"u"), Some(spline)) = (words.next(), &mut self.spline) {
                    for word in words {
                        spline.knots.push(parse(word).ok_or_else(|| not_a_number(line, word))?);
                    }
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Returns the index of a vertex, from 0. Text after a `/` is ignored.
    fn vertex(&self, word: &[u8], line: usize) -> Result<u32, Error> {
        let number = word.split(|&byte| byte == b'/').next().unwrap_or_default();
        let index = resolve(
            parse(number).ok_or_else(|| not_a_number(line, word))?,
            "v",
            self.vertices.len(),
            line,
        )?;
        Ok(index as u32)
    }

    fn read_chain<'a>(
        &mut self,
        words: impl Iterator<Item = &'a [u8]>,
        line: usize,
    ) -> Result<(), Error> {
        let mut before = self.chain.last().copied();
        for (k, word) in words.enumerate() {
            let vertex = self.vertex(word, line)?;
            if k == 0 && before.is_some_and(|before| before != vertex) {
                return Err(second_curve(line));
            }
            if before != Some(vertex) {
                self.chain.push(vertex);
            }
            before = Some(vertex);
        }
        Ok(())
    }

    fn read_spline<'a>(
        &mut self,
        mut words: impl Iterator<Item = &'a [u8]>,
        line: usize,
    ) -> Result<(), Error> {
        if self.spline.is_some() {
            return Err(second_curve(line));
        }
        if self.kind.as_deref() != Some(b"bspline") {
            bail!("line {line}: only curves of `cstype bspline` are supported");
        }
        let Some(degree) = self.degree else {
            bail!("line {line}: the curve has no degree: add a line `deg` before it");
        };
        let (ends, _) = numbers::<2>(words.by_ref().take(2), 2, line)?;
        let control: Result<_, _> = words.map(|word| self.vertex(word, line)).collect();
        let (control, rational) = (control?, self.rational);
        self.spline = Some(Spline { line, degree, rational, ends, control, knots: Vec::new() });
        Ok(())
    }
}

impl Spline {
    fn finish(self, vertices: &[Vertex]) -> Result<Curve, Error> {
        let knots = KnotVector::new(self.degree, self.knots)?;
        if <[f64; 2]>::from(knots.domain()) != self.ends {
            let line = self.line;
            bail!("line {line}: curves that use only a part of their domain are not supported");
        }
        let vertices = self.control.iter().map(|&vertex| vertices[vertex as usize]);
        fn weight(weight: f64, rational: bool) -> f64 {
            if rational { weight } else { 1.0 }
        }
        let (points, weights): (Vec<_>, Vec<_>) =
            vertices.map(|(point, w)| (point, weight(w, self.rational))).unzip();
        Ok(Curve::rational(points, weights, knots)?)
    }
}

fn second_curve(line: usize) -> Error {
    Error::new(format!("line {line}: a second curve begins, which does not continue the first one"))
}

fn polyline(vertices: &[Vertex], mut chain: Vec<u32>) -> Result<Curve, Error> {
    if chain.is_empty() {
        bail!("the file has no curve: no line `l` and no `curv`");
    }
    let is_closed = chain.len() > 3 && chain.first() == chain.last();
    if is_closed {
        chain.pop();
    }
    let points: Vec<_> = chain.iter().map(|&vertex| vertices[vertex as usize].0).collect();
    Ok(Curve::polyline(points, is_closed)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hostile;

    const ELLIPSE: &[u8] = include_bytes!("../../../tests/data/formats/ellipse12.obj");

    const SPLINE: &str = "v 0 0 0 1\nv 1 0 0 0.5\nv 1 1 0 2\nv 0 1 0 1\ncstype rat bspline\ndeg 2\n\
        curv 0 2 1 2 3 \\\n -1\nparm u 0 0 0 1 \\\n 2 2 2\nend\n";

    #[test]
    fn a_line_that_returns_to_its_start_is_closed() {
        let ellipse = read_curve(ELLIPSE).unwrap();
        assert_eq!((ellipse.points().len(), ellipse.is_closed()), (12, true));
        assert_eq!(ellipse.points()[1], Point3::new(1.732050808, 0.5, 0.0));
    }

    #[test]
    fn connected_lines_are_one_curve() {
        let vertices = "v 0 0 0\nv 1 0 0\nv 1 1 0\n";
        fn read(lines: &str, vertices: &str) -> Result<Curve, Error> {
            read_curve(format!("{vertices}{lines}").as_bytes())
        }
        let open = read("l 1 2\nl 2 3/7\n", vertices).unwrap();
        assert_eq!((open.points().len(), open.is_closed()), (3, false));
        assert!(read("l 1 2\nl 2 3\nl -1 -3", vertices).unwrap().is_closed());
        for (lines, error) in [
            (
                "l 1 2\nl 3 1\n",
                "line 5: a second curve begins, which does not continue the first one",
            ),
            ("f 1 2 3\n", "the file has no curve: no line `l` and no `curv`"),
            ("l 1 1\n", "1 points are too few for a curve: at least 2 are needed"),
            ("l 1 4\n", "line 4: there is no v 4 among the 3 so far"),
        ] {
            assert_eq!(read(lines, vertices).unwrap_err().to_string(), error);
        }
    }

    #[test]
    fn a_free_form_curve_keeps_its_weights_and_knots() {
        let curve = read_curve(SPLINE.as_bytes()).unwrap();
        assert_eq!(curve.weights(), Some(&[1.0, 0.5, 2.0, 1.0][..]));
        assert_eq!(curve.knots().unwrap().knots(), [0., 0., 0., 1., 2., 2., 2.]);
        let plain = read_curve(SPLINE.replace("rat ", "").as_bytes()).unwrap();
        assert_eq!(plain.weights(), Some(&[1.0; 4][..]));
    }

    #[test]
    fn unsupported_free_form_curves_are_rejected_with_their_line() {
        fn error(from: &str, to: &str) -> String {
            assert!(SPLINE.contains(from));
            read_curve(SPLINE.replacen(from, to, 1).as_bytes()).unwrap_err().to_string()
        }
        assert_eq!(
            error("bspline", "bezier"),
            "line 7: only curves of `cstype bspline` are supported"
        );
        assert_eq!(
            error("deg 2\n", ""),
            "line 6: the curve has no degree: add a line `deg` before it"
        );
        assert_eq!(
            error("curv 0 2", "curv 0 1"),
            "line 7: curves that use only a part of their domain are not supported"
        );
        assert_eq!(
            error("1 2 3 \\\n -1", "1 2 3 4 4"),
            "the knots are for 4 control points, the curve has 5"
        );
        assert_eq!(
            error("0.5\n", "-0.5\n"),
            "the weight of control point 1 is -0.5; weights of curves are positive"
        );
        assert_eq!(error("deg 2", "deg two"), "line 6: `two` is not a number");
    }

    #[test]
    fn hostile_files_give_errors() {
        hostile::check_no_panic(ELLIPSE, read_curve);
        hostile::check_no_panic(SPLINE.as_bytes(), read_curve);
    }
}
