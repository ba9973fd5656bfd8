//! Eigenvectors of symmetric matrices, the same bits on any number of threads.
//!
//! What LAPACK returns depends in its last bits on how many threads its BLAS has, and such
//! bits decide ties between clusters. Here is one thread and one order of sums: Householder's
//! reduction to a tridiagonal matrix, then QL iterations with implicit shifts (Bowdler, Martin,
//! Reinsch and Wilkinson 1968; Martin and Wilkinson 1968). The rotations of the iterations are
//! kept, and turned back into only as many eigenvectors as are wanted.

use std::fmt;

/// What is wrong with a matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error {
    /// Its numbers are no square.
    NotSquare,
    /// Not all of its numbers are finite.
    NotFinite,
    /// The iterations did not end; never seen with finite numbers.
    NoConvergence,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotSquare => "the matrix must be square",
            Self::NotFinite => "the matrix must be finite",
            Self::NoConvergence => "the eigenvalues do not converge",
        })
    }
}

impl std::error::Error for Error {}

/// All eigenvalues, descending, and the eigenvectors of the first `wanted`.
///
/// `matrix` is symmetric, `n` rows of `n` numbers.
/// The vectors come as `n` rows of one number per vector, orthonormal to rounding. Of two
/// opposite ones either may be returned.
///
/// # Errors
///
/// If the matrix is not square or not finite.
pub fn eigen(matrix: &[f64], n: usize, wanted: usize) -> Result<(Vec<f64>, Vec<f64>), Error> {
    if matrix.len() != n * n {
        return Err(Error::NotSquare);
    }
    if !matrix.iter().all(|value| value.is_finite()) {
        return Err(Error::NotFinite);
    }
    let wanted = wanted.min(n);
    let size = matrix
        .iter()
        .fold(0.0, |size: f64, value| size.max(value.abs()));
    if n == 0 || size == 0.0 {
        let unit = |at: usize| f64::from(u8::from(at / wanted.max(1) == at % wanted.max(1)));
        return Ok((vec![0.0; n], (0..n * wanted).map(unit).collect()));
    }
    let mut scaled: Vec<f64> = matrix.iter().map(|value| value / size).collect();
    let Tridiagonal { mut diagonal, mut beside, factors } = reduce(&mut scaled, n);
    let rotations = iterate(&mut diagonal, &mut beside)?;

    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| diagonal[b].total_cmp(&diagonal[a]));
    let mut vectors = vec![0.0; n * wanted];
    for (column, &row) in order[..wanted].iter().enumerate() {
        vectors[row * wanted + column] = 1.0;
    }
    for &Rotation { row, cos, sin } in rotations.iter().rev() {
        let (upper, lower) = vectors[row * wanted..][..2 * wanted].split_at_mut(wanted);
        for (a, b) in upper.iter_mut().zip(lower) {
            (*a, *b) = (cos * *a + sin * *b, cos * *b - sin * *a);
        }
    }
    let mut along = vec![0.0; wanted];
    for (column, &factor) in factors.iter().enumerate().rev() {
        let normal = &scaled[column * n + column + 1..(column + 1) * n];
        let rows = &mut vectors[(column + 1) * wanted..];
        along.fill(0.0);
        for (&weight, row) in normal.iter().zip(rows.chunks_exact(wanted.max(1))) {
            add(&mut along, weight, row);
        }
        for (&weight, row) in normal.iter().zip(rows.chunks_exact_mut(wanted.max(1))) {
            add(row, -factor * weight, &along);
        }
    }
    let values = order.iter().map(|&index| size * diagonal[index]).collect();
    Ok((values, vectors))
}

/// `to += factor * from`.
fn add(to: &mut [f64], factor: f64, from: &[f64]) {
    for (a, b) in to.iter_mut().zip(from) {
        *a += factor * b;
    }
}

/// `I - factor v vᵀ` for each column turns a matrix into one that has three diagonals.
struct Tridiagonal {
    diagonal: Vec<f64>,
    beside: Vec<f64>,
    factors: Vec<f64>,
}

