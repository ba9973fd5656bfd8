//! Read points from stdin, one per line, and print the cluster of each.
//!
//! `printf '0 0\n9 9\n1 0\n' | cargo run --example labels -- 2.0`

use std::error::Error;
use std::io::stdin;

use mograft_linkage::{Options, Table, cut};

fn main() -> Result<(), Box<dyn Error>> {
    let diameter = std::env::args().nth(1).unwrap_or("1".to_owned()).parse()?;
    let (mut points, mut dim) = (Vec::new(), 1);
    for line in stdin().lines() {
        let before = points.len();
        for number in line?.split_whitespace() {
            points.push(number.parse::<f64>()?);
        }
        dim = points.len() - before;
    }
    for label in cut(Table::rows(&points, dim), diameter, &Options::default())? {
        println!("{label}");
    }
    Ok(())
}
