//! Any numbers: the text is read back bit for bit, and has no more digits than the standard
//! library writes.
//!
//! The first byte is the count of columns.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mograft_text::{format_rows, scan_numbers};

fn count_digits(text: &str) -> usize {
    let mantissa = text.split(['e', 'E']).next().unwrap_or_default();
    let digits: String = mantissa.chars().filter(char::is_ascii_digit).collect();
    digits.trim_matches('0').len()
}

fuzz_target!(|data: &[u8]| {
    let [n_columns, rest @ ..] = data else { return };
    let n_columns = usize::from(*n_columns);
    let numbers: Vec<f64> = (rest.as_chunks::<8>().0.iter())
        .map(|bytes| f64::from_le_bytes(*bytes))
        .filter(|number| number.is_finite())
        .collect();
    let mut text = Vec::new();
    format_rows(&numbers, n_columns, &mut text).unwrap();
    let scan = scan_numbers(&text, numbers.len()).unwrap();
    assert_eq!((scan.values.len(), scan.n_bytes), (numbers.len(), text.len()));
    assert_eq!(scan.lines.len(), numbers.len().div_ceil(n_columns.max(1)));
    for (number, back) in numbers.iter().zip(&scan.values) {
        assert_eq!(number.to_bits(), back.to_bits());
    }
    let text = String::from_utf8(text).unwrap();
    for (token, number) in text.split_ascii_whitespace().zip(&numbers) {
        assert!(count_digits(token) <= count_digits(&format!("{number:e}")), "{token}");
    }
});
