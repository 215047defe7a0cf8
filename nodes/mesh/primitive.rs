//! Makes simple solids.

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_2, TAU};

use maquette_node::{Context, Error, Forecast, Node, Promise, Sizes, ValueSize, bail};
use maquette_value::parallel::*;
use maquette_value::{Faces, Mesh, MeshError};
use nalgebra::{Point3, Vector3};
use schemars::{JsonSchema, json_schema};
use serde::{Deserialize, Serialize};

/// Makes a simple solid: a box, a cylinder or a sphere, for example one that `Boolean` subtracts from a scan or unites with it.
///
/// It is closed and oriented outward. `Transform` rotates and moves it.
///
/// In other programs: cube, tube.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Primitive {
    /// The shape and its size.
    #[serde(default)]
    pub shape: Shape,
    /// Center of the solid in mm.
    #[schemars(extend("unit" = "mm"))]
    #[serde(default)]
    pub center: [f64; 3],
}

/// A simple solid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub enum Shape {
    /// A box with its sides along the axes: six quads.
    Box {
        /// Lengths along x, y and z in mm.
        #[schemars(extend("unit" = "mm", "items" = json_schema!({ "type": "number", "exclusiveMinimum": 0.0 })))]
        size: [f64; 3],
    },
    /// A cylinder along y: quads around, and two polygons.
    Cylinder {
        /// Distance of the cylinder's vertices from its axis in mm.
        #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
        radius: f64,
        /// Height in mm.
        #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
        height: f64,
        /// Number of quads around the cylinder.
        #[schemars(range(min = 3, max = 4096))]
        #[serde(default = "default_sides")]
        sides: u32,
    },
    /// A sphere of nearly square quads: a cube projected onto the sphere.
    Sphere {
        /// Distance of the sphere's vertices from its center in mm.
        #[schemars(range(min = 0.0), extend("unit" = "mm", "exclusiveMinimum" = 0.0))]
        radius: f64,
        /// Number of quads around the sphere: a multiple of 4.
        #[schemars(range(min = 4, max = 4096), extend("multipleOf" = 4))]
        #[serde(default = "default_sides")]
        sides: u32,
    },
}

fn default_sides() -> u32 {
    64
}

impl Default for Shape {
    fn default() -> Self {
        Self::Box { size: [10.0; 3] }
    }
}

/// Maximum number of quads around a cylinder or a sphere.
const MAX_SIDES: u32 = 4096;

impl Node for Primitive {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::always("mesh", "Closed"),
        Promise::always("mesh", "Manifold"),
        Promise::always("mesh", "Oriented"),
        Promise::always("mesh", "Unpinched"),
        Promise::always("mesh", "NonEmpty"),
    ];

    fn forecast(&self, _: &Sizes<'_>) -> Option<Forecast> {
        let mesh = match self.shape {
            Shape::Box { .. } => ValueSize::mesh(8.0, 6.0, 24.0),
            Shape::Cylinder { sides, .. } => {
                let sides = f64::from(sides);
                ValueSize::mesh(2.0 * sides, sides + 2.0, 6.0 * sides)
            }
            // Each of the six sides of a cube is a grid of a quarter of the quads around.
            Shape::Sphere { sides, .. } => {
                let quads = 6.0 * f64::from(sides / 4) * f64::from(sides / 4);
                ValueSize::mesh(quads + 2.0, quads, 4.0 * quads)
            }
        };
        Some(Forecast::by_law(mesh))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let visits = match self.shape {
            Shape::Sphere { sides, .. } => {
                (sides as usize / 4).saturating_pow(2).saturating_mul(SPHERE_VISITS)
            }
            Shape::Box { .. } | Shape::Cylinder { .. } => 0,
        };
        let make = || primitive(self.shape, self.center.into());
        Ok((cx.progress().metered(visits, make)?,))
    }
}

