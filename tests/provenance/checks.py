"""Checks that tests of provenance share."""

import json

import numpy as np

import mograft as mg


def assert_replays(graft):
    """Assert that a graft is made again from its record: motion, numbers, record and advice."""
    document = json.loads(json.dumps(mg.graft_record(graft)))
    again = mg.replay(document, graft.library)
    assert json.loads(json.dumps(mg.graft_record(again))) == document
    assert mg.advise(again) == mg.advise(graft)
    found, expected = again.motion, graft.motion
    np.testing.assert_array_equal(found.rotations, expected.rotations)
    np.testing.assert_array_equal(found.positions, expected.positions)
    np.testing.assert_array_equal(found.channel_numbers(), expected.channel_numbers())
