//! The numbers of BVH files: blocks of text to f64 and back.
//!
//! | module | purpose |
//! |---|---|
//! | [`scan`] | parses numbers separated by white space and locates the first malformed token |
//! | [`format`](mod@format) | writes rows of numbers, each in the fewest digits that give it back |
//!
//! Digits are converted by `fast-float2` and `zmij`; this crate adds the grammar of BVH's motion
//! block: white space, line ends, and the choice of notation.

pub mod format;
pub mod scan;

pub use format::format_rows;
pub use scan::{Scan, scan_numbers};
