//! Tests of the modified butterfly scheme.

use super::*;

fn butterfly(mesh: &Mesh, levels: u32) -> Mesh {
    subdivide(mesh, scheme_options(Scheme::Butterfly, levels, false, Boundary::EdgeAndCorner))
        .unwrap()
}

/// The largest angle, in degrees, between the normals of two faces that share an edge.
fn largest_bend(mesh: &Mesh) -> f64 {
    let normals: Vec<_> =
        mesh.faces().iter().map(|face| mesh.area_vector(face).normalize()).collect();
    let edges = mesh.edges();
    let mut first = vec![None; edges.vertices.len()];
    let mut largest = 0.0f64;
    for (corner, &edge) in edges.of_corner.iter().enumerate() {
        match first[edge as usize] {
            None => first[edge as usize] = Some(corner / 3),
            Some(face) => {
                largest = largest.max(normals[corner / 3].angle(&normals[face]).to_degrees());
            }
        }
    }
    largest
}

#[test]
fn given_vertices_keep_their_bits() {
    fn sharp(mesh: Mesh) -> Mesh {
        let creases = [([0, 1], 10.0), ([1, 2], 1.5), ([0, 2], 0.5)];
        mesh.with_creases(creases).unwrap()
    }
    let mut meshes: Vec<_> = [
        tetrahedron(),
        icosahedron(),
        bipyramid(9),
        wheel(5),
        sheet(4, 6, false),
        sheet(4, 6, true),
    ]
    .into_iter()
    .map(scattered_mesh)
    .collect();
    meshes.push(sharp(scattered_mesh(tetrahedron())));
    for mesh in &meshes {
        let refined = butterfly(mesh, 3);
        let given = mesh.positions().len();
        assert_eq!(refined.positions()[..given], mesh.positions()[..]);
        assert_eq!(refined.faces().len(), 64 * mesh.faces().len());
        assert_eq!(refined.edges().misoriented, 0);
        fn border(mesh: &Mesh) -> usize {
            mesh.edges().faces.iter().filter(|faces| **faces == 1).count()
        }
        assert_eq!(border(&refined), 8 * border(mesh));
        // Affine maps commute with the scheme, so the weights of each new vertex have the sum 1.
        let moved = mesh.positions().iter().map(|p| Point3::new(p.x + 64.0, p.y, p.z)).collect();
        let moved = butterfly(&mesh.with_positions(moved).unwrap(), 3);
        for (a, b) in refined.positions().iter().zip(moved.positions().iter()) {
            assert!((b.x - a.x - 64.0).abs() < 1e-10);
        }
    }
}

#[test]
fn cubics_are_exact_on_the_regular_lattice() {
    const SIDE: u32 = 16;
    fn cubic(x: f64, y: f64) -> f64 {
        0.3 * x * x * x - 0.2 * x * x * y + 0.7 * x * y * y - 0.4 * y * y * y + x * x - y + 2.0
    }
    let faces = (0..SIDE * SIDE).flat_map(|k| {
        let [a, b] = [k / SIDE * (SIDE + 1) + k % SIDE, (k / SIDE + 1) * (SIDE + 1) + k % SIDE];
        [[a, a + 1, b + 1], [a, b + 1, b]]
    });
    let positions = (0..(SIDE + 1) * (SIDE + 1)).map(|k| {
        let [x, y] = [k % (SIDE + 1), k / (SIDE + 1)].map(|k| f64::from(k) / f64::from(SIDE));
        Point3::new(x, y, cubic(x, y))
    });
    let lattice =
        Mesh::new(positions.collect::<Vec<_>>(), Faces::triangles(faces.collect())).unwrap();
    let refined = butterfly(&lattice, 3);
    let mut inside = 0;
    for point in refined.positions().iter() {
        // The border affects three cells of the lattice.
        let is_inside = [point.x, point.y].iter().all(|x| (0.2..0.8).contains(x));
        inside += u32::from(is_inside);
        let allowed = if is_inside { 1e-14 } else { 0.02 };
        assert!((point.z - cubic(point.x, point.y)).abs() <= allowed, "{point}");
    }
    assert!(inside > 5000);
}

