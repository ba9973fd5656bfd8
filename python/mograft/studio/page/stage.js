// The stage: the base and the graft beside each other or in one view, their camera, and marks.
import { ink } from "/viewer/colours.js";
import { nodePlace } from "/viewer/poses.js";
import { clamp, partAt, state } from "/viewer/scene.js";
import { figureOf, ghostOf } from "./figures.js";
import { frameTime, mainFigure, player } from "./player.js";
import { emit, on, selected, store } from "./store.js";
import { parts } from "./ui.js";
import { addRegion, redraw } from "./view.js";

const ONION_SECONDS = 0.3; // Time between onion skins.
const WIDE_ENOUGH = 460; // Width in pixels from which base and graft fit beside each other.

const [baseTile, graftTile] = [parts.baseTile, parts.graftTile];
const marks = parts.marks;
const pen = marks.getContext("2d");
const stand = { frame: 0 };
const top = { yaw: 0, pitch: 1.55, zoom: 0.55, pan: [0, 0] }; // The camera while a path is drawn.

export const stage = { graft: null, base: null, view: null };
const objectMakers = []; // Functions that return objects of the world for the view of the graft.
const figureMakers = []; // Functions that return further figures in the view of the graft.
const markers = []; // Functions that draw marks above the view of the graft.
const clickers = new Map(); // For each mode, what a click or drag on the stage does.
export const onObjects = (maker) => objectMakers.push(maker);
export const onFigures = (maker) => figureMakers.push(maker);
export const onMarks = (marker) => markers.push(marker);
export const onPointer = (mode, handlers) => clickers.set(mode, handlers);

export const baseFigure = () => {
  const motion = selected();
  if (motion?.isComposed) return figureOf("base", motion.id);
  const isClip = motion && store.project.clips.some(({ name }) => name === motion.base);
  return isClip ? figureOf("clip", motion.base) : null;
};
export const frameIn = (clip, frame = player.frame) => clamp(Math.round((frame * frameTime()) / clip.dt), 0, clip.frames - 1);

export function startStage() {
  stage.base = addRegion(baseTile, prepareBase, { isStage: true });
  stage.graft = addRegion(graftTile, prepareGraft, { isStage: true });
  listenToTile(baseTile);
  listenToTile(graftTile);
  new ResizeObserver(layOut).observe(parts.tiles);
  on("project selected figure layout", layOut);
  on("frame focus mode", redrawStage);
  on("frame figure project selected", writeCaption);
}

export function redrawStage() {
  redraw(stage.base);
  redraw(stage.graft);
}

// The base has a tile of its own if it is shown beside the graft and there is room.
const hasTwoTiles = () => store.layout === "beside" && store.mode === "view" && baseFigure() !== null;

let drawn = []; // What the two tiles show.
function layOut() {
  const tiles = parts.tiles;
  const isTwo = hasTwoTiles();
  baseTile.hidden = !isTwo;
  tiles.classList.toggle("stacked", isTwo && tiles.clientWidth < WIDE_ENOUGH);
  const ratio = (marks.ratio = Math.min(window.devicePixelRatio || 1, 2));
  const [width, height] = [marks.clientWidth, marks.clientHeight].map((own) => Math.round(own * ratio));
  if (marks.width !== width || marks.height !== height) Object.assign(marks, { width, height });
  const looks = [baseFigure(), mainFigure()].map((own) => [own, own?.values, own?.hash]);
  const { constraints, violations } = selected() || {};
  looks[0].push(isTwo, store.layout, store.mode, width, height);
  looks[1].push(JSON.stringify([constraints, violations, store.project?.groups, store.project?.skeleton]));
  const isNew = looks.map((own, i) => own.some((value, k) => value !== drawn[i]?.[k]));
  drawn = looks;
  if (isNew[0]) redrawStage();
  else if (isNew[1]) redraw(stage.graft);
}

function prepareBase() {
  const clip = hasTwoTiles() ? baseFigure() : null;
  if (!clip) return null;
  return { figures: [{ clip, frame: frameIn(clip) }], follow: store.follow, stand: stand.frame };
}

