//! The errors of the kernels.

use std::fmt;

use mograft_machine::memory::Refused;

/// Why a kernel refused its input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error {
    /// Fewer frames than the method requires.
    TooFewFrames {
        /// Smallest count of frames.
        needed: usize,
        /// Count of frames.
        given: usize,
    },
    /// Frame times that do not strictly increase.
    TimesNotIncreasing,
    /// A buffer whose length does not match its frames and joints.
    LengthMismatch {
        /// Length that matches.
        expected: usize,
        /// Length of the buffer.
        given: usize,
    },
    /// A joint whose parent does not precede it.
    ParentNotFirst {
        /// The joint.
        joint: usize,
    },
    /// A joint index that is too large.
    InvalidJoint {
        /// The joint.
        joint: usize,
    },
    /// A channel whose axis, column or joint does not exist.
    InvalidChannel,
    /// A segment outside the clip, or of a single frame.
    InvalidSegment {
        /// Index of the segment.
        segment: usize,
    },
    /// A segment index that is too large.
    UnknownSegment {
        /// The segment.
        segment: usize,
    },
    /// A frame index that is too large.
    InvalidFrame {
        /// The frame.
        frame: usize,
    },
    /// A row with a clip or frame that does not exist.
    InvalidRow {
        /// Index of the row.
        row: usize,
    },
    /// A frame in a piece that does not exist.
    InvalidPiece {
        /// Index of the piece.
        piece: usize,
    },
    /// A pair with a capsule index that is too large.
    InvalidPair {
        /// Index of the pair.
        pair: usize,
    },
    /// A pose index that is too large.
    InvalidPose {
        /// The index.
        pose: usize,
    },
    /// A track with keys that do not exist.
    InvalidTrack {
        /// Index of the track.
        track: usize,
    },
    /// A matrix that is not positive definite.
    NotPositiveDefinite {
        /// First row without a positive pivot.
        row: usize,
    },
    /// The system has refused memory.
    OutOfMemory {
        /// Bytes requested.
        bytes: usize,
    },
}

impl std::error::Error for Error {}

impl From<Refused> for Error {
    fn from(Refused { bytes }: Refused) -> Self {
        Self::OutOfMemory { bytes }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::TooFewFrames { needed, given } => {
                write!(f, "at least {needed} frames are required, got {given}")
            }
            Self::OutOfMemory { bytes } => write!(f, "unable to allocate {bytes} bytes"),
            Self::TimesNotIncreasing => write!(f, "`frame_times` must strictly increase"),
            Self::LengthMismatch { expected, given } => {
                write!(f, "expected {expected} values, got {given}")
            }
            Self::ParentNotFirst { joint } => {
                write!(f, "the parent of joint {joint} must precede it")
            }
            Self::InvalidJoint { joint } => {
                write!(f, "`joints` must be indices of joints, got {joint}")
            }
            Self::InvalidChannel => {
                write!(f, "every channel must have an axis, a column and a joint that exist")
            }
            Self::InvalidSegment { segment } => {
                write!(f, "segment {segment} must lie within the clip and span at least 1 interval")
            }
            Self::UnknownSegment { segment } => {
                write!(f, "base segments and donors must be indices of segments, got {segment}")
            }
            Self::InvalidFrame { frame } => {
                write!(f, "frames must be indices of frames, got {frame}")
            }
            Self::InvalidRow { row } => {
                write!(f, "row {row} must have a clip and a frame that exist")
            }
            Self::InvalidPiece { piece } => {
                write!(f, "frames must be in pieces that have a window, got piece {piece}")
            }
            Self::NotPositiveDefinite { row } => {
                write!(f, "the matrix must be positive definite, row {row} is not")
            }
            Self::InvalidTrack { track } => {
                write!(f, "track {track} must have key times and a value for each of them")
            }
            Self::InvalidPose { pose } => {
                write!(f, "`candidates` must be indices of poses, got {pose}")
            }
            Self::InvalidPair { pair } => write!(f, "pair {pair} must be indices of capsules"),
        }
    }
}

/// Check that a buffer has the length that matches its frames and joints.
pub(crate) fn check_len(given: usize, expected: usize) -> Result<(), Error> {
    if given == expected { Ok(()) } else { Err(Error::LengthMismatch { expected, given }) }
}

/// Check that every parent is negative or precedes its joint.
pub(crate) fn check_parents(parents: &[i64]) -> Result<(), Error> {
    let precedes = |(joint, &parent): (usize, &i64)| parent < 0 || (parent as usize) < joint;
    match parents.iter().enumerate().find(|&joint| !precedes(joint)) {
        Some((joint, _)) => Err(Error::ParentNotFirst { joint }),
        None => Ok(()),
    }
}
