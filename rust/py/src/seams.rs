//! Bindings of the kernels of donors and seams; see `mograft_kinematics`.
//!
//! Values are rotations if their last axis has four components, else translations.

use glam::{DQuat, DVec3};
use mograft_kinematics::gradient::{self, Donors, Objective};
use mograft_kinematics::offset::{self, Offsets, PieceTimes};
use mograft_kinematics::{resample, value};
use numpy::{IntoPyArray as _, IxDyn, PyArrayDyn, PyArrayMethods as _, PyUntypedArrayMethods as _};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{
    Array, Floats, Indices, Output, as_quats, as_quats_mut, as_usizes, as_vecs, as_vecs_mut,
    from_quats, from_vecs, kernel_error, poses_shape,
};

/// See [`offset::add_offsets`].
#[pyfunction]
pub fn add_offsets<'py>(
    py: Python<'py>,
    values: Floats<'py>,
    times: (Indices<'py>, Floats<'py>, Floats<'py>, Floats<'py>),
    before: (Floats<'py>, Floats<'py>),
    after: (Floats<'py>, Floats<'py>),
) -> Array<'py> {
    let [n, n_joints] = poses_shape(values.shape())?;
    let piece = as_usizes(&times.0)?;
    let times = PieceTimes {
        piece: &piece,
        elapsed: times.1.as_slice()?,
        left: times.2.as_slice()?,
        windows: times.3.as_slice()?,
    };
    let before = Offsets { values: as_vecs(&before.0)?, rates: as_vecs(&before.1)? };
    let after = Offsets { values: as_vecs(&after.0)?, rates: as_vecs(&after.1)? };
    if values.shape().last() == Some(&4) {
        let quats = as_quats(&values)?;
        let sums = py.detach(|| offset::add_offsets(quats, n_joints, times, before, after));
        return from_quats(py, sums.map_err(kernel_error)?, &[n, n_joints]);
    }
    let vecs = as_vecs(&values)?;
    let sums = py.detach(|| offset::add_offsets(vecs, n_joints, times, before, after));
    from_vecs(py, sums.map_err(kernel_error)?, &[n, n_joints])
}

/// See [`gradient::smooth_gradient`].
#[pyfunction]
pub fn smooth_gradient<'py>(
    py: Python<'py>,
    mut values: Output<'py, f64, IxDyn>,
    donors: (Indices<'py>, Indices<'py>, Floats<'py>, Indices<'py>, Floats<'py>),
    weights: [f64; 3],
    limits: (f64, usize, f64),
) -> PyResult<()> {
    let [_, n_joints] = poses_shape(values.shape())?;
    let is_rotation = values.shape().last() == Some(&4);
    let (starts, stops, rows, seams, accelerations) = &donors;
    let [starts, stops, seams] = [as_usizes(starts)?, as_usizes(stops)?, as_usizes(seams)?];
    // Those of the donors that end at the seams, then those of the donors that start there.
    let accelerations = as_vecs(accelerations)?;
    let accelerations = accelerations.split_at(accelerations.len() / 2).into();
    let (reach, n_fixed, spread) = limits;
    let objective = Objective { weights, reach, n_fixed, spread };
    let (starts, stops, seams) = (&starts[..], &stops[..], &seams[..]);
    if is_rotation {
        let (quats, rows) = (as_quats_mut(&mut values)?, as_quats(rows)?);
        let donors = Donors { starts, stops, rows, seams, accelerations };
        return py
            .detach(|| gradient::smooth_gradient(quats, n_joints, donors, objective))
            .map_err(kernel_error);
    }
    let (vecs, rows) = (as_vecs_mut(&mut values)?, as_vecs(rows)?);
    let donors = Donors { starts, stops, rows, seams, accelerations };
    py.detach(|| gradient::smooth_gradient(vecs, n_joints, donors, objective))
        .map_err(kernel_error)
}

