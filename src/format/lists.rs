//! Which formats there are.

use maquette_node::pack::{Format, Pack, format};
use maquette_node::reading::{AnyReader, NoReader, Readers, Reading, reader};
use maquette_syntax::error::Error;
use maquette_value::{Value, value_type};

use crate::{
    depth, e57, glb, handles, json, las, obj, pcd, picture_file, ply, png, ptx, range_file, step,
    stl, surface, three_mf, tiff, xyz,
};

/// What reads and writes files of well-known formats.
pub static PACK: Pack = Pack {
    name: "format",
    version: env!("CARGO_PKG_VERSION"),
    build: maquette_node::this_build!(),
    formats: FORMATS,
    readers: READERS,
    ..Pack::EMPTY
};

/// The files that the engine's own values can be written to; the first one of a type is preferred where nobody names a file.
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

/// The files that the engine's own values can be read from; where only the ending is known, the first one that finds something.
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
];

/// The value in a file, by the reader of [`READERS`] for such values and its ending.
///
/// # Errors
/// [`NoReader`] if there is none, or those of the reader.
pub fn read<T: Value>(file: &Reading<'_>) -> Result<T, Error> {
    let value = Readers::new(READERS.iter().copied()).read(value_type::<T>(), file)?;
    value.get().cloned().ok_or_else(|| {
        let (what, ending) = (T::NAME, file.ending());
        NoReader { what, ending, known: Vec::new() }.into()
    })
}
