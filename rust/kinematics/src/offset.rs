//! Offsets that decay from seams.

use glam::DVec3;

use crate::error::{Error, check_len};
use crate::value::{Value, add};
use mograft_machine::memory::copy;

/// The times of n frames in the pieces between successive seams.
#[derive(Clone, Copy, Debug)]
pub struct PieceTimes<'a> {
    /// Index of the piece of each frame.
    pub piece: &'a [usize],
    /// Time from the start of the piece to each frame.
    pub elapsed: &'a [f64],
    /// Time from each frame to the end of the piece.
    pub left: &'a [f64],
    /// Time in which offsets decay, for each piece.
    pub windows: &'a [f64],
}

/// Offsets at one side of the seams and their rates of change, seam by seam, joint by joint.
#[derive(Clone, Copy, Debug)]
pub struct Offsets<'a> {
    /// The offsets at the seams.
    pub values: &'a [DVec3],
    /// Their rates per unit of time, away from the seam.
    pub rates: &'a [DVec3],
}

/// Values plus offsets that decay from both ends of each piece.
///
/// `values` are n frames of `n_joints`. There is one seam between each piece and the next; `before`
/// are the offsets at the end of the piece before each seam, `after` those at the start of the
/// piece after it. An offset is the cubic that has the given value and rate at the seam, and value
/// and rate 0 after the window. Where the sum of the offsets is 0 a value is kept bit for bit. Takes
/// O(n × joints) time.
///
/// # Errors
///
/// If the lengths disagree or a piece does not exist.
pub fn add_offsets<V: Value>(
    values: &[V],
    n_joints: usize,
    times: PieceTimes,
    before: Offsets,
    after: Offsets,
) -> Result<Vec<V>, Error> {
    let n = times.piece.len();
    check_len(values.len(), n * n_joints)?;
    check_len(times.elapsed.len(), n)?;
    check_len(times.left.len(), n)?;
    let n_seams = times.windows.len().saturating_sub(1);
    for vectors in [before.values, before.rates, after.values, after.rates] {
        check_len(vectors.len(), n_seams * n_joints)?;
    }
    if let Some(&piece) = times.piece.iter().find(|&&p| p >= times.windows.len()) {
        return Err(Error::InvalidPiece { piece });
    }
    let mut sums = copy(values)?;
    for (frame, &piece) in times.piece.iter().enumerate() {
        let own = &mut sums[frame * n_joints..(frame + 1) * n_joints];
        let window = times.windows[piece];
        let start = (piece > 0).then(|| Decay::new(times.elapsed[frame], window, piece - 1, after));
        let end = (piece < n_seams).then(|| Decay::new(times.left[frame], window, piece, before));
        if start.is_none_or(|own| own.u >= 1.0) && end.is_none_or(|own| own.u >= 1.0) {
            continue;
        }
        for (joint, value) in own.iter_mut().enumerate() {
            let at =
                |decay: Option<Decay>| decay.map_or(DVec3::ZERO, |own| own.at(joint, n_joints));
            *value = add(*value, at(start) + at(end));
        }
    }
    Ok(sums)
}

/// The decay of the offsets at a seam, at one time.
#[derive(Clone, Copy)]
struct Decay<'a> {
    u: f64,
    window: f64,
    seam: usize,
    offsets: Offsets<'a>,
}

impl<'a> Decay<'a> {
    fn new(time: f64, window: f64, seam: usize, offsets: Offsets<'a>) -> Self {
        Self { u: (time / window).min(1.0), window, seam, offsets }
    }

    fn at(&self, joint: usize, n_joints: usize) -> DVec3 {
        let index = self.seam * n_joints + joint;
        let (value, rate) = (self.offsets.values[index], self.offsets.rates[index]);
        let s = 1.0 - self.u;
        // The last factor makes it exactly 0 at the end.
        (rate * self.window * self.u + value * (1.0 + 2.0 * self.u)) * (s * s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_have_given_values_at_seams_and_end_with_window() {
        // Two pieces of 4 frames that share the time of the seam.
        let times = PieceTimes {
            piece: &[0, 0, 0, 0, 1, 1, 1, 1],
            elapsed: &[0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0],
            left: &[3.0, 2.0, 1.0, 0.0, 3.0, 2.0, 1.0, 0.0],
            windows: &[2.0, 2.0],
        };
        let offsets = |x| Offsets { values: x, rates: &[DVec3::ZERO] };
        let found =
            add_offsets(&[DVec3::ZERO; 8], 1, times, offsets(&[DVec3::X]), offsets(&[DVec3::Y]))
                .unwrap();
        let half = 0.5;
        let expected = [0.0, 0.0, half, 1.0, 0.0, 0.0, 0.0, 0.0];
        assert!(
            found
                .iter()
                .zip(expected)
                .all(|(own, x)| (own.x - x).abs() < 1e-15)
        );
        let expected = [0.0, 0.0, 0.0, 0.0, 1.0, half, 0.0, 0.0];
        assert!(
            found
                .iter()
                .zip(expected)
                .all(|(own, y)| (own.y - y).abs() < 1e-15)
        );
    }

    #[test]
    fn offsets_of_unknown_piece_return_error() {
        let times = PieceTimes { piece: &[1], elapsed: &[0.0], left: &[1.0], windows: &[1.0] };
        let none = Offsets { values: &[], rates: &[] };
        let refused = add_offsets(&[DVec3::ZERO], 1, times, none, none);
        assert_eq!(refused, Err(Error::InvalidPiece { piece: 1 }));
    }
}
