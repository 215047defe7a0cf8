//! Values for Python: their parts, files and pictures.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::OnceLock;

use maquette::render::{Look, Projection, Representation, View, picture};
use maquette::value::{ElementKind, FactValue, Items, Meaning, Mesh, Parts};
use maquette::{AnyValue, Error, NewFile, Tolerance, ValueType, compare};
use numpy::{PyArrayDescrMethods, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::{PyMemoryError, PyOSError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};

use crate::column::Column;
use crate::workers::{on_threads, until_signal};
use crate::{CATALOG, plain};

/// A value, such as a mesh or an image.
#[pyclass(frozen)]
pub(crate) struct Value {
    value: AnyValue,
    /// The facts and columns, which are made when they are first needed.
    made_of: OnceLock<MadeOf>,
}

struct MadeOf {
    facts: Vec<(String, FactValue)>,
    columns: Vec<Py<Column>>,
}

impl Value {
    pub(crate) fn new(value: AnyValue) -> Self {
        Self { value, made_of: OnceLock::new() }
    }

    pub(crate) fn any(&self) -> &AnyValue {
        &self.value
    }

    fn made_of(&self, py: Python<'_>) -> PyResult<&MadeOf> {
        if let Some(made_of) = self.made_of.get() {
            return Ok(made_of);
        }
        let (facts, columns) = on_threads(py, || {
            let parts = self.value.parts();
            let columns: Vec<_> = parts
                .columns
                .iter()
                .map(|part| Column::new(&self.value, part, parts.row))
                .collect();
            let facts = parts.facts.into_iter().map(|fact| (fact.name.into_owned(), fact.value));
            (Vec::from_iter(facts), columns)
        })?;
        let columns =
            columns.into_iter().map(|column| Py::new(py, column)).collect::<PyResult<_>>()?;
        // If another thread has made the facts and columns first, its result is used. Both results are equal.
        Ok(self.made_of.get_or_init(|| MadeOf { facts, columns }))
    }
}

#[pymethods]
impl Value {
    /// The name of the value's type.
    #[getter]
    fn kind(&self) -> &'static str {
        self.value.kind().name
    }

    /// The hash of the value's content, 64 hexadecimal digits.
    #[getter]
    fn hash(&self) -> String {
        self.value.hash().to_string()
    }

    /// The memory of the value in bytes.
    #[getter]
    fn size(&self) -> usize {
        self.value.size()
    }

    /// Returns the facts and counts by name. A value can be made again from its facts and columns.
    fn facts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let facts = PyDict::new(py);
        for (name, fact) in &self.made_of(py)?.facts {
            match fact {
                FactValue::Count(count) => facts.set_item(name, count)?,
                FactValue::Size(size) => facts.set_item(name, (size[0], size[1]))?,
                FactValue::Flag(flag) => facts.set_item(name, flag)?,
                FactValue::Text(text) => facts.set_item(name, text)?,
            }
        }
        Ok(facts)
    }

    /// Returns the columns of the value.
    fn columns<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        PyList::new(py, &self.made_of(py)?.columns)
    }

    /// Returns a summary of the value.
    fn describe<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let value = self.value.clone();
        let summary = until_signal(py, move || value.describe())?;
        dict(py, &summary.0)
    }

    /// Returns a summary of the element at a pixel.
    fn probe<'py>(&self, py: Python<'py>, at: [usize; 2]) -> PyResult<Bound<'py, PyDict>> {
        let summary = on_threads(py, || self.value.probe(at))?;
        dict(py, &summary.0)
    }

    /// Returns the files that contain the value, with their names and contents, and warnings of lost data. The extension of the file name
    /// `name` determines the format.
    fn files<'py>(&self, py: Python<'py>, name: String) -> PyResult<Files<'py>> {
        let (files, doubts) = self.written(py, name)?;
        let files = files.into_iter().map(|it| (it.name, PyBytes::new(py, &it.bytes)));
        Ok((files.collect(), doubts))
    }

    /// Writes the value to the file `path` and, if its format needs them, to other files beside it. Returns all paths, and warnings of lost
    /// data.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<(Vec<PathBuf>, Vec<String>)> {
        let name = path.file_name().unwrap_or_default().to_str().map(str::to_owned);
        let name = name.ok_or_else(|| {
            let path = path.display();
            PyValueError::new_err(format!("{path}: expected a file name in UTF-8; rename the file"))
        })?;
        let (files, doubts) = self.written(py, name)?;
        let paths = py.detach(|| maquette::save(files, &path)).map_err(|error| {
            match error.system_code() {
                // Python chooses the subclass of OSError by the error code.
                Some(code) => {
                    PyOSError::new_err((code, error.to_string(), error.path.into_os_string()))
                }
                None => PyOSError::new_err(error.to_string()),
            }
        })?;
        Ok((paths, doubts))
    }

    /// Renders the value from the front, rotated to the right by `yaw` and upwards by `pitch`, in degrees. Without a size, the picture has
    /// the value's native size.
    fn render(
        &self,
        py: Python<'_>,
        size: Option<[usize; 2]>,
        yaw: f64,
        pitch: f64,
        zoom: f64,
        orthographic: bool,
    ) -> PyResult<Option<Self>> {
        let flat = [Projection::Perspective, Projection::Orthographic];
        let projection = flat[usize::from(orthographic)];
        let kind = if size.is_some() { Representation::Fitted } else { Representation::Native };
        let size = size.unwrap_or(View::front().size);
        check_room(size[0].saturating_mul(size[1]).saturating_mul(BYTES_PER_PIXEL))?;
        let view = View { size, yaw, pitch, zoom, projection, ..View::front() };
        let look = Look { view, representation: kind, backdrop: None };
        let value = self.value.clone();
        let drawn = until_signal(py, move || picture(&value.show(), &look).map(AnyValue::new))?;
        Ok(drawn.map(Self::new))
    }

    /// Returns two columns for a mesh: the two vertices of each edge, and the edge that begins at each corner.
    fn edges(&self, py: Python<'_>) -> PyResult<Option<(Column, Column)>> {
        let Some(mesh) = self.value.get::<Mesh>() else { return Ok(None) };
        let edges = on_threads(py, || mesh.edges())?;
        let ends = Column::list("edges", edges.vertices.into_flattened(), 2);
        Ok(Some((ends, Column::list("edge of a corner", edges.of_corner, 1))))
    }

    /// Returns the differences from another value, in the format of `maquette compare --json`.
    #[expect(clippy::too_many_arguments, reason = "the package calls it, with names")]
    fn compare<'py>(
        &self,
        py: Python<'py>,
        other: &Self,
        max: Option<f64>,
        rms: Option<f64>,
        normals: Option<f64>,
        attributes: BTreeMap<String, f64>,
        differing: f64,
        level: f64,
        relative: f64,
        remeshed: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let tolerance = Tolerance {
            max,
            rms,
            normals,
            attributes,
            differing,
            level,
            relative,
            remeshed,
            ..Tolerance::default()
        };
        let (old, new) = (self.value.clone(), other.value.clone());
        let comparison = until_signal(py, move || compare(&old, &new, &tolerance))?;
        plain::from_json(py, &comparison.to_json())
    }

    /// Returns the unit normals of a mesh's vertices.
    fn normals(&self, py: Python<'_>) -> PyResult<Option<Column>> {
        let Some(mesh) = self.value.get::<Mesh>() else { return Ok(None) };
        let normals = on_threads(py, || mesh.vertex_normals())?;
        let normals = normals.iter().flat_map(|it| [it.x, it.y, it.z]);
        Ok(Some(Column::list("normals", Vec::from_iter(normals), 3)))
    }

    /// Returns the faces of a mesh as triangles, given by indices of corners.
    fn triangle_corners(&self, py: Python<'_>) -> PyResult<Option<Column>> {
        let Some(mesh) = self.value.get::<Mesh>() else { return Ok(None) };
        let triangles = on_threads(py, || mesh.triangle_corners().into_flattened())?;
        Ok(Some(Column::list("triangle corners", triangles, 3)))
    }

    /// Returns the faces of a mesh as triangles, given by indices of vertices. Larger faces are cut along inner diagonals.
    fn triangles(&self, py: Python<'_>) -> PyResult<Option<Column>> {
        let Some(mesh) = self.value.get::<Mesh>() else { return Ok(None) };
        let triangles = on_threads(py, || mesh.triangles().as_flattened().to_vec())?;
        Ok(Some(Column::list("triangles", triangles, 3)))
    }
}