#[test]
fn borders_and_creases_follow_the_four_point_rule_of_their_own_vertices() {
    let sheet = scattered_mesh(sheet(4, 6, false));
    let edges = sheet.edges();
    let border: Vec<u32> =
        (0..edges.vertices.len() as u32).filter(|&e| edges.faces[e as usize] == 1).collect();
    let refined = butterfly(&sheet, 1);
    fn at(vertex: u32, sheet: &Mesh) -> Vector3<f64> {
        sheet.positions()[vertex as usize].coords
    }
    let mut ordinary = 0;
    for &edge in &border {
        let [a, b] = edges.vertices[edge as usize];
        fn beyond(
            from: u32,
            to: u32,
            sheet: &Mesh,
            border: &[u32],
            edges_vertices: &[[u32; 2]],
        ) -> Option<u32> {
            let faces = sheet.faces().corners().iter().filter(|&&corner| corner == from).count();
            let others = border.iter().flat_map(|&edge| {
                let [p, q] = edges_vertices[edge as usize];
                [(p, q), (q, p)]
            });
            let other = others.filter(|&(p, q)| p == from && q != to).map(|(_, q)| q).next();
            other.filter(|_| faces > 1)
        }
        let expected = match (
            beyond(a, b, &sheet, &border, &edges.vertices),
            beyond(b, a, &sheet, &border, &edges.vertices),
        ) {
            (Some(p), Some(q)) => {
                ordinary += 1;
                (at(a, &sheet) + at(b, &sheet)) * 0.5625 - (at(p, &sheet) + at(q, &sheet)) * 0.0625
            }
            (Some(p), None) => at(a, &sheet) * 0.75 + at(b, &sheet) * 0.375 - at(p, &sheet) * 0.125,
            (None, Some(q)) => at(a, &sheet) * 0.375 + at(b, &sheet) * 0.75 - at(q, &sheet) * 0.125,
            (None, None) => (at(a, &sheet) + at(b, &sheet)) * 0.5,
        };
        let found = refined.positions()[sheet.positions().len() + edge as usize];
        assert!((found.coords - expected).norm() < 1e-14);
    }
    assert!(ordinary > 5);

    // A cube with sharp edges stays a cube.
    let cube = cube(10.0);
    let refined = butterfly(&cube, 3);
    let [low, high] = cube
        .positions()
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| [low.min(p.x), high.max(p.x)]);
    for point in refined.positions().iter() {
        let on_side =
            point.coords.iter().any(|x| (x - low).abs() < 1e-14 || (x - high).abs() < 1e-14);
        assert!(on_side, "{point}");
    }
}

#[test]
fn surfaces_are_smooth_also_at_vertices_with_any_number_of_neighbors() {
    for count in [3, 4, 5, 7, 9, 12] {
        let mesh = mesh_at(
            bipyramid(count),
            &(0..count + 2)
                .map(|k| match k {
                    _ if k < count => {
                        let angle = std::f64::consts::TAU * f64::from(k) / f64::from(count);
                        [libm::cos(angle), libm::sin(angle), 0.0]
                    }
                    _ if k == count => [0.0, 0.0, 1.0],
                    _ => [0.0, 0.0, -1.0],
                })
                .collect::<Vec<_>>(),
        );
        let bends = [3, 4, 5].map(|levels| largest_bend(&butterfly(&mesh, levels)));
        // A limit with an edge or a tip would keep its bend.
        assert!(bends[1] < 0.75 * bends[0] && bends[2] < 0.75 * bends[1], "{count}: {bends:?}");
    }
}

#[test]
fn attributes_and_smooth_corners_are_carried() {
    let mesh = octahedron();
    let corners = mesh.faces().corners().len();
    let place = mesh.faces().corners().iter().map(|&v| mesh.positions()[v as usize].into());
    let place: Vec<[f64; 3]> = place.collect();
    let mesh = mesh
        .with_vertex("height", Attribute::Number((0..6).map(f64::from).collect()))
        .unwrap()
        .with_corner("place", Attribute::Vector(place.into()))
        .unwrap();
    let options = scheme_options(Scheme::Butterfly, 2, false, Boundary::EdgeAndCorner);
    let smooth = subdivide(&mesh, Subdivision { corners: Corners::Smooth, ..options }).unwrap();
    assert_eq!(smooth.faces().corners().len(), 16 * corners);
    assert!(matches!(smooth.vertex().get("height"), Some(Attribute::Number(_))));
    // Corner data that are positions are refined as positions.
    let Some(Attribute::Vector(place)) = smooth.corner().get("place") else { panic!() };
    for (place, &vertex) in place.iter().zip(smooth.faces().corners().iter()) {
        assert!((Point3::from(*place) - smooth.positions()[vertex as usize]).norm() < 1e-14);
    }
}

#[test]
fn a_limit_is_refused() {
    let options = scheme_options(Scheme::Butterfly, 1, true, Boundary::EdgeAndCorner);
    let error = subdivide(&octahedron(), options).unwrap_err().to_string();
    assert!(error.starts_with("`Butterfly` has no formulas for its limit surface"), "{error}");
}
