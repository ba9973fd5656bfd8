//! The cheapest candidates at every position.

use crate::Error;

/// Indices, ascending, of the `limit` cheapest candidates of every position, and their numbers.
///
/// `counts` has the numbers of candidates at every position; `costs` and `is_first` are those of
/// all candidates, position after position. Candidates that are first come before all others, and
/// NaN after all others; ties go to the lowest index. Takes time in proportion to the number of
/// candidates.
///
/// # Errors
///
/// If the lengths do not match, or memory is exhausted.
pub fn keep_cheapest(
    counts: &[usize],
    costs: &[f64],
    is_first: &[bool],
    limit: usize,
) -> Result<(Vec<usize>, Vec<usize>), Error> {
    let n = counts
        .iter()
        .fold(0, |sum: usize, n| sum.saturating_add(*n));
    if costs.len() != n || is_first.len() != n {
        return Err(Error::CandidateMismatch);
    }
    let n_kept = counts.iter().map(|&count| count.min(limit));
    let (mut kept, mut kept_counts, mut ranks) = (Vec::new(), Vec::new(), Vec::new());
    kept_counts.try_reserve_exact(counts.len())?;
    kept_counts.extend(n_kept);
    kept.try_reserve_exact(kept_counts.iter().sum())?;
    ranks.try_reserve_exact(counts.iter().copied().max().unwrap_or(0))?;
    let mut start = 0;
    for (&count, &n_kept) in counts.iter().zip(&kept_counts) {
        let own = start..start + count;
        start = own.end;
        if n_kept == count {
            kept.extend(own);
        } else if let Some(last) = n_kept.checked_sub(1) {
            ranks.clear();
            ranks.extend(own.clone().map(|i| (rank(costs[i], is_first[i]), i)));
            let (_, &mut last, _) = ranks.select_nth_unstable(last);
            kept.extend(own.filter(|&i| (rank(costs[i], is_first[i]), i) <= last));
        }
    }
    Ok((kept, kept_counts))
}

/// A number that orders candidates as their costs do, because whole numbers are compared faster.
fn rank(cost: f64, is_first: bool) -> u64 {
    const SIGN: u64 = 1 << 63;
    let bits = (cost + 0.0).to_bits(); // without the sign of -0
    match (is_first, cost.is_nan()) {
        (true, _) => 0,
        (_, true) => u64::MAX,
        _ if bits & SIGN == 0 => bits | SIGN,
        _ => !bits,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition: sort by (is not first, cost, index), with NaN last.
    fn by_sorting(costs: &[f64], is_first: &[bool], limit: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..costs.len()).collect();
        let compare = |a: f64, b: f64| match (a.is_nan(), b.is_nan()) {
            (false, false) => a.partial_cmp(&b).unwrap(),
            (a, b) => a.cmp(&b),
        };
        order.sort_by(|&i, &k| {
            let by_cost =
                if is_first[i] { std::cmp::Ordering::Equal } else { compare(costs[i], costs[k]) };
            is_first[k].cmp(&is_first[i]).then(by_cost)
        });
        order.truncate(limit);
        order.sort_unstable();
        order
    }

    #[test]
    fn keep_cheapest_equals_sorting() {
        let values =
            [0.0, -0.0, 1.0, f64::INFINITY, -1.5, f64::NAN, f64::NEG_INFINITY, 1e-300, 1.0, -1e9];
        let counts = [0, 1, 7, 40, 3, 0, 100];
        let n = counts.iter().sum::<usize>();
        for seed in 0..20 {
            let costs: Vec<f64> = (0..n).map(|i| values[(i * i + seed * i) % 10]).collect();
            let is_first: Vec<bool> = (0..n).map(|i| (i * 7 + seed) % 11 == 0).collect();
            for limit in [0, 1, 3, 30, 1000] {
                let (kept, kept_counts) = keep_cheapest(&counts, &costs, &is_first, limit).unwrap();
                let (mut start, mut rest) = (0, &kept[..]);
                for (&count, &n_kept) in counts.iter().zip(&kept_counts) {
                    let own = start..start + count;
                    let expected = by_sorting(&costs[own.clone()], &is_first[own], limit);
                    let (found, others) = rest.split_at(n_kept);
                    let found: Vec<usize> = found.iter().map(|i| i - start).collect();
                    assert_eq!(found, expected);
                    (start, rest) = (start + count, others);
                }
                assert!(rest.is_empty());
            }
        }
    }

    #[test]
    fn keep_cheapest_refuses_lengths_that_do_not_match() {
        let refused = Err(Error::CandidateMismatch);
        assert_eq!(keep_cheapest(&[2], &[0.0], &[true; 2], 1), refused);
        assert_eq!(keep_cheapest(&[2], &[0.0; 2], &[true], 1), refused);
        assert_eq!(keep_cheapest(&[usize::MAX, 2], &[0.0], &[true], 1), refused);
    }
}
