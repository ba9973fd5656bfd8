//! Gradient-domain smoothing of seams: the frames that best keep the derivatives of the donors.

use glam::DVec3;

use crate::banded::solve_pentadiagonal;
use crate::error::{Error, check_len};
use crate::value::{Value, add};
use mograft_machine::memory::{allocate, with_capacity};

/// Joints that are solved for at a time, so that the changes of a long motion take little memory.
const JOINTS_PER_BLOCK: usize = 8;

/// Donors that replace consecutive segments, and the seams between them.
#[derive(Clone, Copy, Debug)]
pub struct Donors<'a, V> {
    /// First frame of each segment: the last frame of the previous one, or the frame after it.
    pub starts: &'a [usize],
    /// Last frame of each segment.
    pub stops: &'a [usize],
    /// Values of the donors, segment after segment, both ends included, frame-major.
    pub rows: &'a [V],
    /// Segments that end with a seam, ascending.
    pub seams: &'a [usize],
    /// Accelerations of the donors at each seam, of those that end there and of those that start
    /// there, per frame², joint by joint.
    pub accelerations: [&'a [DVec3]; 2],
}

/// What [`smooth_gradient`] minimises, and where.
#[derive(Clone, Copy, Debug)]
pub struct Objective {
    /// Weights of the squared errors of values, velocities and accelerations.
    pub weights: [f64; 3],
    /// Greatest distance in frames from a seam at which a frame may change.
    pub reach: f64,
    /// Frames at the start that keep their values; the first one always does.
    pub n_fixed: usize,
    /// Distance in frames from a seam at which accelerations are those of the donors alone.
    pub spread: f64,
}

/// Move `values` to the frames whose values, velocities and accelerations are nearest to donors'.
///
/// `values` are all frames of `n_joints`, the first of them the first of segment 0. Minimises the
/// weighted sum of squared errors by one Gauss-Newton step from `values`; for translations it is
/// exact. Derivatives are finite differences. A frame that two donors share has the mean of the
/// errors from both. At a seam, the acceleration is the mean of `Donors::accelerations`; beside it,
/// half of their difference falls linearly to 0 at `Objective::spread`, or at the other end of the
/// segment if that is nearer. The first frames, the last frame, frames away from seams and joints
/// whose donors are constant up to 1e-12 keep their values bit for bit. Takes O(frames × joints)
/// time and, beside `values`, O(frames) memory.
///
/// # Errors
///
/// If the lengths disagree or segments do not follow each other; `values` are unchanged then. If
/// memory is exhausted, the values of some joints may have changed.
pub fn smooth_gradient<V: Value>(
    values: &mut [V],
    n_joints: usize,
    donors: Donors<V>,
    objective: Objective,
) -> Result<(), Error> {
    let frames = Frame::list(&donors, objective.spread)?;
    check_len(values.len(), frames.len() * n_joints)?;
    check_len(donors.rows.len(), n_joints * row_count(&donors))?;
    for own in donors.accelerations {
        check_len(own.len(), n_joints * donors.seams.len())?;
    }
    let is_free = free_frames(&donors, frames.len(), objective)?;
    let joints = moving_joints(donors.rows, n_joints);
    if joints.is_empty() || !is_free.contains(&true) {
        return Ok(());
    }
    let bands = normal_matrix(&frames, &is_free, objective.weights)?;
    for joints in joints.chunks(JOINTS_PER_BLOCK) {
        let system = System { values, n_joints, donors, frames: &frames, is_free: &is_free };
        let mut change = system.slopes(joints, objective.weights)?;
        solve_pentadiagonal(&bands, &mut change, 3 * joints.len())?;
        for (frame, change) in change.chunks_exact(3 * joints.len()).enumerate() {
            for (&joint, delta) in joints.iter().zip(change.chunks_exact(3)) {
                let value = &mut values[frame * n_joints + joint];
                *value = add(*value, -DVec3::from_slice(delta));
            }
        }
    }
    Ok(())
}

