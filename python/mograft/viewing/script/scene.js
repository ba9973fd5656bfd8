// The data of the page and the state of the viewer. Names come from files and enter the page as
// text only.
export const root = document.getElementById("mograft");
const stored = document.getElementById("mograft-data");
// The page of the studio contains no figures: it adds them later.
const nothing = { clips: [], groups: [], characters: [], objects: [], windows: {}, shown: 0, height: 1, floor: 0 };
export const scene = stored ? JSON.parse(stored.textContent) : nothing;
export const find = (name) => root.querySelector(`[data-part="${name}"]`);
export const stage = find("stage");
export const marks = find("marks");
export const rows = find("rows");
export const overview = find("overview");
export const isAlone = document.body.classList.contains("alone");
export const clips = scene.clips;
// Frame numbers of the page are those of the first figure.
export const first = clips[0];
export const nFrames = Math.max(1, ...clips.map((clip) => Math.round(((clip.frames - 1) * clip.dt) / first.dt) + 1));
export const size = { width: 1, height: 1, ratio: 1 };

const isNarrow = root.clientWidth < 600;
export const state = {
  frame: 0,
  playing: false,
  speed: 1,
  shown: clips.map((_, i) => i).slice(0, isNarrow ? Math.min(2, scene.shown) : scene.shown),
  overlay: false,
  follow: true,
  stand: 0,
  trails: false,
  floor: true,
  colours: true,
  mesh: true,
  clusters: false,
  loop: false,
  yaw: 0.55,
  pitch: 0.22,
  zoom: 1,
  pan: [0, 0],
  window: [0, nFrames - 1],
  range: null, // Selected frames of the page: [first, last].
  pinned: null,
  hovered: null,
  preview: null, // A donor that replaces the motion of a group in the frames of a segment.
};

export const shownClips = () => state.shown.map((i) => clips[i]);
export const clamp = (value, low, high) => Math.max(low, Math.min(high, value));
export const clipFrame = (clip, frame) => Math.min(Math.round((frame * first.dt) / clip.dt), clip.frames - 1);
export const toPageFrame = (clip, frame) => (frame * clip.dt) / first.dt;

export function create(tag, text, className) {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = text;
  if (className) element.className = className;
  return element;
}

export function createButton(text, title, act) {
  const button = create("button", text);
  button.type = "button";
  button.title = title;
  button.addEventListener("click", act);
  return button;
}

// Index of the segment of a row that contains a frame, or -1.
export function partAt({ start, stop }, frame) {
  const part = start.findLastIndex((own) => own <= frame);
  return part >= 0 && frame <= stop[part] ? part : -1;
}
