//! Makes a control net from sections.

use maquette_base::limits::POINTS;
use maquette_node::{Context, Error, FieldError, In, Node, bail};
use maquette_value as value;
use maquette_value::{Curve, KnotVector};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::knot_vectors::even_knots::is_even;
use super::net::rows::{resample, shares};

/// Makes a control net from consecutive sections, such as the ribs of a hull. Each section becomes a row of the net.
///
/// Sections of different lengths are divided evenly, by arc length, into as many points as the net has columns; a section with that many
/// keeps its own. A section of one point is a tip. For linked B-splines their points are used; only if all sections are B-splines with the
/// same knots, or tips, their control points and weights are used, so that a surface with these knots along v passes through the curves
/// exactly.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Loft {
    /// Sections, in order; they follow those of `sections`.
    #[serde(default)]
    pub curves: Vec<In<Curve>>,
    /// Sections written here, each a list of points (x, y, z), in mm.
    #[schemars(extend("unit" = "mm"))]
    #[serde(default)]
    pub sections: Vec<Vec<[f64; 3]>>,
    /// A tip (a single point) after the linked sections; none if omitted.
    #[schemars(extend("unit" = "mm"))]
    #[serde(default)]
    pub end: Option<[f64; 3]>,
    /// Number of columns of the net; 0 means the points of the longest section.
    #[schemars(range(max = 4096))]
    #[serde(default)]
    pub columns: usize,
}

/// The error message for a loft without sections.
const NO_SECTIONS: &str = "there are no sections: both `curves` and `sections` are empty";

fn empty_section(section: usize) -> Error {
    Error::new(format!("section {section} has no point"))
}

fn one_column(columns: usize) -> Error {
    Error::new(format!("a loft has at least 2 columns; the sections have {columns}"))
}

impl Node for Loft {
    type Outputs = (value::ControlNet,);
    const OUTPUTS: [&'static str; 1] = ["net"];

    fn check(&self) -> Result<(), FieldError> {
        let count = self.sections.len() + self.curves.len() + usize::from(self.end.is_some());
        if let Some(section) = self.sections.iter().position(Vec::is_empty) {
            let help = "write its points, or leave it out";
            return Err(FieldError::new("sections", empty_section(section), help));
        }
        if count == 0 {
            let help =
                "link curves, as `curves: [\"curve\"]`, or write `sections: [[(0, 0, 0), ..], ..]`";
            return Err(FieldError::new("", NO_SECTIONS, help));
        }
        // A net of one row has no surface. Nodes with links are not checked here, because a single link may yield several curves.
        if count == 1 && self.curves.is_empty() {
            let message = "expected at least 2 sections, found 1";
            return Err(FieldError::new("", message, "link or write another one, or an `end`"));
        }
        let columns = match self.columns {
            0 if !self.curves.is_empty() => return Ok(()),
            0 => self.sections.iter().map(Vec::len).max().unwrap_or(1),
            columns => columns,
        };
        if columns < 2 {
            let (field, help) = match self.columns {
                0 => ("sections", "give a section more points"),
                _ => ("columns", "write at least 2, or leave `columns` out"),
            };
            return Err(FieldError::new(field, one_column(columns), help));
        }
        Ok(())
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let curves: Vec<&Curve> = self.curves.iter().map(|curve| cx.get(curve)).collect();
        let mut sections: Vec<Section> = self.sections.iter().map(|points| points.into()).collect();
        sections.extend(curves.iter().map(|&curve| Section::from(curve)));
        sections.extend(self.end.map(|tip| Section::from(&vec![tip])));
        if let Some(knots) = common_knots(&sections).filter(|knots| !is_even(knots)) {
            cx.warn(format!(
                "the sections' knots are not even: to go through them, `Nurbs` needs them at `v`, as in Knots(kind: Values({:?}))",
                knots.knots()
            ));
        }
        Ok((loft(&sections, self.columns)?,))
    }
}

/// A section: the source of one row of a lofted net.
#[derive(Clone, Debug, PartialEq)]
pub struct Section {
    /// The polyline that is divided into points, from end to end.
    points: Vec<Point3<f64>>,
    /// The curve of the section if the curve is a B-spline; `None` for a polyline.
    spline: Option<Curve>,
}

/// Points per span when a B-spline is converted to a polyline. With this number, the polyline of a quarter circle deviates from it by at
/// most a hundred-thousandth of the circle's size.
const PIECES: usize = 256;

impl From<&Curve> for Section {
    fn from(curve: &Curve) -> Self {
        let mut points = curve.sample(PIECES);
        if curve.is_closed() {
            points.extend(points.first().copied());
        }
        Self { points, spline: curve.knots().map(|_| curve.clone()) }
    }
}

impl From<&Vec<[f64; 3]>> for Section {
    fn from(points: &Vec<[f64; 3]>) -> Self {
        Self { points: points.iter().copied().map(Point3::from).collect(), spline: None }
    }
}

impl Section {
    fn knots(&self) -> Option<&KnotVector> {
        self.spline.as_ref()?.knots()
    }

