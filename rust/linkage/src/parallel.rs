//! Jobs that threads share out, and the progress callback.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::thread::{self, ThreadId};

use crate::error::Error;
use crate::profile;
use mograft_machine::instructions::Isa;
use mograft_machine::memory::{check_available, with_capacity};
use mograft_machine::threads::{run_with_helpers, share};

/// A callback that receives the fraction done, 0 to 1; [`ControlFlow::Break`] stops the call.
///
/// It is called on the caller's thread only, at least every tenth of a second.
pub type Progress<'a> = &'a (dyn Fn(f64) -> ControlFlow<()> + Sync);

/// Items of a serial loop between two checks of the progress.
const ITEMS_PER_CHECK: usize = 1 << 13;

/// Coordinates that a serial loop handles between two checks of the progress.
const COORDINATES_PER_CHECK: usize = 1 << 17;

/// Work of a job between two checks of the progress, in the unit of [`Workers::add_work`].
pub(crate) const WORK_PER_CHECK: u64 = 1 << 22;

/// Bytes that are written for the first time between two checks of the progress.
const BYTES_PER_CHECK: usize = 1 << 22;

/// The threads of a call, their instruction set, and the state of the progress callback.
pub(crate) struct Workers<'a> {
    n_threads: usize,
    /// The caller's thread.
    caller: ThreadId,
    progress: Option<Progress<'a>>,
    /// Bits of the fraction done.
    fraction: AtomicU64,
    is_stopped: AtomicBool,
    /// Bytes that the system has refused to a job; 0 if it has not.
    refused_bytes: AtomicUsize,
    /// Work done so far.
    work: AtomicU64,
    /// Work since the last check of the progress, and the most between two checks.
    #[cfg(test)]
    unchecked_work: [AtomicU64; 2],
    /// The instruction set to use.
    pub isa: Isa,
}

