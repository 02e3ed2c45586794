import assert from "node:assert/strict";
import test from "node:test";

import { load, number } from "../src/numbers.js";

test("numbers have the language's decimal sign", () => {
  assert.deepEqual(["en", "de", "it"].map((language) => number(6.04, 1, language)), ["6.0", "6,0", "6,0"]);
});

test("a positive load is shown, a negative one is not", () => {
  assert.equal(load(11.26, "en"), "11.3 kg");
  assert.equal(load(11.26, "de"), "11,3 kg");
  for (const none of [undefined, 0, -0.3, -12]) assert.equal(load(none, "it"), "–");
});
