//! Scoped threads that share out jobs, and the progress callback.
//!
//! Threads live as long as one call of [`Workers::run`]. A pool that lived longer would not
//! survive a fork: the forked child would wait for threads that do not exist in it.

use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::thread;

use crate::error::Error;
use crate::profile;
use crate::simd::Isa;

/// A callback that receives the fraction done, 0 to 1; [`ControlFlow::Break`] stops the call.
///
/// It is called on the caller's thread only, at least every tenth of a second.
pub type Progress<'a> = &'a (dyn Fn(f64) -> ControlFlow<()> + Sync);

/// The threads of a call, their instruction set, and the state of the progress callback.
pub(crate) struct Workers<'a> {
    n_threads: usize,
    progress: Option<Progress<'a>>,
    /// Bits of the fraction done.
    fraction: AtomicU64,
    is_stopped: AtomicBool,
    /// Work done so far.
    work: AtomicU64,
    /// The instruction set to use.
    pub isa: Isa,
}

impl<'a> Workers<'a> {
    /// `n_threads` threads, at least one, of which the first is the caller's.
    ///
    /// See [`affordable_threads`] for a process with little address space.
    pub fn new(n_threads: usize, isa: Isa, progress: Option<Progress<'a>>) -> Self {
        Self {
            n_threads: n_threads.max(1),
            progress,
            fraction: AtomicU64::new(0),
            is_stopped: AtomicBool::new(false),
            work: AtomicU64::new(0),
            isa,
        }
    }

    /// Count of threads.
    pub fn n_threads(&self) -> usize {
        self.n_threads
    }

    /// Add to the work done.
    ///
    /// The unit is the time that the difference of two coordinates takes in f64 with vectors, about
    /// 0.1 to 0.3 ns. The sum does not depend on the threads, except after a search that ended early.
    pub fn add_work(&self, work: u64) {
        self.work.fetch_add(work, Relaxed);
    }

    /// The work done so far.
    pub fn work(&self) -> f64 {
        self.work.load(Relaxed) as f64
    }

    /// Set the fraction done, for the next call of the callback.
    pub fn set_fraction(&self, fraction: f64) {
        self.fraction.store(fraction.to_bits(), Relaxed);
    }

    /// Call the progress callback. Only the caller's thread may do so.
    ///
    /// # Errors
    ///
    /// [`Error::Stopped`] if the callback requests a stop, or has done so before.
    pub fn check_progress(&self) -> Result<(), Error> {
        let fraction = f64::from_bits(self.fraction.load(Relaxed));
        if self
            .progress
            .is_some_and(|progress| progress(fraction).is_break())
        {
            self.is_stopped.store(true, Relaxed);
        }
        if self.is_stopped.load(Relaxed) { Err(Error::Stopped) } else { Ok(()) }
    }

    /// Run every job on whichever thread is free; return the state of every thread.
    ///
    /// `init` makes the state of a thread, which `work` updates. A job must not write what
    /// another one accesses, or must write it so that the order of jobs does not matter: results
    /// may not depend on the assignment of jobs to threads. A job should take between 10 µs and
    /// 0.1 s, because the progress callback is called between jobs. A panic in a job is passed on.
    ///
    /// # Errors
    ///
    /// [`Error::Stopped`] if the progress callback requests a stop.
    pub fn run<Job: Send, State: Send>(
        &self,
        jobs: impl ExactSizeIterator<Item = Job> + Send,
        init: impl Fn() -> State + Sync,
        work: impl Fn(&mut State, Job) + Sync,
    ) -> Result<Vec<State>, Error> {
        let n_helpers = self.n_threads.min(jobs.len()).saturating_sub(1);
        let jobs = Mutex::new(jobs);
        // The lock is poisoned only if the iterator panics; that panic is passed on below.
        let next_job = || jobs.lock().ok().and_then(|mut jobs| jobs.next());
        let help = || {
            let mut state = init();
            while !self.is_stopped.load(Relaxed) {
                let Some(job) = next_job() else { break };
                work(&mut state, job);
            }
            state
        };
        thread::scope(|scope| {
            // If the system has no memory for a thread, the others do its jobs.
            let spawn = |_| thread::Builder::new().spawn_scoped(scope, help).ok();
            let helpers: Vec<_> = (0..n_helpers).map_while(spawn).collect();
            let mut state = init();
            while self.check_progress().is_ok() {
                let Some(job) = next_job() else { break };
                profile::measure_job(|| work(&mut state, job));
            }
            profile::end_run();
            let mut states = vec![state];
            for helper in helpers {
                match helper.join() {
                    Ok(state) => states.push(state),
                    Err(panic) => std::panic::resume_unwind(panic),
                }
            }
            if self.is_stopped.load(Relaxed) { Err(Error::Stopped) } else { Ok(states) }
        })
    }
}

/// Address space of a thread: its stack, and what allocators such as glibc's reserve for it.
const THREAD_BYTES: usize = 72 << 20;

/// The largest count of threads, at most `n_threads`, for which the system has address space
/// besides `bytes` bytes.
///
/// An allocation that is refused in a thread would abort the process. Only processes whose address
/// space is limited get fewer threads.
pub(crate) fn affordable_threads(n_threads: usize, bytes: usize) -> usize {
    let mut n_helpers = n_threads.saturating_sub(1);
    while n_helpers > 0 {
        let more = n_helpers.saturating_mul(THREAD_BYTES);
        if check_available(bytes.saturating_add(more)).is_ok() {
            break;
        }
        n_helpers /= 2;
    }
    n_helpers + 1
}

/// A vector of `len` equal values.
///
/// # Errors
///
/// [`Error::OutOfMemory`] if the system refuses the memory.
pub(crate) fn allocate<T: Copy>(value: T, len: usize) -> Result<Vec<T>, Error> {
    let mut vector = Vec::new();
    vector
        .try_reserve_exact(len)
        .map_err(|_| Error::OutOfMemory { bytes: len.saturating_mul(size_of::<T>()) })?;
    vector.resize(len, value);
    Ok(vector)
}

/// Check that the system has `bytes` bytes of memory, by requesting and releasing them.
///
/// # Errors
///
/// [`Error::OutOfMemory`] if the system refuses the memory.
pub(crate) fn check_available(bytes: usize) -> Result<(), Error> {
    Vec::<u8>::new()
        .try_reserve_exact(bytes)
        .map_err(|_| Error::OutOfMemory { bytes })
}
