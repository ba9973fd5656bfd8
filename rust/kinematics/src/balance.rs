//! How donors change the balance of base segments.
#![allow(clippy::inline_always, reason = "loops are compiled for several instruction sets")]

use std::f64::consts::LOG2_E;

use glam::DVec2;

use crate::error::{Error, check_len};
use mograft_machine::instructions::{Isa, Loops};
use mograft_machine::memory::{allocate, with_capacity};
use mograft_machine::threads::for_each_part;

/// Donors whose imbalances are computed together: the loops over them become vector instructions.
const LANES: usize = 8;

/// Smallest count of donors that gets a thread of its own.
const MIN_DONORS_PER_THREAD: usize = 1024;

/// What the balance of base segments depends on: `n_samples` instants of each.
#[derive(Clone, Copy, Debug)]
pub struct Bases<'a> {
    /// Index of each base segment among all segments.
    pub segments: &'a [usize],
    /// Instants per segment.
    pub n_samples: usize,
    /// For each base segment a matrix, row by row, from the displacements of the center of mass at
    /// all samples to the shifts of the zero-moment point at these.
    pub operators: &'a [f64],
    /// Horizontal unit vectors.
    pub directions: &'a [DVec2],
    /// For each base segment and sample, the distances that the zero-moment point may move in each
    /// direction, then those in each opposite direction.
    pub margins: &'a [f64],
    /// The distance outside the support that makes an imbalance of e / (1 + e).
    pub scale: f64,
}

impl Bases<'_> {
    fn check(&self, n_segments: usize) -> Result<(), Error> {
        let n_instants = self.segments.len().saturating_mul(self.n_samples);
        check_len(self.operators.len(), n_instants.saturating_mul(self.n_samples))?;
        let n_directions = self.directions.len().saturating_mul(2);
        check_len(self.margins.len(), n_instants.saturating_mul(n_directions))?;
        check_indices(self.segments, n_segments)
    }
}

fn check_indices(segments: &[usize], n_segments: usize) -> Result<(), Error> {
    match segments.iter().find(|&&segment| segment >= n_segments) {
        Some(&segment) => Err(Error::UnknownSegment { segment }),
        None => Ok(()),
    }
}

/// By how much each donor raises the imbalance of its base segment; 0 if it falls.
///
/// `offsets` has the center of mass at the samples of all segments, relative to the root. `donors`
/// has the donors of the first base segment, then those of the next; `counts` has their numbers.
/// The imbalance is the mean over the samples of 1 / (1 + exp(-d / scale)), where d is the largest
/// distance of the zero-moment point beyond a margin. Base segments are shared out among
/// `threads`; the result does not depend on their count. A NaN offset gives NaN for its donor or
/// base segment; with NaN margins the result is arbitrary. Takes O(donors × samples × (samples +
/// directions)) time.
///
/// # Errors
///
/// If buffers do not match, a segment does not exist, or memory is exhausted.
pub fn added_imbalances(
    bases: Bases<'_>,
    offsets: &[DVec2],
    donors: &[usize],
    counts: &[usize],
    threads: usize,
) -> Result<Vec<f64>, Error> {
    added_imbalances_with(Isa::best(), bases, offsets, donors, counts, threads)
}

/// [`added_imbalances`] with one instruction set.
#[doc(hidden)]
pub fn added_imbalances_with(
    isa: Isa,
    bases: Bases<'_>,
    offsets: &[DVec2],
    donors: &[usize],
    counts: &[usize],
    threads: usize,
) -> Result<Vec<f64>, Error> {
    let n_segments = offsets.len() / bases.n_samples.max(1);
    check_len(offsets.len(), n_segments * bases.n_samples)?;
    bases.check(n_segments)?;
    check_len(counts.len(), bases.segments.len())?;
    check_len(donors.len(), counts.iter().fold(0, |sum, n| n.saturating_add(sum)))?;
    check_indices(donors, n_segments)?;
    let mut added = allocate(0.0, donors.len())?;
    let donors_per_thread = donors
        .len()
        .div_ceil(threads.max(1))
        .max(MIN_DONORS_PER_THREAD);
    let mut parts = with_capacity(donors.len() / donors_per_thread + 1)?;
    let (mut rest, mut first) = (added.as_mut_slice(), Start { base: 0, donor: 0 });
    let mut next = first;
    for &count in counts {
        next = Start { base: next.base + 1, donor: next.donor + count };
        let n = next.donor - first.donor;
        if n >= donors_per_thread || next.base == counts.len() {
            let (own, others) = rest.split_at_mut(n);
            parts.push((first, own));
            (rest, first) = (others, next);
        }
    }
    for_each_part(parts.into_iter(), |(first, mut added): (Start, &mut [f64])| {
        let mut row_kernel = RowKernel::new(bases, offsets);
        let mut rest = &donors[first.donor..][..added.len()];
        for (row, &count) in (first.base..).zip(&counts[first.base..]) {
            let (own, later) = rest.split_at(count.min(rest.len()));
            let (targets, others) = added.split_at_mut(own.len());
            let kernel = &mut row_kernel;
            isa.run(FillRow { kernel, row, donors: own, added: targets });
            (rest, added) = (later, others);
            if rest.is_empty() {
                break;
            }
        }
    });
    Ok(added)
}

