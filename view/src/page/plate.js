// The plate from above: the worker faces up, so left is left.
import { FEET, colour, prepared } from "./body.js";

const LEAST_SHOWN_M = 0.62;

export function drawPlate(canvas, frame) {
  const { context, width, height } = prepared(canvas);
  if (!frame) return;
  const { cop_measured: measured, cop_estimated: estimated, cop_sigma: sigma } = frame.state;
  const origins = frame.segment_origin_m;
  const feet = origins ? FEET.map((foot) => foot.map((segment) => origins[segment])) : [];
  const corners = frame.plate_corners_m;
  const seen = corners ?? feet.flat();
  const known = seen.length ? seen : [measured, estimated].filter(Boolean);
  if (!known.length) return;

  // World X (forward) is up, world Y (left) is left.
  const range = [0, 1].map((axis) => known.map((p) => p[axis]));
  const [middleX, middleY] = range.map((values) => (Math.min(...values) + Math.max(...values)) / 2);
  const [spanX, spanY] = range.map((values) => Math.max(LEAST_SHOWN_M, Math.max(...values) - Math.min(...values) + 0.08));
  const scale = Math.min(height / spanX, width / spanY);
  const at = ([x, y]) => [width / 2 - (y - middleY) * scale, height / 2 - (x - middleX) * scale];

  if (corners) {
    path(context, corners.map(at));
    context.closePath();
    context.fillStyle = colour("page");
    context.fill();
    stroke(context, colour("none"), 1.5);
  }
  for (const [heel, ball] of feet) {
    const [ax, ay] = [ball[0] - heel[0], ball[1] - heel[1]];
    // From the heel, a little behind the ankle, to the tip of the toes.
    path(context, [[heel[0] - 0.25 * ax, heel[1] - 0.25 * ay], [ball[0] + 0.3 * ax, ball[1] + 0.3 * ay]].map(at));
    stroke(context, colour("line"), 0.09 * scale);
  }
  if (measured && estimated) {
    path(context, [at(estimated), at(measured)]);
    stroke(context, colour("soft"), 1.5);
  }
  if (estimated) {
    const [x, y] = at(estimated);
    if (sigma) {
      // Two sigma: the true point is inside in about 86 of 100 cases.
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
  if (measured) {
    const [x, y] = at(measured);
    path(context, [[x - 9, y], [x + 9, y]]);
    stroke(context, colour("ink"), 2.5);
    path(context, [[x, y - 9], [x, y + 9]]);
    stroke(context, colour("ink"), 2.5);
  }
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
