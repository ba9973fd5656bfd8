// The timeline: one row of blocks per joint group of each shown figure, and the overview.
import { groupColour, ink, numberColour } from "./colours.js";
import { drawObjectFrames } from "./objects.js";
import { clips, first, nFrames, overview, partAt, rows, scene, shownClips, size, state, toPageFrame } from "./scene.js";

const ROW = 22;
const GAP = 6;
const WIDE_SEAM = 45; // Angle in degrees of a seam whose mark has the full height.

export const timeline = { lines: [], offsets: [], height: 0, gutter: 110 };
let picture = null; // The timeline without its cursor.
let pictureKey = "";

export function layOutRows() {
  const lines = [];
  for (const clip of shownClips()) for (const row of clip.rows) lines.push({ clip, row });
  let breaks = 0;
  const offsets = lines.map((line, i) => {
    if (i && lines[i - 1].clip !== line.clip) breaks++;
    return i * ROW + breaks * GAP;
  });
  const height = lines.length ? offsets[lines.length - 1] + ROW : 0;
  // A selected segment keeps its row.
  const { pinned } = state;
  if (pinned) pinned.line = lines.find(({ row }) => row === pinned.line.row) || pinned.line;
  Object.assign(timeline, { lines, offsets, height });
  rows.hidden = !lines.length;
  rows.style.height = `${height}px`;
}

const span = () => state.window[1] - state.window[0] || 1;
const inner = (wide) => wide - timeline.gutter - 8;
const toX = (frame, wide) => timeline.gutter + ((frame - state.window[0]) / span()) * inner(wide);
export const toFrame = (x, wide) => state.window[0] + ((x - timeline.gutter) / inner(wide)) * span();
export const overviewFrame = (x, wide) => ((x - timeline.gutter) / inner(wide)) * (nFrames - 1);

// The segment of the timeline at a position of the canvas.
export function segmentAt(x, y) {
  const index = timeline.offsets.findIndex((top) => y >= top && y < top + ROW);
  if (index < 0 || x < timeline.gutter) return null;
  const line = timeline.lines[index];
  const part = partAt(line.row, (toFrame(x, rows.clientWidth) * first.dt) / line.clip.dt);
  return part < 0 ? null : { line, part };
}

function fit(context, text, room) {
  if (context.measureText(text).width <= room) return text;
  let length = text.length;
  while (length && context.measureText(`…${text.slice(-length)}`).width > room) length--;
  return length ? `…${text.slice(-length)}` : "";
}

function drawRowName(brush, { clip, row }, top) {
  brush.fillStyle = groupColour(row.group);
  brush.fillRect(0, top + 4, 4, ROW - 8);
  brush.fillStyle = ink.text;
  const group = clips.length > 1 ? ` · ${row.group}` : row.group;
  const room = timeline.gutter - 16 - brush.measureText(group).width;
  brush.fillText((clips.length > 1 ? fit(brush, clip.name, room) : "") + group, 9, top + ROW / 2);
}

// The names that fit into a block, longest first.
function blockNames(source, from, to) {
  const frames = `${from}–${to}`;
  return source === null ? [frames] : [`${source} ${frames}`, source];
}

export const donorName = (row, part) => (row.source[part] < 0 ? null : scene.donors[row.source[part]]);

function drawBlock(brush, top, a, b, { fill, names, seam, isBold }) {
  const width = Math.max(b - a - (b - a > 4 ? 1.5 : 0.3), 0.5);
  brush.fillStyle = fill;
  brush.fillRect(a, top + 1.5, width, ROW - 3);
  if (isBold) {
    brush.strokeStyle = ink.text;
    brush.strokeRect(a + 0.5, top + 2, width - 1, ROW - 4);
  }
  const room = a + width - 8;
  let name = names.find((text) => brush.measureText(text).width <= room - a - 2) || "";
  if (seam !== null) {
    // The mark of a seam is as high as its gap is wide.
    const high = Math.max(3, Math.min(seam / WIDE_SEAM, 1) * (ROW - 3));
    brush.fillStyle = ink.text;
    brush.fillRect(a, top + ROW - 1.5 - high, 2, high);
    const text = `${seam.toFixed(0)}°  ${name}`;
    if (brush.measureText(text).width <= room - a - 2) name = text;
  }
  brush.fillStyle = ink.text;
  brush.fillText(name, a + 6, top + ROW / 2 + 0.5);
}

function drawSegments(brush, { clip, row }, top, wide) {
  const place = (frame) => toX(toPageFrame(clip, frame), wide);
  for (let part = 0; part < row.start.length; part++) {
    const [a, b] = [place(row.start[part]), place(row.stop[part])];
    if (b < timeline.gutter || a > wide) continue;
    const source = donorName(row, part);
    const [from, to] = source === null ? [row.start, row.stop] : [row.first, row.last];
    const names = blockNames(source, from[part], to[part]);
    const cluster = row.cluster[part];
    let fill = source === null ? ink.panel : numberColour(row.source[part]);
    if (state.clusters && cluster >= 0) {
      fill = numberColour(cluster + 3);
      names.unshift(`cluster ${cluster}`, `${cluster}`);
    }
    drawBlock(brush, top, a, b, { fill, names, seam: row.before[part] });
  }
  for (const own of row.changes) {
    const names = blockNames(scene.donors[own.source], own.first, own.last);
    const look = { fill: numberColour(own.source), names, seam: null, isBold: true };
    drawBlock(brush, top, place(own.start), place(own.stop), look);
  }
}

