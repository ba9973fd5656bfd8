//! Motion at times between its frames.
//!
//! Two ways: [`slerp`] turns at constant speed along the shorter arc from frame to frame;
//! [`cubic`] is smooth (C1), by the cubic Hermite curve on the sphere of Kim, Kim and Shin
//! (SIGGRAPH 1995), with tangents from the parabola through three neighbouring frames.
//! [`segments`] does the latter for many segments of a clip at once.

use glam::{DQuat, DVec3};

use crate::Error;
use crate::error::check_len;
use crate::rotation::{self, exp, log};

/// A point of a curve between two frames that has a cubic through it.
trait Knot: Copy {
    /// The way to the next frame, as a vector.
    fn way_to(self, next: Self) -> DVec3;
    /// The cubic that leaves `self` by `leaving` and reaches `next` by `reaching`.
    fn cubic(self, next: Self, leaving: DVec3, reaching: DVec3, t: f64) -> Self;
}

impl Knot for DQuat {
    fn way_to(self, next: Self) -> DVec3 {
        log(self.inverse() * next)
    }

    fn cubic(self, next: Self, leaving: DVec3, reaching: DVec3, t: f64) -> Self {
        hermite(self, next, leaving, reaching, t)
    }
}

impl Knot for DVec3 {
    fn way_to(self, next: Self) -> DVec3 {
        next - self
    }

    fn cubic(self, next: Self, leaving: DVec3, reaching: DVec3, t: f64) -> Self {
        let s = 1.0 - t;
        // Hermite's basis, written so that t = 0 and t = 1 give the frames themselves.
        self * (s * s * (1.0 + 2.0 * t)) + next * (t * t * (1.0 + 2.0 * s)) + leaving * (t * s * s)
            - reaching * (t * t * s)
    }
}

/// The cubic on the sphere from `start` to `end` at `t`, 0 to 1.
///
/// `leaving` and `reaching` are the angular velocities at the two ends in the body's own
/// frame, as rotation vectors per unit of `t`; both are met exactly, as are the ends.
pub fn hermite(start: DQuat, end: DQuat, leaving: DVec3, reaching: DVec3, t: f64) -> DQuat {
    if t == 0.0 {
        return start;
    }
    if t == 1.0 {
        return end;
    }
    let (first, last) = (leaving / 3.0, reaching / 3.0);
    let middle = log(exp(-first) * start.inverse() * end * exp(-last));
    let s = 1.0 - t;
    start
        * exp(first * (1.0 - s * s * s))
        * exp(middle * (t * t * (3.0 - 2.0 * t)))
        * exp(last * (t * t * t))
}

/// Rotations at `times`, by spherical linear interpolation between frames.
///
/// `rotations` is frame-major, `n_joints` wide; the result is laid out alike. A time
/// outside the frames takes the nearest end frame; a NaN time gives NaN. Takes
/// O(`times.len()` × (`n_joints` + log `frame_times.len()`)) time.
///
/// # Errors
///
/// If there are fewer than two frames, if `frame_times` does not strictly increase, or if
/// `rotations` is not `frame_times.len() * n_joints` long.
pub fn slerp(
    frame_times: &[f64],
    rotations: &[DQuat],
    n_joints: usize,
    times: &[f64],
) -> Result<Vec<DQuat>, Error> {
    check_frames(frame_times, rotations.len(), n_joints)?;
    let mut resampled = Vec::with_capacity(times.len() * n_joints);
    for &time in times {
        let (f, t) = locate(frame_times, time);
        let arcs = rotations[f * n_joints..]
            .iter()
            .zip(&rotations[(f + 1) * n_joints..]);
        resampled.extend(arcs.take(n_joints).map(|(&a, &b)| rotation::slerp(a, b, t)));
    }
    Ok(resampled)
}

