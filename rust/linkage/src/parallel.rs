//! Work shared out among threads, and the caller's wish to stop.
//!
//! Threads live as long as one piece of work. A pool that outlived it would be lost to a
//! forked child, which waits for it for ever.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::thread;

use crate::Error;
use crate::simd::Isa;

/// Told now and then how much is done, from 0 to 1; answers whether to go on.
pub type Watch<'a> = &'a (dyn Fn(f64) -> bool + Sync);

/// Those who do the work.
pub(crate) struct Crew<'a> {
    threads: usize,
    watch: Option<Watch<'a>>,
    done: AtomicU64,
    stopped: AtomicBool,
    /// What their processor can do.
    pub isa: Isa,
}

impl<'a> Crew<'a> {
    /// At least one thread, the caller's own.
    pub fn new(threads: usize, isa: Isa, watch: Option<Watch<'a>>) -> Self {
        let (done, stopped) = (AtomicU64::new(0), AtomicBool::new(false));
        Self { threads: threads.max(1), watch, done, stopped, isa }
    }

    /// How many they are.
    pub fn threads(&self) -> usize {
        self.threads
    }

    /// Note how much of everything is done.
    pub fn report(&self, fraction: f64) {
        self.done.store(fraction.to_bits(), Relaxed);
    }

    /// Ask the caller whether to go on. Only the caller's own thread may ask.
    ///
    /// # Errors
    ///
    /// If not.
    pub fn ask(&self) -> Result<(), Error> {
        let fraction = f64::from_bits(self.done.load(Relaxed));
        if self.watch.is_some_and(|goes_on| !goes_on(fraction)) {
            self.stopped.store(true, Relaxed);
        }
        if self.stopped.load(Relaxed) { Err(Error::Stopped) } else { Ok(()) }
    }

    /// Do every job, each on whichever thread is free, and return what each thread gathered.
    ///
    /// A job must touch nothing that another one writes, or write it so that order does not
    /// matter: the outcome may not depend on who does what. Jobs should take some ten
    /// microseconds at least, and no more than a tenth of a second.
    ///
    /// # Errors
    ///
    /// If the caller wants to stop.
    pub fn each<Job: Send, Gathered: Send>(
        &self,
        jobs: impl ExactSizeIterator<Item = Job> + Send,
        gather: impl Fn() -> Gathered + Sync,
        work: impl Fn(&mut Gathered, Job) + Sync,
    ) -> Result<Vec<Gathered>, Error> {
        let helpers = self.threads.min(jobs.len()).saturating_sub(1);
        let jobs = Mutex::new(jobs);
        // A job lost to a panic elsewhere is lost with everything: the panic is passed on.
        let next = || jobs.lock().ok().and_then(|mut jobs| jobs.next());
        let help = || {
            let mut gathered = gather();
            while !self.stopped.load(Relaxed) {
                let Some(job) = next() else { break };
                work(&mut gathered, job);
            }
            gathered
        };
        thread::scope(|scope| {
            let helpers: Vec<_> = (0..helpers).map(|_| scope.spawn(help)).collect();
            let mut own = gather();
            while self.ask().is_ok() {
                let Some(job) = next() else { break };
                work(&mut own, job);
            }
            let mut all = vec![own];
            for helper in helpers {
                match helper.join() {
                    Ok(gathered) => all.push(gathered),
                    Err(panic) => std::panic::resume_unwind(panic),
                }
            }
            if self.stopped.load(Relaxed) { Err(Error::Stopped) } else { Ok(all) }
        })
    }
}
