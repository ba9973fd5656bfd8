//! The text of BVH files: joints, and blocks of numbers to f64 and back.
//!
//! | module | purpose |
//! |---|---|
//! | [`scan`] | parses numbers separated by white space and locates the first malformed token |
//! | [`hierarchy`] | reads joints that are written in the usual form |
//! | [`format`](mod@format) | writes rows of numbers, each in the fewest digits that give it back |
//!
//! Digits are converted by `fast-float2` and `zmij`; this crate adds the grammar of BVH's motion
//! block: white space, line ends, text that arrives in pieces, and the choice of notation.

pub mod format;
pub mod hierarchy;
pub mod scan;

pub use format::format_rows;
pub use hierarchy::{EndSite, Hierarchy, Joint, Limits, Open, scan_hierarchy};
pub use scan::{Scan, scan_numbers};
