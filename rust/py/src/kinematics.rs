//! Bindings of `mograft-kinematics`. Every function has its kernel's name.

use glam::{DQuat, DVec3};
use mograft_kinematics::energy::{self, Omega};
use mograft_kinematics::keyframes::{self, Interpolation, KeyTimes, Track};
use mograft_kinematics::{Error, capsule, derivatives, forward, pose, resample, rotation, sample};
use mograft_machine::memory::collect_first;
use numpy::{IntoPyArray as _, PyArrayMethods as _, PyUntypedArrayMethods as _};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{
    Array, Floats, IndexRows, Indices, Rows, as_quats, as_rows, as_usizes, as_vecs, check_equal,
    from_quats, from_vecs, into_array, kernel_error, pairs, poses_shape, shape_with_last,
};

/// See [`rotation::exp`].
#[pyfunction]
pub fn exp<'py>(py: Python<'py>, vectors: Floats<'py>) -> Array<'py> {
    let slice = as_vecs(&vectors)?;
    let quats = py.detach(|| collect_first(slice.iter().map(|&v| rotation::exp(v)), slice.len()));
    from_quats(py, quats.map_err(kernel_error)?, &shape_with_last(&vectors, &[]))
}

/// See [`rotation::log`].
#[pyfunction]
pub fn log<'py>(py: Python<'py>, rotations: Floats<'py>) -> Array<'py> {
    let slice = as_quats(&rotations)?;
    let vectors = py.detach(|| collect_first(slice.iter().map(|&q| rotation::log(q)), slice.len()));
    from_vecs(py, vectors.map_err(kernel_error)?, &shape_with_last(&rotations, &[]))
}

/// Products of pairs of quaternions.
#[pyfunction]
pub fn multiply<'py>(py: Python<'py>, a: Floats<'py>, b: Floats<'py>) -> Array<'py> {
    let pairs = pairs(as_quats(&a)?, as_quats(&b)?)?;
    let n = pairs.len();
    let products = py.detach(|| collect_first(pairs.map(|(&a, &b)| a.mul_quat(b)), n));
    from_quats(py, products.map_err(kernel_error)?, &shape_with_last(&a, &[]))
}

/// See [`rotation::rotate`].
#[pyfunction]
pub fn rotate<'py>(py: Python<'py>, rotations: Floats<'py>, vectors: Floats<'py>) -> Array<'py> {
    let pairs = pairs(as_quats(&rotations)?, as_vecs(&vectors)?)?;
    let n = pairs.len();
    let rotated = py.detach(|| collect_first(pairs.map(|(&q, &v)| rotation::rotate(q, v)), n));
    from_vecs(py, rotated.map_err(kernel_error)?, &shape_with_last(&vectors, &[]))
}

/// See [`rotation::angle`].
#[pyfunction]
pub fn angle<'py>(py: Python<'py>, a: Floats<'py>, b: Floats<'py>) -> Array<'py> {
    let pairs = pairs(as_quats(&a)?, as_quats(&b)?)?;
    let n = pairs.len();
    let angles = py.detach(|| collect_first(pairs.map(|(&a, &b)| rotation::angle(a, b)), n));
    into_array(py, angles.map_err(kernel_error)?, &shape_with_last(&a, &[]))
}

/// See [`rotation::continuous_signs`].
#[pyfunction]
pub fn continuous_signs<'py>(py: Python<'py>, rotations: Floats<'py>) -> Array<'py> {
    let shape = shape_with_last(&rotations, &[]);
    let slice = as_quats(&rotations)?;
    let n_joints = shape.iter().skip(1).product();
    let quats = py.detach(|| rotation::continuous_signs(slice, n_joints));
    from_quats(py, quats.map_err(kernel_error)?, &shape)
}

/// See [`rotation::from_euler`].
#[pyfunction]
pub fn from_euler<'py>(py: Python<'py>, angles: Floats<'py>, axes: Vec<usize>) -> Array<'py> {
    let shape = shape_with_last(&angles, &[]);
    let n = shape.iter().product();
    let slice = angles.as_slice()?;
    let quats = py.detach(|| rotation::from_euler(slice, &axes, n));
    from_quats(py, quats.map_err(kernel_error)?, &shape)
}

