//! Rational Gaussian surfaces.

use maquette_base::limits::VERTICES;
use maquette_node::{Context, Error, Forecast, Node, Promise, Sizes, ValueSize, bail};
use maquette_value::parallel::*;
use maquette_value::{Attribute, Faces, Handle, HandleSpace, Handles, Mesh};
use nalgebra::{Matrix3, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Mode;
use super::gaussian::deformation::{Base, Deformation};
use super::gaussian::layout::{Bounds, choose_deviations, prepare};
use super::gaussian::system::System;

/// Creates a surface from control points with rational Gaussian functions.
///
/// The points may have any parameters u and v from 0 to 1, in any number; no grid is needed. The deviation of a point determines its reach:
/// small deviations pull the surface to the points in flat steps, large ones smooth it. The mesh has exact normals, and u and v as
/// attribute `uv`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct GaussianSurface {
    /// Control points.
    #[schemars(length(min = 1))]
    pub points: Vec<SurfacePoint>,
    /// Makes the surface pass through the points; otherwise it only approaches them.
    #[serde(default)]
    pub through: bool,
    /// Number of quads along u.
    #[schemars(range(min = 1, max = 8192))]
    #[serde(default = "default_quads")]
    pub u: usize,
    /// Number of quads along v.
    #[schemars(range(min = 1, max = 8192))]
    #[serde(default = "default_quads")]
    pub v: usize,
}

fn default_quads() -> usize {
    32
}

/// A control point of a Gaussian surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SurfacePoint {
    /// Parameters u and v: from 0 to 1 on the surface; values outside are allowed.
    pub at: [f64; 2],
    /// Position of the point.
    #[schemars(extend("unit" = "mm"))]
    pub to: [f64; 3],
    /// Standard deviations along u and v. If omitted, 0.75 of the mean distance to the three nearest points.
    #[schemars(extend("items" = serde_json::json!({ "type": "number", "format": "double", "exclusiveMinimum": 0.0 })))]
    #[serde(default)]
    pub sigma: Option<[f64; 2]>,
    /// Weight relative to the other points, greater than 0.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    #[serde(default = "default_weight")]
    pub weight: f64,
}

fn default_weight() -> f64 {
    1.0
}

impl Node for GaussianSurface {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::always("mesh", "Manifold"),
        Promise::always("mesh", "Oriented"),
        Promise::always("mesh", "Unpinched"),
        Promise::always("mesh", "NonEmpty"),
        Promise::never_has("mesh", "Triangles"),
    ];

    fn forecast(&self, _: &Sizes<'_>) -> Option<Forecast> {
        let (vertices, quads) = (vertices([self.u, self.v]), self.u as f64 * self.v as f64);
        let mesh = ValueSize::mesh(vertices, quads, 4.0 * quads).with_more_bytes(24.0 * vertices);
        let solved = if self.through { square(self.points.len()) * 16.0 } else { 0.0 };
        Some(Forecast::by_law(mesh).with_memory(vertices * 220.0 + solved, VERTICES.help))
    }

    fn eval(&self, _: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((gaussian_surface(&self.points, self.through, [self.u, self.v])?,))
    }
}

/// The unit square of the parameters u and v, as the box to which handle coordinates are relative.
const SQUARE: Bounds = (Point3::new(0.0, 0.0, 0.0), Point3::new(1.0, 1.0, 1.0));

