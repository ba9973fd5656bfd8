//! Motion at times between its frames.
//!
//! Two methods: [`slerp`] rotates at constant speed along the shorter arc between frames;
//! [`cubic`] has continuous velocity. It is the cubic Hermite curve on the sphere of Kim, Kim and
//! Shin (SIGGRAPH 1995), with tangents from the parabola through three neighbouring frames.
//! [`segments`] applies the cubic to many segments of a clip at once.

use glam::{DQuat, DVec3};

use crate::error::{Error, check_len};
use crate::rotation::{self, exp, log};
use mograft_machine::memory::with_capacity;

/// A frame of one joint: a value that has a cubic to another one.
pub trait Knot: Copy {
    /// The delta to another value.
    fn delta_to(self, other: Self) -> DVec3;
    /// The cubic at `t` that starts at `self` with velocity `start_velocity` and ends at `next`
    /// with `end_velocity`.
    #[must_use]
    fn cubic(self, next: Self, start_velocity: DVec3, end_velocity: DVec3, t: f64) -> Self;
}

impl Knot for DQuat {
    fn delta_to(self, other: Self) -> DVec3 {
        log(self.inverse() * other)
    }

    fn cubic(self, next: Self, start_velocity: DVec3, end_velocity: DVec3, t: f64) -> Self {
        hermite(self, next, start_velocity, end_velocity, t)
    }
}

impl Knot for DVec3 {
    fn delta_to(self, other: Self) -> DVec3 {
        other - self
    }

    fn cubic(self, next: Self, start_velocity: DVec3, end_velocity: DVec3, t: f64) -> Self {
        let s = 1.0 - t;
        // The Hermite basis in a form that is exact at t = 0 and t = 1.
        self * (s * s * (1.0 + 2.0 * t))
            + next * (t * t * (1.0 + 2.0 * s))
            + start_velocity * (t * s * s)
            - end_velocity * (t * t * s)
    }
}

/// The cubic on the sphere from `start` to `end` at `t`, 0 to 1.
///
/// `start_velocity` and `end_velocity` are angular velocities in the frame of the body, as
/// rotation vectors per unit of `t`. The curve has exactly these velocities and ends. NaN gives
/// NaN, except that the ends are returned for `t` of 0 and 1. Source: Kim, Kim and Shin, *A general
/// construction scheme for unit quaternion curves with simple high order derivatives*, SIGGRAPH
/// 1995.
pub fn hermite(
    start: DQuat,
    end: DQuat,
    start_velocity: DVec3,
    end_velocity: DVec3,
    t: f64,
) -> DQuat {
    if t == 0.0 {
        return start;
    }
    if t == 1.0 {
        return end;
    }
    let (first, last) = (start_velocity / 3.0, end_velocity / 3.0);
    let middle = log(exp(-first) * start.inverse() * end * exp(-last));
    let s = 1.0 - t;
    start
        * exp(first * (1.0 - s * s * s))
        * exp(middle * (t * t * (3.0 - 2.0 * t)))
        * exp(last * (t * t * t))
}

/// Rotations at `times`, by spherical linear interpolation between frames.
///
/// `rotations` is frame-major, `n_joints` wide, and so is the result. A time outside the
/// frames gives the nearest end frame; a NaN time gives NaN. Takes
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
    let mut resampled = with_capacity(times.len() * n_joints)?;
    for &time in times {
        let (f, t) = locate(frame_times, time);
        let arcs = rotations[f * n_joints..]
            .iter()
            .zip(&rotations[(f + 1) * n_joints..]);
        resampled.extend(arcs.take(n_joints).map(|(&a, &b)| rotation::slerp(a, b, t)));
    }
    Ok(resampled)
}

/// Rotations at `times`, by a curve through all frames with continuous velocity.
///
/// Arguments, layout, times outside the frames, NaN and complexity are as for [`slerp`]. Constant
/// velocity is reproduced; a rotation of the world rotates the curve; a reversal of time changes
/// the curve slightly.
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

/// Positions at `times`, by the cubic Hermite curve with the tangents of [`cubic`].
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
    let interval = |f: usize| frame_times[f + 1] - frame_times[f];
    let mut resampled = with_capacity(times.len() * n_joints)?;
    for &time in times {
        let (f, t) = locate(frame_times, time);
        resampled.extend(Span::new(knots, n_joints, 0, frame_times.len() - 1, &interval).at(f, t));
    }
    Ok(resampled)
}