/// See [`rotation::from_channels`].
#[pyfunction]
pub fn from_channels<'py>(
    py: Python<'py>,
    values: Floats<'py>,
    starts: Vec<usize>,
    turns: Vec<(usize, usize)>,
    radians: f64,
) -> Array<'py> {
    let &[n_frames, n_channels] = values.shape() else {
        return Err(PyValueError::new_err("`values` must have shape (n_frames, n_channels)"));
    };
    let n_joints = starts.len().saturating_sub(1);
    let slice = values.as_slice()?;
    let quats = py
        .detach(|| rotation::from_channels(slice, n_channels, &starts, &turns, radians))
        .map_err(kernel_error)?;
    from_quats(py, quats, &[n_frames, n_joints])
}

/// See [`rotation::to_euler`].
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
        .map_err(kernel_error)?;
    into_array(py, angles.into_flattened(), &shape_with_last(&rotations, &[3]))
}

/// See [`resample::hermite`].
#[pyfunction]
pub fn hermite<'py>(
    py: Python<'py>,
    start: Floats<'py>,
    end: Floats<'py>,
    start_velocity: Floats<'py>,
    end_velocity: Floats<'py>,
    t: Floats<'py>,
) -> Array<'py> {
    let (from, to) = (as_quats(&start)?, as_quats(&end)?);
    let (start_velocity, end_velocity) = (as_vecs(&start_velocity)?, as_vecs(&end_velocity)?);
    let t = t.as_slice()?;
    let counts = [from.len(), to.len(), start_velocity.len(), end_velocity.len(), t.len()];
    check_equal(counts)?;
    let quats = py.detach(|| {
        let ends = from
            .iter()
            .zip(to)
            .zip(start_velocity.iter().zip(end_velocity))
            .zip(t);
        let curve = ends.map(|(((&a, &b), (&u, &v)), &t)| resample::hermite(a, b, u, v, t));
        collect_first(curve, t.len())
    });
    from_quats(py, quats.map_err(kernel_error)?, &shape_with_last(&start, &[]))
}

/// See [`keyframes::sample_keys`].
///
/// `key_starts` has one entry per list of key times, and at the end their number. A row of `tracks`
/// has the first value, the list of key times, and 0, 1 or 2 for step, linear and spline.
#[pyfunction]
pub fn sample_keys<'py>(
    py: Python<'py>,
    times: Floats<'py>,
    key_times: Floats<'py>,
    key_starts: Indices<'py>,
    values: Floats<'py>,
    tracks: IndexRows<'py>,
) -> Array<'py> {
    let (times, seconds, starts) =
        (times.as_slice()?, key_times.as_slice()?, as_usizes(&key_starts)?);
    let keys = KeyTimes { seconds, starts: &starts };
    let tracks = as_tracks(&tracks)?;
    let shape = [times.len(), tracks.len()];
    if values.shape().last() == Some(&4) {
        let values = as_quats(&values)?;
        let sampled = py.detach(|| keyframes::sample_keys(times, keys, values, &tracks));
        return from_quats(py, sampled.map_err(kernel_error)?, &shape);
    }
    let values = as_vecs(&values)?;
    let sampled = py.detach(|| keyframes::sample_keys(times, keys, values, &tracks));
    from_vecs(py, sampled.map_err(kernel_error)?, &shape)
}

/// Convert rows of three integers.
fn as_tracks(rows: &IndexRows<'_>) -> PyResult<Vec<Track>> {
    let convert = |row: &[i64]| {
        let &[start, times, interpolation] = row else { return None };
        Some(Track {
            start: usize::try_from(start).ok()?,
            times: usize::try_from(times).ok()?,
            interpolation: match interpolation {
                0 => Interpolation::Step,
                1 => Interpolation::Linear,
                2 => Interpolation::Spline,
                _ => return None,
            },
        })
    };
    let found: Option<Vec<_>> = rows.as_slice()?.chunks(3).map(convert).collect();
    found.ok_or_else(|| {
        PyValueError::new_err("`tracks` must have rows of a start, a list and an interpolation")
    })
}