/// A frame and the rows of its donors.
#[derive(Clone, Copy)]
struct Frame {
    /// The row; of two donors that share the frame, that of the later one.
    row: usize,
    /// The row of the earlier donor at a seam, and the index of the seam.
    seam: Option<(usize, usize)>,
    /// Whether this frame and the next belong to one donor.
    is_step: bool,
    /// Of the seams before and after it, the index and the share of half of the difference of
    /// accelerations there.
    shares: [(usize, f64); 2],
}

impl Frame {
    fn list<V>(donors: &Donors<V>, spread: f64) -> Result<Vec<Self>, Error> {
        check_len(donors.stops.len(), donors.starts.len())?;
        let n_rows = donors
            .starts
            .iter()
            .zip(donors.stops)
            .map(|(start, stop)| stop.saturating_sub(*start).saturating_add(1));
        let mut frames = with_capacity(n_rows.fold(0, usize::saturating_add))?;
        let (mut row, mut seams) = (0, donors.seams.iter().enumerate().peekable());
        let first = donors.starts.first().copied().unwrap_or(0);
        for (segment, (&start, &stop)) in donors.starts.iter().zip(donors.stops).enumerate() {
            let is_shared = start + 1 == first + frames.len();
            if start >= stop || !(is_shared || start == first + frames.len()) {
                return Err(Error::InvalidSegment { segment });
            }
            let seam = seams.next_if(|&(_, &own)| own + 1 == segment);
            let seam = seam.filter(|_| is_shared).map(|(seam, _)| (row - 1, seam));
            if is_shared {
                frames.pop();
            }
            let last = row + stop - start;
            let frame = |row| Self { row, seam: None, is_step: row < last, shares: [(0, 0.0); 2] };
            frames.extend((row..=last).map(frame));
            let at = frames.len() - (stop - start) - 1;
            frames[at].seam = seam;
            if let Some((_, seam)) = seam {
                let before = donors.stops[segment - 1] - donors.starts[segment - 1];
                Self::spread_difference(&mut frames, at, [before, stop - start], (seam, spread));
            }
            row = last + 1;
        }
        Ok(frames)
    }

    /// Give the frames beside a seam at frame `at` their shares of its difference.
    fn spread_difference(
        frames: &mut [Self],
        at: usize,
        lengths: [usize; 2],
        (seam, spread): (usize, f64),
    ) {
        for (side, length) in lengths.into_iter().enumerate() {
            let reach = spread.min(length as f64);
            for distance in (1..length).take_while(|&own| (own as f64) < reach) {
                let share = 1.0 - distance as f64 / reach;
                match side {
                    0 => frames[at - distance].shares[1] = (seam, share),
                    _ => frames[at + distance].shares[0] = (seam, -share),
                }
            }
        }
    }
}

fn row_count<V>(donors: &Donors<V>) -> usize {
    donors
        .starts
        .iter()
        .zip(donors.stops)
        .map(|(start, stop)| stop - start + 1)
        .sum()
}

/// Whether each frame is within reach of a seam and not an end of the motion.
fn free_frames<V>(
    donors: &Donors<V>,
    n_frames: usize,
    objective: Objective,
) -> Result<Vec<bool>, Error> {
    let mut is_free = allocate(false, n_frames)?;
    let first = donors.starts.first().copied().unwrap_or(0);
    for &seam in donors.seams {
        let Some(&stop) = donors.stops.get(seam) else { continue };
        let (seam, reach) = (stop - first, objective.reach.max(0.0) as usize);
        let range = seam.saturating_sub(reach)..=(seam.saturating_add(reach)).min(n_frames - 1);
        is_free[range].fill(true);
    }
    let n_fixed = objective.n_fixed.clamp(1, n_frames.max(1));
    if let [.., last] = &mut is_free[..] {
        *last = false;
        is_free[..n_fixed].fill(false);
    }
    Ok(is_free)
}

