import assert from "node:assert/strict";
import test from "node:test";

import { withHoles } from "../src/holes.js";

test("nothing is drawn where nothing was told", () => {
  assert.deepEqual(withHoles([[0, 1, 4, 5], [7, 8, 9, 6]], 1), [[0, 1, 2.5, 4, 5], [7, 8, null, 9, 6]]);
});

test("what came in time stays as it was, and nothing stays nothing", () => {
  assert.deepEqual(withHoles([[0, 1], [7, null], [1, 2]], 1), [[0, 1], [7, null], [1, 2]]);
  assert.deepEqual(withHoles([[], []], 1), [[], []]);
});
