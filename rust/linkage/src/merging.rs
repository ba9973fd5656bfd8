//! Merging on a sparse graph until no edge is left, without measuring any distance again.
//!
//! The graph holds every pair of clusters within a limit and its squared distance. In each round
//! all pairs of clusters merge that are each other's nearest. The neighbours of a union are the
//! common neighbours of its parts, at the larger of the two distances. Common neighbours are found
//! by counting: unions A and C are neighbours if each pair of their parts is an edge, |A| |C|
//! edges in all. (If a pair of parts is not an edge, it is beyond the limit, and so are A and C.)
//!
//! A cluster selects its nearest neighbour again only if it has merged, or that neighbour has. The
//! merge of two other clusters brings neither of them nearer.
//!
//! The list of a union is not longer than that of either part. Every list therefore stays in its
//! place, and one allocation holds those of all clusters.

use std::sync::Mutex;

use crate::adjacency::{Neighbour, adjacency_lists, split_lists};
use crate::error::Error;
use crate::neighbours::Edge;
use crate::parallel::Workers;
use mograft_machine::memory::{allocate, append, collect, push, reserve};

/// Marks a missing cluster.
const NONE: u32 = u32::MAX;

/// Clusters for which one job selects the nearest neighbour.
const CLUSTERS_PER_JOB: usize = 256;

/// Edges per band of clusters, as far as there are fewer than [`MAX_BANDS`] bands.
const EDGES_PER_BAND: usize = 1 << 18;

/// Largest count of bands. Each reads all edges that remain, and may need an eighth of them more.
const MAX_BANDS: usize = 8;

/// Clusters that select at a time: their lists are taken from the others.
const CLUSTERS_PER_BATCH: usize = 1 << 16;

/// The result of merging clusters up to a limit.
pub(crate) struct MergedClusters {
    /// Pairs of clusters and their squared distances; every pair stands behind those of its parts.
    pub pairs: Vec<(u32, u32, f64)>,
    /// For each cluster, the one that it was merged into; itself if it remains.
    pub roots: Vec<u32>,
}

/// Merge all clusters that the edges within a limit determine.
///
/// `representatives` are those of the clusters: of equal distances the smallest goes first. Takes
/// O(e log m) time for e edges of m clusters, unless lists stay long through many rounds, and
/// 32 bytes per edge.
///
/// # Errors
///
/// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn merge_on_graph(
    workers: &Workers<'_>,
    representatives: &[u32],
    edges: Vec<Vec<Edge>>,
) -> Result<MergedClusters, Error> {
    let m = representatives.len();
    let n_edges: usize = edges.iter().map(Vec::len).sum();
    let n_bands = (n_edges / EDGES_PER_BAND).clamp(1, MAX_BANDS);
    let mut parts = adjacency_lists(workers, m, edges, n_bands)?;
    let mut state = State::new(workers, split_lists(&mut parts)?)?;
    // Clusters that may still merge.
    let mut active: Vec<u32> = collect(0..m as u32)?;
    active.retain(|&cluster| !state.lists[cluster as usize].is_empty());
    // Clusters that select in this round, ascending, and what was merged into them.
    let mut selecting = collect(active.iter().map(|&cluster| (cluster, NONE)))?;
    let mut pairs = Vec::new();
    // The buffers of threads, from round to round.
    let mut buffers = Vec::new();
    while !selecting.is_empty() {
        for batch in selecting.chunks(CLUSTERS_PER_BATCH) {
            buffers = state.select(workers, representatives, batch, buffers)?;
        }
        let merged = reciprocal_pairs(workers, representatives, &state.nearest, &selecting)?;
        state.apply(&merged);
        workers.check_progress()?;
        let State { parents, nearest, .. } = &state;
        active.retain(|&i| parents[i as usize] == i && nearest[i as usize].0 != NONE);
        workers.check_progress()?;
        state.next_selections(workers, &active, &merged, &mut selecting)?;
        append(&mut pairs, merged.into_iter())?;
    }
    let roots = collect((0..m as u32).map(|i| state.root(i)))?;
    Ok(MergedClusters { pairs, roots })
}

