"""Hypothesis strategies for motions and for dialects of BVH text."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

import mograft as mg
from mograft.motion.skeleton import CHANNELS
from tests.strategies import quaternions

WHITE = " \t\v\f"


def names():
    """Joint names that BVH can represent: one line, no brace, no white space at the ends."""
    common = st.sampled_from(["Hips", "mixamorig:LeftArm", "Bip01 L Thigh", "toe1-1.R", "2", "End"])
    character = st.characters(exclude_characters="\r\n{", exclude_categories=["Cs"])
    arbitrary = st.text(character, min_size=1, max_size=9)
    return (common | arbitrary).filter(lambda name: name and name.strip(WHITE) == name)


def coordinates():
    """Lengths and angles: integers, four decimals, any digits, and large numbers."""
    return st.one_of(
        st.integers(-360, 360).map(float),
        st.floats(-400, 400).map(lambda x: round(x, 4)),
        st.floats(-400, 400),
        st.floats(-1e30, 1e30),
    )


@st.composite
def skeletons(draw, max_joints=6):
    """Skeletons in depth-first order with any channels and end sites."""
    n_joints = draw(st.integers(1, max_joints))
    # The parent of the next joint is the last joint or one of its ancestors.
    parents, path = [-1], [0]
    for joint in range(1, n_joints):
        path = path[: draw(st.integers(1, len(path)))]
        parents.append(path[-1])
        path.append(joint)
    words = st.lists(st.sampled_from(CHANNELS), unique=True)
    channels = [tuple(draw(words)) for _ in range(n_joints)]
    channels[0] = channels[0] or ("Zrotation",)
    counts = [parents.count(joint) for joint in range(n_joints)]
    offsets = npst.arrays(np.float64, 3, elements=coordinates())

    def end_site(joint, before, offset, name):
        return mg.EndSite(joint, offset, before % (counts[joint] + 1), name)

    joints, positions = st.integers(0, n_joints - 1), st.integers(0, 9)
    site = st.builds(end_site, joints, positions, offsets, st.just("") | names())
    sites = draw(st.lists(site, max_size=4))
    joint_names = tuple(draw(names()) for _ in range(n_joints))
    joint_offsets = np.array([draw(offsets) for _ in range(n_joints)])
    skeleton = mg.Skeleton(joint_names, parents, joint_offsets, tuple(channels), tuple(sites))
    # End sites in depth-first order, as in a file.
    ordered, stack = [], [0]
    while stack:
        item = stack.pop()
        if isinstance(item, mg.EndSite):
            ordered.append(item)
        else:
            stack += reversed(skeleton.children_and_sites[item])
    return replace(skeleton, end_sites=tuple(ordered))


@dataclass(frozen=True)
class Clip:
    """The content of a BVH file."""

    skeleton: mg.Skeleton
    frame_time: float
    values: np.ndarray


@st.composite
def clips(draw, max_frames=4):
    skeleton = draw(skeletons())
    shape = (draw(st.integers(1, max_frames)), skeleton.n_channels)
    usual = st.sampled_from([1 / 30, 1 / 120, 0.0417083750417, 2e-5])
    frame_time = draw(usual | st.floats(1e-5, 1e3))
    return Clip(skeleton, frame_time, draw(npst.arrays(np.float64, shape, elements=coordinates())))


LAYOUTS = {
    "blank": [" ", "   ", "\t", " \t "],
    "indent": ["\t", "", "  "],
    "trailing": ["", " ", "\t "],
    "blank_lines": [False, True],
    "final_newline": [True, False],
    "number": ["repr", "plus", "digits", "exponent"],
}
"""White space and numbers of the same content; the first of each is the standard one."""

REPAIRS = {
    "case": ["as is", "lower", "upper", "title"],
    "channel_case": ["as is", "lower", "upper", "title"],
    "brace": ["\n", " ", ""],
    "site": ["End Site", "End site", "end  SITE"],
    "comment": ["", "# exported", "// by hand"],
    "frames": ["Frames: ", "Frames:", "frames : ", "FRAMES\t:", "Frames "],
    "frame_time": ["Frame Time: ", "FrameTime:", "frame time :", "Frames Time: ", "FRAME  TIME: "],
    "count": ["{}", "{}.0", "{}.", "+{}"],
    "channels_first": [False, True],
    "rows": ["a line each", "wrapped", "a value each", "joined", "one line"],
    "encoding": ["utf-8", "utf-8-sig", "utf-16"],
    "padding": ["", "\0\0", "\x1a"],
    "declared": [0, -1, 7],
}
"""Deviations that the reader tolerates; the first of each is the standard."""


class Dialect(SimpleNamespace):
    """A way to write BVH, by default the standard one."""

    def __init__(self, line_ends=("\n",), **choices):
        standard = {name: values[0] for name, values in (LAYOUTS | REPAIRS).items()}
        super().__init__(line_ends=line_ends, **standard | choices)


def layouts(**fields):
    """Dialects that differ from the standard one in white space, number format and `fields`."""
    ends = st.lists(st.sampled_from(["\n", "\r\n", "\r"]), min_size=1, max_size=3)
    choices = {name: st.sampled_from(values) for name, values in LAYOUTS.items()}
    return st.builds(Dialect, line_ends=ends.map(tuple), **choices, **fields)


def dialects():
    """All dialects that the reader tolerates; half of the choices are the standard ones."""
    choices = {k: st.just(own[0]) | st.sampled_from(own) for k, own in REPAIRS.items()}
    return layouts(**choices)


CASES = {"as is": str, "lower": str.lower, "upper": str.upper, "title": str.title}


@dataclass
class _TextLines:
    dialect: Dialect
    lines: list = field(default_factory=list)

    def add(self, depth, *words):
        """Add a line of words, and a blank line if the dialect has them."""
        line = self.dialect.indent * depth + self.dialect.blank.join(words)
        self.lines.append(line + self.dialect.trailing)
        if self.dialect.blank_lines and depth % 2 == 0:
            self.lines.append(self.dialect.trailing)

    def text(self):
        ends = self.dialect.line_ends
        text = "".join(line + ends[n % len(ends)] for n, line in enumerate(self.lines))
        return text if self.dialect.final_newline else text.rstrip("\r\n \t")


def to_text(clip, dialect):
    """Return the bytes of a clip in a dialect, independent of the writer of the package."""
    skeleton, values = clip.skeleton, clip.values
    out = _TextLines(dialect)

    keyword, channel = CASES[dialect.case], CASES[dialect.channel_case]

    def number(value):
        text = repr(float(value))
        if dialect.number == "plus" and not text.startswith("-"):
            return "+" + text
        if dialect.number == "exponent":
            return f"{value:.17E}"
        if dialect.number == "digits" and abs(value) < 1e9:
            return f"{value:.40f}" if float(f"{value:.40f}") == value else text
        return text

    def open_brace(depth, words):
        if dialect.brace == "\n":
            out.add(depth, *words)
            out.add(depth, "{")
        else:
            out.add(depth, " ".join(words) + dialect.brace + "{")

    def offset(depth, numbers):
        out.add(depth, keyword("OFFSET"), *map(number, numbers))

    if dialect.comment:
        out.add(0, dialect.comment)
    out.add(0, keyword("HIERARCHY"))
    stack = [(0, 0)]
    while stack:
        item, depth = stack.pop()
        if item is None:
            out.add(depth, "}")
            continue
        stack.append((None, depth))
        if isinstance(item, mg.EndSite):
            open_brace(depth, [dialect.site, item.name] if item.name else [dialect.site])
            offset(depth + 1, item.offset)
            continue
        open_brace(depth, [keyword("JOINT" if item else "ROOT"), skeleton.names[item]])
        channels = skeleton.channels[item]
        if not dialect.channels_first:
            offset(depth + 1, skeleton.offsets[item])
        words = keyword("CHANNELS"), dialect.count.format(len(channels)), *map(channel, channels)
        out.add(depth + 1, *words)
        if dialect.channels_first:
            offset(depth + 1, skeleton.offsets[item])
        stack += [(child, depth + 1) for child in reversed(skeleton.children_and_sites[item])]
    out.add(0, keyword("MOTION"))
    declared = len(values)
    # If rows are not lines, the declared number of frames must be correct.
    # If frames are missing, a line end must follow the last.
    is_complete = dialect.declared < 0 or dialect.final_newline
    if dialect.rows == "a line each" and declared + dialect.declared > 0 and is_complete:
        declared += dialect.declared
    out.add(0, dialect.frames + dialect.count.format(declared))
    out.add(0, dialect.frame_time + number(clip.frame_time))
    for line in split_rows(values, dialect.rows):
        out.add(0, *map(number, line))
    text = out.text()
    if dialect.padding:
        text += "\n" + dialect.padding
    return text.encode(dialect.encoding)


def split_rows(values, rows):
    """Return the numbers of each line of text."""
    if rows == "a line each":
        return list(values)
    if rows == "one line":
        return [values.ravel()]
    if rows == "a value each":
        return values.reshape(-1, 1)
    if rows == "joined":
        return [values[n : n + 2].ravel() for n in range(0, len(values), 2)]
    half = -(-values.shape[1] // 2)
    return [part for row in values for part in (row[:half], row[half:])]


@st.composite
def motions(draw, max_joints=5, max_frames=5):
    """Motions of any skeleton without channel values."""
    skeleton = draw(skeletons(max_joints))
    n_frames = draw(st.integers(1, max_frames))
    shape = (n_frames, skeleton.n_joints)
    positions = npst.arrays(np.float64, (*shape, 3), elements=st.floats(-1e6, 1e6))
    return mg.Motion(skeleton, 1 / 30, draw(quaternions(shape)), draw(positions))