/// The joints whose donors are not constant.
fn moving_joints<V: Value>(rows: &[V], n_joints: usize) -> Vec<usize> {
    // A constant track differs in its last bits after resampling.
    let moves = |joint: &usize| {
        let mut track = rows.iter().skip(*joint).step_by(n_joints);
        let first = track.next();
        track.any(|own| first.is_some_and(|first| own.difference(*first) > 1e-12))
    };
    (0..n_joints).filter(moves).collect()
}

/// The least-squares problem of all joints.
struct System<'a, V> {
    values: &'a [V],
    n_joints: usize,
    donors: Donors<'a, V>,
    frames: &'a [Frame],
    is_free: &'a [bool],
}

impl<V: Value> System<'_, V> {
    /// Half of the gradient of the sum at `values`: three components per joint, frame by frame.
    ///
    /// It is 0 in frames that are not free.
    fn slopes(&self, joints: &[usize], weights: [f64; 3]) -> Result<Vec<f64>, Error> {
        let (n, width) = (self.frames.len(), joints.len());
        let mut slopes = allocate(0.0, 3 * n * width)?;
        let mut add = |f: usize, column: usize, slope: DVec3| {
            if self.is_free[f] {
                let at = 3 * (f * width + column);
                for (sum, term) in slopes[at..at + 3].iter_mut().zip(slope.to_array()) {
                    *sum += term;
                }
            }
        };
        // Of each joint, the steps from the frame before, of `values` and of the donors.
        let mut last = vec![(DVec3::ZERO, DVec3::ZERO); width];
        for (f, frame) in self.frames.iter().enumerate() {
            let near = f.saturating_sub(1)..(f + 3).min(n);
            let has_step = frame.is_step && self.is_free[near].contains(&true);
            let has_acceleration = has_step && f > 0 && self.frames[f - 1].is_step;
            for (column, (&joint, last)) in joints.iter().zip(&mut last).enumerate() {
                if self.is_free[f] {
                    add(f, column, self.value_error(f, joint));
                }
                if !has_step {
                    continue;
                }
                let at = |values: &[V], row: usize| values[row * self.n_joints + joint];
                let step = at(self.values, f).delta_to(at(self.values, f + 1));
                let rows = self.donors.rows;
                let target = at(rows, frame.row).delta_to(at(rows, frame.row + 1));
                let error = weights[1] * (step - target);
                add(f, column, -error);
                add(f + 1, column, error);
                if has_acceleration {
                    let wanted = self.acceleration(frame, joint, target - last.1);
                    let error = weights[2] * (step - last.0 - wanted);
                    add(f - 1, column, error);
                    add(f, column, -2.0 * error);
                    add(f + 1, column, error);
                }
                *last = (step, target);
            }
        }
        Ok(slopes)
    }

    /// The wanted acceleration in a frame in which that of the donor is `own`.
    fn acceleration(&self, frame: &Frame, joint: usize, own: DVec3) -> DVec3 {
        let at = |seam: usize| {
            let index = seam * self.n_joints + joint;
            self.donors.accelerations.map(|side| 0.5 * side[index])
        };
        if let Some((_, seam)) = frame.seam {
            let [before, after] = at(seam);
            return before + after;
        }
        let shares = frame.shares.into_iter().filter(|&(_, share)| share != 0.0);
        shares.fold(own, |sum, (seam, share)| {
            let [before, after] = at(seam);
            sum + share * (after - before)
        })
    }

    fn value_error(&self, f: usize, joint: usize) -> DVec3 {
        let error = |row: usize| {
            let target = self.donors.rows[row * self.n_joints + joint];
            target.delta_to(self.values[f * self.n_joints + joint])
        };
        let Frame { row, seam, .. } = self.frames[f];
        match seam {
            Some((earlier, _)) => 0.5 * (error(row) + error(earlier)),
            None => error(row),
        }
    }
}

