//! Numbers out of text, exactly rounded.

/// How far a scan came.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Scan {
    /// Numbers written.
    pub values: usize,
    /// Bytes read: whole numbers and the white space around them.
    pub bytes: usize,
    /// For each line end that was read, how many of the numbers stand before it.
    pub line_ends: Vec<usize>,
    /// Whether what stands at `bytes` begins no number.
    pub bad: bool,
}

/// Powers of ten that an f64 holds exactly.
const TENS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
    1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
];

/// Read the numbers of `text` into `out`, until either ends or a token is no number.
///
/// White space is that of ASCII; LF, CR and CR LF end a line. A number is a decimal with an
/// optional sign, fraction and exponent and at least one digit; it is rounded to the nearest
/// f64. NaN, infinity and what overflows to it are bad tokens.
///
/// With `last` false more text will follow: a number or CR at the very end, which may go on
/// there, is left unread.
pub fn scan_numbers(text: &[u8], last: bool, out: &mut [f64]) -> Scan {
    let mut scan = Scan::default();
    loop {
        scan.bytes = skip_white(text, scan.bytes, last, scan.values, &mut scan.line_ends);
        let rest = &text[scan.bytes..];
        let ahead = rest.first().copied();
        let (Some(first), Some(slot)) = (ahead, out.get_mut(scan.values)) else {
            return scan;
        };
        if first == b'\r' {
            return scan;
        }
        let (length, value) = number(rest);
        match rest.get(length) {
            None if !last => return scan,
            Some(byte) if !is_white(*byte) => scan.bad = true,
            _ => {}
        }
        match value {
            Some(value) if !scan.bad => *slot = value,
            _ => {
                scan.bad = true;
                return scan;
            }
        }
        scan.values += 1;
        scan.bytes += length;
    }
}

fn is_white(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t'..=b'\r')
}

/// Skip white space from `at` on, noting line ends; a last CR is kept if an LF may follow.
fn skip_white(
    text: &[u8],
    mut at: usize,
    last: bool,
    values: usize,
    line_ends: &mut Vec<usize>,
) -> usize {
    while let Some(&byte) = text.get(at) {
        if !is_white(byte) {
            break;
        }
        let ends = match (byte, text.get(at + 1)) {
            (b'\n', _) => true,
            (b'\r', None) if !last => break,
            // The LF of a CR LF ends the line.
            (b'\r', next) => next != Some(&b'\n'),
            _ => false,
        };
        if ends {
            line_ends.push(values);
        }
        at += 1;
    }
    at
}

/// The number that `text` begins with, and its length; none if there is none or it overflows.
///
/// The length reaches to where the grammar stops, whether or not that made a number.
fn number(text: &[u8]) -> (usize, Option<f64>) {
    let mut at = usize::from(matches!(text.first(), Some(b'+' | b'-')));
    let (whole, length) = digits(text, at, 0);
    at += length;
    let (mut mantissa, mut places) = (whole, 0);
    if text.get(at) == Some(&b'.') {
        (mantissa, places) = digits(text, at + 1, whole);
        at += 1 + places;
    }
    let n_digits = length + places;
    if n_digits == 0 {
        return (at, None);
    }
    let mut exponent = 0;
    if let Some(b'e' | b'E') = text.get(at) {
        at += 1;
        let negative = text.get(at) == Some(&b'-');
        at += usize::from(matches!(text.get(at), Some(b'+' | b'-')));
        let (power, length) = digits(text, at, 0);
        at += length;
        if length == 0 {
            return (at, None);
        }
        // Beyond two digits the slow way below is taken in any case.
        let power = if length > 2 { 999 } else { power as i32 };
        exponent = if negative { -power } else { power };
    }
    let scale = |power: i32| TENS.get(power.unsigned_abs() as usize);
    let power = exponent.checked_sub_unsigned(u32::try_from(places).unwrap_or(u32::MAX));
    // Up to 19 digits do not overflow; a mantissa up to 2^53 and these powers of ten are
    // exact, so that one operation rounds once (Clinger 1990).
    let exact = n_digits <= 19 && mantissa <= 1 << 53;
    let value = match power.and_then(|power| Some((power, scale(power)?))) {
        Some((power, scale)) if exact => {
            let size = mantissa as f64;
            let size = if power < 0 { size / scale } else { size * scale };
            // Half of all signs would be guessed wrong by a branch.
            let sign = u64::from(text[0] == b'-') << 63;
            Some(f64::from_bits(size.to_bits() | sign))
        }
        _ => str::from_utf8(&text[..at])
            .ok()
            .and_then(|token| token.parse().ok()),
    };
    (at, value.filter(|value: &f64| value.is_finite()))
}

