//! Linear systems whose matrix has few diagonals.

use crate::error::{Error, check_len};
use crate::memory::{copied, filled};

/// Solution of A x = b for a symmetric positive definite matrix of five diagonals.
///
/// `bands[i]` holds A(i, i), A(i, i + 1) and A(i, i + 2); entries beyond the last column are
/// ignored. `rhs` has one row of `width` right-hand sides per row of A, and so has the result.
///
/// Factorises A = L D Lᵀ without pivoting (Golub and Van Loan, Matrix Computations, 4.3.5), in
/// O(rows × width) time. A NaN in `rhs` affects its column only.
///
/// # Errors
///
/// If the lengths disagree, A is not positive definite or has a NaN, or memory is exhausted.
pub fn solve_pentadiagonal(
    bands: &[[f64; 3]],
    rhs: &[f64],
    width: usize,
) -> Result<Vec<f64>, Error> {
    let mut x = copied(rhs)?;
    solve_in_place(bands, &mut x, width)?;
    Ok(x)
}

/// [`solve_pentadiagonal`] that replaces the right-hand sides by the solution.
pub(crate) fn solve_in_place(bands: &[[f64; 3]], x: &mut [f64], width: usize) -> Result<(), Error> {
    let n = bands.len();
    check_len(x.len(), n * width)?;
    let mut pivots = filled(0.0, n)?;
    // Columns 1 and 2 below the diagonal of L.
    let mut lower = filled([0.0; 2], n)?;
    for row in 0..n {
        let [mut pivot, mut first, second] = bands[row];
        if row >= 1 {
            pivot -= lower[row - 1][0] * lower[row - 1][0] * pivots[row - 1];
            first -= lower[row - 1][0] * lower[row - 1][1] * pivots[row - 1];
        }
        if row >= 2 {
            pivot -= lower[row - 2][1] * lower[row - 2][1] * pivots[row - 2];
        }
        if !(pivot > 0.0 && pivot.is_finite() && first.is_finite() && second.is_finite()) {
            return Err(Error::NotPositiveDefinite { row });
        }
        pivots[row] = pivot;
        lower[row] = [first / pivot, second / pivot];
    }
    for row in 0..n {
        for back in 1..=2.min(row) {
            let factor = lower[row - back][back - 1];
            let (above, below) = x.split_at_mut(row * width);
            let source = &above[(row - back) * width..(row - back + 1) * width];
            for (value, other) in below[..width].iter_mut().zip(source) {
                *value -= factor * other;
            }
        }
    }
    for row in (0..n).rev() {
        for value in &mut x[row * width..(row + 1) * width] {
            *value /= pivots[row];
        }
        for ahead in 1..=2.min(n - 1 - row) {
            let factor = lower[row][ahead - 1];
            let (above, below) = x.split_at_mut((row + 1) * width);
            let source = &below[(ahead - 1) * width..ahead * width];
            for (value, other) in above[row * width..].iter_mut().zip(source) {
                *value -= factor * other;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solution_satisfies_the_system() {
        let bands = [[4.0, 1.0, -0.5], [5.0, -1.0, 0.25], [3.0, 0.5, 9.0], [2.0, 9.0, 9.0]];
        let x = [1.0, -2.0, 0.5, 3.0, -1.0, 4.0, 2.0, 0.0];
        let entry = |i: usize, j: usize| {
            let (low, gap) = (i.min(j), i.abs_diff(j));
            if gap < 3 { bands[low][gap] } else { 0.0 }
        };
        let rhs: Vec<f64> = (0..8)
            .map(|k| (0..4).map(|j| entry(k / 2, j) * x[2 * j + k % 2]).sum())
            .collect();
        let found = solve_pentadiagonal(&bands, &rhs, 2).unwrap();
        assert!(found.iter().zip(x).all(|(a, b)| (a - b).abs() < 1e-14));
    }

    #[test]
    fn indefinite_matrix_is_refused() {
        let bands = [[1.0, 2.0, 0.0], [1.0, 0.0, 0.0]];
        let refused = solve_pentadiagonal(&bands, &[1.0, 1.0], 1);
        assert_eq!(refused, Err(Error::NotPositiveDefinite { row: 1 }));
    }
}
