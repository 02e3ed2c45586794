// Plate from above. World X (forward) is up, world Y (left) is left.
import { FEET, prepared } from "./body.js";
import { colour } from "./theme.js";

const SHOWN_MIN_M = 0.62;

// Ankle and ball of each foot; none while the position of the body in the station is invalid.
export function feetOf({ segment_origin_m: origins, withheld }) {
  return origins && !withheld?.com ? FEET.map((foot) => foot.map((segment) => origins[segment])) : [];
}

// `trail`: earlier measured CoP, in order, with nothing in gaps.
export function drawPlate(canvas, frame, trail) {
  const { context, width, height } = prepared(canvas);
  if (!frame) return;
  const { cop_measured: measured, cop_estimated: estimated, cop_sigma: sigma } = frame.state;
  const feet = feetOf(frame);
  const corners = frame.plate_corners_m;
  const outline = corners ?? feet.flat();
  const shown = outline.length ? outline : [measured, estimated].filter(Boolean);
  if (!shown.length) return;

  const range = [0, 1].map((axis) => shown.map((p) => p[axis]));
  const [middleX, middleY] = range.map((values) => (Math.min(...values) + Math.max(...values)) / 2);
  const [spanX, spanY] = range.map((values) => Math.max(SHOWN_MIN_M, Math.max(...values) - Math.min(...values) + 0.08));
  const scale = Math.min(height / spanX, width / spanY);
  const at = ([x, y]) => [width / 2 - (y - middleY) * scale, height / 2 - (x - middleX) * scale];

  if (corners) {
    path(context, corners.map(at));
    context.closePath();
    context.fillStyle = colour("page");
    context.fill();
    stroke(context, colour("none"), 1.5);
  }
  if (feet.length) {
    // Support polygon.
    path(context, hull(feet.flatMap(footOutline)).map(at));
    context.closePath();
    context.fillStyle = colour("pressed");
    context.fill();
    context.setLineDash([5, 4]);
    stroke(context, colour("soft"), 1.2);
    context.setLineDash([]);
  }
  for (const [heel, ball] of feet) {
    const [ax, ay] = [ball[0] - heel[0], ball[1] - heel[1]];
    // From the heel, a little behind the ankle, to the tip of the toes.
    path(context, [[heel[0] - 0.25 * ax, heel[1] - 0.25 * ay], [ball[0] + 0.3 * ax, ball[1] + 0.3 * ay]].map(at));
    stroke(context, colour("line"), 0.09 * scale);
  }
  context.globalAlpha = 0.45;
  for (const [i, to] of trail.entries()) {
    const from = trail[i - 1];
    if (!from || !to) continue;
    path(context, [at(from), at(to)]);
    stroke(context, colour("soft"), 1);
  }
  context.globalAlpha = 1;
  if (measured && estimated) {
    path(context, [at(estimated), at(measured)]);
    stroke(context, colour("soft"), 1.5);
  }
  if (estimated) {
    const [x, y] = at(estimated);
    if (sigma) {
      // 2σ ellipse: contains the true point with a probability of 86 %.
      context.beginPath();
      context.ellipse(x, y, Math.max(2, 2 * sigma[1] * scale), Math.max(2, 2 * sigma[0] * scale), 0, 0, 2 * Math.PI);
      context.globalAlpha = 0.22;
      context.fillStyle = colour("you");
      context.fill();
      context.globalAlpha = 1;
    }
    context.beginPath();
    context.arc(x, y, 6, 0, 2 * Math.PI);
    stroke(context, colour("you"), 3);
  }
  const { com, suit_com: suitCom } = frame.state;
  if (com) {
    context.beginPath();
    context.arc(...at(com), 3.5, 0, 2 * Math.PI);
    context.fillStyle = colour("you");
    context.fill();
  }
  if (suitCom) {
    // Centre of mass by the suit's software, from an average body.
    const [x, y] = at(suitCom);
    path(context, [[x, y - 6], [x + 6, y], [x, y + 6], [x - 6, y]]);
    context.closePath();
    stroke(context, colour("soft"), 2);
  }
  if (measured) {
    const [x, y] = at(measured);
    path(context, [[x - 9, y], [x + 9, y]]);
    stroke(context, colour("ink"), 2.5);
    path(context, [[x, y - 9], [x, y + 9]]);
    stroke(context, colour("ink"), 2.5);
  }
}

// Corners of a foot outline from ankle and ball of the foot: it extends 0.33 of their distance behind the ankle and 0.4 in
// front of the ball.
function footOutline([heel, ball]) {
  const [ax, ay] = [ball[0] - heel[0], ball[1] - heel[1]];
  const length = Math.max(Math.hypot(ax, ay), 1e-6);
  const side = [-ay / length * 0.045, ax / length * 0.045];
  return [-0.33, 1.4].flatMap((k) => [1, -1].map((s) => [heel[0] + k * ax + s * side[0], heel[1] + k * ay + s * side[1]]));
}

// Convex hull, counterclockwise (Andrew's monotone chain).
export function hull(points) {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const turns = (o, a, b) => (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
  const half = (ordered) => {
    const chain = [];
    for (const point of ordered) {
      while (chain.length > 1 && turns(chain.at(-2), chain.at(-1), point) <= 0) chain.pop();
      chain.push(point);
    }
    return chain.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

function path(context, points) {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
}

function stroke(context, style, width) {
  context.strokeStyle = style;
  context.lineWidth = width;
  context.lineCap = "round";
  context.stroke();
}