/// [`forward::world`] or [`forward::local`].
type TransformKernel = fn(&[i64], &[DQuat], &[DVec3]) -> Result<(Vec<DQuat>, Vec<DVec3>), Error>;

/// Rotations and positions.
type Transforms<'py> = PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)>;

fn transform<'py>(
    py: Python<'py>,
    kernel: TransformKernel,
    parents: &Indices<'py>,
    rotations: &Floats<'py>,
    positions: &Floats<'py>,
) -> Transforms<'py> {
    let (quats, vecs) = (as_quats(rotations)?, as_vecs(positions)?);
    let parents = parents.as_slice()?;
    let (turned, moved) = py
        .detach(|| kernel(parents, quats, vecs))
        .map_err(kernel_error)?;
    let shape = shape_with_last(rotations, &[]);
    Ok((from_quats(py, turned, &shape)?.into_any(), from_vecs(py, moved, &shape)?.into_any()))
}

/// See [`forward::world`].
#[pyfunction]
pub fn world<'py>(
    py: Python<'py>,
    parents: Indices<'py>,
    rotations: Floats<'py>,
    positions: Floats<'py>,
) -> Transforms<'py> {
    transform(py, forward::world, &parents, &rotations, &positions)
}

/// See [`forward::local`].
#[pyfunction]
pub fn local<'py>(
    py: Python<'py>,
    parents: Indices<'py>,
    rotations: Floats<'py>,
    positions: Floats<'py>,
) -> Transforms<'py> {
    transform(py, forward::local, &parents, &rotations, &positions)
}

/// See [`energy::kinetic_energy`].
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
        _ => return Err(PyValueError::new_err("`omega` must be 'world' or 'local'")),
    };
    let (parents, quats) = (parents.as_slice()?, as_quats(&rotations)?);
    let inertia = inertia.as_slice()?;
    let energy = py
        .detach(|| energy::kinetic_energy(parents, quats, inertia, frame_time, omega))
        .map_err(kernel_error)?;
    let n_frames = energy.len();
    into_array(py, energy, &[n_frames])
}

/// [`resample::slerp`] or [`resample::cubic`].
type ResampleKernel<K> = fn(&[f64], &[K], usize, &[f64]) -> Result<Vec<K>, Error>;

fn resample_rotations<'py>(
    py: Python<'py>,
    kernel: ResampleKernel<DQuat>,
    frame_times: &Floats<'py>,
    rotations: &Floats<'py>,
    times: &Floats<'py>,
) -> Array<'py> {
    let [_, n_joints] = poses_shape(rotations.shape())?;
    let (frame_times, times) = (frame_times.as_slice()?, times.as_slice()?);
    let quats = as_quats(rotations)?;
    let resampled = py
        .detach(|| kernel(frame_times, quats, n_joints, times))
        .map_err(kernel_error)?;
    from_quats(py, resampled, &[times.len(), n_joints])
}

/// See [`resample::slerp`].
#[pyfunction]
pub fn slerp<'py>(
    py: Python<'py>,
    frame_times: Floats<'py>,
    rotations: Floats<'py>,
    times: Floats<'py>,
) -> Array<'py> {
    resample_rotations(py, resample::slerp, &frame_times, &rotations, &times)
}

/// See [`resample::cubic`].
#[pyfunction]
pub fn cubic<'py>(
    py: Python<'py>,
    frame_times: Floats<'py>,
    rotations: Floats<'py>,
    times: Floats<'py>,
) -> Array<'py> {
    resample_rotations(py, resample::cubic, &frame_times, &rotations, &times)
}

