//! The joints of a BVH hierarchy that are written in the usual form.

use std::collections::TryReserveError;

use crate::scan::is_white_space;

/// Longest name that is read, in bytes.
const MAX_NAME_BYTES: usize = (1 << 16) - 1;

const CHANNELS: [&[u8]; 6] =
    [b"Xposition", b"Yposition", b"Zposition", b"Xrotation", b"Yrotation", b"Zrotation"];

/// A joint whose brace is open.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Open {
    /// Index of the joint.
    pub joint: usize,
    /// Its children so far.
    pub n_children: usize,
    /// Its end sites so far.
    pub n_end_sites: usize,
}

/// The name, the channels and the parent of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Joint {
    /// First byte of the name and the byte after it.
    pub name: (usize, usize),
    /// Line ends before the name.
    pub n_line_ends: usize,
    /// Bytes before the name that follow the last line end.
    pub column: usize,
    /// The channels as digits to base 7, the first the lowest; X, Y, Z position and rotation are 1
    /// to 6.
    pub channels: usize,
    /// Index of the parent.
    pub parent: usize,
}

/// The place of an end site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EndSite {
    /// Index of the joint above it.
    pub parent: usize,
    /// Children of this joint that precede it.
    pub before: usize,
}

/// The joints and end sites at the start of a text, each in the order of the text.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hierarchy {
    /// The joints.
    pub joints: Vec<Joint>,
    /// OFFSET of the joints.
    pub offsets: Vec<[f64; 3]>,
    /// The end sites.
    pub end_sites: Vec<EndSite>,
    /// OFFSET of the end sites.
    pub end_offsets: Vec<[f64; 3]>,
    /// The joints that ended with both children and end sites, or as leaves without exactly one
    /// end site.
    pub unusual: Vec<Open>,
    /// Bytes that were read, with the white space after them.
    pub n_bytes: usize,
}

/// The greatest numbers of joints in a hierarchy.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Joints.
    pub joints: usize,
    /// Joints from the root to the deepest.
    pub levels: usize,
}

/// Read joints and end sites of the usual form until another item follows, a limit is reached, the
/// text ends or no brace is open.
///
/// `text` starts with a word. `open` are the joints with open braces, before and after; the first
/// joint that is read gets the index `n_joints`. In the usual form the keywords have their standard
/// spelling, a name has no white space, a brace opens on the line after the name, and OFFSET
/// precedes CHANNELS. Lines end with LF or CR LF. Takes O(`text.len()`) time.
///
/// # Errors
///
/// If the system refuses memory.
pub fn scan_hierarchy(
    text: &[u8],
    open: &mut Vec<Open>,
    n_joints: usize,
    limits: Limits,
) -> Result<Hierarchy, TryReserveError> {
    let mut found = Hierarchy::default();
    let (mut n_line_ends, mut line_start) = (0, 0);
    while !open.is_empty() {
        let n_levels = open.len();
        let above = &mut open[n_levels - 1];
        let mut words = Words { text, position: found.n_bytes };
        match text.get(found.n_bytes) {
            Some(b'J') => {
                let joint = n_joints.saturating_add(found.joints.len());
                let Some((name, offset, channels)) = words.joint() else { break };
                if joint >= limits.joints || n_levels >= limits.levels {
                    break;
                }
                // Only ASCII characters precede the name on its line, within this text.
                let (column, parent) = (name.0 - line_start, above.joint);
                above.n_children = above.n_children.saturating_add(1);
                push(&mut found.joints, Joint { name, n_line_ends, column, channels, parent })?;
                push(&mut found.offsets, offset)?;
                push(open, Open { joint, ..Open::default() })?;
            }
            Some(b'E') => {
                let Some(offset) = words.end_site() else { break };
                let (parent, before) = (above.joint, above.n_children);
                above.n_end_sites = above.n_end_sites.saturating_add(1);
                push(&mut found.end_sites, EndSite { parent, before })?;
                push(&mut found.end_offsets, offset)?;
            }
            Some(b'}') => {
                let Some(()) = words.closing() else { break };
                if above.n_end_sites != usize::from(above.n_children == 0) {
                    push(&mut found.unusual, *above)?;
                }
                open.pop();
            }
            _ => break,
        }
        for (index, byte) in text[..words.position]
            .iter()
            .enumerate()
            .skip(found.n_bytes)
        {
            if *byte == b'\n' {
                n_line_ends += 1;
                line_start = index + 1;
            }
        }
        found.n_bytes = words.position;
    }
    Ok(found)
}

fn push<T>(items: &mut Vec<T>, item: T) -> Result<(), TryReserveError> {
    items.try_reserve(1)?;
    items.push(item);
    Ok(())
}

