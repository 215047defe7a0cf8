//! What is known of a mesh beside its value, so that a file of it that is written again and again costs what has changed: what takes much
//! memory only as long as somebody keeps it.

use std::fmt;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use nalgebra::{Point3, Vector3};

use super::{BLOCK, Mesh, bounds};
use crate::column::WeakColumn;
use crate::parallel::*;
use crate::{Column, Encoder, Hash, Material, Rgb, material};

mod after;
mod spread;

pub(super) use spread::Spread;

/// No part of the value, and shared by its copies.
#[derive(Clone, Default)]
pub(super) struct Known {
    of_places: Arc<OfPlaces>,
    colors: Arc<Mutex<Option<Colors>>>,
}

/// The colors that the picture has at the vertices, and the hash of what they were made of.
#[derive(Clone)]
struct Colors(Hash, WeakColumn<Rgb>);

/// What belongs to the places of the vertices.
#[derive(Default)]
struct OfPlaces {
    normals: Mutex<Option<WeakColumn<[f32; 3]>>>,
    before: Option<Before>,
    boxes: OnceLock<Vec<Bounds>>,
}

/// The normals of a mesh with the same faces, and the rows of vertices that have moved since.
struct Before {
    normals: WeakColumn<[f32; 3]>,
    moved: Vec<Range<u32>>,
}

/// The lowest and the highest coordinates of some points.
type Bounds = (Point3<f64>, Point3<f64>);

impl Known {
    /// What is known when all vertices have moved.
    pub(super) fn elsewhere(&self) -> Self {
        Self { of_places: Arc::default(), colors: self.colors.clone() }
    }

    /// What is known when some rows of vertices have moved to these places, which are those of all.
    pub(super) fn moved(&self, rows: &[Range<u32>], places: &[Point3<f64>]) -> Self {
        let of_places = OfPlaces {
            normals: Mutex::default(),
            before: self.of_places.before(rows),
            boxes: OnceLock::new(),
        };
        if let Some(boxes) = self.of_places.boxes.get() {
            let mut boxes = boxes.clone();
            let touched = rows.iter().filter(|row| !row.is_empty());
            let touched =
                touched.flat_map(|row| row.start as usize / BLOCK..=(row.end as usize - 1) / BLOCK);
            let mut last = None;
            for block in touched.filter(|block| last.replace(*block) != Some(*block)) {
                boxes[block] = box_of(places, block);
            }
            // Nobody else knows it yet.
            let _ = of_places.boxes.set(boxes);
        }
        Self { of_places: of_places.into(), colors: self.colors.clone() }
    }

    fn normals(&self) -> Option<Column<[f32; 3]>> {
        lock(&self.of_places.normals).as_ref()?.upgrade()
    }
}

impl OfPlaces {
    /// What the normals can be made of when these rows have moved.
    fn before(&self, rows: &[Range<u32>]) -> Option<Before> {
        let known = lock(&self.normals).as_ref().and_then(WeakColumn::upgrade);
        let (normals, moved) = match (known, &self.before) {
            (Some(normals), _) => (normals, rows.to_vec()),
            (None, before) => {
                let before = before.as_ref()?;
                (before.normals.upgrade()?, [&before.moved, rows].concat())
            }
        };
        // To follow more than all of them costs more than to make them anew.
        let count: usize = moved.iter().map(ExactSizeIterator::len).sum();
        (count < normals.len()).then(|| Before { normals: normals.downgrade(), moved })
    }
}

impl PartialEq for Known {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl fmt::Debug for Known {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("..")
    }
}

fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Mesh {
    /// [`vertex_normals`](Self::vertex_normals) in single precision. They are known as long as somebody keeps them.
    pub fn single_normals(&self) -> Column<[f32; 3]> {
        if let Some(known) = self.known.normals() {
            return known;
        }
        let before = self.known.of_places.before.as_ref();
        let before = before.and_then(|before| Some((before.normals.upgrade()?, &before.moved)));
        // Two that ask at once make them twice.
        let normals = match before {
            Some((normals, moved)) => self.normals_after(&normals, moved),
            None => single(&self.vertex_normals()).into(),
        };
        *lock(&self.known.of_places.normals) = Some(normals.downgrade());
        normals
    }

    /// The colors of the pictures at the vertices, if there is one and it is known where on it they are. A vertex on a seam takes the color of
    /// one side; one of a face without a picture has its own color, or that of the material. They are known as long as somebody keeps them.
    pub fn texture_colors(&self) -> Option<Column<Rgb>> {
        let faces = self.face_materials();
        let is_shown = match faces {
            Some(_) => self.materials.iter().any(|it| it.shown().is_some()),
            None => self.materials.first()?.shown().is_some(),
        };
        let (vertex, corner) = (self.vertex.pairs("uv"), self.corner.pairs("uv"));
        let uv = vertex.or(corner).filter(|_| is_shown)?;
        let by_corner = vertex.is_none() || faces.is_some();
        let made_of = Encoder::hash("texture colors", |to| {
            material::encode(&self.materials, to.plain(&u8::from(vertex.is_some())).column(uv));
            if by_corner {
                self.faces.encode(to);
            }
            if let Some(faces) = faces {
                self.vertex.encode(to.column(faces));
            }
        });
        let known = lock(&self.known.colors).clone();
        let known = known.filter(|Colors(of, _)| *of == made_of);
        if let Some(colors) = known.and_then(|Colors(_, colors)| colors.upgrade()) {
            return Some(colors);
        }
        fn sample(of: &Material, uv: [f64; 2]) -> [u8; 3] {
            of.sample(uv).map(|channel| channel.round() as u8)
        }
        let colors = if !by_corner {
            uv.par_iter()
                .with_min_len(BLOCK)
                .map(|&uv| sample(&self.materials[0], uv))
                .collect::<Vec<_>>()
        } else {
            let mut last = vec![None; self.positions.len()];
            let corners = self.faces.iter().enumerate().flat_map(|(face, corners)| {
                corners.iter().map(move |&vertex| (face, vertex as usize))
            });
            for (corner, (face, of)) in corners.enumerate() {
                last[of] = Some((face, uv[if vertex.is_some() { of } else { corner }]));
            }
            let own = self.vertex.colors("color");
            last.par_iter()
                .enumerate()
                .with_min_len(BLOCK)
                .map(|(vertex, last)| {
                    let (material, uv) = match *last {
                        Some((face, uv)) => (self.material_of(face), uv),
                        None => (self.materials.first(), [0.0; 2]),
                    };
                    match (material, own) {
                        (Some(material), _) if material.shown().is_some() => sample(material, uv),
                        (_, Some(own)) => own[vertex],
                        (material, None) => material.map_or([255; 3], Material::color),
                    }
                })
                .collect()
        };
        let colors = Column::from(colors);
        *lock(&self.known.colors) = Some(Colors(made_of, colors.downgrade()));
        Some(colors)
    }

    /// The lowest and the highest coordinates; none without vertices. It costs what has moved since they were known.
    pub fn known_bounds(&self) -> Option<Bounds> {
        let known = &self.known.of_places.boxes;
        let boxes = known.get().unwrap_or_else(|| {
            let blocks = (0..self.positions.len().div_ceil(BLOCK)).into_par_iter();
            // Made outside of the lock: its threads may take on other work meanwhile that asks for the same.
            let boxes = blocks.map(|block| box_of(&self.positions, block)).collect();
            known.get_or_init(|| boxes)
        });
        let (first, others) = boxes.split_first()?;
        Some(others.iter().fold(*first, |all: Bounds, of| (all.0.inf(&of.0), all.1.sup(&of.1))))
    }
}

/// The box around the points of a block, of which there is at least one.
fn box_of(places: &[Point3<f64>], block: usize) -> Bounds {
    let places = &places[block * BLOCK..places.len().min((block + 1) * BLOCK)];
    bounds(places.iter()).unwrap_or_default()
}