/// See [`resample::cubic_positions`].
#[pyfunction]
pub fn cubic_positions<'py>(
    py: Python<'py>,
    frame_times: Floats<'py>,
    positions: Floats<'py>,
    times: Floats<'py>,
) -> Array<'py> {
    let [_, n_joints] = poses_shape(positions.shape())?;
    let (frame_times, times) = (frame_times.as_slice()?, times.as_slice()?);
    let vecs = as_vecs(&positions)?;
    let resampled = py
        .detach(|| resample::cubic_positions(frame_times, vecs, n_joints, times))
        .map_err(kernel_error)?;
    from_vecs(py, resampled, &[times.len(), n_joints])
}

/// See [`resample::segments`].
#[pyfunction]
pub fn segments<'py>(
    py: Python<'py>,
    rotations: Floats<'py>,
    starts: Indices<'py>,
    stops: Indices<'py>,
    counts: Indices<'py>,
) -> Array<'py> {
    let [_, n_joints] = poses_shape(rotations.shape())?;
    let [starts, stops, counts] = [as_usizes(&starts)?, as_usizes(&stops)?, as_usizes(&counts)?];
    let quats = as_quats(&rotations)?;
    let resampled = py
        .detach(|| resample::segments(quats, n_joints, &starts, &stops, &counts))
        .map_err(kernel_error)?;
    from_quats(py, resampled, &[counts.iter().sum(), n_joints])
}

/// See [`resample::segments_positions`].
#[pyfunction]
pub fn segments_positions<'py>(
    py: Python<'py>,
    positions: Floats<'py>,
    starts: Indices<'py>,
    stops: Indices<'py>,
    counts: Indices<'py>,
) -> Array<'py> {
    let [_, n_joints] = poses_shape(positions.shape())?;
    let [starts, stops, counts] = [as_usizes(&starts)?, as_usizes(&stops)?, as_usizes(&counts)?];
    let vecs = as_vecs(&positions)?;
    let resampled = py
        .detach(|| resample::segments_positions(vecs, n_joints, &starts, &stops, &counts))
        .map_err(kernel_error)?;
    from_vecs(py, resampled, &[counts.iter().sum(), n_joints])
}

/// See [`sample::moments`].
#[pyfunction]
pub fn moments<'py>(py: Python<'py>, rows: Rows<'py>, shape: (usize, usize)) -> Array<'py> {
    let sums = match &rows {
        Rows::F32(array) => {
            let rows = as_rows(array, shape)?;
            py.detach(|| sample::moments(rows))
        }
        Rows::F64(array) => {
            let rows = as_rows(array, shape)?;
            py.detach(|| sample::moments(rows))
        }
    };
    into_array(py, sums.map_err(kernel_error)?, &[shape.1, 4, 4])
}

/// See [`sample::features`].
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
    let (joints, references) = (as_usizes(&joints)?, as_quats(&references)?);
    let (n, vectors) = match &rows {
        Rows::F32(array) => {
            let rows = as_rows(array, shape)?;
            (
                array.shape()[0],
                py.detach(|| sample::features(rows, &joints, references, n_rest, threads)),
            )
        }
        Rows::F64(array) => {
            let rows = as_rows(array, shape)?;
            (
                array.shape()[0],
                py.detach(|| sample::features(rows, &joints, references, n_rest, threads)),
            )
        }
    };
    let n_poses = 3_usize.saturating_mul(shape.0);
    let width = n_poses.saturating_mul(joints.len()).saturating_add(n_rest);
    into_array(py, vectors.map_err(kernel_error)?, &[n, width])
}

/// See [`pose::pose_gaps`].
#[pyfunction]
pub fn pose_gaps<'py>(py: Python<'py>, ends: Floats<'py>, starts: Floats<'py>) -> Array<'py> {
    let ([n_ends, n_joints], [n_starts, _]) =
        (poses_shape(ends.shape())?, poses_shape(starts.shape())?);
    let shape = [n_ends, n_starts];
    let (from, to) = (as_quats(&ends)?, as_quats(&starts)?);
    let gaps = py
        .detach(|| pose::pose_gaps(from, to, n_joints))
        .map_err(kernel_error)?;
    into_array(py, gaps, &shape)
}

