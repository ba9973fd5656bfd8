//! Every instruction set against scalar arithmetic.

use mograft_machine::instructions::{Isa, Level};

use super::*;

const DIMS: [usize; 5] = [1, 2, 7, 10, 33];

/// `count` numbers of both signs, the same at every call.
fn numbers(count: usize) -> impl Iterator<Item = f64> {
    (0..count).map(|i| ((i * 7919 + 13) % 1009) as f64 / 97.0 - 5.0)
}

fn f32_lanes(count: usize) -> Vec<F32Lanes> {
    let flat: Vec<f32> = numbers(count * LANES).map(|x| x as f32).collect();
    flat.as_chunks().0.iter().copied().map(Aligned).collect()
}

fn f64_lanes(count: usize) -> Vec<F64Lanes> {
    let flat: Vec<f64> = numbers(count * LANES).collect();
    flat.as_chunks().0.iter().copied().map(Aligned).collect()
}

/// Lanes of whole numbers, whose f32 arithmetic is exact, fused or not.
fn whole_lanes(count: usize) -> Vec<F32Lanes> {
    let round = |lanes: &F32Lanes| Aligned(lanes.map(f32::round));
    f32_lanes(count).iter().map(round).collect()
}

fn instruction_sets() -> [Isa; 3] {
    [Level::Baseline, Level::Avx2, Level::Avx512].map(Isa::up_to)
}

#[test]
fn f64_kernels_on_every_set_equal_scalar_bits() {
    for dim in DIMS {
        let (point, block, variances): (Vec<f64>, _, _) =
            (numbers(dim).map(|x| x / 3.0).collect(), f64_lanes(dim), f64_lanes(1)[0]);
        let expected: Vec<f64> = (0..LANES)
            .map(|lane| {
                let mut sum = 0.0;
                for (x, lanes) in point.iter().zip(&block) {
                    sum += (lanes[lane] - x) * (lanes[lane] - x);
                }
                sum + (variances[lane] + 0.5)
            })
            .collect();
        let row: Vec<f64> = numbers(91).collect();
        for isa in instruction_sets() {
            assert_eq!(squared_bounds(isa, &point, 0.5, &block, &variances).to_vec(), expected);
            assert_eq!(minimum(isa, &row), row.iter().copied().fold(f64::INFINITY, f64::min));
            for value in row.iter().copied().chain([f64::NAN, 1e9]) {
                let expected = row.iter().position(|&x| x == value);
                assert_eq!(first_position(isa, &row, value), expected);
            }
            let mut larger = row.clone();
            maximize(isa, &mut larger, &expected);
            let pairs = row.iter().zip(&expected).map(|(a, b)| a.max(*b));
            assert!(larger.iter().copied().zip(pairs).all(|(a, b)| a == b));
        }
    }
}

#[test]
fn f32_distances_on_every_set_are_within_stated_error() {
    for dim in DIMS {
        let blocks = f32_lanes(3 * dim);
        let points: Vec<f32> = numbers(QUERIES * dim).map(|x| (x / 3.0) as f32).collect();
        let exact = |point: usize, block: usize, lane: usize| {
            (0..dim)
                .map(|k| f64::from(blocks[block * dim + k][lane] - points[point * dim + k]).powi(2))
                .sum::<f64>()
        };
        for isa in instruction_sets() {
            let mut out = vec![Aligned([0.0; LANES]); 3];
            let largest = squared_distances(isa, &points[..dim], &blocks, &mut out);
            for (i, &squared) in out.iter().flat_map(|lanes| &lanes.0).enumerate() {
                let expected = exact(0, i / LANES, i % LANES);
                assert!((f64::from(squared) - expected).abs() <= f32_sum_error(dim) * expected);
            }
            assert_eq!(largest, out.iter().flat_map(|lanes| lanes.0).fold(0.0, f32::max));
            let maxima = max_of_rows(isa, &points, dim, &blocks);
            for (point, &squared) in maxima.iter().enumerate() {
                let expected = (0..3 * LANES)
                    .map(|i| exact(point, i / LANES, i % LANES))
                    .fold(0.0, f64::max);
                assert!((f64::from(squared) - expected).abs() <= f32_sum_error(dim) * expected);
            }
        }
    }
}

#[test]
fn blocks_within_on_every_set_equals_brute_force() {
    for dim in DIMS {
        let extremes = whole_lanes(6 * dim).split_off(2 * dim);
        let (offsets, variances) = (whole_lanes(2 * dim), Aligned(whole_lanes(1)[0].map(f32::abs)));
        let (midpoint, other_midpoint) = (vec![3.0; dim], vec![1.0; dim]);
        let half_extents = vec![5.0; dim];
        let min_variance = variances.iter().copied().fold(f32::INFINITY, f32::min);
        let block = |midpoint, offsets, extremes| Block {
            midpoint,
            half_extents: &half_extents,
            offsets,
            extremes,
            variances: &variances,
            min_variance,
        };
        let first = block(&midpoint, &offsets[..dim], &extremes[..2 * dim]);
        let other = block(&other_midpoint, &offsets[dim..], &extremes[2 * dim..]);
        for limit in [0.0, 9.0 * dim as f32, 25.0 * dim as f32, 1e9] {
            let results = instruction_sets().map(|isa| {
                let mut queries = [other, first, first].map(Query::new);
                for query in &mut queries[1..] {
                    (query.limit, query.extreme_limit) = (limit, limit / 2.0);
                }
                blocks_within(isa, &mut queries, 0b110, &other);
                queries.map(|query| (query.rows, query.found))
            });
            assert_eq!(results[0], results[1]);
            assert_eq!(results[0], results[2]);
            let [unselected, second, third] = results[0];
            assert_eq!((unselected, second), ((0, [0; LANES]), third));
            let (rows, found) = second;
            for row in 0..LANES {
                let has_passed = rows >> row & 1 != 0;
                for lane in 0..LANES {
                    let squared: f32 = (0..dim)
                        .map(|k| other.offsets[k][lane] - first.offsets[k][row] - 2.0)
                        .map(|difference| difference * difference) // powi need not be exact
                        .sum();
                    let between_extremes = |p: usize, q: usize| {
                        (0..dim)
                            .map(|k| {
                                first.extremes[2 * k + p][row] + 2.0
                                    - other.extremes[2 * k + q][lane]
                            })
                            .map(|difference| difference * difference)
                            .sum::<f32>()
                    };
                    let pairs =
                        [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(p, q)| between_extremes(p, q));
                    let is_within = squared + variances[row] + variances[lane] <= limit
                        && pairs.iter().all(|&squared| squared <= limit / 2.0);
                    assert_eq!(has_passed && found[row] >> lane & 1 != 0, is_within);
                }
            }
        }
    }
}