/// A range of frames whose curve depends on these frames only.
struct Span<'a, K, G> {
    knots: &'a [K],
    n_joints: usize,
    first: usize,
    last: usize,
    /// The time from a frame to the next.
    interval: &'a G,
}

impl<'a, K: Knot, G: Fn(usize) -> f64> Span<'a, K, G> {
    fn new(knots: &'a [K], n_joints: usize, first: usize, last: usize, interval: &'a G) -> Self {
        Self { knots, n_joints, first, last, interval }
    }

    /// All joints at `t`, 0 to 1, between frame `f` and the next.
    fn at(&self, f: usize, t: f64) -> impl Iterator<Item = K> {
        (0..self.n_joints).map(move |joint| {
            if t == 0.0 {
                return self.knot(f, joint);
            }
            if t == 1.0 {
                return self.knot(f + 1, joint);
            }
            let (start_velocity, end_velocity) = self.tangents(f, joint);
            self.knot(f, joint)
                .cubic(self.knot(f + 1, joint), start_velocity, end_velocity, t)
        })
    }

    fn knot(&self, f: usize, joint: usize) -> K {
        self.knots[f * self.n_joints + joint]
    }

    fn tangents(&self, f: usize, joint: usize) -> (DVec3, DVec3) {
        let difference = |f: usize| self.knot(f, joint).delta_to(self.knot(f + 1, joint));
        tangents(f, self.first, self.last, self.interval, difference)
    }
}

/// The velocities at both ends of the interval from frame `f`, per interval.
///
/// Each is that of the parabola through three frames of `first` to `last`: the frame and both
/// neighbours, or at an end the three nearest. With only two frames the velocity is constant.
/// `interval` and `difference` are the time and the delta from a frame to the next.
fn tangents(
    f: usize,
    first: usize,
    last: usize,
    interval: impl Fn(usize) -> f64,
    difference: impl Fn(usize) -> DVec3,
) -> (DVec3, DVec3) {
    let chord = |f: usize| (difference(f) / interval(f), interval(f));
    let (speed, interval) = chord(f);
    let before = (f > first).then(|| chord(f - 1));
    let after = (f + 1 < last).then(|| chord(f + 1));
    // At a frame between two chords: their slopes, each weighted by the length of the other.
    let inner = |earlier: (DVec3, f64), later: (DVec3, f64)| {
        (earlier.0 * later.1 + later.0 * earlier.1) / (earlier.1 + later.1)
    };
    // At an end: the slope of the parabola extrapolated from this chord and the next.
    let outer = |next: (DVec3, f64)| speed + (speed - next.0) * (interval / (interval + next.1));
    let start_velocity = match (before, after) {
        (Some(before), _) => inner(before, (speed, interval)),
        (None, Some(after)) => outer(after),
        (None, None) => speed,
    };
    let end_velocity = match (before, after) {
        (_, Some(after)) => inner((speed, interval), after),
        (Some(before), None) => outer(before),
        (None, None) => speed,
    };
    (start_velocity * interval, end_velocity * interval)
}

/// Values of several clips at any times, by the curve of [`cubic`] through each clip.
///
/// Clips are frame-major, `n_joints` wide. Row `i` of the result is clip `clip[i]` at `times[i]`, in
/// frames. Times outside the clip, NaN and whole frames are as for [`cubic`]. Takes O(rows × joints)
/// time; deltas between frames are computed once for successive rows near the same frame.
///
/// # Errors
///
/// If a clip does not exist, has fewer than two frames or is not a whole number of frames.
pub fn sample_clips<V: Knot>(
    clips: &[&[V]],
    n_joints: usize,
    clip: &[usize],
    times: &[f64],
) -> Result<Vec<V>, Error> {
    check_len(times.len(), clip.len())?;
    let counts = frame_counts(clips, n_joints, clip)?;
    let mut rows = with_capacity(times.len() * n_joints)?;
    let mut steps = Steps::new(clips, n_joints);
    for (&clip, &time) in clip.iter().zip(times) {
        let Some(last) = counts[clip].checked_sub(1).filter(|&last| last > 0) else {
            return Err(Error::TooFewFrames { needed: 2, given: counts[clip] });
        };
        let f = (time.max(0.0) as usize).min(last - 1);
        let t = (time - f as f64).clamp(0.0, 1.0);
        let frame = |f: usize| &clips[clip][f * n_joints..(f + 1) * n_joints];
        if t == 0.0 || t == 1.0 {
            rows.extend_from_slice(frame(f + usize::from(t == 1.0)));
            continue;
        }
        let near = f.saturating_sub(1)..=(f + 1).min(last - 1);
        near.for_each(|f| steps.set(clip, f));
        for (joint, (&start, &end)) in frame(f).iter().zip(frame(f + 1)).enumerate() {
            let (leaving, reaching) = tangents(f, 0, last, |_| 1.0, |f| steps.get(f)[joint]);
            rows.push(start.cubic(end, leaving, reaching, t));
        }
    }
    Ok(rows)
}

