//! The lists of file formats.

use maquette_node::importers::{AnyReader, InputFile, NoReader, Readers, reader};
use maquette_node::pack::{Format, Pack, format};
use maquette_syntax::error::Error;
use maquette_value::{Value, value_type};

use crate::{
    depth, e57, glb, handles, json, las, obj, pcd, picture_file, ply, png, ptx, range_file, step,
    stl, surface, three_mf, tiff, xyz,
};

/// Readers and writers of common file formats.
pub static PACK: Pack = Pack {
    name: "format",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    formats: FORMATS,
    readers: READERS,
    ..Pack::EMPTY
};

/// The writers for the engine's value types. The first writer of each type is the default.
pub const FORMATS: &[Format] = &[
    format::<png::ImagePng>(),
    format::<png::MaskPng>(),
    format::<png::LabelsPng>(),
    format::<png::FieldPng>(),
    format::<tiff::ImageTiff>(),
    format::<tiff::MaskTiff>(),
    format::<tiff::FieldTiff>(),
    format::<pcd::RangePcd>(),
    format::<glb::MeshGlb>(),
    format::<ply::MeshPly>(),
    format::<ply::ControlNetPly>(),
    format::<ply::RegionPly>(),
    format::<ply::RangePly>(),
    format::<ply::PointsPly>(),
    format::<ply::HandlesPly>(),
    format::<ply::CurvePly>(),
    format::<ptx::RangePtx>(),
    format::<xyz::RangeXyz>(),
    format::<depth::RangeDepthPng>(),
    format::<xyz::PointsXyz>(),
    format::<obj::MeshObj>(),
    format::<obj::CurveObj>(),
    format::<stl::MeshStl>(),
    format::<three_mf::MeshThreeMf>(),
    format::<step::SurfaceStep>(),
    format::<surface::SurfaceGlb>(),
    format::<surface::SurfacePly>(),
    format::<obj::SurfaceObj>(),
    format::<json::DirectionJson>(),
    format::<json::KnotVectorJson>(),
    format::<json::LabelsJson>(),
    format::<json::TraceJson>(),
    format::<json::ControlNetJson>(),
    format::<handles::HandlesJson>(),
];

/// The readers for the engine's value types. If only the extension is known, the first reader that finds data is used.
pub const READERS: &[AnyReader] = &[
    reader::<picture_file::ImageFiles>(),
    reader::<range_file::RangeFiles>(),
    reader::<obj::MeshObj>(),
    reader::<ply::MeshPly>(),
    reader::<stl::MeshStl>(),
    reader::<glb::MeshGlb>(),
    reader::<glb::MeshGltf>(),
    reader::<three_mf::MeshThreeMf>(),
    reader::<ply::PointsPly>(),
    reader::<pcd::PointsPcd>(),
    reader::<xyz::PointsXyz>(),
    reader::<ptx::PointsPtx>(),
    reader::<las::PointsLas>(),
    reader::<e57::PointsE57>(),
    reader::<obj::CurveObj>(),
    reader::<picture_file::MaskFiles>(),
    reader::<handles::HandlesRon>(),
    reader::<handles::HandlesJson>(),
    reader::<handles::HandlesCsv>(),
    reader::<json::ControlNetJson>(),
];

/// Reads a value. The reader is chosen from [`READERS`] by the value's type and the file's extension.
///
/// Returns the error [`NoReader`] if there is no such reader, or the error of the reader.
pub fn read<T: Value>(file: &InputFile<'_>) -> Result<T, Error> {
    let value = Readers::new(READERS.iter().copied()).read(value_type::<T>(), file)?;
    value.get().cloned().ok_or_else(|| {
        let (what, ending) = (T::NAME, file.extension());
        NoReader { what, extension: ending, known: Vec::new() }.into()
    })
}
