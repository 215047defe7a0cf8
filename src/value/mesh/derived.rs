//! Data that is derived from a mesh and cached with it. When a changed mesh is written again, only the data that depends on the changes is
//! computed again. Large data is cached only while something outside of the cache also holds it.

use std::fmt;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use nalgebra::{Point3, Vector3};

use super::{BLOCK, Mesh, bounds};
use crate::column::WeakColumn;
use crate::content::Content;
use crate::parallel::*;
use crate::{Column, DecodeError, Decoder, Encoder, Hash, Material, Rgb};

mod face_bins;
mod update;

pub(super) use face_bins::FaceBins;

/// The caches of a mesh. They are not part of the mesh as a value. Copies of a mesh share them.
#[derive(Clone, Default)]
pub(super) struct DerivedData {
    of_positions: Arc<PositionCaches>,
    colors: Arc<Mutex<Option<TextureColors>>>,
}

/// The colors that the textures have at the vertices, and the hash of the data from which the colors were computed.
#[derive(Clone)]
struct TextureColors {
    hash_of_inputs: Hash,
    colors: WeakColumn<Rgb>,
}

/// Data that depends on the positions of the vertices.
#[derive(Default)]
struct PositionCaches {
    normals: Mutex<Option<WeakColumn<[f32; 3]>>>,
    earlier: Option<EarlierNormals>,
    boxes: OnceLock<Vec<Bounds>>,
}

/// The normals of an earlier mesh with the same faces, and the rows of vertices whose positions differ between that mesh and this one.
struct EarlierNormals {
    normals: WeakColumn<[f32; 3]>,
    moved: Vec<Range<u32>>,
}

/// The minimum and maximum coordinates of some points.
type Bounds = (Point3<f64>, Point3<f64>);

impl DerivedData {
    /// The caches that stay valid after all vertices have moved.
    pub(super) fn after_moving_all(&self) -> Self {
        Self { of_positions: Arc::default(), colors: self.colors.clone() }
    }

    /// The caches that stay valid after the given rows of vertices have moved; `positions` holds the new positions of all vertices.
    pub(super) fn after_moving_rows(&self, rows: &[Range<u32>], positions: &[Point3<f64>]) -> Self {
        let of_positions = PositionCaches {
            normals: Mutex::default(),
            earlier: self.of_positions.earlier_normals(rows),
            boxes: OnceLock::new(),
        };
        if let Some(boxes) = self.of_positions.boxes.get() {
            let mut boxes = boxes.clone();
            let touched = rows.iter().filter(|row| !row.is_empty());
            let touched =
                touched.flat_map(|row| row.start as usize / BLOCK..=(row.end as usize - 1) / BLOCK);
            let mut last = None;
            for block in touched.filter(|block| last.replace(*block) != Some(*block)) {
                boxes[block] = box_of(positions, block);
            }
            // `set` cannot fail: no other thread has access to the new cell yet.
            let _ = of_positions.boxes.set(boxes);
        }
        Self { of_positions: of_positions.into(), colors: self.colors.clone() }
    }

    fn normals(&self) -> Option<Column<[f32; 3]>> {
        lock(&self.of_positions.normals).as_ref()?.upgrade()
    }
}

impl PositionCaches {
    /// The cached normals that can be updated after the vertices in `rows` have moved. `None` if no normals are cached, or updating them
    /// would cost more than computing all normals again.
    fn earlier_normals(&self, rows: &[Range<u32>]) -> Option<EarlierNormals> {
        let current = lock(&self.normals).as_ref().and_then(WeakColumn::upgrade);
        let (normals, moved) = match (current, &self.earlier) {
            (Some(normals), _) => (normals, rows.to_vec()),
            (None, earlier) => {
                let earlier = earlier.as_ref()?;
                (earlier.normals.upgrade()?, [&earlier.moved, rows].concat())
            }
        };
        // If as many vertices have moved as there are normals, computing all normals again costs less than updating them.
        let count: usize = moved.iter().map(ExactSizeIterator::len).sum();
        (count < normals.len()).then(|| EarlierNormals { normals: normals.downgrade(), moved })
    }
}

impl PartialEq for DerivedData {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// Nothing is written, because the caches can be computed again.
impl Content for DerivedData {
    fn encode(&self, _: &mut Encoder) {}

