// The timeline: one lane for each joint group, blocks with their donors, seams, locks and violations.
import { ink, numberColour } from "/viewer/colours.js";
import { clamp } from "/viewer/scene.js";
import { laneOfConstraints } from "./ranges.js";
import { mainFigure, nFrames, player, seconds, seek } from "./player.js";
import { baseFigure } from "./stage.js";
import { focusOn, on, selected, store } from "./store.js";
import { icon, make, named, parts, range } from "./ui.js";

const BLOCK_WIDTH = 74; // Pixels of a block at first, about.
const WIDE_SEAM = 45; // Degrees of a seam whose mark has the full height.
const MAX_ZOOM = 200;

let zoom = 1;
let shown = ""; // What the lanes show: they are made again if it changes.
let written = 0; // Frame of the cursor.
let fitted = null; // The motion that the zoom fits.

export const toShare = (frame) => frame / Math.max(nFrames() - 1, 1);
const percent = (frame) => `${(100 * toShare(frame)).toFixed(4)}%`;
export function place(element, first, last) {
  element.style.left = percent(first);
  element.style.width = `${(100 * toShare(last - first)).toFixed(4)}%`;
  return element;
}
export function frameAt(event) {
  const box = parts.track.getBoundingClientRect();
  return Math.round(clamp((event.clientX - box.left) / box.width, 0, 1) * (nFrames() - 1));
}

export function startTimeline() {
  listenToRuler();
  parts.wider.addEventListener("click", () => setZoom(zoom / 1.6));
  parts.nearer.addEventListener("click", () => setZoom(zoom * 1.6));
  parts.lanes.addEventListener("pointerdown", beginDrag);
  parts.lanes.addEventListener("keydown", moveBetweenBlocks);
  parts.scroller.addEventListener("wheel", onWheel, { passive: false });
  new ResizeObserver(fit).observe(parts.scroller);
  on("project selected figure theme", write);
  on("frame", writeCursor);
  on("focus", writeFocus);
}

function setZoom(factor, at = player.frame) {
  const middle = toShare(at) * parts.track.clientWidth - parts.scroller.scrollLeft;
  zoom = clamp(factor, 1, MAX_ZOOM);
  parts.track.style.width = `${100 * zoom}%`;
  parts.scroller.scrollLeft = toShare(at) * parts.track.clientWidth - middle;
  writeRuler();
}

function onWheel(event) {
  if (!event.ctrlKey && !event.metaKey) return;
  event.preventDefault();
  setZoom(zoom * Math.exp(-event.deltaY * 0.0015), frameAt(event));
}

// If blocks are too narrow for their names, only a part of the timeline is visible at first.
function fit() {
  const clip = mainFigure();
  if (!clip?.rows || fitted === clip.key) return writeRuler();
  fitted = clip.key;
  const most = Math.max(1, ...clip.rows.map((row) => row.start.length));
  setZoom((most * BLOCK_WIDTH) / Math.max(parts.scroller.clientWidth, 1));
}

function writeRuler() {
  const frames = nFrames();
  const wide = parts.track.clientWidth || 1;
  const steps = [1, 2, 5, 10, 20, 30, 60, 150, 300, 600, 1500, 3000, 9000];
  const step = steps.find((own) => (own / frames) * wide > 56) || steps.at(-1);
  const key = [frames, step].join();
  if (parts.ruler.dataset.key === key) return;
  parts.ruler.dataset.key = key;
  const ticks = [];
  for (let frame = 0; frame < frames - 1 && ticks.length < 2000; frame += step) {
    const tick = make("span", { text: frame });
    tick.style.left = percent(frame);
    ticks.push(tick);
  }
  parts.ruler.replaceChildren(...ticks);
  parts.ruler.setAttribute("aria-valuemax", frames - 1);
}

function listenToRuler() {
  const { ruler } = parts;
  ruler.addEventListener("pointerdown", (event) => {
    ruler.setPointerCapture(event.pointerId);
    seek(frameAt(event));
  });
  ruler.addEventListener("pointermove", (event) => ruler.hasPointerCapture(event.pointerId) && seek(frameAt(event)));
}

function writeCursor() {
  parts.cursor.style.left = percent(player.frame);
  parts.ruler.setAttribute("aria-valuenow", player.frame);
  parts.ruler.setAttribute("aria-valuetext", `frame ${player.frame} of ${nFrames() - 1}, ${seconds(player.frame)} seconds`);
  if (player.frame === written) return; // A person may have scrolled away from it.
  written = player.frame;
  const x = toShare(player.frame) * parts.track.clientWidth;
  const { scrollLeft, clientWidth } = parts.scroller;
  if (x < scrollLeft || x > scrollLeft + clientWidth) parts.scroller.scrollLeft = x - 0.1 * clientWidth;
}

