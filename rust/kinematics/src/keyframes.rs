//! Keyframe animation: values of tracks of keys at the times of frames.
//!
//! A track has key times and, for every key, a value: a translation, a scale, or a rotation. The
//! interpolations are those of glTF 2.0 (appendix C of its specification).

use std::ops::{Add, Mul};

use glam::{DQuat, DVec3};

use crate::error::{Error, check_len};
use crate::rotation;
use mograft_machine::memory::with_capacity;

/// How the value changes from a key to the next one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// It keeps the value of the key before.
    Step,
    /// It is linear, or spherical linear.
    Linear,
    /// It is a cubic Hermite spline. A key has three values: in-tangent, value and out-tangent.
    Spline,
}

/// One track: where its keys are.
#[derive(Clone, Copy, Debug)]
pub struct Track {
    /// Index of its first value.
    pub start: usize,
    /// Index of its list of key times.
    pub times: usize,
    /// How its values change between keys.
    pub interpolation: Interpolation,
}

/// Lists of key times, one after another.
#[derive(Clone, Copy, Debug)]
pub struct KeyTimes<'a> {
    /// Seconds, not decreasing within a list.
    pub seconds: &'a [f64],
    /// Index of the first key of each list, and at the end the number of all keys.
    pub starts: &'a [usize],
}

/// A value of a key.
pub trait Value: Copy + PartialEq + Add<Output = Self> + Mul<f64, Output = Self> {
    /// The value at the fraction `u` of the way to `next`.
    #[must_use]
    fn mix(self, next: Self, u: f64) -> Self;
    /// The valid value nearest to a sum of values.
    #[must_use]
    fn normalise(self) -> Self;
}

impl Value for DVec3 {
    fn mix(self, next: Self, u: f64) -> Self {
        self + u * (next - self)
    }

    fn normalise(self) -> Self {
        self
    }
}

impl Value for DQuat {
    fn mix(self, next: Self, u: f64) -> Self {
        rotation::slerp(self, next, u)
    }

    fn normalise(self) -> Self {
        let length = self.length();
        if length < 1e-6 { Self::IDENTITY } else { self * (1.0 / length) }
    }
}

/// The keys before and after a frame.
#[derive(Clone, Copy)]
struct Place {
    before: usize,
    after: usize,
    /// From the key before to the key after.
    seconds: f64,
    /// The fraction of `seconds` until the frame; 0 at a key.
    fraction: f64,
}

/// The values of all tracks in every frame, frame-major.
///
/// `times` are the times of the frames in seconds, which increase. Before its first key a track has
/// the value of this key, and after its last key that of the last one. A frame at a key has exactly
/// the value of the key; times in single precision count as equal up to their rounding, or up to
/// 1e-4 frames. Takes O(keys + frames × tracks) time. NaN affects the frames between its neighbours.
///
/// # Errors
///
/// If a list of key times is empty or outside `keys`, or a track has a value outside `values`.
pub fn sample_keys<V: Value>(
    times: &[f64],
    keys: KeyTimes<'_>,
    values: &[V],
    tracks: &[Track],
) -> Result<Vec<V>, Error> {
    let places = find_places(times, keys)?;
    for (track, &Track { start, times, interpolation }) in tracks.iter().enumerate() {
        let length = match keys.starts.get(times..).and_then(|starts| starts.get(..2)) {
            Some(ends) => ends[1] - ends[0],
            None => return Err(Error::InvalidTrack { track }),
        };
        let width = if interpolation == Interpolation::Spline { 3 } else { 1 };
        if values.len().saturating_sub(start) < width * length {
            return Err(Error::InvalidTrack { track });
        }
    }
    let mut sampled = with_capacity(times.len().saturating_mul(tracks.len()))?;
    for frame in 0..times.len() {
        for track in tracks {
            let place = places[track.times * times.len() + frame];
            sampled.push(value_at(&values[track.start..], track.interpolation, place));
        }
    }
    Ok(sampled)
}

/// The keys around every frame, for all frames of the first list, then of the second, and so on.
fn find_places(times: &[f64], keys: KeyTimes<'_>) -> Result<Vec<Place>, Error> {
    let n_lists = keys.starts.len().saturating_sub(1);
    let mut places = with_capacity(n_lists.saturating_mul(times.len()))?;
    let step = match times {
        [first, .., last] => (last - first) / (times.len() - 1) as f64,
        _ => 0.0,
    };
    check_len(keys.seconds.len(), keys.starts.last().copied().unwrap_or(0))?;
    for ends in keys.starts.windows(2) {
        let seconds = keys.seconds.get(ends[0]..ends[1]).unwrap_or_default();
        let Some(last) = seconds.last() else {
            return Err(Error::TooFewFrames { needed: 1, given: 0 });
        };
        let tolerance = 1e-4 * step + 2.0 * f64::from(f32::EPSILON) * last;
        let mut n_passed = 0;
        for time in times {
            while n_passed < seconds.len() && seconds[n_passed] <= time + tolerance {
                n_passed += 1;
            }
            let before = n_passed.saturating_sub(1);
            let after = (before + 1).min(seconds.len() - 1);
            let (gap, elapsed) = (seconds[after] - seconds[before], time - seconds[before]);
            let is_at_key = elapsed <= tolerance || gap <= 0.0;
            let fraction = if is_at_key { 0.0 } else { (elapsed / gap).min(1.0) };
            places.push(Place { before, after, seconds: gap, fraction });
        }
    }
    Ok(places)
}

