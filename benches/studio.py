"""Print how fast the studio replies, draws and solves, and the memory that it needs.

Run as ``python benches/studio.py [FOLDER]``. The clips are 100 dances of the built-in dancer with
fingers, 60 joints; with FOLDER they are its motion files. The first, here of 30 s, is the base. The
times of an action include the request, the new poses and the picture. `--minutes` sets how long a
script uses the page before memory is measured.
"""

import argparse
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches._common import resident_bytes, run
from mograft.dancer import dance
from mograft.studio.server import StudioServer
from mograft.studio.session import Session
from tests.browser import chromium

N_FINGERS = 42

TOOLS = """
async () => {
  const [store, figures, view] = await Promise.all(
    ["store", "figures", "view"].map((name) => import(`/studio/${name}.js`)));
  const pause = (own) => new Promise((resolve) => setTimeout(resolve, own));
  const picture = () => new Promise((resolve) => requestAnimationFrame(() => resolve()));
  const shown = async (id, old) => {
    for (;;) {
      const figure = figures.figureOf("motion", id);
      if (figure?.values && figure.hash !== old) return picture();
      await pause(1);
    }
  };
  const clears = { count: 0, isCounted: (canvas) => canvas.dataset.part === "cardsCanvas" };
  const { clear } = WebGL2RenderingContext.prototype;
  WebGL2RenderingContext.prototype.clear = function (...given) {
    clears.count += clears.isCounted(this.canvas);
    return clear.apply(this, given);
  };
  window.bench = {
    // Milliseconds from an action until the new motion, or the state, is on the screen.
    act: async (action, isMoving) => {
      const old = figures.figureOf("motion", action.id)?.hash;
      const start = performance.now();
      const reply = await store.act(action);
      if (!reply) return null;
      if (isMoving && reply.motions.length) await shown(action.id, old);
      else await picture();
      return performance.now() - start;
    },
    shown: (id) => shown(id, null),
    // Solves in a second while an obstacle is dragged; the page sends the newest place only.
    drag: async (id, number, constraint, seconds) => {
      const start = performance.now();
      let count = 0, isWaiting = false, angle = 0;
      while (performance.now() - start < 1000 * seconds) {
        angle += 0.05;
        const center = constraint.obstacle.center.map((own, i) => own + 8 * Math.sin(angle + i));
        const next = { ...constraint, obstacle: { ...constraint.obstacle, center } };
        if (!isWaiting) {
          isWaiting = true;
          const given = { action: "set_constraint", id, number, constraint: next, preview: true };
          store.act(given, { isQuiet: true }).then((reply) => {
            isWaiting = false;
            count += Boolean(reply?.hash);
          });
        }
        await picture();
      }
      while (isWaiting) await pause(5);
      return (1000 * count) / (performance.now() - start);
    },
    previews: async (seconds) => {
      clears.count = 0;
      const start = performance.now();
      await pause(1000 * seconds);
      return (1000 * clears.count) / (performance.now() - start);
    },
    heap: () => performance.memory.usedJSHeapSize,
  };
}
"""


