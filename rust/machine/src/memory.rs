//! Vectors whose memory the system may refuse: an error instead of the end of the process.

use std::fmt;

/// The system has refused memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused {
    /// Bytes requested.
    pub bytes: usize,
}

impl std::error::Error for Refused {}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "unable to allocate {} bytes", self.bytes)
    }
}

/// Make room for `count` more elements, and for others as a vector grows.
///
/// # Errors
///
/// [`Refused`] if the system refuses the memory.
pub fn reserve<T>(vector: &mut Vec<T>, count: usize) -> Result<(), Refused> {
    vector
        .try_reserve(count)
        .map_err(|_| refused::<T>(vector.len().saturating_add(count)))
}

/// Make room for `len` elements in all.
///
/// # Errors
///
/// [`Refused`] if the system refuses the memory.
pub fn ensure_capacity<T>(vector: &mut Vec<T>, len: usize) -> Result<(), Refused> {
    reserve(vector, len.saturating_sub(vector.len()))
}

/// An empty vector with room for exactly `len` elements.
///
/// # Errors
///
/// [`Refused`] if the system refuses the memory.
pub fn with_capacity<T>(len: usize) -> Result<Vec<T>, Refused> {
    let mut vector = Vec::new();
    vector
        .try_reserve_exact(len)
        .map_err(|_| refused::<T>(len))?;
    Ok(vector)
}

/// A vector of `len` equal values.
///
/// # Errors
///
/// [`Refused`] if the system refuses the memory.
pub fn allocate<T: Clone>(value: T, len: usize) -> Result<Vec<T>, Refused> {
    let mut vector = with_capacity(len)?;
    vector.resize(len, value);
    Ok(vector)
}

/// A vector of values whose count is known.
///
/// # Errors
///
/// [`Refused`] if the system refuses the memory.
pub fn collect<T>(values: impl ExactSizeIterator<Item = T>) -> Result<Vec<T>, Refused> {
    let mut vector = with_capacity(values.len())?;
    vector.extend(values);
    Ok(vector)
}

/// A copy of a slice.
///
/// # Errors
///
/// [`Refused`] if the system refuses the memory.
pub fn copy<T: Copy>(slice: &[T]) -> Result<Vec<T>, Refused> {
    collect(slice.iter().copied())
}

/// The first `len` elements of an iterator, or all if there are fewer.
///
/// # Errors
///
/// [`Refused`] if the system refuses the memory.
pub fn collect_first<T>(values: impl Iterator<Item = T>, len: usize) -> Result<Vec<T>, Refused> {
    let mut vector = with_capacity(len)?;
    vector.extend(values.take(len));
    Ok(vector)
}

/// Append values whose count is known.
///
/// # Errors
///
/// [`Refused`] if the system refuses the memory.
pub fn append<T>(
    vector: &mut Vec<T>,
    values: impl ExactSizeIterator<Item = T>,
) -> Result<(), Refused> {
    reserve(vector, values.len())?;
    vector.extend(values);
    Ok(())
}

/// Append a value.
///
/// # Errors
///
/// [`Refused`] if the system refuses the memory.
pub fn push<T>(vector: &mut Vec<T>, value: T) -> Result<(), Refused> {
    if vector.len() == vector.capacity() {
        reserve(vector, 1)?;
    }
    vector.push(value);
    Ok(())
}

/// Check that the system has `bytes` bytes of memory, by requesting and releasing them.
///
/// # Errors
///
/// [`Refused`] if the system refuses the memory.
pub fn check_available(bytes: usize) -> Result<(), Refused> {
    with_capacity::<u8>(bytes).map(drop)
}

/// The error for `len` elements.
fn refused<T>(len: usize) -> Refused {
    Refused { bytes: len.saturating_mul(size_of::<T>()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_allocation_beyond_the_address_space_is_an_error() {
        let len = usize::MAX / 16;
        let error = Refused { bytes: len.saturating_mul(8) };
        assert_eq!(with_capacity::<f64>(len), Err(error));
        assert_eq!(allocate(0.0, len), Err(error));
        assert_eq!(collect_first(std::iter::repeat(0.0), len), Err(error));
        assert_eq!(reserve(&mut Vec::<f64>::new(), len), Err(error));
        assert_eq!(collect_first(0..9, 3), Ok(vec![0, 1, 2]));
        assert_eq!(copy(&[1, 2]), Ok(vec![1, 2]));
        assert_eq!(allocate(1, 2), Ok(vec![1, 1]));
    }
}