/// Rotations at `times`, by a curve through all frames without jumps in velocity.
///
/// Arguments, layout and ends as for [`slerp`]. Constant velocity is reproduced,
/// and turning the world turns the curve; reversing time changes it a little.
///
/// # Errors
///
/// As for [`slerp`].
pub fn cubic(
    frame_times: &[f64],
    rotations: &[DQuat],
    n_joints: usize,
    times: &[f64],
) -> Result<Vec<DQuat>, Error> {
    cubic_knots(frame_times, rotations, n_joints, times)
}

/// Positions at `times`, by the cubic of [`cubic`] for vectors.
///
/// # Errors
///
/// As for [`slerp`].
pub fn cubic_positions(
    frame_times: &[f64],
    positions: &[DVec3],
    n_joints: usize,
    times: &[f64],
) -> Result<Vec<DVec3>, Error> {
    cubic_knots(frame_times, positions, n_joints, times)
}

fn cubic_knots<K: Knot>(
    frame_times: &[f64],
    knots: &[K],
    n_joints: usize,
    times: &[f64],
) -> Result<Vec<K>, Error> {
    check_frames(frame_times, knots.len(), n_joints)?;
    let gap = |f: usize| frame_times[f + 1] - frame_times[f];
    let mut resampled = Vec::with_capacity(times.len() * n_joints);
    for &time in times {
        let (f, t) = locate(frame_times, time);
        resampled.extend(Span::new(knots, n_joints, 0, frame_times.len() - 1, &gap).at(f, t));
    }
    Ok(resampled)
}

/// A stretch of frames whose curve looks at no frame outside it.
struct Span<'a, K, G> {
    knots: &'a [K],
    n_joints: usize,
    first: usize,
    last: usize,
    gap: &'a G,
}

impl<'a, K: Knot, G: Fn(usize) -> f64> Span<'a, K, G> {
    fn new(knots: &'a [K], n_joints: usize, first: usize, last: usize, gap: &'a G) -> Self {
        Self { knots, n_joints, first, last, gap }
    }

    /// All joints, `t` of the way from frame `f` to the next.
    fn at(&self, f: usize, t: f64) -> impl Iterator<Item = K> {
        (0..self.n_joints).map(move |joint| {
            if t == 0.0 {
                return self.knot(f, joint);
            }
            if t == 1.0 {
                return self.knot(f + 1, joint);
            }
            let (leaving, reaching) = self.tangents(f, joint);
            self.knot(f, joint)
                .cubic(self.knot(f + 1, joint), leaving, reaching, t)
        })
    }

    fn knot(&self, f: usize, joint: usize) -> K {
        self.knots[f * self.n_joints + joint]
    }

    /// The velocities at both ends of the interval from frame `f`, per interval.
    ///
    /// Each is that of the parabola through three frames: those around the frame, or at
    /// an end the three nearest. With two frames in all the velocity is constant.
    fn tangents(&self, f: usize, joint: usize) -> (DVec3, DVec3) {
        let way = |f: usize| self.knot(f, joint).way_to(self.knot(f + 1, joint));
        let here = way(f);
        let gap = (self.gap)(f);
        let speed = here / gap;
        let before = (f > self.first).then(|| (way(f - 1) / (self.gap)(f - 1), (self.gap)(f - 1)));
        let after =
            (f + 1 < self.last).then(|| (way(f + 1) / (self.gap)(f + 1), (self.gap)(f + 1)));
        // Slopes of the chord before and after a knot, weighted by the other's length.
        let through = |earlier: (DVec3, f64), later: (DVec3, f64)| {
            (earlier.0 * later.1 + later.0 * earlier.1) / (earlier.1 + later.1)
        };
        let beyond = |next: (DVec3, f64)| speed + (speed - next.0) * (gap / (gap + next.1));
        let leaving = match (before, after) {
            (Some(before), _) => through(before, (speed, gap)),
            (None, Some(after)) => beyond(after),
            (None, None) => speed,
        };
        let reaching = match (before, after) {
            (_, Some(after)) => through((speed, gap), after),
            (Some(before), None) => beyond(before),
            (None, None) => speed,
        };
        (leaving * gap, reaching * gap)
    }
}

