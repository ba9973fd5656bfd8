//! Bindings of `mograft-kinematics`. Each function bears its kernel's name.

use glam::{DQuat, DVec3};
use mograft_kinematics::energy::{self, Omega};
use mograft_kinematics::{Error, capsule, forward, pose, resample, rotation, sample};
use numpy::{IntoPyArray as _, PyArrayMethods as _, PyReadonlyArray1, PyUntypedArrayMethods as _};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{
    Array, Floats, Rows, as_quats, as_rows, as_vecs, from_quats, from_vecs, into_array,
    value_error, with_last,
};

type Indices<'py> = PyReadonlyArray1<'py, i64>;

/// See `mograft.rotations.exp`.
#[pyfunction]
pub fn exp<'py>(py: Python<'py>, vectors: Floats<'py>) -> Array<'py> {
    let slice = as_vecs(&vectors)?;
    let quats: Vec<DQuat> = py.detach(|| slice.iter().map(|&v| rotation::exp(v)).collect());
    from_quats(py, quats, &with_last(&vectors, &[]))
}

/// See `mograft.rotations.log`.
#[pyfunction]
pub fn log<'py>(py: Python<'py>, rotations: Floats<'py>) -> Array<'py> {
    let slice = as_quats(&rotations)?;
    let vectors: Vec<DVec3> = py.detach(|| slice.iter().map(|&q| rotation::log(q)).collect());
    from_vecs(py, vectors, &with_last(&rotations, &[]))
}

/// See `mograft.rotations.multiply`.
#[pyfunction]
pub fn multiply<'py>(py: Python<'py>, a: Floats<'py>, b: Floats<'py>) -> Array<'py> {
    let pairs = as_quats(&a)?.iter().zip(as_quats(&b)?);
    let products = py.detach(|| pairs.map(|(&a, &b)| a.mul_quat(b)).collect());
    from_quats(py, products, &with_last(&a, &[]))
}

/// See `mograft.rotations.rotate`.
#[pyfunction]
pub fn rotate<'py>(py: Python<'py>, rotations: Floats<'py>, vectors: Floats<'py>) -> Array<'py> {
    let pairs = as_quats(&rotations)?.iter().zip(as_vecs(&vectors)?);
    let turned: Vec<DVec3> = py.detach(|| pairs.map(|(&q, &v)| rotation::rotate(q, v)).collect());
    from_vecs(py, turned, &with_last(&vectors, &[]))
}

/// See `mograft.rotations.angle`.
#[pyfunction]
pub fn angle<'py>(py: Python<'py>, a: Floats<'py>, b: Floats<'py>) -> Array<'py> {
    let pairs = as_quats(&a)?.iter().zip(as_quats(&b)?);
    let angles = py.detach(|| pairs.map(|(&a, &b)| rotation::angle(a, b)).collect());
    into_array(py, angles, &with_last(&a, &[]))
}

/// See `mograft.rotations.from_euler`.
#[pyfunction]
pub fn from_euler<'py>(py: Python<'py>, angles: Floats<'py>, axes: Vec<usize>) -> Array<'py> {
    let shape = with_last(&angles, &[]);
    let n = shape.iter().product();
    let slice = angles.as_slice()?;
    let quats = py.detach(|| rotation::from_euler(slice, &axes, n));
    from_quats(py, quats, &shape)
}

/// See `mograft.bvh`.
#[pyfunction]
pub fn from_channels<'py>(
    py: Python<'py>,
    values: Floats<'py>,
    starts: Vec<usize>,
    turns: Vec<(usize, usize)>,
    radians: f64,
) -> Array<'py> {
    let &[n_frames, n_channels] = values.shape() else {
        return Err(PyValueError::new_err("expected shape (n_frames, n_channels)"));
    };
    let n_joints = starts.len().saturating_sub(1);
    let slice = values.as_slice()?;
    let quats = py
        .detach(|| rotation::from_channels(slice, n_channels, &starts, &turns, radians))
        .map_err(value_error)?;
    from_quats(py, quats, &[n_frames, n_joints])
}

