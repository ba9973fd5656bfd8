//! Bindings of `mograft-text`. Every function has its kernel's name.

use numpy::{IntoPyArray as _, PyArray1, PyUntypedArrayMethods as _};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::convert::{Floats, memory_error};

/// The fields of `mograft_text::Scan`.
type ScanTuple<'py> =
    (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>, usize, bool);

/// Parse the numbers of `text` from byte `start` on.
#[pyfunction]
pub fn scan_numbers<'py>(
    py: Python<'py>,
    text: &[u8],
    start: usize,
    capacity: usize,
) -> PyResult<ScanTuple<'py>> {
    let text = tail(text, start)?;
    let scan = py.detach(|| mograft_text::scan_numbers(text, capacity));
    let scan = scan.map_err(memory_error)?;
    Ok((
        scan.values.into_pyarray(py),
        scan.lines.into_pyarray(py),
        scan.counts.into_pyarray(py),
        scan.n_bytes,
        scan.has_bad_token,
    ))
}

/// The bytes of a text from `start` on.
fn tail(text: &[u8], start: usize) -> PyResult<&[u8]> {
    let n_bytes = text.len();
    text.get(start..).ok_or_else(|| {
        let message = format!("`start` must be between 0 and {n_bytes}, got {start}");
        PyIndexError::new_err(message)
    })
}

/// Format an array `(..., n_columns)` as text, one line per row.
#[pyfunction]
pub fn format_rows<'py>(py: Python<'py>, values: Floats<'py>) -> PyResult<Bound<'py, PyBytes>> {
    let slice = values.as_slice()?;
    let n_columns = values.shape().last().copied().unwrap_or(1);
    let mut text = Vec::new();
    py.detach(|| mograft_text::format_rows(slice, n_columns, &mut text))
        .map_err(memory_error)?;
    PyBytes::new_with(py, text.len(), |bytes| {
        bytes.copy_from_slice(&text);
        Ok(())
    })
}
