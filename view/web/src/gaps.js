// Longer gaps in the residual and the measured CoP are not bridged, s.
export const RESIDUAL_GAP_S = 0.5;

// Inserts a row of nulls into each gap longer than `gapAfter`, so that charts do not interpolate across missing data. The first
// column is time, s.
export function withGaps([t, ...columns], gapAfter) {
  const rows = t.map((at, i) => [at, ...columns.map((column) => column[i])]);
  const filled = rows.flatMap((row, i) => (i && row[0] - rows[i - 1][0] > gapAfter ? [[(row[0] + rows[i - 1][0]) / 2, ...columns.map(() => null)], row] : [row]));
  return [t, ...columns].map((_, k) => filled.map((row) => row[k]));
}

// The measured CoP of the residual's rows, in order; nothing where it is not valid and in gaps.
export const trailOf = (rows) => withGaps([rows.map(([t]) => t), rows.map(({ cop }) => cop)], RESIDUAL_GAP_S)[1];