    /// Returns the number of control points of the spline, or of points of the polyline.
    fn own_count(&self) -> usize {
        self.spline.as_ref().map_or(self.points.len(), |curve| curve.points().len())
    }

    fn divide(&self, columns: usize) -> Vec<Point3<f64>> {
        if self.spline.is_none() && self.points.len() == columns {
            return self.points.clone();
        }
        resample(&self.points, &shares(&self.points), columns)
    }
}

/// Returns the knots of the sections, if all sections except single points are B-splines with the same knots.
fn common_knots(sections: &[Section]) -> Option<&KnotVector> {
    let mut all = sections.iter().filter(|section| section.points.len() != 1).map(Section::knots);
    let first = all.next()??;
    all.all(|knots| knots == Some(first)).then_some(first)
}

/// Makes the control net whose rows are the given sections, each of `columns` points; 0 means the number of points of the longest section.
/// B-splines with the same knots keep their control points and weights, if `columns` allows all of them.
///
/// # Errors
/// Returns an error if there is no section, a section is empty, all are single points, or a point is not finite.
pub fn loft(sections: &[Section], columns: usize) -> Result<value::ControlNet, Error> {
    if sections.is_empty() {
        bail!("{NO_SECTIONS}");
    }
    if let Some(section) = sections.iter().position(|section| section.points.is_empty()) {
        return Err(empty_section(section));
    }
    let longest = sections.iter().map(Section::own_count).max().unwrap_or(0);
    let columns = if columns == 0 { longest } else { columns };
    if columns < 2 {
        return Err(one_column(columns));
    }
    POINTS.check("the net of the sections", sections.len() as f64 * columns as f64)?;
    let exact = common_knots(sections).is_some_and(|knots| knots.n_control() == columns);
    let mut points = Vec::with_capacity(sections.len() * columns);
    let mut weights = Vec::with_capacity(sections.len() * columns);
    for section in sections {
        match section.spline.as_ref().filter(|_| exact) {
            Some(curve) => {
                points.extend_from_slice(curve.points());
                weights.extend_from_slice(curve.weights().unwrap_or_default());
            }
            None => {
                points.extend(section.divide(columns));
                weights.resize(points.len(), 1.0);
            }
        }
    }
    Ok(value::ControlNet::new(sections.len(), columns, points)?.with_weights(weights)?)
}

#[cfg(test)]
mod tests {
    use maquette_value::{ControlNetError, ParameterDirection};

    use super::super::nurbs::nurbs;
    use super::*;

    fn loft(sections: &[Vec<[f64; 3]>], columns: usize) -> Result<value::ControlNet, Error> {
        super::loft(&sections.iter().map(Section::from).collect::<Vec<_>>(), columns)
    }

    /// Returns an exact quarter circle with the given radius in the plane at height z.
    fn arc(radius: f64, z: f64) -> Curve {
        fn point(x: f64, y: f64, radius: f64, z: f64) -> Point3<f64> {
            Point3::new(radius * x, radius * y, z)
        }
        let corner = 0.5f64.sqrt();
        let points = vec![
            point(1.0, 0.0, radius, z),
            point(1.0, 1.0, radius, z),
            point(0.0, 1.0, radius, z),
        ];
        let knots = KnotVector::new(2, vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0]).unwrap();
        Curve::rational(points, vec![1.0, corner, 1.0], knots).unwrap()
    }

