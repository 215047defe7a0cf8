//! A direction as a line of text: `x y z`.

use maquette_node::pack::{FileFormat, NewFile};
use maquette_syntax::error::Error;
use maquette_value::Direction;

/// Writes a direction.
pub(super) struct DirectionTxt;

impl FileFormat for DirectionTxt {
    type Value = Direction;
    const ENDING: &'static str = "txt";

    fn write(direction: &Direction, name: &str) -> Result<Vec<NewFile>, Error> {
        let [x, y, z]: [f64; 3] = direction.vector().into_inner().into();
        Ok(NewFile::only(name, format!("{x} {y} {z}\n").into_bytes()))
    }
}
