//! Samples a texture to vertex colors.

use maquette_base::linear::cholesky::{Cholesky, Dissection, Links, Symmetric};
use maquette_base::topology::lists::Lists;
use maquette_node::{
    CancelledError, Carry, Context, Error, Estimate, In, Limit, Node, Progress, Promise, Transfer,
    bail,
};
use maquette_value::{Attribute, Image, Material, Mesh};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::atlas::{Texels, corner_uv};

/// Samples the texture of a mesh to vertex colors, for programs that read no textures.
///
/// The texture is removed; texture coordinates stay.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
pub struct TextureToColors {
    /// The mesh, with a texture.
    pub mesh: In<Mesh>,
    /// Rule for the color of a vertex.
    #[serde(default)]
    pub by: Sampling,
}

/// A rule for the color of a vertex.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Sampling {
    /// The best fit: colors interpolated between vertices are as close as possible to the texture everywhere, so that no single texel
    /// decides. With several textures, colors are taken as by `Point`.
    #[default]
    Area,
    /// The texture's color at the vertex, interpolated between four texels; at a seam the mean of all its positions.
    Point,
}

/// Maximum number of pixels of a texture that is sampled by area.
const PIXELS: Limit =
    Limit { max: 1 << 27, items: "pixels", help: "choose `by: Point`, or a smaller picture" };

impl Node for TextureToColors {
    type Outputs = (Mesh,);
    const OUTPUTS: [&'static str; 1] = ["mesh"];

    const PROMISES: &'static [Promise<Self>] = &Promise::faces_kept("mesh", "mesh");

    const CARRIES: &'static [Carry] =
        &[Carry::uniform("mesh", "mesh", Transfer::Kept).excluding(&["color"])];

    fn estimate(&self, cx: &Context<'_>) -> Option<Estimate> {
        let mesh = cx.get(&self.mesh);
        let pixels = mesh.texture().map_or(0, |it| it.pixels().len()) as f64;
        let corners = mesh.faces().corners().len() as f64;
        let bytes = match self.by {
            // Bytes of memory for the texels and for the equations of the triangles.
            Sampling::Area => 30.0 * pixels + 150.0 * corners,
            Sampling::Point => 40.0 * corners,
        };
        Some(Estimate { bytes: bytes + 1e6, help: PIXELS.help })
    }

    fn eval(&self, cx: &Context<'_>) -> Result<Self::Outputs, Error> {
        Ok((texture_to_colors(cx.get(&self.mesh), self.by, cx.progress())?,))
    }
}

/// Weight of the spring that holds a vertex to the texture's color at its position, relative to the weight of a texel that depends on this
/// vertex only.
const SPRING_WEIGHT: f64 = 0.1;

/// Returns the mesh with the colors of its texture at its vertices, without the texture. Colors are mixed in sRGB, as in pictures.
///
/// [`Sampling::Area`] is the best fit of Kavan, Bargteil and Sloan, "Least squares vertex baking" (2011), section 3: the minimum, over
/// texels, of the squared difference between the texture and the interpolated vertex colors. Instead of the smoothing in that paper, a weak
/// spring pulls the color of each vertex to the texture's color at the vertex; the spring matters only for vertices that affect hardly any
/// texel.
///
/// # Errors
/// Returns an error if the mesh has no texture or no texture coordinates.
pub fn texture_to_colors(
    mesh: &Mesh,
    by: Sampling,
    progress: &Progress<'_>,
) -> Result<Mesh, Error> {
    let Some(picture) = mesh.texture().filter(|it| !it.pixels().is_empty()) else {
        bail!("the mesh has no picture: add one with `Texture`, `Bake` or `ColorsToTexture`");
    };
    let Some(uv) = corner_uv(mesh) else {
        bail!(
            "the mesh has no texture coordinates `uv`, by which its {} vertices could find their colors in the picture; add both with `Texture` or `Bake`",
            mesh.positions().len()
        );
    };
    let mut colors = at_vertices(mesh, &uv);
    if by == Sampling::Area && mesh.face_materials().is_none() {
        let size = [picture.width(), picture.height()];
        PIXELS.check("the picture", size[0] as f64 * size[1] as f64)?;
        let laid =
            mesh.clone().without_attribute("uv").with_corner("uv", Attribute::Pair(uv.into()))?;
        let texels = progress.part(0.0..0.5, |progress| Texels::new(&laid, size, progress))?;
        colors = fit_colors(mesh, picture, &texels, colors, progress)?;
    }
    let colors = colors.iter().map(|color| color.map(|x| x.clamp(0.0, 255.0).round() as u8));
    let colors = Attribute::Color(colors.collect());
    Ok(mesh.clone().with_texture(None).without_attribute("color").with_vertex("color", colors)?)
}

/// Returns the mean of the texture's colors at all corners of each vertex; black for a vertex without faces.
fn at_vertices(mesh: &Mesh, uv: &[[f64; 2]]) -> Vec<[f64; 3]> {
    let mut sums = vec![([0.0; 3], 0.0_f64); mesh.positions().len()];
    let own = mesh.vertex().colors("color");
    let corners = mesh.faces().iter().enumerate();
    let corners =
        corners.flat_map(|(face, corners)| corners.iter().map(move |&it| (face, it as usize)));
    for ((face, vertex), &uv) in corners.zip(uv) {
        let (sum, count) = &mut sums[vertex];
        let color = match (mesh.material_of(face), own) {
            (Some(material), _) if material.non_empty_picture().is_some() => material.sample(uv),
            (_, Some(own)) => own[vertex].map(f64::from),
            (material, None) => material.map_or([255; 3], Material::color).map(f64::from),
        };
        (0..3).for_each(|k| sum[k] += color[k]);
        *count += 1.0;
    }
    sums.into_iter().map(|(sum, count)| sum.map(|x| x / count.max(1.0))).collect()
}

/// Returns the vertex colors that fit the texture best.
fn fit_colors(
    mesh: &Mesh,
    picture: &Image,
    texels: &Texels,
    own: Vec<[f64; 3]>,
    progress: &Progress<'_>,
) -> Result<Vec<[f64; 3]>, CancelledError> {
    let corners = mesh.faces().corners();
    // For each triangle, its contribution to the equations: sums of products of weights, and sums of weights times colors.
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
    let mut right: Vec<_> = own.iter().map(|color| color.map(|x| x * SPRING_WEIGHT)).collect();
    let mut diagonal = vec![SPRING_WEIGHT; own.len()];
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
        let mut row = lists.list(vertex).to_vec();
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
    Ok(match Cholesky::with_ordering(&matrix, &order, progress)? {
        Some(factors) => {
            factors.solve(&mut right);
            right
        }
        None => own,
    })
}

/// Pairs of corners of a triangle: each corner with itself, then each two different corners.
const PAIRS: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [0, 1], [1, 2], [2, 0]];