/// The value of a track in a frame.
fn value_at<V: Value>(values: &[V], interpolation: Interpolation, place: Place) -> V {
    let u = place.fraction;
    match interpolation {
        Interpolation::Step => values[place.before],
        Interpolation::Linear => {
            let (start, end) = (values[place.before], values[place.after]);
            if u == 0.0 || start == end { start } else { start.mix(end, u) }
        }
        Interpolation::Spline => {
            let (before, after) = (3 * place.before, 3 * place.after);
            let (square, cube) = (u * u, u * u * u);
            let curve = values[before + 1] * (2.0 * cube - 3.0 * square + 1.0)
                + values[before + 2] * (place.seconds * (cube - 2.0 * square + u))
                + values[after + 1] * (3.0 * square - 2.0 * cube)
                + values[after] * (place.seconds * (cube - square));
            curve.normalise()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: Interpolation = Interpolation::Step;
    const LINEAR: Interpolation = Interpolation::Linear;
    const SPLINE: Interpolation = Interpolation::Spline;

    fn track(start: usize, times: usize, interpolation: Interpolation) -> Track {
        Track { start, times, interpolation }
    }

    #[test]
    fn keys_of_each_interpolation_have_known_values_between() {
        let keys = KeyTimes { seconds: &[1.0, 3.0, 0.0, 4.0], starts: &[0, 2, 4] };
        let at = |x: f64| DVec3::new(x, 0.0, 0.0);
        // Two keys of 0 and 8; then a spline of the cube of the time, with its slopes.
        let values = [0.0, 8.0, 0.0, 0.0, 0.0, 48.0, 64.0, 48.0].map(at);
        let tracks = [track(0, 0, STEP), track(0, 0, LINEAR), track(2, 1, SPLINE)];
        let sampled = sample_keys(&[0.0, 1.0, 2.0, 3.0, 4.0], keys, &values, &tracks).unwrap();
        let found: Vec<_> = sampled.iter().map(|v| v.x).collect();
        let expected =
            [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 4.0, 8.0], [8.0, 8.0, 27.0], [8.0, 8.0, 64.0]];
        assert_eq!(found, expected.concat());
    }

    #[test]
    fn rotations_take_the_shorter_arc_and_keep_keys() {
        let quarter = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let keys = KeyTimes { seconds: &[0.0, 1.0], starts: &[0, 2] };
        let tracks = [track(0, 0, LINEAR)];
        let values = [DQuat::IDENTITY, -quarter];
        let found = sample_keys(&[0.0, 0.5, 1.0], keys, &values, &tracks).unwrap();
        assert_eq!((found[0], found[2]), (DQuat::IDENTITY, -quarter));
        assert!(rotation::angle(found[1] * found[1], quarter) < 1e-15);
    }

    #[test]
    fn spline_of_opposite_rotations_is_the_identity_where_it_vanishes() {
        let (zero, half) = (DQuat::from_array([0.0; 4]), DQuat::from_rotation_x(3.0));
        let keys = KeyTimes { seconds: &[0.0, 1.0], starts: &[0, 2] };
        let values = [zero, half, zero, zero, -half, zero];
        let tracks = [track(0, 0, SPLINE)];
        assert_eq!(sample_keys(&[0.5], keys, &values, &tracks), Ok(vec![DQuat::IDENTITY]));
    }

    #[test]
    fn tracks_without_keys_or_values_return_errors() {
        let sample = |starts: &[usize], tracks: &[Track]| {
            let keys = KeyTimes { seconds: &[0.0, 1.0], starts };
            sample_keys(&[0.0], keys, &[DVec3::ZERO; 3], tracks).unwrap_err()
        };
        let short = Error::LengthMismatch { expected: 1, given: 2 };
        assert_eq!(sample(&[0, 1], &[]), short);
        assert_eq!(sample(&[0, 0, 2], &[]), Error::TooFewFrames { needed: 1, given: 0 });
        let invalid = [track(2, 0, LINEAR), track(0, 1, STEP), track(0, 0, SPLINE)];
        for track in invalid {
            assert_eq!(sample(&[0, 2], &[track]), Error::InvalidTrack { track: 0 });
        }
    }
}
