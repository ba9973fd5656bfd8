//! How fast the links turn, and with what kinetic energy.

use glam::{DQuat, DVec3};

use crate::Error;
use crate::error::{check_len, check_parents};
use crate::rotation::log;

/// In which frame a link's angular velocity is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Omega {
    /// Relative to the world: what a link's inertia feels.
    World,
    /// Relative to the parent: the speed of the joint alone.
    Local,
}

/// Kinetic energy of rotation E = Σ ½ I ω² of every frame.
///
/// `rotations` are local and frame-major; `inertia` is one moment per joint and
/// `frame_time` is in seconds. The velocity from one frame to the next is the rotation
/// vector between them over `frame_time`; a frame has the mean of the two beside it, the
/// end frames the one they have. Neither root translation nor a constant turn of the
/// world changes it. Takes O(frames × joints) time; NaN stays in the frames it touches.
///
/// # Errors
///
/// If there are fewer than two frames, if the lengths do not fit, or if a parent does not
/// stand before its child.
pub fn kinetic_energy(
    parents: &[i64],
    rotations: &[DQuat],
    inertia: &[f64],
    frame_time: f64,
    omega: Omega,
) -> Result<Vec<f64>, Error> {
    check_parents(parents)?;
    let n_joints = parents.len();
    check_len(inertia.len(), n_joints)?;
    let n_frames = rotations.len().checked_div(n_joints).unwrap_or(0);
    check_len(rotations.len(), n_frames * n_joints)?;
    if n_frames < 2 {
        return Err(Error::TooFewFrames { needed: 2, given: n_frames });
    }

    let pose = |frame: usize, turned: &mut Vec<DQuat>| {
        turned.clear();
        for (joint, &parent) in parents.iter().enumerate() {
            let local = rotations[frame * n_joints + joint];
            let is_free = parent < 0 || omega == Omega::Local;
            turned.push(if is_free { local } else { turned[parent as usize] * local });
        }
    };
    let weighted = |velocity: DVec3, inertia: f64| 0.5 * inertia * velocity.length_squared();

    let mut energy = Vec::with_capacity(n_frames);
    let (mut before, mut after) = (Vec::new(), Vec::new());
    let (mut earlier, mut later) = (vec![DVec3::ZERO; n_joints], vec![DVec3::ZERO; n_joints]);
    pose(0, &mut before);
    for frame in 1..n_frames {
        pose(frame, &mut after);
        for joint in 0..n_joints {
            later[joint] = log(after[joint] * before[joint].inverse()) / frame_time;
        }
        let previous = if frame == 1 { &later } else { &earlier };
        let joints = previous.iter().zip(&later).zip(inertia);
        energy.push(joints.map(|((a, b), &i)| weighted(0.5 * (a + b), i)).sum());
        std::mem::swap(&mut before, &mut after);
        std::mem::swap(&mut earlier, &mut later);
    }
    energy.push(
        earlier
            .iter()
            .zip(inertia)
            .map(|(&v, &i)| weighted(v, i))
            .sum(),
    );
    Ok(energy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_that_turns_steadily_has_half_i_omega_squared() {
        let rotations: Vec<_> = (0..5)
            .flat_map(|f| [DQuat::from_rotation_y(0.1 * f64::from(f)), DQuat::IDENTITY])
            .collect();
        let energy =
            |omega| kinetic_energy(&[-1, 0], &rotations, &[3.0, 5.0], 0.02, omega).unwrap();

        for (world, local) in energy(Omega::World).into_iter().zip(energy(Omega::Local)) {
            assert!((world - 0.5 * 8.0 * 25.0).abs() < 1e-9);
            assert!((local - 0.5 * 3.0 * 25.0).abs() < 1e-9);
        }
    }

    #[test]
    fn a_single_frame_is_refused() {
        let refusal =
            kinetic_energy(&[-1], &[DQuat::IDENTITY], &[1.0], 1.0, Omega::World).unwrap_err();
        assert_eq!(refusal, Error::TooFewFrames { needed: 2, given: 1 });
    }
}
