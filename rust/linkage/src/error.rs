//! What the crate refuses to cluster.

use std::fmt;

/// A refusal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error {
    /// Points without coordinates, or a buffer that holds no whole number of them.
    NoPoints {
        /// Length of the buffer.
        len: usize,
        /// Coordinates of one point.
        dim: usize,
    },
    /// More points than a tree can number.
    TooManyPoints {
        /// Points given.
        given: usize,
        /// The most that will do.
        most: usize,
    },
    /// A coordinate that is infinite or not a number.
    NotFinite {
        /// Row of the point.
        point: usize,
        /// Which of its coordinates.
        axis: usize,
    },
    /// A distance that is negative, infinite or not a number.
    BadDistance {
        /// Its place in the condensed matrix.
        index: usize,
    },
    /// A condensed matrix whose length is no n(n-1)/2.
    NotCondensed {
        /// Length given.
        len: usize,
    },
    /// A diameter that is negative or not a number.
    BadDiameter,
    /// The caller asked to stop.
    Stopped,
}

impl std::error::Error for Error {}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NoPoints { len, dim } => {
                write!(f, "points must have at least 1 coordinate each, got {len} for {dim} axes")
            }
            Self::TooManyPoints { given, most } => {
                write!(f, "at most {most} points can be clustered, got {given}")
            }
            Self::NotFinite { point, axis } => {
                write!(f, "points must be finite, got another value at [{point}, {axis}]")
            }
            Self::BadDistance { index } => {
                write!(f, "distances must be finite and not negative, got another at [{index}]")
            }
            Self::NotCondensed { len } => {
                write!(f, "distances must be n(n-1)/2 in number, got {len}")
            }
            Self::BadDiameter => write!(f, "max_diameter must be 0 or more"),
            Self::Stopped => write!(f, "stopped by the caller"),
        }
    }
}
