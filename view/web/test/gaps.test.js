import assert from "node:assert/strict";
import test from "node:test";

import { withGaps } from "../src/gaps.js";

test("a gap in the data interrupts the curve", () => {
  assert.deepEqual(withGaps([[0, 1, 4, 5], [7, 8, 9, 6]], 1), [[0, 1, 2.5, 4, 5], [7, 8, null, 9, 6]]);
});

test("data without gaps and empty data are unchanged", () => {
  assert.deepEqual(withGaps([[0, 1], [7, null], [1, 2]], 1), [[0, 1], [7, null], [1, 2]]);
  assert.deepEqual(withGaps([[], []], 1), [[], []]);
});
