//! Bindings of `mograft-text`. Every function has its kernel's name.

use numpy::{IntoPyArray as _, PyArray1, PyReadwriteArray1, PyUntypedArrayMethods as _};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::convert::{Floats, memory_error, value_error};

/// The fields of `mograft_text::Scan`: count of numbers written, count of bytes read, count of
/// numbers before every line end, and whether a bad token follows.
type ScanTuple<'py> = (usize, usize, Bound<'py, PyArray1<i64>>, bool);

/// Parse the numbers of `text` from byte `start` on into `out`.
#[pyfunction]
#[pyo3(signature = (text, start, out, *, last))]
pub fn scan_numbers<'py>(
    py: Python<'py>,
    text: &[u8],
    start: usize,
    mut out: PyReadwriteArray1<'py, f64>,
    last: bool,
) -> PyResult<ScanTuple<'py>> {
    let n_bytes = text.len();
    let Some(text) = text.get(start..) else {
        let message = format!("`start` must be between 0 and {n_bytes}, got {start}");
        return Err(PyIndexError::new_err(message));
    };
    let slots = out.as_slice_mut()?;
    let scan = py.detach(|| mograft_text::scan_numbers(text, last, slots));
    let scan = scan.map_err(memory_error)?;
    let line_ends: Result<Vec<_>, _> = scan.line_ends.into_iter().map(i64::try_from).collect();
    let line_ends = line_ends.map_err(value_error)?.into_pyarray(py);
    Ok((scan.n_values, scan.n_bytes, line_ends, scan.has_bad_token))
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
