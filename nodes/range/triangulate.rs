//! Converts range images to meshes.
//!
//! The node does not implement `update`: a single moved point changes the median spacing, which affects every triangle.

use maquette_node::{
    Carry, Certainty, Context, Error, Estimate, Forecast, In, Node, Promise, Sizes, Transfer,
    ValueSize,
};
use maquette_value::parallel::*;
use maquette_value::{Attribute, Faces, Mesh, RangeImage};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::grid::border::Border;
use super::grid::grid_triangles::{GridTriangle, double_area, grid_triangles};
use super::grid::joins::{GRAZING, JUMP, Joins};
use super::grid::terraces::Terraces;

/// Joins neighboring cells of a range image to a mesh of triangles that face the sensor, also if the grid is mirrored.
///
/// Each vertex is a cell with its texture coordinate in the picture; vertices along borders are moved to smooth the steps of the grid.
/// Where two parts of the mesh touch in a single cell, the cell gets a vertex for each, so that the mesh is manifold. Surfaces of a
/// redesign or of filled cells are never cut.
///
/// Depths that a sensor measures in coarse steps give terraces; a warning states the steps and the `Denoise` that removes them.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Triangulate {
    /// Range image.
    pub range: In<RangeImage>,
    /// Maximum edge length of a triangle, in multiples of the grid's median spacing. Longer edges bridge the gap between an object and its
    /// background.
    #[schemars(range(min = 0.0))]
    #[serde(default = "default_jump")]
    pub jump: f64,
    /// Maximum angle between the line of sight and the normal of a triangle, on either side. Steeper triangles also bridge the gap between
    /// an object and its background. 90 keeps all.
    #[schemars(range(min = 0.0, max = 90.0), extend("unit" = "deg"))]
    #[serde(default = "default_grazing")]
    pub grazing: f64,
    /// Number of times that borders are smoothed; 0 keeps the steps of the grid. The steps of nearly straight borders are removed, however
    /// long they are. No vertex moves by more than one cell, and none along the border of the grid. Single triangles and pairs, which would
    /// shrink to a point, are left out.
    #[schemars(range(max = 1000))]
    #[serde(default = "default_smooth_border")]
    pub smooth_border: u32,
}

fn default_jump() -> f64 {
    JUMP
}

fn default_grazing() -> f64 {
    GRAZING
}

fn default_smooth_border() -> u32 {
    20
}

impl Node for Triangulate {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &[
        Promise::always("mesh", "Triangles"),
        Promise::always("mesh", "Manifold"),
        Promise::always("mesh", "Oriented"),
        Promise::always("mesh", "Unpinched"),
    ];

    const CARRIES: &'static [Carry] = &[Carry::cells("range", "mesh", Transfer::Kept)];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let points = cx.get(&self.range).points();
        let valid = points.iter().filter(|point| point.x.is_finite()).count() as f64;
        Some(Estimate { bytes: memory(points.len() as f64, valid), help: SMALLER })
    }

    fn forecast(&self, sizes: &Sizes<'_>) -> Option<Forecast> {
        // Most cells have a point and are joined to two triangles with it. How many are empty is not known before the grid is read.
        let cells = sizes.get(&self.range)?.points;
        let mesh = ValueSize::mesh(cells, 2.0 * cells, 6.0 * cells).with_more_bytes(16.0 * cells);
        let forecast = Forecast::by_law(mesh.at_most(Certainty::Guess));
        Some(forecast.with_memory(memory(cells, cells), SMALLER))
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        let range = cx.get(&self.range);
        let mesh = cx.progress().metered(VISITS_PER_CELL * range.points().len(), || {
            triangulate(range, self.jump, self.grazing, self.smooth_border)
        })?;
        if mesh.faces().is_empty() {
            cx.warn(
                "no triangle is left: increase `jump` or `grazing`, or check the range image for holes",
            );
        }
        if let Some(terraces) = Terraces::new(range) {
            cx.warn(terraces.warning());
        }
        Ok((mesh,))
    }
}

/// The number of times that loops visit each cell or triangle, per cell; for progress.
const VISITS_PER_CELL: usize = 13;