/// A base segment, and the first of its donors.
#[derive(Clone, Copy)]
struct Start {
    base: usize,
    donor: usize,
}

/// Compute how much donors raise the imbalance of the base segment of a row.
struct FillRow<'a, 'b> {
    kernel: &'a mut RowKernel<'b>,
    row: usize,
    donors: &'a [usize],
    added: &'a mut [f64],
}

impl Loops for FillRow<'_, '_> {
    #[inline(always)]
    fn run(self) {
        self.kernel.fill(self.row, self.donors, self.added);
    }
}

/// Computes one base segment after the other.
struct RowKernel<'a> {
    bases: Bases<'a>,
    offsets: &'a [DVec2],
    /// Displacements of the center of mass at all samples, along both axes; of no donor, and of
    /// several donors.
    still: Vec<[[f64; 1]; 2]>,
    gaps: Vec<[[f64; LANES]; 2]>,
}

impl<'a> RowKernel<'a> {
    fn new(bases: Bases<'a>, offsets: &'a [DVec2]) -> Self {
        let still = vec![[[0.0; 1]; 2]; bases.n_samples];
        let gaps = vec![[[0.0; LANES]; 2]; bases.n_samples];
        Self { bases, offsets, still, gaps }
    }

    /// Compute how much donors raise the imbalance of the base segment of a row.
    #[inline(always)]
    fn fill(&mut self, row: usize, donors: &[usize], added: &mut [f64]) {
        let [known] = self.imbalances(row, &self.still);
        let base = self.track(self.bases.segments[row]);
        for (donors, added) in donors.chunks(LANES).zip(added.chunks_mut(LANES)) {
            for lane in 0..LANES {
                // The last block repeats its last donor.
                let donor = self.track(donors[lane.min(donors.len() - 1)]);
                for ((gap, to), from) in self.gaps.iter_mut().zip(donor).zip(base) {
                    (gap[0][lane], gap[1][lane]) = (to.x - from.x, to.y - from.y);
                }
            }
            for (target, imbalance) in added.iter_mut().zip(self.imbalances(row, &self.gaps)) {
                let rise = imbalance - known;
                *target = if rise < 0.0 { 0.0 } else { rise };
            }
        }
    }

    fn track(&self, segment: usize) -> &'a [DVec2] {
        let n_samples = self.bases.n_samples;
        &self.offsets[segment * n_samples..][..n_samples]
    }

    /// The imbalances of the base segment of a row after `N` displacements of the center of mass.
    #[inline(always)]
    fn imbalances<const N: usize>(&self, row: usize, gaps: &[[[f64; N]; 2]]) -> [f64; N] {
        let Bases { n_samples, operators, directions, margins, scale, .. } = self.bases;
        let n_directions = directions.len();
        let mut sums = [0.0; N];
        for sample in row * n_samples..(row + 1) * n_samples {
            let mut shift = [[0.0; N]; 2];
            for (weight, gap) in operators[sample * n_samples..].iter().zip(gaps) {
                for (sums, lanes) in shift.iter_mut().zip(gap) {
                    for (sum, lane) in sums.iter_mut().zip(lanes) {
                        *sum += weight * lane;
                    }
                }
            }
            let margins = &margins[2 * sample * n_directions..][..2 * n_directions];
            let distances = distances(&shift, directions, margins);
            for (sum, distance) in sums.iter_mut().zip(distances) {
                *sum += 1.0 / (1.0 + exponential(-distance / scale));
            }
        }
        sums.map(|sum| sum / n_samples as f64)
    }
}

/// The largest distances of shifted points beyond their margins; negative inside.
#[inline(always)]
fn distances<const N: usize>(
    [xs, ys]: &[[f64; N]; 2],
    directions: &[DVec2],
    margins: &[f64],
) -> [f64; N] {
    let (mut high, mut low) = ([f64::NEG_INFINITY; N], [f64::INFINITY; N]);
    let (along, opposite) = margins.split_at(directions.len());
    for ((direction, along), opposite) in directions.iter().zip(along).zip(opposite) {
        for lane in 0..N {
            let shift = direction.x * xs[lane] + direction.y * ys[lane];
            let (beyond, behind) = (shift - along, shift + opposite);
            // In this form, comparisons become one instruction, and a NaN shift gives NaN.
            high[lane] = if high[lane] > beyond { high[lane] } else { beyond };
            low[lane] = if low[lane] < behind { low[lane] } else { behind };
        }
    }
    for (high, low) in high.iter_mut().zip(low) {
        *high = if *high > -low { *high } else { -low };
    }
    high
}

