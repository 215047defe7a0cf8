//! Gives vertices the colors of a picture.

use maquette_base::linear::cholesky::{Cholesky, Dissection, Links, Symmetric};
use maquette_base::topology::lists::Lists;
use maquette_node::{
    Cancelled, Carry, Context, Error, Estimate, Fate, In, Limit, Node, Progress, Promise,
};
use maquette_value::{Attribute, Image, Material, Mesh, MeshError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::atlas::{Texels, corner_uv};

/// Gives the vertices of a mesh the colors of the picture on it, for what knows no textures.
///
/// The picture is taken off; texture coordinates stay.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct TextureToColors {
    /// The mesh, with a picture on it.
    pub mesh: In<Mesh>,
    /// How a vertex gets its color.
    #[serde(default)]
    pub by: Sampling,
}

/// How a vertex gets a color of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Sampling {
    /// So that what is mixed between vertices is as near as possible to the picture everywhere: no speck of the picture decides alone.
    /// Of several pictures, colors are taken as by `Point`.
    #[default]
    Area,
    /// That of the picture where the vertex lies, mixed of the four texels around; at a seam the mean of all its places.
    Point,
}

/// Why vertices got no colors.
#[derive(Debug, thiserror::Error)]
pub enum TextureToColorsError {
    /// No picture.
    #[error("the mesh has no picture: put one on it by `Texture`, `Bake` or `ColorsToTexture`")]
    NoPicture,
    /// No texture coordinates.
    #[error(
        "the mesh has no texture coordinates `uv`, by which its {vertices} vertices could find their colors in the picture"
    )]
    NoCoordinates {
        /// How many vertices.
        vertices: usize,
    },
    /// A picture that is too large.
    #[error(transparent)]
    TooMuch(#[from] maquette_node::TooMuch),
    /// Never for a sound mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The evaluation was told to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Pixels of a picture whose areas are looked at.
const PIXELS: Limit =
    Limit { most: 1 << 27, of: "pixels", help: "choose `by: Point`, or a smaller picture" };

impl Node for TextureToColors {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] = &[Carry::all("mesh", "mesh", Fate::Kept).but(&["color"])];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let mesh = cx.get(&self.mesh);
        let pixels = mesh.texture().map_or(0, |it| it.pixels().len()) as f64;
        let corners = mesh.faces().corners().len() as f64;
        let bytes = match self.by {
            // The texels, and the equations of each triangle.
            Sampling::Area => 30.0 * pixels + 150.0 * corners,
            Sampling::Point => 40.0 * corners,
        };
        Some(Estimate { bytes: bytes + 1e6, help: PIXELS.help })
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((texture_to_colors(cx.get(&self.mesh), self.by, cx.progress())?,))
    }
}

/// How strongly a vertex is held to the color of the picture at its own place, beside one texel that it decides alone.
const OWN: f64 = 0.1;

/// The mesh with the colors of its picture at its vertices, without the picture. Colors are mixed in sRGB, as pictures are.
///
/// By area it is the best fit of Kavan, Bargteil and Sloan, "Least squares vertex baking" (2011), section 3: the least sum over texels of the
/// squared difference between the picture and what is mixed of the vertices. Instead of their smoothing, each vertex is held a little to
/// the color at its own place, which decides where a vertex has hardly a texel.
///
/// # Errors
/// If there is no picture, or there are no texture coordinates.
pub fn texture_to_colors(
    mesh: &Mesh,
    by: Sampling,
    progress: &Progress<'_>,
) -> Result<Mesh, TextureToColorsError> {
    let picture = mesh.texture().filter(|it| !it.pixels().is_empty());
    let picture = picture.ok_or(TextureToColorsError::NoPicture)?;
    let vertices = mesh.positions().len();
    let uv = corner_uv(mesh).ok_or(TextureToColorsError::NoCoordinates { vertices })?;
    let mut colors = at_vertices(mesh, &uv);
    if by == Sampling::Area && mesh.face_materials().is_none() {
        let size = [picture.width(), picture.height()];
        PIXELS.check("the picture", size[0] as f64 * size[1] as f64)?;
        let laid = mesh.clone().without("uv").with_corner("uv", Attribute::Pair(uv.into()))?;
        let texels = progress.part(0.0..0.5, |progress| Texels::new(&laid, size, progress))?;
        colors = fitted(mesh, picture, &texels, colors, progress)?;
    }
    let colors = colors.iter().map(|color| color.map(|x| x.clamp(0.0, 255.0).round() as u8));
    let colors = Attribute::Color(colors.collect());
    Ok(mesh.clone().with_texture(None).without("color").with_vertex("color", colors)?)
}