/// The number of times that loops visit quads and vertices of a sphere, per quad of a sixth of it; for progress.
const SPHERE_VISITS: usize = 12;

/// Makes a simple solid with the given center, in mm.
///
/// # Errors
/// Returns an error if a length is not positive, `sides` is out of range, or positions are too large.
pub fn primitive(shape: Shape, center: Point3<f64>) -> Result<Mesh, Error> {
    fn length(name: &str, length: f64) -> Result<(), Error> {
        if !(length > 0.0 && length.is_finite()) {
            bail!("`{name}` is {length} mm, but must be a number above 0");
        }
        Ok(())
    }
    let (places, faces) = match shape {
        Shape::Box { size } => {
            size.iter().try_for_each(|&side| length("size", side))?;
            let size = Vector3::from(size);
            // The box is a cube with one quad per side, scaled.
            let (corners, faces) = cube(1);
            (
                corners
                    .iter()
                    .map(|corner| {
                        size.component_mul(&Vector3::from(corner.map(|k| f64::from(k) - 0.5)))
                    })
                    .collect::<Vec<_>>(),
                faces,
            )
        }
        Shape::Cylinder { radius, height, sides } => {
            length("radius", radius)?;
            length("height", height)?;
            if !(3..=MAX_SIDES).contains(&sides) {
                bail!("`sides` is {sides}, but must be from 3 to 4096");
            }
            cylinder(radius, height, sides)?
        }
        Shape::Sphere { radius, sides } => {
            length("radius", radius)?;
            if !(4..=MAX_SIDES).contains(&sides) || !sides.is_multiple_of(4) {
                bail!("`sides` is {sides}, but must be a multiple of 4 from 4 to 4096");
            }
            let steps = sides / 4;
            let (corners, faces) = cube(steps);
            // Place the vertices at equal angles, as seen from the center, along the edges of the cube's sides.
            fn angle(k: u32, steps: u32) -> f64 {
                (f64::from(k) / f64::from(steps) - 0.5) * FRAC_PI_2
            }
            (
                corners
                    .par_iter()
                    .map(|corner| {
                        Vector3::from(corner.map(|k| libm::tan(angle(k, steps)))).normalize()
                            * radius
                    })
                    .collect::<Vec<_>>(),
                faces,
            )
        }
    };
    let places: Vec<_> = places.iter().map(|place| center + place).collect();
    Ok(Mesh::new(places, faces)?)
}

/// Returns the surface of a cube with `steps` quads along each edge: its vertices on an integer grid that begins at 0, and its faces.
fn cube(steps: u32) -> (Vec<[u32; 3]>, Faces) {
    let (mut corners, mut numbers) = (Vec::new(), HashMap::new());
    let mut faces = Vec::with_capacity(24 * (steps * steps) as usize);
    for axis in 0..3 {
        for end in [0, steps] {
            let quads = (0..steps * steps).until_stopped();
            for [i, j] in quads.map(|k| [k % steps, k / steps]) {
                let mut quad = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]];
                if end == 0 {
                    quad.reverse();
                }
                faces.extend(quad.map(|[i, j]| {
                    let mut corner = [end; 3];
                    corner[(axis + 1) % 3] = i;
                    corner[(axis + 2) % 3] = j;
                    *numbers.entry(corner).or_insert_with(|| {
                        corners.push(corner);
                        corners.len() as u32 - 1
                    })
                }));
            }
        }
    }
    (corners, Faces::uniform(4, faces).expect("quads"))
}