/// The help text if the node needs too much memory.
const SMALLER: &str = "use a smaller part of the scan (`ExtractRegion`)";

/// Returns an upper bound of the memory in bytes for a grid with this number of cells, of which `valid` have a point.
fn memory(cells: f64, valid: f64) -> f64 {
    cells * 8.0 + valid * 130.0
}

/// Joins neighboring cells of `range` to triangles that are counter-clockwise as seen from the sensor. If the surface was changed and
/// overhangs, the sensor sees some triangles from the back; then the orientation of the majority decides.
///
/// A triangle is left out if it has no area. It is also left out if an edge is longer than `jump` times the median distance of valid cells
/// that share a side, or if its normal makes an angle of more than `grazing` degrees with the line of sight. These two rules do not apply
/// to [forced triangles](RangeImage::forced_triangles). The angle is measured on either side of the triangle, since a changed surface may
/// overhang.
///
/// The vertices are the cells of the triangles, row by row from the top. If several fans of triangles that share no edge meet in a cell,
/// the cell becomes one vertex per fan, which makes the mesh manifold. Vertices along borders are smoothed `smooth_border` times.
/// Components of one or two triangles, which smoothing would shrink to a point, are left out. The vertex attributes are `uv`, `filled`
/// (true for a filled cell), and `color` if the range image has colors.
///
/// # Errors
/// Returns an error if no cell has a point, or if the grid has more cells than a mesh can hold.
pub fn triangulate(
    range: &RangeImage,
    jump: f64,
    grazing: f64,
    smooth_border: u32,
) -> Result<Mesh, Error> {
    let frame = range.capture_frame()?;
    let (width, height, points) = (range.width(), range.height(), range.points());
    let joins = Joins::new(range, jump, grazing);
    let forced = |quad: usize| range.forced_triangles(quad);
    let mut triangles = grid_triangles(width, height, points, forced, |triangle, corners| {
        double_area(corners).norm_squared() > 0.0
            && (joins.is_on_surface(corners)
                || forced(triangle.quad as usize) & triangle.half.bit() != 0)
    });
    // Reverse all triangles if the grid is mirrored: its columns run to the left or its rows run up.
    let away = triangles
        .par_iter()
        .with_min_len(BLOCK)
        .filter(|triangle| joins.faces_away(triangle.cells(width).map(|cell| points[cell])))
        .count();
    let is_mirrored = triangles.len() < 2 * away;
    let (cells, faces, positions, places) = loop {
        let fans = Fans::new(width, height, &triangles);
        let cells = fans.vertices();
        let faces: Vec<[u32; 3]> = triangles
            .par_iter()
            .with_min_len(BLOCK)
            .map(|triangle| {
                let [a, b, c] = fans.face(width, *triangle);
                if is_mirrored { [a, c, b] } else { [a, b, c] }
            })
            .collect();
        let vertices = || cells.par_iter().with_min_len(BLOCK);
        let mut positions: Vec<Point3<f64>> = vertices().map(|&cell| points[cell]).collect();
        let mut places: Vec<[f64; 2]> =
            vertices().map(|&cell| [(cell % width) as f64, (cell / width) as f64]).collect();
        let border =
            Border::new(&faces, |vertex: u32| fans.wedges[cells[vertex as usize]] != u8::MAX);
        let specks =
            border.smooth(smooth_border, [width, height], &faces, &mut positions, &mut places);
        if specks.is_empty() {
            break (cells, faces, positions, places);
        }
        let mut numbers = 0..;
        triangles
            .retain(|_| numbers.next().is_none_or(|face| specks.binary_search(&face).is_err()));
    };
    let mesh = Mesh::new(positions, Faces::triangles(faces))?.with_frame(Some(frame));
    with_attributes(mesh, range, &cells, &places)
}