/// See `mograft.rotations.to_euler`.
#[pyfunction]
pub fn to_euler<'py>(
    py: Python<'py>,
    rotations: Floats<'py>,
    axes: [usize; 3],
    near: [f64; 3],
) -> Array<'py> {
    let slice = as_quats(&rotations)?;
    let angles = py
        .detach(|| rotation::to_euler(slice, axes, near))
        .into_flattened();
    into_array(py, angles, &with_last(&rotations, &[3]))
}

/// See `mograft.rotations.hermite`.
#[pyfunction]
pub fn hermite<'py>(
    py: Python<'py>,
    start: Floats<'py>,
    end: Floats<'py>,
    leaving: Floats<'py>,
    reaching: Floats<'py>,
    t: Floats<'py>,
) -> Array<'py> {
    let (from, to) = (as_quats(&start)?, as_quats(&end)?);
    let (leaving, reaching) = (as_vecs(&leaving)?, as_vecs(&reaching)?);
    let t = t.as_slice()?;
    let quats: Vec<DQuat> = py.detach(|| {
        let ends = from.iter().zip(to).zip(leaving.iter().zip(reaching)).zip(t);
        ends.map(|(((&a, &b), (&u, &v)), &t)| resample::hermite(a, b, u, v, t))
            .collect()
    });
    from_quats(py, quats, &with_last(&start, &[]))
}

/// See `mograft.Motion.world_positions`.
#[pyfunction]
pub fn world<'py>(
    py: Python<'py>,
    parents: Indices<'py>,
    rotations: Floats<'py>,
    positions: Floats<'py>,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let (quats, vecs) = (as_quats(&rotations)?, as_vecs(&positions)?);
    let parents = parents.as_slice()?;
    let (turned, placed) = py
        .detach(|| forward::world(parents, quats, vecs))
        .map_err(value_error)?;
    let shape = with_last(&rotations, &[]);
    Ok((from_quats(py, turned, &shape)?.into_any(), from_vecs(py, placed, &shape)?.into_any()))
}

/// See `mograft.kinetic_energy`.
#[pyfunction]
pub fn kinetic_energy<'py>(
    py: Python<'py>,
    parents: Indices<'py>,
    rotations: Floats<'py>,
    inertia: Floats<'py>,
    frame_time: f64,
    omega: &str,
) -> Array<'py> {
    let omega = match omega {
        "world" => Omega::World,
        "local" => Omega::Local,
        _ => return Err(PyValueError::new_err("omega must be 'world' or 'local'")),
    };
    let (parents, quats) = (parents.as_slice()?, as_quats(&rotations)?);
    let inertia = inertia.as_slice()?;
    let energy = py
        .detach(|| energy::kinetic_energy(parents, quats, inertia, frame_time, omega))
        .map_err(value_error)?;
    let n_frames = energy.len();
    into_array(py, energy, &[n_frames])
}

type AtTimes<K> = fn(&[f64], &[K], usize, &[f64]) -> Result<Vec<K>, Error>;

fn rotations_at<'py>(
    py: Python<'py>,
    kernel: AtTimes<DQuat>,
    frame_times: &Floats<'py>,
    rotations: &Floats<'py>,
    times: &Floats<'py>,
) -> Array<'py> {
    let n_joints = rotations.shape()[1];
    let (frame_times, times) = (frame_times.as_slice()?, times.as_slice()?);
    let quats = as_quats(rotations)?;
    let resampled = py
        .detach(|| kernel(frame_times, quats, n_joints, times))
        .map_err(value_error)?;
    from_quats(py, resampled, &[times.len(), n_joints])
}

/// See `mograft.resample.slerp`.
#[pyfunction]
pub fn slerp<'py>(
    py: Python<'py>,
    frame_times: Floats<'py>,
    rotations: Floats<'py>,
    times: Floats<'py>,
) -> Array<'py> {
    rotations_at(py, resample::slerp, &frame_times, &rotations, &times)
}

/// See `mograft.resample.cubic`.
#[pyfunction]
pub fn cubic<'py>(
    py: Python<'py>,
    frame_times: Floats<'py>,
    rotations: Floats<'py>,
    times: Floats<'py>,
) -> Array<'py> {
    rotations_at(py, resample::cubic, &frame_times, &rotations, &times)
}

