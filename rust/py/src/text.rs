//! Bindings of `mograft-text`. Every function has its kernel's name.

use numpy::{IntoPyArray as _, Ix1, PyArray1, PyUntypedArrayMethods as _};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::convert::{Floats, Output, memory_error, value_error};

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
    mut out: Output<'py, f64, Ix1>,
    last: bool,
) -> PyResult<ScanTuple<'py>> {
    let text = tail(text, start)?;
    let slots = out.as_slice_mut()?;
    let scan = py.detach(|| mograft_text::scan_numbers(text, last, slots));
    let scan = scan.map_err(memory_error)?;
    let line_ends: Result<Vec<_>, _> = scan.line_ends.into_iter().map(i64::try_from).collect();
    let line_ends = line_ends.map_err(value_error)?.into_pyarray(py);
    Ok((scan.n_values, scan.n_bytes, line_ends, scan.has_bad_token))
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
