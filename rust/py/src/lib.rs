//! Python bindings of mograft's crates: convert arguments, release the GIL, convert results.
//!
//! | Python | Rust |
//! |---|---|
//! | C-contiguous float64 array `(..., 4)` | `&[DQuat]`, no copy |
//! | C-contiguous float64 array `(..., 3)` | `&[DVec3]`, no copy |
//! | C-contiguous float64 array `(..., 2)` | `&[DVec2]`, no copy |
//! | C-contiguous float64 or int64 array | `&[f64]` or `&[i64]`, no copy |
//! | C-contiguous float32 or float64 array of sampled segments | `Rows<f32>` or `Rows<f64>`, no copy |
//! | `bytes` | `&[u8]`, no copy |
//! | an error of a kernel | `ValueError`, or `MemoryError` if the system refuses memory |
//!
//! Another thread must not write an array while a call reads it. The module has no state: functions read their
//! arguments and return new arrays, so that free-threaded Python needs no lock (`gil_used = false`).
#![allow(clippy::needless_pass_by_value, reason = "PyO3 extracts arguments by value")]

mod balance;
mod convert;
mod kinematics;
mod seams;
mod text;
mod trellis;

/// Compiled kernels of mograft. Private: call the functions of the package instead.
#[pyo3::pymodule(gil_used = false)]
mod _core {
    /// `"debug"` or `"release"`: benchmarks refuse to measure a debug build.
    #[pymodule_export]
    const BUILD_PROFILE: &str = if cfg!(debug_assertions) { "debug" } else { "release" };

    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");

    #[pymodule_export]
    use crate::balance::added_imbalances;

    #[pymodule_export]
    use crate::kinematics::{
        angle, box_clearance, capsule_ends, clearance, continuous_signs, cubic, cubic_positions,
        distances, exp, features, from_channels, from_euler, greatest_derivatives, hermite,
        kinetic_energy, local, log, moments, multiply, pose_gaps, pose_gaps_along, rotate,
        sample_keys, segments, segments_positions, slerp, to_euler, velocity_gaps,
        velocity_gaps_along, world, world_jerk,
    };

    #[pymodule_export]
    use mograft_linkage_bindings::{available_memory, cut, linkage, linkage_condensed};

    #[pymodule_export]
    use crate::seams::{add_offsets, clip_states, replace_joints, sample_clips, smooth_gradient};

    #[pymodule_export]
    use crate::text::{format_rows, scan_numbers};

    #[pymodule_export]
    use crate::trellis::{keep_cheapest, sample};
}