/// See [`pose::velocity_gaps`].
#[pyfunction]
pub fn velocity_gaps<'py>(py: Python<'py>, ends: Floats<'py>, starts: Floats<'py>) -> Array<'py> {
    let ([n_ends, n_joints], [n_starts, _]) =
        (poses_shape(ends.shape())?, poses_shape(starts.shape())?);
    let shape = [n_ends, n_starts];
    let (from, to) = (as_vecs(&ends)?, as_vecs(&starts)?);
    let gaps = py
        .detach(|| pose::velocity_gaps(from, to, n_joints))
        .map_err(kernel_error)?;
    into_array(py, gaps, &shape)
}

/// See [`pose::pose_gaps_along`].
#[pyfunction]
pub fn pose_gaps_along<'py>(
    py: Python<'py>,
    ends: Floats<'py>,
    starts: Floats<'py>,
    candidates: Indices<'py>,
    counts: Indices<'py>,
) -> Array<'py> {
    let [_, n_joints] = poses_shape(ends.shape())?;
    let (candidates, counts) = (as_usizes(&candidates)?, as_usizes(&counts)?);
    let (from, to) = (as_quats(&ends)?, as_quats(&starts)?);
    let gaps = py
        .detach(|| pose::pose_gaps_along(from, to, n_joints, &candidates, &counts))
        .map_err(kernel_error)?;
    let n = gaps.len();
    into_array(py, gaps, &[n])
}

/// See [`pose::velocity_gaps_along`].
#[pyfunction]
pub fn velocity_gaps_along<'py>(
    py: Python<'py>,
    ends: Floats<'py>,
    starts: Floats<'py>,
    candidates: Indices<'py>,
    counts: Indices<'py>,
) -> Array<'py> {
    let [_, n_joints] = poses_shape(ends.shape())?;
    let (candidates, counts) = (as_usizes(&candidates)?, as_usizes(&counts)?);
    let (from, to) = (as_vecs(&ends)?, as_vecs(&starts)?);
    let gaps = py
        .detach(|| pose::velocity_gaps_along(from, to, n_joints, &candidates, &counts))
        .map_err(kernel_error)?;
    let n = gaps.len();
    into_array(py, gaps, &[n])
}

/// See [`capsule::capsule_ends`].
#[pyfunction]
pub fn capsule_ends<'py>(
    py: Python<'py>,
    rotations: Floats<'py>,
    positions: Floats<'py>,
    joints: Indices<'py>,
    bones: Floats<'py>,
) -> Array<'py> {
    let &[n_frames, n_joints, _] = rotations.shape() else {
        return Err(PyValueError::new_err("`rotations` must have shape (n_frames, n_joints, 4)"));
    };
    let (quats, vecs) = (as_quats(&rotations)?, as_vecs(&positions)?);
    let (joints, bones) = (as_usizes(&joints)?, as_vecs(&bones)?);
    let ends = py
        .detach(|| capsule::capsule_ends(quats, vecs, n_joints, &joints, bones))
        .map_err(kernel_error)?;
    from_vecs(py, ends, &[n_frames, joints.len(), 2])
}

