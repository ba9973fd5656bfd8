//! Vectors whose memory the system may refuse: an error instead of the end of the process.

use crate::error::Error;

/// Make room for `count` more elements, and for others as a vector grows.
///
/// # Errors
///
/// [`Error::OutOfMemory`] if the system refuses the memory.
pub(crate) fn reserve<T>(vector: &mut Vec<T>, count: usize) -> Result<(), Error> {
    vector
        .try_reserve(count)
        .map_err(|_| refused::<T>(vector.len().saturating_add(count)))
}

/// Make room for `len` elements in all.
///
/// # Errors
///
/// [`Error::OutOfMemory`] if the system refuses the memory.
pub(crate) fn ensure_capacity<T>(vector: &mut Vec<T>, len: usize) -> Result<(), Error> {
    reserve(vector, len.saturating_sub(vector.len()))
}

/// An empty vector with room for exactly `len` elements.
///
/// # Errors
///
/// [`Error::OutOfMemory`] if the system refuses the memory.
pub(crate) fn with_capacity<T>(len: usize) -> Result<Vec<T>, Error> {
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
/// [`Error::OutOfMemory`] if the system refuses the memory.
pub(crate) fn allocate<T: Clone>(value: T, len: usize) -> Result<Vec<T>, Error> {
    let mut vector = with_capacity(len)?;
    vector.resize(len, value);
    Ok(vector)
}

/// A vector of values whose count is known.
///
/// # Errors
///
/// [`Error::OutOfMemory`] if the system refuses the memory.
pub(crate) fn collect<T>(values: impl ExactSizeIterator<Item = T>) -> Result<Vec<T>, Error> {
    let mut vector = with_capacity(values.len())?;
    vector.extend(values);
    Ok(vector)
}

/// Append values whose count is known.
///
/// # Errors
///
/// [`Error::OutOfMemory`] if the system refuses the memory.
pub(crate) fn append<T>(
    vector: &mut Vec<T>,
    values: impl ExactSizeIterator<Item = T>,
) -> Result<(), Error> {
    reserve(vector, values.len())?;
    vector.extend(values);
    Ok(())
}

/// Append a value.
///
/// # Errors
///
/// [`Error::OutOfMemory`] if the system refuses the memory.
pub(crate) fn push<T>(vector: &mut Vec<T>, value: T) -> Result<(), Error> {
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
/// [`Error::OutOfMemory`] if the system refuses the memory.
pub(crate) fn check_available(bytes: usize) -> Result<(), Error> {
    with_capacity::<u8>(bytes).map(drop)
}

/// The error for `len` elements.
fn refused<T>(len: usize) -> Error {
    Error::OutOfMemory { bytes: len.saturating_mul(size_of::<T>()) }
}