/// Pairs of clusters that are each other's nearest: the smaller representative first, sorted.
fn reciprocal_pairs(
    workers: &Workers<'_>,
    representatives: &[u32],
    nearest: &[(u32, f64)],
    selecting: &[(u32, u32)],
) -> Result<Vec<(u32, u32, f64)>, Error> {
    let mut pairs = Vec::new();
    for (i, &(cluster, _)) in selecting.iter().enumerate() {
        workers.check_item(i)?;
        let (other, squared) = nearest[cluster as usize];
        if other != NONE && nearest[other as usize].0 == cluster {
            let is_ordered = representatives[cluster as usize] < representatives[other as usize];
            let (low, high) = if is_ordered { (cluster, other) } else { (other, cluster) };
            push(&mut pairs, (low, high, squared))?;
        }
    }
    // If both clusters selected in this round, the pair was found twice.
    pairs.sort_unstable_by_key(|&(low, high, _)| (low, high));
    pairs.dedup_by_key(|&mut (low, high, _)| (low, high));
    Ok(pairs)
}

/// The buffers of a thread: the position of every cluster in the list below, and that list.
type Buffers = (Vec<u32>, Vec<Neighbour>);

/// The state of all clusters between rounds.
struct State<'a> {
    lists: Vec<&'a mut [Neighbour]>,
    /// For each cluster, the one that it was merged into; see [`Self::root`].
    parents: Vec<u32>,
    /// For each cluster, the number of initial clusters that it consists of, itself included.
    sizes: Vec<u32>,
    /// The nearest neighbour of each cluster and its squared distance.
    nearest: Vec<(u32, f64)>,
    /// Which clusters have merged in this round.
    has_merged: Vec<bool>,
}

impl<'a> State<'a> {
    fn new(workers: &Workers<'_>, lists: Vec<&'a mut [Neighbour]>) -> Result<Self, Error> {
        let m = lists.len();
        Ok(Self {
            lists,
            parents: collect(0..m as u32)?,
            sizes: workers.allocate(1, m)?,
            nearest: workers.allocate((NONE, f64::INFINITY), m)?,
            has_merged: allocate(false, m)?,
        })
    }

    /// The remaining cluster that contains a cluster.
    fn root(&self, mut cluster: u32) -> u32 {
        // Lists are updated often; a cluster in them is few merges away from its root.
        while self.parents[cluster as usize] != cluster {
            cluster = self.parents[cluster as usize];
        }
        cluster
    }

    /// Select the nearest neighbours of some clusters.
    fn select(
        &mut self,
        workers: &Workers<'_>,
        representatives: &[u32],
        batch: &[(u32, u32)],
        buffers: Vec<Buffers>,
    ) -> Result<Vec<Buffers>, Error> {
        let mut selections = collect(batch.iter().map(|&(cluster, merged)| Selection {
            cluster,
            list: std::mem::take(&mut self.lists[cluster as usize]),
            merged_list:
                (self.lists.get_mut(merged as usize)).map_or_else(Default::default, std::mem::take),
            nearest: (NONE, f64::INFINITY),
        }))?;
        let m = self.lists.len();
        let buffers = Mutex::new(buffers);
        let take_buffers = || {
            let buffers = buffers.lock().ok().and_then(|mut buffers| buffers.pop());
            buffers.unwrap_or_else(|| {
                let positions = workers.ok_or_stop(allocate(NONE, m));
                (positions.unwrap_or_default(), Vec::new())
            })
        };
        let buffers = workers.run(
            selections.chunks_mut(CLUSTERS_PER_JOB),
            take_buffers,
            |(positions, buffer), chunk| {
                for selection in chunk {
                    let selected =
                        selection.select_nearest(representatives, self, positions, buffer);
                    if workers.ok_or_stop(selected).is_none() {
                        return;
                    }
                }
            },
        )?;
        for selection in selections {
            self.nearest[selection.cluster as usize] = selection.nearest;
            self.lists[selection.cluster as usize] = selection.list;
        }
        Ok(buffers)
    }

