//! Updates a shape after some vertices of its mesh have moved. The cost grows with the number of moved vertices, plus one copy of each
//! column that changes.

use std::collections::BTreeMap;
use std::ops::Range;
use std::slice;

use bytemuck::Pod;
use maquette_value::parallel::*;
use maquette_value::{Column, Mesh};

use super::{
    Leaning, Normalization, Normals, Paint, SeparateVertices, Shape, Triangulation, VertexData,
};

impl Shape {
    /// Returns this shape updated for a changed mesh. The result equals that of [`new`](Self::new). Returns `None` if more than the
    /// positions of vertices has changed, or if the number of display vertices changes.
    pub(super) fn update(
        &self,
        mesh: &Mesh,
        is_solid: bool,
        normalization: Normalization,
    ) -> Option<Self> {
        let is_alike =
            !self.is_split && self.is_solid == is_solid && self.normalization == normalization;
        let can_lean = self.computed.is_some();
        if !is_alike || can_lean && mesh.faces().sides().is_none() {
            return None;
        }
        let moved =
            mesh.moved_since(&self.mesh).filter(|_| mesh.materials() == self.mesh.materials())?;
        let count = mesh.positions().len();
        // Give up if most vertices have moved: an update would be as slow as building the shape again.
        if 2 * moved.vertices.iter().map(ExactSizeIterator::len).sum::<usize>() > count {
            return None;
        }
        let touched = match mesh.faces().sides() {
            Some(3) => Vec::new(),
            _ => mesh.faces_at_rows(&moved.vertices),
        };
        let recut: Vec<_> = touched
            .iter()
            .filter(|&&face| {
                let face = face as usize;
                !mesh.face_triangles(face).eq(self.mesh.face_triangles(face))
            })
            .collect();
        // Give up: if the faces differ in their numbers of corners, the face of a triangle cannot be computed from the triangle's index.
        if !recut.is_empty() && mesh.faces().sides().is_none() {
            return None;
        }
        let mut bent = self.bent.clone();
        if !recut.is_empty() {
            bent.retain(|face| touched.binary_search(face).is_err());
            bent.extend(touched.iter().filter(|face| !mesh.is_fan(**face as usize)));
            bent.sort_unstable();
        }
        let (paint, normals) = (Paint::new(mesh), Normals::new(mesh));
        // Leave out the list of triangles. It exists only if the faces differ in their numbers of corners, and then there are no leaning
        // triangles here.
        let cut = Triangulation { mesh, listed: None, bent };
        let turned = match (&self.computed, normals.computed_normals()) {
            (Some(before), Some(now)) => now.changed_rows(before)?,
            _ => moved.normals,
        };
        let leaning = match can_lean {
            true => {
                self.updated_leaning(mesh, &normals, &cut, &[&moved.vertices[..], &turned].concat())
            }
            false => Vec::new(),
        };
        let shared = |triangle| cut.vertices(triangle, mesh.faces().corners());
        let separate = SeparateVertices::new(&leaning, count, shared);
        if separate.end() != self.origins.len() {
            return None;
        }
        let mut triangles =
            BTreeMap::from_iter(self.leaning.iter().map(|it| (it.triangle, shared(it.triangle))));
        let of_face = cut.of_face();
        let of_recut = recut.iter().flat_map(|face| (**face as usize * of_face..).take(of_face));
        triangles.extend(of_recut.map(|triangle| (triangle, shared(triangle))));
        separate
            .patch(&leaning, shared, |triangle, vertices| _ = triangles.insert(triangle, vertices));
        triangles.retain(|&triangle, vertices| self.triangles[triangle] != *vertices);
        let rows = triangles
            .keys()
            .map(|&triangle| triangle as u32..triangle as u32 + 1)
            .collect::<Vec<_>>();
        let triangles =
            self.triangles.with_rows(&rows, &triangles.into_values().collect::<Vec<_>>());

        let data = VertexData {
            mesh,
            normalization,
            paint: &paint,
            normals: &normals,
            firsts: None,
            separate: &separate,
        };
        let separate_rows = count as u32..separate.end() as u32;
        let only = slice::from_ref(&separate_rows);
        let origins = update_rows(&self.origins, only, |k| data.origin(k));
        Some(Self {
            mesh: mesh.clone(),
            normalization,
            is_solid,
            positions: update_rows(&self.positions, &[&moved.vertices, only].concat(), |k| {
                data.position(k)
            }),
            normals: update_rows(&self.normals, &[&turned, only].concat(), |k| data.normal(k)),
            colors: self.colors.as_ref().map(|colors| update_rows(colors, only, |k| data.color(k))),
            uv: self.uv.as_ref().map(|uv| update_rows(uv, only, |k| data.uv(k))),
            triangles,
            material_runs: self.material_runs.clone(),
            fields: self.fields.clone(),
            origins,
            computed: normals.computed_normals().cloned(),
            leaning,
            is_split: false,
            bent: cut.bent,
        })
    }

