"""The cases of `same_outputs`: what users do, and the data that they do it with.

A step is a command line that begins with ``mograft``, or a Python snippet. Commands are written
with the options of the new version; `old_command` translates them for versions that had an option
of its own for each field of the configuration. Snippets see the names that `PREAMBLE` defines.
"""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

SEEDS = (0, 7)
MOTION_SUFFIXES = (".bvh", ".fbx", ".glb", ".gltf", ".npz", ".usd", ".usda", ".usdc")

PREAMBLE = """
import sys
from pathlib import Path
import numpy as np
import mograft as mg
C = getattr(mg, "constraints", mg)
K = getattr(mg, "clustering", mg)
F = getattr(mg, "formats", mg)
def candidates(library, *values):
    new = getattr(mg, "candidates", None)
    return new(library, *values) if new else library.candidates(*values)
def edit(graft, *values, **options):
    new = getattr(mg, "edit", None)
    return new(graft, *values, **options) if new else graft.replace(*values, **options)
def rows(substitutions):
    return [(s.group, s.start, s.stop, s.clip, s.donor_start, s.donor_stop) for s in substitutions]
"""


@dataclass(frozen=True)
class Case:
    """Steps that run one after the other in a folder of their own."""

    name: str
    steps: tuple[str, ...]
    needs: tuple[str, ...] = ()  # fixtures and paths in the data folder, copied to ``data``
    old_steps: tuple[str, ...] = field(default=())  # where `old_command` does not suffice

    def for_version(self, *, is_old: bool) -> tuple[str, ...]:
        """Return the steps in the words of the old or of the new version."""
        if not is_old:
            return self.steps
        return self.old_steps or tuple(map(old_command, self.steps))


OLD_NAMES = {"--only-violations": "--repair", "--length": "--frames"}


def old_command(step: str) -> str:
    """Return a command with the old names of options, and one for each field; snippets stay."""
    if not step.startswith("mograft "):
        return step
    words = [OLD_NAMES.get(word, word) for word in shlex.split(step)]
    while "--set" in words:
        place = words.index("--set")
        name, value = words[place + 1].split("=", 1)
        flag = f"--{name.replace('_', '-')}"
        is_false = name == "self_repair" and value == "false"
        words[place : place + 2] = [f"--no-{flag[2:]}"] if is_false else [flag, value]
    if words[1:3] == ["lib", "export"]:
        place = words.index("--format")
        words[place : place + 2] = [f"--{words[place + 1]}"]
    return shlex.join(words)


def all_cases(data: Path) -> list[Case]:
    """Return every case; the last ones graft on each folder and file of `data`."""
    cases = [*documentation(), *options(), *libraries(), *edits(), *exports(), *python()]
    return [*cases, *sources(data)]


def lines(text: str) -> tuple[str, ...]:
    """Return the lines of a text that are not empty."""
    return tuple(line.strip() for line in text.splitlines() if line.strip())


def documentation() -> Iterator[Case]:
    """Yield the console examples of README, of the first steps, and of questions and how-tos."""
    # The command evaluates by other rules now; see docs/evaluation.md.
    for name, (needs, text) in PAGES.items():
        yield Case(f"docs/{name}", lines(text), needs)


