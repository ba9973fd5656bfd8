//! The extension module of the Python package `mograft_linkage`.

/// Compiled kernels of mograft_linkage. Private: call the functions of the package instead.
#[pyo3::pymodule(gil_used = false)]
mod _core {
    /// `"debug"` or `"release"`: benchmarks refuse to measure a debug build.
    #[pymodule_export]
    const BUILD_PROFILE: &str = if cfg!(debug_assertions) { "debug" } else { "release" };

    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");

    #[pymodule_export]
    use mograft_linkage_bindings::{available_memory, cut, linkage, linkage_condensed};
}
