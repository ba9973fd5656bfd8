//! Angular velocities of the links, and their kinetic energy.

use glam::{DQuat, DVec3};

use crate::error::{Error, check_len, check_parents};
use crate::rotation::log;
use mograft_machine::memory::with_capacity;

/// The reference of a link's angular velocity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Omega {
    /// The world: the velocity that determines the physical energy.
    World,
    /// The parent: the speed of the joint alone.
    Local,
}

/// Kinetic energy of rotation E = Σ ½ I ω² of every frame.
///
/// `rotations` are local and frame-major; `inertia` is one moment per joint and
/// `frame_time` is in seconds. The velocity from one frame to the next is the rotation
/// vector between them divided by `frame_time`. A frame has the mean of the two adjacent
/// velocities, an end frame the only one. Neither translation of the root nor a constant
/// rotation of the world changes the energy. Takes O(frames × joints) time; NaN in a frame
/// affects that frame and the two beside it.
///
/// # Errors
///
/// If there are fewer than two frames, if the lengths do not match, or if a parent does not
/// precede its child.
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

    let set_pose = |frame: usize, pose: &mut Vec<DQuat>| {
        pose.clear();
        for (joint, &parent) in parents.iter().enumerate() {
            let local = rotations[frame * n_joints + joint];
            let is_local = parent < 0 || omega == Omega::Local;
            pose.push(if is_local { local } else { pose[parent as usize] * local });
        }
    };
    let link_energy = |velocity: DVec3, inertia: f64| 0.5 * inertia * velocity.length_squared();

    let mut energy = with_capacity(n_frames)?;
    let (mut before, mut after) = (Vec::new(), Vec::new());
    let (mut earlier, mut later) = (vec![DVec3::ZERO; n_joints], vec![DVec3::ZERO; n_joints]);
    set_pose(0, &mut before);
    for frame in 1..n_frames {
        set_pose(frame, &mut after);
        for joint in 0..n_joints {
            later[joint] = log(after[joint] * before[joint].inverse()) / frame_time;
        }
        let previous = if frame == 1 { &later } else { &earlier };
        let joints = previous.iter().zip(&later).zip(inertia);
        energy.push(
            joints
                .map(|((a, b), &i)| link_energy(0.5 * (a + b), i))
                .sum(),
        );
        std::mem::swap(&mut before, &mut after);
        std::mem::swap(&mut earlier, &mut later);
    }
    energy.push(
        earlier
            .iter()
            .zip(inertia)
            .map(|(&v, &i)| link_energy(v, i))
            .sum(),
    );
    Ok(energy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinetic_energy_of_constant_rotation_is_half_i_omega_squared() {
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
    fn kinetic_energy_of_single_frame_returns_error() {
        let error =
            kinetic_energy(&[-1], &[DQuat::IDENTITY], &[1.0], 1.0, Omega::World).unwrap_err();
        assert_eq!(error, Error::TooFewFrames { needed: 2, given: 1 });
    }
}
