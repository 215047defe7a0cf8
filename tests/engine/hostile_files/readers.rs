//! Lists all readers of files, with some small valid files for each, and damages these files. The fuzz targets use the same list.

use maquette::format::camera::CameraFile;
use maquette::format::{
    abs, camera, depth, e57, glb, jpeg, las, obj, pcd, picture_file, ply, png, ptx, stl, tiff, xyz,
};
use maquette::rng::Random;
use maquette::value::{Mesh, Points};
use maquette::{InputFile, Value};

/// A reader of files. Its result is ignored: the tests only check that it does not panic, hang or use much memory.
pub(crate) struct Reader {
    /// The file format, and the type of the values that are read.
    pub(crate) name: &'static str,
    /// Reads the bytes of a file, and ignores the result.
    pub(crate) read: fn(&[u8]),
    /// Valid files. The tests damage copies of them.
    pub(crate) seeds: &'static [&'static [u8]],
}

macro_rules! seeds {
    ($($name:literal),+) => {
        &[$(include_bytes!(concat!("../../data/formats/", $name)).as_slice()),+]
    };
}

const GRIDS: &[&[u8]] = seeds!("range_grid_ascii.ply", "range_grid_le.ply", "range_grid_be.ply");

const CAMERA: &[u8] = br#"{"units": "mm", "color": {"width": 16, "height": 12, "fx": 20, "fy": 20, "cx": 7, "cy": 5.5},
    "range": {"intrinsic_matrix": [10, 0, 0, 0, 10, 0, 3.5, 2.5, 1]}, "depth_png": {"units_per_mm": 50},
    "world_from_camera_mm": [[0, -1, 0, 5], [1, 0, 0, 6.5], [0, 0, 1, -7], [0, 0, 0, 1]]}"#;

const SOLID: &[u8] = b"solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid";

/// An OBJ mesh and its material library in one file.
const MATERIAL: &[u8] =
    b"mtllib a.mtl\nusemtl skin\nnewmtl skin\nmap_Kd -s 1 1 1 -clamp on a.png\n";

const PATCH: &[u8] = b"v 0 0 0\nv 1 0 0 1 0.5 0\nv 1 1 0\nv 0 1 0 \\\nvt 0 0\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/2/1 3//1\nf -1 -2 -4\n";

const SPLINE: &[u8] = b"v 0 0 0 1\nv 1 0 0 0.5\nv 1 1 0 2\nv 0 1 0 1\ncstype rat bspline\ndeg 2\n\
    curv 0 2 1 2 3 -1\nparm u 0 0 0 1 \\\n 2 2 2\nend\n";

/// A glTF scene that refers to a buffer and a texture in other files.
const SCENE: &[u8] = br#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "scale": [1, 2, 1]}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
    "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 0.5, 1, 1]}}],
    "textures": [{"source": 0}], "images": [{"uri": "a.png"}, {"uri": "a.png"}], "buffers": [{"byteLength": 60, "uri": "a.bin"}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "sparse": {"count": 1,
    "indices": {"bufferView": 1, "componentType": 5121}, "values": {"bufferView": 0}}},
    {"bufferView": 1, "byteOffset": 0, "componentType": 5126, "count": 3, "type": "VEC2"}]}"#;

/// Reads bytes as a file with this name. If the file refers to other files, each of those also has these bytes.
fn by_name<T: Value>(name: &str, bytes: &[u8]) {
    drop(maquette::format::read::<T>(&InputFile::new(name, bytes, &|_| Ok(bytes.into()))));
}

