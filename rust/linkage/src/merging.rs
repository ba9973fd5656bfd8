//! Merging on a sparse graph, to exhaustion, without measuring anything anew.
//!
//! The graph holds every pair of clusters within a limit and its squared distance. Clusters
//! that are each other's nearest merge, all such pairs in one round; the union's neighbours are
//! the common neighbours of its parts, at the larger of the two distances. Whether they are
//! common is a matter of counting: two unions are neighbours if each pair of their parts is an
//! edge, |A| |C| edges in all. (A pair of parts that is no edge is beyond the limit, and so are
//! then the unions.)
//!
//! A list of neighbours is put in order only when its owner must choose again: when it has
//! merged, or its nearest has. Another's merger takes nothing nearer to it.

use crate::Error;
use crate::graph::Edge;
use crate::parallel::Crew;

/// No cluster.
const NONE: u32 = u32::MAX;

/// Lists to be put in order together: how many one job takes.
const PER_JOB: usize = 256;

/// A neighbour.
#[derive(Clone, Copy)]
struct Neighbour {
    /// The cluster, or one that has gone into it.
    cluster: u32,
    /// Pairs of parts within the limit that are known by this entry.
    pairs: u32,
    /// The largest of their squared distances.
    squared: f64,
}

/// What merging has come to.
pub(crate) struct Merged {
    /// Pairs of clusters, and squared distances, parts before unions.
    pub pairs: Vec<(u32, u32, f64)>,
    /// The cluster that each has gone into, itself for those that are left.
    pub roots: Vec<u32>,
}

/// Merge as long as two clusters are within the limit of the graph and nearest to each other.
///
/// `reps` are the clusters' representatives: of equal distances the smallest goes first. Takes
/// O(e log m) time for e edges unless lists stay long through many rounds, and 32 bytes an edge.
pub(crate) fn merge(crew: &Crew<'_>, reps: &[u32], edges: Vec<Edge>) -> Result<Merged, Error> {
    let m = reps.len();
    let mut lists = lists_of(m, edges);
    let mut roots: Vec<u32> = (0..m as u32).collect();
    let mut sizes = vec![1_u32; m];
    let mut nearest = vec![(NONE, f64::INFINITY); m];
    let mut pairs = Vec::new();
    // Who must choose: at first all that have a neighbour.
    let mut choosing: Vec<Choice> = (0..m as u32)
        .zip(&mut lists)
        .filter(|(_, list)| !list.is_empty())
        .map(|(cluster, list)| Choice::new(cluster, std::mem::take(list)))
        .collect();
    let mut waiting: Vec<u32> = choosing.iter().map(|choice| choice.cluster).collect();
    let mut touched = vec![false; m];
    while !choosing.is_empty() {
        crew.each(
            choosing.chunks_mut(PER_JOB),
            || (vec![NONE; m], Vec::new()),
            |(places, room), choices| {
                for choice in choices {
                    choice.choose(reps, &roots, &sizes, places, room);
                }
            },
        )?;
        for choice in &mut choosing {
            nearest[choice.cluster as usize] = choice.nearest;
            lists[choice.cluster as usize] = std::mem::take(&mut choice.list);
        }

        let mut merged = Vec::new();
        for choice in &choosing {
            let (own, (other, squared)) = (choice.cluster, choice.nearest);
            if other != NONE && nearest[other as usize].0 == own {
                merged.push(if reps[own as usize] < reps[other as usize] {
                    (own, other, squared)
                } else {
                    (other, own, squared)
                });
            }
        }
        // Where both had to choose, both have found the pair.
        merged.sort_unstable_by_key(|&(low, high, _)| (low, high));
        merged.dedup_by_key(|&mut (low, high, _)| (low, high));
        for &(low, high, _) in &merged {
            roots[high as usize] = low;
            sizes[low as usize] += sizes[high as usize];
            touched[low as usize] = true;
            touched[high as usize] = true;
        }
        for i in 0..m {
            roots[i] = roots[roots[i] as usize];
        }

        waiting.retain(|&i| roots[i as usize] == i && nearest[i as usize].0 != NONE);
        choosing.clear();
        for &cluster in &waiting {
            if touched[cluster as usize] || touched[nearest[cluster as usize].0 as usize] {
                let list = std::mem::take(&mut lists[cluster as usize]);
                choosing.push(Choice::new(cluster, list));
            }
        }
        for &(low, high, _) in &merged {
            touched[low as usize] = false;
            touched[high as usize] = false;
            let more = std::mem::take(&mut lists[high as usize]);
            if let Ok(place) = choosing.binary_search_by_key(&low, |choice| choice.cluster) {
                choosing[place].more = more;
            }
        }
        pairs.extend(merged);
    }
    Ok(Merged { pairs, roots })
}

/// A cluster that is to choose its nearest neighbour.
struct Choice {
    cluster: u32,
    list: Vec<Neighbour>,
    /// The list of the cluster that it has just swallowed.
    more: Vec<Neighbour>,
    nearest: (u32, f64),
}

impl Choice {
    fn new(cluster: u32, list: Vec<Neighbour>) -> Self {
        Self { cluster, list, more: Vec::new(), nearest: (NONE, f64::INFINITY) }
    }

    /// Put the list in order and find the nearest.
    ///
    /// `places` is a table of NONE for each cluster, and is left so.
    fn choose(
        &mut self,
        reps: &[u32],
        roots: &[u32],
        sizes: &[u32],
        places: &mut [u32],
        room: &mut Vec<Neighbour>,
    ) {
        room.clear();
        for neighbour in self.list.iter().chain(&self.more) {
            let cluster = roots[neighbour.cluster as usize];
            if cluster == self.cluster {
                continue;
            }
            let place = &mut places[cluster as usize];
            if *place == NONE {
                *place = room.len() as u32;
                room.push(Neighbour { cluster, ..*neighbour });
            } else {
                let known = &mut room[*place as usize];
                known.pairs += neighbour.pairs;
                known.squared = known.squared.max(neighbour.squared);
            }
        }
        self.list.clear();
        self.more = Vec::new();
        let own = u64::from(sizes[self.cluster as usize]);
        let mut best = (f64::INFINITY, NONE);
        for neighbour in &*room {
            places[neighbour.cluster as usize] = NONE;
            if u64::from(neighbour.pairs) == own * u64::from(sizes[neighbour.cluster as usize]) {
                self.list.push(*neighbour);
                let key = (neighbour.squared, reps[neighbour.cluster as usize]);
                if key < best {
                    best = key;
                    self.nearest = (neighbour.cluster, neighbour.squared);
                }
            }
        }
    }
}

/// The neighbours of each cluster.
fn lists_of(m: usize, edges: Vec<Edge>) -> Vec<Vec<Neighbour>> {
    let mut degrees = vec![0; m];
    for edge in &edges {
        degrees[edge.a as usize] += 1;
        degrees[edge.b as usize] += 1;
    }
    let mut lists: Vec<Vec<Neighbour>> = degrees.into_iter().map(Vec::with_capacity).collect();
    for Edge { a, b, squared } in edges {
        lists[a as usize].push(Neighbour { cluster: b, pairs: 1, squared });
        lists[b as usize].push(Neighbour { cluster: a, pairs: 1, squared });
    }
    lists
}