PAGES: dict[str, tuple[tuple[str, ...], str]] = {
    "demo": ((), "mograft demo\nmograft demo -o seven --seed 7 --json"),
    "README": (
        ("demo", "clips"),
        """
        mograft info demo/dance.bvh
        mograft check clips/
        mograft graft demo/dance.bvh -o five/ -n 5
        mograft graft clips/ --base take0.bvh -o folder/
        mograft graft demo/dance.bvh -o arms/ --groups lower_torso_larm_rarm
        mograft graft demo/dance.bvh -o reach/ --reach 120:LeftHand:30,140,20
        mograft graft demo/dance.bvh -o graph/ --scenario graph --duration 60
        mograft graft demo/dance.bvh -o report/ -n 3 --report
        mograft view demo/dance.bvh five/dance_graft0.bvh -o both.html
        mograft export five/dance_graft0.bvh -o new.glb
        mograft index clips/ -o dance.mograft -j 2
        mograft graft dance.mograft --base take0 -o avoid/ --avoid sphere:0,100,50,30 --keep 0-60
        """,
    ),
    "first-five-minutes": (
        ("demo",),
        """
        mograft info demo/dance.bvh
        mograft graft demo/dance.bvh -o out -n 2 --seed 7 --report
        """,
    ),
    "questions": (
        ("clips",),
        """
        mograft graft clips/ --base take0 --seed 3 --report -o first.bvh
        mograft candidates clips/ --clip take0 --segment 18
        mograft graft --from first.json --take 18=take1:302-314 -o changed.bvh
        mograft graft --from first.json --keep 10s-20s -o kept.bvh
        mograft candidates clips/ --clip take0 --frame 6s
        mograft graft clips/ --base take0 --variety 0.8 --max-stretch 0.3 --mirror -o varied.bvh
        mograft graft clips/ --base take0 --measure -o measured.bvh
        mograft export first.bvh -o first.glb
        mograft index clips/ -o clips.mograft
        mograft graft clips.mograft --base take0 -n 5 --seed 1 -o many/
        mograft graft --from kept.json -o again.bvh
        mograft index clips/ -o tagged.mograft --tags clips/tags.csv
        mograft graft tagged.mograft --base take0 -o licensed.bvh
        """,
    ),
    "howto/amass": (
        ("amass", "demo"),
        """
        mograft info amass/walk_poses.npz
        mograft graft amass/walk_poses.npz amass/wave_poses.npz -n 2 -o new
        mograft graft amass/walk_poses.npz amass/wave_poses.npz -o new_poses.npz
        mograft export new/walk_poses_graft1.bvh -o other_poses.npz --like amass/walk_poses.npz
        mograft graft amass/walk_poses.npz amass/wave_poses.npz --skeleton amass/body.bvh -o body
        mograft info amass/walk_poses.npz demo/dance.bvh --match anatomy
        mograft graft amass/walk_poses.npz demo/dance.bvh --match anatomy -o mixed
        """,
    ),
    "howto/blender-glb": (
        ("demo",),
        """
        mograft export demo/dance.bvh -o character.glb
        mograft info character.glb
        mograft graft character.glb -n 3 -o new.glb
        mograft view "new.glb#*_graft*" -o new.html
        mograft graft --from "new.json#dance_graft1" --ban 24 -o changed.glb
        """,
    ),
    "howto/blender": (
        ("demo",),
        "mograft export demo/dance.bvh demo/dance_graft0.bvh -o dance.glb",
    ),
    "howto/choose": (
        ("demo",),
        """
        mograft graft demo/dance.bvh -o varied/ -n 3 --variety 0.8
        mograft graft demo/dance.bvh -o kept/ --keep 10s-20s --set choice=viterbi
        """,
    ),
    "howto/edit": (
        ("clips",),
        """
        mograft graft clips/ --base take0 --seed 3 --report -o first.bvh
        mograft candidates clips/ --clip take0 --segment 18
        mograft candidates clips/ --clip take1 --frame 22.3s
        mograft graft --from first.json --take 24=take1:667-679 -o second.bvh
        mograft view first.bvh second.bvh -o both.html
        mograft graft --from second.json --ban 31 --keep 10s-12.5s --ban 900-960 -o third.bvh
        mograft graft --from third.json -o again.bvh
        mograft graft clips/ --base take0 --take 24=take1:667-679 --ban 31 --keep 600-900 -o n.bvh
        """,
    ),
    "howto/look": (
        ("demo",),
        """
        mograft view demo/dance.bvh demo/dance_graft0.bvh -o page.html
        mograft graft --from demo/dance_graft0.json -o changed.bvh --take 24=dance:137-147
        mograft export demo/dance.bvh demo/dance_graft0.bvh -o both.gif --frames 0-60 --size 320x160
        mograft plot strip demo/dance.bvh -o strip.svg --poses 8
        mograft plot timeline demo/dance.bvh -o timeline.png --frames 0-300
        mograft plot pca demo/dance.bvh -o pca.png --dark
        """,
    ),
    "howto/motionbuilder": (("demo",), "mograft info demo/dance_graft0.bvh"),
    "howto/seams": (
        ("demo",),
        """
        mograft graft demo/dance.bvh -o new.bvh --report
        mograft graft demo/dance.bvh -o calm.bvh --max-angle 30
        """,
    ),
    "howto/studio": (
        ("demo",),
        """
        mograft check demo
        mograft index demo --include-grafts -o dance.mograft -j 2
        mograft lib info dance.mograft --clips
        mograft index demo --include-grafts -o dance.mograft --add
        mograft lib verify dance.mograft
        mograft graft dance.mograft --base dance -n 2 --report -o new
        """,
    ),
    "howto/engines": (
        ("demo",),
        """
        mograft export demo/dance_graft0.bvh -o Dance.glb --scale cm
        mograft export demo/dance.bvh demo/dance_graft0.bvh -o dance30.glb --rate 30
        mograft export demo/dance_graft0.bvh -o dance299.glb --frames 0-299
        """,
    ),
    "groups": (
        ("demo",),
        """
        mograft groups demo/dance.bvh
        mograft groups demo/dance.bvh --json
        mograft groups demo/dance.bvh --preset auto:3 -o groups.toml
        mograft graft demo/dance.bvh --groups auto:3 -o grafts
        mograft graft demo/dance.bvh --groups groups.toml -o again
        """,
    ),
}
"""Fixtures and commands of each page, by its name."""


