//! Python bindings of mograft's crates: convert, let go of the GIL, convert back.
//!
//! | Python | Rust |
//! |---|---|
//! | C-contiguous float64 array `(..., 4)` | `&[DQuat]`, no copy |
//! | C-contiguous float64 array `(..., 3)` | `&[DVec3]`, no copy |
//! | C-contiguous float64 or int64 array | `&[f64]` or `&[i64]`, no copy |
//! | C-contiguous float32 or float64 array of sampled segments | `Rows<f32>` or `Rows<f64>`, no copy |
//! | `bytes` | `&[u8]`, no copy |
//! | a kernel's refusal | `ValueError` |
//!
//! Arrays must not be written by another thread while a call runs.
#![allow(clippy::needless_pass_by_value, reason = "PyO3 extracts arguments by value")]

mod convert;
mod kinematics;
mod linkage;
mod text;

/// Compiled kernels of mograft. Private: call the package's own functions instead.
#[pyo3::pymodule]
mod _core {
    /// `"debug"` or `"release"`: benchmarks refuse to time a debug build.
    #[pymodule_export]
    const BUILD_PROFILE: &str = if cfg!(debug_assertions) { "debug" } else { "release" };

    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");

    #[pymodule_export]
    use crate::kinematics::{
        angle, box_clearance, capsule_ends, clearance, cubic, cubic_positions, exp, features,
        from_channels, from_euler, hermite, kinetic_energy, log, moments, multiply, pose_gaps,
        rotate, segments, segments_positions, slerp, to_euler, velocity_gaps, world,
    };

    #[pymodule_export]
    use crate::linkage::{
        cut, cut_tuned, linkage, linkage_by_chain, linkage_condensed, linkage_tuned,
    };

    #[pymodule_export]
    use crate::text::{format_rows, scan_numbers};
}
