import assert from "node:assert/strict";
import test from "node:test";

import { HANDS, PARENT } from "../src/body.js";
import { View } from "../src/view.js";

// Upright, feet on the floor, arms out: right to -Y, left to +Y, as in the station's world.
function standing() {
  const origins = PARENT.map((_, segment) => [0, 0, segment < 7 ? 1 + 0.1 * segment : 1.4]);
  [7, 8, 9, 10].forEach((segment, i) => { origins[segment] = [0, -0.15 * (i + 1), 1.4]; });
  [11, 12, 13, 14].forEach((segment, i) => { origins[segment] = [0, 0.15 * (i + 1), 1.4]; });
  for (const [hip, side] of [[15, -0.1], [19, 0.1]]) [0.9, 0.5, 0.08, 0.02].forEach((z, i) => { origins[hip + i] = [i === 3 ? 0.15 : 0, side, z]; });
  return origins;
}

function viewed(azimuth, mirrored) {
  const view = new View({ addEventListener() {} }, () => {});
  view.look(azimuth, mirrored);
  view.update({ segment_origin_m: standing() }, 1200, 800);
  return view;
}

test("in the mirror the right hand is on the right, from the front on the left", () => {
  const [right, left] = HANDS.map((hand) => standing()[hand]);
  const across = (view) => view.project(right)[0] - view.project(left)[0];
  assert.ok(across(viewed(0, true)) > 100);
  assert.ok(across(viewed(0, false)) < -100);
  assert.ok(across(viewed(180, false)) > 100, "from behind as in the mirror");
});

test("the whole worker is in view and fills most of its height", () => {
  const view = viewed(20, true);
  for (const point of standing()) {
    const [x, y] = view.project(point);
    assert.ok(x > 0 && x < 1200 && y > 0 && y < 800, String(point));
  }
  assert.ok(view.figurePx > 0.7 * 800 && view.figurePx < 800);
});

test("a turn follows the drag in the mirror too", () => {
  for (const mirrored of [false, true]) {
    const view = viewed(0, mirrored);
    const toes = standing()[18];
    const before = view.project(toes)[0];
    view.turn(-10, 0);
    view.update({ segment_origin_m: standing() }, 1200, 800);
    assert.ok(view.project(toes)[0] > before, "dragged to the right");
  }
});
