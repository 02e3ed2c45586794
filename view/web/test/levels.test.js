import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import test from "node:test";

const LEVELS = JSON.parse(await readFile(new URL("../../src/levels.json", import.meta.url), "utf8"));

// Linear RGB of `#rrggbb`.
const linear = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
const times = (matrix, v) => matrix.map((row) => Math.min(1, Math.max(0, row.reduce((sum, m, i) => sum + m * v[i], 0))));

// Full deficiencies: Machado, Oliveira & Fernandes 2009, Table 1, severity 1.0.
const VISION = {
  normal: [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
  protanopia: [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
  deuteranopia: [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]],
  tritanopia: [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]],
};

// CIE L*a*b*, D65.
function lab([r, g, b]) {
  const [x, y, z] = [
    (0.4124 * r + 0.3576 * g + 0.1805 * b) / 0.9505, 0.2126 * r + 0.7152 * g + 0.0722 * b, (0.0193 * r + 0.1192 * g + 0.9505 * b) / 1.089,
  ].map((t) => (t > 0.008856 ? Math.cbrt(t) : 7.787 * t + 16 / 116));
  return [116 * y - 16, 500 * (x - y), 200 * (y - z)];
}

test("any two levels differ with every colour vision", () => {
  for (const [vision, matrix] of Object.entries(VISION)) {
    const seen = LEVELS.map(({ colour }) => lab(times(matrix, linear(colour))));
    seen.forEach((a, i) => seen.slice(0, i).forEach((b, k) => {
      const difference = Math.hypot(...a.map((v, axis) => v - b[axis]));
      assert.ok(difference > 20, `${LEVELS[i].name} and ${LEVELS[k].name} differ by ${difference.toFixed(0)} in ${vision}`);
    }));
  }
});

test("levels differ by sign and size too, and signs are legible", () => {
  const luminance = (hex) => times([[0.2126, 0.7152, 0.0722]], linear(hex))[0];
  assert.equal(new Set(LEVELS.map(({ sign }) => sign)).size, LEVELS.length);
  for (const { name, colour, ink, size } of LEVELS) {
    const [dark, light] = [luminance(colour), luminance(ink)].sort((a, b) => a - b);
    assert.ok((light + 0.05) / (dark + 0.05) > 4.5, name);
    assert.ok(size > 0 && size <= 1, name);
  }
});
