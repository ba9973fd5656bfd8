//! Vectors whose allocation may fail without ending the process.
//!
//! Kernels use them for buffers whose size grows with the number of frames or rows.

use crate::error::Error;

/// An empty vector with room for `len` elements.
///
/// # Errors
///
/// [`Error::OutOfMemory`] if the system refuses the memory.
pub fn reserve<T>(len: usize) -> Result<Vec<T>, Error> {
    let mut vector = Vec::new();
    vector
        .try_reserve_exact(len)
        .map_err(|_| Error::OutOfMemory { bytes: len.saturating_mul(size_of::<T>()) })?;
    Ok(vector)
}

/// A vector of `len` equal elements.
///
/// # Errors
///
/// As [`reserve`].
pub fn filled<T: Clone>(value: T, len: usize) -> Result<Vec<T>, Error> {
    let mut vector = reserve(len)?;
    vector.resize(len, value);
    Ok(vector)
}

/// A copy of a slice.
///
/// # Errors
///
/// As [`reserve`].
pub fn copied<T: Copy>(slice: &[T]) -> Result<Vec<T>, Error> {
    let mut copy = reserve(slice.len())?;
    copy.extend_from_slice(slice);
    Ok(copy)
}

/// The elements of an iterator that has at most `len` of them.
///
/// # Errors
///
/// As [`reserve`].
pub fn collected<T>(elements: impl Iterator<Item = T>, len: usize) -> Result<Vec<T>, Error> {
    let mut vector = reserve(len)?;
    vector.extend(elements.take(len));
    Ok(vector)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_allocation_beyond_the_address_space_is_an_error() {
        let len = usize::MAX / 16;
        let error = Error::OutOfMemory { bytes: len.saturating_mul(8) };
        assert_eq!(reserve::<f64>(len), Err(error));
        assert_eq!(filled(0.0, len), Err(error));
        assert_eq!(collected(std::iter::repeat(0.0), len), Err(error));
        assert_eq!(collected(0..9, 3), Ok(vec![0, 1, 2]));
        assert_eq!(copied(&[1, 2]), Ok(vec![1, 2]));
        assert_eq!(filled(1, 2), Ok(vec![1, 1]));
    }
}
