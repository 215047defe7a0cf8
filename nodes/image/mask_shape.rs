//! Draws masks of simple shapes.

use maquette_node::{Context, Error, In, Node};
use maquette_value::Mask;
use maquette_value::parallel::*;
use schemars::{JsonSchema, json_schema};
use serde::{Deserialize, Serialize};

use super::picture::Picture;

/// Draws a mask of the size of a picture: a rectangle, an ellipse or a polygon.
///
/// Positions are in pixels from the upper left corner of the picture, so the center of the first pixel is (0.5, 0.5). A pixel belongs to
/// the shape if its center does. Parts outside the picture are cut off.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct MaskShape {
    /// Picture or mask that defines the size of the result.
    pub image: In<Picture>,
    /// Shape to draw.
    pub shape: Shape,
    /// Inverts the mask.
    #[serde(default)]
    pub invert: bool,
}

/// A shape in a picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Shape {
    /// Rectangle with sides parallel to those of the picture.
    Rectangle {
        /// Upper left corner.
        #[schemars(extend("unit" = "px"))]
        at: [f64; 2],
        /// Width and height.
        #[schemars(extend("unit" = "px", "items" = json_schema!({ "type": "number", "format": "double", "minimum": 0.0 })))]
        size: [f64; 2],
    },
    /// Ellipse.
    Ellipse {
        /// Center.
        #[schemars(extend("unit" = "px"))]
        center: [f64; 2],
        /// Half the width and half the height, before rotation.
        #[schemars(extend("unit" = "px", "items" = json_schema!({ "type": "number", "format": "double", "minimum": 0.0 })))]
        radii: [f64; 2],
        /// Rotation, clockwise.
        #[schemars(extend("unit" = "deg"))]
        #[serde(default)]
        angle: f64,
    },
    /// Polygon with the given corners, closed automatically. Areas that the outline encloses twice are outside.
    Polygon(
        #[schemars(length(min = 3), extend("unit" = "px"))]
        /// Corners.
        Vec<[f64; 2]>,
    ),
}

impl Node for MaskShape {
    type Outputs = (Mask,);
    const OUTPUTS: [&'static str; 1] = ["mask"];

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let [width, height] = cx.get(&self.image).size();
        let mask = mask_shape(width, height, &self.shape, self.invert);
        if mask.is_empty() {
            cx.warn(format!(
                "the shape contains no pixel of the picture, which has {width} x {height} pixels"
            ));
        }
        Ok((mask,))
    }
}

/// Returns a mask of the pixels whose centers are in a shape, or of all other pixels if `invert` is true.
pub fn mask_shape(width: usize, height: usize, shape: &Shape, invert: bool) -> Mask {
    let mut pixels = vec![0; width * height];
    pixels.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, pixels)| {
        let y = row as f64 + 0.5;
        let spans = spans(shape, y);
        for (column, pixel) in pixels.iter_mut().enumerate() {
            let x = column as f64 + 0.5;
            let is_inside = spans.iter().filter(|start| **start <= x).count() % 2 == 1;
            *pixel = u8::from(is_inside != invert);
        }
    });
    Mask::new(width, height, pixels).expect("one entry per pixel")
}

/// Returns the x coordinates at which the shape begins and ends, alternately, on the line with the given y coordinate.
fn spans(shape: &Shape, y: f64) -> Vec<f64> {
    match shape {
        Shape::Rectangle { at: [left, top], size: [width, height] } => {
            let crosses_row = *width > 0.0 && (*top..top + height).contains(&y);
            if crosses_row { vec![*left, left + width] } else { Vec::new() }
        }
        Shape::Ellipse { center, radii: [a, b], angle } => {
            // Solve the equation of the rotated ellipse, (cos x + sin y)^2 / a^2 + (cos y - sin x)^2 / b^2 = 1, for x.
            let (sin, cos) = libm::sincos(angle.to_radians());
            let y = y - center[1];
            fn square(x: f64) -> f64 {
                x * x
            }
            let quadratic = square(cos / a) + square(sin / b);
            let half = sin * cos * y * (1.0 / (a * a) - 1.0 / (b * b));
            let rest = square(sin * y / a) + square(cos * y / b) - 1.0;
            let root = half * half - quadratic * rest;
            match *a > 0.0 && *b > 0.0 && root >= 0.0 {
                true => {
                    [-1.0, 1.0].map(|s| center[0] + (s * root.sqrt() - half) / quadratic).to_vec()
                }
                false => Vec::new(),
            }
        }
        Shape::Polygon(corners) => {
            let next = corners.iter().cycle().skip(1);
            corners
                .iter()
                .zip(next)
                .filter_map(|(a, b): (&[f64; 2], &[f64; 2])| {
                    let crosses = (a[1] <= y) != (b[1] <= y);
                    crosses.then(|| a[0] + (y - a[1]) * (b[0] - a[0]) / (b[1] - a[1]))
                })
                .collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use expect_test::{Expect, expect};

    use super::*;

    fn check(shape: &Shape, expected: Expect) {
        expected.assert_eq(&mask_shape(9, 5, shape, false).draw());
    }

    #[test]
    fn a_pixel_belongs_to_a_shape_if_its_center_does() {
        check(
            &Shape::Rectangle { at: [1.4, 1.0], size: [3.0, 2.6] },
            expect![[r#"
                .........
                .###.....
                .###.....
                .###.....
                .........
            "#]],
        );
        check(
            &Shape::Ellipse { center: [4.5, 2.5], radii: [4.2, 1.6], angle: 0.0 },
            expect![[r#"
                .........
                .#######.
                #########
                .#######.
                .........
            "#]],
        );
        check(
            &Shape::Polygon(vec![[0.0, 0.0], [9.0, 0.0], [0.0, 5.0]]),
            expect![[r#"
                ########.
                ######...
                ####.....
                ###......
                #........
            "#]],
        );
    }

    #[test]
    fn an_ellipse_is_rotated_clockwise() {
        let turned = Shape::Ellipse { center: [4.5, 2.5], radii: [5.0, 0.8], angle: 30.0 };
        check(
            &turned,
            expect![[r#"
                ##.......
                ..##.....
                ...###...
                .....##..
                .......##
            "#]],
        );
        let upright = Shape::Ellipse { center: [4.5, 2.5], radii: [2.0, 1.0], angle: 90.0 };
        let same = Shape::Ellipse { center: [4.5, 2.5], radii: [1.0, 2.0], angle: 0.0 };
        let [upright, same] = [upright, same].map(|shape| mask_shape(9, 5, &shape, false));
        assert_eq!(upright, same);
    }

    #[test]
    fn areas_enclosed_twice_are_outside_and_flat_shapes_are_empty() {
        let twice = Shape::Polygon(vec![
            [0.0, 0.0],
            [9.0, 0.0],
            [9.0, 5.0],
            [0.0, 5.0],
            [0.0, 0.0],
            [2.0, 1.0],
            [7.0, 1.0],
            [7.0, 4.0],
            [2.0, 4.0],
            [2.0, 1.0],
        ]);
        assert_eq!(mask_shape(9, 5, &twice, false).count(), 45 - 15);
        assert_eq!(mask_shape(9, 5, &twice, true).count(), 15);
        let flat = Shape::Ellipse { center: [4.5, 2.5], radii: [2.0, 0.0], angle: 0.0 };
        assert!(mask_shape(9, 5, &flat, false).is_empty());
        assert!(mask_shape(0, 0, &flat, true).is_empty());
    }
}
