//! Points in blocks: many points, of which only a part is in memory at a time.

use super::column::ColumnHasher;
use super::encoding::{Bytes, Encoder};
use super::{Attribute, Hash, Points, Value};

/// The error that blocks have different attributes, so that they are not parts of one set of points.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the blocks of points have different attributes")]
pub struct BlocksDiffer;

impl Points {
    /// Joins blocks of points, in this order.
    ///
    /// # Errors
    /// If there is no block, or their attributes have different names or types.
    pub fn concat(blocks: &[Self]) -> Result<Self, BlocksDiffer> {
        let first = match blocks {
            [] => return Err(BlocksDiffer),
            [block] => return Ok(block.clone()),
            [first, ..] => first,
        };
        let count = first.attributes().iter().count();
        if blocks.iter().any(|block| block.attributes().iter().count() != count) {
            return Err(BlocksDiffer);
        }
        let mut positions =
            Vec::with_capacity(blocks.iter().map(|block| block.positions().len()).sum());
        blocks.iter().for_each(|block| positions.extend_from_slice(block.positions()));
        let mut points = Self::new(positions).map_err(|_| BlocksDiffer)?;
        for (name, _) in first.attributes().iter() {
            let columns: Option<Vec<_>> =
                blocks.iter().map(|block| block.attributes().get(name)).collect();
            let column = columns.and_then(|columns| Attribute::concat(&columns));
            let column = column.ok_or(BlocksDiffer)?;
            points = points.with_attribute(name, column).map_err(|_| BlocksDiffer)?;
        }
        Ok(points)
    }
}

/// Computes the hash of points that are never in memory as a whole.
#[derive(Default)]
pub struct PointsHasher {
    positions: ColumnHasher,
    /// The name, the tag and the hash of each attribute. `None` before the first block.
    attributes: Option<Vec<(String, u8, ColumnHasher)>>,
    count: usize,
    bytes: usize,
}

/// What is known of points whose blocks were hashed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointsDigest {
    /// The hash that the points have as a value.
    pub hash: Hash,
    /// The number of points.
    pub count: usize,
    /// The memory that the points would take, in bytes.
    pub bytes: usize,
}

impl PointsHasher {
    /// Appends a block of points.
    ///
    /// # Errors
    /// If its attributes have other names or types than those of the first block.
    pub fn push(&mut self, block: &Points) -> Result<(), BlocksDiffer> {
        let attributes = block.attributes();
        let known = self.attributes.get_or_insert_with(|| {
            let each = attributes.iter();
            each.map(|(name, it)| (name.to_owned(), it.tag(), ColumnHasher::default())).collect()
        });
        let same = known.iter().map(|(name, tag, _)| (name.as_str(), *tag));
        if !same.eq(attributes.iter().map(|(name, attribute)| (name, attribute.tag()))) {
            return Err(BlocksDiffer);
        }
        for ((_, _, hasher), (_, attribute)) in known.iter_mut().zip(attributes.iter()) {
            let column = attribute.column();
            hasher.push(column.items(), column.bytes());
        }
        let positions: &dyn Bytes = block.positions();
        self.positions.push(positions.items(), positions.bytes());
        self.count += positions.items();
        self.bytes += block.size();
        Ok(())
    }

    /// Returns the hash of all points.
    pub fn finish(self) -> PointsDigest {
        let attributes = self.attributes.unwrap_or_default();
        let hash = Encoder::hash(Points::NAME, |to| {
            to.column_hash(self.positions.finish()).counts(&[attributes.len()]);
            for (name, tag, hasher) in attributes {
                to.text(&name).plain(&tag).column_hash(hasher.finish());
            }
        });
        PointsDigest { hash, count: self.count, bytes: self.bytes }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::AnyValue;

    fn points(count: usize) -> Points {
        let positions = (0..count).map(|k| Point3::new(k as f64, (k * k % 7) as f64, 0.5));
        let points = Points::new(positions.collect::<Vec<_>>()).unwrap();
        let colors = (0..count).map(|k| [k as u8, 1, 2]).collect();
        let points = points.with_attribute("color", Attribute::Color(colors)).unwrap();
        let numbers = (0..count).map(|k| k as f64 / 3.0).collect();
        points.with_attribute("intensity", Attribute::Number(numbers)).unwrap()
    }

    fn blocks(points: &Points, len: usize) -> Vec<Points> {
        let indices: Vec<_> = (0..points.positions().len() as u32).collect();
        indices.chunks(len).map(|indices| points.select(indices)).collect()
    }

    #[test]
    fn blocks_have_the_hash_and_the_content_of_all_points() {
        for count in [1, 700, 5000] {
            let points = points(count);
            for len in [1000, 65_536, 333] {
                let blocks = blocks(&points, len);
                assert_eq!(Points::concat(&blocks), Ok(points.clone()));
                let mut hasher = PointsHasher::default();
                blocks.iter().for_each(|block| hasher.push(block).unwrap());
                let expected = PointsDigest {
                    hash: AnyValue::new(points.clone()).hash(),
                    count,
                    bytes: points.size(),
                };
                assert_eq!(hasher.finish(), expected, "{count} {len}");
            }
        }
    }

    #[test]
    fn blocks_with_different_attributes_are_an_error() {
        let bare = Points::new(vec![Point3::origin()]).unwrap();
        let indices = Attribute::Index(vec![1].into());
        let other = points(1).with_attribute("intensity", indices).unwrap();
        for other in [bare, other] {
            assert_eq!(Points::concat(&[points(1), other.clone()]), Err(BlocksDiffer));
            assert_eq!(Points::concat(&[other.clone(), points(1)]), Err(BlocksDiffer));
            let mut hasher = PointsHasher::default();
            hasher.push(&points(1)).unwrap();
            assert_eq!(hasher.push(&other), Err(BlocksDiffer));
        }
        assert_eq!(Points::concat(&[]), Err(BlocksDiffer));
    }
}
