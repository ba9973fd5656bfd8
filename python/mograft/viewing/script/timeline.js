// The timeline: one row of segments per joint group of each shown figure, and the overview.
import { clusterColour, groupColour, ink } from "./colours.js";
import { drawObjectFrames } from "./objects.js";
import { clips, first, nFrames, overview, partAt, rows, scene, shownClips, size, state, toPageFrame } from "./scene.js";

const ROW = 18;
const GAP = 6;

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
  let low = 0;
  let high = text.length;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (context.measureText(`…${text.slice(-middle)}`).width <= room) low = middle;
    else high = middle - 1;
  }
  return low ? `…${text.slice(-low)}` : "";
}

function hatch(context) {
  const tile = document.createElement("canvas");
  tile.width = tile.height = 6 * size.ratio;
  const brush = tile.getContext("2d");
  brush.scale(size.ratio, size.ratio);
  brush.strokeStyle = ink.dark ? "rgba(255,255,255,.42)" : "rgba(0,0,0,.34)";
  brush.lineWidth = 1.2;
  for (const shift of [-6, 0, 6]) {
    brush.moveTo(shift, 6);
    brush.lineTo(shift + 6, 0);
  }
  brush.stroke();
  const pattern = context.createPattern(tile, "repeat");
  pattern.setTransform(new DOMMatrix().scale(1 / size.ratio));
  return pattern;
}

function drawRowName(brush, line, top) {
  brush.fillStyle = groupColour(line.row.group);
  brush.fillRect(0, top + 3, 4, ROW - 6);
  brush.fillStyle = ink.text;
  const many = clips.length > 1;
  const group = many ? ` · ${line.row.group}` : "";
  const room = timeline.gutter - 16 - brush.measureText(group).width;
  const name = many ? fit(brush, line.clip.name, room) + group : fit(brush, line.row.group, room);
  brush.fillText(name, 9, top + ROW / 2);
}

function drawSegments(brush, line, top, wide, stripes) {
  const { start, stop, cluster, source } = line.row;
  for (let part = 0; part < start.length; part++) {
    const a = toX(toPageFrame(line.clip, start[part]), wide);
    const b = toX(toPageFrame(line.clip, stop[part]), wide);
    if (b < timeline.gutter || a > wide) continue;
    const width = Math.max(b - a - (b - a > 4 ? 1.5 : 0.3), 0.5);
    // Without clusters, the colour of an exchanged segment is that of the clip of its donor.
    brush.fillStyle = clusterColour(cluster[part] < 0 ? source[part] : cluster[part]);
    brush.fillRect(a, top + 1.5, width, ROW - 3);
    if (source[part] >= 0) {
      brush.fillStyle = b - a > 3 ? stripes : "rgba(0,0,0,.2)";
      brush.fillRect(a, top + 1.5, width, ROW - 3);
    }
    const number = `${cluster[part]}`;
    if (cluster[part] < 0 || b - a <= 7 * number.length + 6) continue;
    const middle = a + width / 2;
    const room = brush.measureText(number).width + 5;
    if (source[part] >= 0) {
      brush.fillStyle = clusterColour(cluster[part]);
      brush.fillRect(middle - room / 2, top + 3, room, ROW - 6);
    }
    brush.fillStyle = ink.dark ? "#fff" : "#111";
    brush.textAlign = "center";
    brush.fillText(number, middle, top + ROW / 2 + 0.5);
    brush.textAlign = "left";
  }
}

function drawPicture(wide) {
  const key = [state.window, state.shown, rows.width, rows.height, ink.version].join();
  if (picture && key === pictureKey) return;
  pictureKey = key;
  picture = document.createElement("canvas");
  picture.width = rows.width;
  picture.height = rows.height;
  const brush = picture.getContext("2d");
  brush.scale(size.ratio, size.ratio);
  brush.font = "11px system-ui, sans-serif";
  brush.textBaseline = "middle";
  const stripes = hatch(brush);
  timeline.lines.forEach((line, i) => {
    const top = timeline.offsets[i];
    drawRowName(brush, line, top);
    brush.save();
    brush.beginPath();
    brush.rect(timeline.gutter, top, inner(wide), ROW);
    brush.clip();
    drawSegments(brush, line, top, wide, stripes);
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
  for (const [chosen, strong] of [
    [state.hovered, false],
    [state.pinned, true],
  ]) {
    if (chosen) outline(context, chosen, wide, strong);
  }
  drawCursor(context, toX(state.frame, wide), height);
}

// Outline a segment, and its donor if the donor is in the timeline.
function outline(context, { line, part }, wide, strong) {
  const frame = (target, from, to, dashed) => {
    const index = timeline.lines.indexOf(target);
    if (index < 0) return;
    const a = Math.max(toX(toPageFrame(target.clip, from), wide), timeline.gutter);
    const b = Math.min(toX(toPageFrame(target.clip, to), wide), wide - 8);
    if (b <= a) return;
    context.strokeStyle = ink.text;
    context.lineWidth = strong ? 2 : 1.2;
    context.setLineDash(dashed ? [3, 2] : []);
    context.strokeRect(a, timeline.offsets[index] + 1.5, b - a - 1, ROW - 3);
    context.setLineDash([]);
  };
  const { row } = line;
  frame(line, row.start[part], row.stop[part], false);
  if (row.source[part] < 0) return;
  const donor = scene.donors[row.source[part]];
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
