//! What a caller chooses: resources, progress and tuning. None of it changes a result.

use crate::parallel::Progress;
use crate::simd::Level;

/// Resources and progress of a call. Results are the same for all values.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// Count of threads; 0 counts as 1.
    pub threads: usize,
    /// Largest size of a full matrix of distances, in bytes.
    pub max_matrix_bytes: usize,
    /// Called between pieces of work, at least every tenth of a second.
    pub progress: Option<Progress<'a>>,
    /// Parameters that tests vary.
    pub tuning: Tuning,
}

impl Default for Options<'_> {
    /// One thread, 16 MiB, no callback.
    fn default() -> Self {
        Self { threads: 1, max_matrix_bytes: 16 << 20, progress: None, tuning: Tuning::default() }
    }
}

/// Parameters that change the running time only.
#[derive(Clone, Copy, Debug)]
pub struct Tuning {
    /// Widest instruction set to use.
    pub level: Level,
    /// Mean count of neighbours per cluster that a stage searches for.
    pub degree: f64,
    /// Largest count of clusters that is merged on a full matrix.
    pub dense_size: usize,
    /// Edges that a stage may find in addition to a multiple of those expected.
    pub spare_edges: usize,
}

impl Default for Tuning {
    fn default() -> Self {
        Self { level: Level::Avx512, degree: 10.0, dense_size: 256, spare_edges: 1 << 20 }
    }
}