/// See [`resample::sample_clips`].
#[pyfunction]
pub fn sample_clips<'py>(
    py: Python<'py>,
    clips: Vec<Floats<'py>>,
    clip: Indices<'py>,
    times: Floats<'py>,
) -> Array<'py> {
    let (clip, times) = (as_usizes(&clip)?, times.as_slice()?);
    let n_joints = joint_count(&clips)?;
    let shape = [times.len(), n_joints];
    if is_rotations(&clips) {
        let quats = clips.iter().map(as_quats).collect::<PyResult<Vec<_>>>()?;
        let rows = py.detach(|| resample::sample_clips(&quats, n_joints, &clip, times));
        return from_quats(py, rows.map_err(kernel_error)?, &shape);
    }
    let vecs = clips.iter().map(as_vecs).collect::<PyResult<Vec<_>>>()?;
    let rows = py.detach(|| resample::sample_clips(&vecs, n_joints, &clip, times));
    from_vecs(py, rows.map_err(kernel_error)?, &shape)
}

/// Values, velocities and accelerations.
type States<'py> =
    (Bound<'py, PyArrayDyn<f64>>, Bound<'py, PyArrayDyn<f64>>, Bound<'py, PyArrayDyn<f64>>);

/// See [`resample::clip_states`].
#[pyfunction]
pub fn clip_states<'py>(
    py: Python<'py>,
    clips: Vec<Floats<'py>>,
    clip: Indices<'py>,
    frames: Indices<'py>,
) -> PyResult<States<'py>> {
    let (clip, frames) = (as_usizes(&clip)?, as_usizes(&frames)?);
    let n_joints = joint_count(&clips)?;
    let shape = [frames.len(), n_joints];
    let (values, velocities, accelerations) = if is_rotations(&clips) {
        let quats = clips.iter().map(as_quats).collect::<PyResult<Vec<_>>>()?;
        let found = py.detach(|| resample::clip_states(&quats, n_joints, &clip, &frames));
        let (values, velocities, accelerations) = found.map_err(kernel_error)?;
        (from_quats(py, values, &shape)?, velocities, accelerations)
    } else {
        let vecs = clips.iter().map(as_vecs).collect::<PyResult<Vec<_>>>()?;
        let found = py.detach(|| resample::clip_states(&vecs, n_joints, &clip, &frames));
        let (values, velocities, accelerations) = found.map_err(kernel_error)?;
        (from_vecs(py, values, &shape)?, velocities, accelerations)
    };
    Ok((values, from_vecs(py, velocities, &shape)?, from_vecs(py, accelerations, &shape)?))
}

/// The number of joints of all clips.
fn joint_count(clips: &[Floats<'_>]) -> PyResult<usize> {
    let mut counts = clips
        .iter()
        .map(|own| poses_shape(own.shape()).map(|shape| shape[1]));
    let first = counts.next().transpose()?.unwrap_or(0);
    for count in counts {
        if count? != first {
            return Err(PyValueError::new_err("`clips` must have the same number of joints"));
        }
    }
    Ok(first)
}

fn is_rotations(clips: &[Floats<'_>]) -> bool {
    clips
        .first()
        .is_some_and(|own| own.shape().last() == Some(&4))
}

/// See [`value::replace_joints`]. Without a different value, the first result is `base` itself.
#[pyfunction]
pub fn replace_joints<'py>(
    py: Python<'py>,
    base: Floats<'py>,
    part: Floats<'py>,
    joints: Indices<'py>,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let [n, n_joints] = poses_shape(base.shape())?;
    let joints = as_usizes(&joints)?;
    let (values, mask) = if base.shape().last() == Some(&4) {
        let (quats, part) = (as_quats(&base)?, as_quats(&part)?);
        let found =
            py.detach(|| value::replace_joints(quats, n_joints, part, &joints, DQuat::IDENTITY));
        let (quats, mask) = found.map_err(kernel_error)?;
        (quats.map(|quats| from_quats(py, quats, &[n, n_joints])), mask)
    } else {
        let (vecs, part) = (as_vecs(&base)?, as_vecs(&part)?);
        let found = py.detach(|| value::replace_joints(vecs, n_joints, part, &joints, DVec3::ZERO));
        let (vecs, mask) = found.map_err(kernel_error)?;
        (vecs.map(|vecs| from_vecs(py, vecs, &[n, n_joints])), mask)
    };
    let mask = mask.into_pyarray(py).reshape([n, joints.len()])?;
    let values = values
        .transpose()?
        .map_or_else(|| base.as_any().clone(), Bound::into_any);
    Ok((values, mask.into_any()))
}
