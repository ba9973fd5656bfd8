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

use std::sync::Mutex;

use crate::error::Error;
use crate::neighbours::Edge;
use crate::parallel::Workers;

/// Marks a missing cluster.
const NONE: u32 = u32::MAX;

/// Clusters for which one job selects the nearest neighbour.
const CLUSTERS_PER_JOB: usize = 256;

/// Edges that one job reads while lists are built, as far as there are threads for all of them.
const EDGES_PER_JOB: usize = 1 << 22;

/// An entry of a cluster's list of neighbours.
#[derive(Clone, Copy)]
struct Neighbour {
    /// The neighbour, or a cluster that was merged into it.
    cluster: u32,
    /// Count of pairs of parts within the limit that this entry stands for.
    n_pairs: u32,
    /// The largest of their squared distances.
    squared: f64,
}

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
/// [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn merge_on_graph(
    workers: &Workers<'_>,
    representatives: &[u32],
    edges: Vec<Vec<Edge>>,
) -> Result<MergedClusters, Error> {
    let m = representatives.len();
    let mut state = State::new(adjacency_lists(workers, m, &edges)?);
    drop(edges);
    // The buffers of threads, from round to round.
    let mut buffers = Mutex::new(Vec::new());
    let mut selections: Vec<Selection> = (0..m as u32)
        .zip(&mut state.lists)
        .filter(|(_, list)| !list.is_empty())
        .map(|(cluster, list)| Selection::new(cluster, std::mem::take(list)))
        .collect();
    // Clusters that may still merge.
    let mut active: Vec<u32> = selections
        .iter()
        .map(|selection| selection.cluster)
        .collect();
    let mut pairs = Vec::new();
    while !selections.is_empty() {
        let take_buffers = || {
            let buffers = buffers.lock().ok().and_then(|mut buffers| buffers.pop());
            buffers.unwrap_or_else(|| (vec![NONE; m], Vec::new()))
        };
        let used = workers.run(
            selections.chunks_mut(CLUSTERS_PER_JOB),
            take_buffers,
            |(positions, buffer), chunk| {
                for selection in chunk {
                    selection.select_nearest(representatives, &state, positions, buffer);
                }
            },
        )?;
        buffers = Mutex::new(used);
        for selection in &mut selections {
            state.nearest[selection.cluster as usize] = selection.nearest;
            state.lists[selection.cluster as usize] = std::mem::take(&mut selection.list);
        }
        let merged = reciprocal_pairs(representatives, &state.nearest, &selections);
        state.apply(&merged);
        let State { parents, nearest, .. } = &state;
        active.retain(|&i| parents[i as usize] == i && nearest[i as usize].0 != NONE);
        state.next_selections(&active, &merged, &mut selections);
        pairs.extend(merged);
    }
    let roots = (0..m as u32).map(|i| state.root(i)).collect();
    Ok(MergedClusters { pairs, roots })
}

/// Pairs of clusters that are each other's nearest: the smaller representative first, sorted.
fn reciprocal_pairs(
    representatives: &[u32],
    nearest: &[(u32, f64)],
    selections: &[Selection],
) -> Vec<(u32, u32, f64)> {
    let mut pairs = Vec::new();
    for selection in selections {
        let (cluster, (other, squared)) = (selection.cluster, selection.nearest);
        if other != NONE && nearest[other as usize].0 == cluster {
            let is_ordered = representatives[cluster as usize] < representatives[other as usize];
            let (low, high) = if is_ordered { (cluster, other) } else { (other, cluster) };
            pairs.push((low, high, squared));
        }
    }
    // If both clusters selected in this round, the pair was found twice.
    pairs.sort_unstable_by_key(|&(low, high, _)| (low, high));
    pairs.dedup_by_key(|&mut (low, high, _)| (low, high));
    pairs
}

/// The state of all clusters between rounds.
struct State {
    lists: Vec<Vec<Neighbour>>,
    /// For each cluster, the one that it was merged into; see [`Self::root`].
    parents: Vec<u32>,
    /// For each cluster, the number of initial clusters that it consists of, itself included.
    sizes: Vec<u32>,
    /// The nearest neighbour of each cluster and its squared distance.
    nearest: Vec<(u32, f64)>,
    /// Which clusters have merged in this round.
    has_merged: Vec<bool>,
}

