// Requests to the server, and the connection: its events, its loss and its return.
import { find } from "/viewer/scene.js";

const LOST =
  "Connection lost. All changes are saved; the page tries again. If the studio was started again, open its new address.";

export class ServerError extends Error {
  constructor(text, kind, status) {
    super(text);
    this.kind = kind;
    this.status = status;
  }
}

async function request(path, options = {}) {
  let reply;
  try {
    reply = await fetch(path, { credentials: "same-origin", cache: "no-store", ...options });
  } catch {
    lose();
    throw new ServerError("The server of the studio does not answer.", "lost", 0);
  }
  regain();
  const found = reply.headers.get("Content-Type")?.startsWith("application/json") ? await reply.json() : {};
  if (!reply.ok) throw new ServerError(found.error || `The server answered ${reply.status}.`, found.kind, reply.status);
  return found;
}

export const read = (path) => request(path);
export const send = (path, body) =>
  request(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
export function upload(name, body) {
  const headers = { "Content-Type": "application/octet-stream" };
  return request(`/api/files/${encodeURIComponent(name)}`, { method: "PUT", headers, body });
}

// A line below the header, until the reason for it is over.
export function warn(text) {
  const banner = find("banner");
  banner.textContent = text;
  banner.hidden = !text;
}

let hideMessage = 0;
// A short message; errors stay until the next one.
export function say(text, isError = false) {
  const message = find("message");
  clearTimeout(hideMessage);
  message.querySelector("span").textContent = text;
  message.classList.toggle("error", isError);
  message.hidden = !text;
  if (text && !isError) hideMessage = setTimeout(() => (message.hidden = true), 5000);
}

// Run what a person asked for; say what went wrong.
export async function attempt(act, show = (error) => say(error.message, true)) {
  try {
    return await act();
  } catch (error) {
    if (error.kind !== "lost") show(error);
    if (!(error instanceof ServerError)) console.error(error);
    return null;
  }
}

let isLost = false;
function lose() {
  isLost = true;
  document.getElementById("mograft").dataset.connection = "lost";
  warn(LOST);
}

function regain() {
  document.getElementById("mograft").dataset.connection = "open";
  if (isLost) warn("");
  isLost = false;
}

// Listen to events of the server. `onOpen` is called whenever the connection is made, also again.
export function listen(onEvent, onOpen) {
  const source = new EventSource("/api/events");
  source.addEventListener("open", () => {
    regain();
    onOpen();
  });
  source.addEventListener("message", ({ data }) => {
    regain();
    onEvent(JSON.parse(data));
  });
  source.addEventListener("error", () => {
    lose();
    // A refused connection is closed for good: make a new one.
    if (source.readyState !== EventSource.CLOSED) return;
    setTimeout(() => listen(onEvent, onOpen), 1000);
  });
}