/// The exponential of a number, which is first limited to the numbers from -708 to 708.
///
/// The relative error is below 1e-15. Unlike `f64::exp` it has no branches, so that loops over it
/// become vector instructions, and the result is the same on all systems. Rational approximation
/// of Moshier's Cephes library, `exp.c`.
#[inline(always)]
fn exponential(x: f64) -> f64 {
    let x = if x > LIMIT { LIMIT } else { x };
    let x = if x < -LIMIT { -LIMIT } else { x };
    // The sum has the nearest whole number in its lowest bits.
    let shifted = x * LOG2_E + WHOLE;
    let whole = shifted - WHOLE;
    let rest = x - whole * LN_2_HIGH - whole * LN_2_LOW;
    let square = rest * rest;
    let p = rest * P.iter().fold(0.0, |sum, c| sum * square + c);
    let q = Q.iter().fold(0.0, |sum, c| sum * square + c);
    let power = f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52);
    (1.0 + 2.0 * (p / (q - p))) * power
}

const LIMIT: f64 = 708.0;

/// 1.5 · 2⁵²: numbers of this size have no fraction.
const WHOLE: f64 = 6_755_399_441_055_744.0;

/// Two parts of the logarithm of 2; products of the first with small whole numbers are exact.
const LN_2_HIGH: f64 = 6.931_457_519_531_25e-1;
const LN_2_LOW: f64 = 1.428_606_820_309_417_2e-6;

const P: [f64; 3] = [1.261_771_930_748_105_9e-4, 3.029_944_077_074_419_6e-2, 1.0];

const Q: [f64; 4] =
    [3.001_985_051_386_644_6e-6, 2.524_483_403_496_841e-3, 2.272_655_482_081_550_3e-1, 2.0];

#[cfg(test)]
mod tests {
    use super::*;
    use mograft_machine::instructions::Level;

    const DIRECTIONS: [DVec2; 3] =
        [DVec2::X, DVec2::new(0.5, 0.866_025_403_784_438_6), DVec2::new(-0.6, 0.8)];

    /// Different numbers of both signs, at most `size`.
    fn numbers(n: usize, size: f64) -> Vec<f64> {
        (0..n)
            .map(|i| size * (1.7 * i as f64 + (i * i) as f64).sin())
            .collect()
    }

    fn vectors(n: usize, size: f64) -> Vec<DVec2> {
        numbers(2 * n, size)
            .chunks(2)
            .map(DVec2::from_slice)
            .collect()
    }

    /// Operators and margins of base segments.
    fn base_arrays(n: usize, n_samples: usize) -> [Vec<f64>; 2] {
        let margins = numbers(n * n_samples * 2 * DIRECTIONS.len(), 0.05);
        [numbers(n * n_samples * n_samples, 1.0), margins]
    }

    fn imbalance(shifts: &[DVec2], margins: &[f64], scale: f64) -> f64 {
        let n = DIRECTIONS.len();
        let shares = shifts
            .iter()
            .zip(margins.chunks(2 * n))
            .map(|(shift, margins)| {
                let beyond = |k: usize| DIRECTIONS[k].dot(*shift) - margins[k];
                let behind = |k: usize| -DIRECTIONS[k].dot(*shift) - margins[n + k];
                let distances = (0..n).flat_map(|k| [beyond(k), behind(k)]);
                let distance = distances.fold(f64::NEG_INFINITY, f64::max);
                1.0 / (1.0 + (-distance / scale).exp())
            });
        shares.sum::<f64>() / shifts.len() as f64
    }

