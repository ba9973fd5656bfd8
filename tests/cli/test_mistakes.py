"""Typical mistakes on the command line: exit code, message, and that nothing is written."""

import pytest

from mograft import write_bvh
from mograft.cli import main
from mograft.dancer import dance
from tests.exit_codes import exit_code

USAGE, RUNTIME, INVALID, INFEASIBLE = 2, 1, 3, 4
ROBOT = (
    "<mujoco><worldbody><body name='base'><freejoint/><body name='arm'><joint name='arm_joint'/>"
    "</body></body></worldbody></mujoco>"
)

MISTAKES = [
    # Names
    ("grapht a.bvh -o x", USAGE, "got 'grapht'; did you mean 'graft'?"),
    ("lib verfy lib", USAGE, "got 'verfy'; did you mean 'verify'?"),
    ("graft a.bvh -o x --varity 1", USAGE, "no option --varity; did you mean '--variety'?"),
    ("graft a.bvh -o x --set seam=ofset", USAGE, "got 'ofset'; did you mean 'offset'?"),
    ("graft a.bvh -o x --reach 9:LeftHnd:0,90,0", RUNTIME, "'LeftHnd'; did you mean 'LeftHand'?"),
    ("graft lib -o x --base walkk", RUNTIME, "got 'walkk'; did you mean 'walk'?"),
    ("graft a.bvh -o x --swap arms", RUNTIME, "--swap must name groups other than the base group "
     "'lower', got 'arms': choose from upper; --groups lower_torso_arms has the groups lower, "
     "torso, arms"),
    ("candidates a.bvh --segment 1 --group larm", RUNTIME, "got 'larm'; --groups "
     "lower_torso_larm_rarm has the groups lower, torso, larm,"),
    ("graft a.bvh -o x --groups arms", USAGE, "arms is no preset: use --groups lower_torso_arms "
     "--swap arms"),
    ("graft a.bvh -o x --reach 9:hand.l:0,90,0", RUNTIME, "no joint is named 'hand.l'; did you "
     "mean 'LeftHand', the same body part?"),
    ("graft a.bvh -o x --swap lower", RUNTIME, "g.toml writes, and use --groups g.toml"),
    ("graft a.bvh -o x --only-from aa", RUNTIME, "--only-from must match at least one of a; got"),
    ("graft a.bvh -o x --only-tagged slow", RUNTIME, "--only-tagged must be left out, as"),
    ("candidates lib --segment 1 --clip walkk", RUNTIME, "--clip must be a clip, one of dance,"),
    ("candidates a.bvh --segment 1 --group lower", RUNTIME, "--group must be one of upper, not"),
    ("plot pca a.bvh -o x.png --group lowr", RUNTIME, "got 'lowr'; did you mean 'lower'?"),
    ("view lib --clip walkk -o x.html", RUNTIME, "got 'walkk'; did you mean 'walk'?"),
    ("graft a.bvh -o x --groups lower_uper", USAGE, "'lower_uper'; did you mean 'lower_upper'?"),
    ("graft a.bvh -o x --scenario graph --among wlk", RUNTIME, "--among must match"),
    ("evaluate balance", USAGE, "expected one library or at least one motion file"),
    ("evaluate a.bvh qualiti", USAGE, "got qualiti; did you mean 'quality'?"),
    ("graft a.bvh -o x --take 299=a:0-9", RUNTIME, "got 299; frame 299 is in segment "),
    ("graft a.bvh -o x --ban 999=a", RUNTIME, "segment of --ban must be 0 to"),
    ("graft a.bvh -o x --set variety=1", USAGE, "no field of Config; `variety` sets"),
    ("graft --from a.bvh -o x", INVALID, "expected the JSON file that is written beside a new"),
    ("graft a.bvh -o x --change legs@0-9", RUNTIME, "got 'legs', which is no name of a group "
     "or part; the base group 'lower' keeps its motion; to exchange it, set another base"),
    ("graft a.bvh b.bvh -o x --base a --change upper@0-90=b:280-400", RUNTIME, "did you mean "
     "179-299?"),
    ("graft a.bvh -o x --set seam", USAGE, "offset, with a field of docs/settings.md, got seam"),
    ("graft a.bvh -o x --set segmentation=no.json", RUNTIME, "no.json: No such file or directory"),
    ("index b.bvh -o lib --add --set segmentation=energy", USAGE, "--set is fixed when"),
    ("graft lib -o x --groups lower_upper", USAGE, "--groups is fixed when a library is created"),
    ("index b.bvh -o lib --add --match names", USAGE, "--match is fixed when a library is"),
    ("graft lib -o x --set segmentation=energy", USAGE, "--set segmentation is fixed when"),
    ("config show grapht", USAGE, "got grapht; did you mean 'graft'?"),
    ("graft a.bvh -o x --change 5-9", USAGE, "--change: expected GROUP@FIRST-LAST"),
    ("graft a.bvh -o x --change upper@5-9=", USAGE, "--change: expected GROUP@FIRST-LAST"),
    ("graft a.bvh -o x --change uper@5-9", RUNTIME, "the group of --change must be an exchanged"),
    ("graft a.bvh -o x --change upper@5-99999", RUNTIME, "got 5-99999; did you mean 5-299?"),
    ("graft a.bvh -o x --change upper@300-", RUNTIME, "got 300-301; did you mean 298-299?"),
    # Files
    ("info othr.bvh", RUNTIME, "othr.bvh: No such file or directory; did you mean 'other.bvh'?"),
    ("lib info libb", RUNTIME, "libb: no such library; did you mean 'lib'?"),
    ("graft empty -o x", RUNTIME, "empty: no motion file in this folder"),
    ("info broken.bvh", INVALID, "broken.bvh:4:2: expected OFFSET"),
    ("graft a.bvh other.bvh -o x", RUNTIME, "also has LeftElbow, unlike"),
    ("graft a.bvh -o x --base other.bvh", RUNTIME, "unlike a in the library; the "
     "base must have the hierarchy of the clips, unless joints are matched by anatomy (--match"),
    ("graft one.bvh -o x", RUNTIME, "must have at least 2 frames, got 1"),
    ("graft lib a.bvh -o x", USAGE, "expected one library or motion files, got both"),
    ("export lib -o x.glb", RUNTIME, "lib is a library; expected motion files"),
    *((f"{words} lib{rest}", RUNTIME, "lib is a library; expected motion files, as mograft lib "
       "info lib --clips lists them") for words, rest in (("info", ""), ("check", ""),
       ("groups", ""), ("play", " --vmc 127.0.0.1"), ("index", " -o x"))),
    ("play clips --vmc 127.0.0.1", RUNTIME, "clips is a folder; expected one file, such as clips/"),
    ("info empty", RUNTIME, "empty has no motion file"),
    ("graft --from lib -o x", USAGE, "must be .json or FILE.glb#NAME of a graft, got folder lib"),
    ("lib info a.bvh", RUNTIME, "it is a file; mograft info describes motion files, mograft index "
     "a.bvh -o a.mograft makes a library"),
    ("lib info clips", RUNTIME, "mograft index clips -o clips.mograft makes one of motion files"),
    ("find lib walk", USAGE, "LIB comes last: mograft find walk lib"),
    ("find lib", USAGE, " is read as LIB, the last word; before it give the clip or file to find, "
     "or --text WORDS"),
    ("find wlk lib", RUNTIME, "CLIP|FILE must be a clip, one of dance, walk; got 'wlk'; did you"),
    ("find walk lib --part arms", RUNTIME, "--part must be one of lower, upper, got 'arms'; "
     "a library made by mograft index FILE -o LIB --groups lower_torso_arms has the groups"),
    ("curate lib --part arms", RUNTIME, "must be one of lower, upper, got 'arms'; a library made "
     "by mograft index FILE -o LIB --groups lower_torso_arms"),
    ("candidates lib --segment 1 --group arms", RUNTIME, "; a library made by mograft index FILE "
     "-o LIB --groups lower_torso_arms"),
    *((f"{words} tags.csv{rest}", INVALID, "other tables are no motions, which are .bvh, .glb, "
       ".fbx or .npz: one of clips and their tags is for mograft index --tags ") for words, rest
      in (("check", ""), ("info", ""), ("graft", " -o x"), ("view", " -o x.html"))),
    ("info text", INVALID, "text: expected a motion file (.bvh, .glb, .gltf, .fbx, .npz, .csv, "),
    ("info zzzzzz.bvh", RUNTIME, "or directory; the folder has a.bvh, b.bvh, broken.bvh"),
    ("studio clips -o a.bvh", USAGE, "-o must be a folder, got a.bvh"),
    ("plot strip clips -o x.png", RUNTIME, "one motion, got 2: give one of clips/dance.bvh, "),
    ("plot energy lib -o x.png", RUNTIME, "got 2: give one by --clip of dance, walk"),
    ("export clips -o x.bvh", USAGE, "by -o FOLDER --format bvh, or give one of clips/"),
    ("export a.bvh -o x.npz --tracker mjlab", RUNTIME, "--tracker needs a robot, given by --model"),
    ("augment lib -o x -n 2 --seconds 100", RUNTIME, "--seconds must be at most 10, the longest "
     "span without faults of the base clips of all, got 100"),
    ("plot pca a.bvh b.bvh -o x.png --clip a", USAGE, "--clip requires strip, timeline, energy"),
    ("view a.bvh -o x.html --clip a", USAGE, "--clip requires a library; of files, give FILE or"),
    ("play a.bvh b.bvh --vmc 127.0.0.1", RUNTIME, "got 2: give one of a.bvh, b.bvh"),
    ("graft n.json -o x", USAGE, "n.json is no motion; --from n.json makes a graft again"),
    ("graft a.bvh -o x --model robot.xml", USAGE, "--model requires motions of a robot, such as"),
    ("groups a.bvh --preset arms", USAGE, "arms is no preset: use lower_torso_arms"),
    ("graft a.bvh -o x --outputs 3", USAGE, "did you mean '-n', the number of motions?"),
    ("curate lib -n 3", USAGE, "unexpected words -n 3; did you mean '--keep', how much"),
    ("augment lib -o x -n 2 --split 50", RUNTIME, "--split must be a CSV file of clips and parts"),
    ("graft a.bvh -o x --reach 30:LeftHand:@sword+0,0,0", RUNTIME, "no joint or body part is named "
     "'sword', but Hips, LeftUpLeg, LeftLeg, "),
    ("graft a.bvh -o x --avoid sphere:0,0,0,500", INFEASIBLE, "or exchange these joints by "
     "a --groups file with another base group; --best-effort writes the violation"),
    ("graft a.bvh -o x --avoid sphere:-114,85,183,20", INFEASIBLE, "mograft export BASE -o new.bvh "
     "--avoid ... leads a walk round an obstacle"),
    ("plot strip a.bvh -o x.png --count 11", USAGE,
     "no option --count; mograft graft [LIB|FILE ...] -o PATH has it"),
    ("check a.bvh --nowhere 0-9", USAGE,
     "no option --nowhere; mograft check --help-all lists all options"),
    ("info a.bvh --quaternion wxyz", USAGE, "--quaternion requires --model"),
    ("info a.bvh --fps 50", USAGE, "--fps requires --model"),
    ("info a.bvh --model robot.xml --skeleton a.bvh", USAGE, "--skeleton cannot be combined with"),
    ("info a.bvh --model robot.xml --fps x", USAGE, "--fps: must be FPS or GLOB=FPS"),
    ("info a.bvh --model robt.xml", RUNTIME, "file or directory; did you mean 'robot.xml'?"),
    ("graft a.bvh -o x --groups auto:1", USAGE, "--groups: must be auto or auto:N with a whole "
     "number N of at least 2, got 'auto:1'"),
    # Outputs
    ("graft a.bvh -o x.csv", USAGE, "mograft export writes .csv from a .bvh file"),
    ("graft lib -o x.csv", RUNTIME, "may end with .csv only for a robot"),
    ("graft a.bvh -o x.glb --digits 8", USAGE, "--digits requires .bvh; got x.glb"),
    ("export a.bvh -o out", USAGE, "add --format, such as --format bvh"),
    ("export a.bvh -o x.bvh --format bvh", USAGE, "--format needs a folder, got -o x.bvh"),
    ("view a.bvh -o page.html --force", RUNTIME, "page.html: is a folder, expected a file"),
    ("view a.bvh -o v.png", USAGE, "mograft plot strip draws .png"),
    ("graft a.bvh", USAGE, "one of -o and --into is required, got none"),
    ("graft a.bvh -o x --into y.glb", USAGE, "one of -o and --into is required, got both"),
    ("graft a.bvh --into y.glb", RUNTIME, "y.glb: No such file"),
    ("graft a.bvh --into y.bvh", USAGE, "--into must be a .glb file, got y.bvh"),
    ("graft a.bvh -o x --as new", USAGE, "--as requires a .glb file and a single motion"),
    ("graft a.bvh -o x.glb -n 2 --as new", USAGE, "--as requires a .glb file and a single motion"),
    ("graft a.bvh -o x.bvh -n 3", USAGE, "-o must be a folder, or a .glb or .npz file, if -n"),
    ("export a.bvh -o x.fbx", USAGE, "-o cannot be .fbx: write .glb or .bvh"),
    ("plot pie a.bvh -o x.png", USAGE, "must be one of strip, timeline, energy,"),
    ("export --cycle a.bvh -o x.bvh", USAGE, "seconds above 0, or no value, after FILE, for the"),
    ("export a.bvh -o x.bvh --cycle 9", RUNTIME, "has no cycle of 6.75 to 11.2 s"),
    ("export a.bvh -o x.bvh --turn 9999", RUNTIME, "--turn must be at most "),
    ("export a.bvh -o x.gif --size 160", USAGE, "must be WIDTHxHEIGHT, such as 720x480, got 160"),
    ("export a.bvh -o x.gif --scale cm", USAGE, "--scale requires .glb, .usd"),
    ("index a.bvh -o x.bvh", USAGE, "-o must be a folder, got x.bvh"),
    ("graft a.bvh -o a.bvh/x", RUNTIME, "a.bvh is a file; expected a folder"),
    ("demo -o text --force", RUNTIME, "text is a file; expected a folder"),
    ("index a.bvh -o lib", RUNTIME, "lib exists; use --force to replace a library"),
    # Values
    ("graft a.bvh -o x -n 0", USAGE, "must be from 1 to 100000 (other seeds give more), got 0"),
    ("graft a.bvh -o x --keep 0-999999", RUNTIME, "frames of --keep must be within 0 to 299 "
     "(9.96667 s), got 0-999999"),
    ("candidates a.bvh --frame 99s", RUNTIME, "0 to 299 (9.96667 s) in a, got 2970; "
     "did you mean 299?"),
    ("export a.bvh -o x.csv --frames 100-900", RUNTIME, "--frames must be two or more"),
    ("graft a.bvh -o x --avoid cube:0,0,0,1", USAGE, "got cube"),
    ("graft a.bvh -o x --avoid sphere:0,0,0", USAGE, "expected sphere:X,Y,Z,RADIUS, got sphere:0"),
    ("graft a.bvh -o x --scenario graph --base b.bvh", USAGE, "--base cannot be combined with"),
    ("graft a.bvh -o x --base b.bvh --duration 9", USAGE, "graph, which makes a base itself: leave "
     "--base out"),
    ("graft a.bvh -o x --take 900=a:10-20", RUNTIME, "289-299; did you mean 41? donor of "
     "--take must be a segment of a, got 10-20; most of frames 10-20 is in segment 1, frames 6-16"),
    ("graft a.bvh -o x --change upper@60-90=b@10-30", USAGE, "mean 'upper@60-90=b:10-30'?"),
    ("lib verify lib/manifest.json", RUNTIME, "is a file of a library; did you mean 'lib'?"),
    ("find walk lib -o x.csv", USAGE, "got x.csv; --json prints the results as data"),
    ("graft a.bvh -o x.fbx", USAGE, "got x.fbx; mograft reads .fbx, but does not"),
    ("graft a.bvh -o x --avoid box:0,0,0,2,2,-2", USAGE, "HX,HY,HZ must not be negative"),
    ("graft lib -o x --swap lower", RUNTIME, "and use a library made by mograft index FILE -o LIB"),
    ("stream a.bvh --port 0 --delay inf", USAGE, "must be seconds of at least 0, such as 0.5, got"),
    ("studio cut.json", INVALID, "cut.json: expected JSON: "),
    ("graft --project cut.json -o x", INVALID, "cut.json: expected JSON: "),
    ("studio text", USAGE, "text is neither a motion file, nor a project.json or a library"),
    ("graft a.bvh -o x --scenario graph --duration 1e300", RUNTIME, "at most 86400 s, got 1e+300"),
    ("graft a.bvh -o x --scenario graph --beats 1e300", RUNTIME,
     "--beats must be at most 1800 beats per minute, one per frame, got 1e+300"),
    ("plot timeline a.bvh -o x.png --frames 900-950", RUNTIME, "the first within 0-299, got (900"),
    ("graft a.bvh -o x --max-stretch nan", USAGE, "must be a fraction from 0 to 3, such as 0.3"),
    ("export a.bvh -o x.glb --scale mile", USAGE, "m, cm, mm, inch, CMU or the metres of a"),
    ("graft a.bvh -o x --set sigma_scale=nan", USAGE, "--set: `sigma_scale` must be above 0"),
    ("graft a.bvh -o x --take 24", USAGE, "LAST as mograft candidates lists it, such as 24=walk"),
    ("graft a.bvh -o x --keep 3s-4", USAGE, "such as 100-400 or 3.3s-13.3s, got 3s-4"),
    ("export a.bvh -o x.npz --tracker isaac", USAGE, "for a motion of a robot that --model gives"),
    ("graft a.bvh -o x --face 10-20:0,90,0", USAGE, "did you mean '0,90,0@10-20'?"),
    ("export a.bvh -o x.npz --frames 10..20", USAGE, "got 10..20; did you mean '10-20'?"),
    ("graft a.bvh -o x --set seam_blend:0.6", USAGE, "did you mean 'seam_blend=0.6'?"),
    ("graft a.bvh -o x --ban 3=", USAGE, "expected SEGMENT, SEGMENT=CLIP or"),
    ("graft a.bvh -o x --only-violations -n 2", USAGE,
     "--count cannot be combined with --only-violations"),
    ("graft -o x", USAGE, "expected LIB or FILE"),
    ("candidates a.bvh --segment 1 --frame 2", USAGE, "--frame is required, got both"),
    ("augment a.bvh -o x -n 2 --part test", USAGE, "--part requires --split"),
    ("stream a.bvh", USAGE, "one of --port and --vmc-in is required, got none"),
    ("stream a.bvh --vmc-in x", USAGE, "--vmc-in: must be PORT or HOST:PORT"),
    ("stream a.bvh --vmc-in 39600", USAGE, "--vmc-in requires --vmc"),
    ("stream a.bvh --port 0 --vmc 127.0.0.1", USAGE, "--vmc requires --vmc-in: "),
    ("play a.bvh", USAGE, "required: --vmc"),
    ("play a.bvh --vmc 127.0.0.1:0", USAGE, "--vmc: must be HOST or HOST:PORT"),
    ("plot pca a.bvh -o x.png --frames 1-5", USAGE, "--frames requires strip, timeline, energy"),
    ("plot strip lib -o x.png --clip walk --preset paper", USAGE, "--preset is fixed when"),
    ("plot strip a.bvh -o x.png --group lower", USAGE, "--group requires pca, dendrogram"),
    ("graft a.bvh -o x --scenario graph --length 1", USAGE, "--length: must be at least 2 frames"),
    ("graft a.bvh -o x --scenario graph --length 9 --beats 90", USAGE,
     "--length cannot be combined with --beats"),
    ("graft a.bvh -o x --scenario graph --path 1,2", USAGE, "must be at least two corners"),
    ("graft --from n.json -o x --seed 0", USAGE, "--seed cannot be combined with --from"),
    ("graft --from n.json -o x --ban 3 --swap upper", USAGE, "--swap cannot be combined with"),
    ("graft --from n.json -o x --take :3=b:0-9", USAGE, "expected SEGMENT=CLIP:FIRST-LAST"),
    ("graft --from n.json -o x", RUNTIME, "n.json: No such file or directory"),
    ("graft --project p.json -o x", RUNTIME, "p.json: No such file or directory"),
    ("graft --project text -o x", INVALID, "text: expected JSON"),
    ("graft --project text -o x.bvh", USAGE, "-o must be a folder"),
    ("graft --project text -o x --seed 3", USAGE, "--seed cannot be combined"),
    ("graft --project text a.bvh -o x", USAGE, "LIB|FILE cannot be combined"),
    # Data sets
    ("augment lib -o x -n 5 --resume", RUNTIME, "No such folder"),
    ("augment lib -o clips -n 5", RUNTIME, "exists; use --resume to continue it"),
    ("augment lib -o x -n 5 --split none.csv", RUNTIME, "none.csv"),
    ("augment lib -o x -n 5 --split auto:clips", RUNTIME, "--split must be a file, auto:clip"),
    ("augment lib -o x -n 5 --bases none", RUNTIME, "--bases must match"),
    ("augment lib -o x -n 5 --features roots", RUNTIME, "did you mean 'root'?"),
    ("augment lib -o x.bvh -n 5", USAGE, "-o must be a folder"),
    ("augment clips -o x -n 3 -j 2", USAGE, "--jobs requires a library in a folder"),
    ("augment lib -o x -n 0", USAGE, "--count: must be from 1 to 10000000"),
    ("find lib --text x --part upper", USAGE, "--part requires a clip or file before LIB"),
    ("find none lib", RUNTIME, "must be a clip"),
    ("find walk lib -o x.png", USAGE, "-o must be a file that ends in .html"),
    ("find walk lib --frames 1s-99s", RUNTIME, "--frames must be two or more frames within"),
    ("curate lib --keep 10% --radius 1", USAGE, "--keep cannot be combined with --radius"),
    ("curate lib --keep 200%", USAGE, "must be a share from 0 to 1, or a percentage"),
    ("curate lib --keep 0.1%", RUNTIME, "--keep must be at least"),
    ("curate lib -o x.bvh", USAGE, "-o must be a folder or a file that ends in .csv"),
    ("curate lib -o x.csv --files copy", USAGE, "--files requires -o with a folder"),
    ("curate lib -o clips", RUNTIME, "exists; choose another folder"),
    # Constraints that nothing satisfies
    ("graft a.bvh -o x --reach 9:LeftHand:0,9999,0", INFEASIBLE, "1 of 1 motions violate the "
     "constraints, because no donor sequence satisfies them; no motion was written; --set "
     "reach_ik=1 is not enough: place the target nearer; --only-violations also tries "
     "less similar donors; a target or obstacle elsewhere, or a larger tolerance (~TOL), may help; "
     "--best-effort writes all"),
    ("graft a.bvh -o x --reach 9:LeftHand:@chest+0,0.1,0.3 --set reach_ik=0", INFEASIBLE,
     "no motion was written; --set reach_ik=1 satisfies them; --only-violations also tries"),
    ("graft a.bvh b.bvh -o x --only-from b --set sigma_scale=1e-6", INFEASIBLE,
     "--set sigma_scale=1e-06 is small: a larger value allows less similar donors; --change "
     "GROUP@FIRST-LAST=CLIP puts a part of a clip there, whatever its legs; --best-effort"),
]  # fmt: skip


