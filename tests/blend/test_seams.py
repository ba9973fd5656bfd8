"""Laws of seams: how smooth each treatment is, between frames too, and what it leaves alone."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mograft import Config, Library, graft
from mograft.blend.seams import PieceTimes, SeamBoundaries, dead, displacement, inertial, offset
from mograft.blend.transplant import DonorTimeline, _joined
from mograft.blend.value_spaces import ROTATIONS, TRANSLATIONS
from mograft.motion import rotations
from tests.blend.test_transplant import LENGTHS, pick, tiles
from tests.hierarchies import DANCES, recording
from tests.strategies import SEEDS, quaternions, vectors, wander

SMOOTH = ("offset", "inertial", "dead")
RATE = 30.0
STEP = 1e-5  # of a frame


def velocities(algebra, curve, frames, side):
    """One-sided velocities per frame, exact to the second order."""
    here, near, far = (curve(frames + side * step) for step in (0.0, STEP, 2 * STEP))
    return side * (4.0 * algebra.delta(here, near) - algebra.delta(here, far)) / (2.0 * STEP)


def jumps(laid, algebra, tracks, seams, config):
    """Jumps in value, and in velocity relative to 1 + it, where anything might jump."""

    def on(segment):
        return lambda step: _joined(laid, seams, algebra, tracks, segment, step, config)

    n = laid.cut.lengths
    left = np.arange(len(n) - 1)
    before, after = on(left), on(left + 1)
    ends, starts = n[:-1].astype(float), np.zeros(len(n) - 1)
    value = algebra.delta(before(ends), after(starts))
    pairs = [(velocities(algebra, before, ends, -1), velocities(algebra, after, starts, 1))]
    # Frames inside, and where windows end.
    reach = config.seam_blend * laid.rate
    inner = np.concatenate([np.arange(1.0, m) for m in n])
    segment = np.repeat(np.arange(len(n)), n - 1)
    edges = [(segment, inner), (np.arange(len(n)), np.full(len(n), reach)), (left, ends - reach)]
    for own, steps in edges:
        inside = (steps > 2 * STEP) & (steps < n[own] - 2 * STEP)
        both = [velocities(algebra, on(own[inside]), steps[inside], side) for side in (-1, 1)]
        pairs.append(tuple(both))
    velocity = [np.abs(a - b).max(axis=-1) / (1 + np.abs(a).max(axis=-1)) for a, b in pairs]
    return np.abs(value).max(initial=0), max(v.max(initial=0) for v in velocity)


def laid_out(lengths, seed):
    rng = np.random.default_rng(seed)
    cut = tiles(lengths)
    track = wander(rng, int(cut.stop[-1]) + 1, 2)
    donors = pick(cut, rng.integers(0, len(cut), len(cut)))
    laid = DonorTimeline(cut, donors, RATE)
    return laid, track, laid.true_seams([track])


@settings(deadline=None)
@given(LENGTHS, SEEDS, st.sampled_from(SMOOTH))
def test_neither_pose_nor_velocity_jumps_anywhere(lengths, seed, seam):
    laid, track, seams = laid_out(lengths, seed)
    value, velocity = jumps(laid, ROTATIONS, [track], seams, Config(seam=seam))
    assert value < 1e-9
    assert velocity < 1e-5


@settings(deadline=None)
@given(LENGTHS, SEEDS, st.sampled_from(SMOOTH))
def test_nor_do_translations(lengths, seed, seam):
    laid, track, seams = laid_out(lengths, seed)
    places = np.ascontiguousarray(rotations.log(track))
    value, velocity = jumps(laid, TRANSLATIONS, [places], seams, Config(seam=seam))
    assert value < 1e-9
    assert velocity < 1e-5


def test_displacement_closes_the_gap_but_leaves_the_kink():
    laid, track, seams = laid_out(np.array([9, 6, 12, 7]), 1)
    value, velocity = jumps(laid, ROTATIONS, [track], seams, Config(seam="displacement"))
    assert value < 1e-9
    assert velocity > 0.05


@given(quaternions((3, 2)), vectors((4, 2)), st.floats(0.05, 1.0), st.sampled_from(SMOOTH))
def test_any_two_pieces_meet_smoothly(poses, turning, blend, seam):
    """Pieces that turn evenly, of any pose and velocity, half turns apart included."""
    pieces, speeds = poses[:2], turning[:2]
    durations = np.array([0.4, 0.7])
    ends = SeamBoundaries(pieces[:1], pieces[1:], speeds[:1], speeds[1:])

    def curve(piece):
        def at(frames):
            since = np.asarray(frames) / RATE
            from_seam = since - durations[0] if piece == 0 else since
            values = rotations.multiply(
                pieces[piece], rotations.exp(speeds[piece] * from_seam[:, None, None])
            )
            moments = PieceTimes(np.full(len(since), piece), since, durations)
            treatment = {"offset": offset, "inertial": inertial, "dead": dead}[seam]
            return treatment(ROTATIONS, values, moments, ends, blend)

        return at

    end, start = np.array([durations[0] * RATE]), np.zeros(1)
    gap = np.linalg.norm(ROTATIONS.delta(ends.before, ends.after), axis=-1)
    if (gap > np.pi - 1e-3).any():
        return  # either way round is as short: the halves may take different ones
    assert rotations.angle(curve(0)(end), curve(1)(start)).max() < 1e-9
    before, after = (
        velocities(ROTATIONS, curve(0), end, -1),
        velocities(ROTATIONS, curve(1), start, 1),
    )
    assert np.abs(before - after).max() < 1e-5


@settings(deadline=None)
@given(LENGTHS, SEEDS, st.sampled_from(SMOOTH))
def test_outside_its_window_every_bit_stays(lengths, seed, seam):
    laid, track, seams = laid_out(lengths, seed)
    config = Config(seam=seam)
    segment, step = laid.frames()
    source = laid.sample(ROTATIONS, [track], segment, step)
    values = _joined(laid, seams, ROTATIONS, [track], segment, step, config)
    moments = laid.pieces(np.flatnonzero(seams), segment, step)
    outside = moments.seconds >= config.seam_blend
    if seam == "offset":
        outside &= moments.seconds_left >= config.seam_blend
    else:
        outside |= moments.piece == 0
    np.testing.assert_array_equal(values[outside], source[outside])
    np.testing.assert_allclose(np.linalg.norm(values, axis=-1), 1.0, atol=1e-12)


@given(SEEDS, st.sampled_from(SMOOTH))
def test_pieces_that_meet_as_they_are_are_left_alone(seed, seam):
    rng = np.random.default_rng(seed)
    pose, speed = wander(rng, 1, 3), rng.normal(size=(1, 3, 3))
    ends = SeamBoundaries(pose, pose, speed, speed)
    at = PieceTimes(np.array([0, 0, 1, 1]), np.array([0.1, 0.2, 0.0, 0.1]), np.array([0.2, 0.3]))
    values = wander(rng, 4, 3)
    treatment = {"offset": offset, "inertial": inertial, "dead": dead}[seam]
    np.testing.assert_array_equal(treatment(ROTATIONS, values, at, ends, 0.3), values)


@given(SEEDS)
def test_causal_treatments_leave_what_was_before(seed):
    """The frames before a seam, and so the velocity that leaves them, do not change."""
    rng = np.random.default_rng(seed)
    poses, speeds = wander(rng, 2, 3), rng.normal(size=(2, 3, 3))
    ends = SeamBoundaries(poses[:1], poses[1:], speeds[:1], speeds[1:])
    at = PieceTimes(np.zeros(5, int), np.linspace(0, 0.2, 5), np.array([0.2, 0.3]))
    values = wander(rng, 5, 3)
    for treatment in (inertial, dead):
        np.testing.assert_array_equal(treatment(ROTATIONS, values, at, ends, 0.3), values)


def test_displacement_of_opposite_gaps_is_none_half_way():
    way = np.array([[[0.3, -0.2, 0.5]]])
    pose = np.array([[rotations.IDENTITY]])
    there = rotations.exp(way)
    ends = SeamBoundaries(
        np.concatenate([pose, pose]), np.concatenate([there, there]), *[np.zeros((2, 1, 3))] * 2
    )
    at = PieceTimes(np.array([1]), np.array([0.5]), np.ones(3))
    np.testing.assert_allclose(displacement(ROTATIONS, pose, at, ends), pose, atol=1e-15)


@pytest.mark.filterwarnings("ignore")  # of faults in the recordings
@pytest.mark.parametrize("name", DANCES)
def test_offset_is_smooth_at_every_seam_of_real_grafts(name):
    motion = recording(name)
    library = Library.build(motion)
    new = graft(library, seed=3)
    chosen = np.array([s.donor for s in new.substitutions])
    own = np.array([s.segment for s in new.substitutions])
    laid = DonorTimeline(pick(library.segments, own), pick(library.segments, chosen), library.rate)
    track = np.ascontiguousarray(motion.rotations[:, library.joints("upper")])
    seams = laid.true_seams([track])
    assert seams.sum() > 10
    value, velocity = jumps(laid, ROTATIONS, [track], seams, library.config)
    assert value < 1e-9
    assert velocity < 1e-4


def test_a_treatment_that_is_none_is_refused_by_name():
    with pytest.raises(ValueError, match=r"`seam` must be one of .*'offset'.*, got 'glue'"):
        replace(Config(), seam="glue")
    with pytest.raises(ValueError, match="seam_blend must be above 0, got 0"):
        Config(seam_blend=0)
