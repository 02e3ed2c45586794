import assert from "node:assert/strict";
import test from "node:test";

import { trailOf, withGaps } from "../src/gaps.js";

test("a gap in the data interrupts the curve", () => {
  assert.deepEqual(withGaps([[0, 1, 4, 5], [7, 8, 9, 6]], 1), [[0, 1, 2.5, 4, 5], [7, 8, null, 9, 6]]);
});

test("data without gaps and empty data are unchanged", () => {
  assert.deepEqual(withGaps([[0, 1], [7, null], [1, 2]], 1), [[0, 1], [7, null], [1, 2]]);
  assert.deepEqual(withGaps([[], []], 1), [[], []]);
});

test("no line joins the CoP before a gap with that after it", () => {
  const row = (t, cop) => Object.assign([t, 1, 2, 3, -3], { cop });
  assert.deepEqual(trailOf([row(0, [0, 0]), row(0.1, [1, 0]), row(3, [2, 0])]), [[0, 0], [1, 0], null, [2, 0]]);
  assert.deepEqual(trailOf([row(0, [0, 0]), row(0.1)]), [[0, 0], undefined]);
});
