//! Bindings of `mograft-linkage`. Each function bears its kernel's name.

use mograft_linkage::{self as kernel, Options};
use numpy::{
    IntoPyArray as _, PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods as _,
};
use pyo3::prelude::*;

use crate::convert::{Array, into_array, value_error};

type Points<'py> = PyReadonlyArray2<'py, f64>;

/// Hand the rows of a tree over to NumPy as `(n - 1, 4)`.
fn into_tree(py: Python<'_>, rows: Vec<[f64; 4]>) -> Array<'_> {
    let shape = [rows.len(), 4];
    into_array(py, rows.into_flattened(), &shape)
}

/// See `mograft.linkage`.
#[pyfunction]
pub fn linkage<'py>(py: Python<'py>, points: Points<'py>, threads: usize) -> Array<'py> {
    let (slice, dim) = (points.as_slice()?, points.shape()[1]);
    let rows = py
        .detach(|| kernel::linkage(slice, dim, &Options { threads }))
        .map_err(value_error)?;
    into_tree(py, rows)
}

/// See `mograft.linkage_condensed`.
#[pyfunction]
pub fn linkage_condensed<'py>(
    py: Python<'py>,
    distances: PyReadonlyArray1<'py, f64>,
    threads: usize,
) -> Array<'py> {
    let distances = distances.as_slice()?.to_vec();
    let rows = py
        .detach(|| kernel::linkage_condensed(distances, &Options { threads }))
        .map_err(value_error)?;
    into_tree(py, rows)
}

/// See `mograft.cut`.
#[pyfunction]
pub fn cut<'py>(
    py: Python<'py>,
    points: Points<'py>,
    max_diameter: f64,
    threads: usize,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let (slice, dim) = (points.as_slice()?, points.shape()[1]);
    let labels = py
        .detach(|| kernel::cut(slice, dim, max_diameter, &Options { threads }))
        .map_err(value_error)?;
    Ok(labels.into_pyarray(py))
}
