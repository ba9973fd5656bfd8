//! What a kernel refuses to compute.

use std::fmt;

/// A kernel's refusal of its input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error {
    /// Fewer frames than the method needs.
    TooFewFrames {
        /// Frames needed.
        needed: usize,
        /// Frames given.
        given: usize,
    },
    /// Frame times that do not strictly increase.
    TimesNotIncreasing,
    /// A buffer of another length than its frames and joints call for.
    LengthMismatch {
        /// Length called for.
        expected: usize,
        /// Length given.
        given: usize,
    },
    /// A joint whose parent does not stand before it.
    ParentNotBefore {
        /// The joint.
        joint: usize,
    },
    /// A joint that a pose does not have.
    NoSuchJoint {
        /// The joint.
        joint: usize,
    },
    /// A channel that belongs to no axis, no column or no joint.
    BadChannel,
    /// A segment that does not lie within the clip, or has no interval.
    BadSegment {
        /// The segment's place in the list.
        segment: usize,
    },
    /// A pair of capsules of which one is not there.
    BadPair {
        /// The pair's place in the list.
        pair: usize,
    },
    /// More frames are wanted than memory holds.
    NoRoom,
}

impl std::error::Error for Error {}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::TooFewFrames { needed, given } => {
                write!(f, "at least {needed} frames are needed, got {given}")
            }
            Self::NoRoom => write!(f, "more frames are wanted than memory holds"),
            Self::TimesNotIncreasing => write!(f, "frame times must strictly increase"),
            Self::LengthMismatch { expected, given } => {
                write!(f, "expected {expected} values, got {given}")
            }
            Self::ParentNotBefore { joint } => {
                write!(f, "the parent of joint {joint} must stand before it")
            }
            Self::NoSuchJoint { joint } => write!(f, "there is no joint {joint}"),
            Self::BadChannel => write!(f, "a channel must have an axis, a column and a joint"),
            Self::BadSegment { segment } => {
                write!(f, "segment {segment} must lie within the clip and span at least 1 interval")
            }
            Self::BadPair { pair } => write!(f, "pair {pair} must name capsules that are there"),
        }
    }
}

/// Check that a buffer has the length that its frames and joints call for.
pub(crate) fn check_len(given: usize, expected: usize) -> Result<(), Error> {
    if given == expected { Ok(()) } else { Err(Error::LengthMismatch { expected, given }) }
}

/// Check that every parent is negative or stands before its joint.
pub(crate) fn check_parents(parents: &[i64]) -> Result<(), Error> {
    let stands_before = |(joint, &parent): (usize, &i64)| parent < 0 || (parent as usize) < joint;
    match parents
        .iter()
        .enumerate()
        .find(|&joint| !stands_before(joint))
    {
        Some((joint, _)) => Err(Error::ParentNotBefore { joint }),
        None => Ok(()),
    }
}
