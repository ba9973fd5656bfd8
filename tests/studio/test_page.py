"""The page of the studio in a browser, on sessions of two short dances."""

from itertools import combinations

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from tests.browser import wait_until
from tests.strategies import HOSTILE_NAMES
from tests.studio.story import opened

pytestmark = pytest.mark.browser

IMPORTS = """
const modules = {};
for (const name of ["store", "figures", "player", "gizmo", "records", "stage", "timeline"])
  modules[name] = await import(`/studio/${name}.js`);
for (const name of ["poses", "actors", "scene"]) modules[name] = await import(`/viewer/${name}.js`);
const figure = async (kind, name) => {
  const { figureOf } = modules.figures;
  while (!figureOf(kind, name)) await new Promise((resolve) => setTimeout(resolve, 20));
  return figureOf(kind, name);
};
"""


@pytest.fixture
def page(browser, session):
    """The page of a session, which shows its first motion."""
    with opened(browser, session) as found:
        until_figure(found)
        yield found


def run(page, body, argument=None):
    """Return the result of an async function of the page's modules."""
    return page.evaluate(f"async (argument) => {{ {IMPORTS} {body} }}", argument)


def until_figure(page, name="m1", kind="motion"):
    """Wait until a figure is loaded."""
    run(page, "await figure(argument[0], argument[1]);", [kind, name])


def in_frames(page, kind, name, frames, value):
    """Return an expression of `pose` and `clip` in some frames, as the page poses a figure."""
    body = f"""
      const clip = await figure(argument.kind, argument.name);
      const pose = modules.poses.makePose(clip);
      return argument.frames.map((frame) => {{
        modules.poses.setPose(clip, frame, pose);
        return {value};
      }});"""
    return np.array(run(page, body, {"kind": kind, "name": name, "frames": list(map(int, frames))}))


def places(page, kind, name, frames):
    """Return the positions of the joints of a figure as the page poses them."""
    value = "clip.parents.map((_, joint) => modules.poses.nodePlace(clip, pose, joint))"
    return in_frames(page, kind, name, frames, value)


def assert_posed(page, kind, name, motion, frames):
    """Compare the poses of a figure of the page with those of a motion."""
    want = motion.world_positions()[frames]
    np.testing.assert_allclose(places(page, kind, name, frames), want, atol=0.02)


def add_constraints(page, kinds):
    """Add constraints of some kinds by the controls of the page."""
    page.locator("#tab-constraints").click()
    for number, kind in enumerate(kinds):
        page.locator("[data-part=newKind]").select_option(kind)
        page.get_by_role("button", name="Add", exact=True).click()
        page.locator(".constraint").nth(number).wait_for()


def drag(page, start, stop):
    """Move the pointer from one place to another with its button down."""
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(*stop, steps=8)
    page.mouse.up()


def graft_of(session, name="m1"):
    return session.workshop.graft(session.project.motion(name).record)


def test_page_has_the_poses_of_the_session_also_after_any_edits_and_undo(page, session):
    rng = np.random.default_rng(5)
    base = graft_of(session).base
    assert_posed(page, "clip", "one", base, [0, 1, 137, base.n_frames - 1])
    for name in ("", "ban", "restore", "change", "regenerate", "undo", "ban", "restore"):
        start = int(rng.integers(0, base.n_frames - 60))
        where = {"id": "m1", "group": "upper", "first": start, "last": start + 40}
        if name:
            action = {"action": name} | ({} if name == "undo" else where)
            run(page, "await modules.store.act(argument);", action)
        key = session.project.motion("m1").record
        wait_until(
            page,
            "(async () => { const { figureOf } = await import('/studio/figures.js');"
            f"return figureOf('motion', 'm1').hash === '{key}' }})()",
        )
        frames = [0, *rng.integers(0, base.n_frames, 12), base.n_frames - 1]
        assert_posed(page, "motion", "m1", graft_of(session).motion, frames)


def test_donor_is_posed_in_place_while_it_is_pointed_at(page, session):
    page.locator(".block[data-block='upper/2']").click()
    row = page.locator(".donors tbody tr:not(.used):not(.refused)").first
    row.wait_for()
    graft = graft_of(session)
    part = [own for own in graft.substitutions if own.group == "upper"][2]
    ends = [part.start, part.stop]
    before = places(page, "motion", "m1", ends)
    preview = "(async () => (await import('/viewer/scene.js')).state.preview {} null)()"
    row.hover()
    wait_until(page, preview.format("!=="))
    clip, frames = row.locator("button").first.inner_text().rsplit(" ", 1)
    donor = next(own for own in graft.library.clips if own.name == clip)
    want = donor.rotations[list(map(int, frames.split("\N{EN DASH}")))]
    turns = in_frames(
        page, "motion", "m1", ends, "pose.bones.map((bone) => bone.quaternion.toArray())"
    )
    cosine = np.abs((turns * want).sum(axis=-1))
    assert cosine[:, graft.library.joints("upper")].min() > 1 - 1e-7
    page.mouse.move(5, 5)
    wait_until(page, preview.format("==="))
    np.testing.assert_allclose(places(page, "motion", "m1", ends), before, atol=1e-9)


