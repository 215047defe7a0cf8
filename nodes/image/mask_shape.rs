//! A mask of a simple shape.

use maquette_node::{Context, Error, In, Node};
use maquette_value::Mask;
use maquette_value::parallel::*;
use schemars::{JsonSchema, json_schema};
use serde::{Deserialize, Serialize};

use super::picture::Picture;

/// Draws a mask: a rectangle, an ellipse or a polygon, as large as a picture.
///
/// Places are in pixels from the picture's upper left corner, so that the middle of the first pixel is (0.5, 0.5). A pixel belongs to the
/// shape if its middle does. What lies outside of the picture is cut off.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct MaskShape {
    /// The picture or mask that says how large the mask is.
    pub image: In<Picture>,
    /// The shape.
    pub shape: Shape,
    /// Marks all the other pixels instead.
    #[serde(default)]
    pub invert: bool,
}

/// A shape in a picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Shape {
    /// A rectangle with its sides along those of the picture.
    Rectangle {
        /// Its upper left corner.
        #[schemars(extend("unit" = "px"))]
        at: [f64; 2],
        /// Its width and height.
        #[schemars(extend("unit" = "px", "items" = json_schema!({ "type": "number", "format": "double", "minimum": 0.0 })))]
        size: [f64; 2],
    },
    /// An ellipse.
    Ellipse {
        /// Its middle.
        #[schemars(extend("unit" = "px"))]
        center: [f64; 2],
        /// Half of its width and of its height, before it is turned.
        #[schemars(extend("unit" = "px", "items" = json_schema!({ "type": "number", "format": "double", "minimum": 0.0 })))]
        radii: [f64; 2],
        /// By how much it is turned, clockwise.
        #[schemars(extend("unit" = "deg"))]
        #[serde(default)]
        angle: f64,
    },
    /// What some corners enclose, one after the other; the last one is joined to the first. What is enclosed twice is outside.
    Polygon(
        #[schemars(length(min = 3), extend("unit" = "px"))]
        /// The corners.
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
            cx.warn(format!("the shape has no pixel in the picture, which has {width} x {height}"));
        }
        Ok((mask,))
    }
}

/// The pixels of a picture of this size whose middles are in a shape; with `invert` the others.
pub fn mask_shape(width: usize, height: usize, shape: &Shape, invert: bool) -> Mask {
    let mut pixels = vec![0; width * height];
    pixels.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, pixels)| {
        let y = row as f64 + 0.5;
        let spans = spans(shape, y);
        for (column, pixel) in pixels.iter_mut().enumerate() {
            let x = column as f64 + 0.5;
            let is_in = spans.iter().filter(|start| **start <= x).count() % 2 == 1;
            *pixel = u8::from(is_in != invert);
        }
    });
    Mask::new(width, height, pixels).expect("one entry per pixel")
}

/// Where the shape begins and ends by turns on a line of the picture.
fn spans(shape: &Shape, y: f64) -> Vec<f64> {
    match shape {
        Shape::Rectangle { at: [left, top], size: [width, height] } => {
            let is_there = *width > 0.0 && (*top..top + height).contains(&y);
            if is_there { vec![*left, left + width] } else { Vec::new() }
        }
        Shape::Ellipse { center, radii: [a, b], angle } => {
            // (cos x + sin y)^2 / a^2 + (cos y - sin x)^2 / b^2 = 1, solved for x.
            let (sin, cos) = libm::sincos(angle.to_radians());
            let y = y - center[1];
            fn squared(x: f64) -> f64 {
                x * x
            }
            let square = squared(cos / a) + squared(sin / b);
            let half = sin * cos * y * (1.0 / (a * a) - 1.0 / (b * b));
            let rest = squared(sin * y / a) + squared(cos * y / b) - 1.0;
            let root = half * half - square * rest;
            match *a > 0.0 && *b > 0.0 && root >= 0.0 {
                true => [-1.0, 1.0].map(|s| center[0] + (s * root.sqrt() - half) / square).to_vec(),
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
    fn a_pixel_belongs_to_a_shape_if_its_middle_does() {
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
    fn an_ellipse_turns_clockwise() {
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
    fn what_is_enclosed_twice_is_outside_and_what_is_not_there_is_nothing() {
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
