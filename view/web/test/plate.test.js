import assert from "node:assert/strict";
import test from "node:test";

import { hull } from "../src/plate.js";

test("the hull has the corners in order, without inner points", () => {
  const corners = [[0, 0], [2, 0], [2, 1], [0, 1]];
  assert.deepEqual(hull([[1, 0.5], ...corners, [1, 0], [0.2, 0.9]]), corners);
});