/// Returns the surface `P(u, v) = sum_i V_i g_i(u, v)` as a mesh of `u` x `v` quads: rows of vertices along u, positions in mm.
///
/// The coefficients `V_i` are the points' positions, or, with `through`, the coefficients for which `P` passes through the points.
/// Goshtasby, "Geometric modelling using rational Gaussian curves and surfaces" (1995); Yoshida, Kanou and Kitajima, equations 1 to 3.
/// Normals are computed from the derivatives.
///
/// # Errors
/// Returns an error if there is no point; if a number is not finite, or not greater than 0 where it must be; if with `through` two points
/// have the same parameters or are so close that the equations cannot be solved; or if the number of quads is 0 or too large.
pub fn gaussian_surface(
    points: &[SurfacePoint],
    through: bool,
    [u, v]: [usize; 2],
) -> Result<Mesh, Error> {
    if points.is_empty() {
        bail!("a surface needs at least one control point");
    }
    if u == 0 || v == 0 {
        bail!("expected at least 1 x 1 quads, found {u} x {v}");
    }
    VERTICES.check("the surface", vertices([u, v]))?;
    let count = (u + 1) * (v + 1);
    let surface = coefficients(points, through)?;
    let parameters: Vec<Point3<f64>> = (0..count)
        .map(|index: usize| {
            let (row, column) = (index / (v + 1), index % (v + 1));
            Point3::new(row as f64 / u as f64, column as f64 / v as f64, 0.0)
        })
        .collect();
    let mut positions = vec![Point3::origin(); count];
    let mut slopes = vec![Matrix3::zeros(); count];
    let chunks = parameters.par_chunks(CHUNK_SIZE).zip(positions.par_chunks_mut(CHUNK_SIZE));
    chunks.zip(slopes.par_chunks_mut(CHUNK_SIZE)).for_each(|((parameters, positions), slopes)| {
        surface.apply(&surface.terms, parameters, positions, Some(slopes));
    });
    fn corner(quad: usize, v: usize) -> u32 {
        (quad / v * (v + 1) + quad % v) as u32
    }
    let mesh = Mesh::new(
        positions,
        Faces::uniform(
            4,
            (0..u * v)
                .flat_map(|quad: usize| {
                    let (a, b) = (corner(quad, v), corner(quad, v) + v as u32 + 1);
                    [a, b, b + 1, a + 1]
                })
                .collect::<Vec<_>>(),
        )?,
    )?;
    let faces = mesh.vertex_normals();
    let normals = slopes
        .iter()
        .zip(&faces)
        .map(|(slope, face): (&Matrix3<f64>, &Vector3<f64>)| {
            // Use the mesh's normal if the surface degenerates to a point or a line.
            let normal: Vector3<f64> = slope.column(0).cross(&slope.column(1));
            normal.try_normalize(0.0).unwrap_or(*face).into()
        })
        .collect();
    let uv = parameters.iter().map(|at| [at.x, at.y]).collect();
    Ok(mesh
        .with_vertex("normal", Attribute::Vector(normals))?
        .with_vertex("uv", Attribute::Pair(uv))?)
}

/// Returns the number of vertices of a grid of `u` x `v` quads.
fn vertices([u, v]: [usize; 2]) -> f64 {
    (u as f64 + 1.0) * (v as f64 + 1.0)
}

fn square(count: usize) -> f64 {
    count as f64 * count as f64
}

/// The number of vertices that one task computes.
const CHUNK_SIZE: usize = 4096;

