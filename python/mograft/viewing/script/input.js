// Pointer and keyboard.
import { cut, play, redraw, seek, show, zoomTime } from "./player.js";
import { clamp, find, isAlone, nFrames, root, size, stage, state } from "./scene.js";
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
  find(name).ariaPressed = value;
  placeCaptions();
  redraw();
}

// Follow the pointers of an element. `down`, `move` and `up` receive the place of a single pointer,
// `move` also the steps since the last event; `pinch` receives the middle of two pointers, by which
// factor they moved apart, and how their middle moved; `wheel` the event and its place.
function listenToPointers(element, { down = () => {}, move, up = () => {}, pinch, wheel }) {
  const fingers = new Map();
  const place = (event) => {
    const box = element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const gauge = () => {
    const [p, q] = [...fingers.values()];
    return { middle: [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2], apart: Math.max(Math.hypot(p[0] - q[0], p[1] - q[1]), 8) };
  };
  element.addEventListener("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, place(event));
    down(fingers.size === 1 ? place(event) : null);
  });
  element.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    const at = place(event);
    const old = fingers.size === 2 && before ? gauge() : null;
    if (before) fingers.set(event.pointerId, at);
    if (!old) return move(event, at, before && [at[0] - before[0], at[1] - before[1]]);
    const { middle, apart } = gauge();
    pinch(middle, apart / old.apart, [middle[0] - old.middle[0], middle[1] - old.middle[1]]);
  });
  for (const kind of ["pointerup", "pointercancel"]) {
    element.addEventListener(kind, (event) => {
      fingers.delete(event.pointerId);
      up(kind === "pointerup" ? place(event) : null);
    });
  }
  const onWheel = (event) => {
    if (!capturesWheel() && !(event.ctrlKey && element !== stage)) return;
    event.preventDefault();
    wheel(event, place(event));
  };
  element.addEventListener("wheel", onWheel, { passive: false });
}

export function listenToStage() {
  stage.addEventListener("contextmenu", (event) => event.preventDefault());
  listenToPointers(stage, {
    move: (event, _, step) => {
      if (!step) return;
      if (event.shiftKey || event.buttons & 6) pan(...step);
      else orbit(-step[0] * 0.008, step[1] * 0.008);
    },
    pinch: (_, factor, step) => {
      zoom(factor);
      pan(...step);
    },
    wheel: (event) => zoom(Math.exp(-event.deltaY * 0.0012)),
  });
}

// Drag over the rows selects a range; drag over the overview seeks; two fingers zoom both.
export function listenToTimeline(canvas, hasRows) {
  let start = null; // Where a single pointer went down.
  const frameOf = (x) => (hasRows ? toFrame : overviewFrame)(x, canvas.clientWidth);
  const isClick = (at) => Math.abs(at[0] - start[0]) <= 4;
  listenToPointers(canvas, {
    down: (at) => {
      start = at;
      if (at && !hasRows) seek(frameOf(at[0]));
    },
    move: (_, at, step) => {
      if (hasRows) state.hovered = segmentAt(...at);
      if (step && start && !hasRows) seek(clamp(frameOf(at[0]), 0, nFrames - 1));
      else if (step && start && !isClick(at)) {
        const ends = [start[0], at[0]].map((x) => Math.round(clamp(frameOf(x), ...state.window)));
        state.range = ends.sort((a, b) => a - b);
      }
      redraw();
    },
    up: (at) => {
      if (at && start && hasRows) {
        const frame = clamp(frameOf(at[0]), ...state.window);
        if (isClick(at)) {
          state.pinned = segmentAt(...at);
          if (state.range && (frame < state.range[0] || frame > state.range[1])) state.range = null;
        } else state.pinned ||= segmentAt(...start);
        seek(isClick(at) ? frame : state.range[0]);
      }
      start = null;
    },
    pinch: (middle, factor) => zoomTime(1 / factor, frameOf(middle[0])),
    wheel: (event, at) => {
      const [a, b] = state.window;
      if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) show(a + (event.deltaX / canvas.clientWidth) * (b - a), b - a);
      else zoomTime(Math.exp(event.deltaY * 0.0015), frameOf(at[0]));
    },
  });
  canvas.addEventListener("pointerleave", () => {
    state.hovered = null;
    redraw();
  });
}

// Begin or end the selected range at the current frame.
function setRange(end) {
  const range = state.range || [state.frame, state.frame];
  range[end] = state.frame;
  state.range = range[0] <= range[1] ? [...range] : [state.frame, state.frame];
  redraw();
}

// The buttons that switch a part of the state, by their keys.
export const TOGGLES = {
  ...{ o: "overlay", f: "follow", t: "trails", g: "floor" },
  ...{ l: "loop", c: "colours", m: "mesh", k: "clusters" },
};

const KEYS = {
  ArrowRight: (event) => seek(state.frame + (event.shiftKey ? 10 : 1)),
  ArrowLeft: (event) => seek(state.frame - (event.shiftKey ? 10 : 1)),
  Home: () => seek(0),
  End: () => seek(nFrames - 1),
  "[": () => cut(-1),
  "]": () => cut(1),
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
    const act = KEYS[event.key] || (TOGGLES[event.key] && (() => toggle(TOGGLES[event.key])));
    if (!act || isOther(event) || isText(event.target) || event.target.closest("select, summary")) return;
    event.preventDefault();
    act(event);
  });
}