/// Returns a cylinder along y around the origin.
fn cylinder(radius: f64, height: f64, sides: u32) -> Result<(Vec<Vector3<f64>>, Faces), MeshError> {
    let quads = (0..sides).flat_map(|k| {
        let next = (k + 1) % sides;
        [k, next, sides + next, sides + k]
    });
    let lids = (0..sides).rev().chain(sides..2 * sides);
    let counts: Vec<_> = (0..sides).map(|_| 4).chain([sides as usize; 2]).collect();
    let faces = Faces::polygons(&counts, quads.chain(lids).collect())?;
    Ok((
        (0..2 * sides)
            .map(|k: u32| {
                let turn = TAU * f64::from(k % sides) / f64::from(sides);
                let up = if k < sides { -0.5 } else { 0.5 };
                Vector3::new(radius * libm::sin(turn), up * height, radius * libm::cos(turn))
            })
            .collect(),
        faces,
    ))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn volume(mesh: &Mesh) -> f64 {
        mesh.faces()
            .iter()
            .map(|face| {
                fn position(vertex: u32, mesh: &Mesh) -> Vector3<f64> {
                    mesh.positions()[vertex as usize].coords
                }
                let fan = face[1..].windows(2);
                fan.map(|pair| {
                    position(face[0], mesh)
                        .dot(&position(pair[0], mesh).cross(&position(pair[1], mesh)))
                })
                .sum::<f64>()
            })
            .sum::<f64>()
            / 6.0
    }

    #[test]
    fn solids_are_closed_look_outward_and_have_their_volume() {
        let r = 5.0;
        for (shape, expected) in [
            (Shape::Box { size: [2.0, 3.0, 4.0] }, 24.0),
            (Shape::Cylinder { radius: r, height: 7.0, sides: 64 }, PI * r * r * 7.0),
            (
                Shape::Cylinder { radius: r, height: 7.0, sides: 3 },
                0.75 * 3f64.sqrt() * r * r * 7.0,
            ),
            (Shape::Sphere { radius: r, sides: 64 }, 4.0 / 3.0 * PI * r * r * r),
            (Shape::Sphere { radius: r, sides: 4 }, 8.0 * r * r * r / (3.0 * 3f64.sqrt())),
        ] {
            let mesh = primitive(shape, Point3::new(1.0, -2.0, 30.0)).unwrap();
            let edges = mesh.edges();
            assert!(edges.misoriented == 0 && edges.faces.iter().all(|faces| *faces == 2));
            assert_eq!(mesh.positions().len() + mesh.faces().len(), edges.faces.len() + 2);
            let found = volume(&mesh);
            assert!((found / expected - 1.0).abs() < 0.005, "{shape:?}: {found} {expected}");
            let (low, high) = mesh.bounds().unwrap();
            assert!((nalgebra::center(&low, &high) - Point3::new(1.0, -2.0, 30.0)).y.abs() < 1e-9);
        }
    }

    #[test]
    fn the_quads_of_a_sphere_are_even() {
        let mesh = primitive(Shape::Sphere { radius: 1.0, sides: 64 }, Point3::origin()).unwrap();
        let areas = mesh.faces().iter().map(|face| mesh.area_vector(face).norm());
        let areas = Vec::from_iter(areas);
        let (least, most) = areas.iter().fold((f64::MAX, 0.0), |(a, b), x| (x.min(a), x.max(b)));
        assert!(most < 1.5 * least, "{least} {most}");
    }

    #[test]
    fn invalid_sizes_are_refused() {
        fn error(shape: Shape) -> String {
            primitive(shape, Point3::origin()).unwrap_err().to_string()
        }
        let flat = Shape::Box { size: [1.0, 0.0, 1.0] };
        assert_eq!(error(flat), "`size` is 0 mm, but must be a number above 0");
        let thin = Shape::Cylinder { radius: f64::NAN, height: 1.0, sides: 8 };
        assert_eq!(error(thin), "`radius` is NaN mm, but must be a number above 0");
        let odd = Shape::Sphere { radius: 1.0, sides: 10 };
        assert_eq!(error(odd), "`sides` is 10, but must be a multiple of 4 from 4 to 4096");
        let far = primitive(Shape::default(), Point3::new(f64::INFINITY, 0.0, 0.0));
        assert!(far.unwrap_err().downcast::<MeshError>().is_some());
    }
}
