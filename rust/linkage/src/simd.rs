//! The inner loops, compiled for three instruction sets and chosen at run time.
//!
//! Every loop is plain Rust over sixteen lanes; the compiler turns the lanes into vectors.
//! What differs between the sets is the width of those vectors and nothing that can be seen:
//!
//! * Loops in f64 decide results. They add coordinates in order and never fuse, so each
//!   lane holds the bits that one-by-one arithmetic gives (and SciPy's `pdist`).
//! * Loops in f32 only sort out pairs that need no closer look. They may fuse a
//!   multiplication with an addition, which moves their rounding within the tolerance that
//!   [`rounding`] states and every caller allows for.
//!
//! The tests below run clean under the address sanitizer with AVX-512, under Valgrind with AVX2,
//! the widest that it knows, and under Miri with the baseline:
//!
//! ```text
//! RUSTFLAGS=-Zsanitizer=address cargo +nightly test -p mograft-linkage --lib \
//!     --target x86_64-unknown-linux-gnu
//! valgrind target/release/deps/mograft_linkage-… simd
//! cargo +nightly miri test -p mograft-linkage --lib simd
//! ```
//!
//! All `unsafe` of the crate stands here: in the macro `dispatch`, because a function compiled for
//! an instruction set may only be called where the processor has it, and in the few methods of
//! the vectors that such functions use. The one way to an [`Isa`] beyond the baseline is to ask
//! the processor.
#![allow(unsafe_code, reason = "calls into functions compiled for detected instruction sets")]
#![allow(clippy::inline_always, reason = "vectors must stay in registers across these functions")]
#![allow(clippy::too_many_arguments, reason = "what the inner loops read is laid out flat")]

use std::ops::{Deref, DerefMut};

/// Lanes of a block: clusters or points handled side by side.
pub(crate) const LANES: usize = 16;

/// Sixteen numbers where no vector of them straddles two lines of the cache.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(64))]
pub(crate) struct Aligned<T>(pub [T; LANES]);

impl<T> Deref for Aligned<T> {
    type Target = [T; LANES];

    #[inline(always)]
    fn deref(&self) -> &[T; LANES] {
        &self.0
    }
}

impl<T> DerefMut for Aligned<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T; LANES] {
        &mut self.0
    }
}

/// One coordinate of sixteen things, as the filter sees it.
pub(crate) type Lanes = Aligned<f32>;

/// One coordinate of sixteen things, exactly.
pub(crate) type Wide = Aligned<f64>;

/// The most that a sum of `dim` squares in f32 can be off, as a fraction of it.
pub(crate) fn rounding(dim: usize) -> f64 {
    // Each of dim squares and dim + 1 additions rounds by at most half a unit of 2^-23;
    // the rest of the margin covers the products of these.
    (dim as f64 + 4.0) / f64::from(1 << 23)
}

/// An instruction set that this processor has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Isa(Level);

/// The instruction sets that there is code for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// What every processor of the family has; on x86-64, SSE2.
    Baseline,
    /// AVX2 with fused multiplication and addition.
    Avx2,
    /// AVX-512 (F, BW, DQ, VL).
    Avx512,
}

impl Isa {
    /// The widest set that this processor has, up to `level`.
    pub fn up_to(level: Level) -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            let has_avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
            let has_avx512 = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl");
            if level >= Level::Avx512 && has_avx2 && has_avx512 {
                return Self(Level::Avx512);
            }
            if level >= Level::Avx2 && has_avx2 {
                return Self(Level::Avx2);
            }
        }
        let _ = level;
        Self(Level::Baseline)
    }

    /// The widest set that this processor has.
    pub fn best() -> Self {
        Self::up_to(Level::Avx512)
    }
}

