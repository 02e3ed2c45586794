// Columns over time, the first of them in seconds, with a row of nothing wherever nothing was told for longer than `holeAfter`:
// a curve that goes on across it would tell what nobody knows.
export function withHoles([t, ...columns], holeAfter) {
  const rows = t.map((at, i) => [at, ...columns.map((column) => column[i])]);
  const whole = rows.flatMap((row, i) => (i && row[0] - rows[i - 1][0] > holeAfter ? [[(row[0] + rows[i - 1][0]) / 2, ...columns.map(() => null)], row] : [row]));
  return [t, ...columns].map((_, k) => whole.map((row) => row[k]));
}