def with_fingers(motion, rng):
    """Return a motion of the dancer with moving fingers: 60 joints."""
    skeleton = motion.skeleton
    hands = [joint for joint, name in enumerate(skeleton.names) if name.endswith("Hand")]
    names, parents, offsets = list(skeleton.names), skeleton.parents.tolist(), [*skeleton.offsets]
    for finger in range(N_FINGERS // 3):
        parent = hands[finger % 2]
        for bone in range(3):
            names.append(f"{skeleton.names[hands[finger % 2]]}Finger{finger // 2}{bone}")
            parents.append(parent)
            offsets.append(np.array([3.0 if finger % 2 == 0 else -3.0, 0.0, finger / 2 - 4.0]))
            parent = len(names) - 1
    wide = mg.Skeleton(tuple(names), np.array(parents), np.array(offsets))
    times = np.arange(motion.n_frames)[:, None] * motion.frame_time
    bends = 0.3 + 0.3 * np.sin(times * rng.uniform(1, 3, N_FINGERS) + rng.uniform(0, 6, N_FINGERS))
    fingers = np.zeros((motion.n_frames, N_FINGERS, 4))
    fingers[..., 2], fingers[..., 3] = np.sin(bends / 2), np.cos(bends / 2)
    quats = np.concatenate([motion.rotations, fingers], axis=1)
    places = np.tile(wide.offsets, (motion.n_frames, 1, 1))
    places[:, 0] = motion.positions[:, 0]
    return mg.Motion(wide, motion.frame_time, quats, places, name=motion.name)


def write_clips(folder, lengths):
    """Write dances of 60 joints, with these numbers of frames, into a folder."""
    rng = np.random.default_rng(0)
    for seed, n_frames in enumerate(lengths):
        motion = dance(seed=seed, strides=1).motion[:n_frames]
        motion = with_fingers(replace(motion, name=f"dance{seed:03}"), rng)
        mg.write(motion, folder / f"dance{seed:03}.npz")


def print_times(name, times):
    """Print the median and 95th percentile of times, and the median of the server's processor."""
    median, used = np.median(times, axis=0)
    high = np.quantile(times[:, 0], 0.95)
    print(
        f"{name:34} {median:6.0f} ms, 95 % {high:6.0f} ms; processor of the server {used:4.0f} ms"
    )


def open_clips(page, session, paths):
    """Print the time from opening 100 clips to the first card, and that of the server."""
    start, used = time.perf_counter(), time.process_time()
    session.open(paths)
    while session.opened.status not in ("ready", "failed"):
        time.sleep(0.02)
    session.do({"action": "make", "base": session.opened.library.names[0], "count": 1})
    page.evaluate("() => bench.shown('m1')")
    seconds, processor = time.perf_counter() - start, time.process_time() - used
    print(
        f"{len(paths)} clips opened, first card      {seconds:6.1f} s, processor {processor:.1f} s"
    )


def actions(page, session, n_runs):
    """Print the times of lock and of take, of which each takes the best donor not in use."""
    base = session.do({"action": "make", "base": session.opened.library.names[0], "count": 1})
    key = base["motions"][0]
    page.evaluate("(id) => bench.shown(id)", key)
    graft = session.workshop.graft(session.project.motion(key).record)
    parts = [own for own in graft.substitutions if own.group == "upper"]
    print(f"library of {len(session.opened.library.segments)} segments, {len(parts)} in the motion")
    names = ("lock, until it is shown", "list of donors", "take a donor, until it is shown")
    times = {name: [] for name in names}

    def measure(name, call):
        start, used = time.perf_counter(), time.process_time()
        result = call()
        seconds = time.perf_counter() - start, time.process_time() - used
        times[name].append(1e3 * np.array(seconds))
        return result

    def act(action, *, is_moving):
        return page.evaluate("(own) => bench.act(...own)", [action, is_moving])

    for part in parts[1 : n_runs + 1]:
        where = {"id": key, "group": "upper", "first": part.start, "last": part.stop}
        measure(names[0], partial(act, {"action": "lock", **where}, is_moving=False))
        act({"action": "unlock", **where}, is_moving=False)
        found = measure(names[1], partial(session.donors, {**where, "limit": 10}))
        donors = found["donors"]
        free = [own for own in donors if not (own["refused"] or own["isUsed"])]
        if free:
            donor = {"clip": free[0]["clip"], "from": free[0]["first"], "to": free[0]["last"]}
            action = {"action": "take", **where, **donor}
            measure(names[2], partial(act, action, is_moving=True))
    for name, own in times.items():
        print_times(name, np.array(own))
    return key


def drag(page, session, key, seconds):
    """Print how often an obstacle that is dragged is solved."""
    library = session.opened.library
    middle = library.clips[0].n_frames // 2
    head = library.clips[0].world_transforms()[1][middle, -1]
    center = (head + np.array([20.0, 0.0, 20.0])).tolist()
    constraint = {"kind": "Avoid", "obstacle": {"kind": "Sphere", "center": center, "radius": 12.0}}
    constraint["frames"] = [middle - 50, middle + 50]
    session.do({"action": "add_constraint", "id": key, "constraint": constraint})
    number = len(session.state()["motions"][-1]["constraints"]) - 1
    given = [key, number, constraint, seconds]
    rate = page.evaluate("(own) => bench.drag(...own)", given)
    print(f"obstacle dragged                   {rate:6.1f} solves/s")


def previews(page, session, seconds):
    """Print how often each of 12 cards is drawn."""
    count = 12 - len(session.project.motions)
    session.do({"action": "make", "base": session.opened.library.names[0], "count": count})
    for own in session.project.motions:
        page.evaluate("(id) => bench.shown(id)", own.id)
    page.set_viewport_size({"width": 1280, "height": 1900})
    page.wait_for_timeout(1000)
    rate = page.evaluate("(own) => bench.previews(own)", seconds)
    print(f"12 previews                        {rate / 12:6.1f} frames/s")


def memory(browser, page, session, minutes):
    """Use the page by a script, and print the memory of its browser and of the server."""
    keys = [own.id for own in session.project.motions]
    until, n_actions = time.monotonic() + 60 * minutes, 0
    rng = np.random.default_rng(1)
    while time.monotonic() < until:
        key = keys[n_actions % len(keys)]
        first = int(rng.integers(0, session.opened.library.clips[0].n_frames - 60))
        where = {"id": key, "group": "upper", "first": first, "last": first + 30}
        names = ["change", "lock", "unlock", "regenerate", "undo", "restore", "undo", "redo"]
        page.evaluate("(own) => bench.act(own, false)", {"action": names[n_actions % 8], **where})
        n_actions += 1
    client = page.context.new_cdp_session(page)
    client.send("HeapProfiler.collectGarbage")
    heap = page.evaluate("() => bench.heap()") / 1e6
    own = browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")["processInfo"]
    pages = [resident_bytes(each["id"]) for each in own if each["type"] == "renderer"]
    server = resident_bytes()
    if server is not None:
        print(f"after {minutes} minutes and {n_actions} actions: page {max(pages) / 1e6:.0f} MB")
        print(f"  (scripts {heap:.0f} MB), server with this bench {server / 1e6:.0f} MB")


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--minutes", type=float, default=2.0)
    run(parser, report, argv)


def report(options):
    lengths = [120, 120] if options.tiny else [900] + 99 * [775]  # about 10,000 segments
    with tempfile.TemporaryDirectory() as name, chromium() as browser:
        folder = Path(name)
        clips = options.folder or folder / "clips"
        if options.folder is None:
            clips.mkdir()
            with ProcessPoolExecutor(1) as process:  # whose memory is not counted
                process.submit(write_clips, clips, lengths).result()
        session = Session(folder / "session")
        with StudioServer(session, session.folder, report=print) as server:
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            page.goto(server.url)
            page.wait_for_selector("#mograft[data-ready='1']")
            page.evaluate(TOOLS)
            open_clips(page, session, sorted(own for own in clips.iterdir() if own.is_file()))
            key = actions(page, session, 2 if options.tiny else 30)
            drag(page, session, key, 0.2 if options.tiny else 5.0)
            previews(page, session, 0.2 if options.tiny else 5.0)
            memory(browser, page, session, 0.02 if options.tiny else options.minutes)
            page.close()
        session.close()


if __name__ == "__main__":
    main()
