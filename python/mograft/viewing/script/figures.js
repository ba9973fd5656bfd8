// Which figures are shown, and their captions: the names, and the donors in this frame.
import { tiles } from "./camera.js";
import { load } from "./poses.js";
import { clipFrame, clips, create, find, partAt, scene, shownClips, size, state } from "./scene.js";

let captions = [];

export function makeCaptions() {
  captions = shownClips().map((clip) => {
    const box = create("div", undefined, "caption");
    const now = create("div", "", "now");
    box.append(create("bdi", clip.name), now);
    return { box, now, text: "" };
  });
  find("captions").replaceChildren(...captions.map(({ box }) => box));
  placeCaptions();
}

export function placeCaptions() {
  const places = tiles();
  captions.forEach(({ box }, i) => {
    const tile = state.overlay ? [0, i * 40, size.width, 40] : places[i];
    box.style.left = `${tile[0]}px`;
    box.style.top = `${tile[1]}px`;
    box.style.width = `${tile[2]}px`;
    box.style.opacity = state.overlay && i ? "0.65" : "1";
  });
}

export function writeCaptions() {
  shownClips().forEach((clip, i) => {
    const frame = clipFrame(clip, state.frame);
    const text = clip.rows
      .map((row) => [row, partAt(row, frame)])
      .filter(([row, at]) => at >= 0 && row.source[at] >= 0)
      .map(([row, at]) => `${row.group} ← ${scene.donors[row.source[at]]} ${row.first[at]}–${row.last[at]}`)
      .join(" · ");
    if (text !== captions[i].text) captions[i].now.textContent = captions[i].text = text;
  });
}

function markChosen() {
  const buttons = find("figures").querySelectorAll("button");
  buttons.forEach((button, i) => button.setAttribute("aria-pressed", state.shown.includes(i)));
}

// Show the figures of the given indices, which must have been loaded.
function showFigures(indices, onChange) {
  state.shown = [...indices].sort((a, b) => a - b);
  if (state.pinned && !shownClips().includes(state.pinned.line.clip)) state.pinned = null;
  state.hovered = null;
  makeCaptions();
  markChosen();
  onChange();
}

// One button per figure; several figures are shown side by side.
export function makeFigureButtons(onChange) {
  const box = find("figures");
  box.hidden = clips.length < 3;
  clips.forEach((clip, i) => {
    const button = create("button");
    button.type = "button";
    button.title = "Show or hide; with shift, show this figure beside the first one only";
    button.append(create("bdi", clip.name));
    button.addEventListener("click", async (event) => {
      // A figure is decoded when it is shown for the first time.
      await Promise.all([load(clips[0]), load(clip)]);
      const others = state.shown.filter((k) => k !== i);
      if (event.shiftKey) showFigures(i ? [0, i] : [0], onChange);
      else if (others.length === state.shown.length) showFigures([...others, i], onChange);
      else if (others.length) showFigures(others, onChange);
    });
    box.append(button);
  });
  markChosen();
}
