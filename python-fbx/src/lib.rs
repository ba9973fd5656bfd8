//! Python bindings of mograft-fbx: convert arguments, release the GIL, convert results.
#![allow(clippy::needless_pass_by_value, reason = "PyO3 extracts arguments by value")]

use std::collections::HashMap;

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

/// The bytes of a GLB file, and the names of missing textures.
type GlbTuple<'py> = (Bound<'py, PyBytes>, Vec<String>);

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

    /// File names of the textures that are not embedded.
    #[getter]
    fn textures(&self) -> Vec<String> {
        let textures = self.0.materials().into_iter().filter_map(|own| own.texture);
        textures
            .filter_map(|(name, data)| data.is_empty().then_some(name))
            .collect()
    }

    /// The figure as a GLB file and the names of missing textures; None without meshes.
    #[pyo3(signature = (joints, names, textures, *, generator, max_corners))]
    fn to_glb<'py>(
        &self,
        py: Python<'py>,
        joints: Vec<usize>,
        names: Vec<String>,
        textures: HashMap<String, Vec<u8>>,
        generator: String,
        max_corners: usize,
    ) -> PyResult<Option<GlbTuple<'py>>> {
        let figure = mograft_fbx::Figure {
            joints: &joints,
            names: &names,
            textures: &textures,
            generator: &generator,
        };
        let found = py
            .detach(|| self.0.to_glb(&figure, max_corners))
            .map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(found.map(|own| (PyBytes::new(py, &own.data), own.missing)))
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