    /// Returns the leaning triangles after the given ranges of vertices have changed.
    fn updated_leaning(
        &self,
        mesh: &Mesh,
        normals: &Normals<'_>,
        cut: &Triangulation<'_>,
        vertices: &[Range<u32>],
    ) -> Vec<Leaning> {
        let touched = mesh.faces_at_rows(vertices).into_iter();
        let of_face = cut.of_face();
        let touched =
            touched.flat_map(|face| face as usize * of_face..(face as usize + 1) * of_face);
        let touched = Vec::from_iter(touched);
        let mut leaning: Vec<Leaning> = touched
            .par_iter()
            .filter_map(|&triangle| normals.find_leaning(mesh, cut, triangle))
            .collect();
        leaning
            .extend(self.leaning.iter().filter(|it| touched.binary_search(&it.triangle).is_err()));
        leaning.sort_unstable_by_key(|it| it.triangle);
        leaning
    }
}

/// Computes the given rows of a column again. If nothing changes, returns the same column without copying it.
fn update_rows<T: Pod + PartialEq + Send + Sync>(
    before: &Column<T>,
    rows: &[Range<u32>],
    item: impl Fn(usize) -> T,
) -> Column<T> {
    let indices: Vec<_> = rows.iter().cloned().flatten().map(|k| k as usize).collect();
    let items: Vec<_> = indices.iter().map(|&k| item(k)).collect();
    let is_same = indices.iter().zip(&items).all(|(&k, item)| before[k] == *item);
    if is_same { before.clone() } else { before.with_rows(rows, &items) }
}

#[cfg(test)]
mod tests {
    use maquette_value::rng::Random;
    use maquette_value::{Attribute, Faces, Image};
    use nalgebra::{Point3, Vector3};

    use super::*;

    /// Creates a sheet of triangles or quads with spikes, so that some triangles lean.
    fn sheet(width: u32, sides: usize) -> Mesh {
        let cells =
            (0..(width - 1) * (width - 1)).map(|k| (k / (width - 1)) * width + k % (width - 1));
        let corners =
            cells.flat_map(|a| [a, a + 1, a + width + 1, a + width].into_iter().take(sides));
        let faces = Faces::uniform(sides, corners.collect::<Vec<_>>()).unwrap();
        Mesh::new(
            (0..width * width)
                .map(|k: u32| {
                    let [x, y] = [k % width, k / width].map(f64::from);
                    Point3::new(x, y, if k.is_multiple_of(89) { 9.0 } else { 0.3 * libm::sin(x) })
                })
                .collect::<Vec<_>>(),
            faces,
        )
        .unwrap()
    }

    fn shape(mesh: &Mesh) -> Shape {
        let normalization = Normalization { center: Point3::new(32.0, 32.0, 0.0), scale: 64.0 };
        Shape::new(mesh.clone(), false, normalization)
    }

    /// Panics if two shapes differ.
    fn assert_same(now: &Shape, fresh: &Shape) {
        assert_eq!(now.positions, fresh.positions);
        assert_eq!(now.normals, fresh.normals);
        assert_eq!(now.colors, fresh.colors);
        assert_eq!(now.uv, fresh.uv);
        assert_eq!(now.triangles, fresh.triangles);
        assert_eq!(now.origins, fresh.origins);
        assert_eq!(now.leaning, fresh.leaning);
        assert_eq!(now.computed, fresh.computed);
        assert_eq!(now.positions.hash(), Column::from(fresh.positions.to_vec()).hash());
        assert_eq!(now.normals.hash(), Column::from(fresh.normals.to_vec()).hash());
        fn fields(shape: &Shape) -> Vec<(String, [f64; 2])> {
            shape
                .fields
                .iter()
                .map(|field| (field.name.clone(), field.typical_range))
                .collect::<Vec<_>>()
        }
        assert_eq!(fields(now), fields(fresh));
    }