    #[test]
    fn sections_become_rows_of_one_length() {
        let tip = vec![[0.0, 0.0, 0.0]];
        let bent = vec![[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 3.0]];
        let own = vec![
            [2.0, 0.0, 0.0],
            [2.0, 0.1, 0.0],
            [2.0, 0.2, 0.0],
            [2.0, 9.0, 0.0],
            [2.0, 9.5, 0.0],
        ];
        let net = loft(&[tip, bent, own.clone()], 0).unwrap();
        assert_eq!((net.rows(), net.columns()), (3, 5));
        assert!(net.points()[..5].iter().all(|point| *point == Point3::origin()));
        let z = [0.0, 0.0, 1.0, 2.0, 3.0];
        assert!(net.points()[5..10].iter().zip(z).all(|(point, z)| point.z == z));
        assert!(net.points()[10..].iter().zip(own).all(|(point, own)| *point == own.into()));
    }

    #[test]
    fn a_surface_goes_through_splines_of_the_same_knots() {
        let curves = [arc(2.0, 0.0), arc(3.0, 5.0)];
        let sections =
            [Section::from(&curves[0]), (&curves[1]).into(), (&vec![[0., 0., 9.]]).into()];
        let net = super::loft(&sections, 0).unwrap();
        assert_eq!((net.rows(), net.columns()), (3, 3));
        let surface = nurbs(&net, None, Some(curves[0].knots().unwrap()), Some([2, 3])).unwrap();
        for k in 0..=10 {
            let v = f64::from(k) / 10.0;
            for (u, curve) in curves.iter().enumerate() {
                assert!((surface.point(u as f64, v) - curve.point(v)).norm() <= 1e-14);
            }
            assert!((surface.point(2.0, v) - Point3::new(0.0, 0.0, 9.0)).norm() <= 1e-14);
        }
        assert_eq!(surface.iso_curve(ParameterDirection::V, 0.0).points.len(), 3);
    }

    #[test]
    fn other_curves_are_divided_by_their_length() {
        let square = [[0., 0., 0.], [4., 0., 0.], [4., 4., 0.], [0., 4., 0.]].map(Point3::from);
        let square = Curve::polyline(square.to_vec(), true).unwrap();
        let net = super::loft(&[Section::from(&arc(2.0, 1.0)), (&square).into()], 9).unwrap();
        for (k, point) in net.points()[..9].iter().enumerate() {
            let angle = std::f64::consts::FRAC_PI_2 * k as f64 / 8.0;
            let even = Point3::new(2.0 * libm::cos(angle), 2.0 * libm::sin(angle), 1.0);
            assert!((point - even).norm() <= 1e-4, "{k}");
        }
        assert_eq!(net.points()[9], net.points()[17]);
        assert!((net.points()[10] - Point3::new(2.0, 0.0, 0.0)).norm() <= 1e-14);
        // The list of a closed polyline contains the first point twice.
        assert_eq!(
            super::loft(&[Section::from(&square), (&square).into()], 0).unwrap().columns(),
            5
        );
    }

    #[test]
    fn sections_that_make_no_net_are_refused() {
        fn points(count: usize) -> Vec<[f64; 3]> {
            vec![[0.0; 3]; count]
        }
        fn error(sections: &[Vec<[f64; 3]>], columns: usize) -> String {
            loft(sections, columns).unwrap_err().to_string()
        }
        let one_column = "a loft has at least 2 columns; the sections have 1";
        assert_eq!(error(&[points(2), points(0)], 0), "section 1 has no point");
        assert_eq!(error(&[points(1)], 0), one_column);
        assert_eq!(error(&[points(3)], 1), one_column);
        for columns in [0, 4] {
            assert_eq!(error(&[], columns), NO_SECTIONS);
        }
        let error = loft(&[vec![[f64::NAN; 3]; 3]], 5).unwrap_err();
        assert!(error.downcast::<ControlNetError>().is_some(), "{error}");
    }

    #[test]
    fn a_net_that_memory_does_not_hold_is_refused_with_numbers() {
        let line = vec![[0.0; 3], [1.0, 0.0, 0.0]];
        let error = loft(&vec![line; 2000], 4096).unwrap_err().to_string();
        assert!(error.contains("about 8 200 000 points"), "{error}");
    }
}
