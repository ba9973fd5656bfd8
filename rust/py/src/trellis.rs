//! Bindings of `mograft-trellis`. Every function has its kernel's name.

use mograft_trellis::{Error, Trellis};
use numpy::{IntoPyArray as _, PyArray1};
use pyo3::prelude::*;

use crate::convert::{Floats, Indices, as_usizes, memory_error, value_error};

/// See [`mograft_trellis::sample`].
#[pyfunction]
pub fn sample<'py>(
    py: Python<'py>,
    counts: Indices<'py>,
    unary: Floats<'py>,
    pairwise: Floats<'py>,
    temperature: f64,
    draws: Floats<'py>,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let (counts, unary) = (as_usizes(&counts)?, unary.as_slice()?);
    let (pairwise, draws) = (pairwise.as_slice()?, draws.as_slice()?);
    let trellis = Trellis { counts: &counts, unary, pairwise };
    let path = py
        .detach(|| mograft_trellis::sample(trellis, temperature, draws))
        .map_err(|error| match error {
            Error::OutOfMemory(error) => memory_error(error),
            _ => value_error(error),
        })?;
    let indices: Result<Vec<_>, _> = path.into_iter().map(i64::try_from).collect();
    Ok(indices.map_err(value_error)?.into_pyarray(py))
}
