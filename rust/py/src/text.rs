//! Bindings of `mograft-text`. Every function has its kernel's name.

use mograft_text::{Joint, Limits, Open};
use numpy::{
    Element, IntoPyArray as _, Ix1, PyArray1, PyArray2, PyArrayMethods as _,
    PyUntypedArrayMethods as _,
};
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

/// The fields of `mograft_text::Hierarchy`, and the open joints. A row of the first array has name
/// start, name end, line ends, column, channels and parent of a joint; one of the third, parent and
/// `before` of an end site.
type HierarchyTuple<'py> = (
    Bound<'py, PyArray2<i64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<i64>>,
    Bound<'py, PyArray2<f64>>,
    Vec<OpenTuple>,
    usize,
    Vec<OpenTuple>,
);

/// Index, count of children and count of end sites.
type OpenTuple = (usize, usize, usize);

/// Read the usual joints and end sites in `text` from byte `start` on. `limits` are those of joints
/// and levels.
#[pyfunction]
pub fn scan_hierarchy<'py>(
    py: Python<'py>,
    text: &[u8],
    start: usize,
    opened: Vec<OpenTuple>,
    n_joints: usize,
    limits: (usize, usize),
) -> PyResult<HierarchyTuple<'py>> {
    let text = tail(text, start)?;
    let limits = Limits { joints: limits.0, levels: limits.1 };
    let mut open: Vec<_> = opened
        .into_iter()
        .map(|(joint, n_children, n_end_sites)| Open { joint, n_children, n_end_sites })
        .collect();
    let found = py.detach(|| mograft_text::scan_hierarchy(text, &mut open, n_joints, limits));
    let found = found.map_err(memory_error)?;
    let joints = found.joints.iter().map(|joint| {
        let &Joint { name, n_line_ends, column, channels, parent } = joint;
        [name.0, name.1, n_line_ends, column, channels, parent]
    });
    let sites = found
        .end_sites
        .iter()
        .map(|site| [site.parent, site.before]);
    let as_tuples = |open: Vec<Open>| {
        let tuples = open
            .into_iter()
            .map(|own| (own.joint, own.n_children, own.n_end_sites));
        tuples.collect()
    };
    Ok((
        integer_rows(py, joints)?,
        rows(py, found.offsets)?,
        integer_rows(py, sites)?,
        rows(py, found.end_offsets)?,
        as_tuples(found.unusual),
        found.n_bytes,
        as_tuples(open),
    ))
}

fn rows<T: Element, const N: usize>(
    py: Python<'_>,
    rows: Vec<[T; N]>,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    let shape = [rows.len(), N];
    rows.into_flattened().into_pyarray(py).reshape(shape)
}

fn integer_rows<const N: usize>(
    py: Python<'_>,
    table: impl Iterator<Item = [usize; N]>,
) -> PyResult<Bound<'_, PyArray2<i64>>> {
    // Indices of bytes in memory are below the greatest i64.
    let signed = |number| i64::try_from(number).unwrap_or(i64::MAX);
    rows(py, table.map(|row| row.map(signed)).collect())
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