def test_record_of_a_shape_that_nobody_moved_is_the_record(page):
    center, unit = [120.0, 90.0, -40.0], [0.0, 0.6, 0.8]
    shapes = [
        {"kind": "Sphere", "center": center, "radius": 12.5},
        {"kind": "Box", "center": center, "half": [1.5, 20.0, 50.0], "rotation": [*unit, 0.0]},
        {"kind": "Capsule", "start": center, "stop": [-80.0, 160.0, 10.0], "radius": 4.0},
        {"kind": "HalfSpace", "point": center, "normal": unit},
    ]
    records = [{"kind": "Avoid", "obstacle": own, "frames": [3, 9]} for own in shapes]
    records += [
        {"kind": "Reach", "joint": "LeftHand", "target": center, "tolerance": 0.03},
        {"kind": "Face", "target": center},
        {"kind": "KeepOut", "joint": "LeftHand", "region": shapes[0]},
    ]
    body = """
      const clip = await figure("motion", "m1");
      const { makeMesh, recordOf } = modules.gizmo;
      const rounded = (_, own) => typeof own === "number" ? Math.round(own * 1e3) / 1e3 + 0 : own;
      return argument.map((record) => {
        const mesh = makeMesh(record, clip);
        const found = recordOf({ record, mesh, scale: mesh.scale.toArray() });
        return JSON.parse(JSON.stringify(found, rounded));
      });"""
    assert run(page, body, records) == records


def test_gizmo_that_is_dragged_moves_the_obstacle_in_one_step(page, session):
    page.locator("#tab-constraints").click()
    page.locator("#pane-constraints button", has_text="Add").click()
    page.locator(".constraint.selected").wait_for()
    n_steps = len(session.history.past)
    before = graft_of(session).request.constraints[0].obstacle.center
    wait_until(page, "!document.querySelector('[data-part=gizmo]').hidden")
    page.wait_for_timeout(300)
    (x, y), (up_x, up_y) = run(
        page,
        """const box = document.querySelector("[data-part=graftTile]").getBoundingClientRect();
        const { camera } = modules.stage.stage.view;
        const point = (place) => {
          const { x, y } = place.project(camera);
          return [box.left + (x + 1) / 2 * box.width, box.top + (1 - y) / 2 * box.height];
        };
        const { center } = modules.store.selected().constraints[0].record.obstacle;
        const place = new THREE.Vector3(...center);
        return [point(place.clone()), point(place.clone().setY(center[1] + 18))];""",
    )
    grip = [x + 1.6 * (up_x - x), y + 1.6 * (up_y - y)]
    drag(page, grip, [grip[0], grip[1] - 50])
    wait_until(
        page,
        "(async () => { const own = (await import('/studio/store.js')).selected();"
        f"return own.constraints[0].record.obstacle.center[1] > {before[1] + 1}; }})()",
    )
    after = graft_of(session).request.constraints[0].obstacle.center
    np.testing.assert_allclose([after[0], after[2]], [before[0], before[2]], atol=0.01)
    assert len(session.history.past) == n_steps + 1


def test_range_that_is_dragged_over_a_lane_is_locked_and_undone_by_keyboard(page, session):
    box = page.locator(".lane[data-group=upper]").bounding_box()
    y = box["y"] + 12
    drag(page, [box["x"] + 60, y], [box["x"] + 150, y])
    focus = run(page, "return modules.store.store.focus;")
    assert focus["group"] == "upper"
    assert 0 < focus["first"] < focus["last"]
    page.keyboard.press("k")
    page.locator(".locked").first.wait_for()
    (lock,) = session.project.motion("m1").locks
    # Whole segments are locked.
    assert lock.group == "upper"
    assert lock.first <= focus["first"] < focus["last"] <= lock.last
    page.locator("#pane-segment button", has_text="Unlock").wait_for()
    assert page.locator("#pane-segment button", has_text="Choose again").is_disabled()
    page.keyboard.press("Control+z")
    wait_until(page, "document.querySelectorAll('.locked').length === 0")
    assert session.project.motion("m1").locks == ()
    page.keyboard.press("Control+Shift+z")
    page.locator(".locked").first.wait_for()


