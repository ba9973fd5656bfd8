"""XML files as trees of elements with line numbers, with limits and without entities."""

from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.errors import FormatError
from mograft.motion.limits import MAX_COORDINATE

MAX_XML_BYTES = 1 << 21
"""Largest file that is read: models have meshes in files of their own."""

_MAX_DEPTH = 256


@dataclass(eq=False)
class XmlElement:
    """An element, its attributes and its children."""

    path: Path
    line: int
    tag: str
    attributes: dict[str, str]
    children: "list[XmlElement]" = field(default_factory=list)

    def error(self, message: str) -> FormatError:
        """Return the error for the element."""
        return FormatError(message, self.path, f"line {self.line}")

    def all(self, tag: str) -> "list[XmlElement]":
        """Return the children with a tag."""
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> "XmlElement":
        """Return the first child with a tag, or an element without content."""
        return next(iter(self.all(tag)), XmlElement(self.path, self.line, tag, {}))

    def numbers(self, name: str, count: int, default: str | None = None) -> FloatArray:
        """Return the numbers of an attribute; raise `FormatError` unless there are `count`."""
        text = self.attributes.get(name, default)
        if text is None:
            raise self.error(f"expected the attribute {name} of <{self.tag}>, got none")
        try:
            values = np.array(text.split(), np.float64)
        except ValueError:
            values = np.full(count, np.nan)
        if len(values) != count or not (np.abs(values) <= MAX_COORDINATE).all():
            expected = f"{count} finite number{'s' * (count > 1)} in {name} of <{self.tag}>"
            raise self.error(f"expected {expected}, got {text[:80]!r}")
        return values


def read_xml(path: Path) -> XmlElement:
    """Return the root element of an XML file.

    Raises `FormatError` with the line if the file is not XML, declares a document type or entities,
    has more than 2 MiB, or is nested deeper than 256 levels; OSError if it cannot be read.
    """
    with path.open("rb") as file:
        data = file.read(MAX_XML_BYTES + 1)
    if len(data) > MAX_XML_BYTES:
        raise FormatError("expected at most 2 MiB of XML, got more", path)
    parser = expat.ParserCreate()
    top = XmlElement(path, 0, "", {})
    stack = [top]

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = XmlElement(path, parser.CurrentLineNumber, tag, attributes)
        if len(stack) > _MAX_DEPTH:
            raise element.error(f"expected at most {_MAX_DEPTH} levels, got more")
        stack[-1].children.append(element)
        stack.append(element)

    def refuse(*_: object) -> None:
        line = f"line {parser.CurrentLineNumber}"
        raise FormatError("document types and entities are not read", path, line)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    try:
        parser.Parse(data, True)  # noqa: FBT003 - the end of the file
    except (expat.ExpatError, LookupError) as error:
        message = f"expected XML of a robot (MJCF, URDF): {error}"
        raise FormatError(message, path, f"line {parser.CurrentLineNumber}") from None
    return top.children[0]