    /// Adds a vertex attribute to a copy of the mesh.
    fn with_vertex_attribute(mesh: &Mesh, name: &str, attribute: Attribute) -> Mesh {
        mesh.clone().with_vertex(name, attribute).unwrap()
    }

    #[test]
    fn updated_shapes_equal_new_ones() {
        let mut dice = Random(5);
        let count = 65 * 65_u32;
        let colors = Attribute::Color((0..count).map(|k| [k as u8, (k / 3) as u8, 7]).collect());
        let heights = Attribute::Number((0..count).map(f64::from).collect());
        let normals = Attribute::Vector(vec![[0.0, 0.6, 0.8]; count as usize].into());
        let (mut leaned, mut others) = (0, 0);
        for sides in [3, 4] {
            let plain = sheet(65, sides);
            let colored = with_vertex_attribute(
                &with_vertex_attribute(&plain, "color", colors.clone()),
                "height",
                heights.clone(),
            );
            let smooth = with_vertex_attribute(&plain, "normal", normals.clone());
            for mut mesh in [plain, colored, smooth] {
                let mut before = shape(&mesh);
                for round in 0..30 {
                    let start = dice.next_below(count as usize) as u32;
                    let row = start..(start + 1 + dice.next_below(9) as u32).min(count);
                    let rows = slice::from_ref(&row);
                    let lift = if round % 3 == 0 { 4.0 } else { 0.02 };
                    let positions: Vec<_> = row
                        .clone()
                        .map(|vertex| {
                            mesh.positions()[vertex as usize]
                                + Vector3::new(0.0, 0.01, lift * dice.even())
                        })
                        .collect();
                    mesh = mesh.with_moved(rows, &positions).unwrap();
                    if let Some(Attribute::Vector(normals)) = mesh.vertex().get("normal") {
                        let turned =
                            normals.with_rows(rows, &vec![[0.6, dice.even(), 0.8]; row.len()]);
                        mesh = with_vertex_attribute(&mesh, "normal", Attribute::Vector(turned));
                    }
                    let fresh = shape(&mesh);
                    leaned += usize::from(fresh.leaning != before.leaning);
                    let now = before.update(&mesh, false, before.normalization);
                    match &now {
                        Some(now) => assert_same(now, &fresh),
                        None => assert_ne!(before.origins.len(), fresh.origins.len()),
                    }
                    others += usize::from(now.is_none());
                    before = now.unwrap_or(fresh);
                }
            }
        }
        assert!(leaned > 20 && others < leaned / 2, "{leaned} {others}");
    }

    #[test]
    fn other_changes_are_not_updates() {
        let mesh = sheet(9, 3);
        let before = shape(&mesh);
        let moved =
            mesh.with_moved(slice::from_ref(&(5..6)), &[Point3::new(5.0, 0.1, 0.3)]).unwrap();
        let normalization = before.normalization;
        assert!(before.update(&moved, false, normalization).is_some());
        assert!(before.update(&moved, true, normalization).is_none());
        assert!(
            before.update(&moved, false, Normalization { scale: 32.0, ..normalization }).is_none()
        );
        let colors = Attribute::Color(vec![[1, 2, 3]; 81].into());
        assert!(
            before
                .update(&with_vertex_attribute(&moved, "color", colors), false, normalization)
                .is_none()
        );
        assert!(before.update(&sheet(9, 4), false, normalization).is_none());
        assert!(before.update(&sheet(8, 3), false, normalization).is_none());
        let uv = with_vertex_attribute(&moved, "uv", Attribute::Pair(vec![[0.2, 0.5]; 81].into()));
        let [red, blue] =
            [[255, 0, 0], [0, 0, 255]].map(|color| Image::new(1, 1, vec![color]).unwrap());
        let before = shape(&uv.clone().with_texture(Some(red)));
        assert!(before.update(&uv.with_texture(Some(blue)), false, normalization).is_none());
        let lifted =
            mesh.positions().iter().map(|position| position + Vector3::z()).collect::<Vec<_>>();
        assert!(
            shape(&mesh)
                .update(&mesh.with_positions(lifted).unwrap(), false, normalization)
                .is_none()
        );
    }
}