impl Value {
    /// Returns the files that contain the value, and warnings of lost data. The extension of the file name `name` determines the format.
    fn written(&self, py: Python<'_>, name: String) -> PyResult<(Vec<NewFile>, Vec<String>)> {
        let value = self.value.clone();
        let written = until_signal(py, move || {
            let files = CATALOG.write(&value, &name)?;
            Ok((files, CATALOG.doubts(&value, &name)))
        })?;
        written.map_err(|error: Error| PyValueError::new_err(error.to_string()))
    }
}

/// The names and contents of files, and warnings of lost data.
type Files<'py> = (Vec<(String, Bound<'py, PyBytes>)>, Vec<String>);

fn dict<'py>(
    py: Python<'py>,
    entries: &[(String, serde_json::Value)],
) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (name, entry) in entries {
        dict.set_item(name, plain::from_json(py, entry)?)?;
    }
    Ok(dict)
}

/// Number of bytes per pixel that rendering needs: color and depth.
const BYTES_PER_PIXEL: usize = 4;

/// Raises MemoryError if this number of bytes cannot be allocated. An attempt to allocate them without this check would end the process.
fn check_room(bytes: usize) -> PyResult<()> {
    let tried = Vec::<u8>::new().try_reserve_exact(bytes);
    tried.map_err(|_| PyMemoryError::new_err(format!("there is no room for {bytes} bytes")))
}

