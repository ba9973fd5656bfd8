//! The errors of this crate.

use std::fmt;

use mograft_machine::memory::Refused;

/// Why an input was refused, or a call ended early.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Error {
    /// Points without coordinates, or a buffer that is not a whole number of points.
    InvalidShape {
        /// Length of the buffer.
        len: usize,
        /// Coordinates per point.
        dim: usize,
    },
    /// More points than cluster numbers.
    TooManyPoints {
        /// Count of points.
        given: usize,
        /// Largest count supported.
        max: usize,
    },
    /// A coordinate that is infinite or NaN.
    InvalidCoordinate {
        /// Row of the point.
        point: usize,
        /// Index of the coordinate.
        axis: usize,
        /// The coordinate.
        value: f64,
    },
    /// A distance that is negative, infinite or NaN.
    InvalidDistance {
        /// Index in the condensed matrix.
        index: usize,
        /// The distance.
        value: f64,
    },
    /// A condensed matrix whose length is not n(n - 1)/2 for any n.
    InvalidLength {
        /// The length.
        len: usize,
    },
    /// A diameter that is negative or NaN.
    InvalidDiameter {
        /// The diameter.
        value: f64,
    },
    /// The call needs more memory than [`Options::max_bytes`](crate::Options::max_bytes) allows.
    MemoryLimit {
        /// Bytes needed, estimated.
        needed: usize,
        /// The limit.
        limit: usize,
    },
    /// The system has refused memory.
    OutOfMemory {
        /// Bytes requested.
        bytes: usize,
    },
    /// The progress callback requested a stop.
    Stopped,
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
            Self::InvalidShape { len, dim } => {
                write!(
                    f,
                    "`points` must be rows of at least 1 coordinate, got {len} values for {dim} axes"
                )
            }
            Self::TooManyPoints { given, max } => {
                write!(f, "`points` must have at most {max} rows, got {given}")
            }
            Self::InvalidCoordinate { point, axis, value } => {
                write!(f, "`points` must be finite, got {value} at [{point}, {axis}]")
            }
            Self::InvalidDistance { index, value } => {
                write!(f, "`distances` must be finite and not negative, got {value} at [{index}]")
            }
            Self::InvalidLength { len } => {
                write!(f, "`distances` must have n(n - 1)/2 elements for some n, got {len}")
            }
            Self::InvalidDiameter { value } => {
                write!(f, "`max_diameter` must be 0 or more, got {value}")
            }
            Self::MemoryLimit { needed, limit } => {
                write!(f, "the call needs about {needed} bytes, the limit is {limit}")
            }
            Self::OutOfMemory { bytes } => write!(f, "unable to allocate {bytes} bytes"),
            Self::Stopped => write!(f, "stopped by the progress callback"),
        }
    }
}
