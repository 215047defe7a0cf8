"""Faults that `run.py` inserts into the program, one at a time: the graph tests must notice them.

Each is (file, old text, new text, kind). The old text must occur exactly once before the tests of the file. The list was written from the
code, without looking at the tests, before any of the faults was tried.
"""

MUTATIONS = [
    # Pictures
    ("nodes/image/filter/morphology.rs", "spread_both(mask, radius, [0, 1])", "spread_both(mask, radius, [1, 0])", "swapped"),
    ("nodes/image/filter/morphology.rs", "(center + radius + 1).min(count)", "(center + radius).min(count)", "off by one"),
    ("nodes/image/segment/otsu.rs", "moment_below += count * level;", "moment_below += count * (level + 1);", "off by one"),
    ("nodes/image/filter/gaussian.rs", "const CUTOFF: f64 = 4.0;", "const CUTOFF: f64 = 3.0;", "default"),
    ("nodes/image/filter/gaussian.rs", "libm::exp(-0.5 * (k * k) as f64", "libm::exp(-0.6 * (k * k) as f64", "weight"),
    ("nodes/image/filter/hysteresis.rs", "word >> 1 | before | after << (WORD - 1)", "word >> 1 | before & after << (WORD - 1)", "dropped"),
    ("nodes/image/filter/hysteresis.rs", "[0, STRIP_ROWS - 1].contains(", "[1, STRIP_ROWS - 1].contains(", "off by one"),
    ("nodes/image/fill_contour.rs", "outside.collect(), width, height), Connectivity::Four)", "outside.collect(), width, height), Connectivity::Eight)", "swapped"),
    ("nodes/image/thin.rs", "has_all(north | east | west, neighborhood)", "has_all(north | east | south, neighborhood)", "swapped"),
    ("nodes/image/thin.rs", "(s || sw || !nw) && w", "(s || sw || nw) && w", "sign"),
    ("nodes/image/edges.rs", "fn default_low() -> f64 {\n    0.4", "fn default_low() -> f64 {\n    0.5", "default"),
    ("nodes/image/segment/components.rs", "self.join_rows(start - self.last..start, start..start + below.first, reach);", "self.join_rows(start - self.last..start, start..start + below.first, 0 * reach);", "dropped"),
    # Range data
    ("nodes/range/grid/footprint.rs", "scale * (cell as f64 + side) + offset + 0.5)", "scale * (cell as f64 + side) + offset)", "dropped"),
    ("nodes/range/grid/footprint.rs", "const HALF: f64 = 0.5 - 1e-9;", "const HALF: f64 = 0.6 - 1e-9;", "default"),
    ("nodes/range/holes/range_holes.rs", "fill && !hole.touches_border", "fill && hole.touches_border", "sign"),
    ("nodes/range/foreground.rs", "Select::Near { color, distance, lightness: 1.0 }", "Select::Near { color, distance, lightness: 0.5 }", "weight"),
    ("nodes/range/foreground.rs", "let is_covered = -0.5 <= at && at <= grid[axis] as f64 - 0.5;", "let is_covered = 0.0 <= at && at <= grid[axis] as f64 - 1.0;", "comparison"),
    ("nodes/range/extract_region.rs", "let pieces = label(&usable, Connectivity::Four);", "let pieces = label(&usable, Connectivity::Eight);", "swapped"),
    ("nodes/range/extract_region.rs", "u8::from(point.x.is_nan() || range.is_filled(cell as usize))", "u8::from(range.is_filled(cell as usize))", "dropped"),
    ("nodes/base/unit.rs", "Self::Inch => 25.4,", "Self::Inch => 25.0,", "weight"),
    ("nodes/range/grid/joins.rs", "normal.dot(&ray).abs() >= self.min_cosine", "normal.dot(&ray) >= self.min_cosine", "dropped"),
    ("nodes/range/grid/contour.rs", "let mut to = (from + 1) % 8;", "let mut to = (from + 2) % 8;", "off by one"),
    ("nodes/base/linear/laplace.rs", "const TOLERANCE: f64 = 1e-12;", "const TOLERANCE: f64 = 1e-6;", "default"),
    ("nodes/base/linear/laplace.rs", "(row + 1 < height).then(|| cell + width),", "(row + 2 < height).then(|| cell + width),", "off by one"),
    # Nets and surfaces
    ("nodes/nurbs/net/rays.rs", "const SMOOTHING: f64 = 2.0;", "const SMOOTHING: f64 = 1.0;", "default"),
    ("nodes/nurbs/net/rays.rs", "|[x, y]| libm::atan2(-y, *x)", "|[x, y]| libm::atan2(*y, *x)", "sign"),
    ("nodes/nurbs/loft.rs", "const PIECES: usize = 256;", "const PIECES: usize = 16;", "default"),
    ("nodes/nurbs/grid/within.rs", "|(least, _)| distance < least)", "|(least, _)| distance > least)", "comparison"),
    ("nodes/nurbs/grid/refine.rs", "map.scale[axis] * (0.5 / factors[axis] - 0.5)", "map.scale[axis] * (0.5 / factors[axis])", "dropped"),
    ("nodes/nurbs/grid/refine.rs", "(after.coordinate[k] - before.coordinate[k]) / 2.0,", "after.coordinate[k] - before.coordinate[k],", "weight"),
    ("nodes/nurbs/grid/refine.rs", "let factors = [right, down].map", "let factors = [down, right].map", "swapped axis"),
    ("nodes/nurbs/grid/disk.rs", "[(from[0] + to[0]) / 2.0, (from[1] + to[1]) / 2.0]", "[(from[0] + to[0]) / 2.0, from[1]]", "formula"),
    ("nodes/nurbs/grid/disk.rs", "[true, true, false, true] => triangles.push([a, d, b]),", "[true, true, false, true] => {}", "dropped"),
    ("nodes/nurbs/fit/fit_net.rs", "FitParameters::Chord => parameters(net, along, |distance| distance),", "FitParameters::Chord => parameters(net, along, f64::sqrt),", "formula"),
    ("nodes/nurbs/fit/fit_net.rs", "V => (net.columns(), order[1], counts[1]),", "V => (net.columns(), order[0], counts[1]),", "swapped axis"),
    ("nodes/nurbs/offset_net.rs", "+ axis.cross(&direction) * sin", "- axis.cross(&direction) * sin", "sign"),
    ("nodes/nurbs/offset_net.rs", "spoke * spoke.transpose() / count", "spoke * spoke.transpose()", "weight"),
    ("nodes/nurbs/blend.rs", "let share = smoothstep(target.depth / band);", "let share = (target.depth / band).min(1.0);", "formula"),
    ("nodes/nurbs/blend.rs", "flag == 1 || range.point(cell as usize).is_none()", "range.point(cell as usize).is_none()", "dropped"),
    ("nodes/nurbs/net/polar.rs", "let start = (order - 2) as f64 / 2.0;", "let start = (order - 1) as f64 / 2.0;", "off by one"),
    ("nodes/nurbs/net/harmonic.rs", "(((lengths[a] + lengths[b]) / 2.0).round() as usize + 1)", "(((lengths[a] + lengths[b]) / 2.0).round() as usize + 2)", "off by one"),
    ("nodes/nurbs/tessellate.rs", "Ok(surface.tessellate(u, v)?)", "Ok(surface.tessellate(v, u)?)", "swapped axis"),
    # Subdivision
    ("nodes/subdivision/masks/vertex_rings.rs", "smooth, [2.0 / 3.0, 1.0 / 6.0]", "smooth, [0.6, 0.2]", "weight"),
    ("nodes/subdivision/masks/loop_masks.rs", "(libm::sin(angle), libm::cos(angle))", "(libm::cos(angle), libm::sin(angle))", "swapped"),
    ("nodes/subdivision/refine/primal.rs", ".map(|face| face / 4)", ".map(|face| face / 5)", "off by one"),
    ("nodes/subdivision/masks/sharpness.rs", "!ring.closed && ring.n_faces() <= 1;", "!ring.closed && ring.n_faces() <= 2;", "off by one"),
    # Meshes
    ("nodes/mesh/merge.rs", "shift: Vector3::new(pose[(0, 3)], pose[(1, 3)], pose[(2, 3)])", "shift: Vector3::new(pose[(3, 0)], pose[(3, 1)], pose[(3, 2)])", "swapped"),
    ("nodes/mesh/merge.rs", "Attribute::Flag(_) => join!(Flag, Some(0)),", "Attribute::Flag(_) => join!(Flag, None::<u8>),", "dropped"),
    ("nodes/mesh/turned_faces.rs", "places.extend(others.rev());", "places.extend(others);", "dropped"),
    ("nodes/mesh/texture.rs", "let [s, t] = [0, 1].map(|k| (camera.center[k] + 0.5) / size[k]);", "let [s, t] = [0, 1].map(|k| camera.center[k] / size[k]);", "off by one"),
    # Values
    ("src/value/knots/generate.rs", "index - 1.0", "index", "formula"),
    ("src/value/range.rs", "let middle = depths.len() / 2;", "let middle = depths.len() / 3;", "weight"),
    ("src/value/surface/grid.rs", "(nx, ny, nz) = (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)", "(nx, ny, nz) = (az * by - ay * bz, ax * bz - az * bx, ay * bx - ax * by)", "sign"),
    ("src/value/labels.rs", "sum[0] += (count * (start + last) / 2) as u64;", "sum[0] += (count * (start + last + 1) / 2) as u64;", "off by one"),
    # Files
    ("src/format/ptx.rs", "(rows - 1 - index % rows) * columns + index / rows", "(index % rows) * columns + index / rows", "swapped axis"),
    ("src/format/depth.rs", "pinhole.unproject([(cell % width) as f64, (cell / width) as f64], z)", "pinhole.unproject([(cell / width) as f64, (cell % width) as f64], z)", "swapped axis"),
    ("src/format/png.rs", "65535.0 / (max - min)", "65536.0 / (max - min)", "off by one"),
    ("src/format/glb/scene.rs", "[s, 1.0 - t]", "[s, t]", "sign"),
    ("src/format/step.rs", "[(low_v, \".T.\"), (high_u, \".T.\"), (high_v, \".F.\"), (low_u, \".F.\")]", "[(low_v, \".T.\"), (high_u, \".T.\"), (high_v, \".T.\"), (low_u, \".F.\")]", "sign"),
    ("src/format/stl.rs", "let [a, b, c] = triangle.map(|vertex", "let [a, c, b] = triangle.map(|vertex", "swapped"),
]
