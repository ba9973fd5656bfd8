//! Conversions between NumPy arrays and glam types.

use std::collections::TryReserveError;
use std::fmt::Display;
use std::ops::{Deref, DerefMut};

use glam::{DQuat, DVec2, DVec3};
use mograft_kinematics::{Error, sample};
use mograft_machine::memory;
use numpy::{
    Element, IntoPyArray as _, Ix1, Ix2, IxDyn, PyArray, PyArrayDyn, PyArrayMethods as _,
    PyReadonlyArray, PyReadwriteArray, PyUntypedArrayMethods as _, ndarray::Dimension,
};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;

/// A C-contiguous array that nothing writes during the call.
///
/// The conversions of `numpy` accept arrays in Fortran order, and panic if an array is written.
pub struct Input<'py, T: Element, D: Dimension>(PyReadonlyArray<'py, T, D>);

impl<'a, 'py, T: Element + 'a, D: Dimension + 'a> FromPyObject<'a, 'py> for Input<'py, T, D> {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let array = object.cast::<PyArray<T, D>>()?;
        check_order(&array)?;
        Ok(Self(array.try_readonly()?))
    }
}

impl<'py, T: Element, D: Dimension> Deref for Input<'py, T, D> {
    type Target = PyReadonlyArray<'py, T, D>;

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

/// A C-contiguous array that the call changes and nothing else uses.
pub struct Output<'py, T: Element, D: Dimension>(PyReadwriteArray<'py, T, D>);

impl<'a, 'py, T: Element + 'a, D: Dimension + 'a> FromPyObject<'a, 'py> for Output<'py, T, D> {
    type Error = PyErr;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let array = object.cast::<PyArray<T, D>>()?;
        check_order(&array)?;
        Ok(Self(array.try_readwrite()?))
    }
}

impl<'py, T: Element, D: Dimension> Deref for Output<'py, T, D> {
    type Target = PyReadwriteArray<'py, T, D>;

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl<T: Element, D: Dimension> DerefMut for Output<'_, T, D> {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut self.0
    }
}

fn check_order<T: Element, D: Dimension>(array: &Bound<'_, PyArray<T, D>>) -> PyResult<()> {
    if array.is_c_contiguous() {
        return Ok(());
    }
    Err(PyValueError::new_err("expected a C-contiguous array"))
}

/// An array of f64, of any shape.
pub type Floats<'py> = Input<'py, f64, IxDyn>;

/// An array of indices.
pub type Indices<'py> = Input<'py, i64, Ix1>;

/// An array of truth values.
pub type Flags<'py> = Input<'py, bool, Ix1>;

/// Rows of integers.
pub type IndexRows<'py> = Input<'py, i64, Ix2>;

/// An array returned to Python.
pub type Array<'py> = PyResult<Bound<'py, PyArrayDyn<f64>>>;

/// Rows of sampled segments, C-contiguous, in the precision in which they are stored.
#[derive(FromPyObject)]
pub enum Rows<'py> {
    /// As libraries store them.
    F32(Input<'py, f32, Ix2>),
    /// As they are computed.
    F64(Input<'py, f64, Ix2>),
}

/// View an array `(n, width)` as sampled segments.
pub fn as_rows<'a, T: Element>(
    array: &'a Input<'_, T, Ix2>,
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

/// View an array `(..., 2)` as vectors of a plane.
pub fn as_planar<'a>(array: &'a Floats<'_>) -> PyResult<&'a [DVec2]> {
    check_last_axis(array.shape(), 2)?;
    Ok(bytemuck::cast_slice(array.as_slice()?))
}

/// View an array `(..., 4)` as quaternions that may be changed.
pub fn as_quats_mut<'a>(array: &'a mut Output<'_, f64, IxDyn>) -> PyResult<&'a mut [DQuat]> {
    check_last_axis(array.shape(), 4)?;
    Ok(bytemuck::cast_slice_mut(array.as_slice_mut()?))
}

/// View an array `(..., 3)` as vectors that may be changed.
pub fn as_vecs_mut<'a>(array: &'a mut Output<'_, f64, IxDyn>) -> PyResult<&'a mut [DVec3]> {
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

/// The first two axes of an array `(n, n_joints, width)`.
pub fn poses_shape(shape: &[usize]) -> PyResult<[usize; 2]> {
    match *shape {
        [n, n_joints, _] => Ok([n, n_joints]),
        _ => {
            Err(PyValueError::new_err(format!("expected shape (n, n_joints, ...), got {shape:?}")))
        }
    }
}

/// Check that some arrays have the same number of elements.
pub fn check_equal<const N: usize>(lengths: [usize; N]) -> PyResult<()> {
    if lengths.windows(2).all(|pair| pair[0] == pair[1]) {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("expected arrays of equal length, got {lengths:?}")))
}

/// Iterate over two slices of the same length.
pub fn pairs<'a, A, B>(
    a: &'a [A],
    b: &'a [B],
) -> PyResult<impl ExactSizeIterator<Item = (&'a A, &'a B)>> {
    check_equal([a.len(), b.len()])?;
    Ok(a.iter().zip(b))
}

/// Convert indices, which must not be negative.
pub fn as_usizes(indices: &Indices<'_>) -> PyResult<Vec<usize>> {
    let as_usize = |&i: &i64| usize::try_from(i).map_err(value_error);
    let indices = indices.as_slice()?;
    let mut numbers = memory::with_capacity(indices.len()).map_err(kernel_error)?;
    for index in indices {
        numbers.push(as_usize(index)?);
    }
    Ok(numbers)
}

/// The shape of an array with its last axis replaced by `last`.
pub fn shape_with_last(array: &Floats<'_>, last: &[usize]) -> Vec<usize> {
    let shape = array.shape();
    [&shape[..shape.len().saturating_sub(1)], last].concat()
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
pub fn kernel_error(error: impl Into<Error>) -> PyErr {
    match error.into() {
        error @ Error::OutOfMemory { .. } => PyMemoryError::new_err(error.to_string()),
        error => value_error(error),
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
