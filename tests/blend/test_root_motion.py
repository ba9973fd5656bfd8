"""Laws of the root's way: no faster than what was captured, and without a jump."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Config, Segments
from mograft.blend.recombine import recombine
from mograft.blend.rigid_alignment import RootTransforms
from mograft.blend.root_motion import (
    blend_root_velocity,
    integrate_root,
    root_velocity_weights,
    yaw_rates,
)
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.transplant import GraftedGroup, transplant
from mograft.motion import rotations
from tests.oracles import pipeline as plain
from tests.strategies import (
    SEEDS,
    SEGMENT_LENGTHS,
    same_rotations,
    select_segments,
    star_clip,
    tile_segments,
)

CONFIGS = st.sampled_from([Config(seam=seam) for seam in SEAM_TREATMENTS.names])
BLENDS = st.floats(0.02, 1.0)
ROOT = GraftedGroup(np.array([0]), root=0)


def steps_of(rng, lengths, jumps=1.0):
    """Velocities that change little within segments, and much between them."""
    n = int(lengths.sum())
    base = np.repeat(rng.normal(size=(len(lengths), 4)) * jumps, lengths, axis=0)
    return base + 0.1 * np.cumsum(rng.normal(size=(n, 4)), axis=0) / np.sqrt(n)


@given(SEGMENT_LENGTHS, SEEDS, CONFIGS, BLENDS)
def test_velocities_are_means_of_those_captured(lengths, seed, config, blend):
    rng = np.random.default_rng(seed)
    cut, config = tile_segments(lengths), replace(config, seam_blend=blend)
    steps, seams = steps_of(rng, lengths), rng.random(len(lengths) - 1) < 0.7
    faded = blend_root_velocity(steps, cut, seams, config, 30.0)
    np.testing.assert_allclose(
        faded, plain.blended(steps, lengths, seams, config.seam, blend * 30.0), atol=1e-12
    )
    for axes in (slice(0, 3), slice(3, 4)):
        most = np.linalg.norm(steps[:, axes], axis=1).max()
        assert (np.linalg.norm(faded[:, axes], axis=1) <= most * (1 + 1e-12)).all()
    at = np.arange(len(steps)) + 0.5
    near = np.zeros(len(steps), bool)
    for seam in cut.stop[:-1][seams]:
        early = config.seam == "offset"
        near |= (at - seam < blend * 30.0) & (at > seam)
        near |= (seam - at < blend * 30.0) & (at < seam) & early
    np.testing.assert_array_equal(faded[~near], steps[~near])


@given(st.integers(4, 15), st.integers(4, 15), SEEDS)
def test_velocities_meet_half_way(before, after, seed):
    """No frame takes more of a jump than the cubic does where it is steepest, over four frames."""
    rng = np.random.default_rng(seed)
    steps = np.repeat(rng.normal(size=(2, 4)), [before, after], axis=0)
    faded = blend_root_velocity(
        steps, tile_segments(np.array([before, after])), np.array([True]), Config(), 30.0
    )
    jump = np.abs(steps[before] - steps[before - 1])
    assert (np.abs(np.diff(faded, axis=0)) <= 1.5 / 8 * jump + 1e-12).all()
    mean = 0.5 * (faded[before - 1] + faded[before])
    if before == after:
        np.testing.assert_allclose(mean, 0.5 * (steps[0] + steps[-1]), atol=1e-12)


@given(st.integers(1, 40), st.floats(0.0, 40.0), CONFIGS)
def test_shares_fall_from_the_seam_on(length, frames, config):
    here, later = (
        root_velocity_weights(np.array(at), np.array(length), config, 30.0) for at in (frames, 40.0)
    )
    starting = root_velocity_weights(np.array(0.0), np.array(length), config, 30.0)
    for share, last, first in zip(here, later, starting, strict=True):
        assert last == 0.0 <= share <= first
    blends = config.seam in ("offset", "inertial", "dead")
    assert sum(starting) == pytest.approx(1.0 if blends else 0.0)


def root_speeds(motion, joint=0):
    """The root's ways over the floor and its turns about up, from frame to frame."""
    steps = np.linalg.norm(np.diff(motion.positions[:, joint], axis=0)[:, [0, 2]], axis=1)
    quats = motion.rotations[:, joint]
    return steps, np.abs(yaw_rates(quats, 1))