/// Many segments of a clip, each resampled to a number of frames of its own.
///
/// Segment `i` runs from frame `starts[i]` to `stops[i]`, both included, and becomes
/// `counts[i]` frames evenly spread over it, appended one segment after the other. The
/// curve is that of [`cubic`] and looks at no frame outside the segment. A sample that
/// falls on a frame is that frame bit for bit; as many frames as before are the segment
/// itself. A single frame wanted is the segment's first.
///
/// # Errors
///
/// If the buffers do not fit, or a segment leaves the clip or spans no interval.
pub fn segments(
    rotations: &[DQuat],
    n_joints: usize,
    starts: &[usize],
    stops: &[usize],
    counts: &[usize],
) -> Result<Vec<DQuat>, Error> {
    segment_knots(rotations, n_joints, starts, stops, counts)
}

/// As [`segments`], for positions.
///
/// # Errors
///
/// As for [`segments`].
pub fn segments_positions(
    positions: &[DVec3],
    n_joints: usize,
    starts: &[usize],
    stops: &[usize],
    counts: &[usize],
) -> Result<Vec<DVec3>, Error> {
    segment_knots(positions, n_joints, starts, stops, counts)
}

fn segment_knots<K: Knot>(
    knots: &[K],
    n_joints: usize,
    starts: &[usize],
    stops: &[usize],
    counts: &[usize],
) -> Result<Vec<K>, Error> {
    let n_frames = knots.len().checked_div(n_joints).unwrap_or(0);
    check_len(knots.len(), n_frames * n_joints)?;
    check_len(stops.len(), starts.len())?;
    check_len(counts.len(), starts.len())?;
    let is_good = |(&start, &stop): (&usize, &usize)| start < stop && stop < n_frames;
    if let Some(segment) = starts.iter().zip(stops).position(|bounds| !is_good(bounds)) {
        return Err(Error::BadSegment { segment });
    }

    // What is wanted is the caller's word: a failed allocation would end the process.
    let wanted = counts
        .iter()
        .try_fold(0_usize, |sum, &count| sum.checked_add(count));
    let size = wanted.and_then(|frames| frames.checked_mul(n_joints));
    let mut resampled = Vec::new();
    if size.is_none_or(|size| resampled.try_reserve_exact(size).is_err()) {
        return Err(Error::NoRoom);
    }
    for ((&start, &stop), &count) in starts.iter().zip(stops).zip(counts) {
        let span = Span::new(knots, n_joints, start, stop, &|_| 1.0);
        let (length, steps) = (stop - start, count.saturating_sub(1).max(1));
        for sample in 0..count {
            // In whole numbers, so that a sample on a frame is seen to be on it.
            let (whole, rest) = (sample * length / steps, sample * length % steps);
            resampled.extend(span.at(start + whole, rest as f64 / steps as f64));
        }
    }
    Ok(resampled)
}

/// Check that `len` values make up frames of `n_joints` at increasing times.
fn check_frames(frame_times: &[f64], len: usize, n_joints: usize) -> Result<(), Error> {
    let given = frame_times.len();
    if given < 2 {
        return Err(Error::TooFewFrames { needed: 2, given });
    }
    check_len(len, given * n_joints)?;
    // Asked as "is less", so that a NaN, which is less than nothing, is refused too.
    if !frame_times.is_sorted_by(|a, b| a < b) {
        return Err(Error::TimesNotIncreasing);
    }
    Ok(())
}

