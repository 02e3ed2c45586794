// 2D figure, for browsers without WebGL.
import { FEET, bones, cobotBones, headCentre, prepared, cornersOf } from "./body.js";
import { isPlaced } from "./match.js";
import { Pen } from "./pen.js";
import { colour } from "./theme.js";

export class Figure2d {
  constructor(canvas) {
    this.canvas = canvas;
  }

  recolour() {}

  // `frame` is null while no data are available. `deviations`: angle of each limb from the suggested pose, rad.
  draw(view, frame, faded, deviations, reachedRad) {
    const { context } = prepared(this.canvas);
    const pen = new Pen(context, view.project);
    const origins = frame?.segment_origin_m;
    drawFloor(pen, view.centre, cornersOf(frame));
    if (frame?.cobot) drawBones(pen, cobotBones(frame.cobot), (segment) => colour(segment === "part" ? "load" : "none"));
    if (!origins) return;
    if (frame.suggested) drawGhost(context, pen, frame.suggested.segment_origin_m, (segment) => colour(isPlaced(segment, deviations, reachedRad) ? "placed" : "ghost"));
    drawShadow(pen, origins, view.centre[2]);
    drawBody(pen, origins, () => colour(faded ? "none" : "you"));
  }
}

function drawFloor(pen, [x, y, z], plate) {
  const [x0, y0] = [Math.round(x * 4) / 4, Math.round(y * 4) / 4];
  for (let k = -4; k <= 4; k += 1) {
    const at = k * 0.25;
    pen.line([[x0 + at, y0 - 1, z], [x0 + at, y0 + 1, z]], colour("grid"), 0, 1);
    pen.line([[x0 - 1, y0 + at, z], [x0 + 1, y0 + at, z]], colour("grid"), 0, 1);
  }
  if (plate) pen.area(plate.map((corner) => [...corner, z]), colour("plate"), colour("soft"));
}

function drawBones(pen, all, styleOf, thickness = 1) {
  for (const { from, to, radius, segment } of all) pen.line([from, to], styleOf(segment), 2 * radius * thickness);
}

function drawBody(pen, origins, styleOf, thickness = 1) {
  drawBones(pen, bones(origins), styleOf, thickness);
  pen.disc(headCentre(origins), 0.105 * thickness, styleOf());
}

// Drawn opaque on a separate canvas, then blended once: otherwise overlapping limbs would be darker.
function drawGhost(context, pen, origins, styleOf) {
  const { canvas } = context;
  const layer = new OffscreenCanvas(canvas.width, canvas.height);
  const above = layer.getContext("2d");
  above.setTransform(context.getTransform());
  drawBody(new Pen(above, pen.project), origins, styleOf, 1.1);
  context.save();
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.globalAlpha = 0.62;
  context.drawImage(layer, 0, 0);
  context.restore();
}

function drawShadow(pen, origins, floor) {
  pen.context.globalAlpha = 0.12;
  for (const [heel, toe] of FEET) {
    const flat = [heel, toe].map((segment) => [...origins[segment].slice(0, 2), floor]);
    pen.line(flat, "#000", 0.13);
  }
  pen.context.globalAlpha = 1;
}