GRAFT_OPTIONS = """
    --avoid sphere:0,100,50,30
    --avoid sphere:40,120,50,15@30-200 --best-effort
    --avoid capsule:40,80,40,40,160,40,10 --best-effort
    --avoid box:60,100,60,10,10,10 --best-effort
    --avoid wall:60,0,0,-1,0,0 --best-effort
    --avoid clips/take1.bvh@120,0,0,90 --best-effort
    --avoid-self
    --avoid-self --best-effort
    --face 0,150,300 --best-effort
    --face 0,150,300@60-120
    --keep 0-60 --keep 10s-12s
    --reach 120:LeftHand:30,140,20
    --reach 120-130:RightHand:30,140,20~0.2 --best-effort
    --reach 120:LeftHand:30,140,20 --best-effort --set reach_ik=0
    --only-violations --avoid sphere:40,120,50,15 --best-effort
    --only-violations --avoid-self --best-effort
    --only-violations --reach 120:LeftHand:30,140,20 --best-effort
    --take 24=take1:667-679 --ban 31
    --ban 24=take0 --ban 190-220 --best-effort
    --only-from take1
    --not-from take1
    --max-stretch 0.3
    --max-angle 20
    --variety 0
    --variety 1
    --variety 0.3 -n 4
    --mirror
    --mirror --variety 0.8 -n 3
    --swap upper
    --swap larm --groups lower_torso_larm_rarm
    --groups lower_torso_arms
    --groups lower_torso_larm_rarm --seed 7
    --groups lower_torso_larm_rarm --take larm:24=take1:667-679
    --groups auto
    --groups auto:2 -n 2
    --scenario graph --duration 20
    --scenario graph --length 601 --seed 7
    --scenario graph --path 0,0:300,0:300,200
    --scenario graph --beats 120 --duration 20
    --scenario graph --among take1 --duration 20
    --set seam=gradient
    --set seam=offset
    --set seam=paper
    --set seam=displacement
    --set seam=inertial
    --set choice=viterbi -n 2
    --set choice=sample -n 3
    --set choice=nearest -n 2
    --set choice=random
    --set temperature=2
    --set temperature=0.1 -n 2
    --set diversity=4 -n 3
    --set diversity=0 -n 3
    --set neighbourhood=ball
    --set neighbourhood=ball --set choice=nearest
    --set sigma_scale=1.2
    --set sigma_scale=0.2 -n 5
    --set torso=pelvis
    --set torso=world
    --set feet=never
    --set feet=auto --groups clips/upper_base.toml
    --set self_repair=false
    --set segmentation=clips/cuts.json
    --preset paper --seed 7
    --preset paper --groups lower_torso_larm_rarm
    --preset paper --set seam=gradient --set choice=sample
    -n 8 --seed 5
    --digits 3
    --measure --report -n 2
    --report --avoid sphere:40,120,50,15 --best-effort
    --json -n 2
    --verbose
"""


def options() -> Iterator[Case]:
    """Yield a graft of two clips for each set of options."""
    for words in lines(GRAFT_OPTIONS):
        name = re.sub(r"[^\w=.,-]+", "_", words.replace("clips/", "")).strip("_-")
        base = "" if "--scenario" in words else "--base take0 "
        step = f"mograft graft clips/ {base}-o out/ {words}"
        yield Case(f"graft/{name}", (step,), ("clips",))
    mixed = "mograft graft clips/ data/synthetic_names --match anatomy -n 2 -o out/"
    yield Case("graft/match-anatomy", (mixed,), ("clips", "synthetic_names"))
    rated = "mograft graft data/dance_perfume_test data/skel_video2bvh --match anatomy -o out/"
    yield Case("graft/rates", (rated,), ("dance_perfume_test", "skel_video2bvh"))


