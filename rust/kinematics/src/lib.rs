//! Kernels of motion: functions on slices, independent of Python.
//!
//! Motion is frame-major: joint `j` of frame `f` has index `f * n_joints + j`. Rotations
//! are unit quaternions, xyzw; a joint's rotation and translation are local, relative to
//! its parent. Parents precede their children, and the parent of the root is negative. Lengths and
//! times may have any unit; angles are in radians. Unless stated otherwise, NaN in an input gives
//! NaN in the outputs that depend on it.
//!
//! | module | contents |
//! |---|---|
//! | [`rotation`] | exponential, logarithm, angle, Euler angles |
//! | [`resample`] | motion between frames: spherical linear, or a C1 cubic |
//! | [`keyframes`] | tracks of keys at the times of frames |
//! | [`forward`] | world rotations and positions, and from these to local ones |
//! | [`derivatives`] | accelerations and jerks |
//! | [`energy`] | angular velocities and kinetic energy |
//! | [`sample`] | feature vectors of sampled segments |
//! | [`pose`] | distances between poses |
//! | [`balance`] | effects of donors on balance |
//! | [`capsule`] | distances between capsules, and from boxes |
//! | [`value`] | differences of rotations and of translations |
//! | [`offset`] | decaying offsets at seams |
//! | [`gradient`] | smoothing of seams that keeps derivatives |

pub mod balance;
mod banded;
pub mod capsule;
pub mod derivatives;
pub mod energy;
mod error;
pub mod forward;
pub mod gradient;
pub mod keyframes;
pub mod offset;
pub mod pose;
pub mod resample;
pub mod rotation;
pub mod sample;
pub mod value;

pub use error::Error;