    #[test]
    fn added_imbalances_on_any_thread_count_equal_scalar_formula() {
        let (n_samples, n_segments, scale) = (4, 300, 0.01);
        let counts = [0, 2100, 1, 8, 0, 9, 1500, 0];
        let segments = [5, 0, 299, 7, 8, 7, 1, 1];
        let offsets = vectors(n_segments * n_samples, 0.05);
        let [operators, margins] = base_arrays(segments.len(), n_samples);
        let bases = Bases {
            segments: &segments,
            n_samples,
            operators: &operators,
            directions: &DIRECTIONS,
            margins: &margins,
            scale,
        };
        let donors: Vec<usize> = (0..counts.iter().sum())
            .map(|i| 7 * i % n_segments)
            .collect();
        let one = added_imbalances(bases, &offsets, &donors, &counts, 1).unwrap();
        for threads in [0, 2, 3, 1000] {
            let found = added_imbalances(bases, &offsets, &donors, &counts, threads);
            assert_eq!(found.as_ref(), Ok(&one));
        }
        for isa in [Level::Baseline, Level::Avx2].map(Isa::up_to) {
            let found = added_imbalances_with(isa, bases, &offsets, &donors, &counts, 1);
            assert_eq!(found.as_ref(), Ok(&one));
        }
        let track = |segment: usize| &offsets[segment * n_samples..][..n_samples];
        let mut found = donors.iter().zip(&one);
        let mut n_positive = 0;
        for (row, &count) in counts.iter().enumerate() {
            let margins = &margins[row * n_samples * 6..][..n_samples * 6];
            for (&donor, &added) in found.by_ref().take(count) {
                let shift = |sample: usize| -> DVec2 {
                    let weights = &operators[(row * n_samples + sample) * n_samples..];
                    let gaps = track(donor).iter().zip(track(segments[row]));
                    let terms = weights
                        .iter()
                        .zip(gaps)
                        .map(|(w, (to, from))| *w * (to - from));
                    terms.sum()
                };
                let shifts: Vec<DVec2> = (0..n_samples).map(shift).collect();
                let still = vec![DVec2::ZERO; n_samples];
                let rise = imbalance(&shifts, margins, scale) - imbalance(&still, margins, scale);
                assert!((added - rise.max(0.0)).abs() < 1e-13, "{row} {donor}");
                n_positive += usize::from(added > 0.0);
                assert!(donor != segments[row] || added == 0.0);
            }
        }
        assert!(n_positive > donors.len() / 4 && n_positive < donors.len());
    }

    #[test]
    fn added_imbalances_of_infinite_margins_are_zero_and_of_nan_offsets_nan() {
        let margins = vec![f64::INFINITY; 2 * DIRECTIONS.len()];
        let bases = Bases {
            segments: &[0],
            n_samples: 1,
            operators: &[1.0],
            directions: &DIRECTIONS,
            margins: &margins,
            scale: 0.01,
        };
        let offsets = [DVec2::ZERO, DVec2::new(3.0, -9.0), DVec2::NAN];
        assert_eq!(added_imbalances(bases, &offsets, &[1, 0], &[2], 1), Ok(vec![0.0; 2]));
        let margins = vec![0.0; 2 * DIRECTIONS.len()];
        let bases = Bases { margins: &margins, ..bases };
        let found = added_imbalances(bases, &offsets, &[2, 1], &[2], 1).unwrap();
        assert!(found[0].is_nan() && found[1] > 0.4);
    }

    #[test]
    fn added_imbalances_of_mismatched_input_return_error() {
        let (n_samples, segments) = (2, [1, 0]);
        let offsets = vectors(3 * n_samples, 0.1);
        let [operators, margins] = base_arrays(2, n_samples);
        let bases = Bases {
            segments: &segments,
            n_samples,
            operators: &operators,
            directions: &DIRECTIONS,
            margins: &margins,
            scale: 0.01,
        };
        let (donors, counts) = (&[0, 1, 2], &[1, 2]);
        assert!(added_imbalances(bases, &offsets, donors, counts, 1).is_ok());
        assert!(added_imbalances(bases, &offsets[1..], donors, counts, 1).is_err());
        assert!(added_imbalances(bases, &offsets, donors, &[3], 1).is_err());
        assert!(added_imbalances(bases, &offsets, donors, &[1, 1], 1).is_err());
        let unknown = Err(Error::UnknownSegment { segment: 3 });
        assert_eq!(added_imbalances(bases, &offsets, &[0, 3, 2], counts, 1), unknown);
        for bad in [
            Bases { segments: &[3, 0], ..bases },
            Bases { segments: &[0], ..bases },
            Bases { operators: &operators[1..], ..bases },
            Bases { margins: &margins[1..], ..bases },
            Bases { directions: &DIRECTIONS[1..], ..bases },
            Bases { n_samples: 0, ..bases },
        ] {
            assert!(added_imbalances(bad, &offsets, donors, counts, 1).is_err());
        }
        let none = Bases { segments: &[], operators: &[], margins: &[], ..bases };
        assert_eq!(added_imbalances(none, &offsets, &[], &[], 1), Ok(vec![]));
    }

    #[test]
    fn exponential_is_exp_between_its_limits() {
        for i in -70_800..=70_800 {
            let x = f64::from(i) / 100.0;
            assert!((exponential(x) / x.exp() - 1.0).abs() < 1e-15, "{x}");
        }
        assert_eq!(exponential(f64::INFINITY), exponential(708.0));
        assert_eq!(exponential(f64::NEG_INFINITY), exponential(-708.0));
        assert_eq!(exponential(0.0), 1.0);
        assert!(exponential(f64::NAN).is_nan());
    }
}
