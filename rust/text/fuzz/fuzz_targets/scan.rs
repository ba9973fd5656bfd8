//! Any text: token by token as the standard library parses numbers, and line by line.
//!
//! The first byte is the room for numbers.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mograft_text::scan_numbers;

/// Whether a token has only the characters that the grammar allows.
fn has_number_characters(token: &[u8]) -> bool {
    token
        .iter()
        .all(|byte| byte.is_ascii_digit() || b"+-.eE".contains(byte))
}

fuzz_target!(|data: &[u8]| {
    let [capacity, text @ ..] = data else { return };
    let scan = scan_numbers(text, usize::from(*capacity)).unwrap();
    assert!(scan.n_bytes <= text.len() && scan.has_bad_token == (scan.n_bytes < text.len()));
    assert!(scan.lines.is_sorted_by(|a, b| a < b) && scan.counts.iter().all(|&n| n > 0));
    assert_eq!(scan.counts.iter().sum::<i64>(), i64::try_from(scan.values.len()).unwrap());

    // Every number is that of the standard library, and the first bad token is none of its.
    let tokens = text
        .split(|byte| matches!(byte, b' ' | b'\t'..=b'\r'))
        .filter(|token| !token.is_empty());
    let parse = |token: &[u8]| {
        let number = std::str::from_utf8(token).ok()?.parse::<f64>().ok()?;
        (has_number_characters(token) && number.is_finite()).then_some(number)
    };
    let parsed: Vec<_> = tokens.map(parse).collect();
    for (number, expected) in scan.values.iter().zip(&parsed) {
        assert_eq!(Some(number.to_bits()), expected.map(f64::to_bits));
    }
    assert_eq!(scan.has_bad_token, parsed.get(scan.values.len()).is_some());
    assert!(parsed.get(scan.values.len()).is_none_or(Option::is_none));
});