function drawPicture(wide) {
  const key = [state.window, state.shown, state.clusters, rows.width, rows.height, ink.version].join();
  if (picture && key === pictureKey) return;
  pictureKey = key;
  picture = document.createElement("canvas");
  picture.width = rows.width;
  picture.height = rows.height;
  const brush = picture.getContext("2d");
  brush.scale(size.ratio, size.ratio);
  brush.font = "11px system-ui, sans-serif";
  brush.textBaseline = "middle";
  timeline.lines.forEach((line, i) => {
    const top = timeline.offsets[i];
    drawRowName(brush, line, top);
    brush.save();
    brush.beginPath();
    brush.rect(timeline.gutter, top, inner(wide), ROW);
    brush.clip();
    drawSegments(brush, line, top, wide);
    brush.restore();
  });
}

export function drawRows() {
  const { lines, height } = timeline;
  if (!lines.length) return;
  const wide = rows.clientWidth;
  drawPicture(wide);
  const context = rows.getContext("2d");
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, rows.width, rows.height);
  if (rows.width && rows.height) context.drawImage(picture, 0, 0);
  context.setTransform(size.ratio, 0, 0, size.ratio, 0, 0);
  if (state.range) {
    const [a, b] = state.range.map((frame) => Math.max(toX(frame, wide), timeline.gutter));
    context.fillStyle = context.strokeStyle = ink.accent;
    context.globalAlpha = 0.16;
    context.fillRect(a, 0, b - a, height);
    context.globalAlpha = 1;
    for (const x of [a, b]) context.fillRect(x - 0.5, 0, 1, height);
  }
  if (state.hovered) outline(context, state.hovered, wide, 1.2);
  if (state.pinned) outline(context, state.pinned, wide, 2);
  drawCursor(context, toX(state.frame, wide), height);
}

// Outline a segment, and its donor if the donor is in the timeline.
function outline(context, { line, part }, wide, lineWidth) {
  const frame = (target, from, to, dashed) => {
    const index = timeline.lines.indexOf(target);
    if (index < 0) return;
    const a = Math.max(toX(toPageFrame(target.clip, from), wide), timeline.gutter);
    const b = Math.min(toX(toPageFrame(target.clip, to), wide), wide - 8);
    if (b <= a) return;
    Object.assign(context, { strokeStyle: ink.text, lineWidth });
    context.setLineDash(dashed ? [3, 2] : []);
    context.strokeRect(a, timeline.offsets[index] + 1.5, b - a - 1, ROW - 3);
    context.setLineDash([]);
  };
  const { row } = line;
  frame(line, row.start[part], row.stop[part], false);
  const donor = donorName(row, part);
  const home = timeline.lines.find((other) => other.clip.name === donor && other.row.group === row.group);
  if (home) frame(home, row.first[part], row.last[part], true);
}

function drawCursor(context, x, height) {
  if (x < timeline.gutter - 1) return;
  context.fillStyle = ink.accent;
  context.fillRect(x - 1, 0, 2, height);
}

export function drawOverview() {
  const wide = overview.clientWidth;
  const tall = overview.clientHeight;
  const { gutter } = timeline;
  const context = overview.getContext("2d");
  const toPlace = (frame) => gutter + (frame / Math.max(nFrames - 1, 1)) * inner(wide);
  context.setTransform(size.ratio, 0, 0, size.ratio, 0, 0);
  context.clearRect(0, 0, wide, tall);
  context.font = "11px system-ui, sans-serif";
  context.textBaseline = "middle";
  context.fillStyle = ink.faint;
  context.fillText(fit(context, first.energy.length ? "energy" : "whole", gutter - 16), 9, tall / 2);
  context.fillStyle = ink.panel;
  context.fillRect(gutter, 2, inner(wide), tall - 4);
  const [a, b] = state.window.map(toPlace);
  const curve = first.energy;
  const last = toPageFrame(first, first.frames - 1);
  if (curve.length > 1) {
    context.beginPath();
    context.moveTo(toPlace(0), tall - 3);
    curve.forEach((value, i) => context.lineTo(toPlace((i / (curve.length - 1)) * last), tall - 3 - (value / 255) * (tall - 8)));
    context.lineTo(toPlace(last), tall - 3);
    context.fillStyle = ink.faint;
    context.globalAlpha = 0.45;
    context.fill();
    context.globalAlpha = 1;
  }
  drawObjectFrames(context, toPlace, tall);
  if (state.window[0] > 0 || state.window[1] < nFrames - 1) {
    context.strokeStyle = ink.text;
    context.lineWidth = 1.5;
    context.strokeRect(a, 2, Math.max(b - a, 3), tall - 4);
  }
  drawCursor(context, toPlace(state.frame), tall);
}