impl<'a> Workers<'a> {
    /// `n_threads` threads, at least one, of which the first is this thread, the caller's.
    ///
    /// See [`affordable_threads`] for a process with little address space.
    pub fn new(n_threads: usize, isa: Isa, progress: Option<Progress<'a>>) -> Self {
        Self {
            n_threads: n_threads.max(1),
            caller: thread::current().id(),
            progress,
            fraction: AtomicU64::new(0),
            is_stopped: AtomicBool::new(false),
            refused_bytes: AtomicUsize::new(0),
            work: AtomicU64::new(0),
            #[cfg(test)]
            unchecked_work: Default::default(),
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
        self.add_estimated_work(work);
        #[cfg(test)]
        self.unchecked_work[0].fetch_add(work, Relaxed);
    }

    /// Add to the work done an estimate of work that begins now.
    pub fn add_estimated_work(&self, work: u64) {
        self.work.fetch_add(work, Relaxed);
    }

    /// The most work between two checks of the progress.
    #[cfg(test)]
    pub fn max_unchecked_work(&self) -> f64 {
        self.unchecked_work[1].load(Relaxed) as f64
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
    /// [`Error::Stopped`] if the callback requests a stop, or has done so before;
    /// [`Error::OutOfMemory`] after [`Self::ok_or_stop`] of that error.
    pub fn check_progress(&self) -> Result<(), Error> {
        #[cfg(test)]
        {
            let [unchecked, max] = &self.unchecked_work;
            max.fetch_max(unchecked.swap(0, Relaxed), Relaxed);
        }
        let fraction = f64::from_bits(self.fraction.load(Relaxed));
        if self
            .progress
            .is_some_and(|progress| progress(fraction).is_break())
        {
            self.is_stopped.store(true, Relaxed);
        }
        self.check_stopped()
    }

    /// Check the progress once in [`ITEMS_PER_CHECK`] items of a serial loop.
    ///
    /// # Errors
    ///
    /// As for [`Self::check_progress`].
    pub fn check_item(&self, item: usize) -> Result<(), Error> {
        if item.is_multiple_of(ITEMS_PER_CHECK) { self.check_progress() } else { Ok(()) }
    }

    /// Check the progress in a serial loop over rows of `dim` coordinates.
    ///
    /// # Errors
    ///
    /// As for [`Self::check_progress`].
    pub fn check_row(&self, row: usize, dim: usize) -> Result<(), Error> {
        let rows_per_check = (COORDINATES_PER_CHECK / dim.max(1)).clamp(1, ITEMS_PER_CHECK);
        if row.is_multiple_of(rows_per_check) { self.check_progress() } else { Ok(()) }
    }

    /// Whether a job shall go on. Once `work` is large, adds it to the work done, sets it to 0 and
    /// checks the progress.
    ///
    /// For jobs that may take longer than [`Self::run`] allows. A job that ends early must not
    /// matter: [`Self::run`] then returns an error.
    pub fn can_continue(&self, work: &mut u64) -> bool {
        if *work >= WORK_PER_CHECK {
            self.add_work(std::mem::take(work));
            if thread::current().id() == self.caller {
                return self.check_progress().is_ok();
            }
        }
        !self.is_stopped.load(Relaxed)
    }

    /// A vector of `len` equal values, like [`allocate`](mograft_machine::memory::allocate).
    ///
    /// For vectors of the size of the input: the system clears their memory while it is written.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfMemory`], and those of [`Self::check_progress`].
    pub fn allocate<T: Clone>(&self, value: T, len: usize) -> Result<Vec<T>, Error> {
        let mut vector = with_capacity(len)?;
        while vector.len() < len {
            self.check_progress()?;
            let end = vector.len() + BYTES_PER_CHECK / size_of::<T>();
            vector.resize(end.min(len), value.clone());
        }
        Ok(vector)
    }

    /// A copy of values, in memory that may be as large as the input.
    ///
    /// # Errors
    ///
    /// As for [`Self::allocate`].
    pub fn copy<T: Copy>(&self, values: &[T]) -> Result<Vec<T>, Error> {
        let mut vector = with_capacity(values.len())?;
        for part in values.chunks(BYTES_PER_CHECK / size_of::<T>()) {
            self.check_progress()?;
            vector.extend_from_slice(part);
        }
        Ok(vector)
    }

    /// The value, if a job got the memory for it; otherwise stop all threads.
    ///
    /// [`Self::run`] then returns the error.
    pub fn ok_or_stop<T>(&self, result: Result<T, impl Into<Error>>) -> Option<T> {
        let result = result.map_err(Into::into);
        if let Err(error) = result
            && let Error::OutOfMemory { bytes } = error
        {
            self.refused_bytes.store(bytes.max(1), Relaxed);
        }
        if result.is_err() {
            self.is_stopped.store(true, Relaxed);
        }
        result.ok()
    }

    /// The error, if the threads shall stop.
    fn check_stopped(&self) -> Result<(), Error> {
        if !self.is_stopped.load(Relaxed) {
            return Ok(());
        }
        match self.refused_bytes.load(Relaxed) {
            0 => Err(Error::Stopped),
            bytes => Err(Error::OutOfMemory { bytes }),
        }
    }

    /// Run every job on whichever thread is free; return the state of every thread.
    ///
    /// `init` makes the state of a thread, which `work` updates. A job must not write what
    /// another one accesses, or must write it so that the order of jobs does not matter: results
    /// may not depend on the assignment of jobs to threads. A job should take between 10 µs and
    /// 0.01 s, because the progress callback is called between jobs; longer ones call
    /// [`Self::can_continue`]. A panic in a job is passed on.
    ///
    /// # Errors
    ///
    /// [`Error::Stopped`] if the progress callback requests a stop, and [`Error::OutOfMemory`] if
    /// a job has used [`Self::ok_or_stop`] with that error.
    pub fn run<Job: Send, State: Send>(
        &self,
        jobs: impl ExactSizeIterator<Item = Job> + Send,
        init: impl Fn() -> State + Sync,
        work: impl Fn(&mut State, Job) + Sync,
    ) -> Result<Vec<State>, Error> {
        let n_helpers = self.n_threads.min(jobs.len()).saturating_sub(1);
        let next_job = share(jobs);
        let help = || {
            let mut state = init();
            while !self.is_stopped.load(Relaxed) {
                let Some(job) = next_job() else { break };
                work(&mut state, job);
            }
            state
        };
        let own = || {
            let mut state = init();
            while self.check_progress().is_ok() {
                let Some(job) = next_job() else { break };
                profile::measure_job(|| work(&mut state, job));
            }
            profile::end_run();
            state
        };
        let states = run_with_helpers(n_helpers, help, own);
        self.check_stopped().map(|()| states)
    }
}

/// Address space of a thread: its stack, and what allocators such as glibc's reserve for it.
const THREAD_BYTES: usize = 72 << 20;

/// The largest count of threads, at most `n_threads`, for which the system has address space
/// besides `bytes` bytes.
///
/// An allocation that is refused in a thread ends the call with an error. Only processes whose
/// address space is limited get fewer threads.
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
