//! Blocks of numbers: text to f64 and back.
//!
//! | module | what it does |
//! |---|---|
//! | [`scan`] | reads numbers parted by white space, and says where the first bad one stands |
//! | [`format`] | writes rows of numbers, each in the fewest digits that give it back |

pub mod format;
pub mod scan;

pub use format::format_rows;
pub use scan::{Scan, scan_numbers};
