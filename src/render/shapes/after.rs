//! A shape after some vertices have moved: it costs what has moved, and a copy of each column in which something is other.

use std::collections::BTreeMap;
use std::ops::Range;
use std::slice;

use bytemuck::Pod;
use maquette_value::parallel::*;
use maquette_value::{Column, Mesh};

use super::{Leaning, Normals, Own, Paint, Ruler, Seen, Shape, Triangles};

impl Shape {
    /// What [`new`](Self::new) makes of this mesh, if it is the one here with some vertices elsewhere and there are as many vertices to be
    /// shown.
    pub(super) fn after(&self, mesh: &Mesh, is_solid: bool, ruler: Ruler) -> Option<Self> {
        let is_alike = !self.is_split && self.is_solid == is_solid && self.ruler == ruler;
        let can_lean = self.computed.is_some();
        if !is_alike || can_lean && mesh.faces().sides().is_none() {
            return None;
        }
        let moved =
            mesh.moved_since(&self.mesh).filter(|_| mesh.materials() == self.mesh.materials())?;
        let count = mesh.positions().len();
        // To change most of it takes as long as to make it.
        if 2 * moved.vertices.iter().map(ExactSizeIterator::len).sum::<usize>() > count {
            return None;
        }
        let touched = match mesh.faces().sides() {
            Some(3) => Vec::new(),
            _ => mesh.faces_with(&moved.vertices),
        };
        let recut: Vec<_> = touched
            .iter()
            .filter(|&&face| {
                let cut = |mesh: &Mesh| mesh.face_triangles(face as usize);
                !cut(mesh).eq(cut(&self.mesh))
            })
            .collect();
        // The triangles of mixed faces have no numbers that tell their faces.
        if !recut.is_empty() && mesh.faces().sides().is_none() {
            return None;
        }
        let mut bent = self.bent.clone();
        if !recut.is_empty() {
            bent.retain(|face| touched.binary_search(face).is_err());
            bent.extend(touched.iter().filter(|face| !mesh.is_fan(**face as usize)));
            bent.sort_unstable();
        }
        let (paint, normals) = (Paint::of(mesh), Normals::of(mesh));
        // Where faces have different numbers of corners none leans here, and no triangle is asked for.
        let cut = Triangles { mesh, listed: None, bent };
        let turned = match (&self.computed, normals.computed()) {
            (Some(before), Some(now)) => now.changed(before)?,
            _ => moved.normals,
        };
        let leaning = match can_lean {
            true => {
                self.leaning_after(mesh, &normals, &cut, &[&moved.vertices[..], &turned].concat())
            }
            false => Vec::new(),
        };
        let shared = |triangle| cut.vertices(triangle, mesh.faces().corners());
        let own = Own::of(&leaning, count, shared);
        if own.end() != self.origins.len() {
            return None;
        }
        let mut triangles =
            BTreeMap::from_iter(self.leaning.iter().map(|it| (it.triangle, shared(it.triangle))));
        let of_face = cut.of_face();
        let of_recut = recut.iter().flat_map(|face| (**face as usize * of_face..).take(of_face));
        triangles.extend(of_recut.map(|triangle| (triangle, shared(triangle))));
        own.patch(&leaning, shared, |triangle, vertices| _ = triangles.insert(triangle, vertices));
        triangles.retain(|&triangle, vertices| self.triangles[triangle] != *vertices);
        let rows = triangles
            .keys()
            .map(|&triangle| triangle as u32..triangle as u32 + 1)
            .collect::<Vec<_>>();
        let triangles =
            self.triangles.with_rows(&rows, &triangles.into_values().collect::<Vec<_>>());

        let seen = Seen { mesh, ruler, paint: &paint, normals: &normals, firsts: None, own: &own };
        let behind = count as u32..own.end() as u32;
        let only = slice::from_ref(&behind);
        let origins = remade(&self.origins, only, |k| seen.origin(k));
        Some(Self {
            mesh: mesh.clone(),
            ruler,
            is_solid,
            places: remade(&self.places, &[&moved.vertices, only].concat(), |k| seen.place(k)),
            normals: remade(&self.normals, &[&turned, only].concat(), |k| seen.normal(k)),
            colors: self.colors.as_ref().map(|colors| remade(colors, only, |k| seen.color(k))),
            uv: self.uv.as_ref().map(|uv| remade(uv, only, |k| seen.uv(k))),
            triangles,
            stretches: self.stretches.clone(),
            fields: self.fields.clone(),
            origins,
            computed: normals.computed().cloned(),
            leaning,
            is_split: false,
            bent: cut.bent,
        })
    }

    /// The triangles that lean after something has changed at these vertices.
    fn leaning_after(
        &self,
        mesh: &Mesh,
        normals: &Normals<'_>,
        cut: &Triangles<'_>,
        vertices: &[Range<u32>],
    ) -> Vec<Leaning> {
        let touched = mesh.faces_with(vertices).into_iter();
        let of_face = cut.of_face();
        let touched =
            touched.flat_map(|face| face as usize * of_face..(face as usize + 1) * of_face);
        let touched = Vec::from_iter(touched);
        let mut leaning: Vec<Leaning> =
            touched.par_iter().filter_map(|&triangle| normals.lean(mesh, cut, triangle)).collect();
        leaning
            .extend(self.leaning.iter().filter(|it| touched.binary_search(&it.triangle).is_err()));
        leaning.sort_unstable_by_key(|it| it.triangle);
        leaning
    }
}