/// See [`capsule::clearance`]. The pair is returned as its two capsules, -1 without pairs.
#[pyfunction]
pub fn clearance<'py>(
    py: Python<'py>,
    ends: Floats<'py>,
    radii: Floats<'py>,
    others: Floats<'py>,
    other_radii: Floats<'py>,
    other_frames: Indices<'py>,
    pairs: (Indices<'py>, Indices<'py>),
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let (ends, others) = (as_vecs(&ends)?, as_vecs(&others)?);
    let (radii, other_radii) = (radii.as_slice()?, other_radii.as_slice()?);
    let other_frames = as_usizes(&other_frames)?;
    let (left, right) = pairs;
    let (lefts, rights) = (as_usizes(&left)?, as_usizes(&right)?);
    let n_pairs = lefts.len();
    check_equal([n_pairs, rights.len()])?;
    let pairs = collect_first(lefts.into_iter().zip(rights), n_pairs).map_err(kernel_error)?;
    let (distances, nearest) = py
        .detach(|| capsule::clearance(ends, radii, others, other_radii, &other_frames, &pairs))
        .map_err(kernel_error)?;
    let n_frames = distances.len();
    let (left, right) = (left.as_slice()?, right.as_slice()?);
    // Without pairs the index is -1, and so are both capsules.
    let capsules = |index| usize::try_from(index).map_or([-1, -1], |i| [left[i], right[i]]);
    let nearest =
        collect_first(nearest.into_iter().map(capsules), n_frames).map_err(kernel_error)?;
    let nearest = nearest.into_flattened().into_pyarray(py);
    Ok((
        into_array(py, distances, &[n_frames])?.into_any(),
        nearest.reshape([n_frames, 2])?.into_any(),
    ))
}

/// See [`capsule::box_clearance`].
#[pyfunction]
pub fn box_clearance<'py>(
    py: Python<'py>,
    ends: Floats<'py>,
    radii: Floats<'py>,
    center: [f64; 3],
    half: [f64; 3],
    rotation: [f64; 4],
) -> Array<'py> {
    let &[n_frames, n_capsules, _, _] = ends.shape() else {
        return Err(PyValueError::new_err("`ends` must have shape (n_frames, n_capsules, 2, 3)"));
    };
    let (end_points, radii) = (as_vecs(&ends)?, radii.as_slice()?);
    let (center, half, rotation) = (center.into(), half.into(), DQuat::from_array(rotation));
    let distances = py
        .detach(|| capsule::box_clearance(end_points, radii, center, half, rotation))
        .map_err(kernel_error)?;
    into_array(py, distances, &[n_frames, n_capsules])
}

/// See [`derivatives::greatest_derivatives`].
#[pyfunction]
pub fn greatest_derivatives<'py>(
    py: Python<'py>,
    rotations: Floats<'py>,
    joints: Indices<'py>,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let [n_frames, n_joints] = poses_shape(rotations.shape())?;
    let (quats, joints) = (as_quats(&rotations)?, as_usizes(&joints)?);
    let (accelerations, jerks) = py
        .detach(|| derivatives::greatest_derivatives(quats, n_joints, &joints))
        .map_err(kernel_error)?;
    Ok((
        into_array(py, accelerations, &[n_frames])?.into_any(),
        into_array(py, jerks, &[n_frames])?.into_any(),
    ))
}

/// See [`derivatives::world_jerk`].
#[pyfunction]
pub fn world_jerk<'py>(
    py: Python<'py>,
    parents: Indices<'py>,
    rotations: Floats<'py>,
    positions: Floats<'py>,
    joints: Indices<'py>,
) -> Array<'py> {
    let (quats, vecs) = (as_quats(&rotations)?, as_vecs(&positions)?);
    let (parents, joints) = (parents.as_slice()?, as_usizes(&joints)?);
    let [n_frames, _] = poses_shape(rotations.shape())?;
    let shape = [n_frames, joints.len()];
    let jerks = py
        .detach(|| derivatives::world_jerk(parents, quats, vecs, &joints))
        .map_err(kernel_error)?;
    into_array(py, jerks, &shape)
}

/// See [`sample::distances`].
#[pyfunction]
#[pyo3(signature = (points, from, to, /))]
pub fn distances<'py>(
    py: Python<'py>,
    points: Floats<'py>,
    from: Indices<'py>,
    to: Indices<'py>,
) -> Array<'py> {
    let &[_, width] = points.shape() else {
        return Err(PyValueError::new_err("`points` must have two axes"));
    };
    let (numbers, from, to) = (points.as_slice()?, as_usizes(&from)?, as_usizes(&to)?);
    let lengths = py.detach(|| sample::distances(numbers, width, &from, &to));
    into_array(py, lengths.map_err(kernel_error)?, &[from.len()])
}