// The lanes of the selected motion: its exchanged groups, then those that its base keeps.
export function lanes() {
  const clip = mainFigure();
  if (!clip?.rows) return [];
  const own = clip.rows.map((row) => ({ clip, row, isCaptured: !row.grafted }));
  const base = clip.key?.startsWith("motion:") ? baseFigure() : null;
  const names = own.map(({ row }) => row.group);
  const others = (base?.rows || []).filter(({ group }) => !names.includes(group));
  return [...own, ...others.map((row) => ({ clip: base, row, isCaptured: true }))];
}

function write() {
  const motion = selected();
  const all = lanes();
  const shapes = all.map(({ clip, row }) => [clip.key, clip.hash, row.group]);
  const marks = [motion?.locks, motion?.violations, motion?.constraints, ink.version];
  const next = JSON.stringify([store.selected, nFrames(), shapes, marks]);
  fit();
  writeCursor();
  if (next === shown) return;
  shown = next;
  const focused = document.activeElement?.dataset?.block;
  parts.lanes.replaceChildren(...all.map((lane) => makeLane(lane, motion)));
  const rows = motion ? laneOfConstraints(motion) : [];
  parts.constraintLanes.replaceChildren(...rows.map(({ element }) => element));
  const nameOf = (name, kind, note = "") => named("div", { class: kind, title: name + note }, name, note);
  const names = all.map(({ row, isCaptured }) => nameOf(row.group, "name", isCaptured ? " captured" : ""));
  parts.laneNames.replaceChildren(nameOf("frame", "name"), ...names);
  parts.constraintNames.replaceChildren(...rows.map(({ name }) => nameOf(name, "name thin")));
  writeFocus();
  if (focused) parts.lanes.querySelector(`[data-block="${CSS.escape(focused)}"]`)?.focus();
}

// Segments share their first frame with the one before.
export const overlaps = (own, first, last) => own.first < last && own.last > first;

function makeLane({ clip, row, isCaptured }, motion) {
  const lane = make("div", { class: "lane", role: "group", "aria-label": isCaptured ? `${row.group}, captured` : row.group });
  lane.dataset.group = row.group;
  for (let part = 0; part < row.start.length; part++) lane.append(makeBlock(clip, row, part, motion, isCaptured));
  for (const own of row.changes) {
    const text = `${clip.donors[own.source]} ${range(own.first, own.last)}`;
    const block = make("div", { class: "changed", title: `changed in ${range(own.start, own.stop)}: ${text}`, text });
    block.style.backgroundColor = numberColour(own.source);
    lane.append(place(block, own.start, own.stop));
  }
  if (!motion || isCaptured) return lane;
  for (const own of motion.locks) {
    if (own.group !== null && own.group !== row.group) continue;
    const mark = make("div", { class: "locked", title: `locked in ${range(own.first, own.last)}` }, icon("lock"));
    lane.append(place(mark, own.first, own.last));
  }
  return lane;
}

function makeBlock(clip, row, part, motion, isCaptured) {
  const [first, last] = [row.start[part], row.stop[part]];
  const donor = row.source[part] < 0 ? null : clip.donors[row.source[part]];
  const frames = range(row.first[part], row.last[part]);
  const full = donor === null ? "captured" : `${donor} ${frames}`;
  const block = make("button", { type: "button", class: "block", tabindex: "-1", title: full });
  Object.assign(block.dataset, { group: row.group, part, block: `${row.group}/${part}` });
  if (donor !== null) block.style.backgroundColor = numberColour(row.source[part]);
  else block.classList.add("captured");
  const seam = isCaptured ? null : row.before[part];
  const isLocked = motion?.locks.some((own) => (own.group === null || own.group === row.group) && overlaps(own, first, last));
  const angle = seam === null ? "" : `${seam.toFixed(0)}°`;
  const said = [`donor ${donor} ${frames} ${angle}`, row.group, `segment ${part}`, `frames ${range(first, last)}`];
  // In narrow blocks, there is only the name of the clip.
  if (isCaptured || donor === null) {
    const text = isCaptured ? range(first, last) : "captured";
    said[0] = isCaptured ? `${text} captured` : text;
    block.append(make("span", { text }));
  } else {
    const clipName = make("span", { class: "clip", text: store.project.clips.length > 1 ? donor : "" });
    block.append(clipName, " ", make("span", { class: "frames", text: frames }), " ");
    if (seam >= 5) block.append(make("span", { class: "angle", text: angle }));
  }
  if (angle) said.push(`seam ${angle}`);
  if (isLocked) said.push("locked");
  block.setAttribute("aria-label", said.join(", "));
  if (seam !== null) {
    const mark = make("i", { class: "seam", title: `seam: ${seam.toFixed(1)}°` });
    mark.style.height = `${(15 + 85 * Math.min(seam / WIDE_SEAM, 1)).toFixed(0)}%`;
    block.prepend(mark);
  }
  return place(block, row.start[part], row.stop[part]);
}