/// So little, where the greatest number is 1, that its square's reciprocal is still finite.
const NOTHING: f64 = 1e-100;

/// Reduce a matrix; the vectors `v` are left in its rows, right of the diagonal.
fn reduce(matrix: &mut [f64], n: usize) -> Tridiagonal {
    let mut diagonal = vec![0.0; n];
    let mut beside = vec![0.0; n];
    let mut factors = vec![0.0; n.saturating_sub(1)];
    let mut image = vec![0.0; n];
    for column in 0..n {
        let (done, rest) = matrix.split_at_mut((column + 1) * n);
        let row = &mut done[column * n..];
        diagonal[column] = row[column];
        let normal = &mut row[column + 1..];
        let Some(&first) = normal.first() else { break };
        let length = normal.iter().map(|v| v * v).sum::<f64>().sqrt();
        if length < NOTHING {
            continue;
        }
        // The sign that adds, so that nothing cancels.
        beside[column] = -length.copysign(first);
        normal[0] = first - beside[column];
        let factor = 1.0 / (length * (length + first.abs()));
        factors[column] = factor;

        let image = &mut image[column + 1..];
        image.fill(0.0);
        for (&weight, row) in normal.iter().zip(rest.chunks_exact(n)) {
            add(image, factor * weight, &row[column + 1..]);
        }
        let half: f64 = normal.iter().zip(&*image).map(|(v, p)| v * p).sum::<f64>() * 0.5 * factor;
        add(image, -half, normal);
        for ((&v, &p), row) in normal.iter().zip(&*image).zip(rest.chunks_exact_mut(n)) {
            let own = &mut row[column + 1..];
            for ((a, &b), &q) in own.iter_mut().zip(&*normal).zip(&*image) {
                *a -= v * q + p * b;
            }
        }
    }
    Tridiagonal { diagonal, beside, factors }
}

/// A rotation in the plane of two neighbouring rows.
struct Rotation {
    row: usize,
    cos: f64,
    sin: f64,
}

/// Iterations that one eigenvalue may take; two or three are usual.
const MOST: usize = 64;

/// Make the numbers beside the diagonal vanish; return the rotations that did it.
fn iterate(diagonal: &mut [f64], beside: &mut [f64]) -> Result<Vec<Rotation>, Error> {
    let n = diagonal.len();
    // Beside the whole matrix, not its neighbours: these vanish, too, where there is no rank.
    let sizes = diagonal
        .iter()
        .zip(&*beside)
        .map(|(d, e)| d.abs() + e.abs());
    let nothing = f64::EPSILON * sizes.fold(0.0, f64::max);
    let mut rotations = Vec::new();
    for first in 0..n {
        for round in 0.. {
            let last = (first..n - 1)
                .find(|&at| beside[at].abs() <= nothing)
                .unwrap_or(n - 1);
            if last == first {
                break;
            }
            if round == MOST {
                return Err(Error::NoConvergence);
            }
            // Wilkinson's shift: of the eigenvalues of the first two rows the nearer to the first.
            let ratio = (diagonal[first + 1] - diagonal[first]) / (2.0 * beside[first]);
            let root = ratio.hypot(1.0);
            let shift = diagonal[first] - beside[first] / (ratio + root.copysign(ratio));
            let (mut sin, mut cos, mut moved) = (1.0, 1.0, 0.0);
            let mut bulge = diagonal[last] - shift;
            let mut early = false;
            for row in (first..last).rev() {
                let (f, b) = (sin * beside[row], cos * beside[row]);
                let r = f.hypot(bulge);
                beside[row + 1] = r;
                if r == 0.0 {
                    diagonal[row + 1] -= moved;
                    beside[last] = 0.0;
                    early = true;
                    break;
                }
                (sin, cos) = (f / r, bulge / r);
                let below = diagonal[row + 1] - moved;
                let r = (diagonal[row] - below) * sin + 2.0 * cos * b;
                moved = sin * r;
                diagonal[row + 1] = below + moved;
                bulge = cos * r - b;
                rotations.push(Rotation { row, cos, sin });
            }
            if early {
                continue;
            }
            diagonal[first] -= moved;
            beside[first] = bulge;
            beside[last] = 0.0;
        }
    }
    Ok(rotations)
}

