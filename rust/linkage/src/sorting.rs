//! Sorting of many keys on several threads, in pieces between which the progress is checked.

use crate::error::Error;
use crate::parallel::Workers;

/// Largest part that one job sorts.
const MAX_PART: usize = 1 << 15;

/// Sort keys of which no two are equal. Takes O(n log n) time for n keys.
///
/// # Errors
///
/// [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn sort<T: Ord + Send>(workers: &Workers<'_>, keys: &mut [T]) -> Result<(), Error> {
    let mut parts = vec![keys];
    // In each step all parts are halved: the keys of the first half are smaller.
    while parts.iter().any(|part| part.len() > MAX_PART) {
        workers.run(
            parts.iter_mut(),
            || (),
            |(), part| {
                part.select_nth_unstable(part.len() / 2);
            },
        )?;
        parts = parts
            .into_iter()
            .flat_map(|part| {
                let (low, high) = part.split_at_mut(part.len() / 2);
                [low, high]
            })
            .collect();
    }
    workers.run(parts.into_iter(), || (), |(), part| part.sort_unstable())?;
    Ok(())
}

/// Work of moving a key to its half, in the unit of [`Workers::add_work`].
const KEY_WORK: u64 = 64;

/// Sort keys of which no two are equal, in a job that others need not share.
///
/// The keys are left in any order if the progress callback requests a stop.
pub(crate) fn sort_in_job<T: Ord>(workers: &Workers<'_>, keys: &mut [T], work: &mut u64) {
    if keys.len() <= MAX_PART {
        keys.sort_unstable();
        return;
    }
    let middle = keys.len() / 2;
    keys.select_nth_unstable(middle);
    *work += keys.len() as u64 * KEY_WORK;
    if workers.can_continue(work) {
        let (low, high) = keys.split_at_mut(middle);
        sort_in_job(workers, low, work);
        sort_in_job(workers, high, work);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mograft_machine::instructions::Isa;

    #[test]
    fn sort_any_order_gives_ascending_keys() {
        let n = 5 * MAX_PART as u64 + 17;
        for multiplier in [1, n - 1, 7_919] {
            for n_threads in [1, 3] {
                // The multipliers and n have no common divisor, so that no two keys are equal.
                let mut keys: Vec<u64> = (0..n).map(|i| i * multiplier % n).collect();
                sort(&Workers::new(n_threads, Isa::best(), None), &mut keys).unwrap();
                assert!(keys.into_iter().eq(0..n));
                let mut keys: Vec<u64> = (0..n).map(|i| i * multiplier % n).collect();
                sort_in_job(&Workers::new(1, Isa::best(), None), &mut keys, &mut 0);
                assert!(keys.into_iter().eq(0..n));
            }
        }
        sort::<u64>(&Workers::new(2, Isa::best(), None), &mut []).unwrap();
    }
}