/// Values, velocities and accelerations of several clips in given frames.
///
/// Clips and rows are as for [`sample_clips`]. Velocities, per frame, are those of the curve of
/// [`cubic`] at its frames. Accelerations, per frame², are second differences; the first and the
/// last frame of a clip have that of the nearest other frame. Both are 0 in clips that are too short.
///
/// # Errors
///
/// If a clip or frame does not exist, or a clip is not a whole number of frames.
#[expect(clippy::type_complexity, reason = "three parallel buffers")]
pub fn clip_states<V: Knot>(
    clips: &[&[V]],
    n_joints: usize,
    clip: &[usize],
    frames: &[usize],
) -> Result<(Vec<V>, Vec<DVec3>, Vec<DVec3>), Error> {
    check_len(frames.len(), clip.len())?;
    let counts = frame_counts(clips, n_joints, clip)?;
    let size = frames.len() * n_joints;
    let (mut values, mut velocities) = (with_capacity(size)?, with_capacity(size)?);
    let mut accelerations = with_capacity(size)?;
    let mut steps = Steps::new(clips, n_joints);
    for (row, (&clip, &frame)) in clip.iter().zip(frames).enumerate() {
        let count = counts[clip];
        if frame >= count {
            return Err(Error::InvalidRow { row });
        }
        values.extend_from_slice(&clips[clip][frame * n_joints..(frame + 1) * n_joints]);
        if count < 3 {
            let velocity = |joint: usize| {
                let at = |f: usize| clips[clip][f * n_joints + joint];
                if count == 2 { at(0).delta_to(at(1)) } else { DVec3::ZERO }
            };
            velocities.extend((0..n_joints).map(velocity));
            accelerations.resize(accelerations.len() + n_joints, DVec3::ZERO);
            continue;
        }
        let inside = frame.clamp(1, count - 2);
        steps.set(clip, inside - 1);
        steps.set(clip, inside);
        for (&before, &after) in steps.get(inside - 1).iter().zip(steps.get(inside)) {
            velocities.push(match frame {
                0 => 1.5 * before - 0.5 * after,
                _ if frame > inside => 1.5 * after - 0.5 * before,
                _ => 0.5 * (before + after),
            });
            accelerations.push(after - before);
        }
    }
    Ok((values, velocities, accelerations))
}

/// The frames in each clip; an error if one of `used` does not exist.
fn frame_counts<V>(clips: &[&[V]], n_joints: usize, used: &[usize]) -> Result<Vec<usize>, Error> {
    if let Some(row) = used.iter().position(|&clip| clip >= clips.len()) {
        return Err(Error::InvalidRow { row });
    }
    let count = |clip: &&[V]| {
        let count = clip.len().checked_div(n_joints).unwrap_or(usize::MAX);
        check_len(clip.len(), count.saturating_mul(n_joints)).map(|()| count)
    };
    clips.iter().map(count).collect()
}

/// Deltas from frames to the next, joint by joint, of the last three frames asked for.
struct Steps<'a, V> {
    clips: &'a [&'a [V]],
    n_joints: usize,
    /// The deltas of frame `f` are in slot `f % 3`.
    slots: [Vec<DVec3>; 3],
    /// The clip and frame of each slot.
    keys: [Option<(usize, usize)>; 3],
}

