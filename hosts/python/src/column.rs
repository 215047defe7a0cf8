//! Columns of a value as NumPy arrays, which share the value's memory.
//!
//! Columns implement NumPy's `__array_interface__`. It needs no copy, no `unsafe` code, and no NumPy when the module is imported. The
//! arrays are read-only, because values never change, and a column does not implement Python's buffer protocol. The package `maquette`
//! copies each array before it reaches users.

use maquette::AnyValue;
use maquette::value::{ElementKind, Items, Meaning, Part};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

/// A column of numbers. NumPy reads it through `__array_interface__`, as a read-only view that keeps the column alive.
#[pyclass(frozen)]
pub(crate) struct Column {
    #[pyo3(get)]
    name: String,
    #[pyo3(get)]
    on: &'static str,
    #[pyo3(get)]
    meaning: &'static str,
    #[pyo3(get)]
    aside: bool,
    shape: Vec<usize>,
    kind: &'static str,
    /// The memory address of the numbers.
    address: usize,
    /// Keeps the numbers alive; it never changes or moves them.
    _holder: Holder,
}

/// The owner of a column's numbers: the value or a copied list.
enum Holder {
    Value { _value: AnyValue },
    List { _items: Items<'static> },
}

impl Column {
    /// Makes a column of a part of `value`. `row` is the number of pixels per row of a picture. Contiguous data is not copied.
    pub(crate) fn new(value: &AnyValue, part: &Part<'_>, row: Option<usize>) -> Self {
        let (mut kind, address) = place(&part.items);
        if is_flags(part) {
            kind = "|b1";
        }
        let (address, holder) = match is_borrowed(&part.items) {
            // The numbers are in the memory of `value`. The clone keeps them alive, and values never change.
            true => (address, Holder::Value { _value: value.clone() }),
            false => {
                let items = to_owned_items(&part.items);
                (place(&items).1, Holder::List { _items: items })
            }
        };
        let mut shape = vec![part.count()];
        if let Some(row) = row.filter(|row| part.element_kind == ElementKind::Pixel && 0 < *row) {
            shape = vec![part.count() / row, row];
        }
        // With one number per element the array has one dimension, otherwise two, even if the list has only one element.
        if part.width != 1 {
            shape.push(part.width);
        }
        let (name, aside) = (part.name.clone().into_owned(), part.is_hidden);
        let (on, meaning) = (part.element_kind.word(), part.meaning.word());
        Self { name, on, meaning, aside, shape, kind, address, _holder: holder }
    }

    /// Makes a column that is not part of a value, with `width` numbers per element.
    pub(crate) fn list(name: &str, items: impl Into<Items<'static>>, width: usize) -> Self {
        let items = items.into();
        let shape = if width == 1 { vec![items.len()] } else { vec![items.len() / width, width] };
        let (kind, address) = place(&items);
        let holder = Holder::List { _items: items };
        let (name, on, meaning) = (name.to_owned(), "entry", "index");
        Self { name, on, meaning, aside: false, shape, kind, address, _holder: holder }
    }
}

#[pymethods]
impl Column {
    #[getter]
    fn __array_interface__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let interface = PyDict::new(py);
        interface.set_item("version", 3)?;
        interface.set_item("shape", PyTuple::new(py, &self.shape)?)?;
        interface.set_item("typestr", self.kind)?;
        let is_read_only = true;
        interface.set_item("data", (self.address, is_read_only))?;
        Ok(interface)
    }
}

/// Returns true if NumPy must read the bytes as booleans. Bytes in other parts may mean something else, for example bits.
fn is_flags(part: &Part<'_>) -> bool {
    let is_exact = part.meaning == Meaning::Exact && !part.is_hidden;
    is_exact && matches!(part.items, Items::U8(_))
}

/// Returns NumPy's name of the number type, and the address of the numbers.
fn place(items: &Items<'_>) -> (&'static str, usize) {
    // `=` means the byte order of this machine.
    match items {
        Items::F64(items) => ("=f8", items.as_ptr().expose_provenance()),
        Items::F32(items) => ("=f4", items.as_ptr().expose_provenance()),
        Items::U32(items) => ("=u4", items.as_ptr().expose_provenance()),
        Items::U8(items) => ("|u1", items.as_ptr().expose_provenance()),
    }
}

fn is_borrowed(items: &Items<'_>) -> bool {
    use std::borrow::Cow::Borrowed;
    matches!(
        items,
        Items::F64(Borrowed(_))
            | Items::F32(Borrowed(_))
            | Items::U32(Borrowed(_))
            | Items::U8(Borrowed(_))
    )
}

fn to_owned_items(items: &Items<'_>) -> Items<'static> {
    match items {
        Items::F64(items) => Items::from(items.to_vec()),
        Items::F32(items) => Items::from(items.to_vec()),
        Items::U32(items) => Items::from(items.to_vec()),
        Items::U8(items) => Items::from(items.to_vec()),
    }
}
