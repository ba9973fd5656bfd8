//! Cluster a million points of a mixture, print the progress, and stop after a given time.
//!
//! `cargo run --release --example million -- [POINTS] [SECONDS]`

use std::error::Error;
use std::ops::ControlFlow;
use std::thread::available_parallelism;
use std::time::{Duration, Instant};

use mograft_linkage::{Options, Table, linkage};

const DIM: usize = 10;

/// A reproducible number from 0 to 1 (xorshift; Marsaglia 2003).
fn uniform(state: &mut u64) -> f32 {
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    (*state >> 40) as f32 / (1 << 24) as f32
}

fn main() -> Result<(), Box<dyn Error>> {
    let argument = |i| std::env::args().nth(i);
    let n: usize = argument(1).unwrap_or("1000000".to_owned()).parse()?;
    let limit = Duration::from_secs(argument(2).unwrap_or("600".to_owned()).parse()?);
    let mut state = 1;
    let centres: Vec<f32> = (0..20 * DIM).map(|_| uniform(&mut state)).collect();
    let mut points = Vec::with_capacity(n * DIM);
    for i in 0..n {
        for axis in 0..DIM {
            let noise: f32 = (0..4).map(|_| uniform(&mut state)).sum();
            points.push(centres[i % 20 * DIM + axis] + 0.2 * noise);
        }
    }
    let start = Instant::now();
    let show = |fraction: f64| {
        eprint!("\r{:5.1} %", 100.0 * fraction);
        if start.elapsed() > limit { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let threads = available_parallelism()?.get();
    let options = Options { threads, progress: Some(&show), ..Options::default() };
    let tree = linkage(Table::rows(&points, DIM), &options)?;
    println!("\r{n} points, {threads} threads: {:.1} s", start.elapsed().as_secs_f64());
    println!("height of the root: {}", tree.last().map_or(0.0, |row| row[2]));
    Ok(())
}