/// Define a function that runs `$body` as compiled for the instruction set it is given.
///
/// `$body` is generic over the vectors of that set.
macro_rules! dispatch {
    ($(#[$doc:meta])* $name:ident = $body:ident($($arg:ident: $type:ty),*) $(-> $out:ty)?) => {
        $(#[$doc])*
        #[inline]
        pub(crate) fn $name(isa: Isa, $($arg: $type),*) $(-> $out)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,fma")]
                fn avx2($($arg: $type),*) $(-> $out)? {
                    $body::<x86::Avx2>($($arg),*)
                }
                #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl")]
                fn avx512($($arg: $type),*) $(-> $out)? {
                    $body::<x86::Avx512>($($arg),*)
                }
                match isa.0 {
                    // SAFETY: an `Isa` above the baseline comes from `Isa::up_to` alone, which
                    // has found the processor to have every feature named above.
                    Level::Avx512 => return unsafe { avx512($($arg),*) },
                    // SAFETY: as above.
                    Level::Avx2 => return unsafe { avx2($($arg),*) },
                    Level::Baseline => {}
                }
            }
            let _ = isa;
            $body::<Baseline>($($arg),*)
        }
    };
}

/// Sixteen lanes of f32 in the registers of an instruction set.
trait Sixteen: Copy {
    fn load(lanes: &Lanes) -> Self;
    fn store(self, lanes: &mut Lanes);
    fn splat(x: f32) -> Self;
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
    fn abs(self) -> Self;
    fn max(self, other: Self) -> Self;
    /// `self * self + sum`, rounded once or twice.
    fn square_plus(self, sum: Self) -> Self;
    /// Bit by bit, which lanes are at most those of the other.
    fn at_most(self, other: Self) -> u16;
}

/// Vectors of the baseline, left to the compiler.
#[derive(Clone, Copy)]
struct Baseline(Lanes);

impl Baseline {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut lanes = self.0;
        for (x, &y) in lanes.iter_mut().zip(other.0.iter()) {
            *x = f(*x, y);
        }
        Self(lanes)
    }
}

impl Sixteen for Baseline {
    #[inline(always)]
    fn load(lanes: &Lanes) -> Self {
        Self(*lanes)
    }
    #[inline(always)]
    fn store(self, lanes: &mut Lanes) {
        *lanes = self.0;
    }
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(Aligned([x; LANES]))
    }
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.zip(other, |x, y| x + y)
    }
    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.zip(other, |x, y| x - y)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(Aligned(self.0.map(f32::abs)))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |x, y| if x > y { x } else { y })
    }
    #[inline(always)]
    fn square_plus(self, sum: Self) -> Self {
        self.zip(sum, |x, sum| x * x + sum)
    }
    #[inline(always)]
    fn at_most(self, other: Self) -> u16 {
        // Each lane keeps its own bit; the bits are gathered by halves, a vector at a time.
        let mut bits = [0_u32; LANES];
        for (lane, (bit, (x, y))) in bits
            .iter_mut()
            .zip(self.0.iter().zip(other.0.iter()))
            .enumerate()
        {
            *bit = u32::from(x <= y) << lane;
        }
        let mut half = LANES / 2;
        while half > 0 {
            for lane in 0..half {
                bits[lane] |= bits[lane + half];
            }
            half /= 2;
        }
        bits[0] as u16
    }
}