def test_path_that_is_drawn_on_the_floor_is_sent_in_axes_of_the_page(page):
    sent = []
    page.locator("#tab-scenario").click()
    page.locator("button", has_text="Draw path").click()
    page.wait_for_timeout(300)
    box = page.locator("[data-part=graftTile]").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    drag(page, [x, y], [x + 100, y - 60])
    page.route(
        "**/api/do",
        lambda route: (
            sent.append(route.request.post_data_json),
            route.fulfill(json={"revision": 1, "motions": [], "message": ""}),
        ),
    )
    page.locator("button", has_text="along this path").click()
    page.wait_for_timeout(300)
    (action,) = sent
    points = np.array(action["points"])
    assert action["action"] == "scenario"
    assert len(points) > 3
    # From above, right on the screen is x of the page, and up is -z.
    move = points[-1] - points[0]
    assert move[0] > 10
    np.testing.assert_allclose(move[1] / move[0], -0.6, atol=0.1)


def test_change_of_an_old_state_is_refused_and_the_new_state_shown(browser, session):
    with opened(browser, session, expected=["409"]) as page:
        until_figure(page)
        page.route("**/api/events", lambda route: route.abort())
        run(page, "modules.store.store.project.revision -= 1;")
        page.locator(".card").nth(1).get_by_label("Favourite:").click()
        page.get_by_text("The project changed elsewhere").wait_for()
        assert session.project.motion("m2").mark is None
        page.locator(".card").nth(1).get_by_label("Favourite:").click()
        page.locator(".card.starred").wait_for()
        assert session.project.motion("m2").mark == "star"


def test_lost_connection_is_shown_until_the_server_is_back(browser, session):
    expected = ["Failed to load resource", "net::ERR"]
    with opened(browser, session, expected=expected) as page:
        until_figure(page)
        page.context.set_offline(True)
        page.locator(".card").first.get_by_label("Favourite:").click()
        page.locator("[data-part=banner]", has_text="Connection lost").wait_for()
        assert session.project.motion("m1").mark is None
        page.context.set_offline(False)
        session.do({"action": "mark", "id": "m2", "mark": "star"})
        page.locator(".card.starred").wait_for()
        wait_until(page, "document.querySelector('[data-part=banner]').hidden")


@pytest.mark.parametrize(
    "name", [own for own in HOSTILE_NAMES if own.strip() and own.isprintable()]
)
def test_names_are_shown_as_text(page, session, name):
    session.do({"action": "rename", "id": "m1", "name": name})
    card = page.locator(".card").first
    wait_until(page, "!document.querySelector('.card bdi').textContent.startsWith('one')")
    assert card.locator("bdi").evaluate("own => own.textContent") == name.strip()
    assert page.locator("[data-part=graftName]").evaluate("own => own.children.length") == 0
    assert page.evaluate("document.querySelectorAll('script').length") == 2


def test_meshes_of_removed_motions_are_dropped(page, session):
    until_figure(page, "m2")
    count = "(async () => [...(await import('/viewer/actors.js')).allActors()].length)()"
    wait_until(page, f"{count}.then((found) => found >= 4)")
    before = page.evaluate(count)
    session.do({"action": "remove", "ids": ["m2", "m3"]})
    wait_until(page, "document.querySelectorAll('.card').length === 1")
    assert page.evaluate(count) < before


def test_constraints_of_every_kind_are_added_and_shown_by_another_page(browser, session):
    with opened(browser, session) as page:
        until_figure(page)
        kinds = page.locator("[data-part=newKind] option").all_text_contents()
        add_constraints(page, kinds)
        forms = page.locator(".constraint").all_inner_texts()
    assert len(graft_of(session).request.constraints) == len(kinds)
    with opened(browser, session) as page:
        until_figure(page)
        page.locator("#tab-constraints").click()
        page.locator(".constraint").nth(len(kinds) - 1).wait_for()
        assert page.locator(".constraint").all_inner_texts() == forms
        field = page.get_by_role("group", name="Box").get_by_label("turn")
        field.fill("30")
        field.press("Enter")
        wait_until(page, "document.querySelector('[data-part=undo]').title.includes('move')")
    box = graft_of(session).request.constraints[kinds.index("Box to avoid")].obstacle
    half = np.radians(15)
    np.testing.assert_allclose(box.rotation, [0, np.sin(half), 0, np.cos(half)], atol=1e-6)