#[cfg(test)]
mod tests {
    use maquette_value::Faces;
    use nalgebra::Point3;

    use super::*;

    /// Returns a mesh of `n` by `n` squares that fills the texture.
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
        let found = texture_to_colors(mesh, by, &Progress::silent()).unwrap();
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
                // At the border of the mesh, half a texel is missing.
                assert!(
                    (0..3).all(|k| (f64::from(color[k]) - expected[k]).abs() <= 4.0),
                    "{by:?} {color:?} {expected:?}"
                );
            }
        }
    }

    #[test]
    fn a_speck_decides_only_a_point() {
        // One texel in 256 is white, and each white texel is at a vertex.
        let mut pixels = vec![[0; 3]; 64 * 64];
        for k in 0..16 {
            pixels[(k / 4 * 16 + 15) * 64 + k % 4 * 16 + 15] = [255; 3];
        }
        let mesh = net(4, Image::new(64, 64, pixels).unwrap());
        let inner = 6;
        assert!(colors(&mesh, Sampling::Point)[inner][0] > 50);
        assert!(colors(&mesh, Sampling::Area)[inner][0] < 10);
        // The vertex colors must have the mean brightness of the texture.
        let mean =
            colors(&mesh, Sampling::Area).iter().map(|it| f64::from(it[0])).sum::<f64>() / 25.0;
        assert!((0.3..3.0).contains(&mean), "{mean}");
    }

    #[test]
    fn a_mesh_without_a_picture_is_an_error() {
        let picture = Image::new(1, 1, vec![[0; 3]]).unwrap();
        let mesh = net(1, picture);
        fn error(mesh: Mesh) -> String {
            texture_to_colors(&mesh, Sampling::Area, &Progress::silent()).unwrap_err().to_string()
        }
        assert!(error(mesh.clone().with_texture(None)).starts_with("the mesh has no picture: add"));
        let text = "the mesh has no texture coordinates `uv`, by which its 4 vertices could find their colors in the picture; add both with `Texture` or `Bake`";
        assert_eq!(error(mesh.without_attribute("uv")), text);
    }
}
