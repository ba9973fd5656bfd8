"""Cursor over the text of a BVH file: words, line numbers, errors and repairs."""

import codecs
import math
import os
import re
from typing import IO, Any, NoReturn, TypeAlias

from mograft.errors import BvhError

BvhFile: TypeAlias = str | os.PathLike[str] | IO[Any]
"""A path or an open file, text or binary."""

MAX_WORD_BYTES = 1 << 16
_START_BYTES = 4 * MAX_WORD_BYTES

_ENCODING_OF_MARK = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}
_KEYWORDS = {
    word.upper(): word
    for word in (b"HIERARCHY", b"ROOT", b"JOINT", b"End", b"OFFSET", b"CHANNELS", b"MOTION")
}
_WHITE_SPACE = re.compile(rb"[ \t-\r]*")
# Like all patterns for `Cursor.take`: one group, followed by white space.
_WORD = re.compile(rb"([^ \t-\r{}]+|[{}])[ \t-\r]*")
_COMMENT = re.compile(rb"((?:#|//)[^\r\n]*)[ \t-\r]*")
_NUMBER = re.compile(rb"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NOT_FINITE = re.compile(
    rb"[+-]?(?:nan.*|inf(?:inity)?|1\.?#(?:ind|inf|[qs]?nan).*)", re.IGNORECASE
)
_DECIMAL_COMMA = re.compile(rb"[+-]?[0-9]*,[0-9]+(?:[eE][+-]?[0-9]+)?")


class Cursor:
    """A reading position in the text of a BVH file; places are offsets in the text.

    If `strict`, deviations from the format raise an error; see `tolerate`. `label` names the file
    in errors.
    """

    def __init__(self, text: bytes, label: str, *, strict: bool) -> None:
        self.label = label
        self.strict = strict
        self.text = text  # as UTF-8
        self.offset = 0
        self.word_start = 0  # of the last word taken
        # Line and message of the first deviation of each kind, and the number of further ones.
        self._repairs: dict[str, tuple[int, str, int]] = {}
        for mark, encoding in _ENCODING_OF_MARK.items():
            if text.startswith(mark):
                self.text = text[len(mark) :]
                if encoding != "utf-8":
                    try:
                        self.text = self.text.decode(encoding).encode()
                    except UnicodeError as error:
                        self.fail(f"expected UTF-16 text, got invalid bytes: {error}")
                self.tolerate("mark", f"a byte-order mark: the text is {encoding.upper()}")
        self.skip_white_space()

    def skip_white_space(self) -> None:
        """Move to the next word."""
        self.word_start = self.offset = match_end(_WHITE_SPACE, self.text, self.offset)

    def take(self, pattern: re.Pattern[bytes]) -> bytes | None:
        """Match a pattern at the cursor, move after the match and return its first group.

        If the pattern does not match, return None and do not move.
        """
        match = pattern.match(self.text, self.offset)
        self.word_start = self.offset
        if match is None:
            return None
        if match.end(1) - self.offset >= MAX_WORD_BYTES:
            limit = f"a word of fewer than {MAX_WORD_BYTES} characters"
            self.fail(f"expected {limit}, got a longer one")
        self.offset = match.end()
        return match.group(1)

    def skip_text(self, text: bytes) -> bool:
        """Move to the end of `text` if it follows, and a word behind it; return whether it does."""
        end = self.offset + len(text)
        if not self.text.startswith(text, self.offset) or match_end(_WORD, self.text, end) == end:
            return False
        self.offset = end
        return True

    def take_word(self) -> bytes:
        """Return the next word or brace and move after it; at the end of the file return b""."""
        return self.take(_WORD) or b""

    def take_keyword(self) -> bytes:
        """Skip comments, return the next word and move after it.

        Keywords are returned in standard spelling, such as ``End`` for ``END``.
        """
        self.skip_comments()
        word = self.take_word()
        keyword = _KEYWORDS.get(word.upper())
        if keyword is None:
            return word
        if word != keyword:
            text = f"{describe_word(word)} read as {describe_word(keyword)}"
            self.tolerate(f"case {keyword!r}", text)
        return keyword

    def expect(self, keyword: bytes) -> None:
        """Take the next word; raise BvhError unless it is the given keyword or brace."""
        word = self.take_keyword()
        if word == keyword:
            return
        if keyword == b"MOTION" and word == b"ROOT":
            self.fail("expected MOTION, got a second ROOT: a motion has one skeleton with one root")
        self.fail(f"expected {describe_word(keyword)}, got {describe_word(word)}")

    def skip_comments(self) -> None:
        """Move to the next word that does not start a comment."""
        while self.text.startswith((b"#", b"//"), self.offset):
            self.take(_COMMENT)
            self.tolerate("comment", "a comment")

    def take_number(self, meaning: str) -> float:
        """Return the next word as a finite number; errors name `meaning` as expected."""
        return self._to_float(self.take_word(), meaning)

    def take_count(self, meaning: str) -> int:
        """Return the next word as an integer of at least 0; errors name `meaning` as expected."""
        word = self.take_word()
        value = self._to_float(word, meaning)
        if not value.is_integer() or value < 0 or value >= 2**53:
            self.fail(f"expected {meaning}, got {describe_word(word)}")
        if not word.isdigit():
            self.tolerate("count", f"{describe_word(word)} read as {int(value)}")
        return int(value)

    def _to_float(self, word: bytes, meaning: str) -> float:
        value = float(word) if _NUMBER.fullmatch(word) else math.inf
        if math.isinf(value):
            self.fail(f"expected {meaning}, got {describe_number(word)}")
        return value

    def line_and_column(self, place: int) -> tuple[int, int]:
        """Return the line and the column of a place, counted from 1."""
        before = self.text[:place]
        n_line_ends = before.count(b"\n") + before.count(b"\r") - before.count(b"\r\n")
        last = before[max(before.rfind(b"\n"), before.rfind(b"\r")) + 1 :]
        return n_line_ends + 1, len(last.decode("utf-8", "replace")) + 1

    def fail(self, message: str, place: int | None = None, *, line: int | None = None) -> NoReturn:
        """Raise BvhError for a place or a line; the default is the last word taken."""
        at = self.line_and_column(self.word_start if place is None else place)
        raise BvhError(message, self.label, *(at if line is None else (line, 1)))

    def tolerate(
        self, kind: str, message: str, place: int | None = None, *, line: int | None = None
    ) -> None:
        """Add a deviation from the format to `repairs`; raise BvhError instead if strict.

        For each `kind`, only the first message and the number of deviations are kept.
        """
        if self.strict:
            self.fail(f"{message}: refused in strict mode", place, line=line)
        if kind not in self._repairs:
            place = self.word_start if place is None else place
            self._repairs[kind] = line or self.line_and_column(place)[0], message, -1
        first, message, n_more = self._repairs[kind]
        self._repairs[kind] = first, message, n_more + 1

    def repairs(self) -> tuple[str, ...]:
        """Return one text for each kind of tolerated deviation, ordered by line."""
        found = sorted(self._repairs.values(), key=lambda repair: repair[0])
        return tuple(
            f"line {line}: {text}" + (f" (and {n_more} more like it)" if n_more else "")
            for line, text, n_more in found
        )


