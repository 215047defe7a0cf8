//! Tests with cracks: closed meshes whose faces are not joined along a path.

use std::collections::BTreeMap;

use maquette_value::Extent;
use nalgebra::Vector3;

use super::*;

/// Returns a mesh that is cut along a path of edges: the inner vertices of the path become two.
fn cut_along(mesh: &Mesh, path: &[u32]) -> Mesh {
    let mut faces = mesh.faces().as_triangles().unwrap().to_vec();
    let by_edge: BTreeMap<[u32; 2], usize> = (0..)
        .zip(&faces)
        .flat_map(|(index, &[a, b, c])| [([a, b], index), ([b, c], index), ([c, a], index)])
        .collect();
    let mut points = mesh.positions().to_vec();
    let before = faces.clone();
    for triple in path.windows(3) {
        let [from, vertex, to] = [triple[0], triple[1], triple[2]];
        let new = points.len() as u32;
        points.push(points[vertex as usize]);
        let mut spoke = to;
        while spoke != from {
            let index = by_edge[&[vertex, spoke]];
            let k = before[index].iter().position(|&corner| corner == vertex).unwrap();
            faces[index][k] = new;
            spoke = before[index][(k + 2) % 3];
        }
    }
    triangle_mesh(points, faces)
}

/// Returns a path of edges that visits no vertex twice.
fn random_path(mesh: &Mesh, edges: usize, seed: u64) -> Vec<u32> {
    let mut neighbors = vec![Vec::new(); mesh.positions().len()];
    for &[a, b] in &mesh.edges().vertices {
        neighbors[a as usize].push(b);
        neighbors[b as usize].push(a);
    }
    fn pick(count: usize, k: usize, seed: u64) -> usize {
        (random(seed * 1000 + k as u64) * count as f64) as usize
    }
    let mut path = vec![pick(neighbors.len(), 0, seed) as u32];
    for k in 1..=edges {
        let free: Vec<u32> = neighbors[path[path.len() - 1] as usize]
            .iter()
            .copied()
            .filter(|vertex| !path.contains(vertex))
            .collect();
        let Some(&next) = free.get(pick(free.len(), k, seed)) else { break };
        path.push(next);
    }
    path
}

/// Returns a closed shape with edges of about 1 mm: a ball with smooth bumps.
fn bumpy_ball(seed: u64) -> Mesh {
    let ball = sphere(3);
    fn wave(k: u64, seed: u64) -> f64 {
        1.0 + 4.0 * random(seed * 77 + k)
    }
    let points = ball.positions().iter().map(|point| {
        let bump = libm::sin(wave(1, seed) * point.x + wave(2, seed))
            * libm::cos(wave(3, seed) * point.y + wave(4, seed) * point.z);
        point * (8.0 + bump)
    });
    ball.with_positions(points.collect()).unwrap()
}

/// Returns the mesh with all border vertices shaken by `jitter` times the mean edge length.
fn shake(mesh: &Mesh, jitter: f64, seed: u64) -> Mesh {
    let edges = mesh.edges();
    let length =
        |&[a, b]: &[u32; 2]| (mesh.positions()[a as usize] - mesh.positions()[b as usize]).norm();
    let mean = edges.vertices.iter().map(length).sum::<f64>() / edges.vertices.len() as f64;
    let mut points = mesh.positions().to_vec();
    for (vertex, is_border) in mesh.border_vertices().into_iter().enumerate() {
        if is_border {
            let shift = [0, 1, 2].map(|k| random(seed * 9999 + 3 * vertex as u64 + k) - 0.5);
            points[vertex] += Vector3::from(shift).normalize() * (jitter * mean);
        }
    }
    mesh.with_positions(points).unwrap()
}

/// Returns the largest angle in degrees between the normals of adjacent faces.
fn largest_bend(mesh: &Mesh) -> f64 {
    let edges = mesh.edges();
    let mut normals = vec![Vec::new(); edges.vertices.len()];
    for (face, corners) in mesh.faces().iter().enumerate() {
        let first = mesh.faces().first_corner(face);
        for k in 0..corners.len() {
            normals[edges.of_corner[first + k] as usize]
                .push(mesh.area_vector(corners).normalize());
        }
    }
    let bends = normals.iter().filter_map(|normals| match normals[..] {
        [a, b] => Some(a.angle(&b).to_degrees()),
        _ => None,
    });
    bends.fold(0.0, f64::max)
}

