//! Columns of a value as arrays of NumPy, which lie where the value has them.
//!
//! `__array_interface__` needs no copy here, no `unsafe`, and nothing of NumPy at import. It gives no way to write, because the object has
//! no buffer that could be asked for. The package `maquette` copies each array before users get it.

use maquette::AnyValue;
use maquette::value::{Items, Meaning, On, Part};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

/// A column of numbers. NumPy takes it by `__array_interface__`: as a view that cannot be written to and that keeps the column alive.
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
    /// Where the numbers begin.
    address: usize,
    /// What holds the numbers there, and never changes or moves them.
    _holder: Holder,
}

/// What holds the numbers of a column.
enum Holder {
    Value { _value: AnyValue },
    List { _items: Items<'static> },
}

impl Column {
    /// A column of a value, whose pixels come in rows of so many. What the value has side by side is not copied.
    pub(crate) fn of(value: &AnyValue, part: &Part<'_>, row: Option<usize>) -> Self {
        let (mut kind, address) = place(&part.items);
        if is_flags(part) {
            kind = "|b1";
        }
        let (address, holder) = match is_borrowed(&part.items) {
            // It lies in what `value` shares, which is as long as anyone shares it, and values never change.
            true => (address, Holder::Value { _value: value.clone() }),
            false => {
                let items = owned(&part.items);
                (place(&items).1, Holder::List { _items: items })
            }
        };
        let mut shape = vec![part.count()];
        if let Some(row) = row.filter(|row| part.on == On::Pixel && 0 < *row) {
            shape = vec![part.count() / row, row];
        }
        // A list of numbers has one direction, whereas places of a list with one place have two.
        if part.width != 1 {
            shape.push(part.width);
        }
        let (name, aside) = (part.name.clone().into_owned(), part.aside);
        let (on, meaning) = (part.on.word(), part.meaning.word());
        Self { name, on, meaning, aside, shape, kind, address, _holder: holder }
    }

    /// A column that belongs to no value, of so many numbers an element.
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

/// Returns true if the numbers are false and true. Aside of a value are bytes of bits, too.
fn is_flags(part: &Part<'_>) -> bool {
    let is_exact = part.meaning == Meaning::Exact && !part.aside;
    is_exact && matches!(part.items, Items::U8(_))
}

/// How NumPy calls the numbers, and where they begin.
fn place(items: &Items<'_>) -> (&'static str, usize) {
    // Whole numbers in the order of bytes of this machine.
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

fn owned(items: &Items<'_>) -> Items<'static> {
    match items {
        Items::F64(items) => Items::from(items.to_vec()),
        Items::F32(items) => Items::from(items.to_vec()),
        Items::U32(items) => Items::from(items.to_vec()),
        Items::U8(items) => Items::from(items.to_vec()),
    }
}