/// Adds the attributes of the cells to the vertices. `places` has the column and row of each vertex.
fn with_attributes(
    mesh: Mesh,
    range: &RangeImage,
    cells: &[usize],
    places: &[[f64; 2]],
) -> Result<Mesh, Error> {
    let map = range.registration();
    let uv: Vec<[f64; 2]> =
        places.par_iter().with_min_len(BLOCK).map(|&place| map.uv_from_range(place)).collect();
    let mut mesh = mesh.with_vertex("uv", Attribute::Pair(uv.into()))?;
    if cells.iter().any(|&cell| range.is_filled(cell)) {
        let filled = cells.iter().map(|&cell| u8::from(range.is_filled(cell))).collect();
        mesh = mesh.with_vertex("filled", Attribute::Flag(filled))?;
    }
    if let Some(colors) = range.colors() {
        let colors = cells.iter().map(|&cell| colors[cell]).collect();
        mesh = mesh.with_vertex("color", Attribute::Color(colors))?;
    }
    Ok(mesh)
}

/// The number of vertices or faces that one task processes.
const BLOCK: usize = 8192;

/// The fans of connected triangles around each cell: a cell becomes one vertex per fan.
struct Fans {
    /// For each cell eight bits: a bit is set if the corresponding wedge (sector) around the cell is filled by a triangle; see
    /// [`GridTriangle::wedges`].
    wedges: Vec<u8>,
    /// For each cell, the index of the first vertex that is made from the cell.
    first: Vec<u32>,
}

impl Fans {
    fn new(width: usize, height: usize, triangles: &[GridTriangle]) -> Self {
        let mut wedges = vec![0; width * height];
        for triangle in triangles.iter().until_stopped() {
            for (cell, filled) in triangle.cells(width).into_iter().zip(triangle.wedges()) {
                wedges[cell] |= filled;
            }
        }
        let mut count = 0;
        let first = wedges.iter().until_stopped().map(|&filled| {
            count += fan_count(filled);
            count - fan_count(filled)
        });
        Self { first: first.collect(), wedges }
    }

    /// Returns, for each vertex, the cell from which it is made.
    fn vertices(&self) -> Vec<usize> {
        let cells = self.wedges.iter().enumerate().until_stopped();
        cells.flat_map(|(cell, &filled)| (0..fan_count(filled)).map(move |_| cell)).collect()
    }

    fn face(&self, width: usize, triangle: GridTriangle) -> [u32; 3] {
        let (cells, wedges) = (triangle.cells(width), triangle.wedges());
        [0, 1, 2].map(|k| self.first[cells[k]] + fan_of(self.wedges[cells[k]], wedges[k]))
    }
}

/// Returns the wedges (sectors around a cell) at which a fan begins: filled wedges whose predecessor is not filled.
fn fan_starts(filled: u8) -> u8 {
    filled & !filled.rotate_left(1)
}

/// Returns the number of fans that the filled wedges around a cell form.
fn fan_count(filled: u8) -> u32 {
    if filled == u8::MAX { 1 } else { fan_starts(filled).count_ones() }
}

