//! Text to numbers, correctly rounded.

use std::collections::TryReserveError;

/// The result of a scan.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Scan {
    /// Count of numbers written.
    pub n_values: usize,
    /// Count of bytes read: whole numbers and the white space around them.
    pub n_bytes: usize,
    /// For each line end that was read, the count of numbers before it.
    pub line_ends: Vec<usize>,
    /// Whether the token that starts at `n_bytes` is malformed.
    pub has_bad_token: bool,
}

/// Parse the numbers of `text` into `out` until the text ends, `out` is full or a token is bad.
///
/// White space is that of ASCII; LF, CR and CR LF end a line. A number is a decimal with an
/// optional sign, fraction and exponent and at least one digit in the mantissa; it is rounded to
/// the nearest f64, ties to even. NaN, infinity and numbers that overflow are bad tokens.
///
/// `is_last` is false if more text will follow: then a number or CR at the very end, which may
/// continue there, is left unread. Takes O(`text.len()`) time and no memory but `line_ends`.
///
/// # Errors
///
/// If the system refuses memory for `line_ends`.
pub fn scan_numbers(text: &[u8], is_last: bool, out: &mut [f64]) -> Result<Scan, TryReserveError> {
    let mut scan = Scan::default();
    loop {
        scan.n_bytes =
            skip_white_space(text, scan.n_bytes, is_last, scan.n_values, &mut scan.line_ends)?;
        let rest = &text[scan.n_bytes..];
        let (Some(&first), Some(slot)) = (rest.first(), out.get_mut(scan.n_values)) else {
            return Ok(scan);
        };
        if first == b'\r' {
            return Ok(scan);
        }
        match fast_float2::parse_partial::<f64, _>(rest) {
            Ok((value, length)) if value.is_finite() && is_complete(rest, length, is_last) => {
                *slot = value;
                scan.n_values += 1;
                scan.n_bytes += length;
            }
            _ => {
                scan.has_bad_token = is_last || !is_prefix_of_number(rest);
                return Ok(scan);
            }
        }
    }
}

/// Whether the number that ends at `length` is certain to end there.
fn is_complete(text: &[u8], length: usize, is_last: bool) -> bool {
    text.get(length)
        .map_or(is_last, |&byte| is_white_space(byte))
}

/// Whether the whole of `text` may be the beginning of a number, or a number.
#[cold]
fn is_prefix_of_number(text: &[u8]) -> bool {
    let skip_digits = |position: usize| {
        let digits = text[position..]
            .iter()
            .take_while(|byte| byte.is_ascii_digit());
        position + digits.count()
    };
    let skip_sign =
        |position: usize| position + usize::from(matches!(text.get(position), Some(b'+' | b'-')));
    let start = skip_sign(0);
    let mut position = skip_digits(start);
    let mut n_digits = position - start;
    if text.get(position) == Some(&b'.') {
        let end = skip_digits(position + 1);
        n_digits += end - position - 1;
        position = end;
    }
    if n_digits > 0 && matches!(text.get(position), Some(b'e' | b'E')) {
        position = skip_digits(skip_sign(position + 1));
    }
    position == text.len()
}

/// Whether a byte is white space of ASCII.
pub(crate) fn is_white_space(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t'..=b'\r')
}