/// Vectors of the wider sets.
///
/// Their methods are for functions that [`dispatch`] has compiled for the set, into which they
/// are inlined; nothing else names these types.
#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::{
        __m256, __m512, _CMP_LE_OQ, _mm256_add_ps, _mm256_andnot_ps, _mm256_cmp_ps,
        _mm256_fmadd_ps, _mm256_loadu_ps, _mm256_max_ps, _mm256_movemask_ps, _mm256_set1_ps,
        _mm256_storeu_ps, _mm256_sub_ps, _mm512_abs_ps, _mm512_add_ps, _mm512_cmp_ps_mask,
        _mm512_fmadd_ps, _mm512_loadu_ps, _mm512_max_ps, _mm512_set1_ps, _mm512_storeu_ps,
        _mm512_sub_ps,
    };

    use super::{Lanes, Sixteen};

    /// Eight lanes each.
    #[derive(Clone, Copy)]
    pub struct Avx2(__m256, __m256);

    /// All sixteen.
    #[derive(Clone, Copy)]
    pub struct Avx512(__m512);

    // SAFETY, of every block below: the processor has the instructions, because `dispatch` gets
    // here only with an `Isa` that says so; loads and stores move the sixteen f32 of a `Lanes`,
    // whole or in halves, and ask for no alignment.

    impl Sixteen for Avx2 {
        #[inline(always)]
        fn load(lanes: &Lanes) -> Self {
            let at = lanes.as_ptr();
            unsafe { Self(_mm256_loadu_ps(at), _mm256_loadu_ps(at.add(8))) }
        }
        #[inline(always)]
        fn store(self, lanes: &mut Lanes) {
            let at = lanes.as_mut_ptr();
            unsafe {
                _mm256_storeu_ps(at, self.0);
                _mm256_storeu_ps(at.add(8), self.1);
            }
        }
        #[inline(always)]
        fn splat(x: f32) -> Self {
            unsafe { Self(_mm256_set1_ps(x), _mm256_set1_ps(x)) }
        }
        #[inline(always)]
        fn plus(self, other: Self) -> Self {
            unsafe { Self(_mm256_add_ps(self.0, other.0), _mm256_add_ps(self.1, other.1)) }
        }
        #[inline(always)]
        fn minus(self, other: Self) -> Self {
            unsafe { Self(_mm256_sub_ps(self.0, other.0), _mm256_sub_ps(self.1, other.1)) }
        }
        #[inline(always)]
        fn abs(self) -> Self {
            unsafe {
                let sign = _mm256_set1_ps(-0.0);
                Self(_mm256_andnot_ps(sign, self.0), _mm256_andnot_ps(sign, self.1))
            }
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            unsafe { Self(_mm256_max_ps(self.0, other.0), _mm256_max_ps(self.1, other.1)) }
        }
        #[inline(always)]
        fn square_plus(self, sum: Self) -> Self {
            unsafe {
                Self(_mm256_fmadd_ps(self.0, self.0, sum.0), _mm256_fmadd_ps(self.1, self.1, sum.1))
            }
        }
        #[inline(always)]
        fn at_most(self, other: Self) -> u16 {
            unsafe {
                let low = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0));
                let high = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self.1, other.1));
                (low | high << 8) as u16
            }
        }
    }

    impl Sixteen for Avx512 {
        #[inline(always)]
        fn load(lanes: &Lanes) -> Self {
            unsafe { Self(_mm512_loadu_ps(lanes.as_ptr())) }
        }
        #[inline(always)]
        fn store(self, lanes: &mut Lanes) {
            unsafe { _mm512_storeu_ps(lanes.as_mut_ptr(), self.0) }
        }
        #[inline(always)]
        fn splat(x: f32) -> Self {
            unsafe { Self(_mm512_set1_ps(x)) }
        }
        #[inline(always)]
        fn plus(self, other: Self) -> Self {
            unsafe { Self(_mm512_add_ps(self.0, other.0)) }
        }
        #[inline(always)]
        fn minus(self, other: Self) -> Self {
            unsafe { Self(_mm512_sub_ps(self.0, other.0)) }
        }
        #[inline(always)]
        fn abs(self) -> Self {
            unsafe { Self(_mm512_abs_ps(self.0)) }
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            unsafe { Self(_mm512_max_ps(self.0, other.0)) }
        }
        #[inline(always)]
        fn square_plus(self, sum: Self) -> Self {
            unsafe { Self(_mm512_fmadd_ps(self.0, self.0, sum.0)) }
        }
        #[inline(always)]
        fn at_most(self, other: Self) -> u16 {
            unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, other.0) }
        }
    }
}

/// Add the squared way from `at` to each lane.
#[inline(always)]
fn add_way<V: Sixteen>(sums: &mut V, lanes: V, at: f32) {
    *sums = lanes.minus(V::splat(at)).square_plus(*sums);
}

/// The largest lane, by halves: a vector at a time.
#[inline(always)]
fn largest<V: Sixteen>(vector: V) -> f32 {
    let mut lanes = Aligned([0.0; LANES]);
    vector.store(&mut lanes);
    let mut half = LANES / 2;
    while half > 0 {
        for lane in 0..half {
            lanes[lane] = lanes[lane].max(lanes[lane + half]);
        }
        half /= 2;
    }
    lanes[0]
}

