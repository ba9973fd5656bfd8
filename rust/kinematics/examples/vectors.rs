//! Print the time of inner loops with each instruction set, in ms, the median of nine calls.

use std::hint::black_box;
use std::time::Instant;

use glam::{DQuat, DVec2, DVec3, Vec3Swizzles as _};
use mograft_kinematics::balance::{Bases, added_imbalances_with};
use mograft_kinematics::pose::gaps_along_with;
use mograft_machine::instructions::{Isa, Level};

const JOINTS: usize = 11;
const SAMPLES: usize = 10;
const DONORS: usize = 128;
const BASES: usize = 200;

fn main() {
    let angle = |i: usize| (i * i % 9_973) as f64;
    let turns: Vec<DQuat> = (0..2_000 * JOINTS)
        .map(|i| DQuat::from_scaled_axis(DVec3::new(angle(i), angle(i + 1), 1.0)))
        .collect();
    let velocities: Vec<DVec3> = turns.iter().map(|turn| turn.xyz()).collect();
    let candidates: Vec<usize> = (0..32 * 1_024).map(|i| 7 * i % 2_000).collect();
    let counts = [32; 1_024];

    let offsets: Vec<DVec2> = velocities[..2_000 * SAMPLES]
        .iter()
        .map(|v| 0.01 * v.xy())
        .collect();
    let segments: Vec<usize> = (0..BASES).collect();
    let operators: Vec<f64> = (0..BASES * SAMPLES * SAMPLES)
        .map(|i| angle(i).sin())
        .collect();
    let directions: Vec<DVec2> = (0..24)
        .map(|i| DVec2::from_angle(f64::from(i) * std::f64::consts::PI / 24.0))
        .collect();
    let margins: Vec<f64> = (0..BASES * SAMPLES * 48)
        .map(|i| 0.05 * angle(i).cos())
        .collect();
    let bases = Bases {
        segments: &segments,
        n_samples: SAMPLES,
        operators: &operators,
        directions: &directions,
        margins: &margins,
        scale: 0.01,
    };
    let (donors, donor_counts) = (&candidates[..BASES * DONORS], [DONORS; BASES]);

    println!(
        "{:<10} {:>12} {:>16} {:>18}",
        "set", "pose gaps", "velocity gaps", "added imbalances"
    );
    for level in [Level::Baseline, Level::Avx2] {
        let isa = Isa::up_to(level);
        let poses = milliseconds(|| {
            black_box(gaps_along_with(isa, &turns, &turns, JOINTS, &candidates, &counts).is_ok())
        });
        let speeds = milliseconds(|| {
            let (v, joints) = (&velocities, JOINTS);
            black_box(gaps_along_with(isa, v, v, joints, &candidates, &counts).is_ok())
        });
        let balance = milliseconds(|| {
            let found = added_imbalances_with(isa, bases, &offsets, donors, &donor_counts, 1);
            black_box(found.is_ok())
        });
        println!(
            "{:<10} {poses:>12.1} {speeds:>16.1} {balance:>18.1}",
            format!("{:?}", isa.level())
        );
    }
}

fn milliseconds(work: impl Fn() -> bool) -> f64 {
    let mut times = [0.0; 9].map(|_: f64| {
        let start = Instant::now();
        assert!(work());
        1e3 * start.elapsed().as_secs_f64()
    });
    times.sort_unstable_by(f64::total_cmp);
    times[4]
}