/// A position in a text; every method moves it or returns None.
struct Words<'a> {
    text: &'a [u8],
    position: usize,
}

impl Words<'_> {
    /// Name, offset and channels.
    fn joint(&mut self) -> Option<((usize, usize), [f64; 3], usize)> {
        self.keyword(b"JOINT")?;
        self.blanks(1)?;
        let start = self.position;
        let is_name = |byte: &&u8| !is_white_space(**byte) && !matches!(byte, b'{' | b'}');
        let length = self.text[start..].iter().take_while(is_name).count();
        if length == 0 || length > MAX_NAME_BYTES {
            return None;
        }
        self.position += length;
        self.line_end()?;
        self.white_space()?;
        self.keyword(b"{")?;
        self.white_space()?;
        let offset = self.offset()?;
        self.keyword(b"CHANNELS")?;
        let channels = self.channels()?;
        self.white_space()?;
        Some(((start, start + length), offset, channels))
    }

    fn end_site(&mut self) -> Option<[f64; 3]> {
        self.keyword(b"End")?;
        self.blanks(1)?;
        self.keyword(b"Site")?;
        self.line_end()?;
        self.white_space()?;
        self.keyword(b"{")?;
        self.white_space()?;
        let offset = self.offset()?;
        self.closing()?;
        Some(offset)
    }

    fn closing(&mut self) -> Option<()> {
        self.keyword(b"}")?;
        self.white_space()
    }

    /// OFFSET, three numbers, and the white space after them.
    fn offset(&mut self) -> Option<[f64; 3]> {
        self.keyword(b"OFFSET")?;
        let mut offset = [0.0; 3];
        for number in &mut offset {
            let before = self.position;
            self.white_space()?;
            let rest = &self.text[self.position..];
            let (value, length) = fast_float2::parse_partial::<f64, _>(rest).ok()?;
            let is_whole = rest.get(length).is_some_and(|&byte| is_white_space(byte));
            if before == self.position || !is_whole || !f64::is_finite(value) {
                return None;
            }
            *number = value;
            self.position += length;
        }
        self.white_space()?;
        Some(offset)
    }

    /// The number of channels and their names, on one line, with its end; see [`Joint::channels`].
    fn channels(&mut self) -> Option<usize> {
        self.blanks(1)?;
        let count = usize::from(self.text.get(self.position)?.wrapping_sub(b'0'));
        self.position += 1;
        if count > CHANNELS.len() {
            return None;
        }
        let (mut channels, mut used, mut place) = (0, [false; CHANNELS.len()], 1);
        for _ in 0..count {
            self.blanks(1)?;
            let rest = &self.text[self.position..];
            let index = CHANNELS.iter().position(|name| rest.starts_with(name))?;
            if std::mem::replace(&mut used[index], true) {
                return None;
            }
            channels += place * (index + 1);
            place *= CHANNELS.len() + 1;
            self.position += CHANNELS[index].len();
        }
        self.line_end()?;
        Some(channels)
    }

    fn keyword(&mut self, word: &[u8]) -> Option<()> {
        self.text[self.position..]
            .starts_with(word)
            .then(|| self.position += word.len())
    }

    /// At least `least` blanks or tabs.
    fn blanks(&mut self, least: usize) -> Option<()> {
        let rest = &self.text[self.position..];
        let count = rest
            .iter()
            .take_while(|byte| matches!(byte, b' ' | b'\t'))
            .count();
        self.position += count;
        (count >= least).then_some(())
    }

    /// Blanks, and LF or CR LF.
    fn line_end(&mut self) -> Option<()> {
        self.blanks(0)?;
        self.keyword(b"\n").or_else(|| self.keyword(b"\r\n"))
    }

    /// Any white space, but no CR without LF.
    fn white_space(&mut self) -> Option<()> {
        while let Some(&byte) = self.text.get(self.position) {
            if !is_white_space(byte) {
                break;
            }
            if byte == b'\r' && self.text.get(self.position + 1) != Some(&b'\n') {
                return None;
            }
            self.position += 1;
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "JOINT a\n{\n\tOFFSET 1 -2.5 3e1\n\tCHANNELS 2 Zrotation Xposition\r\n\t\
                        End Site\n\t{ OFFSET 0 4 0 } }\n JOINT b\n { OFFSET 0 0 0\nCHANNELS 0\n";

    const LIMITS: Limits = Limits { joints: 9, levels: 9 };

    fn scan(text: &str, n_open: usize) -> (Hierarchy, Vec<Open>) {
        let mut open = (0..n_open)
            .map(|joint| Open { joint, ..Open::default() })
            .collect();
        (scan_hierarchy(text.as_bytes(), &mut open, n_open, LIMITS).unwrap(), open)
    }

    #[test]
    fn usual_items_are_read_with_their_places() {
        let (found, open) = scan(TEXT, 1);
        assert_eq!(found.n_bytes, TEXT.len());
        assert_eq!(
            (&found.offsets[..], &found.end_offsets[..]),
            (&[[1.0, -2.5, 30.0], [0.0; 3]][..], &[[0.0, 4.0, 0.0]][..])
        );
        let [a, b] = found.joints[..] else { panic!("{:?}", found.joints) };
        assert_eq!((&TEXT[a.name.0..a.name.1], a.n_line_ends, a.column, a.parent), ("a", 0, 6, 0));
        assert_eq!((&TEXT[b.name.0..b.name.1], b.n_line_ends, b.column, b.parent), ("b", 6, 7, 0));
        assert_eq!((a.channels, b.channels), (6 + 7, 0));
        assert_eq!(found.end_sites, [EndSite { parent: 1, before: 0 }]);
        assert_eq!(found.unusual, []);
        let root = Open { joint: 0, n_children: 2, n_end_sites: 0 };
        assert_eq!(open, [root, Open { joint: 2, ..Open::default() }]);
    }

    #[test]
    fn limits_are_not_exceeded() {
        let chain = "JOINT a\n{ OFFSET 0 0 0\nCHANNELS 0\n".repeat(5);
        for (joints, levels) in [(3, 9), (9, 3), (3, 3)] {
            let mut open = vec![Open::default()];
            let limits = Limits { joints, levels };
            let found = scan_hierarchy(chain.as_bytes(), &mut open, 1, limits).unwrap();
            assert_eq!((found.joints.len(), open.len()), (2, 3));
            assert_eq!(found.n_bytes, chain.len() / 5 * 2);
        }
    }

    #[test]
    fn joints_without_end_or_with_several_are_listed() {
        let (found, open) = scan("} End Site\n{ OFFSET 0 0 0 }\nEnd Site\n{ OFFSET 0 0 0 } }", 2);
        let several = Open { joint: 0, n_children: 0, n_end_sites: 2 };
        assert_eq!(found.unusual, [Open { joint: 1, ..Open::default() }, several]);
        assert_eq!(open, []);
    }

    #[test]
    fn other_forms_are_left_unread() {
        for text in [
            "joint a\n{\nOFFSET 0 0 0\nCHANNELS 0\n",
            "JOINT a b\n{\nOFFSET 0 0 0\nCHANNELS 0\n",
            "JOINT a {\nOFFSET 0 0 0\nCHANNELS 0\n",
            "JOINT a\r{\nOFFSET 0 0 0\nCHANNELS 0\n",
            "JOINT a\n{\nOFFSET 0 0 1e999\nCHANNELS 0\n",
            "JOINT a\n{\nOFFSET 0 0 nan\nCHANNELS 0\n",
            "JOINT a\n{\nOFFSET 0 0 0,5\nCHANNELS 0\n",
            "JOINT a\n{\nOFFSET 0 0 0\nCHANNELS 2 Xrotation\n",
            "JOINT a\n{\nOFFSET 0 0 0\nCHANNELS 2 Xrotation Xrotation\n",
            "JOINT a\n{\nOFFSET 0 0 0\nCHANNELS 1 XrotationYrotation\n",
            "JOINT a\n{\nOFFSET 0 0 0\nCHANNELS 7\n",
            "JOINT a\n{\nOFFSET 0 0 0\nCHANNELS 1",
            "JOINT a\n{\nCHANNELS 0\nOFFSET 0 0 0\n",
            "JOINT\n{\nOFFSET 0 0 0\nCHANNELS 0\n",
            "End Site b\n{\nOFFSET 0 0 0\n}\n",
            "End Site\n{\nOFFSET 0 0 0",
            "MOTION",
            "",
        ] {
            assert_eq!(scan(text, 1).0, Hierarchy::default(), "{text}");
        }
        assert_eq!(scan("} } MOTION", 2).0.n_bytes, 4);
        assert_eq!(scan("} } }", 1).0.n_bytes, 2);
    }

    #[test]
    fn any_cut_of_a_text_gives_a_prefix_of_its_joints() {
        let (all, _) = scan(TEXT, 1);
        for cut in 0..TEXT.len() {
            let (found, _) = scan(&TEXT[..cut], 1);
            assert_eq!(found.joints[..], all.joints[..found.joints.len()], "{cut}");
            assert_eq!(found.end_sites[..], all.end_sites[..found.end_sites.len()], "{cut}");
        }
    }
}