    /// Merge pairs of clusters.
    fn apply(&mut self, merged: &[(u32, u32, f64)]) {
        for &(low, high, _) in merged {
            self.parents[high as usize] = low;
            self.sizes[low as usize] += self.sizes[high as usize];
            self.has_merged[low as usize] = true;
            self.has_merged[high as usize] = true;
        }
    }

    /// The clusters that must select again: those that have merged, or whose nearest has.
    ///
    /// With each of them, the cluster that was merged into it in this round.
    fn next_selections(
        &mut self,
        workers: &Workers<'_>,
        active: &[u32],
        merged: &[(u32, u32, f64)],
        selecting: &mut Vec<(u32, u32)>,
    ) -> Result<(), Error> {
        let has_merged = |cluster: u32| self.has_merged[cluster as usize];
        let must_select =
            |&cluster: &u32| has_merged(cluster) || has_merged(self.nearest[cluster as usize].0);
        selecting.clear();
        for cluster in active.iter().copied().filter(must_select) {
            push(selecting, (cluster, NONE))?;
        }
        for (i, &(low, high, _)) in merged.iter().enumerate() {
            workers.check_item(i)?;
            self.has_merged[low as usize] = false;
            self.has_merged[high as usize] = false;
            if let Ok(position) = selecting.binary_search_by_key(&low, |&(cluster, _)| cluster) {
                selecting[position].1 = high;
            }
        }
        Ok(())
    }
}

/// A cluster that must select its nearest neighbour.
struct Selection<'a> {
    cluster: u32,
    list: &'a mut [Neighbour],
    /// The list of the cluster that was merged into it in the last round.
    merged_list: &'a [Neighbour],
    nearest: (u32, f64),
}

impl Selection<'_> {
    /// Combine the lists and find the nearest neighbour.
    ///
    /// `positions` holds [`NONE`] for every cluster, before and after the call.
    fn select_nearest(
        &mut self,
        representatives: &[u32],
        state: &State<'_>,
        positions: &mut [u32],
        buffer: &mut Vec<Neighbour>,
    ) -> Result<(), Error> {
        buffer.clear();
        reserve(buffer, self.list.len() + self.merged_list.len())?;
        for neighbour in self.list.iter().chain(self.merged_list) {
            let cluster = state.root(neighbour.cluster);
            if cluster == self.cluster {
                continue;
            }
            let position = &mut positions[cluster as usize];
            if *position == NONE {
                *position = buffer.len() as u32;
                buffer.push(Neighbour { cluster, ..*neighbour });
            } else {
                let known = &mut buffer[*position as usize];
                known.n_pairs += neighbour.n_pairs;
                known.squared = known.squared.max(neighbour.squared);
            }
        }
        let mut n_kept = 0;
        let size = u64::from(state.sizes[self.cluster as usize]);
        let mut best = (f64::INFINITY, NONE);
        for neighbour in &*buffer {
            positions[neighbour.cluster as usize] = NONE;
            let other_size = u64::from(state.sizes[neighbour.cluster as usize]);
            if u64::from(neighbour.n_pairs) == size * other_size {
                // Each stands for a pair of its own in the list.
                self.list[n_kept] = *neighbour;
                n_kept += 1;
                let key = (neighbour.squared, representatives[neighbour.cluster as usize]);
                if key < best {
                    best = key;
                    self.nearest = (neighbour.cluster, neighbour.squared);
                }
            }
        }
        self.list = &mut std::mem::take(&mut self.list)[..n_kept];
        Ok(())
    }
}