#[cfg(test)]
mod tests {
    use super::{Error, eigen};

    fn made(n: usize, seed: u64) -> Vec<f64> {
        let mut state = seed;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 33) as f64 / f64::from(1 << 30) - 1.0
        };
        let mut matrix = vec![0.0; n * n];
        for row in 0..n {
            for column in 0..=row {
                let value = next();
                matrix[row * n + column] = value;
                matrix[column * n + row] = value;
            }
        }
        matrix
    }

    #[test]
    fn vectors_are_orthonormal_and_the_matrix_stretches_them() {
        for n in 1..40 {
            for wanted in [1, n / 2, n] {
                let matrix = made(n, n as u64);
                let (values, vectors) = eigen(&matrix, n, wanted).unwrap();
                assert!(values.is_sorted_by(|a, b| a >= b));
                let trace: f64 = (0..n).map(|i| matrix[i * n + i]).sum();
                assert!((values.iter().sum::<f64>() - trace).abs() < 1e-12 * n as f64);
                for a in 0..wanted {
                    for row in 0..n {
                        let image: f64 = (0..n)
                            .map(|k| matrix[row * n + k] * vectors[k * wanted + a])
                            .sum();
                        let expected = values[a] * vectors[row * wanted + a];
                        assert!((image - expected).abs() < 1e-12 * n as f64);
                    }
                    for b in 0..wanted {
                        let product: f64 = (0..n)
                            .map(|k| vectors[k * wanted + a] * vectors[k * wanted + b])
                            .sum();
                        assert!((product - f64::from(u8::from(a == b))).abs() < 1e-13 * n as f64);
                    }
                }
            }
        }
    }

    #[test]
    fn equal_values_and_none_at_all_are_no_trouble() {
        let n = 9;
        let unit: Vec<f64> = (0..n * n)
            .map(|at| f64::from(u8::from(at / n == at % n)))
            .collect();
        assert_eq!(eigen(&unit, n, n).unwrap().0, vec![1.0; n]);
        let (values, vectors) = eigen(&[1.0, 1e-170, 1e-170, 1e-170], 2, 2).unwrap();
        assert_eq!((values[0], vectors), (1.0, vec![1.0, 0.0, 0.0, 1.0]));
        let (values, vectors) = eigen(&vec![0.0; n * n], n, 3).unwrap();
        assert_eq!(values, vec![0.0; n]);
        assert_eq!(vectors.iter().sum::<f64>(), 3.0);
        let ones = vec![1e-200; n * n];
        let (values, _) = eigen(&ones, n, 0).unwrap();
        assert!((values[0] / 1e-200 - 9.0).abs() < 1e-12);
        assert!(values[1..].iter().all(|value| value.abs() < 1e-213));
        // Of rank one; the rest is rounding.
        let rows: Vec<f64> = (0..60).map(|at| 1.0 + f64::from(at % 3)).collect();
        let low: Vec<f64> = (0..3600)
            .map(|at| rows[at / 60] * rows[at % 60] / 3.0)
            .collect();
        let (values, _) = eigen(&low, 60, 5).unwrap();
        let sum: f64 = rows.iter().map(|row| row * row / 3.0).sum();
        assert!((values[0] - sum).abs() < 1e-11);
        assert!(values[1..].iter().all(|value| value.abs() < 1e-12));
        assert_eq!(eigen(&[], 0, 4), Ok((vec![], vec![])));
    }

    #[test]
    fn what_is_no_symmetric_matrix_is_refused() {
        assert_eq!(eigen(&[1.0, 2.0], 2, 1), Err(Error::NotSquare));
        assert_eq!(eigen(&[f64::NAN], 1, 1), Err(Error::NotFinite));
    }
}
