"""Cursor over the text of a BVH file: words, line numbers, errors and repairs."""

import codecs
import math
import os
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any, NoReturn, TypeAlias

from mograft.errors import BvhError

BvhFile: TypeAlias = str | os.PathLike[str] | IO[Any]
"""A path or an open file, text or binary."""

Position: TypeAlias = tuple[int, int]
"""Line and column, counted from 1."""

# The reader holds about this many bytes of the text at a time. They fit in the cache.
CHUNK_BYTES = 1 << 18
# Maximum length of a word. The buffer holds at least this much text after the cursor, up to the
# end of the file.
MAX_WORD_BYTES = 1 << 16

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
_NAN = re.compile(rb"[+-]?(?:nan.*|1\.?#(?:ind|[qs]?nan).*)", re.IGNORECASE)
_INFINITY = re.compile(rb"[+-]?(?:inf(?:inity)?|1\.?#inf.*)", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(rb"[+-]?[0-9]*,[0-9]+(?:[eE][+-]?[0-9]+)?")


class Cursor:
    """A reading position in the text of a BVH file; memory holds one chunk of the text at a time.

    If `strict`, deviations from the format raise an error; see `tolerate`. `label` names the file
    in errors.
    """

    def __init__(self, stream: IO[Any], label: str, *, strict: bool) -> None:
        self.label = label
        self.strict = strict
        self.buffer = b""  # the chunk in memory, as UTF-8
        self.offset = 0  # of the cursor in `buffer`
        self.is_at_end = False  # whether `buffer` holds the end of the file
        self.file_bytes = _file_bytes(stream)  # CHUNK_BYTES if the size is unknown
        self._stream = stream
        self._decoder: codecs.IncrementalDecoder | None = None
        # Line and message of the first deviation of each kind, and the number of deviations.
        self._repairs: dict[str, tuple[int, str]] = {}
        self._n_repairs = Counter[str]()
        # `_line` and `_column` are those of the offset `_counted` in the buffer.
        self._counted, self._line, self._column = 0, 1, 1
        self._has_lone_cr: bool | None = None  # whether CR ends a line of `buffer`; None if unknown
        self._word_start = 0
        self._held = b""  # a CR at the end of the text read so far, which is not in `buffer`
        self._read_start()
        self.skip_white_space()

    def _read_start(self) -> None:
        """Read the first chunk and detect its encoding by the byte-order mark."""
        start = self._read_bytes()
        while len(start) < 4 and (more := self._read_bytes()):
            start += more
        for mark, encoding in _ENCODING_OF_MARK.items():
            if start.startswith(mark):
                start = start[len(mark) :]
                if encoding != "utf-8":
                    self._decoder = codecs.getincrementaldecoder(encoding)()
                self.tolerate("mark", f"a byte-order mark: the text is {encoding.upper()}")
        self.buffer = self._hold_cr(self._to_utf8(start))

    def read_chunk(self) -> None:
        """Read the next chunk and drop the text before the cursor."""
        self._count_to(self.offset)
        pieces, size = [self.buffer[self.offset :]], 0
        self._word_start -= self.offset
        self._counted = self.offset = 0
        self._has_lone_cr = None
        while size < CHUNK_BYTES:
            piece = self._read_bytes()
            if not piece:
                self.is_at_end = True
                pieces += [self._held, self._to_utf8(b"", final=True)]
                self._held = b""
                break
            size += len(piece)
            pieces.append(self._hold_cr(self._held + self._to_utf8(piece)))
        self.buffer = b"".join(pieces)

    def _hold_cr(self, text: bytes) -> bytes:
        """Remove a CR from the end of a text, keep it for the next chunk, and return the rest.

        The next chunk may begin with the LF of the same line end.
        """
        self._held = b"\r" if text.endswith(b"\r") else b""
        return text.removesuffix(b"\r")

    def _read_bytes(self) -> bytes:
        piece = self._stream.read(CHUNK_BYTES) or b""
        return piece.encode("utf-8", "surrogatepass") if isinstance(piece, str) else bytes(piece)

    def _to_utf8(self, piece: bytes, *, final: bool = False) -> bytes:
        if self._decoder is None:
            return piece
        try:
            return str(self._decoder.decode(piece, final)).encode()
        except UnicodeError as error:
            self.fail(f"expected UTF-16 text, got invalid bytes: {error}")

    def skip_white_space(self) -> None:
        """Move to the next word and ensure that the buffer holds the whole word."""
        while True:
            self.offset = match_end(_WHITE_SPACE, self.buffer, self.offset)
            if self.is_at_end or self.has_lookahead:
                self._word_start = self.offset
                return
            self.read_chunk()

    def ends_in_word(self) -> bool:
        """Return whether the text in the buffer ends in a word, not in white space or padding."""
        end = self.buffer[-1:]
        return bool(end) and end not in b"\0\x1a \t\n\v\f\r"

    def take(self, pattern: re.Pattern[bytes]) -> bytes | None:
        """Match a pattern at the cursor, move after the match and return its first group.

        If the pattern does not match, return None and do not move.
        """
        self._ensure_lookahead()
        match = pattern.match(self.buffer, self.offset)
        self._word_start = self.offset
        if match is None:
            return None
        if match.end(1) - self.offset >= MAX_WORD_BYTES:
            self.fail(
                f"expected a word of fewer than {MAX_WORD_BYTES} characters, got a longer one"
            )
        self.offset = match.end()
        return match.group(1)

    def skip_text(self, text: bytes) -> bool:
        """Move after `text` if it and then another word follow; return whether they do."""
        end = self.offset + len(text)
        if (
            not self.buffer.startswith(text, self.offset)
            or match_end(_WORD, self.buffer, end) == end
        ):
            return False
        self.offset = end
        return True

    @property
    def has_lookahead(self) -> bool:
        """Whether the buffer holds enough text after the cursor for a word of maximum length."""
        return len(self.buffer) - self.offset >= MAX_WORD_BYTES

    def _ensure_lookahead(self) -> None:
        if not self.is_at_end and not self.has_lookahead:
            self.skip_white_space()

    def move_back(self) -> None:
        """Move back to the start of the last word taken."""
        self.offset = self._word_start

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
            self.tolerate(
                f"case {keyword!r}", f"{describe_word(word)} read as {describe_word(keyword)}"
            )
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
        self._ensure_lookahead()
        while self.buffer.startswith((b"#", b"//"), self.offset):
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

    def position(self) -> Position:
        """Return line and column of the last word taken."""
        self._count_to(self._word_start)
        return self._line, self._column

    def fail(self, message: str, position: Position | None = None) -> NoReturn:
        """Raise BvhError; the default position is that of the last word taken."""
        line, column = position or self.position()
        raise BvhError(message, self.label, line, column)

    def tolerate(self, kind: str, message: str, position: Position | None = None) -> None:
        """Add a deviation from the format to `repairs`; raise BvhError instead if strict.

        For each `kind`, only the first message and the number of deviations are kept.
        """
        found_at = position or self.position()
        if self.strict:
            self.fail(f"{message}: refused in strict mode", found_at)
        self._repairs.setdefault(kind, (found_at[0], message))
        self._n_repairs[kind] += 1

    def move(self, size: int, n_line_ends: int) -> None:
        """Move forward by `size` bytes of ASCII text, which contain `n_line_ends` line ends."""
        self._count_to(self.offset)
        end = self.offset + size
        if n_line_ends:
            last = max(self.buffer.rfind(mark, self.offset, end) for mark in (b"\n", b"\r"))
            self._line, self._column = self._line + n_line_ends, end - last
        else:
            self._column += size
        self.offset = self._counted = end

    def repairs(self) -> tuple[str, ...]:
        """Return one text for each kind of tolerated deviation, ordered by line."""
        counts = {kind: count - 1 for kind, count in self._n_repairs.items()}
        more = {kind: f" (and {n} more like it)" if n else "" for kind, n in counts.items()}
        found = sorted(self._repairs.items(), key=lambda item: item[1][0])
        return tuple(f"line {line}: {text}{more[kind]}" for kind, (line, text) in found)

    def _count_to(self, offset: int) -> None:
        if offset <= self._counted:
            return
        buffer, start = self.buffer, self._counted
        if self._has_lone_cr is None:
            self._has_lone_cr = buffer.count(b"\r") != buffer.count(b"\r\n")
        lines = buffer.count(b"\n", start, offset)
        if self._has_lone_cr:
            passed = buffer[start:offset]
            lines += passed.count(b"\r") - passed.count(b"\r\n")
        if lines:
            self._line += lines
            self._column = 1
            last = buffer.rfind(b"\n", start, offset)
            if self._has_lone_cr:
                last = max(last, buffer.rfind(b"\r", start, offset))
            start = last + 1
        self._column += len(buffer[start:offset].decode("utf-8", "replace"))
        self._counted = offset


@contextmanager
def open_cursor(file: BvhFile, *, strict: bool) -> Iterator[Cursor]:
    """Yield a cursor at the first word of a file: a path that is opened, or an open file."""
    if isinstance(file, str | os.PathLike):
        with open(file, "rb", buffering=0) as stream:
            yield Cursor(stream, os.fspath(file), strict=strict)
    elif hasattr(file, "read"):
        name = getattr(file, "name", None)
        yield Cursor(file, name if isinstance(name, str) else "<stream>", strict=strict)
    else:
        raise TypeError(f"`source` must be a path or a file object, got {type(file).__name__}")


def _file_bytes(stream: IO[Any]) -> int:
    try:
        return os.fstat(stream.fileno()).st_size
    except (AttributeError, OSError):
        return CHUNK_BYTES


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
    if _NAN.fullmatch(word) or _INFINITY.fullmatch(word):
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
