//! The rotation in a matrix that may also scale, shear and mirror.

use glam::{DMat3, DQuat, DVec3};

/// Steps of the iteration; from an error below 1e-3 two steps reach the precision of f64.
const MAX_STEPS: usize = 40;

/// Return the rotation that is nearest to a matrix, after the matrix is negated if it mirrors.
///
/// `fallback` is the result for matrices without a nearest rotation: singular, or not finite.
/// Newton's iteration for the polar factor: Higham, "Computing the polar decomposition", 1986,
/// with the scale factor of equation (3.4) in the Frobenius norm.
pub fn nearest_rotation(matrix: DMat3, fallback: DQuat) -> DQuat {
    let largest = |axis: DVec3| axis.abs().max_element();
    let size = largest(matrix.x_axis)
        .max(largest(matrix.y_axis))
        .max(largest(matrix.z_axis));
    let mut factor = matrix * size.recip();
    let determinant = factor.determinant();
    if !(size.is_normal() && size.recip().is_normal()) || determinant.abs() < 1e-12 {
        return fallback;
    }
    if determinant < 0.0 {
        factor *= -1.0;
    }
    for _ in 0..MAX_STEPS {
        let inverse = factor.inverse().transpose();
        let scale = (frobenius(inverse) / frobenius(factor)).sqrt();
        let next = (factor * scale + inverse * scale.recip()) * 0.5;
        let change = frobenius(next - factor);
        factor = next;
        if change < 1e-14 {
            break;
        }
    }
    let rotation = DQuat::from_mat3(&factor).normalize();
    if rotation.is_finite() { rotation } else { fallback }
}

fn frobenius(matrix: DMat3) -> f64 {
    let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    (x.length_squared() + y.length_squared() + z.length_squared()).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::EulerRot;

    const TURN: (f64, f64, f64) = (0.3, -1.2, 2.9);

    fn turn() -> DQuat {
        DQuat::from_euler(EulerRot::XYZ, TURN.0, TURN.1, TURN.2)
    }

    #[test]
    fn nearest_rotation_scaled_rotation_is_that_rotation() {
        for scale in [1e-200, 1e-3, 1.0, 1e200] {
            let matrix = DMat3::from_quat(turn()) * scale;
            let found = nearest_rotation(matrix, DQuat::IDENTITY);
            assert!(found.dot(turn()).abs() > 1.0 - 1e-14, "{scale}: {found}");
        }
    }

    #[test]
    fn nearest_rotation_stretched_axes_is_that_rotation() {
        let scale = DMat3::from_diagonal(DVec3::new(0.01, 3.0, -20.0));
        let found = nearest_rotation(DMat3::from_quat(turn()) * scale, DQuat::IDENTITY);
        let mirrored = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
        let expected = DQuat::from_mat3(&(DMat3::from_quat(turn()) * mirrored));
        assert!(found.dot(expected).abs() > 1.0 - 1e-13, "{found}");
    }

    #[test]
    fn nearest_rotation_without_one_is_the_fallback() {
        for scale in [0.0, f64::NAN, f64::INFINITY] {
            let matrix = DMat3::from_diagonal(DVec3::new(1.0, scale, 1.0));
            assert_eq!(nearest_rotation(matrix, turn()), turn());
        }
    }
}
