//! Measure one thread, simulate sixteen that share its jobs, and count comparisons.
//!
//! `cargo run --release --features profile --example scaling -- [POINTS] [mixture | white]`

use std::error::Error;

use mograft_linkage::{Options, Table, linkage, profile};

const DIM: usize = 10;

/// Reproducible numbers, approximately normal (xorshift; Marsaglia 2003).
fn normal(state: &mut u64) -> f32 {
    let mut sum = 0.0;
    for _ in 0..6 {
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        sum += (*state >> 40) as f32 / (1 << 24) as f32;
    }
    (sum - 3.0) * 2.0_f32.sqrt()
}

fn main() -> Result<(), Box<dyn Error>> {
    let argument = |i| std::env::args().nth(i);
    let n: usize = argument(1).unwrap_or("300000".to_owned()).parse()?;
    let spread = if argument(2).is_some_and(|kind| kind == "white") { 0.0 } else { 1.5 };
    let mut state = 1;
    let centres: Vec<f32> = (0..20 * DIM).map(|_| normal(&mut state)).collect();
    let mut points = Vec::with_capacity(n * DIM);
    for i in 0..n {
        for axis in 0..DIM {
            let x = spread * centres[i % 20 * DIM + axis] + normal(&mut state);
            let decay = if spread > 0.0 { (1.0 + axis as f32).sqrt() } else { 1.0 };
            points.push(x / decay);
        }
    }
    let _ = profile::take_phases();
    linkage(Table::rows(&points, DIM), &Options::default())?;
    println!("per point:");
    for (name, count) in profile::take_counts() {
        println!("{:9.1} {name}", count as f64 / n as f64);
    }
    let (mut serial, mut parallel, mut busiest) = (0.0, 0.0, 0.0);
    println!("seconds    {:>8} {:>8} {:>8}", "serial", "jobs", "busiest");
    for (name, phase) in profile::take_phases() {
        println!("{name:10} {:8.2} {:8.2} {:8.2}", phase.serial, phase.parallel, phase.busiest);
        serial += phase.serial;
        parallel += phase.parallel;
        busiest += phase.busiest;
    }
    let total = serial + parallel;
    println!("total      {serial:8.2} {parallel:8.2} {busiest:8.2}");
    println!("serial share {:.1} % of {total:.2} s", 100.0 * serial / total);
    println!("{} threads: {:.1} times", profile::N_SIMULATED, total / (serial + busiest));
    Ok(())
}
