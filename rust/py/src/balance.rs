//! Bindings of the kernels of balance; see `mograft_kinematics`.

use mograft_kinematics::balance::{self, Bases};
use numpy::{IntoPyArray as _, PyArray1, PyUntypedArrayMethods as _};
use pyo3::prelude::*;

use crate::convert::{Floats, Indices, as_planar, as_usizes, kernel_error, poses_shape};

/// See [`balance::added_imbalances`].
///
/// `bases` has the base segments, their operators and their margins; `donors` has the donors and
/// their numbers.
#[pyfunction]
pub fn added_imbalances<'py>(
    py: Python<'py>,
    offsets: Floats<'py>,
    bases: (Indices<'py>, Floats<'py>, Floats<'py>),
    donors: (Indices<'py>, Indices<'py>),
    directions: Floats<'py>,
    scale: f64,
    threads: usize,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (segments, operators, margins) = &bases;
    let (segments, counts) = (as_usizes(segments)?, as_usizes(&donors.1)?);
    let [_, n_samples] = poses_shape(offsets.shape())?;
    let (offsets, directions) = (as_planar(&offsets)?, as_planar(&directions)?);
    let bases = Bases {
        segments: &segments,
        n_samples,
        operators: operators.as_slice()?,
        directions,
        margins: margins.as_slice()?,
        scale,
    };
    let donors = as_usizes(&donors.0)?;
    let added = py.detach(|| balance::added_imbalances(bases, offsets, &donors, &counts, threads));
    Ok(added.map_err(kernel_error)?.into_pyarray(py))
}