/// Returns the weighted sum of Gaussians that defines the surface, as a deformation.
fn coefficients(points: &[SurfacePoint], through: bool) -> Result<Deformation, Error> {
    let handles: Vec<_> = points
        .iter()
        .map(|point| Handle {
            at: [point.at[0], point.at[1], 0.0],
            to: Some(point.to),
            sigma: point.sigma.map(|[u, v]| [u, v, 1.0]),
            weight: point.weight,
        })
        .collect();
    let handles = Handles::new(HandleSpace::World, &handles)?;
    let base = Base::keep(0.0);
    if !through {
        let (layout, to) = choose_deviations(&handles, SQUARE, Mode::Displacement)?;
        let values = to.iter().map(|to| (*to).into()).collect();
        return Ok(Deformation::new(layout.gaussians(), values, base));
    }
    let prepared = prepare(&handles, SQUARE, Mode::Displacement, 0.0, 0.0)?;
    let system = System::new(&prepared.layout)?;
    let [x, y, z] = [0, 1, 2]
        .map(|axis: usize| system.solve(prepared.targets.iter().map(|to| to[axis])).coefficients);
    let values = (0..x.len()).map(|index| [x[index], y[index], z[index]]).collect();
    Ok(Deformation::new(prepared.layout.gaussians(), values, base))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(at: [f64; 2], height: f64, sigma: f64) -> SurfacePoint {
        SurfacePoint { at, to: [at[0], at[1], height], sigma: Some([sigma; 2]), weight: 1.0 }
    }

    /// Returns the nine points of algorithms.md, section 9.7. The center point makes a bump; its deviation is `middle`.
    fn bump(middle: f64) -> Vec<SurfacePoint> {
        fn place(k: usize) -> [f64; 2] {
            [(k / 3) as f64 / 2.0, (k % 3) as f64 / 2.0]
        }
        (0..9)
            .map(|k| if k == 4 { point(place(k), 1.0, middle) } else { point(place(k), 0.0, 0.25) })
            .collect()
    }

    #[test]
    fn the_bump_has_the_heights_of_the_published_figure() {
        for (sigma, beside) in
            [(0.25, 0.389_922_2), (0.18, 0.286_561_0), (0.12, 0.107_380_8), (0.06, 0.000_179_0)]
        {
            let mesh = gaussian_surface(&bump(sigma), false, [4, 4]).unwrap();
            fn height(u: usize, v: usize, mesh: &Mesh) -> f64 {
                mesh.positions()[u * 5 + v].z
            }
            let top = 1.0 / (1.0 + 4.0 * libm::exp(-2.0) + 4.0 * libm::exp(-4.0));
            assert!((height(2, 2, &mesh) - top).abs() <= 1e-6, "{sigma}: {}", height(2, 2, &mesh));
            assert!((top - 0.619_347_0).abs() <= 1e-6);
            assert!(
                (height(3, 2, &mesh) - beside).abs() <= 1e-6,
                "{sigma}: {}",
                height(3, 2, &mesh)
            );
        }
    }

    #[test]
    fn the_surface_is_in_the_hull_of_its_points() {
        let mesh = gaussian_surface(&bump(0.1), false, [20, 20]).unwrap();
        for k in 0..100 {
            let k = f64::from(k);
            let direction =
                Vector3::new(libm::sin(k), libm::cos(1.7 * k), libm::sin(2.3 * k + 1.0));
            fn support(
                points: &mut dyn Iterator<Item = Vector3<f64>>,
                direction: Vector3<f64>,
            ) -> f64 {
                points.map(|point| point.dot(&direction)).fold(f64::NEG_INFINITY, f64::max)
            }
            let hull =
                support(&mut bump(0.1).iter().map(|point| Vector3::from(point.to)), direction);
            let surface =
                support(&mut mesh.positions().iter().map(|point| point.coords), direction);
            assert!(surface <= hull + 1e-14, "{surface} {hull}");
        }
    }

    #[test]
    fn a_surface_through_its_points_contains_them() {
        let mesh = gaussian_surface(&bump(0.2), true, [2, 2]).unwrap();
        for (vertex, point) in mesh.positions().iter().zip(bump(0.2)) {
            assert!((vertex - Point3::from(point.to)).norm() <= 1e-12, "{vertex}");
        }
    }

    #[test]
    fn normals_are_those_of_the_surface() {
        let mesh = gaussian_surface(&bump(0.25), false, [200, 200]).unwrap();
        let (exact, faces) = (mesh.vertex().vectors("normal").unwrap(), mesh.vertex_normals());
        for (vertex, (exact, faces)) in exact.iter().zip(&faces).enumerate() {
            let inside = (1..200).contains(&(vertex / 201)) && (1..200).contains(&(vertex % 201));
            let angle = (Vector3::from(*exact) - faces).norm();
            assert!(!inside || angle <= 1e-3, "{vertex}: {angle}");
        }
        assert!(exact[200 * 100 + 300][2] > 0.0);
    }

    #[test]
    fn invalid_parameters_are_rejected() {
        let error = gaussian_surface(&[], false, [1, 1]).unwrap_err();
        assert_eq!(error.to_string(), "a surface needs at least one control point");
        assert!(gaussian_surface(&bump(0.1), false, [0, 1]).is_err());
        assert!(gaussian_surface(&bump(0.1), false, [usize::MAX, 2]).is_err());
        assert!(gaussian_surface(&bump(-0.1), false, [1, 1]).is_err());
        let twice = [point([0.5; 2], 0.0, 0.1), point([0.5; 2], 1.0, 0.1)];
        assert!(gaussian_surface(&twice, false, [1, 1]).is_ok());
        let error = gaussian_surface(&twice, true, [1, 1]).unwrap_err();
        let conflicting = "handles 0 and 1 have the same position but different targets; remove one of them, or give both the same target";
        assert_eq!(error.to_string(), conflicting);
    }
}
