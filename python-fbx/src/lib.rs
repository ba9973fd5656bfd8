//! Python bindings of mograft-fbx: convert arguments, release the GIL, convert results.
#![allow(clippy::needless_pass_by_value, reason = "PyO3 extracts arguments by value")]

use mograft_fbx::{BakeError, Kind};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray as _, PyArray1, PyArray2, PyArray3, PyArrayMethods as _};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// Hierarchy, rest pose and takes of one FBX file.
#[pyclass(frozen, module = "mograft_fbx")]
struct Scene(mograft_fbx::Scene);

/// World rotations `(n_frames, n_joints, 4)` and positions `(n_frames, n_joints, 3)`.
type PoseArrays<'py> = (Bound<'py, PyArray3<f64>>, Bound<'py, PyArray3<f64>>);

/// World rotations `(n_nodes, 4)` and positions `(n_nodes, 3)`.
type RestArrays<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// Name, first and last second of the take and of its keys, and indices of the animated nodes.
type TakeTuple = (String, (f64, f64), Option<(f64, f64)>, Vec<usize>);

/// Name, node, material, triangles, positions, normals, texture coordinates, joints and weights.
type PartTuple<'py> = (
    String,
    usize,
    Option<usize>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<i64>>,
    Bound<'py, PyArray2<f32>>,
);

/// Name, linear RGB, and the texture: its file name, and its bytes, which may be empty.
type MaterialTuple<'py> = (String, [f64; 3], Option<(String, Bound<'py, PyBytes>)>);

#[pymethods]
impl Scene {
    /// Load a file from its bytes.
    #[new]
    #[pyo3(signature = (data, memory_limit, *, with_geometry = false))]
    fn new(
        py: Python<'_>,
        data: &[u8],
        memory_limit: usize,
        with_geometry: bool,
    ) -> PyResult<Self> {
        let scene = py.detach(|| mograft_fbx::Scene::load(data, memory_limit, with_geometry));
        scene
            .map(Self)
            .map_err(|error| PyValueError::new_err(error.to_string()))
    }

    /// Names of the nodes in preorder.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.0
            .nodes()
            .iter()
            .map(|node| node.name.clone())
            .collect()
    }

    /// Indices of the parents, -1 for the root.
    #[getter]
    fn parents<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let parents: Result<Vec<_>, _> = self
            .0
            .nodes()
            .iter()
            .map(|node| node.parent.map_or(Ok(-1), i64::try_from))
            .collect();
        Ok(parents
            .map_err(|error| PyValueError::new_err(error.to_string()))?
            .into_pyarray(py))
    }

    /// Kinds of the nodes: `"bone"`, `"mesh"`, `"camera"`, `"light"` or `"node"`.
    #[getter]
    fn kinds(&self) -> Vec<&'static str> {
        let kinds = self.0.nodes().iter().map(|node| match node.kind {
            Kind::Bone => "bone",
            Kind::Mesh => "mesh",
            Kind::Camera => "camera",
            Kind::Light => "light",
            Kind::Other => "node",
        });
        kinds.collect()
    }

    /// World rotations `(n_nodes, 4)` and positions `(n_nodes, 3)` of all nodes in the rest pose.
    fn rest_pose<'py>(&self, py: Python<'py>) -> RestArrays<'py> {
        let poses = self.0.rest_pose();
        let rotations = Array2::from(poses.rotations).into_pyarray(py);
        (rotations, Array2::from(poses.positions).into_pyarray(py))
    }

    /// The takes in the order of the file.
    #[getter]
    fn takes(&self) -> Vec<TakeTuple> {
        let takes = self.0.takes();
        takes
            .into_iter()
            .map(|t| (t.name, t.range, t.key_range, t.animated))
            .collect()
    }

    /// Version, whether the file is text, metres per unit, axes and frames per second.
    #[getter]
    fn settings(&self) -> (u32, bool, f64, String, f64) {
        let settings = self.0.settings();
        let mograft_fbx::Settings { version, is_ascii, unit_metres, axes, rate } = settings;
        (version, is_ascii, unit_metres, axes, rate)
    }

    /// Number of constraints, which are not evaluated.
    #[getter]
    fn n_constraints(&self) -> usize {
        self.0.n_constraints()
    }

    /// The triangles of all meshes in the rest pose, by mesh and material; needs `with_geometry`.
    fn meshes<'py>(&self, py: Python<'py>, max_corners: usize) -> PyResult<Vec<PartTuple<'py>>> {
        let parts = py
            .detach(|| self.0.meshes(max_corners))
            .map_err(|error| PyValueError::new_err(error.to_string()))?;
        let to_tuple = |part: mograft_fbx::Part| {
            (
                part.name,
                part.node,
                part.material,
                part.triangles.into_pyarray(py),
                Array2::from(part.positions).into_pyarray(py),
                Array2::from(part.normals).into_pyarray(py),
                Array2::from(part.uvs).into_pyarray(py),
                Array2::from(part.joints).into_pyarray(py),
                Array2::from(part.weights).into_pyarray(py),
            )
        };
        Ok(parts.into_iter().map(to_tuple).collect())
    }

    /// Name, linear RGB, and file name and bytes of the texture of each material.
    #[getter]
    fn materials<'py>(&self, py: Python<'py>) -> Vec<MaterialTuple<'py>> {
        let materials = self.0.materials().into_iter();
        materials
            .map(|own| {
                let texture = own.texture.map(|(name, data)| (name, PyBytes::new(py, &data)));
                (own.name, own.color, texture)
            })
            .collect()
    }

    /// World transforms of `joints`, indices of nodes, in frames from second `begin` on.
    #[pyo3(signature = (take, joints, *, begin, rate, n_frames))]
    fn bake<'py>(
        &self,
        py: Python<'py>,
        take: usize,
        joints: Vec<usize>,
        begin: f64,
        rate: f64,
        n_frames: usize,
    ) -> PyResult<PoseArrays<'py>> {
        let poses = py
            .detach(|| self.0.bake(take, &joints, begin, rate, n_frames))
            .map_err(|error| match error {
                BakeError::OutOfMemory => PyMemoryError::new_err(error.to_string()),
                _ => PyValueError::new_err(error.to_string()),
            })?;
        let shape = [n_frames, joints.len()];
        let rotations = Array2::from(poses.rotations).into_pyarray(py);
        let positions = Array2::from(poses.positions).into_pyarray(py);
        Ok((
            rotations.reshape([shape[0], shape[1], 4])?,
            positions.reshape([shape[0], shape[1], 3])?,
        ))
    }
}

/// Reader of FBX files for mograft. Private: call `mograft.read` instead.
#[pymodule(name = "mograft_fbx", gil_used = false)]
mod module {
    /// `"debug"` or `"release"`: benchmarks refuse to measure a debug build.
    #[pymodule_export]
    const BUILD_PROFILE: &str = if cfg!(debug_assertions) { "debug" } else { "release" };

    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");

    #[pymodule_export]
    use crate::Scene;
}
