//! Writes values without faces: points, regions, range images, handles and curves.

use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::error::Error;
use maquette_value::{Attribute, Curve, Handles, Mesh, Points, RangeImage, Region};

use super::no_faces;
use super::write::encode;
use crate::rows::{floats, indices};
use crate::upright::upright_points;
use crate::{check_single, precision_note};

/// Writes the points of a region.
pub(crate) struct RegionPly;

impl FileFormat for RegionPly {
    type Value = Region;
    const EXTENSION: &'static str = "ply";

    fn write(region: &Region, name: &str) -> Result<Vec<NewFile>, Error> {
        let mesh = Mesh::new(upright_points(region.points(), true), no_faces())?
            .with_vertex("filled", Attribute::Flag(region.filled_cells().to_vec().into()))?;
        Ok(NewFile::single(name, encode(&mesh)?))
    }
}

/// Writes the points of a range image's valid cells, with their colors.
pub(crate) struct RangePly;

impl FileFormat for RangePly {
    type Value = RangeImage;
    const EXTENSION: &'static str = "ply";

    fn write(range: &RangeImage, name: &str) -> Result<Vec<NewFile>, Error> {
        let cells = 0..range.points().len();
        let valid: Vec<_> = cells.filter(|&cell| range.point(cell).is_some()).collect();
        let points: Vec<_> = valid.iter().map(|&cell| range.points()[cell]).collect();
        let mut mesh = Mesh::new(upright_points(&points, true), no_faces())?;
        if let Some(colors) = range.colors() {
            let colors = valid.iter().map(|&cell| colors[cell]).collect();
            mesh = mesh.with_vertex("color", Attribute::Color(colors))?;
        }
        let filled: Vec<u8> = valid.iter().map(|&cell| u8::from(range.is_filled(cell))).collect();
        if filled.contains(&1) {
            mesh = mesh.with_vertex("filled", Attribute::Flag(filled.into()))?;
        }
        Ok(NewFile::single(name, encode(&mesh)?))
    }
}

/// Writes points with all attributes.
pub(crate) struct PointsPly;

impl FileFormat for PointsPly {
    type Value = Points;
    const EXTENSION: &'static str = "ply";
    const FIDELITY: maquette_node::Fidelities = crate::fidelity::POINTS_PLY;

    fn write(points: &Points, name: &str) -> Result<Vec<NewFile>, Error> {
        let mut mesh = Mesh::new(points.positions().clone(), no_faces())?;
        for (attribute, column) in points.attributes().iter() {
            mesh = mesh.with_vertex(attribute, column.clone())?;
        }
        Ok(NewFile::single(name, encode(&mesh)?))
    }

    fn warnings(points: &Points) -> Vec<String> {
        precision_note(points.positions()).into_iter().collect()
    }
}

/// Writes the positions of handles, in the space of the handles, with their motions, deviations and weights.
pub(crate) struct HandlesPly;

impl FileFormat for HandlesPly {
    type Value = Handles;
    const EXTENSION: &'static str = "ply";

    fn write(handles: &Handles, name: &str) -> Result<Vec<NewFile>, Error> {
        let pairs = handles.positions().iter().zip(handles.targets());
        let motions: Vec<[f64; 3]> = pairs.map(|(at, to)| (to - at).into()).collect();
        let mesh = Mesh::new(handles.positions().to_vec(), no_faces())?
            .with_vertex("motion", Attribute::Vector(motions.into()))?
            .with_vertex("sigma", Attribute::Vector(handles.sigma().to_vec().into()))?
            .with_vertex("weight", Attribute::Number(handles.weight().to_vec().into()))?;
        Ok(NewFile::single(name, encode(&mesh)?))
    }
}

/// Writes a curve as a polyline: vertices and edges.
pub(crate) struct CurvePly;

impl FileFormat for CurvePly {
    type Value = Curve;
    const EXTENSION: &'static str = "ply";

    fn write(curve: &Curve, name: &str) -> Result<Vec<NewFile>, Error> {
        let points = curve.sample(0);
        check_single("point", &points)?;
        let count = points.len();
        let edges = if curve.is_closed() { 0..count } else { 0..count - 1 };
        let mut bytes = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty float x\nproperty float y\n\
             property float z\nelement edge {}\nproperty int vertex1\nproperty int vertex2\nend_header\n",
            edges.len()
        )
        .into_bytes();
        for point in points {
            bytes.extend_from_slice(floats(point.coords.into()).as_flattened());
        }
        for edge in edges {
            let ends = [edge, (edge + 1) % count].map(|vertex| vertex as u32);
            bytes.extend_from_slice(indices(ends).as_flattened());
        }
        Ok(NewFile::single(name, bytes))
    }
}

