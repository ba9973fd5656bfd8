//! The lists of neighbours of all clusters, from the edges of a graph.

use crate::error::Error;
use crate::neighbours::Edge;
use crate::parallel::Workers;
use mograft_machine::memory::{allocate, collect, with_capacity};

/// Edges that one job reads while lists are built.
const EDGES_PER_JOB: usize = 1 << 20;

/// An entry of a cluster's list of neighbours.
#[derive(Clone, Copy, Default)]
pub(crate) struct Neighbour {
    /// The neighbour, or a cluster that was merged into it.
    pub cluster: u32,
    /// Count of pairs of parts within the limit that this entry stands for.
    pub n_pairs: u32,
    /// The largest of their squared distances.
    pub squared: f64,
}

/// The lists of neighbours of consecutive clusters.
pub(crate) struct Lists {
    /// The first cluster.
    first: usize,
    /// All lists, one after the other.
    neighbours: Vec<Neighbour>,
    /// Where each list ends.
    ends: Vec<usize>,
}

impl Lists {
    /// Lists of given lengths, without neighbours.
    fn new(first: usize, degrees: &[u32]) -> Result<Self, Error> {
        let mut n_neighbours = 0;
        let starts = collect(degrees.iter().map(|&degree| {
            let start = n_neighbours;
            n_neighbours += degree as usize;
            start
        }))?;
        let neighbours = allocate(Neighbour::default(), n_neighbours)?;
        Ok(Self { first, neighbours, ends: starts })
    }

    /// Add the clusters at the other ends of some edges.
    fn extend(&mut self, edges: &[Edge]) {
        for &Edge { a, b, squared } in edges {
            for (cluster, other) in [(a, b), (b, a)] {
                let position = (cluster as usize).wrapping_sub(self.first);
                if let Some(end) = self.ends.get_mut(position) {
                    self.neighbours[*end] = Neighbour { cluster: other, n_pairs: 1, squared };
                    *end += 1;
                }
            }
        }
    }
}

/// The lists of neighbours of `m` clusters.
///
/// They are built for one band of clusters after the other. Edges whose clusters both have lists
/// are removed, so that not all edges and all lists are in memory at a time. Takes O(b e) time for
/// e edges and b bands.
///
/// # Errors
///
/// [`Error::OutOfMemory`], and [`Error::Stopped`] if the progress callback requests a stop.
pub(crate) fn adjacency_lists(
    workers: &Workers<'_>,
    m: usize,
    mut edges: Vec<Vec<Edge>>,
    n_bands: usize,
) -> Result<Vec<Lists>, Error> {
    let width = m.div_ceil(n_bands * workers.n_threads()).max(1);
    let degrees = count_degrees(workers, m, &edges)?;
    let mut parts = with_capacity(m.div_ceil(width))?;
    for band in (0..m).step_by(width * workers.n_threads()) {
        let band_end = m.min(band + width * workers.n_threads());
        let firsts = (band..band_end).step_by(width);
        let mut band_parts: Vec<Lists> = workers
            .run(
                firsts.zip(degrees[band..band_end].chunks(width)),
                Vec::new,
                |lists, (first, degrees)| {
                    lists.extend(workers.ok_or_stop(Lists::new(first, degrees)));
                },
            )?
            .into_iter()
            .flatten()
            .collect();
        for edges in edges.iter().flat_map(|edges| edges.chunks(EDGES_PER_JOB)) {
            workers.run(band_parts.iter_mut(), || (), |(), lists| lists.extend(edges))?;
        }
        workers.run(
            edges.iter_mut(),
            || (),
            |(), edges| {
                edges.retain(|edge| edge.b as usize >= band_end);
                edges.shrink_to_fit();
            },
        )?;
        parts.append(&mut band_parts);
    }
    parts.sort_unstable_by_key(|lists| lists.first);
    Ok(parts)
}

/// The count of edges at each of `m` clusters.
fn count_degrees(workers: &Workers<'_>, m: usize, edges: &[Vec<Edge>]) -> Result<Vec<u32>, Error> {
    let mut degrees = allocate(0, m)?;
    let width = m.div_ceil(workers.n_threads()).max(1);
    for edges in edges.iter().flat_map(|edges| edges.chunks(EDGES_PER_JOB)) {
        workers.run(
            degrees.chunks_mut(width).enumerate(),
            || (),
            |(), (job, degrees)| {
                for cluster in edges.iter().flat_map(|edge| [edge.a, edge.b]) {
                    let position = (cluster as usize).wrapping_sub(job * width);
                    if let Some(degree) = degrees.get_mut(position) {
                        *degree += 1;
                    }
                }
            },
        )?;
    }
    Ok(degrees)
}

/// The list of each cluster.
///
/// # Errors
///
/// [`Error::OutOfMemory`].
pub(crate) fn split_lists(parts: &mut [Lists]) -> Result<Vec<&mut [Neighbour]>, Error> {
    let mut lists = with_capacity(parts.iter().map(|part| part.ends.len()).sum())?;
    for part in parts {
        let (mut rest, mut start) = (part.neighbours.as_mut_slice(), 0);
        for end in std::mem::take(&mut part.ends) {
            let list;
            (list, rest) = rest.split_at_mut(end - start);
            lists.push(list);
            start = end;
        }
    }
    Ok(lists)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mograft_machine::instructions::Isa;

    #[test]
    fn adjacency_lists_any_bands_and_threads_hold_both_ends_of_each_edge() {
        let m = 37;
        // Of all pairs about two thirds, in three parts of mixed order.
        let mut edges = vec![Vec::new(); 3];
        let mut expected = vec![Vec::new(); m as usize];
        for a in (0..m).rev() {
            for b in (a + 1..m).filter(|b| (a * b + a) % 3 != 0) {
                let squared = f64::from(a * m + b);
                edges[(b % 3) as usize].push(Edge { a, b, squared });
                expected[a as usize].push((b, 1, squared));
                expected[b as usize].push((a, 1, squared));
            }
        }
        for list in &mut expected {
            list.sort_unstable_by_key(|entry: &(u32, u32, f64)| entry.0);
        }
        for (n_threads, n_bands) in [(1, 1), (1, 5), (2, 3), (3, 8), (4, 50)] {
            let workers = Workers::new(n_threads, Isa::best(), None);
            let mut parts = adjacency_lists(&workers, m as usize, edges.clone(), n_bands).unwrap();
            let lists = split_lists(&mut parts).unwrap().into_iter().map(|list| {
                list.sort_by_key(|neighbour| neighbour.cluster);
                let entry = |it: &Neighbour| (it.cluster, it.n_pairs, it.squared);
                list.iter().map(entry).collect::<Vec<_>>()
            });
            assert_eq!(lists.collect::<Vec<_>>(), expected, "{n_threads} threads, {n_bands} bands");
        }
    }
}