impl<'a, V: Knot> Steps<'a, V> {
    fn new(clips: &'a [&'a [V]], n_joints: usize) -> Self {
        Self { clips, n_joints, slots: Default::default(), keys: [None; 3] }
    }

    /// Compute the deltas of a frame unless they are known.
    fn set(&mut self, clip: usize, f: usize) {
        let deltas = &mut self.slots[f % 3];
        if self.keys[f % 3].replace((clip, f)) != Some((clip, f)) {
            let frames = &self.clips[clip][f * self.n_joints..(f + 2) * self.n_joints];
            let (start, end) = frames.split_at(self.n_joints);
            deltas.clear();
            deltas.extend(start.iter().zip(end).map(|(&a, &b)| a.delta_to(b)));
        }
    }

    /// The deltas of a frame that was set last of those in its slot.
    fn get(&self, f: usize) -> &[DVec3] {
        &self.slots[f % 3]
    }
}

/// Many segments of a clip, each resampled to a given count of frames.
///
/// Segment `i` runs from frame `starts[i]` to `stops[i]`, both included, and becomes
/// `counts[i]` evenly spaced frames; segments follow each other in the result. The curve is
/// that of [`cubic`] and depends on the frames of the segment only. A sample that coincides with a
/// frame is that frame, bit for bit: a segment resampled to its own count is unchanged. A count of
/// 1 gives the first frame. NaN affects the samples of the two intervals on either side. Takes
/// O(joints × Σ counts) time.
///
/// # Errors
///
/// If the lengths do not match, a segment leaves the clip or spans no interval, or the result does
/// not fit in memory.
pub fn segments(
    rotations: &[DQuat],
    n_joints: usize,
    starts: &[usize],
    stops: &[usize],
    counts: &[usize],
) -> Result<Vec<DQuat>, Error> {
    segment_knots(rotations, n_joints, starts, stops, counts)
}

/// Positions of many segments of a clip, as [`segments`] for rotations.
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
    let is_valid = |(&start, &stop): (&usize, &usize)| start < stop && stop < n_frames;
    if let Some(segment) = starts
        .iter()
        .zip(stops)
        .position(|bounds| !is_valid(bounds))
    {
        return Err(Error::InvalidSegment { segment });
    }

    // `counts` are not bounded by the input.
    let n_samples = counts
        .iter()
        .try_fold(0_usize, |sum, &count| sum.checked_add(count));
    let size = n_samples.and_then(|frames| frames.checked_mul(n_joints));
    let mut resampled = with_capacity(size.unwrap_or(usize::MAX))?;
    for ((&start, &stop), &count) in starts.iter().zip(stops).zip(counts) {
        let span = Span::new(knots, n_joints, start, stop, &|_| 1.0);
        let (length, steps) = (stop - start, count.saturating_sub(1).max(1));
        for sample in 0..count {
            // Integer arithmetic finds exactly whether a sample coincides with a frame.
            let (whole, rest) = (sample * length / steps, sample * length % steps);
            resampled.extend(span.at(start + whole, rest as f64 / steps as f64));
        }
    }
    Ok(resampled)
}

/// Check that `len` values are frames of `n_joints` joints at strictly increasing times.
fn check_frames(frame_times: &[f64], len: usize, n_joints: usize) -> Result<(), Error> {
    let given = frame_times.len();
    if given < 2 {
        return Err(Error::TooFewFrames { needed: 2, given });
    }
    check_len(len, given * n_joints)?;
    // `<` is false for NaN, which is therefore refused.
    if !frame_times.is_sorted_by(|a, b| a < b) {
        return Err(Error::TimesNotIncreasing);
    }
    Ok(())
}