def libraries() -> Iterator[Case]:
    """Yield cases that build, extend, describe, export and use a library."""
    folders = ("bandai_ds1", "bandai_ds2", "dance_cmu60_salsa", "dance_perfume_test")
    for folder in folders:
        yield Case(
            f"library/{folder}",
            lines(f"""
            mograft index data/{folder} -o new.mograft
            mograft lib info new.mograft --json
            mograft lib verify new.mograft
            mograft lib export new.mograft --format csv -o csv
            mograft lib export new.mograft --format parquet -o parquet
            mograft candidates new.mograft --segment 5 --json
            mograft graft new.mograft -n 2 --report -o out/
            mograft plot pca new.mograft -o pca.svg
            """),
            (folder,),
        )
    yield Case(
        "library/options",
        lines("""
        mograft index clips/ -o a.mograft --groups lower_torso_larm_rarm --preset paper
        mograft index clips/ -o b.mograft --set sigma_scale=1 --rate 60
        mograft index clips/ -o c.mograft --true-rate take1=60 --json
        mograft index clips/ -o d.mograft --tags clips/tags.csv --set sigma_scale=0.5
        mograft index clips/ -o e.mograft --groups auto:3
        mograft lib info c.mograft
        mograft graft a.mograft -o a/
        mograft graft b.mograft -o b/ --set seam=offset --variety 0.7
        mograft graft d.mograft -o d/ --only-tagged "licence:CC BY 4.0"
        mograft graft e.mograft -o e/ --not-from take1
        mograft candidates clips/ --segment 30 --json --set neighbourhood=ball
        mograft candidates clips/ --segment 30 --json --max-angle 20 --keep 0-500
        mograft candidates a.mograft --frame 200 --group larm
        """),
        ("clips",),
    )
    yield Case(
        "library/add",
        lines("""
        mograft index data/bandai_ds1 -o new.mograft
        mograft index data/bandai_ds1 data/bandai_ds2 -o new.mograft --add
        mograft index data/bandai_ds1 data/bandai_ds2 -o new.mograft --add
        mograft lib info new.mograft --json --clips
        mograft graft new.mograft --base dataset-2_walk_active_001 -n 2 -o out/
        """),
        ("bandai_ds1", "bandai_ds2"),
    )


def edits() -> Iterator[Case]:
    """Yield replays with and without edits, of several bases."""
    edited = ("--ban 24", "--ban 0-60 --seed 9", "--ban 12", "--keep 0-100")
    for folder in ("bandai_ds2", "dance_cmu94_indian_30fps", "dance_perfume_test"):
        first = f"mograft graft data/{folder} -n 2 -o one.bvh".replace("-n 2 ", "")
        replays = [f"mograft graft --from one.json {e} -o {i}.bvh" for i, e in enumerate(edited)]
        chain = ("mograft graft --from 0.json -o again.bvh",)
        yield Case(f"from/{folder}", (first, *replays, *chain), (folder,))
    glb = "glb/kaykit_Med_MovementBasic.glb"
    steps = f"""
        mograft graft data/{glb} -n 2 -o new.glb
        mograft info new.glb
        mograft info new.glb --json
        mograft export "new.glb#*_graft1" -o new.usda
        mograft view new.glb -o new.html
    """
    yield Case("from/glb", lines(steps), (glb,))


EXPORTS = (
    "new.glb",
    "new.usda",
    "new.usdc",
    "new.npz",
    "new.csv",
    "new.bvh",
    "new.gif --frames 0-40",
    "cm.glb --scale cm --frames 1s-2s",
    "slow.bvh --rate 15",
    "slow.npz --rate 15 --frames 10-90",
    "dark.gif --dark --frames 0-30 --size 200x160 --groups lower_torso_arms",
)
PLOTS = ("strip", "timeline", "energy", "pca", "dendrogram")