/// Append the digits that stand at `at` to `before`, modulo 2^64; how many they are.
fn digits(text: &[u8], at: usize, before: u64) -> (u64, usize) {
    let (mut value, mut length) = (before, 0);
    for byte in text.get(at..).unwrap_or_default() {
        let digit = byte.wrapping_sub(b'0');
        if digit > 9 {
            break;
        }
        value = value.wrapping_mul(10).wrapping_add(u64::from(digit));
        length += 1;
    }
    (value, length)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scanned(text: &str) -> (Vec<f64>, Scan) {
        let mut out = vec![f64::NAN; text.len()];
        let scan = scan_numbers(text.as_bytes(), true, &mut out);
        out.truncate(scan.values);
        (out, scan)
    }

    #[test]
    fn every_way_to_write_a_number_gives_what_the_standard_library_reads() {
        let wholes = ["", "0", "7", "007", "123456", "9007199254740993", "18446744073709551616"];
        let fractions = ["", ".", ".0", ".5", ".000000", ".1234567890123456789012345"];
        let powers = ["", "e0", "E5", "e-5", "e+22", "e-23", "e308", "e-320", "e-999999999"];
        for sign in ["", "+", "-"] {
            for whole in wholes {
                for fraction in fractions {
                    for power in powers {
                        let token = format!("{sign}{whole}{fraction}{power}");
                        let want = token.parse::<f64>().ok().filter(|value| value.is_finite());
                        let (got, scan) = scanned(&format!("{token} 1"));
                        if let Some(want) = want {
                            assert_eq!(got.len(), 2, "{token}");
                            assert_eq!(got[0].to_bits(), want.to_bits(), "{token}");
                        } else if !token.is_empty() {
                            assert!(scan.bad && scan.values == 0, "{token}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn what_is_no_number_is_bad_where_it_begins() {
        for token in [
            "nan", "inf", "-inf", "1_0", "1,5", "0.0-1.5", "1.5.2", "1e", "1e+", "+", "-", ".",
            "e5", "0x10", "1e309", "--1", "1\0", "\u{a0}1", "1\u{a0}", "#", "1d5",
        ] {
            let (got, scan) = scanned(&format!(" 2.5\n\t{token} 3"));
            assert_eq!(
                (got.as_slice(), scan.bytes, scan.bad),
                ([2.5].as_slice(), 6, true),
                "{token}"
            );
        }
    }

    #[test]
    fn lines_end_with_lf_cr_or_both() {
        let (values, scan) = scanned("1 2\n3\r\n\r4\x0b\x0c5\r\r\n");
        assert_eq!(values, [1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!(scan.line_ends, [2, 3, 3, 5, 5]);
    }

    #[test]
    fn text_in_pieces_gives_the_same_as_the_whole() {
        let text = b"  1.25 -3e-2\r\n+.5\r7. \n\n 123456789.5e3 \r\n";
        let mut whole = [0.0; 5];
        let all = scan_numbers(text, true, &mut whole);
        assert_eq!((all.values, all.bytes, all.bad), (5, text.len(), false));
        for cut in 0..=text.len() {
            for room in 0..=5 {
                let mut out = [0.0; 5];
                let first = scan_numbers(&text[..cut], false, &mut out[..room]);
                let (begun, rest) = out.split_at_mut(first.values);
                let second = scan_numbers(&text[first.bytes..], true, rest);
                let later = second.line_ends.iter().map(|end| end + begun.len());
                let line_ends: Vec<_> = first.line_ends.iter().copied().chain(later).collect();
                assert_eq!((out, line_ends), (whole, all.line_ends.clone()), "cut at {cut}");
            }
        }
    }
}
