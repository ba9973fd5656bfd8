// The current frame of the selected motion, and playback.
import { setPose } from "/viewer/poses.js";
import { clamp } from "/viewer/scene.js";
import { figureOf } from "./figures.js";
import { emit, on, selected, store } from "./store.js";
import { parts } from "./ui.js";

export const player = { frame: 0, isPlaying: false, speed: 1 };

export const motionFigure = () => figureOf("motion", store.selected);
// The figure whose frames the page counts: the selected motion, or else the first clip.
export const mainFigure = () => (selected() ? motionFigure() : figureOf("clip", shownClip()?.name));
// Without a selected motion, the stage shows the clip that is chosen as base.
const shownClip = () => store.project?.clips.find(({ name }) => name === store.clip) || store.project?.clips[0];
export const nFrames = () => selected()?.frames ?? shownClip()?.frames ?? 1;
export const frameTime = () => (selected() ? 1 / selected().rate : (mainFigure()?.dt ?? 1 / 30));
export const seconds = (frame) => (frame * frameTime()).toFixed(2);

// The pose of a figure in the current frame; pictures of cards leave other poses.
export function poseNow(clip) {
  const frame = clamp(Math.round((player.frame * frameTime()) / clip.dt), 0, clip.frames - 1);
  return setPose(clip, frame, clip.now);
}

export function seek(frame) {
  player.frame = clamp(Math.round(frame), 0, nFrames() - 1);
  writeFrame();
  emit("frame");
}

function writeFrame() {
  parts.time.textContent = `${seconds(player.frame)} s`;
  parts.total.textContent = `of ${nFrames() - 1}`;
  const input = parts.frame;
  input.max = nFrames() - 1;
  if (document.activeElement !== input) input.value = player.frame;
}

let clock = 0;
let carried = 0;
function tick(time) {
  if (!player.isPlaying) return;
  carried += ((time - clock) / 1000) * (player.speed / frameTime());
  clock = time;
  const whole = Math.floor(carried);
  if (whole > 0) {
    carried -= whole;
    const { focus, loop } = store;
    const [from, to] = loop && focus ? [focus.first, focus.last] : [0, nFrames() - 1];
    const next = player.frame + whole;
    seek(next > to || next < from ? from : next);
  }
  requestAnimationFrame(tick);
}

export function play(isOn = !player.isPlaying) {
  player.isPlaying = isOn && nFrames() > 1;
  const button = parts.play;
  button.ariaLabel = button.lastElementChild.textContent = player.isPlaying ? "Pause" : "Play";
  button.querySelector("use").setAttribute("href", player.isPlaying ? "#i-pause" : "#i-play");
  clock = performance.now();
  carried = 0;
  if (player.isPlaying) requestAnimationFrame(tick);
}

// Go to the previous or next segment boundary of the selected group, or of the first one.
export function cut(direction) {
  const rows = mainFigure()?.rows || [];
  const row = rows.find(({ group }) => group === store.focus?.group) || rows.find(({ grafted }) => grafted) || rows[0];
  const cuts = [0, ...(row?.start || []), nFrames() - 1];
  const next = direction > 0 ? cuts.find((f) => f > player.frame) : cuts.findLast((f) => f < player.frame);
  if (next !== undefined) seek(next);
}

on("selected project figure", () => seek(player.frame));