dispatch! {
    /// Which of sixteen boxes may hold a point within reach of the box from `low` to `high`.
    ///
    /// The boxes' corners are given coordinate by coordinate. A bit is set where the squared
    /// gap of the boxes, plus `spread` and the other's of `spreads`, is at most `limit`.
    boxes_near = boxes_near_body(
        low: &[f64], high: &[f64], spread: f64,
        lows: &[Wide], highs: &[Wide], spreads: &Wide, limit: f64
    ) -> u16
}

#[inline(always)]
fn boxes_near_body<V: Sixteen>(
    low: &[f64],
    high: &[f64],
    spread: f64,
    lows: &[Wide],
    highs: &[Wide],
    spreads: &Wide,
    limit: f64,
) -> u16 {
    let mut sums = *spreads;
    for sum in sums.iter_mut() {
        *sum += spread;
    }
    for ((&low, &high), (lows, highs)) in low.iter().zip(high).zip(lows.iter().zip(highs)) {
        for lane in 0..LANES {
            let gap = (lows[lane] - high).max(low - highs[lane]).max(0.0);
            sums[lane] += gap * gap;
        }
    }
    sums.iter()
        .rev()
        .fold(0, |bits, &sum| bits << 1 | u16::from(sum <= limit))
}

/// Sixteen things around a middle.
#[derive(Clone, Copy)]
pub(crate) struct Block<'a> {
    /// Of the box around them, by axis.
    pub middle: &'a [f64],
    /// How far the box extends from there, both ways.
    pub half: &'a [f32],
    /// The way from the middle to each of them.
    pub offsets: &'a [Lanes],
    /// What each adds to its squared distances.
    pub spreads: &'a Lanes,
    /// The least of these.
    pub spread: f32,
}

/// A block whose things look for those of another that are within reach.
pub(crate) struct Query<'a> {
    /// The block.
    pub own: Block<'a>,
    /// The largest squared distance within reach.
    pub limit: f32,
    /// Those of the block that may be within reach of the other's box, bit by bit.
    pub rows: u16,
    /// For each of these rows, which of the other are within reach.
    pub found: [u16; LANES],
    /// The block as seen from the other's middle.
    seen: Vec<Lanes>,
}

impl<'a> Query<'a> {
    /// Nothing is asked yet.
    pub fn new(own: Block<'a>) -> Self {
        let seen = vec![Aligned([0.0; LANES]); own.middle.len()];
        Self { own, limit: 0.0, rows: 0, found: [0; LANES], seen }
    }
}