/// The mean of the pictures' colors at all corners of each vertex; black for a vertex of no face.
fn at_vertices(mesh: &Mesh, uv: &[[f64; 2]]) -> Vec<[f64; 3]> {
    let mut sums = vec![([0.0; 3], 0.0_f64); mesh.positions().len()];
    let own = mesh.vertex().colors("color");
    let corners = mesh.faces().iter().enumerate();
    let corners =
        corners.flat_map(|(face, corners)| corners.iter().map(move |&it| (face, it as usize)));
    for ((face, vertex), &uv) in corners.zip(uv) {
        let (sum, count) = &mut sums[vertex];
        let color = match (mesh.material_of(face), own) {
            (Some(material), _) if material.shown().is_some() => material.sample(uv),
            (_, Some(own)) => own[vertex].map(f64::from),
            (material, None) => material.map_or([255; 3], Material::color).map(f64::from),
        };
        (0..3).for_each(|k| sum[k] += color[k]);
        *count += 1.0;
    }
    sums.into_iter().map(|(sum, count)| sum.map(|x| x / count.max(1.0))).collect()
}

/// The colors of vertices that fit the picture best.
fn fitted(
    mesh: &Mesh,
    picture: &Image,
    texels: &Texels,
    own: Vec<[f64; 3]>,
    progress: &Progress<'_>,
) -> Result<Vec<[f64; 3]>, Cancelled> {
    let corners = mesh.faces().corners();
    // What each triangle adds to the equations: the sums of products of shares, and of shares times colors.
    let mut sums = vec![([0.0; 6], [[0.0; 3]; 3]); texels.triangles.len()];
    for texel in texels.texels.iter().filter(|it| it.is_inside) {
        let (products, loads) = &mut sums[texel.triangle as usize];
        let shares = texel.shares();
        let color = picture.pixels()[texel.pixel as usize].map(f64::from);
        for (product, [i, j]) in products.iter_mut().zip(PAIRS) {
            *product += shares[i] * shares[j];
        }
        for (load, share) in loads.iter_mut().zip(shares) {
            (0..3).for_each(|k| load[k] += share * color[k]);
        }
    }
    progress.tick(0.6)?;
    fn vertex(
        triangle: usize,
        k: usize,
        corners: &maquette_value::Column<u32>,
        texels_triangles: &[[u32; 3]],
    ) -> u32 {
        corners[texels_triangles[triangle][k] as usize]
    }
    let mut right: Vec<_> = own.iter().map(|color| color.map(|x| x * OWN)).collect();
    let mut diagonal = vec![OWN; own.len()];
    for (triangle, (products, loads)) in sums.iter().enumerate() {
        for k in 0..3 {
            let at = vertex(triangle, k, corners, &texels.triangles) as usize;
            (0..3).for_each(|channel| right[at][channel] += loads[k][channel]);
            diagonal[at] += products[k];
        }
    }
    let lists = Lists::group(own.len(), || {
        sums.iter().enumerate().flat_map(|(triangle, (products, _))| {
            PAIRS[3..].iter().zip(&products[3..]).flat_map(move |(&[i, j], &product)| {
                let [a, b] = [i, j].map(|k| vertex(triangle, k, corners, &texels.triangles));
                [(a, (b, product)), (b, (a, product))]
            })
        })
    });
    let mut matrix = Symmetric { starts: vec![0], indices: Vec::new(), entries: Vec::new() };
    for (vertex, &entry) in diagonal.iter().enumerate() {
        let mut row = lists.of(vertex).to_vec();
        row.sort_by_key(|it| it.0);
        matrix.indices.push(vertex as u32);
        matrix.entries.push(entry);
        for entries in row.chunk_by(|a, b| a.0 == b.0) {
            matrix.indices.push(entries[0].0);
            matrix.entries.push(entries.iter().map(|it| it.1).sum());
        }
        matrix.starts.push(matrix.indices.len() as u32);
    }
    let order = Dissection::new(Links { starts: &matrix.starts, neighbors: &matrix.indices }, 1);
    Ok(match Cholesky::ordered(&matrix, &order, progress)? {
        Some(factors) => {
            factors.solve(&mut right);
            right
        }
        None => own,
    })
}

