//! Text to numbers, correctly rounded.

use std::collections::TryReserveError;

/// The result of a scan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scan {
    /// The numbers.
    pub values: Vec<f64>,
    /// The lines that hold numbers, ascending, counted from 0 at the start of the text.
    pub lines: Vec<i64>,
    /// How many numbers each of `lines` holds.
    pub counts: Vec<i64>,
    /// Count of bytes read: whole numbers and the white space around them.
    pub n_bytes: usize,
    /// Whether the token that starts at `n_bytes` is malformed; otherwise the text has ended.
    pub has_bad_token: bool,
}

/// Parse the numbers of `text` until it ends or a token is bad.
///
/// White space is that of ASCII; LF, CR and CR LF end a line. A number is a decimal with an
/// optional sign, fraction and exponent and at least one digit in the mantissa; it is rounded to
/// the nearest f64, ties to even. NaN, infinity and numbers that overflow are bad tokens.
///
/// There is room for `capacity` numbers from the start; more numbers take more time. Takes
/// O(`text.len()`) time; blank lines take no memory.
///
/// # Errors
///
/// If the system refuses memory for the result.
pub fn scan_numbers(text: &[u8], capacity: usize) -> Result<Scan, TryReserveError> {
    let mut scan = Scan::default();
    scan.values.try_reserve_exact(capacity)?;
    let mut line = 0;
    loop {
        let n_lines = skip_white_space(text, &mut scan.n_bytes);
        line += n_lines;
        let rest = &text[scan.n_bytes..];
        if rest.is_empty() {
            return Ok(scan);
        }
        let (value, length) = match fast_float2::parse_partial::<f64, _>(rest) {
            Ok((value, length)) if value.is_finite() && is_end(rest, length) => (value, length),
            _ => {
                scan.has_bad_token = true;
                return Ok(scan);
            }
        };
        scan.values.try_reserve(1)?;
        scan.values.push(value);
        scan.n_bytes += length;
        match scan.counts.last_mut() {
            Some(count) if scan.lines.last() == Some(&line) => *count += 1,
            _ => {
                scan.lines.try_reserve(1)?;
                scan.lines.push(line);
                scan.counts.try_reserve(1)?;
                scan.counts.push(1);
            }
        }
    }
}

/// Whether a token may end at `position`.
fn is_end(text: &[u8], position: usize) -> bool {
    text.get(position).is_none_or(|&byte| is_white_space(byte))
}

/// Whether a byte is white space of ASCII.
pub(crate) fn is_white_space(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t'..=b'\r')
}

/// Move `position` to the end of the white space that starts there; return how many lines end in it.
fn skip_white_space(text: &[u8], position: &mut usize) -> i64 {
    let mut n_lines = 0;
    while let Some(&byte) = text.get(*position).filter(|byte| is_white_space(**byte)) {
        *position += 1;
        // Of CR LF, the LF ends the line.
        let is_cr_of_pair = byte == b'\r' && text.get(*position) == Some(&b'\n');
        n_lines += i64::from(matches!(byte, b'\n' | b'\r') && !is_cr_of_pair);
    }
    n_lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan_all(text: &str) -> Scan {
        scan_numbers(text.as_bytes(), 0).unwrap()
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
                        let scan = scan_all(&format!("{token} 1"));
                        if let Some(expected) = expected {
                            assert_eq!(scan.values.len(), 2, "{token}");
                            assert_eq!(scan.values[0].to_bits(), expected.to_bits(), "{token}");
                        } else if !token.is_empty() {
                            assert!(scan.has_bad_token && scan.values.is_empty(), "{token}");
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
            let scan = scan_all(&token);
            assert_eq!(
                (scan.values.first().copied(), scan.has_bad_token),
                (expected, expected.is_none())
            );
        }
    }

    #[test]
    fn scan_bad_token_stops_at_its_start() {
        for token in [
            "nan", "inf", "-inf", "1_0", "1,5", "0.0-1.5", "1.5.2", "1e", "1e+", "+", "-", ".",
            "e5", "0x10", "1e309", "--1", "1\0", "\u{a0}1", "1\u{a0}", "#", "1d5",
        ] {
            let scan = scan_all(&format!(" 2.5\n\t{token} 3"));
            assert_eq!(
                (scan.values.as_slice(), scan.n_bytes, scan.has_bad_token),
                ([2.5].as_slice(), 6, true),
                "{token}"
            );
        }
    }

    #[test]
    fn scan_lf_cr_and_crlf_end_lines() {
        let scan = scan_all("\n1 2\n3\r\n\r4\x0b\x0c5\r\r\n6");
        assert_eq!(scan.values, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!((scan.lines, scan.counts), (vec![1, 2, 4, 6], vec![2, 1, 2, 1]));
    }

    #[test]
    fn scan_result_does_not_depend_on_capacity() {
        let text = b"  1.25 -3e-2\r\n+.5\r7. \n\n 123456789.5e3 \r\n";
        let whole = scan_numbers(text, 0).unwrap();
        assert_eq!(
            (whole.values.len(), whole.n_bytes, whole.has_bad_token),
            (5, text.len(), false)
        );
        for capacity in 1..=6 {
            assert_eq!(scan_numbers(text, capacity).unwrap(), whole);
        }
    }

    #[test]
    fn scan_blank_lines_take_no_memory() {
        let scan = scan_all(&"\r\n".repeat(5_000));
        assert_eq!((scan.n_bytes, scan.lines.capacity(), scan.counts.capacity()), (10_000, 0, 0));
    }
}
