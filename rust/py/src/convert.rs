//! Conversions between NumPy arrays and glam types.

use std::collections::TryReserveError;
use std::fmt::Display;

use glam::{DQuat, DVec3};
use mograft_kinematics::{Error, memory, sample};
use numpy::{
    Element, IntoPyArray as _, PyArrayDyn, PyArrayMethods as _, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArrayDyn, PyReadwriteArrayDyn, PyUntypedArrayMethods as _,
};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;

/// A C-contiguous array of f64, of any shape.
pub type Floats<'py> = PyReadonlyArrayDyn<'py, f64>;

/// A C-contiguous array of indices.
pub type Indices<'py> = PyReadonlyArray1<'py, i64>;

/// An array returned to Python.
pub type Array<'py> = PyResult<Bound<'py, PyArrayDyn<f64>>>;

/// Rows of sampled segments, C-contiguous, in the precision in which they are stored.
#[derive(FromPyObject)]
pub enum Rows<'py> {
    /// As libraries store them.
    F32(PyReadonlyArray2<'py, f32>),
    /// As they are computed.
    F64(PyReadonlyArray2<'py, f64>),
}

/// View an array `(n, width)` as sampled segments.
pub fn as_rows<'a, T: Element>(
    array: &'a PyReadonlyArray2<'_, T>,
    (n_samples, n_joints): (usize, usize),
) -> PyResult<sample::Rows<'a, T>> {
    Ok(sample::Rows { numbers: array.as_slice()?, width: array.shape()[1], n_samples, n_joints })
}

/// View an array `(..., 4)` as quaternions, scalar last.
pub fn as_quats<'a>(array: &'a Floats<'_>) -> PyResult<&'a [DQuat]> {
    check_last_axis(array.shape(), 4)?;
    Ok(bytemuck::cast_slice(array.as_slice()?))
}

/// View an array `(..., 3)` as vectors.
pub fn as_vecs<'a>(array: &'a Floats<'_>) -> PyResult<&'a [DVec3]> {
    check_last_axis(array.shape(), 3)?;
    Ok(bytemuck::cast_slice(array.as_slice()?))
}

/// View an array `(..., 4)` as quaternions that may be changed.
pub fn as_quats_mut<'a>(array: &'a mut PyReadwriteArrayDyn<'_, f64>) -> PyResult<&'a mut [DQuat]> {
    check_last_axis(array.shape(), 4)?;
    Ok(bytemuck::cast_slice_mut(array.as_slice_mut()?))
}

/// View an array `(..., 3)` as vectors that may be changed.
pub fn as_vecs_mut<'a>(array: &'a mut PyReadwriteArrayDyn<'_, f64>) -> PyResult<&'a mut [DVec3]> {
    check_last_axis(array.shape(), 3)?;
    Ok(bytemuck::cast_slice_mut(array.as_slice_mut()?))
}

fn check_last_axis(shape: &[usize], expected: usize) -> PyResult<()> {
    match shape {
        [.., last] if *last == expected => Ok(()),
        shape => {
            Err(PyValueError::new_err(format!("expected shape (..., {expected}), got {shape:?}")))
        }
    }
}

/// Convert indices, which must not be negative.
pub fn as_usizes(indices: &Indices<'_>) -> PyResult<Vec<usize>> {
    let as_usize = |&i: &i64| usize::try_from(i).map_err(value_error);
    let indices = indices.as_slice()?;
    let mut numbers = memory::reserve(indices.len()).map_err(kernel_error)?;
    for index in indices {
        numbers.push(as_usize(index)?);
    }
    Ok(numbers)
}

/// The shape of an array with its last axis replaced by `last`.
pub fn shape_with_last(array: &Floats<'_>, last: &[usize]) -> Vec<usize> {
    let shape = array.shape();
    [&shape[..shape.len() - 1], last].concat()
}

/// Convert a vector to an array of the given shape, without a copy.
pub fn into_array<'py>(py: Python<'py>, flat: Vec<f64>, shape: &[usize]) -> Array<'py> {
    flat.into_pyarray(py).reshape(shape)
}

/// Convert quaternions to an array `(*shape, 4)`.
pub fn from_quats<'py>(py: Python<'py>, quats: Vec<DQuat>, shape: &[usize]) -> Array<'py> {
    // `collect` reuses the allocation.
    let numbers: Vec<_> = quats.into_iter().map(|q| q.to_array()).collect();
    into_array(py, numbers.into_flattened(), &[shape, &[4]].concat())
}

/// Convert vectors to an array `(*shape, 3)`.
pub fn from_vecs<'py>(py: Python<'py>, vecs: Vec<DVec3>, shape: &[usize]) -> Array<'py> {
    let numbers: Vec<_> = vecs.into_iter().map(|v| v.to_array()).collect();
    into_array(py, numbers.into_flattened(), &[shape, &[3]].concat())
}

/// The Python exception for an error of a kernel of motion.
pub fn kernel_error(error: Error) -> PyErr {
    match error {
        Error::OutOfMemory { .. } => PyMemoryError::new_err(error.to_string()),
        _ => value_error(error),
    }
}

/// The Python exception if the system refuses memory.
pub fn memory_error(error: TryReserveError) -> PyErr {
    PyMemoryError::new_err(error.to_string())
}

/// The Python exception for any other error.
pub fn value_error(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}