/// Returns the index of the fan that contains a triangle with the wedges `wedge`. `filled` are the filled wedges around the cell.
fn fan_of(filled: u8, wedge: u8) -> u32 {
    let starts = fan_starts(filled);
    if starts.count_ones() < 2 {
        return 0;
    }
    let up_to_wedge = u8::MAX >> (7 - wedge.trailing_zeros());
    match (starts & up_to_wedge).count_ones() {
        // The last fan may wrap around from the last wedge to the first.
        0 => starts.count_ones() - 1,
        begun => begun - 1,
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::{Mask, RangeError, Registration};
    use proptest::prelude::*;

    use super::*;

    const HOLE: Point3<f64> = Point3::new(f64::NAN, f64::NAN, f64::NAN);

    /// Returns a range image whose valid cells are drawn as `#`. Cells are 1 mm apart and 500 mm away.
    fn range_from_drawing(rows: &[&str]) -> RangeImage {
        let mask = Mask::from_rows(rows);
        let points = mask
            .pixels()
            .iter()
            .enumerate()
            .map(|(index, &valid)| match valid {
                1 => {
                    Point3::new((index % mask.width()) as f64, (index / mask.width()) as f64, 500.0)
                }
                _ => HOLE,
            })
            .collect();
        RangeImage::new(mask.width(), mask.height(), points).unwrap()
    }

    fn plain(range: &RangeImage) -> Mesh {
        triangulate(range, 6.0, 85.0, 0).unwrap()
    }

    /// Returns the number of fans of faces at each vertex. Faces at a vertex are in one fan if edges at the vertex connect them.
    fn fans_per_vertex(mesh: &Mesh) -> Vec<usize> {
        let mut around = vec![Vec::new(); mesh.positions().len()];
        for face in mesh.faces().as_triangles().unwrap() {
            for k in 0..3 {
                around[face[k] as usize].push([face[(k + 1) % 3], face[(k + 2) % 3]]);
            }
        }
        around
            .into_iter()
            .map(|spokes: Vec<[u32; 2]>| {
                let mut fans: Vec<Vec<u32>> = Vec::new();
                for pair in spokes {
                    let (joined, apart): (Vec<_>, Vec<_>) = fans
                        .into_iter()
                        .partition(|fan| pair.iter().any(|spoke| fan.contains(spoke)));
                    fans = apart;
                    fans.push(joined.into_iter().flatten().chain(pair).collect());
                }
                fans.len()
            })
            .collect()
    }

    #[test]
    fn a_mirrored_grid_faces_the_sensor_too() {
        let plain_grid = range_from_drawing(&["####", "####", "##.#"]);
        for (x, y) in [(-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)] {
            let turned = plain_grid.points().iter();
            let turned = turned.map(|point| Point3::new(x * point.x, y * point.y, point.z));
            let mesh = plain(&RangeImage::new(4, 3, turned.collect()).unwrap());
            assert_eq!(mesh.faces().len(), plain(&plain_grid).faces().len());
            for face in mesh.faces().iter() {
                assert!(mesh.area_vector(face).z < 0.0, "{x} {y}");
            }
        }
    }

    #[test]
    fn vertices_are_ordered_by_rows_and_face_the_sensor() {
        let mesh = plain(&range_from_drawing(&["#####", "#####", "#..#.", "...#."]));
        assert_eq!(mesh.positions().len(), 12);
        let mut pairs = mesh.positions().windows(2);
        assert!(pairs.all(|pair| (pair[0].y, pair[0].x) < (pair[1].y, pair[1].x)));
        assert!(mesh.vertex_normals().iter().all(|normal| normal.z < -0.999));
        assert_eq!(mesh.frame().unwrap().depth, 500.0);
    }

    #[test]
    fn parts_that_touch_in_one_cell_get_a_vertex_each() {
        let mesh = plain(&range_from_drawing(&["#..", "###", "..#"]));
        assert_eq!(mesh.faces().as_triangles().unwrap(), [[0, 1, 3], [2, 5, 4]]);
        assert_eq!(mesh.positions()[2], mesh.positions()[3]);
        let mesh = plain(&range_from_drawing(&["##.", "###", "..#"]));
        assert_eq!((mesh.faces().len(), mesh.positions().len()), (4, 6));
    }

    #[test]
    fn every_set_of_wedges_has_as_many_fans_as_runs() {
        for filled in 0..=u8::MAX {
            let starts: Vec<u32> = (0..8)
                .filter(|k| filled >> k & 1 == 1 && filled >> ((k + 7) % 8) & 1 == 0)
                .collect();
            let expected = if filled == u8::MAX { 1 } else { starts.len() as u32 };
            assert_eq!(fan_count(filled), expected);
            for wedge in (0..8).filter(|k| filled >> k & 1 == 1) {
                let fan = fan_of(filled, 1 << wedge);
                assert!(fan < expected, "{filled:b} {wedge}");
                let next = (wedge + 1) % 8;
                if filled >> next & 1 == 1 {
                    assert_eq!(fan_of(filled, 1 << next), fan, "{filled:b} {wedge}");
                }
            }
            let mut fans: Vec<u32> =
                starts.iter().map(|start| fan_of(filled, 1 << start)).collect();
            fans.sort_unstable();
            fans.dedup();
            assert_eq!(fans.len(), starts.len(), "{filled:b}");
        }
    }

    #[test]
    fn joined_triangles_are_never_cut_and_others_are() {
        fn step(cell: usize) -> f64 {
            if cell % 4 < 2 { 500.0 } else { 600.0 }
        }
        let points =
            (0..12).map(|cell| Point3::new((cell % 4) as f64, (cell / 4) as f64, step(cell)));
        let range = RangeImage::new(4, 3, points.collect()).unwrap();
        assert_eq!(plain(&range).faces().len(), 8);
        fn with_joined(bits: [u8; 2], range: &RangeImage) -> Mesh {
            let joined =
                (0..12).map(|cell| if cell % 4 == 1 && cell < 8 { bits[cell / 4] } else { 0 });
            plain(&range.clone().with_joined(joined.collect()).unwrap())
        }
        assert_eq!(with_joined([3, 0], &range).faces().len(), 10);
        assert_eq!(with_joined([2, 12], &range).faces().len(), 11);
        fn has_diagonal(mesh: &Mesh) -> bool {
            mesh.faces().iter().any(|face| face.contains(&2) && face.contains(&5))
        }
        assert!(has_diagonal(&with_joined([12, 0], &range)));
        assert!(!has_diagonal(&with_joined([3, 0], &range)));
    }

    #[test]
    fn borders_lose_their_steps_and_keep_their_position() {
        // The mesh has an inclined border, and a border that is the border of the grid.
        let rows: Vec<String> = (0..24)
            .map(|y| (0..30).map(|x| if 5 * x < 40 + 2 * y { '#' } else { '.' }).collect())
            .collect();
        let rows: Vec<&str> = rows.iter().map(String::as_str).collect();
        let range = range_from_drawing(&rows);
        let [steps, smooth] = [0, 20].map(|rounds| triangulate(&range, 6.0, 85.0, rounds).unwrap());
        assert_eq!(steps.faces(), smooth.faces());
        // Returns the difference between the maximum and minimum distance of the inclined border from a straight line, without its ends.
        fn roughness(mesh: &Mesh) -> f64 {
            let (min, max) = (6..18)
                .map(|row: usize| {
                    let row = row as f64;
                    let points =
                        mesh.positions().iter().filter(|point| (point.y - row).abs() < 0.5);
                    points.map(|point| point.x - 0.4 * point.y).fold(0.0, f64::max)
                })
                .fold((9e9_f64, 0.0_f64), |(a, b), x| (a.min(x), b.max(x)));
            max - min
        }
        assert!(
            roughness(&smooth) < 0.45 * roughness(&steps),
            "{} {}",
            roughness(&smooth),
            roughness(&steps)
        );
        for (old, new) in steps.positions().iter().zip(smooth.positions().iter()) {
            let on_rim = old.x == 0.0 || old.y == 0.0 || old.y == 23.0;
            assert!((new - old).norm() <= if on_rim { 0.0 } else { 1.0 });
        }
        let (Some(Attribute::Pair(uv)), map) = (smooth.vertex().get("uv"), range.registration())
        else {
            panic!("no texture coordinates")
        };
        for (uv, point) in uv.iter().zip(smooth.positions().iter()) {
            let expected_uv = map.uv_from_range([point.x, point.y]);
            assert!((0..2).all(|k| (uv[k] - expected_uv[k]).abs() < 1e-12));
        }
    }

    #[test]
    fn small_holes_keep_the_areas_around_them_and_specks_are_left_out() {
        let range = range_from_drawing(&[
            "............",
            "..##........",
            "..#.....##..",
            "........##..",
            "............",
            "############",
            "############",
            "#####.######",
            "############",
            "####..######",
            "############",
            "############",
        ]);
        let steps = triangulate(&range, 6.0, 85.0, 0).unwrap();
        // The single triangle shrinks faster than the component of two triangles.
        for (rounds, specks) in [(1, 0), (6, 1), (20, 3), (100, 3)] {
            let mesh = triangulate(&range, 6.0, 85.0, rounds).unwrap();
            assert_eq!(steps.faces().len() - mesh.faces().len(), specks, "{rounds}");
            let areas = mesh.faces().iter().map(|face| mesh.area_vector(face).norm());
            let smallest = areas.fold(f64::INFINITY, f64::min);
            assert!(4e-4 < smallest, "{rounds}: {smallest}");
        }
    }

    #[test]
    fn a_step_is_not_bridged() {
        let flat = range_from_drawing(&["####", "####"]);
        fn step(depth: f64, flat: &RangeImage) -> RangeImage {
            let points = flat.points().iter().enumerate().map(|(index, &point)| {
                if index % 4 < 2 { point } else { point + nalgebra::Vector3::z() * depth }
            });
            flat.with_points(points.collect()).unwrap()
        }
        assert_eq!(plain(&step(4.0, &flat)).faces().len(), 6);
        assert_eq!(plain(&step(7.0, &flat)).faces().len(), 4);
        assert_eq!(triangulate(&step(7.0, &flat), 8.0, 85.0, 0).unwrap().faces().len(), 6);
        assert_eq!(triangulate(&step(7.0, &flat), 8.0, 80.0, 0).unwrap().faces().len(), 4);
    }

    #[test]
    fn an_overhang_is_kept() {
        let flat = range_from_drawing(&["######", "######"]);
        let folded = flat.points().iter().enumerate().map(|(cell, point)| match cell % 6 {
            3 => Point3::new(1.25, point.y, point.z),
            _ => *point,
        });
        let mesh = plain(&flat.with_points(folded.collect()).unwrap());
        let away = mesh.faces().iter().filter(|face| mesh.area_vector(face).z > 0.0).count();
        assert_eq!((mesh.faces().len(), away), (10, 2));
    }

    #[test]
    fn vertices_have_the_attributes_of_their_cells() {
        let map = Registration::corners([2, 2], [4, 4]);
        let range = range_from_drawing(&["##", "##"]).with_registration(map);
        assert!(plain(&range).vertex().get("filled").is_none());
        let range = range.with_filled(vec![0, 0, 1, 0]).unwrap();
        let range = range.with_colors(vec![[1; 3], [2; 3], [3; 3], [4; 3]]).unwrap();
        let mesh = plain(&range);
        let uv = mesh.vertex().pairs("uv").unwrap();
        assert_eq!(uv[..], [[0.25, 0.75], [0.75, 0.75], [0.25, 0.25], [0.75, 0.25]]);
        let filled = Attribute::Flag(vec![0, 0, 1, 0].into());
        assert_eq!(mesh.vertex().get("filled"), Some(&filled));
        assert_eq!(mesh.vertex().colors("color").unwrap()[2], [3; 3]);
    }

    #[test]
    fn a_range_image_without_points_is_an_error_and_one_point_makes_no_face() {
        let none = triangulate(&range_from_drawing(&["...", "..."]), 6.0, 85.0, 0);
        assert_eq!(none.unwrap_err().downcast(), Some(&RangeError::NoValidRange));
        let one = plain(&range_from_drawing(&["...", ".#."]));
        assert!(one.faces().is_empty() && one.positions().is_empty());
        let coincident = RangeImage::new(2, 2, vec![Point3::new(0.0, 0.0, 5.0); 4]).unwrap();
        assert!(plain(&coincident).faces().is_empty());
    }

    proptest! {
        #[test]
        fn the_mesh_of_any_grid_is_manifold_and_oriented(
            (width, depths) in (1usize..14, 1usize..14).prop_flat_map(|(width, height)| {
                let depth = prop_oneof![1 => Just(f64::NAN), 3 => 500.0..508.0f64];
                (Just(width), prop::collection::vec(depth, width * height))
            }),
            jump in 1.0..8.0f64,
        ) {
            let points: Vec<_> = depths
                .iter()
                .enumerate()
                .map(|(index, &z)| Point3::new((index % width) as f64, (index / width) as f64, z))
                .collect();
            let range = RangeImage::new(width, depths.len() / width, points).unwrap();
            prop_assume!(range.n_valid() > 0);
            let mesh = triangulate(&range, jump, 89.0, 0).unwrap();
            let edges = mesh.edges();
            prop_assert!(edges.faces.iter().all(|&faces| faces <= 2));
            prop_assert_eq!(edges.misoriented, 0);
            prop_assert!(fans_per_vertex(&mesh).iter().all(|&fans| fans == 1));
        }
    }
}
