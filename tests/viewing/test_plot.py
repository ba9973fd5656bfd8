"""Pictures: the drawn values equal the computed ones. Skips without matplotlib."""

import sys

import numpy as np
import pytest

from mograft import Config, Library, Motion, Skeleton, graft, kinetic_energy, segment, write_bvh
from mograft.body.mass import mass_model
from mograft.cli.syntax.commands import PLOT_KINDS
from tests.running import run_python

matplotlib = pytest.importorskip("matplotlib", reason="matplotlib is not installed")
matplotlib.use("agg")
from matplotlib import colors, image, pyplot  # noqa: E402

from mograft.viewing import plot  # noqa: E402


@pytest.fixture
def axes():
    yield pyplot.subplots()[1]
    pyplot.close("all")


def test_strip_draws_every_bone_of_every_pose(motion, axes):
    assert plot.strip(motion, 7, groups="lower_upper", ax=axes) is axes
    n_bones = motion.n_joints - 1 + len(motion.skeleton.end_sites)
    bones = [line for line in axes.lines if len(line.get_xdata()) == 2][: 7 * n_bones]
    frames = np.linspace(0, motion.n_frames - 1, 7).round().astype(int)
    assert [text.get_text() for text in axes.texts] == list(map(str, frames))
    # The vertical extent of the first pose equals that in the world.
    heights = np.array([line.get_ydata() for line in bones[:n_bones]])
    world = motion[:1].world_positions()[0, :, 1]
    tall = 1.2 * np.ptp(world)
    assert 0.9 * np.ptp(world) < np.ptp(heights) * mass_model(motion.skeleton).height < tall
    shown = {colors.to_hex(line.get_color()) for line in bones}
    assert shown == set(plot.PALETTE[:2])


def test_energy_curve_and_boundaries_equal_segmentation(motion, axes):
    plot.energy(motion, ax=axes)
    measured, smoothed, boundaries = axes.lines
    np.testing.assert_allclose(measured.get_ydata(), kinetic_energy(motion))
    segments = segment(motion)
    bounds = np.append(segments.start, segments.stop[-1])
    np.testing.assert_allclose(boundaries.get_xdata(), bounds * motion.frame_time)
    np.testing.assert_allclose(boundaries.get_ydata(), smoothed.get_ydata()[bounds])
    assert len(axes.patches) == (len(segments) + 1) // 2


def test_pca_points_have_colour_of_cluster(library, axes):
    plot.pca(library, "upper", ax=axes)
    singles, others = axes.collections
    labels = library.labels["upper"]
    points = library.embedding["upper"].points[:, :2]
    is_single = np.bincount(labels)[labels] == 1
    np.testing.assert_allclose(singles.get_offsets(), points[is_single])
    np.testing.assert_allclose(others.get_offsets(), points[~is_single])
    faces = [colors.to_hex(c) for c in others.get_facecolors()]
    by_label = dict(zip(labels[~is_single].tolist(), faces, strict=True))
    assert [by_label[label] for label in labels[~is_single].tolist()] == faces
    variances = library.embedding["upper"].variances
    labels = (axes.get_xlabel(), axes.get_ylabel())
    for share, label in zip(variances / variances.sum(), labels, strict=False):
        assert f"{100 * share:.0f} %" in label


def test_timeline_exchanged_segments_are_hatched(library, axes):
    new = graft(library, seed=2)
    plot.timeline(new, frames=(0, 300), ax=axes)
    names = [t.get_text() for t in axes.get_yticklabels()]
    assert names == ["dance · lower", "dance · upper", "dance_graft0 · upper"]
    shown = [s for s in new.substitutions if s.start < 300]
    hatched = [c for c in axes.collections if c.get_hatch()]
    assert len(hatched) == sum(not s.is_own for s in shown)
    starts = sorted(float(c.get_paths()[0].vertices[:, 0].min()) for c in hatched)
    assert starts == sorted(s.start for s in shown if not s.is_own)
    assert len(axes.collections) == 3 * len(shown)


def test_dendrogram_threshold_gives_clusters(library, axes):
    plot.dendrogram(library, ax=axes)
    branches = [branch for c in axes.collections for branch in c.get_segments()]
    n = len(library.segments)
    assert len(branches) == n - 1
    tops = np.array([branch[:, 1].max() for branch in branches])
    assert (tops <= library.sigma["lower"]).sum() == n - (library.labels["lower"].max() + 1)
    grey = [c for c in axes.collections if np.ptp(c.get_colors()[0, :3]) == 0]
    found = {branch[:, 1].max() for c in grey for branch in c.get_segments()}
    assert found == set(tops[tops > library.sigma["lower"]])
    # Each leaf is the end of one branch.
    leaves = sorted(x for branch in branches for x, y in (branch[0], branch[3]) if y == 0)
    assert leaves == list(range(n))