/// See `mograft.resample.cubic_positions`.
#[pyfunction]
pub fn cubic_positions<'py>(
    py: Python<'py>,
    frame_times: Floats<'py>,
    positions: Floats<'py>,
    times: Floats<'py>,
) -> Array<'py> {
    let n_joints = positions.shape()[1];
    let (frame_times, times) = (frame_times.as_slice()?, times.as_slice()?);
    let vecs = as_vecs(&positions)?;
    let resampled = py
        .detach(|| resample::cubic_positions(frame_times, vecs, n_joints, times))
        .map_err(value_error)?;
    from_vecs(py, resampled, &[times.len(), n_joints])
}

fn as_usizes(indices: &Indices<'_>) -> PyResult<Vec<usize>> {
    let as_usize = |&i: &i64| usize::try_from(i).map_err(value_error);
    indices.as_slice()?.iter().map(as_usize).collect()
}

/// See `mograft.resample.segments`.
#[pyfunction]
pub fn segments<'py>(
    py: Python<'py>,
    rotations: Floats<'py>,
    starts: Indices<'py>,
    stops: Indices<'py>,
    counts: Indices<'py>,
) -> Array<'py> {
    let n_joints = rotations.shape()[1];
    let [starts, stops, counts] = [as_usizes(&starts)?, as_usizes(&stops)?, as_usizes(&counts)?];
    let quats = as_quats(&rotations)?;
    let resampled = py
        .detach(|| resample::segments(quats, n_joints, &starts, &stops, &counts))
        .map_err(value_error)?;
    from_quats(py, resampled, &[counts.iter().sum(), n_joints])
}

/// See `mograft.resample.segments_positions`.
#[pyfunction]
pub fn segments_positions<'py>(
    py: Python<'py>,
    positions: Floats<'py>,
    starts: Indices<'py>,
    stops: Indices<'py>,
    counts: Indices<'py>,
) -> Array<'py> {
    let n_joints = positions.shape()[1];
    let [starts, stops, counts] = [as_usizes(&starts)?, as_usizes(&stops)?, as_usizes(&counts)?];
    let vecs = as_vecs(&positions)?;
    let resampled = py
        .detach(|| resample::segments_positions(vecs, n_joints, &starts, &stops, &counts))
        .map_err(value_error)?;
    from_vecs(py, resampled, &[counts.iter().sum(), n_joints])
}

/// See `mograft.embedding.moments`.
#[pyfunction]
pub fn moments<'py>(py: Python<'py>, rows: Rows<'py>, shape: (usize, usize)) -> Array<'py> {
    let summed = match &rows {
        Rows::Single(own) => {
            let rows = as_rows(own, shape)?;
            py.detach(|| sample::moments(rows))
        }
        Rows::Double(own) => {
            let rows = as_rows(own, shape)?;
            py.detach(|| sample::moments(rows))
        }
    };
    into_array(py, summed.map_err(value_error)?, &[shape.1, 4, 4])
}

/// See `mograft.embedding.features`.
#[pyfunction]
pub fn features<'py>(
    py: Python<'py>,
    rows: Rows<'py>,
    shape: (usize, usize),
    joints: Indices<'py>,
    references: Floats<'py>,
    n_rest: usize,
    threads: usize,
) -> Array<'py> {
    let (joints, from) = (as_usizes(&joints)?, as_quats(&references)?);
    let (n, vectors) = match &rows {
        Rows::Single(own) => {
            let rows = as_rows(own, shape)?;
            (own.shape()[0], py.detach(|| sample::features(rows, &joints, from, n_rest, threads)))
        }
        Rows::Double(own) => {
            let rows = as_rows(own, shape)?;
            (own.shape()[0], py.detach(|| sample::features(rows, &joints, from, n_rest, threads)))
        }
    };
    let wide = 3 * shape.0 * joints.len() + n_rest;
    into_array(py, vectors.map_err(value_error)?, &[n, wide])
}