/// All readers of files.
pub(crate) const READERS: &[Reader] = &[
    Reader {
        name: "abs",
        read: |bytes| drop(abs::read(bytes).map(|file| file.range.n_valid())),
        seeds: seeds!("minolta.abs"),
    },
    Reader { name: "camera", read: |bytes| drop(camera::read(bytes)), seeds: &[CAMERA] },
    Reader {
        name: "depth",
        read: |bytes| drop(depth::read(bytes, eight_by_six().as_ref())),
        seeds: seeds!("depth16.png", "depth32f.tiff"),
    },
    Reader {
        name: "e57",
        read: |bytes| {
            drop(e57::read(bytes));
            drop(e57::read(&seal(bytes)));
        },
        seeds: seeds!("two_scans.e57", "spherical.e57"),
    },
    Reader {
        name: "glb",
        read: |bytes| drop(glb::read(bytes)),
        seeds: seeds!("colored.glb", "textured.glb"),
    },
    Reader { name: "gltf", read: |bytes| by_name::<Mesh>("a.gltf", bytes), seeds: &[SCENE] },
    Reader {
        name: "jpeg",
        read: |bytes| drop(jpeg::read(bytes)),
        seeds: seeds!("photo.jpg", "progressive.jpg", "gray.jpg", "cmyk.jpg"),
    },
    Reader {
        name: "las",
        read: |bytes| drop(las::read(bytes)),
        seeds: seeds!("survey.las", "bytes.las"),
    },
    Reader {
        name: "light",
        read: |bytes| drop(picture_file::read(bytes)),
        seeds: seeds!("light.exr", "alpha.exr", "light.hdr"),
    },
    Reader { name: "obj", read: |bytes| drop(obj::read(bytes)), seeds: &[PATCH] },
    Reader {
        name: "obj_picture",
        read: |bytes| drop(obj::materials(bytes, &mut |_| Ok(bytes.into()))),
        seeds: &[MATERIAL],
    },
    Reader {
        name: "obj_curve",
        read: |bytes| drop(obj::read_curve(bytes)),
        seeds: &[SPLINE, include_bytes!("../../data/formats/ellipse12.obj")],
    },
    Reader {
        name: "pcd",
        read: |bytes| drop(pcd::read(bytes)),
        seeds: seeds!("ascii.pcd", "binary.pcd", "compressed_rgba.pcd", "odd_fields.pcd"),
    },
    Reader {
        name: "picture",
        read: |bytes| drop(picture_file::read(bytes)),
        seeds: seeds!("colour_2x.png", "photo.jpg", "lzw.tiff"),
    },
    Reader { name: "ply", read: |bytes| drop(ply::read(bytes)), seeds: GRIDS },
    Reader {
        name: "ply_range",
        read: |bytes| drop(ply::read_range(bytes).map(|file| file.range.n_valid())),
        seeds: GRIDS,
    },
    Reader {
        name: "png",
        read: |bytes| drop(png::read(bytes)),
        seeds: seeds!("colour_2x.png", "depth16.png"),
    },
    Reader {
        name: "ptx",
        read: |bytes| drop(ptx::read(bytes).map(|file| file.range.n_valid())),
        seeds: seeds!("norgb.ptx", "rgb.ptx"),
    },
    Reader {
        name: "ptx_points",
        read: |bytes| by_name::<Points>("a.ptx", bytes),
        seeds: seeds!("norgb.ptx", "rgb.ptx"),
    },
    Reader {
        name: "stl",
        read: |bytes| drop(stl::read(bytes)),
        seeds: &[SOLID, include_bytes!("../../data/formats/square.stl")],
    },
    Reader {
        name: "three_mf",
        read: |bytes| by_name::<Mesh>("a.3mf", bytes),
        seeds: seeds!("print.3mf"),
    },
    Reader {
        name: "tiff",
        read: |bytes| drop(tiff::read(bytes)),
        seeds: seeds!("lzw.tiff", "deflate_rgba.tiff", "depth32f.tiff"),
    },
    Reader {
        name: "webp_bmp",
        read: |bytes| drop(picture_file::read(bytes)),
        seeds: seeds!("photo.webp", "lossless.webp", "alpha.webp", "rgb.bmp", "palette.bmp"),
    },
    Reader { name: "xyz", read: |bytes| drop(xyz::read(bytes)), seeds: seeds!("points.xyz") },
];

/// Corrects the checksums of the file's pages. Otherwise readers would refuse most damaged files at once. Each checksum is the CRC-32C of
/// the 1020 bytes before it, big-endian.
fn seal(bytes: &[u8]) -> Vec<u8> {
    const PAGE: usize = 1024;
    let mut file = bytes.to_vec();
    file.resize(bytes.len().next_multiple_of(PAGE), 0);
    for page in file.chunks_exact_mut(PAGE) {
        let (data, sum) = page.split_at_mut(PAGE - 4);
        let crc = data.iter().fold(u32::MAX, |sum, &byte| {
            (0..8).fold(sum ^ u32::from(byte), |sum: u32, _| (sum >> 1) ^ (0x82f6_3b78 * (sum & 1)))
        });
        sum.copy_from_slice(&(!crc).to_be_bytes());
    }
    file
}

/// A camera for depth maps of 8 x 6 pixels.
fn eight_by_six() -> Option<CameraFile> {
    camera::read(br#"{"fx": 10, "fy": 10, "cx": 3.5, "cy": 2.5}"#).ok()
}

/// Returns a damaged copy of a valid file of the reader. `case` is the seed of the random damage.
pub(crate) fn spoil(reader: &Reader, case: u64) -> Vec<u8> {
    let mut random = Random(case);
    let mut file = random.pick(reader.seeds).to_vec();
    for _ in 0..1 + random.next_below(4) {
        if file.is_empty() {
            break;
        }
        let at = random.next_below(file.len());
        let length = (1 + random.next_below(16)).min(file.len() - at);
        match random.next_below(9) {
            0 => file[at] = random.bits() as u8,
            1 => file[at] ^= 1 << random.next_below(8),
            2 => file[at] = b'0' + random.next_below(10) as u8,
            3 => file.truncate(at),
            4 => drop(file.drain(at..at + length)),
            // Insert a copy of a part of the file at another position.
            5 => {
                let piece = file[at..at + length].to_vec();
                let to = random.next_below(file.len());
                file.splice(to..to, piece);
            }
            // Overwrite bytes to make a number large, negative or invalid.
            6 => file[at..at + length].fill(*random.pick(&[0, 0x7f, 0x80, 0xff])),
            7 => {
                let words: [&[u8]; 8] = [
                    b"-1",
                    b"nan",
                    b"1e999",
                    b"4294967295",
                    b"18446744073709551615",
                    b" ",
                    b"\n",
                    b"\\\n",
                ];
                let word = random.pick(&words).to_vec();
                file.splice(at..at + length, word);
            }
            // Join the beginning of this file and the end of another one.
            _ => {
                let other = random.pick(reader.seeds);
                let from = random.next_below(other.len());
                file.truncate(at);
                file.extend_from_slice(&other[from..]);
            }
        }
    }
    file
}

/// Picks a random item of a list.
trait Pick {
    fn pick<'a, T>(&mut self, items: &'a [T]) -> &'a T;
}

impl Pick for Random {
    fn pick<'a, T>(&mut self, items: &'a [T]) -> &'a T {
        &items[self.next_below(items.len())]
    }
}