/// The last frame at or before `time` that has a successor, and the fraction of the interval.
fn locate(frame_times: &[f64], time: f64) -> (usize, f64) {
    let last = frame_times.len() - 1;
    let after = frame_times.partition_point(|&t| t <= time).clamp(1, last);
    let (start, end) = (frame_times[after - 1], frame_times[after]);
    (after - 1, ((time - start) / (end - start)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random_walk(n_frames: usize) -> Vec<DQuat> {
        (0..n_frames)
            .map(|f| {
                let f = f as f64;
                exp(DVec3::new((0.9 * f).sin(), 0.4 * f, (0.3 * f).cos()))
            })
            .collect()
    }

    #[test]
    fn hermite_has_given_ends_and_velocities() {
        let (start, end) = (exp(DVec3::new(0.2, -1.0, 0.4)), exp(DVec3::new(-0.5, 0.3, 1.2)));
        let (start_velocity, end_velocity) =
            (DVec3::new(1.0, 0.4, -0.7), DVec3::new(-0.2, 0.9, 0.5));
        let curve = |t| hermite(start, end, start_velocity, end_velocity, t);
        let step = 1e-6;

        assert_eq!((curve(0.0), curve(1.0)), (start, end));
        let at_start = log(start.inverse() * curve(step)) / step;
        let at_end = log(curve(1.0 - step).inverse() * end) / step;
        assert!(at_start.abs_diff_eq(start_velocity, 1e-5), "{at_start}");
        assert!(at_end.abs_diff_eq(end_velocity, 1e-5), "{at_end}");
    }

    #[test]
    fn cubic_velocity_is_continuous_at_frames() {
        let frames = random_walk(9);
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
    fn segments_of_same_count_are_unchanged() {
        let frames = random_walk(30);
        let resampled = segments(&frames, 1, &[3, 10], &[10, 29], &[8, 20]).unwrap();
        assert_eq!(resampled[..8], frames[3..=10]);
        assert_eq!(resampled[8..], frames[10..=29]);
    }

    #[test]
    fn sample_clips_agrees_with_cubic_of_each_clip() {
        let (long, short) = (random_walk(12), random_walk(2));
        let times = [0.0, 0.4, 0.9, 1.3, 2.0, 1.9, 7.7, 10.6, 11.0, 12.5, -1.0, 0.2];
        let clip: Vec<usize> = (0..times.len()).map(|n| n % 5 % 2).collect();
        let found = sample_clips(&[&long, &short], 1, &clip, &times).unwrap();
        for (row, (&clip, &time)) in found.iter().zip(clip.iter().zip(&times)) {
            let frames = [&long, &short][clip];
            let frame_times: Vec<_> = (0..frames.len()).map(|f| f as f64).collect();
            assert_eq!(*row, cubic(&frame_times, frames, 1, &[time]).unwrap()[0]);
        }
    }

    #[test]
    fn clip_states_have_velocity_and_acceleration_of_curve() {
        let frames: Vec<_> = (0..5)
            .map(|n| DVec3::new(f64::from(n * n), f64::from(n), 0.0))
            .collect();
        let (values, velocities, accelerations) =
            clip_states(&[&frames], 1, &[0; 5], &[0, 1, 2, 3, 4]).unwrap();
        assert_eq!(values, frames);
        for (f, velocity) in velocities.iter().enumerate() {
            assert_eq!(*velocity, DVec3::new(2.0 * f as f64, 1.0, 0.0));
        }
        assert_eq!(accelerations, [DVec3::new(2.0, 0.0, 0.0); 5]);
        let two = clip_states(&[&frames[..2]], 1, &[0], &[1]).unwrap();
        assert_eq!(two.1, [DVec3::new(1.0, 1.0, 0.0)]);
        let refused = clip_states(&[&frames], 1, &[0], &[5]).err();
        assert_eq!(refused, Some(Error::InvalidRow { row: 0 }));
        assert!(sample_clips(&[&frames], 1, &[1], &[0.0]).is_err());
    }

    #[test]
    fn segments_outside_clip_return_error() {
        let frames = random_walk(5);
        let error = |start, stop| segments(&frames, 1, &[start], &[stop], &[3]).unwrap_err();
        assert_eq!(error(2, 5), Error::InvalidSegment { segment: 0 });
        assert_eq!(error(2, 2), Error::InvalidSegment { segment: 0 });
    }

    #[test]
    fn segments_of_more_frames_than_memory_return_error() {
        let frames = random_walk(5);
        let error = |counts: &[usize]| {
            segments(&frames, 1, &[0, 0][..counts.len()], &[4, 4][..counts.len()], counts)
        };
        for counts in [&[usize::MAX >> 6][..], &[usize::MAX][..], &[usize::MAX, 2][..]] {
            assert!(matches!(error(counts), Err(Error::OutOfMemory { .. })));
        }
    }

    #[test]
    fn slerp_of_invalid_frames_returns_error() {
        let error = |times: &[f64]| slerp(times, &[DQuat::IDENTITY; 3], 1, &[]).unwrap_err();
        assert_eq!(error(&[0.0]), Error::TooFewFrames { needed: 2, given: 1 });
        assert_eq!(error(&[0.0, 1.0]), Error::LengthMismatch { expected: 2, given: 3 });
        assert_eq!(error(&[0.0, 1.0, 1.0]), Error::TimesNotIncreasing);
        assert_eq!(error(&[0.0, 1.0, f64::NAN]), Error::TimesNotIncreasing);
    }
}