def exports() -> Iterator[Case]:
    """Yield exports, pages, plots and listings."""
    sample = "bandai_ds2/dataset-2_wave-both-hands_active_001.bvh"
    words = tuple(f"mograft export data/{sample} -o {target}" for target in EXPORTS)
    yield Case("export/bvh", words, (sample,))
    fbx, npz = "fbx/quaternius_Male_Casual.fbx", "npz/kimodo-soma-rp_05_root_path.npz"
    for name, source in (("fbx", fbx), ("kimodo", npz)):
        steps = f"""
            mograft info data/{source} --json
            mograft check data/{source} --json
            mograft export data/{source}{"#*Man_Walk" if name == "fbx" else ""} -o new.glb
            mograft export data/{source}{"#*Man_Walk" if name == "fbx" else ""} -o new.bvh
            mograft export data/{source}{"#*Man_Walk" if name == "fbx" else ""} -o new.npz
        """
        yield Case(f"export/{name}", lines(steps), (source,))
    for suffix in ("svg", "png"):
        files = {"strip": "clips/take0.bvh", "energy": "clips/take0.bvh"}
        plots = tuple(
            f"mograft plot {kind} {files.get(kind, 'clips/')} -o {kind}.{suffix}" for kind in PLOTS
        )
        yield Case(f"plot/{suffix}", plots, ("clips",))
    pages = """
        mograft view clips/take0.bvh clips/take1.bvh -o two.html
        mograft view clips/take0.bvh -o colours.html --groups lower_torso_arms
        mograft index clips/ -o clips.mograft
        mograft view clips.mograft -o library.html
        mograft plot strip clips.mograft --clip take1 -o strip.svg --frames 2s-5s --dark
    """
    yield Case("view/pages", lines(pages), ("clips",))
    listings = """
        mograft info clips/
        mograft info clips/ --json
        mograft check clips/ --json
        mograft info data/dance_mass_snu data/skel_pybvh --verbose
        mograft check data/dance_mass_snu data/skel_pybvh --strict
        mograft groups data/synthetic_quadruped/quadruped_trot.bvh
    """
    needs = ("clips", "dance_mass_snu", "skel_pybvh", "synthetic_quadruped")
    yield Case("info/listings", lines(listings), needs)


STREAM = """
clips = ["clips/take0.bvh", "clips/take1.bvh"]
library = mg.Library.build(clips, {groups!r})
base = mg.read_bvh("demo/dance.bvh")[:1200]
stream = mg.Stream(library, seed={seed}, **{options!r})
pieces = []
for start in range(0, base.n_frames, {chunk}):
    if start >= 600 and not stream.constraints and {constrained}:
        stream.constraints = [C.Avoid(C.Sphere((40.0, 120.0, 50.0), 15.0)), C.NotFrom(["take1"])]
    stream.push(base[start : start + {chunk}])
    pieces += stream.pieces()
stream.close()
pieces += stream.pieces()
for piece in pieces:
    print(piece.start, piece.stop, rows(piece.substitutions), len(piece.violations))
motion = mg.join_pieces(pieces)
np.save("rotations.npy", motion.rotations)
np.save("positions.npy", motion.positions)
mg.write_bvh(motion, "live.bvh")
"""

CONFIGS = """
configs = dict(
    samples=dict(samples=6), components=dict(components=4), omega=dict(omega="local"),
    subtree=dict(inertia="subtree"), unit=dict(inertia="unit"), heading=dict(keep_heading=True),
    literal=dict(sigma="literal"), novelty=dict(novelty=2.0), window=dict(seam="paper",
    seam_window=0.3), blend=dict(seam_blend=0.15), few=dict(max_candidates=4),
    smoothing=dict(smoothing=0.1), lengths=dict(min_length=0.2, max_length=1.0),
    slack=dict(length_slack=0.0), weights=dict(length_weight=3.0, distance_weight=1.0),
    balance=dict(balance_weight=0.0), angle=dict(angle_scale=0.2, velocity_scale=2.0),
    floors=dict(rotation_floor=0.02, position_floor=0.01, length_floor=1.0),
    cuts=dict(segmentation={"take0": [30, 75, 120], "take1": [40, 90]}),
)
for name, fields in configs.items():
    library = mg.Library.build("clips", config=mg.Config(**fields))
    print(name, len(library.segments), *library.labels["lower"])
    mg.write_graft(mg.graft(library, seed=1), f"{name}.bvh")
"""