#[cfg(test)]
mod tests {
    use maquette_value::{Handle, HandleSpace};
    use nalgebra::Point3;

    use super::*;
    use crate::ply::{read, read_points};

    #[test]
    fn a_range_image_becomes_its_valid_points() {
        let points = vec![Point3::new(f64::NAN, 0., 1.), Point3::new(1., 2., 3.)];
        let range = RangeImage::new(2, 1, points).unwrap();
        let range = range.with_colors(vec![[1; 3], [2, 3, 4]]).unwrap();
        let range = range.with_filled(vec![0, 1]).unwrap();
        let mesh = read(&RangePly::write(&range, "range.ply").unwrap()[0].bytes).unwrap();
        // The points are rotated upright, as in all files for viewers.
        assert_eq!(mesh.positions()[..], [Point3::new(1., -2., -3.)]);
        assert_eq!(mesh.vertex().colors("color").unwrap()[..], [[2, 3, 4]]);
        assert_eq!(mesh.vertex().get("filled"), Some(&Attribute::Flag(vec![1].into())));
    }

    #[test]
    fn written_points_are_read_back() {
        let positions = vec![Point3::new(1., 2., 3.), Point3::new(4., 5., 6.)];
        let colors = Attribute::Color(vec![[1, 2, 3], [4, 5, 6]].into());
        let weights = Attribute::Number(vec![0.5, 1.5].into());
        let points = Points::new(positions).unwrap().with_attribute("color", colors).unwrap();
        let points = points.with_attribute("weight", weights).unwrap();
        let bytes = PointsPly::write(&points, "a.ply").unwrap().remove(0).bytes;
        assert_eq!(read_points(&bytes).unwrap(), points);
    }

    #[test]
    fn handles_become_points_with_their_motions() {
        fn handle(x: f64, weight: f64) -> Handle {
            Handle {
                at: [x, 2.0, 3.0],
                to: Some([x + 0.5, 2.0, 3.0]),
                sigma: Some([0.5, 0.25, 1.0]),
                weight,
            }
        }
        let handles = Handles::new(HandleSpace::World, &[handle(1.0, 1.0), handle(4.0, 2.0)]);
        let bytes = HandlesPly::write(&handles.unwrap(), "a.ply").unwrap().remove(0).bytes;
        let points = read_points(&bytes).unwrap();
        assert_eq!(points.positions()[..], [Point3::new(1., 2., 3.), Point3::new(4., 2., 3.)]);
        let attributes = points.attributes();
        assert_eq!(attributes.vectors("motion").unwrap()[..], [[0.5, 0.0, 0.0]; 2]);
        assert_eq!(attributes.vectors("sigma").unwrap()[..], [[0.5, 0.25, 1.0]; 2]);
        assert_eq!(attributes.get("weight"), Some(&Attribute::Number(vec![1.0, 2.0].into())));
    }

    #[test]
    fn a_closed_curve_has_an_edge_back_to_its_start() {
        let positions =
            vec![Point3::new(1., 2., 3.), Point3::new(4., 5., 6.), Point3::new(7., 8., 0.)];
        for (closed, edges) in [(true, vec![[0, 1], [1, 2], [2, 0]]), (false, vec![[0, 1], [1, 2]])]
        {
            let curve = Curve::polyline(positions.clone(), closed).unwrap();
            let bytes = CurvePly::write(&curve, "a.ply").unwrap().remove(0).bytes;
            assert_eq!(read(&bytes).unwrap().positions()[..], positions);
            let rows: Vec<_> = edges.into_iter().flat_map(indices).collect();
            assert!(bytes.ends_with(rows.as_flattened()));
        }
    }

    #[test]
    fn a_region_becomes_its_points() {
        let points = vec![Point3::new(1., 2., 3.), Point3::new(4., 5., 6.)];
        let region = Region::new(2, 1, vec![0, 1], points, vec![0, 1], vec![]).unwrap();
        let mesh = read(&RegionPly::write(&region, "region.ply").unwrap()[0].bytes).unwrap();
        assert_eq!(mesh.positions()[..], [Point3::new(1., -2., -3.), Point3::new(4., -5., -6.)]);
        assert_eq!(mesh.vertex().get("filled"), Some(&Attribute::Flag(vec![0, 1].into())));
    }
}