/// The matrix of the normal equations for [`solve_pentadiagonal`].
///
/// Rows and columns of fixed frames are those of the identity.
fn normal_matrix(
    frames: &[Frame],
    is_free: &[bool],
    weights: [f64; 3],
) -> Result<Vec<[f64; 3]>, Error> {
    let mut bands = allocate([weights[0], 0.0, 0.0], frames.len())?;
    let mut add = |first: usize, stencil: &[f64], weight: f64| {
        for (i, a) in stencil.iter().enumerate() {
            for (j, b) in stencil[i..].iter().enumerate() {
                bands[first + i][j] += weight * a * b;
            }
        }
    };
    for (f, pair) in frames
        .windows(2)
        .enumerate()
        .filter(|(_, pair)| pair[0].is_step)
    {
        add(f, &[-1.0, 1.0], weights[1]);
        if pair[1].is_step {
            add(f, &[1.0, -2.0, 1.0], weights[2]);
        }
    }
    let is_fixed = |f: usize| is_free.get(f) == Some(&false);
    for (f, band) in bands.iter_mut().enumerate() {
        if is_fixed(f) {
            *band = [1.0, 0.0, 0.0];
        }
        for (ahead, entry) in band.iter_mut().enumerate().skip(1) {
            if is_fixed(f + ahead) {
                *entry = 0.0;
            }
        }
    }
    Ok(bands)
}

#[cfg(test)]
mod tests {
    use super::*;

    const OBJECTIVE: Objective =
        Objective { weights: [1.0, 4.0, 16.0], reach: 3.0, n_fixed: 1, spread: 2.0 };

    fn ramp(first: f64, slope: f64) -> impl Iterator<Item = DVec3> {
        (0..=5).map(move |n| DVec3::new(first + slope * f64::from(n), 0.0, 0.0))
    }

    #[test]
    fn seam_without_gap_is_unchanged_and_gap_is_spread_over_reach() {
        for gap in [0.0, 1.0] {
            let rows: Vec<_> = ramp(0.0, 1.0).chain(ramp(5.0 + gap, 1.0)).collect();
            let mut values = rows.clone();
            values.remove(5);
            values[5].x = 5.0 + 0.5 * gap;
            let donors = Donors {
                starts: &[0, 5],
                stops: &[5, 10],
                rows: &rows,
                seams: &[0],
                accelerations: [&[DVec3::ZERO]; 2],
            };
            let mut smooth = values.clone();
            smooth_gradient(&mut smooth, 1, donors, OBJECTIVE).unwrap();
            let is_changed: Vec<_> = (0..11).filter(|&f| smooth[f] != values[f]).collect();
            assert!((smooth[5].x - values[5].x).abs() < 1e-12, "by symmetry");
            if gap == 0.0 {
                assert!(
                    smooth
                        .iter()
                        .zip(&values)
                        .all(|(a, b)| (a.x - b.x).abs() < 1e-12)
                );
            } else {
                assert!(is_changed.iter().all(|f| (2..=8).contains(f)));
                assert!(smooth[4].x > values[4].x + 0.1 && smooth[6].x < values[6].x - 0.1);
            }
        }
    }

    #[test]
    fn segments_that_do_not_follow_each_other_return_error() {
        let donors = |starts: &'static [usize], stops: &'static [usize]| Donors {
            starts,
            stops,
            rows: &[DVec3::ZERO; 6],
            seams: &[],
            accelerations: [&[]; 2],
        };
        let refused = |starts, stops| {
            smooth_gradient(&mut [DVec3::ZERO; 6], 1, donors(starts, stops), OBJECTIVE).err()
        };
        assert_eq!(refused(&[0, 3], &[2, 5]), None);
        assert_eq!(refused(&[0, 4], &[2, 5]), Some(Error::InvalidSegment { segment: 1 }));
        assert_eq!(refused(&[0, 1], &[2, 5]), Some(Error::InvalidSegment { segment: 1 }));
        assert_eq!(
            refused(&[0, 2], &[2, 5]),
            Some(Error::LengthMismatch { expected: 7, given: 6 })
        );
    }
}
