// The stage: floor, trails, figures and objects.
import { views } from "./camera.js";
import { groupColour, ink } from "./colours.js";
import { drawObjects } from "./objects.js";
import { pose } from "./poses.js";
import { clipFrame, scene, size, stage, state } from "./scene.js";

const pen = stage.getContext("2d");

function drawFloor(view) {
  const step = view.tall / 3;
  const [cx, , cz] = view.target.map((value) => Math.round(value / step) * step);
  const reach = 9;
  pen.strokeStyle = ink.line;
  pen.lineWidth = 1;
  for (let i = -reach; i <= reach; i++) {
    // Lines fade with distance, so that the floor has no visible edge.
    for (let k = -reach; k < reach; k++) {
      const away = Math.hypot(i, k + 0.5) / reach;
      if (away >= 1) continue;
      pen.globalAlpha = 1 - away * away;
      pen.beginPath();
      view.line([cx + i * step, scene.floor, cz + k * step], [cx + i * step, scene.floor, cz + (k + 1) * step]);
      view.line([cx + k * step, scene.floor, cz + i * step], [cx + (k + 1) * step, scene.floor, cz + i * step]);
      pen.stroke();
    }
  }
  pen.globalAlpha = 1;
}

function drawTrails(clip, frame, view) {
  const back = Math.round(1.5 / clip.dt);
  const step = Math.max(1, clip.step, Math.round(1 / 30 / clip.dt));
  const place = new Float32Array(clip.nodes * 3);
  const trails = clip.tips.map(() => []);
  for (let f = Math.max(0, frame - back); f <= frame; f += step) {
    pose(clip, f, place);
    clip.tips.forEach((tip, i) => trails[i].push(view.point(place[tip * 3], place[tip * 3 + 1], place[tip * 3 + 2])));
  }
  pen.lineWidth = 1.6;
  trails.forEach((trail, i) => {
    pen.strokeStyle = groupColour(clip.groups[clip.group[clip.tips[i]]]);
    for (let k = 1; k < trail.length; k++) {
      pen.globalAlpha = (0.75 * k) / trail.length;
      pen.beginPath();
      pen.moveTo(trail[k - 1][0], trail[k - 1][1]);
      pen.lineTo(trail[k][0], trail[k][1]);
      pen.stroke();
    }
  });
  pen.globalAlpha = 1;
}

function drawShadow(lines, view, alpha) {
  // One stroke for all bones: the shadow is not darker where they cross.
  pen.globalAlpha = 0.14 * alpha;
  pen.strokeStyle = ink.text;
  pen.lineWidth = Math.max(1.5, 0.026 * view.tall * lines[0][0][2]);
  pen.lineJoin = "round";
  pen.beginPath();
  for (const [from, to] of lines) {
    pen.moveTo(from[0], from[1]);
    pen.lineTo(to[0], to[1]);
  }
  pen.stroke();
}

function drawFigure(clip, view, alpha) {
  const { now } = clip;
  const bones = [];
  const shadow = [];
  pen.lineCap = "round";
  for (let node = 0; node < clip.nodes; node++) {
    const above = clip.parents[node];
    if (above < 0) continue;
    const a = [now[above * 3], now[above * 3 + 1], now[above * 3 + 2]];
    const b = [now[node * 3], now[node * 3 + 1], now[node * 3 + 2]];
    bones.push([view.point(...a), view.point(...b), node]);
    if (state.floor) shadow.push([view.point(a[0], scene.floor, a[2]), view.point(b[0], scene.floor, b[2])]);
  }
  if (shadow.length) drawShadow(shadow, view, alpha);
  // Farther bones are drawn first.
  bones.sort((p, q) => p[0][2] + p[1][2] - q[0][2] - q[1][2]);
  for (const [from, to, node] of bones) {
    const wide = Math.max(1.5, 0.02 * view.tall * 0.5 * (from[2] + to[2]) * clip.width[node]);
    const colour = groupColour(clip.groups[clip.group[clip.parents[node]]]);
    // A rim along the sides separates crossing limbs; the joints have none.
    for (const [width, style, cap] of [
      [wide + 3, ink.paper, "butt"],
      [wide, colour, "round"],
    ]) {
      pen.globalAlpha = alpha;
      pen.strokeStyle = style;
      pen.lineWidth = width;
      pen.lineCap = cap;
      pen.beginPath();
      pen.moveTo(from[0], from[1]);
      pen.lineTo(to[0], to[1]);
      pen.stroke();
    }
  }
  pen.globalAlpha = 1;
}

function drawBorders(places) {
  pen.strokeStyle = ink.line;
  pen.lineWidth = 1;
  for (const [left, top, wide, tall] of places) {
    pen.beginPath();
    if (left > 0) {
      pen.moveTo(left + 0.5, top);
      pen.lineTo(left + 0.5, top + tall);
    }
    if (top > 0) {
      pen.moveTo(left, top + 0.5);
      pen.lineTo(left + wide, top + 0.5);
    }
    pen.stroke();
  }
}

export function drawStage() {
  const { width, height, ratio } = size;
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  const shown = views(pen);
  shown.forEach(({ clip, view }, i) => {
    const frame = clipFrame(clip, state.frame);
    const isFirst = !state.overlay || i === 0;
    pose(clip, frame, clip.now);
    pen.save();
    pen.beginPath();
    pen.rect(...view.tile);
    pen.clip();
    if (state.floor && isFirst) drawFloor(view);
    if (isFirst) drawObjects(pen, { clip, view }, true);
    if (state.trails) drawTrails(clip, frame, view);
    drawFigure(clip, view, isFirst ? 1 : 0.5);
    if (!state.overlay || i === shown.length - 1) drawObjects(pen, { clip, view }, false);
    pen.restore();
  });
  if (!state.overlay) drawBorders(shown.map(({ view }) => view.tile));
}