/// Return the end of the white space at `position`; append `n_values` to `line_ends` for each line
/// end in it.
///
/// Unless `is_last`, a CR at the very end is not skipped, because an LF may follow.
fn skip_white_space(
    text: &[u8],
    mut position: usize,
    is_last: bool,
    n_values: usize,
    line_ends: &mut Vec<usize>,
) -> Result<usize, TryReserveError> {
    while let Some(&byte) = text.get(position) {
        if !is_white_space(byte) {
            break;
        }
        let is_line_end = match (byte, text.get(position + 1)) {
            (b'\n', _) => true,
            (b'\r', None) if !is_last => break,
            // Of CR LF, the LF ends the line.
            (b'\r', next) => next != Some(&b'\n'),
            _ => false,
        };
        if is_line_end {
            line_ends.try_reserve(1)?;
            line_ends.push(n_values);
        }
        position += 1;
    }
    Ok(position)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan_all(text: &str) -> (Vec<f64>, Scan) {
        let mut out = vec![f64::NAN; text.len()];
        let scan = scan_numbers(text.as_bytes(), true, &mut out).unwrap();
        out.truncate(scan.n_values);
        (out, scan)
    }

    /// Whether `text` is a number by the grammar, written independently of the code above.
    fn is_number(text: &str) -> bool {
        let unsigned = text.strip_prefix(['+', '-']).unwrap_or(text);
        let (mantissa, exponent) = match unsigned.split_once(['e', 'E']) {
            Some((mantissa, exponent)) => (mantissa, Some(exponent)),
            None => (unsigned, None),
        };
        let is_digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
        let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
        let has_digits =
            is_digits(whole) && is_digits(fraction) && whole.len() + fraction.len() > 0;
        has_digits
            && exponent.is_none_or(|exponent| {
                let power = exponent.strip_prefix(['+', '-']).unwrap_or(exponent);
                !power.is_empty() && is_digits(power)
            })
    }

    #[test]
    fn scan_every_notation_equals_standard_library() {
        let wholes = ["", "0", "7", "007", "123456", "9007199254740993", "18446744073709551616"];
        let fractions = ["", ".", ".0", ".5", ".000000", ".1234567890123456789012345"];
        let powers = ["", "e0", "E5", "e-5", "e+22", "e-23", "e308", "e-320", "e-999999999"];
        for sign in ["", "+", "-"] {
            for whole in wholes {
                for fraction in fractions {
                    for power in powers {
                        let token = format!("{sign}{whole}{fraction}{power}");
                        let expected = token.parse::<f64>().ok().filter(|value| value.is_finite());
                        let (values, scan) = scan_all(&format!("{token} 1"));
                        if let Some(expected) = expected {
                            assert_eq!(values.len(), 2, "{token}");
                            assert_eq!(values[0].to_bits(), expected.to_bits(), "{token}");
                        } else if !token.is_empty() {
                            assert!(scan.has_bad_token && scan.n_values == 0, "{token}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn scan_random_tokens_accepts_exactly_the_grammar() {
        let alphabet = b"0123456789012345++--..eEinfaINFx_,";
        let mut state = 0x9e37_79b9_7f4a_7c15_u64;
        for _ in 0..300_000 {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            let token: String = (0..=state % 9)
                .map(|i| alphabet[(state >> (6 * i)) as usize % alphabet.len()] as char)
                .collect();
            let expected = token
                .parse::<f64>()
                .ok()
                .filter(|value| is_number(&token) && value.is_finite());
            let (values, scan) = scan_all(&token);
            assert_eq!(
                (values.first().copied(), scan.has_bad_token),
                (expected, expected.is_none())
            );
            // If more text may follow, a token is bad only if no number begins with it.
            let open = scan_numbers(token.as_bytes(), false, &mut [0.0]).unwrap();
            let can_continue = ["", "0", "0e0"]
                .iter()
                .any(|more| is_number(&format!("{token}{more}")));
            assert_eq!(open.has_bad_token, !can_continue, "{token}");
            assert_eq!((open.n_values, open.n_bytes), (0, 0));
        }
    }

    #[test]
    fn scan_bad_token_stops_at_its_start() {
        for token in [
            "nan", "inf", "-inf", "1_0", "1,5", "0.0-1.5", "1.5.2", "1e", "1e+", "+", "-", ".",
            "e5", "0x10", "1e309", "--1", "1\0", "\u{a0}1", "1\u{a0}", "#", "1d5",
        ] {
            let (values, scan) = scan_all(&format!(" 2.5\n\t{token} 3"));
            assert_eq!(
                (values.as_slice(), scan.n_bytes, scan.has_bad_token),
                ([2.5].as_slice(), 6, true),
                "{token}"
            );
        }
    }

    #[test]
    fn scan_lf_cr_and_crlf_end_lines() {
        let (values, scan) = scan_all("1 2\n3\r\n\r4\x0b\x0c5\r\r\n");
        assert_eq!(values, [1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!(scan.line_ends, [2, 3, 3, 5, 5]);
    }

    #[test]
    fn scan_text_in_two_pieces_equals_scan_of_whole() {
        let text = b"  1.25 -3e-2\r\n+.5\r7. \n\n 123456789.5e3 \r\n";
        let mut whole = [0.0; 5];
        let scan = scan_numbers(text, true, &mut whole).unwrap();
        assert_eq!((scan.n_values, scan.n_bytes, scan.has_bad_token), (5, text.len(), false));
        for cut in 0..=text.len() {
            for capacity in 0..=5 {
                let mut out = [0.0; 5];
                let first = scan_numbers(&text[..cut], false, &mut out[..capacity]).unwrap();
                let (begun, rest) = out.split_at_mut(first.n_values);
                let second = scan_numbers(&text[first.n_bytes..], true, rest).unwrap();
                let later = second.line_ends.iter().map(|end| end + begun.len());
                let line_ends: Vec<_> = first.line_ends.iter().copied().chain(later).collect();
                assert_eq!((out, line_ends), (whole, scan.line_ends.clone()), "cut at {cut}");
            }
        }
    }
}