impl State {
    fn new(lists: Vec<Vec<Neighbour>>) -> Self {
        let m = lists.len();
        Self {
            lists,
            parents: (0..m as u32).collect(),
            sizes: vec![1; m],
            nearest: vec![(NONE, f64::INFINITY); m],
            has_merged: vec![false; m],
        }
    }

    /// The remaining cluster that contains a cluster.
    fn root(&self, mut cluster: u32) -> u32 {
        // Lists are updated often; a cluster in them is few merges away from its root.
        while self.parents[cluster as usize] != cluster {
            cluster = self.parents[cluster as usize];
        }
        cluster
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
    fn next_selections(
        &mut self,
        active: &[u32],
        merged: &[(u32, u32, f64)],
        selections: &mut Vec<Selection>,
    ) {
        selections.clear();
        for &cluster in active {
            let nearest = self.nearest[cluster as usize].0;
            if self.has_merged[cluster as usize] || self.has_merged[nearest as usize] {
                let list = std::mem::take(&mut self.lists[cluster as usize]);
                selections.push(Selection::new(cluster, list));
            }
        }
        for &(low, high, _) in merged {
            self.has_merged[low as usize] = false;
            self.has_merged[high as usize] = false;
            let list = std::mem::take(&mut self.lists[high as usize]);
            let position = selections.binary_search_by_key(&low, |selection| selection.cluster);
            if let Ok(position) = position {
                selections[position].merged_list = list;
            }
        }
    }
}

/// A cluster that must select its nearest neighbour.
struct Selection {
    cluster: u32,
    list: Vec<Neighbour>,
    /// The list of the cluster that was merged into it in the last round.
    merged_list: Vec<Neighbour>,
    nearest: (u32, f64),
}

impl Selection {
    fn new(cluster: u32, list: Vec<Neighbour>) -> Self {
        Self { cluster, list, merged_list: Vec::new(), nearest: (NONE, f64::INFINITY) }
    }

    /// Combine the lists and find the nearest neighbour.
    ///
    /// `positions` holds [`NONE`] for every cluster, before and after the call.
    fn select_nearest(
        &mut self,
        representatives: &[u32],
        state: &State,
        positions: &mut [u32],
        buffer: &mut Vec<Neighbour>,
    ) {
        buffer.clear();
        for neighbour in self.list.iter().chain(&self.merged_list) {
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
        self.list.clear();
        self.merged_list = Vec::new();
        let size = u64::from(state.sizes[self.cluster as usize]);
        let mut best = (f64::INFINITY, NONE);
        for neighbour in &*buffer {
            positions[neighbour.cluster as usize] = NONE;
            let other_size = u64::from(state.sizes[neighbour.cluster as usize]);
            if u64::from(neighbour.n_pairs) == size * other_size {
                self.list.push(*neighbour);
                let key = (neighbour.squared, representatives[neighbour.cluster as usize]);
                if key < best {
                    best = key;
                    self.nearest = (neighbour.cluster, neighbour.squared);
                }
            }
        }
    }
}

/// The list of neighbours of each of `m` clusters.
///
/// Every job reads all edges, for some of the clusters.
fn adjacency_lists(
    workers: &Workers<'_>,
    m: usize,
    edges: &[Vec<Edge>],
) -> Result<Vec<Vec<Neighbour>>, Error> {
    let n_edges: usize = edges.iter().map(Vec::len).sum();
    let n_jobs = workers.n_threads().max(n_edges / EDGES_PER_JOB).max(1);
    let width = m.div_ceil(n_jobs).max(1);
    let mut lists = vec![Vec::new(); m];
    workers.run(
        lists.chunks_mut(width).enumerate(),
        || (),
        |(), (job, lists)| {
            let position = |cluster: u32| (cluster as usize).wrapping_sub(job * width);
            let mut degrees = vec![0; lists.len()];
            for edge in edges.iter().flatten() {
                for cluster in [edge.a, edge.b] {
                    if let Some(degree) = degrees.get_mut(position(cluster)) {
                        *degree += 1;
                    }
                }
            }
            for (list, degree) in lists.iter_mut().zip(degrees) {
                *list = Vec::with_capacity(degree);
            }
            for &Edge { a, b, squared } in edges.iter().flatten() {
                for (cluster, other) in [(a, b), (b, a)] {
                    if let Some(list) = lists.get_mut(position(cluster)) {
                        list.push(Neighbour { cluster: other, n_pairs: 1, squared });
                    }
                }
            }
        },
    )?;
    Ok(lists)
}