@pytest.fixture(scope="module")
def mistakes_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mistakes")
    motion = dance(seed=1, strides=1).motion
    write_bvh(motion[:300], folder / "a.bvh")
    write_bvh(motion[300:600], folder / "b.bvh")
    write_bvh(motion[:1], folder / "one.bvh")
    text = (folder / "a.bvh").read_text()
    (folder / "other.bvh").write_text(text.replace("LeftForeArm", "LeftElbow"))
    (folder / "broken.bvh").write_text(text.replace("OFFSET", "OFSET", 1))
    (folder / "text").write_text("text")
    (folder / "cut.json").write_text('{"format": ')
    (folder / "tags.csv").write_text("clip,tags\nwalk,slow\n")
    (folder / "robot.xml").write_text(ROBOT)
    (folder / "empty").mkdir()
    (folder / "page.html").mkdir()
    sources = [folder / "clips" / f"{name}.bvh" for name in ("dance", "walk")]
    sources[0].parent.mkdir()
    for source, frames in zip(sources, (motion[:300], motion[300:600]), strict=True):
        write_bvh(frames, source)
    assert main(["index", *map(str, sources), "-o", str(folder / "lib")]) == 0
    return folder


def contents(folder):
    """Return the bytes of all files by path, and None for folders."""
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.mark.parametrize(
    ("words", "code", "message"), MISTAKES, ids=[" ".join(row[0].split()) for row in MISTAKES]
)
def test_mistake_has_message_and_exit_code_and_writes_nothing(
    mistakes_folder, monkeypatch, capsys, words, code, message
):
    monkeypatch.chdir(mistakes_folder)
    before = contents(mistakes_folder)
    found = exit_code(words.split())
    out, err = capsys.readouterr()
    assert (found, out) == (code, ""), err
    assert message in err.splitlines()[-1]
    assert err.splitlines()[-1].startswith("error: ")
    assert sum(line.startswith("usage: ") for line in err.splitlines()) == (code == USAGE)
    assert contents(mistakes_folder) == before