dispatch! {
    /// Which things of some blocks are within reach of which of another block.
    ///
    /// Those queries are answered that have a bit in `which`. Within reach is who has a squared
    /// distance, plus the spreads of both, of at most the query's limit.
    blocks_near = blocks_near_body(queries: &mut [Query<'_>], which: u16, other: &Block<'_>)
}

#[inline(always)]
fn blocks_near_body<V: Sixteen>(queries: &mut [Query<'_>], which: u16, other: &Block<'_>) {
    let mut left = which;
    while left != 0 {
        let first = left.trailing_zeros() as usize;
        left &= left - 1;
        let second = left.trailing_zeros() as usize;
        left &= left.wrapping_sub(1);
        // Two at a time, as in `lanes_near`.
        match queries.get_disjoint_mut([first, second]) {
            Ok(both) => lanes_near_box::<V, 2>(both, other),
            Err(_) => lanes_near_box::<V, 1>([&mut queries[first]], other),
        }
    }
    left = which;
    while left != 0 {
        lanes_near::<V>(&mut queries[left.trailing_zeros() as usize], other);
        left &= left - 1;
    }
}

/// Find the rows of queries that may be within reach of the other's box.
#[inline(always)]
fn lanes_near_box<V: Sixteen, const N: usize>(queries: [&mut Query<'_>; N], other: &Block<'_>) {
    let dim = other.middle.len();
    let mut sums = queries.each_ref().map(|query| {
        let spreads = V::load(query.own.spreads);
        spreads.plus(V::splat(other.spread))
    });
    let mut answers = queries.map(|query| {
        let Query { own, limit, rows, seen, .. } = query;
        (&own.middle[..dim], &own.offsets[..dim], &mut seen[..dim], V::splat(*limit), rows)
    });
    for (axis, (middle, &half)) in other.middle.iter().zip(&other.half[..dim]).enumerate() {
        let half = V::splat(half);
        for (sum, (own, offsets, seen, ..)) in sums.iter_mut().zip(&mut answers) {
            let moved = V::load(&offsets[axis]).plus(V::splat((own[axis] - middle) as f32));
            moved.store(&mut seen[axis]);
            let gap = moved.abs().minus(half).max(V::splat(0.0));
            *sum = gap.square_plus(*sum);
        }
    }
    for (sum, (.., limit, rows)) in sums.into_iter().zip(answers) {
        *rows = sum.at_most(limit);
    }
}

/// Find for each of a query's rows which of the other are within reach.
#[inline(always)]
fn lanes_near<V: Sixteen>(query: &mut Query<'_>, other: &Block<'_>) {
    let (mut rows, spreads) = (query.rows, query.own.spreads);
    let limit = V::splat(query.limit);
    while rows != 0 {
        // Several at a time, each with sums of its own, hide how long an addition takes.
        let mut next = rows.trailing_zeros() as usize % LANES;
        let row = [(); ROWS].map(|()| {
            if rows != 0 {
                next = rows.trailing_zeros() as usize % LANES;
                rows &= rows - 1;
            }
            next
        });
        let start = |row: usize| V::load(other.spreads).plus(V::splat(spreads[row]));
        let (mut a, mut b, mut c, mut d) =
            (start(row[0]), start(row[1]), start(row[2]), start(row[3]));
        for (seen, target) in query.seen.iter().zip(other.offsets) {
            let target = V::load(target);
            add_way(&mut a, target, seen[row[0]]);
            add_way(&mut b, target, seen[row[1]]);
            add_way(&mut c, target, seen[row[2]]);
            add_way(&mut d, target, seen[row[3]]);
        }
        for (row, sum) in row.into_iter().zip([a, b, c, d]) {
            query.found[row] = sum.at_most(limit);
        }
    }
}

/// How many rows are computed together.
pub(crate) const ROWS: usize = 4;

dispatch! {
    /// Squared distance of one point to each of many, sixteen by sixteen.
    ///
    /// `blocks` holds `from.len()` coordinates of sixteen points, then of the next sixteen.
    /// Returns the largest.
    sweep = sweep_body(from: &[f32], blocks: &[Lanes], out: &mut [Lanes]) -> f32
}

#[inline(always)]
fn sweep_body<V: Sixteen>(from: &[f32], blocks: &[Lanes], out: &mut [Lanes]) -> f32 {
    let mut most = V::splat(0.0);
    for (block, out) in blocks.chunks_exact(from.len()).zip(out) {
        let mut sums = V::splat(0.0);
        for (&at, lanes) in from.iter().zip(block) {
            add_way(&mut sums, V::load(lanes), at);
        }
        most = most.max(sums);
        sums.store(out);
    }
    largest(most)
}

dispatch! {
    /// The largest squared distance of each of [`ROWS`] points to any of many.
    ///
    /// `from` holds the points one after the other, `blocks` the many as for [`sweep`].
    farthest_of_rows = farthest_of_rows_body(
        from: &[f32], dim: usize, blocks: &[Lanes]
    ) -> [f32; ROWS]
}

#[inline(always)]
fn farthest_of_rows_body<V: Sixteen>(from: &[f32], dim: usize, blocks: &[Lanes]) -> [f32; ROWS] {
    let mut most = [V::splat(0.0); ROWS];
    let (first, rest) = from.split_at(dim);
    let (second, rest) = rest.split_at(dim);
    let (third, fourth) = rest.split_at(dim);
    for block in blocks.chunks_exact(dim) {
        let [mut a, mut b, mut c, mut d] = [V::splat(0.0); ROWS];
        let points = first.iter().zip(second).zip(third.iter().zip(fourth));
        for (lanes, ((&p, &q), (&r, &s))) in block.iter().zip(points) {
            let lanes = V::load(lanes);
            add_way(&mut a, lanes, p);
            add_way(&mut b, lanes, q);
            add_way(&mut c, lanes, r);
            add_way(&mut d, lanes, s);
        }
        most = [most[0].max(a), most[1].max(b), most[2].max(c), most[3].max(d)];
    }
    most.map(largest)
}

dispatch! {
    /// Squared distance of one point to each of sixteen, plus `spread` and theirs; exact.
    ///
    /// Distances come first, coordinate by coordinate; spreads are added to their sum.
    bounds = bounds_body(from: &[f64], spread: f64, block: &[Wide], spreads: &Wide) -> Wide
}

#[inline(always)]
fn bounds_body<V: Sixteen>(from: &[f64], spread: f64, block: &[Wide], spreads: &Wide) -> Wide {
    let mut sums = Aligned([0.0; LANES]);
    for (&at, lanes) in from.iter().zip(block) {
        for lane in 0..LANES {
            let way = lanes[lane] - at;
            sums[lane] += way * way;
        }
    }
    for lane in 0..LANES {
        sums[lane] += spreads[lane] + spread;
    }
    sums
}

dispatch! {
    /// The least of a row of the matrix; infinity if it is empty.
    least = least_body(row: &[f64]) -> f64
}

#[inline(always)]
fn least_body<V: Sixteen>(row: &[f64]) -> f64 {
    let (blocks, rest) = row.as_chunks::<32>();
    let mut least = [f64::INFINITY; 32];
    for block in blocks {
        for (least, &value) in least.iter_mut().zip(block) {
            *least = if value < *least { value } else { *least };
        }
    }
    least
        .iter()
        .chain(rest)
        .fold(f64::INFINITY, |a, &b| if b < a { b } else { a })
}

dispatch! {
    /// Raise each element of `row` to that of `other`.
    raise = raise_body(row: &mut [f64], other: &[f64])
}

#[inline(always)]
fn raise_body<V: Sixteen>(row: &mut [f64], other: &[f64]) {
    for (a, &b) in row.iter_mut().zip(other) {
        *a = if b > *a { b } else { *a };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of all signs and sizes, the same each time.
    fn numbers(count: usize) -> impl Iterator<Item = f64> {
        (0..count).map(|i| ((i * 7919 + 13) % 1009) as f64 / 97.0 - 5.0)
    }

    fn lanes(count: usize) -> Vec<Lanes> {
        let all: Vec<f32> = numbers(count * LANES).map(|x| x as f32).collect();
        all.as_chunks().0.iter().copied().map(Aligned).collect()
    }

    fn wide(count: usize) -> Vec<Wide> {
        let all: Vec<f64> = numbers(count * LANES).collect();
        all.as_chunks().0.iter().copied().map(Aligned).collect()
    }

    fn sets() -> [Isa; 3] {
        [Level::Baseline, Level::Avx2, Level::Avx512].map(Isa::up_to)
    }

    #[test]
    fn f64_is_the_same_to_the_last_bit_on_every_set() {
        for dim in [1, 2, 7, 10, 33] {
            let (from, block, spreads): (Vec<f64>, _, _) =
                (numbers(dim).map(|x| x / 3.0).collect(), wide(dim), wide(1)[0]);
            let by_hand: Vec<f64> = (0..LANES)
                .map(|lane| {
                    let mut sum = 0.0;
                    for (x, lanes) in from.iter().zip(&block) {
                        sum += (lanes[lane] - x) * (lanes[lane] - x);
                    }
                    sum + (spreads[lane] + 0.5)
                })
                .collect();
            let row: Vec<f64> = numbers(91).collect();
            for isa in sets() {
                assert_eq!(bounds(isa, &from, 0.5, &block, &spreads).to_vec(), by_hand);
                assert_eq!(least(isa, &row), row.iter().copied().fold(f64::INFINITY, f64::min));
                let mut raised = row.clone();
                raise(isa, &mut raised, &by_hand);
                let wanted = row.iter().zip(&by_hand).map(|(a, b)| a.max(*b));
                assert!(raised.iter().copied().zip(wanted).all(|(a, b)| a == b));
            }
        }
    }

    #[test]
    fn f32_is_within_its_rounding_on_every_set() {
        for dim in [1, 2, 7, 10, 33] {
            let blocks = lanes(3 * dim);
            let from: Vec<f32> = numbers(ROWS * dim).map(|x| (x / 3.0) as f32).collect();
            let exact = |row: usize, block: usize, lane: usize| {
                (0..dim)
                    .map(|k| f64::from(blocks[block * dim + k][lane] - from[row * dim + k]).powi(2))
                    .sum::<f64>()
            };
            for isa in sets() {
                let mut out = vec![Aligned([0.0; LANES]); 3];
                let most = sweep(isa, &from[..dim], &blocks, &mut out);
                for (i, &squared) in out.iter().flat_map(|lanes| &lanes.0).enumerate() {
                    let wanted = exact(0, i / LANES, i % LANES);
                    assert!((f64::from(squared) - wanted).abs() <= rounding(dim) * wanted);
                }
                assert_eq!(most, out.iter().flat_map(|lanes| lanes.0).fold(0.0, f32::max));
                let farthest = farthest_of_rows(isa, &from, dim, &blocks);
                for (row, &squared) in farthest.iter().enumerate() {
                    let wanted = (0..3 * LANES)
                        .map(|i| exact(row, i / LANES, i % LANES))
                        .fold(0.0, f64::max);
                    assert!((f64::from(squared) - wanted).abs() <= rounding(dim) * wanted);
                }
            }
        }
    }

    #[test]
    fn the_sieves_pass_the_same_on_every_set() {
        for dim in [1, 2, 7, 10, 33] {
            // Small whole numbers, of which f32 makes no error, fused or not.
            let whole = |count| -> Vec<Lanes> {
                lanes(count)
                    .iter()
                    .map(|lanes| Aligned(lanes.map(f32::round)))
                    .collect()
            };
            let (offsets, spreads) = (whole(2 * dim), Aligned(whole(1)[0].map(f32::abs)));
            let (own_middle, other_middle) = (vec![3.0; dim], vec![1.0; dim]);
            let half = vec![5.0; dim];
            let spread = spreads.iter().copied().fold(f32::INFINITY, f32::min);
            let block =
                |middle, offsets| Block { middle, half: &half, offsets, spreads: &spreads, spread };
            let own = block(&own_middle, &offsets[..dim]);
            let other = block(&other_middle, &offsets[dim..]);
            for limit in [0.0, 9.0 * dim as f32, 25.0 * dim as f32, 1e9] {
                let all = sets().map(|isa| {
                    let mut queries = [other, own, own].map(Query::new);
                    queries[1..]
                        .iter_mut()
                        .for_each(|query| query.limit = limit);
                    blocks_near(isa, &mut queries, 0b110, &other);
                    queries.map(|query| (query.rows, query.found))
                });
                assert_eq!(all[0], all[1]);
                assert_eq!(all[0], all[2]);
                assert_eq!((all[0][0], all[0][1]), ((0, [0; LANES]), all[0][2]));
                let (rows, found) = all[0][1];
                for row in 0..LANES {
                    let is_asked = rows >> row & 1 != 0;
                    for lane in 0..LANES {
                        let apart: f32 = (0..dim)
                            .map(|k| other.offsets[k][lane] - own.offsets[k][row] - 2.0)
                            .map(|away| away * away) // powi need not be exact
                            .sum();
                        let is_near = apart + spreads[row] + spreads[lane] <= limit;
                        assert_eq!(is_asked && found[row] >> lane & 1 != 0, is_near);
                    }
                }
            }
        }
    }
}