function prepareGraft() {
  const clip = mainFigure();
  clearMarks();
  if (!clip) return null;
  const frame = frameIn(clip);
  const figures = [{ clip, frame }];
  const base = baseFigure();
  if (base && store.layout === "overlay" && store.mode === "view")
    figures.push({ clip: base, frame: frameIn(base), alpha: 0.4, colour: ink.body });
  if (store.onion) {
    const gap = ONION_SECONDS / clip.dt;
    [-2, -1, 1, 2].forEach((step, i) => {
      const own = Math.round(frame + step * gap);
      if (own < 0 || own >= clip.frames) return;
      figures.push({ clip: ghostOf(clip, i), frame: own, alpha: Math.abs(step) === 1 ? 0.3 : 0.15 });
    });
  }
  for (const maker of figureMakers) figures.push(...maker(clip, frame));
  const isDrawing = store.mode === "draw";
  const objects = objectMakers.flatMap((make) => make(clip, frame));
  const seen = { follow: store.follow, stand: stand.frame, look: state };
  return { figures, objects, after: drawMarks, ...(isDrawing ? { follow: false, stand: 0, look: top } : seen) };
}

function clearMarks() {
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.clearRect(0, 0, marks.width, marks.height);
}

function drawMarks(view) {
  stage.view = view;
  const ratio = marks.ratio || 1;
  pen.setTransform(ratio, 0, 0, ratio, ratio * graftTile.offsetLeft, ratio * graftTile.offsetTop);
  labels = [];
  drawViolations(view);
  for (const marker of markers) marker(pen, view);
}

let labels = []; // Places of those that are drawn: others are drawn above them.
export function label(text, x, y, { width }) {
  pen.font = "12px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.lineWidth = 4;
  pen.lineJoin = "round";
  const half = pen.measureText(text).width / 2 + 4;
  const middle = clamp(x, half, Math.max(width - half, half));
  const isOver = (own) => Math.abs(own.middle - middle) < own.half + half && Math.abs(own.y - y) < 15;
  while (labels.some(isOver)) y -= 4;
  labels.push({ middle, half, y });
  const colour = pen.fillStyle;
  pen.strokeStyle = ink.paper;
  pen.strokeText(text, middle, y);
  pen.fillStyle = colour;
  pen.fillText(text, middle, y);
}

// A ring and an exclamation mark at each joint that violates a constraint in this frame.
function drawViolations(view) {
  const joints = store.project?.skeleton?.joints.map(({ name }) => name) || [];
  for (const { first, last, joint } of selected()?.violations || []) {
    const index = joints.indexOf(joint);
    if (player.frame < first || player.frame > last || index < 0 || index >= view.clip.parents.length) continue;
    const [x, y, depth] = view.point(nodePlace(view.clip, view.clip.now, index));
    if (depth > 1) continue;
    pen.strokeStyle = pen.fillStyle = ink.accent;
    pen.lineWidth = 2.5;
    pen.beginPath();
    pen.arc(x, y, 11, 0, 2 * Math.PI);
    pen.stroke();
    label(`! ${joint}`, x, y - 16, view);
  }
}

let caption = "";
function writeCaption() {
  const motion = selected();
  const clip = mainFigure();
  parts.graftTile.hidden = !clip && !motion;
  parts.graftName.textContent = motion?.name ?? clip?.name ?? "";
  parts.graftNote.textContent = motion ? (clip ? `graft of ${motion.base}` : "is loaded…") : clip ? "captured" : "";
  parts.baseName.textContent = motion?.base ?? "";
  parts.baseNote.textContent = motion?.isComposed ? "composed of captured parts" : "captured";
  const texts = (motion && clip?.rows ? clip.rows : []).map((row) => sourceText(clip, row));
  const text = texts.filter(Boolean).join(" · ");
  if (text !== caption) parts.now.textContent = caption = text;
}

function sourceText(clip, row) {
  const at = partAt(row, player.frame);
  if (at < 0 || row.source[at] < 0) return "";
  return `${row.group} from ${clip.donors[row.source[at]]} ${row.first[at]}–${row.last[at]}`;
}

