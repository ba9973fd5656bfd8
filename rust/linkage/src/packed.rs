//! Members of clusters as f32 offsets from the centre, sixteen side by side.

use crate::clusters::{Clusters, SORTED_SIZE, clusters_per_job};
use crate::error::Error;
use crate::parallel::Workers;
use crate::points::{Points, squared_distance};
use crate::simd::{Aligned, F32Lanes, LANES};
use mograft_machine::memory::with_capacity;

/// Smallest cluster that is packed; the members of smaller ones are read from the points.
pub(crate) const MIN_PACKED_SIZE: usize = 4;

/// The packed members of all clusters.
pub(crate) struct PackedMembers {
    dim: usize,
    /// Blocks of sixteen members, `dim` elements each. The first member of a cluster fills the
    /// unused lanes of its last block.
    lanes: Vec<F32Lanes>,
    /// For each cluster, the index of its first element of `lanes`; then the total.
    starts: Vec<usize>,
    /// For each block of a cluster of [`SORTED_SIZE`] or more, the distance of its farthest member
    /// from the centre.
    block_radii: Vec<f64>,
}

impl PackedMembers {
    /// Pack the members of all clusters. Takes O(n) time and memory for n points.
    ///
    /// # Errors
    ///
    /// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
    pub fn new(workers: &Workers<'_>, points: &Points, clusters: &Clusters) -> Result<Self, Error> {
        let (dim, m) = (points.dim, clusters.len());
        let mut starts = with_capacity(m + 1)?;
        starts.push(0);
        for cluster in 0..m {
            workers.check_item(cluster)?;
            let size = clusters.members(cluster).len();
            let n_blocks = if size < MIN_PACKED_SIZE { 0 } else { size.div_ceil(LANES) };
            starts.push(starts[cluster] + n_blocks * dim);
        }
        let mut lanes = workers.allocate(Aligned([0.0; LANES]), starts[m])?;
        let mut block_radii = workers.allocate(0.0, starts[m] / dim)?;
        let mut rest = (lanes.as_mut_slice(), block_radii.as_mut_slice());
        let width = clusters_per_job(m);
        let mut jobs = with_capacity(m.div_ceil(width))?;
        for first in (0..m).step_by(width) {
            let end = (first + width).min(m);
            let length = starts[end] - starts[first];
            let (blocks, later_blocks) = rest.0.split_at_mut(length);
            let (radii, later_radii) = rest.1.split_at_mut(length / dim);
            rest = (later_blocks, later_radii);
            jobs.push((first..end, blocks, radii));
        }
        workers.run(
            jobs.into_iter(),
            || (),
            |(), (range, blocks, radii)| {
                let first = starts[range.start];
                for cluster in range {
                    let span = starts[cluster] - first..starts[cluster + 1] - first;
                    let (members, centre) = (clusters.members(cluster), clusters.centre(cluster));
                    pack(points, members, centre, &mut blocks[span.clone()]);
                    if members.len() >= SORTED_SIZE {
                        let radii = &mut radii[span.start / dim..span.end / dim];
                        // The first member of a block is its farthest.
                        for (radius, &member) in radii.iter_mut().zip(members.iter().step_by(LANES))
                        {
                            *radius = squared_distance(points.row(member), centre).sqrt();
                        }
                    }
                }
            },
        )?;
        Ok(Self { dim, lanes, starts, block_radii })
    }

    /// Whether a cluster has at least [`MIN_PACKED_SIZE`] members.
    pub fn contains(&self, cluster: usize) -> bool {
        self.starts[cluster + 1] > self.starts[cluster]
    }

    /// The blocks of a cluster, `dim` elements each.
    pub fn blocks(&self, cluster: usize) -> &[F32Lanes] {
        &self.lanes[self.starts[cluster]..self.starts[cluster + 1]]
    }

    /// For each block of a cluster, the distance of its farthest member from the centre.
    ///
    /// Zeros unless the cluster has at least [`SORTED_SIZE`] members.
    pub fn block_radii(&self, cluster: usize) -> &[f64] {
        &self.block_radii[self.starts[cluster] / self.dim..self.starts[cluster + 1] / self.dim]
    }

    /// Offset of member `i` of a cluster from its centre.
    pub fn offset(&self, cluster: usize, i: usize) -> impl Iterator<Item = f32> {
        let first = self.starts[cluster] + i / LANES * self.dim;
        self.lanes[first..first + self.dim]
            .iter()
            .map(move |lanes| lanes[i % LANES])
    }

    /// Append member `i` of a cluster to `blocks`, which hold `count` members.
    pub fn append(&self, cluster: usize, i: usize, count: usize, blocks: &mut Vec<F32Lanes>) {
        let first = count / LANES * self.dim;
        if count.is_multiple_of(LANES) {
            // The first member of a block fills its unused lanes.
            blocks.extend(self.offset(cluster, i).map(|x| Aligned([x; LANES])));
        }
        for (lanes, x) in blocks[first..].iter_mut().zip(self.offset(cluster, i)) {
            lanes[count % LANES] = x;
        }
    }
}

/// Write offsets of points from `origin` to `out`, sixteen side by side.
fn pack(points: &Points, members: &[u32], origin: &[f64], out: &mut [F32Lanes]) {
    for (block, chunk) in out.chunks_exact_mut(points.dim).zip(members.chunks(LANES)) {
        for lane in 0..LANES {
            let row = points.row(*chunk.get(lane).unwrap_or(&members[0]));
            for (lanes, (x, y)) in block.iter_mut().zip(row.iter().zip(origin)) {
                lanes[lane] = (x - y) as f32;
            }
        }
    }
}
