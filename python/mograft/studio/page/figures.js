// The figures of the page: encodings of motions and clips, kept up to date by what changed in them.
import { dropActor } from "/viewer/actors.js";
import { loadCharacters } from "/viewer/character.js";
import { load, makePose, smooth } from "/viewer/poses.js";
import { scene } from "/viewer/scene.js";
import { attempt, read } from "./net.js";
import { emit, motionOf, on, store } from "./store.js";

const MAX_HELD = 60; // Figures in memory.
const RETRY_MILLISECONDS = 2000; // After a figure could not be read.
const MAX_LOADING = 3; // Requests for figures at the same time.

const held = new Map(); // "motion:ID" or "clip:NAME" -> {kind, name, clip, asking, isStale}
const waiting = [];
let nLoading = 0;
let characters = null; // Name of the character whose meshes are loaded, and the promise of them.

// The decoded figure, or null while it is loaded: the event "figure" names its key then.
export function figureOf(kind, name) {
  if (name === undefined || name === null || !store.project) return null;
  const key = `${kind}:${name}`;
  const old = held.get(key);
  if (!old && store.project.library?.status === "building") return null;
  const own = old || { key, kind, name, clip: null, asking: null, isStale: false };
  // The figure that was used last is the last one.
  held.delete(key);
  held.set(key, own);
  if (!old) ask(own);
  return own.clip;
}

// Forget the figures that were not used for the longest time.
function forgetOld() {
  for (const own of held.values()) {
    if (held.size <= MAX_HELD) return;
    if (own.clip) forget(own);
  }
}

function ask(own) {
  if (own.asking) {
    own.isStale = true;
    return;
  }
  own.asking = new Promise((resolve) => waiting.push({ own, resolve }));
  startWaiting();
}

function startWaiting() {
  while (waiting.length && nLoading < MAX_LOADING) {
    // Figures on the stage are loaded before those of cards.
    const index = waiting.findIndex(({ own }) => own.name === store.selected);
    const { own, resolve } = waiting.splice(Math.max(index, 0), 1)[0];
    nLoading++;
    attempt(() => update(own)).then(() => {
      nLoading--;
      own.asking = null;
      resolve();
      const isOld = own.isStale && (own.kind !== "motion" || own.clip?.hash !== motionOf(own.name)?.hash);
      own.isStale = false;
      if (isOld) ask(own);
      else if (!own.clip) setTimeout(() => held.get(own.key) === own && held.delete(own.key), RETRY_MILLISECONDS);
      startWaiting();
    });
  }
}

async function update(own) {
  const since = own.clip ? `?since=${encodeURIComponent(own.clip.hash)}` : "";
  const found = await read(`/api/figure/${own.kind}/${encodeURIComponent(own.name)}${since}`);
  if (!held.has(own.key)) return;
  if ("patch" in found && own.clip) {
    const { patch, ...rest } = found;
    if (patch) await applyPatch(own.clip, patch);
    Object.assign(own.clip, rest);
  } else await replace(own, found);
  own.clip.key = own.key;
  forgetOld();
  emit("figure", own.key);
}

async function replace(own, found) {
  if (found.character !== null && found.character !== undefined) await loadMeshes();
  await load(found);
  const old = own.clip;
  const isSame = old && String(old.offsets) === String(found.offsets) && old.character === found.character;
  if (!isSame) {
    if (old) dropGhosts(old);
    if (old) dropActor(old);
    own.clip = found;
    return;
  }
  // The meshes stay bound to the bones.
  Object.assign(old, found, { now: old.now });
}

async function loadMeshes() {
  const wanted = String(store.project.character);
  if (characters?.wanted !== wanted) {
    const loading = (async () => {
      const found = await read("/api/character");
      scene.characters = Array.isArray(found) ? found : [found].filter((one) => one?.parts);
      await loadCharacters();
      // A character is shown as it is; colours of groups are a switch.
      if (scene.characters.length) emit("character");
    })();
    characters = { wanted, loading };
  }
  await characters.loading;
}

// Write the frames of a patch, which has the tracks of the figure.
async function applyPatch(clip, patch) {
  await load(patch);
  clip.values.set(patch.values, patch.first * clip.tracks);
  clip.cameraPath = smooth(clip, Math.round(0.4 / (clip.dt * clip.step)));
}

// Further poses of a figure, by name: for onion skins, and coarse ones for cards. They share its frames.
const ghosts = new Map();
export function ghostOf(clip, name, given = {}) {
  const own = ghosts.get(clip) || new Map();
  ghosts.set(clip, own);
  if (!own.has(name)) own.set(name, Object.assign(Object.create(clip, { now: { value: makePose(clip) } }), given));
  return own.get(name);
}
function dropGhosts(clip) {
  for (const ghost of ghosts.get(clip)?.values() || []) dropActor(ghost);
  ghosts.delete(clip);
}

// Frames of a captured clip, for previews of donors.
const windows = new Map();
export async function windowOf(clip, first, last) {
  const key = JSON.stringify([clip, first, last]);
  if (!windows.has(key)) {
    if (windows.size > 200) windows.delete(windows.keys().next().value);
    const asked = read(`/api/window/${first}/${last}/${encodeURIComponent(clip)}`);
    windows.set(
      key,
      asked.then(async (found) => {
        const source = { moving: [], step: 1, ...found };
        await load(source);
        return { source, shift: -(source.first ?? first) };
      }),
    );
    windows.get(key).catch(() => windows.delete(key));
  }
  return windows.get(key);
}

function forget(own) {
  held.delete(own.key);
  if (!own.clip) return;
  dropGhosts(own.clip);
  dropActor(own.clip);
}

let shape = "";
on("project", () => {
  const { groups, character, skeleton, library } = store.project;
  scene.groups = groups?.names || [];
  if (library?.status === "building") return; // There are no figures until it is ready.
  // Other groups, another mesh or another skeleton change all figures.
  const next = JSON.stringify([groups?.joints, character, skeleton, library?.status === "ready"]);
  if (shape && next !== shape) {
    windows.clear();
    for (const own of held.values()) if (own.clip) own.clip.hash = "";
    for (const own of [...held.values()]) ask(own);
  }
  shape = next;
  for (const own of [...held.values()]) {
    if (own.kind === "clip") continue;
    const motion = motionOf(own.name);
    if (!motion) forget(own);
    else if (own.kind === "motion" && own.clip && own.clip.hash !== motion.hash) ask(own);
  }
});
on("changed", ({ ids }) => {
  for (const id of ids) {
    const own = held.get(`motion:${id}`);
    if (own?.clip) ask(own);
  }
});