def test_constraints_of_one_kind_have_names_and_places_of_their_own(page, session):
    shapes = ["Sphere", "Wall", "Sphere", "Wall", "Sphere"]
    limbs = "No limb through the body"
    kinds = [*(f"{own} to avoid" for own in shapes), limbs]
    names = ["Sphere 1", "Wall 1", "Sphere 2", "Wall 2", "Sphere 3", limbs]
    add_constraints(page, kinds)
    assert page.locator(".constraint h3").all_inner_texts() == names
    assert page.locator(".name.thin").all_inner_texts() == names
    state = run(page, "return modules.store.selected();")
    violated = {names[own["number"]] for own in state["violations"]}
    assert violated
    cards = page.locator(".constraint", has=page.locator(".violations"))
    assert set(cards.locator("h3").all_inner_texts()) == violated
    kept = page.locator(".constraint", has=page.get_by_text("✓ satisfied"))
    assert set(kept.locator("h3").all_inner_texts()) == set(names) - violated
    marks = page.locator(".violated").evaluate_all("all => all.map((own) => own.ariaLabel)")
    assert {own.partition(":")[0] for own in marks} == violated
    worst = graft_of(session).violations[0].worst
    cards.first.get_by_role("button", name="Violated").click()
    assert int(page.locator("[data-part=frame]").input_value()) == worst
    records = [own.obstacle for own in graft_of(session).request.constraints[:5]]
    assert pdist([own.center for own in records[::2]]).min() > 10
    # A wall that is moved along itself would be the same wall.
    walls = np.array([own.point for own in records[1::2]])
    assert abs((walls[1] - walls[0]) @ np.array(records[1].normal)) > 10


def test_labels_on_the_stage_do_not_cover_each_other(page, session):
    sphere = {"kind": "Sphere", "center": [0.0, 100.0, 30.0], "radius": 5.0}
    for _ in range(4):
        record = {"kind": "Avoid", "obstacle": sphere}
        session.do({"action": "add_constraint", "id": "m1", "constraint": record})
    body = """
      const { prototype } = CanvasRenderingContext2D;
      const { fillText } = prototype;
      const found = {};
      prototype.fillText = function (text, x, y) {
        found[text] = [x, y, this.measureText(text).width];
      };
      modules.stage.redrawStage();
      while (!found["Sphere 4"]) await new Promise((resolve) => setTimeout(resolve, 20));
      prototype.fillText = fillText;
      return Object.values(found);"""
    labels = run(page, body)
    assert len(labels) >= 4
    for (x, y, width), (other_x, other_y, other_width) in combinations(labels, 2):
        assert abs(x - other_x) >= (width + other_width) / 2 or abs(y - other_y) >= 12


def test_export_says_what_is_written_and_where(page, session):
    page.locator("[data-part=export]").click()
    dialog = page.get_by_role("dialog", name="Export")
    dialog.get_by_text("No motion is ticked “Keep for export”").wait_for()
    dialog.get_by_label("folder").fill("there")
    dialog.get_by_text(f"Written to {session.folder}/there", exact=True).wait_for()
    dialog.get_by_role("button", name="Cancel").click()
    assert not list(session.folder.glob("there*"))
    session.do({"action": "keep", "id": "m2", "isKept": True})
    page.get_by_role("button", name="Export 1 motion…").click()
    dialog.get_by_text("1 motion with a tick at “Keep for export”.", exact=True).wait_for()


def test_previews_stand_still_for_who_wants_less_motion(page):
    count = """(async () => {
      const { prototype } = WebGL2RenderingContext;
      const { clear } = prototype;
      let found = 0;
      prototype.clear = function (...given) {
        found += 1;
        return clear.apply(this, given);
      };
      await new Promise((resolve) => setTimeout(resolve, 1000));
      prototype.clear = clear;
      return found;
    })()"""
    for own in ("m1", "m2", "m3"):
        until_figure(page, own)
    assert page.get_by_role("button", name="previews").get_attribute("aria-pressed") == "false"
    wait_until(page, f"{count}.then((found) => found === 0)")
    page.get_by_role("button", name="previews").click()
    wait_until(page, f"{count}.then((found) => found > 0)")


def test_parts_that_are_listed_for_another_selection_can_not_be_used(page, session):
    record = session.project.motion("m1").record
    page.locator(".card .preview").first.click()
    page.locator('.lane[data-group="upper"] .block').nth(1).click()
    use = page.locator("table.donors tbody:not([aria-busy]) button:enabled", has_text="Use")
    use.first.wait_for()
    page.evaluate("""() => {
      const block = document.querySelectorAll('.lane[data-group="upper"] .block')[2];
      block.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", bubbles: true }));
      document.querySelector("table.donors td:last-child button:enabled").click();
    }""")
    use.first.wait_for()
    page.wait_for_timeout(200)
    assert session.project.motion("m1").record == record
    use.first.focus()
    page.keyboard.press("Enter")
    state = "(async () => (await (await fetch('/api/state')).json()).motions[0].hash"
    wait_until(page, f"{state} !== '{record}')()")
