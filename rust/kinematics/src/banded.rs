//! Linear systems whose matrix has few diagonals.

use crate::error::{Error, check_len};
use mograft_machine::memory::allocate;

/// Replace right-hand sides b by the solution of A x = b, for a symmetric positive definite matrix
/// of five diagonals.
///
/// `bands[i]` holds A(i, i), A(i, i + 1) and A(i, i + 2); entries beyond the last column are
/// ignored. `x` has one row of `width` right-hand sides, later of solutions, per row of A.
///
/// Factorises A = L D Lᵀ without pivoting (Golub and Van Loan, Matrix Computations, 4.3.5), in
/// O(rows × width) time. A NaN in `x` affects its column only.
///
/// # Errors
///
/// If the lengths disagree, A is not positive definite or has a NaN, or memory is exhausted; `x` is
/// unchanged then.
pub(crate) fn solve_pentadiagonal(
    bands: &[[f64; 3]],
    x: &mut [f64],
    width: usize,
) -> Result<(), Error> {
    let n = bands.len();
    check_len(x.len(), n * width)?;
    let mut pivots = allocate(0.0, n)?;
    // Columns 1 and 2 below the diagonal of L.
    let mut lower = allocate([0.0; 2], n)?;
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

    /// The entry A(i, j) of a matrix given by its bands.
    fn entry(bands: &[[f64; 3]], i: usize, j: usize) -> f64 {
        let gap = i.abs_diff(j);
        if gap < 3 { bands[i.min(j)][gap] } else { 0.0 }
    }

    fn multiply(bands: &[[f64; 3]], x: &[f64], width: usize) -> Vec<f64> {
        let n = bands.len();
        (0..n * width)
            .map(|k| {
                let (i, column) = (k / width, k % width);
                (0..n)
                    .map(|j| entry(bands, i, j) * x[j * width + column])
                    .sum()
            })
            .collect()
    }

    #[test]
    fn solution_satisfies_the_system() {
        for (n, width) in (1..12).flat_map(|n| (0..4).map(move |width| (n, width))) {
            let number = |k: usize| (12.9898 * (k + 100 * n + 10 * width) as f64).sin();
            // Diagonally dominant, so positive definite.
            let bands: Vec<_> = (0..n)
                .map(|i| [5.0 + number(i), number(i + 20), number(i + 40)])
                .collect();
            let x: Vec<_> = (0..n * width).map(|k| 9.0 * number(k + 60)).collect();
            let mut found = multiply(&bands, &x, width);
            solve_pentadiagonal(&bands, &mut found, width).unwrap();
            assert!(found.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-12));
        }
    }

    #[test]
    fn indefinite_matrix_is_refused_and_right_hand_sides_are_kept() {
        let bands = [[1.0, 2.0, 0.0], [1.0, 0.0, 0.0]];
        let mut x = [3.0, 4.0];
        let refused = solve_pentadiagonal(&bands, &mut x, 1);
        assert_eq!(refused, Err(Error::NotPositiveDefinite { row: 1 }));
        assert_eq!(x, [3.0, 4.0]);
    }
}
