//! Bindings of `mograft-spectral`. Each function bears its kernel's name.

use numpy::PyUntypedArrayMethods as _;
use pyo3::prelude::*;

use crate::convert::{Floats, into_array, value_error};

/// See `mograft._algebra.eigen`.
#[pyfunction]
pub fn eigen<'py>(
    py: Python<'py>,
    matrix: Floats<'py>,
    wanted: usize,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let (slice, n) = (matrix.as_slice()?, matrix.shape()[0]);
    let (values, vectors) = py
        .detach(|| mograft_spectral::eigen(slice, n, wanted))
        .map_err(value_error)?;
    let values = into_array(py, values, &[n])?;
    Ok((values.into_any(), into_array(py, vectors, &[n, wanted.min(n)])?.into_any()))
}