def open_cursor(file: BvhFile, *, strict: bool) -> Cursor:
    """Return a cursor at the first word of a file: a path, or an open file."""
    if isinstance(file, str | os.PathLike):
        with open(file, "rb") as stream:
            text = stream.read(_START_BYTES)
            if _may_be_bvh(text):  # of another file, which may be endless, the start is enough
                text += stream.read()
        return Cursor(text, os.fspath(file), strict=strict)
    if not hasattr(file, "read"):
        raise TypeError(f"`source` must be a path or a file object, got {type(file).__name__}")
    text, name = file.read(), getattr(file, "name", None)
    text = text.encode("utf-8", "surrogatepass") if isinstance(text, str) else bytes(text)
    return Cursor(text, name if isinstance(name, str) else "<stream>", strict=strict)


def _may_be_bvh(start: bytes) -> bool:
    """Return whether the first word of a file, whose text may be cut, can be HIERARCHY."""
    try:
        cursor = Cursor(start, "", strict=False)
    except BvhError:
        return True  # a character of UTF-16 may be cut
    try:
        cursor.skip_comments()
        return b"HIERARCHY".startswith(cursor.take_word().upper())
    except BvhError:
        return False


def match_end(pattern: re.Pattern[bytes], buffer: bytes, start: int) -> int:
    """Match a pattern at `start` in `buffer`, and return the offset of the end of the match.

    If the pattern does not match, return `start`.
    """
    match = pattern.match(buffer, start)
    return start if match is None else match.end()


def describe_word(word: bytes) -> str:
    """Return a word as printable text for a message, cut after 40 characters.

    An empty word stands for the end of the file.
    """
    if not word:
        return "the end of the file"
    text = word.decode("utf-8", "replace")
    text = text if len(text) <= 40 else text[:40] + "..."
    return text if text.isprintable() else ascii(text)


def describe_number(word: bytes) -> str:
    """Return a word that is not a valid number as text for a message, with the reason if known."""
    text = describe_word(word)
    end = match_end(_NUMBER, word, 0)
    if _NOT_FINITE.fullmatch(word):
        return f"{text}, which is not a finite number"
    if end and end == len(word):
        return f"{text}, which is too large for a double"
    if _DECIMAL_COMMA.fullmatch(word):
        return f"{text} with a decimal comma instead of a point"
    if b"_" in word and _NUMBER.fullmatch(word.replace(b"_", b"")):
        return f"{text} with an underscore"
    if end and _NUMBER.match(word, end):
        return f"{text} without a space before {describe_word(word[end:])}"
    return text