/// A column with some rows made anew; itself if they are as they were.
fn remade<T: Pod + PartialEq + Send + Sync>(
    before: &Column<T>,
    rows: &[Range<u32>],
    item: impl Fn(usize) -> T,
) -> Column<T> {
    let places = || rows.iter().cloned().flatten().map(|k| k as usize);
    let items: Vec<_> = places().map(item).collect();
    let is_same = places().zip(&items).all(|(k, item)| before[k] == *item);
    if is_same { before.clone() } else { before.with_rows(rows, &items) }
}

#[cfg(test)]
mod tests {
    use maquette_value::random::Random;
    use maquette_value::{Attribute, Faces, Image};
    use nalgebra::{Point3, Vector3};

    use super::*;

    /// A sheet of triangles or quads with spikes, at which faces lean.
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
        let ruler = Ruler { center: Point3::new(32.0, 32.0, 0.0), scale: 64.0 };
        Shape::new(mesh.clone(), false, ruler)
    }

    /// Panics if one of two shapes has something that the other has not.
    fn assert_same(now: &Shape, anew: &Shape) {
        assert_eq!(now.places, anew.places);
        assert_eq!(now.normals, anew.normals);
        assert_eq!(now.colors, anew.colors);
        assert_eq!(now.uv, anew.uv);
        assert_eq!(now.triangles, anew.triangles);
        assert_eq!(now.origins, anew.origins);
        assert_eq!(now.leaning, anew.leaning);
        assert_eq!(now.computed, anew.computed);
        assert_eq!(now.places.hash(), Column::from(anew.places.to_vec()).hash());
        assert_eq!(now.normals.hash(), Column::from(anew.normals.to_vec()).hash());
        fn fields(shape: &Shape) -> Vec<(String, [f64; 2])> {
            shape.fields.iter().map(|field| (field.name.clone(), field.usual)).collect::<Vec<_>>()
        }
        assert_eq!(fields(now), fields(anew));
    }

    /// The same mesh with data at its vertices.
    fn with(mesh: &Mesh, name: &str, attribute: Attribute) -> Mesh {
        mesh.clone().with_vertex(name, attribute).unwrap()
    }

    #[test]
    fn shapes_after_moves_are_those_made_anew() {
        let mut dice = Random(5);
        let count = 65 * 65_u32;
        let colors = Attribute::Color((0..count).map(|k| [k as u8, (k / 3) as u8, 7]).collect());
        let heights = Attribute::Number((0..count).map(f64::from).collect());
        let normals = Attribute::Vector(vec![[0.0, 0.6, 0.8]; count as usize].into());
        let (mut leaned, mut others) = (0, 0);
        for sides in [3, 4] {
            let plain = sheet(65, sides);
            let colored = with(&with(&plain, "color", colors.clone()), "height", heights.clone());
            let smooth = with(&plain, "normal", normals.clone());
            for mut mesh in [plain, colored, smooth] {
                let mut before = shape(&mesh);
                for round in 0..30 {
                    let start = dice.below(count as usize) as u32;
                    let row = start..(start + 1 + dice.below(9) as u32).min(count);
                    let rows = slice::from_ref(&row);
                    let lift = if round % 3 == 0 { 4.0 } else { 0.02 };
                    let places: Vec<_> = row
                        .clone()
                        .map(|vertex| {
                            mesh.positions()[vertex as usize]
                                + Vector3::new(0.0, 0.01, lift * dice.even())
                        })
                        .collect();
                    mesh = mesh.with_moved(rows, &places).unwrap();
                    if let Some(Attribute::Vector(normals)) = mesh.vertex().get("normal") {
                        let turned =
                            normals.with_rows(rows, &vec![[0.6, dice.even(), 0.8]; row.len()]);
                        mesh = with(&mesh, "normal", Attribute::Vector(turned));
                    }
                    let anew = shape(&mesh);
                    leaned += usize::from(anew.leaning != before.leaning);
                    let now = before.after(&mesh, false, before.ruler);
                    match &now {
                        Some(now) => assert_same(now, &anew),
                        None => assert_ne!(before.origins.len(), anew.origins.len()),
                    }
                    others += usize::from(now.is_none());
                    before = now.unwrap_or(anew);
                }
            }
        }
        assert!(leaned > 20 && others < leaned / 2, "{leaned} {others}");
    }

    #[test]
    fn what_has_changed_otherwise_is_made_anew() {
        let mesh = sheet(9, 3);
        let before = shape(&mesh);
        let moved =
            mesh.with_moved(slice::from_ref(&(5..6)), &[Point3::new(5.0, 0.1, 0.3)]).unwrap();
        let ruler = before.ruler;
        assert!(before.after(&moved, false, ruler).is_some());
        assert!(before.after(&moved, true, ruler).is_none());
        assert!(before.after(&moved, false, Ruler { scale: 32.0, ..ruler }).is_none());
        let colors = Attribute::Color(vec![[1, 2, 3]; 81].into());
        assert!(before.after(&with(&moved, "color", colors), false, ruler).is_none());
        assert!(before.after(&sheet(9, 4), false, ruler).is_none());
        assert!(before.after(&sheet(8, 3), false, ruler).is_none());
        let uv = with(&moved, "uv", Attribute::Pair(vec![[0.2, 0.5]; 81].into()));
        let [red, blue] =
            [[255, 0, 0], [0, 0, 255]].map(|color| Image::new(1, 1, vec![color]).unwrap());
        let before = shape(&uv.clone().with_texture(Some(red)));
        assert!(before.after(&uv.with_texture(Some(blue)), false, ruler).is_none());
        let lifted = mesh.positions().iter().map(|place| place + Vector3::z()).collect::<Vec<_>>();
        assert!(shape(&mesh).after(&mesh.with_positions(lifted).unwrap(), false, ruler).is_none());
    }
}
