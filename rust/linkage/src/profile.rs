//! How much of a call several threads could share, and what it counts, for the example `scaling`.
//!
//! With the feature `profile`, calls on one thread measure the processor time of each job. The jobs
//! of each run are then assigned to simulated threads, every job to the first thread that is free.
//! Without the feature nothing is measured.

use std::cell::RefCell;
use std::collections::BTreeMap;

/// Count of simulated threads.
pub const N_SIMULATED: usize = 16;

/// Processor time of one phase of a call on one thread, in seconds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Phase {
    /// Outside of jobs, on the caller's thread.
    pub serial: f64,
    /// In jobs.
    pub parallel: f64,
    /// In the jobs of the busiest simulated thread, summed over all runs of jobs.
    pub busiest: f64,
}

#[derive(Default)]
struct State {
    phases: BTreeMap<&'static str, Phase>,
    counts: BTreeMap<&'static str, u64>,
    current: &'static str,
    /// When the current phase began.
    since: f64,
    /// Time in jobs since then.
    in_jobs: f64,
    /// Times of the jobs of the current run.
    jobs: Vec<f64>,
}

thread_local! {
    static STATE: RefCell<State> = RefCell::default();
}

/// Processor time of this thread in seconds; 0 if the system does not tell.
fn processor_time() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text.split_whitespace().next();
    nanoseconds.map_or(0.0, |field| field.parse().unwrap_or(0.0) * 1e-9)
}

/// End the current phase of this thread's call and begin another.
pub(crate) fn begin_phase(name: &'static str) {
    if !cfg!(feature = "profile") {
        return;
    }
    let time = processor_time();
    STATE.with_borrow_mut(|state| {
        let phase = state.phases.entry(state.current).or_default();
        phase.serial += time - state.since - state.in_jobs;
        (state.current, state.since, state.in_jobs) = (name, time, 0.0);
    });
}

/// Add to a count.
pub(crate) fn count(name: &'static str, amount: usize) {
    if !cfg!(feature = "profile") {
        return;
    }
    STATE.with_borrow_mut(|state| *state.counts.entry(name).or_default() += amount as u64);
}

/// Measure a job.
pub(crate) fn measure_job(job: impl FnOnce()) {
    if !cfg!(feature = "profile") {
        return job();
    }
    let start = processor_time();
    job();
    let time = processor_time() - start;
    STATE.with_borrow_mut(|state| state.jobs.push(time));
}

/// End a run of jobs: simulate it.
pub(crate) fn end_run() {
    if !cfg!(feature = "profile") {
        return;
    }
    STATE.with_borrow_mut(|state| {
        let jobs = std::mem::take(&mut state.jobs);
        let mut loads = [0.0_f64; N_SIMULATED];
        for job in &jobs {
            if let Some(load) = loads.iter_mut().min_by(|a, b| a.total_cmp(b)) {
                *load += job;
            }
        }
        let total: f64 = jobs.iter().sum();
        state.in_jobs += total;
        let phase = state.phases.entry(state.current).or_default();
        phase.parallel += total;
        phase.busiest += loads.into_iter().fold(0.0, f64::max);
    });
}

/// The counts of the calls on this thread since the last call of this function.
pub fn take_counts() -> BTreeMap<&'static str, u64> {
    STATE.with_borrow_mut(|state| std::mem::take(&mut state.counts))
}

/// The phases of the calls on this thread since the last call of this function.
pub fn take_phases() -> BTreeMap<&'static str, Phase> {
    begin_phase("");
    let phases = STATE.with_borrow_mut(|state| std::mem::take(&mut state.phases));
    phases
        .into_iter()
        .filter(|(name, _)| !name.is_empty())
        .collect()
}