/// Corners of a triangle with themselves, and with each other.
const PAIRS: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [0, 1], [1, 2], [2, 0]];

#[cfg(test)]
mod tests {
    use maquette_value::Faces;
    use nalgebra::Point3;

    use super::*;

    /// A net of `n` by `n` squares that fills the picture.
    fn net(n: u32, picture: Image) -> Mesh {
        let uv: Vec<_> = (0..(n + 1) * (n + 1))
            .map(|k: u32| [k % (n + 1), k / (n + 1)].map(|x| f64::from(x) / f64::from(n)))
            .collect();
        let places = uv.iter().map(|[x, y]| Point3::new(*x, *y, 0.0)).collect::<Vec<_>>();
        let cells = (0..n * n).map(|k| k / n * (n + 1) + k % n);
        let quads = cells.flat_map(|a| [a, a + 1, a + n + 2, a + n + 1]);
        let mesh = Mesh::new(places, Faces::uniform(4, quads.collect::<Vec<_>>()).unwrap());
        let mesh = mesh.unwrap().with_vertex("uv", Attribute::Pair(uv.into())).unwrap();
        mesh.with_texture(Some(picture))
    }

    fn colors(mesh: &Mesh, by: Sampling) -> Vec<[u8; 3]> {
        let found = texture_to_colors(mesh, by, &Progress::none()).unwrap();
        assert!(found.texture().is_none());
        found.vertex().colors("color").unwrap().to_vec()
    }

    #[test]
    fn a_ramp_comes_through_both_ways() {
        let ramp = (0..64 * 64).map(|k| [(k % 64 * 4) as u8, (k / 64 * 4) as u8, 9]);
        let mesh = net(4, Image::new(64, 64, ramp.collect::<Vec<_>>()).unwrap());
        for by in [Sampling::Area, Sampling::Point] {
            for (place, color) in mesh.positions().iter().zip(colors(&mesh, by)) {
                let expected = [255.0 * place.x, 255.0 * (1.0 - place.y), 9.0];
                // At the border half a texel is missing.
                assert!(
                    (0..3).all(|k| (f64::from(color[k]) - expected[k]).abs() <= 4.0),
                    "{by:?} {color:?} {expected:?}"
                );
            }
        }
    }

    #[test]
    fn a_speck_decides_only_a_point() {
        // A texel in 256 is white, and lies at a vertex.
        let mut pixels = vec![[0; 3]; 64 * 64];
        for k in 0..16 {
            pixels[(k / 4 * 16 + 15) * 64 + k % 4 * 16 + 15] = [255; 3];
        }
        let mesh = net(4, Image::new(64, 64, pixels).unwrap());
        let inner = 6;
        assert!(colors(&mesh, Sampling::Point)[inner][0] > 50);
        assert!(colors(&mesh, Sampling::Area)[inner][0] < 10);
        // In the mean the same light is there.
        let mean =
            colors(&mesh, Sampling::Area).iter().map(|it| f64::from(it[0])).sum::<f64>() / 25.0;
        assert!((0.3..3.0).contains(&mean), "{mean}");
    }

    #[test]
    fn what_has_no_picture_is_told() {
        let picture = Image::new(1, 1, vec![[0; 3]]).unwrap();
        let mesh = net(1, picture);
        fn told(mesh: Mesh) -> String {
            texture_to_colors(&mesh, Sampling::Area, &Progress::none()).unwrap_err().to_string()
        }
        assert!(told(mesh.clone().with_texture(None)).starts_with("the mesh has no picture: put"));
        let text = "the mesh has no texture coordinates `uv`, by which its 4 vertices could find their colors in the picture";
        assert_eq!(told(mesh.without("uv")), text);
    }
}
