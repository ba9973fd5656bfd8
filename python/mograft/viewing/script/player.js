// The current frame, playback, and drawing after a change.
import { clips, find, first, nFrames, state, toPageFrame } from "./scene.js";

const drawers = [];
export const onDraw = (drawer) => drawers.push(drawer);

let isAsked = false;
export function draw() {
  isAsked = false;
  for (const drawer of drawers) drawer();
}
export function redraw() {
  if (isAsked) return;
  isAsked = true;
  requestAnimationFrame(draw);
}

export const seconds = () => (state.frame * first.dt).toFixed(2);
export function writeFrame() {
  find("time").textContent = `${seconds()} s`;
  if (document.activeElement !== find("frame")) find("frame").value = state.frame;
}

export function show(start, span) {
  const length = Math.max(Math.min(span, nFrames - 1), Math.min(20, nFrames - 1));
  const from = Math.max(0, Math.min(start, nFrames - 1 - length));
  state.window = [from, from + length];
  redraw();
}
export function zoomTime(factor, around) {
  const [a, b] = state.window;
  show(around - (around - a) * factor, (b - a) * factor);
}

export function seek(frame) {
  state.frame = Math.max(0, Math.min(nFrames - 1, Math.round(frame)));
  const [a, b] = state.window;
  if (state.frame < a || state.frame > b) show(state.frame - 0.1 * (b - a), b - a);
  redraw();
}

// The frames that repeat: the selected range, or else those of the selected segment.
function loopFrames() {
  const { pinned, range } = state;
  if (range || !pinned) return range;
  const { clip, row } = pinned.line;
  return [row.start, row.stop].map((frames) => Math.round(toPageFrame(clip, frames[pinned.part])));
}

let clock = 0;
let carried = 0;
function tick(time) {
  if (!state.playing) return;
  carried += ((time - clock) / 1000) * (state.speed / first.dt);
  clock = time;
  const whole = Math.floor(carried);
  if (whole > 0) {
    carried -= whole;
    let next = state.frame + whole;
    const [from, to] = (state.loop && loopFrames()) || [0, nFrames - 1];
    if (next > to || next < from) next = from;
    seek(next);
  }
  requestAnimationFrame(tick);
}

export function play(on = !state.playing) {
  state.playing = on && nFrames > 1;
  find("play").ariaLabel = state.playing ? "Pause" : "Play";
  find("play").dataset.on = state.playing ? "1" : "";
  clock = performance.now();
  carried = 0;
  if (state.playing) requestAnimationFrame(tick);
}

// Go to the previous or next segment boundary.
export function cut(direction) {
  const cuts = new Set([0, nFrames - 1]);
  const { pinned } = state;
  const clip = pinned ? pinned.line.clip : clips[state.shown.find((i) => clips[i].rows.length)];
  const row = pinned ? pinned.line.row : clip?.rows[0];
  if (row) for (const frame of row.start) cuts.add(Math.round(toPageFrame(clip, frame)));
  const sorted = [...cuts].sort((a, b) => a - b);
  const next = direction > 0 ? sorted.find((f) => f > state.frame) : sorted.findLast((f) => f < state.frame);
  if (next !== undefined) seek(next);
}