@pytest.mark.parametrize(
    ("draw", "arguments", "message"),
    [
        (plot.strip, {"poses": 0}, "`poses` must be at least 1, got 0"),
        (plot.strip, {"frames": (9, 10**6)}, "`frames` must be ascending within 0 to"),
        (plot.pca, {"group": "wings"}, "`group` must be one of lower, upper, got 'wings'"),
        *(
            (draw, {"frames": frames}, r"`frames` must be two ascending .* first within 0-\d+, got")
            for draw in (plot.energy, plot.timeline)
            for frames in ((-5, 20), (10**6, 10**6 + 9), (5, 5), (9, 3))
        ),
    ],
)
def test_plots_invalid_arguments_raise_value_error(motion, library, draw, arguments, message):
    with pytest.raises(ValueError, match=message):
        draw(library if draw is plot.pca else motion, **arguments)


def test_plots_of_too_short_motions_raise_value_error(motion):
    with pytest.raises(ValueError, match="at least 2 frames"):
        plot.energy(motion[:1])
    with pytest.warns(UserWarning, match="too few to compare"):
        single = Library.build(motion[:4], config=Config(min_length=1.0))
    with pytest.raises(ValueError, match="has no embedding"):
        plot.dendrogram(single)


@pytest.mark.parametrize("kind", PLOT_KINDS)
@pytest.mark.parametrize("dark", [False, True])
def test_plot_command_draws_each_kind(motion, tmp_path, succeed, fail, kind, dark):
    write_bvh(motion[:400], tmp_path / "a.bvh")
    target = tmp_path / "x.png"
    words = ["plot", kind, tmp_path / "a.bvh", "-o", target, *["--dark"][: int(dark)]]
    assert succeed(*words)[0].strip() == str(target)
    picture = image.imread(target)[..., :3]
    assert picture[0, 0].mean() == (0.0 if dark else 1.0)
    assert 0.001 < (np.abs(picture - picture[0, 0]).max(axis=-1) > 0.2).mean() < 0.9
    before = target.read_bytes()
    fail(1, *words)
    assert target.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.bvh", "x.png"]


@pytest.mark.parametrize("ending", ["svg", "pdf", "png"])
def test_plot_command_same_input_gives_same_bytes(motion, tmp_path, succeed, ending):
    write_bvh(motion[:200], tmp_path / "a.bvh")
    targets = [tmp_path / f"{name}.{ending}" for name in "xy"]
    for target in targets:
        options = ["--frames", "10-90", "--json", "-o", target]
        succeed("plot", "energy", tmp_path / "a.bvh", *options)
    assert targets[0].read_bytes() == targets[1].read_bytes()


def test_import_without_matplotlib_succeeds():
    code = "import sys, mograft.viewing.plot, mograft.cli; print('matplotlib' in sys.modules)"
    assert run_python(code).strip() == "False"


def test_plots_missing_matplotlib_names_extra(motion, tmp_path, monkeypatch, fail):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ImportError, match=r"pip install 'mograft\[plot\]'"):
        plot.energy(motion)
    write_bvh(motion[:20], tmp_path / "a.bvh")
    words = ["plot", "energy", tmp_path / "a.bvh", "-o", tmp_path / "x.png"]
    assert "pip install 'mograft[plot]'" in fail(1, *words)


def test_strip_single_joint_has_frame_numbers_without_bones():
    lone = Skeleton(["a"], [-1], [[0, 0, 0]])
    axes = plot.strip(Motion(lone, 0.1, [[[0, 0, 0, 1]]] * 5, [[[0, 0, 0]]] * 5), 3)
    assert [own.get_text() for own in axes.texts] == ["0", "2", "4"]
    assert axes.get_legend() is None


def test_strip_and_energy_of_frames_show_true_frames_and_times(motion):
    axes = plot.strip(motion, 5, frames=(400, 520))
    assert [text.get_text() for text in axes.texts] == ["400", "430", "460", "490", "520"]
    axes = plot.energy(motion, frames=(300, 600))
    assert axes.get_xlim() == pytest.approx((300 / motion.rate, 600 / motion.rate))