function blockAt(group, frame) {
  const lane = lanes().find(({ row }) => row.group === group);
  const part = lane ? lane.row.start.findLastIndex((start) => start <= frame) : -1;
  return part < 0 ? null : { lane, part };
}

export function selectBlock(group, part, isSeeking = true) {
  const lane = lanes().find(({ row }) => row.group === group);
  if (!lane) return;
  const [first, last] = [lane.row.start[part], lane.row.stop[part]];
  focusOn({ group, first, last, part, isCaptured: lane.isCaptured });
  if (isSeeking && (player.frame < first || player.frame > last)) seek(first);
}

// A click selects a block, a drag a range of frames in its lane.
function beginDrag(event) {
  const lane = event.target.closest(".lane");
  if (!lane || event.button !== 0) return;
  const from = { x: event.clientX, frame: frameAt(event), group: lane.dataset.group };
  let isDragged = false;
  const { isCaptured } = lanes().find(({ row }) => row.group === from.group);
  const move = (next) => {
    if (!isDragged && Math.abs(next.clientX - from.x) < 5) return;
    isDragged = true;
    const [first, last] = [from.frame, frameAt(next)].sort((a, b) => a - b);
    focusOn({ group: from.group, first, last, part: null, isCaptured, isDragging: true });
  };
  const up = () => {
    window.removeEventListener("pointermove", move);
    window.removeEventListener("pointerup", up);
    window.removeEventListener("pointercancel", up);
    if (isDragged) {
      focusOn({ ...store.focus, isDragging: false });
      return seek(store.focus.first);
    }
    const found = blockAt(from.group, from.frame);
    if (!found) return;
    selectBlock(from.group, found.part, false);
    seek(from.frame);
    parts.lanes.querySelector(`[data-block="${CSS.escape(`${from.group}/${found.part}`)}"]`)?.focus({ preventScroll: true });
  };
  window.addEventListener("pointermove", move);
  window.addEventListener("pointerup", up);
  window.addEventListener("pointercancel", up);
}

// Arrow keys select the block beside or in the lane above or below; with shift they change the range.
function moveBetweenBlocks(event) {
  const { block, group, part } = event.target.dataset;
  if (!block || event.ctrlKey || event.metaKey || event.altKey) return;
  const index = Number(part);
  const all = lanes();
  const at = all.findIndex(({ row }) => row.group === group);
  const aside = { ArrowLeft: -1, ArrowRight: 1, Enter: 0, " ": 0 }[event.key];
  const lane = all[at + ({ ArrowUp: -1, ArrowDown: 1 }[event.key] ?? NaN)];
  if (aside === undefined && !lane) return;
  event.preventDefault();
  event.stopPropagation();
  if (event.shiftKey && aside && store.focus) {
    const { first, last } = store.focus;
    return focusOn({ ...store.focus, part: null, last: clamp(last + aside, first, nFrames() - 1) });
  }
  const { start } = all[at].row;
  const above = lane?.row.start.findLastIndex((frame) => frame <= start[index]);
  const target = lane ? [lane.row.group, Math.max(above, 0)] : [group, clamp(index + aside, 0, start.length - 1)];
  selectBlock(...target);
  parts.lanes.querySelector(`[data-block="${CSS.escape(target.join("/"))}"]`)?.focus();
}

function writeFocus() {
  const { focus } = store;
  for (const block of parts.lanes.querySelectorAll(".block")) {
    const isSelected = focus && focus.part !== null && block.dataset.block === `${focus.group}/${focus.part}`;
    block.setAttribute("aria-pressed", Boolean(isSelected));
    block.tabIndex = isSelected ? 0 : -1;
  }
  if (!parts.lanes.querySelector('.block[tabindex="0"]')) parts.lanes.querySelector(".block")?.setAttribute("tabindex", "0");
  parts.range.hidden = !focus;
  parts.selection.textContent = "Click a block, or drag over frames.";
  if (!focus) return;
  parts.selection.textContent = `${focus.group ?? "all groups"}, frames ${range(focus.first, focus.last)}`;
  place(parts.range, focus.first, Math.max(focus.last, focus.first + 0.5));
  const lane = parts.lanes.querySelector(`[data-group="${CSS.escape(focus.group ?? "")}"].lane`);
  parts.range.style.top = lane ? `${lane.offsetTop}px` : "0";
  parts.range.style.height = lane ? `${lane.offsetHeight}px` : "100%";
}

// Begin or end the selected range at the current frame.
export function setRange(end) {
  const group = store.focus?.group ?? lanes()[0]?.row.group ?? null;
  const frames = store.focus ? [store.focus.first, store.focus.last] : [player.frame, player.frame];
  frames[end] = player.frame;
  const [first, last] = frames[0] <= frames[1] ? frames : [player.frame, player.frame];
  focusOn({ group, first, last, part: null, isCaptured: store.focus?.isCaptured ?? false });
}
