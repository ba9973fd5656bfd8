//! Kernels return an error, and do not abort, whichever large allocation the system refuses.
#![allow(unsafe_code, reason = "an allocator is unsafe code")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::fmt::Debug;

use glam::{DQuat, DVec2, DVec3};
use mograft_kinematics::balance::{Bases, added_imbalances};
use mograft_kinematics::gradient::{Donors, Objective, smooth_gradient};
use mograft_kinematics::keyframes::{Interpolation, KeyTimes, Track, sample_keys};
use mograft_kinematics::offset::{Offsets, PieceTimes, add_offsets};
use mograft_kinematics::{
    capsule, derivatives, energy, forward, pose, resample, rotation, sample, value,
};

/// Size from which an allocation counts as large.
const LARGE: usize = 1 << 14;

thread_local! {
    /// Large allocations until the one that is refused; negative afterwards.
    static REMAINING: Cell<i64> = const { Cell::new(i64::MAX) };
}

struct Refusing;

/// Whether the allocation of this size is refused.
fn is_refused(size: usize) -> bool {
    if size < LARGE {
        return false;
    }
    REMAINING.with(|remaining| {
        remaining.set(remaining.get().saturating_sub(1));
        remaining.get() == -1
    })
}

// SAFETY: every call is passed on to the allocator of the system, or returns null, which an
// allocator may.
unsafe impl GlobalAlloc for Refusing {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if is_refused(layout.size()) {
            return std::ptr::null_mut();
        }
        // SAFETY: the caller's contract is that of the system's allocator.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Refusing = Refusing;

/// Run a kernel with each of its large allocations refused in turn, then without refusal.
fn refuse_each<T: Debug, E: Debug>(name: &str, kernel: impl Fn() -> Result<T, E>) {
    for n in 0..100 {
        REMAINING.set(n);
        let result = kernel();
        let is_reached = REMAINING.replace(i64::MAX) < 0;
        match result {
            Ok(_) if n == 0 => panic!("{name} has no large allocation"),
            Ok(_) if !is_reached => return,
            Ok(_) => panic!("{name} ignores that allocation {n} was refused"),
            Err(error) => {
                let text = format!("{error:?}");
                assert!(
                    ["OutOfMemory", "AllocError", "Refused"]
                        .iter()
                        .any(|e| text.contains(e)),
                    "{name}: {text}"
                );
            }
        }
    }
    panic!("{name} has too many large allocations");
}

const FRAMES: usize = 4_000;
const JOINTS: usize = 3;

#[test]
fn every_kernel_survives_every_refused_allocation() {
    let quats = vec![DQuat::IDENTITY; FRAMES * JOINTS];
    let vecs: Vec<DVec3> = (0..FRAMES * JOINTS)
        .map(|i| DVec3::splat((i % 97) as f64))
        .collect();
    let numbers = vec![0.5; FRAMES * JOINTS];
    let times: Vec<f64> = (0..FRAMES).map(|i| i as f64).collect();
    let inner: Vec<f64> = times.iter().map(|t| t + 0.5).collect();
    let zeros = vec![0; FRAMES];
    let frames: Vec<usize> = (0..FRAMES).collect();
    let parents = [-1, 0, 1];

    refuse_each("memory", || mograft_machine::memory::copy(&numbers));
    refuse_each("from_euler", || rotation::from_euler(&numbers, &[0, 1, 2], FRAMES));
    refuse_each("to_euler", || rotation::to_euler(&quats, [0, 1, 2], [0.0; 3]));
    refuse_each("from_channels", || {
        rotation::from_channels(&numbers, JOINTS, &[0, 1, 2, 3], &[(0, 0), (1, 1), (2, 2)], 1.0)
    });
    refuse_each("slerp", || resample::slerp(&times, &quats, JOINTS, &inner));
    refuse_each("cubic", || resample::cubic(&times, &quats, JOINTS, &inner));
    refuse_each("segments", || resample::segments(&quats, JOINTS, &[0], &[FRAMES - 1], &[FRAMES]));
    refuse_each("sample_clips", || resample::sample_clips(&[&vecs[..]], JOINTS, &zeros, &inner));
    refuse_each("clip_states", || resample::clip_states(&[&vecs[..]], JOINTS, &zeros, &frames));
    refuse_each("world", || forward::world(&parents, &quats, &vecs));
    refuse_each("local", || forward::local(&parents, &quats, &vecs));
    refuse_each("continuous_signs", || rotation::continuous_signs(&quats, JOINTS));
    let keys = KeyTimes { seconds: &times, starts: &[0, FRAMES] };
    let track = Track { start: 0, times: 0, interpolation: Interpolation::Linear };
    refuse_each("sample_keys", || sample_keys(&inner, keys, &vecs, &[track]));
    refuse_each("kinetic_energy", || {
        energy::kinetic_energy(&parents, &quats, &[1.0; 3], 0.1, energy::Omega::World)
    });
    refuse_each("greatest_derivatives", || {
        derivatives::greatest_derivatives(&quats, JOINTS, &[0, 2])
    });
    refuse_each("world_jerk", || derivatives::world_jerk(&parents, &quats, &vecs, &[0, 1, 2]));
    refuse_each("pose_gaps", || pose::pose_gaps(&quats[..300], &quats[..6000], JOINTS));
    refuse_each("velocity_gaps", || pose::velocity_gaps(&vecs[..300], &vecs[..6000], JOINTS));
    refuse_each("pose_gaps_along", || {
        pose::pose_gaps_along(&quats, &quats, JOINTS, &frames[..400], &[100, 300])
    });
    let bases = Bases {
        segments: &[0],
        n_samples: 1,
        operators: &[1.0],
        directions: &[DVec2::X],
        margins: &[0.1, 0.1],
        scale: 0.01,
    };
    refuse_each("added_imbalances", || {
        added_imbalances(bases, &[DVec2::ZERO], &zeros, &[FRAMES], 1)
    });
    refuse_each("distances", || sample::distances(&numbers, 1, &zeros, &frames));
    refuse_each("capsule_ends", || {
        capsule::capsule_ends(&quats, &vecs, JOINTS, &[0, 1], &[DVec3::X, DVec3::Y])
    });
    let ends = &vecs[..FRAMES * 2];
    refuse_each("clearance", || capsule::clearance(ends, &[1.0], ends, &[1.0], &frames, &[(0, 0)]));
    refuse_each("clearance without pairs", || {
        capsule::clearance(ends, &[1.0], ends, &[1.0], &frames, &[])
    });
    refuse_each("box_clearance", || {
        capsule::box_clearance(ends, &[1.0], DVec3::ZERO, DVec3::ONE, DQuat::IDENTITY)
    });
    refuse_each("replace_joints", || {
        value::replace_joints(&vecs, JOINTS, &vecs[JOINTS..][..FRAMES], &[1], DVec3::ZERO)
    });
    let rows = sample::Rows { numbers: &numbers, width: 6, n_samples: 1, n_joints: 1 };
    refuse_each("features", || sample::features(rows, &[0], &[DQuat::IDENTITY], 2, 2));
}

#[test]
fn seams_survive_every_refused_allocation() {
    let vecs: Vec<DVec3> = (0..FRAMES * JOINTS)
        .map(|i| DVec3::splat((i % 97) as f64))
        .collect();
    let (starts, stops) = ([0, 1_999], [1_999, FRAMES - 1]);
    let rows: Vec<DVec3> = vecs
        .iter()
        .chain(&vecs[..JOINTS])
        .map(|v| *v * 2.0)
        .collect();
    let accelerations = [DVec3::ZERO; JOINTS];
    let donors = Donors {
        starts: &starts,
        stops: &stops,
        rows: &rows,
        seams: &[0],
        accelerations: [&accelerations; 2],
    };
    let objective = Objective { weights: [1.0; 3], reach: 100.0, n_fixed: 1, spread: 4.0 };
    refuse_each("smooth_gradient", || {
        // An error leaves the values unchanged, so one copy per call is outside of the count.
        let remaining = REMAINING.replace(i64::MAX);
        let mut values = vecs.clone();
        REMAINING.set(remaining);
        let result = smooth_gradient(&mut values, JOINTS, donors, objective);
        assert!(result.is_ok() || values == vecs);
        result
    });
    let (piece, elapsed) = (vec![0; FRAMES], vec![0.5; FRAMES]);
    let times = PieceTimes { piece: &piece, elapsed: &elapsed, left: &elapsed, windows: &[1.0] };
    let none = Offsets { values: &[], rates: &[] };
    refuse_each("add_offsets", || add_offsets(&vecs, JOINTS, times, none, none));
}

#[test]
fn text_and_trellis_survive_every_refused_allocation() {
    let numbers = vec![0.123_456_789_012_345_6; 2_000];
    refuse_each("format_rows", || {
        let mut text = Vec::new();
        mograft_text::format_rows(&numbers, 3, &mut text)
    });
    let long = vec![-2.225_073_858_507_201_4e-308; 2_000];
    refuse_each("format_rows of long numbers", || {
        let mut text = Vec::new();
        mograft_text::format_rows(&long, 3, &mut text)
    });
    let lines = "1\n".repeat(5_000);
    refuse_each("scan_numbers", || mograft_text::scan_numbers(lines.as_bytes(), 2_500));
    let (counts, unary) = ([2_100, 2_100], vec![1.0; 4_200]);
    let pairwise = vec![1.0; 2_100 * 2_100];
    let trellis = mograft_trellis::Trellis { counts: &counts, unary: &unary, pairwise: &pairwise };
    let (ones, marks) = (vec![1; 4_200], vec![false; 4_200]);
    refuse_each("keep_cheapest", || {
        mograft_trellis::keep_cheapest(&[4_200], &unary, &marks, 4_000)
    });
    refuse_each("keep_cheapest of one candidate each", || {
        mograft_trellis::keep_cheapest(&ones, &unary, &marks, 1)
    });
    refuse_each("sample", || mograft_trellis::sample(trellis, 1.0, &[0.5, 0.5]));
}