/// The frame before `time` that has a successor, and how far towards it, 0 to 1.
fn locate(frame_times: &[f64], time: f64) -> (usize, f64) {
    let last = frame_times.len() - 1;
    let after = frame_times.partition_point(|&t| t <= time).clamp(1, last);
    let (start, end) = (frame_times[after - 1], frame_times[after]);
    (after - 1, ((time - start) / (end - start)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wander(n_frames: usize) -> Vec<DQuat> {
        (0..n_frames)
            .map(|f| {
                let f = f as f64;
                exp(DVec3::new((0.9 * f).sin(), 0.4 * f, (0.3 * f).cos()))
            })
            .collect()
    }

    #[test]
    fn hermite_meets_its_ends_and_their_velocities() {
        let (start, end) = (exp(DVec3::new(0.2, -1.0, 0.4)), exp(DVec3::new(-0.5, 0.3, 1.2)));
        let (leaving, reaching) = (DVec3::new(1.0, 0.4, -0.7), DVec3::new(-0.2, 0.9, 0.5));
        let curve = |t| hermite(start, end, leaving, reaching, t);
        let step = 1e-6;

        assert_eq!((curve(0.0), curve(1.0)), (start, end));
        let at_start = log(start.inverse() * curve(step)) / step;
        let at_end = log(curve(1.0 - step).inverse() * end) / step;
        assert!(at_start.abs_diff_eq(leaving, 1e-5), "{at_start}");
        assert!(at_end.abs_diff_eq(reaching, 1e-5), "{at_end}");
    }

    #[test]
    fn cubic_has_no_jump_in_velocity_at_a_frame() {
        let frames = wander(9);
        let times: Vec<_> = [0.0, 1.0, 1.5, 2.7, 3.0, 4.0, 4.1, 6.0, 7.0].into();
        let step = 1e-6;
        for frame in 1..8 {
            let at = [times[frame] - step, times[frame], times[frame] + step];
            let near = cubic(&times, &frames, 1, &at).unwrap();
            let before = log(near[0].inverse() * near[1]) / step;
            let after = log(near[1].inverse() * near[2]) / step;
            assert!(before.abs_diff_eq(after, 1e-3), "{before} {after}");
        }
    }

    #[test]
    fn as_many_frames_as_before_are_the_segment_itself() {
        let frames = wander(30);
        let resampled = segments(&frames, 1, &[3, 10], &[10, 29], &[8, 20]).unwrap();
        assert_eq!(resampled[..8], frames[3..=10]);
        assert_eq!(resampled[8..], frames[10..=29]);
    }

    #[test]
    fn a_segment_outside_the_clip_is_refused() {
        let frames = wander(5);
        let refusal = |start, stop| segments(&frames, 1, &[start], &[stop], &[3]).unwrap_err();
        assert_eq!(refusal(2, 5), Error::BadSegment { segment: 0 });
        assert_eq!(refusal(2, 2), Error::BadSegment { segment: 0 });
    }

    #[test]
    fn more_frames_than_memory_holds_are_refused() {
        let frames = wander(5);
        let refusal = |counts: &[usize]| {
            segments(&frames, 1, &[0, 0][..counts.len()], &[4, 4][..counts.len()], counts)
        };
        for counts in [&[usize::MAX >> 6][..], &[usize::MAX][..], &[usize::MAX, 2][..]] {
            assert_eq!(refusal(counts).unwrap_err(), Error::NoRoom);
        }
    }

    #[test]
    fn frames_that_are_no_motion_are_refused() {
        let refusal = |times: &[f64]| slerp(times, &[DQuat::IDENTITY; 3], 1, &[]).unwrap_err();
        assert_eq!(refusal(&[0.0]), Error::TooFewFrames { needed: 2, given: 1 });
        assert_eq!(refusal(&[0.0, 1.0]), Error::LengthMismatch { expected: 2, given: 3 });
        assert_eq!(refusal(&[0.0, 1.0, 1.0]), Error::TimesNotIncreasing);
        assert_eq!(refusal(&[0.0, 1.0, f64::NAN]), Error::TimesNotIncreasing);
    }
}
