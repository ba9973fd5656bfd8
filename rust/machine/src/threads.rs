//! Threads that live as long as one call.
//!
//! A pool that lived longer would not survive a fork: the forked child would wait for threads that
//! do not exist in it.

use std::sync::Mutex;
use std::thread;

/// Run `own` on this thread and `help` on `n_helpers` others; return their results, `own`'s first.
///
/// If the system has no memory for a thread, there are fewer. A panic in a thread is passed on.
pub fn run_with_helpers<T: Send>(
    n_helpers: usize,
    help: impl Fn() -> T + Sync,
    own: impl FnOnce() -> T,
) -> Vec<T> {
    thread::scope(|scope| {
        let spawn = |_| thread::Builder::new().spawn_scoped(scope, &help).ok();
        let helpers: Vec<_> = (0..n_helpers).map_while(spawn).collect();
        let mut results = vec![own()];
        for helper in helpers {
            match helper.join() {
                Ok(result) => results.push(result),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
        results
    })
}

/// A function that returns the next job; several threads may call it.
pub fn share<T>(jobs: impl Iterator<Item = T> + Send) -> impl Fn() -> Option<T> + Sync {
    let jobs = Mutex::new(jobs);
    // The lock is poisoned only if the iterator panics.
    move || jobs.lock().ok().and_then(|mut jobs| jobs.next())
}

/// Call `work` with every part, on as many threads as there are parts.
pub fn for_each_part<T: Send>(
    parts: impl ExactSizeIterator<Item = T> + Send,
    work: impl Fn(T) + Sync,
) {
    let n_helpers = parts.len().saturating_sub(1);
    let next_part = share(parts);
    let help = || {
        while let Some(part) = next_part() {
            work(part);
        }
    };
    run_with_helpers(n_helpers, help, help);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_is_worked_on_once() {
        for n_parts in [0, 1, 5] {
            let mut numbers = vec![0; n_parts];
            for_each_part(numbers.iter_mut(), |number| *number += 1);
            assert_eq!(numbers, vec![1; n_parts]);
        }
    }

    #[test]
    #[should_panic(expected = "a job")]
    fn panics_of_helpers_are_passed_on() {
        run_with_helpers(1, || panic!("a job"), || ());
    }
}
