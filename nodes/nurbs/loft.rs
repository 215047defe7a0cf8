//! Makes a control net of sections.

use maquette::value::{self, ControlNetError};
use maquette::{Context, Error, Node};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::rows::{resampled, shares};

/// Makes a control net of sections that follow each other, such as the ribs of a hull. Each becomes a row of the net.
///
/// Sections of different lengths are divided evenly, by their length in space, into as many points as the net has columns; a
/// section that has as many keeps its own. A section of one point is a tip.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Loft {
    /// The sections, each a list of points (x, y, z), in the unit of the model.
    #[schemars(extend("unit" = "mm"))]
    pub sections: Vec<Vec<[f64; 3]>>,
    /// Columns of the net; 0 takes the points of the longest section.
    #[schemars(range(max = 4096))]
    #[serde(default)]
    pub columns: usize,
}

/// Why sections make no net.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LoftError {
    /// A section without points.
    #[error("section {section} has no point")]
    Empty {
        /// Its index.
        section: usize,
    },
    /// Too few columns to tell the ends of a section apart.
    #[error("a loft has at least 2 columns; the sections have {columns}")]
    OneColumn {
        /// Columns asked for, or points of the longest section.
        columns: usize,
    },
    /// Points that make no net.
    #[error(transparent)]
    Net(#[from] ControlNetError),
}

impl Node for Loft {
    type Outputs = (value::ControlNet,);
    const OUTPUTS: [&'static str; 1] = ["net"];

    fn eval(&self, _: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((loft(&self.sections, self.columns)?,))
    }
}

/// The control net whose rows are these sections, each of `columns` points; 0 takes those of the longest section.
///
/// # Errors
/// If there is no section, one is empty, all are single points, or a point is not finite.
pub fn loft(sections: &[Vec<[f64; 3]>], columns: usize) -> Result<value::ControlNet, LoftError> {
    if let Some(section) = sections.iter().position(Vec::is_empty) {
        return Err(LoftError::Empty { section });
    }
    let longest = sections.iter().map(Vec::len).max().unwrap_or(0);
    let columns = if columns == 0 { longest } else { columns };
    if columns < 2 {
        return Err(LoftError::OneColumn { columns });
    }
    let mut points = Vec::with_capacity(sections.len() * columns);
    for section in sections {
        let section: Vec<Point3<f64>> = section.iter().copied().map(Point3::from).collect();
        if section.len() == columns {
            points.extend(section);
        } else {
            points.extend(resampled(&section, &shares(&section), columns));
        }
    }
    Ok(value::ControlNet::new(sections.len(), columns, points)?)
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn sections_that_make_no_net_are_refused() {
        let points = |count| vec![[0.0; 3]; count];
        assert_eq!(loft(&[points(2), points(0)], 0), Err(LoftError::Empty { section: 1 }));
        assert_eq!(loft(&[points(1)], 0), Err(LoftError::OneColumn { columns: 1 }));
        assert_eq!(loft(&[points(3)], 1), Err(LoftError::OneColumn { columns: 1 }));
        assert!(loft(&[], 0).is_err() && loft(&[], 4).is_err());
        assert!(matches!(loft(&[vec![[f64::NAN; 3]; 3]], 5), Err(LoftError::Net(_))));
    }
}
