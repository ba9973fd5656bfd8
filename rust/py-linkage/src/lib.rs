//! Python bindings of `mograft-linkage`. Every function has its kernel's name.
//!
//! Two extension modules export them: `mograft._core` and `mograft_linkage._core`.
#![allow(clippy::needless_pass_by_value, reason = "PyO3 extracts arguments by value")]
#![allow(clippy::missing_errors_doc, reason = "errors are Python exceptions of the package")]

use std::ops::ControlFlow;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use mograft_linkage::{self as kernel, Coordinate, Error, Options, Table};
use numpy::{
    Element, IntoPyArray as _, PyArray1, PyArray2, PyArrayMethods as _, PyReadonlyArray1,
    PyReadonlyArray2, PyUntypedArrayMethods as _,
};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;

/// See [`kernel::available_memory`].
#[pyfunction]
#[must_use]
pub fn available_memory() -> usize {
    kernel::available_memory()
}

/// The Python exception for an error of the kernel.
#[allow(clippy::needless_pass_by_value, reason = "passed to `map_err`")]
fn linkage_error(error: Error) -> PyErr {
    match error {
        Error::MemoryLimit { .. } | Error::OutOfMemory { .. } => {
            PyMemoryError::new_err(error.to_string())
        }
        _ => PyValueError::new_err(error.to_string()),
    }
}

/// Points in C or Fortran order, of either precision.
#[derive(FromPyObject)]
pub enum Points<'py> {
    /// Single precision.
    F32(PyReadonlyArray2<'py, f32>),
    /// Double precision.
    F64(PyReadonlyArray2<'py, f64>),
}

/// Distances of either precision.
#[derive(FromPyObject)]
pub enum Distances<'py> {
    /// Single precision.
    F32(PyReadonlyArray1<'py, f32>),
    /// Double precision.
    F64(PyReadonlyArray1<'py, f64>),
}

/// View an array as points, without a copy.
fn as_table<'a, T: Coordinate + Element>(
    array: &'a PyReadonlyArray2<'_, T>,
) -> PyResult<Table<'a, T>> {
    let (slice, dim) = (array.as_slice()?, array.shape()[1]);
    let is_row_major = array.is_c_contiguous();
    Ok(if is_row_major { Table::rows(slice, dim) } else { Table::columns(slice, dim) })
}

type Tree<'py> = PyResult<Bound<'py, PyArray2<f64>>>;
type Labels<'py> = Bound<'py, PyArray1<i64>>;

/// Threads, largest size of a matrix, largest memory of the call, and progress callback.
type Limits<'a> = (usize, usize, Option<usize>, Option<&'a Py<PyAny>>);

/// Least time between two calls of the progress callback.
const CALLBACK_INTERVAL: Duration = Duration::from_millis(25);

/// Run a kernel without the GIL; pass its progress to Python and let Python stop it.
///
/// The callback checks for signals, so that Ctrl-C works, and calls `progress` with the fraction
/// done. An exception of either stops the kernel and is raised.
fn with_options<T: Send>(
    py: Python<'_>,
    (threads, max_matrix_bytes, max_bytes, progress): Limits<'_>,
    run: impl FnOnce(&Options<'_>) -> Result<T, Error> + Send,
) -> PyResult<T> {
    let last_call = Mutex::new(Instant::now());
    let exception = Mutex::new(None);
    let call_python = |fraction: f64| {
        Python::attach(|py| {
            py.check_signals()?;
            progress.map_or(Ok(()), |progress| progress.call1(py, (fraction,)).map(drop))
        })
    };
    let callback = |fraction: f64| {
        if let Ok(mut last_call) = last_call.lock() {
            if last_call.elapsed() < CALLBACK_INTERVAL {
                return ControlFlow::Continue(());
            }
            *last_call = Instant::now();
        }
        match call_python(fraction) {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => {
                if let Ok(mut exception) = exception.lock() {
                    *exception = Some(error);
                }
                ControlFlow::Break(())
            }
        }
    };
    let options = |progress| Options {
        threads,
        max_matrix_bytes,
        max_bytes: max_bytes.unwrap_or(usize::MAX),
        progress: Some(progress),
        ..Options::default()
    };
    let result = py.detach(|| run(&options(&callback)));
    match exception.into_inner() {
        Ok(Some(error)) => Err(error),
        _ => result.map_err(linkage_error),
    }
}

/// Convert the rows of a tree to an array `(n - 1, 4)`.
fn into_tree(py: Python<'_>, rows: Vec<[f64; 4]>) -> Tree<'_> {
    let shape = [rows.len(), 4];
    rows.into_flattened().into_pyarray(py).reshape(shape)
}

/// See [`kernel::linkage`].
#[pyfunction]
pub fn linkage<'py>(
    py: Python<'py>,
    points: Points<'py>,
    threads: usize,
    matrix_bytes: usize,
    max_bytes: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> Tree<'py> {
    let limits = (threads, matrix_bytes, max_bytes, progress.as_ref());
    let rows = match &points {
        Points::F32(points) => {
            let table = as_table(points)?;
            with_options(py, limits, |options| kernel::linkage(table, options))
        }
        Points::F64(points) => {
            let table = as_table(points)?;
            with_options(py, limits, |options| kernel::linkage(table, options))
        }
    };
    into_tree(py, rows?)
}

/// See [`kernel::linkage_condensed`].
#[pyfunction]
pub fn linkage_condensed<'py>(
    py: Python<'py>,
    distances: Distances<'py>,
    threads: usize,
    matrix_bytes: usize,
    max_bytes: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> Tree<'py> {
    let limits = (threads, matrix_bytes, max_bytes, progress.as_ref());
    let rows = match &distances {
        Distances::F32(distances) => {
            let slice = distances.as_slice()?;
            with_options(py, limits, |options| kernel::linkage_condensed(slice, options))
        }
        Distances::F64(distances) => {
            let slice = distances.as_slice()?;
            with_options(py, limits, |options| kernel::linkage_condensed(slice, options))
        }
    };
    into_tree(py, rows?)
}

/// See [`kernel::cut`].
#[pyfunction]
pub fn cut<'py>(
    py: Python<'py>,
    points: Points<'py>,
    max_diameter: f64,
    threads: usize,
    matrix_bytes: usize,
    max_bytes: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Labels<'py>> {
    let limits = (threads, matrix_bytes, max_bytes, progress.as_ref());
    let labels = match &points {
        Points::F32(points) => {
            let table = as_table(points)?;
            with_options(py, limits, |options| kernel::cut(table, max_diameter, options))
        }
        Points::F64(points) => {
            let table = as_table(points)?;
            with_options(py, limits, |options| kernel::cut(table, max_diameter, options))
        }
    };
    Ok(labels?.into_pyarray(py))
}
