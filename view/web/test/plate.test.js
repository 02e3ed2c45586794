import assert from "node:assert/strict";
import test from "node:test";

import { cornersOf } from "../src/body.js";
import { feetOf, hull } from "../src/plate.js";

test("the hull has the corners in order, without inner points", () => {
  const corners = [[0, 0], [2, 0], [2, 1], [0, 1]];
  assert.deepEqual(hull([[1, 0.5], ...corners, [1, 0], [0.2, 0.9]]), corners);
});

test("no foot is drawn while the position of the body is invalid", () => {
  const segment_origin_m = Array.from({ length: 23 }, (_, i) => [i, 0, 0]);
  assert.equal(feetOf({ segment_origin_m }).length, 2);
  assert.equal(feetOf({ segment_origin_m, withheld: { moving: "moving" } }).length, 2);
  assert.deepEqual(feetOf({ segment_origin_m, withheld: { com: "position_unknown" } }), []);
  assert.deepEqual(feetOf({}), []);
});

test("no plate is drawn next to a body whose position in the station is invalid", () => {
  const plate_corners_m = [[0, 0], [1, 0], [1, 1], [0, 1]];
  const corners = (valid) => cornersOf({ state: { valid }, plate_corners_m });
  assert.deepEqual([corners(["moving"]), corners(["position_unknown"]), cornersOf(null)], [plate_corners_m, undefined, undefined]);
});