/// See `mograft.substitution.pose_gaps`.
#[pyfunction]
pub fn pose_gaps<'py>(py: Python<'py>, ends: Floats<'py>, starts: Floats<'py>) -> Array<'py> {
    let n_joints = ends.shape()[1];
    let shape = [ends.shape()[0], starts.shape()[0]];
    let (from, to) = (as_quats(&ends)?, as_quats(&starts)?);
    let gaps = py
        .detach(|| pose::pose_gaps(from, to, n_joints))
        .map_err(value_error)?;
    into_array(py, gaps, &shape)
}

/// See `mograft.substitution.velocity_gaps`.
#[pyfunction]
pub fn velocity_gaps<'py>(py: Python<'py>, ends: Floats<'py>, starts: Floats<'py>) -> Array<'py> {
    let n_joints = ends.shape()[1];
    let shape = [ends.shape()[0], starts.shape()[0]];
    let (from, to) = (as_vecs(&ends)?, as_vecs(&starts)?);
    let gaps = py
        .detach(|| pose::velocity_gaps(from, to, n_joints))
        .map_err(value_error)?;
    into_array(py, gaps, &shape)
}

/// See `mograft.capsules.Capsules.ends`.
#[pyfunction]
pub fn capsule_ends<'py>(
    py: Python<'py>,
    turned: Floats<'py>,
    placed: Floats<'py>,
    joints: Indices<'py>,
    bones: Floats<'py>,
) -> Array<'py> {
    let &[n_frames, n_joints, _] = turned.shape() else {
        return Err(PyValueError::new_err("expected shape (n_frames, n_joints, 4)"));
    };
    let (quats, vecs) = (as_quats(&turned)?, as_vecs(&placed)?);
    let (joints, bones) = (as_usizes(&joints)?, as_vecs(&bones)?);
    let ends = py
        .detach(|| capsule::capsule_ends(quats, vecs, n_joints, &joints, bones))
        .map_err(value_error)?;
    from_vecs(py, ends, &[n_frames, joints.len(), 2])
}

/// See `mograft.capsules.clearance`.
#[pyfunction]
pub fn clearance<'py>(
    py: Python<'py>,
    ends: Floats<'py>,
    radii: Floats<'py>,
    others: Floats<'py>,
    other_radii: Floats<'py>,
    at: Indices<'py>,
    pairs: (Indices<'py>, Indices<'py>),
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let (own, far) = (as_vecs(&ends)?, as_vecs(&others)?);
    let (radii, other_radii, at) = (radii.as_slice()?, other_radii.as_slice()?, as_usizes(&at)?);
    let (left, right) = pairs;
    let pairs: Vec<_> = as_usizes(&left)?
        .into_iter()
        .zip(as_usizes(&right)?)
        .collect();
    let (distances, which) = py
        .detach(|| capsule::clearance(own, radii, far, other_radii, &at, &pairs))
        .map_err(value_error)?;
    let n_frames = distances.len();
    let (left, right) = (left.as_slice()?, right.as_slice()?);
    let named = |index| usize::try_from(index).map_or([-1, -1], |at| [left[at], right[at]]);
    let which: Vec<[i64; 2]> = which.into_iter().map(named).collect();
    let which = which.into_flattened().into_pyarray(py);
    Ok((
        into_array(py, distances, &[n_frames])?.into_any(),
        which.reshape([n_frames, 2])?.into_any(),
    ))
}

/// See `mograft.capsules.box_clearance`.
#[pyfunction]
pub fn box_clearance<'py>(
    py: Python<'py>,
    ends: Floats<'py>,
    radii: Floats<'py>,
    center: [f64; 3],
    half: [f64; 3],
    rotation: [f64; 4],
) -> Array<'py> {
    let (own, widths) = (as_vecs(&ends)?, radii.as_slice()?);
    let (center, half, turn) = (center.into(), half.into(), DQuat::from_array(rotation));
    let distances = py
        .detach(|| capsule::box_clearance(own, widths, center, half, turn))
        .map_err(value_error)?;
    into_array(py, distances, &ends.shape()[..2])
}
