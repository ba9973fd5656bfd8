//! Numbers to text: the fewest digits that give the same f64 back.

use std::collections::TryReserveError;
use std::io::Write as _;

use zmij::Buffer;

/// 10^6: a number that is an integer after multiplication by this has at most six decimals.
const DECIMALS_SCALE: f64 = 1e6;

/// Scaled numbers below this have at most 15 significant digits.
///
/// No two decimals of at most 15 digits round to the same f64, so the shortest decimal of such a
/// number is unique.
const MAX_SCALED: f64 = 1e15;

/// Longest text of a number, such as `-2.2250738585072014e-308`, with the space after it.
const MAX_BYTES: usize = 25;

/// Below this, `zmij` writes an exponent or more digits than the standard library.
const MIN_FIXED: f64 = 1e-4;

/// Append rows of `n_columns` numbers to `out`, separated by spaces, each row ending in LF.
///
/// `values` is row-major; a last row may be shorter. Every number has the fewest digits that are
/// parsed back as the same f64, and at least one digit after the point. The exponent form
/// (`1.5e-7`, `1e16`) is used from 1e16 on, and below 1e-4 unless six decimals suffice. If two
/// decimals of the same length are equally near, the one larger in magnitude is written, as the
/// standard library's `{:?}` does. Takes O(`values.len()`) time.
///
/// `values` must be finite: NaN and infinity are written as Rust writes them, `NaN` and `inf`,
/// which [`scan_numbers`](crate::scan_numbers) refuses.
///
/// # Errors
///
/// If the system refuses memory for the text.
pub fn format_rows(
    values: &[f64],
    n_columns: usize,
    out: &mut Vec<u8>,
) -> Result<(), TryReserveError> {
    out.try_reserve(values.len().saturating_mul(20))?;
    let mut buffer = Buffer::new();
    for row in values.chunks(n_columns.max(1)) {
        out.try_reserve(row.len().saturating_mul(MAX_BYTES))?;
        for &value in row {
            push_number(value, &mut buffer, out);
            out.push(b' ');
        }
        out.pop();
        out.push(b'\n');
    }
    Ok(())
}

/// Append one number.
fn push_number(value: f64, buffer: &mut Buffer, out: &mut Vec<u8>) {
    let size = value.abs();
    let scaled = (size * DECIMALS_SCALE).round();
    // The quotient is rounded once: it is the f64 nearest to the decimal of six places.
    let is_short = scaled < MAX_SCALED && scaled / DECIMALS_SCALE == size;
    if is_short && size >= MIN_FIXED {
        out.extend_from_slice(buffer.format_finite(value).as_bytes());
    } else if is_short && size > 0.0 {
        write!(out, "{value}").expect("writing to a vector cannot fail");
    } else {
        write!(out, "{value:?}").expect("writing to a vector cannot fail");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn formatted(value: f64) -> String {
        let mut out = Vec::new();
        push_number(value, &mut Buffer::new(), &mut out);
        String::from_utf8(out).unwrap()
    }

    fn count_digits(text: &str) -> usize {
        let mantissa = text.split('e').next().unwrap_or_default();
        let digits: String = mantissa.chars().filter(char::is_ascii_digit).collect();
        digits.trim_matches('0').len()
    }

    #[test]
    fn format_random_numbers_round_trips_with_fewest_digits() {
        let mut state = 0x9e37_79b9_7f4a_7c15_u64;
        for step in 0..400_000 {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            let random = (state >> 11) as f64;
            let value = match step % 5 {
                0 => f64::from_bits(state),
                1 => (random / 1e7).round() / 1e6 - 450.0,
                2 => random / 1e13 - 450.0,
                3 => (random % 1e6) / 1e6,
                _ => (random % 2e3).round() / 1e7,
            };
            if value.is_finite() {
                let text = formatted(value);
                assert_eq!(text.parse::<f64>().map(f64::to_bits), Ok(value.to_bits()), "{text}");
                let shortest = format!("{value:e}");
                assert!(count_digits(&text) <= count_digits(&shortest), "{text} {shortest}");
            }
        }
    }

    #[test]
    fn format_numbers_of_at_least_1e_4_equals_debug_format() {
        let mut state = 0x2545_f491_4f6c_dd1d_u64;
        for step in 0..400_000 {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            let random = (state >> 11) as f64;
            let value = match step % 4 {
                0 => f64::from_bits(state),
                1 => (random / 1e3).round() / 1e6,
                2 => (random % 1e10).round() / 1e4,
                // Halfway between two decimals of 16 digits, often.
                _ => f64::from((random / 1e13) as f32),
            };
            if value.is_finite() && value.abs() >= MIN_FIXED {
                assert_eq!(formatted(value), format!("{value:?}"));
            }
        }
    }

    #[test]
    fn format_known_numbers_gives_known_text() {
        for (value, expected) in [
            (0.0, "0.0"),
            (-0.0, "-0.0"),
            (1.0, "1.0"),
            (-0.25, "-0.25"),
            (90.0, "90.0"),
            (0.000_001, "0.000001"),
            (-0.000_09, "-0.00009"),
            (0.000_1, "0.0001"),
            (0.000_012_5, "1.25e-5"),
            (-12.345_678, "-12.345678"),
            (999_999_999.999_999, "999999999.999999"),
            (-3_042_277.0 / 32_768.0, "-92.84292602539063"),
            (0.1 + 0.2, "0.30000000000000004"),
            (1e15, "1000000000000000.0"),
            (1e30, "1e30"),
            (1e-40, "1e-40"),
        ] {
            assert_eq!(formatted(value), expected);
        }
    }

    #[test]
    fn format_rows_of_two_columns_gives_one_line_each() {
        let mut out = b"x".to_vec();
        format_rows(&[1.0, 2.0, 3.5, -4.0], 2, &mut out).unwrap();
        assert_eq!(out, b"x1.0 2.0\n3.5 -4.0\n");
    }
}
