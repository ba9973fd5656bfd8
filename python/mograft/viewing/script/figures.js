// Which figures are shown, and their captions: name, how new it is, and the donors in this frame.
import { mark, markOf, onChoice } from "./choices.js";
import { load } from "./poses.js";
import { clipFrame, clips, create, createButton, find, partAt, shownClips, size, state } from "./scene.js";
import { tiles } from "./stage.js";
import { donorName } from "./timeline.js";

let captions = [];

function markButtons(clip) {
  if (clip.keep === null) return [];
  return Object.entries({ star: "Keep", reject: "Reject" }).map(([value, text]) => {
    const button = createButton(text, `${text} this motion in the command below`, () => mark(clip, value));
    button.ariaLabel = `${text} this motion: ${clip.name}`;
    button.dataset.mark = value;
    return button;
  });
}

export function makeCaptions() {
  captions = shownClips().map((clip) => {
    const box = create("div", undefined, "caption");
    const now = create("div", "", "now");
    const head = create("div", undefined, "head");
    head.append(create("bdi", clip.name), ...markButtons(clip));
    const note = create("div", clip.note, "now note");
    note.title = clip.note;
    box.append(head, note, now);
    return { box, now, clip };
  });
  find("captions").replaceChildren(...captions.map(({ box }) => box));
  placeCaptions();
  markCaptions();
}

function markCaptions() {
  for (const { box, clip } of captions) {
    for (const button of box.querySelectorAll("button"))
      button.setAttribute("aria-pressed", markOf(clip) === button.dataset.mark);
    box.classList.toggle("rejected", markOf(clip) === "reject");
  }
}
onChoice(markCaptions);

// A caption covers the tile of its figure; its edges separate the tiles.
export function placeCaptions() {
  const places = tiles();
  captions.forEach(({ box }, i) => {
    const [left, top, width, height] = state.overlay ? [0, i * 64, size.width, 64] : places[i];
    Object.assign(box.style, { left: `${left}px`, top: `${top}px`, width: `${width}px`, height: `${height}px` });
    box.classList.toggle("beside", left > 0);
    box.classList.toggle("below", top > 0 && !state.overlay);
    box.style.opacity = state.overlay && i ? "0.65" : "1";
  });
}

export function writeCaptions() {
  for (const { clip, now } of captions) {
    const frame = clipFrame(clip, state.frame);
    const text = clip.rows
      .map((row) => [row, partAt(row, frame)])
      .filter(([row, at]) => at >= 0 && row.source[at] >= 0)
      .map(([row, at]) => `${row.group} from ${donorName(row, at)} ${row.first[at]}–${row.last[at]}`)
      .join(" · ");
    if (text !== now.textContent) now.textContent = text;
  }
}

function markChosen() {
  const buttons = find("figures").querySelectorAll("button");
  buttons.forEach((button, i) => button.setAttribute("aria-pressed", state.shown.includes(i)));
}

// Show the figures of the given indices, in this order, which must have been loaded.
export function showFigures(indices, onChange) {
  state.shown = indices;
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
    const title = "Show or hide; with shift, show this figure beside the first one only";
    const button = createButton("", title, async (event) => {
      // A figure is decoded when it is shown for the first time.
      await Promise.all([load(clips[0]), load(clip)]);
      const others = state.shown.filter((k) => k !== i);
      if (event.shiftKey) showFigures(i ? [0, i] : [0], onChange);
      else if (others.length === state.shown.length) showFigures([...others, i].sort((a, b) => a - b), onChange);
      else if (others.length) showFigures(others, onChange);
    });
    button.append(create("bdi", clip.name));
    box.append(button);
  });
  markChosen();
}