@given(SEGMENT_LENGTHS, SEEDS, st.sampled_from(("offset", "inertial", "dead")))
def test_the_root_goes_and_turns_no_faster_than_the_fastest_donor(lengths, seed, seam):
    """Whatever meets whatever."""
    rng = np.random.default_rng(seed)
    cut, config = tile_segments(lengths), Config(seam=seam)
    base = star_clip(rng, cut)
    other = replace(star_clip(rng, cut), name="other")
    given_to = rng.permutation(len(cut))
    cut = tile_segments(cut.lengths[given_to])
    donors = select_segments(tile_segments(lengths), given_to)
    donors = Segments(donors.start, donors.stop, rng.integers(0, 2, len(cut)))
    part = transplant(base, cut, donors, [base, other], ROOT, config)
    new = recombine(base, [part], "new")
    most = np.zeros(2)
    for which, first, last in zip(donors.clip, donors.start, donors.stop, strict=True):
        own = root_speeds((base, other)[which])
        most = np.maximum(most, [speed[first:last].max() for speed in own])
    for speed, limit in zip(root_speeds(new), most, strict=True):
        assert (speed <= limit * (1 + 1e-9) + 1e-9).all()


@given(SEEDS, st.integers(3, 40))
def test_the_root_is_led_as_it_is_told(seed, n):
    """It turns and goes by the velocities given, whatever the joined motion does about up."""
    rng = np.random.default_rng(seed)
    up = int(rng.integers(3))
    upright = rotations.from_axis_angle(np.eye(3)[up], rng.uniform(-3, 3, n))
    placed = np.cumsum(rng.normal(size=(n, 3)), axis=0)
    level = np.arange(3) != up
    captured = np.concatenate(
        [level * np.diff(placed, axis=0), yaw_rates(upright, up)[:, None]], axis=1
    )
    told = captured * rng.uniform(-1, 1, (n - 1, 1))
    joined = rotations.multiply(
        rotations.from_axis_angle(np.eye(3)[up], rng.uniform(-1, 1, n)), upright
    )
    heights = rng.normal(size=(n, 3))
    source, closed = RootTransforms(upright, placed), RootTransforms(joined, heights)
    root = integrate_root(told, captured, source, closed, up)
    quats, places = root.rotations, root.positions
    np.testing.assert_allclose(yaw_rates(quats, up), told[:, 3], atol=1e-9)
    np.testing.assert_array_equal(places[:, up], heights[:, up])
    steps = np.linalg.norm(level * np.diff(places, axis=0), axis=1)
    np.testing.assert_allclose(steps, np.linalg.norm(told[:, :3], axis=1), atol=1e-9)
    # Where it goes, it goes by the same side of its body.
    ways = rotations.rotate(rotations.inverse(quats[:-1]), level * np.diff(places, axis=0))
    np.testing.assert_allclose(
        ways, rotations.rotate(rotations.inverse(upright[:-1]), told[:, :3]), atol=1e-9
    )


@given(SEEDS, st.integers(3, 40))
def test_what_is_as_captured_stays_so_to_the_bit(seed, n):
    rng = np.random.default_rng(seed)
    quats = rotations.exp(rng.normal(size=(n, 3)))
    places = rng.normal(size=(n, 3))
    ways = np.diff(places, axis=0) * [1, 0, 1]
    captured = np.concatenate([ways, yaw_rates(quats, 1)[:, None]], axis=1)
    root = RootTransforms(quats, places)
    new = integrate_root(captured, captured, root, root, 1)
    np.testing.assert_array_equal(new.rotations, quats)
    np.testing.assert_array_equal(new.positions, places)


@given(SEEDS, st.integers(3, 40))
def test_leaning_otherwise_is_kept(seed, n):
    """Only the turn about up is taken from the captured: the lean is the joined one."""
    rng = np.random.default_rng(seed)
    quats, joined = (rotations.exp(0.4 * rng.normal(size=(n, 3))) for _ in range(2))
    places = rng.normal(size=(n, 3))
    captured = np.zeros((n - 1, 4))
    captured[:, 3] = yaw_rates(quats, 1)
    source, closed = RootTransforms(quats, places), RootTransforms(joined, places)
    new = integrate_root(captured, captured, source, closed, 1).rotations
    leans = [
        rotations.multiply(rotations.inverse(rotations.twist(own, 1)), own) for own in (new, joined)
    ]
    same_rotations(*leans, 1e-6)
    rates = np.abs(yaw_rates(new, 1))
    assert (rates <= np.abs(captured[:, 3]).max() * (1 + 1e-9)).all()
