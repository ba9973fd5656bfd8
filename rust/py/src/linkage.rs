//! Bindings of `mograft-linkage`. Each function bears its kernel's name.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use mograft_linkage::{self as kernel, Error, Level, Options, Tuning, Watch};
use numpy::{IntoPyArray as _, PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use numpy::{PyArrayDyn, PyUntypedArrayMethods as _};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{Array, into_array, value_error};

type Points<'py> = PyReadonlyArray2<'py, f64>;
type Labels<'py> = Bound<'py, PyArray1<i64>>;

/// How often Python is asked whether to go on.
const PAUSE: Duration = Duration::from_millis(50);

/// Run a kernel that asks now and then whether to go on, so that Ctrl-C works and progress shows.
fn watched<T: Send>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    run: impl FnOnce(Watch<'_>) -> Result<T, Error> + Send,
) -> PyResult<T> {
    let asked = Mutex::new(Instant::now());
    let raised = Mutex::new(None);
    let ask = |done: f64| {
        Python::attach(|py| {
            py.check_signals()?;
            progress.map_or(Ok(()), |progress| progress.call1(py, (done,)).map(drop))
        })
    };
    let watch = |done: f64| {
        if let Ok(mut asked) = asked.lock() {
            if asked.elapsed() < PAUSE {
                return true;
            }
            *asked = Instant::now();
        }
        ask(done)
            .map_err(|error| raised.lock().map(|mut raised| *raised = Some(error)))
            .is_ok()
    };
    let outcome = py.detach(|| run(&watch));
    match raised.into_inner() {
        Ok(Some(error)) => Err(error),
        _ => outcome.map_err(value_error),
    }
}

/// Hand the rows of a tree over to NumPy as `(n - 1, 4)`.
fn into_tree(py: Python<'_>, rows: Vec<[f64; 4]>) -> Array<'_> {
    let shape = [rows.len(), 4];
    into_array(py, rows.into_flattened(), &shape)
}

/// See `mograft.linkage`.
#[pyfunction]
pub fn linkage<'py>(
    py: Python<'py>,
    points: Points<'py>,
    threads: usize,
    memory: usize,
    progress: Option<Py<PyAny>>,
) -> Array<'py> {
    let (slice, dim) = (points.as_slice()?, points.shape()[1]);
    let rows = watched(py, progress.as_ref(), |watch| {
        let options = Options { threads, memory, watch: Some(watch), ..Options::default() };
        kernel::linkage(slice, dim, &options)
    })?;
    into_tree(py, rows)
}

/// See `mograft.linkage_condensed`.
#[pyfunction]
pub fn linkage_condensed<'py>(
    py: Python<'py>,
    distances: PyReadonlyArray1<'py, f64>,
    threads: usize,
    memory: usize,
    progress: Option<Py<PyAny>>,
) -> Array<'py> {
    let slice = distances.as_slice()?;
    let rows = watched(py, progress.as_ref(), |watch| {
        let options = Options { threads, memory, watch: Some(watch), ..Options::default() };
        kernel::linkage_condensed(slice, &options)
    })?;
    into_tree(py, rows)
}

/// See `mograft.cut`.
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
    let labels = watched(py, progress.as_ref(), |watch| {
        let options = Options { threads, memory, watch: Some(watch), ..Options::default() };
        kernel::cut(slice, dim, max_diameter, &options)
    })?;
    Ok(labels.into_pyarray(py))
}

/// For tests: the tree, with all that makes it fast turned as the caller likes.
///
/// `level` is 0 to 2 for the baseline, AVX2 and AVX-512; the rest is as in `Tuning`.
#[pyfunction]
pub fn linkage_tuned<'py>(
    py: Python<'py>,
    points: Points<'py>,
    threads: usize,
    level: usize,
    degree: f64,
    finish: usize,
    crowd: usize,
) -> Array<'py> {
    let tuning = tuning(level, degree, finish, crowd)?;
    let (slice, dim) = (points.as_slice()?, points.shape()[1]);
    let rows = watched(py, None, |watch| {
        let options = Options { threads, memory: 0, watch: Some(watch), tuning };
        kernel::linkage(slice, dim, &options)
    })?;
    into_tree(py, rows)
}

/// For tests: the cut, as [`linkage_tuned`] is the tree.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "a test turns all of them")]
pub fn cut_tuned<'py>(
    py: Python<'py>,
    points: Points<'py>,
    max_diameter: f64,
    threads: usize,
    level: usize,
    degree: f64,
    finish: usize,
    crowd: usize,
) -> PyResult<Labels<'py>> {
    let tuning = tuning(level, degree, finish, crowd)?;
    let (slice, dim) = (points.as_slice()?, points.shape()[1]);
    let labels = watched(py, None, |watch| {
        let options = Options { threads, memory: 0, watch: Some(watch), tuning };
        kernel::cut(slice, dim, max_diameter, &options)
    })?;
    Ok(labels.into_pyarray(py))
}

/// For tests: the tree as the plain nearest-neighbour chain finds it.
#[pyfunction]
pub fn linkage_by_chain<'py>(
    py: Python<'py>,
    points: Points<'py>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let (slice, dim) = (points.as_slice()?, points.shape()[1]);
    let rows = py
        .detach(|| kernel::linkage_by_chain(slice, dim))
        .map_err(value_error)?;
    into_tree(py, rows)
}

fn tuning(level: usize, degree: f64, finish: usize, crowd: usize) -> PyResult<Tuning> {
    let levels = [Level::Baseline, Level::Avx2, Level::Avx512];
    match levels.get(level) {
        Some(&level) => Ok(Tuning { level, degree, finish, crowd }),
        None => Err(PyValueError::new_err(format!("level must be 0, 1 or 2, got {level}"))),
    }
}