/// Returns the value type with this name.
pub(crate) fn kind_of(name: &str) -> PyResult<&'static ValueType> {
    CATALOG
        .value_type(name)
        .ok_or_else(|| PyValueError::new_err(format!("there is no type of values `{name}`")))
}

/// Makes a value from columns. Each column is given as (name, element kind, meaning of the numbers, components per element, contiguous
/// array).
#[pyfunction]
pub(crate) fn make(
    py: Python<'_>,
    kind: &str,
    columns: Vec<(String, String, String, usize, Bound<'_, PyUntypedArray>)>,
    facts: Vec<(String, Bound<'_, PyAny>)>,
    row: Option<usize>,
) -> PyResult<Value> {
    let kind = kind_of(kind)?;
    let arrays = columns.iter().map(|(.., array)| Array::from_array(array));
    let arrays = arrays.collect::<PyResult<Vec<_>>>()?;
    let bytes = columns.iter().map(|(.., array)| array.len() * array.dtype().itemsize());
    check_room(bytes.sum::<usize>().saturating_mul(2))?;
    let mut parts = Parts { row, ..Parts::default() };
    for ((name, on, meaning, width, _), array) in columns.iter().zip(&arrays) {
        let on = ElementKind::from_word(on).map_err(PyValueError::new_err)?;
        let meaning = Meaning::from_word(meaning).map_err(PyValueError::new_err)?;
        parts.push(&name[..], on, meaning, *width, array.items()?);
    }
    for (name, fact) in facts {
        parts.fact(name, fact_of(&fact)?);
    }
    let value = on_threads(py, || kind.from_parts(&parts))?;
    value.map(Value::new).map_err(|error| PyValueError::new_err(error.to_string()))
}

/// A NumPy array with one of the number types that columns can have.
enum Array<'py> {
    F64(PyReadonlyArrayDyn<'py, f64>),
    F32(PyReadonlyArrayDyn<'py, f32>),
    U32(PyReadonlyArrayDyn<'py, u32>),
    U8(PyReadonlyArrayDyn<'py, u8>),
}

impl<'py> Array<'py> {
    fn from_array(array: &Bound<'py, PyUntypedArray>) -> PyResult<Self> {
        if let Ok(array) = array.extract() {
            return Ok(Self::F64(array));
        }
        if let Ok(array) = array.extract() {
            return Ok(Self::F32(array));
        }
        if let Ok(array) = array.extract() {
            return Ok(Self::U32(array));
        }
        let told = || PyTypeError::new_err(format!("no column holds {} numbers", array.dtype()));
        array.extract().map(Self::U8).map_err(|_| told())
    }

    fn items(&self) -> PyResult<Items<'_>> {
        Ok(match self {
            Self::F64(array) => Items::from(array.as_slice()?),
            Self::F32(array) => Items::F32(array.as_slice()?.into()),
            Self::U32(array) => Items::from(array.as_slice()?),
            Self::U8(array) => Items::from(array.as_slice()?),
        })
    }
}

fn fact_of(fact: &Bound<'_, PyAny>) -> PyResult<FactValue> {
    if let Ok(flag) = fact.extract::<bool>() {
        return Ok(flag.into());
    }
    if let Ok(count) = fact.extract::<usize>() {
        return Ok(count.into());
    }
    if let Ok(size) = fact.extract::<[usize; 2]>() {
        return Ok(size.into());
    }
    Ok(fact.extract::<String>()?.into())
}