PYTHON_GRAFTS = """
library = mg.Library.build("clips")
many = mg.graft_many(library, count=5, seed=7)
for i, graft in enumerate(many):
    mg.write_graft(graft, f"many{i}.bvh")
    print(graft.report())
hand = many[0].motion.skeleton.index("LeftHand")
place = many[0].motion.world_positions()[120, hand]
again = mg.graft(library, constraints=[C.Reach("LeftHand", place, 120)], seed=1)
mg.write_graft(again, "reach.bvh")
changed = edit(again, C.Use(24, ("take1", 667, 679)), C.KeepOriginal(frames=(300, 375)))
mg.write_graft(changed, "changed.bvh")
mg.write_graft(edit(changed, C.Ban(31), C.Ban(frames=(900, 960))), "banned.bvh")
mended = mg.repair(library, constraints=[C.AvoidSelf()])
np.save("mended.npy", mended.motion.rotations)
print(rows(mended.substitutions), len(mended.violations))
for c in candidates(library, 18, "upper").allowed:
    print(c.segment, c.cost)
print(library.with_mirror_images().labels["upper"].tolist())
"""

SCENARIOS = """
from mograft.scenario import fill, follow, repetition, to_beats, transitions, walk
library = mg.Library.build("clips")
graph = transitions(library)
path = np.array([[0.0, 0.0], [300.0, 0.0], [300.0, 200.0]])
ways = {
    "walk": walk(library, duration=20.0, seed=3),
    "free": walk(library, duration=20.0, seed=3, repeat_penalty=0.0),
    "fill": fill(library, 601, seed=3, graph=graph),
    "follow": follow(library, path, graph=graph),
    "beats": to_beats(library, np.arange(0.0, 20.0, 0.5), seed=3, graph=graph),
}
for name, way in ways.items():
    mg.write_graft(mg.graft(library, scenario=way, seed=5), f"{name}.bvh")
print(repetition(library, ways["walk"]).longest_repeat)
"""

ANALYSIS = """
points = np.random.default_rng(0).normal(size=(500, 10))
np.save("tree.npy", K.linkage(points))
print(K.threshold(points), K.cut(points, max_diameter=K.threshold(points)).tolist())
apart = np.linalg.norm(points[:, None] - points, axis=-1)[np.triu_indices(500, 1)]
np.save("condensed.npy", K.linkage_condensed(apart))
print(K.CompleteLinkage(n_clusters=8).fit(points).labels_.tolist())
for path in ("clips/take0.bvh", "data/dance_perfume_test/A_test.bvh"):
    motion = mg.read_bvh(path)
    print(mg.segment(motion).start.tolist(), mg.segment(motion, method=[9, 40]).start.tolist())
    np.save(Path(path).stem + ".npy", mg.kinetic_energy(motion))
    print(mg.find_faults(motion))
    mg.write_bvh(mg.mirror(motion), Path(path).stem + "_mirrored.bvh")
    mg.write_bvh(motion.resample(24), Path(path).stem + "_24.bvh")
    print(mg.discover_groups(motion, 3).groups.to_toml())
"""


def python() -> Iterator[Case]:
    """Yield snippets: streams, scenarios, parameters without an option, analysis."""
    streams = {
        "frames": ("lower_upper", 0, 1, {}, False),
        "chunks": ("lower_upper", 7, 37, {}, False),
        "near": ("lower_upper", 7, 50, {"horizon": 1}, False),
        "constrained": ("lower_upper", 3, 10, {}, True),
        "groups": ("lower_torso_larm_rarm", 3, 25, {}, True),
    }
    names = ("groups", "seed", "chunk", "options", "constrained")
    for name, values in streams.items():
        filled = STREAM.format(**dict(zip(names, values, strict=True)))
        yield Case(f"stream/{name}", (filled,), ("clips", "demo"))
    yield Case("python/configs", (CONFIGS,), ("clips",))
    yield Case("python/grafts", (PYTHON_GRAFTS,), ("clips",))
    yield Case("python/scenarios", (SCENARIOS,), ("clips",))
    yield Case("python/analysis", (ANALYSIS,), ("clips", "dance_perfume_test"))


def sources(data: Path) -> Iterator[Case]:
    """Yield grafts on each folder and motion file of the data, by two seeds and two presets."""
    folders = sorted(path for path in data.iterdir() if path.is_dir())
    files = [f for folder in folders for f in sorted(folder.rglob("*")) if f.is_file()]
    motions = [path for path in files if path.suffix.lower() in MOTION_SUFFIXES]
    for path in (*folders, *motions):
        name = path.relative_to(data).as_posix()
        start = shlex.join(["mograft", "graft", f"data/{name}", "-n", "2"])
        steps = [
            f"{start} --seed {seed} --preset {preset} -o {preset}{seed}"
            for preset in ("default", "paper")
            for seed in SEEDS
        ]
        yield Case(
            f"data/{name}", tuple(s.replace(" --preset default", "") for s in steps), (name,)
        )
