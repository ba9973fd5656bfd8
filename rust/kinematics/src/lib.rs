//! Kernels of motion: functions on slices, free of Python.
//!
//! Motion is frame-major: joint `j` of frame `f` stands at `f * n_joints + j`. Rotations
//! are unit quaternions, xyzw; a joint's rotation and translation are local, relative to
//! its parent. Parents stand before their children, and the root's parent is negative.
//!
//! | module | what it computes |
//! |---|---|
//! | [`rotation`] | exponential, logarithm, angle, Euler angles |
//! | [`resample`] | motion between its frames: along the arc, or smoothly |
//! | [`forward`] | where the joints are in the world |
//! | [`energy`] | how fast the links turn, and with what energy |
//! | [`sample`] | sampled segments as vectors to compare |
//! | [`pose`] | how far poses are apart |
//! | [`capsule`] | how far bodies are apart |

pub mod capsule;
pub mod energy;
mod error;
pub mod forward;
pub mod pose;
pub mod resample;
pub mod rotation;
pub mod sample;

pub use error::Error;
