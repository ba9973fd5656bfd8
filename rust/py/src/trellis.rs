//! Bindings of `mograft-trellis`. Every function has its kernel's name.

use mograft_trellis::{Error, Trellis};
use numpy::{IntoPyArray as _, PyArray1};
use pyo3::prelude::*;

use crate::convert::{Flags, Floats, Indices, as_usizes, memory_error, value_error};

/// Indices returned to Python.
type IndexArray<'py> = Bound<'py, PyArray1<i64>>;

/// See [`mograft_trellis::keep_cheapest`].
#[pyfunction]
pub fn keep_cheapest<'py>(
    py: Python<'py>,
    counts: Indices<'py>,
    costs: Floats<'py>,
    is_first: Flags<'py>,
    limit: usize,
) -> PyResult<(IndexArray<'py>, IndexArray<'py>)> {
    let counts = as_usizes(&counts)?;
    let (costs, is_first) = (costs.as_slice()?, is_first.as_slice()?);
    let (kept, kept_counts) = py
        .detach(|| mograft_trellis::keep_cheapest(&counts, costs, is_first, limit))
        .map_err(trellis_error)?;
    Ok((from_usizes(py, kept)?, from_usizes(py, kept_counts)?))
}

/// See [`mograft_trellis::sample`].
#[pyfunction]
pub fn sample<'py>(
    py: Python<'py>,
    counts: Indices<'py>,
    unary: Floats<'py>,
    pairwise: Floats<'py>,
    temperature: f64,
    draws: Floats<'py>,
) -> PyResult<IndexArray<'py>> {
    let (counts, unary) = (as_usizes(&counts)?, unary.as_slice()?);
    let (pairwise, draws) = (pairwise.as_slice()?, draws.as_slice()?);
    let trellis = Trellis { counts: &counts, unary, pairwise };
    let path = py
        .detach(|| mograft_trellis::sample(trellis, temperature, draws))
        .map_err(trellis_error)?;
    from_usizes(py, path)
}

fn from_usizes(py: Python<'_>, numbers: Vec<usize>) -> PyResult<IndexArray<'_>> {
    // `collect` reuses the allocation.
    let indices: Result<Vec<_>, _> = numbers.into_iter().map(i64::try_from).collect();
    Ok(indices.map_err(value_error)?.into_pyarray(py))
}

fn trellis_error(error: Error) -> PyErr {
    match error {
        Error::OutOfMemory(error) => memory_error(error),
        _ => value_error(error),
    }
}
