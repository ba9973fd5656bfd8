//! Any text: in pieces as at once, and token by token as the standard library parses numbers.
//!
//! The first byte is where the text is cut, the second the room for numbers.
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
    let [cut, room, text @ ..] = data else { return };
    let (cut, room) = (usize::from(*cut).min(text.len()), usize::from(*room));
    let mut whole = vec![0.0; room];
    let scan = scan_numbers(text, true, &mut whole).unwrap();
    assert!(scan.n_values <= room && scan.n_bytes <= text.len());
    assert!(scan.line_ends.is_sorted() && scan.line_ends.iter().all(|&n| n <= scan.n_values));

    // Every number is that of the standard library, and the first bad token is none of its.
    let tokens = text
        .split(|byte| matches!(byte, b' ' | b'\t'..=b'\r'))
        .filter(|token| !token.is_empty());
    let parse = |token: &[u8]| {
        let number = std::str::from_utf8(token).ok()?.parse::<f64>().ok()?;
        (has_number_characters(token) && number.is_finite()).then_some(number)
    };
    let parsed: Vec<_> = tokens.map(parse).collect();
    for (number, expected) in whole[..scan.n_values].iter().zip(&parsed) {
        assert_eq!(Some(number.to_bits()), expected.map(f64::to_bits));
    }
    if scan.n_values < room {
        assert_eq!(scan.has_bad_token, parsed.get(scan.n_values).is_some());
        assert!(parsed.get(scan.n_values).is_none_or(Option::is_none));
    }

    // The text in two pieces gives the same numbers and lines.
    let mut pieces = vec![0.0; room];
    let first = scan_numbers(&text[..cut], false, &mut pieces).unwrap();
    if first.has_bad_token {
        assert!(scan.has_bad_token || scan.n_values == room);
        return;
    }
    let second = scan_numbers(&text[first.n_bytes..], true, &mut pieces[first.n_values..]).unwrap();
    assert_eq!(first.n_values + second.n_values, scan.n_values);
    assert_eq!(first.n_bytes + second.n_bytes, scan.n_bytes);
    let bits = |numbers: &[f64]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&pieces), bits(&whole));
    let later = second.line_ends.iter().map(|n| n + first.n_values);
    assert_eq!(
        first
            .line_ends
            .iter()
            .copied()
            .chain(later)
            .collect::<Vec<_>>(),
        scan.line_ends
    );
});
