// Pointer and keyboard.
import { cut, play, redraw, seek, show, zoomTime } from "./player.js";
import { clamp, find, isAlone, nFrames, root, size, state } from "./scene.js";
import { placeCaptions } from "./figures.js";
import { overviewFrame, segmentAt, toFrame } from "./timeline.js";

// The wheel zooms while the viewer has the focus; otherwise the page, or the notebook around it,
// scrolls. A page that contains only the viewer does not scroll.
const isFilling = isAlone && window.self === window.top;
const capturesWheel = () => isFilling || (document.hasFocus() && root.contains(document.activeElement));

function orbit(yaw, pitch) {
  state.yaw += yaw;
  state.pitch = clamp(state.pitch + pitch, -0.3, 1.55);
  redraw();
}
function pan(dx, dy) {
  const scale = 4 / (Math.min(size.width, size.height) * state.zoom);
  state.pan = [state.pan[0] + dx * scale, state.pan[1] - dy * scale];
  redraw();
}
function zoom(factor) {
  state.zoom = clamp(state.zoom * factor, 0.1, 20);
  redraw();
}
export function resetCamera() {
  Object.assign(state, { yaw: 0.55, pitch: 0.22, zoom: 1, pan: [0, 0], stand: state.frame });
  redraw();
}

export function toggle(name, value = !state[name]) {
  state[name] = value;
  if (name === "follow") state.stand = state.frame;
  find(name).setAttribute("aria-pressed", value);
  placeCaptions();
  redraw();
}

export function listenToStage(stage) {
  const fingers = new Map();
  let spread = 0;
  stage.addEventListener("contextmenu", (event) => event.preventDefault());
  stage.addEventListener("pointerdown", (event) => {
    stage.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    spread = 0;
  });
  for (const kind of ["pointerup", "pointercancel"]) {
    stage.addEventListener(kind, (event) => fingers.delete(event.pointerId));
  }
  stage.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (fingers.size === 2) {
      const [p, q] = [...fingers.values()];
      const apart = Math.hypot(p[0] - q[0], p[1] - q[1]);
      if (spread) state.zoom = clamp(state.zoom * (apart / spread), 0.1, 20);
      spread = apart;
      pan(dx / 2, dy / 2);
    } else if (event.shiftKey || event.buttons & 6) pan(dx, dy);
    else orbit(-dx * 0.008, dy * 0.008);
  });
  stage.addEventListener(
    "wheel",
    (event) => {
      if (!capturesWheel()) return;
      event.preventDefault();
      zoom(Math.exp(-event.deltaY * 0.0012));
    },
    { passive: false },
  );
}

// Drag over the rows selects a range; drag over the overview seeks; two fingers zoom both.
export function listenToTimeline(canvas, hasRows) {
  const fingers = new Map();
  let start = null; // The frame at which the pointer went down.
  let spread = 0;
  const frameOf = (x) => (hasRows ? toFrame : overviewFrame)(x, canvas.clientWidth);
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    const at = place(event);
    fingers.set(event.pointerId, at[0]);
    spread = 0;
    start = fingers.size === 1 ? at : null;
    if (!hasRows) seek(frameOf(at[0]));
  });
  canvas.addEventListener("pointermove", (event) => {
    const at = place(event);
    if (hasRows) state.hovered = segmentAt(...at);
    if (fingers.has(event.pointerId)) fingers.set(event.pointerId, at[0]);
    if (fingers.size === 2) {
      const [a, b] = [...fingers.values()];
      const apart = Math.max(Math.abs(a - b), 8);
      if (spread) zoomTime(spread / apart, frameOf((a + b) / 2));
      spread = apart;
    } else if (start && !hasRows) seek(clamp(frameOf(at[0]), 0, nFrames - 1));
    else if (start && Math.abs(at[0] - start[0]) > 4) {
      const ends = [start[0], at[0]].map((x) => Math.round(clamp(frameOf(x), ...state.window)));
      state.range = ends.sort((a, b) => a - b);
    }
    redraw();
  });
  canvas.addEventListener("pointerup", (event) => {
    fingers.delete(event.pointerId);
    const at = place(event);
    if (hasRows && start && Math.abs(at[0] - start[0]) <= 4) {
      state.pinned = segmentAt(...at);
      if (state.range && (frameOf(at[0]) < state.range[0] || frameOf(at[0]) > state.range[1])) state.range = null;
      seek(clamp(frameOf(at[0]), ...state.window));
    } else if (hasRows && start && state.range) {
      state.pinned ||= segmentAt(...start);
      seek(state.range[0]);
    }
    start = null;
  });
  canvas.addEventListener("pointercancel", (event) => {
    fingers.delete(event.pointerId);
    start = null;
  });
  canvas.addEventListener("pointerleave", () => {
    state.hovered = null;
    redraw();
  });
  canvas.addEventListener(
    "wheel",
    (event) => {
      if (!event.ctrlKey && !capturesWheel()) return;
      event.preventDefault();
      const [a, b] = state.window;
      if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) show(a + (event.deltaX / canvas.clientWidth) * (b - a), b - a);
      else zoomTime(Math.exp(event.deltaY * 0.0015), frameOf(place(event)[0]));
    },
    { passive: false },
  );
}

// Begin or end the selected range at the current frame.
function setRange(end) {
  const range = state.range || [state.frame, state.frame];
  range[end] = state.frame;
  state.range = range[0] <= range[1] ? [...range] : [state.frame, state.frame];
  redraw();
}

const KEYS = {
  ArrowRight: (event) => seek(state.frame + (event.shiftKey ? 10 : 1)),
  ArrowLeft: (event) => seek(state.frame - (event.shiftKey ? 10 : 1)),
  Home: () => seek(0),
  End: () => seek(nFrames - 1),
  "[": () => cut(-1),
  "]": () => cut(1),
  o: () => toggle("overlay"),
  f: () => toggle("follow"),
  t: () => toggle("trails"),
  g: () => toggle("floor"),
  l: () => toggle("loop"),
  c: () => toggle("colours"),
  m: () => toggle("mesh"),
  k: () => toggle("clusters"),
  i: () => setRange(0),
  u: () => setRange(1),
  Escape: () => {
    state.range = state.pinned = null;
    redraw();
  },
  a: () => orbit(-0.15, 0),
  d: () => orbit(0.15, 0),
  w: () => orbit(0, 0.1),
  s: () => orbit(0, -0.1),
  "+": () => zoom(1.2),
  "-": () => zoom(1 / 1.2),
  0: resetCamera,
  "?": () => find("keys").showModal(),
};

const isText = (element) => element.closest("input:not([readonly]), textarea, [contenteditable]");
const isOther = (event) => event.ctrlKey || event.metaKey || event.altKey || find("keys").open;

export function listenToKeys() {
  // Space plays wherever the focus is. Enter still presses buttons and opens lists.
  for (const kind of ["keydown", "keyup"]) {
    document.addEventListener(kind, (event) => {
      if (event.key !== " " || isOther(event) || isText(event.target)) return;
      event.preventDefault();
      if (kind === "keydown" && !event.repeat) play();
    });
  }
  (isAlone ? document : root).addEventListener("keydown", (event) => {
    const act = KEYS[event.key];
    if (!act || isOther(event) || isText(event.target) || event.target.closest("select, summary")) return;
    event.preventDefault();
    act(event);
  });
}
