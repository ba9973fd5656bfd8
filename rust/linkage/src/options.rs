//! What a caller chooses: resources, progress and tuning. None of it changes a result.

use crate::parallel::Progress;
use mograft_machine::instructions::Level;

/// Resources and progress of a call. Results are the same for all values.
///
/// ```
/// use mograft_linkage::Options;
///
/// let options = Options { threads: 4, ..Options::default() };
/// ```
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// Count of threads; 0 counts as 1.
    pub threads: usize,
    /// Largest size of a matrix of all n² distances, in bytes; 0 for none.
    ///
    /// Such a matrix is computed for few points, and if the bounds exclude so few pairs that it
    /// takes less time. Other memory is proportional to n.
    pub max_matrix_bytes: usize,
    /// Memory that a call may use beyond its input; it returns an error if it needs more.
    ///
    /// The need is estimated from the count of points before the computation.
    pub max_bytes: usize,
    /// Called between pieces of work, at least every tenth of a second.
    pub progress: Option<Progress<'a>>,
    /// Parameters that tests vary.
    pub tuning: Tuning,
}

impl Default for Options<'_> {
    /// One thread, a matrix of at most half of the available memory, no limit, no callback.
    fn default() -> Self {
        Self {
            threads: 1,
            max_matrix_bytes: available_memory() / 2,
            max_bytes: usize::MAX,
            progress: None,
            tuning: Tuning::default(),
        }
    }
}

/// Memory assumed to be available if the system does not tell.
const ASSUMED_MEMORY: usize = 4 << 30;

/// Bytes of memory that processes can still use without swapping: on Linux, what the kernel
/// estimates, at most the limit of the control group. 4 GiB on other systems.
pub fn available_memory() -> usize {
    let read = |path| std::fs::read_to_string(path).ok();
    let limit = read("/sys/fs/cgroup/memory.max").and_then(|text| text.trim().parse().ok());
    let available = read("/proc/meminfo").and_then(|text| {
        let line = text
            .lines()
            .find_map(|line| line.strip_prefix("MemAvailable:"))?;
        let kilobytes: usize = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
        Some(kilobytes << 10)
    });
    available
        .unwrap_or(ASSUMED_MEMORY)
        .min(limit.unwrap_or(usize::MAX))
}

/// Parameters that change the running time only.
#[derive(Clone, Copy, Debug)]
pub struct Tuning {
    /// Widest instruction set to use.
    pub level: Level,
    /// Mean count of neighbours per cluster that a stage searches for.
    pub degree: f64,
    /// Largest count of points that is merged on a full matrix without any stage.
    pub matrix_size: usize,
    /// Largest count of clusters that is merged on a full matrix after some stages.
    pub dense_size: usize,
    /// Smallest count of clusters of which the densest are merged first if density is uneven.
    pub split_size: usize,
    /// Edges that a stage may find in addition to a multiple of those expected.
    pub spare_edges: usize,
    /// Work on stages, as a fraction of that on a full matrix, after which the matrix is used.
    pub matrix_work: f64,
}

impl Default for Tuning {
    fn default() -> Self {
        Self {
            level: Level::Avx512,
            degree: 7.0,
            matrix_size: 1448,
            dense_size: 128,
            split_size: 1 << 13,
            spare_edges: 1 << 20,
            matrix_work: 0.4,
        }
    }
}