    fn decode(_: &mut Decoder<'_>) -> Result<Self, DecodeError> {
        Ok(Self::default())
    }
}

impl fmt::Debug for DerivedData {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("..")
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Mesh {
    /// The [`vertex_normals`](Self::vertex_normals) in single precision. They stay cached while a caller holds them.
    pub fn cached_normals(&self) -> Column<[f32; 3]> {
        if let Some(known) = self.derived.normals() {
            return known;
        }
        let earlier = self.derived.of_positions.earlier.as_ref();
        let earlier = earlier.and_then(|it| Some((it.normals.upgrade()?, &it.moved)));
        // The cache is not locked here, so two concurrent calls may both compute the normals.
        let normals = match earlier {
            Some((normals, moved)) => self.updated_normals(&normals, moved),
            None => to_single_precision(&self.vertex_normals()).into(),
        };
        *lock(&self.derived.of_positions.normals) = Some(normals.downgrade());
        normals
    }

    /// The colors that the textures have at the vertices. `None` without textures or texture coordinates. A vertex on a seam takes the
    /// color of one side. A vertex of a face without a texture has its own color, or else that of the material. The colors are cached while
    /// another owner keeps them.
    pub fn texture_colors(&self) -> Option<Column<Rgb>> {
        let faces = self.face_materials();
        let is_shown = match faces {
            Some(_) => self.materials.iter().any(|it| it.non_empty_picture().is_some()),
            None => self.materials.first()?.non_empty_picture().is_some(),
        };
        let (vertex, corner) = (self.vertex.pairs("uv"), self.corner.pairs("uv"));
        let uv = vertex.or(corner).filter(|_| is_shown)?;
        let by_corner = vertex.is_none() || faces.is_some();
        let hash_of_inputs = Encoder::hash("texture colors", |to| {
            self.materials.encode(to.plain(&u8::from(vertex.is_some())).column(uv));
            if by_corner {
                self.faces.encode(to);
            }
            if let Some(faces) = faces {
                self.vertex.encode(to.column(faces));
            }
        });
        let known = lock(&self.derived.colors).clone();
        let known = known.filter(|known| known.hash_of_inputs == hash_of_inputs);
        if let Some(colors) = known.and_then(|known| known.colors.upgrade()) {
            return Some(colors);
        }
        let colors = if by_corner {
            self.colors_of_corners(uv, vertex.is_some())
        } else {
            uv.par_iter()
                .with_min_len(BLOCK)
                .map(|&uv| sample_color(&self.materials[0], uv))
                .collect()
        };
        let colors = Column::from(colors);
        *lock(&self.derived.colors) =
            Some(TextureColors { hash_of_inputs, colors: colors.downgrade() });
        Some(colors)
    }

    /// The color of each vertex, taken from the vertex's last corner. `uv` has an entry per vertex if `is_by_vertex` is true, otherwise an
    /// entry per corner.
    fn colors_of_corners(&self, uv: &[[f64; 2]], is_by_vertex: bool) -> Vec<Rgb> {
        let mut last = vec![None; self.positions.len()];
        let corners =
            self.faces.iter().enumerate().flat_map(|(face, corners)| {
                corners.iter().map(move |&vertex| (face, vertex as usize))
            });
        for (corner, (face, vertex)) in corners.enumerate() {
            last[vertex] = Some((face, uv[if is_by_vertex { vertex } else { corner }]));
        }
        let vertex_colors = self.vertex.colors("color");
        last.par_iter()
            .enumerate()
            .with_min_len(BLOCK)
            .map(|(vertex, last)| {
                let (material, uv) = match *last {
                    Some((face, uv)) => (self.material_of(face), uv),
                    None => (self.materials.first(), [0.0; 2]),
                };
                match (material, vertex_colors) {
                    (Some(material), _) if material.non_empty_picture().is_some() => {
                        sample_color(material, uv)
                    }
                    (_, Some(colors)) => colors[vertex],
                    (material, None) => material.map_or([255; 3], Material::color),
                }
            })
            .collect()
    }

    /// The minimum and maximum coordinates; `None` without vertices. After a move only the bounding boxes of blocks with moved vertices are
    /// computed again.
    pub fn cached_bounds(&self) -> Option<Bounds> {
        let known = &self.derived.of_positions.boxes;
        let boxes = known.get().unwrap_or_else(|| {
            let blocks = (0..self.positions.len().div_ceil(BLOCK)).into_par_iter();
            // The boxes are computed outside of the lock, because the thread pool may meanwhile run other work that needs the same value.
            let boxes = blocks.map(|block| box_of(&self.positions, block)).collect();
            known.get_or_init(|| boxes)
        });
        let (first, others) = boxes.split_first()?;
        Some(others.iter().fold(*first, |all: Bounds, it| (all.0.inf(&it.0), all.1.sup(&it.1))))
    }
}

/// The bounding box of the points of a block, which must not be empty.
fn box_of(positions: &[Point3<f64>], block: usize) -> Bounds {
    let positions = &positions[block * BLOCK..positions.len().min((block + 1) * BLOCK)];
    bounds(positions.iter()).unwrap_or_default()
}

/// The color of a material's texture at a texture coordinate.
fn sample_color(material: &Material, uv: [f64; 2]) -> Rgb {
    material.sample(uv).map(|channel| channel.round() as u8)
}

fn to_single_precision(normals: &[Vector3<f64>]) -> Vec<[f32; 3]> {
    let normals = normals.par_iter().with_min_len(BLOCK);
    normals.map(|normal| normal.cast().into()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Random;
    use crate::{Attribute, Image, MATERIAL_ATTRIBUTE};

    /// A bumpy square sheet of faces with 3 or 4 sides.
    fn sheet(width: u32, sides: usize) -> Mesh {
        super::super::tests::sheet([width; 2], sides, |k| f64::from(k * k % 7))
    }

    fn recomputed_normals(mesh: &Mesh) -> Vec<[f32; 3]> {
        to_single_precision(&mesh.vertex_normals())
    }

    #[test]
    fn vertices_have_the_texture_color_of_their_faces() {
        fn picture(color: Rgb) -> Image {
            Image::new(1, 1, vec![color]).unwrap()
        }
        let red = Material::from_picture(picture([255, 0, 0]));
        let green = Material { base_color: [0.0, 1.0, 0.0, 1.0], ..Material::default() };
        let mesh = sheet(2, 3);
        assert_eq!(mesh.texture_colors(), None);
        let uv = Attribute::Pair(vec![[0.5; 2]; 4].into());
        let mesh = mesh.with_vertex("uv", uv).unwrap();
        let one = mesh.clone().with_materials([red.clone()]);
        assert_eq!(one.texture_colors().unwrap()[..], [[255, 0, 0]; 4]);
        // The vertices of the two faces are 0 1 2 and 1 3 2.
        let numbers = Attribute::Index(vec![0, 1].into());
        let two = mesh.with_face(MATERIAL_ATTRIBUTE, numbers).unwrap().with_materials([red, green]);
        let colors = two.texture_colors().unwrap();
        assert_eq!(colors[..], [[255, 0, 0], [0, 255, 0], [0, 255, 0], [0, 255, 0]]);
        let own = Attribute::Color(vec![[1, 2, 3]; 4].into());
        let own = two.with_vertex("color", own).unwrap().texture_colors().unwrap();
        assert_eq!(own[..], [[255, 0, 0], [1, 2, 3], [1, 2, 3], [1, 2, 3]]);
    }

    #[test]
    fn updated_normals_equal_recomputed_ones() {
        let mut dice = Random(3);
        for (width, sides) in [(2, 4), (2, 3), (70, 4), (150, 3)] {
            let mut mesh = sheet(width, sides);
            let mut kept = mesh.cached_normals();
            for round in 0..20 {
                // Every other round makes two moves in a row and does not request the normals between them.
                for _ in 0..1 + round % 2 {
                    let count = mesh.positions().len();
                    let mut ends = [0; 4].map(|_| dice.next_below(count + 1) as u32);
                    ends.sort_unstable();
                    let [from, to, later, end] = ends;
                    let rows = [from..to.min(from + 8), later..end.min(later + 8)];
                    let positions: Vec<_> = rows
                        .iter()
                        .cloned()
                        .flatten()
                        .map(|vertex| {
                            mesh.positions()[vertex as usize] + Vector3::new(0.0, 0.1, dice.even())
                        })
                        .collect();
                    mesh = mesh.with_moved(&rows, &positions).unwrap();
                }
                assert!(
                    mesh.derived.of_positions.earlier.is_some() || width == 2,
                    "there is something to begin with"
                );
                kept = mesh.cached_normals();
                assert_eq!(kept[..], recomputed_normals(&mesh), "{width} {round}");
                assert_eq!(kept.hash(), Column::from(recomputed_normals(&mesh)).hash());
            }
            drop(kept);
            assert!(mesh.derived.normals().is_none(), "nobody keeps them");
            assert_eq!(mesh.cached_normals()[..], recomputed_normals(&mesh));
        }
    }

    #[test]
    fn normals_are_recomputed_after_large_moves() {
        let mesh = sheet(9, 3);
        let kept = mesh.cached_normals();
        let lifted: Vec<_> =
            mesh.positions().iter().map(|position| position.map(|x| x * x)).collect();
        let lifted = mesh.with_positions(lifted).unwrap();
        assert_eq!(lifted.cached_normals()[..], recomputed_normals(&lifted));
        let mut moved = mesh.clone();
        for _ in 0..90 {
            let position = moved.positions()[5] + Vector3::z();
            moved = moved.with_moved(std::slice::from_ref(&(5..6)), &[position]).unwrap();
        }
        assert!(moved.derived.of_positions.earlier.is_none());
        assert_eq!(moved.cached_normals()[..], recomputed_normals(&moved));
        assert_eq!(kept[..], recomputed_normals(&mesh));
    }
}
