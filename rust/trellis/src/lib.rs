//! The cheapest candidates of a trellis, and random paths through it.
//!
//! A trellis has one or more candidates at every position. A path takes one candidate per
//! position; it costs the sum of their unary costs and of the pairwise costs of neighbours.

use std::collections::TryReserveError;
use std::fmt;

mod cheapest;

pub use cheapest::keep_cheapest;

/// The costs of a trellis. Costs may be infinite.
#[derive(Clone, Copy, Debug)]
pub struct Trellis<'a> {
    /// Number of candidates at every position, each at least 1.
    pub counts: &'a [usize],
    /// Unary costs of all candidates, position after position.
    pub unary: &'a [f64],
    /// For every position but the last, a row of pairwise costs per candidate, with one cost per
    /// candidate of the next position.
    pub pairwise: &'a [f64],
}

/// Why there is no result.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error {
    /// Buffers whose lengths do not match the numbers of candidates.
    LengthMismatch,
    /// Costs or marks whose number is not that of all candidates.
    CandidateMismatch,
    /// The system has refused memory.
    OutOfMemory(TryReserveError),
}

impl std::error::Error for Error {}

impl From<TryReserveError> for Error {
    fn from(error: TryReserveError) -> Self {
        Self::OutOfMemory(error)
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LengthMismatch => {
                write!(
                    f,
                    "`unary`, `pairwise` and `draws` must match `counts`, which must be above 0"
                )
            }
            Self::CandidateMismatch => {
                write!(f, "`costs` and `is_first` must have one element per candidate")
            }
            Self::OutOfMemory(error) => error.fmt(f),
        }
    }
}

impl Trellis<'_> {
    fn check(&self) -> Result<(), Error> {
        let n_pairs = self
            .counts
            .windows(2)
            .map(|pair| pair[0].saturating_mul(pair[1]));
        let n_candidates = self
            .counts
            .iter()
            .fold(0, |sum: usize, n| sum.saturating_add(*n));
        let fits = self.unary.len() == n_candidates
            && self.pairwise.len() == n_pairs.fold(0, usize::saturating_add)
            && !self.counts.contains(&0);
        if fits { Ok(()) } else { Err(Error::LengthMismatch) }
    }
}

/// Draw a path with probability proportional to exp(-cost / temperature).
///
/// `draws` has one number of [0, 1) per position. Forward filtering, backward sampling (Carter and
/// Kohn, Biometrika 81, 1994), here with the directions exchanged, in logarithms. A candidate of
/// probability 0 is never drawn; if all have probability 0, or costs are NaN, the path is
/// arbitrary. Takes time in proportion to the number of costs.
///
/// # Errors
///
/// If the lengths do not match, a position has no candidate, or memory is exhausted.
pub fn sample(trellis: Trellis<'_>, temperature: f64, draws: &[f64]) -> Result<Vec<usize>, Error> {
    trellis.check()?;
    if draws.len() != trellis.counts.len() {
        return Err(Error::LengthMismatch);
    }
    let weights = log_weights(trellis, temperature)?;
    let (mut weights, mut pairwise) = (weights.as_slice(), trellis.pairwise);
    let (mut path, mut ends) = (Vec::<usize>::new(), Vec::new());
    path.try_reserve_exact(draws.len())?;
    ends.try_reserve_exact(trellis.counts.iter().copied().max().unwrap_or(0))?;
    for (position, (&count, draw)) in trellis.counts.iter().zip(draws).enumerate() {
        let (own, rest) = weights.split_at(count);
        weights = rest;
        ends.clear();
        ends.extend_from_slice(own);
        if let Some(&previous) = path.last() {
            let (rows, rest) = pairwise.split_at(trellis.counts[position - 1] * count);
            pairwise = rest;
            for (end, cost) in ends.iter_mut().zip(&rows[previous * count..]) {
                *end -= cost / temperature;
            }
        }
        let top = ends.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let mut sum = 0.0;
        for end in &mut ends {
            sum += (*end - top).exp();
            *end = sum;
        }
        let index = ends.partition_point(|&end| end <= draw * sum);
        path.push(index.min(count - 1));
    }
    Ok(path)
}

/// The logarithm of the summed probabilities, not normalized, of all continuations of candidates.
fn log_weights(trellis: Trellis<'_>, temperature: f64) -> Result<Vec<f64>, TryReserveError> {
    let mut weights = Vec::new();
    weights.try_reserve_exact(trellis.unary.len())?;
    weights.extend(trellis.unary.iter().map(|cost| -cost / temperature));
    let (mut earlier, mut pairwise) = (weights.as_mut_slice(), trellis.pairwise);
    let mut onward = Vec::new();
    onward.try_reserve_exact(trellis.counts.iter().copied().max().unwrap_or(0))?;
    for pair in trellis.counts.windows(2).rev() {
        let (rest, later) = earlier.split_at_mut(earlier.len() - pair[1]);
        let (before, rows) = pairwise.split_at(pairwise.len() - pair[0] * pair[1]);
        let first = rest.len() - pair[0];
        for (weight, row) in rest[first..].iter_mut().zip(rows.chunks_exact(pair[1])) {
            onward.clear();
            onward.extend(
                later
                    .iter()
                    .zip(row)
                    .map(|(weight, cost)| weight - cost / temperature),
            );
            *weight += log_sum_exp(&onward);
        }
        (earlier, pairwise) = (rest, before);
    }
    Ok(weights)
}

/// The logarithm of a sum of exponentials, without overflow; -∞ if all terms are 0.
fn log_sum_exp(logarithms: &[f64]) -> f64 {
    let top = logarithms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let top = if top.is_finite() { top } else { 0.0 };
    top + logarithms
        .iter()
        .map(|value| (value - top).exp())
        .sum::<f64>()
        .ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRELLIS: Trellis<'_> = Trellis {
        counts: &[2, 1, 2],
        unary: &[0.0, f64::INFINITY, 0.0, 1.0, 0.0],
        pairwise: &[0.0, 0.0, 0.0, 0.0],
    };

    #[test]
    fn sample_divides_draws_by_probability() {
        let share = (-1.0_f64).exp() / (1.0 + (-1.0_f64).exp());
        for (draw, last) in [(0.0, 0), (share - 1e-9, 0), (share + 1e-9, 1), (0.999, 1)] {
            let path = sample(TRELLIS, 1.0, &[0.999, 0.5, draw]).unwrap();
            assert_eq!(path, [0, 0, last]);
        }
    }

    #[test]
    fn sample_counts_continuations() {
        // The first candidate has one continuation, the second has three.
        let pairwise = [0.0, f64::INFINITY, f64::INFINITY, 0.0, 0.0, 0.0];
        let trellis = Trellis { counts: &[2, 3], unary: &[0.0; 5], pairwise: &pairwise };
        assert_eq!(sample(trellis, 1.0, &[0.249, 0.9]).unwrap(), [0, 0]);
        assert_eq!(sample(trellis, 1.0, &[0.251, 0.9]).unwrap(), [1, 2]);
    }

    #[test]
    fn sample_refuses_lengths_that_do_not_match() {
        assert_eq!(sample(TRELLIS, 1.0, &[0.0]), Err(Error::LengthMismatch));
        let trellis = Trellis { pairwise: &[], ..TRELLIS };
        assert_eq!(sample(trellis, 1.0, &[0.0; 3]), Err(Error::LengthMismatch));
        let trellis = Trellis { counts: &[2, 0], unary: &[0.0; 2], pairwise: &[] };
        assert_eq!(sample(trellis, 1.0, &[0.0; 2]), Err(Error::LengthMismatch));
    }
}
