//! Text out of numbers.

use std::io::Write as _;

/// Decimals that the short way below tries.
const PLACES: usize = 6;
const SCALE: f64 = 1e6;
/// Decimals of up to 15 digits are all told apart by f64.
const LONGEST: f64 = 1e15;

/// Append rows of `n_columns` numbers to `out`, parted by blanks, each row with a line end.
///
/// Each number has the fewest digits that are read back as it, and at least one after the
/// point; numbers below 1e-5 with more than six decimals, and those from 1e16 on, have an
/// exponent. `values` are finite.
pub fn format_rows(values: &[f64], n_columns: usize, out: &mut Vec<u8>) {
    out.reserve(values.len() * 20);
    for row in values.chunks(n_columns.max(1)) {
        for &value in row {
            push(value, out);
            out.push(b' ');
        }
        out.pop();
        out.push(b'\n');
    }
}

fn push(value: f64, out: &mut Vec<u8>) {
    let size = value.abs();
    let scaled = (size * SCALE).round();
    // The quotient is rounded once, so it is the f64 nearest to the decimal; and no other
    // decimal of so few digits has the same f64.
    if scaled < LONGEST && scaled / SCALE == size {
        if value.is_sign_negative() {
            out.push(b'-');
        }
        push_decimal(scaled as u64, out);
    } else {
        write!(out, "{value:?}").expect("a vector takes all that is written");
    }
}

/// Append `scaled` with the point before its last six digits, without needless zeros.
fn push_decimal(mut scaled: u64, out: &mut Vec<u8>) {
    let mut text = [b'0'; 16];
    let mut start = text.len();
    let mut places = 0;
    while scaled > 0 || places <= PLACES {
        start -= 1;
        if places == PLACES {
            text[start] = b'.';
            start -= 1;
        }
        text[start] = b'0' + (scaled % 10) as u8;
        scaled /= 10;
        places += 1;
    }
    let zeros = text[text.len() - PLACES + 1..]
        .iter()
        .rev()
        .take_while(|&&b| b == b'0')
        .count();
    out.extend_from_slice(&text[start..text.len() - zeros]);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(value: f64) -> String {
        let mut out = Vec::new();
        push(value, &mut out);
        String::from_utf8(out).expect("ASCII")
    }

    #[test]
    fn numbers_come_back_bit_for_bit_in_the_fewest_digits() {
        let digits = |text: &str| {
            let mantissa: String = text
                .split(['e', 'E'])
                .next()
                .unwrap_or("")
                .replace(['.', '-'], "");
            mantissa.trim_matches('0').len()
        };
        let mut state = 1_u64;
        for step in 0..200_000 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            let random = (state >> 11) as f64;
            let value = match step % 4 {
                0 => f64::from_bits(state),
                1 => (random / 1e7).round() / 1e6 - 450.0,
                2 => random / 1e13 - 450.0,
                _ => (random % 1e6) / 1e6,
            };
            if value.is_finite() {
                let text = text(value);
                assert_eq!(text.parse::<f64>().map(f64::to_bits), Ok(value.to_bits()), "{text}");
                assert!(digits(&text) <= digits(&format!("{value:e}")), "{text} {value:e}");
            }
        }
    }

    #[test]
    fn numbers_look_as_they_are_known() {
        for (value, want) in [
            (0.0, "0.0"),
            (-0.0, "-0.0"),
            (1.0, "1.0"),
            (-0.25, "-0.25"),
            (90.0, "90.0"),
            (0.000_001, "0.000001"),
            (-12.345_678, "-12.345678"),
            (999_999_999.999_999, "999999999.999999"),
            (0.1 + 0.2, "0.30000000000000004"),
            (1e30, "1e30"),
            (1e-40, "1e-40"),
        ] {
            assert_eq!(text(value), want);
        }
    }

    #[test]
    fn rows_are_lines() {
        let mut out = b"x".to_vec();
        format_rows(&[1.0, 2.0, 3.5, -4.0], 2, &mut out);
        assert_eq!(out, b"x1.0 2.0\n3.5 -4.0\n");
    }
}
