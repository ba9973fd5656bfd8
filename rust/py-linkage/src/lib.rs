//! Python bindings of `mograft-linkage`. Every function has its kernel's name.
//!
//! Two extension modules export them: `mograft._core` and `mograft_linkage._core`.
#![allow(clippy::needless_pass_by_value, reason = "PyO3 extracts arguments by value")]
#![allow(clippy::missing_errors_doc, reason = "errors are Python exceptions of the package")]

use std::ops::ControlFlow;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use mograft_linkage::{self as kernel, Error, Options, Progress, Table};
use numpy::{
    IntoPyArray as _, PyArray1, PyArray2, PyArrayMethods as _, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods as _,
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

type Points<'py> = PyReadonlyArray2<'py, f64>;
type Tree<'py> = PyResult<Bound<'py, PyArray2<f64>>>;
type Labels<'py> = Bound<'py, PyArray1<i64>>;

/// Least time between two calls of the progress callback.
const CALLBACK_INTERVAL: Duration = Duration::from_millis(50);

/// Run a kernel without the GIL; pass its progress to Python and let Python stop it.
///
/// The callback checks for signals, so that Ctrl-C works, and calls `progress` with the fraction
/// done. An exception of either stops the kernel and is raised.
fn with_progress<T: Send>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    run: impl FnOnce(Progress<'_>) -> Result<T, Error> + Send,
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
    let result = py.detach(|| run(&callback));
    match exception.into_inner() {
        Ok(Some(error)) => Err(error),
        _ => result.map_err(linkage_error),
    }
}

fn options(threads: usize, max_matrix_bytes: usize, progress: Progress<'_>) -> Options<'_> {
    Options { threads, max_matrix_bytes, progress: Some(progress), ..Options::default() }
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
    memory: usize,
    progress: Option<Py<PyAny>>,
) -> Tree<'py> {
    let (slice, dim) = (points.as_slice()?, points.shape()[1]);
    let rows = with_progress(py, progress.as_ref(), |progress| {
        let options = options(threads, memory, progress);
        kernel::linkage(Table::rows(slice, dim), &options)
    })?;
    into_tree(py, rows)
}

/// See [`kernel::linkage_condensed`].
#[pyfunction]
pub fn linkage_condensed<'py>(
    py: Python<'py>,
    distances: PyReadonlyArray1<'py, f64>,
    threads: usize,
    memory: usize,
    progress: Option<Py<PyAny>>,
) -> Tree<'py> {
    let slice = distances.as_slice()?;
    let rows = with_progress(py, progress.as_ref(), |progress| {
        let options = options(threads, memory, progress);
        kernel::linkage_condensed(slice, &options)
    })?;
    into_tree(py, rows)
}

/// See [`kernel::cut`].
#[pyfunction]
pub fn cut<'py>(
    py: Python<'py>,
    points: Points<'py>,
    max_diameter: f64,
    threads: usize,
    memory: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Labels<'py>> {
    let (slice, dim) = (points.as_slice()?, points.shape()[1]);
    let labels = with_progress(py, progress.as_ref(), |progress| {
        let options = options(threads, memory, progress);
        kernel::cut(Table::rows(slice, dim), max_diameter, &options)
    })?;
    Ok(labels.into_pyarray(py))
}
