"""Law of the memory of commands: it grows by a stated multiple of the arrays of the motion."""

import sys

import pytest

pytest.importorskip("resource", reason="the platform does not report the memory of processes")

from benches.memory import COMMANDS, measure, write_groups, write_motion
from mograft.dancer import dance

FACTORS = {
    "graft": 8.0,
    "graft, feet planted": 8.0,
    "graft, obstacle": 8.0,
    "graft, reach": 8.0,
    "index": 4.0,
    "view": 4.0,
    "export glb": 4.0,
    "export npz": 4.0,
}
"""Greatest memory per frame, as a multiple of the arrays of the motion, as docs/reliability.md."""

SIZES = (4_000, 24_000)
"""Frames; the peak of a process varies by the arrays of some 2,000 frames."""


@pytest.fixture(scope="module")
def dances():
    return [dance(seed=seed).motion for seed in range(2)]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the units are those of Linux")
@pytest.mark.parametrize(
    "name",
    [
        name if name == "graft" else pytest.param(name, marks=pytest.mark.thorough)
        for name in FACTORS
    ],
)
def test_memory_of_a_command_grows_by_at_most_a_multiple_of_the_motion(dances, tmp_path, name):
    """The difference of two motions, so that the memory of the program itself does not count."""
    peaks, arrays = [], []
    write_groups(dances[0].skeleton, tmp_path / "groups.toml")
    for n_frames in SIZES:
        arrays.append(write_motion(dances, n_frames, tmp_path / "long.bvh"))
        words = [
            word.format(file=tmp_path / "long.bvh", folder=tmp_path) for word in COMMANDS[name]
        ]
        code, peak, _ = measure(words)
        assert code == 0
        peaks.append(peak)
    growth = (peaks[1] - peaks[0]) / (arrays[1] - arrays[0])
    assert 1.0 < growth <= FACTORS[name]
