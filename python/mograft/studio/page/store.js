// The state of the server, what is selected in the page, and who listens to changes of them.
import { attempt, read, say, send, warn } from "./net.js";
import { sentence } from "./ui.js";

export const store = {
  project: null, // The state of the server.
  selected: null, // Identity of the motion on the stage; null for the clip that is chosen as base.
  clip: null, // Name of that clip.
  focus: null, // Selected frames: {group or null, first, last, part or null}.
  layout: "beside", // How the base is shown: "beside", "overlay" or "graft".
  follow: true,
  onion: false,
  floor: true,
  loop: false,
  mode: "view", // What a pointer does on the stage: "view", "draw" a path, or choose joints for "groups".
};

const listeners = new Map();
export function on(kinds, listener) {
  for (const kind of kinds.split(" ")) listeners.set(kind, [...(listeners.get(kind) || []), listener]);
}
// An error of one listener does not keep the others from hearing.
export function emit(kind, detail) {
  for (const listener of listeners.get(kind) || []) {
    try {
      listener(detail);
    } catch (error) {
      console.error(error);
    }
  }
}

export const motions = () => store.project?.motions || [];
export const motionOf = (id) => motions().find((own) => own.id === id);
export const selected = () => motionOf(store.selected);

let asked = null;
let isWanted = false;
// Read the state of the server; calls during a read cause one more.
export function refresh() {
  isWanted = true;
  asked ||= (async () => {
    while (isWanted) {
      isWanted = false;
      const project = await attempt(() => read("/api/state"));
      if (project) accept(project);
    }
  })().finally(() => (asked = null));
  return asked;
}

function accept(project) {
  if (project.revision < store.project?.revision && project.file === store.project.file) return;
  const before = store.selected;
  const isFirst = !motions().length;
  store.project = project;
  if (before === null ? isFirst : !motionOf(before)) store.selected = project.motions[0]?.id ?? null;
  if (store.selected !== before) store.focus = null;
  emit("project");
  if (store.selected !== before) emit("selected");
}

export function select(id) {
  if (id === store.selected && id !== null) return;
  store.selected = id;
  store.focus = null;
  emit("selected");
  emit("focus");
}

export function focusOn(focus) {
  store.focus = focus;
  emit("focus");
}

// A preview of a motion is not in the state of the server.
function showPreview({ motions: ids, hash, violations }) {
  const motion = motionOf(ids[0]);
  if (motion) Object.assign(motion, { hash, violations });
  emit("project");
}

let last = Promise.resolve();
// Ask for a change; the reply names the changed motions. Changes are asked for one after the other,
// as each is one of the state that the one before leads to. Previews do not wait.
export function act(action, given) {
  if (action.preview) return ask(action, given);
  last = last.then(() => ask(action, given));
  return last;
}

async function ask(action, { isQuiet = false, said = "" } = {}) {
  const body = { ...action, revision: action.preview ? null : (store.project?.revision ?? null) };
  const reply = await attempt(async () => {
    try {
      return await send("/api/do", body);
    } catch (error) {
      if (error.kind !== "stale") throw error;
      await refresh();
      warn("");
      say("The project changed elsewhere. The page shows the new state; repeat the change if it is still wanted.", true);
      return null;
    }
  });
  if (!reply) return null;
  if (!isQuiet) say(said || (reply.message && `${sentence(`done: ${reply.message}`)}.`));
  if (reply.hash) showPreview(reply);
  emit("changed", { ids: reply.motions || [] });
  if (!action.preview) await refresh();
  return reply;
}