fn single(normals: &[Vector3<f64>]) -> Vec<[f32; 3]> {
    let normals = normals.par_iter().with_min_len(BLOCK);
    normals.map(|normal| normal.cast().into()).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::random::Random;
    use crate::{Attribute, Faces, Image, MATERIAL};

    /// A bumpy sheet of triangles or quads.
    fn sheet(width: u32, quads: bool) -> Mesh {
        let place =
            |k: u32| Point3::new(f64::from(k % width), f64::from(k / width), f64::from(k * k % 7));
        let cells = (0..(width - 1) * (width - 1))
            .map(|k: u32| (k / (width - 1)) * width + k % (width - 1));
        let faces = match quads {
            true => Faces::uniform(
                4,
                cells.flat_map(|a| [a, a + 1, a + width + 1, a + width]).collect::<Vec<_>>(),
            )
            .unwrap(),
            false => Faces::triangles(
                cells
                    .flat_map(|a| [[a, a + 1, a + width], [a + 1, a + width + 1, a + width]])
                    .collect(),
            ),
        };
        Mesh::new((0..width * width).map(place).collect::<Vec<_>>(), faces).unwrap()
    }

    fn anew(mesh: &Mesh) -> Vec<[f32; 3]> {
        single(&mesh.vertex_normals())
    }

    #[test]
    fn vertices_have_the_color_of_the_picture_of_their_faces() {
        fn picture(color: Rgb) -> Image {
            Image::new(1, 1, vec![color]).unwrap()
        }
        let red = Material::of_picture(picture([255, 0, 0]));
        let green = Material { base_color: [0.0, 1.0, 0.0, 1.0], ..Material::default() };
        let mesh = sheet(2, false);
        assert_eq!(mesh.texture_colors(), None);
        let uv = Attribute::Pair(vec![[0.5; 2]; 4].into());
        let mesh = mesh.with_vertex("uv", uv).unwrap();
        let one = mesh.clone().with_materials([red.clone()]);
        assert_eq!(one.texture_colors().unwrap()[..], [[255, 0, 0]; 4]);
        // The faces are 0 1 2 and 1 3 2.
        let numbers = Attribute::Index(vec![0, 1].into());
        let two = mesh.with_face(MATERIAL, numbers).unwrap().with_materials([red, green]);
        let colors = two.texture_colors().unwrap();
        assert_eq!(colors[..], [[255, 0, 0], [0, 255, 0], [0, 255, 0], [0, 255, 0]]);
        let own = Attribute::Color(vec![[1, 2, 3]; 4].into());
        let own = two.with_vertex("color", own).unwrap().texture_colors().unwrap();
        assert_eq!(own[..], [[255, 0, 0], [1, 2, 3], [1, 2, 3], [1, 2, 3]]);
    }

    #[test]
    fn normals_after_moves_are_those_made_anew() {
        let mut dice = Random(3);
        for (width, quads) in [(2, true), (2, false), (70, true), (150, false)] {
            let mut mesh = sheet(width, quads);
            let mut kept = mesh.single_normals();
            for round in 0..20 {
                // Two moves in a row now and then, of which nobody has seen the first.
                for _ in 0..1 + round % 2 {
                    let count = mesh.positions().len();
                    let mut ends = [0; 4].map(|_| dice.below(count + 1) as u32);
                    ends.sort_unstable();
                    let [from, to, later, end] = ends;
                    let rows = [from..to.min(from + 8), later..end.min(later + 8)];
                    let places: Vec<_> = rows
                        .iter()
                        .cloned()
                        .flatten()
                        .map(|vertex| {
                            mesh.positions()[vertex as usize] + Vector3::new(0.0, 0.1, dice.even())
                        })
                        .collect();
                    mesh = mesh.with_moved(&rows, &places).unwrap();
                }
                assert!(
                    mesh.known.of_places.before.is_some() || width == 2,
                    "there is something to begin with"
                );
                kept = mesh.single_normals();
                assert_eq!(kept[..], anew(&mesh), "{width} {round}");
                assert_eq!(kept.hash(), Column::from(anew(&mesh)).hash());
            }
            drop(kept);
            assert!(mesh.known.normals().is_none(), "nobody keeps them");
            assert_eq!(mesh.single_normals()[..], anew(&mesh));
        }
    }

    #[test]
    fn other_places_and_long_ways_begin_anew() {
        let mesh = sheet(9, false);
        let kept = mesh.single_normals();
        let lifted: Vec<_> = mesh.positions().iter().map(|place| place.map(|x| x * x)).collect();
        let lifted = mesh.with_positions(lifted).unwrap();
        assert_eq!(lifted.single_normals()[..], anew(&lifted));
        let mut moved = mesh.clone();
        for _ in 0..90 {
            let place = moved.positions()[5] + Vector3::z();
            moved = moved.with_moved(std::slice::from_ref(&(5..6)), &[place]).unwrap();
        }
        assert!(moved.known.of_places.before.is_none());
        assert_eq!(moved.single_normals()[..], anew(&moved));
        assert_eq!(kept[..], anew(&mesh));
    }
}