/// Fills a crack and checks that the result is closed and not folded.
fn check_crack(seed: u64, jitter: f64, method: FillMethod) {
    let whole = bumpy_ball(seed);
    let cut = cut_along(&whole, &random_path(&whole, 5 + seed as usize % 36, seed));
    let cracked = shake(&cut, jitter, seed);
    let filled = fill(&cracked, HoleChoice::All, method).unwrap();
    let name = format!("crack {seed}, jitter {jitter}");
    assert_eq!(filled.mesh.edges().faces.iter().filter(|&&faces| faces != 2).count(), 0, "{name}");
    let (bend, most) = (largest_bend(&filled.mesh), largest_bend(&whole));
    // A vertex that moves by the fraction `jitter` of an edge turns faces by about as much, more if these are slender.
    let shaken = (jitter * 8.0).to_degrees();
    assert!(bend <= most + shaken + 1e-6, "{name}: {bend} degrees, {most} in the data");
    assert!(filled.mesh.positions().len() == whole.positions().len(), "{name}");
    if jitter == 0.0 {
        let (a, b) = (Extent::from_mesh(&whole), Extent::from_mesh(&filled.mesh));
        assert!((a.area - b.area).abs() <= 1e-9 * a.area, "{name}");
        assert!((a.volume - b.volume).abs() <= 1e-9 * a.volume, "{name}");
    }
}

#[test]
fn a_hundred_cracks_are_zipped() {
    for seed in 0..100 {
        let jitter = [0.0, 0.0, 1e-9, 1e-6, 1e-3, 1e-2][seed as usize % 6];
        let method = [FillMethod::Flat, FillMethod::ThinPlate][seed as usize % 2].clone();
        check_crack(seed, jitter, method);
    }
}

#[test]
fn vertices_on_one_side_of_a_crack_divide_the_edges_of_the_other() {
    let plate = grid(9, 6, |x, _| 0.05 * x * x);
    // The rows above y = 2 are a mesh of their own whose lowest row has twice as many vertices.
    let faces = plate.faces().as_triangles().unwrap();
    let is_low =
        |face: &[u32; 3]| face.iter().all(|&vertex| plate.positions()[vertex as usize].y <= 2.0);
    let low: Vec<u32> = (0..).zip(faces).filter(|(_, face)| is_low(face)).map(|(k, _)| k).collect();
    let high: Vec<u32> =
        (0..).zip(faces).filter(|(_, face)| !is_low(face)).map(|(k, _)| k).collect();
    let (low, high) = (plate.select(&low), plate.select(&high));
    let offset = low.positions().len() as u32;
    let mut points = [&low.positions()[..], &high.positions()[..]].concat();
    let mut all: Vec<[u32; 3]> = low.faces().as_triangles().unwrap().to_vec();
    let mut added = 0;
    for face in high.faces().as_triangles().unwrap() {
        let face = face.map(|vertex| vertex + offset);
        fn on_line(vertex: u32, points: &[Point3<f64>]) -> bool {
            points[vertex as usize].y == 2.0
        }
        match (0..3).find(|&k| on_line(face[k], &points) && on_line(face[(k + 1) % 3], &points)) {
            Some(k) => {
                let [a, b, c] = [0, 1, 2].map(|i| face[(k + i) % 3]);
                let middle = nalgebra::center(&points[a as usize], &points[b as usize]);
                points.push(middle);
                added += 1;
                let new = points.len() as u32 - 1;
                all.extend([[a, new, c], [new, b, c]]);
            }
            None => all.push(face),
        }
    }
    let zipped = fill(&triangle_mesh(points, all), HoleChoice::All, FillMethod::Flat).unwrap();
    assert!(has_warning(&zipped, "borders touch"), "{:?}", zipped.warnings);
    let counts = maquette_value::Topology::from_mesh(&zipped.mesh);
    assert_eq!((counts.components, counts.euler(), counts.vertices), (1, 1, 54 + added));
    assert!(largest_bend(&zipped.mesh) < 7.0);
}

#[test]
fn a_narrow_hole_is_filled_and_not_zipped() {
    let plate = grid(20, 12, |_, _| 0.0);
    for gap in [0.1, 0.2, 0.4] {
        let path: Vec<u32> = (4..16).map(|column| 6 * 20 + column).collect();
        let cut = cut_along(&plate, &path);
        let mut points = cut.positions().to_vec();
        for (vertex, point) in points.iter_mut().enumerate().skip(240) {
            assert_eq!(point.y, 6.0, "{vertex}");
            point.y += gap;
        }
        let holed = cut.with_positions(points).unwrap();
        let filled = fill(&holed, HoleChoice::All, FillMethod::Flat).unwrap();
        assert_eq!(check_kept(&holed, &filled.mesh), 60);
        assert!(!has_warning(&filled, "borders touch"));
    }
}

#[test]
fn a_seam_of_texture_coordinates_stays_a_seam() {
    let whole = bumpy_ball(1);
    let cut = cut_along(&whole, &random_path(&whole, 12, 1));
    let sides = (0..cut.positions().len()).map(|vertex| {
        let point = cut.positions()[vertex];
        [point.x + if vertex < whole.positions().len() { 0.0 } else { 50.0 }, point.y]
    });
    let cut = cut.clone().with_vertex("uv", Attribute::Pair(sides.collect())).unwrap();
    let filled = fill(&cut, HoleChoice::All, FillMethod::Flat).unwrap().mesh;
    assert!(filled.vertex().get("uv").is_none());
    assert_eq!(filled.corner().pairs("uv").map(|uv| uv.len()), Some(3 * whole.faces().len()));
}
