//! A hash of meshes and point sets that does not depend on the order of their elements.

use maquette_value::parallel::*;
use maquette_value::rng;
use maquette_value::rng::STEP;
use maquette_value::{AnyValue, Attributes, Faces, Mesh, Points};

use crate::parts::{GoldenColumn, GoldenParts};

/// Returns the sum of the hashes of all faces and vertices, or of all points. Returns `None` for a value whose order matters.
pub(crate) fn unordered_hash(value: &AnyValue) -> Option<u128> {
    if let Some(mesh) = value.get::<Mesh>() {
        return Some(mesh_mark(mesh));
    }
    value.get::<Points>()?;
    let parts = GoldenParts::from_value(value)?;
    let columns = Vec::from_iter(&parts.columns);
    let count = columns.first().map_or(0, |column| column.count);
    Some(sum(&marks(&columns, count)))
}

/// Returns the sum of the hashes (marks) of all elements of a mesh. The hash of a face does not depend on the corner at which it begins.
pub(super) fn mesh_mark(mesh: &Mesh) -> u128 {
    fn columns(attributes: &Attributes) -> Vec<(usize, Vec<u64>)> {
        columns_of(attributes)
    }
    let places: &[f64] = bytemuck::cast_slice(mesh.positions());
    let mut vertex = columns(mesh.vertex());
    let (corner, face) = (columns(mesh.corner()), columns(mesh.face()));
    let n = [mesh.positions().len(), mesh.faces().corners().len(), mesh.faces().len()];
    vertex.push((3, places.iter().map(|x| x.to_bits()).collect()));
    let [vertex, corner, face] =
        [(vertex, n[0]), (corner, n[1]), (face, n[2])].map(|(columns, count)| {
            Vec::from_iter(
                (0..count)
                    .into_par_iter()
                    .map(|k: usize| {
                        let numbers =
                            columns.iter().flat_map(|(width, bits)| &bits[k * width..][..*width]);
                        numbers.fold(1, |mark, &bits| mix(mark, bits))
                    })
                    .collect::<Vec<u64>>(),
            )
        });
    let faces: Vec<u64> = (0..n[2])
        .into_par_iter()
        .map(|index: usize| {
            let first = mesh.faces().first_corner(index);
            let corners = mesh.faces().face(index).iter().zip(&corner[first..]);
            let ring: Vec<u64> = corners.map(|(&v, &c)| mix(vertex[v as usize], c)).collect();
            let start = (0..ring.len()).min_by_key(|&k| ring[k]).unwrap_or(0);
            let turned = ring[start..].iter().chain(&ring[..start]);
            turned.fold(face[index], |mark, &corner| mix(mark, corner))
        })
        .collect();
    let creases = mesh.creases().map(|([a, b], sharpness)| {
        let [a, b] = [a, b].map(|end| vertex[end as usize]);
        mix(mix(a.min(b), a.max(b)), sharpness.to_bits())
    });
    let creases: Vec<u64> = creases.collect();
    // Represent the materials by the hash of an empty mesh that has them.
    let bare = Mesh::new(Vec::new(), Faces::triangles(Vec::new())).ok();
    let texture = bare.filter(|_| !mesh.materials().is_empty()).map_or(0, |bare| {
        let hash = maquette_value::hash_of(&bare.with_materials(mesh.materials().clone()));
        u64::from_le_bytes(hash.0[..8].try_into().unwrap_or_default())
    });
    let frame = mesh.frame().map_or(0, |frame| {
        let mut numbers =
            frame.camera.map_or(vec![], |camera| [camera.focal, camera.center].concat());
        numbers.extend(frame.picture.map(|size| size as f64));
        numbers.extend(frame.world_from_camera.iter().flatten());
        numbers.iter().fold(frame.depth.to_bits(), |mark, x| mix(mark, x.to_bits()))
    });
    [sum(&vertex), sum(&faces), sum(&creases), u128::from(mix(texture, frame))].iter().fold(
        0,
        |all, part: &u128| {
            all.rotate_left(17).wrapping_mul(0x9e37_79b9_7f4a_7c15_f39c_c060_5ced_c835) ^ part
        },
    )
}

fn columns_of(attributes: &Attributes) -> Vec<(usize, Vec<u64>)> {
    let parts = GoldenParts::attribute_columns(attributes);
    parts
        .iter()
        .map(|part| (part.width, part.numbers.iter().map(|x| x.to_bits()).collect()))
        .collect()
}

fn marks(columns: &[&GoldenColumn], count: usize) -> Vec<u64> {
    (0..count)
        .into_par_iter()
        .map(|k: usize| {
            let numbers = columns.iter().flat_map(|column| column.element(k));
            numbers.fold(1, |mark, x| mix(mark, x.to_bits()))
        })
        .collect()
}

fn sum(marks: &[u64]) -> u128 {
    marks
        .par_iter()
        .map(|&mark| u128::from(mix(mark, 1)) << 64 | u128::from(mix(mark, 2)))
        .reduce(|| 0, u128::wrapping_add)
}

/// Mixes more bits into a hash. The result depends on the order in which bits are mixed in.
fn mix(mark: u64, bits: u64) -> u64 {
    rng::mix((mark ^ bits).wrapping_add(STEP)).wrapping_add(mark.rotate_left(23))
}