export function orbit(yaw, pitch) {
  state.yaw += yaw;
  state.pitch = clamp(state.pitch + pitch, -0.3, 1.55);
  redrawStage();
}
function pan(dx, dy) {
  const look = store.mode === "draw" ? top : state;
  const scale = 4 / (Math.min(graftTile.clientWidth, graftTile.clientHeight) * look.zoom);
  look.pan = [look.pan[0] + dx * scale, look.pan[1] - dy * scale];
  redrawStage();
}
export function zoom(factor) {
  const look = store.mode === "draw" ? top : state;
  look.zoom = clamp(look.zoom * factor, 0.05, 20);
  redrawStage();
}
export function resetCamera() {
  Object.assign(state, { yaw: 0.55, pitch: 0.22, zoom: 1, pan: [0, 0] });
  Object.assign(top, { yaw: 0, pitch: 1.55, zoom: 0.55, pan: [0, 0] });
  stand.frame = player.frame;
  redrawStage();
}
export function standStill() {
  stand.frame = player.frame;
}

// What a pointer does on the stage from now on, and what the page says about it.
export function setStageMode(mode, hint = "") {
  store.mode = mode;
  parts.hint.hidden = !hint;
  parts.hint.textContent = hint;
  emit("mode");
  emit("layout");
}

const gizmoGuards = []; // Functions that return whether a gizmo takes the pointer.
export const onGizmo = (guard) => gizmoGuards.push(guard);

// One pointer rotates the camera or does what the mode asks for; two move and zoom it.
function listenToTile(tile) {
  const fingers = new Map();
  const place = (event) => {
    const box = tile.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const gauge = () => {
    const [p, q] = [...fingers.values()];
    return { middle: [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2], apart: Math.max(Math.hypot(p[0] - q[0], p[1] - q[1]), 8) };
  };
  let start = null;
  const mode = () => (tile === graftTile ? clickers.get(store.mode) : null);
  tile.addEventListener("contextmenu", (event) => event.preventDefault());
  tile.addEventListener("pointerdown", (event) => {
    if (gizmoGuards.some((guard) => guard())) return;
    tile.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, place(event));
    start = fingers.size === 1 ? place(event) : null;
    if (start && !event.shiftKey) mode()?.down?.(place(event), stage.view);
  });
  tile.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    const at = place(event);
    if (!before) return mode()?.hover?.(at, stage.view);
    const old = fingers.size === 2 ? gauge() : null;
    fingers.set(event.pointerId, at);
    const step = [at[0] - before[0], at[1] - before[1]];
    if (old) {
      const { middle, apart } = gauge();
      zoom(apart / old.apart);
      return pan(middle[0] - old.middle[0], middle[1] - old.middle[1]);
    }
    if (event.shiftKey || event.buttons & 6) return pan(...step);
    if (mode()?.drag) return mode().drag(at, stage.view);
    orbit(-step[0] * 0.008, step[1] * 0.008);
  });
  for (const kind of ["pointerup", "pointercancel"]) {
    tile.addEventListener(kind, (event) => {
      if (!fingers.delete(event.pointerId)) return;
      const at = place(event);
      const isClick = start && Math.hypot(at[0] - start[0], at[1] - start[1]) < 5;
      if (kind === "pointerup") mode()?.up?.(at, stage.view);
      if (kind === "pointerup" && isClick) mode()?.click?.(at, stage.view, event);
      start = null;
    });
  }
  // Where the page scrolls, the wheel zooms only in a tile that has the focus.
  const onWheel = (event) => {
    if (document.documentElement.scrollHeight > window.innerHeight + 1 && tile !== document.activeElement) return;
    event.preventDefault();
    zoom(Math.exp(-event.deltaY * 0.0012));
  };
  tile.addEventListener("wheel", onWheel, { passive: false });
}

// The point of the floor, or of another height, below a place of the view of the graft.
export function floorPoint([x, y], { camera, width, height, clip }) {
  const ray = new THREE.Raycaster();
  ray.setFromCamera(new THREE.Vector2((2 * x) / width - 1, 1 - (2 * y) / height), camera);
  const plane = new THREE.Plane(new THREE.Vector3(0, 1, 0), -clip.floor);
  return ray.ray.intersectPlane(plane, new THREE.Vector3());
}
