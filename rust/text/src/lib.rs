//! Blocks of numbers: text to f64 and back.
